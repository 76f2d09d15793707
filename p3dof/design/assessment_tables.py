"""Tables and sentences about an `Assessment`: loads, ratings, needs of motors, what all of it rests on."""

from __future__ import annotations

import math

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.tables import NONE, Cell, Table, html_of, notebook_html, number, percent, table_of
from p3dof.design.assessment import Assessment, RatingUse
from p3dof.design.drives.sizing import BUCKLING, WHIRL
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.design.tasks import FastestPlan
from p3dof.machine.parameters import LEGS

_LEADS = (5.0, 10.0, 16.0, 20.0, 32.0)  # of screws for which torques of motors are told [mm a turn]
_RPM = 30 / math.pi


def uses_table(found: Assessment, most: int | None = None) -> Table:
    """Return all ratings that are known, those used most first, with times and places."""
    rows = tuple(_use(one) for one in found.ratings[:most])
    header = ("rating", "of", "required", "permissible", "utilisation", "at t [s]", "segment")
    left = 0 if most is None else len(found.ratings) - most
    note = f"{left} more have a lower utilisation." if left > 0 else ""
    return Table("Utilisation of ratings", header, rows, note)


def _use(one: RatingUse) -> tuple[str, ...]:
    values = (f"{figure} {one.unit}".strip() for figure in one.figures)
    return (f"{one.name} of {one.part}", one.kind, *values, percent(one.share), *_when(one.time, one.place))


def _when(time: float, place: str) -> tuple[str, str]:
    return (NONE, "over the cycle") if math.isnan(time) else (number(time), place or NONE)


def loads_table(found: Assessment) -> Table:
    """Return what each slider bears and does over the cycle, with the instant of the largest.

    The force at the nut, which guide and mechanism feel, and that of the motor, which moves its own inertia
    too, are two rows.
    """
    forces, speed = found.cycle.force, found.found.slider_velocities
    power, motor = forces * speed, found.motor_forces
    own = bool(found.robot.parameters.actuators.armature)
    rows: dict[str, list[Cell]] = {"force at the nut, peak [N]": _peak(found, forces)}
    rows["force at the nut, rms [N]"] = [*_rms(found, forces), NONE, NONE]
    if found.drives is not None:
        rows["force of the motor at the slider, peak [N]"] = _peak(found, motor)
        axes = zip(found.drives.axes, found.drives.drives, strict=True)
        rms = [axis.rms_torque * drive.ratio for axis, drive in axes]
        rows["force of the motor at the slider, rms [N]"] = [*rms, NONE, NONE]
    elif own:
        rows["force of the actuator, with armature, peak [N]"] = _peak(found, motor)
        rows["force of the actuator, with armature, rms [N]"] = [*_rms(found, motor), NONE, NONE]
    rows["speed, peak [m/s]"] = _peak(found, speed)
    rows["acceleration, peak [m/s²]"] = _peak(found, found.found.slider_accelerations)
    rows["power at the nut, peak [W]"] = _peak(found, power, np.maximum)
    rows["regenerative power at the nut, peak [W]"] = _peak(found, power, np.minimum)
    if found.drives is not None:
        turning = motor * speed
        rows["power of the motor, peak [W]"] = _peak(found, turning, np.maximum)
        rows["regenerative power of the motor, peak [W]"] = _peak(found, turning, np.minimum)
    header = ("load", *LEGS, "peak at t [s]", "segment")
    note = (
        "The nut's force is what mechanism and guides feel; that of the motor holds the inertia and the "
        "losses of its drive too."
        if found.drives is not None
        else "Without inertia and losses of drives."
    )
    return table_of("Loads of the sliders", header, rows, note)


def _peak(found: Assessment, values: FloatArray, side: np.ufunc = np.abs) -> list[Cell]:
    """Return the largest values of the axes, and when and where the largest of all is."""
    sizes = np.abs(values) if side is np.abs else np.abs(side(values, 0.0))
    row, _ = np.unravel_index(int(sizes.argmax()), sizes.shape)
    time = float(found.found.time[row])
    place = _when(time, found.place(time))
    return [*(number(float(size)) for size in sizes.max(axis=0)), *place]


def _rms(found: Assessment, forces: FloatArray) -> list[float]:
    cycle = found.cycle
    squares = np.trapezoid(forces**2, cycle.time, axis=0) + cycle.rest * np.asarray(cycle.holding) ** 2
    return [float(value) for value in np.sqrt(squares / cycle.duration)]


def needs_table(found: Assessment) -> Table:
    """Return what motors must give behind screws of some leads, without inertia and losses of drives."""
    forces, speed = found.cycle.force, np.abs(found.found.slider_velocities).max(axis=0)
    peak, rms = np.abs(forces).max(axis=0), np.array(_rms(found, forces))
    rows = {}
    for lead in _LEADS:
        turn = lead / 1e3 / (2 * math.pi)
        torques = [
            number(float(f"{value:.4g}"))
            for pair in zip(peak, rms, strict=True)
            for value in pair * np.array(turn)
        ]
        rows[f"{lead:g} mm"] = [*torques, *(f"{_RPM * value / turn:.0f}" for value in speed)]
    header = (
        "lead of the screw",
        *(f"{leg} {what} [N m]" for leg in LEGS for what in ("peak", "rms")),
        *(f"{leg} top [rpm]" for leg in LEGS),
    )
    note = (
        "Without efficiency, and without the inertia of motor and screw, which may take most of the torque: "
        "give a catalogue of drives (--drives) for these."
    )
    return table_of("Required torque and speed of the motors", header, rows, note, "wide")


def assumptions(found: Assessment) -> dict[str, str]:
    """Return what the numbers rest on, by topic; the most important first."""
    parameters = found.robot.parameters
    limits = parameters.limits
    told = {
        "limits": f"force ({limits.force:g} N) holds at the actuator, which is the nut without armature; "
        f"speed ({limits.speed:g} m/s) and travel at the slider; torque, speed and heat of motors at their "
        "shafts, buckling at the nut" + _of_the_task(found),
        "parallelogram": f"half width b = {1e3 * parameters.geometry.b:g} mm: the paper does not give it; it "
        "affects no actuator force, but the loads of rods and bearings",
        "friction": _friction(found),
        "armature and counterbalance": _actuators(found),
    }
    if found.drives is not None:
        told["drives"] = (
            "efficiency acts on the force at the nut only, in the direction of its power, not on the inertia "
            "of motor and screw; rms torque is compared with the continuous torque at the rms speed, at rest "
            f"the motor holds; screws run to {WHIRL:.0%} of their critical speed and {BUCKLING:.0%} of "
            "Euler's load; the same drive on all axes"
        )
        told["ambient"] = "ratings as the catalogue gives them, no derating for temperature, altitude or duty"
    if found.reactions is not None:
        guess = "estimates" if found.stiffness is None else "as given"
        told["stiffness and assembly errors"] = (
            f"stiffnesses of joints and rods are {guess}; "
            f"bodies are rigid, joints have no backlash; {_fit(found)}"
        )
    if isinstance(found.found, TaskForces):
        told["payloads"] = "picked up when a dwell begins, put down when it ends, rigidly held"
    told["cycle"] = f"{number(found.cycle_time)} s" + (
        f", of which {number(found.rest)} s at rest after the motion" if found.rest else ""
    )
    gravity = ", ".join(f"{value:g}" for value in parameters.gravity)
    told["gravity"] = f"({gravity}) m/s²"
    return told


def _of_the_task(found: Assessment) -> str:
    """Return what the task allows besides the machine, in words."""
    plan = found.found.plan if isinstance(found.found, TaskForces) else None
    fastest = isinstance(plan, FastestPlan)
    limits = plan.limits if isinstance(plan, FastestPlan) else found.limits
    if limits is None:
        return ""
    units = {"force": "N", "speed": "m/s", "power": "W", "jerk": "m/s³", "nut_force": "N"}
    words = []
    for name, unit in units.items():
        values, own = getattr(limits, name), getattr(found.robot.parameters.limits, name, math.inf)
        if (values != own).any():
            each = values[:1] if (values == values[0]).all() else values
            text = ", ".join(f"{value:.6g}" if math.isfinite(value) else "any" for value in each)
            words.append(f"{name.replace('_', ' ')} {text} {unit}")
    if not words:
        return ""
    own = f"; the {'time-optimal motion' if fastest else 'task'} has limits of its own: {', '.join(words)}"
    masses = ", ".join(f"{mass:g}" for mass in limits.reflected_mass)
    return own + (f", with {masses} kg of drives in its force" if limits.reflected_mass.any() else "")


def _friction(found: Assessment) -> str:
    friction = found.robot.parameters.friction
    results = found.found.results if isinstance(found.found, TaskForces) else (found.found,)
    loads = any(result.coulomb is not None for result in results)
    grows = "load-dependent friction of the joints is in forces and reactions"
    if not friction:
        return grows if loads else "none in guides and joints: that of screws is in their efficiency"
    words = {
        "viscous": ", ".join(f"{name} {value:g}" for name, value in friction.viscous.items()),
        "Coulomb": ", ".join(f"{name} {value:g}" for name, value in friction.coulomb.items()),
    }
    told = "; ".join(f"{kind}: {text}" for kind, text in words.items() if text) + " (SI units)"
    return f"{told}; {grows}" if loads else told


def _actuators(found: Assessment) -> str:
    given = found.robot.parameters.actuators
    if not given:
        return "the machine has no counterbalance" + (
            "" if found.drives else ", and its actuators no inertia"
        )
    kinds = {"armature": "kg", "counterbalance": "N", "spring": "N/m", "counterweight": "kg"}
    words = []
    for kind, unit in kinds.items():
        numbers = getattr(given, kind)
        if numbers:
            words.append(
                f"{kind} " + ", ".join(f"{name} {value:g} {unit}" for name, value in numbers.items())
            )
    if found.drives is not None and given.armature:
        words.append("the drives' own inertia replaces the armature")
    return "; ".join(words)


def _fit(found: Assessment) -> str:
    loads = found.reactions
    if loads is None or not loads.fit.any():
        return "no assembly error was given"
    worst = np.nanmax(loads.fit[:, 0, :, 0])
    most = number(round(float(worst), 3))
    return f"assembly errors add up to {most} N to a component, which is not in the lives"


@html_of.register(Assessment)
def assessment_html(found: Assessment) -> str:
    """Return how a notebook shows an assessment, as HTML."""
    tables = [loads_table(found), uses_table(found, 12)]
    facts = f"{found.verdict}. Not checked: {'; '.join(found.unchecked)}."
    return notebook_html(found.name, facts, tables, found.warnings)
