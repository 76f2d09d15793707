"""Which drives fit a machine for what it has to do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from p3dof._base.checks import FloatArray, Progress, require, shown
from p3dof._base.errors import DriveError, InputError
from p3dof.design.drives import VERDICTS, Ambient, Catalogue, Drive, Margins, Sizing, cycle_of, size_of
from p3dof.design.drives.sizing import BRAKE_SAFETY
from p3dof.design.forces_of_tasks import TaskForces, machines_of
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Friction, Parameters
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics

_POSES = 200  # poses of each piece at which holding forces and inertia are looked at


def size_drives(
    robot: Manipulator,
    found: InverseDynamics | TaskForces,
    drives: Drive | Sequence[Drive] | Iterable[Drive],
    *,
    rest: float = 0.0,
    brake_safety: float = BRAKE_SAFETY,
    margins: Margins | None = None,
    ambient: Ambient | None = None,
    progress: Progress | None = None,
) -> list[Sizing]:
    """Return what a motion or a task takes of drives, the best first.

    Each drive is tried on all three axes. Those that fit with their margins come first, the weakest motor
    first, by rated torque times rated speed; among equal motors that whose ratings are used least. Then
    those that fit without reserve, then those that do not fit, by the rating that they exceed most.

    Forces are those at the nuts: each drive's own turning parts are added at the motor, and an armature of
    the machine, which stands for those of another drive, is left out. Brakes must hold the
    machine with what it carries at any pose of the way, without help of friction.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    found : InverseDynamics or TaskForces
        Its forces over a motion or a task.
    drives : Drive or iterable of Drive
        What to try, such as a `p3dof.design.drives.Catalogue`.
    rest : float
        How long the machine rests after the last sample, besides the dwells of a task [s].
    brake_safety : float
        How much more a brake must hold than what it bears.
    margins : Margins, optional
        What of each rating must stay free; those of a `Catalogue`, or the usual ones, without it.
    ambient : Ambient, optional
        Where the motors work; that of a `Catalogue`, or up to 40 °C and 1000 m, without it.
    progress : callable, optional
        Called with (done, total) drives.

    Raises
    ------
    DriveError
        If the motion is not possible, there is no drive, or an argument does not fit.
    InputError
        If `robot` or `found` is something else.
    """
    require("robot", robot, Manipulator)
    if not isinstance(found, InverseDynamics | TaskForces):
        raise InputError(f"found: expected forces over a motion or a task, got {shown(found)}")
    results = [found] if isinstance(found, InverseDynamics) else found.results
    if any(result.coulomb is not None and result.coulomb.screws is not None for result in results):
        raise DriveError(
            "found: the forces have losses of screws (screw of the load friction), and drives have "
            "efficiencies of their own: leave one of them out"
        )
    if isinstance(drives, Catalogue):
        margins, ambient = margins or drives.margins, ambient or drives.ambient
    chosen = [drives] if isinstance(drives, Drive) else list(drives)
    if not chosen:
        raise DriveError("drives: expected at least one, got none")
    cycle = cycle_of(found, rest)
    held, when, mass, last = _static(robot, found)
    cycle = replace(cycle, holding=last)
    sizings = []
    for done, drive in enumerate(chosen, 1):
        if not isinstance(drive, Drive):
            raise DriveError(f"drives: expected Drive objects, got {shown(drive)}")
        sizings.append(
            size_of(
                cycle,
                drive,
                held=held,
                held_time=when,
                load_mass=mass,
                brake_safety=brake_safety,
                margins=margins,
                ambient=ambient,
            )
        )
        if progress is not None:
            progress(done, len(chosen))
    return sorted(sizings, key=_rank)


def _rank(sizing: Sizing) -> tuple[float, ...]:
    motor = sizing.drives[0].motor
    power = motor.rated_torque * float(motor.rated_speed or 0.0)
    share = sizing.worst[1].share
    place = VERDICTS.index(sizing.verdict)
    return (place, power, share) if place < 2 else (place, share, power)


def _static(
    robot: Manipulator, found: InverseDynamics | TaskForces
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the largest static forces (3,), when, least and largest moved masses (2, 3), last holding."""
    times, forces, masses = [], [], []
    for parameters, motion in _loaded(robot, found):
        rows = np.linspace(0, len(motion) - 1, min(len(motion), _POSES)).round().astype(int)
        poses = motion.pose[np.unique(rows)]
        machine = Manipulator(replace(parameters, friction=Friction()))
        still = np.zeros_like(poses)
        when = motion.time[np.unique(rows)]
        when[0] = np.nextafter(when[0], np.inf)  # of this piece, not of the one before it
        times.append(when)
        forces.append(machine.forces(poses, still, still, method="compiled"))
        jacobian = np.linalg.inv(machine.jacobian(poses))
        moved = np.swapaxes(jacobian, 1, 2) @ machine.mass_matrix(poses) @ jacobian
        masses.append(np.diagonal(moved, axis1=1, axis2=2) - parameters.actuators.rotors)
    held, moved = np.concatenate(forces), np.concatenate(masses)
    most = np.abs(held).argmax(axis=0)
    return (
        np.abs(held)[most, np.arange(3)],
        np.concatenate(times)[most],
        np.array([moved.min(axis=0), moved.max(axis=0)]),
        held[-1],
    )


def _loaded(robot: Manipulator, found: InverseDynamics | TaskForces) -> list[tuple[Parameters, Motion]]:
    """Return the machine with what it carries, and how it moves with it, piece by piece."""
    if isinstance(found, InverseDynamics):
        return [(robot.parameters, found.motion)]
    pieces = found.plan.pieces
    return [
        (machine.parameters, piece.motion)
        for machine, piece in zip(machines_of(robot, found.plan), pieces, strict=True)
    ]
