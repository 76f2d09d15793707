"""What all pages of this room share: templates, figures and words around the numbers."""

from __future__ import annotations

import base64
import platform
import re
from collections.abc import Mapping
from datetime import datetime
from importlib import resources
from importlib.metadata import version
from typing import Any

from p3dof._base.checks import shown
from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.tables import table_html

PACKAGES = ("p3dof", "pin", "numpy", "scipy", "matplotlib", "Jinja2")
_INSTANT = "at t [s]"
"""The column of tables that has instants."""
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


def template(name: str) -> Any:
    """Return a template of this room.

    Parameters
    ----------
    name : str
        Its file.

    Returns
    -------
    jinja2.Template

    Raises
    ------
    MissingExtraError
        As `require_reports`.
    """
    require_reports()
    import jinja2
    import markupsafe  # Jinja2's own

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_text_of),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["table"] = lambda table: markupsafe.Markup(table_html(table))  # noqa: S704 - it has escaped its texts
    environment.filters["linked"] = lambda table: markupsafe.Markup(linked(table_html(table)))  # noqa: S704 - likewise
    return environment.get_template(name)


def require_reports() -> None:
    """Raise `MissingExtraError` if Jinja2 or matplotlib is not installed, before the work begins."""
    try:
        import jinja2  # noqa: F401 - it is tried
        import matplotlib.figure  # noqa: F401 - a page without figures is none
    except ImportError as error:
        missing = error.name or "Jinja2 and matplotlib"
        raise MissingExtraError(f"a report needs {missing}: pip install 'p3dof[report]'") from error


def _text_of(name: str) -> str:
    return resources.files("p3dof.report").joinpath(name).read_text(encoding="utf-8")


def rendered(page: Any, words: Mapping[str, Any]) -> str:
    """Return a template with words in it, as text that UTF-8 can write: names of files may not be text."""
    text: str = page.render(words)
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def versions() -> dict[str, str]:
    """Return the versions of what a report was made with."""
    found = {name: version(name) for name in PACKAGES}
    return {
        **found,
        "Python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def dated(date: datetime | None) -> str:
    """Return a date in words; now without one."""
    if date is not None and not isinstance(date, datetime):
        raise InputError(f"date: expected a datetime, got {shown(date)}")
    when = datetime.now().astimezone() if date is None else date
    return when.isoformat(sep=" ", timespec="seconds")


def texts(**given: str | None) -> None:
    """Refuse arguments that are no text."""
    for name, text in given.items():
        if text is not None and not isinstance(text, str):
            raise InputError(f"{name}: expected text, got {shown(text)}")


def data_uri(picture: bytes) -> str:
    """Return a picture (PNG) as an address."""
    if not isinstance(picture, bytes):
        raise InputError(f"picture: expected the bytes of a PNG, got {shown(picture)}")
    return f"data:image/png;base64,{base64.b64encode(picture).decode('ascii')}"


def linked(table: str) -> str:
    """Return a table as HTML whose instants, "at t [s]", lead to the page of the report.

    Parameters
    ----------
    table : str
        As of `p3dof._base.tables.table_html`.

    Returns
    -------
    str
    """
    names = re.findall(r'<th scope="col">(.*?)</th>', table)
    if _INSTANT not in names:
        return table
    column = names.index(_INSTANT) - 1  # the first is the name of the row

    def led(row: re.Match[str]) -> str:
        cells = row[0].split("<td>")
        value, end, rest = cells[1 + column].partition("</td>")
        if _NUMBER.fullmatch(value):
            cells[1 + column] = f'<a href="#t={value}">{value}</a>{end}{rest}'
        return "<td>".join(cells)

    return re.sub(r'<tr><th scope="row">.*?</tr>', led, table)
