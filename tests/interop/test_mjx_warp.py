"""MJX and MuJoCo Warp read the MJCF of any robot; `docs/examples/robot_in_mjx.py` and `robot_in_warp.py`."""

import numpy as np
import pytest
from closed_loop_robots import differences
from documents import ROOT
from numpy.testing import assert_allclose

import p3dof

mujoco = pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[mjcf]'")
jax = pytest.importorskip("jax", reason="jax not installed: pip install 'p3dof[jax]'")
mjx = pytest.importorskip("mujoco.mjx", reason="mujoco-mjx not installed: pip install 'p3dof[adapters]'")
warp = pytest.importorskip("mujoco_warp", reason="mujoco-warp not installed: pip install 'p3dof[adapters]'")
robot_in_mjx = pytest.importorskip("robot_in_mjx")
robot_in_warp = pytest.importorskip("robot_in_warp")
GALLERY = {file.stem: file for file in sorted((ROOT / "docs/_static/gallery").glob("*.urdf"))}
FAST = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}
SINGLE = 2e-6  # single precision, over a dozen bodies; of the largest force


pytestmark = pytest.mark.usefixtures("warp_cache")


def motions(loop, count=3, seed=0):
    """Closed states that move, their order in MuJoCo, and the forces by p3dof."""
    model, rng = loop.model, np.random.default_rng(seed)
    home = loop.assemble().q
    u = [home[model.joints[model.getJointId(name)].idx_q] for name in loop.actuated]
    at = u + 0.05 * rng.uniform(-1, 1, (count, len(u)))
    states = loop.complete_batch(at, *rng.normal(size=(2, count, len(u))))
    assert not states.errors
    return states, loop.inverse_dynamics_batch(states.q, states.v, states.a).tau


def order(loop, theirs):
    """Where each of MuJoCo's coordinates is in ours."""
    return [loop.model.joints[loop.model.getJointId(theirs.joint(i).name)].idx_q for i in range(theirs.njnt)]


def compiled(function, *arguments):
    return jax.jit(function).lower(*arguments).compile(compiler_options=FAST)(*arguments)


@pytest.mark.parametrize("name", GALLERY)
def test_the_mjcf_is_read_as_it_is(name, tmp_path):
    """No shapes are written, so nothing collides; every closure and motor is there."""
    loop = p3dof.load_robot(GALLERY[name])
    loop.write(tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert model.ngeom == 0
    for read in (mjx.put_model(model), warp.put_model(model)):
        assert (read.nq, read.nv, read.nu, read.neq) == (model.nq, model.nv, model.nu, model.neq)
        assert read.ngeom == 0
    assert model.nu == len(loop.actuated)


def test_mjx_has_the_same_forces():
    loop = p3dof.load_robot(GALLERY["four_bar"])
    states, tau = motions(loop)
    with jax.enable_x64(True):
        robot = robot_in_mjx.RobotInMjx(loop)
        to = order(loop, robot.mujoco)
        found = compiled(robot.forces, states.q[0, to], states.v[0, to], states.a[0, to])
    assert_allclose(found, tau[0], rtol=0, atol=1e-12 * np.abs(tau).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["five_bar", "gripper"])
def test_mjx_has_the_same_forces_and_accelerations_in_double_precision(name):
    loop = p3dof.load_robot(GALLERY[name])
    states, tau = motions(loop)
    with jax.enable_x64(True):
        robot = robot_in_mjx.RobotInMjx(loop)
        to = order(loop, robot.mujoco)
        q, v, a = states.q[:, to], states.v[:, to], states.a[:, to]
        assert_allclose(
            compiled(jax.vmap(robot.forces), q, v, a), tau, rtol=0, atol=1e-10 * np.abs(tau).max()
        )
        found = compiled(jax.vmap(robot.accelerations), q, v, tau)
        assert_allclose(found, a, rtol=0, atol=1e-9 * np.abs(a).max())
        other = compiled(jax.vmap(robot.accelerations), q, v, tau + 1.0)
        assert np.abs(other - a).max() > 0.1


@pytest.mark.slow
def test_mjx_has_derivatives_of_forces():
    loop = p3dof.load_robot(GALLERY["four_bar"])
    states, _ = motions(loop, 1)
    here = states.q[0][loop.actuated_v]

    def held(angle):
        state = loop.complete(here + angle, [0.0], [0.0], guess=states.q[0])
        return loop.inverse_dynamics(state.q, state.v, state.a).tau

    first, _ = differences(held, h=1e-3)
    with jax.enable_x64(True):
        robot = robot_in_mjx.RobotInMjx(loop)
        to = order(loop, robot.mujoco)
        rest, along = np.zeros(len(to)), states.v[0, to] / states.v[0, loop.actuated_v]
        _, found = jax.jit(lambda q, t: jax.jvp(lambda x: robot.forces(x, rest, rest), (q,), (t,)))(
            states.q[0, to], along
        )
    assert_allclose(found, first, rtol=0, atol=1e-8 * max(1.0, np.abs(first).max()))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["four_bar", "five_bar", "gripper"])
def test_warp_has_the_same_forces_in_single_precision(name):
    loop = p3dof.load_robot(GALLERY[name])
    states, tau = motions(loop, 5)
    robot = robot_in_warp.RobotInWarp(loop, 5)
    to = order(loop, robot.mujoco)
    found = robot.forces(states.q[:, to], states.v[:, to], states.a[:, to])
    assert_allclose(found, tau, rtol=0, atol=SINGLE * np.abs(tau).max())


@pytest.mark.slow
def test_warp_has_mujocos_accelerations_of_the_tree():
    robot = robot_in_warp.RobotInWarp(p3dof.load_robot(GALLERY["five_bar"]), 1)
    model, (theirs, data) = robot.mujoco, robot.tree
    own, rng = mujoco.MjData(model), np.random.default_rng(2)
    own.qpos[:], own.qvel[:], own.ctrl[:] = model.key_qpos[0], rng.normal(size=4), rng.normal(size=2)
    mujoco.mj_forward(model, own)
    for name in ("qpos", "qvel", "ctrl"):
        getattr(data, name).assign(getattr(own, name)[None].astype(np.float32))
    warp.forward(theirs, data)
    assert_allclose(data.qacc.numpy()[0], own.qacc, rtol=0, atol=10 * SINGLE * np.abs(own.qacc).max())


def test_joints_of_several_coordinates_are_told():
    loop = p3dof.load_robot(GALLERY["delta"])
    for adapter in (robot_in_mjx.RobotInMjx, lambda one: robot_in_warp.RobotInWarp(one, 1)):
        with pytest.raises(ValueError, match="expected joints with one coordinate each, slides and hinges"):
            adapter(loop)
