"""`p3dof designs`: tables in, tables out, one clear error with the row."""

from __future__ import annotations

import builtins
import io
import sys

import numpy as np
import pytest

import p3dof
from p3dof.analysis.designs import forces_of_designs
from p3dof.cli import designs as command
from p3dof.cli.app import main

parquet = pytest.importorskip("pyarrow.parquet")

HEADER = "R [mm],L,platform.mass [g]"
ROWS = 23


@pytest.fixture
def table(tmp_path):
    rng = np.random.default_rng(3)
    lines = [
        f"{rng.uniform(235, 265)!r},{rng.uniform(0.39, 0.45)!r},{rng.uniform(5e3, 9e3)!r}"
        for _ in range(ROWS)
    ]
    lines[4] = "250,0.16,8000"  # out of reach
    path = tmp_path / "designs.csv"
    path.write_text("\n".join(["# from a search", HEADER, "", *lines, ""]))
    return path


def expected(table):
    numbers = np.loadtxt(table, delimiter=",", skiprows=2)
    columns = dict(zip(HEADER.split(","), numbers.T, strict=True))
    return columns, forces_of_designs(columns, p3dof.paper_motion(101), figures=("power",), gradients=("R",))


def read(path):
    if path.suffix == ".parquet":
        found = parquet.read_table(path)
        return {name: found.column(name).to_numpy() for name in found.column_names}
    header, *lines = path.read_text().splitlines()
    return dict(
        zip(header.split(","), np.array([line.split(",") for line in lines], dtype=object).T, strict=True)
    )


ASK = ("--samples", "101", "--compute", "power", "--gradient", "R")


@pytest.mark.parametrize("rows", [7, 100])
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_table_of_designs_becomes_a_table_of_figures(table, tmp_path, capsys, monkeypatch, suffix, rows):
    monkeypatch.setattr(command, "ROWS", rows)
    out = tmp_path / f"found.{suffix}"
    assert main(["designs", str(table), *ASK, "--out", str(out), "--top", "3"]) == 0
    columns, wanted = expected(table)
    found = read(out)
    assert list(found) == [*columns, *wanted.to_columns()]
    words = found.pop("status")
    assert words[4] == "out_of_reach"
    assert list(words).count("feasible") == ROWS - 1
    for name, column in {**columns, **wanted.to_columns()}.items():
        if name != "status":
            np.testing.assert_array_equal(found[name].astype(float), column, err_msg=name)
    told = capsys.readouterr().out
    assert "23 designs" in told
    assert "a leg is too short for a sample of the motion" in told
    best = np.nanargmin(wanted.peak_force.max(axis=1)) + 1
    assert f"{best} " in told.partition("Least peak force")[2]
    assert f"wrote {out}" in told


def test_parquet_in_is_as_csv_in(table, tmp_path):
    import pyarrow

    columns, _ = expected(table)
    path = tmp_path / "designs.parquet"
    parquet.write_table(pyarrow.table(columns), path)
    for given, name in ((table, "one.csv"), (path, "other.csv")):
        assert main(["designs", str(given), *ASK, "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "other.csv").read_bytes()


def test_streams_in_and_out(table, tmp_path, capfd, monkeypatch):
    assert main(["designs", str(table), *ASK, "--out", str(tmp_path / "found.csv")]) == 0
    capfd.readouterr()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(table.read_bytes())))
    assert main(["designs", "-", *ASK, "--out", "-"]) == 0
    out, told = capfd.readouterr()
    assert out == (tmp_path / "found.csv").read_text()
    assert "23 designs" in told


def test_solids_and_the_machine_of_a_file(tmp_path):
    machine = tmp_path / "machine.yaml"
    p3dof.write_parameters(p3dof.of_solids(p3dof.machine.Geometry(R=0.26)), machine)
    table = tmp_path / "designs.csv"
    table.write_text("rod_radius [mm]\n9\n11\n")
    out = tmp_path / "found.csv"
    arguments = ["--parameters", str(machine), "--solids", "--samples", "101", "--out", str(out)]
    assert main(["designs", str(table), *arguments]) == 0
    wanted = forces_of_designs(
        {"rod_radius": [0.009, 0.011]},
        p3dof.paper_motion(101),
        p3dof.read_parameters(machine),
        bodies="solids",
    )
    np.testing.assert_array_equal(read(out)["peak_force_c [N]"].astype(float), wanted.peak_force[:, 2])


def test_no_design_that_can_is_a_machine_that_cannot(tmp_path, capsys):
    table = tmp_path / "designs.csv"
    table.write_text("L\n.16\n-1\nnan\n")
    assert main(["designs", str(table), "--samples", "11"]) == 1
    told = " ".join(capsys.readouterr().out.split())
    for words in ("a leg is too short", "no geometry", "a number is not finite"):
        assert words in told


BAD = {
    "no number": ("R\n.25\n.26\n.2x\n", "row 3 (line 4), column R: expected a number, got '.2x'"),
    "nothing": ("R,L\n.25,.4\n,.4\n", "row 2 (line 3), column R: expected a number, got nothing"),
    "another script's digits": ("R\n.25\n٣\n", "row 2 (line 3), column R: expected a number"),
    "underscores": ("R\n1_0\n", "row 1 (line 2), column R: expected a number, got '1_0'"),
    "too few columns": ("R,L\n.25,.4\n\n# so\n.25\n", "row 2 (line 5): expected 2 columns, got 1"),
    "too many columns": ("R,L\n.25,.4,1\n", "row 1 (line 2): expected 2 columns, got 3"),
    "an unknown column": ("R,colour\n.25,3\n", "designs.csv, column 2: unknown column 'colour'"),
    "a wrong unit": ("R [kg]\n.25\n", "column 1: column 'R [kg]': expected a length"),
    "millimetres without their unit": ("R,L\n.25,.4\n250,400\n", "row 2, column R: 250 m is more than 20 m"),
    "one column twice": ("R,R\n.25,.4\n", "designs.csv: two columns are geometry.R: 'R' and 'R'"),
    "the same in two units": (
        "R,R [mm]\n.25,250\n",
        "designs.csv: two columns are geometry.R: 'R' and 'R [mm]'; leave one",
    ),
    "no names": ("240,300\n241,300\n", "designs.csv: the first line has numbers only; expected the names"),
    "semicolons": ("R;L\n.25;.4\n", "expected commas between the columns, got semicolons"),
    "an empty file": ("\n\n", "got an empty file"),
    "no rows": ("R\n# none\n", "expected rows of numbers after the names of columns, got none"),
    "solids that are not asked for": ("rod_radius\n.01\n", "needs bodies of solids: --solids"),
    "a long line": ("R\n" + "1" * 200_000 + "\n", "line 2: expected less than 100000 characters"),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_bad_tables_have_one_clear_error_and_leave_what_was_there(tmp_path, capsys, text, message):
    table, out = tmp_path / "designs.csv", tmp_path / "found.csv"
    table.write_text(text, encoding="utf-8")
    out.write_text("before")
    assert main(["designs", str(table), "--samples", "11", "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
    assert told.startswith("p3dof: error: ")
    assert out.read_text() == "before"
    assert {path.name for path in tmp_path.iterdir()} == {"designs.csv", "found.csv"}


def test_a_bad_row_late_in_the_file_leaves_what_was_there(table, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(command, "ROWS", 5)
    table.write_text(table.read_text() + "250,0.4,much\n")
    out = tmp_path / "found.parquet"
    out.write_text("before")
    assert main(["designs", str(table), "--samples", "11", "--out", str(out)]) == 2
    assert (
        "row 24 (line 27), column platform.mass [g]: expected a number, got 'much'" in capsys.readouterr().err
    )
    assert out.read_text() == "before"


def test_bad_parquet_has_one_clear_error(tmp_path, capsys):
    import pyarrow

    path = tmp_path / "designs.parquet"
    for columns, message in (
        ({"R": [0.25, None, 0.26]}, "row 2, column R: expected a number, got nothing"),
        ({"R": ["wide"]}, "column R: expected numbers, got the type string"),
        ({"R": pyarrow.array([], pyarrow.float64())}, "expected rows of numbers, got none"),
        ({"Q": [1.0]}, "column 1: unknown column 'Q'"),
    ):
        parquet.write_table(pyarrow.table(columns), path)
        assert main(["designs", str(path), "--samples", "11"]) == 2
        assert message in capsys.readouterr().err
    path.write_bytes(b"PAR1 not at all")
    assert main(["designs", str(path), "--samples", "11"]) == 2
    assert "no Parquet file, or damaged" in capsys.readouterr().err


def test_files_that_are_not_there_or_would_be_lost(table, tmp_path, capsys):
    for name in ("missing.csv", "missing.parquet"):
        assert main(["designs", str(tmp_path / name)]) == 2
        assert f"{name}: cannot be read" in capsys.readouterr().err
    assert main(["designs", str(table), "--out", str(table)]) == 2
    assert "would be overwritten" in capsys.readouterr().err
    assert main(["designs", str(table), "--out", "found.xlsx"]) == 2
    assert "ends in .csv or .parquet" in capsys.readouterr().err


def test_parquet_without_pyarrow_has_one_clear_error(table, tmp_path, capsys, monkeypatch):
    original = builtins.__import__

    def without(name, *others, **more):
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return original(name, *others, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    for arguments in (
        [str(table), "--out", str(tmp_path / "found.parquet")],
        [str(tmp_path / "designs.parquet")],
    ):
        assert main(["designs", *arguments, "--samples", "11"]) == 2
        assert "Parquet files need pyarrow: pip install 'p3dof[tables]'" in capsys.readouterr().err


def test_a_bad_cell_is_an_error_of_the_input_also_where_results_are_written(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.csv").write_text("geometry.R [furlong]\n10\n", encoding="utf-8")
    assert main(["designs", "bad.csv", "--out", "found.csv"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("p3dof: error: bad.csv, column 1: ")
    assert "cannot be written" not in told
    assert [path.name for path in tmp_path.iterdir()] == ["bad.csv"]
