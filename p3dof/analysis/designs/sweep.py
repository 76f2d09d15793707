"""`forces_of_designs`: the forces of any number of designs over one motion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from p3dof._base.checks import Progress
from p3dof.analysis.designs.clients import evaluate_with
from p3dof.analysis.designs.columns import BodiesOfDesigns, Designs
from p3dof.analysis.designs.evaluation import DesignEvaluation
from p3dof.analysis.designs.figures import FigureGroup
from p3dof.analysis.designs.results import DesignForces
from p3dof.machine.motion import Motion
from p3dof.machine.motion.wrenches import WrenchOverTime
from p3dof.machine.parameters import Parameters


def forces_of_designs(
    designs: Any,
    motion: Motion,
    machine: Parameters | None = None,
    *,
    bodies: BodiesOfDesigns = "kept",
    wrench: WrenchOverTime = None,
    figures: Iterable[FigureGroup] = ("singularity",),
    gradients: Iterable[str] = (),
    level: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    client: Any = None,
) -> DesignForces:
    """Return peaks, means and least margins of the forces of many designs over one motion.

    A design that cannot make the motion has NaN and a `DesignStatus` that says why; the others do not depend
    on it. The compiled loop computes about a million designs a second and thread over 200 samples.

    Parameters
    ----------
    designs : Designs, or what `Designs` takes
        Columns by name, one number a design: lengths, sizes of solids, masses, friction, payload, limits,
        the place of the motion.
    motion : Motion
        What every design does; at most 100,000 samples. Peaks are those of the samples.
    machine : Parameters, optional
        What has no column; the paper's machine by default.
    bodies : {"kept", "solids"}
        Keep the bodies of `machine`, or compute them anew from solids of each design; see `Designs`.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P, in the fixed frame [N, N m]; see
        `Manipulator.inverse_dynamics`.
    figures : iterable of {"singularity", "sliders", "power"}
        What to compute beside forces and reach: the least angle from the actuation singularity; slider
        positions, speeds and margins to limits; power, work and all of the sliders.
    gradients : iterable of str
        Columns to differentiate all figures by, exactly. The derivative of a peak is that at its sample:
        where two samples tie, it holds to one side.
    level, threads
        What to run on, as of `MachineKernels`.
    progress : callable, optional
        Called with the number of designs done and of all.
    client : distributed.Client or concurrent.futures.Executor, optional
        Who computes, in blocks of 65,536 designs and to the same bits; this process by default. Where designs
        are too many for the memory, or must survive interruptions, see `p3dof.design.sweeps`.

    Returns
    -------
    DesignForces

    Raises
    ------
    InputError
        If a column or an argument does not fit.

    Examples
    --------
    >>> import numpy as np, p3dof
    >>> found = p3dof.forces_of_designs({"R [mm]": np.linspace(240, 280, 5)}, p3dof.paper_motion(201))
    >>> found.peak_force.max(axis=1).round(1)
    """
    if not isinstance(designs, Designs):
        designs = Designs(designs, machine, bodies)
    evaluation = DesignEvaluation(motion, wrench, figures, gradients, level, threads)
    if client is not None:
        return evaluate_with(client, evaluation, designs, progress)
    return evaluation.evaluate(designs, progress)
