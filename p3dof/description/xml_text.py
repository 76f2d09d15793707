"""Documents of a mechanism: what all formats of the exported model begin with."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from p3dof.description.mechanism import Mechanism
from p3dof.markup import text


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
