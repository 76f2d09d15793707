"""The unit of length in which a model is computed: that of the model itself.

All tolerances of this layer are lengths and angles, and the rows and columns of its matrices mix both, which
fits machines whose links are about as long as the unit of length. `Units` finds such a unit, a power of 64 m,
and `p3dof.loops.scaled_model` computes a model in it. Powers of two scale exactly: tolerances change,
and no rounding. The metre is the unit of all models of .125 to 8 m; nothing is scaled there.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import LARGEST, FloatArray
from p3dof._base.errors import ModelError
from p3dof.loops.closure_kinds import lengths_of
from p3dof.loops.coordinates import length_coordinates
from p3dof.loops.sidecar import Coupling, Sidecar

_STEP = 6
"""Units are powers of 2**6 m."""


class Units:
    """Factors between metres and a model's unit of length, for everything that this layer takes and returns.

    Parameters
    ----------
    model : pin.Model
        The tree.
    sidecar : Sidecar
        Its closures.
    """

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        self.q, self.v, known = length_coordinates(model)
        size = size_of(model, sidecar)
        if not size < LARGEST:  # also what is not a number
            raise ModelError(f"model: expected placements of less than {LARGEST:g} m, got {size:g} m")
        power = round(math.log2(size) / _STEP) if known and size > 0 else 0
        self.length = 2.0 ** (_STEP * power)
        """The unit of length [m]."""
        joints = [i for i in range(1, model.njoints) if model.nvs[i] == 1]
        self._slides = {str(model.names[i]): bool(self.v[model.idx_vs[i]]) for i in joints}
        rows = [is_length for closure in sidecar.closures for is_length in lengths_of(closure.kind)]
        rows += [self._slides[coupling.joint] for coupling in sidecar.couplings]
        self.rows = np.array(rows, dtype=bool)
        """Which rows of closures and couplings are lengths."""

    def motion(self, lengths: NDArray[np.bool_]) -> FloatArray:
        """Return the units [m, rad] of coordinates, some of which are lengths."""
        return np.where(lengths, self.length, 1.0)

    def force(self, lengths: NDArray[np.bool_]) -> FloatArray:
        """Return the units [N, N m] of the forces along such coordinates."""
        return np.where(lengths, self.length, self.length**2)

    def scaled(self, model: pin.Model) -> pin.Model:
        """Return a copy of the model in these units; masses and times stay."""
        copy = model.copy()
        for i in range(model.njoints):
            copy.jointPlacements[i] = self._placement(model.jointPlacements[i])
        for frame in copy.frames:
            frame.placement = self._placement(frame.placement)
        self.update(copy, model)
        return copy

    def update(self, copy: pin.Model, model: pin.Model) -> None:
        """Give a scaled copy the masses and the gravity that its model has now."""
        u = self.length
        for i in range(model.njoints):
            body = model.inertias[i]
            copy.inertias[i] = pin.Inertia(body.mass, body.lever / u, body.inertia / u**2)
        copy.gravity.linear = model.gravity.linear / u
        with np.errstate(over="ignore"):  # where there is no limit
            for name in ("lowerPositionLimit", "upperPositionLimit"):
                setattr(copy, name, np.asarray(getattr(model, name)) / self.motion(self.q))
        copy.armature = np.asarray(model.armature) / np.where(self.v, 1.0, u**2)

    def sidecar(self, model: pin.Model, sidecar: Sidecar) -> Sidecar:
        """Return the sidecar of the scaled copy of a model."""
        reference: dict[str, Any] = {}
        for name, value in (sidecar.reference or {}).items():
            i = model.getJointId(name)
            lengths = self.q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]]
            reference[name] = np.asarray(value) / (self.motion(lengths) if lengths.any() else 1.0)
        return replace(
            sidecar,
            closures=tuple(
                replace(closure, length=None if closure.length is None else closure.length / self.length)
                for closure in sidecar.closures
            ),
            couplings=tuple(self._coupling(coupling) for coupling in sidecar.couplings),
            reference=reference or None,
            joint_data=(),  # whoever hands a state in adds what acts in the joints
        )

    def _coupling(self, coupling: Coupling) -> Coupling:
        def unit(name: str | None) -> float:
            return self.length if name and self._slides[name] else 1.0

        powers = np.arange(len(coupling.coefficients))
        one = unit(coupling.joint)
        return replace(
            coupling,
            coefficients=tuple(np.array(coupling.coefficients) * unit(coupling.on) ** powers / one),
            others=tuple((name, factor * unit(name) / one) for name, factor in coupling.others),
        )

    def _placement(self, M: pin.SE3) -> pin.SE3:
        return pin.SE3(M.rotation, M.translation / self.length)


def size_of(model: pin.Model, sidecar: Sidecar) -> float:
    """Return the longest distance between a joint's origin and what the model fixes to it [m].

    Parameters
    ----------
    model : pin.Model
        The tree.
    sidecar : Sidecar
        Its closures: the frames and rods that count.
    """
    ends = {frame for closure in sidecar.closures for frame in (closure.frame1, closure.frame2)}
    placements = [*model.jointPlacements, *(frame.placement for frame in model.frames if frame.name in ends)]
    rods = [closure.length for closure in sidecar.closures if closure.length is not None]
    return max((*(float(np.linalg.norm(M.translation)) for M in placements), *rods), default=0.0)
