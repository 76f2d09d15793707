"""Shaped motions and motor references: impulses, modes by quadrature, and the whole machine on springs."""

import math
import re
from itertools import pairwise

import numpy as np
import pytest
from command_line import run
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq
from table_numbers import check_table, shows

import p3dof
from p3dof import InputError, Task, Waypoint
from p3dof.design import (
    AxisLimits,
    fastest_plan,
    forces_of_task,
    motor_references,
    residual_energies,
    residual_vibration,
    shaped,
    shaper,
    shapers_of,
)
from p3dof.design.tasks.laws import ProfileLaw, quintic, s_curve
from p3dof.design.tasks.paths import LengthPath, SampledPath
from p3dof.design.vibration import ShapedLaw, modes_table, swings_of, swings_table
from p3dof.machine import Body

PART = Body(3.0, [0, 0, -0.04], np.zeros((3, 3)))
TILT = math.pi / 12
SPRING = 2e5
LINE = Task([Waypoint([-0.15, 0.025, -TILT]), Waypoint([0.15, 0.025, TILT])], carrying=PART)


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def plain(robot):
    plan = LINE.plan(0.3)
    return forces_of_task(robot, plan)


@pytest.mark.parametrize(
    ("kind", "damping", "true", "left"),
    [
        ("zv", 0.01, 13.2, 0.1537433),
        ("zv", 0.01, 10.8, 0.1542271),
        ("zvd", 0.01, 13.2, 0.0236370),
        ("zvd", 0.01, 10.8, 0.0237860),
        ("zv", 0.05, 13.2, 0.1432095),
        ("zv", 0.05, 10.8, 0.1454796),
        ("zvd", 0.05, 13.2, 0.0205089),
        ("zvd", 0.05, 10.8, 0.0211643),
    ],
)
def test_a_wrong_frequency_leaves_what_singer_and_seering_say(kind, damping, true, left):
    found = shaper(kind, 12.0, damping)
    assert residual_vibration(found, true, damping) == pytest.approx(left, abs=5.1e-8)
    assert residual_vibration(found, 12.0, damping) < 1e-15
    assert found.shares.sum() == pytest.approx(1.0, abs=1e-15)
    steps = (1 if kind == "zv" else 2) / (24 * math.sqrt(1 - damping**2))
    assert found.duration == pytest.approx(steps, rel=1e-15)


@pytest.mark.parametrize(("kind", "width"), [("zv", 0.06369), ("zvd", 0.28713)])
def test_the_width_within_which_a_twentieth_is_left(kind, width):
    found = shaper(kind, 1.0)
    ends = [
        brentq(lambda f: residual_vibration(found, f) - 0.05, *bracket) for bracket in ((0.5, 1), (1, 1.5))
    ]
    assert ends[1] - ends[0] == pytest.approx(width, abs=5.1e-6)


def left_over(law, length, frequency, damping):
    """Amplitude of a linear mode after a move, integrated in time [m]."""
    rate = 2 * math.pi * frequency

    def change(time, state):
        place = law.at(np.array([time]))[0][0]
        return [state[1], rate**2 * (place - state[0]) - 2 * damping * rate * state[1]]

    state, ends = [0.0, 0.0], np.union1d(law.kinks, [0.0, law.duration])
    for pair in pairwise(ends):
        state = solve_ivp(change, pair, state, method="DOP853", rtol=1e-11, atol=1e-14).y[:, -1]
    off = state[0] - length
    return math.hypot(off, (state[1] / rate + damping * off) / math.sqrt(1 - damping**2))


def test_a_linear_mode_in_time_is_left_with_the_numbers_of_the_formula():
    law = ProfileLaw(quintic, 0.3, 0.25)
    plain = left_over(law, 0.3, 13.2, 0.02)
    assert plain == pytest.approx(3.209706e-3, abs=5.1e-10)
    for kind, left in (("zv", 4.849086e-4), ("zvd", 7.325789e-5)):
        own = shaper(kind, 12.0, 0.02)
        found = left_over(ShapedLaw(law, own), 0.3, 13.2, 0.02)
        assert found == pytest.approx(left, abs=5.1e-11)
        assert found / plain == pytest.approx(residual_vibration(own, 13.2, 0.02), rel=1e-8)


def test_modes_are_convolved_and_none_of_them_is_left():
    found = shaper("zvd", [11.0, 29.0, 33.0], 0.03)
    assert len(found.times) == 27
    assert (np.diff(found.times) >= 0).all()
    for mode in (11.0, 29.0, 33.0):
        assert residual_vibration(found, mode, 0.03) < 1e-15


@pytest.mark.parametrize("profile", [quintic, s_curve])
def test_a_shaped_law_is_the_sum_of_its_parts_and_its_rates_are_its_own(profile):
    law = ProfileLaw(profile, 0.4, 0.7)
    found = ShapedLaw(law, shaper("zvd", [3.0, 7.0]))
    place, speed, change = found.at(np.array([0.0, found.duration]))
    assert place == pytest.approx([0.0, 0.4], abs=1e-15)
    assert speed == pytest.approx([0.0, 0.0], abs=1e-15)
    assert change == pytest.approx([0.0, 0.0], abs=1e-12)
    time, step = np.random.default_rng(3).uniform(0.01, found.duration - 0.01, 50), 1e-5
    clear = np.abs(time[:, None] - found.kinks).min(axis=1) > 2 * step
    before, here, after = (found.at(time[clear] + shift) for shift in (-step, 0.0, step))
    assert (after[0] - before[0]) / (2 * step) == pytest.approx(here[1], abs=1e-8)
    assert (after[1] - before[1]) / (2 * step) == pytest.approx(here[2], abs=1e-6)
    when = found.when(here[0])
    assert found.at(when)[0] == pytest.approx(here[0], abs=1e-14)


def test_the_path_is_kept(robot):
    task = Task(
        [
            Waypoint([-0.15, 0, -0.2], dwell=0.1),
            Waypoint([-0.02, 0.04], blend=0.05),
            Waypoint([0.15, 0, 0.2]),
            Waypoint([0.05, 0.01, 0]),
        ]
    )
    plan = task.plan(0.9)
    each = shapers_of(robot, plan, 1e6)
    found = shaped(plan, each)
    assert found.duration == pytest.approx(0.9 + sum(one.duration for one in each), abs=1e-15)
    path = task.paths[0]
    rows = (found.motion.time > 0.1) & (found.motion.time < found.times[2])
    poses = found.motion.pose[rows]
    assert len(poses) > 300
    for y, z, theta in poses[::40]:
        s = brentq(lambda s, y=y: path.at(np.array([s]))[0][0, 0] - y, 0, path.end, xtol=1e-16, rtol=1e-15)
        assert path.at(np.array([s]))[0][0, 1:] == pytest.approx([z, theta], abs=1e-14)
    assert [piece.name for piece in found.pieces] == [piece.name for piece in plan.pieces]
    assert (found.motion.pose[-1] == plan.motion.pose[-1]).all()


def linear(robot, pose, k):
    """Mass, stiffness and its part by gravity about rest, by differences of the virtual powers' formulas."""
    held = robot.forces(pose, np.zeros(3), np.zeros(3), method="virtual-power")

    def load(x):
        jacobian = robot.jacobian(x, method="virtual-power")
        return robot.gravity_forces(x) - jacobian.T @ held

    steps = 1e-5 * np.eye(3)
    gravity = np.column_stack([(load(pose + step) - load(pose - step)) / 2e-5 for step in steps])
    jacobian = robot.jacobian(pose, method="virtual-power")
    return robot.mass_matrix(pose, method="virtual-power"), k * jacobian.T @ jacobian, gravity


@pytest.mark.parametrize(
    ("part", "pose", "modes"),
    [
        (None, [0, 0, 0], [28.95971, 70.27646, 77.93003]),
        (PART, [-0.15, 0.025, -TILT], [30.19749, 67.67730, 74.83285]),
    ],
)
def test_the_frequencies_are_those_of_differences(robot, part, pose, modes):
    machine = robot if part is None else p3dof.Manipulator(robot.parameters.carrying(part))
    mass, springs, gravity = linear(machine, np.array(pose, float), 1e6)
    stiffness = springs + (gravity + gravity.T) / 2
    found = np.sqrt(eigh(stiffness, mass, eigvals_only=True)) / (2 * math.pi)
    assert found == pytest.approx(modes, abs=5.1e-6)
    own = machine.indices(pose, drive_stiffness=1e6, rods=None).frequency
    assert own == pytest.approx(found, rel=1e-8)


def test_a_small_move_leaves_the_energy_of_its_linear_modes(robot):
    start, way, none = np.array([-0.05, 0.02, 0.1]), np.array([8e-6, 6e-6, 3e-5]), np.zeros(3)
    found = forces_of_task(robot, Task([Waypoint(start), Waypoint(start + way)]).plan(0.05))
    middle = rest = start + way / 2
    for _ in range(20):
        held = robot.forces(rest, none, none, method="virtual-power")
        rest = robot.forward_kinematics(robot.sliders(middle) - held / SPRING)
    mass, springs, gravity = linear(robot, rest, SPRING)
    gravity = (gravity + gravity.T) / 2
    way = np.linalg.solve(robot.jacobian(rest), robot.jacobian(middle) @ way)
    squares, shapes = eigh(springs + gravity, mass)
    time, rates = np.linspace(0, 0.05, 20001), np.sqrt(squares)
    place, _, change = quintic(time / 0.05)
    pushes = np.outer(change / 0.05**2, mass @ way) + np.outer(place - 1, gravity @ way)
    moved = np.trapezoid(pushes @ shapes * np.exp(1j * np.outer(time, rates)), time, axis=0)
    moved += 1j * (gravity @ way @ shapes) / rates  # where it begins it is off the last place of rest
    energy = (np.abs(moved) ** 2).sum() / 2
    assert residual_energies(robot, found, SPRING)[0] == pytest.approx(energy, rel=1e-4)


def share(robot, found, plain, true, assumed=None):
    return math.sqrt(
        residual_energies(robot, found, true, assumed)[0] / residual_energies(robot, plain, true)[0]
    )


def test_elastic_inverse_dynamics_leaves_nothing_where_the_stiffness_is_known(robot, plain):
    assert share(robot, plain, plain, SPRING, SPRING) < 1e-8
    for error in (0.8, 1.2):
        assert 0.1 < share(robot, plain, plain, SPRING * error, SPRING) < 0.25


BLENDS = [
    Waypoint([-0.15, 0, -TILT]),
    Waypoint([-0.15, 0.025], blend=0.025),
    Waypoint([0.15, 0.025], blend=0.025),
    Waypoint([0.15, 0, TILT]),
]


@pytest.mark.parametrize(
    ("options", "impulses"),
    [
        ({"profile": "s-curve"}, None),
        ({"smoothness": 3, "profile": "septic"}, None),
        ({"path": "spline"}, None),
        ({}, shaper("zv", [14.0, 33.0])),
    ],
)
def test_elastic_inverse_dynamics_bears_bends_of_laws_and_paths(robot, options, impulses):
    plan = Task(BLENDS, carrying=PART, **options).plan(0.4)
    given = forces_of_task(robot, plan)
    found = given if impulses is None else forces_of_task(robot, shaped(plan, impulses, 301))
    assert share(robot, found, given, SPRING, SPRING) < 1e-8


@pytest.mark.parametrize(
    ("points", "jerk", "left"),
    [(LINE.waypoints, 500.0, 1e-8), (LINE.waypoints, np.inf, 1e-5), (BLENDS, np.inf, 5e-3)],
)
def test_elastic_inverse_dynamics_of_a_motion_in_the_least_time(robot, points, jerk, left):
    """Where accelerations jump, and change a little at each of 400 nodes, samples tell less."""
    limits = AxisLimits(400.0, 2.0, jerk=jerk)
    found = forces_of_task(robot, fastest_plan(robot, Task(points, carrying=PART), limits))
    assert share(robot, found, found, SPRING, SPRING) < left


@pytest.mark.parametrize("error", [0.8, 1.2])
def test_with_zvd_on_top_a_wrong_stiffness_leaves_less_than_a_twentieth(robot, plain, error):
    plan = shaped(plain.plan, shapers_of(robot, plain.plan, SPRING))
    found = forces_of_task(robot, plan)
    assert share(robot, found, plain, SPRING * error, SPRING) < 0.05
    assert share(robot, found, plain, SPRING) < 0.1
    assert share(robot, found, plain, SPRING, SPRING) < 1e-8  # kinks where impulses begin and end included


def test_each_way_has_its_payload_and_its_energy(robot):
    stops = [
        Waypoint([0, 0, 0]),
        Waypoint([-0.1, 0, -0.1], pick_up=PART, dwell=0.1),
        Waypoint([0, 0.03], blend=0.03),
        Waypoint([0.1, 0, 0.1], put_down=True),
        Waypoint([0, 0, 0]),
    ]
    task = Task(stops)
    found = forces_of_task(robot, task.plan(0.7))
    energies = residual_energies(robot, found, SPRING)
    assert energies.shape == (3,)
    alone = Task(stops[3:4] + stops[4:], carrying=PART).plan(
        float(found.plan.source.stretches[2].law.duration)
    )
    last = residual_energies(robot, forces_of_task(robot, alone), SPRING)[0]
    assert last == pytest.approx(energies[2], rel=1e-6)
    assert (residual_energies(robot, found, SPRING, SPRING) < 1e-16 * energies).all()


def test_references_are_sliders_and_forces_by_stiffness(robot, plain, tmp_path):
    k = np.array([1e5, 2e5, 4e5])
    found, result = motor_references(plain, k), plain.results[0]
    motion = result.motion
    wanted = robot.sliders(motion.pose) + plain.nut_forces / k
    assert found.positions == pytest.approx(wanted, abs=1e-15)
    slopes = np.gradient(wanted, motion.time, axis=0, edge_order=2)
    assert found.velocities == pytest.approx(slopes, abs=2e-4)
    rigid = motor_references(plain, np.inf)
    assert rigid.velocities == pytest.approx(result.slider_velocities, abs=1e-8)
    rows = np.loadtxt(found.to_csv(tmp_path / "motors.csv"), delimiter=",", skiprows=1)
    assert (rows == np.column_stack([found.time, found.positions, found.velocities])).all()


def test_a_motion_in_the_least_time_is_shaped_too(robot):
    task = Task([Waypoint([-0.1, 0, -0.1]), Waypoint([0.1, 0, 0.1])])
    plan = fastest_plan(robot, task, AxisLimits(300.0, 2.0), nodes=40)
    own = shaper("zv", 30.0)
    found = shaped(plan, own)
    assert found.duration == pytest.approx(plan.duration + own.duration, abs=1e-14)
    assert not hasattr(found, "uses")
    with pytest.raises(InputError, match="one for each of 1 ways"):
        shaped(plan, [own, own])


@shows("p3dof.design.vibration.swings_table", "p3dof.design.vibration.modes_table")
def test_the_tables_have_what_machine_and_energies_have(robot):
    task = Task([*LINE.waypoints, LINE.waypoints[0]], carrying=PART)
    plan = task.plan(0.7, 51)
    k = np.array([2e5, 3e5, 2.5e5])
    shapers = shapers_of(robot, plan, k, "zv")
    given, found = forces_of_task(robot, plan), forces_of_task(robot, shaped(plan, shapers))
    machine = p3dof.Manipulator(robot.parameters.carrying(PART))
    rows = {}
    for piece, one in zip(plan.pieces, shapers, strict=True):
        modes = []
        for pose in piece.motion.pose:
            mass, springs, gravity = linear(machine, pose, k)
            stiffness = springs + (gravity + gravity.T) / 2
            modes.append(np.sqrt(eigh(stiffness, mass, eigvals_only=True)) / (2 * math.pi))
        first, second, third = np.array(modes).mean(axis=0)
        time = 0.35 + 1 / (2 * first) + 1 / (second + third)
        assert one.duration == pytest.approx(time - 0.35, rel=1e-6)
        used = (first, (second + third) / 2)
        rows[piece.name] = (first, second, third, 0.35, used, time)
    table = modes_table(robot, plan, found.plan, k)
    check_table(table, rows, header=[1, 2, 3])
    plain = modes_table(robot, plan, plan, k)
    assert [row[:5] for row in plain.rows] == [row[:5] for row in table.rows]
    assert all(row[5:] == ("–", "–") for row in plain.rows)

    swings = swings_of(robot, given, found, k, "zv")
    cases = (
        ("plain", "sliders", "as given", given, 1.0, None),
        ("ZV", "sliders", "as given", found, 1.0, None),
        ("ZV", "references", "as given", found, 1.0, k),
        ("ZV", "references", "20% less", found, 0.8, k),
        ("ZV", "references", "20% more", found, 1.2, k),
    )
    rows, whole = [], None
    for motion, motors, words, forces, share_of_k, assumed in cases:
        left = residual_energies(robot, forces, share_of_k * k, assumed)
        whole = left.max() if whole is None else whole
        stop, swing = forces.plan.pieces[int(left.argmax())].last, math.sqrt(left.max() / whole)
        seen = ("< 1e-12", "< 0.1%") if assumed is k and share_of_k == 1 else (left.max(), swing)
        rows.append((motion, motors, words, forces.plan.duration, *seen, stop))
    check_table(swings_table(swings, found.plan), rows)
    alone = swings_of(robot, given, given, k)
    rest = cases[:1] + cases[2:]
    assert [(one.motion, one.motors, one.stiffness) for one in alone] == [("plain", *c[1:3]) for c in rest]
    assert alone[0] == swings[0]
    assert alone[3].energy == residual_energies(robot, given, 1.2 * k, k).max()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: shaper("ei", 12.0), "kind: expected one of zv, zvd"),
        (lambda: shaper("zv", 0.0), "frequency: expected a positive"),
        (lambda: shaper("zv", []), "frequency: expected a number or a row"),
        (lambda: shaper("zv", [[1.0]]), "frequency: expected a number or a row"),
        (lambda: shaper("zv", "fast"), "frequency: expected"),
        (lambda: shaper("zv", 12.0, 1.0), "damping: expected a damping ratio below 1"),
        (lambda: shaper("zv", 12.0, -0.1), "damping: expected"),
        (lambda: residual_vibration("zv", 12.0), "shaping: expected a Shaper"),
        (lambda: residual_vibration(shaper("zv", 12.0), -1), "frequency: expected"),
        (lambda: shaped(3, shaper("zv", 12.0)), "plan: expected a Plan"),
        (lambda: shaped(LINE.plan(1.0), "zv"), "shapers: expected one, or one for each of 1 ways"),
        (lambda: motor_references(3, 1e6), "found: expected a TaskForces"),
        (
            lambda: shapers_of(p3dof.load(), LINE.plan(1.0), [1e6, 1e6]),
            "drive_stiffness: expected a positive",
        ),
        (lambda: shapers_of(p3dof.load(), LINE.plan(1.0), "stiff"), "drive_stiffness: expected real numbers"),
        (lambda: shapers_of(p3dof.load(), LINE.plan(1.0), 0), "drive_stiffness: expected a positive"),
        (lambda: shapers_of(p3dof.load(), LINE.plan(1.0), math.inf), "drive_stiffness: expected a finite"),
        (lambda: shapers_of(p3dof.load(), 3, 1e6), "plan: expected"),
    ],
)
def test_what_does_not_fit_is_one_clear_line(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


FILE = """
name: line
carrying: {mass: 3 kg, com: [0, 0, -40 mm], inertia: [0, 0, 0]}
waypoints:
  - {name: pick, pose: [-150 mm, 25 mm, -15 deg]}
  - {name: place, pose: [150 mm, 25 mm, 15 deg]}
"""


@pytest.fixture
def line(tmp_path):
    (tmp_path / "line.yaml").write_text(FILE, encoding="utf-8")
    return tmp_path / "line.yaml"


def test_a_planned_task_is_shaped_and_its_motors_led(robot, plain, line, capsys):
    files = [line.with_name(name) for name in ("motion.csv", "motors.csv")]
    given = "--duration", 0.3, "--drive-stiffness", "0.2 N/um", "--shape", "zvd", "--samples", 301
    code, told, _ = run(capsys, "plan", line, *given, "--out", files[0], "--motors-out", files[1])
    assert code == 0
    same = p3dof.read_task(line).plan(0.3, 301)
    plan = shaped(same, shapers_of(robot, same, SPRING), 301)
    found = motor_references(forces_of_task(robot, plan), SPRING)
    rows = np.loadtxt(files[1], delimiter=",", skiprows=1)
    assert rows[:, :4] == pytest.approx(np.column_stack([found.time, found.positions]), abs=1e-15)
    assert rows[:, 4:] == pytest.approx(found.velocities, abs=1e-10)  # roundings by the time between samples
    motion = p3dof.Motion.from_csv(files[0])
    assert motion.duration == pytest.approx(plan.duration, abs=1e-12)
    assert "Natural frequencies on elastic drives" in told
    assert f"{plan.duration:.6g}" in told
    energy = residual_energies(robot, plain, SPRING)[0]
    first = next(row for row in told.splitlines() if "plain" in row)
    assert [f"{energy:.3g}", "100.0%"] == [cell.strip() for cell in first.split("│")[5:7]]
    assert "exceeds" not in told


def test_the_path_of_a_motion_is_shaped_by_its_length(robot):
    """Of a line the shaped poses are the impulses' sum of the plain ones; of a curve they stay on it."""
    motion = LINE.plan(0.3, 201).motion
    plan = fastest_plan(robot, motion, AxisLimits(400.0, 2.0, jerk=500.0), nodes=30)
    own = shaper("zvd", 30.0)
    found = shaped(plan, own)
    law, path = plan.source.stretches[0].law, plan.source.stretches[0].path
    time = found.motion.time
    wanted = sum(
        part * path.at(law.at(np.clip(time - start, 0, law.duration))[0])[0]
        for start, part in zip(own.times, own.shares, strict=True)
    )
    assert found.motion.pose == pytest.approx(wanted, abs=1e-9)

    way = LengthPath(SampledPath(Task(BLENDS, path="spline").plan(0.5).motion, 0.1))
    places, step = np.linspace(0.05, 0.95, 40) * way.end, 1e-6
    before, here, after = (way.at(places + shift) for shift in (-step, 0.0, step))
    assert np.linalg.norm(here[1] * [1, 1, 0.1], axis=1) == pytest.approx(1.0, abs=1e-6)
    for k in (0, 1):
        assert (after[k] - before[k]) / (2 * step) == pytest.approx(here[k + 1], rel=1e-6, abs=1e-6)


def test_a_shape_that_exceeds_the_limits_of_the_fastest_motion_is_said(line, capsys):
    given = "--max-force", 400, "--nodes", 40, "--samples", 101
    drives = "--drive-stiffness", "2e5,2e5,250 N/mm"
    code, told, _ = run(capsys, "fastest", line, *given, *drives, "--shape", "zv")
    assert code == 1
    assert "the shaped motion exceeds limits that the plain one keeps" in told
    assert "Motor references jump where accelerations do" in told
    assert "Limits of the time-optimal motion" not in told
    assert re.search(r"force A \[N\] .* 400 +task +10\d\.\d%", told)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--shape", "zv"), "--shape: expected with --drive-stiffness"),
        (("--motors-out", "m.csv"), "--motors-out: expected with --drive-stiffness"),
        (("--shape", "ei", "--drive-stiffness", 1), "'--shape': 'ei' is not one of 'zv', 'zvd'"),
        (("--drive-stiffness", 0), "'--drive-stiffness': expected positive numbers, got '0'"),
        (("--drive-stiffness", "1,2"), "'--drive-stiffness': expected one number, or three"),
        (("--drive-stiffness", "3 mm"), "expected a stiffness, a number in N/m"),
        (
            ("--drive-stiffness", 1),
            "--drive-stiffness: expected drives that hold the machine, got [1. 1. 1.] N/m",
        ),
    ],
)
def test_options_that_do_not_fit_are_one_clear_line(line, capsys, options, words):
    code, out, err = run(capsys, "plan", line, "--duration", 0.3, "--samples", 11, *options)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
