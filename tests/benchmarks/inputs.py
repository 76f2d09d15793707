"""What the contenders compute: two machines, random states that both reach, and columns of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

import p3dof
from p3dof.closed_form.compiled import MachineKernels
from p3dof.closed_form.compiled.formulas import ACCELERATION, FORCES, POSE, SLIDERS, VELOCITY, WRENCH
from p3dof.machine.parameters import LINKS, Bodies, Body, Parameters

CACHED = 1000
"""Samples whose columns stay in the cache."""

MILLION = 1_000_000
CACHE_LINE = 8  # doubles
SPREAD = {
    **dict.fromkeys(POSE, 0.05),
    **dict.fromkeys(VELOCITY, 0.5),
    **dict.fromkeys(ACCELERATION, 5.0),
    **dict.fromkeys((*WRENCH, *FORCES), 20.0),
    **dict.fromkeys(SLIDERS, 0.02),
}
"""Largest size of every number of a sample, in SI units."""


def general_machine() -> Parameters:
    """Return the paper's machine with bodies that lack any symmetry, under gravity along no axis."""
    rng = np.random.default_rng(6)
    return Parameters(
        p3dof.PAPER.geometry, Bodies(**{link: _cloud(rng) for link in LINKS}), gravity=(0.4, -0.3, -9.7)
    )


def _cloud(rng: np.random.Generator) -> Body:
    """Return the body of five point masses anywhere."""
    masses, positions = rng.uniform(0.1, 1, 5), rng.uniform(-0.2, 0.2, (5, 3))
    com = masses @ positions / masses.sum()
    d = positions - com
    moments = d.T @ (masses[:, None] * d)
    return Body(masses.sum(), com, np.trace(moments) * np.eye(3) - moments)


MACHINES = {"general": general_machine(), "symmetric": p3dof.PAPER}
"""The machines by the form of the kernels that serve them."""


@cache
def rows(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pose, velocity and acceleration (count, 3) of random states."""
    rng = np.random.default_rng(count)
    found = [
        rng.uniform(-1, 1, (count, 3)) * [SPREAD[name] for name in names]
        for names in (POSE, VELOCITY, ACCELERATION)
    ]
    return found[0], found[1], found[2]


@cache
def columns(names: tuple[str, ...], count: int) -> list[np.ndarray]:
    """Return one column a name (count,), random, at the start of a cache line, an odd number of them apart.

    Columns a multiple of 4 KiB apart would fight for the same places in the cache.
    """
    rng = np.random.default_rng(count)
    lines = count // CACHE_LINE + 1
    length = (lines + 1 - lines % 2) * CACHE_LINE
    room = np.empty(len(names) * length + CACHE_LINE)
    start = -room.ctypes.data // room.itemsize % CACHE_LINE
    block = room[start : start + len(names) * length].reshape(len(names), length)
    for name, column in zip(names, block, strict=True):
        column[:] = rng.uniform(-SPREAD.get(name, 1.0), SPREAD.get(name, 1.0), len(column))
    return list(block[:, :count])


def kernel_columns(
    kernels: MachineKernels, name: str, count: int
) -> tuple[Sequence[np.ndarray], Sequence[np.ndarray | None]]:
    """Return inputs and outputs of a kernel; its margin is not kept."""
    used, _ = kernels.prepared(name)
    split = len(used.inputs)
    found = columns((*used.inputs, *used.outputs[:-1]), count)
    return found[:split], [*found[split:], None]


def forget() -> None:
    """Let go of all arrays."""
    rows.cache_clear()
    columns.cache_clear()
