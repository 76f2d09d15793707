"""Pareto fronts: both ways against optima that are computed apart, interruption, hypervolumes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from design_problems import PAPER_DESIGN, paper_problem

import p3dof
from p3dof import InputError
from p3dof._base.errors import OptimisationError, SweepError
from p3dof.design import Front
from p3dof.design.optimisation import front_tables
from p3dof.design.optimisation.pareto import _spread, efficient, hypervolume

PEAK_AND_WIDTH = ["peak_force", "width"]
PUBLISHED = {0.6: 60.3126, 0.5: 61.6491, 0.45: 63.1718, 0.4: 65.3750, 0.36: 67.9655}
"""Width of the base [m] and least peak force [N], of two other programs."""


@pytest.fixture(scope="module")
def by_epsilon() -> Front:
    return paper_problem().pareto(PEAK_AND_WIDTH, points=31)


@pytest.fixture(scope="module")
def by_nsga() -> Front:
    pytest.importorskip("pymoo")
    return paper_problem().pareto(PEAK_AND_WIDTH, method="nsga2", population=60, generations=40, points=31)


def test_designs_that_agree_to_nine_digits_are_one_of_a_front() -> None:
    """Of different starts: what differs in the tenth digit is rounding, and in the eighth another design."""
    small = SimpleNamespace(better="small")
    for apart, count in ((3e-10, 1), (3e-8, 2)):
        costs = np.array([[0.5, 1.0], [0.5 + apart, 1.0 - apart], [0.6, 1.1]])  # the last one is dominated
        found = SimpleNamespace(objectives=costs, feasible=np.ones(3, dtype=bool))
        problem = SimpleNamespace(objectives=[small, small], evaluate=lambda _, found=found: found)
        assert len(efficient(problem, np.arange(3.0)[:, None])) == count


def test_fronts_lie_on_the_published_optima(by_epsilon: Front) -> None:
    peak, width = by_epsilon.objectives.T
    assert len(by_epsilon) == 31
    assert (np.diff(width) > 0).all()
    assert (np.diff(peak) < 0).all()
    for bound, expected in PUBLISHED.items():
        # The front is convex: straight lines between its points lie above it, by less than 0.5 % here.
        assert expected - 1e-4 < np.interp(bound, width, peak) < 1.005 * expected


@pytest.mark.slow
def test_polished_fronts_of_nsga_are_those_of_the_epsilon_constraint_method(by_nsga: Front) -> None:
    assert len(by_nsga.unpolished) > 20
    for index in range(1, len(by_nsga), 6):
        peak, width = by_nsga.objectives[index]
        exact = paper_problem().minimise("peak_force", {"width": float(width)}, starts=2)
        assert peak == pytest.approx(exact.value, rel=1e-5)


@pytest.mark.slow
def test_polishing_only_makes_fronts_better(by_nsga: Front, by_epsilon: Front) -> None:
    corner = [120.0, 0.7]
    before = hypervolume(by_nsga.unpolished, np.array(corner))
    assert before < by_nsga.hypervolume(corner)
    assert by_nsga.hypervolume(corner) == pytest.approx(by_epsilon.hypervolume(corner), rel=1e-3)
    assert by_epsilon.hypervolume(corner) == pytest.approx(22.54, rel=2e-3)


def test_efficient_are_the_feasible_designs_that_no_other_one_dominates() -> None:
    """One objective is to be large; each pair is compared, and a design that is there twice counts once."""
    problem = paper_problem(objectives=["width", "rod_frequency"], motion=p3dof.paper_motion(21))
    designs = np.array(PAPER_DESIGN) * np.random.default_rng(1).uniform(0.8, 1.2, (60, 4))
    found = problem.evaluate(designs)
    width, frequency = found.objectives.T
    best = [
        i
        for i in np.flatnonzero(found.feasible)
        if not any(
            width[k] <= width[i] and frequency[k] >= frequency[i] and k != i
            for k in np.flatnonzero(found.feasible)
        )
    ]
    assert 3 < len(best) < found.feasible.sum() < 60
    best.sort(key=lambda i: frequency[i])
    twice = np.vstack([designs, designs[best[:2]]])
    np.testing.assert_array_equal(efficient(problem, twice), designs[best])


def test_members_are_spread_from_the_ends_of_a_front_to_the_widest_gaps() -> None:
    """Along a line, in another order, with a dominated one: its ends, then what is farthest from all."""
    along = np.array([0.0, 0.55, 1.0, 0.1, 0.5, 0.25, 0.8])
    costs = np.vstack([np.stack([3 * along, 1 - along], axis=1), [2.9, 0.9]])
    assert set(_spread(costs, 2)) == {0, 2}
    assert _spread(costs, 5)[2:] == [4, 5, 6]  # .5 in the middle, .25 from both; then .8
    assert set(_spread(costs, 99)) == set(range(7))


def test_hypervolumes_are_those_of_boxes_and_of_random_points() -> None:
    assert hypervolume(np.array([[1.0, 2.0], [2.0, 1.0], [5.0, 5.0]]), np.array([3.0, 3.0])) == 3.0
    costs = np.random.default_rng(3).uniform(0.2, 1, (12, 3))
    points = np.random.default_rng(4).uniform(0, 1, (200_000, 3))
    covered = (points[:, None] >= costs).all(axis=2).any(axis=1).mean()
    deviation = np.sqrt(covered * (1 - covered) / len(points))
    assert hypervolume(costs, np.ones(3)) == pytest.approx(covered, abs=5 * deviation)


@pytest.mark.slow
def test_three_objectives_are_polished_by_bounds_on_two() -> None:
    pytest.importorskip("pymoo")
    problem = paper_problem(objectives=["peak_force", "width", "moving_mass"])
    front = problem.pareto(method="nsga3", population=40, generations=20, points=6)
    assert 3 <= len(front) <= 6
    index = len(front) // 2
    _, width, mass = front.objectives[index].tolist()
    exact = problem.minimise("peak_force", {"width": width, "moving_mass": mass}, starts=2)
    assert front.objectives[index, 0] == pytest.approx(exact.value, rel=1e-3)


@pytest.mark.parametrize("method", [pytest.param("epsilon", marks=pytest.mark.slow), "nsga2"])
def test_an_interrupted_front_goes_on_to_the_same_result(method: str, tmp_path: Path) -> None:
    pytest.importorskip("pymoo")
    problem = paper_problem()
    options = {"method": method, "population": 24, "generations": 8, "points": 6, "seed": 2}
    whole = problem.pareto(PEAK_AND_WIDTH, **options)

    def interrupt(done: int, _: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        problem.pareto(PEAK_AND_WIDTH, **options, store=tmp_path, progress=interrupt)
    parts = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    assert parts
    resumed = problem.pareto(PEAK_AND_WIDTH, **options, store=tmp_path, resume=True)
    assert np.array_equal(resumed.designs, whole.designs)
    assert np.array_equal(resumed.unpolished, whole.unpolished)
    assert all(path.stat().st_mtime_ns == moment for path, moment in parts.items())
    with pytest.raises(SweepError, match="seed is 2 there, 3 here"):
        problem.pareto(PEAK_AND_WIDTH, **options | {"seed": 3}, store=tmp_path, resume=True)


def test_a_front_knows_the_start_and_is_written_as_a_table(by_epsilon: Front, tmp_path: Path) -> None:
    table = front_tables(by_epsilon)[0]
    assert table.rows[0][0] == "start"
    assert table.rows[0][1:5] == pytest.approx(PAPER_DESIGN)
    lines = by_epsilon.to_csv(tmp_path / "front.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("r [m],R [m],L [m],rod_radius [m],peak_force [N],width [m]")
    assert len(lines) == 32
    assert by_epsilon.check.violation < 1e-4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"objectives": ["width"]}, "two or more"),
        ({"method": "simplex"}, "expected epsilon or nsga2 or nsga3"),
        ({"points": 1}, "points: expected a whole number from 2"),
        ({"objectives": ["width", "peak_force", "energy"]}, "take 'nsga3' for more"),
    ],
)
def test_what_makes_no_front_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        paper_problem().pareto(**options)


def test_a_front_of_nothing_names_what_is_missing() -> None:
    problem = paper_problem(constraints={"width": {"max": 0.2}})
    with pytest.raises(OptimisationError, match=r"be relaxed, width ≤ 0\.2 m by 0\.1 m or the bound R"):
        problem.pareto(["peak_force", "moving_mass"])
