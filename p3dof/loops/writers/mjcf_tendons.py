"""Couplings of joints as equalities of MuJoCo; joints that are tendons, by which a motor pulls at others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from xml.etree import ElementTree as Xml

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.markup import numbers, sub
from p3dof.loops.constraints import Coupling
from p3dof.loops.joint_data import JointData
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.writers.names import Names

_SIMPLE = ("JointModelP", "JointModelR")
"""Beginnings of the names of slides and hinges."""
_LINEAR = 2
"""Coefficients of a polynomial of degree one."""


@dataclass(frozen=True)
class TendonJoint:
    """A joint without mass that is the length of a tendon; the motor on it pulls at the joints it follows.

    Parameters
    ----------
    name : str
        The joint, and the tendon.
    joint : int
        Its index.
    coupling : Coupling
        What it follows.
    """

    name: str
    joint: int
    coupling: Coupling


def tendon_joints(loop: LoopModel) -> list[TendonJoint]:
    """Return the joints of a robot that are lengths of fixed tendons.

    Parameters
    ----------
    loop : LoopModel
        The robot.

    Returns
    -------
    list of TendonJoint
    """
    model, found = loop.model, []
    leaders = {leader for coupling in loop.sidecar.couplings for leader in coupling.leaders}
    occupied = {int(frame.parentJoint) for frame in model.frames if frame.name not in set(model.names)}
    occupied |= {int(parent) for parent in list(model.parents)[1:]}
    for coupling in loop.sidecar.couplings:
        i = model.getJointId(coupling.joint)
        inertia, c = model.inertias[i], coupling.coefficients
        fixed = str(model.joints[i].shortname()).startswith(_SIMPLE) and model.nqs[i] == model.nvs[i] == 1
        empty = not (inertia.mass or np.any(inertia.inertia)) and i not in occupied and model.parents[i] == 0
        linear = len(c) == _LINEAR and c[0] == 0.0 and coupling.on is not None
        if fixed and empty and linear and coupling.joint not in leaders:
            found.append(TendonJoint(coupling.joint, i, coupling))
    return found


def write_tendons(
    loop: LoopModel,
    joints: Sequence[TendonJoint],
    data: Mapping[str, JointData],
    names: Names,
    tendons: Xml.Element,
    equalities: Xml.Element,
) -> None:
    """Write tendons that are joints, and couplings.

    Parameters
    ----------
    loop : LoopModel
        The robot.
    joints : sequence of TendonJoint
        Its joints that are lengths of tendons.
    data : mapping of str to JointData
        What acts in joints.
    names : Names
        Of tendons.
    tendons, equalities : Element
        Where to.
    """
    for joint in joints:
        entry = data.get(joint.name, JointData(joint.name))
        armature = float(loop.model.armature[loop.model.idx_vs[joint.joint]])
        values = {"damping": entry.damping, "frictionloss": entry.friction, "armature": armature}
        if entry.stiffness:
            values |= {"stiffness": entry.stiffness, "springlength": float(np.asarray(entry.rest))}
        acting = {
            key: numbers(value, exact=True) for key, value in values.items() if value or key == "springlength"
        }
        _fixed(
            tendons,
            joint.name,
            [(str(joint.coupling.on), joint.coupling.coefficients[1]), *joint.coupling.others],
            acting,
        )
    written = {joint.name for joint in joints}
    for coupling in loop.sidecar.couplings:
        if coupling.joint not in written:
            _coupling(coupling, names, tendons, equalities)


def _coupling(coupling: Coupling, names: Names, tendons: Xml.Element, equalities: Xml.Element) -> None:
    name = names.new(coupling.name or coupling.joint)
    coefficients = numbers(*(coupling.coefficients + (0.0,) * 5)[:5], exact=True)
    if not coupling.others:
        on = {} if coupling.on is None else {"joint2": coupling.on}
        sub(equalities, "joint", name=name, joint1=coupling.joint, **on, polycoef=coefficients)
        return
    _fixed(tendons, name, [(coupling.joint, 1.0), *((other, -factor) for other, factor in coupling.others)])
    on = {}
    if coupling.on is not None:
        on["tendon2"] = names.new(f"{name}_on")
        _fixed(tendons, on["tendon2"], [(coupling.on, 1.0)])
    sub(equalities, "tendon", name=name, tendon1=name, **on, polycoef=coefficients)


def _fixed(
    tendons: Xml.Element,
    name: str,
    joints: Sequence[tuple[str, float]],
    acting: Mapping[str, str] | None = None,
) -> None:
    tendon = sub(tendons, "fixed", name=name, **(acting or {}))
    for joint, factor in joints:
        sub(tendon, "joint", joint=joint, coef=numbers(factor, exact=True))


def turned(couplings: Sequence[Coupling], values: dict[str, FloatArray], circles: Collection[str]) -> None:
    """Count the turns of continuous joints that follow others: MuJoCo does.

    Parameters
    ----------
    couplings : sequence of Coupling
        The couplings.
    values : dict of str to (1,) array
        Values of all joints, which change.
    circles : collection of str
        The continuous joints.
    """
    left = {coupling.joint: coupling.leaders for coupling in couplings}
    by_joint = {coupling.joint: coupling for coupling in couplings}
    for joint in TopologicalSorter(left).static_order():
        if joint in by_joint and joint in circles:
            coupling = by_joint[joint]
            on = 0.0 if coupling.on is None else values[coupling.on][0]
            follows = np.polynomial.polynomial.polyval(on, coupling.coefficients)
            follows += sum(factor * values[other][0] for other, factor in coupling.others)
            whole = 2.0 * np.pi * np.round((follows - values[joint]) / (2.0 * np.pi))
            values[joint] = values[joint] + whole
