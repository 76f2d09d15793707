"""Sweeps block by block: the same bits however, wherever and how often they are computed."""

from __future__ import annotations

import errno
import json
import os
import pickle
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import sweep_problems
from sweep_problems import PARQUET, environment, files, problem, reductions, wait_until

import p3dof
from p3dof._base import blocks
from p3dof._base.files import hash_of

FORMATS = ("npz", pytest.param("parquet", marks=PARQUET))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A sweep that was not interrupted."""
    return p3dof.sweep(problem(), tmp_path_factory.mktemp("sweep"), reductions=reductions(), seed=3)


def again(folder, **options):
    return p3dof.sweep(problem(), folder, reductions=reductions(), seed=3, **options)


def a_block(sweep, number):
    (path,) = sweep.folder.rglob(f"{number:010d}.*")
    return path


def test_items_are_the_forces_of_their_machines(whole):
    assert whole.complete
    assert len(whole) == 60
    found = whole.columns()
    assert found["index"].tolist() == list(range(60))
    machine = {name: found[name][17:18] for name in sweep_problems.VARIABLES}
    for name, values in sweep_problems.peaks(machine).items():
        assert found[name][17] == values[0]
    assert np.isfinite(found["peak_a"]).all()


def test_inputs_of_a_block_depend_on_its_number_and_the_seed_alone(whole, tmp_path):
    alone = problem().sampling.draw(blocks.Block(4, 20, 25, 3))
    for name, values in alone.items():
        np.testing.assert_array_equal(whole.columns([name])[name][20:25], values)
    other = p3dof.sweep(problem(), tmp_path, seed=4).columns(["R"])["R"]
    assert not np.any(np.isin(other, whole.columns(["R"])["R"]))


@pytest.mark.parametrize("options", [{"workers": 3}, {"client": "executor"}, {"shared": False}], ids=str)
def test_files_are_the_same_to_the_last_bit_whoever_computes(whole, tmp_path, options):
    with ThreadPoolExecutor(2) as pool:
        if options.get("client"):
            options = {"client": pool, "in_flight": 5}
        again(tmp_path / "out", **options)
    assert files(tmp_path / "out") == files(whole.folder)


def test_a_sweep_goes_on_where_ctrl_c_ended_it(whole, tmp_path):
    def press(done, _):
        if done == 25:
            raise KeyboardInterrupt

    with pytest.raises(blocks.SweepInterrupted, match=r"interrupted: 5 of 12 blocks .* resume=True"):
        again(tmp_path, progress=press)
    half = blocks.Sweep.load(tmp_path)
    assert not half.complete
    assert half.numbers == (0, 1, 2, 3, 4)
    assert len(half) == len(half.columns()["R"]) == 25
    assert half.reductions["7 smallest peak_a"].index.max() < 25
    with pytest.raises(
        p3dof.errors.SweepError, match="holds 5 of 12 blocks of this sweep; to resume it: resume=True"
    ):
        again(tmp_path)
    assert again(tmp_path, resume=True).notes == ()
    assert files(tmp_path) == files(whole.folder)
    assert again(tmp_path, resume=True).complete  # and what is complete stays so


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("damage", ["cut", "bit", "swapped", "foreign", "empty"])
def test_a_damaged_block_is_computed_again_and_told(tmp_path, kind, damage):
    made = p3dof.sweep(problem(20), tmp_path / "a", reductions=reductions(), format=kind)
    before = files(made.folder)
    path = a_block(made, 2)
    data = bytearray(path.read_bytes())
    if damage == "cut":
        data = data[: len(data) // 2]
    elif damage == "bit":
        data[data.index(made.columns(["R"])["R"][10].tobytes())] ^= 1
    elif damage == "swapped":
        data = a_block(made, 1).read_bytes()
    elif damage == "foreign":
        other = p3dof.sweep(problem(20), tmp_path / "b", reductions=reductions(), format=kind, seed=9)
        data = a_block(other, 2).read_bytes()
    else:
        data = b""
    path.write_bytes(data)
    with pytest.raises(p3dof.FileError, match=r"0000000002.*expected block 2 of this sweep"):
        made.columns()
    resumed = p3dof.sweep(
        problem(20), tmp_path / "a", reductions=reductions(), format=kind, resume=True, workers=2
    )
    (note,) = resumed.notes
    assert "computed again" in note
    assert "0000000002" in note
    assert files(made.folder) == before
    assert "computed again" in resumed._repr_html_()


def test_a_block_that_is_missing_is_computed(whole, tmp_path):
    made = again(tmp_path)
    a_block(made, 7).unlink()
    assert again(tmp_path, resume=True).notes == ()
    assert files(tmp_path) == files(whole.folder)


OTHERS = {
    "seed is 3 there, 4 here": lambda: {"seed": 4},
    r"settings\.sampling\.variables\.L\.high is 0\.5 there, 0\.6 here": lambda: {"wider": True},
    "count is 60 there, 61 here": lambda: {"count": 61},
    "block_size is 5 there, 6 here": lambda: {"block_size": 6},
    r"reductions is \[.*there, \[\] here": lambda: {"reductions": ()},
    'format is "npz" there, "parquet" here': lambda: {"format": "parquet"},
    r"keep is \[.* there, \[\] here": lambda: {"keep": None},
}


@pytest.mark.parametrize("what", OTHERS)
def test_another_sweep_is_not_resumed(whole, what, monkeypatch):
    options = {"reductions": reductions(), "seed": 3, **OTHERS[what]()}
    if options.pop("wider", False):
        monkeypatch.setitem(sweep_problems.VARIABLES, "L", blocks.Uniform(0.38, 0.6))
    asked = problem(options.pop("count", 60))
    before = files(whole.folder)
    with pytest.raises(
        p3dof.errors.SweepError, match=f"holds another sweep: .*{what}.*; choose another folder"
    ):
        p3dof.sweep(asked, whole.folder, resume=True, **options)
    assert files(whole.folder) == before


def test_another_version_is_not_resumed(tmp_path, monkeypatch):
    again(tmp_path)
    monkeypatch.setattr("numpy.__version__", "9.9.9")
    with pytest.raises(p3dof.errors.SweepError, match=r"versions\.numpy is .* there, \"9\.9\.9\" here"):
        again(tmp_path, resume=True)


def test_two_processes_do_not_work_on_one_folder(tmp_path):
    gate = tmp_path / "gate"
    arguments = [sys.executable, "-c", OTHER_PROCESS, str(tmp_path / "out"), str(gate)]
    with subprocess.Popen(arguments, env=environment()) as other:
        try:
            wait_until(lambda: len(list((tmp_path / "out").rglob("*.npz"))) == 2)
            with pytest.raises(
                p3dof.errors.SweepError, match=rf"another process .*\(process {other.pid} on "
            ):
                again(tmp_path / "out", resume=True)
        finally:
            gate.touch()
        assert other.wait(60) == 0
    assert again(tmp_path / "out", resume=True).complete


OTHER_PROCESS = """
import sys
import p3dof
from sweep_problems import gated, reductions
p3dof.sweep(gated(sys.argv[2], 2), sys.argv[1], reductions=reductions(), seed=3)
"""


def test_one_process_does_not_work_twice_on_one_folder(tmp_path):
    def inner(done, _):
        if done == 5:
            with pytest.raises(p3dof.errors.SweepError, match="this process works on this sweep already"):
                again(tmp_path, resume=True)

    assert again(tmp_path, progress=inner).complete


def test_a_worker_that_dies_is_replaced(whole, tmp_path):
    gate = tmp_path / "gate"
    waiting = sweep_problems.gated(gate, 4)
    with blocks.Processes(2) as client:
        assert list(client.map(abs, [-1, 2], [])) == []
        assert list(client.map(abs, [-1, 2])) == [1, 2]
        killed = []

        def kill_one(done, _):
            if done == 20 and not killed:  # the first four blocks: all that the gate lets through
                killed.extend(client.pids)
                os.kill(killed[0], signal.SIGKILL)
                gate.touch()

        made = p3dof.sweep(
            waiting, tmp_path / "out", client=client, seed=3, progress=kill_one, keep=["R", "peak_a"]
        )
        assert killed
        assert killed[0] not in client.pids
    for name in ("R", "peak_a"):
        np.testing.assert_array_equal(made.columns([name])[name], whole.columns([name])[name])


def test_a_block_that_kills_every_worker_ends_the_sweep_with_one_line(tmp_path):
    deadly = problem(10, 5, function=die)
    with (
        blocks.Processes(1) as client,
        pytest.raises(
            p3dof.errors.SweepError,
            match=r"workers died while block \d .* 0 of 2 blocks .*; to resume it: resume=True",
        ),
    ):
        p3dof.sweep(deadly, tmp_path, client=client)


def die(_columns):
    os._exit(1)


def test_a_full_disk_is_one_clear_error_and_what_is_done_stays(whole, tmp_path, monkeypatch):
    calls = []

    def fsync(_):
        calls.append(1)
        if len(calls) > 4:  # the manifest and three blocks
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", fsync)
        with pytest.raises(
            p3dof.FileError,
            match=r"0000000003\.npz: cannot be written \(No space left on device\); 3 of 12 blocks",
        ):
            again(tmp_path)
    assert len(list(tmp_path.rglob("*.npz"))) == 3
    assert not list(tmp_path.rglob("*.tmp"))
    again(tmp_path, resume=True)
    assert files(tmp_path) == files(whole.folder)


def test_a_folder_that_cannot_be_made_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(p3dof.FileError, match=r"file.out: cannot be written"):
        again(tmp_path / "file" / "out")


def test_an_error_of_the_problem_comes_through(tmp_path):
    with pytest.raises(p3dof.errors.SweepError, match="block 0: expected 5 numbers in the column peak_a"):
        p3dof.sweep(problem(function=short), tmp_path / "a")
    with pytest.raises(p3dof.errors.SweepError, match="block 0: expected the columns R, L"):
        p3dof.sweep(problem(function=dict), tmp_path / "b")
    with pytest.raises(ZeroDivisionError):
        p3dof.sweep(problem(function=fails), tmp_path / "c", workers=2)


def short(columns):
    return dict.fromkeys(sweep_problems.OUTPUTS, columns["R"][1:])


def fails(_columns):
    return 1 / 0


def test_reductions_alone_are_stored(whole, tmp_path):
    made = again(tmp_path, keep=None)
    assert made.columns() == {"index": pytest.approx(np.arange(60))}
    for number in range(12):
        assert a_block(made, number).stat().st_size < a_block(whole, number).stat().st_size
    for name, found in whole.reductions.items():
        assert pickle.dumps(made.reductions[name]) == pickle.dumps(found)
    with pytest.raises(p3dof.InputError, match=r"expected some of those that are kept \(none\), got 'R'"):
        made.columns(["R"])


def test_reductions_are_those_of_all_columns(whole):
    found, columns = whole.reductions, whole.columns()
    order = np.argsort(columns["peak_a"])[:7]
    assert found["7 smallest peak_a"].index.tolist() == order.tolist()
    for name, values in found["7 smallest peak_a"].columns.items():
        np.testing.assert_array_equal(values, columns[name][order])
    counts = found["histogram of peak_c"]
    np.testing.assert_array_equal(counts.counts, np.histogram(columns["peak_c"], 10, (0, 200))[0])
    moments = found["mean and range of peak_a, peak_b"]["peak_b"]
    assert moments.mean == pytest.approx(columns["peak_b"].mean(), rel=1e-14)
    assert moments.deviation == pytest.approx(columns["peak_b"].std(), rel=1e-12)
    assert (moments.low, moments.high) == (columns["peak_b"].min(), columns["peak_b"].max())


@PARQUET
def test_parquet_is_read_by_others(whole, tmp_path):
    import pyarrow.parquet as pq

    again(tmp_path, format="parquet")
    table = pq.read_table(tmp_path / "blocks")
    assert table.num_rows == 60
    np.testing.assert_array_equal(table["peak_a"].to_numpy(), whole.columns()["peak_a"])
    made = blocks.Sweep.load(tmp_path)
    for name, found in whole.reductions.items():
        assert pickle.dumps(made.reductions[name]) == pickle.dumps(found)


def test_a_manifest_says_what_the_sweep_is(whole):
    data = json.loads((whole.folder / "sweep.json").read_text(encoding="utf-8"))
    assert data["settings"]["sampling"]["variables"]["R"] == {"kind": "Uniform", "low": 0.22, "high": 0.3}
    assert data["versions"] == {"p3dof": p3dof.__version__, "numpy": np.__version__}
    assert (data["seed"], data["count"], data["block_size"]) == (3, 60, 5)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"seed": 3', '"seed": 4'),
        ('"kind": "p3dof sweep"', '"kind": "something"'),
        ('"count": 60', '"count": 6e99'),
        ("{", "[" * 100_000),
    ],
)
def test_a_manifest_that_is_damaged_is_refused(tmp_path, old, new):
    made = again(tmp_path)
    path = made.folder / "sweep.json"
    path.write_text(path.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(p3dof.FileError, match=r"sweep\.json: expected the manifest of a sweep"):
        blocks.Sweep.load(tmp_path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"column": "peak_c"', '"column": "peak"'),
        ('"height"\n   ]', '"breadth"\n   ]'),
        ('"kind": "TopK"', '"kind": ["TopK"]'),
        ('"peak_b"\n   ]', '["peak_b"]\n   ]'),
    ],
)
def test_a_manifest_whose_reductions_do_not_fit_is_refused_though_its_hash_is_right(tmp_path, old, new):
    made = again(tmp_path)
    path = made.folder / "sweep.json"
    assert old in path.read_text(encoding="utf-8")
    data = json.loads(path.read_text(encoding="utf-8").replace(old, new))
    data["hash"] = hash_of({key: value for key, value in data.items() if key != "hash"})
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(p3dof.FileError, match=r"expected the manifest of a sweep \(") as caught:
        blocks.Sweep.load(tmp_path)
    assert "hash" not in str(caught.value)


def test_what_is_no_sweep_is_refused(tmp_path):
    with pytest.raises(p3dof.FileError, match=r"sweep\.json: cannot be read"):
        blocks.Sweep.load(tmp_path)


def test_parquet_without_pyarrow_says_which_extra_brings_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(p3dof.errors.MissingExtraError, match=r"pip install 'p3dof\[tables\]'"):
        again(tmp_path / "out", format="parquet")
    assert not files(tmp_path)
    assert not (tmp_path / "out/sweep.json").exists()


def test_columns_that_are_too_large_are_read_in_blocks(whole):
    with pytest.raises(p3dof.InputError, match="`blocks` reads them one after the other"):
        whole.columns(max_bytes=100)
    parts = [columns["R"] for _, columns in whole.blocks(["R"])]
    np.testing.assert_array_equal(np.concatenate(parts), whole.columns(["R"])["R"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"client": 5}, "client: expected a distributed.Client, an executor"),
        ({"workers": 0}, "workers: expected a whole number from 1"),
        ({"keep": ["mass"]}, "keep: unknown column 'mass'; expected one of the columns R, L"),
        ({"format": "csv"}, "format: expected npz or parquet"),
        ({"seed": -1}, "seed: expected a whole number from 0"),
        ({"block_size": 0}, "block_size: expected a whole number from 1"),
        ({"reductions": [5]}, "reductions: expected TopK"),
        (
            {"reductions": [blocks.TopK("mass")]},
            "10 smallest mass: unknown column 'mass'; expected one of the columns R, L",
        ),
        ({"reductions": [blocks.TopK("R"), blocks.TopK("R")]}, "reductions: expected each one once"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_written(tmp_path, options, message):
    with pytest.raises(p3dof.InputError, match=message):
        p3dof.sweep(problem(), tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_what_is_no_problem_is_refused(tmp_path):
    with pytest.raises(p3dof.InputError, match="problem: expected an object with count, columns"):
        p3dof.sweep(5, tmp_path)
    with pytest.raises(p3dof.InputError, match="problem: expected what can be pickled"):
        p3dof.sweep(problem(function=lambda c: c), tmp_path, workers=2)


def test_a_table_a_reduction(whole):
    tables = blocks.sweep_tables(whole)
    assert [table.title for table in tables][:2] == [
        "7 smallest peak_a",
        "Pareto front of min peak_a, max height",
    ]
    assert len(tables[0].rows) == 7
    assert "60 of 60 items in 12 of 12 blocks, seed 3, 7 of 7 columns kept" in whole._repr_html_()
