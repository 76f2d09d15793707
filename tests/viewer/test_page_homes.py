"""One page in four homes: a file, a server, a report, a notebook. The same file, and the same behaviour."""

from __future__ import annotations

import hashlib
import html
import re
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cache

import numpy as np
import pytest
from browser import until

import p3dof
from p3dof import report
from p3dof.viewer.document.encoding import decoded

pytest.importorskip("tornado", reason="tornado is not installed")
pytest.importorskip("jinja2", reason="Jinja2 is not installed")

HOMES = ("file", "live", "report", "notebook")
READY = "() => !!window.p3dof && !!p3dof.ready && p3dof.ready.then(() => true)"

DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
FORCES = "['a', 'b', 'c'].map((leg) => p3dof.instant().values[`force_${leg}`])"


@dataclass
class Home:
    """A page somewhere: the tab, the frame in it that is the page, and what went wrong."""

    tab: object
    frame: object
    errors: list[str]
    outside: list[str]

    def tell(self, script, argument=None):
        return self.frame.evaluate(script, argument)

    def wait(self, script, argument=None):
        self.frame.wait_for_function(script, arg=argument, timeout=60_000)


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def result(robot):
    return robot.inverse_dynamics(p3dof.paper_motion())


@cache
def reported(robot, result):
    """A report, without its figures, which take nearly all of the time."""
    from p3dof.report.templates import Picture, Pictures

    blank = Picture("data:,", "nothing", "nothing", 1, 1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("p3dof.report.page.pictures_of", lambda *_: Pictures(*[blank] * len(fields(Pictures))))
        return report.render(robot, result.motion, page=robot.page(result).html)


@contextmanager
def at_home(browser, home, robot, result, folder):
    live = robot.show(result, port=0, playing=False) if home == "live" else None
    if live is not None:
        address, host = live.url, f"127.0.0.1:{live.server.port}"
    else:
        text = {
            "file": lambda: robot.page(result).html,
            "report": lambda: reported(robot, result),
            "notebook": lambda: f"<!doctype html><title>cell</title>{robot.page(result)._repr_html_()}",
        }[home]()
        path, host = folder / f"{home}.html", "nowhere"
        path.write_text(text, encoding="utf-8")
        address = path.as_uri()
    context = browser.new_context(viewport={"width": 1400, "height": 860})
    errors, outside = [], []
    try:
        tab = context.new_page()
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
        tab.on("request", lambda request: outside.append(request.url))
        tab.goto(address)
        frame = tab.main_frame if home in ("file", "live") else tab.main_frame.child_frames[0]
        frame.wait_for_function(READY, timeout=60_000)
        if frame is not tab.main_frame:  # browsers draw nothing of a frame that is out of sight
            tab.locator("iframe").scroll_into_view_if_needed()
        frame.evaluate(DRAWN)
        yield Home(tab, frame, errors, outside)
    finally:
        context.close()
        if live is not None:
            live.stop()
    assert errors == []
    own = ("file:", "data:", "blob:", "about:", f"http://{host}", f"ws://{host}")
    assert [url for url in outside if not url.startswith(own)] == []


@pytest.fixture(scope="module", params=HOMES)
def home(request, browser, robot, result, tmp_path_factory):
    with at_home(browser, request.param, robot, result, tmp_path_factory.mktemp("home")) as found:
        yield found


def test_it_shows_the_forces_of_python_and_moves_all_in_one_frame(home, result):
    """Time, forces, joints and the chart's cursor of one frame belong together; a click in a chart seeks."""
    assert home.tell("() => p3dof.state.engine !== null")  # it computes by itself, in a sandbox too
    for row in (0, 350, 1000):
        seen = home.tell(
            "time => { p3dof.seek(time); const i = p3dof.instant();"
            " return [i.time, ...['a', 'b', 'c'].map((leg) => i.values[`force_${leg}`]), ...i.q]; }",
            float(result.time[row]),
        )
        np.testing.assert_allclose(seen[:4], [result.time[row], *result.forces[row]], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(seen[4:], result.joints.q[row], atol=1e-12)
    chart = home.frame.locator("#charts .u-over").first
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    home.tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    home.wait("() => p3dof.state.time > 0.2 && p3dof.state.time < 0.8")
    holding = home.tell("() => [...p3dof.state.engine.holding([0.05, -0.02, 0.1])]")
    expected = p3dof.load().forces([0.05, -0.02, 0.1], np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(holding, expected, rtol=1e-10)


def test_it_can_be_moved_with_the_mouse(home):
    """The platform is dragged by P: the forces that hold it are those of the pose where it is."""
    x, y = home.tell(
        "() => { const { stage } = p3dof.state, { traced } = p3dof.state.document.scene;"
        " p3dof.seek(0); stage.canvas.scrollIntoView(); return stage.pixel([0, 0, 0].map((_, k) =>"
        " { const m = p3dof.instant().placements, j = 16 * traced.joint, p = traced.point;"
        " return m[j + k] * p[0] + m[j + 4 + k] * p[1] + m[j + 8 + k] * p[2] + m[j + 12 + k]; })); }"
    )
    home.tell(DRAWN)
    box = home.frame.locator("#stage canvas").bounding_box()
    mouse = home.tab.mouse
    mouse.move(box["x"] + x, box["y"] + y)
    mouse.down()
    mouse.move(box["x"] + x + 25, box["y"] + y - 15, steps=5)
    home.wait("() => p3dof.state.hand !== null")
    mouse.up()
    pose, forces = home.tell(f"() => [p3dof.instant().pose, {FORCES}]")
    assert abs(pose[0]) > 0.01
    np.testing.assert_allclose(forces, p3dof.load().forces(pose, np.zeros(3), np.zeros(3)), rtol=1e-9)


def test_a_written_page_is_small_and_alone(robot, result, browser, tmp_path):
    path = robot.page(result).save(tmp_path / "page.html")
    assert path.stat().st_size <= 1.2e6
    with at_home(browser, "file", robot, result, tmp_path) as found:
        assert found.tell(READY)
    text = path.read_text(encoding="utf-8")
    for holder in ("© 2010-2026 three.js authors", "(c) 2022 Leon Sorokin", "2019 The MessagePack Community"):
        assert holder in text


def test_all_homes_have_the_same_script(robot, result):
    def script(text):
        (found,) = re.findall(r"<script>(.*?)</script>\s*</body>", text, re.DOTALL)
        return hashlib.sha256(found.encode()).hexdigest()

    with robot.show(result, port=0) as live:
        pages = [robot.page(result).html, live._page(), live._page_of_widget()]
    inside = re.search(r'srcdoc="(.*?)"></iframe>', reported(robot, result), re.DOTALL)[1]
    cell = re.search(r'srcdoc="(.*?)" sandbox', robot.page(result)._repr_html_(), re.DOTALL)[1]
    pages += [html.unescape(inside), html.unescape(cell)]
    assert len({script(page) for page in pages}) == 1


def test_a_link_of_a_report_leads_to_an_instant_of_the_page(robot, result, browser, tmp_path):
    with at_home(browser, "report", robot, result, tmp_path) as found:
        links = found.tab.locator("a[href^='#t=']")
        href = links.nth(3).get_attribute("href")
        links.nth(3).click()
        found.wait("time => p3dof.state.time === time", float(href.removeprefix("#t=")))
        found.tell("() => p3dof.seek(0.123)")
        links.nth(3).click()  # the same again
        found.wait("time => p3dof.state.time === time", float(href.removeprefix("#t=")))
    with at_home(browser, "report", robot, result, tmp_path) as found:
        found.tab.goto(f"{(tmp_path / 'report.html').as_uri()}#t=0.35")
        found.tab.reload()
        frame = found.tab.main_frame.child_frames[0]
        frame.wait_for_function("() => window.p3dof && p3dof.state && p3dof.state.time === 0.35")


def test_waypoints_of_a_page_reach_python(browser, robot, result):
    with robot.show(result, port=0, playing=False) as live:
        seen = []
        live.follow(seen.append, "waypoints")
        context = browser.new_context()
        try:
            tab = context.new_page()
            tab.goto(live.url)
            tab.wait_for_function(READY)
            tab.wait_for_function("() => p3dof.state.connection.follow")
            tab.evaluate("() => p3dof.seek(0.5)")
            tab.get_by_role("button", name="Add this pose").click()
            tab.wait_for_function("() => p3dof.state.task.waypoints.length === 1")
            pose = tab.evaluate("() => [...p3dof.state.task.waypoints[0].pose]")
            until(tab, lambda: seen)
        finally:
            context.close()
    assert seen[-1] == live.waypoints
    assert live.waypoints[0]["pose"] == pose
    np.testing.assert_allclose(pose, result.motion.pose[500], atol=1e-3)  # the page rounds it


def test_without_webassembly_python_answers(browser, robot, result):
    """The stored run plays, and a live page asks Python where the platform is moved by hand."""
    with robot.show(result, port=0, playing=False) as live:
        context = browser.new_context()
        try:
            tab = context.new_page()
            tab.add_init_script("delete window.WebAssembly")
            tab.goto(live.url)
            tab.wait_for_function(READY)
            tab.wait_for_function("() => p3dof.state.connection.open && p3dof.state.engine")
            pose = [0.05, -0.02, 0.1]
            tab.evaluate("pose => p3dof.state.engine.move({ pose })", pose)
            tab.wait_for_function("() => p3dof.state.hand !== null")
            forces = tab.evaluate(f"() => {FORCES}")
            expected = robot.forces(pose, np.zeros(3), np.zeros(3))
            np.testing.assert_allclose(forces, expected, rtol=1e-10)
            tab.evaluate("pose => p3dof.state.engine.move({ pose })", [0.4, 0.0, 0.0])
            tab.wait_for_function("() => p3dof.state.refused !== null")
            assert tab.evaluate("() => p3dof.state.refused.legs") == ["a"]
        finally:
            context.close()


def test_a_stored_run_of_any_robot_plays_in_a_file(browser, tmp_path):
    """A five-bar with its closure and the force in it; the page moves the joints itself."""
    from documents import ROOT

    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/five_bar.urdf")
    run = p3dof.runs.simulate_robot(loop, 0.1, samples=21, method="general")
    page = p3dof.robot_page(loop, run, closure_forces=True)
    context = browser.new_context()
    try:
        tab = context.new_page()
        tab.goto(page.save(tmp_path / "five_bar.html").as_uri())
        tab.wait_for_function(READY)
        load = next(one for one in page.document["runs"][0]["loads"] if one["group"] == "multiplier")
        values = decoded(load["values"])
        for row in (0, 10, 20):
            vector = tab.evaluate(
                "([time, key]) => { p3dof.seek(time);"
                " return p3dof.instant().loads.find((one) => one.load.key === key).vector; }",
                [float(run.time[row]), load["key"]],
            )
            np.testing.assert_allclose(vector, values[row], rtol=1e-6, atol=1e-9)
        assert tab.is_enabled("#joint-0")
        assert "while Python is behind the page" not in tab.inner_text("#pose")
    finally:
        context.close()
