"""The short examples: each runs alone, and its main number is what another derivation of the machine says."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT, blocks
from lagrange import BODIES, LagrangeModel, lagrange_forces

import p3dof
from p3dof.runs import Measurement

PAGE = (ROOT / "docs/tutorials/examples.md").read_text(encoding="utf-8")
FIRST, *CELLS = (block.text for block in blocks(ROOT / "docs/tutorials/examples.md"))
HEADINGS = re.findall(r"^## (\d+)\. (.+)$", PAGE, re.MULTILINE)
PAPER = LagrangeModel(p3dof.PAPER)
LEG_C = "crossbar_upper", "crossbar_lower", "platform"


@cache
def ran(number):
    """Run the first lines and one example; return the names of the session."""
    plt = pytest.importorskip("matplotlib.pyplot")
    session: dict[str, object] = {}
    for text in (FIRST, CELLS[number - 1]):
        exec(compile(text, f"example {number}", "exec"), session)  # noqa: S102 - our own text
    plt.close("all")
    return SimpleNamespace(**session)


def of(motion):
    return motion.pose, motion.velocity, motion.acceleration


def close(found, expected, share=1e-11):
    """Assert that two arrays differ by less than a share of the largest number."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=share * np.abs(expected).max())


def in_a_loop(model, controller, duration, period=1e-3):
    """Return times and poses under sampled control, from rest at home, by Runge and Kutta."""

    def rate(x, forces):
        return np.concatenate([x[3:], model.accelerations(x[:3], x[3:], forces)])

    x, poses, count = np.zeros(6), [np.zeros(3)], round(duration / period)
    for k in range(count):
        sliders, speeds = model.sliders(x[:3]), model.slider_velocities(x[:3], x[3:])
        measured = Measurement(
            k * period, period, sliders, speeds, np.zeros(3, dtype=bool), model.parameters.geometry
        )
        forces = np.asarray(controller(measured))
        one = rate(x, forces)
        two = rate(x + period / 2 * one, forces)
        three = rate(x + period / 2 * two, forces)
        x = x + period / 6 * (one + 2 * two + 2 * three + rate(x + period * three, forces))
        poses.append(x[:3])
    return np.arange(count + 1) * period, np.array(poses)


def test_each_example_is_short_and_points_to_a_guide_and_to_the_reference():
    assert [int(number) for number, _ in HEADINGS] == list(range(1, len(CELLS) + 1))
    assert len(CELLS) == 17
    assert "Seventeen jobs" in PAGE
    for part, cell in zip(re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:], CELLS, strict=True):
        lines = cell.splitlines()
        assert len(lines) <= 12, part
        assert max(map(len, lines)) <= 100, part
        assert re.search(r"^How to: \[.*\]\(\.\./how-to/", part, re.MULTILINE), part
        assert re.search(r"Reference:\s+\[`\w+[\w.]*`\]\(#p3dof\.", part), part
        assert "alt: " in part or "describe()" in cell, part


def test_names_of_the_reference_are_there():
    names = re.findall(r"\]\(#(p3dof\.[\w.]+)\)", PAGE)
    assert len(names) > 25
    for name in names:
        found = p3dof
        for part in name.split(".")[1:]:
            found = getattr(found, part)


def test_1_the_forces_are_those_of_lagrange():
    seen = ran(1)
    close(seen.result.forces, PAPER.forces(*of(seen.motion)))
    close(seen.result.peak_forces, np.abs(PAPER.forces(*of(seen.motion))).max(axis=0))


def test_2_both_ways_have_the_forces_of_a_third_one():
    seen = ran(2)
    for one in (seen.found.first, seen.found.second):
        close(one.forces, PAPER.forces(*of(seen.motion)))
    assert seen.difference.max() < 1e-12
    assert "the methods agree" in seen.found.verdict


def test_3_the_payload_adds_its_own_newton_and_euler():
    """As a wrench on the empty platform: its weight and inertia, where the platform turns about y alone."""
    seen = ran(3)
    pose, velocity, acceleration = of(seen.motion)
    mass, drop, about = 2.0, 0.05, 0.004  # kg, m, kg m² about y
    s, c = np.sin(pose[:, 2]), np.cos(pose[:, 2])
    w, alpha, zero = velocity[:, 2], acceleration[:, 2], 0 * s
    arm = drop * np.stack([-s, zero, -c], axis=-1)  # turned about y
    bent = drop * np.stack([-c * alpha + s * w**2, zero, s * alpha + c * w**2], axis=-1)
    force = mass * (
        np.array([0, 0, -9.806]) - bent - np.stack([zero, acceleration[:, 0], acceleration[:, 1]], axis=-1)
    )
    moment = np.cross(arm, force) - np.stack([zero, about * alpha, zero], axis=-1)
    expected = PAPER.forces(pose, velocity, acceleration, np.hstack([force, moment]))
    close(seen.loaded.forces, expected)
    close(seen.empty.forces, PAPER.forces(pose, velocity, acceleration))


def test_4_a_part_is_carried_from_pick_to_place():
    seen = ran(4)
    plan, motion = seen.carried.plan, seen.carried.plan.motion
    held = lagrange_forces(p3dof.PAPER.carrying(seen.part), *of(motion))
    free = PAPER.forces(*of(motion))
    assert [piece.payload is None for piece in plan.pieces].count(False) > 0
    close(seen.carried.peak_forces, np.abs(held).max(axis=0))
    assert not np.allclose(np.abs(held).max(axis=0), np.abs(free).max(axis=0), rtol=0.05)
    np.testing.assert_allclose(motion.pose[[0, -1]], [[-0.15, 0, -0.26], [0.15, 0, 0.26]], atol=1e-12)
    assert np.abs(motion.pose[:, :2] - [0, 0.05]).sum(axis=1).min() < 0.02  # it passes, on a blend


def test_5_within_its_limits_nothing_is_to_spare():
    seen = ran(5)
    motion = seen.fastest.motion
    forces = PAPER.forces(*of(motion))
    speeds = PAPER.slider_velocities(motion.pose, motion.velocity)
    used = np.stack([np.abs(forces) / 300, np.abs(speeds) / 2, forces * speeds / 150]).max(axis=(0, 2))
    assert used.max() < 1 + 1e-3
    assert np.mean(used > 0.98) > 0.9
    np.testing.assert_allclose(motion.pose[[0, -1]], [[-0.1, 0, -0.2], [0.1, 0, 0.2]], atol=1e-9)
    assert seen.fastest.duration == pytest.approx(motion.time[-1], rel=1e-12)


def test_6_a_longer_lead_turns_the_screw_less():
    seen = ran(6)
    speed = np.abs(PAPER.slider_velocities(seen.motion.pose, seen.motion.velocity)).max()
    leads = [sizing.drives[0].transmission.lead for sizing in seen.sizings]
    assert leads == [0.02, 0.01, 0.005]
    for lead, sizing in zip(leads, seen.sizings, strict=True):
        most = sizing.worst[1]
        share = most.required / most.allowed
        assert most.name == "DN"
        nominal = 1.25 * 12.7  # mm, taken of a screw with a core diameter alone
        assert most.required == pytest.approx(nominal * 60 * speed / lead, rel=1e-9)  # mm rpm
        assert most.share == pytest.approx(share, rel=1e-12)
        assert sizing.fits == (most.share <= 1)


def test_7_the_volume_is_that_of_poses_that_are_counted():
    """Each (y, θ) of a grid has the height that travel leaves; at both ends in y half a cell is open."""
    seen = ran(7)
    limits = p3dof.PAPER.limits
    low, high = limits.travel
    (y, dy), (theta, dt) = (
        ((np.arange(n) + 0.5) * (b - a) / n + a, (b - a) / n)
        for a, b, n in ((-0.3, 0.3, 600), (*limits.tilt, 240))
    )
    grid = np.stack(np.meshgrid(y, theta, indexing="ij"), axis=-1)
    poses = np.insert(grid, 1, 0.0, axis=-1)
    sliders = PAPER.sliders(poses)
    height = (high - low) - np.ptp(sliders, axis=-1)
    height = np.where(np.isfinite(height) & (height > 0), height, 0)
    ends = [column[np.flatnonzero(column)[[0, -1]]].sum() for column in height.T]  # where a leg is horizontal
    assert abs(seen.space.volume - height.sum() * dy * dt) < np.sum(ends) * dy * dt / 2
    box = seen.space.largest_box()
    ends = np.array([(a, 0, b) for a in box.y for b in np.linspace(*box.theta, 9)])
    least, most = PAPER.sliders(ends).min(), PAPER.sliders(ends).max()
    assert box.height <= (high - low) - (most - least) + 1e-9
    sides = np.ptp(box.y) * np.ptp(box.theta) * box.height
    assert box.volume == pytest.approx(sides, rel=1e-12)


def test_8_a_singularity_is_where_the_bars_of_leg_c_point_at_the_platforms_axis():
    seen = ran(8)
    for found, poses in ((seen.along, seen.motion.pose), (seen.turned, seen.turned.pose)):
        origins = PAPER.origins(poses)
        top, joint, axis = (origins[:, BODIES.index(name)] for name in LEG_C)
        bar, arm = (joint - top)[:, ::2], (axis - joint)[:, ::2]  # in the plane of x and z
        angle = np.arctan2(bar[:, 0] * -arm[:, 1] + bar[:, 1] * arm[:, 0], np.sum(bar * arm, axis=1))
        np.testing.assert_allclose(found.actuation, np.abs(angle), rtol=0, atol=1e-9)
    still = np.zeros(3)
    close(seen.turned.holding, PAPER.forces(seen.turned.pose, still, still), 1e-10)
    assert seen.turned.actuation.min() < np.radians(2)


def test_9_errors_are_those_of_lagranges_machine_in_a_loop_of_its_own():
    seen = ran(9)
    for name, run in seen.followed.items():
        poses = in_a_loop(PAPER, seen.ways[name], seen.wanted.duration)
        at = np.searchsorted(poses[0], run.time + 1e-9) - 1
        here = np.isclose(poses[0][at], run.time, rtol=0, atol=1e-9)
        assert here.sum() > 50
        np.testing.assert_allclose(run.pose[here], poses[1][at][here], rtol=0, atol=1e-8)
        share = run.time / 0.3
        wanted = np.outer(share**3 * (10 - 15 * share + 6 * share**2), [0.05, 0.05, 0.3])
        np.testing.assert_allclose(np.abs(run.error), np.abs(run.pose - wanted), rtol=0, atol=1e-7)


def test_10_a_machine_of_many_does_what_it_does_alone():
    seen = ran(10)
    assert seen.many.counts() == {"finished": 200}
    worst = int(seen.many.peak_error[:, 1].argmax())
    geometry = replace(p3dof.PAPER.geometry, L=seen.built["L"][worst])
    plate = replace(p3dof.PAPER.bodies.platform, mass=seen.built["platform.mass"][worst])
    bodies = replace(p3dof.PAPER.bodies, platform=plate)
    machine = LagrangeModel(replace(p3dof.PAPER, geometry=geometry, bodies=bodies))
    time, poses = in_a_loop(machine, seen.follow["controller"], 0.3)
    wanted = np.array([seen.follow["controller"].reference.at(t)[0] for t in time])
    np.testing.assert_allclose(np.abs(poses - wanted).max(axis=0), seen.many.peak_error[worst], rtol=1e-3)


def test_11_the_legs_do_the_virtual_work_of_all_bodies():
    seen = ran(11)
    robot, model = seen.stewart, seen.stewart.model
    data, joint = model.createData(), model.getJointId("platform_free")
    for k in range(0, 101, 20):
        q, v, a = (getattr(seen.states, name)[k] for name in "qva")
        pin.framesForwardKinematics(model, data, q)
        expected = [0.06 * np.cos(seen.w * seen.time[k]), 0.06 * np.sin(seen.w * seen.time[k]), 0.52]
        np.testing.assert_allclose(data.oMi[joint].translation, expected, atol=1e-9)
        inward = -(seen.w**2) * np.array(expected[:2])
        np.testing.assert_allclose(a[model.idx_vs[joint] :][:2], inward, atol=1e-8)
        place = p3dof.FrameTarget("platform", data.oMi[joint])
        moved = np.array([robot.complete(place, unit, np.zeros(6), guess=q).v for unit in np.eye(6)])
        legs = np.linalg.solve(moved[:, robot.actuated_v], moved @ pin.rnea(model, data, q, v, a))
        close(seen.legs[k], legs, 1e-9)


def test_12_the_torque_is_the_rate_of_the_energy():
    seen = ran(12)
    model = seen.four_bar.model
    data, count = model.createData(), len(seen.turn.q) - 1  # of one period
    energy = [
        pin.computeMechanicalEnergy(model, data, pin.integrate(model, pin.neutral(model), q), v)
        for q, v in zip(seen.turn.q[:-1], seen.turn.v[:-1], strict=True)
    ]
    waves = 1j * np.fft.fftfreq(count, 1 / count)
    slope = np.fft.ifft(waves * np.fft.fft(energy)).real  # by the angle of the crank, in one turn
    close(seen.torque[:-1], slope, 1e-9)


def test_13_the_ankle_does_the_work_of_its_motors():
    seen = ran(13)
    h = 1e-5

    def rates(at):  # of the motors by the joints, each a row
        moved = [[seen.ankle.joint_to_actuator(at + d).position for d in (h * e, -h * e)] for e in np.eye(2)]
        return np.array([(ahead - behind) / (2 * h) for ahead, behind in moved])

    np.testing.assert_allclose(seen.motors.velocity, rates(np.array([-0.3, 0.1]))[0], rtol=1e-7)
    motors = np.linalg.solve(rates(np.array([seen.pitch, 0.0])), seen.corners.T).T
    np.testing.assert_allclose(np.abs(motors), 60, rtol=1e-7)  # N m, of the URDF
    assert len({tuple(signs) for signs in np.sign(motors)}) == 4


def test_14_friction_that_was_put_in_is_found():
    seen = ran(14)
    place = int(np.flatnonzero(seen.friction)[0])
    found, deviation = seen.identified.parameters[place], seen.identified.deviations[place]
    assert abs(found - 0.5) < 3 * deviation < 0.05


def test_15_each_design_of_the_front_is_the_best_of_its_width():
    seen = ran(15)
    motion = p3dof.paper_motion(51)

    def peak(R, L):
        machine = replace(p3dof.PAPER, geometry=replace(p3dof.PAPER.geometry, R=R, L=L))
        return np.abs(lagrange_forces(machine, *of(motion))).max()

    assert len(seen.front.objectives) == 7
    for (R, L), (force, width) in zip(seen.front.designs, seen.front.objectives, strict=True):
        assert width == pytest.approx(2 * R, rel=1e-12)
        assert force == pytest.approx(peak(R, L), rel=1e-10)
        assert all(force <= peak(R, other) * (1 + 1e-9) for other in np.linspace(0.35, 0.5, 16))


def test_16_the_frame_has_the_forces_and_the_power():
    seen = ran(16)
    forces = PAPER.forces(*of(seen.motion))
    close(seen.frame[["fA [N]", "fB [N]", "fC [N]"]].to_numpy(), forces)
    speeds = PAPER.slider_velocities(seen.motion.pose, seen.motion.velocity)
    close(seen.frame["power [W]"].to_numpy(), np.sum(forces * speeds, axis=1))


def test_17_the_urdf_has_the_platform_where_the_motion_has_it():
    pytest.importorskip("yourdfpy", reason="yourdfpy is not installed")
    seen = ran(17)
    home = np.sqrt(0.4**2 - (0.25 - 0.1) ** 2)
    np.testing.assert_allclose(seen.places, seen.motion.pose[:, :2] - [0, home], rtol=0, atol=1e-9)
