"""`Page`: a document as a page, to be written into a file or shown in a notebook."""

from __future__ import annotations

import html
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from p3dof._base.files import suffix_of, write_atomic
from p3dof.viewer.document.html import page_html

HEIGHT = 760
"""Of a page in a notebook or a report [pixels]."""


class Page:
    """One page of the browser: a machine with its runs and forces, in one file that needs nothing else.

    In a notebook it shows itself, and is kept in the notebook's file: about a megabyte a cell.

    Parameters
    ----------
    document : dict
        What it shows, as of `p3dof.viewer.document.page_document`.

    Attributes
    ----------
    document : dict
        Likewise.
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
        """Write the page into a file, whole or not at all.

        Parameters
        ----------
        path : path-like
            The file, whose name ends in ``.html``; missing folders are made.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        FileError
            If the file cannot be written.
        InputError
            If the name ends in something else.
        """
        suffix_of(path, "animation")
        return write_atomic(path, self.html)

    def frame(self, height: str | None = None, **attributes: str) -> str:
        """Return the page in a frame of another page, in which it can reach nothing.

        Parameters
        ----------
        height : str, optional
            As in CSS; `HEIGHT` without it.
        **attributes : str
            Of the frame, such as ``id``.

        Returns
        -------
        str
            HTML.
        """
        size = f"{HEIGHT}px" if height is None else height
        more = "".join(f' {name}="{html.escape(value)}"' for name, value in attributes.items())
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" sandbox="allow-scripts allow-downloads" '
            f'title="{html.escape(str(self.document["title"]))}" '
            f'style="display: block; width: 100%; height: {size}; border: 0"{more}></iframe>'
        )

    def _repr_html_(self) -> str:
        return self.frame()
