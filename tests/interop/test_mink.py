"""mink: docs/examples/mink_closures.py, differential inverse kinematics with loop closures."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from reaching import ROBOTS, apart, motors, out_of_reach, reaching

pytest.importorskip("mink", reason="mink not installed: pip install 'p3dof[adapters]'")
pytest.importorskip("daqp", reason="daqp not installed: pip install 'p3dof[adapters]'")

from mink_closures import reach


@pytest.fixture(params=ROBOTS)
def case(request):
    return reaching(request.param)


@pytest.mark.parametrize("strict", [True, False], ids=["constraint", "task"])
def test_the_frame_is_reached_with_closed_loops_where_p3dof_assembles(case, strict):
    robot, frame, goal, there = case
    found, errors = reach(robot, frame, goal, strict)
    assert np.abs(errors[-1]).max() < 1e-12
    assert_allclose(found[-1], motors(robot, there), rtol=0, atol=1e-9)
    assert apart(robot, frame, robot.assemble(found[-1], guess=there).q, goal) < 1e-9


def test_in_small_steps_the_loops_stay_closed_all_the_way(case):
    """What opens them grows with the square of a step."""
    robot, frame, goal, there = case
    gaps = {}
    for gain in (0.01, 0.1):
        found, errors = reach(robot, frame, goal, gain=gain, steps=int(10 / gain))
        gaps[gain] = np.abs(errors).max()
        assert_allclose(found[-1], motors(robot, there), rtol=0, atol=1e-4)
    assert gaps[0.01] < 1e-6
    assert gaps[0.1] > 30 * gaps[0.01]


def test_out_of_reach_a_constraint_holds_and_a_task_yields():
    robot, frame, goal = out_of_reach()
    (_, strict), (_, yielding) = (reach(robot, frame, goal, kind) for kind in (True, False))
    assert np.abs(strict[-1]).max() < 1e-12
    assert 1e-9 < np.abs(yielding[-1]).max() < 1e-5
