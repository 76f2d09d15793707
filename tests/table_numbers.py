"""Every number that is shown has a reference: tables, and the evidence that results carry.

A test says by `@shows("p3dof.room.module.function")` whose numbers it looks after, and compares all of them
by `check_table`; for a field of a result, `@shows("p3dof.room.module.Class.field")` and `check_evidence`. The
claim is held against what the test did (`conftest.py`), and `test_every_number.py` demands a claim for each
function that makes a table and for each field that holds an error.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from p3dof._base.tables import NONE, Table

shows = pytest.mark.shows
"""What numbers a test looks after: dotted names of functions that make tables, or of fields of results."""

_NUMBER = re.compile(
    r"(?<![\w.^])(?<!\^-)[-+]?(?:\d{1,3}(?:,\d{3})+(?:\.\d+)?|\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?: ?%)?"
)
_SIX = 5e-6
"""Half a unit of the last of six digits, as a share: what a page shows of a number."""

_compared: set[str] = set()
_codes: set[Any] = set()
"""Fields, by name, and functions, by code, whose numbers were compared since the last `begin`."""


def check_table(
    table: Table,
    expected: Mapping[str, Sequence[Any]] | Sequence[Sequence[Any]],
    *,
    note: Sequence[Any] = (),
    title: Sequence[Any] = (),
    header: Sequence[Any] = (),
    rtol: float = _SIX,
    atol: float = 1e-12,
) -> None:
    """Compare every number of a table with a reference of the test's own; name all that differ.

    Parameters
    ----------
    table : Table
        As the package made it.
    expected : mapping of str to sequence, or sequence of sequence
        The cells beside each row's name, or rows with their names in front (where names repeat). For a cell
        that is a number: that number, NaN for one that does not exist. For a text: its only number, or a
        tuple of its numbers in their order (shares for percents), in which strings are words that must stand
        there; or a string, which is the whole text.
    note, title, header : sequence
        The numbers (and words) in the note, the title, and the names of the columns one after the other.
    rtol, atol : float
        For cells that are numbers; numbers in texts are compared to half a unit of their last digit.
    """
    wrong: list[str] = []
    texts = (
        ("note", table.note, note),
        ("title", table.title, title),
        ("header", "; ".join(table.header), header),
    )
    for place, text, numbers in texts:
        wrong += [f"{place}: {words}" for words in _differences(text, tuple(numbers))]
    rows = [(name, *cells) for name, cells in expected.items()] if isinstance(expected, Mapping) else expected
    if [row[0] for row in rows] != [row[0] for row in table.rows]:
        wrong.append(f"rows {[row[0] for row in table.rows]}, expected {[row[0] for row in rows]}")
    for row, wanted in zip(table.rows, rows, strict=False):
        if len(row) != len(table.header) or len(wanted) != len(row):
            wrong.append(
                f"{row[0]}: {len(row)} cells under {len(table.header)} names, {len(wanted)} expected"
            )
        for name, cell, value in zip(table.header[1:], row[1:], wanted[1:], strict=False):
            if not isinstance(cell, str):
                fits = not isinstance(value, str | tuple) and np.isclose(
                    cell, value, rtol, atol, equal_nan=True
                )
                found = [] if fits else [f"{cell!r}, expected {value!r}"]
            else:
                found = _differences(cell, value if isinstance(value, str | tuple) else (value,))
            wrong += [f"{row[0]}, {name}: {words}" for words in found]
    assert not wrong, f"{table.title}\n" + "\n".join(wrong)
    _codes.update(getattr(table, "_makers", ()))


def _differences(text: str, expected: str | tuple[Any, ...]) -> list[str]:
    """Return in what a text differs from its numbers and words, or from the whole of it."""
    if isinstance(expected, str):
        return [] if text == expected else [f"{text!r}, expected {expected!r}"]
    wanted = [float(value) for value in expected if not isinstance(value, str)]
    wrong = [
        f"{word!r} is not in {text!r}" for word in expected if isinstance(word, str) and word not in text
    ]
    if text == NONE and np.isnan(wanted).tolist() == [True]:
        return wrong
    found = numbers_in(text)
    fits = len(found) == len(wanted) and all(
        abs(value - reference) <= half + 1e-9 * abs(reference)
        for (value, half), reference in zip(found, wanted, strict=True)
    )
    return wrong if fits else [*wrong, f"{[value for value, _ in found]} in {text!r}, expected {wanted}"]


def numbers_in(text: str) -> list[tuple[float, float]]:
    """Return the numbers of a text, percents as shares, each with half a unit of its last digit."""
    found = []
    for match in _NUMBER.finditer(text.replace("−", "-")):
        word = match[0].replace(",", "")
        size = 0.01 if word.endswith("%") else 1.0
        mantissa, _, power = word.rstrip(" %").partition("e")
        unit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
        found.append((size * float(word.rstrip(" %")), 0.5 * size * unit))
    return found


def check_evidence(
    result: object,
    field: str,
    expected: Any,
    *,
    rtol: float = 1e-6,
    atol: float = 0.0,
    measure: Callable[[Any], Any] = np.asarray,
) -> None:
    """Compare an error that a result reports with a reference, where an error was put in on purpose.

    Parameters
    ----------
    result : object
        What reports it.
    field : str
        The name of the attribute.
    expected : float or array
        The error that was put in, in the measure of the field: computed by the test. It may not be zero
        everywhere, nor below the tolerance: a field of zeros must fail.
    rtol, atol : float
        Of the comparison.
    measure : callable
        What of the field is compared, such as its length where its axes are not those of the test.
    """
    found, wanted = np.asarray(measure(getattr(result, field)), float), np.asarray(expected, float)
    largest = np.max(np.abs(wanted), initial=0.0, where=np.isfinite(wanted))
    assert largest > 2 * (atol + rtol * largest), f"{field}: no error was put in: {expected}"
    np.testing.assert_allclose(found, wanted, rtol=rtol, atol=atol, err_msg=field)
    _compared.update(f"{kind.__module__}.{kind.__qualname__}.{field}" for kind in type(result).__mro__)


def begin() -> None:
    """Forget what was compared, before a test."""
    _compared.clear()
    _codes.clear()


def not_compared(claims: Sequence[str]) -> list[str]:
    """Return the claims whose numbers were not compared since `begin`."""
    return [name for name in claims if name not in _compared and _code(name) not in _codes]


def _code(name: str) -> object:
    """Return the code of a function or method by its dotted name; None for what has none."""
    parts = name.split(".")
    size = next(n for n in range(len(parts), 0, -1) if ".".join(parts[:n]) in sys.modules)
    found: Any = importlib.import_module(".".join(parts[:size]))
    for part in parts[size:]:
        found = inspect.getattr_static(found, part, None)
    found = inspect.unwrap(getattr(found, "fget", None) or getattr(found, "callback", None) or found)
    return getattr(found, "__code__", None)


def _remember_makers() -> None:
    """Let each table know which functions were at work when it was made."""
    plain = Table.__init__

    @functools.wraps(plain)
    def made(self: Table, *args: Any, **named: Any) -> None:
        plain(self, *args, **named)
        frame, codes = sys._getframe(1), set()
        while frame is not None:
            codes.add(frame.f_code)
            frame = frame.f_back
        object.__setattr__(self, "_makers", codes)

    Table.__init__ = made  # type: ignore[method-assign]


_remember_makers()
