"""`DesignSweep`: the forces of any number of machines over one motion, as a problem of `p3dof.sweep`."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import Block, Sampling, digest
from p3dof._base.checks import positive
from p3dof._base.errors import InputError
from p3dof._base.time_series.wrenches import Load, WrenchOverTime
from p3dof.analysis.designs import DesignEvaluation, DesignForces, Designs
from p3dof.analysis.designs.columns import QUANTITIES, BodiesOfDesigns, columns_of
from p3dof.analysis.designs.figures import BITS, FigureGroup
from p3dof.analysis.designs.results import RESULT_UNITS
from p3dof.closed_form.compiled.designs import compiled_level
from p3dof.closed_form.compiled.kernels import NUMPY
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import PAPER, Parameters
from p3dof.runs.many import ManyRuns, simulate_many
from p3dof.runs.many.columns import run_columns_of, unit_of
from p3dof.runs.many.many import require_runs

_SHORT = 16  # longest array that is told number by number

_DEEPEST = 8


def described(value: Any) -> Any:
    """Return plain data that differ where an object differs: its class and its attributes, arrays as hashes.

    For JSON. What is not made of these counts by its class alone.
    """
    return _described(value, 0)


def _described(value: Any, depth: int) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value) if isinstance(value, float) and not np.isfinite(value) else value
    for kinds, tell in _KNOWN.items():
        if isinstance(value, kinds):
            return tell(value)
    kind = type(value)
    if depth > _DEEPEST:
        return kind.__qualname__
    if isinstance(value, list | tuple):
        return [_described(item, depth + 1) for item in value]
    parts = value if isinstance(value, Mapping) else getattr(value, "__dict__", {})
    found = {str(name): _described(item, depth + 1) for name, item in parts.items()}
    return (
        found if isinstance(value, Mapping) else {"kind": f"{kind.__module__}.{kind.__qualname__}", **found}
    )


def _of_array(value: Any) -> Any:
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        return [_described(item, _DEEPEST) for item in array.ravel().tolist()]
    if array.size <= _SHORT and np.isfinite(array).all():
        return array.tolist()
    return {"shape": list(array.shape), "sha256": digest(array)}


def _of_machine(machine: Parameters) -> dict[str, str]:
    text = json.dumps(machine.to_dict(), sort_keys=True)
    return {"kind": "Parameters", "sha256": hashlib.sha256(text.encode()).hexdigest()}


def _of_function(function: Any) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def motion_settings(motion: Motion) -> dict[str, Any]:
    """Return what tells a motion from others."""
    return {
        "samples": len(motion),
        "from": float(motion.time[0]),
        "to": float(motion.time[-1]),
        "sha256": digest(motion.time, motion.pose, motion.velocity, motion.acceleration),
    }


_KNOWN: dict[tuple[type, ...], Callable[[Any], Any]] = {
    (np.ndarray, np.generic): _of_array,
    (Parameters,): _of_machine,
    (Motion,): motion_settings,
    (FunctionType, BuiltinFunctionType, MethodType): _of_function,
}
"""What is told in another way than by its attributes."""


WORST = ("peak_force", "rms_force", "peak_speed", "peak_power", "peak_braking")
"""Figures of three actuators of which there is a column with the largest too."""


class DesignSweep:
    """The forces of machines over one motion, for `p3dof.sweep`: what `forces_of_designs` finds.

    The columns are the inputs, by their full names (``geometry.R``, in SI units), and the figures: ``status``
    (a `DesignStatus`, 0 for designs that make the motion), ``reach``, ``peak_force_a`` and so on, without
    units in their names, and ``peak_force``, the largest of the three. Figures of designs that cannot perform
    the motion are NaN.

    Parameters
    ----------
    sampling : Sampling
        The columns that differ between machines, named as `Designs` takes them: `p3dof.blocks.Samples`,
        `p3dof.blocks.Grid`, `FileRows`.
    motion : Motion
        What every machine does.
    machine : Parameters, optional
        What has no column; the paper's machine by default.
    bodies : {"kept", "solids"}
        Keep the bodies of `machine`, or compute them anew from solids of each design.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P [N, N m].
    figures : iterable of {"singularity", "sliders", "power"}
        What to compute beside forces and reach.
    level : str, optional
        What to run on, as of `MachineKernels`: that of this computer by default. All workers take the same,
        whose last bits differ from those of others.
    block_size : int
        Designs of a block where nobody says how many.

    Raises
    ------
    InputError
        If a column or an argument does not fit.
    """

    def __init__(
        self,
        sampling: Sampling,
        motion: Motion,
        machine: Parameters | None = None,
        bodies: BodiesOfDesigns = "kept",
        wrench: WrenchOverTime = None,
        figures: Iterable[FigureGroup] = ("singularity",),
        level: str | None = None,
        block_size: int = 20_000,
    ) -> None:
        self.sampling, self.bodies, self.block_size = sampling, bodies, block_size
        self.machine = PAPER if machine is None else machine
        load = None if wrench is None else Load(wrench, motion.start).over(motion.time)
        self.level = compiled_level(level, 1)[0] or NUMPY
        self.forces = DesignEvaluation(motion, load, figures, (), self.level, 1)
        self._load = load
        self._inputs = columns_of(sampling.names)
        Designs(dict.fromkeys(sampling.names, np.ones(1)), self.machine, bodies)  # names that fit each other

    @property
    def count(self) -> int:
        """How many designs there are."""
        return self.sampling.count

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the inputs, then of the figures."""
        one = Designs({"geometry.R": [self.machine.geometry.R]}, self.machine)
        return (*(column.name for column in self._inputs), *_figures(self.forces.evaluate(one)))

    @cached_property
    def units(self) -> dict[str, str]:
        """Units of the columns that have one."""
        known = {name: QUANTITIES[name].unit for name in (column.name for column in self._inputs)}
        for column in self.columns[len(known) :]:
            known[column] = RESULT_UNITS[column if column in RESULT_UNITS else column.rpartition("_")[0]]
        return {name: unit for name, unit in known.items() if unit}

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on."""
        return {
            "machine": self.machine.to_dict(),
            "bodies": self.bodies,
            "motion": motion_settings(self.forces.motion),
            "wrench": None if self._load is None else digest(self._load),
            "figures": [group for group, bit in BITS.items() if self.forces.asked & bit],
            "level": self.level,
            "sampling": dict(self.sampling.settings()),
        }

    def compute(self, block: Block) -> dict[str, NDArray[Any]]:
        """Return the columns of a block."""
        drawn = self.sampling.draw(block)
        pairs = zip(self._inputs, self.sampling.names, strict=True)
        inputs = {column.name: column.in_si(drawn[name]) for column, name in pairs}
        found = self.forces.evaluate(Designs(inputs, self.machine, self.bodies))
        return {**inputs, **_figures(found)}


def _figures(found: DesignForces) -> dict[str, NDArray[Any]]:
    """Return figures by the names of columns, without units, with the largest of three."""
    columns = {name.partition(" [")[0]: values for name, values in found.to_columns().items()}
    for name in WORST:
        of_actuators = getattr(found, name)
        if of_actuators is not None:
            columns[name] = of_actuators.max(axis=1, initial=-np.inf)
    return columns


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
        return {**inputs, **_figures_of_runs(found)}


def _figures_of_runs(found: ManyRuns) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {"stop": found.stop, "end": found.time}
    for prefix, name in _BY_AXIS.items():
        columns |= {f"{prefix}{axis}": getattr(found, name)[:, i] for i, axis in enumerate(_AXES)}
    for name in _BY_LEG:
        values = getattr(found, name)
        columns |= {f"{name}_{leg}": values[:, i] for i, leg in enumerate(_LEGS)}
        columns[name] = values.max(axis=1, initial=-np.inf)
    return columns | {"work": found.work, "energy": found.energy}
