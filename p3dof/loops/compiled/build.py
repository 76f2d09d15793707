"""From C to a function that Python can call: a compiler, and a cache by content.

A library that is kept has two hashes in its name: of what it was made from, by which it is looked for, and of
its own bytes, which it must have before it is loaded: what is cut off would end the process. The folder, and
all above it, are this user's or the system's, and nobody else can write there.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import platform
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from p3dof._base.errors import LOG, MissingExtraError, ModelError
from p3dof._base.files import reason, scratch_folder, write_atomic

LEVELS = {
    "auto": ("-march=native",),
    "avx512": ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mavx2", "-mfma"),
    "avx2": ("-mavx2", "-mfma"),
    "baseline": (),
}
"""Instructions that may be used, by name: those of this processor, or of a family."""
_FLAGS = ("-O2", "-std=gnu11", "-g0", "-shared", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-w")
_CONTRACT = ("-ffp-contract=fast",)
_SECONDS = 300.0  # longest time that a compiler gets


@cache
def compiler() -> str | None:
    """Return the path of a C compiler that knows vector types, None if there is none."""
    wanted = os.environ.get("CC", "")
    for name in (*wanted.split()[:1], "gcc", "clang", "cc"):
        found = shutil.which(name)
        if found and sys.platform != "win32":
            return found
    return None


@cache
def _version(program: str) -> str:
    try:
        done = subprocess.run([program, "--version"], capture_output=True, text=True, check=False, timeout=60)  # noqa: S603 - found on the path
    except (OSError, subprocess.SubprocessError):
        return program
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
    """Return shared libraries of C sources; those that were compiled before come from the cache."""
    program = compiler()
    if program is None:
        raise MissingExtraError("compiling needs a C compiler, gcc or clang, on the path")
    command = [program, *_FLAGS, *_CONTRACT, *LEVELS[level]]
    keys = [_key(command, source) for source in sources]
    known = {key: kept for key in keys if (kept := _kept(key)) is not None}
    pending = {key: source for key, source in zip(keys, sources, strict=True) if key not in known}
    if pending:
        with scratch_folder() as scratch:
            made = _compiled(command, {scratch / f"{key}.so": source for key, source in pending.items()})
            known |= {path.stem: _keep(path) for path in made}
    return [known[key] for key in keys]


def _key(command: Sequence[str], source: str) -> str:
    parts = (*command, _version(command[0]), _processor(), source)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _compiled(command: Sequence[str], sources: dict[Path, str]) -> list[Path]:
    """Compile texts side by side to the files that they are given for."""
    LOG.info("compiling the robot by %s, once", Path(command[0]).name)
    jobs: list[subprocess.Popen[str]] = []
    try:
        jobs += (_start(command, source, path) for path, source in sources.items())
        for job in jobs:
            _finish(job)
    except OSError as error:
        raise ModelError(f"the C compiler cannot be run ({reason(error)})") from error
    finally:
        for job in jobs:
            if job.poll() is None:
                os.killpg(job.pid, signal.SIGKILL)  # also those that it has started
                job.communicate()
    return list(sources)


def _start(command: Sequence[str], source: str, made: Path) -> subprocess.Popen[str]:
    text = made.with_suffix(".c")
    text.write_text(source, encoding="ascii")
    call = [*command, "-o", str(made), str(text), "-lm"]
    how: dict[str, Any] = {"stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL, "text": True}
    how["env"] = {**os.environ, "TMPDIR": str(made.parent)}  # its own files go with ours, however it ends
    return subprocess.Popen(call, start_new_session=True, **how)  # noqa: S603 - a compiler with our own text


def _finish(job: subprocess.Popen[str]) -> None:
    try:
        _, told = job.communicate(timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        raise ModelError(f"the C compiler took longer than {_SECONDS:g} s") from None
    if job.returncode:
        raise ModelError(f"the C compiler failed: {told.strip()[:300]}")


def _kept(key: str) -> ctypes.CDLL | None:
    """Return a library that was compiled before; one that is not what was kept is removed."""
    for folder in _folders():
        for path in folder.glob(f"{key}-*.so"):
            with contextlib.suppress(OSError):  # it cannot be read, or not be loaded from here
                ours = path.lstat().st_uid == _user()  # the folder may have been open to others before
                if ours and path.stem == f"{key}-{hashlib.sha256(path.read_bytes()).hexdigest()}":
                    return ctypes.CDLL(str(path))
                path.unlink()
    return None


def _keep(made: Path) -> ctypes.CDLL:
    """Load what was compiled, from the first folder that takes it; if none does, from where it is."""
    try:
        data = made.read_bytes()
        for folder in _folders(make=True):
            with contextlib.suppress(OSError):  # FileError too: a full disk, or one to run nothing from
                kept = folder / f"{made.stem}-{hashlib.sha256(data).hexdigest()}.so"
                return ctypes.CDLL(str(write_atomic(kept, data)))
        return ctypes.CDLL(str(made))
    except OSError as error:
        raise ModelError(f"what the C compiler made cannot be loaded ({reason(error)})") from error


def _folders(make: bool = False) -> Iterator[Path]:
    """Yield the folders for what is compiled into which nobody else can put code; make those missing."""
    places = []
    base, home = os.environ.get("XDG_CACHE_HOME", ""), os.path.expanduser("~")  # noqa: PTH111 - Path.home raises
    if os.path.isabs(base):  # noqa: PTH117 - another one is to be ignored, its specification says
        places.append(Path(base, "p3dof"))
    elif os.path.isabs(home):  # noqa: PTH117 - it stays "~" for a user whom nobody knows
        places.append(Path(home, ".cache", "p3dof"))
    with contextlib.suppress(OSError):  # there is none
        places.append(Path(tempfile.gettempdir(), f"p3dof-{_user()}"))
    for place in places:
        folder = place / "loops"
        with contextlib.suppress(OSError, RuntimeError):
            for part in (place, folder) if make else ():
                part.mkdir(parents=True, exist_ok=True, mode=0o700)
            folder = folder.resolve()
            if _private(folder) and os.access(folder, os.R_OK | os.W_OK):
                yield folder


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0


def _private(folder: Path) -> bool:
    """Return whether a folder is this user's, and nobody else can change what is in it or above it."""
    for part in (folder, *folder.parents):
        told = part.stat()
        shared = told.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not told.st_mode & stat.S_ISVTX
        if shared or told.st_uid not in {_user(), *(() if part == folder else (0,))}:
            return False
    return not folder.stat().st_mode & (stat.S_IWGRP | stat.S_IWOTH)
