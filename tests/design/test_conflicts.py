"""Problems without a solution: constraints that are named, each needed, and by how much each gives way."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from design_problems import STEEL, VARIABLES, paper_problem

import p3dof
from p3dof._base.errors import OptimisationError
from p3dof.design import DesignProblem
from p3dof.design.optimisation import FunctionMeasure
from p3dof.design.optimisation.feasibility import closer, is_slow, nearest_feasible, starts_of

LENGTHS = {name: VARIABLES[name] for name in "rRL"}
HARMLESS = ["L >= 0.25", "R <= 0.95", "L <= 2*r + 0.9"]

CASES = {
    "two relations": (["R >= r + 0.03", "R <= r + 0.01"], {}, {"R >= r + 0.03": 0.02, "R <= r + 0.01": 0.02}),
    "three in a ring": (
        ["R >= r + 0.1", "L >= 2*R", "L <= 2*r + 0.1"],
        {},
        {"R >= r + 0.1": 0.05, "L >= 2*R": 0.1, "L <= 2*r + 0.1": 0.1},
    ),
    "a lower bound": ([], {"width": {"max": 0.2}}, {"width ≤ 0.2 m": 0.1, "the bound R ≥ 0.15 m": 0.05}),
    "an upper bound": (["R >= 0.6"], {}, {"R >= 0.6": 0.1, "the bound R ≤ 0.5 m": 0.1}),
    "two bounds": (
        ["L >= R + 0.7"],
        {},
        {"L >= R + 0.7": 0.05, "the bound R ≥ 0.15 m": 0.05, "the bound L ≤ 0.8 m": 0.05},
    ),
    "two constraints and a bound": (
        ["L >= R + r + 0.5"],
        {"width": {"min": 0.7}},  # R from .35, r from .08: L from .93; no r that is positive makes up for it
        {"L >= R + r + 0.5": 0.13, "width ≥ 0.7 m": 0.26, "the bound L ≤ 0.8 m": 0.13},
    ),
}
"""Relations, bounds on measures, and by how much each of those to blame gives way, by hand."""


def lengths_problem(relations: list[str], measures: dict[str, object]) -> DesignProblem:
    return DesignProblem(
        LENGTHS, motion=p3dof.paper_motion(21), constraints={**measures, "relations": [*HARMLESS, *relations]}
    )


def conflicts_of(problem: DesignProblem) -> tuple[p3dof.design.optimisation.Conflict, ...]:
    words = (
        r"^no design satisfies all constraints: .+(?: conflict: one must be relaxed,|, which is violated by) "
    )
    with pytest.raises(OptimisationError, match=words) as told:
        nearest_feasible(problem, starts_of(problem, 2, 0))
    again = pickle.loads(pickle.dumps(told.value))  # noqa: S301 - made here
    assert again.conflicts == told.value.conflicts
    return told.value.conflicts


def given_way(problem: DesignProblem, name: str, by: float) -> DesignProblem:
    """Return a problem in which one constraint, or bound of a variable, gives way."""
    new = problem.asking()
    if name.startswith("the bound "):
        label, sign = name.split()[2:4]
        index = problem.variables.labels.index(label)
        end = "low" if sign == "≥" else "high"
        moved = getattr(problem.variables, end).copy()
        moved[index] += by if end == "high" else -by
        new.variables = replace(problem.variables, **{end: moved})
        return new
    new.constraints = tuple(
        replace(item, bound=item.bound - by if item.at_least else item.bound + by)
        if item.name == name
        else item
        for item in problem.constraints
    )
    return new


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[pytest.mark.slow] * (k in (1, 3, 5))) for k, case in enumerate(CASES)]
)
def test_what_is_named_is_irreducible_and_gives_way_by_the_least_amount(case: str) -> None:
    relations, measures, expected = CASES[case]
    problem = lengths_problem(relations, measures)
    (conflict,) = conflicts_of(problem)
    assert set(conflict.names) == set(expected)
    starts = starts_of(problem, 4, 0)
    for name, by in zip(conflict.names, conflict.amounts, strict=True):
        assert by == pytest.approx(expected[name], abs=1e-7), name
        enough = given_way(problem, name, by + 1e-6)
        assert enough.evaluate(nearest_feasible(enough, starts)).feasible[0], name
        with pytest.raises(OptimisationError):
            nearest_feasible(given_way(problem, name, 0.9 * by), starts)


def test_one_constraint_to_blame_is_named_alone() -> None:
    """At best the force is that of the smallest base: a scan of machines by the other way to the forces."""
    motion = p3dof.paper_motion(51)
    problem = DesignProblem(
        {"R": (0.2, 0.4)}, motion, constraints={"peak_force": {"max": 20}, "width": {"max": 0.45}}
    )
    peaks = [
        np.abs(p3dof.load(replace(p3dof.PAPER, geometry=replace(p3dof.PAPER.geometry, R=R)))
               .inverse_dynamics(motion, method="pinocchio").forces).max()
        for R in np.linspace(0.2, 0.225, 6)
    ]  # fmt: skip
    assert (np.diff(peaks) < 0).all()
    (conflict,) = conflicts_of(problem)
    assert conflict.names == ("peak_force ≤ 20 N",)
    assert conflict.amounts[0] == pytest.approx(peaks[-1] - 20, rel=1e-6)


def test_two_conflicts_are_told_each_with_its_own() -> None:
    problem = lengths_problem(["R >= r + 0.03", "R <= r + 0.01"], {"width": {"max": 0.2}})
    found = {conflict.names: conflict.amounts for conflict in conflicts_of(problem)}
    apart = ("R >= r + 0.03", "R <= r + 0.01")
    narrow = (
        "width ≤ 0.2 m",
        "R >= r + 0.03",
        "the bound r ≥ 0.08 m",
    )  # where R may be smaller: r + .03 is not
    assert set(found) == {apart, narrow, ("width ≤ 0.2 m", "the bound R ≥ 0.15 m")}
    assert found[narrow] == pytest.approx((0.02, 0.01, 0.01), abs=1e-7)
    assert found[apart] == pytest.approx((0.02, 0.02), abs=1e-7)


def test_no_conflict_is_told_that_was_not_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that finds designs for what it took for a conflict says what the nearest design misses."""
    problem = lengths_problem(["R >= r + 0.03", "R <= r + 0.01"], {})
    monkeypatch.setattr("p3dof.design.optimisation.feasibility._ConflictSearch.least", lambda *_: 0.0)
    with pytest.raises(
        OptimisationError, match=r"no feasible design was found; the nearest violates R [<>]= r"
    ) as told:
        nearest_feasible(problem, starts_of(problem, 2, 0))
    assert told.value.conflicts == ()


def test_conflicts_that_share_a_constraint_are_told_each() -> None:
    problem = lengths_problem(["R >= 0.4", "R <= r + 0.1", "L >= R + 0.5", "R <= 0.38 + 0*r"], {})
    found = {
        conflict.names: dict(zip(conflict.names, conflict.amounts, strict=True))
        for conflict in conflicts_of(problem)
    }
    expected = {  # by hand: r up to .2, L up to .8, what only other conflicts name is left out
        ("R >= 0.4", "R <= r + 0.1", "the bound r ≤ 0.2 m"): (0.1, 0.1, 0.1),
        ("R >= 0.4", "L >= R + 0.5", "the bound L ≤ 0.8 m"): (0.1, 0.1, 0.1),
        ("R >= 0.4", "R <= 0.38 + 0*r"): (0.1, 0.02),
    }
    assert set(found) == set(expected)
    for names, amounts in expected.items():
        assert list(found[names].values()) == pytest.approx(amounts, abs=1e-7), names


@pytest.mark.slow
def test_the_least_amount_is_what_the_published_optimum_lacks() -> None:
    whole = paper_problem()
    problem = DesignProblem(
        {name: VARIABLES[name] for name in ("R", "L")},
        objectives=whole.objectives,
        constraints=whole.constraints,
        box=whole.setting.box,
        bodies="solids",
        fixed=STEEL | {"r": 0.1, "rod_radius": 0.003},
    )
    with pytest.raises(OptimisationError, match=re.escape("peak_force ≤ 70 N by 10.24 N")) as told:
        problem.minimise("width", {"peak_force": 70.0, "width": 0.5}, starts=1)
    found = [dict(zip(each.names, each.amounts, strict=True)) for each in told.value.conflicts]
    assert len(found) > 1  # each of the others is enough to forbid so small a force
    for amounts in found:
        assert amounts["peak_force ≤ 70 N"] == pytest.approx(80.2398 - 70, abs=1e-4)
        assert len(amounts) == 2


class Slow(FunctionMeasure):
    """A measure that takes long."""

    slow = True


def linear(*slopes: float, kind: type[FunctionMeasure] = FunctionMeasure) -> FunctionMeasure:
    """Return a measure that grows along r, R and L by the slopes."""

    def found(designs: p3dof.analysis.Designs, by: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray | None]:
        sizes = [designs.columns[f"geometry.{name}"] for name in "rRL"]
        values = np.asarray(sum(slope * size for slope, size in zip(slopes, sizes, strict=True)))
        return values, np.tile(slopes, (len(values), 1)) if by else None

    return kind("along", "m", found)


def any_machine(objective: FunctionMeasure, **constraints: object) -> DesignProblem:
    """Return a problem over sizes all of which make a motion that is at rest at home."""
    still = p3dof.Motion(np.arange(2.0), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))
    variables = {"r": (0.1, 0.2), "R": (0.2, 0.3), "L": (0.4, 0.8)}
    return DesignProblem(variables, still, objectives=[objective], constraints=constraints)


@pytest.mark.parametrize("times", [4, 10])
@pytest.mark.parametrize("sign", [1, -1])
def test_random_designs_reach_as_far_as_ranges_halved(times: int, sign: int) -> None:
    problem = any_machine(linear(0, 0, sign))
    start = np.array([[0.15, 0.25, 0.6]])
    found = closer(problem, start, [times])
    np.testing.assert_array_equal(found[0], start[0])
    shares = (found[1:] - start) / problem.variables.span * 2**times
    assert np.abs(shares).max() <= 1 + 1e-9
    assert (np.diff(shares[:, 2] * sign) >= 0).all()  # the best first
    assert shares[0, 2] * sign == pytest.approx(-1, abs=0.01)  # of a thousand


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("beyond", [-0.0005, 0.0005])
def test_random_designs_stay_in_the_ranges_and_come_to_their_ends(sign: int, beyond: float) -> None:
    problem = any_machine(linear(0, 0, sign))
    low, high = problem.variables.low, problem.variables.high
    end = low if sign > 0 else high
    start = (end - sign * beyond * problem.variables.span)[None]
    found = closer(problem, start, [10])[1:]
    assert (low <= found).all()
    assert (found <= high).all()
    assert found[0, 2] == end[2]


@pytest.mark.parametrize("sign", [1, -1])
def test_random_designs_begin_at_the_end_of_ranges_that_a_start_is_beyond(sign: int) -> None:
    problem = any_machine(linear(0, 0, sign))
    end, span = problem.variables.high if sign > 0 else problem.variables.low, problem.variables.span
    found = closer(problem, (end + sign * 0.5 * span)[None], [10])[1:]
    shares = (found - end) / span * 2**10
    assert np.abs(shares).max() <= 1 + 1e-9
    assert shares[0, 2] * sign == pytest.approx(-1, abs=0.01)


@pytest.mark.parametrize("sign", [1, -1])
def test_turns_of_random_designs_lead_from_one_corner_of_the_ranges_to_the_other(sign: int) -> None:
    """A half, a quarter and so on of the ranges: all of them together."""
    problem = any_machine(linear(0, 0, sign))
    low, high = problem.variables.low, problem.variables.high
    begin, end = (high, low) if sign > 0 else (low, high)
    found = closer(problem, begin[None])
    assert found[1, 2] == pytest.approx(end[2], abs=0.01 * problem.variables.span[2])


def test_random_designs_keep_constraints_before_they_are_good() -> None:
    problem = any_machine(linear(0, 0, -1), relations=["L <= 0.62"])
    found = closer(problem, np.array([[0.15, 0.25, 0.6]]), [3])
    assert (found[1:, 2] <= 0.62).all()
    assert found[1, 2] == pytest.approx(0.62, abs=1e-3)


def test_no_random_designs_where_a_measure_takes_long() -> None:
    quick, slow = linear(0, 0, 1), linear(0, 1, 0, kind=Slow)
    start = np.array([[0.15, 0.25, 0.6]])
    bounded = any_machine(quick)
    bounded.constraints = any_machine(quick, relations=["L <= 0.7"]).constraints
    assert not is_slow(bounded)
    assert len(closer(bounded, start, [1])) > 1
    bounded.constraints = (*bounded.constraints, replace(bounded.constraints[0], measure=slow))
    for problem in (any_machine(slow), bounded):
        assert is_slow(problem)
        np.testing.assert_array_equal(closer(problem, start), start)
