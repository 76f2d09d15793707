"""A document as a page: in one file of HTML that needs nothing else, or in a notebook."""

from __future__ import annotations

import base64
import html
import json
import os
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from p3dof._base.errors import FileError
from p3dof._base.files import suffix_of, write_atomic
from p3dof.codegen.webassembly import section_of

_PLACES = ("@@TITLE@@", "@@ENGINE@@", "@@DOCUMENT@@")
"""What is filled in, in the order of the template."""


_POLICY = "content=\"default-src 'none'; "
"""How the policy of the template begins."""


def page_html(document: Mapping[str, Any], connection: str = "", hosts: Sequence[str] = ()) -> str:
    """Return a page that shows a document.

    HTML with all scripts, styles and numbers in it; it asks for nothing outside.
    """
    engine = ""
    if document.get("engine", {}).get("kind") == "p3dof":
        wasm = _installed("p3dof.wasm")
        if not section_of(wasm):  # it is the end of the file
            raise _damaged("p3dof.wasm")
        engine = base64.b64encode(wasm).decode("ascii")
    values = (html.escape(str(document["title"])), engine, as_script(document))
    return filled(_template(connection, hosts), dict(zip(_PLACES, values, strict=True)))


def template(name: str, places: Sequence[str]) -> str:
    """Return a page of this package, with places to fill."""
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


def as_script(value: object) -> str:
    """Return JSON that no parser of HTML takes for the end of a script, whatever texts are in it."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


HEIGHT = 760
"""Of a page in a notebook or a report [pixels]."""


def framed(page: str, title: str, height: str | None = None, **attributes: str) -> str:
    """Return a page in a frame of another page, in which it can reach nothing; HTML."""
    size = f"{HEIGHT}px" if height is None else height
    more = "".join(f' {name}="{html.escape(value)}"' for name, value in attributes.items())
    return (
        f'<iframe srcdoc="{html.escape(page)}" sandbox="allow-scripts allow-downloads" '
        f'title="{html.escape(title)}" style="display: block; width: 100%; height: {size}; border: 0"{more}>'
        "</iframe>"
    )


class Page:
    """One page of the browser: a machine with its runs and forces, in one file that needs nothing else.

    In a notebook it shows itself, and is kept in the notebook's file: about a megabyte a cell.
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.document = dict(document)

    def __repr__(self) -> str:
        runs = ", ".join(str(run["name"]) for run in self.document["runs"])
        return f"Page({self.document['title']}: {runs})"

    @property
    def html(self) -> str:
        """The page, with all that it needs."""
        return page_html(self.document)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page into a file, whole or not at all; the path written."""
        suffix_of(path, "animation")
        return write_atomic(path, self.html)

    def frame(self, height: str | None = None, **attributes: str) -> str:
        """Return the page in a frame of another page, in which it can reach nothing; HTML."""
        return framed(self.html, str(self.document["title"]), height, **attributes)

    def _repr_html_(self) -> str:
        return self.frame()
