"""`RunSweep`: simulations of any number of machines, as a problem of `p3dof.sweep`."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import Block, Sampling
from p3dof._base.checks import positive
from p3dof._base.errors import InputError
from p3dof.closed_form.compiled.designs import compiled_level
from p3dof.closed_form.compiled.kernels import NUMPY
from p3dof.design.sweeps.designs import described
from p3dof.machine.parameters import PAPER, Parameters
from p3dof.runs.many import ManyRuns, simulate_many
from p3dof.runs.many.columns import run_columns_of, unit_of
from p3dof.runs.many.many import require_runs

SEED = "seed"
_AXES, _LEGS = ("y", "z", "theta"), ("a", "b", "c")
_BY_AXIS = {"": "pose", "velocity_": "velocity", "peak_error_": "peak_error", "rms_error_": "rms_error"}
_BY_LEG = ("peak_force", "rms_force")
_LEFT_OUT = ("histories", "every", "threads", "progress", "level")


class RunSweep:
    """Simulations, each with its own machine, start, gains and noise, for `p3dof.sweep`.

    The columns are the inputs, by their full names (``geometry.L``, in SI units), and what
    `p3dof.runs.simulate_many` counts: ``stop`` (why a run ended, as of `p3dof.runs.many.reason_of`; -1 at its
    end), ``end`` (when [s]), the pose ``y``, ``z``, ``theta`` and ``velocity_y`` and so on at the end,
    ``peak_error_y``, ``rms_error_y``, ``peak_force_a``, ``rms_force_a``, the largest of the three
    ``peak_force`` and ``rms_force``, ``work`` and ``energy``.

    Parameters
    ----------
    sampling : Sampling
        The columns that differ between runs, named as `p3dof.runs.simulate_many` takes them.
    duration : float
        How long each run is [s].
    machine : Parameters, optional
        What has no column; the paper's machine by default.
    level : str, optional
        What to run on, as of `MachineKernels`: that of this computer by default, for all workers.
    block_size : int
        Runs of a block where nobody says how many.
    **options
        Of `simulate_many`: start, controller, control, reference, wrench, stop_at, integration. The
        noise of a run has the seed of its `Noise` plus the number of the run, unless there is a column
        ``seed``.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    def __init__(
        self,
        sampling: Sampling,
        duration: float,
        machine: Parameters | None = None,
        level: str | None = None,
        block_size: int = 2_000,
        **options: Any,
    ) -> None:
        for name in options:
            if name in _LEFT_OUT:
                raise InputError(f"{name}: expected none, a sweep has its own")
        self.sampling, self.block_size = sampling, block_size
        self._inputs = run_columns_of(sampling.names)
        self.duration = positive("duration", duration, InputError)
        self.machine = PAPER if machine is None else machine
        self.level = compiled_level(level, 1)[0] or NUMPY
        self._options = copy.deepcopy(options)
        self._described = {name: described(value) for name, value in sorted(options.items())}
        noise = getattr(options.get("control"), "noise", None)
        names = [column.name for column in self._inputs]
        self._first_seed = None if noise is None or SEED in names else int(noise.seed)
        require_runs(self.machine, self.duration, dict.fromkeys(names, np.ones(1)), **options)

    @property
    def count(self) -> int:
        """How many runs there are."""
        return self.sampling.count

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the inputs, then of the figures."""
        figures = [f"{prefix}{axis}" for prefix in _BY_AXIS for axis in _AXES]
        figures += [f"{name}_{leg}" for name in _BY_LEG for leg in _LEGS]
        return (
            *(column.name for column in self._inputs),
            "stop",
            "end",
            *figures,
            *_BY_LEG,
            "work",
            "energy",
        )

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns that have one."""
        known = {column.name: unit_of(column.name) for column in self._inputs} | {"end": "s"}
        for prefix, by_axis in _BY_AXIS.items():
            rate = "/s" if by_axis == "velocity" else ""
            known |= {f"{prefix}{axis}": f"{'rad' if axis == 'theta' else 'm'}{rate}" for axis in _AXES}
        known |= dict.fromkeys((*_BY_LEG, *(f"{name}_{leg}" for name in _BY_LEG for leg in _LEGS)), "N")
        return {name: unit for name, unit in (known | {"work": "J", "energy": "J"}).items() if unit}

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on."""
        return {
            "machine": self.machine.to_dict(),
            "duration": self.duration,
            "level": self.level,
            **self._described,
            "sampling": dict(self.sampling.settings()),
        }

    def compute(self, block: Block) -> dict[str, NDArray[Any]]:
        """Return the columns of a block."""
        drawn = self.sampling.draw(block)
        pairs = zip(self._inputs, self.sampling.names, strict=True)
        inputs: dict[str, NDArray[Any]] = {column.name: column.in_si(drawn[name]) for column, name in pairs}
        given = dict(inputs)
        if self._first_seed is not None:
            given[SEED] = np.arange(block.start, block.stop) + self._first_seed
        options = copy.deepcopy(self._options)  # a controller may remember its last run
        found = simulate_many(self.machine, self.duration, given, level=self.level, threads=1, **options)
        if found.interrupted:
            raise KeyboardInterrupt
        return {**inputs, **_figures(found)}


def _figures(found: ManyRuns) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {"stop": found.stop, "end": found.time}
    for prefix, name in _BY_AXIS.items():
        columns |= {f"{prefix}{axis}": getattr(found, name)[:, i] for i, axis in enumerate(_AXES)}
    for name in _BY_LEG:
        values = getattr(found, name)
        columns |= {f"{name}_{leg}": values[:, i] for i, leg in enumerate(_LEGS)}
        columns[name] = values.max(axis=1, initial=-np.inf)
    return columns | {"work": found.work, "energy": found.energy}
