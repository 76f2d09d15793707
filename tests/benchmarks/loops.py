"""Compiled dynamics of robots with closed loops, beside the general layer and what others do.

All run interleaved in one process, on one thread: compare the ratios of one run. MuJoCo's `mj_inverse` is
that of the open tree, without constraints, called from C like the compiled code; CasADi gets the same
operations and prints them as C. Run with ``make benchmark``. Timings are never a test: machines differ.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import pinocchio as pin
from cpp_rival import NotHereError, rival
from rich.table import Table
from robots import GALLERY, motion
from rounds import Contender, Timing, calling, described, load_average, measure, wide_console

import p3dof
from p3dof import ClosedLoopModel
from p3dof._base.errors import DynamicsError, P3dofError
from p3dof._base.tracing.printing import function_of
from p3dof.loops import CompiledLoop
from p3dof.loops.compiled import build
from p3dof.loops.compiled.function import pointers, sizes
from p3dof.loops.compiled.printing import lanes_source

ROUNDS, ROWS, MANY, TIMES = 15, 64, 512, 8
INVERSE, FORWARD = "inverse_dynamics", "forward_dynamics"
C, BOUND, ROWS_OF, CALL, BATCH = "C, one sample", "bound call", "rows", "ClosedLoopModel", "its batch"
FEW_ROWS, WHOLE, FEW_WHOLE = "100 rows", "its batch, compiled", "its batch, compiled, 100 rows"
LANES = {"avx512": "SIMD8", "avx2": "SIMD4"}
MUJOCO, CASADI = "MuJoCo, open tree, C", "CasADi's C"
ROBOTS = ("five_bar", "leg", "delta", "stewart")
MOTION, RIVAL = "motion", "Pinocchio C++, RNEA + LU"
DRIVER = """\
#include <stddef.h>
#include <string.h>
void turns(void (*call)(double *const *), long count, long rows, long size, double *samples, double *out)
{
    for (long i = 0; i < count; ++i) {
        double *buffers[2] = {samples + size * (i % rows), out};
        call(buffers);
    }
}
void turns_of_mujoco(void (*call)(const void *, void *), const void *model, void *data, long count, long rows,
                     const long *sizes, double *const *samples, double *const *places)
{
    for (long i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k)
            memcpy(places[k], samples[k] + sizes[k] * (i % rows), sizeof(double) * (size_t)sizes[k]);
        call(model, data);
    }
}
"""
_CALL_CASADI = """
void casadi_bound(double *const *buffers)
{
    static casadi_real w[forces_SZ_W + 1];
    static casadi_int iw[forces_SZ_IW + 1];
    const casadi_real *arg[forces_SZ_ARG + 1] = {buffers[0]};
    casadi_real *res[forces_SZ_RES + 1] = {buffers[1]};
    forces(arg, res, iw, w, 0);
}
"""
PROMISES = (
    ("C / ClosedLoopModel", INVERSE, C, CALL, 300.0),
    ("C / MuJoCo's open tree, C", INVERSE, C, MUJOCO, 4.0),
    ("C / CasADi's C", INVERSE, C, CASADI, None),
    ("C / Pinocchio C++", INVERSE, C, RIVAL, None),
    ("C / Pinocchio C++", MOTION, C, RIVAL, None),
    ("SIMD8 / C", INVERSE, "SIMD8", C, 4.0),
    ("SIMD4 / C", INVERSE, "SIMD4", C, 2.5),
    ("rows from Python / batch", INVERSE, ROWS_OF, BATCH, 100.0),
    ("batch, compiled / rows", INVERSE, WHOLE, ROWS_OF, 0.5),
    ("the same, 100 rows", INVERSE, FEW_WHOLE, FEW_ROWS, 0.5),
    ("C / ClosedLoopModel", FORWARD, C, CALL, 150.0),
)
"""What is faster, for which function, than what, and at least how many times."""


def library(text: str, folder: Path, name: str, flags: Sequence[str] = ()) -> ctypes.CDLL:
    """Return C, compiled as what it is compared with."""
    file, made = folder / f"{name}.c", folder / f"{name}.so"
    file.write_text(text)
    command = [
        build.compiler() or "gcc",
        "-O2",
        "-march=native",
        "-ffp-contract=fast",
        "-shared",
        "-fPIC",
        "-w",
    ]
    subprocess.run([*command, *flags, "-o", str(made), str(file), "-lm"], check=True)
    return ctypes.CDLL(str(made))


class FromC:
    """Calls a function of one sample from C, on one of some samples after the other."""

    def __init__(self, driver: ctypes.CDLL, call: Any, samples: np.ndarray, results: int) -> None:
        self.samples, self.out = np.ascontiguousarray(samples), np.zeros(results)
        self._turns, self._call = driver.turns, ctypes.cast(call, ctypes.c_void_p)
        self._turns.restype = None

    def __call__(self, count: int) -> float:
        rows, size = self.samples.shape
        arguments = (ctypes.c_long(count), ctypes.c_long(rows), ctypes.c_long(size))
        places = ctypes.c_void_p(self.samples.ctypes.data), ctypes.c_void_p(self.out.ctypes.data)
        start = time.perf_counter()
        self._turns(self._call, *arguments, *places)
        return time.perf_counter() - start


class OpenTree:
    """`mj_inverse` of the same tree, called from C at the same states; no constraint counts."""

    def __init__(
        self, driver: ctypes.CDLL, loop: ClosedLoopModel, file: Path, rows: Sequence[np.ndarray]
    ) -> None:
        import mujoco

        sys.path.append(str(Path(__file__).parents[1]))
        from mujoco_robots import in_mujoco

        robot = in_mujoco(loop, file)
        self.model, self.data = robot.model, mujoco.MjData(robot.model)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        states = [
            (robot.qpos(q), robot.qvel(q, v), robot.qacc(q, v, a)) for q, v, a in zip(*rows, strict=True)
        ]
        self.states = [np.ascontiguousarray(column) for column in zip(*states, strict=True)]
        self.states = [np.array(column) for column in self.states]
        here = [self.data.qpos, self.data.qvel, self.data.qacc]
        self._sizes = (ctypes.c_long * 3)(*(len(array) for array in here))
        self._samples = pointers([array.ctypes.data for array in self.states])
        self._places = pointers([array.ctypes.data for array in here])
        found = next(Path(mujoco.__file__).parent.glob("libmujoco.so*"))
        self._call = ctypes.cast(ctypes.CDLL(str(found)).mj_inverse, ctypes.c_void_p)
        self._turns = driver.turns_of_mujoco
        self._turns.restype = None
        self(1)
        tree = pin.rnea(loop.model, loop.model.createData(), *(column[0] for column in rows))
        plain = [there for at, _, there, _, kind in robot.joints() if not kind]
        assert plain, "no joint to compare"
        span = [(at, there) for _, at, _, there, kind in robot.joints() if not kind]
        mine = np.concatenate([tree[at] for at, _ in span])
        theirs = np.concatenate([self.data.qfrc_inverse[there] for _, there in span])
        np.testing.assert_allclose(theirs, mine, rtol=0, atol=1e-6 * np.abs(mine).max())

    def __call__(self, count: int) -> float:
        data = ctypes.c_void_p(self.data._address)
        arguments = (ctypes.c_long(count), ctypes.c_long(len(self.states[0])), self._sizes)
        start = time.perf_counter()
        self._turns(
            self._call, ctypes.c_void_p(self.model._address), data, *arguments, self._samples, self._places
        )
        return time.perf_counter() - start


def casadi_call(compiled: CompiledLoop, folder: Path, name: str) -> Any:
    """Return CasADi's C of the forces, from the same operations."""
    import casadi

    traced = compiled.function(INVERSE)
    names = {key: getattr(casadi, key) for key in ("sqrt", "sin", "cos", "tanh", "floor", "atan2")}
    x = casadi.SX.sym("x", len(traced.symbols))
    found = function_of(
        traced.tape, traced.symbols, traced.results, SimpleNamespace(**names, minimum=casadi.fmin)
    )(*casadi.vertsplit(x))
    forces = casadi.Function("forces", [x], [casadi.cse(casadi.vertcat(*found))])
    return library(forces_text(forces) + _CALL_CASADI, folder, f"casadi_{name}").casadi_bound


def forces_text(function: Any) -> str:
    """Return CasADi's C of a function, with the sizes that it needs."""
    import casadi

    generator = casadi.CodeGenerator("forces.c")
    generator.add(function)
    sizes_of = zip(("ARG", "RES", "IW", "W"), (1, 1, function.sz_iw(), function.sz_w()), strict=True)
    return "\n".join(f"#define forces_SZ_{name} {size}" for name, size in sizes_of) + "\n" + generator.dump()


_IN_LANES = f"""
void in_lanes(ptrdiff_t blocks, ptrdiff_t inputs, const lanes *in, lanes *out);
void in_lanes(ptrdiff_t blocks, ptrdiff_t inputs, const lanes *in, lanes *out)
{{
    for (ptrdiff_t i = 0; i < blocks; ++i) {{
        {INVERSE}_lanes(in + inputs * i, out);
        __asm__ volatile("" : : "r"(out) : "memory");
    }}
}}
"""


def in_lanes(made: ctypes.CDLL, compiled: CompiledLoop, inputs: dict[str, np.ndarray]) -> Callable[[], None]:
    """Return a call of the function on samples that are in lanes already."""
    traced = compiled.function(INVERSE)
    samples, width = np.hstack([inputs[name] for name in traced.inputs]), made.width()
    blocks = samples.reshape(-1, width, samples.shape[1]).transpose(0, 2, 1)
    room = np.zeros(blocks.size + len(traced.results) * width + 16)
    start = -room.ctypes.data % 64 // 8
    room[start : start + blocks.size] = blocks.ravel()
    out = start + blocks.size
    places = [ctypes.c_void_p(room.ctypes.data + 8 * place) for place in (start, out)]
    numbers = ctypes.c_ssize_t(len(blocks)), ctypes.c_ssize_t(samples.shape[1])

    def call() -> None:
        made.in_lanes(*numbers, *places)

    call.kept = room  # type: ignore[attr-defined]  # C has its address only
    call()
    tau = room[out : out + width * traced.outputs["tau"]].reshape(-1, width).T
    expected = compiled.inverse_dynamics(*(inputs[name][-width:] for name in ("q", "v", "a"))).tau
    np.testing.assert_allclose(tau, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    return call


def lanes(made: ctypes.CDLL, compiled: CompiledLoop, inputs: dict[str, np.ndarray]) -> Callable[[], None]:
    """Return a call of the function on rows, without what Python does around it."""
    traced = compiled.function(INVERSE)
    function = getattr(made, f"{INVERSE}_many")
    given = [np.ascontiguousarray(inputs[name]) for name in traced.inputs]
    found = [np.empty((len(given[0]), size)) for size in traced.outputs.values()]
    count = ctypes.c_ssize_t(len(given[0]))
    arguments = (
        pointers([array.ctypes.data for array in given]),
        sizes([array.shape[1] for array in given]),
        pointers([array.ctypes.data for array in found]),
    )

    def call() -> None:
        function(count, *arguments)

    call.kept = given, found  # type: ignore[attr-defined]  # C has their addresses only

    call()
    expected = compiled.inverse_dynamics(inputs["q"], inputs["v"], inputs["a"])
    assert expected.tau is not None
    np.testing.assert_allclose(found[0], expected.tau, rtol=1e-9, atol=1e-9 * np.abs(expected.tau).max())
    return call


def contenders(
    name: str, loop: ClosedLoopModel, file: Path, folder: Path, driver: ctypes.CDLL
) -> Iterator[Contender]:
    """Return all ways for one robot."""
    q, v, a, tau, *_ = motion(loop)
    q, v, a, tau = (np.ascontiguousarray(array[:MANY]) for array in (q, v, a, tau))
    compiled = loop.compile(threads=1)
    long = [np.tile(array, (TIMES, 1)) for array in (q, v, a, tau)]
    few = [np.roll(array, 5, axis=0)[:: MANY // ROWS] for array in (q, v, a, tau)]
    columns = {INVERSE: (0, 1, 2), FORWARD: (0, 1, 3)}
    for what, used in columns.items():
        traced = compiled.function(what)
        samples = np.hstack([few[i] for i in used])
        (made,) = build.libraries([lanes_source([traced])])
        call = FromC(driver, getattr(made, f"{what}_bound"), samples, len(traced.results))
        call(1)
        bound = compiled.bind(what)
        for group, i in zip(traced.inputs, used, strict=True):
            bound.inputs[group][:] = few[i][0]
        bound.run()
        if not bound.outputs["trusted"][0] > 0:
            raise DynamicsError(f"{what} is not to be trusted along the motion")
        np.testing.assert_allclose(call.out, np.concatenate([*bound.outputs.values()]))
        yield Contender(what, C, name, call)
        yield calling(what, BOUND, name, bound.run)
        arrays = [(q, v, a, tau)[i] for i in used]
        yield calling(
            what, ROWS_OF, name, partial(getattr(compiled, what), *(long[i] for i in used)), TIMES * MANY
        )
        single = [array[MANY // 3] for array in arrays]
        yield calling(what, CALL, name, partial(getattr(loop, what), *single))
    yield calling(INVERSE, BATCH, name, lambda: loop.inverse_dynamics_batch(q, v, a), MANY)
    whole = partial(loop.inverse_dynamics_batch, method=compiled)
    yield calling(INVERSE, WHOLE, name, partial(whole, *long[:3]), TIMES * MANY)
    yield calling(INVERSE, FEW_ROWS, name, partial(compiled.inverse_dynamics, q[:100], v[:100], a[:100]), 100)
    yield calling(INVERSE, FEW_WHOLE, name, partial(whole, q[:100], v[:100], a[:100]), 100)
    told = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    for level, words in LANES.items():
        if {"avx512": "avx512dq", "avx2": "avx2"}[level] in told:
            (made,) = build.libraries([lanes_source([compiled.function(INVERSE)], _IN_LANES)], level)
            given = dict(zip("qva", long, strict=False))
            yield calling(INVERSE, words, name, in_lanes(made, compiled, given), TIMES * MANY)
            yield calling(INVERSE, f"{words}, rows", name, lanes(made, compiled, given), TIMES * MANY)
    if find_spec("mujoco") is not None:
        try:
            yield Contender(INVERSE, MUJOCO, name, OpenTree(driver, loop, file, few[:3]))
        except (AssertionError, ValueError, KeyError) as error:
            sys.stdout.write(f"{name}: not in MuJoCo: {error}\n")
    yield from in_cpp(name, loop, few[:3], folder, driver)
    if find_spec("casadi") is not None:
        samples = np.hstack(few[:3])
        call = FromC(
            driver, casadi_call(compiled, folder, name), samples, len(compiled.function(INVERSE).results)
        )
        call(1)
        forces = loop.inverse_dynamics(few[0][0], few[1][0], few[2][0]).tau
        np.testing.assert_allclose(call.out[: len(forces)], forces, rtol=0, atol=1e-9 * np.abs(forces).max())
        yield Contender(INVERSE, CASADI, name, call)


def in_cpp(
    name: str, loop: ClosedLoopModel, rows: Sequence[np.ndarray], folder: Path, driver: ctypes.CDLL
) -> Iterator[Contender]:
    """Return an expert's C++, and beside it our code for what else it does: v and a from independent ones."""
    motors = len(loop.actuated)
    try:
        other, free = rival(loop, rows[0][0], folder, name)
    except NotHereError as error:
        sys.stdout.write(f"{name}: no rival in C++: {error}\n")
        return
    compiled = loop.compile(threads=1)
    traced = compiled.function(MOTION)
    (made,) = build.libraries([lanes_source([traced])])
    place = list(compiled.independent_places)
    q, v, a = rows
    jobs = {
        (INVERSE, RIVAL): (other.inverse_dynamics_bound, np.hstack(rows), motors, 0),
        (MOTION, RIVAL): (other.motion_bound, np.hstack([q, v[:, free], a[:, free]]), motors, 0),
        (MOTION, C): (
            made.motion_bound,
            np.hstack([q, v[:, place], a[:, place]]),
            len(traced.results),
            2 * loop.model.nv,
        ),
    }
    forces = loop.inverse_dynamics(*(column[0] for column in rows)).tau
    for (what, words), (call, samples, results, start) in jobs.items():
        contender = FromC(driver, call, samples, results)
        contender(1)
        found = contender.out[start : start + motors]
        np.testing.assert_allclose(found, forces, rtol=0, atol=1e-9 * np.abs(forces).max())
        yield Contender(what, words, name, contender)


def preparation(loop: ClosedLoopModel) -> tuple[float, float]:
    """Return the seconds that tracing and compiling inverse dynamics take, nothing being known before."""
    before = os.environ.get("XDG_CACHE_HOME")
    with tempfile.TemporaryDirectory() as empty:
        os.environ["XDG_CACHE_HOME"] = empty
        try:
            start = time.perf_counter()
            compiled = loop.compile()
            compiled.operations(INVERSE)
            traced = time.perf_counter()
            compiled.bind(INVERSE)
            return traced - start, time.perf_counter() - traced
        finally:
            if before is None:
                del os.environ["XDG_CACHE_HOME"]
            else:
                os.environ["XDG_CACHE_HOME"] = before


def times_table(found: dict[tuple[str, str, str], Timing], names: Sequence[str]) -> Table:
    """Return nanoseconds a sample."""
    result = Table(title="compiled dynamics, one thread, ns a sample", title_justify="left")
    for head in ("", "", *names):
        result.add_column(head, justify="left" if not head else "right")
    for group, name in dict.fromkeys((key[0], key[1]) for key in found):
        row = [found.get((group, name, robot)) for robot in names]
        result.add_row(group, name, *(f"{one.best * 1e9:.3g}" if one else "" for one in row))
    return result


def ratios_table(found: dict[tuple[str, str, str], Timing], names: Sequence[str]) -> Table:
    """Return how many times as fast, and what is promised."""
    result = Table(title="times as fast, by the best rounds", title_justify="left")
    for head in ("", "", "at least", *names):
        result.add_column(head, justify="left" if not head else "right")
    for words, group, fast, slow, least in PROMISES:
        cells = []
        for robot in names:
            pair = found.get((group, fast, robot)), found.get((group, slow, robot))
            if pair[0] is None or pair[1] is None:
                cells.append("")
                continue
            ratio = pair[1].best / pair[0].best
            cells.append(f"{ratio:.3g}{'' if least is None or ratio >= least else ' !'}")
        result.add_row(group, words, "" if least is None else f"{least:g}", *cells)
    cells = []
    for robot in names:
        if (INVERSE, C, robot) not in found:
            cells.append("")
            continue
        bound, call = (found[INVERSE, name, robot].best * 1e9 for name in (BOUND, C))
        cells.append(f"{bound:.0f} / {3 * call + 100:.0f}{'' if bound <= 3 * call + 100 else ' !'}")
    result.add_row(INVERSE, "bound call [ns] / 3 C + 100", "", *cells)
    return result


@click.command()
@click.option(
    "--only", multiple=True, default=("five_bar", "leg", "delta", "stewart"), help="Robots of the gallery."
)
@click.argument("files", nargs=-1, type=click.Path(path_type=Path, exists=True))
def main(only: Sequence[str], files: Sequence[Path]) -> None:
    """Measure and print; FILES are more robots, with their sidecars beside them."""
    warnings.simplefilter("ignore")
    console = wide_console()
    paths = {name: GALLERY / f"{name}.urdf" for name in only}
    paths |= {file.parent.name if file.stem == "robot" else file.stem: file for file in files}
    prepared = Table(title="inverse dynamics, made from nothing", title_justify="left")
    for head in ("", "nv", "operations", "traced [s]", "compiled [s]"):
        prepared.add_column(head, justify="left" if not head else "right")
    ways: list[Contender] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        driver = library(DRIVER, folder, "driver")
        for name, file in paths.items():
            loop = p3dof.load_robot(file)
            seconds = preparation(loop)
            count = loop.compile().operations(INVERSE)
            prepared.add_row(name, str(loop.model.nv), str(count), *(f"{x:.2f}" for x in seconds))
            try:
                ways += contenders(name, loop, file, folder, driver)
            except P3dofError as error:
                console.print(f"{name}: left out: {error}", soft_wrap=True)
        found = measure(ways, ROUNDS, share=1.0)
    for table in (times_table(found, list(paths)), ratios_table(found, list(paths)), prepared):
        console.print(table)
    console.print(f"best of {ROUNDS} interleaved rounds; {described()}; {load_average()}", soft_wrap=True)


if __name__ == "__main__":
    main()
