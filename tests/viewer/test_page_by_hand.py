"""The page while a machine is moved by hand, and its runs beside each other: still, honest, and readable."""

from __future__ import annotations

import numpy as np
import pages
import pytest
from browser import opened
from numpy.testing import assert_allclose

import p3dof
from p3dof.viewer.document.html import page_html
from p3dof.viewer.machine.document import page_document

WIDTHS = {1280: 800, 1440: 900, 390: 844}
BEFORE = """() => {
    const seen = (each) => each.checkVisibility({visibilityProperty: true});
    const ends = (each) => {
        const {left, top, right, bottom} = each.getBoundingClientRect();
        return [left, top, right, bottom];
    };
    const all = [...document.querySelectorAll("#page, #page *")];
    const boxes = all.filter(seen).map((each) => [each, ends(each)]);
    window.shifts ??= new PerformanceObserver((list) => shifts.found.push(...list.getEntries()));
    shifts.observe({type: "layout-shift"});
    shifts.found = [];
    window.moved = () => boxes.filter(([each]) => seen(each)).flatMap(([each, before]) => {
        const far = Math.max(...ends(each).map((end, k) => Math.abs(end - before[k])));
        return far > 0 ? [[far, each.outerHTML.slice(0, 80)]] : [];
    });
    return boxes.length;
}"""
AFTER = """async () => {  // two frames, so that what was drawn last is measured too
    for (let frame = 0; frame < 2; frame++) await new Promise((done) => requestAnimationFrame(done));
    shifts.found.push(...shifts.takeRecords());
    shifts.disconnect();
    return [moved(), shifts.found.map(({value}) => value)];
}"""
P = """() => {
    const {stage} = p3dof.state, {left, top} = stage.canvas.getBoundingClientRect();
    const [x, y] = stage.pixel(stage.contents.handles.P.position.toArray());
    return [x + left, y + top];
}"""


@pytest.fixture(scope="module")
def result():
    return p3dof.Manipulator().inverse_dynamics(p3dof.paper_motion(201))


@pytest.fixture(scope="module")
def written(result, tmp_path_factory):
    return pages.written(tmp_path_factory.mktemp("pages"), result, slower=pages.slower(51, 2.0))


@pytest.fixture(scope="module")
def opened_page(browser, written):
    with pages.shared(browser, written, 1280, 800) as watched:
        yield watched


@pytest.fixture
def watched(opened_page):
    yield pages.as_new(opened_page)
    opened_page.healthy()


def settled(watched):
    watched.page.evaluate(pages.SETTLED)


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_moves_when_a_drag_begins_ends_or_is_refused(browser, written, width):
    """No box of what is seen before and after, and no layout shift that Chromium counts: 0 px."""
    with opened(browser, written, width, WIDTHS[width], ready=pages.READY) as watched:
        page, mouse = watched.page, watched.page.mouse
        page.evaluate("p3dof.seek(0.35)")
        settled(watched)
        x, y = page.evaluate(P)
        mouse.move(x, y)
        settled(watched)

        def still(act, state):
            assert page.evaluate(BEFORE) > 200
            act()
            watched.wait(state)
            assert page.evaluate(AFTER) == [[], []]

        mouse.down()
        still(lambda: mouse.move(x + 1, y), "p3dof.state.hand && !p3dof.state.refused")
        still(lambda: mouse.move(x + 160, y - 170), "p3dof.state.refused && p3dof.state.refused.legs.length")
        still(mouse.up, "p3dof.state.refused")
        assert page.locator("#stage .refused").is_visible()
        still(lambda: page.keyboard.press("Escape"), "!p3dof.state.hand && !p3dof.state.refused")
        assert not page.locator("#stage .refused").is_visible()
        watched.healthy()


LEAVING = {
    "another pose": ("page => page.state.set({hand: {pose: [0, 0, 0]}})", True),
    "another instant": ("page => page.seek(0.5)", False),
    "another run": ("page => page.state.set({run: 1, hand: null})", False),
    "another machine": ("page => page.state.set({whatIf: {payload: 2}})", True),
}


@pytest.mark.parametrize("way", LEAVING)
def test_a_pose_that_is_refused_stays_marked_until_it_is_left(watched, way):
    page, box = watched.page, watched.page.locator("#pose input[name=y]")
    box.fill("9999")
    box.press("Enter")
    box.evaluate("each => each.blur()")
    settled(watched)
    page.evaluate("p3dof.state.set({hover: 0.1, units: 'mm', view: 'front'})")  # none of these leaves it
    settled(watched)
    assert (box.input_value(), box.get_attribute("aria-invalid")) == ("9999", "true")
    for where in ("#stage .refused", "#pose .refused"):
        assert "cannot go there" in page.locator(where).inner_text()
    act, held = LEAVING[way]
    page.evaluate(f"() => ({act})(p3dof)")
    settled(watched)
    assert page.evaluate("[p3dof.state.refused, Boolean(p3dof.state.hand)]") == [None, held]
    assert box.get_attribute("aria-invalid") is None
    assert not page.locator("#stage .refused").is_visible()
    assert "cannot" not in page.locator("#pose .refused").inner_text()


def heads(watched):
    return watched.page.locator(".legend .head .now").all_inner_texts()


def test_charts_say_held_while_they_list_held_values(watched):
    page = watched.page
    assert heads(watched) == [""] * 3
    page.evaluate("p3dof.state.set({hand: {pose: [0.03, -0.02, 0.1]}})")
    settled(watched)
    assert heads(watched) == ["held"] * 3
    robot = p3dof.Manipulator()
    force = robot.forces([0.03, -0.02, 0.1], [0, 0, 0], [0, 0, 0])
    listed = page.locator(".chart").first.locator("button + .value").all_inner_texts()
    assert_allclose([float(text.replace("−", "-")) for text in listed], force, atol=0.051)
    x, y, width, height = page.locator(".overlay").first.bounding_box().values()
    page.mouse.move(x + width / 2, y + height / 2)  # values of the run, where the pointer is
    watched.wait("p3dof.state.hover !== null")
    settled(watched)
    assert heads(watched) == [""] * 3
    page.mouse.move(5, 5)
    page.keyboard.press("Escape")
    settled(watched)
    assert heads(watched) == [""] * 3
    page.evaluate("p3dof.state.set({compare: 1, hand: {pose: [0, 0, 0]}})")
    settled(watched)
    assert page.locator(".legend .head").first.inner_text().split("\n")[-2:] == ["held", "slower"]
    page.evaluate("p3dof.state.set({hand: null})")
    settled(watched)
    assert heads(watched) == ["this run"] * 3


def test_home_is_where_the_machine_is_at_home(watched):
    page = watched.page
    back = page.locator("#pose").get_by_role("button", name="Back to the run")
    assert back.is_disabled()
    page.locator("#pose").get_by_role("button", name="Home").click()
    settled(watched)
    assert page.evaluate("p3dof.state.hand.pose") == [0, 0, 0]
    values = page.evaluate("p3dof.instant().values")
    assert_allclose(
        [values[f"force_{leg}"] for leg in "abc"], p3dof.Manipulator().forces(*np.zeros((3, 3))), rtol=1e-12
    )
    back.click()
    settled(watched)
    assert page.evaluate("p3dof.state.hand") is None
    page.keyboard.press("h")
    settled(watched)
    assert page.evaluate("p3dof.state.hand.pose") == [0, 0, 0]


def test_runs_are_chosen_shown_hidden_and_removed_in_a_list(browser, written):
    with opened(browser, written, 1280, 800, ready=pages.READY) as watched:
        used(watched, watched.page, watched.page.locator("#runs"))
        watched.healthy()


def used(watched, page, runs):
    """Use the list of runs."""
    assert runs.locator("li .name").all_inner_texts()[1] == "slower"
    beside = runs.get_by_role("button", name="Compare slower with")
    beside.click()
    settled(watched)
    assert page.evaluate("p3dof.state.compare") == 1
    assert (
        page.evaluate("p3dof.charts[0].lines.map(({kind}) => kind).join()") == "now,other,now,other,now,other"
    )
    runs.get_by_role("radio", name="slower").check()  # the one that was shown is beside it then
    settled(watched)
    assert page.evaluate("[p3dof.state.run, p3dof.state.compare]") == [1, 0]
    runs.get_by_role("button", name="Compare").first.click()
    settled(watched)
    assert page.evaluate("p3dof.state.compare") is None
    page.evaluate("p3dof.seek(0.25)")
    runs.get_by_role("button", name="Remove").first.click()
    settled(watched)
    assert page.evaluate("[p3dof.state.run, p3dof.state.document.runs.map(({name}) => name)]") == [
        0,
        ["slower"],
    ]
    assert page.evaluate("p3dof.state.time") == 0.25
    assert not runs.is_visible()
    with page.expect_navigation(url="**#run=2&t=0.75"):  # still the second one of the file
        page.evaluate("location.hash = '#run=2&t=0.75'")
    watched.wait("p3dof.state.time === 0.75")
    page.evaluate("location.hash = '#run=1'")
    watched.wait("p3dof.state.linked.startsWith('The link leads to run 1, but there is one run here')")


@pytest.mark.parametrize("width", WIDTHS)
def test_two_runs_beside_each_other_are_readable(browser, written, width):
    """No name, number or heading is cut off, and nothing in the legends has to be scrolled to."""
    with opened(browser, written, width, WIDTHS[width], ready=pages.READY) as watched:
        watched.page.evaluate("p3dof.state.set({compare: 1, run: 0}); p3dof.seek(0.35)")
        settled(watched)
        cut = watched.page.evaluate("""() => {
            const texts = document.querySelectorAll(".side .name, .side .value, .runs .name");
            const wide = (each) => each.scrollWidth > each.clientWidth + 1 && each.clientWidth;
            const high = (each) => each.scrollHeight > each.clientHeight + 1;
            const sides = [...document.querySelectorAll(".side")];
            return [...[...texts].filter(wide), ...sides.filter(high)].map((each) => each.textContent);
        }""")
        assert cut == []
        rows = watched.page.locator(".chart").first.locator(".row:not(.head) .value").all_inner_texts()
        assert len(rows) == 6


def test_any_curve_is_drawn_over_any_other(watched, result):
    """The force of A over the position of its slider: drawn, marked, told and sought where Python has it."""
    page = watched.page
    page.get_by_label("Horizontal axis of chart 2").select_option("slider_a")
    page.get_by_label("Curves of chart 2").select_option("Actuator forces")
    page.evaluate("p3dof.seek(0.35)")
    settled(watched)
    line = "() => ['x', 'values', 'time'].map((name) => [...p3dof.charts[1].lines[0][name]])"
    across, up, time = page.evaluate(line)
    assert_allclose(across, result.sliders[:, 0], atol=1e-12)
    assert_allclose(up, result.forces[:, 0], rtol=1e-12)
    assert "over Slider A: A from" in page.locator(".plot").nth(1).get_attribute("aria-label")
    assert page.locator(".plot").nth(1).locator(".cursor").is_hidden()
    pixel = """([x, y]) => {
        const {plot} = p3dof.charts[1].chart, {left, top} = plot.over.getBoundingClientRect();
        return [left + plot.valToPos(x, "x"), top + plot.valToPos(y, "y")];
    }"""
    spots = """() => [...document.querySelectorAll(".spot")].map((each) => {
        const {left, right, top, bottom} = each.getBoundingClientRect();
        return [(left + right) / 2, (top + bottom) / 2];
    })"""
    for sample in (40, 70, 180):
        page.mouse.move(5, 5)
        watched.wait("p3dof.state.hover === null")
        page.evaluate("time => p3dof.seek(time)", time[sample])
        wanted = [
            page.evaluate(pixel, [across[sample], float(result.forces[sample, leg])]) for leg in range(3)
        ]
        assert_allclose(page.evaluate(spots), wanted, atol=0.6)
        page.mouse.click(*page.evaluate(pixel, [across[sample + 15], up[sample + 15]]))
        settled(watched)
        there = int(np.argmin(np.abs(np.subtract(time, page.evaluate("p3dof.state.time")))))
        at, seen = (page.evaluate(pixel, [across[k], up[k]]) for k in (sample + 15, there))
        assert np.hypot(*np.subtract(at, seen)) < 4  # or what lies on the same pixels
    blue = """() => {
        const {ctx} = p3dof.charts[1].chart.plot, {width, height} = ctx.canvas;
        const pixels = new Uint32Array(ctx.getImageData(0, 0, width, height).data.buffer);
        return pixels.filter((pixel) => pixel === 0xffb27200).length;
    }"""
    assert page.evaluate(blue) > 100
    page.mouse.move(5, 5)
    page.evaluate("p3dof.state.set({hand: {pose: [0.01, 0, 0]}})")
    watched.wait("p3dof.state.hover === null")
    settled(watched)
    held = page.evaluate("(({slider_a, force_a}) => [slider_a, force_a])(p3dof.instant().values)")
    assert_allclose(page.evaluate(spots)[0], page.evaluate(pixel, held), atol=0.6)
    page.get_by_label("Horizontal axis of chart 2").select_option("")
    settled(watched)
    assert page.locator(".spot").count() == 0
    assert page.locator(".plot").nth(1).locator(".cursor").is_visible()


@pytest.mark.parametrize("motion", ["no-preference", "reduce"])
def test_a_page_that_begins_playing_waits_where_less_motion_is_wanted(browser, result, motion, tmp_path):
    document = page_document(p3dof.Manipulator(), result) | {"start": {"playing": True}}
    (tmp_path / "page.html").write_text(page_html(document), encoding="utf-8")
    context = browser.new_context(reduced_motion=motion)
    try:
        page = context.new_page()
        page.goto((tmp_path / "page.html").as_uri())
        page.evaluate("p3dof.ready.then(() => true)")
        page.evaluate(pages.SETTLED)
        assert page.evaluate("p3dof.state.playing") is (motion == "no-preference")
        if motion == "reduce":
            assert page.evaluate("p3dof.state.time") == 0
            page.get_by_role("button", name="Play").click()  # who asks for it gets it
        page.wait_for_function("() => p3dof.state.time > 0.05")
    finally:
        context.close()
