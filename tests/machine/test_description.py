"""The neutral description, its URDF and sidecar, and the files made from them."""

import ast
import itertools
import math
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from documents import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st

from p3dof._base.errors import FileError, InputError, ModelError
from p3dof._base.markup import numbers, roll_pitch_yaw
from p3dof.machine import description
from p3dof.machine.description import (
    FORMATS,
    Box,
    Closure,
    Cylinder,
    Joint,
    JointLimits,
    Link,
    Mechanism,
    Placement,
    Sphere,
    check,
    describe,
    sidecar,
    urdf,
    with_masses,
    write,
)
from p3dof.machine.parameters import (
    PAPER,
    SOLIDS,
    STEEL_DENSITY,
    Bodies,
    Body,
    Dimensions,
    Geometry,
    Parameters,
)

SIGNS = np.array(list(itertools.product((-1, 1), repeat=3)))  # the corners of a box
LINKS = [
    "base_link",
    "slider_a",
    "leg_a",
    "slider_b",
    "leg_b",
    "slider_c",
    "crossbar_upper",
    "rod_left",
    "crossbar_lower",
    "platform",
    "rod_right",
]
MARKERS = [
    "leg_a_tip",
    "leg_b_tip",
    "rod_right_tip",
    "crossbar_lower_right",
    "platform_a",
    "platform_b",
    "platform_center",
]
JOINTS = [
    "slide_a",
    "hinge_a",
    "slide_b",
    "hinge_b",
    "slide_c",
    "hinge_c",
    "hinge_left",
    "hinge_lower",
    "hinge_platform",
    "hinge_right",
]
PAIRS = [["leg_a_tip", "platform_a"], ["leg_b_tip", "platform_b"], ["rod_right_tip", "crossbar_lower_right"]]
GEOMETRIES = [
    Geometry(),
    Geometry(0.01, 0.025, 0.04, 0.005),
    Geometry(0.3, 0.75, 1.2, 0.15),
    Geometry(0.2, 0.25, 0.6, 0.03),
    Geometry(0.05, 0.3, 0.26, 0.2),
]


def model_of(parameters):
    model = pin.buildModelFromXML(urdf(describe(parameters)))
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    return model, data


def placement(model, data, name):
    assert model.existFrame(name)
    return data.oMf[model.getFrameId(name)]


def random_bodies(seed):
    rng = np.random.default_rng(seed)

    def body():
        parts = rng.uniform(0.01, 1.0, 3)
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        inertia = axes @ np.diag([parts[1] + parts[2], parts[0] + parts[2], parts[0] + parts[1]]) @ axes.T
        return Body(rng.uniform(0.1, 5), rng.normal(size=3), (inertia + inertia.T) / 2)

    return Bodies(**{name: body() for name in LINKS[1:]})


def home_frames(geometry):
    """Body frames at home in the fixed frame, from the docstring of Body alone: (origin, axes as columns)."""
    R, r, b, h = geometry.R, geometry.r, geometry.b, geometry.h
    up = np.eye(3)

    def rod(top, end, y):
        x = (np.array(end) - top) / np.linalg.norm(np.array(end) - top)
        return np.array(top), np.column_stack([x, y, np.cross(x, y)])

    n = np.array([h, 0.0, R - r]) / geometry.L
    return {
        "slider_a": (np.array([0, -R, 0]), up),
        "leg_a": rod((0, -R, 0), (0, -r, -h), [1, 0, 0]),
        "slider_b": (np.array([0, R, 0]), up),
        "leg_b": rod((0, R, 0), (0, r, -h), [1, 0, 0]),
        "slider_c": (np.array([-R, 0, 0]), up),
        "crossbar_upper": (np.array([-R, 0, 0]), up),
        "rod_left": rod((-R, b, 0), (-r, b, -h), n),
        "crossbar_lower": (np.array([-r, 0, -h]), up),
        "platform": (np.array([0, 0, -h]), up),
        "rod_right": rod((-R, -b, 0), (-r, -b, -h), n),
    }


# --- the tree ------------------------------------------------------------


def test_names_are_those_of_the_architecture():
    mechanism = describe(PAPER)
    model, _ = model_of(PAPER)
    assert [link.name for link in mechanism.links if link.name in LINKS] == LINKS
    assert sorted(link.name for link in mechanism.links) == sorted(LINKS + MARKERS)
    assert [joint.name for joint in mechanism.joints if joint.kind != "fixed"] == JOINTS
    assert list(model.names)[1:] == JOINTS
    assert mechanism.actuated == ("slide_a", "slide_b", "slide_c")
    assert [[c.frame1, c.frame2] for c in mechanism.closures] == PAIRS
    for name in LINKS + MARKERS:
        assert model.existFrame(name, pin.FrameType.BODY)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_neutral_is_home_and_closed(geometry):
    model, data = model_of(replace(PAPER, geometry=geometry))
    assert not pin.neutral(model).any()
    for first, second in PAIRS:
        gap = placement(model, data, first).translation - placement(model, data, second).translation
        assert np.abs(gap).max() < 1e-14 * max(1.0, geometry.L)
    center = placement(model, data, "platform_center")
    np.testing.assert_allclose(center.translation, [0, 0, -geometry.h], rtol=0, atol=1e-14)
    r, h = geometry.r, geometry.h
    for name, place in (("platform_a", [0, -r, -h]), ("platform_b", [0, r, -h]), ("platform", [-r, 0, -h])):
        np.testing.assert_allclose(placement(model, data, name).translation, place, rtol=0, atol=1e-14)


def test_link_frames_at_home():
    model, data = model_of(PAPER)
    frames = home_frames(PAPER.geometry)
    r, b, h = PAPER.geometry.r, PAPER.geometry.b, PAPER.geometry.h
    origins = {name: origin for name, (origin, _) in frames.items()}
    origins["crossbar_lower"], origins["platform"] = np.array([-r, b, -h]), np.array([-r, 0, -h])
    frames["crossbar_lower"] = frames["rod_left"]  # its link frame has the rods' axes
    for name, (_, axes) in frames.items():
        found = placement(model, data, name)
        np.testing.assert_allclose(found.translation, origins[name], rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.rotation, axes, rtol=0, atol=1e-14)


def test_joint_axes_and_their_signs():
    model, data = model_of(PAPER)
    pin.computeJointJacobians(model, data, pin.neutral(model))
    g = PAPER.geometry
    n = np.array([g.h, 0, g.R - g.r]) / g.L
    x, y, z = np.eye(3)
    expected = dict(zip(JOINTS, [z, x, z, x, z, y, n, n, y, n], strict=True))
    for name, axis in expected.items():
        joint = model.getJointId(name)
        column = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[:, model.idx_vs[joint]]
        moving = column[:3] if name.startswith("slide") else column[3:]
        np.testing.assert_allclose(moving, axis, rtol=0, atol=1e-14)
    tip = pin.computeFrameJacobian(
        model, data, pin.neutral(model), model.getFrameId("rod_right_tip"), pin.LOCAL_WORLD_ALIGNED
    )
    np.testing.assert_allclose(
        tip[:3, model.idx_vs[model.getJointId("hinge_right")]], [0, g.L, 0], rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
@pytest.mark.parametrize("base", [PAPER, SOLIDS])
def test_masses_centres_and_inertias_are_those_of_the_parameters(base, seed):
    parameters = base if seed is None else replace(base, bodies=random_bodies(seed))
    model, data = model_of(parameters)
    frames = home_frames(parameters.geometry)
    for name, body in parameters.bodies.items():
        link = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        found = data.oMi[link.parentJoint].act(model.inertias[link.parentJoint])
        assert found.mass == pytest.approx(body.mass, rel=1e-12)
        if body.mass == 0:
            assert not found.inertia.any()
            continue
        origin, axes = frames[name]
        np.testing.assert_allclose(found.lever, origin + axes @ body.com, rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.inertia, axes @ body.inertia @ axes.T, rtol=0, atol=1e-12)
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(parameters.bodies.mass, rel=1e-12)
    assert describe(parameters).mass == pytest.approx(parameters.bodies.mass, rel=1e-12)


def test_a_body_at_the_limit_of_physical_survives():
    point = Body(2.0, [0.1, 0.2, 0.3], np.zeros((3, 3)))
    bodies = Bodies.alike(slider=point, leg=point, crossbar=point, platform=point)
    model, _ = model_of(replace(PAPER, bodies=bodies))
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(20.0)
    assert not any(inertia.inertia.any() for inertia in model.inertias)


def test_limits_reach_the_model():
    limits = replace(PAPER.limits, travel=(-0.1, 0.3), speed=1.5, force=77.0, tilt=(-0.3, 0.9))
    model, _ = model_of(replace(PAPER, limits=limits))
    for name in ("slide_a", "slide_b", "slide_c"):
        at = model.idx_qs[model.getJointId(name)]
        found = [
            getattr(model, what)[at]
            for what in ("lowerPositionLimit", "upperPositionLimit", "upperVelocityLimit", "upperEffortLimit")
        ]
        assert found == [-0.1, 0.3, 1.5, 77.0]
    assert np.all(model.lowerPositionLimit < 0)
    assert np.all(model.upperPositionLimit > 0)
    assert np.all(model.upperPositionLimit - model.lowerPositionLimit < 2 * np.pi)
    for what in (model.upperVelocityLimit, model.upperEffortLimit):
        assert np.all(what > 0)
        assert np.all(np.isfinite(what))


@st.composite
def machines(draw):
    def number(low, high):
        return draw(st.floats(low, high, allow_subnormal=False))

    r, w = number(1e-3, 10), number(1e-3, 10)
    geometry = Geometry(r, r + w, (w) * (1 + number(1e-3, 10)), number(1e-3, 10))
    limits = replace(PAPER.limits, tilt=(-number(1e-3, 4), number(1e-3, 4)), force=number(1e-3, 1e5))
    return Parameters(geometry, random_bodies(draw(st.integers(0, 10**6))), limits)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(machines())
def test_any_valid_machine_loads_and_closes(parameters):
    model, data = model_of(parameters)
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(parameters.bodies.mass, rel=1e-12)
    for first, second in PAIRS:
        gap = placement(model, data, first).translation - placement(model, data, second).translation
        assert np.abs(gap).max() < 1e-13 * (
            parameters.geometry.R + parameters.geometry.L + parameters.geometry.b
        )
    assert np.all(model.lowerPositionLimit < 0)
    assert np.all(model.upperPositionLimit > 0)


# --- the solids ------------------------------------------------------------


def contains(solid, points):
    local = (points - solid.placement.position) @ solid.placement.rotation
    if isinstance(solid.shape, Box):
        return np.all(np.abs(local) <= np.array(solid.shape.size) / 2, axis=-1)
    if isinstance(solid.shape, Cylinder):
        round_ = np.hypot(local[:, 0], local[:, 1]) <= solid.shape.radius
        return round_ & (np.abs(local[:, 2]) <= solid.shape.length / 2)
    return np.linalg.norm(local, axis=1) <= solid.shape.radius


def link(mechanism, name):
    return next(item for item in mechanism.links if item.name == name)


def rounded(geometry, size, points, grow):
    """Whether points of the platform's frame (origin P) are in the widened triangle, grown by a little."""
    corners = np.array([[0, -geometry.r], [0, geometry.r], [-geometry.r, 0]])
    flat = points[:, :2]
    inside = np.ones(len(points), bool)
    distance = np.full(len(points), np.inf)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, away = end - start, flat - start
        inside &= edge[0] * away[:, 1] - edge[1] * away[:, 0] >= 0
        along = np.clip(away @ edge / (edge @ edge), 0, 1)
        distance = np.minimum(distance, np.linalg.norm(away - along[:, None] * edge, axis=1))
    within = inside | (distance <= size.corner_radius + grow)
    return within & (np.abs(points[:, 2]) <= size.plate_thickness / 2 + grow)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_platform_is_the_rounded_plate_exactly(geometry):
    size = Dimensions.scaled(geometry)
    r, c, t = geometry.r, size.corner_radius, size.plate_thickness
    rng = np.random.default_rng(5)
    points = rng.uniform([-r - 1.5 * c, -r - 1.5 * c, -0.7 * t], [1.5 * c, r + 1.5 * c, 0.7 * t], (50_000, 3))
    platform = link(describe(replace(PAPER, geometry=geometry)), "platform")
    for solids in (platform.visuals, platform.collisions):
        found = np.any([contains(solid, points + np.array([r, 0, 0])) for solid in solids], axis=0)
        assert not np.any(found & ~rounded(geometry, size, points, 1e-9 * r))
        assert not np.any(rounded(geometry, size, points, -1e-9 * r) & ~found)
        assert 0.2 < found.mean() < 0.9


def test_a_plate_of_very_many_slabs_is_cut_short_and_stays_inside():
    geometry = Geometry(b=1e-4)
    size = Dimensions.scaled(geometry)
    platform = link(describe(replace(PAPER, geometry=geometry)), "platform")
    assert len(platform.visuals) == 46
    points = np.random.default_rng(5).uniform([-0.1, -0.1, -1e-5], [0, 0.1, 1e-5], (50_000, 3))
    found = np.any([contains(solid, points + np.array([0.1, 0, 0])) for solid in platform.visuals], axis=0)
    inside = rounded(geometry, size, points, 1e-12)
    assert not np.any(found & ~inside)
    assert found.sum() > 0.95 * inside.sum()
    for slab in platform.visuals[6:]:
        corners = slab.placement.position - np.array([0.1, 0, 0]) + np.array(slab.shape.size) / 2 * SIGNS
        assert rounded(geometry, size, corners, 1e-12).all()


def test_drawn_solids_weigh_what_the_solids_of_the_parameters_weigh():
    mechanism = describe(SOLIDS)
    for name in (
        "slider_a",
        "slider_b",
        "slider_c",
        "leg_a",
        "leg_b",
        "rod_left",
        "rod_right",
        "crossbar_upper",
    ):
        shape = link(mechanism, name).visuals[0].shape
        volume = math.prod(shape.size) if isinstance(shape, Box) else math.pi * shape.radius**2 * shape.length
        assert volume * STEEL_DENSITY == pytest.approx(link(mechanism, name).body.mass, rel=1e-12)


def test_legs_are_told_apart_by_colour():
    mechanism = describe(PAPER)
    colours = [link(mechanism, name).visuals[0].colour for name in ("leg_a", "leg_b", "rod_left", "platform")]
    assert len({colour.rgba for colour in colours}) == len({colour.name for colour in colours}) == 4
    assert link(mechanism, "rod_left").visuals[0].colour == link(mechanism, "rod_right").visuals[0].colour


# --- the texts ------------------------------------------------------------


def test_the_urdf_holds_primitives_and_standard_tags_only():
    tree = ET.fromstring(urdf(describe(PAPER)))  # noqa: S314 - our own text
    known = {"robot", "material", "color", "link", "visual", "collision", "geometry", "origin", "inertial"}
    known |= {"mass", "inertia", "box", "cylinder", "sphere", "joint", "parent", "child", "axis", "limit"}
    known |= {"mimic", "ros2_control"}
    control = tree.find("ros2_control")
    inside = set(control.iter()) - {control}
    assert {element.tag for element in tree.iter() if element not in inside} <= known
    for element in inside:
        element.tag = f"control_{element.tag}"  # a <joint> there is only a name
    for tag in ("visual", "collision", "joint", "inertial"):
        for element in tree.iter(tag):
            assert [child.tag for child in element].count("origin") == (0 if element.tag == "link" else 1)
    children = [joint.find("child").get("link") for joint in tree.iter("joint")]
    assert len(set(children)) == len(children) == len(tree.findall("link")) - 1
    assert all(float(limit.get("effort")) > 0 for limit in tree.iter("limit"))


def test_ros2_control_names_the_three_effort_interfaces():
    control = ET.fromstring(urdf(describe(PAPER))).find("ros2_control")  # noqa: S314 - our own text
    joints = control.findall("joint")
    assert [joint.get("name") for joint in joints] == ["slide_a", "slide_b", "slide_c"]
    for joint in joints:
        (command,) = joint.findall("command_interface")
        assert command.get("name") == "effort"
        limits = {param.get("name"): float(param.text) for param in command}
        assert limits == {"min": -PAPER.limits.force, "max": PAPER.limits.force}
        states = [state.get("name") for state in joint.findall("state_interface")]
        assert states == ["position", "velocity", "effort"]
    assert control.find("hardware/plugin").text == "mock_components/GenericSystem"


def test_mimic_keeps_the_parallelogram_together():
    mimics = {joint.name: joint.mimic for joint in describe(PAPER).joints if joint.mimic is not None}
    assert {name: (m.joint, m.multiplier) for name, m in mimics.items()} == {
        "hinge_lower": ("hinge_left", -1),
        "hinge_right": ("hinge_left", 1),
    }


def test_numbers_have_fifteen_digits_and_no_negative_zero():
    text = urdf(describe(replace(SOLIDS, bodies=random_bodies(0))))
    found = re.findall(r"-?\d+\.?\d*(?:e[-+]\d+)?", " ".join(re.findall(r'"([-\d. e+]+)"', text)))
    assert max(len(re.sub(r"e.*|[-.]", "", number).lstrip("0")) for number in found) == 15
    assert "-0" not in found
    assert "nan" not in text
    assert numbers([1 / 3, -0.0, 1e-20, -2.5e17]) == "0.333333333333333 0 1e-20 -2.5e+17"


def test_bytes_do_not_depend_on_the_run():
    code = (
        "import sys; from p3dof.machine.description import *; from p3dof.machine.parameters import PAPER;"
        "m = describe(PAPER); sys.stdout.buffer.write((urdf(m) + sidecar(m)).encode())"
    )
    runs = {
        subprocess.run(
            [sys.executable, "-c", code],
            check=True,
            capture_output=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    mechanism = describe(PAPER)
    assert runs == {(urdf(mechanism) + sidecar(mechanism)).encode()}


def test_the_sidecar_is_in_the_convention_of_gepetto():
    assert yaml.safe_load(sidecar(describe(PAPER))) == {
        "closed_loop": PAIRS,
        "type": ["3d", "3d", "3d"],
        "name_mot": ["slide_a", "slide_b", "slide_c"],
    }


def test_names_are_escaped():
    odd = "<a & \"b\" 'c'>: é"
    limits = JointLimits(-1.0, 1.0, 1.0, 1.0)
    joint = Joint(odd, "revolute", "yes", odd, Placement(), [0, 0, 1], limits)
    mechanism = Mechanism(
        odd, (Link("yes"), Link(odd)), (joint,), (Closure("k", "yes", odd),), (odd,), np.zeros(3)
    )
    model = pin.buildModelFromXML(urdf(mechanism))
    assert model.name == odd
    assert model.names[1] == odd
    assert model.existFrame(odd, pin.FrameType.BODY)
    assert yaml.safe_load(sidecar(mechanism)) == {
        "closed_loop": [["yes", odd]],
        "type": ["3d"],
        "name_mot": [odd],
    }


def test_angles_give_the_rotation_back():
    rng = np.random.default_rng(2)
    cases = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(200)]
    cases = [case * np.sign(np.linalg.det(case)) for case in cases]
    turns = [-np.pi / 2, 0.0, 0.3, np.pi / 2, np.pi]
    cases += [pin.rpy.rpyToMatrix(*angles) for angles in itertools.product(turns, repeat=3)]
    cases += [np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0.0]]), np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0.0]])]
    for case in cases:  # roll and yaw are angles of vectors of this length, but for a pitch of 90 degrees
        length = np.hypot(case[0, 0], case[1, 0])
        allowed = 2e-15 + (4e-16 / length if length > 1e-9 else 0)
        np.testing.assert_allclose(pin.rpy.rpyToMatrix(*roll_pitch_yaw(case)), case, rtol=0, atol=allowed)


# yourdfpy 0.0.60 itself calls a function that trimesh has deprecated.
@pytest.mark.filterwarnings(r"ignore:`Scene.dump\(concatenate=True\)`:DeprecationWarning")
def test_yourdfpy_loads_it(tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy")
    path = write(PAPER, tmp_path)[0]
    robot = yourdfpy.URDF.load(str(path), load_collision_meshes=False, build_collision_scene_graph=True)
    assert robot.validate()
    assert robot.base_link == "base_link"
    assert sorted(robot.actuated_joint_names) == sorted(set(JOINTS) - {"hinge_lower", "hinge_right"})
    for first, second in PAIRS:
        gap = robot.get_transform(first)[:3, 3] - robot.get_transform(second)[:3, 3]
        assert np.abs(gap).max() < 1e-12


# --- the files ------------------------------------------------------------


def test_committed_files_are_up_to_date():
    assert check(PAPER, ROOT / "urdf") == []


def test_write_and_check(tmp_path):
    folder = tmp_path / "new" / "folder"
    paths = write(PAPER, folder)
    assert paths == [folder / "p3dof.urdf", folder / "p3dof.yaml"]
    assert paths[0].read_text(encoding="utf-8") == urdf(with_masses(describe(PAPER)))
    assert paths[1].read_text(encoding="utf-8") == sidecar(describe(PAPER))
    assert check(PAPER, folder) == []
    assert check(SOLIDS, folder) != []
    assert sorted(path.name for path in folder.iterdir()) == ["p3dof.urdf", "p3dof.yaml"]


def change(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return text[: text.index(old)].count("\n") + 1


def test_check_names_file_and_line_of_a_changed_number(tmp_path):
    path = write(PAPER, tmp_path)[0]
    line = change(path, '<mass value="0.9751" />', '<mass value="0.97510000001" />')
    assert check(PAPER, tmp_path) == [
        f"{path}, line {line}: expected '<mass value=\"0.9751\" />', got '<mass value=\"0.97510000001\" />'"
    ]


@pytest.mark.parametrize("other", ["0.97510000000000006", "0.975099999999999", "9.751e-1"])
def test_check_takes_a_last_digit_for_equal(tmp_path, other):
    change(write(PAPER, tmp_path)[0], 'value="0.9751"', f'value="{other}"')
    assert check(PAPER, tmp_path) == []


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("p3dof.urdf", '"leg_a_tip"', '"leg_a_top"'),
        ("p3dof.urdf", 'value="0.9751"', 'value=""'),
        ("p3dof.urdf", 'value="0.9751"', 'value="-0.9751"'),
        ("p3dof.urdf", 'value="0.9751"', 'value="0.9751 0"'),
        ("p3dof.yaml", "3d", "6d"),
        ("p3dof.yaml", "slide_b", "slide_c"),
    ],
)
def test_check_sees_any_other_change(tmp_path, file, old, new):
    write(PAPER, tmp_path)
    line = change(tmp_path / file, old, new)
    (difference,) = check(PAPER, tmp_path)
    assert difference.startswith(f"{tmp_path / file}, line {line}: expected ")


def test_check_reports_missing_and_cut_files(tmp_path):
    urdf_path, yaml_path = write(PAPER, tmp_path)
    yaml_path.unlink()
    assert check(PAPER, tmp_path) == [f"{yaml_path}: missing"]
    assert check(PAPER, tmp_path / "nowhere") == [
        f"{tmp_path / 'nowhere' / name}: missing" for name in ("p3dof.urdf", "p3dof.yaml")
    ]
    write(PAPER, tmp_path)
    text = urdf_path.read_text(encoding="utf-8")
    count = len(text.splitlines())
    urdf_path.write_text(text.replace("</robot>\n", ""), encoding="utf-8")
    assert check(PAPER, tmp_path) == [
        f"{urdf_path}, line {count}: expected '</robot>', got the end of the file"
    ]
    urdf_path.write_text(text + "more\n", encoding="utf-8")
    assert check(PAPER, tmp_path) == [
        f"{urdf_path}, line {count + 1}: expected the end of the file, got 'more'"
    ]


def test_a_file_that_cannot_be_written_is_an_error_and_harms_nothing(tmp_path):
    path = tmp_path / "p3dof.urdf"
    path.write_text("kept", encoding="utf-8")
    with pytest.raises(FileError, match=re.escape(str(path))):
        write(PAPER, path)  # the "folder" is a file
    assert path.read_text(encoding="utf-8") == "kept"
    path.unlink()
    path.mkdir()
    with pytest.raises(FileError, match="folder"):
        write(PAPER, tmp_path)
    assert [item.name for item in tmp_path.iterdir()] == ["p3dof.urdf"]
    (tmp_path / "p3dof.yaml").write_bytes(b"\xff\xfe")
    path.rmdir()
    with pytest.raises(FileError, match=r"p3dof\.yaml: would be overwritten, but was not generated"):
        write(PAPER, tmp_path)
    assert [item.name for item in tmp_path.iterdir()] == ["p3dof.yaml"]
    write(PAPER, tmp_path, force=True)
    (tmp_path / "p3dof.yaml").write_bytes(b"\xff\xfe")
    with pytest.raises(FileError, match="UTF-8"):
        check(PAPER, tmp_path)


def test_files_of_the_papers_machine_are_not_replaced_by_those_of_another(tmp_path):
    formats = ("urdf", "srdf", "mjcf")
    mine = replace(PAPER, geometry=Geometry(r=0.12))
    written = write(PAPER, tmp_path, formats)
    before = {path: path.read_bytes() for path in written}
    with pytest.raises(
        FileError, match=r"p3dof\.urdf: would be overwritten, but describes the paper's machine"
    ):
        write(mine, tmp_path, formats)
    with pytest.raises(FileError, match="the paper's machine"):
        write(mine, tmp_path, ["srdf", "urdf"], exact=True)
    assert {path: path.read_bytes() for path in written} == before
    write(PAPER, tmp_path, ["urdf"], exact=True)  # the same machine, told in another way
    write(PAPER, tmp_path, formats)
    write(mine, tmp_path, ["srdf"])  # the same for every machine
    write(mine, tmp_path, formats, force=True)
    assert check(mine, tmp_path, formats) == []
    write(replace(PAPER, geometry=Geometry(r=0.13)), tmp_path, formats)  # one's own machine changes
    write(PAPER, tmp_path, formats)


def test_formats_of_one_call_are_written_together(tmp_path, monkeypatch):
    write(PAPER, tmp_path, ["urdf", "sdf"])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    put = Path.replace

    def sometimes(path, target):
        if Path(target).name == "p3dof.sdf" and b"0.12" in path.read_bytes():
            raise OSError(28, "No space left on device")
        return put(path, target)

    monkeypatch.setattr(Path, "replace", sometimes)
    with pytest.raises(FileError, match="No space left"):
        write(replace(PAPER, geometry=Geometry(r=0.12)), tmp_path, ["urdf", "sdf"], force=True)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_formats_are_a_registry(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"expected some of urdf, .*got 'cad'"):
        write(PAPER, tmp_path, ["cad"])
    assert not list(tmp_path.iterdir())
    monkeypatch.setitem(FORMATS, "names", {"names.txt": lambda mechanism: mechanism.name + "\n"})
    assert [path.name for path in write(PAPER, tmp_path, ["names", "urdf"])] == [
        "names.txt",
        "p3dof.urdf",
        "p3dof.yaml",
    ]
    assert check(PAPER, tmp_path, ["names", "urdf"]) == []


# --- the description's own checks ------------------------------------------------------------


def fixed(name, parent, child):
    return Joint(name, "fixed", parent, child, Placement())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"links": ()}, "at least the root"),
        ({"links": (Link("a"), Link("a"))}, "'a' is used more than once"),
        ({"links": (Link("a"), Link(""))}, "printable names"),
        ({"links": (Link("a"), Link("b\0"))}, "printable names"),
        ({"joints": (fixed("1", "a", "b"), fixed("2", "b", "c"))}, "no joint leads to 'd'"),
        ({"joints": (fixed("1", "a", "b"), fixed("2", "a", "b"))}, "not yet reached, got 'b'"),
        ({"joints": (fixed("1", "a", "z"),)}, "not yet reached, got 'z'"),
        ({"joints": (fixed("1", "b", "c"),)}, "not depth first"),
        ({"joints": tuple(fixed(*names) for names in ("1ab", "2ac", "3bd"))}, "not depth first"),
        ({"closures": (Closure("k", "a", "z"),)}, "closure k: there is no link 'z'"),
        ({"actuated": ("1",)}, "there is no moving joint '1'"),
        ({"gravity": [0, 0]}, "gravity"),
    ],
)
def test_a_malformed_mechanism_is_refused(changes, message):
    joints = tuple(fixed(*names) for names in ("1ab", "2bd", "3ac"))
    good = Mechanism("m", tuple(Link(name) for name in "abcd"), joints, (), (), np.zeros(3))
    with pytest.raises(ModelError, match=message):
        replace(good, **changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Placement([0, 0]), "position"),
        (lambda: Placement([0, 0, np.nan]), "finite"),
        (lambda: Placement(rotation=-np.eye(3)), "right-handed"),
        (lambda: Placement(rotation=2 * np.eye(3)), "right-handed"),
        (lambda: Box((1.0, 0.0, 1.0)), "positive"),
        (lambda: Cylinder(1.0, -1.0), "length"),
        (lambda: Sphere(np.inf), "finite"),
        (lambda: JointLimits(0.1, 1.0, 1.0, 1.0), "home"),
        (lambda: JointLimits(-1.0, 1.0, 1.0, 0.0), "effort"),
        (lambda: Joint("j", "ball", "a", "b", Placement()), "ball"),
        (lambda: Joint("j", "revolute", "a", "b", Placement()), "axis and limits"),
        (lambda: Joint("j", "fixed", "a", "b", Placement(), [0, 0, 1]), "axis and limits"),
        (lambda: Joint("j", "revolute", "a", "b", Placement(), [0, 0, 2], JointLimits(-1, 1, 1, 1)), "unit"),
    ],
)
def test_malformed_parts_are_refused(make, message):
    with pytest.raises(ModelError, match=message):
        make()


def test_arrays_are_frozen():
    mechanism = describe(PAPER)
    for array in (mechanism.gravity, mechanism.joints[0].axis, mechanism.joints[0].placement.rotation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    np.testing.assert_array_equal(mechanism.gravity, PAPER.gravity)


def test_all_names_exist_and_only_lower_floors_are_imported():
    assert all(hasattr(description, name) for name in description.__all__)
    rooms = {"_base": ("errors", "checks", "files", "markup"), "machine": ("parameters", "description")}
    allowed = {f"p3dof.{door}.{room}" for door in rooms for room in rooms[door]}
    for path in (ROOT / "p3dof" / "machine" / "description").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                ours = ".".join(name.split(".")[:3])
                assert not name.startswith("p3dof") or ours in allowed, (path, name)
