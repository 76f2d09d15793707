"""The fastest way along a path: published times, limits that hold in between, friction, power, bad input."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from task_files import BLENDED, LINE, PapersPath

import p3dof
from p3dof import Waypoint
from p3dof._base.errors import InputError, TaskError
from p3dof.design import AxisLimits, fastest_plan, forces_of_task
from p3dof.design.fastest import WayOfMachine
from p3dof.design.tasks.fastest import DENSE, Points, Programs, Rows, fastest_law
from p3dof.design.tasks.files import parse
from p3dof.design.tasks.laws import SpeedLaw
from p3dof.methods.utilisation import time_of_peak

NONE = np.zeros((1, 6))


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def lossy(robot):
    friction = p3dof.machine.Friction(viscous={"sliders": 40, "joints": 0.02}, coulomb={"sliders": 8})
    return p3dof.load(replace(robot.parameters, friction=friction))


# --- linear programs ----------------------------------------------------------------------------------------


def program_of(steps, points, seed):
    """Return a program of steps with three unknowns each, of which neighbours share one."""
    random = np.random.default_rng(seed)
    step = np.tile(np.arange(steps), points)
    parts = [(random.standard_normal((len(step), 3)), random.uniform(0.5, 2, len(step))) for _ in range(4)]
    within = [(np.eye(3)[[k] * steps], np.full(steps, 9.0)) for k in range(3)]
    columns = np.column_stack([np.arange(steps), np.arange(1, steps + 1), steps + 1 + np.arange(steps)])
    cost = -random.uniform(0.1, 1, 2 * steps + 1)
    return (
        [(row, bound, step) for row, bound in parts] + [(*one, np.arange(steps)) for one in within],
        columns,
        cost,
    )


def alone(parts, columns, cost, box, equal=None):
    """Return the least cost by SciPy, of a full matrix."""
    from scipy.optimize import linprog

    def matrix(rows, steps):
        full = np.zeros((len(rows), len(cost)))
        np.put_along_axis(full, columns[steps], rows, axis=1)
        return full

    rows, bounds, steps = (np.concatenate(part) for part in zip(*parts, strict=True))
    fixed = {} if equal is None else {"A_eq": matrix(equal[0], equal[2]), "b_eq": equal[1]}
    return linprog(cost, matrix(rows, steps), bounds, bounds=box, method="highs-ds", **fixed).fun


def test_programs_one_after_the_other_have_the_optima_of_each_alone():
    """More rows and other numbers: what is known of the program before may not show in the next."""
    programs = Programs()
    equal = np.tile([1.0, -1.0, 0.5], (20, 1)), np.zeros(20), np.arange(20)
    for points, seed, joined in ((3, 1, False), (5, 1, False), (5, 2, False), (5, 2, True), (3, 1, True)):
        parts, columns, cost = program_of(20, points, seed)
        box = np.column_stack([np.full(len(cost), -3.0), np.full(len(cost), np.inf)])
        rows = Rows()
        for part in parts:
            rows.add(*part)
        if joined:
            rows.add(*equal, least=0.0)
        found = programs.solved(cost, rows, columns, box, unit=1.0 + seed)
        assert cost @ found == pytest.approx(
            alone(parts, columns, cost, box, equal if joined else None), rel=1e-9
        )
        for row, bound, step in parts:
            assert (np.einsum("ij,ij->i", row, found[columns[step]]) <= bound + 1e-6).all()


def test_a_program_without_a_solution_is_an_error_and_the_next_one_has_its_own():
    programs = Programs()
    parts, columns, cost = program_of(10, 2, 3)
    box = np.column_stack([np.full(len(cost), -3.0), np.full(len(cost), np.inf)])
    best = alone(parts, columns, cost, box)
    for bounds in (None, -100.0, None):
        rows = Rows()
        for row, bound, step in parts:
            rows.add(row, bound if bounds is None else np.full(len(bound), bounds), step)
        if bounds is None:
            assert cost @ programs.solved(cost, rows, columns, box) == pytest.approx(best, rel=1e-9)
        else:
            with pytest.raises(TaskError, match="however slowly"):
                programs.solved(cost, rows, columns, box)


def test_the_library_says_nothing_where_tables_go():
    """One release writes its name as soon as a process begins to use it."""
    words = "from p3dof.design.tasks.fastest import Programs; Programs()"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


# --- published numbers --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("force", "speed", "nodes", "expected", "within"),
    [
        pytest.param(500, 2, 800, 0.20529, 1e-5, marks=pytest.mark.slow),
        (120, 1, 300, 0.47872, 2e-4),
        (200, 1.5, 400, 0.32812, 4e-5),
    ],
)
def test_the_least_time_of_a_blended_path(robot, force, speed, nodes, expected, within):
    """Found elsewhere by two ways, TOPP-RA and an interior-point method, equal to 2e-6."""
    found = fastest_plan(robot, BLENDED, AxisLimits(force, speed), nodes=nodes)
    assert found.duration == pytest.approx(expected, abs=within)


@pytest.mark.parametrize(
    ("force", "speed", "mass", "expected"),
    [(500, 2, 14.8044066, 0.52410), (1000, 2, 14.8044066, 0.37183), (1000, 2, 0, 0.23665)],
)
def test_the_least_time_of_the_papers_path(robot, force, speed, mass, expected):
    limits = AxisLimits(force, speed, reflected_mass=mass)
    way = WayOfMachine(robot, PapersPath(), NONE, limits.reflected_mass)
    even = np.linspace(0, 1, 401)
    law = fastest_law(even**2 * (3 - 2 * even), way, limits)
    assert law.duration == pytest.approx(expected, abs=3e-5)


def test_an_armature_of_the_machine_is_as_good_as_reflected_mass(robot):
    """The reference again: the limit is at the actuator, which moves its own rotor and screw."""
    drives = p3dof.machine.Actuators({"sliders": 14.8044066})
    way = WayOfMachine(
        p3dof.load(replace(robot.parameters, actuators=drives)), PapersPath(), NONE, np.zeros(3)
    )
    even = np.linspace(0, 1, 401)
    law = fastest_law(even**2 * (3 - 2 * even), way, AxisLimits(500, 2))
    assert law.duration == pytest.approx(0.52410, abs=3e-5)


def test_the_least_time_of_a_straight_line(robot):
    assert fastest_plan(robot, LINE, AxisLimits(500, 2)).duration == pytest.approx(0.15834, abs=1e-5)


def test_more_nodes_come_nearer(robot):
    times = [fastest_plan(robot, LINE, AxisLimits(300, 1), nodes=n).duration for n in (25, 50, 100, 400)]
    errors = np.array(times[:-1]) - times[-1]
    assert (errors > 0).all()
    assert errors[2] < errors[0] / 4


def test_more_nodes_come_nearer_with_dry_friction_too(lossy):
    """The last step is then 1e-7 of the way: a tolerance of the programs is a force there."""
    times = [fastest_plan(lossy, LINE, AxisLimits(300, 2), nodes=n).duration for n in (200, 400, 800)]
    assert 0 < times[1] - times[2] < (times[0] - times[1]) / 1.8


# --- the limits hold ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("power", [np.inf, 60.0])
@pytest.mark.parametrize("friction", [False, True])
def test_the_limits_hold_along_the_way_and_one_is_reached(robot, lossy, friction, power):
    machine = lossy if friction else robot
    task = p3dof.Task(
        [
            Waypoint([-0.1, 0, -0.2], "a", pick_up=p3dof.machine.Body(1.5, np.zeros(3), np.zeros((3, 3)))),
            Waypoint([0, 0.03, 0.1], "b", blend=0.02, wrench=[0, 0, -30, 0, 0, 0]),
            Waypoint([0.1, 0, 0.2], "c"),
        ]
    )
    plan = fastest_plan(machine, task, AxisLimits(250, 1.2, power), nodes=150, samples=7001)
    found = forces_of_task(machine, plan)
    force, speed = np.abs(found.forces) / 250, np.abs(found.slider_velocities) / 1.2
    used = [force, speed]
    if np.isfinite(power):
        used.append(found.forces * found.slider_velocities / power)
    assert np.max(used) < 1 + 2e-4
    most = np.max([part.max(axis=1) for part in used], axis=0)
    assert np.median(most) > 0.99  # one of the limits is reached nearly everywhere


@pytest.mark.parametrize("nodes", [60, 100])
def test_few_steps_keep_the_limits_too(robot, nodes):
    """Collocation at as few nodes would be faster than possible, and exceed the force by half."""
    plan = fastest_plan(robot, BLENDED, AxisLimits(500, 2), nodes=nodes, samples=8001)
    assert 1 <= plan.duration / 0.20529 < 1.003
    assert max(one.share for one in plan.uses) <= 1 + 1e-9
    assert np.abs(forces_of_task(robot, plan).forces).max() < 500 * 1.001


def test_friction_takes_time(robot, lossy):
    with_, without = (fastest_plan(m, LINE, AxisLimits(300, 2), nodes=60).duration for m in (lossy, robot))
    assert with_ > 1.001 * without


def test_a_limit_that_is_left_out_would_be_noticed(robot):
    """The dense check is what finds it: half the force at one place of a law that keeps the other limit."""
    limits = AxisLimits(300, 2)
    way = WayOfMachine(robot, LINE.paths[0], NONE, limits.reflected_mass)
    nodes = LINE.paths[0].end * np.linspace(0, 1, 101)
    law = fastest_law(nodes, way, limits)
    dense = Points.everywhere(nodes, DENSE, way)
    assert dense.shares(law, limits).max() <= 1
    assert dense.shares(law, AxisLimits(150, 2)).max() > 1.5


def test_a_law_of_speeds_is_a_motion():
    """Time, parameter, speed and acceleration belong together, for slopes of either sign and none."""
    nodes = np.array([0.0, 0.1, 0.3, 0.6, 1.0])
    law = SpeedLaw(nodes, np.array([0.0, 0.4, 0.9, 0.5, 0.0]), np.array([3.0, -4.0, 0.0, 1e-9]))
    time = np.linspace(0, law.duration, 40_001)
    place, speed, change = law.at(time)
    assert place[-1] == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(law.at(law.kinks)[0], nodes, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        np.interp(time, time, place)[1:],
        np.cumsum(np.diff(time) * (speed[1:] + speed[:-1]) / 2),
        rtol=0,
        atol=1e-8,
    )
    inside = np.abs(time[:, None] - law.kinks).min(axis=1) > 2 * time[1]
    np.testing.assert_allclose(np.gradient(speed, time)[inside], change[inside], rtol=0, atol=2e-6)


def test_stops_payloads_and_given_durations_are_kept(robot):
    task = parse(
        """
waypoints:
  - {name: a, pose: [0, 0, 0], dwell: 0.1}
  - {name: b, pose: [0.1, 0, 0], dwell: 0.2}
  - {name: c, pose: [0, 0, 0], duration: 0.5}
"""
    )
    plan = fastest_plan(robot, task, AxisLimits(300, 1.5))
    assert plan.times[2] - plan.times[1] == pytest.approx(0.7, abs=1e-12)
    assert plan.times[1] < 0.1 + 0.3


def test_the_time_of_a_peak_at_a_jump_is_that_of_the_jump():
    time, values = np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 1.0, 3.0, 2.0])
    assert time_of_peak(time, values, 2) == 1.0


# --- bad input ----------------------------------------------------------------------------------------------

BAD = {
    "force: expected above zero": lambda _: AxisLimits(0, 1),
    "speed: expected": lambda _: AxisLimits(1, [1, 2]),
    "power: expected": lambda _: AxisLimits(1, 1, np.nan),
    "reflected_mass: expected zero or more": lambda _: AxisLimits(1, 1, reflected_mass=-1),
    "waypoint 1 → waypoint 2: force: ": lambda robot: fastest_plan(robot, LINE, AxisLimits(30, 1)),
    "pick → place: force: ": lambda robot: fastest_plan(robot, BLENDED, AxisLimits([500, 500, 20], 1)),
}


@pytest.mark.parametrize(("words", "call"), BAD.items())
def test_limits_that_do_not_fit_are_one_clear_error(robot, words, call):
    with pytest.raises(TaskError, match=r"\A[^\n]*\Z") as found:
        call(robot)
    assert str(found.value).startswith(words)


def test_other_things_are_refused(robot):
    for call in (
        lambda: fastest_plan(None, LINE),
        lambda: fastest_plan(robot, None),
        lambda: fastest_plan(robot, LINE, 500),
        lambda: fastest_plan(robot, LINE, nodes=5),
        lambda: fastest_plan(robot, LINE, nodes=True),
    ):
        with pytest.raises(InputError, match="expected"):
            call()


PICK_AND_PLACE = parse(
    """
waypoints:
  - {name: home, pose: [0, 0, 0]}
  - name: pick
    pose: [-150 mm, 0, -15 deg]
    dwell: 200 ms
    pick_up: {mass: 2 kg, com: [0, 0, -40 mm], inertia: [0, 0, 0]}
  - {name: up, pose: [-150 mm, 25 mm], blend: 25 mm}
  - {name: over, pose: [150 mm, 25 mm], blend: 25 mm}
  - {name: place, pose: [150 mm, 0, 15 deg], dwell: 200 ms, put_down: true}
  - {name: back, pose: [0, 0, 0]}
"""
)


@pytest.mark.parametrize(("power", "most"), [(20.0, 1.51), pytest.param(10.0, 1.99, marks=pytest.mark.slow)])
def test_a_small_power_gives_a_slow_motion(robot, power, most):
    """Power is force by speed: any will do, if the motion is slow enough."""
    plan = fastest_plan(robot, PICK_AND_PLACE, AxisLimits(300, 2, power=power))
    assert plan.duration < most
    used = [use.share for use in plan.uses if use.quantity == "power"]
    assert 0.999 < max(used) <= 1 + 1e-9


# --- the command --------------------------------------------------------------------------------------------


def test_the_command_keeps_the_limits(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    p3dof.write_task(BLENDED, "task.yaml")
    code, out, _ = run(
        capsys,
        "fastest",
        "task.yaml",
        "--max-force",
        200,
        "--max-speed",
        1.5,
        "--nodes",
        150,
        "--out",
        "fast.csv",
    )
    assert code == 0
    motion = p3dof.Motion.from_csv("fast.csv", check=False)
    assert motion.duration == pytest.approx(0.32812, abs=3e-4)
    assert "last pose of the task is not its first" in out
    assert "pick → place" in out
    assert "pick to place" not in out


def test_a_limit_that_cannot_hold_the_machine_is_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    p3dof.write_task(BLENDED, "task.yaml")
    code, _, err = run(capsys, "fastest", "task.yaml", "--max-force", 20)
    assert code == 2
    assert "to stand still" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("waits", [0.0, 0.2])
def test_loads_of_the_fastest_motion_are_those_of_many_samples(robot, waits):
    """Both sides of a jump are samples, so that neither peaks nor work need more of them."""
    stops = [[0, 0, 0], [-0.12, -0.01, -0.17], [0.12, 0.01, 0.35], [0, 0, 0]]
    task = p3dof.Task([Waypoint(stop, dwell=waits * (k == 1)) for k, stop in enumerate(stops)])
    plan, fine = (fastest_plan(robot, task, AxisLimits(300.0, 2.0), samples=n).motion for n in (1001, 40_001))
    result, many = (robot.inverse_dynamics(motion, method="compiled") for motion in (plan, fine))
    assert result.warnings == ()
    np.testing.assert_allclose(result.peak_forces, many.peak_forces, rtol=1e-4)
    energy = robot.energy(result)
    power = many.forces * many.slider_velocities
    scale = np.trapezoid(np.abs(power), many.time, axis=0)
    assert np.all(np.abs(energy.work[-1] - np.trapezoid(power, many.time, axis=0)) <= 2e-4 * scale)
    assert np.abs(energy.balance).max() <= 5e-4 * energy.scale


@pytest.mark.parametrize("waits", [0.0, 0.2])
def test_the_fastest_motion_can_be_read_from_its_own_file(robot, tmp_path, waits):
    """Without a limit of jerk it begins and ends with full acceleration, so its samples have to say."""
    stops = [[0, 0, 0], [-0.12, -0.01, -0.17], [0.12, 0.01, 0.35], [0, 0, 0]]
    task = p3dof.Task([Waypoint(stop, dwell=waits * (k == 1)) for k, stop in enumerate(stops)])
    motion = fastest_plan(robot, task, AxisLimits(force=300.0, speed=2.0)).motion
    path = motion.to_csv(tmp_path / "motion.csv")
    read = p3dof.Motion.from_csv(path)  # which checks that accelerations belong to the velocities
    np.testing.assert_array_equal(read.acceleration, motion.acceleration)
    assert np.abs(motion.acceleration[[0, -1]]).max(axis=1).min() > 10
    resting = motion.time[np.all(motion.velocity == 0, axis=1)]
    assert len(resting) >= 4  # both ends and both stops
    waiting = np.all(motion.velocity == 0, axis=1) & (motion.time > 0) & (motion.time < motion.time[-1])
    if waits:
        assert np.sum(np.all(motion.acceleration[waiting] == 0, axis=1)) >= 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "speed", "power", "dwells"),
    [
        (250, 1.0, 120, True),
        pytest.param(250, 1.0, 120, False, marks=pytest.mark.slow),
        pytest.param(200, 2.0, 300, True, marks=pytest.mark.slow),
        (250, 0.5, np.inf, False),
    ],
)
def test_a_motion_with_many_jumps_can_be_read_from_its_own_file(robot, tmp_path, force, speed, power, dwells):
    """Between two jumps of the acceleration are samples enough to tell it from either side."""
    points = [point if dwells else replace(point, dwell=0.0) for point in PICK_AND_PLACE.waypoints]
    task = replace(PICK_AND_PLACE, waypoints=tuple(points))
    motion = fastest_plan(robot, task, AxisLimits(force, speed, power=power)).motion
    read = p3dof.Motion.from_csv(motion.to_csv(tmp_path / "motion.csv"))
    np.testing.assert_array_equal(read.acceleration, motion.acceleration)
