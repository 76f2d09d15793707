"""Reflected inertia and counterbalance at the sliders: as parameters, and in the dynamics everywhere."""

import copy
import dataclasses
import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from machines import SEEDS, conditioning, derivative, random_actuators, random_machine, random_states

import p3dof
from p3dof import PAPER
from p3dof._base.errors import ParameterError
from p3dof.analysis.energy import kinetic_energy, potential_energy
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled import levels
from p3dof.machine import Actuators
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import SLIDES
from p3dof.methods import pinocchio as pinocchio_method
from p3dof.methods.closed_form import coriolis_matrix, gravity_forces
from p3dof.methods.results import forces_table

METHODS = ("virtual-power", "pinocchio", "compiled")
HOME = np.zeros(3)
SHARP = p3dof.runs.Integration(rtol=1e-12, atol=1e-14)

SOME = Actuators(
    armature={"sliders": 14.8, "slide_c": 2.5},
    counterbalance={"slide_a": 48.15, "slide_c": -5},
    spring={"slide_b": -420.0},
    counterweight={"slide_b": 4.9},
)


def test_numbers_are_by_slide_and_the_group_comes_first():
    assert dict(SOME.armature) == {"slide_a": 14.8, "slide_b": 14.8, "slide_c": 2.5}
    assert dict(Actuators({"slide_c": 2.5, "sliders": 14.8}).armature) == dict(SOME.armature)
    np.testing.assert_array_equal(SOME.inertia, [14.8, 14.8 + 4.9, 2.5])
    np.testing.assert_array_equal(SOME.stiffness, [0, -420, 0])
    np.testing.assert_array_equal(SOME.balance_at_home(np.array([1, 2, -9.806])), [48.15, 4.9 * 9.806, -5])
    assert SOME.slides == ("slide_a", "slide_b", "slide_c")
    assert not Actuators({"sliders": 0})
    assert not PAPER.actuators


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"armature": {"hinge_a": 1}},
            "armature: unknown slide 'hinge_a', expected one of sliders, slide_a, ",
        ),
        ({"armature": {"slide_a": -1}}, "armature.slide_a: expected zero or more, got -1"),
        ({"counterweight": {"sliders": -0.5}}, "counterweight.sliders: expected zero or more, got -0.5"),
        ({"spring": {"slide_b": float("nan")}}, "spring.slide_b: expected a finite number, got nan"),
        ({"counterbalance": {"slide_b": "x"}}, "counterbalance.slide_b: expected real numbers"),
        ({"counterbalance": 48}, "counterbalance: expected numbers by slide, got 48"),
    ],
)
def test_errors_name_the_number(given, message):
    with pytest.raises(ParameterError) as caught:
        Actuators(**given)
    assert str(caught.value).startswith(message)


def test_parameters_hold_only_actuators():
    with pytest.raises(ParameterError, match="actuators: expected Actuators, got dict"):
        dataclasses.replace(PAPER, actuators={"armature": {"sliders": 1}})


def test_a_file_gives_the_same_machine_back(tmp_path):
    machine = dataclasses.replace(PAPER, actuators=SOME)
    path = tmp_path / "machine.yaml"
    p3dof.write_parameters(machine, path)
    for same in (
        p3dof.read_parameters(path),
        p3dof.Parameters.from_dict(machine.to_dict()),
        pickle.loads(pickle.dumps(machine)),  # noqa: S301 - our own
        copy.deepcopy(machine),
    ):
        assert same.actuators.to_dict() == SOME.to_dict()
    assert machine.carrying(PAPER.bodies.leg_a).unladen.actuators.to_dict() == SOME.to_dict()
    with pytest.raises(TypeError):
        machine.actuators.armature["slide_a"] = 1
    assert "actuators" not in PAPER.to_dict()


def test_a_file_may_have_units():
    data = {
        **PAPER.to_dict(),
        "actuators": {"armature": {"sliders": "900 g"}, "spring": {"slide_a": "2 N/mm"}},
    }
    found = p3dof.Parameters.from_dict(data).actuators
    assert found.armature["slide_b"] == 0.9
    assert found.spring["slide_a"] == 2000


def test_tables_and_pages_show_them():
    machine = dataclasses.replace(PAPER, actuators=SOME)
    table = next(t for t in p3dof.machine.parameters.parameter_tables(machine) if t.title == "Actuators")
    assert table.rows[1][:5] == ("slide_b", 14.8, 0.0, -420.0, 4.9)
    assert "counterweight [kg]" in machine._repr_html_()
    assert "counterweight [kg]" not in PAPER._repr_html_()


# The dynamics


def actuated(seed, springs=True):
    """A random machine with actuators at all sliders, about as heavy as its bodies."""
    machine = random_machine(seed)
    own = random_actuators(np.random.default_rng(seed), machine, springs)
    return dataclasses.replace(machine, actuators=own)


def without(machine):
    return dataclasses.replace(machine, actuators=Actuators())


def motion_of(states):
    return states.pose, states.velocity, states.acceleration


@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_the_methods_agree(seed):
    """Virtual powers, Pinocchio with its own armature, and the kernels: each in its own way."""
    machine = actuated(seed, springs=seed % 2 == 0)
    robot, states = p3dof.load(machine), random_states(machine, seed, 12)
    forces = {
        method: robot.forces(*motion_of(states), wrench=states.wrench, method=method) for method in METHODS
    }
    expected = forces["virtual-power"]
    bound = 1e-13 * conditioning(machine.geometry, states.pose)[:, None] * np.abs(expected).max()
    for found in forces.values():
        assert np.all(np.abs(found - expected) < bound)
    plain = p3dof.load(without(machine)).forces(*motion_of(states), wrench=states.wrench)
    moving = kinematics.mechanism_motion(machine.geometry, *motion_of(states))
    own = machine.actuators
    weights = np.array([own.counterweight.get(slide, 0) for slide in SLIDES])
    balance = np.array([own.counterbalance[slide] for slide in SLIDES]) - weights * machine.gravity[2]
    more = own.inertia * moving.slider_accelerations - balance + own.stiffness * moving.sliders
    np.testing.assert_allclose(expected, plain + more, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("method", METHODS)
def test_an_armature_is_a_heavier_slider_without_its_weight(method):
    machine, mass = p3dof.SOLIDS, 14.8044066
    drives = Actuators({"sliders": mass})
    bodies = dict(machine.bodies.items())
    for name in ("slider_a", "slider_b", "slider_c"):
        body = bodies[name]
        bodies[name] = p3dof.machine.Body(body.mass + mass, body.com, body.inertia)
    heavier = dataclasses.replace(machine, bodies=p3dof.machine.Bodies(**bodies))
    motion = p3dof.paper_motion(201)
    found, other = (
        p3dof.load(m).inverse_dynamics(motion, method=method)
        for m in (dataclasses.replace(machine, actuators=drives), heavier)
    )
    np.testing.assert_allclose(found.forces, other.forces + mass * machine.gravity[2], rtol=0, atol=6e-12)
    assert np.abs(found.power_residual).max() < 1e-10 * np.abs(found.power).max()
    plain = p3dof.load(machine).inverse_dynamics(motion, method=method)
    np.testing.assert_allclose(found.nut_forces, plain.forces, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(plain.nut_forces, plain.forces)


@given(seed=SEEDS)
@settings(max_examples=5, deadline=None)
def test_every_way_inverts_and_the_equations_of_motion_hold(seed):
    machine = actuated(seed)
    robot, states = p3dof.load(machine), random_states(machine, seed, 8)
    forces = robot.forces(*motion_of(states), wrench=states.wrench)
    M, size = robot.mass_matrix(states.pose), np.abs(states.acceleration).max()
    bound = 1e-9 * np.maximum(1, np.linalg.cond(M))[:, None] * size
    for method in METHODS:
        found = robot.forward_dynamics(
            states.pose, states.velocity, forces, wrench=states.wrench, method=method
        )
        assert np.all(np.abs(found - states.acceleration) < bound)
        np.testing.assert_allclose(
            robot.mass_matrix(states.pose, method=method), M, rtol=0, atol=1e-11 * np.abs(M).max()
        )
    bare = robot.forces(*motion_of(states))
    C, g = robot.coriolis_matrix(states.pose, states.velocity), robot.gravity_forces(states.pose)
    C_ref = coriolis_matrix(machine, states_of(states.pose, states.velocity))
    np.testing.assert_allclose(C, C_ref, rtol=0, atol=1e-9 * np.abs(C_ref).max())
    g_ref = gravity_forces(machine, states_of(states.pose))
    np.testing.assert_allclose(g, g_ref, rtol=0, atol=1e-11 * np.abs(g_ref).max())
    taken = np.einsum("nij,nj->ni", M, states.acceleration) + np.einsum("nij,nj->ni", C, states.velocity) + g
    given_ = np.einsum("nij,ni->nj", robot.jacobian(states.pose), bare)
    np.testing.assert_allclose(taken, given_, rtol=0, atol=1e-10 * np.abs(taken).max())


@pytest.mark.parametrize("symmetric", [False, True])
def test_derivatives_by_the_motion(symmetric):
    machine = dataclasses.replace(p3dof.SOLIDS, actuators=SOME) if symmetric else actuated(3)
    robot, states = p3dof.load(machine), random_states(machine, 3, 5, drop=0.3, angle=0.3)
    found = robot.force_derivatives(*motion_of(states))
    one = robot.force_derivatives(*(row[0] for row in motion_of(states)))
    for place, by in enumerate((found.by_pose, found.by_velocity, found.by_acceleration)):
        np.testing.assert_allclose(one.arrays[1 + place], by[0], rtol=1e-12, atol=1e-9)
        for column in range(3):

            def along(t, place=place, column=column):
                moved = [np.array(row) for row in motion_of(states)]
                moved[place][:, column] += t
                return robot.forces(*moved, method="virtual-power")

            expected = derivative(along, 0.0, 1e-5)
            np.testing.assert_allclose(
                by[..., column], expected, rtol=0, atol=1e-7 * max(1, np.abs(expected).max())
            )
    np.testing.assert_array_equal(
        found.by_pose[:, [0, 1, 2], 1], np.broadcast_to(machine.actuators.stiffness, (5, 3))
    )


@pytest.mark.parametrize("seed", [1, 4])
def test_forces_are_linear_in_them(seed):
    machine = actuated(seed)
    robot, states = p3dof.load(machine), random_states(machine, seed, 20)
    found = robot.force_regressor(*motion_of(states))
    forces = robot.forces(*motion_of(states), method="virtual-power")
    total = found.base @ found.base_parameters + found.actuators @ found.actuator_parameters
    np.testing.assert_allclose(total, forces, rtol=0, atol=1e-12 * np.abs(forces).max())
    assert found.actuators.shape == (20, 3, len(found.actuator_names)) == (20, 3, 9)
    moving = kinematics.mechanism_motion(machine.geometry, *motion_of(states))
    bound = 1e-12 * np.abs(moving.slider_accelerations).max()
    for leg in range(3):
        expected = np.zeros((20, 3, 3))
        expected[:, leg] = np.stack(
            [moving.slider_accelerations[:, leg], -np.ones(20), moving.sliders[:, leg]], axis=-1
        )
        np.testing.assert_allclose(found.actuators[..., leg::3], expected, rtol=0, atol=bound)
    heavier = dataclasses.replace(machine, gravity=machine.gravity + np.array([0, 0, 1.0]))
    change = p3dof.load(heavier).forces(*motion_of(states)) - forces
    np.testing.assert_allclose(found.by_gravity[..., 2], change, rtol=0, atol=1e-10 * np.abs(forces).max())
    for axis, name in enumerate("rRL"):

        def stretched(t, name=name):
            geometry = dataclasses.replace(machine.geometry, **{name: getattr(machine.geometry, name) + t})
            longer = dataclasses.replace(machine, geometry=geometry)
            return p3dof.load(longer).forces(*motion_of(states), method="virtual-power")

        expected = derivative(stretched, 0.0, 1e-4 * machine.geometry.r)
        np.testing.assert_allclose(
            found.by_lengths[..., axis], expected, rtol=0, atol=1e-6 * np.abs(expected).max()
        )


@pytest.mark.parametrize("method", METHODS)
def test_energy_balances(method):
    machine = dataclasses.replace(
        actuated(5), friction=p3dof.machine.Friction({"sliders": 3.0, "joints": 0.1}, {"slide_a": 2.0})
    )
    robot = p3dof.load(machine)
    motion = p3dof.Motion.rest_to_rest([0, 0, 0], np.array([0.05, 0.1, 0.1]) * machine.geometry.L, 1.0, 401)
    found = robot.inverse_dynamics(motion, method=method)
    assert np.abs(found.power_residual).max() < 1e-10 * np.abs(found.power).max()
    energy = robot.energy(found)
    assert np.abs(energy.balance).max() < 1e-8 * energy.scale
    assert energy.bodies[10:] == ("actuator_a", "actuator_b", "actuator_c")
    slides = found.slider_velocities
    np.testing.assert_allclose(energy.kinetic[:, 10:], machine.actuators.inertia * slides**2 / 2, rtol=1e-12)
    assert energy.kinetic[:, 10:].sum(axis=1).max() > 0.3 * energy.kinetic_total.max()
    assert p3dof.load(without(machine)).energy(robot.inverse_dynamics(motion)).kinetic.shape[1] == 10


def test_pinocchio_has_the_armature_itself():
    machine = actuated(7)
    robot, states = p3dof.load(machine), random_states(machine, 7, 4)
    energies = kinetic_energy(machine, states.pose, states.velocity).sum(axis=-1)
    model = robot.loop.model
    data = model.createData()
    for i in range(4):
        target = pinocchio_method.target_of(states.pose[i], machine.geometry.h)
        state = robot.loop.complete(target, states.velocity[i], np.zeros(3))
        own = pin.computeKineticEnergy(model, data, state.q, state.v)
        assert own == pytest.approx(energies[i], rel=1e-12)
        np.testing.assert_array_equal(np.sort(model.armature)[-3:], np.sort(machine.actuators.inertia))


def test_guides_feel_the_nut_and_no_rotor():
    """Reactions are those of the machine without armature; with a balance, the nut's share of the slide's."""
    machine = dataclasses.replace(p3dof.SOLIDS, actuators=Actuators({"sliders": 14.8}))
    motion = p3dof.paper_motion(11)
    plain, found = (p3dof.load(m).reactions(motion, joints="elastic") for m in (p3dof.SOLIDS, machine))
    np.testing.assert_allclose(found.forces, plain.forces, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.moments, plain.moments, rtol=0, atol=1e-8)
    assert found.residual.max() < 1e-8
    balanced = dataclasses.replace(machine, actuators=SOME)
    other = p3dof.load(balanced).reactions(motion, joints="elastic")
    assert other.residual.max() < 1e-8


def test_counterbalance_of_the_papers_machine():
    """The reference: constant forces that halve the RMS of the paper's motion, and more."""
    best = dict(zip(SLIDES, (48.15, 52.49, 55.49), strict=True))
    motion = p3dof.paper_motion(1001)
    plain = p3dof.load(PAPER).inverse_dynamics(motion)
    np.testing.assert_allclose(plain.rms_forces, [51.7, 53.8, 59.3], atol=0.05)
    balanced = dataclasses.replace(PAPER, actuators=Actuators(counterbalance=best))
    found = p3dof.load(balanced).inverse_dynamics(motion)
    np.testing.assert_allclose(found.rms_forces, [18.8, 11.9, 20.8], atol=0.05)
    with_rotors = dataclasses.replace(PAPER, actuators=Actuators({"sliders": 14.8044066}))
    forces = p3dof.load(with_rotors).inverse_dynamics(motion).forces
    mean = np.trapezoid(forces, motion.time, axis=0) / motion.duration
    np.testing.assert_allclose(mean, [61.220, 57.180, 64.377], atol=2e-3)
    weights = dataclasses.replace(PAPER, actuators=Actuators(counterweight={"slide_a": 4.90}))
    assert p3dof.load(weights).inverse_dynamics(motion).rms_forces[0] == pytest.approx(26.2, abs=0.05)


@pytest.fixture(scope="module")
def sprung():
    """A machine that swings on its own springs, with armature; and its controller instead of them."""
    hold = p3dof.load(PAPER).forces(HOME, HOME, HOME)
    own = Actuators(counterbalance=dict(zip(SLIDES, hold, strict=True)), spring={"sliders": 2000.0})
    return dataclasses.replace(PAPER, actuators=own), p3dof.runs.Springs(2000.0, preload=hold)


@pytest.mark.parametrize("method", METHODS)
def test_springs_of_the_machine_are_those_of_a_controller(sprung, method):
    machine, springs = sprung
    start = p3dof.runs.InitialState([0.02, 0.03, 0.15], [0.1, 0, 0.2])
    options = {"start": start, "method": method, "samples": 41, "integration": SHARP}
    found = p3dof.load(machine).simulate(0.2, **options)
    other = p3dof.load(PAPER).simulate(0.2, controller=springs, **options)
    np.testing.assert_allclose(found.pose, other.pose, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_free_run_keeps_its_energy(sprung, method):
    own = dataclasses.replace(sprung[0].actuators, armature={"sliders": 5.0}, counterweight={"slide_a": 1.0})
    machine = dataclasses.replace(sprung[0], actuators=own)
    start = p3dof.runs.InitialState([0.02, 0.03, 0.15], [0.1, 0, 0.2])
    run = p3dof.load(machine).simulate(1.0, start=start, method=method, samples=201, integration=SHARP)
    assert run.finished
    kinetic = kinetic_energy(machine, run.pose, run.velocity).sum(axis=-1)
    energy = kinetic + potential_energy(machine, run.pose).sum(axis=-1)
    assert np.abs(energy - energy[0]).max() < 1e-9 * kinetic.max()
    assert np.ptp(run.pose, axis=0).min() > 0.02  # it does swing


@pytest.mark.skipif(len(levels()) == 1, reason="needs the extension")
@pytest.mark.parametrize("controller", [p3dof.runs.ComputedTorque, p3dof.runs.Feedforward, p3dof.runs.PD])
def test_controllers_know_them_and_many_runs_are_single_ones(controller):
    machine = dataclasses.replace(p3dof.SOLIDS, actuators=SOME)
    robot, motion = p3dof.load(machine), p3dof.paper_motion(1001).from_rest(0.2)
    ideal = controller(robot, motion, 60.0, 1.0)
    control = p3dof.runs.ControlLoop(1000)
    rows = {"start.y": motion.pose[0, 0] + np.array([0, 1e-3])}
    rows |= {"start.z": np.full(2, motion.pose[0, 1]), "start.theta": np.full(2, motion.pose[0, 2])}
    many = robot.simulate_many(0.1, rows, controller=ideal, control=control)
    for i in range(2):
        start = p3dof.runs.InitialState([rows[f"start.{name}"][i] for name in ("y", "z", "theta")])
        for method in ("compiled", "virtual-power"):
            run = robot.simulate(
                0.1, start=start, controller=ideal, control=control, method=method, samples=11
            )
            np.testing.assert_allclose(many.pose[i], run.pose[-1], rtol=0, atol=1e-8)
    if controller is p3dof.runs.ComputedTorque:  # an ideal model keeps to the motion
        run = robot.simulate(
            0.1,
            start=p3dof.runs.InitialState(motion.pose[0]),
            controller=ideal,
            samples=11,
            method="pinocchio",
        )
        np.testing.assert_allclose(run.pose[-1], motion.pose[100], rtol=0, atol=1e-7)


@pytest.mark.parametrize("level", levels())
@pytest.mark.parametrize("springs", [False, True])
def test_designs_have_them(level, springs):
    own = SOME if springs else Actuators({"sliders": 14.8}, {"slide_a": 40.0}, {}, {"slide_b": 3.0})
    machine = dataclasses.replace(p3dof.SOLIDS, actuators=own)
    motion = p3dof.paper_motion(101)
    columns = {"R": [0.25, 0.27], "gravity.z": [-9.806, -5.0], "offset.z": [0.0, 0.01]}
    found = p3dof.analysis.forces_of_designs(p3dof.analysis.Designs(columns, machine), motion, level=level)
    for i in range(2):
        geometry = dataclasses.replace(machine.geometry, R=columns["R"][i])
        one = dataclasses.replace(machine, geometry=geometry, gravity=[0, 0, columns["gravity.z"][i]])
        moved = p3dof.Motion(
            motion.time,
            motion.pose + np.array([0, columns["offset.z"][i], 0]),
            motion.velocity,
            motion.acceleration,
        )
        expected = p3dof.load(one).inverse_dynamics(moved, method="virtual-power")
        np.testing.assert_allclose(found.peak_force[i], expected.peak_forces, rtol=1e-11)


def test_forces_at_nuts_are_told_beside_those_of_actuators(tmp_path):
    machine = dataclasses.replace(PAPER, actuators=Actuators({"sliders": 14.8}))
    robot, motion = p3dof.load(machine), p3dof.paper_motion(51)
    found, plain = robot.inverse_dynamics(motion), p3dof.load(PAPER).inverse_dynamics(motion)
    rows = {row[0]: row[1:] for row in forces_table(found).rows}
    expected = {row[0]: row[1:] for row in forces_table(plain).rows}
    assert list(rows) == ["A", "B", "C", "nut A", "nut B", "nut C"]
    assert list(expected) == ["A", "B", "C"]
    for leg, row in expected.items():
        assert rows[f"nut {leg}"] == pytest.approx(row, rel=1e-10)
        assert rows[leg][1] > row[1] + 1
    header, *lines = found.to_csv(tmp_path / "forces.csv").read_text(encoding="utf-8").splitlines()
    table = np.array([[float(x) for x in line.split(",")] for line in lines])
    places = [header.split(",").index(f"nut {leg} [N]") for leg in "ABC"]
    np.testing.assert_array_equal(table[:, places], found.nut_forces)
    assert "nut" not in plain.to_csv(tmp_path / "plain.csv").read_text(encoding="utf-8")


def test_drives_are_sized_by_the_forces_at_nuts():
    """An armature in the machine stands for the drive's own turning parts, which must not count twice."""
    motion = p3dof.paper_motion(201)
    drive = next(iter(p3dof.design.drives.GENERIC))
    sizes = [
        p3dof.size_drives(p3dof.load(machine), p3dof.load(machine).inverse_dynamics(motion), drive)[0]
        for machine in (PAPER, dataclasses.replace(PAPER, actuators=Actuators({"sliders": 14.8})))
    ]
    for one, other in zip(*(size.axes for size in sizes), strict=True):
        assert other.worst.name == one.worst.name
        assert other.worst.share == pytest.approx(one.worst.share, rel=1e-9)
        ratios = [[r.share for r in axis.ratings] for axis in (one, other)]
        np.testing.assert_allclose(ratios[1], ratios[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_nuts_in_a_run_feel_what_the_machine_without_armature_takes(method):
    machine = dataclasses.replace(PAPER, actuators=SOME)
    robot = p3dof.load(machine)
    forces = robot.forces(HOME, HOME, HOME) + np.array([20.0, 15.0, -10.0])
    run = robot.simulate(0.05, controller=forces, method=method, samples=6)
    bare = Actuators({}, *machine.actuators.mappings[1:])
    plain = p3dof.load(dataclasses.replace(machine, actuators=bare))
    expected = plain.forces(run.pose, run.velocity, run.acceleration)
    np.testing.assert_allclose(run.nut_forces(machine.actuators), expected, rtol=0, atol=1e-7)
    assert np.abs(run.forces - expected).max() > 1
