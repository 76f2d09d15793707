"""Rank, null space and least-norm solutions of one matrix, from one singular value decomposition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof.checks import FloatArray

RANK_TOLERANCE = 1e-9
"""Singular values below this fraction of the largest count as zero.

An assembled configuration closes its loops to 1e-12 or better, which is also the size of the singular values
that should be zero; the smallest that matter in a working machine are above 1e-4. The rows of a closure's
Jacobian mix metres and radians, so the fraction has no exact meaning: the room on either side makes that
harmless for machines of about the size of the unit of length; see `p3dof.closed_loop.units`.
"""


@dataclass(frozen=True, eq=False)
class Decomposition:
    """A matrix A (m, n) as U diag(s) Vᵀ, with its numerical rank.

    Parameters
    ----------
    U : (m, m) array
        Left singular vectors; the columns from `rank` on span the null space of Aᵀ.
    s : (min(m, n),) array
        Singular values, largest first.
    Vt : (n, n) array
        Right singular vectors; the rows from `rank` on span the null space of A.
    rank : int
        The numerical rank.
    """

    U: FloatArray
    s: FloatArray
    Vt: FloatArray
    rank: int

    @classmethod
    def of(
        cls, A: FloatArray, relative: float = RANK_TOLERANCE, largest: float | None = None
    ) -> Decomposition:
        """Decompose a matrix.

        Parameters
        ----------
        A : (m, n) array
            The matrix; m or n may be zero.
        relative : float
            Singular values up to this fraction of `largest` count as zero.
        largest : float, optional
            What to compare with; by default the largest singular value.

        Returns
        -------
        Decomposition
        """
        U, s, Vt = np.linalg.svd(A)
        reference = largest if largest is not None else (s[0] if s.size else 0.0)
        return cls(U, s, Vt, int(np.count_nonzero(s > relative * reference)))

    @property
    def null_space(self) -> FloatArray:
        """Orthonormal basis of the vectors that A maps to zero, (n, n - rank)."""
        return self.Vt[self.rank :].T

    @property
    def pseudo_inverse(self) -> FloatArray:
        """The matrix (n, m) of `solve`."""
        r = self.rank
        return (self.Vt[:r].T / self.s[:r]) @ self.U[:, :r].T

    def solve(self, b: FloatArray) -> FloatArray:
        """Return the shortest x (n,) that minimises |A x - b|, for b (m,)."""
        r = self.rank
        return ((self.U[:, :r].T @ b) / self.s[:r]) @ self.Vt[:r]

    def solve_transpose(self, f: FloatArray) -> FloatArray:
        """Return the shortest y (m,) that minimises |Aᵀ y - f|; f is (n,), or (n, k) for k of them."""
        r = self.rank
        return (self.U[:, :r] / self.s[:r]) @ (self.Vt[:r] @ f)
