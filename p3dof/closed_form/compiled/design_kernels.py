"""Kernels for many designs over one motion: forces, and what goes with them, from constants of each design.

Less than the kernels of one machine do: sine and cosine of the motion are the same for all designs and come
with the samples; whether a state is good follows from the least of a few values over the motion; and roots
come from `rsqrt`, which with wide vectors is made of products: they overlap, while processors divide and take
roots one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from p3dof._base.algebra import Vector, subtract
from p3dof._base.tracing import Number, Tape
from p3dof._base.tracing.divisions import in_pairs
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import ACCELERATION, FORCES, MODEL, SLIDERS, VELOCITY, WRENCH, Kernel
from p3dof.closed_form.compiled.reduced import SMALLER_ZEROS, Model, Shape, State
from p3dof.closed_form.compiled.reduced.friction import FRICTION, generalized_friction
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
    """A sample on a tape, with sine and cosine known; takes the place of the tape as a namespace.

    Parameters
    ----------
    tape : Tape
        The operations.
    """

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
    """Return the numbers of a machine on a tape, and of its friction.

    Parameters
    ----------
    tape : Tape
        Where they go.
    symmetric : bool
        Its bodies are symmetric and gravity acts along z0: some are zero.
    friction : bool
        There is friction.
    prefix : str
        What their names begin with.

    Returns
    -------
    tuple of Symbol or 0
    """
    zeros = SMALLER_ZEROS if symmetric else ()
    names = (*MODEL, *(FRICTION if friction else ()))
    return tuple(0 if name in zeros else tape.symbol(prefix + name, constant=True) for name in names)


@cache
def design_kernel(name: str) -> Kernel:
    """Return a kernel, traced once.

    Parameters
    ----------
    name : str
        One of `NAMES`.

    Returns
    -------
    Kernel
        The fourth output, ``sine``, is r² s |s| for the sine s of the angle from the actuation singularity;
        with the sliders, their positions and speeds follow.
    """
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
    """Return the kernel that takes the place of another where it serves.

    Parameters
    ----------
    name : str
        One of `NAMES`.

    Returns
    -------
    str
        For symmetric bodies; with friction, where none is Coulomb's.
    """
    return f"{name}_viscous" if name.endswith("_with_friction") else f"{name}_symmetric"
