"""`MachineKernels`: the kernels of one machine, at one level of the processor, on one or several threads."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.algebra import BLOCK, components
from p3dof._base.checks import FloatArray, as_floats, shown
from p3dof._base.errors import LOG, InputError
from p3dof._base.threads import OneThread, in_threads, shares, slices, thread_count
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof._base.tracing import Number, Symbol, Tape, derivatives, straight_line
from p3dof._base.tracing.printing import function_of, or_nan
from p3dof._native.sources import fingerprint, is_cut_off
from p3dof.closed_form.compiled.evidence import NAMES as OF_EVIDENCE
from p3dof.closed_form.compiled.evidence import evidence_kernel, numbers_of
from p3dof.closed_form.compiled.formulas import NAMES, WITH_FRICTION, Kernel, is_symmetric, kernel
from p3dof.closed_form.compiled.reduced import Model, assembled, model_of, shape, solve_transposed
from p3dof.closed_form.compiled.reduced.dynamics import friction_numbers
from p3dof.closed_form.kinematics import forward_kinematics
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.closed_form.paper.friction import generalized_losses, losses_of
from p3dof.machine.parameters import Geometry, Parameters

NUMPY = "numpy"  # the level without the extension: blocks of arrays

SampleFunction: TypeAlias = Callable[..., FloatArray | None]
"""A kernel on rows of numbers of one sample; see `MachineKernels.sample`."""

SHARE = 32_768  # samples that are worth a thread of their own


def levels() -> tuple[str, ...]:
    """Return what the kernels can run on here, the slowest first.

    ``"numpy"``, and where the extension was built ``"baseline"`` and what the processor has of ``"avx2"`` and
    ``"avx512"``.
    """
    compiled = _extension()
    return (NUMPY,) if compiled is None else (NUMPY, *compiled.levels)


def in_words() -> str:
    """Return what new kernels run on in this process, and why if that is not the extension.

    Such as ``"avx512, 2 threads"``, or ``"numpy: P3DOF_LEVEL asks for it"``.
    """
    level, threads = _level(None), thread_count(None)
    if level != NUMPY:
        return f"{level}, {threads} thread{'s' if threads > 1 else ''}"
    if _extension() is not None:
        return f"{NUMPY}: P3DOF_LEVEL asks for it"
    if find_spec("p3dof._native._compiled") is None:
        return f"{NUMPY}: {_unbuilt()}"
    return f"{NUMPY}: the extension {_OLD if _is_old() else 'does not load, install it again'}"


class MachineKernels:
    """The compiled formulas of one machine; any number of threads may use them at once.

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
        if not isinstance(parameters, Parameters):
            raise InputError(f"parameters: expected Parameters, got {type(parameters).__name__}")
        self.parameters = parameters
        self.level = _level(level)
        self.threads = thread_count(threads)
        self.model = model_of(parameters)
        self.symmetric = is_symmetric(self.model)
        self.has_friction = bool(parameters.friction)
        self._prepared: dict[str, tuple[Kernel, FloatArray]] = {}
        self._functions: dict[str, Callable[..., tuple[float, ...]]] = {}

    def __repr__(self) -> str:
        return f"MachineKernels(level={self.level!r}, threads={self.threads})"

    def __reduce__(self) -> tuple[type[MachineKernels], tuple[Parameters, str, int]]:
        return MachineKernels, (self.parameters, self.level, self.threads)

    def prepared(self, name: str) -> tuple[Kernel, FloatArray]:
        """Return the kernel that serves this machine, and its constants (C,).

        Parameters
        ----------
        name : str
            One of `p3dof.closed_form.compiled.formulas.NAMES`, or of `evidence.NAMES`.

        Raises
        ------
        InputError
            If there is no such kernel.
        """
        if name not in self._prepared:
            if name in OF_EVIDENCE:
                found = evidence_kernel(name)
                self._prepared[name] = found, found.of_numbers(numbers_of(self.parameters))
                return self._prepared[name]
            if name not in NAMES:
                known = ", ".join((*NAMES, *OF_EVIDENCE))
                raise InputError(f"kernel: expected one of {known}, got {shown(name)}")
            found = kernel(name, self.symmetric)
            friction = friction_numbers(self.parameters.friction) if name in WITH_FRICTION else ()
            self._prepared[name] = found, found.of(self.model, friction)
        return self._prepared[name]

    def run(self, name: str, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray | None]) -> bool:
        """Compute the outputs of many samples; whether every sample's margin is positive.

        Parameters
        ----------
        name : str
            The kernel.
        inputs : sequence of ndarray, shape (N,)
            One column an input of the kernel, with any strides.
        outputs : sequence of ndarray, shape (N,)
            Where to write; the last one, the margin, may be None.
        """
        used, constants = self.prepared(name)
        compiled = _extension()
        if self.level == NUMPY or compiled is None:
            return on_arrays(used, constants, inputs, outputs)
        call = compiled.Call(used.name, self.level, constants, inputs, outputs)
        parts = shares(len(inputs[0]), self.threads, SHARE)
        return bool(call()) if len(parts) == 1 else all(in_threads(lambda part: bool(call(*part)), parts))

    def function(self, name: str) -> Callable[..., tuple[float, ...]]:
        """Return a kernel as a function of one sample: numbers in, numbers out, the margin last.

        Parameters
        ----------
        name : str
            The kernel.
        """
        if name not in self._functions:
            used, constants = self.prepared(name)
            compiled = _extension()
            if self.level == NUMPY or compiled is None:
                plain = function_of(used.tape, (*used.constants, *used.symbols), used.results)
                self._functions[name] = or_nan(partial(plain, *constants.tolist()), len(used.results))
            else:
                self._functions[name] = compiled.Function(used.name, self.level, constants)
        return self._functions[name]

    def sample(
        self,
        name: str,
        rows: tuple[tuple[int, tuple[int, ...]], ...],
        entries: tuple[int | float, ...],
        shape: tuple[int, ...],
    ) -> SampleFunction:
        """Return a kernel as a function of rows of numbers: arrays in, an array out.

        Parameters
        ----------
        name : str
            The kernel.
        rows : tuple of (int, tuple of int)
            Of each row: how many numbers it has, and which of them the kernel reads, in order.
        entries : tuple of int or float
            Of each number of the result: which output it is, or, as a float, what it always is.
        shape : tuple of int
            Of the result.

        Returns
        -------
        callable
            ``(out, *rows)`` to `out`, or a new array where that is None; or None, for what is no plain row of
            doubles or not clearly good. Always None on NumPy.
        """
        used, constants = self.prepared(name)
        compiled = _extension()
        if self.level == NUMPY or compiled is None:
            return _no_sample
        found: SampleFunction = compiled.Sample(
            used.name, self.level, constants, rows, entries, shape, np.empty
        )
        return found

    def bind_inverse_dynamics(self) -> BoundInverseDynamics:
        """Return the inverse dynamics bound to buffers, for a control loop."""
        return BoundInverseDynamics(self)


class BoundInverseDynamics:
    """Inverse dynamics of one sample in buffers of its own: write the state, run, read the forces.

    The buffers stay the same arrays for good; write into them with ``loop.state[:] = ...``. It belongs to the
    thread that runs it first.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.

    Attributes
    ----------
    call : callable
        What `run` calls: without its protection, also against other threads, and half as long. It returns
        False for a bad state and leaves whatever came out in `forces`.
    """

    def __init__(self, kernels: MachineKernels) -> None:
        self._state, self._wrench, self._forces = np.zeros((3, 3)), np.zeros(6), np.zeros(3)
        self._mine = OneThread("the buffers of this inverse dynamics, bind one in each thread")
        columns = [*self._state.reshape(9, 1), *(self._wrench[row : row + 1] for row in WRENCH_ROWS)]
        results = [*self._forces.reshape(3, 1), None]
        kind = "with_friction" if kernels.parameters.friction else "loaded"
        used, constants = kernels.prepared(f"inverse_dynamics_{kind}")
        compiled = _extension()
        self.call: Callable[[], bool]
        if kernels.level == NUMPY or compiled is None:
            self.call = partial(on_arrays, used, constants, columns, results)
        else:
            self.call = compiled.Call(used.name, kernels.level, constants, columns, results)

    @property
    def state(self) -> FloatArray:
        """Pose, velocity and acceleration of (y, z, θ), row by row, (3, 3)."""
        return self._state

    @property
    def wrench(self) -> FloatArray:
        """External force and moment on the platform at P, in the fixed frame, (6,) [N, N m]; first zero."""
        return self._wrench

    @property
    def forces(self) -> FloatArray:
        """Forces of the actuators A, B, C, (3,) [N]; NaN after a bad state."""
        return self._forces

    def run(self) -> bool:
        """Compute the forces, friction included.

        Returns
        -------
        bool
            Whether the state is finite, reachable and not singular, with a margin: in the last 1e-12 of the
            reach, within 2e-6 rad of det J = 0 or beyond 1e5 rad, `Manipulator.forces` may still have an
            answer.

        Raises
        ------
        InputError
            If another thread uses it.
        """
        self._mine.check()
        if self.call():
            return True
        self._forces.fill(np.nan)
        return False

    def __call__(self, state: ArrayLike) -> FloatArray:
        """Return the forces of a state, (3,): a view that the next call overwrites; NaN if it is not good."""
        self._mine.check()
        given = as_floats("state", state)
        if given.shape != (3, 3):
            raise InputError(f"state: expected shape (3, 3), got {given.shape}")
        self._state[:] = given
        self.run()
        return self._forces


def _no_sample(out: Any, *rows: Any) -> None:  # noqa: ARG001 - as `SampleFunction`
    return None


def on_arrays(
    used: Kernel, constants: FloatArray, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray | None]
) -> bool:
    """Run a kernel on NumPy, block by block; arguments and result as of `MachineKernels.run`."""
    numbers, good = constants.tolist(), True
    with np.errstate(all="ignore"):  # what is out of reach is told by the margin
        for block in slices(len(inputs[0]), BLOCK):
            found = used.on_arrays(*numbers, *(column[block] for column in inputs))
            for output, values in zip(outputs, found, strict=True):
                if output is not None:
                    output[block] = values
            good = good and bool(np.all(found[-1] > 0))
    return good


_CUT = "is cut off: install the package again"
_OLD = "was compiled from other sources than are here: install the package again"


@cache
def _extension() -> Any:
    found = _loaded()
    if found is not None and not _is_old():
        return found
    if found is not None or _is_cut_off():
        reason = _CUT if found is None else _OLD
        warnings.warn(f"the compiled extension {reason}; until then NumPy does its work", stacklevel=2)
    else:
        LOG.info("kernels run in NumPy: %s", _unbuilt())
    return None


def _unbuilt() -> str:
    """Return why there is no extension, as far as it can be known: a wheel without it does not say why."""
    name = "P3DOF_NO_EXTENSION"
    if os.environ.get(name, "") not in {"", "0"}:
        return f"no extension, {name} switches it off"
    return f"no extension was built at installation (no compiler, or {name})"


def _loaded() -> Any:
    """Return the extension; None if there is none, or to load it would end the process."""
    if _is_cut_off():
        return None
    try:
        from p3dof._native import _compiled
    except ImportError:
        return None
    return _compiled


def _is_cut_off() -> bool:
    spec = find_spec("p3dof._native._compiled")
    return spec is not None and spec.origin is not None and is_cut_off(Path(spec.origin))


def _is_old() -> bool:
    """Whether the extension loads, but is not of the sources beside it."""
    found = _loaded()
    return found is not None and found.sources not in (0, fingerprint() or found.sources)


def _level(level: str | None) -> str:
    asked = os.environ.get("P3DOF_LEVEL")
    name, wanted = ("level", level) if level is not None else ("P3DOF_LEVEL", asked or levels()[-1])
    if wanted not in levels():
        raise InputError(f"{name}: expected one of {', '.join(levels())}, got {shown(wanted)}")
    return str(wanted)


_Function = Callable[..., tuple[Any, ...]]


def loss_by_lengths(
    parameters: Parameters, pose: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the actuator forces against friction, J⁻ᵀ d, and how they change with r, R and L."""
    found = _on_blocks(_loss_by_lengths(parameters), pose, velocity, 12)
    rows = found.reshape(3, 4, -1).transpose(2, 0, 1)
    return np.ascontiguousarray(rows[..., 0]), np.ascontiguousarray(rows[..., 1:])


def losses_of_state(parameters: Parameters) -> Callable[..., tuple[float, ...]]:
    """Return friction of a state (pose 3, velocity 3) as forces of y, z, θ [N, N, N m]; NaN out of reach."""
    return or_nan(straight_line(_formula(parameters), 6), 3)


def _formula(parameters: Parameters) -> Callable[..., Sequence[Number]]:
    lengths, friction = Lengths.of(parameters.geometry), losses_of(parameters.friction)

    def formula(tape: Tape, *x: Symbol) -> Sequence[Number]:
        return generalized_losses(lengths, components(x[:3]), components(x[3:]), friction, tape)

    return formula


@lru_cache(maxsize=64)
def _loss_by_lengths(parameters: Parameters) -> _Function:
    g, friction = parameters.geometry, losses_of(parameters.friction)
    own = model_of(parameters).numbers

    def formula(tape: Tape, *symbols: Symbol) -> Sequence[Number]:
        r, R, L, *x = symbols
        lengths = Lengths(r, R, L, g.b, tape.sqrt((L - (R - r)) * (L + (R - r))))
        lost = generalized_losses(lengths, components(x[:3]), components(x[3:]), friction, tape)
        where = shape(Model.of_numbers((r, R, L, *own[3:])), x[0], x[2], tape)
        forces = solve_transposed(where, lost)
        rows = zip(forces, derivatives(forces, (r, R, L)), strict=True)
        return [entry for force, row in rows for entry in (force, *row)]

    function = straight_line(formula, 9, np)
    return lambda *x: function(g.r, g.R, g.L, *x)


def _on_blocks(function: _Function, pose: FloatArray, velocity: FloatArray, width: int) -> FloatArray:
    found = np.empty((width, len(pose)))
    with np.errstate(all="ignore"):  # out of reach is told elsewhere
        for start in range(0, len(pose), BLOCK):
            block = slice(start, start + BLOCK)
            for row, values in zip(found, function(*pose[block].T, *velocity[block].T), strict=True):
                row[block] = values
    return found


def pose_at(geometry: Geometry, sliders: FloatArray) -> FloatArray:
    """Return the pose in the working mode at slider positions; ndarray, shape (3,): y [m], z [m], θ [rad]."""
    *pose, margin = _assembly(geometry)(*sliders.tolist())
    return np.array(pose) if margin > 0 else forward_kinematics(geometry, sliders)


@lru_cache(maxsize=64)
def _assembly(geometry: Geometry) -> Callable[..., tuple[float, ...]]:
    model = Model.of_numbers((geometry.r, geometry.R, geometry.L, *33 * (0,)))

    def formula(tape: Tape, *sliders: Symbol) -> Sequence[Number]:
        pose, margin = assembled(model, (sliders[0], sliders[1], sliders[2]), tape)
        return [*pose, margin]

    return or_nan(straight_line(formula, 3), 4)
