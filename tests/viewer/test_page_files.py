"""What can be taken out of the page, read back by what reads such files; and links to an instant."""

from __future__ import annotations

import csv
import io
import itertools
import json
import struct

import numpy as np
import pages
import pytest
from browser import opened
from numpy.testing import assert_allclose
from page_documents import curve_of, placements

import p3dof
from p3dof.viewer.document.html import page_html
from p3dof.viewer.machine.document import page_document

SAMPLES = 101


@pytest.fixture(scope="module")
def result():
    return p3dof.Manipulator().inverse_dynamics(p3dof.paper_motion(SAMPLES))


@pytest.fixture(scope="module")
def document(result):
    return page_document(p3dof.Manipulator(), result, runs={"slower": pages.slower(51, 2.0)})


@pytest.fixture(scope="module")
def written(document, tmp_path_factory):
    path = tmp_path_factory.mktemp("pages") / "page.html"
    path.write_text(page_html(document), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def opened_page(browser, written):
    with pages.shared(browser, written, 640, 480) as watched:
        yield watched


@pytest.fixture
def watched(opened_page):
    yield pages.as_new(opened_page)
    opened_page.healthy()


def saved(watched, label):
    """Press a button, and return the bytes and the name of the file that comes."""
    with watched.page.expect_download() as coming:
        watched.page.get_by_role("button", name=label, exact=True).click()
    return coming.value.path().read_bytes(), coming.value.suggested_filename


def test_the_motion_is_a_file_that_p3dof_reads_to_the_same_bits(watched, result, tmp_path):
    content, name = saved(watched, "Motion CSV")
    assert name.endswith("-motion.csv")
    (tmp_path / name).write_bytes(content)
    motion = p3dof.Motion.from_csv(tmp_path / name)
    for field in ("time", "pose", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(motion, field), getattr(result.motion, field))
    np.testing.assert_array_equal(p3dof.Manipulator().inverse_dynamics(motion).forces, result.forces)


def test_all_curves_are_a_table_with_their_units(watched, document):
    content, _ = saved(watched, "Curves CSV")
    names, *rows = csv.reader(content.decode().splitlines())
    run = document["runs"][0]
    assert names[:2] == ["t [s]", "Force A [N]"]
    assert len(set(names)) == len(names) == len(run["curves"]) + 1
    table = np.array(rows, dtype=float)
    for column, curve in enumerate(run["curves"], 1):
        np.testing.assert_array_equal(table[:, column], curve_of(run, curve["key"]))
        assert names[column].endswith(f"[{curve['unit']}]")


@pytest.mark.parametrize("label", ["Charts PNG", "3D PNG"])
def test_a_picture_shows_the_instant(watched, label):
    from matplotlib.image import imread

    watched.see()
    pictures = []
    for time in (0.0, 0.8):
        watched.page.evaluate("time => p3dof.seek(time)", time)
        pictures.append(imread(io.BytesIO(saved(watched, label)[0])))
    first, second = pictures
    assert first.shape == second.shape
    assert first.std() > 0.02
    assert np.abs(first - second).max() > 0.2
    if label == "3D PNG":  # without the ring and the ball that the hand takes hold of
        red, green, blue = np.moveaxis(first[..., :3], -1, 0)
        assert not ((blue > red + 0.1) & (red > green + 0.2) & (blue > 0.8)).any()
        assert watched.page.evaluate("!!p3dof.state.stage.contents.handles.group.parent")


def floats(glb, gltf, accessor, width):
    """The numbers of an accessor of a binary glTF file."""
    (json_size,) = struct.unpack_from("<I", glb, 12)
    view = gltf["bufferViews"][gltf["accessors"][accessor]["bufferView"]]
    start = 28 + json_size + view["byteOffset"]
    return np.frombuffer(glb, "<f4", view["byteLength"] // 4, start).reshape(-1, width)


def test_the_scene_is_a_gltf_file_whose_joints_move_as_in_the_document(watched, document):
    from scipy.spatial.transform import Rotation

    glb, name = saved(watched, "glTF")
    assert name.endswith(".glb")
    magic, version, length, json_size, kind = struct.unpack_from("<4sIII4s", glb)
    assert (magic, version, length, kind) == (b"glTF", 2, len(glb), b"JSON")
    gltf = json.loads(glb[20 : 20 + json_size])
    (animation,) = gltf["animations"]
    tracks = {}
    for channel in animation["channels"]:
        path, sampler = channel["target"]["path"], animation["samplers"][channel["sampler"]]
        times = floats(glb, gltf, sampler["input"], 1)[:, 0]
        tracks[channel["target"]["node"], path] = floats(
            glb, gltf, sampler["output"], 3 + (path == "rotation")
        )
    assert_allclose(times, np.linspace(0.0, 1.0, SAMPLES), atol=1e-6)
    parents = {child: i for i, node in enumerate(gltf["nodes"]) for child in node.get("children", ())}
    for sample in (0, 35, SAMPLES - 1):

        def world(node, sample=sample):
            own = np.eye(4)
            turn = tracks.get(
                (node, "rotation"), [gltf["nodes"][node].get("rotation", [0, 0, 0, 1])] * SAMPLES
            )
            place = tracks.get(
                (node, "translation"), [gltf["nodes"][node].get("translation", [0, 0, 0])] * SAMPLES
            )
            own[:3, :3], own[:3, 3] = Rotation.from_quat(turn[sample]).as_matrix(), place[sample]
            return own if parents[node] == 0 else world(parents[node]) @ own

        here = placements(document, document["runs"][0], sample)
        for i, joint in enumerate(document["scene"]["joints"]):
            assert gltf["nodes"][i + 1]["name"] == joint["name"]
            assert_allclose(world(i + 1), here[i], atol=1e-5)  # floats
    assert sum("mesh" in node for node in gltf["nodes"]) == len(document["scene"]["solids"])


def test_a_gif_has_one_picture_for_each_instant_and_comes_out_the_same_again(watched):
    from PIL import Image

    watched.see()
    watched.page.evaluate("p3dof.state.set({speed: 4}); p3dof.seek(0.35)")
    first, again = (saved(watched, "GIF")[0] for _ in range(2))
    assert first == again
    film = Image.open(io.BytesIO(first))
    assert film.n_frames == 7  # 1 s, four times as fast, 25 pictures a second
    frames = []
    for k in range(film.n_frames):
        film.seek(k)
        assert film.info["duration"] == 40
        frames.append(np.asarray(film.convert("RGB"), dtype=int))
    assert all(np.abs(a - b).max() > 100 for a, b in itertools.pairwise(frames))
    assert watched.page.evaluate("p3dof.state.time") == 0.35


def test_a_film_plays_as_long_as_the_run(watched):
    watched.see()
    watched.page.evaluate("p3dof.state.set({speed: 2})")
    content, name = saved(watched, "MP4")
    assert name.endswith(".mp4")
    seen = watched.page.evaluate(
        """async (bytes) => {
        const film = document.createElement("video");
        film.muted = true;
        film.src = URL.createObjectURL(new Blob([new Uint8Array(bytes)], {type: "video/mp4"}));
        await new Promise((done, failed) => Object.assign(film, {onloadeddata: done, onerror: failed}));
        const canvas = document.createElement("canvas"), shots = [];
        [canvas.width, canvas.height] = [film.videoWidth, film.videoHeight];
        const to = canvas.getContext("2d", {willReadFrequently: true});
        for (const time of [0.01, 0.4]) {
            film.currentTime = time;
            await new Promise((done) => { film.onseeked = done; });
            to.drawImage(film, 0, 0);
            shots.push(to.getImageData(0, 0, canvas.width, canvas.height).data);
        }
        let most = 0;
        for (let i = 0; i < shots[0].length; i++) most = Math.max(most, Math.abs(shots[0][i] - shots[1][i]));
        return [film.duration, film.videoWidth, film.videoHeight, most];
    }""",
        list(content),
    )
    duration, width, height, difference = seen
    assert_allclose(duration, 16 / 30, atol=1e-3)  # 0.5 s, and the last picture
    size = watched.page.evaluate("(({width, height}) => [width, height])(p3dof.state.stage.canvas)")
    assert [width, height] == size
    assert difference > 100


def test_a_film_can_be_cancelled_and_leaves_the_time_as_it_was(watched):
    watched.see()
    watched.page.evaluate("p3dof.state.set({speed: 0.05}); p3dof.seek(0.35)")
    watched.page.get_by_role("button", name="GIF", exact=True).click()
    watched.wait("document.querySelector('.film progress').value > 0")
    watched.page.get_by_role("button", name="Cancel", exact=True).click()
    watched.wait("document.querySelector('.film').hidden")
    assert "Cancelled" in watched.page.locator("#downloads").inner_text()
    assert watched.page.evaluate("p3dof.state.time") == 0.35


def test_a_link_leads_to_its_run_and_its_instant(browser, written, watched):
    with opened(browser, f"{written}#run=2&t=1.5", ready=pages.READY) as linked:
        assert linked.page.evaluate("[p3dof.state.run, p3dof.instant().time]") == [1, 1.5]
    with opened(browser, f"{written}#t=.35", ready=pages.READY) as linked:
        assert linked.page.evaluate("[p3dof.state.run, p3dof.instant().time]") == [0, 0.35]
        linked.page.evaluate("location.hash = 't=0.5'")
        linked.wait("p3dof.state.time === 0.5")
    with opened(browser, f"{written}#run=7&t=nonsense", ready=pages.READY) as linked:
        assert linked.page.evaluate("[p3dof.state.run, p3dof.instant().time]") == [0, 0.0]
        linked.healthy()
    watched.page.evaluate("p3dof.state.set({run: 1}); p3dof.seek(0.25)")
    watched.page.get_by_role("button", name="Link", exact=True).click()
    watched.wait("location.hash === '#run=2&t=0.25'")
