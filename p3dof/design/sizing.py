"""Which drives fit a machine for what it has to do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from heapq import heappop, heappush

import numpy as np

from p3dof._base.checks import FloatArray, Progress, require, shown
from p3dof._base.errors import DriveError, InputError
from p3dof.design.drives import (
    VERDICTS,
    Ambient,
    AxisLoads,
    Catalogue,
    Drive,
    Margins,
    RequiredLife,
    Sizing,
    StopLoads,
    StopRamp,
    Supply,
    cycle_of,
    required_life,
    size_of,
    with_supply,
)
from p3dof.design.drives.sizing import BRAKE_SAFETY, with_others
from p3dof.design.drives.stopping import Instants, controlled_stops, uncontrolled_stops
from p3dof.design.forces_of_tasks import TaskForces, machines_of, with_guide_friction
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LEGS, Friction, Parameters
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
    supply: Supply | None = None,
    per_axis: bool = False,
    life: RequiredLife | str | None = None,
    frictionless: bool = False,
    progress: Progress | None = None,
) -> list[Sizing]:
    """Return what a motion or a task takes of drives, the best first.

    Each drive is tried on all three axes. Those that fit with their margins come first, the weakest motor
    first, by rated torque times rated speed; among equal motors that whose ratings are used least. Then
    those that fit without reserve, then those that do not fit, by the rating that they exceed most.

    With `per_axis`, or of a catalogue with `axes`, each axis may have another drive. Axes are independent but
    for their supply: combinations of the drives that fit alone are tried by the sum of rated powers, the
    smallest first, until `COMBINATIONS` fit (or eight times as many were tried); of an axis that none fits,
    the drive that comes nearest stays.

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
    supply : Supply, optional
        What feeds the amplifiers; that of the catalogue without it.
    per_axis : bool
        Whether the axes may have different drives.
    life : RequiredLife or str, optional
        What ball nuts have to live, such as ``"20000 h"``; that of the catalogue without it.
    frictionless : bool
        Leave the forces as they are; else, where neither machine nor forces have any friction, they get that
        which is usual of guides: 3.5 N of seals and .003 of its load for each carriage.
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
    needed = required_life(life if life is not None else getattr(drives, "life", None))
    chosen = [drives] if isinstance(drives, Drive) else list(drives)
    if not chosen:
        raise DriveError("drives: expected at least one, got none")
    source = supply
    of_axes = [chosen] * 3
    if isinstance(drives, Catalogue):
        source = drives.supply if supply is None else supply
        names = [{drive.name for drive in drives.of_axis(leg)} for leg in LEGS]
        of_axes = [[drive for drive in chosen if drive.name in allowed] for allowed in names]
        per_axis = per_axis or bool(drives.axes)
    cycle_of(found, rest)  # says at once that the machine cannot make it
    cycle = cycle_of(found if frictionless else with_guide_friction(robot, found), rest)
    held, when, mass, last = static_loads(robot, found)
    cycle = replace(cycle, holding=last)

    def sized(parts: Drive | Sequence[Drive]) -> Sizing:
        sizing = size_of(
            cycle,
            parts,
            held=held,
            held_time=when,
            load_mass=mass,
            brake_safety=brake_safety,
            margins=margins,
            ambient=ambient,
            life=needed,
        )
        return sizing if source is None else with_supply(sizing, cycle, source)

    sizings = []
    for done, drive in enumerate(chosen, 1):
        if not isinstance(drive, Drive):
            raise DriveError(f"drives: expected Drive objects, got {shown(drive)}")
        sizings.append(sized(drive))
        if progress is not None:
            progress(done, len(chosen))
    if per_axis:
        alone = {id(one.drives[0]): one.axes for one in sizings}
        loads = [[alone[id(drive)][k] for drive in part] for k, part in enumerate(of_axes)]
        sizings = _combined(of_axes, loads, sized)
    return sorted(sizings, key=_rank)


STOPPED = 10
"""How many drives are tried in emergency stops, until one fits."""
COMBINATIONS = 50
"""How many combinations of different drives are looked for that fit."""


def _combined(
    drives: Sequence[Sequence[Drive]],
    loads: Sequence[Sequence[AxisLoads]],
    sized: Callable[[Sequence[Drive]], Sizing],
) -> list[Sizing]:
    """Return combinations of drives of A, B and C, the least sum of rated powers first.

    Each axis is ranked alone. The next drive of an axis has a larger power or, at the same, uses more of a
    rating: no combination comes before those that it follows from, and a queue gives them in order.
    """
    ranked = []
    for part, axes in zip(drives, loads, strict=True):
        each = [
            (one.worst.share, _power(drive), k) for k, (drive, one) in enumerate(zip(part, axes, strict=True))
        ]
        fitting = sorted((power, share, k) for share, power, k in each if axes[k].fits)
        share, power, k = min(each)
        ranked.append([(p, s, part[k]) for p, s, k in fitting] or [(power, share, part[k])])

    def key(place: tuple[int, ...]) -> tuple[float, float, tuple[int, ...]]:
        chosen = [axis[k] for axis, k in zip(ranked, place, strict=True)]
        return sum(one[0] for one in chosen), max(one[1] for one in chosen), place

    start: tuple[int, ...] = (0, 0, 0)
    found: list[Sizing] = []
    queue, seen, fit = [key(start)], {start}, 0
    while queue and fit < COMBINATIONS and len(found) < 8 * COMBINATIONS:
        *_, place = heappop(queue)
        found.append(sized([axis[k][2] for axis, k in zip(ranked, place, strict=True)]))
        fit += found[-1].fits
        for leg in range(3):
            following = tuple(k + (j == leg) for j, k in enumerate(place))
            if following[leg] < len(ranked[leg]) and following not in seen:
                seen.add(following)
                heappush(queue, key(following))
    return found


def _power(drive: Drive) -> float:
    return drive.motor.rated_torque * float(drive.motor.rated_speed or 0.0)


def _rank(sizing: Sizing) -> tuple[float, ...]:
    power = sum(map(_power, sizing.drives))
    share = sizing.worst[1].share
    place = VERDICTS.index(sizing.verdict)
    return (place, power, share) if place < 2 else (place, share, power)


def emergency_stops(
    robot: Manipulator,
    found: InverseDynamics | TaskForces,
    drives: Drive | Sequence[Drive],
    ramp: StopRamp | None = None,
    *,
    instants: int = 200,
) -> tuple[StopLoads, ...]:
    """Return the worst emergency stops of a motion or a task: by the drives on a ramp, and by brakes alone.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    found : InverseDynamics or TaskForces
        Its forces over a motion or a task.
    drives : Drive or sequence of Drive
        One for all axes, or those of A, B and C.
    ramp : StopRamp, optional
        How the drives stop; without it only the stops by brakes are worked out.
    instants : int
        From how many instants, at least one of each piece of the task; more than half of the samples are all.

    Raises
    ------
    DriveError
        If the motion is not possible, or an argument does not fit.
    InputError
        If `robot` or `found` is something else.
    """
    require("robot", robot, Manipulator)
    if not isinstance(found, InverseDynamics | TaskForces):
        raise InputError(f"found: expected forces over a motion or a task, got {shown(found)}")
    if not isinstance(ramp, StopRamp | None):
        raise DriveError(f"ramp: expected a StopRamp, got {shown(ramp)}")
    chosen = (drives,) * 3 if isinstance(drives, Drive) else drives
    if (
        not isinstance(chosen, Sequence)
        or len(chosen) != 3
        or not all(isinstance(drive, Drive) for drive in chosen)
    ):
        raise DriveError("drives: expected one Drive, or those of A, B and C")
    if isinstance(instants, bool) or not isinstance(instants, int) or instants < 1:
        raise DriveError(f"instants: expected a whole number from 1, got {shown(instants)}")
    cycle_of(found)  # says at once that the machine cannot make it
    loads = (
        [found.wrench] if isinstance(found, InverseDynamics) else [one.wrench for one in found.plan.pieces]
    )
    every = max(sum(len(motion) for _, motion in _loaded(robot, found)) // instants, 1)
    pieces = []
    for (parameters, motion), load in zip(_loaded(robot, found), loads, strict=True):
        rows = np.unique(np.append(np.arange(0, len(motion), every), len(motion) - 1))
        wrench = np.broadcast_to(load, (len(motion), 6))[rows]
        state = motion.pose[rows], motion.velocity[rows], motion.acceleration[rows]
        pieces.append(Instants(parameters, motion.time[rows], *state, wrench))
    braked = uncontrolled_stops(pieces, chosen)
    return (braked,) if ramp is None else (controlled_stops(pieces, chosen, ramp), braked)


def stopped_safely(
    robot: Manipulator,
    found: InverseDynamics | TaskForces,
    ranked: Sequence[Sizing],
    ramp: StopRamp | None = None,
) -> tuple[list[Sizing], tuple[StopLoads, ...]]:
    """Return ranked drives, first the best that also fits in emergency stops, and its stops.

    Of the drives that fit, the best are tried in their order, `STOPPED` at most; each that was tried has the
    ratings of its stops among its `others`.
    """
    left, stops = list(ranked), {}
    for k, sizing in enumerate(left[:STOPPED]):
        if k and not sizing.fits:
            break
        stops[k] = emergency_stops(robot, found, sizing.drives, ramp)
        left[k] = with_others(sizing, (one for stop in stops[k] for one in stop.ratings))
        if left[k].fits:
            break
    order = sorted(range(len(left)), key=lambda k: (k not in stops, _rank(left[k])))
    return [left[k] for k in order], stops[order[0]]


def static_loads(
    robot: Manipulator, found: InverseDynamics | TaskForces
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the largest static forces (3,), when, least and largest moved masses (2, 3), last holding."""
    times, forces, masses = [], [], []
    for piece, (parameters, motion) in enumerate(_loaded(robot, found)):
        rows = np.linspace(0, len(motion) - 1, min(len(motion), _POSES)).round().astype(int)
        poses = motion.pose[np.unique(rows)]
        machine = Manipulator(replace(parameters, friction=Friction()))
        still = np.zeros_like(poses)
        when = motion.time[np.unique(rows)]
        if piece:
            when[0] = np.nextafter(when[0], np.inf)  # of this piece, not of the one before it
        times.append(when)
        forces.append(machine.forces(poses, still, still, method="compiled"))
        jacobian = np.linalg.inv(machine.jacobian(poses, method="compiled"))
        moved = np.swapaxes(jacobian, 1, 2) @ machine.mass_matrix(poses, method="compiled") @ jacobian
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
