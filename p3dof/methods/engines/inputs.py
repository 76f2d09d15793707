"""Checks of what users give to all engines, and the engines' libraries."""

from __future__ import annotations

import importlib
from typing import Any

from p3dof._base.checks import positive
from p3dof._base.errors import InputError, MissingExtraError
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Parameters


def step_count(duration: float, step: float) -> int:
    """Return how many steps a duration has.

    Parameters
    ----------
    duration, step : float
        Positive [s].

    Returns
    -------
    int

    Raises
    ------
    InputError
        If one is not positive, or the steps do not fill the duration.
    """
    duration, step = positive("duration", duration, InputError), positive("step", step, InputError)
    count = round(duration / step)
    if count < 1 or abs(count * step - duration) > 1e-6 * step:
        raise InputError(f"step: expected one that divides the duration of {duration:g} s, got {step:g} s")
    return count


def check_machine(parameters: object) -> None:
    """Raise unless an engine can model a machine.

    Parameters
    ----------
    parameters : object
        What the user gave.

    Raises
    ------
    InputError
        If `parameters` is not a `Parameters`, or the machine has friction.
    """
    if not isinstance(parameters, Parameters):
        raise InputError(f"parameters: expected Parameters, got {type(parameters).__name__}")
    if parameters.friction:
        raise InputError(
            "parameters: expected a machine without friction, got some in "
            f"{', '.join(parameters.friction.joints)} (the engines model none)"
        )


def check_motion(motion: object) -> None:
    """Raise unless something is a motion.

    Parameters
    ----------
    motion : object
        What the user gave.

    Raises
    ------
    InputError
        If `motion` is not a `Motion`.
    """
    if not isinstance(motion, Motion):
        raise InputError(f"motion: expected a Motion, got {type(motion).__name__}")


def library(module: str, engine: str) -> Any:
    """Return a module of an optional library.

    Parameters
    ----------
    module : str
        Its name.
    engine : str
        Which engine needs it.

    Returns
    -------
    module

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"the engine {engine} needs its library: pip install 'p3dof[engines]'"
        ) from error
