"""Files of a motion: the page that plays with no network, films and pictures; drawn by a real browser."""

from __future__ import annotations

import asyncio
import dataclasses
import io
import itertools
import re
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest

import p3dof
from p3dof.errors import MissingExtraError

pytest.importorskip("meshcat", reason="meshcat is not installed")
from browser import chromium, find_chromium, opened
from PIL import Image

from p3dof.viewer import (
    ArrowScale,
    Scene,
    animation_html,
    films,
    joints_of,
    save_animation,
    save_screenshot,
    save_video,
    trace_of,
    video,
)
from p3dof.viewer.animation import frames_of
from p3dof.viewer.drawing import ROOT

VISUALS = f"meshcat/{ROOT}/visuals/"
SMALL = (320, 240)


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def result(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(samples=1001), method="virtual-power")


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def file(robot, result, tmp_path_factory):
    return save_animation(tmp_path_factory.mktemp("page") / "new" / "motion.html", robot, result)


@pytest.fixture(scope="module")
def page(browser, file):
    with opened(browser, file.as_uri(), 800, 600) as watched:
        yield watched
        watched.healthy()
        assert watched.requests == [file.as_uri()]


def at(watched, time):
    watched.page.evaluate("time => freeze(time)", time)


def expected_places(robot, pose):
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, joints_of(robot, pose))
    solids = robot.visual_model.geometryObjects
    return [(data.oMi[solid.parentJoint] * solid.placement).homogeneous for solid in solids]


def test_one_second_at_sixty_frames_stays_under_three_megabytes(file):
    assert 0.8e6 < file.stat().st_size < 1.5e6


def test_it_plays_by_itself_and_again_and_again(browser, file):
    with opened(browser, file.as_uri(), 400, 300) as watched:
        watched.wait("viewer.animator.playing && viewer.animator.time > 0.3")
        watched.page.evaluate("window.latest = 0; window.turns = 0")
        watched.wait(
            "() => { const now = viewer.animator.time; turns += now < latest; latest = now; "
            "return turns > 1 }"
        )
        watched.healthy()


@pytest.mark.parametrize("frame", [0, 1, 13, 29, 44, 60])
def test_every_body_is_where_pinocchio_has_it(page, robot, frame):
    at(page, frame / 60)
    pose = p3dof.paper_motion(samples=61).pose[frame]
    names = [VISUALS + solid.name for solid in robot.visual_model.geometryObjects]
    np.testing.assert_allclose(page.places(names), expected_places(robot, pose), rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        page.place("meshcat/platform")[:3, 3], trace_of(robot, pose), rtol=0, atol=1e-6
    )


def test_between_frames_it_goes_straight(page, robot, result):
    at(page, 27.5 / 60)
    pose = p3dof.paper_motion(samples=121).pose[55]
    names = [VISUALS + solid.name for solid in robot.visual_model.geometryObjects]
    bound = np.abs(result.motion.acceleration).max() / 60**2 / 8  # of linear interpolation
    np.testing.assert_allclose(page.places(names), expected_places(robot, pose), rtol=0, atol=bound)


def test_arrows_and_numbers_follow_the_forces(page, robot, result):
    scale = ArrowScale.of_motion(robot, result)
    for time in (0.1, 0.5, 0.85, 1.0):
        at(page, time)
        forces = [np.interp(time, result.time, column) for column in result.forces.T]
        for leg, force in zip("abc", forces, strict=True):
            shaft, head = (page.place(f"meshcat/forces/{leg}/{part}") for part in ("shaft", "head"))
            np.testing.assert_allclose(
                (head @ [0, 0, 1, 1] - shaft @ [0, 0, 0, 1])[:3],
                [0, 0, scale.length(force)],
                rtol=0,
                atol=1e-6,
            )
            shown = page.page.inner_text(f"#force_{leg.upper()}")
            assert float(shown.removesuffix(" N")) == pytest.approx(force, abs=0.0501)
        assert page.page.inner_text("#time") == f"t = {time:.3f} s"


def test_every_arrow_stays_in_sight_and_the_legend_says_how_long_they_are(browser, robot, result, tmp_path):
    """Also of a motion with five times the forces, and in a window that is higher than wide."""
    strong = dataclasses.replace(result, forces=5 * result.forces)
    path = save_animation(tmp_path / "strong.html", robot, strong, fps=20)
    with opened(browser, path.as_uri(), 800, 600) as watched:
        assert watched.page.inner_text("#legend").startswith(
            "The grey arrow is 500 N; the longest is 592.5 N"
        )
        for width, height in ((800, 600), (300, 420), (900, 300)):
            watched.page.set_viewport_size({"width": width, "height": height})
            watched.wait("([w, h]) => Math.abs(viewer.camera.aspect - w / h) < 1e-3", [width, height])
            for time in (0.0, 0.3, 0.6, 1.0):
                at(watched, time)
                assert np.abs(watched.tips()).max() < 1
        watched.healthy()


def pixels(watched):
    return np.asarray(Image.open(io.BytesIO(watched.page.screenshot())).convert("RGB"), dtype=int)


def test_pixels_change_with_time_and_only_then(page):
    at(page, 0.0)
    first = pixels(page)
    at(page, 0.5)
    second = pixels(page)
    at(page, 0.0)
    changed = np.abs(first - second).max(axis=-1) > 40
    assert 0.005 < changed.mean() < 0.3
    np.testing.assert_array_equal(pixels(page), first)


def test_the_mouse_pauses_plays_and_seeks(browser, file):
    with opened(browser, file.as_uri(), 1000, 600) as watched:
        watched.wait("viewer.animator.playing")
        watched.page.get_by_text("pause", exact=True).click()
        watched.wait("!viewer.animator.playing")
        bar = watched.page.locator("li.has-slider", has_text="time").locator(".slider").bounding_box()
        watched.page.mouse.click(bar["x"] + 0.5 * bar["width"], bar["y"] + 0.5 * bar["height"])
        watched.wait("Math.abs(viewer.animator.time - 0.5) < 0.02")
        watched.wait("/t = 0\\.(49|50|51)\\d s/.test(document.getElementById('time').textContent)")
        watched.page.get_by_text("play", exact=True).click()
        watched.wait("viewer.animator.playing && viewer.animator.time > 0.6")
        box = watched.page.locator("li.number", has_text=re.compile("^speed$")).locator("input")
        box.fill("0.25")
        box.press("Enter")
        watched.wait("viewer.animator.mixer.timeScale === 0.25")
        watched.healthy()


def test_the_licences_can_be_read(browser, file):
    with opened(browser, file.as_uri(), 800, 600) as watched:
        assert watched.page.locator("#licences pre").is_hidden()
        watched.page.get_by_text("licences", exact=True).click()
        text = watched.page.locator("#licences pre")
        assert text.is_visible()
        assert "Copyright \N{COPYRIGHT SIGN} 2010-2021 three.js authors" in text.inner_text()
        watched.healthy()


def test_speed_and_title_are_taken(browser, robot, result, tmp_path):
    title = '<img src=x onerror="alert(1)"> </script> @SCRIPT@ & more'
    path = save_animation(tmp_path / "slow.html", robot, result, speed=0.5, fps=10, title=title)
    assert len(frames_of(robot, result, 0.5, 10).time) == 21
    with opened(browser, path.as_uri(), 400, 300) as watched:
        assert watched.page.evaluate("viewer.animator.mixer.timeScale") == 0.5
        assert watched.page.inner_text("h1") == title
        assert watched.page.title() == title
        watched.healthy()


def test_arrows_flip_and_vanish_and_the_last_pose_within_reach_stays(browser, robot, tmp_path):
    time = np.linspace(2.0, 3.0, 11)
    pose = np.zeros((11, 3))
    pose[:, 0] = np.where(time < 2.45, time - 2.0, 0.0)  # leg A cannot reach beyond y = .25
    motion = p3dof.Motion(time, pose, np.zeros((11, 3)), np.zeros((11, 3)), check=False)
    solved = robot.inverse_dynamics(motion, method="virtual-power", on_invalid="nan")
    assert [bool(valid) for valid in solved.valid] == [True] * 3 + [False] * 2 + [True] * 6
    flipped = solved.forces * np.where(time > 2.75, -1, 1)[:, None]
    shown = dataclasses.replace(solved, forces=flipped)
    path = save_animation(tmp_path / "odd.html", robot, shown, fps=10)
    platform = f"{VISUALS}platform_0"
    with opened(browser, path.as_uri(), 400, 300) as watched:
        at(watched, 0.2)
        held = watched.place(platform)
        at(watched, 0.4)
        np.testing.assert_allclose(watched.place(platform), held, rtol=0, atol=1e-7)
        assert watched.page.inner_text("#force_A") == "not determined"
        assert not watched.page.evaluate("nodeOf('meshcat/forces/a').object.visible")
        assert watched.page.evaluate("nodeOf('meshcat/open/a').object.visible")
        for moment, sign in ((0.6, 1), (0.9, -1)):
            at(watched, moment)
            assert watched.page.evaluate("nodeOf('meshcat/forces/a').object.visible")
            assert not watched.page.evaluate("nodeOf('meshcat/open/a').object.visible")
            head = watched.place("meshcat/forces/a/head")
            assert np.sign((head @ [0, 0, 1, 0])[2]) == sign
        assert watched.page.inner_text("#time") == "t = 2.900 s"
        watched.healthy()


def test_a_motion_of_one_sample_is_a_still(browser, robot, tmp_path):
    motion = p3dof.Motion([0.0], [[0.01, 0.02, 0.1]], np.zeros((1, 3)), np.zeros((1, 3)))
    path = save_animation(tmp_path / "still.html", robot, robot.inverse_dynamics(motion))
    with opened(browser, path.as_uri(), 400, 300) as watched:
        at(watched, 0.0)
        expected = trace_of(robot, motion.pose[0])
        np.testing.assert_allclose(watched.place("meshcat/platform")[:3, 3], expected, rtol=0, atol=1e-6)
        watched.healthy()


def test_frames_are_exact_and_cover_the_motion(robot, result):
    frames = frames_of(robot, result, 1.0, 24)
    assert len(frames.time) == 25
    assert frames.time[[0, -1]].tolist() == [0.0, 1.0]
    assert frames.rate == pytest.approx(24)
    exact = joints_of(robot, p3dof.paper_motion(samples=25).pose)
    np.testing.assert_allclose(frames.joints, exact, rtol=0, atol=1e-12)
    forces = robot.inverse_dynamics(p3dof.paper_motion(samples=25), method="virtual-power").forces
    np.testing.assert_allclose(frames.forces, forces, rtol=0, atol=5e-3)
    assert frames_of(robot, result, 3.0, 24).rate == pytest.approx(8)
    assert len(frames_of(robot, result, 1.0, 0.3).time) == 2


def test_a_picture_shows_the_machine(robot, result, tmp_path):
    find_chromium()
    trace = trace_of(robot, result.motion.pose)
    path = save_screenshot(
        tmp_path / "shot.png", robot, result.motion.pose[600], result.forces[600], trace, (640, 480)
    )
    image = Image.open(io.BytesIO(path.read_bytes()))
    assert image.format == "PNG"
    assert image.size == (640, 480)
    colours = np.asarray(image.convert("HSV"), dtype=int)
    vivid = colours[..., 0][colours[..., 1] > 140] * 360 / 255
    for hue in (54, 203, 26, 163):  # platform and the three legs
        assert np.mean(np.abs(vivid - hue) < 8) > 0.03
    bare = bare_picture(robot, result, 600, tmp_path / "bare.png")
    changed = np.asarray(image.convert("RGB")) != np.asarray(bare.convert("RGB"))
    assert 0.001 < changed.any(axis=-1).mean() < 0.1


def bare_picture(robot, result, sample, path):
    """Without arrows, legend and trace, and as from a notebook's cell, where an event loop runs."""

    async def cell():
        pose, forces = result.motion.pose[sample], result.forces[sample]
        scale = ArrowScale.of_forces(robot, forces, result.sliders[sample])  # the camera is the same
        return save_screenshot(path, robot, pose, size=(640, 480), scale=scale)

    with ThreadPoolExecutor(1) as elsewhere:  # playwright's own loop runs in the main thread
        written = elsewhere.submit(lambda: asyncio.run(cell())).result()
    return Image.open(io.BytesIO(written.read_bytes()))


def test_pinocchio_captures_the_picture(robot):
    find_chromium()
    picture = Scene(robot).visualizer.captureImage()
    assert picture.shape == (video.SIZE[1], video.SIZE[0], 3)
    assert picture.std() > 20


def test_a_gif_plays_the_motion_in_a_loop(robot, result, tmp_path):
    find_chromium()
    done = []
    path = save_video(
        tmp_path / "film.gif", robot, result, fps=6, size=SMALL, progress=lambda *n: done.append(n)
    )
    film = Image.open(io.BytesIO(path.read_bytes()))
    assert (film.format, film.size, film.n_frames, film.info["loop"]) == ("GIF", SMALL, 7, 0)
    assert done == [(i, 7) for i in range(1, 8)]
    frames, durations = [], []
    for number in range(film.n_frames):
        film.seek(number)
        durations.append(film.info["duration"])
        frames.append(np.asarray(film.convert("RGB"), dtype=int))
    assert sum(durations) == pytest.approx(7 / 6 * 1000, abs=10)
    for one, other in itertools.pairwise(frames):
        assert (np.abs(one - other).max(axis=-1) > 40).mean() > 0.002


def test_an_mp4_is_a_film(robot, result, tmp_path):
    find_chromium()
    try:
        ffmpeg = films._ffmpeg()
    except MissingExtraError:
        pytest.skip("neither ffmpeg nor imageio-ffmpeg is installed")
    path = save_video(tmp_path / "film.mp4", robot, result, fps=5, size=(321, 241), speed=2.0)
    data = path.read_bytes()
    assert data[4:8] == b"ftyp"
    run = films.subprocess.run([ffmpeg, "-i", str(path)], capture_output=True, text=True, check=False)
    assert re.search(r"h264.*yuv420p.*322x242.* 6 fps", run.stderr)


def test_without_a_browser_or_ffmpeg_it_is_said(robot, result, tmp_path, monkeypatch):
    monkeypatch.setattr(films.shutil, "which", lambda _: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[video\].*gif"):
        save_video(tmp_path / "film.mp4", robot, result)
    monkeypatch.setitem(sys.modules, "playwright", None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[video\]"):
        save_screenshot(tmp_path / "shot.png", robot)
    assert list(tmp_path.iterdir()) == []


def test_a_browser_that_does_not_start_is_one_clear_error(robot, tmp_path, monkeypatch):
    pytest.importorskip("playwright", reason="playwright is not installed")
    monkeypatch.setenv("CHROMIUM", str(tmp_path / "no-such-browser"))
    with pytest.raises(MissingExtraError, match="does not start"):
        save_screenshot(tmp_path / "shot.png", robot)


def test_bad_input_is_one_clear_error(robot, result, tmp_path):
    other = p3dof.load(dataclasses.replace(p3dof.PAPER, geometry=p3dof.Geometry(r=0.11)))
    lost = dataclasses.replace(result, forces=np.full_like(result.forces, np.nan))
    still = np.zeros((len(result.time), 3))
    nowhere = dataclasses.replace(lost, motion=p3dof.Motion(result.time, still + 9, still, still))
    cut = dataclasses.replace(result, motion=result.motion[:9])
    shot, film = tmp_path / "a.png", tmp_path / "a.gif"
    cases = [
        (lambda: animation_html(robot, result.motion), "result: expected an InverseDynamics, got a Motion"),
        (lambda: animation_html("robot", result), "robot: expected a Manipulator, got 'robot'"),
        (lambda: animation_html(other, result), "sliders where this machine has none"),
        (lambda: animation_html(robot, result, speed=0), "speed: expected a positive number, got 0"),
        (lambda: animation_html(robot, result, fps=-1), "fps: expected a positive number, got -1"),
        (lambda: animation_html(robot, result, fps=1e9), "at most 20000 frames, got 1000000000"),
        (lambda: animation_html(robot, result, title=None), "title: expected text, got None"),
        (lambda: save_video(film, robot, result, fps=60), "at most 50 for a GIF, got 60"),
        (lambda: save_video(film, robot, result, size=(3, 3)), "size: expected width and height from 16"),
        (lambda: save_video(film, robot, result, size="big"), "size: expected width and height .* a str"),
        (lambda: save_video(shot, robot, result), "name that ends in .mp4 or .gif"),
        (lambda: save_screenshot(film, robot), "name that ends in .png"),
        (lambda: save_screenshot(shot, robot, [0, 0]), r"pose: expected shape \(3,\), got \(2,\)"),
        (lambda: save_screenshot(shot, "robot"), "robot: expected a Manipulator"),
        (lambda: animation_html(robot, cut), "9 samples"),
        (lambda: animation_html(robot, nowhere), "expected a motion with a pose within reach"),
    ]
    for call, message in cases:
        with pytest.raises(p3dof.InputError, match=message):
            call()
    with pytest.raises(p3dof.ReachError):
        save_screenshot(shot, robot, [1, 0, 0])
    with pytest.raises(p3dof.InputError, match=r"a\.gif: expected a file name that ends in \.html"):
        save_animation(film, robot, result, fps=2)
    folder = tmp_path / "folder.html"
    folder.mkdir()
    for path in (folder, 3):
        with pytest.raises(p3dof.FileError):
            save_animation(path, robot, result, fps=2)
    assert list(tmp_path.iterdir()) == [folder]
