"""Which sources an extension was compiled from: one that is older than the Python beside it is not used.

The build runs this file by itself, so it imports nothing of p3dof.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
"""The folder of p3dof."""


def headers(package: Path = PACKAGE) -> list[Path]:
    """Return the files that the extension includes."""
    places = ("_native", "_native/generated", "_base", "_base/integrators", "_base/tracing")
    return sorted(header for place in places for header in (package / place).glob("*.h"))


def fingerprint(package: Path = PACKAGE) -> int | None:
    """Return 63 bits that tell the sources of the extension from others.

    None where the sources are not there, as in a wheel.
    """
    sources = sorted((package / "_native").glob("*.c"))
    if not sources:
        return None
    found = hashlib.blake2b(digest_size=8)
    for file in (*sources, *headers(package)):
        found.update(file.read_bytes().replace(b"\r\n", b"\n"))
    return int.from_bytes(found.digest(), "big") >> 1


def is_cut_off(library: Path) -> bool:
    """Return whether a shared library ends before it says: to load it would end the process (SIGBUS)."""
    try:
        with library.open("rb") as file:
            head = file.read(64)
        size = library.stat().st_size
    except OSError:
        return False  # loading it tells
    if head[:6] != b"\x7fELF\x02\x01" or len(head) < 64:
        return False
    table, entry, count = (int.from_bytes(head[a:b], "little") for a, b in ((40, 48), (58, 60), (60, 62)))
    return size < table + entry * count
