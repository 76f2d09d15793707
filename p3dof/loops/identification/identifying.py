"""From a log to a robot: preparation, checks, estimate, in one call."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable, frozen_array
from p3dof._base.time_series.smoothing import Smooth
from p3dof.loops.identification.data import OFFSET, Delay, Fit, Period, PreparedLog, prepare_log
from p3dof.loops.identification.diagnosis import beyond_limits, excitation_told
from p3dof.loops.identification.estimates import EstimationMethod, ParameterEstimate, estimate_parameters
from p3dof.loops.identification.forces import IdentifiableForces, Rows
from p3dof.loops.identification.logs import MotorLog

_INFORMED = 4.0
"""Information of a combination over the prior's from which it tests the prior."""


@dataclass(frozen=True, eq=False)
class Identification(Readable):
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

    forces: IdentifiableForces
    data: PreparedLog
    estimate: ParameterEstimate
    prior: FloatArray
    prior_factor: float
    prior_share: float
    remarks: tuple[str, ...]

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
    data = prepare_log(forces, log, period=period, smooth=smooth, delay=delay, deviations=prior, check=check)
    columns, design, doubt, names = data.rows.columns, forces.design, prior, tuple(forces.names)
    if offsets:
        columns = with_offsets(data.rows)
        design = np.concatenate([design, np.zeros(m)])
        doubt = np.concatenate([prior, OFFSET * np.sqrt((data.forces**2).mean(axis=0))])
        names += tuple(f"{name}.offset" for name in forces.actuators)
    estimate = estimate_parameters(
        columns, data.forces - data.rows.known, design, doubt, data.noise,
        method=method, widths=widths, names=names, consistent=consistent,
    )  # fmt: skip
    fit = Fit(data.rows, forces.design, prior, data.noise, doubt[count:] if offsets else np.zeros(m))
    factor, share = fit.against_prior(data.forces, _INFORMED)
    remarks = [
        *data.remarks,
        *beyond_limits(forces, data.states, data.time),
        *excitation_told(data.rows, prior, data.noise),
        *estimate.remarks,
    ]
    return Identification(forces, data, estimate, prior, factor, share, tuple(remarks))
