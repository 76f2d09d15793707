"""Hybrid dynamics: prescribed accelerations and idle freedoms, against forward dynamics called many times."""

from __future__ import annotations

import pickle
from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from other_robots import EXPORTED, load, others

from p3dof._base.errors import DynamicsError, InputError, SingularityError
from p3dof.loops import ClosedLoopModel, Closure, Coupling, Sidecar
from p3dof.loops.hybrid import Hybrid
from p3dof.loops.partitions import Terms

SIDES = {"left": 0.1, "right": -0.1}


def biped() -> ClosedLoopModel:
    """A floating torso with two legs, whose knees are moved by four-bars; a rod swings idly at each shank."""
    parts = [robots.link("world"), robots.link("torso", robots.ARM)]
    parts.append(robots.joint("base", "world", "torso", kind="floating"))
    closures = []
    for side, y in SIDES.items():
        parts += [
            robots.link(f"{side}_hip", robots.ROD),
            robots.joint(f"{side}_yaw", "torso", f"{side}_hip", (0, y, -0.1), (0, 0, 1)),
            robots.link(f"{side}_thigh", robots.ROD),
            robots.joint(f"{side}_pitch", f"{side}_hip", f"{side}_thigh", axis=(0, -1, 0)),
            robots.link(f"{side}_rod", robots.BAR),
            robots.joint(f"{side}_rod_joint", f"{side}_thigh", f"{side}_rod", (0.2, 0, 0), (0, -1, 0)),
            robots.link(f"{side}_shank", robots.ARM),
            robots.joint(f"{side}_knee", f"{side}_hip", f"{side}_shank", (0.5, 0, 0), (0, -1, 0)),
            robots.link(f"{side}_tail", robots.BAR),
            robots.joint(f"{side}_swing", f"{side}_shank", f"{side}_tail", (0.4, 0, 0), (1, 0, 0)),
            robots.link(f"{side}_rod_tip"),
            robots.joint(f"{side}_a", f"{side}_rod", f"{side}_rod_tip", (0.45, 0, 0), kind="fixed"),
            robots.link(f"{side}_lever"),
            robots.joint(f"{side}_b", f"{side}_shank", f"{side}_lever", (0.35, 0, 0), kind="fixed"),
        ]
        closures.append(Closure(f"{side}_rod_tip", f"{side}_lever"))
    actuated = tuple(f"{side}_{name}" for side in SIDES for name in ("yaw", "pitch"))
    return ClosedLoopModel.from_urdf(robots.robot(*parts), Sidecar(tuple(closures), actuated))


def geared() -> ClosedLoopModel:
    """A floating torso with a tail that is geared to the yaw of a leg, by a coupling."""
    plain = biped()
    sidecar = Sidecar(
        plain.sidecar.closures, plain.actuated, (Coupling("left_swing", "left_yaw", (0.1, 2.0, 0.3)),)
    )
    return ClosedLoopModel(plain.model.copy(), sidecar)


def moving(
    loop: ClosedLoopModel, seed: int, guess: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """An assembled configuration near the one given, and a velocity that its closures allow."""
    rng = np.random.default_rng(seed)
    home = loop.assemble(None, guess).q
    q = loop.assemble(None, pin.integrate(loop.model, home, 0.1 * rng.normal(size=loop.model.nv))).q
    J = loop.closure_jacobian(q)
    v = rng.normal(size=loop.model.nv)
    return q, v - np.linalg.pinv(J, rcond=1e-9) @ (J @ v)


def by_forward_dynamics(loop, q, v, prescribed, *loads):
    """The forces for accelerations of the actuated joints, by one call more than there are of them."""
    act, count = loop.actuated_v, len(loop.actuated)
    rest = loop.forward_dynamics(q, v, np.zeros(count), *loads).a
    by_force = [loop.forward_dynamics(q, v, unit, *loads).a[act] - rest[act] for unit in np.eye(count)]
    return np.linalg.solve(np.transpose(by_force), prescribed - rest[act])


def check(loop, q, v, seed, *loads):
    prescribed = np.random.default_rng(seed).normal(size=len(loop.actuated))
    found = loop.hybrid_dynamics(q, v, prescribed, None, *loads)
    expected = by_forward_dynamics(loop, q, v, prescribed, *loads)
    assert np.abs(found.tau - expected).max() <= 1e-8 * max(1.0, np.abs(expected).max())
    assert np.abs(found.a[loop.actuated_v] - prescribed).max() <= 1e-9
    assert found.prescribed_residual <= 1e-9
    moved = loop.forward_dynamics(q, v, found.tau, *loads)
    assert np.abs(moved.a - found.a).max() <= 1e-8 * max(1.0, np.abs(found.a).max())
    assert found.closure_residual <= 1e-9 * max(1.0, np.abs(found.a).max())
    assert found.residual <= 1e-9 * max(1.0, np.abs(found.tau).max())
    assert found.tau_unique
    assert found.mobility == loop.mobility(q)
    return found


@pytest.mark.parametrize("name", others(*EXPORTED))
def test_other_robots_against_forward_dynamics(name):
    loop = load(name)
    q = loop.assemble().q
    J = loop.closure_jacobian(q)
    v = np.random.default_rng(1).normal(size=loop.model.nv)
    v -= np.linalg.pinv(J, rcond=1e-9) @ (J @ v)
    check(loop, q, v, 5)


@pytest.mark.parametrize("missed", ["wanted", "drift"])
def test_what_misses_its_task_is_solved_again_by_the_slower_way(monkeypatch, missed):
    loop = biped()
    q, v = moving(loop, 2)
    prescribed = np.random.default_rng(4).normal(size=len(loop.actuated))
    expected = loop.hybrid_dynamics(q, v, prescribed)
    asked, real = [], Hybrid._result

    def result(self, task, *found):
        asked.append(task)
        if len(asked) == 1:  # what the quick way found is right for another task
            task = replace(task, **{missed: getattr(task, missed) + 1e-6})
        return real(self, task, *found)

    monkeypatch.setattr(Hybrid, "_result", result)
    found = loop.hybrid_dynamics(q, v, prescribed)
    assert len(asked) == 2
    assert np.abs(found.tau - expected.tau).max() <= 1e-9 * np.abs(expected.tau).max()


@pytest.mark.parametrize("size", [1e-8, 1.0, 1e4])
def test_forces_that_are_not_solved_for_are_refused_however_small_they_are(monkeypatch, size):
    loop, force, scale = biped(), Terms.tree_force, Terms.scale
    q, v = moving(loop, 2)
    monkeypatch.setattr("p3dof.loops.hybrid._SOLUTIONS", 0)
    monkeypatch.setattr(Terms, "tree_force", lambda self, *given: size * force(self, *given))
    monkeypatch.setattr(Terms, "scale", lambda self, *given: size * scale(self, *given))
    with pytest.raises(DynamicsError, match="need a force that no actuator gives"):
        loop.hybrid_dynamics(q, v, np.ones(len(loop.actuated)))


@pytest.mark.parametrize("build", [biped, geared])
@pytest.mark.parametrize("seed", range(3))
def test_a_floating_biped_against_forward_dynamics(build, seed):
    loop = build()
    q, v = moving(loop, seed, standing(loop))
    rng = np.random.default_rng(seed)
    loads = (
        {"torso": 10 * rng.normal(size=6), "left_tail": rng.normal(size=6)},
        rng.normal(size=loop.model.nv),
    )
    found = check(loop, q, v, seed, *loads)
    assert found.mobility > len(loop.actuated)  # the base and the tails are idle
    assert 0.0 < found.conditioning <= 1.0
    with pytest.raises(DynamicsError, match=r"no actuator gives: .*; hybrid_dynamics\(\) lets passive"):
        loop.inverse_dynamics(q, v, np.zeros(len(v)) + check_drift(loop, q, v))


def standing(loop: ClosedLoopModel) -> np.ndarray:
    q, model = pin.neutral(loop.model), loop.model
    crank, coupler, rocker = robots.four_bar_q(0.9, *robots.FOUR_BAR)
    for side in SIDES:
        for name, value in zip(("pitch", "rod_joint", "knee"), (crank, coupler, rocker), strict=True):
            q[model.idx_qs[model.getJointId(f"{side}_{name}")]] = value
    return q


def check_drift(loop, q, v):
    """The shortest acceleration that keeps the loops closed: M a + h of it needs forces in the base."""
    J, h = loop.closure_jacobian(q), 1e-5
    there, here = (loop.closure_jacobian(pin.integrate(loop.model, q, s * h * v)) for s in (1, -1))
    return -np.linalg.pinv(J, rcond=1e-9) @ ((there - here) @ v / (2 * h))


def test_without_idle_freedoms_it_is_inverse_dynamics():
    for xml, sidecar, guess in (
        (robots.five_bar(), robots.FIVE_BAR_SIDECAR, robots.five_bar_q(2.0, 1.2)),
        (robots.sarrus(), robots.SARRUS_SIDECAR, 0.2 * np.array([1, -2, 1] * 2)),
    ):
        loop = ClosedLoopModel.from_urdf(xml, sidecar)
        count = len(loop.actuated)
        rates = np.linspace(1.0, -2.0, 2 * count).reshape(2, count)
        start = guess[loop.actuated_v]
        state = loop.complete(start, *rates, guess=guess)
        expected = loop.inverse_dynamics(state.q, state.v, state.a)
        found = loop.hybrid_dynamics(state.q, state.v, rates[1])
        np.testing.assert_allclose(found.tau, expected.tau, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.a, state.a, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.lambda_, expected.lambda_, rtol=0, atol=1e-10)
        assert np.array_equal(found.unique, expected.unique)
        assert (found.rank, found.mobility) == (expected.rank, expected.mobility)


def test_an_open_tree_that_floats_and_one_that_does_not():
    arm = robots.arm_model()
    loop = ClosedLoopModel(arm, Sidecar.serial(arm))
    q, v, a = np.random.default_rng(0).normal(size=(3, 7))
    np.testing.assert_allclose(
        loop.hybrid_dynamics(q, v, a).tau, pin.rnea(arm, arm.createData(), q, v, a), rtol=0, atol=1e-11
    )
    tree = ClosedLoopModel(biped().model, Sidecar((), biped().actuated))
    check(tree, *moving(tree, 4), 4)


def test_other_joints_and_frames_may_be_prescribed():
    """The base and frames with as many actuators: what follows has these accelerations, and forces agree."""
    loop = biped()
    q, v = moving(loop, 1, standing(loop))
    wanted = {"left_pitch": 1.0, "right_yaw": np.array([-2.0])}
    lift = np.array([np.nan, np.nan, 3.0, np.nan, -1.0, np.nan])
    found = loop.hybrid_dynamics(q, v, wanted, {"torso": lift})
    model, data = loop.model, loop.model.createData()
    pin.forwardKinematics(model, data, q, v, found.a)
    frame = model.getFrameId("torso")
    moved = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
    np.testing.assert_allclose(moved[[2, 4]], [3.0, -1.0], rtol=0, atol=1e-9)
    at = {name: found.a[model.idx_vs[model.getJointId(name)]] for name in wanted}
    assert at == pytest.approx({"left_pitch": 1.0, "right_yaw": -2.0}, abs=1e-9)
    again = loop.forward_dynamics(q, v, found.tau)
    np.testing.assert_allclose(again.a, found.a, rtol=0, atol=1e-8 * np.abs(found.a).max())
    of_base = found.a[:6]
    few = {"base": of_base}
    with pytest.raises(DynamicsError, match="6 prescribed accelerations"):
        loop.hybrid_dynamics(q, v, {"base": of_base + 1.0})  # four motors cannot hold six
    np.testing.assert_allclose(loop.hybrid_dynamics(q, v, wanted | few).tau, found.tau, rtol=1e-6)


@pytest.mark.parametrize(("feet", "kind"), [(("left",), "6d"), (("left", "right"), "3d")])
def test_feet_on_the_ground_carry_the_weight(feet, kind):
    """A floating robot on its feet: the closures' forces are the ground's, and carry all masses."""
    loop = biped()
    q, _ = moving(loop, 3, standing(loop))
    data = loop.model.createData()
    pin.framesForwardKinematics(loop.model, data, q)
    model = loop.model.copy()
    for side in feet:
        shank = model.getFrameId(f"{side}_shank")
        place = pin.SE3(np.eye(3), data.oMf[shank].act(np.array([0.5, 0.0, 0.0])))
        joint = model.frames[shank].parentJoint
        sole = data.oMi[joint].actInv(place)
        model.addFrame(pin.Frame(f"{side}_ground", 0, place, pin.OP_FRAME))
        model.addFrame(pin.Frame(f"{side}_sole", joint, sole, pin.OP_FRAME))
    ground = tuple(Closure(f"{side}_ground", f"{side}_sole", kind) for side in feet)
    stands = ClosedLoopModel(model, Sidecar((*ground, *loop.sidecar.closures), loop.actuated))
    # The distance of two feet is a function of the motors: one of them follows, and they can work against it.
    wanted = dict.fromkeys(loop.actuated[: 5 - len(feet)], 0.5)
    found = stands.hybrid_dynamics(q, np.zeros(model.nv), wanted)
    assert found.tau_unique == (len(feet) == 1)
    assert found.prescribed_residual < 1e-9
    pin.centerOfMass(model, data := model.createData(), q, np.zeros(model.nv), found.a)
    weight = pin.computeTotalMass(model) * (data.acom[0] - model.gravity.linear)
    carried = sum(found.lambda_[stands.constraint_rows[i]][:3] for i in range(len(feet)))
    np.testing.assert_allclose(carried, weight, rtol=0, atol=1e-9)


@pytest.mark.parametrize("s", [1e-4, 1e3])
def test_models_of_every_size(s):
    one = biped()
    model = one.model.copy()
    for i in range(model.njoints):
        body, place = model.inertias[i], model.jointPlacements[i]
        model.jointPlacements[i] = pin.SE3(place.rotation, s * place.translation)
        model.inertias[i] = pin.Inertia(body.mass, s * body.lever, s**2 * body.inertia)
    for frame in model.frames:
        frame.placement = pin.SE3(frame.placement.rotation, s * frame.placement.translation)
    model.gravity.linear = s * model.gravity.linear
    other = ClosedLoopModel(model, one.sidecar)
    q, v = moving(one, 2, standing(one))
    by_q, by_v = np.ones(model.nq), np.ones(model.nv)
    by_q[:3], by_v[:3] = s, s
    lift = np.array([1.0, np.nan, 2.0, 3.0, np.nan, np.nan])
    load = np.arange(6.0)
    first = one.hybrid_dynamics(
        q, v, {"left_yaw": 0.5}, {"torso": lift}, {"torso": load}, load.repeat(3)[: len(v)]
    )
    lengths = np.where(np.arange(6) < 3, s, 1.0)
    force = load.repeat(3)[: len(v)] * np.where(np.arange(len(v)) < 3, s, s**2)
    wrench = {"torso": load * lengths[::1] * np.where(np.arange(6) < 3, 1.0, s**2)}
    second = other.hybrid_dynamics(
        q * by_q, v * by_v, {"left_yaw": [0.5]}, {"torso": lift * lengths}, wrench, force
    )
    np.testing.assert_allclose(second.tau / s**2, first.tau, rtol=1e-8)
    np.testing.assert_allclose(second.a / by_v, first.a, rtol=0, atol=1e-8 * np.abs(first.a).max())
    assert second.gap <= 1e-10 * max(1.0, s)
    rows = [np.tile(value, (9, 1)) for value in (q, v, [1.0, -0.5, 2.0, 3.0])]
    small = one.hybrid_dynamics_batch(*rows, None, {"torso": load}, load.repeat(3)[: len(v)])
    large = other.hybrid_dynamics_batch(rows[0] * by_q, rows[1] * by_v, rows[2], None, wrench, force)
    assert not large.errors
    np.testing.assert_allclose(large.tau / s**2, small.tau, rtol=1e-8)
    np.testing.assert_allclose(large.a / by_v, small.a, rtol=0, atol=1e-8 * np.abs(small.a).max())


def test_what_is_not_determined_or_not_possible_is_refused():
    loop = biped()
    q, v = moving(loop, 0, standing(loop))
    crank = {"left_pitch": 1.0, "left_knee": 1.0}
    everything = dict.fromkeys([*loop.actuated, "left_swing", "right_swing"], 3.0)
    with pytest.raises(
        DynamicsError, match=r"depend on each other: 2 are prescribed, .* can choose 1 of them"
    ):
        loop.hybrid_dynamics(q, v, crank)
    with pytest.raises(
        DynamicsError, match="1 prescribed accelerations leave 3 of the 4 actuators' forces open"
    ):
        loop.hybrid_dynamics(q, v, {"left_pitch": 1.0})
    with pytest.raises(DynamicsError, match="0 prescribed accelerations leave 4 of the 4"):
        loop.hybrid_dynamics(q, v)
    with pytest.raises(DynamicsError, match=r"need a force that no actuator gives: .* is missing"):
        loop.hybrid_dynamics(q, v, everything)


def test_actuators_without_effect_on_what_is_prescribed():
    """A crank at its dead centre cannot be moved by the rocker."""
    lengths = (0.5, 0.4, 0.35, 0.3)
    sidecar = Sidecar(robots.FOUR_BAR_SIDECAR.closures, ("rocker_joint",))
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), sidecar)
    reach = 0.4 + 0.35  # crank and coupler in line
    angle = np.arccos((0.5**2 + reach**2 - 0.3**2) / (2 * 0.5 * reach))
    end = reach * np.array([np.cos(angle), np.sin(angle)]) - [0.5, 0.0]
    q = np.array([angle, 0.0, np.arctan2(end[1], end[0])])
    assert np.abs(loop.closure_error(q)).max() < 1e-12
    with pytest.raises(SingularityError, match="cannot produce the prescribed accelerations here"):
        loop.hybrid_dynamics(q, np.zeros(3), {"crank_joint": 1.0})
    massless = loop.copy()
    for i in range(1, massless.model.njoints):
        massless.model.inertias[i] = pin.Inertia.Zero()
    tree = ClosedLoopModel(massless.model, Sidecar((), ("crank_joint",)))
    with pytest.raises(DynamicsError, match="a passive degree of freedom has no inertia"):
        tree.hybrid_dynamics(q, np.zeros(3), [1.0])


def test_opposing_actuators_share_a_force_without_changing_the_motion():
    sidecar = Sidecar(robots.FOUR_BAR_SIDECAR.closures, ("crank_joint", "rocker_joint"))
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)
    q = robots.four_bar_q(0.9, *robots.FOUR_BAR)
    found = loop.hybrid_dynamics(q, np.zeros(3), {"crank_joint": 2.0})
    expected = loop.inverse_dynamics(q, np.zeros(3), found.a)
    np.testing.assert_allclose(found.tau, expected.tau, rtol=0, atol=1e-12)
    assert not found.tau_unique
    assert np.array_equal(found.unique, expected.unique)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0],), r"prescribed: expected shape \(4,\)"),
        (([1.0, 2.0, 3.0, np.nan],), "prescribed: expected finite"),
        (({"left_yaw": [1.0, 2.0]},), r"prescribed left_yaw: expected shape \(1,\)"),
        (({"base": 1.0},), r"prescribed base: expected shape \(6,\)"),
        (({"left_yaw": np.inf},), "prescribed left_yaw: expected a finite"),
        (({"left_yam": 1.0},), "the joint 'left_yam' does not exist; did you mean 'left_yaw'"),
        (({"universe": 1.0},), "the joint 'universe' does not exist"),
        (({3: 1.0},), "the joint 3 does not exist"),
        (({}, {"nowhere": np.zeros(6)}), "frames: the frame 'nowhere' does not exist"),
        (({}, {"torso": np.zeros(3)}), r"frames torso: expected shape \(6,\)"),
        (({}, {"torso": np.full(6, np.nan)}), "frames torso: expected at least one prescribed"),
        (({}, {"torso": [np.inf] * 6}), "frames torso: expected finite"),
        (({}, [1.0]), "frames: expected a mapping of names to accelerations, got list"),
    ],
)
def test_bad_prescriptions_are_refused(arguments, message):
    loop = biped()
    q = loop.assemble(None, standing(loop)).q
    with pytest.raises(InputError, match=message):
        loop.hybrid_dynamics(q, np.zeros(loop.model.nv), *arguments)


def test_open_loops_are_refused():
    loop = biped()
    q = standing(loop)
    q[loop.model.idx_qs[loop.model.getJointId("left_knee")]] += 0.1
    with pytest.raises(InputError, match="q: the closure left_rod_tip/left_lever is open"):
        loop.hybrid_dynamics(q, np.zeros(loop.model.nv), np.zeros(4))
    v = np.zeros(loop.model.nv)
    v[loop.model.idx_vs[loop.model.getJointId("left_knee")]] = 1.0
    with pytest.raises(InputError, match="v: opens the closure left_rod_tip/left_lever"):
        loop.hybrid_dynamics(standing(loop), v, np.zeros(4))


# --- many samples at once -----------------------------------------------------------------------------------


def many(loop: ClosedLoopModel, count: int, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return configurations and velocities near a guess."""
    return tuple(np.array(rows) for rows in zip(*(moving(loop, k, guess) for k in range(count)), strict=True))


@pytest.mark.parametrize("build", [biped, geared])
def test_a_batch_equals_single_samples(build):
    loop, count = build(), 12
    q, v = many(loop, count, standing(loop))
    rng = np.random.default_rng(0)
    prescribed = rng.normal(size=(count, 4))
    loads = {"torso": rng.normal(size=(count, 6)), "left_tail": rng.normal(size=6)}
    forces = rng.normal(size=(count, loop.model.nv))
    found = loop.hybrid_dynamics_batch(q, v, prescribed, None, loads, forces)
    assert not found.errors
    for i in range(count):
        acting = {"torso": loads["torso"][i], "left_tail": loads["left_tail"]}
        one = loop.hybrid_dynamics(q[i], v[i], prescribed[i], None, acting, forces[i])
        np.testing.assert_allclose(found.tau[i], one.tau, rtol=0, atol=1e-10 * np.abs(one.tau).max())
        np.testing.assert_allclose(found.a[i], one.a, rtol=0, atol=1e-10 * np.abs(one.a).max())
        assert found.conditioning[i] == pytest.approx(one.conditioning, rel=1e-8)
        assert np.abs(found.closure_error[i]).max() < 1e-12
    assert found.residual.max() < 1e-10
    rest = {"left_pitch": prescribed[:, 2:3], "right_pitch": [0.5]}
    by_name = loop.hybrid_dynamics_batch(q, v, {"left_yaw": 1.0, "right_yaw": prescribed[:, 1]} | rest)
    assert not by_name.errors
    at = [
        loop.model.idx_vs[loop.model.getJointId(name)] for name in ("left_yaw", "left_pitch", "right_pitch")
    ]
    expected = [np.ones(count), prescribed[:, 2], np.full(count, 0.5)]
    np.testing.assert_allclose(by_name.a[:, at].T, expected, rtol=0, atol=1e-9)


def test_a_batch_is_done_by_arrays(monkeypatch):
    loop = biped()
    q, v = many(loop, 20, standing(loop))
    monkeypatch.setattr(loop, "hybrid_dynamics", None)  # all samples are done without it
    assert not loop.hybrid_dynamics_batch(q, v, np.ones((20, 4))).errors


def test_samples_that_fail_are_told_and_the_others_are_there():
    loop, count = biped(), 10
    q, v = many(loop, count, standing(loop))
    q = q.copy()
    q[3, loop.model.idx_qs[loop.model.getJointId("left_swing")]] += 1.0
    q[6, loop.model.idx_qs[loop.model.getJointId("left_knee")]] += 0.5
    found = loop.hybrid_dynamics_batch(q, v, np.ones((count, 4)))
    assert set(found.errors) == {6}
    assert isinstance(found.errors[6], InputError)
    assert np.isnan(found.tau).all(axis=1).nonzero()[0].tolist() == [6]
    expected = loop.hybrid_dynamics(q[3], v[3], np.ones(4)).tau
    np.testing.assert_allclose(found.tau[3], expected, rtol=1e-10)
    early = loop.hybrid_dynamics_batch(q, v, {"left_pitch": 1.0}, stop=True)
    assert set(early.errors) == {0}
    assert isinstance(early.errors[0], DynamicsError)


def test_a_batch_with_frames_and_of_other_sizes():
    loop, count = biped(), 9
    q, v = many(loop, count, standing(loop))
    lift = np.array([np.nan, np.nan, 3.0, np.nan, -1.0, np.nan])
    wanted = {"left_pitch": np.arange(9.0), "right_yaw": -2.0}
    found = loop.hybrid_dynamics_batch(q, v, wanted, {"torso": lift})
    assert not found.errors
    one = loop.hybrid_dynamics(q[4], v[4], {"left_pitch": 4.0, "right_yaw": -2.0}, {"torso": lift})
    np.testing.assert_allclose(found.tau[4], one.tau, rtol=1e-12)


@pytest.mark.parametrize(
    ("prescribed", "message"),
    [
        (np.ones((3, 4)), r"prescribed: expected|prescribed left_yaw: expected shape \(2,"),
        (np.ones(4), r"prescribed: expected shape \(2, 4\)"),
        ({"left_yaw": [1.0, 2.0, 3.0]}, r"prescribed left_yaw: expected shape \(2,\)"),
        ({"base": np.ones((3, 6))}, r"prescribed base: expected shape \(2, 6\)"),
        ({"left_yam": 1.0}, "the joint 'left_yam' does not exist"),
    ],
)
def test_bad_prescriptions_of_a_batch_are_refused(prescribed, message):
    loop = biped()
    q, v = many(loop, 2, standing(loop))
    with pytest.raises(InputError, match=message):
        loop.hybrid_dynamics_batch(q, v, prescribed)


def test_inverse_dynamics_of_many_samples_is_done_by_arrays_with_idle_freedoms_too(monkeypatch):
    """Motions whose idle freedoms move as they must have forces; one that does not is refused alone."""
    loop, count = biped(), 20
    q, v = many(loop, count, standing(loop))
    found = loop.hybrid_dynamics_batch(q, v, np.random.default_rng(0).normal(size=(count, 4)))
    a = found.a.copy()
    a[7, loop.model.idx_vs[loop.model.getJointId("left_swing")]] += 1.0
    single, alone = loop._tree.inverse_dynamics, []
    monkeypatch.setattr(loop._tree, "inverse_dynamics", lambda *args: alone.append(1) or single(*args))
    forces = loop.inverse_dynamics_batch(q, v, a)
    assert len(alone) == 1
    assert set(forces.errors) == {7}
    assert isinstance(forces.errors[7], DynamicsError)
    good = np.arange(count) != 7
    np.testing.assert_allclose(
        forces.tau[good], found.tau[good], rtol=0, atol=1e-9 * np.nanmax(np.abs(found.tau))
    )
    assert forces.conditioning[good].min() > 0.0
    for i in (0, 3):
        one = loop.inverse_dynamics(q[i], v[i], a[i])
        np.testing.assert_allclose(forces.tau[i], one.tau, rtol=0, atol=1e-10 * np.abs(one.tau).max())
        assert forces.conditioning[i] == pytest.approx(one.conditioning, rel=1e-10)


def test_frames_are_prescribed_at_many_samples_by_arrays(monkeypatch):
    """Base and hands by components: the forces of each sample, and its evidence."""
    loop, count = biped(), 24
    q, v = many(loop, count, standing(loop))
    wanted = np.full((count, 6), np.nan)
    wanted[:, :2] = np.random.default_rng(3).normal(size=(count, 2))
    joints = {name: np.linspace(-1, 1, count) for name in loop.actuated[:2]}
    alone = [
        loop.hybrid_dynamics(q[i], v[i], {k: x[i] for k, x in joints.items()}, {"torso": wanted[i]})
        for i in range(count)
    ]
    monkeypatch.setattr(loop, "hybrid_dynamics", None)  # all samples are done without it
    found = loop.hybrid_dynamics_batch(q, v, joints, {"torso": wanted})
    assert not found.errors
    for i, one in enumerate(alone):
        size = max(np.abs(one.tau).max(), np.abs(one.lambda_).max())
        np.testing.assert_allclose(found.tau[i], one.tau, rtol=0, atol=1e-9 * size)
        np.testing.assert_allclose(found.a[i], one.a, rtol=0, atol=1e-8 * np.abs(one.a).max())
        assert found.conditioning[i] == pytest.approx(one.conditioning, rel=1e-8)
    sent = pickle.loads(pickle.dumps(found))  # noqa: S301 - our own
    np.testing.assert_array_equal(sent.conditioning, found.conditioning)


def test_components_of_frames_that_change_are_done_one_by_one():
    loop, count = biped(), 12
    q, v = many(loop, count, standing(loop))
    wanted = np.full((count, 6), np.nan)
    wanted[:, :2] = 0.5
    wanted[::2, 1], wanted[::2, 2] = np.nan, 0.5
    joints = {name: np.zeros(count) for name in loop.actuated[:2]}
    found = loop.hybrid_dynamics_batch(q, v, joints, {"torso": wanted})
    for i in range(count):
        one = loop.hybrid_dynamics(q[i], v[i], {k: x[i] for k, x in joints.items()}, {"torso": wanted[i]})
        np.testing.assert_array_equal(found.tau[i], one.tau)
    assert not found.errors
