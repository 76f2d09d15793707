"""What all pages of this room share: templates, figures and words around the numbers."""

from __future__ import annotations

import base64
import os
import platform
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import shown
from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.tables import table_html
from p3dof.analysis.energy import Energy
from p3dof.analysis.reactions import AnyReactions
from p3dof.machine.parameters import LEGS
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics
from p3dof.report import plots
from p3dof.report.plots.common import encoded, laid_out
from p3dof.report.plots.forces import joints_figure
from p3dof.report.plots.mechanism import mechanism_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PACKAGES = ("p3dof", "pin", "numpy", "scipy", "matplotlib", "Jinja2")
_INSTANT = "at t [s]"  # the column of tables that has instants
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


def template(name: str) -> Any:
    """Return a template of this room."""
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


def write_report(path: str | os.PathLike[str], make: Callable[[], str]) -> Path:
    """Write a page of this room to a file, as HTML or printed to a PDF; other names are refused first."""
    printed = suffix_of(path, "report") == ".pdf"
    text = make()
    if not printed:
        return write_atomic(path, text)
    from p3dof.viewer.headless import pdf_of

    return write_atomic(path, pdf_of(text))


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


@dataclass(frozen=True)
class Heading:
    """What stands around the numbers of a page; it is checked before the work begins."""

    title: str | None = None  # in place of the page's own
    about: Mapping[str, str] | None = None  # what it is about, by topic
    command: str | None = None  # that made the page
    page: str | None = None  # HTML in which the machine moves, to be opened from this one
    picture: bytes | None = None  # PNG
    date: datetime | None = None  # now without one

    def words(self, title: str) -> dict[str, Any]:
        """Return the words of a template, with the page's own title."""
        for name in ("title", "command", "page"):
            if not isinstance(text := getattr(self, name), str | None):
                raise InputError(f"{name}: expected text, got {shown(text)}")
        return {
            "title": title if self.title is None else self.title,
            "about": dict(self.about or {}),
            "command": self.command,
            "page": self.page,
            "picture": None if self.picture is None else data_uri(self.picture),
            "date": dated(self.date),
            "versions": versions(),
        }


def data_uri(picture: bytes) -> str:
    """Return a picture (PNG) as an address."""
    if not isinstance(picture, bytes):
        raise InputError(f"picture: expected the bytes of a PNG, got {shown(picture)}")
    return f"data:image/png;base64,{base64.b64encode(picture).decode('ascii')}"


def linked(table: str) -> str:
    """Return a table as HTML whose instants, "at t [s]", lead to the page of the report."""
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


@dataclass(frozen=True)
class Picture:
    """A picture for a page."""

    source: str  # its address: a data URI with the whole picture
    alternative: str  # what it shows, for who cannot see it
    caption: str  # what stands below it
    width: int  # its size [px]
    height: int


@dataclass(frozen=True)
class Pictures:
    """The pictures of a report."""

    mechanism: Picture  # one of each figure
    joints: Picture
    forces: Picture
    energy: Picture
    reactions: Picture


def pictures_of(
    robot: Manipulator,
    results: tuple[InverseDynamics, InverseDynamics],
    energy: Energy,
    reactions: AnyReactions,
) -> Pictures:
    """Draw the figures of a report."""
    first = results[0]
    motion, row = first.motion, int(np.argmax(first.valid))
    y, z, theta = motion.pose[row]
    peaks, work = _peaks(first), _work(energy)
    span = f"from t = {motion.time[0]:g} to {motion.time[-1]:g} s"
    return Pictures(
        mechanism=picture(
            mechanism_figure(robot, motion.pose[row], motion),
            "Drawing of the mechanism from the front, the side, the top and at an angle, with the joints "
            f"A1 to C7, at y = {y:.4g} m, z = {z:.4g} m, θ = {theta:.4g} rad.",
            f"The mechanism at t = {motion.time[row]:g} s, from the front, the side and the top at one "
            "scale, and the path of P. Guides are drawn in the background.",
        ),
        joints=picture(
            joints_figure(first),
            f"Positions, velocities and accelerations of the three sliders and the seven hinges {span}.",
            "Sliders and passive joints: positions, velocities and accelerations.",
        ),
        forces=picture(
            plots.forces_figure(list(results)),
            f"Forces of the three actuators {span} by both methods, and their difference. {peaks}",
            "Actuator forces by both methods (for the paper's motion its Figs. 3–5), and their difference.",
        ),
        energy=picture(
            plots.energy_figure(energy),
            f"Energy, kinetic energy by bodies, and power of the actuators {span}. {work}",
            "Change of the energy and the work done, kinetic energy by bodies, power of the actuators.",
        ),
        reactions=picture(
            plots.reactions_figure(reactions),
            f"Resultant force and moment in each of the thirteen joints {span}.",
            "Resultant forces and moments in the joints. Of what rigid bodies leave open, solid lines are "
            "what elastic joints bear, dashed and dotted ones the results of two idealisations.",
        ),
    )


def _peaks(result: InverseDynamics) -> str:
    if not result.possible:
        return "Shaded where the machine cannot perform the motion."
    peaks = zip(LEGS, result.peak_forces, strict=True)
    return f"Peaks: {', '.join(f'{leg} {force:.4g} N' for leg, force in peaks)}."


def _work(energy: Energy) -> str:
    if not energy.valid.all():
        return "Shaded where the machine cannot perform the motion."
    given, taken = energy.drives.positive_work.sum(), -energy.drives.negative_work.sum()
    return f"The actuators supply {given:.4g} J and regenerate {taken:.4g} J."


def picture(figure: Figure, alternative: str, caption: str) -> Picture:
    """Draw a figure as SVG, the same bytes each time."""
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "p3dof", "svg.fonttype": "path"}), laid_out(figure):
        data = base64.b64encode(encoded(figure, "svg")).decode("ascii")
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return Picture(f"data:image/svg+xml;base64,{data}", alternative, caption, width, height)
