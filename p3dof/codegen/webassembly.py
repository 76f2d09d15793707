"""Generated C as a small WebAssembly file that imports nothing, and the JavaScript that loads it."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

from p3dof._base.errors import FileError, MissingExtraError, ModelError
from p3dof._base.files import read_text, scratch_folder, write_atomic
from p3dof._base.tracing.wasm import MAGIC, leb
from p3dof.codegen.frame import INDENT, Argument, Prototype, definition, indented
from p3dof.codegen.naming import fill


@dataclass(frozen=True)
class Exported:
    """A function of generated C that is called on rows, every argument row after row."""

    function: Prototype  # the function
    first: str = ""  # its first argument, if that is no row
    kept: tuple[Argument, ...] = ()  # of ``state``, copied from there after a call

    @property
    def name(self) -> str:
        """Its name, without prefix."""
        return self.function.name

    @property
    def inputs(self) -> tuple[Argument, ...]:
        """What it takes."""
        return self.function.inputs

    @property
    def outputs(self) -> tuple[Argument, ...]:
        """What it gives."""
        return (*self.function.outputs, *self.kept)

    def code(self, prefix: str) -> str:
        """Return C that calls it on rows, and tells how many are good."""
        given = [f"const double *{one.name}" for one in self.inputs]
        taken = [f"double *{one.name}" for one in self.outputs]
        head = (
            f"size_t rows_of_{self.name}(size_t count, {', '.join([*given, *taken])}, unsigned char *status)"
        )
        first = [self.first] if self.first else []
        called = ", ".join([*first, *(one.row(prefix) for one in self.function.arguments)])
        kept = [
            f"memcpy({one.name} + {one.size}U * i, state.{one.name}, {one.size}U * sizeof(double));"
            for one in self.kept
        ]
        inner = [
            f"const {prefix}_status told = {prefix}_{self.name}({called});",
            "status[i] = (unsigned char)told;",
            f"if (told == {prefix.upper()}_OK) {{",
            *indented(("++good;", *kept)),
            "}",
        ]
        lines = [
            "size_t i, good = 0U;",
            "for (i = 0U; i < count; ++i) {",
            *indented(inner),
            "}",
            "return good;",
        ]
        return f'EXPORT("{self.name}") {head};\n\n{definition(head, lines)}'


@dataclass(frozen=True)
class WebModule:
    """What a WebAssembly file offers."""

    prefix: str  # what the names of the C begin with
    note: str  # what its files begin with
    functions: Sequence[Exported]  # what is called on rows
    statuses: Mapping[int, str]  # what a status means, by its number
    state: str = ""  # C of what is kept between calls
    methods: str = ""  # JavaScript of more methods, and of what is done at first
    constructed: str = ""
    places: Mapping[str, object] = field(default_factory=dict)
    """Where the parameters are, by name; empty without any."""
    optimisation: str = "-O2"  # what the compiler is told: `"-O2"` for speed, `"-Oz"` for a small file

    def exports(self) -> str:
        """Return the C that is compiled beside the library."""
        functions = "\n".join(one.code(self.prefix) for one in self.functions)
        return fill(
            "wasm_exports.in", note=self.note, prefix=self.prefix, state=self.state, functions=functions
        )

    def loader(self) -> str:
        """Return the JavaScript module."""
        spec = {
            one.name: {
                "inputs": _sizes(one.inputs),
                "optional": [argument.name for argument in one.inputs if argument.optional],
                "outputs": _sizes(one.outputs),
            }
            for one in self.functions
        }
        example = self.functions[0]
        places = (
            "\n/** Places in `parameters`; at a body's begin mass, mass centre (3) and inertia (6). */\n"
            f"export const places = {_script(self.places)};\n"
            if self.places
            else ""
        )
        return fill(
            "wasm_loader.in",
            note=self.note,
            prefix=self.prefix,
            example=example.name,
            arguments=", ".join(one.name for one in example.inputs if not one.optional),
            statuses=_script(self.statuses),
            spec=_script(spec),
            places=places,
            constructed=self.constructed,
            methods=self.methods,
        )


def _sizes(groups: Iterable[Argument]) -> dict[str, int]:
    return {one.name: one.size for one in groups}


def _script(value: object) -> str:
    """Return a constant of JavaScript, an entry of the outermost object a line."""
    if not isinstance(value, Mapping):
        return json.dumps(value)
    lines = [f"{INDENT}{json.dumps(str(key))}: {json.dumps(one)}," for key, one in value.items()]
    return "\n".join(["{", *lines, "}"])


_NAME = b"p3dof"


def with_section(made: bytes, told: Mapping[str, str]) -> bytes:
    """Return a file with the section at its end."""
    body = leb(len(_NAME)) + _NAME + json.dumps(dict(told)).encode()
    return made + b"\0" + leb(len(body)) + body


def section_of(found: bytes) -> dict[str, str]:
    """Return what the section of a file says; empty if it has no such section, or is no WebAssembly."""
    place = len(MAGIC)
    try:
        while found.startswith(MAGIC) and place < len(found):
            kind = found[place]
            size, start = _number(found, place + 1)
            if kind == 0:
                length, at = _number(found, start)
                if found[at : at + length] == _NAME:
                    told = json.loads(found[at + length : start + size])
                    return told if isinstance(told, dict) else {}
            place = start + size
    except (IndexError, ValueError):
        pass
    return {}


def _number(found: bytes, place: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = found[place]
        value |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if byte < 0x80:
            return value, place


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
    """Return generated C as WebAssembly whose exports take rows; its end tells sources and compiler."""
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
    """Return a hash of all that goes into a file, and of the flags."""
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
    """Return what stands for a C library, by file name."""
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
    """Return the paths of clang and of its linker."""
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


@dataclass(frozen=True)
class WebFiles:
    """The files that WebAssembly adds to those of generated C."""

    module: WebModule  # what is exported

    @property
    def names(self) -> tuple[str, ...]:
        """The files that are no text."""
        return (f"{self.module.prefix}.wasm",)

    def texts(self) -> dict[str, str]:
        """Return the JavaScript by file name."""
        return {f"{self.module.prefix}.mjs": self.module.loader()}

    def write(self, folder: Path, texts: Mapping[str, str], force: bool = False) -> Path:
        """Build and write the file; the file written."""
        prefix = self.module.prefix
        path = folder / f"{prefix}.wasm"
        content = webassembly(texts[f"{prefix}.h"], texts[f"{prefix}.c"], self.module)
        if path.is_file() and not force and not section_of(_read(path)):
            advice = "use another folder, or force it (--force)"
            raise FileError(f"{path}: would be overwritten, but was not generated by p3dof; {advice}")
        return write_atomic(path, content)

    def check(self, folder: Path) -> list[str]:
        """Say in what the file is not what would be built from the C beside it.

        One line for each difference. Where the compiler that built it is here, it is built again, and its
        bytes are compared; other compilers give other bytes, and there a hash of its sources has to do.
        """
        prefix = self.module.prefix
        beside = [folder / f"{prefix}.{ending}" for ending in ("h", "c")]
        if not all(one.is_file() for one in beside):
            return []  # said already
        return self.compare(folder, *map(read_text, beside))

    def compare(self, folder: Path, header: str, library: str) -> list[str]:
        """Say, a line each, in what the file is not what would be built from some C; as `check`."""
        path = folder / f"{self.module.prefix}.wasm"
        if not path.exists():
            return [f"{path}: missing"]
        found = _read(path)
        told = section_of(found)
        if told.get("sources") != sources_hash(header, library, self.module):
            return [f"{path}: was not built from the C that goes with it"]
        if told.get("compiler") == compiler_here() and webassembly(header, library, self.module) != found:
            return [f"{path}: the same compiler gives other bytes"]
        return []


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}") from error
