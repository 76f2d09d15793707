"""Robots of the gallery in MuJoCo, which reads their URDF itself; closures are added as equalities.

Everything is in the order of Pinocchio's q and v at the outside.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from p3dof.loops import ClosedLoopModel, Sidecar

COMPILER = '<compiler fusestatic="false" discardvisual="true" boundmass="1e-14" boundinertia="1e-14"/>'
"""Links without mass get one that no force shows."""


@dataclass(frozen=True)
class InMujoco:
    """A robot in both: `model` is MuJoCo's."""

    loop: ClosedLoopModel
    model: Any

    def joints(self):
        """Slices of each joint in Pinocchio's q and v, and in MuJoCo's; what kind of joint it is."""
        tree = self.loop.model
        for i in range(1, tree.njoints):
            other = self.model.joint(tree.names[i])
            nq, nv = int(tree.nqs[i]), int(tree.nvs[i])
            angle = nq == 2
            at_q, at_v = int(other.qposadr[0]), int(other.dofadr[0])
            yield (
                slice(tree.idx_qs[i], tree.idx_qs[i] + nq),
                slice(tree.idx_vs[i], tree.idx_vs[i] + nv),
                slice(at_q, at_q + (1 if angle else nq)),
                slice(at_v, at_v + nv),
                {7: "floating", 4: "ball", 2: "angle"}.get(nq, ""),
            )

    def qpos(self, q: np.ndarray) -> np.ndarray:
        found = np.zeros(self.model.nq)
        for at, _, there, _, kind in self.joints():
            found[there] = _angle(q[at]) if kind == "angle" else q[at]
            if kind in ("floating", "ball"):
                x, y, z, w = q[at][-4:]
                found[there][-4:] = w, x, y, z
        return found

    def qvel(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        found = np.zeros(self.model.nv)
        for at, span, _, there, kind in self.joints():
            found[there] = v[span]
            if kind == "floating":  # MuJoCo's linear velocity is in world axes
                found[there][:3] = _rotation(q[at]) @ v[span][:3]
        return found

    def qacc(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        found = np.zeros(self.model.nv)
        for at, span, _, there, kind in self.joints():
            found[there] = a[span]
            if kind == "floating":
                linear = a[span][:3] + np.cross(v[span][3:], v[span][:3])
                found[there][:3] = _rotation(q[at]) @ linear
        return found

    def actuated_v(self) -> list[int]:
        return [int(self.model.joint(name).dofadr[0]) for name in self.loop.actuated]

    def from_qpos(self, qpos: np.ndarray) -> np.ndarray:
        q = np.zeros(self.loop.model.nq)
        for at, _, there, _, kind in self.joints():
            value = qpos[there]
            if kind == "angle":
                q[at] = np.cos(value[0]), np.sin(value[0])
            elif kind in ("floating", "ball"):
                w, x, y, z = value[-4:]
                q[at] = *value[:-4], x, y, z, w
            else:
                q[at] = value
        return q


def in_mujoco(loop: ClosedLoopModel, file: Path) -> InMujoco:
    """Return a robot as MuJoCo reads its URDF, with the closures, couplings and springs of its sidecar."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[engines]'")
    text = re.sub(
        r"(<robot [^>]*>)", rf"\1<mujoco>{COMPILER}</mujoco>", file.read_text(encoding="utf-8"), count=1
    )
    spec = _edited(mujoco, text, loop.sidecar)
    for joint in spec.joints:
        joint.limited = False
        joint.range = np.zeros(2)
    for number, closure in enumerate(loop.sidecar.closures):
        _add(mujoco, spec, number, closure)
    for coupling in loop.sidecar.couplings:
        assert not coupling.others
        row = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
        row.name1, row.name2 = coupling.joint, coupling.on
        row.data[: len(coupling.coefficients)] = coupling.coefficients
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model = spec.compile()
    for number, closure in enumerate(loop.sidecar.closures):
        if closure.kind == "distance":  # its error counts from the cord's length at zero
            name = f"closure_{number}"
            model.equality(name).data[0] = closure.length - model.tendon_length0[model.tendon(name).id]
    return InMujoco(loop, model)


def _edited(mujoco: Any, text: str, sidecar: Sidecar) -> Any:
    """Return a URDF with springs, dampers and balls, and floating bodies in the world, their only place.

    That is done in MuJoCo's own XML, which has six digits; all numbers are put back afterwards.
    """
    urdf, loose = ElementTree.fromstring(text), {}  # noqa: S314 - our own file
    for joint in urdf.findall("joint[@type='floating']"):
        joint.set("type", "fixed")
        loose[joint.find("child").get("link")] = joint.get("name")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(urdf, encoding="unicode"))
    exact = spec.compile()
    tree = ElementTree.fromstring(spec.to_xml())  # noqa: S314 - MuJoCo's
    world = tree.find("worldbody")
    for link, name in loose.items():
        parent = world.find(f".//body[@name='{link}']/..")
        body = parent.find(f"body[@name='{link}']")
        parent.remove(body)
        world.append(body)
        body.insert(0, ElementTree.Element("freejoint", name=name))
    for name, kind in sidecar.joints:
        assert kind == "SPHERICAL"
        world.find(f".//joint[@name='{name}']").set("type", "ball")
    for given in sidecar.joint_data:
        joint = world.find(f".//joint[@name='{given.joint}']")
        values = {"stiffness": given.stiffness, "springref": given.rest, "damping": given.damping}
        joint.attrib.update({key: repr(value) for key, value in values.items()})
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(tree, encoding="unicode"))
    _exactly(spec, exact, set(loose.values()))
    return spec


def _exactly(spec: Any, exact: Any, loose: set[str]) -> None:
    for body in spec.bodies[1:]:
        known = exact.body(body.name)
        for key in ("pos", "quat", "ipos", "iquat", "inertia"):
            setattr(body, key, getattr(known, key))
        body.mass = float(known.mass[0])
    for joint in spec.joints:
        if joint.name not in loose:
            joint.axis = exact.joint(joint.name).axis


def _add(mujoco: Any, spec: Any, number: int, closure: Any) -> None:
    """Add a closure; frames of the gallery's sidecars are links."""
    ends = (closure.frame1, closure.frame2)
    for name in ends:
        spec.body(name).add_site(name=name)
    if closure.kind == "distance":  # a cord that neither lengthens nor slackens
        cord = spec.add_tendon(name=f"closure_{number}")
        for name in ends:
            cord.wrap_site(name)
        row = spec.add_equality(type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON)
        row.name = row.name1 = f"closure_{number}"
        row.data[:5] = 0.0, 1.0, 0.0, 0.0, 0.0
        return
    kinds = {"3d": mujoco.mjtEq.mjEQ_CONNECT, "6d": mujoco.mjtEq.mjEQ_WELD}
    row = spec.add_equality(type=kinds[closure.kind], objtype=mujoco.mjtObj.mjOBJ_SITE)
    row.name1, row.name2 = ends


def _angle(value: np.ndarray) -> float:
    return float(np.arctan2(value[1], value[0]))


def _rotation(place: np.ndarray) -> np.ndarray:
    return pin.XYZQUATToSE3(place).rotation
