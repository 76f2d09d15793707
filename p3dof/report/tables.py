"""The numbers of a report, as tables."""

from __future__ import annotations

import numpy as np

from p3dof.checks import FloatArray
from p3dof.energy import Energy
from p3dof.manipulator import Comparison
from p3dof.methods import InverseDynamics
from p3dof.motion import Motion
from p3dof.parameters import LEGS, Body, Friction, Geometry, Limits, Parameters
from p3dof.report.table import Table, number, table_of


def parameter_tables(parameters: Parameters) -> list[Table]:
    """Return the tables of lengths, bodies, limits, gravity and friction.

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    list of Table
    """
    return [
        _geometry(parameters.geometry),
        _limits(parameters.limits, parameters.gravity),
        _bodies(parameters),
        _friction(parameters.friction),
    ]


def _geometry(geometry: Geometry) -> Table:
    rows = {
        "r, from P to A₃, B₃ and C₅": geometry.r,
        "R, from O to each guide-way": geometry.R,
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
    return table_of("Bodies", ("body", *_BODY), rows, note)


def payload_table(parameters: Parameters) -> Table | None:
    """Return what the platform carries: the platform alone, each payload, and all together.

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    Table or None
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
    return table_of("Platform and payload", ("body", *_BODY), rows, note)


def _friction(friction: Friction) -> Table:
    rows = {
        name: (friction.viscous.get(name, 0.0), friction.coulomb.get(name, 0.0)) for name in friction.joints
    }
    note = f"Coulomb friction turns around over {number(friction.smoothing)} m/s or rad/s."
    header = ("joint", "viscous [N s/m, N m s/rad]", "Coulomb [N, N m]")
    return table_of("Friction", header, rows, note if rows else "None.")


def motion_table(motion: Motion, wrench: FloatArray) -> Table:
    """Return how far, how fast and how hard the platform moves, and what loads it.

    Parameters
    ----------
    motion : Motion
        The motion.
    wrench : ndarray, shape (N, 6)
        The external load [N, N m].

    Returns
    -------
    Table
    """
    names = (("y [m], per s, per s²", 0), ("z [m], per s, per s²", 1), ("θ [rad], per s, per s²", 2))
    rows = {
        name: (
            motion.pose[:, k].min(),
            motion.pose[:, k].max(),
            np.abs(motion.velocity[:, k]).max(),
            np.abs(motion.acceleration[:, k]).max(),
        )
        for name, k in names
    }
    largest = np.abs(wrench).max(axis=0)
    loads = (
        "No external load."
        if not largest.any()
        else "Largest external force and moment at P, by components: "
        f"{', '.join(number(value) for value in largest[:3])} N; "
        f"{', '.join(number(value) for value in largest[3:])} N m."
    )
    note = f"{len(motion)} samples over {number(motion.duration)} s. {loads}"
    header = ("platform", "lowest", "highest", "largest speed", "largest acceleration")
    return table_of("Motion", header, rows, note)


def agreement_table(found: Comparison) -> Table:
    """Return how well the forces of the two methods agree.

    Parameters
    ----------
    found : Comparison
        Both methods over a motion.

    Returns
    -------
    Table
    """
    worst, second = found.difference[found.both_valid].max(axis=0, initial=0.0), found.second
    peak, rms, scale = second.peak_forces, second.rms_forces, second.force_scale
    rows = {
        f"actuator {leg}": (
            number(peak[k]),
            number(rms[k]),
            f"{worst[k]:.1e}",
            f"{worst[k] / scale[k] if scale[k] else 0.0:.1e}",
        )
        for k, leg in enumerate(LEGS)
    }
    header = ("", "largest force [N]", "RMS force [N]", "largest difference [N]", "of its largest force")
    return table_of(f"Forces by {found.first.method} and by {second.method}", header, rows)


def evidence_table(*results: InverseDynamics) -> Table:
    """Return closure errors and power residuals.

    Parameters
    ----------
    *results : InverseDynamics
        By different methods; some sample of each is valid.

    Returns
    -------
    Table
    """
    rows = {
        result.method: (
            f"{result.closure_error[result.valid].max():.1e}",
            f"{np.abs(result.power_residual[result.valid]).max():.1e}",
            number(np.abs(result.power).max()),  # NaN in one sample: there is no largest one
        )
        for result in results
    }
    header = ("method", "largest gap of the loops [m]", "power residual [W]", "largest power [W]")
    return table_of("Evidence", header, rows)


def drives_table(energy: Energy) -> Table:
    """Return what each drive must do.

    Parameters
    ----------
    energy : Energy
        Over a motion.

    Returns
    -------
    Table
    """
    drives = energy.drives
    rows = {
        "peak force [N]": drives.peak_force,
        "RMS force [N]": drives.rms_force,
        "peak speed [m/s]": drives.peak_speed,
        "peak power [W]": drives.peak_power,
        "peak braking power [W]": drives.peak_braking,
        "mean power [W]": drives.mean_power,
        "work given [J]": drives.positive_work,
        "work taken back [J]": drives.negative_work,
    }
    values = {name: tuple(float(value) for value in each) for name, each in rows.items()}
    return table_of("What the drives must do", ("", *(f"actuator {leg}" for leg in LEGS)), values)


def limits_table(result: InverseDynamics, limits: Limits) -> Table:
    """Return how much of each limit the motion uses, and when.

    Parameters
    ----------
    result : InverseDynamics
        The forces.
    limits : Limits
        What the actuators can do.

    Returns
    -------
    Table
    """
    rows = {
        f"{one.quantity} {one.leg} [{one.unit}]": (
            one.value,
            one.time,
            one.limit,
            "–" if np.isnan(one.share) else f"{one.share:.1%}",
        )
        for one in result.utilisations(limits)
    }
    return table_of("How much of the limits is used", ("", "peak", "at t [s]", "limit", "used"), rows)


def bodies_table(energy: Energy) -> Table:
    """Return the largest kinetic energy of each body.

    Parameters
    ----------
    energy : Energy
        Over a motion; some sample is valid.

    Returns
    -------
    Table
    """
    header = ["body", "peak kinetic energy [J]"]
    if not energy.valid.all():
        unknown = dict.fromkeys(energy.bodies, (np.nan,))
        return table_of("Kinetic energy", header, unknown, "Not known in all samples.")
    most = int(np.argmax(energy.kinetic_total))
    total = energy.kinetic_total[most]
    rows = {
        name: (
            number(energy.kinetic[:, k].max()),
            f"{energy.kinetic[most, k] / total if total else 0.0:.1%}",
        )
        for k, name in enumerate(energy.bodies)
    }
    header.append(f"share at t = {number(energy.time[most])} s")
    done, missed = energy.work_done[-1], np.abs(energy.balance).max()
    note = (
        f"All bodies at most {number(total)} J. Work done on the mechanism: {number(done)} J; "
        f"it misses the change of the energy by {missed:.1e} J."
    )
    return table_of("Kinetic energy", header, rows, note)
