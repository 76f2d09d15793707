"""Turns formulas on scalars into straight-line code, in Python and in C, and differentiates them exactly.

The formulas of this package are written once, for anything that has ``+ - * /``. Traced with symbols, such a
formula becomes a list of scalar operations, each done once however often the formula asks for it, and
constants are computed beforehand.
"""

from p3dof._base.tracing.printing import straight_line
from p3dof._base.tracing.tape import Number, Symbol, Tape, derivatives

__all__ = ["Number", "Symbol", "Tape", "derivatives", "straight_line"]
