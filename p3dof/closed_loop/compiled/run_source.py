"""Runs of any robot in time as C: the text around `p3dof.closed_loop.compiled.run_functions`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from p3dof.closed_loop.compiled.formulas import Robot
from p3dof.closed_loop.compiled.function import Function
from p3dof.closed_loop.compiled.printing import fill, lanes_source, listed

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
    parts = {place: part for part in robot.tree.parts[1:] for place in part.v}
    loads = list(flow.inputs.values())[3:]
    independent = {place: i for i, place in enumerate(robot.independent)}
    real, width = KINDS[suffix]
    shared = fill(
        "runs.in",
        nq=robot.tree.nq,
        nv=robot.tree.nv,
        free=len(robot.independent),
        motors=len(robot.motors),
        loads=sum(loads),
        groups=len(loads),
        flow_results=len(flow.results),
        load_sizes=listed(loads or [0]),
        motor_places=listed([parts[place].q[0] for place in robot.motors] or [0]),
        motor_circles=listed([int(parts[place].kind == "unbounded") for place in robot.motors] or [0]),
        motor_speeds=listed([independent.get(place, -1) for place in robot.motors] or [0]),
    )
    functions = [flow] if model is None else [flow, replace(model, name="model_forces")]
    by_model = "" if model is None else _by_model(robot, model, defaults, real, suffix)
    block = fill("run_block.in", suffix=suffix, real=real, width=width, model=by_model)
    return lanes_source(functions, shared + block, calls=False)


def _by_model(
    robot: Robot, model: Function, defaults: Mapping[str, list[float]], real: str, suffix: str
) -> str:
    at = robot.tree.nq + len(robot.independent) + len(robot.motors)
    lines = []
    for name in list(model.inputs)[3:]:
        for value in defaults[name]:
            lines.append(f"        in[{at}] += {value!r};")
            at += 1
    text = _MODEL.replace("@inputs", str(max(1, at))).replace("@outputs", str(len(model.results)))
    return (
        text.replace("@defaults\n", "".join(f"{line}\n" for line in lines))
        .replace("@real", real)
        .replace("@suffix", suffix)
    )
