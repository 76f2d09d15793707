"""WebAssembly from C by clang and wasm-ld, without a C library; the same input gives the same bytes."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from p3dof._base.errors import MissingExtraError, ModelError
from p3dof._base.files import scratch_folder
from p3dof.codegen.filling import fill
from p3dof.codegen.wasm_section import with_section
from p3dof.codegen.webassembly import WebModule

_COMPILE = (
    "--target=wasm32-unknown-unknown",
    "-std=c99",
    "-nostdlibinc",
    "-Iinclude",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fvisibility=hidden",
    "-w",
    "-c",
)
_LINK = (
    "--no-entry",
    "--strip-all",
    "--gc-sections",
    "--stack-first",
    "-z",
    "stack-size=262144",
    "--export=__heap_base",
)
_NEEDS = "WebAssembly needs clang and wasm-ld on the path (on Debian: apt-get install clang lld)"
_TOOLS = ("clang", "wasm-ld")
_SECONDS = 300.0


def webassembly(header: str, library: str, module: WebModule) -> bytes:
    """Return generated C as WebAssembly, with exports that take rows.

    Parameters
    ----------
    header, library : str
        Text of the header and of the C file.
    module : WebModule
        What to export.

    Returns
    -------
    bytes
        The file; it ends with a section that holds a hash of its sources and the compiler's version.

    Raises
    ------
    MissingExtraError
        If clang or wasm-ld is missing, or knows no WebAssembly.
    ModelError
        If they fail.
    """
    clang, linker = tools()
    sources = _sources(header, library, module)
    with scratch_folder() as folder:
        (folder / "include").mkdir()
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        objects = []
        for name in sources:
            if name.endswith(".c"):
                own = ("-fno-builtin",) if name == "mathematics.c" else ()
                objects.append(f"{name[:-2]}.o")
                _run([clang, *_COMPILE, module.optimisation, *own, "-o", objects[-1], name], folder)
        _run([linker, *_LINK, "-o", "made.wasm", *objects], folder)
        made = (folder / "made.wasm").read_bytes()
    told = {"sources": _digest(sources, module), "compiler": _version(clang)}
    return with_section(made, told)


def sources_hash(header: str, library: str, module: WebModule) -> str:
    """Return a hash of all that goes into a file, and of the flags.

    Parameters
    ----------
    header, library : str
        Text of the header and of the C file.
    module : WebModule
        What to export.

    Returns
    -------
    str
    """
    return _digest(_sources(header, library, module), module)


def compiler_here() -> str | None:
    """Return the version of the compiler that would build; None without one."""
    return _version(tools()[0]) if all(map(shutil.which, _TOOLS)) else None


def _sources(header: str, library: str, module: WebModule) -> dict[str, str]:
    prefix = module.prefix
    return {
        f"{prefix}.h": header,
        f"{prefix}.c": library,
        "exports.c": module.exports(),
        **mathematics(module.note),
    }


def mathematics(note: str) -> dict[str, str]:
    """Return what stands for a C library, by file name.

    Parameters
    ----------
    note : str
        What files begin with.

    Returns
    -------
    dict of str to str
    """
    shared = files("p3dof._base.tracing")
    names = ("sincos.h", "tanh.h", "atan2.h")
    return {
        "mathematics.c": fill("wasm_math.in", note=note),
        "include/math.h": fill("wasm_math_h.in", note=note),
        "include/string.h": fill("wasm_string_h.in", note=note),
        **{f"include/{name}": (shared / name).read_text(encoding="utf-8") for name in names},
    }


def _digest(sources: Mapping[str, str], module: WebModule) -> str:
    parts = [
        *_COMPILE,
        module.optimisation,
        *_LINK,
        *(part for pair in sorted(sources.items()) for part in pair),
    ]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def tools() -> tuple[str, str]:
    """Return the paths of clang and of its linker.

    Raises
    ------
    MissingExtraError
        If one is missing.
    """
    clang, linker = map(shutil.which, _TOOLS)
    if clang is None or linker is None:
        missing = " and ".join(name for name in _TOOLS if shutil.which(name) is None)
        raise MissingExtraError(f"{_NEEDS}; not found: {missing}")
    return clang, linker


def _version(clang: str) -> str:
    return _run([clang, "--version"], Path()).splitlines()[0]


def _run(command: Sequence[str], folder: Path) -> str:
    """Run a tool. The linker is called by itself: the compiler would call wasm-opt where it finds one."""
    try:
        done = subprocess.run(  # noqa: S603 - clang and its linker, with our own text
            command, cwd=folder, capture_output=True, text=True, check=False, timeout=_SECONDS
        )
    except subprocess.TimeoutExpired:
        raise ModelError(f"{Path(command[0]).name} took longer than {_SECONDS:g} s") from None
    except OSError as error:
        raise MissingExtraError(f"{_NEEDS}; {command[0]} cannot be run: {error.strerror}") from error
    if done.returncode == 0:
        return done.stdout
    told = " ".join(done.stderr.split())[:300]
    if "target" in told and "wasm" in told:
        raise MissingExtraError(f"{_NEEDS}; {command[0]} knows no WebAssembly")
    raise ModelError(f"{Path(command[0]).name} failed: {told}")
