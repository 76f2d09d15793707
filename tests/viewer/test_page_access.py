"""The page for everybody: keys alone, screen readers, phones, paper, and browsers without WebGL."""

from __future__ import annotations

import re

import numpy as np
import pages
import pytest
from browser import opened
from documents import ROOT
from numpy.testing import assert_allclose

import p3dof

AXE = ROOT / "page/node_modules/axe-core/axe.min.js"


@pytest.fixture(scope="module")
def result():
    return p3dof.Manipulator().inverse_dynamics(p3dof.paper_motion())


@pytest.fixture(scope="module")
def written(result, tmp_path_factory):
    return pages.written(tmp_path_factory.mktemp("pages"), result, slower=pages.slower(51, 2.0))


@pytest.fixture(scope="module")
def opened_page(browser, written):
    with pages.shared(browser, written) as watched:
        yield watched


@pytest.fixture
def watched(opened_page):
    yield pages.as_new(opened_page)
    opened_page.healthy()


@pytest.fixture
def telephone(browser, written):
    context = browser.new_context(
        viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True, device_scale_factor=2
    )
    try:
        page = context.new_page()
        page.goto(written)
        page.evaluate("p3dof.ready.then(() => true)")
        page.evaluate(pages.SETTLED)
        yield page
    finally:
        context.close()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_serious(watched, theme):
    if not AXE.exists():
        pytest.skip("axe-core is not installed: `make page-check` installs what page/ needs")
    watched.page.evaluate("theme => { p3dof.state.set({theme, compare: 1}); p3dof.seek(0.35); }", theme)
    watched.page.evaluate(pages.SETTLED)
    watched.page.evaluate(AXE.read_text(encoding="utf-8"))
    found = watched.page.evaluate("""async () => (await axe.run()).violations.map(
        ({id, impact, nodes}) => [id, impact, nodes.map(({html, any}) => [html, any[0]?.message])])""")
    assert [each for each in found if each[1] in ("serious", "critical")] == []


def test_keys_alone_play_seek_zoom_move_and_choose(watched, result):
    page, state = watched.page, "JSON.parse(JSON.stringify(p3dof.state[{!r}]))"

    def after(key, field):
        page.keyboard.press(key)
        page.evaluate(pages.SETTLED)
        return page.evaluate(state.format(field))

    page.mouse.move(700, 5)
    assert_allclose(after("ArrowRight", "time"), result.time[1], rtol=1e-12)
    assert_allclose(after("Shift+ArrowRight", "time"), result.time[11], rtol=1e-12)
    assert_allclose(after("ArrowLeft", "time"), result.time[10], rtol=1e-12)
    assert after("End", "time") == 1.0
    assert after("Home", "time") == 0.0
    assert after("+", "speed") == 2
    assert after("-", "speed") == 1
    assert after("l", "loop") is False
    assert after("u", "units") == "SI"
    assert after("t", "theme") == "light"
    assert after("2", "view") == "front"
    assert after("c", "case") == "static"
    assert after("c", "case") == "dynamic"
    assert after("c", "case") == "total"
    assert after("z", "zoom") == [0.0, 0.5]
    assert after("x", "zoom") is None
    assert after("r", "run") == 1
    assert after("r", "run") == 0
    assert after("d", "hand")["pose"][0] == pytest.approx(0.005)
    assert after("e", "hand")["pose"][2] == pytest.approx(np.pi / 180)
    assert after("Escape", "hand") is None
    assert after(" ", "playing") is True
    watched.wait("p3dof.state.time > 0.05")
    assert after(" ", "playing") is False
    page.locator("button.peak").first.click()
    assert after(" ", "playing") is True  # and not the button again
    assert after(" ", "playing") is False
    assert after("?", "help") is True
    assert "play, pause" in page.locator("dialog[open]").inner_text()
    page.keyboard.press("Escape")
    watched.wait("!document.querySelector('dialog[open]') && !p3dof.state.help")


def test_every_control_is_reached_by_the_tab_key_and_has_a_name(watched):
    names = []
    for _ in range(150):
        watched.page.keyboard.press("Tab")
        name = watched.page.evaluate("""() => {
            const {activeElement: here} = document;
            if (!here || here === document.body) return null;
            return here.tagName + " " + (here.ariaLabel || here.labels?.[0]?.innerText || here.innerText
                || here.title || here.name);
        }""")
        if name is None:
            break
        names.append(name)
    assert all(name.split(" ", 1)[1].strip() for name in names)
    told = "\n".join(names)
    for wanted in ("Play", "Time", "Curves of chart 3", "Actuator forces over time", "Units", "Curves CSV"):
        assert wanted in told


def test_charts_say_their_ranges_and_peaks(watched, result):
    said = watched.page.locator(".plot").nth(0).get_attribute("aria-label")
    for leg, row in zip("ABC", result.forces.T, strict=True):
        low, high, when = re.search(rf"{leg} from (\S+) to (\S+) N, largest at (\S+) s", said).groups()
        assert_allclose([float(low), float(high)], [row.min(), row.max()], atol=0.051)
        assert_allclose(float(when), result.time[np.abs(row).argmax()], atol=5e-4)


def test_a_screen_reader_is_told_the_numbers_when_time_rests_and_nothing_while_it_runs(watched, result):
    page = watched.page
    page.evaluate("""() => {
        window.told = [];
        const region = document.getElementById("spoken");
        new MutationObserver(() => told.push(region.textContent)).observe(region, {childList: true});
    }""")
    page.keyboard.press(" ")
    watched.wait("p3dof.state.time > 0.6")
    assert page.evaluate("told") == []
    page.keyboard.press(" ")
    page.evaluate("p3dof.seek(0.35)")
    watched.wait("told.length === 1")
    (text,) = page.evaluate("told")
    assert text.startswith("0.350 s: Actuator forces A ")
    numbers = [float(number) for number in re.findall(r"(\d+\.\d+) N", text)]
    assert_allclose(numbers, result.forces[350], atol=0.051)


@pytest.mark.parametrize("width", [390, 768, 1400])
def test_nothing_runs_out_of_the_page_sideways(browser, written, width):
    with opened(browser, written, width, 844, ready=pages.READY) as watched:
        watched.page.evaluate("p3dof.state.set({compare: 1}); p3dof.seek(0.35)")
        watched.page.evaluate(pages.SETTLED)
        wide = watched.page.evaluate("""() => [...document.querySelectorAll("#page *")].filter((each) => {
            const {right, width} = each.getBoundingClientRect();
            return width && right > innerWidth + 0.5 && !each.closest(".hidden");
        }).map((each) => each.outerHTML.slice(0, 100))""")
        assert wide == []
        cut = "() => [...document.querySelectorAll('.legend .name')].filter((name) =>"
        cut += " name.scrollWidth > name.clientWidth + 1).map((name) => name.textContent)"
        assert watched.page.evaluate(cut) == []
        watched.page.evaluate("p3dof.state.set({compare: null}); p3dof.state.refresh()")
        assert watched.page.evaluate(cut) == []
        assert watched.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        watched.healthy()


def test_fingers_seek_and_zoom_the_charts_and_still_scroll_the_page(telephone):
    page, touch = telephone, telephone.context.new_cdp_session(telephone)
    page.locator(".plot").nth(1).scroll_into_view_if_needed()
    box = page.locator(".overlay").nth(1).bounding_box()

    def at(share, down=0.5):
        return {"x": box["x"] + share * box["width"], "y": box["y"] + down * box["height"]}

    def drag(start, end):
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [start]})
        for share in (0.2, 0.6, 1.0):
            point = {key: start[key] + share * (end[key] - start[key]) for key in "xy"}
            touch.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [point]})
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    page.touchscreen.tap(**at(0.5))
    page.wait_for_function("() => Math.abs(p3dof.state.time - 0.5) < 4e-3")
    drag(at(0.25), at(0.75))
    page.wait_for_function("() => p3dof.state.zoom !== null")
    assert_allclose(page.evaluate("p3dof.state.zoom"), [0.25, 0.75], atol=8e-3)
    before = page.evaluate("scrollY")
    drag(at(0.5, 0.9), {"x": at(0.5)["x"], "y": at(0.5)["y"] - 200})
    page.wait_for_function("before => scrollY > before + 50", arg=before)
    assert_allclose(page.evaluate("p3dof.state.zoom"), [0.25, 0.75], atol=8e-3)


def test_the_printed_page_has_charts_and_table_in_light_and_no_panel(watched, result):
    page = watched.page
    page.evaluate("p3dof.state.set({theme: 'dark'}); p3dof.seek(0.35)")
    page.emulate_media(media="print")
    watched.wait("document.querySelectorAll('#print canvas').length === 3")
    assert not page.locator("#panel").is_visible()
    assert not page.locator("#stage").is_visible()
    rows = page.locator("#print tbody tr").all_inner_texts()
    force = re.split(r"\s+", next(row for row in rows if row.startswith("Actuator forces, A")))
    assert_allclose(float(force[4]), result.forces[350, 0], atol=0.051)
    assert_allclose(float(force[5]), np.abs(result.forces[:, 0]).max(), atol=0.051)
    colours = page.evaluate("""() => [...document.querySelectorAll("#print canvas")].map((canvas) => {
        const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        const seen = new Set();
        for (let i = 0; i < data.length; i += 4) seen.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
        return [[...data.slice(0, 3)], seen.has(0x0072b2), seen.size];
    })""")
    assert all(corner == [255, 255, 255] and blue and many > 20 for corner, blue, many in colours)
    assert page.pdf()[:5] == b"%PDF-"
    page.emulate_media(media="screen")
    watched.wait("!document.querySelector('#print').children.length")


def test_without_webgl_all_but_the_picture_works(browser, written, result):
    context = browser.new_context(viewport={"width": 1400, "height": 860})
    try:
        page = context.new_page()
        page.add_init_script("""
            const {getContext} = HTMLCanvasElement.prototype;
            HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
                return kind.startsWith("webgl") ? null : getContext.call(this, kind, ...rest);
            };""")
        errors = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
        page.goto(written)
        page.evaluate("p3dof.ready.then(() => true)")
        page.locator('button.peak[data-key="force_b"]').click()
        page.evaluate(pages.SETTLED)
        sample = np.abs(result.forces[:, 1]).argmax()
        assert_allclose(page.evaluate("p3dof.state.time"), result.time[sample], rtol=1e-12)
        shown = page.locator("table.numbers td.value").all_inner_texts()
        assert_allclose([float(text) for text in shown[::3]], result.forces[sample], atol=0.051)
        assert page.evaluate("p3dof.charts.every(({chart}) => chart.plot.data[0].length > 1000)")
        assert page.get_by_role("button", name="GIF", exact=True).is_disabled()
        assert "no WebGL" in page.locator("#stage").inner_text()
        page.evaluate("p3dof.state.set({hand: {pose: [0.02, 0, 0]}})")
        page.evaluate(pages.SETTLED)
        assert page.evaluate("p3dof.instant().q[0]") != 0.0
        assert errors == []
    finally:
        context.close()


def test_no_frame_of_a_playing_page_mixes_two_instants(watched):
    frames = watched.page.evaluate("""() => new Promise((done) => {
        const frames = [], {state} = p3dof;
        const spots = () => [...document.querySelectorAll(".cursor")].map((line) => {
            const {width} = line.parentElement.getBoundingClientRect();
            return parseFloat(line.style.transform.slice(11)) / width;
        });
        const number = (text) => Number(text.replace("−", "-"));
        const stop = state.subscribe(() => {  // after all parts: what this frame shows
            const now = p3dof.instant(), {joints} = state.stage.contents.solids;
            const drawn = joints.flatMap(({matrix}) => matrix.toArray());
            frames.push({
                time: now.time, state: state.time, spots: spots(),
                table: Number(document.querySelector("table.numbers").dataset.time),
                forces: ["a", "b", "c"].map((leg) => now.values[`force_${leg}`]),
                shown: [...document.querySelectorAll("td.value")].map((cell) => number(cell.textContent))
                    .filter((_, i) => i % 3 === 0),
                bar: Number(document.querySelector(".track").value),
                joints: Math.max(...drawn.map((value, i) => Math.abs(value - now.placements[i]))),
            });
            if (frames.length === 25) {
                stop();
                state.set({playing: false});
                done(frames);
            }
        });
        state.set({playing: true, loop: true});
    })""")
    assert len({frame["time"] for frame in frames}) > 10
    for frame in frames:
        assert_allclose(
            [frame["state"], frame["table"], frame["bar"], *frame["spots"]], frame["time"], atol=1e-9
        )
        assert_allclose(frame["shown"], frame["forces"], atol=0.051)
        assert frame["joints"] < 1e-6


def test_without_webassembly_the_stored_run_plays(browser, written, result):
    context = browser.new_context(viewport={"width": 1400, "height": 860})
    try:
        page = context.new_page()
        page.add_init_script("delete window.WebAssembly;")
        page.goto(written)
        page.evaluate("p3dof.ready.then(() => true)")
        assert "cannot be computed" in page.locator("#panel").inner_text()
        page.keyboard.press(" ")
        page.wait_for_function("() => p3dof.state.time > 0.3")
        page.evaluate("p3dof.seek(0.35)")
        shown = page.locator("table.numbers td.value").all_inner_texts()
        assert_allclose([float(text) for text in shown[::3]], result.forces[350], atol=0.051)
    finally:
        context.close()
