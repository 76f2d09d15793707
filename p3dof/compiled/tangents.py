"""Kernels for gradients of designs: forces and sliders, and how they change along one direction.

Forward mode of the same formulas as in `p3dof.compiled.formulas`. A direction is part of the constants, as
the numbers of the machine are: what only these need is computed once for a design.
"""

from __future__ import annotations

from functools import cache

from p3dof.compiled import reduced
from p3dof.compiled.formulas import (
    ACCELERATION,
    FORCES,
    MODEL,
    POSE,
    SLIDERS,
    VELOCITY,
    WRENCH,
    Kernel,
    less_friction,
)
from p3dof.compiled.reduced import SYMMETRIC_ZEROS, Model, State
from p3dof.compiled.reduced.friction import FRICTION
from p3dof.tracing import Number, Symbol, Tape
from p3dof.tracing.derivatives import tangent
from p3dof.tracing.divisions import in_pairs

SPEEDS = ("speed_a", "speed_b", "speed_c")


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
    tape, rows = trace.tape, trace.rows((*POSE, *VELOCITY, *ACCELERATION, *WRENCH))
    load = rows | (less_friction(tape, trace.model, rows | trace.friction) if friction else {})
    x = reduced.shape(trace.model, rows["y"], rows["theta"], tape)
    state = State(*(rows[name] for name in State._fields))
    wrench = load["w_y"], load["w_z"], load["w_theta"]
    forces = reduced.actuator_forces(trace.model, x, state, tape, wrench)
    name = "forces_tangent" + "_with_friction" * friction + "_symmetric" * symmetric
    return trace.kernel(name, forces, FORCES, x, held=True)


@cache
def sliders_tangent() -> Kernel:
    """Return the kernel of the sliders' positions and speeds and how they change.

    Returns
    -------
    Kernel
        Likewise.
    """
    trace = _Trace(False, False)
    rows = trace.rows((*POSE, *VELOCITY))
    x = reduced.shape(trace.model, rows["y"], rows["theta"], trace.tape)
    velocity = rows["vy"], rows["vz"], rows["vtheta"]
    found = [
        *reduced.sliders(trace.model, x, rows["z"], trace.tape),
        *reduced.slider_rates(x, velocity),
    ]
    return trace.kernel("sliders_tangent", found, (*SLIDERS, *SPEEDS), x, held=False)


class _Trace:
    def __init__(self, friction: bool, symmetric: bool) -> None:
        tape = self.tape = Tape()
        zeros = ("gx", "gy", *SYMMETRIC_ZEROS) if symmetric else ()
        names = (*MODEL, *(FRICTION if friction else ()))
        self.numbers = self._constants("", names, zeros)
        self.rates = self._constants("d_", names, zeros)
        self.model = Model.of_numbers(self.numbers[: len(MODEL)])
        self.friction = dict(zip(FRICTION, self.numbers[len(MODEL) :], strict=False))
        self.pose_rates = tape.symbols((f"d_{name}" for name in POSE), constant=True)

    def _constants(self, prefix: str, names: tuple[str, ...], zeros: tuple[str, ...]) -> tuple[Number, ...]:
        tape = self.tape
        return tuple(0 if name in zeros else tape.symbol(prefix + name, constant=True) for name in names)

    def rows(self, names: tuple[str, ...]) -> dict[str, Symbol]:
        """Return the inputs of a sample."""
        self.inputs = dict(zip(names, self.tape.symbols(names), strict=True))
        return dict(self.inputs)

    def kernel(
        self,
        name: str,
        results: tuple[Number, ...] | list[Number],
        names: tuple[str, ...],
        x: reduced.Shape,
        held: bool,
    ) -> Kernel:
        """Return results and their tangents, and the margin, as a kernel."""
        pairs = [*zip(self.numbers, self.rates, strict=True)]
        pairs += zip((self.inputs[name] for name in POSE), self.pose_rates, strict=True)
        seeds = {value.index: rate for value, rate in pairs if isinstance(value, Symbol)}
        moved = tangent(results, seeds)
        unused = [self.inputs["z"], self.inputs["vz"]] if held else []
        margin = reduced.margin(self.model, x, self.tape, [*results, *moved, *unused], held=held)
        found = in_pairs(self.tape, [*results, *moved, margin])
        outputs = (*names, *(f"d_{name}" for name in names), "margin")
        model = (*self.numbers, *self.rates, *self.pose_rates)
        return Kernel(
            name, self.tape, model, tuple(self.inputs), outputs, tuple(self.inputs.values()), tuple(found)
        )
