"""A motion of the actuated joints of any robot: read, completed to all joints, and the forces for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from p3dof.checks import FloatArray
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.tables import is_slide, joint_values, units_of_actuated
from p3dof.errors import AssemblyError, DynamicsError, InputError, P3dofError, SingularityError
from p3dof.files import Source, called, read_text, write_table
from p3dof.motion.joint_files import read_joints


@dataclass(frozen=True, eq=False)
class Forces:
    """Forces along a motion, with the motion of all joints.

    Parameters
    ----------
    robot : ClosedLoopModel
        What moves.
    time : (N,) array
        Times [s].
    q : (N, nq) array
        Configurations.
    v, a : (N, nv) array
        Velocities and accelerations.
    tau : (N, n_actuated) array
        Forces of the actuated joints [N or N m].
    gap, residual : float
        Largest gap of a loop [m or rad], and largest error of the equation of motion [N or N m].
    """

    robot: ClosedLoopModel
    time: FloatArray
    q: FloatArray
    v: FloatArray
    a: FloatArray
    tau: FloatArray
    gap: float
    residual: float

    def to_csv(self, path: Path) -> Path:
        """Write times, actuated joints, their forces and all joints; see `p3dof.files.write_table`."""
        units = units_of_actuated(self.robot)
        rows = [joint_values(self.robot, q) for q in self.q]
        header = ["t [s]"]
        header += [
            f"force {name} [{unit}]" for name, (_, unit) in zip(self.robot.actuated, units, strict=True)
        ]
        columns = [self.time, *self.tau.T]
        for name in rows[0]:
            values = np.array([row[name] for row in rows])
            joint = self.robot.model.getJointId(name)
            if self.robot.model.nvs[joint] == 1:
                turns = values[:, 0] if is_slide(self.robot, joint) else np.unwrap(values[:, 0])
                header.append(f"{name} [{'m' if is_slide(self.robot, joint) else 'rad'}]")
                columns.append(turns)
            else:
                header += [f"{name}.{i}" for i in range(values.shape[1])]
                columns += list(values.T)
        return write_table(path, header, tuple(columns))


def forces_along(robot: ClosedLoopModel, motion: Source) -> Forces:
    """Return the forces of the actuated joints along a motion of them.

    Parameters
    ----------
    robot : ClosedLoopModel
        What moves.
    motion : path-like or stream
        The CSV file.

    Returns
    -------
    Forces

    Raises
    ------
    AssemblyError, DynamicsError, SingularityError
        If the robot cannot make the motion, with the time at which.
    MotionError, FileError, InputError
        If the file does not fit the robot.
    """
    if not robot.actuated:
        raise InputError("the robot has no actuated joints")
    joints = [robot.model.getJointId(name) for name in robot.actuated]
    text, name = read_text(motion), called(motion)
    sliding = [is_slide(robot, joint) for joint in joints]
    time, values, velocities, accelerations = read_joints(text, name, robot.actuated, sliding)
    start = robot.assemble(values[0]).q
    states = robot.complete_batch(values, velocities, accelerations, start, stop=True)
    _require(states.errors, time)
    found = robot.inverse_dynamics_batch(states.q, states.v, states.a, stop=True)
    _require(found.errors, time)
    gap = float(np.abs(found.closure_error).max(initial=0.0))
    return Forces(
        robot, time, states.q, states.v, states.a, found.tau, gap, float(found.residual.max(initial=0.0))
    )


def _require(errors: dict[int, P3dofError], time: FloatArray) -> None:
    """Raise the first error with its time."""
    for index, error in sorted(errors.items()):
        words = f"at t = {time[index]:.6g} s: {error}"
        if isinstance(error, AssemblyError):
            raise AssemblyError(words, error.gap) from error
        kind = (
            type(error) if isinstance(error, DynamicsError | SingularityError | InputError) else DynamicsError
        )
        raise kind(words) from error
