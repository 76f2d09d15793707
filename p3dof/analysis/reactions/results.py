"""Reactions of all joints over a motion."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.files import write_table
from p3dof._base.tables import ShownInNotebook
from p3dof.analysis.reactions.joints import JOINTS, joint_axes
from p3dof.analysis.reactions.newton_euler import in_fixed_axes
from p3dof.analysis.reactions.one_joint import (
    JointLoad,
    JointReaction,
    OpenPeak,
    Peak,
    largest,
    loads_of,
    peaks_of,
)
from p3dof.loops.reactions import BoolArray
from p3dof.machine.motion import Motion


@dataclass(frozen=True, eq=False)
class Reactions(ShownInNotebook):
    """Reactions of all joints over a motion; ``result["hinge_a"]`` is one of them.

    Parameters
    ----------
    way : str
        How loads are found that rigid bodies leave open: ``"elastic"``, ``"paper"`` or ``"points"``.
    cuts : str
        How the cuts are built, ``"paper"`` or ``"points"``.
    length : float
        What compares moments with forces where a choice is made [m]; see `p3dof.analysis.reactions`.
    motion : Motion
        The motion of the platform.
    forces, moments : ndarray, shape (N, 13, 3)
        What the predecessor of each of `JOINTS` exerts on the successor, at the origin and in the axes of
        the joint's frame (`Joint.frame`; `in_base` turns them) [N, N m]; NaN where a sample is invalid. Along
        a joint's freedoms lie the force of its actuator and its friction.
    determined_forces, determined_moments : ndarray of bool, shape (N, 13, 3)
        Which components rigid bodies determine; False where a sample is invalid.
    rotations : ndarray, shape (N, 13, 3, 3)
        Axes of the joints' frames, as columns, in the fixed frame.
    positions : ndarray, shape (N, 13, 3)
        Origins of the joints' frames in the fixed frame [m].
    undetermined : ndarray of int, shape (N,)
        How many independent changes of the reactions leave the motion as it is.
    fit : ndarray, shape (N, 2, 13, 2, 3)
        What a misfit of assembly may add to each component of force and moment, either way: at worst, and at
        random (standard deviations, if the tolerances are some) [N, N m]; zero without any.
    residual : ndarray, shape (N,)
        Largest error of Newton's and Euler's equations [N or N m]: of every body, with the motion of its mass
        centre from the closed forms of `p3dof.closed_form.kinematics`, and all reactions that act on it.
    """

    way: str
    cuts: str
    length: float
    motion: Motion
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray
    rotations: FloatArray
    positions: FloatArray
    undetermined: NDArray[np.int_]
    fit: FloatArray
    residual: FloatArray

    def __repr__(self) -> str:
        worst = largest(self.residual[self.valid])
        return f"Reactions({self.way}, {self.motion!r}, residual {worst:.1e})"

    def __getitem__(self, name: str) -> JointReaction:
        if name not in self.joints:
            raise InputError(f"joint: expected one of {', '.join(self.joints)}, got {name!r}")
        i = self.joints.index(name)
        return JointReaction(
            JOINTS[i],
            self.axes[i],
            self.forces[:, i],
            self.moments[:, i],
            self.determined_forces[:, i],
            self.determined_moments[:, i],
            self.fit[:, 0, i],
        )

    @property
    def ways(self) -> tuple[str, ...]:
        """The one way, as of a comparison."""
        return (self.way,)

    @property
    def rests_on_stiffness(self) -> bool:
        """Whether loads that rigid bodies leave open are those of elastic joints."""
        return self.way == "elastic"

    @property
    def each(self) -> tuple[Reactions, ...]:
        """Itself alone, as of a comparison."""
        return (self,)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the thirteen joints."""
        return tuple(joint.name for joint in JOINTS)

    @property
    def axes(self) -> FloatArray:
        """Axis of each joint in its own frame, shape (13, 3); NaN for ball joints."""
        return joint_axes(self.cuts)

    @property
    def time(self) -> FloatArray:
        """Times, shape (N,) [s]."""
        return self.motion.time

    @property
    def valid(self) -> BoolArray:
        """Which samples have reactions, shape (N,)."""
        return np.asarray(np.isfinite(self.forces).all(axis=(1, 2)))

    @property
    def possible(self) -> bool:
        """Whether every sample is valid: else the machine cannot make the motion."""
        return bool(self.valid.all())

    def in_base(self) -> tuple[FloatArray, FloatArray]:
        """Return forces and moments in the axes of the fixed frame, at the same points.

        Marks hold for the joints' own axes only: here a component mixes what is determined and what is not.

        Returns
        -------
        forces, moments : ndarray, shape (N, 13, 3)
            [N, N m].
        """
        return in_fixed_axes(self.rotations, self.forces), in_fixed_axes(self.rotations, self.moments)

    def loads(self, name: str) -> dict[str, JointLoad]:
        """Return the largest loads of a joint and which of them are open, by the fields of a `Peak`.

        Parameters
        ----------
        name : str
            Of the joint.

        Returns
        -------
        dict of str to JointLoad
            NaN unless the motion is `possible`: what lies between the samples may be larger.

        Raises
        ------
        InputError
            If there is no such joint.
        """
        return loads_of(self[name], self.time, self.valid & self.possible)

    def peaks(self) -> tuple[Peak, ...]:
        """Return the largest loads of every joint, for sizing its bearings.

        Returns
        -------
        tuple of Peak
            One for each of `JOINTS`; unless the joints are elastic, NaN where `open_peaks` tells.
        """
        return tuple(peaks_of(name, {self.way: self.loads(name)})[0] for name in self.joints)

    def open_peaks(self) -> tuple[OpenPeak, ...]:
        """Return the largest values here of the loads that rigid bodies leave open.

        Unless the joints are elastic, each is one of many possible values, and no bound.

        Returns
        -------
        tuple of OpenPeak
            In the order of `JOINTS`.
        """
        found = (peaks_of(name, {self.way: self.loads(name)})[1] for name in self.joints)
        return tuple(peak for peaks in found for peak in peaks)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write time, all reactions and the residual to a CSV file, 17 significant digits.

        Components are in the axes of the joints' frames (`Joint.frame`). One that is not determined in every
        sample is followed by a column that says where it is (1) and where not (0).

        Parameters
        ----------
        path : path-like
            The file; replaced whole or not at all.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        header, columns = ["t [s]"], [self.time]
        for name in self.joints:
            one = self[name]
            for kind, values, determined in (
                ("f{} [N]", one.forces, one.determined_forces),
                ("m{} [N m]", one.moments, one.determined_moments),
            ):
                for i, axis in enumerate("xyz"):
                    header.append(f"{name} {kind.format(axis)}")
                    columns.append(values[:, i])
                    if not determined[self.valid, i].all():
                        header.append(f"{name} {kind[0]}{axis} determined")
                        columns.append(determined[:, i].astype(float))
        return write_table(path, [*header, "residual"], (*columns, self.residual))
