"""Many runs at once: a machine, a start, gains, noise and a payload for each, figures counted on the way.

- `columns`, `stops`: what differs between runs, and why one ended or could not begin.
- `plan`: what all share, for the engine in the compiled extension; `running`: blocks on threads.
- `singly`: one by one by `p3dof.runs`, for what the engine cannot do.
- `many`: `simulate_many`; `results`, `tables`, `files`.
"""

from p3dof.runs.many.columns import kind_of, read_runs, reason_of, stop_codes
from p3dof.runs.many.many import EQUAL_STEPS, simulate_many
from p3dof.runs.many.results import ManyRuns, RunHistories, failures, figures_table, stops_table

__all__ = [
    "EQUAL_STEPS",
    "ManyRuns",
    "RunHistories",
    "failures",
    "figures_table",
    "kind_of",
    "read_runs",
    "reason_of",
    "simulate_many",
    "stop_codes",
    "stops_table",
]
