"""Many designs at once: columns of machines in, figures of their forces over one motion out.

- `names`, `columns`: what columns mean; `Designs`, which are machines by columns.
- `status`: which of them could be built, and the reasons.
- `folding`: columns to the few numbers of the dynamics, traced, with derivatives.
- `samples`: the motion with the weights of its means and integrals.
- `figures`, `formula`, `gradients`: what is computed, on NumPy, and its derivatives.
- `evaluation`, `sweep`: all of it over blocks of designs, compiled where it can be; `results`.
- `files`, `stream`: tables of any length; `clients`: workers elsewhere.
"""

from p3dof.analysis.designs.columns import Designs
from p3dof.analysis.designs.evaluation import DesignEvaluation, forces_of_designs
from p3dof.analysis.designs.results import DesignForces, DesignStatus

__all__ = ["DesignEvaluation", "DesignForces", "DesignStatus", "Designs", "forces_of_designs"]
