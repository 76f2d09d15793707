"""The command line: `p3dof compare`, `forces`, `urdf`, `export`.

Exit codes: 0 done, 1 a check failed (methods disagree, files differ), 2 bad input (one line on stderr).
"""

from p3dof.cli.commands import app, main

__all__ = ["app", "main"]
