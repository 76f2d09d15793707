"""The port bound: how fast a core could run the hot loop of a kernel if nothing had to wait for anything.

The model
---------
The compiled loops of a kernel are disassembled and their vector instructions are counted by kind. Each group
of ports needs at least the time that its share of the instructions takes when none waits for another:

* arithmetic: add, min, mul, fma, and what is done bit by bit or moves lanes;
* divider: div and sqrt, which block it for many cycles;
* memory: loads, also those that are an operand of something else, and stores, all in the first-level cache.

These times are measured here and now, on this core, at the same width, as streams of the counted instructions
in even mixture: ports that kinds share count as shared, and those that they do not share do not. The *bound*
is the largest of the three: no order of these instructions is faster.

Beside it:

* *counted*: count times throughput of every kind, each measured alone; add, min, mul and fma added up, as if
  all shared the same ports (as they do on many cores), div and sqrt added up; the larger of the two;
* *together*: all instructions of the loop as one stream, which adds what the front end can issue; its order
  may not be the best, so this is not strictly a bound.

Needs Linux on x86-64, gcc and objdump; left out elsewhere.
"""

from __future__ import annotations

import ctypes
import platform
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from batch import COMPILED, FORCES
from inputs import MACHINES
from rounds import Contender, Timing

from p3dof.closed_form.compiled import MachineKernels

PORTS = "ports"
ALONE = ("add", "min", "mul", "fma", "div", "sqrt")
SHARED = (("add", "min", "mul", "fma"), ("div", "sqrt"))
"""Kinds that are taken to share a port where only counts are used."""

GROUPS = {
    "arithmetic": ("add", "min", "mul", "fma", "logic", "integer", "shift", "blend", "shuffle"),
    "divider": ("div", "sqrt"),
    "memory": ("load", "store"),
}
TOGETHER = "together"
LANES = {"baseline": 2, "avx2": 4, "avx512": 8}
UNROLLED = 60
"""Instructions of one kind in a row, to measure its throughput."""

_KINDS = {
    "add": r"(add|sub)pd",
    "min": r"(min|max|cmp\w*)pd",
    "mul": r"mulpd",
    "fma": r"fn?m(add|sub)\d+pd",
    "div": r"divpd",
    "sqrt": r"sqrtpd",
    "logic": r"(and|andn|or|xor)p[sd]|p(and|andn|or|xor)[qd]?|pternlog[qd]",
    "integer": r"p(add|sub)[qd]",
    "shift": r"ps(rl|ll|ra)[qd]",
    "blend": r"p?blend\w+",
    "shuffle": r"p?broadcast\w+|p?unpck\w+|movddup|p?shuf\w+|p?perm\w+|v?(insert|extract)\w+",
    "move": r"mov(ap|up)[sd]|movdq\w+|mov[hl]p[sd]",
}
_WIDE = {
    "add": "vaddpd {a}, {b}, {d}",
    "min": "vminpd {a}, {b}, {d}",
    "mul": "vmulpd {a}, {b}, {d}",
    "fma": "vfmadd231pd {a}, {b}, {d}",
    "div": "vdivpd {a}, {b}, {d}",
    "sqrt": "vsqrtpd {a}, {d}",
    "logic": "vpand {a}, {b}, {d}",
    "integer": "vpaddq {a}, {b}, {d}",
    "shift": "vpsrlq $1, {a}, {d}",
    "blend": "vblendvpd {a}, {b}, {a}, {d}",
    "shuffle": "vbroadcastsd %xmm0, {d}",
    "move": "vmovapd {a}, {d}",
    "load": "vmovapd {offset}(%rsi), {d}",
    "store": "vmovapd {a}, {offset}(%rsi)",
    "scalar": "lea 8(%rdx), %{scalar}",
}
_TEMPLATES: Mapping[str, Mapping[str, str]] = {
    "baseline": {
        "add": "addpd {a}, {d}",
        "min": "minpd {a}, {d}",
        "mul": "mulpd {a}, {d}",
        "div": "divpd {a}, {d}",
        "sqrt": "sqrtpd {a}, {d}",
        "logic": "pand {a}, {d}",
        "integer": "paddq {a}, {d}",
        "shift": "psrlq $1, {d}",
        "shuffle": "unpcklpd {a}, {d}",
        "move": "movapd {a}, {d}",
        "load": "movapd {offset}(%rsi), {d}",
        "store": "movapd {a}, {offset}(%rsi)",
        "scalar": "lea 8(%rdx), %{scalar}",
    },
    "avx2": _WIDE,
    "avx512": {**_WIDE, "logic": "vpandq {a}, {b}, {d}", "blend": "vblendmpd {a}, {b}, {d}{{%k1}}"},
}
_REGISTERS = {"baseline": ("xmm", 16), "avx2": ("ymm", 16), "avx512": ("zmm", 32)}
_AREA = 4096
"""Bytes that streams load from; as many more to store to."""


@dataclass(frozen=True, eq=False)
class Loop:
    """The hot loops of a compiled kernel.

    Parameters
    ----------
    level, machine : str
        Of the kernel.
    counts : Counter
        Its instructions by kind; loads that are operands of others count on their own.
    instructions : int
        How many there are in all.
    samples : int
        Computed by a pass.
    """

    level: str
    machine: str
    counts: Counter[str]
    instructions: int
    samples: int

    def name(self, group: str) -> str:
        """Return what a stream of this loop is called."""
        return f"{self.level}: {group}"


def available() -> bool:
    """Return whether there is what the model needs."""
    tools = all(shutil.which(tool) for tool in ("gcc", "objdump"))
    return bool(COMPILED) and tools and platform.system() == "Linux" and platform.machine() == "x86_64"


def hot_loops(folder: Path) -> list[Loop]:
    """Return the loops of the inverse dynamics, of every level and machine."""
    found = []
    functions = _disassembled(folder)
    for level in COMPILED:
        for machine, parameters in MACHINES.items():
            used, _ = MachineKernels(parameters, level, 1).prepared(FORCES)
            lines = _hottest(functions[f"{used.name}_{level}"], _REGISTERS[level][0])
            counts = _counted(lines)
            divided = counts["div"] // used.operations()["div"]  # more than 1 if unrolled
            found.append(Loop(level, machine, counts, len(lines), LANES[level] * divided))
    return found


def streams(loops: Sequence[Loop], folder: Path) -> Iterator[Contender]:
    """Contenders: every group of every loop, all of a loop together, and every kind alone."""
    wanted: dict[tuple[str, str], tuple[str, list[str], int]] = {}
    for loop in loops:
        for group, kinds in GROUPS.items():
            mixed = _mixed({kind: loop.counts[kind] for kind in kinds})
            wanted[loop.machine, loop.name(group)] = loop.level, mixed, loop.samples
        wanted[loop.machine, loop.name(TOGETHER)] = loop.level, _mixed(loop.counts), loop.samples
    for level in COMPILED:
        for kind in ALONE:
            if kind in _TEMPLATES[level]:
                wanted["", f"{level}: {kind}"] = level, [kind] * UNROLLED, UNROLLED
    library = _assembled({f"stream_{i}": value[:2] for i, value in enumerate(wanted.values())}, folder)
    for i, ((machine, name), (_, kinds, samples)) in enumerate(wanted.items()):
        yield Contender(PORTS, name, machine, _passes(library[f"stream_{i}"], bool(kinds)), samples)


def bounds(loop: Loop, timings: Mapping[tuple[str, str, str], Timing]) -> dict[str, float]:
    """Return seconds a sample by group, their largest as ``"bound"``, and ``"counted"`` and ``"together"``.

    What a stream takes is its best round: a bound must not be raised by what else the machine does.
    """
    found = {group: timings[PORTS, loop.name(group), loop.machine].best for group in GROUPS}
    found["bound"] = max(found.values())
    alone = {kind: timings.get((PORTS, f"{loop.level}: {kind}", "")) for kind in ALONE}
    times = {kind: loop.counts[kind] * one.best / loop.samples for kind, one in alone.items() if one}
    found["counted"] = max(sum(times.get(kind, 0.0) for kind in kinds) for kinds in SHARED)
    found[TOGETHER] = timings[PORTS, loop.name(TOGETHER), loop.machine].best
    return found


def _disassembled(folder: Path) -> dict[str, list[str]]:
    """Return the instructions of every function of the extension, ``address: mnemonic operands``."""
    from p3dof._native import _compiled

    found = _functions(Path(str(_compiled.__file__)))
    if any(name.startswith(FORCES) for name in found):
        return found
    command = [sys.executable, "setup.py", "-q", "build_ext", "--build-lib", folder, "--build-temp", folder]
    subprocess.run(command, cwd=Path(__file__).parents[2], check=True)  # that one was stripped
    objects = [_functions(made) for made in folder.rglob("level_*.o")]
    return {name: lines for functions in objects for name, lines in functions.items()}


def _functions(path: Path) -> dict[str, list[str]]:
    command = ["objdump", "-d", "--no-show-raw-insn", path]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in text.splitlines():
        if head := re.fullmatch(r"[0-9a-f]+ <(\w+)>:", line):
            lines = found[head[1]] = []
        elif re.match(r"\s+[0-9a-f]+:\t", line):
            lines.append(line.strip())
    return found


def _hottest(lines: Sequence[str], register: str) -> list[str]:
    """Return the innermost loops that multiply vectors of full width, in a row."""
    places = {int(line.partition(":")[0], 16): i for i, line in enumerate(lines)}
    loops = []
    for end, line in enumerate(lines):
        jump = re.match(r"[0-9a-f]+:\tj\w+\s+([0-9a-f]+)", line)
        start = places.get(int(jump[1], 16)) if jump else None
        if start is not None and start <= end:
            loops.append((start, end))
    inner = [
        one
        for one in loops
        if not any(one != other and one[0] <= other[0] <= other[1] <= one[1] for other in loops)
    ]
    bodies = [lines[start : end + 1] for start, end in inner]
    wide = [body for body in bodies if any("mulpd" in line and f"%{register}" in line for line in body)]
    return [line for body in wide for line in body]


def _parts(line: str) -> tuple[str, list[str]]:
    """Return mnemonic and operands of an instruction."""
    mnemonic, _, rest = line.partition("\t")[2].partition("#")[0].partition(" ")
    return mnemonic.removeprefix("v"), re.findall(
        r"[^,(]*\([^)]*\)[^,]*|[^,]+", rest.partition("<")[0].strip()
    )


def _counted(lines: Sequence[str]) -> Counter[str]:
    found: Counter[str] = Counter()
    for line in lines:
        mnemonic, operands = _parts(line)
        if mnemonic.startswith("nop") or not operands:
            continue
        kind = next((kind for kind, form in _KINDS.items() if re.fullmatch(form, mnemonic)), "scalar")
        loads = any("(" in operand for operand in operands[:-1])
        stores = "(" in operands[-1] and mnemonic.startswith("mov")
        loads = loads or ("(" in operands[-1] and not stores and not mnemonic.startswith("lea"))
        found["load"] += loads
        found["store"] += stores
        only_moves = kind == "move" or "broadcast" in mnemonic or mnemonic in {"mov", "movddup"}
        if not (only_moves and (loads or stores)):
            found[kind] += 1
    return +found


def _mixed(counts: Mapping[str, int]) -> list[str]:
    """Return as many of every kind, evenly mixed."""
    places = [((k + 0.5) / count, kind) for kind, count in counts.items() for k in range(count)]
    return [kind for _, kind in sorted(places)]


def _assembled(wanted: Mapping[str, tuple[str, Sequence[str]]], folder: Path) -> ctypes.CDLL:
    """Return a library of functions f(passes, memory), one a stream."""
    folder.mkdir(parents=True)
    source, library = folder / "streams.S", folder / "streams.so"
    text = "".join(_function(name, level, kinds) for name, (level, kinds) in wanted.items())
    source.write_text(f'.text\n{text}.section .note.GNU-stack,"",@progbits\n')
    subprocess.run(["gcc", "-shared", "-o", library, source], check=True)
    return ctypes.CDLL(str(library))


def _function(name: str, level: str, kinds: Sequence[str]) -> str:
    kind, count = _REGISTERS[level]
    names = [f"%{kind}{i}" for i in range(count)]
    width = 8 * LANES[level]
    templates, slots = _TEMPLATES[level], _AREA // width
    load = "movapd" if level == "baseline" else "vmovapd"
    lines = ["stmxcsr -8(%rsp)", "mov -8(%rsp), %eax", "or $0x8040, %eax", "mov %eax, -4(%rsp)"]
    lines += ["ldmxcsr -4(%rsp)"]  # numbers that become too small are zeros, which cost nothing
    lines += [f"{load} {width * i}(%rsi), {register}" for i, register in enumerate(names)]
    lines += ["kxnorw %k1, %k1, %k1"] if level == "avx512" else []
    lines += [".p2align 6", "1:"]
    for i, wanted in enumerate(kinds):
        area = _AREA if wanted == "store" else 0
        lines.append(
            templates[wanted].format(
                a=names[0],
                b=names[1],
                d=names[2 + i % (count - 2)],
                offset=area + width * (i % slots),
                scalar=f"r{8 + i % 4}",
            )
        )
    lines += [
        "sub $1, %rdi",
        "jnz 1b",
        "ldmxcsr -8(%rsp)",
        "" if level == "baseline" else "vzeroupper",
        "ret",
    ]
    return f".globl {name}\n.p2align 6\n{name}:\n" + "\n".join(lines) + "\n"


def _passes(function: Callable[..., None], some: bool) -> Callable[[int], float]:
    """Return what runs a stream; an empty one takes no time."""
    size = 2 * _AREA // 8 + 8
    memory = (ctypes.c_double * size)(*(1 + i * 0.6180339887498949 % 1 for i in range(size)))
    address = ctypes.addressof(memory)
    aligned = ctypes.c_void_p(address + -address % 64)

    def run(count: int) -> float:
        start = time.perf_counter()
        function(ctypes.c_long(count), aligned)
        seconds = time.perf_counter() - start
        return seconds if some else count * 1e-12

    run.memory = memory  # type: ignore[attr-defined] - kept as long as it is used
    return run
