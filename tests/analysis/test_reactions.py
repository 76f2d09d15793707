"""Reactions in the joints, against bookkeeping that shares nothing with the recursion through the tree."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from joint_forces import Bookkeeping, X, Y, Z, motion_of
from machines import random_machine, random_states, virtual_power_forces
from table_numbers import check_evidence, check_table, shows

import p3dof
from p3dof._base.errors import (
    DynamicsError,
    InputError,
    ModelError,
    ReachError,
    SampleError,
    SingularityError,
)
from p3dof.analysis.reactions import (
    JOINTS,
    Misfit,
    ReactionsComparison,
    Stiffness,
    how_chosen,
    names_table,
    open_tables,
    reactions_table,
)
from p3dof.analysis.reactions.evaluation import of_result, of_solution, over_motion
from p3dof.analysis.reactions.results import JointReaction, cuts, loads_of
from p3dof.cli import main
from p3dof.cli.output import rich_table
from p3dof.closed_form import kinematics
from p3dof.loops import ClosedLoopModel, Closure, Sidecar
from p3dof.loops.reactions import ClosureJoint, ReactionSolver, loop_reactions
from p3dof.machine import description
from p3dof.machine.motion import Motion, paper_motion, states_over
from p3dof.machine.parameters import PAPER, PASSIVE, SLIDES, SOLIDS, Bodies, Body, Friction, Parameters
from p3dof.methods.pinocchio import PinocchioMethod

KINDS = ("paper", "points")
WAYS = ("elastic", *KINDS)
OPEN = {"paper": 6, "points": 2}


@lru_cache
def case(name: str) -> tuple[Parameters, Motion, np.ndarray]:
    """A machine, states of motion (whatever the time), and wrenches on the platform."""
    if name in ("PAPER", "SOLIDS"):
        motion = paper_motion(41)
        wrench = np.random.default_rng(3).normal(0, 20, (41, 6))
        return (PAPER if name == "PAPER" else SOLIDS), motion, wrench
    seed = int(name)
    parameters = random_machine(seed)
    states = random_states(parameters, seed, 6, side=(1, -1)[seed % 2])
    return parameters, motion_of(states), states.wrench


CASES = ("PAPER", "SOLIDS", *map(str, range(4)))


@lru_cache
def solved(name: str, kind: str):
    parameters, motion, wrench = case(name)
    return over_motion(p3dof.load(parameters).loop, parameters, motion, kind, wrench)


# --- bookkeeping on the closed forms: bodies, ends of joints, 60 equations ----------------------------------


def test_forces_that_produce_no_sample_of_a_motion_are_named():
    """None at all, which once was an error of NumPy."""
    robot, motion = p3dof.load(), p3dof.paper_motion(5)
    result = robot.inverse_dynamics(motion)
    wrong = replace(result, forces=result.forces + 10.0)
    with pytest.raises(SampleError, match="sample 0: tau: the forces do not produce the motion"):
        of_result(robot.loop, robot.parameters, wrong, "elastic")


def largest(values):
    return np.abs(values).max(axis=tuple(range(1, np.ndim(values))))


def scales(result):
    """Largest force and moment of each sample."""
    return largest(result.forces), largest(result.moments)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CASES)
def test_every_body_obeys_newton_and_euler(name, kind):
    parameters, motion, wrench = case(name)
    result = solved(name, kind)
    assert len(result.time) >= 3
    newton, euler = Bookkeeping(parameters, motion, wrench).errors(result)
    force, moment = scales(result)
    arm = force * parameters.geometry.L  # moments of forces cancel in Euler's equation
    assert np.all(largest(newton) <= 1e-10 * force)
    assert np.all(largest(euler) <= 1e-10 * np.maximum(moment, arm))
    errors = np.maximum(largest(newton), largest(euler))
    assert np.all(np.abs(result.residual - errors) <= 1e-11 * np.maximum(force, np.maximum(moment, arm)))


MORE = np.array([[0.3, 0.05, 0.02], [0.05, 0.5, -0.04], [0.02, -0.04, 0.4]])
WRONG = {
    "mass": (1.5, np.zeros(3), 0 * MORE),
    "centre": (0, [0.02, -0.03, 0.05], 0 * MORE),
    "inertia": (0, np.zeros(3), MORE),
}


def with_an_error(way, wrong, motion, stiffness=None):
    """Reactions whose equations miss by the weight of another mass, centre or inertia; and by how much."""
    robot, own = p3dof.load(), PAPER.bodies.platform
    mass, away, inertia = WRONG[wrong]
    body = Body(own.mass + mass, own.com + away, own.inertia + inertia)
    other = replace(PAPER, bodies=replace(PAPER.bodies, platform=body))
    found = of_result(robot.loop, other, robot.inverse_dynamics(motion), way, stiffness=stiffness)
    expected = []
    for (*_, theta), (*_, rate), (*along, change) in zip(
        motion.pose, motion.velocity, motion.acceleration, strict=True
    ):
        c, s = np.cos(theta), np.sin(theta)
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # about y0
        arms = turn @ np.column_stack([own.com, body.com])
        bent = change * np.cross(Y, arms.T) + rate**2 * np.cross(Y, np.cross(Y, arms.T))
        right, left = (
            one.mass * (np.array([0, *along]) + part - PAPER.gravity)
            for one, part in zip((own, body), bent, strict=True)
        )
        more = turn @ inertia @ turn.T @ Y
        euler = change * more + rate**2 * np.cross(Y, more) + np.cross(turn @ away, right)
        expected.append(max(np.abs(left - right).max(), np.abs(euler).max()))
    return found, np.array(expected)


@pytest.mark.parametrize("wrong", WRONG)
@shows(
    "p3dof.analysis.reactions.results.Reactions.residual",
    "p3dof.analysis.reactions.comparison.ReactionsComparison.residual",
)
def test_the_residual_is_the_error_that_was_put_in(wrong):
    for way in (*WAYS, "all"):
        found, expected = with_an_error(way, wrong, paper_motion(8))
        assert min(expected) > 0.1
        check_evidence(found, "residual", expected, rtol=1e-9)
    parts = [replace(one, residual=(k + 1) * expected) for k, one in enumerate(found.each)]
    check_evidence(ReactionsComparison(*parts), "residual", 3 * expected, rtol=1e-9)


FORCES, MOMENTS = ("force", "axial", "radial", "rms_force"), ("moment", "across", "rms_moment")


def loads_by_hand(result, joint):
    """The loads of `LOADS` of a joint, and which have an open component, sample by sample."""
    i, one = result.joints.index(joint), result[joint]
    axis = 2 if joint.startswith("slide") else 1
    others = [k for k in range(3) if k != axis]
    step = np.diff(result.time)

    def mean(squares):
        return np.sqrt((step * (squares[1:] + squares[:-1]) / 2).sum() / step.sum())

    force, moment = ((part**2).sum(axis=1) for part in (one.forces, one.moments))
    values = {
        "force": np.sqrt(force.max()),
        "axial": max(abs(one.forces[:, axis])),
        "radial": np.sqrt((one.forces[:, others] ** 2).sum(axis=1).max()),
        "rms_force": mean(force),
        "moment": np.sqrt(moment.max()),
        "across": np.sqrt((one.moments[:, others] ** 2).sum(axis=1).max()),
        "rms_moment": mean(moment),
    }
    if result.cuts == "points" and joint.startswith("loop"):
        values |= dict.fromkeys(("axial", "radial", "across"), np.nan)  # a ball has no axis
    seen = {"axial": [axis], "radial": others, "across": others}
    known = {"f": result.determined_forces[:, i], "m": result.determined_moments[:, i]}
    marked = {
        name
        for name, value in values.items()
        if not np.isnan(value)
        and not known["f" if name in FORCES else "m"][:, seen.get(name, [0, 1, 2])].all()
    }
    fits = [np.sqrt((result.fit[:, 0, i, k] ** 2).sum(axis=1).max()) for k in (0, 1)]
    return values, marked, fits


ROWS, PART = [0, 7, 11, 23, 24, 40], paper_motion(41)
UNEVEN = Motion(
    PART.time[ROWS] + 3, PART.pose[ROWS], PART.velocity[ROWS], PART.acceleration[ROWS], check=False
)
ORDER = ("force", "axial", "radial", "rms_force", "moment", "across", "rms_moment")
NAMED = {joint.name: f"{joint.name} ({joint.label})" for joint in JOINTS}


@pytest.mark.parametrize("way", [*WAYS, "all"])
@shows("p3dof.analysis.reactions.comparison.reactions_table")
def test_every_number_of_the_table_of_reactions(way):
    """Uneven times, misfits, and forces that miss the equations, so that no number of it is zero."""
    motion, stiffness = UNEVEN, Stiffness(misfit=Misfit(2e-5, 3e-4))
    result, errors = with_an_error(way, "mass", motion, stiffness)
    sized = result.elastic if way == "all" else result
    rows = {}
    for joint in result.joints:
        values, marked, fits = loads_by_hand(sized, joint)
        if way == "all":
            marked = set.union(*(loads_by_hand(one, joint)[1] for one in result.each))
        open_ = ("~",) if sized.way == "elastic" else ()
        cells = [
            values[name] if name not in marked else (*open_, values[name]) if open_ else "open"
            for name in ORDER
        ]
        rows[NAMED[joint]] = [*cells, *(fits if open_ else ())]
    check_table(reactions_table(result), rows, note=[errors.max()], atol=1e-9)


@shows("p3dof.analysis.reactions.comparison.open_tables")
def test_every_number_of_the_tables_of_open_loads():
    result = robot_reactions(UNEVEN)
    found = {joint: [loads_by_hand(one, joint) for one in result.each] for joint in result.joints}
    for table, names in zip(open_tables(result), (FORCES, MOMENTS), strict=True):
        rows = {}
        for joint, each in found.items():
            marked = set.union(*(marked for _, marked, _ in each)) & {*names}
            cells = (
                [values[name] for values, _, _ in each] if name in marked else [""] * 3 for name in names
            )
            if marked:
                rows[NAMED[joint]] = [cell for three in cells for cell in three]
        check_table(table, rows, atol=1e-9)
        assert len(rows) > 3


@shows("p3dof.analysis.reactions.comparison.names_table")
def test_the_key_of_the_joints_names_has_no_numbers():
    """Labels of the paper's drawing; what each is stands in words."""
    legs = {"A": ("slide_a", "hinge_a", "loop_a"), "B": ("slide_b", "hinge_b", "loop_b")}
    legs["C"] = ("slide_c", "hinge_c", "hinge_left", "hinge_lower", "hinge_platform", "hinge_right", "loop_c")
    rows = [
        (f"{leg}{k}", name, ("platform" if "loop" in name and leg < "C" else "",))
        for leg, names in legs.items()
        for k, name in enumerate(names, 1)
    ]
    check_table(names_table(), rows)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CASES)
def test_joints_transmit_what_they_can(name, kind):
    parameters, motion, wrench = case(name)
    result = solved(name, kind)
    states = motion.pose, motion.velocity, motion.acceleration
    actuators = virtual_power_forces(parameters, *states, wrench)
    force, moment = scales(result)
    slides = np.stack([result[s].forces[:, 2] for s in ("slide_a", "slide_b", "slide_c")], axis=-1)
    assert np.all(largest(slides - actuators) <= 1e-10 * force)
    hinges = [i for i, joint in enumerate(JOINTS) if joint.name.startswith("hinge")]
    assert np.all(largest(result.moments[:, hinges, 1]) <= 1e-10 * np.maximum(moment, force))
    cuts = result.moments[:, 10:]
    if kind == "points":
        assert not np.any(cuts)
        return
    platform = kinematics.mechanism_motion(parameters.geometry, *states).bodies["platform"].rotation[..., 1]
    legs = result.in_base()[1][:, 10:12]
    assert np.all(np.abs(cuts[..., 1]) <= 1e-10 * moment[:, None])  # legs' and rod's own hinge axes
    assert np.all(np.abs(np.einsum("nki,ni->nk", legs, platform)) <= 1e-10 * moment[:, None])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CASES)
def test_the_ground_bears_momentum_weight_and_load(name, kind):
    parameters, motion, wrench = case(name)
    result = solved(name, kind)
    book = Bookkeeping(parameters, motion, wrench)
    force = sum(need for need, _ in book.needs.values())
    moment = sum(m + np.cross(book.centre[name], f) for name, (f, m) in book.needs.items())  # about O
    forces, moments = result.in_base()
    ground = [0, 2, 4]
    at = np.stack([book.ends[s][3] for s in ("slide_a", "slide_b", "slide_c")], axis=1)
    borne = (moments + np.cross(result.positions, forces))[:, ground].sum(axis=1)
    np.testing.assert_allclose(result.positions[:, ground], at, rtol=0, atol=1e-12 * parameters.geometry.L)
    scale_f, scale_m = scales(result)
    assert np.all(largest(forces[:, ground].sum(axis=1) - force) <= 1e-10 * scale_f)
    assert np.all(largest(borne - moment) <= 1e-10 * np.maximum(scale_m, scale_f * parameters.geometry.L))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_friction_lies_along_the_joints_freedoms(seed, kind):
    parameters, motion, wrench = case(str(seed))
    rng = np.random.default_rng(seed)
    names = (*SLIDES, *PASSIVE)
    viscous, coulomb = ({name: rng.uniform(0, 3) for name in names} for _ in range(2))
    friction_ = Friction(viscous, coulomb, smoothing=0.3)
    parameters = Parameters(
        parameters.geometry, parameters.bodies, gravity=parameters.gravity, friction=friction_
    )
    result = over_motion(p3dof.load(parameters).bare_loop, parameters, motion, kind, wrench)
    newton, euler = Bookkeeping(parameters, motion, wrench).errors(result)
    force, moment = scales(result)
    bound = 1e-10 * np.maximum(moment, force * parameters.geometry.L)
    assert np.all(largest(newton) <= 1e-10 * force)
    assert np.all(largest(euler) <= bound)

    def resisting(name, rate):
        return -viscous[name] * rate - coulomb[name] * np.tanh(rate / 0.3)

    states = motion.pose, motion.velocity, motion.acceleration
    moving = kinematics.mechanism_motion(parameters.geometry, *states)
    actuators = virtual_power_forces(parameters, *states, wrench)
    for k, name in enumerate(SLIDES):
        along = actuators[:, k] + resisting(name, moving.slider_velocities[:, k])
        assert np.all(np.abs(result[name].forces[:, 2] - along) <= 1e-10 * force)
    for joint in result.joints[:10]:
        if joint.startswith("hinge"):
            along = resisting(joint, moving.velocity[joint])
            assert np.all(np.abs(result[joint].moments[:, 1] - along) <= bound)
    cuts = result.in_base()[1][:, 10:]
    for k, (name, leg) in enumerate((("universal_a", "leg_a"), ("universal_b", "leg_b"))):
        for axis in (0, 1):  # x0 and y0
            rate = (moving.bodies["platform"].omega - moving.bodies[leg].omega)[:, axis]
            assert np.all(np.abs(cuts[:, k, axis] - resisting(name, rate)) <= bound)
    rate = moving.velocity["hinge_lower"]  # the rods move alike
    along = resisting("hinge_lower_right", rate)
    assert np.all(np.abs(result["loop_c"].moments[:, 1] - along) <= bound)


# --- what is left open --------------------------------------------------------------------------------------


def null_space(matrix):
    _, s, Vt = np.linalg.svd(matrix)
    rank = int(np.sum(s > 1e-9 * s[0]))
    return Vt[rank:].T


def brute_force(book, i, kind):
    """Changes of all components (13, 6, k) that no equation sees, moments in units of N times L."""
    L = book.parameters.geometry.L
    matrix, components = book.system(i, kind)
    rows = np.tile([1, 1, 1, 1 / L, 1 / L, 1 / L], 10)[:, None]
    is_moment = np.abs(components.reshape(13, 6, -1)[:, 3:]).sum(axis=(0, 1)) > 0
    null = null_space(rows * matrix * np.where(is_moment, L, 1.0))
    assert matrix.shape == (60, 66 if kind == "paper" else 62)
    return (components @ null).reshape(13, 6, -1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CASES)
def test_marked_is_exactly_what_sixty_equations_leave_open(name, kind):
    parameters, motion, wrench = case(name)
    result, book = solved(name, kind), Bookkeeping(parameters, motion, wrench)
    assert set(result.undetermined) == {OPEN[kind]}
    for i in range(0, len(motion), 5 if len(motion) > 10 else 1):
        change = brute_force(book, i, kind)
        assert change.shape[-1] == OPEN[kind]
        moves = np.linalg.norm(change, axis=-1) > 1e-7
        np.testing.assert_array_equal(~moves[:, :3], result.determined_forces[i])
        np.testing.assert_array_equal(~moves[:, 3:], result.determined_moments[i])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CASES)
def test_of_all_solutions_the_one_with_the_least_squares_over_all_joints(name, kind):
    parameters, motion, wrench = case(name)
    result, book = solved(name, kind), Bookkeeping(parameters, motion, wrench)
    assert result.length == pytest.approx(parameters.geometry.L / 20, rel=1e-15)
    weight = np.r_[1, 1, 1, np.full(3, 20 / parameters.geometry.L)]
    for i in range(0, len(motion), 5 if len(motion) > 10 else 1):
        change = (in_si(brute_force(book, i, kind), parameters) * weight[:, None]).reshape(78, -1)
        all_ = (np.hstack([result.forces[i], result.moments[i]]) * weight).ravel()
        change = change / np.linalg.norm(change, axis=0)
        assert np.all(np.abs(change.T @ all_) <= 1e-9 * np.linalg.norm(all_))


def in_si(change, parameters):
    """The same with moments in N m."""
    return change * np.r_[1, 1, 1, np.full(3, parameters.geometry.L)][:, None]


def mirrored(motion: Motion) -> Motion:
    """The same motion with left and right exchanged."""
    signs = np.array([-1, 1, 1])
    return Motion(motion.time, motion.pose * signs, motion.velocity * signs, motion.acceleration * signs)


def test_left_and_right_bear_alike():
    """y -> -y exchanges the legs A and B, and the rods; forces turn like arrows, moments against them."""
    motion = paper_motion(41)
    twin = {"slide_a": "slide_b", "hinge_a": "hinge_b", "loop_a": "loop_b", "hinge_left": "hinge_right",
            "hinge_lower": "loop_c"}  # fmt: skip
    twin |= {other: one for one, other in twin.items()}
    one, other = (robot_reactions(m) for m in (motion, mirrored(motion)))
    order = [one.joints.index(twin.get(name, name)) for name in one.joints]
    for kind in KINDS:
        forces, moments = getattr(one, kind).in_base()
        their_forces, their_moments = (array[:, order] for array in getattr(other, kind).in_base())
        gap = (forces - their_forces * [1, -1, 1], moments - their_moments * [-1, 1, -1])
        if kind == "paper":
            assert np.abs(gap[0]).max() < 1e-11
            assert np.abs(gap[1]).max() < 1e-11
        else:  # a ball at one rod and a hinge at the other are not symmetric themselves
            assert 1e-3 < np.abs(gap[0]).max() < 1


def robot_reactions(motion, parameters=PAPER):
    return p3dof.load(parameters).reactions(motion)


def test_the_unit_of_length_does_not_change_the_choice():
    """The same machine in another unit, masses kept: forces the same if accelerations are scaled too."""
    motion = paper_motion(11)
    one = robot_reactions(motion).paper
    k = 50.0
    g = PAPER.geometry
    lengths = {name: k * getattr(g, name) for name in ("r", "R", "L", "b")}
    bodies = {name: Body(b.mass, k * b.com, k**2 * b.inertia) for name, b in PAPER.bodies.items()}
    larger = Parameters(type(g)(**lengths), Bodies(**bodies), gravity=k * PAPER.gravity)
    scale = np.array([k, k, 1])
    moved = Motion(motion.time, *(getattr(motion, n) * scale for n in ("pose", "velocity", "acceleration")))
    other = robot_reactions(moved, larger).paper  # 1 kg mm/s² a unit of force
    np.testing.assert_allclose(other.forces / k, one.forces, rtol=0, atol=1e-8)
    np.testing.assert_allclose(other.moments / k**2, one.moments, rtol=0, atol=1e-8)
    assert other.length == pytest.approx(1.0)


def test_another_length_is_another_choice():
    loop, motion = p3dof.load().loop, paper_motion(3)
    solution = PinocchioMethod(PAPER, loop).solve(states_over(motion))
    q, v, a = (getattr(solution.joints, name)[2] for name in "qva")
    solvers = [ReactionSolver(loop, cuts("paper"), length) for length in (None, 0.02, 0.4)]
    default, same, other = (solver.solve(q, v, a, solution.forces[2]) for solver in solvers)
    assert solvers[0].length == pytest.approx(0.02)  # a twentieth of the longest link, a leg
    np.testing.assert_allclose(default.forces, same.forces, rtol=0, atol=1e-11)
    left = JOINTS.index(next(joint for joint in JOINTS if joint.name == "hinge_left"))
    assert np.linalg.norm(same.forces[left]) == pytest.approx(136.4, abs=0.1)
    assert np.linalg.norm(other.forces[left]) == pytest.approx(68.6, abs=0.1)
    for bad in (0.0, -1.0, np.nan, "x"):
        with pytest.raises(InputError, match="length"):
            ReactionSolver(loop, cuts("paper"), bad)


def special(name):
    """States at which the machine is symmetric, upright or otherwise special."""
    g = PAPER.geometry
    pose = {
        "home": (0, 0, 0),
        "straight down": (0, 0.05, 0),
        "tilted": (0, 0, 0.4),
        "sideways": (0.05, 0, 0),
        "leg A upright": (-(g.R - g.r), 0, 0),
        "leg B upright": (g.R - g.r, 0, 0.2),
        "half right angle": (0.02, 0, np.pi / 4),
    }[name]
    moving = SimpleNamespace(pose=np.array([pose]), velocity=np.zeros((1, 3)), acceleration=np.zeros((1, 3)))
    return motion_of(moving)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "name",
    [
        "home", "straight down", "tilted", "sideways", "leg A upright", "leg B upright",
        "half right angle",
    ],
)  # fmt: skip
def test_marks_at_special_poses(name, kind):
    motion = special(name)
    result = over_motion(p3dof.load().loop, PAPER, motion, kind)
    change = brute_force(Bookkeeping(PAPER, motion, np.zeros((1, 6))), 0, kind)
    assert change.shape[-1] == result.undetermined[0] == OPEN[kind]
    moves = np.linalg.norm(change, axis=-1) > 1e-7
    np.testing.assert_array_equal(~moves[:, :3], result.determined_forces[0])
    np.testing.assert_array_equal(~moves[:, 3:], result.determined_moments[0])


def test_what_is_marked_at_home_and_away_from_it():
    """The guides of A and B share the pull along x0; at home the marked components are fewer."""
    loop = p3dof.load().loop
    home, away = (over_motion(loop, PAPER, special(name), "points") for name in ("home", "leg B upright"))
    for result in (home, away):
        for joint in ("slide_a", "slide_b"):
            np.testing.assert_array_equal(result[joint].determined_forces[0], [False, True, True])
        for joint in ("hinge_a", "hinge_b", "loop_a", "loop_b"):
            np.testing.assert_array_equal(result[joint].determined_forces[0], [True, False, True])
        assert result["slide_c"].determined_forces.all()
        assert result["hinge_platform"].determined_forces.all()
    marks = [np.sum(~r.determined_forces) + np.sum(~r.determined_moments) for r in (home, away)]
    assert marks[0] < marks[1]


# --- results ------------------------------------------------------------------------------------------------


def test_joints_are_those_of_the_description():
    mechanism = description.describe(PAPER)
    joints = {joint.name: joint for joint in mechanism.joints}
    assert len({joint.label for joint in JOINTS}) == len(JOINTS) == 13
    parents = {joint.child: joint.parent for joint in mechanism.joints}
    loop = p3dof.load().loop
    closures = mechanism.closures
    assert [j.name for j in JOINTS] == [*list(loop.model.names)[1:], *(c.name for c in closures)]
    for given in JOINTS[:10]:
        joint = joints[given.name]
        assert (joint.parent, joint.child, joint.child) == (given.predecessor, given.successor, given.frame)
        np.testing.assert_array_equal(joint.axis, {"y": Y, "z": Z}[given.axis])
    for given, closure in zip(JOINTS[10:], closures, strict=True):
        ends = parents[closure.frame1], parents[closure.frame2], closure.frame1
        assert ends == (given.predecessor, given.successor, given.frame)


def test_determined_forces_of_ball_joints_are_the_multipliers_of_the_inverse_dynamics():
    loop, result = p3dof.load().loop, solved("PAPER", "points")
    _, motion, wrench = case("PAPER")
    solution = PinocchioMethod(PAPER, loop).solve(states_over(motion, wrench))
    states = solution.joints
    for i in range(0, len(motion), 5):
        external = {"platform_center": wrench[i]}
        one = loop.inverse_dynamics(states.q[i], states.v[i], states.a[i], external)
        np.testing.assert_array_equal(result.determined_forces[i, 10:].ravel(), one.unique)
        np.testing.assert_allclose(
            result.forces[i, 10:].ravel()[one.unique], one.lambda_[one.unique], rtol=0, atol=1e-11
        )
        assert 0 < one.unique.sum() < 9


def test_massless_crossbars_are_the_limit_of_light_ones():
    motion = paper_motion(11)
    light = Body(1e-9, np.zeros(3), np.full(3, 1e-11))
    bodies = dict(PAPER.bodies.items()) | {"crossbar_upper": light, "crossbar_lower": light}
    heavier = Parameters(PAPER.geometry, Bodies(**bodies), gravity=PAPER.gravity)
    assert PAPER.bodies.crossbar_lower.mass == 0
    for kind in KINDS:
        one, other = (over_motion(p3dof.load(p).loop, p, motion, kind) for p in (PAPER, heavier))
        np.testing.assert_allclose(one.forces, other.forces, atol=1e-6)
        np.testing.assert_allclose(one.moments, other.moments, atol=1e-6)


def test_determined_components_do_not_depend_on_how_the_cuts_are_built():
    balls, hinges = solved("SOLIDS", "points"), solved("SOLIDS", "paper")
    both = balls.determined_forces & hinges.determined_forces
    np.testing.assert_allclose(balls.forces[both], hinges.forces[both], rtol=0, atol=1e-10)
    assert not np.allclose(balls.forces, hinges.forces, atol=1)


def test_peaks_are_those_of_what_is_determined():
    result = over_motion(p3dof.load().loop, PAPER, paper_motion(101), "paper")
    peaks = {peak.joint: peak for peak in result.peaks()}
    assert tuple(peaks) == result.joints
    one, peak = result["slide_c"], peaks["slide_c"]
    assert peak.force == np.linalg.norm(one.forces, axis=1).max()
    assert peak.axial == np.abs(one.forces[:, 2]).max()
    np.testing.assert_allclose(peak.radial, np.hypot(*one.forces.T[:2]).max(), rtol=1e-14)
    np.testing.assert_allclose(peak.across, np.hypot(*one.moments.T[:2]).max(), rtol=1e-14)
    mean = np.trapezoid(np.sum(one.forces**2, axis=1), result.time) / (result.time[-1] - result.time[0])
    np.testing.assert_allclose(peak.rms_force, np.sqrt(mean), rtol=1e-14)
    # The guide of C turns its slider about z0 by an undetermined moment; all else in it is determined.
    assert peak.undetermined == ("moment", "rms_moment")
    assert np.isnan([peak.moment, peak.rms_moment]).all()
    opened = {(peak.joint, peak.load): peak.values for peak in result.open_peaks()}
    assert opened["slide_c", "moment"] == {"paper": np.linalg.norm(one.moments, axis=1).max()}
    assert peaks["hinge_a"].undetermined == ("force", "axial", "moment", "across", "rms_force", "rms_moment")
    balls = {peak.joint: peak for peak in solved("PAPER", "points").peaks()}
    assert np.isnan([balls["loop_a"].axial, balls["loop_b"].radial, balls["loop_c"].across]).all()
    assert balls["loop_a"].undetermined == ("force", "rms_force")
    assert balls["loop_a"].moment == 0


LOADS = ("force", "axial", "radial", "rms_force", "moment", "across", "rms_moment")


def test_the_loads_of_a_joint_by_hand():
    """3, 4, 12 is 13 long; of two directions of misfit both count; a sample that is left out does not."""
    known = np.ones((3, 3), bool)
    known[1, 0] = False
    one = JointReaction(
        JOINTS[1],
        Y,
        np.array([[3.0, -4, 12], [0, 1, 0], [99, 99, 99]]),
        np.array([[2.0, -3, 6], [0, 0, 1], [99, 99, 99]]),
        known,
        np.ones((3, 3), bool),
        np.array([[[2.0, 3, 6], [1, 4, 8]], [[0, 1, 0], [0, 0, 1]], [[99, 99, 99]] * 2]),
    )
    found = loads_of(one, np.array([4.0, 4.5, 6]), np.array([True, True, False]))
    expected = {
        "force": (13, True), "axial": (4, False), "radial": (np.hypot(3, 12), True),
        "moment": (7, False), "across": (np.hypot(2, 6), False),
        "rms_force": (np.sqrt((169 + 1) / 2), True), "rms_moment": (np.sqrt((49 + 1) / 2), False),
        "fit_force": (7, False), "fit_moment": (9, False),
    }  # fmt: skip
    assert found.keys() == expected.keys()
    for name, (value, open_) in expected.items():
        assert (found[name].value, found[name].undetermined) == (pytest.approx(value, rel=1e-14), open_), name


def test_elastic_joints_and_both_idealisations_side_by_side():
    both = robot_reactions(paper_motion(21))
    kinds = {kind: robot_reactions_as(kind) for kind in WAYS}
    assert both.ways == WAYS
    book = Bookkeeping(PAPER, both.motion, np.zeros((21, 6)))
    for i in (3, 14):  # what no way leaves open: whatever is built at the cuts
        moves = [np.linalg.norm(brute_force(book, i, kind), axis=-1) > 1e-7 for kind in KINDS]
        np.testing.assert_array_equal(both.determined_forces[i], ~np.any(moves, axis=0)[:, :3])
        np.testing.assert_array_equal(both.determined_moments[i], ~np.any(moves, axis=0)[:, 3:])
    assert both.determined_moments[14].sum() not in {0, 39}
    opened = {(peak.joint, peak.load): peak.values for peak in both.open_peaks()}
    for peak, *single in zip(both.peaks(), *(one.peaks() for one in kinds.values()), strict=True):
        for load in LOADS:
            value = getattr(peak, load)
            is_open = any(load in one.undetermined for one in single)
            assert is_open == (load in peak.undetermined) == ((peak.joint, load) in opened)
            if is_open:  # the number to size for is that of elastic joints
                assert value == pytest.approx(kinds["elastic"].loads(peak.joint)[load].value, rel=1e-12)
                continue
            known = [getattr(one, load) for one in single if np.isfinite(getattr(one, load))]
            np.testing.assert_allclose(known, value, rtol=1e-10, atol=1e-11)
    for (joint, load), values in opened.items():
        assert tuple(values) == WAYS
        for kind, value in values.items():
            expected = kinds[kind].loads(joint)[load].value
            np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12)
    found = {"elastic": 139.19, "paper": 136.43, "points": 138.50}
    assert opened["hinge_left", "force"] == pytest.approx(found, abs=0.01)
    assert np.isnan(opened["loop_a", "axial"]["points"])
    assert len(opened) > 40


def robot_reactions_as(kind):
    return p3dof.load().reactions(paper_motion(21), joints=kind)


def test_an_eccentric_payload_no_longer_seems_to_leave_a_rod_unloaded():
    """The right rod bears a couple with the left one; with cut forces alone made small it seemed to bear 18 N
    under one idealisation and 420 N under the other."""
    machine = PAPER.carrying(Body(20.0, np.array([0, 0.1, 0]), np.zeros(3)))
    result = robot_reactions(paper_motion(21), machine)
    opened = {(peak.joint, peak.load): peak.values for peak in result.open_peaks()}
    values = opened["hinge_right", "force"]
    assert {way: values[way] for way in KINDS} == pytest.approx({"paper": 549.5, "points": 546.6}, abs=0.1)
    (peak,) = (peak for peak in result.paper.peaks() if peak.joint == "hinge_right")
    assert np.isnan([getattr(peak, load) for load in LOADS]).all()
    assert set(peak.undetermined) == set(LOADS)


def test_elastic_joints_can_bear_more_than_both_idealisations():
    """So neither is a bound: joints with other stiffnesses, by the same bookkeeping."""
    parameters, motion, wrench = PAPER, paper_motion(2), np.zeros((2, 6))
    book, both = Bookkeeping(parameters, motion, wrench), robot_reactions(motion)
    result, last = both.paper, 1
    change = in_si(brute_force(book, last, "paper"), parameters).reshape(78, -1)
    soft = np.tile([1e-8, 1e-8, 1e-8, 1e-4, 1e-4, 1e-4], 13)
    soft[both.joints.index("hinge_right") * 6 :][:6] *= 0.2
    soft[both.joints.index("loop_c") * 6 :][:6] *= 0.2
    r = np.hstack([result.forces[last], result.moments[last]]).ravel()
    r = r - change @ np.linalg.solve((change.T * soft) @ change, (change.T * soft) @ r)
    left = np.linalg.norm(r.reshape(13, 6)[both.joints.index("hinge_left"), :3])
    each = [np.linalg.norm(one["hinge_left"].forces[last]) for one in (both.paper, both.points)]
    assert left < min(each) - 0.1 or left > max(each) + 0.1


def test_the_comparison(tmp_path):
    both = robot_reactions(paper_motion(11))
    path = both.to_csv(tmp_path / "reactions.csv")
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    table = dict(zip(header, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    for k, joint in enumerate(both.joints):
        for i, axis in enumerate("xyz"):
            for letter, unit, kind in (("f", "N", "forces"), ("m", "N m", "moments")):
                values = {one.way: getattr(one, kind)[:, k, i] for one in both.each}
                determined = getattr(both, f"determined_{kind}")[:, k, i]
                name = f"{joint} {letter}{axis}"
                if determined.all():
                    np.testing.assert_array_equal(table[f"{name} [{unit}]"], values["elastic"])
                    np.testing.assert_allclose(values["elastic"], values["points"], rtol=0, atol=1e-11)
                    continue
                assert f"{name} [{unit}]" not in table
                np.testing.assert_array_equal(table[f"{name} determined"], determined)
                for way, column in values.items():
                    np.testing.assert_array_equal(table[f"{name} {way} [{unit}]"], column)
    np.testing.assert_array_equal(table["residual points"], both.points.residual)
    assert both.residual.max() < 1e-11
    assert "11" in repr(both)
    for words in (r"20 mm", "equally stiff"):
        assert words in how_chosen(both)
    with pytest.raises(InputError, match="expected Reactions, got int"):
        how_chosen(3)


def test_table(tmp_path):
    result = solved("PAPER", "paper")
    path = result.to_csv(tmp_path / "reactions.csv")
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    table = dict(zip(header, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    for k, joint in enumerate(result.joints):
        for i, axis in enumerate("xyz"):
            for letter, unit, values, determined in (
                ("f", "N", result.forces, result.determined_forces),
                ("m", "N m", result.moments, result.determined_moments),
            ):
                np.testing.assert_array_equal(table[f"{joint} {letter}{axis} [{unit}]"], values[:, k, i])
                marks = table.get(f"{joint} {letter}{axis} determined", np.ones(len(result.time)))
                np.testing.assert_array_equal(marks, determined[:, k, i])
    assert "slide_a fz determined" not in table
    np.testing.assert_array_equal(table["residual"], result.residual)


def test_invalid_samples():
    far = [[0, 0, 0], [9, 0, 0], [0.01, 0, 0.1], [0, 0, np.pi / 3]]
    rest = np.zeros((4, 3))
    motion = Motion(np.arange(4.0), far, rest, rest, check=False)
    loop = p3dof.load().loop
    result = over_motion(loop, PAPER, motion, "paper", on_invalid="nan")
    np.testing.assert_array_equal(result.valid, [True, False, True, False])
    for array in (result.forces, result.moments, result.residual, result.positions, result.rotations):
        assert np.isfinite(array[[0, 2]]).all()
        assert np.isnan(array[[1, 3]]).all()
    assert not result.determined_forces[1].any()
    np.testing.assert_array_equal(result.undetermined, [6, 0, 6, 0])
    loads = [getattr(peak, name) for peak in result.peaks() for name in ("force", "axial", "rms_moment")]
    assert np.isnan(loads).all()  # the largest one may be in between
    assert result.open_peaks() == ()
    with pytest.raises(ReachError):
        over_motion(loop, PAPER, motion)
    with pytest.raises(SingularityError):
        over_motion(loop, PAPER, Motion([0.0], [far[3]], rest[:1], rest[:1], check=False))
    none = over_motion(
        loop, PAPER, Motion([0.0], [far[1]], rest[:1], rest[:1], check=False), "paper", on_invalid="nan"
    )
    assert "nan" in repr(none)
    assert np.isnan(none.peaks()[3].rms_moment)
    assert none.peaks()[3].undetermined == ()


def test_forces_that_do_not_belong_to_the_motion():
    loop, motion = p3dof.load().loop, paper_motion(6)
    solution = PinocchioMethod(PAPER, loop).solve(states_over(motion))
    solution.forces[4, 1] += 1e-3
    with pytest.raises(SampleError, match=r"sample 4.*do not produce the motion") as caught:
        of_solution(loop, PAPER, motion, solution)
    assert caught.value.index == (4,)
    result = of_solution(loop, PAPER, motion, solution, on_invalid="nan")
    np.testing.assert_array_equal(result.valid, [True] * 4 + [False, True])


def test_the_help_says_what_the_joints_are(capsys):
    with pytest.raises(SystemExit, match="0"):
        raise SystemExit(main(["reactions", "--help"]))
    shown = capsys.readouterr().out
    for joint in JOINTS:
        assert f"{joint.label}  {joint.name:15} {joint.meaning}" in shown


def test_bad_arguments():
    loop = p3dof.load().loop
    motion = paper_motion(11)
    with pytest.raises(
        InputError, match="joints: expected 'all' or 'elastic' or 'paper' or 'points', got 'welds'"
    ):
        over_motion(loop, PAPER, motion, "welds")
    with pytest.raises(InputError, match="motion: expected a Motion"):
        over_motion(loop, PAPER, motion.pose)
    with pytest.raises(InputError, match="wrench: expected shape"):
        over_motion(loop, PAPER, motion, wrench=np.zeros((7, 6)))
    with pytest.raises(InputError, match=r"joint: expected one of slide_a, .*got 'elbow'"):
        solved("PAPER", "paper")["elbow"]


def cells_of(table):
    return {column.header: [str(cell) for cell in column.cells] for column in table.columns}


@pytest.mark.parametrize("joints", ["all", "paper", "points"])
def test_the_screen_tables_keep_open_loads_apart(joints):
    result = p3dof.load().reactions(paper_motion(11), joints=joints)
    cells = cells_of(rich_table(reactions_table(result)))
    for i, peak in enumerate(result.peaks()):
        assert cells["joint"][i].split()[0] == peak.joint
        for load, title in zip(LOADS, list(cells)[1:], strict=True):
            shown = cells[title][i]
            assert shown.startswith("~" if joints == "all" else "open") == (load in peak.undetermined)
            value = shown.lstrip("~")
            assert value in ("open", "-") or float(value) == pytest.approx(getattr(peak, load), abs=6e-3)
    forces, moments = (cells_of(rich_table(table)) for table in open_tables(result))
    kinds = WAYS if joints == "all" else (joints,)
    row = next(i for i, name in enumerate(forces["joint"]) if name == "hinge_right (C6)")
    for kind in kinds:
        values = next(p.values for p in result.open_peaks() if (p.joint, p.load) == ("hinge_right", "force"))
        assert float(forces[f"force\n[N]\n{kind}"][row]) == pytest.approx(values[kind], abs=6e-3)
    assert len(forces) == 1 + 4 * len(kinds)
    assert len(moments) == 1 + 3 * len(kinds)
    assert "slide_c (C1)" not in forces["joint"]  # all of them are determined


def test_the_command(tmp_path, capsys):
    out = tmp_path / "reactions.csv"
    assert main(["reactions", "--samples", "11", "--joint-model", "points", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    for word in ("hinge_platform (C5)", "axial", "126.0", "open", "neither is a bound", f"wrote {out}"):
        assert word.lower() in shown.lower()
    expected = over_motion(p3dof.load().loop, PAPER, paper_motion(11), "points")
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, 1], expected["slide_a"].forces[:, 0])
    motion = tmp_path / "far.csv"
    motion.write_text("t,y,z,theta\n0,9,0,0\n1,9,0,0\n", encoding="utf-8")
    assert main(["reactions", "--motion", str(motion), "--out", str(motion)]) == 2
    assert "would be overwritten" in capsys.readouterr().err
    assert main(["reactions", "--motion", str(motion), "--on-invalid", "nan"]) == 1
    assert "no sample of the motion" in capsys.readouterr().err


# --- other robots -------------------------------------------------------------------------------------------


def loop_of(xml, sidecar) -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(xml, sidecar)


def five_bar_state():
    loop = loop_of(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    return loop, loop.complete([2.0, 1.2], [1.0, -0.5], [3.0, 2.0], guess=robots.five_bar_q(2.0, 1.2))


def body_errors(loop, state, result, external, ends):
    """Newton's and Euler's largest error of each body, from mass centres by Pinocchio's kinematics.

    `ends` are the joints (predecessor, successor) of the closures.
    """
    model, data = loop.model, loop.model.createData()
    pin.forwardKinematics(model, data, state.q, state.v, state.a)
    pin.updateFramePlacements(model, data)
    forces = np.einsum("kij,kj->ki", result.rotations, result.forces)
    moments = np.einsum("kij,kj->ki", result.rotations, result.moments)
    pairs = [(int(model.parents[j]), j) for j in range(1, model.njoints)] + ends
    worst = 0.0
    for j in range(1, model.njoints):
        inertia, M = model.inertias[j], data.oMi[j]
        centre, w = M.act(inertia.lever), M.rotation @ data.v[j].angular
        at_centre = pin.SE3(np.eye(3), inertia.lever)
        a = pin.getFrameClassicalAcceleration(model, data, j, at_centre, pin.LOCAL_WORLD_ALIGNED)
        I = M.rotation @ inertia.inertia @ M.rotation.T  # noqa: E741
        force = inertia.mass * (model.gravity.linear - a.linear)
        moment = -I @ a.angular - np.cross(w, I @ w)
        for (one, other), f, m, p in zip(pairs, forces, moments, result.positions, strict=True):
            sign = (other == j) - (one == j)
            force = force + sign * f
            moment = moment + sign * (m + np.cross(p - centre, f))
        for name, wrench in external.items():
            frame = model.frames[model.getFrameId(name)]
            if frame.parentJoint == j:
                p = data.oMf[model.getFrameId(name)].translation
                force = force + wrench[:3]
                moment = moment + wrench[3:] + np.cross(p - centre, wrench[:3])
        worst = max(worst, np.abs(np.r_[force, moment]).max())
    return worst


def closure_ends(loop):
    frames = loop.model.frames
    ids = [(loop.model.getFrameId(c.frame1), loop.model.getFrameId(c.frame2)) for c in loop.sidecar.closures]
    return [(int(frames[one].parentJoint), int(frames[other].parentJoint)) for one, other in ids]


@pytest.mark.parametrize(
    ("joint", "open_"),
    [(ClosureJoint.ball(), 1), (ClosureJoint.revolute(Y), 3), (ClosureJoint.universal(Y, X), 2), (None, 1)],
)
def test_a_planar_five_bar_is_overconstrained_out_of_its_plane(joint, open_):
    loop, state = five_bar_state()
    external = {"left_tip": np.array([3.0, 2, -1, 0.3, 0.2, -0.5]), "right_near": np.arange(6.0)}
    tau = loop.inverse_dynamics(state.q, state.v, state.a, external).tau
    result = loop_reactions(
        loop, state.q, state.v, state.a, tau, external, joints=None if joint is None else [joint]
    )
    assert result.undetermined == open_
    assert body_errors(loop, state, result, external, closure_ends(loop)) < 1e-12
    planar = np.ones((5, 3), dtype=bool)
    planar[:, 1] = False  # forces in the plane of motion are determined, those across it are not
    np.testing.assert_array_equal(result.determined_forces, planar)
    assert result.names[-1] == "left_tip/right_tip"


def test_a_welded_loop_and_one_without_redundancy():
    sarrus = loop_of(robots.sarrus(), robots.SARRUS_SIDECAR)
    state = sarrus.complete([0.2], [0.7], [1.5])
    tau = sarrus.inverse_dynamics(state.q, state.v, state.a).tau
    result = loop_reactions(sarrus, state.q, state.v, state.a, tau)
    assert result.undetermined == 1
    assert body_errors(sarrus, state, result, {}, closure_ends(sarrus)) < 1e-12
    hexapod = loop_of(robots.hexapod(), robots.HEXAPOD_SIDECAR)
    q = robots.hexapod_q(pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.1, 0, 0.8])), hexapod.model)
    rest = np.zeros(hexapod.model.nv)
    tau = hexapod.inverse_dynamics(q, rest, rest).tau
    result = loop_reactions(hexapod, q, rest, rest, tau)
    state = SimpleNamespace(q=q, v=rest, a=rest)
    assert result.undetermined == 0
    assert result.determined_forces.all()
    assert result.determined_moments.all()
    assert body_errors(hexapod, state, result, {}, closure_ends(hexapod)) < 1e-11


def test_an_open_tree_needs_no_closures():
    xml = robots.robot(
        robots.link("base"),
        robots.link("arm", robots.ARM),
        robots.joint("shoulder", "base", "arm", kind="prismatic", axis=(1, 0, 0)),
    )
    loop = ClosedLoopModel.from_urdf(xml)
    result = loop_reactions(loop, [0.1], [0.0], [3.0], [robots.ARM.mass * 3])
    np.testing.assert_allclose(result.forces, [[6.3, 0, 2.1 * 9.81]])
    np.testing.assert_allclose(
        result.moments[0], np.cross(robots.ARM.com, [6.3, 0, 2.1 * 9.81]), rtol=0, atol=1e-14
    )
    assert result.undetermined == 0
    assert result.determined_moments.all()


def test_friction_in_joints_and_closures():
    """Forces in the passive joints lie along their axes, those in a closure are an external pair."""
    loop, state = five_bar_state()
    q, v, a = state.q, state.v, state.a
    in_joints, pair = np.array([0.4, -0.3, 0.2, 0.6]), np.array([0.0, 0, 0, 0, 0.7, 0])
    data = loop.model.createData()
    external = {"left_tip": -pair, "right_tip": pair}
    # What the actuators then have to give, from the equation of motion alone.
    J = loop.closure_jacobian(q)
    N = null_space(J)
    f = pin.rnea(loop.model, data, q, v, a) - in_joints
    pin.computeJointJacobians(loop.model, data, q)
    pin.updateFramePlacements(loop.model, data)
    for name, wrench in external.items():
        Je = pin.getFrameJacobian(loop.model, data, loop.model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)
        f = f - Je.T @ wrench
    tau = np.linalg.solve(N[loop.actuated_v].T, N.T @ f)
    solver = ReactionSolver(loop, [ClosureJoint.revolute(Y)])
    result = solver.solve(q, v, a, tau, external, in_joints)
    given = in_joints.copy()
    given[loop.actuated_v] += tau
    np.testing.assert_allclose(-result.moments[:-1, 1], given, rtol=0, atol=1e-12)  # the axes are along -y
    assert abs(result.moments[-1, 1]) < 1e-14
    assert body_errors(loop, state, result, external, closure_ends(loop)) < 1e-12
    with pytest.raises(DynamicsError, match="do not produce the motion"):
        solver.solve(q, v, a, tau, external)


def test_a_rotor_takes_its_share_of_the_actuators_torque():
    loop, state = five_bar_state()
    loop.model.armature = np.array([0.3, 0, 0, 0.0])
    tau = loop.inverse_dynamics(state.q, state.v, state.a).tau
    result = loop_reactions(loop, state.q, state.v, state.a, tau)
    np.testing.assert_allclose(-result.moments[0, 1], tau[0] - 0.3 * state.a[0], rtol=1e-12)
    assert body_errors(loop, state, result, {}, closure_ends(loop)) < 1e-12


def test_scale_does_not_change_the_marks():
    for factor in (0.05, 1.0, 30.0, 100.0, 1e-6):
        g = PAPER.geometry
        sizes = {name: factor * getattr(g, name) for name in ("r", "R", "L", "b")}
        parameters = Parameters(type(g)(**sizes), PAPER.bodies, gravity=PAPER.gravity)
        rest = np.zeros((1, 3))
        motion = Motion([0.0], [[0.03 * factor, 0.02 * factor, 0.2]], rest, rest, check=False)
        result = over_motion(p3dof.load(parameters).loop, parameters, motion, "paper")
        marks = np.concatenate([result.determined_forces, result.determined_moments], axis=-1)
        if factor == 0.05:
            first = marks
        np.testing.assert_array_equal(marks, first)
        assert result.undetermined[0] == 6


def test_marks_do_not_mind_loops_that_are_open_by_rounding():
    """The share that decides, 1e-7, is more than 1e-11 m of opening adds, less than a joint takes."""
    loop, motion = p3dof.load().loop, paper_motion(3)
    solution = PinocchioMethod(PAPER, loop).solve(states_over(motion))
    q, v, a = (getattr(solution.joints, name)[2] for name in "qva")
    opened = q + 1e-11 * np.random.default_rng(0).normal(size=q.shape)
    for kind in KINDS:
        solver = ReactionSolver(loop, cuts(kind))
        one, other = (solver.solve(at, v, a, solution.forces[2]) for at in (q, opened))
        np.testing.assert_array_equal(other.determined_forces, one.determined_forces)
        np.testing.assert_array_equal(other.determined_moments, one.determined_moments)


def test_bad_input_of_the_general_solver():
    loop, state = five_bar_state()
    q, v, a = state.q, state.v, state.a
    tau = loop.inverse_dynamics(q, v, a).tau
    with pytest.raises(ModelError, match="they leave 1 free motions, the loops have 2"):
        loop_reactions(loop, q, v, a, tau, joints=[ClosureJoint.weld()])
    with pytest.raises(ModelError, match="expected 1, one for each closure, got 2"):
        loop_reactions(loop, q, v, a, tau, joints=[ClosureJoint.ball()] * 2)
    with pytest.raises(ModelError, match="expected a sequence of ClosureJoint"):
        loop_reactions(loop, q, v, a, tau, joints=["ball"])
    with pytest.raises(InputError, match="loop: expected a ClosedLoopModel"):
        loop_reactions(loop.model, q, v, a, tau)
    with pytest.raises(InputError, match=r"tau: expected shape \(2,\)"):
        loop_reactions(loop, q, v, a, [1.0])
    with pytest.raises(InputError, match="q: expected shape"):
        loop_reactions(loop, q[:2], v, a, tau)
    with pytest.raises(InputError, match="is open by"):
        loop_reactions(loop, q + np.array([0.01, 0, 0, 0]), v, a, tau)
    with pytest.raises(InputError, match="v: opens the closure"):
        loop_reactions(loop, q, v + np.array([0.01, 0, 0, 0]), a, tau)
    with pytest.raises(DynamicsError, match="do not produce the motion"):
        loop_reactions(loop, q, v, a + np.array([0.1, 0, 0, 0]), tau)
    with pytest.raises(InputError, match="a: expected finite numbers"):
        loop_reactions(loop, q, v, [np.nan, 0, 0, 0], tau)
    with pytest.raises(InputError, match="external: expected a mapping"):
        loop_reactions(loop, q, v, a, tau, external=[1])
    with pytest.raises(InputError, match="the frame 'nowhere' does not exist"):
        loop_reactions(loop, q, v, a, tau, external={"nowhere": np.zeros(6)})
    with pytest.raises(InputError, match=r"joint_forces: expected shape \(4,\)"):
        loop_reactions(loop, q, v, a, tau, joint_forces=np.zeros(3))


@pytest.mark.parametrize("axis", [(0, 0, 0), (1, 2), "y", (np.nan, 0, 1)])
def test_bad_axes(axis):
    with pytest.raises(ModelError, match="axis"):
        ClosureJoint.revolute(axis)
    with pytest.raises(ModelError, match="axis2"):
        ClosureJoint.universal(Y, axis)


def test_what_closure_joints_transmit():
    turn = pin.rpy.rpyToMatrix(0.3, -0.4, 0.5)
    assert ClosureJoint.ball().moments(turn).shape == (3, 0)
    assert ClosureJoint.weld().moments(turn).shape == (3, 3)
    hinge = ClosureJoint.revolute((0, 2, 0)).moments(turn)
    np.testing.assert_allclose(hinge.T @ hinge, np.eye(2), rtol=0, atol=1e-15)
    assert np.abs(hinge.T @ Y).max() < 1e-15
    cardan = ClosureJoint.universal(X, Z).moments(turn)
    assert cardan.shape == (3, 1)
    assert abs(cardan[:, 0] @ X) < 1e-15
    assert abs(cardan[:, 0] @ turn @ Z) < 1e-15
    with pytest.raises(ModelError, match="axes1: expected a tuple"):
        ClosureJoint("y")
    loop, state = five_bar_state()
    with pytest.raises(ModelError, match="both frames are on the same body"):
        ClosedLoopModel(loop.model, Sidecar((Closure("left_tip", "left_far"),), ()))
    assert state.same_assembly


def test_the_axes_of_components_are_as_they_are_told():
    """Of every frame, at home, as the table and `Joint.frame` say; the lower cross-bar is the exception."""
    home = Motion(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    found, g = p3dof.load().reactions(home, "elastic"), PAPER.geometry
    s, c = (g.R - g.r) / g.L, g.h / g.L
    along = {  # x of the body's own frame: fixed, but down the rods
        "hinge_a": (0, s, -c), "hinge_b": (0, -s, -c), "hinge_left": (s, 0, -c), "hinge_right": (s, 0, -c),
        "loop_a": (0, s, -c), "loop_b": (0, -s, -c), "loop_c": (s, 0, -c), "hinge_lower": (s, 0, -c),
    }  # fmt: skip
    for i, name in enumerate(found.joints):
        np.testing.assert_allclose(
            found.rotations[0, i, :, 0], along.get(name, (1, 0, 0)), rtol=0, atol=1e-14
        )
    assert "Those of hinge_lower" in names_table().note
    forces, _ = found.in_base()
    i = found.joints.index("hinge_lower")
    turned = np.array([[s, 0, -c], [c, 0, s]]) @ forces[0, i]  # x and y of the rods
    np.testing.assert_allclose(found["hinge_lower"].forces[0, :2], turned, rtol=0, atol=1e-13)
