"""One table of whole calls as a user makes them, in calls of bare `pin.rnea` of the same model, and its gate.

    make benchmark          the table, beside that of the last release
    make ratios             the same; fails when a ratio is 1.5 times worse
    make benchmark-table    the table becomes the reference of this processor, in table.json

CPU time, all in one process, on one thread; of fresh processes theirs. A ratio is that of a call and what it
is measured by, before and after it: what slows the machine slows all three. Ratios are medians of
interleaved rounds. What is worse is measured twice more, and fails when it is worse each time. The reference
is that of the same processor; where there is none, the largest ratios of all, and rows whose ratio is decided
by the vectors of the processor are then not judged.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from datetime import date
from functools import partial
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path
from typing import Any

import click
import numpy as np
import pinocchio as pin
from batch import kernel_call
from inputs import CACHED, MILLION, rows
from rich import box
from rich.table import Table
from robots import GALLERY, BareForward, Newton, Rival, motion
from rounds import described, load_average, machine_description, wide_console

import p3dof
from p3dof.runs import PD, ComputedTorque, ControlLoop, Integration

Work = Callable[[], object]

REFERENCE = Path(__file__).with_name("table.json")
WORSE = 1.5
"""How many times a ratio of the last release fails."""

ROUNDS, TURN = 5, 4e-3
"""How often all rows have their turn, and the least time of one [s]."""

FEW, RUNS, DESIGNS = 1001, 1000, 20_000
HOME, AT_1_KHZ = np.zeros(3), ControlLoop(1000)
RNEA = "rnea"


@dataclass(frozen=True, eq=False)
class Row:
    """A whole call, and what it is compared with.

    Parameters
    ----------
    name, each : str
        What is called, and what `count` of a call are: samples, runs.
    call, bare : callable
        The call, and what its time is divided by, `bares` of them at once.
    kernel, peer : (callable, count), optional
        What the call is made around, and what others do.
    by : str
        What `bare` is.
    vectors : bool
        Whether the level of the processor decides the ratio.
    """

    name: str
    call: Work
    bare: Work
    each: str = "call"
    count: int = 1
    bares: int = 1
    kernel: tuple[Work, int] | None = None
    peer: tuple[str, Work, int] | None = None
    by: str = RNEA
    vectors: bool = False


@dataclass(frozen=True)
class Found:
    """Medians of a row: seconds a piece, and ratios to what is measured by."""

    seconds: float
    ratio: float
    kernel: float | None
    peer: float | None


def compare(last: Mapping[str, float], now: Mapping[str, float]) -> tuple[list[str], list[str]]:
    """Return a line for each ratio that is worse than of the last release; and what else there is to say."""
    both = [name for name in last if name in now]
    worse = [
        f"{name}: {now[name]:.3g}, {now[name] / last[name]:.2f} times {last[name]:.3g}, of the last release"
        for name in both
        if now[name] > WORSE * last[name]
    ]
    told = [f"{name}: no longer measured" for name in last if name not in now]
    told += [f"{name}: {now[name]:.3g}, not in the last release" for name in now if name not in last]
    return worse, told


def judged(
    last: Mapping[str, float], now: dict[str, float], again: Callable[[str], float]
) -> tuple[list[str], list[str]]:
    """Compare, and measure twice more what is worse: the best ratio counts."""
    for _ in range(2):
        for name in [name for name in now if name in last and now[name] > WORSE * last[name]]:
            now[name] = min(now[name], again(name))
    return compare(last, now)


def bare_rnea(model: pin.Model, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> Work:
    """Return calls of `pin.rnea`, one a row."""
    data, rows = model.createData(), list(zip(q, v, a, strict=True))

    def call() -> None:
        for row in rows:
            pin.rnea(model, data, *row)

    return call


def calling_each(function: Callable[..., object], *columns: np.ndarray) -> Work:
    """Return a call with another row each time."""
    samples = cycle(list(zip(*columns, strict=True)))
    return lambda: function(*next(samples))


def quiet(*arguments: str) -> Work:
    """Return a run of Python in a process of its own."""
    usual = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return partial(
        subprocess.run, [sys.executable, *arguments], check=True, env=usual, stdout=subprocess.DEVNULL
    )


def fresh_rows() -> Iterator[Row]:
    """Programs, in imports of NumPy and Pinocchio."""
    bare = quiet("-c", "import numpy, pinocchio")
    force = "import p3dof; p3dof.load().forces([0, 0, 0], [0, 0, 0], [0, 0, 0], method={!r})"
    for name, arguments in {
        "load(), one compiled force": ("-c", force.format("compiled")),
        "load(), one force by Pinocchio": ("-c", force.format("pinocchio")),
        "p3dof simulate": ("-m", "p3dof", "simulate"),
        "p3dof loop --help": ("-m", "p3dof", "loop", "--help"),
    }.items():
        yield Row(name, quiet(*arguments), bare, "process", by="import pinocchio")


def force_rows(robot: p3dof.Manipulator, rnea: dict[str, Any]) -> Iterator[Row]:
    """Forces and inverse dynamics of the paper's machine."""
    few, some, many = (p3dof.paper_motion(count) for count in (FEW, 100_000, MILLION))
    kernel = kernel_call(robot.kernels, "inverse_dynamics", CACHED), CACHED
    state = few.pose[7], few.velocity[7], few.acceleration[7]
    name = "inverse_dynamics"
    yield Row(f"{name}, {FEW:,}", partial(robot.inverse_dynamics, few), each="sample", count=FEW, **rnea)
    yield Row("forces, 1", partial(robot.forces, *state), peer=mujoco_inverse(robot), **rnea)
    yield Row(
        "forward_dynamics, 1",
        partial(robot.forward_dynamics, *state[:2], HOME),
        peer=forward(robot, few),
        **rnea,
    )
    by = partial(robot.inverse_dynamics, few, method="virtual-power")
    yield Row(f"{name}, virtual power, {FEW:,}", by, each="sample", count=FEW, **rnea)
    compiled: dict[str, Any] = {"each": "sample", "kernel": kernel, "vectors": True, **rnea}
    for motion_of in (some, many):
        call = partial(robot.inverse_dynamics, motion_of, method="compiled")
        yield Row(f"{name}, compiled, {len(motion_of):,}", call, count=len(motion_of), **compiled)

    def read() -> object:
        found = robot.inverse_dynamics(some, method="compiled")
        return found.joints, found.closure_error, found.power_residual

    yield Row(f"{name}, compiled, {len(some):,}, evidence read", read, count=len(some), **compiled)
    bound = robot.kernels.bind_inverse_dynamics()
    bound.state[:] = state
    call = partial(robot.forces, *state, method="compiled")
    yield Row("forces, compiled, 1", call, kernel=(bound.run, 1), **rnea)
    for count in (2, 1000, MILLION):
        call = partial(robot.forces, *rows(count), method="compiled")
        yield Row(f"forces, compiled, {count:,}", call, count=count, **compiled | {"vectors": count > 2})


def mujoco_inverse(robot: p3dof.Manipulator) -> tuple[str, Work, int] | None:
    """Return MuJoCo's `mj_inverse` of the same machine, called from Python."""
    if not find_spec("mujoco"):
        return None
    import mujoco
    from simulators import Mujoco

    model = mujoco.MjModel.from_xml_string(Mujoco(robot).text)
    return "mj_inverse", partial(mujoco.mj_inverse, model, mujoco.MjData(model)), 1


def forward(robot: p3dof.Manipulator, few: p3dof.Motion) -> tuple[str, Work, int]:
    """Return bare `pin.constraintDynamics` of the same machine."""
    bare, joints = BareForward(robot.loop), robot.inverse_dynamics(few).joints
    return "constraintDynamics", partial(bare, joints.q[7], joints.v[7], HOME), 1


def run_rows(robot: p3dof.Manipulator, rnea: dict[str, Any]) -> Iterator[Row]:
    """Runs in time; the kernel of a run is the same, prepared."""
    weight, wanted = robot.forces(HOME, HOME, HOME), p3dof.paper_motion()

    def python(measured: Any) -> Any:
        return weight - 3000 * measured.sliders - 100 * measured.slider_velocities

    for name, controller, loop in (
        ("falling", 0.98 * weight, ControlLoop()),
        ("PD at 1 kHz", PD(robot, wanted), AT_1_KHZ),
        ("computed torque at 1 kHz", ComputedTorque(robot, wanted), AT_1_KHZ),
        ("a controller in Python at 1 kHz", python, AT_1_KHZ),
    ):
        options: dict[str, Any] = {"controller": controller, "control": loop, "samples": 2}
        assert robot.simulate(1.0, **options).finished
        prepared = robot.prepare_run(1.0, **options)
        yield Row(
            f"simulate, 1 s, {name}", partial(robot.simulate, 1.0, **options), kernel=(prepared, 1), **rnea
        )
    rng = np.random.default_rng(0)
    columns = {
        "platform.mass": robot.parameters.bodies.platform.mass * rng.normal(1, 0.05, RUNS),
        "frequency": rng.uniform(4, 6, RUNS),
    }
    more = {"controller": PD(robot, wanted), "control": AT_1_KHZ, "threads": 1}
    many = partial(robot.simulate_many, 0.25, columns, **more, integration=Integration(scheme="rk4"))
    yield Row(f"simulate_many, 1/4 s, PD, {RUNS:,}", many, each="run", count=RUNS, vectors=True, **rnea)


def file_rows(folder: Path, rnea: dict[str, Any]) -> Iterator[Row]:
    """Files: a motion, and a table of designs by the command, after its imports."""
    from p3dof.cli import app

    written, table, out = folder / "motion.csv", folder / "designs.csv", folder / "found.csv"
    p3dof.paper_motion(DESIGNS).to_csv(written)
    text = partial(np.loadtxt, written, delimiter=",", skiprows=1)
    size = written.stat().st_size
    yield Row(
        "Motion.from_csv", partial(p3dof.Motion.from_csv, written), text, "byte", size, size, by="np.loadtxt"
    )
    rng, paper = np.random.default_rng(0), p3dof.PAPER.geometry
    scale = rng.normal(1, 0.01, (DESIGNS, 2)) * [paper.L, p3dof.PAPER.bodies.platform.mass]
    np.savetxt(table, scale, delimiter=",", header="L,platform.mass", comments="")
    arguments = ["designs", str(table), "--samples", "200", "--threads", "1", "--out", str(out)]

    def designs() -> None:
        with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere):
            app(arguments, standalone_mode=False)

    yield Row(f"p3dof designs, {DESIGNS:,}", designs, each="design", count=DESIGNS, vectors=True, **rnea)


def robot_rows() -> Iterator[Row]:
    """Any robot: its batch around compiled rows, single calls beside what an expert writes."""
    for name in ("five_bar", "stewart"):
        loop = p3dof.load_robot(GALLERY / f"{name}.urdf")
        q, v, a, *_ = (np.ascontiguousarray(column) for column in motion(loop))
        rnea: dict[str, Any] = {"bare": bare_rnea(loop.model, q, v, a), "bares": len(q)}
        compiled, long = loop.compile(threads=1), [np.tile(column, (8, 1)) for column in (q, v, a)]
        whole = partial(loop.inverse_dynamics_batch, *long, method=compiled)
        inner = partial(compiled.inverse_dynamics, *long), len(long[0])
        more: dict[str, Any] = {"each": "sample", "count": len(long[0]), "kernel": inner, "vectors": True}
        yield Row(f"{name}: batch, compiled, {len(long[0]):,}", whole, **more, **rnea)
        batch = partial(loop.inverse_dynamics_batch, q, v, a)
        yield Row(f"{name}: batch, {len(q)}", batch, each="sample", count=len(q), **rnea)
        expert = "plain Pinocchio", calling_each(Rival(loop, q[0]), q, v, a), 1
        call = calling_each(loop.inverse_dynamics, q, v, a)
        yield Row(f"{name}: inverse_dynamics, 1", call, peer=expert, **rnea)
        away = [pin.integrate(loop.model, row, 0.01 * np.cos(np.arange(loop.model.nv))) for row in q]
        newton = "Newton in NumPy", calling_each(Newton(loop), np.array(away)), 1
        assemble = calling_each(partial(loop.assemble, None), np.array(away))
        yield Row(f"{name}: assemble, from near", assemble, peer=newton, **rnea)


def all_rows(folder: Path) -> list[Row]:
    """Return all that is measured."""
    robot = p3dof.load()
    joints = robot.inverse_dynamics(p3dof.paper_motion(FEW)).joints
    rnea = {"bare": bare_rnea(robot.model, joints.q, joints.v, joints.a), "bares": FEW}
    parts = (fresh_rows(), force_rows(robot, rnea), run_rows(robot, rnea), file_rows(folder, rnea))
    return [row for part in (*parts, robot_rows()) for row in part]


def seconds(work: Work, times: int) -> float:
    """Return the CPU time of calls, that of processes which they started among it."""
    begun = _spent()
    for _ in range(times):
        work()
    return (_spent() - begun) / times


def _spent() -> float:
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + others.ru_utime + others.ru_stime


def times_of(work: Work) -> int:
    """Return how many calls fill a turn; the first may have to prepare something."""
    if seconds(work, 1) > 20 * TURN:
        return 1
    count = 1
    while (took := seconds(work, count) * count) < TURN / 4:
        count *= 4
    return max(1, round(count * TURN / took))


class Measured:
    """A row that is measured round by round: everything beside its own yardstick."""

    def __init__(self, row: Row) -> None:
        self.row, self.values = row, {"call": [], "kernel": [], "peer": []}  # type: ignore[var-annotated]
        self.seconds: list[float] = []
        self.works = {"call": (row.call, row.count)}
        if row.kernel is not None:
            self.works["kernel"] = row.kernel
        if row.peer is not None:
            self.works["peer"] = row.peer[1:]
        self.times = {name: times_of(work) for name, (work, _) in self.works.items()}
        self.bares = times_of(row.bare)

    def turn(self, only: Sequence[str] = ("call", "kernel", "peer")) -> None:
        """Measure each once, between two of what it is measured by."""
        row, before = self.row, seconds(self.row.bare, self.bares)
        for name in (name for name in only if name in self.works):
            work, count = self.works[name]
            took, after = seconds(work, self.times[name]) / count, seconds(row.bare, self.bares)
            self.values[name].append(took / ((before + after) / 2 / row.bares))
            if name == "call":
                self.seconds.append(took)
            before = after

    def again(self) -> float:
        """Return the ratio of new rounds."""
        self.values["call"].clear()
        for _ in range(ROUNDS):
            self.turn(["call"])
        return self.found.ratio

    @property
    def found(self) -> Found:
        middle = {name: statistics.median(some) if some else None for name, some in self.values.items()}
        ratio = middle["call"]
        assert ratio is not None
        return Found(statistics.median(self.seconds), ratio, middle["kernel"], middle["peer"])


def digits(value: float | None, scale: float = 1.0) -> str:
    """Return three digits, without exponent; nothing of nothing."""
    if value is None:
        return ""
    number = value * scale
    return f"{number:,.0f}" if number >= 100 else f"{number:.3g}" if number >= 1e-4 else f"{number:.1e}"


def printed(rows: Mapping[str, Measured], last: Mapping[str, float]) -> Table:
    """Return the table."""
    title = "whole calls, CPU time; ratios are to bare pin.rnea of the same model, unless said"
    result = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    result.add_column("")
    for head in ("µs", "ratio", "kernel", "peer", "last", "now / last"):
        result.add_column(head, justify="right", no_wrap=True)
    for name, one in rows.items():
        found, row, then = one.found, one.row, last.get(name)
        by = "" if row.by == RNEA else f", to {row.by}"
        peer = f"{row.peer[0]} {digits(found.peer)}" if row.peer else ""
        cells = [digits(found.seconds, 1e6), digits(found.ratio), digits(found.kernel), peer, digits(then)]
        result.add_row(f"{name}, a {row.each}{by}", *cells, then and f"{found.ratio / then:.2f}")
    return result


def references() -> list[dict[str, Any]]:
    """Return what was written, the latest first."""
    found: list[dict[str, Any]] = json.loads(REFERENCE.read_text("utf-8")) if REFERENCE.exists() else []
    return found


def is_here(made: Mapping[str, Any], level: str) -> bool:
    """Whether a reference is of this processor, at this level."""
    here = dict(machine_description())["processor"]
    return bool(made["machine"]["processor"] == here and made["level"] == level)


def reference_for(made: Sequence[dict[str, Any]], level: str) -> dict[str, Any]:
    """Return what this processor is compared with: its own reference, else the largest ratios of all."""
    if not made:
        return {"level": level, "ratios": {}}
    largest = {name: max(one["ratios"].get(name, 0.0) for one in made) for name in made[0]["ratios"]}
    return next((one for one in made if is_here(one, level)), made[0] | {"ratios": largest})


def reference_of(rows: Mapping[str, Measured], level: str) -> dict[str, Any]:
    """Return what the next release is compared with."""
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
    ratios = {name: float(f"{one.found.ratio:.3g}") for name, one in rows.items()}
    made = {"commit": done.stdout.strip(), "date": date.today().isoformat(), "level": level}
    return made | {"machine": dict(machine_description()), "ratios": ratios}


@click.command()
@click.option(
    "--judge", is_flag=True, help=f"Fail when a ratio is {WORSE:g} times worse than of the last release."
)
@click.option("--write", is_flag=True, help="Write the reference of this processor, in table.json.")
@click.option("--only", multiple=True, help="Rows whose name has this in it; all by default.")
def main(judge: bool, write: bool, only: tuple[str, ...]) -> None:
    """Measure, print and compare."""
    warnings.simplefilter("ignore")
    console, level = wide_console(), p3dof.load().kernels.level
    known = reference_for(references(), level)
    with tempfile.TemporaryDirectory() as folder:
        rows = {
            row.name: Measured(row)
            for row in all_rows(Path(folder))
            if not only or any(part in row.name for part in only)
        }
        for _ in range(ROUNDS):
            for one in rows.values():
                one.turn()
        same = not known["ratios"] or is_here(known, level)
        other = set() if same else {name for name, one in rows.items() if one.row.vectors}
        last = {
            name: ratio
            for name, ratio in known["ratios"].items()
            if name not in other and (name in rows or not only)
        }
        now = {name: one.found.ratio for name, one in rows.items() if name not in other}
        worse, told = judged(last, now, lambda name: rows[name].again()) if judge else compare(last, now)
    console.print(printed(rows, known["ratios"]))
    console.print(
        f"medians of {ROUNDS} interleaved rounds; {level}; {described()}; {load_average()}", soft_wrap=True
    )
    if known["ratios"]:
        of = f"{known['commit']}, {known['date']}, {known['level']}, {known['machine']['processor']}"
        console.print(f"last release: {of}", soft_wrap=True)
    if other:
        told.append(f"of another processor or level; not judged: {'; '.join(sorted(other))}")
    for line in [*(told if known["ratios"] else ()), *(f"WORSE: {line}" for line in worse)]:
        console.print(line, soft_wrap=True, markup=False)
    if write:
        kept = [one for one in references() if not is_here(one, level)]
        text = json.dumps([reference_of(rows, level), *kept], indent=1, ensure_ascii=False)
        REFERENCE.write_text(text + "\n", encoding="utf-8")
    if judge and worse:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
