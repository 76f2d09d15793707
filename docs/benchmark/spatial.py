"""The benchmark's robots that move in space; their dimensions are our own."""

from __future__ import annotations

from building import GROUND, Build, around


def bennett():
    """Bennett's linkage: four skewed hinges, mobile by exact dimensions only."""
    b = Build(size=2.0)
    b.link("link_1", GROUND, (0, 0, 0), "z", (0.3, 0, 0))
    b.link("link_2", "link_1", (0.3, 0, 0), (0, -0.6, 0.8), (-0.1, 0, 0))
    b.link("link_3", "link_2", (-0.1, 0, 0), (0, 0.28, 0.96), (-0.4, 0, 0))
    b.hinge("link_3", GROUND, (-0.4, 0, 0), (0, 0.8, 0.6))
    return b.drive("link_1", kinds=["overconstrained"])


def bricard():
    """Bricard's linkage along six edges of a cube, mobile by exact dimensions only."""
    b = Build(force=2)
    corners = [(0, 0, 0), (0.4, 0, 0), (0.4, 0.4, 0), (0.4, 0.4, 0.4), (0, 0.4, 0.4), (0, 0, 0.4)]
    last = GROUND
    for k, axis in enumerate("yzxyz"):
        last = b.link(f"link_{k + 1}", last, corners[k], axis, corners[k + 1])
    b.hinge(last, GROUND, corners[5], "x")
    return b.drive("link_1", kinds=["overconstrained"])


def sarrus():
    """Sarrus' linkage: two pairs of plates lift a platform straight up."""
    b = Build(force=5)
    b.link("lower_1", GROUND, (0.3, 0, 0), "y", (0.5, 0, 0.3))
    b.link("upper_1", "lower_1", (0.5, 0, 0.3), "y", (0.3, 0, 0.6))
    b.link("platform", "upper_1", (0.3, 0, 0.6), "y", (0, 0.3, 0.6), mass=3.0, thick=0.2)
    b.link("lower_2", GROUND, (0, 0.3, 0), "x", (0, 0.5, 0.3))
    b.link("upper_2", "lower_2", (0, 0.5, 0.3), "x", (0, 0.3, 0.6))
    b.hinge("upper_2", "platform", (0, 0.3, 0.6), "x")
    return b.drive("lower_1", kinds=["overconstrained"])


def _shell(b, name, parent, axis, one, other, mass=0.8):
    """Add a body that turns about an axis through the origin, and reaches from one direction to another."""
    b.link(
        name,
        parent,
        (0, 0, 0),
        axis,
        [round(0.1 * (x + y), 4) for x, y in zip(one, other, strict=True)],
        mass=mass,
    )


def spherical_four_bar():
    """Spherical four-bar linkage: all four axes meet in a point."""
    b = Build()
    axes = [(0, 0, 1), (0.6, 0, 0.8), (0.48, 0.64, 0.6), (0, 0.8, 0.6)]
    last = GROUND
    for k in range(3):
        _shell(b, f"link_{k + 1}", last, axes[k], axes[k], axes[k + 1])
        last = f"link_{k + 1}"
    b.hinge(last, GROUND, (0, 0, 0), axes[3])
    return b.drive("link_1", kinds=["overconstrained"])


def spherical_wrist():
    """Wrist on three legs whose nine axes meet in a point, 3-RRR."""
    b = Build(size=0.8)
    axes = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
    for k, (base, middle, end) in enumerate(("xyz", "yzx", "zxy"), 1):
        _shell(b, f"inner_{k}", GROUND, base, axes[base], axes[middle])
        _shell(b, f"outer_{k}", f"inner_{k}", middle, axes[middle], axes[end])
        if k == 1:
            _shell(b, "platform", "outer_1", end, axes[end], (0.6, 0.4, 0.2), mass=1.5)
        else:
            b.hinge(f"outer_{k}", "platform", (0, 0, 0), end)
    return b.drive("inner_1", "inner_2", "inner_3", kinds=["overconstrained"])


def delta():
    """Delta robot: three arms, six rods with universal joints and ball ends."""
    b = Build(size=0.6, force=2)
    b.floating("platform", (0, 0, -0.6), mass=0.8)
    for k in range(3):
        turn = 120 * k
        foot, elbow = around(0.15, turn), around(0.35, turn, -0.08)
        b.link(f"arm_{k + 1}", GROUND, foot, around(1, turn + 90), elbow)
        for side, shift in (("left", -0.05), ("right", 0.05)):
            dx, dy, _ = around(shift, turn + 90)
            top = (round(elbow[0] + dx, 6), round(elbow[1] + dy, 6), elbow[2])
            corner = around(0.05, turn, -0.6)
            end = (round(corner[0] + dx, 6), round(corner[1] + dy, 6), corner[2])
            rod = b.turns(
                f"{side}_rod_{k + 1}", f"arm_{k + 1}", top, [around(1, turn + 90), around(1, turn)], end, 0.1
            )
            b.point(rod, "platform", end)
    return b.drive("arm_1", "arm_2", "arm_3")


def linear_delta():
    """Linear Delta robot: three upright sliders, six rods without mass."""
    b = Build(size=0.6, force=20)
    b.floating("platform", (0, 0, 0.2), mass=1.2)
    for k in range(3):
        turn = 120 * k
        b.slide(f"slider_{k + 1}", GROUND, around(0.4, turn, 0.6), "z", 0.9)
        for shift in (-0.06, 0.06):
            dx, dy, _ = around(shift, turn + 90)
            ends = []
            for radius, z in ((0.4, 0.6), (0.1, 0.2)):
                x, y, _ = around(radius, turn)
                ends.append((round(x + dx, 6), round(y + dy, 6), z))
            b.distance(f"slider_{k + 1}", ends[0], "platform", ends[1], 0.5)
    return b.drive("slider_1", "slider_2", "slider_3")


def _hexapod(b, screws=False):
    b.floating("platform", (0, 0, 0.5), mass=6.0, thick=0.3)
    drives = []
    for k in range(6):
        pair, side = divmod(k, 2)
        foot = around(0.4, 120 * pair + (20 if side else -20))
        corner = around(0.2, 120 * pair + (45 if side else -45), 0.5)
        along = [c - f for c, f in zip(corner, foot, strict=True)]
        middle = [round(f + 0.5 * d, 6) for f, d in zip(foot, along, strict=True)]
        lower = b.turns(f"lower_{k + 1}", GROUND, foot, ["x", "y"], middle, 1.0)
        axis = [round(x, 6) for x in along]
        upper = b.link(f"upper_{k + 1}", lower, middle, axis, corner, kind="prismatic", mass=0.7)
        b.point(upper, "platform", corner)
        if screws:
            b.link(f"screw_{k + 1}", lower, foot, axis, middle, kind="revolute", mass=0.4)
            b.gear(upper, f"screw_{k + 1}", 0.0008)
        drives.append(f"screw_{k + 1}" if screws else upper)
    free = [f"platform_{name}" for name in ("x", "y", "z", "rz", "ry")] + ["platform"]
    return b.drive(*drives, given=free if screws else (), kinds=["ill-conditioned"] if screws else ())


def stewart():
    """Stewart platform, 6-UPS."""
    return _hexapod(Build(size=0.4, force=20))


def hexapod_screws():
    """Stewart platform whose cylinders are screws with turning motors."""
    b = Build(size=0.4, force=0.02)
    return _hexapod(b, screws=True)


def upu_3():
    """Platform on three telescopes with universal joints at both ends, 3-UPU; it does not turn."""
    b = Build(size=0.4, force=20)
    for k in range(3):
        turn = 120 * k + 10
        foot, corner = around(0.4, turn), around(0.15, turn, 0.5)
        along = [round(c - f, 6) for c, f in zip(corner, foot, strict=True)]
        middle = [round((f + c) / 2, 6) for f, c in zip(foot, corner, strict=True)]
        side = around(1, turn + 90)
        across = [  # at right angles to the leg and to the first axis
            round(side[1] * along[2] - side[2] * along[1], 6),
            round(side[2] * along[0] - side[0] * along[2], 6),
            round(side[0] * along[1] - side[1] * along[0], 6),
        ]
        lower = b.turns(f"lower_{k + 1}", GROUND, foot, [side, across], middle, 1.0)
        upper = b.link(f"upper_{k + 1}", lower, middle, along, corner, kind="prismatic", mass=0.7)
        end = b.link(f"cross_{k + 1}", upper, corner, across, mass=0.05)
        if k == 0:
            b.link("platform", end, corner, side, (0, 0, 0.55), mass=3.0, thick=0.2)
        else:
            b.hinge(end, "platform", corner, side)
    return b.drive("upper_1", "upper_2", "upper_3")


def rps_3():
    """Platform on three telescopes, hinges below and balls above, 3-RPS."""
    b = Build(size=0.4, force=20)
    for k in range(3):
        turn = 120 * k
        foot, corner = around(0.4, turn), around(0.25, turn, 0.6)
        along = [round(c - f, 6) for c, f in zip(corner, foot, strict=True)]
        middle = [round((f + c) / 2, 6) for f, c in zip(foot, corner, strict=True)]
        lower = b.link(f"lower_{k + 1}", GROUND, foot, around(1, turn + 90), middle)
        upper = b.link(f"upper_{k + 1}", lower, middle, along, corner, kind="prismatic")
        if k == 0:
            b.turns("platform", upper, corner, ["x", "y", "z"], (0, 0, 0.62), 4.0)
        else:
            b.point(upper, "platform", corner)
    return b.drive("upper_1", "upper_2", "upper_3")


def orthoglide():
    """Three sliders at right angles, each with a pair of rods, as the Orthoglide."""
    b = Build(size=0.5, force=20)
    b.floating("platform", (0, 0, 0), mass=0.8)
    for k, axis in enumerate("xyz"):

        def turned(along, across, k=k):
            point = [0.0, 0.0, 0.0]
            point[k], point[(k + 1) % 3] = along, across
            return point

        slider = b.slide(f"slider_{axis}", GROUND, turned(-0.5, 0.0), axis, 0.9)
        for side, shift in (("left", -0.05), ("right", 0.05)):
            top, end = turned(-0.5, shift), turned(-0.05, shift)
            rod = b.turns(
                f"{side}_rod_{axis}", slider, top, ["xyz"[(k + 1) % 3], "xyz"[(k + 2) % 3]], end, 0.15
            )
            b.point(rod, "platform", end)
    return b.drive("slider_x", "slider_y", "slider_z")


def tricept():
    """Three telescopes and a passive leg in the middle, as the Tricept."""
    b = Build(size=0.4, force=50)
    b.turns("sleeve", GROUND, (0, 0, 0), ["x", "y"], (0, 0, -0.4), 4.0)
    b.link("platform", "sleeve", (0, 0, -0.4), "z", (0, 0, -0.9), kind="prismatic", mass=6.0)
    for k in range(3):
        foot, corner = around(0.45, 120 * k + 30, 0.05), around(0.15, 120 * k + 30, -0.75)
        along = [round(c - f, 6) for c, f in zip(corner, foot, strict=True)]
        middle = [round((f + c) / 2, 6) for f, c in zip(foot, corner, strict=True)]
        lower = b.turns(f"lower_{k + 1}", GROUND, foot, ["x", "y"], middle, 2.0)
        upper = b.link(f"upper_{k + 1}", lower, middle, along, corner, kind="prismatic", mass=1.5)
        b.point(upper, "platform", corner)
    return b.drive("upper_1", "upper_2", "upper_3")


def differential():
    """Bevel gear differential on a carrier, a reducer at one side; couplings only."""
    b = Build(force=2)
    b.link("carrier", GROUND, (0, 0, 0.3), "x", (0, 0, 0.4), mass=1.2)
    b.link("tool", "carrier", (0, 0, 0.3), "z", (0.15, 0.05, 0.35), kind="revolute", mass=0.8)
    b.link("left_side", "carrier", (-0.05, 0, 0.3), "x", (-0.1, 0, 0.3), kind="revolute", mass=0.3)
    b.link("right_side", "carrier", (0.05, 0, 0.3), "x", (0.1, 0.02, 0.3), kind="revolute", mass=0.3)
    b.link("motor", "carrier", (-0.1, 0, 0.25), "x", (-0.16, 0, 0.25), kind="revolute", mass=0.2)
    b.gear("left_side", "tool", 1.5)
    b.gear("right_side", "tool", -1.5)
    b.gear("motor", "left_side", -8.0)
    return b.drive("carrier", "motor", given=["carrier", "tool"])


def _ankle(b, parent, heel, side=""):
    """Add a foot on a universal joint at the heel of a shank, moved by two cranks and rods."""
    x, y, z = heel
    at = lambda dx, dy, dz: (round(x + dx, 6), round(y + dy, 6), round(z + dz, 6))  # noqa: E731 - shorter
    b.turns(f"{side}foot", parent, heel, ["y", "x"], at(0.06, 0, -0.06), 1.0)
    cranks = []
    for name, dy in (("inner", -0.04), ("outer", 0.04)):
        crank = b.link(f"{side}{name}_crank", parent, at(0, dy, 0.2), "y", at(-0.05, dy, 0.2), mass=0.2)
        rod = b.turns(f"{side}{name}_rod", crank, at(-0.05, dy, 0.2), ["y", "x"], at(-0.06, dy, 0.02), 0.1)
        b.point(rod, f"{side}foot", at(-0.06, dy, 0.02))
        cranks.append(crank)
    return cranks


def ankle():
    """Ankle of a humanoid: two upright sliders move a foot by rods."""
    b = Build(size=0.4, force=20)
    b.turns("foot", GROUND, (0, 0, 0), ["y", "x"], (0.08, 0, -0.06), 1.2)
    for name, dy in (("inner", -0.04), ("outer", 0.045)):
        slider = b.slide(f"{name}_slider", GROUND, (-0.05, dy, 0.25), "z", 0.3)
        rod = b.turns(f"{name}_rod", slider, (-0.05, dy, 0.25), ["y", "x"], (-0.06, dy, 0.02), 0.15)
        b.point(rod, "foot", (-0.06, dy, 0.02))
    return b.drive("inner_slider", "outer_slider")


def _leg(b, hip, parent, side=""):
    """Add a leg with six motors: three in the hip, one that moves the knee by a rod, two for the ankle."""
    x, y, z = hip
    at = lambda dx, dz: (round(x + dx, 6), y, round(z + dz, 6))  # noqa: E731 - shorter
    b.link(f"{side}hip_yaw", parent, hip, "z", mass=0.5)
    b.link(f"{side}hip_roll", f"{side}hip_yaw", hip, "x", mass=0.5)
    thigh = b.link(f"{side}thigh", f"{side}hip_roll", hip, "y", at(0.1, -0.38), mass=4.0)
    shank = b.link(f"{side}shank", thigh, at(0.1, -0.38), "y", at(0, -0.76), mass=2.0)
    b.link(f"{side}knee_crank", thigh, at(0.02, -0.1), "y", at(-0.04, -0.12), mass=0.2)
    b.link(f"{side}knee_rod", f"{side}knee_crank", at(-0.04, -0.12), "y", at(0.04, -0.4), mass=0.2)
    b.point(f"{side}knee_rod", shank, at(0.04, -0.4))
    cranks = _ankle(b, shank, at(0, -0.76), side)
    return [f"{side}hip_yaw", f"{side}hip_roll", thigh, f"{side}knee_crank", *cranks]


def humanoid_leg():
    """Leg of a humanoid: rods move knee and ankle."""
    b = Build(size=0.3, force=5)
    motors = _leg(b, (0, 0, 0.85), GROUND)
    given = ["hip_yaw", "hip_roll", "thigh", "shank", "foot_1", "foot"]
    return b.drive(*motors, given=given)


def biped():
    """Humanoid on both feet: a trunk on two such legs, twelve motors for six freedoms."""
    b = Build(size=0.15, force=10)
    b.floating("trunk", (0, 0, 0.9), (0.02, 0, 1.3), mass=20.0, thick=0.25)
    motors = []
    for side, y in (("left_", 0.09), ("right_", -0.09)):
        motors += _leg(b, (0, y, 0.85), "trunk", side)
        b.weld(f"{side}foot", GROUND, (0.02, y, 0.0))
    free = [f"trunk_{name}" for name in ("x", "y", "z", "rz", "ry")] + ["trunk"]
    return b.drive(*motors, given=free, kinds=["redundantly actuated"])


SPATIAL = (
    bennett, bricard, sarrus, spherical_four_bar, spherical_wrist, delta, linear_delta, orthoglide, stewart,
    hexapod_screws, upu_3, rps_3, tricept, differential, ankle, humanoid_leg, biped,
)  # fmt: skip
