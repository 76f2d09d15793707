"""What is found of all items of a sweep: right, and the same bits in whatever order blocks are merged."""

from __future__ import annotations

import json
import pickle
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import p3dof
from p3dof._base import blocks
from p3dof._base.blocks.storage import REDUCTIONS

SEEDS = st.integers(0, 2**32 - 1)


def data(seed, count=300):
    """Columns with ties, both zeros, infinities, NaN, large and small numbers."""
    rng = np.random.default_rng(seed)
    ties = rng.integers(0, 6, (4, count)).astype(float)
    smooth = rng.normal(size=(4, count)) * 10.0 ** rng.integers(-8, 8, (4, 1))
    columns = np.where(rng.random((4, 1)) < 0.5, ties, smooth)
    columns[rng.random(columns.shape) < 0.03] = np.nan
    columns[rng.random(columns.shape) < 0.03] = -0.0
    columns[rng.random(columns.shape) < 0.01] = np.inf
    columns[rng.random(columns.shape) < 0.01] = -np.inf
    return {**dict(zip("abcd", columns, strict=True)), "code": rng.integers(0, 3, count)}


def parts(columns, seed):
    """The same columns cut into some blocks, with where they start."""
    count = len(columns["a"])
    rng = np.random.default_rng(seed)
    cuts = [0, *sorted(rng.choice(np.arange(1, count), rng.integers(1, 12), replace=False)), count]
    return [({k: v[i:j] for k, v in columns.items()}, i) for i, j in pairwise(cuts)]


KINDS = [
    blocks.TopK("a", 9),
    blocks.TopK("code", 20, largest=True, columns=("a",)),
    blocks.ParetoArchive({"a": "min"}),
    blocks.ParetoArchive({"a": "min", "b": "max"}),
    blocks.ParetoArchive({"a": "min", "b": "max", "c": "min"}),
    blocks.ParetoArchive({"a": "max", "b": "max"}, resolution={"a": 0.7}),
    blocks.ParetoArchive({"a": "min", "b": "max", "c": "min"}, resolution={"a": 2, "c": 3}),
    blocks.Histogram("b", -2, 5, 13),
    blocks.Moments(("a", "b", "code")),
]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@settings(max_examples=30)
@given(seed=SEEDS)
def test_the_order_of_merging_changes_no_bit(kind, seed):
    columns = data(seed)
    reduction = kind.over(tuple(columns))
    states = [reduction.of(part, start) for part, start in parts(columns, seed)]
    rng = np.random.default_rng(seed)
    at_once = reduction.merge([states[i] for i in rng.permutation(len(states))])
    one_by_one = states[0]
    for state in states[1:]:
        one_by_one = reduction.merge([state, one_by_one])
    while len(states) > 1:  # any tree
        i, j = rng.choice(len(states), 2, replace=False)
        pair = [states[i], states[j]]
        states = [state for k, state in enumerate(states) if k not in (i, j)] + [reduction.merge(pair)]
    expected = {name: (array.dtype.kind, array.tobytes()) for name, array in at_once.items()}
    for other in (one_by_one, states[0]):
        assert {name: (array.dtype.kind, array.tobytes()) for name, array in other.items()} == expected


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_blocks_may_be_cut_anywhere(kind):
    """But for means, whose blocks have rounded sums."""
    columns = data(5)
    reduction = kind.over(tuple(columns))
    whole = reduction.result(reduction.of(columns, 0))
    cut = reduction.result(reduction.merge([reduction.of(*part) for part in parts(columns, 6)]))
    if isinstance(kind, blocks.Moments):
        for name, found in whole.items():
            assert cut[name].mean == pytest.approx(found.mean, rel=1e-13)
            assert cut[name].deviation == pytest.approx(found.deviation, rel=1e-12)
            assert (cut[name].low, cut[name].high, cut[name].count) == (found.low, found.high, found.count)
    else:
        assert pickle.dumps(cut) == pickle.dumps(whole)


def dominated(one, others):
    return any(all(o <= x for o, x in zip(other, one)) and other != one for other in others)  # noqa: B905


@pytest.mark.parametrize("names", ["a", "ab", "abc", "abcd"])
@settings(max_examples=30)
@given(seed=SEEDS)
def test_a_pareto_archive_is_what_no_item_beats(names, seed):
    columns = data(seed, 120)
    ways = dict(zip(names, ("min", "max", "min", "max"), strict=False))
    reduction = blocks.ParetoArchive(ways).over(tuple(columns))
    found = reduction.result(reduction.merge([reduction.of(*part) for part in parts(columns, seed)]))
    signs = [1 if way == "min" else -1 for way in ways.values()]
    points = [tuple(s * columns[n][i] for s, n in zip(signs, ways, strict=True)) for i in range(120)]
    valid = [p for p in points if not any(np.isnan(p))]
    expected = [i for i, p in enumerate(points) if not any(np.isnan(p)) and not dominated(p, valid)]
    assert found.index.tolist() == expected
    for name, values in found.columns.items():
        np.testing.assert_array_equal(values, columns[name][expected])


@given(seed=SEEDS)
def test_a_coarse_archive_has_one_item_a_box_and_no_box_beats_another(seed):
    rng = np.random.default_rng(seed)
    columns = {"a": rng.normal(size=400), "b": rng.normal(size=400)}
    reduction = blocks.ParetoArchive({"a": "min", "b": "min"}, resolution={"a": 0.5, "b": 0.5})
    reduction = reduction.over(("a", "b"))
    found = reduction.result(reduction.of(columns, 0))
    boxes = [tuple(np.floor(np.array(point) / 0.5)) for point in zip(*found.columns.values(), strict=True)]
    assert len(set(boxes)) == len(boxes)
    everywhere = {tuple(np.floor(np.array(point) / 0.5)) for point in zip(*columns.values(), strict=True)}
    assert set(boxes) == {box for box in everywhere if not dominated(box, everywhere)}


@given(seed=SEEDS, largest=st.booleans())
def test_the_best_are_in_order_and_ties_go_to_lower_items(seed, largest):
    columns = data(seed)
    reduction = blocks.TopK("a", 25, largest=largest).over(tuple(columns))
    found = reduction.result(reduction.merge([reduction.of(*part) for part in parts(columns, seed)]))
    sign = -1 if largest else 1
    valid = [i for i in range(300) if not np.isnan(columns["a"][i])]
    assert found.index.tolist() == sorted(valid, key=lambda i: (sign * columns["a"][i], i))[:25]
    assert found.columns["code"].dtype == np.int64


@given(seed=SEEDS)
def test_means_are_those_of_exact_sums(seed):
    rng = np.random.default_rng(seed)
    values = 1e6 + rng.normal(size=500)  # a mean far from zero
    reduction = blocks.Moments("x").over(("x",))
    cuts = np.array_split(values, 7)
    found = reduction.result(reduction.merge([reduction.of({"x": part}, 0) for part in cuts]))["x"]
    exact = sum(map(Fraction, values.tolist())) / 500
    variance = sum((Fraction(v) - exact) ** 2 for v in values.tolist()) / 500
    assert found.mean == pytest.approx(float(exact), rel=1e-15)
    # a block's mean is rounded to 1e-16 of 1e6, and its part of the variance by that times a deviation
    assert found.deviation == pytest.approx(float(variance) ** 0.5, rel=1e-9)
    assert (found.low, found.high, found.count, found.invalid) == (values.min(), values.max(), 500, 0)


def test_means_of_nothing_do_not_exist():
    reduction = blocks.Moments("x").over(("x",))
    found = reduction.result(reduction.of({"x": np.array([np.nan, np.inf])}, 0))["x"]
    assert np.isnan([found.mean, found.deviation, found.low, found.high]).all()
    assert (found.count, found.invalid) == (0, 2)


def test_histograms_count_everything_once():
    columns = {"x": np.array([-1, 0, 0.5, 1, 2, 2.5, 3, np.nan, np.inf, -np.inf])}
    reduction = blocks.Histogram("x", 0, 2, 2).over(("x",))
    found = reduction.result(reduction.of(columns, 0))
    assert found.counts.tolist() == [2, 2]  # 0, .5 and 1, 2: the last bin has its upper edge too
    assert (found.below, found.above, found.invalid) == (2, 3, 1)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_manifest_tells_all_of_a_reduction(kind):
    told = json.loads(json.dumps(kind.settings()))
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in told.items()}
    assert REDUCTIONS[values.pop("kind")](**values) == kind


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: blocks.TopK("a", 0), "count: expected a whole number from 1"),
        (lambda: blocks.ParetoArchive({}), "objectives: expected one column or more"),
        (lambda: blocks.ParetoArchive({"a": "low"}), "objectives: a: expected 'min' or 'max', got 'low'"),
        (lambda: blocks.ParetoArchive({"a": "min"}, {"b": 1}), "resolution: expected one of the objectives"),
        (lambda: blocks.ParetoArchive({"a": "min"}, {"a": 0}), "resolution: a: expected a positive number"),
        (lambda: blocks.Histogram("a", 1, 1), "low, high: expected room for 50 bins"),
        (lambda: blocks.Histogram("a", 1, np.nan), "high: expected a finite number"),
        (lambda: blocks.Histogram("a", 0, 1, 0), "bins: expected a whole number from 1"),
        (lambda: blocks.Moments(()), "columns: expected one column or more"),
    ],
)
def test_bad_reductions_are_refused(make, message):
    with pytest.raises(p3dof.InputError, match=message):
        make()


def test_a_front_that_is_too_large_says_what_to_do(monkeypatch):
    monkeypatch.setattr(blocks.ParetoArchive, "most", 10)
    line = np.arange(20.0)
    reduction = blocks.ParetoArchive({"a": "min", "b": "min"}).over(("a", "b"))
    with pytest.raises(p3dof.errors.SweepError, match="more than 10 items; with a `resolution`"):
        reduction.of({"a": line, "b": -line}, 0)
