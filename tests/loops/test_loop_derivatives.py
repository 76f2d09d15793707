"""Exact derivatives of the dynamics of any robot, against differences along closed motions."""

from __future__ import annotations

from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closure_robots import MASSLESS, built_otherwise, common, universal_loop
from documents import ROOT
from loop_motions import biped, index_of, motion, moved, slope

import p3dof
from p3dof import ClosedLoopModel, Coupling, InputError, JointData, Sidecar
from p3dof._base.errors import DynamicsError, SingularityError

ACCURACY = 1e-7
"""Of derivatives, relative to the largest element."""


def gallery(name: str, seed: int = 1, step: float = 0.1) -> tuple[ClosedLoopModel, np.ndarray]:
    """A robot of the gallery near its reference, all joints moved."""
    loop = p3dof.load_robot(ROOT / f"docs/_static/gallery/{name}.urdf")
    q = loop.assemble().q
    N = np.linalg.svd(loop.closure_jacobian(q))[2][loop.rank(q) :].T
    return loop, moved(loop, q, step * N @ np.random.default_rng(seed).normal(size=N.shape[1]))


def agrees(given: np.ndarray, expected: np.ndarray, scale: float) -> None:
    np.testing.assert_allclose(given, expected, rtol=0, atol=ACCURACY * max(scale, 1e-12))


def largest(*blocks: np.ndarray) -> float:
    return max(float(np.nanmax(np.abs(block), initial=0.0)) for block in blocks)


def check_inverse(loop, q, coordinates=None, external=None, seed=0, h=1e-3):
    """Along two directions of coordinates, speeds and accelerations at once: forces, motion, multipliers."""
    index, generator = index_of(loop, loop.coordinates(q, coordinates)), np.random.default_rng(seed)
    n, nv, m = len(index), loop.model.nv, len(loop.actuated)
    state = np.concatenate((np.zeros(n), generator.normal(size=2 * n)))
    v, a = motion(loop, q, index, state[n : 2 * n], state[2 * n :])
    by = loop.inverse_dynamics_derivatives(q, v, a, coordinates, external)

    def value(q, v, a):
        found = loop.inverse_dynamics(q, v, a, external)
        return np.concatenate((found.tau, a, v, found.lambda_))

    for direction in generator.normal(size=(2, 3 * n)):
        d = np.split(direction, 3)
        expected = slope(loop, q, index, state, direction, value, h)
        for name, part in (("tau", expected[:m]), ("a", expected[m : m + nv])):
            blocks = [
                getattr(getattr(by, name), f"by_{x}") for x in ("coordinates", "speeds", "accelerations")
            ]
            agrees(sum(B @ x for B, x in zip(blocks, d, strict=True)), part, largest(*blocks))
        agrees(by.v_by_coordinates @ d[0] + by.motion @ d[1], expected[m + nv : m + 2 * nv], largest(part))
        blocks = [by.lambda_.by_coordinates, by.lambda_.by_speeds, by.lambda_.by_accelerations]
        unique = by.dynamics.unique
        assert np.array_equal(np.isnan(blocks[0]).any(axis=1), ~unique)
        found = sum(B @ x for B, x in zip(blocks, d, strict=True))[unique]
        agrees(found, expected[m + 2 * nv :][unique], largest(*blocks))
    return by


def check_forward(loop, q, coordinates=None, external=None, seed=0, h=1e-3):
    index, generator = index_of(loop, loop.coordinates(q, coordinates)), np.random.default_rng(seed)
    n, nv, m = len(index), loop.model.nv, len(loop.actuated)
    state = np.concatenate((np.zeros(n), generator.normal(size=2 * n)))
    tau, push = 5.0 * generator.normal(size=(2, m))
    v, _ = motion(loop, q, index, state[n : 2 * n], np.zeros(n))
    by = loop.forward_dynamics_derivatives(q, v, tau, coordinates, external)
    for direction in generator.normal(size=(2, 3 * n)):

        def value(q, v, _a):
            found = loop.forward_dynamics(q, v, tau, external)
            return np.concatenate((found.a, found.lambda_))

        expected = slope(loop, q, index, state, direction, value, h)
        y, speeds, _ = np.split(direction, 3)
        blocks = [by.a.by_coordinates, by.a.by_speeds, by.a.by_forces]
        agrees(blocks[0] @ y + blocks[1] @ speeds, expected[:nv], largest(*blocks))
        blocks = [by.accelerations.by_coordinates, by.accelerations.by_speeds]
        agrees(blocks[0] @ y + blocks[1] @ speeds, expected[:nv][index], largest(*blocks))
        agrees(
            by.Fx @ np.concatenate((y, speeds)),
            np.concatenate((speeds, expected[:nv][index])),
            largest(*blocks),
        )
        blocks = [by.lambda_.by_coordinates, by.lambda_.by_speeds]
        unique = ~np.isnan(blocks[0]).any(axis=1)
        agrees((blocks[0] @ y + blocks[1] @ speeds)[unique], expected[nv:][unique], largest(*blocks))
    pushed, rest = (
        loop.forward_dynamics(q, v, t, external) for t in (tau + push, tau)
    )  # linear in the forces
    agrees(by.a.by_forces @ push, pushed.a - rest.a, largest(pushed.a))
    felt = np.concatenate((np.zeros(n), (pushed.a - rest.a)[index]))
    agrees(by.Fu @ push, felt, largest(pushed.a))
    agrees(
        (by.lambda_.by_forces @ push)[unique],
        (pushed.lambda_ - rest.lambda_)[unique],
        largest(pushed.lambda_),
    )
    return by


def check_hybrid(loop, q, prescribed, frames=None, coordinates=None, external=None, seed=0, h=1e-3):
    index, generator = index_of(loop, loop.coordinates(q, coordinates)), np.random.default_rng(seed)
    n, nv, m = len(index), loop.model.nv, len(loop.actuated)
    state = np.concatenate((np.zeros(n), generator.normal(size=2 * n)))
    v, _ = motion(loop, q, index, state[n : 2 * n], np.zeros(n))
    by = loop.hybrid_dynamics_derivatives(q, v, prescribed, frames, coordinates, external)

    def value(q, v, _a):
        found = loop.hybrid_dynamics(q, v, prescribed, frames, external)
        return np.concatenate((found.tau, found.a, found.lambda_))

    direction = generator.normal(size=3 * n)
    expected = slope(loop, q, index, state, direction, value, h)
    y, speeds, _ = np.split(direction, 3)
    for name, part in zip(("tau", "a", "lambda_"), np.split(expected, [m, m + nv]), strict=True):
        blocks = getattr(by, name)
        found = blocks.by_coordinates @ y + blocks.by_speeds @ speeds
        known = ~np.isnan(found)
        agrees(found[known], part[known], largest(blocks.by_coordinates, blocks.by_speeds))
    return by, v


def test_the_stewart_platform_of_the_gallery_against_complete_and_inverse_dynamics():
    loop, q = gallery("stewart")
    load = {"platform": np.arange(1.0, 7.0)}
    generator = np.random.default_rng(3)
    lengths = q[[loop.model.idx_qs[loop.model.getJointId(name)] for name in loop.actuated]]
    speeds, accelerations = generator.normal(size=(2, 6))

    def forces(y, speeds, accelerations):
        state = loop.complete(y, speeds, accelerations, guess=q)
        return loop.inverse_dynamics(state.q, state.v, state.a, load).tau

    state = loop.complete(lengths, speeds, accelerations, guess=q)
    by = loop.inverse_dynamics_derivatives(state.q, state.v, state.a, external=load)
    assert by.coordinates == loop.actuated
    blocks = by.tau.by_coordinates, by.tau.by_speeds, by.tau.by_accelerations
    for block, scale in zip(blocks, np.eye(3), strict=True):
        expected = np.array(
            [
                robots.differences(
                    lambda t, d=d, s=scale: forces(
                        lengths + t * s[0] * d, speeds + t * s[1] * d, accelerations + t * s[2] * d
                    ),
                    h=1e-3,
                )[0]
                for d in np.eye(6)
            ]
        ).T
        agrees(block, expected, largest(expected))
    check_forward(loop, state.q, external=load)


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "delta", "gripper", "two_arms", "biped"])
def test_robots_of_the_gallery(name):
    loop, q = gallery(name, step=0.03)
    check_inverse(loop, q)
    check_forward(loop, q)


def test_a_leg_with_rods_that_spin_about_themselves():
    loop, q = gallery("leg", step=0.03)
    assert loop.mobility(q) > len(loop.actuated)
    check_forward(loop, q)
    check_hybrid(loop, q, np.arange(1.0, 7.0))
    with pytest.raises(DynamicsError, match="hybrid_dynamics"):
        loop.inverse_dynamics_derivatives(q, np.zeros(15), np.zeros(15))


@pytest.mark.parametrize("kind", MASSLESS)
def test_every_kind_of_closure(kind):
    loop, twin, q2 = built_otherwise(kind, 1)
    q = q2[common(twin.model)]
    load = {"two": np.arange(1.0, 7.0)}
    check_inverse(loop, q, external=load, h=3e-4)
    check_forward(loop, q, external=load, h=3e-4)
    check_forward(twin, q2, h=3e-4)  # a weld, or for the rod a ball; its massless joints are coordinates


@pytest.mark.parametrize("standing", [(), ("left",), ("left", "right")])
def test_a_floating_biped_with_its_feet_in_the_air_and_on_the_ground(standing):
    loop, q = biped(*standing)
    free = 6 * (3 - len(standing))
    assert loop.mobility(q) == free
    load = {"right_sole": np.array([5.0, -3.0, 20.0, 0.5, 0.2, -0.1])}
    names = check_forward(loop, q, external=load).coordinates
    assert len(names) == free
    if standing:
        by = check_inverse(loop, q, external=load)
        assert by.dynamics.tau_unique == (len(standing) == 1)
    else:
        assert set(loop.actuated) < set(names)
        wanted = np.random.default_rng(5).normal(size=12)
        by, v = check_hybrid(loop, q, wanted, external=load)
        push = np.random.default_rng(6).normal(size=12)  # forces are linear in what is prescribed
        more = loop.hybrid_dynamics(q, v, wanted + push, external=load)
        agrees(by.tau.by_prescribed @ push, more.tau - by.dynamics.tau, largest(more.tau))
        agrees(by.a.by_prescribed @ push, more.a - by.dynamics.a, largest(more.a))


def test_accelerations_of_frames_are_prescribed():
    loop, q = biped()
    wanted = {"left_sole": np.array([0.1, 0.2, np.nan, 0.4, 0.5, 0.6])}
    joints = {name: 0.3 for name in loop.actuated if not name.startswith("left")}
    check_hybrid(loop, q, {**joints, "left_knee": 0.1}, wanted)
    sidecar = replace(robots.FIVE_BAR_SIDECAR, actuated=("left_joint",))
    closed = ClosedLoopModel.from_urdf(robots.five_bar(), sidecar)
    upward = {"left_tip": [np.nan, np.nan, 1.0, np.nan, np.nan, np.nan]}
    check_hybrid(closed, robots.five_bar_q(2.0, 1.0), {}, upward)


def test_springs_and_dampers_count_and_friction_only_near_rest():
    lengths = robots.FOUR_BAR
    plain = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), robots.FOUR_BAR_SIDECAR)
    q = robots.four_bar_q(0.6, *lengths)
    data = (
        JointData("rocker_joint", 5.0, 0.2, 0.3),
        JointData("coupler_joint", 2.0, -0.2, 0.1),
        JointData("crank_joint", friction=0.7),
    )
    loop = ClosedLoopModel(plain.model, replace(plain.sidecar, joint_data=data))
    by, without = check_inverse(loop, q), check_inverse(plain, q)
    assert largest(by.tau.by_coordinates - without.tau.by_coordinates) > 1
    rough = ClosedLoopModel(plain.model, replace(plain.sidecar, joint_data=data[2:]))
    np.testing.assert_array_equal(  # 0.7 N m whatever the speed
        check_inverse(rough, q).tau.by_speeds, without.tau.by_speeds
    )
    rest = np.zeros(3)
    slow = rough.inverse_dynamics_derivatives(q, rest, rest).tau.by_speeds
    np.testing.assert_allclose(slow, 0.7 / 1e-3, rtol=1e-12)  # as steep as its smoothing


def test_couplings_that_bend():
    xml = robots.four_bar(*robots.FOUR_BAR)
    geared = ClosedLoopModel.from_urdf(
        xml,
        Sidecar(
            (),
            ("crank_joint",),
            (
                Coupling("rocker_joint", "crank_joint", (0.1, -0.5, 0.3, 0.2, -0.1)),
                Coupling("coupler_joint", "rocker_joint", (0.3, 0.1, -0.4), others=[("crank_joint", 0.7)]),
            ),
        ),
    )
    q = geared.assemble([0.7]).q
    check_inverse(geared, q)
    check_forward(geared, q)


def test_the_smallest_forces_of_redundant_motors_turn_with_the_mechanism():
    loop = ClosedLoopModel.from_urdf(
        robots.five_bar(),
        replace(robots.FIVE_BAR_SIDECAR, actuated=("left_joint", "right_joint", "right_elbow")),
    )
    by = check_inverse(loop, robots.five_bar_q(2.0, 1.0))
    assert not by.dynamics.tau_unique
    check_inverse(loop, robots.five_bar_q(2.0, 1.0), coordinates=["right_elbow", "left_elbow"])
    check_hybrid(loop, robots.five_bar_q(2.0, 1.0), {"left_joint": 0.4, "right_joint": -0.3})


def test_redundant_closures_do_no_harm():
    loop = ClosedLoopModel.from_urdf(robots.parallelogram(), robots.PARALLELOGRAM_SIDECAR)
    q = loop.assemble([0.7]).q
    assert loop.rank(q) < loop.closure_jacobian(q).shape[0]
    check_inverse(loop, q)
    check_forward(loop, q)


def test_a_robot_of_another_size_has_the_derivatives_of_its_scaled_twin():
    """Of a Stewart platform 1000 times as small: by lengths, times and forces alone."""
    s = 1e-3
    loop = ClosedLoopModel.from_urdf(robots.hexapod(), robots.HEXAPOD_SIDECAR)
    model = loop.model.copy()
    for i in range(model.njoints):
        model.jointPlacements[i] = pin.SE3(
            model.jointPlacements[i].rotation, s * model.jointPlacements[i].translation
        )
        body = model.inertias[i]
        model.inertias[i] = pin.Inertia(body.mass, s * body.lever, s**2 * body.inertia)
    for frame in model.frames:
        frame.placement = pin.SE3(frame.placement.rotation, s * frame.placement.translation)
    model.gravity.linear = s * model.gravity.linear
    small = ClosedLoopModel(model, loop.sidecar)
    assert small.unit_of_length != 1.0
    q = robots.hexapod_q(pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.05, 0.02, 0.6])), loop.model)
    factor_q, factor_v = np.ones(model.nq), np.ones(model.nv)
    for name in ("float", *loop.actuated):
        i = model.getJointId(name)
        count = min(3, model.nvs[i])
        factor_q[model.idx_qs[i] : model.idx_qs[i] + count] = s
        factor_v[model.idx_vs[i] : model.idx_vs[i] + count] = s
    index = index_of(loop, loop.actuated)
    v, a = motion(loop, q, index, *np.random.default_rng(4).normal(size=(2, 6)))
    load = np.arange(1.0, 7.0)
    by = loop.inverse_dynamics_derivatives(q, v, a, external={"platform": load})
    state = q * factor_q, v * factor_v, a * factor_v
    same = small.inverse_dynamics_derivatives(*state, external={"platform": load * s ** np.repeat([1, 2], 3)})
    for name in ("by_coordinates", "by_speeds", "by_accelerations"):  # N over m; s over s
        np.testing.assert_allclose(
            getattr(same.tau, name), getattr(by.tau, name), rtol=0, atol=1e-9 * largest(getattr(by.tau, name))
        )
    there = small.forward_dynamics_derivatives(*state[:2], s * by.dynamics.tau)
    here = loop.forward_dynamics_derivatives(q, v, by.dynamics.tau)
    np.testing.assert_allclose(
        s * there.accelerations.by_forces, s * here.accelerations.by_forces, rtol=1e-9, atol=1e-12
    )
    frames = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    units = s ** np.repeat([1, 0], 3)
    hybrid = loop.hybrid_dynamics_derivatives(q, v, frames={"platform": frames}).tau
    also = small.hybrid_dynamics_derivatives(*state[:2], frames={"platform": frames * units}).tau
    scale = largest(hybrid.by_coordinates)
    np.testing.assert_allclose(also.by_coordinates, hybrid.by_coordinates, rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(also.by_prescribed * units / s, hybrid.by_prescribed, rtol=1e-9, atol=1e-9)
    jacobian = loop.frame_jacobian("platform", q, v)
    also = small.frame_jacobian("platform", *state[:2])
    np.testing.assert_allclose(also.jacobian * s, jacobian.jacobian * units[:, None], rtol=0, atol=1e-12)
    np.testing.assert_allclose(also.drift, jacobian.drift * units, rtol=0, atol=1e-9)
    equations, also = small.minimal_dynamics(*state[:2]), loop.minimal_dynamics(q, v)
    np.testing.assert_allclose(equations.mass_matrix, also.mass_matrix, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(equations.coriolis_matrix, also.coriolis_matrix, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(equations.gravity_forces, s * also.gravity_forces, rtol=1e-9)


def test_what_has_no_derivative_is_refused():
    lengths = robots.FOUR_BAR
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), replace(robots.FOUR_BAR_SIDECAR, actuated=()))
    q = robots.four_bar_q(0.6, *lengths)
    rest = np.zeros(3)
    with pytest.raises(DynamicsError):
        loop.inverse_dynamics_derivatives(q, rest, rest)
    assert loop.forward_dynamics_derivatives(q, rest, []).accelerations.by_forces.shape == (1, 0)
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), robots.FOUR_BAR_SIDECAR)
    for names, error in (
        ("nobody", InputError),
        (["crank_joint", "crank_joint"], InputError),
        (["crank_joint", "rocker_joint"], InputError),
        ([], SingularityError),
        (3, InputError),
    ):
        with pytest.raises(error):
            loop.inverse_dynamics_derivatives(q, rest, rest, names)
    with pytest.raises(InputError, match="opens"):
        loop.forward_dynamics_derivatives(q, [0.0, 1e-3, 0.0], [0.0])


def test_joints_whose_axes_turn_in_their_bodies():
    loop, q = universal_loop()
    load = {"on_cross": np.arange(1.0, 7.0)}
    check_forward(loop, q, external=load, h=3e-4)
    by, _ = check_hybrid(loop, q, [1.0, 2.0, 3.0], external=load, h=3e-4)
    for i in range(1, loop.model.njoints):  # masses may change
        loop.model.inertias[i].mass *= 2.0
    loop.model.gravity.linear = np.array([1.0, 2.0, -3.0])
    heavy, _ = check_hybrid(loop, q, [1.0, 2.0, 3.0], external=load, h=3e-4)
    assert largest(heavy.tau.by_coordinates - by.tau.by_coordinates) > 1
    v = loop.minimal_dynamics(q).motion @ np.arange(1.0, 1.0 + loop.mobility(q))
    at = loop.minimal_dynamics(q, v)
    rate, _ = robots.differences(
        lambda t: loop.minimal_dynamics(moved(loop, q, t * v), None, at.coordinates).mass_matrix, h=3e-4
    )
    S = rate - 2.0 * at.coriolis_matrix
    agrees(S, -S.T, largest(rate))


def test_joints_that_are_no_chains_are_refused():
    odd = pin.Model()
    odd.addJoint(0, pin.JointModelEllipsoid(0.1, 0.2, 0.3), pin.SE3.Identity(), "odd")
    with pytest.raises(p3dof.ModelError, match="odd"):
        ClosedLoopModel(odd, Sidecar((), ())).minimal_dynamics(np.zeros(3))
