"""The document of the page for any robot: joints, shapes within a budget, forces, closures."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from gallery import GALLERY
from page_documents import curve_of, matrix, placements, read

import p3dof
from p3dof._base.errors import InputError
from p3dof.loops.closures import ClosureWrenches
from p3dof.runs import simulate_robot
from p3dof.runs.forces_along import through_ranges
from p3dof.viewer.document.document import robot_document, robot_hash, slider_ranges
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.document.figure import RobotFigure
from p3dof.viewer.document.meshes import MeshFiles
from p3dof.viewer.document.motion import JointMotion
from p3dof.viewer.document.solids import Triangles, reduced, robot_solids, triangles_of

coal = pytest.importorskip("coal")
NAMES = sorted(path.stem for path in GALLERY.glob("*.urdf"))


def gallery(name):
    return p3dof.load_robot(GALLERY / f"{name}.urdf")


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_of_the_gallery_stands_where_pinocchio_has_it(name):
    robot = gallery(name)
    document = read(robot_document(robot, RobotFigure(robot, GALLERY / f"{name}.urdf")))
    (run,) = document["runs"]
    (q,) = decoded(run["q"])
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, q)
    found = placements(document, run, 0)
    np.testing.assert_allclose(found, [data.oMi[i].homogeneous for i in range(1, model.njoints)], atol=1e-12)
    assert [one["key"] for one in document["inputs"]] == list(robot.actuated)
    assert len(document["closures"]) == len(robot.sidecar.closures)
    size = document["scene"]["radius"]
    for closure in document["closures"]:
        if closure["kind"] in ("3d", "hinge", "universal", "6d"):
            one, two = (
                (np.eye(4) if closure[f"joint{i}"] < 0 else found[closure[f"joint{i}"]])
                @ matrix(closure[f"placement{i}"])
                for i in (1, 2)
            )
            np.testing.assert_allclose(one[:3, 3], two[:3, 3], atol=1e-6 * size)


def test_a_run_has_the_forces_of_actuators_and_closures():
    robot = gallery("five_bar")
    start = robot.assemble().q
    run = simulate_robot(robot, 0.2, q=start, samples=21, method="general")
    document = read(robot_document(robot, run=run))
    (found,) = document["runs"]
    np.testing.assert_array_equal(decoded(found["q"]), run.q)
    motors = list(robot.actuated)
    for i, name in enumerate(motors):
        np.testing.assert_array_equal(curve_of(found, f"force {name}"), run.forces[:, i])
        at = robot.model.idx_vs[robot.model.getJointId(name)]
        np.testing.assert_array_equal(curve_of(found, f"v {name}"), run.v[:, at])
    loads = {load["key"]: load for load in found["loads"]}
    wrenches = ClosureWrenches(robot.model, robot.sidecar)
    for sample in (0, 13, 20):
        lambda_ = robot.forward_dynamics(run.q[sample], run.v[sample], run.forces[sample]).lambda_
        expected = wrenches.at(run.q[sample], lambda_)
        load = loads["closure 1 force"]
        size = np.abs(expected.forces).max()
        np.testing.assert_allclose(decoded(load["values"])[sample], expected.forces[0], atol=1e-6 * size)
        place = placements(document, found, sample)[load["joint"]] @ [*load["point"], 1.0]
        np.testing.assert_allclose(place[:3], expected.places[0], atol=1e-9)
        one = curve_of(found, "force in closure 1")[sample]
        assert one == pytest.approx(np.linalg.norm(expected.forces[0]), rel=1e-9)
    assert loads[f"force {motors[0]}"]["kind"] == "moment"
    assert {load["group"] for load in found["loads"]} == {"actuator", "multiplier"}
    assert {load.get("layer") for load in found["loads"]} == {None, "multipliers"}


def swing_of(robot):
    q = robot.assemble().q
    return q, through_ranges(robot, q, slider_ranges(robot, q, 0.2))


@pytest.mark.parametrize("name", NAMES)
def test_without_a_motion_the_motors_swing_where_they_alone_move_the_robot(name):
    robot = gallery(name)
    q, found = swing_of(robot)
    if robot.mobility(q) != len(robot.actuated):  # redundant motors, or joints that none holds
        assert name in ("biped", "leg", "two_arms")
        assert found is None
        return
    np.testing.assert_allclose(found.q[0], q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.q[-1], q, rtol=0, atol=1e-9)
    values = found.q[:, [robot.model.idx_qs[robot.model.getJointId(joint)] for joint in robot.actuated]]
    assert np.ptp(values, axis=0).min() > 0.02
    for i in range(0, 201, 20):
        assert np.abs(robot.closure_error(found.q[i])).max() < 1e-10
        one = robot.inverse_dynamics(found.q[i], found.v[i], found.a[i])
        np.testing.assert_allclose(found.forces[i], one.tau, rtol=0, atol=1e-9 * np.abs(found.forces).max())
    middle = pin.difference(robot.model, found.q[99], found.q[101]) / 0.04
    np.testing.assert_allclose(found.v[100], middle, rtol=0, atol=2e-3 * np.abs(found.v).max())


def test_the_motors_swing_less_where_a_passive_joint_would_pass_its_limit():
    free = gallery("four_bar")
    q, wide = swing_of(free)
    passive = next(name for name in list(free.model.names)[1:] if name not in free.actuated)
    at = free.model.idx_qs[free.model.getJointId(passive)]
    for limit, side in (("lowerPositionLimit", -0.05), ("upperPositionLimit", 0.05)):
        values = np.array(getattr(free.model, limit))
        values[at] = q[at] + side
        setattr(free.model, limit, values)
    _, narrow = swing_of(p3dof.ClosedLoopModel(free.model, free.sidecar))
    assert np.ptp(wide.q[:, at]) > 0.2
    assert 0.02 < np.ptp(narrow.q[:, at]) <= 0.1 + 1e-9


def test_a_robot_that_stands_is_held_and_loaded():
    robot = gallery("stewart")
    weight = {"platform": [10.0, 0.0, -200.0, 0.0, 5.0, 0.0]}
    document = read(robot_document(robot, external=weight, title="Loaded", engine="ask"))
    (run,) = document["runs"]
    held = robot.inverse_dynamics(decoded(run["q"])[0], *np.zeros((2, robot.model.nv)), external=weight)
    forces = [curve_of(run, f"force {name}")[0] for name in robot.actuated]
    np.testing.assert_allclose(forces, held.tau, rtol=1e-9, atol=1e-9)
    loads = {load["key"]: load for load in run["loads"]}
    np.testing.assert_allclose(decoded(loads["wrench force platform"]["values"]), [[10.0, 0.0, -200.0]])
    assert document["engine"] == {"kind": "ask"}
    assert document["title"] == "Loaded"


def test_kinds_that_a_page_cannot_move_come_with_placements():
    model = pin.Model()
    body = pin.Inertia(1.0, np.array([0.1, 0.0, 0.2]), np.eye(3))
    first = model.addJoint(0, pin.JointModelSphericalZYX(), pin.SE3.Random(), "turn")
    model.appendBodyToJoint(first, body, pin.SE3.Identity())
    second = model.addJoint(first, pin.JointModelRUBX(), pin.SE3.Random(), "wheel")
    model.appendBodyToJoint(second, body, pin.SE3.Identity())
    robot = p3dof.ClosedLoopModel(model, p3dof.Sidecar((), ("wheel",)))
    q = np.array([pin.integrate(model, pin.neutral(model), t * np.ones(4)) for t in np.linspace(0, 7, 15)])
    motion = JointMotion(np.linspace(0, 1, 15), q)
    document = read(robot_document(robot, run=motion))
    (run,) = document["runs"]
    data = model.createData()
    for sample in (0, 7, 14):
        pin.forwardKinematics(model, data, q[sample])
        expected = [data.oMi[i].homogeneous for i in (1, 2)]
        np.testing.assert_allclose(placements(document, run, sample), expected, atol=1e-12)
    turn = decoded(run["placed"]["turn"])[:, 3:]
    assert np.einsum("ij,ij->i", turn[1:], turn[:-1]).min() > 0
    np.testing.assert_allclose(np.diff(curve_of(run, "q wheel")), 0.5, atol=1e-9)  # more than a turn, no jump


def test_meshes_are_those_that_pinocchio_loaded():
    example = pytest.importorskip("example_robot_data").load("solo12")
    robot = p3dof.ClosedLoopModel(example.model, p3dof.Sidecar.serial(example.model))
    still = JointMotion([0.0], example.q0[None])
    whole = read(robot_document(robot, example.visual_model, still, triangles=10**6))
    solids = {solid["name"]: solid for solid in whole["scene"]["solids"]}
    total = 0
    for one in example.visual_model.geometryObjects:
        shape = solids[one.name]["shape"]
        corners = decoded(shape["positions"]) * shape["scale"] + shape["offset"]
        faces = decoded(shape["indices"])
        own = one.geometry.vertices()
        total += len(faces)
        assert len(faces) == one.geometry.num_tris
        size = np.ptp(own, axis=0).max()
        np.testing.assert_allclose(corners, own, atol=size / 65000)
        assert tuple(faces[7]) == tuple(one.geometry.tri_indices(7)[k] for k in range(3))
    assert whole["runs"][0]["notes"] == []
    few = read(robot_document(robot, example.visual_model, still, triangles=5000))
    drawn = sum(decoded(solid["shape"]["indices"]).shape[0] for solid in few["scene"]["solids"])
    assert 3000 < drawn <= 5000
    (note,) = few["runs"][0]["notes"]
    assert note.startswith(f"The meshes are drawn with {drawn:,} of their {total:,} triangles")
    assert len(json.dumps(few)) < 300_000
    assert few["scene"]["radius"] == whole["scene"]["radius"]


def test_a_simpler_mesh_keeps_its_size_and_shape():
    ball = triangles_of(coal.Ellipsoid(0.3, 0.2, 0.1))
    few = reduced(ball, 100)
    assert 40 < len(few.faces) <= 100 < len(ball.faces)
    np.testing.assert_allclose(np.abs(few.corners).max(axis=0), [0.3, 0.2, 0.1], rtol=0.25)
    nothing = Triangles(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    assert reduced(nothing, 5) is nothing


@pytest.mark.parametrize(
    ("shape", "volume"),
    [(coal.Ellipsoid(0.3, 0.2, 0.1), 4 / 3 * np.pi * 0.006), (coal.Cone(0.2, 0.5), np.pi * 0.04 * 0.5 / 3)],
)
def test_round_shapes_are_closed_and_face_outward(shape, volume):
    corners, faces = triangles_of(shape)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    found = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert 0.95 * volume < found < volume
    edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, [2, 0]])), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_names_stay_different_and_shapes_without_end_are_left_out():
    model, visual = pin.Model(), pin.GeometryModel()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "j")
    for shape in (coal.Box(1, 2, 3), coal.Capsule(0.1, 0.5), coal.Halfspace(np.array([0, 0, 1.0]), 0.0)):
        visual.addGeometryObject(
            pin.GeometryObject(f"part{visual.ngeoms // 2}", 1, pin.SE3.Identity(), shape)
        )

    class Figure:
        visual_model = visual

    solids, notes = robot_solids(Figure())
    assert [solid["shape"]["kind"] for solid in solids] == ["box", "capsule"]
    assert notes == ["1 shapes without an end are not shown"]
    assert len({solid["name"] for solid in solids}) == 2


def test_the_hash_is_that_of_the_numbers():
    one, same = gallery("five_bar"), gallery("five_bar")
    assert robot_hash(one) == robot_hash(same)
    heavier = same.model.inertias[1]
    same.model.inertias[1] = pin.Inertia(heavier.mass * 1.01, heavier.lever, heavier.inertia)
    assert robot_hash(one) != robot_hash(same)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"visual": 3}, "visual: expected a visual model"),
        ({"run": JointMotion([0.0], np.zeros((1, 2)))}, "q: expected shape"),
        ({"runs": [1]}, "runs: expected runs by name"),
        ({"title": 1}, "title: expected text"),
        ({"engine": "all"}, "engine: expected"),
        ({"triangles": 0}, "triangles: expected a positive"),
        ({"run": "run"}, "run: expected a run"),
    ],
)
def test_bad_arguments_are_named(arguments, words):
    with pytest.raises(InputError, match=words):
        robot_document(gallery("five_bar"), **arguments)
    with pytest.raises(InputError, match="expected a ClosedLoopModel"):
        robot_document(3)


def test_a_mesh_with_a_number_that_is_none_is_refused_and_not_shown_in_part(tmp_path):
    pytest.importorskip("trimesh")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    (tmp_path / "whole.obj").write_text(corners + "f 1 2 3\nf 1 2 4\n", encoding="ascii")
    assert len(MeshFiles(tmp_path).read("whole.obj", None).corners) == 2
    (tmp_path / "part.obj").write_text(corners.replace("0 1 0", "0 l 0") + "f 1 2 3\n", encoding="ascii")
    with pytest.raises(p3dof.FileError, match=r"part\.obj: trimesh cannot read it \(string or file"):
        MeshFiles(tmp_path).read("part.obj", None)


def test_a_page_of_a_robot_loads_nothing_of_the_machine():
    code = (
        "import sys, p3dof; from p3dof.viewer import LiveViewer, robot_page, save_glb, save_video; "
        "robot_page(p3dof.load_robot(sys.argv[1])).html; "
        "print(*{name.split('.')[1] for name in sys.modules if name.startswith('p3dof.')})"
    )
    command = [sys.executable, "-c", code, GALLERY / "five_bar.urdf"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    others = {"machine", "closed_form", "manipulator", "methods", "runs", "analysis", "design"}
    assert others.isdisjoint(run.stdout.split()), run.stdout
