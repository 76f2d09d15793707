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
}
