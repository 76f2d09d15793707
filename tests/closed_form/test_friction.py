"""Friction and payload: both routes against the power of relative rates, and clouds of point masses."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from lagrange import LagrangeModel, cloud_body, friction_forces, random_cloud
from machines import SEEDS, random_friction, random_machine, random_states

import p3dof
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters import PAPER, PASSIVE, SLIDES, Body, Friction
from p3dof.machine.parameters.machine import dump, parse


@given(seed=SEEDS)
@settings(max_examples=8, deadline=None)
def test_forces_are_those_without_friction_and_the_resistances(seed):
    smooth = random_machine(seed)
    rough = replace(smooth, friction=random_friction(np.random.default_rng(seed)))
    states = random_states(smooth, seed, 3)
    given_ = (states.pose, states.velocity, states.acceleration)
    expected = p3dof.load(smooth).forces(*given_, method="virtual-power", wrench=states.wrench)
    for i, (pose, velocity) in enumerate(zip(states.pose, states.velocity, strict=True)):
        resisting, _ = friction_forces(rough, pose, velocity)
        expected[i] += np.linalg.solve(LagrangeModel(smooth).jacobian(pose).T, resisting)
    scale = np.abs(expected).max()
    for method in ("virtual-power", "pinocchio"):
        found = p3dof.load(rough).forces(*given_, method=method, wrench=states.wrench)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * scale)


@pytest.mark.parametrize(("away", "bound"), [({"drop": 0.2, "angle": 0.1}, 1e-10), ({}, 1e-9)])
@given(seed=SEEDS)
@settings(max_examples=12, deadline=None)
def test_forward_dynamics_is_the_inverse_both_ways(away, bound, seed):
    """Nearer the singular poses the forces grow, and with them what rounding leaves."""
    machine = replace(random_machine(seed), friction=random_friction(np.random.default_rng(seed)))
    robot, states = p3dof.load(machine), random_states(machine, seed, 3, **away)
    forces = robot.forces(
        states.pose, states.velocity, states.acceleration, method="virtual-power", wrench=states.wrench
    )
    scale = np.abs(states.acceleration).max()
    for method in ("virtual-power", "pinocchio"):
        found = robot.forward_dynamics(
            states.pose, states.velocity, forces, method=method, wrench=states.wrench
        )
        np.testing.assert_allclose(found, states.acceleration, rtol=0, atol=bound * scale)


@pytest.mark.parametrize("method", ["pinocchio", "virtual-power"])
def test_the_power_is_balanced_with_friction_payload_and_wrench(method):
    friction = Friction({"sliders": 20, "joints": 0.3}, {"sliders": 5, "joints": 0.2, "universal_a": 0.7})
    payload = Body(5.0, [0.02, 0.03, -0.1], [0.02, 0.03, 0.04])
    robot = p3dof.load(replace(PAPER, friction=friction).carrying(payload))
    motion = p3dof.paper_motion(101)
    result = robot.inverse_dynamics(motion, method=method, wrench=[3, 20, -10, 1, 2, 3])
    assert np.abs(result.power_residual).max() < 1e-12 * np.abs(result.power).max()
    expected = [friction_forces(robot.parameters, *row)[1] for row in zip(motion.pose, motion.velocity)]  # noqa: B905
    np.testing.assert_allclose(result.dissipation, expected, rtol=1e-10, atol=1e-10)
    assert result.dissipation.max() > 50
    assert result.dissipation.min() >= 0
    free = p3dof.load().inverse_dynamics(motion, method=method)
    assert np.all(free.dissipation == 0)


def test_both_routes_agree_over_the_papers_motion():
    robot = p3dof.load(replace(PAPER, friction=Friction({"joints": 0.1}, {"sliders": 10, "joints": 0.3})))
    motion = p3dof.paper_motion(201)
    first, second = (
        robot.inverse_dynamics(motion, method=method) for method in ("pinocchio", "virtual-power")
    )
    assert np.abs(first.forces - second.forces).max() < 1e-10 * first.peak_forces.max()
    np.testing.assert_allclose(first.dissipation, second.dissipation, rtol=1e-10, atol=1e-11)


def test_at_rest_nothing_resists():
    rough = replace(PAPER, friction=Friction({"sliders": 20}, {"sliders": 5, "joints": 1}))
    for method in ("pinocchio", "virtual-power"):
        held = p3dof.load(rough).forces([0.01, 0.02, 0.1], np.zeros(3), np.zeros(3), method=method)
        free = p3dof.load().forces([0.01, 0.02, 0.1], np.zeros(3), np.zeros(3), method=method)
        np.testing.assert_allclose(held, free, rtol=1e-14)


def test_an_invalid_sample_loses_nan():
    robot = p3dof.load(replace(PAPER, friction=Friction({"sliders": 20})))
    pose = np.zeros((4, 3))
    pose[2, 0] = 1.0
    motion = p3dof.Motion(np.arange(4.0), pose, np.ones((4, 3)), np.zeros((4, 3)), check=False)
    for method in ("pinocchio", "virtual-power"):
        found = robot.inverse_dynamics(motion, method=method, on_invalid="nan").dissipation
        assert np.isnan(found).tolist() == [False, False, True, False]


def test_groups_and_overrides():
    friction = Friction({"hinge_c": 3, "joints": 1, "slide_a": 0}, {"sliders": 2})
    assert friction.viscous == {name: 3.0 if name == "hinge_c" else 1.0 for name in PASSIVE}
    assert friction.coulomb == dict.fromkeys(SLIDES, 2.0)
    assert set(friction.joints) == {*SLIDES, *PASSIVE}
    assert friction
    assert not Friction()
    assert not Friction({"joints": 0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"viscous": {"hinge": 1}},
            "viscous: unknown joint 'hinge', expected one of sliders, joints, slide_a",
        ),
        ({"coulomb": {"slide_a": -1}}, "coulomb.slide_a: expected zero or more, got -1"),
        ({"coulomb": {"slide_a": np.nan}}, "coulomb.slide_a: expected a finite number"),
        ({"viscous": {"slide_a": "much"}}, "viscous.slide_a: expected real numbers, got 'much'"),
        ({"viscous": {3: 1.0}}, "viscous: unknown joint 3"),
        ({"viscous": 3}, "viscous: expected numbers by joint, got 3"),
        ({"smoothing": 0}, "smoothing: expected a positive number, got 0"),
    ],
)
def test_friction_refuses(arguments, message):
    with pytest.raises(ParameterError, match=message):
        Friction(**arguments)


def test_friction_is_frozen_and_copies():
    friction = Friction({"joints": 1}, {"slide_a": 2}, 0.01)
    with pytest.raises(TypeError):
        friction.viscous["hinge_a"] = 2
    for other in (copy.deepcopy(friction), pickle.loads(pickle.dumps(friction))):  # noqa: S301
        assert other.to_dict() == friction.to_dict()
    with pytest.raises(ParameterError, match="friction: expected Friction, got float"):
        replace(PAPER, friction=1.0)
    assert pickle.loads(pickle.dumps(PAPER)).friction.to_dict() == PAPER.friction.to_dict()  # noqa: S301


def test_files_hold_friction_and_payload():
    friction = Friction({"sliders": 20, "hinge_c": 0.1}, {"joints": 0.3}, 0.002)
    text = dump(replace(PAPER, friction=friction))
    assert parse(text).friction.to_dict() == friction.to_dict()
    assert "friction" not in dump(PAPER)
    text = dump(PAPER) + (
        "friction: {viscous: {sliders: 2e1}, smoothing: 0.01}\n"
        "payload: {mass: 5, com: [0, 0, -0.1], inertia: [0.02, 0.02, 0.02]}\n"
    )
    machine = parse(text)
    assert machine.friction.viscous == dict.fromkeys(SLIDES, 20.0)
    assert machine.bodies.platform.mass == PAPER.bodies.platform.mass + 5
    for bad, message in (
        ("friction: {viscous: {knee: 1}}", "file: friction: viscous: unknown joint 'knee'"),
        ("friction: 3", "file: friction: expected the fields viscous, coulomb, smoothing, got 3"),
        ("payload: {com: [0, 0, 0]}", "file: payload: the field 'mass' is missing"),
        (
            "payload: {mass: -5, com: [0, 0, 0], inertia: [0, 0, 0]}",
            "file: payload: mass: expected zero or more",
        ),
    ):
        with pytest.raises(ParameterError, match=message):
            parse(dump(PAPER) + bad, "file")


@given(seed=SEEDS)
@settings(max_examples=12, deadline=None)
def test_joined_clouds_are_one_cloud(seed):
    rng = np.random.default_rng(seed)
    (m1, p1), (m2, p2) = random_cloud(rng), random_cloud(rng)
    joined = cloud_body(m1, p1).joined(cloud_body(m2, p2))
    whole = cloud_body(np.concatenate([m1, m2]), np.concatenate([p1, p2]))
    assert joined.mass == pytest.approx(whole.mass, rel=1e-14)
    np.testing.assert_allclose(joined.com, whole.com, rtol=0, atol=1e-14)
    np.testing.assert_allclose(joined.inertia, whole.inertia, rtol=0, atol=1e-14)


def test_a_payload_takes_what_moving_it_alone_takes():
    """Newton and Euler for the payload alone, its wrench at P, against the difference of the forces."""
    payload = Body(7.0, [0.05, -0.02, 0.1], [[0.03, 0.01, 0.0], [0.01, 0.04, 0.005], [0.0, 0.005, 0.05]])
    motion = p3dof.paper_motion(51)
    more = p3dof.load(PAPER.carrying(payload)).inverse_dynamics(motion, method="virtual-power").forces
    less = p3dof.load().inverse_dynamics(motion, method="virtual-power").forces
    robot = p3dof.load()
    platform = robot.mechanism_motion(motion.pose, motion.velocity, motion.acceleration).bodies["platform"]
    center, _, acceleration = platform.at(payload.com)
    force = payload.mass * (acceleration - PAPER.gravity)
    inertia = platform.rotation @ payload.inertia @ np.swapaxes(platform.rotation, -1, -2)
    spin = np.einsum("nij,nj->ni", inertia, platform.omega)
    moment = np.einsum("nij,nj->ni", inertia, platform.epsilon) + np.cross(platform.omega, spin)
    moment += np.cross(center - platform.origin, force)
    wrench = np.concatenate([-force, -moment], axis=-1)
    loaded = robot.inverse_dynamics(motion, method="virtual-power", wrench=wrench).forces
    np.testing.assert_allclose(more, loaded, rtol=0, atol=1e-12 * np.abs(more).max())
    assert np.abs(more - less).max() > 30


def test_carrying_nothing_changes_nothing_and_only_bodies_are_carried():
    platform = PAPER.carrying(Body.massless()).bodies.platform
    assert platform.mass == PAPER.bodies.platform.mass
    np.testing.assert_allclose(platform.inertia, PAPER.bodies.platform.inertia, rtol=0, atol=1e-16)
    assert Body.massless().joined(Body.massless()).mass == 0
    with pytest.raises(ParameterError, match="payload: expected a Body or a mass, got a list"):
        PAPER.carrying([5])


def test_what_is_carried_stays_known(tmp_path):
    loads = [Body(5.0, [0, 0, -0.1], np.full(3, 0.02)), Body(2.0, [0.1, 0.03, 0], np.zeros(3))]
    machine = PAPER
    assert machine.payloads == ()
    assert machine.unladen is machine
    for load in loads:
        machine = machine.carrying(load)
    assert list(machine.payloads) == loads
    assert machine.unladen.bodies.platform is PAPER.bodies.platform
    assert machine.carrying(Body.massless()).payloads == machine.payloads
    for laden in (machine, PAPER.carrying(loads[0])):
        p3dof.write_parameters(laden, tmp_path / "m.yaml")
        again = p3dof.read_parameters(tmp_path / "m.yaml")
        assert [body.to_dict() for body in again.payloads] == [body.to_dict() for body in laden.payloads]
        for (name, one), (_, other) in zip(again.bodies.items(), laden.bodies.items(), strict=True):
            assert one.to_dict() == other.to_dict(), name  # to the last bit
        assert again.unladen.bodies.platform.to_dict() == PAPER.bodies.platform.to_dict()
    copy = pickle.loads(pickle.dumps(machine))  # noqa: S301
    assert [body.mass for body in copy.payloads] == [5, 2]
    # Another platform is empty again; other changes keep the load.
    emptied = replace(machine, bodies=replace(machine.bodies, platform=PAPER.bodies.platform))
    assert emptied.payloads == ()
    assert len(replace(machine, gravity=np.zeros(3)).payloads) == 2


def test_a_scaled_machine_takes_scaled_forces():
    heavy = replace(PAPER, bodies=PAPER.bodies.scaled(1.1))
    motion = p3dof.paper_motion(11)
    found, expected = (p3dof.load(machine).inverse_dynamics(motion).forces for machine in (heavy, PAPER))
    np.testing.assert_allclose(found, 1.1 * expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    with pytest.raises(ParameterError, match="factor: expected a positive number, got 0"):
        PAPER.bodies.scaled(0)
