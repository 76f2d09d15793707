"""Numbers of sweeps, designs, runs, optima and workspaces in their tables, each by sums of the tests' own."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from table_numbers import check_evidence, check_table, shows

import p3dof
from p3dof import PAPER
from p3dof._base import blocks
from p3dof._base.blocks.results import sweep_tables
from p3dof.analysis.designs import DesignEvaluation, Designs
from p3dof.analysis.designs.files import DesignSummary, Rows
from p3dof.analysis.workspace import workspace_table
from p3dof.design import DesignProblem
from p3dof.design.optimisation import front_tables, optimum_tables
from p3dof.design.optimisation import optimum as checking
from p3dof.runs import PD, ControlLoop, InitialState, Integration
from p3dof.runs.many import figures_table, stops_table
from p3dof.runs.simulation import errors_table, run_table

NAMES = tuple(f"x{i}" for i in range(5))


def valued(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    total = sum((i + 1) * columns[name] for i, name in enumerate(NAMES))
    return {"value": np.where(columns["x4"] > 0.98, np.nan, total)}


@shows(
    "p3dof._base.blocks.results.sweep_tables",
    "p3dof._base.blocks.results._table",
    "p3dof._base.blocks.results._of_rows",
    "p3dof._base.blocks.results._of_counts",
)
def test_tables_of_sweeps_have_sums_over_all_items(tmp_path: Path) -> None:
    sampling = blocks.Samples(dict.fromkeys(NAMES, blocks.Uniform(0.0, 1.0)), 90)
    problem = blocks.FunctionProblem(sampling, valued, ("value",), {}, 20, {"value": "N", "x0": "m"})
    reductions = (
        blocks.TopK("value", 30),
        blocks.Histogram("value", 4.0, 10.0, 45),
        blocks.Moments(("value", "x0")),
    )
    drawn = {name: [] for name in NAMES}
    for k in range(5):
        block = blocks.Block(k, 20 * k, min(20 * k + 20, 90), 3)
        for name, values in sampling.draw(block).items():
            drawn[name] += values.tolist()
    x = {name: np.array(values) for name, values in drawn.items()}
    value = valued(x)["value"]
    good = np.flatnonzero(np.isfinite(value))
    assert 0 < 90 - len(good) < 10
    best, counts, moments = sweep_tables(p3dof.sweep(problem, tmp_path, reductions=reductions, seed=3))
    first = good[np.argsort(value[good], kind="stable")][:20]
    check_table(
        best,
        {str(i): (value[i], *(x[name][i] for name in NAMES[:4])) for i in first},
        title=(30, "smallest value"),
        note=(20, 30, 5, 6),
        header=("item; value [N]; x0 [m]; x1",),
    )
    edge = [4.0 + 6.0 * k / 15 for k in range(16)]
    within = [((value >= a) & (value < b)).sum() for a, b in pairwise(edge)]
    rows = {f"{a:.6g} to {b:.6g}": (n,) for (a, b), n in zip(pairwise(edge), within, strict=True)}
    told = ((value < 4).sum(), (value > 10).sum(), 90 - len(good))
    assert min(told) > 0
    check_table(counts, rows, note=told, header=("value [N]",))
    wanted = {}
    for name, values in (("value [N]", value[good]), ("x0 [m]", x["x0"])):
        mean = sum(values) / len(values)
        deviation = (sum((v - mean) ** 2 for v in values) / len(values)) ** 0.5
        wanted[name] = (mean, deviation, min(values), max(values), len(values), 90 - len(values))
    check_table(moments, wanted)


@shows("p3dof.analysis.designs.files.DesignSummary.tables")
def test_tables_of_designs_have_the_forces_of_each_machine() -> None:
    motion = p3dof.paper_motion(21)
    R = np.array([0.24, 0.26, 0.3, 0.22, 0.2, 0.28])
    L = np.array([0.4, 0.2, 0.45, 0.5, 0.38, 0.1])
    columns = {"R [mm]": 1e3 * R, "L": L}
    summary = DesignSummary(3)
    evaluation = DesignEvaluation(motion)
    for part in (slice(0, 4), slice(4, 6)):
        rows = Rows(part.start + 1, {name: values[part] for name, values in columns.items()})
        summary.add(rows, evaluation.evaluate(Designs(rows.columns)))
    peaks = {}
    for k in (0, 2, 3, 4):
        geometry = replace(PAPER.geometry, R=R[k], L=L[k])
        forces = p3dof.load(replace(PAPER, geometry=geometry)).inverse_dynamics(motion, method="pinocchio")
        peaks[k] = np.abs(forces.forces).max(axis=0)
    counts, best = summary.tables()
    check_table(
        counts,
        {
            "makes the motion": (4,),
            "a leg is too short for a sample of the motion": (1,),
            "no geometry: 0 < r < R, L > R - r >= 1e-6 L and b > 0 do not hold": (1,),
        },
        title=(6, "designs"),
    )
    order = sorted(peaks, key=lambda k: peaks[k].max())[:3]
    check_table(best, {str(k + 1): (1e3 * R[k], L[k], *peaks[k]) for k in order})


FOLLOWED = p3dof.paper_motion(1001).from_rest(0.2)
TICKS = 101
STARTS = np.array([2e-3, -1e-3, 0.5e-3, 9.0, 3e-3])
"""Errors in y that runs begin with [m]; the fourth is out of reach."""


@pytest.fixture(scope="module")
def singles() -> list[p3dof.Simulation]:
    """Runs by the virtual powers and a precise integrator in Python, one by one."""
    robot = p3dof.load()
    return [
        robot.simulate(
            0.1,
            start=InitialState(FOLLOWED.pose[0] + [off, 0, 0]),
            controller=PD(PAPER, FOLLOWED),
            control=ControlLoop(1000),
            method="virtual-power",
            samples=TICKS,
            integration=Integration(rtol=1e-10, atol=1e-12),
        )
        for off in STARTS[STARTS < 1]
    ]


def errors_of(run: p3dof.Simulation) -> np.ndarray:
    """At the ticks, which are samples of the motion."""
    return run.pose - FOLLOWED.pose[:TICKS]


@shows(
    "p3dof.runs.many.results.ManyRuns.peak_error",
    "p3dof.runs.many.results.ManyRuns.rms_error",
    "p3dof.runs.many.results.figures_table",
    "p3dof.runs.many.results.stops_table",
)
def test_many_runs_have_the_figures_of_single_ones(singles: list[p3dof.Simulation]) -> None:
    many = p3dof.load().simulate_many(
        0.1,
        {"start.y": FOLLOWED.pose[0, 0] + STARTS, "start.z": FOLLOWED.pose[0, 1],
         "start.theta": FOLLOWED.pose[0, 2]},
        controller=PD(PAPER, FOLLOWED),
        control=ControlLoop(1000),
    )  # fmt: skip
    errors = np.array([errors_of(run) for run in singles])
    peak, rms = np.abs(errors).max(axis=1), np.sqrt((errors**2).mean(axis=1))
    none = np.full((1, 3), np.nan)
    check_evidence(many, "peak_error", np.concatenate([peak[:3], none, peak[3:]]), rtol=1e-6, atol=1e-10)
    check_evidence(many, "rms_error", np.concatenate([rms[:3], none, rms[3:]]), rtol=1e-6, atol=1e-10)
    force = np.array([np.abs(run.forces).max(axis=0) for run in singles])
    work = [np.sum(run.forces[:-1] * np.diff(run.sliders, axis=0)) for run in singles]
    figures = {
        f"largest error in {axis} [{unit}]": 1e3 * peak[:, k]
        for k, (axis, unit) in enumerate((("y", "mm"), ("z", "mm"), ("θ", "mrad")))
    }
    figures |= {f"largest force {leg} [N]": force[:, k] for k, leg in enumerate("ABC")}
    figures["work [J]"] = np.array(work)
    places = (0.15, 1.5, 2.85, 3.0)  # of the first to the fourth, 0 to 3
    rows = {name: tuple(np.interp(places, range(4), np.sort(v))) for name, v in figures.items()}
    check_table(figures_table(many), rows, header=(0.05, 0.95))
    reason = next(kind for kind in many.counts() if kind != "finished")
    assert "reach" in many.reason(3)
    check_table(stops_table(many), {"finished": (4, 0.8), reason: (1, 0.2)})


@shows(
    "p3dof.runs.simulation.Simulation.error",
    "p3dof.runs.results.RunResult.peak_error",
    "p3dof.runs.results.RunResult.rms_error",
    "p3dof.runs.simulation.errors_table",
    "p3dof.runs.simulation.run_table",
)
def test_tables_of_runs_have_those_of_another_integrator(singles: list[p3dof.Simulation]) -> None:
    one = singles[0]
    run = p3dof.load().simulate(
        0.1,
        start=InitialState(FOLLOWED.pose[0] + [STARTS[0], 0, 0]),
        controller=PD(PAPER, FOLLOWED),
        control=ControlLoop(1000),
        method="compiled",
        samples=TICKS,
    )
    errors = errors_of(one)
    peak = np.abs(errors).max(axis=0)
    check_evidence(run, "error", errors, rtol=1e-6, atol=1e-10)
    check_evidence(run, "peak_error", peak, rtol=1e-6)
    check_evidence(run, "rms_error", np.sqrt((errors**2).mean(axis=0)), rtol=1e-6)
    timed = replace(run, seconds=0.04, closure_error=np.where(np.arange(TICKS) == 7, 3.2e-5, 1e-6))
    force = np.abs(one.forces).max(axis=0)
    check_table(errors_table({"PD": timed}), {"PD": (*(1e3 * peak), force.max(), 0.1 / 0.04)})
    rows = {
        leg: (
            force[k],
            np.abs(one.slider_velocities[:, k]).max(),
            one.sliders[:, k].min(),
            one.sliders[:, k].max(),
        )
        for k, leg in enumerate("ABC")
    }
    check_table(run_table(timed), rows, note=(3.2e-5, " m"))


SHORT = p3dof.paper_motion(21)


def peak_of(R: float) -> float:
    machine = replace(PAPER, geometry=replace(PAPER.geometry, R=R))
    return float(np.abs(p3dof.load(machine).inverse_dynamics(SHORT, method="pinocchio").forces).max())


@shows(
    "p3dof.design.optimisation.optimum.Check.difference",
    "p3dof.design.optimisation.pareto.optimum_tables",
    "p3dof.design.optimisation.pareto._changes",
    "p3dof.design.optimisation.pareto._limits",
    "p3dof.design.optimisation.pareto._checks",
)
def test_tables_of_an_optimum_have_the_forces_of_its_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """The wider the base, the less the peak: the best one is at the bound of the width, 2R."""
    assert np.all(np.diff([peak_of(R) for R in (0.2, 0.22, 0.24)]) < 0)
    problem = DesignProblem(
        {"R": (0.2, 0.3)},
        SHORT,
        objectives=["peak_force", "width"],
        constraints={
            "width": {"max": 0.44},
            "motion_singularity": {"min": "30 deg"},
            "relations": ["R >= r"],
        },
    )
    optimum = problem.minimise("peak_force", starts=1)
    theirs = checking.pinocchio_forces

    def wrong(*given: object) -> np.ndarray:
        forces = theirs(*given).copy()
        forces[3, 1] += 2.5e-3 * np.sign(forces[3, 1])  # not where the peak is
        return forces

    monkeypatch.setattr(checking, "pinocchio_forces", wrong)
    check_evidence(optimum.check, "difference", 2.5e-3, rtol=1e-6)
    changes, limits, checks = optimum_tables(optimum)
    before, after = peak_of(0.25), peak_of(0.22)
    check_table(
        changes, {"R [m]": (0.25, 0.22, -0.03 / 0.25), "peak_force [N]": (before, after, after / before - 1)}
    )

    def clearance(R: float) -> float:
        """Least angle from det J = 0 over the motion, between leg C's plane and the platform [deg]."""
        y, _, theta = SHORT.pose.T
        r, L = PAPER.geometry.r, PAPER.geometry.L
        w = R - r * np.cos(theta)
        c = np.sqrt(L**2 - y**2 - w**2)
        return float(np.degrees(np.arcsin((np.cos(theta) * c - np.sin(theta) * w) / np.hypot(c, w))).min())

    margins = {
        "width ≤ 0.44 [m]": (0.44 - 0.5, 0.0, "binding"),
        "motion_singularity ≥ 30 [deg]": (clearance(0.25) - 30, clearance(0.22) - 30, ""),
        "R >= r [m]": (0.15, 0.12, ""),
    }
    check_table(limits, margins, atol=1e-9)
    rows = {
        "peak_force by the optimiser [N]": (after,),
        "peak_force on a finer grid [N]": (after,),  # the peak is at the end of the motion
        "violation on a finer grid": ("none",),
        "largest force by Pinocchio [N]": (after,),
        "largest difference of the two methods [N]": (2.5e-3,),
    }
    check_table(checks, rows)


@shows("p3dof.design.optimisation.pareto.front_tables")
def test_the_table_of_a_front_has_machines_of_even_widths() -> None:
    problem = DesignProblem({"R": (0.2, 0.24)}, SHORT, objectives=["peak_force", "width"])
    (table,) = front_tables(problem.pareto(points=3))
    sizes = sorted(float(row[1]) for row in table.rows[1:])
    assert sizes == pytest.approx([0.2, 0.22, 0.24], abs=1e-7)
    rows = {"start": (0.25, peak_of(0.25), 0.5)}
    rows |= {str(k): (R, peak_of(R), 2 * R) for k, R in enumerate((0.2, 0.22, 0.24))}
    check_table(table, rows, title=(3, "designs"))


@shows("p3dof.analysis.workspace.workspace.workspace_table")
def test_sizes_of_a_workspace_are_sums_over_fine_grids() -> None:
    r, R, L = 0.14, 0.32, 0.55
    robot = p3dof.load(replace(PAPER, geometry=replace(PAPER.geometry, r=r, R=R, L=L)))
    low, high, least, most = -0.15, 0.2, np.radians(-30), np.radians(55)
    space = robot.workspace(p3dof.machine.Limits(travel=(low, high), tilt=(least, most)))
    reach = L - (R - r)
    y = ((np.arange(1600) + 0.5) / 1600 * 2 - 1)[:, None] * reach

    def over(first: float, last: float, count: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Return largest and least ℓ (y, θ) in home's aspect, NaN elsewhere, and dy dθ."""
        step = (last - first) / count
        theta = (first + (np.arange(count) + 0.5) * step)[None]
        with np.errstate(invalid="ignore"):
            a, b = (np.sqrt(L**2 - (R - r + side * y) ** 2) for side in (1, -1))
            w = R - r * np.cos(theta)
            c = np.sqrt(L**2 - y**2 - w**2)
            good = np.cos(theta) * c - np.sin(theta) * w > 0
        c = np.where(good, c + r * np.sin(theta), np.nan)
        return np.maximum(np.maximum(a, b), c), np.minimum(np.minimum(a, b), c), 2 * reach / 1600 * step

    top, bottom, cell = over(least, most, 1200)
    height = np.where(np.isnan(top), 0.0, np.maximum(high - low - (top - bottom), 0.0))
    stays = high - low - (top.max(axis=1) - bottom.min(axis=1))  # NaN where some θ is out of the aspect
    some = height > 0
    up = np.where(some, high - top, -np.inf).max(axis=1)
    down = np.where(some, low - bottom, np.inf).min(axis=1)
    across = 2 * reach / 1600
    flat_top, flat_bottom, _ = over(-1e-9, 1e-9, 1)
    flat = np.maximum(high - low - (flat_top - flat_bottom), 0.0)
    aspect_top, _, aspect_cell = over(-np.pi, np.pi, 3000)
    rows = {
        "volume in y, z, θ": height.sum() * cell,
        "area in (y, θ)": some.sum() * cell,
        "area in (y, z) at θ = 0": flat.sum() * across,
        "with every orientation of the tilt": np.nan_to_num(np.maximum(stays, 0.0)).sum() * across,
        "with some orientation": np.where(some.any(axis=1), up - down, 0.0).sum() * across,
        "home's aspect in (y, θ), without limits": np.isfinite(aspect_top).sum() * aspect_cell,
    }
    units = ("m² rad", "m rad", "m²", "m²", "m²", "m rad")
    wanted = {name: (size, unit) for (name, size), unit in zip(rows.items(), units, strict=True)}
    check_table(workspace_table(space), wanted, rtol=1e-3)
