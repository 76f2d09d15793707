"""The shapes of a robot's own file in the viewer: found in given folders only, drawn where they belong."""

from __future__ import annotations

import base64
import os
import random
import re
import sys

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest

import p3dof
from p3dof._base.errors import FileError, InputError

pytest.importorskip("meshcat", reason="meshcat is not installed")
pytest.importorskip("yourdfpy", reason="yourdfpy is not installed")
pytest.importorskip("trimesh", reason="trimesh is not installed")
import trimesh
from browser import opened
from documents import ROOT

from p3dof.viewer import JointMotion
from p3dof.viewer.document import meshes
from p3dof.viewer.document.document import robot_document
from p3dof.viewer.document.figure import RobotFigure
from p3dof.viewer.document.meshes import MeshFiles
from p3dof.viewer.headless import as_image

SHAPES = {
    "base": '<visual><geometry><box size="0.6 0.1 0.02"/></geometry><material name="dark"/></visual>',
    "crank": '<visual><origin xyz="0.1 0 0" rpy="0 1.5707963267948966 0"/><geometry>'
    '<cylinder radius="0.01" length="0.2"/></geometry></visual>',
    "coupler": '<visual><origin xyz="0.2 0 0"/><geometry><mesh filename="package://four/bar.stl" '
    'scale="0.45 0.02 0.02"/></geometry><material name="red"><color rgba="1 0 0 1"/></material></visual>',
    "rocker": '<visual><geometry><sphere radius="0.03"/></geometry></visual>',
}


def with_shapes(**changed):
    """A four-bar whose links have shapes."""
    text = robots.four_bar(*robots.FOUR_BAR)
    for link, shape in (SHAPES | changed).items():
        if f'<link name="{link}"/>' in text:
            text = text.replace(f'<link name="{link}"/>', f'<link name="{link}">{shape}</link>')
        else:
            text = text.replace(f'<link name="{link}">', f'<link name="{link}">{shape}', 1)
    return text.replace("</robot>", '<material name="dark"><color rgba="0 0 0.2 1"/></material></robot>')


@pytest.fixture
def folder(tmp_path):
    """A robot's file, a package beside it, and a secret outside."""
    inside = tmp_path / "robot"
    (inside / "four").mkdir(parents=True)
    (inside / "four_bar.urdf").write_text(with_shapes(), encoding="utf-8")
    trimesh.creation.box((1, 1, 1)).export(inside / "four/bar.stl")
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "secret.stl")
    return inside


def loop_of(text):
    return p3dof.ClosedLoopModel.from_urdf(text, robots.FOUR_BAR_SIDECAR)


def figure_of(path, **options):
    return RobotFigure(loop_of(path), path, **options)


def named(figure):
    return [s for s in figure.visual_model.geometryObjects if s.name not in figure.sticks]


def test_shapes_are_where_the_file_has_them(folder):
    path = folder / "four_bar.urdf"
    figure = figure_of(path)
    assert figure.notes == ()
    assert figure.usual == {"sticks": False}
    kinds = [type(solid.geometry).__name__ for solid in named(figure)]
    assert kinds == ["Box", "Cylinder", "Box", "Sphere"]
    q = robots.four_bar_q(0.7, *robots.FOUR_BAR)
    loop = loop_of(path)
    document = robot_document(loop, figure, JointMotion([0.0], [q]))
    data = loop.model.createData()
    pin.framesForwardKinematics(loop.model, data, q)
    mesh = named(figure)[2]
    place = data.oMf[loop.model.getFrameId("coupler", pin.FrameType.BODY)] * pin.SE3(
        np.eye(3), np.array([0.2, 0, 0])
    )
    solid = next(one for one in document["scene"]["solids"] if one["name"] == mesh.name)
    x, y, z, *turn = solid["placement"]
    own = pin.SE3(pin.Quaternion(np.array(turn)).matrix(), np.array([x, y, z]))
    pin.forwardKinematics(loop.model, data, q)
    drawn = data.oMi[solid["joint"] + 1] * own
    np.testing.assert_allclose(drawn.homogeneous, place.homogeneous, rtol=0, atol=1e-12)
    low, high = figure.skins[mesh.name].box
    np.testing.assert_allclose(high - low, [0.45, 0.02, 0.02], atol=1e-7)
    np.testing.assert_array_equal(figure.skins[mesh.name].colours, np.tile([1.0, 0.0, 0.0], (12, 1)))
    np.testing.assert_allclose(named(figure)[0].meshColor, [0, 0, 0.2, 1])
    shown = {layer["name"]: layer["shown"] for layer in document["scene"]["layers"]}
    assert shown == {"shapes": True, "sticks": False, "multipliers": True}


@pytest.mark.parametrize(
    "name",
    [
        "../secret.stl",
        "four/../../secret.stl",
        "{top}/secret.stl",
        "file://{top}/secret.stl",
        "package://../secret.stl",
        "package://four/../../secret.stl",
        "package:///etc/secret.stl",
        "http://127.0.0.1/secret.stl",
        "https://example.org/secret.stl",
        "C:\\secret.stl",
        "four\\bar.stl",
        "link.stl",
        "linked/secret.stl",
        "ring.stl",
        "pipe.stl",
        "folder.stl",
        "bar\0.stl",
        "a" * 5000 + ".stl",
        "four/bar.txt",
        "",
        "package://",
        "package://other/bar.stl",
    ],
)
def test_nothing_outside_of_the_folders_is_opened(folder, name, monkeypatch):
    top = folder.parent
    (folder / "link.stl").symlink_to(top / "secret.stl")
    (folder / "linked").symlink_to(top)
    (folder / "ring.stl").symlink_to(folder / "ring.stl")
    (folder / "folder.stl").mkdir()
    os.mkfifo(folder / "pipe.stl")
    monkeypatch.setattr(meshes, "read_bytes", lambda *_: pytest.fail("something is opened"))
    with pytest.raises(FileError) as caught:
        MeshFiles(folder).read(name.format(top=top), None)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_given_folders_are_looked_in(folder):
    top, files = folder.parent, MeshFiles(folder)
    inside = folder / "four/bar.stl"
    for name in (
        "package://four/bar.stl",
        "package:///four/bar.stl",
        "four/bar.stl",
        "./four/bar.stl",
        "four/../four/bar.stl",
    ):
        assert files.find(name) == inside.resolve()
    (folder / "alias.stl").symlink_to(inside)
    assert files.find("alias.stl") == inside.resolve()
    for given in (top, [str(top)]):
        more = MeshFiles(folder, given)
        assert more.find("secret.stl") == (top / "secret.stl").resolve()
        assert more.find("../secret.stl") == (top / "secret.stl").resolve()
        assert more.find("package://robot/four/bar.stl") == inside.resolve()
    assert MeshFiles(None, [folder / "four"]).find("package://four/bar.stl") == inside.resolve()
    with pytest.raises(InputError, match="package_dirs: expected folders"):
        MeshFiles(folder, [folder / "nowhere"])


def test_what_is_missing_is_told_in_a_line_and_rods_are_shown(folder):
    (folder / "four/bar.stl").unlink()
    figure = figure_of(folder / "four_bar.urdf")
    assert figure.notes == ("1 shape is not shown: package://four/bar.stl: not in the folders given",)
    assert figure.usual == {"sticks": True}
    assert len(named(figure)) == 3


def test_without_the_libraries_there_are_rods(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    assert "pip install 'p3dof[shapes]'" in figure_of(folder / "four_bar.urdf").notes[0]
    monkeypatch.setitem(sys.modules, "yourdfpy", None)
    figure = figure_of(folder / "four_bar.urdf")
    assert figure.notes[0].startswith("rods are drawn: shapes of a URDF need yourdfpy")
    assert named(figure) == []


@pytest.mark.parametrize(
    ("visual", "words"),
    [
        ("<visual/>", "base: "),
        ('<visual><geometry><box size="1 2"/></geometry></visual>', "base: a shape that is not understood"),
        ('<visual><geometry><box size="a b c"/></geometry></visual>', "base: yourdfpy cannot read its shape"),
        ("<visual><geometry><cylinder/></geometry></visual>", "base: yourdfpy cannot read its shape"),
        ('<visual><geometry><sphere radius="-1"/></geometry></visual>', "a sphere without size"),
        (
            '<visual><geometry><sphere radius="nan"/></geometry></visual>',
            "base: a shape that is not understood",
        ),
        ("<visual><geometry><torus/></geometry></visual>", "base: yourdfpy cannot read its shape"),
    ],
)
def test_a_shape_that_is_none_is_told_and_the_others_are_shown(folder, visual, words):
    (folder / "bad.urdf").write_text(with_shapes(base=visual), encoding="utf-8")
    figure = figure_of(folder / "bad.urdf")
    assert len(figure.notes) == 1
    assert words in figure.notes[0]
    assert len(named(figure)) == 3


def test_broken_shapes_are_told_or_one_clear_error():
    text, rng = with_shapes(), random.Random(3)  # noqa: S311 - no secret
    words = (
        "nan",
        "inf",
        "1e300",
        "-1",
        "0",
        "",
        "x",
        "1 2",
        "1 2 3 4",
        "0x10",
        "1_0",
        "1e29 1e29 1e29",
        "../x.stl",
    )
    shapes, told, refused = re.findall("<visual>.*?</visual>", text, re.DOTALL), 0, 0
    for _ in range(60):
        shape = rng.choice(shapes)
        part = rng.choice(re.findall(r'[a-z]+="[^"]*"', shape))
        name = part.partition("=")[0]
        bad = text.replace(shape, shape.replace(part, rng.choice((f'{name}="{rng.choice(words)}"', ""))))
        try:
            told += len(RobotFigure(loop_of(bad), bad).notes)
        except p3dof.P3dofError as error:
            refused += "\n" not in str(error)
    assert told > 30
    assert refused > 0


BAD = {
    "no mesh at all": b"solid",
    "empty": b"",
    "a count of triangles without them": b"\0" * 80 + b"\xff\xff\xff\x7f",
    "numbers that are none": b"solid x\nfacet normal 0 0 1\nouter loop\n"
    + b"vertex nan 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid",
}


@pytest.mark.parametrize("content", BAD.values(), ids=BAD)
def test_a_mesh_that_is_none_is_told(folder, content):
    (folder / "four/bar.stl").write_bytes(content)
    figure = figure_of(folder / "four_bar.urdf")
    assert len(figure.notes) == 1
    assert figure.notes[0].startswith("1 shape is not shown: package://four/bar.stl: ")
    assert "\n" not in figure.notes[0]


COLLADA = '<?xml version="1.0" encoding="{}"?>{}<COLLADA version="1.4.1"><asset/>{}</COLLADA>'
HOSTILE = {
    "entities": ("utf-8", '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>', "", "document type"),
    "another encoding": ("utf-7", "", "", "expected UTF-8, got 'utf-7'"),
    "nodes used again": ("utf-8", "", "<instance_node/>" * 3, "instance_node"),
    "many copies": ("utf-8", "", "<instance_geometry/>" * 50_000, "too large"),
}


@pytest.mark.parametrize(("encoding", "head", "body", "words"), HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_collada_file_is_refused(folder, encoding, head, body, words):
    (folder / "bar.dae").write_text(COLLADA.format(encoding, head, body))
    with pytest.raises(p3dof.P3dofError, match=words):
        MeshFiles(folder).read("bar.dae", None)


def test_meshes_are_bounded(folder, monkeypatch):
    monkeypatch.setattr(meshes, "MAX_FACES", 30)
    files = MeshFiles(folder)
    files.read("four/bar.stl", None)
    files.read("four/bar.stl", None)
    with pytest.raises(FileError, match="at most 30 triangles in all"):
        files.read("four/bar.stl", None)
    monkeypatch.setattr(meshes, "MAX_MESHES", 100)
    (folder / "four/no.stl").write_bytes(b"x" * 200)
    files = MeshFiles(folder)
    for words in ("expected triangles", "at most 100 bytes in all meshes"):
        with pytest.raises(FileError, match=words):
            files.read("four/no.stl", None)
    monkeypatch.setattr(meshes, "MAX_MESH", 100)
    with pytest.raises(FileError, match="expected at most 100 bytes"):
        MeshFiles(folder).read("four/bar.stl", None)


def test_materials_of_a_mesh_are_not_looked_for(folder):
    (folder / "four/bar.obj").write_text(
        "mtllib ../../secret.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl x\nf 1 2 3\n", encoding="utf-8"
    )
    opened_files, watching = [], [True]

    def hook(event, arguments):  # it cannot be taken away again
        if watching and event == "open":
            opened_files.append(arguments[0])

    sys.addaudithook(hook)
    MeshFiles(folder).read("four/bar.obj", None)
    watching.clear()
    assert any(str(path).endswith("bar.obj") for path in opened_files)
    assert not [path for path in opened_files if "secret" in str(path)]


def test_primitive_shapes_of_an_mjcf():
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    text = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
      <body name="arm" pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
        <geom type="capsule" size=".03 .2" pos="0 0 -.2" rgba="1 0 0 1"/>
        <geom type="box" size=".1 .2 .3" group="3"/><geom type="ellipsoid" size=".1 .2 .3"/></body>
    </worldbody></mujoco>"""
    loop = p3dof.load_robot(text)
    figure = RobotFigure(loop, text)
    capsule, ellipsoid = named(figure)
    assert capsule.parentJoint == loop.model.getJointId("hinge")
    np.testing.assert_allclose(capsule.placement.translation, [0, 0, -0.2], atol=1e-12)
    assert (capsule.geometry.radius, 2 * capsule.geometry.halfLength) == (0.03, 0.4)
    np.testing.assert_allclose(ellipsoid.geometry.radii, [0.1, 0.2, 0.3])


def test_shapes_of_an_sdf_are_those_of_the_urdf():
    """Of the machine, which is written as both: all of its solids, with their places and colours at home."""
    drawn = []
    for ending in ("urdf", "sdf"):
        loop = p3dof.load_robot(ROOT / f"urdf/p3dof.{ending}")
        figure = RobotFigure(loop, ROOT / f"urdf/p3dof.{ending}")
        assert (figure.notes, figure.usual) == ((), {"sticks": False})
        data = loop.model.createData()
        pin.forwardKinematics(loop.model, data, loop.assemble().q)
        rows = []
        for solid in named(figure):
            place = (data.oMi[solid.parentJoint] * solid.placement).homogeneous
            solid.geometry.computeLocalAABB()
            rows.append([*place[:3].ravel(), solid.geometry.aabb_radius, *solid.meshColor])
        drawn.append(np.array(rows))
    assert len(drawn[0]) > 20
    near = np.abs(drawn[0][:, None] - drawn[1][None]).max(axis=2)
    assert near.min(axis=0).max() < 1e-9
    assert near.min(axis=1).max() < 1e-9


def test_meshes_of_an_sdf_are_found_by_their_model_and_beside_included_files(folder):
    mesh = "<visual name='v'><geometry><mesh><uri>{}</uri><scale>1 2 3</scale></mesh></geometry></visual>"
    one, other = (mesh.format(uri) for uri in ("model://four/bar.stl", "bar.stl"))
    link = "<sdf version='1.9'><model name='{0}'><link name='{0}'>{1}</link>{2}</model></sdf>"
    (folder / "four/model.sdf").write_text(link.format("inner", other, ""), encoding="utf-8")
    include = "<include><uri>four</uri></include>"
    (folder / "outer.sdf").write_text(link.format("outer", one, include), encoding="utf-8")
    loop = p3dof.load_robot(folder / "outer.sdf")
    figure = RobotFigure(loop, folder / "outer.sdf")
    assert figure.notes == ()
    assert len(named(figure)) == 2
    for solid in named(figure):
        np.testing.assert_array_equal(2 * solid.geometry.halfSide, [1, 2, 3])
    (folder / "below").mkdir()
    below = folder / "below/outer.sdf"
    below.write_text(link.format("outer", one, include.replace("four", "../four")), encoding="utf-8")
    loop = p3dof.load_robot(below, include_root=folder)
    assert len(named(RobotFigure(loop, below, [folder]))) == 2
    (note,) = RobotFigure(loop, below).notes
    assert "is no file below the folder" in note
    outside = link.format("outer", mesh.format("../secret.stl"), "")
    below.write_text(outside, encoding="utf-8")
    (note,) = RobotFigure(p3dof.load_robot(below), below).notes
    assert note == "1 shape is not shown: ../secret.stl: outside of the folders given"


def test_a_mesh_is_seen_in_the_page_and_can_be_hidden(folder, browser):
    path = folder / "four_bar.urdf"
    loop, q = loop_of(path), robots.four_bar_q(0.7, *robots.FOUR_BAR)
    ready = "!!window.p3dof && p3dof.ready.then(() => true)"
    with (
        p3dof.show_robot(loop, JointMotion([0.0], [q]), shapes=path, port=0) as live,
        opened(browser, live.url, 800, 500, ready) as watched,
    ):
        watched.see()
        shown = red(watched)
        assert shown > 50
        watched.page.uncheck("#layers input[name=shapes]")
        watched.wait("p3dof.state.layers.shapes === false")
        assert not watched.page.is_checked("#layers input[name=sticks]")
        assert red(watched) < shown / 10
        watched.healthy()


def red(watched):
    """How many pixels are of the mesh's colour."""
    png = base64.b64decode(watched.page.evaluate("() => p3dof.state.stage.picture().split(',')[1]"))
    picture = np.asarray(as_image(png)).astype(int)
    return int(((picture[..., 0] > 80) & (picture[..., 1] < 60) & (picture[..., 2] < 60)).sum())
