"""A scene of MeshCat as one HTML file that needs nothing else: its own script, and what is drawn."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterable
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from p3dof._base.errors import MissingExtraError


def standalone(messages: Iterable[bytes], title: str = "p3dof") -> str:
    """Return a page that shows a scene with no network.

    Parameters
    ----------
    messages : iterable of bytes
        Packed commands, as of `SceneWindow.messages`.
    title : str
        Of the page.

    Returns
    -------
    str
        The HTML.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    """
    commands = [base64.b64encode(message).decode("ascii") for message in messages]
    return filled(
        resource("standalone.html"),
        TITLE=html.escape(title),
        MESHCAT=meshcat_script(),
        FIT=resource("page/fit.js"),
        LICENCES=html.escape(licences()),
        COMMANDS=as_script(commands),
    )


def filled(text: str, **parts: str) -> str:
    """Return a template with every ``@NAME@`` replaced, in one pass: what is put in is not searched."""
    for name in parts:
        text = text.replace(f"@{name}@", f"\0{name}\0")
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(text.split("\0")))


def as_script(value: Any) -> str:
    """Return plain data as JavaScript that may stand in a page."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def resource(name: str) -> str:
    """Return the text of a file of this package."""
    return (resources.files("p3dof.viewer") / name).read_text(encoding="utf-8")


def licences() -> str:
    """Return the notices of all whose JavaScript is in a page: MeshCat 0.3.2, and what its script holds.

    Whoever takes another MeshCat has to look again at what is in it; a test compares them.
    """
    return resource("page/licences.txt")


@cache
def meshcat_script() -> str:
    """Return MeshCat's JavaScript, from its package.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    """
    try:
        import meshcat
    except ImportError as error:
        raise MissingExtraError("the viewer needs meshcat: pip install 'p3dof[viz]'") from error
    path = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    return path.read_text(encoding="utf-8")
