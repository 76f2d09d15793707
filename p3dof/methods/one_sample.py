"""One plain sample, or some rows of them, at once: what a control loop asks for a thousand times a second."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from p3dof._base.checks import FloatArray
from p3dof._base.samples import POLICIES
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.closed_form.compiled.formulas import ACCELERATION, DERIVATIVES, POSE, VELOCITY
from p3dof.closed_form.compiled.kernels import MachineKernels, SampleFunction

_ROW = (3, (0, 1, 2))
_WRENCH = (6, WRENCH_ROWS)
_NO_WRENCH = (0.0,) * 6
_SLOPE_A, _SLOPE_B, _SLOPE_C, _ARM = 3, 4, 5, 6
_JACOBIAN = (_SLOPE_A, 1.0, 0.0, _SLOPE_B, 1.0, 0.0, _SLOPE_C, 1.0, _ARM)
_YY, _YZ, _YT, _ZT, _TT, _ZZ = range(6)
_MASSES = (_YY, _YZ, _YT, _YZ, _ZZ, _ZT, _YT, _ZT, _TT)
"""Which output of a kernel each entry of the matrix is, or what it always is."""
_BY_Z = 2
"""Where the derivative by z is beside a force."""


def _derivatives(moving: tuple[str, ...], stiffness: FloatArray) -> tuple[int | float, ...]:
    """Return, of each force, itself and its derivatives by the motion; z moves springs only."""
    entries: list[int | float] = []
    places = [moving.index(x) if x in moving else None for x in (*POSE, *VELOCITY, *ACCELERATION)]
    for leg, spring in enumerate(stiffness.tolist()):
        row = [leg, *(0.0 if place is None else 3 + len(moving) * leg + place for place in places)]
        row[_BY_Z] = spring
        entries += row
    return tuple(entries)


class OneSample:
    """Results of the kernels for one plain sample, or up to 2000 rows, without what batches take.

    Every door takes what the user gave, `out` first, and returns the result; or None where somebody must look
    closer: a large batch, what is masked or no array of doubles (of one sample: list or tuple), a number that
    is not finite, a state that is not clearly good, and an `out` that does not fit.
    """

    def __init__(self, kernels: MachineKernels) -> None:
        self._kernels, self._friction = kernels, kernels.has_friction

    def forces(self, out: Any, q: Any, v: Any, a: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the actuator forces (3,) [N] at a pose, velocity and acceleration."""
        if on_invalid not in POLICIES:
            return None
        return self._forces(out, q, v, a) if wrench is None else self._loaded_forces(out, q, v, a, wrench)

    def accelerate(self, out: Any, q: Any, v: Any, f: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the acceleration (3,) of the platform at a pose and velocity, under forces."""
        if on_invalid not in POLICIES:
            return None
        if wrench is None:
            return self._acceleration(out, q, v, f)
        return self._loaded_acceleration(out, q, v, f, wrench)

    def jacobian(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (3, 3)."""
        return self._jacobian(out, pose) if on_invalid in POLICIES else None

    def mass_matrix(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return the mass matrix in y, z, θ, (3, 3)."""
        return self._mass_matrix(out, pose) if on_invalid in POLICIES else None

    def derivatives(self, q: Any, v: Any, a: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the actuator forces and their derivatives by pose, velocity and acceleration, (3, 10)."""
        if on_invalid not in POLICIES:
            return None
        return self._derivatives(None, q, v, a, _NO_WRENCH if wrench is None else wrench)

    def sliders(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return the slider positions (3,) [m]."""
        return self._sliders(out, pose) if on_invalid in POLICIES else None

    def poses(self, out: Any, sliders: Any, on_invalid: str) -> FloatArray | None:
        """Return the pose (3,) in the working mode at slider positions."""
        return self._poses(out, sliders) if on_invalid in POLICIES else None

    @cached_property
    def _forces(self) -> SampleFunction:
        return self._driven("inverse_dynamics")

    @cached_property
    def _loaded_forces(self) -> SampleFunction:
        return self._loaded("inverse_dynamics")

    @cached_property
    def _acceleration(self) -> SampleFunction:
        return self._driven("forward_dynamics")

    @cached_property
    def _loaded_acceleration(self) -> SampleFunction:
        return self._loaded("forward_dynamics")

    @cached_property
    def _jacobian(self) -> SampleFunction:
        return self._kernels.sample("kinematics", (_ROW,), _JACOBIAN, (3, 3))

    @cached_property
    def _mass_matrix(self) -> SampleFunction:
        return self._kernels.sample("mass_matrix", (_ROW,), _MASSES, (3, 3))

    @cached_property
    def _derivatives(self) -> SampleFunction:
        name, moving = DERIVATIVES[self._friction]
        entries = _derivatives(moving, self._kernels.parameters.actuators.stiffness)
        return self._kernels.sample(name, (_ROW, _ROW, _ROW, _WRENCH), entries, (3, 10))

    @cached_property
    def _sliders(self) -> SampleFunction:
        return self._kernels.sample("kinematics", (_ROW,), (0, 1, 2), (3,))

    @cached_property
    def _poses(self) -> SampleFunction:
        return self._kernels.sample("forward_kinematics", (_ROW,), (0, 1, 2), (3,))

    def _driven(self, kind: str) -> SampleFunction:
        if self._friction:
            loaded = self._loaded(kind)
            return lambda out, q, v, a: loaded(out, q, v, a, _NO_WRENCH)
        return self._kernels.sample(kind, (_ROW, _ROW, _ROW), (0, 1, 2), (3,))

    def _loaded(self, kind: str) -> SampleFunction:
        name = f"{kind}_{'with_friction' if self._friction else 'loaded'}"
        return self._kernels.sample(name, (_ROW, _ROW, _ROW, _WRENCH), (0, 1, 2), (3,))
