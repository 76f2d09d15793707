"""Texts of SDF files, with one trait each that tests read."""

from __future__ import annotations


def solid(mass=1.3, com=(0.11, 0.02, -0.03), moments=(0.02, 0.003, -0.001, 0.03, 0.002, 0.04)):
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    inertia = "".join(f"<{name}>{value}</{name}>" for name, value in zip(names, moments, strict=True))
    x, y, z = com
    return (
        f"<inertial><pose>{x} {y} {z} 0.3 -0.2 0.5</pose><mass>{mass}</mass><inertia>{inertia}</inertia>"
        "</inertial>"
    )


def link(name, pose="", more="", **inertia):
    return f'<link name="{name}">{pose}{solid(**inertia)}{more}</link>'


def pose(numbers, relative="", more=""):
    where = f' relative_to="{relative}"' if relative else ""
    return f"<pose{where}{more}>{numbers}</pose>"


def joint(name, parent, child, kind="revolute", axis="0 1 0", more="", limit="", where=""):
    line = f"<axis><xyz>{axis}</xyz>{limit}</axis>" if axis else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>'
        f"{where}{line}{more}</joint>"
    )


def sdf(*parts, version="1.11", model="", name="robot"):
    return f'<sdf version="{version}"><model name="{name}" {model}>{"".join(parts)}</model></sdf>'


def effort(value):
    return f"<limit><effort>{value}</effort></limit>"


RICH = sdf(
    '<frame name="corner" attached_to="base">',
    pose("0.1 0.2 -0.3 10 20 -30", more=' degrees="true"'),
    "</frame>",
    link("base", pose("0.3 -0.2 0.5 0.1 0.2 0.3")),
    link("arm", pose("0.2 0.1 0.4 0.2 -0.5 0.1", "shoulder")),
    link("slider", pose("0.3 0.1 0.2 0.1 0.7 -0.1 0.7", "arm", ' rotation_format="quat_xyzw"'), mass=0.7),
    joint("weld", "world", "base", "fixed", axis=""),
    joint("shoulder", "corner", "arm", axis="1 2 -0.5", where=pose("0.1 0 0.2 0.3 0.1 0.2", "corner")),
    joint(
        "slide", "arm", "slider", "prismatic", axis="0 0.6 0.8", where=pose("0.1 0.2 0.3 0.2 0.1 -0.4")
    ).replace("<xyz>", '<xyz expressed_in="hand::grip">'),
    f'<model name="hand" placement_frame="grip">{pose("0.1 0.3 -0.2 0.4 0.1 0.3", "slider")}'
    f'<frame name="grip" attached_to="palm">{pose("0.02 0.1 0.05 0.3 -0.2 0.7")}</frame>'
    + link("palm", pose("0.3 0.1 0.1 0.1 0.3 0.4"), mass=0.4)
    + link("finger", pose("0.1 0 0.2 0 0.3 0", "palm"))
    + joint("knuckle", "palm", "finger", axis="0.2 1 0.4", where=pose("0 0.1 0.2 0.3 0.4 0.5", "__model__"))
    + f'<model name="tip">{pose("0 0.1 0 0.2 0 0.4", "finger")}'
    + link("nail", pose("0.1 0.2 0 0 0 0.2"))
    + "</model>"
    + joint("pad", "finger", "tip::nail", "screw", "1 0 1", "<screw_thread_pitch>0.7</screw_thread_pitch>")
    + "</model>",
    joint(
        "wrist", "slider", "hand", "universal", axis="1 0 0", where=pose("0 0 0.1 0.5 0.2 0.1", "hand::palm")
    ).replace("</joint>", "<axis2><xyz>0 1 0</xyz></axis2></joint>"),
    model='canonical_link="arm"',
)
BACKWARDS = sdf(
    link("foot", pose("0.1 0.2 0.3 0.1 0.2 0.3")),
    link("shin", pose("0.3 0.1 0.6 0.2 0.4 0.1")),
    link("thigh", pose("0.5 0.1 0.7 0.2 0.5 0.3"), mass=0.8),
    joint("knee", "thigh", "shin", axis="1 0.3 0.2", where=pose("0.1 0.2 0.1 0.3 0.1 0.2")),
    joint("ankle", "shin", "foot", "prismatic", axis="0.3 0.4 1", where=pose("0 0.2 0.1 0.3 0.1 0.2")),
    joint("weld", "world", "foot", "revolute", axis="0 0 1"),
)
FOUR_BAR = sdf(
    link("ground", mass=3),
    link("crank", pose("0 0 0 0 0.3 0"), mass=0.5),
    link("coupler", pose("0.2 0 0.1 0 -0.4 0"), mass=0.9),
    link("rocker", pose("0.5 0 0 0 0.2 0"), mass=0.6),
    joint("held", "world", "ground", "fixed", axis=""),
    joint("crank_joint", "ground", "crank", limit=effort(20)),
    joint("coupler_joint", "crank", "coupler", limit=effort(0), where=pose("0.02 0 0.01 0 0 0")),
    joint("rocker_joint", "ground", "rocker", limit=effort(0)),
    joint(
        "closing", "rocker", "coupler", limit=effort(0), where=pose("0.4 0 0.15 0.1 0.2 0.3", "__model__")
    ).replace("<xyz>", '<xyz expressed_in="__model__">'),
)
DRAKES = sdf(
    link("crank", pose("0 0 0 0 0.3 0"), mass=0.5),
    link("coupler", pose("0.2 0 0.1 0 -0.4 0"), mass=0.9),
    link("rocker", pose("0.5 0 0 0 0.2 0"), mass=0.6),
    joint("crank_joint", "world", "crank", limit=effort(20)).replace(
        "</joint>",
        "<drake:rotor_inertia>0.002</drake:rotor_inertia><drake:gear_ratio>7</drake:gear_ratio></joint>",
    ),
    joint("coupler_joint", "crank", "coupler", limit=effort(0), where=pose("0.02 0 0.01 0 0 0")),
    joint("rocker_joint", "world", "rocker", limit=effort(0)),
    "<drake:ball_constraint><drake:ball_constraint_body_A>coupler</drake:ball_constraint_body_A>"
    "<drake:ball_constraint_p_AP>0.25 0 0.1</drake:ball_constraint_p_AP>"
    "<drake:ball_constraint_body_B>rocker</drake:ball_constraint_body_B>"
    "<drake:ball_constraint_p_BQ>-0.02 0 0.2</drake:ball_constraint_p_BQ></drake:ball_constraint>",
).replace("<sdf", '<sdf xmlns:drake="http://drake.mit.edu"', 1)
GEARS = sdf(
    link("frame"),
    link("first", pose("0.1 0 0 0 0 0.2")),
    link("second", pose("0.3 0 0 0 0.1 0")),
    link("third", pose("0.5 0.1 0 0 0.1 0")),
    joint("one", "frame", "first", axis="0 0 1", limit=effort(5)),
    joint(
        "two", "second", "frame", axis="0 0 1", where=pose("0 0 0 0 0 0", "second"), limit=effort(0)
    ).replace("<xyz>", '<xyz expressed_in="__model__">'),
    joint("three", "frame", "third", axis="0 1 0", limit=effort(0)).replace(
        "</axis>",
        '<mimic joint="one" axis="axis"><multiplier>3</multiplier><offset>0.2</offset>'
        "<reference>0.5</reference></mimic>"
        "</axis>",
    ),
    joint("gear", "first", "second", "gearbox", axis="0 0 1")
    .replace("<xyz>", '<xyz expressed_in="__model__">')
    .replace(
        "</joint>",
        '<axis2><xyz expressed_in="__model__">0 0 -1</xyz></axis2><gearbox_ratio>2.5</gearbox_ratio>'
        "<gearbox_reference_body>frame</gearbox_reference_body></joint>",
    ),
)
ALL = RICH, BACKWARDS, FOUR_BAR, DRAKES, GEARS
