"""Motions of closed loops for tests, from differentiated Jacobians and projections; and a small biped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
from closed_loop_robots import ARM, BAR, ROD, Solid, differences
from documents import ROOT

import p3dof
from p3dof.loops import ClosedLoopModel, Closure, Sidecar


def index_of(loop: ClosedLoopModel, names: tuple[str, ...]) -> np.ndarray:
    """Entries of v of coordinates such as ``elbow`` and ``base[2]``."""
    model, found = loop.model, []
    for name in names:
        joint, _, rest = name.partition("[")
        found.append(model.idx_vs[model.getJointId(joint)] + (int(rest[:-1]) if rest else 0))
    return np.array(found, dtype=int)


def free_motions(loop: ClosedLoopModel, q: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """N (nv, n), and what closes the loops (nv, rows): both from the closures' Jacobian alone."""
    J = loop.closure_jacobian(q)
    both = np.linalg.pinv(np.vstack((J, np.eye(loop.model.nv)[index])), rcond=1e-8)
    return both[:, len(J) :], both[:, : len(J)]


def moved(loop: ClosedLoopModel, q: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The nearest configuration with closed loops after a step along the tangent."""
    there = pin.integrate(loop.model, q, step)
    return loop.assemble(None, there).q if len(loop.constraint_rows) else there


def motion(
    loop: ClosedLoopModel, q: np.ndarray, index: np.ndarray, speeds: np.ndarray, accelerations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and acceleration of the tree; J̇ v by differences of J v."""
    N, closing = free_motions(loop, q, index)
    v = N @ speeds
    drift, _ = differences(lambda t: loop.closure_jacobian(pin.integrate(loop.model, q, t * v)) @ v, h=1e-3)
    return v, N @ accelerations - closing @ drift


def slope(
    loop: ClosedLoopModel,
    q: np.ndarray,
    index: np.ndarray,
    state: np.ndarray,
    direction: np.ndarray,
    value: Callable[..., np.ndarray],
    h: float = 1e-3,
) -> np.ndarray:
    """Rate of value(q, v, a) when coordinates, speeds and accelerations (3 n) move along a direction."""
    n = len(index)
    N, _ = free_motions(loop, q, index)

    def at(t: float) -> np.ndarray:
        there = moved(loop, q, t * (N @ direction[:n])) if t else q
        speeds, accelerations = np.split((state + t * direction)[n:], 2)
        return value(there, *motion(loop, there, index, speeds, accelerations))

    return differences(at, h=h)[0]


FOOT = Solid(0.9, (0.03, 0.0, -0.04), (0.002, 0, 0, 0.004, 0, 0.004))
LEG = (
    ("yaw", pin.JointModelRZ, (0, 0, 0), ROD),
    ("roll", pin.JointModelRX, (0, 0, 0), ROD),
    ("hip", pin.JointModelRY, (0, 0, -0.05), ARM),
    ("knee", pin.JointModelRY, (0, 0, -0.4), BAR),
    ("ankle", pin.JointModelRY, (0, 0, -0.35), ROD),
    ("tilt", pin.JointModelRX, (0, 0, -0.02), FOOT),
)
STANCE = {"hip": -0.4, "knee": 0.8, "ankle": -0.35, "yaw": 0.1, "roll": 0.05}


def biped(*standing: str) -> tuple[ClosedLoopModel, np.ndarray]:
    """A floating torso on two legs of six motors each; the feet named are held to the ground by frames."""
    model = pin.Model()
    torso = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(torso, pin.Inertia(9.0, np.array([0.02, 0.01, 0.2]), np.diag([0.3, 0.25, 0.1])),
                            pin.SE3.Identity())  # fmt: skip
    model.addFrame(pin.Frame("torso", torso, pin.SE3.Identity(), pin.FrameType.BODY))
    names = []
    for side, y in (("left", 0.1), ("right", -0.12)):
        parent, place = torso, np.array([0.0, y, -0.1])
        for part, joint, offset, solid in LEG:
            names.append(f"{side}_{part}")
            parent = model.addJoint(parent, joint(), pin.SE3(np.eye(3), place + np.array(offset)), names[-1])
            inertia = pin.Inertia(solid.mass, np.array(solid.com), solid.matrix)
            model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
            place = np.zeros(3)
        sole = pin.SE3(np.eye(3), np.array([0.02, 0.0, -0.06]))
        model.addFrame(pin.Frame(f"{side}_sole", parent, sole, pin.FrameType.OP_FRAME))
    q = pin.neutral(model)
    q[2] = 0.9
    for name in names:
        value = STANCE.get(name.split("_")[1], 0.0) * (1.0 if name.startswith("left") else 0.9)
        q[model.idx_qs[model.getJointId(name)]] = value
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    for side in standing:
        mark = data.oMf[model.getFrameId(f"{side}_sole")]
        model.addFrame(pin.Frame(f"{side}_ground", 0, mark, pin.FrameType.OP_FRAME))
    closures = tuple(Closure(f"{side}_ground", f"{side}_sole", "6d") for side in standing)
    model.armature = np.concatenate((np.zeros(6), np.full(12, 0.01)))
    return ClosedLoopModel(model, Sidecar(closures, tuple(names))), q


def five_bar(**changes: object) -> tuple[ClosedLoopModel, np.ndarray]:
    sidecar = replace(robots.FIVE_BAR_SIDECAR, **changes)
    return ClosedLoopModel.from_urdf(robots.five_bar(), sidecar), robots.five_bar_q(2.0, 1.0)


def stewart() -> tuple[ClosedLoopModel, np.ndarray]:
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/stewart.urdf")
    generator = np.random.default_rng(1)
    q = loop.assemble().q
    return loop, moved(
        loop, q, np.linalg.svd(loop.closure_jacobian(q))[2][-6:].T @ generator.normal(size=6) / 10
    )


def geared() -> tuple[ClosedLoopModel, np.ndarray]:
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/gripper.urdf")
    return loop, loop.assemble().q


def bent() -> tuple[ClosedLoopModel, np.ndarray]:
    """Bars of the four-bar without its closure, geared by polynomials."""
    couplings = (
        p3dof.Coupling("rocker_joint", "crank_joint", (0.1, -0.5, 0.3, 0.2)),
        p3dof.Coupling("coupler_joint", "rocker_joint", (0.3, 0.1, -0.4)),
    )
    sidecar = Sidecar((), ("crank_joint",), couplings)
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)
    return loop, loop.assemble([0.7]).q


ROBOTS = {
    "five-bar": five_bar,
    "Stewart platform": stewart,
    "gripper with a coupling": geared,
    "bars with bent couplings": bent,
    "biped in the air": biped,
    "biped on one foot": lambda: biped("left"),
    "biped on two feet": lambda: biped("left", "right"),
}
