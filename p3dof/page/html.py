"""A document as a page: the built template with the numbers in it, in one file that needs nothing else."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

_PLACES = ("@@TITLE@@", "@@ENGINE@@", "@@DOCUMENT@@")
"""What is filled in, in the order of the template; `page/build.mjs` sees that each is there once."""


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
    """
    engine = ""
    if document.get("engine", {}).get("kind") == "p3dof":
        engine = base64.b64encode((files(__package__) / "p3dof.wasm").read_bytes()).decode("ascii")
    values = (html.escape(str(document["title"])), engine, _data(document))
    rest, parts = _template(connection, hosts), []
    for place, value in zip(_PLACES, values, strict=True):
        before, _, rest = rest.partition(place)
        parts += [before, value]
    return "".join((*parts, rest))


def _template(connection: str, hosts: Sequence[str]) -> str:
    """Return the template, which may connect to hosts and knows how."""
    text = (files(__package__) / "page.html").read_text("utf-8")
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
