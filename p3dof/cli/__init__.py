"""The command line: `p3dof compare`, `forces`, `show`, `report`, `simulate` and others.

Each command is a module that calls the package and prints; it is imported when it is asked for.

Exit codes: 0 done; 1 a check failed (methods disagree, files differ, a run ended early); 2 bad input (one
line on stderr); 130 interrupted by Ctrl-C (likewise); 141 the reader of a pipe left before the end (nothing
is said), as for any program in a shell.
"""

from p3dof.cli.app import app, main

__all__ = ["app", "main"]
