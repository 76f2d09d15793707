"""By which method samples of a robot are computed, and what is compiled for it and kept while it stays."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops.closed_tree import CLOSED
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.loop_model import LoopModel

ENOUGH = 0.1  # margin from which on what was compiled around the reference configuration serves elsewhere
_KEPT = 8  # most compiled robots that are kept
Method: TypeAlias = Literal["general", "compiled"] | CompiledLoop
"""The robot's own ways, those compiled for it, or what was compiled before."""


class Kept:
    """What was compiled for one robot; made once, whoever asks meanwhile."""

    def __init__(self) -> None:
        self._all: list[CompiledLoop] = []
        self.lock = threading.RLock()

    def of_now(
        self, loop: LoopModel, frames: Iterable[str], joint_forces: bool, inertias: Iterable[str] = ()
    ) -> list[CompiledLoop]:
        """Return what is kept of the robot as it is, and forget what is not."""
        self._all = [one for one in self._all if one.is_of(loop)]
        needed = {f"wrench_{frame}" for frame in frames} | {f"inertia_{joint}" for joint in inertias}
        needed |= {"joint_forces"} if joint_forces else set()
        found = [one for one in self._all if needed <= set(one.defaults)]
        return sorted(found, key=lambda one: len(one.defaults))

    def keep(self, compiled: CompiledLoop) -> CompiledLoop:
        """Keep what was compiled last, and forget the oldest."""
        self._all = [compiled, *self._all][:_KEPT]
        return compiled


def _kept(loop: LoopModel) -> Kept:
    kept: Kept | None = loop._made.get("compiled")
    return kept or loop._made.setdefault("compiled", Kept())  # whoever else asks now


def compiled_for(
    loop: LoopModel,
    q: ArrayLike,
    external: Iterable[str] = (),
    joint_forces: bool = False,
    inertias: Iterable[str] = (),
) -> CompiledLoop:
    """Return what is trusted at a configuration, see `ClosedLoopModel.compiled_for`."""
    wanted, kept = (tuple(external), joint_forces, tuple(inertias)), _kept(loop)
    with kept.lock:
        best = max(kept.of_now(loop, *wanted), key=lambda one: one.margin(q), default=None)
        if best is not None and best.margin(q) > ENOUGH:
            return best
        if best is None:
            try:
                best = kept.keep(CompiledLoop(loop, None, *wanted))
            except AssemblyError:  # the reference configuration does not close
                return kept.keep(CompiledLoop(loop, q, *wanted))
            if best.margin(q) > ENOUGH:
                return best
        here = kept.keep(CompiledLoop(loop, q, *wanted))
        return max((best, here), key=lambda one: one.margin(q))


def chosen(
    loop: LoopModel, method: Method, q: FloatArray, frames: Sequence[str] = (), joint_forces: bool = False
) -> CompiledLoop | None:
    """Return what computes samples (N, nq) by a method; None for the robot's own ways."""
    compiled = method_of(loop, method, frames, joint_forces)
    if isinstance(compiled, CompiledLoop):
        return compiled
    if compiled is None or not len(q):
        return None
    kept = _kept(loop)
    with kept.lock:
        known = kept.of_now(loop, frames, joint_forces)
    if known:
        return known[0]
    gap = float(np.abs(loop.closure_error(q[0])).max(initial=0.0))
    return compiled_for(loop, q[0], frames, joint_forces) if gap <= CLOSED else None


Find: TypeAlias = Callable[[LoopModel, ArrayLike, Iterable[str]], CompiledLoop]

ROBOT_METHODS: dict[str, Find | None] = {"general": None, "compiled": compiled_for}
"""What can compute the motion of a robot, by name: what finds its compiled dynamics; None for the robot."""


def method_of(
    loop: LoopModel, method: Method, frames: Sequence[str] = (), joint_forces: bool = False
) -> CompiledLoop | Find | None:
    """Return what a method means: what was compiled, what compiles, or None for the robot's own ways."""
    if isinstance(method, CompiledLoop):
        require_fit(loop, method, frames)
        if joint_forces and "joint_forces" not in method.defaults:
            raise InputError(
                "method: it was compiled without forces in joints; see joint_forces= of "
                "ClosedLoopModel.compile"
            )
        return method
    if not isinstance(method, str) or method not in ROBOT_METHODS:
        raise InputError(
            f"method: expected {', '.join(map(repr, ROBOT_METHODS))} or what ClosedLoopModel.compile "
            f"returns, got {shown(method)}"
        )
    return ROBOT_METHODS[method]


def require_fit(
    loop: LoopModel, compiled: CompiledLoop, frames: Sequence[str] = (), name: str = "method"
) -> None:
    """Raise unless this robot was compiled, as it is now, with wrenches on the frames."""
    if not isinstance(compiled, CompiledLoop):
        raise InputError(f"{name}: expected what ClosedLoopModel.compile returns, got {shown(compiled)}")
    if not compiled.is_of(loop):
        raise InputError(f"{name}: it was compiled for another robot, or for this one before it was changed")
    missing = [frame for frame in frames if frame not in compiled.external]
    if missing:
        raise InputError(
            f"{name}: it was compiled without wrenches on {', '.join(map(shown, missing))}; "
            "see external= of ClosedLoopModel.compile"
        )
