"""Emergency stops: closed forms, the whole machine against an integrator of its own, and ratings."""

import functools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from scipy.integrate import solve_ivp
from table_numbers import check_table, shows

import p3dof
from p3dof._base.errors import DriveError, InputError
from p3dof._base.tables import number
from p3dof.design.drives import (
    Catalogue,
    Drive,
    Motor,
    Screw,
    StopRamp,
    brake_fall,
    read_catalogue,
    stopping,
    stops_table,
)
from p3dof.design.drives.sizing import Rating, with_others
from p3dof.design.drives.stopping import Instants, controlled_stops, uncontrolled_stops
from p3dof.design.drives.tables import FALLS, _words
from p3dof.design.sizing import emergency_stops
from p3dof.machine.parameters import Body

TURN = 2 * math.pi
MOTOR = Motor(1.3, 3.8, 520.0, 3e-5, brake_torque=1.4, brake_time=0.03)
DRIVE = Drive(MOTOR, Screw(0.01, diameter=0.0127, length=0.5))


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def motion():
    return p3dof.paper_motion(21)


# --- closed forms of one slider -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mass", "inertia", "lead", "torque", "speed", "delay", "way", "force"),
    [
        (8, 8e-5, 0.010, 1.4, 0.35, 0.040, 0.02013906, 240.4023),
        (5, 5e-5, 0.005, 0.3, 0.25, 0.025, 0.01539506, 68.58034),
    ],
)
def test_a_vertical_slider_falls_until_its_brake_holds(mass, inertia, lead, torque, speed, delay, way, force):
    """Numbers computed elsewhere, in all their digits; and the equation of motion, integrated."""
    ratio = TURN / lead
    found = brake_fall(mass, inertia * ratio**2, torque * ratio, speed, delay)
    assert found == pytest.approx((way, force), rel=5e-7)
    total, time = mass + inertia * ratio**2, [0.0, delay, delay + 10]

    def stands(_, x):
        return x[1]

    stands.terminal = True
    state, place = [0.0, speed], 0.0
    for start, end, brake in zip(time, time[1:], (0, torque * ratio), strict=False):
        run = solve_ivp(
            lambda _, x, brake=brake: [x[1], (mass * 9.81 - brake) / total],
            (start, end),
            state,
            events=stands,
            rtol=1e-12,
            atol=1e-14,
        )
        state, place = run.y[:, -1], run.y[0, -1]
    assert found[0] == pytest.approx(place, rel=1e-9)


def test_a_brake_that_cannot_hold_never_stops():
    way, force = brake_fall(5.0, 10.0, 40.0, 0.1, 0.02, gravity=10.0)
    assert way == math.inf
    assert force == pytest.approx(40 + 10 * 10 / 15, rel=1e-14)


@pytest.mark.parametrize(
    ("speed", "ramp", "way"),
    [(0.5846, (8, 400, 0.004), 0.02954422), (1.2, (12, 600, 0.01), 0.084), (0.1, (8, 400), 0.1**1.5 / 20)],
)
def test_a_controlled_stop_with_jerk(speed, ramp, way):
    assert StopRamp(*ramp).way(speed) == pytest.approx(way, rel=2e-7)
    assert StopRamp(*ramp).way(-speed) == StopRamp(*ramp).way(speed)


def integrated(speed, acceleration, times, jerks):
    """States at the ends of phases of constant jerk, and the largest acceleration."""
    way, v, a, most = 0.0, speed, acceleration, abs(acceleration)
    for t, j in zip(times, jerks, strict=True):
        way += v * t + a * t * t / 2 + j * t**3 / 6
        v, a = v + a * t + j * t * t / 2, a + j * t
        most = max(most, abs(a))
    return way, v, a, most


def test_ramps_end_at_rest_within_their_limits():
    """From any speed and acceleration; in the least time, below which no jerk stops it."""
    rng = np.random.default_rng(3)
    ramp = StopRamp(8.0, 400.0, 0.004)
    speed, acceleration = rng.normal(0, 0.5, 300), rng.normal(0, 6, 300)
    acceleration[:100], speed[100:120] = 0.0, 0.0
    times, jerks = ramp.phases(speed, acceleration)
    assert (times >= 0).all()
    for k in range(300):
        way, v, a, most = integrated(speed[k], acceleration[k], times[:, k], jerks[:, k])
        assert (v, a) == pytest.approx((0, 0), abs=1e-13)
        assert most <= max(8.0, abs(acceleration[k])) * (1 + 1e-12)
        assert set(np.abs(jerks[:, k])) <= {0.0, 400.0}
        if k < 100:
            assert abs(way) == pytest.approx(float(ramp.way(speed[k])), rel=1e-12)


# --- the whole machine --------------------------------------------------------------------------------------


def instant(parameters, pose, velocity, acceleration=(0, 0, 0)):
    rows = (np.atleast_2d(np.array(one, dtype=float)) for one in (pose, velocity, acceleration))
    return Instants(parameters, np.array([0.5]), *rows, np.zeros((1, 6)))


@functools.cache
def follow(pose, velocity):
    """One stop by brakes by an integrator with events: each slider slides until it stands, and stays there.

    In the coordinates of the platform, by Pinocchio: M ẍ = Jᵀ(b - f) with f for no acceleration. A standing
    slider is held by what keeps its acceleration zero. Ways, forces at the nuts, works, end, duration.
    """
    rotor, hold, delay = DRIVE.reflected_mass, MOTOR.brake_torque * DRIVE.ratio, MOTOR.brake_time
    armature = dict.fromkeys(("slide_a", "slide_b", "slide_c"), rotor)
    laden = p3dof.load(replace(p3dof.PAPER, actuators=p3dof.machine.Actuators(armature=armature)))

    def slips(state):
        return laden.jacobian(state[:3], method="compiled") @ state[3:6]

    def dynamics(state, standing, closed):
        x, v, h = state[:3], state[3:6], 1e-6
        jacobian = laden.jacobian(x, method="compiled")
        still = laden.forces(x, v, np.zeros(3))
        give = jacobian @ np.linalg.solve(laden.mass_matrix(x), jacobian.T)
        jacobians = [laden.jacobian(x + s * h * v, method="compiled") for s in (1, -1)]
        change = (jacobians[0] - jacobians[1]) @ v / (2 * h)
        force = np.where(standing, 0.0, -np.sign(jacobian @ v) * hold * closed)
        free = change + give @ (force - still)
        rows = np.flatnonzero(standing)
        force[rows] = np.linalg.solve(give[np.ix_(rows, rows)], -free[rows]) if len(rows) else 0.0
        slide = change + give @ (force - still)
        return np.linalg.solve(jacobian, slide - change), force, force - rotor * slide

    def rates(_, state, standing, closed):
        change, force, _ = dynamics(state, standing, closed)
        return [*state[3:6], *change, *np.abs(force * slips(state))]

    def event(k, standing, closed):
        def stands(_, state, *__):
            return slips(state)[k] if closed and not standing[k] else 1.0

        stands.terminal = True
        return stands

    state, time, standing = np.array([*pose, *velocity, 0, 0, 0]), 0.0, np.zeros(3, bool)
    nut = np.zeros(3)
    while time < delay or not standing.all():
        closed = time >= delay
        span = (time, time + 1.0 if closed else delay)
        events = [event(k, standing, closed) for k in range(3)]
        run = solve_ivp(rates, span, state, args=(standing, closed), events=events, rtol=1e-6, atol=1e-9)
        for row in run.y.T[:-1]:  # at the last, slips have no sign
            nut = np.maximum(nut, np.abs(dynamics(row, standing, closed)[2]))
        time, state = run.t[-1], run.y[:, -1]
        standing = standing | np.array([len(times) > 0 for times in run.t_events])
    return laden.sliders(state[:3]) - laden.sliders(pose), nut, state[6:], state[:3], time


@pytest.mark.parametrize(
    ("pose", "velocity"), [([0.02, -0.03, 0.1], [0.3, -0.5, 1.0]), ([-0.05, 0.02, -0.2], [-0.4, -0.2, -0.5])]
)
def test_brakes_stop_the_whole_machine_as_its_equations_say(robot, pose, velocity):
    """Way, force, work and duration of one stop; the steps' error is of second order, so of a thousandth."""
    way, nut, work, place, time = follow(tuple(pose), tuple(velocity))
    found = uncontrolled_stops([instant(robot.parameters, pose, velocity)], [DRIVE] * 3, step=1e-4)
    np.testing.assert_allclose(found.way, np.abs(way), rtol=1e-4)
    np.testing.assert_allclose(found.brake_energy, work, rtol=1e-4)
    np.testing.assert_allclose(found.nut_force, nut, rtol=2e-3)
    assert found.platform_way == pytest.approx(np.linalg.norm(place[:2] - pose[:2]), rel=1e-4)
    assert found.duration == pytest.approx(time, abs=1.1e-4)


def test_brakes_take_the_energy_that_there_is(robot):
    """Kinetic energy of bodies and rotors, and what they fall."""
    pose, velocity = np.array([0.02, -0.03, 0.1]), np.array([0.3, -0.5, 1.0])
    found = uncontrolled_stops([instant(robot.parameters, pose, velocity)], [DRIVE] * 3, step=1e-4)
    slides = dict.fromkeys(("slide_a", "slide_b", "slide_c"), DRIVE.reflected_mass)
    parts = replace(robot.parameters, actuators=p3dof.machine.Actuators(armature=slides))
    kinetic = velocity @ p3dof.load(parts).mass_matrix(pose) @ velocity / 2
    *_, place, _ = follow(tuple(pose), tuple(velocity))
    path = np.linspace(0, 1, 101)[:, None] * (place - pose) + pose
    fallen = np.trapezoid(robot.gravity_forces(path) @ (place - pose), np.linspace(0, 1, 101))
    assert found.brake_energy.sum() == pytest.approx(kinetic - fallen, rel=1e-4)


def test_sliders_that_nothing_couples_stop_as_each_alone():
    """Sliders of 4 kg under a mechanism of 1e-9 of that: the closed form of one slider, to as much."""
    light = Body(4e-9, (0, 0, 0), np.eye(3) * 1e-12)
    bodies = p3dof.machine.parameters.Bodies(
        platform=light,
        **{name: Body(4.0, (0, 0, 0), np.eye(3) * 1e-3) for name in ("slider_a", "slider_b", "slider_c")},
        **dict.fromkeys(
            ("leg_a", "leg_b", "rod_left", "rod_right", "crossbar_upper", "crossbar_lower"), light
        ),
    )
    parts = replace(p3dof.PAPER, bodies=bodies)
    found = uncontrolled_stops([instant(parts, [0, 0, 0], [0, -0.3, 0])], [DRIVE] * 3, step=1e-3)
    gravity = -parts.gravity[2]
    hold = MOTOR.brake_torque * DRIVE.ratio
    way, force = brake_fall(4.0, DRIVE.reflected_mass, hold, 0.3, MOTOR.brake_time, gravity)
    np.testing.assert_allclose(found.way, way, rtol=1e-6)
    np.testing.assert_allclose(found.nut_force, force, rtol=1e-6)
    np.testing.assert_allclose(found.brake_energy, hold * (way - fallen_before(parts, DRIVE)), rtol=1e-6)


def fallen_before(parts, drive):
    a = 4.0 * -parts.gravity[2] / (4.0 + drive.reflected_mass)
    return 0.3 * drive.motor.brake_time + a * drive.motor.brake_time**2 / 2


def test_one_open_brake_lets_the_platform_fall(robot):
    """The other two hold: their sliders hardly move, and the machine does not come to rest."""
    open_ = replace(DRIVE, motor=replace(MOTOR, brake_torque=0.0), name="open")
    pieces = [instant(robot.parameters, [0, 0, 0], [0, 0, 0])]
    held = uncontrolled_stops(pieces, [DRIVE] * 3)
    assert held.way.max() < 0.005
    found = uncontrolled_stops(pieces, [DRIVE, DRIVE, open_])
    assert found.platform_way == math.inf
    assert found.duration == math.inf
    ways = {owner: one for owner, one in found.ratings if one.name == "way of a stop by the brakes"}
    assert ways["C"].share == math.inf
    both = stops_table([held, found])
    assert both.note == (
        f"by the brakes: P moves {number(1e3 * held.platform_way)} mm at most, in {number(held.duration)} s. "
        "by the brakes: no brake stops an axis within its travel (see brake_torque): it falls or runs on."
    )
    assert 0 < held.platform_way < 0.01
    assert {row[0]: row[3] for row in stops_table([found]).rows}["by the brakes: way [mm]"] == "– (no end)"


def test_a_motion_at_rest_with_closed_brakes_stays():
    quick = replace(DRIVE, motor=replace(MOTOR, brake_time=0.0), name="quick")
    found = uncontrolled_stops([instant(p3dof.PAPER, [0.05, 0, 0.1], [0, 0, 0])], [quick] * 3)
    np.testing.assert_array_equal(found.way, 0)
    held = p3dof.load().forces([0.05, 0, 0.1], [0] * 3, [0] * 3)
    np.testing.assert_allclose(found.nut_force, np.abs(held), rtol=1e-12)


def test_a_controlled_stop_of_the_machine(robot):
    """Ways are those of the ramps; the force at the nuts that of inverse dynamics along the stop."""
    pose, velocity = np.array([0.02, -0.03, 0.1]), np.array([0.3, -0.5, 1.0])
    change = np.array([1.0, 2.0, -3.0])
    ramp = StopRamp(8.0, 400.0, 0.004)
    found = controlled_stops([instant(robot.parameters, pose, velocity, change)], [DRIVE] * 3, ramp)
    moved = robot.mechanism_motion(pose, velocity, change)
    times, jerks = ramp.phases(moved.slider_velocities, moved.slider_accelerations)
    ways, states = [], []
    for k in range(3):
        args = moved.slider_velocities[k], moved.slider_accelerations[k], times[:, k], jerks[:, k]
        ways.append(abs(integrated(*args)[0]))
        states.append(args)
    np.testing.assert_allclose(found.way, ways, rtol=1e-9)
    longest = times.sum(axis=0).max()
    assert found.duration == pytest.approx(longest, rel=1e-14)
    nuts, h = [], 1e-5
    start = robot.sliders(pose)

    def sliders(t):
        out = []
        for v, a, durations, js in states:
            cut = np.clip(t - np.append(0, np.cumsum(durations)[:-1]), 0, durations)
            out.append(integrated(v, a, cut, js)[0])
        return start + np.array(out)

    for t in np.linspace(0, longest, 33)[1:-1]:
        before, here, after = (robot.forward_kinematics(sliders(s)) for s in (t - h, t, t + h))
        force = robot.forces(here, (after - before) / (2 * h), (after - 2 * here + before) / h**2)
        nuts.append(np.abs(force))
    inside = np.max(nuts, axis=0)
    edges = np.abs(robot.forces(pose, velocity, change))
    np.testing.assert_allclose(found.nut_force, np.maximum(inside, edges), rtol=2e-3)
    assert not found.brake_energy.any()


def test_the_worst_of_all_instants(robot, motion):
    """Of many together, the largest of each alone, with its time."""
    found = robot.inverse_dynamics(motion, method="compiled")
    ramp = StopRamp(30.0, 3000.0)
    together = emergency_stops(robot, found, DRIVE, ramp, instants=21)
    for kind, one in zip(("by the drives", "by the brakes"), together, strict=True):
        assert one.kind == kind
        each = []
        for k in range(len(motion)):
            state = motion.pose[k], motion.velocity[k], motion.acceleration[k]
            piece = instant(robot.parameters, *state)
            work = controlled_stops if kind == "by the drives" else uncontrolled_stops
            each.append(work([piece], [DRIVE] * 3, *([ramp] if kind == "by the drives" else [])))
        for name, when in (("way", "way_time"), ("nut_force", "nut_time"), ("brake_energy", "energy_time")):
            values = np.array([getattr(stop, name) for stop in each])
            np.testing.assert_allclose(getattr(one, name), values.max(axis=0), rtol=1e-9)
            np.testing.assert_array_equal(getattr(one, when), motion.time[values.argmax(axis=0)])
        platform = [stop.platform_way for stop in each]
        assert one.platform_way == pytest.approx(max(platform), rel=1e-9)
        assert one.platform_time == motion.time[int(np.argmax(platform))]


def test_a_task_stops_with_what_it_carries(robot):
    """Each piece with its payload and its load from outside."""
    part = Body(4.0, (0, 0, -0.04), np.zeros((3, 3)))
    pick = p3dof.Waypoint([-0.05, 0, 0], pick_up=part, dwell=0.1)
    way = [p3dof.Waypoint([0, 0, 0]), pick, p3dof.Waypoint([0.05, 0.05, 0], wrench=(0, 0, -40, 0, 0, 0))]
    plan = p3dof.Task(way).plan(duration=0.5, samples=21)
    (found,) = emergency_stops(robot, p3dof.design.forces_of_task(robot, plan), DRIVE)
    laden = robot.parameters.carrying(part)
    assert [piece.payload is not None for piece in plan.pieces] == [False, True, True]
    each = []
    for piece, parameters in zip(plan.pieces, (robot.parameters, laden, laden), strict=True):
        motion = piece.motion
        wrench = np.tile([0, 0, -40.0, 0, 0, 0] if piece is plan.pieces[-1] else [0.0] * 6, (len(motion), 1))
        states = motion.time, motion.pose, motion.velocity, motion.acceleration
        each.append(uncontrolled_stops([Instants(parameters, *states, wrench)], [DRIVE] * 3))
    for name in ("way", "nut_force", "brake_energy"):
        values = np.max([getattr(one, name) for one in each], axis=0)
        np.testing.assert_allclose(getattr(found, name), values, rtol=1e-12)


# --- ratings, tables, files, commands -----------------------------------------------------------------------


def test_ratings_of_stops(robot, motion):
    """What is left of the travel, the nut's static load, the motor's peak torque, the brake's energy."""
    found = robot.inverse_dynamics(motion, method="compiled")
    rated = Drive(replace(MOTOR, brake_energy=12.0), Screw(0.01, diameter=0.0127, length=0.5, static=1800.0))
    stops = emergency_stops(robot, found, [rated, DRIVE, DRIVE], StopRamp(30.0, 3000.0), instants=21)
    ratings = {(owner, one.name): one for stop in stops for owner, one in stop.ratings}
    ways = [f"{what} of a stop by the {by}" for by in ("drives", "brakes") for what in ("way",)]
    names = {"A": {*ways, "torque of a stop by the drives", "brake energy of a stop"}}
    names["A"] |= {f"nut force of a stop by the {by}" for by in ("drives", "brakes")}
    names["B"] = names["C"] = {*ways, "torque of a stop by the drives"}
    assert {leg: {name for owner, name in ratings if owner == leg} for leg in "ABC"} == names
    drives, brakes = stops
    one = ratings["A", "nut force of a stop by the brakes"]
    assert (one.required, one.allowed, one.time) == (brakes.nut_force[0], 900.0, brakes.nut_time[0])
    one = ratings["A", "brake energy of a stop"]
    assert (one.required, one.allowed, one.time) == (brakes.brake_energy[0], 12.0, brakes.energy_time[0])
    for one in (rating for (_, name), rating in ratings.items() if name.startswith("way")):
        row = int(np.argmin(np.abs(motion.time - one.time)))
        at = robot.sliders(motion.pose[row])
        assert np.abs(np.concatenate([0.2 - at, at + 0.2]) - one.allowed).min() < 1e-12
        assert one.required <= max(drives.way.max(), brakes.way.max())
    torque = ratings["B", "torque of a stop by the drives"]
    assert torque.required > 0
    assert torque.allowed <= 3.8
    sizing = p3dof.size_drives(robot, found, DRIVE)[0]
    given = [one for stop in stops for one in stop.ratings]
    assert with_others(sizing, given).others == tuple(given)


@shows("p3dof.design.drives.stopping.stops_table")
def test_the_table_of_stops(robot):
    """A stop of each slider by itself, from a state whose numbers are those of the integrators above."""
    pose, velocity = [0.02, -0.03, 0.1], [0.3, -0.5, 1.0]
    piece = instant(robot.parameters, pose, velocity)
    ramp = StopRamp(8.0, 400.0)
    stops = (controlled_stops([piece], [DRIVE] * 3, ramp), uncontrolled_stops([piece], [DRIVE] * 3, 1e-4))
    moved = robot.mechanism_motion(np.array(pose), np.array(velocity), np.zeros(3))
    args = moved.slider_velocities, moved.slider_accelerations
    times, jerks = ramp.phases(*args)
    ways = [abs(integrated(args[0][k], args[1][k], times[:, k], jerks[:, k])[0]) for k in range(3)]
    way, nut, work, place, time = follow(tuple(pose), tuple(velocity))
    here = robot.forward_kinematics(robot.sliders(pose) + np.sign(args[0]) * ways)
    rows = {
        "by the drives: way [mm]": [1e3 * value for value in ways],
        "by the drives: from t [s]": [0.5] * 3,
        "by the drives: force at the nut [N]": stops[0].nut_force.tolist(),
        "by the brakes: way [mm]": (1e3 * np.abs(way)).tolist(),
        "by the brakes: from t [s]": [0.5] * 3,
        "by the brakes: force at the nut [N]": nut.tolist(),
        "by the brakes: energy of the brake [J]": work.tolist(),
    }
    table = stops_table(stops)
    assert [row[0] for row in table.rows] == list(rows)
    for row, values in zip(table.rows, rows.values(), strict=True):
        np.testing.assert_allclose([float(cell) for cell in row[1:]], values, rtol=2e-3, err_msg=row[0])
    shown = {row[0]: [float(cell) for cell in row[1:]] for row in table.rows}
    path = 1e3 * np.linalg.norm(here[:2] - pose[:2])
    assert 1e3 * stops[0].platform_way == pytest.approx(path, rel=0.05)
    note = [1e3 * stops[0].platform_way, times.sum(axis=0).max(), 1e3 * np.linalg.norm(place[:2] - pose[:2])]
    assert stops[1].platform_way * 1e3 == pytest.approx(note[2], rel=1e-3)
    assert stops[1].duration == pytest.approx(time, abs=2e-4)
    note = [note[0], note[1], 1e3 * stops[1].platform_way, stops[1].duration]
    check_table(table, shown, note=note)


def test_a_stop_that_leaves_the_reach_has_no_end(robot, monkeypatch):
    """At 3 m/s the way is longer than the machine."""
    piece = instant(robot.parameters, [0, 0, 0], [0, 6.0, 0])
    found = controlled_stops([piece], [DRIVE] * 3, StopRamp(3.0, 400.0))
    assert found.platform_way == math.inf or found.way.max() > 0.4
    assert max(one.share for _, one in found.ratings if one.name.startswith("way")) > 1
    monkeypatch.setattr(stopping, "_LONGEST", 0.031)
    cut = uncontrolled_stops([instant(robot.parameters, [0, 0, 0], [0, -0.5, 0])], [DRIVE] * 3)
    assert cut.duration == math.inf


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"deceleration": 0, "jerk": 1}, "stop: deceleration: expected a number above zero"),
        ({"deceleration": 1, "jerk": -1}, "stop: jerk: expected a number above zero"),
        ({"deceleration": 1, "jerk": 1, "delay": -1}, "stop: delay: expected"),
    ],
)
def test_ramps_that_are_none(given, words):
    with pytest.raises(DriveError, match=words):
        StopRamp(**given)


def test_what_is_asked_of_something_else(robot, motion):
    found = robot.inverse_dynamics(motion, method="compiled")
    for args, words in (
        ((robot, found, 3), "drives: expected one Drive, or those of A, B and C"),
        ((robot, found, [DRIVE] * 2), "drives: expected one Drive, or those of A, B and C"),
        ((robot, found, DRIVE, 8), "ramp: expected a StopRamp, got 8"),
    ):
        with pytest.raises(DriveError, match=words):
            emergency_stops(*args)
    with pytest.raises(DriveError, match="instants: expected a whole number from 1, got 0"):
        emergency_stops(robot, found, DRIVE, instants=0)
    with pytest.raises(InputError, match="found: expected forces over a motion or a task"):
        emergency_stops(robot, 3, DRIVE)
    with pytest.raises(DriveError, match="static: expected a number above zero"):
        Screw(0.01, inertia=1e-5, static=0.0)
    with pytest.raises(DriveError, match="catalogue: stop: expected a StopRamp"):
        Catalogue([MOTOR], [DRIVE.transmission], stop=3)


FILE = """
motors:
  - {name: M, rated_torque: 1.3 Nm, peak_torque: 3.8 Nm, max_speed: 5000 rpm, inertia: 0.3 kg cm^2,
     brake_torque: 1.4 Nm, brake_time: 40 ms}
screws: [{name: 16x10, lead: 10 mm, diameter: 12.7 mm, length: 500 mm, static: 24 kN}]
stop: {deceleration: 8 m/s^2, jerk: 400 m/s^3, delay: 4 ms}
"""


def test_the_command_adds_stops_to_the_ratings(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drives.yaml").write_text(FILE, encoding="utf-8")
    (tmp_path / "task.yaml").write_text(
        "waypoints: [{pose: [0, 0, 0]}, {pose: [50 mm, 20 mm, 0]}]\n", encoding="utf-8"
    )
    assert read_catalogue("drives.yaml").stop == StopRamp(8.0, 400.0, 0.004)
    words = ["size", "task.yaml", "--duration", 1, "--drives", "drives.yaml", "--samples", 101]
    code, told, _ = run(capsys, *words, "--stops")
    assert code == 0
    assert "Emergency stops" in told
    assert "way of a stop by the brakes" in told
    assert "nut force of a stop by the drives" in told
    assert "Emergency stops" not in run(capsys, *words)[1]
    (tmp_path / "drives.yaml").write_text(FILE.replace("8 m/s^2", "8 mm"), encoding="utf-8")
    code, _, err = run(capsys, *words, "--stops")
    assert (code, err.count("\n")) == (2, 1)
    assert "stop: deceleration: expected an acceleration" in err


def test_an_axis_that_nothing_stops_is_said_in_words(tmp_path, capsys, monkeypatch):
    """The same by `size` and by `report`: no infinite way, and each warning once."""
    monkeypatch.chdir(tmp_path)
    bare = FILE.replace("brake_torque: 1.4 Nm, brake_time: 40 ms", "rated_speed: 3000 rpm")
    (tmp_path / "drives.yaml").write_text(bare, encoding="utf-8")
    (tmp_path / "task.yaml").write_text(
        "waypoints: [{pose: [0, 0, 0]}, {pose: [50 mm, 20 mm, 0]}]\n", encoding="utf-8"
    )
    options = ("task.yaml", "--duration", "1", "--drives", "drives.yaml", "--samples", "101", "--stops")
    code, told, _ = run(capsys, "size", *options)
    assert code == 1
    headline = told.splitlines()[0]
    for leg in "ABC":
        words = f"way of a stop by the brakes of {leg} has {FALLS}, at t = 0 s"
        assert words in headline
    assert "no brake stops an axis within its travel (see brake_torque): it falls or runs on." in told
    code, told, err = run(capsys, "report", *options, "--out", "report.html")
    assert code == 1
    assert f"way of a stop by the brakes of A has {FALLS} at t = 0 s" in told
    assert f"way of a stop by the brakes of B: {FALLS}, at t = 0 s" in told + err
    assert "inf m" not in told + err
    assert (told + err).count("M: no brake is given; the machine falls when the power fails") == 1


def test_a_way_that_ends_beyond_what_is_left_has_a_number():
    """Where nothing is left a finite way is told in metres; the axis does not fall."""
    ratings = [("A", Rating("way of a stop by the brakes", way, 0.0, "m", 0.25)) for way in (0.03, math.inf)]
    told = [_words(*one, None) for one in ratings]
    assert told == [
        "way of a stop by the brakes of A takes 0.03 m where none is permissible, at t = 0.25 s",
        f"way of a stop by the brakes of A has {FALLS}, at t = 0.25 s",
    ]
    assert re.search(r"no end .* the axis falls .* brake_torque", FALLS)


def test_an_assessment_counts_stops(robot, motion):
    found = robot.inverse_dynamics(motion, method="compiled")
    weak = Catalogue([replace(MOTOR, brake_energy=1e-3)], [DRIVE.transmission], stop=StopRamp(30.0, 3000.0))
    plain, stopped = (p3dof.assess(robot, found, drives=weak, stops=stops) for stops in (False, True))
    assert plain.stops == ()
    assert [one.kind for one in stopped.stops] == ["by the drives", "by the brakes"]
    assert {"brake energy of a stop", "torque of a stop by the drives"} <= {
        one.name for one in stopped.ratings if one.share > 1
    }
    assert not any("stop" in one.name for one in plain.ratings)
    with pytest.raises(InputError, match="stops: expected drives"):
        p3dof.assess(robot, found, stops=True)
    assert "Emergency stops" in p3dof.report.render_assessment(stopped)
    assert "Emergency stops" not in p3dof.report.render_assessment(plain)
