"""The document of the page says what Python knows: scene, joints, runs, curves, loads, limits."""

import dataclasses

import jsonschema
import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from machines import random_actuators, random_machine
from page_documents import SCHEMA, curve_of, every_joint, placements, read
from scipy.spatial.transform import Rotation

import p3dof
from p3dof._base.errors import InputError
from p3dof.codegen.web_controller import controller_module
from p3dof.design import CollisionShape, Surroundings, clearance_of
from p3dof.design.clearance import CollisionModel
from p3dof.machine.parameters import PAPER
from p3dof.runs import simulate_robot
from p3dof.viewer.document.encoding import DTYPES, decoded, encoded
from p3dof.viewer.document.trees import placed_over, tree_of
from p3dof.viewer.machine.document import page_document

ROBOT = p3dof.load()
MOTION = p3dof.paper_motion(samples=41)


@pytest.fixture(scope="module")
def paper():
    return read(page_document(ROBOT, ROBOT.inverse_dynamics(MOTION)))


def test_the_schema_is_a_schema():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("dtype", DTYPES)
def test_arrays_come_back_as_they_were(dtype):
    values = np.arange(12).reshape(3, 4).astype(dtype)
    if dtype.startswith("float"):
        values[0, 0] = np.nan
    again = decoded(encoded(values, dtype))
    assert again.dtype == values.dtype
    np.testing.assert_array_equal(again, values)


@pytest.mark.parametrize(
    ("array", "words"),
    [
        ({"shape": [3], "dtype": "float64", "base64": "AAAA"}, "expected 3 numbers"),
        ({"shape": [1], "dtype": "float16", "base64": "AAA="}, "expected a shape and one of"),
        ({"shape": [1], "dtype": "float64", "base64": "?"}, "expected shape, dtype and base64"),
        ({"shape": [1], "dtype": "float64"}, "expected shape, dtype and base64"),
    ],
)
def test_what_is_no_array_is_refused(array, words):
    with pytest.raises(InputError, match=words):
        decoded(array)


def test_whole_numbers_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="fit into int16"):
        encoded([40000], "int16")


@pytest.mark.parametrize("method", ["pinocchio", "virtual-power", "compiled"])
def test_a_run_holds_the_numbers_of_its_result(method):
    result = ROBOT.inverse_dynamics(MOTION, method=method, wrench=[1.0, 2.0, 30.0, 0.5, 0.0, 0.25])
    document = read(page_document(ROBOT, result))
    (run,) = document["runs"]
    np.testing.assert_array_equal(decoded(run["pose"]), MOTION.pose)
    np.testing.assert_array_equal(decoded(run["wrench"]), result.wrench)
    for i, leg in enumerate("abc"):
        np.testing.assert_array_equal(curve_of(run, f"force_{leg}"), result.forces[:, i])
        np.testing.assert_array_equal(curve_of(run, f"slider_{leg}"), result.sliders[:, i])
        np.testing.assert_array_equal(curve_of(run, f"speed_{leg}"), result.slider_velocities[:, i])
        np.testing.assert_array_equal(curve_of(run, f"acceleration_{leg}"), result.slider_accelerations[:, i])
    np.testing.assert_allclose(curve_of(run, "power_total"), result.power, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(curve_of(run, "theta_ddot"), MOTION.acceleration[:, 2])
    loads = {load["key"]: load for load in run["loads"]}
    np.testing.assert_array_equal(decoded(loads["wrench_moment"]["values"]), result.wrench[:, 3:])
    assert {load["group"] for load in run["loads"]} == {"actuator", "wrench"}


def test_forces_at_rest_are_those_that_hold_the_pose(paper):
    nothing = np.zeros_like(MOTION.pose)
    still = p3dof.Motion(MOTION.time, MOTION.pose, nothing, nothing, check=False)
    held = ROBOT.inverse_dynamics(still).forces
    found = np.column_stack([curve_of(paper["runs"][0], f"static_{leg}") for leg in "abc"])
    np.testing.assert_allclose(found, held, rtol=0, atol=1e-11 * np.abs(held).max())


def test_joints_and_solids_are_where_pinocchio_has_them(paper):
    model, visual = ROBOT.model, ROBOT.visual_model
    data, geometry = model.createData(), visual.createData()
    for sample in (0, 17, 40):
        q = decoded(paper["runs"][0]["q"])[sample]
        pin.updateGeometryPlacements(model, data, visual, geometry, q)
        found = placements(paper, paper["runs"][0], sample)
        np.testing.assert_allclose(
            found, [data.oMi[i].homogeneous for i in range(1, model.njoints)], atol=1e-12
        )
    solids = {solid["name"]: solid for solid in paper["scene"]["solids"]}
    seen = [one for one in visual.geometryObjects if not one.name.startswith("platform")]
    for one in seen:
        np.testing.assert_allclose(solids[one.name]["placement"][:3], one.placement.translation, atol=1e-12)
        assert solids[one.name]["joint"] == one.parentJoint - 1
    assert len(seen) == 21


def test_the_path_of_P_is_that_of_the_platform(paper):
    traced, run = paper["scene"]["traced"], paper["runs"][0]
    for sample in (0, 20, 40):
        y, z, _ = MOTION.pose[sample]
        found = placements(paper, run, sample)[traced["joint"]] @ [*traced["point"], 1.0]
        np.testing.assert_allclose(found[:3], [0.0, y, z - ROBOT.parameters.geometry.h], atol=1e-12)


def test_closures_are_closed_over_the_run(paper):
    for sample in range(0, 41, 8):
        found = placements(paper, paper["runs"][0], sample)
        for closure in paper["closures"]:
            one, two = (found[closure[f"joint{i}"]] @ [*closure[f"placement{i}"][:3], 1.0] for i in (1, 2))
            np.testing.assert_allclose(one, two, atol=1e-12)
    assert len(paper["closures"]) == 3


def test_the_scene_shows_what_is_in_the_viewer(paper):
    scene = paper["scene"]
    assert [label["text"] for label in scene["labels"]] == ["A", "B", "C", "x0", "y0", "z0"]
    names = {solid["name"] for solid in scene["solids"]}
    assert {"rail_a", "rail_b", "rail_c", "axis_x", "axis_z_head", "platform", "P"} <= names
    skin = next(solid["shape"] for solid in scene["solids"] if solid["name"] == "platform")
    corners = decoded(skin["positions"])
    radius = ROBOT.parameters.geometry.r + p3dof.machine.Dimensions().corner_radius
    assert radius < np.abs(corners[:, :2]).max() < 1.05 * radius
    assert decoded(skin["indices"]).max() < len(corners)
    assert {solid["leg"] for solid in scene["solids"] if solid["name"] == "rod_left_0"} == {"c"}


def test_limits_are_those_of_the_machine(paper):
    limits = ROBOT.parameters.limits
    curves = {curve["key"]: curve for curve in paper["runs"][0]["curves"]}
    assert curves["force_b"]["limit"] == [-limits.force, limits.force]
    assert curves["slider_c"]["limit"] == list(limits.travel)
    assert curves["theta"]["limit"] == list(limits.tilt)
    assert paper["limits"]["speed"] == limits.speed
    assert [one["key"] for one in paper["inputs"]] == ["y", "z", "theta"]


@pytest.mark.parametrize("seed", range(3))
def test_the_engine_has_the_numbers_of_any_machine(seed):
    parameters = random_machine(seed)
    own = random_actuators(np.random.default_rng(seed), parameters)
    parameters = dataclasses.replace(parameters, actuators=own)
    document = read(page_document(p3dof.Manipulator(parameters)))
    row, places = decoded(document["engine"]["parameters"]), controller_module().places
    assert row.shape == (152,)
    for name in ("r", "R", "L", "b"):
        assert row[places[name]] == getattr(parameters.geometry, name)
    np.testing.assert_array_equal(row[places["gravity"] : places["gravity"] + 3], parameters.gravity)
    assert row[places["bodies"]["platform"]] == parameters.bodies.platform.mass
    assert row[places["force"]] == parameters.limits.force
    assert tuple(row[places["tilt"] : places["tilt"] + 2]) == parameters.limits.tilt
    for kind in ("armature", "counterbalance", "spring", "counterweight"):
        for slide, value in getattr(own, kind).items():
            assert row[places[kind][slide]] == value
    assert document["machine"]["hash"] != read(page_document(ROBOT))["machine"]["hash"]


def test_without_a_motion_the_machine_is_held_at_home():
    (run,) = read(page_document(ROBOT))["runs"]
    np.testing.assert_array_equal(decoded(run["pose"]), np.zeros((1, 3)))
    weight = ROBOT.inverse_dynamics(MOTION[:1]).forces
    assert np.isfinite(curve_of(run, "force_c")).all()
    assert weight.shape == (1, 3)


def test_runs_stand_beside_each_other():
    other = ROBOT.inverse_dynamics(MOTION, method="virtual-power")
    document = read(page_document(ROBOT, MOTION, runs={"by hand": other}, title="Two"))
    assert [run["name"] for run in document["runs"]] == ["Forces by Pinocchio", "by hand"]
    assert document["title"] == "Two"


def test_a_run_of_another_machine_says_so():
    other = p3dof.Manipulator(p3dof.of_solids(p3dof.machine.Geometry(r=0.1, R=0.25, L=0.5)))
    runs = {"longer legs": (other, MOTION), "the same": (p3dof.load(), MOTION)}
    document = read(page_document(ROBOT, MOTION, runs=runs))
    first, longer, same = document["runs"]
    assert longer["machine"] == {"r": 0.1, "R": 0.25, "L": 0.5}
    assert "another machine" in longer["notes"][0]
    assert longer["solids"]["density"] == dict.fromkeys(("slider", "leg", "crossbar", "platform"), 7801.0)
    assert not {"machine"} & {*first, *same}
    expected = other.inverse_dynamics(MOTION)
    np.testing.assert_array_equal(curve_of(longer, "force_b"), expected.forces[:, 1])
    np.testing.assert_array_equal(decoded(longer["q"]), expected.joints.q)
    light = p3dof.Manipulator(dataclasses.replace(PAPER, density=2700.0, dimensions={"rod_radius": 0.012}))
    solids = read(page_document(light))["engine"]["solids"]
    assert set(solids["density"].values()) == {2700.0}
    assert solids["dimensions"] == {"rod_radius": 0.012}
    with pytest.raises(InputError, match="expected a Manipulator"):
        page_document(ROBOT, runs={"wrong": (3, MOTION)})


def test_a_machine_and_a_robot_differ_only_in_what_one_has_more():
    robot = p3dof.load_robot(ROOT / "docs/_static/gallery/five_bar.urdf")
    run = simulate_robot(robot, 0.1, samples=5, method="general")
    mine, theirs = read(page_document(ROBOT, MOTION)), read(p3dof.viewer.robot_document(robot, run=run))
    of_slides, of_motors = mine["runs"][0]["loads"][0], theirs["runs"][0]["loads"][0]
    for one, other, more in (
        (mine, theirs, {"limits"}),
        (mine["scene"], theirs["scene"], {"traced"}),
        (mine["runs"][0], theirs["runs"][0], {"pose", "velocity", "acceleration"}),
        (of_slides, of_motors, set()),
        (theirs["inputs"][0], mine["inputs"][0], {"joint"}),
    ):
        assert set(one) - set(other) == more
        assert set(other) <= set(one)


def test_pages_that_begin_elsewhere_are_of_the_schema_too():
    found = read(p3dof.viewer.page(ROBOT, MOTION, at=0.5, speed=2.0, playing=False).document)
    assert found["start"] == {"time": 0.5, "speed": 2.0, "playing": False}
    five_bar = p3dof.load_robot(ROOT / "docs/_static/gallery/five_bar.urdf")
    found = read(p3dof.viewer.robot_page(five_bar, closure_forces=True).document)
    assert found["start"]["layers"] == {"closures": True, "multipliers": True}


def test_a_run_in_time_has_what_it_followed():
    run = ROBOT.simulate(
        0.1, controller=p3dof.runs.PD(ROBOT, MOTION), reference=MOTION, samples=21, method="compiled"
    )
    (found,) = read(page_document(ROBOT, run))["runs"]
    np.testing.assert_array_equal(curve_of(found, "y_error"), run.error[:, 0])
    np.testing.assert_array_equal(curve_of(found, "force_a"), run.forces[:, 0])
    assert found["name"] == "Simulation, compiled"


def test_reactions_of_joints_are_curves_and_arrows_that_can_be_shown():
    reactions = ROBOT.reactions(MOTION)
    document = read(page_document(ROBOT, MOTION, reactions=reactions))
    assert "width b of the parallelogram, which the paper does not give" in document["runs"][0]["notes"][-1]
    (run,) = document["runs"]
    forces, moments = reactions.elastic.in_base()
    loads = {load["key"]: load for load in run["loads"]}
    assert {load["layer"] for load in loads.values() if load["group"] == "reaction"} == {"reactions"}
    (layer,) = (layer for layer in document["scene"]["layers"] if layer["name"] == "reactions")
    assert not layer["shown"]
    for i, name in enumerate(reactions.elastic.joints):
        np.testing.assert_allclose(curve_of(run, f"force {name}"), np.linalg.norm(forces[:, i], axis=1))
        size = np.abs(moments[:, i]).max()
        np.testing.assert_allclose(
            decoded(loads[f"moment {name}"]["values"]), moments[:, i], atol=1e-6 * size
        )
        for sample in (0, 25):
            load = loads[f"force {name}"]
            at = placements(document, run, sample)[load["joint"]] @ [*load["point"], 1.0]
            np.testing.assert_allclose(at[:3], reactions.elastic.positions[sample, i], atol=1e-9)
    shown = read(ROBOT.page(MOTION, reactions=reactions).document)
    assert [load["key"] for load in shown["runs"][0]["loads"]] == [load["key"] for load in run["loads"]]
    with pytest.raises(InputError, match="the motion that is shown first"):
        page_document(ROBOT, MOTION[:9], reactions=reactions)
    with pytest.raises(InputError, match="reactions: expected Reactions"):
        page_document(ROBOT, MOTION, reactions=3)


def test_the_nearest_parts_are_points_a_curve_and_what_stands_around():
    around = Surroundings(
        payload=[CollisionShape("load", size=(0.1, 0.08, 0.06), at=(0, 0, -0.06), turn=(0.1, 0.2, 0.3))],
        obstacles=[CollisionShape("post", ends=((0.1, 0.33, -0.6), (0, 0.33, 0)), radius=0.02)],
    )
    clearance = clearance_of(ROBOT, MOTION, around, required=0.002)
    document = read(page_document(ROBOT, MOTION, clearance=clearance))
    (run,) = document["runs"]
    near, least = run["nearest"], clearance.distances.min(axis=1)
    assert near["required"] == 0.002
    np.testing.assert_array_equal(decoded(near["distances"]), least)
    np.testing.assert_array_equal(curve_of(run, "least_distance"), least)
    points = decoded(near["points"]).reshape(-1, 2, 3)
    np.testing.assert_array_equal(points, clearance.nearest_points())
    names = [near["names"][pair] for pair in decoded(near["pairs"])]
    assert names == [" and ".join(clearance.pairs[pair]) for pair in clearance.distances.argmin(axis=1)]
    (line,) = (one for one in run["curves"] if one["key"] == "least_distance")
    assert (line["limit"], line["unit"]) == ([0.002, None], "m")
    shown = {layer["name"] for layer in document["scene"]["layers"] if layer["shown"]}
    assert {"nearest", "surroundings"} <= shown
    solids = {one["name"]: one for one in document["scene"]["solids"] if one["layer"] == "surroundings"}
    assert set(solids) == {"load", "post"}
    x, y, z, *turn = solids["post"]["placement"]
    np.testing.assert_allclose([x, y, z], [0.05, 0.33, -0.3], atol=1e-15)
    along = Rotation.from_quat(turn).apply([0, 0, solids["post"]["shape"]["length"]])
    np.testing.assert_allclose(along, [-0.1, 0, 0.6], atol=1e-12)
    for sample in (0, 25):
        place = placements(document, run, sample)[solids["load"]["joint"]]
        own = np.eye(4)
        own[:3, :3] = Rotation.from_quat(solids["load"]["placement"][3:]).as_matrix()
        own[:3, 3] = solids["load"]["placement"][:3]
        platform = Rotation.from_rotvec([0, MOTION.pose[sample, 2], 0])
        solids_there = CollisionModel(ROBOT.parameters, around).solids(MOTION.pose[sample])
        (corners,) = (corners for part, corners, _ in solids_there if part == "load")
        np.testing.assert_allclose((place @ own)[:3, 3], corners.mean(axis=0), atol=1e-12)
        expected = platform.as_matrix() @ Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix()
        np.testing.assert_allclose((place @ own)[:3, :3], expected, atol=1e-12)
    plain = read(page_document(ROBOT, MOTION, clearance=clearance_of(ROBOT, MOTION)))
    assert "surroundings" not in {layer["name"] for layer in plain["scene"]["layers"]}
    with pytest.raises(InputError, match="clearance: expected that of the motion that is shown first"):
        page_document(ROBOT, MOTION[:9], clearance=clearance)
    with pytest.raises(InputError, match="clearance: expected a Clearance, got 3"):
        page_document(ROBOT, MOTION, clearance=3)


def test_samples_out_of_reach_are_gaps_and_a_note():
    motion = p3dof.Motion.rest_to_rest([0.0, 0.0, 0.0], [0.52, 0.0, 0.0], 1.0, samples=21)
    (run,) = read(page_document(ROBOT, motion))["runs"]
    forces = curve_of(run, "force_a")
    assert np.isnan(forces).any()
    assert np.isfinite(forces).any()
    np.testing.assert_array_equal(np.isnan(curve_of(run, "static_a")), np.isnan(forces))
    assert any("invalid" in note for note in run["notes"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"result": 3}, "result: expected a Motion"),
        ({"title": 3}, "title: expected text"),
        ({"runs": [MOTION]}, "runs: expected runs by name"),
    ],
)
def test_bad_arguments_are_named(arguments, words):
    with pytest.raises(InputError, match=words):
        page_document(ROBOT, **arguments)
    with pytest.raises(InputError, match="expected a Manipulator"):
        page_document("robot")


def test_every_kind_of_joint_is_moved_as_pinocchio_moves_it():
    model, data = every_joint()
    q = np.array([pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)) for _ in range(5)])
    document = {"scene": {"joints": tree_of(model)}}
    run = {"q": encoded(q), "placed": placed_over(model, q)}
    kinds = {joint["kind"] for joint in document["scene"]["joints"]}
    assert kinds == {*SCHEMA["$defs"]["joint"]["properties"]["kind"]["enum"]} - {"fixed"}
    assert set(run["placed"]) == {"zyx", "composite"}
    for sample, values in enumerate(q):
        pin.forwardKinematics(model, data, values)
        expected = [data.oMi[i].homogeneous for i in range(1, model.njoints)]
        np.testing.assert_allclose(placements(document, run, sample), expected, atol=1e-12)
