"""What axe finds in the pages of Sphinx and its theme is mended here; see ``tests/built_docs.py``."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

PARAMETERS = re.compile(r'<dl>\n((?:<dd><em class="sig-param">.*?</dd>\n?)+)</dl>', re.DOTALL)
"""A signature of several lines, which is no list of definitions."""


def _lines(found: re.Match[str]) -> str:
    lines = found[1].replace("<dd>", '<div class="sig-line">').replace("</dd>", "</div>")
    return f"<div>\n{lines}</div>"


def mend(_app: Sphinx, _page: str, _template: str, context: dict[str, Any], _doctree: Any) -> None:
    """Write signatures without definitions, and name what opens a part of the navigation."""
    if "body" in context:
        context["body"] = PARAMETERS.sub(_lines, context["body"])
    made = context.get("generate_toctree_html")
    if made:
        context["generate_toctree_html"] = lambda *given, **options: str(made(*given, **options)).replace(
            "<summary>", '<summary aria-label="Pages below">'
        )


def setup(app: Sphinx) -> dict[str, bool]:
    """Mend pages after the theme."""
    app.connect("html-page-context", mend, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
