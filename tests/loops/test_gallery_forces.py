"""Forces of the gallery's robots against two references: virtual motions by differences, and MuJoCo."""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from gallery import GALLERY, MOBILITY, MOTORS
from mujoco_robots import in_mujoco
from virtual_motions import errors, passive, smallest_forces, virtual_motions

import p3dof

FLOATING = {"two_arms": "bar_free", "biped": "torso_free"}
"""What is prescribed where there are more motors than freedoms."""


@pytest.fixture(scope="module", params=MOBILITY)
def moving(request):
    """A robot that moves: name, robot, q, v, prescribed accelerations, what `hybrid_dynamics` finds."""
    name = request.param
    loop, rng = p3dof.load_robot(GALLERY / f"{name}.urdf"), np.random.default_rng(11)
    model, home = loop.model, loop.assemble().q
    q = loop.assemble(None, pin.integrate(model, home, 0.1 * rng.uniform(-1, 1, model.nv))).q
    _, _, Vt = np.linalg.svd(loop.closure_jacobian(q))
    N = Vt[loop.rank(q) :].T
    v = N @ rng.normal(size=MOBILITY[name])
    if name in FLOATING:
        wanted = {FLOATING[name]: rng.normal(size=6)}
    else:
        wanted = dict(zip(loop.actuated, rng.normal(size=MOTORS[name]), strict=True))
    return name, loop, q, v, wanted, loop.hybrid_dynamics(q, v, wanted)


def test_forces_are_those_of_virtual_motions(moving):
    name, loop, q, v, wanted, found = moving
    model = loop.model
    assert np.abs(errors(loop, q)).max() < 1e-12
    N = virtual_motions(loop, q)
    assert N.shape[1] == MOBILITY[name]
    np.testing.assert_allclose(N @ (N.T @ v), v, rtol=0, atol=1e-10 * np.abs(v).max())
    for joint, acceleration in wanted.items():
        at = model.joints[model.getJointId(joint)]
        given = found.a[at.idx_v : at.idx_v + at.nv]
        np.testing.assert_allclose(given, np.atleast_1d(acceleration), rtol=0, atol=1e-9)
    load = pin.rnea(model, model.createData(), q, v, found.a) - passive(loop, q, v)
    tau = smallest_forces(loop, N, load)
    size = max(np.abs(load).max(), np.abs(tau).max())
    np.testing.assert_allclose(found.tau, tau, rtol=0, atol=1e-10 * size)
    again = loop.inverse_dynamics(q, v, found.a)
    np.testing.assert_allclose(again.tau, tau, rtol=0, atol=1e-10 * size)
    assert again.tau_unique == found.tau_unique == (MOTORS[name] <= MOBILITY[name])
    # With the multipliers they hold the whole tree in balance, not only along the virtual motions.
    carried = load - loop.closure_jacobian(q).T @ again.lambda_
    carried[loop.actuated_v] -= tau
    assert np.abs(carried).max() < 1e-9 * size


def test_forces_bring_the_motion_back(moving):
    _, loop, q, v, _, found = moving
    size = max(1.0, np.abs(found.a).max())
    forward = loop.forward_dynamics(q, v, found.tau)
    np.testing.assert_allclose(forward.a, found.a, rtol=0, atol=1e-9 * size)
    # And the motion keeps the loops closed: along q(t) the errors have no second derivative.
    speed = np.abs(v).max() ** 2
    rate, curvature = robots.differences(
        lambda t: errors(loop, pin.integrate(loop.model, q, v * t + found.a * t * t / 2)),
        h=5e-3 / np.sqrt(max(size, speed)),
    )
    assert np.abs(rate).max() < 1e-9 * max(size, speed)
    assert np.abs(curvature).max() < 1e-7 * max(size, speed)


def test_forces_are_those_of_mujoco(moving):
    """MuJoCo reads the URDF itself; its open tree's load and its closures' Jacobian give the forces."""
    name, loop, q, v, _, found = moving
    mujoco = pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[engines]'")
    other = in_mujoco(loop, GALLERY / f"{name}.urdf")
    data = mujoco.MjData(other.model)
    data.qpos[:], data.qvel[:] = other.qpos(q), other.qvel(q, v)
    data.qacc[:] = other.qacc(q, v, found.a)
    mujoco.mj_inverse(other.model, data)
    assert np.abs(data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]).max() < 1e-12
    load = data.qfrc_inverse + data.qfrc_constraint  # without what soft closures give
    J = data.efc_J.reshape(data.nefc, other.model.nv)
    _, s, Vt = np.linalg.svd(J)
    N = Vt[np.count_nonzero(s > 1e-9 * s[0]) :].T
    assert N.shape[1] == MOBILITY[name]
    tau, *_ = np.linalg.lstsq(N[other.actuated_v()].T, N.T @ load, rcond=None)
    size = max(np.abs(load).max(), np.abs(tau).max())
    np.testing.assert_allclose(found.tau, tau, rtol=0, atol=1e-10 * size)
