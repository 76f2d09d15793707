"""The main job: forces over a motion by both methods, and by others, side by side, with a verdict."""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Progress, Readable, Watch, frozen_array
from p3dof._base.errors import InputError, SampleError
from p3dof._base.samples import OnInvalid
from p3dof._base.tables import (
    ShownInNotebook,
    Table,
    Tabular,
    columns_by,
    formatted,
    html_of,
    notebook_html,
    table_of,
    time_text,
)
from p3dof.closed_form.compiled import MachineKernels
from p3dof.machine.motion import Motion, WrenchOverTime
from p3dof.machine.motion.core import require_motion
from p3dof.machine.parameters import LEGS, Parameters
from p3dof.methods import InverseDynamics, Method, engines, evidence_table
from p3dof.methods.registry import TOLERANCE, prepare

ENGINE_TOLERANCE = 1e-9
"""The same for another engine, and for the compiled kernels."""

_PAIR: tuple[Method, Method] = ("pinocchio", "virtual-power")


class ComparedMachine(Protocol):
    """What the methods are compared on: `p3dof.Manipulator`."""

    @property
    def parameters(self) -> Parameters:
        """The machine."""

    @property
    def kernels(self) -> MachineKernels:
        """Its compiled kernels."""

    def forces(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        *,
        wrench: ArrayLike | None = ...,
        method: Method = ...,
    ) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""

    def inverse_dynamics(
        self,
        motion: Motion,
        *,
        wrench: WrenchOverTime = ...,
        on_invalid: OnInvalid = ...,
        method: Method = ...,
        progress: Progress | None = ...,
    ) -> InverseDynamics:
        """Return the actuator forces over a motion."""


@dataclass(frozen=True, eq=False)
class Opinion(Readable):
    """What the compiled kernels, or another engine, found.

    Parameters
    ----------
    name : str
        Which, and its version or level.
    forces : ndarray, shape (N, 3)
        Its forces; NaN where the motion is invalid [N].
    seconds : float
        How long it took [s].
    """

    name: str
    forces: FloatArray
    seconds: float


@dataclass(frozen=True, eq=False)
class Comparison(ShownInNotebook, Tabular):
    """The same motion by two methods that share nothing but the parameters, and by others.

    Parameters
    ----------
    first, second : InverseDynamics
        By Pinocchio, and by virtual powers; each decides by itself which samples are valid.
    seconds : tuple of two float
        How long each took [s].
    compiled : Opinion or None
        What the compiled kernels found; None if no sample is valid by both methods.
    engines : tuple of Opinion
        What other engines found.
    tolerance : float
        Largest difference that passes, as a share of the largest force; at least 1e-9 for the opinions.
    """

    first: InverseDynamics
    second: InverseDynamics
    seconds: tuple[float, float]
    compiled: Opinion | None
    engines: tuple[Opinion, ...] = ()
    tolerance: float = TOLERANCE

    def __repr__(self) -> str:
        others = "".join(f", {one.name}" for one in self.opinions)
        return f"Comparison({self.first.method}, {self.second.method}{others}: {self.verdict})"

    @property
    def opinions(self) -> tuple[Opinion, ...]:
        """What the compiled kernels and the engines found."""
        return self.engines if self.compiled is None else (self.compiled, *self.engines)

    @property
    def both_valid(self) -> NDArray[np.bool_]:
        """Which samples both methods take, shape (N,)."""
        return self.first.valid & self.second.valid

    @property
    def differing(self) -> NDArray[np.intp]:
        """Samples that one method takes and the other refuses, shape (K,)."""
        return np.flatnonzero(self.first.valid != self.second.valid)

    @property
    def difference(self) -> FloatArray:
        """Magnitude of first less second, shape (N, 3), NaN where one of them is [N]."""
        return np.abs(self.first.forces - self.second.forces)

    @property
    def largest_difference(self) -> float:
        """Largest difference of any actuator's force over the samples that both take [N]."""
        return float(self.difference[self.both_valid].max(initial=0.0))

    @property
    def share(self) -> float:
        """The largest difference as a share of the largest force."""
        return self._share(self.largest_difference)

    @property
    def agree(self) -> bool:
        """Whether the two methods take the same samples, some at all, and find the same forces."""
        same = not len(self.differing) and bool(self.both_valid.any())
        return same and self.share <= self.tolerance

    def opinion_share(self, opinion: Opinion) -> float:
        """Return how far an opinion is from the virtual powers, as a share of the largest force.

        Parameters
        ----------
        opinion : Opinion
            One of `opinions`.

        Returns
        -------
        float
            NaN as `opinion_difference`.
        """
        return self._share(self.opinion_difference(opinion))

    def opinion_difference(self, opinion: Opinion) -> float:
        """Return the largest difference of an opinion from the virtual powers [N].

        Parameters
        ----------
        opinion : Opinion
            One of `opinions`.

        Returns
        -------
        float
            NaN, which agrees with nothing, where the opinion lacks the force of a valid sample.
        """
        return float(np.abs(opinion.forces - self.second.forces)[self.second.valid].max(initial=0.0))

    @property
    def confirmed(self) -> bool:
        """Whether all opinions are as the two methods say."""
        allowed = max(self.tolerance, ENGINE_TOLERANCE)
        return all(self.opinion_share(opinion) <= allowed for opinion in self.opinions)

    @property
    def passed(self) -> bool:
        """Whether all agree, and the machine can perform the motion."""
        return self.agree and self.confirmed and self.second.possible

    @property
    def verdict(self) -> str:
        """Whether the two methods agree, in one sentence."""
        word = "agree" if self.agree else "DISAGREE"
        return (
            f"the methods {word}: {self.largest_difference:.1e} N, {self.share:.1e} of the largest force "
            f"(tolerance {self.tolerance:.0e}), over {int(self.both_valid.sum())} samples"
        )

    @property
    def verdict_on_samples(self) -> str:
        """On which samples the methods, each judging by itself, differ, in one sentence; empty if on none."""
        if not len(self.differing):
            return ""
        i = int(self.differing[0])
        taken, refused = (self.first, self.second) if self.first.valid[i] else (self.second, self.first)
        return (
            f"the methods DISAGREE on which samples are valid: {len(self.differing)} of "
            f"{len(self.first.valid)}, the first at t = {self.first.time[i]:g} s (sample {i}), which "
            f"{taken.method} takes and {refused.method} refuses"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader of these numbers should know; see `InverseDynamics.warnings`."""
        return self.second.warnings

    def to_columns(self) -> dict[str, FloatArray]:
        """Return the forces by all, and the difference of the two methods, (N,) each, by name and unit."""
        named = {result.method: result.forces for result in (self.first, self.second)}
        named |= {opinion.name: opinion.forces for opinion in self.engines}
        found = {"t [s]": self.first.time}
        for name, forces in named.items():
            found |= columns_by(f"f{{}} {name} [N]", LEGS, forces)
        return found | columns_by("difference {} [N]", LEGS, self.first.forces - self.second.forces)

    def _share(self, difference: float) -> float:
        largest = float(self.second.force_scale.max())
        return difference / largest if largest else difference


def compare(
    robot: ComparedMachine,
    motion: Motion,
    wrench: WrenchOverTime = None,
    on_invalid: OnInvalid = "raise",
    others: Iterable[str] = (),
    tolerance: float = TOLERANCE,
    watch: Watch | None = None,
) -> Comparison:
    """Compare the methods on a motion; `p3dof.Manipulator.compare` has the arguments."""
    require_motion(motion)
    names = _engine_names(others)
    allowed = float(frozen_array("tolerance", tolerance, ()))
    if allowed < 0:
        raise InputError(f"tolerance: expected a share of the largest force, 0 or more, got {allowed:g}")
    seen = (lambda *_: nullcontext()) if watch is None else watch
    (first, first_seconds), (second, second_seconds) = _by_both(robot, motion, wrench, on_invalid, seen)
    seconds = first_seconds, second_seconds
    if not (first.valid & second.valid).any():
        return Comparison(first, second, seconds, None, (), allowed)
    opinions = tuple(_ask(name, robot, second, seen) for name in names)
    return Comparison(first, second, seconds, _compiled(robot, second), opinions, allowed)


def _by_both(
    robot: ComparedMachine, motion: Motion, wrench: WrenchOverTime, on_invalid: OnInvalid, watch: Watch
) -> list[tuple[InverseDynamics, float]]:
    """Solve by both methods; an invalid sample raises as asked only if both refuse the same ones."""

    def timed(name: Method, policy: OnInvalid) -> tuple[InverseDynamics, float]:
        prepare(robot.forces, motion, name)
        with watch(name, len(motion)) as progress:
            start = time.perf_counter()
            result = robot.inverse_dynamics(
                motion, wrench=wrench, on_invalid=policy, method=name, progress=progress
            )
        return result, time.perf_counter() - start

    try:
        return [timed(name, on_invalid) for name in _PAIR]
    except SampleError:
        runs = [timed(name, "nan") for name in _PAIR]
        if np.array_equal(runs[0][0].valid, runs[1][0].valid):
            raise
        return runs


def _engine_names(others: Iterable[str]) -> tuple[str, ...]:
    names = (others,) if isinstance(others, str) else tuple(dict.fromkeys(others))
    names = tuple(engines.ENGINES) if "all" in names else names
    for name in names:
        engines.available(name)  # raises for what is none
    return names


def _valid_motion(known: InverseDynamics) -> Motion:
    valid, motion = known.valid, known.motion
    columns = (motion.pose[valid], motion.velocity[valid], motion.acceleration[valid])
    return Motion(motion.time[valid], *columns, check=False, start=motion.start)


def _ask(name: str, robot: ComparedMachine, known: InverseDynamics, watch: Watch) -> Opinion:
    """Let an engine compute the forces of the valid samples."""
    engine = engines.load(name, robot.parameters)
    asked, forces = _valid_motion(known), np.full_like(known.forces, np.nan)
    with watch(name, len(asked)) as progress:
        start = time.perf_counter()
        forces[known.valid] = engine.forces(asked, known.wrench[known.valid], progress)
    return Opinion(f"{name} {engine.version}", forces, time.perf_counter() - start)


def _compiled(robot: ComparedMachine, known: InverseDynamics) -> Opinion:
    """Compute the forces of the valid samples by the kernels, without what else a result carries."""
    asked, forces = _valid_motion(known), np.full_like(known.forces, np.nan)
    states = asked.pose, asked.velocity, asked.acceleration
    wrench = known.wrench[known.valid]
    robot.forces(*states, wrench=wrench, method="compiled")  # the first call prepares
    start = time.perf_counter()
    forces[known.valid] = robot.forces(*states, wrench=wrench, method="compiled")
    return Opinion(f"compiled ({robot.kernels.level})", forces, time.perf_counter() - start)


def agreement_table(found: Comparison) -> Table:
    """Return how well the forces of the two methods agree."""
    worst, second = found.difference[found.both_valid].max(axis=0, initial=0.0), found.second
    peak, rms, scale = second.peak_forces, second.rms_forces, second.force_scale
    rows = {
        leg: (peak[k], rms[k], formatted(worst[k], ".1e"), formatted(worst[k] / (scale[k] or 1.0), ".1e"))
        for k, leg in enumerate(LEGS)
    }
    header = (
        "actuator",
        "largest force [N]",
        "RMS force [N]",
        "largest difference [N]",
        "of its largest force",
    )
    return table_of(f"Forces by {found.first.method} and by {second.method}", header, rows, decimals=6)


def opinions_table(found: Comparison) -> Table:
    """Return how far others are from the virtual powers."""
    rows = {
        opinion.name: (
            formatted(found.opinion_difference(opinion), ".1e"),
            formatted(found.opinion_share(opinion), ".1e"),
            time_text(opinion.seconds / max(1, int(found.second.valid.sum()))),
        )
        for opinion in found.opinions
    }
    header = ("by", "largest difference [N]", "of the largest force", "time per sample")
    return table_of(f"Others against {found.second.method}", header, rows)


@html_of.register(Comparison)
def comparison_html(found: Comparison) -> str:
    """Return how a notebook shows a comparison, as HTML."""
    evidence = evidence_table(found.first, found.second, seconds=found.seconds)
    tables = [agreement_table(found), evidence]
    tables += [opinions_table(found)] if found.opinions else []
    warnings = (*filter(None, [found.verdict_on_samples]), *found.warnings)
    return notebook_html("Comparison", found.verdict, tables, warnings)
