"""Many samples at once are the single samples, for any robot, and what is special about one is not lost."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import FIVE_BAR_SIDECAR, FOUR_BAR, FOUR_BAR_SIDECAR
from hypothesis import given, settings
from machines import SEEDS, conditioning, random_machine, random_states

import p3dof
from p3dof._base.errors import AssemblyError, InputError, ReachError, SingularityError
from p3dof.closed_form import kinematics
from p3dof.loops import ClosedLoopModel, Sidecar
from p3dof.loops.batch.assembly import FrameTargets
from p3dof.loops.batch.kinematics import ClosureRows, Sweep
from p3dof.loops.closed_tree import ClosedTree
from p3dof.loops.coordinates import rotation_vector, turned_rates
from p3dof.loops.linear import BLOCK, FEW, independent_rows, inverse
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import PAPER, Friction
from p3dof.methods import pinocchio
from p3dof.methods.pinocchio import PinocchioMethod

ROUGH = Friction({"sliders": 20, "joints": 0.3}, {"sliders": 5, "joints": 0.2, "universal_a": 0.7})


def two_arms() -> tuple[ClosedLoopModel, np.ndarray]:
    model, guess = robots.two_arms()
    loop = ClosedLoopModel(model, Sidecar(robots.TWO_ARMS, tuple(str(name) for name in model.names[1:15])))
    return loop, loop.assemble(None, guess=guess).q


def built(name: str) -> tuple[ClosedLoopModel, np.ndarray]:
    """A robot and a configuration in the middle of its motion."""
    if name == "two_arms":
        return two_arms()
    if name == "arm":
        model = robots.arm_model()
        return ClosedLoopModel(model, Sidecar.serial(model)), np.array([0.1, -0.3, 0.2, -2.0, 0.15, 1.9, 0.4])
    place = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.05, -0.03, 0.6]))
    angles = robots.four_bar_q(0.9, *FOUR_BAR)
    xml, sidecar, q = {
        "four_bar": lambda: (robots.four_bar(*FOUR_BAR), FOUR_BAR_SIDECAR, angles),
        "circles": lambda: (
            robots.four_bar(*FOUR_BAR, kind="continuous"),
            FOUR_BAR_SIDECAR,
            np.column_stack((np.cos(angles), np.sin(angles))).ravel(),
        ),
        "five_bar": lambda: (robots.five_bar(), FIVE_BAR_SIDECAR, robots.five_bar_q(2.0, 1.2)),
        "sarrus": lambda: (robots.sarrus(), robots.SARRUS_SIDECAR, 0.2 * np.array([1.0, -2.0, 1.0] * 2)),
        "bennett": lambda: (robots.bennett(), robots.BENNETT_SIDECAR, np.zeros(4)),
        "parallelogram": lambda: (
            robots.parallelogram(),
            robots.PARALLELOGRAM_SIDECAR,
            0.4 * np.array([1.0, -1.0, 1.0]),
        ),
        "hexapod": lambda: (robots.hexapod(), robots.HEXAPOD_SIDECAR, None),
    }[name]()
    loop = ClosedLoopModel.from_urdf(xml, sidecar)
    return loop, robots.hexapod_q(place, loop.model) if q is None else q


ROBOTS = [
    "four_bar",
    "circles",
    "five_bar",
    "sarrus",
    "bennett",
    "parallelogram",
    "hexapod",
    "two_arms",
    "arm",
]
DETERMINED = [*ROBOTS[:7], "arm"]


def joint_values(loop: ClosedLoopModel, q: np.ndarray) -> np.ndarray:
    """Values of the actuated joints, an angle for a circle."""
    values = []
    for name in loop.actuated:
        j = loop.model.getJointId(name)
        i = loop.model.idx_qs[j]
        values.append(np.arctan2(q[i + 1], q[i]) if loop.model.nqs[j] == 2 else q[i])
    return np.array(values)


def joint_motion(loop, q, count, spread=0.1, seed=0):
    generator = np.random.default_rng(seed)
    middle = joint_values(loop, q)
    shape = (count, len(middle))
    return middle + generator.uniform(-spread, spread, shape), *generator.normal(size=(2, *shape))


@pytest.fixture
def alone(monkeypatch):
    """Counts the samples that are treated alone."""
    calls = {"complete": 0, "inverse_dynamics": 0}
    for name in calls:
        real = getattr(ClosedTree, name)

        def counting(self, *args, _name=name, _real=real, **kwargs):
            calls[_name] += 1
            return _real(self, *args, **kwargs)

        monkeypatch.setattr(ClosedTree, name, counting)
    return calls


# --- the kinematics under it --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*ROBOTS, "pendulum"])
def test_closures_of_many_configurations_are_those_of_each(name):
    """Errors, Jacobian and drift, also where the loops are open."""
    loop, q = built(name) if name != "pendulum" else (ClosedLoopModel.from_urdf(*robots.pendulum("6d")), None)
    q = pin.neutral(loop.model) if q is None else q
    generator, k = np.random.default_rng(0), loop._tree.kinematics
    moved = np.array(
        [pin.integrate(loop.model, q, 0.2 * dq) for dq in generator.normal(size=(9, loop.model.nv))]
    )
    v = generator.normal(size=(9, loop.model.nv))
    sweep = Sweep(loop.model)
    rows = ClosureRows(k, sweep)
    samples = sweep.moving(moved, v)
    frames = rows.frames(samples)
    J, drift = rows.jacobian(moved, samples, frames), rows.drift(moved, samples, frames, v)
    errors = rows.errors(moved, frames)
    for i in range(9):
        point = k.at(moved[i])
        np.testing.assert_allclose(J[i], point.J, rtol=0, atol=1e-14)
        np.testing.assert_allclose(errors[i], point.error, rtol=0, atol=1e-14)
        k.move(moved[i], v[i])
        np.testing.assert_allclose(drift[i], k.acceleration(), rtol=0, atol=1e-12)


def test_a_sweep_is_pinocchio():
    loop, q = built("hexapod")
    model, data = loop.model, loop.model.createData()
    v, a = np.random.default_rng(0).normal(size=(2, 1, model.nv))
    sweep = Sweep(model)
    samples = sweep.moving(q[None], v)
    pin.forwardKinematics(model, data, q, v[0], a[0])
    twists = sweep.twists(samples.J, v)[0]
    rates = (sweep.twists(samples.J, a) + sweep.twists(samples.J_dot, v))[0]
    for i in range(1, model.njoints):
        np.testing.assert_array_equal(samples.R[0, i], data.oMi[i].rotation)
        np.testing.assert_array_equal(samples.p[0, i], data.oMi[i].translation)
        np.testing.assert_allclose(twists[i], data.oMi[i].act(data.v[i]).vector, rtol=0, atol=1e-13)
        np.testing.assert_allclose(rates[i], data.oMi[i].act(data.a[i]).vector, rtol=0, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.02, 0.3, 2.9])
def test_rotation_vectors_are_pinocchios(angle):
    axis = np.array([0.6, 0.0, 0.8])
    turn = rotation_vector(pin.exp3(angle * axis)[None])[0]
    np.testing.assert_allclose(turn, angle * axis, rtol=0, atol=1e-14)
    np.testing.assert_allclose(turned_rates(turn), pin.Jlog3(pin.exp3(turn)).T, rtol=0, atol=1e-12)


def test_singular_matrices_do_not_spoil_the_others():
    A = np.array([np.eye(2), np.ones((2, 2)), 2 * np.eye(2)])
    K = inverse(A)
    assert np.isnan(K[1]).all()
    np.testing.assert_array_equal(K[[0, 2]], [np.eye(2), np.eye(2) / 2])
    assert independent_rows(np.array([[1.0, 0], [2, 0], [0, 1e-9], [1, 1]]), 2).tolist() == [1, 3]
    assert independent_rows(np.array([[1.0, 0], [2, 0]]), 2).tolist() == [1]


# --- any robot ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DETERMINED)
def test_states_at_joint_values_are_those_of_each_sample(name, alone):
    loop, q = built(name)
    targets, velocity, acceleration = joint_motion(loop, q, 40)
    found = loop.complete_batch(targets, velocity, acceleration, guess=q)
    assert alone["complete"] == 0
    assert not found.errors
    for i in range(40):
        one = loop.complete(targets[i], velocity[i], acceleration[i], guess=q)
        assert one.same_assembly
        assert found.same_assembly[i]
        assert np.abs(pin.difference(loop.model, one.q, found.q[i])).max() < 1e-12
        np.testing.assert_allclose(found.v[i], one.v, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.a[i], one.a, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_forces_are_those_of_each_sample(name, alone):
    """With a wrench on the last frame and forces in the joints; robots with spare actuators too."""
    loop, q = built(name)
    generator = np.random.default_rng(1)
    if name == "two_arms":
        one = loop.assemble(None, guess=q).q
        states = np.tile(one, (12, 1)), *np.zeros((2, 12, loop.model.nv))
    else:
        found = loop.complete_batch(*joint_motion(loop, q, 12), guess=q)
        states = found.q, found.v, found.a
    push = {loop.model.frames[loop.model.nframes - 1].name: generator.normal(size=(12, 6))}
    forces = (
        generator.normal(size=(12, loop.model.nv)) if name != "two_arms" else np.zeros((12, loop.model.nv))
    )
    alone["inverse_dynamics"] = 0
    result = loop.inverse_dynamics_batch(*states, push, forces)
    assert alone["inverse_dynamics"] == (12 if name == "two_arms" else 0)
    power = loop.power_batch(*states)
    for i, state in enumerate(zip(*states, strict=True)):
        one = loop.inverse_dynamics(*state, {name: w[i] for name, w in push.items()}, forces[i])
        largest = max(1.0, np.abs(one.tau).max())
        np.testing.assert_allclose(result.tau[i], one.tau, rtol=0, atol=1e-12 * largest)
        assert result.conditioning[i] == pytest.approx(one.conditioning, rel=1e-11)
        assert result.residual[i] < 1e-11 * largest
        np.testing.assert_allclose(result.closure_error[i], loop.closure_error(state[0]), rtol=0, atol=1e-15)
        assert power[i] == pytest.approx(loop.power(*state), rel=1e-12, abs=1e-12)


def test_a_four_bar_turns_round_in_any_order():
    """Joints in closed form: no sample falls into the other assembly, however far it is from the next."""
    loop, q = built("four_bar")
    theta = np.random.default_rng(3).uniform(-3.1, 3.1, 400)
    found = loop.complete_batch(theta[:, None], np.zeros((400, 1)), np.zeros((400, 1)), guess=q)
    expected = np.array([robots.four_bar_q(t, *FOUR_BAR) for t in theta])
    difference = (found.q - expected + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(difference).max() < 1e-12
    assert found.same_assembly.all()


@pytest.mark.parametrize("mask", [[True] * 6, [True, True, True, False, False, False]])
def test_frame_targets_with_and_without_a_determined_motion(mask, alone):
    loop, q = built("hexapod")
    generator, count, size = np.random.default_rng(2), 12, sum(mask)
    positions = np.array([0.05, -0.03, 0.6]) + generator.uniform(-0.02, 0.02, (count, 3))
    rotations = np.array([pin.exp3(w) for w in generator.uniform(-0.2, 0.2, (count, 3))])
    targets = FrameTargets("corner_2", positions, rotations, mask)
    velocity, acceleration = generator.normal(size=(2, count, size))
    found = loop.complete_batch(targets, velocity, acceleration, guess=q)
    assert alone["complete"] == (0 if size == 6 else count)
    data = loop.model.createData()
    for i in range(count):
        pin.forwardKinematics(loop.model, data, found.q[i], found.v[i], found.a[i])
        pin.updateFramePlacements(loop.model, data)
        frame = (loop.model, data, loop.model.getFrameId("corner_2"), pin.LOCAL_WORLD_ALIGNED)
        M = data.oMf[loop.model.getFrameId("corner_2")]
        error = np.concatenate((M.translation - positions[i], pin.log3(M.rotation @ rotations[i].T)))
        assert np.abs(error[mask]).max() < 1e-13
        np.testing.assert_allclose(pin.getFrameVelocity(*frame).vector[mask], velocity[i], rtol=0, atol=1e-12)
        moving = pin.getFrameClassicalAcceleration(*frame).vector[mask]
        np.testing.assert_allclose(moving, acceleration[i], rtol=0, atol=1e-11)
        assert np.abs(loop.closure_jacobian(found.q[i]) @ found.v[i]).max() < 1e-12


def test_a_masked_rotation_far_from_the_others(alone):
    """The frame turns about axes that are not prescribed: rates of the residual are not velocities there."""
    whole, q = built("arm")
    model = pin.buildReducedModel(whole.model, [3, 5, 7], q)
    q = q[[0, 1, 3, 5]]
    loop, data = ClosedLoopModel(model, Sidecar.serial(model)), model.createData()
    hand = model.getFrameId("panda_hand")
    pin.framesForwardKinematics(model, data, q)
    place = data.oMf[hand].copy()
    generator = np.random.default_rng(0)
    positions = place.translation + generator.uniform(-0.01, 0.01, (20, 3))
    tilted = np.tile(pin.exp3(np.array([0.3, 0.0, -0.2])) @ place.rotation, (20, 1, 1))
    mask = np.array([True, True, True, False, True, False])
    velocity, acceleration = generator.normal(size=(2, 20, 4))
    targets = FrameTargets("panda_hand", positions, tilted, mask)
    found = loop.complete_batch(targets, velocity, acceleration, guess=q)
    assert alone["complete"] == 0
    for i in range(20):
        pin.forwardKinematics(model, data, found.q[i], found.v[i], found.a[i])
        pin.updateFramePlacements(model, data)
        turn = pin.log3(data.oMf[hand].rotation @ tilted[i].T)
        assert abs(turn[1]) < 1e-13
        assert np.abs(turn).max() > 0.1
        frame = (model, data, hand, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(pin.getFrameVelocity(*frame).vector[mask], velocity[i], rtol=0, atol=1e-12)
        moving = pin.getFrameClassicalAcceleration(*frame).vector[mask]
        np.testing.assert_allclose(moving, acceleration[i], rtol=0, atol=1e-10)


def test_what_fails_alone_fails_alone():
    loop = ClosedLoopModel.from_urdf(robots.four_bar(0.5, 0.4, 0.35, 0.3), FOUR_BAR_SIDECAR)
    q = robots.four_bar_q(0.6, 0.5, 0.4, 0.35, 0.3)
    targets, velocity, acceleration = joint_motion(loop, q, 20)
    targets[[4, 11]] = 2.5  # coupler and rocker are too short
    found = loop.complete_batch(targets, velocity, acceleration, guess=q)
    assert sorted(found.errors) == [4, 11]
    assert all(isinstance(error, AssemblyError) for error in found.errors.values())
    assert np.isnan(found.q).any(axis=1).nonzero()[0].tolist() == [4, 11]
    assert found.same_assembly.sum() == 18
    first = loop.complete_batch(targets, velocity, acceleration, guess=q, stop=True)
    assert list(first.errors) == [4]


def test_the_dead_point_among_others():
    xml = robots.four_bar(0.5, 0.4, 0.35, 0.3)
    loop = ClosedLoopModel.from_urdf(xml, FOUR_BAR_SIDECAR)
    rocker = ClosedLoopModel.from_urdf(xml, Sidecar(FOUR_BAR_SIDECAR.closures, ("rocker_joint",)))
    theta = np.arccos((0.5**2 + 0.4**2 - 0.65**2) / (2 * 0.5 * 0.4))
    along = np.arctan2(-0.4 * np.sin(theta), 0.5 - 0.4 * np.cos(theta))
    dead = np.array([theta, along - theta, along - np.pi])
    q = np.array([rocker.assemble([dead[2] + bend], guess=dead).q for bend in np.linspace(0.1, 0.4, 10)])
    q[[0, 6]] = dead  # the first one is where the independent rows are looked for
    zero = np.zeros((10, 3))
    result = loop.inverse_dynamics_batch(q, zero, zero)
    assert sorted(result.errors) == [0, 6]
    assert all(isinstance(error, SingularityError) for error in result.errors.values())
    for i in (1, 2, 9):
        np.testing.assert_allclose(result.tau[i], loop.inverse_dynamics(q[i], *zero[:2]).tau, rtol=1e-11)
    assert list(loop.inverse_dynamics_batch(q, zero, zero, stop=True).errors) == [0]


def test_a_motion_that_opens_the_loops_is_an_error_of_its_sample():
    loop, q = built("four_bar")
    states = loop.complete_batch(*joint_motion(loop, q, 10), guess=q)
    v = states.v.copy()
    v[3, 1] += 1e-3
    result = loop.inverse_dynamics_batch(states.q, v, states.a)
    assert "v: opens the closure coupler_tip/rocker_tip" in str(result.errors.pop(3))
    assert not result.errors
    assert np.isfinite(np.delete(result.tau, 3, axis=0)).all()


def test_masses_and_gravity_are_read_at_every_call():
    loop, q = built("sarrus")
    states = loop.complete_batch(*joint_motion(loop, q, 10), guess=q)
    before = loop.inverse_dynamics_batch(states.q, states.v, states.a).tau
    loop.model.gravity.linear = np.array([0.0, 0.0, -1.6])
    after = loop.inverse_dynamics_batch(states.q, states.v, states.a).tau
    alone = [loop.inverse_dynamics(*row).tau for row in zip(states.q, states.v, states.a, strict=True)]
    np.testing.assert_allclose(after, alone, rtol=1e-12)
    assert np.abs(after - before).min() > 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": np.zeros((10, 2))}, r"target: expected shape \(N, 1\), got \(10, 2\)"),
        ({"target": np.full((10, 1), np.nan)}, "target: expected finite numbers"),
        ({"velocity": np.zeros((9, 1))}, r"velocity: expected shape \(10, 1\), got \(9, 1\)"),
        ({"acceleration": np.zeros(10)}, r"acceleration: expected shape \(10, 1\)"),
        ({"guess": np.zeros(4)}, r"guess: expected shape \(3,\)"),
    ],
)
def test_complete_batch_refuses(change, message):
    loop, _ = built("four_bar")
    arguments = {
        "target": np.zeros((10, 1)),
        "velocity": np.zeros((10, 1)),
        "acceleration": np.zeros((10, 1)),
    }
    with pytest.raises(InputError, match=message):
        loop.complete_batch(**(arguments | change))


def test_inverse_dynamics_batch_and_frame_targets_refuse():
    loop, q = built("hexapod")
    q, zero = np.tile(q, (9, 1)), np.zeros((9, loop.model.nv))
    with pytest.raises(InputError, match="q: not normalised"):
        loop.inverse_dynamics_batch(2 * q, zero, zero)
    with pytest.raises(InputError, match="external: expected a mapping"):
        loop.inverse_dynamics_batch(q, zero, zero, [1.0])
    with pytest.raises(InputError, match="external: the frame 'nowhere' does not exist"):
        loop.inverse_dynamics_batch(q, zero, zero, {"nowhere": np.zeros(6)})
    with pytest.raises(InputError, match=r"external platform: expected shape \(9, 6\), got \(8, 6\)"):
        loop.inverse_dynamics_batch(q, zero, zero, {"platform": np.zeros((8, 6))})
    with pytest.raises(InputError, match="joint_forces: expected shape"):
        loop.inverse_dynamics_batch(q, zero, zero, None, np.zeros(3))
    with pytest.raises(InputError, match="rotations: number 1 is not a rotation"):
        FrameTargets("platform", np.zeros((2, 3)), np.array([np.eye(3), -np.eye(3)]))
    with pytest.raises(InputError, match="mask: expected six bools"):
        FrameTargets("platform", np.zeros((1, 3)), np.eye(3)[None], [True])
    missing = FrameTargets("nowhere", np.zeros((1, 3)), np.eye(3)[None])
    with pytest.raises(InputError, match="target: the frame 'nowhere' does not exist"):
        loop.complete_batch(missing, np.zeros((1, 6)), np.zeros((1, 6)))


# --- this machine -------------------------------------------------------------------------------------------


def route(machine, pose, velocity, acceleration, wrench=None, one_by_one=False, progress=None, **options):
    """The Pinocchio route, past the checks of the facade."""
    dynamics = PinocchioMethod(machine.parameters, machine.bare_loop)
    states = states_of(pose, velocity, acceleration, wrench=wrench, **options)
    if not one_by_one:
        return dynamics.solve(states, progress)
    parts = [dynamics.solve(states.of_rows(np.array([i]), states.on_invalid)) for i in range(len(pose))]
    return [np.concatenate([getattr(part, name) for part in parts]) for name in EVIDENCE]


EVIDENCE = ("forces", "closure_error", "energy_rate", "dissipation")


@settings(max_examples=12, deadline=None)
@given(SEEDS)
def test_the_route_is_the_same_together_and_one_by_one(seed):
    """Random machines with friction, a wrench, and poses over the whole reach in random order."""
    machine = p3dof.load(replace(random_machine(seed), friction=ROUGH))
    s = random_states(machine.parameters, seed, 30)
    together = route(machine, s.pose, s.velocity, s.acceleration, s.wrench)
    forces, gap, energy, lost = route(machine, s.pose, s.velocity, s.acceleration, s.wrench, one_by_one=True)
    largest = np.abs(forces).max()
    allowed = 1e-13 * conditioning(machine.parameters.geometry, s.pose)[:, None] * largest
    assert np.all(np.abs(together.forces - forces) <= allowed)
    size = machine.parameters.geometry.L
    assert max(together.closure_error.max(), gap.max()) < 1e-13 * max(1.0, size)
    np.testing.assert_allclose(together.energy_rate, energy, rtol=0, atol=1e-11 * np.abs(energy).max())
    np.testing.assert_allclose(together.dissipation, lost, rtol=0, atol=1e-11 * np.abs(lost).max())


@settings(max_examples=8, deadline=None)
@given(SEEDS)
def test_joints_are_those_of_the_working_assembly_everywhere(seed):
    """Against the closed form, near the folds where assemblies meet, in random order."""
    machine = p3dof.load(random_machine(seed))
    near = {"drop": 0.1, "angle": 0.1}
    s = random_states(machine.parameters, seed, 150, drop=0.01, angle=1e-4, near=near)
    found = route(machine, s.pose, s.velocity, s.acceleration).joints
    motion = kinematics.mechanism_motion(machine.parameters.geometry, s.pose, s.velocity, s.acceleration)
    expected = np.column_stack([motion.position[name] for name in found.names])
    turns = np.char.startswith(found.names, "hinge")
    difference = np.where(turns, np.angle(np.exp(1j * (found.q - expected))), found.q - expected)
    assert np.abs(difference).max() < 1e-11 * max(1.0, machine.parameters.geometry.L)


def test_a_motion_needs_no_sample_alone(alone):
    robot, motion = p3dof.load(), p3dof.paper_motion(BLOCK + 200)
    given = motion.pose, motion.velocity, motion.acceleration
    together = route(robot, *given)
    shuffled = np.random.default_rng(0).permutation(len(motion))
    mixed = route(robot, *(array[shuffled] for array in given))
    assert alone == {"complete": 0, "inverse_dynamics": 0}
    expected = robot.forces(*given, method="virtual-power")
    largest = np.abs(expected).max()
    assert np.abs(together.forces - expected).max() < 1e-13 * largest
    assert np.abs(mixed.forces - expected[shuffled]).max() < 1e-13 * largest
    for solution in (together, mixed):
        assert solution.closure_error.max() < 1e-14
        powers = np.sum(
            solution.forces * solution.joints.columns(("slide_a", "slide_b", "slide_c")).v, axis=1
        )
        assert np.abs(powers - solution.energy_rate).max() < 1e-12 * np.abs(powers).max()


@pytest.mark.parametrize("count", [0, 1, FEW - 1, FEW, FEW + 1, 70])
def test_any_number_of_samples(count):
    robot = p3dof.load(replace(PAPER, friction=ROUGH))
    s = random_states(PAPER, 5, 70)
    pose = np.repeat(s.pose[:1], count, axis=0) if count == FEW else s.pose[:count]  # once all the same
    told = []
    solution = route(
        robot, pose, s.velocity[:count], s.acceleration[:count], progress=lambda *n: told.append(n)
    )
    assert solution.forces.shape == (count, 3)
    expected = robot.forces(pose, s.velocity[:count], s.acceleration[:count], method="virtual-power")
    np.testing.assert_allclose(solution.forces, expected, rtol=0, atol=1e-9)
    assert told[-1] == (count, count)
    assert told[0] == (0, count)


def test_bad_samples_among_good_ones():
    """Out of reach, singular, not a number: each is what it is alone, and the others do not notice."""
    robot, count = p3dof.load(), 30
    motion = p3dof.paper_motion(count)
    pose = motion.pose.copy()
    pose[21, 0], pose[12], pose[5] = 0.3, [0, 0, np.pi / 3], np.nan
    given = pose, motion.velocity, motion.acceleration
    solution = route(robot, *given, on_invalid="nan")
    assert np.isnan(solution.forces).all(axis=1).nonzero()[0].tolist() == [5, 12, 21]
    for name in EVIDENCE:
        assert np.isnan(getattr(solution, name)).reshape(count, -1).all(axis=1).nonzero()[0].tolist() == [
            5,
            12,
            21,
        ]
    good = np.setdiff1d(np.arange(count), [5, 12, 21])
    expected = robot.forces(*(array[good] for array in given), method="virtual-power")
    assert np.abs(solution.forces[good] - expected).max() < 1e-13 * np.abs(expected).max()
    pose[5] = motion.pose[5]
    with pytest.raises(ReachError, match=r"leg A is too short by 0\.05 m \(sample 21, the first") as info:
        route(robot, *given)
    assert (info.value.index, info.value.leg) == ((21,), "a")
    assert abs(info.value.margin + 0.05) < 1e-15
    pose[21, 0] = 0.1
    with pytest.raises(SingularityError, match=r"actuation-singular.*sample 12, the first of 1") as info:
        route(robot, *given)
    assert info.value.index == (12,)
    pose[21, 0] = 0.3
    wrench = np.zeros((count, 6))
    wrench[7, 2] = np.nan
    assert np.isnan(route(robot, *given, wrench, on_invalid="nan").forces[7]).all()


def test_copies_in_threads_give_the_same():
    robot, s = p3dof.load(), random_states(PAPER, 8, 200)
    targets = pinocchio.targets_of(s.pose, PAPER.geometry.h)

    def forces(loop: ClosedLoopModel) -> np.ndarray:
        found = loop.complete_batch(targets, s.velocity, s.acceleration)
        return loop.inverse_dynamics_batch(found.q, found.v, found.a).tau

    expected = forces(robot.loop)
    with ThreadPoolExecutor(2) as pool:
        for tau in pool.map(forces, [robot.loop.copy() for _ in range(4)]):
            np.testing.assert_array_equal(tau, expected)


@pytest.mark.parametrize("count", [1, 8, 40])
def test_friction_in_the_cuts_where_nothing_assembles(count):
    machine = replace(p3dof.PAPER, friction=p3dof.machine.Friction(coulomb={"joints": 0.05}))
    robot, far = p3dof.load(machine), np.tile([0.2501, 0, 0], (count, 1))  # by a hair
    with pytest.raises(p3dof.errors.SampleError, match="sample 0"):
        robot.forces(far, np.zeros(3), np.zeros(3))
    assert np.isnan(robot.forces(far, np.zeros(3), np.zeros(3), on_invalid="nan")).all()


@pytest.mark.parametrize("name", ["inverse_dynamics", "hybrid_dynamics"])
def test_a_last_block_of_one_sample(name):
    """Pinocchio returns the forces of one sample as a vector."""
    loop, _ = built("four_bar")
    crank = np.linspace(0.4, 0.9, BLOCK + 1)[:, None]
    states = loop.complete_batch(crank, np.ones_like(crank), np.ones_like(crank))
    last = np.ones_like(crank) if name == "hybrid_dynamics" else states.a
    found = getattr(loop, f"{name}_batch")(states.q, states.v, last).tau
    alone = getattr(loop, name)(states.q[-1], states.v[-1], last[-1]).tau
    np.testing.assert_allclose(found[-1], alone, rtol=1e-9)
