"""Runs of the manipulator as a document has them: motions with their forces, and runs in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.machine.motion import Motion, states_of
from p3dof.machine.parameters import PLATFORM, SLIDES
from p3dof.methods import InverseDynamics, JointStates
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.runs import Simulation
from p3dof.viewer.document.curves import GREY, PALETTE, Limit, curve
from p3dof.viewer.document.encoding import colour, encoded
from p3dof.viewer.document.machine import Machine
from p3dof.viewer.document.machine_scene import beside
from p3dof.viewer.document.room import COLOURS, LEGS

Runnable = Motion | InverseDynamics | Simulation
"""What can be a run of a document."""

_POSE = (("y", "y", "m"), ("z", "z", "m"), ("theta", "θ", "rad"))
"""Key, symbol and unit of what the platform's pose consists of."""
_NAMES = {"pinocchio": "Pinocchio", "virtual-power": "virtual powers", "compiled": "compiled"}


@dataclass(frozen=True, eq=False)
class Samples:
    """What a run of the manipulator consists of, however it was found.

    Parameters
    ----------
    name : str
        What it is called.
    motion : Motion
        Motion of the platform, N samples.
    joints : JointStates
        Every joint, in the order of the model.
    forces : ndarray, shape (N, 3)
        Of the actuators A, B, C [N].
    wrench : ndarray, shape (N, 6)
        On the platform at P [N, N m].
    notes : tuple of str
        What a reader should know.
    reference : ndarray, shape (N, 3), optional
        Poses that a controller was to follow.
    asked : ndarray, shape (N, 3), optional
        Forces that it asked for [N].
    """

    name: str
    motion: Motion
    joints: JointStates
    forces: FloatArray
    wrench: FloatArray
    notes: tuple[str, ...]
    reference: FloatArray | None = None
    asked: FloatArray | None = None

    @classmethod
    def of(cls, robot: Machine, run: Runnable, name: str | None = None) -> Samples:
        """Return the samples of a motion, of a result, or of a run in time.

        Parameters
        ----------
        robot : Manipulator
            The machine.
        run : Motion, InverseDynamics or Simulation
            The forces of a motion are worked out with Pinocchio.
        name : str, optional
            What to call it; by default the method that it was found with.

        Returns
        -------
        Samples

        Raises
        ------
        InputError
            If it is something else.
        """
        if isinstance(run, Motion):
            run = robot.inverse_dynamics(run, on_invalid="nan")
        names = tuple(str(joint) for joint in robot.model.names[1:])
        if isinstance(run, InverseDynamics):
            told = f"Forces by {_NAMES.get(run.method, run.method)}" if name is None else name
            joints = run.joints.columns(names)
            return cls(told, run.motion, joints, run.forces, run.wrench, run.warnings)
        if isinstance(run, Simulation):
            told = f"Run in time, {_NAMES.get(run.method, run.method)}" if name is None else name
            stop = () if run.stop is None else (f"The run ended early: {run.stop}.",)
            joints = run.joints.columns(names)
            asked = None if np.array_equal(run.asked, run.forces, equal_nan=True) else run.asked
            return cls(told, run.motion, joints, run.forces, run.wrench, stop, run.reference, asked)
        raise InputError(f"result: expected a Motion, InverseDynamics or Simulation, got {shown(run)}")

    @property
    def slides(self) -> JointStates:
        """The sliders."""
        return self.joints.columns(SLIDES)


def run_of(robot: Machine, samples: Samples) -> dict[str, Any]:
    """Return a run of a document.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    samples : Samples
        Its samples.

    Returns
    -------
    dict
    """
    motion = samples.motion
    found: dict[str, Any] = {
        "name": samples.name,
        "time": encoded(motion.time),
        "q": encoded(samples.joints.q),
        "pose": encoded(motion.pose),
        "velocity": encoded(motion.velocity),
        "acceleration": encoded(motion.acceleration),
        "curves": curves_of(robot, samples),
        "loads": _loads(robot, samples),
        "notes": list(samples.notes),
    }
    if np.any(samples.wrench):
        found["wrench"] = encoded(samples.wrench)
    return found


def curves_of(robot: Machine, samples: Samples) -> list[dict[str, Any]]:
    """Return the curves of a run: forces, sliders, power, pose; of a run in time also what it followed.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    samples : Samples
        Its samples.

    Returns
    -------
    list of dict
    """
    return [*_force_curves(robot, samples), *_slider_curves(robot, samples), *_pose_curves(robot, samples)]


def _force_curves(robot: Machine, samples: Samples) -> list[dict[str, Any]]:
    most = robot.parameters.limits.force
    limit, forces, found = (-most, most), samples.forces, []
    static = static_forces(robot, samples)
    power = forces * samples.slides.v
    tables = [("force", "Actuator forces", "Force", forces, "N", limit)]
    tables += [("static", "Forces at rest", "Holding force", static, "N", limit)]
    if samples.asked is not None:
        tables += [("asked", "Forces asked for", "Force asked for", samples.asked, "N", limit)]
    for key, group, words, values, unit, bounds in tables:
        found += _by_leg(key, group, words, values, unit, bounds)
    found += _by_leg("power", "Power", "Power", power, "W", None)
    found.append(curve("power_total", "Power, sum", "Power", "W", GREY, power.sum(axis=1)))
    return found


def _by_leg(
    key: str, group: str, words: str, values: FloatArray, unit: str, limit: Limit | None
) -> list[dict[str, Any]]:
    return [
        curve(f"{key}_{leg}", f"{words} {leg.upper()}", group, unit, _ink(leg), column, limit=limit)
        for leg, column in zip(LEGS, values.T, strict=True)
    ]


def _ink(leg: str) -> str:
    return colour(COLOURS[leg])


def static_forces(robot: Machine, samples: Samples) -> FloatArray:
    """Return the forces (N, 3) that would hold the machine at rest in each pose [N].

    Parameters
    ----------
    robot : Manipulator
        The machine.
    samples : Samples
        Poses, and the external wrench on the platform.

    Returns
    -------
    ndarray, shape (N, 3)
        NaN where the forces of the run are.
    """
    states = states_of(samples.motion.pose, wrench=samples.wrench, on_invalid="nan")
    static = VirtualPowerMethod(robot.parameters).forces(states)
    static[~np.isfinite(samples.forces)] = np.nan
    return static


def _slider_curves(robot: Machine, samples: Samples) -> list[dict[str, Any]]:
    limits, found = robot.parameters.limits, []
    rest = samples.slides
    for leg, slide in zip(LEGS, SLIDES, strict=True):
        place, words = ("q", samples.joints.names.index(slide)), f"Slider {leg.upper()}"
        shared = ("Slider positions", "m", _ink(leg), None, place, limits.travel)
        found.append(curve(f"slider_{leg}", words, *shared))
    found += _by_leg("speed", "Slider speeds", "Speed", rest.v, "m/s", (-limits.speed, limits.speed))
    return [*found, *_by_leg("acceleration", "Slider accelerations", "Acceleration", rest.a, "m/s²", None)]


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
    joints, places = list(samples.joints.names), beside(robot)
    found: list[dict[str, Any]] = [
        {
            "key": f"force_{leg}",
            "label": f"Force of actuator {leg.upper()}",
            "kind": "force",
            "joint": joints.index(slide),
            "point": places[leg].tolist(),
            "frame": "world",
            "direction": [0.0, 0.0, 1.0],
            "curve": f"force_{leg}",
            "colour": _ink(leg),
            "group": "actuator",
            "unit": "N",
        }
        for leg, slide in zip(LEGS, SLIDES, strict=True)
    ]
    frame = robot.model.frames[robot.model.getFrameId(PLATFORM)]
    point = frame.placement.translation.tolist()
    for kind, unit, part in (("force", "N", slice(0, 3)), ("moment", "N m", slice(3, 6))):
        if np.any(samples.wrench[:, part]):
            found.append(
                {
                    "key": f"wrench_{kind}",
                    "label": f"External {kind} at P",
                    "kind": kind,
                    "joint": int(frame.parentJoint) - 1,
                    "point": point,
                    "frame": "world",
                    "values": encoded(samples.wrench[:, part]),
                    "colour": PALETTE[6],
                    "group": "wrench",
                    "unit": unit,
                }
            )
    return found
