"""Random robots with loops of every kind of joint, closure and coupling, closed where it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.errors import AssemblyError
from p3dof.loops import ClosedLoopModel, Closure, Coupling, JointData, Sidecar

ONE_FREEDOM = (
    lambda _: pin.JointModelRX(),
    lambda _: pin.JointModelRZ(),
    lambda _: pin.JointModelRUBY(),
    lambda _: pin.JointModelPY(),
    lambda rng: pin.JointModelRevoluteUnaligned(unit(rng)),
    lambda rng: pin.JointModelPrismaticUnaligned(unit(rng)),
    lambda rng: pin.JointModelHelicalUnaligned(unit(rng), 0.1),
)
SEVERAL = (
    lambda _: pin.JointModelSpherical(),
    lambda _: pin.JointModelFreeFlyer(),
    lambda _: pin.JointModelPlanar(),
    lambda _: pin.JointModelTranslation(),
    lambda _: pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0, 1.0, 0])),
    lambda _: pin.JointModelSphericalZYX(),
)
KINDS = ("3d", "6d", "hinge", "slider", "universal", "cylindrical", "planar", "distance")


def unit(rng: np.random.Generator) -> np.ndarray:
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def placement(rng: np.random.Generator) -> pin.SE3:
    return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(0, 0.3, 3))


def inertia(rng: np.random.Generator) -> pin.Inertia:
    points = rng.normal(0, 0.1, (5, 3))
    about = sum((p @ p) * np.eye(3) - np.outer(p, p) for p in points)
    return pin.Inertia(rng.uniform(0.5, 2), rng.normal(0, 0.1, 3), about)


@dataclass
class Closed:
    """A robot, and closed configurations of it with motions that keep its loops closed."""

    loop: ClosedLoopModel
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def random_tree(rng: np.random.Generator, joints: int, several: float) -> pin.Model:
    model, path = pin.Model(), [0]
    for i in range(joints):
        kinds = SEVERAL if rng.random() < several else ONE_FREEDOM
        while len(path) > 1 and rng.random() < 0.4:
            path.pop()
        joint = model.addJoint(path[-1], kinds[rng.integers(len(kinds))](rng), placement(rng), f"joint{i}")
        model.appendBodyToJoint(joint, inertia(rng), pin.SE3.Identity())
        model.addJointFrame(joint)
        path.append(joint)
    model.armature = rng.uniform(0, 0.1, model.nv) * (rng.random(model.nv) < 0.3)
    return model


def closures(model: pin.Model, q: np.ndarray, rng: np.random.Generator, count: int) -> list[Closure]:
    """Closures between random bodies, whose frames meet at a configuration."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    found = []
    for number in range(count):
        one, two = rng.choice(model.njoints, 2, replace=False).tolist()
        kind = KINDS[rng.integers(len(KINDS))]
        here = placement(rng)
        there = data.oMi[two].actInv(data.oMi[one] * here)
        if kind == "distance":
            there = pin.SE3(there.rotation, there.translation + 0.3 * unit(rng))
            gap = data.oMi[two].act(there.translation) - data.oMi[one].act(here.translation)
        for name, joint, place in ((f"end{number}_1", one, here), (f"end{number}_2", two, there)):
            above = 0 if joint == 0 else model.getFrameId(str(model.names[joint]))
            model.addFrame(pin.Frame(name, joint, above, place, pin.FrameType.OP_FRAME))
        length = float(np.linalg.norm(gap)) if kind == "distance" else None
        found.append(Closure(f"end{number}_1", f"end{number}_2", kind, length))
    return found


def random_robot(seed: int, joints: int = 6, loops: int = 2, several: float = 0.25) -> ClosedLoopModel | None:
    """A random robot that can move and whose motors are independent; None if it did not come out."""
    rng = np.random.default_rng(seed)
    model = random_tree(rng, joints, several)
    q = pin.integrate(model, pin.neutral(model), rng.normal(0, 0.5, model.nv))
    chosen = closures(model, q, rng, loops)
    singles = [i for i in range(1, model.njoints) if model.nvs[i] == 1 and model.nqs[i] == 1]
    couplings, reference = (
        [],
        {
            str(model.names[i]): (
                np.arctan2(q[model.idx_qs[i] + 1], q[model.idx_qs[i]])
                if model.nvs[i] == 1 and model.nqs[i] == 2
                else q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]]
            )
            for i in range(1, model.njoints)
        },
    )
    if len(singles) > 2 and rng.random() < 0.5:
        follower, leader = (int(i) for i in rng.choice(singles, 2, replace=False))
        slopes = rng.normal(0, 0.5, rng.integers(1, 3))
        on = q[model.idx_qs[leader]]
        rest = q[model.idx_qs[follower]] - sum(c * on ** (k + 1) for k, c in enumerate(slopes))
        names = str(model.names[follower]), str(model.names[leader])
        couplings.append(Coupling(*names, (float(rest), *slopes.tolist())))
    sidecar = Sidecar(tuple(chosen), (), tuple(couplings), reference=reference)
    passive = ClosedLoopModel(model, sidecar)
    try:
        mobility = passive.mobility(passive.assemble().q)
    except AssemblyError:
        return None
    data = [
        JointData(str(model.names[i]), *rng.uniform(0, 1, 4).tolist())
        for i in range(1, model.njoints)
        if model.nvs[i] == 1 and rng.random() < 0.3
    ]
    names = [str(model.names[i]) for i in range(1, model.njoints) if model.nvs[i] == 1]
    rng.shuffle(names)
    if not mobility or not names:
        return None
    # As many independent motors as there are, at most the mobility: a motor that adds nothing is left out.
    J, motors = passive.closure_jacobian(passive.assemble().q), []
    basis = np.linalg.svd(J)[2][passive.rank(passive.assemble().q) :] if J.size else np.eye(model.nv)
    for name in names:
        rows = basis[:, [model.idx_vs[model.getJointId(n)] for n in (*motors, name)]]
        if np.linalg.svd(rows, compute_uv=False)[-1] > 0.05 and len(rows) >= rows.shape[1]:
            motors.append(name)
    if not motors:
        return None
    return ClosedLoopModel(
        model,
        Sidecar(tuple(chosen), tuple(motors), tuple(couplings), reference=reference, joint_data=tuple(data)),
    )


def motions(loop: ClosedLoopModel, count: int, seed: int, spread: float = 0.3) -> Closed:
    """Random motions that keep the loops closed, around the reference."""
    rng, rows = np.random.default_rng(seed), []
    q0 = loop.assemble().q
    while len(rows) < count:
        base = q0 if not rows else rows[-1][0]
        N = free(loop, base)
        shift = N @ rng.normal(size=N.shape[1])
        shift *= spread * rng.random() / np.abs(shift).max(initial=1e-9)
        try:
            q = np.array(loop.assemble(None, guess=pin.integrate(loop.model, base, shift)).q)
        except AssemblyError:
            rows.append(
                (q0, *rows[-1][1:]) if rows else (q0, np.zeros(loop.model.nv), np.zeros(loop.model.nv))
            )
            continue
        N = free(loop, q)
        v = N @ rng.normal(size=N.shape[1])
        a = N @ rng.normal(size=N.shape[1]) - drift(loop, q, v)
        rows.append((q, v, a))
    return Closed(loop, *(np.array(column) for column in zip(*rows, strict=True)))


def free(loop: ClosedLoopModel, q: np.ndarray) -> np.ndarray:
    """Basis of the free motions."""
    J = loop.closure_jacobian(q)
    return np.linalg.svd(J)[2][loop.rank(q) :].T if J.size else np.eye(loop.model.nv)


def drift(loop: ClosedLoopModel, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The shortest J⁺ J̇ v, by the general layer's own kinematics."""
    J = loop.closure_jacobian(q)
    if not J.size:
        return np.zeros(loop.model.nv)
    loop._tree.kinematics.move(q, v)
    return np.linalg.lstsq(J, loop._tree.kinematics.acceleration(), rcond=1e-9)[0]
