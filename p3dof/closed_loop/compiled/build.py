"""From C to a function that Python can call: a compiler, and a cache by content."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from p3dof.errors import MissingExtraError, ModelError

LEVELS = {
    "auto": ("-march=native",),
    "avx512": ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mavx2", "-mfma"),
    "avx2": ("-mavx2", "-mfma"),
    "baseline": (),
}
"""Instructions that may be used, by name: those of this processor, or of a family."""
_FLAGS = ("-O2", "-std=gnu11", "-g0", "-shared", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-w")
_CONTRACT = ("-ffp-contract=fast",)
_SECONDS = 300.0
"""Longest time that a compiler gets."""


@cache
def compiler() -> str | None:
    """Return the path of a C compiler that knows vector types, None if there is none."""
    wanted = os.environ.get("CC", "")
    for name in (*shlex.split(wanted)[:1], "gcc", "clang", "cc"):
        found = shutil.which(name)
        if found and sys.platform != "win32":
            return found
    return None


@cache
def _version(program: str) -> str:
    done = subprocess.run([program, "--version"], capture_output=True, text=True, check=False, timeout=60)  # noqa: S603 - found on the path
    return done.stdout.splitlines()[0] if done.stdout else program


@cache
def _processor() -> str:
    """Return what tells this processor's instructions from another's, for a cache on a shared disk."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
        return next(line for line in lines if line.startswith(("flags", "Features")))
    except (OSError, StopIteration):
        return platform.machine() + platform.processor()


def libraries(sources: Sequence[str], level: str = "auto") -> list[ctypes.CDLL]:
    """Return shared libraries of C sources; those that were compiled before come from the cache.

    Parameters
    ----------
    sources : sequence of str
        Texts of C; several are compiled side by side.
    level : str
        One of `LEVELS`.

    Returns
    -------
    list of ctypes.CDLL

    Raises
    ------
    MissingExtraError
        If there is no C compiler.
    ModelError
        If it fails, or takes longer than five minutes.
    """
    program = compiler()
    if program is None:
        raise MissingExtraError("compiling needs a C compiler, gcc or clang, on the path")
    command = [program, *_FLAGS, *_CONTRACT, *LEVELS[level]]
    with tempfile.TemporaryDirectory(prefix="p3dof-") as scratch:
        folder = _cache() or Path(scratch)
        paths = [folder / f"{_key(command, source)}.so" for source in sources]
        pending = [(s, p) for s, p in zip(sources, paths, strict=True) if not p.exists()]
        running = [_start(command, source, Path(scratch) / f"{i}") for i, (source, _) in enumerate(pending)]
        for job, (_, path) in zip(running, pending, strict=True):
            _finish(job, path)
        return [ctypes.CDLL(str(path)) for path in paths]


def _key(command: Sequence[str], source: str) -> str:
    parts = (*command, _version(command[0]), _processor(), source)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _start(command: Sequence[str], source: str, base: Path) -> tuple[subprocess.Popen[str], Path]:
    text, made = base.with_suffix(".c"), base.with_suffix(".so")
    text.write_text(source, encoding="ascii")
    call = [*command, "-o", str(made), str(text), "-lm"]
    job = subprocess.Popen(call, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)  # noqa: S603 - a compiler with our own text
    return job, made


def _finish(running: tuple[subprocess.Popen[str], Path], path: Path) -> None:
    job, made = running
    try:
        _, told = job.communicate(timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        job.kill()
        job.communicate()
        raise ModelError(f"the C compiler took longer than {_SECONDS:g} s") from None
    except BaseException:
        job.kill()
        job.communicate()
        raise
    if job.returncode:
        raise ModelError(f"the C compiler failed: {told.strip()[:300]}")
    if path.parent == made.parent:
        made.replace(path)
        return
    beside = path.with_name(f"{path.stem}.{os.getpid()}.tmp")
    shutil.copy(made, beside)
    beside.replace(path)  # whole or not at all


def _cache() -> Path | None:
    """Return the folder of what was compiled before; None if others can put code into it."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    folder = (Path(base) if base else Path.home() / ".cache") / "p3dof" / "loops"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        told = folder.stat()
    except OSError:
        return None
    ours = not hasattr(os, "getuid") or told.st_uid == os.getuid()
    writable = told.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return folder if ours and not writable and os.access(folder, os.W_OK) else None
