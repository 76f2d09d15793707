"""`DesignProblem`: which machine would be better, and the ways to it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from p3dof._base.blocks import Reduction, Sweep, sweep
from p3dof._base.blocks.sampling import Method
from p3dof._base.checks import Progress
from p3dof.design.optimisation.evolution import GENERATIONS
from p3dof.design.optimisation.front import Front
from p3dof.design.optimisation.measure import Measure
from p3dof.design.optimisation.minimising import STARTS, Optimiser, minimise
from p3dof.design.optimisation.optimum import Optimum
from p3dof.design.optimisation.pareto import GENERATIONS as FRONT_GENERATIONS
from p3dof.design.optimisation.pareto import POINTS, POPULATION, FrontMethod, pareto
from p3dof.design.optimisation.statement import Statement
from p3dof.design.optimisation.sweeping import ProblemSweep


class DesignProblem(Statement):
    """Find machines that are better: what may change, what is to become small, what must be kept.

    Parameters
    ----------
    variables : mapping of str to pair
        Lower and upper bound of each column of designs that may change (see `Designs`): lengths, sizes of
        solids, masses, the place of the motion (``offset.y`` and so on). Numbers in SI units, or texts with
        units such as ``"80 mm"``.
    motion : Motion, optional
        What every design does; the paper's with 201 samples by default.
    objectives : str, Measure, or sequence of these
        What to make small, or large where large is good: names of `p3dof.design.optimisation.MEASURES`, or
        measures of one's own, see `p3dof.design.optimisation.FunctionMeasure`.
    constraints : mapping or sequence
        By the name of a measure, ``{"min": ...}``, ``{"max": ...}`` or both, in its SI unit; in a sequence,
        besides, `Constraint` objects and linear relations of columns such as ``"R >= r + 0.03"``, in SI
        units. A mapping may have these relations by the name ``relations``.
    box : Box, optional
        Poses that every design must reach, for measures over poses.
    machine : Parameters, optional
        What has no column, and the design to begin with; the paper's machine by default.
    bodies : {"kept", "solids"}
        Keep the bodies of `machine`, or compute them anew from solids of each design; see `Designs`.
    fixed : mapping of str to float, optional
        Columns that are the same for all designs, such as sizes of solids which would else scale with the
        lengths.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P [N, N m]; see `Manipulator.inverse_dynamics`.
    modulus : float
        Young's modulus of the rods [Pa].
    drive_stiffness : float
        Of one drive [N/m].
    level, threads
        What to run on, as of `MachineKernels`.

    Raises
    ------
    InputError
        If an argument does not fit.

    Examples
    --------
    >>> import p3dof
    >>> problem = p3dof.DesignProblem({"R": ("200 mm", "300 mm"), "L": ("350 mm", "500 mm")})
    >>> problem.gradient([0.25, 0.4])["peak_force"].round(2)
    """

    def minimise(
        self,
        objective: str | Measure | None = None,
        subject_to: Mapping[str, float] | None = None,
        *,
        method: Optimiser = "slsqp",
        starts: int = STARTS,
        generations: int = GENERATIONS,
        seed: int = 0,
        polish: bool = True,
        store: str | os.PathLike[str] | None = None,
        resume: bool = False,
        progress: Progress | None = None,
    ) -> Optimum:
        """Return the best design by one objective.

        Parameters
        ----------
        objective : str or Measure, optional
            What to make small, or large where large is good; the first objective by default.
        subject_to : mapping of str to float, optional
            The worst value that further measures may have, such as ``{"width": 0.5}`` [SI units].
        method : {"slsqp", "evolution"}
            Local optima from several starts by SLSQP with exact gradients, in epigraph form; or differential
            evolution, which needs no gradients.
        starts : int
            How many starts SLSQP has: the machine itself, and good designs of a Sobol sequence.
        generations : int
            Most generations of differential evolution.
        seed : int
            Of starts and random numbers.
        polish : bool
            Let SLSQP end what differential evolution found.
        store : path-like, optional
            Folder for what is finished, so that an interrupted optimisation can go on.
        resume : bool
            Go on with what is in the folder.
        progress : callable, optional
            Called with starts (or generations) done and all of them.

        Returns
        -------
        Optimum

        Raises
        ------
        OptimisationError
            If no design keeps all constraints: the message names them, and what is missing.
        InputError
            If an argument does not fit.
        SweepError
            If the folder holds another optimisation, or this one without `resume`.
        FileError
            If something cannot be read or written.

        Examples
        --------
        >>> import p3dof
        >>> problem = p3dof.DesignProblem({"R": (0.2, 0.3), "L": (0.35, 0.5)})
        >>> problem.minimise().design.round(3)
        """
        return minimise(
            self,
            objective,
            subject_to,
            method=method,
            starts=starts,
            generations=generations,
            seed=seed,
            polish=polish,
            store=store,
            resume=resume,
            progress=progress,
        )

    def pareto(
        self,
        objectives: Sequence[str | Measure] | None = None,
        *,
        method: FrontMethod = "epsilon",
        points: int = POINTS,
        population: int = POPULATION,
        generations: int = FRONT_GENERATIONS,
        polish: bool = True,
        seed: int = 0,
        store: str | os.PathLike[str] | None = None,
        resume: bool = False,
        progress: Progress | None = None,
    ) -> Front:
        """Return a Pareto front: designs that no other one beats in all objectives.

        Parameters
        ----------
        objectives : sequence of str or Measure, optional
            Two or more; those of the problem by default.
        method : {"epsilon", "nsga2", "nsga3"}
            The ε-constraint method, for two objectives: the first one as good as it can be for even bounds on
            the second. Or a genetic algorithm (extra ``studio``), whose designs are then polished.
        points : int
            Designs of the polished front.
        population, generations : int
            Of the genetic algorithm.
        polish : bool
            Make the first objective of its designs as good as the others allow; else take them as they are.
        seed : int
            Of all random numbers.
        store : path-like, optional
            Folder for what is finished, so that an interrupted front can go on.
        resume : bool
            Go on with what is in the folder.
        progress : callable, optional
            Called with generations, then points done and all of them.

        Returns
        -------
        Front

        Raises
        ------
        OptimisationError
            If no design keeps all constraints.
        InputError
            If an argument does not fit.
        SweepError
            If the folder holds another optimisation, or this one without `resume`.
        FileError
            If something cannot be read or written.
        MissingExtraError
            If pymoo is needed and not installed.
        """
        return pareto(
            self,
            objectives,
            method=method,
            points=points,
            population=population,
            generations=generations,
            polish=polish,
            seed=seed,
            store=store,
            resume=resume,
            progress=progress,
        )

    def sweep(
        self,
        count: int,
        store: str | os.PathLike[str],
        *,
        client: Any = None,
        sampling: Method = "sobol",
        seed: int = 0,
        resume: bool = False,
        reductions: Sequence[Reduction] | None = None,
        progress: Progress | None = None,
        **options: Any,
    ) -> Sweep:
        """Evaluate designs that fill the bounds of the variables, block by block, here or on a cluster.

        Parameters
        ----------
        count : int
            How many designs.
        store : path-like
            Folder for the blocks.
        client : distributed.Client, p3dof._base.blocks.Processes or Executor, optional
            Who computes; this process by default.
        sampling : {"sobol", "random", "latin-hypercube"}
            How designs fill the bounds.
        seed : int
            Of the sampling.
        resume : bool
            Go on with the sweep that is in the folder.
        reductions : sequence of Reduction, optional
            What to find of all designs; the Pareto front of the objectives by default.
        progress : callable, optional
            Called with designs done and all.
        **options
            Further ones of `p3dof.sweep`: workers, keep, block_size, format, shared, in_flight.

        Returns
        -------
        Sweep

        Raises
        ------
        InputError, SweepError, FileError
            As of `p3dof.sweep`.
        """
        problem = ProblemSweep(self, count, sampling)
        options["reductions"] = problem.reductions if reductions is None else tuple(reductions)
        return sweep(problem, store, client=client, seed=seed, resume=resume, progress=progress, **options)
