"""Any robot in the page's picture: joints, forces of closures, and actuated joints that follow the hand."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from browser import opened
from gallery import GALLERY
from numpy.testing import assert_allclose
from pages import DRAWN, READY, SETTLED, placements

import p3dof
from p3dof.loops.closures import ClosureWrenches
from p3dof.runs import simulate_robot
from p3dof.viewer.document.document import robot_document
from p3dof.viewer.document.figure import RobotFigure
from p3dof.viewer.document.html import page_html
from p3dof.viewer.document.motion import JointMotion
from p3dof.viewer.machine.document import page_document

GRIPS = """() => {
    const { state } = p3dof, { stage } = state, { left, top } = stage.canvas.getBoundingClientRect();
    const found = [];
    for (let y = 20; y < stage.height - 20; y += 12) for (let x = 20; x < stage.width - 20; x += 12) {
        const grip = stage.gripAt(x, y);
        if (grip) found.push([grip.input.key, grip.place, ...grip.point.toArray(), x + left, y + top]);
    }
    return found;
}"""
SEEN = """([place, point]) => {
    const { stage } = p3dof.state, { left, top } = stage.canvas.getBoundingClientRect();
    const m = p3dof.instant().placements.slice(16 * place);
    const at = [0, 1, 2].map((k) => m[k] * point[0] + m[4 + k] * point[1] + m[8 + k] * point[2] + m[12 + k]);
    const [x, y] = stage.pixel(at);
    return [x + left, y + top];
}"""


def written(folder, document):
    path = folder / "page.html"
    path.write_text(page_html(document), encoding="utf-8")
    return path.as_uri()


def fixed(model, q):
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return np.stack([data.oMi[i].homogeneous for i in range(1, model.njoints)])


def test_a_five_bar_moves_with_the_forces_of_its_closure(browser, tmp_path):
    robot = p3dof.load_robot(GALLERY / "five_bar.urdf")
    run = simulate_robot(robot, 0.2, q=robot.assemble().q, samples=21, method="general")
    figure = RobotFigure(robot, GALLERY / "five_bar.urdf")
    document = robot_document(robot, figure, run, engine="none")
    with opened(browser, written(tmp_path, document), 1200, 800, ready=READY) as watched:
        for i in (0, 13, 20):
            watched.page.evaluate("time => p3dof.seek(time)", float(run.time[i]))
            assert_allclose(placements(watched), fixed(robot.model, run.q[i]), rtol=0, atol=1e-12)
            arrows = {arrow["key"]: arrow for arrow in watched.page.evaluate(DRAWN)}
            lambda_ = robot.forward_dynamics(run.q[i], run.v[i], run.forces[i]).lambda_
            force = np.linalg.norm(
                ClosureWrenches(robot.model, robot.sidecar).at(run.q[i], lambda_).forces[0]
            )
            assert arrows["closure 1 force"]["value"] == pytest.approx(force, rel=1e-6)
            assert arrows["closure 1 force"]["drawn"] > 0
        watched.page.locator('#layers input[name="closures"]').click()
        watched.page.evaluate(SETTLED)
        ends = """() => p3dof.state.stage.contents.closures.ends.map(
            (pair) => pair.map(({ position }) => position.toArray()))"""
        assert_allclose(*np.array(watched.page.evaluate(ends)).transpose(1, 0, 2), rtol=0, atol=1e-6)
        heads = "key => p3dof.state.stage.contents.arrows.arrows.get(key).heads.length"
        assert watched.page.evaluate(heads, "force left_motor") == 2  # a moment
        assert watched.page.evaluate(heads, "closure 1 force") == 1
        # without an engine a page cannot close the loop: nothing that would break it can be moved
        before = placements(watched)
        assert watched.page.locator('input[name="left_motor"]').first.is_disabled()
        spots = [spot for spot in watched.page.evaluate(GRIPS) if spot[0] == "left_motor"]
        x, y = spots[len(spots) // 2][-2:]
        watched.page.mouse.move(x, y)
        watched.page.mouse.down()
        watched.page.mouse.move(x + 20, y + 20, steps=3)
        watched.page.mouse.up()
        watched.page.evaluate(SETTLED)
        assert_allclose(placements(watched), before, rtol=0, atol=0)
        assert watched.page.evaluate("p3dof.state.stage.touched")  # the camera turned in its place
        watched.healthy()


def test_a_robot_at_rest_has_no_charts_and_values_only_beside_forces_that_count(browser, tmp_path):
    robot = p3dof.load_robot(GALLERY / "biped.urdf")
    still = robot_document(robot, RobotFigure(robot))
    q = robot.assemble().q
    forces = np.array([[3e-9, -2.0, *np.zeros(len(robot.actuated) - 2)]] * 2)
    moving = robot_document(
        robot, RobotFigure(robot), JointMotion([0.0, 1.0], np.stack([q, q]), robot.actuated, forces)
    )
    for name, document, seen in (("still", still, False), ("moving", moving, True)):
        (tmp_path / name).mkdir()
        with opened(browser, written(tmp_path / name, document), 1200, 800, ready=READY) as watched:
            watched.page.evaluate(SETTLED)
            for part in ("#charts", "#time-bar", ".peaks"):
                assert watched.page.locator(part).first.is_visible() == seen, part
            texts = watched.page.evaluate("""() => {
                const { arrows, drawn } = p3dof.state.stage.contents.arrows;
                return drawn.map(({ key, value }) => [key, value, arrows.get(key).text.sprite.visible]);
            }""")
            assert len(texts) >= len(robot.actuated)
            for unit in ("N", "N m"):
                own = [row for row in texts if row[0].startswith("force ") == (unit == "N m")]
                largest = max((abs(value) for _, value, _ in own), default=0.0)
                for key, value, shown in own:
                    assert shown == (abs(value) >= 1e-6 * largest), (name, key, value)
            stage = watched.page.locator("#stage").bounding_box()
            assert (stage["height"] == 800) != seen
            watched.healthy()


def test_python_closes_the_loops_of_what_the_hand_drags(browser):
    pytest.importorskip("tornado", reason="tornado is not installed")
    from p3dof.viewer.live_viewer import LiveViewer

    robot = p3dof.load_robot(GALLERY / "five_bar.urdf")
    start = robot.assemble().q
    document = robot_document(
        robot, RobotFigure(robot, GALLERY / "five_bar.urdf"), JointMotion([0.0], start[None]), engine="ask"
    )

    def answered(question):
        return {"q": robot.assemble(question["inputs"], guess=question["q"]).q}

    with (
        LiveViewer(document, lambda result: result, answered, port=0) as viewer,
        opened(browser, viewer.url, 1200, 800, ready=READY) as watched,
    ):
        watched.wait("p3dof.state.connection.open && p3dof.state.engine !== null")
        spots = [spot for spot in watched.page.evaluate(GRIPS) if spot[0] == "left_motor"]
        _, place, *rest = spots[len(spots) // 2]
        point, (x, y) = rest[:3], rest[3:]
        watched.page.mouse.move(x, y)
        watched.page.mouse.down()
        watched.page.mouse.move(x + 3, y + 3, steps=3)
        watched.wait("p3dof.state.hand !== null && !p3dof.state.engine.busy")
        watched.page.evaluate(SETTLED)
        q = np.array(watched.page.evaluate("() => [...p3dof.instant().q]"))
        assert np.linalg.norm(robot.closure_error(q)) < 1e-9
        assert abs(q - start).max() > 1e-3
        assert_allclose(placements(watched), fixed(robot.model, q), rtol=0, atol=1e-12)
        right = robot.model.joints[robot.model.getJointId("right_motor")].idx_q
        assert q[right] == pytest.approx(start[right], abs=1e-9)  # the other motor stays
        reached = np.array(watched.page.evaluate(SEEN, [place, point]))
        assert np.linalg.norm(reached - [x, y]) > 1.0
        watched.page.mouse.up()
        watched.healthy()


def test_a_tree_with_meshes_follows_the_hand_joint_by_joint(browser, tmp_path):
    example = pytest.importorskip("example_robot_data").load("solo12")
    robot = p3dof.ClosedLoopModel(example.model, p3dof.Sidecar.serial(example.model))
    still = JointMotion([0.0], example.q0[None])
    document = robot_document(robot, example.visual_model, still, triangles=5000)
    with opened(browser, written(tmp_path, document), 1200, 800, ready=READY) as watched:
        assert_allclose(placements(watched), fixed(example.model, example.q0), rtol=0, atol=1e-12)
        found = watched.page.evaluate(GRIPS)
        grips = {}
        for key, place, *rest in found:
            grips.setdefault(key, []).append((place, rest[:3], rest[3:]))
        knees = {key: spots for key, spots in grips.items() if key.endswith("KFE")}
        assert knees
        for key, spots in list(knees.items())[:2]:
            place, point, (x, y) = spots[len(spots) // 2]
            before = np.array(watched.page.evaluate("() => [...p3dof.instant().q]"))
            watched.page.mouse.move(x, y)
            watched.page.mouse.down()
            watched.page.mouse.move(x + 6, y + 2, steps=3)
            watched.page.evaluate(SETTLED)
            q = np.array(watched.page.evaluate("() => [...p3dof.instant().q]"))
            joint = example.model.joints[example.model.getJointId(key)]
            (moved,) = np.flatnonzero(abs(q - before) > 1e-9)
            assert moved == joint.idx_q
            assert_allclose(placements(watched), fixed(example.model, q), rtol=0, atol=1e-12)
            # the point cannot be nearer to the pointer than anywhere on its circle
            target = np.array([x + 6.0, y + 2.0])
            reached = np.array(watched.page.evaluate(SEEN, [place, point]))
            for nearby in (-2e-3, 2e-3):
                other = q.copy()
                other[moved] += nearby
                holding = "q => { p3dof.state.set({ hand: { q } }); p3dof.state.refresh(); }"
                watched.page.evaluate(holding, [*other])
                aside = np.array(watched.page.evaluate(SEEN, [place, point]))
                assert np.linalg.norm(aside - target) > np.linalg.norm(reached - target)
            watched.page.mouse.up()
        assert not watched.page.evaluate("p3dof.state.stage.touched")
        watched.page.keyboard.press("Escape")
        watched.wait("p3dof.state.hand === null")
        watched.healthy()


def test_reactions_of_joints_are_shown_when_they_are_wanted(browser, tmp_path):
    robot, motion = p3dof.load(), p3dof.paper_motion(samples=21)
    document = page_document(robot, motion, reactions=robot.reactions(motion, "paper"))
    with opened(browser, written(tmp_path, document), 1200, 800, ready=READY) as watched:
        keys = "() => p3dof.state.stage.contents.arrows.drawn.map(({ key }) => key)"
        assert set(watched.page.evaluate(keys)) == {"force_a", "force_b", "force_c"}
        scale = "() => p3dof.state.stage.contents.arrows.scales.N"
        actuators = watched.page.evaluate(scale)
        watched.page.locator('#layers input[name="reactions"]').click()
        watched.page.evaluate(SETTLED)
        assert len(watched.page.evaluate(keys)) == 3 + 26
        assert watched.page.evaluate(scale) > actuators
        watched.healthy()


def test_a_run_of_another_machine_is_drawn_with_its_lengths(browser, tmp_path):
    robot, motion = p3dof.load(), p3dof.paper_motion(samples=21)
    other = p3dof.Manipulator(p3dof.of_solids(p3dof.machine.Geometry(r=0.09, R=0.27, L=0.5)))
    result = other.inverse_dynamics(motion)
    document = page_document(robot, motion, runs={"other": (other, result)})
    with opened(browser, written(tmp_path, document), 1200, 800, ready=READY) as watched:
        watched.page.evaluate("() => p3dof.state.set({ run: 1 })")
        watched.page.evaluate("time => p3dof.seek(time)", float(motion.time[13]))
        watched.page.evaluate(SETTLED)
        expected = fixed(other.model, result.joints.q[13])
        assert_allclose(placements(watched), expected, rtol=0, atol=1e-9)
        assert watched.page.evaluate("() => p3dof.instant().values.force_b") == result.forces[13, 1]
        told = watched.page.locator(".agreement").inner_text()
        assert "agree with the file's to" in told  # those of its own machine
        watched.healthy()
