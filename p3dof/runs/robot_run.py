"""`RobotRun`: everything that a run of any robot leaves behind."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.files import write_table
from p3dof.loops import BatchReactions, ClosedLoopModel, ClosureJoint, ReactionSolver, reactions_batch
from p3dof.loops.tables import is_slide, units_of_actuated
from p3dof.runs.events import Occurrence
from p3dof.runs.margins import Stop


@dataclass(frozen=True)
class JointExceedance:
    """A limit of a joint's force or speed that a run exceeds, where it does so the most.

    Parameters
    ----------
    quantity : str
        ``"force"`` or ``"speed"``.
    joint : str
        The joint.
    time : float
        When [s].
    value, limit : float
        What it is then, and the limit of the robot's file.
    unit : str
        Of both.
    """

    quantity: str
    joint: str
    time: float
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        return (
            f"{self.quantity} of {self.joint}: {self.value:g} {self.unit} at t = {self.time:g} s, "
            f"limit {self.limit:g} {self.unit}"
        )


def explained(stop: Stop | None, loop: ClosedLoopModel, v: FloatArray) -> Stop | None:
    """Return the end of a run; of one that could not go on with the joint that moved the fastest.

    Parameters
    ----------
    stop : Stop, optional
        The end.
    loop : ClosedLoopModel
        The robot.
    v : (nv,) array
        Its velocity then.

    Returns
    -------
    Stop, optional
    """
    if stop is None or stop.kind != "accuracy":
        return stop
    at = int(np.argmax(np.abs(v)))
    joints = range(1, loop.model.njoints)
    name = next(
        str(loop.model.names[i]) for i in joints if 0 <= at - loop.model.idx_vs[i] < loop.model.nvs[i]
    )
    words = f"{stop.reason}; the joint {name!r} moves the fastest, at {v[at]:.3g} (SI units)"
    return Stop(stop.kind, stop.time, words)


@dataclass(frozen=True, eq=False)
class RobotRun:
    """A run of any robot in time.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    time : (N,) array
        Times of the samples [s].
    q : (N, nq) array
        Configurations in Pinocchio's order [m, rad].
    v, a : (N, nv) array
        Velocities and accelerations.
    forces : (N, n_actuated) array
        Of the actuated joints [N or N m].
    asked : (N, n_actuated) array
        Forces that the controller asked for, before they were cut off [N or N m].
    gap : (N,) array
        Largest distance by which a loop is open [m or rad].
    energy : (N,) array
        Kinetic and potential energy, that of springs in joints included [J].
    stop : Stop, optional
        What ended the run before its time.
    evaluations : int
        Of the equations of motion.
    seconds : float
        On the clock.
    external : mapping of str to (N, 6) array
        Wrenches that acted on frames, in world axes at their origins [N, N m].
    reference : (N, n_actuated) array, optional
        Values of the actuated joints that the controller followed [m or rad].
    events : tuple of Occurrence
        Events that did not end the run, in their order.
    """

    loop: ClosedLoopModel
    time: FloatArray
    q: FloatArray
    v: FloatArray
    a: FloatArray
    forces: FloatArray
    asked: FloatArray
    gap: FloatArray
    energy: FloatArray
    stop: Stop | None
    evaluations: int
    seconds: float = 0.0
    external: Mapping[str, FloatArray] = field(default_factory=dict)
    reference: FloatArray | None = None
    events: tuple[Occurrence, ...] = ()

    def __len__(self) -> int:
        return len(self.time)

    @property
    def finished(self) -> bool:
        """Whether it went on to its end."""
        return self.stop is None

    @property
    def actuated(self) -> FloatArray:
        """Values of the actuated joints (N, n_actuated) [m or rad]; of continuous ones without jumps."""
        return np.column_stack(
            [np.zeros((len(self), 0)), *(self.values(name) for name in self.loop.actuated)]
        )

    @property
    def error(self) -> FloatArray | None:
        """Reference less value of the actuated joints (N, n_actuated) [m or rad]; None if there is none."""
        if self.reference is None:
            return None
        error = self.reference - self.actuated
        model = self.loop.model
        circles = [model.nqs[model.getJointId(name)] == 2 for name in self.loop.actuated]
        return np.where(circles, np.arctan2(np.sin(error), np.cos(error)), error)

    @property
    def power(self) -> FloatArray:
        """Power of the actuators (N, n_actuated) [W]."""
        return np.asarray(self.forces * self.v[:, self.loop.actuated_v])

    def multipliers(self) -> FloatArray:
        """Return the forces in the closures (N, rows), in the order of `loop.constraint_rows` [N or N m].

        Of redundant closures they are the least that there are; see `ClosedLoopModel.inverse_dynamics`.

        Raises
        ------
        DynamicsError, InputError
            As `ClosedLoopModel.forward_dynamics`.
        """
        found = [
            self.loop.forward_dynamics(q, v, tau, {name: wrench[i] for name, wrench in self.external.items()})
            for i, (q, v, tau) in enumerate(zip(self.q, self.v, self.forces, strict=True))
        ]
        return np.array([one.lambda_ for one in found]).reshape(len(self), -1)

    def reactions(self, joints: Sequence[ClosureJoint] | None = None) -> BatchReactions:
        """Return the reactions in all joints at all samples.

        Parameters
        ----------
        joints : sequence of ClosureJoint, optional
            How each closure is built, as of `p3dof.loops.ReactionSolver`.

        Returns
        -------
        BatchReactions

        Raises
        ------
        ModelError
            If there is not one for each closure.
        """
        solver = ReactionSolver(self.loop, joints)
        return reactions_batch(solver, self.q, self.v, self.a, self.forces, dict(self.external))

    def exceedances(self) -> tuple[JointExceedance, ...]:
        """Return which limits of force and speed in the robot's file samples exceed, each at its worst.

        A limit that is zero or infinite is none: so are files that leave them out.
        """
        model, found = self.loop.model, []
        effort, speed = np.asarray(model.upperEffortLimit), np.asarray(model.upperVelocityLimit)
        columns = [
            ("force", name, self.forces[:, i], float(effort[at]))
            for i, (name, at) in enumerate(zip(self.loop.actuated, self.loop.actuated_v, strict=True))
        ]
        single = [i for i in range(1, model.njoints) if model.nvs[i] == 1]
        columns += [
            ("speed", str(model.names[i]), self.v[:, model.idx_vs[i]], float(speed[model.idx_vs[i]]))
            for i in single
        ]
        for quantity, name, values, limit in columns:
            at = int(np.argmax(np.abs(values)))
            if 0 < limit < np.inf and abs(values[at]) > limit * (1 + 1e-12):
                slides = is_slide(self.loop, model.getJointId(name))
                unit = {"force": ("N m", "N"), "speed": ("rad/s", "m/s")}[quantity][slides]
                found.append(
                    JointExceedance(quantity, name, float(self.time[at]), float(values[at]), limit, unit)
                )
        return tuple(found)

    def to_csv(self, path: str | os.PathLike[str], multipliers: bool = False) -> Path:
        """Write time, joints, velocities, forces, energy and gap to a CSV file.

        Parameters
        ----------
        path : path-like
            The file, which ends in ``.csv``; replaced whole or not at all.
        multipliers : bool
            Whether to add the forces in the closures, see `multipliers`.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        InputError, FileError
            If its name does not fit, or it cannot be written.
        """
        model, names = self.loop.model, [str(name) for name in self.loop.model.names[1:]]
        header, columns = ["t [s]"], [self.time]
        for name in names:
            values = np.atleast_2d(self.values(name).T)
            header += _numbered(name, len(values))
            columns += list(values)
        for name in names:
            joint = model.getJointId(name)
            span = self.v[:, model.idx_vs[joint] : model.idx_vs[joint] + model.nvs[joint]]
            header += [f"{one} dot" for one in _numbered(name, span.shape[1])]
            columns += list(span.T)
        units = units_of_actuated(self.loop)
        header += [
            f"force {name} [{unit}]" for name, (_, unit) in zip(self.loop.actuated, units, strict=True)
        ]
        columns += [*self.forces.T]
        if multipliers:
            header += self._closure_names()
            columns += list(self.multipliers().T)
        return write_table(path, [*header, "energy [J]", "gap"], (*columns, self.energy, self.gap))

    def values(self, name: str) -> FloatArray:
        """Return the values of a joint (N,) or (N, n) [m, rad]; those of a continuous one go on after a turn.

        Parameters
        ----------
        name : str
            The joint; it must exist.
        """
        model, joint = self.loop.model, self.loop.model.getJointId(name)
        at, size = model.idx_qs[joint], model.nqs[joint]
        if size == 2 and model.nvs[joint] == 1:
            return np.asarray(np.unwrap(np.arctan2(self.q[:, at + 1], self.q[:, at])))
        return self.q[:, at] if size == 1 else self.q[:, at : at + size]

    def _closure_names(self) -> list[str]:
        """Return the names of all multipliers."""
        sidecar, found = self.loop.sidecar, []
        titles = [f"{closure.frame1}/{closure.frame2}" for closure in sidecar.closures]
        titles += [coupling.title for coupling in sidecar.couplings]
        for title, span in zip(titles, self.loop.constraint_rows, strict=True):
            found += _numbered(f"multiplier {title}", span.stop - span.start)
        return found


def _numbered(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name}.{i}" for i in range(count)]
