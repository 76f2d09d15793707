"""Runs of any robot as a document has them: joints, forces of actuators, what closures transmit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops import ClosedLoopModel, Closure
from p3dof.loops.closures import ClosureWrenches
from p3dof.loops.tables import is_slide
from p3dof.viewer.document.encoding import GREY, PALETTE, Limit, curve, encoded, load
from p3dof.viewer.document.motion import JointMotion
from p3dof.viewer.document.trees import place_of, placed_over, tree_of

_UNLIMITED = 1e3
"""Limits that are farther from zero are none [m, rad, m/s, rad/s]."""
_MOST_FORCE = 1e9
"""Likewise of forces [N, N m]."""
MULTIPLIERS = "multipliers"
"""The layer of what closures transmit, which can be hidden."""
CLOSURES = "#6b299e"
"""Colour of what closures transmit."""
_SMALLEST = "Other actuator forces would do too: these are the smallest, and those in closures go with them."


def as_run(
    name: str,
    time: FloatArray,
    q: FloatArray,
    curves: list[dict[str, Any]],
    loads: list[dict[str, Any]],
    notes: list[str],
    tables: dict[str, FloatArray] | None = None,
) -> dict[str, Any]:
    """Return a run of the machine or any robot; `tables` have columns that curves are of."""
    found: dict[str, Any] = {"name": name, "time": encoded(time), "q": encoded(q)}
    found |= {key: encoded(values) for key, values in (tables or {}).items()}
    return found | {"curves": curves, "loads": loads, "notes": notes}


def robot_run(
    loop: ClosedLoopModel, motion: JointMotion, v: FloatArray | None, name: str, notes: list[str]
) -> dict[str, Any]:
    """Return a run of a document."""
    transmitted = Transmitted(loop, motion)
    curves = [*_actuator_curves(loop, motion, v), *transmitted.curves(), *_joint_curves(loop, motion, v)]
    loads = [*_actuator_loads(loop, motion), *transmitted.loads(), *_wrench_loads(loop, motion)]
    notes = [*notes, *([_SMALLEST] if motion.smallest else [])]
    placed = placed_over(loop.model, np.asarray(motion.q))
    return as_run(name, motion.time, motion.q, curves, loads, notes) | ({"placed": placed} if placed else {})


def _actuator_curves(
    loop: ClosedLoopModel, motion: JointMotion, v: FloatArray | None
) -> list[dict[str, Any]]:
    model, forces, powers = loop.model, [], []
    total = np.zeros(len(motion.time))
    for i, (name, force) in enumerate(zip(motion.actuated, motion.known.T, strict=True)):
        joint, ink = model.getJointId(name), PALETTE[i % len(PALETTE)]
        group, unit = ("Actuator forces", "N") if is_slide(loop, joint) else ("Actuator torques", "N m")
        most = float(model.upperEffortLimit[model.idx_vs[joint]])
        limit = (-most, most) if 0 < most < _MOST_FORCE else None
        forces.append(curve(f"force {name}", name, group, unit, ink, force, limit=limit))
        if v is not None:
            power = force * v[:, model.idx_vs[joint]]
            powers.append(curve(f"power {name}", name, "Power", "W", ink, power))
            total = total + power
    return [*forces, *powers, *([curve("power", "Sum", "Power", "W", GREY, total)] if powers else [])]


def _joint_curves(loop: ClosedLoopModel, motion: JointMotion, v: FloatArray | None) -> list[dict[str, Any]]:
    """Return positions and speeds of joints with one degree of freedom, the actuated ones first."""
    model, positions, speeds = loop.model, [], []
    single = [i for i in range(1, model.njoints) if model.nvs[i] == 1 and model.nqs[i] > 0]
    actuated = {model.getJointId(name) for name in loop.actuated}
    for k, i in enumerate(sorted(single, key=lambda i: (i not in actuated, i))):
        name, start, ink = str(model.names[i]), int(model.idx_qs[i]), PALETTE[k % len(PALETTE)]
        slides, known = is_slide(loop, i), "Actuated joints" if i in actuated else "Passive joints"
        group, unit = f"{known}, {'positions' if slides else 'angles'}", "m" if slides else "rad"
        if model.nqs[i] == 1:
            limit = _limit(float(model.lowerPositionLimit[start]), float(model.upperPositionLimit[start]))
            positions.append(curve(f"q {name}", name, group, unit, ink, None, ("q", start), limit))
        else:
            angle = np.unwrap(np.arctan2(motion.q[:, start + 1], motion.q[:, start]))
            positions.append(curve(f"q {name}", name, group, unit, ink, angle))
        if v is not None:
            at = int(model.idx_vs[i])
            most = float(model.upperVelocityLimit[at])
            limit = _limit(-most, most) if most > 0 else None
            group, unit = f"{known}, {'speeds' if slides else 'rates'}", f"{unit}/s"
            speeds.append(curve(f"v {name}", name, group, unit, ink, v[:, at], limit=limit))
    return [*positions, *speeds]


def _limit(low: float, high: float) -> Limit | None:
    """Return a range, infinite where it has no end; None for none."""
    ends = low if abs(low) < _UNLIMITED else -np.inf, high if abs(high) < _UNLIMITED else np.inf
    return ends if high > low and np.isfinite(ends).any() else None


def _actuator_loads(loop: ClosedLoopModel, motion: JointMotion) -> list[dict[str, Any]]:
    found, joints = [], tree_of(loop.model)
    for i, name in enumerate(motion.actuated):
        joint, ink = loop.model.getJointId(name) - 1, PALETTE[i % len(PALETTE)]
        words, kind = ("Force", "force") if is_slide(loop, joint + 1) else ("Torque", "moment")
        along, place = (joints[joint]["axis"], f"force {name}"), (joint, [0.0, 0.0, 0.0])
        label = f"{words} of {name}"
        found.append(load(f"force {name}", label, kind, place, ink, "actuator", None, along, "joint"))
    return found


def _wrench_loads(loop: ClosedLoopModel, motion: JointMotion) -> list[dict[str, Any]]:
    found, model = [], loop.model
    for name, wrench in motion.acting.items():
        body = model.existFrame(name, pin.FrameType.BODY)  # links go before joints of the same name
        number = model.getFrameId(name, pin.FrameType.BODY) if body else model.getFrameId(name)
        place = place_of(model.frames[number])
        for kind, part in (("force", wrench[:, :3]), ("moment", wrench[:, 3:])):
            if np.any(part):
                values, label = encoded(part, "float32"), f"External {kind} on {name}"
                found.append(load(f"wrench {kind} {name}", label, kind, place, GREY, "wrench", values))
    return found


class Transmitted:
    """What closures and couplings transmit over a motion: nothing where the multipliers are not known."""

    def __init__(
        self, loop: ClosedLoopModel, motion: JointMotion, wrenches: ClosureWrenches | None = None
    ) -> None:
        self._loop, self._motion, self._closures = loop, motion, loop.sidecar.closures
        shape = len(motion.time), len(self._closures), 3
        self.forces: FloatArray = np.full(shape, np.nan)
        self.moments: FloatArray = np.full(shape, np.nan)
        self.known = motion.closing.shape[1] > 0
        if not self.known or not self._closures:
            return
        wrenches = ClosureWrenches(loop.model, loop.sidecar) if wrenches is None else wrenches
        for i, (q, lambda_) in enumerate(zip(motion.q, motion.closing, strict=True)):
            if np.isfinite(q).all():
                found = wrenches.at(q, lambda_)
                self.forces[i, found.known] = found.forces[found.known]
                self.moments[i, found.known] = found.moments[found.known]

    @property
    def couplings(self) -> FloatArray:
        """The multipliers of the couplings, shape (N, couplings) [N or N m]."""
        rows = self._loop.constraint_rows[len(self._closures) :]
        return self._motion.closing[:, [span.start for span in rows]]

    def curves(self) -> list[dict[str, Any]]:
        """Return the sizes of forces and moments in closures, and what holds couplings."""
        if not self.known:
            return []
        found = []
        for kind, words, unit, values in (
            ("force", "Forces in closures", "N", self.forces),
            ("moment", "Moments in closures", "N m", self.moments),
        ):
            for i, closure in enumerate(self._closures):
                if kind in _kinds(closure):
                    size, ink = np.linalg.norm(values[:, i], axis=1), PALETTE[i % len(PALETTE)]
                    found.append(curve(f"{kind} in closure {i + 1}", closure.name, words, unit, ink, size))
        for i, (coupling, values) in enumerate(
            zip(self._loop.sidecar.couplings, self.couplings.T, strict=True)
        ):
            slides = is_slide(self._loop, self._loop.model.getJointId(coupling.joint))
            group, unit = ("Forces in couplings", "N") if slides else ("Torques in couplings", "N m")
            ink = PALETTE[i % len(PALETTE)]
            found.append(curve(f"coupling {i + 1}", coupling.title, group, unit, ink, values))
        return found

    def loads(self) -> list[dict[str, Any]]:
        """Return forces and moments on the bodies of the second frames."""
        if not self.known:
            return []
        found, model = [], self._loop.model
        for i, closure in enumerate(self._closures):
            place = place_of(model.frames[model.getFrameId(closure.frame2)])
            for kind in _kinds(closure):
                values = encoded((self.forces if kind == "force" else self.moments)[:, i], "float32")
                key, label = f"closure {i + 1} {kind}", f"{kind.capitalize()} in {closure.name}"
                arrow = load(key, label, kind, place, CLOSURES, "multiplier", values, layer=MULTIPLIERS)
                found.append(arrow)
        return found


def _kinds(closure: Closure) -> tuple[str, ...]:
    """Return what a closure can transmit."""
    return ("force",) if closure.kind in ("3d", "distance") else ("force", "moment")
