"""A robot whose actuated joints are moved by hand: where it is then, and the forces that hold it there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.closures import ClosureWrenches
from p3dof.loops.compiled.following import Settler
from p3dof.loops.compiled.kept import Method, method_of
from p3dof.loops.tables import joint_values
from p3dof.viewer.document.document import values_of
from p3dof.viewer.document.motion import JointMotion, held
from p3dof.viewer.document.runs import Transmitted

_OPEN = 1e-9
"""Loops that are less open than this count as closed [m or rad]."""
_SAME = 1e-12
"""Values nearer than this are the same [m or rad]."""

_ANOTHER = "the loops close there in another assembly, past a singular configuration"


class Hand:
    """A robot that is moved by hand, from where it is.

    Where there are more actuators than the robot has freedoms, only the joint that is moved is prescribed;
    the others follow.
    """

    def __init__(self, robot: ClosedLoopModel, q: FloatArray, compiled: CompiledLoop | None = None) -> None:
        self._robot = robot
        self._settler = Settler(compiled) if compiled is not None and compiled.determined else None
        self._redundant = len(robot.actuated) > robot.mobility(q)
        self._asked: FloatArray = np.zeros(0)
        self._values: FloatArray = self._asked
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
    """Return what computes a robot that is moved by hand; None for the robot, also without a C compiler."""
    found = method_of(robot, method, tuple(frames))
    if found is None or isinstance(found, CompiledLoop):
        return found
    is_open = np.abs(robot.closure_error(q)).max(initial=0.0) > _OPEN
    compiled = found(robot, robot.assemble(None, q).q if is_open else q, frames)
    return None if compiled.level == "numpy" else compiled


class RobotAnswers:
    """Answers pages that move the actuated joints of a robot: it knows nothing of where they were before.

    A question has ``q``, the configuration that a page shows, and ``inputs``, values by actuated joint [m or
    rad]; the loops are closed from there. The answer has the configuration, and the ``values`` of the curves
    and the ``loads`` of a document of this robot, by key.
    """

    def __init__(
        self,
        robot: ClosedLoopModel,
        q: FloatArray,
        external: Mapping[str, FloatArray] | None = None,
        method: Method = "general",
    ) -> None:
        self._robot = robot
        self._external = dict(external or {})
        self._compiled = compiled_of(robot, q, self._external, method)
        self._hand = Hand(robot, q, self._compiled)
        self._wrenches = ClosureWrenches(robot.model, robot.sidecar)
        model = robot.model
        self._single = [i for i in range(1, model.njoints) if model.nvs[i] == 1 and model.nqs[i] > 0]

    def __call__(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """Return the answer."""
        q = frozen_array("q", question.get("q"), (self._robot.model.nq,))
        inputs = question.get("inputs")
        if not isinstance(inputs, Mapping) or not set(inputs) <= set(self._robot.actuated):
            raise InputError(f"inputs: expected values by actuated joint, got {shown(inputs)}")
        self._hand.follow(q)
        now = dict(zip(self._robot.actuated, self._hand.values.tolist(), strict=True)) | dict(inputs)
        values = frozen_array("inputs", list(now.values()), (len(now),))
        if not self._hand.moves_to(values):
            raise AssemblyError(self._hand.refused)
        motion, why = held(self._robot, self._hand.q, self._external, self._compiled)
        transmitted = Transmitted(self._robot, motion, self._wrenches)
        return {
            "q": motion.q[0],
            "values": self._values(motion, transmitted),
            "loads": self._loads(transmitted),
            "notes": [why] if why else [],
        }

    def _values(self, motion: JointMotion, transmitted: Transmitted) -> dict[str, float | None]:
        found: dict[str, float] = {"power": 0.0}
        for name, force in zip(motion.actuated, motion.known[0].tolist(), strict=True):
            found |= {f"force {name}": force, f"power {name}": 0.0}
        at = joint_values(self._robot, motion.q[0])
        for i in self._single:
            name = str(self._robot.model.names[i])
            found |= {f"q {name}": float(np.ravel(at[name])[0]), f"v {name}": 0.0}
        if transmitted.known:
            for i, (force, turn) in enumerate(
                zip(transmitted.forces[0], transmitted.moments[0], strict=True), 1
            ):
                found[f"force in closure {i}"] = float(np.linalg.norm(force))
                found[f"moment in closure {i}"] = float(np.linalg.norm(turn))
            found |= {f"coupling {i}": size for i, size in enumerate(transmitted.couplings[0].tolist(), 1)}
        return {key: value if np.isfinite(value) else None for key, value in found.items()}

    def _loads(self, transmitted: Transmitted) -> dict[str, list[float]]:
        found: dict[str, FloatArray] = {}
        for i in range(len(self._robot.sidecar.closures)):
            found[f"closure {i + 1} force"] = transmitted.forces[0, i]
            found[f"closure {i + 1} moment"] = transmitted.moments[0, i]
        for name, wrench in self._external.items():
            found |= {f"wrench force {name}": wrench[:3], f"wrench moment {name}": wrench[3:]}
        return {key: vector.tolist() for key, vector in found.items() if np.isfinite(vector).all()}
