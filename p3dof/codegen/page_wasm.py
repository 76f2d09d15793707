"""The WebAssembly of the page in the browser: few functions, small, for any machine."""

from __future__ import annotations

from pathlib import Path

from p3dof.codegen.controller import controller_files, origin_of
from p3dof.codegen.naming import PREFIX
from p3dof.codegen.wasm_files import WebFiles
from p3dof.codegen.web_controller import controller_module
from p3dof.machine.parameters import PAPER

DIRECTORY = Path(__file__).parents[1] / "viewer" / "document"
FUNCTIONS = (
    "inverse_dynamics",
    "inverse_kinematics",
    "jacobian",
    "mass_matrix",
    "forward_dynamics",
    "forward_kinematics",
    "joints",
)
"""What the page calls on samples, besides the map."""
_COMMAND = "p3dof codegen --page"


def page_wasm() -> tuple[WebFiles, dict[str, str]]:
    """Return the WebAssembly of the page, and the C that it is built from.

    Returns
    -------
    WebFiles
        To be written into `DIRECTORY`, or compared with what is there.
    dict of str to str
        Text by file name.
    """
    note = origin_of(PAPER, command=_COMMAND)
    module = controller_module(note=note, only=FUNCTIONS, optimisation="-Oz")
    texts = controller_files(PAPER, command=_COMMAND)
    return WebFiles(module), {name: texts[name] for name in (f"{PREFIX}.h", f"{PREFIX}.c")}
