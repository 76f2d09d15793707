"""Momentum observer: external forces, from the motors' forces and the motion alone.

With the generalised momentum p = Nᵀ M v in independent coordinates, rotors and linkages included,

    dp/dt = ṗ(q, v) + Nᵀ B τ + f

where ṗ(q, v) = d(Nᵀ M N)/dt ẏ - h has weight, springs, damping and friction in h, and f is what else acts:
contact, an unknown payload, errors of the model. No acceleration enters. f is seen through a lag of first
order, by the implicit Euler method: stable at any period.

References
----------
A. De Luca, R. Mattone, Sensorless robot collision detection and hybrid force/motion control, IEEE
International Conference on Robotics and Automation 2005. S. Haddadin, A. De Luca, A. Albu-Schäffer, Robot
collisions: a survey on detection, isolation, and identification, IEEE Transactions on Robotics 33(6), 2017.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array, not_negative, positive, shown
from p3dof._base.errors import AssemblyError, InputError, ModelError, SingularityError
from p3dof.loops.closed_tree import External
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.following import CONVERGING, LARGEST_CORRECTION, Settler
from p3dof.loops.compiled.function import BoundFunction, Function
from p3dof.loops.compiled.kept import require_fit
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.results import read_only

_NEAR, _STEPS = 0.02, 4
"""How far motors move at most between samples [rad, or share of the unit of length]; steps of Newton."""
_COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")


class _Sample(NamedTuple):
    """What is kept of the last sample."""

    q: FloatArray
    momentum: FloatArray
    rate: FloatArray


class MomentumObserver:
    """Estimates the generalised force of all that the model does not have; see `ClosedLoopModel.observer`.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot as it is now.
    bandwidth : float
        Of the lag behind which forces are seen [Hz]: ``1 / (2 π bandwidth)`` is its time constant.
    threshold : float or (n,) array, optional
        Forces above which there is a contact, along each coordinate [N or N m].
    compiled : CompiledLoop, optional
        The robot compiled for where it works, for known wrenches or payloads.

    Attributes
    ----------
    coordinates : tuple of str
        The n independent coordinates: the actuated joints where those determine the motion.
    external : (n,) array
        The estimate along each of them [N or N m]; zero before the second sample.

    Raises
    ------
    InputError
        If the bandwidth or a threshold is not positive, or `compiled` is of another robot.
    ModelError, AssemblyError
        As `ClosedLoopModel.compile`.
    """

    def __init__(
        self,
        loop: LoopModel,
        bandwidth: float,
        threshold: ArrayLike | None = None,
        compiled: CompiledLoop | None = None,
    ) -> None:
        self.bandwidth = positive("bandwidth", bandwidth, InputError)
        if compiled is not None:
            require_fit(loop, compiled, name="compiled")
        self._loop, self._compiled = loop, CompiledLoop(loop) if compiled is None else compiled
        self.coordinates = self._compiled.independent
        self._threshold = None if threshold is None else self._limits(threshold)
        self._free = list(self._compiled.independent_places)
        self._bound, self._function = self._compiled.bind("momentum"), self._compiled.function("momentum")
        self.start()

    def __repr__(self) -> str:
        return f"MomentumObserver({', '.join(self.coordinates)}; {self.bandwidth:g} Hz)"

    def start(self) -> None:
        """Forget what was seen: the next sample is the first."""
        self.external: FloatArray = read_only(np.zeros(len(self._free)))
        self._last: _Sample | None = None

    @property
    def share(self) -> float:
        """The largest force of the estimate in its threshold; `ModelError` without a threshold."""
        if self._threshold is None:
            raise ModelError("observer: it was made without a threshold")
        return float((np.abs(self.external) / self._threshold).max(initial=0.0))

    @property
    def contact(self) -> bool:
        """Whether a force of the estimate is above its threshold; `ModelError` without one."""
        return self.share > 1.0

    def update(
        self,
        dt: float,
        q: ArrayLike,
        v: ArrayLike,
        forces: ArrayLike,
        external: External | None = None,
        inertias: Mapping[str, ArrayLike] | None = None,
    ) -> FloatArray:
        """Return the estimate after one more sample of a control loop (n,) [N or N m].

        Parameters
        ----------
        dt : float
            Time since the last sample [s]; zero begins anew.
        q : (nq,) array
            Configuration, with closed loops.
        v : (nv,) array
            Velocities.
        forces : (n_actuated,) array
            Of the actuators since the last sample: gear ratio times torque constant times current, say.
        external, inertias
            Known wrenches and inertial parameters, as of `CompiledLoop.inverse_dynamics`.

        Raises
        ------
        InputError
            If an argument has the wrong shape or is not finite, or the loops are open.
        SingularityError
            If the independent coordinates do not determine the motion here.
        """
        model, dt = self._loop.model, not_negative("dt", dt)
        inputs = self._bound.inputs
        given = {
            "q": frozen_array("q", q, (model.nq,)),
            "v_independent": frozen_array("v", v, (model.nv,))[self._free],
            "tau": frozen_array("forces", forces, (len(self._loop.actuated),)),
            **self._compiled._load(1, external, None, inertias),
        }
        for name, value in given.items():
            inputs[name][:] = value
        self._bound.run()
        found = self._bound.outputs
        if not found["trusted"][0] > 0.0:
            gap, margin = found["gap"][0], found["margin"][0]
            refused("observer", self._function, self.coordinates, gap, margin)
        now = _Sample(given["q"], np.array(found["momentum"]), np.array(found["rate"]))
        if self._last is None or not dt:
            self.start()
        else:
            seen = (now.momentum - self._last.momentum) / dt - (now.rate + self._last.rate) / 2
            self.external = read_only(self._lagged(self.external, seen - found["actuation"], dt))
        self._last = now
        return self.external

    def update_from_motors(
        self,
        dt: float,
        position: ArrayLike,
        velocity: ArrayLike,
        forces: ArrayLike,
        external: External | None = None,
        inertias: Mapping[str, ArrayLike] | None = None,
    ) -> FloatArray:
        """Return the estimate after one more sample of what the motors tell (n,) [N or N m].

        The passive joints are found from the last sample on, at first from the reference configuration.

        Parameters
        ----------
        dt : float
            As of `update`.
        position, velocity : (n_actuated,) array
            Of the actuated joints [m or rad, and per second].
        forces, external, inertias
            As of `update`.

        Raises
        ------
        ModelError
            If the actuated joints do not determine the motion.
        AssemblyError
            If the linkage does not reach the position on its branch.
        InputError, SingularityError
            As `update`.
        """
        if not self._compiled.determined:
            raise ModelError("observer: the actuated joints do not determine the motion; update takes q, v")
        count = (len(self._loop.actuated),)
        speeds, v = frozen_array("velocity", velocity, count), np.zeros(self._loop.model.nv)
        q = self._closed(frozen_array("position", position, count))
        v[self._free] = speeds[self._closing[0].order]
        return self.update(dt, q, v, forces, external, inertias)

    def record(
        self,
        time: ArrayLike,
        q: ArrayLike,
        v: ArrayLike,
        forces: ArrayLike,
        external: External | None = None,
        inertias: Mapping[str, ArrayLike] | None = None,
        held: bool = False,
    ) -> FloatArray:
        """Return the estimates (N, n) over a log or a run; the observer itself stays as it is.

        Parameters
        ----------
        time : (N,) array
            Rising [s].
        q, v, forces : (N, nq), (N, nv) and (N, n_actuated) array
            As of `update`, at each time.
        external, inertias
            As of `update`, with or without a leading axis N.
        held : bool
            Whether each row of forces acts until the next time; else they change evenly in between.

        Raises
        ------
        InputError, SingularityError
            As `update`.
        """
        time, model = frozen_array("time", time, ("N",)), self._loop.model
        count = len(time)
        if count and not (np.diff(time) > 0).all():
            raise InputError("time: expected rising times")
        given = {
            "q": frozen_array("q", q, (count, model.nq)),
            "v_independent": frozen_array("v", v, (count, model.nv))[:, self._free],
            "tau": frozen_array("forces", forces, (count, len(self._loop.actuated))),
            **self._compiled._load(count, external, None, inertias),
        }
        found = self._compiled.rows("momentum", given)
        bad = ~(found["trusted"][:, 0] > 0.0)
        if bad.any():
            i = int(np.argmax(bad))
            gap, margin = found["gap"][i, 0], found["margin"][i, 0]
            refused("observer", self._function, self.coordinates, gap, margin, f" at sample {i}")
        actuation = found["actuation"]
        acting = actuation[:-1] if held else (actuation[1:] + actuation[:-1]) / 2
        steps = np.diff(time)
        seen = np.diff(found["momentum"], axis=0) / steps[:, None]
        seen -= (found["rate"][1:] + found["rate"][:-1]) / 2 + acting
        estimates = np.zeros((count, len(self._free)))
        for k, dt in enumerate(steps):
            estimates[k + 1] = self._lagged(estimates[k], seen[k], dt)
        return estimates

    def frame_wrench(self, frame: str, components: Sequence[str]) -> FloatArray:
        """Return the wrench on a frame that explains the last estimate best; (6,) array.

        Force [N] and moment [N m] in world axes at the frame's origin; zero in all other components.

        Parameters
        ----------
        frame : str
            Where the contact is, as the platform.
        components : sequence of str
            Which ones it has, at most n of ``fx``, ``fy``, ``fz``, ``mx``, ``my``, ``mz``.

        Raises
        ------
        InputError
            If there is no such frame, a component is unknown or there are too many of them, or nothing was
            seen yet.
        SingularityError
            If the motion does not tell the components apart here.
        """
        if self._last is None:
            raise InputError("frame_wrench: nothing was seen yet: update() first")
        chosen = [components] if isinstance(components, str) else list(components)
        if not chosen or not set(chosen) <= set(_COMPONENTS) or len(set(chosen)) < len(chosen):
            raise InputError(
                f"components: expected some of {', '.join(_COMPONENTS)}, got {shown(components)}"
            )
        if len(chosen) > len(self._free):
            raise InputError(
                f"components: {len(self._free)} coordinates tell at most as many, got {len(chosen)}"
            )
        rows = [_COMPONENTS.index(name) for name in chosen]
        J = self._loop.frame_jacobian(frame, self._last.q, None, self.coordinates).jacobian[rows]
        seen = Decomposition.of(J.T, RANK_TOLERANCE, float(np.abs(J).max(initial=0.0)))
        if seen.rank < len(rows):
            raise SingularityError(f"frame_wrench: the motion does not tell {', '.join(chosen)} apart here")
        wrench = np.zeros(6)
        wrench[rows] = seen.pseudo_inverse @ self.external
        return wrench

    def _closed(self, values: FloatArray) -> FloatArray:
        """Return the configuration at positions of the motors: near the last one by Newton's method alone."""
        settle, step = self._closing
        start = self._loop.regular_configuration if self._last is None else self._last.q
        q, wanted = np.array(start)[None], values[settle.order][None]
        if np.abs(wanted - settle.values(q)).max(initial=0.0) < _NEAR * self._compiled.length:
            settle.enter(q, wanted)
            for _ in range(_STEPS):
                step.inputs["q"][:] = q[0]
                step.run()
                size = np.abs(step.outputs["q"] - q[0]).max(initial=0.0)
                q[0] = step.outputs["q"]
                if size <= CONVERGING:
                    return np.asarray(q[0])
                if size > LARGEST_CORRECTION:
                    break
        there = settle(start, values[None])
        if not there.good[0]:
            told = ", ".join(f"{name}={x:.4g}" for name, x in zip(self._loop.actuated, values, strict=True))
            raise AssemblyError(f"observer: the linkage does not reach {told} on its branch")
        return np.asarray(there.q[0])

    @cached_property
    def _closing(self) -> tuple[Settler, BoundFunction]:
        return Settler(self._compiled), self._compiled.bind("step")

    def _lagged(self, last: FloatArray, seen: FloatArray, dt: float) -> FloatArray:
        gain = 2.0 * np.pi * self.bandwidth * dt
        return np.asarray(last + gain / (1.0 + gain) * (seen - last))

    def _limits(self, threshold: ArrayLike) -> FloatArray:
        values = np.asarray(threshold, dtype=float)
        n = len(self.coordinates)
        if values.shape not in ((), (n,)) or not (np.isfinite(values) & (values > 0.0)).all():
            raise InputError(f"threshold: expected a positive number or {n} of them, got {shown(threshold)}")
        return np.broadcast_to(values, (n,)).copy()


def refused(
    who: str, function: Function, independent: Sequence[str], gap: float, margin: float, where: str = ""
) -> NoReturn:
    """Raise what is wrong with a sample that a compiled function does not trust."""
    if gap > function.closed:
        raise InputError(f"{who}: the loops are open by {gap:.3g} m or rad{where}")
    if margin < function.least_margin:
        raise SingularityError(
            f"{who}: {', '.join(independent)} hardly determine the motion{where}, margin "
            f"{margin:.2g}: give it what compile(around=q) returns"
        )
    raise InputError(f"{who}: a quaternion or circle is not of length one{where}, or q or v too large")
