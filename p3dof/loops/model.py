"""`ClosedLoopModel`: a robot with loops, one sample and many, by its own ways or compiled; and its files.

Many samples are checked first. What is compiled then takes those that it trusts; all others are the robot's
own, with the same results and errors.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Self

from p3dof._base.checks import FloatArray, as_floats, checked_array, frozen_array
from p3dof._base.errors import AssemblyError, InputError, P3dofError
from p3dof._base.files import together, write_atomic
from p3dof.loops.assembly import TOLERANCE
from p3dof.loops.batch.assembly import BatchStates, BatchTarget, targets_of
from p3dof.loops.batch.dynamics import (
    BatchEvidence,
    BatchForwardDynamics,
    BatchHybridDynamics,
    BatchInverseDynamics,
    Prescribed,
)
from p3dof.loops.closed_tree import Asked, External, Loads
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.following import Settler
from p3dof.loops.compiled.kept import ENOUGH, Method, chosen, compiled_for
from p3dof.loops.coordinates import rounding
from p3dof.loops.hybrid import ByName, by_joint, by_name, joint_freedoms, rates_of
from p3dof.loops.linear import BoolArray, IndexArray
from p3dof.loops.loop_model import LoopModel

if TYPE_CHECKING:  # what is imported when it is asked for
    from p3dof.loops.observer import MomentumObserver
    from p3dof.loops.online import RecursiveEstimator
    from p3dof.loops.transmission import Transmission


class _Acting(NamedTuple):
    """What acts at many samples."""

    wrenches: dict[str, FloatArray]  # by frame, (N, 6)
    forces: FloatArray  # (N, nv): in joints, besides the actuators
    given: bool  # whether anything is said of them

    def of(self, some: IndexArray) -> _Acting:
        """Return what acts at some of the samples."""
        wrenches = {name: wrench[some] for name, wrench in self.wrenches.items()}
        return _Acting(wrenches, self.forces[some], self.given)


class _Samples:
    """Configurations and rates of many samples; compiled functions look at their values themselves."""

    def __init__(
        self, loop: LoopModel, method: Method, state: Sequence[ArrayLike], more: Mapping[str, ArrayLike] = {}
    ) -> None:
        self._tree, self._state, self._more = loop._tree, state, more
        given: list[Any] = [*state, *more.values()]
        if (isinstance(method, str) and method == "general") or type(given[0]) is not np.ndarray:
            self.check()
            return
        nv, actuated = loop.model.nv, len(loop.actuated)
        widths = [loop.model.nq, *[nv] * (len(state) - 1), *[actuated] * len(more)]
        if all(_fits(array, (len(given[0]), width)) for array, width in zip(given, widths, strict=True)):
            self.arrays: list[FloatArray] = [given[0].copy(), *given[1:]]
        else:
            self.check()

    def check(self) -> None:
        """Refuse values that are not finite, too large or not normalised."""
        self.arrays = self._tree.states(*self._state, kept=False)
        shape = len(self.arrays[0]), len(self._tree.actuated)
        for name, array in self._more.items():
            self.arrays.append(checked_array(name, array, shape))


def _fits(array: Any, shape: tuple[int, int]) -> bool:
    return type(array) is np.ndarray and array.dtype == np.float64 and array.shape == shape


def _acting(loads: Loads, count: int, nv: int) -> _Acting:
    """Return loads as rows of many samples, after checking them."""
    external, joint_forces = loads
    if external is not None and not isinstance(external, Mapping):
        raise InputError(
            f"external: expected a mapping of frame names to wrenches, got {type(external).__name__}"
        )
    given = (external or {}).items()
    wrenches = {name: rows_of(f"external {name}", wrench, count, 6) for name, wrench in given}
    if joint_forces is None:
        return _Acting(wrenches, np.broadcast_to(0.0, (count, nv)), False)
    return _Acting(wrenches, rows_of("joint_forces", joint_forces, count, nv), True)


def complete(
    loop: LoopModel,
    target: BatchTarget | Sequence[BatchTarget],
    named: tuple[ArrayLike | ByName, ArrayLike | ByName],
    starts: tuple[ArrayLike | None, ArrayLike | None],
    stop: bool,
    method: Method,
) -> BatchStates:
    """`ClosedLoopModel.complete_batch`."""
    velocity, acceleration = named
    if isinstance(velocity, Mapping) or isinstance(acceleration, Mapping):
        velocity, acceleration = rates_of(target, named, loop.actuated)
    rates = velocity, acceleration
    if isinstance(method, str) and method == "general":
        return _own_complete(loop, target, rates, starts, stop)
    if isinstance(target, Mapping) or not _is_array(target):
        chosen(loop, method, np.zeros((0, loop.model.nq)))
        return _own_complete(loop, target, rates, starts, stop)
    values = frozen_array("target", target, ("N", len(loop.actuated)))
    v, a = (
        frozen_array(name, rate, values.shape)
        for name, rate in zip(("velocity", "acceleration"), rates, strict=True)
    )
    guess, near = starts
    try:
        start = np.array(loop.assemble(None, guess=guess).q)
    except AssemblyError:
        return _own_complete(loop, target, rates, starts, stop)
    compiled = chosen(loop, method, start[None])
    if compiled is None or not compiled.determined or not len(values):
        return _own_complete(loop, target, rates, starts, stop)
    result, good = _settled(compiled, start, values, (v, a), list(loop.actuated_v))

    def rest(some: IndexArray) -> BatchStates:
        known = np.flatnonzero(good)
        first = near if not len(known) else result.q[known[np.abs(known - some[0]).argmin()]]
        return _own_complete(loop, values[some], (v[some], a[some]), (guess, first), stop)

    _completed(result, good, rest, stop)
    return result


def _own_complete(
    loop: LoopModel,
    target: BatchTarget | Sequence[BatchTarget],
    rates: tuple[ArrayLike, ArrayLike],
    starts: tuple[ArrayLike | None, ArrayLike | None],
    stop: bool,
) -> BatchStates:
    """Complete by the robot's own ways."""
    robot, (guess, near) = loop._tree, starts
    count = len(np.atleast_1d(as_floats("velocity", rates[0])))
    goals = targets_of(target, robot.kinematics, robot.joints, count)
    shape = len(goals), len(goals.order)
    v, a = frozen_array("velocity", rates[0], shape), frozen_array("acceleration", rates[1], shape)
    start = None if guess is None else robot.configuration("guess", guess)
    first = None if near is None else robot.configuration("near", near)
    motion = v[:, goals.order], a[:, goals.order]
    found = loop._many.complete_batch(goals, motion, start, first, stop)
    return replace(found, influence=goals.given(found.influence))


def inverse_dynamics(
    loop: LoopModel, motion: tuple[ArrayLike, ArrayLike, ArrayLike], loads: Loads, stop: bool, method: Method
) -> BatchInverseDynamics:
    """`ClosedLoopModel.inverse_dynamics_batch`."""
    if isinstance(method, str) and method == "general":
        q, v, a = loop._tree.states(*motion, kept=False)
        return loop._many.inverse_dynamics_batch(q, v, a, *_acting(loads, *v.shape)[:2], stop)
    samples = _Samples(loop, method, motion)
    acting = _acting(loads, len(samples.arrays[0]), loop.model.nv)
    done = _rows_by(loop, method, "checked_inverse_dynamics", samples, ("q", "v", "a"), acting)
    q, v, a = samples.arrays
    if done is None:
        return loop._many.inverse_dynamics_batch(q, v, a, *acting[:2], stop)
    found, good = done
    evidence = _evidence(loop, q)
    result = BatchInverseDynamics(found["tau"], found["residual"][:, 0], found["closure_error"], {}, evidence)

    def rest(some: IndexArray) -> BatchInverseDynamics:
        return loop._many.inverse_dynamics_batch(q[some], v[some], a[some], *acting.of(some)[:2], stop)

    evidence.leave_open(_completed(result, good, rest, stop))
    return result


def forward_dynamics(
    loop: LoopModel,
    state: tuple[ArrayLike, ArrayLike],
    tau: ArrayLike | ByName,
    loads: Loads,
    stop: bool,
    method: Method,
) -> BatchForwardDynamics:
    """`ClosedLoopModel.forward_dynamics_batch`."""
    if isinstance(tau, Mapping):
        tau = by_joint("tau", tau, loop.actuated, 0.0)
    samples = _Samples(loop, method, state, {"tau": tau})
    acting = _acting(loads, len(samples.arrays[0]), loop.model.nv)
    done = _rows_by(loop, method, "checked_forward_dynamics", samples, ("q", "v", "tau"), acting)
    q, v, tau = samples.arrays
    if done is None:
        return _each_forward(loop, q, v, tau, acting, stop)
    found, good = done
    residual = found["residual"][:, 0], found["closure_residual"][:, 0]
    result = BatchForwardDynamics(found["a"], *residual, found["closure_error"], {})

    def rest(some: IndexArray) -> BatchForwardDynamics:
        return _each_forward(loop, q[some], v[some], tau[some], acting.of(some), stop)

    _completed(result, good, rest, stop)
    return result


def _each_forward(
    loop: LoopModel, q: FloatArray, v: FloatArray, tau: FloatArray, acting: _Acting, stop: bool
) -> BatchForwardDynamics:
    """Return the accelerations of many samples, one after the other."""
    a, gaps = np.full(v.shape, np.nan), np.full((len(q), loop._tree.kinematics.size), np.nan)
    residual, opening = np.full((2, len(q)), np.nan)
    result = BatchForwardDynamics(a, residual, opening, gaps, {})
    for i in range(len(q)):
        wrenches = {name: wrench[i] for name, wrench in acting.wrenches.items()}
        try:
            one = loop.forward_dynamics(q[i], v[i], tau[i], wrenches, acting.forces[i])
        except P3dofError as error:
            result.errors[i] = error
            if stop:
                break
        else:
            a[i], residual[i], opening[i] = one.a, one.residual, one.closure_residual
            gaps[i] = loop.closure_error(q[i])
    return result


def hybrid_dynamics(
    loop: LoopModel,
    state: tuple[ArrayLike, ArrayLike],
    asked: Asked,
    loads: Loads,
    stop: bool,
    method: Method,
) -> BatchHybridDynamics:
    """`ClosedLoopModel.hybrid_dynamics_batch`; accelerations of the actuated joints are compiled."""
    prescribed, frames = asked
    if prescribed is None or isinstance(prescribed, Mapping):
        joints, done = by_name("prescribed", prescribed or {}), None
        q, v = loop._tree.states(*state, kept=False)
        acting = _acting(loads, *v.shape)
    else:
        samples = _Samples(loop, "general" if frames else method, state, {"prescribed": prescribed})
        acting = _acting(loads, len(samples.arrays[0]), loop.model.nv)
        names = "q", "v", "a_actuated"
        done = None if frames else _rows_by(loop, method, "checked_hybrid_dynamics", samples, names, acting)
        q, v, wanted = samples.arrays
        joints = dict(zip(loop.actuated, wanted.T, strict=True))
    if done is None:
        chosen(loop, method, q[:0])  # there has to be such a method here too
        return _own_hybrid(loop, q, v, joints, by_name("frames", frames or {}), acting, stop)
    found, good = done
    evidence = _evidence(loop, q)
    result = BatchHybridDynamics(
        found["tau"], found["a"], found["residual"][:, 0], found["closure_error"], {}, evidence
    )

    def rest(some: IndexArray) -> BatchHybridDynamics:
        few = {name: value[some] for name, value in joints.items()}
        return _own_hybrid(loop, q[some], v[some], few, {}, acting.of(some), stop)

    evidence.leave_open(_completed(result, good, rest, stop))
    return result


def _own_hybrid(
    loop: LoopModel,
    q: FloatArray,
    v: FloatArray,
    prescribed: Mapping[str, FloatArray],
    frames: Mapping[str, FloatArray],
    acting: _Acting,
    stop: bool,
) -> BatchHybridDynamics:
    """Return forces and motions by the robot's own ways."""
    robot, count = loop._tree, len(q)
    freedoms = {name: list(joint_freedoms(robot.model, name)) for name in prescribed}
    joints = {name: _of_samples(name, prescribed[name], count, len(at)) for name, at in freedoms.items()}
    places = {name: np.broadcast_to(value, (count, *value.shape[-1:])) for name, value in frames.items()}
    forces = acting.forces + robot.passive.forces(q, v)
    at = np.array([k for part in freedoms.values() for k in part], dtype=int)
    values = np.concatenate([np.zeros((count, 0)), *joints.values()], axis=1)
    result = BatchHybridDynamics.empty(count, len(robot.actuated), v.shape[1], robot.kinematics.size)
    done: BoolArray = np.zeros(count, dtype=bool)
    asked = _prescribed_alike(at, values, places)
    if asked is not None:
        result, done = loop._many.hybrid_dynamics_batch(q, v, asked, acting.wrenches, forces)
    for i in np.flatnonzero(~done):
        mine, framed, wrenches = (
            {name: value[i] for name, value in part.items()} for part in (joints, places, acting.wrenches)
        )
        try:
            one = loop.hybrid_dynamics(q[i], v[i], mine, framed, wrenches, acting.forces[i])
        except P3dofError as error:
            result.errors[int(i)] = error
            if stop:
                break
        else:
            result.put(int(i), one, loop.closure_error(q[i]))
    return result


def _prescribed_alike(
    at: IndexArray, values: FloatArray, places: Mapping[str, FloatArray]
) -> Prescribed | None:
    """Return what is prescribed of joints and frames; None if not the same components at all samples."""
    frames: list[tuple[str, BoolArray]] = []
    columns: list[FloatArray] = [np.zeros((len(values), 0))]
    for name, wanted in places.items():
        if wanted.shape != (len(values), 6) or np.isinf(wanted).any():
            return None  # each sample alone tells what is wrong
        mask = ~np.isnan(wanted[:1]).ravel() if len(wanted) else np.ones(6, dtype=bool)
        if not (np.isnan(wanted) == ~mask).all() or not mask.any():
            return None
        frames.append((name, mask))
        columns.append(wanted[:, mask])
    return Prescribed(at, values, tuple(frames), np.concatenate(columns, axis=1))


def _of_samples(name: str, value: FloatArray, count: int, size: int) -> FloatArray:
    """Return the accelerations (count, size) of a joint; those of one freedom may be plain numbers."""
    if size == 1 and value.ndim < 2 and value.shape != (1,):
        value = np.broadcast_to(value, count) if value.shape == () else value
        return frozen_array(f"prescribed {name}", value, (count,))[:, None]
    return rows_of(f"prescribed {name}", value, count, size)


def rows_of(name: str, value: ArrayLike, count: int, width: int) -> FloatArray:
    """Return rows of a value that may be the same for all; (count, width)."""
    array = as_floats(name, value)
    return frozen_array(
        name, np.tile(array, (count, 1)) if array.shape == (width,) else array, (count, width)
    )


def _rows_by(
    loop: LoopModel, method: Method, name: str, samples: _Samples, inputs: Sequence[str], acting: _Acting
) -> tuple[dict[str, FloatArray], BoolArray] | None:
    """Return what is compiled at many samples, and where it is good; None for the robot's own ways."""
    if isinstance(method, str) and method == "general":
        return None
    q, frames = samples.arrays[0], tuple(acting.wrenches)
    try:
        compiled = chosen(loop, method, q, frames, acting.given)
    except InputError:
        samples.check()  # says more of what was given
        raise
    if compiled is None or (name == "checked_hybrid_dynamics" and not compiled.hybrid):
        samples.check()
        return None
    given = dict(zip(inputs, samples.arrays, strict=True))
    given |= {f"wrench_{frame}": wrench for frame, wrench in acting.wrenches.items()}
    if acting.given:
        given["joint_forces"] = acting.forces
    found = compiled.rows(name, given)
    if not (found["trusted"] > 0.0).all():
        samples.check()
    margin = found["margin"][:, 0]
    if isinstance(method, str) and not margin.min() > ENOUGH and not float(np.median(margin)) > ENOUGH:
        middle = int(np.argsort(margin)[len(q) // 2])
        if found["gap"][middle, 0] <= TOLERANCE * 1e3:
            better = compiled_for(loop, q[middle], frames, acting.given)
            found = found if better is compiled else better.rows(name, given)
    return found, found["trusted"][:, 0] > 0.0


def _evidence(loop: LoopModel, q: FloatArray) -> BatchEvidence:
    """Return evidence of samples (N, nq) of which nothing is known, in the robot's own unit of length."""
    batch, units = loop._scaled.batch, loop._scaled.of_q
    return BatchEvidence(np.full(len(q), np.nan), lambda some: batch.dynamics.conditioning(q[some] / units))


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
    if good.all():
        return np.arange(len(good))
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


class ClosedLoopModel(LoopModel):
    """Kinematics and dynamics of any robot with (or without) loop closures, for one sample and for many.

    Parameters
    ----------
    model : pin.Model
        A tree. Its frames and joints must stay as they are; masses and gravity may be changed.
    sidecar : Sidecar
        Loop closures, couplings, actuated joints, and perhaps the reference configuration.

    Raises
    ------
    ModelError
        If a frame or joint that the sidecar names does not exist, both frames of a closure are on the same
        body, an actuated or coupled joint has not exactly one degree of freedom, a continuous joint is
        coupled in a way that needs its turns counted, the reference does not fit the joints, or joints of the
        tree are not depth first.

    Notes
    -----
    Any number of threads may use an instance at once: each has workspaces of its own. Masses and gravity are
    for a time when no method runs. Arrays in results are read-only copies.

    A model much larger or smaller than a metre is computed in a unit of length of its own, see
    `p3dof.loops.units`: tolerances that are said here in metres are in that unit then, and so are ranks
    and the conditioning.

    Many samples have a `method`: ``"general"``, the robot's own; ``"compiled"``, C that is compiled for it
    when it is first asked for, and kept while the robot stays as it is; or what `compile` returned. Samples
    that the compiled dynamics does not trust are the robot's own, with the same results and errors.
    """

    def write(
        self,
        path: str | os.PathLike[str],
        format: Literal["urdf", "mjcf", "sdf", "drake"] | None = None,  # noqa: A002 - as everywhere
    ) -> list[Path]:
        """Write the robot as URDF and sidecar, MJCF or SDF, with its loops, all files or none; return these.

        Joints keep their names, and the forces of all motions stay the same. `load_robot` reads all of them
        back. Shapes are not written.

        Parameters
        ----------
        path : path-like
            The file; a sidecar gets the same name with the ending ``.yaml``.
        format : {"urdf", "mjcf", "sdf", "drake"}, optional
            By default what the name ends in: ``.urdf``, ``.xml``, ``.sdf``. Drake reads SDF with loops in
            elements of its own.

        Raises
        ------
        ModelError
            If the robot has something that the format cannot hold; the message names it.
        InputError
            If there is no such format, or the name ends otherwise.
        FileError
            If a file cannot be written.
        """
        from p3dof.loops.writers import contents  # what writes is loaded when it is asked for

        texts = contents(self, path, format)
        with together():
            return [write_atomic(file, text) for file, text in texts.items()]

    def complete_batch(
        self,
        target: BatchTarget | Sequence[BatchTarget],
        velocity: ArrayLike | ByName,
        acceleration: ArrayLike | ByName,
        guess: ArrayLike | None = None,
        near: ArrayLike | None = None,
        stop: bool = False,
        method: Method = "general",
    ) -> BatchStates:
        """Find the motion of the whole tree at many samples; fast where the target determines every joint.

        Parameters
        ----------
        target : FrameTargets, (N, n_actuated) array, mapping of str to (N,) array, or a list of these
            Placements of a frame, values of the actuated joints, or those of other joints by name, a number
            for the same at all samples; or several of them at once, as in `complete`.
        velocity, acceleration : (N, size) array, or mapping of str to (N,) array
            As in `complete`, of every sample.
        guess : (nq,) array, optional
            Where all samples start; by default the reference configuration.
        near : (nq,) array, optional
            Where a sample that has to be treated alone starts first, while no other one is known.
        stop : bool
            Leave the rest out after the first sample that fails.
        method : {"general", "compiled"} or CompiledLoop
            What computes the samples, see `ClosedLoopModel`.
            Compiled are values of the actuated joints, where these determine the motion.

        Returns
        -------
        BatchStates
            With the errors of the samples that failed, which are those of `complete`.

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or names a frame or joint that does not exist.
        """
        motion = velocity, acceleration
        return complete(self, target, motion, (guess, near), stop, method)

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
        """Return the actuator forces at many samples; fast with as many actuators as freedoms.

        Parameters
        ----------
        q : (N, nq) array
            Configurations, with closed loops.
        v, a : (N, nv) array
            Velocities and accelerations, which keep the loops closed.
        external : mapping of str to (6,) or (N, 6) array, optional
            Wrenches that act on frames, as in `inverse_dynamics`.
        joint_forces : (nv,) or (N, nv) array, optional
            As in `inverse_dynamics`.
        stop : bool
            Leave the rest out after the first sample that fails.
        method : {"general", "compiled"} or CompiledLoop
            What computes the samples, see `ClosedLoopModel`.

        Returns
        -------
        BatchInverseDynamics
            With the errors of the samples that failed, which are those of `inverse_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        return inverse_dynamics(self, (q, v, a), (external, joint_forces), stop, method)

    def forward_dynamics_batch(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike | ByName,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        stop: bool = False,
        method: Method = "general",
    ) -> BatchForwardDynamics:
        """Return the accelerations that actuator forces produce at many samples, one after the other.

        Parameters
        ----------
        q : (N, nq) array
            Configurations, with closed loops.
        v : (N, nv) array
            Velocities.
        tau : (N, n_actuated) array, or mapping of str to (N,) array
            Forces of the actuated joints [N or N m]; by name, those of the others are zero.
        external : mapping of str to (6,) or (N, 6) array, optional
            Wrenches that act on frames, as in `forward_dynamics`.
        joint_forces : (nv,) or (N, nv) array, optional
            As in `forward_dynamics`.
        stop : bool
            Leave the rest out after the first sample that fails.
        method : {"general", "compiled"} or CompiledLoop
            What computes the samples, see `ClosedLoopModel`.

        Returns
        -------
        BatchForwardDynamics
            With the errors of the samples that failed, which are those of `forward_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        return forward_dynamics(self, (q, v), tau, (external, joint_forces), stop, method)

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
        """Return forces and motions for prescribed accelerations at many samples.

        It is fast where as many accelerations are prescribed as joints are actuated, and the same components
        of frames at all samples.

        Parameters
        ----------
        q : (N, nq) array
            Configurations, with closed loops.
        v : (N, nv) array
            Velocities, which keep the loops closed.
        prescribed : (N, n_actuated) array or mapping of str to float or array
            As in `hybrid_dynamics`, of every sample; a value by name may also be the same for all.
        frames : mapping of str to (6,) or (N, 6) array, optional
            As in `hybrid_dynamics`.
        external : mapping of str to (6,) or (N, 6) array, optional
            As in `hybrid_dynamics`.
        joint_forces : (nv,) or (N, nv) array, optional
            As in `hybrid_dynamics`.
        stop : bool
            Leave the rest out after the first sample that fails.
        method : {"general", "compiled"} or CompiledLoop
            What computes the samples, see `ClosedLoopModel`.
            Compiled are accelerations of the actuated joints, where none of them follows from the others.

        Returns
        -------
        BatchHybridDynamics
            With the errors of the samples that failed, which are those of `hybrid_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite, or a name does not exist.
        """
        asked, loads = (prescribed, frames), (external, joint_forces)
        return hybrid_dynamics(self, (q, v), asked, loads, stop, method)

    def power_batch(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> FloatArray:
        """Return the rate of change of the mechanical energy (N,) at many samples [W]; see `power`.

        Parameters
        ----------
        q : (N, nq) array
            Configurations.
        v, a : (N, nv) array
            Velocities and accelerations.

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite.
        """
        return self._si_batch.dynamics.power(*self._tree.states(q, v, a))

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
            configuration. Singular ones, such as dead centres, are left out; regular ones nearby take their
            place where no other is given.
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

    def transmission(
        self, coordinates: Iterable[str], actuators: Iterable[str] | None = None, level: str = "auto"
    ) -> Transmission[Self]:
        """Return how coordinates, and the actuators behind the linkages, move and load each other.

        Positions, velocities, accelerations, forces, gains of controllers, reflected inertia, both ways:
        what a policy in joint space needs where motors are behind linkages.

        Parameters
        ----------
        coordinates : iterable of str
            Joints with one degree of freedom, as ``("ankle_pitch", "ankle_roll")``.
        actuators : iterable of str, optional
            As many actuated joints; by default all those of the linkage.
        level : str
            As of `compile`.

        Raises
        ------
        ModelError
            If a joint does not exist or has several degrees of freedom, if there are not as many actuators as
            coordinates, or one side does not determine the other.
        AssemblyError
            If the loops do not close at the reference configuration.
        """
        from p3dof.loops.transmission import Transmission

        return Transmission(self, coordinates, actuators, level)

    def observer(
        self, bandwidth: float, threshold: ArrayLike | None = None, compiled: CompiledLoop | None = None
    ) -> MomentumObserver:
        """Return an observer of contact forces and unknown payloads, from the motors' forces and the motion.

        Parameters
        ----------
        bandwidth : float
            Of the lag of first order behind which forces are seen [Hz].
        threshold : float or (n,) array, optional
            Forces above which there is a contact, along each coordinate [N or N m].
        compiled : CompiledLoop, optional
            What `compile` returned, for where the robot works, known wrenches or payloads.

        Raises
        ------
        InputError
            If the bandwidth or a threshold is not positive, or `compiled` is of another robot.
        ModelError, AssemblyError
            As `compile`.
        """
        from p3dof.loops.observer import MomentumObserver

        return MomentumObserver(self, bandwidth, threshold, compiled)

    def payload_estimator(
        self,
        joint: str,
        noise: ArrayLike,
        deviations: ArrayLike,
        parameters: ArrayLike | None = None,
        forgetting: float = 1.0,
        gate: float | None = None,
        compiled: CompiledLoop | None = None,
    ) -> RecursiveEstimator:
        """Return an estimator of a body's inertial parameters in a control loop, as of a payload.

        Parameters
        ----------
        joint : str
            Joint that carries the body.
        noise : float or (n_actuated,) array
            Standard deviations of the actuators' measured forces [N or N m].
        deviations : (10,) array
            Of the parameters before the first sample, as of `payload_deviations`; zero keeps a parameter.
        parameters : (10,) array, optional
            Before the first sample; the design's by default.
        forgetting : float
            By what older samples' weight is multiplied at each sample; 1 forgets none.
        gate : float, optional
            Standard deviations beyond which a sample is left out as an outlier.
        compiled : CompiledLoop, optional
            What `compile` returned with ``inertias=[joint]``, for where the robot works.

        Raises
        ------
        InputError
            If an argument does not fit, or `compiled` is of another robot or body.
        ModelError, AssemblyError
            If there are more actuators than degrees of freedom, and as `compile`.
        """
        from p3dof.loops.online import RecursiveEstimator

        return RecursiveEstimator(self, joint, noise, deviations, parameters, forgetting, gate, compiled)

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

        Raises
        ------
        ModelError
            If a joint is of a kind that cannot be compiled.
        InputError
            If an argument does not fit, or the loops are open.
        """
        return compiled_for(self, q, external, joint_forces, inertias)
