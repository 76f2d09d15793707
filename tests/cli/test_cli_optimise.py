"""Design problems in files; `p3dof optimise`, `p3dof pareto` and `p3dof sweep` with them."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml
from design_problems import FILE, paper_problem
from documents import ROOT
from referencing import Registry, Resource

import p3dof
from p3dof._base.errors import P3dofError
from p3dof.cli import main
from p3dof.design.optimisation import MEASURES, DesignProblem, ProblemSweep, read_problem
from p3dof.design.optimisation.minimising import bounds_of
from p3dof.design.optimisation.problem import FIELDS, OF_SWEEPS

REFERENCE = ROOT / "docs/reference"
SCHEMA = json.loads((REFERENCE / "problem.schema.json").read_text(encoding="utf-8"))
PARAMETERS = json.loads((REFERENCE / "parameters.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(
    SCHEMA, registry=Registry().with_resource("parameters.schema.json", Resource.from_contents(PARAMETERS))
)


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    path = tmp_path / "problem.yaml"
    path.write_text(yaml.safe_dump(FILE, sort_keys=False), encoding="utf-8")
    return path


def changed(file: Path, place: str, value: Any) -> None:
    data = copy.deepcopy(FILE)
    *parents, last = place.split("/")
    inner = data
    for name in parents:
        inner = inner[name]
    inner[last] = value
    file.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")


def test_the_file_is_the_problem_that_python_makes(file: Path) -> None:
    ours, theirs = read_problem(file).settings(), paper_problem().settings()
    for name in ("modulus", "drive_stiffness", "box", "variables", "constraints"):
        assert json.dumps(ours.pop(name)).replace("0.1500000", "0.15") == json.dumps(theirs.pop(name)), name
    assert ours == theirs


def test_the_schema_has_all_fields_and_measures(file: Path) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert set(SCHEMA["properties"]) == {*FIELDS, *OF_SWEEPS}
    assert SCHEMA["$defs"]["measure"]["enum"] == list(MEASURES)
    VALIDATOR.validate(yaml.safe_load(file.read_text(encoding="utf-8")))


BAD = [
    ("variables/R", [1], "variables.R: expected a lower and an upper bound"),
    ("variables/R", ["1 kg", 2], "variables.R: expected a length"),
    ("variables", {}, "variables: expected fields, got nothing"),
    ("box", {"y": [0, 1]}, "box: the field 'theta' is missing"),
    ("box/theta", ["30 deg", "10 deg"], "box.theta: expected the lower end below"),
    ("box/grid", [1, 2], "box.grid: expected whole numbers from 2 to 201"),
    ("objectives", ["peak_forces"], "did you mean 'peak_force'"),
    ("objectives", [], "one measure or more"),
    ("constraints/singularity", {"least": 1}, "expected {'min': ...}"),
    ("constraints/singularity", {"min": "15 kg"}, "expected an angle"),
    ("constraints/relations", ["R = 1"], "character 3: no formula can go on"),
    ("bodies", "steel", "expected 'kept' or 'solids'"),
    ("modulus", "2 kg", "expected a modulus"),
    ("fixed", {"slider_edg": 1}, "unknown column"),
    ("objective", "width", "unknown field 'objective'"),
]


@pytest.mark.parametrize(("place", "value", "message"), BAD)
def test_what_does_not_fit_is_one_line_with_file_and_field(
    file: Path, capsys: pytest.CaptureFixture[str], place: str, value: Any, message: str
) -> None:
    changed(file, place, value)
    assert main(["optimise", "problem.yaml"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("p3dof: error: problem.yaml")
    assert message in told
    assert told.count("\n") == 1


def test_optimise_tells_the_optimum_and_writes_its_machine(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["optimise", file.name, "--subject-to", "width=0.5", "--starts", "2"]
    assert main([*command, "--out", "better.yaml", "--figure", "better.png"]) == 0
    told = capsys.readouterr().out
    assert "61.6491" in told
    assert "-48.60%" in told
    assert "largest force by Pinocchio" in told
    assert told.endswith("wrote better.yaml\nwrote better.png\n")
    assert Path("better.png").read_bytes().startswith(b"\x89PNG")
    forces = p3dof.load("better.yaml").inverse_dynamics(p3dof.paper_motion(201)).forces
    assert np.abs(forces).max() == pytest.approx(61.6491, abs=1e-3)
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["found"]["peak_force [N]"] == pytest.approx(61.6491, abs=1e-4)
    assert found["binding"][:2] == ["serial_reach ≥ 0.4", "width ≤ 0.5 m"]
    assert found["pinocchio"]["difference"] < 1e-9


def test_optimise_writes_a_page_that_compares_with_the_start(
    file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["optimise", file.name, "--starts", "1", "--report", "better.html"]) == 0
    assert capsys.readouterr().out.endswith("wrote better.html\n")
    page = Path("better.html").read_text(encoding="utf-8")
    assert "optimum" in page
    assert "119.9" in page
    assert "60.3" in page
    changed(file, "wrench", [0, 0, -5, 0, 0, 0])
    monkeypatch.setattr(DesignProblem, "minimise", None)  # it is refused before the work
    assert main(["optimise", file.name, "--starts", "1", "--report", "loaded.html"]) == 2
    assert "expected no wrench and no offset" in capsys.readouterr().err


def test_no_machine_is_exit_code_one_and_a_line(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = copy.deepcopy(FILE)
    data["fixed"] |= {name: data["variables"].pop(name)[0] for name in ("r", "rod_radius")}
    data["constraints"]["width"] = {"max": "200 mm"}
    file.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    assert main(["optimise", file.name, "--out", "better.yaml"]) == 1
    told = capsys.readouterr().err
    assert "no design satisfies all constraints: width ≤ 0.2 m and the bound R ≥ 0.15 m conflict" in told
    assert "one must be relaxed, width ≤ 0.2 m by 0.1 m or the bound R ≥ 0.15 m by 0.05 m at least" in told
    assert told.count("\n") == 1
    assert not Path("better.yaml").exists()
    for bad in ("width", "=3", "width="):
        assert main(["optimise", file.name, "--subject-to", bad]) == 2
        assert "expected NAME=VALUE such as 'width=500 mm', got " in capsys.readouterr().err


LENGTHS = "--subject-to: width: expected a length, a number in m or one with a unit such as '1 mm', "


@pytest.mark.parametrize("command", ["optimise", "pareto"])
@pytest.mark.parametrize(
    ("bound", "words"),
    [
        ("width=wide", LENGTHS + "got 'wide'"),
        ("width=5 kg", LENGTHS + "got '5 kg'"),
        ("width=0,5", LENGTHS + "got '0,5'; with a decimal point it is 0.5"),
        ("width=nan", "width: expected a finite number"),
        ("peak_power=1 N", "expected a power, a number in W or one with a unit such as '1 kW'"),
        ("room=1 l", "room: expected a number in m³, got '1 l'"),
        ("transmission=5 %", "transmission: expected a number without a unit, got '5 %'"),
        ("widths=0.5", "unknown measure 'widths'; did you mean 'width'"),
    ],
)
def test_a_bound_in_another_unit_is_one_line(
    file: Path, capsys: pytest.CaptureFixture[str], command: str, bound: str, words: str
) -> None:
    assert main([command, file.name, "--subject-to", bound]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1


def test_a_bound_has_a_unit_of_its_measure(file: Path) -> None:
    """Each unit by hand: powers, times, frequencies and stresses too; what has no other unit, in its own."""
    problem = read_problem(file)
    for name, text, value in (
        ("width", "500 mm", 0.5),
        ("width", "0.5", 0.5),
        ("peak_power", "0.3 kW", 300.0),
        ("fastest_time", "800ms", 0.8),
        ("lowest_frequency", "0.02 kHz", 20.0),
        ("rms_torque", "1200 N mm", 1.2),
        ("rod_stress", "90 MPa", 90e6),
        ("energy", "0.01 kJ", 10.0),
        ("moving_mass", "4500 g", 4.5),
        ("life", "20000 h", 20000.0),
        ("room", "0.2 m³", 0.2),
        ("transmission", "0.3", 0.3),
    ):
        (found,) = bounds_of(problem, {name: text})
        assert found.bound == pytest.approx(value, rel=1e-15), name
        (plain,) = bounds_of(problem, {name: value})
        assert (plain.measure, plain.at_least) == (found.measure, found.at_least)


def test_pareto_tells_the_front_and_goes_on(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changed(file, "objectives", ["peak_force", "width"])
    command = ["pareto", file.name, "--points", "5", "--store", "state"]
    assert main([*command, "--out", "front.csv", "--figure", "front.svg"]) == 0
    told = capsys.readouterr().out
    assert "Pareto front of 5 designs" in told
    assert "start" in told
    assert "<svg" in Path("front.svg").read_text(encoding="utf-8")
    assert len(Path("front.csv").read_text(encoding="utf-8").splitlines()) == 6
    kept = {path: path.stat().st_mtime_ns for path in Path("state").glob("*.npz")}
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["front"]
    assert found["peak_force [N]"][-1] == pytest.approx(60.3069, abs=1e-3)
    assert {path: path.stat().st_mtime_ns for path in Path("state").glob("*.npz")} == kept
    changed(file, "objectives", ["peak_force", "moving_mass"])
    assert main(command) == 2
    assert "holds another optimisation: problem.objectives" in capsys.readouterr().err


def test_the_same_file_is_swept_block_by_block(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", file.name, "--out", "found"]) == 2
    assert "count: expected how many designs there are" in capsys.readouterr().err
    changed(file, "count", 900)
    assert main(["optimise", file.name, "--starts", "1"]) == 0  # the field is for sweeps
    capsys.readouterr()
    assert main(["sweep", file.name, "--out", "found"]) == 0
    assert "Pareto front of min peak_force, min width, min rms_power" in capsys.readouterr().out
    swept = p3dof.blocks.Sweep.load("found")
    columns = swept.columns()
    problem = read_problem(file)
    designs = np.column_stack([columns[name] for name in problem.variables.names])
    again = problem.evaluate(designs)
    np.testing.assert_array_equal(columns["violation"], again.violation)
    good = again.feasible
    assert good.any()
    np.testing.assert_array_equal(columns["peak_force"][good], again["peak_force"][good])
    assert np.isnan(columns["peak_force"][~good]).all()


def test_a_sweep_of_a_problem_goes_on_and_takes_clients(tmp_path: Path) -> None:
    from p3dof._base.blocks import Processes, TopK

    problem = paper_problem()
    best = TopK("peak_force", 3)
    alone = problem.sweep(600, tmp_path / "a", block_size=150, reductions=[best])
    with Processes(2) as client:
        beside = problem.sweep(600, tmp_path / "b", block_size=150, client=client, reductions=[best])
    ours, theirs = (made.reductions[best.name].columns for made in (alone, beside))
    for name, column in ours.items():
        np.testing.assert_array_equal(column, theirs[name])
    next((tmp_path / "a").rglob("0000000002.npz")).unlink()
    again = problem.sweep(600, tmp_path / "a", block_size=150, reductions=[best], resume=True)
    assert again.computed == 1
    with pytest.raises(P3dofError, match="holds another sweep"):
        paper_problem(modulus=70e9).sweep(600, tmp_path / "a", block_size=150, resume=True)
    assert ProblemSweep(problem, 10).units["peak_force"] == "N"
