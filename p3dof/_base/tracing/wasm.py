"""Traced functions as WebAssembly, assembled here: bytes that a browser takes, with no compiler.

Every function takes two addresses, of its inputs and of its results, as numbers of eight bytes each. Sines,
cosines, tanh and atan2 are those of whoever loads the module, by the name ``m``.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from p3dof._base.tracing.tape import Number, Symbol, Tape


class Traced(NamedTuple):
    """A function to assemble."""

    tape: Tape
    inputs: Sequence[Symbol]
    results: Sequence[Number]


MAGIC = b"\0asm\1\0\0\0"
_IMPORTED = {"sin": 1, "cos": 1, "tanh": 1, "atan2": 2}  # and how many numbers they take
_CODES = {
    "add": b"\xa0",
    "sub": b"\xa1",
    "mul": b"\xa2",
    "div": b"\xa3",
    "neg": b"\x9a",
    "fabs": b"\x99",
    "sqrt": b"\x9f",
    "floor": b"\x9c",
    **{name: b"\x10" + bytes([i]) for i, name in enumerate(_IMPORTED)},
}
_I32, _F64 = b"\x7f", b"\x7c"
_DEEPEST = 40  # operations within operations that stay on the stack
_PAGE = 1 << 16


def module_of(functions: Mapping[str, Traced]) -> bytes:
    """Return a module that exports functions by name, and ``memory`` with room for the largest of them."""
    types = [_type(b"\x7c" * count, _F64) for count in (1, 2)] + [_type(_I32 * 2, b"")]
    imports = [_named("m") + _named(name) + b"\0" + bytes([count - 1]) for name, count in _IMPORTED.items()]
    bodies = [_Body(one).code() for one in functions.values()]
    exports = [_named(name) + b"\0" + leb(len(_IMPORTED) + i) for i, name in enumerate(functions)]
    size = 8 * max((len(one.inputs) + len(one.results) for one in functions.values()), default=0)
    sections = (
        (1, types),
        (2, imports),
        (3, [b"\x02"] * len(bodies)),
        (5, [b"\0" + leb(size // _PAGE + 1)]),
        (7, [*exports, _named("memory") + b"\x02\0"]),
        (10, bodies),
    )
    return MAGIC + b"".join(_section(number, items) for number, items in sections)


def leb(value: int) -> bytes:
    """Return a number that is not negative in LEB128."""
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


def _section(number: int, items: Sequence[bytes]) -> bytes:
    content = leb(len(items)) + b"".join(items)
    return bytes([number]) + leb(len(content)) + content


def _type(given: bytes, found: bytes) -> bytes:
    return b"\x60" + leb(len(given)) + given + leb(len(found)) + found


def _named(name: str) -> bytes:
    text = name.encode()
    return leb(len(text)) + text


class _Body:
    """The code of one function: what is used once stays on the stack, all else in locals used again."""

    def __init__(self, function: Traced) -> None:
        self._tape, self._results = function.tape, function.results
        self._offsets = {symbol.index: 8 * i for i, symbol in enumerate(function.inputs)}
        self._needed = self._tape.needed(self._results)
        self._uses = dict.fromkeys(self._needed, 0)
        for operand in (*self._results, *(x for i in self._needed for x in self._operands(i))):
            if isinstance(operand, Symbol):
                self._uses[operand.index] += 1
        self._kept = self._chosen()
        self._unneeded: dict[int, list[int]] = {}  # locals by the last value that needs them
        for index, root in self._ends().items():
            self._unneeded.setdefault(root, []).append(index)
        self._local: dict[int, int] = {}
        self._free: list[int] = []
        self._count = 2  # the first two are the addresses

    def code(self) -> bytes:
        """Return the function's entry of the code section."""
        parts = []
        for index in self._needed:
            if index in self._kept:
                parts.append(self._made(index, index))
                self._free += [self._local[done] for done in self._unneeded.get(index, ())]
                parts.append(b"\x21" + leb(self._place(index)))
        for i, result in enumerate(self._results):
            parts.append(b"\x20\x01" + self._value(result, -1) + b"\x39\x03" + leb(8 * i))
        locals_ = self._count - 2
        content = (b"\x01" + leb(locals_) + _F64 if locals_ else b"\0") + b"".join(parts) + b"\x0b"
        return leb(len(content)) + content

    def _operands(self, index: int) -> tuple[Number, ...]:
        operation = self._tape.operations[index]
        return operation.operands * (2 if operation.name == "min" else 1)  # compared, then chosen from

    def _chosen(self) -> set[int]:
        """Return the values that get a local: those that are used again, and some of what lies deep."""
        kept: set[int] = set()
        depth: dict[int, int] = {}
        for index in self._needed:
            inner = [x.index for x in self._operands(index) if isinstance(x, Symbol)]
            depth[index] = 1 + max((depth[i] for i in inner if i not in kept), default=0)
            if self._uses[index] > 1 or depth[index] > _DEEPEST:
                kept.add(index)
        return kept

    def _ends(self) -> dict[int, int]:
        """Return by local value the last one that needs it; -1 where a result does."""
        roots: dict[int, int] = {}
        last: dict[int, int] = {}
        used = {x.index for x in self._results if isinstance(x, Symbol)}
        for index in reversed(self._needed):
            if index in self._kept or index in used:
                roots[index] = -1 if index not in self._kept else index
            root = roots[index]
            for operand in self._operands(index):
                if isinstance(operand, Symbol):
                    if operand.index in self._kept:
                        before = last.get(operand.index, root)
                        last[operand.index] = -1 if -1 in (before, root) else max(before, root)
                    else:
                        roots.setdefault(operand.index, root)
        return last | dict.fromkeys(used & self._kept, -1)

    def _place(self, index: int) -> int:
        if self._free:
            place = self._free.pop()
        else:
            place, self._count = self._count, self._count + 1
        self._local[index] = place
        return place

    def _value(self, value: Number, root: int) -> bytes:
        if not isinstance(value, Symbol):
            return b"\x44" + struct.pack("<d", float(value))
        if value.index in self._kept:
            return b"\x20" + leb(self._local[value.index])
        return self._made(value.index, root)

    def _made(self, index: int, root: int) -> bytes:
        """Return the code that leaves a value on the stack, as a part of what makes another, or alone."""
        if index in self._offsets:
            return b"\x20\0\x2b\x03" + leb(self._offsets[index])
        name = self._tape.operations[index].name
        code = b"".join(self._value(x, root) for x in self._operands(index))
        if name == "rsqrt":
            return b"\x44" + struct.pack("<d", 1.0) + code + _CODES["sqrt"] + _CODES["div"]
        return code + (b"\x63\x1b" if name == "min" else _CODES[name])
