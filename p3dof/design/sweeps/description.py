"""What results depend on, as plain data: settings of a sweep from the objects that users give."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any

import numpy as np

from p3dof._base.blocks import digest
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Parameters

_SHORT = 16
"""Longest array that is told number by number."""

_DEEPEST = 8


def described(value: Any) -> Any:
    """Return plain data that differ where an object differs: its class and its attributes, arrays as hashes.

    Parameters
    ----------
    value : object
        Numbers, texts, arrays, machines, motions, functions (by name), and objects made of these.

    Returns
    -------
    object
        For JSON. What is not made of these counts by its class alone.
    """
    return _described(value, 0)


def _described(value: Any, depth: int) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value) if isinstance(value, float) and not np.isfinite(value) else value
    for kinds, tell in _KNOWN.items():
        if isinstance(value, kinds):
            return tell(value)
    kind = type(value)
    if depth > _DEEPEST:
        return kind.__qualname__
    if isinstance(value, list | tuple):
        return [_described(item, depth + 1) for item in value]
    parts = value if isinstance(value, Mapping) else getattr(value, "__dict__", {})
    found = {str(name): _described(item, depth + 1) for name, item in parts.items()}
    return (
        found if isinstance(value, Mapping) else {"kind": f"{kind.__module__}.{kind.__qualname__}", **found}
    )


def _of_array(value: Any) -> Any:
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        return [_described(item, _DEEPEST) for item in array.ravel().tolist()]
    if array.size <= _SHORT and np.isfinite(array).all():
        return array.tolist()
    return {"shape": list(array.shape), "sha256": digest(array)}


def _of_machine(machine: Parameters) -> dict[str, str]:
    text = json.dumps(machine.to_dict(), sort_keys=True)
    return {"kind": "Parameters", "sha256": hashlib.sha256(text.encode()).hexdigest()}


def _of_function(function: Any) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def motion_settings(motion: Motion) -> dict[str, Any]:
    """Return what tells a motion from others."""
    return {
        "samples": len(motion),
        "from": float(motion.time[0]),
        "to": float(motion.time[-1]),
        "sha256": digest(motion.time, motion.pose, motion.velocity, motion.acceleration),
    }


_KNOWN: dict[tuple[type, ...], Callable[[Any], Any]] = {
    (np.ndarray, np.generic): _of_array,
    (Parameters,): _of_machine,
    (Motion,): motion_settings,
    (FunctionType, BuiltinFunctionType, MethodType): _of_function,
}
"""What is told in another way than by its attributes."""
