"""Texts of MuJoCo's robots: tendons, a gripper whose motor pulls at two joints."""

from __future__ import annotations

import pytest

mujoco = pytest.importorskip("mujoco")

FINGER = """
  <body name="{0}_driver" pos="0 {1} 0.05" euler="0 0 {2}">
    <joint name="{0}_driver" class="driver"/>
    <inertial pos="0 0.02 0" mass="0.01" diaginertia="2e-6 2e-6 4e-7"/>
    <body name="{0}_coupler" pos="0 0.03 -0.004">
      <joint name="{0}_coupler"/><inertial pos="0 0.003 0.02" mass="0.014" diaginertia="4e-6 3.5e-6 9e-7"/>
    </body>
  </body>
  <body name="{0}_link" pos="0 {3} 0.06" euler="0 0 {2}">
    <joint name="{0}_link" class="spring"/>
    <inertial pos="0 0.02 0.02" mass="0.02" diaginertia="9e-6 7e-6 3e-6"/>
    <body name="{0}_tip" pos="0 0.055 0.0375">
      <joint name="{0}_tip" pos="0 -0.018 0.0065"/>
      <inertial pos="0 -0.01 0.01" mass="0.0125" diaginertia="3e-6 2e-6 1e-6"/>
      <body name="{0}_pad" pos="0 -0.019 0.0135"><geom type="mesh" mesh="pad"/></body>
    </body>
  </body>
"""
GRIPPER = f"""
<mujoco model="gripper">
  <compiler angle="degree" autolimits="true" meshdir="assets"/>
  <asset><mesh name="pad" file="pad.stl"/><mesh name="mount" file="mount.stl"/></asset>
  <default>
    <joint axis="1 0 0"/>
    <default class="driver"><joint range="0 45" armature="0.005" damping="0.1"/></default>
    <default class="spring"><joint stiffness="0.05" springref="150" damping="0.00125"/></default>
  </default>
  <worldbody>
    <body name="mount"><geom type="mesh" mesh="mount"/>
      {FINGER.format("right", 0.03, 0, 0.013)}{FINGER.format("left", -0.03, 180, -0.013)}
    </body>
  </worldbody>
  <tendon>
    <fixed name="split">
      <joint joint="right_driver" coef="0.5"/><joint joint="left_driver" coef="0.25"/>
    </fixed>
  </tendon>
  <equality>
    <connect anchor="0 0.01 0" body1="right_tip" body2="right_coupler"/>
    <connect anchor="0 0.01 0" body1="left_tip" body2="left_coupler"/>
    <joint joint1="right_driver" joint2="left_driver" polycoef="0 1 0.3 0 0"/>
  </equality>
  <actuator><motor name="fingers" tendon="split" gear="2"/></actuator>
</mujoco>
"""
TENDONS = """
<mujoco model="tendons">
  <worldbody>
    <site name="wall" pos="0.3 0.1 0.9"/>
    <body name="a" pos="0 0 1">
      <joint name="one" axis="0 1 0" ref="0.2"/><geom type="capsule" size="0.02 0.1" pos="0 0 -0.1"/>
      <body name="b" pos="0 0 -0.2">
        <joint name="two" axis="1 1 0"/><geom type="capsule" size="0.02 0.1" pos="0 0 -0.1"/>
        <body name="c" pos="0 0 -0.2">
          <joint name="three" axis="0 1 0" ref="-0.1"/><geom type="capsule" size="0.02 0.1" pos="0 0 -0.1"/>
          <site name="tip" pos="0 0 -0.2"/>
        </body>
      </body>
    </body>
    <body name="d" pos="1 0 1"><joint name="four" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/></body>
    <body name="e" pos="2 0 1"><joint name="five" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/></body>
    <body name="f" pos="2 0 1">
      <joint name="six" type="slide" axis="0 1 0" ref="0.3"/><joint name="seven" axis="0 1 0"/>
      <geom size="0.1"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rod"><site site="wall"/><site site="tip"/></spatial>
    <fixed name="sum"><joint joint="four" coef="2"/><joint joint="five" coef="-0.5"/></fixed>
    <fixed name="slide"><joint joint="six" coef="3"/></fixed>
    <fixed name="line"><joint joint="four" coef="1"/><joint joint="seven" coef="1.5"/></fixed>
    <fixed name="pulled" stiffness="3" springlength="0.4" damping="0.2" frictionloss="0.1" {tendon}>
      <joint joint="one" coef="0.7"/><joint joint="three" coef="-1.1"/>
    </fixed>
  </tendon>
  <equality>
    <tendon tendon1="rod" polycoef="0.05"/>
    <tendon tendon1="sum" tendon2="slide" polycoef="0.1 0.2 0.3"/>
    <tendon tendon1="line" tendon2="sum" polycoef="0.1 0.4"/>
  </equality>
  <actuator>
    <motor joint="one" gear="3" {armature}/><motor name="pull" tendon="pulled" gear="2"/>
  </actuator>
</mujoco>
"""
NEWEST = mujoco.MjModel.from_xml_string("<mujoco/>")
TENDONS = TENDONS.replace("{tendon}", 'armature="0.3"' if hasattr(NEWEST, "tendon_armature") else "")


def without_meshes(xml: str) -> str:
    lines = xml.replace('<mesh name="pad" file="pad.stl"/><mesh name="mount" file="mount.stl"/>', "")
    return lines.replace('<geom type="mesh" mesh="pad"/>', "").replace('<geom type="mesh" mesh="mount"/>', "")
