"""Margins, derating, speeds of nuts: worked numbers, makers' tables, and the right reasons."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import p3dof
from p3dof._base.errors import DriveError
from p3dof.design.drives import (
    VERDICTS,
    Ambient,
    Belt,
    Catalogue,
    Cycle,
    Drive,
    Gear,
    Margins,
    Motor,
    Rack,
    Screw,
    caveats,
    margins,
    margins_of,
    size_of,
    verdict,
)
from p3dof.design.drives.sizing import speed_ratings
from p3dof.design.optimisation import task_measures
from p3dof.design.tasks.files import parse

RPM = math.pi / 30
TASK = """
name: pick and place
waypoints:
  - {name: home, pose: [0, 0, 0]}
  - name: pick
    pose: [-150 mm, 0, -15 deg]
    dwell: 200 ms
    pick_up: {mass: 3 kg, com: [0, 0, -40 mm], inertia: [0, 0, 0]}
  - {name: up, pose: [-150 mm, 25 mm], blend: 25 mm}
  - {name: over, pose: [150 mm, 25 mm], blend: 25 mm}
  - {name: place, pose: [150 mm, 0, 15 deg], dwell: 0.2, put_down: true}
  - {name: back, pose: [0, 0, 0]}
"""
M100 = Motor(0.32, 0.95, 6000 * RPM, 5e-6, 3000 * RPM, brake_torque=0.3, name="M100")
M400 = Motor(1.3, 3.8, 5000 * RPM, 3e-5, 3000 * RPM, brake_torque=1.4, time_constant=900.0, name="M400")
SCREWS = {
    lead: Screw(lead / 1e3, efficiency, diameter=0.0127, length=0.5, name=f"16x{lead}")
    for lead, efficiency in ((10, 0.9), (5, 0.88))
}


@pytest.fixture(scope="module")
def ranked():
    """The tutorial's drives for 3 kg in 2 s, by their names."""
    robot = p3dof.load()
    found = p3dof.design.forces_of_task(robot, parse(TASK).plan(2.0, 4001))
    sizings = p3dof.size_drives(robot, found, Catalogue([M100, M400], list(SCREWS.values())))
    return {sizing.name: sizing for sizing in sizings}


def used(sizing, name):
    """Of A, B, C, in percent."""
    return [next(100 * one.share for one in axis.ratings if one.name == name) for axis in sizing.axes]


def test_the_drive_of_the_tutorial_fits_and_its_least_reserve_is_the_nut(ranked):
    assert next(iter(ranked)) == "M400 + 16x10"
    best = ranked["M400 + 16x10"]
    assert best.fits
    assert best.worst[1].name == "DN"
    assert_allclose(used(best, "DN")[1], 80.174, rtol=2e-5)
    assert_allclose(used(best, "speed")[1], 70.153, rtol=2e-5)
    assert_allclose(used(best, "brake")[0], 21.498, rtol=1e-4)
    assert_allclose(best.axes[0].inertia_ratio, [0.777836, 2.035144], rtol=3e-6)
    assert_allclose(best.axes[2].inertia_ratio, [0.370689, 0.556827], rtol=3e-6)
    assert verdict(best).startswith("fits with 20% reserve; the least is DN of ")
    told = " ".join(caveats(best))
    for words in (
        "DN 70,000 (no dn of 16x10)",
        "by its designation",
        "up to 5,000 rpm",
        "up to 10 (no max_in",
    ):
        assert words in told


def test_what_does_not_fit_says_why_the_farthest_first(ranked):
    small = ranked["M100 + 16x10"]
    reasons = [(rating.name, leg) for leg, rating in small.exceeded]
    assert reasons == [("inertia ratio", "A"), ("inertia ratio", "B"), ("brake", "A")]
    assert_allclose(used(small, "brake")[0], 100.325, rtol=1e-5)
    assert_allclose(small.axes[0].inertia_ratio, [4.667013, 12.210864], rtol=3e-6)
    assert "load by rotor inertia above 3 (A 12.2, B 12, C 3.34, without the screw)" in small.remarks[0]
    for name, speed in (("M100 + 16x5", 116.921), ("M400 + 16x5", 140.305)):
        short = ranked[name]
        assert short.exceeded[0][1].name == "DN"
        assert not any("torque" in rating.name for _, rating in short.exceeded)
        assert_allclose(used(short, "DN")[1], 160.349, rtol=2e-5)
        assert_allclose(used(short, "nut speed")[1], 140.305, rtol=2e-5)
        assert_allclose(used(short, "speed")[1], speed, rtol=2e-5)
        assert verdict(short).startswith("does not fit: DN of A has a utilisation of 160%")


def turning(rpm, force=10.0):
    """A cycle at one speed of a screw of 5 mm."""
    still = np.full((2, 3), force), np.full((2, 3), rpm / 60 * 0.005), np.zeros((2, 3))
    return Cycle([0.0, 1.0], *still)


def rating(screw, name, rpm=5549.0):
    found = size_of(turning(rpm), Drive(Motor(1, 3, 6000 * RPM, 1e-4), screw)).axes[0].ratings
    return next((one for one in found if one.name == name), None)


def test_a_nut_of_16_mm_at_5549_rpm_is_refused_for_its_dn():
    """126.834 % of 70,000: the drive that was once said to fit."""
    one = rating(SCREWS[5], "DN")
    assert_allclose((one.required, 100 * one.share), (88784, 126.834), rtol=5e-6)
    assert rating(SCREWS[5], "nut speed").share == pytest.approx(1.1098, rel=1e-12)


def test_what_the_maker_says_of_a_nut_goes_before_what_is_assumed():
    own = {"lead": 0.005, "inertia": 0.0, "nominal_diameter": 0.02}
    assumed = rating(Screw(**own), "DN")
    assert (assumed.allowed, assumed.assumed) == (70000, "DN 70,000 (no dn of screw)")
    stated = rating(Screw(**own, dn=130_000), "DN")
    assert (stated.allowed, stated.assumed) == (130_000, "")
    assert stated.required == pytest.approx(20 * 5549, rel=1e-12)
    assert rating(Screw(**own, max_speed=700.0), "DN") is None
    assert rating(Screw(**own, max_speed=700.0), "nut speed").assumed == ""
    assert rating(Screw(**own, max_speed=math.inf), "nut speed") is None
    assert rating(Screw(**own, max_speed=700.0, dn=130_000), "DN").allowed == 130_000
    assert rating(Screw(0.005, inertia=0.0), "DN") is None  # of no diameter
    core = rating(Screw(0.005, inertia=0.0, diameter=0.01, length=0.3), "DN")
    assert core.required == pytest.approx(12.5 * 5549, rel=1e-12)
    assert core.assumed.endswith("nominal diameter of screw 5/4 of its core")
    names = {"25x10": 12.5, "8x5": 12.5, "16.5": 12.5, "16x5x300": 16, "R16x5": 16, "16 x 5": 16}
    for name, nominal in names.items():
        named = Screw(0.005, inertia=0.0, diameter=0.01, length=0.3, name=name)
        assert named.sold_diameter[0] == pytest.approx(nominal / 1e3, rel=1e-12), name


@pytest.mark.parametrize(("rpm", "expected"), [(4799, 0), (4801, 1), (6000, 1), (6001, 2)])
def test_margins_part_what_fits_from_what_has_no_reserve(rpm, expected):
    """80 % of 6000 rpm."""
    screw = Screw(0.005, inertia=0.0, max_speed=math.inf)
    found = size_of(turning(rpm), Drive(Motor(1, 3, 6000 * RPM, 1e-4), screw))
    assert found.verdict == VERDICTS[expected]
    assert found.fits == (expected == 0)
    assert found.axes[0].fits == found.fits
    assert [rating.name for _, rating in found.without_reserve] == ["speed"] * 3 * (expected == 1)
    full = size_of(turning(rpm), found.drives[0], margins=Margins.none())
    assert full.verdict == VERDICTS[2 if expected == 2 else 0]
    if expected == 1:
        assert "(80% keep the margin)" in verdict(found)
        assert verdict(found).startswith("fits without reserve: speed of A")


def test_every_rating_has_its_margin():
    """Each rating named by a field, and no other: one twenty-fifth more than its share is without reserve."""
    given = Margins(peak_torque="30 %", speed=0.1, rms_torque="25%", buckling=0.5)
    found = size_of(turning(3000), Drive(M400, SCREWS[5]), margins=given, load_mass=np.ones((2, 3)))
    shares = {one.name: one.margin for one in found.axes[0].ratings}
    assert {name: value for name, value in shares.items() if value} == {
        "peak torque": 0.3, "rms torque": 0.25, "speed": 0.1, "heating": 0.36, "buckling": 0.5,
    }  # fmt: skip
    assert all(hasattr(given, name.replace(" ", "_")) for name in shares)
    limits = {one.name: one.limit / one.allowed for one in found.axes[0].ratings}
    assert limits["peak torque"] == pytest.approx(0.7, rel=1e-15)


OF_STOPS = {"brake energy of a stop"}  # the energy that the maker allows has its own safety


def test_every_name_of_a_rating_in_the_source_has_a_margin():
    """A rating without a field would have no margin, and none could be asked for."""
    folder = Path(margins.__file__).parent
    source = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.py"))
    names = {*re.findall(r'Rating\(\s*"([^"]+)"', source), "rack speed", "rack force", "belt force"}
    assert {"speed", "line power", "life"} <= names
    fields = {name.replace("_", " ") for name in Margins.__annotations__}
    assert names - OF_STOPS <= fields


def test_ratings_of_speed_are_those_that_designs_by_tasks_count():
    screw = Screw(0.01, inertia=0.0, nominal_diameter=0.016, diameter=0.013, length=0.8, ends="fixed-free")
    slow = Belt(0.05, max_speed=50.0), Rack(0.05, max_speed=50.0), screw, replace(screw, max_speed=100.0)
    drives = [Drive(M400, one, Gear(2.0, max_speed=300.0)) for one in slow]
    names = {one.name for drive in drives for one in speed_ratings(drive, 100.0)}
    assert names == set(task_measures._OF_SPEED)


# --- heat and height --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("temperature", "altitude", "rise", "rated_at", "torque", "left"),
    [
        (47.5, 1650, 100, 40, 1, 0.927362),
        (50, 2200, 100, 40, 1, 0.883176),
        (65, 0, 100, 40, 24.8, 21.47743),  # Machine Design
        (55, 0, 105, 25, 1, 0.845154),  # Exlar
        (40, 1000, 100, 40, 1, 1),
    ],
)
def test_heat_and_height_take_their_share(temperature, altitude, rise, rated_at, torque, left):
    assert_allclose(torque * Ambient(temperature, altitude).heat_share(rise, rated_at), left, rtol=5e-7)


def test_of_the_ways_to_derate_at_speed_the_least_counts():
    """T_c = .6 T_0, x = .9: .54 by the share, .5 by the shift, .412311 by the losses of one body."""
    motor = Motor(1.0, 3.0, 400.0, 1e-4, curve=[[0, 1, 3], [400, 0.6, 2]])
    assert_allclose(motor.continuous(np.array([400.0]), 0.9), 0.412311, rtol=2e-6)
    assert_allclose(motor.continuous(np.array([0.0]), 0.9), 0.9, rtol=1e-15)
    flat = Motor(1.0, 3.0, 400.0, 1e-4, rated_speed=300.0)  # falls to 0.75 from 300 to 400
    at = np.array([280.0])  # the shrunk curve is at 280 / 0.9 there, beyond its corner
    shrunk = 0.9 * (1 - 0.25 * (280 / 0.9 - 300) / 100)
    assert_allclose(flat.continuous(at, 0.9), shrunk, rtol=1e-14)
    assert flat.continuous(at, 1.0) == flat.continuous(at)


def test_a_warm_and_high_place_is_in_the_ratings_and_told():
    place = Ambient(50, 2200)
    drive = Drive(M400, SCREWS[10])
    cool, warm = (size_of(turning(300, 100.0), drive, ambient=each) for each in (None, place))
    pair = [{one.name: one for one in sizing.axes[0].ratings} for sizing in (cool, warm)]
    x = 0.883176
    rms = pair[0]["rms torque"].required
    assert_allclose(pair[1]["rms torque"].allowed, 1.3 * x, rtol=1e-6)
    assert_allclose(pair[1]["heating"].required, (rms / 1.3 / x) ** 2, rtol=2e-6)
    assert_allclose([warm.axes[1].heat_share, cool.axes[1].heat_share], [x, 1], rtol=1e-6)
    assert pair[1]["peak torque"] == pair[0]["peak torque"]  # a moment does not warm it
    assert "2200 m: above 2000 m makers derate them" in place.warnings[0]
    assert Ambient().warnings == ()
    assert size_of(turning(300, 100.0), drive, ambient=Ambient(10.0)).axes[0].rms_torque == rms
    assert M400.heat_share(Ambient(10.0)) == 1


def test_a_maker_s_own_table_goes_first():
    motor = Motor(
        1.0,
        3.0,
        400.0,
        1e-4,
        derating_temperature=[[40, 1], [50, 0.8]],
        derating_altitude=[[1000, 1], [3000, 0.9]],
    )
    assert motor.heat_share(Ambient(45, 2000)) == pytest.approx(0.9 * 0.95, rel=1e-14)
    assert motor.heat_share(Ambient(90, 500)) == pytest.approx(0.8, rel=1e-14)


def test_what_a_maker_has_no_table_of_is_by_the_heat_of_one_body():
    of_height = Motor(1.0, 3.0, 400.0, 1e-4, derating_altitude=[[1000, 1], [3000, 0.9]])
    of_heat = Motor(1.0, 3.0, 400.0, 1e-4, derating_temperature=[[40, 1], [50, 0.8]])
    assert of_height.heat_share(Ambient(60, 2000)) == pytest.approx(0.95 * math.sqrt(0.8), rel=1e-14)
    assert of_heat.heat_share(Ambient(45, 3000)) == pytest.approx(0.9 * math.sqrt(0.8), rel=1e-14)
    assert of_height.heat_share(Ambient(20, 0)) == of_heat.heat_share(Ambient(20, 0)) == 1.0


def test_the_assessment_tells_margins_place_and_what_is_assumed():
    robot = p3dof.load()
    result = robot.inverse_dynamics(p3dof.paper_motion(101), method="compiled")
    found = p3dof.assess(robot, result, drives=Drive(M400, SCREWS[10]), ambient=Ambient(50, 2200))
    told = p3dof.design.assessment.assumptions(found)
    assert told["margins"].startswith("20% of peak torque, rms torque, speed; 36% of heating; ")
    assert told["ambient"].startswith("50 °C, 2200 m; ")
    assert "M400 0.883" in told["ambient"]
    assert any(one.startswith("assumed: ") for one in found.warnings)
    assert any("above 2000 m" in one for one in found.warnings)
    tight = p3dof.assess(
        robot,
        result,
        drives=Drive(Motor(9, 30, 7000 * RPM, 1e-3), Screw(0.01, inertia=0.0, max_speed=math.inf)),
    )
    assert tight.verdict.startswith("fits without reserve: speed of C has a utilisation of 95%")
    assert "80% keep the margin" in tight.verdict
    assert any(one.startswith("without reserve: speed of C 95%") for one in tight.warnings)


def test_margins_and_place_of_a_catalogue_count_unless_others_are_given():
    robot = p3dof.load()
    result = robot.inverse_dynamics(p3dof.paper_motion(101), method="compiled")
    given = Catalogue([M400], [SCREWS[10]], margins=Margins(speed=0.45), ambient=Ambient(50, 2200))
    (sizing,) = p3dof.size_drives(robot, result, given)
    assert {one.margin for one in sizing.axes[0].ratings if one.name == "speed"} == {0.45}
    assert sizing.axes[0].heat_share == M400.heat_share(Ambient(50, 2200))
    assert p3dof.assess(robot, result, drives=given).ambient == Ambient(50, 2200)
    (other,) = p3dof.size_drives(robot, result, given, margins=Margins(), ambient=Ambient())
    assert {one.margin for one in other.axes[0].ratings if one.name == "speed"} == {0.2}
    assert other.axes[0].heat_share == 1


# --- bad input --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Margins(speed=1.0), "margins: speed: expected less than 1, got 1: a margin is a share"),
        (lambda: Margins(speed=20), "expected less than 1, got 20"),
        (lambda: Margins(speed=-0.1), "margins: speed: expected"),
        (lambda: Margins(speed="much"), "expected a share such as 0.2 or '20 %', got 'much'"),
        (lambda: Margins(speed="20 %%"), "expected a share such as 0.2 or '20 %', got '20 %%'"),
        (lambda: margins_of({"spede": 0.1}), "unknown margin 'spede'.*did you mean 'speed'"),
        (lambda: margins_of({"speed": 2}, "drives.yaml: margins"), "^drives.yaml: margins: speed: expected"),
        (lambda: Ambient(313.15), "temperature: expected -60 to 150 °C, got 313.15 °C"),
        (lambda: Ambient(20, 12000), "altitude: expected -500 to 9000 m"),
        (lambda: Motor(1, 3, 400, 1e-4, temperature_rise=0), "temperature_rise: expected a number above"),
        (lambda: Motor(1, 3, 400, 1e-4, rated_ambient=500), "temperature: expected -60"),
        (lambda: Motor(1, 3, 400, 1e-4, derating_temperature=[[50, 1], [40, 2]]), "rows of a rising value"),
        (lambda: Motor(1, 3, 400, 1e-4, derating_altitude=[]), "derating_altitude"),
        (lambda: Motor(1, 3, 400, 1e-4, derating_altitude=[[0, -1]]), "rows of a rising value"),
        (lambda: Screw(0.005, inertia=0, dn=0), "dn: expected a number above zero"),
        (lambda: Screw(0.005, diameter=0.02, length=1, nominal_diameter=0.016), "at least that of the core"),
        (lambda: size_of(turning(9), Drive(M400, SCREWS[5]), margins=0.2), "margins: expected a Margins"),
        (lambda: size_of(turning(9), Drive(M400, SCREWS[5]), ambient=40), "ambient: expected an Ambient"),
    ],
)  # fmt: skip
def test_bad_input_is_one_clear_line(call, words):
    with pytest.raises(DriveError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
