"""Evidence that can fail: a force or a length that is off, a loop left out show in it at full size."""

from __future__ import annotations

import pickle
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from machines import conditioning, drops, random_friction, random_machine, random_states
from scipy.integrate import solve_ivp
from table_numbers import check_evidence, shows

import p3dof
import p3dof.loops.batch.dynamics as batch_dynamics
from p3dof import PAPER
from p3dof._base.errors import DynamicsError, ReachError
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled import kernels, levels
from p3dof.closed_form.compiled.evidence import BODY, NUMBERS, evidence_kernel, numbers_of
from p3dof.closed_form.paper import evidence
from p3dof.loops.batch import traced
from p3dof.loops.linear import Decomposition
from p3dof.machine import Actuators, Friction
from p3dof.machine.motion import Motion, states_over
from p3dof.machine.parameters.body import LINKS
from p3dof.methods import METHODS, closed_form, compiled, with_evidence
from p3dof.methods.compiled import CompiledMethod
from p3dof.methods.pinocchio import PinocchioMethod
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.runs.machine_plants import Equations, MachineJoints, MinimalPlant

WAYS = ("pinocchio", "virtual-power", "compiled")
ROUGH = replace(PAPER, friction=Friction({"sliders": 20.0, "joints": 0.5}))
WRENCH = np.array([3.0, 40.0, -30.0, 1.0, 2.0, 5.0])
MOTION = p3dof.paper_motion(41)
GAPS = (5e-11, 2e-7)
"""Open loops that the batch takes, and that only the single sample does [m]."""
HOME = np.zeros(3)
COLUMNS = ("forces", "closure_error", "power", "power_residual", "dissipation", "actuation", "sliders")


@pytest.fixture(scope="module")
def robot():
    return p3dof.load(ROUGH)


def solution(method, parameters=ROUGH, motion=MOTION):
    dynamics = METHODS[method](p3dof.load(parameters))
    return dynamics.solve(states_over(motion, WRENCH))


def balanced(method, found, wrench=WRENCH, motion=MOTION):
    loads = None if wrench is None else np.tile(wrench, (len(motion), 1))
    return with_evidence(method, motion, found, loads)


def assert_residual(result, expected):
    assert np.abs(expected).max() > 0.1  # W: something to see
    scale = np.abs(result.power).max()
    check_evidence(result, "power_residual", expected, rtol=0, atol=1e-13 * scale)


@pytest.mark.parametrize("method", WAYS)
@shows("p3dof.methods.results.InverseDynamics.power_residual")
def test_a_force_that_is_off_shows_in_the_power_balance(method):
    found = solution(method)
    right = balanced(method, found)
    assert np.abs(right.power_residual).max() <= 1e-13 * np.abs(right.power).max()
    assert_residual(balanced(method, replace(found, forces=1.01 * found.forces)), 0.01 * right.power)
    for leg in range(3):
        off = found.forces + np.eye(3)[leg]
        assert_residual(balanced(method, replace(found, forces=off)), right.slider_velocities[:, leg])


@pytest.mark.parametrize("method", WAYS)
def test_a_load_a_loss_or_a_mass_that_is_off_shows_in_the_power_balance(method):
    found = solution(method)
    loads = WRENCH[1] * MOTION.velocity[:, 0] + WRENCH[2] * MOTION.velocity[:, 1]
    loads = loads + WRENCH[4] * MOTION.velocity[:, 2]
    assert_residual(balanced(method, found, wrench=None), -loads)
    assert_residual(balanced(method, replace(found, dissipation=0 * found.dissipation)), found.dissipation)
    heavier = solution(method, replace(ROUGH, bodies=PAPER.bodies.scaled(1.01)))
    assert_residual(
        balanced(method, replace(found, energy_rate=heavier.energy_rate)), -0.01 * found.energy_rate
    )


@pytest.mark.parametrize("method", WAYS)
def test_the_power_balance_of_a_result_is_that_of_its_forces(method, robot, monkeypatch):
    """Through the whole of `inverse_dynamics`: one per cent on the forces is one per cent of the power."""
    right = robot.inverse_dynamics(MOTION, method=method, wrench=WRENCH)
    route = dict(zip(WAYS, (PinocchioMethod, VirtualPowerMethod, CompiledMethod), strict=True))[method]
    solve = route.solve

    def off(*args, **kwargs):
        found = solve(*args, **kwargs)
        return replace(found, forces=1.01 * found.forces)

    monkeypatch.setattr(route, "solve", off)
    assert_residual(robot.inverse_dynamics(MOTION, method=method, wrench=WRENCH), 0.01 * right.power)


@pytest.mark.parametrize("length", ["r", "L", "b"])
def test_a_length_that_is_off_opens_the_loops_by_as_much(length):
    """The closed form's loops, seen with a length a millimetre longer: open by that millimetre."""
    motion = kinematics.mechanism_motion(PAPER.geometry, MOTION.pose, MOTION.velocity, MOTION.acceleration)
    assert kinematics.closure_error(PAPER.geometry, motion).max() < 1e-15
    longer = replace(PAPER.geometry, **{length: getattr(PAPER.geometry, length) + 1e-3})
    np.testing.assert_allclose(kinematics.closure_error(longer, motion), 1e-3, rtol=0, atol=1e-15)


@pytest.mark.parametrize("body", ["leg_a", "leg_b", "rod_right"])
@shows("p3dof.methods.results.InverseDynamics.closure_error", "p3dof.methods.solution.Solution.closure_error")
def test_every_loop_of_the_closed_form_is_looked_at(body, robot, monkeypatch):
    real = evidence.frames

    def shifted(*args, **kwargs):
        frames = real(*args, **kwargs)
        x, y, z = frames[body].position
        return {**frames, body: frames[body]._replace(position=(x, y, z + 1e-3))}

    monkeypatch.setattr(evidence, "frames", shifted)
    monkeypatch.setattr(kernels, "evidence_kernel", evidence_kernel.__wrapped__)  # traced again
    plain = p3dof.load(ROUGH)
    plain.kernels = p3dof.closed_form.MachineKernels(ROUGH, "numpy")
    found = robot.inverse_dynamics(MOTION, method="virtual-power")
    traced = plain.inverse_dynamics(MOTION, method="compiled")
    for one in (found, solution("virtual-power"), traced):
        check_evidence(one, "closure_error", np.full(len(MOTION), 1e-3), rtol=0, atol=1e-15)


def test_every_number_of_the_compiled_evidence_shows_when_it_is_off(monkeypatch):
    """One per cent more in the kernels alone: loops open, or power is missed; but of what no motion feels."""
    drive = Actuators(armature={"sliders": 2.0}, counterbalance={"sliders": 30.0}, spring={"sliders": 50.0})
    machine = replace(random_machine(7), friction=random_friction(np.random.default_rng(2)), actuators=drive)
    states, numbers = random_states(machine, 7, 40), np.array(numbers_of(machine))
    held = kinematics.singularity(machine.geometry, states.pose).actuation > 0.2
    columns = (each[held] for each in (states.pose, states.velocity, states.acceleration))
    motion = Motion(np.arange(held.sum()), *columns, check=False)

    def shown():
        result = p3dof.load(machine).inverse_dynamics(motion, method="compiled")
        return result.closure_error.max(), result.power_residual / np.abs(result.power).max()

    right, hidden = shown()[1], set()
    for k in np.flatnonzero(numbers):
        off = numbers * np.where(np.arange(len(numbers)) == k, 1.01, 1)
        monkeypatch.setattr(kernels, "numbers_of", lambda _, off=off: off)
        gap, residual = shown()
        if gap < 1e-9 and np.abs(residual - right).max() < 1e-9:
            hidden.add(NUMBERS[k])
    seen = {slider: {"mass"} for slider in ("slider_a", "slider_b", "slider_c")}
    seen |= {rod: set(BODY) for rod in ("rod_left", "rod_right")}  # others move in a plane
    bodies = [f"{link}_{n}" for link in LINKS for n in set(BODY) - seen.get(link, {"mass", "x", "z", "yy"})]
    assert hidden == ({*bodies, "b"} & set(np.array(NUMBERS)[numbers != 0]))


def energy_rate_of_bodies(machine, motion):
    """Σ v·m(a-g) + ω·(Iα + ω×Iω) in fixed axes, with what acts at the sliders [W]."""
    actuators = machine.actuators
    balance = actuators.balance_at_home(machine.gravity) - actuators.stiffness * motion.sliders
    total = np.sum(
        motion.slider_velocities * (actuators.inertia * motion.slider_accelerations - balance), axis=-1
    )
    for name, body in machine.bodies.items():
        moving = motion.bodies[name]
        _, v, a = moving.at(body.com)
        inertia = moving.rotation @ body.inertia @ np.swapaxes(moving.rotation, -1, -2)
        spin = np.einsum("nij,nj->ni", inertia, moving.omega)
        turning = np.einsum("nij,nj->ni", inertia, moving.epsilon) + np.cross(moving.omega, spin)
        total += body.mass * np.sum(v * (a - machine.gravity), axis=-1)
        total += np.sum(moving.omega * turning, axis=-1)
    return total


@pytest.mark.parametrize("level", levels())
@pytest.mark.parametrize("seed", [2, 5, 6])
def test_compiled_evidence_is_that_of_the_bodies(seed, level, monkeypatch):
    rng = np.random.default_rng(seed)
    drive = Actuators(armature={"sliders": 2.0}, counterbalance={"slide_a": 30.0}, spring={"slide_b": 50.0})
    machine = replace(random_machine(seed), friction=random_friction(rng), actuators=drive)
    states, names = random_states(machine, seed, 300), kinematics.JOINTS
    moves = states.pose, states.velocity, states.acceleration
    motion = Motion(np.arange(300.0), *moves, check=False)
    known = kinematics.mechanism_motion(machine.geometry, *moves)
    other = VirtualPowerMethod(machine).solve(states_over(motion, on_invalid="nan"))
    found = CompiledMethod(kernels.MachineKernels(machine, level)).solve(states_over(motion))
    close = conditioning(machine.geometry, states.pose)
    expected = (known.position, known.velocity, known.acceleration)
    for values, rates in zip((found.joints.q, found.joints.v, found.joints.a), expected, strict=True):
        for k, name in enumerate(names):
            scale = np.abs(rates[name]).max()
            assert np.all(np.abs(values[:, k] - rates[name]) < 1e-13 * close * scale), name
    rate = energy_rate_of_bodies(machine, known)
    assert np.all(np.abs(found.energy_rate - rate) < 1e-13 * close * np.abs(rate).max())
    assert np.all(found.closure_error < 1e-14 * machine.geometry.L)
    lost = other.dissipation
    assert np.all(np.abs(found.dissipation - lost) < 1e-13 * close * lost.max())
    angle = kinematics.singularity(machine.geometry, states.pose).actuation
    np.testing.assert_allclose(found.actuation, angle, rtol=0, atol=1e-7)  # its arcsine, at 90 degrees
    np.testing.assert_allclose(np.sin(found.actuation), np.sin(angle), rtol=0, atol=1e-14)
    monkeypatch.setattr(kernels, "SHARE", 7)  # many threads
    shared = CompiledMethod(kernels.MachineKernels(machine, level, 8)).solve(states_over(motion))
    for name in ("speeds", "closure_error", "energy_rate", "actuation"):
        np.testing.assert_array_equal(getattr(shared, name), getattr(found, name))
    for name in "qva":
        np.testing.assert_array_equal(getattr(shared.joints, name), getattr(found.joints, name))


def test_evidence_of_bad_samples_is_that_of_the_closed_forms(robot):
    pose = MOTION.pose.copy()
    pose[5, 0], pose[9:11, 2] = 3.0, 1.6
    motion = Motion(MOTION.time, pose, MOTION.velocity, MOTION.acceleration, check=False)
    found, expected = (
        robot.inverse_dynamics(motion, wrench=WRENCH, on_invalid="nan", method=m)
        for m in ("compiled", "virtual-power")
    )
    assert np.isnan(found.forces[5]).all()
    for name in COLUMNS:
        scale = np.nanmax(np.abs(getattr(expected, "power" if "residual" in name else name)))
        atol = 1e-12 * max(scale, PAPER.geometry.L)
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0, atol=atol)
    for name in "qva":
        values, wanted = getattr(found.joints, name), getattr(expected.joints, name)
        np.testing.assert_allclose(values, wanted, rtol=0, atol=1e-12 * np.nanmax(np.abs(wanted)))


def test_joints_and_evidence_are_found_when_they_are_asked_for(robot, monkeypatch):
    asked, real = [], compiled._evidence
    monkeypatch.setattr(compiled, "_evidence", lambda *given: asked.append(given[-1]) or real(*given))
    found = robot.inverse_dynamics(MOTION, method="compiled")
    assert found.possible
    assert "joints" in dir(found)
    assert asked == []
    assert np.abs(found.power_residual).max() <= 1e-13 * np.abs(found.power).max()
    assert asked == ["speeds"]
    assert found.joints is found.joints
    assert asked == ["speeds", "joints"]
    with pytest.raises(AttributeError, match="no attribute 'torques'"):
        _ = found.torques
    far = Motion(
        MOTION.time, MOTION.pose + np.array([3.0, 0, 0]), MOTION.velocity, MOTION.acceleration, check=False
    )
    with pytest.raises(ReachError):
        robot.inverse_dynamics(far, method="compiled")
    monkeypatch.undo()
    new = robot.inverse_dynamics(MOTION, method="compiled")
    for other in (pickle.loads(pickle.dumps(new)), replace(new, crossings=np.ones(1)), new):  # noqa: S301 - its own
        for name in (*COLUMNS, "armature", "wrench"):
            np.testing.assert_array_equal(getattr(other, name), getattr(found, name))


@shows("p3dof.methods.results.InverseDynamics.closure_error")
@pytest.mark.parametrize("gap", GAPS)
@pytest.mark.parametrize("count", [1, len(MOTION)], ids=["alone", "together"])
@pytest.mark.parametrize("way", ["traced", "general"])
@pytest.mark.parametrize(
    ("joint", "arm"), [("slide_a", 1), ("slide_b", 1), ("hinge_right", PAPER.geometry.L)]
)
def test_every_loop_of_the_pinocchio_route_is_looked_at(joint, arm, way, count, gap, monkeypatch):
    """A joint that moves the end of one loop only is put off by so much that the loop is open by `gap`."""
    robot = p3dof.load(ROUGH)
    change = np.eye(10)[list(robot.model.names[1:]).index(joint)] * gap / arm
    motion = MOTION.resampled(MOTION.time[:count])
    batch, assembled = robot.bare_loop.complete_batch, traced.TracedLoops._assembled

    def together(*args, **kwargs):
        found = batch(*args, **kwargs)
        return replace(found, q=found.q + change)

    def put_off(*args):
        q, good = assembled(*args)
        return q + change, good

    if way == "general":
        monkeypatch.setattr(traced.TracedLoops, "_choose", lambda _: False)
        monkeypatch.setattr(robot.bare_loop, "complete_batch", together)
    else:
        monkeypatch.setattr(traced.TracedLoops, "_assembled", put_off)
        right = robot.inverse_dynamics(motion, method="pinocchio")
        assert right.closure_error.max() < 1e-12  # an open loop is left to the general way
        for limit in ("TOLERANCE", "ACCURACY"):
            monkeypatch.setattr(traced, limit, 1.0)
        robot = p3dof.load(ROUGH)
    found = robot.inverse_dynamics(motion, method="pinocchio")
    check_evidence(found, "closure_error", np.full(count, gap), rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("closure", range(3))
@pytest.mark.parametrize("end", ["frame1", "frame2"])
def test_a_length_that_is_off_opens_a_loop_of_pinocchios_model(closure, end, robot):
    """The machine's joints in a model whose leg, rod or platform is a millimetre longer on one side."""
    name = getattr(robot.loop.sidecar.closures[closure], end)
    model = robot.model.copy()
    frame = model.frames[model.getFrameId(name)]
    frame.placement = frame.placement * pin.SE3(np.eye(3), np.array([1e-3, 0, 0]))
    longer = p3dof.ClosedLoopModel(model, robot.loop.sidecar)
    for q in robot.inverse_dynamics(MOTION, method="pinocchio").joints.q:
        gaps = np.linalg.norm(longer.closure_error(q).reshape(3, 3), axis=1)
        np.testing.assert_allclose(gaps, 1e-3 * np.eye(3)[closure], rtol=0, atol=1e-14)


def equation(robot, i=7):
    """A state of the mechanism with friction and a wrench, its solution, and the arguments for the error."""
    found = robot.inverse_dynamics(MOTION, method="pinocchio")
    state = found.joints.q[i], found.joints.v[i], found.joints.a[i]
    loads = {"external": {"platform_center": WRENCH}, "joint_forces": -20 * found.joints.v[i]}
    return state, loads, robot.loop.inverse_dynamics(*state, **loads)


def test_a_force_or_a_loop_that_is_off_shows_in_the_equation_of_motion(robot):
    state, loads, right = equation(robot)
    loop, J = robot.loop, robot.loop.closure_jacobian(state[0])
    scale = np.abs(right.tau).max()
    assert right.residual == loop.residual(*state, right.tau, right.lambda_, **loads) < 1e-13 * scale
    off = loop.residual(*state, 1.01 * right.tau, right.lambda_, **loads)
    assert off == pytest.approx(0.01 * scale, rel=1e-10)
    for rows in loop.constraint_rows:  # a loop left out
        cut = right.lambda_.copy()
        cut[rows] = 0
        expected = np.abs(J[rows].T @ right.lambda_[rows]).max()
        assert expected > 1
        assert loop.residual(*state, right.tau, cut, **loads) == pytest.approx(expected, rel=1e-10)
    heavier = {**loads, "external": {"platform_center": 1.01 * WRENCH}}
    expected = np.abs(loop._tree.force(({"platform_center": 0.01 * WRENCH}, None))).max()
    assert loop.residual(*state, right.tau, right.lambda_, **heavier) == pytest.approx(expected, rel=1e-9)
    rougher = {**loads, "joint_forces": 1.01 * loads["joint_forces"]}
    expected = 0.01 * np.abs(loads["joint_forces"]).max()
    assert loop.residual(*state, right.tau, right.lambda_, **rougher) == pytest.approx(expected, rel=1e-9)


def test_the_residual_of_a_result_shows_a_solver_that_is_off(robot, monkeypatch):
    """With multipliers one per cent too large, one per cent of their forces is left over."""
    state, loads, right = equation(robot)
    solve = Decomposition.solve_transpose
    expected = 0.01 * np.abs(robot.loop.closure_jacobian(state[0]).T @ right.lambda_).max()
    monkeypatch.setattr(Decomposition, "solve_transpose", lambda self, f: 1.01 * solve(self, f))
    off = robot.loop.inverse_dynamics(*state, **loads)
    assert off.residual == pytest.approx(expected, rel=1e-9)


@shows("p3dof.loops.batch.dynamics.BatchInverseDynamics.residual")
def test_the_residual_of_a_batch_shows_a_solver_that_is_off(robot, monkeypatch):
    """With solutions that are too large by a share, that share of the passive joints' forces is left over."""
    joints = robot.inverse_dynamics(MOTION, method="pinocchio").joints
    share = 1e-8
    right = robot.bare_loop.inverse_dynamics_batch(joints.q, joints.v, joints.a)
    solve = batch_dynamics.solve
    monkeypatch.setattr(batch_dynamics, "solve", lambda A, b: (1 + share) * solve(A, b))
    monkeypatch.setattr(batch_dynamics, "follow", lambda rows, *_: np.ones(len(rows), dtype=bool))
    off = robot.bare_loop.inverse_dynamics_batch(joints.q, joints.v, joints.a)
    passive = [name not in robot.bare_loop.actuated for name in joints.names]
    rows = zip(joints.q, joints.v, joints.a, strict=True)
    expected = np.array([np.abs(rnea(robot, *row)[passive]).max() for row in rows])
    assert (right.residual < 1e-13 * expected).all()
    check_evidence(off, "residual", share * expected, rtol=1e-4)


def rnea(robot, q, v, a):
    return np.array(pin.rnea(robot.model, robot.model.createData(), q, v, a))


@pytest.mark.parametrize("row", range(6))
def test_each_component_of_a_wrench_acts_alone_in_both_plants(row):
    robot = p3dof.load(ROUGH)
    minimal = MinimalPlant(ROUGH, Equations(ROUGH))
    constrained = MachineJoints(ROUGH, robot.loop, 10.0)
    pose, velocity, forces = np.array([0.02, -0.03, 0.25]), np.array([0.3, -0.2, 1.5]), np.full(3, 50.0)
    wrench = np.zeros(6)
    wrench[row] = 8.0
    found = []
    for plant in (minimal, constrained):
        state = plant.state(pose, velocity)
        with_it, without = (plant.rate(state, forces, load) for load in (wrench, np.zeros(6)))
        found.append([plant.acceleration(state, rate) for rate in (with_it, without)])
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-10)
    works = row in {1, 2, 4}  # F_y, F_z and M_y
    assert (np.abs(found[0][0] - found[0][1]).max() > 0.1) == works


def test_both_plants_say_the_same_of_a_state():
    """Rates, sliders, pose, acceleration, joints and how far each leg hangs down, in motion under forces."""
    robot = p3dof.load(ROUGH)
    minimal = MinimalPlant(ROUGH, Equations(ROUGH))
    constrained = MachineJoints(ROUGH, robot.loop, 10.0)
    pose, velocity = np.array([0.02, -0.03, 0.25]), np.array([0.3, -0.2, 1.5])
    found = robot.mechanism_motion(pose, velocity, HOME)
    names = robot.model.names[1:]
    one = minimal.state(pose, velocity)
    other = np.array([*(found.position[name] for name in names), *(found.velocity[name] for name in names)])
    forces = np.array([70.0, 20.0, 60.0])
    rates = minimal.rate(one, forces, WRENCH), constrained.rate(other, forces, WRENCH)
    a = [
        plant.acceleration(x, rate)
        for plant, x, rate in zip((minimal, constrained), (one, other), rates, strict=True)
    ]
    np.testing.assert_allclose(
        a[0],
        robot.forward_dynamics(pose, velocity, forces, wrench=WRENCH, method="virtual-power"),
        rtol=1e-11,
    )
    np.testing.assert_allclose(a[1], a[0], rtol=0, atol=1e-10)
    for plant, x in ((minimal, one), (constrained, other)):
        np.testing.assert_allclose(plant.pose(x), (pose, velocity), rtol=0, atol=1e-14)
        np.testing.assert_allclose(
            plant.actuated(x), (found.sliders, found.slider_velocities), rtol=0, atol=1e-14
        )
    (first, gap), (second, other_gap) = (
        plant.joints(np.array([x]), np.array([rate]))
        for plant, x, rate in zip((minimal, constrained), (one, other), rates, strict=True)
    )
    assert first.names == second.names == tuple(names)
    for quantity in ("q", "v", "a"):
        scale = np.abs(getattr(first, quantity)).max()
        np.testing.assert_allclose(
            getattr(first, quantity), getattr(second, quantity), rtol=0, atol=1e-11 * scale
        )
    assert max(gap, other_gap) < 1e-14
    np.testing.assert_array_equal(constrained.checked_state(other[:10], other[10:], 1e-9), other)
    opened = other.copy()
    opened[0] += 1e-4
    assert constrained.joints(np.array([opened]), np.array([rates[1]]))[1] == pytest.approx([1e-4], rel=1e-9)
    across = np.sqrt(1 - (pose[0] / ROUGH.geometry.L) ** 2)  # of leg C, in the plane across y0
    np.testing.assert_allclose(
        constrained.drops(other), drops(ROUGH.geometry, pose) / [1, 1, across], rtol=1e-12
    )


@pytest.mark.parametrize("theta", [1.0, -2.5, -4.0, -7.0, 10.0, -13.0])
def test_a_turned_platform_keeps_its_whole_turns(theta):
    robot = p3dof.load()
    found = robot.mechanism_motion([0.01, 0.02, theta], HOME, HOME)
    joints = {name: float(found.position[name]) for name in robot.model.names[1:]}
    whole = (
        theta - joints["hinge_c"] - joints["hinge_platform"]
    )  # the closed form may wind an angle up itself
    joints["hinge_platform"] += whole
    plant = MachineJoints(PAPER, robot.loop, 10.0)
    pose, _ = plant.pose(np.array([*joints.values(), *np.zeros(10)]))
    np.testing.assert_allclose(pose, [0.01, 0.02, theta], rtol=0, atol=1e-13)


def test_a_plant_has_no_rate_where_no_dynamics_is():
    """A trial step of an integrator may go anywhere: what comes back has the shape of a state."""
    plant = MachineJoints(PAPER, p3dof.load().loop, 10.0)
    state = plant.state(np.array([0.02, 0.03, 0.15]), HOME)
    for there, forces in ((np.full(20, np.nan), HOME), (state, np.full(3, np.nan))):
        rate = plant.rate(there, forces, np.zeros(6))
        assert rate.shape == (20,)
        assert np.isnan(rate).all()


def test_of_samples_that_are_not_valid_no_number_is_told(robot):
    far = p3dof.Motion(
        MOTION.time,
        MOTION.pose + np.array([0.5, 0.0, 0.0]),
        MOTION.velocity,
        MOTION.acceleration,
        check=False,
    )
    result = robot.inverse_dynamics(far, on_invalid="nan")
    assert not result.valid.any()
    assert repr(result).endswith(f"not possible: {len(far)} samples are invalid)")
    np.testing.assert_array_equal(result.force_scale, np.zeros(3))
    told = {one.quantity for one in result.exceedances(PAPER.limits)}
    assert told == set()


def test_the_rms_force_is_a_mean_over_the_time_of_the_motion(robot):
    slow = p3dof.Motion(
        2.5 * MOTION.time, MOTION.pose, MOTION.velocity / 2.5, MOTION.acceleration / 2.5**2, check=False
    )
    result = robot.inverse_dynamics(slow)
    middle = (result.forces[1:] ** 2 + result.forces[:-1] ** 2) / 2
    mean = np.average(middle, axis=0, weights=np.diff(slow.time))
    np.testing.assert_allclose(result.rms_forces, np.sqrt(mean), rtol=1e-14)
    assert (result.rms_forces < np.abs(result.forces).max(axis=0)).all()


def test_what_errors_are_small_to_is_the_largest_force(robot):
    result = robot.inverse_dynamics(MOTION)
    np.testing.assert_array_equal(result.force_scale, np.abs(result.forces).max(axis=0))


@pytest.mark.parametrize("method", [*METHODS, "compiled"])
def test_without_a_wrench_a_result_has_six_zeros_a_sample(method, robot):
    result = robot.inverse_dynamics(MOTION, method=method)
    assert result.wrench.shape == (len(MOTION), 6)
    assert not result.wrench.any()


@pytest.mark.parametrize("method", [*METHODS, "compiled"])
def test_a_wrench_that_is_not_known_leaves_nothing_of_its_sample(method, robot):
    """Neither forces nor power: one component that is missing is as bad as six."""
    wrench = np.zeros((len(MOTION), 6))
    wrench[3, 4] = np.nan
    result = robot.inverse_dynamics(MOTION, method=method, wrench=wrench, on_invalid="nan")
    assert np.flatnonzero(~result.valid).tolist() == [3]
    for values in (result.forces, result.power, result.power_residual[:, None]):
        assert np.isnan(values[3]).all()
        assert np.isfinite(np.delete(values, 3, axis=0)).all()


@pytest.mark.parametrize("count", [1, 3, 41])
def test_the_power_of_a_batch_is_that_of_each_sample(count, robot):
    joints = robot.inverse_dynamics(MOTION, method="pinocchio").joints
    q, v, a = joints.q[-count:], joints.v[-count:], joints.a[-count:]
    expected = np.array([robot.loop.power(*row) for row in zip(q, v, a, strict=True)])
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(robot.loop.power_batch(q, v, a), expected, rtol=1e-11)
    geared = robot.loop.copy()  # rotors take up power of their own
    geared.model.armature = np.linspace(0.1, 1.0, geared.model.nv)
    expected += (v * a) @ geared.model.armature
    np.testing.assert_allclose(
        [geared.power(*row) for row in zip(q, v, a, strict=True)], expected, rtol=1e-11
    )
    np.testing.assert_allclose(geared.power_batch(q, v, a), expected, rtol=1e-11)


def test_baumgarte_closes_a_gap_as_it_says():
    """A gap e₀ at rest follows ë + 2β ė + β² e = 0, that is e = e₀ (1 + βt) exp(-βt)."""
    robot = p3dof.load()
    beta, gap = 10.0, 1e-5
    plant = MachineJoints(PAPER, robot.loop, beta)
    state = plant.state(np.array([0.02, 0.03, 0.15]), HOME)
    state[:3:2] += [gap, -gap / 2]  # sliders A and B
    holding = robot.forces([0.02, 0.03, 0.15], HOME, HOME)
    time = np.linspace(0, 0.5, 11)
    run = solve_ivp(
        lambda _, x: plant.rate(x, holding, np.zeros(6)),
        (0, 0.5),
        state,
        "DOP853",
        time,
        rtol=1e-10,
        atol=1e-14,
    )
    errors = np.array([robot.loop.closure_error(q) for q in run.y[:10].T])
    assert np.abs(errors[0]).max() > gap / 2
    decay = (1 + beta * time) * np.exp(-beta * time)
    np.testing.assert_allclose(errors, decay[:, None] * errors[0], rtol=0, atol=1e-6 * gap)


def test_what_is_off_in_the_forward_dynamics_is_told(robot, monkeypatch):
    """An acceleration that is off is refused, with the force that is missing and the opening it makes."""
    (q, v, _), loads, right = equation(robot)
    loop = robot.loop
    J, exact = loop.closure_jacobian(q), loop.forward_dynamics(q, v, right.tau, **loads)
    assert exact.residual < 1e-12 * np.abs(right.tau).max()
    change = np.linspace(-1, 1, 10)
    forward = loop._tree.dynamics.forward
    refined = forward._refined
    monkeypatch.setattr(forward, "_refined", lambda *args: refined(*args) + change)
    partitioned = forward._partitioned

    def wrong(split, point, v, force, drift):  # closures that open do not pass for an acceleration
        return partitioned(split, point, v, force, drift + 1.0)

    monkeypatch.setattr(forward, "_partitioned", wrong)
    with pytest.raises(DynamicsError, match="did not reach its accuracy") as caught:
        loop.forward_dynamics(q, v, right.tau, **loads)
    missing = rnea(robot, q, v, exact.a + change) - rnea(robot, q, v, exact.a)
    missing = missing - J.T @ np.linalg.lstsq(J.T, missing, rcond=1e-9)[0]
    told = [float(number) for number in re.findall(r"([\d.e+-]+) (?:N or|m/s²)", str(caught.value))]
    np.testing.assert_allclose(told, [np.abs(missing).max(), np.abs(J @ change).max()], rtol=5e-3)


@pytest.mark.parametrize("method", ["compiled", "virtual-power"])
def test_evidence_of_a_long_motion_takes_little_more_memory_than_the_result(method):
    robot, count = p3dof.load(), 40_000
    motion = p3dof.paper_motion(count)
    robot.inverse_dynamics(p3dof.paper_motion(10), method=method)
    tracemalloc.start()
    try:
        result = robot.inverse_dynamics(motion, method=method)
        kept, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert result.possible
    assert (peak - kept) / count < 700


@pytest.mark.parametrize("method", ["compiled", "virtual-power"])
def test_blocks_change_no_bit_and_no_word(method, monkeypatch):
    machine = random_machine(4)
    robot, states = p3dof.load(machine), random_states(machine, 4, 5000)
    pose = states.pose.copy()
    motion = p3dof.Motion(np.arange(5000.0), pose, states.velocity, states.acceleration, check=False)
    pose[[3000, 4500]] = [9.0, 0, 0]
    broken = p3dof.Motion(np.arange(5000.0), pose, states.velocity, states.acceleration, check=False)
    table = [x.reshape(5, 1000, 3) for x in (pose, states.velocity, states.acceleration)]
    found = []
    for block in (10**6, 1000, 4999):
        monkeypatch.setattr(closed_form, "_BLOCK", block)
        results = [
            robot.inverse_dynamics(one, method=method, on_invalid="nan", wrench=states.wrench)
            for one in (motion, broken)
        ]
        assert np.isnan(results[1].forces[[3000, 4500]]).all()
        with pytest.raises(ReachError, match=r"\(sample 3000, the first of 2 such of 5000\)"):
            robot.inverse_dynamics(broken, method=method)
        with pytest.raises(ReachError, match=r"\(sample \(3, 0\), the first of 2 such of 5000\)"):
            robot.forces(*table, method=method)
        found.append([getattr(result, name) for result in results for name in COLUMNS])
        found[-1] += [result.joints.a for result in results]
    for others in found[1:]:
        for one, other in zip(found[0], others, strict=True):
            np.testing.assert_array_equal(one, other)
