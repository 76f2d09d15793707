"""Work of any size, cut into blocks: computed anywhere, stored whole, resumed after anything.

`sweep` computes a `Problem` block by block into a folder, in this process, in processes beside it or on a
cluster; `Sweep.load` reads what is there. What is found of all items (`TopK`, `ParetoArchive`, `Histogram`,
`Moments`) needs no item to be stored. Nothing here knows a machine: `p3dof.design.sweeps` has problems of
machines.
"""

from p3dof._base.blocks.best import ParetoArchive, TopK, nondominated
from p3dof._base.blocks.crew import Processes
from p3dof._base.blocks.distributions import Distribution, LogUniform, Normal, Uniform
from p3dof._base.blocks.manifest import REDUCTIONS, Manifest
from p3dof._base.blocks.problem import Block, FunctionProblem, Problem, Sampling, digest
from p3dof._base.blocks.reduction import Reduction, Rows, RowsReduction
from p3dof._base.blocks.results import Sweep
from p3dof._base.blocks.running import SweepInterrupted, sweep
from p3dof._base.blocks.sampling import Grid, Samples
from p3dof._base.blocks.statistics import ColumnMoments, Counts, Histogram, Moments
from p3dof._base.blocks.tables import sweep_facts, sweep_tables

__all__ = [
    "REDUCTIONS",
    "Block",
    "ColumnMoments",
    "Counts",
    "Distribution",
    "FunctionProblem",
    "Grid",
    "Histogram",
    "LogUniform",
    "Manifest",
    "Moments",
    "Normal",
    "ParetoArchive",
    "Problem",
    "Processes",
    "Reduction",
    "Rows",
    "RowsReduction",
    "Samples",
    "Sampling",
    "Sweep",
    "SweepInterrupted",
    "TopK",
    "Uniform",
    "digest",
    "nondominated",
    "sweep",
    "sweep_facts",
    "sweep_tables",
]
