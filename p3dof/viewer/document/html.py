"""A document as a page: the built template with the numbers in it, in one file that needs nothing else."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from p3dof._base.errors import FileError
from p3dof.codegen.wasm_section import section_of

_PLACES = ("@@TITLE@@", "@@ENGINE@@", "@@DOCUMENT@@")
"""What is filled in, in the order of the template."""


_POLICY = "content=\"default-src 'none'; "
"""How the policy of the template begins."""


def page_html(document: Mapping[str, Any], connection: str = "", hosts: Sequence[str] = ()) -> str:
    """Return a page that shows a document.

    Parameters
    ----------
    document : dict
        Of format 1, with arrays as they are encoded in it. A document whose engine is "p3dof" takes the
        WebAssembly of the generated C with it.
    connection : str
        How the page finds a Python behind it: ``"server N"`` or ``"parent N"``, where N counts what was sent;
        without it the page is alone.
    hosts : sequence of str
        Which the page may connect to, such as ``"ws://127.0.0.1:7000"``.

    Returns
    -------
    str
        HTML with all scripts, styles and numbers in it; it asks for nothing outside.

    Raises
    ------
    FileError
        If a file of the package is not as it was installed.
    """
    engine = ""
    if document.get("engine", {}).get("kind") == "p3dof":
        wasm = _installed("p3dof.wasm")
        if not section_of(wasm):  # it is the end of the file
            raise _damaged("p3dof.wasm")
        engine = base64.b64encode(wasm).decode("ascii")
    values = (html.escape(str(document["title"])), engine, _data(document))
    return filled(_template(connection, hosts), dict(zip(_PLACES, values, strict=True)))


def template(name: str, places: Sequence[str]) -> str:
    """Return a page of this package, with places to fill.

    Parameters
    ----------
    name : str
        The file.
    places : sequence of str
        What is filled in; `page/build.mjs` sees that each is there once.

    Returns
    -------
    str

    Raises
    ------
    FileError
        If the file is not as it was installed.
    """
    text = _installed(name).decode("utf-8", "replace")
    if any(text.count(place) != 1 for place in places) or not text.endswith("</html>\n"):
        raise _damaged(name)
    return text


def filled(text: str, values: Mapping[str, str]) -> str:
    """Return a template with values in their places, which stand in this order."""
    parts = []
    for place, value in values.items():
        before, _, text = text.partition(place)
        parts += [before, value]
    return "".join((*parts, text))


def _installed(name: str) -> bytes:
    try:
        return (files(__package__) / name).read_bytes()
    except OSError as error:
        raise _damaged(name) from error


def _damaged(name: str) -> FileError:
    return FileError(f"{files(__package__) / name}: is not as it was installed; install p3dof again")


def _template(connection: str, hosts: Sequence[str]) -> str:
    """Return the template, which may connect to hosts and knows how."""
    text = template("page.html", _PLACES)
    if hosts:
        text = text.replace(_POLICY, f"{_POLICY}connect-src {' '.join(hosts)}; ", 1)
    if connection:
        mark = f'<meta name="p3dof-connection" content="{html.escape(connection)}">'
        text = text.replace("<title>", f"{mark}\n<title>", 1)
    return text


def _data(document: Mapping[str, Any]) -> str:
    """Return JSON that no parser of HTML takes for the end of a script, whatever texts are in it."""
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")
