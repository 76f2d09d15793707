"""Any robot in the live page: it moves by itself, or asks Python, which says what holds it there."""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from browser import opened
from gallery import GALLERY

import p3dof
from p3dof._base.errors import InputError
from p3dof.loops.compiled.build import compiler
from p3dof.viewer.answers import Hand, RobotAnswers, compiled_of
from p3dof.viewer.document.document import robot_document, slider_ranges, values_of
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.document.motion import JointMotion, held

READY = "!!window.p3dof && p3dof.ready.then(() => p3dof.state.connection.open)"


@pytest.fixture(scope="module")
def stewart():
    return p3dof.load_robot(GALLERY / "stewart.urdf")


@pytest.fixture(scope="module")
def gripper():
    return p3dof.load_robot(GALLERY / "gripper.urdf")


def answers_of(robot, external=None, method="general"):
    return RobotAnswers(robot, robot.assemble().q, external, method)


def drag(watched, slider, share):
    """Drag a slider with the mouse to a share of its length."""
    watched.page.locator(f"#{slider}").scroll_into_view_if_needed()
    box = watched.page.locator(f"#{slider}").bounding_box()
    middle = box["y"] + box["height"] / 2
    now = watched.page.evaluate(
        "id => { const s = document.getElementById(id); return (s.value - s.min) / (s.max - s.min); }", slider
    )
    mouse = watched.page.mouse
    mouse.move(box["x"] + 8 + now * (box["width"] - 16), middle)
    mouse.down()
    mouse.move(box["x"] + 8 + share * (box["width"] - 16), middle, steps=6)


def seen(watched):
    return watched.page.evaluate(
        "() => { const i = p3dof.instant(); return { q: [...i.q], values: i.values, byHand: i.byHand,"
        " loads: Object.fromEntries(i.loads.map((one) => [one.load.key, one.vector])) }; }"
    )


@pytest.mark.parametrize(
    ("name", "slider", "share"), [("stewart", "joint-2", 0.55), ("gripper", "joint-0", 0.7)]
)
def test_a_slider_moves_a_joint_and_the_loops_stay_closed(browser, request, name, slider, share):
    robot = request.getfixturevalue(name)
    with p3dof.show_robot(robot, port=0) as live, opened(browser, live.url, 1000, 640, READY) as watched:
        assert watched.page.inner_text("h1") == name
        index = int(slider[-1])
        before = values_of(robot, np.array(seen(watched)["q"]))
        drag(watched, slider, share)
        watched.wait(
            "i => { const { engine, document: { inputs } } = p3dof.state;"
            " return p3dof.instant().byHand && Math.abs(engine.values(p3dof.instant().q)[i]"
            " - document.getElementById(`joint-${i}`).value) < 1e-12; }",
            index,
        )
        watched.page.mouse.up()
        found = seen(watched)
        q = np.array(found["q"])
        after = values_of(robot, q)
        assert abs(after[index] - before[index]) > 0.02
        still = np.arange(len(after)) != index
        np.testing.assert_allclose(after[still], before[still], rtol=0, atol=1e-12)
        assert np.abs(robot.closure_error(q)).max() < 1e-12
        held = robot.inverse_dynamics(q, np.zeros(robot.model.nv), np.zeros(robot.model.nv))
        forces = [found["values"][f"force {joint}"] for joint in robot.actuated]
        np.testing.assert_allclose(forces, held.tau, rtol=1e-9, atol=1e-12)
        assert found["byHand"]
        watched.page.click("#pose button")
        watched.wait("p3dof.state.hand === null")
        watched.healthy()


def test_out_of_reach_is_told_and_the_picture_stays(browser, stewart):
    with p3dof.show_robot(stewart, port=0) as live, opened(browser, live.url, 900, 600, READY) as watched:
        before = seen(watched)["q"]
        far = {name: 0.4 + 0.5 * (i % 2) for i, name in enumerate(stewart.actuated)}
        watched.page.evaluate("inputs => p3dof.state.engine.move({ inputs })", far)
        watched.wait("p3dof.state.refused !== null")
        assert watched.page.evaluate("() => p3dof.state.refused.text").startswith("The loops do not close")
        assert "The picture stays" in watched.page.inner_text("#pose")
        assert seen(watched)["q"] == before
        watched.healthy()


def test_forces_in_closures_are_arrows_that_can_be_seen(browser, gripper):
    """Also where the gripper is held by hand: they come with the answer."""
    with (
        p3dof.show_robot(gripper, port=0, closure_forces=True) as live,
        opened(browser, live.url, 900, 600, READY) as watched,
    ):
        assert watched.page.is_checked("#layers input[name=multipliers]")
        watched.page.evaluate("() => p3dof.state.engine.move({ inputs: { left_drive: 0.5 } })")
        watched.wait("p3dof.state.hand !== null")
        found = seen(watched)
        expected = answers_of(gripper)({"q": gripper.assemble().q, "inputs": {"left_drive": 0.5}})["loads"]
        keys = [key for key in expected if key in found["loads"]]
        assert any(key.startswith("closure") for key in keys)
        for key in keys:
            np.testing.assert_allclose(found["loads"][key], expected[key], rtol=1e-6, atol=1e-9)
        watched.page.uncheck("#layers input[name=multipliers]")
        watched.wait("!p3dof.state.layers.multipliers")
        watched.healthy()


def test_a_run_is_played_and_the_hand_goes_on_from_where_it_is(browser):
    robot = p3dof.load_robot(GALLERY / "four_bar.urdf")
    run = p3dof.runs.simulate_robot(robot, 0.4, samples=81, method="general")
    with (
        p3dof.show_robot(robot, run, port=0, playing=False) as live,
        opened(browser, live.url, 900, 600, READY) as watched,
    ):
        for index in (0, 40, 80):
            watched.page.evaluate("time => p3dof.seek(time)", float(run.time[index]))
            np.testing.assert_allclose(seen(watched)["q"], run.q[index], rtol=0, atol=1e-12)
        angle = float(run.q[80, 0]) + 0.05
        name = robot.actuated[0]
        watched.page.evaluate("inputs => p3dof.state.engine.move({ inputs })", {name: angle})
        watched.wait("p3dof.state.hand !== null")
        q = np.array(seen(watched)["q"])
        assert q[0] == pytest.approx(angle, abs=1e-12)
        assert np.abs(robot.closure_error(q)).max() < 1e-12
        assert np.abs(q - run.q[80]).max() < 0.2  # and in no other assembly
        again = p3dof.runs.simulate_robot(robot, 0.2, samples=11, method="general")
        live.show(again, name="shorter")
        watched.wait("p3dof.state.run === 1 && p3dof.state.hand === null")
        np.testing.assert_allclose(seen(watched)["q"], again.q[-1], rtol=0, atol=1e-12)
        watched.healthy()


def test_the_page_writes_names_and_never_runs_them(browser):
    text = robots.four_bar(*robots.FOUR_BAR).replace("crank_joint", "&lt;img src=x onerror=window.bad=1&gt;")
    loop = p3dof.ClosedLoopModel.from_urdf(
        text,
        p3dof.Sidecar((p3dof.Closure("coupler_tip", "rocker_tip"),), ("<img src=x onerror=window.bad=1>",)),
    )
    motion = JointMotion([0.0], [robots.four_bar_q(0.7, *robots.FOUR_BAR)])
    with (
        p3dof.show_robot(loop, motion, port=0) as live,
        opened(browser, live.url, 700, 500, READY) as watched,
    ):
        assert watched.page.inner_text(".joint label") == "<img src=x onerror=window.bad=1>"
        assert watched.page.evaluate("() => window.bad === undefined")
        watched.healthy()


def test_why_forces_are_not_known_is_said(browser):
    """Both rods of this five-bar are in line: the motors have no hold of the point between them."""
    loop = p3dof.ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    flat = np.array([np.pi, -np.pi, 0.0, np.pi])
    answer = RobotAnswers(loop, flat)({"q": flat, "inputs": {}})
    assert "a force that no actuator gives" in answer["notes"][0]
    assert answer["values"][f"force {loop.actuated[0]}"] is None
    with (
        p3dof.show_robot(loop, JointMotion.at_rest(loop, flat), port=0) as live,
        opened(browser, live.url, 800, 500, READY) as watched,
    ):
        watched.page.evaluate("() => p3dof.state.engine.move({ inputs: {} })")
        watched.wait("p3dof.state.hand !== null")
        assert "A force is needed that no actuator gives: 2.88 N" in watched.page.inner_text("#pose")
        watched.healthy()


# --- without a browser --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["five_bar", "stewart", "gripper", "biped", "two_arms"])
def test_an_answer_says_what_the_document_says_of_a_robot_that_stands(name):
    robot = p3dof.load_robot(GALLERY / f"{name}.urdf")
    frame = robot.model.frames[robot.model.nframes - 1].name
    external = {frame: np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])}
    document = robot_document(robot, None, JointMotion.at_rest(robot, None, external))
    (run,) = document["runs"]
    (q,) = decoded(run["q"])
    answer = RobotAnswers(robot, q, external)({"q": q.tolist(), "inputs": {}})
    np.testing.assert_allclose(answer["q"], q, rtol=0, atol=1e-12)
    for curve in run["curves"]:
        table, column = curve.get("column", (None, 0))
        value = decoded(curve["values"])[0] if table is None else decoded(run[table])[0, column]
        told = answer["values"][curve["key"]]
        np.testing.assert_allclose(np.nan if told is None else told, value, rtol=1e-9, atol=1e-9)
    for load in run["loads"]:
        if "values" in load:
            told = answer["loads"].get(load["key"], np.full(3, np.nan))
            np.testing.assert_allclose(told, decoded(load["values"])[0], rtol=1e-5, atol=1e-6)


def test_answers_know_nothing_of_where_another_page_was(stewart):
    answers, home = answers_of(stewart), stewart.assemble().q
    name = stewart.actuated[0]
    low = answers({"q": home, "inputs": {name: 0.55}})
    other = answers({"q": home, "inputs": {stewart.actuated[1]: 0.6}})
    again = answers({"q": home, "inputs": {name: 0.55}})
    np.testing.assert_array_equal(low["q"], again["q"])
    assert np.abs(low["q"] - other["q"]).max() > 1e-3


def test_bad_questions_are_refused(gripper):
    answers, home = answers_of(gripper), gripper.assemble().q
    for question, words in (
        ({}, "q: expected"),
        ({"q": [0.0]}, "q: expected shape"),
        ({"q": home}, "inputs: expected values by actuated joint"),
        ({"q": home, "inputs": {"right_drive": 0.1}}, "inputs: expected values by actuated joint"),
        ({"q": home, "inputs": {"left_drive": "x"}}, "inputs: expected"),
    ):
        with pytest.raises(InputError, match=words):
            answers(question)
    with pytest.raises(InputError, match="method: expected"):
        p3dof.show_robot(gripper, port=0, method="fast")
    with pytest.raises(InputError, match="robot: expected a ClosedLoopModel"):
        p3dof.robot_page("gripper")


def test_a_robot_without_motors_has_no_sliders():
    text = robots.four_bar(*robots.FOUR_BAR)
    loop = p3dof.ClosedLoopModel.from_urdf(
        text, p3dof.Sidecar((p3dof.Closure("coupler_tip", "rocker_tip"),), ())
    )
    q = robots.four_bar_q(0.7, *robots.FOUR_BAR)
    rest = JointMotion.at_rest(loop, q)
    falling = loop.forward_dynamics(q, np.zeros(3), [])
    np.testing.assert_allclose(rest.closing[0, [0, 2]], falling.lambda_[[0, 2]], rtol=1e-12)
    assert np.isnan(rest.closing[0, 1])  # across the plane
    assert p3dof.robot_page(loop, rest).document["inputs"] == []


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
    between = pin.interpolate(loop.model, *ends, 0.5)
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


def test_forces_of_a_run_are_those_that_acted_though_motors_are_redundant():
    """Two arms hold a bar: other torques would do; what the hands bear under the given ones is determined."""
    robot = p3dof.load_robot(GALLERY / "two_arms.urdf")
    start = robot.assemble().q
    torques = np.linspace(-2.0, 2.0, 12)
    run = p3dof.runs.simulate_robot(robot, 0.002, start, controller=torques, samples=3, method="general")
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
