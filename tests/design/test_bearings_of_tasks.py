"""Reactions and lives over tasks whose payload and load change on the way, against each piece on its own."""

from __future__ import annotations

import math

import numpy as np
import pytest

import p3dof
from p3dof.analysis.load_friction import HingeContact, LoadFriction, SlideContact
from p3dof.analysis.reactions import JOINTS, Stiffness
from p3dof.cli import main
from p3dof.design.bearings import Bearing, Bearings, Guide, bearing_life, guides_table
from p3dof.design.tasks import Task, Waypoint
from p3dof.machine.parameters import PAPER, Body, Parameters

LOAD = Body(6.0, np.array([0.05, 0.04, -0.06]), np.full(3, 0.01))
TASK = Task(
    [
        Waypoint([0, 0, 0], "home", dwell=0.1),
        Waypoint([-0.15, 0, -0.25], "pick", dwell=0.2, pick_up=LOAD),
        Waypoint([0, 0.05], "over", blend=0.02, wrench=[0, 30, 0, 0, 0, 4]),
        Waypoint([0.15, 0, 0.25], "place", dwell=0.15, put_down=True, wrench=[0, 0, -200, 0, 2, 0]),
        Waypoint([0, 0, 0], "back"),
    ]
)
BALL = Bearing(3000.0, 2000.0, Y=1.2)
ROLLER = Bearing(5000.0, kind="roller")
GUIDE = Guide(1e4, 50e3, (120, 120, 150), static=2e4, centre=(0.0, 0.01, -0.02))
PARTS = Bearings(BALL, GUIDE, {"hinge_left": ROLLER})
FRICTION = LoadFriction(HingeContact(0.1, 8e-3), slides=SlideContact(4.0, 0.01, 0.03))


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def plan():
    return TASK.plan(2.0, 161)


@pytest.fixture(scope="module")
def pieces(plan):
    """Each way and wait with its own machine, as nobody but this test computes them."""
    found = []
    for piece in plan.pieces:
        own: Parameters = PAPER if piece.payload is None else PAPER.carrying(piece.payload)
        found.append(p3dof.load(own).reactions(piece.motion, "elastic", wrench=piece.wrench))
    return found


@pytest.fixture(scope="module")
def whole(robot, plan):
    return p3dof.design.reactions_of_task(robot, plan)


def test_every_sample_of_every_piece_is_there(plan, pieces, whole):
    """Both ends too where the load changes, a billionth of the task apart."""
    assert len(plan.pieces) == 7
    for piece, own in zip(plan.pieces, pieces, strict=True):
        begin = np.searchsorted(whole.time, piece.motion.time[0] - 1e-12)
        rows = slice(begin, begin + len(piece.motion))
        if np.abs(whole.forces[begin] - own.forces[0]).max() > 1e-9:  # of the former piece
            rows = slice(begin + 1, begin + 1 + len(piece.motion))
        np.testing.assert_allclose(whole.time[rows], piece.motion.time, rtol=0, atol=1e-8)
        np.testing.assert_allclose(whole.forces[rows], own.forces, rtol=0, atol=1e-9)
        np.testing.assert_allclose(whole.moments[rows], own.moments, rtol=0, atol=1e-9)
    assert (np.diff(whole.time) > 0).all()
    assert whole.residual.max() < 1e-9
    largest = max(np.abs(one.forces).max() for one in pieces)
    assert np.abs(whole.forces).max() == pytest.approx(largest, rel=1e-14)
    assert max(peak.force for peak in whole.peaks()) > 1.5 * max(peak.force for peak in pieces[0].peaks())


def test_lives_are_those_of_all_pieces_together(plan, pieces, whole):
    """Miner's rule over ways and waits: Σ ∫ P^p |ω| dt, by hand, with the whole cycle for the hours."""
    report = bearing_life(PAPER, whole, PARTS, rest=0.4)
    assert report.cycle == pytest.approx(plan.duration + 0.4, rel=1e-12)
    for one in report.bearings:
        joint = next(joint for joint in JOINTS if joint.name == one.joint)
        damage = turned = 0.0
        for piece, own in zip(plan.pieces, pieces, strict=True):
            rate = joint_rate(piece.motion, joint)
            forces = own[one.joint].forces
            load = np.hypot(forces[:, 0], forces[:, 2])
            if one.bearing is BALL:
                load = load + 1.2 * np.abs(forces[:, 1])
            damage += np.trapezoid(
                (load / one.bearing.dynamic) ** one.bearing.exponent * rate, piece.motion.time
            )
            turned += np.trapezoid(rate, piece.motion.time)
        assert one.bearing is (ROLLER if one.joint == "hinge_left" else BALL)
        assert one.revolutions == pytest.approx(turned / (2 * math.pi), rel=1e-8)
        cycles = 1e6 / (damage / (2 * math.pi))
        assert one.hours == pytest.approx(cycles * report.cycle / 3600, rel=1e-7)
        assert one.peak_load == pytest.approx(largest_load(pieces, one.joint, one.bearing), rel=1e-12)
    for one in report.guides:
        damage = way = moments = 0.0
        for piece, own in zip(plan.pieces, pieces, strict=True):
            speed = np.abs(slider_speed(piece.motion, one.joint))
            f, m = own[one.joint].forces, own[one.joint].moments
            about = m - np.cross(
                [0.0, 0.01, -0.02], f * [1, 1, 0]
            )  # from the slider's origin to the carriage
            turning = np.abs(about) @ (1e4 / np.array([120, 120, 150]))
            load = np.abs(f[:, :2]).sum(axis=1) + turning
            damage += np.trapezoid((load / 1e4) ** 3 * speed, piece.motion.time)
            way += np.trapezoid(speed, piece.motion.time)
            moments += np.trapezoid(turning / load, piece.motion.time)
        assert one.way == pytest.approx(way, rel=1e-8)
        assert one.hours == pytest.approx(50e3 / damage * report.cycle / 3600, rel=1e-7)
        assert one.moment_share == pytest.approx(moments / plan.duration, rel=1e-7)


def joint_rate(motion, joint):
    """How fast a hinge turns, from the bodies on both sides."""
    moving = p3dof.load().mechanism_motion(motion.pose, motion.velocity, motion.acceleration).bodies
    if joint.name.startswith("loop_") and joint.name != "loop_c":  # a leg turns about x0 against its slider
        return np.abs(moving[joint.predecessor].omega[:, 0])
    still = np.zeros((len(motion), 3))
    one = moving[joint.predecessor].omega if joint.predecessor in moving else still
    return np.linalg.norm(moving[joint.successor].omega - one, axis=1)


def slider_speed(motion, joint):
    moving = p3dof.load().mechanism_motion(motion.pose, motion.velocity, motion.acceleration).bodies
    return moving[joint.replace("slide", "slider")].at(np.zeros(3))[1][:, 2]


def largest_load(pieces, joint, bearing):
    found = 0.0
    for own in pieces:
        f = own[joint].forces
        axial = 1.2 * np.abs(f[:, 1]) if bearing is BALL else 0.0
        found = max(found, float((np.hypot(f[:, 0], f[:, 2]) + axial).max()))
    return found


def test_waits_wear_nothing_and_take_their_time(robot):
    """Twice as long a wait: the same damage a cycle, more hours, less share of time in the motion."""
    short, long = (
        Task(
            [
                Waypoint([0, 0, 0]),
                Waypoint([0.1, 0.02, 0.1], dwell=dwell, pick_up=LOAD),
                Waypoint([0, 0, 0], duration=0.5),
            ]
        ).plan(1.0 + dwell, 101)
        for dwell in (0.2, 1.4)
    )
    one, other = (
        bearing_life(PAPER, p3dof.design.reactions_of_task(robot, each), PARTS) for each in (short, long)
    )
    for a, b in zip((*one.bearings, *one.guides), (*other.bearings, *other.guides), strict=True):
        assert b.life == pytest.approx(a.life, rel=1e-3)  # samples lie elsewhere
        assert b.hours / a.hours == pytest.approx(2.4 / 1.2, rel=1e-3)


@pytest.mark.slow
def test_in_all_ways_and_with_friction(robot, plan, whole):
    every = p3dof.design.reactions_of_task(robot, plan, "all")
    np.testing.assert_array_equal(every.elastic.forces, whole.forces)
    fixed = every.determined_forces
    np.testing.assert_allclose(every.paper.forces[fixed], whole.forces[fixed], rtol=0, atol=1e-9)
    rough = p3dof.design.reactions_of_task(
        robot, plan, load_friction=FRICTION, stiffness=Stiffness(rods=None)
    )
    laden = p3dof.load(PAPER.carrying(LOAD))
    piece = next(piece for piece in plan.pieces if piece.name == "over → place")
    own = laden.reactions(
        piece.motion, "elastic", wrench=piece.wrench, load_friction=FRICTION, stiffness=Stiffness(rods=None)
    )
    rows = np.searchsorted(rough.time, piece.motion.time[1:-1] - 1e-12)
    np.testing.assert_allclose(rough.forces[rows], own.forces[1:-1], rtol=0, atol=1e-9)
    found = p3dof.design.forces_of_task(robot, plan, "virtual-power", load_friction=FRICTION)
    assessed = p3dof.assess(robot, found, bearings=PARTS)
    direct = bearing_life(PAPER, p3dof.design.reactions_of_task(robot, plan, load_friction=FRICTION), PARTS)
    assert assessed.bearings.bearings[0].hours == pytest.approx(direct.bearings[0].hours, rel=1e-9)


TEXT = """
waypoints:
- {name: home, pose: [0, 0, 0]}
- {name: pick, pose: [-0.15, 0, -15 deg], dwell: 0.2, pick_up: {mass: 6, com: [0, 0, 0], inertia: [0, 0, 0]}}
- {name: place, pose: [0.15, 0, 15 deg], put_down: true, wrench: [0, 0, -200, 0, 0, 0]}
- {name: back, pose: [0, 0, 0]}
"""


def test_the_commands(tmp_path, capsys):
    task, parts = tmp_path / "task.yaml", tmp_path / "bearings.yaml"
    task.write_text(TEXT, encoding="utf-8")
    parts.write_text(
        "hinges: {dynamic: 3 kN}\nguides: {dynamic: 10 kN, basis: 50 km, moments: [120, 120, 150]}\n",
        encoding="utf-8",
    )
    given = ["--task", str(task), "--duration", "2", "--samples", "101"]
    assert main(["bearings", str(parts), *given, "--rest", "0.5"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "pick → place" in shown
    assert "2.5 s" in shown
    plan = p3dof.read_task(task).plan(2.0, 101)
    report = bearing_life(
        PAPER, p3dof.design.reactions_of_task(p3dof.load(), plan), p3dof.design.bearings.read_bearings(parts)
    )
    row = guides_table(report, lambda time: plan.piece_at(time).name).rows[0]
    assert row[5] == plan.piece_at(report.guides[0].peak_time).name
    out = tmp_path / "r.csv"
    assert main(["reactions", *given, "--out", str(out)]) == 0
    assert len(out.read_text(encoding="utf-8").splitlines()) > 101
    assert "bears" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--motion", "m.csv"], "--motion: a task has its own motion and loads"),
        (["--wrench", "w.csv"], "--wrench: a task has its own motion and loads"),
        ([], "--duration: "),
    ],
)
def test_wrong_options(tmp_path, capsys, options, told):
    task, parts = tmp_path / "task.yaml", tmp_path / "bearings.yaml"
    task.write_text(TEXT, encoding="utf-8")
    parts.write_text("hinges: {dynamic: 3 kN}\n", encoding="utf-8")
    for name in ("m.csv", "w.csv"):
        (tmp_path / name).write_text("t\n", encoding="utf-8")
    given = [str(tmp_path / word) if word.endswith(".csv") else word for word in options]
    for command in (["bearings", str(parts)], ["reactions"]):
        assert main([*command, "--task", str(task), *given]) == 2
        assert told in capsys.readouterr().err
        assert main([*command, "--duration", "2"]) == 2
        assert "--duration: it belongs to --task" in capsys.readouterr().err
    assert main(["reactions", "--task", str(task), "--duration", "2", "--out", str(task)]) == 2
    assert "task.yaml" in capsys.readouterr().err
