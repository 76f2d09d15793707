"""The path of a motion, made as fast as the limits allow: published times, the path itself, rests, gaps."""

from itertools import pairwise

import numpy as np
import pytest
from command_line import run
from task_files import BLENDED, LINE

import p3dof
from p3dof._base.errors import TaskError
from p3dof.design import AxisLimits, best_path, fastest_plan
from p3dof.design.tasks.files import write_task
from p3dof.design.tasks.task import MotionTask
from p3dof.machine.motion import Motion, paper_motion

METRIC = np.array([1.0, 1.0, 0.1])


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


def papers_pose(t):
    """Eq. (5) of the paper."""
    return np.stack(
        [-t * t * (t * t - 1.3 * t + 0.3), 0.2 * t * t * (2 * t * t - t - 1), 0.4 * np.sin(4 * np.pi * t)], -1
    )


def papers_rate(t):
    return np.stack(
        [
            -4 * t**3 + 3.9 * t**2 - 0.6 * t,
            0.2 * (8 * t**3 - 3 * t**2 - 2 * t),
            1.6 * np.pi * np.cos(4 * np.pi * t),
        ],
        -1,
    )


def distance_to_papers_path(poses):
    """How far poses are from the paper's path, each from the place on it that is nearest, by Newton's way."""
    grid = np.linspace(0, 1, 4001)
    near = papers_pose(grid) * METRIC
    t = grid[[np.argmin(((pose * METRIC - near) ** 2).sum(axis=1)) for pose in poses]]
    for _ in range(8):
        off, rate = (papers_pose(t) - poses) * METRIC, papers_rate(t) * METRIC
        t = np.clip(t - (off * rate).sum(axis=1) / (rate * rate).sum(axis=1), 0, 1)
    return np.abs((papers_pose(t) - poses) * METRIC).max()


def joined(*poses, samples=400, rest=0.0):
    """Samples of poses that are gone to on straight lines, from rest to rest in a second each."""
    time, places, start = [np.zeros(1)], [np.array(poses[:1], dtype=float)], 0.0
    share = np.arange(1, samples + 1) / samples
    ease = share**3 * (10 - 15 * share + 6 * share**2)
    for a, b in pairwise(poses):
        time.append(start + share)
        places.append(np.array(a) + ease[:, None] * (np.array(b) - a))
        start += 1
        if rest:
            time.append(start + rest * np.arange(1, 11) / 10)
            places.append(np.tile(np.array(b, dtype=float), (10, 1)))
            start += rest
    return np.concatenate(time), np.concatenate(places)


@pytest.mark.parametrize(
    ("force", "mass", "expected"),
    [(500, 14.8044066, 0.52410), (1000, 14.8044066, 0.37183), (1000, 0, 0.23665)],
)
def test_the_least_time_of_the_papers_motion(robot, force, mass, expected):
    found = fastest_plan(robot, paper_motion(), AxisLimits(force, 2, reflected_mass=mass))
    assert found.duration == pytest.approx(expected, abs=3e-5)


def test_the_path_is_kept_between_the_samples_too(robot):
    path = MotionTask(paper_motion()).paths[0]
    poses = path.at(np.linspace(0, path.end, 3001))[0]
    assert distance_to_papers_path(poses) < 1e-11
    found = fastest_plan(robot, paper_motion(), AxisLimits(1000, 2), nodes=60).motion
    assert distance_to_papers_path(found.pose) < 1e-11
    assert np.abs(found.pose[[0, -1]] - papers_pose(np.array([0.0, 1.0]))).max() < 1e-15
    assert not found.velocity[[0, -1]].any()


def test_what_timing_a_motion_had_does_not_matter(robot):
    """A line slowly, with other steps and another profile, and by the task itself: published, .15834 s."""
    limits, pose = AxisLimits(500, 2), [point.pose for point in LINE.waypoints]
    fine = np.linspace(0, 1, 700) ** 1.3
    bent = pose[0] + (fine**4 * (35 - 84 * fine + 70 * fine**2 - 20 * fine**3))[:, None] * (pose[1] - pose[0])
    for motion in (
        LINE.plan(1.0).motion,
        Motion.rest_to_rest(*pose, 30.0, samples=301),
        Motion.from_poses(7 * fine, bent),
    ):
        assert fastest_plan(robot, motion, limits).duration == pytest.approx(0.15834, abs=2e-5)


def test_a_blended_path_comes_back_from_its_samples(robot):
    motion = BLENDED.plan(1.0).motion
    limits = AxisLimits(120, 1)
    assert fastest_plan(robot, motion, limits).duration == pytest.approx(0.47872, abs=2e-4)  # published


def test_the_jerk_is_limited_as_on_the_path_of_a_task(robot):
    limits = AxisLimits(500, 2, jerk=500.0)
    found, known = (fastest_plan(robot, what, limits, nodes=40) for what in (LINE.plan(1.0).motion, LINE))
    assert found.duration == pytest.approx(known.duration, rel=3e-3)
    assert max(use.share for use in found.uses) <= 1 + 1e-9


def test_rests_are_kept_and_a_stop_for_a_moment_is_one(robot):
    a, b, c = [-0.1, 0, -0.2], [0.1, 0.02, 0.2], [0, -0.02, 0]
    limits = AxisLimits(500, 2)
    tasks = [p3dof.Task([p3dof.Waypoint(x), p3dof.Waypoint(y)]) for x, y in ((a, b), (b, c))]
    alone = [fastest_plan(robot, task, limits, nodes=200).duration for task in tasks]
    for rest in (0.0, 0.25):
        time, poses = joined(a, b, c, rest=rest)
        task = MotionTask(Motion.from_poses(time, poses), "there and back")
        assert [point.dwell for point in task.waypoints] == pytest.approx([0, rest, rest], abs=1e-12)
        assert np.array([point.pose for point in task.waypoints]) == pytest.approx(
            np.array([a, b, c]), abs=1e-15
        )
        found = fastest_plan(robot, task, limits, nodes=200)
        assert found.duration == pytest.approx(sum(alone) + 2 * rest, abs=4e-5)
        assert found.name == "there and back"
        assert found.waypoints == ("start", "stop at 1 s", "end")


def test_bad_motions_are_refused(robot, tmp_path):
    time, poses = joined([-0.1, 0, -0.2], [0.1, 0.02, 0.2])
    holed = np.r_[0:180, 200:401]
    cases = [
        (Motion(time, poses * 0 + 0.1, poses * 0, poses * 0), "the motion stays in one pose"),
        (Motion.from_poses(time[holed], poses[holed]), r"a gap from 0\.4475 to 0\.5 s: a step of"),
        (3.0, "motion: expected a Motion, got 3.0"),
    ]
    for motion, told in cases:
        with pytest.raises(TaskError, match=told):
            MotionTask(motion)
    coarse = np.linspace(0, 1, 5)
    with pytest.raises(TaskError, match="does not go as the velocity at"):
        MotionTask(
            Motion(coarse, papers_pose(coarse), papers_rate(coarse), 0 * papers_rate(coarse), check=False)
        )
    whole = MotionTask(Motion.from_poses(time, poses))
    with pytest.raises(TaskError, match="the path of a motion has no form as a task file"):
        write_task(whole, tmp_path / "task.yaml")
    with pytest.raises(TaskError, match="nothing can be optimised"):
        best_path(robot, whole, AxisLimits(500, 2))


def test_the_command_takes_a_motion_file(capsys, tmp_path):
    file, out = tmp_path / "slow.csv", tmp_path / "fast.csv"
    paper_motion(301).to_csv(file)
    limits = ("--max-force", "300 N", "--max-speed", "2", "--nodes", "60")
    code, told, _ = run(capsys, "fastest", file, *limits, "--out", out)
    assert code == 0
    assert "start → end" in told
    same = fastest_plan(p3dof.load(), Motion.from_csv(file), AxisLimits(300, 2), nodes=60)
    assert Motion.from_csv(out).duration == pytest.approx(same.duration, rel=1e-12)
    code, _, told = run(capsys, "plan", file)
    assert code == 2
    assert told.startswith("p3dof: error:")
