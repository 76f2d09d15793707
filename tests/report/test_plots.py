"""Figures: what is drawn is what was computed."""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pytest

import p3dof
from p3dof._base.errors import FileError, InputError, MissingExtraError
from p3dof.loops import ClosedLoopModel, Sidecar
from p3dof.report import plots
from p3dof.report.plots import common
from p3dof.runs import Event, JointPD, simulate_robot


@pytest.fixture(scope="module")
def results():
    robot, motion = p3dof.load(), p3dof.paper_motion(51)
    return [robot.inverse_dynamics(motion, method=method) for method in ("pinocchio", "virtual-power")]


def test_curves_are_the_forces_and_their_difference(results):
    figure = plots.forces_figure(results)
    assert len(figure.axes) == 6
    for leg in range(3):
        top, bottom = figure.axes[leg], figure.axes[3 + leg]
        for line, result in zip(top.lines, results, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), result.forces[:, leg])
        difference = results[0].forces[:, leg] - results[1].forces[:, leg]
        np.testing.assert_array_equal(bottom.lines[0].get_ydata(), difference)
        assert "[N]" in top.get_ylabel()
        assert bottom.get_xlabel() == "time [s]"


def test_one_result(results, tmp_path):
    figure = plots.forces_figure(results[:1])
    assert len(figure.axes) == 3
    for name, start in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.pdf", b"%PDF")):
        assert plots.save(figure, tmp_path / name).read_bytes().startswith(start)


def test_bad_input(results, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="expected one or two, got 3"):
        plots.forces_figure([*results, results[0]])
    other = p3dof.load().inverse_dynamics(p3dof.paper_motion(7), method="virtual-power")
    with pytest.raises(InputError, match="same motion"):
        plots.forces_figure([results[0], other])
    with pytest.raises(InputError, match=r"ends in \.png"):
        plots.save(plots.forces_figure(results), tmp_path / "figure.doc")
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="cannot be written"):
        plots.save(plots.forces_figure(results), tmp_path / "file" / "a.png")
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[plot\]"):
        plots.forces_figure(results)


def test_the_figure_of_any_robots_run_has_its_joints_and_forces(tmp_path):
    """A robot with hinges and slides has a row for each; references, events and the end are drawn."""
    text = robots.robot(
        robots.link("base"),
        robots.link("arm", robots.ROD),
        robots.link("body", robots.BAR),
        robots.joint("turn", "base", "arm", kind="continuous"),
        robots.joint("slide", "arm", "body", (0.3, 0, 0), (1, 0, 0), kind="prismatic"),
    )
    loop = ClosedLoopModel.from_urdf(text, ())
    upper = np.array(loop.model.upperPositionLimit)
    upper[2] = 0.4
    loop.model.upperPositionLimit = upper
    controller = JointPD(loop, [3.0, 0.1], [20.0, 0.0], 2.0)
    passing = Event("passing", lambda *given: given[0] - 0.1, stops=False)
    run = simulate_robot(loop, 2.0, controller=controller, events=[passing], samples=101, method="general")
    assert run.stop.kind == "joint limit"
    figure = plots.robot_run_figure(run)
    axes = figure.axes
    assert [axis.get_ylabel() for axis in axes] == [
        "joints [rad]",
        "forces [N m]",
        "joints [m]",
        "forces [N]",
        "energy [J]",
        "largest gap [m or rad]",
    ]
    lines = axes[0].get_lines()
    np.testing.assert_array_equal(lines[1].get_ydata(), run.values("turn"))
    np.testing.assert_allclose(lines[0].get_ydata(), 3.0, atol=1e-12)
    np.testing.assert_array_equal(axes[3].get_lines()[0].get_ydata(), run.forces[:, 1])
    assert "ended by joint limit" in figure.get_suptitle()
    assert plots.save(figure, tmp_path / "run.png").stat().st_size > 10_000
    passive = ClosedLoopModel(loop.model, Sidecar((), ()))
    figure = plots.robot_run_figure(simulate_robot(passive, 0.1, samples=5, method="general"))
    assert [axis.get_visible() for axis in figure.axes] == [True, False, True, False, True, True]
    with pytest.raises(InputError, match="run: expected a RobotRun"):
        plots.robot_run_figure(3)


def test_axes_of_decades_keep_their_ticks():
    figure = common.new_figure((4, 3))
    axis = figure.subplots()
    axis.loglog([1, 1e6], [1e-9, 1e-3])
    before = axis.get_xticks()
    common.tidy(axis)
    np.testing.assert_array_equal(axis.get_xticks(), before)


def test_small_errors_are_drawn_as_they_are():
    """A run that begins without error comes from below the axis; nothing lies flat on it."""
    robot, motion = p3dof.load(), p3dof.paper_motion(61)
    run = robot.simulate(
        0.2,
        start=p3dof.runs.InitialState(motion.pose[0], motion.velocity[0]),
        controller=p3dof.runs.ComputedTorque(robot.parameters, motion),
        control=p3dof.runs.ControlLoop(rate=1000),
        method="compiled",
    )
    figure = plots.tracking_figure({"computed torque": run})
    for k, axis in enumerate(figure.axes[3:6]):
        error = 1e3 * np.abs(run.error[:, k])
        np.testing.assert_array_equal(axis.lines[0].get_ydata(), error)
        lowest, highest = axis.get_ylim()
        assert 0 < lowest < error.max() < highest
        assert 1e2 < error.max() / lowest < 1e4
