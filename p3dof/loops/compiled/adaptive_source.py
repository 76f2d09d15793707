"""One run of any robot in time with adaptive steps, as C: DOP853 around the rates of a state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from p3dof._base import integrators
from p3dof.loops.compiled.formulas import Robot
from p3dof.loops.compiled.function import Function
from p3dof.loops.compiled.printing import fill, lanes_source, listed
from p3dof.loops.compiled.run_source import defaults_of, sizes_of

_MODEL = """\
    if (a->control >= PD_WITH_GRAVITY) {
        double in[@inputs] = {0}, out[@outputs];
        memcpy(in, y, sizeof(double) * NQ);
@defaults
        for (int i = 0; i < FREE && a->control == COMPUTED_TORQUE; ++i)
            in[NQ + i] = y[NQ + free_v[i]];
        for (int i = 0; i < MOTORS && a->control == COMPUTED_TORQUE; ++i)
            in[NQ + FREE + i] = wanted[i];
        model_forces_one(in, out);
        for (int i = 0; i < MOTORS; ++i)
            wanted[i] = a->control == COMPUTED_TORQUE ? out[i] : wanted[i] + out[i];
        a->doubtful |= !(out[MOTORS + 2] > 0.0);
    }
"""


def adaptive_source(
    robot: Robot,
    flow: Function,
    model: Function | None,
    defaults: Mapping[str, list[float]],
    limited: Sequence[tuple[int, int]],
) -> str:
    """Return C that follows a robot in time with adaptive steps.

    Parameters
    ----------
    robot : Robot
        The robot.
    flow : Function
        The rates of q and v, stabilised.
    model : Function, optional
        The forces of its controller's model.
    defaults : mapping of str to list of float
        Values of the model's inputs besides the motion.
    limited : sequence of (int, int)
        Places in q and in v of the joints that may have limits.

    Returns
    -------
    str
    """
    by_model = ""
    if model is not None:
        lines, size = defaults_of(robot, model, defaults)
        by_model = _MODEL.replace("@inputs", str(size)).replace("@outputs", str(len(model.results)))
        by_model = by_model.replace("@defaults\n", lines)
    text = fill(
        "adaptive.in",
        **sizes_of(robot, flow, list(flow.inputs.values())[3:-1]),
        motor_speeds=listed(list(robot.motors) or [0]),
        free_places=listed(list(robot.independent) or [0]),
        limits=len(limited),
        limit_q=listed([q for q, _ in limited] or [0]),
        limit_v=listed([v for _, v in limited] or [0]),
        model=by_model,
        dop853=integrators.text("dop853"),
        crossings=integrators.text("crossings"),
    )
    functions = [replace(flow, name="flow")]
    functions += [] if model is None else [replace(model, name="model_forces")]
    return lanes_source(functions, text, calls=False)
