"""`ClosedLoopModel`: a tree model, its loop closures and its actuators, for one sample and for many."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import frozen_array
from p3dof._base.files import together, write_atomic
from p3dof.loops.compiled_model import CompiledModel
from p3dof.loops.motors import MotorSide, motor_side
from p3dof.loops.writers.files import contents


class ClosedLoopModel(CompiledModel):
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
        coupled in a way that needs its turns counted, or the reference does not fit the joints.

    Notes
    -----
    Any number of threads may use an instance at once: each has workspaces of its own. Masses and gravity are
    for a time when no method runs. Arrays in results are read-only copies.
    """

    def motor_side(self, tau: ArrayLike, v: ArrayLike) -> MotorSide:
        """Return torques and speeds of the motors before their gears, see `JointData`.

        Parameters
        ----------
        tau : (n_actuated,) or (N, n_actuated) array
            Forces of the actuated joints [N or N m].
        v : (nv,) or (N, nv) array
            Velocities of the tree.

        Returns
        -------
        MotorSide

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite.
        """
        shape: tuple[int | str, ...] = () if np.ndim(tau) == 1 else ("N",)
        forces = frozen_array("tau", tau, (*shape, len(self.actuated)))
        speeds = frozen_array("v", v, (*forces.shape[:-1], self.model.nv))[..., self.actuated_v]
        return motor_side(self.actuated, self.sidecar.joint_data, forces, speeds)

    def write(
        self,
        path: str | os.PathLike[str],
        format: Literal["urdf", "mjcf", "sdf", "drake"] | None = None,  # noqa: A002 - as everywhere
    ) -> list[Path]:
        """Write the robot as URDF and sidecar, MJCF or SDF, with its loops; all files or none.

        Joints keep their names, and the forces of all motions stay the same. `load_robot` reads back all but
        SDF. Shapes are not written.

        Parameters
        ----------
        path : path-like
            The file; a sidecar gets the same name with the ending ``.yaml``.
        format : {"urdf", "mjcf", "sdf", "drake"}, optional
            By default what the name ends in: ``.urdf``, ``.xml``, ``.sdf``. Drake reads SDF with loops in
            elements of its own.

        Returns
        -------
        list of Path
            What has been written.

        Raises
        ------
        ModelError
            If the robot has something that the format cannot hold; the message names it.
        InputError
            If there is no such format, or the name ends otherwise.
        FileError
            If a file cannot be written.
        """
        texts = contents(self, path, format)
        with together():
            return [write_atomic(file, text) for file, text in texts.items()]
