"""Lives of bearings and guides, buckling of rods: published rules, hand calculations, every bad input."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from lagrange import BODIES, LagrangeModel
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from table_numbers import check_table, shows

import p3dof
from p3dof._base.errors import InputError, ParameterError, SampleError
from p3dof.analysis.reactions import JOINTS, Misfit, RodSection, Stiffness
from p3dof.cli import main
from p3dof.design.bearings import (
    Bearing,
    Bearings,
    Guide,
    advice_table,
    bearing_life,
    bearings_table,
    guides_table,
    read_bearings,
    rods_table,
)
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import PAPER, Body

BALL = Bearing(dynamic=3000.0, static=2400.0, name="6001")
GUIDE = Guide(dynamic=10e3, basis=50e3, moments=(120.0, 120.0, 150.0), static=16e3)


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def elastic(robot):
    return robot.reactions(paper_motion(1001), "elastic")


@pytest.fixture(scope="module")
def report(elastic):
    return bearing_life(PAPER, elastic, Bearings(BALL, GUIDE))


# Computed by another route, with Simpson's rule: mean load [N], revolutions a cycle, L10 [Mrev].
LIVES = {
    "hinge_a": (71.3574, 0.060332, 74310),
    "hinge_left": (75.7945, 0.053918, 62008),
    "hinge_c": (53.3981, 0.027683, 177332),
    "hinge_b": (44.3666, 0.056359, 309168),
    "hinge_platform": (30.7977, 0.508944, 924288),
}
AXIAL = {
    "hinge_a": 84.9477,
    "hinge_left": 80.9231,
    "hinge_c": 59.4974,
    "hinge_b": 55.0559,
    "hinge_platform": 34.9829,
}
SHARES = {"slide_a": 0.8826, "slide_b": 0.8863, "slide_c": 0.8706}  # in the mean over the motion
GUIDES = {
    "slide_a": (393.425, 0.205456, 821076),
    "slide_b": (364.044, 0.103819, 1036360),
    "slide_c": (462.704, 0.358641, 504732),
}


def test_lives_of_bearings(report, elastic):
    found = {one.joint: one for one in report.bearings}
    assert len(found) == 10
    for joint, (load, turns, life) in LIVES.items():
        one = found[joint]
        assert one.mean_load == pytest.approx(load, rel=4e-5)
        assert one.revolutions == pytest.approx(turns, rel=2e-5)
        assert one.life / 1e6 == pytest.approx(life, rel=1.2e-4)
        assert one.hours == pytest.approx(one.life / one.revolutions / 3600, rel=1e-12)
        assert one.oscillates
    swings = {"hinge_a": 10.9, "hinge_b": 10.1, "hinge_c": 1.5, "hinge_left": 9.7, "hinge_platform": 46.0}
    for joint, swing in swings.items():
        assert math.degrees(found[joint].swing) == pytest.approx(swing, abs=0.06)
    assert found["loop_a"].revolutions == pytest.approx(found["hinge_a"].revolutions, rel=1e-12)
    assert found["hinge_left"].static_safety == pytest.approx(2400 / 139.096, rel=1e-5)
    thrust = bearing_life(PAPER, elastic, Bearings(replace(BALL, Y=1.5)))
    for one in thrust.bearings:
        if one.joint in AXIAL:
            assert one.mean_load == pytest.approx(AXIAL[one.joint], rel=4e-5)


def test_lives_of_guides(report):
    for one in report.guides:
        load, way, life = GUIDES[one.joint]
        assert one.mean_load == pytest.approx(load, rel=4e-5)
        assert one.way == pytest.approx(way, rel=2e-5)
        assert one.life / 1e3 == pytest.approx(life, rel=1.2e-4)
        assert one.moment_share == pytest.approx(SHARES[one.joint], abs=5e-4)
    assert "two carriages on each rail" in " ".join(report.warnings)


def test_what_misfits_add_is_told(robot):
    stiffness = Stiffness(misfit=Misfit(20e-6, 1e-4))
    reactions = robot.reactions(paper_motion(21), "elastic", stiffness=stiffness)
    report = bearing_life(PAPER, reactions, Bearings(BALL, GUIDE), stiffness=stiffness)
    (told,) = (words for words in report.warnings if "assembly errors" in words)
    most = np.linalg.norm(reactions["hinge_lower"].fit[:, 0][:, [0, 2]], axis=-1).max()
    assert f"hinge_lower {most:.3g} N" in told
    for share, count in ((1.0, 4), (0.75, 2)):  # those above a twentieth of the load, the largest first
        stiffness = Stiffness(misfit=Misfit(share * 20e-6, share * 1e-4))
        reactions = robot.reactions(paper_motion(21), "elastic", stiffness=stiffness)
        report = bearing_life(PAPER, reactions, Bearings(BALL), stiffness=stiffness)
        peaks = {one.joint: one.peak_load for one in report.bearings}
        added = {name: np.hypot(*reactions[name].fit[:, 0][:, [0, 2]].T).max() for name in peaks}
        order = sorted(added, key=added.get, reverse=True)
        much = [f"{name} {added[name]:.3g} N" for name in order if added[name] > peaks[name] / 20]
        (told,) = (words for words in report.warnings if "assembly errors" in words)
        assert told.startswith(f"assembly errors add up to {', '.join(much)} across")
        assert len(much) == count
    plain = bearing_life(PAPER, robot.reactions(paper_motion(21), "elastic"), Bearings(BALL))
    assert not any("assembly errors" in words for words in plain.warnings)


def test_static_loads_are_those_of_iso_76(elastic):
    """P0 = 0.6 Fr + 0.5 Fa of ball bearings, 1 Fr of rollers, at least Fr; or by factors of the maker."""
    radial, axial = np.array([100.0, 100.0, 10.0]), np.array([10.0, 200.0, 0.0])
    assert BALL.static_equivalent(radial, axial).tolist() == [100.0, 160.0, 10.0]
    roller = Bearing(3000.0, kind="roller")
    assert roller.static_equivalent(radial, axial).tolist() == [100.0, 100.0, 10.0]
    assert replace(BALL, X0=0.5, Y0=0.26).static_equivalent(radial, axial).tolist() == [100.0, 102.0, 10.0]
    assert replace(BALL, X0=0, Y0=1).static_equivalent(radial, axial).tolist() == [100.0, 200.0, 10.0]
    thrust = replace(BALL, X=0.56, Y=1.6, e=0.1, Y0=3.0)
    (one,) = bearing_life(PAPER, elastic, Bearings(joints={"hinge_a": thrust})).bearings
    forces = elastic["hinge_a"].forces
    radial, axial = np.hypot(forces[:, 0], forces[:, 2]), np.abs(forces[:, 1])
    static = np.maximum(radial, 0.6 * radial + 3 * axial)
    assert one.static_load == static.max()
    assert one.static_time == elastic.time[static.argmax()]
    assert one.static_safety == pytest.approx(2400 / static.max(), rel=1e-14)
    assert one.peak_load != one.static_load


def test_rods(report):
    rods = {rod.rod: rod for rod in report.rods}
    assert rods["rod_right"].compression == pytest.approx(90.9261, abs=1e-3)
    assert rods["rod_left"].tension == pytest.approx(139.0936, abs=1e-3)
    assert rods["leg_a"].compression == 0
    assert rods["leg_a"].buckling_safety == math.inf
    assert "none" in str(rods_table(report).rows)
    for rod in rods.values():
        assert rod.buckling == pytest.approx(101739, rel=1e-5)
        assert rod.frequency == pytest.approx(254.69, rel=5e-5)


ENDS = {
    "leg_a": ("hinge_a", "loop_a"),
    "leg_b": ("hinge_b", "loop_b"),
    "rod_left": ("hinge_left", "hinge_lower"),
    "rod_right": ("hinge_right", "loop_c"),
}


@pytest.mark.parametrize(("up", "side", "end"), [(-1, 1, 1), (-1, -1, 1), (1, 1, 0)])
def test_rods_bear_along_themselves_at_both_ends(up, side, end):
    """Both rods in compression, whichever end decides: with the paper's motion, mirrored, gravity upward."""
    machine, papers = replace(PAPER, gravity=[0.6, -0.4, up * 9.81]), paper_motion(101)
    mirror = [np.array(part) * [side, 1, 1] for part in (papers.pose, papers.velocity, papers.acceleration)]
    reactions = p3dof.load(machine).reactions(Motion(papers.time, *mirror), "elastic")
    axes = LagrangeModel(machine).orientations(mirror[0])[..., 0]  # of each body, from above to below
    forces, _ = reactions.in_base()
    found = {rod.rod: rod for rod in bearing_life(machine, reactions, Bearings(BALL)).rods}
    assert found.keys() == ENDS.keys()
    for name, rod in found.items():
        ends = [forces[:, reactions.joints.index(end)] for end in ENDS[name]]
        thrust = np.array([(end * axes[:, BODIES.index(name)]).sum(axis=1) for end in ends])
        most, at = np.unravel_index(thrust.argmax(), thrust.shape)
        assert rod.compression == pytest.approx(max(thrust.max(), 0), rel=1e-12)
        assert rod.tension == pytest.approx(max(-thrust.min(), 0), rel=1e-12)
        if thrust.max() > 0:
            assert rod.compression_time == papers.time[at]
            assert rod.buckling_safety == pytest.approx(rod.buckling / thrust.max(), rel=1e-12)
        if name.startswith("rod"):
            assert rod.compression > 0
            assert most == end


def test_rods_bend_with_the_section_of_the_file_and_the_mass_of_the_leg(elastic):
    """A tube, say: of other mass than a solid steel rod of its diameter."""
    light = replace(PAPER.bodies.leg_a, mass=0.4)
    machine = replace(PAPER, bodies=replace(PAPER.bodies, leg_a=light))
    section = RodSection(diameter=0.03, young=70e9)
    rods = bearing_life(machine, elastic, Bearings(hinges=BALL), stiffness=Stiffness(rods=section))
    stiff, length = 70e9 * math.pi * 0.03**4 / 64, PAPER.geometry.L
    for name, mass in (("leg_a", 0.4), ("leg_b", PAPER.bodies.leg_b.mass)):
        (rod,) = (one for one in rods.rods if one.rod == name)
        omega = (math.pi / length) ** 2 * math.sqrt(stiff / (mass / length))  # of a hinged beam, m per length
        assert rod.frequency == pytest.approx(omega / (2 * math.pi), rel=1e-14)
        assert rod.buckling == pytest.approx(math.pi**2 * stiff / length**2, rel=1e-14)
    assert "the mass as the parameters have it" in rods_table(rods).note


def test_a_constant_load_lives_as_the_standard_says():
    """(C / P)^p million revolutions, and the basis times (C / P)^p, of one load; factors beyond e."""
    assert BALL.equivalent(np.array([3.0, 4.0]), np.array([5.0, 0.0])).tolist() == [3.0, 4.0]
    both = replace(BALL, X=0.56, Y=1.6, e=0.27)
    np.testing.assert_allclose(
        both.equivalent(np.array([100.0, 100.0]), np.array([26.0, 28.0])), [100.0, 56 + 44.8], rtol=1e-14
    )
    assert replace(BALL, kind="roller").exponent == pytest.approx(10 / 3)
    forces, moments = GUIDE.parts(np.array([[3.0, -4.0, 99.0]]), np.array([[1.2, -2.4, 3.0]]))
    assert forces.tolist() == [[7.0]]
    np.testing.assert_allclose(moments, [[1.2 / 120 * 1e4 + 2.4 / 120 * 1e4 + 3 / 150 * 1e4]], rtol=1e-14)
    above = replace(GUIDE, centre=(0.0, 0.0, 0.1))  # 4 N across turn it by 0.4 N m
    _, moments = above.parts(np.array([[0.0, 4.0, 0.0]]), np.array([[0.4, 0.0, 0.0]]))
    turned = 0.4 + 0.1 * 4.0
    np.testing.assert_allclose(moments, [[turned / 120 * 1e4]], rtol=1e-14)


def test_a_rail_that_is_mounted_otherwise(elastic):
    """A quarter turn exchanges x and y; any turn is that of forces and moments the other way about."""
    uneven = replace(GUIDE, moments=(100.0, 60.0, 150.0), centre=(0.01, -0.02, 0.03))
    forces, moments = elastic["slide_c"].forces, elastic["slide_c"].moments
    quarter = replace(uneven, turn=math.pi / 2)
    swapped = replace(uneven, moments=(60.0, 100.0, 150.0))
    for one, other in zip(quarter.parts(forces, moments), swapped.parts(forces, moments), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    c, s = math.cos(0.3), math.sin(0.3)
    back = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    turned = replace(uneven, centre=tuple(back @ uneven.centre))
    expected = turned.parts(forces @ back.T, moments @ back.T)
    for one, other in zip(replace(uneven, turn=0.3).parts(forces, moments), expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    assert np.abs(expected[1] - uneven.parts(forces, moments)[1]).max() > 10


ROLLER = Bearing(180.0, 4100.0, kind="roller", X=0.4, Y=1.6, e=0.3, name="NU 3")
OFFSET = Guide(240.0, 100e3, (2.7, 2.1, 3.3), static=15e3, centre=(0.01, -0.02, 0.03), turn=0.4, name="HG 15")
PARTS = Bearings(
    replace(BALL, Y=1.2, name="6001"), GUIDE, {"hinge_left": ROLLER, "slide_b": OFFSET, "hinge_c": BALL}
)


def rates_by_hand(machine, motion):
    """How fast each joint turns about its axis, or slides, from Lagrange's spins and axes."""
    model = LagrangeModel(machine)
    spins = model.angular_velocities(motion.pose, motion.velocity)
    axes = model.orientations(motion.pose)[..., 1]
    axes[:, BODIES.index("crossbar_lower")] = axes[:, BODIES.index("rod_left")]  # where the rods are hinged
    sliders = model.slider_velocities(motion.pose, motion.velocity)
    found = {f"slide_{leg}": sliders[:, k] for k, leg in enumerate("abc")}
    for joint in JOINTS:
        one, other = (
            BODIES.index(link) if link in BODIES else -1 for link in (joint.predecessor, joint.successor)
        )
        axis = axes[:, one if joint.name.startswith("loop") else other]
        turning = spins[:, other] - (spins[:, one] if one >= 0 else 0)
        found.setdefault(joint.name, (turning * axis).sum(axis=1))
    return found


@shows(
    "p3dof.design.bearings.evaluation.bearings_table",
    "p3dof.design.bearings.evaluation.guides_table",
    "p3dof.design.bearings.evaluation.rods_table",
)
def test_every_number_of_the_tables_of_bearings(robot):
    """ISO 281, 76 and 14728-1 and hinged beams, trapezoid by trapezoid, of unlike parts and uneven times."""
    papers, rows = paper_motion(41), [0, 1, 4, 9, 10, 17, 26, 30, 39, 40]
    states = [np.array(part)[rows] for part in (papers.pose, papers.velocity, papers.acceleration)]
    motion = Motion(1.25 * papers.time[rows] + 2.0, *states, check=False)
    soft = Stiffness(rods=RodSection(diameter=0.018, young=195e9))
    reactions = robot.reactions(motion, "elastic", stiffness=soft)
    report = bearing_life(PAPER, reactions, PARTS, stiffness=soft, rest=0.7)
    step, rates = np.diff(motion.time), rates_by_hand(PAPER, motion)

    def integral(values):
        return (step * (values[1:] + values[:-1]) / 2).sum()

    def lives(load, rate, exponent, per):
        """Mean load, largest load and when, way, and how often it is gone on a rating of 1 for `per`."""
        way = integral(np.abs(rate))
        mean = (integral(load**exponent * np.abs(rate)) / way) ** (1 / exponent)
        cycles = per / way * mean**-exponent
        return (mean, load.max(), motion.time[load.argmax()]), way, cycles

    bearings, guides = {}, {}
    for joint in reactions.joints:
        part, rate = PARTS.of(joint), rates[joint]
        f, m = reactions[joint].forces, reactions[joint].moments
        if isinstance(part, Guide):
            c, s = np.cos(part.turn), np.sin(part.turn)
            rail = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            f = f * [1, 1, 0]
            about = (m - np.cross(part.centre, f)) @ rail.T
            turning = (np.abs(about) / part.moments).sum(axis=1) * part.dynamic
            load = np.abs(f @ rail.T).sum(axis=1) + turning
            loads, way, cycles = lives(load / part.dynamic, rate, 3, part.basis)
            loads = part.dynamic * loads[0], part.dynamic * loads[1], loads[2]
            share = integral(turning / load) / step.sum()
            hours = cycles * 1.95 / 3600
            life = (cycles * way / 1e3, (hours if hours < 1e5 else (">", 1e5)), part.static / loads[1])
            guides[joint] = (part.name, *loads, f"near {loads[2]:g}", (share,), way, *life)
            continue
        radial, axial = np.hypot(f[:, 0], f[:, 2]), np.abs(f[:, 1])
        load = np.where(axial > part.e * radial, part.X * radial + part.Y * axial, radial)
        x0, y0 = (0.6, 0.5) if part.kind == "ball" else (1, 0)
        static = np.maximum(radial, x0 * radial + y0 * axial)
        exponent = 3 if part.kind == "ball" else 10 / 3
        loads, angle, cycles = lives(load / part.dynamic, rate, exponent, 2e6 * np.pi)
        loads = part.dynamic * loads[0], part.dynamic * loads[1], loads[2]
        way = np.cumsum(np.r_[0, step * (rate[1:] + rate[:-1]) / 2])
        hours, turns = cycles * 1.95 / 3600, angle / (2 * np.pi)
        life = (cycles * turns / 1e6, (hours if hours < 1e5 else (">", 1e5)), part.static / static.max())
        swing = np.degrees(way.max() - way.min())
        bearings[joint] = (part.name, *loads, f"near {loads[2]:g}", swing, turns, *life)
    order = [one.joint for one in report.bearings]
    place = "near {:g}".format
    check_table(bearings_table(report, place), {joint: bearings[joint] for joint in order}, note=[1.95, 281])
    check_table(guides_table(report, place), guides, note=[14728, 1])
    assert set(bearings) == set(order)
    rods = {}
    length = PAPER.geometry.L
    for name, ends in ENDS.items():
        axes = LagrangeModel(PAPER).orientations(motion.pose)[:, BODIES.index(name), :, 0]
        forces = reactions.in_base()[0]
        thrust = np.array([(forces[:, reactions.joints.index(end)] * axes).sum(axis=1) for end in ends])
        most, least = thrust.max(), thrust.min()
        when = motion.time[thrust.argmax() % len(motion)]
        mass = getattr(PAPER.bodies, name).mass
        stiff = 195e9 * np.pi * 0.018**4 / 64
        buckling = np.pi**2 * stiff / length**2
        hertz = np.pi / 2 / length**2 * np.sqrt(stiff / (mass / length))
        pushed = (most, when) if most > 0 else ("none", np.nan)
        safety = buckling / most if most > 0 else "no load"
        rods[name] = (*pushed, -least if least < 0 else "none", buckling, safety, hertz)
    check_table(rods_table(report), rods)


def test_what_no_paper_tells_stands_beside_the_loads(report):
    assert "width b of the parallelogram" in rods_table(report).note
    assert "width b of the parallelogram" in report._repr_html_()


def test_rest_and_standing_still(robot, elastic):
    one = bearing_life(PAPER, elastic, Bearings(BALL), rest=1.0)
    other = bearing_life(PAPER, elastic, Bearings(BALL))
    assert one.cycle == 2.0
    assert one.bearings[0].hours == pytest.approx(2 * other.bearings[0].hours, rel=1e-12)
    still = Motion(np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))
    report = bearing_life(PAPER, robot.reactions(still, "elastic"), Bearings(BALL, GUIDE))
    for life in (*report.bearings, *report.guides):
        assert life.life == life.hours == math.inf
        assert math.isnan(life.mean_load)
        assert (life.way if hasattr(life, "way") else life.revolutions) == 0
    assert "–" in str(bearings_table(report).rows)


def test_warnings_come_first_for_what_breaks(robot):
    heavy = PAPER.carrying(Body(400.0, np.array([0.1, 0.1, 0]), np.zeros(3)))
    reactions = p3dof.load(heavy).reactions(paper_motion(21), "elastic")
    soft = Stiffness(rods=replace(Stiffness().rods, diameter=0.004))
    report = bearing_life(heavy, reactions, Bearings(BALL), stiffness=soft)
    assert report.warnings[0].startswith("leg_a buckles at") or "buckles at" in report.warnings[0]
    assert any("static safety" in words for words in report.warnings)
    unsafe = [rod for rod in report.rods if rod.buckling_safety < 4]
    assert 0 < len(unsafe) < 4
    for rod, words in zip(unsafe, report.warnings, strict=False):
        assert words.startswith(f"{rod.rod} buckles at {rod.buckling:.4g} N, {rod.buckling_safety:.2g} times")
        assert words.endswith(" its compression; 4 times are usual")
    assert sum("buckles" in words for words in report.warnings) == len(unsafe)
    weak = [words for words in report.warnings if "static safety" in words]
    assert all(words.endswith(" s, less than 2") for words in weak)
    assert [words.split(":")[0] for words in weak] == [
        one.joint for one in report.bearings if one.static_safety < 2
    ]
    html = report._repr_html_()
    assert "buckles" in html
    assert "Bearings" in html
    assert (
        bearing_life(
            PAPER, robot.reactions(paper_motion(5), "elastic"), Bearings(BALL), stiffness=Stiffness(rods=None)
        ).rods
        == ()
    )


def test_two_carriages_are_recommended_where_moments_are_half_of_the_load(elastic):
    """However small the load: shares do not depend on its size."""

    def guided(size, reactions=elastic):
        guide = replace(GUIDE, moments=[size * moment for moment in GUIDE.moments])
        return bearing_life(
            PAPER, reactions, Bearings(joints={"slide_a": guide}), stiffness=Stiffness(rods=None)
        )

    def share(size):
        return guided(size).guides[0].moment_share

    for wanted in (0.502, 0.498):
        size = brentq(lambda size, wanted=wanted: share(size) - wanted, 1, 100, xtol=1e-9)
        told = [words for words in guided(size).warnings if "two carriages" in words]
        assert len(told) == (wanted > 0.5)
    light = replace(elastic, forces=1e-4 * elastic.forces, moments=1e-4 * elastic.moments)
    assert guided(1, light).guides[0].moment_share == pytest.approx(share(1), rel=1e-12)


def test_bad_arguments(robot, elastic):
    with pytest.raises(InputError, match="leaves loads of the bearings undetermined; ask for 'elastic'"):
        bearing_life(PAPER, robot.reactions(paper_motion(5), "paper"), Bearings(BALL))
    assert bearing_life(PAPER, robot.reactions(paper_motion(5)), Bearings(BALL)).bearings
    with pytest.raises(InputError, match="reactions: expected Reactions, got 3"):
        bearing_life(PAPER, 3, Bearings(BALL))
    with pytest.raises(InputError, match="bearings: expected Bearings"):
        bearing_life(PAPER, elastic, BALL)
    with pytest.raises(InputError, match="rest: expected zero or more"):
        bearing_life(PAPER, elastic, Bearings(BALL), rest=-1)
    with pytest.raises(SampleError, match="a life needs a motion"):
        bearing_life(PAPER, robot.reactions(paper_motion(5)[:1], "elastic"), Bearings(BALL))
    with pytest.raises(ParameterError, match="expected hinges, guides or joints, got none"):
        Bearings()
    with pytest.raises(ParameterError, match="joints: slide_a: expected a Guide"):
        Bearings(joints={"slide_a": BALL})
    with pytest.raises(ParameterError, match=r"joints: expected names of slide_a, .*'elbow'"):
        Bearings(joints={"elbow": BALL})
    with pytest.raises(ParameterError, match="moments: expected three positive"):
        replace(GUIDE, moments=(1.0, 0.0, 1.0))
    assert replace(GUIDE, moments=[0.2, 0.1, 0.3]).moments == (0.2, 0.1, 0.3)  # of a small carriage
    assert Bearing(0.5, 0.4).dynamic == 0.5
    with pytest.raises(ParameterError, match="guides: expected a Guide"):
        Bearings(guides=BALL)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("guides: {dynamic: 10 kN, moments: [1, 1, 1]}\n", "guides: the field 'basis' is missing"),
        ("guides: {dynamic: 10 kN, basis: 70 km, moments: [1, 1, 1]}\n", "basis: expected 50 km or 100 km"),
        ("guides: {dynamic: 10 kN, basis: 50 km}\n", "guides: the field 'moments' is missing"),
        ("guides: {dynamic: 10 kN, basis: 50 km, moments: [1, 0, 1]}\n", "moments: expected three positive"),
        ("hinges: {static: 1 kN}\n", "hinges: the field 'dynamic' is missing"),
        ("hinges: {dynamic: 3 mm}\n", "hinges.dynamic: expected a force"),
        ("hinges: {dynamic: 3 kN, kind: needle}\n", "kind: expected ball or roller"),
        ("hinges: {dynamic: 3 kN, kind: [ball]}\n", "kind: expected ball or roller, got a list"),
        ("hinges: {dynamic: 3 kN, Y: -1}\n", "Y: expected zero or more"),
        ("joints: {elbow: {dynamic: 3 kN}}\n", "joints: unknown field 'elbow'"),
        ("{}\n", "expected hinges, guides or joints"),
    ],
)
def test_a_wrong_file(tmp_path, capsys, text, told):
    path = tmp_path / "b.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError, match=told):
        read_bearings(path)
    assert main(["bearings", str(path), "--samples", "5"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("p3dof: error: ")
    assert "b.yaml" in error


def test_the_command(tmp_path, capsys):
    path = tmp_path / "b.yaml"
    path.write_text(
        "hinges: {name: 6001, dynamic: 3 kN}\n"
        "guides: {dynamic: 10 kN, basis: 50 km, moments: [120 Nm, 120 Nm, 150 Nm]}\n"
        "joints: {hinge_left: {name: needle, dynamic: 6 kN, static: 7 kN, kind: roller}}\n",
        encoding="utf-8",
    )
    read = read_bearings(path)
    assert read.of("hinge_left") == Bearing(6e3, 7e3, "roller", name="needle")
    assert read.of("hinge_a") == Bearing(3e3, name="6001")
    assert read.of("slide_b").moments == (120.0, 120.0, 150.0)
    assert main(["bearings", str(path), "--samples", "201", "--rest", "0.5"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for words in (
        "false brinelling",
        "needle",
        "no prediction",
        "1.5 s",
        "rod_right",
        "which the paper does not give",
    ):
        assert words in shown
    assert guides_table(bearing_life(PAPER, p3dof.load().reactions(paper_motion(5)), read)).rows


@shows("p3dof.design.bearings.evaluation.advice_table")
def test_what_to_do_is_told_of_each_hinge_that_swings_a_little_and_each_guide_with_moments():
    """Swings by the relative rotations of Lagrange's bodies; shares of moments by their definition."""
    motion, ball, ratings = paper_motion(401), Bearing(5100.0), np.array([120.0, 120.0, 150.0])
    guide = Guide(1e4, 50e3, tuple(ratings))
    part = Bearings(joints={"hinge_a": ball, "hinge_b": ball, "slide_c": guide})
    reactions = p3dof.load().reactions(motion, "elastic")
    axes, rows = LagrangeModel(PAPER).orientations(motion.pose), {}
    for joint in JOINTS:
        if joint.name in ("hinge_a", "hinge_b"):
            body = axes[:, BODIES.index(joint.successor)]
            below = axes[:, BODIES.index(joint.predecessor)]
            turned = np.swapaxes(below, 1, 2) @ body
            apart = Rotation.from_matrix(turned[0].T @ turned).as_rotvec()
            swing = np.degrees(np.ptp(apart @ apart[200] / np.linalg.norm(apart[200])))
            what = "a full turn now and then" if swing > 30 else "a plain or needle bearing"
            rows[joint.name] = (f"swings {swing:.3g}°: false brinelling", what, "grease against fretting")
    joint = reactions["slide_c"]
    force = np.abs(joint.forces[:, :2]).sum(axis=1)
    moment = (np.abs(joint.moments) * 1e4 / ratings).sum(axis=1)
    share = np.trapezoid(moment / (force + moment), reactions.time) / np.ptp(reactions.time)
    words = f"{share:.0%} of its load from moments", "two carriages on the rail", "a wider rail"
    check_table(advice_table(bearing_life(PAPER, reactions, part)), rows | {"slide_c": words})
    two = Bearings(guides=replace(guide, distance=0.12))
    assert not advice_table(bearing_life(PAPER, reactions, two)).rows
