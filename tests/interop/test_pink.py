"""Pink: docs/examples/pink_closures.py, differential inverse kinematics with loop closures."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from reaching import ROBOTS, apart, out_of_reach, reaching

pytest.importorskip("pink", reason="pink not installed: pip install 'p3dof[adapters]'")
pytest.importorskip("daqp", reason="daqp not installed: pip install 'p3dof[adapters]'")

from pink_closures import ClosureTask, reach


@pytest.fixture(params=ROBOTS)
def case(request):
    return reaching(request.param)


@pytest.mark.parametrize("strict", [True, False], ids=["constraint", "task"])
def test_the_frame_is_reached_with_closed_loops_where_p3dof_assembles(case, strict):
    robot, frame, goal, there = case
    q = reach(robot, frame, goal, strict)[-1]
    assert np.abs(robot.closure_error(q)).max() < 1e-12
    assert apart(robot, frame, q, goal) < 1e-12
    assert_allclose(q, there, rtol=0, atol=1e-11)


def test_in_small_steps_the_loops_stay_closed_all_the_way(case):
    """What opens them grows with the square of a step."""
    robot, frame, goal, _ = case
    gaps = {}
    for gain in (0.01, 0.1):
        way = reach(robot, frame, goal, gain=gain, steps=int(10 / gain))
        gaps[gain] = max(np.abs(robot.closure_error(q)).max() for q in way)
        assert apart(robot, frame, way[-1], goal) < 1e-4 * apart(robot, frame, way[0], goal)
    assert gaps[0.01] < 1e-6
    assert gaps[0.1] > 30 * gaps[0.01]


def test_out_of_reach_a_constraint_holds_and_a_task_yields():
    robot, frame, goal = out_of_reach()
    strict, yielding = (reach(robot, frame, goal, kind)[-1] for kind in (True, False))
    assert np.abs(robot.closure_error(strict)).max() < 1e-12
    assert 1e-9 < np.abs(robot.closure_error(yielding)).max() < 1e-5


def test_without_closures_the_loops_open(case, monkeypatch):
    robot, frame, goal, _ = case
    monkeypatch.setattr(ClosureTask.__init__, "__defaults__", (0.0,))
    q = reach(robot, frame, goal, strict=False)[-1]
    assert np.abs(robot.closure_error(q)).max() > 1e-3
