"""Whether a machine fits a task: the verdict, its ratings with time and place, and the engineer's report."""

from __future__ import annotations

import dataclasses
import html
import math
import re
import shlex
import shutil
import subprocess

import numpy as np
import pytest
from browser import find_chromium

import p3dof
from p3dof import report
from p3dof._base.errors import DriveError, InputError, SampleError
from p3dof.cli import main
from p3dof.design.assessment import assumptions, loads_table, needs_table, uses_table
from p3dof.design.bearings import Bearing, Bearings, Guide, bearing_life
from p3dof.design.drives import Catalogue, Motor, Screw, cycle_of, size_of
from p3dof.design.forces_of_tasks import joined, without_jumps
from p3dof.machine.parameters import Friction
from p3dof.report import plots
from p3dof.report.assessment import AssessmentPictures
from p3dof.report.templates import Picture

RPM = math.pi / 30
LOAD = p3dof.machine.Body(2.0, np.array([0, 0, -0.04]), np.zeros((3, 3)))
TASK = p3dof.Task(
    [
        p3dof.Waypoint([0, 0, 0], "home"),
        p3dof.Waypoint([-0.15, 0, -0.26], "pick", dwell=0.2, pick_up=LOAD),
        p3dof.Waypoint([-0.15, 0.025], "up", blend=0.025),
        p3dof.Waypoint([0.15, 0.025], "over", blend=0.025),
        p3dof.Waypoint([0.15, 0, 0.26], "place", dwell=0.2, put_down=True),
        p3dof.Waypoint([0, 0, 0], "back"),
    ],
    "pick and place",
)
SMALL = Motor(
    0.32, 0.95, 6000 * RPM, 5e-6, 3000 * RPM, brake_torque=0.3, time_constant=600.0, max_inertia_ratio=30.0,
    name="small",
)  # fmt: skip
LARGE = Motor(1.3, 3.8, 5000 * RPM, 3e-5, 3000 * RPM, brake_torque=1.4, name="large")
SCREWS = [Screw(lead, 0.9, diameter=0.0127, length=0.5, name=f"16x{1e3 * lead:g}") for lead in (0.01, 0.005)]
PARTS = Bearings(Bearing(5100.0, 2400.0), Guide(1e4, 50e3, (120.0, 120.0, 150.0), 16e3))
ROBOT = p3dof.load()


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(scope="module")
def forces():
    return p3dof.design.forces_of_task(ROBOT, TASK.plan(2.0, 501))


@pytest.fixture(scope="module")
def found(forces):
    return p3dof.assess(ROBOT, forces, drives=Catalogue([SMALL, LARGE], SCREWS), bearings=PARTS)


def rating(found, name, part):
    (one,) = (one for one in found.ratings if (one.name, one.part) == (name, part) and one.kind != "machine")
    return one


def test_the_verdict_says_what_is_worst_when_where_and_by_how_much(found):
    held = p3dof.Manipulator(p3dof.PAPER.carrying(LOAD))
    needed = (
        1.5 * abs(held.forces(TASK.waypoints[1].pose, np.zeros(3), np.zeros(3))[0]) * 0.01 / (2 * math.pi)
    )
    worst = found.worst
    assert (worst.name, worst.part, worst.place, worst.unit) == ("brake", "A", "at pick", "N m")
    assert worst.required == pytest.approx(needed, rel=1e-12)
    assert worst.share == pytest.approx(needed / 0.3, rel=1e-12)
    begins = next(piece.motion.time[0] for piece in found.found.plan.pieces if piece.name == "at pick")
    assert worst.time == pytest.approx(begins, rel=1e-12)
    assert found.fits
    used = f"brake of A, {needed:.4g} of 0.3 N m at t = {begins:.4g} s, at pick"
    assert found.verdict == f"fits with {1 - needed / 0.3:.0%} reserve; the least is {used}"


def test_every_rating_has_its_time_and_the_piece_of_the_way(found):
    for one in found.ratings:
        if math.isnan(one.time):
            assert one.name in ("rms torque", "inertia ratio") or one.required == 0
            continue
        (piece, *_) = (
            piece
            for piece in found.found.plan.pieces
            if piece.motion.time[0] <= one.time <= piece.motion.time[-1] and piece.name == one.place
        )
        assert piece.name == one.place
    shares = [round(one.share, 9) for one in found.ratings]
    assert shares == sorted(shares, reverse=True)
    # Axes that are used alike are named in order: rounding decides nothing.
    named = [one.part for one in found.ratings if one.name in ("DN", "nut speed")]
    assert "".join(named) == "ABABCC"
    peak = rating(found, "peak torque", "A")
    drive = found.drives.drives[0]
    torque = np.abs(
        drive.torque(
            *(column[:, 0] for column in (found.cycle.force, found.cycle.speed, found.cycle.acceleration))
        )
    )
    assert peak.required == torque.max()
    assert peak.time == found.cycle.time[torque.argmax()]


def test_heat_and_brakes_tell_when(found):
    """Where the one-body model is hottest, by its own integral in small steps."""
    cycle, drive = found.cycle, found.drives.drives[0]
    torque = drive.torque(cycle.force[:, 0], cycle.speed[:, 0], cycle.acceleration[:, 0])
    load = (torque / drive.motor.continuous(drive.ratio * cycle.speed[:, 0])) ** 2
    heat, hottest = 0.0, []
    for _ in range(2):
        hottest = [heat]
        for step, one, two in zip(np.diff(cycle.time), load[:-1], load[1:], strict=True):
            heat += (0.5 * (one + two) - heat) * -math.expm1(-step / 600.0)
            hottest.append(heat)
        heat = (
            hottest[-1]
            if len(hottest) < 2
            else (hottest[-1] - hottest[0] * math.exp(-2.0 / 600)) / -math.expm1(-2.0 / 600)
        )
    one = rating(found, "heating", "A")
    assert one.required == pytest.approx(max(hottest), rel=1e-9)
    assert one.time == cycle.time[int(np.argmax(hottest))]


def test_the_load_s_inertia_is_a_rating_where_the_motor_has_a_limit(forces):
    limited = dataclasses.replace(SMALL, max_inertia_ratio=5.0)
    found = p3dof.assess(ROBOT, forces, drives=Catalogue([limited], SCREWS[:1]))
    ratio = found.drives.axes[0].inertia_ratio[1]
    assert rating(found, "inertia ratio", "A").share == pytest.approx(ratio / 5)
    assert not found.fits
    assert found.worst.name == "inertia ratio"
    assert "too much" in found.verdict
    with pytest.raises(DriveError, match="max_inertia_ratio"):
        dataclasses.replace(SMALL, max_inertia_ratio=-1.0)


def test_drives_stand_in_the_place_of_the_machine_s_armature(forces):
    """Twice the same machine, once with armature: drives have to move the same."""
    heavy = p3dof.load(
        dataclasses.replace(p3dof.PAPER, actuators=p3dof.machine.Actuators(armature={"sliders": 12.0}))
    )
    laden = p3dof.design.forces_of_task(heavy, TASK.plan(2.0, 501))
    assert np.abs(laden.forces - forces.forces).max() > 50
    np.testing.assert_allclose(cycle_of(laden).force, forces.forces, rtol=0, atol=1e-9)
    catalogue = Catalogue([SMALL], SCREWS[:1])
    pair = [p3dof.size_drives(robot, one, catalogue)[0] for robot, one in ((ROBOT, forces), (heavy, laden))]
    for one, two in zip(*(sizing.axes for sizing in pair), strict=True):
        assert two.rms_torque == pytest.approx(one.rms_torque, rel=1e-9)
        assert two.inertia_ratio == pytest.approx(one.inertia_ratio, rel=1e-9)
    rows = {row[0]: row[1:4] for row in loads_table(p3dof.assess(heavy, laden)).rows}
    assert [float(cell) for cell in rows["force at the nut, peak [N]"]] == pytest.approx(
        forces.peak_forces, rel=1e-5
    )
    with_armature = [float(cell) for cell in rows["force of the actuator, with armature, peak [N]"]]
    assert with_armature == pytest.approx(laden.peak_forces, rel=1e-5)


def test_power_and_regeneration_are_ratings_where_there_are_limits(forces):
    limited = dataclasses.replace(SMALL, max_power=40.0, max_braking_power=35.0)
    found = p3dof.assess(ROBOT, forces, drives=Catalogue([limited], SCREWS[:1]))
    cycle, drive = found.cycle, found.drives.drives[0]
    for leg, name in enumerate("ABC"):
        columns = (column[:, leg] for column in (cycle.force, cycle.speed, cycle.acceleration))
        power = drive.torque(*columns) * drive.ratio * cycle.speed[:, leg]
        for what, values, limit in (("power", power, 40.0), ("regeneration", -power, 35.0)):
            one = rating(found, what, name)
            assert (one.allowed, one.unit) == (limit, "W")
            assert one.required == pytest.approx(values.max(), rel=1e-12)
            assert one.time == cycle.time[values.argmax()]
    assert not found.fits
    assert found.worst.name == "power"
    with pytest.raises(DriveError, match="max_power"):
        dataclasses.replace(SMALL, max_power=0.0)


def test_limits_of_the_task_are_held_too(forces):
    """By samples of a plan in a given time, densely of the fastest one."""
    limits = p3dof.design.AxisLimits(force=[150.0, 120.0, 500.0], speed=2.0, power=1000.0, jerk=100.0)
    found = p3dof.assess(ROBOT, forces, limits=limits)
    assert (found.worst.kind, found.worst.name, found.worst.part) == ("task", "force", "B")
    assert found.worst.share == forces.peak_forces[1] / 120
    assert not found.fits
    assert any("hold for the time-optimal motion only: jerk" in told for told in found.warnings)
    quick = p3dof.Task(TASK.waypoints, "quick", limits={"force": 200.0})
    plan = p3dof.design.fastest_plan(ROBOT, quick, samples=301)
    fastest = p3dof.assess(ROBOT, p3dof.design.forces_of_task(ROBOT, plan))
    uses = [(use.quantity, use.leg, use.value, use.time) for use in plan.uses]
    told = [(one.name, one.part, one.required, one.time) for one in fastest.ratings if one.kind == "task"]
    assert sorted(told) == sorted(uses)
    assert fastest.worst.kind == "task"
    with pytest.raises(InputError, match="limits: expected AxisLimits"):
        p3dof.assess(ROBOT, forces, limits=3)


def test_the_table_has_every_rating_of_machine_task_and_drive(forces):
    """Three of one name are three rows, the worst first."""
    limits = p3dof.design.AxisLimits(force=150.0, speed=0.4)
    found = p3dof.assess(ROBOT, forces, drives=Catalogue([SMALL], SCREWS[:1]), limits=limits)
    rows = uses_table(found).rows
    kinds = [row[1] for row in rows if row[0] == "speed of B"]
    assert sorted(kinds) == ["drive", "machine", "task"]
    assert rows[0][:2] == (f"{found.worst.name} of {found.worst.part}", found.worst.kind)
    assert len(rows) == len(found.ratings)
    shares = [float(row[4].rstrip("%")) for row in rows]
    worse = sum(one.verdict == "does not fit" for one in found.ratings)
    assert shares[:worse] == sorted(shares[:worse], reverse=True)
    assert min(shares[:worse]) > 100


@pytest.mark.usefixtures("undrawn")
@pytest.mark.usefixtures("undrawn")
def test_limits_of_a_task_count_in_plan_size_and_report(files, capsys):
    """A task within the limits of the machine, and not within its own."""
    assert run(capsys, "plan", "task.yaml", "--duration", 2, "--samples", 201)[0] == 0
    line = ["task.yaml", "--duration", 2, "--samples", 201, "--drives", "drives.yaml"]
    assert run(capsys, "size", *line)[0] == 0
    own = "limits: {force: 400 N, speed: 0.2 m/s}\n"
    (files / "task.yaml").write_text(FILES["task.yaml"] + own, encoding="utf-8")
    row = re.compile(r"speed B \[m/s\].* 0\.2\b.*task .*\d{3}\.\d ?%")
    code, out, _ = run(capsys, "plan", "task.yaml", "--duration", 2, "--samples", 201)
    assert code == 1
    assert row.search(out), out
    code, out, _ = run(capsys, "size", *line)
    assert code == 1
    assert row.search(out), out
    assert out.splitlines()[1].startswith("the task exceeds limits")  # next to whether a drive fits
    code, out, _ = run(capsys, "report", *line, "--out", "r.html", "--no-animation")
    assert code == 1
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", (files / "r.html").read_text(encoding="utf-8")))
    assert row.search(text[text.index("Utilisation of limits") :])
    assert "the task has limits of its own: force 400 N, speed 0.2 m/s" in text
    code, out, _ = run(capsys, "fastest", "task.yaml", "--samples", 201, "--nodes", 100)
    assert code == 0
    assert re.search(r"speed B \[m/s\].* 0\.2\b.*task .*100\.0%", out), out


def test_what_is_just_exceeded_is_told_with_digits_enough(forces):
    most = forces.peak_forces.max()
    limits = p3dof.design.AxisLimits(force=most / (1 + 2e-5), speed=2.0)
    found = p3dof.assess(ROBOT, forces, limits=limits)
    assert not found.fits
    required, allowed = (float(text) for text in found.worst.figures)
    assert required > allowed
    assert required / allowed == pytest.approx(1 + 2e-5, abs=2e-6)
    assert uses_table(found, 1).rows[0][4] == "100.002%"
    assert "has a utilisation of 100.002%" in found.verdict
    assert "0.002% too much" in found.verdict


def test_balance_and_armature_are_told():
    actuators = p3dof.machine.Actuators(armature={"slide_a": 3.0}, counterbalance={"sliders": 50.0})
    balanced = p3dof.load(dataclasses.replace(p3dof.PAPER, actuators=actuators))
    found = p3dof.assess(balanced, balanced.inverse_dynamics(p3dof.paper_motion(51), method="compiled"))
    told = assumptions(found)["armature and counterbalance"]
    assert told.startswith("armature slide_a 3 kg")
    assert "counterbalance slide_a 50 N, slide_b 50 N, slide_c 50 N" in told
    drives = p3dof.assess(balanced, found.found, drives=Catalogue([LARGE], SCREWS[:1]))
    assert "replaces the armature" in assumptions(drives)["armature and counterbalance"]
    assert (
        "no counterbalance"
        in assumptions(p3dof.assess(ROBOT, ROBOT.inverse_dynamics(p3dof.paper_motion(51))))[
            "armature and counterbalance"
        ]
    )


def test_nut_and_motor_are_two_rows(found):
    rows = {row[0]: row[1:] for row in loads_table(found).rows}
    drive, cycle = found.drives.drives[0], found.cycle
    for leg in range(3):
        torque = drive.torque(cycle.force[:, leg], cycle.speed[:, leg], cycle.acceleration[:, leg])
        most = float(rows["force of the motor at the slider, peak [N]"][leg])
        assert most == pytest.approx(np.abs(torque).max() * drive.ratio, rel=1e-5)
        assert float(rows["force at the nut, peak [N]"][leg]) == pytest.approx(
            found.found.peak_forces[leg], rel=1e-5
        )
        assert float(rows["force at the nut, rms [N]"][leg]) == pytest.approx(
            found.found.rms_forces[leg], rel=1e-5
        )
    assert rows["force at the nut, peak [N]"][4] == "pick → up"


def test_forces_and_reactions_of_a_task_are_those_of_its_pieces(forces):
    one = joined(forces)
    np.testing.assert_array_equal(one.time, forces.plan.motion.time)
    loads = p3dof.design.reactions_of_task(ROBOT, forces.plan)
    laden = p3dof.Manipulator(p3dof.PAPER.carrying(LOAD))
    for name, machine in (("home → pick", ROBOT), ("up → over", laden)):
        piece = next(piece for piece in forces.plan.pieces if piece.name == name)
        direct = machine.reactions(piece.motion, "elastic")
        rows = np.searchsorted(loads.time, piece.motion.time[1:-1])
        np.testing.assert_allclose(loads.forces[rows], direct.forces[1:-1], rtol=0, atol=1e-9)
        rows = np.searchsorted(one.time, piece.motion.time[1:-1])
        np.testing.assert_allclose(
            one.forces[rows], machine.inverse_dynamics(piece.motion).forces[1:-1], rtol=0, atol=1e-9
        )
    report = bearing_life(p3dof.PAPER, loads, PARTS)
    assessed = p3dof.assess(ROBOT, forces, bearings=PARTS).bearings
    hours = [life.hours for life in report.bearings]
    assert [life.hours for life in assessed.bearings] == pytest.approx(hours, rel=1e-10)
    with pytest.raises(InputError, match="found"):
        joined(one)
    with pytest.raises(SampleError, match="do not produce the motion"):  # of all samples alike
        p3dof.assess(p3dof.Manipulator(p3dof.PAPER.carrying(LOAD)), forces, bearings=PARTS)


def test_what_motors_must_give_without_a_catalogue(forces):
    found = p3dof.assess(ROBOT, forces)
    header, rows = needs_table(found).header, {row[0]: row[1:] for row in needs_table(found).rows}
    ideal = Screw(0.01, 1.0, 1.0, inertia=0.0)
    motor = dataclasses.replace(LARGE, inertia=0.0)
    axes = size_of(cycle_of(forces), p3dof.design.drives.Drive(motor, ideal)).axes
    cells = dict(zip(header[1:], rows["10 mm"], strict=True))
    for leg, axis in zip("ABC", axes, strict=True):
        assert float(cells[f"{leg} peak [N m]"]) == pytest.approx(abs(axis.peak_torque), rel=1e-3)
        assert float(cells[f"{leg} rms [N m]"]) == pytest.approx(axis.rms_torque, rel=1e-3)
        assert float(cells[f"{leg} top [rpm]"]) == pytest.approx(axis.top_speed / RPM, rel=1e-3)


def test_what_is_exceeded_comes_first(forces):
    quick = p3dof.design.forces_of_task(ROBOT, TASK.plan(1.0, 501))
    found = p3dof.assess(ROBOT, quick, drives=Catalogue([SMALL], SCREWS[1:]))
    assert not found.fits
    assert 1 < found.worst.share < math.inf
    assert {"speed", "heating", "DN"} <= {one.name for one in found.ratings if one.share > 1}
    assert found.warnings[0].startswith(f"{found.worst.name} of {found.worst.part}:")
    assert p3dof.assess(ROBOT, forces).worst.kind == "machine"


def test_what_the_verdict_says_nothing_about(forces):
    """By what the files have: less is unchecked with drives, with bearings, with friction."""
    plain = p3dof.assess(ROBOT, forces)
    assert any(one.startswith("motors, gears, screws") for one in plain.unchecked)
    assert any(one.startswith("bearings, guides and rods (no ratings") for one in plain.unchecked)
    assert any(one.startswith("friction of guides and joints") for one in plain.unchecked)
    parts = Bearings(joints={"hinge_a": Bearing(3000.0), "slide_a": PARTS.of("slide_a")})
    rough = p3dof.load(dataclasses.replace(p3dof.PAPER, friction=Friction({"sliders": 5.0})))
    found = p3dof.assess(
        rough,
        p3dof.design.forces_of_task(rough, TASK.plan(2.0, 101)),
        drives=Catalogue([SMALL], SCREWS[1:]),
        bearings=parts,
    )
    told = "; ".join(found.unchecked)
    assert "no ratings were given" not in told
    assert "no drives were given" not in told
    assert "friction" not in told
    assert "bearings of hinge_a" not in told
    assert "hinge_platform" in told  # of many that have none
    assert "static load of hinge_a (no static rating)" in told
    assert "no life was required" in told
    page = report.render_assessment(plain)
    box = page[page.index('class="box') :]
    box = box[: box.index("</div>")]
    assert "<strong>Fits with " in box
    assert all(html.escape(one) in box for one in plain.unchecked)


def test_friction_that_grows_with_loads_is_in_all_of_it():
    contact = p3dof.analysis.load_friction.SlideContact(drag=4.0, mu=0.05)
    friction = p3dof.analysis.LoadFriction(slides=contact)
    plan = TASK.plan(2.0, 101)
    rough = p3dof.design.forces_of_task(ROBOT, plan, "virtual-power", load_friction=friction)
    found = p3dof.assess(ROBOT, rough, bearings=PARTS)
    bare = p3dof.assess(ROBOT, p3dof.design.forces_of_task(ROBOT, plan))
    assert (np.abs(found.found.forces - bare.found.forces).max(axis=0) > 4).all()
    assert "load-dependent" in assumptions(found)["friction"]
    assert "load-dependent" not in assumptions(bare)["friction"]
    pair = {"a": ROBOT, "b": ROBOT}
    (one,) = p3dof.compare_designs(pair, TASK, duration=2.0, samples=101, load_friction=friction)
    assert one["peak force of A"].values[0] == pytest.approx(found.found.peak_forces[0], rel=1e-9)
    # Of a guide, actuator and friction act along it together: their sum is what moves the slider.
    along = without_jumps(found.reactions, plan)["slide_a"].forces[:, 2]
    np.testing.assert_allclose(along, joined(bare.found).forces[:, 0], rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [((3, None), "robot: expected a Manipulator"), ((ROBOT, 3), "found: expected forces")],
)
def test_bad_arguments(arguments, words):
    with pytest.raises(InputError, match=words):
        p3dof.assess(*arguments)


def test_bad_settings(forces):
    for options, words in (({"rest": -1.0}, "rest"), ({"name": 3}, "name"), ({"drives": []}, "at least one")):
        with pytest.raises((InputError, DriveError), match=words):
            p3dof.assess(ROBOT, forces, **options)
    with pytest.raises(InputError, match="found"):
        report.render_assessment(3)


FILES = {
    "task.yaml": """name: pick and place
waypoints:
  - {name: home, pose: [0, 0, 0]}
  - {name: pick, pose: [-150 mm, 0, -15 deg], dwell: 200 ms,
     pick_up: {mass: 2 kg, com: [0, 0, -40 mm], inertia: [0, 0, 0]}}
  - {name: place, pose: [150 mm, 0, 15 deg], dwell: 200 ms, put_down: true}
  - {name: back, pose: [0, 0, 0]}
""",
    "far.yaml": "waypoints: [{pose: [0, 0, 0]}, {name: there, pose: [600 mm, 0, 0]}]\n",
    "drives.yaml": """motors: [{name: M1, rated_torque: 1.3 Nm, peak_torque: 3.8 Nm, max_speed: 5000 rpm,
  inertia: 0.3 kg cm^2, brake_torque: 1.4 Nm}]
screws: [{name: S1, lead: 10 mm, diameter: 12.7 mm, length: 500 mm}]
""",
    "bearings.yaml": "hinges: {name: 6001, dynamic: 5.1 kN, static: 2.4 kN}\n",
}


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    p3dof.write_parameters(p3dof.PAPER, tmp_path / "machine.yaml")
    return tmp_path


@pytest.fixture
def undrawn(monkeypatch):
    """Leaves the pictures away, which take most of the time."""
    blank = Picture("data:,", "nothing", "nothing", 1, 1)
    pictures = AssessmentPictures(*[blank] * len(dataclasses.fields(AssessmentPictures)))
    monkeypatch.setattr("p3dof.report.assessment._pictures", lambda _: pictures)


@pytest.mark.usefixtures("undrawn")
def test_the_command_answers_first(files, capsys):
    line = ["report", "task.yaml", "--duration", 2, "--drives", "drives.yaml", "--bearings", "bearings.yaml"]
    code, out, err = run(capsys, *line, "--samples", 201, "--out", "r.html", "--parameters", "machine.yaml")
    assert (code, err) == (0, "")
    assert out.startswith("pick and place: fits with ")
    text = (files / "r.html").read_text(encoding="utf-8")
    body = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text[text.index("<main>") :]))
    answer = out.splitlines()[0].removeprefix("pick and place: f")
    assert body.lstrip().startswith(f"F{answer}, with M1 + S1.")
    titles = re.findall(r"<h2 [^>]*>([^<]*)<", text)
    assert titles.index("Assumptions") < titles.index("The machine")
    captions = re.findall(r"<caption>([^<]*)<", text)
    for caption in ("Utilisation of ratings", "Loads of the sliders", "Bearings", "M1 + S1"):
        assert caption in captions
    assert "half width b = 50 mm" in text
    assert "estimates" in text
    assert text.count("<img ") == 5
    assert "loads of joints" not in text
    assert "force hinge_left" in text  # the moving page has the loads of the joints
    # The command in the page makes it again.
    again = next(line for line in re.findall(r"<pre>(.*?)</pre>", text))
    assert shlex.split(again)[:3] == ["p3dof", "report", "task.yaml"]
    (files / "r.html").unlink()
    code, _, _ = run(capsys, *shlex.split(again)[1:])
    assert code == 0
    dated = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d\d:\d\d")
    assert dated.sub("", (files / "r.html").read_text(encoding="utf-8")) == dated.sub("", text)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.usefixtures("undrawn")
def test_a_task_alone_and_the_fastest(files, capsys):
    code, out, _ = run(
        capsys, "report", "task.yaml", "--fastest", "--samples", 201, "--out", "r.html", "--no-animation"
    )
    assert code == 0
    text = (files / "r.html").read_text(encoding="utf-8")
    assert "No drives were chosen." in text
    assert "Required torque and speed of the motors" in text
    assert re.search(r"fits, just; the least is (force|speed) of [ABC]", out)
    assert "<script" not in text


@pytest.mark.usefixtures("undrawn")
@pytest.mark.usefixtures("undrawn")
def test_a_motion_with_drives(files, capsys):
    code, out, _ = run(
        capsys, "report", "--samples", 101, "--drives", "drives.yaml", "--out", "r.html", "--no-animation"
    )
    assert code == 1  # C turns too fast for this nut, and for this motor
    assert "motion: does not fit: DN of C has a utilisation of 150%" in out
    assert re.search(r"speed of C: 66\d\d of 5000 rpm", out)
    text = (files / "r.html").read_text(encoding="utf-8")
    assert "<strong>Does not fit:</strong> DN of C" in text


@pytest.mark.slow
def test_a_task_is_printed(files, capsys):
    find_chromium()  # skips where there is none
    line = ["report", "task.yaml", "--duration", 2, "--drives", "drives.yaml", "--samples", 101]
    code, _, _ = run(capsys, *line, "--out", "r.pdf")
    assert code == 0
    pdf = (files / "r.pdf").read_bytes()
    pages = len(re.findall(rb"/MediaBox \[0 0 59[45]", pdf))
    assert 5 <= pages <= 12
    assert len(re.findall(rb"/Width 960\b", pdf)) == 1  # figures are drawings, the machine is the one picture
    if shutil.which("pdftotext"):
        ends = ["pdftotext", "-layout", "-l", "1", "r.pdf", "-"]
        first = subprocess.run(ends, capture_output=True, check=True).stdout.decode()
        assert "Fits with " in first
        assert re.search(rf"pick and place +1 ?/ ?{pages}\s*$", first)


@pytest.mark.usefixtures("undrawn")
def test_bad_input_is_one_line_and_leaves_nothing(files, capsys):
    before = sorted(files.rglob("*"))
    (files / "file").touch()
    for arguments, words in (
        (("machine.yaml",), "expected a task, got the parameters of a machine"),
        (("none.yaml",), "none.yaml: cannot be read"),
        (("task.yaml", "--duration", 2, "--drives", "none.yaml"), "none.yaml: cannot be read"),
        (("task.yaml", "--duration", 2, "--drives", "task.yaml"), "unknown field"),
        (("far.yaml", "--duration", 2), "there"),
        (("task.yaml", "--duration", 2, "--out", "r.docx"), "ends in .html or .pdf"),
        (("task.yaml", "--duration", 2, "--out", "file/r.html"), "cannot be written"),
        (("task.yaml", "--duration", 2, "--out", "task.yaml"), "ends in .html"),
        (("task.yaml",), "--duration"),
        (("task.yaml", "--duration", 2, "--fastest"), "--duration"),
        (("task.yaml", "--duration", 2, "--motion", "m.csv"), "--motion"),
        (("--duration", 2), "--duration"),
        (("task.yaml", "--duration", 2, "--joint-model", "paper"), "--joint-model"),
    ):
        code, out, err = run(capsys, "report", *arguments)
        assert code in (1, 2)
        assert "wrote" not in out
        assert re.fullmatch(r"p3dof: error: [^\n]*\n", err), err
        assert words in err
    (files / "file").unlink()
    assert sorted(files.rglob("*")) == before


def test_tables_and_notebooks(found):
    assert [row[0] for row in uses_table(found, 1).rows] == ["brake of A"]
    assert found.verdict in found._repr_html_().replace("&gt;", ">")
    assert found.verdict in repr(found)


def test_labels_of_bars_stand_off_the_line_of_the_limit(forces):
    limits = p3dof.design.AxisLimits(force=forces.peak_forces.max() * 1.03, speed=2.0)
    figure = plots.utilisation_figure(p3dof.assess(ROBOT, forces, limits=limits))
    figure.canvas.draw()
    (axis,) = figure.axes
    line = axis.transData.transform((1.0, 0.0))[0]
    spans = [text.get_window_extent() for text in axis.texts]
    assert any(text.get_text() == "97%" for text in axis.texts)
    assert not any(span.x0 <= line <= span.x1 for span in spans)
