"""Tables as plain data, and as HTML.

Each room makes the tables of its own results; `report` prints them in a page, `cli` on a terminal, and
notebooks show them.
"""

from p3dof._base.tables.html import ShownInNotebook, html_of, notebook_html, table_html
from p3dof._base.tables.table import NONE, Cell, Table, fixed, number, percent, table_of, time_text

__all__ = [
    "NONE",
    "Cell",
    "ShownInNotebook",
    "Table",
    "fixed",
    "html_of",
    "notebook_html",
    "number",
    "percent",
    "table_html",
    "table_of",
    "time_text",
]
