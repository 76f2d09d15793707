"""Every command alike: --json, --quiet, and - for the standard output."""

from __future__ import annotations

import copy
import csv
import io
import json

import click
import numpy as np
import pytest
import yaml
from command_line import commands, run
from documents import ROOT

import p3dof
from p3dof._base.files import SUFFIXES
from p3dof._base.tables import formatted, number, percent
from p3dof.cli.files import OutputFile
from p3dof.cli.output import plain

FIVE_BAR = ROOT / "docs" / "_static" / "gallery" / "five_bar.urdf"


def test_every_command_has_both_options_once():
    for name, command in commands():
        options = [option for one in command.params for option in one.opts]
        assert [options.count(option) for option in ("--json", "--quiet")] == [1, 1], name


def test_every_file_may_be_the_standard_output():
    count = 0
    for name, command in commands():
        for one in command.params:
            if isinstance(one.type, OutputFile):
                with click.Context(command) as context:
                    path = one.type.convert("-", one, context)
                    suffix = SUFFIXES[one.type._kind][0]
                    assert str(path) == "-" or (path.suffix == suffix and path.parent.is_dir()), name
                assert not path.exists()
                assert str(path) == "-" or not path.parent.exists()
                count += 1
    assert count > 40


CALLS = {
    "forces": ["forces", "--samples", "101"],
    "compare": ["compare", "--samples", "101", "--no-plot", "--out", "out"],
    "energy": ["energy", "--samples", "101"],
    "reactions": ["reactions", "--samples", "101"],
    "indices": ["indices", "--pose", "0,0,0"],
    "plan": ["plan", "task.yaml", "--duration", "2"],
    "size": ["size", "task.yaml", "--duration", "2"],
    "init": ["init", "new"],
    "doctor": ["doctor"],
    "completion": ["completion", "bash"],
    "urdf": ["urdf", "--out", "urdf"],
    "loop info": ["loop", "info", FIVE_BAR],
    "loop assemble": ["loop", "assemble", FIVE_BAR],
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")
    points = {"a": [-0.1, 0, -0.2], "b": [0.1, 0, 0.2], "c": [-0.1, 0, -0.2]}
    task = {"waypoints": [{"name": name, "pose": pose} for name, pose in points.items()]}
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(task))
    return tmp_path


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_json_is_one_document_with_what_is_printed_else(call, here, capsys):
    code, out, _ = run(capsys, *call, *(["--force"] if call[0] in ("init", "urdf") else []))
    again, text, err = run(capsys, *call, "--json", *(["--force"] if call[0] in ("init", "urdf") else []))
    data = json.loads(text)
    assert (again, err) == (code, "")
    assert {"tables", "notes", "warnings", "files"} <= set(data)
    for table in data["tables"]:
        assert table["title"] in out
        assert all(len(row) == len(table["header"]) for row in table["rows"])
        assert all(str(row[0]) in out for row in table["rows"])
    for line in (*data["notes"], *data["warnings"], *(f"wrote {name}" for name in data["files"])):
        assert all(part in out for part in line.splitlines())
    assert all((here / name).exists() for name in data["files"])
    assert any(data.values())


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_quiet_leaves_warnings_and_errors(call, here, capsys):
    more = ["--force"] if call[0] in ("init", "urdf") else []
    code, out, err = run(capsys, *call, *more)
    files = sorted(path.name for path in here.rglob("*"))
    again, silent, told = run(capsys, *call, "--quiet", *more)
    assert (again, silent) == (code, "")
    assert all(line in out + err for line in told.splitlines())
    assert sorted(path.name for path in here.rglob("*")) == files


@pytest.mark.usefixtures("here")
def test_numbers_of_the_document_are_not_rounded(capsys):
    data = json.loads(run(capsys, "forces", "--samples", "101", "--json")[1])
    forces = p3dof.load().inverse_dynamics(p3dof.paper_motion(101)).forces
    table = data["tables"][0]
    assert table["header"][1:3] == ["lowest [N]", "highest [N]"]
    for k, row in enumerate(table["rows"]):
        assert row[1:3] == [forces[:, k].min(), forces[:, k].max()]


@pytest.mark.usefixtures("here")
def test_warnings_are_in_the_document_or_aside(capsys):
    data = json.loads(run(capsys, "forces", "--samples", "5", "--json")[1])
    (warning,) = data["warnings"]
    assert "undersampled" in warning
    code, out, err = run(capsys, "forces", "--samples", "5", "--quiet")
    assert (code, out) == (0, "")
    assert "undersampled" in err


@pytest.mark.usefixtures("here")
def test_an_error_is_a_line_as_ever(capsys):
    for option in ("--json", "--quiet"):
        code, out, err = run(capsys, "forces", "--motion", "none.csv", option)
        assert (code, out) == (2, "")
        assert err.startswith("p3dof: error: ")


def test_a_table_or_a_parameter_file_goes_to_the_standard_output(here, capsys):
    code, out, err = run(capsys, "size", "task.yaml", "--duration", 2, "--out", "-")
    assert run(capsys, "size", "task.yaml", "--duration", 2, "--out", "ranking.csv")[0] == code
    assert out == (here / "ranking.csv").read_text()
    assert "Utilisation of ratings" in err
    assert next(csv.DictReader(io.StringIO(out)))["drive"]
    code, out, err = run(capsys, "balance", "task.yaml", "--duration", 2, "--kind", "constant", "--out", "-")
    assert (code, "wrote" in err) == (0, False)
    assert yaml.safe_load(out)["actuators"]["counterbalance"]


def test_a_robot_and_its_joints_go_to_the_standard_output(here, capsys):
    code, out, _ = run(capsys, "loop", "export", FIVE_BAR, "--out", "-")
    assert code == 0
    (here / "again.urdf").write_text(out)
    again = p3dof.load_robot(here / "again.urdf", FIVE_BAR.with_suffix(".yaml"))
    assert again.actuated == p3dof.load_robot(FIVE_BAR).actuated
    code, out, err = run(capsys, "loop", "assemble", FIVE_BAR, "--out", "-", "--quiet")
    assert (code, err) == (0, "")
    assert len(out.splitlines()) == 2


@pytest.mark.usefixtures("here")
def test_a_picture_is_bytes(capfdbinary):
    from p3dof.cli import main

    assert main(["forces", "--samples", "101", "--figure", "-"]) == 0
    out, err = capfdbinary.readouterr()
    assert out.startswith(b"\x89PNG\r\n")
    assert b"wrote" not in err


def test_what_takes_the_standard_output_twice_is_refused(here, capsys):
    for more, words in (
        (("--out", "-", "--json"), "--json and --out - both take the standard output"),
        (("--out", "-", "--figure", "-"), "only one file can be written to the standard output (-)"),
    ):
        assert run(capsys, "forces", *more) == (2, "", f"p3dof: error: {words}\n")
    (here / "designs.csv").write_text("R [mm]\n250\n")
    code, out, err = run(capsys, "designs", "designs.csv", "--out", "-", "--json")
    assert (code, out) == (2, "")
    assert "both take" in err


@pytest.mark.usefixtures("here")
def test_nothing_is_written_after_a_failure(capsys):
    code, out, err = run(capsys, "plan", "none.yaml", "--out", "-")
    assert (code, out) == (2, "")
    assert "none.yaml" in err


def test_plain_data():
    found = plain(
        {"a": np.array([1.0, np.nan]), "b": (np.float64(2), {"c": np.inf}), "d": np.arange(2), 3: "x"}
    )
    assert found == {"a": [1.0, None], "b": [2.0, {"c": None}], "d": [0, 1], "3": "x"}


@pytest.mark.usefixtures("here")
def test_numbers_that_tables_show_rounded_are_whole(capsys):
    """Of texts too, as tables of drives have them: a share is a share, what does not exist is null."""
    data = json.loads(run(capsys, "plan", "task.yaml", "--duration", "2", "--json")[1])
    task = p3dof.design.tasks.read_task("task.yaml")
    found = p3dof.design.forces_of_task(p3dof.load(), task.plan(duration=2))
    table = next(one for one in data["tables"] if one["title"] == "Utilisation of limits")
    row = next(row for row in table["rows"] if row[0] == "force A [N]")
    peak = np.abs(found.forces[:, 0]).max()
    assert row[1] == pytest.approx(peak, rel=1e-13)
    assert row[-1] == row[1] / p3dof.load().parameters.limits.force
    assert copy.deepcopy(formatted(1 / 3, ".2f")).value == 1 / 3
    assert plain((number(np.nan), formatted(1 / 3, ".2f"), percent(np.inf))) == [None, 1 / 3, None]
