"""Tables of any robot with loops: its joints, its closures, an assembly, forces over a motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.tables import NONE, Cell, Table, formatted, number
from p3dof.loops.assembly import Assembly
from p3dof.loops.linear import UNIQUE, actuation_of, determined
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.sidecar import motor_side


@dataclass(frozen=True, eq=False)
class Overview:
    """What a robot can do at a configuration."""

    rank: int  # rank of the closures' Jacobian, and nv - rank
    mobility: int
    held: int  # how many of the free motions the actuators see, at most `mobility`
    idle: tuple[str, ...]  # joints that can move while all actuated joints stand still
    undetermined: np.ndarray
    """(rows,): which multipliers of closures and couplings no force determines: the closures are
    redundant."""


def overview(loop: LoopModel, q: FloatArray) -> Overview:
    """Return what a robot can do at a configuration."""
    svd = loop._scaled.core.at(loop._scaled.q(q)).svd
    actuation = actuation_of(svd, loop.actuated_v)
    unseen = actuation.U[:, actuation.rank :]
    still = np.abs(svd.null_space @ unseen).max(axis=1, initial=0.0) > UNIQUE
    model = loop.model
    idle = [i for i in range(1, model.njoints) if still[_freedoms(model, i)].any()]
    return Overview(
        svd.rank,
        model.nv - svd.rank,
        actuation.rank,
        tuple(str(model.names[i]) for i in idle),
        ~determined(svd, None, loop.actuated_v),
    )


def closure_conditioning(loop: LoopModel, q: FloatArray, rank: int) -> float:
    """Return how far the closures' Jacobian is from losing rank.

    The singular value of this number, the largest being 1; infinite if the rank is zero. Of a robot that is
    computed in a unit of length of its own, the Jacobian is in that unit.
    """
    if not rank:
        return np.inf
    s = np.linalg.svd(loop._scaled.core.at(loop._scaled.q(q)).J, compute_uv=False)
    return float(s[rank - 1] / s[0])


def _freedoms(model: pin.Model, joint: int) -> slice:
    return slice(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])


_KINDS = {"R": "revolute", "P": "prismatic", "H": "helical"}
_ENDLESS = 1e10  # limits from here on are none [m or rad]
_NAMED = {
    "JointModelFreeFlyer": "free",
    "JointModelSpherical": "ball",
    "JointModelSphericalZYX": "ball",
    "JointModelPlanar": "planar",
    "JointModelTranslation": "translation",
    "JointModelUniversal": "universal",
}


def kind_of(loop: LoopModel, joint: int) -> str:
    """Return what kind a joint is, in a word."""
    name = str(loop.model.joints[joint].shortname())
    if name in _NAMED:
        return _NAMED[name]
    if loop.model.nqs[joint] == 2 and loop.model.nvs[joint] == 1:
        return "continuous"
    short = name.removeprefix("JointModel")
    return _KINDS.get(short[:1], short.lower())


def is_slide(loop: LoopModel, joint: int) -> bool:
    """Whether a joint with one degree of freedom moves along its axis, so that its value is a length."""
    return kind_of(loop, joint) == "prismatic"


def units_of_actuated(loop: LoopModel) -> tuple[tuple[str, str], ...]:
    """Return, for each actuated joint, the units of its value and of its force."""
    joints = (loop.model.getJointId(name) for name in loop.actuated)
    return tuple(("m", "N") if is_slide(loop, joint) else ("rad", "N m") for joint in joints)


def joints_table(loop: LoopModel, seen: Overview | None = None) -> Table:
    """Return all joints: what they are, what they carry, where they may go, who moves them."""
    model, rows = loop.model, []
    idle = () if seen is None else seen.idle
    follow = {coupling.joint: coupling.on or "locked" for coupling in loop.sidecar.couplings}
    for i in range(1, model.njoints):
        name = str(model.names[i])
        role = "actuated" if name in loop.actuated else follow.get(name, "")
        if role not in ("", "actuated", "locked"):
            role = f"follows {role}"
        role = role or ("passive" if name in idle else "")
        rows.append((name, kind_of(loop, i), role, formatted(model.inertias[i].mass, ".4g"), _range(loop, i)))
    header = ("Joint", "kind", "role", "mass [kg]", "range [m or rad]")
    note = "Mass: that of the body behind the joint. Passive: can move while all actuated joints are locked."
    return Table("Joints", header, tuple(rows), note, layout="list")


def _range(loop: LoopModel, joint: int) -> str:
    """Return between which values a joint may move."""
    model, at = loop.model, loop.model.idx_qs[joint]
    if model.nqs[joint] != 1:
        return NONE
    low, high = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
    ends = [f"{limit:.4g}" if abs(limit) < _ENDLESS else NONE for limit in (low, high)]
    return NONE if ends == [NONE, NONE] else " to ".join(ends)


def closures_table(loop: LoopModel, seen: Overview | None = None) -> Table:
    """Return all closures and couplings, and which of their forces are determined."""
    entries = [(f"{c.frame1}/{c.frame2}", c.kind) for c in loop.sidecar.closures]
    entries += [(c.title, "coupling") for c in loop.sidecar.couplings]
    rows = []
    for (title, kind), span in zip(entries, loop.constraint_rows, strict=True):
        size = span.stop - span.start
        free = NONE if seen is None else f"{size - int(seen.undetermined[span].sum())} of {size}"
        rows.append((title, kind, number(size), free))
    header = ("Closure", "kind", "rows", "determined forces")
    return Table("Closures and couplings", header, tuple(rows), layout="words")


def bushings_table(loop: LoopModel) -> Table:
    """Return all bushings: between which frames they are, and their numbers."""
    rows = [
        (each.title, "/".join(each.frames), *(" ".join(f"{x:g}" for x in part) for part in parts))
        for each in loop.sidecar.bushings
        for parts in [(each.stiffness, each.damping)]
    ]
    header = ("Bushing", "frames", "stiffness", "damping")
    note = "Along x, y, z [N/m, N s/m], then in roll, pitch, yaw [N m/rad, N m s/rad]."
    return Table("Bushings", header, tuple(rows), note, layout="words")


def facts_table(loop: LoopModel, seen: Overview | None = None, gap: float = math.nan) -> Table:
    """Return what matters of a robot in numbers."""
    model = loop.model
    mass = sum(inertia.mass for inertia in list(model.inertias)[1:])  # the first stands still
    rows: list[tuple[str, str]] = [
        ("joints", number(model.njoints - 1)),
        ("degrees of freedom of the tree", number(model.nv)),
        ("rows of closures and couplings", number(sum(s.stop - s.start for s in loop.constraint_rows))),
        ("largest gap", formatted(gap, ".1e", "m or rad") if math.isfinite(gap) else NONE),
        ("rank", NONE if seen is None else number(seen.rank)),
        *_at_reference(loop, seen),
        ("mobility", NONE if seen is None else number(seen.mobility)),
        ("actuated joints", number(len(loop.actuated))),
    ]
    if seen is not None:
        rows += [
            ("controlled free motions", number(seen.held)),
            ("passive joints", number(len(seen.idle))),
            ("actuator forces", "unique" if seen.held == len(loop.actuated) else "not unique"),
        ]
    rows += [("moving mass", number(float(mass), "kg")), ("gravity", f"{_vector(loop)} m/s²")]
    return Table(f"Robot {model.name}", ("", "value"), tuple(rows), layout="words")


def _at_reference(loop: LoopModel, seen: Overview | None) -> list[tuple[str, str]]:
    """Return the rank at the reference configuration, where that is singular."""
    rank = None if seen is None else loop.rank(loop.assemble().q)
    return [] if seen is None or rank == seen.rank else [("rank at the reference", f"{rank}, singular")]


_AXIAL = ("hinge", "slider", "cylindrical", "planar")  # closures that the z axes of their frames matter to


def doubts(loop: LoopModel, seen: Overview) -> list[str]:
    """Return what to look at first of a robot with a singular reference, or less mobility than motors."""
    found, there = [], overview(loop, loop.assemble().q)
    if (there.rank, there.held) != (seen.rank, seen.held):
        values = joint_values(loop, loop.regular_configuration)
        near = ", ".join(f"{name}={float(row[0]):.3g}" for name, row in values.items() if len(row) == 1)
        lost = f"the closures have rank {there.rank} there and {seen.rank}"
        if there.rank == seen.rank:
            lost = f"the motors move {there.held} of {there.mobility} free motions there and {seen.held}"
        found.append(
            f"the reference configuration is singular: {lost} nearby, where what is said here holds. Motions "
            "and forces are not determined at the reference; "
            f"a regular one near it, for --around or 'reference' of the sidecar: {near}"
        )
    every = sum(size == 1 for size in loop.model.nvs)
    if not (loop.constraint_rows or loop.sidecar.bushings) and len(loop.actuated) == every:
        found.append(
            "no loop closures are known: this is an open chain. A URDF has them, and which joints are "
            "actuated, in a sidecar: FILE.yaml beside FILE.urdf, or the second argument"
        )
    axial = [closure.name for closure in loop.sidecar.closures if closure.kind in _AXIAL]
    if axial and seen.mobility < max(1, len(loop.actuated)):
        found.append(
            f"the mobility is {seen.mobility}, with {len(loop.actuated)} actuated joints: is the z axis of "
            f"both frames of {axial[0]} the axis of the joint? Closures turn and slide about z, whatever the "
            "axes of other joints are"
        )
    return found


def doubtful_bodies(loop: LoopModel) -> list[str]:
    """Return what speaks against the bodies of a robot's file, in sentences."""
    none = []
    for name, body in zip(loop.model.names, loop.model.inertias, strict=True):
        least, middle, most = np.linalg.eigvalsh(body.inertia) if body.mass > 0.0 else np.zeros(3)
        if least < -_ROUNDED * most or most > (1 + _ROUNDED) * (least + middle):
            none.append(f"the one after {name}")
    words = "no body has these moments of inertia, of which one is negative or more than the others together"
    return [*([f"{words}: {', '.join(none)}"] if none else []), *doubtful_units(loop)]


_ROUNDED = 1e-3  # how exact the moments in files are
# Mass over the cube of the size [kg/m³]. Of a ball, by its radius of gyration, it is nine times the density,
# of tungsten 1.7e5, in millimetres 1e-9 of that, of air 11; of a steel rod a hundred times as long as thick
# it is 0.6, and by its radius of gyration 25.
_NO_BODY, _AIR = 1e-3, 11.0
_NO_GYRATION = 10.0  # radius of gyration by the longest distance, which it exceeds in hardly any machine


def doubtful_units(loop: LoopModel) -> list[str]:
    """Return what speaks for lengths in millimetres or inertias in kg mm²: one sentence, or none.

    For the former nine tenths of the mass are in bodies that are too light for the longest distance that they
    fix, where they fix any, or this and their radius of gyration. For the latter they are so for their radius
    of gyration alone, and this is ten times as long as any distance.
    """
    model = loop.model
    parts: list[tuple[float, float, float, str]] = []  # mass, distance, radius of gyration, name
    ends: list[list[FloatArray]] = [[] for _ in range(model.njoints)]
    for joint in range(1, model.njoints):
        ends[model.parents[joint]].append(model.jointPlacements[joint].translation)
    for frame in model.frames:
        ends[frame.parentJoint].append(frame.placement.translation)
    for joint, body in enumerate(model.inertias):
        if joint and body.mass > 0.0:
            distance = max(float(np.linalg.norm(p)) for p in (body.lever, *ends[joint]))
            radius = math.sqrt(max(0.0, float(np.trace(body.inertia))) / 2.0 / body.mass)
            parts.append((body.mass, distance, radius, str(model.names[joint])))
    if not parts:
        return []
    mass, distance, radius = np.array([part[:3] for part in parts]).T
    heaviest = int(np.argmax(mass))
    told = f"the body after {parts[heaviest][3]} has {mass[heaviest]:.3g} kg"
    mean = math.sqrt(float(mass @ radius**2 / mass.sum()))
    if _thin(mass, radius, _AIR) and mean > _NO_GYRATION * distance.max() > 0.0:
        return [
            f"are inertias in kg mm²? They are read in kg m², and {told} and a radius of gyration of "
            f"{radius[heaviest]:.3g} m, where no body is longer than {distance.max():.3g} m"
        ]
    size, long = np.maximum(distance, radius), distance > 0.0
    if _thin(mass, size, _NO_BODY) or _thin(mass[long], distance[long], _NO_BODY):
        return [
            f"are lengths in millimetres? They are read in metres, and {told} at a size of "
            f"{size[heaviest]:.3g} m: far lighter than air"
        ]
    return []


def _thin(mass: FloatArray, size: FloatArray, least: float) -> bool:
    """Return whether nine tenths of the mass are in bodies with less mass for their size."""
    return bool(mass[mass < least * size**3].sum() > 0.9 * mass.sum())


def assembly_table(loop: LoopModel, assembly: Assembly) -> Table:
    """Return the values of all joints of an assembly."""
    rows = []
    for name, values in joint_values(loop, assembly.q).items():
        joint = loop.model.getJointId(name)
        single = len(values) == 1
        unit = ("m" if is_slide(loop, joint) else "rad") if single else "m, rad"
        told = [number(float(value)) for value in values]
        rows.append((name, told[0] if single else ", ".join(told), unit))
    kept = "the same" if assembly.same_assembly else "perhaps another one"
    note = (
        f"Gap {assembly.gap:.1e} m or rad, rank {assembly.rank}, mobility {assembly.mobility}, "
        f"{assembly.iterations} iterations; the assembly is {kept} as that of the start."
    )
    return Table("Assembly", ("Joint", "value", "unit"), tuple(rows), note, layout="words")


def joint_values(loop: LoopModel, q: FloatArray) -> dict[str, FloatArray]:
    """Return the values of all joints by name: of a continuous joint its angle; dict of str to (n,) array."""
    model, found = loop.model, {}
    for i in range(1, model.njoints):
        values = np.asarray(q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]])
        if model.nqs[i] == 2 and model.nvs[i] == 1:
            values = np.array([np.arctan2(values[1], values[0])])
        found[str(model.names[i])] = values
    return found


def actuators_table(loop: LoopModel, time: FloatArray, tau: FloatArray, v: FloatArray) -> Table:
    """Return peaks and root mean squares over time of the actuators' forces over a motion."""
    power = tau * v[:, loop.actuated_v]
    rows: list[tuple[Cell, ...]] = []
    for i, name in enumerate(loop.actuated):
        at = int(np.argmax(np.abs(tau[:, i])))
        rms = math.sqrt(mean_over(time, tau[:, i] ** 2))
        unit = units_of_actuated(loop)[i][1]
        peak_power = float(power[np.argmax(np.abs(power[:, i])), i])
        rows.append((name, float(tau[at, i]), float(time[at]), rms, unit, peak_power))
    header = ("Actuator", "peak", "at [s]", "RMS", "unit", "peak power [W]")
    return Table("Forces of the actuators", header, tuple(rows))


def motors_table(loop: LoopModel, tau: FloatArray, v: FloatArray) -> Table | None:
    """Return peaks of torque and speed before the gears over a motion; None where there are no gears."""
    data = {entry.joint: entry for entry in loop.sidecar.joint_data}
    geared = [name for name in loop.actuated if name in data and data[name].gear_ratio != 1.0]
    side = motor_side(loop.actuated, loop.sidecar.joint_data, tau, v[:, loop.actuated_v])
    rows: list[tuple[Cell, ...]] = []
    for name in geared:
        i = loop.actuated.index(name)
        peaks = (float(np.abs(values[:, i]).max()) for values in (side.torque, side.speed))
        rows.append((name, data[name].gear_ratio, data[name].rotor_inertia, *peaks))
    header = ("Motor of", "gear ratio", "rotor [kg m^2]", "peak torque [N m]", "peak speed [rad/s]")
    return Table("Motors, before their gears", header, tuple(rows), decimals=6) if rows else None


def mean_over(time: FloatArray, values: FloatArray) -> float:
    """Return the mean over time by the trapezoidal rule; of one sample its value."""
    if len(time) < 2:
        return float(values[0])
    areas = (values[1:] + values[:-1]) / 2 * np.diff(time)
    return float(areas.sum() / (time[-1] - time[0]))


def _vector(loop: LoopModel) -> str:
    return ", ".join(number(float(x)) for x in loop.model.gravity.linear)
