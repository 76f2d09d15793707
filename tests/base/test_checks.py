"""The argument checks that several modules share."""

import numpy as np
import pytest

from p3dof._base.checks import as_floats, batch_of, frozen_array, one_line, positive
from p3dof._base.errors import InputError, MotionError, ParameterError

NOT_NUMBERS = {
    "text": "1",
    "texts": ["1", "2", "3"],
    "none": None,
    "nones": [None, None, None],
    "ragged": [[1, 2], [3]],
    "complex": [1j, 2, 3],
    "bool": True,
    "bools": [True, False, True],
    "object": object(),
    "mapping": {"x": 1.0},
    "set": {1, 2, 3},
    "dates": np.array(["2024-01-01"], dtype="datetime64[D]"),
    "bytes": b"abc",
    "big_integer": [10**400, 0, 0],
}


@pytest.mark.parametrize("value", NOT_NUMBERS.values(), ids=NOT_NUMBERS)
@pytest.mark.parametrize("error", [InputError, ParameterError, MotionError])
def test_what_is_not_a_real_number_is_refused_by_name(value, error):
    for check in (
        lambda: as_floats("pose", value, error),
        lambda: frozen_array("pose", value, (3,), error),
        lambda: positive("pose", value, error),
    ):
        with pytest.raises(error, match=r"^pose: expected real numbers"):
            check()


@pytest.mark.parametrize(
    "value",
    [3, 2.5, np.float32(1.5), [1, 2], np.arange(6, dtype=np.uint8).reshape(2, 3), (1.0, np.nan, np.inf)],
)
def test_real_numbers_of_any_kind_become_doubles(value):
    array = as_floats("x", value)
    assert array.dtype == np.float64
    np.testing.assert_array_equal(array, np.asarray(value, dtype=float))


def test_frozen_array_is_a_read_only_copy():
    mine = np.arange(3.0)
    array = frozen_array("x", mine, (3,))
    mine[0] = 7.0
    assert array.tolist() == [0, 1, 2]
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 1.0
    assert mine.flags.writeable


@pytest.mark.parametrize(
    ("value", "shape", "message"),
    [
        ([1, 2], (3,), r"^x: expected shape \(3,\), got \(2,\)$"),
        (1.0, (3,), r"^x: expected shape \(3,\), got a single number$"),
        ([1, 2], (), r"^x: expected a single number, got shape \(2,\)$"),
        (np.zeros((4, 2)), ("N", 3), r"^x: expected shape \(N, 3\), got \(4, 2\)$"),
        (np.zeros((3, 3, 1)), (3, 3), r"^x: expected shape \(3, 3\), got \(3, 3, 1\)$"),
        ([1, np.nan, 3], (3,), r"^x: expected finite numbers, got nan at index \[1\]$"),
        ([[0, 0], [0, -np.inf]], (2, 2), r"^x: expected finite numbers, got -inf at index \[1, 1\]$"),
        (np.inf, (), r"^x: expected a finite number, got inf$"),
        (np.nan, (), r"^x: expected a finite number, got nan$"),
        (-1e31, (), r"^x: expected a number of at most 1e\+30 in size, got -1e\+31$"),
        ([0, 1e200], ("N",), r"^x: expected numbers of at most 1e\+30 in size, got 1e\+200 at index \[1\]$"),
        ("8,15", (), "^x: expected real numbers, got '8,15'$"),
        (["1", "two"], (2,), "^x: expected real numbers, got 'two'$"),
        (["1", "2"], (2,), "^x: expected real numbers, got '1'$"),
        (np.array([], "U1"), (0,), "^x: expected real numbers, got text$"),
        (True, (), "^x: expected real numbers, got True$"),
        ([True, False], (2,), "^x: expected real numbers, got true or false$"),
    ],
)
def test_frozen_array_names_expected_and_received(value, shape, message):
    with pytest.raises(InputError, match=message):
        frozen_array("x", value, shape)


@pytest.mark.parametrize("shape", [("N", 3), (0, 3), ("N", "M")])
def test_letters_stand_for_any_length(shape):
    assert frozen_array("x", np.zeros((0, 3)), shape).shape == (0, 3)


@pytest.mark.parametrize("shape", [(3,), (1, 3), (4, 5, 3), (0, 3)])
def test_batch_of_keeps_leading_axes(shape):
    value = np.full(shape, np.nan)
    assert batch_of("pose", value, 3).shape == shape


@pytest.mark.parametrize("value", [1.0, [], [1, 2], np.zeros((3, 4)), np.zeros((3, 0))])
def test_batch_of_refuses_other_lengths(value):
    with pytest.raises(InputError, match=r"^pose: expected shape \(\.\.\., 3\), got \("):
        batch_of("pose", value, 3)


@pytest.mark.parametrize("value", [1, 2.5, np.float64(1e-30), np.int32(4), np.array(3.0)])
def test_positive_returns_a_float(value):
    number = positive("r", value, ParameterError)
    assert type(number) is float
    assert number == value


@pytest.mark.parametrize("value", [0, -1.0, -0.0, np.nan, np.inf, [1.0], "1", None, True])
def test_positive_refuses(value):
    with pytest.raises(ParameterError, match=r"^r: expected"):
        positive("r", value, ParameterError)


@pytest.mark.parametrize("size", [3, 4999, 5001])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1.0000001e30, 1e200])
def test_one_wrong_number_among_many_is_found(size, wrong):
    values = np.linspace(-1.0, 1.0, size)
    values[size // 2] = wrong
    with pytest.raises(InputError, match=rf"values: expected .* at index \[{size // 2}\]"):
        frozen_array("values", values, (size,))
    values[size // 2] = -1e30
    found = frozen_array("values", values, (size,))
    assert not found.flags.writeable
    np.testing.assert_array_equal(found, values)
    assert not np.shares_memory(found, values)


def test_a_long_text_on_one_line_says_that_its_end_is_left_out():
    assert one_line("a\n\t b") == "a b"
    assert one_line("x" * 400) == "x" * 400
    assert one_line("x" * 401) == "x" * 400 + "..."
    assert one_line("ab" + " " * 10 + "c", limit=6) == "ab..."
    assert one_line("ab" + " " * 9 + "c", limit=6) == "ab c"
