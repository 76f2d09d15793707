"""Loops closed by straight-line functions: against Pinocchio's own Jacobians, and the general way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from machines import conditioning, random_machine, random_states

import p3dof
from p3dof import PAPER
from p3dof.loops.batch import traced
from p3dof.loops.batch.traced import AxisTree, Elimination, TracedLoops
from p3dof.machine import Friction
from p3dof.machine.motion import states_of
from p3dof.methods.pinocchio import MASK, PLATFORM, PinocchioMethod
from p3dof.methods.pinocchio import target_of as target_at
from p3dof.methods.virtual_power import VirtualPowerMethod


def loops_of(robot):
    depth = robot.parameters.geometry.h

    def goal(y, z, c, s):
        return (0.0, y, z - depth), [(c, 0.0, -s), (0.0, 1.0, 0.0), (s, 0.0, c)]

    loop = robot.loop
    return TracedLoops(loop.model, loop.sidecar, loop.reference, PLATFORM, MASK, goal, 4)


def target_of(pose):
    return pose[:, 0], pose[:, 1], np.cos(pose[:, 2]), np.sin(pose[:, 2])


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def loops(robot):
    return loops_of(robot)


def test_rows_are_those_of_pinocchios_constraint_models_and_frames(robot, loops):
    """At configurations where the loops are wide open, too."""
    model, models, rng = robot.model, robot.constraint_models, np.random.default_rng(1)
    datas, data = pin.StdVec_ConstraintData(), model.createData()
    for one in models:
        datas.append(one.createData())
    for q in rng.uniform(-1, 1, (20, model.nq)):
        pin.computeJointJacobians(model, data, q)
        for one, own in zip(models, datas, strict=True):
            one.calc(model, data, own)
        J = pin.getConstraintsJacobian(model, data, models, datas)
        frame = model.getFrameId(PLATFORM)
        target = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[np.array(MASK)]
        bodies = loops.tree.bodies(loops.tree.numbers_of_one(q))
        np.testing.assert_allclose(loops._rows(bodies, range(9)), np.vstack((J, target)), rtol=0, atol=5e-14)
        errors = [loops._axis(bodies, row) @ np.array(loops._apart(bodies)[row // 3]) for row in range(9)]
        wanted = np.concatenate([own.extract().constraint_position_error for own in datas])
        np.testing.assert_allclose(errors, wanted, rtol=0, atol=5e-14)


def test_drift_energy_and_wrenches_are_pinocchios(robot, loops):
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(2)
    power, loads = loops.power, loops.loads((PLATFORM, "leg_a_tip"))
    for q, v, a in rng.uniform(-1, 1, (20, 3, model.nv)):
        numbers = loops.tree.numbers_of_one(q)
        scale = np.abs(v) @ np.abs(pin.rnea(model, data, q, v, a)) + 1.0
        assert power(*numbers, *v.tolist(), *a.tolist())[0] == pytest.approx(
            robot.loop.power(q, v, a), abs=1e-13 * scale
        )
        pin.forwardKinematics(model, data, q, v, 0 * v)
        frame = model.getFrameId(PLATFORM)
        moving = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
        _, drift = loops._drift(loops.tree.bodies(numbers), v.tolist())
        np.testing.assert_allclose(drift, moving[np.array(MASK)], rtol=0, atol=1e-13)
        wrenches = rng.uniform(-1, 1, (2, 6))
        pin.computeJointJacobians(model, data, q)
        wanted = sum(
            pin.computeFrameJacobian(model, data, q, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED).T @ w
            for name, w in zip((PLATFORM, "leg_a_tip"), wrenches, strict=True)
        )
        np.testing.assert_allclose(loads(*numbers, *wrenches.ravel().tolist()), wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", range(8))
def test_forces_joints_and_evidence_are_those_of_both_other_ways(seed, monkeypatch):
    """On random machines with friction and wrenches: the general way, and virtual powers."""
    machine = replace(random_machine(seed), friction=Friction({"sliders": 20.0, "joints": 0.5}))
    s = random_states(machine, seed, 60)
    states = states_of(s.pose, s.velocity, s.acceleration, wrench=s.wrench)
    method = PinocchioMethod(machine, p3dof.load(machine).loop)
    traced_part = method._direct.here.together(np.arange(60), *states[:3], states.wrench)
    rows = traced_part.rows
    assert len(rows) >= 5
    found = method.solve(states)
    np.testing.assert_array_equal(found.forces[rows], traced_part.forces)
    monkeypatch.setattr(TracedLoops, "_choose", lambda _: False)
    general = PinocchioMethod(machine, p3dof.load(machine).loop).solve(states)
    powers = VirtualPowerMethod(machine).solve(states)
    near = 1e-13 * conditioning(machine.geometry, s.pose)[rows, None]
    for wanted in (general, powers):
        sines = [np.sin(each.actuation[rows]) for each in (found, wanted)]
        np.testing.assert_allclose(*sines, rtol=0, atol=near.max())
        for name in ("forces", "energy_rate", "dissipation"):
            one, other = (np.reshape(getattr(each, name)[rows], (len(rows), -1)) for each in (found, wanted))
            assert (np.abs(one - other) <= near * np.abs(getattr(wanted, name)).max()).all(), name
        assert found.closure_error[rows].max() < 1e-13 * max(1.0, machine.geometry.L)
    for name in "qva":  # of the general way, angles may be a whole turn off: poses come in any order
        one, other = (getattr(each.joints, name)[rows] for each in (found, powers))
        assert (np.abs(one - other) <= near * np.abs(getattr(powers.joints, name)).max()).all(), name


def test_a_sample_has_the_same_bits_alone_and_in_any_company(robot, loops):
    pose, velocity, acceleration = np.random.default_rng(3).uniform(-1, 1, (3, 300, 3)) * [0.1, 0.1, 0.6]
    many = robot.forces(pose, velocity, acceleration)
    order = np.random.default_rng(4).permutation(300)
    np.testing.assert_array_equal(
        robot.forces(*(x[order] for x in (pose, velocity, acceleration))), many[order]
    )
    for i in range(0, 300, 7):
        one = [x[i] for x in (pose, velocity, acceleration)]
        np.testing.assert_array_equal(robot.forces(*one), many[i])
        np.testing.assert_array_equal(robot.forces(*(x.tolist() for x in one)), many[i])
    assert loops.many(target_of(pose), velocity, acceleration).good.all()  # none of them took the general way


def test_another_assembly_or_a_singularity_is_left_to_the_general_way(robot, loops):
    rest = np.zeros((1, 3))
    away = loops.many(target_of(np.array([[5.0, 0.0, 0.0]])), rest, rest)
    assert not away.good.any()
    assert loops.one((5.0, 0.0, 1.0, 0.0), [0.0] * 3, [0.0] * 3) is None
    rest, other_assemblies = [0.0] * 6, 0
    for mode in robot.loop.assembly_modes(
        target_at([0.0, 0.0, 0.0], robot.parameters.geometry.h), starts=60, seed=0
    ):
        numbers = loops.tree.numbers_of_one(mode.q)
        (_, y, z), axes = loops._placed(loops.tree.bodies(numbers))
        given = y, z + robot.parameters.geometry.h, axes[0][0], -axes[0][2]
        same = np.allclose(mode.q, robot.loop.reference, rtol=0, atol=1e-6)
        assert (loops._end(*numbers, *given, *rest)[0] > 0.0) == same  # the signs of the pivots tell
        other_assemblies += not same
    assert other_assemblies > 0


def test_elimination_solves_with_a_pattern_and_refuses_nothing():
    rng = np.random.default_rng(5)
    for size in range(1, 9):
        pattern = rng.uniform(size=(size, size)) < 0.4
        pattern |= np.eye(size, dtype=bool)[rng.permutation(size)]
        values = np.where(pattern, rng.uniform(1, 2, (size, size)) * rng.choice([-1, 1], (size, size)), 0.0)
        if np.linalg.cond(values) > 1e4:
            continue
        solver, b = Elimination(values, pattern), rng.normal(size=size)
        factors = values.tolist()
        pivots = solver.factorise(factors)
        np.testing.assert_allclose(pivots, solver.pivots, rtol=1e-9)
        assert abs(np.prod(pivots)) == pytest.approx(abs(np.linalg.det(values)), rel=1e-10)
        np.testing.assert_allclose(solver.solve(factors, b.tolist()), np.linalg.solve(values, b), rtol=1e-10)


def test_robots_of_other_joints_or_closures_are_not_traced(robot):
    free = pin.Model()
    free.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    assert not AxisTree.suits(free)
    assert AxisTree.suits(robot.model)
    welded = replace(robot.loop.sidecar, closures=robot.loop.sidecar.closures[:1])
    goal = lambda *_: ((0.0, 0.0, 0.0), [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])  # noqa: E731
    assert not TracedLoops(robot.model, welded, robot.loop.reference, PLATFORM, MASK, goal, 0).usable
    loose = p3dof.loops.Sidecar((), ())
    assert not TracedLoops(free, loose, pin.neutral(free), "free", MASK, goal, 0).usable


def test_a_wrong_row_is_seen_and_left_to_the_general_way(monkeypatch):
    """The rows that are not needed to find accelerations tell that one of the others is off."""
    right = p3dof.load().forces([0.02, 0.03, 0.1], [0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
    drift = TracedLoops._drift

    def broken(self, bodies, v):
        rows, of_target = drift(self, bodies, v)
        return [row * (1.001 if i in self._others else 1.0) for i, row in enumerate(rows)], of_target

    monkeypatch.setattr(traced.TracedLoops, "_drift", broken)
    np.testing.assert_allclose(
        p3dof.load(PAPER).forces([0.02, 0.03, 0.1], [0.1, 0.2, 0.3], [1.0, 2.0, 3.0]), right, rtol=1e-12
    )
