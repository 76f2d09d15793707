"""`page_document`: the document of the page for the manipulator, with its scene."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof.analysis.reactions import AnyReactions
from p3dof.codegen.machine import ACTUATORS, limit_row, parameter_row
from p3dof.machine.description.shapes import PLATFORM
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import PLATFORM as PLATFORM_FRAME
from p3dof.machine.parameters import SLIDES, Parameters
from p3dof.viewer.document.document import as_document, as_scene, check_asked
from p3dof.viewer.document.encoding import colour, encoded, layer, setting
from p3dof.viewer.document.solids import mesh, solid, solids_of
from p3dof.viewer.document.trees import place_of, placement
from p3dof.viewer.machine.room import (
    AXES,
    COLOURS,
    GLASS,
    LEGS,
    LINKS_OF_LEGS,
    RAIL,
    TRACE,
    Machine,
    Room,
    require_machine,
    skin_of,
)
from p3dof.viewer.machine.runs import Runnable, Samples, run_of, with_distances, with_reactions
from p3dof.viewer.stage import HEAD, HEAD_RADIUS, above

TITLE = "3-DOF spatial parallel manipulator"


def page_document(
    robot: Machine,
    result: Runnable | None = None,
    *,
    runs: Mapping[str, Runnable | tuple[Machine, Runnable]] | None = None,
    reactions: AnyReactions | None = None,
    clearance: Any = None,
    title: str = TITLE,
) -> dict[str, Any]:
    """Return the document of the manipulator: its scene, and runs with their curves and loads.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    result : Motion, InverseDynamics or Simulation, optional
        The run that is shown first. The forces of a motion are worked out with Pinocchio; without any run
        the machine is held at home.
    runs : mapping of str to Motion, InverseDynamics or Simulation, optional
        Further runs by name, to be compared with it. One of another machine is given as a pair, the machine
        and the run: it is drawn with that machine's lengths.
    reactions : Reactions or ReactionsComparison, optional
        Of the joints, over the motion of `result`: curves of their sizes, and arrows that can be shown.
    clearance : p3dof.design.Clearance, optional
        Of the parts, over the motion of `result`: a line between the two points that are nearest, with their
        distance, its curve, and what the machine carried and what stood around it.
    title : str
        Heading of the page.

    Returns
    -------
    dict
        What `json.dumps` takes; SI units and radians.

    Raises
    ------
    InputError
        If an argument is something else.
    """
    require_machine(robot)
    check_asked(runs, title)
    found = [] if result is None else [(robot, Samples.of(robot, result))]
    for name, run in (runs or {}).items():
        machine, one = run if isinstance(run, tuple) and len(run) == 2 else (robot, run)
        require_machine(machine)
        found.append((machine, Samples.of(machine, one, str(name))))
    if not found:
        still = Motion(np.zeros(1), *np.zeros((3, 1, 3)))
        found = [(robot, Samples.of(robot, still, "Held at home"))]
    row = engine_row(robot.parameters)
    limits = robot.parameters.limits
    document = as_document(
        robot.bare_loop,
        title,
        ("p3dof", hashlib.sha256(np.array(row, "<f8").tobytes()).hexdigest()),
        machine_scene(robot),
        [_run(robot, machine, samples) for machine, samples in found],
        _inputs(robot.parameters),
        {"kind": "p3dof", "parameters": encoded(row), "solids": _solids(robot.parameters)},
        limits={
            "travel": list(limits.travel),
            "speed": limits.speed,
            "force": limits.force,
            "tilt": list(limits.tilt),
        },
    )
    if reactions is not None:
        document = with_reactions(robot, document, found[0][1], reactions)
    return document if clearance is None else with_distances(robot, document, found[0][1], clearance)


def _run(robot: Machine, machine: Machine, samples: Samples) -> dict[str, Any]:
    """Return a run of a document, perhaps of another machine than the document's."""
    found = run_of(machine, samples)
    if engine_row(machine.parameters) == engine_row(robot.parameters):
        return found
    geometry = machine.parameters.geometry
    lengths = {name: getattr(geometry, name) for name in ("r", "R", "L")}
    own = {"machine": lengths, "parameters": encoded(engine_row(machine.parameters))}
    own["solids"] = _solids(machine.parameters)
    return found | own | {"notes": ["This run is of another machine.", *found["notes"]]}


_OF_SLIDERS = len(ACTUATORS) * len(SLIDES)


def engine_row(parameters: Parameters) -> list[float]:
    """Return the numbers of a machine as the C of its controller takes them, ``p3dof_parameters``.

    r, R, L, b, gravity (3), the ten bodies (10 each), viscous and Coulomb friction (13 each), smoothing,
    travel (2), speed, force, tilt (2), armature, counterbalance, spring and counterweight of the sliders (3
    each): 152 numbers.
    """
    row = parameter_row(parameters)
    own, of_sliders = row[:-_OF_SLIDERS], row[-_OF_SLIDERS:]
    return [*own[:3], parameters.geometry.b, *own[3:], *limit_row(parameters), *of_sliders]


def _solids(parameters: Parameters) -> dict[str, dict[str, float]]:
    """Return the densities of solids [kg/m³] and those of their sizes that are given [m]."""
    return {"density": dict(parameters.density), "dimensions": dict(parameters.dimensions)}


def _inputs(parameters: Parameters) -> list[dict[str, Any]]:
    """Return what may be set: the pose of the platform."""
    geometry, limits = parameters.geometry, parameters.limits
    reach = geometry.L - (geometry.R - geometry.r)
    return [
        setting("y", "y of P", "m", (-reach, reach)),
        setting("z", "z of P", "m", limits.travel),
        setting("theta", "Tilt θ", "rad", limits.tilt),
    ]


LAYERS = {
    "machine": "Machine",
    "frame": "Frame",
    "rails": "Guides",
    "axes": "Axes",
    "names": "Names of the legs",
    "trace": "Path of P",
}
"""What can be hidden, and what it is called."""
_SIDES = 16


def machine_scene(robot: Machine) -> dict[str, Any]:
    """Return the scene of a document of the manipulator."""
    room = Room.around(robot.parameters)
    frame = robot.model.frames[robot.model.getFrameId(PLATFORM_FRAME)]
    solids = [*_machine(robot, room, frame), *_rails(room), *_axes(room)]
    layers = [layer(name, label) for name, label in LAYERS.items()]
    joint, point = place_of(frame)
    traced = {"name": "P", "joint": joint, "point": point, "colour": colour(TRACE), "layer": "trace"}
    return as_scene(robot.model, room.corners, solids, layers, _labels(room), traced=traced)


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
    return [*found, solid("P", joint, place, ball, TRACE, "machine")]


def _rails(room: Room) -> list[dict[str, Any]]:
    bottom, top, radius = room.rails
    shape = {"kind": "cylinder", "radius": radius, "length": top - bottom}
    places = {leg: above(pivot, (bottom + top) / 2) for leg, pivot in room.pivots.items()}
    return [
        solid(f"rail_{leg}", -1, [*place.tolist(), 0.0, 0.0, 0.0, 1.0], shape, RAIL, "rails")
        for leg, place in places.items()
    ]


def _axes(room: Room) -> list[dict[str, Any]]:
    """Return the axes of the fixed frame: a shaft and a head each."""
    length, radius = room.axes
    head = HEAD * radius
    shaft = {"kind": "cylinder", "radius": radius, "length": length - head}
    cone, found = _cone(HEAD_RADIUS * radius, head), []
    for i, (axis, rgba) in enumerate(AXES.items()):
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
    length, _ = room.axes
    rows = [(leg.upper(), at, room.letter, COLOURS[leg], "names") for leg, at in room.names.items()]
    for direction, (axis, rgba) in zip(np.eye(3), AXES.items(), strict=True):
        rows.append((f"{axis}0", 1.25 * length * direction, 0.25 * length, rgba, "axes"))
    return [
        {
            "text": text,
            "at": at.tolist(),
            "joint": -1,
            "height": height,
            "colour": colour(rgba),
            "layer": name,
        }
        for text, at, height, rgba, name in rows
    ]
