"""The live page in a real browser: it shows what Pinocchio says, and does what the user does."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pinocchio as pin
import pytest
from browser import chromium, opened

import p3dof

pytest.importorskip("meshcat", reason="meshcat is not installed")

from p3dof.viewer.live import LiveViewer, viewer

READY = "!document.getElementById('panel').hidden && nodeOf('meshcat/p3dof/visuals/rod_right_0/<object>')"
SPEEDS = itertools.cycle((0.5, 0.75))
LOOPS = (
    ("leg_a_tip", "platform_a"),
    ("leg_b_tip", "platform_b"),
    ("rod_right_tip", "crossbar_lower_right"),
)


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def result(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(101))


@pytest.fixture(scope="module")
def viewed(browser, robot, result):
    """One viewer and one page for all tests: a browser draws without a graphics card, and slowly."""
    with (
        LiveViewer(robot, result, port=0, playing=False) as running,
        opened(browser, running.url, ready=READY) as watched,
    ):
        yield running, watched


@pytest.fixture
def live(viewed):
    return viewed[0]


@pytest.fixture
def page(viewed):
    running, watched = viewed
    watched.page.mouse.up()
    watched.wait("held.size === 0")
    # A slider's last message may be still under way: what the page sends after it tells when it is there.
    speed = next(SPEEDS)
    watched.page.evaluate("speed => send('speed', speed)", speed)
    watched.wait("speed => state.speed === speed", speed)
    running.show_forces("total")
    running.set_speed(1.0)
    running.seek(0.0)
    watched.wait(
        """() => state.time === 0 && state.case === "total" && state.source === "motion"
           && !state.playing && state.speed === 1 && held.size === 0"""
    )
    yield watched
    watched.healthy()


def solids(robot):
    return {solid.name: f"meshcat/p3dof/visuals/{solid.name}" for solid in robot.visual_model.geometryObjects}


def placements(robot, q):
    """Where Pinocchio has the solids, (n, 4, 4)."""
    data, visuals = robot.model.createData(), robot.visual_model.createData()
    pin.forwardKinematics(robot.model, data, q)
    pin.updateGeometryPlacements(robot.model, data, robot.visual_model, visuals)
    return np.array([placement.homogeneous for placement in visuals.oMg])


def joints(robot, pose):
    """All joints as Pinocchio assembles the loops, from the platform's pose alone."""
    rest = np.zeros((1, 3))
    return robot.inverse_dynamics(p3dof.Motion([0.0], [pose], rest, rest)).joints.q[0]


def wait_for_pose(watched, robot, pose):
    places = placements(robot, joints(robot, pose)).reshape(-1, 16).tolist()
    watched.wait(
        """([paths, places]) => paths.every((path, i) => {
           const m = placeOf(path);
           return m && m.every((entry, k) => Math.abs(entry - places[i][k]) < 1e-9); })""",
        [list(solids(robot).values()), places],
    )


def frame_in_page(watched, robot, name):
    """Where a frame is in the page, told by a solid of its body there."""
    frame = robot.model.frames[robot.model.getFrameId(name)]
    solid = next(s for s in robot.visual_model.geometryObjects if s.parentJoint == frame.parentJoint)
    drawn = watched.place(solids(robot)[solid.name])
    return (drawn @ solid.placement.inverse().homogeneous @ frame.placement.homogeneous)[:3, 3]


def number(watched, name):
    return float(watched.page.inner_text(f"#{name}").split()[0].replace("\N{MINUS SIGN}", "-"))


def wait_for_number(watched, name, value, digits):
    text = f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}")  # no minus zero
    watched.wait("([id, text]) => document.getElementById(id).textContent.startsWith(text)", [name, text])


def drag(watched, slider, share):
    """Drag a thumb with the mouse to a share of its range; the button stays pressed."""
    box = watched.page.locator(f"#{slider}").bounding_box()
    low, high, value = watched.page.evaluate(
        "id => { const s = document.getElementById(id); return [+s.min, +s.max, +s.value]; }", slider
    )
    mouse, middle, thumb = watched.page.mouse, box["y"] + box["height"] / 2, 16
    left, width = box["x"] + thumb / 2, box["width"] - thumb
    mouse.move(left + width * (value - low) / (high - low), middle)
    mouse.down()
    mouse.move(left + width * share, middle, steps=4)


def colour(watched, robot, solid):
    return watched.page.evaluate(
        "path => nodeOf(path + '/<object>').object.material.color.getHexString()", solids(robot)[solid]
    )


def arrow(watched, leg):
    """The arrow's length along z0 in the page [m], positive upward; 0 when it is hidden."""
    node = f"meshcat/forces/{leg}"
    if not watched.page.evaluate("path => nodeOf(path).object.visible", node):
        return 0.0
    tip = watched.place(f"{node}/head") @ [0, 0, 1, 1]
    along = tip[:3] - watched.place(node)[:3, 3]
    np.testing.assert_allclose(along[:2], 0, atol=1e-12)
    return along[2]


def wait_for_arrow(watched, leg, length):
    """Wait until an arrow is as long as that: it comes after the numbers, by another way."""
    watched.wait(
        """([path, length]) => {
           if (!nodeOf(path).object.visible) return length === 0;
           const head = placeOf(path + "/head"), foot = placeOf(path);
           return head && foot && Math.abs(head[10] + head[11] - foot[11] - length) < 1e-9; }""",
        [f"meshcat/forces/{leg}", length],
    )


@pytest.mark.parametrize("at", [0.0, 0.37, 0.625, 1.0])
def test_every_body_is_where_pinocchio_has_it_and_the_loops_are_closed(page, live, robot, at):
    live.seek(at)
    pose = p3dof.paper_motion(8001).pose[round(8000 * at)]
    wait_for_pose(page, robot, pose)
    found = page.places(list(solids(robot).values()))
    np.testing.assert_allclose(found, placements(robot, joints(robot, pose)), rtol=0, atol=1e-9)
    assert {s.parentJoint for s in robot.visual_model.geometryObjects} == set(range(11))  # no body left out
    for first, second in LOOPS:
        gap = frame_in_page(page, robot, first) - frame_in_page(page, robot, second)
        np.testing.assert_allclose(gap, 0, atol=1e-9)


def test_numbers_and_arrows_follow_the_forces(page, live, robot, result):
    rest = np.zeros(3)
    signs = set()
    for sample in (0, 40, 100):
        pose = result.motion.pose[sample]
        static = robot.forces(pose, rest, rest)
        cases = {"total": result.forces[sample], "static": static, "dynamic": result.forces[sample] - static}
        live.seek(result.time[sample])
        for case, forces in cases.items():
            page.page.click(f"#case button[value={case}]")
            wait_for_number(page, "time-value", result.time[sample], 3)
            for leg, name in enumerate("abc"):
                wait_for_number(page, f"force-{name}", forces[leg], 2)
                wait_for_number(page, f"slider-{name}", result.sliders[sample, leg], 4)
            for leg, name in enumerate("abc"):
                wait_for_arrow(page, name, float(live.scene.scale.length(forces[leg])))
                drawn = arrow(page, name)
                assert drawn * forces[leg] >= 0
                signs.add(np.sign(drawn))
            assert page.page.get_attribute(f"#case button[value={case}]", "aria-pressed") == "true"
    assert {-1.0, 1.0} <= signs
    assert page.page.locator("#chart .curve").count() == 3


def test_the_arrows_stay_in_sight_and_the_legend_says_how_long_they_are(page, live, result):
    assert page.page.inner_text("#legend") == (
        "The grey arrow is 100 N; the longest is 118.5 N, the largest force of the motion."
    )
    drawn = page.place("meshcat/legend/arrow/head") @ [0, 0, 1, 1] - page.place("meshcat/legend")[:, 3]
    assert drawn[2] == pytest.approx(live.scene.scale.length(100.0), abs=1e-9)
    for sample in (0, 40, 100):
        live.seek(result.time[sample])
        wait_for_number(page, "force-a", result.forces[sample, 0], 2)
        assert np.abs(page.tips()).max() < 1
    live.move_to([0.1, 0.15, 0.2])  # high up
    wait_for_number(page, "z-value", 0.15, 4)
    assert np.abs(page.tips()).max() < 1


def test_a_force_beyond_the_scale_is_said_and_by_hand_there_is_another_scale(browser, robot):
    time = np.linspace(0, 1, 11)
    motion = p3dof.Motion.from_poses(time, np.stack((0.01 * time, 0 * time, 0 * time), axis=-1))
    gentle = robot.inverse_dynamics(motion)
    with (
        LiveViewer(robot, gentle, port=0, playing=False) as live,
        opened(browser, live.url, ready=READY) as page,
    ):
        page.wait("document.getElementById('legend').textContent.startsWith('The grey arrow is 50 N; ')")
        assert page.page.is_hidden("#off-scale")
        live.move_to([0.2, 0.0, 0.3])
        page.wait("document.getElementById('legend').textContent.startsWith('The grey arrow is 100 N; ')")
        assert "holds the platform at rest" in page.page.inner_text("#legend")
        assert page.page.is_hidden("#off-scale")
        live.seek(0.5)
        live._result.forces.flags.writeable = True
        live._result.forces[:] *= [1.0, 10.0, np.nan]  # what no scale has foreseen
        live.seek(1.0)
        page.wait("document.getElementById('off-scale').textContent.includes('none for C')")
        words = (
            f"B is cut off: its {gentle.forces[-1, 1]:.4g} N are beyond the longest arrow, "
            f"{live.scene.scale.newtons:.4g} N"
        )
        assert words in page.page.inner_text("#off-scale")
        assert page.page.evaluate("nodeOf('meshcat/cut/b').object.visible")
        assert not page.page.evaluate("nodeOf('meshcat/forces/c').object.visible")
        assert page.page.inner_text("#force-c") == "not determined"
        page.healthy()


def test_a_mouse_drag_moves_the_platform_and_the_numbers(page, live, robot):
    live.play()
    page.wait("document.getElementById('play').classList.contains('playing')")
    drag(page, "y", 0.75)
    page.wait("+document.getElementById('y').value > 0.13")
    page.wait(
        "document.getElementById('y-value').textContent.startsWith((+document.getElementById('y').value).toFixed(4))"
    )
    y = page.page.evaluate("+document.getElementById('y').value")
    page.page.mouse.up()
    page.wait("!document.getElementById('play').classList.contains('playing')")
    pose = live.shown.pose
    assert pose[0] == y
    assert number(page, "z-value") == pytest.approx(pose[1], abs=6e-5)
    wait_for_pose(page, robot, pose)
    for leg, force in zip("abc", robot.forces(pose, np.zeros(3), np.zeros(3)), strict=True):
        wait_for_number(page, f"force-{leg}", force, 2)
    assert page.page.inner_text("#source") == "moved by hand"
    for slider, share in (("z", 0.6), ("theta", 0.3)):
        before = number(page, f"{slider}-value")
        drag(page, slider, share)
        page.page.mouse.up()
        page.wait("([id, old]) => parseFloat(document.getElementById(id).textContent) !== old",
                  [f"{slider}-value", before])  # fmt: skip
    page.page.click("#home")
    for axis in ("y", "z", "theta"):
        wait_for_number(page, f"{axis}-value", 0.0, 4)


def test_out_of_reach_says_so_turns_the_leg_red_and_keeps_the_pose(page, live, robot):
    live.move_to([0.2, 0.01, 0.1])
    wait_for_number(page, "y-value", 0.2, 4)
    usual = {name: colour(page, robot, name) for name in ("leg_a_0", "leg_b_0", "rod_left_0")}
    drag(page, "y", 1.0)
    page.wait("document.getElementById('message').textContent.includes('leg A is too short by 0.025 m')")
    message = page.page.inner_text("#message")
    assert "The last reachable pose is kept" in message
    kept = live.shown.pose
    assert 0.2 <= kept[0] < 0.25
    wait_for_number(page, "y-value", kept[0], 4)
    wait_for_pose(page, robot, kept)
    red, green, blue = bytes.fromhex(colour(page, robot, "leg_a_0"))
    assert red > 200
    assert max(green, blue) < 50
    assert colour(page, robot, "leg_b_0") == usual["leg_b_0"]
    page.page.mouse.up()
    page.wait("y => +document.getElementById('y').value === y", kept[0])  # the thumb goes back to where it is
    assert page.page.is_visible("#message")
    drag(page, "y", 0.1)
    page.wait("document.getElementById('message').hidden")
    page.page.mouse.up()
    assert {name: colour(page, robot, name) for name in usual} == usual


def test_limits_are_told(page, live):
    live.move_to([0.0, 0.2, 0.5])
    page.wait("!document.getElementById('limits').hidden")
    assert "Beyond a limit: travel of slider C" in page.page.inner_text("#limits")
    assert page.page.locator("#slider-c.over").count() == 1


def test_time_slider_speed_and_play(page):
    drag(page, "time", 0.5)
    page.page.mouse.up()
    page.wait("Math.abs(parseFloat(document.getElementById('time-value').textContent) - 0.5) < 0.02")
    assert page.page.inner_text("#source") == "paused"
    page.page.select_option("#speed", "0.1")
    page.page.click("#play")
    page.wait("parseFloat(document.getElementById('time-value').textContent) > 0.53")
    first = page.page.screenshot()
    page.page.wait_for_timeout(300)
    assert page.page.screenshot() != first
    page.page.click("#play")
    page.wait("document.getElementById('source').textContent === 'paused'")
    stopped = page.page.inner_text("#time-value")
    page.page.wait_for_timeout(150)
    assert page.page.inner_text("#time-value") == stopped


def test_a_reload_and_a_second_page_show_the_same(browser, page, live, robot):
    pose = [0.1, -0.05, 0.2]
    live.move_to(pose)
    wait_for_pose(page, robot, pose)
    for _ in range(2):
        page.page.reload()
        page.wait(READY)
        wait_for_pose(page, robot, pose)
    wait_for_number(page, "y-value", 0.1, 4)
    with opened(browser, live.url, ready=READY) as other:
        wait_for_pose(other, robot, pose)
        drag(other, "theta", 0.9)
        other.page.mouse.up()
        other.wait("parseFloat(document.getElementById('theta-value').textContent) > 0.5")
        for watched in (page, other):
            wait_for_pose(watched, robot, live.shown.pose)
        assert live.server.pages == 2
        other.healthy()
    deadline = time.monotonic() + 5
    while live.server.pages > 1 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert live.server.pages == 1


def test_a_page_says_that_its_viewer_is_closed_and_a_new_one_has_a_new_address(browser, robot):
    with LiveViewer(robot, port=0) as live, opened(browser, live.url, ready=READY) as watched:
        port = live.server.port
        live.stop()
        watched.wait("document.getElementById('link').className === 'off'")
        assert "A new one has a new address" in watched.page.inner_text("#message")
        with LiveViewer(robot, port=port) as again:
            assert again.url.partition("token=")[0] == live.url.partition("token=")[0]
            watched.page.goto(again.url)
            watched.wait(READY)
            watched.wait("document.getElementById('link').className === ''")
            assert not watched.page.is_visible("#motion")  # there is none
            drag(watched, "z", 0.9)
            watched.page.mouse.up()
            watched.wait("parseFloat(document.getElementById('z-value').textContent) > 0.1")
            assert again.shown.pose[1] > 0.1


def test_a_page_whose_connection_is_lost_comes_back(browser, robot):
    with LiveViewer(robot, port=0) as live, opened(browser, live.url, ready=READY) as watched:
        for channel in (live.server._scenes, live.server._panels):  # either of the two
            watched.page.evaluate("window.before = true")
            (page,) = channel.pages
            live.server._loop.call_soon_threadsafe(page.hang_up)
            watched.wait("document.getElementById('link').className === 'off'")
            watched.wait("!window.before && document.getElementById('link').className === ''")
            watched.wait(READY)


def test_a_page_that_floods_says_why_it_was_closed_while_another_goes_on(browser, page, live):
    with opened(browser, live.url, ready=READY) as flooding:
        flooding.page.evaluate("for (let i = 0; i < 20000; i++) socket.send('[]')")
        flooding.wait("document.getElementById('message').textContent.includes('too many messages')")
        assert flooding.page.inner_text("#message").startswith("The viewer has closed this page: too many")
        page.page.click("#home")
        page.wait("state.source === 'pose'")
        assert live.server.pages == 1


def test_a_notebook_shows_the_page(browser, live, tmp_path):
    live.show_forces("total")
    live.seek(0.0)
    (tmp_path / "cell.html").write_text(live._repr_html_(), encoding="utf-8")
    with opened(
        browser, (tmp_path / "cell.html").as_uri(), ready="!!document.querySelector('iframe')"
    ) as cell:
        frame = cell.page.frame_locator("iframe")
        frame.locator("#force-a").get_by_text("52.21 N").wait_for()
        assert cell.errors == []


def test_the_plain_visualizer_has_a_page(browser, robot):
    shown = viewer(robot, port=0)
    try:
        with opened(
            browser, shown.viewer.url(), ready="nodeOf('meshcat/p3dof/visuals/rod_right_0')"
        ) as watched:
            pose = [0.05, 0.02, -0.1]
            shown.display(joints(robot, pose))
            wait_for_pose(watched, robot, pose)
            assert not watched.page.is_visible("#panel")
            watched.healthy()
    finally:
        shown.viewer.close()
    assert shown.viewer.url() == ""
