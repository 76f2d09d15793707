"""What results of a problem depend on, as plain data: a folder of another problem is refused by it."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from p3dof._base.blocks import digest
from p3dof.design.optimisation.constraints import Constraint
from p3dof.design.optimisation.evaluated import Asked
from p3dof.design.optimisation.measure import FunctionMeasure, Measure
from p3dof.design.optimisation.population import Setting
from p3dof.design.optimisation.robust import Robust


def settings_of(setting: Setting, asked: Asked) -> dict[str, Any]:
    """Return what the results of a problem depend on.

    Parameters
    ----------
    setting : Setting
        What its designs share.
    asked : Asked
        Variables, objectives and constraints.

    Returns
    -------
    dict
        For JSON; measures of one's own count by their names and functions.
    """
    variables, box, motion = asked.variables, setting.box, setting.motion
    machine = json.dumps(setting.machine.to_dict(), sort_keys=True)
    bounds = zip(variables.names, variables.low.tolist(), variables.high.tolist(), strict=True)
    return {
        "variables": {name: [low, high] for name, low, high in bounds},
        "objectives": [_measure(measure) for measure in asked.objectives],
        "constraints": [_constraint(item) for item in asked.constraints],
        "box": None if box is None else {"y": list(box.y), "theta": list(box.theta), "grid": list(box.grid)},
        "bodies": setting.bodies,
        "fixed": dict(setting.fixed),
        "machine": hashlib.sha256(machine.encode()).hexdigest(),
        "motion": digest(motion.time, motion.pose, motion.velocity, motion.acceleration),
        "wrench": None if setting.wrench is None else digest(setting.wrench),
        "modulus": setting.modulus,
        "drive_stiffness": setting.drive_stiffness,
        "level": setting.level,
    }


def _measure(measure: Measure) -> dict[str, Any]:
    kind = type(measure)
    found: dict[str, Any] = {
        "name": measure.name,
        "kind": f"{kind.__module__}.{kind.__qualname__}",
        "better": measure.better,
    }
    if isinstance(measure, FunctionMeasure):
        function = measure.function
        found["function"] = getattr(function, "__qualname__", type(function).__qualname__)
    if isinstance(measure, Robust):
        found |= {
            "sigma": dict(measure.sigma),
            "k": measure.k,
            "points": measure.points,
            "seed": measure.seed,
        }
        found["of"] = _measure(measure.measure)
    return found


def _constraint(item: Constraint) -> dict[str, Any]:
    return {**_measure(item.measure), "at_least": item.at_least, "bound": item.bound}
