"""Thresholds just below and just above, and the numbers inside error messages against an own computation."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import p3dof
import p3dof.loops.batch.assembly as batch_assembly
from p3dof import PAPER, FrameTarget, Motion
from p3dof._base.errors import (
    AssemblyError,
    DynamicsError,
    InputError,
    MotionError,
    ReachError,
    SampleError,
    SingularityError,
)
from p3dof.loops import ClosedLoopModel, Sidecar
from p3dof.loops import assembly as solver

G = PAPER.geometry
HOME = np.zeros(3)
NUMBER = r"(-?\d+\.?\d*(?:e[+-]?\d+)?)"


def told(error, *patterns):
    """The numbers of a message at the places of the patterns, each with one # for a number."""
    text = str(error.value)
    found = [re.search(pattern.replace("#", NUMBER), text) for pattern in patterns]
    assert all(found), text
    return [float(match[1]) for match in found]


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def swing(robot):
    """A state of all joints in motion."""
    joints = robot.inverse_dynamics(p3dof.paper_motion(11)).joints
    return joints.q[3], joints.v[3], joints.a[3]


# -- thresholds --------------------------------------------------------------------------------------------


class Scripted:
    """A system of equations whose Newton steps have given sizes; its residual is zero from the start."""

    def __init__(self, *sizes):
        self.sizes = iter([*sizes, 0.0, 0.0])

    def at(self, _):
        size = next(self.sizes)
        point = SimpleNamespace(q=np.zeros(1), r=np.zeros(1))
        point.step_to = lambda _: np.array([size])
        return point

    def moved(self, q, _):
        return self.at(q)


@pytest.mark.parametrize(
    ("sizes", "taken"),
    [
        ((0.2999, 0.07), True),
        ((0.3001, 0.07), False),  # the first step is too long
        ((0.2, 0.04999), True),
        ((0.2, 0.05001), False),  # a quarter of the one before
        ((0.2, 0.04, 0.00999), True),
        ((0.2, 0.04, 0.01001), False),
        ((0.2, 0.04, 1e-10), True),
    ],
)
def test_a_newton_step_contracts_to_a_quarter(sizes, taken):
    system = Scripted(*sizes)
    start = system.at(None)
    point, _ = solver._correct(system, start, np.zeros(1), True, 1e-12, np.ones(1))
    assert (point is not None) == taken


def test_a_newton_step_of_a_batch_contracts_to_the_same_quarter():
    first = np.array([0.2999, 0.3001, 0.2, 0.2])
    second = np.array([0.07, 0.07, 0.04999, 0.05001])
    steps = [first, second, np.zeros(4), np.zeros(4)]

    class Points:
        def __init__(self, rows, level):
            self.rows, self.level = rows, level
            self.q = np.zeros((len(rows), 1))

        def take(self, rows):
            return Points(self.rows[rows], self.level)

        def put(self, *_):
            pass

    level = iter(range(1, 9))
    system = SimpleNamespace(
        step=lambda points, _: steps[min(points.level, 3)][points.rows][:, None],
        at=lambda _, rows: Points(rows, next(level)),
        moved=lambda q, _: q,
        sweep=SimpleNamespace(model=SimpleNamespace(nv=1)),
    )
    here, rows = Points(np.arange(4), 0), np.arange(4)
    _, solved = batch_assembly._correct(system, here, np.zeros((4, 1)), rows)
    assert solved.tolist() == [True, False, True, False]


@pytest.mark.parametrize("what", ["velocity", "acceleration"])
def test_a_motion_that_the_mechanism_cannot_have_is_told_with_what_is_left(robot, what):
    """The platform cannot move along x0: what is asked there is left over, and allowed up to 1e-9 of 1."""
    place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -G.h]))
    target = FrameTarget("platform_center", place, (True, True, True, False, True, False))

    def complete(along):
        asked = {"velocity": np.zeros(4), "acceleration": np.zeros(4)}
        asked[what][0] = along
        return robot.loop.complete(target, asked["velocity"], asked["acceleration"])

    with pytest.raises(AssemblyError, match=f"cannot have this {what}") as caught:
        complete(1e-3)
    left = caught.value.gap
    unit = "m/s or rad/s" if what == "velocity" else "m/s² or rad/s²"
    found = told(caught, f"# {unit} is left over", "; # values are prescribed at", "mobility of #")
    assert found == pytest.approx([left, 4, robot.loop.mobility(robot.loop.assemble().q)], rel=5e-3)
    assert 1e-5 < left <= 1e-3
    complete(0.999e-9 * 1e-3 / left)
    with pytest.raises(AssemblyError):
        complete(1.001e-9 * 1e-3 / left)


def straight(dy=0.0, ddy=0.0, jump=0.0):
    """Constant acceleration, which all splines know exactly, with errors in it."""
    t = np.linspace(0, 1, 21)
    pose = np.column_stack([t**2, 0 * t, 0 * t])
    pose[11:, 0] += jump
    velocity = np.column_stack([2 * t + dy, 0 * t, 0 * t])
    acceleration = np.column_stack([0 * t + 2 + ddy, 0 * t, 0 * t])
    return Motion(t, pose, velocity, acceleration)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_motion_is_consistent_to_a_thousandth(sign):
    """Of the column's largest velocity, 2 m/s, and acceleration, 2 m/s²."""
    straight(dy=sign * 1.999e-3)
    straight(ddy=sign * 1.999e-3)
    with pytest.raises(MotionError, match="velocity of y") as caught:
        straight(dy=sign * 2.01e-3)
    expected, got = told(caught, "expected # m/s,", "got # m/s")
    assert got - expected == pytest.approx(sign * 2.01e-3, abs=1.1e-5)
    with pytest.raises(MotionError, match="acceleration of y") as caught:
        straight(ddy=sign * 2.01e-3)
    expected, got = told(caught, "expected # m/s²,", "got # m/s²")
    assert (expected, got) == pytest.approx((2, 2 + sign * 2.01e-3), abs=1e-5)


# -- numbers in messages -----------------------------------------------------------------------------------


def test_how_much_a_leg_is_too_short(robot):
    short = p3dof.load(replace(PAPER, geometry=replace(G, L=0.3)))  # one whose leg C reaches less than R + r
    for machine, leg, pose in (
        (robot, "A", [0.26, 0.1, 0.2]),
        (robot, "B", [-0.27, 0.0, 0.1]),
        (short, "C", [0.02, 0.0, np.pi - 0.1]),
    ):
        with pytest.raises(ReachError, match=f"leg {leg} is too short") as caught:
            machine.forces(pose, HOME, HOME, method="virtual-power")
        y, _, theta = pose
        demands = {"A": G.R - G.r + y, "B": G.R - G.r - y, "C": np.hypot(y, G.R - G.r * np.cos(theta))}
        short_by = demands[leg] - machine.parameters.geometry.L
        assert short_by > 1e-3
        assert told(caught, "too short by # m") == pytest.approx([short_by], rel=1e-5)
        assert told(caught, "y = # m", "z = # m", "theta = # rad") == pytest.approx(pose, rel=1e-5)
        assert caught.value.margin == pytest.approx(-short_by, rel=1e-12)


def test_how_far_sliders_are_from_assembling(robot):
    with pytest.raises(ReachError, match="too far apart") as caught:
        robot.forward_kinematics([0.1, 1.0, 0.0])
    apart = 2 * (np.hypot(G.R - G.r, 0.45) - G.L)
    assert told(caught, "for their legs by # m") == pytest.approx([apart], rel=1e-5)
    assert told(caught, "A = # m", "B = # m", "C = # m") == [0.1, 1.0, 0.0]
    with pytest.raises(ReachError, match="leg C misses") as caught:
        robot.forward_kinematics([0.0, 0.0, 2.0])
    drop = np.sqrt(G.L**2 - (G.R - G.r) ** 2)
    assert told(caught, "by # m") == pytest.approx([np.hypot(G.R, 2 + drop) - G.L - G.r], rel=1e-5)


def test_how_near_a_pose_is_to_the_singularity(robot):
    theta = np.arccos(G.R / (G.r + G.L))
    off = 4e-7
    with pytest.raises(SingularityError) as caught:
        robot.forces([0, 0, theta - off], HOME, HOME, method="virtual-power")
    assert told(caught, "# rad from det J") == pytest.approx([off * (1 + G.r / G.L)], rel=2e-2)


def test_by_how_much_loops_are_open_or_opened(robot, swing):
    q, v, a = swing
    off = q.copy()
    off[0] += 3e-3
    with pytest.raises(InputError, match="closure leg_a_tip") as caught:
        robot.loop.inverse_dynamics(off, v, a)
    expected = np.abs(robot.loop.closure_error(off)).max()
    assert 2e-3 < expected <= 3e-3
    assert told(caught, "open by #", "at most #") == pytest.approx([expected, 1e-5], rel=5e-3)
    for name, arguments in (("v", (v + 0.1 * np.eye(10)[2], a)), ("a", (v, a + 0.2 * np.eye(10)[2]))):
        with pytest.raises(InputError, match=f"{name}: opens the closure leg_b_tip") as caught:
            robot.loop.inverse_dynamics(q, *arguments)
        J = robot.loop.closure_jacobian(q)[3:6, 2]
        size = {"v": 0.1, "a": 0.2}[name]
        assert told(caught, "by # ")[0] == pytest.approx(size * np.abs(J).max(), rel=5e-3)


def test_how_much_force_is_missing(robot, swing):
    """With two of the three drives left, one free motion is not driven."""
    weak = ClosedLoopModel(robot.model, Sidecar(robot.loop.sidecar.closures, ("slide_a", "slide_b")))
    with pytest.raises(DynamicsError, match=r"\(2 actuators, 3 free motions\)") as caught:
        weak.inverse_dynamics(*swing)
    q, v, a = swing
    f = np.array(pin.rnea(robot.model, robot.model.createData(), q, v, a))
    _, s, V = np.linalg.svd(robot.loop.closure_jacobian(q))
    N = V[int(np.sum(s > 1e-9)) :].T
    A = N[weak.actuated_v].T
    left = N @ (N.T @ f - A @ np.linalg.lstsq(A, N.T @ f, rcond=None)[0])
    missing = told(caught, "gives: # N")[0]
    assert np.linalg.norm(left) / 3 <= missing <= 1.01 * np.linalg.norm(left)  # in a basis of N of its own


def test_how_far_a_pose_is_from_closing(robot):
    """Pinocchio's own way: out of reach by 5 cm along y, the best it finds is open by some of it."""
    place = pin.SE3(np.eye(3), np.array([0.0, 0.30, -G.h]))
    target = FrameTarget("platform_center", place, (False, True, True, False, True, False))
    with pytest.raises(AssemblyError) as caught:
        robot.loop.assemble(target)
    assert told(caught, "leaves # m or rad")[0] == pytest.approx(caught.value.gap, rel=5e-3)
    assert 0.005 < caught.value.gap < 0.05


def test_what_sample_is_meant(robot):
    poses = np.zeros((7, 3))
    poses[[4, 6], 0] = 0.3
    with pytest.raises((ReachError, SampleError)) as caught:
        robot.forces(poses, HOME, HOME, method="virtual-power")
    assert told(caught, r"sample # ?,", r"first of # such", "such of #") == [4, 2, 7]
    assert caught.value.index == (4,)


def test_joints_of_a_run_that_starts_with_open_loops(robot, swing):
    q, v, _ = swing
    off = q.copy()
    off[2] += 1e-4
    with pytest.raises(InputError, match="the loops are open") as caught:
        robot.simulate(0.1, start=p3dof.runs.InitialState(joints=(off, v)), method="pinocchio")
    expected = np.abs(robot.loop.closure_error(off)).max()
    assert told(caught, "open by # m")[0] == pytest.approx(expected, rel=5e-3)
    faster = v.copy()
    faster[2] += 0.01
    with pytest.raises(InputError, match="opens the loops at") as caught:
        robot.simulate(0.1, start=p3dof.runs.InitialState(joints=(q, faster)), method="pinocchio")
    expected = np.abs(robot.loop.closure_jacobian(q) @ faster).max()
    assert told(caught, "loops at # m/s")[0] == pytest.approx(expected, rel=5e-3)


def test_limits_that_are_exceeded_are_told_with_value_and_time(robot):
    result = robot.inverse_dynamics(p3dof.paper_motion(101), method="virtual-power")
    tight = replace(PAPER.limits, speed=0.1, force=60.0)
    for exceedance in result.exceedances(tight):
        leg = "ABC".index(exceedance.leg)
        column = {"speed": result.slider_velocities, "force": result.forces}[exceedance.quantity][:, leg]
        worst = int(np.argmax(np.abs(column)))
        assert (exceedance.value, exceedance.time) == (column[worst], result.time[worst])
        assert exceedance.limit == np.copysign(getattr(tight, exceedance.quantity), column[worst])
