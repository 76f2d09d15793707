"""The document of the page: everything that it shows, as JSON.

`page_document` writes that of the manipulator, `p3dof.viewer.document.robot_document` that of any robot. The
format is described in the reference of the documentation, and by ``document.schema.json`` beside this file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof._base.version import __version__
from p3dof.analysis.reactions import AnyReactions
from p3dof.codegen.machine import ACTUATORS, limit_row, parameter_row
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import SLIDES, Parameters
from p3dof.viewer.document.closures import closures_of
from p3dof.viewer.document.encoding import encoded
from p3dof.viewer.document.machine import Machine, require_machine
from p3dof.viewer.document.machine_reactions import with_reactions
from p3dof.viewer.document.machine_runs import Runnable, Samples, run_of
from p3dof.viewer.document.machine_scene import machine_scene

FORMAT = 1
"""Of the documents that are written; a page refuses a newer one."""
TITLE = "3-DOF spatial parallel manipulator"


def page_document(
    robot: Machine,
    result: Runnable | None = None,
    *,
    runs: Mapping[str, Runnable | tuple[Machine, Runnable]] | None = None,
    reactions: AnyReactions | None = None,
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
    if not isinstance(title, str):
        raise InputError(f"title: expected text, got {shown(title)}")
    if not isinstance(runs, Mapping | None):
        raise InputError(f"runs: expected runs by name, got {shown(runs)}")
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
    document: dict[str, Any] = {
        "format": FORMAT,
        "title": title,
        "generator": {"p3dof": __version__, "pinocchio": str(pin.__version__)},
        "machine": {"name": "p3dof", "hash": hashlib.sha256(np.array(row, "<f8").tobytes()).hexdigest()},
        "scene": machine_scene(robot),
        "runs": [_run(robot, machine, samples) for machine, samples in found],
        "closures": closures_of(robot.loop),
        "inputs": _inputs(robot.parameters),
        "limits": {
            "travel": list(limits.travel),
            "speed": limits.speed,
            "force": limits.force,
            "tilt": list(limits.tilt),
        },
        "engine": {"kind": "p3dof", "parameters": encoded(row)},
    }
    return document if reactions is None else with_reactions(robot, document, found[0][1], reactions)


def _run(robot: Machine, machine: Machine, samples: Samples) -> dict[str, Any]:
    """Return a run of a document, perhaps of another machine than the document's."""
    found = run_of(machine, samples)
    if engine_row(machine.parameters) == engine_row(robot.parameters):
        return found
    geometry = machine.parameters.geometry
    lengths = {name: getattr(geometry, name) for name in ("r", "R", "L")}
    own = {"machine": lengths, "parameters": encoded(engine_row(machine.parameters))}
    return found | own | {"notes": ["This run is of another machine.", *found["notes"]]}


_OF_SLIDERS = len(ACTUATORS) * len(SLIDES)


def engine_row(parameters: Parameters) -> list[float]:
    """Return the numbers of a machine as the C of its controller takes them, ``p3dof_parameters``.

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    list of float
        r, R, L, b, gravity (3), the ten bodies (10 each), viscous and Coulomb friction (13 each), smoothing,
        travel (2), speed, force, tilt (2), armature, counterbalance, spring and counterweight of the sliders
        (3 each): 152 numbers.
    """
    row = parameter_row(parameters)
    own, of_sliders = row[:-_OF_SLIDERS], row[-_OF_SLIDERS:]
    return [*own[:3], parameters.geometry.b, *own[3:], *limit_row(parameters), *of_sliders]


def _inputs(parameters: Parameters) -> list[dict[str, Any]]:
    """Return what may be set: the pose of the platform."""
    geometry, limits = parameters.geometry, parameters.limits
    reach = geometry.L - (geometry.R - geometry.r)
    rows = [("y", "y of P", "m", (-reach, reach)), ("z", "z of P", "m", limits.travel)]
    rows += [("theta", "Tilt θ", "rad", limits.tilt)]
    return [
        {"key": key, "label": label, "unit": unit, "low": low, "high": high, "value": 0.0}
        for key, label, unit, (low, high) in rows
    ]
