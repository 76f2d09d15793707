"""Pinocchio and the other engines on the paper's machine, as contenders."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from rounds import Contender, calling

import p3dof
from p3dof.loops.batch.assembly import complete_near
from p3dof.methods import engines
from p3dof.methods.pinocchio import target_of

OTHERS = "Pinocchio and others"
BARE, PARALLEL = "bare pin.rnea, called from Python", "pin.rneaInParallel, one thread"
SAMPLE_QVA, SAMPLE_POSE, SAMPLE_CALL = (
    "Pinocchio, sample by sample: q, v, a given",
    "Pinocchio, sample by sample: from the pose",
    "Pinocchio, sample by sample: robot.forces",
)
EVIDENCE = "Pinocchio, batch: with evidence (robot.inverse_dynamics)"
BATCH_QVA, BATCH_POSE = "Pinocchio, batch: q, v, a given", "Pinocchio, batch: from the pose (robot.forces)"
FEW, MANY = 100, 2000
MACHINE = "symmetric"


def pinocchio() -> Iterator[Contender]:
    """Bare calls of Pinocchio, and its route through the loops, sample by sample and as a batch."""
    robot = p3dof.load()
    few, many = p3dof.paper_motion(FEW), p3dof.paper_motion(MANY)
    joints = robot.inverse_dynamics(many).joints
    q, v, a = joints.q, joints.v, joints.a
    loop, depth = robot.loop, robot.parameters.geometry.h
    data = robot.model.createData()

    def bare() -> None:
        for i in range(MANY):
            pin.rnea(robot.model, data, q[i], v[i], a[i])

    def from_joints() -> None:
        for i in range(FEW):
            loop.inverse_dynamics(q[i], v[i], a[i])

    def from_poses() -> None:
        near = None
        for i in range(FEW):
            state = complete_near(
                loop, target_of(few.pose[i], depth), few.velocity[i], few.acceleration[i], near
            )
            near = state.q
            loop.inverse_dynamics(state.q, state.v, state.a)

    yield calling(OTHERS, BARE, MACHINE, bare, MANY)
    if hasattr(pin, "rneaInParallel"):  # only where Pinocchio was built with OpenMP
        yield _in_parallel(robot.model, q, v, a)
    yield calling(OTHERS, SAMPLE_QVA, MACHINE, from_joints, FEW)
    yield calling(OTHERS, SAMPLE_POSE, MACHINE, from_poses, FEW)
    state = few.pose[7], few.velocity[7], few.acceleration[7]
    yield calling(OTHERS, SAMPLE_CALL, MACHINE, lambda: robot.forces(*state))
    yield calling(OTHERS, BATCH_QVA, MACHINE, lambda: loop.inverse_dynamics_batch(q, v, a), MANY)
    motion = many.pose, many.velocity, many.acceleration
    yield calling(OTHERS, BATCH_POSE, MACHINE, lambda: robot.forces(*motion), MANY)
    yield calling(OTHERS, EVIDENCE, MACHINE, lambda: robot.inverse_dynamics(many), MANY)


def _in_parallel(model: pin.Model, *joints: np.ndarray) -> Contender:
    pool = pin.ModelPool(model, 1)
    q, v, a = (np.asfortranarray(array.T) for array in joints)
    tau = np.zeros_like(v)
    return calling(OTHERS, PARALLEL, MACHINE, lambda: pin.rneaInParallel(1, pool, q, v, a, tau), MANY)


def other_engines() -> Iterator[Contender]:
    """The engines that are installed, each sample on its own, with loops and checks."""
    motion = p3dof.paper_motion(FEW // 4)
    for name in engines.ENGINES:
        if engines.available(name):
            yield _engine(name, motion)


def _engine(name: str, motion: p3dof.Motion) -> Contender:
    engine = engines.load(name)
    return calling(
        OTHERS, f"{name}, with loops and checks", MACHINE, lambda: engine.forces(motion), len(motion)
    )
