"""Machines of every size: lengths times s, all else alike, is the same machine in another unit of length."""

from __future__ import annotations

from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from machines import random_machine, random_states

import p3dof
from p3dof._base.errors import AssemblyError, ParameterError
from p3dof.loops import ClosedLoopModel, Sidecar
from p3dof.loops.batch.assembly import FrameTargets
from p3dof.machine.parameters import PAPER, Bodies, Body, Geometry, Parameters

SCALES = [1e-6, 1e-3, 1e-2, 20.0, 150.0, 1e4]
REST = np.zeros(3)


def scaled_machine(machine: Parameters, s: float) -> Parameters:
    g = machine.geometry
    bodies = {name: Body(b.mass, b.com * s, b.inertia * s**2) for name, b in machine.bodies.items()}
    lengths = Geometry(r=g.r * s, R=g.R * s, L=g.L * s, b=g.b * s)
    return replace(machine, geometry=lengths, bodies=Bodies(**bodies), gravity=machine.gravity * s)


@pytest.mark.parametrize("machine", [PAPER, random_machine(5)], ids=["paper", "random"])
@pytest.mark.parametrize("s", SCALES)
def test_both_ways_agree_at_every_scale(s, machine):
    """One by one and in a batch, and the equations of motion the other way round."""
    robot = p3dof.load(scaled_machine(machine, s))
    states = random_states(machine, 3, 30, drop=0.3, angle=0.3)
    by = np.array([s, s, 1])
    pose, velocity, acceleration = states.pose * by, states.velocity * by, states.acceleration * by
    expected = robot.forces(pose, velocity, acceleration, method="virtual-power")
    size = np.abs(expected).max(axis=1, keepdims=True)
    batch = robot.forces(pose, velocity, acceleration)
    assert (np.abs(batch - expected) / size).max() < 1e-12
    few = robot.forces(pose[:3], velocity[:3], acceleration[:3])
    assert (np.abs(few - expected[:3]) / size[:3]).max() < 1e-12
    found = robot.forward_dynamics(pose[:3], velocity[:3], expected[:3], method="pinocchio")
    assert (np.abs(found - acceleration[:3]) / by).max() < 1e-9 * np.abs(states.acceleration).max()


@pytest.mark.parametrize("s", [1e-6, 1e4])
def test_evidence_and_runs_at_every_scale(s):
    """Closures and power balance in their units, and a run in time that is the paper's machine's, scaled."""
    robot, by = p3dof.load(scaled_machine(PAPER, s)), np.array([s, s, 1])
    paper = p3dof.paper_motion(21)
    motion = p3dof.Motion(paper.time, paper.pose * by, paper.velocity * by, paper.acceleration * by)
    result = robot.inverse_dynamics(motion)
    assert 0 < result.closure_error.max() < 1e-14 * s
    assert np.abs(result.power_residual).max() < 1e-13 * np.abs(result.power).max()
    runs = [
        p3dof.load(machine).simulate(
            0.1,
            start=p3dof.runs.InitialState(velocity=[0, 0, 1.0]),
            method="pinocchio",
            samples=3,
            stop_at=(),
        )
        for machine in (PAPER, scaled_machine(PAPER, s))
    ]
    np.testing.assert_allclose(runs[1].pose, runs[0].pose * by, rtol=1e-7, atol=1e-9 * s)


@pytest.mark.filterwarnings("ignore:beyond what the machine can do")
@pytest.mark.parametrize("z", [-200.0, 200.0, 1e3, 1e4, -1e6])
def test_platforms_far_up_and_down(z):
    """As exact as the rounding of so large numbers allows; the forces do not depend on z at all."""
    robot, motion = p3dof.load(), p3dof.paper_motion(20)
    pose = motion.pose + np.array([0, z, 0])
    for rows in (slice(None), slice(0, 3)):
        states = pose[rows], motion.velocity[rows], motion.acceleration[rows]
        expected = robot.forces(*states, method="virtual-power")
        error = np.abs(robot.forces(*states) - expected).max() / np.abs(expected).max()
        assert error < 2 * np.finfo(float).eps * abs(z) / PAPER.geometry.L


@pytest.mark.parametrize("b", [1e-6, 1e2, 1e4])
def test_parallelograms_of_any_width(b):
    robot = p3dof.load(replace(PAPER, geometry=replace(PAPER.geometry, b=b)))
    motion = p3dof.paper_motion(20)
    expected = robot.inverse_dynamics(motion, method="virtual-power").forces
    error = np.abs(robot.inverse_dynamics(motion).forces - expected).max() / np.abs(expected).max()
    assert error < 1e-12 + 10 * np.finfo(float).eps * b / PAPER.geometry.L


@pytest.mark.parametrize("gap", [1e-7, 1e-9, 1e-13])
def test_parallel_legs_cannot_hold_the_platform(gap):
    """Legs A and B one beside the other: no machine, whichever way its forces would be computed."""
    with pytest.raises(ParameterError, match="R - r: expected at least 1e-06 L"):
        Geometry(r=0.25 - gap, R=0.25)
    machine = replace(PAPER, geometry=Geometry(r=0.25 - 1e-6, R=0.25))
    forces = [p3dof.load(machine).forces(REST, REST, REST, method=m) for m in ("pinocchio", "virtual-power")]
    np.testing.assert_allclose(*forces, rtol=1e-8, atol=0)


def scaled_loop(name: str, s: float) -> ClosedLoopModel:
    """A robot whose lengths are s times as long."""
    xml, sidecar = {
        "hexapod": (robots.hexapod(), robots.HEXAPOD_SIDECAR),
        "sarrus": (robots.sarrus(), robots.SARRUS_SIDECAR),
    }[name]
    loop = ClosedLoopModel.from_urdf(xml, sidecar)
    model = loop.model.copy()
    for i in range(model.njoints):
        M, body = model.jointPlacements[i], model.inertias[i]
        model.jointPlacements[i] = pin.SE3(M.rotation, M.translation * s)
        model.inertias[i] = pin.Inertia(body.mass, body.lever * s, body.inertia * s**2)
    for frame in model.frames:
        frame.placement = pin.SE3(frame.placement.rotation, frame.placement.translation * s)
    model.gravity.linear = model.gravity.linear * s
    return ClosedLoopModel(model, loop.sidecar)


@pytest.mark.parametrize("s", [1e-5, 1e3])
def test_hexapods_of_every_scale(s):
    """A floating platform and slides: lengths and angles in one configuration."""
    one, other = scaled_loop("hexapod", 1.0), scaled_loop("hexapod", s)
    rng, count = np.random.default_rng(0), 12
    home = pin.SE3(pin.utils.rotate("x", 0.1), np.array([0.05, -0.02, 0.6]))
    guess = robots.hexapod_q(home, one.model)
    turns = [pin.exp3(rng.normal(0, 0.1, 3)) @ home.rotation for _ in range(count)]
    places = home.translation + rng.normal(0, 0.03, (count, 3))
    twist, change = rng.normal(size=(2, count, 6))
    # what is a length in q: that of the platform, and of every leg
    names = ["float", *(f"slide_{i}" for i in range(6))]
    q_by, v_by = np.ones(one.model.nq), np.ones(one.model.nv)
    for name in names:
        j = one.model.getJointId(name)
        q_by[one.model.idx_qs[j] : one.model.idx_qs[j] + min(3, one.model.nqs[j])] = s
        v_by[one.model.idx_vs[j] : one.model.idx_vs[j] + min(3, one.model.nvs[j])] = s
    lengths = np.array([s, s, s, 1, 1, 1])
    small = one.complete_batch(FrameTargets("platform", places, turns), twist, change, guess=guess)
    targets = FrameTargets("platform", places * s, turns)
    large = other.complete_batch(targets, twist * lengths, change * lengths, guess=guess * q_by)
    np.testing.assert_allclose(large.q / q_by, small.q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(large.a / v_by, small.a, rtol=0, atol=1e-11)
    np.testing.assert_allclose(
        large.inverse_jacobian * lengths / s, small.inverse_jacobian, rtol=0, atol=1e-12
    )
    wrench = rng.normal(size=(count, 6))
    acting = {"platform": wrench}, {"platform": wrench * s * [1, 1, 1, s, s, s]}
    first = one.inverse_dynamics_batch(small.q, small.v, small.a, acting[0])
    second = other.inverse_dynamics_batch(large.q, large.v, large.a, acting[1])
    assert not first.errors
    assert not second.errors
    np.testing.assert_allclose(second.tau / s, first.tau, rtol=0, atol=1e-10)
    assert second.conditioning.min() > 0.05  # in a unit of about the machine's size: no smaller for tiny ones
    # one by one, and forward
    target = targets[3]
    state = other.complete(target, twist[3] * lengths, change[3] * lengths, guess * q_by)
    np.testing.assert_allclose(state.q, large.q[3], rtol=0, atol=1e-12 * max(1, s))
    alone = other.inverse_dynamics(state.q, state.v, state.a, {"platform": acting[1]["platform"][3]})
    np.testing.assert_allclose(alone.tau / s, first.tau[3], rtol=0, atol=1e-10)
    assert alone.gap < 1e-13 * max(1, s)
    moving = other.forward_dynamics(state.q, state.v, alone.tau, {"platform": acting[1]["platform"][3]})
    np.testing.assert_allclose(moving.a / v_by, small.a[3], rtol=0, atol=1e-8)


@pytest.mark.parametrize("s", [1e-5, 1e3])
def test_closures_of_placements_at_every_scale(s):
    """Multipliers are forces and moments, gaps metres and radians; masses and gravity may change later."""
    one, other = scaled_loop("sarrus", 1.0), scaled_loop("sarrus", s)
    q = [loop.assemble([0.3]).q for loop in (one, other)]
    np.testing.assert_allclose(q[1], q[0], rtol=0, atol=1e-12)
    assert [loop.rank(q[0]) for loop in (one, other)] == [5, 5]
    assert [loop.mobility(q[0]) for loop in (one, other)] == [1, 1]
    assert one.generic_rank == other.generic_rank == 5
    for loop in (one, other):
        body = loop.model.inertias[1]
        loop.model.inertias[1] = pin.Inertia(2 * body.mass, body.lever, 2 * body.inertia)
        loop.model.gravity.linear = loop.model.gravity.linear * 1.5
    states = [loop.complete([0.3], [0.7], [1.1]) for loop in (one, other)]
    found = [loop.inverse_dynamics(x.q, x.v, x.a) for loop, x in zip((one, other), states, strict=True)]
    np.testing.assert_allclose(found[1].tau / s**2, found[0].tau, rtol=1e-11)
    by = s * np.array([1, 1, 1, s, s, s])
    forces = [x.lambda_[:6] for x in found]
    unique = found[0].unique & found[1].unique
    np.testing.assert_allclose((forces[1] / by)[unique], forces[0][unique], rtol=0, atol=1e-9)


@pytest.mark.parametrize("s", [1e-5, 1.0, 1e3])
def test_couplings_of_lengths_and_angles_at_every_scale(s):
    """A cam on a slide, a rack on a pinion, and a slide by the sum of both, in closed form."""
    model = pin.Model()
    kinds = {"slide": pin.JointModelPX(), "cam": pin.JointModelRZ(), "rack": pin.JointModelPY()}
    for name, kind in {**kinds, "sum": pin.JointModelPZ()}.items():
        place = pin.SE3(np.eye(3), np.array([0.3, 0.2, 0.1]) * s)
        index = model.addJoint(model.njoints - 1, kind, place, name)
        model.appendBodyToJoint(index, pin.Inertia(1.0, REST, np.eye(3) * s**2), pin.SE3.Identity())
    couplings = (
        p3dof.Coupling("cam", "slide", (0.1, 3 / s, -5 / s**2)),
        p3dof.Coupling("rack", "cam", (0.02 * s, 0.4 * s)),
        p3dof.Coupling("sum", None, (0.05 * s,), others=[("cam", -0.3 * s), ("slide", 0.5)]),
    )
    loop = ClosedLoopModel(model, Sidecar((), ("slide",), couplings))
    x, v, a = 0.15, 0.7, -1.2  # of the slide, by s
    cam = np.array([0.1 + 3 * x - 5 * x**2, (3 - 10 * x) * v, (3 - 10 * x) * a - 10 * v**2])
    rows = [np.array([x, v, a]), cam, 0.4 * cam + [0.02, 0, 0], 0.5 * np.array([x, v, a]) - 0.3 * cam]
    rows[3][0] += 0.05
    expected, by = np.transpose(rows), np.array([s, 1, s, s])
    found = loop.complete([x * s], [v * s], [a * s])
    together = loop.complete_batch([[x * s]], [[v * s]], [[a * s]])
    for name, row in zip(("q", "v", "a"), expected, strict=True):
        np.testing.assert_allclose(getattr(found, name) / by, row, rtol=0, atol=1e-12)
        np.testing.assert_allclose(getattr(together, name)[0] / by, row, rtol=0, atol=1e-12)
    for target in ({"slide": x * s}, {"cam": cam[0]}, {"rack": rows[2][0] * s}):
        np.testing.assert_allclose(loop.assemble(target).q / by, expected[0], rtol=0, atol=1e-12)


def test_errors_of_scaled_models_name_the_unit():
    loop = scaled_loop("hexapod", 1e3)
    far = pin.SE3(np.eye(3), np.array([0.0, 0, 600.0]))
    q = loop.assemble(p3dof.FrameTarget("platform", far)).q.copy()
    q[loop.model.idx_qs[loop.model.getJointId("slide_0")]] += 1.0
    with pytest.raises(
        p3dof._base.errors.InputError,
        match=r"is open by 0\.998 m or 0\.0156 rad, expected at most 0\.00064 m",
    ):
        loop.inverse_dynamics(q, *np.zeros((2, 24)))
    with pytest.raises(AssemblyError, match=r"leaves (\S+) m or \S+ rad") as info:
        scaled_loop("sarrus", 1e-3).assemble(
            p3dof.FrameTarget("plate", pin.SE3(np.eye(3), np.array([5.0, 0, 0])))
        )
    assert 4 < info.value.gap < 6
    assert float(str(info.value).split("leaves ")[1].split(" m or")[0]) == pytest.approx(
        info.value.gap, rel=5e-3
    )
