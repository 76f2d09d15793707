"""Tables of a machine: lengths, bodies, limits, friction, actuators, and what it carries."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.tables import Table, html_of, notebook_html, number, table_of
from p3dof.machine.parameters.actuators import Actuators, Friction, Geometry, Limits
from p3dof.machine.parameters.body import Body
from p3dof.machine.parameters.machine import Parameters


def parameter_tables(parameters: Parameters) -> list[Table]:
    """Return the tables of lengths, bodies, limits, gravity, friction and actuators."""
    return [
        _geometry(parameters.geometry),
        _limits(parameters.limits, parameters.gravity),
        _bodies(parameters),
        _friction(parameters.friction),
        _actuators(parameters.actuators),
    ]


def _geometry(geometry: Geometry) -> Table:
    rows = {
        "r, from P to A₃, B₃ and C₅": geometry.r,
        "R, from O to each guide": geometry.R,
        "L, of legs and rods": geometry.L,
        "b, half the width of the parallelogram": geometry.b,
        "h, from the sliders down to the platform at home": geometry.h,
    }
    return table_of("Geometry", ("length", "[m]"), {name: (value,) for name, value in rows.items()})


def _limits(limits: Limits, gravity: FloatArray) -> Table:
    rows = {
        "slider travel [m]": f"{number(limits.travel[0])} to {number(limits.travel[1])}",
        "slider speed [m/s]": number(limits.speed),
        "actuator force [N]": number(limits.force),
        "platform tilt θ [rad]": f"{number(limits.tilt[0])} to {number(limits.tilt[1])}",
        "gravity x₀, y₀, z₀ [m/s²]": ", ".join(number(part) for part in gravity),
    }
    return table_of(
        "Limits and gravity", ("quantity", "value"), {name: (text,) for name, text in rows.items()}
    )


_DUST = 1e-14
"""Share of the largest of some numbers below which one of them is rounding."""
_BODY = (
    *("mass [kg]", "x [m]", "y [m]", "z [m]"),
    *("Ixx [kg m²]", "Iyy [kg m²]", "Izz [kg m²]", "Ixy [kg m²]", "Ixz [kg m²]", "Iyz [kg m²]"),
)


def _numbers(body: Body) -> tuple[float, ...]:
    """Return mass, mass centre and inertia of a body in the order of the columns."""
    inertia = body.inertia
    moments = np.array([*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]])
    return (body.mass, *_without_dust(body.com), *_without_dust(moments))


def _without_dust(values: FloatArray) -> FloatArray:
    """Return numbers with those that are rounding beside the largest one as zero."""
    return np.where(np.abs(values) < _DUST * np.abs(values).max(), 0.0, values)


def _bodies(parameters: Parameters) -> Table:
    bodies = parameters.bodies
    laden = {"platform": "platform + payload"} if parameters.payloads else {}
    rows = {laden.get(name, name): _numbers(body) for name, body in bodies.items()}
    note = (
        f"{number(bodies.mass)} kg move. Mass centres (x, y, z) and inertias about them, in the bodies' own "
        "frames: leg or rod from its upper joint, x down the rod; platform from P; all others from the pivot."
    )
    return table_of("Bodies", ("body", *_BODY), rows, note, "wide")


def payload_table(parameters: Parameters) -> Table | None:
    """Return what the platform carries: the platform alone, each payload, and all together.

    None if it carries nothing.
    """
    payloads = parameters.payloads
    if not payloads:
        return None
    rows = {"platform": _numbers(parameters.unladen.bodies.platform)}
    for i, body in enumerate(payloads, 1):
        rows["payload" if len(payloads) == 1 else f"payload {i}"] = _numbers(body)
    rows["together"] = _numbers(parameters.bodies.platform)
    note = (
        f"The platform carries {number(sum(body.mass for body in payloads))} kg. Mass centres from P, in the "
        "platform's axes; inertias about each one's own mass centre."
    )
    return table_of("Platform and payload", ("body", *_BODY), rows, note, "wide")


def _friction(friction: Friction) -> Table:
    rows = {
        name: (friction.viscous.get(name, 0.0), friction.coulomb.get(name, 0.0)) for name in friction.joints
    }
    note = f"Coulomb friction turns around over {number(friction.smoothing)} m/s or rad/s."
    header = ("joint", "viscous [N s/m, N m s/rad]", "Coulomb [N, N m]")
    return table_of("Friction", header, rows, note if rows else "None.")


def _actuators(actuators: Actuators) -> Table:
    columns = (actuators.armature, actuators.counterbalance, actuators.spring, actuators.counterweight)
    rows = {name: tuple(column.get(name, 0.0) for column in columns) for name in actuators.slides}
    header = ("slide", "armature [kg]", "counterbalance [N]", "spring [N/m]", "counterweight [kg]")
    note = "Reflected inertia, which gravity does not act on; force along z0 at home and how fast it falls."
    return table_of("Actuators", header, rows, note if rows else "None.")


@html_of.register(Parameters)
def machine_html(parameters: Parameters, name: str = "Parameters") -> str:
    """Return how a notebook shows a machine; HTML."""
    geometry, limits, bodies, *others = parameter_tables(parameters)
    payload = payload_table(parameters)
    tables = [geometry, limits, bodies]
    tables += [] if payload is None else [payload]
    tables += [table for table in others if table.rows]
    return notebook_html(name, f"{number(parameters.bodies.mass)} kg move", tables)
