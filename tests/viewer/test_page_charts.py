"""Charts, time bar, table and keys of the page in a real browser, with real clicks and keys."""

from __future__ import annotations

import numpy as np
import pages
import pytest
from browser import opened
from documents import ROOT
from numpy.testing import assert_allclose

import p3dof
from p3dof.viewer.document.html import page_html

SEEN = """() => {
    const number = (text) => Number(text.replace("−", "-"));
    const boxes = (name) => [...document.querySelectorAll(name)].map((each) => each.getBoundingClientRect());
    const [track] = boxes(".track");
    const bar = document.querySelector(".track"), [start, end] = [Number(bar.min), Number(bar.max)];
    const across = (left, right, x) => start + (x - left) / (right - left) * (end - start);
    const plots = boxes(".overlay"), cursors = boxes(".cursor"), hovers = boxes(".plot .hover");
    const text = document.querySelector("output.time").textContent;
    return {
        state: p3dof.state.time,
        instant: p3dof.instant().time,
        track: Number(document.querySelector(".track").value),
        clock: parseFloat(text),
        table: Number(document.querySelector("table.numbers").dataset.time),
        cursors: cursors.map((box, i) => across(plots[i].left, plots[i].right, (box.left + box.right) / 2)),
        hovers: hovers.map((box, i) => box.width ? across(plots[i].left, plots[i].right, box.left) : null),
        plots: plots.map((box) => [box.left, box.right]),
        rail: [track.left + 8, track.right - 8],
        numbers: [...document.querySelectorAll("td.value")].map((cell) => number(cell.textContent)),
        legends: [...document.querySelectorAll(".legend")].map((legend) =>
            [...legend.querySelectorAll(".row:not(.head) .value")].map((cell) => number(cell.textContent))),
        aria: [...document.querySelectorAll(".plot")].map((plot) => Number(plot.ariaValueNow)),
    };
}"""
SPANS = "p3dof.charts.map(({chart: {plot}}) => [plot.scales.x.min, plot.scales.x.max])"


@pytest.fixture(scope="module")
def machine():
    return p3dof.Manipulator()


@pytest.fixture(scope="module")
def result(machine):
    return machine.inverse_dynamics(p3dof.paper_motion())


@pytest.fixture(scope="module")
def opened_page(browser, result, tmp_path_factory):
    address = pages.written(tmp_path_factory.mktemp("pages"), result, slower=pages.slower())
    with pages.shared(browser, address) as watched:
        watched.wait("document.querySelectorAll('.plot canvas').length === 3")
        yield watched


@pytest.fixture
def watched(opened_page):
    yield pages.as_new(opened_page)
    opened_page.healthy()


def seen(watched):
    """What all parts show in one frame."""
    return watched.page.evaluate(SEEN)


def settled(watched):
    watched.page.evaluate(pages.SETTLED)


def spot(watched, chart, share, height=0.5):
    """Where in the window a share of a chart's width is."""
    box = watched.page.locator(".overlay").nth(chart).bounding_box()
    return box["x"] + share * box["width"], box["y"] + height * box["height"]


def at_one_time(shown, time, tolerance=1e-9):
    for name in ("state", "instant", "track", "table"):
        assert_allclose(shown[name], time, atol=tolerance)
    assert_allclose(shown["aria"], time, atol=tolerance)
    assert_allclose(shown["clock"], time, atol=0.5e-3 + tolerance)
    assert_allclose(shown["cursors"], time, atol=2e-3)  # a pixel is 1.3 ms


@pytest.mark.parametrize("chart", [0, 1, 2])
def test_a_click_in_any_chart_moves_everything_to_its_instant(watched, result, chart):
    x, y = spot(watched, chart, 0.62, 0.9)
    watched.page.mouse.click(x, y)
    watched.wait("Math.abs(p3dof.state.time - 0.62) < 2e-3")
    settled(watched)
    shown = seen(watched)
    at_one_time(shown, shown["state"])
    here = [np.interp(shown["state"], result.time, row) for row in result.forces.T]
    assert_allclose(shown["numbers"][0::3], here, atol=0.051)
    speeds = [np.interp(shown["state"], result.time, row) for row in 1e3 * result.slider_velocities.T]
    watched.page.mouse.move(5, 5)
    settled(watched)
    assert_allclose(seen(watched)["legends"][:2], [here, speeds], atol=0.51)


def test_time_bar_and_charts_have_one_width(watched):
    shown = seen(watched)
    for plot in shown["plots"]:
        assert_allclose(plot, shown["rail"], atol=1.0)


def test_peaks_are_those_of_python_and_a_click_goes_there(watched, result):
    found = watched.page.evaluate(
        "[...document.querySelectorAll('button.peak')].map(({dataset}) => [dataset.key, +dataset.time])"
    )
    times = dict(found)
    largest = np.abs(result.forces).argmax(axis=0)
    assert_allclose([times[f"force_{leg}"] for leg in "abc"], result.time[largest], rtol=1e-12)
    for leg, sample in zip("abc", largest, strict=True):
        watched.page.locator(f'button.peak[data-key="force_{leg}"]').click()
        settled(watched)
        shown = seen(watched)
        at_one_time(shown, result.time[sample])
        row = "abc".index(leg)
        assert_allclose(shown["numbers"][3 * row], result.forces[sample, row], atol=0.051)


def test_marks_of_peaks_have_their_values_and_cover_no_other(watched, result):
    marks = watched.page.evaluate(
        "p3dof.charts.map(({chart}) => chart.marks.map(({key, time, value, text, x, y, width, height}) =>"
        " ({key, time, value, text, x, y, width, height})))"
    )
    peaks = np.abs(result.forces).max(axis=0)
    assert [mark["text"] for mark in marks[0]] == [f"{value:.1f}" for value in peaks]
    for chart in marks:
        assert len(chart) >= 3
        for i, one in enumerate(chart):
            for other in chart[i + 1 :]:
                apart = (
                    one["x"] + one["width"] <= other["x"]
                    or other["x"] + other["width"] <= one["x"]
                    or one["y"] + one["height"] <= other["y"]
                    or other["y"] + other["height"] <= one["y"]
                )
                assert apart, (one, other)


def test_hover_shows_the_values_of_all_curves_in_all_charts(watched, result):
    x, y = spot(watched, 1, 0.25)
    watched.page.mouse.move(x, y)
    watched.wait("p3dof.state.hover !== null")
    settled(watched)
    shown = seen(watched)
    hover = watched.page.evaluate("p3dof.state.hover")
    assert abs(hover - 0.25) < 2e-3
    assert_allclose(shown["hovers"], hover, atol=2e-3)
    at_one_time(shown, 0.0)
    power = np.column_stack([result.forces * result.slider_velocities, result.power])
    tables = result.forces, 1e3 * result.slider_velocities, power
    for legend, table in zip(shown["legends"], tables, strict=True):
        assert_allclose(legend, [np.interp(hover, result.time, row) for row in table.T], atol=0.51)
    watched.page.mouse.move(5, 5)
    watched.wait("p3dof.state.hover === null")


def test_a_drag_zooms_all_charts_and_a_double_click_brings_all_back(watched):
    watched.page.mouse.move(*spot(watched, 0, 0.2))
    watched.page.mouse.down()
    watched.page.mouse.move(*spot(watched, 0, 0.5), steps=4)
    watched.page.mouse.up()
    watched.wait("p3dof.state.zoom !== null")
    settled(watched)
    assert_allclose(watched.page.evaluate(SPANS), 3 * [[0.2, 0.5]], atol=3e-3)
    assert watched.page.evaluate("p3dof.state.time") == 0.0  # a drag is no click
    watched.page.mouse.dblclick(*spot(watched, 2, 0.3))
    watched.wait("p3dof.state.zoom === null")
    settled(watched)
    assert_allclose(watched.page.evaluate(SPANS), 3 * [[0.0, 1.0]])


def test_any_group_of_the_run_can_be_chosen_for_any_chart(watched, result):
    groups = watched.page.evaluate("[...new Set(p3dof.instant().run.curves.map(({group}) => group))]")
    select = watched.page.get_by_label("Curves of chart")
    assert select.nth(2).locator("option").count() >= len(groups)
    select.nth(2).select_option("Slider positions")
    watched.page.evaluate("p3dof.seek(0.35)")
    assert_allclose(seen(watched)["legends"][2], 1e3 * result.sliders[350], atol=0.051)
    watched.page.locator(".legend").nth(2).locator("button").first.click()
    settled(watched)
    assert watched.page.evaluate("p3dof.charts[2].chart.plot.series.length") == 3  # time and two curves


def test_beyond_limits_is_shaded(watched):
    watched.page.locator(".side select").nth(0).select_option("Slider speeds")
    settled(watched)
    shade = watched.page.evaluate("""() => {
        const {chart} = p3dof.charts[0], {ctx, bbox} = chart.plot;
        const row = (value) => chart.plot.valToPos(value, "y", true);
        return [2.005, 1.9].map((value) => [...ctx.getImageData(bbox.left + 20, row(value), 1, 1).data]);
    }""")
    assert shade[0] != shade[1]
    assert "±2000 mm/s" in watched.page.locator(".chart").nth(0).inner_text()


def test_two_runs_stand_beside_each_other_and_their_difference_is_a_curve(watched, machine, result):
    slower = machine.inverse_dynamics(pages.slower())
    watched.page.evaluate("p3dof.state.set({compare: 1}); p3dof.seek(0.35)")
    other = np.array([np.interp(0.35, slower.time, row) for row in slower.forces.T])
    legend = np.reshape(seen(watched)["legends"][0], (3, 2))
    assert_allclose(legend, np.column_stack([result.forces[350], other]), atol=0.051)
    watched.page.evaluate("p3dof.state.set({difference: true}); p3dof.state.refresh()")
    assert_allclose(seen(watched)["legends"][0], result.forces[350] - other, atol=0.051)


def test_of_100001_samples_what_can_be_seen_is_drawn_and_no_peak_is_lost(watched):
    drawn = watched.page.evaluate(pages.LONG_RUN)
    for points, width in zip(drawn["points"], drawn["widths"], strict=True):
        assert width < points <= 4 * width
    assert_allclose(drawn["highest"], 2.0, atol=1e-3)


def test_what_changes_with_a_payload_is_a_curve_and_what_does_not_is_none(watched, result):
    watched.page.evaluate("p3dof.state.set({whatIf: {payload: 2}, difference: true}); p3dof.seek(0.35)")
    loaded = p3dof.Manipulator(
        p3dof.PAPER.carrying(p3dof.machine.Body(2.0, np.zeros(3), np.zeros(3)))
    ).inverse_dynamics(p3dof.paper_motion())
    assert_allclose(seen(watched)["legends"][0], (loaded.forces - result.forces)[350], atol=0.051)
    marks = watched.page.evaluate("p3dof.charts.map(({chart}) => chart.marks.map(({text}) => text))")
    assert len(marks[0]) == 2  # nothing changes at C
    assert marks[1] == []  # rounding has no peak


def test_the_bar_between_picture_and_charts_gives_more_room_to_one_of_them(watched):
    def height():
        return watched.page.locator("#charts").bounding_box()["height"]

    before, bar = height(), watched.page.locator(".splitter").bounding_box()
    watched.page.mouse.move(bar["x"] + 300, bar["y"] + 4)
    watched.page.mouse.down()
    watched.page.mouse.move(bar["x"] + 300, bar["y"] - 96, steps=3)
    watched.page.mouse.up()
    assert_allclose(height(), before + 100, atol=2)
    watched.page.locator(".splitter").press("ArrowDown")
    assert_allclose(height(), before + 100 - 0.03 * 860, atol=2)
    watched.wait("() => p3dof.charts.every(({chart, canvas}) => chart.plot.height === canvas.clientHeight)")


def test_a_resized_window_leaves_charts_and_time_bar_on_one_axis(watched):
    for size in ((1000, 600), (1400, 860)):
        watched.page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
        watched.wait("() => p3dof.charts.every(({chart, canvas}) => chart.plot.width === canvas.clientWidth)")
        watched.wait(
            "() => p3dof.charts.every(({chart, canvas}) => chart.plot.height === canvas.clientHeight)"
        )
        shown = seen(watched)
        for plot in shown["plots"]:
            assert_allclose(plot, shown["rail"], atol=1.0)


def test_ticks_are_round_in_the_unit_that_is_shown(watched):
    watched.page.locator(".side select").nth(0).select_option("Velocity of the platform: θ")
    for units, unit in (("mm", "°/s"), ("SI", "rad/s")):
        watched.page.evaluate("units => { p3dof.state.set({units}); p3dof.state.refresh(); }", units)
        ticks = watched.page.evaluate("p3dof.charts[0].chart.plot.axes[1]._values")
        numbers = np.array([float(tick.replace("−", "-")) for tick in ticks])
        steps = np.diff(numbers)
        assert len(numbers) >= 2
        assert_allclose(steps, steps[0])
        assert f"{steps[0]:e}"[:3] in ("1.0", "2.0", "2.5", "5.0")
        assert unit in watched.page.locator(".side select").nth(0).locator("option:checked").inner_text()


def test_charts_and_table_show_any_robot(opened_page, tmp_path):
    from p3dof.runs import simulate_robot
    from p3dof.viewer.document.document import robot_document

    robot = p3dof.load_robot(ROOT / "docs/_static/gallery/five_bar.urdf")
    run = simulate_robot(robot, 0.2, q=robot.assemble().q, samples=21, method="general")
    (tmp_path / "robot.html").write_text(page_html(robot_document(robot, run=run)), encoding="utf-8")
    browser = opened_page.page.context.browser
    with opened(browser, (tmp_path / "robot.html").as_uri(), 1400, 860, ready=pages.READY) as watched:
        watched.page.evaluate("p3dof.seek(0.1)")
        rows = watched.page.locator("table.numbers tbody").nth(0).locator("tr").all_inner_texts()
        names = [row.split("\t")[0] for row in rows]
        assert names == list(robot.actuated)
        at = [robot.model.idx_vs[robot.model.getJointId(name)] for name in names]
        rates = [float(row.split("\t")[3].replace("−", "-")) for row in rows]
        assert_allclose(rates, np.degrees(run.v[10, at]), atol=0.051)
        assert watched.page.evaluate("p3dof.charts.map(({chart}) => chart.content.lines.length)") == [2, 2, 3]
        watched.healthy()
