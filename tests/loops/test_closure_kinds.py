"""Every kind of closure, and couplings: derivatives, the same machines built otherwise, many samples."""

from __future__ import annotations

import copy
import pickle

import closed_loop_robots as robots
import mpmath
import numpy as np
import pinocchio as pin
import pytest
from closure_robots import JOINTS, MASSLESS, ROD, built_otherwise, closure, common, solid, spatial_loop, tree
from scipy.integrate import solve_ivp

from p3dof._base.errors import InputError
from p3dof.loops import ClosedLoopModel, Closure, Coupling, FrameTargets, Sidecar
from p3dof.loops.batch.kinematics import ClosureRows, Sweep
from p3dof.loops.closure_kinds import _KINDS, PARTS, KindRows, _shortest
from p3dof.loops.reactions import loop_reactions
from p3dof.loops.sidecar import KINDS

# --- derivatives on trees with joints of all kinds ----------------------------------------------------------


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
        Coupling(slides[1], None, (0.15,), others=[(hinges[1], -0.3), (circles[0], 0.02)]),
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
        away = np.abs(loop.closure_error(q)[-4:]) / (2 * np.pi * np.array([0.03, 1 / 3, 1, 0.02]))
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
    model, k, generator = loop.model, loop._tree.kinematics, np.random.default_rng(seed + 100)
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


@pytest.mark.parametrize(
    "kinds", [("hinge", "planar"), ("hinge", "slider"), ("distance", "universal", "distance")]
)
def test_a_closure_is_the_same_whatever_kinds_are_beside_it(kinds):
    """Kinds of as many rows, or of others, are computed together."""
    every, q = all_kinds(5)
    names = [c.kind for c in every.sidecar.closures]
    some = [names.index(kind) for kind in kinds]
    loop = ClosedLoopModel(every.model, Sidecar([every.sidecar.closures[i] for i in some], ()))
    rows = np.concatenate([np.arange(every.closure_error(q).size)[every.constraint_rows[i]] for i in some])
    np.testing.assert_array_equal(loop.closure_error(q), every.closure_error(q)[rows])
    size = np.abs(every.closure_jacobian(q)).max()
    np.testing.assert_allclose(
        loop.closure_jacobian(q), every.closure_jacobian(q)[rows], rtol=0, atol=1e-14 * size
    )
    v, a = np.random.default_rng(3).normal(size=(2, every.model.nv))
    for one in (every, loop):
        one._tree.kinematics.move(q, v, a)
    drift = every._tree.kinematics.acceleration()[rows]
    np.testing.assert_allclose(
        loop._tree.kinematics.acceleration(), drift, rtol=0, atol=1e-14 * np.abs(drift).max()
    )


@pytest.mark.parametrize("seed", range(4))
def test_many_configurations_of_every_kind_are_each(seed):
    loop, q = all_kinds(seed)
    generator, k = np.random.default_rng(seed), loop._tree.kinematics
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


# --- the same machine built otherwise -----------------------------------------------------------------------


def motion_of(loop: ClosedLoopModel, q: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random motion of the closed loops, by differences of the Jacobian."""
    generator, J = np.random.default_rng(seed), loop.closure_jacobian(q)
    N = np.linalg.svd(J)[2][loop.rank(q) :].T
    v = N @ generator.normal(size=N.shape[1])
    J_dot, _ = robots.differences(
        lambda t: loop.closure_jacobian(pin.integrate(loop.model, q, t * v)), h=1e-3
    )
    return v, N @ generator.normal(size=N.shape[1]) - np.linalg.pinv(J, rcond=1e-9) @ (J_dot @ v)


def wrench_on_frame_2(loop: ClosedLoopModel, kind: str, q: np.ndarray, lambda_: np.ndarray) -> np.ndarray:
    """Force and moment at the origin of frame 2 in world axes, as the multipliers' documentation says."""
    model, data = loop.model, loop.model.createData()
    pin.framesForwardKinematics(model, data, q)
    M1, M2 = (data.oMf[model.getFrameId(name)] for name in ("one", "two"))
    x1, y1, z1 = M1.rotation.T
    d = M2.translation - M1.translation
    force, moment = {
        "hinge": ([x1, y1, z1], [x1, y1]),
        "slider": ([x1, y1], [x1, y1, z1]),
        "universal": ([x1, y1, z1], [np.cross(x1, M2.rotation[:, 1])]),
        "cylindrical": ([x1, y1], [x1, y1]),
        "planar": ([z1], [x1, y1]),
        "distance": ([d / np.linalg.norm(d)], np.zeros((0, 3))),
    }[kind]
    split = len(force)
    return np.concatenate((lambda_[:split] @ np.array(force), lambda_[split:] @ np.array(moment)))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", MASSLESS)
def test_a_closure_is_its_massless_joints_and_a_weld(kind, seed):
    loop, twin, q2 = built_otherwise(kind, seed)
    at = common(twin.model)
    q = q2[at]
    assert np.abs(loop.closure_error(q)).max() < 1e-12
    assert (loop.rank(q), loop.mobility(q)) == (KINDS[kind], twin.mobility(q2))
    v2, a2 = motion_of(twin, q2, seed)
    v, a = v2[at], a2[at]
    load = {"two": np.arange(1.0, 7.0)}
    given, expected = loop.inverse_dynamics(q, v, a, load), twin.inverse_dynamics(q2, v2, a2, load)
    scale = np.abs(expected.tau).max() + np.abs(expected.lambda_).max()
    np.testing.assert_allclose(given.tau, expected.tau, rtol=0, atol=1e-10 * scale)
    assert given.unique.all()
    assert given.residual < 1e-12 * scale
    # What acts on frame 2 is that of the weld, which is in the axes of the massless body.
    data = twin.model.createData()
    pin.framesForwardKinematics(twin.model, data, q2)
    axes = data.oMf[twin.model.getFrameId("end")].rotation
    weld = np.concatenate([axes @ part for part in expected.lambda_.reshape(-1, 3)])
    weld = np.append(weld, np.zeros(6 - len(weld)))
    wrench = wrench_on_frame_2(loop, kind, q, given.lambda_)
    np.testing.assert_allclose(wrench, weld, rtol=0, atol=1e-10 * scale)
    moved, also = (m.forward_dynamics(*s, given.tau, load) for m, s in ((loop, (q, v)), (twin, (q2, v2))))
    np.testing.assert_allclose(moved.a, also.a[at], rtol=0, atol=1e-10 * np.abs(also.a).max())
    np.testing.assert_allclose(moved.a, a, rtol=0, atol=1e-9 * np.abs(a).max())
    np.testing.assert_allclose(moved.lambda_, given.lambda_, rtol=0, atol=1e-9 * scale)
    assert loop.power(q, v, a) == pytest.approx(
        given.tau @ v[loop.actuated_v] + loop._tree.force((load, None)) @ v, rel=1e-9
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_hinge_is_two_points_on_its_axis(seed):
    loop, _, q2 = built_otherwise("hinge", seed)
    q = q2[common(spatial_loop(seed, MASSLESS["hinge"]))]
    points = (Closure("one", "two"), Closure("one_up", "two_up"))
    twin = ClosedLoopModel(loop.model, Sidecar(points, loop.actuated))
    twice = ClosedLoopModel(loop.model, Sidecar((*loop.sidecar.closures * 2, points[0]), loop.actuated))
    v, a = motion_of(loop, q, seed)
    tau = loop.inverse_dynamics(q, v, a).tau
    for other in (twin, twice):  # redundant: six rows of rank five, thirteen of rank five
        assert (other.rank(q), other.mobility(q)) == (5, 4)
        result = other.inverse_dynamics(q, v, a)
        np.testing.assert_allclose(result.tau, tau, rtol=0, atol=1e-10 * np.abs(tau).max())
        assert not result.unique.all()
        moved = other.forward_dynamics(q, v, tau)
        np.testing.assert_allclose(moved.a, a, rtol=0, atol=1e-10 * np.abs(a).max())


# --- what else the layer does with them ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", MASSLESS)
def test_many_motions_are_each(kind, monkeypatch):
    """By the algebra of arrays: no sample is left to the methods for single ones."""
    loop, twin, q2 = built_otherwise(kind, 1)
    q = q2[common(twin.model)]
    generator, n = np.random.default_rng(0), len(loop.actuated)
    target = q[loop.actuated_v] + 0.05 * generator.uniform(-1, 1, (12, n))
    velocity, acceleration = generator.normal(size=(2, 12, n))
    with monkeypatch.context() as alone:
        for name in ("complete", "inverse_dynamics"):
            alone.setattr(ClosedLoopModel, name, None)
        states = loop.complete_batch(target, velocity, acceleration, guess=q)
        forces = loop.inverse_dynamics_batch(states.q, states.v, states.a)
    assert not states.errors
    assert not forces.errors
    for i in range(12):
        state = loop.complete(target[i], velocity[i], acceleration[i], guess=q)
        for name in ("q", "v", "a"):
            value = getattr(state, name)
            np.testing.assert_allclose(
                getattr(states, name)[i], value, rtol=0, atol=1e-10 * np.abs(value).max()
            )
        one = loop.inverse_dynamics(states.q[i], states.v[i], states.a[i])
        np.testing.assert_allclose(forces.tau[i], one.tau, rtol=0, atol=1e-12 * np.abs(one.tau).max() * 10)
        assert forces.conditioning[i] == pytest.approx(one.conditioning, rel=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_many_placements_of_a_frame_are_each(seed, monkeypatch):
    loop, twin, q2 = built_otherwise("planar", seed)  # the placement of one body tells all joints
    q = q2[common(twin.model)]
    generator, data = np.random.default_rng(0), loop.model.createData()
    moved = [loop.assemble(guess=q + 0.02 * dq).q for dq in generator.normal(size=(10, loop.model.nq))]
    places = []
    for row in moved:
        pin.framesForwardKinematics(loop.model, data, row)
        places.append(pin.SE3(data.oMf[loop.model.getFrameId("inner")]))
    target = FrameTargets("inner", [M.translation for M in places], [M.rotation for M in places])
    velocity, acceleration = generator.normal(size=(2, 10, 6))
    with monkeypatch.context() as alone:
        alone.setattr(ClosedLoopModel, "complete", None)
        states = loop.complete_batch(target, velocity, acceleration, guess=q)
    assert not states.errors
    np.testing.assert_allclose(states.q, moved, rtol=0, atol=1e-9)
    for i in range(10):
        state = loop.complete(target[i], velocity[i], acceleration[i], guess=q)
        for name in ("q", "v", "a"):
            value = getattr(state, name)
            np.testing.assert_allclose(
                getattr(states, name)[i], value, rtol=0, atol=1e-9 * np.abs(value).max()
            )


def test_many_powers_are_each_with_joints_of_all_kinds():
    """A universal joint's own axes turn within it, which is in no matrix of Pinocchio's."""
    loop, q = all_kinds(0)
    generator, nv = np.random.default_rng(0), loop.model.nv
    moved = np.array([pin.integrate(loop.model, q, dq) for dq in generator.normal(size=(9, nv))])
    v, a = generator.normal(size=(2, 9, nv))
    expected = [loop.power(*row) for row in zip(moved, v, a, strict=True)]
    np.testing.assert_allclose(loop.power_batch(moved, v, a), expected, rtol=1e-11)


@pytest.mark.parametrize("kind", MASSLESS)
def test_gaps_follow_their_equation(kind):
    """With β, closures that are a little open and opening obey ë + 2β ė + β² e = 0, whatever their kind."""
    loop, twin, q2 = built_otherwise(kind, 0)
    generator, beta = np.random.default_rng(0), 30.0
    q = q2[common(twin.model)] + 1e-4 * generator.normal(size=loop.model.nq)
    v = motion_of(loop, q, 0)[0] + 1e-3 * generator.normal(size=loop.model.nv)
    a = loop.forward_dynamics(q, v, np.ones(len(loop.actuated)), stabilisation=beta).a
    along = lambda t: loop.closure_error(q + t * v + t**2 / 2 * a)  # noqa: E731
    e, (e_dot, e_ddot) = loop.closure_error(q), robots.differences(along)
    assert 1e-5 < np.abs(e).max() < 1e-3
    np.testing.assert_allclose(e_ddot, -2 * beta * e_dot - beta**2 * e, rtol=0, atol=1e-8)


@pytest.mark.parametrize("kind", MASSLESS)
def test_a_machine_let_go_keeps_its_energy_and_its_closure(kind):
    loop, twin, q2 = built_otherwise(kind, 0)
    free = ClosedLoopModel(loop.model, Sidecar(loop.sidecar.closures, ()))
    model, data, n = free.model, loop.model.createData(), loop.model.nv
    q = q2[common(twin.model)]
    start = np.concatenate((q, 0.3 * motion_of(free, q, 0)[0]))

    def rate(_t: float, state: np.ndarray) -> np.ndarray:
        found = free.forward_dynamics(state[:n], state[n:], [], stabilisation=20.0)
        return np.concatenate((state[n:], found.a))

    run = solve_ivp(rate, (0, 0.3), start, method="DOP853", rtol=1e-9, atol=1e-10)
    kinetic = np.array([pin.computeKineticEnergy(model, data, x[:n], x[n:]) for x in run.y.T])
    total = kinetic + [pin.computePotentialEnergy(model, data, x[:n]) for x in run.y.T]
    assert np.ptp(kinetic) > 1.0
    assert np.ptp(total) < 1e-9 * kinetic.max()
    assert max(np.abs(free.closure_error(x[:n])).max() for x in run.y.T) < 1e-10


@pytest.mark.parametrize("kind", ["hinge", "cylindrical", "planar"])
def test_parallel_axes_have_the_same_sense(kind):
    """A body that hangs upside down at its hinge is not assembled, and is turned round."""
    model = pin.Model()
    ball = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    model.appendBodyToJoint(ball, solid(np.random.default_rng(0)), pin.SE3.Identity())
    model.addFrame(pin.Frame("two", ball, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    loop = ClosedLoopModel(model, Sidecar((closure(kind, "universe"),), ()))
    down = pin.SE3ToXYZQUAT(pin.SE3(pin.rpy.rpyToMatrix(np.pi - 0.1, 0, 0), np.zeros(3)))
    assert np.abs(loop.closure_error(down)).max() == pytest.approx(np.pi - 0.1)
    found = loop.assemble(guess=down)
    assert pin.XYZQUATToSE3(found.q).rotation[:, 2] == pytest.approx([0, 0, 1], abs=1e-12)
    exactly = pin.SE3ToXYZQUAT(pin.SE3(np.diag([1.0, -1, -1]), np.zeros(3)))
    assert np.abs(loop.closure_error(exactly)).max() == pytest.approx(np.pi)  # open, and it goes some way:
    assert loop.closure_jacobian(exactly)[-2:, 3:] == pytest.approx(
        np.array([[1, 0, 0], [0, -1, 0]]), abs=1e-12
    )
    found = loop.assemble(guess=exactly)
    assert pin.XYZQUATToSE3(found.q).rotation[:, 2] == pytest.approx([0, 0, 1], abs=1e-12)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("kind", MASSLESS)
def test_reactions_are_those_of_the_machine_with_massless_joints(kind, seed):
    loop, twin, q2 = built_otherwise(kind, seed)
    at = common(twin.model)
    v2, a2 = motion_of(twin, q2, seed)
    q, v, a = q2[at], v2[at], a2[at]
    tau = loop.inverse_dynamics(q, v, a).tau
    given, expected = loop_reactions(loop, q, v, a, tau), loop_reactions(twin, q2, v2, a2, tau)
    assert given.undetermined == 0
    names = [name for name in given.names if name in expected.names]
    assert len(names) == 9  # the joints of both trees
    mine, theirs = ([r.names.index(name) for name in names] for r in (given, expected))
    for part in ("forces", "moments"):
        ours, others = getattr(given, part)[mine], getattr(expected, part)[theirs]
        np.testing.assert_allclose(ours, others, rtol=0, atol=1e-9 * np.abs(given.forces).max())


def test_redundant_kinds_leave_their_reactions_open():
    loop, twin, q2 = built_otherwise("hinge", 0)
    q = q2[common(twin.model)]
    v, a = motion_of(loop, q, 0)
    twice = ClosedLoopModel(loop.model, Sidecar(loop.sidecar.closures * 2, loop.actuated))
    tau = loop.inverse_dynamics(q, v, a).tau
    one, two = loop_reactions(loop, q, v, a, tau), loop_reactions(twice, q, v, a, tau)
    assert (one.undetermined, two.undetermined) == (0, 5)
    np.testing.assert_allclose(two.forces[-1] + two.forces[-2], one.forces[-1], rtol=0, atol=1e-9)
    assert two.determined_forces[:-2].all()
    assert not two.determined_forces[-2:].any()


@pytest.mark.parametrize("kind", MASSLESS)
def test_copies_and_pickles_are_the_model(kind):
    loop, twin, q2 = built_otherwise(kind, 0)
    q = q2[common(twin.model)] + 0.1
    for other in (loop.copy(), pickle.loads(pickle.dumps(loop)), copy.deepcopy(loop)):  # noqa: S301
        assert np.array_equal(other.closure_error(q), loop.closure_error(q))
        assert np.array_equal(other.closure_jacobian(q), loop.closure_jacobian(q))


def test_pinocchio_has_points_and_frames_only():
    loop, _ = all_kinds(0)
    names = [model.shortname() for model in loop.constraint_models]
    assert names == ["PointAnchorConstraintModel", "FrameAnchorConstraintModel"]
    sizes = [rows.stop - rows.start for rows in loop.constraint_rows]
    assert sizes == [*KINDS.values(), 1, 1, 1, 1, 1]


def test_a_rod_whose_ends_coincide_finds_its_way():
    """There is no direction then; the rod takes one."""
    model = pin.Model()
    for i in range(3):
        joint = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)[i]()
        model.addJoint(i, joint, pin.SE3.Identity(), f"slide_{i}")
    model.appendBodyToJoint(3, solid(np.random.default_rng(0)), pin.SE3.Identity())
    model.addFrame(pin.Frame("two", 3, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    loop = ClosedLoopModel(model, Sidecar((closure("distance", "universe"),), ()))
    found = loop.assemble()
    assert np.linalg.norm(found.q) == pytest.approx(ROD, abs=1e-12)
    with pytest.raises(InputError, match="q: the closure universe/two is open by"):
        loop.inverse_dynamics([0.5, 0, 0], np.zeros(3), np.zeros(3))
    # Ends that part along this direction, x = 2 t + 3 t²/2, are x from each other from the beginning.
    for x in (0.0, 0.1):
        place = np.array([x, 0, 0])
        assert loop.closure_jacobian(place).tolist() == [[1, 0, 0]]
        loop._tree.kinematics.move(place, np.array([2.0, 0, 0]), np.array([3.0, 0, 0]))
        assert loop._tree.kinematics.acceleration().tolist() == [3]


def test_each_closure_and_coupling_has_one_gap():
    loop, q = all_kinds(0)
    error, gaps = loop.closure_error(q), loop.closure_gaps(q)
    parts = [(3,), (3, 3), (3, 2), (2, 3), (3, 1), (2, 2), (1, 2), (1,), *[(1,)] * 5]
    start, expected = 0, []
    for sizes in parts:
        sums = []
        for size in sizes:
            sums.append(np.linalg.norm(error[start : start + size]))
            start += size
        expected.append(max(sums))
    assert start == len(error)
    assert gaps == pytest.approx(expected, rel=1e-14)
    model = robots.arm_model()
    assert ClosedLoopModel(model, Sidecar.serial(model)).closure_gaps(pin.neutral(model)).shape == (0,)


@pytest.mark.parametrize("kind", sorted(PARTS))
@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 9e-3, 1.1e-2, 0.03, 0.3, 1.0, 2.5])
def test_plain_numbers_and_arrays_give_the_same(kind, size):
    """A single sample and a batch, where closures are closed, a little open, and far from closed."""
    rng = np.random.default_rng(7)
    length = 0.4 if kind == "distance" else None
    one = Closure("one", "other", kind, length)
    for _ in range(5):
        d = rng.normal(size=3) * (1.0 if kind == "distance" else max(size, 1e-12))
        turn = size * rng.normal(size=3) / np.sqrt(3)
        E = pin.exp3(turn)
        V, omega, a, alpha = rng.normal(size=(4, 3))
        (group,) = KindRows([one], [slice(0, one.rows)]).at(d[None], E[None], pin.log3(E)[None])
        rows = one.rows
        errors, J, drift = np.zeros(rows), np.zeros((rows, 6)), np.zeros(rows)
        shift = np.eye(6)
        shift[:3, 3:] = -pin.skew(d)  # ḋ = V + ω × d
        group.errors(errors)
        group.jacobian(shift[None], J)
        d_dot = V + np.cross(omega, d)
        d_ddot = a + np.cross(alpha, d) + np.cross(omega, d_dot)
        group.drift(np.array([[*d_dot, *omega]]), np.array([[*d_ddot, *alpha]]), drift)
        plain, found, matrix, bias = _KINDS[kind](length or 0.0), [], [], []
        plain.evaluate(tuple(d.tolist()), E.tolist(), found, matrix)
        plain.bias(tuple(d_dot), tuple(omega), tuple(np.cross(omega, d_dot)), bias)
        A = np.reshape(matrix, (rows, 6))
        np.testing.assert_allclose(found, errors, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(A, J, rtol=0, atol=1e-11)
        np.testing.assert_allclose(A @ [*a, *alpha] + bias, drift, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("y", [0.0, 1e-9, 3e-6, 1e-5, 8e-5, 9.9e-5, 1.1e-4, 1e-3, 4e-3, 0.02, 0.3, 0.9])
def test_how_far_a_body_is_turned_has_the_derivatives_of_the_closed_form(y):
    """Its angle by the sine, g = φ / sin φ, over the cosine, with thirty digits more."""
    cosine = 1.0 - 2.0 * y
    with mpmath.workdps(50):
        at = mpmath.mpf(cosine)
        expected = [mpmath.mpf(1), -mpmath.mpf(1) / 3, mpmath.mpf(4) / 15]
        if at < 1:
            expected = mpmath.taylor(lambda c: mpmath.acos(c) / mpmath.sqrt(1 - c * c), at, 2)
            expected[2] *= 2
        found = _shortest(cosine)
        allowed = 2e-15 if y < 0.05 else 2e-14  # beyond, the closed form loses a digit where it begins
        for number, exact in zip(found, expected, strict=True):
            assert abs(number - exact) <= allowed * abs(exact)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 9.9e-3, 0.0101, 0.5, 3.0])
def test_rates_of_a_rotation_vector_have_sixteen_digits(angle):
    """The inverse of the left Jacobian of SO(3) in fifty digits, on both sides of where the series ends."""
    turn = angle * np.array([0.6, -0.48, 0.64])
    slider, errors, rows = object.__new__(_KINDS["slider"]), [], []
    slider.rotation(pin.exp3(turn).tolist(), errors, rows)
    with mpmath.workdps(50):
        x, y, z = (mpmath.mpf(float(value)) for value in errors)
        across = mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        inverse = mpmath.eye(3)
        if angle:
            size = mpmath.sqrt(x * x + y * y + z * z)
            factor = 1 / size**2 - (1 + mpmath.cos(size)) / (2 * size * mpmath.sin(size))
            inverse += across * across * factor
        inverse -= across / 2
        expected = np.array(inverse.tolist(), dtype=float)
    found = np.reshape(rows, (3, 6))[:, 3:]
    np.testing.assert_allclose(found, expected, rtol=0, atol=4e-16 if angle < 0.01 else 1e-12)
