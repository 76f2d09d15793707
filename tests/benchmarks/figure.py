"""The figure: time a sample against the size of the batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from batch import BEST, CURVE
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter
from others import BARE, BATCH_POSE, BATCH_QVA, FEW, MANY, OTHERS, SAMPLE_CALL, SAMPLE_POSE, SAMPLE_QVA
from rounds import Timing

from p3dof.report.plots.common import new_figure, save, tidy

INK = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f")
DASHES = ("-", "--", "-.", (0, (1, 1.2)), (0, (5, 1, 1, 1, 1, 1)))
MARKS = "osD^vPX"
POINTS = {
    SAMPLE_CALL: (1, "Pinocchio, one sample a call"),
    SAMPLE_POSE: (FEW, "Pinocchio, sample by sample, from the pose"),
    SAMPLE_QVA: (FEW, "Pinocchio, sample by sample, q, v, a given"),
    BATCH_POSE: (MANY, "Pinocchio, batch, from the pose"),
    BATCH_QVA: (MANY, "Pinocchio, batch, q, v, a given"),
}
APART = 0.155
"""Least distance of two labels, in decades."""


def draw(
    timings: Mapping[tuple[str, str, str], Timing], bound: float | None, caption: str, folder: Path
) -> list[Path]:
    """Write the figure as SVG and PNG."""
    figure = new_figure((9.0, 6.2))
    axis = figure.subplots()
    machine = "symmetric"
    lines: dict[str, list[tuple[int, float]]] = {}
    for group, name, _ in timings:
        if group == CURVE:
            line, _, count = name.rpartition(" @ ")
            lines.setdefault(line, []).append((int(count), timings[group, name, machine].median))
    largest = max(count for points in lines.values() for count, _ in points)
    ends = [_line(axis, i, name, sorted(points)) for i, (name, points) in enumerate(lines.items())]
    ends.append(_level(axis, timings[OTHERS, BARE, machine].median, "one bare pin.rnea call", largest))
    if bound is not None:
        ends.append(_level(axis, bound, f"port bound, {BEST}, 1 core", largest))
    _points(axis, timings, machine)
    axis.set(xscale="log", yscale="log", xlim=(0.8, largest * 1.3))
    axis.set_xlabel("samples in a batch")
    axis.set_ylabel("time per sample")
    axis.yaxis.set_major_formatter(EngFormatter(unit="s", sep="\N{NO-BREAK SPACE}"))
    axis.yaxis.set_major_locator(LogLocator(numticks=12))
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.xaxis.set_major_locator(LogLocator(numticks=12))
    tidy(axis)
    _labels(axis, ends, largest)
    axis.set_title(
        "Inverse dynamics of the paper's machine: pose, velocity, acceleration to three forces", loc="left"
    )
    figure.supxlabel(caption, fontsize=7, color="0.35")
    return [save(figure, folder / f"batch-sizes.{kind}") for kind in ("svg", "png")]


def _line(
    axis: Axes, i: int, name: str, points: Sequence[tuple[int, float]]
) -> tuple[float, float, str, str]:
    counts, seconds = zip(*points, strict=True)
    colour = INK[i % len(INK)]
    axis.plot(
        counts,
        seconds,
        color=colour,
        ls=DASHES[i % len(DASHES)],
        marker=MARKS[i % len(MARKS)],
        ms=3.5,
        lw=1.4,
    )
    return counts[-1], seconds[-1], name.replace("columns, ", "kernel on columns, "), colour


def _level(axis: Axes, seconds: float, name: str, largest: int) -> tuple[float, float, str, str]:
    axis.axhline(seconds, color="0.55", lw=0.8, ls=(0, (2, 3)), zorder=0)
    return largest, seconds, name, "0.4"


def _points(axis: Axes, timings: Mapping[tuple[str, str, str], Timing], machine: str) -> None:
    for name, (count, text) in POINTS.items():
        seconds = timings[OTHERS, name, machine].median
        axis.plot([count], [seconds], marker="*", ms=9, color="0.15", ls="none")
        axis.annotate(
            text, (count, seconds), (7, 0), textcoords="offset points", fontsize=8, va="center", color="0.15"
        )


def _labels(axis: Axes, ends: Sequence[tuple[float, float, str, str]], largest: int) -> None:
    """Write the names beside the ends of the lines, moved apart where they would overlap."""
    ordered = sorted(ends, key=lambda end: end[1])
    places: list[float] = []
    for _, seconds, *_ in ordered:
        at = float(np.log10(seconds))
        places.append(at if not places else max(at, places[-1] + APART))
    for (count, seconds, name, colour), place in zip(ordered, places, strict=True):
        axis.annotate(
            name,
            (count, seconds),
            (largest * 2.0, 10**place),
            fontsize=8,
            va="center",
            color=colour,
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "lw": 0.5,
                "alpha": 0.6,
                "shrinkA": 1,
                "shrinkB": 2,
            },
        )
