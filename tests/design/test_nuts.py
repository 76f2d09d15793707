"""Lives of ball nuts and guides, belts, racks: published examples, and sums of the test's own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from table_numbers import check_table, shows

import p3dof
from p3dof._base.errors import DriveError, ParameterError
from p3dof.cli import main
from p3dof.design.bearings import Bearings, Guide, bearing_life
from p3dof.design.drives import (
    Belt,
    Cycle,
    Drive,
    Motor,
    Rack,
    RequiredLife,
    Screw,
    caveats,
    cycle_of,
    not_checked,
    nuts_table,
    read_catalogue,
    required_life,
    size_of,
)
from p3dof.design.drives.nuts import flank_loads, nut_life
from p3dof.design.forces_of_tasks import with_guide_friction
from p3dof.machine.parameters import PAPER

MOTOR = Motor(5.0, 15.0, 900.0, 1e-4)
NOTE = {  # paper's motion, C_a 9000 N, F_pr 450 N, lead 5 mm: turns, F_m of both flanks [N], L [Mrev], [h]
    "A": (41.09137, 484.3298, 421.3729, 4136.716, 27964.2),
    "B": (20.76390, 476.1571, 427.6184, 4191.297, 56070.8),
    "C": (71.72825, 482.4692, 422.3813, 4154.441, 16088.7),
}


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def paper(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(4001), method="compiled")


def nuts(cycle, screw, **given):
    return [axis.nut for axis in size_of(cycle, Drive(MOTOR, screw), **given).axes]


def steady(force, rpm, seconds=1.0):
    """A cycle with constant force and speed of a screw of 10 mm."""
    speed = np.full((2, 3), rpm / 60 * 0.01)
    return Cycle([0.0, seconds], np.full((2, 3), force), speed, 0 * speed)


@pytest.mark.parametrize(
    ("dynamic", "load", "rpm", "hours", "digits"),
    [
        # MITCalc, help of "Ball screws": 1000 N with load factor 1.2 at 2400 rpm, 20,000 h: C_a 17073.1 N.
        (17073.1, 1.2 * 1000.0, 2400.0, 20000.0, 1e-5),
        # calculatorfriend.com, "Ball screw life": 150 against 80 daN with factor 1.25 at 75 rpm: 750 h.
        (1500.0, 1.25 * 800.0, 75.0, 750.0, 1e-12),
    ],
)
def test_published_lives(dynamic, load, rpm, hours, digits):
    for sign in (1, -1):  # one flank bears all, whichever
        found = nuts(steady(sign * load, rpm), Screw(0.01, inertia=0.0, dynamic=dynamic, preload=0.0))[0]
        assert found.hours == pytest.approx(hours, rel=digits)
        assert found.mean_speed == pytest.approx(rpm * math.pi / 30, rel=1e-12)


def test_worked_numbers_of_the_papers_motion(paper):
    screw = Screw(0.005, inertia=0.0, dynamic=9000.0, preload=450.0)
    for leg, one in zip("ABC", nuts(cycle_of(paper), screw), strict=True):
        found = (one.turns, *one.mean_loads, one.life / 1e6, one.hours)
        assert found == pytest.approx(NOTE[leg], rel=4e-6)  # half a digit
    bare = nuts(cycle_of(paper), Screw(0.005, inertia=0.0, dynamic=9000.0, preload=0.0))[0]
    assert bare.life / 1e6 == pytest.approx(1751764, rel=2e-6)
    coarse = nuts(cycle_of(paper), Screw(0.01, inertia=0.0, dynamic=7000.0, preload=300.0))
    lives = [one.life / 1e6 for one in coarse]
    assert lives == pytest.approx([6347.613, 6520.000, 6405.082], rel=2e-6)


def test_flanks_by_another_integration():
    """Gauss-Kronrod over F = 700 cos 2t, n = 50 sin t, which goes both ways, against trapezoids."""
    preload, dynamic, end = 300.0, 6000.0, 4.0
    limit = 2**1.5 * preload

    def pressed(force):
        size = abs(force)
        return preload * (1 + size / limit) ** 1.5 if size < limit else size

    def load(t, flank):
        force = flank * 700 * math.cos(2 * t)
        return pressed(force) if force >= 0 else pressed(force) - abs(force)

    points = [math.pi / 4, 3 * math.pi / 4, math.pi]
    angle = quad(lambda t: abs(50 * math.sin(t)), 0, end, points=points)[0]
    means = [
        (quad(lambda t, f=flank: load(t, f) ** 3 * abs(50 * math.sin(t)), 0, end, points=points)[0] / angle)
        ** (1 / 3)
        for flank in (1, -1)
    ]
    lives = [(dynamic / mean) ** 3 for mean in means]
    together = sum(life ** (-10 / 9) for life in lives) ** (-9 / 10)
    time = np.linspace(0, end, 200_001)
    found = nut_life(time, 700 * np.cos(2 * time), 50 * np.sin(time), 6.0, dynamic, preload)
    assert found.mean_loads == pytest.approx(means, rel=1e-8)
    assert found.life == pytest.approx(1e6 * together, rel=1e-8)
    assert found.hours == pytest.approx(1e6 * together / (angle / 2 / math.pi) * 6 / 3600, rel=1e-8)
    assert found.mean_speed == pytest.approx(angle / 6, rel=1e-8)


def test_the_standard_is_near_two_springs_of_hertz():
    """F_i = F_pr (1 ± s)^(3/2) with F1 - F2 = F: the standard is above by 2.48 % at most, never below."""
    one, other = flank_loads(np.array([500.0, -500.0]), 600.0)
    np.testing.assert_allclose(one, [883.8298, 383.8298], rtol=2e-7)
    np.testing.assert_allclose(other, [383.8298, 883.8298], rtol=2e-7)
    above = []
    for force in np.linspace(1, 2**1.5 * 600 - 1, 400):
        s = brentq(lambda s, f=force: 600 * ((1 + s) ** 1.5 - (1 - s) ** 1.5) - f, 0, 1)
        above.append(flank_loads(np.array(force), 600.0)[0] / (600 * (1 + s) ** 1.5) - 1)
    assert min(above) >= -1e-12
    assert max(above) == pytest.approx(0.0248, abs=5e-5)
    beyond = flank_loads(np.array([2000.0]), 600.0)
    assert [float(part[0]) for part in beyond] == [2000.0, 0.0]


@pytest.mark.parametrize(
    ("nominal", "lead", "preload", "drag"),
    [(0.016, 0.005, 600.0, 0.0756940), (0.016, 0.01, 600.0, 0.107047), (0.02, 0.02, 450.0, 0.126943)],
)
def test_drag_of_the_preload(nominal, lead, preload, drag):
    screw = Screw(lead, inertia=0.0, nominal_diameter=nominal, dynamic=1e4, preload=preload)
    assert screw.drag == pytest.approx(drag, rel=5e-6)
    assert Screw(lead, inertia=0.0, nominal_diameter=nominal, dynamic=1e4, drag=0.2).drag == 0.2
    assert Screw(lead, inertia=0.0, dynamic=1e4).drag == 0.0


def test_what_is_said_of_the_drag_where_only_the_designation_is_known(paper):
    """A name such as 16x5 has a diameter, which limits the speed; the drag is zero, and that is said."""
    own = {"inertia": 1e-5, "name": "M 16x5", "dynamic": 9000.0}
    screw = Screw(0.005, **own)
    assert (screw.drag, screw.preload_force) == (0.0, 450.0)
    assert screw.sold_diameter == (0.016, "nominal diameter of M 16x5 by its designation, for its speed only")
    words = "drag of the preload of M 16x5 (no drag, no nominal_diameter in the file)"
    for given, silent in (
        ({}, False),
        ({"nominal_diameter": 0.016}, True),
        ({"drag": 0.05}, True),
        ({"preload": 0.0}, True),
    ):
        found = size_of(cycle_of(paper), Drive(MOTOR, Screw(0.005, **own, **given)))
        assert (words not in not_checked(found)) == silent, given
        told = any("by its designation, for its speed only" in one for one in caveats(found))
        assert told == ("nominal_diameter" not in given), given
    by_hand = 0.05 / math.sqrt(0.005 / (math.pi * 0.016)) * 450.0 * 0.005 / (2 * math.pi)
    assert Screw(0.005, **own, nominal_diameter=0.016).drag == pytest.approx(by_hand, rel=1e-12)


def test_preloads_where_little_is_known():
    assert Screw(0.01, inertia=0.0, dynamic=8000.0).preload_force == pytest.approx(400.0)
    assert Screw(0.01, inertia=0.0, dynamic=8000.0, preload="8 %").preload_force == pytest.approx(640.0)
    assert Screw(0.01, inertia=0.0, dynamic=8000.0, preload=800.0).preload_force == 800.0
    assert Screw(0.01, inertia=0.0).preload_force == 0.0
    assert Screw(0.01, inertia=0.0, lead_accuracy="T7").lead_deviation == 52e-6
    assert Screw(0.01, inertia=0.0, lead_accuracy=1e-5).lead_deviation == 1e-5


def ratings(transmission, force=250.0, **given):
    found = size_of(steady(force, 600.0, 2.0), Drive(MOTOR, transmission), **given).axes[0]
    return {one.name: one for one in found.ratings}


def test_life_and_static_load_are_ratings():
    screw = Screw(0.01, inertia=0.0, dynamic=9000.0, static=1200.0)
    used = ratings(screw, life="20000 h")
    assert (used["static load"].required, used["static load"].allowed) == (250.0, 600.0)
    assert "static safety 2" in used["static load"].assumed
    assert used["life"].required == 20000.0
    assert used["life"].allowed == nuts(steady(250.0, 600.0, 2.0), screw)[0].hours
    assert "preload 5%" in used["life"].assumed
    assert ratings(screw, life=RequiredLife(cycles=1e6))["life"].required == pytest.approx(1e6 * 2 / 3600)
    # 600 rpm at 10 mm: 0.2 m in a cycle of 2 s
    assert ratings(screw, life="360 km")["life"].required == pytest.approx(360e3 / 0.2 * 2 / 3600)
    assert "life" not in ratings(screw)
    impact = ratings(Screw(0.01, inertia=0.0, static=1200.0, static_safety=5.0))["static load"]
    assert (impact.share, impact.assumed) == (pytest.approx(250 * 5 / 1200), "")


def test_belts_and_racks():
    belt = Belt(0.05, max_force=400.0, pretension=300.0, max_tension=700.0)
    used = ratings(belt, -250.0)
    found = {name: (one.required, one.allowed) for name, one in used.items() if name in TEETH}
    assert found == {
        "belt force": (250.0, 400.0),
        "pretension": (250.0, 300.0),
        "belt tension": (550.0, 700.0),
    }
    rack = ratings(Rack(0.05, max_force=700.0))["rack force"]
    assert (rack.required, rack.allowed) == (250.0, pytest.approx(500.0))
    assert rack.assumed == "static safety 1.4"
    assert ratings(Rack(0.05, max_force=700.0, static_safety=2.0))["rack force"].allowed == 350.0
    assert not set(TEETH) & set(ratings(Belt(0.05)))
    assert ratings(Belt(0.05, max_speed=100.0))["belt speed"].allowed == pytest.approx(100 * 30 / math.pi)
    assert ratings(Rack(0.05, max_speed=100.0))["rack speed"].allowed == pytest.approx(100 * 30 / math.pi)


TEETH = ("belt force", "pretension", "belt tension", "rack force")


@shows("p3dof.design.drives.tables.nuts_table")
def test_the_table_of_nuts():
    screw = Screw(0.01, inertia=0.0, nominal_diameter=0.016, dynamic=9000.0, static=900.0, lead_accuracy="P5")
    plain = Drive(MOTOR, Screw(0.01, inertia=0.0))
    sizing = size_of(steady(300.0, 600.0, 2.0), [Drive(MOTOR, screw), plain, plain])
    limit = 2**1.5 * 450
    one = 450 * (1 + 300 / limit) ** 1.5
    lives = [(9000 / load) ** 3 for load in (one, one - 300)]
    life = sum(each ** (-10 / 9) for each in lives) ** -0.9
    drag = 0.05 / math.sqrt(10 / (16 * math.pi)) * 450 * 0.01 / (2 * math.pi)
    values = [450.0, 300.0, 0.0, 20.0, 600.0, one, one - 300, life, life * 1e6 / 600 / 60, 3.0, drag, 23.0]
    table = nuts_table(sizing)
    rows = {row[0]: (value, math.nan, math.nan) for row, value in zip(table.rows, values, strict=True)}
    check_table(table, rows, note=[3408, 5, "screw: 5%", 0.05])
    assert not nuts_table(size_of(steady(1.0, 60.0), plain)).rows


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Screw(0.01, inertia=0, dynamic=1000.0, preload=101.0), "at most 10% of the dynamic rating"),
        (lambda: Screw(0.01, inertia=0, dynamic=1000.0, preload="11 %"), "at most 10% of the dynamic rating"),
        (lambda: Screw(0.01, inertia=0, preload="5 %"), "a share needs the dynamic rating"),
        (lambda: Screw(0.01, inertia=0, preload=-1.0), "preload: expected zero or more"),
        (lambda: Screw(0.01, inertia=0, dynamic=0.0), "dynamic: expected a number above zero"),
        (lambda: Screw(0.01, inertia=0, static=-3.0), "static: expected a number above zero"),
        (lambda: Screw(0.01, inertia=0, static_safety=0.0), "static_safety: expected a number above"),
        (lambda: Screw(0.01, inertia=0, lead_accuracy="T6"), "lead_accuracy: expected a length .* one of P1"),
        (lambda: Screw(0.01, inertia=0, nominal_diameter=0.0), "nominal_diameter: expected a number above"),
        (lambda: Belt(0.05, pretension=-1.0), "pretension: expected zero or more"),
        (lambda: Belt(0.05, max_tension=0.0), "max_tension: expected a number above zero"),
        (lambda: Rack(0.05, pretension=10.0), "a rack has none"),
        (lambda: Rack(0.05, max_force=0.0), "max_force: expected a number above zero"),
        (RequiredLife, "expected exactly one of hours, cycles and distance, got none"),
        (lambda: RequiredLife(hours=1.0, cycles=2.0), "got hours and cycles"),
        (lambda: RequiredLife(hours=-1.0), "hours: expected a number above zero"),
        (lambda: required_life("20000"), "expected a life such as '20000 h'"),
        (lambda: required_life("2 years"), "expected a life such as"),
        (lambda: required_life("x h"), "expected a life such as"),
        (lambda: required_life("-5 h"), "expected a life such as"),
        (lambda: required_life(7), "expected a life such as"),
    ],
)
def test_bad_numbers_have_one_clear_error(make, words):
    with pytest.raises(DriveError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_required_lives_of_texts():
    assert str(required_life("20000 h")) == "20000 h"
    assert required_life("1e7 cycles").hours_of(3.6) == pytest.approx(1e4)
    assert required_life("5000 km") == RequiredLife(distance=5e6)
    assert math.isnan(required_life("5000 km").hours_of(1.0))
    assert required_life(None) is None


# --- guides -------------------------------------------------------------------------------------------------

SIZE_15 = {"dynamic": 11300.0, "basis": 50e3, "moments": (90.0, 90.0, 75.0)}
ONE = (626.281, 570.886, 725.149)
TWO = ((115.473, 125.032), (78.7273, 88.1318), (100.041, 98.6929))


@pytest.fixture(scope="module")
def elastic(robot):
    return robot.reactions(p3dof.paper_motion(1001), "elastic")


def test_one_and_two_carriages(elastic):
    """Worked numbers of the paper's motion, of a finer sampling."""
    one = bearing_life(PAPER, elastic, Bearings(guides=Guide(**SIZE_15))).guides
    two = bearing_life(PAPER, elastic, Bearings(guides=Guide(**SIZE_15, distance=0.12))).guides
    assert [guide.mean_load for guide in one] == pytest.approx(ONE, rel=2e-4)
    for guide, loads in zip(two, TWO, strict=True):
        assert guide.mean_loads == pytest.approx(loads, rel=5e-4)
        assert guide.life == pytest.approx(50e3 * (11300 / max(loads)) ** 3, rel=2e-3)


def test_two_carriages_are_in_balance_with_what_they_bear():
    """From free bodies: forces at ±ℓ/2 with the sum and the moments of the load, in any axes of the rail."""
    rng = np.random.default_rng(3)
    force, moment, centre = rng.normal(0, 100, 3), rng.normal(0, 10, 3), rng.normal(0, 0.1, 3)
    force[2] = 0.0
    guide = Guide(**SIZE_15, distance=0.2, turn=0.4, centre=centre, preload=500.0)
    c, s = math.cos(0.4), math.sin(0.4)
    axes = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    f, m = axes @ force, axes @ (moment - np.cross(centre, force))
    arms = np.array([[0, 0, 0.1], [0, 0, -0.1]])
    unknown = np.zeros((4, 4))  # fx, fy of both, from their sums and moments about x and y
    unknown[0, [0, 2]] = unknown[1, [1, 3]] = 1
    for k, arm in enumerate(arms):
        for j, unit in enumerate(np.eye(3)[:2]):
            unknown[2:, 2 * k + j] = np.cross(arm, unit)[:2]
    solved = np.linalg.solve(unknown, [f[0], f[1], m[0], m[1]]).reshape(2, 2)
    loads = np.abs(solved).sum(axis=1) + abs(m[2]) / 2 * 11300 / 75
    parts = sum(guide.parts(force[None], moment[None]))[0]
    np.testing.assert_allclose(parts, loads, rtol=1e-12)
    preloaded = [500 * (1 + load / 1400) ** 1.5 if load < 1400 else load for load in loads]
    np.testing.assert_allclose(guide.equivalent(force[None], moment[None])[0], preloaded, rtol=1e-12)
    drag = 2 * 3.5 + 0.003 * sum(preloaded)
    assert guide.resistance(force[None], moment[None])[0] == pytest.approx(drag, rel=1e-12)


def test_guides_and_bearings_have_to_live(elastic, tmp_path, capsys):
    parts = Bearings(guides=Guide(**SIZE_15, static=2000.0, static_safety=5.0), life="1e9 h")
    report = bearing_life(PAPER, elastic, parts, rest=1.0)
    assert not report.lasts
    assert any("1e+09 h are required" in words for words in report.warnings)
    assert any("less than 5" in words for words in report.warnings)
    asked = bearing_life(PAPER, elastic, parts, life="1000 km", rest=1.0)
    assert asked.lasts
    one = asked.guides[0]
    assert one.required == pytest.approx(1e6 / one.way * 2 / 3600, rel=1e-12)
    with pytest.raises(ParameterError, match="life: expected a life"):
        Bearings(guides=Guide(**SIZE_15), life="long")
    for given, words in (({"distance": 0.0}, "distance"), ({"preload": "x %"}, "share"), ({"mu": -1}, "mu")):
        with pytest.raises(ParameterError, match=words):
            Guide(**SIZE_15, **given)
    file = tmp_path / "bearings.yaml"
    file.write_text(
        "guides: {dynamic: 11.3 kN, basis: 50 km, moments: [90 Nm, 90 Nm, 75 Nm], preload: 2 %,"
        " distance: 120 mm}\nlife: 20000 h\n",
        encoding="utf-8",
    )
    assert main(["bearings", str(file), "--samples", "21"]) == 0
    assert main(["bearings", str(file), "--samples", "21", "--life", "1e12 h"]) == 1
    assert "are required" in capsys.readouterr().out


def test_the_usual_friction_of_guides(robot):
    """On each slider 3.5 N and .003 of what it bears, by the reactions at all samples."""
    few = robot.inverse_dynamics(p3dof.paper_motion(51), method="compiled")
    found = with_guide_friction(robot, few)
    loads = robot.reactions(p3dof.paper_motion(51), "elastic")
    for k, joint in enumerate(("slide_a", "slide_b", "slide_c")):
        forces, moments = loads[joint].forces, loads[joint].moments
        load = np.abs(forces[:, :2]).sum(axis=1) + np.abs(moments).sum(axis=1) / 0.01
        speed = few.slider_velocities[:, k]
        friction = (3.5 + 0.003 * load) * np.tanh(speed / 1e-3)
        added = found.forces[:, k] - few.forces[:, k]
        assert np.abs(added - friction).max() < 1e-9
    assert np.abs(found.power_residual - few.power_residual).max() < 1e-9
    assert with_guide_friction(robot, found) is found
    drive = Drive(MOTOR, Screw(0.01, inertia=1e-5))
    rough, smooth = (p3dof.size_drives(robot, few, drive, frictionless=off)[0] for off in (False, True))
    assert rough.axes[0].rms_torque > smooth.axes[0].rms_torque
    assessed = p3dof.assess(robot, few, drives=drive)
    assert assessed.assumed
    assert assessed.drives.axes[0].rms_torque == rough.axes[0].rms_torque
    assert not p3dof.assess(robot, few, drives=drive, frictionless=True).assumed
    assert not p3dof.assess(robot, few).assumed


def test_a_catalogue_with_nuts_belts_and_racks(tmp_path):
    file = tmp_path / "drives.yaml"
    file.write_text(
        "motors: [{name: M, rated_torque: 1 Nm, peak_torque: 3 Nm, max_speed: 314, inertia: 1 kg cm^2}]\n"
        "screws: [{name: S, lead: 10 mm, inertia: 0, nominal_diameter: 16 mm, dynamic: 9 kN, static: 13 kN,"
        " preload: 5 %, lead_accuracy: 52 um}]\n"
        "belts: [{name: B, diameter: 50 mm, max_force: 400 N, pretension: 300 N, max_tension: 0.7 kN}]\n"
        "racks: [{name: R, diameter: 50 mm, max_force: 2 kN}]\nlife: 20000 h\n",
        encoding="utf-8",
    )
    found = read_catalogue(file)
    screw, belt, rack = found.transmissions
    assert (screw.preload_force, screw.lead_deviation) == (450.0, 52e-6)
    assert (belt.max_force, belt.max_tension, rack.max_force) == (400.0, 700.0, 2000.0)
    assert found.life == RequiredLife(hours=20000.0)
    file.write_text(file.read_text(encoding="utf-8").replace("20000 h", "long"), encoding="utf-8")
    with pytest.raises(DriveError, match="life: expected a life"):
        read_catalogue(file)
