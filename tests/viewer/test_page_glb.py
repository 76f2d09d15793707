"""Documents as binary glTF: valid, read by others, and joints where Pinocchio has them."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess

import numpy as np
import pinocchio as pin
import pytest
from command_line import run
from documents import ROOT
from page_documents import every_joint, matrix, placements, read

import p3dof
from p3dof._base.errors import InputError
from p3dof.viewer.document.document import robot_document
from p3dof.viewer.document.encoding import decoded, encoded
from p3dof.viewer.document.glb import KEYS, as_glb, motions_over, save_glb
from p3dof.viewer.document.motion import JointMotion
from p3dof.viewer.document.solids import surface_of
from p3dof.viewer.document.trees import placed_over, tree_of
from p3dof.viewer.machine.document import page_document

MODULES = ROOT / "page/node_modules"
NODE = shutil.which("node")
with_node = pytest.mark.skipif(
    NODE is None or not (MODULES / "gltf-validator").is_dir(), reason="no node, or no npm ci in page/"
)
SCRIPT = """
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { AnimationMixer, LoopOnce, Matrix4 } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
const [file, ...times] = process.argv.slice(2), bytes = new Uint8Array(readFileSync(file));
const { issues } = await createRequire(import.meta.url)("gltf-validator").validateBytes(bytes);
const { scene, animations } = await new GLTFLoader().parseAsync(bytes.buffer, "");
const names = JSON.parse(readFileSync(0, "utf8")), mixer = new AnimationMixer(scene), found = [];
const once = { loop: LoopOnce, clampWhenFinished: true };
for (const clip of animations) Object.assign(mixer.clipAction(clip), once).play();
for (const time of times.map(Number)) {
    mixer.setTime(time);
    scene.updateMatrixWorld(true);
    const back = new Matrix4().copy(scene.children[0].matrixWorld).invert();
    found.push(names.map((name) => back.clone().multiply(scene.getObjectByName(name).matrixWorld).elements));
}
const [root] = scene.children, up = root.matrixWorld.elements.slice(8, 11);
console.log(JSON.stringify({ issues, found, up, root: root.name }));
"""


@pytest.fixture(scope="module")
def paper():
    robot = p3dof.load()
    motion = p3dof.paper_motion(samples=121)
    return robot, page_document(robot, robot.inverse_dynamics(motion, method="compiled"))


def parts(content):
    """JSON and numbers of a file."""
    kind, version, length = struct.unpack_from("<4sII", content)
    assert (kind, version, length) == (b"glTF", 2, len(content))
    size, name = struct.unpack_from("<I4s", content, 12)
    assert name == b"JSON"
    binary, kind = struct.unpack_from("<I4s", content, 20 + size)
    assert (kind, 28 + size + binary) == (b"BIN\0", len(content))
    return json.loads(content[20 : 20 + size]), content[28 + size :]


def of_three(path, names, times):
    """What three's loader has at times (N,): placements (N, njoints, 4, 4), and what the validator says."""
    script = ROOT / "page/node_modules/.p3dof-glb.mjs"
    if not script.is_file() or script.read_text(encoding="utf-8") != SCRIPT:
        script.write_text(SCRIPT, encoding="utf-8")
    command = [NODE, script, path, *map(repr, map(float, times))]
    done = subprocess.run(command, input=json.dumps(names), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert [answer["issues"][kind] for kind in ("numErrors", "numWarnings")] == [0, 0], answer["issues"]
    np.testing.assert_allclose(answer["up"], [0.0, 1.0, 0.0], atol=1e-12)
    return np.array(answer["found"]).reshape(len(times), len(names), 4, 4).swapaxes(-1, -2), answer


def of_pinocchio(model, q):
    data, found = model.createData(), []
    for row in q:
        pin.forwardKinematics(model, data, row)
        found.append([data.oMi[i].homogeneous for i in range(1, model.njoints)])
    return np.array(found)


@with_node
def test_joints_are_where_pinocchio_has_them(paper, tmp_path):
    robot, document = paper
    path = save_glb(tmp_path / "paper.glb", document)
    q, time = (decoded(document["runs"][0][name]) for name in ("q", "time"))
    some = [0, 17, 60, 120]
    names = [str(name) for name in robot.model.names[1:]]
    found, answer = of_three(path, names, (time - time[0]).astype(np.float32)[some])
    expected = of_pinocchio(robot.model, q[some])
    assert answer["root"] == "p3dof"
    assert np.abs(found - expected)[:, :, :3, 3].max() <= 1e-8
    assert np.abs(found - expected)[:, :, :3, :3].max() <= 5e-8


@with_node
def test_a_robot_with_every_joint_and_meshes(tmp_path):
    pytest.importorskip("coal")
    example = pytest.importorskip("example_robot_data").load("solo12")
    robot = p3dof.ClosedLoopModel(example.model, p3dof.Sidecar.serial(example.model))
    steps = [np.cos(0.2 * k) * np.ones(example.model.nv) for k in range(9)]
    q = np.array([pin.integrate(example.model, example.q0, 0.3 * step) for step in steps])
    document = read(
        robot_document(robot, example.visual_model, JointMotion(np.arange(9.0), q), triangles=9000)
    )
    path = save_glb(tmp_path / "solo.glb", document)
    names = [str(name) for name in example.model.names[1:]]
    found, _ = of_three(path, names, [0.0, 3.0, 8.0])
    assert np.abs(found - of_pinocchio(example.model, q[[0, 3, 8]]))[:, :, :3, 3].max() <= 5e-8


def test_placements_of_every_kind_are_pinocchios():
    model, data = every_joint()
    q = np.array([pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)) for _ in range(6)])
    q[3] = np.nan
    run = {"q": encoded(q), "placed": placed_over(model, q)}
    joints = tree_of(model)
    found = motions_over({"scene": {"joints": joints}, "runs": [run]})
    assert np.isnan(found[3]).all()
    for sample in (0, 1, 2, 4, 5):
        pin.forwardKinematics(model, data, q[sample])
        expected = [data.liMi[i].homogeneous for i in range(1, model.njoints)]
        zero = [np.eye(4) if one["kind"] == "placed" else matrix(one["placement"]) for one in joints]
        places = [a @ matrix(b) for a, b in zip(zero, found[sample], strict=True)]
        np.testing.assert_allclose(places, expected, atol=1e-12)
    known = found[[0, 1, 2, 4, 5], :, 3:]
    assert np.einsum("nij,nij->ni", known[1:], known[:-1]).min() >= -1e-12


def test_what_does_not_change_has_no_track(paper):
    _, document = paper
    gltf, _ = parts(as_glb(document))
    names = [node["name"] for node in gltf["nodes"]]
    assert names[0] == "p3dof"
    (animation,) = gltf["animations"]
    tracks = {(names[c["target"]["node"]], c["target"]["path"]) for c in animation["channels"]}
    sliders = {("slide_a", "translation"), ("slide_b", "translation"), ("slide_c", "translation")}
    assert {track for track in tracks if track[1] == "translation"} == sliders
    assert ("hinge_platform", "rotation") in tracks
    assert not any(name.startswith("slide") for name, path in tracks if path == "rotation")
    assert len(as_glb(document)) < 250_000


def test_invalid_samples_and_long_runs():
    robot = p3dof.load()
    motion = p3dof.Motion.rest_to_rest([0.0, 0.0, 0.0], [0.52, 0.0, 0.0], 1.0, samples=4001)
    document = page_document(robot, robot.inverse_dynamics(motion, on_invalid="nan", method="compiled"))
    gltf, binary = parts(as_glb(document))
    accessor = gltf["accessors"][gltf["animations"][0]["samplers"][0]["input"]]
    assert accessor["count"] == KEYS
    view = gltf["bufferViews"][accessor["bufferView"]]
    time = np.frombuffer(binary, "<f4", accessor["count"], view["byteOffset"])
    assert (np.diff(time) > 0).all()
    assert accessor["max"] == [pytest.approx(time[-1])]
    valid = np.isfinite(decoded(document["runs"][0]["q"])).all(axis=1)
    assert time[-1] == pytest.approx(motion.time[valid][-1])
    still, _ = parts(as_glb(page_document(robot)))
    assert "animations" not in still


def test_trimesh_reads_the_scene(paper, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    robot, document = paper
    scene = trimesh.load_scene(save_glb(tmp_path / "paper.glb", document))
    drawn = {solid["name"] for solid in document["scene"]["solids"]}
    assert drawn <= set(scene.graph.nodes_geometry)
    transform, _ = scene.graph.get("P")
    at = placements(document, document["runs"][0], 0)[robot.model.getJointId("hinge_platform") - 1]
    x, y, z = at[:3, :3] @ [robot.parameters.geometry.r, 0.0, 0.0] + at[:3, 3]
    np.testing.assert_allclose(transform[:3, 3], [x, z, -y], atol=1e-7)  # y is up


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        ({"kind": "box", "size": [1.0, 2.0, 3.0]}, 6.0),
        ({"kind": "sphere", "radius": 0.5}, np.pi / 6),
        ({"kind": "cylinder", "radius": 0.5, "length": 2.0}, np.pi / 2),
        ({"kind": "capsule", "radius": 0.5, "length": 2.0}, np.pi / 2 + np.pi / 6),
    ],
)
def test_surfaces_are_closed_and_face_outward(shape, volume):
    corners, normals, faces = surface_of(shape)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)
    assert np.linalg.norm(areas, axis=1).min() > 1e-6
    found = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert 0.96 * volume < found <= volume * (1 + 1e-12)
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-12)  # closed
    if normals is not None:
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
        unit = areas / np.linalg.norm(areas, axis=1, keepdims=True)
        assert min(np.einsum("ij,ij->i", normals[faces[:, k]], unit).min() for k in range(3)) > 0.9


def test_on_the_command_line(capsys, tmp_path):
    status, told, _ = run(capsys, "export", "--format", "glb", "--out", str(tmp_path / "machine"))
    assert (status, "p3dof.glb" in told) == (0, True)
    names = {node["name"] for node in parts((tmp_path / "machine/p3dof.glb").read_bytes())[0]["nodes"]}
    assert {"slide_a", "platform", "rail_c"} <= names
    five_bar = str(ROOT / "docs/_static/gallery/five_bar.urdf")
    assert run(capsys, "loop", "export", five_bar, "--out", str(tmp_path / "five_bar.glb"))[0] == 0
    gltf, _ = parts((tmp_path / "five_bar.glb").read_bytes())
    assert {str(name) for name in p3dof.load_robot(five_bar).model.names[1:]} <= {
        n["name"] for n in gltf["nodes"]
    }
    for arguments in (
        ("export", "--format", "glb", "--format", "urdf"),
        ("export", "--format", "glb", "--check"),
        ("export", "--motion", "m.csv"),
        ("loop", "export", five_bar, "--out", str(tmp_path / "x.urdf"), "--motion", "m.csv"),
        ("loop", "export", five_bar, "--out", str(tmp_path / "x.urdf"), "--format", "glb"),
    ):
        status, _, error = run(capsys, *arguments)
        assert status == 2, arguments
        assert "error" in error.lower()


def test_bad_arguments_are_named(paper, tmp_path):
    for number in (1, -1, True, "first"):
        with pytest.raises(InputError, match="run: expected a number from 0 to 0"):
            as_glb(paper[1], number)
    with pytest.raises(InputError, match=r"ends in \.glb"):
        save_glb(tmp_path / "scene.gltf", paper[1])
