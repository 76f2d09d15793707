"""Robots as other people's files have them, made here; and the files themselves, where they are at hand.

The stand-ins have the traits that two public collections have. Gepetto's example-parallel-robots comes from a
CAD program: sidecars beside, closures between frames of almost no mass, joints without room between limits,
balls of three hinges between massless bodies, idle freedoms, planar loops with closures that hold six
freedoms, meshes that are missing. URDF+ of generalized_rbda has loops and rolling couplings in the file,
rotors, joints without an axis, continuous joints, bodies with inertia about one axis. Sizes are our own.

P3DOF_ROBOTS names the folder of the outside collection; without it, `shared/robots` beside the repository is
taken if it is there. Its files are further cases of the same tests.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from documents import ROOT

import p3dof
from p3dof.loops import ClosedLoopModel

UP = (np.pi / 2, 0, np.pi / 2)
"""From a plane in which a mechanism is drawn to one that stands upright."""


def numbers(values) -> str:
    return " ".join(f"{value:.17g}" for value in values)


def inertial(mass, com, inertia) -> str:
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    terms = " ".join(f'{name}="{value:.17g}"' for name, value in zip(names, inertia, strict=True))
    place = f'<mass value="{mass:.17g}"/><origin xyz="{numbers(com)}"/>'
    return f"<inertial>{place}<inertia {terms}/></inertial></link>"


def solid(name, mass, com, inertia) -> str:
    return f'<link name="{name}">' + inertial(mass, com, inertia)


def body(name: str, mass: float, length: float = 0.1) -> str:
    """A link of a CAD program: a slender body along -y and a mesh that nobody has; a mark without a mesh."""
    if mass < 1e-6:
        return solid(name, mass, (0, 0, 0), (0, 0, 0, 0, 0, 0))
    across, along = mass * length**2 / 12, mass * length**2 / 90
    mesh = f'<geometry><mesh filename="package:///{name}.stl"/></geometry>'
    return f'<link name="{name}"><visual>{mesh}</visual><collision>{mesh}</collision>' + inertial(
        mass,
        (0.003 * length, -length / 2, 0.02 * length),
        (across, 0.02 * along, 0, along, -0.01 * along, 0.97 * across),
    )


def hinge(name, parent, child, xyz=None, rpy=(0, 0, 0), axis=(0, 0, 1), room=""):
    """A revolute joint of a CAD program, whose limits leave no room, for they are not given."""
    place = "" if xyz is None else f'<origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/>'
    return (
        f'<joint name="{name}" type="revolute">{place}<parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{numbers(axis)}"/><limit effort="1" velocity="20" {room}/></joint>'
    )


def mark(name, parent, xyz, rpy=(0, 0, 0)):
    return body(name, 1e-9) + (
        f'<joint name="{name}_frame" type="fixed"><origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/>'
        f'<parent link="{parent}"/><child link="{name}"/><axis xyz="0 0 0"/></joint>'
    )


def ball(parent, child, xyz):
    """A spherical joint as three hinges between massless bodies."""
    name, one, two = f"{parent}_{child}", f"{parent}_{child}_1", f"{parent}_{child}_2"
    return (
        body(one, 0.0) + body(two, 0.0) + hinge(f"{name}_rev0", parent, one, xyz, axis=(1, 0, 0))
        + hinge(f"{name}_rev1", one, two, axis=(0, 1, 0)) + hinge(f"{name}_rev2", two, child)
    )  # fmt: skip


def exported(*parts: str) -> str:
    return f'<robot name="exported">{"".join(parts)}</robot>'


def sidecar(kind: str, pairs, motors, **more) -> str:
    lists = {"closed_loop": [list(pair) for pair in pairs], "type": [kind] * len(pairs), "name_mot": motors}
    return "".join(f"{key}: {value}\n" for key, value in {**lists, **more}.items())


def five_bar_hinges():
    """A planar loop whose last joint is in two halves, which may spin: pins of a density that is wrong."""
    bodies = (body("built", 40), *(body(f"rod_{i}", 20 + i, 0.3) for i in range(4)))
    return exported(
        *bodies, body("pin", 2e5), body("pin_2", 2e5),
        hinge("closedloop1_A", "rod_1", "pin", (0, -0.42, 0), (0, 0, 1.5)),
        hinge("free1", "rod_0", "rod_1", (0, -0.38, 0.05)),
        hinge("mot1", "built", "rod_0", (0.1, 0.16, 0.04), UP),
        mark("effector", "rod_3", (0, -0.5, 0), (-np.pi / 2, -np.pi / 2, 0)),
        hinge("closedloop1_B", "rod_3", "pin_2", (0, -0.42, 0.05)),
        hinge("free2", "rod_2", "rod_3", (0, -0.38, 0), (0, 0, -2.6)),
        hinge("mot2", "built", "rod_2", (0.1, -0.16, 0.04), UP),
    ), sidecar("6d", [("closedloop1_A", "closedloop1_B")], ["mot1", "mot2"])  # fmt: skip


def _five_bar(kind: str, *end: str):
    """A five-bar with a motor at an elbow, and a tip that turns across the plane."""
    bodies = (body("base", 90, 0.3), *(body(f"rod_{i}", 22 - i, 0.3) for i in range(4)), body("tip", 11, 0.2))
    pair = [(f"closedloop{kind}_B", f"closedloop{kind}_A")]
    return exported(
        *bodies, *end,
        mark("effector", "tip", (0.02, -0.18, -0.07), (np.pi, 0, -np.pi / 2)),
        hinge("freeortho", "rod_1", "tip", (-0.065, -0.34, -0.025), (0, np.pi / 2, 0)),
        hinge("free1", "rod_0", "rod_1", (0, 0.31, -0.05), (0, 0, 2.1)),
        hinge("mot1", "base", "rod_0", (-0.15, -0.1, 0), (-np.pi / 2, 0.45, 0)),
        mark(f"closedloop{kind}_B", "rod_3", (-0.0025, -0.36, -0.025), (np.pi / 2, 0, np.pi)),
        hinge("mot2", "rod_2", "rod_3", (0, -0.31, -0.05), (0, 0, 0.8)),
        hinge("free2", "base", "rod_2", (0.15, -0.1, 0), (np.pi / 2, 0.44, np.pi)),
    ), sidecar(kind.lower(), pair, ["mot2", "mot1"])  # fmt: skip


def five_bar_point():
    return _five_bar("3D", mark("closedloop3D_A", "tip", (0, -0.18, -0.0625), (np.pi / 2, -np.pi / 2, 0)))


def five_bar_rod_end():
    """The point is a rod end: a ball of three hinges, and a closure that holds six freedoms."""
    end = mark("closedloop6D_A", "rod_end", (0, 0, -0.1), (np.pi, 0, np.pi))
    return _five_bar("6D", body("rod_end", 5, 0.1), ball("tip", "rod_end", (0, -0.18, -0.065)), end)


def _leg(side: str, y: float, rod: Callable[..., str], loops: tuple[int, int]) -> str:
    """A leg whose knee follows by one rod and whose ankle by a crank and another, each cut in the middle."""
    masses = {"hip": 1.4, "thigh": 3.9, "shin": 0.74, "crank": 0.0045, "foot": 0.33}
    parts = [body(f"{name}{side}", mass, 0.2) for name, mass in masses.items()]
    parts += [
        hinge(f"motor_hip{side}", "torso", f"hip{side}", (-0.03, y, 0.06), (np.pi / 2, 0.2, np.pi / 2)),
        hinge(f"motor_knee{side}", f"hip{side}", f"thigh{side}", (0.02, 0, -0.05), (np.pi / 2, 0, 0.3)),
        hinge(f"free_knee{side}", f"thigh{side}", f"shin{side}", (0, -0.32, 0.01), (0, 0, 0.7)),
        hinge(f"motor_shin{side}", f"shin{side}", f"crank{side}", (-0.03, -0.08, 0.03), (0, 0, 0.5)),
        hinge(f"free_foot{side}", f"shin{side}", f"foot{side}", (0, -0.32, -0.01), (0, 0, -0.4)),
    ]
    cut = (
        (loops[0], 0.0157, 0.17, ("shin", (0.05, -0.03, 0.02)), ("hip", (0.06, 0.01, -0.06))),
        (loops[1], 0.006, 0.12, ("foot", (-0.05, 0.01, 0.05)), ("crank", (-0.05, 0.0, 0.005))),
    )
    for loop, mass, half, *ends in cut:
        for end, (parent, place) in zip("AB", ends, strict=True):
            name = f"toe_{loop}_1/2_{end}"
            parts += [
                body(name, mass, half),
                rod(f"{parent}{side}", name, place, end == "A"),
                mark(f"closedloop{loop}_{end}", name, (0, 0, -half), (np.pi if end == "A" else 0, 0, 0.3)),
            ]
    return "".join(parts)


def leg_with_rods():
    """Rods that spin between two balls: freedoms without an actuator, of bodies of a few grams."""
    leg = _leg("", 0.07, lambda parent, child, place, _: ball(parent, child, place), (1, 2))
    motors = ["motor_hip", "motor_knee", "motor_shin"]
    pairs = [("closedloop1_B", "closedloop1_A"), ("closedloop2_B", "closedloop2_A")]
    return exported(body("torso", 3.2), mark("hip_mark", "torso", (0, 0, 0.002)), leg), sidecar(
        "6d", pairs, motors
    )


def two_legs():
    """The sidecar says of hinges that they are balls and universal joints."""

    def rod(parent, child, place, is_ball):
        kinds.append((f"to_{child}", "SPHERICAL" if is_ball else "UJOINT_XY"))
        return hinge(f"to_{child}", parent, child, place, (np.pi / 2, 0.1, 0.4))

    kinds: list[tuple[str, str]] = []
    legs = _leg("", -0.07, rod, (1, 2)) + _leg("_left", 0.07, rod, (3, 4))
    pairs = [(f"closedloop{i}_B", f"closedloop{i}_A") for i in (1, 2, 3, 4)]
    motors = [f"motor_{name}{side}" for side in ("", "_left") for name in ("hip", "knee", "shin")]
    names, types = map(list, zip(*kinds, strict=True))
    text = exported(body("torso", 3.2), legs)
    return text, sidecar("6d", pairs, motors, joint_name=names, joint_type=types)


def tiny_delta():
    """Three chains in a plane of a few grams, whose loops close over pins of micrograms that spin."""
    masses = {"rod1": 0.0028, "long1": 0.0044, "effector": 0.0038, "rod2": 0.0028, "long2": 0.0044}
    masses |= {"rod3": 0.0015, "angle": 0.0013, "long3": 0.0022}
    quarter = f'lower="{-np.pi / 2:.17g}" upper="{np.pi / 2:.17g}"'
    return exported(
        body("built", 0.05), *(body(name, mass, 0.05) for name, mass in masses.items()),
        *(body(f"pin_{i}", 6.5e-6, 0.01) for i in range(6)),
        mark("eff", "effector", (-0.005, 0.012, 0), (-np.pi / 2, np.pi / 2, 0)),
        hinge("closedloop3_B", "effector", "pin_0", (-0.01, 0, 0), (0, 0, 0.3)),
        hinge("closedloop2_B", "effector", "pin_1", (0, 0, 0), (0, 0, 3.1)),
        hinge("free2_rod1", "long1", "effector", (0, 0.06, 0), (0, 0, 0.4), room=quarter),
        hinge("free1_rod1", "rod1", "long1", (0, 0.04, 0), (0, 0, 1.2)),
        hinge("mot1_rod1", "built", "rod1", (0.005, -0.01, 0.05), (np.pi / 2, 0.6, np.pi / 2)),
        hinge("closedloop1_B", "long2", "pin_2", (0, 0, 0), (0, 0, -1.9)),
        hinge("closedloop2_A", "long2", "pin_3", (0, 0.06, 0), (0, 0, 1.5)),
        hinge("free1_rod2", "rod2", "long2", (0, 0.04, 0), (0, 0, -1.2)),
        hinge("mot1_rod2", "built", "rod2", (0.005, 0.01, 0.05), (np.pi / 2, -0.6, np.pi / 2)),
        hinge("closedloop3_A", "long3", "pin_4", (0, 0.06, 0), (0, 0, np.pi)),
        hinge("free3_rod3", "angle", "long3", (-0.01, 0.008, 0), (0, 0, 0.8)),
        hinge("closedloop1_A", "angle", "pin_5", (0, 0.008, 0), (0, 0, -1.6)),
        hinge("free2_rod3", "rod3", "angle", (0, 0.04, 0)),
        hinge("free1_rod3", "built", "rod3", (0.005, 0.01, 0.042), (np.pi / 2, 0, np.pi / 2)),
    ), sidecar("6d", [(f"closedloop{i}_A", f"closedloop{i}_B") for i in (1, 2, 3)],
               ["mot1_rod1", "mot1_rod2"])  # fmt: skip


# URDF+


def plus(*parts: str) -> tuple[str, None]:
    head = '<?xml version="1.0" ?>\n<robot name="plus" xmlns:xacro="http://ros.org/wiki/xacro">'
    return f"{head}{''.join(parts)}</robot>", None


def turning(name, parent, child, x=None, more="", kind="continuous", axis="0 0 1"):
    """A joint along z; without a place it has no origin, without an axis it turns about x."""
    place = "" if x is None else f'<origin xyz="{numbers(x if isinstance(x, tuple) else (x, 0, 0))}"/>'
    along = f'<axis xyz="{axis}"/>' if axis else ""
    limit = '<limit effort="30" velocity="1" lower="-12" upper="12"/>' if kind == "revolute" else ""
    return (
        f'<joint name="{name}" type="{kind}"{more}><parent link="{parent}"/><child link="{child}"/>'
        f"{place}{along}{limit}</joint>"
    )


def pinned(one, at_one, other, at_other):
    ends = "".join(
        f'<{tag} link="{link}"><origin xyz="{x} 0 0"/></{tag}>'
        for tag, link, x in (("predecessor", one, at_one), ("successor", other, at_other))
    )
    return f'<loop name="loop" type="revolute">{ends}<axis xyz="0 0 1"/></loop>'


def rolling(link, rotor, ratio):
    ends = f'<predecessor link="{link}"/><successor link="{rotor}"/>'
    return f'<coupling name="gear_{link}" type="rolling">{ends}<ratio value="{ratio}"/></coupling>'


FREE, FOLLOWS = ' independent="true"', ' independent="false"'
BAR = (0.011, 0, 0, 0.036, 0, 0.043)
FLAT = (0, 0, 0, 0, 0, 4e-5)
ROTOR = (3.1e-4, 6e-5, -5e-7, 8.3e-4, 9e-7, 2.5e-4)


def plus_four_bar():
    """A parallelogram that is in line at zero."""
    bars = [solid(f"link{i}", 3.2, (0, 0, 0), BAR) for i in (1, 2, 3)]
    return plus(
        '<link name="base"/>', *bars,
        turning("joint1", "base", "link1", 0.0, FREE, "revolute"),
        turning("joint2", "link1", "link2", 0.4, FOLLOWS, "revolute"),
        turning("joint3", "base", "link3", 0.9, FOLLOWS, "revolute"),
        pinned("link2", 0.9, "link3", 0.4),
    )  # fmt: skip


def plus_six_bar():
    """Open at zero, with three motors in one chain."""
    bars = [solid(f"link{i}", 3.4, (0, 0, 0), BAR) for i in range(1, 6)]
    return plus(
        '<link name="base"/>', *bars,
        turning("joint1", "base", "link1", 0.0), turning("joint2", "link1", "link2", 0.12),
        turning("joint3", "link2", "link3", 0.22), turning("joint4", "base", "link4", 0.0, FOLLOWS),
        turning("joint5", "link4", "link5", 0.42, FOLLOWS), pinned("link3", 0.32, "link5", 0.52),
    )  # fmt: skip


def plus_planar_leg():
    """Bodies with inertia about one axis only."""
    masses = (("thigh", 0.23), ("driver", 0.004), ("support", 0.22), ("foot", 0.017))
    return plus(
        '<link name="base"/>', *(solid(name, mass, (0.04, 0, 0), FLAT) for name, mass in masses),
        turning("base_to_thigh", "base", "thigh", 0.0),
        turning("thigh_to_driver", "thigh", "driver", 0.012, FREE),
        turning("thigh_to_support", "thigh", "support", 0.044, FOLLOWS),
        turning("driver_to_foot", "driver", "foot", 0.095, FOLLOWS),
        pinned("foot", 0.032, "support", 0.095),
    )  # fmt: skip


def plus_leg_with_rotors():
    """Joints of a serial leg with rotors that are geared to them; the first have neither place nor axis."""
    parts, parent = ['<link name="base"/>'], "base"
    for name, place, axis, ratio in (
        ("abduct", None, "", 6), ("thigh", (0, -0.06, 0), "0 -1 0", 6), ("shank", (0, 0, -0.21), "0 -1 0", 9)
    ):  # fmt: skip
        for child, mass in ((name, 0.6), (f"{name}_rotor", 0.05)):
            parts += [
                solid(child, mass, (0, -0.03, -0.02), ROTOR),
                turning(f"to_{child}", parent, child, place, axis=axis),
            ]
        parts.append(rolling(name, f"{name}_rotor", ratio))
        parent = name
    return plus(*parts)


def plus_rotor_chain():
    """Rotors without mass."""
    parts, parent = ['<link name="base"/>'], "base"
    for i in range(3):
        x = 0.9 if i else None
        parts += [
            solid(f"link-{i}", 1.1, (0.45, 0, 0), (1, 0, 0, 1, 0, 1)),
            solid(f"rotor-{i}", 0, (0, 0, 0), (1e-4, 0, 0, 1e-4, 0, 1e-4)),
            turning(f"joint{i}", parent, f"link-{i}", x, kind="revolute"),
            turning(f"joint{i}r", parent, f"rotor-{i}", x, FOLLOWS, "revolute"),
            rolling(f"link-{i}", f"rotor-{i}", 6),
        ]
        parent = f"link-{i}"
    return plus(*parts)


EXPORTED = (
    "five_bar_hinges", "five_bar_point", "five_bar_rod_end", "leg_with_rods", "two_legs", "tiny_delta"
)  # fmt: skip
STAND_INS: dict[str, tuple[Callable[[], tuple[str, str | None]], str]] = {
    "five_bar_hinges": (five_bar_hinges, "5bar_linkage/robot.urdf"),
    "five_bar_point": (five_bar_point, "5bar_linkage_iso3d/robot.urdf"),
    "five_bar_rod_end": (five_bar_rod_end, "5bar_linkage_iso6d/robot.urdf"),
    "leg_with_rods": (leg_with_rods, "digit_like/robot.urdf"),
    "two_legs": (two_legs, "digit_like_2legs/robot.urdf"),
    "tiny_delta": (tiny_delta, "robot_delta/robot.urdf"),
    "plus_four_bar": (plus_four_bar, "urdf_plus/four_bar.urdf"),
    "plus_six_bar": (plus_six_bar, "urdf_plus/six_bar.urdf"),
    "plus_planar_leg": (plus_planar_leg, "urdf_plus/planar_leg_linkage.urdf"),
    "plus_leg_with_rotors": (plus_leg_with_rotors, "urdf_plus/mini_cheetah_leg.urdf"),
    "plus_rotor_chain": (plus_rotor_chain, "urdf_plus/revolute_rotor_chain.urdf"),
}
"""Each stand-in, and the file of the outside collection that it stands for."""


def collection(named: str | None, beside: Path) -> Path | None:
    """Return the folder of the outside collection, if there is one; one that is named must be there."""
    if named and not Path(named).is_dir():
        raise FileNotFoundError(f"P3DOF_ROBOTS: expected the folder of a collection of robots, got {named}")
    return Path(named) if named else beside if beside.is_dir() else None


OUTSIDE = collection(os.environ.get("P3DOF_ROBOTS"), ROOT.parent / "shared" / "robots")


def others(*names: str) -> list[str]:
    """Return stand-ins, by default all, and the files that they stand for where these are at hand."""
    chosen = names or tuple(STAND_INS)
    return [*chosen, *(STAND_INS[name][1] for name in chosen if OUTSIDE is not None)]


def urdf_of(name: str) -> str:
    """Return the text of a robot that `others` named."""
    if name in STAND_INS:
        return STAND_INS[name][0]()[0]
    assert OUTSIDE is not None
    return (OUTSIDE / name).read_text(encoding="utf-8")


def load(name: str) -> ClosedLoopModel:
    """Load a robot that `others` named, from its file."""
    if name not in STAND_INS:
        assert OUTSIDE is not None
        return p3dof.load_robot(OUTSIDE / name)
    urdf, yaml = STAND_INS[name][0]()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "robot.urdf")
        file.write_text(urdf, encoding="utf-8")
        if yaml is not None:
            file.with_suffix(".yaml").write_text(yaml, encoding="utf-8")
        return p3dof.load_robot(file)
