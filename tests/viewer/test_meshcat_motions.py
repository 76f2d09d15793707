"""Motions in MeshCat, in a real browser: live and recorded, of the machine and of other robots."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import re
import signal
import subprocess
import sys
import threading

import numpy as np
import pinocchio as pin
import pytest
from browser import eventually, find_chromium, opened, until
from closed_loop_robots import FOUR_BAR, FOUR_BAR_SIDECAR, four_bar, four_bar_q
from documents import ROOT

import p3dof

pytest.importorskip("meshcat", reason="meshcat is not installed")

from p3dof._base.errors import InputError
from p3dof.machine import Body
from p3dof.runs import simulate_robot
from p3dof.viewer import JointMotion, Scene, SceneWindow, headless, joints_of, playing, robot_viewer
from p3dof.viewer.robot_scene import RobotScene
from p3dof.viewer.server import ServedWindow

GALLERY = ROOT / "docs/_static/gallery"
STATIC = ROOT / "docs/_static"
PHONE = 390, 844
RECORDED = "!!window.viewer && viewer.animator.duration > 0 && !!document.getElementById('player')"


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def result(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(samples=101))


@pytest.fixture(scope="module")
def bar():
    """A four-bar linkage that turns, with the torques that hold it, in text alone."""
    robot = p3dof.ClosedLoopModel.from_urdf(four_bar(*FOUR_BAR), FOUR_BAR_SIDECAR)
    time = np.linspace(2.0, 3.0, 21)
    q = np.array([four_bar_q(theta, *FOUR_BAR) for theta in np.linspace(0.4, 2.4, 21)])
    rest = np.zeros(3)
    tau = np.array([robot.inverse_dynamics(row, rest, rest).tau for row in q])
    assert tau.min() < -1 < 1 < tau.max()  # arrows of both directions
    return robot, JointMotion(time, q, robot.actuated, tau)


def bodies(visualizer, q):
    """Where Pinocchio has the solids, by their places in the scene."""
    model, data = visualizer.model, visualizer.model.createData()
    pin.forwardKinematics(model, data, q)
    return {
        f"meshcat/p3dof/visuals/{solid.name}": (data.oMi[solid.parentJoint] * solid.placement).homogeneous
        for solid in visualizer.visual_model.geometryObjects
    }


def check_bodies(page, expected):
    np.testing.assert_allclose(page.places(list(expected)), list(expected.values()), rtol=0, atol=1e-6)


def arrow_of(page, path, head="head"):
    """Where an arrow starts, and where its tip is from there, in the fixed frame."""
    root, cone = page.place(path), page.place(f"{path}/{head}")
    return root[:3, 3], (cone @ [0, 0, 1, 1])[:3] - root[:3, 3]


def check_arrows(page, scale, result, i):
    for leg, force in zip("abc", result.forces[i], strict=True):
        _, tip = arrow_of(page, f"meshcat/forces/{leg}")
        np.testing.assert_allclose(tip, [0, 0, scale.metres * force / scale.newtons], rtol=0, atol=1e-6)


def check_platform(page, robot, pose):
    expected = pose[:2] - [0, robot.parameters.geometry.h]
    np.testing.assert_allclose(page.place("meshcat/platform")[1:3, 3], expected, rtol=0, atol=1e-6)


def seek(page, time):
    page.page.evaluate(
        "time => { viewer.animator.pause(); viewer.animator.seek(time); viewer.render(); }", time
    )


def pixels(page):
    page.see()
    page.page.evaluate("viewer.render()")
    picture = page.page.screenshot()
    page.page.evaluate("blind = true")
    return np.asarray(headless.as_image(picture)).astype(int)


def colours(picture):
    """Where a picture has the strong colours of legs and platform: rows and columns."""
    return np.nonzero(np.ptp(picture, axis=2) > 60)


# Live


def test_a_live_page_shows_the_instants_of_a_motion(browser, robot, result):
    visualizer = robot.viewer(port=0)
    player = visualizer.scene.player(result)
    pictures = []
    with opened(browser, visualizer.viewer.url()) as page:
        for i in (20, 90):
            player.draw(result.time[i])
            expected = bodies(visualizer, result.joints.q[i])
            eventually(page.page, check_bodies, page, expected)
            eventually(page.page, check_platform, page, robot, result.motion.pose[i])
            eventually(page.page, check_arrows, page, visualizer.scene.scale, result, i)
            pictures.append(pixels(page))
        page.healthy()
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 40).mean() > 0.005
    visualizer.viewer.close()


@pytest.mark.parametrize("given", ["motion", "result", "simulation"])
def test_play_moves_the_open_page_to_the_end(browser, robot, result, given):
    run = {
        "motion": lambda: result.motion,
        "result": lambda: result,
        "simulation": lambda: robot.simulate(0.2, samples=21),
    }[given]()
    visualizer = robot.viewer(port=0)
    with opened(browser, visualizer.viewer.url()) as page:
        page.wait("!!nodeOf('meshcat/platform')")
        played = threading.Thread(target=visualizer.play, args=(run,), kwargs={"speed": 4.0})
        played.start()
        until(page.page, lambda: not played.is_alive())
        expected = bodies(visualizer, run.joints.q[-1] if given != "motion" else result.joints.q[-1])
        eventually(page.page, check_bodies, page, expected)
        page.wait("!!nodeOf('meshcat/trace')")
        page.healthy()
    visualizer.viewer.close()


def test_pinocchios_own_play_still_plays_joints_and_the_platform_goes_along(robot, result):
    scene, seen = Scene(robot), []
    rows = result.joints.q[::25]
    scene.visualizer.play(
        rows, 1e-3, callback=lambda _: seen.append(place_in(scene.window, "/meshcat/platform"))
    )
    np.testing.assert_allclose([place[1, 3] for place in seen], result.motion.pose[::25, 0], atol=1e-12)
    assert scene.visualizer.play([rows[0]]) is None


def place_in(window, path):
    import umsgpack

    commands = [umsgpack.unpackb(message) for message in window.messages()]
    (found,) = (c["matrix"] for c in commands if c["type"] == "set_transform" and c["path"] == path)
    return np.reshape(found, (4, 4)).T


class Clock:
    """A clock that only drawing and sleeping move."""

    def __init__(self, drawing):
        self.now, self.drawing = 100.0, drawing

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        assert seconds >= 0
        self.now += seconds


def recorded_moments(monkeypatch, scene, clock):
    moments = []

    def display(q, _forces):
        moments.append((clock.now, float(q[0])))
        clock.now += clock.drawing

    monkeypatch.setattr(playing, "time", clock)
    monkeypatch.setattr(scene, "display", display)
    return moments


def crank(bar, moment):
    return np.interp(moment, bar[1].time, bar[1].q[:, 0])


@pytest.mark.parametrize(("drawing", "most"), [(1e-3, 61), (0.3, 5)])
@pytest.mark.parametrize("speed", [1.0, 0.5])
def test_pictures_are_of_their_instants_and_dropped_rather_than_late(monkeypatch, bar, drawing, most, speed):
    scene = RobotScene(bar[0], p3dof.viewer.RobotFigure(bar[0]))
    clock = Clock(drawing)
    moments = recorded_moments(monkeypatch, scene, clock)
    player = scene.player(bar[1], speed=speed)
    start = clock.now
    assert player.run() is True
    times, q = np.array(moments).T
    np.testing.assert_allclose(q, crank(bar, 2.0 + speed * np.maximum(times - start, 0)), rtol=0, atol=1e-9)
    assert q[-1] == bar[1].q[-1, 0]
    assert clock.now - start >= 1 / speed
    assert most / 2 < len(times) <= most / speed + 2
    assert np.diff(times).min() >= min(drawing, 1 / 60) - 1e-9


def test_it_repeats_begins_where_it_is_told_and_waits_for_a_page(monkeypatch, bar):
    window = ServedWindow()
    scene = RobotScene(bar[0], p3dof.viewer.RobotFigure(bar[0]), window)
    clock = Clock(0.0)
    moments = recorded_moments(monkeypatch, scene, clock)
    player = scene.player(bar[1], at=2.5, repeat=True)
    assert player.run(1.0) is False  # nobody looks yet
    assert len(moments) == 1
    start = clock.now + playing.PATIENCE - 1.0
    assert player.run(7.2) is False
    times, q = np.array(moments[1:]).T
    begin = times[0] - 1 / 60  # where it has been drawn already
    assert start - 1e-9 < begin < start + 1 / 60
    phase = (0.5 + times - begin) % 1.0
    inner = np.abs(phase - 0.5) < 0.4999
    assert inner.sum() > 180
    np.testing.assert_allclose(q[inner], crank(bar, 2.0 + phase[inner]), rtol=0, atol=1e-9)
    still = scene.player(bar[1], at=3.0, playing=False, repeat=True)
    before = len(moments)
    assert still.run(20.0) is False
    assert len(moments) == before
    assert moments[-1][1] == bar[1].q[-1, 0]


def test_gaps_leave_the_picture_before(bar):
    robot, motion = bar
    q = motion.q.copy()
    q[5:9] = np.nan
    take = playing.Take(motion.time, q, np.zeros((21, 0)), np.zeros((0, 3)))
    assert take.at(robot.model, 2.22) is None
    found, _ = take.at(robot.model, float(motion.time[9]))
    np.testing.assert_array_equal(found, q[9])


# Recorded


def test_a_recorded_page_plays_with_no_python_and_no_network(browser, robot, result, tmp_path):
    scene = Scene(robot)
    file = scene.record(result, playing=False, at=0.5).save(tmp_path / "motion.html")
    visualizer, pictures = scene.visualizer, []
    with opened(browser, file.as_uri(), ready=RECORDED) as page:
        page.page.context.set_offline(True)
        check_bodies(page, bodies(visualizer, result.joints.q[50]))  # where it begins
        assert page.page.inner_text("#player output") == "0.50 s"
        scale = p3dof.viewer.ArrowScale.of_motion(robot, result)
        for i in (20, 90, 100):
            seek(page, result.time[i])
            check_bodies(page, bodies(visualizer, result.joints.q[i]))
            check_arrows(page, scale, result, i)
            y, z, theta = result.motion.pose[i]
            c, s = np.cos(theta), np.sin(theta)
            place = [[c, 0, s, 0], [0, 1, 0, y], [-s, 0, c, z - robot.parameters.geometry.h], [0, 0, 0, 1]]
            np.testing.assert_allclose(page.place("meshcat/platform"), place, rtol=0, atol=1e-6)
            pictures.append(pixels(page))
        assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 40).mean() > 0.005
        page.page.click("#player button")
        page.wait("viewer.animator.playing && viewer.animator.time > 0.05 && viewer.animator.time < 0.9")
        assert page.page.inner_text("#player button") == "Pause"
        page.page.click("#player button")
        page.wait("!viewer.animator.playing")
        page.page.focus("#player input")
        page.page.keyboard.press("Home")
        page.wait("viewer.animator.time === 0")
        check_bodies(page, bodies(visualizer, result.joints.q[0]))
        page.healthy()


def test_a_recorded_page_repeats_at_its_speed(browser, robot, result, tmp_path):
    file = Scene(robot).record(result, speed=4.0).save(tmp_path / "again.html")
    with opened(browser, file.as_uri(), ready=RECORDED) as page:
        page.page.evaluate("window.turns = 0; viewer.animator.mixer.addEventListener('loop', () => turns++)")
        page.wait("turns > 2 && viewer.animator.playing")
        assert page.page.evaluate("viewer.animator.mixer.timeScale") == 4.0
        page.healthy()


def test_a_recorded_page_that_plays_once_ends_and_plays_again(browser, robot, result, tmp_path):
    file = Scene(robot).record(result, speed=2.0, repeat=False).save(tmp_path / "once.html")
    end = bodies(Scene(robot).visualizer, result.joints.q[-1])
    ended = "!viewer.animator.playing && document.querySelector('#player button').textContent === 'Play'"
    with opened(browser, file.as_uri(), ready=RECORDED) as page:
        for slid in (False, True):
            page.wait(ended)
            check_bodies(page, end)
            assert page.page.inner_text("#player output") == "1.00 s"
            if slid:  # it is at the end by hand
                page.page.focus("#player input")
                page.page.keyboard.press("Home")
                page.wait("viewer.animator.time === 0")
                page.page.keyboard.press("End")
                page.wait("viewer.animator.time === viewer.animator.duration")
            page.page.evaluate(
                """() => {
                    const display = viewer.animator.display_progress;
                    window.times = [];
                    const button = document.querySelector('#player button');
                    window.labels = new Set();
                    new MutationObserver(() => labels.add(button.textContent))
                        .observe(button, {childList: true, characterData: true, subtree: true});
                    viewer.animator.display_progress = (time) => { times.push(time); display(time); };
                }"""
            )
            page.page.click("#player button")
            page.wait(f"labels.size === 2 && {ended}")  # it may end before one can look
            assert page.page.evaluate("[...labels]") == ["Pause", "Play"]
            times = page.page.evaluate("times")
            assert times[0] == 0
            assert times == sorted(times)
            assert times[-1] == 1.0
            assert len(times) > 2
        page.healthy()


def test_a_force_that_turns_shrinks_through_zero(browser, robot, result, tmp_path):
    """An arrow that is mirrored: half way between two samples of opposite forces it has no length."""
    forces = np.where(np.arange(101)[:, None] % 2, 10.0, -10.0) * [1, 1, 1]
    turning = dataclasses.replace(result, forces=forces)
    file = Scene(robot).record(turning).save(tmp_path / "turning.html")
    with opened(browser, file.as_uri(), ready=RECORDED) as page:
        for time, share in ((0.2, -1), (0.21, 1), (0.2025, -0.5)):
            seek(page, time)
            _, tip = arrow_of(page, "meshcat/forces/b")
            np.testing.assert_allclose(tip, [0, 0, share * robot.parameters.geometry.R], rtol=0, atol=1e-5)


def check_torque(page, robot, motion, i):
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, motion.q[i])
    largest = np.abs(motion.known).max()
    start, tip = arrow_of(page, "meshcat/forces/crank_joint")
    np.testing.assert_allclose(start, data.oMi[1].translation, rtol=0, atol=1e-6)
    axis = data.oMi[1].rotation @ [0, -1, 0]  # of the joint's axis, as the robot's text has it
    assert np.sign(tip @ axis) == np.sign(motion.known[i, 0])
    np.testing.assert_allclose(np.cross(tip, axis), 0, atol=1e-6)
    longest = np.linalg.norm(tip) / abs(motion.known[i, 0]) * largest
    _, inner = arrow_of(page, "meshcat/forces/crank_joint", "second_head")
    assert 0.3 < np.linalg.norm(inner) / np.linalg.norm(tip) < 1  # a torque has two heads
    return longest


def test_any_robot_plays_live_and_recorded(browser, bar, tmp_path):
    robot, motion = bar
    visualizer = robot_viewer(robot, trace="coupler_tip", port=0)
    player, lengths = visualizer.scene.player(motion), []
    with opened(browser, visualizer.viewer.url()) as page:
        for i in (4, 18):
            player.draw(motion.time[i])
            eventually(page.page, check_bodies, page, bodies(visualizer, motion.q[i]))
            eventually(page.page, check_torque, page, robot, motion, i)
            lengths.append(check_torque(page, robot, motion, i))
        points = page.page.evaluate(
            "Array.from(nodeOf('meshcat/trace').children['<object>'].object.geometry.attributes.position.array)"
        )
        page.healthy()
    visualizer.viewer.close()
    path = np.reshape(points, (-1, 3))[::2]
    data, frame = robot.model.createData(), robot.model.getFrameId("coupler_tip")
    for point, q in zip(path, motion.q[:-1], strict=True):
        pin.framesForwardKinematics(robot.model, data, q)
        np.testing.assert_allclose(point, data.oMf[frame].translation, rtol=0, atol=1e-6)
    file = visualizer.record(motion).save(tmp_path / "bar.html")
    with opened(browser, file.as_uri(), ready=RECORDED) as page:
        for i in (4, 18):
            seek(page, motion.time[i] - 2.0)
            check_bodies(page, bodies(visualizer, motion.q[i]))
            lengths.append(check_torque(page, robot, motion, i))
        page.page.evaluate("viewer.animator.display_progress(0.5)")
        assert page.page.inner_text("#player output") == "2.50 s"
        page.healthy()
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-5)


def test_forces_along_slides_have_one_head_and_meshes_are_drawn(browser, robot, result, tmp_path):
    """The machine as any robot: its forces point along z, beside the same bodies."""
    motion = JointMotion(result.time, result.joints.q, robot.loop.actuated, result.forces)
    scene = RobotScene(robot.loop, robot)
    file = scene.record(motion).save(tmp_path / "machine.html")
    lengths = []
    with opened(browser, file.as_uri(), ready=RECORDED) as page:
        for i in (20, 90):
            seek(page, result.time[i])
            check_bodies(page, bodies(scene.visualizer, result.joints.q[i]))
            for name, force in zip(robot.loop.actuated, result.forces[i], strict=True):
                _, tip = arrow_of(page, f"meshcat/forces/{name}")
                np.testing.assert_allclose(tip[:2], 0, atol=1e-6)
                lengths.append(tip[2] / force)
                assert page.page.evaluate(
                    "path => nodeOf(path) === null", f"meshcat/forces/{name}/second_head"
                )
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-5)


def labels(window):
    """What is written in a scene, by place."""
    import umsgpack

    commands = [umsgpack.unpackb(message) for message in window.messages()]
    found = [command for command in commands if command["type"] == "set_object"]
    return {c["path"]: c["object"]["textures"][0]["text"] for c in found if c["object"].get("textures")}


def test_grey_arrows_are_the_scales_of_forces_and_torques(browser, tmp_path):
    """A round value of each, as long as an arrow of it would be, left of the robot; none without forces."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "slide")
    model.addJoint(1, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.3, 0.0, 0.2])), "hinge")
    model.appendBodyToJoint(2, pin.Inertia(1.0, np.array([0.0, 0.1, 0.2]), np.eye(3)), pin.SE3.Identity())
    robot = p3dof.ClosedLoopModel(model, p3dof.loops.Sidecar.serial(model))
    q, forces = [[0.0, 0.5], [0.1, 1.0]], np.array([[-1250.0, 0.03], [800.0, -0.069]])
    scene = RobotScene(robot, p3dof.viewer.RobotFigure(robot))
    moved = JointMotion([0.0, 1.0], q, robot.actuated, forces)
    paths = ["meshcat/legend/of_1/arrow", "meshcat/legend/of_2/arrow"]
    assert labels(scene.window) == {}
    scene.player(moved)
    assert labels(scene.window) == {
        "/meshcat/legend/of_1/text": "1000 N",
        "/meshcat/legend/of_2/text": "0.05 N m",
    }
    file = scene.record(moved).save(tmp_path / "both.html")
    scene.player(JointMotion([0.0, 1.0], q, robot.actuated, forces * [1, 0]))
    assert list(labels(scene.window)) == ["/meshcat/legend/of_1/text"]
    with opened(browser, file.as_uri(), ready=RECORDED) as page:
        for time, now in zip((0.0, 1.0), forces, strict=True):
            seek(page, time)
            for path, name, share in zip(paths, robot.actuated, abs(now) / [1000, 0.05], strict=True):
                grey, tip = arrow_of(page, path)[1], arrow_of(page, f"meshcat/forces/{name}")[1]
                np.testing.assert_allclose(np.linalg.norm(tip), share * np.linalg.norm(grey), rtol=1e-5)
                np.testing.assert_allclose(grey[:2], 0, atol=1e-6)
            tips = [*paths, *(f"meshcat/forces/{name}" for name in robot.actuated)]
            x, y = np.array(page.page.evaluate("paths => tipsOf(paths)", tips)).T
            assert max(*abs(x), *abs(y)) < 1
            assert x[1] + 0.05 < x[0] < x[2:].min()
        page.healthy()


def test_the_shapes_of_a_file_are_drawn_and_rods_without():
    loop = p3dof.load_robot(GALLERY / "five_bar.urdf")
    figure = p3dof.viewer.RobotFigure(loop, GALLERY / "five_bar.urdf")
    scene = RobotScene(loop, figure)
    names = {solid.name for solid in scene.visualizer.visual_model.geometryObjects}
    shapes = {solid.name for solid in figure.visual_model.geometryObjects} - figure.sticks
    assert names == (figure.sticks if figure.usual["sticks"] else shapes)
    run = simulate_robot(loop, 0.1, samples=11)
    assert scene.take(run).q.shape == (11, loop.model.nq)


def test_meshes_stand_in_the_places_of_their_boxes(browser, tmp_path):
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    import trimesh

    trimesh.creation.icosphere(radius=0.05).apply_translation([0.02, 0.0, 0.0]).export(tmp_path / "ball.stl")
    text = four_bar(*FOUR_BAR).replace(
        '<link name="crank">',
        '<link name="crank"><visual><origin xyz="0.1 0 0"/><geometry><mesh filename="ball.stl"/></geometry>'
        "</visual>",
    )
    (tmp_path / "bar.urdf").write_text(text, encoding="utf-8")
    robot = p3dof.ClosedLoopModel.from_urdf(text, FOUR_BAR_SIDECAR)
    scene = RobotScene(robot, p3dof.viewer.RobotFigure(robot, tmp_path / "bar.urdf"))
    q = four_bar_q(1.0, *FOUR_BAR)
    scene.display(q)
    (tmp_path / "still.html").write_text(scene.window.get_scene(), encoding="utf-8")
    with opened(browser, (tmp_path / "still.html").as_uri()) as page:
        low, high = page.page.evaluate(
            """() => {
                const node = nodeOf('meshcat/p3dof/visuals/shape_0_crank_joint/part_0');
                const part = node.children['<object>'].object;
                part.geometry.computeBoundingBox();
                return [part.geometry.boundingBox.min.toArray(), part.geometry.boundingBox.max.toArray()];
            }"""
        )
        np.testing.assert_allclose([low, high], [[-0.05] * 3, [0.05] * 3], atol=1e-3)
        place = page.place("meshcat/p3dof/visuals/shape_0_crank_joint/part_0")
        np.testing.assert_allclose(place[:3, 3], 0.12 * np.array([np.cos(1), 0, np.sin(1)]), atol=1e-6)


# On a phone


@pytest.mark.parametrize("size", [PHONE, (844, 390), (1280, 800)])
def test_the_whole_machine_is_in_the_picture(browser, robot, result, tmp_path, size):
    file = Scene(robot).record(result, playing=False).save(tmp_path / "phone.html")
    corners = Scene(robot)._room.corners
    with opened(browser, file.as_uri(), *size, ready=RECORDED) as page:
        assert page.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        for i in (0, 20, 90):
            seek(page, result.time[i])
            assert np.abs(page.tips()).max() < 1
            rows, columns = colours(pixels(page))
            assert rows.min() > 5
            assert rows.max() < size[1] - 5
            assert columns.min() > 5
            assert columns.max() < size[0] - 5
        seen = page.page.evaluate(
            """(points) => points.map(([x, y, z]) => {
                const root = nodeOf('meshcat').object;
                root.updateWorldMatrix(true, false);
                viewer.camera.updateWorldMatrix(true, false);
                const place = root.position.clone().set(x, y, z).applyMatrix4(root.matrixWorld);
                const seen = place.project(viewer.camera);
                return [seen.x, seen.y];
            })""",
            corners.tolist(),
        )
        assert np.abs(seen).max() < 1
        assert np.ptp(np.array(seen), axis=0).max() > 0.9  # and it is not small
        box = page.page.locator("#player").bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= size[0]
        assert page.page.locator("#player button").bounding_box()["height"] >= 32


# The pictures of the documentation


def coarse(png):
    """A picture in 32 by 24 patches: what differs between two browsers' edges and fonts is not in it."""
    from PIL import Image

    image = Image.open(io.BytesIO(png)).convert("RGB")
    assert image.size == (800, 600)
    return np.asarray(image.resize((32, 24), Image.Resampling.BOX)).astype(float)


@pytest.mark.slow
def test_the_pictures_of_the_documentation(robot, tmp_path):
    """Make them anew, and compare what they show; where it has changed, the new ones are to be committed."""
    pytest.importorskip("PIL", reason="Pillow is not installed")
    html = Scene(robot).record(p3dof.paper_motion(), playing=False).html
    find_chromium()  # skips where there is none
    found, kept = {}, {}
    for time in ("0.2", "0.9"):
        png = headless.picture_of(html, (800, 600), float(time))
        (tmp_path / f"meshcat_{time}.png").write_bytes(png)
        found[time] = coarse(png)
        kept[time] = coarse((STATIC / f"meshcat_{time}.png").read_bytes())
    apart = np.abs(found["0.2"] - found["0.9"]).mean()
    assert apart > 1  # the motion shows
    for time, picture in found.items():
        assert np.abs(picture - kept[time]).mean() < 0.25 * apart, f"other than {tmp_path}"


# The commands


@contextlib.contextmanager
def running(*arguments):
    """A command as a process, and the address that it prints."""
    program = "import sys; from p3dof.cli import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments), "--no-open", "--port", "0"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        address = re.compile(r"(http://127\.0\.0\.1:\d+/\?token=[\w-]+) shows the (machine|robot)")
        url = next(found[1] for line in process.stdout if (found := address.match(line)))  # after its notes
        yield process, url
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A motion and a load of the machine, a motion of a robot."""
    folder = tmp_path_factory.mktemp("motions")
    motion = p3dof.paper_motion(samples=41)
    (folder / "motion.csv").write_bytes(motion_csv(motion))
    (folder / "wrench.csv").write_text(
        "t,fx,fy,fz,mx,my,mz\n0,0,0,-30,0,0,0\n1,0,0,-30,0,0,0\n", encoding="utf-8"
    )
    (folder / "bar.csv").write_text("t,crank_joint\n0,0.4\n0.5,0.9\n1,1.4\n", encoding="utf-8")
    (folder / "bar.urdf").write_text(four_bar(*FOUR_BAR), encoding="utf-8")
    (folder / "bar.yaml").write_text(
        "closed_loop:\n- [coupler_tip, rocker_tip]\ntype: [3d]\nname_mot: [crank_joint]\n", encoding="utf-8"
    )
    return folder


def motion_csv(motion):
    rows = np.column_stack((motion.time, motion.pose, motion.velocity, motion.acceleration))
    names = "t,y,z,theta,ydot,zdot,thetadot,yddot,zddot,thetaddot"
    return "\n".join([names, *(",".join(map(repr, row)) for row in rows.tolist())]).encode()


def bodies_along(robot_too, files, body):
    """Where a body is along the motion of `files`, (N, 4, 4)."""
    if robot_too:
        robot = p3dof.ClosedLoopModel.from_urdf((files / "bar.urdf").read_text(), FOUR_BAR_SIDECAR)
        scene = RobotScene(robot, p3dof.viewer.RobotFigure(robot))
        rows = [four_bar_q(theta, *FOUR_BAR) for theta in np.linspace(0.4, 1.4, 201)]
    else:
        robot = p3dof.load()
        scene, rows = Scene(robot), joints_of(robot, p3dof.paper_motion(samples=201).pose)
    return np.array([bodies(scene.visualizer, q)[body] for q in rows])


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("robot_too", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_show_plays_again_and_again_until_ctrl_c(browser, files, robot_too):
    given = ["loop", "show", files / "bar.urdf", files / "bar.yaml"] if robot_too else ["show"]
    motion = files / ("bar.csv" if robot_too else "motion.csv")
    body = "meshcat/p3dof/visuals/" + ("coupler_joint_ball_0" if robot_too else "platform_0")
    with running(*given, "--meshcat", "--motion", motion, "--speed", 4) as (process, url):
        with opened(browser, url) as page:
            page.page.evaluate(
                """(path) => {
                    const handle = viewer.handle_command.bind(viewer);
                    window.seen = [];
                    viewer.handle_command = (command) => {
                        const moves = command.type === "set_transform" && command.path === path;
                        handle(command);
                        if (moves) seen.push(command.matrix);
                    };
                }""",
                f"/{body}",
            )
            path = bodies_along(robot_too, files, body)  # which of its places each one is the next to

            def instants():
                found = np.array(page.page.evaluate("seen")).reshape(-1, 4, 4).transpose(0, 2, 1)
                gaps = np.abs(found[:, None] - path).max(axis=(2, 3))
                assert gaps.min(axis=1, initial=np.inf).max(initial=0.0) < np.abs(np.diff(path, axis=0)).max()
                return gaps.argmin(axis=1)

            until(page.page, lambda: (np.diff(instants()) < -len(path) / 2).sum() >= 2)
            assert len(set(instants().tolist())) > 3
            page.healthy()
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")


@pytest.mark.parametrize("robot_too", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_once_ends_by_itself(browser, files, robot, robot_too):
    given = ["loop", "show", files / "bar.urdf", files / "bar.yaml"] if robot_too else ["show"]
    motion = files / ("bar.csv" if robot_too else "motion.csv")
    with running(*given, "--meshcat", "--motion", motion, "--once") as (process, url):
        with opened(browser, url) as page:
            until(page.page, lambda: process.poll() is not None)
            page.wait("document.getElementById('note').textContent.includes('what was drawn stays')")
            if not robot_too:
                (q,) = joints_of(robot, p3dof.paper_motion(samples=41).pose[-1:])
                eventually(page.page, check_bodies, page, bodies(Scene(robot).visualizer, q))
        assert process.communicate() == ("", "")
        assert process.returncode == 0


@pytest.mark.slow
def test_once_ends_where_nobody_looks(files):
    with running("show", "--meshcat", "--motion", files / "motion.csv", "--once", "--speed", 4) as (
        process,
        _,
    ):
        assert process.wait(timeout=60) == 0


@pytest.mark.usefixtures("ctrl_c")
def test_the_forces_hold_payload_and_load_at_a_moment(browser, files, robot):
    options = ("--motion", files / "motion.csv", "--payload", "2", "--wrench", files / "wrench.csv")
    with running("show", "--meshcat", *options, "--at", "0.5", "--paused") as (process, url):
        with opened(browser, url) as page:
            page.wait("!!nodeOf('meshcat/legend/text') && !!nodeOf('meshcat/forces/c/head')")
            loaded = p3dof.load(robot.parameters.carrying(Body(2.0, np.zeros(3), np.zeros((3, 3)))))
            result = loaded.inverse_dynamics(p3dof.paper_motion(samples=41), wrench=[0, 0, -30, 0, 0, 0])
            scale = p3dof.viewer.ArrowScale.of_motion(loaded, result)
            eventually(page.page, check_bodies, page, bodies(Scene(loaded).visualizer, result.joints.q[20]))
            eventually(page.page, check_arrows, page, scale, result, 20)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0


def test_the_commands_write_recorded_pages(browser, files, robot, tmp_path, capsys):
    from p3dof.cli import main

    machine, other = tmp_path / "machine.html", tmp_path / "robot.html"
    motion = str(files / "motion.csv")
    assert (
        main(["show", "--meshcat", "--motion", motion, "--paused", "--at", "0.9", "--out", str(machine)]) == 0
    )
    given = [str(files / name) for name in ("bar.urdf", "bar.yaml")]
    moved = ["--motion", str(files / "bar.csv"), "--trace", "coupler_tip"]
    assert main(["loop", "show", *given, "--meshcat", *moved, "--out", str(other)]) == 0
    assert f"wrote {machine}" in capsys.readouterr().out
    with opened(browser, machine.as_uri(), ready=RECORDED) as page:
        (q,) = joints_of(robot, p3dof.paper_motion(samples=41).pose[36:37])
        check_bodies(page, bodies(Scene(robot).visualizer, q))
        page.healthy()
    with opened(browser, other.as_uri(), ready=RECORDED) as page:
        page.wait("viewer.animator.playing && viewer.animator.time > 0.1 && !!nodeOf('meshcat/trace')")
        page.healthy()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--meshcat", "--out", "show.png"], "show.png: --meshcat writes .html only"),
        (["--meshcat", "--screenshot", "show.png"], "show.png: --meshcat writes .html only"),
        (["--once"], "--once needs --meshcat"),
        (["--meshcat", "--once", "--paused"], "--once and --paused exclude each other"),
        (["--meshcat", "--once", "--out", "show.html"], "--once is for what is played live, not for files"),
    ],
)
def test_options_that_do_not_fit(capsys, arguments, words):
    from p3dof.cli import main

    assert main(["show", "--no-open", *arguments]) == 2
    assert words in capsys.readouterr().err
    if "--screenshot" not in arguments:
        assert main(["loop", "show", str(GALLERY / "four_bar.urdf"), "--no-open", *arguments]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--meshcat", "--closure-forces"], "--closure-forces are in the page with charts"),
        (["--trace", "coupler_tip"], "--trace needs --meshcat"),
        (["--meshcat", "--trace", "copler_tip", "--out", "x.html"], "did you mean 'coupler_tip'"),
    ],
)
def test_options_of_any_robot_that_do_not_fit(capsys, arguments, words):
    from p3dof.cli import main

    assert main(["loop", "show", str(GALLERY / "four_bar.urdf"), "--no-open", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_bad_arguments_are_one_clear_error(robot, result, bar):
    scene, other = Scene(robot), RobotScene(bar[0], p3dof.viewer.RobotFigure(bar[0]))
    for call, words in (
        (
            lambda: scene.visualizer.play("motion.csv"),
            "result: expected a Motion, InverseDynamics or Simulation",
        ),
        (lambda: scene.visualizer.play(result, speed=9), r"speed: expected a number from 0\.1 to 4"),
        (lambda: scene.visualizer.play(result, at=2), "at: expected a number from 0 to 1, got 2"),
        (
            lambda: scene.visualizer.record(result, wrench=np.zeros(6)),
            "wrench: expected a Motion to go with it",
        ),
        (lambda: other.take(result.motion), "motion: expected a RobotRun or a JointMotion"),
        (lambda: other.take(JointMotion([0], np.zeros((1, 7)))), r"q of shape \(N, 3\), got \(1, 7\)"),
        (lambda: other.take(bar[1], np.zeros(6)), "wrench: a run of any robot has its own loads"),
        (lambda: robot_viewer(robot), "robot: expected a ClosedLoopModel"),
        (lambda: robot_viewer(bar[0], trace="cupler_tip"), "did you mean 'coupler_tip'"),
    ):
        with pytest.raises(InputError, match=words):
            call()
    assert scene.record(result).title.startswith("3-DOF")
    assert "<iframe" in scene.record(result)._repr_html_()
    with pytest.raises(InputError, match=r"\.html"):
        scene.record(result).save("motion.mp4")
    assert SceneWindow().watched


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_play_and_the_script_goes_on():
    program = (
        "import p3dof\n"
        "viewer = p3dof.load().viewer(port=0)\n"
        "viewer.play(p3dof.paper_motion(samples=11), repeat=True)\n"
        "print('after', bool(viewer.viewer.url()))\n"
    )
    how = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": ROOT}
    environment = {
        name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    with subprocess.Popen([sys.executable, "-c", program], env=environment, **how) as process:
        assert " shows the motion" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "after True\n", "")
