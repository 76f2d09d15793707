"""CasADi: docs/examples/casadi_*.py, generated C as functions with Jacobians, an optimum by IPOPT."""

import shutil

import numpy as np
import pytest
from closed_loop_robots import differences
from documents import ROOT
from gallery import GALLERY, gallery
from numpy.testing import assert_allclose

import p3dof

pytest.importorskip("casadi", reason="casadi not installed: pip install 'p3dof[adapters]'")

import casadi_swing_up
from casadi_robot import dynamics

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="cc not installed")
FILES = {
    "five-bar": GALLERY / "five_bar.urdf",
    "paper": ROOT / "urdf/p3dof.urdf",
    "stewart": GALLERY / "stewart.urdf",
}
LONG = {"stewart": pytest.mark.slow}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    found = {}

    def of(name):
        if name not in found:
            found[name] = dynamics(FILES[name], tmp_path_factory.mktemp(name))
        return found[name]

    return of


@pytest.mark.parametrize("name", [pytest.param(name, marks=LONG.get(name, ())) for name in FILES])
def test_accelerations_and_jacobians_are_those_of_the_robot(made, name):
    accelerate, robot = made(name), p3dof.load_robot(FILES[name])
    by, rng, home = accelerate.jacobian(), np.random.default_rng(0), robot.assemble().q
    joints = [robot.model.joints[robot.model.getJointId(name)] for name in robot.actuated]
    places = [joint.idx_v for joint in joints]
    start, n = np.array([home[joint.idx_q] for joint in joints]), len(joints)
    for _ in range(5):
        x, u = np.r_[start + 0.03 * rng.normal(size=n), 0.3 * rng.normal(size=n)], 20 * rng.normal(size=n)
        moving = robot.complete(x[:n], x[n:], 0 * u, guess=home)
        expected = robot.forward_dynamics_derivatives(moving.q, moving.v, u)
        a = np.array(accelerate(x, u)).ravel()
        Fx, Fu = map(np.array, by(x, u, []))
        size = np.abs(expected.Fx).max()
        assert_allclose(a, expected.dynamics.a[places], rtol=0, atol=1e-11 * size)
        assert_allclose(Fx, expected.Fx[n:], rtol=0, atol=1e-10 * size)
        assert_allclose(Fu, expected.Fu[n:], rtol=0, atol=1e-10 * np.abs(expected.Fu).max())
    columns = [
        differences(lambda t, along=along: np.array(accelerate(x + t * along, u)).ravel(), h=5e-4)[0]
        for along in np.eye(2 * n)
    ]
    assert_allclose(Fx, np.transpose(columns), rtol=0, atol=1e-8 * size)
    x[0] += 0.01  # elsewhere they are others
    assert np.abs(np.array(by(x, u, [])[0]) - np.transpose(columns)).max() > 1e-5 * size


def test_a_state_out_of_reach_is_an_error_and_leaves_no_trace(made):
    accelerate = made("five-bar")
    x, u = [2.0, 1.1, 0.1, 0.2], [1.0, 2.0]
    before = np.array(accelerate(x, u))
    for y in ([np.pi, 0.0], [np.nan, 1.0], [1e9, 1.0]):  # both rods in one line; and what is no place
        with pytest.raises(RuntimeError, match="Evaluation failed"):
            accelerate([*y, 0, 0], u)
    assert (np.array(accelerate(x, u)) == before).all()


@pytest.fixture(scope="module")
def swing(made):
    return casadi_swing_up.swing_up(made("five-bar"))


def test_a_five_bar_swings_up_within_the_limit_and_p3dof_integrates_it_likewise(made, swing):
    accelerate, robot, (xs, us, _) = made("five-bar"), gallery("five_bar"), swing
    assert np.abs(us).max() < 1.8 + 1e-6
    assert_allclose(xs[0], np.r_[casadi_swing_up.DOWN, 0, 0], rtol=0, atol=1e-8)
    assert_allclose(xs[-1], np.r_[casadi_swing_up.UP, 0, 0], rtol=0, atol=1e-8)

    def rate(x, u):
        return np.r_[x[2:], np.array(accelerate(x, u)).ravel()]

    near, h = robot.assemble(casadi_swing_up.DOWN).q, 0.05 / 10
    for x, u, after in zip(xs, us, xs[1:], strict=False):
        start = robot.complete(x[:2], x[2:], [0, 0], guess=near)
        near = start.q
        run = p3dof.runs.simulate_robot(robot, 0.05, start.q, start.v, u, samples=2, stop_at=())
        end = np.r_[run.q[-1, robot.actuated_v], run.v[-1, robot.actuated_v]]
        assert np.abs(end - after).max() < 5e-3  # the error of one step of 0.05 s
        for _ in range(10):
            a = rate(x, u)
            b = rate(x + h / 2 * a, u)
            c = rate(x + h / 2 * b, u)
            x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c, u))  # noqa: PLW2901
        assert_allclose(end, x, rtol=0, atol=1e-6)


def test_ipopt_and_fddp_find_optima_of_the_same_cost(swing):
    pytest.importorskip("crocoddyl", reason="crocoddyl not installed: pip install 'p3dof[adapters]'")
    import crocoddyl_swing_up

    solver = crocoddyl_swing_up.swing_up(gallery("five_bar"))
    least = swing[2]
    assert least < solver.cost < 1.02 * least  # FDDP pays for the goal too, and stops earlier
