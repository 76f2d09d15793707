"""Speed of the dynamics of any robot, beside what an expert writes for one in plain Pinocchio.

The robots are those of the gallery, and any others whose files are given. All run interleaved in one process:
with BLAS threads as they are by default, unless OPENBLAS_NUM_THREADS says otherwise. Run with
``make benchmark``. Timings are never a test: machines differ; compare the ratios of one run.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from itertools import cycle
from pathlib import Path

import click
import numpy as np
import pinocchio as pin
from rich.table import Table
from rounds import Contender, Timing, calling, described, load_average, measure, wide_console

import p3dof
from p3dof import ClosedLoopModel
from p3dof._base.errors import P3dofError
from p3dof.loops.assembly import TOLERANCE, Limits
from p3dof.loops.linear import RANK_TOLERANCE

GALLERY = Path(__file__).parents[2] / "docs" / "_static" / "gallery"
ROUNDS = 15
SAMPLES = 512
STARTS, LEAST = 64, 1e-6
INVERSE, FORWARD, HYBRID, COMPLETE, ASSEMBLE, FAR = (
    "inverse dynamics",
    "forward dynamics",
    "hybrid dynamics",
    "complete, from the sample before",
    "assemble, from 0.01 beside",
    "assemble, from anywhere",
)
PLAIN, BATCH = "plain Pinocchio: ", "batch: "


class Rival:
    """Inverse dynamics as an expert writes it for one robot: no checks, no evidence, one LU decomposition.

    Which closures are redundant and which freedoms are idle he knows beforehand.
    """

    def __init__(self, loop: ClosedLoopModel, q: np.ndarray) -> None:
        self.model, self.data, self.other = loop.model, loop.model.createData(), loop.model.createData()
        self.constraints, self.actuated = loop.constraint_models, loop.actuated_v
        self.datas = pin.StdVec_ConstraintData()
        for constraint in self.constraints:
            self.datas.append(constraint.createData())
        passive = np.setdiff1d(np.arange(loop.model.nv), self.actuated)
        J = loop.closure_jacobian(q)
        rank = loop.rank(q)
        self.rows = independent(J[:, passive].T, rank)
        follow = passive[independent(J[self.rows][:, passive], rank)]
        self.kept = np.sort(np.concatenate((self.actuated, follow)))
        self.size = len(self.kept)

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        model, data, n = self.model, self.data, len(self.actuated)
        pin.forwardKinematics(model, data, q, v, a)
        pin.computeJointJacobians(model, data)
        for constraint, found in zip(self.constraints, self.datas, strict=True):
            constraint.calc(model, data, found)
        J = pin.getConstraintsJacobian(model, data, self.constraints, self.datas)
        f = pin.rnea(model, self.other, q, v, a)
        A = np.zeros((model.nv, self.size))
        A[self.actuated, range(n)] = 1.0
        A[:, n:] = J[self.rows].T if self.size - n < len(J) else J.T
        if self.size < model.nv:
            A, f = A[self.kept], f[self.kept]
        return np.linalg.solve(A, f)[:n]


class Newton:
    """Newton's method that closes loops by shortest steps, halved until the error falls; nothing besides."""

    def __init__(self, loop: ClosedLoopModel) -> None:
        self.model, self.data, self.constraints = loop.model, loop.model.createData(), loop.constraint_models
        self.datas = pin.StdVec_ConstraintData()
        for constraint in self.constraints:
            self.datas.append(constraint.createData())
        self.pairs = list(zip(self.constraints, self.datas, strict=True))
        self._contents = [data.extract() for data in self.datas]
        self._errors = [data.constraint_position_error for data in self._contents]

    def __call__(self, q: np.ndarray) -> np.ndarray | None:
        r = self._error(q)
        for _ in range(100):
            if np.abs(r).max() <= TOLERANCE:
                return q
            J = pin.getConstraintsJacobian(self.model, self.data, self.constraints, self.datas)
            step, cost, fraction = np.linalg.lstsq(J, -r, rcond=RANK_TOLERANCE)[0], r @ r, 1.0
            while True:
                there = pin.integrate(self.model, q, fraction * step)
                r = self._error(there)
                if r @ r < cost:
                    break
                fraction /= 2.0
                if fraction < LEAST:
                    return None
            q = there
        return None

    def _error(self, q: np.ndarray) -> np.ndarray:
        pin.computeJointJacobians(self.model, self.data, q)
        for constraint, data in self.pairs:
            constraint.calc(self.model, self.data, data)
        return np.concatenate(self._errors)


class BareForward:
    """`pin.constraintDynamics`, and nothing around it."""

    def __init__(self, loop: ClosedLoopModel) -> None:
        self.model, self.data, self.actuated = loop.model, loop.model.createData(), loop.actuated_v
        self.models, self.datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for constraint in loop.constraint_models:
            self.models.append(pin.convertToRigidConstraintModel(loop.model, constraint.extract()))
            self.datas.append(self.models[-1].createData())
        pin.initConstraintDynamics(self.model, self.data, self.models, self.datas)
        self.settings = pin.ProximalSettings(1e-12, 1e-12, 1e-8, 50)

    def __call__(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        force = np.zeros(self.model.nv)
        force[self.actuated] = tau
        return pin.constraintDynamics(
            self.model, self.data, q, v, force, self.models, self.datas, self.settings
        )


def independent(A: np.ndarray, count: int) -> np.ndarray:
    """Return columns of A that are far from dependent on each other."""
    from scipy.linalg import qr

    return np.sort(qr(A, mode="r", pivoting=True)[1][:count])


def motion(loop: ClosedLoopModel) -> tuple[np.ndarray, ...]:
    """Return a motion of the actuated joints around the reference, in small steps; and its forces."""
    start = loop.assemble()
    joints = [loop.model.getJointId(name) for name in loop.actuated]
    home = np.array([value_of(loop.model, start.q, joint) for joint in joints])
    phase = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    wave = 0.05 * np.sin(phase[:, None] + np.arange(len(home)))
    angle = home + wave - wave[0]
    rates, change = np.roll(wave, -SAMPLES // 4, axis=0), -wave
    q = start.q
    rows = []
    for i in range(SAMPLES):
        state = loop.complete(angle[i], rates[i], change[i], q)
        found = loop.hybrid_dynamics(state.q, state.v, change[i])
        rows.append((state.q, state.v, found.a, found.tau, angle[i], rates[i], change[i]))
        q = state.q
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def value_of(model: pin.Model, q: np.ndarray, joint: int) -> float:
    at = model.idx_qs[joint]
    return float(q[at] if model.nqs[joint] == 1 else np.arctan2(q[at + 1], q[at]))


def contenders(name: str, loop: ClosedLoopModel) -> Iterator[Contender]:
    """Return all ways for one robot; every call has another sample."""
    q, v, a, tau, values, rates, change = motion(loop)

    def one(what: str, function: Callable[..., object], *columns: np.ndarray) -> Contender:
        samples = cycle(list(zip(*columns, strict=True)))
        return calling(what.partition(": ")[2] or what, what, name, lambda: function(*next(samples)))

    def many(what: str, function: Callable[..., object], *columns: np.ndarray) -> Contender:
        return calling(what, BATCH + what, name, lambda: function(*columns), SAMPLES)

    plain = len(loop.constraint_models) == len(loop.sidecar.closures) and not loop.sidecar.couplings
    if plain and not loop.passive:
        rival, bare = Rival(loop, q[0]), BareForward(loop)
        for i in (0, SAMPLES // 3):
            forces = loop.inverse_dynamics(q[i], v[i], a[i]).tau
            np.testing.assert_allclose(rival(q[i], v[i], a[i]), forces, rtol=1e-6, atol=1e-6)
        yield one(PLAIN + INVERSE, rival, q, v, a)
        yield one(PLAIN + FORWARD, bare, q, v, tau)
    yield one(INVERSE, loop.inverse_dynamics, q, v, a)
    yield many(INVERSE, loop.inverse_dynamics_batch, q, v, a)
    yield one(FORWARD, loop.forward_dynamics, q, v, tau)
    yield one(HYBRID, loop.hybrid_dynamics, q, v, change)
    yield many(HYBRID, loop.hybrid_dynamics_batch, q, v, change)
    before = np.roll(q, 1, axis=0)
    yield one(COMPLETE, loop.complete, values, rates, change, before)
    yield many(COMPLETE, loop.complete_batch, values, rates, change)
    away = [pin.integrate(loop.model, row, 0.01 * np.cos(np.arange(loop.model.nv))) for row in q]
    yield one(ASSEMBLE, lambda guess: loop.assemble(None, guess), np.array(away))
    if plain and loop.constraint_models:
        newton, limits, generator = Newton(loop), Limits(loop.model), np.random.default_rng(0)
        far = [limits.random(loop.model, q[0], generator) for _ in range(STARTS)]
        closes = [start for start in far if newton(start) is not None]
        for start in far:
            loop.assemble(None, start)  # closes from everywhere
        yield one(PLAIN + ASSEMBLE, newton, np.array(away))
        yield one(PLAIN + FAR, newton, np.array(closes))
        yield one(FAR, lambda guess: loop.assemble(None, guess), np.array(closes))


def table(found: dict[tuple[str, str, str], Timing], loops: dict[str, ClosedLoopModel]) -> Table:
    """Return microseconds a sample, and ratios."""
    result = Table(title="dynamics of any robot, µs a sample", title_justify="left")
    heads = (
        "",
        "robot",
        "nv",
        "plain Pinocchio",
        "a single call",
        "batch",
        "single / plain",
        "single / batch",
    )
    for head in heads:
        result.add_column(head, justify="left" if head in ("", "robot") else "right")
    for what in (INVERSE, FORWARD, HYBRID, COMPLETE, ASSEMBLE, FAR):
        for name, loop in loops.items():
            times = [found.get((what, prefix + what, name)) for prefix in (PLAIN, "", BATCH)]
            if times[1] is None:
                continue
            plain, single, batch = (time and time.best for time in times)
            numbers = (f"{time * 1e6:.3g}" if time else "" for time in (plain, single, batch))
            ratios = (f"{single / other:.2f}" if other else "" for other in (plain, batch))
            result.add_row(what, name, str(loop.model.nv), *numbers, *ratios)
    return result


@click.command()
@click.option("--only", multiple=True, help="Robots of the gallery; all by default.")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path, exists=True))
def main(only: Sequence[str], files: Sequence[Path]) -> None:
    """Measure and print; FILES are pairs of a robot's file and its sidecar."""
    warnings.simplefilter("ignore")
    pairs = [(file, file.with_suffix(".yaml")) for file in sorted(GALLERY.glob("*.urdf"))]
    pairs = [pair for pair in pairs if not only or pair[0].stem in only]
    pairs += zip(files[::2], files[1::2], strict=True)
    console = wide_console()
    loops: dict[str, ClosedLoopModel] = {}
    ways: list[Contender] = []
    for file, sidecar in pairs:
        loop = p3dof.load_robot(file, sidecar if sidecar.exists() else None)
        name = file.parent.name if file.stem == "robot" else file.stem
        try:
            ways += contenders(name, loop)
            loops[name] = loop
        except P3dofError as error:
            console.print(f"{name}: left out: {error}", soft_wrap=True)
    found = measure(ways, ROUNDS, share=1.0)
    console.print(table(found, loops))
    threads = os.environ.get("OPENBLAS_NUM_THREADS", "as by default")
    console.print(
        f"best of {ROUNDS} interleaved rounds; BLAS threads: {threads}; {described()}; {load_average()}",
        soft_wrap=True,
    )


if __name__ == "__main__":
    main()
