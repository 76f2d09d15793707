"""`AdaptiveRun`: one run of a robot in time with adaptive steps of order 8, in C.

It takes the steps of `scipy.integrate.DOP853` on the states of `p3dof.runs.plants.ConstrainedPlant`,
whose loops are stabilised; limits are found on its dense output. What is not to be trusted ends it: others
decide.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops.compiled import build
from p3dof.loops.compiled.adaptive_source import adaptive_source
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.kernels import pointers, sizes
from p3dof.loops.compiled.runs import Limited

Other: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray | None]
"""State and forces of the motors to the derivative of the state; None if it has to be given up."""
_DOUBLES = ctypes.POINTER(ctypes.c_double)
_OTHER = ctypes.CFUNCTYPE(ctypes.c_int, _DOUBLES, _DOUBLES, _DOUBLES)


class _Adaptive(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_ssize_t) for name in ("begin", "edges", "row", "sample", "samples", "history")),
        ("evaluations", ctypes.c_ssize_t),
        *(
            (name, ctypes.c_int)
            for name in ("control", "continuous", "closing", "reason", "crawled", "doubtful")
        ),
        *((name, ctypes.c_double) for name in ("rtol", "atol", "longest", "next", "shortest")),
        *((name, ctypes.c_double) for name in ("span", "period", "end")),
        *((name, ctypes.c_void_p) for name in ("edge", "tick", "times", "lower", "upper", "given")),
        *((name, ctypes.c_void_p) for name in ("rows", "row_strides", "y", "asked", "past", "room", "found")),
        ("other", _OTHER),
    )


@dataclass(frozen=True, eq=False)
class Adaptation:
    """How a run is cut into parts and steps.

    Parameters
    ----------
    edges : (K + 1,) array
        When steps must end, the beginning first [s].
    tick : (K,) array of uint8
        At which of them the controller acts.
    times : (S,) array
        Of the samples [s].
    period : float
        How long forces are held [s]; zero for always.
    rtol, atol, longest, shortest : float
        Tolerances, longest step, and one that leads nowhere.
    """

    edges: FloatArray
    tick: NDArray[np.uint8]
    times: FloatArray
    period: float
    rtol: float
    atol: float
    longest: float
    shortest: float


class CompiledAdaptation:
    """What follows one robot with adaptive steps, compiled.

    Parameters
    ----------
    compiled : CompiledLoop
        The robot.
    model : CompiledLoop, optional
        The model of its controller, with the same independent coordinates.
    """

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
    """One run that waits, or goes on from tick to tick.

    Parameters
    ----------
    made : CompiledAdaptation
        The robot.
    how : Adaptation
        Its parts and steps.
    state : (nq + nv,) array
        Where it starts; the array holds the state from then on.
    given : mapping of str to array
        ``kp``, ``kd``, ``most``, ``forces`` (n,), ``stabilisation``, and what else acts.
    rows : three (ticks, n) arrays
        As of `CompiledRuns.prepare`.
    limited : Limited
        Where it ends.
    control : int
        What gives the forces.
    continuous : bool
        Whether these change with the state all the time.
    other : callable, optional
        What decides at states where the compiled dynamics is not to be trusted; without it they end the run.
    """

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
        self._run: Any = _Adaptive(
            *(0, len(how.tick), 0, 0, len(how.times), count, 0),
            *(control, continuous, 1, 0, 0, 0),
            *(how.rtol, how.atol, how.longest, 0.0, how.shortest, float(how.edges[-1]), how.period, 0.0),
            *(array.ctypes.data for array in arrays),
            *(inputs, targets, strides, self.state.ctypes.data, room[0].ctypes.data, past),
            *(room[1].ctypes.data, room[2].ctypes.data),
            _OTHER(0) if other is None else _called(other, nq + nv, n),
        )
        self._kept = tables, arrays, room, lists
        self._call = made.library.adaptive
        self._call.argtypes, self._call.restype = [ctypes.c_void_p], ctypes.c_int

    def advance(self, begin: int, edges: int, closing: bool, row: int) -> int:
        """Go on by some parts, from an edge on, the tick there being that of a row.

        Closing is whether a sample at the end belongs to them.

        Returns
        -------
        int
            Why it ended: zero if it did not, -1 if others have to decide, else one more than the place among
            the limits that are counted, the lower ones first.
        """
        run = self._run
        run.begin, run.edges, run.closing, run.row = begin, edges, closing, row
        reason = int(self._call(ctypes.addressof(run)))
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
