"""Sweeps over machines: the forces of `forces_of_designs`, from a file, on the command line."""

from __future__ import annotations

import copy
import json
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from referencing import Registry, Resource
from sweep_problems import wait_until
from test_blocks import PARQUET, environment

import p3dof
from p3dof import blocks, plots, sweeps
from p3dof.cli import main

REFERENCE = Path(__file__).parents[1] / "docs/reference"
SCHEMA = json.loads((REFERENCE / "sweep.schema.json").read_text(encoding="utf-8"))
PARAMETERS = json.loads((REFERENCE / "parameters.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(
    SCHEMA,
    registry=Registry().with_resource("parameters.schema.json", Resource.from_contents(PARAMETERS)),
)
MISSING = object()
FILE = {
    "motion": {"paper": 21},
    "variables": {
        "R": {"uniform": ["240 mm", 0.28]},
        "L": {"log-uniform": [0.38, "50 cm"]},
        "platform.mass": {"normal": ["8 kg", "200 g"]},
    },
    "sampling": "sobol",
    "count": 120,
    "block_size": 50,
    "seed": 4,
    "figures": ["singularity", "sliders"],
    "reductions": [
        {"top": "peak_force", "count": 5},
        {"pareto": {"peak_force": "min", "reach": "max"}},
        {"histogram": "peak_force", "from": 80, "to": 160, "bins": 8},
        {"moments": ["peak_force", "reach"]},
    ],
}


def changed(place, value, start=FILE):
    """A file with one field set, added or (MISSING) left out."""
    data = copy.deepcopy(start)
    *outer, last = place.split("/")
    target = data
    for key in outer:
        target = target[int(key) if isinstance(target, list) else key]
    if value is MISSING:
        del target[last]
    else:
        target[int(last) if isinstance(target, list) else last] = value
    return data


def written(folder, data):
    path = folder / "sweep.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    return sweeps.read_sweep(written(folder, FILE)).run(folder / "out")


def test_figures_are_those_of_the_designs(made):
    columns = made.columns()
    inputs = {name: columns[name] for name in ("geometry.R", "geometry.L", "bodies.platform.mass")}
    assert columns["geometry.R"].min() >= 0.24
    assert columns["geometry.L"].max() <= 0.5
    assert abs(columns["bodies.platform.mass"].mean() - 8) < 0.05
    found = p3dof.forces_of_designs(inputs, p3dof.paper_motion(21), figures=("singularity", "sliders"))
    for i, leg in enumerate("abc"):
        # The same formulas, whose last bits may depend on how designs stand side by side in lanes.
        np.testing.assert_allclose(columns[f"peak_force_{leg}"], found.peak_force[:, i], rtol=1e-14)
    np.testing.assert_allclose(columns["peak_force"], found.peak_force.max(axis=1), rtol=1e-14)
    np.testing.assert_array_equal(columns["status"], found.status)
    best = made.reductions["5 smallest peak_force"]
    assert best.index.tolist() == np.argsort(columns["peak_force"], kind="stable")[:5].tolist()


def test_designs_are_the_forces_of_the_robot(made):
    columns = made.columns()
    machine = p3dof.PAPER.to_dict()
    machine["geometry"] |= {"R": columns["geometry.R"][77], "L": columns["geometry.L"][77]}
    machine["bodies"]["platform"]["mass"] = columns["bodies.platform.mass"][77]
    robot = p3dof.load(p3dof.Parameters.from_dict(machine))
    forces = robot.inverse_dynamics(p3dof.paper_motion(21), method="pinocchio").forces
    assert columns["peak_force"][77] == pytest.approx(np.abs(forces).max(), rel=1e-10)


def test_designs_that_cannot_have_a_reason_and_no_numbers(tmp_path):
    data = changed("variables/L", {"uniform": [0.16, 0.3]})
    made = sweeps.read_sweep(written(tmp_path, data)).run(tmp_path / "out")
    columns = made.columns()
    cannot = columns["status"] != 0
    assert 0 < cannot.sum() < 120
    assert np.isnan(columns["peak_force"][cannot]).all()
    assert np.isfinite(columns["peak_force"][~cannot]).all()
    assert made.reductions["histogram of peak_force"].invalid == cannot.sum()


@pytest.mark.parametrize("kind", ["csv", pytest.param("parquet", marks=PARQUET)])
def test_rows_of_a_file_are_the_inputs(tmp_path, kind):
    rng = np.random.default_rng(3)
    R, mass = rng.uniform(240, 280, 130), rng.uniform(7, 9, 130)
    path = tmp_path / f"designs.{kind}"
    if kind == "csv":
        lines = [f"{a!r},{b!r}" for a, b in zip(R.tolist(), mass.tolist(), strict=True)]
        path.write_text("\n".join(["R [mm],platform.mass", *lines]) + "\n", encoding="utf-8")
    else:
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table({"R [mm]": R, "platform.mass": mass}), path, row_group_size=40)
    data = {"motion": {"paper": 21}, "rows": path.name, "block_size": 33}
    plan = sweeps.read_sweep(written(tmp_path, data))
    made = plan.run(tmp_path / "out")
    np.testing.assert_array_equal(made.columns()["geometry.R"], R / 1000)
    np.testing.assert_array_equal(made.columns()["bodies.platform.mass"], mass)
    path.write_bytes(path.read_bytes().replace(b"R", b"L", 1))
    with pytest.raises(p3dof.P3dofError):
        sweeps.read_sweep(tmp_path / "sweep.yaml").run(tmp_path / "out", resume=True)


def test_a_problem_goes_through_pickle(made):
    plan = sweeps.read_sweep(written(made.folder.parent, FILE))
    again = pickle.loads(pickle.dumps(plan.problem))  # noqa: S301 - ours
    block = made.manifest.block(1)
    for name, values in again.compute(block).items():
        np.testing.assert_array_equal(values, made.columns([name])[name][50:100])


def test_another_machine_or_motion_is_not_resumed(made, tmp_path):
    other = changed("machine", p3dof.PAPER.carrying(p3dof.Body(1, np.zeros(3), np.ones(3))).to_dict())
    with pytest.raises(p3dof.SweepError, match=r"settings\.machine\.payload is only here"):
        sweeps.read_sweep(written(tmp_path, other)).run(made.folder, resume=True)
    with pytest.raises(p3dof.SweepError, match=r"settings\.motion\.samples is 21 there, 22 here"):
        sweeps.read_sweep(written(tmp_path, changed("motion", {"paper": 22}))).run(made.folder, resume=True)


ONE = {"R": {"values": [0.25, "26 cm"]}}
GRID = changed("sampling", "grid", changed("count", MISSING, changed("variables", ONE)))
ROWS = {"rows": "designs.csv"}
ACCEPTED = {
    "all": FILE,
    "a grid": GRID,
    "a grid that is not told": changed("sampling", MISSING, GRID),
    "random numbers": changed("sampling", MISSING),
    "rows": ROWS,
    "no motion": changed("motion", MISSING),
    "a motion file": changed("motion", "motion.csv"),
    "samples of a motion file": changed("motion", {"file": "motion.csv", "samples": 11}),
    "a machine file": changed("machine", "machine.yaml"),
    "a machine": changed("machine", p3dof.PAPER.to_dict()),
    "solids": changed("bodies", "solids"),
    "a wrench": changed("wrench", [0, 0, 5, 0, 0, 0.5]),
    "nothing kept": changed("keep", "none"),
    "a column kept": changed("keep", ["peak_force"]),
    "no reductions": changed("reductions", []),
    "a coarse front": changed("reductions/1/resolution", {"reach": 0.01}),
    "the mean of one": changed("reductions/3/moments", "reach"),
    "the largest": changed("reductions/0/largest", True),
}
REFUSED = {
    "an unknown field": changed("machines", "machine.yaml"),
    "no variables": changed("variables", MISSING),
    "empty variables": changed("variables", {}),
    "a variable without a spread": changed("variables/R", {}),
    "two spreads": changed("variables/R", {"uniform": [0.2, 0.3], "normal": [0.2, 0.1]}),
    "an unknown spread": changed("variables/R", {"triangular": [0.2, 0.3]}),
    "one number of a range": changed("variables/R", {"uniform": [0.2]}),
    "a number as a range": changed("variables/R", {"uniform": 0.2}),
    "text as a number": changed("variables/R", {"uniform": ["small", 0.3]}),
    "an unknown sampling": changed("sampling", "halton"),
    "a count of zero": changed("count", 0),
    "text as a count": changed("count", "many"),
    "rows and variables": {**FILE, **ROWS},
    "rows and a count": {**ROWS, "count": 5},
    "an unknown motion": changed("motion", {"samples": 5}),
    "unknown bodies": changed("bodies", "new"),
    "unknown figures": changed("figures", ["speed"]),
    "a negative seed": changed("seed", -1),
    "an unknown format": changed("format", "csv"),
    "a block of nothing": changed("block_size", 0),
    "an unknown reduction": changed("reductions/0", {"best": "reach"}),
    "an unknown field of one": changed("reductions/0/bins", 5),
    "no top": changed("reductions/0/count", 0),
    "a direction that is none": changed("reductions/1/pareto", {"reach": "high"}),
    "a histogram without an end": changed("reductions/2/to", MISSING),
    "a number as a column": changed("reductions/0/top", 5),
    "reductions as a mapping": changed("reductions", {"top": "reach"}),
}


def run(tmp_path, data):
    p3dof.write_parameters(p3dof.PAPER, tmp_path / "machine.yaml")
    p3dof.paper_motion(51).to_csv(tmp_path / "motion.csv")
    (tmp_path / "designs.csv").write_text("R,L\n.25,.4\n.26,.41\n", encoding="utf-8")
    return sweeps.read_sweep(written(tmp_path, data)).run(tmp_path / "out")


@pytest.mark.parametrize("data", ACCEPTED.values(), ids=ACCEPTED)
def test_the_schema_and_the_program_both_accept(data, tmp_path):
    VALIDATOR.validate(data)
    assert run(tmp_path, data).complete


@pytest.mark.parametrize("data", REFUSED.values(), ids=REFUSED)
def test_the_schema_and_the_program_both_refuse(data, tmp_path):
    assert not VALIDATOR.is_valid(data)
    with pytest.raises(p3dof.P3dofError):
        run(tmp_path, data)


WRONG = {
    r"sweep\.yaml: .*unknown column 'Rr'": changed("variables", {"Rr": {"uniform": [0.2, 0.3]}}),
    r"sweep\.yaml: variables\.geometry\.R\.uniform: expected a length": changed(
        "variables/R", {"uniform": ["1 kg", 0.3]}
    ),
    r"variables\.geometry\.R: low, high: expected low < high": changed(
        "variables/R", {"uniform": [0.3, 0.2]}
    ),
    r"sweep\.yaml: count: expected how many designs": changed("count", MISSING),
    r"expected `values` of each variable of a grid, got a count besides": changed("count", 5, GRID),
    r"sweep\.yaml: reductions\[0\]: 5 smallest peak_forc: unknown column 'peak_forc'; "
    r"did you mean peak_force or ": changed("reductions/0/top", "peak_forc"),
    r"sweep\.yaml: reductions\[1\]: Pareto front of min mass: unknown column .mass.;": changed(
        "reductions/1/pareto", {"mass": "min"}
    ),
    r"sweep\.yaml: keep: unknown column 'peak'": changed("keep", ["peak"]),
    r"sweep\.yaml: sampling: expected random, latin-hypercube, sobol or grid, got 'soboll'": changed(
        "sampling", "soboll"
    ),
    r"sweep\.yaml: motion: there is no file .*nowhere\.csv; names count from the folder": changed(
        "motion", "nowhere.csv"
    ),
    r"sweep\.yaml: motion: there is no file .*other\.csv": changed("motion", {"file": "other.csv"}),
    r"sweep\.yaml: wrench: there is no file .*load\.csv": changed("wrench", "load.csv"),
    r"sweep\.yaml: rows: there is no file .*nowhere\.csv": {"rows": "nowhere.csv"},
    r"reductions\[2\]: low, high: expected room for 8 bins": changed("reductions/2/to", 1),
    r"sweep\.yaml: machine: there is no file .*nowhere\.yaml": changed("machine", "nowhere.yaml"),
}


@pytest.mark.parametrize("message", WRONG)
def test_what_is_wrong_is_named(message, tmp_path):
    with pytest.raises(p3dof.P3dofError, match=message):
        run(tmp_path, WRONG[message])


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert set(SCHEMA["properties"]) == set(sweeps.problem_file.FIELDS)


def test_the_command_line_computes_and_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, FILE)
    assert main(["sweep", "sweep.yaml", "--out", "out", "--figure", "found.png"]) == 0
    told = capsys.readouterr().out
    assert "120 of 120 items in 3 of 3 blocks, seed 4" in told
    assert "5 smallest peak_force" in told
    for unit in ("geometry.R [m]", "peak_force [N]", "reach [m]"):
        assert unit in " ".join(told.split())
    assert told.endswith("wrote out\n")
    assert (tmp_path / "found.png").read_bytes().startswith(b"\x89PNG")
    assert main(["sweep", "sweep.yaml", "--out", "out"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("p3dof: error: ")
    assert error.endswith("holds 3 of 3 blocks of this sweep; to go on: --resume\n")
    assert main(["sweep", "sweep.yaml", "--out", "out", "--resume"]) == 0
    assert capsys.readouterr().out.endswith("nothing was missing: all 3 blocks were in out\n")
    next((tmp_path / "out").rglob("0000000001.npz")).unlink()
    assert main(["sweep", "sweep.yaml", "--out", "out", "--resume"]) == 0
    assert capsys.readouterr().out.endswith("computed 1 of 3 blocks, those that were missing, in out\n")
    assert main(["sweep", "sweep.yaml", "--out", "o", "--workers", "2", "--scheduler", "tcp://x"]) == 2


def test_ctrl_c_on_the_command_line_ends_in_one_line_and_goes_on_with_workers(tmp_path):
    data = changed("count", 400_000, changed("block_size", 500, changed("keep", ["peak_force"])))
    written(tmp_path, data)
    command = [sys.executable, "-m", "p3dof", "sweep", "sweep.yaml", "--out", "out", "--workers", "1"]
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment(), stderr=subprocess.PIPE, text=True
    ) as program:
        wait_until(lambda: len(list(tmp_path.rglob("*.npz"))) >= 3)
        os.kill(program.pid, signal.SIGINT)
        error = program.stderr.read()
        assert program.wait(60) == 130
    assert error.startswith("p3dof: error: interrupted: ")
    assert error.count("\n") == 1
    assert "of 800 blocks are in" in error
    assert error.endswith("to go on: --resume\n")
    left = blocks.Sweep.load(tmp_path / "out")
    assert 3 <= len(left.numbers) < 800
    for block, columns in left.blocks():
        assert len(columns["peak_force"]) == len(block)


def test_the_figure_has_a_panel_for_each_histogram_and_front(made):
    pytest.importorskip("matplotlib", reason="matplotlib not installed")
    figure = plots.sweep_figure(made)
    assert [axis.get_xlabel() for axis in figure.axes] == ["peak_force [N] (small is good)", "peak_force [N]"]
    front, counts = figure.axes
    assert front.get_ylabel() == "reach [m] (large is good)"
    assert all(tick == round(tick) for tick in counts.get_yticks())
    points = made.reductions["Pareto front of min peak_force, max reach"]
    np.testing.assert_array_equal(front.lines[0].get_ydata(), points.columns["reach"])
    drawn = counts.patches[0].get_data().values
    np.testing.assert_array_equal(drawn, made.reductions["histogram of peak_force"].counts)
    with pytest.raises(p3dof.InputError, match="expected a Sweep, got 5"):
        plots.sweep_figure(5)
