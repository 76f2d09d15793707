"""The scene of the manipulator: its solids, its skinned platform, guide-ways, axes and letters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.machine.description.shapes import PLATFORM
from p3dof.machine.parameters import PLATFORM as PLATFORM_FRAME
from p3dof.viewer.document.encoding import colour
from p3dof.viewer.document.machine import Machine
from p3dof.viewer.document.measures import above
from p3dof.viewer.document.room import COLOURS, GLASS, LEGS, LINKS_OF_LEGS, Room
from p3dof.viewer.document.skin import skin_of
from p3dof.viewer.document.solids import mesh, solid, solids_of
from p3dof.viewer.document.trees import placement, tree_of

LAYERS = {
    "machine": "Machine",
    "frame": "Frame",
    "rails": "Guide-ways",
    "axes": "Axes",
    "names": "Names of the legs",
    "trace": "Path of P",
}
"""What can be hidden, and what it is called."""
TRACE = "#7b1fa2"
"""Colour of the path of P."""
_RAIL = (0.373, 0.42, 0.463, 1.0)
_AXES = {"x": (0.698, 0.133, 0.133, 1.0), "y": (0.18, 0.49, 0.196, 1.0), "z": (0.122, 0.306, 0.62, 1.0)}
_HEAD, _HEAD_RADIUS, _SIDES = 4.0, 2.4, 16


def machine_scene(robot: Machine) -> dict[str, Any]:
    """Return the scene of a document of the manipulator.

    Parameters
    ----------
    robot : Manipulator
        The machine.

    Returns
    -------
    dict
    """
    room = Room.around(robot.parameters)
    frame = robot.model.frames[robot.model.getFrameId(PLATFORM_FRAME)]
    joint = int(frame.parentJoint) - 1
    solids = [*_machine(robot, room, frame), *_rails(room), *_axes(room)]
    low, high = room.corners.min(axis=0), room.corners.max(axis=0)
    return {
        "centre": ((low + high) / 2).tolist(),
        "radius": float(np.linalg.norm(high - low)) / 2,
        "floor": room.bottom,
        "joints": tree_of(robot.model),
        "solids": solids,
        "labels": _labels(room),
        "lines": [],
        "layers": [{"name": name, "label": text, "shown": True} for name, text in LAYERS.items()],
        "traced": {"name": "P", "joint": joint, "point": frame.placement.translation.tolist()}
        | {"colour": TRACE, "layer": "trace"},
    }


def beside(robot: Machine) -> dict[str, FloatArray]:
    """Return where the force of each leg's actuator is drawn, beside its slider, in the slider's axes [m].

    Parameters
    ----------
    robot : Manipulator
        The machine.

    Returns
    -------
    dict of str to ndarray, shape (3,)
    """
    edge = Room.around(robot.parameters).size.slider_edge
    shifts = {"a": -1.2 * edge, "b": 1.2 * edge, "c": robot.parameters.geometry.b + 0.7 * edge}
    return {leg: np.array([0.0, shift, 0.0]) for leg, shift in shifts.items()}


def _machine(robot: Machine, room: Room, frame: Any) -> list[dict[str, Any]]:
    """Return the solids of the model: the frame of glass, the platform as one skin, and P."""
    found = []
    for one in solids_of(robot.visual_model):
        link = one["name"].rpartition("_")[0]
        if link == "platform":  # the skin is in the place of its solids
            continue
        if one["layer"] == "frame":
            one |= {"colour": colour(GLASS), "opacity": GLASS[3]}
        leg = next((leg for leg in LEGS if link in LINKS_OF_LEGS[leg]), None)
        found.append(one if leg is None else one | {"leg": leg})
    joint, place = int(frame.parentJoint) - 1, placement(frame.placement)
    skin = mesh(*skin_of(robot.parameters.geometry.r, room.size))
    ball = {"kind": "sphere", "radius": 0.5 * room.size.rod_radius}
    found.append(solid("platform", joint, place, skin, PLATFORM.rgba, "machine"))
    return [*found, solid("P", joint, place, ball, (0.482, 0.122, 0.635, 1.0), "machine")]


def _rails(room: Room) -> list[dict[str, Any]]:
    low, high = room.travel
    bottom, top = low - 0.7 * room.size.slider_edge, high + room.size.slider_edge
    shape = {"kind": "cylinder", "radius": 0.35 * room.size.rod_radius, "length": top - bottom}
    places = {leg: above(pivot, (bottom + top) / 2) for leg, pivot in room.pivots.items()}
    return [
        solid(f"rail_{leg}", -1, [*place.tolist(), 0.0, 0.0, 0.0, 1.0], shape, _RAIL, "rails")
        for leg, place in places.items()
    ]


def _axes(room: Room) -> list[dict[str, Any]]:
    """Return the axes of the fixed frame: a shaft and a head each."""
    radius, length = 0.25 * room.size.rod_radius, 0.35 * room.radius
    head = _HEAD * radius
    shaft = {"kind": "cylinder", "radius": radius, "length": length - head}
    cone, found = _cone(_HEAD_RADIUS * radius, head), []
    for i, (axis, rgba) in enumerate(_AXES.items()):
        turn = np.roll(np.eye(3), 2 - i, axis=1)  # z along the axis
        middle, start = (
            placement(pin.SE3(turn, turn[:, 2] * z)) for z in ((length - head) / 2, length - head)
        )
        found.append(solid(f"axis_{axis}", -1, middle, shaft, rgba, "axes"))
        found.append(solid(f"axis_{axis}_head", -1, start, cone, rgba, "axes"))
    return found


def _cone(radius: float, length: float) -> dict[str, Any]:
    """Return a cone along z from its base at 0."""
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    rim = radius * np.column_stack((np.cos(angles), np.sin(angles), 0 * angles))
    i = np.arange(_SIDES)
    j = (i + 1) % _SIDES
    tip, base = np.full_like(i, _SIDES), np.full_like(i, _SIDES + 1)
    corners = np.vstack((rim, [(0.0, 0.0, length), (0.0, 0.0, 0.0)]))
    return mesh(corners, np.vstack((np.column_stack((i, j, tip)), np.column_stack((j, i, base)))))


def _labels(room: Room) -> list[dict[str, Any]]:
    height = room.top - room.size.slider_edge + room.letter / 2
    found = [
        _label(leg.upper(), above(pivot, height), room.letter, colour(COLOURS[leg]), "names")
        for leg, pivot in room.pivots.items()
    ]
    length = 0.35 * room.radius
    for direction, (axis, rgba) in zip(np.eye(3), _AXES.items(), strict=True):
        found.append(_label(f"{axis}0", 1.25 * length * direction, 0.25 * length, colour(rgba), "axes"))
    return found


def _label(text: str, at: FloatArray, height: float, ink: str, layer: str) -> dict[str, Any]:
    return {"text": text, "at": at.tolist(), "joint": -1, "height": height, "colour": ink, "layer": layer}
