"""Machines drawn at random, as problems of `p3dof.blocks.sweep`: forces over a motion, and poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import (
    Block,
    Distribution,
    Moments,
    Normal,
    Reduction,
    Samples,
    Sweep,
    Uniform,
    digest,
    sweep,
)
from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import InputError
from p3dof._base.files import scratch_folder
from p3dof._base.time_series.wrenches import Load
from p3dof.analysis.designs.columns import OFFSETS
from p3dof.analysis.designs.evaluation import DesignEvaluation
from p3dof.analysis.designs.figures import blocks_of, sampled
from p3dof.analysis.designs.folding import Folded, column_or_number, folding_of
from p3dof.analysis.designs.results import DesignStatus
from p3dof.analysis.tolerances.directions import columns_of_directions, designs_of
from p3dof.analysis.tolerances.pose import (
    NAMES,
    TWO_SIDED,
    ForceCase,
    ForceTolerance,
    PoseTolerance,
    first_order,
    pose_gradient,
    poses_of,
)
from p3dof.closed_form.compiled.designs import compiled_level
from p3dof.closed_form.compiled.kernels import NUMPY
from p3dof.machine.parameters import Geometry

Spread: TypeAlias = Literal["normal", "uniform"]
"""How parameters are spread about their nominal numbers, with the same standard deviation."""


class Draws(NamedTuple):
    """How machines are drawn, and who computes them."""

    machines: int = 2000  # how many
    seed: int = 0  # of the random numbers
    spread: Spread = "normal"  # how parameters are spread
    folder: Any = None  # where blocks are stored, so that it can be resumed
    resume: bool = False  # go on with what is in the folder
    client: Any = None  # who computes; this process without one
    progress: Progress | None = None  # called with the number of machines done and of all

    def made(self, problem: Any, keep: tuple[str, ...], reductions: tuple[Reduction, ...] = ()) -> Sweep:
        """Compute a problem, in the folder or in one of its own."""
        options: dict[str, Any] = {
            "client": self.client,
            "reductions": reductions,
            "keep": keep,
            "seed": self.seed,
            "progress": self.progress,
        }
        if self.folder is not None:
            return sweep(problem, self.folder, resume=self.resume, **options)
        if self.resume:
            raise InputError("resume: expected a folder to resume in")
        with scratch_folder() as place:
            made = sweep(problem, place / "draws", shared=self.client is None, **options)
            _ = made.reductions, self.columns(made, keep)
            return made

    @staticmethod
    def columns(made: Sweep, keep: tuple[str, ...]) -> FloatArray:
        """Return stored columns (items, columns); they are kept with the results once they were read."""
        known: dict[tuple[str, ...], FloatArray] = made.__dict__.setdefault("_read", {})
        if keep not in known:
            found = made.columns(keep)
            known[keep] = np.stack([np.asarray(found[name], dtype=float) for name in keep], axis=1)
        return known[keep]


def sampling_of(names: tuple[str, ...], sigma: FloatArray, draws: Draws) -> Samples:
    """Return how deviations from the nominal numbers are drawn, by the names of parameters."""
    if draws.spread not in get_args(Spread):
        raise InputError(f"spread: expected 'normal' or 'uniform', got {shown(draws.spread)}")
    by_name: Mapping[str, Distribution] = {
        name: Normal(0.0, size) if draws.spread == "normal" else Uniform(-(3**0.5) * size, 3**0.5 * size)
        for name, size in zip(names, sigma.tolist(), strict=True)
    }
    return Samples(by_name, draws.machines)


PEAKS = ("peak_force_a", "peak_force_b", "peak_force_c", "peak_force")


class DrawnForces:
    """Forces of sampled machines, for `p3dof.sweep`; columns of forces at each sample too."""

    def __init__(self, case: ForceCase, sampling: Samples, block_size: int | None = None) -> None:
        load = None if case.wrench is None else Load(case.wrench, case.motion.start).over(case.motion.time)
        fitting = min(2_000, max(100, 2_000_000 // (3 * len(case.motion))))
        self.case, self.sampling = replace(case, wrench=load), sampling
        self.block_size = fitting if block_size is None else block_size
        self.level = compiled_level(None, 1)[0] or NUMPY
        self.forces = DesignEvaluation(case.motion, load, (), (), self.level, 1)
        self.bands = tuple(f"force_{leg}.{k}" for leg in "abc" for k in range(len(case.motion)))

    @property
    def count(self) -> int:
        """How many machines there are."""
        return self.sampling.count

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return (*self.sampling.names, "status", *PEAKS, *self.bands)

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on."""
        case, motion = self.case, self.case.motion
        return {
            "machine": case.machine.to_dict(),
            "bodies": case.bodies,
            "fixed": dict(case.fixed),
            "motion": digest(motion.time, motion.pose, motion.velocity, motion.acceleration),
            "wrench": None if case.wrench is None else digest(case.wrench),
            "level": self.level,
            "sampling": dict(self.sampling.settings()),
        }

    def compute(self, block: Block) -> dict[str, NDArray[Any]]:
        """Return the columns of a block."""
        drawn = self.sampling.draw(block)
        moved = np.stack(list(drawn.values()), axis=1)
        case = self.case
        designs = designs_of(case.directions, case.machine, case.bodies, moved, case.fixed)
        found = self.forces.evaluate(designs)
        peaks = np.column_stack([found.peak_force, found.peak_force.max(axis=1)])
        good = np.flatnonzero(found.status == DesignStatus.FEASIBLE)
        forces = np.full((len(block), 3, len(self.case.motion)), np.nan)
        forces[good] = self._forces(moved[good])
        at_samples = dict(zip(self.bands, forces.reshape(len(block), -1).T, strict=True))
        return {**drawn, "status": found.status, **dict(zip(PEAKS, peaks.T, strict=True)), **at_samples}

    def _forces(self, moved: FloatArray) -> FloatArray:
        """Return the forces of machines at all samples (n, 3, N)."""
        case, samples = self.case, self.forces.samples
        columns = columns_of_directions(case.directions, case.machine, case.bodies, moved, case.fixed)
        folded = folding_of(tuple(columns), case.machine, case.bodies).fold(columns)
        offsets = np.stack([columns.get(name, np.zeros(len(moved))) for name in OFFSETS], axis=1)
        found = np.empty((len(moved), 3, len(samples)))
        for part in blocks_of(len(moved), len(samples)):
            some = Folded(tuple(column_or_number(number, part) for number in folded.numbers))
            found[part] = np.stack(sampled(some, samples, offsets[part]).found.forces, axis=1)
        return found


def drawn_forces(case: ForceCase, draws: Draws) -> ForceTolerance:
    """Return the tolerance of forces by sampled machines; worst cases and shares of first order."""
    linear = first_order(case)
    problem = DrawnForces(case, sampling_of(case.names, case.sigma, draws))
    keep = (*case.names, *PEAKS)
    made = draws.made(problem, keep, (Moments(problem.bands),))
    columns = draws.columns(made, keep)
    drawn, peaks = columns[:, : len(case.names)], columns[:, len(case.names) :]
    good = peaks[np.isfinite(peaks).all(axis=1)]
    if len(good) < 2:
        raise InputError(f"samples: only {len(good)} of {len(peaks)} sampled machines can perform the motion")
    (moments,) = made.reductions.values()
    shape = (3, len(case.motion))
    mean = np.array([moments[name].mean for name in problem.bands]).reshape(shape).T
    of_all = np.array([moments[name].deviation for name in problem.bands]).reshape(shape).T
    deviation = of_all * np.sqrt(len(good) / (len(good) - 1))
    return replace(
        linear,
        method="montecarlo",
        deviation=deviation,
        low=mean - TWO_SIDED * deviation,
        high=mean + TWO_SIDED * deviation,
        peak_mean=good.mean(axis=0),
        peak_deviation=good.std(axis=0, ddof=1),
        peak_high=np.quantile(good, 0.95, axis=0),
        peaks=peaks,
        drawn=drawn,
    )


class DrawnPoses:
    """Errors of poses of sampled machines, for `p3dof.blocks.sweep`."""

    def __init__(
        self, geometry: Geometry, pose: FloatArray, sampling: Samples, block_size: int = 20_000
    ) -> None:
        self.geometry, self.pose, self.sampling, self.block_size = geometry, pose, sampling, block_size
        self.errors = tuple(f"error_{axis}.{k}" for k in range(len(pose)) for axis in ("y", "z", "theta"))

    @property
    def count(self) -> int:
        """How many machines there are."""
        return self.sampling.count

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return (*self.sampling.names, *self.errors)

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on."""
        lengths = {name: getattr(self.geometry, name) for name in ("r", "R", "L")}
        return {"geometry": lengths, "pose": digest(self.pose), "sampling": dict(self.sampling.settings())}

    def compute(self, block: Block) -> dict[str, NDArray[Any]]:
        """Return the columns of a block."""
        drawn = self.sampling.draw(block)
        off = np.zeros((len(block), len(NAMES)))
        for name, values in drawn.items():
            off[:, NAMES.index(name)] = values
        errors = poses_of(self.geometry, self.pose, off) - self.pose
        return {**drawn, **dict(zip(self.errors, errors.reshape(len(block), -1).T, strict=True))}


def first_order_pose(
    geometry: Geometry, pose: FloatArray, names: tuple[str, ...], sigma: FloatArray, worst: float
) -> PoseTolerance:
    """Return the tolerance of poses to first order."""
    gradient = pose_gradient(geometry, pose)[..., [NAMES.index(name) for name in names]]
    spread = gradient * sigma
    covariance = spread @ np.swapaxes(spread, -1, -2)
    variance = (spread**2).sum(axis=-1)
    deviation = np.sqrt(variance)
    shares = spread**2 / np.where(variance > 0, variance, 1.0)[..., None]
    return PoseTolerance(
        "gradient", names, sigma, pose, gradient, deviation, TWO_SIDED * deviation, covariance,
        worst * np.abs(spread).sum(axis=-1), shares, worst,
    )  # fmt: skip


def drawn_poses(geometry: Geometry, linear: PoseTolerance, draws: Draws) -> PoseTolerance:
    """Return the tolerance of poses by sampled machines; worst cases and shares of first order."""
    poses = linear.pose.reshape(-1, 3)
    problem = DrawnPoses(geometry, poses, sampling_of(linear.names, linear.sigma, draws))
    made = draws.made(problem, problem.columns)
    columns = draws.columns(made, problem.columns)
    drawn, errors = columns[:, : len(linear.names)], columns[:, len(linear.names) :]
    good = errors[np.isfinite(errors).all(axis=1)]
    if len(good) < 2:
        raise InputError(f"samples: only {len(good)} of {len(errors)} sampled machines assemble")
    shape = linear.pose.shape
    by_pose = good.reshape(len(good), -1, 3)
    apart = by_pose - by_pose.mean(axis=0)
    covariance = np.einsum("mki,mkj->kij", apart, apart) / (len(good) - 1)
    return replace(
        linear,
        method="montecarlo",
        deviation=good.std(axis=0, ddof=1).reshape(shape),
        high=np.quantile(np.abs(good), 0.95, axis=0).reshape(shape),
        covariance=covariance.reshape(*shape, 3),
        errors=errors.reshape(-1, *shape),
        drawn=drawn,
    )
