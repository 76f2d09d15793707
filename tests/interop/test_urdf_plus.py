"""URDF+: `urdf::parseURDFFile("urdf/p3dof_plus.urdf")` of mit-biomimetics/urdfdom.

That parser is not packaged anywhere; here the file is read as its source reads it, and as plain URDF.
"""

import os
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from reference import FILES, MECHANISM, URDF, assert_placements, closed_joints, placements, random_joints

from p3dof.machine import description
from p3dof.machine.description.mechanism import Closure, Joint, JointLimits, Link, Mechanism, Placement
from p3dof.machine.description.urdf_text import urdf_plus
from p3dof.machine.parameters import PAPER, SOLIDS, Geometry, of_solids

FILE = FILES / "p3dof_plus.urdf"


@pytest.fixture(scope="module")
def robot():
    return ET.parse(FILE).getroot()  # noqa: S314 - our own file


def halves(loop):
    """Link and position in it of the predecessor and of the successor of a loop."""
    found = []
    for side in ("predecessor", "successor"):
        (half,) = loop.findall(side)
        (origin,) = half.findall("origin")
        assert [float(angle) for angle in origin.get("rpy").split()] == [0, 0, 0]
        found.append((half.get("link"), np.array([float(x) for x in origin.get("xyz").split()])))
    return found


def gaps(root, found):
    """Distance between the two halves of every loop, at placements of the links."""
    ends = (
        [found[link][:3, :3] @ at + found[link][:3, 3] for link, at in halves(loop)]
        for loop in root.findall("loop")
    )
    return np.array([np.linalg.norm(one - other) for one, other in ends])


def test_file_is_up_to_date():
    assert description.check(PAPER, FILES, ["urdf+"]) == []


def test_other_readers_see_the_tree_of_the_urdf():
    model, plain = (pin.buildModelFromUrdf(str(file)) for file in (FILE, URDF))
    assert list(model.names) == list(plain.names)
    assert [frame.name for frame in model.frames] == [frame.name for frame in plain.frames]
    for one, other in zip(model.inertias, plain.inertias, strict=True):
        np.testing.assert_array_equal(one.matrix(), other.matrix())
    for name in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "upperEffortLimit"):
        np.testing.assert_array_equal(getattr(model, name), getattr(plain, name))
    for seed in range(3):
        q = random_joints(seed)
        assert_placements(placements(q, FILE), q, 0)


def test_only_loops_and_independence_are_added(robot):
    plain = ET.parse(URDF).getroot()  # noqa: S314
    for extra in (*plain.findall("ros2_control"),):
        plain.remove(extra)
    for joint in plain.findall("joint"):
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
    for loop in robot.findall("loop"):
        robot.remove(loop)
    independent = {}
    for joint in robot.findall("joint"):
        independent[joint.get("name")] = joint.attrib.pop("independent", "true") == "true"
    assert ET.canonicalize(ET.tostring(robot), strip_text=True) == ET.canonicalize(
        ET.tostring(plain), strip_text=True
    )
    assert {joint.name for joint in MECHANISM.passive} == {n for n, free in independent.items() if not free}


def test_loops_are_complete():
    robot = ET.parse(FILE).getroot()  # noqa: S314
    loops = robot.findall("loop")
    assert [loop.get("name") for loop in loops] == [closure.name for closure in MECHANISM.closures]
    names = {element.get("name") for element in robot.findall("joint")}
    for loop, closure in zip(loops, MECHANISM.closures, strict=True):
        assert loop.get("type") == "spherical"
        assert loop.get("name") not in names
        for (link, at), frame in zip(halves(loop), (closure.frame1, closure.frame2), strict=True):
            marker = MECHANISM.markers[frame]
            assert link == marker.parent
            np.testing.assert_allclose(at, marker.placement.position, rtol=1e-14, atol=0)


def test_loops_are_closed_at_closed_poses_and_only_there():
    root = ET.parse(FILE).getroot()  # noqa: S314
    for q in closed_joints(40):
        assert gaps(root, placements(q, FILE)).max() < 1e-12
    for seed in range(5):
        assert gaps(root, placements(random_joints(seed), FILE)).min() > 1e-3


def test_loops_leave_as_many_freedoms_as_there_are_independent_joints():
    """The rank of the loops' gaps, by central differences, at a pose without symmetry."""
    root = ET.parse(FILE).getroot()  # noqa: S314
    q = closed_joints(30)[-1]

    def opening(name, step):
        found = placements({**q, name: q[name] + step}, FILE)
        ends = [
            [found[link][:3, :3] @ at + found[link][:3, 3] for link, at in halves(loop)]
            for loop in root.findall("loop")
        ]
        return np.concatenate([one - other for one, other in ends])

    J = np.stack([(opening(name, 1e-5) - opening(name, -1e-5)) / 2e-5 for name in q], axis=1)
    independent = [joint for joint in MECHANISM.moving if joint.name in MECHANISM.actuated]
    assert J.shape[1] - np.linalg.matrix_rank(J, tol=1e-7) == len(independent)


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("parameters", [SOLIDS, of_solids(Geometry(0.3, 0.75, 1.2, 0.15))])
def test_other_machines_close_at_home(tmp_path, parameters, exact):
    mechanism = description.describe(parameters)
    mechanism = mechanism if exact else description.with_masses(mechanism)
    (tmp_path / "été 1.urdf").write_text(urdf_plus(mechanism), encoding="utf-8")
    home = dict.fromkeys((joint.name for joint in mechanism.moving), 0.0)
    found = placements(home, tmp_path / "été 1.urdf")
    assert gaps(ET.fromstring(urdf_plus(mechanism)), found).max() < 1e-14 * 1.2 * 10  # noqa: S314


def test_names_are_escaped_and_closures_without_markers_work():
    odd = "<a & \"b\" 'c'>: é --"
    limits = JointLimits(-1.0, 1.0, 1.0, 1.0)
    joint = Joint(odd, "revolute", "yes", odd, Placement(), [0, 0, 1], limits)
    mechanism = Mechanism(
        odd, (Link("yes"), Link(odd)), (joint,), (Closure(odd, "yes", odd),), (odd,), np.zeros(3)
    )
    root = ET.fromstring(urdf_plus(mechanism))  # noqa: S314
    (loop,) = root.findall("loop")
    assert loop.get("name") == odd
    assert [link for link, _ in halves(loop)] == ["yes", odd]
    assert pin.buildModelFromXML(urdf_plus(mechanism)).names[1] == odd


def test_without_closures_it_is_a_plain_tree():
    root = ET.fromstring(urdf_plus(replace(MECHANISM, closures=())))  # noqa: S314
    assert root.findall("loop") == []


def test_text_is_the_same_in_every_process():
    code = (
        "import sys; from p3dof.machine.description import files; from p3dof.machine.parameters import PAPER;"
        "sys.stdout.buffer.write(''.join(files.texts(PAPER, ['urdf+', 'srdf']).values()).encode())"
    )
    outputs = {
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
        ).stdout
        for seed in (0, 1)
    }
    assert len(outputs) == 1
