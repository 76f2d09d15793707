"""`Sweep`: the motion of the whole tree along a motion of the independent joints, compiled."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.threads import in_threads, shares
from p3dof.loops.compiled.function import Function
from p3dof.loops.compiled.kernels import SHARE, pointers, sizes


class _Way(ctypes.Structure):
    _fields_ = (
        ("count", ctypes.c_ssize_t),
        ("part", ctypes.c_ssize_t),
        ("steps", ctypes.c_int),
        ("time", ctypes.c_void_p),
        ("start", ctypes.c_void_p),
        ("target", ctypes.c_void_p),
        ("velocity", ctypes.c_void_p),
        ("acceleration", ctypes.c_void_p),
        ("load", ctypes.c_void_p),
        ("strides", ctypes.c_void_p),
        ("q", ctypes.c_void_p),
        ("v", ctypes.c_void_p),
        ("a", ctypes.c_void_p),
        ("out", ctypes.c_void_p),
    )


class Sweep:
    """What follows a motion: every lane a part of it.

    Parameters
    ----------
    motion : Function
        The function ``motion``.
    library : ctypes.CDLL
        Where it is compiled with its sweep.
    """

    def __init__(self, motion: Function, library: ctypes.CDLL) -> None:
        self._motion, self._sweep = motion, library.sweep
        self._sweep.argtypes, self._sweep.restype = [ctypes.c_void_p], None
        library.width.restype = ctypes.c_int
        self.width: int = library.width()
        """Lanes."""

    def parts(self, count: int, threads: int) -> list[tuple[int, int, list[int]]]:
        """Return how samples are shared: first, behind the last, and where lanes start, for every thread."""
        found = []
        for start, stop in shares(count, threads, SHARE):
            part = -(-(stop - start) // self.width)
            found.append((start, stop, [min(start + k * part, stop - 1) for k in range(self.width)]))
        return found

    def __call__(
        self,
        time: FloatArray,
        motion: Sequence[FloatArray],
        load: Mapping[str, FloatArray],
        starts: Mapping[int, FloatArray],
        steps: int,
        threads: int,
    ) -> dict[str, FloatArray]:
        """Return the motion of the tree, and what belongs to it.

        Parameters
        ----------
        time : (N,) array
            Times of the samples [s].
        motion : sequence of three (N, n) arrays
            Values, velocities and accelerations of the independent joints.
        load : mapping of str to (N, size) or (size,) array
            External wrenches and forces in joints.
        starts : mapping of int to (nq,) array
            Configurations of the samples where lanes start, see `parts`.
        steps : int
            Of Newton's method, each sample.
        threads : int
            How many at most.

        Returns
        -------
        dict of str to (N, size) array
        """
        count, outputs = len(time), dict(self._motion.outputs)
        nq = len(next(iter(starts.values())))
        found: dict[str, FloatArray] = {}
        for name, size in {"q": nq, **outputs}.items():
            found[name] = np.empty((count, size))
        groups = [np.ascontiguousarray(array) for array in load.values()]
        strides = [array.shape[1] if array.ndim == 2 else 0 for array in groups]
        arrays = [np.ascontiguousarray(array) for array in (time, *motion)]

        def run(part: tuple[int, int, list[int]]) -> None:
            first, stop, lanes = part
            start = np.ascontiguousarray([starts[i] for i in lanes])
            at = [array.ctypes.data + array.strides[0] * first for array in arrays]
            loads = pointers([g.ctypes.data + 8 * s * first for g, s in zip(groups, strides, strict=True)])
            steps_of = sizes(strides)
            places = {name: array.ctypes.data + array.strides[0] * first for name, array in found.items()}
            rest = pointers([places[name] for name in outputs if name not in ("v", "a")])
            way = _Way(
                stop - first,
                -(-(stop - first) // self.width),
                steps,
                at[0],
                start.ctypes.data,
                *at[1:],
                ctypes.addressof(loads),
                ctypes.addressof(steps_of),
                *(places[name] for name in ("q", "v", "a")),
                ctypes.addressof(rest),
            )
            self._sweep(ctypes.addressof(way))

        in_threads(run, self.parts(count, threads))
        return found
