"""Whether identified parameters are to be used: prediction on held-out data, tests of residuals and prior.

References
----------
L. Ljung, System Identification, Prentice Hall 1999, chapter 16 (validation on other
data, tests of residuals).
G. M. Ljung, G. E. P. Box, On a measure of lack of fit in time series models, Biometrika 65 (1978) 297-303.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable, frozen_array
from p3dof._base.tables import Columns, Table, Tabular, formatted, percent, table_of
from p3dof._base.time_series.smoothing import Smooth
from p3dof.loops.identification.data import OFFSET, Delay, ForcesFit, Period, PreparedLog, prepare_log
from p3dof.loops.identification.estimates import EstimationMethod, ParameterEstimate, estimate_parameters
from p3dof.loops.identification.forces import IdentifiableForces, Rows, bodies_of, require_possible
from p3dof.loops.identification.logs import MotorLog, beyond_limits, excitation_told

_INFORMED = 4.0
"""Information of a combination over the prior's from which it tests the prior."""


@dataclass(frozen=True, eq=False)
class Identification(Tabular):
    """Parameters of a robot from a log; see `identify`.

    Parameters
    ----------
    forces : IdentifiableForces
        The robot as designed.
    data : PreparedLog
        What was measured.
    estimate : ParameterEstimate
        Of the P parameters, and then of m offsets of force sensors if they were asked for.
    prior : (P,) array
        Standard deviations about the design, as they were given.
    prior_factor, prior_share : float
        By what the combinations that the forces show differ from the design, over what the prior expects
        (rms), and how probable so much or so little is if the prior is right.
    remarks : tuple of str
        What to know, and what to do.
    """

    _row_name = "parameter"

    forces: IdentifiableForces
    data: PreparedLog
    estimate: ParameterEstimate
    prior: FloatArray
    prior_factor: float
    prior_share: float
    remarks: tuple[str, ...]

    def to_columns(self) -> Columns:
        """Return the parameters with units, as designed and as identified, (P,) each; one a row."""
        forces = self.forces
        return {
            "parameter": np.array(forces.names),
            "unit": np.array([unit_of(name, forces) for name in forces.names]),
            "design": forces.design,
            "identified": self.parameters,
            "deviation": self.deviations,
            "prior": self.prior,
            "seen": self.seen,
        }

    @property
    def parameters(self) -> FloatArray:
        """The P parameters of the robot."""
        return self.estimate.parameters[: len(self.forces.names)]

    @property
    def deviations(self) -> FloatArray:
        """Their standard deviations (P,)."""
        return self.estimate.deviations[: len(self.forces.names)]

    @property
    def seen(self) -> FloatArray:
        """How much of each parameter's doubt the forces removed (P,), from 0 to 1."""
        return self.estimate.seen[: len(self.forces.names)]

    @property
    def offsets(self) -> FloatArray:
        """Of the force sensors (m,) [N or N m]; zero where they were not asked for."""
        found = self.estimate.parameters[len(self.forces.names) :]
        return found if len(found) else np.zeros(len(self.forces.actuators))

    @cached_property
    def robot(self) -> Any:
        """The same robot with these parameters."""
        return self.forces.corrected(self.parameters)


def with_offsets(rows: Rows) -> FloatArray:
    """Return the columns (N, m, P + m) of the parameters and of offsets of the sensors."""
    N, m = rows.known.shape
    return np.concatenate([rows.columns, np.broadcast_to(np.eye(m), (N, m, m))], axis=-1)


def identify(
    forces: IdentifiableForces,
    log: MotorLog,
    *,
    deviations: ArrayLike | None = None,
    method: EstimationMethod = "map",
    widths: Literal["given", "estimated"] = "given",
    consistent: bool = True,
    offsets: bool = False,
    period: Period = "auto",
    smooth: Smooth = "auto",
    delay: Delay = "auto",
    check: bool = True,
) -> Identification:
    """Estimate the parameters of a robot from a log of its motors.

    Parameters
    ----------
    forces : IdentifiableForces
        The robot as designed: ``LoopForces(robot)``, ``MachineForces(machine)``.
    log : MotorLog
        Of its actuators; an exciting motion.
    deviations : array-like, shape (P,), optional
        Prior: standard deviations about the design; by default ``forces.deviations()``.
    method, widths, consistent
        As of `estimate_parameters`.
    offsets : bool
        Whether force sensors have constant offsets, to be estimated too. Weight and offset are told apart by
        the prior alone where the robot's weight hardly changes.
    period, smooth, delay
        As of `prepare_log`.
    check : bool
        Whether to raise where columns seem to be exchanged, turned round or in another unit.

    Raises
    ------
    InputError
        If the log cannot be used, or its columns seem wrong; the message says what to do.
    P3dofError
        If the robot cannot be in a position of the log.
    """
    count, m = len(forces.names), len(forces.actuators)
    prior = forces.deviations() if deviations is None else frozen_array("deviations", deviations, (count,))
    for first in bodies_of(forces.names) if consistent else ():
        if prior[first : first + 10].any():
            require_possible(f"{forces.names[first][:-2]} in the design", forces.design[first : first + 10])
    data = prepare_log(forces, log, period=period, smooth=smooth, delay=delay, deviations=prior, check=check)
    columns, design, doubt, names = data.rows.columns, forces.design, prior, tuple(forces.names)
    if offsets:
        columns = with_offsets(data.rows)
        design = np.concatenate([design, np.zeros(m)])
        doubt = np.concatenate([prior, OFFSET * np.sqrt((data.forces**2).mean(axis=0))])
        names += tuple(f"{name}.offset" for name in forces.actuators)
    columns, rest = _whatever_the_delay(data, columns)
    estimate = estimate_parameters(
        columns, rest, design, doubt, data.fit_noise,
        method=method, widths=widths, names=names, consistent=consistent,
    )  # fmt: skip
    fit = ForcesFit(
        data.rows, forces.design, prior, data.fit_noise, doubt[count:] if offsets else np.zeros(m)
    )
    factor, share = fit.against_prior(data.forces, _INFORMED)
    remarks = [
        *data.remarks,
        *beyond_limits(forces, data.states, data.time),
        *excitation_told(data.rows, prior, data.fit_noise),
        *estimate.remarks,
    ]
    return Identification(forces, data, estimate, prior, factor, share, tuple(remarks))


def _whatever_the_delay(data: PreparedLog, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return columns and measured forces less what of them another delay would explain.

    Estimates and their doubts are then those with the delay as one more parameter (Frisch and Waugh).
    """
    slope, rest = data.slope / data.fit_noise, data.forces - data.rows.known
    weight = slope / data.fit_noise / ((slope**2).sum() or 1.0)
    shares = np.einsum("nj,njp->p", weight, columns)
    return columns - data.slope[..., None] * shares, rest - data.slope * (weight * rest).sum()


_GAIN = 0.98
"""Error over the design's up to which an estimate is better."""
_LAGS = 20
_SURE = 1e-3
"""Probability below which the prior is said to be wrong."""
_NARROW, _WIDE = 2.5, 0.4
"""Factors from which it is worth saying."""
_LACKING = 4.0
"""Chi-square over its expectation from which the model lacks something."""


@dataclass(frozen=True, eq=False)
class Validation(Readable):
    """How an identified robot predicts the forces of a log that it was not identified from.

    Parameters
    ----------
    identification : Identification
        What is validated.
    data : PreparedLog
        The held-out log.
    residuals, design_residuals : (N, m) array
        Measured less predicted forces, and those of the design [N or N m].
    error, design_error, size : (m,) array
        Root mean square of the residuals, of the design's, and of the forces [N or N m].
    whiteness : (m,) array
        Probability of residuals as correlated as these, if the model were right and noise white (Ljung-Box,
        over the samples that filters leave independent).
    chi_square : float
        Mean square of the residuals over their predicted variance, noise and doubts of the parameters: one
        if all is well.
    better : bool
        Whether to use it.
    verdict : str
        The same in a sentence.
    remarks : tuple of str
        What else to know, and what to do.
    """

    identification: Identification
    data: PreparedLog
    residuals: FloatArray
    design_residuals: FloatArray
    error: FloatArray
    design_error: FloatArray
    size: FloatArray
    whiteness: FloatArray
    chi_square: float
    better: bool
    verdict: str
    remarks: tuple[str, ...]


def validate(
    identification: Identification,
    log: MotorLog,
    *,
    period: Period = "auto",
    smooth: Smooth = "auto",
    check: bool = True,
) -> Validation:
    """Predict the forces of a log that the parameters were not identified from.

    Parameters
    ----------
    identification : Identification
        From another log.
    log : MotorLog
        A motion like those that the robot is used for.
    period, smooth, check
        As of `prepare_log`; the delay is the one that was identified.

    Raises
    ------
    P3dofError
        As of `prepare_log`.
    """
    forces = identification.forces
    data = prepare_log(
        forces, log, period=period, smooth=smooth, delay=identification.data.delay,
        deviations=identification.prior, check=check,
    )  # fmt: skip
    measured = data.forces - data.rows.known
    residuals = measured - data.rows.columns @ identification.parameters - identification.offsets
    design = measured - data.rows.columns @ forces.design
    design = design - design.mean(axis=0) if identification.offsets.any() else design
    error, before, size = (np.sqrt((x**2).mean(axis=0)) for x in (residuals, design, data.forces))
    total, total_before = (float(np.sqrt(((x / size) ** 2).mean())) for x in (error, before))
    better = total <= _GAIN * total_before
    whitened = _whitened(identification, data, residuals)
    chi_square = float((whitened**2).mean())
    white = np.array([ljung_box(x[some]) for x, some in zip(whitened.T, data.independent.T, strict=True)])
    remarks = [*data.remarks, *_prior_told(identification)]
    if chi_square > _LACKING:
        remarks.append(
            f"errors on held-out data are {np.sqrt(chi_square):.2g} times those predicted by noise "
            "and doubts: the "
            "model lacks something (elasticity, backlash, friction that depends on load or temperature)"
        )
    told = _in_units(error, before, forces.force_units)
    start = "Better than the design" if better else "Do not use: not better than the design"
    return Validation(
        identification, data, residuals, design, error, before, size, white, chi_square, better,
        f"{start} on held-out data: {told}.", tuple(remarks),
    )  # fmt: skip


def _in_units(error: FloatArray, before: FloatArray, units: tuple[str, ...]) -> str:
    found = []
    for unit in dict.fromkeys(units):
        own = np.array([one == unit for one in units])
        now, then = (float(np.sqrt((x[own] ** 2).mean())) for x in (error, before))
        found.append(f"{now:.3g} {unit} rms instead of {then:.3g}")
    return ", ".join(found)


def _whitened(identification: Identification, data: PreparedLog, residuals: FloatArray) -> FloatArray:
    """Return (noise + A Σ Aᵀ)^-1/2 r, (N, m): white if all is well, doubts of the parameters included.

    With B = noise^-1/2 A Σ^1/2 and BᵀB = V diag(s² - 1) Vᵀ, it is (1 - B V diag(1 / (s + s²)) Vᵀ Bᵀ) r.
    """
    P = len(identification.forces.names)
    w, V = np.linalg.eigh(identification.estimate.covariance[:P, :P])
    keep = w > 1e-14 * max(float(w.max(initial=0.0)), 1e-300)
    B = (data.rows.columns @ (V[:, keep] * np.sqrt(w[keep]))) / data.noise[:, None]
    B, r = B.reshape(-1, B.shape[-1]), (residuals / data.noise).ravel()
    seen, V = np.linalg.eigh(B.T @ B)
    s = np.sqrt(1 + np.maximum(seen, 0.0))
    return np.asarray(r - B @ (V @ ((V.T @ (B.T @ r)) / (s + s**2)))).reshape(residuals.shape)


def ljung_box(values: FloatArray, lags: int = _LAGS) -> float:
    """Return the probability of values (N,) as correlated as these, if they were white noise."""
    from scipy.stats import chi2

    x, n = values - values.mean(), len(values)
    k = np.arange(1, max(1, min(lags, n // 5)) + 1)
    size = float(x @ x)
    if size == 0:
        return 1.0
    correlation = np.array([x[lag:] @ x[:-lag] for lag in k]) / size
    return float(chi2.sf(n * (n + 2) * (correlation**2 / (n - k)).sum(), len(k)))


def _prior_told(found: Identification) -> list[str]:
    """Return a line if the prior contradicts what the forces show."""
    factor, share = found.prior_factor, found.prior_share
    if not share < _SURE:
        return []
    if factor > _NARROW:
        return [
            f"the prior is too narrow: what the forces show differs from the design by {factor:.2g} "
            "times what it expects; widen it, or look for an error of the design"
        ]
    if factor < _WIDE:
        return [
            f"the prior is too wide: what the forces show differs from the design by {factor:.2g} of "
            "what it expects; narrow it, and parameters that the forces hardly show become surer"
        ]
    return []


def validation_table(found: Validation) -> Table:
    """Return the errors of each actuator on held-out data."""
    forces = found.identification.forces
    rows = {
        name: (unit, size, before, now, percent(now / size), formatted(p, ".2g"))
        for name, unit, size, before, now, p in zip(
            forces.actuators, forces.force_units, found.size, found.design_error, found.error,
            found.whiteness, strict=True,
        )
    }  # fmt: skip
    header = ("", "unit", "force rms", "design's error", "error", "of the force", "white (p)")
    note = (
        f"Mean square of the errors over their predicted variance: {found.chi_square:.3g} (1 if all is well)."
    )
    return table_of("Held-out data", header, rows, note)


def parameters_table(found: Identification, all_of_them: bool = False) -> Table:
    """Return the parameters that the forces showed, in words, with standard deviations."""
    forces, rows = found.forces, {}
    for i in np.argsort(-found.seen, kind="stable"):
        if not all_of_them and found.seen[i] < 0.1:
            break
        rows[in_words(forces.names[i])] = (
            unit_of(forces.names[i], forces),
            *(formatted(x, ".4g") for x in (forces.design[i], found.parameters[i], found.deviations[i])),
            percent(float(found.seen[i]), 0),
        )
    header = ("parameter", "unit", "design", "identified", "standard deviation", "seen")
    note = (
        "Seen: how much of the doubt about it the forces removed. Others stay near the design; "
        "forces need not show single bodies, combinations of them do for predictions."
    )
    return table_of("Parameters that the forces show", header, rows, note, "list")


def combinations_table(found: Identification) -> Table:
    """Return the combinations of parameters that the forces show."""
    each = found.estimate.combinations
    rows = {words: (formatted(value, ".5g"), formatted(spread, ".2g")) for words, value, spread in each}
    return table_of("Combinations that the forces show", ("combination", "value", "standard deviation"), rows,
                    layout="list")  # fmt: skip


_WORDS = {
    "m": "mass",
    "mx": "first moment along x",
    "my": "first moment along y",
    "mz": "first moment along z",
    "Ixx": "inertia xx",
    "Ixy": "inertia xy",
    "Iyy": "inertia yy",
    "Ixz": "inertia xz",
    "Iyz": "inertia yz",
    "Izz": "inertia zz",
    "armature": "rotor inertia, reflected",
    "damping": "viscous friction",
    "friction": "Coulomb friction",
    "stiffness": "stiffness",
    "spring": "spring",
    "preload": "constant force that resists",
    "counterbalance": "counterbalance",
    "stribeck": "Stribeck friction",
    "load_friction": "friction by load",
    "constant": "error of the motor constant",
    "offset": "offset of the force",
}
_UNITS = {"m": "kg", "mx": "kg m", "my": "kg m", "mz": "kg m"}


def in_words(name: str) -> str:
    """Return a parameter's name in words."""
    body, _, what = name.rpartition(".")
    return f"{body}: {_WORDS.get(what, what)}"


def unit_of(name: str, forces: object) -> str:
    """Return the unit of a parameter."""
    owner, _, what = name.rpartition(".")
    actuators: tuple[str, ...] = getattr(forces, "actuators", ())
    if what in _UNITS or what.startswith("I"):
        return _UNITS.get(what, "kg m²")
    slides = owner in getattr(forces, "sliding", ()) or (
        owner in actuators and forces.force_units[actuators.index(owner)] == "N"  # type: ignore[attr-defined]
    )
    turned = {
        "armature": ("kg m²", "kg"), "damping": ("N m s/rad", "N s/m"), "friction": ("N m", "N"),
        "stiffness": ("N m/rad", "N/m"), "spring": ("N m/rad", "N/m"), "preload": ("N m", "N"),
        "counterbalance": ("N m", "N"), "offset": ("N m", "N"), "stribeck": ("N m", "N"),
    }  # fmt: skip
    return turned[what][slides] if what in turned else ""
