"""SRDF: `pin.loadReferenceConfigurations(model, "urdf/p3dof.srdf")`; MoveIt reads it beside the URDF."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from reference import FILES, LINKS, MECHANISM, URDF

from p3dof.machine import description
from p3dof.machine.description.mechanism import Closure, Joint, JointLimits, Link, Mechanism, Placement
from p3dof.machine.description.urdf_text import srdf
from p3dof.machine.parameters import PAPER, SOLIDS, Geometry, of_solids

FILE = FILES / "p3dof.srdf"


@pytest.fixture(scope="module")
def model():
    return pin.buildModelFromUrdf(str(URDF))


@pytest.fixture(scope="module")
def robot():
    return ET.parse(FILE).getroot()  # noqa: S314 - our own file


def test_file_is_up_to_date():
    assert description.check(PAPER, FILES, ["srdf"]) == []


def test_pinocchio_finds_the_home_state(model):
    pin.loadReferenceConfigurations(model, str(FILE))
    assert [entry.key() for entry in model.referenceConfigurations] == ["home"]
    home = model.referenceConfigurations["home"]
    np.testing.assert_array_equal(home, np.zeros(model.nq))
    data = model.createData()
    pin.framesForwardKinematics(model, data, home)
    for closure in MECHANISM.closures:
        one, other = (data.oMf[model.getFrameId(name)] for name in (closure.frame1, closure.frame2))
        np.testing.assert_allclose(one.translation, other.translation, rtol=0, atol=1e-14)


def test_pinocchio_removes_the_pairs_of_neighbours(model):
    geometry = pin.buildGeomFromUrdf(model, str(URDF), pin.GeometryType.COLLISION)
    geometry.addAllCollisionPairs()

    def pairs():
        frames = [model.frames[item.parentFrame].name for item in geometry.geometryObjects]
        return {frozenset((frames[pair.first], frames[pair.second])) for pair in geometry.collisionPairs}

    before = pairs()
    pin.removeCollisionPairs(model, geometry, str(FILE))
    carrier = {name: joint.parent for name, joint in MECHANISM.markers.items()}
    joined = {frozenset((joint.parent, joint.child)) for joint in MECHANISM.moving} | {
        frozenset((carrier[closure.frame1], carrier[closure.frame2])) for closure in MECHANISM.closures
    }
    assert before - pairs() == joined
    assert len(joined) == 13


def test_groups_and_passive_joints(robot):
    groups = {group.get("name"): [j.get("name") for j in group] for group in robot.findall("group")}
    moving = [joint.name for joint in MECHANISM.moving]
    assert groups == {"mechanism": moving, "actuators": list(MECHANISM.actuated)}
    passive = [joint.get("name") for joint in robot.findall("passive_joint")]
    assert sorted(passive + groups["actuators"]) == sorted(moving)
    (state,) = robot.findall("group_state")
    assert {joint.get("name") for joint in state} == set(groups[state.get("group")])


def test_every_name_is_in_the_urdf(robot):
    assert robot.get("name") == MECHANISM.name
    joints = {joint.name for joint in MECHANISM.joints}
    for element in robot.iter():
        for attribute in ("link1", "link2", "child_link"):
            assert element.get(attribute, "base_link") in LINKS
        if element.tag in ("joint", "passive_joint"):
            assert element.get("name") in joints


def test_root_is_fixed_to_the_world(robot):
    (joint,) = robot.findall("virtual_joint")
    assert (joint.get("type"), joint.get("child_link")) == ("fixed", MECHANISM.links[0].name)


@pytest.mark.parametrize("parameters", [SOLIDS, of_solids(Geometry(0.3, 0.75, 1.2, 0.15))])
def test_other_machines_have_the_same_semantics(parameters):
    assert srdf(description.with_masses(description.describe(parameters))) == srdf(MECHANISM)
    assert srdf(description.describe(parameters)) == srdf(MECHANISM)


def test_names_are_escaped_and_closures_without_markers_work():
    odd = "<a & \"b\" 'c'>: é --"
    limits = JointLimits(-1.0, 1.0, 1.0, 1.0)
    joints = (
        Joint("one", "revolute", "root", odd, Placement(), [0, 0, 1], limits),
        Joint("two", "revolute", "root", "other", Placement(), [0, 0, 1], limits),
    )
    links = (Link("root"), Link(odd), Link("other"))
    mechanism = Mechanism(odd, links, joints, (Closure("k", odd, "other"),), ("one",), np.zeros(3))
    root = ET.fromstring(srdf(mechanism))  # noqa: S314
    assert root.get("name") == odd
    pairs = [(pair.get("link1"), pair.get("link2")) for pair in root.findall("disable_collisions")]
    assert pairs == [("root", odd), ("root", "other"), (odd, "other")]
    model = pin.buildModelFromXML(description.urdf(mechanism))
    pin.loadReferenceConfigurationsFromXML(model, srdf(mechanism))
    np.testing.assert_array_equal(model.referenceConfigurations["home"], np.zeros(2))


def test_without_closures_only_joints_make_neighbours():
    root = ET.fromstring(srdf(replace(MECHANISM, closures=())))  # noqa: S314
    assert len(root.findall("disable_collisions")) == len(MECHANISM.moving)
