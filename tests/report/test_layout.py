"""Where the panels of figures go: nothing overlaps or is cut off, and a figure is laid out and drawn once."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

import p3dof
from p3dof.report import plots
from p3dof.report.plots.common import encoded, laid_out
from p3dof.report.plots.forces import joints_figure
from p3dof.report.plots.layout import Panels

FIGURES = ("forces", "one", "joints", "energy", "reactions", "tracking")


def drawn(name, samples=61, scale=1.0):
    """One of the figures, of a machine whose masses are scaled."""
    bodies = p3dof.PAPER.bodies
    robot = p3dof.load(replace(p3dof.PAPER, bodies=bodies if scale == 1 else bodies.scaled(scale)))
    motion = p3dof.paper_motion(samples)
    first = robot.inverse_dynamics(motion, method="pinocchio")
    if name == "tracking":
        runs = {
            kind: robot.simulate(
                0.2,
                start=p3dof.runs.InitialState(motion.pose[0], motion.velocity[0]),
                controller=make(robot.parameters, motion),
                method="compiled",
            )
            for kind, make in (("pd", p3dof.runs.PD), ("computed torque", p3dof.runs.ComputedTorque))
        }
        return plots.tracking_figure(runs)
    if name in {"forces", "one"}:
        second = robot.inverse_dynamics(motion, method="virtual-power")
        return plots.forces_figure([first, second] if name == "forces" else [first])
    if name == "joints":
        return joints_figure(first)
    return (
        plots.energy_figure(robot.energy(first))
        if name == "energy"
        else plots.reactions_figure(robot.reactions(motion))
    )


def overlap(one, other):
    """How far two rectangles lie over each other, in both directions at least [px]."""
    wide = min(one.x1, other.x1) - max(one.x0, other.x0)
    high = min(one.y1, other.y1) - max(one.y0, other.y0)
    return min(wide, high)


@pytest.mark.parametrize("scale", [1.0, pytest.param(1e6, marks=pytest.mark.slow), 1e-6])
@pytest.mark.parametrize("name", FIGURES)
def test_nothing_overlaps_and_nothing_is_cut_off(name, scale):
    """Of panels with all that belongs to them, also when numbers have many digits."""
    if scale != 1 and name not in {"forces", "energy", "reactions"}:
        return
    figure = drawn(name, scale=scale)
    with laid_out(figure):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        renderer = canvas.get_renderer()
        whole = figure.bbox
        cells = {}
        for axis in figure.axes:
            extent = axis.get_tightbbox(renderer)
            cells.setdefault(axis.get_subplotspec().num1, []).append(extent)
            assert extent.x0 > whole.x0 - 1
            assert extent.y0 > whole.y0 - 1
            assert extent.x1 < whole.x1 + 1
            assert extent.y1 < whole.y1 + 1
        head = [one.get_window_extent(renderer) for one in (*figure.legends, *figure.texts)]
        for (_, some), (_, others) in combinations(cells.items(), 2):
            assert all(overlap(one, other) <= 1 for one in some for other in others)
        for one in head:
            assert all(overlap(one, other) <= 2 for some in cells.values() for other in some)
        covered = sum(axis.get_position().width * axis.get_position().height for axis in figure.axes)
        assert covered > 0.45  # and the room is used


def test_names_of_axes_stand_behind_their_ticks():
    figure = drawn("joints")
    with laid_out(figure):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        renderer = canvas.get_renderer()
        columns = {}
        for axis in figure.axes:
            name = axis.yaxis.label.get_window_extent(renderer)
            for tick in axis.yaxis.get_ticklabels():
                low, high = axis.get_ylim()
                if tick.get_text() and low <= tick.get_position()[1] <= high:
                    assert overlap(name, tick.get_window_extent(renderer)) < 0
            columns.setdefault(axis.get_subplotspec().colspan.start, []).append(name.x0)
        for places in columns.values():
            np.testing.assert_allclose(places, places[0], atol=0.5)


def test_a_figure_is_laid_out_once_and_drawn_once_for_each_file(tmp_path, monkeypatch):
    figure = drawn("forces")
    calls = {"layout": 0, "draw": 0}

    def counted(name, method):
        def call(*args, **options):
            calls[name] += 1
            return method(*args, **options)

        return call

    monkeypatch.setattr(Panels, "execute", counted("layout", Panels.execute))
    monkeypatch.setattr(Figure, "draw", counted("draw", Figure.draw))
    paths = plots.save_all(figure, [tmp_path / f"f.{kind}" for kind in ("png", "svg", "pdf")])
    assert calls == {"layout": 1, "draw": 3}
    starts = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    assert all(path.read_bytes().startswith(starts[path.suffix]) for path in paths)


def test_writing_leaves_the_figure_as_it_was(tmp_path):
    figure = drawn("one")
    before = (figure.get_layout_engine(), figure.dpi, figure.canvas, tuple(figure.get_size_inches()))
    first = plots.save(figure, tmp_path / "one.png").read_bytes()
    assert before == (figure.get_layout_engine(), figure.dpi, figure.canvas, tuple(figure.get_size_inches()))
    assert plots.save(figure, tmp_path / "two.png").read_bytes() == first
    figure.savefig(tmp_path / "three.png", dpi=160)  # as a user does
    assert (tmp_path / "three.png").stat().st_size > 0.9 * len(first)
    assert (tmp_path / "three.png").read_bytes()[16:24] == first[16:24]  # of the same size


def test_pictures_are_written_light_and_show_the_same():
    figure = drawn("one")
    with laid_out(figure), rc_context({"svg.hashsalt": "p3dof"}):
        light = encoded(figure, "svg").decode()
        stream = io.BytesIO()
        FigureCanvasSVG(figure).print_svg(stream, metadata={"Date": None})
    whole = stream.getvalue().decode()
    assert len(light) < 0.8 * len(whole)
    whole = re.sub(r"<metadata>.*</metadata>", "", whole, flags=re.DOTALL)
    ones, others = ([*ElementTree.fromstring(text).iter()] for text in (light, whole))  # noqa: S314 - our own
    for one, other in zip(ones, others, strict=True):
        assert one.tag == other.tag
        assert all(
            one.get(name) == other.get(name) for name in ("style", "transform", "clip-path", "viewBox")
        )
        for name in ("d", "x", "y"):
            texts = one.get(name, ""), other.get(name, "")
            np.testing.assert_allclose(*(np.array(re.findall(r"[-.\d]+", t), float) for t in texts), 0, 0.01)
            assert len({"".join(re.findall("[A-Za-z]", text)) for text in texts}) == 1
    for name in re.findall(r'(?:url\(|href=")#([^")]+)', light):
        assert f' id="{name}"' in light


def test_titles_stay_where_they_were_set():
    figure = plots.mechanism_figure(p3dof.load(), p3dof.paper_motion(3).pose[0])
    renderer = FigureCanvasAgg(figure).get_renderer()

    def places():
        titles = [axis._left_title for axis in figure.axes[:4]]
        assert all(title.get_text() for title in titles)
        return [title.get_window_extent(renderer).bounds for title in titles]

    before = places()
    with laid_out(figure):
        assert places() == before
