"""Forces published for a 6-UPS platform, to the digits in which they are published.

Data and results are those that the dynamics library aris states for its model "stewart", in `test_stewart` of
test/test_dynamic/test_dynamic_model_solver.cpp (https://github.com/py0330/aris, commit 3156dba): masses,
first moments and moments of inertia of thirteen bodies, made up so that every term shows; lengths of the legs
with their rates and accelerations; and for these the motion of the platform to 14 digits and the forces of
the legs to 16. Its authors compare within 1e-10 (placement), 1e-9 (velocity), 1e-8 (accelerations, forces).

A leg's first body hangs on a universal joint, whose axes are x of the ground and z of the leg; the second one
slides along y of the leg and ends in the ball's centre.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import p3dof

FEET = [(1, 0, 0), (1, 0, 0), (0, 0, 1.732), (0, 0, 1.732), (-1, 0, 0), (-1, 0, 0)]
BALLS = [
    (0, 0, -0.289),
    (0.25, 0, 0.144),
    (0.25, 0, 0.144),
    (-0.25, 0, 0.144),
    (-0.25, 0, 0.144),
    (0, 0, -0.289),
]
# Mass, first moments by x, y, z; xx, yy, zz, xy, xz, yz of the inertia matrix about the body's origin.
LOWER = [
    (1, -0.62, 0.13, -0.58, 105.0, 116.25, 100.28, 20.11015, 12.2000345614, 0.58539),
    (1, -0.622, 0.113, -0.538, 105.2, 116.75, 100.88, 21.11015, 11.2000345614, 1.58539),
    (1.82156, -0.621, 0.131, -0.581, 105.1, 116.251, 100.281, 20.110151, 12.20003, 0.585391),
    (1.52156, -0.521, 0.231, -0.481, 115.1, 106.251, 110.281, 21.110151, 13.20003, 0.555391),
    (1.82156, -0.621, 0.131, -0.581, 105.1, 112.251, 100.281, 20.110151, 12.20003, 0.585391),
    (1.82156, -0.621, 0.131, -0.581, 125.1, 116.251, 100.281, 20.110151, 12.20003, 0.585391),
]
UPPER = [
    (1, -0.12, 0.53, -0.58, 15.0, 16.25, 100.28, 10.11015, 12.2000345614, 0.58539),
    (1, -0.621, 0.131, -0.581, 105.1, 116.251, 100.281, 20.110151, 12.20003, 0.585391),
    (0.82156, -0.6221, 0.1312, -0.5812, 105.12, 116.2512, 100.2812, 20.1101512, 12.3, 0.5853912),
    (1.82756, -0.621, 0.131, -0.581, 105.1, 116.251, 100.281, 20.110151, 12.20003, 0.585391),
    (1.82156, -0.521, 0.131, -0.581, 105.1, 116.251, 100.281, 20.110151, 12.20003, 0.585391),
    (1.82156, -0.621, 0.131, -0.581, 105.1, 126.251, 100.281, 20.110151, 12.20003, 0.585391),
]
PLATFORM = (1.82156, -0.651, 0.1313, -0.5814, 105.1, 116.271, 100.221, 20.120151, 12.22003, 0.583391)
GRAVITY = (0.0, -9.8, 0.0)
LEGS = tuple(f"leg_{i}" for i in range(6))


def link(name: str, body: tuple[float, ...] = ()) -> str:
    if not body:
        return f'<link name="{name}"/>'
    mass, moments, (xx, yy, zz, xy, xz, yz) = body[0], np.array(body[1:4]), body[4:]
    centre = moments / mass
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    about -= mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    keys = (("ixx", 0, 0), ("iyy", 1, 1), ("izz", 2, 2), ("ixy", 0, 1), ("ixz", 0, 2), ("iyz", 1, 2))
    inertia = " ".join(f'{key}="{float(about[i, j])!r}"' for key, i, j in keys)
    xyz = " ".join(repr(float(x)) for x in centre)
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}"/><mass value="{mass!r}"/>'
        f"<inertia {inertia}/></inertial></link>"
    )


def joint(name: str, kind: str, parent: str, child: str, xyz=(0, 0, 0), axis=(1, 0, 0)) -> str:
    moving = "" if kind in ("fixed", "floating") else f'<axis xyz="{" ".join(map(str, axis))}"/>'
    if kind == "prismatic":
        moving += '<limit lower="0" upper="9" effort="9" velocity="9"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{" ".join(map(str, xyz))}"/>{moving}</joint>'
    )


def platform() -> p3dof.ClosedLoopModel:
    parts = [link("ground"), link("platform", PLATFORM), joint("free", "floating", "ground", "platform")]
    for leg, foot, ball, lower, upper in zip(LEGS, FEET, BALLS, LOWER, UPPER, strict=True):
        parts += [
            *(link(f"{leg}_cross"), link(f"{leg}_lower", lower), link(f"{leg}_upper", upper)),
            link(f"{leg}_seat"),
            joint(f"{leg}_x", "continuous", "ground", f"{leg}_cross", foot),
            joint(f"{leg}_z", "continuous", f"{leg}_cross", f"{leg}_lower", axis=(0, 0, 1)),
            joint(leg, "prismatic", f"{leg}_lower", f"{leg}_upper", axis=(0, 1, 0)),
            joint(f"{leg}_ball", "fixed", "platform", f"{leg}_seat", ball),
        ]
    closures = tuple(p3dof.Closure(f"{leg}_upper", f"{leg}_seat") for leg in LEGS)
    robot = p3dof.load_robot(f'<robot name="stewart">{"".join(parts)}</robot>', p3dof.Sidecar(closures, LEGS))
    robot.model.gravity.linear = np.array(GRAVITY)
    return robot


def guess(robot: p3dof.ClosedLoopModel, place: pin.SE3) -> np.ndarray:
    """The configuration at a placement of the platform, in closed form."""
    q = pin.neutral(robot.model)

    def put(name: str, values) -> None:
        at = robot.model.idx_qs[robot.model.getJointId(name)]
        q[at : at + len(values)] = values

    put("free", pin.SE3ToXYZQUAT(place))
    for leg, foot, ball in zip(LEGS, FEET, BALLS, strict=True):
        x, y, z = place.act(np.array(ball)) - np.array(foot)
        across = np.hypot(y, z)
        length = np.hypot(across, x)
        put(f"{leg}_x", (y / across, z / across))
        put(f"{leg}_z", (across / length, -x / length))
        put(leg, (length,))
    return q


CASES = {
    "at rest": {
        "lengths": (2.0,) * 6,
        "rates": (0.0,) * 6,
        "accelerations": (0.0,) * 6,
        "rotation": (
            (1, 0, 0),
            (0, 0.999999999751072, 2.2312668404904e-05),
            (0, -2.23126684049141e-05, 0.999999999751072),
        ),
        "position": (0, 1.7078344386197, 0.577658198650165),
        "twist": (0.0,) * 6,
        "twist_rate": (0.0,) * 6,
        "forces": (
            *(11.3871054640557503, 13.6991667810515523, -5.9717817946918421),
            *(5.5825903452181880, 50.4497942853426551, 41.0950030749182460),
        ),
    },
    "moving": {
        "lengths": (2.15, 2.03, 1.98, 1.68, 2.22, 2.01),
        "rates": (0.687, 1.521, -0.325, 0.665, 1.225, -0.999),
        "accelerations": (1.687, 0.521, -1.325, 1.665, 0.225, -1.999),
        "rotation": (
            (0.654617242227831, -0.16813527373803, 0.737025641279234),
            (0.286892301165042, 0.957269694021347, -0.0364354283699648),
            (-0.699406229390514, 0.235298241883176, 0.674881962758251),
        ),
        "position": (0.0674004103296998, 1.66351811346172, 0.907546391448817),
        "twist": (  # velocity of the platform where the ground's origin is, and angular velocity
            *(1.54280498347778, -3.56723226481890, 8.32397818500295),
            *(-4.13258637478804, 0.22970180278509, 2.06026880988204),
        ),
        "twist_rate": (
            *(8.30960459916273, -12.12718110567433, 13.28720334002706),
            *(-4.70386456087146, 10.22712238559706, 12.77600107191419),
        ),
        "forces": (
            *(2124.4812403533132965, 275.7606350348426645, 2757.4743715794970740),
            *(-3994.5016219944400291, 3892.2226684026377370, -4810.0920919994805445),
        ),
    },
}


@pytest.mark.parametrize("case", CASES)
def test_forces_are_those_published(case):
    told, robot = CASES[case], platform()
    place = pin.SE3(np.array(told["rotation"]), np.array(told["position"]))
    state = robot.complete(told["lengths"], told["rates"], told["accelerations"], guess=guess(robot, place))
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, state.q, state.v, state.a)
    free = model.getJointId("free")
    np.testing.assert_allclose(data.oMi[free].homogeneous, place.homogeneous, rtol=0, atol=2e-14)
    twist = data.oMi[free].act(data.v[free]).vector
    np.testing.assert_allclose(twist, told["twist"], rtol=0, atol=2e-13)
    rate = data.oMi[free].act(data.a[free]).vector
    np.testing.assert_allclose(rate, told["twist_rate"], rtol=0, atol=1e-12)
    found = robot.inverse_dynamics(state.q, state.v, state.a)
    size = np.abs(told["forces"]).max()
    np.testing.assert_allclose(found.tau, told["forces"], rtol=0, atol=2e-13 * size)
    back = robot.forward_dynamics(state.q, state.v, told["forces"])
    np.testing.assert_allclose(back.a, state.a, rtol=0, atol=1e-9 * max(1.0, np.abs(state.a).max()))
