"""Random robots around one closure of each kind, and the same built otherwise."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import p3dof
from p3dof.loops import ClosedLoopModel, Closure, Sidecar
from p3dof.loops.sidecar import KINDS

ROD = 0.45
AXES = np.eye(3)


def solid(generator: np.random.Generator) -> pin.Inertia:
    A = generator.normal(size=(3, 3))
    return pin.Inertia(
        generator.uniform(0.5, 2), 0.2 * generator.normal(size=3), 0.02 * (A @ A.T + np.eye(3))
    )


def place(generator: np.random.Generator, size: float = 0.3) -> pin.SE3:
    return pin.SE3(pin.exp3(generator.normal(size=3)), size * generator.normal(size=3))


def closure(kind: str, frame1: str = "one", frame2: str = "two") -> Closure:
    return Closure(frame1, frame2, kind, ROD if kind == "distance" else None)


JOINTS = {
    "hinge": pin.JointModelRevoluteUnaligned,
    "slide": pin.JointModelPrismaticUnaligned,
    "circle": lambda _: pin.JointModelRUBZ(),
    "ball": lambda _: pin.JointModelSpherical(),
    "float": lambda _: pin.JointModelFreeFlyer(),
    "plane": lambda _: pin.JointModelPlanar(),
    "cross": lambda _: pin.JointModelUniversal(AXES[0], AXES[1]),
}


def tree(seed: int) -> pin.Model:
    """A floating body and two branches on it, of eleven joints of all kinds; frames on every body."""
    generator = np.random.default_rng(seed)
    model = pin.Model()
    kinds = ["float", *generator.permutation(["hinge", "circle", "slide", "ball", "plane", "cross"])]
    kinds += [*generator.permutation(["circle", "slide", "hinge", "circle"])]
    for i, kind in enumerate(kinds):
        axis = generator.normal(size=3)
        parent = 0 if i == 0 else 1 if i == 7 else i
        index = model.addJoint(
            parent, JOINTS[kind](axis / np.linalg.norm(axis)), place(generator), f"{kind}_{i}"
        )
        model.appendBodyToJoint(index, solid(generator), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"on_{i}", index, place(generator), pin.FrameType.OP_FRAME))
    return model


MASSLESS = {
    "hinge": [pin.JointModelRZ()],
    "slider": [pin.JointModelPZ()],
    "universal": [pin.JointModelRX(), pin.JointModelRY()],
    "cylindrical": [pin.JointModelPZ(), pin.JointModelRZ()],
    "planar": [pin.JointModelPX(), pin.JointModelPY(), pin.JointModelRZ()],
    "distance": [pin.JointModelRX(), pin.JointModelRY()],
}
"""Joints between frame 1 and a massless body that does what the closure lets frame 2 do."""


def spatial_loop(seed: int, massless: list[pin.JointModel], rod: float = 0.0) -> pin.Model:
    """A branch of two joints with frame `one`, massless joints behind it; an arm of seven with frame `two`.

    The massless body has the frame `end`, at the end of the rod.
    """
    generator, model = np.random.default_rng(seed), pin.Model()

    def add(parent: int, kind: str, name: str) -> int:
        axis = generator.normal(size=3)
        index = model.addJoint(parent, JOINTS[kind](axis / np.linalg.norm(axis)), place(generator), name)
        model.appendBodyToJoint(index, solid(generator), pin.SE3.Identity())
        return index

    base = add(add(0, "hinge", "branch_0"), "slide", "branch_1")
    M1 = place(generator)
    model.addFrame(pin.Frame("one", base, M1, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("one_up", base, M1 * pin.SE3(np.eye(3), 0.3 * AXES[2]), pin.FrameType.OP_FRAME))
    last, at = base, M1
    for i, joint in enumerate(massless):
        last, at = model.addJoint(last, joint, at, f"massless_{i}"), pin.SE3.Identity()
    model.addFrame(pin.Frame("end", last, at * pin.SE3(np.eye(3), rod * AXES[2]), pin.FrameType.OP_FRAME))
    parent = 0
    for i, kind in enumerate(["hinge", "hinge", "slide", "hinge", "hinge", "slide", "hinge"]):
        parent = add(parent, kind, f"arm_{i}")
    inner = model.getJointId("arm_5")
    model.addFrame(pin.Frame("inner", inner, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    M2 = place(generator)
    model.addFrame(pin.Frame("two", parent, M2, pin.FrameType.OP_FRAME))
    model.addFrame(
        pin.Frame("two_up", parent, M2 * pin.SE3(np.eye(3), 0.3 * AXES[2]), pin.FrameType.OP_FRAME)
    )
    return model


def common(model: pin.Model) -> list[int]:
    """Coordinates of all joints that are not massless; every joint has one."""
    names = [n for n in model.names[1:] if not n.startswith("massless")]
    return [model.idx_vs[model.getJointId(n)] for n in names]


def built_otherwise(kind: str, seed: int) -> tuple[ClosedLoopModel, ClosedLoopModel, np.ndarray]:
    """The machine with the closure, that with massless joints and a weld (a rod: a ball), and its q."""
    plain = spatial_loop(seed, [])
    other = spatial_loop(seed, MASSLESS[kind], ROD if kind == "distance" else 0.0)
    actuated = tuple(str(n) for n in plain.names[1:])[: plain.nv - KINDS[kind]]
    weld = Closure("end", "two", "3d" if kind == "distance" else "6d")
    loop = ClosedLoopModel(plain, Sidecar((closure(kind),), actuated))
    twin = ClosedLoopModel(other, Sidecar((weld,), actuated))
    generator = np.random.default_rng(seed)
    for _ in range(20):
        found = twin.assemble(guess=0.5 * generator.normal(size=other.nq))
        q = found.q[common(other)]
        N = np.linalg.svd(loop.closure_jacobian(q))[2][KINDS[kind] :]
        if np.linalg.svd(N[:, loop.actuated_v])[1].min() > 0.05:
            return loop, twin, found.q
    raise AssertionError("no configuration that is far from singular")


def universal_loop() -> tuple[ClosedLoopModel, np.ndarray]:
    """A closed loop over a universal joint, a composite one and a ball by three angles."""
    generator, model = np.random.default_rng(12), pin.Model()
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX())
    composite.addJoint(pin.JointModelUniversal(np.eye(3)[1], np.eye(3)[2]), place(generator))
    joints = {
        "arm": pin.JointModelRY(),
        "cross": pin.JointModelUniversal(np.eye(3)[0], np.eye(3)[1]),
        "several": composite,
        "ball": pin.JointModelSphericalZYX(),
        "slide": pin.JointModelPX(),
        "wrist": pin.JointModelRZ(),
    }
    last = 0
    for name, joint in joints.items():
        last = model.addJoint(last, joint, place(generator), name)
        model.appendBodyToJoint(last, solid(generator), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"on_{name}", last, place(generator), pin.FrameType.OP_FRAME))
    q = 0.4 * generator.normal(size=model.nq)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    ground = data.oMf[model.getFrameId("on_wrist")]
    model.addFrame(pin.Frame("ground", 0, ground, pin.FrameType.OP_FRAME))
    loop = ClosedLoopModel(
        model, Sidecar((p3dof.Closure("ground", "on_wrist", "hinge"),), ("arm", "slide", "wrist"))
    )
    return loop, q
