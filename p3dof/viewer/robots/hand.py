"""`Hand`: a robot whose actuated joints are moved by hand, its loops closed at each change."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiled.settling import Settler
from p3dof.loops.compiling_model import Method, method_of
from p3dof.viewer.document.robots.ranges import values_of

_OPEN = 1e-9
"""Loops that are less open than this count as closed [m or rad]."""
_SAME = 1e-12
"""Values nearer than this are the same [m or rad]."""

_ANOTHER = "the loops close there in another assembly, beyond a singular configuration"


class Hand:
    """A robot that is moved by hand, from where it is.

    Where there are more actuators than the robot has freedoms, only the joint that is moved is prescribed;
    the others follow.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot.
    q : ndarray, shape (nq,)
        Where it is.
    compiled : CompiledLoop, optional
        The same robot compiled, whose steps it takes where they lead there.

    Attributes
    ----------
    q : ndarray, shape (nq,)
        Where it is.
    home : ndarray, shape (nq,)
        Where it was at first.
    refused : str
        Why it is not where it was to go; empty if it is.
    """

    def __init__(self, robot: ClosedLoopModel, q: FloatArray, compiled: CompiledLoop | None = None) -> None:
        self._robot = robot
        self._settler = Settler(compiled) if compiled is not None and compiled.determined else None
        self._redundant = len(robot.actuated) > robot.mobility(q)
        self._asked: FloatArray = np.zeros(0)
        self._values: FloatArray = self._asked
        self.home = q
        self.follow(q)

    @property
    def values(self) -> FloatArray:
        """The values of the actuated joints where it is, shape (n,) [m or rad]."""
        return self._values

    def follow(self, q: FloatArray) -> None:
        """Be somewhere else, which something else has chosen."""
        self.q: FloatArray = q
        self.refused = ""
        self._values = self._asked = values_of(self._robot, q)

    def go_home(self) -> None:
        """Be where it was at first."""
        self.follow(self.home)

    def moves_to(self, values: FloatArray) -> bool:
        """Move the actuated joints to values (n,); return whether the robot is there."""
        if np.array_equal(values, self._asked):
            return not self.refused
        self._asked = values
        if self._settler is not None:
            settled = self._settler(self._closed(), values[None])
            if settled.good[0]:
                self.refused, self.q = "", settled.q[0]
                self._values = values_of(self._robot, self.q)
                return True
        try:
            found = self._robot.assemble(self._target(values), self._closed())
        except AssemblyError as error:
            self.refused = str(error)
            return False
        self.refused = "" if found.same_assembly else _ANOTHER
        if not self.refused:
            self.q = found.q
            self._values = values_of(self._robot, found.q)
        return not self.refused

    def _closed(self) -> FloatArray:
        """Return where it is, with closed loops: between the samples of a motion they are a little open."""
        is_open = np.abs(self._robot.closure_error(self.q)).max(initial=0.0) > _OPEN
        return self._robot.assemble(None, self.q).q if is_open else self.q

    def _target(self, values: FloatArray) -> FloatArray | dict[str, float]:
        if not self._redundant:
            return values
        moved = np.abs(values - self._values) > _SAME
        each = zip(self._robot.actuated, values.tolist(), moved, strict=True)
        return {name: value for name, value, changed in each if changed}


def compiled_of(
    robot: ClosedLoopModel, q: FloatArray, frames: Iterable[str], method: Method
) -> CompiledLoop | None:
    """Return what computes a robot that is moved by hand; None for the robot, also without a C compiler.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot.
    q : ndarray, shape (nq,)
        Where it is.
    frames : iterable of str
        Where wrenches act.
    method : {"general", "compiled"} or CompiledLoop
        Which is meant.

    Raises
    ------
    InputError
        If there is no such method, or it was compiled for another robot.
    ModelError
        If the robot cannot be compiled.
    """
    found = method_of(robot, method, tuple(frames))
    if found is None or isinstance(found, CompiledLoop):
        return found
    is_open = np.abs(robot.closure_error(q)).max(initial=0.0) > _OPEN
    compiled = found(robot, robot.assemble(None, q).q if is_open else q, frames)
    return None if compiled.level == "numpy" else compiled
