"""`BuiltModel`: where models come from: files, Pinocchio, and other models whose joints are locked."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import pinocchio as pin
from typing_extensions import Self

from p3dof.loops.closed_tree import ClosedTree
from p3dof.loops.formats import pinocchio_models, urdf
from p3dof.loops.joints import joint_named
from p3dof.loops.locks import locked_at, without
from p3dof.loops.sidecar import Coupling, SidecarLike


class BuiltModel(ClosedTree):
    """A model that is read from files, taken over from Pinocchio, or made of another one."""

    @classmethod
    def from_urdf(
        cls,
        path_or_xml: str | os.PathLike[str],
        closures: SidecarLike = None,
        root_joint: pin.JointModel | None = None,
        mimic: bool = True,
        on_unknown: Literal["raise", "ignore"] = "raise",
        passive: bool = False,
    ) -> Self:
        """Build the model from a tree URDF and its sidecar; `p3dof.load_robot` reads more formats.

        Loops in the file itself are read too: those of URDF+ (``<loop>``, ``<coupling>``, ``independent``),
        Drake's ball constraints, ``<mimic>``. At most 1000 links and 200 degrees of freedom are read.

        Parameters
        ----------
        path_or_xml : str or path-like
            The path of a URDF, or its text.
        closures : Sidecar, mapping, str or path-like, optional
            The sidecar, a mapping with the keys of its file, or the path of the file or its text. Without one
            the robot is an open tree and every joint with one degree of freedom is actuated; a warning
            is given for one that looks as if it had loops, unless an empty tuple says that this is meant.
        root_joint : pin.JointModel, optional
            The joint between the world and the root link; by default the root link is fixed.
        mimic : bool
            Whether ``<mimic>`` couples joints; else they are independent.
        on_unknown : {"raise", "ignore"}
            What to do with elements that look like loops and are not understood.
        passive : bool
            Whether the damping and friction of ``<dynamics>`` act; they are often guesses. What the sidecar
            says of a joint always does, and goes before.

        Returns
        -------
        ClosedLoopModel

        Raises
        ------
        ModelError
            If a file is missing, malformed or too large, names something that does not exist, or has what
            looks like a loop and is not understood.
        InputError
            If `root_joint` is not a joint model.
        """
        return cls(*urdf.read(path_or_xml, closures, root_joint, mimic, on_unknown, passive))

    @classmethod
    def from_pinocchio(
        cls,
        model: pin.Model,
        constraint_models: Iterable[Any] = (),
        actuated: Sequence[str] | None = None,
        couplings: Iterable[Coupling] = (),
        reference: Mapping[str, Any] | None = None,
    ) -> Self:
        """Take over a tree and constraint models that were made with Pinocchio.

        The tree is copied, and gets a frame at each end of each constraint. Baumgarte's parameters and the
        compliance of the constraints are left out: see `stabilisation` of `forward_dynamics`.

        Parameters
        ----------
        model : pin.Model
            The tree, or what has one as its `model`, such as a RobotWrapper.
        constraint_models : iterable
            `RigidConstraintModel` (3D or 6D), `PointAnchorConstraintModel`, `FrameAnchorConstraintModel`, or
            a `ConstraintModel` that holds one of the two.
        actuated : sequence of str, optional
            Names of the actuated joints; by default all with one degree of freedom that no coupling
            determines.
        couplings : iterable of Coupling
            Joints that follow others.
        reference : mapping of str to float or sequence of float, optional
            The configuration that says which assembly is meant, as in `Sidecar`.

        Returns
        -------
        ClosedLoopModel

        Raises
        ------
        ModelError
            If a constraint is of another kind, has an offset, a velocity or an acceleration of its own, or
            the tree is one that Pinocchio computes wrongly (joints that are not depth first).
        InputError
            If `model` is no tree of Pinocchio.
        """
        return cls(*pinocchio_models.read(model, constraint_models, actuated, couplings, reference))

    def copy(self) -> Self:
        """Return an independent copy, for other masses or gravity; instances can be pickled, too."""
        return type(self)(self.model.copy(), self.sidecar)

    def lock(self, joints: Mapping[str, Any] | Iterable[str] | str) -> Self:
        """Return the robot with some joints locked; its closures, couplings and other joints stay.

        Locked joints are no joints any more: what hung on them is part of the body before them. A model that
        keeps the joint, and the force that locks it, has a coupling ``Coupling(joint, None, (value,))``.

        Parameters
        ----------
        joints : mapping of str to float or sequence of float, or names
            Values by joint, as in `Sidecar.reference`; names alone for the values of the reference
            configuration.

        Returns
        -------
        ClosedLoopModel

        Raises
        ------
        ModelError
            If a joint does not exist, its values do not fit, no joint would be left, or a closure or coupling
            is broken that the joints left over cannot restore.
        """
        names, q = locked_at(self.model, joints, self.reference)
        return type(self)(*without(self.model, self.sidecar, names, q))

    def reduced(self, joints: Iterable[str]) -> Self:
        """Return the robot with only some of its joints; the others are locked as in the reference.

        Parameters
        ----------
        joints : iterable of str
            The joints to keep. They should close the loops: assemble a reference configuration first.

        Returns
        -------
        ClosedLoopModel

        Raises
        ------
        ModelError
            As `lock`; if no joint is kept.
        """
        kept = {joint_named(self.model, str(name), "reduced") for name in list(joints)}
        return self.lock([str(self.model.names[i]) for i in range(1, self.model.njoints) if i not in kept])
