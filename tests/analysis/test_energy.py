"""Energy, momentum and work: against Lagrange, Pinocchio, the mass matrix, and the laws they must keep."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from lagrange import BODIES, LagrangeModel
from machines import SEEDS, derivative, random_machine, random_states
from scipy.integrate import simpson
from table_numbers import check_table, shows

import p3dof
import p3dof.cli.forces
from p3dof._base.errors import InputError, MissingExtraError, ReachError
from p3dof.analysis.energy import energy_of, kinetic_energy, momentum, potential_energy
from p3dof.analysis.energy import evaluation as energy_tables
from p3dof.analysis.energy.evaluation import integral, work_weights
from p3dof.cli import main
from p3dof.closed_form import kinematics
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LINKS, PAPER, SOLIDS, Actuators, Friction
from p3dof.report.plots import save
from p3dof.report.plots.forces import energy_figure

METHODS = ("pinocchio", "virtual-power")
WRENCH = np.array([5.0, 20.0, -30.0, 1.0, 3.0, -2.0])
HOME = np.zeros(3)


def solved(parameters=PAPER, samples=1001, method="virtual-power", wrench=None, motion=None, **options):
    motion = p3dof.paper_motion(samples) if motion is None else motion
    result = p3dof.load(parameters).inverse_dynamics(motion, method=method, wrench=wrench, **options)
    return energy_of(parameters, result), result


def close(found, expected, share):
    assert np.abs(found - expected).max() <= share * np.abs(expected).max()


@pytest.fixture(scope="module")
def paper():
    return solved()


@settings(max_examples=40)
@given(SEEDS)
def test_energies_are_those_of_lagrange(seed):
    parameters = random_machine(seed)
    model, s = LagrangeModel(parameters), random_states(parameters, seed, 10)
    T, V = kinetic_energy(parameters, s.pose, s.velocity), potential_energy(parameters, s.pose)
    assert LINKS == BODIES
    close(T, model.body_kinetic_energies(s.pose, s.velocity), 1e-13)
    weights = np.array([body.mass for _, body in parameters.bodies.items()])
    close(V, -weights * np.einsum("k,nbk->nb", parameters.gravity, model.mass_centers(s.pose)), 1e-13)
    assert np.abs(V.sum(axis=-1) - model.potential_energy(s.pose)).max() <= 1e-13 * np.abs(V).max()


@settings(max_examples=40)
@given(SEEDS)
def test_momenta_are_those_of_lagranges_velocities(seed):
    parameters = random_machine(seed)
    model, s = LagrangeModel(parameters), random_states(parameters, seed, 10)
    c, v = model.mass_centers(s.pose), model.mass_center_velocities(s.pose, s.velocity)
    omega, R = model.angular_velocities(s.pose, s.velocity), model.orientations(s.pose)
    masses = np.array([body.mass for _, body in parameters.bodies.items()])[:, None]
    inertia = np.array([body.inertia for _, body in parameters.bodies.items()])
    spin = np.einsum("nbij,bjk,nblk,nbl->nbi", R, inertia, R, omega)
    linear, angular = momentum(parameters, s.pose, s.velocity)
    close(linear, (masses * v).sum(axis=1), 1e-13)
    close(angular, (masses * np.cross(c, v) + spin).sum(axis=1), 1e-13)


@settings(max_examples=40)
@given(SEEDS)
def test_kinetic_energy_is_that_of_the_mass_matrix_and_gravity_the_gradient_of_the_potential(seed):
    parameters = random_machine(seed)
    robot, s = p3dof.load(parameters), random_states(parameters, seed, 10, drop=0.3)
    M = robot.mass_matrix(s.pose, method="virtual-power")
    T = kinetic_energy(parameters, s.pose, s.velocity).sum(axis=-1)
    close(T, np.einsum("ni,nij,nj->n", s.velocity, M, s.velocity) / 2, 2e-14)
    rate = derivative(lambda t: potential_energy(parameters, s.pose + t * s.velocity).sum(axis=-1), 0, 1e-4)
    close(rate, np.sum(robot.gravity_forces(s.pose) * s.velocity, axis=-1), 1e-8)


@pytest.mark.parametrize("seed", [*range(6), None])
def test_pinocchio_finds_the_same(seed):
    """On the joints that the Pinocchio route found by closing the loops."""
    parameters = SOLIDS if seed is None else random_machine(seed)
    robot = p3dof.load(parameters)
    s = random_states(parameters, 7, 5, drop=0.3, angle=0.1)
    motion = Motion(np.arange(5.0), s.pose, s.velocity, s.acceleration, check=False)
    results = [robot.inverse_dynamics(motion[i], method="pinocchio") for i in range(5)]  # on either side
    found = [energy_of(parameters, result) for result in results]
    data, rows = robot.model.createData(), []
    for q, v in ((result.joints.q[0], result.joints.v[0]) for result in results):
        kinetic = pin.computeKineticEnergy(robot.model, data, q, v)
        potential = pin.computePotentialEnergy(robot.model, data, q)
        hg = pin.computeCentroidalMomentum(robot.model, data, q, v)
        centre = pin.centerOfMass(robot.model, data, q)
        rows.append([kinetic, potential, *hg.linear, *(hg.angular + np.cross(centre, hg.linear))])
    expected = np.array(rows)
    columns = {
        "kinetic_total": 0,
        "potential_total": 1,
        "momentum": slice(2, 5),
        "angular_momentum": slice(5, 8),
    }
    for name, column in columns.items():
        close(np.concatenate([getattr(one, name) for one in found]), expected[:, column], 1e-12)


@settings(max_examples=30)
@given(SEEDS)
def test_rates_of_energy_and_momentum(seed):
    """Power of actuators and wrench is the rate of T + V; along the guide-ways nothing else pushes than
    actuators, wrench and weight, and across them the momentum follows the accelerations of the bodies."""
    parameters = random_machine(seed)
    s = random_states(parameters, seed, 10, drop=0.3, angle=0.1)
    robot = p3dof.load(parameters)
    f = robot.forces(s.pose, s.velocity, s.acceleration, method="virtual-power", wrench=s.wrench)

    def state(t):
        return s.pose + t * s.velocity + t**2 / 2 * s.acceleration, s.velocity + t * s.acceleration

    def energy(t):
        pose, velocity = state(t)
        return (kinetic_energy(parameters, pose, velocity) + potential_energy(parameters, pose)).sum(axis=-1)

    sliders = np.einsum("nij,nj->ni", robot.jacobian(s.pose, method="virtual-power"), s.velocity)
    power = (f * sliders).sum(axis=-1) + (s.wrench[:, [1, 2, 4]] * s.velocity).sum(axis=-1)
    scale = np.abs(f * sliders).max()
    assert np.abs(derivative(energy, 0, 1e-4) - power).max() <= 1e-7 * scale

    rate = derivative(lambda t: np.hstack(momentum(parameters, *state(t))), 0, 1e-4)
    along = f.sum(axis=-1) + s.wrench[:, 2] + parameters.bodies.mass * parameters.gravity[2]
    assert np.abs(rate[:, 2] - along).max() <= 1e-7 * np.abs(f).max()
    moving = kinematics.mechanism_motion(parameters.geometry, s.pose, s.velocity, s.acceleration)
    expected = np.zeros((10, 6))
    for name, body in parameters.bodies.items():
        motion = moving.bodies[name]
        c, _, a = motion.at(body.com)
        inertia = motion.rotation @ body.inertia @ np.swapaxes(motion.rotation, -1, -2)
        turning = np.einsum("nij,nj->ni", inertia, motion.epsilon)
        turning += np.cross(motion.omega, np.einsum("nij,nj->ni", inertia, motion.omega))
        expected += np.hstack([body.mass * a, body.mass * np.cross(c, a) + turning])
    close(rate[:, :3], expected[:, :3], 1e-7)
    close(rate[:, 3:], expected[:, 3:], 1e-7)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("wrench", [None, WRENCH])
def test_balance_over_the_papers_motion(method, wrench):
    for parameters in (PAPER, SOLIDS):
        found, result = solved(parameters, method=method, wrench=wrench)
        assert np.abs(found.balance).max() <= 1e-13 * found.scale
        assert found.valid.all()
        np.testing.assert_array_equal(found.power.sum(axis=-1), result.power)
        change = found.total - found.total[0]
        np.testing.assert_allclose(found.work_done, change, rtol=0, atol=1e-13 * found.scale)


@settings(max_examples=15)
@given(SEEDS)
def test_balance_of_any_machine(seed):
    """Along a straight line between two reachable poses in the neighbourhood of each other."""
    parameters = random_machine(seed)
    s = random_states(parameters, seed, 1, drop=0.5, angle=0.3)
    end = s.pose[0] + 0.05 * np.array([parameters.geometry.L, parameters.geometry.L, 1])
    motion = Motion.rest_to_rest(s.pose[0], end, 0.5, samples=501)
    wrench = s.wrench[0] + np.sin(np.linspace(0, 3, 501))[:, None]
    found, _ = solved(parameters, motion=motion, wrench=wrench)
    assert np.abs(found.balance).max() <= 1e-11 * max(found.scale, np.abs(found.total).max())


def test_friction_is_lost_and_the_balance_holds():
    parameters = replace(
        SOLIDS, friction=Friction({"sliders": 12.0, "joints": 0.02}, {"sliders": 6.0}, smoothing=0.05)
    )
    found, result = solved(parameters, wrench=WRENCH)
    free, _ = solved(SOLIDS, wrench=WRENCH)
    np.testing.assert_array_equal(found.dissipated_power, result.dissipation)
    assert np.all(np.diff(found.dissipated_work) > 0)
    assert np.abs(found.balance).max() <= 1e-13 * found.scale
    more = found.work[-1].sum() - free.work[-1].sum()
    assert more == pytest.approx(found.dissipated_work[-1], rel=1e-12)
    np.testing.assert_array_equal(found.kinetic, free.kinetic)


def test_payload_moves_with_the_platform():
    payload = p3dof.machine.Body(2.0, [0.01, 0.02, 0.03], [0.01, 0.01, 0.01])
    loaded, bare = (
        kinetic_energy(p, [0.01, 0, 0.1], [0.1, 0.2, 0.3]) for p in (PAPER.carrying(payload), PAPER)
    )
    changed = [name for name, more in zip(BODIES, loaded - bare, strict=True) if more]
    assert changed == ["platform"]


def test_drive_loads(paper):
    """Against sums over twenty times as many samples, and the numbers of the result."""
    found, result = paper
    fine, _ = solved(samples=20001)
    drives, dt = found.drives, fine.time[1]
    np.testing.assert_array_equal(drives.peak_force, result.peak_forces)
    np.testing.assert_array_equal(drives.rms_force, result.rms_forces)
    np.testing.assert_array_equal(drives.peak_speed, np.abs(result.slider_velocities).max(axis=0))
    np.testing.assert_array_equal(drives.peak_power, found.power.max(axis=0))
    np.testing.assert_array_equal(drives.peak_braking, -found.power.min(axis=0))
    given, taken = (simpson(part(fine.power, 0), dx=dt, axis=0) for part in (np.maximum, np.minimum))
    np.testing.assert_allclose(drives.positive_work, given, rtol=1e-7)
    np.testing.assert_allclose(drives.negative_work, taken, rtol=1e-7)
    np.testing.assert_allclose(drives.mean_power, simpson(fine.power, dx=dt, axis=0), rtol=1e-12)
    np.testing.assert_allclose(drives.positive_work + drives.negative_work, found.work[-1], rtol=1e-13)
    assert repr(found).startswith("Energy(1001 samples, actuators give 23.1287 J and take 16.3568 J")


@shows(
    "p3dof.analysis.energy.evaluation.drives_table",
    "p3dof.analysis.energy.evaluation.bodies_table",
    "p3dof.analysis.energy.evaluation.balance_table",
)
def test_every_number_of_the_tables_of_energy():
    """From Lagrange's energies and forces, with rotors, and a force too much of A that the balance shows."""
    masses, more = np.array([3.0, 0.0, 5.0]), np.array([1.5, 0, 0])
    machine = replace(PAPER, actuators=Actuators({"slide_a": 3.0, "slide_c": 5.0}))
    _, result = solved(machine, samples=101)
    found = energy_of(machine, replace(result, forces=result.forces + more))
    model = LagrangeModel(PAPER)

    def motion_at(samples):
        motion = p3dof.paper_motion(samples)
        states = motion.pose, motion.velocity, motion.acceleration
        speed = model.slider_velocities(*states[:2])
        force = model.forces(*states) + masses * model.slider_accelerations(*states) + more
        return motion, speed, force

    (motion, speed, force), (fine, *product) = motion_at(101), motion_at(10001)
    dt, power = fine.time[1], product[0] * product[1]
    given, taken, net = (simpson(part, dx=dt, axis=0) for part in (power.clip(0), power.clip(None, 0), power))
    squares = (force[1:] ** 2 + force[:-1] ** 2).sum(axis=0) / 2 / 100
    rows = {
        "peak force [N]": abs(force).max(axis=0),
        "RMS force [N]": squares**0.5,
        "peak speed [m/s]": abs(speed).max(axis=0),
        "peak power [W]": (force * speed).max(axis=0),
        "peak braking power [W]": -(force * speed).min(axis=0),
        "mean power [W]": net / 1.0,
        "work supplied [J]": given,
        "work regenerated [J]": taken,
    }
    check_table(energy_tables.drives_table(found), rows)
    kinetic = model.body_kinetic_energies(motion.pose, motion.velocity)
    kinetic = np.column_stack([kinetic, masses * speed**2 / 2])
    total = kinetic.sum(axis=1)
    at = total.argmax()
    rows = {
        name: (kinetic[:, k].max(), (kinetic[at, k] / total[at],))
        for k, name in enumerate([*BODIES, "actuator_a", "actuator_b", "actuator_c"])
    }
    check_table(energy_tables.bodies_table(found), rows, header=[motion.time[at]], note=[total[at]])
    energy = total + model.potential_energy(motion.pose)
    too_much = more[0] * (model.sliders(motion.pose) - model.sliders(motion.pose[0]))[:, 0]
    done = energy[-1] - energy[0] + too_much[-1]
    scale = max(total.max(), energy.max() - energy.min())
    check_table(
        energy_tables.balance_table(found), {"over the motion": (done, (abs(too_much).max(),), scale)}
    )


def test_the_table_tells_small_errors_of_the_balance_too():
    _, result = solved(PAPER, samples=2001)
    found = energy_of(PAPER, result)
    error = np.abs(found.balance).max()
    assert 0 < error < 1e-3
    assert energy_tables.balance_table(found).rows[0][2] == f"{error:.1e}"


def test_lifting_straight_up_takes_the_weight_times_the_height():
    motion = Motion.rest_to_rest([0, 0, 0], [0, 0.1, 0], 1, samples=101)
    found, _ = solved(motion=motion)
    gained = PAPER.bodies.mass * 9.806 * 0.1
    assert found.work_done[-1] == pytest.approx(gained, rel=1e-12)
    assert np.ptp(found.potential_total) == pytest.approx(gained, rel=1e-12)
    np.testing.assert_allclose(
        found.momentum[:, 2], PAPER.bodies.mass * motion.velocity[:, 1], rtol=0, atol=1e-14
    )
    assert np.abs(found.momentum[:, :2]).max() <= 1e-14
    pushing, _ = solved(motion=motion[20:40])
    assert pushing.power.min() > 1
    np.testing.assert_array_equal(pushing.drives.peak_braking, 0)
    lowering, _ = solved(motion=Motion.rest_to_rest([0, 0, 0], [0, -0.1, 0], 1, samples=101)[20:40])
    np.testing.assert_array_equal(lowering.drives.peak_power, 0)
    np.testing.assert_allclose(lowering.drives.negative_work, lowering.work[-1], rtol=1e-14)


def test_few_samples():
    """One: no work; two: a trapezoid; three: Simpson's rule; up to six: the polynomial through all."""
    one, result = solved(samples=1)
    np.testing.assert_array_equal(one.work, np.zeros((1, 3)))
    np.testing.assert_array_equal(one.drives.mean_power, one.power[0])
    np.testing.assert_array_equal(one.balance, 0)
    np.testing.assert_array_equal(one.drives.rms_force, np.abs(result.forces[0]))
    two, _ = solved(samples=2)
    np.testing.assert_allclose(two.work[-1], two.power.mean(axis=0), rtol=1e-14)
    three, _ = solved(samples=3)
    np.testing.assert_allclose(three.work[-1], [1, 4, 1] @ three.power / 6, rtol=1e-13)
    for samples in (4, 5, 6):
        found, _ = solved(samples=samples)
        whole = 2 * (found.time - found.time[0]) / np.ptp(found.time) - 1
        powers = np.vander(whole, increasing=True)
        terms = np.linalg.solve(powers, found.power)
        order = np.arange(1, samples + 1)[:, None]
        primitive = (whole**order - (-1.0) ** order) / order * np.ptp(found.time) / 2
        expected = primitive.T @ terms
        allowed = 1e-15 * np.linalg.cond(powers) * max(1.0, np.abs(found.power).max())
        np.testing.assert_allclose(found.work, expected, rtol=0, atol=allowed)


def test_uneven_times():
    times = np.sort(np.concatenate([[0, 1], np.random.default_rng(3).uniform(0, 1, 999)]))
    found, _ = solved(motion=p3dof.paper_motion(1001).resampled(times))
    assert np.abs(found.balance).max() <= 1e-8 * found.scale


def test_times_too_uneven_for_a_spline_are_integrated_by_trapezoids():
    for time in (np.cumsum(np.geomspace(1e-12, 1, 30)), np.array([0, 5e-324, 1e-323, *range(1, 7)])):
        rates = np.column_stack([np.ones(len(time)), np.sin(time)])
        found = integral(time, rates)(time)
        np.testing.assert_allclose(found[-1], np.trapezoid(rates, time, axis=0), rtol=1e-12)


def test_a_power_that_jumps_is_integrated_on_each_side_of_the_jump():
    sides = np.poly1d([3.0, -1, 2, 0, -4, 10]), np.poly1d([-2.0, 0, 5, 1, 1, -30])
    first, last = np.linspace(0, 1, 12), np.linspace(1, 3, 30)
    time = np.concatenate([first[:-1], [1 - 1e-10], last])
    power = np.concatenate([sides[0](time[:12]), sides[1](last)])
    done = [np.polyint(side) for side in sides]
    before, after = done[0](first) - done[0](0), done[1](last) - done[1](1)
    expected = np.concatenate([before, before[-1] + after])
    np.testing.assert_allclose(integral(time, power[:, None])(time)[:, 0], expected, rtol=0, atol=1e-8)
    assert abs(work_weights(time) @ power - expected[-1]) <= 1e-8
    assert abs(np.trapezoid(power, time) - expected[-1]) > 1e-2


def test_invalid_samples_part_the_work():
    wrench = np.tile(WRENCH, (101, 1))
    wrench[[40, 41, 70, 72]] = np.nan
    motion = p3dof.paper_motion(101)
    for method in METHODS:
        found, _ = solved(motion=motion, wrench=wrench, method=method, on_invalid="nan")
        assert np.flatnonzero(~found.valid).tolist() == [40, 41, 70, 72]
        names = {item.name for item in fields(found)} - {"time", "bodies", "drives"}
        for values in (getattr(found, name) for name in sorted(names | {"total", "work_done"})):
            rows = np.isfinite(values.reshape(101, -1))
            np.testing.assert_array_equal(rows.all(axis=-1), found.valid)
            np.testing.assert_array_equal(rows.any(axis=-1), found.valid)
        parts = [slice(0, 40), slice(42, 70), slice(71, 72), slice(73, 101)]
        done = np.zeros(3)
        for part in parts:
            alone, _ = solved(motion=motion[part], wrench=WRENCH, method=method)
            np.testing.assert_allclose(found.work[part], done + alone.work, rtol=0, atol=1e-12)
            np.testing.assert_allclose(found.balance[part], alone.balance, rtol=0, atol=1e-12)
            done = done + alone.work[-1]
        for item in fields(found.drives):  # what happens in between is unknown
            assert np.isnan(getattr(found.drives, item.name)).all()
        assert np.abs(found.balance[found.valid]).max() <= 1e-6 * found.scale


def test_nothing_valid():
    pose = np.tile([0.5, 0, 0], (3, 1))
    motion = Motion(np.arange(3.0), pose, 0 * pose, 0 * pose)
    found, _ = solved(motion=motion, on_invalid="nan")
    assert not found.valid.any()
    assert np.isnan(found.scale)
    assert np.isnan(found.drives.positive_work).all()
    with pytest.raises(InputError, match="at least one valid sample"):
        energy_figure(found)


def test_crossing_a_singularity_parts_the_work():
    theta = np.arange(0, 1.95, 0.1)
    motion = Motion.from_poses(theta, np.column_stack([0 * theta, 0 * theta, theta]))
    found, result = solved(motion=motion, on_invalid="nan")
    assert result.crossings.tolist() == [theta[10]]
    assert np.flatnonzero(~found.valid).tolist() == [10, 11]
    assert found.balance[0] == found.balance[12] == 0
    np.testing.assert_array_equal(found.work[12], found.work[9])


def test_batches_and_bad_states():
    pose = np.zeros((2, 3, 3))
    pose[1, 1, 0], pose[0, 2, 1] = 0.3, np.nan
    valid = [[True, True, False], [True, False, True]]
    T, V = kinetic_energy(PAPER, pose, HOME, "nan"), potential_energy(PAPER, pose, "nan")
    assert T.shape == V.shape == (2, 3, 10)
    p, H = momentum(PAPER, pose, HOME, on_invalid="nan")
    assert p.shape == H.shape == (2, 3, 3)
    for values in (T, V, p, H):
        assert np.isfinite(values).all(axis=-1).tolist() == np.isfinite(values).any(axis=-1).tolist() == valid
    assert kinetic_energy(PAPER, HOME, np.ones((4, 3))).shape == (4, 10)
    machine = replace(PAPER, actuators=Actuators({"sliders": 2.0}, {"sliders": 5.0}, {"sliders": 30.0}))
    model, speed = LagrangeModel(PAPER), np.ones((4, 2, 3))
    own = kinetic_energy(machine, HOME, speed)[..., 10:], potential_energy(machine, 0.01 * speed)[..., 10:]
    lifted = model.sliders(0.01 * speed)
    np.testing.assert_allclose(own[0], model.slider_velocities(HOME, speed) ** 2, rtol=1e-12)
    np.testing.assert_allclose(own[1], 15 * lifted**2 - 5 * lifted, rtol=1e-10)
    assert kinetic_energy(PAPER, np.zeros((0, 3)), HOME).shape == (0, 10)
    for call in (kinetic_energy, momentum):
        with pytest.raises(ReachError, match="leg A"):
            call(PAPER, pose[1], HOME)
        with pytest.raises(InputError, match="velocity: expected finite"):
            call(PAPER, HOME, [0, np.nan, 0])
        with pytest.raises(InputError, match="expected shapes that fit"):
            call(PAPER, np.zeros((2, 3)), np.zeros((3, 3)))
        with pytest.raises(InputError, match="parameters: expected Parameters, got 'paper'"):
            call("paper", HOME, HOME)
        with pytest.raises(InputError, match="on_invalid"):
            call(PAPER, HOME, HOME, "ignore")
    with pytest.raises(ReachError):
        potential_energy(PAPER, [0.3, 0, 0])
    with pytest.raises(InputError, match="pose: expected shape"):
        potential_energy(PAPER, [0.3, 0])


def test_bad_results(paper):
    result = paper[1]
    with pytest.raises(InputError, match="parameters: expected Parameters, got None"):
        energy_of(None, result)
    with pytest.raises(InputError, match="result: expected InverseDynamics, got a Motion"):
        energy_of(PAPER, result.motion)
    with pytest.raises(InputError, match=r"wrench: expected shape \(1001, 6\)"):
        p3dof.load().inverse_dynamics(result.motion, wrench=np.zeros((7, 6)))
    with pytest.raises(InputError, match="wrench: expected finite numbers"):
        p3dof.load().inverse_dynamics(result.motion, wrench=[0, 0, np.nan, 0, 0, 0])
    for L in (0.3, 0.41):
        other = replace(PAPER, geometry=replace(PAPER.geometry, L=L))
        with pytest.raises(InputError, match="machine with these parameters"):
            energy_of(other, result)


def test_a_wrong_force_or_a_wrong_machine_shows_in_the_balance(paper):
    found, result = paper
    wrong = energy_of(PAPER, replace(result, forces=result.forces * (1 + 1e-9)))
    assert np.abs(wrong.balance).max() > 100 * np.abs(found.balance).max()
    heavier = replace(PAPER, bodies=PAPER.bodies.scaled(1.01))
    assert np.abs(energy_of(heavier, result).balance).max() > 1e-3


def test_csv(paper, tmp_path):
    found = paper[0]
    path = found.to_csv(tmp_path / "energy.csv")
    with path.open(encoding="utf-8") as stream:
        header = stream.readline().strip().split(",")
        table = np.loadtxt(stream, delimiter=",")
    column = {name: table[:, k] for k, name in enumerate(header)}
    assert len(column) == 41
    for name, values in {
        "t [s]": found.time,
        "total [J]": found.total,
        "power B [W]": found.power[:, 1],
        "work C [J]": found.work[:, 2],
        "balance [J]": found.balance,
        "momentum z [N s]": found.momentum[:, 2],
        "angular momentum x [N m s]": found.angular_momentum[:, 0],
        "kinetic platform [J]": found.kinetic[:, 8],
        "potential rod_right [J]": found.potential[:, 9],
    }.items():
        np.testing.assert_array_equal(column[name], values)
    with pytest.raises(InputError, match=r"energy\.xlsx: expected a file name that ends in \.csv"):
        found.to_csv(tmp_path / "energy.xlsx")


def lines(axis):
    return {line.get_label(): np.asarray(line.get_ydata()) for line in axis.lines}


def test_figure_shows_what_was_computed(paper):
    found = paper[0]
    top, middle, bottom = energy_figure(found).axes
    curves = lines(top)
    np.testing.assert_array_equal(curves["T + V"], found.total - found.total[0])
    np.testing.assert_allclose(curves["work of actuators"], found.work_done, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(lines(middle)["all bodies"], found.kinetic_total)
    labels = [text.get_text() for text in middle.get_legend().get_texts()]
    assert labels == ["all bodies", "sliders", "rods of leg C", "legs A, B", "platform"]
    for leg, name in enumerate("ABC"):
        np.testing.assert_array_equal(lines(bottom)[f"actuator {name}"], found.power[:, leg])
    for axis, unit in ((top, "[J]"), (middle, "[J]"), (bottom, "[W]")):
        assert unit in axis.get_ylabel()
    assert bottom.get_xlabel() == "time [s]"


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_figure_of_anything(samples, tmp_path):
    friction = replace(SOLIDS, friction=Friction({"sliders": 1.0}))
    wrench = np.tile(WRENCH, (51, 1))
    wrench[[0, 20, 22]] = np.nan
    rest = Motion(np.arange(5.0), np.zeros((5, 3)), np.zeros((5, 3)), np.zeros((5, 3)))
    for found in (
        solved(samples=samples)[0],
        solved(friction, samples=51, wrench=wrench, on_invalid="nan")[0],
        solved(motion=rest)[0],
    ):
        figure = energy_figure(found)
        assert save(figure, tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    assert figure.axes[0].get_ylim() == (-1, 1)
    assert figure.axes[1].get_ylim() == (0, 1)


def test_figure_needs_matplotlib_and_an_energy(paper, monkeypatch):
    with pytest.raises(InputError, match="energy: expected an Energy, got"):
        energy_figure(paper[1])
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[plot\]"):
        energy_figure(paper[0])


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.parametrize("method", METHODS)
def test_command(tmp_path, capsys, method):
    out, figure = tmp_path / "energy.csv", tmp_path / "energy.png"
    code, text, err = run(
        capsys, "energy", "--samples", 101, "--method", method, "--out", out, "--figure", figure
    )
    assert code == 0, err
    for words in ("platform", "60.5%", "peak speed [m/s]", "118.4980", "balance", f"wrote {out}"):
        assert words in text
    assert "work and energy differ" not in text
    assert np.genfromtxt(out, delimiter=",", skip_header=1).shape == (101, 41)
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_command_tells_what_is_doubtful(tmp_path, capsys):
    code, text, _ = run(capsys, "energy", "--samples", 5, "--method", "virtual-power")
    assert code == 0
    assert "work and energy differ by 13.7 J, where 17.47 J move" in text
    assert "the motion is undersampled" in text
    (tmp_path / "m.csv").write_text("t,y,z,theta\n0,0,0,0\n1,0,0,0\n2,0,0,0\n", encoding="utf-8")
    code, text, _ = run(capsys, "energy", "--motion", tmp_path / "m.csv")
    assert code == 0
    assert "differ" not in text
    assert "nan" not in text


def test_command_with_bad_input(tmp_path, capsys):
    motion = tmp_path / "m.csv"
    motion.write_text("t,y,z,theta\n0,0,0,0\n1,0.5,0,0\n", encoding="utf-8")
    code, _, err = run(capsys, "energy", "--motion", motion)
    assert code == 1  # nothing is wrong with the file: the machine cannot do it
    assert "leg A" in err
    for arguments, words in (
        (["--motion", motion, "--out", motion], "would be overwritten"),
        (["--out", tmp_path / "f.png"], "f.png: expected a file name that ends in .csv"),
        (["--samples", 3, "--figure", tmp_path / "f.doc"], "ends in .png"),
        (["--method", "adams"], "adams"),
        (["--samples", 1], "samples"),
    ):
        code, _, err = run(capsys, "energy", *arguments)
        assert code == 2
        assert len(err.strip().splitlines()) == 1
        assert words in err


def test_importing_costs_no_scipy():
    code = (
        "import sys, p3dof.analysis.energy; print([m for m in ('scipy', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
