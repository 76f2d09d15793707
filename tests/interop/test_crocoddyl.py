"""Crocoddyl: docs/examples/crocoddyl_*.py, optimal control of closed-loop robots with exact derivatives."""

import numpy as np
import pytest
from closed_loop_robots import differences
from gallery import gallery
from numpy.testing import assert_allclose

import p3dof

crocoddyl = pytest.importorskip("crocoddyl", reason="crocoddyl not installed: pip install 'p3dof[adapters]'")

import crocoddyl_pick  # noqa: E402
import crocoddyl_swing_up  # noqa: E402
from crocoddyl_robot import RobotAction  # noqa: E402

ROBOTS = {
    "five-bar": lambda: gallery("five_bar"),
    "paper": lambda: p3dof.load().loop,
    "stewart": lambda: gallery("stewart"),
}
LONG = {"stewart": pytest.mark.slow}
"""Compilers take half a minute for its derivatives."""


@pytest.fixture(scope="module", params=[pytest.param(name, marks=LONG.get(name, ())) for name in ROBOTS])
def action(request):
    robot = ROBOTS[request.param]()
    n = len(robot.actuated)
    return RobotAction(robot, np.full(2 * n, 0.1), np.arange(1.0, 2 * n + 1), 0.3)


def state(action, seed=0):
    """Return a state near where the robot is at home, and forces of the size of its weight."""
    rng, n = np.random.default_rng(seed), action.nu
    x = np.r_[action.q[action.at] + 0.03 * rng.normal(size=n), 0.3 * rng.normal(size=n)]
    return x, 20 * rng.normal(size=n)


def evaluated(model, x, u):
    data = model.createData()
    model.calc(data, x, u)
    model.calcDiff(data, x, u)
    return data


def test_accelerations_are_those_of_the_robot_and_derivatives_are_exact(action):
    (x, u), n = state(action), action.nu
    found = evaluated(action, x, u)
    robot = action.robot
    moving = robot.complete(x[:n], x[n:], np.zeros(n), guess=action.q)
    expected = robot.forward_dynamics_derivatives(moving.q, moving.v, u)
    scale = np.abs(found.Fx).max()
    assert_allclose(found.xout, expected.dynamics.a[action.rows], rtol=1e-10, atol=1e-10 * scale)
    assert_allclose(found.Fx, expected.Fx[n:], rtol=0, atol=1e-9 * scale)
    assert_allclose(found.Fu, expected.Fu[n:], rtol=0, atol=1e-9 * np.abs(found.Fu).max())

    def along(dx, du):
        def moved(t):
            data = action.createData()
            action.calc(data, x + t * dx, u + t * du)
            return np.r_[data.xout, data.cost]

        return differences(moved, h=5e-4)[0]

    columns = np.array([along(dx, 0 * u) for dx in np.eye(2 * n)]).T
    assert_allclose(found.Fx, columns[:-1], rtol=0, atol=1e-8 * scale)
    assert_allclose(found.Lx, columns[-1], rtol=0, atol=1e-8 * np.abs(found.Lx).max())
    columns = np.array([along(0 * x, du) for du in np.eye(n)]).T
    assert_allclose(found.Fu, columns[:-1], rtol=0, atol=1e-8 * np.abs(found.Fu).max())
    assert_allclose(found.Lu, columns[-1], rtol=0, atol=1e-8 * np.abs(found.Lu).max())
    x[0] += 0.01  # elsewhere they are others
    assert np.abs(evaluated(action, x, u).Fu - columns[:-1]).max() > 1e-5 * np.abs(found.Fu).max()


def test_crocoddyls_own_differences_agree_through_its_integrator(action):
    x, u = state(action, 1)
    step = crocoddyl.IntegratedActionModelRK(action, crocoddyl.RKType.four, 0.01)
    found = evaluated(step, x, u)
    theirs = evaluated(crocoddyl.ActionModelNumDiff(step), x, u)
    for name in ("Fx", "Fu", "Lx", "Lu"):
        ours = getattr(found, name)
        assert_allclose(ours, getattr(theirs, name), rtol=0, atol=1e-6 * np.abs(ours).max(), err_msg=name)


def test_what_is_out_of_reach_is_nan_and_leaves_the_branch_alone(action):
    x, u = state(action)
    before = evaluated(action, x, u).xout.copy()
    apart = np.r_[np.pi, np.zeros(len(x) - 1)]  # of a five-bar: both rods in one line; of sliders: 3 m
    for far in (apart, np.full_like(x, np.nan)):
        data = action.createData()
        action.calc(data, far, u)
        assert np.isnan(data.xout).all()
    assert_allclose(evaluated(action, x, u).xout, before, rtol=1e-10, atol=1e-10 * np.abs(before).max())


@pytest.fixture(scope="module")
def swing():
    robot = gallery("five_bar")
    return robot, crocoddyl_swing_up.swing_up(robot)


def test_a_five_bar_swings_up_by_motors_that_could_not_hold_it_level(swing):
    robot, solver = swing
    example = crocoddyl_swing_up
    torques, states = np.array(solver.us), np.array(solver.xs)
    assert np.abs(torques).max() <= 1.8
    still = robot.complete([0, 0], [0, 0], [0, 0], guess=robot.assemble([0, 0]).q)
    assert robot.inverse_dynamics(still.q, still.v, still.a).tau.min() > 1.95
    assert_allclose(states[0], np.r_[example.DOWN, 0, 0], rtol=0, atol=1e-12)
    assert_allclose(states[-1], np.r_[example.UP, 0, 0], rtol=0, atol=1e-3)
    assert solver.stop < solver.th_stop


def test_p3dof_integrates_the_swing_likewise(swing):
    """From each node as the adapter in short steps; all the way it is FDDP's gains that hold it."""
    robot, solver = swing
    step, run = crocoddyl_swing_up.STEP, crocoddyl_swing_up.simulate(robot, solver)
    assert run.gap.max() < 1e-9
    assert_allclose(run.q[-1, robot.actuated_v], crocoddyl_swing_up.UP, rtol=0, atol=1e-3)
    assert_allclose(run.v[-1, robot.actuated_v], 0, rtol=0, atol=1e-3)
    action = RobotAction(robot, np.zeros(4), np.zeros(4), 0.0)
    short = crocoddyl.IntegratedActionModelRK(action, crocoddyl.RKType.four, step / 10)
    data, near = short.createData(), robot.assemble(crocoddyl_swing_up.DOWN).q
    for x, u, after in zip(solver.xs, solver.us, solver.xs.tolist()[1:], strict=False):
        start = robot.complete(x[:2], x[2:], [0, 0], guess=near)
        near, moved = start.q, x
        part = p3dof.runs.simulate_robot(robot, step, start.q, start.v, u, samples=2, stop_at=())
        for _ in range(10):
            short.calc(data, moved, u)
            moved = data.xnext.copy()
        end = np.r_[part.q[-1, robot.actuated_v], part.v[-1, robot.actuated_v]]
        assert_allclose(end, moved, rtol=0, atol=1e-6)
        assert np.abs(end - after).max() < 5e-3  # the error of one step of 0.05 s


def test_the_papers_machine_fetches_a_payload_and_carries_it_off():
    empty, laden, places = crocoddyl_pick.robots()
    solver = crocoddyl_pick.pick(empty, laden, places)
    half, own = crocoddyl_pick.NODES // 2, empty.actuated_v
    states, forces = np.array(solver.xs), np.array(solver.us)
    for i, place in zip((0, half, -1), places, strict=True):
        assert_allclose(states[i], np.r_[place, 0 * place], rtol=0, atol=1e-5)
    assert np.abs(forces).max() < p3dof.PAPER.limits.force
    to, back = crocoddyl_pick.simulate(empty, laden, solver)
    assert max(to.gap.max(), back.gap.max()) < 1e-9
    for run, part in ((to, states[: half + 1]), (back, states[half:])):
        assert_allclose(run.q[:, own], part[:, :3], rtol=0, atol=1e-6)
        assert_allclose(run.v[:, own], part[:, 3:], rtol=0, atol=1e-4)
    _, lost = crocoddyl_pick.simulate(empty, empty, solver)  # without the payload it ends elsewhere
    assert np.abs(lost.q[-1, own] - states[-1, :3]).max() > 1e-2
