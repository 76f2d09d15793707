"""The 3D picture of the page in a real browser: what is drawn is where Python says, and follows the hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from pages import DRAWN, SETTLED, as_new, placements, shared

import p3dof
from p3dof.design import clearance_of
from p3dof.viewer.document.html import page_html
from p3dof.viewer.machine.document import page_document
from p3dof.viewer.machine.room import joints_of

VIEWS = ("3d", "front", "side", "top")
P = """() => {
    const { state } = p3dof, { left, top } = state.stage.canvas.getBoundingClientRect();
    const { joint, point } = state.stage.contents.of.traced, m = p3dof.instant().placements.slice(16 * joint);
    const at = [0, 1, 2].map((k) => m[k] * point[0] + m[4 + k] * point[1] + m[8 + k] * point[2] + m[12 + k]);
    const [x, y] = state.stage.pixel(at);
    return [x + left, y + top];
}"""
KNOB = """() => {
    const { stage } = p3dof.state, { left, top } = stage.canvas.getBoundingClientRect();
    const [x, y] = stage.pixel(stage.contents.handles.knob.position.toArray());
    return [x + left, y + top];
}"""


@pytest.fixture(scope="module")
def machine():
    return p3dof.Manipulator()


@pytest.fixture(scope="module")
def result(machine):
    return machine.inverse_dynamics(p3dof.paper_motion(201))


@pytest.fixture(scope="module")
def written(machine, result, tmp_path_factory):
    path = tmp_path_factory.mktemp("pages") / "page.html"
    motion = p3dof.paper_motion(101)
    other = p3dof.Motion(motion.time, -motion.pose, -motion.velocity, -motion.acceleration)
    document = page_document(machine, result, runs={"mirrored": other})
    path.write_text(page_html(document), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def opened_once(browser, written):
    with shared(browser, written, 1200, 800) as watched:
        yield watched


@pytest.fixture
def watched(opened_once):
    opened_once.page.evaluate("p3dof.state.stage.drawn.delete(window.listener)")
    as_new(opened_once).page.evaluate("p3dof.state.stage.look('3d')")
    yield opened_once
    opened_once.healthy()


def shown(watched):
    """Wait until what was changed last is shown."""
    watched.page.evaluate(SETTLED)


def look(watched, view):
    watched.page.click(f'button[data-view="{view}"]')
    watched.wait("view => p3dof.state.view === view", view)
    shown(watched)


def expected(machine, pose):
    """The same by Pinocchio."""
    data = machine.model.createData()
    pin.forwardKinematics(machine.model, data, joints_of(machine, pose))
    return np.stack([data.oMi[i].homogeneous for i in range(1, machine.model.njoints)])


def holding(machine, pose):
    """The forces that hold a pose [N]."""
    still = p3dof.Motion([0.0], [pose], np.zeros((1, 3)), np.zeros((1, 3)))
    return machine.inverse_dynamics(still).forces[0]


def values(watched):
    return np.array([arrow["value"] for arrow in watched.page.evaluate(DRAWN)])


def hold(watched, pose):
    watched.page.evaluate(
        "pose => { p3dof.state.set({ hand: { pose } }); p3dof.state.refresh(); }", list(pose)
    )


def test_every_joint_is_drawn_where_pinocchio_has_it(watched, machine, result):
    for i in (0, 57, 200):
        watched.page.evaluate("time => p3dof.seek(time)", float(result.motion.time[i]))
        assert_allclose(placements(watched), expected(machine, result.motion.pose[i]), rtol=0, atol=1e-12)
        assert_allclose(values(watched), result.forces[i], rtol=1e-12)
    for pose in np.random.default_rng(5).uniform([-0.08, -0.08, -0.5], [0.08, 0.08, 0.5], (8, 3)):
        hold(watched, pose)
        assert_allclose(placements(watched), expected(machine, pose), rtol=0, atol=1e-12)
        forces = holding(machine, pose)
        assert_allclose(values(watched), forces, rtol=0, atol=1e-12 * abs(forces).max())


def test_with_other_lengths_the_machine_that_is_drawn_is_the_one_that_is_computed(watched, machine):
    lengths = {"L": 0.46, "R": 0.285, "r": 0.085}
    watched.page.evaluate("whatIf => p3dof.state.set({ whatIf, compare: null })", lengths)
    other = p3dof.Manipulator(
        replace(machine.parameters, geometry=replace(machine.parameters.geometry, **lengths))
    )
    for pose in ([0.03, -0.05, 0.3], [-0.06, 0.02, -0.4]):
        hold(watched, pose)
        assert_allclose(placements(watched), expected(other, pose), rtol=0, atol=1e-12)
    ends = watched.page.evaluate(
        """() => { const { stage } = p3dof.state;
        stage.contents.closures.show(p3dof.instant().placements, true);
        return stage.contents.closures.ends.map((pair) => pair.map((ball) => ball.position.toArray())); }"""
    )
    gaps = np.diff(np.array(ends), axis=1)
    assert abs(gaps).max() < 1e-12  # the loops of what is drawn are closed
    assert watched.page.evaluate("p3dof.state.stage.contents.ghost.group.visible")  # the machine before
    watched.page.evaluate("() => p3dof.state.set({ whatIf: {}, hand: null })")
    shown(watched)
    assert not watched.page.evaluate("p3dof.state.stage.contents.ghost?.group.visible ?? false")


def test_a_run_that_is_compared_is_a_ghost_at_the_same_instant(watched, machine, result):
    watched.page.evaluate("() => { p3dof.state.set({ compare: 1 }); p3dof.seek(0.5); }")
    ghost = """() => p3dof.state.stage.contents.ghost.joints.flatMap(({ matrix }) => matrix.elements)"""
    found = np.reshape(watched.page.evaluate(ghost), (-1, 4, 4)).transpose(0, 2, 1)
    assert_allclose(found, expected(machine, -result.motion.pose[100]), rtol=0, atol=1e-12)
    assert_allclose(placements(watched), expected(machine, result.motion.pose[100]), rtol=0, atol=1e-12)
    watched.page.evaluate("() => { p3dof.state.set({ compare: null }); p3dof.state.refresh(); }")
    assert not watched.page.evaluate("p3dof.state.stage.contents.ghost.group.visible")


@pytest.mark.parametrize("view", VIEWS)
def test_the_hand_drags_p_under_the_pointer_and_the_forces_follow(watched, machine, view):
    watched.page.evaluate("() => p3dof.seek(0.35)")
    look(watched, view)
    x, y = watched.page.evaluate(P)
    watched.page.mouse.move(x, y)
    watched.page.mouse.down()
    for share in (0.2, 0.5, 1.0):
        watched.page.mouse.move(x + 25 * share, y - 15 * share)
    shown(watched)
    u, v = watched.page.evaluate(P)
    if view != "side":  # which sees along y
        assert abs(u - x - 25) < 1
    if view != "top":  # which sees along z
        assert abs(v - y + 15) < 1
    watched.page.mouse.up()
    pose = watched.page.evaluate("() => p3dof.state.hand.pose")
    assert pose[2] == pytest.approx(p3dof.paper_motion(1001).pose[350, 2])
    assert_allclose(placements(watched), expected(machine, pose), rtol=0, atol=1e-12)
    assert_allclose(values(watched), holding(machine, pose), rtol=1e-11)
    assert not watched.page.evaluate("p3dof.state.stage.touched")  # the camera stays
    watched.page.locator("#stage .back").click()
    watched.wait("p3dof.state.hand === null")


def test_a_finger_drags_p_and_the_page_does_not_scroll(browser, written):
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    try:
        page = context.new_page()
        page.goto(written)
        page.evaluate("async () => { await p3dof.ready; p3dof.seek(0.2); }")
        x, y = page.evaluate(P)
        client = context.new_cdp_session(page)
        for kind, along in (("Start", 0), ("Move", 4), ("Move", 9), ("Move", 15)):
            point = {"x": x + along, "y": y - along}
            client.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": [point]})
        page.evaluate(SETTLED)
        u, v = page.evaluate(P)
        client.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        assert abs(u - x - 15) < 1
        assert abs(v - y + 15) < 1
        assert page.evaluate("[scrollX, scrollY]") == [0, 0]
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
    finally:
        context.close()


def test_the_ring_turns_the_platform_and_a_bar_does_where_it_is_edge_on(watched, machine):
    watched.page.evaluate("() => p3dof.seek(0)")
    look(watched, "side")
    bar = watched.page.locator("#stage .tilt")
    assert not bar.is_visible()
    centre, knob = np.array(watched.page.evaluate(P)), np.array(watched.page.evaluate(KNOB))
    turn = np.radians(20)  # about y, which points away from the eye: on the screen clockwise
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    watched.page.mouse.move(*knob)
    watched.page.mouse.down()
    watched.page.mouse.move(*(centre + rotation @ (knob - centre)), steps=4)
    watched.page.mouse.up()
    shown(watched)
    pose = watched.page.evaluate("() => p3dof.instant().pose")
    assert_allclose(pose, [0.0, 0.0, turn], rtol=0, atol=1e-3)
    assert_allclose(placements(watched), expected(machine, pose), rtol=0, atol=1e-12)
    look(watched, "front")
    assert bar.is_visible()
    watched.page.locator("#stage .tilt input").focus()
    watched.page.keyboard.press("Home")
    shown(watched)
    low = machine.parameters.limits.tilt[0]
    assert watched.page.evaluate("() => p3dof.instant().pose[2]") == pytest.approx(low)
    assert bar.inner_text() == "θ −45.0°"


def test_outside_the_workspace_the_last_pose_stays_and_the_leg_is_named_and_red(watched, machine):
    watched.page.evaluate("() => p3dof.seek(0)")
    look(watched, "front")
    x, y = watched.page.evaluate(P)
    watched.page.mouse.move(x, y)
    watched.page.mouse.down()
    poses, refused = [], None
    for step in range(40):
        watched.page.mouse.move(x + 80 + 6 * step, y)
        shown(watched)
        refused = watched.page.evaluate("() => p3dof.state.refused")
        if refused:
            break
        poses.append(watched.page.evaluate("() => p3dof.instant().pose"))
    assert refused["legs"] == ["a"]
    assert "leg A is" in watched.page.locator("#stage .refused").inner_text()
    assert watched.page.evaluate("() => p3dof.instant().pose") == poses[-1]
    assert_allclose(placements(watched), expected(machine, poses[-1]), rtol=0, atol=1e-12)
    geometry = machine.parameters.geometry
    flat = geometry.L - (geometry.R - geometry.r)  # the leg lies flat
    assert flat - 0.02 < poses[-1][0] <= flat
    red = """() => Object.fromEntries(p3dof.state.stage.contents.solids.meshes
        .filter(({ userData }) => userData.solid.leg)
        .map(({ material, userData }) => [userData.solid.leg, material.emissive.getHex() > 0]))"""
    assert watched.page.evaluate(red) == {"a": True, "b": False, "c": False}
    watched.page.mouse.move(x + 600, y)  # no leg reaches that far: the first to blame
    shown(watched)
    assert watched.page.evaluate("() => p3dof.state.refused.legs") == ["a"]
    text = watched.page.locator("#stage .refused").inner_text()
    short = float(text.partition("leg A is ")[2].partition(" mm")[0])
    assert short > 100
    assert "leg B" not in text
    assert watched.page.evaluate("() => p3dof.instant().pose") == poses[-1]
    watched.page.mouse.up()
    shown(watched)
    assert watched.page.evaluate(red) == {"a": True, "b": False, "c": False}  # until that pose is left
    assert watched.page.locator("#stage .refused").inner_text() == text
    watched.page.keyboard.press("Escape")
    shown(watched)
    assert watched.page.evaluate(red) == {"a": False, "b": False, "c": False}
    assert not watched.page.locator("#stage .refused").is_visible()


@pytest.mark.parametrize("view", VIEWS)
def test_arrows_are_to_scale_with_their_newtons_at_the_tip_and_inside_the_picture(watched, result, view):
    look(watched, view)
    width, height = watched.page.evaluate("() => [p3dof.state.stage.width, p3dof.state.stage.height]")
    scale = set()
    for i in range(0, 201, 25):
        watched.page.evaluate("time => p3dof.seek(time)", float(result.motion.time[i]))
        for arrow, force in zip(watched.page.evaluate(DRAWN), result.forces[i], strict=True):
            assert arrow["value"] == pytest.approx(force)
            assert not arrow["cut"]
            scale.add(round(arrow["drawn"] / abs(force), 9))
            decimals = 0 if abs(force) >= 100 else 1
            assert arrow["words"] == f"{force:.{decimals}f} N"
            x, y = arrow["tip"]
            assert 0 < x < width
            assert 0 < y < height
            x, y, half, high = arrow["text"]
            assert half < x < width - half
            assert high < y < height - high
    assert len(scale) == 1


def test_nothing_hides_an_arrow_from_any_side(watched):
    watched.see()
    watched.page.evaluate("() => p3dof.seek(0.9)")
    colours = """async (azimuth) => {
        const { state } = p3dof, { stage } = state, gl = stage.renderer.getContext();
        const shown = stage.contents.arrows, [first, second] = [gl.RGBA, gl.UNSIGNED_BYTE];
        stage.cameras.used.position.set(Math.cos(azimuth), Math.sin(azimuth), 0.3).add(stage.target);
        stage.look();
        const seen = () => {
            stage.contents.place();
            stage.refine();
            const ratio = stage.canvas.width / stage.width;
            return p3dof.instant().loads.flatMap(({ load, at }) => {
                const { drawn } = shown.drawn.find(({ key }) => key === load.key), pixel = new Uint8Array(4);
                const [x, y] = stage.pixel([at[0], at[1], at[2] + drawn / 2]);
                gl.readPixels(ratio * x, stage.canvas.height - ratio * y, 1, 1, first, second, pixel);
                return [...pixel.slice(0, 3)];
            });
        };
        const found = seen();
        for (const name of ["frame", "machine", "rails"]) state.layers[name] = false;
        const alone = seen();
        for (const name of ["frame", "machine", "rails"]) state.layers[name] = true;
        return [found, alone];
    }"""
    for azimuth in np.radians(range(0, 360, 15)):
        found, alone = watched.page.evaluate(colours, float(azimuth))
        assert found == alone


def test_keys_show_the_same_views_as_buttons(watched):
    places = "() => [p3dof.state.stage.cameras.used.position.toArray(), p3dof.state.layers.parallel]"
    for key, view in zip("1234", VIEWS, strict=True):
        look(watched, view)
        by_button = watched.page.evaluate(places)
        look(watched, VIEWS[(VIEWS.index(view) + 1) % 4])
        watched.page.locator("#stage canvas").hover(position={"x": 5, "y": 400})
        watched.page.keyboard.press(key)
        watched.wait("view => p3dof.state.view === view", view)
        shown(watched)
        assert watched.page.evaluate(places) == by_button


def test_a_picture_that_the_driver_loses_is_told_and_comes_back(watched):
    watched.see()
    note = watched.page.locator("#stage .stage-note")
    assert not note.is_visible()
    watched.page.evaluate("() => { p3dof.seek(0.3); p3dof.state.stage.renderer.forceContextLoss(); }")
    watched.wait("!document.querySelector('#stage .stage-note').hidden")
    assert "everything else works" in note.inner_text()
    watched.page.evaluate("() => p3dof.seek(0.6)")
    assert "0.600 s" in watched.page.locator("#time-bar").inner_text()
    watched.page.evaluate("() => p3dof.state.stage.renderer.forceContextRestore()")
    watched.wait("document.querySelector('#stage .stage-note').hidden")
    shown(watched)
    many = """() => { const { stage } = p3dof.state, gl = stage.renderer.getContext(); stage.refine();
        const pixels = new Uint8Array(4 * stage.canvas.width * stage.canvas.height);
        gl.readPixels(0, 0, stage.canvas.width, stage.canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        return new Set(new Uint32Array(pixels.buffer)).size; }"""
    assert watched.page.evaluate(many) > 100


def test_an_arrow_that_leaves_the_picture_is_cut_there_and_says_so(watched):
    watched.page.evaluate("() => p3dof.seek(1)")
    box = watched.page.locator("#stage canvas").bounding_box()
    watched.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for _ in range(8):
        watched.page.mouse.wheel(0, -400)
        shown(watched)
    watched.wait("p3dof.state.stage.touched")
    arrows = watched.page.evaluate(DRAWN)
    assert any(arrow["cut"] for arrow in arrows)
    for arrow in arrows:
        x, y, half, high = arrow["text"]
        assert half < x < box["width"] - half
        assert high < y < box["height"] - high
        assert arrow["words"].endswith("⋯") == arrow["cut"]
        assert arrow["drawn"] <= arrow["length"]
    watched.page.get_by_role("button", name="Fit").click()
    shown(watched)
    assert not any(arrow["cut"] for arrow in watched.page.evaluate(DRAWN))


def test_turning_the_camera_leaves_the_named_view_and_time_alone(watched):
    look(watched, "front")
    watched.page.evaluate("() => p3dof.seek(0.4)")
    box = watched.page.locator("#stage canvas").bounding_box()
    watched.page.mouse.move(box["x"] + 60, box["y"] + 300)
    watched.page.mouse.down()
    watched.page.mouse.move(box["x"] + 160, box["y"] + 260, steps=4)
    watched.page.mouse.up()
    watched.wait("p3dof.state.view === 'free'")
    assert watched.page.evaluate("[p3dof.state.time, p3dof.state.hand]") == [0.4, None]
    assert watched.page.locator('[data-view][aria-pressed="true"]').count() == 0


def test_each_layer_can_be_hidden(watched):
    watched.see()
    watched.page.evaluate("() => p3dof.seek(0.4)")
    picture = "() => p3dof.state.stage.picture()"
    before = watched.page.evaluate(picture)
    for name in (
        "machine",
        "frame",
        "rails",
        "axes",
        "names",
        "trace",
        "forces",
        "closures",
        "section",
        "parallel",
    ):
        box = watched.page.locator(f'#layers input[name="{name}"]')
        box.click()
        shown(watched)
        assert watched.page.evaluate(picture) != before, name
        box.click()
        shown(watched)
        assert watched.page.evaluate(picture) == before, name


def test_dark_is_dark(watched):
    watched.see()
    ground = """() => { const { stage } = p3dof.state; stage.render(); const gl = stage.renderer.getContext();
        const pixel = new Uint8Array(4); gl.readPixels(2, 2, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        return Math.max(...pixel.slice(0, 3)); }"""
    watched.page.evaluate("() => p3dof.state.set({ theme: 'light' })")
    watched.wait("document.documentElement.dataset.theme === 'light'")
    shown(watched)
    assert watched.page.evaluate(ground) > 200
    watched.page.evaluate("() => p3dof.state.set({ theme: 'dark' })")
    watched.wait("document.documentElement.dataset.theme === 'dark'")
    shown(watched)
    assert watched.page.evaluate(ground) < 60


def test_no_picture_mixes_two_instants_while_the_page_plays(watched, result):
    watched.page.evaluate(
        """() => { const { state } = p3dof, { stage } = state; window.found = [];
        stage.drawn.add(window.listener = () => {
            const now = p3dof.instant(), { joints } = stage.contents.solids;
            found.push([now.time, state.time, joints[0].matrix.elements[14], now.values.slider_a,
                stage.contents.arrows.drawn[0].value, now.values.force_a]); });
        state.set({ playing: true, speed: 4 }); }"""
    )
    watched.wait("found.length > 12")
    found = np.array(watched.page.evaluate("() => { p3dof.state.set({ playing: false }); return found; }"))
    assert len(set(found[:, 0])) > 5
    for one, other in ((0, 1), (2, 3), (4, 5)):
        assert_allclose(found[:, one], found[:, other], rtol=0, atol=1e-12)
    assert_allclose(found[:, 5], np.interp(found[:, 0], result.motion.time, result.forces[:, 0]), rtol=1e-12)


@pytest.mark.parametrize("drawn", ["refine", "redraw"])
def test_a_picture_between_a_change_and_its_refresh_shows_one_instant(watched, drawn):
    """A timer or a turned camera may draw when the state has another time, and nothing was put there yet."""
    watched.page.evaluate("() => { p3dof.state.set({ playing: false }); p3dof.seek(0.1); }")
    watched.page.evaluate(SETTLED)
    watched.page.evaluate(
        """(drawn) => { const { state } = p3dof, { stage } = state; window.found = [];
        stage.drawn.add(window.listener = () => found.push(
            [stage.contents.solids.joints[0].matrix.elements[14], p3dof.instant().values.slider_a]));
        if (drawn === "redraw") stage.redraw(); // its frame comes before that of the refresh
        state.set({ time: 0.7 });
        if (drawn === "refine") stage.refine(); }""",
        drawn,
    )
    watched.wait("found.length > 0")
    found = np.array(watched.page.evaluate("() => found"))
    assert_allclose(found[:, 0], found[:, 1], rtol=0, atol=1e-12)
    assert watched.page.evaluate("p3dof.instant().time") == 0.7


NEAREST = """() => {
    const { nearest } = p3dof.state.stage.contents;
    return {
        seen: nearest.group.visible && nearest.text.sprite.visible, text: nearest.text.text,
        ends: nearest.ends.map(({ position }) => position.toArray()),
        colour: `#${nearest.line.color.getHexString()}`,
    };
}"""


def test_the_nearest_parts_are_joined_by_a_line_with_its_length(browser, machine, result, tmp_path):
    """As Python has them at samples; not in a hand, with other lengths, or when the layer is off."""
    clearance = clearance_of(machine, result, required=0.004)
    path = tmp_path / "page.html"
    path.write_text(page_html(page_document(machine, result, clearance=clearance)), encoding="utf-8")
    least, points = clearance.distances.min(axis=1), clearance.nearest_points()
    pairs = [" and ".join(clearance.pairs[pair]) for pair in clearance.distances.argmin(axis=1)]
    with shared(browser, path.as_uri(), 1200, 800) as watched:
        for i in (0, 100, int(least.argmin())):
            watched.page.evaluate("time => p3dof.seek(time)", float(result.time[i]))
            found = watched.page.evaluate(NEAREST)
            assert found["seen"]
            assert_allclose(found["ends"], points[i], rtol=0, atol=1e-12)
            name, _, length = found["text"].removesuffix(" mm").rpartition(" ")
            assert name == pairs[i]
            assert float(length) == pytest.approx(1e3 * least[i], rel=5e-4)
            assert found["colour"] == ("#d32f2f" if least[i] < 0.004 else "#7b1fa2")
        assert least.min() < 0.004 < least.max()
        for change in (
            "{ layers: { ...p3dof.state.layers, nearest: false } }",
            "{ hand: { pose: [0, 0, 0] } }",
        ):
            watched.page.evaluate(f"p3dof.state.set({change})")
            shown(watched)
            assert not watched.page.evaluate(NEAREST)["seen"]
            watched.page.evaluate(
                "p3dof.state.set({ hand: null, layers: { ...p3dof.state.layers, nearest: true } })"
            )
            shown(watched)
            assert watched.page.evaluate(NEAREST)["seen"]
        last = (
            "p3dof.state.solved?.curves.find(({ key }) => key === 'least_distance').values.data.at(-1) ?? 0"
        )
        for change, known in (("{ L: 0.41 }", False), ("{ payload: 1 }", True)):
            watched.page.evaluate(f"p3dof.state.set({{ whatIf: {change} }})")
            shown(watched)
            assert watched.page.evaluate(NEAREST)["seen"] is known
            assert watched.page.evaluate(f"Number.isFinite({last})") is known
        watched.healthy()


def test_in_software_edges_are_smooth_when_nothing_moves(watched):
    fine = "p3dof.state.stage.canvas.width === 2 * p3dof.state.stage.width"
    watched.page.evaluate("() => p3dof.seek(0.1)")
    assert watched.page.evaluate(fine)  # scripts that look right after it see the best picture
    watched.page.evaluate("() => p3dof.state.set({ playing: true })")
    watched.wait("p3dof.state.stage.canvas.width <= p3dof.state.stage.width")  # less where frames are slow
    watched.page.evaluate("() => p3dof.state.set({ playing: false })")
    watched.wait(fine)
    width = watched.page.evaluate("p3dof.state.stage.width")
    assert watched.page.locator("#stage canvas").bounding_box()["width"] == width
