"""Machines and tasks side by side: numbers of each, differences, which is better, and the command."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import re
import shlex

import numpy as np
import pytest

import p3dof
from p3dof import report
from p3dof._base.errors import InputError, ReachError
from p3dof.cli import main
from p3dof.design.bearings import Bearing, Bearings
from p3dof.design.design_comparison import comparison_table, verdicts_table
from p3dof.design.drives import GENERIC
from p3dof.design.forces_of_tasks import SEAL_FRICTION, USUAL_FRICTION
from p3dof.machine import Friction
from p3dof.report import plots

WIDE = dataclasses.replace(p3dof.PAPER, geometry=dataclasses.replace(p3dof.PAPER.geometry, R=0.28))
TASK = p3dof.Task(
    [
        p3dof.Waypoint([0, 0, 0], "home"),
        p3dof.Waypoint([0.15, 0.02, 0.2], "there", dwell=0.1),
        p3dof.Waypoint([0, 0, 0], "back"),
    ],
    "there and back",
)
PARTS = Bearings(Bearing(5100.0, 2400.0))
HOSTILE = "<script>alert(1)</script>"


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(scope="module")
def found():
    pair = {"paper": p3dof.PAPER, HOSTILE: WIDE}
    (one,) = p3dof.compare_designs(
        pair, TASK, duration=1.0, drives=GENERIC, bearings=PARTS, samples=401, frictionless=True
    )
    return one


def test_the_numbers_are_those_of_each_machine(found):
    for k, parameters in enumerate((p3dof.PAPER, WIDE)):
        robot = p3dof.load(parameters)
        alone = p3dof.design.forces_of_task(robot, TASK.plan(1.0, 401))
        best = p3dof.size_drives(robot, alone, GENERIC, frictionless=True)[0]
        power = alone.power
        speeds = np.abs(alone.slider_velocities).max(axis=0)
        for leg in range(3):
            name = "ABC"[leg]
            assert found[f"peak force of {name}"].values[k] == alone.peak_forces[leg]
            assert found[f"rms force of {name}"].values[k] == pytest.approx(alone.rms_forces[leg], rel=1e-9)
            assert found[f"top speed of {name}"].values[k] == speeds[leg]
        assert found["peak power"].values[k] == pytest.approx(power.max(), rel=1e-9)
        works = [np.trapezoid(side(power, 0), alone.time) for side in (np.maximum, np.minimum)]
        assert found["work supplied per cycle"].values[k] == pytest.approx(works[0], rel=1e-9)
        assert found["work regenerated per cycle"].values[k] == pytest.approx(-works[1], rel=1e-9)
        assert found["cycle time"].values[k] == pytest.approx(1.0, rel=1e-12)
        assert found["peak power of the bus"].values[k] == best.bus_peak_power
        worst = max(best.worst[1].share, *(use.share for use in alone.utilisations(parameters.limits)))
        assert found["highest utilisation"].values[k] == pytest.approx(100 * worst, rel=1e-9)
        assert found["moving mass"].values[k] == parameters.bodies.mass
        lives = p3dof.assess(robot, alone, bearings=PARTS).bearings.bearings
        assert found["shortest life of bearings"].values[k] == pytest.approx(min(one.hours for one in lives))
        singular = min(np.abs(result.actuation).min() for result in alone.results)
        assert found["nearest singularity"].values[k] == pytest.approx(math.degrees(singular))


def test_the_room_is_that_of_the_joints(found):
    """Sliders and their hinges stand on three sides at the distance R; what else there is lies within."""
    for k, R in enumerate((0.25, 0.28)):
        assert found["footprint of the joints"].values[k] == pytest.approx(2 * R * R, rel=0.3)
    robot = p3dof.load()
    loads = robot.reactions(TASK.plan(1.0, 401).motion, "paper")
    x, y, z = np.ptp(loads.positions.reshape(-1, 3), axis=0)
    assert found["footprint of the joints"].values[0] == pytest.approx(x * y, rel=1e-3)
    assert found["height of the joints"].values[0] == pytest.approx(z, rel=1e-3)


def test_differences_and_directions(found):
    for measure in found.measures:
        one, other = measure.values
        assert measure.differences[0] == 0
        if one:
            assert measure.differences[1] == pytest.approx((other - one) / abs(one), rel=1e-12)
        if measure.best is not None:
            better = min if measure.better == "lower" else max
            assert measure.values[measure.best] == better(measure.values)
            assert abs(other - one) > 5e-4 * min(abs(one), abs(other))
    assert found["moving mass"].best is None
    assert found["footprint of the joints"].best == 0
    rows = {row[0]: row[1:] for row in comparison_table(found).rows}
    measure = found["rms force of A"]
    first, _, more, best = rows["rms force of A [N]"]
    assert float(first) == pytest.approx(measure.values[0], rel=1e-4)
    assert more == f"{100 * measure.differences[1]:+.1f} %"
    assert best == f"{found.names[measure.best]} (lower)"
    assert rows["moving mass [kg]"][2:] == ("+0.0 %", "–")
    assert [row[0] for row in verdicts_table(found).rows] == list(found.names)
    with pytest.raises(InputError, match="measure: expected one of"):
        found["beauty"]


def test_the_friction_that_is_assumed_of_one_machine_is_told(found):
    """Forces of a machine that has none of its own count that of guides, which the other has given."""
    rough = dataclasses.replace(p3dof.PAPER, friction=Friction(coulomb={"sliders": 6.0}))
    pair = {"rough": rough, "silent": WIDE, "plain": p3dof.PAPER}
    (given,) = p3dof.compare_designs(pair, TASK, duration=1.0, drives=GENERIC, samples=401)
    note = verdicts_table(given).note
    assert f"Assumed of silent, plain: {USUAL_FRICTION}." in note
    more = given["peak force of A"].values[2] - found["peak force of A"].values[0]
    assert 0.5 * SEAL_FRICTION < more < 2 * SEAL_FRICTION
    assert "Assumed" not in verdicts_table(found).note


def test_one_machine_with_itself_is_no_better():
    (found,) = p3dof.compare_designs({"one": p3dof.PAPER, "two": p3dof.load()})
    assert found.title == "the paper's motion"
    assert all(measure.best is None for measure in found.measures)
    assert all((measure.differences == 0).all() for measure in found.measures)


def test_each_machine_may_have_drives_of_its_own():
    own = {"a": list(GENERIC)[:1], "b": list(GENERIC)[-1:]}
    (found,) = p3dof.compare_designs(
        dict.fromkeys(own, p3dof.PAPER), TASK, duration=1.0, drives=own, samples=401, frictionless=True
    )
    alone = p3dof.design.forces_of_task(p3dof.load(), TASK.plan(1.0, 401))
    for k, drives in enumerate(own.values()):
        (best,) = p3dof.size_drives(p3dof.load(), alone, drives, frictionless=True)
        torques = [axis.rms_torque for axis in best.axes]
        assert found["rms torque of the motors"].values[k] == pytest.approx(max(torques), rel=1e-12)
    assert found["rms torque of the motors"].best is not None
    with pytest.raises(InputError, match=r"drives: expected those of a, b, got a$"):
        p3dof.compare_designs(dict.fromkeys("ab", p3dof.PAPER), TASK, duration=1.0, drives={"a": own["a"]})


def test_tasks_of_one_machine_and_the_fastest():
    light = p3dof.Task((*TASK.waypoints[:2], p3dof.Waypoint([0, 0, 0])))
    slow = p3dof.load(dataclasses.replace(p3dof.PAPER, limits=p3dof.machine.Limits(force=150.0)))
    (found,) = p3dof.compare_designs(
        {"machine": slow}, {"one": TASK, "two": light}, fastest=True, samples=401
    )
    assert (found.title, found.names) == ("machine", ("one", "two"))
    plan = p3dof.design.fastest_plan(slow, TASK, samples=401)
    assert found["cycle time"].values[0] == plan.duration
    assert found["peak force of A"].values[0] <= 150.0 * 1.001
    two = p3dof.compare_designs({"a": slow, "b": p3dof.PAPER}, {"one": TASK, "two": light}, duration=1.0)
    assert [one.title for one in two] == ["one", "two"]


def test_a_machine_that_cannot_is_named():
    short = dataclasses.replace(p3dof.PAPER, geometry=dataclasses.replace(p3dof.PAPER.geometry, L=0.27))
    far = p3dof.Task([p3dof.Waypoint([0, 0, 0]), p3dof.Waypoint([0.2, 0, 0])])
    with pytest.raises(ReachError, match=r"^short: "):
        p3dof.compare_designs({"paper": p3dof.PAPER, "short": short}, far, duration=1.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (({"one": p3dof.PAPER},), "at least two"),
        (([p3dof.PAPER],), "designs: expected a mapping"),
        (({"one": 3, "two": p3dof.PAPER},), "designs: one: expected a Manipulator"),
        (({"one": p3dof.PAPER, "two": WIDE}, 3), "tasks: expected a mapping"),
        (({"one": p3dof.PAPER, "two": WIDE}, {"task": 3}), "tasks: task: expected a Task"),
        (({"one": p3dof.PAPER, "two": WIDE}, {}), "tasks: expected at least one"),
    ],
)
def test_bad_arguments(arguments, words):
    with pytest.raises(InputError, match=words):
        p3dof.compare_designs(*arguments)


def test_the_figure_lays_the_curves_over_each_other(found):
    figure = plots.comparison_figure(found)
    assert len(figure.axes) == 6
    for leg in range(3):
        for k, one in enumerate(found.assessments):
            drawn = figure.axes[2 * leg].lines[k]
            np.testing.assert_array_equal(drawn.get_ydata(), one.found.forces[:, leg])
            assert drawn.get_label() == one.name
    with pytest.raises(InputError, match="found"):
        plots.comparison_figure(3)


def test_the_page_says_it_all_and_trusts_nobody(found):
    text = report.render_designs([found], title="Two")
    assert HOSTILE not in text
    assert "Comparison: there and back" in text
    assert text.count("<img ") == 1
    assert "All of them" in text
    for one in found.assessments:
        assert one.verdict in text
    with pytest.raises(InputError, match="found"):
        report.render_designs([])
    assert found.names[0] in found._repr_html_()


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    p3dof.write_parameters(p3dof.PAPER, "a.yaml")
    p3dof.write_parameters(WIDE, "b.yaml")
    p3dof.write_task(TASK, "task.yaml")
    far = p3dof.Task([p3dof.Waypoint([0, 0, 0]), p3dof.Waypoint([0.6, 0, 0], "there")])
    p3dof.write_task(far, "far.yaml")
    return tmp_path


def test_the_command_prints_and_writes(files, capsys):
    line = ["compare-designs", "a.yaml", "b.yaml", "--task", "task.yaml", "--duration", 1, "--samples", 201]
    code, out, err = run(capsys, *line, "--out", "t.csv", "--report", "t.html", "--figure", "t.png")
    assert (code, err) == (0, "")
    assert "Comparison: task" in out
    assert re.search(r"rms force of A \[N\] +[\d.]+ +[\d.]+ +[+-][\d.]+ % +[ab] \(lower\)", out)
    assert all(f"wrote {name}" in out for name in ("t.csv", "t.html", "t.png"))
    with (files / "t.csv").open(encoding="utf-8", newline="") as lines:
        table = list(csv.DictReader(lines))
    code, out, err = run(capsys, *line, "--json")
    (data,) = json.loads(out)["comparisons"]
    assert (code, err) == (0, "")
    assert [one["name"] for one in data["designs"]] == ["a", "b"]
    for row, measure in zip(table, data["measures"], strict=True):
        assert row["measure"] == measure["name"]
        assert [float(row["a"]), float(row["b"])] == measure["values"]
        assert row["best"] == (measure["best"] or "")
    text = (files / "t.html").read_text(encoding="utf-8")
    again = shlex.split(re.findall(r"<pre>(.*?)</pre>", text)[0])
    assert again[:5] == ["p3dof", "compare-designs", "a.yaml", "b.yaml", "--task=task.yaml"]
    (files / "t.html").unlink()
    assert run(capsys, *again[1:])[0] == 0
    assert (files / "t.html").exists()


def test_tasks_on_the_command_line(files, capsys):
    (files / "other.yaml").write_text((files / "task.yaml").read_text("utf-8"), "utf-8")
    code, out, _ = run(
        capsys, "compare-designs", "task.yaml", "other.yaml", "--duration", 1, "--samples", 101, "--json"
    )
    assert code == 0
    assert [one["name"] for one in json.loads(out)["comparisons"][0]["designs"]] == ["task", "other"]


def test_bad_input_is_one_line_and_leaves_nothing(files, capsys):
    (files / "file").touch()
    before = sorted(files.rglob("*"))
    outputs = ["--out", "x/t.csv", "--report", "x/t.html"]
    for arguments, words in (
        (("a.yaml",), "at least two"),
        (("a.yaml", "task.yaml"), "task.yaml is a task and a.yaml a machine"),
        (("a.yaml", "none.yaml"), "none.yaml: cannot be read"),
        (("a.yaml", "a.yaml"), "given twice"),
        (("a.yaml", "b.yaml", "--task", "b.yaml"), "expected a task, got the parameters of a machine"),
        (("a.yaml", "b.yaml", "--task", "task.yaml"), "--duration"),
        (("a.yaml", "b.yaml", "--duration", 1), "--duration"),
        (("a.yaml", "b.yaml", "--task", "far.yaml", "--duration", 1), "a: "),
        (("a.yaml", "b.yaml", "--drives", "none.yaml"), "none.yaml: cannot be read"),
        (("task.yaml", "far.yaml", "--task", "task.yaml"), "--task"),
        (("a.yaml", "b.yaml", "--parameters", "a.yaml"), "--parameters"),
        (("a.yaml", "b.yaml", "--report", "t.docx"), "ends in .html or .pdf"),
        (("a.yaml", "b.yaml", "--out", "file/t.csv"), "cannot be written"),
        (("-", "b.yaml"), "by their names"),
    ):
        extra = [] if {"--out", "--report"} & set(arguments) else outputs
        code, out, err = run(capsys, "compare-designs", *arguments, *extra)
        assert code in (1, 2)
        assert out == ""
        assert re.fullmatch(r"p3dof: error: [^\n]*\n", err), err
        assert words in err
        assert sorted(files.rglob("*")) == before
