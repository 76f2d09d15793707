"""`MinimalModel`: equations of motion of any robot in independent coordinates, and Jacobians from them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops.closed_tree import CLOSED, CONSISTENT
from p3dof.loops.hybrid_model import HybridModel
from p3dof.loops.independent import (
    Independent,
    IndexArray,
    default_coordinates,
    named_coordinates,
    pivoted,
)
from p3dof.loops.loop_model import External
from p3dof.loops.minimal import FrameJacobian, MinimalDynamics, frame_motion, motion_rate, stacked
from p3dof.loops.setting import Setting

Names = Iterable[str] | str | None
"""Names of joints, or of single freedoms of joints such as ``base[2]``."""


class MinimalModel(HybridModel):
    """Independent coordinates of any robot, and what follows from them."""

    def coordinates(self, q: ArrayLike, names: Names = None) -> tuple[str, ...]:
        """Return names of independent coordinates at a configuration.

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        names : iterable of str, optional
            Joints, or single freedoms of joints that have several, such as ``base[2]``. By default the
            actuated joints, in their order, if they determine the motion; else those of them that do not
            depend on each other, and other freedoms for what they leave open, those first that move most.
            This choice is made at the reference configuration if it determines the motion here too.

        Returns
        -------
        tuple of str
            One name for each freedom.

        Raises
        ------
        SingularityError
            If they do not determine the motion at this configuration.
        InputError
            If a name does not exist, there are more than free motions, `q` has the wrong shape or is not
            finite, or the loops are open by more than 1e-5.
        """
        with self._setting.open():
            return self._independent(self._configuration("q", q), names).names

    def minimal_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike | None = None,
        coordinates: Names = None,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
    ) -> MinimalDynamics:
        """Return the equations of motion in independent coordinates.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configuration, with closed loops; or many of them.
        v : (nv,) or (N, nv) array, optional
            Velocity, which keeps the loops closed; zero by default.
        coordinates : iterable of str, optional
            As in `coordinates`; many configurations have those of the first one.
        external : mapping of str to (6,) array, optional
            As in `inverse_dynamics`.
        joint_forces : (nv,) array, optional
            As in `inverse_dynamics`.

        Returns
        -------
        MinimalDynamics

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion.
        InputError
            If an argument has the wrong shape or is not finite, a name does not exist, the loops are open by
            more than 1e-5, or the velocity would open them.
        """
        if np.ndim(q) == 2:
            q, v = self._samples(q, v)
            coordinates = self.coordinates(q[0], coordinates)
            return stacked(
                [
                    self.minimal_dynamics(*state, coordinates, external, joint_forces)
                    for state in zip(q, v, strict=True)
                ]
            )
        q, v = self._state(q, v)
        setting = self._setting
        with setting.open():
            at = self._independent(q, coordinates, v)
            N_dot = motion_rate(setting.kinematics, setting.couplings, setting.tree, at, v / setting.v)
        N, N_dot = setting.motion(at), setting.v[:, None] * N_dot / setting.v[at.v]
        tree, data = setting.si_tree, setting.si_tree.data
        M = tree.mass_matrix(q)
        C = np.array(pin.computeCoriolisMatrix(tree.model, data, q, v))
        self._kinematics.at(q)
        passive = self.passive.forces(q, v)
        return MinimalDynamics(
            coordinates=at.names,
            speeds=v[at.v],
            motion=N,
            motion_rate=N_dot,
            mass_matrix=N.T @ M @ N,
            coriolis_matrix=N.T @ (C @ N + M @ N_dot),
            gravity_forces=N.T @ np.array(pin.computeGeneralizedGravity(tree.model, data, q)),
            actuation=N[self.actuated_v].T.copy(),
            passive_forces=N.T @ passive,
            external_forces=N.T @ self._external(external, joint_forces),
        )

    def frame_jacobian(
        self, frame: str, q: ArrayLike, v: ArrayLike | None = None, coordinates: Names = None
    ) -> FrameJacobian:
        """Return the Jacobian from the motors, or other independent coordinates, to a frame, and its drift.

        Parameters
        ----------
        frame : str
            Name of the frame.
        q : (nq,) or (N, nq) array
            Configuration, with closed loops; or many of them.
        v : (nv,) or (N, nv) array, optional
            Velocity, which keeps the loops closed; zero by default.
        coordinates : iterable of str, optional
            As in `minimal_dynamics`.

        Returns
        -------
        FrameJacobian

        Raises
        ------
        SingularityError
            If the coordinates do not determine the motion.
        InputError
            As `minimal_dynamics`, and if the frame does not exist.
        """
        if np.ndim(q) == 2:
            q, v = self._samples(q, v)
            coordinates = self.coordinates(q[0], coordinates)
            return stacked(
                [self.frame_jacobian(frame, *state, coordinates) for state in zip(q, v, strict=True)]
            )
        q, v = self._state(q, v)
        setting = self._setting
        place = setting.kinematics.frame(frame, "frame", InputError)
        with setting.open():
            at, own = self._independent(q, coordinates, v), v / setting.v
            N_dot = motion_rate(setting.kinematics, setting.couplings, setting.tree, at, own)
            J, drift = frame_motion(setting.tree, at, N_dot, own, place)
        return FrameJacobian(at.names, setting.twist[:, None] * J / setting.v[at.v], setting.twist * drift)

    @cached_property
    def _setting(self) -> Setting:
        return Setting(self)

    @cached_property
    def _reference_choice(self) -> IndexArray | None:
        """Coordinates at the reference configuration; None if the loops do not close there."""
        core = self._setting.core
        try:
            q = core.assemble().q
        except AssemblyError:
            return None
        return pivoted(core._kinematics.at(q).svd.null_space, self.actuated_v)

    def _independent(self, q: FloatArray, names: Names, v: FloatArray | None = None) -> Independent:
        """Return independent coordinates in the model's own units, after checks of the closures."""
        setting = self._setting
        point = setting.core._at(q / setting.q, CLOSED)
        if v is not None and point.J.size:
            own = v / setting.v
            opening = point.J @ own
            largest = max(1.0, float(np.abs(own).max(initial=0.0)))
            setting.core._check_opening("v", opening, (CONSISTENT + 100.0 * point.gap) * largest)
        if names is not None:
            chosen = named_coordinates(self.model, names)
        else:
            chosen = default_coordinates(point, self.actuated_v, lambda: self._reference_choice)
        return Independent(chosen, tuple(setting.names[k] for k in chosen), point)

    def _state(self, q: ArrayLike, v: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
        v = np.zeros(self.model.nv) if v is None else frozen_array("v", v, (self.model.nv,))
        return self._configuration("q", q), v

    def _samples(self, q: ArrayLike, v: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
        q = frozen_array("q", q, ("N", self.model.nq))
        if not len(q):
            raise InputError("q: expected at least one configuration, got none")
        shape = (len(q), self.model.nv)
        return q, np.zeros(shape) if v is None else frozen_array("v", v, shape)
