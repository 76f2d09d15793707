"""Simulation, energy and reactions of other robots than the manipulator, by the very same code."""

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest

import p3dof
from p3dof._base.errors import ControllerError, InputError, ModelError
from p3dof.loops import ClosedLoopModel, ClosureJoint, ReactionSolver, reactions_batch
from p3dof.loops.coordinates import ConfigurationRates
from p3dof.machine.parameters import LINKS
from p3dof.runs.actuation import Actuation, Encoders, Noise
from p3dof.runs.integration import Integrator, Schedule, Tolerances
from p3dof.runs.margins import Stop
from p3dof.runs.plants import ConstrainedPlant

HOME = np.zeros(3)


def four_bar() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR)


def five_bar() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)


def told(*measured):
    """What a controller sees: time, period, positions, velocities, which forces were cut off."""
    return measured


class Unlimited:
    """Margins of a plant that nothing stops."""

    def __call__(self, _time, _state):
        return np.array([np.inf])

    def trend(self, time, state, _ahead):
        return self(time, state), self(time, state)


def run(
    plant, state, duration, controller=None, period=0.0, limits=None, load=None, margins=None, encoders=None
):
    """Integrate a plant, as the manipulator's runs are."""
    count = len(plant.loop.actuated)
    actuation = Actuation(
        told, controller, period, np.full(count, np.inf) if limits is None else limits, encoders
    )
    schedule = Schedule(np.linspace(0, duration, 51), period, np.zeros(0))
    load = np.zeros(6) if load is None else load
    tolerances = Tolerances(1e-11, 1e-13)
    integrator = Integrator(plant, actuation, lambda _: load, margins or Unlimited(), schedule, tolerances)
    return integrator.run(state)


def test_a_four_bar_swings_and_keeps_its_energy_and_its_loop():
    loop = four_bar()
    plant = ConstrainedPlant(loop, stabilisation=10.0)
    state = plant.checked_state(robots.four_bar_q(0.7, *robots.FOUR_BAR), np.zeros(3), 1e-9)
    record = run(plant, state, 1.0)
    assert record.stop is None
    assert record.times[-1] == 1.0
    q, v, _, gap = plant.motion(np.array(record.states), np.array(record.rates))
    energies = loop.body_energies(q, v)
    kinetic = energies.kinetic.sum(axis=-1)
    assert kinetic.max() > 3  # it does swing
    assert np.abs(energies.total - energies.total[0]).max() <= 1e-9 * kinetic.max()
    assert gap.max() <= 1e-10
    for crank, *others in q[::10]:
        turns = 2 * np.pi * np.round((others - robots.four_bar_q(crank, *robots.FOUR_BAR)[1:]) / (2 * np.pi))
        np.testing.assert_allclose(
            others - turns, robots.four_bar_q(crank, *robots.FOUR_BAR)[1:], rtol=0, atol=1e-9
        )


def test_two_motors_are_controlled_with_hold_limits_and_noise():
    """Five-bar: any number of actuators; its motors bring it to rest at new angles, cut off at first."""
    loop = five_bar()
    plant = ConstrainedPlant(loop, stabilisation=10.0)
    start, goal = np.array([1.9, 1.2]), np.array([2.0, 1.1])
    holding = loop.inverse_dynamics(robots.five_bar_q(*goal), np.zeros(4), np.zeros(4)).tau
    seen = []

    def controller(measured):
        _, period, positions, velocities, saturated = measured
        seen.append((period, positions, velocities, saturated))
        return holding + 150.0 * (goal - positions) - 15.0 * velocities

    state = plant.checked_state(robots.five_bar_q(*start), np.zeros(4), 1e-9)
    limits = np.abs(holding) + 10.0
    record = run(
        plant, state, 2.0, controller, 1e-2, limits, encoders=Encoders(1e-2, Noise(1e-9, 1e-9), np.zeros(2))
    )
    q, _, _, gap = plant.motion(np.array(record.states), np.array(record.rates))
    angles, speeds = plant.actuated(np.array(record.states[-1]))
    np.testing.assert_allclose(angles, goal, atol=1e-3)
    np.testing.assert_allclose(speeds, 0, atol=1e-3)
    np.testing.assert_allclose(q[-1], robots.five_bar_q(*angles), rtol=0, atol=1e-9)
    assert gap.max() < 1e-10
    assert np.array(record.forces).shape == (51, 2)
    assert (np.abs(record.forces) <= limits).all()
    assert np.abs(np.array(record.asked)[0]).max() > limits.min()
    assert any(saturated.any() for *_, saturated in seen)
    assert {period for period, *_ in seen} == {1e-2}
    assert seen[0][1] == pytest.approx(start, abs=1e-8)
    assert np.any(seen[0][1] != start)  # noise


def test_a_free_body_keeps_its_momentum_and_turns_under_a_load():
    """A configuration with a quaternion: no closure, no actuator."""
    loop = free_body()
    model = loop.model
    place = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))
    model.addFrame(pin.Frame("centre", 1, 0, place, pin.FrameType.OP_FRAME))
    model.gravity.linear = np.zeros(3)
    loop = ClosedLoopModel(model, loop.sidecar)
    plant = ConstrainedPlant(loop, frames=("centre",))
    tumbling = plant.checked_state(pin.neutral(model), np.array([0.1, 0.2, 0.3, 3.0, 0.2, 1.0]), 1e-9)
    record = run(plant, tumbling, 1.0)
    q, v, _, _ = plant.motion(np.array(record.states), np.array(record.rates))
    energies = loop.body_energies(q, v)
    assert np.ptp(q[:, 3:], axis=0).max() > 0.5
    for conserved in (energies.total[:, None], energies.momentum, energies.angular_momentum):
        np.testing.assert_allclose(conserved, np.tile(conserved[0], (len(q), 1)), rtol=0, atol=1e-10)
    still = plant.checked_state(pin.neutral(model), np.zeros(6), 1e-9)
    turned = run(plant, still, 1.0, load=np.array([0, 0, 0, 0, 0, 0.08]))
    q, v, a, _ = plant.motion(np.array(turned.states), np.array(turned.rates))
    np.testing.assert_allclose(v[-1, 3:], [0, 0, 2.0], rtol=0, atol=1e-10)  # M / I = 2 rad/s²
    np.testing.assert_allclose(a[:, 5], 2.0, rtol=0, atol=1e-10)
    np.testing.assert_allclose(q[-1, 5:], [np.sin(0.5), np.cos(0.5)], rtol=0, atol=1e-10)  # by 1 rad


def test_a_motor_without_end_tells_its_angle():
    """A continuous joint has cosine and sine in q."""
    text, sidecar = robots.four_bar(*robots.FOUR_BAR, kind="continuous"), robots.FOUR_BAR_SIDECAR
    loop = ClosedLoopModel.from_urdf(text, sidecar)
    assert loop.model.nq == 2 * loop.model.nv
    plant = ConstrainedPlant(loop, stabilisation=10.0)
    angles = robots.four_bar_q(0.7, *robots.FOUR_BAR)
    q = np.column_stack([np.cos(angles), np.sin(angles)]).ravel()
    record = run(plant, plant.checked_state(q, np.zeros(3), 1e-9), 0.3)
    flat = ConstrainedPlant(four_bar(), stabilisation=10.0)
    other = run(flat, flat.checked_state(angles, np.zeros(3), 1e-9), 0.3)
    for one, two in zip(record.states, other.states, strict=True):
        np.testing.assert_allclose(plant.actuated(one)[0], two[:1], rtol=0, atol=1e-9)
        np.testing.assert_allclose(plant.actuated(one)[1], two[3:4], rtol=0, atol=1e-8)
        np.testing.assert_allclose(plant.actuated(one), flat.actuated(two), rtol=0, atol=1e-8)


def test_the_rate_of_a_configuration_is_the_limit_of_pinocchios_steps():
    model, h = pin.Model(), 1e-5
    kinds = (
        pin.JointModelFreeFlyer(),
        pin.JointModelPlanar(),
        pin.JointModelRUBZ(),
        pin.JointModelSpherical(),
        pin.JointModelRX(),
        pin.JointModelTranslation(),
    )
    for i, kind in enumerate(kinds):
        model.addJoint(i, kind, pin.SE3.Identity(), f"joint {i}")
    rng = np.random.default_rng(5)
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    v = rng.normal(size=model.nv)
    change = (pin.integrate(model, q, h * v) - pin.integrate(model, q, -h * v)) / (2 * h)
    np.testing.assert_allclose(ConfigurationRates(model)(q, v), change, rtol=0, atol=1e-9)
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelSpherical())
    model.addJoint(len(kinds), composite, pin.SE3.Identity(), "wrist")
    with pytest.raises(ModelError, match=r"the joint 'wrist' \(JointModelComposite\) cannot be integrated"):
        ConfigurationRates(model)


class Ceiling:
    """The crank may not turn beyond an angle."""

    def __init__(self, angle):
        self.angle = angle

    def __call__(self, _, state):
        return np.array([self.angle - state[0]])

    def trend(self, time, state, ahead):
        return self(time, state), self(time, state) - ahead * state[3]

    def stop(self, index, time):
        return Stop("stop", time, f"crank at its stop {index}")


def test_a_limit_of_another_robot_ends_its_run():
    plant = ConstrainedPlant(four_bar(), stabilisation=10.0)
    state = plant.checked_state(robots.four_bar_q(0.7, *robots.FOUR_BAR), np.zeros(3), 1e-9)
    record = run(plant, state, 1.0, controller=[40.0], margins=Ceiling(1.5))
    assert record.stop.kind == "stop"
    assert record.times[-1] == record.stop.time < 1
    assert record.states[-1][0] == pytest.approx(1.5, abs=1e-9)


def test_bad_input_names_the_number_of_actuators():
    plant = ConstrainedPlant(five_bar())
    state = plant.checked_state(robots.five_bar_q(1.9, 1.2), np.zeros(4), 1e-9)
    with pytest.raises(InputError, match=r"controller: expected shape \(2,\), got \(3,\)"):
        run(plant, state, 0.1, controller=[1, 2, 3])
    with pytest.raises(ControllerError, match=r"expected forces of shape \(2,\), got \(3,\)"):
        run(plant, state, 0.1, controller=lambda _: [1, 2, 3])
    with pytest.raises(InputError, match=r"q: the loops are open by 0\.\d+ m"):
        plant.checked_state(np.zeros(4), np.zeros(4), 1e-9)


# --- energy -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("parameters", [p3dof.PAPER, p3dof.SOLIDS], ids=["paper", "solids"])
def test_bodies_have_the_energy_of_the_closed_forms(parameters):
    """Body by body, from the URDF by Pinocchio's kinematics, against the closed forms of the mechanism."""
    robot, motion = p3dof.load(parameters), p3dof.paper_motion(41)
    result = robot.inverse_dynamics(motion)
    expected = robot.energy(result)
    found = robot.loop.body_energies(result.joints.q, result.joints.v)
    assert len(found.names) == len(LINKS)
    order = [found.names.index(CARRIED_BY[link]) for link in LINKS]
    scale = np.abs(expected.kinetic + expected.potential).max()
    np.testing.assert_allclose(found.kinetic[:, order], expected.kinetic, rtol=0, atol=1e-12 * scale)
    shift = found.potential[:, order] - expected.potential
    np.testing.assert_allclose(shift, 0, rtol=0, atol=1e-12 * scale)
    for name in ("momentum", "angular_momentum"):
        one, other = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


CARRIED_BY = {
    "slider_a": "slide_a",
    "slider_b": "slide_b",
    "slider_c": "slide_c",
    "leg_a": "hinge_a",
    "leg_b": "hinge_b",
    "crossbar_upper": "hinge_c",
    "rod_left": "hinge_left",
    "rod_right": "hinge_right",
    "crossbar_lower": "hinge_lower",
    "platform": "hinge_platform",
}


def free_body() -> ClosedLoopModel:
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    inertia = pin.Inertia(2.0, np.array([0.1, 0.0, 0.0]), np.diag([0.02, 0.03, 0.04]))
    model.appendBodyToJoint(1, inertia, pin.SE3.Identity())
    return ClosedLoopModel(model, p3dof.Sidecar((), ()))


@pytest.mark.parametrize("make", [four_bar, five_bar, free_body])
def test_energies_are_those_of_the_mass_matrix_and_of_pinocchio(make):
    loop = make()
    rng, model = np.random.default_rng(3), loop.model
    model.armature = rng.uniform(0.1, 1.0, model.nv)
    turns = rng.uniform(-2, 2, (5, model.nv))
    q = np.array([pin.integrate(model, pin.neutral(model), turn) for turn in turns])
    v = rng.normal(size=(5, model.nv))
    found, data = loop.body_energies(q, v), model.createData()
    for i, (q_i, v_i) in enumerate(zip(q, v, strict=True)):
        M = pin.crba(model, data, q_i)
        M = np.triu(M) + np.triu(M, 1).T
        assert found.kinetic[i].sum() == pytest.approx(v_i @ M @ v_i / 2, rel=1e-13)
        potential = pin.computePotentialEnergy(model, data, q_i)
        assert found.potential[i].sum() == pytest.approx(potential, rel=1e-12, abs=1e-12)
        assert found.total[i] == pytest.approx(v_i @ M @ v_i / 2 + potential, rel=1e-12)
        h = pin.computeCentroidalMomentum(model, data, q_i, v_i)
        np.testing.assert_allclose(found.momentum[i], h.linear, rtol=0, atol=1e-12)
        about_origin = h.angular + np.cross(data.com[0], h.linear)
        np.testing.assert_allclose(found.angular_momentum[i], about_origin, rtol=0, atol=1e-12)
        one = loop.body_energies(q_i, v_i)
        np.testing.assert_array_equal(one.kinetic, found.kinetic[i])
        assert one.total == found.total[i]


def test_energies_of_what_is_no_state():
    loop = four_bar()
    for q, v in (
        (np.zeros(2), np.zeros(3)),
        (np.zeros((4, 3)), np.zeros((3, 3))),
        (np.full(3, np.nan), np.zeros(3)),
    ):
        with pytest.raises(InputError):
            loop.body_energies(q, v)


# --- reactions ----------------------------------------------------------------------------------------------


def moving_five_bar():
    """States of motion of a five-bar, with what moves it."""
    loop, rng = five_bar(), np.random.default_rng(11)
    states = [loop.complete(angles, *rng.normal(size=(2, 2))) for angles in rng.uniform(1.1, 1.9, (4, 2))]
    q, v, a = (np.array([getattr(state, name) for state in states]) for name in "qva")
    pull = {"left_near": rng.normal(size=6), "left_tip": rng.normal(size=(4, 6))}
    pull["left_tip"][:, [0, 2]] = 0.0
    return loop, (q, v, a), pull


def test_reactions_of_many_samples_are_those_of_each():
    loop, (q, v, a), pull = moving_five_bar()
    springs = np.array([0.1, -0.2, 0.3, 0.4])
    tau = loop.inverse_dynamics_batch(q, v, a, pull, springs).tau
    solver = ReactionSolver(loop, [ClosureJoint.revolute((0.0, 1.0, 0.0))])
    found = reactions_batch(solver, q, v, a, tau, pull, springs)
    assert found.names == ("left_joint", "left_elbow", "right_joint", "right_elbow", "left_tip/right_tip")
    assert not found.errors
    for i in range(4):
        here = {"left_near": pull["left_near"], "left_tip": pull["left_tip"][i]}
        one = solver.solve(q[i], v[i], a[i], tau[i], here, springs)
        for name, array in found.arrays().items():
            np.testing.assert_array_equal(array[i], getattr(one, name))
    motors = found.moments[:, [0, 2], 1]  # their axes point along -y
    np.testing.assert_allclose(-motors, tau + springs[[0, 2]], rtol=0, atol=1e-12 * np.abs(tau).max())


def test_what_a_joint_of_a_closure_exerts_itself_is_part_of_its_reaction():
    loop, (q, v, a), _ = moving_five_bar()
    friction = np.tile([0.0, 0.0, 0.0, 0.0, 0.7, 0.0], (4, 1))
    pair = {"right_tip": friction, "left_tip": -friction}
    tau = loop.inverse_dynamics_batch(q, v, a, pair).tau
    solver = ReactionSolver(loop, [ClosureJoint.revolute((0.0, 1.0, 0.0))])
    without = reactions_batch(solver, q, v, a, tau, pair)
    found = reactions_batch(solver, q, v, a, tau, pair, within={"right_tip": friction})
    np.testing.assert_allclose(without.moments[:, -1, 1], 0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.moments[:, -1, 1], 0.7, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.forces, without.forces)


def test_a_sample_without_a_solution_leaves_the_others():
    loop, (q, v, a), _ = moving_five_bar()
    tau = loop.inverse_dynamics_batch(q, v, a).tau.copy()
    tau[1] += 1.0
    q[2] = np.nan
    found = reactions_batch(ReactionSolver(loop), q, v, a, tau)
    assert list(found.errors) == [1]
    assert "the forces do not produce the motion" in str(found.errors[1])
    assert np.isnan(found.forces[[1, 2]]).all()
    assert np.isfinite(found.forces[[0, 3]]).all()
    assert not found.determined_forces[1:3].any()
    for wrong in (
        {"q": q[:, :3]},
        {"v": v[:2]},
        {"tau": tau[:, :1]},
        {"external": {"left_tip": np.zeros(3)}},
    ):
        with pytest.raises(InputError, match="expected shape"):
            reactions_batch(ReactionSolver(loop), **({"q": q, "v": v, "a": a, "tau": tau} | wrong))


@pytest.mark.parametrize(("share", "closed"), [(0.9, True), (1.2, False)])
def test_how_far_a_velocity_may_open_the_loops_goes_with_the_fastest_joint(share, closed):
    loop = four_bar()
    plant, q = ConstrainedPlant(loop), robots.four_bar_q(0.7, *robots.FOUR_BAR)
    v = np.array(loop.complete(q[:1], [300.0], [0.0], guess=q).v)
    assert np.abs(v).min() < 0.7 * np.abs(v).max()
    J = loop.closure_jacobian(q)
    v[2] += share * 1e-9 * np.abs(v).max() / np.abs(J[:, 2]).max()
    if closed:
        np.testing.assert_array_equal(plant.checked_state(q, v, 1e-9)[3:], v)
    else:
        with pytest.raises(InputError, match="v: opens the loops at"):
            plant.checked_state(q, v, 1e-9)


def test_a_robot_without_joints_has_a_state_of_no_numbers():
    stone = ClosedLoopModel.from_urdf(robots.robot(robots.link("stone")), ())
    assert ConstrainedPlant(stone).checked_state(np.zeros(0), np.zeros(0), 1e-9).shape == (0,)
