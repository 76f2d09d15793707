"""Sweeps on a real cluster of Dask: workers that die, a program that is killed, errors, memory, addresses."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import psutil
import pytest
from sweep_problems import WAITING, environment, files, gated, peaks, problem, reductions, wait_until

import p3dof
from p3dof._base import blocks
from p3dof.cli import main

distributed = pytest.importorskip("distributed", reason="dask not installed")

LOOPBACK = "127.0.0.1:0"  # where the pages of a cluster are, at any free port

PROGRAM = """
import sys
import p3dof
from distributed import Client, LocalCluster
from sweep_problems import gated, reductions

if __name__ == "__main__":
    folder, gate, first, *options = sys.argv[1:]
    settings = dict(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0")
    with LocalCluster(**settings, silence_logs="CRITICAL") as cluster, Client(cluster) as client:
        print(*client.run(lambda: __import__("os").getpid()).values(), flush=True)
        p3dof.sweep(gated(gate, int(first)), folder, reductions=reductions(), seed=3, client=client,
                    resume="resume" in options)
"""


@pytest.fixture(scope="module")
def client():
    """A cluster of two worker processes that nobody but this machine can reach."""
    settings = {"n_workers": 2, "threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": LOOPBACK}
    dask = pytest.importorskip("dask")
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}), warnings.catch_warnings():
        warnings.simplefilter("error")
        with (
            distributed.LocalCluster(**settings, silence_logs="CRITICAL") as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """What one process computes that nobody disturbs."""
    made = p3dof.sweep(problem(), tmp_path_factory.mktemp("sweep"), reductions=reductions(), seed=3)
    return files(made.folder)


def there(folder):
    return len(list(folder.rglob("*.npz")))


def pids(client):
    return list(client.run(os.getpid).values())


@pytest.mark.parametrize("shared", [True, False])
def test_a_cluster_computes_the_same_bits(client, whole, tmp_path, shared):
    seen = []
    made = p3dof.sweep(
        problem(),
        tmp_path,
        reductions=reductions(),
        seed=3,
        client=client,
        shared=shared,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert made.complete
    assert seen == [(n, 60) for n in range(5, 61, 5)]
    assert files(tmp_path) == whole


@pytest.mark.slow
def test_a_worker_and_then_the_whole_program_may_be_killed(whole, tmp_path):
    """The sweep of a program that lost a worker, and was killed later, goes on to the same bits."""
    folder, gate = tmp_path / "out", tmp_path / "gate"
    command = [sys.executable, "-W", "error", "-c", PROGRAM, str(folder), str(gate)]
    workers, helpers = [], []
    with subprocess.Popen([*command, "4"], env=environment(), stdout=subprocess.PIPE, text=True) as program:
        try:
            workers = [psutil.Process(int(pid)) for pid in program.stdout.readline().split()]
            wait_until(lambda: len(list(tmp_path.glob(f"{WAITING}*"))) == 2 or program.poll() is not None)
            assert program.poll() is None  # both workers stand at the gate; dask chose what they did before
            workers[0].kill()
            wait_until(lambda: not workers[0].is_running())
            helpers = psutil.Process(program.pid).children(recursive=True)
            gate.touch()  # the other one goes on, and what replaces the first one
            wait_until(lambda: there(folder) >= 6)
        finally:
            program.kill()
    assert program.wait() == -signal.SIGKILL
    for process in {*workers, *helpers}:
        wait_until(lambda process=process: not process.is_running() or process.status() == "zombie")
    left = blocks.Sweep.load(folder)
    assert len(left.numbers) >= 6
    made = p3dof.sweep(problem(), folder, reductions=reductions(), seed=3, resume=True)
    assert made.notes == ()
    assert files(folder) == whole


def test_a_cluster_makes_runs_to_the_same_bits(client, monkeypatch):
    monkeypatch.setattr("p3dof.runs.many.running._SENT", 2000)
    rest = p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, -0.02, 0.1], 0.1, 11)
    options = {
        "controller": p3dof.runs.PD(p3dof.PAPER, rest),
        "control": p3dof.runs.ControlLoop(rate=1000, noise=p3dof.runs.Noise(1e-6, 1e-4)),
        "wrench": lambda time: [0, 0, 5 * time, 0, 0, 0],  # of a script: Dask takes it
    }
    masses = {"platform.mass": np.linspace(7, 9, 300)}
    here, there = (p3dof.load().simulate_many(0.1, masses, **options, client=one) for one in (None, client))
    assert here.finished.all()
    for figure in ("pose", "peak_error", "rms_force", "energy"):
        np.testing.assert_array_equal(getattr(here, figure), getattr(there, figure))
    wait_until(lambda: not client.futures)  # the cluster keeps nothing


@pytest.mark.parametrize("options", [(), ("--local-folder",)])
def test_the_command_line_takes_a_cluster(client, tmp_path, monkeypatch, capsys, options):
    monkeypatch.chdir(tmp_path)
    Path("sweep.yaml").write_text("""
motion: {paper: 11}
variables: {R: {uniform: [240 mm, 280 mm]}}
count: 30
block_size: 10
reductions: [{moments: peak_force}]
""")
    address = client.scheduler_info()["address"]
    assert main(["sweep", "sweep.yaml", "--out", "there", "--scheduler", address, *options]) == 0
    assert "30 of 30 items in 3 of 3 blocks" in capsys.readouterr().out
    assert main(["sweep", "sweep.yaml", "--out", "here"]) == 0
    assert files("there") == files("here")
    with distributed.Client(address) as again:
        assert len(again.scheduler_info()["workers"]) == 2  # the cluster goes on


def test_ctrl_c_leaves_a_folder_that_a_cluster_goes_on_with(client, whole, tmp_path):
    gate = tmp_path / "gate"

    def press(done, _):
        if done == 5:  # the first block: no other can keep it from being computed
            gate.touch()
            raise KeyboardInterrupt

    with pytest.raises(blocks.SweepInterrupted, match=r"[1-9] of 12 blocks are in .*resume=True"):
        p3dof.sweep(
            gated(gate, 1), tmp_path / "out", reductions=reductions(), seed=3, client=client, progress=press
        )
    p3dof.sweep(problem(), tmp_path / "out", reductions=reductions(), seed=3, client=client, resume=True)
    assert files(tmp_path / "out") == whole


@pytest.mark.slow
def test_a_block_that_kills_every_worker_ends_the_sweep_with_one_line(client, tmp_path):
    told = r"workers died while block \d .*; to resume it: resume=True"
    with pytest.raises(p3dof.errors.SweepError, match=told):
        p3dof.sweep(problem(10, 5, function=die), tmp_path, client=client)
    wait_until(lambda: len(client.scheduler_info()["workers"]) == 2)


def die(_columns):
    os._exit(1)


def test_errors_of_workers_come_through_as_they_are(client, tmp_path):
    with pytest.raises(ZeroDivisionError):
        p3dof.sweep(problem(function=fails), tmp_path / "a", client=client)
    (tmp_path / "b/blocks").mkdir(parents=True)
    (tmp_path / "b/blocks/0000000").write_text("in the way")
    with pytest.raises(p3dof.FileError, match=r"cannot be written .*; 0 of 12 blocks are in .*resume=True"):
        p3dof.sweep(problem(), tmp_path / "b", client=client)


def fails(_columns):
    return 1 / 0


def test_a_problem_of_a_script_goes_to_the_workers(client, tmp_path):
    """As what is defined in a notebook: it cannot be imported there."""

    def doubled(columns):
        return {**peaks(columns), "height": 2 * columns["R"]}

    doubled.__module__, doubled.__qualname__ = "__main__", "doubled"
    made = p3dof.sweep(problem(10, function=doubled), tmp_path, client=client)
    found = made.columns(["R", "height"])
    assert (found["height"] == 2 * found["R"]).all()


def test_at_most_so_many_blocks_are_on_their_way(client, tmp_path):
    gate = tmp_path / "gate"
    most = []

    def look(done, _):
        most.append(len(client.futures))
        if done == 5:
            gate.touch()

    p3dof.sweep(
        gated(gate, 1), tmp_path / "out", client=client, in_flight=3, progress=look, reductions=reductions()
    )
    assert max(most) <= 3


@pytest.mark.parametrize("large", [False, True])
def test_quick_blocks_go_together(client, tmp_path, monkeypatch, large):
    """A call of a cluster costs milliseconds: quick blocks go some at a time, towards the end alone."""
    monkeypatch.setattr("p3dof._base.blocks.crew._BATCH", 1000.0)  # whatever this machine is busy with
    monkeypatch.setattr("p3dof._base.blocks.running._LARGEST_TOGETHER", 100 if large else 4_000_000)
    calls, seen, submit = [], [], type(client).submit

    def counted(self, function, work, numbers, **options):
        calls.append(len(numbers))
        return submit(self, function, work, numbers, **options)

    monkeypatch.setattr(type(client), "submit", counted)
    options = {"reductions": reductions(), "seed": 3}
    made = p3dof.sweep(
        problem(200), tmp_path / "there", client=client, progress=lambda *now: seen.append(now), **options
    )
    assert seen == [(n, 200) for n in range(5, 201, 5)]
    assert sum(calls) == made.computed == 40
    if large:  # what comes back of many would be too much
        assert set(calls) == {1}
    else:
        assert max(calls) > 2
        assert calls[-1] == 1
        assert len(calls) < 30
    monkeypatch.undo()
    p3dof.sweep(problem(200), tmp_path / "here", **options)
    assert files(tmp_path / "there") == files(tmp_path / "here")


def test_nobody_beyond_this_machine_can_reach_the_cluster(client):
    processes = [psutil.Process(), *(psutil.Process(pid) for pid in pids(client))]
    listening = [c.laddr.ip for p in processes for c in p.net_connections("inet") if c.status == "LISTEN"]
    assert listening
    assert set(listening) <= {"127.0.0.1", "::1"}


def test_folders_that_workers_do_not_see_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "is_file", lambda _: False)
    with pytest.raises(
        p3dof.errors.SweepError, match=r"does not see this folder; share it .* \(shared=False\)"
    ):
        p3dof.sweep(problem(), tmp_path)
