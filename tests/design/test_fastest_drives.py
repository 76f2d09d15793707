"""The fastest way with a torque-speed curve: a point mass in closed form, limits of drives, their sizing."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from scipy.integrate import quad
from scipy.optimize import brentq
from task_files import BLENDED, PICK_AND_PLACE

import p3dof
from p3dof._base.errors import DriveError, InputError, TaskError
from p3dof.design import AxisLimits, drive_limits, fastest_plan, forces_of_task
from p3dof.design.drives import (
    GENERIC,
    Belt,
    Catalogue,
    Drive,
    Gear,
    Margins,
    Motor,
    Screw,
    Winding,
    write_catalogue,
)
from p3dof.design.fastest import tighter
from p3dof.design.sizing import size_drives
from p3dof.design.tasks.fastest import fastest_law
from p3dof.design.tasks.files import dump, parse
from p3dof.design.tasks.limits import Demand
from p3dof.design.tasks.smooth import jerk_limited_law

WAYS = {
    "constant, then falling": ([[0, 10], [1, 10], [3, 2]], 1.0, 10.0),
    "a line": ([[0, 10], [3, 0.5]], 2.0, 10.0),
    "steeper and steeper": ([[0, 10], [1, 9], [2, 6], [2.5, 1]], 3.0, 10.0),
    "like a hyperbola": ([[0, 10], [0.5, 5], [1, 2.5], [2, 1]], 1.5, 10.0),
    "a step, and a limit of speed": ([[0, 10], [1, 10], [1.2, 4], [3, 3]], 2.0, 2.5),
    "down to nothing": ([[0, 10], [1, 10], [2, 0]], 4.0, 10.0),
}


class PointMass:
    """1 kg on each slider along a straight way."""

    lossy = False

    def demand(self, place, _middle):
        one, none = np.ones((len(place), 3)), np.zeros((len(place), 3))
        return Demand(one, none, none, one, none, none, np.zeros(3), none)

    def friction(self, place, _speed):
        return np.zeros((len(place), 3))


def least_time(rows, length, speed):
    """Return the time of 1 kg that pushes with all it has, and brakes with it from the middle on."""
    rows = np.array(rows, dtype=float)

    def force(v):
        return np.interp(v, *rows.T)

    def until(v, work):
        kinks = [p for p in rows[:, 0] if 0 < p < v]
        return quad(lambda u: work(u) / force(u), 0, v, points=kinks or None, limit=400)[0]

    speed = speed if force(speed) > 0 else rows[-1, 0] * (1 - 1e-9)
    way, time = (lambda v: until(v, lambda u: u)), (lambda v: until(v, lambda _: 1.0))
    if 2 * way(speed) < length:
        return 2 * time(speed) + (length - 2 * way(speed)) / speed
    top = brentq(lambda v: 2 * way(v) - length, 1e-9, speed, xtol=1e-15)
    return 2 * time(top)


@pytest.mark.parametrize("kind", WAYS)
def test_a_point_mass_takes_its_least_time(kind):
    """Equation of motion: t = ∫ dv / F(v), s = ∫ v dv / F(v), by quadrature."""
    rows, length, speed = WAYS[kind]
    even = np.linspace(0, 1, 401)
    limits = AxisLimits(1e3, speed, curve=rows)
    found = fastest_law(length * even**2 * (3 - 2 * even), PointMass(), limits).duration
    exact = least_time(rows, length, speed)
    assert 0 <= found - exact < 2e-4 * exact
    without = fastest_law(length * even, PointMass(), AxisLimits(10, speed)).duration
    assert without < 0.99 * exact  # the curve matters


def test_a_jerk_is_limited_besides():
    rows, length, speed = WAYS["steeper and steeper"]
    limits = AxisLimits(1e3, speed, curve=rows, jerk=1e4)
    found = jerk_limited_law(150, length, [0.0, length], PointMass(), limits).duration
    exact = least_time(rows, length, speed)
    assert 0 < found - exact < 2e-3 * exact


# --- limits of drives ---------------------------------------------------------------------------------------

MOTOR = Motor(1.27, 3.8, 314.0, 2.6e-5, 250.0, brake_torque=2.0, max_power=350.0, drag=0.02, name="M")
SCREW = Screw(0.01, 0.9, diameter=0.0127, length=0.5, nominal_diameter=0.016, static=2e4, drag=0.03)
DRIVE = Drive(MOTOR, SCREW)


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def heavy():
    return parse(PICK_AND_PLACE.replace("mass: 2 kg", "mass: 6 kg"))


def test_each_rating_is_a_limit_less_its_margin(robot):
    found = drive_limits(robot, DRIVE)
    at_rest = (0.8 * 3.8 - 0.02 - 0.03) * 2 * np.pi / 0.01
    assert found.force == pytest.approx([at_rest] * 3, rel=1e-14)
    rpm = [0.8 * 314 * 30 / np.pi, 5000, 70_000 / 16]
    assert found.speed == pytest.approx([min(rpm) / 60 * 0.01] * 3, rel=1e-14)
    assert found.power == pytest.approx([0.8 * 350] * 3, rel=1e-14)
    assert found.efficiency == pytest.approx([0.9] * 3, rel=1e-14)
    assert found.efficiency_back == pytest.approx([2 - 1 / 0.9] * 3, rel=1e-14)
    assert found.nut_force == pytest.approx([min(2e4 / 2, SCREW.buckling_force / 2)] * 3, rel=1e-14)
    assert found.reflected_mass == pytest.approx([DRIVE.reflected_mass] * 3, rel=1e-14)
    half = np.array([[0.5 * (250 + 314) * 0.01 / (2 * np.pi)] * 3])
    torque = 0.8 * (3.8 + 1.27) / 2 - 0.02 - 0.03
    assert found.force_at(half) == pytest.approx(torque * 200 * np.pi, rel=1e-12)


def test_gears_belts_and_margins_count(robot):
    belt = Belt(0.04, 0.95, max_force=800.0, pretension=300.0, max_tension=900.0)
    drive = Drive(MOTOR, belt, Gear(5.0, 0.96, max_torque=12.0, max_speed=280.0))
    found = drive_limits(robot, drive, Margins.none())
    assert found.force == pytest.approx([(12.0 / (5 * 0.96) - 0.02) * 250] * 3, rel=1e-14)  # of the gear
    assert found.speed == pytest.approx([280 / 5 * 0.02] * 3, rel=1e-14)
    assert found.nut_force == pytest.approx([300.0] * 3, rel=1e-14)  # then a span is slack
    tight = drive_limits(robot, replace(drive, transmission=replace(belt, pretension=700.0)), Margins.none())
    assert tight.nut_force == pytest.approx([200.0] * 3, rel=1e-14)  # 900 N less pretension


def test_three_drives_have_their_own_limits(robot):
    weak = Drive(replace(MOTOR, peak_torque=2.0, max_speed=280.0, name="W"), SCREW)
    found = drive_limits(robot, [DRIVE, weak, DRIVE])
    alone = [drive_limits(robot, drive) for drive in (DRIVE, weak)]
    speeds = np.linspace(0, 0.4, 41)[:, None] * np.ones(3)
    for leg, own in ((0, alone[0]), (1, alone[1]), (2, alone[0])):
        assert found.force[leg] == own.force[0]
        assert found.speed[leg] == own.speed[0]
        rows = speeds[:, leg] <= own.speed[0]
        assert found.force_at(speeds)[rows, leg] == pytest.approx(own.force_at(speeds)[rows, leg], rel=1e-12)


def test_the_machines_armature_stands_for_that_of_the_drive(robot):
    actuators = replace(robot.parameters.actuators, armature={"sliders": 4.0})
    machine = p3dof.load(replace(robot.parameters, actuators=actuators))
    own = DRIVE.reflected_mass
    assert drive_limits(machine, DRIVE).reflected_mass == pytest.approx([own - 4.0] * 3, rel=1e-12)


@pytest.mark.parametrize(
    "name",
    [
        "generic 50 W + generic 12x10",
        "generic 100 W + generic 20x20",
        "generic 200 W + generic 16x10",
        "generic 400 W + generic 20x20",
    ],
)
def test_the_drive_fits_the_plan_made_by_it(robot, heavy, name):
    """Sizing samples the forces of the finished plan, and takes losses stage by stage."""
    drive = next(drive for drive in GENERIC if drive.name == name)
    plan = fastest_plan(robot, heavy, drive_limits(robot, drive), nodes=120)
    assert max(use.share for use in plan.uses) <= 1 + 1e-9
    assert max(use.share for use in plan.uses) > 0.999
    sizing = size_drives(robot, forces_of_task(robot, plan), drive, frictionless=True)[0]
    kept = {"peak torque", "speed", "nut speed", "DN", "critical speed", "power", "buckling"}
    for axis in sizing.axes:
        for rating in axis.ratings:
            assert rating.name not in kept or rating.share <= (1 - rating.margin) * (1 + 1e-4), rating


def test_the_power_of_the_motor_counts_losses_and_drag(robot, heavy):
    """The plan that 40 W at the shaft make needs 40 W, where drag takes 7 of them at .1 m/s."""
    drive = Drive(replace(MOTOR, max_power=50.0, drag=0.03), replace(SCREW, drag=0.08))
    limits = drive_limits(robot, drive)
    assert limits.drag == pytest.approx([0.11 * 200 * np.pi] * 3, rel=1e-14)
    assert tighter(limits, AxisLimits(500, 2)).drag.tolist() == limits.drag.tolist()
    with_gear = drive_limits(robot, Drive(drive.motor, drive.transmission, Gear(2.0, 0.9)))
    assert with_gear.drag == pytest.approx([(0.03 + 0.08 / (2 * 0.9)) * 400 * np.pi] * 3, rel=1e-14)
    plan = fastest_plan(robot, heavy, limits, nodes=120)
    sizing = size_drives(robot, forces_of_task(robot, plan), drive, frictionless=True)[0]
    most = [next(r.required for r in axis.ratings if r.name == "power") for axis in sizing.axes]
    assert max(most) == pytest.approx(40.0, rel=1e-4)
    with pytest.raises(TaskError, match="drag: expected zero or more, got -1"):
        AxisLimits(500, 2, drag=-1)


def test_little_power_stops_no_program_on_the_way(robot, heavy):
    """What a program takes for straight may allow no speed at all: the law of that divided by zero."""
    drive = Drive(replace(MOTOR, max_power=50.0, drag=0.03), replace(SCREW, drag=0.08), Gear(2.0, 0.9))
    found = fastest_plan(robot, heavy, drive_limits(robot, drive), nodes=120)
    assert max(use.share for use in found.uses) == pytest.approx(1, abs=1e-9)
    more = drive_limits(robot, replace(drive, motor=replace(drive.motor, max_power=51.0)))
    assert 0 < found.duration - fastest_plan(robot, heavy, more, nodes=120).duration < 0.02


def test_a_winding_limits_at_high_speed(robot):
    winding = Winding(320, 4, 0.5, 4e-3, measured="phase", flux=0.07, max_current_peak=12)
    motor = Motor(1.27, 5.0, 6000 * np.pi / 30, 2.6e-5, winding=winding, name="wound")
    drive = Drive(motor, replace(SCREW, max_speed=np.inf))
    limits = drive_limits(robot, drive, Margins.none())
    speeds = np.linspace(0, limits.speed[0], 500)[:, None] * np.ones(3)
    torque = (motor.peak(speeds[:, 0] * drive.ratio) - 0.03) * drive.ratio
    assert limits.speed[0] == pytest.approx(1.0)
    assert limits.force_at(speeds)[:, 0] == pytest.approx(torque, rel=0, abs=5e-3 * torque[0])
    assert limits.force_at(speeds)[-1, 0] == pytest.approx((2.01728 - 0.03) * drive.ratio, rel=1e-5)


def test_tighter_limits_keep_both():
    one = AxisLimits(500, 1, 200, 1.0, curve=[[0, 400], [1, 100]])
    other = AxisLimits([600, 300, 600], 2, jerk=50, nut_force=90, curve=[[0, 500], [0.5, 150], [2, 150]])
    both = tighter(one, other)
    assert both.force.tolist() == [500, 300, 500]
    assert both.speed.tolist() == [1] * 3
    assert both.power.tolist() == [200] * 3
    assert both.jerk.tolist() == [50] * 3
    assert both.nut_force.tolist() == [90] * 3
    assert both.reflected_mass.tolist() == [1] * 3
    speeds = np.linspace(0, 3, 301)[:, None] * np.ones(3)
    least = np.minimum(one.force_at(speeds), other.force_at(speeds))
    assert (both.force_at(speeds) <= least + 1e-9).all()
    at_points = np.isin(speeds[:, 0], [0, 0.5, 1, 2])
    assert both.force_at(speeds)[at_points] == pytest.approx(least[at_points], rel=1e-14)
    assert tighter(AxisLimits(1, 1), AxisLimits(2, 2)).curve is None


def test_a_task_file_has_a_curve():
    text = PICK_AND_PLACE + "limits: {force: 300 N, curve: [[0, 0.3 kN], [500 mm/s, 300], [1 m/s, 50 N]]}\n"
    task = parse(text)
    assert task.limits["curve"] == [[0, 300], [0.5, 300], [1, 50]]
    assert parse(dump(task)).limits == task.limits
    rows = "[[[0, 1], [1, 1]], [[0, 2], [1, 2]], [[0, 3], [1, 3]]]"
    each = parse(PICK_AND_PLACE + f"limits: {{curve: {rows}}}\n")
    assert np.array(each.limits["curve"])[:, 0, 1].tolist() == [1, 2, 3]
    assert parse(dump(each)).limits == each.limits


# --- bad input ----------------------------------------------------------------------------------------------

BAD_CURVES = {
    "rising speed": [[1, 5], [2, 4]],
    "two at least": [[0, 5]],
    "rows of speed": [[0, 5], [0, 4]],
    "above zero at standstill": [[0, 0], [1, 0]],
    "do not rise": [[0, 5], [1, 6]],
    "curve: expected shape": [[0, 5, 3], [1, 4, 2]],
    "expected numbers": "fast",
}


@pytest.mark.parametrize("words", BAD_CURVES)
def test_a_curve_that_is_none_is_one_clear_error(words):
    with pytest.raises(TaskError, match=r"\Acurve: [^\n]*\Z") as found:
        AxisLimits(1, 1, curve=BAD_CURVES[words])
    assert words.removeprefix("curve: ").split()[0] in str(found.value)


@pytest.mark.parametrize(
    "curve", ["5", "[5, 3]", "[[0, 5], [1]]", "[[0, 5 kg], [1, 3]]", "[[], []]", "[[[0, 5], [1, 4]]]"]
)
def test_a_curve_of_a_file_that_is_none_is_named(curve):
    with pytest.raises(TaskError, match=r"\Atask: limits: curve[^\n]*\Z"):
        parse(PICK_AND_PLACE + f"limits: {{curve: {curve}}}\n")


def test_drives_that_are_none_are_refused(robot):
    for call in (
        lambda: drive_limits(None, DRIVE),
        lambda: drive_limits(robot, [DRIVE]),
        lambda: drive_limits(robot, DRIVE, 0.2),
    ):
        with pytest.raises(InputError, match="expected"):
            call()
    stuck = Drive(replace(MOTOR, drag=3.5), SCREW)
    with pytest.raises(DriveError, match="moves nothing"):
        drive_limits(robot, stuck)


def test_what_the_motor_cannot_hold_is_told(robot, heavy):
    weak = Drive(Motor(0.02, 0.05, 314.0, 1e-6, name="tiny"), replace(SCREW, drag=0.0))
    with pytest.raises(TaskError, match="to stand still"):
        fastest_plan(robot, heavy, drive_limits(robot, weak))


# --- the command --------------------------------------------------------------------------------------------


@pytest.fixture
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    p3dof.write_task(BLENDED, "task.yaml")
    write_catalogue(Catalogue([MOTOR], [SCREW]), "one.yaml")


@pytest.mark.usefixtures("_folder")
def test_the_command_takes_a_drive(capsys, robot):
    code, out, err = run(
        capsys, "fastest", "task.yaml", "--drives", "one.yaml", "--nodes", 100, "--out", "f.csv"
    )
    assert "M + screw" in out, err
    assert "Utilisation of ratings" in out
    limits = tighter(AxisLimits(500, 2), drive_limits(robot, DRIVE))
    exact = fastest_plan(robot, BLENDED, limits, nodes=100).duration
    assert p3dof.Motion.from_csv("f.csv", check=False).duration == pytest.approx(exact, rel=1e-9)
    assert code in (0, 1)


@pytest.mark.usefixtures("_folder")
def test_a_generic_drive_goes_by_its_name(capsys):
    name = "generic 400 W + generic 16x10"
    _, out, err = run(capsys, "fastest", "task.yaml", "--nodes", 60, "--drive", name)
    assert out.startswith(name), err


@pytest.mark.usefixtures("_folder")
def test_a_drive_that_is_none_is_one_line(capsys):
    for options, words in (
        (("--drive", "M800"), "--drive: expected one of generic 50 W"),
        (("--drives", "one.yaml", "--drive", "M + scrw"), "did you mean"),
        (("--drive", "generic 400 W + generic 16x10", "--reflected-mass", 3), "the drive has its own"),
    ):
        code, _, err = run(capsys, "fastest", "task.yaml", *options)
        assert code == 2
        assert words in err
    write_catalogue(Catalogue([MOTOR, replace(MOTOR, name="N")], [SCREW]), "two.yaml")
    code, _, err = run(capsys, "fastest", "task.yaml", "--drives", "two.yaml")
    assert code == 2
    assert "expected --drive with it, one of M + screw, N + screw" in err
