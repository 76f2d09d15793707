"""What public MJCFs of closed-loop robots have: tendons, rods on balls, meshes that are missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mujoco_texts import GRIPPER, NEWEST, TENDONS, without_meshes

mujoco = pytest.importorskip("mujoco")

from mujoco_opinion import agree  # noqa: E402

import p3dof  # noqa: E402
from p3dof._base.errors import ModelError, ModelWarning  # noqa: E402
from p3dof.loops.tables import units_of_actuated  # noqa: E402

LEG = """
<mujoco model="leg">
  <compiler angle="degree" autolimits="true"/>
  <default>
    <joint axis="0 1 0" damping="0.1"/><equality solref="0.005 1"/>
    <default class="spring"><joint stiffness="150" springref="10" damping="0.02"/></default>
    <default class="shown"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default>
  </default>
  <asset><mesh name="shell" file="not_there.obj"/></asset>
  <worldbody>
    <body name="hip" pos="0 0 1">
      <freejoint/>
      <inertial pos="0.01 0 0.02" mass="8" fullinertia="0.09 0.07 0.05 0.001 -0.002 0.003"/>
      <geom class="shown" mesh="shell"/>
      <body name="rod" pos="0 0.05 0.02">
        <joint name="rod" type="ball" damping="0.01"/>
        <inertial pos="0.2 0 0" mass="0.15" diaginertia="1e-5 2e-3 2e-3"/>
        <geom class="shown" mesh="shell"/>
      </body>
      <body name="thigh" pos="0.1 0 0" euler="0 20 0">
        <joint name="knee" ref="-15" range="-160 20" armature="0.05"/>
        <inertial pos="0.15 0.01 0" mass="2" diaginertia="0.002 0.02 0.02"/>
        <body name="shin" pos="0.3 0 0" euler="5 30 0">
          <joint name="ankle" class="spring"/>
          <inertial pos="0.1 0 0.02" mass="1" diaginertia="0.001 0.01 0.01"/>
          <body name="heel" pos="0.05 0.05 0.04">
            <joint name="heel" class="spring" axis="0 0 1"/>
            <inertial pos="0.02 0 0" mass="0.1" diaginertia="1e-4 2e-4 2e-4"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><connect body1="rod" body2="heel" anchor="0.35 0.01 0.02"/></equality>
  <actuator><motor name="drive" joint="knee" gear="16" ctrlrange="-5 5"/></actuator>
</mujoco>
"""


def test_a_floating_leg_with_a_rod_on_balls():
    leg = p3dof.load_robot(LEG)
    q = leg.assemble().q
    assert (leg.model.nv, leg.mobility(q)) == (12, 9)
    assert leg.sidecar.closures[0].kind == "3d"
    data = {entry.joint: entry for entry in leg.sidecar.joint_data}
    assert data["ankle"].rest == pytest.approx(np.deg2rad(10))
    for seed in range(2):
        agree(leg, LEG.replace('<mesh name="shell" file="not_there.obj"/>', "").replace(MESH, ""), seed)


MESH = '<geom class="shown" mesh="shell"/>'


def test_a_gripper_whose_motor_pulls_at_two_joints_has_a_joint_for_the_tendon():
    with pytest.warns(
        ModelWarning, match=r"missing \('pad'\): .* not in the inertia of 'right_pad', 'left_pad'$"
    ):
        gripper = p3dof.load_robot(GRIPPER)
    assert gripper.actuated == ("split",)
    assert units_of_actuated(gripper) == (("rad", "N m"),)
    assert gripper.mobility(gripper.assemble().q) == 3
    for seed in range(2):
        agree(gripper, without_meshes(GRIPPER), seed)


def test_a_mesh_that_is_there_weighs_and_one_that_is_needed_is_told(tmp_path):
    (tmp_path / "assets").mkdir()
    cube = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = ["1243", "5786", "1562", "3487", "1375", "2684"]
    text = "".join(f"v {x * 0.01} {y * 0.02} {z * 0.03}\n" for x, y, z in cube)
    text += "".join(f"f {' '.join(face)}\n" for face in faces)
    (tmp_path / "assets" / "pad.obj").write_text(text)
    (tmp_path / "robot.xml").write_text(GRIPPER.replace("pad.stl", "pad.obj"))
    gripper = p3dof.load_robot(tmp_path / "robot.xml")  # the mount stands still: its mesh is not needed
    shown = GRIPPER.replace("pad.stl", "pad.obj").replace('<geom type="mesh" mesh="mount"/>', "")
    (tmp_path / "shown.xml").write_text(shown.replace('<mesh name="mount" file="mount.stl"/>', ""))
    agree(gripper, tmp_path / "shown.xml")
    needed = GRIPPER.replace(
        '<inertial pos="0 0.02 0" mass="0.01" diaginertia="2e-6 2e-6 4e-7"/>',
        '<geom type="mesh" mesh="pad"/>',
    )
    with pytest.raises(
        ModelError, match=r"moving bodies must be .*; the files of meshes are missing \('pad'\)"
    ):
        p3dof.load_robot(needed)


def test_tendons_are_rods_couplings_and_joints():
    newer = "armature='0.02'" if hasattr(NEWEST, "actuator_armature") else ""
    xml = TENDONS.replace("{armature}", newer)
    robot = p3dof.load_robot(xml)
    assert [closure.kind for closure in robot.sidecar.closures] == ["distance"]
    assert [coupling.joint for coupling in robot.sidecar.couplings] == ["four", "seven", "pulled"]
    assert robot.actuated == ("one", "pulled")
    for seed in range(3):
        agree(robot, xml, seed)


LIFTED = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0.4 -1 -9"/>
  <worldbody>
    <body euler="0.3 -0.2 0.5">
      <body name="aslant" euler="0.1 0.4 0" gravcomp="0.7">
        <joint name="slope" type="slide" axis="1 2 3" stiffness="-20" springref="0.1" armature="2"/>
        <inertial pos="0.1 0 0.2" mass="3" diaginertia="0.1 0.1 0.1"/>
        <body name="fixed" pos="0 0 0.3" gravcomp="1.5">
          <inertial pos="0 0.1 0" mass="2" diaginertia="0.1 0.1 0.1"/>
          <body name="swinging" pos="0.2 0 0">
            <joint name="swing" axis="0 1 0"/>
            <inertial pos="0 0 -0.2" mass="1" diaginertia="0.01 0.01 0.01"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="slope"/><motor joint="swing"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("gravity", ["enable", "disable"])
def test_gravity_that_is_compensated_on_a_slide_is_a_force_of_its_joint(gravity):
    xml = LIFTED.replace("<option ", f'<option><flag gravity="{gravity}"/></option><option ')
    robot = p3dof.load_robot(xml)
    (data,) = robot.sidecar.joint_data
    assert (data.joint, data.stiffness) == ("slope", -20.0)
    assert bool(data.force) == (gravity == "enable")
    for seed in range(3):
        agree(robot, xml, seed)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ('springlength="0.4"', 'springlength="0.1 0.4"'),
            "the spring of the tendon 'pulled', which is slack",
        ),
        (('<spatial name="rod">', '<spatial name="rod" damping="1">'), "what acts in the tendon 'rod'"),
        (('<body name="a"', '<body name="a" gravcomp="1"'), "the compensation of gravity"),
        (("<worldbody>", '<option density="1.2"/><worldbody>'), "the fluid around the robot"),
        (
            (
                '<joint name="four" axis="0 1 0"/>',
                '<joint name="free" type="free" armature="1"/><geom size="0.1"/></body><body pos="1 0 1">'
                '<joint name="four" axis="0 1 0"/>',
            ),
            "that the armature of the joint 'free' is in axes of the world",
        ),
    ],
)
def test_what_acts_and_is_left_out_is_told(change, words):
    xml = TENDONS.replace("{armature}", "")
    assert change[0] in xml
    with pytest.warns(ModelWarning, match=words):
        p3dof.load_robot(xml.replace(*change))


def test_what_a_file_switches_off_is_off():
    xml = TENDONS.replace("{armature}", "").replace(
        "<worldbody>", '<option><flag gravity="disable" equality="disable"/></option><worldbody>'
    )
    robot = p3dof.load_robot(xml)
    assert robot.sidecar.closures == ()
    assert not robot.model.gravity.linear.any()


def test_tendons_that_cannot_be_followed_are_refused():
    xml = TENDONS.replace("{armature}", "")
    for wrong, message in (
        (
            '<tendon tendon1="line" tendon2="sum" polycoef="0.1 0.4 1"/>',
            "a polynomial in the length of a tendon",
        ),
        ('<tendon tendon1="rod" tendon2="sum"/>', "neither fixed nor, one alone, straight"),
    ):
        with pytest.raises(ModelError, match=message):
            p3dof.load_robot(xml.replace('<tendon tendon1="line" tendon2="sum" polycoef="0.1 0.4"/>', wrong))


def test_a_joint_may_be_named_first_in_two_equalities():
    body = '<body><joint name="{0}" axis="0 1 0" ref="0.1"/><geom size="0.1" pos="0.1 0 0"/></body>'
    tie = '<joint joint1="a" joint2="{0}" polycoef="0.2 {1}"/>'
    xml = f"""<mujoco><worldbody>{"".join(map(body.format, "abc"))}</worldbody>
      <equality>{tie.format("b", 0.5)}{tie.format("c", -2)}</equality></mujoco>"""
    robot = p3dof.load_robot(xml)
    assert [(coupling.joint, coupling.on) for coupling in robot.sidecar.couplings] == [("a", "b"), ("c", "a")]
    robot = p3dof.ClosedLoopModel(robot.model, replace(robot.sidecar, actuated=()))
    agree(robot, xml)
    assert robot.mobility(robot.assemble().q) == 1
