"""`ScaledModel`: a model that is computed in its own unit of length, see `p3dof.loops.units`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError, DynamicsError, InputError, P3dofError
from p3dof._base.threads import Workspace
from p3dof.loops.assembly_results import Assembly, State
from p3dof.loops.results import ClosureForces, ForwardDynamics, InverseDynamics
from p3dof.loops.sidecar import Sidecar
from p3dof.loops.targets import FrameTarget
from p3dof.loops.units import Units


class Core(Protocol):
    """What `ScaledModel` needs of a `LoopModel`."""

    model: Any
    actuated_v: Any

    def assemble(self, target: Any, guess: Any, tolerance: float, within_limits: bool, /) -> Assembly:
        """Close the loops."""

    def assembly_modes(
        self, target: Any, starts: int, seed: int, within_limits: bool, /
    ) -> tuple[Assembly, ...]:
        """Close the loops in all ways."""

    def complete(self, target: Any, velocity: Any, acceleration: Any, guess: Any, /) -> State:
        """Find the motion of the whole tree."""

    def inverse_dynamics(
        self, q: Any, v: Any, a: Any, external: Any, joint_forces: Any, /
    ) -> InverseDynamics:
        """Return the actuator forces."""

    def forward_dynamics(
        self, q: Any, v: Any, tau: Any, external: Any, joint_forces: Any, stabilisation: float, /
    ) -> ForwardDynamics:
        """Return the acceleration."""


EvidenceT = TypeVar("EvidenceT", bound=ClosureForces)
CoreT_co = TypeVar("CoreT_co", bound=Core, covariant=True)


class ScaledModel(Workspace, Generic[CoreT_co]):
    """The methods of `LoopModel` for a model whose unit of length is not the metre.

    Parameters
    ----------
    units : Units
        Its units.
    model : pin.Model
        The model in metres.
    sidecar : Sidecar
        Its closures.
    build : callable
        Makes a `LoopModel` of a tree and its sidecar.

    Attributes
    ----------
    core : LoopModel
        The model in these units.
    """

    def __init__(
        self,
        units: Units,
        model: pin.Model,
        sidecar: Sidecar,
        build: Callable[[pin.Model, Sidecar], CoreT_co],
    ) -> None:
        self.units = units
        self.core = build(units.scaled(model), units.sidecar(model, sidecar))
        self._model = model
        self._u = units.length
        self._actuated = units.v[self.core.actuated_v]

    def q(self, q: FloatArray) -> FloatArray:
        """Return configurations (..., nq) in these units."""
        return q / self.units.motion(self.units.q)

    def v(self, v: FloatArray) -> FloatArray:
        """Return velocities or accelerations (..., nv) in these units."""
        return v / self.units.motion(self.units.v)

    def forces(self, forces: ArrayLike | None) -> FloatArray | None:
        """Return generalised forces (..., nv) in these units."""
        return None if forces is None else np.asarray(forces) / self.units.force(self.units.v)

    def wrenches(self, external: Mapping[str, ArrayLike] | None) -> dict[str, FloatArray]:
        """Return wrenches (..., 6) on frames in these units."""
        factors = self.units.force(np.arange(6) < 3)
        return {name: np.asarray(wrench) / factors for name, wrench in (external or {}).items()}

    def target(self, target: Any) -> tuple[Any, FloatArray]:
        """Return a target in these units, and the units [m, rad] of its components."""
        if target is None:
            return None, np.ones(0)
        if isinstance(target, list):
            goals, parts = zip(*(self.target(part) for part in target), strict=True)
            return list(goals), np.concatenate(parts)
        if isinstance(target, Mapping):
            at = [self._model.idx_vs[self._model.getJointId(name)] for name in target]
            factors = self.units.motion(self.units.v[at])
            return {
                name: value / u for (name, value), u in zip(target.items(), factors, strict=True)
            }, factors
        if isinstance(target, FrameTarget):
            place = pin.SE3(target.placement.rotation, target.placement.translation / self._u)
            return FrameTarget(target.frame, place, target.mask), self.of_mask(target.mask)
        factors = self.units.motion(self._actuated)
        return target / factors, factors

    def of_mask(self, mask: Any) -> FloatArray:
        """Return the units [m, rad] of the prescribed components of a placement."""
        return self.units.motion((np.arange(6) < 3)[np.asarray(mask)])

    def influence(self, J: FloatArray, lengths: NDArray[np.bool_], target: FloatArray) -> FloatArray:
        """Return the matrices (..., n, size) from a target's speed to that of some joints, in SI units."""
        return J * self.units.motion(lengths)[:, None] / target

    def assemble(
        self, target: Any, guess: FloatArray | None, tolerance: float, within_limits: bool
    ) -> Assembly:
        """`LoopModel.assemble`."""
        goal, _ = self.target(target)
        with self.in_words():
            begin = None if guess is None else self.q(guess)
            found = self.core.assemble(goal, begin, tolerance, within_limits)
        return self._assembly(found)

    def assembly_modes(
        self, target: Any, starts: int, seed: int, within_limits: bool
    ) -> tuple[Assembly, ...]:
        """`LoopModel.assembly_modes`."""
        goal, _ = self.target(target)
        with self.in_words():
            found = self.core.assembly_modes(goal, starts, seed, within_limits)
        return tuple(self._assembly(one) for one in found)

    def _assembly(self, found: Assembly) -> Assembly:
        return replace(found, q=self._out(found.q, self.units.q), gap=found.gap * self._u)

    def complete(
        self, target: Any, velocity: FloatArray, acceleration: FloatArray, guess: FloatArray | None
    ) -> State:
        """`LoopModel.complete`."""
        goal, factors = self.target(target)
        with self.in_words():
            found = self.core.complete(
                goal, velocity / factors, acceleration / factors, None if guess is None else self.q(guess)
            )
        return replace(
            found,
            q=self._out(found.q, self.units.q),
            v=self._out(found.v, self.units.v),
            a=self._out(found.a, self.units.v),
            gap=found.gap * self._u,
            influence=_read_only(self.influence(found.influence, self.units.v, factors)),
        )

    def inverse_dynamics(
        self, q: FloatArray, v: FloatArray, a: FloatArray, external: Any, forces: Any
    ) -> InverseDynamics:
        """`LoopModel.inverse_dynamics`."""
        with self.in_words():
            found = self.core.inverse_dynamics(
                self.q(q), self.v(v), self.v(a), self.wrenches(external), self.forces(forces)
            )
        tau = _read_only(found.tau * self.units.force(self._actuated))
        return InverseDynamics(tau, self.evidence(found.evidence))

    def evidence(self, found: EvidenceT) -> EvidenceT:
        """Return evidence of forces in SI units."""
        return found.in_units(self.units.force(self.units.rows), self._largest_force(), self._u)

    def forward_dynamics(
        self,
        q: FloatArray,
        v: FloatArray,
        tau: FloatArray,
        external: Any,
        forces: Any,
        stabilisation: float,
    ) -> ForwardDynamics:
        """`LoopModel.forward_dynamics`."""
        given = tau / self.units.force(self._actuated)
        with self.in_words():
            found = self.core.forward_dynamics(
                self.q(q), self.v(v), given, self.wrenches(external), self.forces(forces), stabilisation
            )
        return replace(
            found,
            a=self._out(found.a, self.units.v),
            evidence=self.evidence(found.evidence),
        )

    @contextmanager
    def in_words(self) -> Iterator[None]:
        """Bring the model up to date, and say in errors in which unit their numbers are."""
        self.units.update(self.core.model, self._model)
        try:
            yield
        except (AssemblyError, DynamicsError, InputError) as error:
            raise self.told(error) from error

    def told(self, error: P3dofError) -> P3dofError:
        """Return an error whose numbers name their units."""
        words = str(error)
        for old, new in (
            (" m or rad", f" x {self._u:g} m or rad"),
            (" m/s² or rad/s²", f" x {self._u:g} m/s² or rad/s²"),
            (" N or N m", f" x {self._u:g} N or x {self._u**2:g} N m"),
            (" (SI units)", f" (in SI units, but of length {self._u:g} m)"),
        ):
            words = words.replace(old, new)
        if isinstance(error, AssemblyError):
            return AssemblyError(words, error.gap * self._u)
        return type(error)(words)

    def _largest_force(self) -> float:
        return max(self._u, self._u**2)

    def _out(self, array: FloatArray, lengths: NDArray[np.bool_]) -> FloatArray:
        return _read_only(array * self.units.motion(lengths))


def scaled(
    model: pin.Model, sidecar: Sidecar, build: Callable[[pin.Model, Sidecar], CoreT_co]
) -> ScaledModel[CoreT_co] | None:
    """Return a model in its own unit of length; None if that is the metre.

    Parameters
    ----------
    model : pin.Model
        The model in metres.
    sidecar : Sidecar
        Its closures.
    build : callable
        Makes a `LoopModel` of the scaled tree and its sidecar.

    Returns
    -------
    ScaledModel, optional
    """
    units = Units(model, sidecar)
    if units.length == 1.0:
        return None
    return ScaledModel(units, model, sidecar, build)


def _read_only(array: FloatArray) -> FloatArray:
    array.setflags(write=False)
    return array
