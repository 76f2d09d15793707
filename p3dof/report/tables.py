"""The numbers of a report, as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from p3dof.checks import FloatArray
from p3dof.energy import Energy
from p3dof.methods import LEGS, InverseDynamics
from p3dof.motion import Motion
from p3dof.parameters import Bodies, Friction, Geometry, Limits, Parameters
from p3dof.reactions import JOINTS, AnyReactions, Joint

_NOTHING = 1e-9
"""Reactions that are rounding, of a joint that bears none [N, N m]."""


@dataclass(frozen=True)
class Table:
    """A table of texts.

    Parameters
    ----------
    title : str
        What it shows.
    header : tuple of str
        Names of the columns.
    rows : tuple of tuple of str
        The first cell of each is its name.
    note : str
        What a reader must know besides.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def number(value: float) -> str:
    """Return a number with six digits; a dash for what does not exist."""
    return "–" if np.isnan(value) else f"{value + 0.0:.6g}"


def _table(
    title: str, header: Sequence[str], rows: Mapping[str, Sequence[float | str]], note: str = ""
) -> Table:
    cells = (
        (name, *(value if isinstance(value, str) else number(value) for value in values))
        for name, values in rows.items()
    )
    return Table(title, tuple(header), tuple(cells), note)


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
        _bodies(parameters.bodies),
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
    return _table("Geometry", ("length", "[m]"), {name: (value,) for name, value in rows.items()})


def _limits(limits: Limits, gravity: FloatArray) -> Table:
    rows = {
        "slider travel [m]": f"{number(limits.travel[0])} to {number(limits.travel[1])}",
        "slider speed [m/s]": number(limits.speed),
        "actuator force [N]": number(limits.force),
        "platform tilt θ [rad]": f"{number(limits.tilt[0])} to {number(limits.tilt[1])}",
        "gravity x₀, y₀, z₀ [m/s²]": ", ".join(number(part) for part in gravity),
    }
    return _table("Limits and gravity", ("quantity", "value"), {name: (text,) for name, text in rows.items()})


def _bodies(bodies: Bodies) -> Table:
    header = ["body", "mass [kg]", "x [m]", "y [m]", "z [m]"]
    header += ["Ixx [kg m²]", "Iyy [kg m²]", "Izz [kg m²]", "Ixy [kg m²]", "Ixz [kg m²]", "Iyz [kg m²]"]
    rows = {}
    for name, body in bodies.items():
        inertia = body.inertia
        products = (inertia[0, 1], inertia[0, 2], inertia[1, 2])
        rows[name] = (body.mass, *body.com, *np.diag(inertia), *products)
    note = (
        f"{number(bodies.mass)} kg move. Mass centres (x, y, z) and inertias about them, in the bodies' own "
        "frames: leg or rod from its upper joint, x down the rod; platform from P; all others from the pivot."
    )
    return _table("Bodies", header, rows, note)


def _friction(friction: Friction) -> Table:
    rows = {
        name: (friction.viscous.get(name, 0.0), friction.coulomb.get(name, 0.0)) for name in friction.joints
    }
    note = f"Coulomb friction turns around over {number(friction.smoothing)} m/s or rad/s."
    header = ("joint", "viscous [N s/m, N m s/rad]", "Coulomb [N, N m]")
    return _table("Friction", header, rows, note if rows else "None.")


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
    return _table("Motion", header, rows, note)


def agreement_table(first: InverseDynamics, second: InverseDynamics) -> Table:
    """Return how well the forces of two methods agree.

    Parameters
    ----------
    first, second : InverseDynamics
        Of the same motion.

    Returns
    -------
    Table
    """
    worst = np.abs(first.forces - second.forces)[first.valid & second.valid].max(axis=0, initial=0.0)
    peak, rms = second.peak_forces, second.rms_forces
    rows = {
        f"actuator {leg}": (
            number(peak[k]),
            number(rms[k]),
            f"{worst[k]:.1e}",
            f"{worst[k] / peak[k] if peak[k] else 0.0:.1e}",
        )
        for k, leg in enumerate(LEGS)
    }
    header = ("", "largest force [N]", "RMS force [N]", "largest difference [N]", "of its largest force")
    return _table(f"Forces by {first.method} and by {second.method}", header, rows)


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
            number(np.abs(result.power[result.valid]).max()),
        )
        for result in results
    }
    header = ("method", "largest gap of the loops [m]", "power residual [W]", "largest power [W]")
    return _table("Evidence", header, rows)


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
    return _table("What the drives must do", ("", *(f"actuator {leg}" for leg in LEGS)), values)


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
    most = int(np.nanargmax(energy.kinetic_total))
    total = energy.kinetic_total[most]
    rows = {
        name: (
            number(energy.kinetic[energy.valid, k].max()),
            f"{energy.kinetic[most, k] / total if total else 0.0:.1%}",
        )
        for k, name in enumerate(energy.bodies)
    }
    header = ("body", "peak kinetic energy [J]", f"share at t = {number(energy.time[most])} s")
    done, missed = energy.work_done[energy.valid][-1], np.abs(energy.balance[energy.valid]).max()
    note = (
        f"All bodies at most {number(total)} J. Work done on the mechanism: {number(done)} J; "
        f"it misses the change of the energy by {missed:.1e} J."
    )
    return _table("Kinetic energy", header, rows, note)


def names_table() -> Table:
    """Return the key that ties the names in the drawing to those in tables, files and the parameter file.

    Returns
    -------
    Table
    """
    rows = tuple((joint.label, joint.name, joint.meaning) for joint in sorted(JOINTS, key=_by_label))
    note = "The labels are the paper's, but for C7, which the paper does not name."
    return Table("Names of the joints", ("in the drawing", "in tables and files", "what it is"), rows, note)


def _by_label(joint: Joint) -> str:
    return joint.label


_LOADS = {
    "force": "force [N]",
    "axial": "axial [N]",
    "radial": "radial [N]",
    "rms_force": "RMS force [N]",
    "moment": "moment [N m]",
    "across": "across [N m]",
    "rms_moment": "RMS moment [N m]",
}
_NAMES = {joint.name: f"{joint.name} ({joint.label})" for joint in JOINTS}


def reactions_table(result: AnyReactions) -> Table:
    """Return the largest loads of every joint that rigid bodies determine.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        Over a motion.

    Returns
    -------
    Table
    """
    rows = {
        _NAMES[peak.joint]: tuple(
            "open" if name in peak.undetermined else _load(getattr(peak, name)) for name in _LOADS
        )
        for peak in result.peaks()
    }
    residual = result.residual[result.valid].max()
    note = (
        "Axial and radial: along and across the joint's axis; moment and across: all, and across the axis; "
        "open: rigid bodies do not determine it, see below. "
        f"Largest error of Newton's and Euler's equations: {residual:.1e} N or N m."
    )
    title = "Largest reactions that rigid bodies determine: to size joints for"
    return _table(title, ("joint", *_LOADS.values()), rows, note)


def open_tables(result: AnyReactions) -> list[Table]:
    """Return the loads that rigid bodies leave open, by idealisations: of forces and of moments.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        Over a motion.

    Returns
    -------
    list of Table
    """
    values = {(peak.joint, peak.load): peak.values for peak in result.open_peaks()}
    tables = []
    for what, unit in (("forces", "[N]"), ("moments", "[N m]")):
        loads = [name for name, title in _LOADS.items() if title.endswith(unit)]
        columns = [(name, kind) for name in loads for kind in result.idealisations]
        rows = {
            _NAMES[joint]: tuple(
                _load(values[joint, name][kind]) if (joint, name) in values else "" for name, kind in columns
            )
            for joint in result.joints
            if any((joint, name) in values for name in loads)
        }
        header = ("joint", *(f"{_LOADS[name]} {kind}" for name, kind in columns))
        tables.append(_table(f"Open {what}: not to size joints for", header, rows))
    return tables


def _load(value: float) -> str:
    return "0" if abs(value) < _NOTHING else number(value)
