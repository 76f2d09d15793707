"""What the WebAssembly of a robot with closed loops offers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from p3dof.codegen.filling import fill
from p3dof.codegen.webassembly import Exported, Rows, WebModule

_STATUSES = ("OK", "NULL_POINTER", "NOT_FINITE", "SINGULAR", "OPEN", "INCONSISTENT", "BEYOND_LIMITS")
_METHODS = """
    /** Begins to follow a motion about at a configuration, whose loops it closes; returns a status. */
    start(q) {
        return this.#exports.start(this.#put(q));
    }
"""


def loop_module(
    prefix: str,
    note: str,
    calls: Mapping[str, tuple[Sequence[Rows], Sequence[Rows]]],
    follow: tuple[int, int, int, Sequence[Rows]] | None,
) -> WebModule:
    """Return what the WebAssembly of a robot's C offers.

    Parameters
    ----------
    prefix : str
        What the names of the C begin with.
    note : str
        What its files begin with.
    calls : mapping of str to pair of sequences of Rows
        Inputs and outputs of the functions, by name.
    follow : tuple, optional
        Motors, size of a configuration, size of a velocity, and loads, where a motion can be followed.

    Returns
    -------
    WebModule
    """
    functions = [Exported(name, *groups) for name, groups in calls.items()]
    state = methods = ""
    if follow is not None:
        motors, nq, nv, loads = follow
        inputs = [Rows("dt", 1, "*"), *(Rows(n, motors) for n in ("target", "velocity", "acceleration"))]
        kept = [Rows(n, size, kept=f"state.{n}") for n, size in (("q", nq), ("v", nv), ("a", nv))]
        outputs = [Rows("tau", motors), evidence(prefix), *kept]
        functions.append(Exported("follow", [*inputs, *loads], outputs, "&state"))
        state, methods = fill("wasm_state.in", prefix=prefix), _METHODS
    return WebModule(prefix, note, functions, dict(enumerate(_STATUSES)), state, methods)


def evidence(prefix: str) -> Rows:
    """Return margin and gap as rows.

    Parameters
    ----------
    prefix : str
        What the names of the C begin with.

    Returns
    -------
    Rows
    """
    return Rows("evidence", 2, f"({prefix}_evidence *)")
