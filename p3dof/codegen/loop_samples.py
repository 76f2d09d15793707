"""Samples for the self-test of a robot's C, with results of the general layer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import P3dofError
from p3dof.codegen.filling import fill
from p3dof.codegen.selftest import number_table as _numbers
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiled.function import Function
from p3dof.loops.compiled.limits import EVIDENCE
from p3dof.loops.compiled.robot import closed_configurations

_COUNT = 8
_INDENT = " " * 4
_RATE, _SWING, _SAMPLES = 1000.0, 0.02, 100
"""Of the motion that is followed: samples a second, amplitude [m or rad], number."""
_TOLERANCE = 1e-9
"""Largest error, of the largest entry of a result."""


@dataclass(frozen=True, eq=False)
class _State:
    """A motion of the tree that keeps the loops closed, with its forces."""

    q: FloatArray
    v: FloatArray
    a: FloatArray
    tau: FloatArray


def selftest(
    robot: ClosedLoopModel,
    compiled: CompiledLoop,
    prefix: str,
    functions: Sequence[Function],
    follows: bool,
) -> dict[str, str]:
    """Return what the template of the self-test is filled with.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot.
    compiled : CompiledLoop
        Its functions.
    prefix : str
        What all names begin with.
    functions : sequence of Function
        Those that are tested; tangents and steps are compared with themselves in Python only.
    follows : bool
        Whether a motion is followed.

    Returns
    -------
    dict of str to str
        Text by placeholder.
    """
    states = _states(robot, compiled)
    tables, runs, rows = [], [], []
    for function in functions:
        given, expected, sizes = _table(robot, compiled, function, states)
        tables += [
            _numbers(f"in_{function.name}[{len(given)}][{given.shape[1]}]", given),
            _numbers(f"out_{function.name}[{len(given)}][{expected.shape[1]}]", expected),
        ]
        runs.append(_run(prefix, function))
        groups = ", ".join(map(str, [*sizes, *[0] * (6 - len(sizes))]))
        rows.append(
            f'{_INDENT}{{"{function.name}", run_{function.name}, in_{function.name}[0], '
            f"out_{function.name}[0], {given.shape[1]}, {expected.shape[1]}, {len(function.results)}, "
            f"{{{groups}}}}},"
        )
    return {
        "prefix": prefix,
        "PREFIX": prefix.upper(),
        "count": str(len(states)),
        "functions": str(len(functions)),
        "inputs": str(max(len(function.symbols) for function in functions)),
        "results": str(max(len(function.results) for function in functions)),
        "tolerance": repr(_TOLERANCE),
        "tables": "\n\n".join(tables),
        "runs": "\n".join(runs),
        "rows": "\n".join(rows),
        "follow": _follow(robot, prefix, functions) if follows else "",
        "follows": str(int(follows)),
    }


def _states(robot: ClosedLoopModel, compiled: CompiledLoop) -> list[_State]:
    """Return motions that keep the loops closed, always the same."""
    draw, found = np.random.default_rng(1), []
    start = np.array(robot.assemble().q)
    for q in closed_configurations(robot, start, seed=1)[:_COUNT]:
        J = robot.closure_jacobian(q)
        free = np.linalg.svd(J)[2][robot.rank(q) :].T if J.size else np.eye(robot.model.nv)
        v = free @ draw.normal(size=free.shape[1])
        a_actuated = draw.normal(size=len(robot.actuated))
        try:
            if compiled.determined or not compiled.hybrid:
                wanted = free @ draw.normal(size=free.shape[1])
                a = robot.forward_dynamics(q, v, np.zeros(len(robot.actuated))).a + wanted
                found.append(_State(q, v, a, robot.inverse_dynamics(q, v, a).tau))
            else:
                done = robot.hybrid_dynamics(q, v, a_actuated)
                found.append(_State(q, v, np.array(done.a), np.array(done.tau)))
        except P3dofError:
            continue  # a singular configuration is no sample
    return found


def _table(
    robot: ClosedLoopModel, compiled: CompiledLoop, function: Function, states: Sequence[_State]
) -> tuple[FloatArray, FloatArray, list[int]]:
    """Return inputs and expected outputs of a function, and the sizes of their groups.

    What the general layer has is taken from there; the rest from the traced function in Python.
    """
    free = np.array(compiled.independent_places, dtype=int)
    known: dict[str, Callable[[_State], FloatArray]] = {
        "q": lambda s: s.q,
        "v": lambda s: s.v,
        "a": lambda s: s.a,
        "tau": lambda s: s.tau,
        "a_actuated": lambda s: s.a[robot.actuated_v],
        "v_independent": lambda s: s.v[free],
        "a_independent": lambda s: s.a[free],
    }
    given, expected = [], []
    results = [name for name in function.outputs if name not in EVIDENCE]
    compared = [name for name in results if name in ("tau", "v", "a")]
    by_python = not compared or function.name.startswith("tangent")
    sizes = [function.outputs[name] for name in (results if by_python else compared)]
    for number, state in enumerate(states):
        row = []
        for name, size in function.inputs.items():
            if name in known:
                row.append(known[name](state))
            elif name in compiled.defaults:
                row.append(compiled.defaults[name])
            else:  # a direction, or a small change
                row.append(1e-3 * np.cos(np.arange(size) + number))
        given.append(np.concatenate(row))
        if by_python:
            expected.append(np.array(function.on_arrays(*given[-1])[: sum(sizes)], dtype=float))
        else:
            expected.append(np.concatenate([known[name](state) for name in compared]))
    return np.array(given), np.array(expected), sizes


def _run(prefix: str, function: Function) -> str:
    """Return what calls a function from a row of numbers into another, perhaps with a NULL."""
    inputs, outputs, place = [], [], 0
    for size in function.inputs.values():
        inputs += [f"&in[{place}]"] * (size > 0)
        place += size
    place = 0
    for name, size in function.outputs.items():
        outputs += [f"&out[{place}]"] * (size > 0 and name not in EVIDENCE)
        place += size
    inputs[0] = "(missing == 1) ? NULL : in"
    outputs[-1] = f"(missing == 2) ? NULL : {outputs[-1]}"
    told = ["NULL"] if "margin" in function.outputs else []
    head = f"static {prefix}_status run_{function.name}(const double *in, double *out, int missing)"
    call = f",\n{2 * _INDENT}".join([*inputs, *outputs, *told])
    return f"{head}\n{{\n{_INDENT}return {prefix}_{function.name}(\n{2 * _INDENT}{call});\n}}\n"


def _follow(robot: ClosedLoopModel, prefix: str, functions: Sequence[Function]) -> str:
    """Return tables of a motion of the motors and the forces for it, and what tests them."""
    start = np.array(robot.assemble().q)
    home = np.array([_value(robot, start, name) for name in robot.actuated])
    time, phase = np.arange(_SAMPLES)[:, None] / _RATE, np.arange(len(home))
    w = 2 * np.pi * 2.0
    target = home + _SWING * (np.sin(w * time + phase) - np.sin(phase))
    rates = _SWING * w * np.cos(w * time + phase), -_SWING * w * w * np.sin(w * time + phase)
    states = robot.complete_batch(target, *rates)
    forces = robot.inverse_dynamics_batch(states.q, states.v, states.a).tau
    motion = next(function for function in functions if function.name == "motion")
    return fill(
        "loop_selftest_follow.in",
        prefix=prefix,
        PREFIX=prefix.upper(),
        start=_numbers(f"home[1][{len(start)}]", start[None]),
        tables="\n\n".join(
            _numbers(f"{name}[{_SAMPLES}][{len(home)}]", rows)
            for name, rows in zip(
                ("targets", "speeds", "accelerations", "torques"), (target, *rates, forces), strict=True
            )
        ),
        samples=str(_SAMPLES),
        motors=str(len(home)),
        dt=repr(1.0 / _RATE),
        tolerance=repr(_TOLERANCE),
        loads="".join("NULL, " for _ in list(motion.inputs)[3:]),
    )


def _value(robot: ClosedLoopModel, q: FloatArray, name: str) -> float:
    joint = robot.model.getJointId(name)
    at = robot.model.idx_qs[joint]
    return float(np.arctan2(q[at + 1], q[at]) if robot.model.nqs[joint] == 2 else q[at])
