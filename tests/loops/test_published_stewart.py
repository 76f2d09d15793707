"""Forces published for a 6-UPS platform, to the digits in which they are published.

Data and results are those that the dynamics library aris states for its model "stewart", in `test_stewart` of
test/test_dynamic/test_dynamic_model_solver.cpp (https://github.com/py0330/aris, commit 3156dba): masses,
first moments and moments of inertia of thirteen bodies, made up so that every term shows; lengths of the legs
with their rates and accelerations; and for these the motion of the platform to 14 digits and the forces of
the legs to 16. Its authors compare within 1e-10 (placement), 1e-9 (velocity), 1e-8 (accelerations, forces).

The same platform with an arm of six hinges on it is its `test_ur5_on_stewart`, whose forces have 14 decimals.

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
# The arm, all of it in the axes of its base, which stands turned on the platform.
ARM_BASE = {"xyz": (0, 0.025, 0), "rpy": (-np.pi / 2, 0, 0)}
ARM_AXES = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 0, -1), (0, 1, 0)]
ARM_HINGES = [
    (0, 0, 0.089159),
    (0, 0.13585, 0.089159),
    (0.425, 0.01615, 0.089159),
    (0.81725, 0.01615, 0.089159),
    (0.81725, 0.10915, 0.089159),
    (0.81725, 0.10915, -0.005491),
]
ARM_LINKS = [
    (3.7, 0, 0, 0.3298883, 0.0396800068327, 0.0396800068327, 0.00666, 0, 0, 0),
    (
        *(8.393, 2.35004, 1.14018905, 0.748311487, 0.236720786311933, 0.951620579779433),
        *(1.0397965583525, -0.319252934, -0.20952721636, -0.10165811550895),
    ),
    (
        *(2.275, 1.535625, 0.03674125, 0.202836725, 0.022773090751775, 1.10407490812027),
        *(1.0865835597435, -0.02480034375, -0.136914789375, -0.00327581310875),
    ),
    (
        *(1.219, 0.99622775, 0.01968685, 0.108684821, 0.121180928114039, 0.935030114174039),
        *(1.033905071315, -0.0160890781625, -0.0888226699622501, -0.00175525985915),
    ),
    (
        *(1.219, 0.99622775, 0.13305385, 0.108684821, 0.135385813214039, 0.935030114174039),
        *(1.048109956415, -0.1087382589125, -0.0888226699622501, -0.01186294821215),
    ),
    (
        *(0.1879, 0.153561275, 0.020509285, -0.00103175889999999, 0.0193807269912699, 0.14264009052727),
        *(0.1615585404515, -0.01676121316625, 0.000843204961024989, 0.000112616483934999),
    ),
]
HINGES = tuple(f"hinge_{i}" for i in range(6))


def link(name: str, body: tuple[float, ...] = (), at: tuple[float, ...] = (0, 0, 0)) -> str:
    if not body:
        return f'<link name="{name}"/>'
    mass, moments, (xx, yy, zz, xy, xz, yz) = body[0], np.array(body[1:4]), body[4:]
    centre = moments / mass
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    about -= mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    keys = (("ixx", 0, 0), ("iyy", 1, 1), ("izz", 2, 2), ("ixy", 0, 1), ("ixz", 0, 2), ("iyz", 1, 2))
    inertia = " ".join(f'{key}="{float(about[i, j])!r}"' for key, i, j in keys)
    xyz = " ".join(repr(float(x)) for x in centre - at)
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}"/><mass value="{mass!r}"/>'
        f"<inertia {inertia}/></inertial></link>"
    )


def joint(name: str, kind: str, parent: str, child: str, xyz=(0, 0, 0), axis=(1, 0, 0), rpy=(0, 0, 0)) -> str:
    moving = "" if kind in ("fixed", "floating") else f'<axis xyz="{" ".join(map(str, axis))}"/>'
    if kind in ("prismatic", "revolute"):
        moving += '<limit lower="-9" upper="9" effort="9" velocity="9"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
        f"{moving}</joint>"
    )


def arm() -> list[str]:
    """The arm on the platform; each link's frame is where its hinge is."""
    parts = [link("arm_base"), joint("arm_foot", "fixed", "platform", "arm_base", **ARM_BASE)]
    before, parent = np.zeros(3), "arm_base"
    for name, axis, place, body in zip(HINGES, ARM_AXES, ARM_HINGES, ARM_LINKS, strict=True):
        here = np.array(place)
        parts += [link(f"{name}_link", body, place)]
        parts += [joint(name, "revolute", parent, f"{name}_link", tuple((here - before).tolist()), axis)]
        before, parent = here, f"{name}_link"
    return parts


def platform(with_arm: bool = False) -> p3dof.ClosedLoopModel:
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
    parts += arm() if with_arm else []
    sidecar = p3dof.Sidecar(closures, (*HINGES, *LEGS) if with_arm else LEGS)
    robot = p3dof.load_robot(f'<robot name="stewart">{"".join(parts)}</robot>', sidecar)
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


ARM_CASES = {
    "at rest": {
        "hinges": (0.0, 0.0, 0.2, 0.3, 0.1, 0.0),
        "rates": (0.0,) * 6,
        "accelerations": (0.0,) * 6,
        "forces": (
            *(-0.00131007958832, -58.71460842317624, -15.27196793399029, 0.08355927031103, 0.0, 0.0),
            *(38.79115991258558, 90.14001822992438, 102.29642215058338),
            *(-46.58560558137449, 12.29206464937079, 114.33889336911456),
        ),
    },
    "moving": {
        "hinges": (-0.2, -0.3, 0.5, 0.4, 0.1, 0.2),
        "rates": (
            *(0.93426722257942, -0.024823760537999, -0.89419018046124),
            *(0.245922301638701, -1.23100367003297, -0.48185561218356),
        ),
        "accelerations": (
            *(0.70807836306709, -0.496581922752884, -0.159513727427361),
            *(-0.590163055515337, 0.131806583011732, -1.65802060177352),
        ),
        "forces": (
            *(66.24194156738221, -1.05905897103295, 7.17155195304943),
            *(0.08817930939522, -2.78563372294673, -0.03526665204329),
            *(2320.18419686476227, 289.98437373182901, 2815.25099394435256),
            *(-4095.97671710069153, 3990.45076484181300, -5074.18245692169967),
        ),
    },
}


@pytest.mark.parametrize("case", ARM_CASES)
def test_forces_with_an_arm_on_the_platform_are_those_published(case):
    told, legs, robot = ARM_CASES[case], CASES[case], platform(with_arm=True)
    values, rates, accelerations = (
        (*told[arm_key], *legs[leg_key])
        for arm_key, leg_key in (
            ("hinges", "lengths"),
            ("rates", "rates"),
            ("accelerations", "accelerations"),
        )
    )
    place = pin.SE3(np.array(legs["rotation"]), np.array(legs["position"]))
    state = robot.complete(values, rates, accelerations, guess=guess(robot, place))
    assert robot.model.nv == 30
    found = robot.inverse_dynamics(state.q, state.v, state.a)
    size = np.abs(told["forces"]).max()
    np.testing.assert_allclose(found.tau, told["forces"], rtol=0, atol=1e-13 * size)
