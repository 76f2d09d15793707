"""What a page says of the closures and couplings of a robot: kind, name, and the force in each in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof.checks import FloatArray
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.closure_wrenches import ClosureWrenches
from p3dof.closed_loop.tables import is_slide
from p3dof.page.robots.motion import Moment
from p3dof.viewer.robots.closures import WORDS
from p3dof.viewer.stage import number

UNDETERMINED = "not determined"


@dataclass(frozen=True)
class Reading:
    """What is said of one closure or coupling.

    Parameters
    ----------
    number : int
        The number beside it in the picture, from 1; 0 for a coupling, which is not in the picture.
    kind : str
        What it is.
    name : str
        What it is called.
    """

    number: int
    kind: str
    name: str


class ClosureReadings:
    """The closures and couplings of one robot in words.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.

    Attributes
    ----------
    readings : tuple of Reading
        The closures, then the couplings.
    """

    def __init__(self, loop: ClosedLoopModel) -> None:
        sidecar, model = loop.sidecar, loop.model
        self._wrenches = ClosureWrenches(loop)
        self._rows = loop.constraint_rows
        self._moments = [closure.kind not in ("3d", "distance") for closure in sidecar.closures]
        joints = [model.getJointId(coupling.joint) for coupling in sidecar.couplings]
        self._units = ["N" if is_slide(loop, joint) else "N m" for joint in joints]
        closures = enumerate(sidecar.closures, 1)
        self.readings = (
            *(Reading(i, WORDS[closure.kind], closure.name) for i, closure in closures),
            *(Reading(0, "coupling", coupling.title) for coupling in sidecar.couplings),
        )

    def texts(self, moment: Moment) -> list[str]:
        """Return the force in each in words; empty where the forces of the moment are not known at all."""
        if not moment.multipliers.size:
            return [""] * len(self.readings)
        wrench = self._wrenches.at(moment.q, moment.multipliers)
        each = zip(wrench.forces, wrench.moments, self._moments, wrench.determined, strict=True)
        texts = [_text(*one) for one in each]
        for span, unit in zip(self._rows[len(texts) :], self._units, strict=True):
            value = float(moment.multipliers[span][0])
            texts.append(f"{number(value)} {unit}" if np.isfinite(value) else UNDETERMINED)
        return texts


def _text(force: FloatArray, moment: FloatArray, has_moment: bool, determined: int) -> str:
    if not determined:
        return UNDETERMINED
    sizes = [f"{number(float(np.linalg.norm(force)))} N"]
    if has_moment:
        sizes.append(f"{number(float(np.linalg.norm(moment)))} N m")
    return f"{', '.join(sizes)}{'' if determined == 2 else ' in part'}"
