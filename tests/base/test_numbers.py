"""Tables of numbers as text and back: Python's own writer and reader are the reference."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from p3dof._base.files import numbers, numbers_of_lines, table_lines, write_table

pytest.importorskip("p3dof._base.files._numbers", reason="the extension is not built")

RNG = np.random.default_rng(26)
ANY = RNG.integers(0, 2**64, 60_000, dtype=np.uint64).view(np.float64)
"""Any bits: most are very large or very small, some no numbers."""
CORNERS = np.array(
    [0.0, -0.0, 1e22, 1e23, 9007199254740993.0, 123456789012345680.0, 1e16, 9999999999999998.0, 0.1, 1e-4]
    + [
        0.00012345,
        1e-5,
        5e-324,
        1e-323,
        2.2250738585072014e-308,
        1.7976931348623157e308,
        np.inf,
        -np.inf,
        np.nan,
    ]
    + [2.0**k for k in range(-1074, 1024)]
    + [10.0**k for k in range(-323, 309)]
)
USUAL = np.concatenate([RNG.normal(size=20_000), np.round(RNG.normal(size=20_000) * 1000, 3)])
NUMBERS = np.concatenate([ANY, CORNERS, USUAL, RNG.integers(-(2**60), 2**60, 5000).astype(float)])


def same_bits(found: np.ndarray, expected: np.ndarray) -> bool:
    return np.array_equal(found.view(np.uint64), expected.view(np.uint64))


def read(texts: list[str]) -> np.ndarray:
    found = numbers_of_lines("\n".join(texts), 0, 1000, 1)
    assert found is not None
    return np.ascontiguousarray(found[:, 0])


def test_numbers_are_written_as_python_writes_them() -> None:
    assert table_lines([NUMBERS]).decode().split("\n")[:-1] == list(map(repr, NUMBERS.tolist()))


def test_numbers_that_are_written_read_back_to_the_same_bits() -> None:
    finite = NUMBERS[np.isfinite(NUMBERS)]
    assert same_bits(read(table_lines([finite], False).decode().splitlines()), finite)


def test_any_digits_are_read_as_python_reads_them() -> None:
    texts = []
    for count, point, power, form in RNG.integers((1, 0, -345, 0), (25, 25, 320, 4), (30_000, 4)).tolist():
        digits = "".join(map(str, RNG.integers(0, 10, count)))
        number = f"{digits[:point]}.{digits[point:]}" if form else digits
        texts.append(f"{('', '-', '+', '')[form]}{number}{f'e{power}' if form > 1 else ''}")
    texts += [
        "0" * 30 + "1",
        "0." + "0" * 30 + "1",
        "1" + "0" * 30,
        "000.000",
        "-0",
        ".5",
        "5.",
        "1E+05",
        "1e-400",
    ]
    assert same_bits(read(texts), np.array([float(text) for text in texts]))


def test_what_lies_in_the_middle_of_two_numbers_is_rounded_as_python_rounds_it() -> None:
    texts = ["9007199254740993", "9007199254740993.0", "9007199254740995"]
    with localcontext() as context:
        context.prec = 800
        for number in RNG.normal(size=2000) * 10.0 ** RNG.integers(-20, 20, 2000):
            middle = (Decimal(number) + Decimal(np.nextafter(number, np.inf))) / 2
            texts += [f"{middle:f}"[:300], f"{middle:.18e}", f"{middle:.16e}"]
    assert same_bits(read(texts), np.array([float(text) for text in texts]))


def test_blank_lines_and_comments_are_no_rows() -> None:
    text = "x,y\n\n# a comment, of degrees °\n 1 ,\t-2.5e0\n   \n  # another\n3,4"
    found = numbers_of_lines(text, 4, 1000, 2)
    np.testing.assert_array_equal(found, [[1.0, -2.5], [3.0, 4.0]])


@pytest.mark.parametrize(
    "text",
    [
        *("1,2,3", "1", "1,", ",1", "1,x", "1,2 3", "1,nan", "1,inf", "1_0,2", '"1",2', "1,2\r\n3,4", "1;2"),
        *(
            "1,\u0661",
            "1,1e",
            "1,1e+",
            "1,e5",
            "1,.",
            "1,-",
            "1,--2",
            "1,2\0",
            "1,2\x0b",
            "1,0x10",
            "1,1e123456",
        ),
        *(f"1,{' ' * 200}2", f"# {'x' * 200}\n1,2", f"1,{'1' * 90}", "1,2\n3"),
    ],
)
def test_what_is_not_plain_is_left_to_a_careful_reader(text: str) -> None:
    assert numbers_of_lines(text, 0, 80, 2) is None
    assert numbers_of_lines(f"1,2\n{text}\n3,4\n", 0, 80, 2) is None


def test_text_stands_beside_numbers_as_it_is() -> None:
    many = np.arange(3.0).repeat(2)[::2]  # not side by side in memory
    assert table_lines([many, ["a", "é", ""]]) == "0.0,a\n1.0,é\n2.0,\n".encode()
    assert table_lines([many, many[:, None].T[0]], False) == b"0,0\n1,1\n2,2\n"
    assert table_lines([]) == b""


def test_columns_of_other_lengths_or_kinds_are_refused() -> None:
    with pytest.raises(ValueError, match="one length"):
        table_lines([np.zeros(2), np.zeros(3)])
    with pytest.raises(ValueError, match="doubles"):
        table_lines([np.zeros(2, np.int64)])


def test_without_the_extension_the_lines_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = [NUMBERS[-3000:], ["a"] * 3000]
    fast = [table_lines(columns, point) for point in (True, False)]
    monkeypatch.setattr(numbers, "_extension", lambda: None)
    assert [table_lines(columns, point) for point in (True, False)] == fast
    assert numbers_of_lines("1,2\n", 0, 80, 2) is None


def test_a_table_of_several_blocks_is_written_whole(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    from p3dof._base.files import writing

    monkeypatch.setattr(writing, "_ROWS", 7)
    names = np.array([f"{k}, {k}" if k % 5 == 0 else str(k) for k in range(30)])
    path = write_table(tmp_path / "table.csv", ["x [m]", "of, two"], (np.arange(30) / 8, names))
    lines = path.read_text().splitlines()
    assert lines[0] == 'x [m],"of, two"'
    assert lines[1:7] == ['0,"0, 0"', "0.125,1", "0.25,2", "0.375,3", "0.5,4", '0.625,"5, 5"']
    assert len(lines) == 31
