"""Calibration: lengths, placements and encoder offsets of any robot from measured poses.

The motors are read, and a frame is measured: its pose, or a part of it, or its distance from a point, as by a
laser tracker, a camera, a dial gauge, a probe that touches a plate, a ball bar. Errors of placements are
joints that stand still (`p3dof.loops.identification.fitting`), so that each number that was measured is
a function of them which the closed loops define, with exact derivatives. The most likely errors given the
tolerances of the design follow by least squares (`p3dof.loops.identification.fitting`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import (
    FloatArray,
    FrozenArrays,
    Progress,
    Readable,
    as_floats,
    frozen_array,
    require,
    shown,
    whole,
)
from p3dof._base.errors import AssemblyError, InputError, P3dofError
from p3dof._base.tables import Table, Tabular, table_of
from p3dof.loops.identification.fitting import (
    DEVICE,
    OFFSET,
    ChosenPoses,
    Combinations,
    DisplacedRobot,
    Displacements,
    Fit,
    Rows,
    chosen_poses,
    combinations_of,
    displacements,
    fit,
    observability,
    outliers_of,
)
from p3dof.loops.identification.forces import LEAST_MARGIN
from p3dof.loops.model import ClosedLoopModel

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz", "distance")
"""What may be measured of a frame: position [m], rotation vector [rad], distance from a point [m]."""
Combined: TypeAlias = Mapping[str, Mapping[str, float] | Sequence[str]]
"""Parameters that displace several things at once: names, or names and factors, by the parameter."""

_IDLE = 1e-6  # least derivative of a number by an idle joint that makes it undetermined
_ALIKE = 1e-6  # spread of readings below which all poses are one [m or rad]
_WRONG_UNIT = 20.0  # by how much better numbers fit in mm for an error that says so
_MISPLACED = 20.0  # scatter over what was given as sigma from which columns may be turned round or exchanged


@dataclass(frozen=True, eq=False)
class Measurements(FrozenArrays):
    """What was measured of one frame at some poses, and what the motors read there.

    Parameters
    ----------
    readings : (K, m) array
        Of the actuated joints, in their order [m or rad].
    values : (K, c) array
        What was measured [m, rad]; NaN where nothing was.
    components : sequence of str
        What the c columns are: ``x``, ``y``, ``z`` and ``rx``, ``ry``, ``rz`` (the rotation vector) of the
        frame, seen from `base`, or ``distance`` of its origin from `point`.
    frame : str
        The frame of the robot that is measured.
    sigma : float or (c,) array
        Standard deviation of a measured number [m or rad].
    base : str
        The frame that it is seen from: one of the robot, or a new name, by default ``device``, for one at the
        world's origin, which may be displaced: ``device.z``.
    point : (3,) array
        Where distances are measured from, in axes of `base` [m].

    Raises
    ------
    InputError
        If shapes do not fit, a reading is not finite, nothing is measured, or a component is unknown.
    """

    readings: FloatArray
    values: FloatArray
    components: tuple[str, ...]
    frame: str
    sigma: FloatArray
    base: str
    point: FloatArray

    def __init__(
        self,
        readings: ArrayLike,
        values: ArrayLike,
        components: Sequence[str],
        frame: str,
        sigma: ArrayLike,
        base: str = DEVICE,
        point: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        names = tuple([components] if isinstance(components, str) else components)
        wrong = next((name for name in names if name not in COMPONENTS), None)
        if wrong is not None or not names or len(set(names)) < len(names):
            told = "each once" if wrong is None else f"got {shown(wrong)}"
            raise InputError(f"components: expected some of {', '.join(COMPONENTS)}, {told}")
        numbers = as_floats("values", values)
        numbers = numbers[:, None] if numbers.ndim == 1 else numbers
        read = frozen_array("readings", readings, (len(numbers), "m"))
        if numbers.ndim != 2 or numbers.shape[1] != len(names):
            raise InputError(f"values: expected shape (K, {len(names)}), got {numbers.shape}")
        if np.isinf(numbers).any() or np.isnan(numbers).all():
            raise InputError("values: expected finite numbers, NaN where nothing was measured, not all NaN")
        deviations = frozen_array(
            "sigma", np.broadcast_to(as_floats("sigma", sigma), len(names)), (len(names),)
        )
        if not (deviations > 0).all():
            raise InputError("sigma: expected positive standard deviations [m or rad]")
        numbers = numbers.copy()
        numbers.setflags(write=False)
        fixed = frozen_array("point", point, (3,))
        fields = read, numbers, names, str(frame), deviations, str(base), fixed
        for name, value in zip(self.__dataclass_fields__, fields, strict=True):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.readings)

    def only(self, poses: Any) -> Measurements:
        """Return some of the poses, by an index, slice or mask."""
        some = np.arange(len(self))[poses]
        rest = self.components, self.frame, self.sigma, self.base, self.point
        return Measurements(self.readings[some], self.values[some], *rest)


Measured: TypeAlias = Measurements | Sequence[Measurements]
"""One kind of measurement, or several."""


def several(measured: Measured) -> tuple[Measurements, ...]:
    """Return all kinds of measurements."""
    found = (measured,) if isinstance(measured, Measurements) else tuple(measured)
    for one in found:
        require("measured", one, Measurements)
    if not found:
        raise InputError("measured: expected measurements")
    return found


class MeasuredRobot:
    """Measured numbers as functions of the displacements of a robot, with their derivatives."""

    def __init__(self, robot: ClosedLoopModel, measured: Measured, parameters: Displacements) -> None:
        self.robot, self.measured, self.parameters = robot, several(measured), parameters
        self._displaced = DisplacedRobot(robot, parameters.elements, [one.base for one in self.measured])
        self._guesses: list[FloatArray | None] = [None] * sum(map(len, self.measured))
        for one in self.measured:
            if one.readings.shape[1] != len(robot.actuated):
                wanted = ", ".join(robot.actuated)
                raise InputError(
                    f"readings: expected {len(robot.actuated)} columns ({wanted}), got {one.readings.shape}"
                )
            if not robot.model.existFrame(one.frame):
                raise InputError(f"frame: the robot has no {shown(one.frame)}")
        freedoms = robot.mobility(robot.regular_configuration)
        if freedoms < len(robot.actuated):
            raise InputError(
                f"robot: {len(robot.actuated)} motors for {freedoms} freedoms: expected as many motors in "
                "its sidecar; the others are not free"
            )
        self.kept = np.concatenate([~np.isnan(one.values).ravel() for one in self.measured])
        self.sigma = np.concatenate([np.tile(one.sigma, len(one)) for one in self.measured])[self.kept]

    def evaluate(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return computed less measured numbers (N,), and their derivatives by the parameters (N, P)."""
        errors, rows = self.all(p)
        return (
            np.concatenate([part.ravel() for part in errors])[self.kept],
            np.concatenate([part.reshape(-1, len(p)) for part in rows])[self.kept],
        )

    def all(self, p: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
        """Return the same of each kind of measurement: (K, c), (K, c, P); NaN for no number."""
        displaced, model = self._displaced, self._displaced.extended.model
        values = self.parameters.matrix @ p
        robot, data, pose = displaced.with_lengths(values), model.createData(), 0
        errors, rows = [], []
        for one in self.measured:
            frame, base = model.getFrameId(one.frame), model.getFrameId(one.base)
            error = np.empty(one.values.shape)
            row = np.empty((*one.values.shape, len(p)))
            for k, target in enumerate(displaced.targets(one.readings, values)):
                q = self._assembled(robot, target, pose, f"pose {k + 1} of {len(one)}")
                by_p = displaced.influence(robot, q, self.parameters)
                pin.computeJointJacobians(model, data, q)
                pin.updateFramePlacements(model, data)
                error[k], by_q = _seen(model, data, (frame, base), one, one.values[k])
                row[k] = by_q @ by_p
                if not k:
                    self._require_determined(displaced.idle(robot, q), by_q, one)
                pose += 1
            errors.append(error)
            rows.append(row)
        return errors, rows

    def _require_determined(self, idle: FloatArray, by_q: FloatArray, one: Measurements) -> None:
        """Raise if joints that the motors leave free move what is measured."""
        moved = np.abs(by_q @ idle).max(axis=1, initial=0.0)
        if moved.max(initial=0.0) > _IDLE:
            name = one.components[int(moved.argmax())]
            raise InputError(f"measured: the motors do not determine {name} of {shown(one.frame)}")

    def _assembled(self, robot: ClosedLoopModel, target: FloatArray, pose: int, where: str) -> FloatArray:
        """Return the configuration with closed loops, on the assembly of the last one."""
        try:
            q = np.array(robot.assemble(target, guess=self._guesses[pose]).q)
        except AssemblyError as error:
            raise AssemblyError(f"{where}: {error}", error.gap) from error
        self._guesses[pose] = q
        return q

    def corrected(self, p: FloatArray) -> ClosedLoopModel:
        """Return the robot with these errors."""
        return self._displaced.corrected(self.parameters.matrix @ p)


def _seen(
    model: pin.Model, data: pin.Data, frames: tuple[int, int], one: Measurements, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return computed less measured components (c,), and their derivatives (c, nv)."""
    (J, Mf), (Jb, Mb) = (
        (pin.getFrameJacobian(model, data, at, pin.LOCAL_WORLD_ALIGNED), data.oMf[at]) for at in frames
    )
    R, away = Mb.rotation.T, Mf.translation - Mb.translation
    # d/dt Rᵀ (p - b) = Rᵀ (v - v_b - ω_b × (p - b))
    linear = R @ (J[:3] - Jb[:3] + pin.skew(away) @ Jb[3:])
    angular = R @ (J[3:] - Jb[3:])
    position, turn = R @ away, R @ Mf.rotation
    error, rows = np.empty(len(values)), np.empty((len(values), model.nv))
    places = {name: i for i, name in enumerate(one.components)}
    for i, name in enumerate("xyz"):
        if name in places:
            error[places[name]] = position[i] - values[places[name]]
            rows[places[name]] = linear[i]
    turns = [places[name] for name in COMPONENTS[3:6] if name in places]
    if len(turns) == 3 and not np.isnan(values[turns]).any():
        turn = turn @ pin.exp3(values[turns]).T
        error[turns] = pin.log3(turn)
        rows[turns] = pin.Jlog3(turn).T @ angular
    elif turns:
        axes = [i for i, name in enumerate(COMPONENTS[3:6]) if name in places]
        error[turns] = pin.log3(turn)[axes] - values[turns]
        rows[turns] = (pin.Jlog3(turn).T @ angular)[axes]
    if "distance" in places:
        apart = position - one.point
        distance = float(np.linalg.norm(apart))
        if distance == 0:
            raise InputError(
                f"point: the frame {shown(one.frame)} is there, so that its distance has no direction"
            )
        error[places["distance"]] = distance - values[places["distance"]]
        rows[places["distance"]] = apart / distance @ linear
    return error, rows


@dataclass(frozen=True, eq=False)
class Calibration(Tabular):
    """Errors of a robot's geometry from measurements.

    Parameters
    ----------
    names : tuple of str
        Of the P parameters: ``joint.x``, ``joint.offset`` and so on, or names of combined ones.
    parameters : (P,) array
        What is to be added to the design [m or rad].
    deviations : (P,) array
        Their standard deviations: where they are those of the tolerances, measuring told nothing; infinite
        where a parameter without tolerance is not told.
    tolerances : (P,) array
        Standard deviations of the design.
    covariance : (P, P) array
        Of the parameters.
    noise : float
        Standard deviation of the measured numbers over what was given as sigma: much more than 1 tells of
        something else than these parameters, such as elasticity; NaN if nothing is left over.
    seen : Combinations
        Which combinations of the parameters the measurements tell, without tolerances.
    before, after : tuple of (K, c) array
        Computed less measured numbers by the design and by the result, of each kind of measurement.
    outliers : tuple of (int, int, str)
        Numbers that do not fit the others, the worst first: kind of measurement, pose, component.
    left_out : bool
        Whether the result is that without them.
    robot : ClosedLoopModel
        The robot with the errors: its joints are what the encoders read.
    offsets : dict of str to float
        Encoder offsets, which are in its placements: reading less where the joint is [m or rad].
    """

    _row_name = "parameter"

    names: tuple[str, ...]
    parameters: FloatArray
    deviations: FloatArray
    tolerances: FloatArray
    covariance: FloatArray
    noise: float
    seen: Combinations
    before: tuple[FloatArray, ...]
    after: tuple[FloatArray, ...]
    outliers: tuple[tuple[int, int, str], ...]
    left_out: bool
    robot: ClosedLoopModel
    offsets: dict[str, float]
    lengths: tuple[bool, ...]
    """Of the parameters, which are lengths [m]; the others are angles [rad]."""
    _model: MeasuredRobot

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return the errors with units, deviations and tolerances, (P,) each; one parameter a row."""
        return {
            "parameter": np.array(self.names),
            "unit": np.where(self.lengths, "m", "rad"),
            "error": self.parameters,
            "deviation": self.deviations,
            "tolerance": self.tolerances,
        }

    @property
    def measured(self) -> tuple[Measurements, ...]:
        """What was measured, by kind."""
        return self._model.measured

    def errors(self, measured: Measured) -> tuple[FloatArray, ...]:
        """Return computed less measured numbers by the result, of other measurements: (K, c) of each kind."""
        other = MeasuredRobot(self._model.robot, measured, self._model.parameters)
        return tuple(other.all(self.parameters)[0])

    def tested(self, measured: Measurements) -> tuple[FloatArray, FloatArray]:
        """Return computed less measured numbers (K, c) by the design and by the result, of other poses."""
        other = MeasuredRobot(self._model.robot, measured, self._model.parameters)
        return other.all(np.zeros(len(self.names)))[0][0], other.all(self.parameters)[0][0]

    def table(self) -> Table:
        """Return the parameters as a table."""
        return calibration_table(self)


def calibrate(
    robot: ClosedLoopModel,
    measured: Measured,
    tolerances: Mapping[str, float],
    combined: Combined | None = None,
    leave_out: bool = False,
) -> Calibration:
    """Return the most likely errors of placements, lengths and encoders, given measured poses.

    Parameters
    ----------
    robot : ClosedLoopModel
        The design.
    measured : Measurements, or a sequence of them
        What the motors read and what was measured.
    tolerances : mapping of str to float
        Which parameters there are, and their standard deviations about the design [m or rad], by name or
        pattern (``*.offset``); infinite where nothing is known. Names are those of joints and frames with

        - ``x``, ``y``, ``z``: shifts of the placement, along the axes of the body that carries it;
        - ``roll``, ``pitch``, ``yaw``: turns about these axes x, y, z, roll first as in URDF;
        - ``length``: a shift away from the joint before it;
        - ``offset``: of the encoder of an actuated joint, what it reads less where the joint is;

        or of closures by distance, ``frame1/frame2.length``.
    combined : mapping, optional
        Parameters that displace several things at once, such as ``{"rods": ["*_tip.length"]}`` for rods of
        one length, or with factors ``{"radius": {"a.x": 1.0, "b.x": -0.5}}``.
    leave_out : bool
        Whether to leave out numbers that do not fit the others; else they are told only.

    Raises
    ------
    AssemblyError
        If the loops do not close at a pose.
    InputError
        If there are no more numbers than combinations of parameters that they tell, all poses are alike, a
        name does not exist, the loops cannot close with another value of a parameter, numbers look like mm,
        sigma is as large as what is measured, or columns seem exchanged or turned round.
    OptimisationError
        If the least squares do not converge.
    """
    require("robot", robot, ClosedLoopModel)
    kinds = several(measured)
    parameters = displacements(robot, tolerances, combined or {}, [one.base for one in kinds])
    problem = MeasuredRobot(robot, kinds, parameters)
    zero = np.zeros(len(parameters.names))
    before = tuple(problem.all(zero)[0])
    _check_poses(kinds, before)
    error, rows = problem.evaluate(zero)
    seen = combinations_of(rows / problem.sigma[:, None], parameters.names)
    require_enough(len(error), seen)
    told = [
        wrong_columns(one.components, one.values, error) for one, error in zip(kinds, before, strict=True)
    ]
    found = fit_of_columns(
        problem.evaluate, problem.sigma, parameters.tolerances, next(filter(None, told), "")
    )
    wrong = outliers_of(found, parameters.tolerances)
    places = [(k, i, name) for k, one in enumerate(kinds) for i in range(len(one)) for name in one.components]
    outliers = tuple(places[np.flatnonzero(problem.kept)[i]] for i in wrong)
    if wrong and leave_out:
        problem.sigma[wrong] = np.inf
        found = fit(problem.evaluate, problem.sigma, parameters.tolerances)
    return _told(problem, found, seen, before, outliers, leave_out)


def _told(
    problem: MeasuredRobot,
    found: Fit,
    seen: Combinations,
    before: tuple[FloatArray, ...],
    outliers: tuple[tuple[int, int, str], ...],
    leave_out: bool,
) -> Calibration:
    parameters = problem.parameters
    values = parameters.matrix @ found.parameters
    offsets = {
        name.rpartition(".")[0]: float(value)
        for name, value in zip(parameters.elements, values, strict=True)
        if name.rpartition(".")[2] == OFFSET
    }
    return Calibration(
        parameters.names,
        found.parameters,
        found.deviations,
        parameters.tolerances,
        found.covariance,
        found.noise,
        seen,
        before,
        tuple(problem.all(found.parameters)[0]),
        outliers,
        leave_out and bool(outliers),
        problem.corrected(found.parameters),
        offsets,
        parameters.lengths,
        problem,
    )


def require_enough(count: int, seen: Combinations) -> None:
    """Raise unless there are more numbers than what is found from them."""
    if count <= seen.rank:
        raise InputError(
            f"measured: {count} numbers fit exactly to {seen.rank} combinations of parameters, and show no "
            "errors of measuring: measure more poses, or fewer parameters"
        )


def _check_poses(kinds: Sequence[Measurements], before: Sequence[FloatArray]) -> None:
    readings = np.concatenate([one.readings for one in kinds])
    if np.ptp(readings, axis=0).max(initial=0.0) <= _ALIKE:
        raise InputError("measured: all poses are alike: expected readings of the motors that differ")
    for one, error in zip(kinds, before, strict=True):
        lengths = [name[0] != "r" for name in one.components]
        size = np.nanmax(np.abs((error + one.values)[:, lengths]), initial=0.0)
        require_accuracy(one.sigma, lengths, float(size))
        for column, name in enumerate(one.components):
            require_metres(name, one.values[:, column], error[:, column], name[0] != "r")


def require_accuracy(sigma: FloatArray, lengths: Sequence[bool], size: float) -> None:
    """Raise if a measured number would be as uncertain as what is measured is large: a unit is missing."""
    for value, length in zip(sigma, lengths, strict=True):
        what, most, unit = ("lengths", size, "m") if length else ("angles", np.pi, "rad")
        if value >= most > 0:
            raise InputError(
                f"sigma of measured {what}: expected less than what is measured, {most:.3g} {unit}, got "
                f"{value:g} {unit}; numbers without a unit are in SI units"
            )


def wrong_columns(names: Sequence[str], values: FloatArray, error: FloatArray) -> str:
    """Return in words which sign or exchange of measured columns (K, c) fits far better, or nothing."""
    computed = error + values
    found = []
    for i, j in combinations_with_replacement(range(len(names)), 2):
        if (names[i][0] in "rt") != (names[j][0] in "rt"):  # an angle and a length
            continue
        own = computed[:, [i, j]]
        other = values[:, [j, i]] * (-1 if i == j else 1)
        off, left, size = (_spread(x) for x in (own - values[:, [i, j]], own - other, own))
        if min(off, size) > _WRONG_UNIT * left:
            words = f"{names[i]} has the other sign" if i == j else f"{names[i]} and {names[j]} are exchanged"
            found.append((left / off, words))
    return f"measured: it seems that {min(found)[1]}: correct the columns" if found else ""


def _spread(values: FloatArray) -> float:
    """Return the largest distance from the mean of a column: where the device stands does not count."""
    values = values[~np.isnan(values).any(axis=1)]
    return float(np.abs(values - values.mean(axis=0)).max()) if len(values) else 0.0


def fit_of_columns(
    evaluate: Callable[[FloatArray], Rows], sigma: FloatArray, tolerances: FloatArray, wrong: str
) -> Fit:
    """Return the most likely parameters; where none fit, say what is wrong with the columns."""
    try:
        found = fit(evaluate, sigma, tolerances)
    except P3dofError as error:
        if wrong:
            raise InputError(wrong) from error
        raise
    if wrong and found.noise > _MISPLACED:
        raise InputError(wrong)
    return found


def require_metres(name: str, values: FloatArray, error: FloatArray, length: bool) -> None:
    """Raise if numbers would fit much better in mm, or in degrees."""
    factor, unit = (1e-3, "mm") if length else (np.pi / 180, "deg")
    computed, other = error + values, factor * values
    off, left, size = (float(np.nanmax(np.abs(x), initial=0.0)) for x in (error, computed - other, computed))
    if off > _WRONG_UNIT * left and size > _WRONG_UNIT * left:
        raise InputError(
            f"measured: {name} is {1 / factor:.3g} times what the robot does "
            f"({unit}? then name it {name} [{unit}])"
        )


@dataclass(frozen=True, eq=False)
class MeasurementPlan(Readable):
    """Where to measure.

    Parameters
    ----------
    poses : (K,) array of int
        Which candidates are chosen.
    readings : (K, m) array
        Of the motors there [m or rad].
    names : tuple of str
        Of the parameters.
    deviations : (P,) array
        Which standard deviations they will have [m or rad].
    tolerances : (P,) array
        Which they have now.
    observability : float
        O1 of Borm and Menq of the chosen poses, in units of the tolerances and of sigma.
    random : float
        Its mean over as many random candidates.
    exchanges : int
        How many exchanges improved the first choice.
    """

    poses: NDArray[np.int_]
    readings: FloatArray
    names: tuple[str, ...]
    deviations: FloatArray
    tolerances: FloatArray
    observability: float
    random: float
    exchanges: int
    lengths: tuple[bool, ...]

    def table(self) -> Table:
        """Return the parameters as a table."""
        return plan_table(self)


_TRIES = 20  # random readings for each that is wanted


def candidate_readings(
    robot: ClosedLoopModel, count: int, seed: int = 0, progress: Progress | None = None
) -> FloatArray:
    """Return readings (count, m) of motors at random poses within limits: nearer to home after a miss."""
    model, wanted = robot.model, whole("count", count, 1)
    at = np.array([model.idx_qs[model.getJointId(name)] for name in robot.actuated])
    low, high = np.asarray(model.lowerPositionLimit)[at], np.asarray(model.upperPositionLimit)[at]
    for name, width in zip(robot.actuated, high - low, strict=True):
        if not 0 < width < _UNLIMITED:
            raise InputError(
                f"robot: {shown(name)} has no limits: give readings of its motors to choose from"
            )
    rng, home, found, share = np.random.default_rng(seed), robot.assemble().q, list[FloatArray](), 1.0
    for drawn in rng.uniform(low, high, (_TRIES * wanted, len(at))):
        reading = home[at] + share * (drawn - home[at])
        share *= _NEARER
        try:
            there = robot.assemble(reading, guess=home)
        except AssemblyError:
            continue
        within = not robot.beyond_limits(there.q) and there.same_assembly
        if within and robot.singularity_margins(there.q).actuation > LEAST_MARGIN:
            share = min(1.0, _FARTHER * share)
            found.append(reading)
            if progress is not None:
                progress(len(found), wanted)
        if len(found) == wanted:
            return np.array(found)
    raise InputError(
        f"robot: only {len(found)} of {_TRIES * wanted} random readings are poses within all limits"
    )


_NEARER, _FARTHER = 0.7, 1.8  # how far readings are from the reference after one, and after a good one
_UNLIMITED = 1e6  # width of a joint's limits that are none [m or rad]
_DRAWS = 20  # sets of random candidates that a plan is compared with


def plan_measurements(
    robot: ClosedLoopModel,
    candidates: Measurements,
    count: int,
    tolerances: Mapping[str, float],
    combined: Combined | None = None,
) -> MeasurementPlan:
    """Choose the poses of many whose measurement tells most of the parameters: D-optimal.

    Parameters
    ----------
    robot : ClosedLoopModel
        The design.
    candidates : Measurements
        Readings of the motors at poses that can be measured, and what will be measured there, and how
        exactly; of its values only which are NaN counts.
    count : int
        How many poses are chosen.
    tolerances, combined
        As of `calibrate`.

    Raises
    ------
    AssemblyError, InputError
        As `calibrate`; if there are fewer candidates, or too few poses for the parameters.
    """
    require("robot", robot, ClosedLoopModel)
    require("candidates", candidates, Measurements)
    parameters = displacements(robot, tolerances, combined or {}, [candidates.base])
    rows = MeasuredRobot(robot, candidates, parameters).all(np.zeros(len(parameters.names)))[1][0]
    white = np.where(np.isnan(candidates.values)[..., None], 0.0, rows / candidates.sigma[:, None])
    chosen = chosen_poses(white, parameters.tolerances, whole("count", count, 1))
    return plan_of(chosen, white, candidates.readings, parameters)


def plan_of(
    chosen: ChosenPoses, white: FloatArray, readings: FloatArray, parameters: Displacements
) -> MeasurementPlan:
    """Return a plan, compared with random ones."""
    rng, count = np.random.default_rng(0), len(chosen.poses)
    sets = (rng.choice(len(white), count, replace=False) for _ in range(_DRAWS))
    random = float(np.mean([observability(white[some], parameters.tolerances) for some in sets]))
    return MeasurementPlan(
        chosen.poses,
        readings[chosen.poses],
        parameters.names,
        chosen.deviations,
        parameters.tolerances,
        chosen.observability,
        random,
        chosen.exchanges,
        parameters.lengths,
    )


def calibration_table(found: Calibration) -> Table:
    """Return the parameters of a calibration as a table."""
    numbers = found.parameters, found.deviations, found.tolerances
    note = f"Measuring tells {found.seen.rank} of {len(found.names)} combinations of the parameters."
    if found.seen.unseen:
        note += f" It does not tell {'; '.join(found.seen.unseen)}: these keep the design's values."
    names = "parameter", "error", "± standard deviation", "tolerance"
    return table_of("Errors of the geometry", names, in_units(found.names, found.lengths, numbers), note)


def plan_table(found: MeasurementPlan) -> Table:
    """Return the parameters of a plan as a table."""
    rows = in_units(found.names, found.lengths, (found.deviations, found.tolerances))
    note = f"Observability O1 {found.observability:.4g}, of random poses {found.random:.4g}."
    return table_of("What the poses tell", ("parameter", "± standard deviation", "tolerance"), rows, note)


def in_units(
    names: Sequence[str], lengths: Sequence[bool], columns: Sequence[FloatArray]
) -> dict[str, list[float]]:
    """Return numbers by name, in mm and degrees."""
    units = [(1e3, "mm") if length else (180 / np.pi, "deg") for length in lengths]
    rows = np.transpose(columns)
    return {
        f"{name} [{unit}]": [float(factor * x) for x in row]
        for name, (factor, unit), row in zip(names, units, rows, strict=True)
    }
