"""`AssemblyModel`: a model whose loops can be closed at targets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias, TypeGuard, cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import frozen_array, positive, shown
from p3dof._base.errors import InputError, ModelError
from p3dof.loops.assembly import TOLERANCE, Assembler
from p3dof.loops.assembly_results import Assembly, State
from p3dof.loops.built_model import BuiltModel
from p3dof.loops.joints import single_joint
from p3dof.loops.modes import assemble_within_limits, assembly_modes
from p3dof.loops.sidecar import Sidecar
from p3dof.loops.targets import (
    BoundFrameTarget,
    CombinedTarget,
    FrameTarget,
    JointTarget,
    NoTarget,
    Target,
)
from p3dof.loops.trust import Limits

OneTarget: TypeAlias = FrameTarget | ArrayLike | Mapping[str, float]
"""A frame's placement, the values of the actuated joints, or values of joints by name."""
TargetLike: TypeAlias = OneTarget | Sequence[OneTarget] | None
"""One target, several at once, or nothing but closed loops."""


class AssemblyModel(BuiltModel):
    """Configurations that close the loops of a robot at a target, and the motion with them."""

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        super().__init__(model, sidecar)
        self._assembler = Assembler(self._kinematics, self.reference)

    @property
    def generic_rank(self) -> int | None:
        """Rank of the closures around the reference configuration; None if the loops do not close there."""
        return self._assembler.generic_rank if self._scaled is None else self._scaled.core.generic_rank

    def assemble(
        self,
        target: TargetLike = None,
        guess: ArrayLike | None = None,
        tolerance: float = TOLERANCE,
        within_limits: bool = False,
    ) -> Assembly:
        """Find the configuration that closes the loops at a target, on the assembly of the guess.

        Parameters
        ----------
        target : FrameTarget, (n_actuated,) array, mapping of str to float, or a list of these, optional
            A frame's placement, or the values of the actuated joints [m or rad; an angle for a continuous
            joint], or those of other joints by name; or several of them at once, such as the placement of a
            floating base, motors by name and a hand. Without one the loops are only closed, by the shortest
            way.
        guess : (nq,) array, optional
            Where to start; by default the reference configuration. Others can fall into a wrong assembly,
            which `same_assembly` of the result then tells.
        tolerance : float
            Largest closure and target error that counts as closed [m or rad]. The iteration goes on to
            round-off whatever it is.
        within_limits : bool
            Whether hinges and slides have to stay within the limits that the tree's model has for them, which
            may lead to another assembly; else `beyond_limits` tells who does not.

        Returns
        -------
        Assembly

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target, or only beyond the limits; it carries the gap that is
            left.
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        start = None if guess is None else self._configuration("guess", guess)
        bound, tolerance = self._target(target), positive("tolerance", tolerance, InputError)
        if self._scaled is not None:
            return self._scaled.assemble(_goal(target), start, tolerance, within_limits)
        if within_limits:
            return assemble_within_limits(self._assembler, bound, start, tolerance)
        return self._assembler.assemble(bound, start, tolerance)

    def assembly_modes(
        self, target: TargetLike, starts: int = 64, seed: int = 0, within_limits: bool = False
    ) -> tuple[Assembly, ...]:
        """Find all configurations that close the loops at a target, from random starts.

        That none is missing cannot be known; more starts find more. Whole turns of a joint make no other mode
        in a model without couplings.

        Parameters
        ----------
        target : FrameTarget, (n_actuated,) array, mapping of str to float, or a list of these
            As in `assemble`; it must determine every joint, together with the closures.
        starts : int
            How many starts there are; the first one is the reference configuration.
        seed : int
            Of the random starts.
        within_limits : bool
            As in `assemble`.

        Returns
        -------
        tuple of Assembly
            That nearest to the reference configuration first; `same_assembly` tells which are on its
            assembly.

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target, or there are free motions left.
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        bound, starts, seed = self._target(target), whole("starts", starts, 1), whole("seed", seed, 0)
        if self._scaled is not None:
            return self._scaled.assembly_modes(_goal(target), starts, seed, within_limits)
        return assembly_modes(self._assembler, bound, starts, seed, within_limits)

    def beyond_limits(self, q: ArrayLike) -> dict[str, float]:
        """Return which hinges and slides are beyond their limits at `q` (nq,), and by how much [m or rad].

        Below the lower limit it is negative.
        """
        return Limits(self.model).beyond(self._configuration("q", q))

    def complete(
        self, target: TargetLike, velocity: ArrayLike, acceleration: ArrayLike, guess: ArrayLike | None = None
    ) -> State:
        """Find configuration, velocity and acceleration of the whole tree from the motion of a target.

        Parameters
        ----------
        target : FrameTarget, (n_actuated,) array, mapping of str to float, or a list of these
            As in `assemble`.
        velocity, acceleration : (n,) array
            Velocity and acceleration of the joints, or the prescribed components, in the order of the mask,
            of the frame's ``LOCAL_WORLD_ALIGNED`` velocity and classical acceleration. Of several targets one
            after the other.
        guess : (nq,) array, optional
            As in `assemble`.

        Returns
        -------
        State

        Raises
        ------
        AssemblyError
            If the loops cannot be closed at the target, or the closed mechanism cannot move so.
        InputError
            If an argument has the wrong shape, is not finite, or names a frame that does not exist.
        """
        bound = self._target(target)
        v = frozen_array("velocity", velocity, (bound.size,))
        a = frozen_array("acceleration", acceleration, (bound.size,))
        start = None if guess is None else self._configuration("guess", guess)
        if self._scaled is not None:
            return self._scaled.complete(_goal(target), v, a, start)
        return self._assembler.complete(bound, self._assembler.assemble(bound, start, TOLERANCE), v, a)

    def _target(self, target: TargetLike) -> Target:
        if target is None:
            return NoTarget(self.model.nv)
        if isinstance(target, FrameTarget):
            return BoundFrameTarget(self._kinematics, target)
        if isinstance(target, Mapping):
            return JointTarget(self._kinematics, self._named_joints(target), list(target.values()))
        if _are_several(target):
            return CombinedTarget([self._target(part) for part in target])
        return JointTarget(self._kinematics, self._joints, cast("ArrayLike", target))

    def _named_joints(self, names: Iterable[str]) -> list[int]:
        try:
            return [single_joint(self.model, name, "target") for name in names]
        except ModelError as error:
            raise InputError(str(error)) from error


def _are_several(target: TargetLike) -> TypeGuard[Sequence[OneTarget]]:
    """Whether a target is a sequence of targets, and not of numbers."""
    return isinstance(target, list | tuple) and any(
        isinstance(part, FrameTarget | Mapping) for part in target
    )


def whole(name: str, value: int, least: int) -> int:
    """Return a whole number that is at least so large.

    Parameters
    ----------
    name : str
        What to call it in an error.
    value : int
        The number.
    least : int
        The least that it may be.

    Raises
    ------
    InputError
        If it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{name}: expected a whole number of at least {least}, got {shown(value)}")
    return int(value)


def _goal(target: TargetLike) -> Any:
    """Return a target that was checked, with arrays where numbers are meant."""
    if target is None or isinstance(target, FrameTarget):
        return target
    if isinstance(target, Mapping):
        return {name: float(value) for name, value in target.items()}
    if _are_several(target):
        return [_goal(part) for part in target]
    return np.asarray(target, dtype=float)
