"""What writers ask of a robot: where the ends of its closures are, and a configuration that closes them."""

from __future__ import annotations

import warnings
from typing import TypeAlias

import pinocchio as pin

from p3dof._base.checks import FloatArray, one_line
from p3dof._base.errors import AssemblyError, ModelWarning
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.loop_model import LoopModel

End: TypeAlias = tuple[int, pin.SE3]
"""A joint, and where on its body a frame is."""


def frame_ends(loop: LoopModel) -> list[tuple[End, End]]:
    """Return where the two frames of every closure are.

    Parameters
    ----------
    loop : LoopModel
        The robot.

    Returns
    -------
    list of pairs
    """
    ends = LoopKinematics(loop.model, loop.sidecar).ends
    return [((int(one), at), (int(two), there)) for one, at, two, there in ends]


def closed_configuration(loop: LoopModel, target: str) -> FloatArray:
    """Return the reference configuration with closed loops.

    Parameters
    ----------
    loop : LoopModel
        The robot.
    target : str
        What is written, for the warning.

    Returns
    -------
    (nq,) array

    Warns
    -----
    ModelWarning
        If the loops do not close: the reference configuration as it is.
    """
    try:
        return loop.assemble().q
    except AssemblyError as error:
        message = f"{target}: the loops are open in what is written: {one_line(str(error))}"
        warnings.warn(message, ModelWarning, stacklevel=5)
        return loop.reference
