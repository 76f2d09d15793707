"""The page of error messages quotes what the sources say, and its causes have these messages."""

from __future__ import annotations

import ast
import re
import warnings
from dataclasses import replace
from functools import cache

import closed_loop_robots as robots
import numpy as np
import pytest
from command_line import run
from documents import ROOT

import p3dof
from p3dof._base.quantities import FORCE, MOMENT
from p3dof.cli.kinds import Amount, require_unit
from p3dof.codegen.loops import loop_files
from p3dof.design.drives.sizing import Rating
from p3dof.design.drives.tables import _words
from p3dof.loops.identification.fitting import chosen_poses

PAGE = (ROOT / "docs/how-to/error-messages.md").read_text("utf-8")
ROWS = re.findall(r"^\| (`.*?) \| .+ \| .+ \|$", PAGE, re.MULTILINE)
QUOTED = [one for row in ROWS for one in re.findall(r"`([^`]+)`", row) if not one.startswith("pip ")]
FOUR_BAR = ROOT / "docs/_static/gallery/four_bar.urdf"
END = "\x01"
MACHINE = "geometry: {r: 0.1, R: 0.25, L: 0.4}\nbodies: solids\n"


def pattern(message):
    """A quoted message as a regular expression: … stands for anything."""
    return ".*?".join(re.escape(part) for part in message.split("…"))


@cache
def texts():
    """Every text of the package's sources, one behind the other; a NUL stands where something is put in."""
    found = set()
    for path in (ROOT / "p3dof").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = [one.value if isinstance(one, ast.Constant) else "\0" for one in node.values]
                found.add("".join(parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.add(node.value)
    return END.join(sorted(found))


@pytest.mark.parametrize("message", QUOTED)
def test_a_quoted_message_is_one_of_the_sources(message):
    parts = [part for part in re.split("…", message) if part.strip()]
    assert sum(map(len, parts)) >= 8, "it says too little to be found"
    assert re.search(f"[^{END}]*?".join(map(re.escape, parts)), texts())


def parameters(text, tmp_path):
    (tmp_path / "machine.yaml").write_text(text, encoding="utf-8")
    p3dof.read_parameters(tmp_path / "machine.yaml")


def motion(text, tmp_path):
    (tmp_path / "motion.csv").write_text(text, encoding="utf-8")
    return p3dof.Motion.from_csv(tmp_path / "motion.csv")


def crossing(_tmp_path):
    away = p3dof.Motion.rest_to_rest([0, 0, 0], [0, 0, 1.3], 0.5, 51)
    p3dof.load().inverse_dynamics(away)


def in_the_way(tmp_path):
    (tmp_path / "motion.csv").mkdir()
    p3dof.paper_motion(11).to_csv(tmp_path / "motion.csv")


def open_tree(tmp_path):
    (tmp_path / "bare.urdf").write_text(FOUR_BAR.read_text("utf-8"), encoding="utf-8")
    p3dof.load_robot(tmp_path / "bare.urdf")


def four_bar(**changes):
    sidecar = p3dof.load_robot("gallery/four_bar").sidecar
    return p3dof.load_robot(FOUR_BAR, replace(sidecar, **changes))


def no_motor(_tmp_path):
    robot = four_bar(actuated=())
    robot.inverse_dynamics(robot.assemble().q, [0, 0, 0], [0, 0, 0])


def too_far(_tmp_path):
    robot = four_bar(closures=(p3dof.Closure("coupler_tip", "base"),))
    robot.lock({"coupler_joint": 0.0}).assemble([0.5])


def long_quaternion(_tmp_path):
    robot = p3dof.load_robot("gallery/stewart")
    q = robot.reference.copy()
    q[-1] = 2.0
    robot.closure_error(q)


def dead_point(_tmp_path):
    """Crank (0.15 m) and coupler (0.4 m) in one line: the rocker (0.3 m, from 0.4 m) cannot hold them."""
    crank = np.arccos((0.4**2 + 0.55**2 - 0.3**2) / (2 * 0.4 * 0.55))
    rocker = np.arctan2(0.55 * np.sin(crank), 0.55 * np.cos(crank) - 0.4)
    robot = four_bar(actuated=("rocker_joint",))
    robot.inverse_dynamics([crank, 0, rocker], [0, 0, 0], [0, 0, 0])


def loaded(_tmp_path):
    hinges = p3dof.analysis.load_friction.HingeContact(mu=0.1, radius=8e-3)
    friction = p3dof.analysis.LoadFriction(hinges=hinges)
    p3dof.load().inverse_dynamics(p3dof.paper_motion(11), load_friction=friction, method="compiled")


def another_sweep(tmp_path):
    lengths = p3dof.blocks.Samples({"L": p3dof.blocks.Uniform(0.38, 0.5)}, 20)
    problem = p3dof.design.sweeps.DesignSweep(lengths, p3dof.paper_motion(11))
    for seed in (1, 2):
        p3dof.sweep(problem, tmp_path / "lengths", seed=seed)


def flat_start(_tmp_path):
    robot = p3dof.loops.ClosedLoopModel.from_urdf(robots.flat_parallelogram(), robots.PARALLELOGRAM_SIDECAR)
    p3dof.runs.simulate_robot(robot, 0.1, robot.reference)


def two_durations(tmp_path):
    poses = "waypoints: [{pose: [0, 0, 0]}, {pose: [50 mm, 0, 0], duration: 1}]"
    (tmp_path / "task.yaml").write_text(poses, encoding="utf-8")
    p3dof.read_task(tmp_path / "task.yaml").plan(0.5)


def no_mass(_tmp_path):
    text = re.sub("<inertial>.*?</inertial>", "", FOUR_BAR.read_text("utf-8"), flags=re.DOTALL)
    loop_files(p3dof.load_robot(text, p3dof.load_robot("gallery/four_bar").sidecar))


HEADER = "t, y, z, theta, ydot, zdot, thetadot, yddot, zddot, thetaddot\n"
CAUSES = {
    # A part of a quoted message that no other one has; what raises or returns it.
    "cannot be read (": lambda path: p3dof.read_parameters(path / "none.yaml"),
    "cannot be written (": in_the_way,
    "not valid YAML": lambda path: parameters("geometry:\n\tr: 0.1\n", path),
    "unknown field": lambda path: parameters(MACHINE.replace("r: ", "rr: "), path),
    "or one with a unit": lambda path: parameters(MACHINE.replace("0.1,", "120 kg,"), path),
    "got … without one": lambda path: parameters(MACHINE + "payload: {mass: 1, com: [1 mm, 2, 3]}\n", path),
    "is more than": lambda path: parameters("geometry: {r: 100, R: 250, L: 400}\nbodies: solids\n", path),
    "columns, got": lambda path: motion("t, y, z, theta\n0, 0, 0, 0\n0,1, 0, 0, 0\n", path),
    "a time after": lambda path: motion("t, y, z, theta\n0, 0, 0, 0\n0.1, 0, 0, 0\n0.1, 0, 0, 0\n", path),
    "a unit, a column": lambda path: motion(
        HEADER + "".join(f"{t}, {t}, 0, 0, 57, 0, 0, 0, 0, 0\n" for t in np.linspace(0, 0.2, 21)), path
    ),
    "look like waypoints": lambda path: motion(
        "t, y, z, theta\n0, 0, 0, 0\n1, 0.1, 0, 0\n2, 0, 0, 0\n3, 0.1, 0, 0\n", path
    ).remarks(),
    "is out of reach": lambda _: p3dof.load().sliders([0.5, 0, 0]),
    "crosses": crossing,
    "expected r < R": lambda _: p3dof.machine.Geometry(r=0.3, R=0.25),
    "to reach the platform": lambda _: p3dof.machine.Geometry(L=0.1),
    "principal moment": lambda _: p3dof.machine.Body(1.0, inertia=[1.0, 2.0, 4.0]),
    "load_friction: load-": loaded,
    "read as an open tree": open_tree,
    "the frame": lambda _: four_bar(closures=(p3dof.Closure("coupler_tip", "rocker_top"),)),
    "the joint": lambda _: four_bar(actuated=("crank",)),
    "the loops do not close": too_far,
    "not normalised": long_quaternion,
    "is open by": lambda _: four_bar().inverse_dynamics([0.9, -0.4, 1.0], [0, 0, 0], [0, 0, 0]),
    "cannot hold the mechanism": dead_point,
    "no actuator gives": no_motor,
    "holds another sweep": another_sweep,
    "expected a unit of": lambda path: motion("t, y [h], z, theta\n0, 0, 0, 0\n", path),
    "as the actuated joints have": lambda _: require_unit("--noise", Amount(FORCE, MOMENT)("3 N"), ["N m"]),
    "which the waypoints add up to": two_durations,
    "the axis falls or runs on": lambda _: [_words("A", Rating("way", np.inf, 0.0, "m", 0.0), None)],
    "Left out": lambda _: [loop_files(four_bar(actuated=("crank_joint", "rocker_joint"))).left_out],
    "a free motion of the mechanism": no_mass,
    "the number of candidates": lambda _: chosen_poses(np.ones((3, 1, 1)), np.ones(1), 4),
    "at a singular configuration, whose": flat_start,
}


@pytest.mark.parametrize("words", CAUSES)
def test_a_cause_has_the_message_of_the_page(words, tmp_path):
    (message,) = [one for one in QUOTED if words in one]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            said = " ".join(CAUSES[words](tmp_path) or ())
        except (p3dof.P3dofError, p3dof.errors.ModelWarning) as error:
            said = str(error)
    assert re.search(pattern(message), said)


def test_slips_on_the_command_line_have_the_messages_of_the_page(capsys):
    for word, arguments in (
        ("no such option …", ["compare", "--motoin"]),
        ("no such command …", ["comapre"]),
        ("expected … such as '5 …", ["simulate", "--rate", "5 kg"]),
        ("expected each name once, got … twice", ["tolerance", "--sigma", "R=1 mm", "--sigma", "R=2 mm"]),
        ("expected NAME=VALUE such as …, got …", ["tolerance", "--sigma", "R"]),
    ):
        assert word in QUOTED
        assert re.search(pattern(word), run(capsys, *arguments)[2])


def test_the_page_has_what_is_met_most():
    assert 40 <= len(QUOTED) == len(set(QUOTED))
    assert len(CAUSES) > len(QUOTED) / 2
