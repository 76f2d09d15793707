"""Pictures and films: of the page, at exact times, and of what MeshCat draws."""

from __future__ import annotations

import io
import itertools
import shutil
import subprocess
import sys

import numpy as np
import pytest
from browser import chromium, find_chromium, opened

import p3dof
from p3dof._base.errors import InputError, MissingExtraError
from p3dof.viewer import Scene, pictures, save_screenshot, save_video
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.headless import as_image
from p3dof.viewer.pictures import frame_times

SMALL = (320, 240)
READY = "!!window.p3dof && p3dof.ready.then(() => true)"


@pytest.fixture(scope="module")
def page():
    return p3dof.load().page(p3dof.paper_motion(101), at=0.25)


def pixels(path):
    return np.asarray(as_image(path.read_bytes())).astype(int)


def test_a_picture_shows_the_machine_at_an_instant_and_nothing_else(page, tmp_path):
    find_chromium()
    paths = [save_screenshot(tmp_path / f"{time}.png", page, time, SMALL) for time in (None, 0.9)]
    first, later = (pixels(path) for path in paths)
    assert first.shape == (240, 320, 3)
    assert np.abs(first - later).max(axis=2).mean() > 1.0
    for ink in ((0, 114, 178), (213, 94, 0), (0, 158, 115)):  # the legs; lamps change brightness, not hue
        hue = np.array(ink) / np.linalg.norm(ink)
        size = np.linalg.norm(first, axis=2)
        near = (first @ hue > 0.98 * size) & (size > 60)
        assert near.sum() > 30
    ground = first[2, 2]
    assert (first[:, -3:] == ground).all(axis=2).mean() > 0.5  # no panel beside it


def test_the_caption_says_what_and_when(page, tmp_path):
    with (
        chromium() as browser,
        opened(browser, page.save(tmp_path / "p.html").as_uri(), ready=READY) as watched,
    ):
        watched.page.evaluate("() => p3dof.picture()")
        watched.page.evaluate("() => p3dof.seek(0.5)")
        text = watched.page.inner_text(".caption")
        forces = p3dof.load().inverse_dynamics(p3dof.paper_motion(101)).forces[50]
        assert "t = 0.500 s" in text
        for leg, force in zip("ABC", forces, strict=True):
            assert f"Force {leg} {force:.4g} N" in text
        for name in ("#panel", "#time-bar", "#charts", ".views"):
            assert not watched.page.is_visible(name)
        watched.healthy()


def test_a_gif_plays_the_run_in_a_loop(page, tmp_path):
    find_chromium()
    from PIL import Image, ImageSequence

    told = []
    path = save_video(tmp_path / "m.gif", page, 4.0, 1.0, SMALL, progress=lambda *now: told.append(now))
    film = Image.open(io.BytesIO(path.read_bytes()))
    frames = [np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(film)]
    assert len(frames) == 5
    assert told == [(k, 5) for k in range(1, 6)]
    assert film.info["loop"] == 0
    assert all(np.abs(a - b).mean() > 0.3 for a, b in itertools.pairwise(frames))


def test_an_mp4_is_a_film(page, tmp_path):
    find_chromium()
    path = save_video(tmp_path / "m.mp4", page, 3.0, 1.0, SMALL)
    if shutil.which("ffprobe"):
        asked = ["ffprobe", "-v", "error", "-select_streams", "v", "-count_packets", "-of", "csv=p=0"]
        asked += ["-show_entries", "stream=codec_name,width,height,pix_fmt,nb_read_packets", str(path)]
        found = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip().split(",")
        assert found == ["h264", "320", "240", "yuv420p", "4"]
    assert path.read_bytes()[4:8] == b"ftyp"


def test_frames_are_evenly_spaced_and_end_with_the_run(page):
    time = decoded(page.document["runs"][0]["time"])
    np.testing.assert_allclose(frame_times(time, 0.3), [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(frame_times(time, 0.25), [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(frame_times(time[:1], 0.25), [0])
    with pytest.raises(InputError, match="fps, speed: expected at most 20000 frames"):
        frame_times(time, 1e-5)


def test_pinocchio_captures_the_picture():
    find_chromium()
    pytest.importorskip("meshcat", reason="meshcat is not installed")
    image = Scene(p3dof.load()).visualizer.viewer.get_image()
    shown = np.asarray(image).astype(int)
    assert shown.shape[2] == 3
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 100
    stream = io.BytesIO()
    image.save(stream, "PNG")
    assert stream.getvalue().startswith(b"\x89PNG")


def test_without_a_browser_or_ffmpeg_it_is_said(page, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "playwright", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'p3dof\[video\]'"):
        save_screenshot(tmp_path / "m.png", page)
    monkeypatch.undo()
    monkeypatch.setattr(pictures.shutil, "which", lambda _: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match="an MP4 needs ffmpeg"):
        save_video(tmp_path / "m.mp4", page)
    assert not list(tmp_path.iterdir())


def test_a_browser_that_does_not_start_is_one_clear_error(page, tmp_path, monkeypatch):
    pytest.importorskip("playwright", reason="playwright is not installed")
    monkeypatch.setenv("CHROMIUM", "/bin/false")
    with pytest.raises(MissingExtraError, match="the browser for pictures does not start"):
        save_screenshot(tmp_path / "m.png", page)


def test_bad_input_is_one_clear_error(page, tmp_path):
    png = tmp_path / "m.png"
    for make, words in (
        (
            lambda: save_screenshot(tmp_path / "m.jpg", page),
            r"m\.jpg: expected a file name that ends in \.png",
        ),
        (lambda: save_screenshot(png, "page"), "page: expected a Page, got 'page'"),
        (lambda: save_screenshot(png, page, 2.0), "time: expected a number from 0 to 1, got 2"),
        (lambda: save_screenshot(png, page, size=(1, 1)), "size: expected width and height"),
        (lambda: save_video(tmp_path / "m.avi", page), r"\.mp4 or \.gif"),
        (
            lambda: save_video(tmp_path / "m.gif", page, fps=100),
            "fps: expected at most 50 for a GIF, got 100",
        ),
        (lambda: save_video(tmp_path / "m.gif", page, speed=0), "speed: expected"),
        (lambda: page.save(tmp_path / "page.txt"), r"page\.txt: expected a file name that ends in \.html"),
    ):
        with pytest.raises(InputError, match=words):
            make()
    assert not list(tmp_path.iterdir())
