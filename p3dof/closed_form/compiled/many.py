"""Many runs at once in the extension: what its engine takes, as named arrays.

The layouts are those of `many.h` and `many_call.h` in the extension.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.kernels import _extension
from p3dof.closed_form.compiled.lanes import lane_kernel

_SIZES = {
    "place": len(lane_kernel("place").constants),
    "limits": len(lane_kernel("limits").constants),
    "motion": len(lane_kernel("motion_with_friction").constants),
    "load": 3,
    "bound": 4,
    "side": 1,
    "x": 6,
    **dict.fromkeys(("gain", "damping", "share", "base", "wanted", "rate", "cut", "count"), 3),
    "sigma": 2,
    "lag": 3,
}


def _slices(sizes: dict[str, int]) -> dict[str, slice]:
    ends = np.cumsum(list(sizes.values())).tolist()
    return {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}


INPUTS = _slices(_SIZES)  # where the numbers of a run are in a row of inputs

INPUT_WIDTH = sum(_SIZES.values())

RESULTS = _slices(
    {
        **dict.fromkeys(("stop", "time"), 1),
        **dict.fromkeys(("pose", "velocity", "peak_error", "rms_error", "peak_force", "rms_force"), 3),
        **dict.fromkeys(("work", "energy", "careful", "samples"), 1),
    }
)
"""Where the numbers of a run are in a row of results."""

RESULT_WIDTH, HISTORY_WIDTH = 24, 13

FINISHED, ACCURACY, CONTROLLER, START, NOWHERE = -1, 12, 13, 14, 15
"""Why a run ended, besides the twelve limits."""

FEEDBACK, TORQUE = 0, 1  # kinds of controllers

MOST_LATE, MOST_STEPS = 16, 4096  # most whole periods that forces may be late, and steps of a tick


@dataclass(frozen=True, eq=False)
class Engine:
    """What is the same for all runs: how they are cut into steps, the controller, what acts."""

    tick: float  # period of the controller, or of a step where there is none; how long runs are [s]
    end: float
    lengths: FloatArray  # (S,): of the steps of a tick [s]
    changes: NDArray[np.int64]
    """(S,): whether forces change at the beginning of a step; 2 at the tick itself where they are late by
    a part of a period."""
    near: float  # below which share of its length that a leg hangs down a run goes on carefully
    rtol: float  # of the integrator of such runs
    atol: float
    kind: int = FEEDBACK  # `FEEDBACK` or `TORQUE`
    flags: dict[str, bool] = field(default_factory=dict)
    """`noisy`, `counting`, `differencing`, `lagging`, `integrating`, `model_symmetric`, `continuous`."""
    whole: int = 0  # whole periods that forces are late
    every: int = 1  # a row of a history every so many ticks
    table: FloatArray | None = None  # (N, 9): what the controller follows, a row a tick
    model: tuple[FloatArray, ...] = ()
    """Constants of the controller's model, for `TORQUE`: assembly, torque, inverse."""
    reference: FloatArray | None = None  # (N + 1, 3): poses that errors are counted from
    loads: FloatArray | None = None  # (N, S, 3, 3): f_y, F_z, M_y at beginning, middle and end of each step

    @property
    def ticks(self) -> int:
        """How many ticks a run has."""
        return max(1, int(np.ceil(self.end / self.tick - 1e-9)))

    @property
    def rows(self) -> int:
        """How many rows a history has; one more than a whole run needs."""
        return -(-self.ticks // self.every) + 2

    def run(
        self,
        level: str,
        symmetric: bool,
        inputs: FloatArray,
        results: FloatArray,
        cancel: NDArray[np.int64],
        noise: FloatArray | None = None,
        history: FloatArray | None = None,
        wide: bool = True,
        friction: bool = False,
    ) -> None:
        """Run machines in time."""
        flags = [int(self.flags.get(name, False)) for name in _FLAGS]
        late = self.whole > 0 or bool((self.changes == 2).any())
        ring = self.whole + 2 if late else 1
        continuous = bool(self.flags.get("continuous", False))
        last = [int(continuous), int(friction), int(symmetric), self.ticks, self.every, self.rows]
        settings = np.array([self.kind, *flags, self.whole, ring, *last], dtype=np.int64)
        numbers = np.array([self.tick, self.end, self.near, self.rtol, self.atol])
        model = self.model or (None, None, None)
        compiled: Any = _extension()
        compiled.run_many(
            level, wide, settings, numbers, self.lengths, self.changes, cancel, inputs, results, self.table,
            *model, self.reference, self.loads, noise, history,
        )  # fmt: skip


_FLAGS = ("noisy", "counting", "differencing", "lagging", "integrating", "model_symmetric")


def empty_inputs(count: int) -> FloatArray:
    """Return rows of inputs that stand still under no force; ndarray, shape (count, INPUT_WIDTH)."""
    rows = np.zeros((count, INPUT_WIDTH))
    rows[:, INPUTS["bound"]] = [-np.inf, np.inf, -np.inf, np.inf]
    rows[:, INPUTS["cut"]] = np.inf
    rows[:, INPUTS["lag"]] = np.inf
    return rows


def set_machines(rows: FloatArray, model: tuple[Any, ...], symmetric: bool) -> FloatArray:
    """Write the constants of machines into rows of inputs, whose starts are set; return cos(θ + β) there.

    Its sign is the side of the singular pose; NaN out of reach.
    """
    count, place = len(rows), lane_kernel("place")
    lengths_and_bodies = model[: len(MODEL)]
    constants = place.columns(lengths_and_bodies, count)
    rows[:, INPUTS["place"]] = constants
    rows[:, INPUTS["limits"]] = lane_kernel("limits").columns(lengths_and_bodies, count)
    name = "motion" if len(model) == len(MODEL) else "motion_with_friction"
    motion = lane_kernel(name, symmetric).columns(model, count)
    start = INPUTS["motion"].start
    rows[:, start : start + motion.shape[1]] = motion
    with np.errstate(all="ignore"):
        found = place.on_arrays(*constants.T, *rows[:, INPUTS["x"]].T)
    return np.asarray(found[-1])
