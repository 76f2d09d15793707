"""Motions of the actuated joints of any robot: CSV text in.

The header is ``t`` and the names of the joints, in any order; a unit in brackets may follow each, as in
``crank [deg]``; without one the column is in s, m or rad. Blank lines and lines that begin with ``#`` are
skipped.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p3dof.checks import FloatArray
from p3dof.errors import MotionError
from p3dof.motion.csv_files import ANGLES, LENGTHS, Form, header_of, parse
from p3dof.motion.splines import derivatives


def read_joints(
    text: str, source: str, joints: Sequence[str], sliding: Sequence[bool]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Read the motion of some joints from CSV text.

    Velocities and accelerations are those of the spline of degree 7 through the values.

    Parameters
    ----------
    text : str
        The file's text.
    source : str
        What to call it in an error: usually the file name.
    joints : sequence of str
        The joints that must be there.
    sliding : sequence of bool
        Which of their values are lengths.

    Returns
    -------
    time : (N,) array
        Times [s].
    values, velocities, accelerations : (N, n) array
        Of the joints, in the order of `joints` [m or rad].

    Raises
    ------
    MotionError
        On the first thing that does not fit; the message names `source`, line and column.
    """
    given = header_of(text, source)
    if sorted(given[1:]) == sorted(joints) and given[:1] == ["t"]:
        order = [list(given[1:]).index(name) for name in joints]
        named = given
    else:  # the error is that of a file in the robot's own order
        order, named = list(range(len(joints))), ["t", *joints]
    kinds = dict(zip(joints, sliding, strict=True))
    units = {name: LENGTHS if kinds[name] else ANGLES for name in named[1:]}
    form = Form("a motion of joints", tuple(named), (len(named),), units)
    time, values = parse(text, source, form)
    values = np.ascontiguousarray(values[:, order])
    if len(time) == 1:
        nothing = np.zeros_like(values)
        return time, values, nothing, nothing
    velocities, accelerations = derivatives(time, values, 2)
    for name, array in (("velocity", velocities), ("acceleration", accelerations)):
        if not np.isfinite(array).all():
            raise MotionError(f"{source}: the values are too large or too near in time: no finite {name}")
    return time, values, velocities, accelerations
