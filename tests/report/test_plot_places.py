"""Figures in a figure of the caller's: `ax` of every one of them."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import p3dof
from p3dof.report import plots
from p3dof.runs import PD, InitialState

matplotlib = pytest.importorskip("matplotlib")

SHEETS = {"mechanism_figure"}  # to a scale of its own
MOTION = p3dof.paper_motion(21)
ROBOT = p3dof.load()


def run():
    start = InitialState(MOTION.pose[0], MOTION.velocity[0])
    return ROBOT.simulate(0.02, start=start, controller=PD(ROBOT, MOTION), samples=5)


DRAWN = {
    "forces_figure": lambda ax: plots.forces_figure([ROBOT.inverse_dynamics(MOTION)], ax=ax),
    "joints_figure": lambda ax: plots.joints_figure(ROBOT.inverse_dynamics(MOTION), ax=ax),
    "energy_figure": lambda ax: plots.energy_figure(ROBOT.energy(ROBOT.inverse_dynamics(MOTION)), ax=ax),
    "reactions_figure": lambda ax: plots.reactions_figure(ROBOT.reactions(MOTION), ax=ax),
    "tracking_figure": lambda ax: plots.tracking_figure({"PD": run()}, ax=ax),
    "map_figure": lambda ax: plots.map_figure(ROBOT.workspace(), "lti", count=11, ax=ax),
    "slices_figure": lambda ax: plots.slices_figure(ROBOT.workspace(), ax=ax),
    "loci_figure": lambda ax: plots.loci_figure(ROBOT.workspace(), ax=ax),
    "clearance_figure": lambda ax: plots.clearance_figure(p3dof.design.clearance_of(ROBOT, MOTION), ax=ax),
    "utilisation_figure": lambda ax: plots.utilisation_figure(
        p3dof.assess(ROBOT, ROBOT.inverse_dynamics(MOTION)), ax=ax
    ),
    "tolerance_figure": lambda ax: plots.tolerance_figure(
        p3dof.tolerance(ROBOT, MOTION, sigma={"R": 1e-4}), ax=ax
    ),
    "sensitivity_figure": lambda ax: plots.sensitivity_figure(
        p3dof.sensitivity(ROBOT, MOTION, {"L": "10 %"}, method="gradient"), ax=ax
    ),
}


def test_every_figure_can_be_a_part_of_another():
    figures = [name for name in plots.__all__ if name.endswith("_figure")]
    for name in {*figures} - SHEETS:
        parameter = inspect.signature(getattr(plots, name)).parameters["ax"]
        assert (parameter.kind, parameter.default) == (inspect.Parameter.KEYWORD_ONLY, None), name


@pytest.mark.parametrize("name", DRAWN)
def test_a_figure_takes_the_place_of_axes_and_leaves_the_others(name):
    from matplotlib.figure import Figure

    whole = Figure(figsize=(16, 6), layout="constrained")
    left, right = whole.subplots(1, 2)
    left.plot([0, 1], [0, 1])
    alone, drawn = DRAWN[name](None), DRAWN[name](right)
    assert isinstance(alone, Figure)
    assert drawn in whole.subfigs
    assert right not in whole.axes
    assert len(drawn.axes) == len(alone.axes)
    for here, there in zip(drawn.axes, alone.axes, strict=True):
        for one, other in zip(here.lines, there.lines, strict=True):
            np.testing.assert_array_equal(one.get_xydata(), other.get_xydata())
    whole.draw_without_rendering()
    assert left.bbox.x1 < min(axis.bbox.x0 for axis in drawn.axes)


@pytest.mark.parametrize("name", ["forces_figure", "tracking_figure", "map_figure"])
def test_a_legend_stands_above_the_titles(name):
    from matplotlib.figure import Figure

    whole = Figure(figsize=(12, 8), layout="constrained")
    drawn = DRAWN[name](whole.subplots(2, 1)[1])
    whole.draw_without_rendering()
    (legend,) = drawn.legends
    words = min(text.get_window_extent().y0 for text in legend.get_texts())
    assert words >= max(axis.title.get_window_extent().y1 for axis in drawn.axes)


def test_a_subfigure_is_drawn_into(tmp_path):
    from matplotlib.figure import Figure

    whole = Figure(figsize=(12, 8), layout="constrained")
    upper, lower = whole.subfigures(2, 1)
    assert DRAWN["forces_figure"](upper) is upper
    assert DRAWN["energy_figure"](lower) is lower
    assert plots.save(whole, tmp_path / "both.png").stat().st_size > 10_000


def test_what_is_no_place_is_refused():
    from matplotlib.figure import Figure

    free = Figure().add_axes((0, 0, 1, 1))
    for wrong, got in ((free, "Axes"), (3, "got 3"), (np.empty(2, object), "ndarray")):
        with pytest.raises(
            p3dof.InputError, match=f"ax: expected Axes of plt.subplots, or a SubFigure.*{got}"
        ):
            DRAWN["forces_figure"](wrong)
