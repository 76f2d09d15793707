"""The live page of any robot in a real browser, with two robots of the gallery; and the methods behind it."""

from __future__ import annotations

import threading
from pathlib import Path

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest

import p3dof
from p3dof.closed_loop.compiled.build import compiler
from p3dof.errors import InputError

pytest.importorskip("meshcat", reason="meshcat is not installed")
from browser import chromium, opened

from p3dof.page.robots.motion import held
from p3dof.page.robots.ranges import slider_ranges
from p3dof.viewer import JointMotion
from p3dof.viewer.headless import as_image
from p3dof.viewer.robots.hand import Hand, compiled_of
from p3dof.viewer.robots.live import RobotViewer

GALLERY = Path(__file__).parents[1] / "docs/_static/gallery"
READY = (
    "!document.getElementById('panel').hidden && !!state && nodeOf('meshcat/closures/0/first/ball/<object>')"
)


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def stewart():
    return p3dof.load_robot(GALLERY / "stewart.urdf")


@pytest.fixture(scope="module")
def gripper():
    return p3dof.load_robot(GALLERY / "gripper.urdf")


def drag(watched, slider, share):
    """Drag a slider with the mouse to a share of its length."""
    box = watched.page.locator(f"#{slider}").bounding_box()
    middle = box["y"] + box["height"] / 2
    now = watched.page.evaluate(
        "id => { const s = document.getElementById(id); return (s.value - s.min) / (s.max - s.min); }", slider
    )
    mouse = watched.page.mouse
    mouse.move(box["x"] + 8 + now * (box["width"] - 16), middle)
    mouse.down()
    mouse.move(box["x"] + 8 + share * (box["width"] - 16), middle, steps=6)


def pixels(watched):
    png = watched.page.locator("#pane canvas").screenshot()
    return np.asarray(as_image(png)).astype(int)


def frame_place(robot, q, name):
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(name)].translation


@pytest.mark.parametrize(
    ("name", "slider", "share"), [("stewart", "joint-2", 0.55), ("gripper", "joint-0", 0.7)]
)
def test_a_slider_moves_a_joint_and_the_loops_stay_closed(browser, request, name, slider, share):
    robot = request.getfixturevalue(name)
    with RobotViewer(robot, port=0) as live, opened(browser, live.url, 1000, 640, READY) as watched:
        assert watched.page.inner_text("#title") == name
        before, first = watched.page.evaluate("state.joints"), pixels(watched)
        index = int(slider[-1])
        drag(watched, slider, share)
        wanted = "i => Math.abs(state.joints[i] - document.getElementById(`joint-${i}`).value) < 1e-9"
        watched.wait(f"i => ({wanted})(i) && Math.abs(state.joints[i] - {before[index]}) > 0.02", index)
        watched.page.mouse.up()
        watched.wait("held.size === 0")
        assert watched.page.locator("#message").is_hidden()
        joints = watched.page.evaluate("state.joints")
        still = [i for i in range(len(joints)) if i != index]
        np.testing.assert_allclose(np.array(joints)[still], np.array(before)[still], rtol=0, atol=1e-12)
        q = live.shown.q
        assert np.abs(robot.closure_error(q)).max() < 1e-12
        for i, closure in enumerate(robot.sidecar.closures):
            node = f"meshcat/closures/{i}/first"
            goal = frame_place(robot, q, closure.frame2).tolist()
            watched.wait(
                "([node, goal]) => { const m = placeOf(node);"
                " return m && goal.every((x, i) => Math.abs(m[4 * i + 3] - x) < 1e-6); }",
                [node, goal],
            )
        held = robot.inverse_dynamics(q, np.zeros(robot.model.nv), np.zeros(robot.model.nv))
        unit = watched.page.evaluate("setup.actuators[0].unit")
        written = watched.page.evaluate("state.forces.map(parseFloat)")
        np.testing.assert_allclose(written, held.tau, rtol=6e-4, atol=1e-9)
        assert unit in watched.page.inner_text("#actuators")
        assert np.abs(pixels(watched) - first).max(axis=2).mean() > 0.5
        watched.healthy()


def test_out_of_reach_is_told_and_the_picture_stays(browser, stewart):
    with RobotViewer(stewart, port=0) as live, opened(browser, live.url, 900, 600, READY) as watched:
        before, place = live.shown.q, watched.place("meshcat/closures/0/first")
        watched.page.evaluate("send('joints', [0.4, 0.9, 0.4, 0.9, 0.4, 0.9])")
        watched.wait("state.message.startsWith('the loops do not close')")
        assert "The picture stays" in watched.page.inner_text("#message")
        assert "the loops do not close" in live.message
        np.testing.assert_array_equal(live.shown.q, before)
        np.testing.assert_array_equal(watched.place("meshcat/closures/0/first"), place)
        watched.page.click("#home")
        watched.wait("state.message === ''")
        watched.healthy()


def test_layers_are_chosen_in_the_page_and_by_a_method(browser, gripper):
    with RobotViewer(gripper, port=0) as live, opened(browser, live.url, 900, 600, READY) as watched:
        forces = "nodeOf('meshcat/closure_forces').object.visible"
        watched.wait(f"!{forces}")
        watched.page.check("#layer-closure_forces")
        watched.wait(f"{forces} && nodeOf('meshcat/closure_forces/0/part_of_force').object.visible")
        assert "in part" in watched.page.inner_text("#closures")
        assert "coupling gears" in watched.page.inner_text("#closures")
        live.show_layers(closures=False)
        watched.wait(
            "!nodeOf('meshcat/closures').object.visible && !document.getElementById('layer-closures').checked"
        )
        watched.healthy()


def test_a_run_is_played_and_the_hand_goes_on_from_where_it_is(browser):
    robot = p3dof.load_robot(GALLERY / "four_bar.urdf")
    run = p3dof.simulation.simulate_robot(robot, 0.4, samples=81)
    with (
        p3dof.show_robot(robot, run, port=0, playing=False) as live,
        opened(browser, live.url, 900, 600, READY) as watched,
    ):
        assert not watched.page.locator("#motion").is_hidden()
        for index in (0, 40, 80):
            live.seek(float(run.time[index]))
            angle = float(run.q[index, 0])
            watched.wait(
                "([t, x]) => state.time === t && Math.abs(state.joints[0] - x) < 1e-9",
                [float(run.time[index]), angle],
            )
        watched.page.click("#play")
        watched.wait("end => state.playing && state.time < end", float(run.time[-1]))
        watched.page.click("#play")
        watched.wait("!state.playing")
        now = watched.page.evaluate("state.joints[0]")
        watched.page.evaluate("x => send('joints', [x])", now + 0.05)
        watched.wait("x => state.source === 'pose' && Math.abs(state.joints[0] - x) < 1e-9", now + 0.05)
        watched.healthy()


def test_the_page_writes_names_and_never_runs_them(browser):
    text = robots.four_bar(*robots.FOUR_BAR).replace("crank_joint", "&lt;img src=x onerror=window.bad=1&gt;")
    loop = p3dof.ClosedLoopModel.from_urdf(
        text,
        p3dof.Sidecar((p3dof.Closure("coupler_tip", "rocker_tip"),), ("<img src=x onerror=window.bad=1>",)),
    )
    with (
        RobotViewer(loop, JointMotion([0.0], [robots.four_bar_q(0.7, *robots.FOUR_BAR)]), port=0) as live,
        opened(browser, live.url, 700, 500, READY) as watched,
    ):
        assert watched.page.inner_text("#sliders label") == "<img src=x onerror=window.bad=1>"
        assert watched.page.evaluate("window.bad === undefined")
        watched.healthy()


# --- without a browser --------------------------------------------------------------------------------------


def test_methods_move_it_home_and_away_and_say_what_is_wrong(gripper):
    before = set(threading.enumerate())  # other tests may have left some, such as those of the kernels
    with RobotViewer(gripper, port=0) as live:
        start = live.shown.q
        live.move_to({"left_drive": 0.6})
        wait_until(live, lambda: abs(live.shown.q[0] - 0.6) < 1e-9)
        live.home()
        wait_until(live, lambda: np.array_equal(live.shown.q, start))
        live.move_to([0.5])
        wait_until(live, lambda: abs(live.shown.q[0] - 0.5) < 1e-9)
        for bad, words in (
            (lambda: live.move_to([9.0]), "left_drive: expected a number from"),
            (lambda: live.move_to([0.1, 0.2]), r"joints: expected shape \(1,\)"),
            (lambda: live.move_to({"right_drive": 0.1}), "'right_drive' is not actuated"),
            (live.play, "play: there is no motion to play"),
            (lambda: live.show_layers(legs=True), "layers: expected some of"),
            (lambda: live.received({"type": "pose", "value": [0, 0, 0]}), "or layers, got 'pose'"),
        ):
            with pytest.raises(InputError, match=words):
                bad()
        port = live.server.port
    assert f"{port}" not in repr(live)
    assert not [t for t in threading.enumerate() if t.name.startswith("p3dof") and t not in before]


def wait_until(live, condition):
    """Wait for a frame in which something holds."""
    page = threading.Event()
    for _ in range(500):
        if condition():
            return
        live.greeting()
        page.wait(0.01)
    raise AssertionError(live.message)


def test_a_hand_does_not_jump_to_another_assembly():
    """The rod and rocker of this four-bar meet in a line before the crank has made its turn."""
    lengths = (0.5, 0.4, 0.25, 0.25)  # ground, crank, coupler, rocker: not of Grashof's kind
    loop = p3dof.ClosedLoopModel.from_urdf(robots.four_bar(*lengths), robots.FOUR_BAR_SIDECAR)
    hand = Hand(loop, loop.assemble([0.6]).q)
    for angle in np.arange(0.62, 2.0, 0.02):
        if not hand.moves_to(np.array([angle])):
            break
    assert "another assembly" in hand.refused or "do not close" in hand.refused
    assert hand.values[0] < angle
    assert np.abs(loop.closure_error(hand.q)).max() < 1e-12
    q = hand.q
    assert not hand.moves_to(np.array([angle]))
    assert hand.moves_to(np.array([0.6]))
    assert not np.array_equal(hand.q, q)


def test_the_hand_goes_on_between_samples_of_a_coarse_motion_of_another_assembly():
    loop = p3dof.ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR)
    home, *others = (mode.q for mode in loop.assembly_modes([0.4]))
    other = next(q for q in others if np.abs(q - home).max() > 0.5)
    ends = [other, loop.assemble([1.2], other).q]
    between = JointMotion([0.0, 1.0], ends).at(loop.model, 0.5).q
    assert np.abs(loop.closure_error(between)).max() > 1e-3
    hand = Hand(loop, home)
    hand.follow(between)
    assert hand.moves_to(np.array([0.9]))
    np.testing.assert_allclose(hand.q, loop.assemble([0.9], other).q, rtol=0, atol=1e-9)


def test_with_more_motors_than_freedoms_the_others_follow():
    robot = p3dof.load_robot(GALLERY / "biped.urdf")
    hand = Hand(robot, robot.assemble().q)
    values = hand.values.copy()
    values[3] += 0.1
    assert hand.moves_to(values)
    assert hand.values[3] == pytest.approx(values[3], abs=1e-12)
    assert np.abs(hand.values - values).max() > 1e-3
    assert np.abs(robot.closure_error(hand.q)).max() < 1e-12


def test_sliders_go_to_the_limits_of_the_file(stewart):
    q = stewart.assemble().q
    assert slider_ranges(stewart, q, 0.5) == [(0.4, 0.9)] * 6
    text = robots.four_bar(*robots.FOUR_BAR, kind="continuous")
    four_bar = p3dof.ClosedLoopModel.from_urdf(text, robots.FOUR_BAR_SIDECAR)
    assert slider_ranges(four_bar, four_bar.assemble([0.5]).q, 0.5) == [(-np.pi, np.pi)]


def test_a_robot_without_motors_falls_and_its_closures_bear():
    text = robots.four_bar(*robots.FOUR_BAR)
    loop = p3dof.ClosedLoopModel.from_urdf(
        text, p3dof.Sidecar((p3dof.Closure("coupler_tip", "rocker_tip"),), ())
    )
    q = robots.four_bar_q(0.7, *robots.FOUR_BAR)
    rest = JointMotion.at_rest(loop, q)
    falling = loop.forward_dynamics(q, np.zeros(3), [])
    np.testing.assert_allclose(rest.closing[0, [0, 2]], falling.lambda_[[0, 2]], rtol=1e-12)
    assert np.isnan(rest.closing[0, 1])  # across the plane
    with RobotViewer(loop, rest, port=0) as live, pytest.raises(InputError, match="no actuated joints"):
        live.move_to([])


def test_why_forces_are_not_known_is_said(browser):
    """Both rods of this five-bar are in line: the motors have no hold of the point between them."""
    loop = p3dof.ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    flat = JointMotion.at_rest(loop, [np.pi, -np.pi, 0.0, np.pi])
    assert np.isnan(flat.known).all()
    with RobotViewer(loop, flat, port=0) as live, opened(browser, live.url, 800, 500, READY) as watched:
        live.show_layers(numbers=False)
        watched.wait("!state.layers.numbers")
        assert "a force that no actuator gives" in watched.page.inner_text("#unknown")
        assert "not determined" in watched.page.inner_text("#actuators")
        assert watched.page.locator("#message").is_hidden()
        watched.healthy()


def test_forces_of_a_run_are_those_that_acted_though_motors_are_redundant():
    """Two arms hold a bar: other torques would do; what the hands bear under the given ones is determined."""
    robot = p3dof.load_robot(GALLERY / "two_arms.urdf")
    start = robot.assemble().q
    torques = np.linspace(-2.0, 2.0, 12)
    run = p3dof.simulation.simulate_robot(robot, 0.002, start, controller=torques, samples=3)
    motion = JointMotion.of_run(robot, run)
    assert np.isfinite(motion.closing).all()
    for q, v, a, lambda_ in zip(run.q, run.v, run.a, motion.closing, strict=True):
        assert robot.residual(q, v, a, torques, lambda_) < 1e-8
    rest = JointMotion.at_rest(robot)
    assert rest.smallest
    assert np.isfinite(rest.closing).all()


@pytest.mark.skipif(compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize("name", ["gripper", "stewart"])
def test_sliders_move_the_compiled_robot_likewise(request, name):
    robot = request.getfixturevalue(name)
    start = robot.assemble().q
    compiled = compiled_of(robot, start, (), "compiled")
    general, fast = Hand(robot, start), Hand(robot, start, compiled)
    values = general.values + 0.02 * np.cos(np.arange(len(general.values)))
    assert general.moves_to(values)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(robot), "assemble", None)
        assert fast.moves_to(values)
    np.testing.assert_allclose(fast.q, general.q, rtol=0, atol=1e-12)
    load = {robot.model.frames[robot.model.nframes - 1].name: np.arange(6.0)}
    for acting in ({}, load) if name == "gripper" else ({},):
        of = compiled_of(robot, start, acting, "compiled")
        (mine, why), (theirs, _) = held(robot, fast.q, acting, of), held(robot, fast.q, acting)
        assert not why
        np.testing.assert_allclose(mine.forces, theirs.forces, rtol=0, atol=1e-9)
        np.testing.assert_allclose(mine.multipliers, theirs.multipliers, rtol=0, atol=1e-9)
    if name == "stewart":
        assert not fast.moves_to(values + np.eye(6)[0] * 3.0)
        assert fast.refused
    assert compiled_of(robot, start, (), "general") is None


@pytest.mark.skipif(compiler() is None, reason="no C compiler here")
def test_a_page_moves_the_compiled_robot(gripper):
    with RobotViewer(gripper, port=0, method="compiled") as live:
        wanted = live._hand.values + 0.05
        live.move_to(wanted)
        wait_until(live, lambda: np.abs(live._hand.values - wanted).max() < 1e-12)
        assert live.message == ""
        assert np.abs(gripper.closure_error(live.shown.q)).max() < 1e-12
    with pytest.raises(InputError, match=r"method: expected"):
        RobotViewer(gripper, port=0, method="fast")
