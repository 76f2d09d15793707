"""What all figures share: colours, and how they are made and written."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.files import suffix_of, write_atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

Place: TypeAlias = "Axes | SubFigure | None"
"""Where to draw in a figure of the caller's; None for a new one."""

COLOURS = ("#0072b2", "#d55e00", "#009e73")
"""Colours of the legs A, B, C: distinct for colour-blind readers and in grey print."""


RESOLUTION = 160  # of pictures that are made of points [per inch]

TICKS = 6  # most intervals between the ticks of an axis

GAP = "not possible"
"""What legends call the hatched times without valid samples: out of reach, or near a singularity."""

GAP_STYLE: dict[str, Any] = {"facecolor": "0.94", "edgecolor": "0.75", "hatch": "////", "lw": 0, "zorder": -1}


def save(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write a figure; the ending of the name chooses the format (png, svg, pdf).

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    path : path-like
        The file; replaced whole or not at all.

    Raises
    ------
    FileError
        If the file cannot be written.
    InputError
        If the ending is not a format that matplotlib writes.
    """
    return save_all(figure, [path])[0]


def save_all(figure: Figure, paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Write a figure to several files, as `save` writes one; it is laid out only once."""
    files = {path: suffix_of(path, "figure").lstrip(".") for path in paths}
    with laid_out(figure):
        return [write_atomic(path, encoded(figure, kind)) for path, kind in files.items()]


@contextmanager
def laid_out(figure: Figure) -> Iterator[None]:
    """Lay a figure out once for all that is drawn in this block."""
    engine, dpi, canvas = figure.get_layout_engine(), figure.dpi, figure.canvas
    for axis in figure.axes:
        if not any(axis.get_title(side) for side in ("left", "center", "right")):
            axis.set_title("", y=1.0)  # else each drawing makes ticks to look where it would stand
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")
    try:
        yield
    finally:
        figure.set_layout_engine(engine)
        figure.set_dpi(dpi)
        figure.set_canvas(canvas)


def encoded(figure: Figure, kind: str) -> bytes:
    """Draw a figure that is laid out, once: `savefig` would draw it twice."""
    stream = io.BytesIO()
    if kind == "svg":
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        FigureCanvasSVG(figure).print_svg(stream, metadata={"Date": None})  # type: ignore[no-untyped-call]
        return _lighter(stream.getvalue().decode()).encode()
    if kind == "pdf":
        from matplotlib.backends.backend_pdf import FigureCanvasPdf

        FigureCanvasPdf(figure).print_pdf(stream)  # type: ignore[no-untyped-call]
    else:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        figure.set_dpi(RESOLUTION)
        FigureCanvasAgg(figure).print_png(stream)  # type: ignore[no-untyped-call]
    return stream.getvalue()


_REMARKS = re.compile(r"<!--.*?-->\s*|<metadata>.*?</metadata>\s*", re.DOTALL)
_NAMES = re.compile(r' id="[\w.]+_\d+"')
_CORNER = re.compile(r"([MLQC] -?\d+(?:\.\d\d?)?)\d*( -?\d+(?:\.\d\d?)?)\d*")
_PLACE = re.compile(r'( [xy]="-?\d+\.\d\d)\d+')


def _lighter(svg: str) -> str:
    """Return a picture without what nobody sees: digits below a hundredth of a point, names, blanks."""
    svg = _CORNER.sub(r"\1\2", _PLACE.sub(r"\1", _NAMES.sub("", _REMARKS.sub("", svg))))
    for command in "MLQCz":
        svg = svg.replace(f" \n{command}", command)
    return re.sub(r"\n +", "\n", svg)


def new_figure(figsize: tuple[float, float], ax: Place = None) -> Figure:
    """Return an empty figure of a size in inches; with `ax`, a part of its figure in place of it."""
    require_figures()
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

    from p3dof.report.plots.layout import Panels

    if ax is None:
        return Figure(figsize=figsize, layout=Panels())
    if isinstance(ax, FigureBase):
        return cast("Figure", ax)
    place = ax.get_subplotspec() if isinstance(ax, Axes) else None
    if place is None:
        raise InputError(f"ax: expected Axes of plt.subplots, or a SubFigure, got {shown(ax)}")
    figure = ax.figure
    ax.remove()
    return cast("Figure", figure.add_subfigure(place))


def above(figure: Figure) -> str:
    """Return where a legend stands above the panels: in a figure of the caller's, its layout makes room."""
    from matplotlib.figure import Figure as Whole

    return "upper center" if isinstance(figure, Whole) else "outside upper center"


def require_figures() -> None:
    """Find out whether figures can be drawn, before the work for them begins."""
    try:
        import matplotlib.figure  # noqa: F401 - it is tried
    except ImportError as error:
        raise MissingExtraError("figures need matplotlib: pip install 'p3dof[plot]'") from error
    except (
        ValueError
    ) as error:  # matplotlib refuses its own settings, such as MPLBACKEND, when it is imported
        raise InputError(f"matplotlib cannot start: {error}") from error


def few_ticks(axis: Axes) -> None:
    """Give a panel about six ticks each way: each is drawn as five things, which is most of the work."""
    if axis.get_xscale() == "linear":
        axis.locator_params("x", nbins=TICKS)
    if axis.get_yscale() == "linear":
        axis.locator_params("y", nbins=TICKS)


def tidy(axis: Axes) -> None:
    """Give a panel its grid and few ticks, and take its frame away."""
    few_ticks(axis)
    axis.grid(color="0.9", lw=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.margins(x=0.01)


def line(axis: Axes, time: FloatArray, values: FloatArray, valid: NDArray[np.bool_], **style: Any) -> None:
    """Draw a curve of the valid samples, with gaps; those without a valid neighbour are dots."""
    beside = np.concatenate([[False], valid, [False]])
    alone = np.flatnonzero(valid & ~beside[:-2] & ~beside[2:])
    dots = {"marker": "o", "ms": 4, "markevery": alone.tolist()} if len(alone) else {}
    axis.plot(time, np.where(valid, values, np.nan), **{"lw": 1.4, **dots, **style})


def shade_gaps(axis: Axes, time: FloatArray, valid: NDArray[np.bool_]) -> None:
    """Hatch where no sample is valid, up to the samples beside it: the axis keeps the whole time."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], valid, [True]])))
    last = len(time) - 1
    for number, (start, stop) in enumerate(edges.reshape(-1, 2)):
        left, right = float(time[max(start - 1, 0)]), float(time[min(stop, last)])
        label = GAP if number == 0 else None
        axis.axvspan(left, right, **GAP_STYLE, label=label)
