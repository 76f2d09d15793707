"""Sweeps that tests compute, in this process and in workers: peak forces of machines with random lengths."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import p3dof
from p3dof._base import blocks

MOTION = p3dof.paper_motion(41)
VARIABLES = {"R": blocks.Uniform(0.22, 0.3), "L": blocks.Uniform(0.38, 0.5), "share": blocks.Normal(1.0, 0.1)}
WAITING = "waiting-"
"""What the notes of blocks that wait at a gate begin with."""
OUTPUTS = ("peak_a", "peak_b", "peak_c", "height")


def peaks(columns):
    """Peak forces over the paper's motion of machines of the given lengths and masses, one by one."""
    found = []
    for R, L, share in zip(*(columns[name] for name in VARIABLES), strict=True):
        geometry = replace(p3dof.PAPER.geometry, R=R, L=L)
        machine = replace(p3dof.PAPER, geometry=geometry, bodies=p3dof.PAPER.bodies.scaled(share))
        forces = p3dof.load(machine).forces(
            MOTION.pose, MOTION.velocity, MOTION.acceleration, method="compiled", on_invalid="nan"
        )
        found.append([*np.abs(forces).max(axis=0), geometry.h])
    return dict(zip(OUTPUTS, np.array(found).T, strict=True))


def problem(count=60, block_size=5, method="random", function=peaks):
    return blocks.FunctionProblem(
        blocks.Samples(VARIABLES, count, method), function, OUTPUTS, {"samples": len(MOTION)}, block_size
    )


def reductions():
    return (
        blocks.TopK("peak_a", 7),
        blocks.ParetoArchive({"peak_a": "min", "height": "max"}),
        blocks.Histogram("peak_c", 0, 200, 10),
        blocks.Moments(("peak_a", "peak_b")),
    )


@dataclass(frozen=True)
class Gated:
    """The same inputs, whose blocks from one on wait until a file is there; each leaves a note of it."""

    sampling: blocks.Samples
    gate: Path
    first: int

    @property
    def count(self):
        return self.sampling.count

    @property
    def names(self):
        return self.sampling.names

    def settings(self):
        return self.sampling.settings()

    def draw(self, block):
        if block.number >= self.first:
            self.gate.with_name(f"{WAITING}{block.number}").touch()
            while not self.gate.exists():
                time.sleep(0.01)
        return self.sampling.draw(block)


def gated(gate, first, **options):
    """The same problem, whose blocks from one on wait until a file is there."""
    free = problem(**options)
    return replace(free, sampling=Gated(free.sampling, Path(gate), first))


def files(folder):
    """The bytes of everything that a sweep found."""
    found = {}
    for path in sorted(Path(folder).rglob("*")):
        if path.is_file() and path.suffix in {".npz", ".parquet"}:
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def wait_until(what, seconds=60.0):
    """Wait for a state; fail if it does not come."""
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)


PARQUET = pytest.mark.skipif(find_spec("pyarrow") is None, reason="pyarrow not installed")


def environment():
    paths = [
        str(Path(__file__).parent),
        str(Path(p3dof.__file__).parents[1]),
        os.environ.get("PYTHONPATH", ""),
    ]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
