"""The program ``p3dof``, also as ``python -m p3dof``.

Hardly anything is imported before Ctrl-C is looked after: the commands take half a second to load.
"""

import atexit
import gc
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

INTERRUPTED, TERMINATED = 130, 143
"""Exit codes after Ctrl-C and after SIGTERM, as of a shell: 128 and the number of the signal."""

GARBAGE = 400_000
"""New objects after which Python looks for garbage; 700 by its own choice, a tenth of a short run's time."""


def main() -> int:
    """Load the commands, and run the one that was asked for; Ctrl-C and SIGTERM are one line at any time.

    The exit code.
    """
    gc.set_threshold(GARBAGE, 20, 20)
    watched = {  # else somebody else's, or nohup
        number: handler
        for number, handler, usual in (
            (signal.SIGINT, signal.default_int_handler, signal.default_int_handler),
            (signal.SIGTERM, _terminate, signal.SIG_DFL),
        )
        if signal.getsignal(number) is usual
    }
    atexit.register(_handle, dict.fromkeys(watched, signal.SIG_IGN))  # the last thing that is done
    sys.unraisablehook = _unraisable
    try:
        _handle(dict.fromkeys(watched, _leave))  # an exception may be lost in the import of a C extension
        from p3dof.cli import main as run

        _handle(watched)  # commands tidy up before they end
        code = run(loading=lambda: _leaving(watched))
        _handle(dict.fromkeys(watched, _leave))  # nothing is left to tidy up
    except KeyboardInterrupt:
        _leave(signal.SIGTERM if _told else signal.SIGINT)
    if code == INTERRUPTED:  # told and tidied up; after one within exec, Python would end by SIGINT
        os._exit(TERMINATED if _told else INTERRUPTED)
    return code


_told: list[int] = []
"""Whether the program was told to terminate."""


@contextmanager
def _leaving(watched: Mapping[signal.Signals, Any]) -> Iterator[None]:
    """End at once when interrupted: while a command is imported there is nothing to tidy up."""
    _handle(dict.fromkeys(watched, _leave))
    try:
        yield
    finally:
        _handle(watched)


def _handle(handlers: Mapping[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)


def _terminate(number: int, _frame: FrameType | None) -> NoReturn:
    """End as after Ctrl-C: whatever is under way is tidied up."""
    _told.append(number)
    raise KeyboardInterrupt("terminated")


def _unraisable(lost: Any) -> None:
    """Raise Ctrl-C again a moment later where nothing can be raised, as in the end of an object."""
    if not isinstance(lost.exc_value, KeyboardInterrupt) or not hasattr(signal, "setitimer"):
        sys.__unraisablehook__(lost)
        return
    words = lost.exc_value.args

    def again(*_: object) -> NoReturn:
        raise KeyboardInterrupt(*words)

    signal.signal(signal.SIGALRM, again)
    signal.setitimer(signal.ITIMER_REAL, 1e-3)


def _leave(number: int = signal.SIGINT, _frame: FrameType | None = None) -> NoReturn:
    """Say that the program was interrupted or terminated, and end it at once."""
    terminated = number == signal.SIGTERM
    with suppress(OSError):  # nobody may listen
        os.write(2, b"p3dof: error: terminated\n" if terminated else b"p3dof: error: interrupted\n")
    os._exit(TERMINATED if terminated else INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
