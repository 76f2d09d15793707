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
from documents import ROOT
from referencing import Registry, Resource
from sweep_problems import PARQUET, environment, files, wait_until

import p3dof
from p3dof._base import blocks
from p3dof.cli import main
from p3dof.design import sweeps
from p3dof.report import plots

REFERENCE = ROOT / "docs/reference"
SCHEMA = json.loads((REFERENCE / "sweep.schema.json").read_text(encoding="utf-8"))
PARAMETERS = json.loads((REFERENCE / "parameters.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(
    SCHEMA, registry=Registry().with_resource("parameters.schema.json", Resource.from_contents(PARAMETERS))
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
    found = p3dof.analysis.forces_of_designs(
        inputs, p3dof.paper_motion(21), figures=("singularity", "sliders")
    )
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
    other = changed(
        "machine", p3dof.PAPER.carrying(p3dof.machine.Body(1, np.zeros(3), np.full(3, 1e-3))).to_dict()
    )
    with pytest.raises(p3dof.errors.SweepError, match=r"settings\.machine\.payload is only here"):
        sweeps.read_sweep(written(tmp_path, other)).run(made.folder, resume=True)
    with pytest.raises(p3dof.errors.SweepError, match=r"settings\.motion\.samples is 21 there, 22 here"):
        sweeps.read_sweep(written(tmp_path, changed("motion", {"paper": 22}))).run(made.folder, resume=True)


ONE = {"R": {"values": [0.25, "26 cm"]}}
GRID = changed("sampling", "grid", changed("count", MISSING, changed("variables", ONE)))
ROWS = {"rows": "designs.csv"}
RUNS = {
    "motion": {"paper": 101},
    "run": {"controller": "pd", "duration": 0.02, "noise": {"position": "2 um", "velocity": "0.1 mm/s"}},
    "variables": {
        "L": {"normal": ["400 mm", "0.05 mm"]},
        "frequency": {"uniform": [4, 8]},
        "start.y": {"normal": [0, "1 mm"]},
        "payload.mass": {"uniform": [0, "300 g"]},
    },
    "count": 30,
    "block_size": 20,
    "seed": 4,
    "reductions": [{"top": "rms_error_y", "count": 3}, {"moments": ["peak_force", "rms_error_y"]}],
}
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
    "runs": RUNS,
    "runs with all there is to say": changed(
        "run",
        {
            "controller": "computed-torque",
            "rate": 500,
            "frequency": 6,
            "damping": 0.8,
            "integral_time": "200 ms",
            "saturation": "0.4 kN",
            "noise": {"position": "2 um", "velocity": "0.1 mm/s", "seed": 3},
            "resolution": "5 um",
            "differencing": True,
            "delay": "1 ms",
            "bandwidth": 200,
            "ramp": 0.1,
            "duration": "30 ms",
            "step": "1 ms",
            "stop_at": ["slider stop"],
        },
        changed("wrench", "load.csv", RUNS),
    ),
    "runs without noise": changed("run", {"controller": "feedforward", "duration": 0.02}, RUNS),
    "rows of runs": {"run": {"duration": 0.01}, "rows": "runs.csv"},
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
    "runs with figures": changed("figures", ["sliders"], RUNS),
    "runs of solids": changed("bodies", "solids", RUNS),
    "an empty run": changed("run", {}, RUNS),
    "an unknown controller": changed("run/controller", "lqr", RUNS),
    "an unknown field of a run": changed("run/threads", 4, RUNS),
    "text as a rate": changed("run/rate", "1 kHz", RUNS),
    "a run of no time": changed("run/duration", 0, RUNS),
    "a noise of one number": changed("run/noise", 1e-6, RUNS),
    "an unknown field of the noise": changed("run/noise/force", 1, RUNS),
    "a negative noise": changed("run/noise/position", -1e-6, RUNS),
    "an unknown limit": changed("run/stop_at", ["wall"], RUNS),
    "a limit that is no list": changed("run/stop_at", "slider stop", RUNS),
    "differencing by text": changed("run/differencing", "yes", RUNS),
}


def run(tmp_path, data):
    p3dof.write_parameters(p3dof.PAPER, tmp_path / "machine.yaml")
    p3dof.paper_motion(51).to_csv(tmp_path / "motion.csv")
    (tmp_path / "designs.csv").write_text("R,L\n.25,.4\n.26,.41\n", encoding="utf-8")
    (tmp_path / "runs.csv").write_text("L [mm],start.y [mm],frequency\n400,1,5\n401,2,6\n", encoding="utf-8")
    (tmp_path / "large_runs.csv").write_text("L,start.y\n400,1\n", encoding="utf-8")
    (tmp_path / "load.csv").write_text(
        "t,fx,fy,fz,mx,my,mz\n0,0,0,0,0,0,0\n1,0,5,9,0,0,0\n", encoding="utf-8"
    )
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


def test_runs_of_a_file_are_those_of_the_command(tmp_path, capsys):
    """The columns of the first block to a table of runs, which `p3dof runs` makes."""
    made = run(tmp_path, changed("wrench", "load.csv", RUNS))
    columns = made.columns()
    assert made.manifest.units["geometry.L"] == "m"
    inputs = ["geometry.L", "controller.frequency", "start.y", "payload.mass"]
    table = np.column_stack([*(columns[name] for name in inputs), np.arange(30)])
    rows = "\n".join(",".join(map(repr, row)) for row in table.tolist())
    (tmp_path / "given.csv").write_text(f"{','.join(inputs)},seed\n{rows}\n", encoding="utf-8")
    options = ["--samples", "101", "--duration", "0.02", "--noise", "2e-6", "1e-4"]
    options += ["--wrench", str(tmp_path / "load.csv"), "--out", str(tmp_path / "found.npz")]
    assert main(["runs", str(tmp_path / "given.csv"), *options]) == 0
    capsys.readouterr()
    with np.load(tmp_path / "found.npz") as found:
        assert set(found["stop"]) == {"finished"}
        np.testing.assert_array_equal(columns["rms_error_y"], found["rms_error y [m]"])
        np.testing.assert_array_equal(columns["peak_force_a"], found["peak_force A [N]"])
        assert len(np.unique(columns["peak_force_a"])) == 30


def test_a_figure_of_nothing_is_refused_before_the_work(tmp_path, monkeypatch, capsys):
    def work(*_, **__):
        raise AssertionError("it worked before it looked what to draw")

    monkeypatch.setattr(sweeps.SweepPlan, "run", work)
    path = written(tmp_path, changed("reductions", [{"top": "peak_force", "count": 5}]))
    assert main(["sweep", str(path), "--out", str(tmp_path / "o"), "--figure", str(tmp_path / "f.png")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "--figure: expected a Histogram or a ParetoArchive of two columns" in told
    assert (
        main(["sweep", str(path), "--out", str(tmp_path / "o"), "--figure", str(path.with_suffix(".jpg"))])
        == 2
    )


def test_runs_of_a_file_go_to_other_processes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    made = run(tmp_path, RUNS)
    assert main(["sweep", "sweep.yaml", "--out", "other", "--workers", "1"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "30 of 30 items in 2 of 2 blocks" in told
    assert files(made.folder) == files(tmp_path / "other")


WRONG = {
    r"sweep\.yaml: .*unknown column 'Rr'": changed("variables", {"Rr": {"uniform": [0.2, 0.3]}}),
    r"sweep\.yaml: variables\.geometry\.R\.uniform: expected a length": changed(
        "variables/R", {"uniform": ["1 kg", 0.3]}
    ),
    r"variables\.geometry\.R: low, high: expected low < high": changed(
        "variables/R", {"uniform": [0.3, 0.2]}
    ),
    r"sweep\.yaml: count: expected how many items": changed("count", MISSING),
    r"expected `values` of each variable of a grid, got a count besides": changed("count", 5, GRID),
    r"sweep\.yaml: reductions\[0\]: 5 smallest peak_forc: unknown column 'peak_forc'; "
    r"did you mean 'peak_force' or ": changed("reductions/0/top", "peak_forc"),
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
    r"sweep\.yaml: wrench: there is no file .*force\.csv": changed("wrench", "force.csv"),
    r"sweep\.yaml: run\.duration: expected a time": changed("run/duration", "3 mm", RUNS),
    r"sweep\.yaml: run\.rate: expected a number without a unit, got '1 kHz'": changed(
        "run/rate", "1 kHz", RUNS
    ),
    r"sweep\.yaml: run: unknown field 'treads', expected controller": changed("run/treads", 4, RUNS),
    r"sweep\.yaml: run: controller: expected pd, feedforward, computed-torque, got 'lqr'": changed(
        "run/controller", "lqr", RUNS
    ),
    r"sweep\.yaml: runs: unknown column 'rate'": changed("variables/rate", {"uniform": [1, 2]}, RUNS),
    r"sweep\.yaml: runs: the column dimensions\.rod_radius is of solids": changed(
        "variables/rod_radius", {"uniform": [0.01, 0.02]}, RUNS
    ),
    r"sweep\.yaml: runs: the column controller\.stiffness is for a controller of the kind Springs": changed(
        "variables/controller.stiffness", {"uniform": [1, 2]}, RUNS
    ),
    r"sweep\.yaml: run\.stop_at: expected some of slider stop, .*, got 'wall'": changed(
        "run/stop_at", ["wall"], RUNS
    ),
    r"sweep\.yaml: run: ramp, stop: expected at most 2 s": changed("run/ramp", 5, RUNS),
    r"sweep\.yaml: run: duration: expected": changed("run/duration", -1, RUNS),
    r"sweep\.yaml: run: step: expected": changed("run/step", 0, RUNS),
    r"sweep\.yaml: run: delay: expected zero or more": changed("run/delay", -1, RUNS),
    r"sweep\.yaml: variables\.geometry\.R\.uniform: 280 m is more than 20 m: .*'280 mm'": changed(
        "variables/R", {"uniform": [240, 280]}
    ),
    r"runs\.csv, row 1, column L: 400 m is more than 20 m": {"rows": "large_runs.csv", "run": {"rate": 500}},
    r"sweep\.yaml: figures: expected none with `run`": changed("figures", ["power"], RUNS),
    r"sweep\.yaml: reductions\[0\]: 3 smallest rms_err_y: .*did you mean 'rms_error_y'": changed(
        "reductions/0/top", "rms_err_y", RUNS
    ),
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
    monkeypatch.setenv("COLUMNS", "200")
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
    assert error.endswith("holds 3 of 3 blocks of this sweep; to resume it: --resume\n")
    assert main(["sweep", "sweep.yaml", "--out", "out", "--resume"]) == 0
    assert capsys.readouterr().out.endswith("nothing was missing: all 3 blocks were in out\n")
    next((tmp_path / "out").rglob("0000000001.npz")).unlink()
    assert main(["sweep", "sweep.yaml", "--out", "out", "--resume"]) == 0
    assert capsys.readouterr().out.endswith("computed 1 of 3 blocks, those that were missing, in out\n")
    assert main(["sweep", "sweep.yaml", "--out", "o", "--workers", "2", "--scheduler", "tcp://x"]) == 2
    capsys.readouterr()
    assert main(["sweep", "sweep.yaml", "--out", "o", "--local-folder"]) == 2
    assert "--local-folder belongs to --scheduler" in capsys.readouterr().err
    assert not Path("o").exists()


@pytest.mark.parametrize(
    "address", ["nowhere", "tcp://", "127.0.0.1:1", "tcp://127.0.0.1:1", "ftp://a:1", "a:99999"]
)
def test_a_cluster_that_is_not_there_is_told_in_one_line_at_once(address, tmp_path, monkeypatch, capsys):
    distributed = pytest.importorskip("distributed", reason="dask not installed")
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: pytest.fail("it would wait half a minute"))
    monkeypatch.chdir(tmp_path)
    written(tmp_path, FILE)
    assert main(["sweep", "sweep.yaml", "--out", "o", "--scheduler", address]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"p3dof: error: --scheduler: {address}: cannot be reached (")
    assert error.endswith("; expected an address such as tcp://127.0.0.1:8786\n")
    assert error.count("\n") == 1


@pytest.mark.usefixtures("ctrl_c")
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
    assert error.endswith("to resume it: --resume\n")
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
