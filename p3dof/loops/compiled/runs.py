"""`CompiledRuns`: runs of one robot in time, in C: one, or many side by side in vector lanes and threads.

The classical Runge-Kutta method of order 4 takes steps that are given. A state is the configuration and the
independent speeds; the others follow from these at every evaluation, and each step begins with one of
Newton's method, so that loops stay closed to rounding. A run ends where a joint reaches a limit, at the first
zero of the cubic between two steps; and where its accelerations are not to be trusted: the robot itself has
to decide.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError
from p3dof._base.threads import in_threads, shares
from p3dof.loops.compiled import build
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.formulas import Robot
from p3dof.loops.compiled.function import Function, pointers, sizes
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
    """Return C that follows a robot in time."""
    independent = {place: i for i, place in enumerate(robot.independent)}
    real, width = KINDS[suffix]
    speeds = listed([independent.get(place, -1) for place in robot.motors] or [0])
    shared = fill("runs.in", motor_speeds=speeds, **sizes_of(robot, flow, list(flow.inputs.values())[3:]))
    functions = [flow] if model is None else [flow, replace(model, name="model_forces")]
    by_model = "" if model is None else _by_model(robot, model, defaults, real, suffix)
    block = fill("run_block.in", suffix=suffix, real=real, width=width, model=by_model)
    return lanes_source(functions, shared + block, calls=False)


def sizes_of(robot: Robot, flow: Function, loads: list[int]) -> dict[str, object]:
    """Return what the text of runs has of a robot's sizes and motors."""
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


CONSTANT, PD, PD_WITH_GRAVITY, COMPUTED_TORQUE = range(4)
"""What gives the forces of the motors."""
DOUBTFUL = -1  # reason of a run's end: its accelerations are not to be trusted

Indices = NDArray[np.intp]


class StepPlan(NamedTuple):
    """The steps of runs, and what happens at them."""

    time: FloatArray  # (K + 1,): beginnings of the steps, and the end [s]
    tick: NDArray[np.uint8]  # (K,): whether the controller acts at the beginning of a step
    sample_step: Indices  # (S,): in which step each sample is
    sample_share: FloatArray  # (S,): at which share of it; zero at its beginning


@dataclass(frozen=True, eq=False)
class Limited:
    """Limits of joints."""

    q: NDArray[np.int32]  # (L,): their places
    lower: FloatArray  # (L,): what they stay between
    upper: FloatArray


@dataclass(frozen=True, eq=False)
class RunsFound:
    """What is left of N runs."""

    reason: NDArray[np.intc]
    """(N,): zero if it went on to its end; `DOUBTFUL`; one more than the limit that was reached, the lower
    ones first."""
    time: FloatArray  # (N,): when it ended [s]
    q: FloatArray  # (N, nq): the state then
    v: FloatArray
    peak_force: FloatArray  # (N, n): largest forces of the motors, and the sum of their squares over ticks
    square_force: FloatArray
    peak_error: FloatArray  # (N, n): the same of the differences from their targets
    square_error: FloatArray
    gap: FloatArray
    """(N,): largest length of the vector of all errors of the loops before a step of Newton's method [m,
    rad]."""
    margin: FloatArray  # (N,): smallest margin of the partition
    samples: Indices  # (N,): how many there are of each run
    past: Mapping[str, FloatArray]
    """(N, S, size): `q`, `v`, `a`, `forces`, `asked` at the samples; empty if they were not asked for."""


class _Runs(ctypes.Structure):
    _fields_ = (
        *(
            (name, ctypes.c_ssize_t)
            for name in ("begin", "steps", "row", "sample", "samples", "limits", "history")
        ),
        *((name, ctypes.c_int) for name in ("control", "errors", "closing")),
        *(
            (name, ctypes.c_void_p)
            for name in (
                *("time", "tick", "sample_step", "sample_share", "limited", "lower", "upper"),
                *("given", "strides", "rows", "row_strides", "run_strides", "out", "past", "taken", "reason"),
            )
        ),
    )


class CompiledRuns:
    """Runs of one robot, compiled."""

    def __init__(self, compiled: CompiledLoop, model: CompiledLoop | None = None) -> None:
        if compiled.level == "numpy":
            raise ModelError("runs in C need a C compiler")
        if model is not None and model.independent != compiled.independent:
            raise ModelError("the controller's model has other independent coordinates")
        self.compiled, self._model = compiled, model
        self.flow = compiled.function("flow")  # the rates of a state
        self._libraries: dict[str, ctypes.CDLL] = {}

    def prepare(
        self,
        plan: StepPlan,
        given: Mapping[str, FloatArray],
        rows: Sequence[FloatArray] = (),
        limited: Limited | None = None,
        control: int = CONSTANT,
        history: int = 0,
    ) -> PreparedRuns:
        """Return N runs that wait."""
        motors = self.flow.inputs["tau"]
        usual = {**dict.fromkeys(("kp", "kd", "forces"), np.zeros(motors)), "most": np.full(motors, np.inf)}
        names = ["q", "v", "kp", "kd", "most", "forces", *list(self.flow.inputs)[3:]]
        known = {**usual, **self.compiled.defaults, **given}
        suffix = "_one" if len(given["q"]) == 1 else "_lanes"
        prepared = PreparedRuns(self.library(suffix), suffix, self.flow, [known[name] for name in names])
        limits = limited or Limited(np.zeros(0, dtype=np.int32), np.zeros(0), np.zeros(0))
        prepared.fill(plan, rows, limits, control, history)
        return prepared

    def library(self, suffix: str) -> ctypes.CDLL:
        """Return C for runs one by one or side by side; see `KINDS`."""
        if suffix not in self._libraries:
            model = None if self._model is None else self._model.function("model_forces")
            defaults = {} if self._model is None else self._model.defaults
            texts = {name: values.tolist() for name, values in defaults.items()}
            source = runs_source(self.compiled.robot, self.flow, model, texts, suffix)
            (self._libraries[suffix],) = build.libraries([source], self.compiled.level)
        return self._libraries[suffix]


class PreparedRuns:
    """N runs with all that they read and write."""

    def __init__(
        self, library: ctypes.CDLL, suffix: str, flow: Function, parts: Sequence[FloatArray]
    ) -> None:
        self._call = getattr(library, f"runs{suffix}")
        self._call.argtypes, self._call.restype = [ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_ssize_t], None
        self._width = 1 if suffix == "_one" else int(library.width())
        self._flow = flow
        self.parts = [np.ascontiguousarray(part) for part in parts]
        """Inputs: q, independent v, kp, kd, largest forces, forces, and what else acts."""
        self.count = len(self.parts[0])
        self._runs, self._kept = _Runs(), list[Any]()

    def fill(
        self, plan: StepPlan, rows: Sequence[FloatArray], limits: Limited, control: int, history: int
    ) -> None:
        """Say what they do; see `CompiledRuns.prepare`."""
        count, motors = self.count, self._flow.inputs["tau"]
        nq, nv = self._flow.inputs["q"], self._flow.outputs["v"]
        tables = [np.ascontiguousarray(table) for table in rows] or [np.zeros((1, motors))] * 3
        sizes_of = nq, nv, motors, motors, motors, motors
        ends = [np.zeros((count, size)) for size in sizes_of]
        self.out = [np.zeros(count), *ends, np.zeros(count), np.zeros(count)]
        self.past = [np.full((count, history, size), np.nan) for size in (nq, nv, nv, motors, motors)]
        self.taken, self.reason = np.zeros(count, dtype=np.intp), np.zeros(count, dtype=np.intc)
        arrays = [np.ascontiguousarray(x) for x in (*plan, limits.q, limits.lower, limits.upper)]
        lists = [
            pointers([part.ctypes.data for part in self.parts]),
            sizes([part.shape[1] if part.ndim == 2 else 0 for part in self.parts]),
            pointers([table.ctypes.data for table in tables]),
            sizes([motors if table.shape[-2] > 1 else 0 for table in tables]),
            sizes([motors * table.shape[1] if table.ndim == 3 else 0 for table in tables]),
            pointers([array.ctypes.data for array in self.out]),
            pointers([array.ctypes.data for array in self.past]),
        ]
        numbers = 0, len(plan.time) - 1, 0, 0, len(plan.sample_step), len(limits.q), history
        places = [array.ctypes.data for array in arrays] + [ctypes.addressof(one) for one in lists]
        ends_at = self.taken.ctypes.data, self.reason.ctypes.data
        self._runs = _Runs(*numbers, control, bool(rows), 1, *places, *ends_at)
        self._kept = [tables, arrays, lists]

    def run(self, threads: int = 1) -> RunsFound:
        """Make the runs, and return what is left of them."""
        place, width = ctypes.addressof(self._runs), self._width
        blocks = -(-self.count // width)

        def do(part: tuple[int, int]) -> None:
            for block in range(*part):
                self._call(place, block * width, min(width, self.count - block * width))

        in_threads(do, shares(blocks, threads))
        return self.found()

    def advance(self, begin: int, steps: int, closing: bool, row: int) -> int:
        """Take some steps of one run, from a tick on, which is that of a row; return the reason of its end.

        Closing is whether a sample at the end belongs to them.
        """
        runs = self._runs
        runs.begin, runs.steps, runs.closing, runs.row = begin, steps, closing, row
        runs.sample = int(self.taken[0])
        self._call(ctypes.addressof(runs), 0, 1)
        return int(self.reason[0])

    def found(self) -> RunsFound:
        """Return what is left of the runs."""
        names = ("q", "v", "a", "forces", "asked")
        past = dict(zip(names, self.past, strict=True)) if self.past[0].shape[1] else {}
        time, q, v, f, ff, e, ee, gap, margin = self.out
        return RunsFound(self.reason, time, q, v, f, ff, e, ee, gap, margin, self.taken, past)
