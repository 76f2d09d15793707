from typing import Any

from numpy.typing import NDArray
from typing_extensions import Buffer

def rows(powers: Buffer, columns: tuple[Buffer | list[str], ...], point: bool, /) -> bytes: ...
def numbers(
    powers: Buffer, text: str, start: int, longest: int, columns: int, into: NDArray[Any], /
) -> int: ...
