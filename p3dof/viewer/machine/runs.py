"""Runs of the manipulator as a document has them: motions with forces, runs in time, reactions of joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.analysis.reactions import AnyReactions, how_chosen
from p3dof.analysis.reactions.results import JOINTS
from p3dof.machine.motion import Motion, states_of
from p3dof.machine.parameters import PLATFORM, SLIDES
from p3dof.methods import InverseDynamics, JointStates
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.runs import Simulation
from p3dof.viewer.document.encoding import GREY, PALETTE, Limit, colour, curve, encoded, layer, load
from p3dof.viewer.document.runs import as_run
from p3dof.viewer.document.solids import solid
from p3dof.viewer.document.trees import place_of, placement
from p3dof.viewer.machine.room import COLOURS, LEGS, Machine, Room

Runnable = Motion | InverseDynamics | Simulation
"""What can be a run of a document."""

_POSE = (("y", "y", "m"), ("z", "z", "m"), ("theta", "θ", "rad"))
"""Key, symbol and unit of what the platform's pose consists of."""
_NAMES = {"pinocchio": "Pinocchio", "virtual-power": "virtual powers", "compiled": "compiled"}


@dataclass(frozen=True, eq=False)
class Samples:
    """What a run of the manipulator consists of, however it was found."""

    name: str  # what it is called
    motion: Motion  # motion of the platform, N samples
    joints: JointStates  # every joint, in the order of the model
    forces: FloatArray  # (N, 3): of the actuators A, B, C [N]
    wrench: FloatArray  # (N, 6): on the platform at P [N, N m]
    notes: tuple[str, ...]  # what a reader should know
    reference: FloatArray | None = None  # (N, 3): poses that a controller was to follow
    asked: FloatArray | None = None  # (N, 3): forces that it asked for [N]

    @classmethod
    def of(cls, robot: Machine, run: Runnable, name: str | None = None) -> Samples:
        """Return the samples of a motion, of a result, or of a run in time."""
        if isinstance(run, Motion):
            run = robot.inverse_dynamics(run, on_invalid="nan")
        if not isinstance(run, InverseDynamics | Simulation):
            raise InputError(f"result: expected a Motion, InverseDynamics or Simulation, got {shown(run)}")
        joints = run.joints.columns(tuple(str(joint) for joint in robot.model.names[1:]))
        shared, method = (run.motion, joints, run.forces, run.wrench), _NAMES.get(run.method, run.method)
        if isinstance(run, InverseDynamics):
            return cls(f"Forces by {method}" if name is None else name, *shared, run.warnings)
        stop = () if run.stop is None else (f"The run ended early: {run.stop}.",)
        asked = None if np.array_equal(run.asked, run.forces, equal_nan=True) else run.asked
        return cls(f"Simulation, {method}" if name is None else name, *shared, stop, run.reference, asked)

    @property
    def slides(self) -> JointStates:
        """The sliders."""
        return self.joints.columns(SLIDES)


def run_of(robot: Machine, samples: Samples) -> dict[str, Any]:
    """Return a run of a document."""
    motion, joints = samples.motion, samples.joints
    tables = {"pose": motion.pose, "velocity": motion.velocity, "acceleration": motion.acceleration}
    curves, loads = curves_of(robot, samples), _loads(robot, samples)
    found = as_run(samples.name, motion.time, joints.q, curves, loads, list(samples.notes), tables)
    return found | ({"wrench": encoded(samples.wrench)} if np.any(samples.wrench) else {})


def curves_of(robot: Machine, samples: Samples) -> list[dict[str, Any]]:
    """Return the curves of a run: forces, sliders, power, pose; of a run in time also what it followed."""
    limits, slides = robot.parameters.limits, samples.slides
    force, speed = (-limits.force, limits.force), (-limits.speed, limits.speed)
    power, columns = samples.forces * slides.v, [samples.joints.names.index(slide) for slide in SLIDES]
    sizes = static_forces(robot, samples)
    return [
        *_by_leg("force", "Actuator forces", "Force", "N", samples.forces, force),
        *_by_leg("static", "Static forces", "Static force", "N", sizes, force),
        *_by_leg("asked", "Commanded forces", "Commanded force", "N", samples.asked, force),
        *_by_leg("power", "Power", "Power", "W", power),
        curve("power_total", "Power, sum", "Power", "W", GREY, power.sum(axis=1)),
        *_by_leg("slider", "Slider positions", "Slider", "m", columns, limits.travel),
        *_by_leg("speed", "Slider speeds", "Speed", "m/s", slides.v, speed),
        *_by_leg("acceleration", "Slider accelerations", "Acceleration", "m/s²", slides.a),
        *_pose_curves(robot, samples),
    ]


def _by_leg(
    key: str,
    group: str,
    words: str,
    unit: str,
    given: FloatArray | list[int] | None,
    limit: Limit | None = None,
) -> list[dict[str, Any]]:
    """Return a curve for each leg: of values (N, 3), or of columns of the joints; none without."""
    found: list[dict[str, Any]] = []
    if given is None:
        return found
    for i, leg in enumerate(LEGS):
        of: dict[str, Any] = (
            {"column": ("q", given[i])} if isinstance(given, list) else {"values": given[:, i]}
        )
        ink = colour(COLOURS[leg])
        found.append(curve(f"{key}_{leg}", f"{words} {leg.upper()}", group, unit, ink, limit=limit, **of))
    return found


def static_forces(robot: Machine, samples: Samples) -> FloatArray:
    """Return the forces (N, 3) that would hold the machine at rest in each pose [N].

    NaN where the forces of the run are.
    """
    states = states_of(samples.motion.pose, wrench=samples.wrench, on_invalid="nan")
    static = VirtualPowerMethod(robot.parameters).forces(states)
    static[~np.isfinite(samples.forces)] = np.nan
    return static


def _pose_curves(robot: Machine, samples: Samples) -> list[dict[str, Any]]:
    found = []
    for words, dots, per in (("Pose", "", ""), ("Velocity", "_dot", "/s"), ("Acceleration", "_ddot", "/s²")):
        for i, (key, symbol, unit) in enumerate(_POSE):
            limit = robot.parameters.limits.tilt if key == "theta" and words == "Pose" else None
            label = symbol if words == "Pose" else f"{words} of {symbol}"
            shared = (f"{words} of the platform", f"{unit}{per}", PALETTE[3 + i])
            found.append(curve(f"{key}{dots}", label, *shared, None, (words.lower(), i), limit))
    if samples.reference is not None:
        error = samples.motion.pose - samples.reference
        for i, (key, symbol, unit) in enumerate(_POSE):
            shared = ("Tracking error", unit, PALETTE[3 + i])
            found.append(curve(f"{key}_error", f"Error of {symbol}", *shared, error[:, i]))
    return found


def _loads(robot: Machine, samples: Samples) -> list[dict[str, Any]]:
    """Return the forces of the actuators beside their sliders, and the external wrench at P."""
    found, joints = [], list(samples.joints.names)
    places = Room.around(robot.parameters).beside
    for leg, slide in zip(LEGS, SLIDES, strict=True):
        key, label, place = f"force_{leg}", f"Force of actuator {leg.upper()}", places[leg].tolist()
        ink, along = colour(COLOURS[leg]), ([0.0, 0.0, 1.0], key)
        found.append(load(key, label, "force", (joints.index(slide), place), ink, "actuator", along=along))
    place_of_p = place_of(robot.model.frames[robot.model.getFrameId(PLATFORM)])
    for kind, part in (("force", samples.wrench[:, :3]), ("moment", samples.wrench[:, 3:])):
        if np.any(part):
            key, label, values = f"wrench_{kind}", f"External {kind} at P", encoded(part)
            found.append(load(key, label, kind, place_of_p, PALETTE[6], "wrench", values))
    return found


def with_reactions(
    robot: Machine, document: dict[str, Any], samples: Samples, reactions: AnyReactions
) -> dict[str, Any]:
    """Return a document whose first run also has the reactions of the joints."""
    if not isinstance(reactions, AnyReactions):
        raise InputError(f"reactions: expected Reactions, got {shown(reactions)}")
    one = reactions.each[0]
    if not np.array_equal(one.motion.pose, samples.motion.pose, equal_nan=True):
        raise InputError("reactions: expected those of the motion that is shown first")
    curves, loads = [], []
    for kind, values in zip(("force", "moment"), one.in_base(), strict=True):
        group, unit = ("Forces in joints", "N") if kind == "force" else ("Moments in joints", "N m")
        for i, joint in enumerate(JOINTS):
            ink, key, vectors = PALETTE[i % len(PALETTE)], f"{kind} {joint.name}", values[:, i]
            size = np.linalg.norm(vectors, axis=1)
            curves.append(curve(key, f"{joint.label} {joint.name}", group, unit, ink, size))
            # what the predecessor of the joint exerts on the successor, at the joint
            place = place_of(robot.model.frames[robot.model.getFrameId(joint.frame)])
            label = f"{kind.capitalize()} in {joint.label}, {joint.meaning}"
            single = encoded(vectors, "float32")
            loads.append(load(key, label, kind, place, ink, "reaction", single, layer="reactions"))
    run, *others = document["runs"]
    notes = [*run["notes"], f"Loads of joints: {how_chosen(one)}"]
    run = run | {"curves": run["curves"] + curves, "loads": run["loads"] + loads, "notes": notes}
    layers = [*document["scene"]["layers"], layer("reactions", "Reactions of joints", False)]
    return document | {"runs": [run, *others], "scene": document["scene"] | {"layers": layers}}


def with_distances(
    robot: Machine, document: dict[str, Any], samples: Samples, clearance: Any
) -> dict[str, Any]:
    """Return a document whose first run says which parts are nearest; with what stands around the machine."""
    if not all(hasattr(clearance, name) for name in ("pose", "pairs", "distances", "nearest_points")):
        raise InputError(f"clearance: expected a Clearance, got {shown(clearance)}")
    if not np.array_equal(clearance.pose, samples.motion.pose):
        raise InputError("clearance: expected that of the motion that is shown first")
    least, pairs = clearance.distances.min(axis=1), clearance.distances.argmin(axis=1)
    used = np.unique(pairs)
    near = {
        "points": encoded(clearance.nearest_points().reshape(-1, 6)),
        "distances": encoded(least),
        "pairs": encoded(np.searchsorted(used, pairs), "int16"),
        "names": [" and ".join(clearance.pairs[int(pair)]) for pair in used],
        "required": float(clearance.required),
    }
    limit = (float(clearance.required), np.inf)
    line = curve("least_distance", "Least distance", "Least distance", "m", PALETTE[6], least, limit=limit)
    run, *others = document["runs"]
    scene, around = document["scene"], _around(robot, clearance)
    layers = [*scene["layers"], layer("nearest", "Nearest parts")]
    layers += [layer("surroundings", "Surroundings")] if around else []
    scene = scene | {"layers": layers, "solids": [*scene["solids"], *around]}
    run = run | {"curves": [*run["curves"], line], "nearest": near}
    return document | {"runs": [run, *others], "scene": scene}


_THINGS = (0.55, 0.45, 0.35, 0.6)
"""Colour of payloads and obstacles."""


def _around(robot: Machine, clearance: Any) -> list[dict[str, Any]]:
    """Return payload and obstacles as solids of a document."""
    frame, around = robot.model.frames[robot.model.getFrameId(PLATFORM)], clearance.surroundings
    places = [(int(frame.parentJoint) - 1, frame.placement, one) for one in around.payload]
    found = []
    for joint, start, one in [*places, *((-1, pin.SE3.Identity(), one) for one in around.obstacles)]:
        shape: dict[str, Any] = {"kind": "box", "size": one.size}
        place = pin.SE3(pin.rpy.rpyToMatrix(*one.turn), np.array(one.at))
        if one.size is None:
            low, high = np.array(one.ends)
            shape = {"kind": "capsule", "radius": one.radius, "length": float(np.linalg.norm(high - low))}
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), high - low)
            place = pin.SE3(turn.matrix() if shape["length"] else np.eye(3), (low + high) / 2)
        found.append(solid(one.name, joint, placement(start * place), shape, _THINGS, "surroundings"))
    return found
