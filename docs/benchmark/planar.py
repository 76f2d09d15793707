"""The benchmark's robots that move in a plane; their dimensions are our own."""

from __future__ import annotations

from math import cos, pi, sin

from building import GROUND, Build, flat, upright


def four_bar():
    """Four-bar linkage, a crank and a rocker."""
    b = Build(force=2)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.06, 0.08))
    b.link("coupler", "crank", flat(0.06, 0.08), "y", flat(0.38, 0.3))
    b.link("rocker", GROUND, flat(0.4, 0), "y", flat(0.38, 0.3))
    b.point("coupler", "rocker", flat(0.38, 0.3))
    return b.drive("crank")


def slider_crank():
    """Slider-crank with an offset."""
    b = Build(force=2)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.06, 0.08))
    b.link("rod", "crank", flat(0.06, 0.08), "y", flat(0.4, 0.02))
    b.slide("piston", GROUND, flat(0.4, 0.02), "x", 1.5)
    b.point("rod", "piston", flat(0.4, 0.02))
    return b.drive("crank")


def _five_bar(c=(0.0, 0.45), masses=(None, None), **more):
    b = Build(**more)
    elbows = {"left": (-0.1, -0.25), "right": (0.1, 0.25)}
    for side, (foot, elbow) in elbows.items():
        b.link(f"{side}_arm", GROUND, flat(foot, 0), "y", flat(elbow, 0.2), mass=masses[0])
        b.link(f"{side}_rod", f"{side}_arm", flat(elbow, 0.2), "y", flat(*c), mass=masses[1])
    b.point("left_rod", "right_rod", flat(*c))
    return b


def five_bar():
    """Five-bar linkage, two motors."""
    b = _five_bar(force=2)
    return b.drive("left_arm", "right_arm")


def watt_six_bar():
    """Watt's six-bar linkage: two four-bars, the rocker of one drives the other."""
    b = Build(force=2)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.05, 0.12))
    b.link("coupler", "crank", flat(0.05, 0.12), "y", flat(0.33, 0.2))
    b.link("rocker", GROUND, flat(0.3, 0), "y", flat(0.33, 0.2))
    b.link("second_coupler", "rocker", flat(0.38, 0.12), "y", flat(0.68, 0.25))
    b.link("second_rocker", GROUND, flat(0.7, 0), "y", flat(0.68, 0.25))
    b.point("coupler", "rocker", flat(0.33, 0.2))
    b.point("second_coupler", "second_rocker", flat(0.68, 0.25))
    return b.drive("crank")


def stephenson_six_bar():
    """Stephenson's six-bar linkage: the coupler of a four-bar drives a rocker."""
    b = Build(force=2)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.05, 0.1))
    b.link("coupler", "crank", flat(0.05, 0.1), "y", flat(0.4, 0.25))
    b.link("rocker", GROUND, flat(0.42, 0), "y", flat(0.4, 0.25))
    b.link("rod", "coupler", flat(0.25, 0.4), "y", flat(0.6, 0.45))
    b.link("output", GROUND, flat(0.7, 0.1), "y", flat(0.6, 0.45))
    b.point("coupler", "rocker", flat(0.4, 0.25))
    b.point("rod", "output", flat(0.6, 0.45))
    return b.drive("crank")


def pantograph():
    """Pantograph: a parallelogram, whose point follows another one at scale."""
    b = Build(force=3)
    b.link("lower", GROUND, flat(0, 0), "y", flat(0.2, 0.4))
    b.link("upper", "lower", flat(0.2, 0.4), "y", flat(0.7, 0.1))
    b.link("left_side", "lower", flat(0.1, 0.2), "y", flat(0.35, 0.05))
    b.link("right_side", "upper", flat(0.45, 0.25), "y", flat(0.35, 0.05))
    b.point("left_side", "right_side", flat(0.35, 0.05))
    return b.drive("lower", "upper")


def scott_russell():
    """Scott-Russell mechanism: the end of the bar moves on a straight line."""
    b = Build(force=20)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.3, 0.4))
    b.slide("slider", GROUND, flat(0.6, 0), "x")
    b.link("bar", "slider", flat(0.6, 0), "y", flat(0, 0.8))
    b.hinge("bar", "crank", flat(0.3, 0.4), "y")
    return b.drive("slider", kinds=["overconstrained"])


def scissor_lift():
    """Scissor lift of six stages, all pins hinges of five rows each."""
    b = Build(size=0.4, force=100)
    w, h, stages = 0.6, 0.3, 6
    b.slide("slider", GROUND, flat(w, 0), "x")
    left, right = GROUND, "slider"
    for k in range(stages):
        z, up = round(k * h, 6), round((k + 1) * h, 6)
        a = b.link(f"bar_a{k + 1}", left, flat(0, z), "y", flat(w, up))
        c = b.link(f"bar_b{k + 1}", right, flat(w, z), "y", flat(0, up))
        b.hinge(a, c, flat(w / 2, round((k + 0.5) * h, 6)), "y")
        left, right = c, a
    return b.drive("slider", kinds=["overconstrained"])


def _platform(b, name, feet, elbows, corners, slider=None):
    """Add the legs of a planar platform about (0, 0); the first one carries it."""
    for k, (foot, elbow, corner) in enumerate(zip(feet, elbows, corners, strict=True), 1):
        if slider:
            b.slide(f"slider_{k}", GROUND, elbow, slider[k - 1])
        else:
            b.link(f"arm_{k}", GROUND, foot, "y", elbow)
        b.link(f"rod_{k}", f"slider_{k}" if slider else f"arm_{k}", elbow, "y", corner)
        if k == 1:
            b.link(name, "rod_1", corner, "y", corners[-1], mass=2.0)
        else:
            b.point(f"rod_{k}", name, corner)


def _legs(count, radius, small):
    angles = [90 + 360 * k / count for k in range(count)]
    feet = [upright(radius, a) for a in angles]
    corners = [upright(small, a - 40) for a in angles]
    middles = [((f[0] + c[0]) / 2, (f[2] + c[2]) / 2) for f, c in zip(feet, corners, strict=True)]
    shift = [(0.16 * cos((a + 90) * pi / 180), 0.16 * sin((a + 90) * pi / 180)) for a in angles]
    elbows = [flat(round(m[0] + s[0], 4), round(m[1] + s[1], 4)) for m, s in zip(middles, shift, strict=True)]
    return feet, elbows, corners


def planar_3rrr():
    """Planar platform on three arms with motors at their feet."""
    b = Build(size=0.5, force=2)
    _platform(b, "platform", *_legs(3, 0.4, 0.1))
    return b.drive("arm_1", "arm_2", "arm_3")


def planar_3prr():
    """Planar platform on three rods from sliders."""
    b = Build(size=0.3, force=10)
    feet, elbows, corners = _legs(3, 0.4, 0.1)
    _platform(b, "platform", feet, elbows, corners, [upright(1, 90 + 120 * k + 100) for k in range(3)])
    return b.drive("slider_1", "slider_2", "slider_3")


def planar_4rrr():
    """Planar platform on four arms, a motor more than it has freedoms."""
    b = Build(size=0.5, force=2)
    _platform(b, "platform", *_legs(4, 0.45, 0.12))
    return b.drive(
        *(f"arm_{k}" for k in (1, 2, 3, 4)), given=["arm_1", "arm_2", "arm_3"], kinds=["redundantly actuated"]
    )


def parallelogram():
    """Parallelogram with three bars: one bar more than needed, by exact dimensions."""
    b = Build(force=5)
    for k, x in enumerate((0.0, 0.3, 0.7), 1):
        b.link(f"bar_{k}", GROUND, flat(x, 0), "y", flat(round(x + 0.1, 6), 0.4))
    b.link("table", "bar_1", flat(0.1, 0.4), "y", flat(0.8, 0.4), mass=3.0)
    b.hinge("table", "bar_2", flat(0.4, 0.4), "y")
    b.hinge("table", "bar_3", flat(0.8, 0.4), "y")
    return b.drive("bar_1", kinds=["overconstrained"])


def klann_leg():
    """Klann's walking leg: a crank, two rockers and a foot."""
    b = Build(size=0.3, force=2)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.1, 0.03))
    b.link("coupler", "crank", flat(0.1, 0.03), "y", flat(-0.35, 0.18))
    b.link("rocker_1", GROUND, flat(-0.22, -0.12), "y", flat(-0.14, 0.09))
    b.link("leg", "coupler", flat(-0.35, 0.18), "y", flat(-0.6, -0.4))
    b.link("rocker_2", GROUND, flat(-0.25, 0.35), "y", flat(-0.5, 0.08))
    b.point("coupler", "rocker_1", flat(-0.14, 0.09))
    b.point("leg", "rocker_2", flat(-0.5, 0.08))
    return b.drive("crank")


def strandbeest_leg():
    """Jansen's walking leg, as of the Strandbeest: a crank moves all its bars."""
    b = Build(force=2)
    m, pivot, top, side, knee, ankle = (
        flat(0.13, 0.05),
        flat(-0.36, -0.07),
        flat(-0.2, 0.36),
        flat(-0.75, 0.06),
        flat(-0.25, -0.44),
        flat(-0.62, -0.33),
    )
    b.link("crank", GROUND, flat(0, 0), "y", m)
    b.link("upper_rod", "crank", m, "y", top)
    b.link("lower_rod", "crank", m, "y", knee)
    b.link("upper_triangle", GROUND, pivot, "y", side, mass=2.0)
    b.link("swing", GROUND, pivot, "y", knee)
    b.link("side_rod", "upper_triangle", side, "y", ankle)
    b.link("foot", "lower_rod", knee, "y", flat(-0.4, -0.85), mass=1.5)
    b.point("upper_rod", "upper_triangle", top)
    b.point("lower_rod", "swing", knee)
    b.point("side_rod", "foot", ankle)
    return b.drive("crank")


def gripper():
    """Gripper: two parallel fingers, geared to each other and to one motor."""
    b = Build(size=0.5, force=0.1)
    for side, s in (("left", -1), ("right", 1)):
        b.link(f"{side}_drive", GROUND, flat(0.02 * s, 0.1), "y", flat(0.06 * s, 0.16))
        b.link(f"{side}_guide", GROUND, flat(0.01 * s, 0.06), "y", flat(0.05 * s, 0.12))
        b.link(f"{side}_finger", f"{side}_drive", flat(0.06 * s, 0.16), "y", flat(0.05 * s, 0.26))
        b.point(f"{side}_finger", f"{side}_guide", flat(0.05 * s, 0.12))
    b.link("motor", GROUND, flat(0, 0.02), "y", flat(0, 0), kind="revolute", mass=0.15)
    b.gear("right_drive", "left_drive", -1.0)
    b.gear("left_drive", "motor", 0.05)
    return b.drive("motor", given=["left_drive"])


def excavator():
    """Excavator: slew, boom, stick and bucket, three hydraulic cylinders."""
    b = Build(size=0.4, force=5000)
    b.link("cab", GROUND, (0, 0, 0.5), "z", flat(0.1, 1.2), mass=900.0, thick=1.0)
    b.link("boom", "cab", flat(0.3, 1.0), "y", flat(2.6, 2.4), mass=250.0)
    b.link("stick", "boom", flat(2.6, 2.4), "y", flat(3.3, 0.8), mass=120.0)
    b.link("bucket", "stick", flat(3.3, 0.8), "y", flat(3.0, 0.3), mass=80.0, thick=0.3)
    b.link("rocker", "stick", flat(3.2, 1.05), "y", flat(3.55, 1.1), mass=8.0)
    b.link("tie", "rocker", flat(3.55, 1.1), "y", flat(3.5, 0.78), mass=10.0)
    b.point("tie", "bucket", flat(3.5, 0.78))
    cylinders = [
        b.cylinder("boom", "cab", flat(0.6, 0.8), "boom", flat(1.5, 1.9)),
        b.cylinder("stick", "boom", flat(1.6, 2.5), "stick", flat(2.75, 2.75)),
        b.cylinder("bucket", "stick", flat(2.95, 2.2), "rocker", flat(3.55, 1.1)),
    ]
    return b.drive("cab", *cylinders, given=["cab", "boom", "stick", "rocker"])


def crane():
    """Loader crane with two cylinders and a telescope; its load swings freely."""
    b = Build(size=0.4, force=8000)
    b.link("column", GROUND, (0, 0, 0.5), "z", flat(0, 2.0), mass=300.0, thick=0.4)
    b.link("boom", "column", flat(0, 2.0), "y", flat(2.5, 2.8), mass=200.0)
    b.link("jib", "boom", flat(2.5, 2.8), "y", flat(4.2, 2.2), mass=100.0)
    b.link("telescope", "jib", flat(4.2, 2.2), flat(1.7, -0.6), flat(5.05, 1.9), kind="prismatic", mass=60.0)
    b.turns("load", "telescope", flat(5.05, 1.9), ["x", "y"], flat(5.05, 0.6), mass=150.0)
    cylinders = [
        b.cylinder("boom", "column", flat(0.2, 0.9), "boom", flat(1.0, 2.2)),
        b.cylinder("jib", "boom", flat(1.2, 2.7), "jib", flat(2.8, 2.95)),
    ]
    b.from_forces = True
    given = ["column", "boom", "jib", "telescope", "load_1", "load"]
    return b.drive("column", *cylinders, "telescope", given=given, kinds=["underactuated"])


def five_bar_near_singular():
    """Five-bar linkage whose rods are straight but for 2 µm."""
    b = _five_bar(c=(0.0, 0.200002), force=2)
    b.states = [
        {"name": "rest", "q": [0, 0], "v": [0, 0], "a": [0, 0]},
        {"name": "slow", "q": [0, 0], "v": [0.000001, 0.000002], "a": [0.001, -0.002]},
    ]
    return b.drive("left_arm", "right_arm", kinds=["ill-conditioned"])


def five_bar_singular():
    """Five-bar linkage whose rods are straight: its motors cannot hold it."""
    b = _five_bar(c=(0.0, 0.2), force=2)
    b.from_forces = True
    b.states = [{"name": "rest", "q": [0, 0], "v": [0, 0]}, {"name": "moving", "q": [0, 0], "v": [0.5, -0.8]}]
    return b.drive("left_arm", "right_arm", given=["left_arm", "left_rod"], kinds=["singular"])


def four_bar_change_point():
    """Parallelogram stretched flat, where it may turn into its other mode."""
    b = Build(force=2)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.2, 0))
    b.link("coupler", "crank", flat(0.2, 0), "y", flat(0.7, 0))
    b.link("rocker", GROUND, flat(0.5, 0), "y", flat(0.7, 0))
    b.point("coupler", "rocker", flat(0.7, 0))
    b.from_forces = True
    b.states = [
        {"name": "rest", "q": [0, 0, 0], "v": [0, 0, 0]},
        {"name": "moving", "q": [0, 0, 0], "v": [1.5, -1.5, 1.5]},
    ]
    return b.drive("crank", given=["crank", "coupler", "rocker"], kinds=["singular"])


def five_bar_mass_ratio():
    """Five-bar linkage, arms and rods of a tonne, that turns a tool of a gram: a mass ratio of 1e6."""
    b = _five_bar(masses=(1000.0, 1000.0))
    b.link("tool", "left_rod", flat(0, 0.45), "y", flat(0.03, 0.5), mass=0.001, thick=0.004)
    b.forces = [3000.0, -2000.0, 0.0001]
    return b.drive("left_arm", "right_arm", "tool", kinds=["ill-conditioned"])


def four_bar_long():
    """Four-bar linkage with a crank of 2 mm and a coupler of 8 m."""
    b = Build(force=0.5)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.0016, 0.0012))
    b.link("coupler", "crank", flat(0.0016, 0.0012), "y", flat(6, 5))
    b.link("rocker", GROUND, flat(8, 0), "y", flat(6, 5))
    b.point("coupler", "rocker", flat(6, 5))
    return b.drive("crank", kinds=["ill-conditioned"])


def four_bar_chain():
    """Eight four-bar linkages, each driven by the rocker of the one before."""
    b = Build(size=0.4, force=5)
    b.link("crank", GROUND, flat(0, 0), "y", flat(0.1, 0.2))
    last = "crank"
    for k in range(1, 9):
        x = 0.5 * k
        start, end = flat(round(x - 0.4, 6), 0.2), flat(round(x + 0.05, 6), round(0.25 - 0.01 * (k % 3), 6))
        b.link(f"coupler_{k}", last, start, "y", end)
        b.link(f"rocker_{k}", GROUND, flat(x, 0), "y", flat(round(x + 0.1, 6), 0.2))
        b.point(f"coupler_{k}", f"rocker_{k}", end)
        last = f"rocker_{k}"
    return b.drive("crank")


PLANAR = (
    four_bar, slider_crank, five_bar, watt_six_bar, stephenson_six_bar, pantograph, scott_russell,
    scissor_lift, parallelogram, planar_3rrr, planar_3prr, planar_4rrr, klann_leg, strandbeest_leg, gripper,
    excavator, crane, four_bar_chain, four_bar_long, five_bar_mass_ratio, five_bar_near_singular,
    five_bar_singular, four_bar_change_point,
)  # fmt: skip
