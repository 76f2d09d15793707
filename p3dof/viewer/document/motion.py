"""`JointMotion`: what is shown of any robot over time, its joints and the forces on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, FrozenArrays, as_floats, frozen_array, shown
from p3dof._base.errors import InputError, P3dofError
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.linear import UNIQUE
from p3dof.viewer.document.encoding import some_of

MOST_SAMPLES = 1001
"""At so many samples at most the forces in the closures are computed; between them they go straight."""


_ROUNDING = 1e-12
"""Forces smaller than this share of a robot's weight are none [1 or m]."""


class Run(Protocol):
    """A run in time, as `p3dof.runs.RobotRun` is one."""

    @property
    def time(self) -> FloatArray:
        """Times, shape (N,) [s]."""

    @property
    def q(self) -> FloatArray:
        """Configurations, shape (N, nq)."""

    @property
    def v(self) -> FloatArray:
        """Velocities, shape (N, nv)."""

    @property
    def forces(self) -> FloatArray:
        """Of the actuated joints, shape (N, n)."""


@dataclass(frozen=True, eq=False)
class JointMotion(FrozenArrays):
    """Joint positions over time, and the forces of actuators and closures if they are known."""

    time: FloatArray  # (N,): strictly rising times [s]
    q: FloatArray
    """(N, nq): configurations in Pinocchio's order [m, rad], as of a run of a `ConstrainedPlant`."""
    actuated: tuple[str, ...] = ()  # names of the n actuated joints, as of `p3dof.ClosedLoopModel.actuated`
    forces: ArrayLike | None = None
    """(N, n): of the actuators [N or N m]; NaN where they are not determined. Without, no actuator is
    shown."""
    multipliers: ArrayLike | None = None
    """(N, rows): of the closures and couplings, as `p3dof.loops.InverseDynamics.lambda_`; NaN where they
    are not determined."""
    wrenches: Mapping[str, ArrayLike] | None = None
    """(6,): external wrenches by frame: force [N] and moment [N m] at its origin, in world axes."""
    smallest: bool = False
    """Whether other forces of the actuators would do as well; the smallest are given, and the multipliers
    are those that go with them."""

    def __post_init__(self) -> None:
        time = frozen_array("time", self.time, ("N",))
        if not len(time):
            raise InputError("time: expected at least one sample, got none")
        if np.any(np.diff(time) <= 0):
            raise InputError("time: expected strictly rising times")
        q = as_floats("q", self.q)
        count = q.shape[1] if q.ndim == 2 else 0
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "q", frozen_array("q", q, (len(time), count)))
        names = () if self.forces is None else tuple(self.actuated)
        object.__setattr__(self, "actuated", names)
        object.__setattr__(self, "forces", _rows("forces", self.forces, len(time), len(names)))
        object.__setattr__(self, "multipliers", _rows("multipliers", self.multipliers, len(time), None))
        object.__setattr__(self, "wrenches", _wrenches(self.wrenches, len(time)))

    @property
    def known(self) -> FloatArray:
        """The forces of the actuators, shape (N, n); no column without."""
        return np.asarray(self.forces)

    @property
    def closing(self) -> FloatArray:
        """The multipliers, shape (N, rows); no column without."""
        return np.asarray(self.multipliers)

    @property
    def acting(self) -> dict[str, FloatArray]:
        """The external wrenches by frame, shape (N, 6) each."""
        return {name: np.asarray(wrench) for name, wrench in (self.wrenches or {}).items()}

    @classmethod
    def at_rest(
        cls,
        robot: ClosedLoopModel,
        q: ArrayLike | None = None,
        external: Mapping[str, ArrayLike] | None = None,
    ) -> JointMotion:
        """Return a robot that stands still, with the forces that hold it; see `held`."""
        place = frozen_array("q", robot.assemble().q if q is None else q, (robot.model.nq,))
        return held(robot, place, external)[0]

    @classmethod
    def of_run(
        cls,
        robot: ClosedLoopModel,
        run: Run,
        external: Mapping[str, ArrayLike] | None = None,
        smallest: bool = False,
    ) -> JointMotion:
        """Return what a run looks like, with the forces in the closures; of a long run 1001 samples."""
        if not all(hasattr(run, name) for name in ("time", "q", "v", "forces")):
            raise InputError(f"run: expected a run with time, q, v and forces, got {shown(run)}")
        loads = _wrenches(external, len(run.time))
        some = some_of(len(run.time), MOST_SAMPLES)
        closing = []
        for i in some:
            acting = {name: wrench[i] for name, wrench in loads.items()}
            closing.append(_multipliers(robot, run.q[i], run.v[i], run.forces[i], acting))
        loads = {name: wrench[some] for name, wrench in loads.items()}
        forces, closing_ = run.forces[some], np.array(closing)
        return cls(run.time[some], run.q[some], robot.actuated, forces, closing_, loads, smallest)


def held(
    robot: ClosedLoopModel,
    q: FloatArray,
    external: Mapping[str, ArrayLike] | None = None,
    compiled: CompiledLoop | None = None,
) -> tuple[JointMotion, str]:
    """Return a robot at rest with the forces that hold it, and why they are not known.

    Where passive freedoms would move, the forces are those that keep the actuated joints from it; without
    actuators there are only those in closures, as it falls.
    """
    nothing = np.zeros(robot.model.nv)

    def standing(forces: FloatArray, multipliers: FloatArray, smallest: bool = False) -> JointMotion:
        rows = forces[None], multipliers[None]
        return JointMotion(np.zeros(1), q[None], robot.actuated, *rows, wrenches, smallest)

    wrenches = {name: as_floats(f"external {name}", w) for name, w in (external or {}).items()}
    if not robot.actuated:  # it falls
        return standing(np.zeros(0), _multipliers(robot, q, nothing, np.zeros(0), wrenches)), ""
    found: Any = None
    why = ""
    if compiled is not None and compiled.unique and set(wrenches) <= set(compiled.external):
        states = {"q": q[None], "v": nothing[None], "a": nothing[None]}
        fast = compiled.rows("inverse_dynamics", states | {f"wrench_{n}": w for n, w in wrenches.items()})
        if fast["trusted"][0, 0] > 0.0:
            tau, lambda_ = (_without_rounding(robot, fast[name][0]) for name in ("tau", "lambda_"))
            return standing(tau, lambda_), ""
    try:
        found = robot.inverse_dynamics(q, nothing, nothing, external=wrenches)
    except InputError:
        raise
    except P3dofError as error:
        why = str(error).partition("; hybrid_dynamics()")[0]  # advice for programs
    rank = robot.generic_rank  # at a singular pose there are more freedoms, and no motor holds them
    if found is None and robot.model.nv - (robot.rank(q) if rank is None else rank) > len(robot.actuated):
        try:
            still = np.zeros(len(robot.actuated))
            found, why = robot.hybrid_dynamics(q, nothing, still, external=wrenches), ""
        except P3dofError:
            pass
    if found is None:
        rows = sum(span.stop - span.start for span in robot.constraint_rows)
        return standing(np.full(len(robot.actuated), np.nan), np.full(rows, np.nan)), why
    unique = found.unique if found.tau_unique else _unique(robot, q)
    lambda_ = np.where(unique, found.lambda_, np.nan)
    forces, multipliers = _without_rounding(robot, found.tau), _without_rounding(robot, lambda_)
    return standing(forces, multipliers, not found.tau_unique), why


def _multipliers(
    robot: ClosedLoopModel,
    q: FloatArray,
    v: FloatArray,
    forces: FloatArray,
    external: Mapping[str, FloatArray],
) -> FloatArray:
    """Return the multipliers (rows,) under forces of the actuators, NaN where they are not determined."""
    try:
        found = robot.forward_dynamics(q, v, forces, external=external)
    except P3dofError:
        return np.full(sum(span.stop - span.start for span in robot.constraint_rows), np.nan)
    return _without_rounding(robot, np.where(_unique(robot, q), found.lambda_, np.nan))


def _without_rounding(robot: ClosedLoopModel, forces: FloatArray) -> FloatArray:
    """Return forces, zero where nothing is left of them but rounding beside the robot's weight."""
    weight = pin.computeTotalMass(robot.model) * np.linalg.norm(robot.model.gravity.linear)
    return np.where(np.abs(forces) <= _ROUNDING * weight, 0.0, forces)


def _unique(robot: ClosedLoopModel, q: FloatArray) -> NDArray[np.bool_]:
    """Return which multipliers (rows,) are determined when the forces of the actuators are given."""
    U = np.linalg.svd(robot.closure_jacobian(q), full_matrices=True)[0]
    return np.asarray(np.abs(U[:, robot.rank(q) :]).max(axis=1, initial=0.0) <= UNIQUE)


def _rows(name: str, given: ArrayLike | None, count: int, width: int | None) -> FloatArray:
    """Return rows (count, width), read-only; of any width where it is None, and of none without them."""
    rows = np.empty((count, 0)) if given is None else as_floats(name, given).copy()
    if rows.ndim != 2 or rows.shape != (count, rows.shape[1] if width is None else width):
        wanted = f"({count}, {'rows' if width is None else width})"
        raise InputError(f"{name}: expected shape {wanted}, got {rows.shape}")
    rows.setflags(write=False)
    return rows


def _wrenches(given: Mapping[str, ArrayLike] | None, count: int) -> dict[str, FloatArray]:
    """Return wrenches by frame, (count, 6) each."""
    if given is not None and not isinstance(given, Mapping):
        raise InputError(f"wrenches: expected a mapping of frame names to wrenches, got {shown(given)}")
    found = {}
    for name, wrench in (given or {}).items():
        one = as_floats(f"wrench {name}", wrench)
        found[str(name)] = frozen_array(
            f"wrench {name}", np.broadcast_to(one, (count, 6)) if one.shape == (6,) else one, (count, 6)
        )
    return found
