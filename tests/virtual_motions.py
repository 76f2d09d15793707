"""Virtual motions of any robot with closed loops, found without the package's closures.

Errors of closures and couplings are written here from placements of frames and values of joints; their
Jacobian comes from central differences, and its null space are the virtual motions. D'Alembert's principle
along them gives the forces of the actuators.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from p3dof.loops import ClosedLoopModel

SIXTH_ORDER = (np.array([-3, -2, -1, 1, 2, 3]), np.array([-1, 9, -45, 45, -9, 1]) / 60)


def errors(loop: ClosedLoopModel, q: np.ndarray) -> np.ndarray:
    """How far closures and couplings are open, from placements of frames and values of joints."""
    model, data = loop.model, loop.model.createData()
    pin.framesForwardKinematics(model, data, q)
    parts = [np.zeros(0)]
    for closure in loop.sidecar.closures:
        one, two = (data.oMf[body_frame(model, name)] for name in (closure.frame1, closure.frame2))
        apart = two.translation - one.translation
        if closure.kind == "distance":
            parts.append(np.array([np.linalg.norm(apart) - closure.length]))
            continue
        parts.append(apart)
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


def passive(loop: ClosedLoopModel, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Forces (nv,) of springs and dampers at hinges."""
    forces = np.zeros(loop.model.nv)
    for given in loop.sidecar.joint_data:
        at = loop.model.idx_vs[loop.model.getJointId(given.joint)]
        forces[at] = (
            -given.stiffness * (value(loop.model, q, given.joint) - given.rest) - given.damping * v[at]
        )
    return forces


def smallest_forces(loop: ClosedLoopModel, N: np.ndarray, load: np.ndarray) -> np.ndarray:
    """The smallest forces of the actuators that do the work of a load (nv,) along all virtual motions."""
    tau, *_ = np.linalg.lstsq(N[loop.actuated_v].T, N.T @ load, rcond=None)
    return tau
