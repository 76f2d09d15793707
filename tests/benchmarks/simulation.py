"""Runs at equal error: what each way takes where its step or tolerance makes it as exact as the others.

Two runs of the paper's machine, half a second each: falling from home under constant forces a little too
small to hold it, and under PD at 1 kHz towards a place 20 mm away. Every way runs with finer and finer
settings; for each error that is asked for, the cheapest setting that reaches it is then timed in interleaved
rounds. The error is that of the sliders at the end, against a run at the smallest tolerances. Of the rivals
only the stepping is timed; of ours the whole call, which watches reach, singularities and limits. Run with
``make benchmark``. Timings are never a test: machines differ; compare the ratios of one run.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import click
import numpy as np
import simulators
from rich.table import Table
from rounds import Contender, Timing, described, load_average, measure, wide_console

import p3dof
from p3dof._base.errors import P3dofError
from p3dof.closed_form import kinematics
from p3dof.runs import ControlLoop, Integration, Springs

DURATION, TICK = 0.5, 1e-3
FALL, PD = "falling under constant forces", "PD at 1 kHz"
TARGETS = (1e-5, 1e-7, 1e-9, 1e-11)
LONGEST = 2.0
"""Seconds after which no finer setting is tried."""
ROUNDS = 7
MANY = 1024
HOME = np.zeros(3)
TOLERANCES = tuple(10.0**-k for k in range(3, 13))
OURS = "p3dof, compiled"

Run = Callable[[], tuple[np.ndarray, float]]
"""Returns the sliders at the end, and the seconds of processor time that it took."""


@dataclass(frozen=True, eq=False)
class Way:
    """A way to simulate, with settings from coarse to fine."""

    name: str
    settings: Sequence[tuple[str, Run]]


@dataclass(frozen=True, eq=False)
class Task:
    """What to simulate: forces over slider positions and speeds, changed once a tick or never."""

    name: str
    springs: Springs
    held: bool

    def forces(self, sliders: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        s = self.springs
        return s.preload - s.stiffness * (sliders - s.rest) - s.damping * speeds

    @property
    def steps(self) -> tuple[float, ...]:
        """Steps that fit into the run, and into a tick."""
        coarse = TICK if self.held else 20 * TICK
        return tuple(coarse / 2**k for k in range(16))


def tasks(robot: p3dof.Manipulator) -> tuple[Task, ...]:
    """Return both."""
    weight = robot.forces(HOME, HOME, HOME)
    constant = Springs(0.0, preload=weight * [0.95, 1.0, 1.05])
    stiff = Springs(np.full(3, 1e3), rest=[0.02, 0.02, -0.02], damping=np.full(3, 100.0), preload=weight)
    return Task(FALL, constant, held=False), Task(PD, stiff, held=True)


def ours(robot: p3dof.Manipulator, task: Task, method: str, rtol: float) -> tuple[np.ndarray, float]:
    """Simulate with this package."""
    options = {
        "controller": task.springs if task.held else task.springs.preload,
        "control": ControlLoop(1 / TICK if task.held else None),
        "integration": Integration(rtol, rtol / 100),
        "method": method,
        "samples": 2,
    }
    begin = time.process_time()
    done = robot.simulate(DURATION, **options)
    seconds = time.process_time() - begin
    assert done.finished
    return done.sliders[-1], seconds


def in_lanes(robot: p3dof.Manipulator, task: Task, step: float) -> tuple[np.ndarray, float]:
    """Simulate many runs at once; the time is that of one of them."""
    begin = time.process_time()
    done = robot.simulate_many(
        DURATION,
        MANY,
        controller=task.springs if task.held else task.springs.preload,
        control=ControlLoop(1 / TICK if task.held else None),
        integration=Integration(scheme="rk4", step=step),
        threads=1,
    )
    seconds = time.process_time() - begin
    assert (np.asarray(done.stop) < 0).all()
    return kinematics.inverse_kinematics(robot.parameters.geometry, done.pose[-1]).sliders, seconds / MANY


def ways(robot: p3dof.Manipulator, task: Task) -> Iterator[Way]:
    """Return all that there is here."""
    for name, method in {
        OURS: "compiled",
        "p3dof, y z θ on NumPy and SciPy": "virtual-power",
        "p3dof, all joints by Pinocchio and SciPy": "pinocchio",
    }.items():
        settings = [(f"rtol {rtol:.0e}", partial(ours, robot, task, method, rtol)) for rtol in TOLERANCES]
        yield Way(name, settings)
    if hasattr(robot, "simulate_many"):
        settings = [(f"{step * 1e3:.4g} ms", partial(in_lanes, robot, task, step)) for step in task.steps]
        yield Way(f"p3dof, each of {MANY} runs in lanes, RK4", settings)
    for name, simulate in simulators.available(robot, task.held).items():
        settings = []
        for step in task.steps:
            settings.append((f"{step * 1e3:.4g} ms", partial(simulate, task.forces, DURATION, TICK, step)))
        yield Way(name, settings)


def cheapest(way: Way, exact: np.ndarray) -> dict[float, tuple[str, float, Run]]:
    """Return by error that is asked for what is said of the setting, its error, and the run."""
    found: dict[float, tuple[str, float, Run]] = {}
    for name, run in way.settings:
        try:
            end, seconds = run()
        except (P3dofError, AssertionError):
            continue  # this coarse it goes astray
        error = float(np.abs(end - exact).max())
        for target in TARGETS:
            if error <= target and target not in found:
                found[target] = name, error, run
        if len(found) == len(TARGETS) or seconds > LONGEST:
            break
    return found


def timed(name: str, what: str, target: float, run: Run) -> Contender:
    """Return a run as a contender."""

    def runs(count: int) -> float:
        return sum(run()[1] for _ in range(count))

    return Contender(what, name, f"{target:g}", runs)


def table(
    task: Task,
    chosen: dict[str, dict[float, tuple[str, float, Run]]],
    found: dict[tuple[str, str, str], Timing],
) -> Table:
    """Return multiples of real time with the setting, and how many times as fast ours is."""
    result = Table(title=f"{task.name}: × real time, setting, and the first's speed over its own")
    result.add_column("")
    for target in TARGETS:
        result.add_column(f"{target:.0e} m", justify="right")
    for name, settings in chosen.items():
        cells = []
        for target in TARGETS:
            if target not in settings:
                cells.append("-")
                continue
            best = found[task.name, name, f"{target:g}"].best
            first = found.get((task.name, OURS, f"{target:g}"))
            ratio = f", {best / first.best:.3g}" if first and name != OURS else ""
            cells.append(f"{DURATION / best:.3g} ({settings[target][0]}){ratio}")
        result.add_row(name, *cells)
    return result


@click.command()
@click.option("--only", multiple=True, help="Ways whose name has this in it; all by default.")
def main(only: Sequence[str]) -> None:
    """Measure and print."""
    warnings.simplefilter("ignore")
    robot, console = p3dof.load(), wide_console()
    for task in tasks(robot):
        exact, _ = ours(robot, task, "virtual-power", 1e-13)
        chosen = {}
        for way in ways(robot, task):
            if not only or any(part in way.name for part in (*only, OURS)):
                chosen[way.name] = cheapest(way, exact)
        contenders = [
            timed(name, task.name, target, run)
            for name, settings in chosen.items()
            for target, (_, _, run) in settings.items()
        ]
        console.print(table(task, chosen, measure(contenders, ROUNDS, share=5.0)))
    console.print(f"best of {ROUNDS} interleaved rounds; {described()}; {load_average()}", soft_wrap=True)


if __name__ == "__main__":
    main()
