"""Group states of an SRDF, as reference configurations."""

from __future__ import annotations

import math
import os
from collections.abc import Collection
from typing import Any

from p3dof._base.checks import shown
from p3dof._base.errors import ModelError
from p3dof.loops.sidecar import suggestion
from p3dof.loops.xml_text import XmlReader, read_xml


def state_of(source: str | os.PathLike[str], state: str | None, joints: Collection[str]) -> dict[str, Any]:
    """Return the values [m or rad] of the model's joints in a group state, as `p3dof.Sidecar.reference`."""
    text, name = read_xml(source, "SRDF")
    robot = XmlReader(name).parse(text)
    states = list(robot.iterfind("group_state"))
    names = [element.get("name", "") for element in states]
    if not names:
        raise ModelError(f"{name}: it has no group state")
    wanted = names[0] if state is None else state
    if wanted not in names:
        raise ModelError(
            f"{name}: the group state {shown(wanted)} does not exist; {suggestion(wanted, names)}"
        )
    values: dict[str, Any] = {}
    for element in states:
        for joint in element.iterfind("joint") if element.get("name") == wanted else ():
            called = joint.get("name", "")
            if called not in joints:
                if state is None:
                    continue  # of another robot of the same file
                raise ModelError(
                    f"{name}: group state {shown(wanted)}: the joint {shown(called)} does not exist; "
                    f"{suggestion(called, joints)}"
                )
            numbers = [_number(word) for word in joint.get("value", "").split()]
            if not numbers or not all(map(math.isfinite, numbers)):
                raise ModelError(
                    f"{name}: group state {shown(wanted)}, joint {shown(called)}: expected numbers, got "
                    f"{shown(joint.get('value'))}"
                )
            values[called] = numbers[0] if len(numbers) == 1 else tuple(numbers)
    return values


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan
