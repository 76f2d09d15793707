"""`RobotRun`: everything that a run of any robot leaves behind, much of it as runs of the machine do."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import FileError, InputError
from p3dof._base.files import called, suffix_of, write_atomic, write_table
from p3dof._base.tables import Tabular
from p3dof.runs import archive
from p3dof.runs.archive import Member
from p3dof.runs.integration import Recording
from p3dof.runs.margins import ROBOT_KINDS, Occurrence, Stop
from p3dof.runs.plants import Limited

if TYPE_CHECKING:  # the machine runs without Pinocchio, which all that other robots need imports
    from p3dof.loops import BatchReactions, ClosedLoopModel, ClosureJoint
    from p3dof.runs.joint_controllers import JointReference
    from p3dof.runs.plants import ConstrainedPlant

ROBOT_STOPS = (*ROBOT_KINDS, "event", "accuracy", "controller")  # what may have ended a run of a robot

_ARRAYS = ("time", "q", "v", "a", "forces", "asked", "gap", "energy")


def _explained(stop: Stop | None, loop: ClosedLoopModel, v: FloatArray) -> Stop | None:
    """Return the end of a run; of one that could not go on with the joint that moved the fastest."""
    if stop is None or stop.kind != "accuracy":
        return stop
    at = int(np.argmax(np.abs(v)))
    joints = range(1, loop.model.njoints)
    name = next(
        str(loop.model.names[i]) for i in joints if 0 <= at - loop.model.idx_vs[i] < loop.model.nvs[i]
    )
    words = f"{stop.reason}; the joint {name!r} moves the fastest, at {v[at]:.3g} (SI units)"
    return Stop(stop.kind, stop.time, words)


class RunResult:
    """What every run leaves behind, of any robot or of the machine."""

    method: str
    forces: FloatArray
    asked: FloatArray
    reference: FloatArray | None
    stop: Stop | None
    evaluations: int
    seconds: float
    note: str
    events: tuple[Occurrence, ...]

    def __len__(self) -> int:
        return len(self.forces)

    @property
    def finished(self) -> bool:
        """Whether the run went on to its end."""
        return self.stop is None

    @property
    def duration(self) -> float:
        """How long it went on [s]."""
        raise NotImplementedError

    @property
    def error(self) -> Any:
        """Tracking error at the samples (N, n); None if there was nothing to follow."""
        raise NotImplementedError

    @property
    def rates(self) -> FloatArray:
        """Velocities of the actuated joints (N, n) [m/s or rad/s]."""
        raise NotImplementedError

    @property
    def rms_error(self) -> FloatArray:
        """Root mean square over the samples of the tracking error, shape (n,) [m or rad]."""
        return np.asarray(np.sqrt(np.mean(self._missed() ** 2, axis=0)))

    @property
    def peak_error(self) -> FloatArray:
        """Largest magnitude of the tracking error, shape (n,) [m or rad]."""
        return np.asarray(np.abs(self._missed()).max(axis=0))

    @property
    def power(self) -> FloatArray:
        """Power of the actuators (N, n) [W]."""
        return np.asarray(self.forces * self.rates)

    @property
    def speed(self) -> float:
        """Simulated time by time on the clock: above 1 the run was faster than the robot."""
        return self.duration / self.seconds if self.seconds else float("inf")

    def _missed(self) -> FloatArray:
        """Return the tracking error, if there was something to follow."""
        if self.error is None:
            raise InputError("error: the run had no motion to follow")
        return np.asarray(self.error)


@dataclass(frozen=True, eq=False)
class RobotRun(RunResult, Limited, Tabular):
    """A simulation of any robot.

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
    method : str
        What computed accelerations: ``"general"``, the robot; or ``"compiled"``.
    note : str
        What made the run slow, and what to do instead, where it was not made in C; else empty.
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
    method: str = "general"
    note: str = ""

    def __repr__(self) -> str:
        end = "finished" if self.stop is None else f"ended by {self.stop}"
        return f"RobotRun({self.loop.model.name!r}, {self.method}, {len(self)} samples, {end})"

    @property
    def duration(self) -> float:
        """How long it went on [s]."""
        return float(self.time[-1] - self.time[0])

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
    def rates(self) -> FloatArray:
        """Velocities of the actuated joints (N, n_actuated) [m/s or rad/s]."""
        return np.asarray(self.v[:, self.loop.actuated_v])

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

        Raises
        ------
        ModelError
            If there is not one for each closure.
        """
        from p3dof.loops import ReactionSolver, reactions_batch

        solver = ReactionSolver(self.loop, joints)
        return reactions_batch(solver, self.q, self.v, self.a, self.forces, dict(self.external))

    def to_columns(self, multipliers: bool = False) -> dict[str, FloatArray]:
        """Return time, joints, velocities, forces, energy and gap (N,) by name; and `multipliers`."""
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
        from p3dof.loops.tables import units_of_actuated

        units = units_of_actuated(self.loop)
        header += [
            f"force {name} [{unit}]" for name, (_, unit) in zip(self.loop.actuated, units, strict=True)
        ]
        columns += [*self.forces.T]
        if multipliers:
            header += self._closure_names()
            columns += list(self.multipliers().T)
        return dict(zip([*header, "energy [J]", "gap"], (*columns, self.energy, self.gap), strict=True))

    def save(self, path: str | os.PathLike[str], multipliers: bool = False) -> Path:
        """Write the samples to a file; the ending of the name chooses the format.

        Parameters
        ----------
        path : path-like
            ``.csv`` (17 significant digits) or ``.npz`` (NumPy arrays, with accelerations, wrenches and
            events); replaced whole or not at all.
        multipliers : bool
            Whether to add the forces in the closures to CSV, see `multipliers`.

        Raises
        ------
        InputError, FileError
            If its name does not fit, or it cannot be written.
        """
        if suffix_of(path, "run") == ".csv":
            columns = self.to_columns(multipliers)
            return write_table(path, list(columns), tuple(columns.values()))
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        arrays["joint_names"] = np.array(list(self.loop.model.names)[1:], dtype=np.str_)
        arrays["frames"] = np.array(list(self.external), dtype=np.str_)
        wrenches = [np.zeros((len(self), 0, 6)), *(rows[:, None] for rows in self.external.values())]
        arrays["external"] = np.concatenate(wrenches, axis=1)
        return write_atomic(path, archive.pack(self, arrays))

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], loop: ClosedLoopModel, max_samples: int = archive.MAX_SAMPLES
    ) -> RobotRun:
        """Read a run that `save` wrote as ``.npz``.

        Parameters
        ----------
        path : path-like
            The file; it may come from anywhere.
        loop : ClosedLoopModel
            The robot that ran.
        max_samples : int
            Most samples to read.

        Raises
        ------
        FileError
            If the file cannot be read, or is no run of this robot.
        InputError
            If `max_samples` is no positive number.
        """
        model, n = loop.model, len(loop.actuated)
        sizes = {"q": model.nq, "v": model.nv, "a": model.nv, "forces": n, "asked": n}
        form = {
            "time": Member("f", ("N",)),
            **{name: Member("f", ("N", size)) for name, size in sizes.items()},
            "gap": Member("f", ("N",)),
            "energy": Member("f", ("N",)),
            "joint_names": Member("U", (model.njoints - 1,)),
            "frames": Member("U", ("F",)),
            "external": Member("f", ("N", "F", 6)),
            **archive.ENDING,
            "reference": Member("f", ("N", n), optional=True),
        }
        found = archive.unpack(path, form, ("general", "compiled"), ROBOT_STOPS, max_samples)
        if found["joint_names"].tolist() != list(model.names)[1:]:
            raise FileError(f"{called(path)}: expected a run of this robot, got one with other joints")
        external = {str(name): found["external"][:, i] for i, name in enumerate(found["frames"])}
        arrays = {name: found[name] for name in _ARRAYS}
        return cls(loop, **arrays, external=external, **archive.ending_of(found))

    def _closure_names(self) -> list[str]:
        """Return the names of all multipliers."""
        sidecar, found = self.loop.sidecar, []
        titles = [f"{closure.frame1}/{closure.frame2}" for closure in sidecar.closures]
        titles += [coupling.title for coupling in sidecar.couplings]
        for title, span in zip(titles, self.loop.constraint_rows, strict=True):
            found += _numbered(f"multiplier {title}", span.stop - span.start)
        return found


def left_behind(
    loop: ClosedLoopModel,
    plant: ConstrainedPlant,
    record: Recording,
    frames: Sequence[str],
    reference: JointReference | None,
    **known: Any,
) -> RobotRun:
    """Return the run of a recording; `known` is what else is known of it."""
    q, v, a, gap = plant.motion(np.array(record.states), np.array(record.rates))
    time = np.array(record.times)
    loads = np.array(record.loads).reshape(len(time), -1, 6)
    return RobotRun(
        loop,
        time,
        q,
        v,
        a,
        np.array(record.forces).reshape(len(time), -1),
        np.array(record.asked).reshape(len(time), -1),
        gap,
        loop.body_energies(q, v).total,
        _explained(record.stop, loop, v[-1]),
        record.evaluations,
        record.seconds,
        {name: loads[:, i] for i, name in enumerate(frames)},
        None if reference is None else reference.over(time)[0],
        **known,
    )


def _numbered(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name}.{i}" for i in range(count)]
