"""Small robots for the tests of `p3dof.loops`, as URDF text; and the one finite-difference helper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof.loops import Closure, Sidecar


@dataclass(frozen=True)
class Solid:
    """Inertial parameters: mass, mass centre in the link's frame, inertia about it (full matrix)."""

    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]  # xx xy xz yy yz zz

    @property
    def matrix(self) -> np.ndarray:
        xx, xy, xz, yy, yz, zz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


ROD = Solid(1.3, (0.11, 0.02, -0.03), (0.02, 0.003, -0.001, 0.03, 0.002, 0.04))
BAR = Solid(0.7, (0.21, -0.04, 0.05), (0.03, -0.002, 0.001, 0.02, 0.001, 0.025))
ARM = Solid(2.1, (0.15, 0.03, 0.01), (0.05, 0.001, 0.002, 0.04, -0.003, 0.06))


def link(name: str, solid: Solid | None = None) -> str:
    if solid is None:
        return f'<link name="{name}"/>'
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    inertia = " ".join(f'{n}="{v!r}"' for n, v in zip(names, solid.inertia, strict=True))
    xyz = " ".join(repr(v) for v in solid.com)
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}" rpy="0 0 0"/><mass value="{solid.mass!r}"/>'
        f"<inertia {inertia}/></inertial></link>"
    )


def joint(
    name: str, parent: str, child: str, xyz=(0, 0, 0), axis=(0, 1, 0), kind="revolute", rpy=(0, 0, 0)
) -> str:
    place = f'xyz="{" ".join(map(repr, map(float, xyz)))}" rpy="{" ".join(map(repr, map(float, rpy)))}"'
    moving = "" if kind == "fixed" else f'<axis xyz="{" ".join(map(str, axis))}"/>'
    limit = (
        '<limit lower="-9" upper="9" effort="9" velocity="9"/>' if kind in ("revolute", "prismatic") else ""
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"<origin {place}/>{moving}{limit}</joint>"
    )


def robot(*parts: str) -> str:
    return f'<robot name="robot">{"".join(parts)}</robot>'


def four_bar(ground: float, crank: float, coupler: float, rocker: float, kind: str = "revolute") -> str:
    """Planar four-bar in the plane x-z, all axes along -y, so that angles turn x toward z.

    The crank turns at the origin, the coupler at its end; the rocker turns at (ground, 0, 0). The closure is
    coupler_tip / rocker_tip. At q = 0 all three bars lie along +x.
    """
    down = (0, -1, 0)
    return robot(
        link("base"),
        link("crank", ROD),
        link("coupler", BAR),
        link("rocker", ARM),
        link("coupler_tip"),
        link("rocker_tip"),
        joint("crank_joint", "base", "crank", axis=down, kind=kind),
        joint("coupler_joint", "crank", "coupler", (crank, 0, 0), axis=down, kind=kind),
        joint("coupler_tip_joint", "coupler", "coupler_tip", (coupler, 0, 0), kind="fixed"),
        joint("rocker_joint", "base", "rocker", (ground, 0, 0), axis=down, kind=kind),
        joint("rocker_tip_joint", "rocker", "rocker_tip", (rocker, 0, 0), kind="fixed"),
    )


FOUR_BAR = (0.5, 0.2, 0.45, 0.35)
FOUR_BAR_SIDECAR = Sidecar((Closure("coupler_tip", "rocker_tip"),), ("crank_joint",))


def four_bar_angles(theta: float, ground: float, crank: float, coupler: float, rocker: float) -> np.ndarray:
    """Absolute angles of coupler and rocker in closed form (two circles), the joint left of the diagonal."""
    B = np.array([crank * np.cos(theta), crank * np.sin(theta)])
    D = np.array([ground, 0.0])
    d = np.linalg.norm(D - B)
    along = (coupler**2 - rocker**2 + d**2) / (2 * d)
    height = np.sqrt(coupler**2 - along**2)
    e = (D - B) / d
    C = B + along * e + height * np.array([-e[1], e[0]])
    return np.array([np.arctan2(*(C - B)[::-1]), np.arctan2(*(C - D)[::-1])])


def four_bar_q(theta: float, *lengths: float) -> np.ndarray:
    coupler, rocker = four_bar_angles(theta, *lengths)
    return np.array([theta, coupler - theta, rocker])


SLIDER_CRANK_SIDECAR = Sidecar((Closure("rod_tip", "pin", "hinge"),), ("slide",))
SLIDER_CRANK = (0.08, 0.25)  # crank, rod


def slider_crank() -> str:
    """Slider-crank along x with the motor on its piston, at its outer dead centre at zero."""
    up = (0, 0, 1)
    crank, rod = SLIDER_CRANK
    return robot(
        link("base"),
        link("crank", ROD),
        link("rod", BAR),
        link("piston", ARM),
        link("rod_tip"),
        link("pin"),
        joint("crank_joint", "base", "crank", axis=up),
        joint("rod_joint", "crank", "rod", (crank, 0, 0), axis=up),
        joint("rod_tip_joint", "rod", "rod_tip", (rod, 0, 0), kind="fixed"),
        joint("slide", "base", "piston", (crank + rod, 0, 0), axis=(1, 0, 0), kind="prismatic"),
        joint("pin_joint", "piston", "pin", kind="fixed"),
    )


FIVE_BAR_SIDECAR = Sidecar((Closure("left_tip", "right_tip"),), ("left_joint", "right_joint"))
FIVE_BAR = (0.3, 0.25, 0.4)  # distance of the motors, proximal, distal


def five_bar() -> str:
    """Planar five-bar in x-z: motors at (0, 0) and (0.3, 0), proximal 0.25, distal 0.4, axes along -y."""
    down = (0, -1, 0)
    ground, near, far = FIVE_BAR
    parts = [link("base")]
    for side, x in (("left", 0.0), ("right", ground)):
        parts += [
            link(f"{side}_near", ROD if side == "left" else ARM),
            link(f"{side}_far", BAR),
            link(f"{side}_tip"),
            joint(f"{side}_joint", "base", f"{side}_near", (x, 0, 0), axis=down),
            joint(f"{side}_elbow", f"{side}_near", f"{side}_far", (near, 0, 0), axis=down),
            joint(f"{side}_tip_joint", f"{side}_far", f"{side}_tip", (far, 0, 0), kind="fixed"),
        ]
    return robot(*parts)


def five_bar_elbows(left: float, right: float) -> np.ndarray:
    """Absolute angles of both distal links in closed form, tip above the elbows."""
    ground, near, far = FIVE_BAR
    A = near * np.array([np.cos(left), np.sin(left)])
    B = np.array([ground, 0.0]) + near * np.array([np.cos(right), np.sin(right)])
    half = (B - A) / 2
    d = np.linalg.norm(half)
    up = np.array([-half[1], half[0]]) / d
    C = A + half + np.sqrt(far**2 - d**2) * up
    return np.array([np.arctan2(*(C - A)[::-1]), np.arctan2(*(C - B)[::-1])])


def five_bar_q(left: float, right: float) -> np.ndarray:
    a, b = five_bar_elbows(left, right)
    return np.array([left, a - left, right, b - right])


SARRUS_SIDECAR = Sidecar((Closure("plate_mark", "other_mark", "6d"),), ("x_foot",))
SARRUS_ARM = 0.3


def sarrus() -> str:
    """Sarrus linkage: two folding legs in perpendicular planes lift a plate along a straight line.

    Six parallel-in-threes hinges and a 6d closure: rank 5 where the loop is closed, 6 almost everywhere else.
    With s = sin of the foot angle α, each leg has angles (α, π - 2α, ...) and the plate is 2 · 0.3 · s high.
    At q = 0 the arms are folded by 45°.
    """
    parts = [link("base")]
    eighth = np.pi / 4
    for leg, yaw in (("x", 0.0), ("y", np.pi / 2)):
        parts += [
            link(f"{leg}_lower", ROD),
            link(f"{leg}_upper", BAR),
            # Positive rotation about -y of the yawed frame folds upward.
            joint(f"{leg}_foot_place", "base", f"{leg}_base", (0, 0, 0), kind="fixed", rpy=(0, 0, yaw)),
            link(f"{leg}_base"),
            joint(f"{leg}_foot", f"{leg}_base", f"{leg}_lower", (0.2, 0, 0), (0, -1, 0), rpy=(0, -eighth, 0)),
            joint(
                f"{leg}_knee",
                f"{leg}_lower",
                f"{leg}_upper",
                (SARRUS_ARM, 0, 0),
                (0, -1, 0),
                rpy=(0, -2 * eighth, 0),
            ),
        ]
        plate = "plate" if leg == "x" else "other"
        parts += [
            link(plate, ARM if leg == "x" else ROD),
            joint(
                f"{leg}_head", f"{leg}_upper", plate, (SARRUS_ARM, 0, 0), (0, -1, 0), rpy=(0, 3 * eighth, 0)
            ),
            link(f"{plate}_mark"),
            joint(
                f"{plate}_mark_joint", plate, f"{plate}_mark", (-0.2, 0, 0), kind="fixed", rpy=(0, 0, -yaw)
            ),
        ]
    return robot(*parts)


BENNETT_SIDECAR = Sidecar((Closure("end", "start", "6d"),), ("joint_0",))
_BENNETT = ((0.3, 0.4), (0.3 * np.sin(1.0) / np.sin(0.4), 1.0)) * 2  # length, twist; a/sin α = b/sin β


def bennett() -> str:
    """Bennett's linkage: four skew hinges and a 6d closure that ought not to move, and does.

    Rank 3 where the loop is closed, 4 elsewhere. At q = 0 it is closed with joint 0 at 1 rad.
    """
    parts = [link("start"), link("base_end"), joint("base", "start", "base_end", kind="fixed")]
    parent, place, turn = "base_end", (0.0, 0.0, 0.0), np.eye(3)
    home = bennett_angles(1.0)
    for i, (length, twist) in enumerate(_BENNETT):
        turn = turn @ pin.rpy.rpyToMatrix(0, 0, home[i])
        parts += [
            link(f"link_{i}", (ROD, BAR, ARM, ROD)[i]),
            joint(f"joint_{i}", parent, f"link_{i}", place, (0, 0, 1), rpy=pin.rpy.matrixToRpy(turn)),
        ]
        parent, place, turn = f"link_{i}", (length, 0.0, 0.0), pin.rpy.rpyToMatrix(twist, 0, 0)
    parts += [
        link("end"),
        joint("end_joint", parent, "end", place, kind="fixed", rpy=pin.rpy.matrixToRpy(turn)),
    ]
    return robot(*parts)


def bennett_angles(first: float) -> np.ndarray:
    """All four joint angles in closed form: tan(θ0/2) tan(θ1/2) = sin((β+α)/2) / sin((β-α)/2)."""
    alpha, beta = _BENNETT[0][1], _BENNETT[1][1]
    ratio = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    second = 2 * np.arctan2(ratio, np.tan(first / 2))
    return np.array([first, second, -first, -second])


def parallelogram(width: float = 0.3, length: float = 0.4) -> str:
    """Two cranks of equal length side by side and a bar between them; at q = 0 the cranks point along +x."""
    down = (0, -1, 0)
    return robot(
        link("base"),
        link("left", ROD),
        link("bar", BAR),
        link("right", ARM),
        link("bar_tip"),
        link("right_tip"),
        joint("left_joint", "base", "left", axis=down),
        # The bar is along z when the cranks are along x.
        joint("bar_joint", "left", "bar", (length, 0, 0), axis=down, rpy=(0, -np.pi / 2, 0)),
        joint("bar_tip_joint", "bar", "bar_tip", (width, 0, 0), kind="fixed"),
        joint("right_joint", "base", "right", (0, 0, width), axis=down),
        joint("right_tip_joint", "right", "right_tip", (length, 0, 0), kind="fixed"),
    )


PARALLELOGRAM_SIDECAR = Sidecar((Closure("bar_tip", "right_tip"),), ("left_joint",))


def flat_parallelogram(size: float = 1.0) -> str:
    """Such a parallelogram, drawn flat: at q = 0 the rank is 1."""
    width = 0.3 * size
    xml = parallelogram(width, 0.4 * size).replace('rpy="0.0 -1.5707963267948966 0.0"', 'rpy="0.0 0.0 0.0"')
    return xml.replace(f'xyz="0.0 0.0 {width}"', f'xyz="{width} 0.0 0.0"')


def differences(
    f: Callable[[float], np.ndarray], model: pin.Model | None = None, h: float = 2e-3
) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivative of f at 0, by central differences of sixth order.

    With a model, f returns configurations and the derivatives are tangent vectors: velocity and acceleration.
    """
    steps = np.arange(-3, 4)
    values = [np.asarray(f(k * h)) for k in steps]
    if model is None:
        x = np.array(values)
    else:
        x = np.array([pin.difference(model, values[3], value) for value in values])
    first = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
    second = np.array([2, -27, 270, -490, 270, -27, 2]) / 180
    return np.tensordot(first, x, 1) / h, np.tensordot(second, x, 1) / h**2


HEXAPOD_BASE = [(0.5 * np.cos(t), 0.5 * np.sin(t), 0.0) for t in np.deg2rad([10, 110, 130, 230, 250, 350])]
HEXAPOD_TOP = [(0.3 * np.cos(t), 0.3 * np.sin(t), 0.0) for t in np.deg2rad([50, 70, 170, 190, 290, 310])]
HEXAPOD_SIDECAR = Sidecar(
    tuple(Closure(f"rod_{i}_tip", f"corner_{i}") for i in range(6)), tuple(f"slide_{i}" for i in range(6))
)


def hexapod() -> str:
    """Gough-Stewart platform: a floating platform, six legs of two hinges and one actuated slide."""
    parts = [link("base"), link("platform", ARM), joint("float", "base", "platform", kind="floating")]
    for i, (foot, corner) in enumerate(zip(HEXAPOD_BASE, HEXAPOD_TOP, strict=True)):
        parts += [
            link(f"yoke_{i}", Solid(0.1, (0, 0, 0.01), (1e-3, 0, 0, 1e-3, 0, 1e-3))),
            link(f"tube_{i}", ROD),
            link(f"rod_{i}", BAR),
            link(f"rod_{i}_tip"),
            link(f"corner_{i}"),
            joint(f"first_{i}", "base", f"yoke_{i}", foot, (1, 0, 0)),
            joint(f"second_{i}", f"yoke_{i}", f"tube_{i}", axis=(0, 1, 0)),
            joint(f"slide_{i}", f"tube_{i}", f"rod_{i}", axis=(0, 0, 1), kind="prismatic"),
            joint(f"tip_{i}", f"rod_{i}", f"rod_{i}_tip", kind="fixed"),
            joint(f"corner_{i}_joint", "platform", f"corner_{i}", corner, kind="fixed"),
        ]
    return robot(*parts)


def hexapod_q(M: pin.SE3, model: pin.Model) -> np.ndarray:
    """Configuration in closed form: hinge angles and length of every leg from the platform's placement."""
    q = pin.neutral(model)
    start = model.idx_qs[model.getJointId("float")]
    q[start : start + 7] = pin.SE3ToXYZQUAT(M)
    for i, (foot, corner) in enumerate(zip(HEXAPOD_BASE, HEXAPOD_TOP, strict=True)):
        d = M.act(np.array(corner)) - np.array(foot)
        # d = Rx(α) Ry(β) (0, 0, ρ)
        values = (np.arctan2(-d[1], d[2]), np.arctan2(d[0], np.hypot(d[1], d[2])), np.linalg.norm(d))
        for name, value in zip(("first", "second", "slide"), values, strict=True):
            q[model.idx_qs[model.getJointId(f"{name}_{i}")]] = value
    return q


PENDULUM_MARK = (0.05, 0.2, -0.1)


def pendulum(kind: str, mark: str = "ground_mark", swap: bool = False) -> tuple[str, Sidecar]:
    """A floating body, held to the world by one closure at its mark; the world's mark is turned."""
    xml = robot(
        link("base"),
        link("bob", ARM),
        link("bob_mark"),
        link("ground_mark"),
        joint("float", "base", "bob", kind="floating"),
        joint("bob_mark_joint", "bob", "bob_mark", PENDULUM_MARK, kind="fixed", rpy=(0.3, -0.2, 0.5)),
        joint("ground_mark_joint", "base", "ground_mark", (0.1, 0.2, 0.3), kind="fixed", rpy=(0.4, 0.5, 0.6)),
    )
    pair = ("bob_mark", mark) if swap else (mark, "bob_mark")
    return xml, Sidecar((Closure(*pair, kind),), ())


@dataclass(frozen=True)
class PlanarBody:
    """A body of a planar mechanism in x-z: `place(θ)` gives the position (2,) of its pivot and its angle."""

    solid: Solid
    place: Callable[[np.ndarray], tuple[np.ndarray, float]]

    def motion(self, theta: np.ndarray) -> np.ndarray:
        """Mass centre (2,) and angle, as one array (3,)."""
        pivot, angle = self.place(theta)
        c, s = np.cos(angle), np.sin(angle)
        x, z = self.solid.com[0], self.solid.com[2]
        return np.array([pivot[0] + c * x - s * z, pivot[1] + s * x + c * z, angle])


def planar_torques(
    bodies: list[PlanarBody], theta: np.ndarray, rate: np.ndarray, acceleration: np.ndarray, g: float = 9.81
) -> np.ndarray:
    """D'Alembert: τ_j = Σ m (ac - g)·∂c/∂θ_j + Iyy φ̈ ∂φ/∂θ_j, with all derivatives of the closed forms."""
    torques = np.zeros(len(theta))
    for body in bodies:
        weights = np.array([body.solid.mass, body.solid.mass, body.solid.matrix[1, 1]])

        def along(t: float, body: PlanarBody = body) -> np.ndarray:
            return body.motion(theta + rate * t + acceleration * t**2 / 2)

        _, second = differences(along, h=1e-2)
        inertial = weights * (second + np.array([0.0, g, 0.0]))
        for j in range(len(theta)):
            partial, _ = differences(
                lambda t, j=j, b=body: b.motion(theta + t * np.eye(len(theta))[j]), h=1e-2
            )
            torques[j] += inertial @ partial
    return torques


def four_bar_bodies(ground: float, crank: float, coupler: float, rocker: float) -> list[PlanarBody]:
    lengths = (ground, crank, coupler, rocker)

    def end(theta: np.ndarray) -> np.ndarray:
        return crank * np.array([np.cos(theta[0]), np.sin(theta[0])])

    return [
        PlanarBody(ROD, lambda t: (np.zeros(2), t[0])),
        PlanarBody(BAR, lambda t: (end(t), four_bar_angles(t[0], *lengths)[0])),
        PlanarBody(ARM, lambda t: (np.array([ground, 0.0]), four_bar_angles(t[0], *lengths)[1])),
    ]


def five_bar_bodies() -> list[PlanarBody]:
    ground, near, _ = FIVE_BAR
    feet = (np.zeros(2), np.array([ground, 0.0]))

    def elbow(side: int, theta: np.ndarray) -> np.ndarray:
        return feet[side] + near * np.array([np.cos(theta[side]), np.sin(theta[side])])

    return [
        PlanarBody(ROD, lambda t: (feet[0], t[0])),
        PlanarBody(BAR, lambda t: (elbow(0, t), five_bar_elbows(*t)[0])),
        PlanarBody(ARM, lambda t: (feet[1], t[1])),
        PlanarBody(BAR, lambda t: (elbow(1, t), five_bar_elbows(*t)[1])),
    ]


TWO_ARMS = (Closure("left_tool0", "bar_left", "6d"), Closure("right_tool0", "bar_right", "6d"))


def arm_model() -> pin.Model:
    """A seven-joint arm from example-robot-data: the Panda with its fingers held."""
    import example_robot_data

    whole = example_robot_data.load("panda").model
    fingers = [i for i in range(1, whole.njoints) if "finger" in whole.names[i]]
    return pin.buildReducedModel(whole, fingers, pin.neutral(whole))


def two_arms() -> tuple[pin.Model, np.ndarray]:
    """Two Pandas, face to face, and a floating bar between them; and a configuration that nearly closes."""
    arm = arm_model()
    model, single = pin.Model(), pin.Model(arm)
    posture = np.array([0.1, -0.3, 0.2, -2.0, 0.15, 1.9, 0.4])
    for side, x, yaw in (("left", 0.0, 0.0), ("right", 1.6, np.pi)):
        single = pin.Model(arm)
        for i in range(1, single.njoints):
            single.names[i] = f"{side}_{single.names[i]}"
        for i in range(1, single.nframes):
            single.frames[i].name = f"{side}_{single.frames[i].name}"
        place = pin.SE3(pin.utils.rotate("z", yaw), np.array([x, 0.0, 0.0]))
        model = pin.appendModel(model, single, 0, place)
    data = model.createData()
    hold = np.concatenate((posture, posture))
    pin.framesForwardKinematics(model, data, hold)
    tools = [data.oMf[model.getFrameId(f"{side}_panda_hand")].copy() for side in ("left", "right")]
    middle = pin.SE3(np.eye(3), (tools[0].translation + tools[1].translation) / 2)
    for side in ("left", "right"):
        frame = model.frames[model.getFrameId(f"{side}_panda_hand")]
        model.addFrame(pin.Frame(f"{side}_tool0", frame.parentJoint, frame.placement, pin.FrameType.OP_FRAME))
    bar = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "bar")
    model.appendBodyToJoint(bar, pin.Inertia(BAR.mass, np.array(BAR.com), BAR.matrix), pin.SE3.Identity())
    for side, tool in zip(("left", "right"), tools, strict=True):
        grip = middle.actInv(tool)
        model.addFrame(pin.Frame(f"bar_{side}", bar, grip, pin.FrameType.OP_FRAME))
    return model, np.concatenate((hold, pin.SE3ToXYZQUAT(middle)))
