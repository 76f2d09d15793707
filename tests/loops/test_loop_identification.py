"""Regressors and base parameters of any robot."""

from __future__ import annotations

from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closure_robots import universal_loop
from loop_motions import ROBOTS, biped, five_bar, index_of, motion, stewart

import p3dof
from p3dof import ClosedLoopModel, InputError, JointData, Sidecar
from p3dof.loops.linear import Decomposition
from p3dof.loops.regressor import MOMENTS


def moving(loop: ClosedLoopModel, q: np.ndarray, seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    index = index_of(loop, loop.coordinates(q))
    return motion(loop, q, index, *np.random.default_rng(seed).normal(size=(2, len(index))))


@pytest.mark.parametrize("name", ROBOTS)
def test_the_regressor_times_the_parameters_is_what_the_motion_takes(name):
    loop, q = ROBOTS[name]()
    v, a = moving(loop, q)
    frame = str(loop.model.frames[loop.model.nframes - 1].name)
    found = loop.force_regressor(q, v, a, external={frame: np.arange(1.0, 7.0)})
    at = loop.minimal_dynamics(q, v, external={frame: np.arange(1.0, 7.0)})
    accelerations = a[index_of(loop, at.coordinates)]
    left = at.mass_matrix @ accelerations + at.coriolis_matrix @ at.speeds + at.gravity_forces
    expected = left - at.passive_forces
    scale = 1e-10 * max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(found.generalised @ found.parameters, expected, rtol=0, atol=scale)
    np.testing.assert_array_equal(found.generalised_external, at.external_forces)
    assert found.coordinates == at.coordinates
    if len(loop.actuated) >= len(at.coordinates):
        tau = loop.inverse_dynamics(q, v, a, {frame: np.arange(1.0, 7.0)}).tau
        np.testing.assert_allclose(found.forces @ found.parameters + found.external, tau, rtol=0, atol=scale)


def test_every_parameter_of_a_body_and_of_a_joint_has_its_column():
    """Against the forces of models in which one parameter is another one."""
    plain, q = five_bar()
    data = (JointData("left_elbow", 3.0, 0.1, 0.4, 0.2), JointData("right_joint", damping=0.2, friction=0.3))
    loop = ClosedLoopModel(plain.model.copy(), replace(plain.sidecar, joint_data=data))
    loop.model.armature = np.array([0.5, 0.0, 0.7, 0.1])
    v, a = moving(loop, q)
    found = loop.force_regressor(q, v, a)
    tau = loop.inverse_dynamics(q, v, a).tau
    np.testing.assert_allclose(found.forces @ found.parameters, tau, rtol=1e-10)
    joints = [str(name) for name in loop.model.names[1:]]
    assert found.parameter_names[:40:10] == ("left_near.m", "left_far.m", "right_near.m", "right_far.m")
    for k, name in enumerate(found.parameter_names):
        owner, what = name.rsplit(".", 1)
        model, given = loop.model.copy(), {entry.joint: entry for entry in data}
        if what in MOMENTS:
            body = model.frames[model.getFrameId(owner)].parentJoint
            values = model.inertias[body].toDynamicParameters()
            values[MOMENTS.index(what)] += 0.01
            model.inertias[body] = pin.Inertia.FromDynamicParameters(values)
        elif what == "armature":
            model.armature = model.armature + 0.01 * np.eye(4)[joints.index(owner)]
        elif what != "preload":
            entry = given.get(owner, JointData(owner))
            given[owner] = replace(entry, **{what: getattr(entry, what) + 0.01})
        other = ClosedLoopModel(model, replace(loop.sidecar, joint_data=tuple(given.values())))
        force = -0.01 * np.eye(4)[joints.index(owner)] if what == "preload" else np.zeros(4)
        change = other.inverse_dynamics(q, v, a, joint_forces=force).tau - tau
        np.testing.assert_allclose(found.forces[:, k], change / 0.01, rtol=0, atol=1e-9, err_msg=name)
    np.testing.assert_array_equal(found.inertial, found.forces[:, :40])


def test_springs_of_joints_that_turn_without_end_turn_back_by_the_shorter_way():
    lengths = robots.FOUR_BAR
    plain = ClosedLoopModel.from_urdf(robots.four_bar(*lengths, kind="continuous"), robots.FOUR_BAR_SIDECAR)
    data = (JointData("crank_joint", 2.0, 3.0), JointData("rocker_joint", 1.0, -0.5))
    loop = ClosedLoopModel(plain.model, replace(plain.sidecar, joint_data=data))
    reach = robots.four_bar_q(-2.5, *lengths)
    state = loop.complete([-2.5], [1.0], [2.0], guess=np.ravel([(np.cos(x), np.sin(x)) for x in reach]))
    found = loop.force_regressor(state.q, state.v, state.a)
    tau = loop.inverse_dynamics(state.q, state.v, state.a).tau
    np.testing.assert_allclose(found.forces @ found.parameters, tau, rtol=1e-10)


def test_many_motions_are_each():
    loop, _ = five_bar()
    angles = np.random.default_rng(0).uniform(0.8, 1.2, (4, 2)) + np.array([1.0, 0.0])
    states = [loop.complete(x, x - 1.5, 1.0 - x, guess=robots.five_bar_q(2.0, 1.0)) for x in angles]
    q, v, a = (np.array([getattr(state, name) for state in states]) for name in ("q", "v", "a"))
    found = loop.force_regressor(q, v, a)
    assert found.forces.shape == (4, 2, len(found.parameters))
    for i in range(4):
        np.testing.assert_array_equal(found.forces[i], loop.force_regressor(q[i], v[i], a[i]).forces)
    with pytest.raises(InputError, match="opens"):
        loop.force_regressor(q[0], v[0], a[0] + 1.0)


def four_bar() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR)


def arm() -> ClosedLoopModel:
    model = robots.arm_model()
    return ClosedLoopModel(model, Sidecar((), tuple(model.names[1:])))


def manipulator() -> ClosedLoopModel:
    machine = p3dof.load()
    return p3dof.load_robot(machine.urdf, machine.sidecar)


KNOWN = {
    # A planar body on a fixed axis has 3; a coupler has 4, of which masses at both ends go to its neighbours.
    "four-bar": (four_bar, 3 + 3 + 2),
    # Of two couplers of 4, masses at the elbows go to the arms, one at the tip from one to the other.
    "five-bar": (lambda: five_bar()[0], 3 + 3 + 4 + 4 - 2 - 1),
    # A free body has 10, and each hinge adds 7 (Gautier).
    "biped in the air": (lambda: biped()[0], 10 + 12 * 7),
    # The first of seven hinges is along gravity and has 1.
    "Panda": (arm, 1 + 6 * 7),
    # As its closed forms say, see p3dof.closed_form.compiled.reduced.
    "the manipulator": (manipulator, 21),
}
"""Robots whose number of base parameters is known otherwise."""


@pytest.mark.parametrize("name", KNOWN)
def test_base_parameters_are_as_many_as_is_known(name):
    build, count = KNOWN[name]
    loop = build()
    base = loop.base_parameters()
    assert len(base) == len(base.names) == len(base.values) == count
    assert base.margin[0] > 1e-5
    assert base.margin[1] < 1e-12
    again = loop.base_parameters(seed=9)
    np.testing.assert_array_equal(again.columns.shape, base.columns.shape)


@pytest.mark.parametrize("name", KNOWN)
def test_base_parameters_do_not_depend_on_the_processor(monkeypatch, name):
    """LAPACK's basis of a null space differs among them, and columns of equal size tie but for rounding."""
    loop = KNOWN[name][0]()
    base = loop.base_parameters()
    generator = np.random.default_rng(4)

    def turned(self):
        N = self.Vt[self.rank :].T
        return N @ np.linalg.qr(generator.normal(size=(N.shape[1], N.shape[1])))[0]

    monkeypatch.setattr(Decomposition, "null_space", property(turned))
    again = loop.base_parameters()
    assert again.names == base.names
    np.testing.assert_allclose(again.matrix, base.matrix, rtol=0, atol=1e-8 * np.abs(base.matrix).max())


def test_the_rank_is_that_of_the_forces_of_robots_with_other_inertias():
    """W of inverse_dynamics alone, one parameter after the other; and its base columns give all forces."""
    loop, q = five_bar()
    base, generator = loop.base_parameters(), np.random.default_rng(5)
    angles = generator.uniform(-0.35, 0.35, (20, 2)) + np.array([2.0, 1.0])
    motions = zip(angles, *generator.normal(size=(2, 20, 2)) * np.reshape([3.0, 9.0], (2, 1, 1)), strict=True)
    states = [loop.complete(*one, guess=q) for one in motions]

    def forces(model: pin.Model) -> np.ndarray:
        other = ClosedLoopModel(model, loop.sidecar)
        return np.concatenate([other.inverse_dynamics(s.q, s.v, s.a).tau for s in states])

    tau, columns = forces(loop.model), []
    for k in range(40):
        model = loop.model.copy()
        values = model.inertias[1 + k // 10].toDynamicParameters()
        values[k % 10] += 0.1
        model.inertias[1 + k // 10] = pin.Inertia.FromDynamicParameters(values)
        columns.append((forces(model) - tau) / 0.1)
    W = np.array(columns).T
    W[:, np.abs(W).max(axis=0) < 1e-9] = 0.0
    s = np.linalg.svd(W / np.maximum(np.linalg.norm(W, axis=0), 1e-9), compute_uv=False)
    assert int(np.count_nonzero(s > 1e-9 * s[0])) == len(base) == 11
    np.testing.assert_allclose(W[:, base.columns] @ base.matrix, W, rtol=0, atol=1e-9 * np.abs(W).max())
    np.testing.assert_allclose(base.regressor(W) @ base.values, tau, rtol=0, atol=1e-10 * np.abs(tau).max())


def test_base_parameters_are_told_by_name():
    loop = four_bar()
    base = loop.base_parameters()
    totals = dict(zip(base.parameter_names, base.parameters, strict=True))
    for name, value in zip(base.names, base.values, strict=True):
        told, sign = 0.0, 1.0
        for word in name.replace("- ", "-1 * ").replace("+ ", "").replace("-1 * ", "- ").split(" "):
            if word == "-":
                sign = -1.0
            elif word in totals:
                told, sign = told + sign * totals[word], 1.0
            else:
                sign *= float(word)
        assert told == pytest.approx(value, rel=1e-3, abs=1e-4)


def test_data_of_the_joints_are_parameters_on_request():
    plain, q = five_bar()
    data = (JointData("left_elbow", 3.0, 0.1, 0.4), JointData("right_joint", damping=0.2, friction=0.3))
    loop = ClosedLoopModel(plain.model, replace(plain.sidecar, joint_data=data))
    base = loop.base_parameters(joints=True)
    assert len(base) > 11
    v, a = moving(loop, q)
    found = loop.force_regressor(q, v, a)
    assert base.parameter_names == found.parameter_names
    tau = loop.inverse_dynamics(q, v, a).tau
    np.testing.assert_allclose(base.regressor(found.forces) @ base.values, tau, rtol=1e-9)


def test_the_stewart_platform_is_identified_from_forces():
    loop, q = stewart()
    base = loop.base_parameters()
    draw = np.random.default_rng(8)
    lengths = q[[loop.model.idx_qs[loop.model.getJointId(name)] for name in loop.actuated]]
    targets = lengths + 0.03 * draw.normal(size=(40, 6))
    states = loop.complete_batch(targets, draw.normal(size=(40, 6)), 5.0 * draw.normal(size=(40, 6)), guess=q)
    assert not states.errors
    measured = loop.inverse_dynamics_batch(states.q, states.v, states.a).tau
    A = base.regressor(loop.force_regressor(states.q, states.v, states.a).forces).reshape(-1, len(base))
    scale = np.linalg.norm(A, axis=0)
    found = np.linalg.lstsq(A / scale, measured.ravel(), rcond=None)[0] / scale
    np.testing.assert_allclose(found, base.values, rtol=0, atol=1e-6 * np.abs(base.values).max())


def test_idle_freedoms_say_something_too():
    """One motor on the five-bar: forces along both coordinates, of which the motor gives one."""
    loop, q = five_bar(actuated=("left_joint",))
    v = loop.minimal_dynamics(q).motion @ [0.3, -0.5]
    result = loop.hybrid_dynamics(q, v, [0.7])
    found = loop.force_regressor(q, v, result.a)
    expected = found.actuation @ result.tau
    np.testing.assert_allclose(found.generalised @ found.parameters, expected, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.forces @ found.parameters, result.tau, rtol=1e-10)
    assert len(loop.base_parameters()) == 11


def test_loops_that_never_close_have_no_base_parameters():
    lengths = 0.5, 0.2, 0.1, 0.1
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), robots.FOUR_BAR_SIDECAR)
    with pytest.raises(p3dof.errors.AssemblyError):
        loop.base_parameters()
    for seed in (-1, 0.5, "x"):
        with pytest.raises(InputError, match="seed"):
            loop.base_parameters(seed=seed)


def test_a_robot_that_cannot_move_has_nothing_to_show():
    lengths = robots.FOUR_BAR
    sidecar = replace(robots.FOUR_BAR_SIDECAR, couplings=(p3dof.Coupling("crank_joint", None, (0.6,)),))
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), sidecar)
    q, rest = robots.four_bar_q(0.6, *lengths), np.zeros(3)
    assert loop.minimal_dynamics(q).mass_matrix.shape == (0, 0)
    assert loop.inverse_dynamics_derivatives(q, rest, rest).tau.by_coordinates.shape == (1, 0)
    assert loop.forward_dynamics_derivatives(q, rest, [0.0]).a.by_forces.shape == (3, 1)
    assert len(loop.base_parameters()) == 0
    assert loop.singularity_margins(q).actuation == 1.0


def test_joints_whose_axes_turn_in_their_bodies_have_regressors():
    loop, q = universal_loop()
    v, a = moving(loop, q)
    found, at = loop.force_regressor(q, v, a), loop.minimal_dynamics(q, v)
    left = at.mass_matrix @ a[index_of(loop, at.coordinates)] + at.coriolis_forces + at.gravity_forces
    np.testing.assert_allclose(
        found.generalised @ found.parameters, left, rtol=0, atol=1e-9 * np.abs(left).max()
    )
