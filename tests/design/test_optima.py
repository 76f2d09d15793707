"""Optima by one objective: those of two other programs, by two optimisers; checks, interruption."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
from design_problems import STEEL, VARIABLES, paper_problem

import p3dof
from p3dof._base.errors import OptimisationError, SweepError
from p3dof.design import DesignProblem
from p3dof.design.optimisation import FunctionMeasure, Optimum, optimum_tables
from p3dof.design.optimisation.epigraph import descend

FREE = {"width": 1.0}
ROWS = [
    ("peak_force", FREE, None, 60.3069),
    ("peak_force", {"width": 0.6}, None, 60.3126),
    ("peak_force", {"width": 0.5}, None, 61.6491),
    ("peak_force", {"width": 0.45}, None, 63.1718),
    ("peak_force", {"width": 0.4}, None, 65.3750),
    ("peak_force", {"width": 0.36}, None, 67.9655),
    ("peak_force", FREE, 0.1, 76.0598),
    ("peak_force", {"width": 0.5}, 0.1, 80.2398),
    ("rms_power", FREE, None, 31.0722),
]
"""Objective, bounds, radius of the platform [m] where it is kept, and the optimum of two other programs."""


def problem_with(r: float | None) -> DesignProblem:
    if r is None:
        return paper_problem()
    return _with_r(r)


def _with_r(r: float) -> DesignProblem:
    whole = paper_problem()
    variables = {name: bounds for name, bounds in VARIABLES.items() if name != "r"}
    return DesignProblem(
        variables,
        objectives=whole.objectives,
        constraints=whole.constraints,
        box=whole.setting.box,
        bodies="solids",
        fixed=STEEL | {"r": r},
    )


@pytest.mark.parametrize(
    ("objective", "bounds", "r", "expected"),
    [pytest.param(*row, marks=[pytest.mark.slow] * (k not in (0, 3, 7, 8))) for k, row in enumerate(ROWS)],
)
def test_local_descents_find_the_published_optima(
    objective: str, bounds: dict[str, float], r: float | None, expected: float
) -> None:
    starts = 1 if objective == "rms_power" else 3
    found = problem_with(r).minimise(objective, bounds, starts=starts)
    assert found.value == pytest.approx(expected, abs=1e-4)
    assert found.found.feasible[0]


PEAKS = [row[1:] for row in ROWS if row[0] == "peak_force"]


@pytest.mark.slow
@pytest.mark.parametrize(("bounds", "r", "expected"), PEAKS[::7])
def test_evolution_without_gradients_finds_the_same(
    bounds: dict[str, float], r: float | None, expected: float
) -> None:
    found = problem_with(r).minimise("peak_force", bounds, method="evolution", polish=False)
    assert found.value == pytest.approx(expected, abs=1e-3)
    assert found.found.feasible[0]


@pytest.fixture(scope="module")
def optimum() -> Optimum:
    return _with_r(0.1).minimise("peak_force", {"width": 0.5}, starts=2)


def test_an_optimum_says_what_binds_it(optimum: Optimum) -> None:
    assert optimum.binding == ("serial_reach ≥ 0.4", "width ≤ 0.5 m", "rod_radius at its lower bound")
    assert optimum.design == pytest.approx([0.25, 0.27277, 0.003], abs=1e-5)


def test_an_optimum_is_checked_on_finer_grids_and_by_pinocchio(optimum: Optimum) -> None:
    check = optimum.check
    assert check.violation < 3e-5
    assert check.finer.asked is not optimum.found.asked
    assert check.finer["peak_force"][0] == pytest.approx(80.2398, abs=0.05)
    assert check.difference < 1e-11 * check.largest
    assert check.largest == pytest.approx(optimum.value, rel=1e-12)


def test_grids_that_are_too_coarse_show_in_the_check() -> None:
    box = p3dof.design.optimisation.Box((-0.1, 0.1), (-0.5, 0.5), (2, 2))
    coarse = paper_problem(motion=p3dof.paper_motion(9), box=box)
    found = coarse.minimise("rms_power", starts=1)
    assert abs(found.check.finer["rms_power"][0] - found.value) > 0.1
    assert found.check.difference < 1e-11 * found.check.largest  # at the samples of the optimiser


def test_the_optimum_is_a_machine_file(optimum: Optimum, tmp_path: Path) -> None:
    path = optimum.write_parameters(tmp_path / "better.yaml")
    robot = p3dof.load(path)
    forces = robot.inverse_dynamics(p3dof.paper_motion(201)).forces
    assert np.abs(forces).max() == pytest.approx(optimum.value, rel=1e-12)


def test_tables_compare_with_the_machine_that_there_was(optimum: Optimum) -> None:
    changes, limits, checks, bodies = optimum_tables(optimum)
    rows = {row[0]: row[1:] for row in changes.rows}
    assert rows["peak_force [N]"] == (
        pytest.approx(119.93761, abs=1e-5),
        pytest.approx(80.2398, abs=1e-4),
        "-33.10%",
    )
    assert [row[-1] for row in limits.rows].count("binding") == 2
    assert checks.rows[2][1] == "none"
    assert [row[1] for row in bodies.rows] == ["solid"] * 4  # the paper's are nobody's own


def test_moving_the_motion_is_checked_by_pinocchio_too() -> None:
    problem = DesignProblem({"offset.y": (-0.03, 0.03), "offset.theta": (-0.1, 0.1)})
    found = problem.minimise(starts=2)
    assert found.value < problem.evaluate([0, 0])["peak_force"][0] - 1
    assert found.check.difference < 1e-11 * found.check.largest


def test_bounds_in_which_no_machine_makes_the_motion_are_told() -> None:
    problem = DesignProblem({"L": (0.1, 0.16)})
    with pytest.raises(OptimisationError, match="can perform the motion: a leg is too short"):
        problem.minimise(starts=2)


def test_an_objective_that_no_variable_changes_is_told() -> None:
    problem = DesignProblem({"L": (0.35, 0.45), "r": (0.08, 0.12)}, objectives=["width"])
    with pytest.raises(OptimisationError, match=r"^width does not depend on any variable \(L, r\): there is"):
        problem.minimise(starts=3)


@pytest.mark.parametrize("method", ["slsqp", "evolution"])
def test_an_interrupted_optimisation_goes_on_to_the_same_result(method: str, tmp_path: Path) -> None:
    problem, options = _with_r(0.1), {"method": method, "seed": 5, "starts": 3, "generations": 50}
    whole = problem.minimise("peak_force", **options)
    store, stop = tmp_path / "state", 2 if method == "slsqp" else 20

    def interrupt(done: int, _: int) -> None:
        if done == stop:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        problem.minimise("peak_force", **options, store=store, progress=interrupt)
    parts = {path.name: path.stat().st_mtime_ns for path in store.glob("*.npz")}
    assert len(parts) >= stop
    damaged = sorted(parts)[0]
    (store / damaged).write_bytes(b"cut off")
    resumed = problem.minimise("peak_force", **options, store=store, resume=True)
    assert np.array_equal(resumed.design, whole.design)
    kept = [name for name, time in parts.items() if (store / name).stat().st_mtime_ns == time]
    assert sorted(kept) == sorted(set(parts) - {damaged})


def test_the_folder_of_another_problem_is_refused(tmp_path: Path) -> None:
    _with_r(0.1).minimise("peak_force", starts=1, store=tmp_path)
    with pytest.raises(SweepError, match="to resume it: resume=True"):
        _with_r(0.1).minimise("peak_force", starts=1, store=tmp_path)
    with pytest.raises(SweepError, match=r"geometry\.r is 0.1 there, 0.11 here"):
        _with_r(0.11).minimise("peak_force", starts=1, store=tmp_path, resume=True)


def test_the_same_seed_gives_the_same_optimum() -> None:
    how = {"method": "evolution", "seed": 3, "polish": False, "generations": 40}
    one, two = (_with_r(0.1).minimise("peak_force", **how) for _ in range(2))
    assert np.array_equal(one.design, two.design)


def test_what_is_better_large_is_made_large() -> None:
    lightest = paper_problem().minimise("peak_force", starts=1).design
    before = paper_problem(objectives=["transmission"]).evaluate(lightest)["transmission"][0]
    found = paper_problem().minimise("transmission", {"peak_force": 75.0}, starts=3)
    assert found.value > before + 0.1
    assert found.found["peak_force"][0] <= 75.0 + 1e-5


@pytest.mark.parametrize(("over", "end", "programs"), [(0, 0.4, 2), (9, 1.6 / 3, 3)])
def test_a_descent_ends_when_neither_the_optimum_nor_its_pieces_are_others(
    monkeypatch: pytest.MonkeyPatch, over: int, end: float, programs: int
) -> None:
    """Of 2 L and, nine times, 3.2 - 4 L: far from the worst at first, as bad at the other end."""

    def worst(designs: p3dof.analysis.Designs, by: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray | None]:
        L = designs.columns["geometry.L"][:, None]
        slopes = np.array([2.0, *over * [-4.0]])
        return slopes * L + [0, *over * [3.2]], np.tile(slopes, (len(L), 1))[..., None] if by else None

    made: list[float] = []
    minimize = scipy.optimize.minimize
    monkeypatch.setattr("scipy.optimize.minimize", lambda *a, **k: made.append(1) or minimize(*a, **k))
    still = p3dof.Motion(np.arange(2.0), *np.zeros((3, 2, 3)))
    problem = DesignProblem({"L": (0.4, 0.8)}, still, objectives=[FunctionMeasure("worst", "m", worst)])
    found = descend(problem, np.array([0.8]))
    assert found.design == pytest.approx([end], rel=1e-9)
    assert found.value == pytest.approx(2 * end, rel=1e-9)
    assert len(made) == programs  # the last one finds nothing new


BALANCE = {f"actuators.counterbalance.slide_{leg}": (-20.0, 150.0) for leg in "abc"}


@pytest.mark.parametrize(
    ("kept", "expected"),
    [({"r": 0.1, "R": 0.25, "L": 0.4, "rod_radius": 0.01}, 43.3175), ({"r": 0.1}, 28.0241), ({}, 20.1160)],
)
def test_balance_may_be_a_free_choice(kept: dict[str, float], expected: float) -> None:
    """The published least peaks with a constant balancing force on each slider, within the paper's width."""
    whole = paper_problem()
    free = {name: bounds for name, bounds in VARIABLES.items() if name not in kept}
    problem = DesignProblem(
        free | BALANCE,
        constraints=whole.constraints,
        box=whole.setting.box,
        bodies="solids",
        fixed=STEEL | kept,
    )
    found = problem.minimise("peak_force", {"width": 0.5}, starts=2)
    assert found.value == pytest.approx(expected, abs=1e-3)
    assert found.check.difference < 1e-10 * found.check.largest
    assert found.check.largest == pytest.approx(found.value, rel=1e-10)


def test_an_optimum_for_a_motion_that_was_moved_says_so():
    problem = p3dof.design.DesignProblem(
        variables={"L": (0.4, 0.5), "offset.y": ("-20 mm", "20 mm")},
        motion=p3dof.paper_motion(51),
        objectives=["peak_power"],
    )
    found = problem.minimise(starts=2)
    told = [note for note in found.notes if "for the motion moved in y by" in note]
    assert told
    assert f"{found.design[1]:.6g} m" in told[0]


def test_bounds_that_exclude_each_other_are_refused():
    with pytest.raises(p3dof.InputError, match="peak_force: expected min below max, got 100 N and 50 N"):
        p3dof.design.DesignProblem(
            variables={"R": (0.2, 0.4)},
            motion=p3dof.paper_motion(51),
            objectives=["width"],
            constraints={"peak_force": {"min": 100, "max": 50}},
        )
