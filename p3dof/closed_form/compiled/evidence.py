"""Kernels of the evidence of a motion, by the paper's formulas and not by the reduced ones of the forces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

from p3dof._base.algebra import Matrix, components
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof.closed_form.compiled.formulas import ACCELERATION, GRAVITY, POSE, VELOCITY, Kernel
from p3dof.closed_form.compiled.reduced.dynamics import JOINTS as WITH_FRICTION
from p3dof.closed_form.kinematics import JOINTS
from p3dof.closed_form.paper import formulas
from p3dof.closed_form.paper.evidence import evidence, joints
from p3dof.closed_form.paper.friction import Actuation, Losses, actuation_of, lost_power
from p3dof.machine.parameters import SLIDES, Parameters
from p3dof.machine.parameters.body import LINKS, Inertial

BODY = ("mass", "x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz")
_ACTUATION = tuple(f"{what}_{leg}" for what in ("inertia", "balance", "stiffness") for leg in "abc")
_FRICTION = tuple(f"{what}_{joint}" for what in ("viscous", "coulomb") for joint in WITH_FRICTION)
NUMBERS = (
    *formulas.Lengths._fields,
    *GRAVITY,
    *(f"{link}_{number}" for link in LINKS for number in BODY),
    *_ACTUATION,
    *_FRICTION,
    "smoothing",
)
"""The numbers of a machine in a row."""


def numbers_of(parameters: Parameters) -> list[float]:
    """Return the numbers of a machine, by `NUMBERS`."""
    geometry, friction = parameters.geometry, parameters.friction
    found = [*formulas.Lengths.of(geometry), *parameters.gravity]
    for _, body in parameters.bodies.items():  # noqa: PERF102 - no mapping
        second = body.inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
        found += [body.mass, *body.com, *second]
    for row in actuation_of(parameters.actuators, parameters.gravity):
        found += row
    for coefficients in (friction.viscous, friction.coulomb):
        found += [coefficients.get(joint, 0.0) for joint in WITH_FRICTION]
    return [float(number) for number in (*found, friction.smoothing)]


_Rows = Mapping[str, Symbol]


def _lengths(rows: _Rows) -> formulas.Lengths:
    return formulas.Lengths(*(rows[name] for name in formulas.Lengths._fields))


def _three(rows: _Rows, names: Sequence[str]) -> Any:
    return components([rows[name] for name in names])


def _bodies(rows: _Rows) -> dict[str, Inertial]:
    found = {}
    for link in LINKS:
        mass, x, y, z, xx, yy, zz, xy, xz, yz = (rows[f"{link}_{number}"] for number in BODY)
        inertia: Matrix = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
        found[link] = Inertial(mass, (x, y, z), inertia)
    return found


def _moving(
    tape: Tape, rows: _Rows
) -> tuple[formulas.Lengths, formulas.Configuration, formulas.Rates, formulas.Rates]:
    lengths = _lengths(rows)
    pose, velocity, acceleration = (_three(rows, names) for names in (POSE, VELOCITY, ACCELERATION))
    x = formulas.configuration(lengths, pose, tape)
    v = formulas.velocities(lengths, x, velocity)
    return lengths, x, v, formulas.accelerations(lengths, x, v, velocity, acceleration)


def _joints(tape: Tape, rows: _Rows) -> list[Number]:
    found = joints(*_moving(tape, rows), rows["theta"], tape)
    return [value for row in found for value in row]


def _evidence(tape: Tape, rows: _Rows) -> list[Number]:
    lengths, x, v, a = _moving(tape, rows)
    actuation = Actuation(*(_three(rows, _ACTUATION[k : k + 3]) for k in (0, 3, 6)))
    given = _bodies(rows), _three(rows, GRAVITY), actuation
    return [*v.sliders, *evidence(lengths, *given, x, v, a, tape)]


def _dissipation(tape: Tape, rows: _Rows) -> list[Number]:
    lengths, (pose, velocity) = _lengths(rows), (_three(rows, names) for names in (POSE, VELOCITY))
    known = {joint: (rows[f"viscous_{joint}"], rows[f"coulomb_{joint}"]) for joint in WITH_FRICTION}
    x = formulas.configuration(lengths, pose, tape)
    return [lost_power(lengths, x, velocity, Losses(known, rows["smoothing"]), tape)]


def _actuation(tape: Tape, rows: _Rows) -> list[Number]:
    x = formulas.configuration(_lengths(rows), _three(rows, POSE), tape)
    return [tape.atan2(x.cos_54, tape.fabs(x.sin_54))]


_MOTION = (*POSE, *VELOCITY, *ACCELERATION)
_RATES = tuple(f"{order}_{joint}" for order in "qva" for joint in JOINTS)
_KERNELS: dict[str, tuple[Callable[[Tape, _Rows], list[Number]], tuple[str, ...], tuple[str, ...]]] = {
    "joints": (_joints, _MOTION, _RATES),
    "evidence": (_evidence, _MOTION, (*(f"v_{joint}" for joint in SLIDES), "closure_error", "energy_rate")),
    "dissipation": (_dissipation, (*POSE, *VELOCITY), ("dissipation",)),
    "actuation": (_actuation, POSE, ("actuation",)),
}
NAMES = tuple(_KERNELS)
"""All joints; speeds of sliders, gaps, rate of the energy; loss by friction; angle from the singularity."""


@cache
def evidence_kernel(name: str) -> Kernel:
    """Return a kernel of the evidence, traced once; its margin tells whether the last output is finite."""
    formula, inputs, outputs = _KERNELS[name]
    tape = Tape()
    numbers, symbols = tape.symbols(NUMBERS, constant=True), tape.symbols(inputs)
    rows = dict(zip((*NUMBERS, *inputs), (*numbers, *symbols), strict=True))
    results = formula(tape, rows)
    results.append(1 + (results[-1] - results[-1]))
    return Kernel(name, tape, numbers, inputs, (*outputs, "margin"), symbols, tuple(results))
