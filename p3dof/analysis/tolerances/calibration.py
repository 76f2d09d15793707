"""Calibration of the manipulator: lengths of each leg and encoder offsets from measured poses.

The sliders are read and the pose of the platform is measured. The twelve parameters are those of
`p3dof.analysis.tolerances.pose`, whose closures define the pose at given readings; they are found by the
least squares of any robot, `p3dof.loops.identification.fitting`.

A machine's file has one R, r and L for all legs. What it can hold of the errors is a fit of its own: three
lengths and three encoder offsets. What is left of the errors of poses then shows whether the controller needs
lengths of each leg.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Readable, as_floats, batch_of, frozen_array, whole
from p3dof._base.errors import AssemblyError, InputError
from p3dof._base.quantities import ANGLE, LENGTH
from p3dof._base.tables import Table, Tabular, columns_by, table_of
from p3dof.analysis.tolerances.directions import AnyMachine, amount_of, parameters_of
from p3dof.analysis.tolerances.pose import (
    KINDS,
    NAMES,
    checked_pose,
    closure_derivatives,
    closures,
    pose_gradient,
    sigmas_of,
    solved,
)
from p3dof.closed_form.kinematics import forward_kinematics, singularity
from p3dof.loops.identification.calibration import (
    MeasurementPlan,
    fit_of_columns,
    in_units,
    plan_of,
    require_accuracy,
    require_enough,
    require_metres,
    wrong_columns,
)
from p3dof.loops.identification.fitting import (
    Combinations,
    Displacements,
    chosen_poses,
    combinations_of,
    fit,
    in_words,
    outliers_of,
    reduced,
)
from p3dof.machine.parameters import LEGS, Geometry, Parameters

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


DEVICE = ("device.y", "device.z", "device.theta")
"""Where the axes of what measures are, in those of the machine: parameters if a tolerance is given."""
ALL = (*NAMES, *DEVICE)
POSE = ("y", "z", "theta")

_LENGTHS = tuple(name != DEVICE[2] for name in ALL)
_ALIKE = 1e-6  # spread of readings below which all poses are one [m]
_MARGIN = 0.1  # least angle of a candidate from a singularity of actuation [rad]
_REACH = 0.02  # least reach margin of its legs, as a share of their length


@dataclass(frozen=True, eq=False)
class MachineCalibration(Tabular):
    """Errors of the manipulator's legs from measured poses.

    Parameters
    ----------
    names : tuple of str
        Of the parameters: ``R.a``, ``r.a``, ``L.a``, ``encoder.a``, ``R.b`` and so on, ``device.y``.
    parameters : (P,) array
        What is to be added to the design [m or rad]; encoders: what they read less where the slider is.
    deviations, tolerances : (P,) array
        Their standard deviations, and those about the design.
    covariance : (P, P) array
        Of the parameters.
    noise : float
        Standard deviation of the measured numbers over sigma; NaN if nothing is left over.
    seen : Combinations
        Which combinations the measurements tell, without tolerances.
    before, after, after_file : (K, 3) array
        Computed less measured poses by the design, by all parameters, and by what a machine's file holds:
        y [m], z [m], θ [rad].
    outliers : tuple of (int, str)
        Poses and components that do not fit the others, the worst first.
    left_out : bool
        Whether the result is that without them.
    machine : Parameters
        The design with the R, r and L for all legs that fit best with `encoders`.
    encoders : (3,) array
        Offsets that belong to `machine`, whose heights count from its own home [m].
    """

    _row_name = "leg"

    names: tuple[str, ...]
    parameters: FloatArray
    deviations: FloatArray
    tolerances: FloatArray
    covariance: FloatArray
    noise: float
    seen: Combinations
    before: FloatArray
    after: FloatArray
    after_file: FloatArray
    outliers: tuple[tuple[int, str], ...]
    left_out: bool
    machine: Parameters
    encoders: FloatArray
    legs: FloatArray  # (3, 4): R, r, L and encoder of legs A, B, C less those of the design [m]
    device: FloatArray  # (3,): y, z, θ of what measures
    file_device: FloatArray  # (3,): the same beside `machine`
    design: Geometry

    def to_columns(self) -> dict[str, Any]:
        """Return the lengths of each leg and the offset of its encoder, for a controller; one leg a row."""
        own = np.array([self.design.R, self.design.r, self.design.L, 0.0]) + self.legs
        lengths = columns_by("{} [m]", ("R", "r", "L", "encoder"), own)
        return {"leg": np.array(LEGS)} | lengths

    def sliders(self, pose: ArrayLike) -> FloatArray:
        """Return what the encoders read at poses of the platform (..., 3), by the lengths of each leg [m].

        This is the inverse kinematics for the controller. NaN where a leg does not reach.
        """
        return closures(self.design, batch_of("pose", pose, 3), self.legs.ravel())

    def pose(self, sliders: ArrayLike) -> FloatArray:
        """Return the poses (..., 3) at which encoders read this, by the lengths of each leg."""
        return _poses(self.design, batch_of("sliders", sliders, 3), self.legs.ravel())

    def errors(self, sliders: ArrayLike, pose: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return computed less measured poses (K, 3), of others: as `before`, `after`, `after_file`.

        By the design the device is where the machine's file has it.
        """
        read, seen = _measured(sliders, pose)
        problem = _Problem(self.design, read, seen, np.ones(3), np.eye(len(ALL)))
        lengths = [getattr(self.machine.geometry, kind) - getattr(self.design, kind) for kind in KINDS[:3]]
        encoders = self.encoders + self.design.h - self.machine.geometry.h
        own = np.concatenate(
            [np.append(np.tile(lengths, (3, 1)), encoders[:, None], axis=1).ravel(), self.file_device]
        )
        every = np.concatenate([self.legs.ravel(), self.device])
        before, after, file = (problem.all(p)[0] for p in (np.zeros(len(ALL)), every, own))
        return before, after, file


class _Problem:
    """Measured poses as functions of P parameters, which are combinations of all fifteen."""

    def __init__(
        self, geometry: Geometry, sliders: FloatArray, pose: FloatArray, sigma: FloatArray, matrix: FloatArray
    ) -> None:
        self.geometry, self.sliders, self.pose, self.matrix = geometry, sliders, pose, matrix
        self.kept = ~np.isnan(pose)
        self.sigma = np.broadcast_to(sigma, pose.shape)[self.kept].copy()
        self._start: FloatArray = np.asarray(forward_kinematics(geometry, sliders))

    def evaluate(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return computed less measured numbers (N,), and their derivatives (N, P)."""
        error, rows = self.all(p)
        return error[self.kept], rows[self.kept]

    def all(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the same by pose, (K, 3) and (K, 3, P)."""
        off = self.matrix @ p
        legs, (dy, dz, turn) = off[: len(NAMES)], off[len(NAMES) :]
        pose = _poses(self.geometry, self.sliders, legs, self._start)
        by_pose, by_legs = closure_derivatives(self.geometry, pose, legs)
        rows = np.zeros((*pose.shape, len(ALL)))
        rows[..., : len(NAMES)] = -np.linalg.solve(by_pose, by_legs)
        c, s = np.cos(turn), np.sin(turn)
        y, z = pose[:, 0] - dy, pose[:, 1] - dz
        seen = np.column_stack([c * y + s * z, c * z - s * y, pose[:, 2] - turn])
        into = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
        rows[:, 0, len(NAMES) + 2], rows[:, 1, len(NAMES) + 2] = seen[:, 1], -seen[:, 0]
        rows[..., : len(NAMES)] = into @ rows[..., : len(NAMES)]
        rows[..., len(NAMES) : len(NAMES) + 2] = -into[:, :2]
        rows[:, 2, len(NAMES) + 2] = -1.0
        return seen - self.pose, rows @ self.matrix


def _poses(
    geometry: Geometry, sliders: FloatArray, legs: FloatArray, start: FloatArray | None = None
) -> FloatArray:
    """Return the poses of a machine whose legs differ from the design's at readings of its encoders."""
    if start is None:
        start = np.asarray(forward_kinematics(geometry, sliders))
    found = solved(geometry, sliders, legs, start)
    wrong = np.argwhere(~np.isfinite(found).all(axis=-1))
    if len(wrong):
        raise AssemblyError(
            f"pose {1 + int(wrong[0][0])} of {len(found)}: no machine with such legs is there"
        )
    return found


def calibrate_machine(
    robot: AnyMachine,
    sliders: ArrayLike,
    pose: ArrayLike,
    sigma: ArrayLike,
    tolerances: Mapping[str, float | str],
    leave_out: bool = False,
) -> MachineCalibration:
    """Return the most likely errors of the legs and encoders, given measured poses.

    Parameters
    ----------
    robot : Manipulator, Parameters or None
        The design; the paper's machine for None.
    sliders : array-like, shape (K, 3)
        What the encoders of A, B, C read [m].
    pose : array-like, shape (K, 3)
        Measured y [m], z [m], θ [rad]; NaN where nothing was measured.
    sigma : array-like, shape (3,)
        Standard deviations of measured y [m], z [m] and θ [rad].
    tolerances : mapping of str to float or str
        Standard deviations about the design, as ``sigma`` of `p3dof.tolerance` for poses: ``R``, ``r``,
        ``L``, ``encoder`` of each leg, or of one (``L.a``), in m or with a unit. Others are exact.
        ``device.y``, ``device.z``, ``device.theta``: where the axes of what measures are in those of the
        machine; exact by default.
    leave_out : bool
        Whether to leave out numbers that do not fit the others; else they are told only.

    Raises
    ------
    InputError
        If shapes do not fit, there are no more numbers than combinations of parameters that they tell, all
        poses are alike, numbers look like mm or degrees, sigma is as large as the legs are long, or columns
        seem exchanged or turned round.
    ReachError, AssemblyError
        If the design, or a machine with such legs, cannot be where its encoders read so.
    """
    machine = parameters_of(robot)
    geometry = machine.geometry
    read, seen = _measured(sliders, pose)
    deviations = _deviations(sigma, geometry)
    names, widths = _tolerances(tolerances, geometry)
    problem = _Problem(geometry, read, seen, deviations, np.eye(len(ALL))[:, [ALL.index(n) for n in names]])
    before = problem.all(np.zeros(len(names)))[0]
    if np.ptp(read, axis=0).max(initial=0.0) <= _ALIKE:
        raise InputError("sliders: all poses are alike: expected readings that differ")
    for k, name in enumerate(POSE):
        if problem.kept[:, k].any():
            require_metres(name, seen[:, k], before[:, k], k < 2)
    error, rows = problem.evaluate(np.zeros(len(names)))
    told = combinations_of(rows / problem.sigma[:, None], names)
    require_enough(len(error), told)
    columns = wrong_columns(POSE, seen, before)
    found = fit_of_columns(problem.evaluate, problem.sigma, widths, columns)
    wrong = outliers_of(found, widths)
    places = np.argwhere(problem.kept)
    if wrong and leave_out:
        problem.sigma[wrong] = np.inf
        found = fit(problem.evaluate, problem.sigma, widths)
    alike, file = _symmetric(problem, names, widths)
    lengths = {kind: getattr(geometry, kind) + alike[ALL.index(f"{kind}.a")] for kind in KINDS[:3]}
    off, own = problem.matrix @ found.parameters, replace(geometry, **lengths)
    encoders = alike[[ALL.index(f"encoder.{leg}") for leg in "abc"]] + own.h - geometry.h
    return MachineCalibration(
        names,
        found.parameters,
        found.deviations,
        widths,
        found.covariance,
        found.noise,
        told,
        before,
        problem.all(found.parameters)[0],
        file,
        tuple((int(places[i][0]), POSE[places[i][1]]) for i in wrong),
        leave_out and bool(wrong),
        replace(machine, geometry=own),
        encoders,
        off[: len(NAMES)].reshape(3, 4),
        off[len(NAMES) :],
        alike[len(NAMES) :],
        geometry,
    )


def _symmetric(
    problem: _Problem, names: tuple[str, ...], widths: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what a machine's file can hold of the errors, (15,), and what is left of poses, (K, 3).

    One R, r and L for all legs, an encoder offset of each leg, and where the device is.
    """
    columns, own = [], []
    for name, width in zip(names, widths, strict=True):
        kind, _, leg = name.partition(".")
        if kind not in KINDS[:3]:
            columns.append(np.eye(len(ALL))[ALL.index(name)])
        elif leg == min(each.partition(".")[2] for each in names if each.startswith(f"{kind}.")):
            columns.append(np.sum([np.eye(len(ALL))[ALL.index(f"{kind}.{each}")] for each in "abc"], axis=0))
        else:
            continue
        own.append(width)
    alike = _Problem(problem.geometry, problem.sliders, problem.pose, np.ones(3), np.transpose(columns))
    alike.sigma = problem.sigma
    found = fit(alike.evaluate, alike.sigma, np.array(own))
    return alike.matrix @ found.parameters, alike.all(found.parameters)[0]


def _deviations(sigma: ArrayLike, geometry: Geometry) -> FloatArray:
    """Return standard deviations of measured y, z [m] and theta [rad]."""
    found = frozen_array("sigma", sigma, (3,))
    if not (found > 0).all():
        raise InputError("sigma: expected positive standard deviations of y, z [m] and theta [rad]")
    require_accuracy(found, (True, True, False), geometry.L)
    return found


def _measured(sliders: ArrayLike, pose: ArrayLike) -> tuple[FloatArray, FloatArray]:
    seen = as_floats("pose", pose)
    if seen.ndim != 2 or seen.shape[1] != 3 or np.isinf(seen).any() or np.isnan(seen).all():
        raise InputError(
            f"pose: expected shape (K, 3) of finite numbers, NaN where nothing was measured, got {seen.shape}"
        )
    return frozen_array("sliders", sliders, (len(seen), 3)), seen


def _tolerances(given: Mapping[str, float | str], geometry: Geometry) -> tuple[tuple[str, ...], FloatArray]:
    """Return which parameters there are, and their tolerances."""
    legs = {name: value for name, value in dict(given).items() if name not in DEVICE}
    names, widths = sigmas_of(legs, geometry)
    kinds = dict(zip(DEVICE, (LENGTH, LENGTH, ANGLE), strict=True))
    own = [name for name in DEVICE if name in given]
    amounts = [amount_of(given[name], 0.0, kinds[name], f"tolerance of {name}") for name in own]
    return (*names, *own), np.concatenate([widths, np.array(amounts)])


def plan_machine(
    robot: AnyMachine,
    count: int,
    sigma: ArrayLike,
    tolerances: Mapping[str, float | str],
    sliders: ArrayLike | None = None,
    candidates: int = 1000,
    seed: int = 0,
) -> MeasurementPlan:
    """Choose the poses whose measurement tells most of the legs: D-optimal.

    Parameters
    ----------
    robot, sigma, tolerances
        As of `calibrate_machine`.
    count : int
        How many poses are chosen.
    sliders : array-like, shape (C, 3), optional
        Readings at poses that can be measured [m]; by default random ones within the limits of the machine,
        away from singularities.
    candidates : int
        How many random ones.
    seed : int
        Of these.

    Raises
    ------
    InputError
        If an argument does not fit, or there are too few poses for the parameters.
    ReachError
        If the machine cannot be at a candidate.
    """
    machine = parameters_of(robot)
    if sliders is None:
        sliders = _candidates(machine, whole("candidates", candidates, 1), whole("seed", seed, 0))
    read = frozen_array("sliders", sliders, ("C", 3))
    deviations = _deviations(sigma, machine.geometry)
    names, widths = _tolerances(tolerances, machine.geometry)
    columns = [ALL.index(name) for name in names]
    problem = _Problem(machine.geometry, read, np.zeros(read.shape), deviations, np.eye(len(ALL))[:, columns])
    rows = problem.all(np.zeros(len(names)))[1] / deviations[:, None]
    chosen = chosen_poses(rows, widths, whole("count", count, 1))
    lengths = tuple(_LENGTHS[i] for i in columns)
    return plan_of(chosen, rows, read, Displacements(names, names, np.eye(len(names)), widths, lengths))


def _candidates(machine: Parameters, count: int, seed: int) -> FloatArray:
    """Return readings at random poses within the limits."""
    rng = np.random.default_rng(seed)
    found: FloatArray = np.empty((0, 3))
    low, high = machine.limits.travel
    for _ in range(100):
        read = rng.uniform(low, high, (count, 3))
        pose = forward_kinematics(machine.geometry, read, on_invalid="nan")
        inside = (pose[:, 2] >= machine.limits.tilt[0]) & (pose[:, 2] <= machine.limits.tilt[1])
        with np.errstate(invalid="ignore"):
            margins = singularity(machine.geometry, pose)
            inside &= (margins.actuation > _MARGIN) & (
                margins.serial.min(axis=1) > _REACH * machine.geometry.L
            )
        found = np.concatenate((found, read[inside]))
        if len(found) >= count:
            break
    return found[:count]


def machine_calibration_tables(found: MachineCalibration) -> tuple[Table, Table]:
    """Return the parameters and the errors of poses as tables."""
    numbers = found.parameters, found.deviations, found.tolerances
    lengths = [_LENGTHS[ALL.index(name)] for name in found.names]
    note = f"Measuring tells {found.seen.rank} of {len(found.names)} combinations of the parameters."
    if found.seen.unseen:
        note += f" It does not tell {'; '.join(found.seen.unseen)}: these keep the design's values."
    head = "parameter", "error", "± standard deviation", "tolerance"
    first = table_of("Errors of the legs", head, in_units(found.names, lengths, numbers), note)
    rows = {
        name: [float(f * np.sqrt(np.nanmean(error[:, k] ** 2))) for k, f in enumerate((1e6, 1e6, 1e6))]
        for name, error in (
            ("the design", found.before),
            ("one R, r, L, and encoders", found.after_file),
            ("all legs of their own", found.after),
        )
    }
    second = table_of(
        "Root mean square of computed less measured", ("by", "y [µm]", "z [µm]", "θ [µrad]"), rows, decimals=1
    )
    return first, second
