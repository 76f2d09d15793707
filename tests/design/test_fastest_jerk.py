"""The fastest way with a limited jerk: least times, limits between the nodes, nut forces, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from task_files import BLENDED, LINE, SMOOTHER

import p3dof
from p3dof._base.errors import TaskError
from p3dof.design import AxisLimits, fastest_plan, forces_of_task
from p3dof.design.tasks.files import dump, parse
from p3dof.design.tasks.laws import SmoothLaw

SPLINE = parse(
    "path: spline\nwaypoints: [{pose: [-150 mm, 0, -15 deg]}, {pose: [0, 50 mm, 0], blend: 1 mm},"
    " {pose: [150 mm, 30 mm, 15 deg]}]"
)
PAYLOAD = p3dof.machine.Body(1.0, np.array([0, 0, -0.04]), np.zeros((3, 3)))


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


def dense(robot, plan):
    """Return force, speed, power and jerk between close samples, apart from the plan's own."""
    found = forces_of_task(robot, plan)
    step = np.diff(found.time)
    kept = step > 1e-8 * plan.duration
    jerk = np.diff(found.slider_accelerations, axis=0)[kept] / step[kept, None]
    power = found.forces * found.slider_velocities
    return np.abs(found.forces), np.abs(found.slider_velocities), power, np.abs(jerk)


def test_the_least_time_of_a_straight_line(robot):
    """Found elsewhere by programs over time with a piecewise constant and a piecewise linear jerk."""
    plan = fastest_plan(robot, LINE, AxisLimits(500, 2, jerk=500), nodes=100)
    assert plan.duration == pytest.approx(0.2733, abs=2e-4)


def test_a_lone_jerk_gives_the_closed_form(robot):
    """A vertical way d in four parts of constant jerk takes (32 d / j)^(1/3)."""
    task = parse("waypoints: [{pose: [0, -0.05, 0]}, {pose: [0, 0.05, 0]}]")
    plan = fastest_plan(robot, task, AxisLimits(1e4, 100, jerk=300), nodes=80)
    assert plan.duration == pytest.approx((32 * 0.1 / 300) ** (1 / 3), rel=5e-4)


@pytest.mark.parametrize(
    ("task", "limits"),
    [
        pytest.param(BLENDED, AxisLimits(500, 2, jerk=500), marks=pytest.mark.slow),
        pytest.param(SMOOTHER, AxisLimits(120, 1, jerk=[2000, 3000, 1500]), marks=pytest.mark.slow),
        (SPLINE, AxisLimits(300, 0.9, 100, jerk=1000)),
    ],
)
def test_the_limits_hold_between_the_nodes(robot, task, limits):
    plan = fastest_plan(robot, task, limits, nodes=60, samples=20_001)
    force, speed, power, jerk = dense(robot, plan)
    assert (force / limits.force).max() < 1.0005
    assert (speed / limits.speed).max() < 1.0005
    assert (power / limits.power).max() < 1.0005
    assert (jerk / limits.jerk).max() < 1.0005
    assert (jerk / limits.jerk).max() > 0.99


@pytest.mark.slow
def test_friction_and_a_payload_count(robot):
    friction = p3dof.machine.Friction(viscous={"sliders": 20}, coulomb={"sliders": 5})
    machine = p3dof.load(replace(robot.parameters, friction=friction))
    task = p3dof.Task(LINE.waypoints, carrying=PAYLOAD)
    limits = AxisLimits(150, 2, jerk=1500)
    laden, bare = (fastest_plan(robot, one, limits, nodes=60) for one in (task, LINE))
    lossy = fastest_plan(machine, task, limits, nodes=60, samples=10_001)
    assert lossy.duration > 1.002 * laden.duration > 1.02 * bare.duration
    force, _, _, jerk = dense(machine, lossy)
    assert 0.99 < force.max() / 150 < 1.001
    assert 0.99 < jerk.max() / 1500 < 1.001


@pytest.mark.slow
def test_smoother_blends_are_faster_within_a_jerk(robot):
    times = [
        fastest_plan(robot, t, AxisLimits(500, 2, jerk=500), nodes=40).duration for t in (SMOOTHER, BLENDED)
    ]
    assert times[0] < 0.95 * times[1]


def test_a_high_jerk_comes_near_to_the_time_without(robot):
    found = [
        fastest_plan(robot, BLENDED, AxisLimits(500, 2, jerk=j), nodes=60).duration for j in (1e6, np.inf)
    ]
    assert 1 < found[0] / found[1] < 1.003


def test_more_steps_come_nearer_with_the_square_of_their_number(robot):
    times = [fastest_plan(robot, LINE, AxisLimits(500, 2, jerk=500), nodes=n).duration for n in (15, 30, 100)]
    errors = np.array(times[:2]) - times[2]
    assert errors[0] > 2.5 * errors[1] > 0


def test_the_third_derivative_of_a_path():
    for task in (BLENDED, SMOOTHER, SPLINE):
        path = task.paths[0]
        place = path.end * np.array([0.03, 0.11, 0.28, 0.43, 0.77, 0.95])
        step = 1e-5 * path.end
        around = (path.at(place + step)[2] - path.at(place - step)[2]) / (2 * step)
        np.testing.assert_allclose(path.third(place), around, rtol=0, atol=1e-6 * np.abs(around).max())


def test_a_smooth_law_is_a_motion_from_rest_to_rest():
    nodes = np.linspace(0, 1, 6)
    size, changes, bulges = 0.2, np.array([0, 1.0, 2, -1, 0.5, 0]), np.array([0.1, -0.4, 0, 0.2, 0.3])
    rises = size * (changes[1:] + changes[:-1] + 4 / 3 * bulges)
    law = SmoothLaw(nodes, np.append(2.0, 2.0 + np.cumsum(rises)), changes, bulges, 0.7)
    time = np.linspace(0, law.duration, 40_001)
    place, speed, change = law.at(time)
    assert (place[0], speed[0], change[0]) == (0, 0, 0)
    np.testing.assert_allclose((place[-1], speed[-1], change[-1]), (0.7, 0, 0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.gradient(place, time), speed, rtol=0, atol=1e-5)
    np.testing.assert_allclose(np.gradient(speed, time), change, rtol=0, atol=2e-3)
    assert np.abs(np.diff(change)).max() < 1e-2  # no jump
    np.testing.assert_allclose(law.slowed(2.0).duration, 2 * law.duration, rtol=1e-12)


def test_a_nut_does_not_bear_what_turns(robot):
    limits = AxisLimits(600, 2, reflected_mass=9.0, nut_force=200)
    plan = fastest_plan(robot, LINE, limits, samples=5001)
    found = forces_of_task(robot, plan)  # the bare machine's forces are those of the nuts
    assert np.abs(found.forces).max() == pytest.approx(200, rel=2e-4)
    use = next(one for one in plan.uses if (one.quantity, one.leg) == ("nut force", "A"))
    assert use.holds_at == "nut"
    assert use.value == pytest.approx(np.abs(found.forces[:, 0]).max(), rel=1e-3)
    motor = found.forces + 9.0 * found.slider_accelerations
    actuator = next(one for one in plan.uses if (one.quantity, one.leg) == ("force", "B"))
    assert actuator.holds_at == "actuator"
    assert actuator.value == pytest.approx(np.abs(motor[:, 1]).max(), rel=1e-3)


def test_armature_and_balance_of_the_machine_are_of_the_actuator(robot):
    added = p3dof.machine.Actuators(armature={"sliders": 6.0}, counterbalance={"sliders": 40.0})
    machine = p3dof.load(replace(robot.parameters, actuators=added))
    for limits in (AxisLimits(600, 2, nut_force=150), AxisLimits(150, 2, jerk=2000, nut_force=400)):
        plan = fastest_plan(machine, LINE, limits, nodes=60, samples=4001)
        nut, actuator = (forces_of_task(one, plan).forces for one in (robot, machine))
        uses = {(one.quantity, one.leg): one.value for one in plan.uses}
        for leg, name in enumerate("ABC"):
            assert uses["nut force", name] == pytest.approx(np.abs(nut[:, leg]).max(), rel=2e-3)
            assert uses["force", name] == pytest.approx(np.abs(actuator[:, leg]).max(), rel=2e-3)
        shares = np.abs(nut).max() / limits.nut_force[0], np.abs(actuator).max() / limits.force[0]
        assert max(shares) == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize("jerk", [np.inf, 500.0])
def test_friction_that_leaves_no_room_is_told_where_and_of_which(robot, jerk):
    machine = p3dof.load(replace(robot.parameters, friction=p3dof.machine.Friction(coulomb={"slide_b": 300})))
    with pytest.raises(TaskError, match=r"\Awaypoint 1 → waypoint 2: force: B needs \d+.* to move, friction"):
        fastest_plan(machine, LINE, AxisLimits(250, 1, jerk=jerk), nodes=60)


def test_uses_say_when_and_on_which_way(robot):
    task = parse(
        """
waypoints:
  - {name: a, pose: [0, 0, 0], dwell: 0.1}
  - {name: b, pose: [0.1, 0, 0], dwell: 0.2}
  - {name: c, pose: [0, 0, 0], duration: 0.12}
"""
    )
    plan = fastest_plan(robot, task, AxisLimits(300, 1.5, jerk=400), samples=5001, nodes=60)
    found = forces_of_task(robot, plan)
    assert {one.quantity for one in plan.uses} == {"force", "speed", "jerk"}
    for one in plan.uses:
        if one.quantity == "force":
            leg = "ABC".index(one.leg)
            k = int(np.abs(found.forces[:, leg]).argmax())
            assert one.value == pytest.approx(abs(found.forces[k, leg]), rel=1e-3)
            assert one.way == "b → c"
            assert one.time == pytest.approx(found.time[k], abs=2e-3)
    assert max(one.share for one in plan.uses) > 1  # the given duration is too short, and that is told


def test_limits_of_the_task_count(robot):
    text = dump(LINE) + "limits: {jerk: 500, force: 500, speed: 2}\n"
    assert fastest_plan(robot, parse(text), nodes=60).duration == pytest.approx(0.2735, abs=3e-4)


def test_of_the_limits_of_task_and_machine_the_tighter_count(robot):
    slow = p3dof.load(replace(robot.parameters, limits=p3dof.machine.Limits(speed=0.3)))
    text = dump(LINE) + "limits: {force: 500, speed: [1, 0.2, 1]}\n"
    plan = fastest_plan(slow, parse(text), nodes=60)
    top = np.abs(forces_of_task(slow, plan).slider_velocities).max(axis=0)
    assert (top <= [0.3001, 0.2001, 0.3001]).all()
    assert plan.duration == fastest_plan(slow, LINE, AxisLimits(500, (0.3, 0.2, 0.3)), nodes=60).duration
    assert plan.duration > fastest_plan(robot, parse(text), nodes=60).duration


BAD = {
    "jerk: expected above zero, got 0": lambda _: AxisLimits(1, 1, jerk=0),
    "jerk: expected above zero, got -1": lambda _: AxisLimits(1, 1, jerk=[1, -1, 1]),
    "jerk: expected": lambda _: AxisLimits(1, 1, jerk="fast"),
    "power: expected": lambda _: AxisLimits(1, 1, "much"),
    "nut_force: expected": lambda _: AxisLimits(1, 1, nut_force=np.nan),
    "limits: unknown limit": lambda _: p3dof.Task(LINE.waypoints, limits={"snap": 1}),
    "limits: expected limits by name": lambda _: p3dof.Task(LINE.waypoints, limits=5),
    "waypoint 1 → waypoint 2: force: ": lambda r: fastest_plan(r, LINE, AxisLimits(30, 1, jerk=500)),
    "waypoint 1 → waypoint 2: nut_force: ": lambda r: fastest_plan(r, LINE, AxisLimits(300, 1, nut_force=30)),
}


@pytest.mark.parametrize(("words", "call"), BAD.items())
def test_limits_that_do_not_fit_are_one_clear_error(robot, words, call):
    with pytest.raises(TaskError, match=r"\A[^\n]*\Z") as found:
        call(robot)
    assert str(found.value).startswith(words)


def test_the_command_keeps_a_jerk(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    p3dof.write_task(LINE, "task.yaml")
    code, out, _ = run(
        capsys,
        "fastest",
        "task.yaml",
        "--max-force",
        500,
        "--max-speed",
        2,
        "--max-jerk",
        500,
        "--nodes",
        50,
        "--figure",
        "fast.png",
    )
    assert code == 0
    assert "jerk A [m/s³]" in out
    assert "slider" in out
    assert "0.273" in out
    code, _, err = run(capsys, "fastest", "task.yaml", "--max-jerk", 0)
    assert code == 2
    assert "--max-jerk" in err
