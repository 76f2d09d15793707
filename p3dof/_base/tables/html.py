"""Tables as HTML: for the report, and for results in a notebook. All texts are escaped."""

from __future__ import annotations

from collections.abc import Iterable
from functools import singledispatch
from html import escape

from p3dof._base.tables.table import Table

_STYLE = """
.p3dof { font-variant-numeric: tabular-nums; color: inherit; }
.p3dof p { margin: .3em 0; }
.p3dof .scroll { overflow-x: auto; margin: .6em 0 .2em; }
.p3dof table { border-collapse: collapse; margin: 0; background: none; color: inherit; font-size: inherit; }
.p3dof caption { text-align: left; font-weight: 600; color: inherit; padding: .2em 0; white-space: nowrap; }
.p3dof tr, .p3dof tr:hover { background: none !important; }
.p3dof th, .p3dof td { color: inherit; background: none; text-align: right; padding: .2em .7em;
  white-space: nowrap; border: 0 solid currentColor;
  border-color: color-mix(in srgb, currentColor 30%, transparent); }
.p3dof tbody :is(th, td) { border-bottom-width: 1px; }
.p3dof thead th { border-bottom-width: 2px; font-weight: 600; vertical-align: bottom; white-space: normal; }
.p3dof table.wide { font-size: .9em; }
.p3dof table.wide :is(th, td):not(:first-child) { padding: .2em .5em; }
.p3dof :is(th, td):first-child { text-align: left; padding-left: 0; }
.p3dof tbody th { font-weight: 400; }
.p3dof table.words :is(th, td) { text-align: left; }
.p3dof .note { opacity: .75; font-size: .9em; max-width: 60em; }
.p3dof ul { margin: .4em 0; padding-left: 1.2em; }
.p3dof .care { border-left: .3em solid currentColor; padding: .1em .8em; margin: .5em 0; }
"""
"""Only colours of the page that it stands in: it may be dark or light."""


def table_html(table: Table) -> str:
    """Return a table as HTML, in a box that can be scrolled, with its note below.

    Parameters
    ----------
    table : Table
        Without rows, only its title and its note are shown.

    Returns
    -------
    str
    """
    wide = table.layout == "wide"
    region = f' tabindex="0" role="region" aria-label="{escape(table.title)}"' if wide else ""
    layout = "words" if table.layout == "list" else table.layout
    kind = "" if layout == "plain" else f' class="{layout}"'
    lines = [f'<div class="scroll"{region}>', f"<table{kind}>", f"<caption>{escape(table.title)}</caption>"]
    if table.rows:
        names = "".join(f'<th scope="col">{escape(name)}</th>' for name in table.header)
        lines += [f"<thead><tr>{names}</tr></thead>", "<tbody>"]
        for name, *cells in table.texts():
            values = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
            lines.append(f'<tr><th scope="row">{escape(name)}</th>{values}</tr>')
        lines.append("</tbody>")
    lines += ["</table>", "</div>"]
    if table.note:
        lines.append(f'<p class="note">{escape(table.note)}</p>')
    return "\n".join(lines) + "\n"


def notebook_html(
    title: str, facts: str, tables: Iterable[Table], warnings: Iterable[str] = (), remark: str = ""
) -> str:
    """Return how a notebook shows a result: what it is, warnings, then tables.

    Parameters
    ----------
    title : str
        What it is.
    facts : str
        About all of it, in one line.
    tables : iterable of Table
        Its numbers.
    warnings : iterable of str
        What a reader of these numbers should know.
    remark : str
        What stands below the tables.

    Returns
    -------
    str
        Colours are those of the notebook, dark or light.
    """
    lines = [f"<style>{_STYLE}</style>", f"<p><strong>{escape(title)}</strong>: {escape(facts)}</p>"]
    items = "".join(f"<li>{escape(warning)}</li>" for warning in warnings)
    if items:
        lines.append(f'<div class="care" role="note"><strong>To be looked at</strong><ul>{items}</ul></div>')
    lines += [table_html(table) for table in tables]
    if remark:
        lines.append(f'<p class="note">{escape(remark)}</p>')
    text = f'<div class="p3dof">{"".join(lines)}</div>'
    return text.encode("utf-8", "backslashreplace").decode("utf-8")  # names of files may not be text


@singledispatch
def html_of(result: object) -> str:
    """Return how a notebook shows a result: the tables of each room say it for their own."""
    raise NotImplementedError(f"a notebook has no form for {type(result).__name__}")


class ShownInNotebook:
    """Base of the results that a notebook shows as tables."""

    def _repr_html_(self) -> str:
        return html_of(self)
