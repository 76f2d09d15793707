"""What the robots of the benchmark are built with: bodies, joints and closures, where they are at home.

Everything is given in world coordinates of the configuration in which all joints are zero. There all frames
are parallel, so a URDF needs no rotations, and all numbers are short decimals.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from math import cos, hypot, pi, sin
from typing import Any
from xml.sax.saxutils import quoteattr

GROUND = "ground"
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
Point = Sequence[float]


def flat(x: float, z: float) -> tuple[float, float, float]:
    """Return a point of the vertical plane."""
    return (x, 0.0, z)


def around(radius: float, degrees: float, z: float = 0.0) -> tuple[float, float, float]:
    """Return a point on a circle about the z axis, to six decimals."""
    angle = degrees * pi / 180
    return (round(radius * cos(angle), 6), round(radius * sin(angle), 6), z)


def upright(radius: float, degrees: float) -> tuple[float, float, float]:
    """Return a point on a circle about the y axis, in the vertical plane."""
    x, z, _ = around(radius, degrees)
    return flat(x, z)


def decimal(value: float) -> Decimal:
    """Return a number as the exact decimal that it is written as."""
    return Decimal(repr(float(value)))


def text(values: Sequence[float | Decimal]) -> str:
    """Return numbers as decimals without exponents."""
    return " ".join(plain(value) for value in values)


def plain(value: float | Decimal) -> str:
    """Return a number as a decimal without an exponent."""
    found = f"{value if isinstance(value, Decimal) else decimal(value):f}"
    found = found.rstrip("0").rstrip(".") if "." in found else found
    return "0" if found in ("-0", "") else found


def away(one: Point, other: Point) -> list[Decimal]:
    """Return the vector from the other point to the first, exactly."""
    return [decimal(a) - decimal(b) for a, b in zip(one, other, strict=True)]


def _significant(value: float, digits: int = 7) -> float:
    return float(f"{value:.{digits - 1}e}")


class Build:
    """A robot that is being built.

    `size` is the scale of its motions [rad; a fifth of it in m], `force` that of its actuators' forces.
    """

    def __init__(self, size: float = 1.0, force: float = 1.0) -> None:
        self.size, self.force = size, force
        self.gravity = (0.0, 0.0, -9.81)
        self.at: dict[str, Point] = {GROUND: (0.0, 0.0, 0.0)}
        self.parts = [f"  <link name={quoteattr(GROUND)}/>"]
        self.slides: dict[str, bool] = {}
        self.closures: list[dict[str, Any]] = []
        self.couplings: list[dict[str, Any]] = []
        self.actuated: list[str] = []
        self.given: list[str] = []
        self.states: list[dict[str, Any]] | None = None
        self.kinds: list[str] = []
        self.from_forces = False
        self.forces: list[float] = []  # of the actuators, instead of the pattern times `force`

    def link(
        self,
        name: str,
        parent: str,
        at: Point,
        axis: str | Point,
        to: Point | None = None,
        kind: str = "continuous",
        mass: float | None = None,
        thick: float = 0.04,
    ) -> str:
        """Add a joint at a point and its body, a rod from there to another point; return the body's name."""
        end = at if to is None else to
        along = [float(b) - float(a) for a, b in zip(at, end, strict=True)]
        length = hypot(*along)
        mass = round(0.2 + 2 * length, 3) if mass is None else mass
        com = [_significant(x / 2) for x in along]
        unit = [x / length for x in along] if length else [0.0, 0.0, 0.0]
        across, inner = mass * (length**2 + thick**2) / 12, mass * thick**2 / 6
        moments = []
        for key in ("xx", "xy", "xz", "yy", "yz", "zz"):
            i, j = ("xyz".index(letter) for letter in key)
            turned = (inner - across) * unit[i] * unit[j] if length else 0.0
            moments.append(f'i{key}="{plain(_significant(turned + (across if i == j else 0.0)))}"')
        limit = ""
        if kind != "continuous":
            reach = "10000" if kind == "revolute" else "100"
            limit = f'<limit lower="-{reach}" upper="{reach}" effort="1000000" velocity="1000000"/>'
        shown = AXES[axis] if isinstance(axis, str) else axis
        self.parts += [
            f'  <link name="{name}">',
            f'    <inertial><origin xyz="{text(com)}"/><mass value="{plain(mass)}"/>',
            f"      <inertia {' '.join(moments)}/></inertial>",
            "  </link>",
            f'  <joint name="{name}_joint" type="{kind}">',
            f'    <parent link="{parent}"/><child link="{name}"/>',
            f'    <origin xyz="{text(away(at, self.at[parent]))}"/>',
            f'    <axis xyz="{text(shown)}"/>{limit}',
            "  </joint>",
        ]
        self.at[name] = at
        self.slides[f"{name}_joint"] = kind == "prismatic"
        return name

    def slide(self, name: str, parent: str, at: Point, axis: str | Point, mass: float = 1.0, to=None) -> str:
        """Add a body on a prismatic joint."""
        return self.link(name, parent, at, axis, to, kind="prismatic", mass=mass)

    def turns(
        self, name: str, parent: str, at: Point, axes: Sequence[str | Point], to=None, mass=None
    ) -> str:
        """Add a body on a universal joint or a ball: revolute joints, small bodies between them."""
        for number, axis in enumerate(axes[:-1], 1):
            parent = self.link(f"{name}_{number}", parent, at, axis, mass=0.02)
        return self.link(name, parent, at, axes[-1], to, mass=mass)

    def floating(self, name: str, at: Point, to=None, mass: float = 1.0, thick: float = 0.04) -> str:
        """Add a body that is free: three prismatic, then three revolute joints, small bodies between."""
        parent = GROUND
        for axis in "xyz":
            parent = self.link(f"{name}_{axis}", parent, at, axis, kind="prismatic", mass=0.02)
        for axis in "zy":
            parent = self.link(f"{name}_r{axis}", parent, at, axis, mass=0.02)
        return self.link(name, parent, at, "x", to, mass=mass, thick=thick)

    def cylinder(self, name: str, parent: str, at: Point, target: str, to: Point, axis="y") -> str:
        """Add a hydraulic cylinder between two bodies; return the name of its prismatic joint."""
        along = away(to, at)
        middle = [float(a) + 0.5 * float(d) for a, d in zip(at, along, strict=True)]
        self.link(f"{name}_barrel", parent, at, axis, [round(x, 6) for x in middle], mass=5.0)
        self.link(
            f"{name}_rod",
            f"{name}_barrel",
            [round(x, 6) for x in middle],
            [float(d) for d in along],
            to,
            kind="prismatic",
            mass=3.0,
        )
        self.point(f"{name}_rod", target, to)
        return f"{name}_rod_joint"

    def point(self, one: str, other: str, at: Point) -> None:
        """Hold two bodies together at a point."""
        self._close("point", one, at, other, at)

    def hinge(self, one: str, other: str, at: Point, axis: str | Point) -> None:
        """Hold two bodies together by a hinge."""
        shown = [float(x) for x in (AXES[axis] if isinstance(axis, str) else axis)]
        self._close("hinge", one, at, other, at, axis_1=shown, axis_2=shown)

    def weld(self, one: str, other: str, at: Point) -> None:
        """Hold two bodies together altogether."""
        self._close("weld", one, at, other, at)

    def distance(self, one: str, at: Point, other: str, to: Point, length: float) -> None:
        """Hold two points at a distance, by a rod without mass."""
        self._close("distance", one, at, other, to, length=length)

    def _close(self, kind: str, one: str, at: Point, other: str, to: Point, **more: Any) -> None:
        name = f"{one}_to_{other}" + (f"_{len(self.closures) + 1}" if kind == "distance" else "")
        positions = {
            f"position_{k}": [float(plain(x)) for x in away(p, self.at[link])]
            for k, link, p in ((1, one, at), (2, other, to))
        }
        self.closures.append(
            {"name": name, "kind": kind, "link_1": one, "link_2": other, **positions, **more}
        )

    def gear(self, joint: str, of: str, ratio: float) -> None:
        """Let a joint follow another: joint = ratio * of."""
        self.couplings.append({"joint": f"{joint}_joint", "of": f"{of}_joint", "ratio": ratio})

    def drive(self, *links: str, given: Sequence[str] = (), kinds: Sequence[str] = ()) -> Build:
        """Name the links with motors, those whose motion is given, and what is special: the end."""
        self.actuated = [link if link.endswith("_joint") else f"{link}_joint" for link in links]
        self.given = [link if link.endswith("_joint") else f"{link}_joint" for link in given] or self.actuated
        self.kinds = list(kinds)
        return self

    def urdf(self, name: str) -> str:
        """Return the URDF."""
        head = '<?xml version="1.0"?>\n<!-- Written by make.py; the closures are in the JSON file. -->'
        return "\n".join([head, f'<robot name="{name}">', *self.parts, "</robot>", ""])
