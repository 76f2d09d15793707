"""`tolerance`: how uncertain forces or poses are, because a machine is never what its drawing says."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.blocks.problem import whole
from p3dof._base.checks import Progress, positive, shown
from p3dof._base.errors import InputError
from p3dof.analysis.designs.columns import BodiesOfDesigns
from p3dof.analysis.designs.names import QUANTITIES
from p3dof.analysis.tolerances.directions import (
    AnyMachine,
    amount_of,
    directions_of,
    fixed_of,
    parameters_of,
    require_smaller,
)
from p3dof.analysis.tolerances.draws import Draws, Spread, drawn_forces, drawn_poses, first_order_pose
from p3dof.analysis.tolerances.forces import ForceCase, first_order, require_possible
from p3dof.analysis.tolerances.pose import checked_pose, sigmas_of
from p3dof.analysis.tolerances.results import ForceTolerance, PoseTolerance, ToleranceMethod
from p3dof.machine.motion import Motion
from p3dof.machine.motion.wrenches import WrenchOverTime
from p3dof.machine.parameters import Parameters

MOST_MACHINES = 10**7


def tolerance(
    robot: AnyMachine = None,
    motion: Motion | None = None,
    pose: ArrayLike | None = None,
    *,
    sigma: Mapping[str, float | str],
    method: ToleranceMethod = "gradient",
    bodies: BodiesOfDesigns = "kept",
    fixed: Mapping[str, float | str] | None = None,
    wrench: WrenchOverTime = None,
    worst: float = 3.0,
    samples: int = 2000,
    spread: Spread = "normal",
    seed: int = 0,
    folder: str | os.PathLike[str] | None = None,
    resume: bool = False,
    client: Any = None,
    progress: Progress | None = None,
) -> ForceTolerance | PoseTolerance:
    """Return how uncertain the forces over a motion, or static poses, are.

    With `motion`, the forces: a machine is built once, with lengths and bodies that differ a little from the
    nominal ones, and makes the motion exactly. With `pose`, the pose: the sliders stand where the nominal
    machine's would, but each leg has its own R, r, L and offset of its encoder.

    Parameters
    ----------
    robot : Manipulator or Parameters, optional
        The nominal machine; the paper's by default.
    motion : Motion, optional
        Whose forces are asked.
    pose : array-like, shape (..., 3), optional
        y [m], z [m], θ [rad] whose errors are asked, instead of `motion`.
    sigma : mapping of str to float or str
        Standard deviations by names of parameters, independent of each other: numbers in SI units, with a
        unit (``"0.1 mm"``), or as a share (``"2 %"``). For forces, names are those of columns of designs
        (``R``, ``platform.mass``, ``leg.mass``, ``payload.com.x``, ``friction.viscous.sliders``): a kind of
        bodies or a group of joints moves as one, and a mass takes the body's inertia with it. For poses, they
        are ``R``, ``r``, ``L``, ``encoder``, which each leg has on its own, or those of one leg (``L.a``).
    method : {"gradient", "montecarlo"}
        First order by exact derivatives; or machines drawn at random, whose forces are computed, or whose
        closures are solved, without any such approximation.
    bodies : {"kept", "solids"}
        For forces: keep the bodies whatever the lengths are, or compute them anew from solids, whose sizes
        and density may vary then.
    fixed : mapping of str to float or str, optional
        For forces: numbers that are not those of the machine. A machine does not know the sizes of its
        solids: where they are not the paper's, scaled to its lengths, they must be told here.
    wrench : array-like or callable, optional
        External force and moment on the platform, as of `Manipulator.inverse_dynamics`.
    worst : float
        How many standard deviations all parameters are off in the worst case.
    samples : int
        Machines to draw.
    spread : {"normal", "uniform"}
        How parameters are spread about their nominal numbers, with the standard deviation `sigma`.
    seed : int
        Of the random numbers.
    folder : path-like, optional
        Where to store the machines drawn, block by block.
    resume : bool
        Go on with what is in the folder: ends in the same bits.
    client : distributed.Client or concurrent.futures.Executor, optional
        Who computes; this process by default.
    progress : callable, optional
        Called with the number of machines done and of all.

    Returns
    -------
    ForceTolerance or PoseTolerance

    Raises
    ------
    InputError
        If an argument does not fit, or the nominal machine cannot make the motion.
    ReachError, SingularityError
        If it cannot be at a pose, or not hold it.
    SweepError, FileError
        As `sweep`.

    Examples
    --------
    >>> import p3dof
    >>> motion = p3dof.paper_motion(201)
    >>> p3dof.tolerance(p3dof.PAPER, motion, sigma={"R": "0.1 mm", "platform.mass": "2 %"})
    >>> p3dof.tolerance(p3dof.PAPER, pose=[0, 0, 0], sigma={"L": "50 um", "encoder": "10 um"})
    """
    if method not in get_args(ToleranceMethod):
        raise InputError(f"method: expected 'gradient' or 'montecarlo', got {shown(method)}")
    if (motion is None) == (pose is None):
        raise InputError("expected a motion, whose forces are asked, or poses, whose errors are; one of both")
    machine = parameters_of(robot)
    most = positive("worst", worst, InputError)
    whole("samples", samples, 2, MOST_MACHINES)
    draws = Draws(samples, seed, spread, folder, resume, client, progress)
    if motion is None:
        names, sizes = sigmas_of(sigma, machine.geometry)
        poses = checked_pose(machine.geometry, pose)
        linear = first_order_pose(machine.geometry, poses, names, sizes, most)
        return linear if method == "gradient" else drawn_poses(machine.geometry, linear, draws)
    if not isinstance(motion, Motion):
        raise InputError(f"motion: expected a Motion, got {shown(motion)}")
    case = _force_case(machine, motion, sigma, bodies, fixed, wrench, most)
    require_possible(case)
    return first_order(case) if method == "gradient" else drawn_forces(case, draws)


def _force_case(
    machine: Parameters,
    motion: Motion,
    sigma: Mapping[str, Any],
    bodies: BodiesOfDesigns,
    fixed: Mapping[str, Any] | None,
    wrench: WrenchOverTime,
    worst: float,
) -> ForceCase:
    if bodies not in get_args(BodiesOfDesigns):
        raise InputError(f"bodies: expected 'kept' or 'solids', got {shown(bodies)}")
    numbers = fixed_of(fixed, bodies)
    directions, values = directions_of(sigma, "sigma", machine, bodies, numbers)
    pairs = zip(directions, values, strict=True)
    sizes = [
        amount_of(value, direction.nominal, QUANTITIES[direction.name], f"sigma of {direction.name}")
        for direction, value in pairs
    ]
    for direction, size in zip(directions, sizes, strict=True):
        if direction.name.startswith("geometry.") or direction.name.endswith(".mass"):
            require_smaller(size, direction.nominal, direction.unit, f"sigma of {direction.name}")
    return ForceCase(machine, motion, directions, np.array(sizes), bodies, wrench, worst, numbers)
