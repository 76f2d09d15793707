"""The tables of machines, motions, forces and any robot: every number against one of the test's own."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
import scipy.integrate
from table_numbers import check_table, shows

import p3dof
from p3dof.cli import forces as over_motion
from p3dof.cli import main
from p3dof.cli.codegen import _function_table, _kernel_table
from p3dof.cli.loop import codegen as loop_codegen
from p3dof.cli.loop.simulate import _table as run_table
from p3dof.cli.workspace import _table as means_tables
from p3dof.codegen.batch import DIRECTORY
from p3dof.codegen.frame import DOUBLE
from p3dof.codegen.machine import parameter_row
from p3dof.codegen.printing import Printer, machine_numbers
from p3dof.codegen.routines import routines
from p3dof.loops import ClosedLoopModel, Closure, Coupling, Sidecar
from p3dof.loops.sidecar import JointData
from p3dof.loops.tables import (
    actuators_table,
    assembly_table,
    bushings_table,
    closures_table,
    facts_table,
    joints_table,
    motors_table,
    overview,
)
from p3dof.machine.motion.core import motion_table
from p3dof.machine.parameters import Body, Geometry, Limits, Parameters
from p3dof.machine.parameters.tables import parameter_tables, payload_table
from p3dof.methods import InverseDynamics, JointStates
from p3dof.methods.engines.driven import Convergence
from p3dof.methods.results import evidence_table, forces_table, limits_table
from p3dof.runs import ControlLoop
from p3dof.runs.results import RobotRun

NAN = float("nan")
BODIES = {
    "slider_a": (1.1, (0.001, 0.002, -0.003), (0.011, 0.012, 0.013)),
    "slider_b": (1.2, (0, 0, 0), (0.02, 0.02, 0.02)),
    "slider_c": (1.3, (0.01, 0, 0), (0.021, 0.022, 0.023)),
    "leg_a": (0.9, (0.21, 0, 0.01), (0.001, 0.03, 0.0301)),
    "leg_b": (0.8, (0.22, 0, 0), (0.002, 0.031, 0.0311)),
    "rod_left": (0.7, (0.23, 0, 0), (0.003, 0.032, 0.0321)),
    "rod_right": (0.6, (0.24, 0, 0), (0.004, 0.033, 0.0331)),
    "crossbar_upper": (0.3, (0, 0, 0), (0.005, 0.0005, 0.0051)),
    "crossbar_lower": (0.4, (0, 0, 0), (0.006, 0.0006, 0.0061)),
}
"""Mass [kg], mass centre [m], principal moments [kg m²]."""
PRODUCTS = (0.01, -0.02, 0.03)
"""Ixy, Ixz, Iyz of the platform [kg m²]."""


def tensor(diagonal, products):
    xy, xz, yz = products
    return np.diag(diagonal) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])


@pytest.fixture(scope="module")
def machine():
    """A machine in which no two numbers are alike; its platform carries two bodies."""
    platform = Body(5.0, (0.01, -0.02, 0.03), tensor((0.31, 0.32, 0.33), PRODUCTS))
    bodies = p3dof.machine.parameters.Bodies(
        platform=platform, **{name: Body(*given) for name, given in BODIES.items()}
    )
    bare = Parameters(
        Geometry(r=0.14, R=0.33, L=0.47, b=0.05),
        bodies,
        gravity=(0.1, -0.2, -9.7),
        limits=Limits((-0.11, 0.22), 1.7, 333.0, (-0.44, 0.55)),
        friction=p3dof.machine.Friction(
            {"slide_a": 12.5, "hinge_c": 0.07}, {"hinge_c": 0.3, "slide_b": 4.5}, 0.002
        ),
        actuators=p3dof.machine.Actuators(
            {"slide_a": 1.5}, {"slide_b": 22.0}, {"slide_b": -7.0}, {"slide_c": 3.5}
        ),
    )
    return bare.carrying(Body(2.0, (0.1, 0.2, -0.3), (0.04, 0.05, 0.06))).carrying(
        Body(1.5, (0, -0.4, 0), (0, 0, 0))
    )


def joined(parts):
    """Mass, mass centre and inertia of bodies as one: sums of mass, of first and of second moments."""
    mass = sum(m for m, _, _ in parts)
    com = sum(m * np.array(c) for m, c, _ in parts) / mass
    inertia = np.zeros((3, 3))
    for m, c, given in parts:
        d = np.array(c) - com
        inertia += given + m * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, com, inertia


def cells(mass, com, inertia):
    return (mass, *com, *np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])


PLATFORM = (5.0, (0.01, -0.02, 0.03), tensor((0.31, 0.32, 0.33), PRODUCTS))
PAYLOADS = ((2.0, (0.1, 0.2, -0.3), np.diag([0.04, 0.05, 0.06])), (1.5, (0, -0.4, 0), np.zeros((3, 3))))


@shows(
    "p3dof.machine.parameters.tables.parameter_tables",
    "p3dof.machine.parameters.tables._geometry",
    "p3dof.machine.parameters.tables._limits",
    "p3dof.machine.parameters.tables._bodies",
    "p3dof.machine.parameters.tables._friction",
    "p3dof.machine.parameters.tables._actuators",
)
def test_the_tables_of_a_machine(machine):
    geometry, limits, bodies, friction, actuators = parameter_tables(machine)
    height = np.sqrt(0.47**2 - (0.33 - 0.14) ** 2)
    lengths = (0.14, 0.33, 0.47, 0.05, height)
    check_table(geometry, [(row[0], value) for row, value in zip(geometry.rows, lengths, strict=True)])
    assert [row[0][0] for row in geometry.rows] == list("rRLbh")
    check_table(
        limits,
        {
            "slider travel [m]": ((-0.11, 0.22),),
            "slider speed [m/s]": (1.7,),
            "actuator force [N]": (333.0,),
            "platform tilt θ [rad]": ((-0.44, 0.55),),
            "gravity x₀, y₀, z₀ [m/s²]": ((0.1, -0.2, -9.7),),
        },
    )
    laden = joined([PLATFORM, *PAYLOADS])
    rows = {"platform + payload": cells(*laden)}
    rows |= {name: cells(m, c, np.diag(i)) for name, (m, c, i) in BODIES.items()}
    mass = laden[0] + sum(m for m, _, _ in BODIES.values())
    order = [row[0] for row in bodies.rows]
    assert sorted(order) == sorted(rows)
    check_table(bodies, {name: rows[name] for name in order}, note=[mass, "kg move"])
    given = {"slide_a": (12.5, 0.0), "slide_b": (0.0, 4.5), "hinge_c": (0.07, 0.3)}
    check_table(friction, given, note=[0.002])
    given = {"slide_a": (1.5, 0, 0, 0), "slide_b": (0, 22.0, -7.0, 0), "slide_c": (0, 0, 0, 3.5)}
    check_table(actuators, given)


@shows("p3dof.machine.parameters.tables.payload_table")
def test_the_table_of_what_the_platform_carries(machine):
    rows = {"platform": PLATFORM, "payload 1": PAYLOADS[0], "payload 2": PAYLOADS[1]}
    rows["together"] = joined(list(rows.values()))
    check_table(payload_table(machine), {name: cells(*row) for name, row in rows.items()}, note=[3.5, "kg"])
    alone = payload_table(machine.unladen.carrying(Body(2.0, (0.1, 0.2, -0.3), (0.04, 0.05, 0.06))))
    assert [row[0] for row in alone.rows] == ["platform", "payload", "together"]
    assert payload_table(machine.unladen) is None


@shows("p3dof.machine.parameters.tables._bodies")
def test_what_is_rounding_beside_other_numbers_is_shown_as_zero():
    """A hundredth of the least number that stands beside the largest one: not a thousandth of a tenth."""
    inertia = tensor((0.3, 0.3, 0.3), (1e-16, 1e-13, 0))
    bodies = p3dof.machine.parameters.Bodies(
        platform=Body(5.0, (1.0, 1e-13, 1e-15), inertia),
        **{name: Body(*given) for name, given in BODIES.items()},
    )
    table = parameter_tables(Parameters(Geometry(r=0.14, R=0.33, L=0.47, b=0.05), bodies))[2]
    rows = {name: cells(m, c, np.diag(i)) for name, (m, c, i) in BODIES.items()}
    rows["platform"] = (5.0, 1.0, 1e-13, 0.0, 0.3, 0.3, 0.3, 0.0, 1e-13, 0.0)
    mass = 5.0 + sum(m for m, _, _ in BODIES.values())
    check_table(table, {row[0]: rows[row[0]] for row in table.rows}, note=[mass], atol=0.0)


TIME = np.array([1.0, 1.1, 1.4, 1.5, 2.0])
VALUES = np.random.default_rng(7)


@pytest.fixture(autouse=True)
def same_numbers():
    """Whatever ran before."""
    VALUES.bit_generator.state = np.random.default_rng(7).bit_generator.state


def moving():
    pose = VALUES.uniform(-0.4, 0.5, (5, 3))
    return p3dof.Motion(TIME, pose, VALUES.normal(0, 1, (5, 3)), VALUES.normal(0, 9, (5, 3)), check=False)


@pytest.fixture
def result():
    """A result of any numbers: what its tables say must come from these."""
    names = ("slide_b", "hinge_c", "slide_a", "slide_c")
    motion = moving()
    return InverseDynamics(
        "pinocchio",
        motion,
        VALUES.normal(0, 100, (5, 3)),
        JointStates(names, *(VALUES.normal(0, s, (5, 4)) for s in (0.1, 1.0, 9.0))),
        np.array([1e-16, 3.27e-9, 2e-12, 0, 0]),
        np.zeros((5, 6)),
        np.array([1.5, -812.25, 3.0, 700.0, 0]),
        np.array([1e-3, -4.44e-2, 1e-3, 4e-2, 0]),
        np.zeros(5),
        np.ones(5),
        armature=np.array([1.0, 0.0, 4.0]),
    )


def rms(values):
    """By trapezoids, one by one, over the time from the first sample to the last."""
    area = sum((values[i] ** 2 + values[i + 1] ** 2) / 2 * (TIME[i + 1] - TIME[i]) for i in range(4))
    return np.sqrt(area / (TIME[-1] - TIME[0]))


@shows("p3dof.methods.results.forces_table")
def test_the_table_of_forces(result):
    f, a = result.forces, result.joints.a[:, [2, 0, 3]]
    columns = {leg: f[:, k] for k, leg in enumerate("ABC")}
    columns |= {f"nut {leg}": f[:, k] - (1.0, 0.0, 4.0)[k] * a[:, k] for k, leg in enumerate("ABC")}
    rows = {name: (min(one), max(one), rms(one)) for name, one in columns.items()}
    check_table(forces_table(result), rows)
    bare = forces_table(p3dof.methods.InverseDynamics(**{**vars(result), "armature": np.zeros(3)}))
    check_table(bare, {leg: rows[leg] for leg in "ABC"})
    f[1, 1] = NAN
    check_table(
        bare_of_invalid(result), {"A": (*rows["A"][:2], NAN), "B": (NAN,) * 3, "C": (*rows["C"][:2], NAN)}
    )


def bare_of_invalid(result):
    return forces_table(InverseDynamics(**{**vars(result), "armature": np.zeros(3)}))


@shows("p3dof.methods.results.evidence_table")
def test_the_table_of_evidence(result):
    rows = {"pinocchio": (3.27e-9, 4.44e-2, 812.25)}
    check_table(evidence_table(result), rows)
    told = {"pinocchio": (*rows["pinocchio"], (72.1, "µs"))}  # of five samples in 360.5 µs
    check_table(evidence_table(result, seconds=[360.5e-6]), told)
    result.forces[1] = result.power[1] = NAN  # an invalid sample has no say in errors, and there is no peak
    check_table(evidence_table(result), {"pinocchio": (2e-12, 4e-2, NAN)})


def vertex(values, i):
    """When the parabola through a sample and its neighbours is level."""
    if i in (0, 4):
        return TIME[i]
    second, first, _ = np.polyfit(TIME[i - 1 : i + 2] - TIME[i], values[i - 1 : i + 2], 2)
    return TIME[i] - first / (2 * second)


@shows("p3dof.methods.results.limits_table")
def test_the_table_of_limits(result):
    limits = Limits(travel=(-0.11, 0.2), speed=1.5, force=130.0, tilt=(-0.5, 0.41))
    order, rows = [2, 0, 3], {}
    used = {
        ("force", "N", -130.0, 130.0): result.forces,
        ("speed", "m/s", -1.5, 1.5): result.joints.v[:, order],
        ("travel", "m", -0.11, 0.2): result.joints.q[:, order],
        ("tilt", "rad", -0.5, 0.41): result.motion.pose[:, 2:],
    }
    for (what, unit, low, high), columns in used.items():
        for name, values in zip("ABC" if what != "tilt" else ["platform"], columns.T, strict=True):
            shares = [max(value / low, value / high) for value in values]
            i = int(np.argmax(shares))
            limit = low if values[i] < 0 else high
            rows[f"{what} {name} [{unit}]"] = (values[i], vertex(values, i), limit, shares[i])
    check_table(limits_table(result, limits), rows)
    result.forces[2, 2] = NAN
    rows |= {name: (NAN, NAN, row[2], NAN) for name, row in rows.items() if name[:5] in ("force", "speed")}
    rows |= {f"force {leg} [N]": (NAN, NAN, 130.0, NAN) for leg in "ABC"}
    rows |= {f"speed {leg} [m/s]": (NAN, NAN, 1.5, NAN) for leg in "ABC"}
    check_table(limits_table(result, limits), rows)


@shows("p3dof.machine.motion.core.motion_table")
def test_the_table_of_a_motion():
    motion, loads = moving(), VALUES.normal(0, 50, (5, 6))
    rows = {}
    for k, name in enumerate(("y [m], per s, per s²", "z [m], per s, per s²", "θ [rad], per s, per s²")):
        rows[name] = (min(motion.pose[:, k]), max(motion.pose[:, k]))
        rows[name] += (max(map(abs, motion.velocity[:, k])), max(map(abs, motion.acceleration[:, k])))
    check_table(motion_table(motion), rows, note=[5, 1.0])
    largest = [max(abs(value) for value in column) for column in loads.T]
    check_table(motion_table(motion, loads), rows, note=[5, 1.0, *largest])
    check_table(motion_table(motion, 0 * loads), rows, note=[5, 1.0, "No external load"])


# Any robot.

GEARED = Sidecar(
    (Closure("left_tip", "right_tip"),),
    ("left_joint", "right_joint"),
    joint_data=(
        JointData("right_joint", rotor_inertia=2.5e-4, gear_ratio=-50.0),
        JointData("left_joint", damping=1.0),
    ),
)


@pytest.fixture(scope="module")
def five_bar():
    return ClosedLoopModel.from_urdf(robots.five_bar(), GEARED)


@shows("p3dof.loops.tables.actuators_table", "p3dof.loops.tables.motors_table")
def test_the_tables_of_actuators_and_motors(five_bar):
    """Two joints, of which the second has a gear that turns it around; speeds and forces of any numbers."""
    v, tau = VALUES.normal(0, 2, (5, five_bar.model.nv)), VALUES.normal(0, 30, (5, 2))
    rows = {}
    for i, name in enumerate(("left_joint", "right_joint")):
        speed = v[:, five_bar.model.joints[five_bar.model.getJointId(name)].idx_v]
        force, power = tau[:, i], tau[:, i] * speed
        k, m = (max(range(5), key=lambda n: abs(one[n])) for one in (force, power))
        rows[name] = (force[k], TIME[k], rms(force), "N m", power[m])
    check_table(actuators_table(five_bar, TIME, tau, v), rows)
    at = five_bar.model.joints[five_bar.model.getJointId("right_joint")].idx_v
    peaks = max(abs(tau[:, 1])) / 50, max(abs(v[:, at])) * 50
    check_table(motors_table(five_bar, tau, v), {"right_joint": (-50.0, 2.5e-4, *peaks)}, header=())
    plain = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    assert motors_table(plain, tau, v) is None
    once = actuators_table(five_bar, TIME[:1], tau[:1], v[:1])  # of one sample, its own value
    assert [row[3] for row in once.rows] == pytest.approx(np.abs(tau[0]))


CARRIAGE = robots.robot(
    robots.link("base"),
    robots.link("carriage", robots.ROD),
    robots.link("wheel", robots.BAR),
    robots.link("arm", robots.ARM),
    robots.link("screw", robots.Solid(0.123456, (0, 0, 0), (1, 0, 0, 1, 0, 1))),
    robots.joint("rail", "base", "carriage", kind="prismatic"),
    robots.joint("turn", "carriage", "wheel", kind="continuous"),
    robots.joint("swing", "wheel", "arm", (0.4, 0, 0)),
    robots.joint("drive", "base", "screw", axis=(0, 0, 1)),
).replace('lower="-9" upper="9"', 'lower="-0.25" upper="1.5"', 1)
CARRIAGE_SIDECAR = Sidecar((), ("drive", "turn"), couplings=(Coupling("rail", "drive", (0.1, 0.02)),))


@shows(
    "p3dof.loops.tables.joints_table",
    "p3dof.loops.tables.closures_table",
    "p3dof.loops.tables.facts_table",
    "p3dof.loops.tables.assembly_table",
)
def test_the_tables_of_a_robot_with_all_roles():
    """A screw that drives a slide, a wheel with a motor, an arm that is idle: counts by hand."""
    robot = ClosedLoopModel.from_urdf(CARRIAGE, CARRIAGE_SIDECAR)
    assembly = robot.assemble({"drive": 0.7, "turn": 2.5})
    seen = overview(robot, assembly.q)
    masses = {"rail": robots.ROD.mass, "turn": robots.BAR.mass, "swing": robots.ARM.mass, "drive": 0.123456}
    told = {
        "rail": ("prismatic", "follows drive", masses["rail"], (-0.25, "to", 1.5)),
        "turn": ("continuous", "actuated", masses["turn"], NAN),
        "swing": ("revolute", "passive", masses["swing"], (-9, "to", 9)),
        "drive": ("revolute", "actuated", masses["drive"], (-9, "to", 9)),
    }
    order = [str(name) for name in robot.model.names[1:]]
    check_table(joints_table(robot, seen), {name: told[name] for name in order})
    unseen = joints_table(robot)
    assert [row[2] for row in unseen.rows] == [told[name][1].replace("passive", "") for name in order]
    check_table(closures_table(robot, seen), {"rail=drive": ("coupling", 1, (1, "of", 1))})
    check_table(closures_table(robot), {"rail=drive": ("coupling", 1, NAN)})
    facts = {
        "joints": (4,),
        "degrees of freedom of the tree": (4,),
        "rows of closures and couplings": (1,),
        "largest gap": (3.21e-7,),
        "rank": (1,),
        "mobility": (3,),  # four freedoms less one coupling: motor, wheel, arm
        "actuated joints": (2,),
        "controlled free motions": (2,),
        "passive joints": (1,),
        "actuator forces": ("unique",),
        "moving mass": ((sum(masses.values()), "kg"),),
        "gravity": ((0, 0, -9.81),),
    }
    check_table(facts_table(robot, seen, 3.21e-7), facts)
    unknown = {"largest gap", "rank", "mobility"}
    rest = {"controlled free motions", "passive joints", "actuator forces"}
    blank = {name: (NAN,) if name in unknown else row for name, row in facts.items() if name not in rest}
    check_table(facts_table(robot), blank)
    values = {
        "rail": (0.1 + 0.02 * 0.7, "m"),
        "turn": (2.5, "rad"),
        "swing": (0.0, "rad"),
        "drive": (0.7, "rad"),
    }
    found = p3dof.loops.Assembly(assembly.q, 4.56e-11, 17, assembly.evidence)
    note = [4.56e-11, "rank 1", 1, "mobility 3", 3, 17, "iterations", "is the same"]
    check_table(assembly_table(robot, found), {name: values[name] for name in order}, note=note, atol=1e-9)


@shows("p3dof.loops.tables.bushings_table")
def test_the_table_of_bushings():
    mount = p3dof.loops.Bushing(("coupler_tip", "rocker_tip"), (3e4, 2e4, 0, 5, 0, 0), (0, 0, 0, 0, 0.25, 0))
    sidecar = Sidecar((), ("crank_joint",), bushings=(mount, replace(mount, name="mount")))
    robot = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)
    row = "coupler_tip/rocker_tip", (3e4, 2e4, 0, 5, 0, 0), (0, 0, 0, 0, 0.25, 0)
    check_table(bushings_table(robot), {"coupler_tip/rocker_tip": row, "mount": row})


@shows("p3dof.loops.tables.closures_table", "p3dof.loops.tables.facts_table")
def test_the_tables_of_a_robot_with_redundant_closures():
    """A plane four-bar whose closure has three rows: axes across keep points in their planes alone."""
    sidecar = Sidecar((Closure("coupler_tip", "rocker_tip", "3d"),), ("crank_joint",))
    robot = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)
    seen = overview(robot, robots.four_bar_q(1.1, *robots.FOUR_BAR))
    check_table(closures_table(robot, seen), {"coupler_tip/rocker_tip": ("3d", 3, (2, "of", 3))})
    expected = {
        "joints": (3,),
        "degrees of freedom of the tree": (3,),
        "rows of closures and couplings": (3,),
        "largest gap": (NAN,),
        "rank": (2,),
        "mobility": (1,),
        "actuated joints": (1,),
        "controlled free motions": (1,),
        "passive joints": (0,),
        "actuator forces": ("unique",),
        "moving mass": (robots.ROD.mass + robots.BAR.mass + robots.ARM.mass,),
        "gravity": ((0, 0, -9.81),),
    }
    check_table(facts_table(robot, seen), expected)


@shows("p3dof.loops.tables.assembly_table")
def test_the_values_of_a_ball_joint_stand_together():
    model = pin.Model()
    ball = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.addJoint(ball, pin.JointModelPZ(), pin.SE3.Identity(), "slide")
    robot = ClosedLoopModel(model, Sidecar((), ("slide",)))
    evidence = SimpleNamespace(rank=2, mobility=5, kept=False)
    q = np.array([0.1, -0.5, 0.5, 0.7, -0.25])
    table = assembly_table(robot, p3dof.loops.Assembly(q, 0.0, 3, evidence))
    rows = {"ball": (tuple(q[:4]), "m, rad"), "slide": (-0.25, "m")}
    check_table(table, rows, note=[0, 2, 5, 3, "perhaps another one"])


# Tables of commands.


@shows("p3dof.cli.loop.simulate._table")
def test_the_table_of_a_run(five_bar):
    """A run of any numbers: energy from end to end, largest values of all columns."""
    v, a = (VALUES.normal(0, 2, (5, five_bar.model.nv)) for _ in range(2))
    q, energy = VALUES.normal(0, 1, (5, five_bar.model.nq)), VALUES.normal(0, 100, 5)
    forces, gap = VALUES.normal(0, 30, (5, 2)), np.array([0, 1e-9, 3.45e-6, 0, 0])
    run = RobotRun(five_bar, TIME, q, v, a, forces, forces, gap, energy, None, 1)
    columns = [five_bar.model.joints[five_bar.model.getJointId(name)].idx_v for name in five_bar.actuated]

    def work(mean):
        return sum(
            mean(forces[n, i], forces[n + 1, i], TIME[n + 1] - TIME[n]) * (q[n + 1, at] - q[n, at])
            for n in range(4)
            for i, at in enumerate(columns)
        )

    rows = {
        "time": ((2.0, "s"),),
        "method": ("general",),
        "energy gained": (energy[4] - energy[0],),
        "work of the actuators": (work(lambda before, after, _: (before + after) / 2),),
        "largest force of an actuator": (max(abs(forces.ravel())),),
        "largest speed of a joint": (max(abs(v.ravel())),),
        "largest gap of a loop": (3.45e-6,),
    }
    check_table(run_table(run, ControlLoop()), rows)

    def lagging(before, after, step):
        """The mean of a force that goes on from one sample to the next as a first-order lag of 0.7 Hz."""
        left = np.exp(-2 * np.pi * 0.7 * step)
        asked = (after - before * left) / (1 - left)
        force = scipy.integrate.quad(
            lambda t: asked + (before - asked) * np.exp(-2 * np.pi * 0.7 * t), 0, step, epsabs=1e-13
        )
        return force[0] / step

    for control, mean in (
        (ControlLoop(rate=0.5), lambda *forces: forces[0]),
        (ControlLoop(rate=0.5, bandwidth=0.7), lagging),
        (ControlLoop(rate=50), lambda *_: NAN),  # more changes than samples
    ):
        check_table(run_table(run, control), rows | {"work of the actuators": (work(mean),)})
    wanted = q[:, columns] + np.array([[0, 0], [0.01, -0.2], [0, 0.1], [0, 0], [0.3, 0]])
    led = RobotRun(five_bar, TIME, q, v, a, forces, forces, gap, energy, None, 1, reference=wanted)
    first, *rest = rows.items()
    rows = dict([first, ("largest error of an actuated joint", (0.3,)), *rest])
    check_table(run_table(led, ControlLoop()), rows)


@shows("p3dof.cli.workspace._table")
def test_the_table_of_means():
    means = {
        "lti": {"mean": 0.8, "least": 0.3, "largest": 0.95, "share from 0.7": 0.8764},
        "actuation": {"mean": None, "least": None, "largest": 1.23},
    }
    (table,) = means_tables(means)
    rows = {"lti": (0.8, 0.3, 0.95, table.rows[0][4]), "actuation": (NAN, NAN, 1.23, table.rows[1][4])}
    check_table(table, rows, note=["LTI", 0.7, 0.8764])
    assert means_tables({}) == []


def operations(lines, results):
    """Count the operations that results of C need, but those on constants: sums, signs, functions."""
    made = {}
    for line in lines:
        pair = re.search(r"sin\w*\((.*), &(\w+), &(\w+)\);", line)
        one = re.match(r" *(?:const )?(?:double )?(\w+) = (.*);", line)
        several = [(pair[2], pair[1]), (pair[3], pair[1])] if pair else [one.groups()] if one else []
        for name, text in several:
            done = pair or re.search(r" [-+*/?] |\b\w+\(|^-\w", text)
            made.setdefault(name, (bool(done), re.findall(r"\b[a-zA-Z]\w*\b(?!\()", text)))
    varies = {name: not name.startswith("k_") for _, names in made.values() for name in names}
    for name, (_, names) in made.items():
        varies[name] = any(varies[one] for one in names)
    needed, left = set(), list(results)
    while left:
        name = left.pop()
        if name in made and name not in needed and varies[name]:
            needed.add(name)
            left += made[name][1]
    return sum(made[name][0] for name in needed)


@shows("p3dof.cli.codegen._kernel_table")
def test_the_table_of_kernels_counts_what_the_c_does():
    """In the committed C, of one sample: what all results but the last, the margin, are computed from."""
    header = (DIRECTORY / "batch_kernels.h").read_text()
    found = {}
    for name, body in re.findall(r"P3DOF_NAME\((\w+)\)\(\n(.*?)\n}\n", header, re.DOTALL):
        alone = re.sub(r"P3DOF_NAME\((\w+)\)|\[[0i]\]", r"\1", body.partition("return;")[0])
        lines, outputs = alone.splitlines(), re.findall(r"restrict (f\d+) =", alone)
        found[name] = operations([line for line in lines if "restrict" not in line], outputs[:-1])
    table = _kernel_table()
    rows = {row[0]: (found[row[0]], found.get(f"{row[0]}_symmetric", found[row[0]])) for row in table.rows}
    check_table(table, rows)


class Symmetric(Printer):
    """Prints for machines that are symmetric: what is zero of such a machine is zero, and stays so."""

    def _put_in_machine(self, numbers):  # noqa: ARG002
        body = Body(1.2, (0, 0, 0), (0.2, 0.3, 0.4))
        bodies = p3dof.machine.parameters.Bodies.alike(
            slider=body, leg=Body(1.3, (0.21, 0, 0), (0.2, 0.5, 0.6)), crossbar=body, platform=body
        )
        row = parameter_row(Parameters(Geometry(r=0.1234, R=0.3456, L=0.5678, b=0.0712), bodies))
        zeros = {name for name, value in machine_numbers(row).items() if value == 0} | {"steepness"}
        for name in {*machine_numbers(row), *DOUBLE.tolerances}:
            symbol = self.tape.symbol(f"k[{name}]")
            self.names[symbol.index] = f"k[{name}]"
            self._known[routines().symbols[name].index] = 0 if name in zeros else symbol


@shows("p3dof.cli.codegen._function_table")
def test_the_table_of_functions_counts_what_the_c_does(machine):
    """Checks included; friction is the block that is entered if there is any, and what it takes away."""
    rows, numbers = {}, machine_numbers(parameter_row(machine))
    for routine in routines().all:
        general, friction = counts(Printer(routine).code())
        alone = [re.sub(r" \+ added\[\d+\]", "", line) for line in Symmetric(routine).code()]
        symmetric, baked = (counts(one)[0] for one in (alone, Printer(routine, numbers).code()))
        rows[routine.name] = (general, symmetric, friction, baked)
    check_table(_function_table(machine), rows)


def counts(code):
    """Operations of a function without its block for friction, and what that block adds."""
    code = [re.sub(r"\[(\w+)\]", r"_\1", line) for line in code if "NULL" not in line]
    begin = next((i for i, line in enumerate(code) if line.startswith("if (model->friction")), len(code))
    end = next((i for i in range(begin, len(code)) if code[i] == "}"), begin)
    checked = [name for line in code if line.startswith("if (!") for name in re.findall(r"\w+", line)]
    found = [line.split()[0] for line in code if line.startswith("found_")]
    without = operations([*code[:begin], *code[end + 1 :]], [*checked, *found])
    block = [line.split() for line in code[begin + 1 : end]]
    of_block = operations(code, [*checked, *found, *(name for line in block for name in line[:3])])
    return without, of_block - without + sum("-=" in line for line in block)


@shows("p3dof.cli.loop.codegen.codegen")
def test_the_table_of_a_robots_functions_counts_what_the_c_does(tmp_path, monkeypatch):
    """Signs count nothing here."""
    (tmp_path / "robot.urdf").write_text(robots.four_bar(*robots.FOUR_BAR))
    (tmp_path / "robot.yaml").write_text(robots.FOUR_BAR_SIDECAR.to_yaml())
    shown = []
    monkeypatch.setattr(loop_codegen, "show", lambda _, table: shown.append(table))
    chosen = "inverse_dynamics,forward_dynamics,motion"
    options = ["--functions", chosen, "--prefix", "robot", "--out", str(tmp_path / "c")]
    assert main(["loop", "codegen", str(tmp_path / "robot.urdf"), *options]) == 0
    source, rows = (tmp_path / "c/robot.c").read_text(), {}
    for name, body in re.findall(r"void compute_(\w+)\(.*?\n{\n(.*?)\n}\n", source, re.DOTALL):
        text = re.sub(r"\[(\w+)\]", r"_\1", body).replace("zero + ", "").replace("= -", "= ")
        rows[name] = (operations(text.splitlines(), re.findall(r"\bout_\d+", text)),)
    assert sorted(rows) == sorted(chosen.split(","))
    check_table(shown[0], {row[0]: rows[row[0]] for row in shown[0].rows})


@shows("p3dof.cli.forces._print_convergence")
def test_the_table_of_convergence(monkeypatch):
    """Of errors that fall by 4.1 and 7.9: the orders are their logarithms to base 2."""
    errors = np.array([0.041, 0.01, 0.01 / 7.9])
    found = Convergence(
        "trapezoidal", np.array([2e-3, 1e-3, 5e-4]), TIME, 100.0, errors, np.array([3.4e-9, 2e-10, 1e-11]),
        np.zeros((5, 3)), 6.7e-6,
    )  # fmt: skip
    shown = []
    monkeypatch.setattr(over_motion, "show", lambda _, table: shown.append(table))
    monkeypatch.setattr(over_motion.engines, "convergence", lambda *_, **__: found)
    over_motion._print_convergence(
        None, SimpleNamespace(robot=p3dof.load(), motion=p3dof.paper_motion(11), history=None)
    )
    rows = {
        "2": (0.041, "", 3.4e-9),
        "1": (0.01, np.log(4.1) / np.log(2), 2e-10),
        "0.5": (0.01 / 7.9, np.log(7.9) / np.log(2), 1e-11),
        "→ 0": (6.7e-6, "", ""),
    }
    check_table(shown[0], rows)
