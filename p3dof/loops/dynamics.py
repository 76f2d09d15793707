"""`Dynamics`: inverse, forward and hybrid dynamics of one model."""

from __future__ import annotations

import numpy as np

from p3dof.loops.closures import LoopKinematics
from p3dof.loops.forward import Forward
from p3dof.loops.hybrid import Hybrid
from p3dof.loops.inverse import Inverse
from p3dof.loops.terms import Terms


class Dynamics(Terms):
    """The dynamics of one model, which remembers what was of use at the last sample of the thread.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model and its closures.
    actuated_v : (n_actuated,) array of int
        Indices of the actuated joints in v.
    """

    def __init__(self, kinematics: LoopKinematics, actuated_v: np.ndarray) -> None:
        super().__init__(kinematics, actuated_v)
        self.inverse = Inverse(self)
        self.forward = Forward(self)
        self.hybrid = Hybrid(self)
