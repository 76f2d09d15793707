"""A body's inertial parameters from a control loop: recursive least squares, as for a payload.

The forces of the motors are linear in the ten parameters φ of one body: tau = R(q, v, a) φ + rest(q, v, a) +
noise. φ is normally distributed about what is known before, with standard deviations s; each sample makes it
surer, and all of them together are the batch estimate (`estimate_parameters`, maximum a posteriori). With
z = (φ - φ₀) / s the covariance of z is kept as U D Uᵀ, U unit upper triangular and D diagonal: by Bierman's
update D stays positive at any number of roundings.

A forgetting factor β makes old samples count less, P⁻¹ → β P⁻¹ + (1 - β): what the prior knows is not
forgotten. The covariance never exceeds the prior's, and without excitation the estimate stays where it is.

References
----------
G. J. Bierman, Factorization Methods for Discrete Sequential Estimation, Academic Press 1977.
R. Kulhavý, M. B. Zarrop, On a general concept of forgetting, International Journal of Control 58(4), 1993.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import (
    LARGEST,
    SMALLEST,
    FloatArray,
    Readable,
    as_floats,
    frozen_array,
    positive,
    shown,
)
from p3dof._base.errors import InputError, ModelError
from p3dof.loops.closed_tree import External
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.kept import require_fit
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.observer import refused
from p3dof.loops.results import read_only


def payload_deviations(mass: float, reach: float) -> FloatArray:
    """Return how uncertain the inertial parameters of a body are that may carry a payload.

    Parameters
    ----------
    mass : float
        About what the payload weighs at most [kg].
    reach : float
        About how far from the origin of the body's joint it is at most [m].

    Returns
    -------
    ndarray, shape (10,)
        Standard deviations, in the order of Pinocchio, as `RecursiveEstimator` takes them.

    Raises
    ------
    InputError
        If a number is not positive.
    """
    m, r = positive("mass", mass, InputError), positive("reach", reach, InputError)
    first, second, product = m * r, m * r * r, m * r * r / 2
    return np.array([m, first, first, first, second, product, second, product, product, second])


@dataclass(frozen=True, eq=False)
class BodyEstimate(Readable):
    """Inertial parameters of a body or payload as they are known now.

    Parameters
    ----------
    parameters : (10,) array
        Mass [kg], first moments [kg m] and inertias [kg m²] about the origin of the joint that carries the
        body, in its axes, in the order of Pinocchio.
    covariance : (10, 10) array
        Of the parameters.
    """

    parameters: FloatArray
    covariance: FloatArray

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations of the parameters, (10,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.parameters[0])

    @property
    def mass_deviation(self) -> float:
        """Standard deviation of the mass [kg]."""
        return float(self.deviations[0])

    @property
    def centre(self) -> FloatArray:
        """Mass centre in the axes of the joint, (3,) [m]; NaN where the mass is not positive."""
        if not self.mass > 0.0:
            return np.full(3, np.nan)
        return np.asarray(self.parameters[1:4] / self.mass)

    @property
    def centre_deviations(self) -> FloatArray:
        """Standard deviations of the mass centre, to first order, (3,) [m]; NaN where it is."""
        J = np.column_stack([-self.centre, np.eye(3)]) / max(self.mass, np.finfo(float).tiny)
        return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", J, self.covariance[:4, :4], J)))


class UDFactors:
    """A mean z and its covariance U D Uᵀ: standard normal at first. Plain numbers, in the order of the C."""

    def __init__(self, size: int) -> None:
        self.z = [0.0] * size
        self.U = [[float(i == j) for j in range(size)] for i in range(size)]  # zeros below the diagonal
        self.D = [1.0] * size

    def forget(self, factor: float) -> None:
        """Let what was measured count less: the inverse covariance becomes factor P⁻¹ + (1 - factor)."""
        if factor < 1.0:
            size = len(self.z)
            self.D = [d / factor for d in self.D]
            for k in range(size):  # as if each entry were measured, where it is
                self.measure([float(i == k) for i in range(size)], 1.0 / (1.0 - factor), 0.0)

    def seen(self, h: Sequence[float], y: float) -> tuple[float, float]:
        """Return what a measurement y of h z has of new, and the variance of h z."""
        variance = 0.0
        for j, d in enumerate(self.D):
            f = 0.0
            for i in range(j + 1):
                f += self.U[i][j] * h[i]
            variance += f * d * f
        for x, factor in zip(self.z, h, strict=True):
            y -= factor * x
        return y, variance

    def measure(self, h: Sequence[float], noise: float, new: float) -> None:
        """Take a measurement of h z with a variance, of which `new` was not known (Bierman)."""
        U, D, gain, before = self.U, self.D, [0.0] * len(self.z), noise
        for j, d in enumerate(D):
            f = 0.0
            for i in range(j + 1):
                f += U[i][j] * h[i]
            v = d * f
            after = before + f * v
            D[j] = d * (before / after)
            share, gain[j] = -f / before, v
            for i in range(j):
                u = U[i][j]
                U[i][j] = u + gain[i] * share
                gain[i] += u * v
            before = after
        for i, g in enumerate(gain):
            self.z[i] += g * (new / before)

    def sample(
        self,
        rows: Sequence[Sequence[float]],
        values: Sequence[float],
        noise: Sequence[float],
        forgetting: float,
        gate: float,
    ) -> bool:
        """Take the measurements of a sample, unless one is beyond the gate; return whether it was taken.

        Time passes in both cases: what is forgotten lets a lasting change through the gate.
        """
        self.forget(forgetting)
        for h, y, deviation in zip(rows, values, noise, strict=True):
            new, variance = self.seen(h, y)
            if not abs(new) <= gate * sqrt(variance + deviation * deviation):
                return False
        for h, y, deviation in zip(rows, values, noise, strict=True):
            self.measure(h, deviation * deviation, self.seen(h, y)[0])
        return True

    def deviations(self) -> FloatArray:
        """Return the standard deviations of z."""
        return np.asarray(np.sqrt(np.square(self.U) @ np.array(self.D)))


class RecursiveEstimator:
    """Inertial parameters of one body, sample by sample; see `ClosedLoopModel.payload_estimator`.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot as designed.
    joint : str
        Joint that carries the body.
    noise : float or (m,) array
        Standard deviations of the motors' measured forces [N or N m]; errors of the model count, too.
    deviations : (10,) array
        Standard deviations of the parameters before the first sample, as of `payload_deviations`; zero keeps
        a parameter as it is.
    parameters : (10,) array, optional
        The parameters before the first sample; by default the design's.
    forgetting : float
        By what the weight of older samples is multiplied at each sample, above 0 and at most 1: none is
        forgotten. ``exp(-period / memory)`` for a memory in seconds.
    gate : float, optional
        A sample with a force farther from what is expected than this number of standard deviations is left
        out; by default none is.
    compiled : CompiledLoop, optional
        The robot compiled with the inertial parameters of this body as an argument, for where it works.

    Attributes
    ----------
    design : (10,) array
        The parameters of the design.
    samples, outliers : int
        How many samples were taken, and left out.

    Raises
    ------
    InputError
        If an argument does not fit, or `compiled` is of another robot or body.
    ModelError
        If there are more actuators than degrees of freedom: the motion does not determine their forces.
    """

    def __init__(
        self,
        loop: LoopModel,
        joint: str,
        noise: ArrayLike,
        deviations: ArrayLike,
        parameters: ArrayLike | None = None,
        forgetting: float = 1.0,
        gate: float | None = None,
        compiled: CompiledLoop | None = None,
    ) -> None:
        if compiled is None:
            compiled = CompiledLoop(loop, inertias=[joint])
        else:
            require_fit(loop, compiled, name="compiled")
            if [*compiled.robot.inertias] != [joint]:
                raise InputError(f"compiled: expected the robot compiled with inertias=[{joint!r}]")
        if not loop.actuated or not compiled.hybrid:
            raise ModelError(
                f"estimator: the motion does not determine the forces of {len(loop.actuated)} actuators"
            )
        self._loop, self._compiled, self.joint = loop, compiled, joint
        self.design: FloatArray = read_only(compiled.defaults[f"inertia_{joint}"])
        self._noise = _noise(noise, len(loop.actuated))
        self._spread = frozen_array("deviations", deviations, (10,))
        if (self._spread < 0.0).any() or not self._spread.any():
            raise InputError("deviations: expected zero or more, and one that is not zero")
        self._prior = self.design if parameters is None else frozen_array("parameters", parameters, (10,))
        self.forgetting = positive("forgetting", forgetting, InputError)
        if self.forgetting > 1.0:
            raise InputError(f"forgetting: expected at most 1, got {shown(forgetting)}")
        self.gate = inf if gate is None else positive("gate", gate, InputError)
        self._free = list(compiled.independent_places)
        self._bound, self._function = compiled.bind("body_regressor"), compiled.function("body_regressor")
        self.start()

    def __repr__(self) -> str:
        return f"RecursiveEstimator({self.joint}; {self.samples} samples, {self.outliers} left out)"

    def start(self) -> None:
        """Forget what was measured: only the prior is known."""
        self._factors, self.samples, self.outliers = UDFactors(10), 0, 0
        self.__dict__.pop("body", None)

    def update(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, forces: ArrayLike, external: External | None = None
    ) -> FloatArray:
        """Return the parameters after one more sample (10,).

        Parameters
        ----------
        q : (nq,) array
            Configuration, with closed loops.
        v, a : (nv,) array
            Velocities and accelerations; those of the independent coordinates count.
        forces : (n_actuated,) array
            Of the actuators at that time [N or N m].
        external
            Known wrenches, as of `CompiledLoop.inverse_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape, is not finite, or the loops are open.
        SingularityError
            If the independent coordinates do not determine the motion here.
        """
        model, m = self._loop.model, len(self._loop.actuated)
        load = self._compiled._load(1, external, None)
        given = {
            "q": frozen_array("q", q, (model.nq,)),
            "v_independent": frozen_array("v", v, (model.nv,))[self._free],
            "a_independent": frozen_array("a", a, (model.nv,))[self._free],
            **{name: value for name, value in load.items() if name in self._bound.inputs},
        }
        measured = frozen_array("forces", forces, (m,))
        for name, value in given.items():
            self._bound.inputs[name][:] = value
        self._bound.run()
        found = self._bound.outputs
        if not found["trusted"][0] > 0.0:
            gap, margin = found["gap"][0], found["margin"][0]
            refused("estimator", self._function, self._compiled.independent, gap, margin)
        R = found["regressor"].reshape(m, 10)
        values = (measured - found["rest"] - R @ self._prior).tolist()
        rows, noise = (R * self._spread).tolist(), self._noise.tolist()
        taken = self._factors.sample(rows, values, noise, self.forgetting, self.gate)
        self.samples, self.outliers = self.samples + taken, self.outliers + (not taken)
        self.__dict__.pop("body", None)
        return self.body.parameters

    @cached_property
    def body(self) -> BodyEstimate:
        """What is known of the body, with what it carries."""
        U = np.array(self._factors.U) * self._spread[:, None]
        covariance = (U * self._factors.D) @ U.T
        mean = self._prior + self._spread * self._factors.z
        return BodyEstimate(read_only(mean), read_only(covariance))

    @property
    def payload(self) -> BodyEstimate:
        """What is known of the payload: the body less that of the design."""
        return BodyEstimate(read_only(self.body.parameters - self.design), self.body.covariance)


def _noise(noise: ArrayLike, m: int) -> FloatArray:
    values = as_floats("noise", noise)
    if values.shape not in ((), (m,)) or not ((values >= SMALLEST) & (values <= LARGEST)).all():
        raise InputError(f"noise: expected a positive number or {m} of them, got {shown(noise)}")
    return np.broadcast_to(values, (m,)).copy()
