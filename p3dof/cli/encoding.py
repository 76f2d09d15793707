"""Letters on any terminal: what its encoding does not have is spelled in letters that it has."""

from __future__ import annotations

import codecs
import unicodedata

_WORDS = {
    "θ": "theta", "Σ": "sum", "Δ": "Delta", "π": "pi", "ω": "omega", "α": "alpha", "µ": "u", "μ": "u",
    "×": "x", "·": " ", "−": "-", "–": "-", "—": "-", "→": "->", "±": "+/-", "≤": "<=", "≥": ">=", "≈": "~",
    "°": "deg", "²": "^2", "³": "^3", "⁻": "^-", "…": "...", "“": '"', "”": '"', "„": '"', "‘": "'", "’": "'",
    "│": "|", "─": "-", "━": "-",
}  # fmt: skip
"""What to write for a character that an encoding does not have."""


def _spelled(error: UnicodeError) -> tuple[str | bytes, int]:
    """Write a character that the encoding does not have in letters that it has: the codec's error handler."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    character = error.object[error.start]
    if "\udc80" <= character <= "\udcff":  # a byte of a file's name, as Python keeps what it cannot decode
        return bytes([ord(character) - 0xDC00]), error.start + 1
    simple = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return _WORDS.get(character) or simple or "?", error.start + 1


write_what_is_there = "p3dof-spelled"
"""The name of the codecs' error handler that spells what an encoding does not have: θ as theta."""

codecs.register_error(write_what_is_there, _spelled)


def spelled(text: str, encoding: str) -> str:
    """Return a text as an encoding can write it.

    Parameters
    ----------
    text : str
        Any text.
    encoding : str
        A name that Python knows, such as ``"ascii"``.

    Returns
    -------
    str
        The same text where the encoding has all its characters; else with ``theta`` for θ and so on.
    """
    return text.encode(encoding, write_what_is_there).decode(encoding, "surrogateescape")
