"""`MachineKernels`: the kernels of one machine, at one level of the processor, on one or several threads."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any

import numpy as np

from p3dof.checks import FloatArray, shown
from p3dof.errors import InputError
from p3dof.kernels.formulas import Kernel, is_symmetric, kernel
from p3dof.parameters import Parameters
from p3dof.reduced import model_of
from p3dof.tracing.python import function_of

NUMPY = "numpy"
"""The level without the extension: blocks of arrays."""

BLOCK = 4096
"""Samples that NumPy computes at once: their intermediate arrays stay in the processor's cache."""

SHARE = 32_768
"""Samples that are worth a thread of their own."""


def levels() -> tuple[str, ...]:
    """Return what the kernels can run on here, the slowest first.

    Returns
    -------
    tuple of str
        ``"numpy"``, and where the extension was built ``"baseline"`` and what the processor has of
        ``"avx2"`` and ``"avx512"``.
    """
    compiled = _extension()
    return (NUMPY,) if compiled is None else (NUMPY, *compiled.levels)


class MachineKernels:
    """The kernels of one machine; any number of threads may use it at once.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    level : str, optional
        One of `levels`; by default the environment's ``P3DOF_LEVEL``, else the fastest.
    threads : int, optional
        Most threads for a batch, each for at least 32768 samples; by default the environment's
        ``P3DOF_THREADS``, else all processors that the process may use.

    Raises
    ------
    InputError
        If the level does not exist here, or the number of threads is not positive.
    """

    def __init__(self, parameters: Parameters, level: str | None = None, threads: int | None = None) -> None:
        self.parameters = parameters
        self.level = _level(level)
        self.threads = _threads(threads)
        self.model = model_of(parameters)
        self.symmetric = is_symmetric(self.model)
        self._prepared: dict[str, tuple[Kernel, FloatArray]] = {}
        self._functions: dict[str, Callable[..., tuple[float, ...]]] = {}

    def __reduce__(self) -> tuple[type[MachineKernels], tuple[Parameters, str, int]]:
        return MachineKernels, (self.parameters, self.level, self.threads)

    def prepared(self, name: str) -> tuple[Kernel, FloatArray]:
        """Return the kernel that serves this machine, and its constants.

        Parameters
        ----------
        name : str
            One of `p3dof.kernels.formulas.NAMES`.

        Returns
        -------
        kernel : Kernel
        constants : ndarray, shape (C,)
        """
        if name not in self._prepared:
            found = kernel(name, self.symmetric)
            self._prepared[name] = found, found.of(self.model)
        return self._prepared[name]

    def run(self, name: str, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray | None]) -> bool:
        """Compute the outputs of many samples.

        Parameters
        ----------
        name : str
            The kernel.
        inputs : sequence of ndarray, shape (N,)
            One column an input of the kernel, with any strides.
        outputs : sequence of ndarray, shape (N,)
            Where to write; the last one, the margin, may be None.

        Returns
        -------
        bool
            Whether every sample's margin is positive.
        """
        used, constants = self.prepared(name)
        compiled = _extension()
        if self.level == NUMPY or compiled is None:
            return on_arrays(used, constants, inputs, outputs)
        call = compiled.Call(used.name, self.level, constants, inputs, outputs)
        count = len(inputs[0])
        parts = min(self.threads, count // SHARE)
        if parts < 2:
            return bool(call())
        ends = [count * part // parts for part in range(parts + 1)]
        others = [_pool(self.threads).submit(call, *ends[k : k + 2]) for k in range(1, parts)]
        good = call(0, ends[1])  # this thread works too: it need not wait for the others to wake up
        return all([good, *(other.result() for other in others)])

    def function(self, name: str) -> Callable[..., tuple[float, ...]]:
        """Return a kernel as a function of one sample: numbers in, numbers out, the margin last.

        Parameters
        ----------
        name : str
            The kernel.

        Returns
        -------
        callable
        """
        if name not in self._functions:
            used, constants = self.prepared(name)
            compiled = _extension()
            if self.level == NUMPY or compiled is None:
                plain = function_of(used.tape, (*used.constants, *used.symbols), used.results, _Plain)
                self._functions[name] = partial(plain, *constants.tolist())
            else:
                self._functions[name] = compiled.Function(used.name, self.level, constants)
        return self._functions[name]

    def bind_inverse_dynamics(self) -> BoundInverseDynamics:
        """Return the inverse dynamics bound to buffers, for a control loop.

        Returns
        -------
        BoundInverseDynamics
        """
        return BoundInverseDynamics(self)


class BoundInverseDynamics:
    """Inverse dynamics of one sample in buffers of its own: write the state, call, read the forces.

    Friction is not in it. Not for several threads at once.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.

    Attributes
    ----------
    state : ndarray, shape (3, 3)
        Pose, velocity and acceleration of (y, z, θ), row by row.
    wrench : ndarray, shape (3,)
        F_y, F_z, M_y of the external wrench on the platform at P [N, N, N m].
    forces : ndarray, shape (3,)
        Of the actuators A, B, C [N].
    run : callable
        Computes the forces; returns True if the state is reachable, not singular and finite.
    """

    def __init__(self, kernels: MachineKernels) -> None:
        self.state, self.wrench, self.forces = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
        name = "inverse_dynamics_loaded"
        used, constants = kernels.prepared(name)
        columns = [*self.state.reshape(9, 1), *self.wrench.reshape(3, 1)]
        results = [*self.forces.reshape(3, 1), None]
        compiled = _extension()
        self.run: Callable[[], bool]
        if kernels.level == NUMPY or compiled is None:
            self.run = lambda: on_arrays(used, constants, columns, results)
        else:
            self.run = compiled.Call(used.name, kernels.level, constants, columns, results)

    def __call__(self, state: FloatArray) -> FloatArray:
        """Return the forces of a state, (3,): a view that the next call overwrites; NaN if it is not good.

        Parameters
        ----------
        state : ndarray, shape (3, 3)
            Pose, velocity and acceleration.

        Returns
        -------
        ndarray, shape (3,)
        """
        self.state[:] = state
        if not self.run():
            self.forces[:] = np.nan
        return self.forces


class _Plain:
    """`math` with a minimum; NaN outside its domain, as the compiled kernels have it."""

    minimum = staticmethod(min)

    @staticmethod
    def sqrt(x: float) -> float:
        return math.sqrt(x) if x >= 0 else math.nan

    @staticmethod
    def sin(x: float) -> float:
        return math.sin(x) if math.isfinite(x) else math.nan

    @staticmethod
    def cos(x: float) -> float:
        return math.cos(x) if math.isfinite(x) else math.nan


def on_arrays(
    used: Kernel, constants: FloatArray, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray | None]
) -> bool:
    """Run a kernel on NumPy, block by block; arguments and result as of `MachineKernels.run`.

    Parameters
    ----------
    used : Kernel
        What to compute.
    constants : ndarray, shape (C,)
        Of the machine.
    inputs, outputs : sequence of ndarray, shape (N,)
        Columns.

    Returns
    -------
    bool
    """
    numbers, good = constants.tolist(), True
    with np.errstate(all="ignore"):  # what is out of reach is told by the margin
        for start in range(0, len(inputs[0]), BLOCK):
            block = slice(start, start + BLOCK)
            found = used.on_arrays(*numbers, *(column[block] for column in inputs))
            for output, values in zip(outputs, found, strict=True):
                if output is not None:
                    output[block] = values
            good = good and bool(np.all(found[-1] > 0))
    return good


@cache
def _extension() -> Any:
    try:
        from p3dof.kernels import _compiled
    except ImportError:
        return None
    return _compiled


def _forget_pools() -> None:
    _pool.cache_clear()  # their threads do not come along into a forked process


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "p3dof kernels")


def _level(level: str | None) -> str:
    wanted = level or os.environ.get("P3DOF_LEVEL") or levels()[-1]
    if wanted not in levels():
        raise InputError(f"level: expected one of {', '.join(levels())}, got {shown(wanted)}")
    return wanted


def _threads(threads: int | None) -> int:
    if threads is None:
        asked = os.environ.get("P3DOF_THREADS")
        if asked is None:
            return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        threads = int(asked) if asked.isdecimal() else 0
    if isinstance(threads, bool) or not isinstance(threads, int) or not 1 <= threads <= 1024:
        raise InputError(f"threads: expected a number from 1 to 1024, got {shown(threads)}")
    return threads


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pools)
