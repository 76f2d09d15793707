"""`RobotAnswers`: where a robot is when its actuated joints are set, and the forces that hold it there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.closure_wrenches import ClosureWrenches
from p3dof.loops.compiling_model import Method
from p3dof.loops.tables import joint_values
from p3dof.viewer.document.robots.motion import Moment, held
from p3dof.viewer.robots.hand import Hand, compiled_of


class RobotAnswers:
    """Answers pages that move the actuated joints of a robot: it knows nothing of where they were before.

    A question has ``q``, the configuration that a page shows, and ``inputs``, values by actuated joint [m or
    rad]; the loops are closed from there. The answer has the configuration, and the ``values`` of the curves
    and the ``loads`` of a document of this robot, by key.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot.
    q : ndarray, shape (nq,)
        A configuration with closed loops.
    external : mapping of str to ndarray, shape (6,)
        Wrenches that act on frames.
    method : {"general", "compiled"} or CompiledLoop
        What computes: the robot, or C that is compiled for it, where there is a compiler.

    Raises
    ------
    InputError
        If an argument does not fit.
    ModelError
        If the robot cannot be compiled.
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
        self._wrenches = ClosureWrenches(robot)
        model = robot.model
        self._single = [i for i in range(1, model.njoints) if model.nvs[i] == 1 and model.nqs[i] > 0]

    def __call__(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """Return the answer.

        Raises
        ------
        AssemblyError
            If the robot cannot be there.
        InputError
            If the question makes no sense.
        """
        q = frozen_array("q", question.get("q"), (self._robot.model.nq,))
        inputs = question.get("inputs")
        if not isinstance(inputs, Mapping) or not set(inputs) <= set(self._robot.actuated):
            raise InputError(f"inputs: expected values by actuated joint, got {shown(inputs)}")
        self._hand.follow(q)
        now = dict(zip(self._robot.actuated, self._hand.values.tolist(), strict=True)) | dict(inputs)
        values = frozen_array("inputs", list(now.values()), (len(now),))
        if not self._hand.moves_to(values):
            raise AssemblyError(self._hand.refused)
        moment, why = held(self._robot, self._hand.q, self._external, self._compiled)
        return {
            "q": moment.q,
            "values": self._values(moment),
            "loads": self._loads(moment),
            "notes": [why] if why else [],
        }

    def _values(self, moment: Moment) -> dict[str, float | None]:
        found: dict[str, float] = {}
        for name, force in zip(self._robot.actuated, moment.forces.tolist(), strict=False):
            found |= {f"force {name}": force, f"power {name}": 0.0}
        found["power"] = 0.0
        at = joint_values(self._robot, moment.q)
        for i in self._single:
            name = str(self._robot.model.names[i])
            found |= {f"q {name}": float(np.ravel(at[name])[0]), f"v {name}": 0.0}
        for i, (force, turn) in enumerate(self._transmitted(moment), 1):
            found[f"force in closure {i}"] = float(np.linalg.norm(force))
            found[f"moment in closure {i}"] = float(np.linalg.norm(turn))
        if moment.multipliers.size:
            rows = self._robot.constraint_rows[len(self._robot.sidecar.closures) :]
            found |= {f"coupling {i}": float(moment.multipliers[span][0]) for i, span in enumerate(rows, 1)}
        return {key: value if np.isfinite(value) else None for key, value in found.items()}

    def _loads(self, moment: Moment) -> dict[str, list[float]]:
        found: dict[str, FloatArray] = {}
        for i, (force, turn) in enumerate(self._transmitted(moment), 1):
            found |= {f"closure {i} force": force, f"closure {i} moment": turn}
        for name, wrench in self._external.items():
            found |= {f"wrench force {name}": wrench[:3], f"wrench moment {name}": wrench[3:]}
        return {key: vector.tolist() for key, vector in found.items() if np.isfinite(vector).all()}

    def _transmitted(self, moment: Moment) -> list[tuple[FloatArray, FloatArray]]:
        """Return force and moment in each closure; NaN where they are not determined."""
        if not moment.multipliers.size:
            return []
        found = self._wrenches.at(moment.q, moment.multipliers)
        known = found.known[:, None]
        forces, turns = np.where(known, found.forces, np.nan), np.where(known, found.moments, np.nan)
        return list(zip(forces, turns, strict=True))
