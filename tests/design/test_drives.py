"""Drives: torque of a motor stage by stage, ratings, catalogues, and the reference machine D1 of two ways."""

import csv
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from documents import ROOT
from drives_by_hand import D1, D2, slowed
from scipy.optimize import brentq
from task_files import PICK_AND_PLACE

import p3dof
from p3dof._base.errors import DriveError, InputError
from p3dof.design.drives import (
    GENERIC,
    VERDICTS,
    Amplifier,
    Belt,
    Catalogue,
    Cycle,
    Drive,
    Gear,
    Motor,
    Screw,
    Supply,
    cycle_of,
    not_checked,
    read_catalogue,
    size_of,
    verdict,
    with_supply,
)
from p3dof.design.tasks.files import parse

RPM = math.pi / 30


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def paper(robot):
    return cycle_of(robot.inverse_dynamics(p3dof.paper_motion(8001), method="compiled"))


@pytest.fixture(scope="module")
def quintic(robot):
    return cycle_of(robot.inverse_dynamics(slowed(20001), method="compiled"), rest=0.5)


def of(sizing, name):
    return [getattr(axis, name) for axis in sizing.axes]


# --- reference numbers --------------------------------------------------------------------------------------


def test_the_reflected_mass_is_that_of_each_shaft():
    assert D1.reflected_mass == pytest.approx(118.435253, abs=1e-6)
    assert D2.reflected_mass == pytest.approx(14.80441, abs=1e-5)
    geared = Drive(
        Motor(1, 3, 500, 1e-5, coupling_inertia=2e-6), Belt(0.04, inertia=3e-4), Gear(5, inertia=4e-6)
    )
    assert geared.reflected_mass == pytest.approx((1.6e-5 * 25 + 3e-4) * 50**2, rel=1e-14)


PAPER = {
    "peak_torque": (0.926176, 0.368528, 1.936171),
    "peak_time": (0.95428, 0.84323, 0.87790),
    "peak_inertia_share": (0.81151, 0.69991, 0.91810),
    "rms_torque": (0.426031, 0.189783, 0.995301),
    "peak_power": (493.25, 51.05, 792.67),
    "positive_work": (57.5425, 8.4895, 123.1205),
    "negative_work": (-4.7649, -2.6838, -61.3741),
    "screw_loss": (1.434818, 0.559610, 2.392850),
}


@pytest.mark.parametrize(("name", "expected"), PAPER.items())
def test_what_the_papers_motion_takes_of_a_drive(paper, name, expected):
    np.testing.assert_allclose(of(size_of(paper, D1), name), expected, rtol=2e-4)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("top_speed", (5298.98, 1908.38, 6615.93)),
        ("mean_speed", (1232.74, 622.92, 2151.85)),
        ("rms_speed", (1677.44, 775.89, 2605.01)),
    ],
)
def test_how_fast_the_motor_turns(paper, name, expected):
    np.testing.assert_allclose(np.array(of(size_of(paper, D1), name)) / RPM, expected, rtol=1e-5)


def test_what_a_common_bus_takes(paper):
    found = size_of(paper, D1)
    bus = found.bus_positive_work, found.bus_negative_work, found.bus_peak_power, found.bus_peak_braking
    np.testing.assert_allclose(bus, (177.7614, -57.4317, 1210.57, -307.36), rtol=2e-4)


def test_a_cycle_with_rest_held_by_motor_or_brake(quintic):
    found = size_of(quintic, D1)
    np.testing.assert_allclose(of(found, "peak_torque"), (1.264261, 0.555994, 4.293755), rtol=2e-6)
    np.testing.assert_allclose(of(found, "rms_torque"), (0.429222, 0.191896, 1.399509), rtol=1e-4)
    np.testing.assert_allclose(of(found, "braked_rms_torque"), (0.427064, 0.187018, 1.398643), rtol=1e-4)
    np.testing.assert_allclose(of(found, "heating"), (0.073041, 0.014620, 0.776781), rtol=5e-5)
    other = size_of(quintic, D2)
    np.testing.assert_allclose(of(other, "peak_torque"), (0.565853, 0.312591, 1.510810), rtol=1e-4)
    np.testing.assert_allclose(of(other, "rms_torque"), (0.203735, 0.174167, 0.470772), rtol=3e-4)


def test_a_wrong_sign_of_efficiency_would_be_noticed(paper):
    """The losses change the rms torque by more than the tolerance of its reference."""
    lossless = Drive(D1.motor, Screw(0.01, 1.0, 1.0, inertia=2e-4))
    np.testing.assert_allclose(
        of(size_of(paper, lossless), "rms_torque"), (0.420385, 0.188477, 0.993726), rtol=1e-4
    )


def test_a_screw_whirls_and_buckles_as_a_beam():
    screw = Screw(0.01, diameter=0.0127, length=0.5, ends="supported-supported")
    assert screw.buckling_force == pytest.approx(10586.8, abs=0.05)
    area, second = math.pi * 0.0127**2 / 4, math.pi * 0.0127**4 / 64
    beam = math.pi**2 / 0.5**2 * math.sqrt(2.1e11 * second / (7850 * area))
    assert screw.critical_speed == pytest.approx(beam, rel=1e-14)
    assert Screw(0.01, diameter=0.016, length=0.5).inertia == pytest.approx(2.5253e-5, rel=1e-4)


def ends_of_a_beam():
    """λ² of the first bending vibration and π² k of buckling, from the characteristic equations of beams."""

    def root(equation, low, high):
        return brentq(equation, low, high, xtol=1e-15)

    clamped = root(lambda x: math.cos(x) * math.cosh(x) - 1, 4.5, 5)
    free = root(lambda x: math.cos(x) * math.cosh(x) + 1, 1.5, 2.5)
    propped = root(lambda x: math.tan(x) - math.tanh(x), 3.6, 4.2)
    return {
        "supported-supported": (math.pi**2, math.pi**2),
        "fixed-supported": (propped**2, root(lambda x: math.tan(x) - x, 4.4, 4.6) ** 2),
        "fixed-fixed": (clamped**2, (2 * math.pi) ** 2),
        "fixed-free": (free**2, (math.pi / 2) ** 2),
    }


@pytest.mark.parametrize(("ends", "factors"), ends_of_a_beam().items())
def test_every_way_to_hold_a_screw_is_that_of_an_exact_beam(ends, factors):
    given = {} if ends == "fixed-supported" else {"ends": ends}  # that is what a file without a word gets
    screw = Screw(0.01, diameter=0.0137, length=0.61, **given)
    area, second = math.pi * 0.0137**2 / 4, math.pi * 0.0137**4 / 64
    whirl = factors[0] / 0.61**2 * math.sqrt(2.1e11 * second / (7850 * area))
    assert screw.critical_speed == pytest.approx(whirl, rel=1e-10)
    assert screw.buckling_force == pytest.approx(factors[1] * 2.1e11 * second / 0.61**2, rel=1e-10)


def ratings_of(drive, force=100.0, speed=0.1):
    still = np.tile([[force], [force]], 3), np.full((2, 3), speed), np.zeros((2, 3))
    return {rating.name: rating for rating in size_of(Cycle([0.0, 1.0], *still), drive).axes[0].ratings}


def test_screws_may_turn_and_bear_what_their_makers_print():
    """THK: .8 of the critical speed and half of the Euler load of the KR of 1300 mm, with E 2.06e11."""
    for ends, printed in (
        ("fixed-free", 3.4),
        ("supported-supported", 9.7),
        ("fixed-supported", 15.1),
        ("fixed-fixed", 21.9),
    ):
        screw = Screw(0.01, diameter=0.0127, length=0.7, ends=ends)
        rating = ratings_of(Drive(Motor(1, 3, 1e4, 1e-4), screw))["critical speed"]
        maker = printed * 1e7 * 12.7 / 700**2 * math.sqrt(2.1 / 2.06)
        assert rating.allowed == pytest.approx(maker, rel=0.05 / printed + 1e-3)  # printed to a tenth
    screw = Screw(0.01, diameter=0.0175, length=1.3, ends="fixed-fixed")
    allowed = ratings_of(Drive(Motor(1, 3, 1e4, 1e-4), screw))["buckling"].allowed
    assert allowed == pytest.approx(11000 * 2.1 / 2.06, rel=0.03)  # printed to a thousand


def test_behind_a_gear_each_rating_holds_at_its_own_shaft():
    """A gear of 2.5: the motor turns 2.5 times as fast as the screw, and gives less than its torque."""
    screw = Screw(0.02, 0.9, 0.85, diameter=0.014, length=0.5, max_speed=400 * RPM)
    drive = Drive(Motor(2, 6, 1000, 1e-4), screw, Gear(2.5, 0.95, max_speed=3000 * RPM, max_torque=0.7))
    found = ratings_of(drive, force=100.0, speed=0.1)
    turns = 0.1 / 0.02 * 60  # of the screw [rpm]
    assert found["nut speed"].required == pytest.approx(turns, rel=1e-14)
    assert found["nut speed"].allowed == pytest.approx(400, rel=1e-14)
    assert found["speed"].required == found["gear speed"].required == pytest.approx(2.5 * turns, rel=1e-14)
    assert found["gear speed"].allowed == pytest.approx(3000, rel=1e-14)
    assert found["speed"].allowed == pytest.approx(1000 / RPM, rel=1e-14)
    behind = 100 * 0.02 / (2 * math.pi) / 0.9  # at the screw
    assert found["gear torque"].required == pytest.approx(behind, rel=1e-14)
    assert found["peak torque"].required == pytest.approx(behind / 2.5 / 0.95, rel=1e-14)
    assert found["buckling"].required == 100


# --- laws ---------------------------------------------------------------------------------------------------


def test_power_is_conserved_but_for_losses(paper):
    """Motor's work = work at the nut + loss + kinetic energy of what turns, on each axis."""
    found = size_of(paper, D1)
    for leg, axis in enumerate(found.axes):
        nut = np.trapezoid(paper.force[:, leg] * paper.speed[:, leg], paper.time)
        kinetic = D1.reflected_mass * np.diff(paper.speed[[0, -1], leg] ** 2)[0] / 2
        given = axis.positive_work + axis.negative_work
        assert given == pytest.approx(nut + axis.screw_loss + kinetic, abs=2e-5 * abs(axis.positive_work))
        assert axis.screw_loss > 0


def test_stages_lose_power_in_its_direction():
    drive = Drive(
        Motor(1, 3, 500, 0.0, drag=0.01),
        Screw(0.01, 0.8, 0.7, inertia=0.0, drag=0.02),
        Gear(3, efficiency=0.9, efficiency_back=0.85),
    )
    force, ratio = 100.0, 2 * math.pi / 0.01
    driving = drive.torque(np.array(force), np.array(0.5), np.array(0.0))
    assert driving == pytest.approx((force / ratio / 0.8 + 0.02) / 3 / 0.9 + 0.01, rel=1e-14)
    braking = drive.torque(np.array(force), np.array(-0.5), np.array(0.0))
    assert braking == pytest.approx((force / ratio * 0.7 - 0.02) / 3 * 0.85 - 0.01, rel=1e-14)
    assert drive.torque(np.array(force), np.array(0.0), np.array(0.0)) == pytest.approx(
        force / ratio / 3, rel=1e-14
    )


def test_a_drive_is_called_by_its_parts_in_their_order():
    screw = Screw(0.01, inertia=0.0, name="16x10")
    assert Drive(Motor(1, 3, 500, 0.0, name="M1"), screw, Gear(3, name="i3")).name == "M1 + i3 + 16x10"
    assert Drive(Motor(1, 3, 500, 0.0, name="M1"), screw).name == "M1 + 16x10"
    assert Drive(Motor(1, 3, 500, 0.0, name="M1"), screw, name="axis").name == "axis"


def test_a_screw_holds_itself_when_half_is_lost():
    assert Screw(0.005, 0.5, inertia=0.0).efficiency_back == 0
    held = Drive(Motor(1, 3, 500, 0.0), Screw(0.005, 0.5, inertia=0.0))
    assert held.torque(np.array(100.0), np.array(-0.1), np.array(0.0)) == 0  # nothing comes to the motor
    assert held.screw_torque(np.array(100.0), np.array(-0.1), np.array(0.0)) == 0
    assert Screw(0.005, "90 %", inertia=0.0, efficiency_back="80%").efficiency == 0.9
    usual = Screw(0.005, inertia=0.0), Belt(0.04), Gear(3)
    assert [part.efficiency for part in usual] == [0.9, 0.95, 1.0]
    assert [part.drag for part in usual[:2]] == [0.0, 0.0]
    assert [part.efficiency_back for part in usual] == pytest.approx([8 / 9, 18 / 19, 1.0], rel=1e-14)
    assert Screw(0.005, 0.9, inertia=0.0).efficiency_back == pytest.approx(0.88889, abs=1e-5)


def test_heating_follows_its_differential_equation(quintic):
    """Many cycles from cold, by small steps."""
    motor = Motor(1.6, 30.0, 1e4, 1e-4, time_constant=0.8)
    drive = Drive(motor, D1.transmission)
    found = size_of(quintic, drive).axes[2].heating
    torque = drive.torque(quintic.force[:, 2], quintic.speed[:, 2], quintic.acceleration[:, 2])
    load = np.append((torque / 1.6) ** 2, [(quintic.holding[2] / drive.ratio / 1.6) ** 2] * 10_000)
    step, heat, most = 1.5 / len(load), 0.0, 0.0
    for cycle in range(12):
        for value in load[::4].tolist():
            heat += 4 * step / 0.8 * (value - heat)
            most = max(most, heat) if cycle == 11 else most
    assert found == pytest.approx(most, rel=3e-3)


def test_ratings_name_what_is_exceeded_and_when(paper):
    weak = Drive(Motor(0.3, 0.9, 6000 * RPM, 1e-4, rated_speed=3000 * RPM), D1.transmission)
    found = size_of(paper, weak)
    assert not found.fits
    torque = {rating.name: rating for rating in found.axes[2].ratings}["peak torque"]
    own = weak.torque(paper.force[:, 2], paper.speed[:, 2], paper.acceleration[:, 2])
    speed = weak.ratio * paper.speed[:, 2]
    within = np.abs(speed) <= 6000 * RPM  # elsewhere it turns faster than the motor can
    curve = np.interp(np.abs(speed), [0, 3000 * RPM, 6000 * RPM], [0.9, 0.9, 0.3])
    assert torque.share == pytest.approx((np.abs(own) / curve)[within].max())
    speeding = {rating.name: rating for rating in found.axes[2].ratings}["speed"]
    assert speeding.required == pytest.approx(np.abs(speed).max() / RPM)
    assert speeding.share > 1
    assert np.abs(speed[np.searchsorted(paper.time, speeding.time)]) == np.abs(speed).max()
    assert np.abs(own).max() > 0.9


def test_too_fast_a_motor_breaks_its_speed_and_no_torque():
    """A has 111 % of the speed and little torque, B too much torque and 105 %, C is always too fast."""
    motor = Motor(1.0, 2.0, 5000 * RPM, 0.0, time_constant=10.0)
    drive = Drive(motor, Screw(0.01, 1.0, 1.0, inertia=0.0, max_speed=math.inf))
    time = np.linspace(0, 1, 1001)
    swing = 1 - np.abs(2 * time - 1)
    speed = np.column_stack([5550 * swing, 5250 * swing, np.full(1001, 5500.0)]) * RPM / drive.ratio
    force = np.tile(drive.ratio * np.array([0.6, 2.6, 0.5]), (1001, 1))
    sizing = size_of(Cycle(time, force, speed, np.zeros((1001, 3))), drive)
    shares = [{rating.name: rating.share for rating in axis.ratings} for axis in sizing.axes]
    assert shares[0] == pytest.approx({"peak torque": 0.3, "rms torque": 0.6, "speed": 1.11, "heating": 0.36})
    assert shares[2] == pytest.approx({"rms torque": 0.5, "speed": 1.1, "heating": 0.25})
    order = [(leg, rating.name) for leg, rating in sizing.exceeded]
    beyond = [("B", "heating"), ("B", "rms torque"), ("B", "peak torque")]
    assert order == [*beyond, ("A", "speed"), ("C", "speed"), ("B", "speed")]
    assert [rating.share for _, rating in sizing.exceeded] == pytest.approx([6.76, 2.6, 1.3, 1.11, 1.1, 1.05])
    assert sizing.worst == sizing.exceeded[0]
    assert verdict(sizing).count(" has a utilisation of ") == 6
    assert "beyond" not in verdict(sizing)


FULL = Drive(
    Motor(
        1.6, 30.0, 1e4, 1e-4, brake_torque=3.0, time_constant=30.0, max_inertia_ratio=9.0, max_power=900.0,
        max_braking_power=300.0, torque_constant_rms=0.6,
        amplifier=Amplifier(rated_current_rms=3.0, max_current_rms=60.0),
    ),
    Screw(
        0.01, diameter=0.0127, length=0.5, max_speed=400.0, name="16x10", nominal_diameter=0.016,
        dynamic=9000.0, static=13000.0,
    ),
    Gear(2.0, max_speed=500.0, max_torque=40.0, name="planets"),
)  # fmt: skip
"""A drive with a number for every rating that there is."""


@pytest.mark.parametrize(
    ("part", "change", "words"),
    [
        ("motor", {"time_constant": None}, "no time_constant"),
        ("motor", {"max_inertia_ratio": math.inf}, "max_inertia_ratio allows any"),
        ("motor", {"max_power": math.inf}, "no max_power"),
        ("motor", {"max_braking_power": math.inf}, "no max_braking_power"),
        ("motor", {"brake_torque": 0.0}, "motor has no brake_torque"),
        ("transmission", {"max_speed": math.inf}, "speed of the nut of 16x10 (max_speed allows any)"),
        ("motor", {"amplifier": None}, "currents of motor (no amplifier)"),
        ("transmission", {"length": None, "inertia": 1e-5}, "no diameter and length"),
        ("transmission", {"dynamic": None, "drag": None}, "life of the nut of 16x10 (no dynamic rating)"),
        ("transmission", {"static": None}, "static load of the nut of 16x10 (no static rating)"),
        ("gear", {"max_speed": math.inf}, "speed of planets (no max_speed)"),
        ("gear", {"max_torque": math.inf}, "torque of planets (no max_torque)"),
    ],
)
def test_what_has_no_number_is_not_checked_and_said(paper, part, change, words):
    """Just what is missing: each rating that is given is among the ratings, and not among these."""
    every, bare = (
        with_supply(
            size_of(paper, drive, load_mass=np.ones((2, 3)), life="1e5 h"), paper, Supply(1e-3, 300.0, 400.0)
        )
        for drive in (FULL, replace(FULL, **{part: replace(getattr(FULL, part), **change)}))
    )
    more = set(not_checked(bare)) - set(not_checked(every))
    assert [words in one for one in more] == [True]
    without = set(not_checked(replace(every, supply=None))) - set(not_checked(every))
    assert without == {"bus voltage and braking resistor over all axes (no supply)"}
    limits = [{(one.name, one.allowed) for one in found.axes[0].ratings} for found in (every, bare)]
    assert limits[0] - limits[1]
    unasked = replace(size_of(paper, FULL, load_mass=np.ones((2, 3))), supply=every.supply)
    (told,) = set(not_checked(unasked)) - set(not_checked(every))
    assert told == "whether the life of the nut of 16x10 suffices (no life was required)"
    assert not any("(" in one for one in not_checked(every))
    assert "Not checked: " in p3dof._base.tables.html_of(bare)


def test_the_usual_torque_curve():
    motor = Motor(2.0, 6.0, 600.0, 1e-4, rated_speed=300.0)
    np.testing.assert_allclose(motor.continuous(np.array([0, 300, 450, -600, 601])), [2, 2, 1.5, 1, 0])
    np.testing.assert_allclose(motor.peak(np.array([0, -300, 450, 600])), [6, 6, 4, 2])


# --- the machine --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def found(robot):
    return p3dof.design.forces_of_task(robot, parse(PICK_AND_PLACE).plan(2.0, 2001))


def test_the_weakest_that_fits_is_first(robot, found):
    ranked = p3dof.size_drives(robot, found, GENERIC)
    fits = [sizing.fits for sizing in ranked]
    assert fits == sorted(fits, reverse=True)
    assert fits[0]
    assert not fits[-1]
    power = [sizing.drives[0].motor.rated_torque for sizing in ranked if sizing.fits]
    assert power == sorted(power)


def test_brakes_hold_what_is_carried_anywhere_on_the_way(robot, found):
    (sizing,) = p3dof.size_drives(robot, found, Drive(GENERIC.motors[3], D1.transmission), brake_safety=2.0)
    held = []
    for piece, result in zip(found.plan.pieces, found.results, strict=True):
        machine = robot if piece.payload is None else p3dof.load(robot.parameters.carrying(piece.payload))
        poses = result.motion.pose[::10]
        held.append(machine.forces(poses, np.zeros_like(poses), np.zeros_like(poses)))
    most = np.abs(np.concatenate(held)).max(axis=0)
    brakes = [next(r for r in axis.ratings if r.name == "brake") for axis in sizing.axes]
    np.testing.assert_allclose([b.required for b in brakes], 2.0 * most / D1.ratio, rtol=1e-3)


def test_the_mass_that_a_slider_moves_makes_the_inertia_ratio(robot):
    home = p3dof.Motion([0, 1], np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))
    (sizing,) = p3dof.size_drives(robot, robot.inverse_dynamics(home), D1)
    J, M = robot.jacobian(np.zeros(3)), robot.mass_matrix(np.zeros(3))
    moved = np.diag(np.linalg.inv(J).T @ M @ np.linalg.inv(J))
    for axis, mass in zip(sizing.axes, moved, strict=True):
        np.testing.assert_allclose(axis.inertia_ratio, mass / D1.ratio**2 / 1e-4, rtol=1e-12)


def test_a_motion_that_is_not_possible_is_refused(robot):
    far = p3dof.Motion([0, 1], [[0, 0, 0], [0.4, 0, 0]], np.zeros((2, 3)), np.zeros((2, 3)), check=False)
    bad = robot.inverse_dynamics(far, on_invalid="nan")
    with pytest.raises(DriveError, match="cannot perform this motion"):
        p3dof.size_drives(robot, bad, D1)


# --- input --------------------------------------------------------------------------------------------------


def test_generic_sizes_are_those_of_the_documentation():
    """Each motor gives its rated power at 3,000 rpm, but for the digits of its torque."""
    page = (ROOT / "docs/how-to/choose-drives.md").read_text(encoding="utf-8")
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if "|" in line
    ]
    rows = [row for row in rows if len(row) == 5]
    motors = {row[0]: row[1:] for row in rows if row[0].endswith("W")}
    screws = {row[0]: row[1:] for row in rows if row[0].isdigit()}
    for motor in GENERIC.motors:
        name = motor.name.removeprefix("generic ")
        rated, peak, fastest, rotor = map(float, motors.pop(name))
        power, unit = name.split()
        assert motor.rated_speed * rated == pytest.approx(float(power) * {"W": 1, "kW": 1e3}[unit], rel=6e-3)
        found = motor.rated_torque, motor.brake_torque, motor.peak_torque, motor.max_speed, motor.inertia
        np.testing.assert_allclose(found, (rated, rated, peak, fastest * RPM, rotor * 1e-4), rtol=1e-12)
        assert motor.rated_speed == pytest.approx(3000 * RPM)
    known = {
        f"generic {size}x{lead}": (size, root, lead, dynamic, static)
        for size, (root, *lists) in screws.items()
        for lead, dynamic, static in zip(*(cell.split(", ") for cell in lists), strict=True)
    }
    for screw in GENERIC.transmissions:
        found = screw.nominal_diameter, screw.diameter, screw.lead, screw.dynamic / 1e6, screw.static / 1e6
        told = [float(number) / 1e3 for number in known.pop(screw.name)]
        assert found == pytest.approx(told, rel=1e-12)
        assert screw.preload_force == pytest.approx(0.05 * screw.dynamic, rel=1e-15)
        assert (screw.length, screw.efficiency, screw.ends) == (0.5, 0.9, "fixed-supported")
    assert not known
    assert not motors


CATALOGUE = """
motors:
  - {name: M400, rated_torque: 1.3 Nm, peak_torque: 3.8 Nm, rated_speed: 3000 rpm, max_speed: 5000 rpm,
     inertia: 0.3 kg cm^2, brake_torque: 1.4 Nm, time_constant: 15 min}
  - {name: M1, rated_torque: 3, peak_torque: 9, max_speed: 500, inertia: 1e-4,
     curve: [[0, 3, 9], [2000 rpm, 3, 9], [5000 rpm, 2 Nm, 4 Nm]]}
screws:
  - {name: 16x10, lead: 10 mm, diameter: 12.7 mm, length: 500 mm, efficiency: 0.9}
belts:
  - {name: pulley, diameter: 40 mm, inertia: 1 kg cm^2}
gears:
  - {name: direct}
  - {name: i3, ratio: 3, efficiency: 0.96, inertia: 0.1 kg cm^2}
"""


def test_a_catalogue_with_units(tmp_path):
    (tmp_path / "drives.yaml").write_text(CATALOGUE, encoding="utf-8")
    found = read_catalogue(tmp_path / "drives.yaml")
    assert len(found) == len(list(found)) == 8
    motor = found.motors[0]
    assert motor.rated_speed == pytest.approx(100 * math.pi, rel=1e-14)
    assert (motor.inertia, motor.time_constant) == (pytest.approx(3e-5), 900.0)
    assert found.motors[1].peak(np.array([3500 * RPM])) == pytest.approx(6.5)
    assert found.transmissions[1].ratio == 50


MOTOR = "{name: a, rated_torque: 1, peak_torque: 1, "
FAST = f"{MOTOR}max_speed: 5, inertia: 0"
BAD = {
    "the field 'motors' is missing": "screws: []",
    "motors[0]: the field 'name' is missing": "motors: [{rated_torque: 1}]",
    "motors[0]: the field 'peak_torque' is missing": "motors: [{name: a, rated_torque: 1}]",
    "motors[0]: unknown field 'torque'": "motors: [{name: a, torque: 1}]",
    "motors[0]: max_speed: expected a rotational speed": f"motors: [{MOTOR}max_speed: 5 mm, inertia: 0}}]",
    "peak_torque: expected at least the rated torque, 2 N m, got 1 N m": "motors: [{name: a, "
    "rated_torque: 2, peak_torque: 1, max_speed: 5, inertia: 0}]",
    "rated_speed: expected up to 5 rad/s, got 6": f"motors: [{FAST}, rated_speed: 6}}]",
    "curve: expected points up to": f"motors: [{FAST}, curve: [[0, 1, 1], [4, 1, 1]]}}]",
    "curve: expected rising speeds from 0, two": f"motors: [{FAST}, curve: [[0, 1, 1], [4, 1, 1], [4, 1, 1], "
    "[5, 1, 1]]}]",
    "curve: expected continuous torques from zero": f"motors: [{FAST}, curve: [[0, 1, 1], [5, 2, 1]]}}]",
    "curve: expected continuous torques from": f"motors: [{FAST}, curve: [[0, 1, 1], [5, -1, 1]]}}]",
    "curve: expected rising speeds from 0": f"motors: [{FAST}, curve: [[1, 1, 1], [5, 1, 1]]}}]",
    "expected at least one of the transmissions": f"motors: [{FAST}}}]",
    "expected an inertia, or a diameter and a length": "motors: []\nscrews: [{name: s, lead: 1 mm}]",
    "efficiency: expected a share such as 0.9 or '90 %', got 'much'": "motors: []\nscrews: "
    "[{name: s, lead: 1, efficiency: much, inertia: 0}]",
    "efficiency: expected at most 1": "motors: []\nscrews: [{name: s, lead: 1, efficiency: 9, inertia: 0}]",
    "ends: expected one of": "motors: []\nscrews: [{name: s, lead: 1 mm, inertia: 0, ends: free}]",
    "lead: expected a number above zero": "motors: []\nscrews: [{name: s, lead: 0, inertia: 0}]",
    "motors: expected a list": "motors: 5",
    "the name 's' is given twice": f"motors: [{FAST}}}]\n"
    "screws: [{name: s, lead: 1, inertia: 0}, {name: s, lead: 2, inertia: 0}]",
    "not valid YAML": "motors: [",
}


@pytest.mark.parametrize(("words", "text"), BAD.items())
def test_a_bad_catalogue_is_one_clear_error(tmp_path, words, text):
    (tmp_path / "bad.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(DriveError, match=r"\A[^\n]*\Z") as found:
        read_catalogue(tmp_path / "bad.yaml")
    assert words in str(found.value)
    assert "bad.yaml" in str(found.value)


ZERO = np.zeros((2, 3))
BAD_CALLS = {
    "cycle: expected a Cycle": lambda: size_of(None, D1),
    "drives: expected one Drive": lambda: size_of(Cycle([0, 1], ZERO, ZERO, ZERO), [D1, D1]),
    "brake_safety: expected a number above": lambda: size_of(
        Cycle([0, 1], ZERO, ZERO, ZERO), D1, brake_safety=0
    ),
    "time: expected at least two": lambda: Cycle([1, 0], ZERO, ZERO, ZERO),
    "motor: expected Motor": lambda: Drive(D1.transmission, D1.transmission),
    "transmission: expected Screw or Belt": lambda: Drive(D1.motor, Gear()),
    "belt: efficiency_back: expected at most 1": lambda: Belt(0.04, efficiency_back=1.2),
    "no gear: efficiency_back: expected zero or more": lambda: Gear(2, efficiency_back=-0.1),
    "motors: got 5": lambda: Catalogue([5], [D1.transmission]),
}


@pytest.mark.parametrize(("words", "call"), BAD_CALLS.items())
def test_a_bad_argument_is_one_clear_error(words, call):
    with pytest.raises(DriveError, match=r"\A[^\n]*\Z") as found:
        call()
    assert words in str(found.value)


def test_forces_of_something_else_are_refused(robot):
    with pytest.raises(InputError, match="found: expected forces"):
        p3dof.size_drives(robot, p3dof.paper_motion(5), D1)
    with pytest.raises(InputError, match="robot: expected a Manipulator"):
        p3dof.size_drives(None, p3dof.paper_motion(5), D1)


# --- the command --------------------------------------------------------------------------------------------


def test_the_command_ranks_a_catalogue(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    (tmp_path / "drives.yaml").write_text(CATALOGUE, encoding="utf-8")
    code, out, _ = run(
        capsys, "size", "task.yaml", "--duration", 2, "--drives", "drives.yaml", "--out", "ranked.csv"
    )
    assert code == 0
    assert out.splitlines()[0].startswith("M400 + ")
    told = " ".join(out.split())
    assert "not checked: " in told
    assert "assumed: friction of guides: 3.5 N of its seals and 0.003 of its load for each carriage" in told
    _, out, _ = run(capsys, "size", "task.yaml", "--duration", 2, "--drives", "drives.yaml", "--frictionless")
    told = " ".join(out.split())
    assert "friction of guides and joints (none was given: forces are those without)" in told
    rows = list(csv.DictReader((tmp_path / "ranked.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == 8
    assert [row["verdict"] for row in rows] == sorted((row["verdict"] for row in rows), key=VERDICTS.index)
    assert rows[0]["verdict"] == "fits"
    assert 0 < float(rows[0]["peak torque A used"]) < 1


def test_the_command_says_that_nothing_fits(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    code, out, _ = run(capsys, "size", "task.yaml", "--duration", 0.7)
    assert code == 1
    assert "does not fit" in out.splitlines()[0]


@pytest.mark.usefixtures("undrawn")
def test_the_command_names_the_rating_that_is_broken(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    (tmp_path / "drives.yaml").write_text(
        "motors: [{name: M, rated_torque: 1.3, peak_torque: 3.8, max_speed: 5000 rpm, inertia: 3e-5}]\n"
        "screws: [{name: S, lead: 5 mm, inertia: 0, max_speed: 9000 rpm}]\n",
        encoding="utf-8",
    )
    code, out, _ = run(capsys, "size", "task.yaml", "--duration", 2, "--drives", "drives.yaml")
    assert code == 1
    first = out.splitlines()[0]
    assert first.startswith(
        "M + S comes nearest, but does not fit: speed of A has a utilisation of 140%, at t = "
    )
    assert "torque" not in first
    code, out, _ = run(capsys, "report", "task.yaml", "--duration", 2, "--drives", "drives.yaml")
    assert "speed of A has a utilisation of 140%" in out
    assert "torque of" not in out


def test_forces_of_limits_have_the_inertia_of_the_drives_whatever_armature_was_given(
    capsys, tmp_path, monkeypatch
):
    """As those of `plan` of a machine whose armature is what the best drive reflects."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    (tmp_path / "drives.yaml").write_text(CATALOGUE, encoding="utf-8")
    line = ("task.yaml", "--duration", 2, "--samples", 201)
    row = re.compile(r"force ([ABC]) \[N\] +(\S+)")
    found = []
    for armature in ((), ("--armature", 50)):
        _, out, _ = run(capsys, "size", *line, "--drives", "drives.yaml", "--frictionless", *armature)
        told = " ".join(out.split())
        assert "forces of limits have the drives' own inertia" in told
        assert (", which replaces the armature" in told) == bool(armature)
        found.append(row.findall(out))
    assert len(found[0]) == 3
    assert found[0] == found[1]
    mass = re.search(r"reflected mass \[kg\] +(\S+)", out)[1]
    _, out, _ = run(capsys, "plan", *line, "--armature", mass)
    assert [(leg, float(x)) for leg, x in row.findall(out)] == [
        (leg, pytest.approx(float(x), rel=1e-4)) for leg, x in found[0]
    ]
    _, out, _ = run(capsys, "plan", *line)
    assert row.findall(out) != found[0]


def test_a_bad_catalogue_is_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    (tmp_path / "drives.yaml").write_text("motors: []", encoding="utf-8")
    code, _, err = run(capsys, "size", "task.yaml", "--duration", 2, "--drives", "drives.yaml")
    assert code == 2
    assert "drives.yaml: catalogue: expected at least one of the motors" in err
    assert err.count("\n") == 1


def test_the_figure_shows_the_cycle_within_the_curves(tmp_path, capsys):
    from p3dof.report import plots

    robot = p3dof.load()
    result = robot.inverse_dynamics(p3dof.paper_motion(101))
    (sizing,) = p3dof.size_drives(robot, result, [D1], frictionless=True)
    cycle = cycle_of(result, 0.0)
    figure = plots.drives_figure(sizing, cycle)
    for leg, axis in enumerate(figure.axes):
        curve, point, margins, *_ = axis.lines
        ends = np.abs(margins.get_data()).max(axis=1)
        assert ends == pytest.approx([0.8e4 / RPM, 0.8 * D1.motor.peak_torque], rel=5e-3)  # drawn by points
        speed, torque = curve.get_data()
        assert np.abs(torque).max() == pytest.approx(abs(sizing.axes[leg].peak_torque), rel=1e-12)
        assert np.abs(speed).max() == pytest.approx(sizing.axes[leg].top_speed * 30 / np.pi, rel=1e-12)
        assert point.get_ydata()[0] == sizing.axes[leg].rms_torque
    with pytest.raises(InputError, match="sizing: expected a Sizing, got 3"):
        plots.drives_figure(3, cycle)
    path = tmp_path / "task.yaml"
    path.write_text("waypoints: [{pose: [0, 0, 0]}, {pose: [50 mm, 0, 0]}]\n", encoding="utf-8")
    out = tmp_path / "drives.png"
    assert run(capsys, "size", path, "--duration", 1, "--figure", out)[0] == 0
    assert out.read_bytes().startswith(b"\x89PNG")
