"""Runs of any robot as a document has them: joints, forces of actuators, what closures transmit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops import ClosedLoopModel
from p3dof.loops.closure_wrenches import ClosureWrenches
from p3dof.loops.tables import is_slide
from p3dof.viewer.document.curves import GREY, PALETTE, Limit, curve
from p3dof.viewer.document.encoding import encoded
from p3dof.viewer.document.robots.motion import JointMotion
from p3dof.viewer.document.trees import placed_over, tree_of

_UNLIMITED = 1e3
"""Limits that are farther from zero are none [m, rad, m/s, rad/s]."""
_MOST_FORCE = 1e9
"""Likewise of forces [N, N m]."""
LAYER = {"name": "multipliers", "label": "Forces in closures"}
"""What closures transmit can be hidden."""
CLOSURES = "#6b299e"
"""Colour of what closures transmit."""
_SMALLEST = "Other actuator forces would do too: these are the smallest, and those in closures go with them."


def robot_run(
    loop: ClosedLoopModel, motion: JointMotion, v: FloatArray | None, name: str, notes: list[str]
) -> dict[str, Any]:
    """Return a run of a document.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    motion : JointMotion
        Joints and forces over N samples.
    v : ndarray, shape (N, nv), optional
        Their velocities.
    name : str
        What the run is called.
    notes : list of str
        What a reader should know.

    Returns
    -------
    dict
    """
    joints = tree_of(loop.model)
    wrenches = _Transmitted(loop, motion)
    found: dict[str, Any] = {
        "name": name,
        "time": encoded(motion.time),
        "q": encoded(motion.q),
        "curves": [*_actuator_curves(loop, motion, v), *wrenches.curves(), *_joint_curves(loop, motion, v)],
        "loads": [*_actuator_loads(loop, motion, joints), *wrenches.loads(), *_wrench_loads(loop, motion)],
        "notes": [*notes, *([_SMALLEST] if motion.smallest else [])],
    }
    placed = placed_over(loop.model, np.asarray(motion.q))
    return found | ({"placed": placed} if placed else {})


def _actuator_curves(
    loop: ClosedLoopModel, motion: JointMotion, v: FloatArray | None
) -> list[dict[str, Any]]:
    model, found = loop.model, []
    powers = []
    for i, (name, force) in enumerate(zip(motion.actuated, motion.known.T, strict=True)):
        joint = model.getJointId(name)
        slides, ink = is_slide(loop, joint), PALETTE[i % len(PALETTE)]
        group, unit = ("Actuator forces", "N") if slides else ("Actuator torques", "N m")
        most = float(model.upperEffortLimit[model.idx_vs[joint]])
        limit = (-most, most) if 0 < most < _MOST_FORCE else None
        found.append(curve(f"force {name}", name, group, unit, ink, force, limit=limit))
        if v is not None:
            powers.append((name, ink, force * v[:, model.idx_vs[joint]]))
    for name, ink, power in powers:
        found.append(curve(f"power {name}", name, "Power", "W", ink, power))
    if powers:
        total = np.sum([power for _, _, power in powers], axis=0)
        found.append(curve("power", "Sum", "Power", "W", GREY, total))
    return found


def _joint_curves(loop: ClosedLoopModel, motion: JointMotion, v: FloatArray | None) -> list[dict[str, Any]]:
    """Return positions and speeds of joints with one degree of freedom, the actuated ones first."""
    model, found = loop.model, []
    single = [i for i in range(1, model.njoints) if model.nvs[i] == 1 and model.nqs[i] > 0]
    actuated = {model.getJointId(name) for name in loop.actuated}
    ordered = sorted(single, key=lambda i: (i not in actuated, i))
    for k, i in enumerate(ordered):
        name, start, ink = str(model.names[i]), int(model.idx_qs[i]), PALETTE[k % len(PALETTE)]
        slides, known = is_slide(loop, i), "Actuated joints" if i in actuated else "Passive joints"
        group, unit = f"{known}, {'positions' if slides else 'angles'}", "m" if slides else "rad"
        if model.nqs[i] == 1:
            limit = _limit(float(model.lowerPositionLimit[start]), float(model.upperPositionLimit[start]))
            found.append(curve(f"q {name}", name, group, unit, ink, None, ("q", start), limit))
        else:
            angle = np.unwrap(np.arctan2(motion.q[:, start + 1], motion.q[:, start]))
            found.append(curve(f"q {name}", name, group, unit, ink, angle))
    for k, i in enumerate(ordered if v is not None else []):
        name, at, ink = str(model.names[i]), int(model.idx_vs[i]), PALETTE[k % len(PALETTE)]
        slides, known = is_slide(loop, i), "Actuated joints" if i in actuated else "Passive joints"
        most = float(model.upperVelocityLimit[at])
        limit = _limit(-most, most) if most > 0 else None
        group, unit = f"{known}, {'speeds' if slides else 'rates'}", "m/s" if slides else "rad/s"
        found.append(curve(f"v {name}", name, group, unit, ink, np.asarray(v)[:, at], limit=limit))
    return found


def _limit(low: float, high: float) -> Limit | None:
    """Return a range, infinite where it has no end; None for none."""
    ends = low if abs(low) < _UNLIMITED else -np.inf, high if abs(high) < _UNLIMITED else np.inf
    return ends if high > low and np.isfinite(ends).any() else None


def _actuator_loads(
    loop: ClosedLoopModel, motion: JointMotion, joints: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    found = []
    for i, name in enumerate(motion.actuated):
        joint = loop.model.getJointId(name) - 1
        slides = is_slide(loop, joint + 1)
        found.append(
            {
                "key": f"force {name}",
                "label": f"{'Force' if slides else 'Torque'} of {name}",
                "kind": "force" if slides else "moment",
                "joint": joint,
                "point": [0.0, 0.0, 0.0],
                "frame": "joint",
                "direction": joints[joint]["axis"],
                "curve": f"force {name}",
                "colour": PALETTE[i % len(PALETTE)],
                "group": "actuator",
                "unit": "N" if slides else "N m",
            }
        )
    return found


def _wrench_loads(loop: ClosedLoopModel, motion: JointMotion) -> list[dict[str, Any]]:
    found = []
    for name, wrench in motion.acting.items():
        frame = loop.model.frames[_frame(loop.model, name)]
        place = int(frame.parentJoint) - 1, frame.placement.translation.tolist()
        for kind, part in (("force", wrench[:, :3]), ("moment", wrench[:, 3:])):
            if np.any(part):
                found.append(
                    _load(f"wrench {kind} {name}", f"External {kind} on {name}", kind, *place, part, "wrench")
                )
    return found


def _frame(model: pin.Model, name: str) -> int:
    """Return a frame by name; links go before joints of the same name."""
    body = model.existFrame(name, pin.FrameType.BODY)
    return int(model.getFrameId(name, pin.FrameType.BODY) if body else model.getFrameId(name))


def _load(
    key: str, label: str, kind: str, joint: int, point: list[float], values: FloatArray, group: str
) -> dict[str, Any]:
    return {
        "key": key,
        "label": label,
        "kind": kind,
        "joint": joint,
        "point": point,
        "frame": "world",
        "values": encoded(values, "float32"),
        "colour": CLOSURES if group == "multiplier" else GREY,
        "group": group,
        "unit": "N" if kind == "force" else "N m",
    } | ({"layer": LAYER["name"]} if group == "multiplier" else {})


class _Transmitted:
    """What closures and couplings transmit over a motion: nothing where the multipliers are not known."""

    def __init__(self, loop: ClosedLoopModel, motion: JointMotion) -> None:
        self._loop, self._motion = loop, motion
        closures = loop.sidecar.closures
        shape = len(motion.time), len(closures), 3
        self._forces: FloatArray = np.full(shape, np.nan)
        self._moments: FloatArray = np.full(shape, np.nan)
        self._known = motion.closing.shape[1] > 0
        if not self._known or not closures:
            return
        wrenches = ClosureWrenches(loop)
        for i, (q, lambda_) in enumerate(zip(motion.q, motion.closing, strict=True)):
            if np.isfinite(q).all():
                found = wrenches.at(q, lambda_)
                self._forces[i, found.known] = found.forces[found.known]
                self._moments[i, found.known] = found.moments[found.known]

    def curves(self) -> list[dict[str, Any]]:
        """Return the sizes of forces and moments in closures, and what holds couplings."""
        if not self._known:
            return []
        found = []
        for kind, values in (("force", self._forces), ("moment", self._moments)):
            group, unit = ("Forces in closures", "N") if kind == "force" else ("Moments in closures", "N m")
            for i, closure in enumerate(self._loop.sidecar.closures):
                if kind == "force" or closure.kind not in ("3d", "distance"):
                    size, ink = np.linalg.norm(values[:, i], axis=1), PALETTE[i % len(PALETTE)]
                    found.append(curve(f"{kind} in closure {i + 1}", closure.name, group, unit, ink, size))
        rows = self._loop.constraint_rows[len(self._loop.sidecar.closures) :]
        for i, (coupling, span) in enumerate(zip(self._loop.sidecar.couplings, rows, strict=True)):
            slides = is_slide(self._loop, self._loop.model.getJointId(coupling.joint))
            group, unit = ("Forces in couplings", "N") if slides else ("Torques in couplings", "N m")
            key, ink, values = f"coupling {i + 1}", PALETTE[i % len(PALETTE)], self._motion.closing[:, span]
            found.append(curve(key, coupling.title, group, unit, ink, values[:, 0]))
        return found

    def loads(self) -> list[dict[str, Any]]:
        """Return forces and moments on the bodies of the second frames."""
        if not self._known:
            return []
        found, model = [], self._loop.model
        for i, closure in enumerate(self._loop.sidecar.closures):
            frame = model.frames[model.getFrameId(closure.frame2)]
            place = int(frame.parentJoint) - 1, frame.placement.translation.tolist()
            kinds = ("force",) if closure.kind in ("3d", "distance") else ("force", "moment")
            for kind in kinds:
                values = (self._forces if kind == "force" else self._moments)[:, i]
                label = f"{kind.capitalize()} in {closure.name}"
                found.append(_load(f"closure {i + 1} {kind}", label, kind, *place, values, "multiplier"))
        return found
