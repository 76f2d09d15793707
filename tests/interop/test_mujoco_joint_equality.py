"""MuJoCo's joint equalities: a `Coupling` has their polynomial, and moves the same robot alike."""

import numpy as np
import pinocchio as pin
import pytest

from p3dof.loops import ClosedLoopModel, Coupling, Sidecar

mujoco = pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[test]'")

BODY = '<inertial pos="{pos}" mass="{mass}" fullinertia="0.02 0.03 0.04 0.001 -0.002 0.003"/>'


def body(name, pos, joint, axis, inside=""):
    inertial = BODY.format(pos=pos, mass=1.0 + 0.3 * len(name))
    return (
        f'<body name="{name}" pos="{pos}" euler="0.3 -0.2 0.5">{inertial}'
        f'<joint name="{name}_joint" type="{joint}" axis="{axis}"/>{inside}</body>'
    )


TREE = body(
    "base",
    "0.1 0.2 0.3",
    "hinge",
    "0 0.6 0.8",
    body(
        "arm",
        "0.3 0 0.1",
        "hinge",
        "1 0 0",
        body("hand", "0 0.2 0.2", "slide", "0.8 0 0.6", body("tip", "0.1 0.1 0", "hinge", "0 1 0")),
    )
    + body("gear", "-0.2 0 0.1", "hinge", "0 0 1", body("rack", "0 0.1 0", "slide", "1 0 0")),
)
EQUALITIES = """
<joint joint1="hand_joint" joint2="arm_joint" polycoef="0.05 0.3 -0.2 0.1 0.07"/>
<joint joint1="tip_joint" joint2="hand_joint" polycoef="0 2.5 1 0 0"/>
<joint joint1="rack_joint" joint2="gear_joint" polycoef="0 -0.04 0 0 0"/>
"""
MJCF = f"""<mujoco><compiler angle="radian" eulerseq="xyz"/><worldbody>{TREE}</worldbody>
<equality>{{}}</equality></mujoco>"""
COUPLINGS = (
    Coupling("hand_joint", "arm_joint", (0.05, 0.3, -0.2, 0.1, 0.07)),
    Coupling("tip_joint", "hand_joint", (0, 2.5, 1)),
    Coupling("rack_joint", "gear_joint", (0, -0.04)),
)


def rows(model, data, q, v):
    """MuJoCo's errors and Jacobian of the equalities."""
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(model, data)
    return data.efc_pos.copy(), data.efc_J.reshape(data.nefc, model.nv).copy()


def accelerations(model, q, v, force):
    """MuJoCo's mass matrix, bias and equality Jacobian, without the softness of its solver."""
    data, h = mujoco.MjData(model), 1e-4
    after, before = (rows(model, data, q + s * h * v, v)[1] for s in (1, -1))
    further, earlier = (rows(model, data, q + s * 2 * h * v, v)[1] for s in (1, -1))
    drift = (8 * (after - before) - (further - earlier)) @ v / (12 * h)
    _, J = rows(model, data, q, v)
    M = np.zeros((model.nv, model.nv))
    for row, unit in zip(M, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    free = np.linalg.solve(M, force - data.qfrc_bias)
    W = np.linalg.solve(M, J.T)
    return free - W @ np.linalg.lstsq(J @ W, J @ free + drift, rcond=1e-12)[0]


def test_couplings_move_a_robot_as_joint_equalities_do(tmp_path):
    reference = mujoco.MjModel.from_xml_string(MJCF.format(EQUALITIES))
    path = tmp_path / "robot.xml"
    path.write_text(MJCF.format(""), encoding="utf-8")  # Pinocchio's reader leaves joint equalities out
    model = pin.buildModelFromMJCF(str(path))
    assert [reference.joint(i).name for i in range(6)] == list(model.names)[1:]
    loop = ClosedLoopModel(model, Sidecar((), (), COUPLINGS))
    generator = np.random.default_rng(0)
    for _ in range(5):
        q = loop.assemble(guess=generator.normal(size=6)).q
        assert loop.mobility(q) == 3
        N = np.linalg.svd(loop.closure_jacobian(q))[2][3:].T
        v, force = N @ generator.normal(size=3), generator.normal(size=6)
        errors, J = rows(reference, mujoco.MjData(reference), q, v)
        assert np.abs(errors).max() < 1e-12
        np.testing.assert_allclose(J, loop.closure_jacobian(q), rtol=0, atol=1e-14)
        expected = accelerations(reference, q, v, force)
        a = loop.forward_dynamics(q, v, [], joint_forces=force).a
        np.testing.assert_allclose(a, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
