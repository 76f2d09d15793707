"""Motions of the motors, idle freedoms moving as they must: against closed equations and forward dynamics."""

from __future__ import annotations

import re

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from command_line import run
from scipy.integrate import solve_ivp

import p3dof
from p3dof._base.errors import DynamicsError, InputError
from p3dof.loops import ClosedLoopModel, JointData, Sidecar
from p3dof.runs import Integration, JointReference, find_equilibrium, follow_motion

MASS, LENGTH, CART, G = 0.8, 0.5, 2.0, 9.81


def crane(data=()):
    """A cart on a slide, a point mass hanging on it; the cart is driven. At q = 0 the mass is at its side."""
    text = robots.robot(
        robots.link("base"),
        robots.link("cart", robots.Solid(CART, (0, 0, 0), (0.1, 0, 0, 0.1, 0, 0.1))),
        robots.link("load", robots.Solid(MASS, (LENGTH, 0, 0), (0, 0, 0, 0, 0, 0))),
        robots.joint("drive", "base", "cart", axis=(1, 0, 0), kind="prismatic"),
        robots.joint("swing", "cart", "load"),
    )
    return ClosedLoopModel.from_urdf(text, Sidecar((), ("drive",), joint_data=data))


def smooth(end=0.3, duration=1.0, count=61):
    time = np.linspace(0, duration, count)
    s = time / duration
    return JointReference(time, (end * s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3))[:, None])


def test_a_crane_swings_by_its_equation():
    """x is prescribed; the angle follows l θ'' = ẍ sin θ + g cos θ, and the force is that of both masses."""
    loop, motion = crane(), smooth()
    found = follow_motion(loop, motion, samples=51, integration=Integration())

    def equation(t, y):
        x2 = motion.at(t)[2][0]
        return [y[1], (x2 * np.sin(y[0]) + G * np.cos(y[0])) / LENGTH]

    known = solve_ivp(equation, (0, 1), [0, 0], "DOP853", found.time, rtol=1e-12, atol=1e-13, max_step=0.01)
    np.testing.assert_allclose(found.q[:, 1], known.y[0], rtol=0, atol=1e-8)
    angle, speed = known.y
    x2 = motion.over(found.time)[2][:, 0]
    swing = np.array([equation(*pair)[1] for pair in zip(found.time, known.y.T, strict=True)])
    force = (CART + MASS) * x2 - MASS * LENGTH * (swing * np.sin(angle) + speed**2 * np.cos(angle))
    np.testing.assert_allclose(found.forces[:, 0], force, rtol=0, atol=1e-6)
    assert np.abs(found.error).max() < 1e-9
    pushed = follow_motion(loop, motion, samples=11, external={"cart": [2.0, 0, 0, 0, 0, 0]})
    np.testing.assert_allclose(pushed.forces[:, 0], force[::5] - 2.0, rtol=0, atol=1e-5)


def test_idle_freedoms_start_in_equilibrium_on_request():
    loop = crane()
    q = find_equilibrium(loop, [0.2])
    np.testing.assert_allclose(q, [0.2, np.pi / 2], rtol=0, atol=1e-9)
    still = JointReference([0.0, 0.5, 1.0], np.full((3, 1), 0.2))
    rest = follow_motion(loop, still, equilibrium=True, samples=5)
    np.testing.assert_allclose(rest.q, np.tile(q, (5, 1)), rtol=0, atol=1e-8)
    np.testing.assert_allclose(rest.forces, 0, atol=1e-7)
    small = crane().model.copy()
    small.jointPlacements[2].translation *= 1e-3
    small.inertias[2] = pin.Inertia(1e-9, np.array([1e-4, 0, 0]), np.zeros((3, 3)))
    swung = find_equilibrium(ClosedLoopModel(small, Sidecar((), ("drive",))), [0.0], [0.0, 0.1])
    assert swung[1] == pytest.approx(np.pi / 2, abs=1e-9)
    sprung = crane((JointData("swing", stiffness=6.0, rest=0.4),))
    angle = find_equilibrium(sprung, [0.0])[1]
    assert MASS * G * LENGTH * np.cos(angle) == pytest.approx(6.0 * (angle - 0.4), abs=1e-8)
    falling = pin.Model()
    falling.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "fall")
    falling.appendBodyToJoint(1, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    with pytest.raises(DynamicsError, match="of the passive degrees of freedom was found: at best"):
        find_equilibrium(ClosedLoopModel(falling, Sidecar((), ())), [])


def test_a_closed_loop_with_one_motor_missing_follows_and_its_forces_bring_the_motion_back():
    loop = ClosedLoopModel.from_urdf(
        robots.five_bar(), Sidecar(robots.FIVE_BAR_SIDECAR.closures, ("left_joint",))
    )
    motion = JointReference(np.linspace(0, 0.4, 9), 1.9 + 0.1 * np.linspace(0, 1, 9)[:, None] ** 4)
    found = follow_motion(loop, motion, robots.five_bar_q(1.9, 1.2), samples=21)
    assert found.gap.max() < 1e-8  # the tolerance of the integrator
    assert np.abs(found.error).max() < 1e-9
    assert np.ptp(found.q[:, 2]) > 0.1
    for i in (0, 7, 20):
        back = loop.forward_dynamics(found.q[i], found.v[i], found.forces[i]).a
        np.testing.assert_allclose(back, found.a[i], rtol=0, atol=1e-6)
    hanging = find_equilibrium(loop, [1.9], robots.five_bar_q(1.9, 1.2))
    assert np.abs(loop.hybrid_dynamics(hanging, np.zeros(4), [0.0]).a).max() < 1e-8
    assert loop.closure_gaps(hanging).max() < 1e-12


def test_motions_that_cannot_be_followed():
    loop = crane()
    for arguments, words in (
        ((loop, [0.1]), "motion: expected a JointReference, got"),
        ((loop, JointReference.standing([0.1])), "motion: expected at least two samples"),
        (
            (loop, JointReference([0, 1], np.zeros((2, 2)))),
            "reference: expected values of the 1 actuated joints",
        ),
    ):
        with pytest.raises(InputError, match=words):
            follow_motion(*arguments)
    with pytest.raises(InputError, match="integration: expected Integration"):
        follow_motion(loop, smooth(), integration=3)


def test_the_command_line_moves_what_is_idle(capsys, tmp_path):
    path = tmp_path / "crane.urdf"
    text = robots.robot(
        robots.link("base"),
        robots.link("cart", robots.Solid(CART, (0, 0, 0), (0.1, 0, 0, 0.1, 0, 0.1))),
        robots.link("load", robots.Solid(MASS, (LENGTH, 0, 0), (0, 0, 0, 0, 0, 0))),
        robots.joint("drive", "base", "cart", axis=(1, 0, 0), kind="prismatic"),
        robots.joint("swing", "cart", "load"),
    )
    path.write_text(text)
    path.with_suffix(".yaml").write_text(Sidecar((), ("drive",)).to_yaml())
    motion = smooth(count=21)
    rows = np.column_stack([motion.curve.time + 2.0, motion.curve.values])
    lines = "\n".join(f"{t!r},{x!r}" for t, x in rows.tolist())
    (tmp_path / "m.csv").write_text(f"t,drive\n{lines}\n")
    out_file = tmp_path / "f.csv"
    arguments = ("--motion", tmp_path / "m.csv", "--out", out_file)
    code, out, _ = run(capsys, "loop", "forces", path, *arguments)
    assert code == 0
    assert "Joints that no actuator holds move freely, from rest: swing." in out
    header, *_ = out_file.read_text().splitlines()
    found = dict(zip(header.split(","), np.loadtxt(out_file, delimiter=",", skiprows=1).T, strict=True))
    known = follow_motion(p3dof.load_robot(path), motion, samples=len(found["t [s]"]))
    np.testing.assert_allclose(found["t [s]"], known.time + 2.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["force drive [N]"], known.forces[:, 0], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found["swing [rad]"], np.unwrap(known.q[:, 1]), rtol=0, atol=1e-6)
    code, out, _ = run(
        capsys, "loop", "forces", path, *arguments, "--equilibrium", "--external", "cart=1,0,0,0,0,0"
    )
    assert code == 0
    force = np.loadtxt(out_file, delimiter=",", skiprows=1)[0, 1]
    assert force == pytest.approx(-1.0, abs=1e-6)


def test_a_motion_beyond_a_dead_centre_is_told_with_the_joint_that_runs_away():
    loop = ClosedLoopModel.from_urdf(robots.four_bar(0.5, 0.45, 0.3, 0.35), robots.FOUR_BAR_SIDECAR)
    angles = np.array([0.7, 0.75, 0.85, 1.0, 1.3, 1.7, 2.2, 2.7, 3.0])
    motion = JointReference(np.linspace(0, 1, 9), angles[:, None])
    found = follow_motion(loop, motion, samples=11)
    assert found.stop.kind == "accuracy"
    assert re.search(r"the joint '(coupler|rocker)_joint' moves the fastest, at ", found.stop.reason)
    assert 0.2 < found.stop.time < 1
