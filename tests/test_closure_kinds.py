"""Every kind of closure, and couplings: derivatives, the same machines built otherwise, many samples."""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest

from p3dof.closed_loop import ClosedLoopModel, Closure, Coupling, Sidecar
from p3dof.closed_loop.batch.closures import ClosureRows
from p3dof.closed_loop.batch.kinematics import Sweep
from p3dof.closed_loop.constraints import KINDS

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


# --- derivatives on trees with joints of all kinds ----------------------------------------------------------

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


def all_kinds(seed: int) -> tuple[ClosedLoopModel, np.ndarray]:
    """All kinds of closure between bodies of such a tree, one with the world, and couplings of its joints."""
    model, generator = tree(seed), np.random.default_rng(seed)
    named = {kind: [n for n in model.names if n.startswith(kind)] for kind in JOINTS}
    hinges, slides, circles = named["hinge"], named["slide"], named["circle"]
    couplings = (
        Coupling(hinges[0], hinges[1], (0.1, -0.5, 0.3, 0.2, -0.1)),
        Coupling(slides[0], circles[0], (0.1, -0.03)),
        Coupling(circles[1], circles[0], (0.3, -2 / 3)),
        Coupling(circles[2], slides[1], (0.2, 3.0, 0.5)),
        Coupling(slides[1], None, (0.15,)),
    )
    for _ in range(100):
        pairs = [generator.choice(11, 2, replace=False) for _ in KINDS]
        closures = [
            closure(kind, "universe" if i == seed % 8 else f"on_{first}", f"on_{second}")
            for i, (kind, (first, second)) in enumerate(zip(KINDS, pairs, strict=True))
        ]
        loop = ClosedLoopModel(model, Sidecar(closures, (), couplings))
        q = pin.integrate(model, pin.neutral(model), generator.normal(size=model.nv))
        turns = [open_turn(loop, c, q) for c in closures]
        away = np.abs(loop.closure_error(q)[-4:-1]) / (2 * np.pi * np.array([0.03, 1 / 3, 1]))
        if max(turns) < 2.9 and away.max() < 0.45:  # jumps at half a turn and between two are no rates
            return loop, q
    raise AssertionError("no configuration to test at")


def open_turn(loop: ClosedLoopModel, c: Closure, q: np.ndarray) -> float:
    model, data = loop.model, loop.model.createData()
    pin.framesForwardKinematics(model, data, q)
    M1, M2 = (data.oMf[model.getFrameId(name)] for name in (c.frame1, c.frame2))
    return float(np.linalg.norm(pin.log3(M1.rotation.T @ M2.rotation)))


@pytest.mark.parametrize("seed", range(12))
def test_jacobian_and_drift_of_every_kind_are_derivatives_where_the_loops_are_open(seed):
    loop, q = all_kinds(seed)
    model, k, generator = loop.model, loop._kinematics, np.random.default_rng(seed + 100)
    v, a = generator.normal(size=(2, model.nv))
    J = loop.closure_jacobian(q)

    def along(t: float) -> np.ndarray:
        return pin.integrate(model, q, t * v)

    rate, _ = robots.differences(lambda t: loop.closure_error(along(t)), h=1e-3)
    J_dot, _ = robots.differences(lambda t: loop.closure_jacobian(along(t)), h=1e-3)
    k.move(q, v)
    drift = k.acceleration()
    np.testing.assert_allclose(drift, J_dot @ v, rtol=0, atol=1e-9 * max(1.0, np.abs(drift).max()))
    k.move(q, v, a)
    np.testing.assert_allclose(k.acceleration(), drift + J @ a, rtol=0, atol=1e-12 * np.abs(drift).max())
    expected = J @ v
    rows = loop.constraint_rows[[c.kind for c in loop.sidecar.closures].index("6d")]
    M = pin.exp6(loop.closure_error(q)[rows])
    expected[rows] = pin.Jlog6(M) @ M.inverse().action @ expected[rows]  # J is the relative velocity itself
    np.testing.assert_allclose(expected, rate, rtol=0, atol=1e-9 * max(1.0, np.abs(rate).max()))


@pytest.mark.parametrize("seed", range(4))
def test_many_configurations_of_every_kind_are_each(seed):
    loop, q = all_kinds(seed)
    generator, k = np.random.default_rng(seed), loop._kinematics
    nv = loop.model.nv
    moved = np.array([pin.integrate(loop.model, q, 0.05 * dq) for dq in generator.normal(size=(9, nv))])
    v = generator.normal(size=(9, nv))
    sweep = Sweep(loop.model)
    rows = ClosureRows(k, sweep)
    samples = sweep.moving(moved, v)
    frames = rows.frames(samples)
    J, drift = rows.jacobian(moved, samples, frames), rows.drift(moved, samples, frames, v)
    errors = rows.errors(moved, frames)
    for i in range(9):
        point = k.at(moved[i])
        np.testing.assert_allclose(J[i], point.J, rtol=0, atol=1e-12)
        np.testing.assert_allclose(errors[i], point.error, rtol=0, atol=1e-12)
        k.move(moved[i], v[i])
        np.testing.assert_allclose(drift[i], k.acceleration(), rtol=0, atol=1e-12 * np.abs(drift[i]).max())
