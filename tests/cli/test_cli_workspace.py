"""`p3dof workspace` and `p3dof indices`: numbers, files, and one clear error for what cannot be."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray
from command_line import run

import p3dof
from p3dof.analysis.indices import COLUMNS
from p3dof.cli.app import main

ROBOT = p3dof.load()


def numbers(capsys, *arguments):
    code = main([*arguments, "--json"])
    captured = capsys.readouterr()
    return code, json.loads(captured.out), captured.err


def test_a_workspace_is_told_in_tables(capsys):
    assert main(["workspace", "--index", "lti"]) == 0
    told = capsys.readouterr().out
    assert "0.209828" in told
    assert "-166.70" in told
    assert "LTI is at least 0.7 in 30.2% of the volume" in told


def test_json_has_the_workspace_within_limits_with_units(capsys):
    options = ("--tilt", "30 deg", "--travel=-150 mm,0.2", "--serial", "0.4", "--actuation", "15 deg")
    code, found, _ = numbers(capsys, "workspace", *options, "--index", "lci", "--length", "200 mm")
    assert code == 0
    limits = p3dof.machine.Limits(travel=(-0.15, 0.2), tilt=(-np.pi / 6, np.pi / 6))
    space = ROBOT.workspace(limits, p3dof.analysis.WorkspaceMargins(0.4, np.pi / 12))
    assert found["volume"] == pytest.approx(space.volume, rel=1e-12)
    assert found["area_y_theta"] == pytest.approx(space.area_y_theta, rel=1e-12)
    assert found["largest_box"]["y"] == pytest.approx(space.largest_box().y, rel=1e-12)
    assert found["indices"]["lci"]["mean"] == pytest.approx(space.mean("lci", length=0.2), rel=1e-12)
    assert found["limits"]["tilt"] == pytest.approx([-np.pi / 6, np.pi / 6])
    assert found["margins"]["actuation"] == pytest.approx(np.pi / 12)


def test_demands_of_motion_have_units(capsys):
    _, found, _ = numbers(
        capsys, "workspace", "--velocity", "2000 mm/s,1.5 m/s,10", "--acceleration", "25,20,100"
    )
    margins = p3dof.analysis.WorkspaceMargins(velocity=(2, 1.5, 10), acceleration=(25, 20, 100))
    assert found["volume"] == pytest.approx(ROBOT.workspace(margins=margins).volume, rel=1e-9)


@pytest.mark.parametrize("view", ["map", "slices", "loci"])
def test_figures_and_maps_are_written(view, tmp_path, capsys):
    figure, out = tmp_path / "a.png", tmp_path / "a.nc"
    options = ["--index", "lti", "--view", view, "--figure", str(figure), "--out", str(out)]
    assert main(["workspace", *options]) == 0
    assert figure.read_bytes().startswith(b"\x89PNG")
    with xarray.open_dataset(out) as found:
        assert set(found.data_vars) == {"lti", "height"}
        assert found.sizes == {"y": 200, "theta": 200}
    assert capsys.readouterr().out.count("wrote ") == 2


def test_a_motion_is_checked(tmp_path, capsys):
    path = p3dof.paper_motion(51).to_csv(tmp_path / "motion.csv")
    code, found, _ = numbers(capsys, "workspace", "--motion", str(path))
    assert (code, found["motion_inside"]) == (0, True)
    assert main(["workspace", "--motion", str(path), "--tilt", "15 deg"]) == 1
    told = capsys.readouterr().out
    assert "the motion leaves the workspace at t = " in told
    assert ": tilt by " in told


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--tilt", "fast"], "expected one number or two such as '30 deg' or '-30 deg,45 deg', got 'fast'"),
        (["--tilt", "10 deg,45 deg"], "tilt: expected a range around 0"),
        (["--serial", "0.95"], "at home the margin of 'serial A' is -0.0229752"),
        (["--velocity", "1,2"], "expected three numbers, of y, z and theta [m/s, m/s, rad/s], got '1,2'"),
        (["--velocity", "0,3,0"], "'speed A' is -1"),
        (["--index", "lit"], "error: --index: expected one of determinant"),
        (["--actuation", "15 mm"], "expected an angle such as '5 deg', got '15 mm'"),
        (["--max-force", "0"], "expected a positive number, got 0"),
        (["--out", "map.csv"], "expected a file name that ends in .nc"),
    ],
)
def test_bad_input_is_one_line(options, message, capsys):
    assert main(["workspace", *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.startswith("p3dof: error: ")
    assert error.count("\n") == 1


def test_indices_at_poses(capsys, tmp_path):
    out = tmp_path / "a.csv"
    poses = ["--pose", "0,0,0", "--pose", "100 mm,0,-30 deg"]
    code, found, _ = numbers(
        capsys, "indices", *poses, "--length", "0.2", "--rod-diameter", "20 mm", "--out", str(out)
    )
    assert code == 0
    where = np.array([[0, 0, 0], [0.1, 0, -np.pi / 6]])
    known = ROBOT.indices(where, 0.2, rods=p3dof.analysis.reactions.RodSection(diameter=0.02))
    assert set(found["indices"]) == set(COLUMNS)
    for name, values in known.columns.items():
        assert found["indices"][name] == pytest.approx(values.tolist(), rel=1e-12), name
    with out.open(newline="") as lines:
        header, *rows = list(csv.reader(lines))
    assert header[:4] == ["y [m]", "z [m]", "theta [rad]", "determinant [m/rad]"]
    assert float(rows[1][header.index("lti [1]")]) == known.lti[1]


def test_indices_along_a_motion(capsys, tmp_path):
    path = p3dof.paper_motion(51).to_csv(tmp_path / "motion.csv")
    assert main(["indices", "--motion", str(path), "--index", "lti", "--index", "frequency"]) == 0
    told = capsys.readouterr().out
    assert "over 51 poses" in told
    assert "frequency_3" in told
    least = ROBOT.indices(p3dof.paper_motion(51).pose).lti.min()
    assert f"{least:.6g}" in told


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--pose", "0,0"], 2, "expected y,z,theta such as"),
        (["--pose", "0.3,0,0"], 1, "leg A is too short by 0.05 m"),
        (["--pose", "0,0,0", "--index", "lit"], 2, "error: --index: expected one of determinant"),
        (["--pose", "0,0,0", "--length", "0"], 2, "'--length'"),
        (["--rigid-rods", "--rod-diameter", "0.02"], 2, "--rigid-rods and --rod-diameter exclude each other"),
    ],
)
def test_bad_input_of_indices_is_one_line(options, code, message, capsys):
    assert main(["indices", *options]) == code
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("library", ["xarray", "pandas"])
def test_a_map_is_drawn_without_xarray_and_no_netcdf_is_begun(library, tmp_path, capsys, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "xarray"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, "workspace", "--figure", "map.png", "--index", "serial_a")
    assert (code, err) == (0, "")
    assert Path("map.png").read_bytes()[:4] == b"\x89PNG"
    for name in ("map.nc", "-"):
        code, out, err = run(capsys, "workspace", "--out", name)
        assert (code, out) == (2, "")
        assert "'--out': a map (.nc) needs xarray: pip install 'p3dof[xarray]'" in err
