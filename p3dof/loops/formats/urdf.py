"""URDF and what goes with it: the tree by Pinocchio, its loops from the file itself and from a sidecar."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace

import pinocchio as pin

from p3dof._base.checks import shown
from p3dof._base.errors import InputError, ModelWarning
from p3dof.loops.formats.joint_types import with_types
from p3dof.loops.formats.urdf_tags import Declared, declared, tying_plugins
from p3dof.loops.open_ends import open_ends
from p3dof.loops.passive import losses_of, with_armature
from p3dof.loops.sidecar import Sidecar, SidecarLike, sidecar_of
from p3dof.loops.urdf import build_tree
from p3dof.loops.xml_text import is_text, read_xml


def read(
    source: str | os.PathLike[str],
    closures: SidecarLike = None,
    root_joint: pin.JointModel | None = None,
    mimic: bool = True,
    on_unknown: str = "raise",
    passive: bool = False,
) -> tuple[pin.Model, Sidecar]:
    """Return the tree of a URDF and its loops.

    Parameters
    ----------
    source : str or path-like
        XML text or the path of a file.
    closures : Sidecar, mapping, str or path-like, optional
        Loops and actuated joints that the file does not hold; an empty tuple for none, and for no warning of
        an open tree that looks as if it had loops.
    root_joint : pin.JointModel, optional
        The joint between the world and the root link; by default the root link is fixed.
    mimic : bool
        Whether ``<mimic>`` couples joints.
    on_unknown : {"raise", "ignore"}
        What to do with elements that look like loops and are not understood.
    passive : bool
        Whether damping and friction of the URDF act.

    Returns
    -------
    model : pin.Model
    sidecar : Sidecar
        Of the given one and of the file: closures and couplings together. Actuated are those joints that the
        sidecar names; else all that have one degree of freedom and that the file does not call dependent.

    Raises
    ------
    ModelError
        If a file is malformed or too large, or a loop in it is not understood.
    InputError
        If `root_joint` is not a joint model, or `on_unknown` is something else.
    """
    sidecar, is_tree = sidecar_of(closures), isinstance(closures, tuple) and not closures
    if root_joint is not None and not hasattr(root_joint, "nq"):
        raise InputError(f"root_joint: expected a pinocchio joint model, got {type(root_joint).__name__}")
    if on_unknown not in ("raise", "ignore"):
        raise InputError(f"on_unknown: expected 'raise' or 'ignore', got {shown(on_unknown)}")
    text, name = read_xml(source)
    model, robot, line_of = build_tree(text, name, root_joint)
    ignore = on_unknown == "ignore"
    found = declared(robot, model, name, mimic, line_of, ignore_unknown=ignore)
    given = () if sidecar is None else sidecar.couplings
    tied = {*found.dependent, *(coupling.joint for coupling in given)}
    free = {str(joint) for joint in model.names} - tied if mimic else set()
    for element, words in () if ignore else tying_plugins(robot, free):
        warnings.warn(f"{name}, line {line_of(element)}: {words}", ModelWarning, stacklevel=3)
    if sidecar is None:
        sign = "" if is_tree or found.closures else open_ends(None if is_text(source) else name, robot, model)
        if sign:
            warnings.warn(
                f"the URDF is read as an open tree, but {sign}: give them as closures, "
                "or closures=() if it is a tree",
                ModelWarning,
                stacklevel=3,
            )
        return model, _acting(model, _completed(Sidecar.serial(model), found), passive, found)
    if sidecar.joints:
        model = with_types(model, sidecar.joints, "sidecar")
    whole = replace(
        sidecar,
        closures=(*sidecar.closures, *found.closures),
        couplings=(*sidecar.couplings, *_new(found, sidecar)),
    )
    return model, _acting(model, whole, passive, found)


def _acting(model: pin.Model, sidecar: Sidecar, passive: bool, found: Declared) -> Sidecar:
    """Return a sidecar with what acts in the joints; rotors go to the tree. It goes before the file."""
    said = {entry.joint for entry in sidecar.joint_data}
    sidecar = replace(
        sidecar, joint_data=(*sidecar.joint_data, *(one for one in found.rotors if one.joint not in said))
    )
    said |= {entry.joint for entry in sidecar.joint_data}
    more = [entry for entry in losses_of(model) if entry.joint not in said] if passive else []
    return replace(sidecar, joint_data=(*with_armature(model, sidecar.joint_data), *more))


def _completed(serial: Sidecar, found: Declared) -> Sidecar:
    actuated = tuple(name for name in serial.actuated if name not in found.dependent)
    return Sidecar(tuple(found.closures), actuated, tuple(found.couplings))


def _new(found: Declared, sidecar: Sidecar) -> list:
    """Return the couplings of the file for joints that the sidecar does not couple itself."""
    coupled = {coupling.joint for coupling in sidecar.couplings}
    return [coupling for coupling in found.couplings if coupling.joint not in coupled]
