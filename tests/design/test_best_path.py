"""The best path of a task: known optima, freedoms kept, never slower, the same every time, bad input."""

from dataclasses import replace

import jsonschema
import numpy as np
import pytest
import yaml
from command_line import run
from table_numbers import check_table, shows
from task_files import BLENDED, SCHEMA

import p3dof
from p3dof import Waypoint
from p3dof._base.errors import TaskError
from p3dof.design import AxisLimits, best_path, fastest_plan
from p3dof.design.fastest import BestPath, _counted, best_path_table
from p3dof.design.tasks.files import dump, parse

VIAS = """
waypoints:
  - {name: pick, pose: [-150 mm, 0, -15 deg]}
  - {name: up, pose: [-150 mm, 25 mm], blend: 25 mm, blend_range: [5 mm, 25 mm], tolerance: [10 mm, 5 mm]}
  - {name: over, pose: [150 mm, 25 mm], blend: 25 mm, blend_range: [5 mm, 25 mm], tolerance: [10 mm, 5 mm]}
  - {name: place, pose: [150 mm, 0, 15 deg]}
"""


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def found(robot):
    return best_path(robot, parse(VIAS), AxisLimits(500, 2), nodes=50)


def test_the_pick_and_place_takes_less_time(robot, found):
    given = fastest_plan(robot, BLENDED, AxisLimits(500, 2), nodes=50).duration
    assert found.given_plan.duration == given
    assert found.plan.duration < 0.9 * given
    again = fastest_plan(robot, found.task, AxisLimits(500, 2), nodes=50)
    assert again.duration == found.plan.duration


def test_what_may_not_be_left_is_not_left(found):
    for old, new in zip(found.given.waypoints, found.task.waypoints, strict=True):
        if old.tolerance is None:
            np.testing.assert_array_equal(new.pose, old.pose)
            assert new.blend == old.blend
        else:
            assert (np.abs(new.pose - old.pose) <= old.tolerance + 1e-12).all()
            assert old.blend_range[0] <= new.blend <= old.blend_range[1]
    text = " ".join(cell for row in best_path_table(found).rows for cell in row)
    assert "up: blend [mm]" in text
    assert "-160 to -140" in text


@shows("p3dof.design.fastest.best_path_table")
def test_every_number_of_the_table_of_the_best_path():
    """Of what was given, of what is said to be best, and how far from the given one it may be."""
    angle, poses = np.radians(10), ([-0.15, 0.045, -0.1], [0.05, 0.03, 0.2])
    stops = Waypoint([-0.15, 0, -0.26], "pick"), Waypoint([0.15, 0, 0.26], "place")
    free = [
        Waypoint(poses[0], "up", 0.02, blend_range=[0.005, 0.03], tolerance=[0.01, 0.004, angle]),
        Waypoint(poses[1], "over", 0.025, tolerance=[0, 0.002, 0]),
        Waypoint([0.14, 0.02, 0.24], "down", 0.004, blend_range=[0.001, 0.006]),
    ]
    given = p3dof.Task([stops[0], *free, stops[1]])
    moved = [
        replace(free[0], pose=[-0.143, 0.0423, -0.2], blend=0.0287),
        replace(free[1], pose=[0.05, 0.0313, 0.2]),
        replace(free[2], blend=0.0011),
    ]
    best = p3dof.Task([stops[0], *moved, stops[1]])
    found = BestPath(best, best.plan(0.8), given, given.plan(1.3))
    rows = {
        "whole task: time [s]": (1.3, 0.8, ""),
        "up: blend [mm]": (20, 28.7, (5, 30)),
        "up: y [mm]": (-150, -143, (-160, -140)),
        "up: z [mm]": (45, 42.3, (41, 49)),
        "up: θ [deg]": (np.degrees(-0.1), np.degrees(-0.2), (np.degrees(-0.1) - 10, np.degrees(-0.1) + 10)),
        "over: z [mm]": (30, 31.3, (28, 32)),
        "down: blend [mm]": (4, 1.1, (1, 6)),
    }
    check_table(best_path_table(found), rows)


def test_the_task_to_write_leaves_no_room_beyond_the_allowed(found):
    assert all(point.tolerance is None and point.blend_range is None for point in found.decided.waypoints)
    for one, other in zip(found.decided.waypoints, found.task.waypoints, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
        assert one.blend == other.blend


def test_a_via_beside_a_vertical_way_comes_onto_it(robot):
    """The machine and the way are symmetric in y, so that the fastest path is that of y = 0."""
    task = p3dof.Task(
        [
            Waypoint([0, -0.05, 0]),
            Waypoint([0.015, 0.0, 0], blend=0.02, tolerance=[0.02, 0, 0]),
            Waypoint([0, 0.05, 0]),
        ]
    )
    found = best_path(robot, task, AxisLimits(300, 2), nodes=100)
    assert abs(found.task.waypoints[1].pose[0]) < 1e-3
    line = p3dof.Task([task.waypoints[0], task.waypoints[2]])
    straight = fastest_plan(robot, line, AxisLimits(300, 2), nodes=100).duration
    assert straight < found.plan.duration * 1.0001 < 1.002 * straight < found.given_plan.duration


def test_a_corner_is_cut_as_far_as_it_may_be(robot):
    task = p3dof.Task(
        [
            Waypoint([-0.1, 0, 0]),
            Waypoint([0.0, 0.1, 0], blend=0.02, blend_range=[0.01, 0.06]),
            Waypoint([0.1, 0, 0]),
        ]
    )
    found = best_path(robot, task, AxisLimits(300, 2), nodes=100)
    assert found.task.waypoints[1].blend == 0.06
    again = best_path(robot, task, AxisLimits(300, 2), nodes=100)
    assert dump(again.task) == dump(found.task)


def test_what_is_best_already_stays(robot):
    task = p3dof.Task(
        [
            Waypoint([0, -0.05, 0]),
            Waypoint([0.0, 0.0, 0], blend=0.02, tolerance=[0.02, 0, 0]),
            Waypoint([0, 0.05, 0]),
        ]
    )
    found = best_path(robot, task, AxisLimits(300, 2), nodes=50)
    assert found.plan.duration <= found.given_plan.duration
    np.testing.assert_array_equal(found.task.waypoints[1].pose, [0, 0, 0])


def test_freedoms_read_back_from_a_file():
    data = yaml.safe_load(dump(parse(VIAS)))
    jsonschema.Draft202012Validator(SCHEMA).validate(data)
    point = parse(dump(parse(VIAS))).waypoints[1]
    assert point.blend_range.tolist() == [0.005, 0.025]
    assert point.tolerance.tolist() == [0.01, 0.005]


BAD = {
    "blend_range: expected least and largest": lambda: Waypoint([0, 0], blend=0.02, blend_range=[0.03, 0.04]),
    "blend_range: expected shape": lambda: Waypoint([0, 0], blend=0.02, blend_range=0.03),
    "tolerance: expected zero or more": lambda: Waypoint([0, 0], blend=0.02, tolerance=[0.1, -1]),
    "tolerance: expected shape": lambda: Waypoint([0, 0], blend=0.02, tolerance=[0.1, 0, 0]),
    "tolerance: expected at a waypoint that is passed": lambda: Waypoint([0, 0, 0], tolerance=[0.1, 0, 0]),
    "no waypoint on a segment of free duration": lambda: best_path(p3dof.load(), BLENDED, AxisLimits(500, 2)),
}


@pytest.mark.parametrize(("words", "call"), BAD.items())
def test_freedoms_that_do_not_fit_are_one_clear_error(words, call):
    with pytest.raises(TaskError, match=r"\A[^\n]*\Z") as told:
        call()
    assert str(told.value).startswith(words)


def test_the_command_writes_the_task(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    task = p3dof.Task(
        [
            Waypoint([-0.1, 0, 0]),
            Waypoint([0.0, 0.1, 0], "top", blend=0.02, blend_range=[0.01, 0.06]),
            Waypoint([0.1, 0, 0]),
        ]
    )
    p3dof.write_task(task, "task.yaml")
    limits = "--max-force", 300, "--max-speed", 2, "--nodes", 50
    code, out, _ = run(capsys, "fastest", "task.yaml", "--best-path", "--task-out", "best.yaml", *limits)
    assert code == 0
    assert "top: blend [mm]" in out
    assert p3dof.read_task("best.yaml").waypoints[1].blend == 0.06
    code, _, err = run(capsys, "fastest", "best.yaml", "--best-path", *limits)
    assert code == 2
    assert "nothing can be optimised" in err
    code, _, err = run(capsys, "fastest", "task.yaml", "--task-out", "other.yaml")
    assert code == 2
    assert "--best-path" in err


def test_progress_counts_what_was_done_before():
    told = []
    count = _counted(lambda *both: told.append(both), 30, 100)
    for more in (1, 5):
        count(more)
    assert told == [(31, 100), (35, 100)]
