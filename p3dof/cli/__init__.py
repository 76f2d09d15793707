"""The command line: `p3dof compare`, `forces`, `energy`, `reactions`, `simulate`, `urdf`, `export`.

Each command calls the package and prints.

Exit codes: 0 done, 1 a check failed (methods disagree, files differ, a run ended early), 2 bad
input (one line on stderr).
"""

from p3dof.cli import compare, energy, export, forces, reactions, simulate  # noqa: F401 - they add their commands
from p3dof.cli.app import app, main

__all__ = ["app", "main"]
