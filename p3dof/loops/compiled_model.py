"""`CompiledModel`: a model whose many samples are computed by what is compiled for it, when asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import AssemblyError, P3dofError
from p3dof.loops.assembly import TOLERANCE
from p3dof.loops.batch.linear import BoolArray, IndexArray
from p3dof.loops.batch.results import (
    BatchEvidence,
    BatchForwardDynamics,
    BatchHybridDynamics,
    BatchInverseDynamics,
)
from p3dof.loops.batch.states import BatchStates
from p3dof.loops.batch_model import BatchTarget
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.settling import Settler
from p3dof.loops.compiling_model import ENOUGH, CompilingModel, Method
from p3dof.loops.coordinates import rounding
from p3dof.loops.hybrid_model import acting_rows
from p3dof.loops.loop_model import External
from p3dof.loops.prescriptions import ByName

_Found = tuple[dict[str, FloatArray], BoolArray]


class CompiledModel(CompilingModel):
    """Many samples of any robot, by its compiled dynamics on request.

    Each method takes a `method`: ``"general"``, the robot's own; ``"compiled"``, C that is compiled for it
    when it is first asked for, and kept while the robot stays as it is; or what `compile` returned. Samples
    that the compiled dynamics does not trust are the robot's own, with the same results and errors.
    """

    def inverse_dynamics_batch(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stop: bool = False,
        method: Method = "general",
    ) -> BatchInverseDynamics:
        """Return the actuator forces at many samples; `method` as of `CompiledModel`, all else as of it.

        See `BatchModel.inverse_dynamics_batch`.
        """
        given = q, v, a, external, joint_forces
        states = self._states(q, v, a)
        loads, forces = acting_rows(external, joint_forces, len(states[0]), self.model.nv)
        done = self._rows_by(
            method,
            "checked_inverse_dynamics",
            dict(zip("qva", states, strict=True)),
            loads,
            None if joint_forces is None else forces,
        )
        if done is None:
            return super().inverse_dynamics_batch(*given, stop)
        found, good = done
        core, at = self._core(states[0])
        evidence = BatchEvidence(
            np.full(len(at), np.nan), lambda some: core._batch_dynamics.conditioning(at[some])
        )
        residual = found["residual"][:, 0]
        result = BatchInverseDynamics(found["tau"], residual, found["closure_error"], {}, evidence)

        def rest(some: IndexArray) -> Any:
            acting = {name: wrench[some] for name, wrench in loads.items()}
            own = super(CompiledModel, self).inverse_dynamics_batch
            return own(states[0][some], states[1][some], states[2][some], acting, forces[some], stop)

        evidence.leave_open(_completed(result, good, rest, stop))
        return result

    def forward_dynamics_batch(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stop: bool = False,
        method: Method = "general",
    ) -> BatchForwardDynamics:
        """Return the accelerations at many samples; `method` as of `CompiledModel`, all else as of it.

        See `BatchModel.forward_dynamics_batch`.
        """
        given = q, v, tau, external, joint_forces
        q, v, _ = self._states(q, v, v)
        tau = frozen_array("tau", tau, (len(q), len(self.actuated)))
        loads, forces = acting_rows(external, joint_forces, len(q), self.model.nv)
        done = self._rows_by(
            method,
            "checked_forward_dynamics",
            {"q": q, "v": v, "tau": tau},
            loads,
            None if joint_forces is None else forces,
        )
        if done is None:
            return super().forward_dynamics_batch(*given, stop)
        found, good = done
        result = BatchForwardDynamics(
            found["a"],
            found["residual"][:, 0],
            found["closure_residual"][:, 0],
            found["closure_error"],
            {},
        )

        def rest(some: IndexArray) -> Any:
            acting = {name: wrench[some] for name, wrench in loads.items()}
            state = q[some], v[some], tau[some]
            return super(CompiledModel, self).forward_dynamics_batch(*state, acting, forces[some], stop)

        _completed(result, good, rest, stop)
        return result

    def hybrid_dynamics_batch(
        self,
        q: ArrayLike,
        v: ArrayLike,
        prescribed: ArrayLike | ByName | None = None,
        frames: ByName | None = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stop: bool = False,
        method: Method = "general",
    ) -> BatchHybridDynamics:
        """Return forces and motions at many samples; `method` as of `CompiledModel`, all else as of it.

        Compiled are accelerations of the actuated joints, where none of them follows from the others; other
        prescriptions are the robot's own. See `HybridModel.hybrid_dynamics_batch`.
        """
        given = q, v, prescribed, frames, external, joint_forces
        done = None
        if prescribed is not None and not isinstance(prescribed, Mapping) and not frames:
            q_, v_, _ = self._states(q, v, v)
            wanted = frozen_array("prescribed", prescribed, (len(q_), len(self.actuated)))
            loads, forces = acting_rows(external, joint_forces, len(q_), self.model.nv)
            done = self._rows_by(
                method,
                "checked_hybrid_dynamics",
                {"q": q_, "v": v_, "a_actuated": wanted},
                loads,
                None if joint_forces is None else forces,
            )
        if done is None:
            return super().hybrid_dynamics_batch(*given, stop)
        found, good = done
        core, at = self._core(q_)
        evidence = BatchEvidence(
            np.full(len(at), np.nan), lambda some: core._batch_dynamics.conditioning(at[some])
        )
        result = BatchHybridDynamics(
            found["tau"], found["a"], found["residual"][:, 0], found["closure_error"], {}, evidence
        )

        def rest(some: IndexArray) -> Any:
            acting = {name: wrench[some] for name, wrench in loads.items()}
            state = q_[some], v_[some], wanted[some]
            own = super(CompiledModel, self).hybrid_dynamics_batch
            return own(*state, None, acting, forces[some], stop)

        evidence.leave_open(_completed(result, good, rest, stop))
        return result

    def complete_batch(
        self,
        target: BatchTarget | Sequence[BatchTarget],
        velocity: ArrayLike,
        acceleration: ArrayLike,
        guess: ArrayLike | None = None,
        near: ArrayLike | None = None,
        stop: bool = False,
        method: Method = "general",
    ) -> BatchStates:
        """Find the motion of the whole tree at many samples; `method` as of `CompiledModel`, else as of it.

        Compiled are values of the actuated joints, where these determine the motion; other targets are the
        robot's own. See `BatchModel.complete_batch`.
        """
        given = target, velocity, acceleration, guess, near
        single = not isinstance(target, Mapping) and _is_array(target)
        if not single or (isinstance(method, str) and method == "general"):
            self._compiled_by(method, np.zeros((0, self.model.nq)), (), False)
            return super().complete_batch(*given, stop)
        values = frozen_array("target", target, ("N", len(self.actuated)))
        rates = [
            frozen_array(name, rate, values.shape)
            for name, rate in (("velocity", velocity), ("acceleration", acceleration))
        ]
        try:
            start = np.array(self.assemble(None, guess=guess).q)
        except AssemblyError:
            return super().complete_batch(*given, stop)
        compiled = self._compiled_by(method, start[None], (), False)
        if compiled is None or not compiled.determined or not len(values):
            return super().complete_batch(*given, stop)
        result, good = _settled(compiled, start, values, rates, list(self.actuated_v))

        def rest(some: IndexArray) -> Any:
            known = np.flatnonzero(good)
            first = near if not len(known) else result.q[known[np.abs(known - some[0]).argmin()]]
            parts = values[some], rates[0][some], rates[1][some]
            return super(CompiledModel, self).complete_batch(*parts, guess, first, stop)

        _completed(result, good, rest, stop)
        return result

    def _rows_by(
        self,
        method: Method,
        name: str,
        inputs: dict[str, FloatArray],
        loads: Mapping[str, FloatArray],
        joint_forces: FloatArray | None,
    ) -> _Found | None:
        """Return what is compiled at many samples, and where it is good; None for the robot's own ways."""
        q, frames, several = inputs["q"], tuple(loads), joint_forces is not None
        compiled = self._compiled_by(method, q, frames, several)
        if compiled is None or (name == "checked_hybrid_dynamics" and not compiled.hybrid):
            return None
        given = inputs | {f"wrench_{frame}": wrench for frame, wrench in loads.items()}
        if joint_forces is not None:
            given["joint_forces"] = joint_forces
        found = compiled.rows(name, given)
        usual = float(np.median(found["margin"]))
        if isinstance(method, str) and not usual > ENOUGH:
            middle = int(np.argsort(found["margin"][:, 0])[len(q) // 2])
            if found["gap"][middle, 0] <= TOLERANCE * 1e3:
                better = self.compiled_for(q[middle], frames, several)
                found = found if better is compiled else better.rows(name, given)
        return found, found["trusted"][:, 0] > 0.0

    def _core(self, q: FloatArray) -> tuple[CompiledModel, FloatArray]:
        """Return the model in its own unit of length, and configurations in it."""
        return (self, q) if self._scaled is None else (self._scaled.core, self._scaled.q(q))


def _is_array(target: Any) -> bool:
    """Whether a target is values of the actuated joints, and none of several parts."""
    try:
        return np.asarray(target).dtype.kind in "fiub"
    except ValueError:
        return False


def _settled(
    compiled: CompiledLoop,
    start: FloatArray,
    values: FloatArray,
    rates: Sequence[FloatArray],
    actuated: list[int],
) -> tuple[BatchStates, BoolArray]:
    """Return the motion of the tree at values of the actuated joints, and where it is good."""
    settler = Settler(compiled)
    q, good = settler(start, values)
    moving = {
        "q": q,
        "v_independent": rates[0][:, settler.order],
        "a_independent": rates[1][:, settler.order],
    }
    found = compiled.rows("completion", moving)
    shape = len(q), found["v"].shape[1], len(settler.order)
    influence: FloatArray = np.empty(shape)
    influence[:, :, settler.order] = found["influence"].reshape(shape)
    gaps = np.abs(found["closure_error"]).max(axis=1, initial=0.0)
    good &= (found["trusted"][:, 0] > 0.0) & (gaps <= np.maximum(TOLERANCE * compiled.length, rounding(q)))
    return BatchStates(q, found["v"], found["a"], influence, actuated, np.array(good), {}), good


def _completed(result: Any, good: BoolArray, rest: Any, stop: bool) -> IndexArray:
    """Enter the samples that are not good by the robot's own ways; return which did not fail."""
    some = np.flatnonzero(~good)
    failed: dict[int, P3dofError] = {}
    arrays = [name for name, value in vars(result).items() if isinstance(value, np.ndarray)]
    if len(some):
        found = rest(some)
        for name in arrays:
            getattr(result, name)[some] = getattr(found, name)
        failed = {int(some[i]): error for i, error in found.errors.items()}
        result.errors.update(failed)
    if stop and failed:
        for name in arrays:
            array = getattr(result, name)
            array[min(failed) :] = False if array.dtype == bool else np.nan
    left = len(good) if not (stop and failed) else min(failed)
    return np.setdiff1d(np.arange(left), sorted(failed))
