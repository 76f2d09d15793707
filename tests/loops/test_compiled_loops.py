"""Compiled dynamics of robots with closed loops, against the general layer."""

import pickle
import warnings
from dataclasses import replace

import closed_loop_robots as robots
import closed_trees as trees
import numpy as np
import pinocchio as pin
import pytest
from gallery import GALLERY
from hypothesis import given, settings
from hypothesis import strategies as st
from other_robots import load, others

import p3dof
from p3dof._base.errors import DynamicsError, InputError, ModelError, ModelWarning, P3dofError
from p3dof._base.tracing import Tape
from p3dof.loops import ClosedLoopModel, Closure, Coupling, JointData, Sidecar
from p3dof.loops.compiled import build, function, printing
from p3dof.loops.compiled import formulas as limits
from p3dof.loops.compiled.function import Function, Kernel
from p3dof.loops.compiled.pivots import planned

HERE = ("four_bar", "five_bar", "delta", "stewart", "gripper", "leg", "two_arms", "biped")
NO_COMPILER = build.compiler() is None
needs_compiler = pytest.mark.skipif(NO_COMPILER, reason="no C compiler here")


def gallery(name):
    return p3dof.load_robot(GALLERY / f"{name}.urdf")


def largest(values):
    return max(1e-9, float(np.abs(values).max(initial=0.0)))


def condition(loop, q):
    J = loop.closure_jacobian(q)
    sizes = np.linalg.svd(J, compute_uv=False)[: loop.rank(q)] if J.size else np.ones(1)
    return sizes[0] / sizes[-1]


def equal(loop, moving, found, expected):
    """Whether forces are those of the general layer, to 1e-12 or what the closures' condition leaves."""
    for i, one in enumerate(expected):
        allowed = max(1e-12, 1e-15 * condition(loop, moving.q[i]))
        assert np.abs(found[i] - one).max(initial=0.0) <= allowed * largest(one), i


@pytest.fixture(scope="module", params=HERE)
def robot(request):
    """A robot of the gallery, compiled, and motions of it; its motors alone move it."""
    loop = gallery(request.param)
    quick = NO_COMPILER or request.param not in ("five_bar", "gripper", "leg")  # the others take seconds
    compiled = loop.compile(level="numpy" if quick else "auto")
    moving = trees.motions(loop, 12, seed=3, spread=0.2)
    if request.param == "leg":  # idle freedoms move as they must
        rows = zip(moving.q, moving.v, moving.a, strict=True)
        moving.a = np.array([loop.hybrid_dynamics(q, v, a[loop.actuated_v]).a for q, v, a in rows])
    return loop, compiled, moving


def test_forces_and_multipliers_of_the_gallery(robot):
    loop, compiled, moving = robot
    found = compiled.inverse_dynamics(moving.q, moving.v, moving.a)
    assert not found.general.any()
    assert found.errors == {}
    expected = [loop.inverse_dynamics(*state) for state in zip(moving.q, moving.v, moving.a, strict=True)]
    equal(loop, moving, found.tau, [one.tau for one in expected])
    for i, one in enumerate(expected):
        scale = largest(one.lambda_)
        off = np.abs(found.lambda_[i] - one.lambda_)[one.unique]
        assert off.max(initial=0.0) <= 1e-11 * scale
    assert found.gap.max() < 1e-9


def test_accelerations_of_the_gallery(robot):
    loop, compiled, moving = robot
    tau = compiled.inverse_dynamics(moving.q, moving.v, moving.a).tau
    found = compiled.forward_dynamics(moving.q, moving.v, tau)
    assert not found.general.any()
    np.testing.assert_allclose(found.a, moving.a, rtol=0, atol=1e-9 * largest(moving.a))
    one = loop.forward_dynamics(moving.q[0], moving.v[0], tau[0])
    np.testing.assert_allclose(found.a[0], one.a, rtol=0, atol=1e-10 * largest(one.a))


def test_forces_for_prescribed_accelerations_of_motors(robot):
    loop, compiled, moving = robot
    wanted = moving.a[:, loop.actuated_v]
    if len(loop.actuated) > loop.mobility(moving.q[0]):
        with pytest.raises(ModelError, match=r"more actuators than freedoms"):
            compiled.hybrid_dynamics(moving.q, moving.v, wanted)
        return
    found = compiled.hybrid_dynamics(moving.q, moving.v, wanted)
    assert not found.general.any()
    expected = [loop.hybrid_dynamics(*state) for state in zip(moving.q, moving.v, wanted, strict=True)]
    equal(loop, moving, found.tau, [one.tau for one in expected])
    for i, one in enumerate(expected):
        np.testing.assert_allclose(found.a[i], one.a, rtol=0, atol=1e-10 * largest(one.a))


def test_derivatives_are_those_of_the_general_layer(robot):
    loop, compiled, moving = robot
    if loop.mobility(moving.q[0]) > len(loop.actuated):
        found = compiled.inverse_dynamics_derivatives(moving.q[:1], moving.v[:1], moving.a[:1])
        assert list(found.errors) == [0] or not found.general[0]
        return
    found = compiled.inverse_dynamics_derivatives(moving.q[:3], moving.v[:3], moving.a[:3])
    assert not found.general.any()
    for i in range(3):
        state = moving.q[i], moving.v[i], moving.a[i]
        exact = loop.inverse_dynamics_derivatives(*state, compiled.independent).tau
        for mine, theirs in zip(vars(found.by).values(), vars(exact).values(), strict=True):
            np.testing.assert_allclose(mine[i], theirs, rtol=0, atol=1e-9 * largest(theirs))
        forces = found.values[i]
        done = compiled.forward_dynamics_derivatives(moving.q[i], moving.v[i], forces)
        wanted = loop.forward_dynamics_derivatives(moving.q[i], moving.v[i], forces, compiled.independent).a
        for mine, theirs in zip(vars(done.by).values(), vars(wanted).values(), strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-8 * largest(theirs))


@pytest.mark.parametrize(
    "name", others("five_bar_point", "five_bar_rod_end", "leg_with_rods", "two_legs", "tiny_delta")
)
def test_other_robots(name):
    loop = load(name)
    compiled = loop.compile(level="numpy")
    moving = trees.motions(loop, 4, seed=1, spread=0.1)
    wanted = moving.a[:, loop.actuated_v]
    found = compiled.hybrid_dynamics(moving.q, moving.v, wanted)
    for i in np.flatnonzero(~found.general):
        one = loop.hybrid_dynamics(moving.q[i], moving.v[i], wanted[i])
        allowed = max(1e-12, 1e-15 * condition(loop, moving.q[i])) * largest(one.tau)
        # Idle freedoms of tiny bodies: their inertia alone is what divides there.
        allowed = (
            max(allowed, 1e-9 * largest(one.tau)) if loop.mobility(moving.q[i]) > len(wanted[i]) else allowed
        )
        assert np.abs(found.tau[i] - one.tau).max() <= allowed


# Any robot


@given(seed=st.integers(0, 10**6), several=st.sampled_from([0.0, 0.3]))
@settings(max_examples=15, deadline=None)
def test_any_closed_tree(seed, several):
    loop = trees.random_robot(seed, joints=3 + seed % 4, loops=1 + seed % 3, several=several)
    if loop is None:
        return
    moving = trees.motions(loop, 3, seed)
    compiled = loop.compile(level="numpy")
    wanted = moving.a[:, loop.actuated_v]
    found, told = compiled.hybrid_dynamics(moving.q, moving.v, wanted), []
    for i in range(3):
        try:
            one = loop.hybrid_dynamics(moving.q[i], moving.v[i], wanted[i])
        except P3dofError as error:
            told.append((i, error))
            continue
        scale = condition(loop, moving.q[i])
        assert np.abs(found.tau[i] - one.tau).max() <= max(1e-11, 1e-13 * scale) * largest(one.tau)
        back = compiled.forward_dynamics(moving.q[i], moving.v[i], found.tau[i])
        assert np.abs(back.a - found.a[i]).max() <= 1e-7 * max(1.0, scale / 1e3) * largest(found.a[i])
    assert {i: type(error) for i, error in told} == {i: type(e) for i, e in found.errors.items()}


def test_where_the_partition_fails_the_general_layer_decides():
    bar = gallery("four_bar")
    loop = ClosedLoopModel(bar.model, replace(bar.sidecar, actuated=("rocker_joint",)))
    compiled = loop.compile(level="numpy")
    at, margins, refused = loop.assemble().q, [], []
    for angle in np.linspace(0.0, 2 * np.pi, 721):  # twice, crank and coupler are in line
        at = loop.assemble({"crank_joint": angle}, guess=at).q
        N = trees.free(loop, at)
        v = N @ np.ones(N.shape[1])
        a = -trees.drift(loop, at, v)
        found = compiled.inverse_dynamics([at], [v], [a])
        margins.append(found.margin[0])
        assert found.general[0] == (found.margin[0] < limits.MARGIN)
        try:
            tau = loop.inverse_dynamics(at, v, a).tau
        except P3dofError as error:
            refused.append((type(found.errors[0]), type(error)))
            continue
        allowed = max(1e-12, 1e-15 * condition(loop, at), 1e-14 / found.margin[0])
        np.testing.assert_allclose(found.tau[0], tau, rtol=allowed, atol=1e-12)
    assert all(mine is theirs for mine, theirs in refused)
    margins = np.array(margins)
    assert margins.min() < 0.02
    assert np.median(margins) > 0.3
    # Exactly there, between two samples:
    low, high = (2 * np.pi * (np.argmin(margins) + k) / 720 for k in (-1, 1))
    found = None
    for _ in range(60):
        middle = (low + high) / 2
        ends = []
        for angle in (low, middle):
            q = loop.assemble({"crank_joint": angle}, guess=at).q
            ends.append(trees.free(loop, q)[2, 0] * np.sign(trees.free(loop, q)[0, 0]))
            N = trees.free(loop, q)
            found = compiled.inverse_dynamics([q], [N[:, 0]], [-trees.drift(loop, q, N[:, 0])])
        low, high = (middle, high) if ends[0] * ends[1] > 0 else (low, middle)
    assert found.margin[0] < limits.MARGIN
    assert found.general[0]


# What acts


def sprung(name):
    loop = gallery(name)
    joints = [str(n) for n in loop.model.names[1:] if loop.model.nvs[loop.model.getJointId(n)] == 1]
    data = [
        JointData(joint, stiffness=2.0 + i, rest=0.3, damping=0.2, friction=0.1 * i, force=i)
        for i, joint in enumerate(joints)
    ]
    several = [str(n) for n in loop.model.names[1:] if loop.model.nqs[loop.model.getJointId(n)] == 7]
    rest = (0.01, 0.02, 0.3, *pin.Quaternion(pin.exp3(np.array([0.1, -0.2, 0.3]))).coeffs().tolist())
    data += [JointData(joint, stiffness=50.0, rest=rest, damping=0.5) for joint in several]
    loop.model.armature = np.linspace(0.01, 0.05, loop.model.nv)
    return ClosedLoopModel(loop.model, replace(loop.sidecar, joint_data=tuple(data)))


@pytest.mark.parametrize("name", ["four_bar", "stewart"])
def test_springs_damping_friction_rotors_wrenches_and_joint_forces_act(name):
    loop = sprung(name)
    frame = loop.model.frames[loop.model.nframes - 1].name
    first = loop.model.frames[loop.model.nframes // 2].name
    compiled = loop.compile(external=[frame, first], joint_forces=True, level="numpy")
    moving = trees.motions(loop, 5, seed=2)
    rng = np.random.default_rng(0)
    external = {frame: rng.normal(0, 10, (5, 6)), first: rng.normal(0, 10, 6)}
    joints = rng.normal(0, 3, (5, loop.model.nv))
    found = compiled.inverse_dynamics(moving.q, moving.v, moving.a, external, joints)
    back = compiled.forward_dynamics(moving.q, moving.v, found.tau, external, joints)
    np.testing.assert_allclose(back.a, moving.a, rtol=0, atol=1e-9 * largest(moving.a))
    bare = compiled.inverse_dynamics(moving.q, moving.v, moving.a)
    for i in range(5):
        state = moving.q[i], moving.v[i], moving.a[i]
        acting = {frame: external[frame][i], first: external[first]}
        one = loop.inverse_dynamics(*state, acting, joints[i])
        np.testing.assert_allclose(found.tau[i], one.tau, rtol=0, atol=1e-12 * largest(one.tau))
        alone = loop.inverse_dynamics(*state)
        np.testing.assert_allclose(bare.tau[i], alone.tau, rtol=0, atol=1e-12 * largest(one.tau))
        by = compiled.inverse_dynamics_derivatives(*state, acting).by
        exact = loop.inverse_dynamics_derivatives(*state, compiled.independent, acting).tau
        for mine, theirs in zip(vars(by).values(), vars(exact).values(), strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * largest(theirs))


def test_a_payload_may_be_known_only_when_it_runs():
    loop = gallery("stewart")
    compiled = loop.compile(inertias=["platform_free"], level="numpy")
    moving = trees.motions(loop, 3, seed=4)
    heavy = pin.Inertia(25.0, np.array([0.01, 0.02, 0.05]), np.diag([0.3, 0.4, 0.5]))
    numbers = heavy.toDynamicParameters()
    found = compiled.inverse_dynamics(moving.q, moving.v, moving.a, inertias={"platform_free": numbers})
    before = compiled.inverse_dynamics(moving.q, moving.v, moving.a)
    other = loop.copy()
    other.model.inertias[other.model.getJointId("platform_free")] = heavy
    for i in range(3):
        state = moving.q[i], moving.v[i], moving.a[i]
        np.testing.assert_allclose(found.tau[i], other.inverse_dynamics(*state).tau, rtol=1e-11)
        np.testing.assert_allclose(before.tau[i], loop.inverse_dynamics(*state).tau, rtol=1e-11)


def test_a_ball_springs_back_from_any_turn():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    model.addJointFrame(joint)
    rest = tuple(pin.Quaternion(pin.exp3(np.array([0.3, 0.5, -0.2]))).coeffs().tolist())
    loop = ClosedLoopModel(model, Sidecar((), (), joint_data=(JointData("ball", 3.0, rest),)))
    compiled = loop.compile(level="numpy")
    draw = np.random.default_rng(0)
    turns = [np.array(rest), *(pin.Quaternion(pin.exp3(draw.normal(0, 2, 3))).coeffs() for _ in range(20))]
    for q in turns:
        found = compiled.forward_dynamics(q, np.zeros(3), np.zeros(0))
        assert not found.general
        expected = loop.forward_dynamics(q, np.zeros(3), np.zeros(0)).a
        np.testing.assert_allclose(found.a, expected, rtol=0, atol=1e-11 * max(1.0, largest(expected)))


def coupled(circle):
    """Two arms, geared to each other; they turn without end, or have a polynomial between them."""
    model = pin.Model()
    kind = pin.JointModelRUBZ if circle else pin.JointModelRZ
    for name in ("one", "two"):
        joint = model.addJoint(0, kind(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(
            joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3(np.eye(3), np.array([0.3, 0, 0]))
        )
        model.addJointFrame(joint)
    model.gravity.linear = np.array([0, -9.81, 0])
    polynomial = (0.2, -2.0) if circle else (0.2, 0.5, 0.3, -0.1)
    return ClosedLoopModel(model, Sidecar((), ("two",), (Coupling("one", "two", polynomial),)))


@pytest.mark.parametrize("circle", [True, False])
def test_couplings(circle):
    loop = coupled(circle)
    compiled = loop.compile(level="numpy")
    for angle in (-3.0, -0.4, 0.9, 2.8):
        state = loop.complete([angle], [1.3], [0.7])
        one = loop.inverse_dynamics(state.q, state.v, state.a)
        found = compiled.inverse_dynamics(state.q, state.v, state.a)
        assert not found.general
        np.testing.assert_allclose(found.tau, one.tau, rtol=1e-12)
        np.testing.assert_allclose(found.lambda_, one.lambda_, rtol=1e-12)


def test_axes_that_are_opposite_do_not_close_a_hinge():
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "arm")
    turn = model.addJoint(arm, pin.JointModelRZ(), pin.SE3.Identity(), "turn")
    model.appendBodyToJoint(turn, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    for joint, name in ((0, "ground"), (turn, "axle")):
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    loop = ClosedLoopModel(model, Sidecar((Closure("ground", "axle", "hinge"),), ("turn",)))
    compiled = loop.compile(level="numpy")
    zero = np.zeros((1, 2))
    assert not compiled.inverse_dynamics(zero, zero, zero).general[0]
    opposite = compiled.inverse_dynamics([[np.pi, 0.0]], zero, zero)
    assert opposite.gap[0] < 1e-12  # the sine of half a turn is zero
    assert isinstance(opposite.errors[0], InputError)


# Along a motion


def swinging(loop, count, rate, amplitude, frequency=2.0):
    """A motion of the motors around the reference that starts there."""
    q0, model, base = loop.assemble().q, loop.model, []
    for name in loop.actuated:
        joint = model.getJointId(name)
        at = model.idx_qs[joint]
        base.append(np.arctan2(q0[at + 1], q0[at]) if model.nqs[joint] == 2 else q0[at])
    time = np.arange(count)[:, None] / rate
    w, phase = 2 * np.pi * frequency, np.arange(len(base))
    return (
        time[:, 0],
        np.array(base) + amplitude * (np.sin(w * time + phase) - np.sin(phase)),
        amplitude * w * np.cos(w * time + phase),
        -amplitude * w * w * np.sin(w * time + phase),
    )


@needs_compiler
@pytest.mark.parametrize(
    "name",
    [
        "four_bar",
        "five_bar",
        pytest.param("delta", marks=pytest.mark.slow),
        pytest.param("stewart", marks=pytest.mark.slow),
        "gripper",
    ],
)
def test_two_steps_of_newton_follow_a_motion(name):
    loop = gallery(name)
    compiled = loop.compile(threads=1)
    motion = swinging(loop, 203, rate=100.0, amplitude=0.03)
    found = compiled.complete(*motion)
    assert not found.general.any()
    expected = loop.complete_batch(*motion[1:])
    forces = loop.inverse_dynamics_batch(expected.q, expected.v, expected.a).tau
    for mine, theirs in ((found.q, expected.q), (found.v, expected.v), (found.a, expected.a)):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-11 * max(1.0, largest(theirs)))
    np.testing.assert_allclose(found.tau, forces, rtol=0, atol=1e-11 * largest(forces))
    once = compiled.complete(*motion, steps=1)
    assert once.gap.max() > found.gap.max() or once.general.any()


@needs_compiler
def test_the_ways_between_lanes_are_cut_by_the_joint_that_goes_furthest(monkeypatch):
    """One motor turns twice, the other one stands: every assembly is near to the one before."""
    loop, asked = gallery("five_bar"), []
    assemble, turn = type(loop).assemble, 4 * np.pi
    time = np.linspace(0, 1, 401)
    shape = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # from rest to rest
    angles, speeds, changes = (
        np.column_stack([turn * law(time), 0 * time]) for law in (shape, shape.deriv(), shape.deriv(2))
    )
    angles += loop.assemble().q[[loop.model.joints[loop.model.getJointId(n)].idx_q for n in loop.actuated]]

    def recorded(self, values, **more):
        asked.append(values)
        return assemble(self, values, **more)

    compiled = loop.compile(threads=1)
    monkeypatch.setattr(type(loop), "assemble", recorded)
    found = compiled.complete(time, angles, speeds, changes)
    assert not found.general.any()
    steps = np.diff(asked, axis=0)
    assert np.abs(steps).max() <= 0.2
    assert len(steps) >= (asked[-1] - asked[0])[0] / 0.2 > 10
    np.testing.assert_array_equal(asked[0], angles[0])
    assert np.abs(angles - asked[-1]).max(axis=1).min() < 1e-12  # where the last lane starts


@needs_compiler
def test_a_lane_on_another_assembly_is_noticed(monkeypatch):
    loop = gallery("four_bar")
    compiled = loop.compile(threads=1)
    motion = swinging(loop, 400, rate=200.0, amplitude=0.05)
    expected = compiled.complete(*motion)
    assert not expected.general.any()
    modes = loop.assembly_modes(motion[1][0])
    other = next(mode.q for mode in modes if not mode.same_assembly)
    starts = type(compiled)._starts

    def misled(self, sweep, target, guess):
        found = starts(self, sweep, target, guess)
        last = max(found)
        found[last] = np.array(loop.assemble(target[last], guess=other).q)
        return found

    monkeypatch.setattr(type(compiled), "_starts", misled)
    found = compiled.complete(*motion)
    assert found.general.any()
    np.testing.assert_allclose(found.tau, expected.tau, rtol=0, atol=1e-10 * largest(expected.tau))


@needs_compiler
def test_wrenches_act_along_a_motion_and_threads_share_it(monkeypatch):
    from p3dof.loops.compiled import following as sweep
    from p3dof.loops.compiled import function as kernels

    loop = gallery("stewart")
    motion = swinging(loop, 100, rate=100.0, amplitude=0.02)
    push = np.linspace(0, 30, 600).reshape(100, 6)
    alone = loop.compile(external=["platform"], threads=1).complete(*motion, {"platform": push})
    monkeypatch.setattr(kernels, "SHARE", 30)
    monkeypatch.setattr(sweep, "SHARE", 30)
    both = loop.compile(external=["platform"], threads=2)
    found = both.complete(*motion, {"platform": push})
    for name in ("q", "v", "a", "tau"):
        mine, theirs = getattr(found, name), getattr(alone, name)
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-11 * largest(theirs))
    again = both.inverse_dynamics(found.q, found.v, found.a, {"platform": push})
    np.testing.assert_allclose(again.tau, found.tau, rtol=0, atol=1e-11 * largest(found.tau))
    one = loop.inverse_dynamics(found.q[50], found.v[50], found.a[50], {"platform": push[50]})
    np.testing.assert_allclose(found.tau[50], one.tau, rtol=0, atol=1e-11 * largest(one.tau))


def test_following_needs_motors_that_determine_the_motion():
    with pytest.raises(ModelError, match=r"do not determine the motion"):
        gallery("leg").compile(level="numpy").complete(
            [0.0], np.zeros((1, 6)), np.zeros((1, 6)), np.zeros((1, 6))
        )


# Calls


@needs_compiler
@pytest.mark.parametrize("name", ["five_bar", pytest.param("stewart", marks=pytest.mark.slow)])
def test_every_level_and_a_bound_call_give_the_same(name):
    loop = gallery(name)
    moving = trees.motions(loop, 21, seed=7)
    levels = ["baseline", "auto", "numpy"]
    flags = build._processor()
    levels += ["avx2"] * (" avx2 " in flags) + ["avx512"] * (" avx512dq " in flags and " avx512vl " in flags)
    results = {}
    for level in levels:
        compiled = loop.compile(level=level)
        results[level] = compiled.inverse_dynamics(moving.q, moving.v, moving.a)
        bound = compiled.bind()
        for key, row in (("q", moving.q[3]), ("v", moving.v[3]), ("a", moving.a[3])):
            bound.inputs[key][:] = row
        bound.run()
        tau = results[level].tau[3]
        np.testing.assert_allclose(bound.outputs["tau"], tau, rtol=0, atol=1e-14 * largest(tau))
    for found in results.values():
        tau = results["numpy"].tau
        np.testing.assert_allclose(found.tau, tau, rtol=0, atol=1e-13 * largest(tau))


@pytest.mark.parametrize("level", ["numpy", pytest.param("auto", marks=needs_compiler)])
@pytest.mark.parametrize("name", ["inverse_dynamics", "forward_dynamics", "motion", "step"])
def test_a_bound_call_with_nan_has_no_margin_and_is_not_trusted(level, name):
    loop = gallery("four_bar")
    bound, state = loop.compile(level=level).bind(name), trees.motions(loop, 3, seed=7)
    good = {"q": state.q[1], "v": state.v[1], "a": state.a[1]}
    for bad in (None, *bound.inputs):
        for key, values in bound.inputs.items():
            values[:] = good.get(key, 0.0)
        if bad is not None:
            bound.inputs[bad][-1] = np.nan
        bound.run()
        assert np.isnan(bound.outputs["margin"][0]) == (bad == "q")
        assert np.isnan(bound.outputs["gap"][0]) == (bad == "q")
        assert np.isnan(bound.outputs["trusted"][0]) == (bad is not None)


def test_one_sample_and_many_are_the_same_and_neighbours_of_a_bad_one_stay():
    loop = gallery("delta")
    compiled = loop.compile(level="numpy" if NO_COMPILER else "auto")
    moving = trees.motions(loop, 9, seed=5)
    good = compiled.inverse_dynamics(moving.q, moving.v, moving.a)
    q, v, a = moving.q.copy(), moving.v.copy(), moving.a.copy()
    q[2, 0] = np.nan
    q[4] += 0.1  # loops open
    v[6] = 1.0  # opens them
    found = compiled.inverse_dynamics(q, v, a)
    assert sorted(found.errors) == [2, 4, 6]
    assert all(isinstance(error, InputError) for error in found.errors.values())
    kept = [0, 1, 3, 5, 7, 8]
    assert np.array_equal(found.tau[kept], good.tau[kept])
    assert np.isnan(found.tau[[2, 4, 6]]).all()
    one = compiled.inverse_dynamics(moving.q[0], moving.v[0], moving.a[0])
    assert one.tau.shape == (3,)
    assert np.array_equal(one.tau, good.tau[0])
    with pytest.raises(InputError):
        compiled.inverse_dynamics(q[4], v[4], a[4])
    with pytest.raises(ValueError, match=r"read-only"):
        found.tau[0, 0] = 1.0


def test_motions_that_need_forces_nobody_gives_are_errors():
    loop = gallery("leg")
    compiled = loop.compile(level="numpy")
    moving = trees.motions(loop, 3, seed=3)
    found = compiled.inverse_dynamics(moving.q, moving.v, moving.a)
    assert found.general.all()
    assert all(isinstance(error, DynamicsError) for error in found.errors.values())


def test_an_open_tree_is_compiled_too():
    model = pin.buildSampleModelManipulator()
    loop = ClosedLoopModel.from_pinocchio(model)
    compiled = loop.compile(level="numpy")
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 4, model.nv))
    data = model.createData()
    expected = [pin.rnea(model, data, *state).copy() for state in zip(q, v, a, strict=True)]
    np.testing.assert_allclose(compiled.inverse_dynamics(q, v, a).tau, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: c.inverse_dynamics(np.zeros((2, 3)), np.zeros((2, 4)), np.zeros((2, 4))), "^q: expected"),
        (lambda c: c.inverse_dynamics(np.zeros((2, 4)), np.zeros((3, 4)), np.zeros((2, 4))), "^v: expected"),
        (lambda c: c.inverse_dynamics("q", np.zeros(4), np.zeros(4)), "^q: "),
        (
            lambda c: c.inverse_dynamics(np.zeros(4), np.zeros(4), np.zeros(4), {"tip": np.zeros(6)}),
            "wrench tip",
        ),
        (
            lambda c: c.inverse_dynamics(*np.zeros((3, 4)), joint_forces=np.zeros(4)),
            "joint forces: it was not",
        ),
        (lambda c: c.inverse_dynamics(*np.zeros((3, 4)), 3.0), "^external: expected a mapping"),
        (lambda c: c.inverse_dynamics(*np.zeros((3, 4)), inertias=[1]), "^inertias: expected a mapping"),
        (lambda c: c.bind("inverse"), "^name: expected one of"),
        (lambda c: c.operations("x"), "^name: expected one of"),
        (lambda c: c.complete([0.0, 0.0], *np.zeros((3, 2, 2))), "^time: expected rising"),
        (lambda c: c.complete([0.0, 1.0], *np.zeros((3, 2, 2)), steps=0), "^steps: expected"),
    ],
)
def test_bad_calls_are_refused(call, message):
    loop = gallery("five_bar")
    with pytest.raises(P3dofError, match=message):
        call(loop.compile(level="numpy"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"level": "fast"}, "^level: expected one of auto"),
        ({"external": "platform"}, "^external: expected several names"),
        ({"external": ["nobody"]}, "the frame 'nobody' does not exist"),
        ({"external": ["left_tip", "left_tip"]}, "a name is given twice"),
        ({"inertias": ["nobody"]}, "the joint 'nobody' does not exist"),
        ({"around": np.zeros((0, 4))}, "^around: expected at least one"),
        ({"around": np.zeros(4)}, "^around: configuration 0 is open by"),
        ({"around": np.zeros(3)}, "^around: expected"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(P3dofError, match=message):
        gallery("five_bar").compile(**{"level": "numpy", **options})


def test_a_joint_of_an_unknown_kind_is_named():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelEllipsoid(1.0, 0.5, 0.3), pin.SE3.Identity(), "egg")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    with pytest.raises(ModelError, match=r"joint 'egg': a joint of the type Ellipsoid cannot be compiled"):
        ClosedLoopModel(model, Sidecar((), ())).compile(level="numpy")


def test_too_many_operations_are_refused(monkeypatch):
    monkeypatch.setattr(function, "MOST_OPERATIONS", 100)
    compiled = gallery("five_bar").compile(level="numpy")
    with pytest.raises(ModelError, match=r"operations are more than compilers take"):
        compiled.operations()


def test_without_a_compiler_a_line_says_so(monkeypatch):
    monkeypatch.setattr(build, "compiler", lambda: None)
    with pytest.warns(ModelWarning, match=r"no C compiler"):
        compiled = gallery("four_bar").compile()
    assert compiled.level == "numpy"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gallery("four_bar").compile(level="numpy")  # asked for


@needs_compiler
def test_a_compiler_that_fails_is_told(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho 'no space' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(build, "compiler", lambda: str(broken))
    with pytest.raises(ModelError, match=r"the C compiler failed: no space"):
        gallery("four_bar").compile().bind()


def test_masses_that_change_later_are_not_seen():
    loop = gallery("four_bar")
    compiled = loop.compile(level="numpy")
    moving = trees.motions(loop, 1, seed=1)
    before = compiled.inverse_dynamics(moving.q, moving.v, moving.a).tau
    loop.model.gravity.linear = np.zeros(3)
    assert np.array_equal(compiled.inverse_dynamics(moving.q, moving.v, moving.a).tau, before)


def test_pivots_hold_on_all_samples_at_once():
    good, small = np.array([[1.0, 2.0], [0.5, 0.3]]), np.array([[1e-12, 2.0], [0.5, 0.3]])
    plan = planned(np.array([good, small]), ())
    assert (0, 0) not in plan.pivots  # it vanishes on the second
    assert planned(np.array([good]), (1,)).pivots[0][1] == 0
    redundant = np.array([[[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]]])
    assert len(planned(redundant, ()).pivots) == 1


# Wrong numbers that nobody would notice


def sized(loop, size):
    """A robot that is larger or smaller, of the same density."""
    model = loop.model.copy()
    for i in range(1, model.njoints):
        place = model.jointPlacements[i]
        model.jointPlacements[i] = pin.SE3(place.rotation, place.translation * size)
        body = model.inertias[i]
        model.inertias[i] = pin.Inertia(body.mass * size**3, body.lever * size, body.inertia * size**5)
    for frame in model.frames:
        frame.placement = pin.SE3(frame.placement.rotation, frame.placement.translation * size)
    return ClosedLoopModel(model, loop.sidecar)


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1e3])
@pytest.mark.parametrize("name", ["four_bar", "five_bar"])
def test_tiny_and_huge_robots(name, size):
    loop = sized(gallery(name), size)
    compiled = loop.compile(level="numpy")
    moving = trees.motions(loop, 3, seed=2, spread=0.2)
    found = compiled.inverse_dynamics(moving.q, moving.v, moving.a)
    back = compiled.forward_dynamics(moving.q, moving.v, found.tau)
    assert not (found.general | back.general).any()
    for i in range(3):
        one = loop.inverse_dynamics(moving.q[i], moving.v[i], moving.a[i]).tau
        np.testing.assert_allclose(found.tau[i], one, rtol=0, atol=1e-12 * np.abs(one).max())
        np.testing.assert_allclose(back.a[i], moving.a[i], rtol=0, atol=1e-8 * np.abs(moving.a[i]).max())


@pytest.mark.parametrize("level", ["numpy", pytest.param("auto", marks=needs_compiler)])
def test_quaternions_that_are_not_normalised_are_refused(level):
    loop = gallery("stewart" if level == "numpy" else "leg")
    joint = next(joint for joint in loop.model.joints if joint.nq in (4, 7))
    compiled = loop.compile(level=level)
    moving = trees.motions(loop, 2, seed=1, spread=0.1)
    q, place = np.array(moving.q), slice(joint.idx_q + joint.nq - 4, joint.idx_q + joint.nq)
    tau = np.ones((2, len(loop.actuated)))
    q[1, place] *= 1 + 1e-5
    found = compiled.forward_dynamics(q, moving.v, tau)
    assert {i: type(error) for i, error in found.errors.items()} == {1: InputError}
    q[1, place] *= -1 / (1 + 1e-5)  # the same turn
    found = compiled.forward_dynamics(q, moving.v, tau)
    assert not found.general.any()


@pytest.mark.parametrize("level", ["numpy", pytest.param("auto", marks=needs_compiler)])
def test_speeds_and_accelerations_that_overflow_are_refused(level):
    loop = gallery("five_bar")
    compiled = loop.compile(level=level)
    moving = trees.motions(loop, 3, seed=1, spread=0.1)
    for huge in (1e100, 1e160, 1e200):
        for name in ("v", "a"):
            state = {"q": moving.q, "v": np.array(moving.v), "a": np.array(moving.a)}
            state[name][1, 2] = huge
            found = compiled.inverse_dynamics(**state)
            assert list(found.errors) == [1]
            assert np.isnan(found.tau[1]).all()


@pytest.mark.parametrize(
    ("v", "a", "size"),
    [
        ([0.1, -0.2, 0.2], [], 1.0),  # small motions are compared with one unit
        ([2.0, -4.0, 4.0], [], 12.0),
        ([0.1, -0.2, 0.2], [3.0, -6.0, 0.0], 15.0),
        ([2.0, -4.0, 4.0], [3.0, -6.0, 0.0], 144.0),  # accelerations grow with the square of speeds
        ([0.1, -0.2, 0.2], [0.3, -0.6, 0.0], 1.0),
    ],
)
def test_how_far_a_motion_may_open_closures(v, a, size):
    """The size of a motion is its mean square; numbers on a tape are computed at once."""
    assert limits.stays_closed(Tape(), [], 0.1, v, a) == 1
    for opening in ([0.05, -0.02], [3.0, 4.0]):
        expected = 0.01 * size - float(np.dot(opening, opening))
        assert limits.stays_closed(Tape(), opening, 0.1, v, a) == pytest.approx(expected, rel=1e-13)


def test_dead_centres_among_several_configurations_are_left_out():
    """As one alone: the partition is that of the regular ones, or of regular ones beside them."""
    loop = ClosedLoopModel.from_urdf(robots.slider_crank(), robots.SLIDER_CRANK_SIDECAR)
    dead, one, two = np.zeros(3), *(loop.around({"crank_joint": x}).assemble().q for x in (1.0, 1.3))
    same = {"dead": [[dead], [dead, dead]], "regular": [[one, two], [dead, one, two], [one, dead, two]]}
    for kind, each in same.items():
        made = [loop.compile(around=around, level="numpy") for around in each]
        assert [compiled.independent for compiled in made] == [("slide",)] * len(made)
        assert len({tuple(compiled.margin(q) for q in (one, two)) for compiled in made}) == 1, kind
    many = loop.compile(around=[one, dead, two], level="numpy")
    motion = loop.complete([-0.05], [0.3], [0.2], one)
    expected = loop.inverse_dynamics(motion.q, motion.v, motion.a).tau
    found = many.inverse_dynamics(motion.q[None], motion.v[None], motion.a[None]).tau
    np.testing.assert_allclose(found[0], expected, rtol=1e-10)


def test_arguments_that_do_not_fit_are_told_in_one_line():
    loop = gallery("five_bar")
    for threads in (0, -3, 1.5, "two"):
        with pytest.raises(InputError, match=r"threads: expected a number from 1 to 1024"):
            loop.compile(threads=threads)
    with pytest.raises(InputError, match=r"level: expected one of auto.*numpy, got a list"):
        loop.compile(level=["auto"])
    with pytest.raises(InputError, match=r"around: expected real numbers"):
        loop.compile(around="home")
    with pytest.raises(InputError, match=r"external: expected several names, got 5"):
        loop.compile(external=5)


def test_free_motions_without_inertia_are_not_made_up():
    """Rods that are exactly thin spin about themselves: their inertia is rounding."""
    leg = gallery("leg")
    model = leg.model.copy()
    for i in range(1, model.njoints):
        if model.joints[i].nv == 3:
            body = model.inertias[i]
            sizes, axes = np.linalg.eigh(body.inertia)
            thin = axes @ np.diag([0.0, sizes[2], sizes[2]]) @ axes.T
            model.inertias[i] = pin.Inertia(body.mass, axes[:, 0] * (axes[:, 0] @ body.lever), thin)
    loop = ClosedLoopModel(model, leg.sidecar)
    moving = trees.motions(loop, 2, seed=2, spread=0.2)
    compiled = loop.compile(level="numpy")
    found = compiled.hybrid_dynamics(moving.q, moving.v, moving.a[:, loop.actuated_v])
    assert [type(error) for error in found.errors.values()] == [DynamicsError, DynamicsError]
    assert compiled.forward_dynamics(moving.q, moving.v, np.ones((2, 6))).general.all()
    bar = gallery("five_bar")
    for i in range(1, bar.model.njoints):
        bar.model.inertias[i] = pin.Inertia.Zero()
    with pytest.raises(ModelError, match=r"a free motion of the mechanism has no inertia"):
        bar.compile(level="numpy").forward_dynamics(np.zeros(4), np.zeros(4), np.zeros(2))


@pytest.mark.parametrize("kind", trees.KINDS)
def test_newton_s_steps_close_every_kind_of_closure(kind, monkeypatch):
    monkeypatch.setattr(trees, "KINDS", (kind,))
    closed = 0
    for seed in range(40):
        loop = trees.random_robot(seed, joints=4, loops=1)
        if loop is None:
            continue
        compiled = loop.compile(level="numpy")
        step = compiled.bind("step")
        place = step.inputs["q"]
        draw = np.random.default_rng(seed)
        q = np.array(loop.assemble().q)
        place[:] = pin.integrate(loop.model, q, draw.normal(0, 3e-3, loop.model.nv))
        gaps, margins = [], []
        for _ in range(9):
            step.run()
            gaps.append(step.outputs["gap"][0])
            margins.append(step.outputs["margin"][0])
            place[:] = step.outputs["q"]
        if min(margins) < 0.3 or gaps[0] < 1e-5:
            continue  # steps are long near a singularity, and some closures hold by themselves
        assert gaps[-1] < 1e-12, seed
        assert np.abs(loop.closure_error(place)).max() < 1e-11, seed
        closed += 1
        if closed == 8:
            break
    assert closed >= 5


def test_configurations_move_as_those_of_pinocchio():
    draw, model = np.random.default_rng(0), pin.Model()
    joint = 0
    for number, kind in enumerate((*trees.ONE_FREEDOM, *trees.SEVERAL)):
        joint = model.addJoint(joint, kind(draw), trees.placement(draw), f"joint{number}")
        model.appendBodyToJoint(joint, trees.inertia(draw), pin.SE3.Identity())
    integrate = ClosedLoopModel.from_pinocchio(model).compile(level="numpy").bind("integrate")
    q = pin.integrate(model, pin.neutral(model), draw.normal(size=model.nv))
    shift = draw.normal(size=model.nv)
    for size, bound in ((1e-2, 1e-4), (1e-4, 1e-8), (1e-6, 1e-12)):  # to second order
        integrate.inputs["q"][:], integrate.inputs["dq"][:] = q, size * shift
        integrate.run()
        moved = integrate.outputs["q"]
        assert pin.isNormalized(model, moved, 1e-12)
        assert np.abs(pin.difference(model, pin.integrate(model, q, size * shift), moved)).max() < 10 * bound


# Many samples of the robot itself


@pytest.fixture(params=["gripper", pytest.param("two_arms", marks=pytest.mark.slow), "leg"])
def many(request):
    """A robot, and motions of it; the second one has spare motors, the third idle freedoms."""
    loop = gallery(request.param)
    moving = trees.motions(loop, 40, seed=5, spread=0.2)
    if request.param == "leg":
        rows = zip(moving.q, moving.v, moving.a, strict=True)
        moving.a = np.array([loop.hybrid_dynamics(q, v, a[loop.actuated_v]).a for q, v, a in rows])
    return loop, moving


def alike(found, general, names, allowed=1e-12, size=1.0):
    for name in names:
        mine, theirs = getattr(found, name), getattr(general, name)
        np.testing.assert_array_equal(np.isnan(mine), np.isnan(theirs))
        off = np.nanmax(np.abs(mine - theirs), initial=0.0)
        assert off <= allowed * max(size, float(np.nanmax(np.abs(theirs), initial=0.0))), name
    assert {i: str(e) for i, e in found.errors.items()} == {i: str(e) for i, e in general.errors.items()}


@needs_compiler
def test_many_samples_of_a_robot_by_what_is_compiled(many):
    loop, moving = many
    moving.q[7] = moving.q[0]
    moving.v[7] += 1.0  # opens the loops: an error, and no number
    frame = loop.model.frames[loop.model.nframes - 1].name
    acting = {frame: np.random.default_rng(0).normal(0, 3, (len(moving.q), 6))}
    joints = np.linspace(-1, 1, loop.model.nv) if len(loop.actuated) >= loop.mobility(moving.q[0]) else None
    acting = {} if joints is None else acting
    given = moving.q, moving.v, moving.a, acting, joints
    general, found = (loop.inverse_dynamics_batch(*given, method=m) for m in ("general", "compiled"))
    assert list(found.errors) == [7]
    assert type(found) is type(general)
    alike(found, general, ("tau", "closure_error", "conditioning"))
    # What residuals are the rounding of: forces at the closures, too.
    rows = zip(moving.q[:3], moving.v[:3], moving.a[:3], strict=True)
    largest_force = max(np.abs(loop.inverse_dynamics(*row).lambda_).max() for row in rows)
    alike(found, general, ("residual",), size=max(1.0, largest_force))
    if joints is None:
        return  # they take long to compile
    tau = np.nan_to_num(general.tau)
    given = moving.q, moving.v, tau, acting, joints
    general, found = (loop.forward_dynamics_batch(*given, method=m) for m in ("general", "compiled"))
    assert list(found.errors) == [7]
    alike(found, general, ("closure_error",))
    alike(found, general, ("residual",), size=max(1.0, largest_force))
    alike(found, general, ("a", "closure_residual"), 1e-10)
    if len(loop.actuated) > loop.mobility(moving.q[0]):
        return
    given = moving.q, moving.v, moving.a[:, loop.actuated_v], None, acting, joints
    general, found = (loop.hybrid_dynamics_batch(*given, method=m) for m in ("general", "compiled"))
    alike(found, general, ("tau", "closure_error", "conditioning"))
    alike(found, general, ("residual",), size=max(1.0, largest_force))
    alike(found, general, ("a",), 1e-10)


@needs_compiler
def test_the_first_sample_that_fails_may_end_it():
    loop = gallery("gripper")
    moving = trees.motions(loop, 30, seed=5)
    moving.v[[11, 20]] += 1.0
    given = moving.q, moving.v, moving.a
    general, found = (loop.inverse_dynamics_batch(*given, stop=True, method=m) for m in METHODS)
    assert list(found.errors) == list(general.errors) == [11]
    assert np.isnan(found.tau[11:]).all()
    np.testing.assert_allclose(found.tau[:11], general.tau[:11], rtol=1e-12, atol=1e-12)


METHODS = ("general", "compiled")


@needs_compiler
@pytest.mark.parametrize("name", ["gripper", "five_bar"])
def test_motions_of_all_joints_by_what_is_compiled(name):
    loop = gallery(name)
    home = loop.assemble().q
    at = [loop.model.joints[loop.model.getJointId(joint)].idx_q for joint in loop.actuated]
    time = np.linspace(0, 1, 300)[:, None]
    wide = 0.3 if name == "five_bar" else 0.1
    targets = home[at] + wide * np.sin(2 * np.pi * time + np.arange(len(at)))
    shuffled = np.random.default_rng(1).permutation(targets)
    for values in (targets, shuffled, targets[:1]):
        rates = np.cos(values), np.sin(values)
        general, found = (loop.complete_batch(values, *rates, method=m) for m in METHODS)
        assert type(found) is type(general)
        np.testing.assert_array_equal(found.same_assembly, general.same_assembly)
        alike(found, general, ("q", "v", "influence", "inverse_jacobian"), 1e-12)
        alike(found, general, ("a",), 1e-11)
    beyond = np.concatenate([targets[:20], targets[:1] + 40.0, targets[20:40]])
    rates = np.zeros_like(beyond), np.zeros_like(beyond)
    general, found = (loop.complete_batch(beyond, *rates, method=m) for m in METHODS)
    alike(found, general, ("q", "v", "a"), 1e-12)


@needs_compiler
def test_what_is_compiled_is_kept_while_the_robot_stays_as_it_is():
    loop = gallery("four_bar")
    moving = trees.motions(loop, 20, seed=2)
    given = moving.q, moving.v, moving.a
    first = loop.inverse_dynamics_batch(*given, method="compiled")
    kept = loop.compiled_for(moving.q[0])
    assert loop.compiled_for(moving.q[1]) is kept
    loop.model.inertias[1] = pin.Inertia(7.0, np.array([0.1, 0.2, 0.0]), np.eye(3))
    assert loop.compiled_for(moving.q[0]) is not kept
    general, found = (loop.inverse_dynamics_batch(*given, method=m) for m in METHODS)
    assert np.abs(found.tau - first.tau).max() > 0.1
    np.testing.assert_allclose(found.tau, general.tau, rtol=1e-12, atol=1e-12)
    with pytest.raises(InputError, match=r"method: it was compiled for another robot"):
        loop.inverse_dynamics_batch(*given, method=kept)
    with pytest.raises(InputError, match=r"method: expected 'general', 'compiled' or what"):
        loop.inverse_dynamics_batch(*given, method="fast")
    other = pickle.loads(pickle.dumps(loop))  # noqa: S301 - our own
    np.testing.assert_array_equal(other.inverse_dynamics_batch(*given, method="compiled").tau, found.tau)


@pytest.mark.parametrize("level", ["auto", "baseline", "numpy"])
def test_tangents_and_angles_come_from_the_same_text_as_the_kernels(level):
    tape = Tape()
    x, y = tape.symbols(("x", "y"))
    results = tape.tanh(x), tape.atan2(y, x), tape.floor(x)
    used = Function("angles", tape, {"x": 1, "y": 1}, {"t": 1, "a": 1, "f": 1}, (x, y), results)
    source = printing.lanes_source([used])
    assert "EACH(tanh)" not in source
    library = None
    if level != "numpy":
        if not build.compiler():
            pytest.skip("no C compiler")
        (library,) = build.libraries([source], level)
    rng = np.random.default_rng(2)
    given = {"x": rng.normal(0, 5, (1003, 1)), "y": rng.normal(0, 5, (1003, 1))}
    given["x"][:4, 0], given["y"][:4, 0] = (np.inf, -1.0, 0.0, np.nan), (1.0, 0.0, 0.0, 1.0)
    kernel = Kernel(used, library)
    found = kernel(1003, given, 2)
    x, y = given["x"], given["y"]
    # Not NumPy's own in double precision, some of whose vectors are worse than the C library.
    y_long, x_long = y.astype(np.longdouble), x.astype(np.longdouble)
    np.testing.assert_allclose(found["t"], np.tanh(x_long).astype(float), rtol=4e-16)
    np.testing.assert_allclose(found["a"], np.arctan2(y_long, x_long).astype(float), rtol=4e-16)
    np.testing.assert_array_equal(found["f"], np.floor(x))
    one = kernel.bound()
    one.inputs["x"][:], one.inputs["y"][:] = -3.0, 0.5
    one.run()
    np.testing.assert_allclose(
        [one.outputs["t"][0], one.outputs["a"][0]], [np.tanh(-3), np.arctan2(0.5, -3)], rtol=4e-16
    )
