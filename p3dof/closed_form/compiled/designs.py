"""The compiled loop over designs: constants by columns in, a row of figures a design out."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.closed_form.compiled.design_kernels import design_kernel, smaller_form
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.kernels import NUMPY, MachineKernels, _extension
from p3dof.closed_form.compiled.reduced import SMALLER_ZEROS
from p3dof.closed_form.compiled.tangents import forces_tangent, sliders_tangent

_ZEROS = tuple(MODEL.index(name) for name in SMALLER_ZEROS)
_LENGTHS = 3
"""r, R, L; as many numbers as a pose has."""
_SLIDERS, _POWER = 2 | 4, 4


def width_of(asked: int) -> int:
    """Return how many numbers a row of results has; `DesignLoop` tells which.

    Parameters
    ----------
    asked : int
        Which figures.

    Returns
    -------
    int
    """
    return 34 if asked & _POWER else 22 if asked & _SLIDERS else 13


class DesignLoops:
    """Figures of many designs over one motion; any number of threads may ask at once.

    Which kernel computes a design does not depend on the designs beside it, so that its figures do not.

    Parameters
    ----------
    packed : ndarray
        The motion, as `DesignLoop` takes it.
    samples, points : int
        Of the motion, and of the polynomials that integrate powers.
    kind : {"", "loaded", "with_friction"}
        Whether there is an external wrench, and friction.
    asked : int
        Which figures.
    level : str
        Of the processor, as of `MachineKernels`; not ``"numpy"``.
    """

    def __init__(
        self, packed: FloatArray, samples: int, points: int, kind: str, asked: int, level: str
    ) -> None:
        moving = "with_friction" if kind == "with_friction" else "motion" if kind or asked & _SLIDERS else ""
        general = {"with_friction": "design_motion_with_friction", "motion": "design_motion"}
        name = general.get(moving, "design_forces")
        names = {True: smaller_form(name), False: name}
        self._kernels = {smaller: design_kernel(each) for smaller, each in names.items()}
        self._asked, self._friction = asked, kind == "with_friction"
        self._width = width_of(asked)
        self._memory = threading.local()
        self._loops = {
            smaller: _extension().DesignLoop(used.name, level, asked, samples, points, packed)
            for smaller, used in self._kernels.items()
        }

    def rows(self, model: Sequence[Any], offsets: FloatArray | None, count: int) -> FloatArray:
        """Return the figures of designs.

        Parameters
        ----------
        model : sequence of float or ndarray, shape (D,)
            The 36 numbers of the designs, then those of friction.
        offsets : ndarray, shape (D, 3), optional
            By how much the whole motion is moved.
        count : int
            D.

        Returns
        -------
        ndarray, shape (D, width_of(asked))
            As `DesignLoop` says; overwritten by the next call of the same thread.
        """
        smaller = _without_coulomb(model, count) if self._friction else _symmetric(model, count)
        found = self._table(count)
        for form in (True, False):
            members: Any = np.flatnonzero(smaller == form)
            if len(members) == count:
                self._run(form, model, offsets, found)
            elif len(members):
                part = np.empty((len(members), self._width))
                some = [number[members] if _is_column(number) else number for number in model]
                self._run(form, some, None if offsets is None else offsets[members], part)
                found[members] = part
        return found

    def rates(
        self,
        model: Sequence[Any],
        by_numbers: Sequence[Any],
        by_pose: Sequence[float],
        offsets: FloatArray | None,
        count: int,
    ) -> FloatArray:
        """Return how the figures of designs that can make the motion change along a direction.

        Parameters
        ----------
        model, offsets, count
            As of `rows`.
        by_numbers : sequence of float or ndarray, shape (D,)
            How the numbers change.
        by_pose : sequence of float
            How y, z and θ of all samples change.

        Returns
        -------
        ndarray, shape (D, width_of(asked))
            As of `rows`, without status and times.
        """
        symmetric = _symmetric(model, count) & _symmetric(by_numbers, count) & (not self._friction)
        found = np.empty((count, self._width))
        moved = (*model, *by_numbers, *by_pose)
        for form in (True, False):
            members: Any = np.flatnonzero(symmetric == form)
            if len(members) == count:
                self._run_rates(form, moved, offsets, found)
            elif len(members):
                part = np.empty((len(members), self._width))
                some = [number[members] if _is_column(number) else number for number in moved]
                self._run_rates(form, some, None if offsets is None else offsets[members], part)
                found[members] = part
        return found

    def _run_rates(
        self, form: bool, moved: Sequence[Any], offsets: FloatArray | None, found: FloatArray
    ) -> None:
        count, width = len(found), (len(moved) - _LENGTHS) // 2
        lengths = np.empty((count, 3 * _LENGTHS))
        given = (*moved[:_LENGTHS], *moved[width : width + _LENGTHS], *moved[-_LENGTHS:])
        for column, number in zip(lengths.T, given, strict=True):
            column[:] = number
        of_lengths = (*moved[: len(MODEL)], *moved[width : width + len(MODEL)], *moved[-_LENGTHS:])
        with np.errstate(all="ignore"):
            constants = forces_tangent(self._friction, form).of_columns(moved, count)
            sliding = self._asked & _SLIDERS
            turning = sliders_tangent().of_columns(of_lengths, count) if sliding else None
        place = None if offsets is None else np.ascontiguousarray(offsets)
        self._loops[form].tangent(form, constants, turning, lengths, place, found)

    def _table(self, count: int) -> FloatArray:
        """Return a table of this thread: new memory at each call would cost a tenth of the work."""
        known = getattr(self._memory, "table", None)
        if known is None or len(known) < count:
            known = self._memory.table = np.empty((count, self._width))
        table: FloatArray = known[:count]
        return table

    def _run(self, form: bool, numbers: Sequence[Any], offsets: FloatArray | None, found: FloatArray) -> None:
        count = len(found)
        lengths = np.empty((count, _LENGTHS))
        for column, number in zip(lengths.T, numbers[:_LENGTHS], strict=True):
            column[:] = number
        with np.errstate(all="ignore"):
            constants = self._kernels[form].of_columns(numbers, count)
        moved = None if offsets is None else np.ascontiguousarray(offsets)
        self._loops[form](constants, lengths, moved, found)


def compiled_level(level: str | None, threads: int | None) -> tuple[str | None, int]:
    """Return at which level loops over designs run here, None on NumPy, and on how many threads.

    Parameters
    ----------
    level, threads
        As of `MachineKernels`.

    Returns
    -------
    level : str or None
    threads : int

    Raises
    ------
    InputError
        As `MachineKernels`.
    """
    from p3dof.machine.parameters import PAPER

    kernels = MachineKernels(PAPER, level, threads)
    return None if kernels.level == NUMPY else kernels.level, kernels.threads


def _is_column(number: Any) -> bool:
    return isinstance(number, np.ndarray) and number.ndim > 0


def _symmetric(model: Sequence[Any], count: int) -> NDArray[np.bool_]:
    """Return which designs the smaller kernels serve (D,), as `is_symmetric`."""
    found = np.ones(count, dtype=bool)
    for place in _ZEROS:
        found &= np.equal(model[place], 0)
    return found


def _without_coulomb(model: Sequence[Any], count: int) -> NDArray[np.bool_]:
    """Return of which designs all friction is viscous (D,)."""
    coefficients = len(model) - len(MODEL) - 1
    found = np.ones(count, dtype=bool)
    for number in model[len(MODEL) + coefficients // 2 : -1]:
        found &= np.equal(number, 0)
    return found
