"""What sweeps cost: beside bare calls, on two workers, in the client's memory; and one that is killed twice.

    python tests/benchmarks/sweeps.py --count 1000000

Needs the extra ``cluster``; without it, it says so and ends. Times are wall times of a quiet machine with two
free cores, but for the first line, which is processor time of one thread.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import tracemalloc
from contextlib import contextmanager
from pathlib import Path

import psutil

import p3dof
from p3dof._base import blocks
from p3dof.design import sweeps

try:
    import dask
    from distributed import Client, LocalCluster
except ImportError:
    print("sweeps: Dask is not installed: pip install 'p3dof[cluster]'")  # noqa: T201 - its output
    raise SystemExit(0) from None

LOCAL = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
VARIABLES = {
    "R": blocks.Uniform(0.24, 0.28),
    "L": blocks.Uniform(0.38, 0.5),
    "platform.mass": blocks.Normal(8.0, 0.2),
}
PROGRAM = """
import sys
from distributed import Client, LocalCluster
sys.path.insert(0, {folder!r})
import sweeps as benchmark

if __name__ == "__main__":
    local = LocalCluster(n_workers=2, silence_logs="CRITICAL", **benchmark.LOCAL)
    with local as cluster, Client(cluster) as client:
        print(*client.run(lambda: __import__("os").getpid()).values(), flush=True)
        benchmark.run({count}, {out!r}, client=client)
"""


def problem(count, size=20_000):
    return sweeps.DesignSweep(
        blocks.Samples(VARIABLES, count), p3dof.paper_motion(201), figures=("singularity",), block_size=size
    )


def reductions():
    return (
        blocks.TopK("peak_force", 100),
        blocks.ParetoArchive({"peak_force": "min", "reach": "max"}),
        blocks.Histogram("peak_force", 80, 160, 100),
        blocks.Moments(("peak_force", "reach")),
    )


def run(count, folder, **options):
    return p3dof.sweep(problem(count), folder, reductions=reductions(), seed=1, **options)


def tell(text):
    print(text, flush=True)  # noqa: T201 - its output


@contextmanager
def cluster(workers):
    with LocalCluster(n_workers=workers, **LOCAL) as local, Client(local) as client:
        client.run(__import__, "p3dof.design.sweeps")
        yield client


def beside_bare_calls(folder, count):
    """Processor time a design, of `forces_of_designs` alone and of a sweep around it, one thread."""
    work = problem(count)
    columns = work.sampling.draw(blocks.Block(0, 0, count, 1))
    bare, whole, none = [], [], []
    for _ in range(3):
        for keep, times in (("bare", bare), ("all", whole), (None, none)):
            out = folder / "beside"
            start = time.process_time()
            if keep == "bare":
                p3dof.analysis.forces_of_designs(
                    columns, work.forces.motion, figures=("singularity",), threads=1
                )
            else:
                run(count, out, keep=keep)
            times.append(time.process_time() - start)
            shutil.rmtree(out, ignore_errors=True)
    a, b, c = (min(times) / count * 1e6 for times in (bare, whole, none))
    tell(f"forces alone {a:.2f} us a design; sweep, all kept {b:.2f} us; reductions alone kept {c:.2f} us")


def on_two_workers(folder, count, rounds):
    """Wall time on one and on two workers of Dask, and of `Processes`; processor time of the client."""
    best, own = {}, {}
    for kind in ("dask", "processes"):
        for workers in (1, 2):
            with cluster(workers) if kind == "dask" else blocks.Processes(workers) as client:
                run(40_000 * workers, folder / "warm", client=client)
                times, spent = [], []
                for i in range(rounds):
                    start, before = time.perf_counter(), time.process_time()
                    run(count, folder / f"{kind}{workers}.{i}", client=client, keep=["peak_force", "reach"])
                    times.append(time.perf_counter() - start)
                    spent.append(time.process_time() - before)
                    shutil.rmtree(folder / f"{kind}{workers}.{i}")
            shutil.rmtree(folder / "warm")
            best[kind, workers], own[kind, workers] = min(times), min(spent)
        one, two = best[kind, 1], best[kind, 2]
        tell(
            f"{kind}: {count / one:.0f} designs/s on one worker, {count / two:.0f} on two: {one / two:.2f} x"
        )
        client_s = 1e3 * own[kind, 2] * problem(count).block_size / count
        tell(f"{kind}: client and scheduler {client_s:.2f} ms of processor time a block")


@contextmanager
def watched():
    """Give a list to which the largest resident size of this process is added in the end [bytes]."""
    process, sizes, stop = psutil.Process(), [], threading.Event()

    def watch():
        while not stop.wait(0.01):
            sizes.append(process.memory_info().rss)

    thread = threading.Thread(target=watch)
    thread.start()
    found = []
    try:
        yield found
    finally:
        stop.set()
        thread.join()
        found.append(max(sizes, default=0))


def memory_of_the_client(folder, count):
    """Largest memory of the client of a cluster, for sweeps of growing size."""
    with cluster(2) as client:
        run(100_000, folder / "warm", client=client, keep=None)
        for size in (count // 10, count):
            for shared in (True, False):
                out = folder / f"memory{size}{shared}"
                tracemalloc.start()
                with watched() as rss:
                    run(size, out, client=client, keep=["peak_force", "reach"], shared=shared)
                peak = tracemalloc.get_traced_memory()[1]
                tracemalloc.stop()
                shutil.rmtree(out)
                where = "written by workers" if shared else "written by the client"
                tell(
                    f"client over {size} designs, {where}: Python objects {peak / 1e6:.1f} MB, "
                    f"process {rss[0] / 1e6:.0f} MB"
                )


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*.npz"))}


def killed_twice(folder, count):
    """Kill a worker at a quarter, the program at a half; go on; compare every byte."""
    out, whole = folder / "killed", folder / "whole"
    text = PROGRAM.format(folder=str(Path(__file__).parent), count=count, out=str(out))
    half = problem(count).count // problem(count).block_size // 2
    with subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True) as program:
        pids = [int(pid) for pid in program.stdout.readline().split()]
        for blocks_there, pid in ((half // 2, pids[0]), (half, program.pid)):
            while len(list(out.rglob("*.npz"))) < blocks_there:
                if program.poll() is not None:
                    raise SystemExit("the program ended too early")
                time.sleep(0.01)
            os.kill(pid, 9)
    left = blocks.Sweep.load(out)
    tell(f"killed at {len(left.numbers)} of {left.manifest.blocks} blocks")
    with blocks.Processes(2) as client:
        run(count, out, client=client, resume=True)
    run(count, whole)
    same = files(out) == files(whole)
    tell(f"{count} designs, a worker and then the program killed: files {'the same' if same else 'DIFFER'}")
    if not same:
        raise SystemExit(1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    dask.config.set({"logging.distributed": "critical"})
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        beside_bare_calls(folder, 100_000)
        on_two_workers(folder, arguments.count, arguments.rounds)
        memory_of_the_client(folder, arguments.count)
        killed_twice(folder, arguments.count)


if __name__ == "__main__":
    main()
