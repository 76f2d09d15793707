"""Which parameters of the legs a calibration from measured poses can find."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import InputError
from p3dof.analysis.tolerances.directions import AnyMachine, parameters_of
from p3dof.analysis.tolerances.pose import NAMES, checked_pose, pose_gradient
from p3dof.loops.identification.fitting import in_words, reduced
from p3dof.methods.regressor import MOMENTS

_DOUBTS = ("mass", "shift", "other")


@dataclass(frozen=True, eq=False)
class ParameterEstimate(Readable):
    """Parameters from measured forces."""

    parameters: FloatArray  # (P,): the most likely ones
    deviations: FloatArray
    """(P,): their standard deviations: where they are those of the prior, the forces told nothing."""
    residual: float
    """Root mean square of what is left of the forces; much more than the noise tells of something else
    than parameters, such as friction."""


def prior_deviations(
    names: Sequence[str], parameters: ArrayLike, mass: float = 0.1, shift: float = 5e-3, other: float = 0.1
) -> FloatArray:
    """Return how uncertain the inertial parameters of a design are, as standard deviations.

    Parameters
    ----------
    names : sequence of str
        ``body.m``, ``body.mx`` and so on, ten a body in the order of Pinocchio, as
        `ForceRegressor.inertial_names` and `LoopRegressor.parameter_names`; other names are those of joints.
    parameters : array-like, shape (P,)
        Of the design.
    mass : float
        Of masses, as a share of them; of inertias too.
    shift : float
        Of mass centres, in every direction [m].
    other : float
        Of all other parameters, as a share of them.

    Returns
    -------
    ndarray, shape (P,)
        Zero keeps a parameter as it is: masses of nothing, and other parameters that are zero.

    Raises
    ------
    InputError
        If an argument does not fit.
    """
    values = frozen_array("parameters", parameters, (len(names),))
    share, way, rest = (
        positive(name, one, InputError) for name, one in zip(_DOUBTS, (mass, shift, other), strict=True)
    )
    found: FloatArray = rest * np.abs(values)
    kinds = [str(name).rpartition(".")[2] for name in names]
    first = 0
    while first < len(kinds):
        if kinds[first] != "m":
            first += 1
            continue
        if tuple(kinds[first : first + 10]) != MOMENTS:
            raise InputError(f"names: expected {', '.join(MOMENTS)} of a body from {names[first]!r} on")
        m, moments, six = values[first], values[first + 1 : first + 4], values[first + 4 : first + 10]
        size = max(float(six[0] + six[2] + six[5]) / 2, 0.0)  # about a point: of all its mass
        found[first] = share * m
        found[first + 1 : first + 4] = np.hypot(share * moments, way * m)
        found[first + 4 : first + 10] = np.hypot(share * size, 2 * way * np.sqrt(max(m * size, 0.0)))
        first += 10
    return found


def estimate_parameters(
    regressor: ArrayLike, measured: ArrayLike, prior: ArrayLike, deviations: ArrayLike, noise: float
) -> ParameterEstimate:
    """Return the most likely parameters, given measured forces and a design.

    Parameters
    ----------
    regressor : array-like, shape (..., P)
        Derivatives of the forces by the parameters, as `ForceRegressor.inertial` and `LoopRegressor.forces`.
    measured : array-like, shape (...)
        The forces, less what the parameters do not explain, such as known friction and loads [N or N m].
    prior, deviations : array-like, shape (P,)
        Parameters of the design, and their standard deviations; zero keeps a parameter as it is.
    noise : float
        Standard deviation of a measured force [N or N m].

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, a deviation is negative, or the noise not positive.
    """
    given = as_floats("regressor", regressor)
    if given.ndim < 2:
        raise InputError(f"regressor: expected shape (..., P), got {given.shape}")
    size = given.shape[-1]
    A = frozen_array("regressor", given.reshape(-1, size), ("N", size))
    forces = as_floats("measured", measured)
    if forces.shape != given.shape[:-1]:
        raise InputError(f"measured: expected shape {given.shape[:-1]}, got {forces.shape}")
    b = frozen_array("measured", forces.ravel(), ("N",))
    design = frozen_array("prior", prior, (size,))
    doubt = frozen_array("deviations", deviations, (size,))
    if (doubt < 0).any():
        raise InputError("deviations: expected zero or more")
    sigma = positive("noise", noise, InputError)
    # In units of the doubts: (SᵀS + 1) z = Sᵀ r / σ, by the singular values of S.
    U, s, Vt = np.linalg.svd(A * doubt / sigma, full_matrices=False)
    right = U.T @ ((b - A @ design) / sigma)
    z = Vt.T @ (s / (s**2 + 1) * right)
    told = np.einsum("ki,k->i", Vt**2, s**2 / (s**2 + 1))
    found = design + doubt * z
    left = b - A @ found
    return ParameterEstimate(
        found, doubt * np.sqrt(np.maximum(1 - told, 0.0)), float(np.sqrt(np.mean(left**2)))
    )


_NONE = 1e-10  # share of the largest singular value below which one is zero


@dataclass(frozen=True, eq=False)
class Identifiability(Readable):
    """What measured poses tell of the parameters of the legs."""

    rank: int  # how many combinations of the twelve parameters they tell
    condition: float
    """Largest over smallest singular value of these, columns scaled to one: errors of measured poses grow
    by so much at worst."""
    singular_values: FloatArray  # (12,): of the scaled columns
    unseen: tuple[str, ...]
    """Combinations that change no pose, such as `R.a + r.a`: these parameters grow together."""
    null_space: FloatArray
    """(12 - rank, 12): the same as numbers, in the order of `R.a, r.a, L.a, encoder.a, R.b`."""


def identifiability(robot: AnyMachine, pose: ArrayLike) -> Identifiability:
    """Return which parameters of the legs a calibration from measured poses can find.

    Sliders are read, the pose of the platform is measured: each pose tells three numbers.

    Parameters
    ----------
    robot : Manipulator, Parameters or None
        The nominal machine; the paper's for None.
    pose : array-like, shape (K, 3)
        Where it is measured: y [m], z [m], θ [rad].

    Raises
    ------
    InputError
        If there are less than four poses, which could not tell twelve numbers.
    ReachError, SingularityError
        If the machine cannot be at a pose.
    """
    geometry = parameters_of(robot).geometry
    poses = checked_pose(geometry, pose).reshape(-1, 3)
    if len(poses) < 4:
        raise InputError(f"pose: expected four poses or more for twelve parameters, got {len(poses)}")
    rows = pose_gradient(geometry, poses).reshape(-1, len(NAMES))
    sizes = np.linalg.norm(rows, axis=0)
    _, values, directions = np.linalg.svd(rows / sizes, full_matrices=False)
    rank = int((values > _NONE * values[0]).sum())
    null = reduced(directions[rank:] / sizes)
    words = tuple(in_words(row, NAMES) for row in null)
    return Identifiability(rank, float(values[0] / values[rank - 1]), values, words, null)
