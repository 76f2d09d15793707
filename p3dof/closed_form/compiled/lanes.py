"""Formulas for many runs at once: every lane has a machine of its own, one controller's model serves all.

As the kernels of `p3dof.closed_form.compiled.formulas`, without margins, traced for `p3dof.codegen.batch`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from p3dof._base.algebra import Vector
from p3dof._base.checks import FloatArray
from p3dof._base.tracing import Number, Symbol, Tape, derivatives
from p3dof._base.tracing.tape import in_pairs
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
    less_friction,
    state_of,
)
from p3dof.closed_form.compiled.reduced import SMALLER_ZEROS, Model, Shape
from p3dof.closed_form.compiled.reduced.dynamics import FRICTION

SPEEDS = ("speed_a", "speed_b", "speed_c")
COSINES = ("cos_a", "cos_b", "cos_c", "cos_54")

_Rows = dict[str, Symbol]


class LaneKernel(Kernel):
    """A kernel whose constants may be columns, one machine a lane."""

    def columns(self, model: Sequence[FloatArray], count: int) -> FloatArray:
        """Return the constants of many machines, shape (count, C)."""
        with np.errstate(all="ignore"):  # what is no machine is told where the run starts
            return self.of_columns(model, count)


def _place(tape: Tape, model: Model, rows: _Rows) -> list[Number]:
    """Return where sliders and legs are, and how fast the sliders move."""
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    return [*reduced.sliders(model, x, rows["z"], tape), *_speeds(x, rows), *_cosines(tape, model, x)]


def _limits(tape: Tape, model: Model, rows: _Rows) -> list[Number]:
    """Return the same, with the rates of the cosines."""
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    cosines = _cosines(tape, model, x)
    by_pose = derivatives(cosines, [rows["y"], rows["theta"]])
    rates = [by_y * rows["vy"] + by_theta * rows["vtheta"] for by_y, by_theta in by_pose]
    return [*reduced.sliders(model, x, rows["z"], tape), *_speeds(x, rows), *cosines, *rates]


def _motion(tape: Tape, model: Model, rows: _Rows) -> list[Number]:
    """Return accelerations."""
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    forces, wrench = tuple(rows[name] for name in FORCES), tuple(rows[name] for name in WRENCH)
    return list(reduced.forward_dynamics(model, x, state_of(rows), forces, tape, wrench))  # type: ignore[arg-type]


def _motion_with_friction(tape: Tape, model: Model, rows: _Rows) -> list[Number]:
    """Return accelerations where joints have friction."""
    return _motion(tape, model, rows | less_friction(tape, model, rows))


def _assembly(tape: Tape, model: Model, rows: _Rows) -> list[Number]:
    """Return the pose at sliders in the working mode, θ perhaps with a turn too many, and the least drop."""
    a, b, c = (rows[name] for name in SLIDERS)
    r, R, L = model[:3]
    width = R - r
    mean, half = 0.5 * (a + b), 0.5 * (b - a)
    square = width * width + half * half
    share = tape.sqrt((L * L - square) / square)  # reach over half the distance of the circles
    y, p = share * half, mean - share * width
    q = c - p
    u2 = (L - y) * (L + y)
    K = (q * q + r * r + R * R - u2) / (2 * r)
    root = tape.sqrt(R * R + q * q - K * K)
    height = tape.sqrt((L - width) * (L + width))
    rise = q * K - R * root
    least = tape.minimum(tape.minimum(a - p, b - p), q - (r * rise) / (R * R + q * q))
    return [y, p + height, tape.atan2(rise, R * K + q * root), least]


def _torque(tape: Tape, model: Model, rows: _Rows) -> list[Number]:
    """Return how fast the platform moves at a pose, and where it is half a hold later."""
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    a, b, c = (rows[name] for name in SPEEDS)
    vy = (b - a) / (x.ta + x.tb)
    vz = a + x.ta * vy
    vtheta = (c - vz + x.ty * vy) / x.arm
    half = rows["half"]
    ahead = [
        rows[name] + half * (speed + (0.5 * half) * rows[rate])
        for name, speed, rate in zip(POSE, (vy, vz, vtheta), ACCELERATION, strict=True)
    ]
    there = reduced.shape(model, ahead[0], ahead[2], tape)
    least = tape.minimum(tape.minimum(there.squares[0], there.squares[1]), there.squares[2])
    return [vy, vz, vtheta, *ahead, least]


def _inverse(tape: Tape, model: Model, rows: _Rows) -> list[Number]:
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    wrench: Any = tuple(rows.get(name, 0) for name in WRENCH)
    return list(reduced.actuator_forces(model, x, state_of(rows), tape, wrench))


def _inverse_with_friction(tape: Tape, model: Model, rows: _Rows) -> list[Number]:
    """Return forces where joints have friction."""
    unloaded: dict[str, Any] = dict.fromkeys(WRENCH, 0) | rows
    return _inverse(tape, model, rows | less_friction(tape, model, unloaded))


def _speeds(x: Shape, rows: _Rows) -> Vector:
    vy, vz, vtheta = (rows[name] for name in VELOCITY)
    return vz - x.ta * vy, vz + x.tb * vy, vz - x.ty * vy + x.arm * vtheta


def _cosines(tape: Tape, model: Model, x: Shape) -> list[Number]:
    """Shares of the legs' lengths that they hang down, and the platform's cosine to the lower cross-bar."""
    iu = 1 / tape.sqrt(x.u2)
    share = 1 / model.L
    return [x.Sa * share, x.Sb * share, x.Sc * iu, (x.arm * x.Sc) * ((1 / model.r) * iu)]


_STATE = (*POSE, *VELOCITY)
_FORMULAS: dict[str, tuple[Any, tuple[str, ...], tuple[str, ...]]] = {
    "place": (_place, _STATE, (*SLIDERS, *SPEEDS, *COSINES)),
    "limits": (_limits, _STATE, (*SLIDERS, *SPEEDS, *COSINES, *(f"{name}_rate" for name in COSINES))),
    "motion": (_motion, (*_STATE, *FORCES, *WRENCH), ACCELERATION),
    "motion_with_friction": (_motion_with_friction, (*_STATE, *FORCES, *WRENCH), ACCELERATION),
    "assembly": (_assembly, SLIDERS, (*POSE, "drop")),
    "torque": (
        _torque,
        (*POSE, *SPEEDS, *ACCELERATION, "half"),
        (*VELOCITY, "y_ahead", "z_ahead", "theta_ahead", "least"),
    ),
    "inverse": (_inverse, (*_STATE, *ACCELERATION), FORCES),
    "inverse_with_friction": (_inverse_with_friction, (*_STATE, *ACCELERATION), FORCES),
}
NAMES = tuple(_FORMULAS)  # the kernels; those of the machine first
OF_BODIES = ("motion", "motion_with_friction", "inverse", "inverse_with_friction")
"""Those that have a smaller form for symmetric bodies."""
WITH_FRICTION = ("motion_with_friction", "inverse_with_friction")  # with constants of friction too
OF_CONTROLLER = ("assembly", "torque", "inverse", "inverse_with_friction")
"""Those of a controller's model, the same in all lanes."""


@cache
def lane_kernel(name: str, symmetric: bool = False) -> LaneKernel:
    """Return a kernel, traced once."""
    formula, inputs, outputs = _FORMULAS[name]
    symmetric = symmetric and name in OF_BODIES
    zeros: Sequence[str] = SMALLER_ZEROS if symmetric else ()
    tape = Tape()
    model = tuple(0 if number in zeros else tape.symbol(number, constant=True) for number in MODEL)
    friction = tape.symbols(FRICTION, constant=True) if name in WITH_FRICTION else ()
    symbols = tape.symbols(inputs)
    rows = dict(zip((*inputs, *FRICTION), (*symbols, *friction), strict=False))
    results = in_pairs(tape, formula(tape, Model.of_numbers(model), rows))
    full_name = f"lane_{name}" + ("_symmetric" if symmetric else "")
    return LaneKernel(full_name, tape, (*model, *friction), inputs, outputs, symbols, tuple(results))


def all_lane_kernels() -> list[LaneKernel]:
    """Return every kernel in all its forms."""
    return [lane_kernel(name) for name in NAMES] + [lane_kernel(name, symmetric=True) for name in OF_BODIES]
