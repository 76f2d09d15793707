"""Work of any size, cut into blocks: computed anywhere, stored whole, resumed after anything.

`sweep` computes a `Problem` block by block into a folder, in this process, in processes beside it or on a
cluster; `Sweep.load` reads what is there. What is found of all items (`TopK`, `ParetoArchive`, `Histogram`,
`Moments`) needs no item to be stored. Nothing here knows a machine: `p3dof.design.sweeps` has problems of
machines.
"""

from p3dof._base.blocks.crew import Processes
from p3dof._base.blocks.problem import Block, FunctionProblem, Problem, Sampling, digest
from p3dof._base.blocks.reduction import (
    ColumnMoments,
    Counts,
    Histogram,
    Moments,
    ParetoArchive,
    Reduction,
    Rows,
    RowsReduction,
    TopK,
    nondominated,
)
from p3dof._base.blocks.results import Sweep, sweep_facts, sweep_tables
from p3dof._base.blocks.running import SweepInterrupted, sweep
from p3dof._base.blocks.sampling import Distribution, Grid, LogUniform, Normal, Samples, Uniform
from p3dof._base.blocks.storage import REDUCTIONS, Manifest

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
