"""Traced functions as WebAssembly, run by a browser's engine: the same numbers as Python's floats."""

from __future__ import annotations

import base64
import math

import numpy as np
import pytest

from p3dof._base.tracing.printing import function_of
from p3dof._base.tracing.tape import FUNCTIONS, Tape
from p3dof._base.tracing.wasm import Traced, leb, module_of

RUN = """async ([bytes, calls]) => {
    const module = Uint8Array.from(atob(bytes), (x) => x.charCodeAt(0));
    const { instance } = await WebAssembly.instantiate(module, { m: Math });
    const memory = new Float64Array(instance.exports.memory.buffer);
    return calls.map(([name, rows, size]) => rows.map((row) => {
        memory.set(row);
        instance.exports[name](0, 8 * row.length);
        return [...memory.subarray(row.length, row.length + size)].map((x) => Number.isNaN(x) ? "nan" : x);
    }));
}"""


@pytest.fixture(scope="module")
def page(browser):
    page = browser.new_page()
    yield page
    page.close()


def traced(count, formula):
    tape = Tape()
    inputs = tape.symbols(f"x{i}" for i in range(count))
    return Traced(tape, inputs, formula(tape, *inputs))


def run(page, functions, rows):
    """The results of functions at rows of inputs, by name."""
    module = base64.b64encode(module_of(functions)).decode()
    calls = [[name, rows[name].tolist(), len(one.results)] for name, one in functions.items()]
    found = page.evaluate(RUN, [module, calls])
    return {name: np.array(x, dtype=float) for name, x in zip(functions, found, strict=True)}


class Numbers:
    """The functions of Python's own numbers, and what it has not."""

    sqrt, sin, cos, tanh, fabs, atan2 = math.sqrt, math.sin, math.cos, math.tanh, math.fabs, math.atan2
    floor = staticmethod(lambda x: x if math.isnan(x) else float(math.floor(x)))
    rsqrt = staticmethod(lambda x: 1.0 / math.sqrt(x))
    minimum = staticmethod(lambda a, b: a if a < b else b)


def python(function, rows):
    call = function_of(function.tape, function.inputs, function.results, Numbers)
    return np.array([call(*row.tolist()) for row in rows])


def test_every_operation_is_that_of_python(page):
    def formula(tape, x, y):
        some = [getattr(tape, name)(*((y, x) if name == "atan2" else (x,))) for name in FUNCTIONS]
        return [x + y, x - y, x * y, x / y, -x, *some, tape.minimum(x, y), 3.5, x]

    function = traced(2, formula)
    rows = np.array([[0.7, -1.3], [2.0, 2.0], [1e-300, 4.0], [0.6, -0.1], [math.nan, 1.0], [1.0, math.nan]])
    found = run(page, {"all": function}, {"all": rows})["all"]
    expected = python(function, rows)
    exact = [i for i in range(len(function.results)) if i not in range(5, 5 + len(FUNCTIONS))]
    exact += [5 + FUNCTIONS.index(name) for name in ("sqrt", "floor", "fabs")]
    np.testing.assert_array_equal(found[:, exact], expected[:, exact])
    np.testing.assert_allclose(found, expected, rtol=4e-16, atol=0)


@pytest.mark.parametrize("seed", range(6))
def test_random_formulas_keep_their_bits_whatever_shares_a_local(page, seed):
    """Sums and products only: no library has a say in them."""
    draw = np.random.default_rng(seed)

    def formula(tape, *x):
        values = list(x)
        for _ in range(400):
            i, j = draw.integers(max(0, len(values) - 60), len(values), 2)
            name = draw.choice(["add", "subtract", "multiply", "minimum"])
            if draw.random() < 0.1:
                values.append(values[i] * float(draw.normal()))
            else:
                values.append(getattr(tape, name)(values[i], values[j]) * 0.5)
        return [values[i] for i in draw.integers(0, len(values), 30)] + values[-3:]

    functions = {"one": traced(5, formula), "two": traced(3, formula)}
    rows = {"one": draw.normal(size=(3, 5)), "two": draw.normal(size=(3, 3))}
    found = run(page, functions, rows)
    for name, function in functions.items():
        np.testing.assert_array_equal(found[name], python(function, rows[name]))


def test_long_chains_and_large_memories_are_taken(page):
    """Three thousand sums within sums, and more numbers than a page of memory has."""

    def chain(_tape, x):
        total = x
        for k in range(3000):
            total = total * 0.999 + float(k)
        return [total]

    def wide(_tape, *x):
        return [value + 1.0 for value in x]

    nothing = traced(0, lambda _tape: [])
    functions = {"chain": traced(1, chain), "wide": traced(6000, wide), "nothing": nothing}
    rows = {"chain": np.array([[0.3]]), "wide": np.arange(6000.0)[None], "nothing": np.zeros((1, 0))}
    found = run(page, functions, rows)
    np.testing.assert_array_equal(found["chain"], python(functions["chain"], rows["chain"]))
    np.testing.assert_array_equal(found["wide"], rows["wide"] + 1.0)
    assert found["nothing"].size == 0


def test_numbers_in_leb128():
    """The example of the DWARF standard (version 4, figure 22), and the ends of one byte."""
    assert leb(624485) == b"\xe5\x8e\x26"
    assert [leb(n) for n in (0, 127, 128)] == [b"\0", b"\x7f", b"\x80\x01"]
