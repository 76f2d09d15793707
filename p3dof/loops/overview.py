"""What a robot with loops can do where it is assembled: mobility, idle joints, what forces leave open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops.linear import UNIQUE, actuation_of
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.results import determined


@dataclass(frozen=True, eq=False)
class Overview:
    """What a robot can do at a configuration.

    Parameters
    ----------
    rank, mobility : int
        Rank of the closures' Jacobian, and nv - rank.
    held : int
        How many of the free motions the actuators see, at most `mobility`.
    idle : tuple of str
        Joints that can move while all actuated joints stand still.
    undetermined : (rows,) array of bool
        Which multipliers of closures and couplings no force determines: the closures are redundant.
    """

    rank: int
    mobility: int
    held: int
    idle: tuple[str, ...]
    undetermined: np.ndarray


def overview(loop: LoopModel, q: FloatArray) -> Overview:
    """Return what a robot can do at a configuration.

    Parameters
    ----------
    loop : LoopModel
        The robot.
    q : (nq,) array
        A configuration with closed loops.

    Returns
    -------
    Overview

    Raises
    ------
    InputError
        If `q` has the wrong shape, is not finite or not normalised.
    """
    core, own = (loop, q) if loop._scaled is None else (loop._scaled.core, loop._scaled.q(q))
    svd = core._at(own).svd
    actuation = actuation_of(svd, loop.actuated_v)
    unseen = actuation.U[:, actuation.rank :]
    still = np.abs(svd.null_space @ unseen).max(axis=1, initial=0.0) > UNIQUE
    model = loop.model
    idle = [i for i in range(1, model.njoints) if still[_freedoms(model, i)].any()]
    return Overview(
        svd.rank,
        model.nv - svd.rank,
        actuation.rank,
        tuple(str(model.names[i]) for i in idle),
        ~determined(svd, None, loop.actuated_v),
    )


def _freedoms(model: pin.Model, joint: int) -> slice:
    return slice(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])
