"""Work of any size, cut into blocks: computed anywhere, stored whole, resumed after anything.

`sweep` computes a `Problem` block by block into a folder, in this process, in processes beside it or on a
cluster; `Sweep.load` reads what is there. What is found of all items (`TopK`, `ParetoArchive`, `Histogram`,
`Moments`) needs no item to be stored. Nothing here knows a machine: `p3dof.sweeps` has problems of machines.
"""

from p3dof.blocks.best import ParetoArchive, TopK, nondominated
from p3dof.blocks.crew import Processes
from p3dof.blocks.distributions import Distribution, LogUniform, Normal, Uniform
from p3dof.blocks.manifest import REDUCTIONS, Manifest
from p3dof.blocks.problem import Block, FunctionProblem, Problem, Sampling, digest
from p3dof.blocks.reduction import Reduction, Rows, RowsReduction
from p3dof.blocks.results import Sweep
from p3dof.blocks.running import SweepInterrupted, sweep
from p3dof.blocks.sampling import Grid, Samples
from p3dof.blocks.statistics import ColumnMoments, Counts, Histogram, Moments
from p3dof.blocks.tables import sweep_facts, sweep_tables

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
