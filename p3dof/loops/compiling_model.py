"""`CompilingModel`: a model that compiles its dynamics, and keeps that while it stays as it is."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Literal, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops.batch_model import BatchModel
from p3dof.loops.closed_tree import CLOSED
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.sidecar import Sidecar

ENOUGH = 0.1
"""Margin from which on what was compiled around the reference configuration serves elsewhere."""
_KEPT = 8
"""Most compiled robots that are kept."""


class CompilingModel(BatchModel):
    """A robot that compiles its dynamics."""

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        super().__init__(model, sidecar)
        self._kept: list[CompiledLoop] = []
        self._keeping = threading.RLock()  # compiled once, whoever asks meanwhile

    def compile(
        self,
        around: ArrayLike | None = None,
        external: Iterable[str] = (),
        joint_forces: bool = False,
        inertias: Iterable[str] = (),
        level: str = "auto",
        threads: int | None = None,
    ) -> CompiledLoop:
        """Return the dynamics of this robot compiled, 100 to 1000 times as fast; needs a C compiler.

        The robot is taken as it is now. Functions are compiled when they are first used, which takes seconds,
        and kept in a cache on the disk. Samples near configurations where the compiled partition of speeds
        fails are computed by this model instead.

        Parameters
        ----------
        around : (nq,) or (K, nq) array, optional
            Closed configurations that the partition is made for; by default around the reference
            configuration.
        external : iterable of str
            Frames on which external wrenches will act.
        joint_forces : bool
            Whether forces in all joints will be given.
        inertias : iterable of str
            Joints whose bodies will get their inertial parameters at each call, such as a payload.
        level : {"auto", "avx512", "avx2", "baseline", "numpy"}
            The instructions to use: those of this processor; of others; or NumPy, without a compiler.
        threads : int, optional
            Most threads for many samples; by default ``P3DOF_THREADS``, else all processors.

        Returns
        -------
        CompiledLoop

        Raises
        ------
        ModelError
            If a joint is of a kind that cannot be compiled.
        AssemblyError
            If the loops do not close at the reference configuration.
        InputError
            If an argument does not fit.
        """
        return CompiledLoop(self, around, external, joint_forces, inertias, level, threads)

    def compiled_for(
        self,
        q: ArrayLike,
        external: Iterable[str] = (),
        joint_forces: bool = False,
        inertias: Iterable[str] = (),
    ) -> CompiledLoop:
        """Return the dynamics compiled for a configuration: once, as long as the robot stays as it is.

        Parameters
        ----------
        q : (nq,) array
            Where it is to be trusted, with closed loops: what it is compiled around if the reference
            configuration would not do.
        external : iterable of str
            Frames on which wrenches will act.
        joint_forces : bool
            Whether forces in all joints will be given.
        inertias : iterable of str
            Joints whose bodies will get their inertial parameters.

        Returns
        -------
        CompiledLoop

        Raises
        ------
        ModelError
            If a joint is of a kind that cannot be compiled.
        InputError
            If an argument does not fit, or the loops are open.
        """
        wanted = tuple(external), joint_forces, tuple(inertias)
        with self._keeping:
            return self._compiled_for(q, wanted)

    def _compiled_for(
        self, q: ArrayLike, wanted: tuple[tuple[str, ...], bool, tuple[str, ...]]
    ) -> CompiledLoop:
        kept = self._of_now(*wanted)
        best = max(kept, key=lambda one: one.margin(q), default=None)
        if best is not None and best.margin(q) > ENOUGH:
            return best
        if best is None:
            try:
                best = self._keep(self.compile(None, *wanted))
            except AssemblyError:  # the reference configuration does not close
                return self._keep(self.compile(q, *wanted))
            if best.margin(q) > ENOUGH:
                return best
        here = self._keep(self.compile(q, *wanted))
        return max((best, here), key=lambda one: one.margin(q))

    def _of_now(
        self, frames: Sequence[str], joint_forces: bool, inertias: Sequence[str] = ()
    ) -> list[CompiledLoop]:
        """Return what is kept of the robot as it is, and forget what is not."""
        self._kept = [one for one in self._kept if one.is_of(self)]
        needed = {f"wrench_{frame}" for frame in frames} | {f"inertia_{joint}" for joint in inertias}
        needed |= {"joint_forces"} if joint_forces else set()
        found = [one for one in self._kept if needed <= set(one.defaults)]
        return sorted(found, key=lambda one: len(one.defaults))

    def _keep(self, compiled: CompiledLoop) -> CompiledLoop:
        self._kept = [compiled, *self._kept][:_KEPT]
        return compiled

    def _compiled_by(
        self, method: Method, q: FloatArray, frames: Sequence[str], joint_forces: bool
    ) -> CompiledLoop | None:
        """Return what computes samples (N, nq) by a method; None for the robot's own ways."""
        compiled = method_of(self, method, frames, joint_forces)
        if isinstance(compiled, CompiledLoop):
            return compiled
        if compiled is None or not len(q):
            return None
        with self._keeping:
            kept = self._of_now(frames, joint_forces)
        if kept:
            return kept[0]
        gap = float(np.abs(self.closure_error(q[0])).max(initial=0.0))
        return self.compiled_for(q[0], frames, joint_forces) if gap <= CLOSED else None


Method: TypeAlias = Literal["general", "compiled"] | CompiledLoop
"""The robot's own ways, those compiled for it, or what was compiled before."""
Find: TypeAlias = Callable[[CompilingModel, ArrayLike, Iterable[str]], CompiledLoop]

ROBOT_METHODS: dict[str, Find | None] = {"general": None, "compiled": CompilingModel.compiled_for}
"""What can compute the motion of a robot, by name: what finds its compiled dynamics; None for the robot."""


def method_of(
    loop: CompilingModel, method: Method, frames: Sequence[str] = (), joint_forces: bool = False
) -> CompiledLoop | Find | None:
    """Return what a method means: what was compiled, what compiles, or None for the robot's own ways.

    Raises
    ------
    InputError
        If there is no such method, or what is given was compiled for another robot or without what acts.
    """
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
    loop: CompilingModel, compiled: CompiledLoop, frames: Sequence[str] = (), name: str = "method"
) -> None:
    """Raise unless this robot was compiled, as it is now, with wrenches on the frames.

    Raises
    ------
    InputError
        With the name of the argument that does not fit.
    """
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
