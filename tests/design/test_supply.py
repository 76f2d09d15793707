"""Amplifiers, direct-current buses marched in time, and different drives for the axes."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from documents import ROOT
from drives_by_hand import D1, slowed
from scipy.integrate import quad
from table_numbers import check_table, shows

import p3dof
from p3dof._base.errors import DriveError
from p3dof.design.drives import (
    Amplifier,
    Catalogue,
    Cycle,
    Drive,
    Motor,
    Screw,
    Supply,
    Winding,
    cycle_of,
    not_checked,
    read_catalogue,
    size_of,
    supply_table,
    with_supply,
    write_ranking,
)
from p3dof.design.drives.supply import march
from p3dof.design.tasks.files import parse

BUS = Supply(560e-6, 320.0, 380.0, resistor_power=1.0, resistance=1.0)
COPPER = replace(D1, motor=replace(D1.motor, torque_constant_rms=0.594, phase_resistance=0.5))


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def paper(robot):
    """The paper's path from rest to rest; kinks of the power cost at most 4e-4 J at so many samples."""
    return cycle_of(robot.inverse_dynamics(slowed(8001), method="compiled"), rest=0.5)


def loads(cycle, drive, **changes):
    return with_supply(size_of(cycle, drive), cycle, replace(BUS, **changes)).supply


def test_what_the_papers_path_takes_of_a_common_bus(paper):
    """Numbers that were computed elsewhere."""
    assert BUS.energy == pytest.approx(11.76, rel=1e-14)
    (bus,) = loads(paper, D1).buses
    assert bus.braking_work == pytest.approx(162.6697, abs=5e-4)
    assert bus.burnt == pytest.approx(113.0449, abs=4e-4)
    assert bus.mean_power == pytest.approx(75.36325, abs=3e-4)
    assert bus.mean_power / 0.2 == pytest.approx(376.816, abs=2e-3)
    assert bus.peak_power == pytest.approx(1387.619, abs=5e-3)
    assert bus.line_work == pytest.approx(116.8023, abs=4e-4)
    assert loads(paper, COPPER).buses[0].burnt == pytest.approx(106.2542, abs=4e-4)
    burnt = [bus.burnt for bus in loads(paper, D1, common=False).buses]
    np.testing.assert_allclose(burnt, (6.785184, 0, 105.8716), rtol=0, atol=4e-4)
    assert burnt[0] == pytest.approx(6.785184, abs=2e-5)


def test_a_task_whose_braking_the_next_acceleration_takes_burns_nothing(robot):
    """A cycle's braking work less what the capacitors take would burn 10.4 J."""
    page = (ROOT / "docs/how-to/choose-drives.md").read_text(encoding="utf-8")
    text = page.split("```yaml\n")[1].split("```")[0]
    plan = parse(text.replace("mass: 2 kg", "mass: 3 kg"), "task").plan(2.0, 4001)
    motor = Motor(1.3, 3.8, 5000 * math.pi / 30, 3e-5)
    drive = Drive(motor, Screw(0.01, 0.9, diameter=0.0127, length=0.5))
    cycle = cycle_of(p3dof.design.forces_of_task(robot, plan))
    (bus,) = loads(cycle, drive).buses
    assert bus.burnt == 0
    assert bus.braking_work == pytest.approx(22.19270, abs=1e-4)
    assert bus.line_work == pytest.approx(5.105985, abs=1e-6)


def dense(time, power, most, steps, start):
    """March in small steps: the least the plain equation says, to the first order."""
    grid = np.linspace(time[0], time[-1], steps + 1)
    middle = np.interp((grid[1:] + grid[:-1]) / 2, time, power) * np.diff(grid)
    stored, burnt, line = start, 0.0, 0.0
    for work in middle.tolist():
        stored -= work
        burnt += max(stored - most, 0.0)
        line += max(-stored, 0.0)
        stored = min(max(stored, 0.0), most)
    return stored, burnt, line


@pytest.mark.parametrize("seed", range(6))
def test_a_bus_follows_its_equation(seed):
    """Against small steps, over as many cycles as it takes to be steady; and all energy is somewhere."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.05, 0.2, 14))
    power = rng.normal(rng.choice([-20.0, 0.0, 20.0]), 100, 14)
    found = march(BUS, "bus", time, power, 5.0, 0.3)
    time, power = np.append(time, [time[-1], time[-1] + 0.3]), np.append(power, [5.0, 5.0])
    time[-2] += 1e-9
    stored = 0.0
    for _ in range(6):
        before = stored
        stored, burnt, line = dense(time, power, BUS.energy, 20_000, stored)
    assert stored == pytest.approx(before, abs=1e-2)
    assert found.burnt == pytest.approx(burnt, abs=1e-2)
    assert found.line_work == pytest.approx(line, abs=1e-2)
    net = quad(lambda t: np.interp(t, time, power), time[0], time[-1], points=time[1:-1], limit=200)[0]
    assert found.line_work - found.burnt == pytest.approx(net, abs=1e-6)
    assert found.voltage.min() >= BUS.voltage * (1 - 1e-15)
    assert found.top_voltage <= BUS.max_voltage * (1 + 1e-15)
    assert found.voltage[0] == pytest.approx(found.voltage[-1], rel=1e-12)


def test_the_instant_at_which_a_bus_is_full():
    """Braking that falls from 100 W to 0 in a second, 50 J, of which 11.76 are stored; then driving."""
    found = march(BUS, "bus", np.array([0.0, 1.0, 1.0, 2.0]), np.array([-100.0, 0, 100.0, 100.0]), 0.0, 0.0)
    assert found.burnt == pytest.approx(50 - 11.76, rel=1e-13)
    full = 1 - math.sqrt(1 - 2 * 11.76 / 100)  # 100 t - 50 t² = 11.76
    assert (found.peak_time, found.peak_power) == pytest.approx((full, 100 * (1 - full)), rel=1e-13)
    assert found.line_work == pytest.approx(100 - 11.76, rel=1e-13)
    assert found.line_time == pytest.approx(1 + 0.1176, rel=1e-13)
    assert (found.line_power, found.braking_work) == (100.0, 50.0)
    np.testing.assert_allclose(found.voltage, [320, 380, 380, 320], rtol=1e-13)


def test_a_bus_that_nothing_empties_rises_without_end():
    """Without resistor the energy stays in the capacitors; what is given back for ever has no place."""
    open_bus = replace(BUS, resistance=None, resistor_power=None)
    back = march(open_bus, "bus", np.array([0.0, 1.0]), np.array([-1.0, -1.0]), 0.0, 0.0)
    assert back.top_voltage == math.inf
    there = march(open_bus, "bus", np.array([0, 1, 1, 2.0]), np.array([-30.0, -30, 40, 40]), 0.0, 0.0)
    assert there.top_voltage == pytest.approx(math.sqrt(320**2 + 2 * 30 / 560e-6), rel=1e-14)
    assert (there.burnt, there.line_work) == (0.0, 10.0)


def ratings(sizing):
    return {(owner, one.name): one for owner, one in sizing.others}


def cycle_by_hand():
    """Back and forth: A drives 100 W and brakes with 60 W, B brakes with 40 W; C rests; no inertia."""
    force = np.array([[100.0, 0, 0], [100, 0, 0], [-60, -40, 0], [-60, -40, 0]])
    speed = np.array([[1.0, 1, 0]] * 4)
    return Cycle([0, 1, 1, 2], force, speed, 0 * speed)


PLAIN = Drive(
    Motor(5, 9, 1e3, 0.0, torque_constant_rms=0.5, name="M"), Screw(2 * math.pi / 100, 1.0, inertia=0.0)
)
"""Without inertia and losses: 100 rad/m."""


@shows("p3dof.design.drives.supply.supply_table")
def test_the_ratings_and_the_table_of_buses():
    cycle, supply = cycle_by_hand(), Supply(560e-6, 320, 380, 80.0, 500.0, max_power=200.0, duty=0.4)
    common = with_supply(size_of(cycle, PLAIN), cycle, supply)
    burnt = 100 - 11.76
    found = ratings(common)
    assert set(found) == {("bus", name) for name in ("braking resistor power", "peak braking", "line power")}
    one = found["bus", "braking resistor power"]
    assert (one.required, one.allowed) == pytest.approx((burnt / 2 / 0.4, 500.0), rel=1e-13)
    one = found["bus", "peak braking"]
    assert (one.required, one.allowed, one.time) == pytest.approx((100, 380**2 / 80, 1 + 0.1176), rel=1e-13)
    one = found["bus", "line power"]
    assert (one.required, one.allowed, one.time) == pytest.approx((100, 200, 0.1176), rel=1e-13)
    rows = {
        "regenerated [J]": (100,), "burnt in the resistor [J]": (burnt,), "mean of that [W]": (burnt / 2,),
        "largest of that [W]": (100,), "from the line [J]": (burnt,), "from the line, peak [W]": (100,),
        "largest voltage [V]": (380,), "rated power of the resistor, at least [W]": (burnt / 2 / 0.4,),
        "resistance, at most [Ω]": (1444,),
    }  # fmt: skip
    check_table(supply_table(common.supply), rows, note=[11.76, 380, 0.4])
    apart = with_supply(size_of(cycle, PLAIN), cycle, replace(supply, common=False, duty=None)).supply
    a, b, nan = 60 - 11.76, 40.0, math.nan
    rows = {
        "regenerated [J]": (60, 40, 0), "burnt in the resistor [J]": (a, b, 0),
        "mean of that [W]": (a / 2, b / 2, 0), "largest of that [W]": (60, 40, 0),
        "from the line [J]": (100 - 11.76, 0, 0), "from the line, peak [W]": (100, 0, 0),
        "largest voltage [V]": (380, 380, 320),
        "rated power of the resistor, at least [W]": (a / 0.4, b / 0.4, 0),
        "resistance, at most [Ω]": (380**2 / 60, 3610, nan),
    }  # fmt: skip
    check_table(supply_table(apart), rows, note=[11.76, 380, 0.2, "(assumed)"])
    back = Supply(560e-6, 320, 380, feedback=True, max_feedback_power=80.0)
    returned = with_supply(size_of(cycle, PLAIN), cycle, back)
    (one,) = returned.others
    assert (one[0], one[1].name, one[1].share) == ("bus", "feedback", pytest.approx(1.25, rel=1e-13))
    rows = {
        "regenerated [J]": (100,), "given back to the line [J]": (burnt,), "mean of that [W]": (burnt / 2,),
        "largest of that [W]": (100,), "from the line [J]": (burnt,), "from the line, peak [W]": (100,),
        "largest voltage [V]": (380,),
    }  # fmt: skip
    check_table(supply_table(returned.supply), rows, note=[11.76, 380])


def test_what_stands_in_for_the_duty_of_a_resistor_is_said():
    cycle = cycle_by_hand()
    for duty, words in ((None, "20% of the resistor's rated power in the mean"), (0.2, "")):
        supply = Supply(560e-6, 320, 380, None, 500.0, duty=duty)
        (one,) = (rating for _, rating in with_supply(size_of(cycle, PLAIN), cycle, supply).others)
        assert one.assumed == words
        assert one.required == pytest.approx(5 * (100 - 11.76) / 2, rel=1e-13)


def test_drives_do_not_fit_whose_bus_does_not():
    cycle = cycle_by_hand()
    bare = Supply(560e-6, 320, 380)
    found = with_supply(size_of(cycle, PLAIN), cycle, bare)
    top = math.sqrt(320**2 + 2 * 100 / 560e-6)
    assert not found.fits
    assert size_of(cycle, PLAIN).fits
    assert found.worst == ("bus", found.others[0][1])
    assert (found.others[0][1].required, found.others[0][1].allowed) == pytest.approx(
        (top - 320, 60), rel=1e-12
    )
    amplifier = Amplifier(rated_current_rms=5, max_current_rms=9, max_voltage=400.0)
    fed = replace(PLAIN, motor=replace(PLAIN.motor, amplifier=amplifier))
    found = with_supply(size_of(cycle, (PLAIN, fed, PLAIN)), cycle, replace(bare, max_voltage=900.0))
    one = ratings(found)["B", "rise of the bus voltage"]
    assert (one.required, one.allowed, one.time) == pytest.approx((top - 320, 80, 0.0), rel=1e-12)
    assert set(ratings(found)) == {("bus", "rise of the voltage"), ("B", "rise of the bus voltage")}


def test_currents_of_an_amplifier_by_hand():
    """1, 1, -.6, -.6 N m of A by .5 N m/A; holding .4 N m for 2 s; copper 3 R i²."""
    amplifier = Amplifier(
        rated_current_peak=2.0, max_current_peak=4.0, max_current_time=0.9, max_power=130.0, name="D"
    )
    motor = replace(PLAIN.motor, amplifier=amplifier, phase_resistance=2.0)
    cycle = replace(cycle_by_hand(), rest=2.0, holding=np.array([40.0, 0, 0]))
    axis = size_of(cycle, replace(PLAIN, motor=motor)).axes[0]
    found = {one.name: (one.required, one.allowed, one.time) for one in axis.ratings}
    rms = math.sqrt((2**2 + 1.2**2 + 2 * 0.8**2) / 4)
    assert found["rms current"] == pytest.approx((rms, math.sqrt(2), math.nan), rel=1e-13, nan_ok=True)
    assert found["peak current"] == pytest.approx((2.0, 4 / math.sqrt(2), 0.0), rel=1e-13)
    assert found["time above rated current"] == pytest.approx((1.0, 0.9, 0.0), rel=1e-13)
    assert found["amplifier power"] == pytest.approx((100 + 3 * 2 * 4, 130, 0.0), rel=1e-13)
    supply = with_supply(size_of(cycle, replace(PLAIN, motor=motor)), cycle, BUS).supply
    net = 100 - 100 + 3 * 2 * (2**2 + 1.2**2 + 0.8**2 + 2 * 0.8**2)
    (bus,) = supply.buses
    assert bus.line_work - bus.burnt == pytest.approx(net, rel=1e-12)


def test_a_stretch_above_the_rated_current_goes_over_the_end_of_a_cycle():
    """A triangle that is above half its height at both ends: from 1.5 s to .5 s."""
    force = np.outer([100.0, 0, 100.0], [1, 0, 0])
    cycle = Cycle([0, 1, 2], force, 0 * force, 0 * force)
    for height, longest, when in ((1.0, 1.0, 1.5), (1.8, 0.2, 1.9), (0.2, 1.8, 1.1)):
        amplifier = Amplifier(rated_current_rms=height, max_current_rms=9, max_current_time=3.0)
        axis = size_of(cycle, replace(PLAIN, motor=replace(PLAIN.motor, amplifier=amplifier))).axes[0]
        one = next(one for one in axis.ratings if one.name == "time above rated current")
        assert (one.required, one.time) == pytest.approx((longest, when), rel=1e-12)
    for row, expected in ((0, math.inf), (1, 0.0)):
        level = np.full((3, 3), 100.0 if row == 0 else 0.0)
        flat = Cycle([0, 1, 2], level, 0 * level, 0 * level)
        axis = size_of(flat, replace(PLAIN, motor=replace(PLAIN.motor, amplifier=amplifier))).axes[0]
        one = next(one for one in axis.ratings if one.name == "time above rated current")
        assert one.required == expected


def test_constants_of_motors_by_rms_peak_and_winding():
    base = {"rated_torque": 1.3, "peak_torque": 3.8, "max_speed": 500.0, "inertia": 3e-5}
    winding = Winding(320, 4, 1.0, 0.008, "between lines", torque_constant_rms=0.594, max_current_rms=8.5)
    by_winding = Motor(**base, winding=winding)
    by_peak = Motor(**base, torque_constant_peak=0.594 / math.sqrt(2), phase_resistance=0.5)
    for motor in (by_winding, by_peak):
        assert motor.torque_constant == pytest.approx(0.594, rel=1e-14)
        assert motor.resistance == 0.5
        assert motor.copper_loss(np.array([2.0]))[0] == pytest.approx(1.5 * (2 / 0.594) ** 2, rel=1e-13)
        peak = math.sqrt(2) * 2 / 0.594
        assert motor.copper_loss(np.array([2.0]))[0] == pytest.approx(1.5 * 0.5 * peak**2, rel=1e-13)
    assert Motor(**base).copper_loss(np.array([2.0])) == 0
    assert (Motor(**base).torque_constant, Motor(**base).resistance) == (None, None)
    assert Motor(**base, winding=replace(winding, measured="phase")).resistance == 1.0


GOOD = {"rated_current_rms": 3.0, "max_current_rms": 9.0}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "exactly one of rated_current_rms, rated_current_peak, got none"),
        ({**GOOD, "max_current_peak": 12.0}, "got max_current_rms and max_current_peak"),
        ({**GOOD, "max_current_rms": 2.9}, "max_current: expected at least the rated one"),
        ({**GOOD, "max_power": 0}, "max_power: expected a number above zero"),
        ({**GOOD, "max_voltage": -1}, "max_voltage: expected a number above zero"),
        ({**GOOD, "max_current_time": "3"}, "max_current_time: expected"),
        ({**GOOD, "rated_current_rms": math.nan}, "rated_current_rms: expected"),
        ({**GOOD, "name": 3}, "amplifier: name: expected a text"),
    ],
)
def test_amplifiers_that_are_none(given, words):
    with pytest.raises(DriveError, match=words):
        Amplifier(**given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"amplifier": Amplifier(**GOOD)}, "amplifier: expected a winding, torque_constant_rms or"),
        ({"amplifier": 3, "torque_constant_rms": 1.0}, "amplifier: expected an Amplifier"),
        ({"phase_resistance": 1.0}, "phase_resistance: expected a torque constant"),
        ({"torque_constant_rms": 1.0, "torque_constant_peak": 1.0}, "at most one of torque_constant_rms"),
        ({"torque_constant_rms": 0.0}, "torque_constant_rms: expected a number above zero"),
        (
            {
                "torque_constant_rms": 1.0,
                "winding": Winding(320, 4, 1, 1e-3, "phase", flux=0.1, max_current_rms=9),
            },
            "torque_constant_rms: the winding has it already",
        ),
        ({"brake_time": -1.0}, "brake_time: expected"),
        ({"brake_energy": 0.0}, "brake_energy: expected a number above zero"),
    ],
)
def test_motors_whose_currents_nobody_can_tell(given, words):
    with pytest.raises(DriveError, match=words):
        Motor(1.3, 3.8, 500.0, 3e-5, **given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"capacitance": 0}, "capacitance: expected a number above zero"),
        ({"voltage": 380.0}, "max_voltage: expected more than the nominal 380 V"),
        ({"resistance": -1}, "resistance: expected a number above zero"),
        ({"duty": 1.5}, "duty: expected at most 1"),
        ({"duty": 0.2, "resistance": None, "resistor_power": None}, "duty: expected a resistance or"),
        ({"feedback": True}, "feedback: a line that takes energy back has no braking resistor"),
        ({"feedback": 1}, "feedback: expected true or false"),
        ({"common": "yes"}, "common: expected true or false"),
        ({"max_power": 0}, "max_power: expected a number above zero"),
        ({"max_feedback_power": -5}, "max_feedback_power: expected a number above zero"),
        ({"name": None}, "supply: name: expected a text"),
    ],
)
def test_supplies_that_are_none(given, words):
    with pytest.raises(DriveError, match=words):
        replace(BUS, **given)


def test_what_is_asked_of_something_else_than_a_supply():
    cycle = cycle_by_hand()
    with pytest.raises(DriveError, match="supply: expected"):
        with_supply(size_of(cycle, PLAIN), cycle, 3)
    with pytest.raises(DriveError, match="cycle: expected"):
        with_supply(size_of(cycle, PLAIN), 3, BUS)
    with pytest.raises(DriveError, match="sizing: expected"):
        with_supply(3, cycle, BUS)


FILE = """
amplifiers:
  - {name: D4, rated_current_rms: 3 A, max_current_peak: 12000 mA, max_current_time: 500 ms,
     max_voltage: 0.4 V}
motors:
  - {name: M400, rated_torque: 1.3 Nm, peak_torque: 3.8 Nm, max_speed: 5000 rpm, inertia: 0.3 kg cm^2,
     torque_constant_rms: 0.594 Nm/A, phase_resistance: 500 mohm, amplifier: D4, brake_torque: 1.4 Nm,
     brake_time: 40 ms, brake_energy: 0.2 kJ}
  - {name: M100, rated_torque: 0.32 Nm, peak_torque: 0.95 Nm, max_speed: 6000 rpm, inertia: 0.05 kg cm^2}
screws:
  - {name: 16x10, lead: 10 mm, diameter: 12.7 mm, length: 500 mm}
  - {name: 16x5, lead: 5 mm, diameter: 12.7 mm, length: 500 mm}
belts: [{name: b, diameter: 30 mm}]
supply: {capacitance: 560 uF, voltage: 320 V, max_voltage: 380 V, resistance: 40 Ω, resistor_power: 0.2 kW}
axes: {A: {motors: [M400], screws: [16x10]}, C: {belts: [b]}}
"""


def test_a_catalogue_with_amplifiers_supply_and_axes(tmp_path):
    (tmp_path / "drives.yaml").write_text(FILE, encoding="utf-8")
    found = read_catalogue(tmp_path / "drives.yaml")
    motor, other = found.motors
    amplifier = Amplifier(
        rated_current_rms=3.0, max_current_peak=12.0, max_current_time=0.5, max_voltage=0.4, name="D4"
    )
    assert motor.amplifier == amplifier
    assert (motor.torque_constant, motor.resistance) == (0.594, 0.5)
    assert (motor.brake_time, motor.brake_energy, other.amplifier) == (0.04, 200.0, None)
    assert found.supply == Supply(560e-6, 320.0, 380.0, 40.0, 200.0)
    names = [[drive.name for drive in found.of_axis(leg)] for leg in "ABC"]
    assert names[0] == ["M400 + 16x10"]
    assert len(names[1]) == 6
    assert names[2] == ["M400 + b", "M100 + b"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("amplifier: D4", "amplifier: D5", r"motors\[0\]: amplifier: expected one of D4, got 'D5'"),
        ("amplifier: D4", "amplifier: 4", r"motors\[0\]: amplifier: expected one of D4, got 4"),
        ("name: D4, rated_current_rms: 3 A", "name: D4", r"amplifiers\[0\]: .*expected exactly one of rated"),
        ("0.4 V}", "0.4 A}", r"amplifiers\[0\]: max_voltage: expected a voltage"),
        ("560 uF", "560 H", "supply: capacitance: expected a capacitance"),
        ("voltage: 320 V, ", "", "supply: .*voltage"),
        ("40 Ω", "40 ohms", "supply: resistance: expected a resistance"),
        ("axes: {A", "axes: {D", "axes: expected A, B or C, got 'D'"),
        ("motors: [M400]", "motors: [M4]", "axes: A: motors: expected one of M400, M100, got 'M4'"),
        ("motors: [M400]", "motors: M400", "axes: A: motors: expected a list of names"),
        ("motors: [M400]", "motor: [M400]", "axes: A: expected lists of names under motors, gears"),
        (
            "axes: {A: {motors: [M400], screws: [16x10]}, C: {belts: [b]}}",
            "axes: 3",
            "axes: expected A, B or C",
        ),
    ],
)
def test_mistakes_in_amplifiers_supply_and_axes_are_one_line(tmp_path, old, new, words):
    assert old in FILE
    (tmp_path / "drives.yaml").write_text(FILE.replace(old, new), encoding="utf-8")
    with pytest.raises(DriveError, match=words) as error:
        read_catalogue(tmp_path / "drives.yaml")
    assert "\n" not in str(error.value)
    assert "drives.yaml: " in str(error.value)


def test_two_amplifiers_of_one_name(tmp_path):
    line = "\n".join(FILE.splitlines()[2:4]) + "\n"
    (tmp_path / "drives.yaml").write_text(FILE.replace(line, 2 * line), encoding="utf-8")
    with pytest.raises(DriveError, match="amplifiers: the name 'D4' is given twice"):
        read_catalogue(tmp_path / "drives.yaml")


# --- different drives for the axes --------------------------------------------------------------------------


def catalogue(rng, motors=4, screws=3):
    """Motors around what the paper's motion takes."""
    sizes = [
        Motor(t, 3 * t, 700.0, 3e-5 * t**1.3, brake_torque=9.0, name=f"M{k}")
        for k, t in enumerate(np.exp(rng.uniform(-1.5, 1, motors)).tolist())
    ]
    leads = [
        Screw(float(lead), diameter=0.014, length=0.5, name=f"S{k}")
        for k, lead in enumerate(rng.uniform(0.008, 0.03, screws))
    ]
    return Catalogue(sizes, leads)


def power(sizing):
    return sum(drive.motor.rated_torque * drive.motor.rated_speed for drive in sizing.drives)


@pytest.fixture(scope="module")
def motion(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(61), method="compiled")


@pytest.mark.parametrize("seed", range(3))
def test_different_drives_are_those_of_all_combinations(robot, motion, seed):
    """Least power, then least used: of all 12³ combinations, by one sizing of each drive and axis."""
    rng = np.random.default_rng(seed)
    parts = catalogue(rng)
    found = p3dof.size_drives(robot, motion, parts, per_axis=True)
    alone = {one.name: one for one in p3dof.size_drives(robot, motion, parts)}
    each = [[(alone[d.name].axes[k].worst.share, d) for d in parts] for k in range(3)]
    fitting = [
        (sum(d.motor.rated_torque * 700.0 for _, d in three), max(share for share, _ in three))
        for three in itertools.product(*each)
        if all(share <= 1 for share, _ in three)
    ]
    best = min(fitting)
    assert found[0].fits
    assert (power(found[0]), found[0].worst[1].share) == pytest.approx(best, rel=1e-12)
    assert power(found[0]) <= min(power(one) for one in alone.values() if one.fits) * (1 + 1e-12)
    order = [power(one) for one in found if one.fits]
    assert order == pytest.approx(sorted(power for power, _ in fitting)[: len(order)], rel=1e-12)


def test_the_bus_decides_between_drives_that_fit_alone(robot, motion):
    """A supply too weak for the first combination: the lightest that it can bear comes first."""
    parts, cycle = catalogue(np.random.default_rng(1)), cycle_of(motion)
    free = p3dof.size_drives(robot, motion, parts, per_axis=True, frictionless=True)
    tops = [with_supply(one, cycle, Supply(560e-6, 320, 1e4)).supply.buses[0].top_voltage for one in free]
    limit = min(sorted(tops)[len(tops) // 2], tops[0] * (1 - 1e-9))
    found = p3dof.size_drives(
        robot, motion, parts, per_axis=True, frictionless=True, supply=Supply(560e-6, 320, limit)
    )
    expected = [one for one, top in zip(free, tops, strict=True) if top <= limit]
    assert power(found[0]) == power(expected[0])
    assert {one.name for one in expected} <= {one.name for one in found if one.fits}
    assert free[0].name in {one.name for one in found if not one.fits}
    assert {"bus"} == {owner for one in found if not one.fits for owner, _ in one.exceeded}


def test_an_axis_that_no_drive_fits_keeps_the_nearest(robot, motion):
    weak = [Motor(t, 3 * t, 700.0, 1e-6, brake_torque=9.0, name=f"{t}") for t in (0.01, 0.02)]
    found = p3dof.size_drives(
        robot, motion, Catalogue(weak, [Screw(0.01, diameter=0.012, length=0.5)]), per_axis=True
    )
    assert [one.name for one in found] == ["0.02 + screw"]
    assert not found[0].fits


def test_axes_of_a_catalogue_have_what_they_may_have(robot, motion, tmp_path):
    big = Motor(3, 9, 700.0, 1e-4, brake_torque=9.0, name="big")
    parts = Catalogue(
        [big, replace(big, rated_torque=2.0, name="small")],
        [
            Screw(0.01, diameter=0.012, length=0.5, name="s10"),
            Screw(0.02, diameter=0.014, length=0.5, name="s20"),
        ],
        axes={"A": {"motors": ["big"]}, "C": {"screws": ["s20"]}},
    )
    found = p3dof.size_drives(robot, motion, parts)
    assert {one.drives[0].motor.name for one in found} == {"big"}
    assert {one.drives[2].transmission.name for one in found} == {"s20"}
    assert found[0].name.startswith("A: big + ")
    text = write_ranking(found, tmp_path / "out.csv").read_text().splitlines()
    assert text[1].startswith('"A: big + ')
    assert "speed C used" in text[0]


def test_drives_without_names_of_their_own_are_told_apart(robot, motion):
    """Two drives of one name, of which A needs the second."""
    motors = [Motor(t, 3 * t, 700.0, 1e-4, brake_torque=9.0) for t in (0.01, 3.0)]
    drives = [Drive(motor, Screw(0.02, diameter=0.014, length=0.5)) for motor in motors]
    found = p3dof.size_drives(robot, motion, drives, per_axis=True)
    assert [drive is drives[1] for drive in found[0].drives] == [True] * 3
    assert not_checked(found[0])


# --- commands -----------------------------------------------------------------------------------------------

TASK = "waypoints: [{pose: [0, 0, 0]}, {pose: [50 mm, 20 mm, 0]}, {pose: [0, 0, 0]}]\n"


def test_the_command_chooses_a_drive_for_each_axis_and_shows_the_supply(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(TASK, encoding="utf-8")
    (tmp_path / "drives.yaml").write_text(FILE.replace("0.4 V", "400 V"), encoding="utf-8")
    words = ["size", "task.yaml", "--duration", 1, "--drives", "drives.yaml", "--samples", 201]
    code, told, _ = run(capsys, *words, "--out", "ranked.csv")
    assert "A: M400 + 16x10, B: " in told
    assert "Supply: supply" in told
    assert code in (0, 1)
    assert (tmp_path / "ranked.csv").read_text().splitlines()[1].startswith('"A: M400 + 16x10, ')
    plain = FILE[: FILE.index("supply:")]
    (tmp_path / "drives.yaml").write_text(plain.replace("0.4 V", "400 V"), encoding="utf-8")
    same, each = (run(capsys, *words, *more)[1] for more in ((), ("--per-axis",)))
    assert "Supply" not in same
    assert "A: M" in each
    assert "A: M" not in same


def test_the_figure_has_the_voltage_of_the_buses(robot):
    from p3dof.report import plots

    cycle = cycle_of(robot.inverse_dynamics(p3dof.paper_motion(101)))
    for common, count in ((True, 1), (False, 3)):
        sizing = with_supply(size_of(cycle, D1), cycle, replace(BUS, common=common))
        *_, last = plots.drives_figure(sizing, cycle).axes
        for line, bus in zip(last.lines, sizing.supply.buses, strict=False):
            np.testing.assert_array_equal(line.get_ydata(), bus.voltage)
        assert last.lines[count].get_ydata()[0] == 380.0


def test_an_assessment_counts_the_bus(robot, motion):
    parts = Catalogue([Motor(3, 9, 700.0, 1e-4, brake_torque=9.0)], [D2], supply=Supply(560e-6, 320, 321))
    found = p3dof.assess(robot, motion, drives=parts)
    assert (found.worst.part, found.worst.name, found.fits) == ("bus", "rise of the voltage", False)
    assert "rise of the voltage of bus" in found.verdict
    other = replace(parts.motors[0], rated_torque=2.0, name="small")
    pair = Catalogue([*parts.motors, other], [D2], axes={"A": {"motors": ["motor"]}})
    each = p3dof.assess(robot, motion, drives=pair, per_axis=True)
    assert each.drives.name == "A: motor + screw, B: small + screw, C: small + screw"
    page = p3dof.report.render_assessment(each)
    assert f", with {each.drives.name}." in page.replace("&#43;", "+")
    assert "another drive on each axis" in page
    assert "Supply: supply" in p3dof.report.render_assessment(found)


D2 = Screw(0.02, diameter=0.014, length=0.5)
