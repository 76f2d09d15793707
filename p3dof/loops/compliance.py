"""How joints give way: what decides the reactions that rigid bodies leave open.

Joints and links that are linearly elastic, and not stressed when they were assembled, share a load so that
their complementary energy ½ Σ wᵀ C w is smallest, over all reactions w that Newton's and Euler's equations
allow (Castigliano's second theorem, or Menabrea's principle of least work). An assembly error δ, by which
joints would have to be forced together, adds H δ with H = G (Gᵀ C G)⁻¹ Gᵀ, where the columns of G are the
changes of the reactions that rigid bodies leave open.

Compliances along the freedoms of a joint may be anything: no change of the reactions acts along them. What a
joint exerts along them, its friction, is part of w all the same: it bends the links before the joint.

References
----------
S. P. Timoshenko, Strength of Materials, part 1, chapter on strain energy (principle of least work).
M. Wojtyra and J. Fraczek, Comparison of selected methods of handling redundant constraints in multibody
systems simulations, Journal of Computational and Nonlinear Dynamics 8 (2013) 021007.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable, frozen_array
from p3dof._base.errors import ModelError

_SYMMETRIC = 1e-9


@dataclass(frozen=True, eq=False)
class JointCompliance(Readable):
    """How a joint, and a link before it, give way under the wrench that it transmits.

    A compliance matrix (6, 6) takes a wrench (force, moment) to a small displacement (shift, turn) of its
    point of action: blocks [m/N], [m/(N m)], [rad/N], [rad/(N m)].

    Parameters
    ----------
    own : (6, 6) array
        In the axes of the reaction, at its point.
    before : (6, 6) array, optional
        Of the link before the joint, at the same point, in the axes of the predecessor's body; they turn
        against those of the reaction. Of a closure both are the axes of ``frame1``.

    Raises
    ------
    ModelError
        If a matrix is not finite, not symmetric, or has a negative eigenvalue.
    """

    own: FloatArray
    before: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "own", _checked("own", self.own))
        if self.before is not None:
            object.__setattr__(self, "before", _checked("before", self.before))

    @classmethod
    def of_stiffness(
        cls, forces: ArrayLike, moments: ArrayLike, before: ArrayLike | None = None
    ) -> JointCompliance:
        """Return that of a joint that gives way along its axes only.

        Parameters
        ----------
        forces : (3,) array
            Stiffness against shifting along x, y, z of the reaction's axes [N/m]; infinity is rigid.
        moments : (3,) array
            Stiffness against turning about them [N m/rad].
        before : (6, 6) array, optional
            As of the class.

        Raises
        ------
        ModelError
            If a stiffness is not positive.
        """
        stiffness = np.concatenate([np.asarray(forces, dtype=float), np.asarray(moments, dtype=float)])
        if stiffness.shape != (6,) or not (stiffness > 0).all():
            raise ModelError(f"stiffness: expected 3 + 3 positive numbers, got {stiffness}")
        return cls(np.diag(1.0 / stiffness), None if before is None else np.asarray(before, dtype=float))


def beam(
    length: float, area: float, bending: float, torsion: float, young: float, shear: float
) -> FloatArray:
    """Return the compliance (6, 6) at the tip of a slender beam, held at its other end [m/N, rad/(N m), 1/N].

    The beam lies along x, its tip on the side of +x; shear deformation is left out (Bernoulli's beam).

    Parameters
    ----------
    length : float
        [m]
    area : float
        Of the cross-section [m^2].
    bending, torsion : float
        Second moments of the cross-section about y and z, which are alike, and about x [m^4].
    young, shear : float
        Elastic moduli E and G [Pa].
    """
    stiff = young * bending
    C = np.zeros((6, 6))
    C[0, 0] = length / (young * area)
    C[1, 1] = C[2, 2] = length**3 / (3 * stiff)
    C[3, 3] = length / (shear * torsion)
    C[4, 4] = C[5, 5] = length / stiff
    C[1, 5] = C[5, 1] = length**2 / (2 * stiff)
    C[2, 4] = C[4, 2] = -(length**2) / (2 * stiff)
    return C


def factor(compliance: FloatArray) -> FloatArray:
    """Return S with Sᵀ S = C; ndarray, shape (6, 6)."""
    scale = _scales(compliance)
    values, vectors = np.linalg.eigh(compliance / np.outer(scale, scale))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale)


def _checked(name: str, matrix: ArrayLike) -> FloatArray:
    C = frozen_array(name, matrix, (6, 6), ModelError)
    scale = _scales(C)
    scaled = C / np.outer(scale, scale)
    if (np.diagonal(C) < 0).any() or np.abs(scaled - scaled.T).max() > _SYMMETRIC:
        raise ModelError(f"{name}: expected a symmetric matrix of compliances that are not negative")
    if np.linalg.eigvalsh((scaled + scaled.T) / 2).min() < -_SYMMETRIC:
        raise ModelError(f"{name}: a load would gain energy: the matrix has a negative eigenvalue")
    return C


def _scales(C: FloatArray) -> FloatArray:
    """Return what makes forces and moments comparable; 1 where nothing gives way."""
    diagonal = np.sqrt(np.abs(np.diagonal(C)))
    return np.asarray(np.where(diagonal > 0, diagonal, 1.0))
