"""libsdformat 12, by which Gazebo reads models: `<include><uri>/folder/p3dof.sdf</uri></include>` in a world.

Debian has the library without Python bindings: a small C++ program is compiled against it and prints what it
finds, in columns.
"""

import os
import shutil
import subprocess
import sys
from collections import defaultdict
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
import sdf_texts as texts
from reference import FILES, LINKS, MECHANISM, MOVING, URDF, placements

import p3dof
from p3dof._base.errors import ModelError
from p3dof.machine import description
from p3dof.machine.description import Box, Cylinder, Mechanism
from p3dof.machine.description.sdf_text import sdf
from p3dof.machine.parameters import PAPER, SOLIDS, Geometry, of_solids

SDF = FILES / "p3dof.sdf"
MARKERS = set(MECHANISM.markers)
CLOSURES = {closure.name: closure for closure in MECHANISM.closures}

PROGRAM = r"""
#include <iomanip>
#include <iostream>
#include <ignition/math/Pose3.hh>
#include <sdf/sdf.hh>

using ignition::math::Pose3d;
using ignition::math::Vector3d;

static int failures = 0;

static void check(const sdf::Errors &_errors)
{
  for (const auto &error : _errors)
  {
    ++failures;
    std::cout << "error\t" << error << "\n";
  }
}

template <typename V> static std::ostream &vector(std::ostream &_out, const V &_v)
{
  return _out << "\t" << _v.X() << "\t" << _v.Y() << "\t" << _v.Z();
}

static void pose(const Pose3d &_pose)
{
  vector(std::cout, _pose.Pos());
  std::cout << "\t" << _pose.Rot().W();
  vector(std::cout, _pose.Rot());
}

template <typename Solid> static void solid(const char *_kind, const sdf::Link &_link, const Solid &_solid)
{
  Pose3d at;
  check(_solid.SemanticPose().Resolve(at, _link.Name()));
  std::cout << _kind << "\t" << _link.Name() << "\t" << _solid.Name();
  const auto &shape = *_solid.Geom();
  Vector3d size;
  if (shape.BoxShape()) size = shape.BoxShape()->Size();
  if (shape.CylinderShape()) size = {shape.CylinderShape()->Radius(), shape.CylinderShape()->Length(), 0};
  if (shape.SphereShape()) size = {shape.SphereShape()->Radius(), 0, 0};
  vector(std::cout, size);
  pose(at);
}

static void contents(const sdf::Model &_model, const std::string &_prefix, const Pose3d &_outer)
{
  const sdf::Model *model = &_model;
  for (uint64_t i = 0; i < model->LinkCount(); ++i)
  {
    const sdf::Link &link = *model->LinkByIndex(i);
    Pose3d at;
    check(link.SemanticPose().Resolve(at, "__model__"));
    const auto &inertial = link.Inertial();
    const auto moments = inertial.Moi();  // in the axes of the link
    std::cout << "link\t" << _prefix << link.Name() << "\t" << inertial.MassMatrix().Mass();
    vector(std::cout, inertial.Pose().Pos());
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column) std::cout << "\t" << moments(row, column);
    pose(_outer * at);
    std::cout << "\n";
    for (uint64_t k = 0; k < link.VisualCount(); ++k)
    {
      solid("visual", link, *link.VisualByIndex(k));
      const sdf::Material *material = link.VisualByIndex(k)->Material();
      auto colour = material ? material->Diffuse() : ignition::math::Color(-1, -1, -1, -1);
      for (int part = 0; part < 4; ++part) std::cout << "\t" << colour[part];
      std::cout << "\n";
    }
    for (uint64_t k = 0; k < link.CollisionCount(); ++k)
    {
      solid("collision", link, *link.CollisionByIndex(k));
      std::cout << "\n";
    }
  }
  for (uint64_t i = 0; i < model->FrameCount(); ++i)
  {
    const sdf::Frame &frame = *model->FrameByIndex(i);
    Pose3d at;
    check(frame.SemanticPose().Resolve(at, "__model__"));
    std::string body;
    check(frame.ResolveAttachedToBody(body));
    std::cout << "frame\t" << _prefix << frame.Name() << "\t" << body;
    pose(_outer * at);
    std::cout << "\n";
  }
  for (uint64_t i = 0; i < model->JointCount(); ++i)
  {
    const sdf::Joint &joint = *model->JointByIndex(i);
    std::string parent, child;
    check(joint.ResolveParentLink(parent));
    check(joint.ResolveChildLink(child));
    Pose3d at;
    check(joint.SemanticPose().Resolve(at, "__model__"));
    std::cout << "joint\t" << _prefix << joint.Name() << "\t" << static_cast<int>(joint.Type()) << "\t"
              << joint.ParentLinkName() << "\t" << joint.ChildLinkName() << "\t" << parent << "\t" << child;
    pose(_outer * at);
    if (const sdf::JointAxis *axis = joint.Axis())
    {
      Vector3d direction;
      check(axis->ResolveXyz(direction, "__model__"));
      vector(std::cout, _outer.Rot() * direction);
      for (double value : {axis->Lower(), axis->Upper(), axis->Effort(), axis->MaxVelocity(), axis->Damping(),
                           axis->Friction()})
        std::cout << "\t" << value;
    }
    std::cout << "\n";
  }
  for (uint64_t i = 0; i < model->ModelCount(); ++i)
  {
    const sdf::Model &inner = *model->ModelByIndex(i);
    Pose3d at;
    check(inner.SemanticPose().Resolve(at, "__model__"));
    contents(inner, _prefix + inner.Name() + "::", _outer * at);
  }
}

int main(int, char **_arguments)
{
  sdf::Root root;
  check(root.Load(_arguments[1]));
  std::cout << std::setprecision(17);
  const sdf::Model *model = root.Model();
  if (!model) return 1;
  if (!(sdf::checkCanonicalLinkNames(&root) && sdf::checkFrameAttachedToNames(&root)
        && sdf::checkFrameAttachedToGraph(&root) && sdf::checkPoseRelativeToGraph(&root)
        && sdf::recursiveSameTypeUniqueNames(root.Element())
        && sdf::recursiveSiblingUniqueNames(root.Element())
        && sdf::recursiveSiblingNoDoubleColonInNames(root.Element())))
    std::cout << "error\ta check of gz sdf --check failed\n";
  sdf::Errors ends;
  sdf::checkJointParentChildNames(&root, ends);
  check(ends);
  std::cout << "model\t" << model->Name() << "\t" << root.Version() << "\t" << model->CanonicalLinkName()
            << "\n";
  contents(*model, "", Pose3d::Zero);
  return failures;
}
"""

KINDS = {"ball": 1, "fixed": 3, "prismatic": 5, "revolute": 6}
"""sdf::JointType."""


@pytest.fixture(scope="session")
def reader(tmp_path_factory):
    """Return a function that reads a file with libsdformat: rows of text by kind, and what is on stderr."""
    for tool in ("g++", "pkg-config"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} not installed: apt-get install libsdformat-dev pkg-config g++")
    flags = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "sdformat12"], capture_output=True, text=True, check=False
    )
    if flags.returncode:
        pytest.skip("libsdformat 12 not installed: apt-get install libsdformat-dev")
    folder = tmp_path_factory.mktemp("sdformat")
    (folder / "reader.cc").write_text(PROGRAM, "utf-8")
    program = folder / "reader"
    command = ["g++", "-O0", str(folder / "reader.cc"), "-o", str(program), *flags.stdout.split()]
    subprocess.run(command, check=True, timeout=300)

    def read(path):
        environment = os.environ | {
            "HOME": str(folder),
            "SDF_PATH": str(path.parent),
        }  # it writes a log at home
        run = subprocess.run(
            [str(program), str(path)], capture_output=True, env=environment, timeout=60, check=False
        )
        rows = defaultdict(list)
        for line in run.stdout.decode().splitlines():
            kind, *cells = line.split("\t")
            rows[kind].append(cells)
        rows["error"] += [[line] for line in run.stderr.decode().splitlines()]
        return rows

    return read


@pytest.fixture(scope="session")
def found(reader):
    return reader(SDF)


@pytest.fixture(scope="session")
def converted(reader):
    return reader(URDF)


def _floats(cells):
    return np.array([float(cell) for cell in cells])


def _placement(cells):
    numbers = _floats(cells)
    w, x, y, z = numbers[3:]
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), numbers[:3]).homogeneous


def _home():
    return placements(dict.fromkeys(MOVING, 0.0))


def _assert_links(rows):
    """Assert bodies and places: those of Pinocchio's joints, to which it adds what is fixed to them."""
    tree = pin.buildModelFromUrdf(str(URDF))
    expected = {MOVING[name].child: tree.inertias[i] for i, name in enumerate(tree.names) if i}
    home = _home()
    links = {name: cells for name, *cells in rows["link"]}
    assert list(links) == [name for name in LINKS if name not in MARKERS]
    for name, cells in links.items():
        numbers = _floats(cells[:13])
        mass, com, inertia = numbers[0], numbers[1:4], numbers[4:].reshape(3, 3)
        body = LINKS[name].body
        want = expected.get(name, pin.Inertia(body.mass, body.com, body.inertia))
        assert mass == pytest.approx(want.mass, rel=1e-13), name
        np.testing.assert_allclose(com, want.lever, rtol=0, atol=1e-13, err_msg=name)
        size = np.abs(want.inertia).max()
        np.testing.assert_allclose(inertia, want.inertia, rtol=0, atol=1e-12 * size, err_msg=name)
        np.testing.assert_allclose(_placement(cells[13:]), home[name], rtol=0, atol=1e-12, err_msg=name)
    total = sum(float(cells[0]) for cells in links.values())
    assert total == pytest.approx(MECHANISM.mass + LINKS["base_link"].body.mass, rel=1e-14)


def _assert_tree(rows):
    """Assert names, ends, axes and limits of the joints of the tree; return the rows of the others."""
    joints = {name: cells for name, *cells in rows["joint"]}
    home = _home()
    for name, joint in MOVING.items():
        kind, parent, child, parent_link, child_link, *numbers = joints.pop(name)
        assert int(kind) == KINDS[joint.kind]
        assert (parent, child) == (parent_link, child_link) == (joint.parent, joint.child)
        np.testing.assert_allclose(_placement(numbers[:7]), home[joint.child], rtol=0, atol=1e-12)
        axis = home[joint.child][:3, :3] @ joint.axis
        np.testing.assert_allclose(_floats(numbers[7:10]), axis, rtol=0, atol=1e-12)
        limits = joint.limits
        given = [limits.lower, limits.upper, limits.effort, limits.velocity, 0, 0]  # no damping, no friction
        np.testing.assert_allclose(_floats(numbers[10:]), given, rtol=1e-14)
    return joints


def test_it_loads_without_error_or_warning(found):
    assert found["error"] == []
    assert found["model"] == [["p3dof", "1.9", "base_link"]]


def test_every_link_weighs_and_stands_as_it_should(found):
    _assert_links(found)


def test_joints_have_the_same_names_axes_and_limits(found):
    others = _assert_tree(found)
    assert sorted(others) == sorted(["base_link_fixed", *CLOSURES])
    kind, parent, child, *_ = others["base_link_fixed"]
    assert (int(kind), parent, child) == (KINDS["fixed"], "world", "base_link")


def test_loops_are_joints_that_close_at_home(found):
    joints = {name: cells for name, *cells in found["joint"]}
    home = _home()
    carriers = {name: joint.parent for name, joint in MECHANISM.markers.items()}
    for name, closure in CLOSURES.items():
        kind, parent, child, parent_link, child_link, *numbers = joints[name]
        assert int(kind) == KINDS["ball"]
        assert (parent, child) == (closure.frame1, closure.frame2)
        assert (parent_link, child_link) == (carriers[parent], carriers[child])
        place = _placement(numbers)[:3, 3]
        for frame in (parent, child):
            np.testing.assert_allclose(place, home[frame][:3, 3], rtol=0, atol=1e-12)
    # Three of the children have two parents: the graph has one joint more than a tree for each loop.
    children = [cells[5] for cells in found["joint"]]
    assert len(children) == len(found["link"]) + len(CLOSURES)
    assert {name: children.count(name) for name in children if children.count(name) > 1} == {
        "platform": 3,
        "crossbar_lower": 2,
    }


def test_markers_are_frames(found):
    home = _home()
    frames = {name: cells for name, *cells in found["frame"]}
    assert set(frames) == MARKERS
    for name, (body, *numbers) in frames.items():
        assert body == MECHANISM.markers[name].parent
        np.testing.assert_allclose(_placement(numbers), home[name], rtol=0, atol=1e-12)


def test_every_solid_is_there_in_its_colour(found):
    for kind, attribute in (("visual", "visuals"), ("collision", "collisions")):
        rows = iter(found[kind])
        for link in LINKS.values():
            for solid in getattr(link, attribute):
                owner, _, *numbers = next(rows)
                assert owner == link.name
                shape = solid.shape
                size = (
                    shape.size
                    if isinstance(shape, Box)
                    else (shape.radius, shape.length, 0)
                    if isinstance(shape, Cylinder)
                    else (shape.radius, 0, 0)
                )
                np.testing.assert_allclose(_floats(numbers[:3]), size, rtol=1e-14)
                at = _placement(numbers[3:10])
                np.testing.assert_allclose(at[:3, :3], solid.placement.rotation, rtol=0, atol=1e-12)
                np.testing.assert_allclose(at[:3, 3], solid.placement.position, rtol=0, atol=1e-14)
                if kind == "visual":
                    np.testing.assert_allclose(_floats(numbers[10:]), solid.colour.rgba, atol=1e-7)  # float
        assert next(rows, None) is None


# -- the URDF, which libsdformat converts ------------------------------------------------------------------


def test_of_the_urdf_links_and_masses_survive(converted):
    """Markers and their joints are lumped into what carries them; <mimic> and the loops are lost."""
    assert converted["error"] == []
    _assert_links(converted)
    assert _assert_tree(converted) == {}
    assert converted["frame"] == []
    for kind in ("visual", "collision"):
        assert len(converted[kind]) == sum(len(getattr(link, f"{kind}s")) for link in LINKS.values())


# -- other machines, other names ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parameters",
    [SOLIDS, of_solids(Geometry(0.01, 0.025, 0.04, 0.005)), of_solids(Geometry(0.3, 0.75, 1.2, 0.15))],
    ids=["solids", "a tenth", "threefold"],
)
def test_other_machines_load(reader, tmp_path, parameters):
    description.write(parameters, tmp_path / "a folder ü", ("sdf",))
    rows = reader(tmp_path / "a folder ü" / "p3dof.sdf")
    assert rows["error"] == []
    assert len(rows["joint"]) == len(MOVING) + 1 + len(CLOSURES)
    mechanism = description.with_masses(description.describe(parameters))
    moving = sum(float(cells[1]) for cells in rows["link"][1:])
    assert moving == pytest.approx(mechanism.mass, rel=1e-13)


def _renamed(old: str, new: str) -> Mechanism:
    """Return the mechanism with another name of a link, and of what is named after it."""
    joints = (
        replace(joint, parent=joint.parent.replace(old, new), child=joint.child.replace(old, new))
        for joint in MECHANISM.joints
    )
    closures = (
        replace(closure, frame1=closure.frame1.replace(old, new), frame2=closure.frame2.replace(old, new))
        for closure in MECHANISM.closures
    )
    links = (replace(link, name=link.name.replace(old, new)) for link in MECHANISM.links)
    return replace(MECHANISM, links=tuple(links), joints=tuple(joints), closures=tuple(closures))


def test_names_are_escaped(reader, tmp_path):
    odd = "<a & \"b\" 'c'>: é --"
    mechanism = replace(_renamed("leg_a", odd), name=odd)
    path = tmp_path / "odd.sdf"
    path.write_text(sdf(mechanism), "utf-8")
    rows = reader(path)
    assert rows["error"] == []
    assert rows["model"][0][0] == odd
    assert odd in [cells[0] for cells in rows["link"]]
    assert f"{odd}_tip" in [cells[0] for cells in rows["frame"]]
    assert ["loop_a", "1", f"{odd}_tip", "platform_a", odd, "platform"] in [c[:6] for c in rows["joint"]]


@pytest.mark.parametrize("name", ["world", "a::b", "__root__"])
def test_reserved_names_are_refused(name):
    with pytest.raises(ModelError, match=f"'{name}' is reserved"):
        sdf(_renamed("platform_center", name))


def test_names_that_are_used_twice_are_refused():
    with pytest.raises(ModelError, match="'slide_a' is there twice"):
        sdf(_renamed("platform_center", "slide_a"))


def test_links_without_a_mass_are_refused():
    with pytest.raises(ModelError, match="expected a mass of every link, got none of 'base_link'"):
        sdf(description.describe(PAPER))


def test_gravity_is_left_to_the_world():
    root = ET.parse(SDF).getroot()  # noqa: S314 - our own file
    assert root.find("world") is None
    assert [element.tag for element in root.iter() if "gravity" in element.tag] == []


def test_files_are_the_same_bytes_in_every_run():
    code = (
        "import sys; from p3dof.machine import description as d; from p3dof.machine.parameters import PAPER; "
        "sys.stdout.buffer.write(''.join(d.texts(PAPER, ('drake', 'sdf')).values()).encode())"
    )
    texts = "".join(description.texts(PAPER, ("drake", "sdf")).values()).encode()
    for seed in ("1", "2"):
        environment = os.environ | {"PYTHONHASHSEED": seed}
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, env=environment, check=True)
        assert run.stdout == texts


def test_a_light_link_with_solids_stays_a_link(reader, tmp_path):
    """Only what is no more than a frame becomes one."""
    solids = LINKS["slider_a"].visuals
    links = (
        replace(link, visuals=solids if link.name == "platform_a" else link.visuals)
        for link in MECHANISM.links
    )
    path = tmp_path / "solid.sdf"
    path.write_text(sdf(replace(MECHANISM, links=tuple(links))), "utf-8")
    rows = reader(path)
    assert rows["error"] == []
    assert "platform_a" not in [cells[0] for cells in rows["frame"]]
    (mass,) = (float(cells[1]) for cells in rows["link"] if cells[0] == "platform_a")
    assert mass == LINKS["platform_a"].body.mass
    fixed = [cells[:6] for cells in rows["joint"] if cells[0] == "platform_a_fixed"]
    assert fixed == [["platform_a_fixed", "3", "platform", "platform_a", "platform", "platform_a"]]


# -- other robots -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["delta", "five_bar", "two_arms"])
def test_other_robots_are_read_with_their_loops(reader, tmp_path, name):
    robot = p3dof.load_robot(FILES.parent / f"docs/_static/gallery/{name}.urdf")
    robot.write(tmp_path / "robot.sdf")
    found = reader(tmp_path / "robot.sdf")
    assert found["error"] == []
    closures = robot.sidecar.closures
    model, data = robot.model, robot.model.createData()
    q = pin.neutral(model)
    if np.abs(robot.closure_error(q)).max() > 1e-9:  # the file is at zero where its loops close
        q = robot.assemble().q
    pin.framesForwardKinematics(model, data, q)
    loops = found["joint"][-len(closures) :]
    for row, closure in zip(loops, closures, strict=True):
        assert int(row[1]) == KINDS[{"3d": "ball", "6d": "fixed"}[closure.kind]]
        at = np.array(row[6:9], dtype=float)
        for end in (closure.frame1, closure.frame2):
            there = data.oMf[model.getFrameId(end)].translation
            np.testing.assert_allclose(at, there, rtol=0, atol=1e-9)
    masses = sum(float(row[1]) for row in found["link"])
    assert masses == pytest.approx(sum(inertia.mass for inertia in list(model.inertias)[1:]), rel=1e-12)


# -- Files of others, as this package reads them -----------------------------------------------------------


def chain(version, first="", second="", axis=""):
    """Return two links at poses, with what versions understand differently."""
    return texts.sdf(
        texts.link("a", texts.pose("0.1 0.2 0.3 0.4 0.1 -0.3")),
        texts.link("b", texts.pose("0.4 0.1 0.2 0.3 -0.5 0.2", more=first)),
        texts.joint("held", "world", "a", "fixed", axis=""),
        texts.joint(
            "turn",
            "a",
            "b",
            axis="1 2 0.5",
            where=texts.pose("0.1 0 0.3 0.2 0.3 0.6", more=second),
            limit=axis,
        ),
        version=version,
    )


OLD = "<use_parent_model_frame>{}</use_parent_model_frame>"
TEXTS = {
    "1.4": chain("1.4"),
    "1.5": chain("1.5"),
    "1.5 in the model": chain("1.5", axis=OLD.format(1)),
    "1.6": chain("1.6", axis=OLD.format("false")),
    "1.6 with frames": chain("1.6", ' frame="a"', ' frame="a"'),
    "1.7": chain("1.7", ' relative_to="a"', ' relative_to="a"'),
    "nested": texts.RICH.replace('"1.11"', '"1.9"').replace("screw_thread_pitch>", "thread_pitch>"),
}
INCLUDED = (
    '<sdf version="1.6"><model name="inner" placement_frame="tip"><pose>9 8 7 0.1 0.2 0.3</pose>'
    + texts.link("a", texts.pose("0.1 0.2 0.3 0.4 0.1 -0.3"))
    + texts.link("tip", texts.pose("0.4 0.1 0.2 0.3 -0.5 0.2"))
    + texts.joint("turn", "a", "tip", axis="1 2 0.5")
    + "</model></sdf>"
)
POSED = texts.pose("1 2 3 0.3 0.1 0.2")
for name, version, more in (
    ("included", "1.6", ""),
    ("included at a pose", "1.6", POSED),
    ("included of 1.8", "1.8", ""),
    ("included at a pose, of 1.8", "1.8", POSED),
    ("included by a frame", "1.8", f"{POSED}<placement_frame>a</placement_frame><name>other</name>"),
):
    TEXTS[name] = INCLUDED.replace("1.6", version), f"<include><uri>model://inner</uri>{more}</include>"


@pytest.mark.parametrize("name", TEXTS)
def test_it_places_links_joints_and_axes_alike(reader, tmp_path, name):
    written = TEXTS[name]
    if isinstance(written, tuple):
        (tmp_path / "inner").mkdir()
        (tmp_path / "inner/model.sdf").write_text(written[0])
        (tmp_path / "inner/model.config").write_text(
            '<model><name>inner</name><version>1</version><sdf version="1.9">model.sdf</sdf></model>'
        )
        inner = "other" if "other" in written[1] else "inner"
        held = texts.joint("held", "world", f"{inner}::a", "fixed", axis="")
        written = texts.sdf(
            texts.link("own"), texts.joint("pin", "own", f"{inner}::a", "fixed", axis=""), written[1], held
        )
        written = written.replace(' type="fixed"><parent>own', ' type="ball"><parent>own').replace(
            "1.11", "1.9"
        )
        if "1.6" in name:
            written = written.replace("1.9", "1.6")
    path = tmp_path / "robot.sdf"
    path.write_text(written)
    rows = reader(path)
    assert rows["error"] == []
    robot = p3dof.load_robot(path, ())
    model, data = robot.model, robot.model.createData()
    q = np.array(robot.reference)
    pin.framesForwardKinematics(model, data, q)
    J = pin.computeJointJacobians(model, data, q).reshape(6, -1)
    assert rows["link"]
    for called, *cells in rows["link"]:
        there = data.oMf[model.getFrameId(called, pin.FrameType.BODY)].homogeneous
        np.testing.assert_allclose(there, _placement(cells[13:]), rtol=0, atol=1e-13, err_msg=called)
    for called, _, *cells in rows["frame"]:
        there = data.oMf[model.getFrameId(called)].homogeneous
        np.testing.assert_allclose(there, _placement(cells), rtol=0, atol=1e-13, err_msg=called)
    axes = 0
    for called, kind, _, _, _, _, *cells in rows["joint"]:
        if not model.existJointName(called) or len(cells) < 10:
            continue
        axes += 1
        column = J[:, model.idx_vs[model.getJointId(called)]]
        direction = column[:3] if int(kind) == KINDS["prismatic"] else column[3:]
        np.testing.assert_allclose(direction, _floats(cells[7:10]), rtol=0, atol=1e-13, err_msg=called)
        if kind == str(KINDS["revolute"]):
            there = data.oMi[model.getJointId(called)].homogeneous
            np.testing.assert_allclose(there, _placement(cells[:7]), rtol=0, atol=1e-13, err_msg=called)
    assert axes
