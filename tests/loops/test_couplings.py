"""Couplings of joints, locked joints, the reference configuration, and machines of any size with them."""

from __future__ import annotations

import copy
import pickle

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import FOUR_BAR, FOUR_BAR_SIDECAR

from p3dof._base.errors import AssemblyError, InputError, ModelError
from p3dof.loops import ClosedLoopModel, Closure, Coupling, Sidecar
from p3dof.loops.reactions import loop_reactions

G, M2, ARM2 = 9.81, 1.7, 0.23
I1, I2 = 0.04, 0.11  # about the axes


def pair(
    first: pin.JointModel, second: pin.JointModel, coefficients, actuated=("one",), on="one"
) -> ClosedLoopModel:
    """Two bodies on the ground: `one` is balanced about its axis y, `two` has its mass centre on an arm."""
    model = pin.Model()
    for parent, joint, name in ((0, first, "one"), (0, second, "two")):
        model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array([0.3, 0, 0])), name)
    model.appendBodyToJoint(1, pin.Inertia(1.1, np.zeros(3), I1 * np.eye(3)), pin.SE3.Identity())
    about_centre = (I2 - M2 * ARM2**2) * np.eye(3)
    model.appendBodyToJoint(2, pin.Inertia(M2, np.array([ARM2, 0, 0]), about_centre), pin.SE3.Identity())
    return ClosedLoopModel(model, Sidecar((), actuated, (Coupling("two", on, coefficients),)))


def configuration(loop: ClosedLoopModel, *values: float) -> np.ndarray:
    """Values of the joints, angles for continuous ones."""
    parts = [
        [np.cos(x), np.sin(x)] if nq == 2 else [x]
        for x, nq in zip(values, list(loop.model.nqs)[1:], strict=True)
    ]
    return np.concatenate(parts)


HINGES = {"revolute": pin.JointModelRY, "continuous": pin.JointModelRUBY}


@pytest.mark.parametrize("kinds", [("revolute",) * 2, ("continuous",) * 2, ("continuous", "revolute")])
@pytest.mark.parametrize("ratio", [-1.5, 2.0, 1 / 3])
def test_geared_hinges_have_their_closed_form(kinds, ratio):
    """(I1 + r² I2) a = τ + r m g l cos(q2), and the force of the gear is I2 a2 - m g l cos(q2)."""
    loop = pair(HINGES[kinds[0]](), HINGES[kinds[1]](), (0.3, ratio))
    rate, torque = 2.3, 0.7
    for angle in (0.4, -2.9, 3.0):
        q2 = 0.3 + ratio * angle
        q, v = configuration(loop, angle, q2), np.array([1.0, ratio]) * rate
        assert np.abs(loop.closure_error(q)).max() < 1e-14
        weight = M2 * G * ARM2 * np.cos(q2)  # about y, which turns x down
        a = (torque + ratio * weight) / (I1 + ratio**2 * I2)
        found = loop.forward_dynamics(q, v, [torque])
        assert found.a == pytest.approx([a, ratio * a], rel=1e-12)
        assert found.lambda_ == pytest.approx([I2 * ratio * a - weight], rel=1e-11)
        result = loop.inverse_dynamics(q, v, found.a)
        assert result.tau == pytest.approx([torque], rel=1e-11)
        assert result.lambda_ == pytest.approx(found.lambda_, rel=1e-11)
        assert (result.rank, result.mobility, bool(result.unique.all())) == (1, 1, True)
        assert loop.power(q, v, found.a) == pytest.approx(torque * rate, rel=1e-11)


def test_a_cam_has_its_closed_form():
    """A slide that follows a polynomial of the angle: m (p' a + p'' ω²) + m g = λ, τ = I a + p' λ."""
    c = (0.1, -0.2, 0.3, 0.05, -0.08)
    p, (first, second) = np.polynomial.Polynomial(c), (np.polynomial.Polynomial(c).deriv(k) for k in (1, 2))
    loop = pair(pin.JointModelRY(), pin.JointModelPZ(), c)
    x, rate, a = 0.8, -1.9, 3.1
    state = loop.complete([x], [rate], [a], guess=[x, p(x) + 0.01])
    assert state.q == pytest.approx([x, p(x)], abs=1e-14)
    assert state.v == pytest.approx([rate, first(x) * rate], rel=1e-13)
    follows = first(x) * a + second(x) * rate**2
    assert state.a == pytest.approx([a, follows], rel=1e-13)
    force = M2 * (follows + G)
    result = loop.inverse_dynamics(state.q, state.v, state.a)
    assert result.lambda_ == pytest.approx([force], rel=1e-12)
    assert result.tau == pytest.approx([I1 * a + first(x) * force], rel=1e-12)
    reactions = loop_reactions(loop, state.q, state.v, state.a, result.tau)
    assert reactions.forces[1, 2] == pytest.approx(force, rel=1e-12)  # along the slide, the cam's
    assert reactions.moments[0, 1] == pytest.approx(I1 * a, rel=1e-12)  # the motor's, less the cam's
    assert reactions.undetermined == 0


def test_a_locked_joint_stays_where_it_is():
    loop = pair(pin.JointModelRUBY(), pin.JointModelRUBY(), (0.7,), on=None)
    state = loop.complete([3.0], [1.0], [2.0])
    assert loop.mobility(state.q) == 1
    assert state.q == pytest.approx(configuration(loop, 3.0, 0.7), abs=1e-13)
    assert state.v == pytest.approx([1, 0], abs=1e-14)
    result = loop.inverse_dynamics(state.q, state.v, state.a)
    assert result.tau == pytest.approx([I1 * 2.0], rel=1e-12)
    assert result.lambda_ == pytest.approx([-M2 * G * ARM2 * np.cos(0.7)], rel=1e-12)


@pytest.mark.parametrize(
    ("first", "second", "coefficients", "period"),
    [
        ("continuous", "continuous", (0.2, 1.0), 2 * np.pi),
        ("continuous", "continuous", (0.2, -1.0), 2 * np.pi),
        ("continuous", "continuous", (0.2, 3.0), 2 * np.pi),
        ("continuous", "continuous", (0.2, 20 / 33), 2 * np.pi / 33),
        ("continuous", "revolute", (0.2, 0.37), 2 * np.pi * 0.37),
        ("revolute", "continuous", (0.2, 0.37, 1.1), 2 * np.pi),
        ("continuous", "continuous", (0.2,), 2 * np.pi),
        ("continuous", "revolute", (0.2, 0.0, 0.0), None),
        ("revolute", "revolute", (0.2, 1.0), None),
    ],
)
def test_errors_of_continuous_joints_are_continuous(first, second, coefficients, period):
    """Along several turns, held by the coupling: no whole turn counts as an error, and small ones stay."""
    loop = pair(HINGES[first](), HINGES[second](), coefficients)
    p = np.polynomial.Polynomial(coefficients)
    for angle in np.linspace(-20, 20, 401):
        q = configuration(loop, angle, p(angle) + 0.01)
        assert loop.closure_error(q) == pytest.approx([0.01], abs=1e-12)
    half = configuration(loop, 0.0, 0.2 + 100.0)
    wrapped = 100.0 if period is None else 100.0 - period * np.round(100.0 / period)
    assert loop.closure_error(half) == pytest.approx([wrapped], abs=1e-10)


def test_a_differential_has_its_closed_form():
    """ring = (left + right)/2: its force goes half and half into both; turns of all three are not counted."""
    model, inertias = pin.Model(), (0.03, 0.05, 0.2)
    for i, (name, joint) in enumerate(zip(("left", "right", "ring"), [pin.JointModelRUBX] * 3, strict=True)):
        model.addJoint(0, joint(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(
            i + 1, pin.Inertia(1.0, np.zeros(3), inertias[i] * np.eye(3)), pin.SE3.Identity()
        )
    coupling = Coupling("ring", "left", (0, 0.5), "differential", [("right", 0.5)])
    loop = ClosedLoopModel(model, Sidecar((), ("left", "right"), (coupling,)))
    for left, right in ((0.3, 0.4), (3.0, 3.3), (-7.0, 20.0)):
        q = configuration(loop, left, right, (left + right) / 2 + 0.01)
        assert loop.closure_error(q) == pytest.approx([0.01], abs=1e-13)
    q = configuration(loop, 0.3, 3.3, 1.8)
    M = np.diag(inertias[:2]) + inertias[2] / 4 * np.ones((2, 2))
    expected = np.linalg.solve(M, [0.7, -0.2])
    found = loop.forward_dynamics(q, np.array([1.0, 3.0, 2.0]), [0.7, -0.2])
    assert found.a == pytest.approx([*expected, expected.mean()], rel=1e-12)
    assert found.lambda_ == pytest.approx([inertias[2] * expected.mean()], rel=1e-11)
    result = loop.inverse_dynamics(q, np.array([1.0, 3.0, 2.0]), found.a)
    assert result.tau == pytest.approx([0.7, -0.2], rel=1e-11)
    fine = Coupling("ring", "left", (0, 1 / 999), "fine", [("right", 1 / 998)])
    with pytest.raises(ModelError, match=r"coupling fine: the ratios .* common denominator 997002, expected"):
        ClosedLoopModel(model, Sidecar((), (), (fine,)))


@pytest.mark.parametrize(
    ("first", "second", "coefficients", "message"),
    [
        ("continuous", "continuous", (0, np.pi), "the ratio 3.14159265359 of two continuous joints is no"),
        (
            "continuous",
            "continuous",
            (0, 1e-4),
            "denominator of at most 1000; the turns of a continuous joint",
        ),
        (
            "continuous",
            "revolute",
            (0, 1, 0.1),
            "coupling two=one: 'one' enters in a higher power; the turns",
        ),
        ("continuous", "continuous", (0, 0, 0.1), "make it revolute"),
    ],
)
def test_what_needs_turns_counted_is_refused(first, second, coefficients, message):
    with pytest.raises(ModelError, match=message):
        pair(HINGES[first](), HINGES[second](), coefficients)


@pytest.mark.parametrize(
    ("coupling", "message"),
    [
        (
            Coupling("crank_joints", None, (0,)),
            "coupling crank_joints: the joint 'crank_joints' does not exist; ",
        ),
        (
            Coupling("crank_joint", "rocker", (0, 1)),
            "the joint 'rocker' does not exist; did you mean 'rocker_j",
        ),
        (
            Coupling("crank_joint", "root_joint", (0, 1), "belt"),
            "coupling belt: expected joints with one degree",
        ),
        (
            Coupling("root_joint", None, (0,)),
            "expected joints with one degree of freedom, 'root_joint' has 6",
        ),
    ],
)
def test_couplings_that_do_not_fit_the_model(coupling, message):
    with pytest.raises(ModelError, match=message):
        ClosedLoopModel.from_urdf(
            robots.four_bar(*FOUR_BAR), Sidecar((), (), (coupling,)), root_joint=pin.JointModelFreeFlyer()
        )


def train(*couplings: Coupling, actuated=("j0",)) -> ClosedLoopModel:
    """Four hinges one after another."""
    model, generator = pin.Model(), np.random.default_rng(0)
    for i in range(4):
        model.addJoint(i, pin.JointModelRX(), pin.SE3(np.eye(3), generator.normal(size=3)), f"j{i}")
        model.appendBodyToJoint(
            i + 1, pin.Inertia(1.0, generator.normal(size=3), np.eye(3)), pin.SE3.Identity()
        )
    return ClosedLoopModel(model, Sidecar((), actuated, couplings))


CHAIN = (Coupling("j1", "j0", (0.1, 2)), Coupling("j2", "j1", (0, -1, 0.5)), Coupling("j3", "j2", (0, 0.5)))


def test_chains_and_redundant_couplings():
    loop = train(*CHAIN)
    short = (Coupling("j2", "j0", (-0.1 + 0.005, -2 + 0.2, 2.0)), *(CHAIN[i] for i in (0, 2)))
    same = train(*short)  # j2 = -(0.1 + 2 x) + (0.1 + 2 x)²/2
    state, other = (m.complete([0.4], [1.3], [-2.0]) for m in (loop, same))
    for part in ("q", "v", "a"):
        assert getattr(state, part) == pytest.approx(getattr(other, part), rel=1e-12)
    tau = loop.inverse_dynamics(state.q, state.v, state.a).tau
    assert same.inverse_dynamics(state.q, state.v, state.a).tau == pytest.approx(tau, rel=1e-12)
    # A closure that says again what a coupling says: both hold, and neither multiplier is known.
    model = loop.model.copy()
    model.addFrame(pin.Frame("a", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("b", 2, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    b = model.jointPlacements[2].inverse()  # at the origin of a where joint 2 is not turned
    model.frames[model.getFrameId("b")].placement = b
    locked = Coupling("j1", None, (0,))
    twice = ClosedLoopModel(model, Sidecar((Closure("a", "b", "6d"),), ("j0", "j2", "j3"), (locked,)))
    once = ClosedLoopModel(model, Sidecar((), ("j0", "j2", "j3"), (locked,)))
    q, v, a = np.array([0.3, 0, 0.2, -0.1]), np.array([1.0, 0, 2, 3]), np.array([2.0, 0, 1, 1])
    result = twice.inverse_dynamics(q, v, a)
    assert result.tau == pytest.approx(once.inverse_dynamics(q, v, a).tau, rel=1e-12)
    assert (result.mobility, bool(result.unique[-1])) == (3, False)
    assert twice.forward_dynamics(q, v, result.tau).a == pytest.approx(a, abs=1e-10)
    reactions = loop_reactions(twice, q, v, a, result.tau)
    assert reactions.residual < 1e-9


def test_many_motions_with_couplings_are_each(monkeypatch):
    loop = train(*CHAIN)
    generator = np.random.default_rng(0)
    target, velocity, acceleration = generator.uniform(-0.5, 0.5, (3, 20, 1))
    with monkeypatch.context() as alone:
        for name in ("complete", "inverse_dynamics"):
            alone.setattr(ClosedLoopModel, name, None)
        states = loop.complete_batch(target, velocity, acceleration)
        forces = loop.inverse_dynamics_batch(states.q, states.v, states.a)
    assert not states.errors
    assert not forces.errors
    for i in range(20):
        state = loop.complete(target[i], velocity[i], acceleration[i])
        for part in ("q", "v", "a"):
            np.testing.assert_allclose(getattr(states, part)[i], getattr(state, part), rtol=0, atol=1e-12)
        tau = loop.inverse_dynamics(states.q[i], states.v[i], states.a[i]).tau
        np.testing.assert_allclose(forces.tau[i], tau, rtol=1e-12)


def test_errors_of_couplings_follow_their_equation():
    """With β, couplings that are a little off obey ë + 2β ė + β² e = 0."""
    loop, beta, generator = train(*CHAIN), 30.0, np.random.default_rng(0)
    state = loop.complete([0.4], [1.3], [0.0])
    q, v = state.q + 1e-4 * generator.normal(size=4), state.v + 1e-3 * generator.normal(size=4)
    a = loop.forward_dynamics(q, v, [0.5], stabilisation=beta).a
    e, (e_dot, e_ddot) = (
        loop.closure_error(q),
        robots.differences(lambda t: loop.closure_error(q + t * v + t**2 / 2 * a)),
    )
    assert np.abs(e).min() > 1e-5
    np.testing.assert_allclose(e_ddot, -2 * beta * e_dot - beta**2 * e, rtol=0, atol=1e-8)


def test_what_is_off_is_named():
    loop = train(*CHAIN[:2], Coupling("j3", "j2", (0, 0.5), "belt"))
    q = loop.complete([0.4], [0], [0]).q
    wrong = q + 0.01 * np.eye(4)[3]
    with pytest.raises(InputError, match=r"q: the coupling belt is open by 0\.01 m or rad"):
        loop.inverse_dynamics(wrong, np.zeros(4), np.zeros(4))
    with pytest.raises(InputError, match="v: opens the coupling j1=j0 by"):
        loop.inverse_dynamics(q, np.array([1.0, 0, 0, 0]), np.zeros(4))
    never = pair(pin.JointModelRY(), pin.JointModelRY(), (2.0, 0.0, 1.0), ("two",))
    with pytest.raises(AssemblyError, match=r"leaves 0\.5 m or rad"):
        never.assemble([1.0])  # two = 2 + one²


def test_copies_and_pickles_have_the_couplings():
    loop, q = train(*CHAIN), np.array([0.1, 0.2, 0.3, 0.4])
    for other in (loop.copy(), pickle.loads(pickle.dumps(loop)), copy.deepcopy(loop)):  # noqa: S301
        assert np.array_equal(other.closure_error(q), loop.closure_error(q))
        assert other.sidecar == loop.sidecar
        assert repr(other) == "ClosedLoopModel('', nv=4, closures=0, couplings=3, actuated=[j0])"


# --- the reference configuration ----------------------------------------------------------------------------


def other_side(theta: float) -> np.ndarray:
    """The four-bar's configuration on its other assembly: the joint mirrored at the diagonal."""
    ground, crank, _, _ = FOUR_BAR
    theta, coupler, rocker = robots.four_bar_q(theta, *FOUR_BAR)
    to_end = np.arctan2(-crank * np.sin(theta), ground - crank * np.cos(theta))
    return np.array([theta, 2 * to_end - (coupler + theta) - theta, 2 * to_end - rocker])


def test_assembling_starts_at_the_reference():
    xml = robots.four_bar(*FOUR_BAR)
    q = other_side(0.9)
    plain = ClosedLoopModel.from_urdf(xml, FOUR_BAR_SIDECAR)
    assert np.abs(plain.closure_error(q)).max() < 1e-12
    reference = dict(
        zip(("crank_joint", "coupler_joint", "rocker_joint"), np.round(q, 1).tolist(), strict=True)
    )
    sidecar = Sidecar(FOUR_BAR_SIDECAR.closures, FOUR_BAR_SIDECAR.actuated, (), reference)
    for loop in (ClosedLoopModel.from_urdf(xml, sidecar), ClosedLoopModel.from_urdf(xml, sidecar.to_yaml())):
        assert loop.reference == pytest.approx(np.round(q, 1))
        found = loop.assemble([1.1])
        assert found.same_assembly
        assert found.q == pytest.approx(other_side(1.1), abs=1e-10)
        states = loop.complete_batch(np.linspace(0.9, 1.1, 10)[:, None], np.zeros((10, 1)), np.zeros((10, 1)))
        assert states.same_assembly.all()
        assert states.q[-1] == pytest.approx(other_side(1.1), abs=1e-10)
        # A guess that closes nothing belongs to the assembly of the reference, or to another one.
        assert loop.assemble([1.1], guess=q + 0.1).same_assembly
        assert not loop.assemble(
            [1.1], guess=robots.four_bar_q(0.9, *FOUR_BAR) + 0.1 * np.eye(3)[2]
        ).same_assembly


def test_a_reference_of_any_joint():
    model = robots.arm_model()
    name = str(model.names[1])
    assert np.all(ClosedLoopModel(model, Sidecar.serial(model)).reference == pin.neutral(model))
    xml = robots.four_bar(*FOUR_BAR, kind="continuous")
    closures, actuated = FOUR_BAR_SIDECAR.closures, FOUR_BAR_SIDECAR.actuated

    def load(reference, root=None):
        return ClosedLoopModel.from_urdf(xml, Sidecar(closures, actuated, (), reference), root)

    assert load({"coupler_joint": 0.5}).reference == pytest.approx([1, 0, np.cos(0.5), np.sin(0.5), 1, 0])
    assert load({"crank_joint": (0.6, 0.8)}).reference == pytest.approx([0.6, 0.8, 1, 0, 1, 0])
    floating = load({"root_joint": (1, 2, 3, 0, 0, 0.6, 0.8)}, pin.JointModelFreeFlyer())
    assert floating.reference[:7] == pytest.approx([1, 2, 3, 0, 0, 0.6, 0.8])
    for reference, message in (
        (
            {"crank_joints": 1},
            "reference: the joint 'crank_joints' does not exist; did you mean 'crank_joint'",
        ),
        ({"crank_joint": (1, 2, 3)}, "reference: 'crank_joint': expected 2 values, got 3"),
        ({"crank_joint": (1, 2)}, "reference: 'crank_joint': its values are not normalised"),
    ):
        with pytest.raises(ModelError, match=message):
            load(reference)
    with pytest.raises(ModelError, match=f"reference: '{name}': expected 1 values, got 2"):
        ClosedLoopModel(model, Sidecar((), (), (), {name: (1.0, 2.0)}))


# --- any size -----------------------------------------------------------------------------------------------


def machine(size: float) -> ClosedLoopModel:
    """A carriage and a crank with a rod, a hinge on a slide, and a screw; all lengths times `size`."""
    model, generator = pin.Model(), np.random.default_rng(3)
    model.gravity.linear = size * np.array([0, 0.3, -9.81])
    joints = ("RY", "PX", "RZ", "RX", "PY", "RUBY")
    parents = (0, 0, 2, 3, 0, 0)
    for i, (kind, parent) in enumerate(zip(joints, parents, strict=True)):
        where = pin.SE3(np.eye(3), size * generator.normal(size=3) / 2)
        model.addJoint(parent, getattr(pin, f"JointModel{kind}")(), where, f"{kind}_{i}")
        spin = size**2 * np.diag([0.02, 0.03, 0.04])
        body = pin.Inertia(1.0 + i, size * 0.1 * generator.normal(size=3), spin)
        model.appendBodyToJoint(i + 1, body, pin.SE3.Identity())
    for name, joint in (("a", 1), ("b", 4)):
        where = pin.SE3(np.eye(3), size * generator.normal(size=3) / 3)
        model.addFrame(pin.Frame(name, joint, where, pin.FrameType.OP_FRAME))
    couplings = (
        Coupling("PX_1", "RY_0", (size * 0.1, size * 0.2, size * 0.03)),
        Coupling("RX_3", "PX_1", (0.1, 0.4 / size, -0.2 / size**2)),
        Coupling("PY_4", "RUBY_5", (size * 0.1, size * 0.02), others={"RY_0": size * 0.03, "PX_1": 0.1}),
    )
    closures = (Closure("a", "b", "distance", size * 1.5),)
    reference = {"RY_0": 0.3, "PX_1": size * 0.16, "PY_4": size * 0.1, "RUBY_5": 0.2}
    return ClosedLoopModel(model, Sidecar(closures, ("RY_0", "RUBY_5"), couplings, reference))


@pytest.mark.parametrize("size", [64.0, 64.0**-2])
def test_all_lengths_scale(size):
    """Also those of rods, couplings and the reference: forces grow with the size, moments with its square."""
    one, other = machine(1.0), machine(size)
    assert one.unit_of_length == 1.0
    assert other.unit_of_length != 1.0
    lengths = np.array([False, True, False, False, True, False])
    motion = np.where(lengths, size, 1.0)
    rows = np.where([True, True, False, True], size, 1.0)
    at_q = np.append(motion, 1.0)
    states = [m.complete([0.4, 0.3], [1.0, 2.0], [3.0, -1.0]) for m in (one, other)]
    assert states[0].same_assembly
    assert states[1].same_assembly
    assert states[1].q / at_q == pytest.approx(states[0].q, rel=1e-12)
    assert states[1].a / motion == pytest.approx(states[0].a, rel=1e-11)
    results = [m.inverse_dynamics(s.q, s.v, s.a) for m, s in zip((one, other), states, strict=True)]
    assert results[1].tau / size**2 == pytest.approx(results[0].tau, rel=1e-11)
    assert results[1].lambda_ * rows / size**2 == pytest.approx(results[0].lambda_, rel=1e-11)
    moved = [
        m.forward_dynamics(s.q, s.v, r.tau) for m, s, r in zip((one, other), states, results, strict=True)
    ]
    assert moved[1].a / motion == pytest.approx(moved[0].a, rel=1e-11)
    batch = other.inverse_dynamics_batch(*(np.tile(getattr(states[1], p), (9, 1)) for p in "qva"))
    assert not batch.errors
    assert batch.tau == pytest.approx(np.tile(results[1].tau, (9, 1)), rel=1e-11)
    shift = 0.01 * np.array([1, 0, 0, 0, 1, 0, 0])
    errors = [
        m.closure_error(s.q + shift * u) for m, s, u in ((one, states[0], 1.0), (other, states[1], at_q))
    ]
    assert errors[1] / rows == pytest.approx(errors[0], rel=1e-9)
