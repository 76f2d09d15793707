"""The program ``p3dof``, also as ``python -m p3dof``.

Hardly anything is imported before Ctrl-C is looked after: the commands take half a second to load.
"""

import gc
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import Any, NoReturn

INTERRUPTED = 130
"""Exit code after Ctrl-C, as of a shell: 128 and the number of the signal."""

UNUSED = ("trimesh", "viser")
"""What Pinocchio imports, where it is there, for a visualizer that no command uses: it takes .4 s."""

DRAWS_MESHES = ["loop", "show"]
"""The command that uses trimesh itself."""

GARBAGE = 400_000
"""New objects after which Python looks for garbage; 700 by its own choice, a tenth of a short run's time."""


def main() -> int:
    """Load the commands, and run the one that was asked for; Ctrl-C is one line at any time.

    Returns
    -------
    int
        The exit code.
    """
    _hurry()
    watched = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else somebody else's, or nohup
    try:
        if watched:
            signal.signal(signal.SIGINT, _leave)  # an exception may be lost in the import of a C extension
        from p3dof.cli import main as run

        if watched:
            signal.signal(signal.SIGINT, signal.default_int_handler)  # commands tidy up before they end
        code = run()
        if watched:
            signal.signal(signal.SIGINT, _leave)  # nothing is left to tidy up
    except KeyboardInterrupt:
        _leave()
    return code


def _hurry() -> None:
    """Leave out of this process what only costs time."""
    gc.set_threshold(GARBAGE, 20, 20)
    modules: dict[str, Any] = sys.modules
    for name in UNUSED if sys.argv[1:3] != DRAWS_MESHES else UNUSED[1:]:
        modules.setdefault(name, None)  # its import fails


def _leave(_number: int = signal.SIGINT, _frame: FrameType | None = None) -> NoReturn:
    """Say that the program was interrupted, and end it at once."""
    with suppress(OSError):  # nobody may listen
        os.write(2, b"p3dof: error: interrupted\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
