"""Sensitivity: Sobol' indices against closed forms, SALib, published numbers; derivatives by differences."""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import p3dof
from p3dof._base import blocks
from p3dof._base.blocks.problem import Block
from p3dof._base.errors import InputError
from p3dof.analysis.tolerances import MatchedSamples, sobol_indices
from p3dof.machine.parameters import PAPER, SOLIDS, Body

MOTION = p3dof.paper_motion(201)
NAMES = ("r", "R", "L", "rod_radius")
RANGES = dict.fromkeys(NAMES, "10 %")
SHORT = p3dof.paper_motion(11)


def ishigami(columns):
    x = [columns[name] for name in ("x0", "x1", "x2")]
    return np.sin(x[0]) + 7 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


ISHIGAMI = {f"x{i}": blocks.Uniform(-np.pi, np.pi) for i in range(3)}


def exact_ishigami():
    first = [0.5 * (1 + 0.1 * np.pi**4 / 5) ** 2, 49 / 8, 0.0]
    rest = 0.01 * np.pi**8 * (1 / 18 - 1 / 50)
    variance = sum(first) + rest
    return np.array(first) / variance, np.array([first[0] + rest, first[1], rest]) / variance, variance


def drawn(sampling, seed=0):
    return sampling.draw(Block(0, 0, sampling.count, seed))


def test_indices_of_a_function_with_closed_forms():
    first, total, variance = exact_ishigami()
    sampling = MatchedSamples(ISHIGAMI, 2**14)
    found = sobol_indices(ishigami(drawn(sampling)), sampling.names)
    assert_allclose(found.first, first, atol=0.01)
    assert_allclose(found.total, total, atol=0.01)
    assert found.deviation == pytest.approx(np.sqrt(variance), rel=1e-2)
    assert found.mean == pytest.approx(3.5, abs=0.02)


def test_confidence_intervals_hold_what_they_promise():
    """With independent points: those of Sobol's sequence miss by less."""
    first, total, _ = exact_ishigami()
    rng = np.random.default_rng(1)
    inside = np.zeros((2, 3))
    for _ in range(200):
        a, b = rng.uniform(-np.pi, np.pi, (2, 1000, 3))
        rows = [a, b, *(np.where(np.arange(3) == i, b, a) for i in range(3))]
        values = np.stack([ishigami({f"x{i}": part[:, i] for i in range(3)}) for part in rows], axis=1)
        found = sobol_indices(values.ravel(), tuple(ISHIGAMI))
        inside[0] += np.abs(found.first - first) <= found.first_error
        inside[1] += np.abs(found.total - total) <= found.total_error
    assert (inside >= 180).all()  # 95 % of 200 are 190, less three standard deviations of it


def test_rows_are_matched_whatever_the_blocks_are():
    sampling = MatchedSamples(ISHIGAMI, 8)
    whole = np.stack(list(drawn(sampling, 4).values()), axis=1).reshape(8, 5, 3)
    for i in range(3):
        others = [k for k in range(3) if k != i]
        assert_array_equal(whole[:, 2 + i, others], whole[:, 0, others])
        assert_array_equal(whole[:, 2 + i, i], whole[:, 1, i])
    parts = [sampling.draw(Block(k, start, min(start + 7, 40), 4)) for k, start in enumerate(range(0, 40, 7))]
    together = np.concatenate([np.stack(list(part.values()), axis=1) for part in parts])
    assert_array_equal(together, whole.reshape(40, 3))
    assert not np.array_equal(np.stack(list(drawn(sampling, 5).values()), axis=1), together)


def test_salib_has_the_same_indices_of_the_same_results():
    """SALib normalises its results, and estimates S1 in another way: as far apart as the intervals."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its imports
        from SALib.analyze import sobol

        sampling = MatchedSamples(ISHIGAMI, 2**12)
        values = ishigami(drawn(sampling))
        rows = values.reshape(-1, 5)
        theirs = sobol.analyze(
            {"num_vars": 3, "names": list(ISHIGAMI), "bounds": [[0, 1]] * 3},
            rows[:, [0, 2, 3, 4, 1]].ravel(),
            calc_second_order=False,
            num_resamples=100,
            seed=1,
        )
    found = sobol_indices(values, sampling.names)
    assert_allclose(found.total, theirs["ST"], atol=1e-3)
    assert_allclose(found.total_error, theirs["ST_conf"], rtol=0.4)
    assert (np.abs(found.first - theirs["S1"]) <= found.first_error + theirs["S1_conf"]).all()


def test_indices_of_the_peak_force_are_the_published_ones():
    found = p3dof.sensitivity(SOLIDS, MOTION, RANGES, bodies="solids", rows=4096)
    assert_allclose(found.first, [0.546, 0.250, 0.158, 0.039], atol=1e-3)
    assert_allclose(found.total, [0.552, 0.256, 0.160, 0.039], atol=1e-3)
    assert found.mean == pytest.approx(121.01, abs=0.02)
    assert found.deviation == pytest.approx(12.95, abs=0.02)
    assert found.unit == "N"
    assert found.rows == 4096
    assert found.missing_rows == 0
    assert found.low < found.mean < found.high
    assert "geometry.r 0.552" in repr(found)


def test_derivatives_at_the_machine_are_the_published_ones():
    found = p3dof.sensitivity(SOLIDS, MOTION, RANGES, bodies="solids", method="gradient")
    assert_allclose(found.gradient, [1632.4, -434.67, 219.59, 4369.5], rtol=3e-5)
    assert found.value == pytest.approx(119.93761, abs=1e-5)
    assert_allclose(found.normalised, found.gradient * [0.1, 0.25, 0.4, 0.01] / found.value)
    assert found.units == ("m", "m", "m", "m")
    assert "peak_force = 119.938 N" in repr(found)


def moved(name, share):
    """A machine with one number of it changed, by hand."""
    if name == "R":
        return replace(PAPER, geometry=replace(PAPER.geometry, R=PAPER.geometry.R * (1 + share)))
    links = {"platform.mass": ("platform",), "leg.mass": ("leg_a", "leg_b", "rod_left", "rod_right")}[name]
    by = 1 + share
    new = {k: Body(by * x.mass, x.com, by * x.inertia) for k, x in PAPER.bodies.items() if k in links}
    return replace(PAPER, bodies=replace(PAPER.bodies, **new))


@pytest.mark.parametrize("figure", ["rms_force_b", "peak_power", "actuation", "reach", "peak_speed_c"])
def test_any_figure_can_be_asked(figure):
    names = ("R", "platform.mass", "leg.mass")
    found = p3dof.sensitivity(p3dof.load(), SHORT, dict.fromkeys(names, "1 %"), figure, method="gradient")
    machines = [moved(name, sign * 1e-5) for name in names for sign in (1, -1)]
    forces = p3dof.analysis.forces_of_designs(machines, SHORT, figures=("singularity", "power"))
    values = getattr(forces, figure.removesuffix("_b").removesuffix("_c"))
    if values.ndim == 2:
        values = (
            values[:, 1]
            if figure.endswith("_b")
            else values[:, 2]
            if figure.endswith("_c")
            else values.max(1)
        )
    by_hand = (values[::2] - values[1::2]) / (2e-5 * found.nominal)
    assert_allclose(found.gradient, by_hand, rtol=1e-6, atol=1e-8)


def test_the_same_seed_gives_the_same_indices_anywhere(tmp_path):
    ask = {"variables": RANGES, "bodies": "solids", "rows": 4096, "seed": 3}
    here = p3dof.sensitivity(SOLIDS, SHORT, **ask)
    with ThreadPoolExecutor(2) as client:
        there = p3dof.sensitivity(SOLIDS, SHORT, client=client, folder=tmp_path / "sobol", **ask)
    assert_array_equal(there.total, here.total)
    paths = sorted(path for path in (tmp_path / "sobol" / "blocks").rglob("*") if path.is_file())
    assert len(paths) == 2
    paths[0].unlink()
    again = p3dof.sensitivity(SOLIDS, SHORT, folder=tmp_path / "sobol", resume=True, **ask)
    assert_array_equal(again.total, here.total)


def test_machines_that_cannot_move_are_refused_with_a_count_or_left_out_in_whole_rows():
    wide = {"L": (0.12, 0.4), "platform.mass": "10 %"}
    with pytest.raises(InputError, match=r"\d+ of 1024 results are missing; on_missing='drop'"):
        p3dof.sensitivity(PAPER, SHORT, wide, rows=256)
    found = p3dof.sensitivity(PAPER, SHORT, wide, rows=256, on_missing="drop")
    assert 0 < found.missing_rows < 256
    assert found.rows + found.missing_rows == 256
    assert np.isfinite(found.total).all()


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (np.ones(10), "all results are the same"),
        (np.ones(9), "complete rows of 5"),
        (np.ones((2, 5)), "complete rows of 5"),
        (np.full(10, np.nan), "10 of 10 results are missing"),
        (["a"], "real numbers"),
    ],
)
def test_results_that_make_no_indices_are_refused(values, told):
    with pytest.raises(InputError, match=told):
        sobol_indices(values, tuple(ISHIGAMI))
    with pytest.raises(InputError, match="in 2 of 2 matched rows"):
        sobol_indices(np.full(10, np.inf), tuple(ISHIGAMI), on_missing="drop")
    with pytest.raises(InputError, match="in 1 of 2 matched rows"):
        sobol_indices([*np.full(5, np.inf), *range(5)], tuple(ISHIGAMI), on_missing="drop")
    assert sobol_indices([*np.full(5, np.inf), *range(10)], tuple(ISHIGAMI), on_missing="drop").rows == 2


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"variables": None}, "variables: expected numbers by names"),
        ({"variables": {"R": (0.3, 0.2)}}, "low < high"),
        ({"variables": {"R": ("0.3 kg", "1 m")}}, "expected a length"),
        ({"variables": {"radius": "1 %"}}, "variables: unknown column"),
        ({"variables": {"offset.y": "1 %"}}, "of a number that is 0"),
        ({"figure": "beauty"}, "figure: expected one of reach"),
        ({"figure": "peak_time"}, "figure: expected one of reach"),
        ({"figure": "reach_a"}, "figure: expected one of reach"),
        ({"method": "morris"}, "method: expected 'sobol' or 'gradient'"),
        ({"motion": None}, "motion: expected a Motion"),
        ({"bodies": "none"}, "bodies: expected"),
        ({"rows": 1}, "rows: expected a whole number from 2"),
        ({"on_missing": "ignore"}, "on_missing: expected 'raise' or 'drop'"),
    ],
)
def test_bad_arguments_are_told(changes, told):
    given = {"robot": PAPER, "motion": SHORT, "variables": {"R": "1 %"}, "rows": 4} | changes
    with pytest.raises(InputError, match=told):
        p3dof.sensitivity(**given)
