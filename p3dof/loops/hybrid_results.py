"""What hybrid dynamics returns: forces and motion at once, evidence when it is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops.closures import ClosurePoint, max_abs
from p3dof.loops.results import ActuatedForces


class PrescribedMotion(ActuatedForces):
    """What closures have to bear where accelerations are prescribed; also see `ActuatedForces`.

    Parameters
    ----------
    actuated_v : (n_actuated,) array of int
        Indices of the actuated joints in v.
    prescribed : (size, nv) array
        S, the matrix from accelerations to the prescribed ones.
    errors : tuple of (rows,) and (size,) array
        What is left of accelerations at the closures, and of the prescribed ones.
    """

    def __init__(
        self,
        point: ClosurePoint,
        force: FloatArray,
        actuated_v: NDArray[np.int_],
        prescribed: FloatArray,
        errors: tuple[FloatArray, FloatArray],
    ) -> None:
        super().__init__(point, force, actuated_v)
        self.opening, self.off = errors
        self._prescribed = prescribed

    @property
    def prescribed_residual(self) -> float:
        """The largest error of a prescribed acceleration."""
        return max_abs(self.off) * max(1.0, self._length)

    @property
    def closure_residual(self) -> float:
        """The largest relative acceleration that is left at a closure."""
        return max_abs(self.opening) * max(1.0, self._length)

    @cached_property
    def prescribed_conditioning(self) -> float:
        """The smallest singular value of S N; one without any."""
        s = np.linalg.svd(self._prescribed @ self.point.svd.null_space, compute_uv=False)
        return float(s[-1]) if s.size else 1.0


@dataclass(frozen=True, eq=False)
class HybridDynamics:
    """Actuator forces that produce prescribed accelerations, the motion with them, and the evidence.

    Parameters
    ----------
    tau : (n_actuated,) array
        Forces of the actuated joints [N or N m]; the smallest possible if they are not unique.
    a : (nv,) array
        Acceleration of the whole tree: as prescribed, and of the idle freedoms what follows.
    evidence : PrescribedMotion
        What all other attributes ask: it is found out when it is asked for, from what the call has stored.
    """

    tau: FloatArray
    a: FloatArray
    evidence: PrescribedMotion

    @property
    def prescribed_residual(self) -> float:
        """Largest error of a prescribed acceleration [m/s² or rad/s²]."""
        return self.evidence.prescribed_residual

    @property
    def closure_residual(self) -> float:
        """Largest relative acceleration that is left at a closure, J a + J̇ v [m/s² or rad/s²]."""
        return self.evidence.closure_residual

    @property
    def lambda_(self) -> FloatArray:
        """Multipliers of closures and couplings (rows,), as in `InverseDynamics`."""
        return self.evidence.lambda_

    @property
    def unique(self) -> NDArray[np.bool_]:
        """Which multipliers are determined, (rows,) array of bool."""
        return self.evidence.unique

    @property
    def tau_unique(self) -> bool:
        """Whether `tau` is determined, as in `InverseDynamics`."""
        return self.evidence.tau_unique

    @property
    def rank(self) -> int:
        """Rank of the closures' Jacobian."""
        return self.evidence.rank

    @property
    def mobility(self) -> int:
        """Free motions of the closed mechanism: nv - rank."""
        return self.evidence.mobility

    @property
    def conditioning(self) -> float:
        """Smallest singular value of Nᵀ B, as in `InverseDynamics`."""
        return self.evidence.conditioning

    @property
    def prescribed_conditioning(self) -> float:
        """Smallest singular value of S N: how well the prescribed accelerations are seen.

        S picks them, and N are the orthonormal free motions. It is 0 where they cannot be chosen freely.
        Where those of the actuated joints are prescribed it is the `conditioning`.
        """
        return self.evidence.prescribed_conditioning

    @property
    def residual(self) -> float:
        """Largest error of the full equation of motion [N or N m]."""
        return self.evidence.residual

    @property
    def gap(self) -> float:
        """Largest closure error of the configuration [m or rad]."""
        return self.evidence.gap
