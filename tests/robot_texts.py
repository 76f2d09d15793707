"""Texts of robots' files, with one trait each that tests read."""

from __future__ import annotations

import closed_loop_robots as robots


def chain(extra="", first="", second=""):
    """Two rods on hinges, with something more in the file."""
    return robots.robot(
        robots.link("base"),
        robots.link("upper", robots.ROD),
        robots.link("lower", robots.BAR),
        robots.joint("shoulder", "base", "upper").replace("</joint>", f"{first}</joint>"),
        robots.joint("elbow", "upper", "lower", (0.4, 0, 0)).replace("</joint>", f"{second}</joint>"),
        extra,
    )


LOOP = (
    '<loop name="ring" type="{kind}"><predecessor link="{a}"><origin xyz="0.4 0 0" rpy="0 0.3 0"/>'
    "</predecessor>"
    '<successor link="base"><origin xyz="0.5 0 0"/></successor><axis xyz="{axis}"/></loop>'
)


def loop(kind="revolute", a="lower", axis="0 1 0"):
    return LOOP.format(kind=kind, a=a, axis=axis)


ROTOR = robots.link("rotor", robots.ROD) + robots.joint("rotor_joint", "base", "rotor")
GEAR = (
    '<coupling name="gear" type="rolling"><predecessor link="upper"/><successor link="rotor"/>'
    '<ratio value="6"/></coupling>'
)
BALL = (
    '<drake:ball_constraint><drake:ball_constraint_body_A name="lower"/>'
    '<drake:ball_constraint_p_AP value="0.4 0 0"/>'
    '<drake:ball_constraint_body_B name="base"/></drake:ball_constraint>'
)
LOOP_JOINT = (
    '<loop_joint name="ring" type="{}"><link1 link="lower" xyz="0.4 0 0"/><link2 link="base"/></loop_joint>'
)
GAZEBO = (
    '<gazebo><joint name="c" type="{}"><parent>base</parent><child>lower</child><pose>0.4 0 0 0 0 0</pose>'
    "<axis><xyz>0 1 0</xyz></axis></joint></gazebo>"
)
TRANSMISSION = (
    '<transmission name="drive"><type>transmission_interface/SimpleTransmission</type><joint name="{}">'
    '<hardwareInterface>EffortJointInterface</hardwareInterface></joint><actuator name="motor">'
    "<mechanicalReduction>50</mechanicalReduction></actuator></transmission>"
)
CONTROL = (
    '<ros2_control name="arm" type="system"><hardware><plugin>mock</plugin></hardware><joint name="{}">'
    '<command_interface name="effort"/><state_interface name="position"/></joint><joint name="elbow">'
    '<state_interface name="position"/></joint></ros2_control>'
)
QUIET = """
<material name="red"><color rgba="1 0 0 1"/></material>
<gazebo reference="upper"><mu1>0.2</mu1><material>Gazebo/Red</material><selfCollide>true</selfCollide>
  <sensor name="c" type="contact"><contact><collision>lower</collision></contact>
  <plugin name="p" filename="libx.so"><bodyName>upper</bodyName><frameName>lower</frameName></plugin></sensor>
</gazebo>
<drake:collision_filter_group name="g"><drake:member link="upper"/><drake:member link="lower"/>
</drake:collision_filter_group>
<sensor name="imu" type="imu"><parent link="lower"/></sensor>
<mujoco><compiler discardvisual="true"/></mujoco>
"""
INSIDE = '<safety_controller k_velocity="1"/><calibration rising="0"/>'
RATE = """
<gazebo>
  <plugin filename="libgazebo_ros_control.so" name="control"><loop_rate>1000</loop_rate></plugin>
  <sensor name="imu" type="imu"><plugin name="imu"><constraint_loop>1</constraint_loop></plugin></sensor>
</gazebo>"""
MIMIC = """
<gazebo>
  <plugin filename="libroboticsgroup_upatras_gazebo_mimic_joint_plugin.so" name="{name}">
    <joint>shoulder</joint><mimicJoint>elbow</mimicJoint><multiplier>-1.0</multiplier>
  </plugin>
</gazebo>"""
BUSHING = """
<drake:linear_bushing_rpy>
  <drake:bushing_frameA name="lower"/><drake:bushing_frameC name="base"/>
  <drake:bushing_force_stiffness value="3e4 3e4 3e4"/>
</drake:linear_bushing_rpy>"""
SRDF = (
    '<robot name="robot"><group_state name="home" group="arm"><joint name="shoulder" value="0.5"/>'
    "</group_state>"
    '<group_state name="bent" group="arm"><joint name="shoulder" value="0.1"/><joint name="elbow" value="1"/>'
    "</group_state></robot>"
)


GEARS = {"joint": "wheel", "on": "motor", "coefficients": [0, -1.5], "name": "gears", "others": {"ring": 2}}
FULL = {
    "closed_loop": [["a", "b"], ["c", "d"]],
    "type": ["hinge", "distance"],
    "name_mot": ["motor"],
    "length": [None, 0.5],
    "coupling": [GEARS, {"joint": "brake", "coefficients": [0.2]}],
    "reference": {"motor": 0.25, "ball": [0, 0, 0, 1]},
    "joint_name": ["hip"],
    "joint_type": ["SPHERICAL"],
    "joint_data": [
        {"joint": "hip", "stiffness": -2, "rest": -0.5, "damping": "1e-3", "force": -3},
        {"joint": "knee", "friction": 0.1, "armature": 0.01, "rotor_inertia": "4e-6", "gear_ratio": -50},
        {"joint": "ball", "stiffness": 1, "rest": [0, 0, "0", 1]},
    ],
    "bushings": [
        {"frames": ["a", "d"], "stiffness": [1, 2, "3e2", 0, 0, 0.5], "damping": [1, 0, 0, 0, 0, 2]},
        {"frames": ["b", "c"], "name": "mount"},
    ],
}
