"""Documents of a mechanism: what all formats of the exported model begin with."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from p3dof._base.errors import ModelError
from p3dof._base.markup import text
from p3dof.machine.description.mechanism import Joint, Mechanism


def require_no_drive(joint: Joint, form: str, armature: bool = False) -> None:
    """Refuse what motor and balance add in a joint, where a format has no word for it.

    Parameters
    ----------
    joint : Joint
        The joint.
    form : str
        The format, for the error.
    armature : bool
        Whether it can hold the inertia of a motor.

    Raises
    ------
    ModelError
        If it cannot hold what the joint has.
    """
    what = "an inertia of its motor" if joint.armature and not armature else "a balance"
    if joint.balanced or (joint.armature and not armature):
        raise ModelError(
            f"{form} has no word for {what}, which {joint.name} has; MJCF and URDF with its YAML do"
        )


def document(root: ET.Element, mechanism: Mechanism, comment: str) -> str:
    """Return the text of an XML file: declaration, comment, indented elements.

    Parameters
    ----------
    root : Element
        The root element.
    mechanism : Mechanism
        What it describes: named in the comment.
    comment : str
        What a reader should know.

    Returns
    -------
    str
    """
    note = f"{mechanism.name}, written by p3dof: change the parameters, not this file. {comment}"
    return text.document(root, note)
