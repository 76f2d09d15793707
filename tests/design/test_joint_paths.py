"""Paths of tasks on which the sliders go on lines: proportions, derivatives, files, commands, bad input."""

import numpy as np
import pytest
from command_line import run
from task_files import BLENDED

import p3dof
from p3dof import Task, Waypoint
from p3dof._base.errors import ReachError, TaskError
from p3dof.design import AxisLimits, best_path, fastest_plan, forces_of_task
from p3dof.design.tasks.files import dump, parse

STOPS = [Waypoint([-0.15, 0.0, -0.2], "pick", dwell=0.1), Waypoint([0.12, 0.05, 0.3], "place")]
OVER = [STOPS[0], Waypoint([0.0, 0.04, 0.1], "over", blend=0.03), STOPS[1]]


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def lengths(robot):
    return robot.parameters.geometry


def test_sliders_go_in_proportion(robot, lengths):
    """Synchronous point-to-point motion: all sliders have done the same share of their ways at any time."""
    plan = Task(STOPS, path="joint").on(lengths).plan(duration=0.9)
    ways = robot.sliders(plan.motion.pose)
    share = (ways - ways[0]) / (ways[-1] - ways[0])
    assert np.abs(share - share[:, :1]).max() < 1e-12
    assert plan.motion.pose[-1] == pytest.approx(STOPS[1].pose, abs=1e-15)
    straight = Task(STOPS).plan(duration=0.9)
    assert np.abs(straight.motion.pose - plan.motion.pose).max() > 1e-3


@pytest.mark.parametrize("points", [STOPS, OVER])
def test_derivatives_are_those_of_the_path(lengths, points):
    path = Task(points, path="joint", smoothness=3).on(lengths).paths[0]
    place = np.linspace(0.03, 0.97, 41) * path.end
    place = place[np.abs(place[:, None] - path.breaks).min(axis=1) > 0.01 * path.end]
    step = 1e-4 * path.end
    at = [path.at(place + k * step) for k in (-2, -1, 0, 1, 2)]
    for order in (0, 1):
        far, near = at[4][order] - at[0][order], at[3][order] - at[1][order]
        assert (8 * near - far) / (12 * step) == pytest.approx(at[2][order + 1], rel=1e-7, abs=1e-8)
    far, near = at[4][2] - at[0][2], at[3][2] - at[1][2]
    assert path.third(place) == pytest.approx((8 * near - far) / (12 * step), rel=1e-6, abs=1e-5)


def test_the_fastest_is_that_of_the_slider_that_is_slowest(robot):
    """With speed alone as a limit that matters, the longest way of a slider at full speed is the time."""
    ways = np.abs(np.diff(robot.sliders(np.array([point.pose for point in STOPS])), axis=0)).max()
    slow = fastest_plan(robot, Task(STOPS, path="joint"), AxisLimits(2000, 0.02)).duration
    assert slow == pytest.approx(0.1 + ways / 0.02, rel=1e-3)
    fast = fastest_plan(robot, Task(STOPS, path="joint"), AxisLimits(500, 2, jerk=800))
    assert max(use.share for use in fast.uses) <= 1 + 1e-9


def test_blends_may_be_looked_for(robot):
    over = Waypoint([0.0, 0.04, 0.1], "over", blend=0.02, blend_range=(0.01, 0.04))
    found = best_path(robot, Task([STOPS[0], over, STOPS[1]], path="joint"), nodes=30, samples=21)
    assert found.plan.duration <= found.given_plan.duration
    assert 0.01 <= found.task.waypoints[1].blend <= 0.04


def test_two_ways_agree_on_such_a_plan(robot, lengths):
    plan = Task(OVER, path="joint").on(lengths).plan(duration=1.0, samples=41)
    both = [forces_of_task(robot, plan, method).forces for method in ("virtual-power", "pinocchio")]
    assert np.abs(both[0] - both[1]).max() < 1e-9


def test_a_file_and_the_commands_take_it(capsys, tmp_path, monkeypatch, lengths):
    monkeypatch.chdir(tmp_path)
    task = Task(OVER, path="joint")
    assert parse(dump(task)).path == "joint"
    p3dof.write_task(task, "task.yaml")
    code, _, err = run(capsys, "plan", "task.yaml", "--duration", 1, "--out", "moved.csv")
    assert code == 0, err
    exact = task.on(lengths).plan(duration=1.0).motion
    assert p3dof.Motion.from_csv("moved.csv").pose == pytest.approx(exact.pose, abs=1e-12)
    for command in ("size", "balance", "reactions --task"):
        code, _, err = run(capsys, *command.split(), "task.yaml", "--duration", 1)
        assert code in (0, 1), err


def test_what_does_not_fit_is_one_clear_error(robot, lengths):
    with pytest.raises(TaskError, match=r"\Apath: joint: expected a machine, by task.on\("):
        Task(STOPS, path="joint").plan(duration=1.0)
    loose = [STOPS[0], Waypoint([0.0, 0.04], "over", blend=0.03), STOPS[1]]
    with pytest.raises(TaskError, match="over: pose: expected y, z, θ on a path of 'joint'"):
        Task(loose, path="joint").on(lengths)
    with pytest.raises(ReachError):
        Task([STOPS[0], Waypoint([0.9, 0.0, 0.0])], path="joint").on(lengths)
    with pytest.raises(TaskError, match="geometry: expected a Geometry"):
        Task(STOPS, path="joint").on(robot)
    with pytest.raises(TaskError, match="path: expected one of straight, spline, joint"):
        Task(STOPS, path="joints")
    with pytest.raises(TaskError, match="overlap"):
        Task([STOPS[0], Waypoint([0.0, 0.04, 0.1], blend=0.4), STOPS[1]], path="joint").on(lengths)


def test_another_path_stays_as_it_is(lengths):
    assert BLENDED.on(lengths) is BLENDED
