"""Several targets at once, and what an assembly's evidence costs and says."""

from __future__ import annotations

import pickle

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from other_robots import load, others

from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops import ClosedLoopModel, FrameTarget, Sidecar
from p3dof.loops.assembly import Assembler

PLACE = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.05, -0.03, 0.6]))


def hexapod(s: float = 1.0) -> ClosedLoopModel:
    """The Stewart platform, of any size."""
    loop = ClosedLoopModel.from_urdf(robots.hexapod(), robots.HEXAPOD_SIDECAR)
    model = loop.model.copy()
    for i in range(model.njoints):
        body, place = model.inertias[i], model.jointPlacements[i]
        model.jointPlacements[i] = pin.SE3(place.rotation, s * place.translation)
        model.inertias[i] = pin.Inertia(body.mass, s * body.lever, s**2 * body.inertia)
    for frame in model.frames:
        frame.placement = pin.SE3(frame.placement.rotation, s * frame.placement.translation)
    return ClosedLoopModel(model, loop.sidecar)


def guess(loop: ClosedLoopModel, s: float = 1.0) -> np.ndarray:
    q = robots.hexapod_q(PLACE, loop.model)
    for name in ("float", *loop.actuated):
        at = loop.model.idx_qs[loop.model.getJointId(name)]
        q[at : at + (3 if name == "float" else 1)] *= s
    return q


@pytest.mark.parametrize("s", [1.0, 1e3])  # the larger one is computed in a unit of its own
def test_rates_and_forces_by_name_are_those_in_order(s):
    loop, q = hexapod(s), guess(hexapod(s), s)
    names, at = list(loop.actuated), loop.actuated_v
    values = loop.assemble(None, q).q[[loop.model.idx_qs[loop.model.getJointId(name)] for name in names]]
    velocity, acceleration, tau = np.arange(1.0, 19.0).reshape(3, 6) * s / 10
    plain = loop.complete(values, velocity, acceleration, q)
    for turned in (names, names[::-1]):
        by_name = [
            {name: row[names.index(name)] for name in turned} for row in (values, velocity, acceleration, tau)
        ]
        for target in (by_name[0], values):
            state = loop.complete(target, by_name[1], by_name[2], q)
            np.testing.assert_allclose(state.v[at], velocity, rtol=1e-9)
            np.testing.assert_allclose(state.a, plain.a, rtol=0, atol=1e-9 * np.abs(plain.a).max())
        with_array = loop.complete(by_name[0], [by_name[1][name] for name in turned], by_name[2], q)
        np.testing.assert_array_equal(with_array.v, loop.complete(*by_name[:3], q).v)
        rows = [{name: np.array([x, 2 * x]) for name, x in part.items()} for part in by_name[1:3]]
        many = loop.complete_batch(np.tile(values, (2, 1)), *rows, guess=q)
        np.testing.assert_allclose(many.v[:, at], [velocity, 2 * velocity], rtol=1e-9)
        np.testing.assert_allclose(many.a[:, at], [acceleration, 2 * acceleration], rtol=1e-9)
        found = loop.forward_dynamics(plain.q, plain.v, by_name[3]).a
        np.testing.assert_array_equal(found, loop.forward_dynamics(plain.q, plain.v, tau).a)
    one = loop.forward_dynamics(plain.q, plain.v, {names[2]: 3.0}).a  # the others are off
    np.testing.assert_array_equal(one, loop.forward_dynamics(plain.q, plain.v, [0, 0, 3.0, 0, 0, 0]).a)
    state = np.tile(plain.q, (2, 1)), np.tile(plain.v, (2, 1))
    batch = loop.forward_dynamics_batch(*state, {names[2]: np.array([3.0, 0.0])}).a
    np.testing.assert_array_equal(batch, [one, loop.forward_dynamics(plain.q, plain.v, np.zeros(6)).a])


@pytest.mark.parametrize(
    ("target", "velocity", "message"),
    [
        ({"left_joint": 1.9}, {"left_jont": 1.0}, "velocity: no joint 'left_jont' is asked for; "),
        (
            {"left_joint": 1.9},
            {"left_joint": 1.0, "right_joint": 1.0},
            "velocity: no joint 'right_joint' is asked for; ",
        ),
        (
            [1.9, 1.2],
            {"left_joint": 1.0},
            "velocity: expected a value of each joint, got none of right_joint",
        ),
        ([1.9, 1.2], {"left_joint": "x", "right_joint": 1.0}, "velocity left_joint: expected real numbers"),
        (None, {"left_joint": 1.0}, "velocity: expected an array, got names; these belong to a target of"),
        (FrameTarget("left_tip", PLACE), {"left_joint": 1.0}, "velocity: expected an array, got names"),
        ([{"left_joint": 1.9}], {"left_joint": 1.0}, "velocity: expected an array, got names"),
    ],
)
def test_wrong_rates_by_name_are_one_error(target, velocity, message):
    loop = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    with pytest.raises(InputError, match=message):
        loop.complete(target, velocity, [0.0, 0.0])
    with pytest.raises(InputError, match=message.replace("velocity", "acceleration")):
        loop.complete(target, [0.0, 0.0], velocity)
    with pytest.raises(InputError, match="tau: no joint 'left' is asked for; known: left_joint, right"):
        loop.forward_dynamics(robots.five_bar_q(1.9, 1.2), np.zeros(4), {"left": 1.0})
    rates = {"left_joint": np.zeros(2), "right_joint": np.zeros(3)}
    with pytest.raises(InputError, match="velocity: expected a number of each joint, or arrays of one len"):
        loop.complete_batch([[1.9, 1.2]] * 2, rates, np.zeros((2, 2)))


@pytest.mark.parametrize("s", [1.0, 1e3])
def test_several_targets_at_once(s):
    """Height and tilt of the platform, and slides by name: all as asked, with their velocities."""
    loop, upright = hexapod(s), [False, False, True, True, True, False]
    place = pin.SE3(PLACE.rotation, s * (PLACE.translation + np.array([0.3, 0.2, 0.02])))
    slides = {"slide_1": 0.7 * s, "slide_4": 0.75 * s}
    target = [FrameTarget("platform", place, upright), slides]
    rates, lengths = np.arange(1.0, 13.0).reshape(2, 6) / 10, np.array([s, 1, 1, s, s])
    velocity, acceleration = rates[:, 1:] * lengths
    state = loop.complete(target, velocity, acceleration, guess(loop, s))
    model, data = loop.model, loop.model.createData()
    pin.forwardKinematics(model, data, state.q, state.v, state.a)
    pin.updateFramePlacements(model, data)
    frame = (model, data, model.getFrameId("platform"), pin.LOCAL_WORLD_ALIGNED)
    assert data.oMf[frame[2]].translation[2] == pytest.approx(place.translation[2], rel=1e-11)
    v = pin.getFrameVelocity(*frame).vector[upright]
    a = pin.getFrameClassicalAcceleration(*frame).vector[upright]
    at = [model.getJointId(name) for name in slides]
    assert [state.q[model.idx_qs[j]] for j in at] == pytest.approx(list(slides.values()), rel=1e-11)
    np.testing.assert_allclose([*v, *(state.v[model.idx_vs[j]] for j in at)], velocity, rtol=1e-8)
    np.testing.assert_allclose([*a, *(state.a[model.idx_vs[j]] for j in at)], acceleration, rtol=1e-8)
    assert not state.determined  # one freedom of the platform is left
    assert state.influence.shape == (model.nv, 5)
    np.testing.assert_allclose(state.influence @ velocity, state.v, rtol=0, atol=1e-9 * max(1, s))


def test_a_floating_base_is_placed_with_motors_and_a_tip():
    """Base, one motor by name and the placement of a tip determine a floating five-bar in full."""
    model = robots_on_a_base()
    loop = ClosedLoopModel(model, robots.FIVE_BAR_SIDECAR)
    start = np.concatenate(([0, 0, 0, 0, 0, 0, 1.0], robots.five_bar_q(2.0, 1.2)))
    data = model.createData()
    pin.framesForwardKinematics(model, data, start)
    tip = data.oMf[model.getFrameId("left_tip")].copy()
    base = pin.SE3(pin.rpy.rpyToMatrix(0.2, 0.1, -0.3), np.array([1.0, 2.0, 3.0]))
    moved = pin.SE3(tip.rotation, base.act(tip.translation + np.array([0.02, 0.0, 0.01])))
    position = [True, True, True, False, False, False]
    reached = loop.assemble([FrameTarget("base", base), FrameTarget("left_tip", moved, position)], start)
    pin.framesForwardKinematics(model, data, reached.q)
    assert np.abs(data.oMf[model.getFrameId("left_tip")].translation - moved.translation).max() < 1e-12
    values = reached.q[[model.idx_qs[model.getJointId(name)] for name in loop.actuated]]
    for joints in (values, dict(zip(loop.actuated, values, strict=True))):
        again = loop.assemble([FrameTarget("base", base), joints], start)
        assert np.abs(pin.difference(model, again.q, reached.q)).max() < 1e-11
        assert again.same_assembly
    off = pin.SE3(tip.rotation, base.act(tip.translation + np.array([0.0, 0.1, 0.0])))  # out of its plane
    with pytest.raises(AssemblyError, match="at the target"):
        loop.assemble([FrameTarget("base", base), FrameTarget("left_tip", off, position)], start)


def robots_on_a_base() -> pin.Model:
    return ClosedLoopModel.from_urdf(robots.five_bar(), (), root_joint=pin.JointModelFreeFlyer()).model


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ({"left_join": 1.0}, "target: the joint 'left_join' does not exist; did you mean 'left_joint'"),
        ({"left_joint": [1.0, 2.0]}, "target: expected"),
        ({"left_joint": np.nan}, "target: expected finite"),
        ([{"left_joint": 1.0}, [1.0]], r"target: expected shape \(2,\)"),
        ([{"left_joint": 1.0}, FrameTarget("nowhere", pin.SE3.Identity())], "the frame 'nowhere' does not"),
        ([[1.0, 2.0], [1.0, 2.0]], r"target: expected shape \(2,\)"),
    ],
)
def test_bad_targets_are_refused(target, message):
    loop = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    with pytest.raises(InputError, match=message):
        loop.assemble(target, robots.five_bar_q(2.0, 1.2))


# --- evidence -----------------------------------------------------------------------------------------------


def test_evidence_is_found_out_when_asked_for_and_once(monkeypatch):
    loop = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    asked = []
    found = Assembler.on_home
    monkeypatch.setattr(Assembler, "on_home", lambda *args: asked.append(1) or found(*args))
    loop.model.gravity.linear = np.zeros(3)
    near = robots.five_bar_q(2.0, 1.2) + 0.01 * np.array([1.0, -2.0, 3.0, 1.0])
    result = loop.assemble(None, near)
    assert not asked
    assert result.iterations <= 5
    first = result.same_assembly
    assert len(asked) == 1
    assert result.same_assembly == first
    assert len(asked) == 1
    assert pickle.loads(pickle.dumps(result)).same_assembly == first  # noqa: S301 - our own


def test_projecting_back_follows_no_path_from_the_reference(monkeypatch):
    """From 0.01 rad beside a solution of a large robot: a few steps, and nothing else."""
    model, held = robots.two_arms()
    loop = ClosedLoopModel(model, Sidecar(robots.TWO_ARMS, tuple(model.names[1:8])))
    q = loop.assemble(None, held).q
    evaluations = []
    at = loop._tree.kinematics.at
    monkeypatch.setattr(loop._tree.kinematics, "at", lambda q: evaluations.append(1) or at(q))
    for seed in range(5):
        aside = np.random.default_rng(seed).uniform(-0.01, 0.01, model.nv)
        evaluations.clear()
        result = loop.assemble(None, pin.integrate(model, q, aside))
        assert result.gap < 1e-14
        assert result.iterations <= 5
        assert len(evaluations) <= 12


@pytest.mark.parametrize("theta", [0.4, 2.0])
def test_an_open_reference_means_the_assembly_that_closing_it_leads_to(theta):
    """Neutral closes nothing, and its loop closes by the fallback only: that is what is meant by the same."""
    open_, closed = {"crank_joint": theta, "coupler_joint": 3.0, "rocker_joint": 0.1}, robots.FOUR_BAR
    sidecar = Sidecar(robots.FOUR_BAR_SIDECAR.closures, ("crank_joint",), reference=open_)
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*closed), sidecar)
    home = loop.assemble()
    assert home.same_assembly
    further = loop.assemble([home.q[0] + 0.3])
    assert further.same_assembly
    assert loop.assemble([home.q[0] + 0.3], guess=further.q + 0.02).same_assembly
    assert loop.assemble(None, guess=further.q + 0.02).same_assembly  # no target: its free motion is not held
    mirrored = mirror(home.q)
    assert np.abs(loop.closure_error(mirrored)).max() < 1e-9
    assert not loop.assemble(None, guess=mirrored + 0.02).same_assembly


def mirror(q: np.ndarray) -> np.ndarray:
    """The other assembly of a four-bar with the same crank: coupler and rocker turned over the diagonal."""
    ground, crank = robots.FOUR_BAR[:2]
    tip = crank * np.array([np.cos(q[0]), np.sin(q[0])])
    diagonal = np.arctan2(-tip[1], ground - tip[0])
    coupler, rocker = 2 * diagonal - (q[0] + q[1]), 2 * diagonal - q[2]
    return np.array([q[0], coupler - q[0], rocker])


@pytest.mark.parametrize("name", others("five_bar_hinges", "five_bar_rod_end", "leg_with_rods", "tiny_delta"))
def test_other_robots_are_their_own_assembly(name):
    loop = load(name)
    home = loop.assemble()
    assert home.same_assembly
    aside = 0.01 * np.random.default_rng(0).uniform(-1, 1, loop.model.nv)
    back = loop.assemble(None, pin.integrate(loop.model, home.q, aside))
    assert back.iterations <= 5
    assert back.same_assembly
