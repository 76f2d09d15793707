"""Kernels for gradients of designs: forces and sliders, and how they change along one direction.

Forward mode of the formulas in `p3dof.closed_form.compiled.design_kernels`. A direction is part of the
constants, as the numbers of the machine are: what only these need is computed once for a design.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.derivatives import tangent
from p3dof.closed_form.compiled.design_kernels import SPEEDS, Sample, kernel_of, numbers_of
from p3dof.closed_form.compiled.formulas import FORCES, MODEL, POSE, SLIDERS, Kernel
from p3dof.closed_form.compiled.reduced import Model


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
    """Return the kernel of forces and how they change.

    Parameters
    ----------
    friction : bool
        Whether there is friction.
    symmetric : bool
        For symmetric bodies and gravity along z0 that stay so.

    Returns
    -------
    Kernel
        Its `model` has the numbers of a machine and of its friction, their rates, and those of the pose.
    """
    trace = _Trace(friction, symmetric)
    x = trace.sample.shape(trace.model)
    wrench = trace.sample.wrench(x, trace.numbers[len(MODEL) :])
    forces = trace.sample.forces(trace.model, x, wrench)
    name = "forces_tangent" + "_with_friction" * friction + "_symmetric" * symmetric
    return trace.kernel(name, forces, FORCES)


@cache
def sliders_tangent() -> Kernel:
    """Return the kernel of the sliders' positions and speeds and how they change.

    Returns
    -------
    Kernel
        Likewise.
    """
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
