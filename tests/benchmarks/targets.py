"""What was asked of the speed of this package, and what was found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeAlias

from batch import BEST, CURVE, FACADE, FORCES, FUNCTION, IN_CACHE, MORE, ONE, RUN, SIDE_BY_SIDE, STREAMED
from native import DEPENDENT, INDEPENDENT, NATIVE
from others import BARE, BATCH_POSE, BATCH_QVA, OTHERS, SAMPLE_POSE
from ports import TOGETHER, Loop, bounds
from rounds import Timing

from p3dof.closed_form.compiled.formulas import kernel

Key: TypeAlias = tuple[str, str, str]
Pick: TypeAlias = Callable[[str, str, str], float]
"""Seconds a sample by group, name and machine; raises KeyError where it was not measured."""

PAPER = "symmetric"
GENERAL = "general"
BOTH = (GENERAL, PAPER)
COLUMNS = f"columns, {BEST}"
FACADE_BATCH = f"robot.forces, (N, 3), {BEST}"


@dataclass(frozen=True)
class Target:
    """Something that was asked, or that is told beside it.

    Parameters
    ----------
    what, unit : str
        The quantity.
    limit : float, optional
        What it should be.
    at_least : bool
        Whether it should be at least the limit; at most otherwise.
    """

    what: str
    limit: float | None
    unit: str = "×"
    at_least: bool = False

    def holds(self, value: float) -> bool | None:
        """Return whether a value is as asked; None if nothing was."""
        if self.limit is None:
            return None
        return value >= self.limit if self.at_least else value <= self.limit


@dataclass(frozen=True, eq=False)
class Finding:
    """A target and what was found, by machine: with medians, and with the best rounds."""

    target: Target
    median: Mapping[str, float]
    best: Mapping[str, float]


_Formula: TypeAlias = Callable[[Pick, str], float]


def findings(
    timings: Mapping[Key, Timing],
    loops: Sequence[Loop],
    imports: Mapping[str, float],
    threads: int,
    sizes: Sequence[int],
) -> list[Finding]:
    """Return all that can be told of what was measured."""
    found = [*_operations()]
    port_bounds = {loop.machine: bounds(loop, timings) for loop in loops if loop.level == BEST}
    for target, machines, formula in _formulas(port_bounds, threads, sizes):
        median, best = (_values(formula, _picker(timings, which), machines) for which in ("median", "best"))
        if median:
            found.append(Finding(target, median, best))
    pin_and_numpy, *ours = imports.values()
    for name, seconds in zip(list(imports)[1:], ours, strict=True):
        ratio = {"": seconds / pin_and_numpy}
        found.append(Finding(Target(f"{name} / import pin and numpy", 1.3), ratio, ratio))
    return found


def _picker(timings: Mapping[Key, Timing], statistic: str) -> Pick:
    return lambda *key: float(getattr(timings[key], statistic))


def _values(formula: _Formula, pick: Pick, machines: Sequence[str]) -> dict[str, float]:
    """Return what a formula gives, by machine; nothing where it was not measured."""
    found = {}
    for machine in machines:
        with suppress(KeyError):
            found[machine] = formula(pick, machine)
    return found


def _operations() -> Iterator[Finding]:
    for machine, limit in ((GENERAL, 224), (PAPER, 142)):  # actuators included
        count = {machine: float(kernel(FORCES, machine == PAPER).operations().total())}
        yield Finding(Target(f"operations of the forces, {machine} bodies", limit, ""), count, count)


def _formulas(
    port_bounds: Mapping[str, Mapping[str, float]], threads: int, sizes: Sequence[int]
) -> Iterator[tuple[Target, Sequence[str], _Formula]]:
    """What is asked, of which machines, and how it follows from the timings."""

    def kernel_(pick: Pick, machine: str) -> float:
        return pick(IN_CACHE, COLUMNS, machine)

    def over(group: str, name: str, base: tuple[str, str] = (IN_CACHE, COLUMNS)) -> _Formula:
        return lambda pick, machine: pick(group, name, machine) / pick(*base, machine)

    def share(of: str) -> _Formula:
        return lambda pick, machine: port_bounds[machine][of] / kernel_(pick, machine)

    def faster_than(name: str) -> _Formula:
        return lambda pick, machine: pick(OTHERS, name, PAPER) / kernel_(pick, machine)

    yield Target("port bound / forces, general", 0.55, at_least=True), (GENERAL,), share("bound")
    yield Target("port bound / forces, symmetric", 0.58, at_least=True), (PAPER,), share("bound")
    yield (
        Target("port bound / forces, counted as if all arithmetic shared ports", 0.5, at_least=True),
        BOTH,
        share("counted"),
    )
    yield Target("port bound / forces, all instructions together", None), BOTH, share(TOGETHER)
    yield Target("a bare rnea call / forces", 150, at_least=True), BOTH, faster_than(BARE)
    name = "Pinocchio route from the pose, sample by sample / forces"
    yield Target(name, 5000, at_least=True), BOTH, faster_than(SAMPLE_POSE)
    streamed = STREAMED, COLUMNS
    name = "robot.forces of a million / kernel of a million"
    yield Target(name, 3), BOTH, over(STREAMED, FACADE_BATCH, streamed)
    yield Target("robot.forces of a million / forces", None), BOTH, over(STREAMED, FACADE_BATCH)
    one, many = SIDE_BY_SIDE.format(1), SIDE_BY_SIDE.format(threads)
    wanted = Target(f"{threads} threads / 1, speed of the kernel, in the cache", 1.7, at_least=True)
    yield wanted, BOTH, lambda p, m: p(IN_CACHE, one, m) / p(IN_CACHE, many, m)
    for name, text in ((COLUMNS, "kernel"), (FACADE_BATCH, "robot.forces")):
        both = f"{name}, {threads} threads"
        wanted = Target(f"{threads} threads / 1, speed of the {text}, of a million", 1.7, at_least=True)
        yield wanted, BOTH, lambda p, m, one=name, many=both: p(STREAMED, one, m) / p(STREAMED, many, m)
    yield from _single_samples(over)
    yield Target("forces and derivatives / forces", 3.5), BOTH, over(MORE, "forces and their derivatives")
    forces = MORE, "forces"
    yield Target("forward dynamics / forces", 1.15), BOTH, over(MORE, "forward dynamics", forces)
    yield Target("forces with friction / forces", None), BOTH, over(MORE, "forces with friction", forces)
    yield Target("mass matrix / forces", 1.5), BOTH, over(MORE, "mass matrix")
    for name, limit in ((BATCH_QVA, 15), (BATCH_POSE, 60)):
        yield Target(name, limit, "µs"), (PAPER,), lambda p, m, n=name: p(OTHERS, n, m) * 1e6
    if sizes:
        large, small = sizes[-1], 10_000
        name = f"kernel: a sample of {large:.0e} / of {small:.0e} (cost grows linearly)"
        yield (
            Target(name, None),
            (PAPER,),
            lambda p, m: p(CURVE, f"{COLUMNS} @ {large}", m) / p(CURVE, f"{COLUMNS} @ {small}", m),
        )


def _single_samples(over: Callable[..., _Formula]) -> Iterator[tuple[Target, Sequence[str], _Formula]]:
    for name in ("batch kernel, n = 1", "controller", "controller, baked"):
        for calls in (INDEPENDENT, DEPENDENT):
            text = f"one sample from C, {name}, {calls}"
            yield Target(f"{text} / batch", 5), BOTH, over(NATIVE, f"{name}: {calls}")
        text = f"one sample from C, {name}, {INDEPENDENT}"
        if BEST == "avx512":
            base = IN_CACHE, "columns, avx2"
            target = Target(f"{text} / batch, avx2", None)
            yield target, BOTH, over(NATIVE, f"{name}: {INDEPENDENT}", base)
    yield Target("one sample from Python, bound buffers / batch", 15), BOTH, over(ONE, RUN)
    if BEST == "avx512":
        target = Target("one sample from Python, bound buffers / batch, avx2", None)
        yield target, BOTH, over(ONE, RUN, (IN_CACHE, "columns, avx2"))
    yield Target("one sample from Python, Function(numbers) / batch", None), BOTH, over(ONE, FUNCTION)
    name = "one sample through Manipulator, compiled"
    yield Target(name, 15, "µs"), BOTH, lambda p, m: p(ONE, FACADE, m) * 1e6
