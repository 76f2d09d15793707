"""The package's own ways on batches and on single samples, as contenders."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from timeit import Timer

import numpy as np
from inputs import CACHED, MACHINES, MILLION, columns, kernel_columns, rows
from rounds import Contender, calling

import p3dof
from p3dof.closed_form.compiled import MachineKernels
from p3dof.closed_form.compiled.kernels import NUMPY, levels
from p3dof.machine.parameters import Parameters
from p3dof.methods.registry import Method

BEST = levels()[-1]
COMPILED = levels()[1:]
IN_CACHE, STREAMED, ONE, MORE, CURVE = (
    "in the cache",
    "of a million",
    "one sample",
    "beside the forces",
    "by batch size",
)
"""Groups of contenders."""

FORCES = "inverse_dynamics"
BESIDE = {
    FORCES: "forces",
    "inverse_dynamics_loaded": "forces under a wrench",
    "inverse_dynamics_derivatives": "forces and their derivatives",
    "forward_dynamics": "forward dynamics",
    "inverse_dynamics_with_friction": "forces with friction",
    "forward_dynamics_with_friction": "forward dynamics with friction",
    "inverse_dynamics_derivatives_with_friction": "forces with friction and their derivatives",
    "mass_matrix": "mass matrix",
    "coriolis_matrix": "Coriolis matrix",
    "gravity_forces": "gravity forces",
    "forward_kinematics": "forward kinematics",
    "kinematics": "sliders and Jacobian",
}
SIDE_BY_SIDE = f"columns, {BEST}, threads side by side: {{}}"
SHARED, TURNS = 4096, 500
VIRTUAL_POWER = "virtual power, NumPy"
RUN, FUNCTION, FACADE = (
    "from Python: bound buffers, bare call()",
    "from Python: Function(numbers)",
    "from Python: robot.forces, compiled",
)


def robot_on(parameters: Parameters, threads: int, level: str = BEST) -> p3dof.Manipulator:
    """Return a manipulator whose kernels run on so many threads."""
    robot = p3dof.load(parameters)
    robot.kernels = MachineKernels(parameters, level, threads)
    return robot


def all_threads() -> int:
    """Return on how many threads kernels run by default."""
    return MachineKernels(p3dof.PAPER).threads


def kernel_call(kernels: MachineKernels, name: str, count: int) -> Callable[[], object]:
    """Return a function that runs a kernel on one thread, on columns that it is bound to."""
    inputs, outputs = kernel_columns(kernels, name, count)
    used, constants = kernels.prepared(name)
    if kernels.level == NUMPY:
        return lambda: kernels.run(name, inputs, outputs)
    from p3dof._native import _compiled

    return _compiled.Call(used.name, kernels.level, constants, inputs, outputs)


def shared_call(parameters: Parameters, name: str, count: int, threads: int) -> Callable[[], object]:
    """Return a function that runs a kernel at the best level on several threads."""
    kernels = MachineKernels(parameters, BEST, threads)
    inputs, outputs = kernel_columns(kernels, name, count)
    return lambda: kernels.run(name, inputs, outputs)


def side_by_side(parameters: Parameters, threads: int) -> Callable[[], object]:
    """Return a function that runs the kernel `TURNS` times on each thread, in a cache of its own."""
    pool = ThreadPoolExecutor(threads)
    calls = [kernel_call(MachineKernels(parameters, BEST, 1), FORCES, SHARED) for _ in range(threads)]

    def turns(call: Callable[[], object]) -> None:
        for _ in range(TURNS):
            call()

    return lambda: list(pool.map(turns, calls))


def facade_call(robot: p3dof.Manipulator, count: int, method: Method = "compiled") -> Callable[[], object]:
    """Return a function that asks a manipulator for the forces of many samples (count, 3)."""
    return lambda: robot.forces(*rows(count), method=method)


def in_cache() -> Iterator[Contender]:
    """Inverse dynamics of a batch that stays in the cache."""
    for machine, parameters in MACHINES.items():
        for level in levels():
            run = kernel_call(MachineKernels(parameters, level, 1), FORCES, CACHED)
            yield calling(IN_CACHE, f"columns, {level}", machine, run, CACHED)
        for threads in {1, all_threads()}:
            run = side_by_side(parameters, threads)
            name = SIDE_BY_SIDE.format(threads)
            yield calling(IN_CACHE, name, machine, run, SHARED * TURNS * threads, threads)
        run = facade_call(robot_on(parameters, 1), CACHED)
        yield calling(IN_CACHE, f"robot.forces, (N, 3), {BEST}", machine, run, CACHED)
        run = facade_call(robot_on(parameters, 1), CACHED, "virtual-power")
        yield calling(IN_CACHE, VIRTUAL_POWER, machine, run, CACHED)


def streamed() -> Iterator[Contender]:
    """Inverse dynamics of a million samples, which come from memory and go there."""
    threads = all_threads()
    for machine, parameters in MACHINES.items():
        for level in levels():
            run = kernel_call(MachineKernels(parameters, level, 1), FORCES, MILLION)
            yield calling(STREAMED, f"columns, {level}", machine, run, MILLION)
        run = facade_call(robot_on(parameters, 1), MILLION)
        yield calling(STREAMED, f"robot.forces, (N, 3), {BEST}", machine, run, MILLION)
        if threads > 1:
            run = shared_call(parameters, FORCES, MILLION, threads)
            name = f"columns, {BEST}, {threads} threads"
            yield calling(STREAMED, name, machine, run, MILLION, threads)
            run = facade_call(robot_on(parameters, threads), MILLION)
            name = f"robot.forces, (N, 3), {BEST}, {threads} threads"
            yield calling(STREAMED, name, machine, run, MILLION, threads)
        run = facade_call(robot_on(parameters, 1), MILLION // 10, "virtual-power")
        yield calling(STREAMED, f"{VIRTUAL_POWER}, of 100,000", machine, run, MILLION // 10)


def beside() -> Iterator[Contender]:
    """All kernels at the best level, in the cache."""
    for machine, parameters in MACHINES.items():
        kernels = MachineKernels(parameters, BEST, 1)
        for name, text in BESIDE.items():
            yield calling(MORE, text, machine, kernel_call(kernels, name, CACHED), CACHED)


def one_sample() -> Iterator[Contender]:
    """Single samples from Python."""
    pose, velocity, acceleration = (array[0] for array in rows(CACHED))
    for machine, parameters in MACHINES.items():
        kernels = MachineKernels(parameters, BEST, 1)
        bound = kernels.bind_inverse_dynamics()
        bound.state[:] = pose, velocity, acceleration
        yield calling(ONE, RUN, machine, bound.call)
        yield calling(ONE, "from Python: bound buffers, protected run()", machine, bound.run)
        yield calling(ONE, "from Python: bound buffers, new state", machine, _with(bound, bound.state.copy()))
        numbers = [*pose.tolist(), *velocity.tolist(), *acceleration.tolist()]
        names = {f"x{i}": value for i, value in enumerate(numbers)} | {"f": kernels.function(FORCES)}
        timer = Timer(f"f({', '.join(name for name in names if name != 'f')})", globals=names)
        yield Contender(ONE, FUNCTION, machine, timer.timeit)
        robot = robot_on(parameters, 1)
        for name, method in (
            (FACADE, "compiled"),
            ("from Python: robot.forces, virtual power", "virtual-power"),
        ):
            yield calling(ONE, name, machine, _forces(robot, method, (pose, velocity, acceleration)))


def _with(bound: Callable[[np.ndarray], object], state: np.ndarray) -> Callable[[], object]:
    return lambda: bound(state)


def _forces(robot: p3dof.Manipulator, method: Method, state: tuple[np.ndarray, ...]) -> Callable[[], object]:
    return lambda: robot.forces(*state, method=method)


def curve(sizes: list[int], slow: int) -> Iterator[Contender]:
    """Batches of all sizes on the paper's machine; ways above 50 ns a sample only up to `slow` samples."""
    parameters, machine, threads = p3dof.PAPER, "symmetric", all_threads()
    for count in sizes:
        for level in COMPILED:
            run = kernel_call(MachineKernels(parameters, level, 1), FORCES, count)
            yield calling(CURVE, f"columns, {level} @ {count}", machine, run, count)
        if threads > 1:
            run = shared_call(parameters, FORCES, count, threads)
            name = f"columns, {BEST}, {threads} threads @ {count}"
            yield calling(CURVE, name, machine, run, count, threads)
        run = facade_call(robot_on(parameters, 1), count)
        yield calling(CURVE, f"robot.forces, (N, 3), {BEST} @ {count}", machine, run, count)
        if count <= slow:
            run = kernel_call(MachineKernels(parameters, NUMPY, 1), FORCES, count)
            yield calling(CURVE, f"reduced form, NumPy @ {count}", machine, run, count)
            run = facade_call(robot_on(parameters, 1), count, "virtual-power")
            yield calling(CURVE, f"{VIRTUAL_POWER} @ {count}", machine, run, count)


def check() -> None:
    """Raise unless all ways give the same forces."""
    for parameters in MACHINES.values():
        states = rows(CACHED)
        expected = p3dof.load(parameters).forces(*states, method="virtual-power")
        for level in levels():
            found = robot_on(parameters, 1, level).forces(*states, method="compiled")
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    columns.cache_clear()
