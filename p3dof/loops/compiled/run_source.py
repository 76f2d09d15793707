"""Runs of any robot in time as C: the text around `p3dof.loops.compiled.run_functions`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from p3dof.loops.compiled.formulas import Robot
from p3dof.loops.compiled.function import Function
from p3dof.loops.compiled.printing import fill, lanes_source, listed

KINDS = {"_one": ("double", "1"), "_lanes": ("lanes", "WIDTH")}
"""Runs one by one, and side by side: their types, and how many there are."""

_MODEL = """\
    if (r->control >= PD_WITH_GRAVITY) {
        @real in[@inputs], out[@outputs];
        memset(in, 0, sizeof in);
        memcpy(in, b->given, sizeof(@real) * NQ);
@defaults
        if (r->control == COMPUTED_TORQUE) {
            memcpy(in + NQ, b->given + NQ, sizeof(@real) * FREE);
            memcpy(in + NQ + FREE, wanted, sizeof(@real) * MOTORS);
        }
        model_forces@suffix(in, out);
        for (int i = 0; i < MOTORS; ++i)
            wanted[i] = r->control == COMPUTED_TORQUE ? out[i] : wanted[i] + out[i];
        for (int lane = 0; lane < W; ++lane)
            b->good[lane] &= AT(out[MOTORS + 2], lane) > 0.0;
    }
"""


def runs_source(
    robot: Robot, flow: Function, model: Function | None, defaults: Mapping[str, list[float]], suffix: str
) -> str:
    """Return C that follows a robot in time.

    Parameters
    ----------
    robot : Robot
        The robot.
    flow : Function
        Its rates.
    model : Function, optional
        The forces of its controller's model.
    defaults : mapping of str to list of float
        Values of the model's inputs besides the motion.
    suffix : str
        One of `KINDS`.

    Returns
    -------
    str
    """
    independent = {place: i for i, place in enumerate(robot.independent)}
    real, width = KINDS[suffix]
    speeds = listed([independent.get(place, -1) for place in robot.motors] or [0])
    shared = fill("runs.in", motor_speeds=speeds, **sizes_of(robot, flow, list(flow.inputs.values())[3:]))
    functions = [flow] if model is None else [flow, replace(model, name="model_forces")]
    by_model = "" if model is None else _by_model(robot, model, defaults, real, suffix)
    block = fill("run_block.in", suffix=suffix, real=real, width=width, model=by_model)
    return lanes_source(functions, shared + block, calls=False)


def sizes_of(robot: Robot, flow: Function, loads: list[int]) -> dict[str, object]:
    """Return what the text of runs has of a robot's sizes and motors.

    Parameters
    ----------
    robot : Robot
        The robot.
    flow : Function
        Its rates.
    loads : list of int
        Sizes of the inputs that act besides the motors.
    """
    parts = {place: part for part in robot.tree.parts[1:] for place in part.v}
    return {
        "nq": robot.tree.nq,
        "nv": robot.tree.nv,
        "free": len(robot.independent),
        "motors": len(robot.motors),
        "loads": sum(loads),
        "groups": len(loads),
        "flow_results": len(flow.results),
        "load_sizes": listed(loads or [0]),
        "motor_places": listed([parts[place].q[0] for place in robot.motors] or [0]),
        "motor_circles": listed([int(parts[place].kind == "unbounded") for place in robot.motors] or [0]),
    }


def defaults_of(robot: Robot, model: Function, defaults: Mapping[str, list[float]]) -> tuple[str, int]:
    """Return statements that enter what a controller's model has besides the motion, and its inputs."""
    at = robot.tree.nq + len(robot.independent) + len(robot.motors)
    values = [value for name in list(model.inputs)[3:] for value in defaults[name]]
    lines = [f"        in[{at + i}] += {value!r};\n" for i, value in enumerate(values)]
    return "".join(lines), max(1, at + len(values))


def _by_model(
    robot: Robot, model: Function, defaults: Mapping[str, list[float]], real: str, suffix: str
) -> str:
    lines, size = defaults_of(robot, model, defaults)
    text = _MODEL.replace("@inputs", str(size)).replace("@outputs", str(len(model.results)))
    return text.replace("@defaults\n", lines).replace("@real", real).replace("@suffix", suffix)
