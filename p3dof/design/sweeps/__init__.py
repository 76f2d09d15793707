"""Sweeps over machines: problems for `p3dof.sweep`, and the files that describe them.

- `designs`: `DesignSweep`, the forces of machines over one motion;
- `runs`: `RunSweep`, simulations;
- `rows`: inputs from a file of designs;
- `problem_file`: a sweep as a YAML file, as the command line takes it.
"""

from p3dof.design.sweeps.designs import DesignSweep, RunSweep
from p3dof.design.sweeps.problem_file import FileRows, SweepPlan, read_sweep

__all__ = ["DesignSweep", "FileRows", "RunSweep", "SweepPlan", "read_sweep"]
