"""The compiled loop over designs: constants by columns in, a row of figures a design out.

Kernels for many designs over one motion: forces, and what goes with them, from constants of each design.

Less than the kernels of one machine do: sine and cosine of the motion are the same for all designs and come
with the samples; whether a state is good follows from the least of a few values over the motion; and roots
come from `rsqrt`, which with wide vectors is made of products: they overlap, while processors divide and take
roots one after the other.

Kernels for gradients of designs: forces and sliders, and how they change along one direction.

Forward mode of the formulas in `p3dof.closed_form.compiled.designs`. A direction is part of the
constants, as the numbers of the machine are: what only these need is computed once for a design.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.algebra import Vector, subtract
from p3dof._base.checks import FloatArray
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.tape import in_pairs, tangent
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import (
    ACCELERATION,
    FORCES,
    MODEL,
    POSE,
    SLIDERS,
    VELOCITY,
    WRENCH,
    Kernel,
)
from p3dof.closed_form.compiled.kernels import NUMPY, MachineKernels, _extension
from p3dof.closed_form.compiled.reduced import SMALLER_ZEROS, Model, Shape, State
from p3dof.closed_form.compiled.reduced.dynamics import FRICTION, generalized_friction
from p3dof.closed_form.compiled.reduced.shapes import roots_of_u

INPUTS = ("y", "z", "sine", "cosine", *VELOCITY, *ACCELERATION, *WRENCH)
"""What a sample has, for all of these kernels."""

SPEEDS = ("speed_a", "speed_b", "speed_c")

NAMES = (
    "design_forces",
    "design_forces_symmetric",
    "design_motion",
    "design_motion_symmetric",
    "design_motion_with_friction",
    "design_motion_with_friction_viscous",
)
"""Forces without a wrench; forces under one, with the sliders; these with friction, and without Coulomb's."""


class Sample:
    """A sample on a tape, with sine and cosine known; takes the place of the tape as a namespace."""

    def __init__(self, tape: Tape) -> None:
        self.tape = tape
        self.symbols = tape.symbols(INPUTS)
        self.rows = dict(zip(INPUTS, self.symbols, strict=True))

    def sin(self, _: Number) -> Number:
        """Sine of the platform's angle."""
        return self.rows["sine"]

    def cos(self, _: Number) -> Number:
        """Cosine of the platform's angle."""
        return self.rows["cosine"]

    def sqrt(self, x: Number) -> Number:
        """Square root."""
        return self.tape.sqrt(x)

    def tanh(self, x: Number) -> Number:
        """Hyperbolic tangent."""
        return self.tape.tanh(x)

    @property
    def velocity(self) -> Vector:
        """ẏ, ż, θ̇."""
        return self.rows["vy"], self.rows["vz"], self.rows["vtheta"]

    def shape(self, model: Model) -> Shape:
        """Return where a mechanism is."""
        return reduced.shape(model, self.rows["y"], 0, self, rsqrt=self.tape.rsqrt)

    def forces(self, model: Model, x: Shape, wrench: Vector = (0, 0, 0)) -> Vector:
        """Return the forces of the actuators."""
        state = State(*(self.rows.get(name, 0) for name in State._fields))
        return reduced.actuator_forces(model, x, state, self, wrench)

    def wrench(self, x: Shape, friction: Sequence[Number] = ()) -> Vector:
        """Return the wrench, less what friction takes."""
        load: Vector = (self.rows["w_y"], self.rows["w_z"], self.rows["w_theta"])
        if not friction:
            return load
        half = len(friction) // 2
        coefficients = friction[:half], friction[half:-1], friction[-1]
        return subtract(load, generalized_friction(x, self.rows["y"], self.velocity, coefficients, self))

    def sliders(self, model: Model, x: Shape) -> list[Number]:
        """Return positions and speeds of the sliders."""
        return [*reduced.sliders(model, x, self.rows["z"], self), *reduced.slider_rates(x, self.velocity)]


def numbers_of(tape: Tape, symmetric: bool, friction: bool, prefix: str = "") -> tuple[Number, ...]:
    """Return the numbers of a machine on a tape, and of its friction."""
    zeros = SMALLER_ZEROS if symmetric else ()
    names = (*MODEL, *(FRICTION if friction else ()))
    return tuple(0 if name in zeros else tape.symbol(prefix + name, constant=True) for name in names)


@cache
def design_kernel(name: str) -> Kernel:
    """Return a kernel, traced once; ``sine`` is r² s |s|, s of the angle from the actuation singularity."""
    tape = Tape()
    numbers = numbers_of(tape, name.endswith("_symmetric"), "_with_friction" in name)
    if name.endswith("_viscous"):
        numbers = (*numbers[: len(MODEL)], *without_coulomb(numbers[len(MODEL) :]))
    model, sample = Model.of_numbers(numbers[: len(MODEL)]), Sample(tape)
    x = sample.shape(model)
    moving = name.startswith("design_motion")
    forces = sample.forces(model, x, sample.wrench(x, numbers[len(MODEL) :]) if moving else (0, 0, 0))
    hold = x.arm * x.Sc
    sine = hold * tape.fabs(hold) * roots_of_u(x, sample, rooted=not name.endswith("_symmetric"))[2]
    results = [*forces, sine, *(sample.sliders(model, x) if moving else ())]
    outputs = (*FORCES, "sine", *((*SLIDERS, *SPEEDS) if moving else ()))
    return kernel_of(name, tape, numbers, sample, outputs, results)


def kernel_of(
    name: str,
    tape: Tape,
    numbers: tuple[Number, ...],
    sample: Sample,
    outputs: tuple[str, ...],
    results: Sequence[Number],
) -> Kernel:
    """Return results at a sample as a kernel that divides in pairs."""
    return Kernel(name, tape, numbers, INPUTS, outputs, sample.symbols, tuple(in_pairs(tape, results)))


def without_coulomb(friction: Sequence[Number]) -> tuple[Number, ...]:
    """Return coefficients of friction with zeros for what needs a hyperbolic tangent each."""
    half = len(friction) // 2
    return *friction[:half], *[0] * half, 0


def smaller_form(name: str) -> str:
    """Return the kernel of symmetric bodies, or of friction without Coulomb's, where it serves."""
    return f"{name}_viscous" if name.endswith("_with_friction") else f"{name}_symmetric"


def tangent_kernels() -> list[Kernel]:
    """Return all of them."""
    return [
        forces_tangent(),
        forces_tangent(symmetric=True),
        forces_tangent(friction=True),
        sliders_tangent(),
    ]


@cache
def forces_tangent(friction: bool = False, symmetric: bool = False) -> Kernel:
    """Return the kernel of forces and their change, by numbers of machine and friction, and their rates."""
    trace = _Trace(friction, symmetric)
    x = trace.sample.shape(trace.model)
    wrench = trace.sample.wrench(x, trace.numbers[len(MODEL) :])
    forces = trace.sample.forces(trace.model, x, wrench)
    name = "forces_tangent" + "_with_friction" * friction + "_symmetric" * symmetric
    return trace.kernel(name, forces, FORCES)


@cache
def sliders_tangent() -> Kernel:
    """Return the kernel of the sliders' positions and speeds and how they change; likewise."""
    trace = _Trace(False, False)
    found = trace.sample.sliders(trace.model, trace.sample.shape(trace.model))
    return trace.kernel("sliders_tangent", found, (*SLIDERS, *SPEEDS))


class _Trace:
    def __init__(self, friction: bool, symmetric: bool) -> None:
        tape = self.tape = Tape()
        self.numbers = numbers_of(tape, symmetric, friction)
        self.rates = numbers_of(tape, symmetric, friction, "d_")
        self.pose_rates = tape.symbols((f"d_{name}" for name in POSE), constant=True)
        self.model = Model.of_numbers(self.numbers[: len(MODEL)])
        self.sample = Sample(tape)

    def kernel(self, name: str, results: Sequence[Number], names: tuple[str, ...]) -> Kernel:
        """Return results and their tangents as a kernel."""
        rows, (y, z, theta) = self.sample.rows, self.pose_rates
        seeds: dict[int, Number] = {
            value.index: rate
            for value, rate in zip(self.numbers, self.rates, strict=True)
            if isinstance(value, Symbol)
        }
        seeds |= {rows["y"].index: y, rows["z"].index: z}
        seeds |= {rows["sine"].index: rows["cosine"] * theta, rows["cosine"].index: -(rows["sine"] * theta)}
        outputs = (*names, *(f"d_{name}" for name in names))
        model = (*self.numbers, *self.rates, *self.pose_rates)
        return kernel_of(name, self.tape, model, self.sample, outputs, [*results, *tangent(results, seeds)])


_ZEROS = tuple(MODEL.index(name) for name in SMALLER_ZEROS)
_LENGTHS = 3  # r, R, L; as many numbers as a pose has
_SLIDERS, _POWER = 2 | 4, 4


def width_of(asked: int) -> int:
    """Return how many numbers a row of results has; `DesignLoop` tells which."""
    return 34 if asked & _POWER else 22 if asked & _SLIDERS else 13


class DesignLoops:
    """Figures of many designs over one motion; any number of threads may ask at once.

    Which kernel computes a design does not depend on the designs beside it, so that its figures do not.
    """

    def __init__(
        self, packed: FloatArray, samples: int, points: int, kind: str, asked: int, level: str
    ) -> None:
        moving = "with_friction" if kind == "with_friction" else "motion" if kind or asked & _SLIDERS else ""
        general = {"with_friction": "design_motion_with_friction", "motion": "design_motion"}
        name = general.get(moving, "design_forces")
        names = {True: smaller_form(name), False: name}
        self._kernels = {smaller: design_kernel(each) for smaller, each in names.items()}
        self._asked, self._friction = asked, kind == "with_friction"
        self._width = width_of(asked)
        self._memory = threading.local()
        self._loops = {
            smaller: _extension().DesignLoop(used.name, level, asked, samples, points, packed)
            for smaller, used in self._kernels.items()
        }

    def rows(self, model: Sequence[Any], offsets: FloatArray | None, count: int) -> FloatArray:
        """Return the figures of designs; ndarray, shape (D, width_of(asked))."""
        smaller = _without_coulomb(model, count) if self._friction else _symmetric(model, count)
        found = self._table(count)
        for form in (True, False):
            members: Any = np.flatnonzero(smaller == form)
            if len(members) == count:
                self._run(form, model, offsets, found)
            elif len(members):
                part = np.empty((len(members), self._width))
                some = [number[members] if _is_column(number) else number for number in model]
                self._run(form, some, None if offsets is None else offsets[members], part)
                found[members] = part
        return found

    def rates(
        self,
        model: Sequence[Any],
        by_numbers: Sequence[Any],
        by_pose: Sequence[float],
        offsets: FloatArray | None,
        count: int,
    ) -> FloatArray:
        """Return how the figures change along a direction, as of `rows` without status and times."""
        symmetric = _symmetric(model, count) & _symmetric(by_numbers, count) & (not self._friction)
        found = np.empty((count, self._width))
        moved = (*model, *by_numbers, *by_pose)
        for form in (True, False):
            members: Any = np.flatnonzero(symmetric == form)
            if len(members) == count:
                self._run_rates(form, moved, offsets, found)
            elif len(members):
                part = np.empty((len(members), self._width))
                some = [number[members] if _is_column(number) else number for number in moved]
                self._run_rates(form, some, None if offsets is None else offsets[members], part)
                found[members] = part
        return found

    def _run_rates(
        self, form: bool, moved: Sequence[Any], offsets: FloatArray | None, found: FloatArray
    ) -> None:
        count, width = len(found), (len(moved) - _LENGTHS) // 2
        lengths = np.empty((count, 3 * _LENGTHS))
        given = (*moved[:_LENGTHS], *moved[width : width + _LENGTHS], *moved[-_LENGTHS:])
        for column, number in zip(lengths.T, given, strict=True):
            column[:] = number
        of_lengths = (*moved[: len(MODEL)], *moved[width : width + len(MODEL)], *moved[-_LENGTHS:])
        with np.errstate(all="ignore"):
            constants = forces_tangent(self._friction, form).of_columns(moved, count)
            sliding = self._asked & _SLIDERS
            turning = sliders_tangent().of_columns(of_lengths, count) if sliding else None
        place = None if offsets is None else np.ascontiguousarray(offsets)
        self._loops[form].tangent(form, constants, turning, lengths, place, found)

    def _table(self, count: int) -> FloatArray:
        """Return a table of this thread: new memory at each call would cost a tenth of the work."""
        known = getattr(self._memory, "table", None)
        if known is None or len(known) < count:
            known = self._memory.table = np.empty((count, self._width))
        table: FloatArray = known[:count]
        return table

    def _run(self, form: bool, numbers: Sequence[Any], offsets: FloatArray | None, found: FloatArray) -> None:
        count = len(found)
        lengths = np.empty((count, _LENGTHS))
        for column, number in zip(lengths.T, numbers[:_LENGTHS], strict=True):
            column[:] = number
        with np.errstate(all="ignore"):
            constants = self._kernels[form].of_columns(numbers, count)
        moved = None if offsets is None else np.ascontiguousarray(offsets)
        self._loops[form](constants, lengths, moved, found)


def compiled_level(level: str | None, threads: int | None) -> tuple[str | None, int]:
    """Return at which level loops over designs run here, None on NumPy, and on how many threads."""
    from p3dof.machine.parameters import PAPER

    kernels = MachineKernels(PAPER, level, threads)
    return None if kernels.level == NUMPY else kernels.level, kernels.threads


def _is_column(number: Any) -> bool:
    return isinstance(number, np.ndarray) and number.ndim > 0


def _symmetric(model: Sequence[Any], count: int) -> NDArray[np.bool_]:
    """Return which designs the smaller kernels serve (D,), as `is_symmetric`."""
    found = np.ones(count, dtype=bool)
    for place in _ZEROS:
        found &= np.equal(model[place], 0)
    return found


def _without_coulomb(model: Sequence[Any], count: int) -> NDArray[np.bool_]:
    """Return of which designs all friction is viscous (D,)."""
    coefficients = len(model) - len(MODEL) - 1
    found = np.ones(count, dtype=bool)
    for number in model[len(MODEL) + coefficients // 2 : -1]:
        found &= np.equal(number, 0)
    return found
