"""The unit of length in which a model is computed: that of the model itself.

All tolerances of this layer are lengths and angles, and the rows and columns of its matrices mix both, which
fits machines whose links are about as long as the unit of length. `Units` finds such a unit, a power of 64 m,
and `ScaledModel` computes a model in it. Powers of two scale exactly: tolerances change, and no rounding. The
metre is the unit of all models of .125 to 8 m; nothing is scaled there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof.checks import LARGEST, FloatArray
from p3dof.closed_loop.assembly import Assembly, State
from p3dof.closed_loop.closure_kinds import lengths_of
from p3dof.closed_loop.coordinates import length_coordinates
from p3dof.closed_loop.results import ClosureForces, ForwardDynamics, InverseDynamics
from p3dof.closed_loop.sidecar import Coupling, Sidecar
from p3dof.closed_loop.targets import FrameTarget
from p3dof.errors import AssemblyError, DynamicsError, InputError, ModelError, P3dofError

_STEP = 6
"""Units are powers of 2**6 m."""


class Units:
    """Factors between metres and a model's unit of length, for everything that this layer takes and returns.

    Parameters
    ----------
    model : pin.Model
        The tree.
    sidecar : Sidecar
        Its closures.
    """

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        self.q, self.v, known = length_coordinates(model)
        size = size_of(model, sidecar)
        if not size < LARGEST:  # also what is not a number
            raise ModelError(f"model: expected placements of less than {LARGEST:g} m, got {size:g} m")
        power = round(math.log2(size) / _STEP) if known and size > 0 else 0
        self.length = 2.0 ** (_STEP * power)
        """The unit of length [m]."""
        joints = [i for i in range(1, model.njoints) if model.nvs[i] == 1]
        self._slides = {str(model.names[i]): bool(self.v[model.idx_vs[i]]) for i in joints}
        rows = [is_length for closure in sidecar.closures for is_length in lengths_of(closure.kind)]
        rows += [self._slides[coupling.joint] for coupling in sidecar.couplings]
        self.rows = np.array(rows, dtype=bool)
        """Which rows of closures and couplings are lengths."""

    def motion(self, lengths: NDArray[np.bool_]) -> FloatArray:
        """Return the units [m, rad] of coordinates, some of which are lengths."""
        return np.where(lengths, self.length, 1.0)

    def force(self, lengths: NDArray[np.bool_]) -> FloatArray:
        """Return the units [N, N m] of the forces along such coordinates."""
        return np.where(lengths, self.length, self.length**2)

    def scaled(self, model: pin.Model) -> pin.Model:
        """Return a copy of the model in these units; masses and times stay."""
        copy = model.copy()
        for i in range(model.njoints):
            copy.jointPlacements[i] = self._placement(model.jointPlacements[i])
        for frame in copy.frames:
            frame.placement = self._placement(frame.placement)
        self.update(copy, model)
        return copy

    def update(self, copy: pin.Model, model: pin.Model) -> None:
        """Give a scaled copy the masses and the gravity that its model has now."""
        u = self.length
        for i in range(model.njoints):
            body = model.inertias[i]
            copy.inertias[i] = pin.Inertia(body.mass, body.lever / u, body.inertia / u**2)
        copy.gravity.linear = model.gravity.linear / u
        with np.errstate(over="ignore"):  # where there is no limit
            for name in ("lowerPositionLimit", "upperPositionLimit"):
                setattr(copy, name, np.asarray(getattr(model, name)) / self.motion(self.q))
        copy.armature = np.asarray(model.armature) / np.where(self.v, 1.0, u**2)

    def sidecar(self, model: pin.Model, sidecar: Sidecar) -> Sidecar:
        """Return the sidecar of the scaled copy of a model."""
        reference: dict[str, Any] = {}
        for name, value in (sidecar.reference or {}).items():
            i = model.getJointId(name)
            lengths = self.q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]]
            reference[name] = np.asarray(value) / (self.motion(lengths) if lengths.any() else 1.0)
        return replace(
            sidecar,
            closures=tuple(
                replace(closure, length=None if closure.length is None else closure.length / self.length)
                for closure in sidecar.closures
            ),
            couplings=tuple(self._coupling(coupling) for coupling in sidecar.couplings),
            reference=reference or None,
            joint_data=(),  # whoever hands a state in adds what acts in the joints
        )

    def _coupling(self, coupling: Coupling) -> Coupling:
        def unit(name: str | None) -> float:
            return self.length if name and self._slides[name] else 1.0

        powers = np.arange(len(coupling.coefficients))
        one = unit(coupling.joint)
        return replace(
            coupling,
            coefficients=tuple(np.array(coupling.coefficients) * unit(coupling.on) ** powers / one),
            others=tuple((name, factor * unit(name) / one) for name, factor in coupling.others),
        )

    def _placement(self, M: pin.SE3) -> pin.SE3:
        return pin.SE3(M.rotation, M.translation / self.length)


def size_of(model: pin.Model, sidecar: Sidecar) -> float:
    """Return the longest distance between a joint's origin and what the model fixes to it [m].

    Parameters
    ----------
    model : pin.Model
        The tree.
    sidecar : Sidecar
        Its closures: the frames and rods that count.
    """
    ends = {frame for closure in sidecar.closures for frame in (closure.frame1, closure.frame2)}
    placements = [*model.jointPlacements, *(frame.placement for frame in model.frames if frame.name in ends)]
    rods = [closure.length for closure in sidecar.closures if closure.length is not None]
    return max((*(float(np.linalg.norm(M.translation)) for M in placements), *rods), default=0.0)


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


class ScaledModel(Generic[CoreT_co]):
    """The methods of `LoopModel` for a model whose unit of length is not the metre.

    Parameters
    ----------
    units : Units
        Its units.
    model : pin.Model
        The model in metres.
    core : LoopModel
        The model in these units.
    """

    def __init__(self, units: Units, model: pin.Model, core: CoreT_co) -> None:
        self.units, self.core = units, core
        self._model = model
        self._u = units.length
        self._actuated = units.v[core.actuated_v]

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
    return ScaledModel(units, model, build(units.scaled(model), units.sidecar(model, sidecar)))


def _read_only(array: FloatArray) -> FloatArray:
    array.setflags(write=False)
    return array
