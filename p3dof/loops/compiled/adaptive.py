"""`AdaptiveRun`: one run of a robot in time with adaptive steps of order 8, in C.

It takes the steps of `scipy.integrate.DOP853` on the states of `p3dof.runs.plants.ConstrainedPlant`,
whose loops are stabilised; limits are found on its dense output. What is not to be trusted ends it: others
decide.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base import integrators
from p3dof._base.checks import FloatArray
from p3dof.loops.compiled import build
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.formulas import Robot
from p3dof.loops.compiled.function import Function, pointers, sizes
from p3dof.loops.compiled.printing import fill, lanes_source, listed
from p3dof.loops.compiled.runs import Limited, defaults_of, sizes_of

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
    """Return C that follows a robot in time with adaptive steps."""
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


Other: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray | None]
"""State and forces of the motors to the derivative of the state; None if it has to be given up."""
_DOUBLES = ctypes.POINTER(ctypes.c_double)
_OTHER = ctypes.CFUNCTYPE(ctypes.c_int, _DOUBLES, _DOUBLES, _DOUBLES)
_LOOK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_ssize_t)


class _Adaptive(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_ssize_t) for name in ("begin", "edges", "row", "sample", "samples", "history")),
        ("evaluations", ctypes.c_ssize_t),
        *(
            (name, ctypes.c_int)
            for name in ("control", "continuous", "closing", "reason", "crawled", "doubtful")
        ),
        ("trials", ctypes.c_int * 2),
        *((name, ctypes.c_double) for name in ("rtol", "atol", "longest", "next", "shortest")),
        *((name, ctypes.c_double) for name in ("span", "period", "end")),
        *((name, ctypes.c_void_p) for name in ("edge", "tick", "times", "lower", "upper", "given")),
        *((name, ctypes.c_void_p) for name in ("rows", "row_strides", "y", "asked", "past", "room", "found")),
        ("other", _OTHER),
        ("look", _LOOK),
    )


@dataclass(frozen=True, eq=False)
class Adaptation:
    """How a run is cut into parts and steps."""

    edges: FloatArray  # (K + 1,): when steps must end, the beginning first [s]
    tick: NDArray[np.uint8]  # (K,): at which of them the controller acts
    times: FloatArray  # (S,): of the samples [s]
    period: float  # how long forces are held [s]; zero for always
    rtol: float  # tolerances, longest step, and one that leads nowhere
    atol: float
    longest: float
    shortest: float


class CompiledAdaptation:
    """What follows one robot with adaptive steps, compiled."""

    def __init__(self, compiled: CompiledLoop, model: CompiledLoop | None = None) -> None:
        flow = compiled.function("stabilised_flow")
        parts = compiled.robot.tree.parts[1:]
        self.limited = [(part.q[0], part.v[0]) for part in parts if len(part.q) == len(part.v) == 1]
        """Places in q and v of joints that may have limits."""
        defaults = {} if model is None else {name: x.tolist() for name, x in model.defaults.items()}
        forces = None if model is None else model.function("model_forces")
        source = adaptive_source(compiled.robot, flow, forces, defaults, self.limited)
        (self.library,) = build.libraries([source], compiled.level)
        self.compiled, self.flow = compiled, flow


class AdaptiveRun:
    """One run that waits, or goes on from tick to tick."""

    def __init__(
        self,
        made: CompiledAdaptation,
        how: Adaptation,
        state: FloatArray,
        given: Mapping[str, FloatArray],
        rows: Sequence[FloatArray],
        limited: Limited,
        control: int,
        continuous: bool,
        other: Other | None = None,
        look: Callable[[int], object] | None = None,
    ) -> None:
        flow, count = made.flow, len(how.times) + 1
        nq, nv, n = flow.inputs["q"], flow.inputs["v"], flow.inputs["tau"]
        usual = {**dict.fromkeys(("kp", "kd", "forces"), np.zeros(n)), "most": np.full(n, np.inf)}
        known = {**usual, **made.compiled.defaults, **given}
        names = ["kp", "kd", "most", "forces", *list(flow.inputs)[3:]]
        self.parts = [np.array(known[name], dtype=float) for name in names]
        """Inputs: gains, gains of speeds, largest forces, forces, and what else acts."""
        self.state = np.ascontiguousarray(state, dtype=float)
        self.past: list[FloatArray] = [np.full((count, size), np.nan) for size in (nq, nv, nv, n, n)]
        """Samples: q, v, a, forces, asked."""
        lower, upper = np.full(len(made.limited), -np.inf), np.full(len(made.limited), np.inf)
        places = [[q for q, _ in made.limited].index(int(at)) for at in limited.q]
        lower[places], upper[places] = limited.lower, limited.upper
        self._index = {k: i for i, k in enumerate(places)}
        self._limits, self._counted = len(made.limited), len(places)
        tables = [np.ascontiguousarray(table) for table in rows] or [np.zeros((1, n))] * 3
        arrays = [np.ascontiguousarray(x) for x in (how.edges, how.tick, how.times, lower, upper)]
        room = [np.zeros(n + 1), np.zeros(len(flow.symbols) + 1), np.zeros(len(flow.results) + 1)]
        lists = [
            pointers([part.ctypes.data for part in self.parts]),
            pointers([table.ctypes.data for table in tables]),
            sizes([n if len(table) > 1 else 0 for table in tables]),
            pointers([array.ctypes.data for array in self.past]),
        ]
        inputs, targets, strides, past = (ctypes.addressof(one) for one in lists)
        self._raised: list[BaseException] = []
        looks = _looks(look, self._raised)
        next(looks)
        self._run: Any = _Adaptive(
            *(0, len(how.tick), 0, 0, len(how.times), count, 0),
            *(control, continuous, 1, 0, 0, 0, (0, 0)),
            *(how.rtol, how.atol, how.longest, 0.0, how.shortest, float(how.edges[-1]), how.period, 0.0),
            *(array.ctypes.data for array in arrays),
            *(inputs, targets, strides, self.state.ctypes.data, room[0].ctypes.data, past),
            *(room[1].ctypes.data, room[2].ctypes.data),
            _OTHER(0) if other is None else _called(other, nq + nv, n),
            _LOOK(looks.send),
        )
        self._kept = tables, arrays, room, lists
        self._call = made.library.adaptive
        self._call.argtypes, self._call.restype = [ctypes.c_void_p], ctypes.c_int

    def advance(self, begin: int, edges: int, closing: bool, row: int) -> int:
        """Go on by some parts, from an edge on, the tick there being that of a row.

        Closing is whether a sample at the end belongs to them.

        Why it ended: zero if it did not, -1 if others have to decide, else one more than the place among the
        limits that are counted, the lower ones first.
        """
        run = self._run
        run.begin, run.edges, run.closing, run.row = begin, edges, closing, row
        reason = int(self._call(ctypes.addressof(run)))
        if self._raised:
            raise self._raised[0]
        if reason <= 0:
            return reason
        upper, at = divmod(reason - 1, self._limits)
        return 1 + self._index[at] + upper * self._counted

    @property
    def end(self) -> float:
        """Where it got to [s]."""
        return float(self._run.end)

    @property
    def taken(self) -> int:
        """How many samples there are."""
        return int(self._run.sample)

    @property
    def evaluations(self) -> int:
        """Of the equations of motion."""
        return int(self._run.evaluations)


def _looks(look: Callable[[int], object] | None, raised: list[BaseException]) -> Generator[int, int, None]:
    """Say to C whether to go on; a generator, for signals are raised where it waits, which `try` sees."""
    try:
        while True:
            samples = yield 1
            if look is not None:
                look(samples)
    except GeneratorExit:
        return
    except BaseException as error:
        raised.append(error)
        yield 0


def _called(other: Other, size: int, count: int) -> Any:
    """Return a function for C."""

    def call(y: Any, tau: Any, rate: Any) -> int:
        state = np.array(np.ctypeslib.as_array(y, (size,)))
        forces = np.array(np.ctypeslib.as_array(tau, (max(count, 1),)))[:count]
        try:
            found = other(state, forces)
        except Exception:
            return 0
        if found is None:
            return 0
        np.ctypeslib.as_array(rate, (size,))[:] = found
        return 1

    return _OTHER(call)
