"""Forces of public robots against d'Alembert's principle with closures differentiated numerically.

The reference shares nothing with the package's closures: errors of closures and couplings are written here
from placements of frames, their Jacobian comes from central differences, and its null space are the virtual
motions.
"""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT

import p3dof
from p3dof.closed_loop import ClosedLoopModel

SHARED = ROOT.parent / "shared" / "robots"
ROBOTS = [
    "5bar_linkage/robot.urdf",
    "5bar_linkage_iso3d/robot.urdf",
    "5bar_linkage_iso6d/robot.urdf",
    "digit_like/robot.urdf",
    "digit_like_2legs/robot.urdf",
    "robot_delta/robot.urdf",
    "urdf_plus/four_bar.urdf",
    "urdf_plus/mini_cheetah_leg.urdf",
    "urdf_plus/planar_leg_linkage.urdf",
    "urdf_plus/revolute_rotor_chain.urdf",
    "urdf_plus/six_bar.urdf",
]
SIXTH_ORDER = (np.array([-3, -2, -1, 1, 2, 3]), np.array([-1, 9, -45, 45, -9, 1]) / 60)


def errors(loop: ClosedLoopModel, q: np.ndarray) -> np.ndarray:
    """How far closures and couplings are open, from placements of frames and values of joints."""
    model, data = loop.model, loop.model.createData()
    pin.framesForwardKinematics(model, data, q)
    parts = [np.zeros(0)]
    for closure in loop.sidecar.closures:
        one, two = (data.oMf[body_frame(model, name)] for name in (closure.frame1, closure.frame2))
        parts.append(two.translation - one.translation)
        if closure.kind == "6d":
            parts.append(pin.log3(one.rotation.T @ two.rotation))
        elif closure.kind == "hinge":
            parts.append(np.cross(one.rotation[:, 2], two.rotation[:, 2]))
        else:
            assert closure.kind == "3d"
    for coupling in loop.sidecar.couplings:
        terms = [(name, factor) for name, factor in coupling.others]
        follows = np.polynomial.polynomial.polyval(value(model, q, coupling.on), coupling.coefficients)
        follows += sum(factor * value(model, q, name) for name, factor in terms)
        parts.append(np.array([value(model, q, coupling.joint) - follows]))
    return np.concatenate(parts)


def body_frame(model: pin.Model, name: str) -> int:
    """The frame of a name; that of the link where a joint has the same one."""
    return max(
        (i for i, frame in enumerate(model.frames) if frame.name == name),
        key=lambda i: model.frames[i].type == pin.FrameType.BODY,
    )


def value(model: pin.Model, q: np.ndarray, name: str | None) -> float:
    if name is None:
        return 0.0
    joint = model.getJointId(name)
    at = model.idx_qs[joint]
    return float(np.arctan2(q[at + 1], q[at]) if model.nqs[joint] == 2 else q[at])


def virtual_motions(loop: ClosedLoopModel, q: np.ndarray, h: float = 5e-3) -> np.ndarray:
    """Null space (nv, n) of the closures' Jacobian by differences of sixth order."""
    model, (steps, weights) = loop.model, SIXTH_ORDER
    columns = [
        weights @ [errors(loop, pin.integrate(model, q, k * h * unit)) for k in steps] / h
        for unit in np.eye(model.nv)
    ]
    _, s, Vt = np.linalg.svd(np.transpose(columns))
    return Vt[int(np.count_nonzero(s > 1e-7 * s[0])) :].T


@pytest.mark.parametrize("file", ROBOTS)
def test_forces_are_those_of_virtual_motions(file):
    if not (SHARED / file).exists():
        pytest.skip("the collection of public robots is not at hand")
    loop = p3dof.load_robot(SHARED / file)
    model, rng = loop.model, np.random.default_rng(3)
    home = loop.assemble().q
    q = loop.assemble(None, pin.integrate(model, home, 0.1 * rng.uniform(-1, 1, model.nv))).q
    assert np.abs(errors(loop, q)).max() < 1e-9
    N = virtual_motions(loop, q)
    assert N.shape[1] == loop.mobility(q) == model.nv - loop.generic_rank
    v = N @ rng.normal(size=N.shape[1])
    prescribed = rng.normal(size=len(loop.actuated))
    found = loop.hybrid_dynamics(q, v, prescribed)
    f = pin.rnea(model, model.createData(), q, v, found.a)
    tau, *_ = np.linalg.lstsq(N[loop.actuated_v].T, N.T @ f, rcond=None)
    size = max(np.abs(f).max(), np.abs(tau).max())
    np.testing.assert_allclose(found.tau, tau, rtol=0, atol=1e-10 * size)
    again = loop.inverse_dynamics(q, v, found.a)
    np.testing.assert_allclose(again.tau, tau, rtol=0, atol=1e-10 * size)
    forward = loop.forward_dynamics(q, v, tau)
    np.testing.assert_allclose(forward.a, found.a, rtol=0, atol=1e-9 * max(1.0, np.abs(found.a).max()))
    # The acceleration keeps the loops closed: along q(t) the errors have no second derivative.
    size = max(1.0, np.abs(found.a).max(), np.abs(v).max() ** 2)
    rate, curvature = robots.differences(
        lambda t: errors(loop, pin.integrate(model, q, v * t + found.a * t * t / 2)), h=5e-3 / np.sqrt(size)
    )
    assert np.abs(rate).max() < 1e-9 * size
    assert np.abs(curvature).max() < 1e-7 * size
