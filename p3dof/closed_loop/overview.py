"""What a robot with loops can do where it is assembled: mobility, idle joints, what forces leave open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop.linear import RANK_TOLERANCE, Decomposition
from p3dof.closed_loop.loop_model import LoopModel

_OPEN = 1e-7
"""Size of an undetermined share of a multiplier, or of an idle motion in a joint, that counts."""


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
    J, rank = loop.closure_jacobian(q), loop.rank(q)
    U, _, Vt = np.linalg.svd(J, full_matrices=True)
    N = Vt[rank:].T
    actuation = Decomposition.of(N[loop.actuated_v], RANK_TOLERANCE, 1.0)
    still = np.abs(N @ actuation.null_space).max(axis=1, initial=0.0) > _OPEN
    model = loop.model
    idle = [i for i in range(1, model.njoints) if still[_freedoms(model, i)].any()]
    undetermined = np.abs(U[:, rank:]).max(axis=1, initial=0.0) > _OPEN
    return Overview(
        rank,
        model.nv - rank,
        actuation.rank,
        tuple(str(model.names[i]) for i in idle),
        undetermined,
    )


def _freedoms(model: pin.Model, joint: int) -> slice:
    return slice(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])
