"""Columns of inputs: spread as they should be, and the same in whatever blocks they are drawn."""

from __future__ import annotations

import threading
from statistics import NormalDist

import numpy as np
import pytest
from scipy import stats

import p3dof
from p3dof._base import blocks

METHODS = ("random", "latin-hypercube", "sobol")
VARIABLES = {"a": blocks.Uniform(2, 5), "b": blocks.Normal(1, 0.1), "c": blocks.LogUniform(1e-3, 10)}


def drawn(samples, size, seed=7, order=None):
    """All columns, drawn block by block."""
    starts = list(range(0, samples.count, size))
    parts = {}
    for number in order(len(starts)) if order else range(len(starts)):
        start = starts[number]
        block = blocks.Block(number, start, min(start + size, samples.count), seed)
        parts[number] = samples.draw(block)
    return {name: np.concatenate([parts[i][name] for i in sorted(parts)]) for name in samples.names}


@pytest.mark.parametrize("method", METHODS)
def test_columns_are_spread_as_they_should_be(method):
    found = drawn(blocks.Samples(VARIABLES, 4096, method), 512)
    laws = {"a": stats.uniform(2, 3), "b": stats.norm(1, 0.1), "c": stats.loguniform(1e-3, 10)}
    for name, law in laws.items():
        largest = np.abs(np.sort(law.cdf(found[name])) - (np.arange(4096) + 0.5) / 4096).max()
        # Random numbers are about 1 / sqrt(n) off; layers and Sobol points at most one layer of a block.
        assert largest < (2 / np.sqrt(4096) if method == "random" else 1.01 / 512)
    correlation = np.corrcoef(list(found.values())) - np.eye(3)
    assert np.abs(correlation).max() < 0.06


@pytest.mark.parametrize("method", METHODS)
def test_a_block_is_the_same_whenever_it_is_drawn(method):
    samples = blocks.Samples(VARIABLES, 1000, method)
    expected = drawn(samples, 96)
    for order in (lambda n: range(n - 1, -1, -1), np.random.default_rng(0).permutation):
        found = drawn(samples, 96, order=order)
        for name, values in expected.items():
            np.testing.assert_array_equal(found[name], values)
    other = drawn(samples, 96, seed=8)
    assert not np.any(np.isin(other["a"], expected["a"]))


def test_normal_numbers_are_finite_and_those_of_the_standard_library_out_to_both_ends():
    law, shares = NormalDist(3.0, 0.5), [2.0**-54, 1e-9, 0.3, 0.5, 0.975, 1 - 2.0**-53]
    found = blocks.Normal(3.0, 0.5).at(np.array([0.0, *shares, 1.0]))
    expected = [law.inv_cdf(share) for share in shares]
    np.testing.assert_allclose(found, [expected[0], *expected, expected[-1]], rtol=1e-12)


def test_sobol_points_are_those_of_one_sequence_however_they_are_cut():
    samples = blocks.Samples(VARIABLES, 1024, "sobol")
    whole = drawn(samples, 1024)
    for size in (1, 100, 333):
        for name, values in drawn(samples, size).items():
            np.testing.assert_array_equal(values, whole[name])
    for name, law in (("a", stats.uniform(2, 3)), ("b", stats.norm(1, 0.1))):
        layers = np.floor(law.cdf(whole[name]) * 1024).astype(int)
        assert sorted(layers.tolist()) == list(range(1024))  # one in each layer: what makes it Sobol's


def test_a_latin_hypercube_has_one_item_in_each_layer_of_a_block():
    samples = blocks.Samples(VARIABLES, 300, "latin-hypercube")
    for number in range(3):
        found = samples.draw(blocks.Block(number, 100 * number, 100 * number + 100, 1))
        layers = np.floor((found["a"] - 2) / 3 * 100).astype(int)
        assert sorted(layers.tolist()) == list(range(100))


def test_threads_draw_sobol_points_without_disturbing_each_other():
    samples = blocks.Samples(VARIABLES, 2000, "sobol")
    expected, found = drawn(samples, 50), {}

    def work(name):
        found[name] = drawn(samples, 50, order=np.random.default_rng(name).permutation)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(found[i][name], expected[name]) for i in range(4) for name in VARIABLES)


def test_a_grid_has_all_combinations():
    grid = blocks.Grid({"a": [1, 2], "b": [5.0, 6.0, 7.0]})
    found = drawn(grid, 4)
    assert grid.count == 6
    assert found["a"].tolist() == [1, 1, 1, 2, 2, 2]
    assert found["b"].tolist() == [5, 6, 7, 5, 6, 7]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: blocks.Uniform(2, 1), "low, high: expected low < high, got 2 and 1"),
        (lambda: blocks.Uniform(0, np.inf), "high: expected a finite number"),
        (lambda: blocks.LogUniform(0, 1), "low: expected a positive number"),
        (lambda: blocks.Normal(0, 0), "deviation: expected a positive number"),
        (lambda: blocks.Samples({}, 5), "variables: expected one column or more"),
        (lambda: blocks.Samples({"a b": blocks.Uniform(0, 1)}, 5), "variables: expected names of letters"),
        (lambda: blocks.Samples({"a": 5}, 5), "a: expected Uniform, Normal or the like, got 5"),
        (lambda: blocks.Samples(VARIABLES, 0), "count: expected a whole number from 1"),
        (lambda: blocks.Samples(VARIABLES, 5, "halton"), "method: expected random, latin-hypercube, sobol"),
        (lambda: blocks.Samples(VARIABLES, 2**32 + 1, "sobol"), "count: expected a whole number from 1"),
        (lambda: blocks.Grid({"a": []}), "a: expected one value or more"),
        (lambda: blocks.Grid({"a": [np.nan]}), "a: expected finite numbers"),
    ],
)
def test_bad_samplings_are_refused(make, message):
    with pytest.raises(p3dof.InputError, match=message):
        make()
