from collections.abc import Callable, Mapping, Sequence
from typing import Any, SupportsIndex, TypeAlias, final, overload

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Buffer

levels: tuple[str, ...]
kernels: Mapping[str, tuple[int, int, int]]
sources: int

_Doubles: TypeAlias = NDArray[np.float64] | Buffer

def run_many(level: str, wide: bool, /, *buffers: Buffer | None) -> None: ...

@final
class Call:
    @property
    def kernel(self) -> str: ...
    @property
    def level(self) -> str: ...
    @property
    def size(self) -> int: ...
    def __new__(
        cls,
        kernel: str,
        level: str,
        constants: _Doubles,
        inputs: Sequence[_Doubles],
        outputs: Sequence[_Doubles | None],
    ) -> Call: ...
    @overload
    def __call__(self) -> bool: ...
    @overload
    def __call__(self, start: SupportsIndex, stop: SupportsIndex, /) -> bool: ...

@final
class Function:
    @property
    def kernel(self) -> str: ...
    @property
    def level(self) -> str: ...
    def __new__(cls, kernel: str, level: str, constants: _Doubles) -> Function: ...
    def __call__(self, *numbers: float) -> tuple[float, ...]: ...

@final
class Sample:
    @property
    def kernel(self) -> str: ...
    @property
    def level(self) -> str: ...
    def __new__(
        cls,
        kernel: str,
        level: str,
        constants: _Doubles,
        arguments: tuple[tuple[int, tuple[int, ...]], ...],
        entries: tuple[int | float, ...],
        shape: tuple[int, ...],
        empty: Callable[[tuple[int, ...]], NDArray[np.float64]],
    ) -> Sample: ...
    def __call__(self, out: object, *rows: object) -> Any: ...

@final
class DesignLoop:
    def __new__(
        cls, kernel: str, level: str, asked: int, samples: int, points: int, motion: _Doubles
    ) -> DesignLoop: ...
    def __call__(
        self, constants: _Doubles, lengths: _Doubles, offsets: _Doubles | None, results: _Doubles, /
    ) -> None: ...
    def tangent(
        self,
        symmetric: bool,
        constants: _Doubles,
        turning: _Doubles | None,
        lengths: _Doubles,
        offsets: _Doubles | None,
        results: _Doubles,
        /,
    ) -> None: ...

@final
class MachineRun:
    @property
    def time(self) -> float: ...
    @property
    def evaluations(self) -> int: ...
    @property
    def count(self) -> int: ...
    @property
    def index(self) -> int: ...
    def __new__(
        cls, kernel: str, level: str, tables: tuple[_Doubles, ...], numbers: _Doubles
    ) -> MachineRun: ...
    def advance(
        self, told: Callable[[int], object] | None, drain: Callable[[int], object] | None = None, /
    ) -> int: ...
    def hold(self, forces: _Doubles, /) -> None: ...
    def begin(self, start: _Doubles, /) -> None: ...
    def rows(self, table: _Doubles, noise: _Doubles, /) -> None: ...
    def live(self, into: _Doubles, /) -> None: ...
    def samples(self, into: _Doubles, /) -> None: ...
