"""Formulas as drawings in the page, set by matplotlib: no script, no font and no network is needed.

A formula that matplotlib cannot read fails the build.
"""

from __future__ import annotations

import re
from functools import cache
from html import escape
from typing import Any

from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.path import Path
from matplotlib.textpath import TextPath
from sphinx.application import Sphinx

SIZE = 100.0
"""Units of a drawing per em."""
FONT = FontProperties(size=SIZE, math_fontfamily="stix")
SCALE = 1.12
"""Formulas are set a little larger than the text, whose letters are larger for their size."""
SPELLINGS = {
    re.compile(r"\\frac(\d)(\d)"): r"\\frac{\1}{\2}",
    re.compile(r"\\sqrt(\d)"): r"\\sqrt{\1}",
    re.compile(r"\\([gl])e(?![a-z])"): r"\\\1eq",
}
"""Short forms of LaTeX that matplotlib does not read, and the long ones that it does."""
LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}


@cache
def drawn(latex: str, scale: float = SCALE) -> str:
    """Return a formula as SVG that stands on the line of the text and has its colour.

    Parameters
    ----------
    latex : str
        The formula, without dollars.
    scale : float
        Its size, of that of the text.

    Returns
    -------
    str
    """
    plain = " ".join(latex.split())
    for short, long in SPELLINGS.items():
        plain = short.sub(long, plain)
    text = f"${plain}$"
    width, height, depth = MathTextParser("path").parse(text, 72, FONT)[:3]
    parts = []
    for vertices, code in TextPath((0, 0), text, size=SIZE, prop=FONT).iter_segments(simplify=False):
        numbers = (f"{-x if index % 2 else x:.1f}" for index, x in enumerate(vertices))
        parts.append("Z" if code == Path.CLOSEPOLY else LETTERS[code] + " ".join(numbers))
    em = scale / SIZE
    return (
        f'<svg class="formula" role="img" aria-label="{escape(latex, quote=True)}" '
        f'viewBox="0 {-height:.1f} {width:.1f} {height + depth:.1f}" '
        f'style="width:{width * em:.3f}em;height:{(height + depth) * em:.3f}em;'
        f'vertical-align:{-depth * em:.3f}em"><path d="{"".join(parts)}"/></svg>'
    )


def _inline(translator: Any, node: nodes.Element) -> None:
    translator.body.append(drawn(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.Element) -> None:
    translator.body.append(f'<div class="formulas">{drawn(node.astext(), 1.2 * SCALE)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("drawn", inline_renderers=(_inline, None), block_renderers=(_block, None))
    app.config.html_math_renderer = "drawn"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
