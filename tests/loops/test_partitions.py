"""Joints that follow from others: what is remembered of them is quick, and never wrong."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import (
    FIVE_BAR_SIDECAR,
    FOUR_BAR,
    FOUR_BAR_SIDECAR,
    five_bar,
    five_bar_q,
    four_bar,
    four_bar_q,
)
from gallery import GALLERY

import p3dof
from p3dof import ClosedLoopModel
from p3dof._base.errors import P3dofError, SingularityError
from p3dof.loops.closed_tree import ClosedTree
from p3dof.loops.linear import least_norm, orientation

ROBOTS = ("stewart", "delta", "five_bar", "four_bar", "gripper", "paper")
EVIDENCE = ("unique", "tau_unique", "rank", "mobility", "conditioning")


def robot(name: str) -> ClosedLoopModel:
    if name == "paper":
        return p3dof.load().loop.copy()
    return p3dof.load_robot(GALLERY / f"{name}.urdf", GALLERY / f"{name}.yaml")


def core(loop: ClosedLoopModel) -> ClosedTree:
    return loop._scaled.core


def state(loop, seed, spread=0.2):
    """A configuration near the reference, closed, and a motion that keeps it so."""
    rng = np.random.default_rng(seed)
    home = loop.assemble(None, loop.reference).q
    q = loop.assemble(None, pin.integrate(loop.model, home, spread * rng.uniform(-1, 1, loop.model.nv))).q
    return q, *moving(loop, q, rng)


def moving(loop, q, rng):
    inner, at = core(loop), loop._scaled.q(q)
    point = inner.kinematics.at(at)
    N = point.svd.null_space
    v = N @ rng.normal(size=N.shape[1])
    inner.kinematics.move(at, v)
    a = N @ rng.normal(size=N.shape[1]) - point.svd.solve(inner.kinematics.acceleration())
    return v * loop._scaled.of_v, a * loop._scaled.of_v


def careful(monkeypatch, loop):
    """Let singular value decompositions decide on everything."""
    dynamics = core(loop).dynamics
    for solver in (dynamics.inverse, dynamics.forward, dynamics.hybrid):
        monkeypatch.setattr(solver, "_partitioned", lambda *_: None)
    return loop


@pytest.mark.parametrize("name", ROBOTS)
def test_forces_and_evidence_are_those_of_singular_value_decompositions(name, monkeypatch):
    quick, slow = robot(name), careful(monkeypatch, robot(name))
    for seed in range(8):
        q, v, a = state(quick, seed)
        some = a[quick.actuated_v]
        for one, other in (
            (quick.hybrid_dynamics(q, v, some), slow.hybrid_dynamics(q, v, some)),
            (quick.forward_dynamics(q, v, some), slow.forward_dynamics(q, v, some)),
        ):
            np.testing.assert_allclose(one.a, other.a, rtol=0, atol=1e-9 * np.abs(other.a).max())
            np.testing.assert_allclose(
                one.lambda_, other.lambda_, rtol=0, atol=1e-9 * np.abs(other.lambda_).max()
            )
        a = quick.hybrid_dynamics(q, v, some).a  # so that idle freedoms need no force
        one, other = quick.inverse_dynamics(q, v, a), slow.inverse_dynamics(q, v, a)
        size = max(np.abs(other.tau).max(), np.abs(other.lambda_).max())
        np.testing.assert_allclose(one.tau, other.tau, rtol=0, atol=1e-10 * size)
        np.testing.assert_allclose(one.lambda_, other.lambda_, rtol=0, atol=1e-10 * size)
        for what in EVIDENCE:
            np.testing.assert_allclose(getattr(one, what), getattr(other, what), rtol=1e-9)
        assert max(one.residual, other.residual) <= 1e-12 * size
        assert one.gap == other.gap


@pytest.mark.parametrize("name", ROBOTS)
def test_usual_calls_decompose_no_singular_values(name, monkeypatch):
    loop = robot(name)
    q, v, a = state(loop, 0)
    wanted = a[loop.actuated_v]
    a = loop.hybrid_dynamics(q, v, wanted).a
    other = state(loop, 1)

    def calls(q, v, a):
        found = loop.inverse_dynamics(q, v, a)
        loop.forward_dynamics(q, v, found.tau)
        loop.hybrid_dynamics(q, v, a[loop.actuated_v])

    calls(q, v, a)
    loop.closure_error(other[0])  # nothing is left over of the first
    for routine in ("svd", "lstsq", "pinv"):
        monkeypatch.setattr(np.linalg, routine, None)
    calls(q, v, a)


def test_what_is_remembered_fits_nowhere_else():
    """Jumps across the whole range, and to other assemblies, give what a fresh model gives."""
    loop = ClosedLoopModel.from_urdf(four_bar(*FOUR_BAR), FOUR_BAR_SIDECAR)
    rng, kept = np.random.default_rng(0), set()
    for theta in rng.permutation(np.linspace(0, 2 * np.pi, 41)):
        q = four_bar_q(theta, *FOUR_BAR)
        q = loop.assemble(None, rng.choice([1.0, -1.0]) * q).q  # below the ground: the other assembly
        v, a = moving(loop, q, rng)
        tau = rng.normal(size=1)
        fresh = loop.copy()
        forces, expected = (model.inverse_dynamics(q, v, a).tau for model in (loop, fresh))
        np.testing.assert_allclose(forces, expected, rtol=1e-9)
        rates, expected = (model.forward_dynamics(q, v, tau).a for model in (loop, fresh))
        np.testing.assert_allclose(rates, expected, rtol=1e-9)
        kept.add(id(loop._tree.dynamics.forward._memory._partition))
    assert len(kept) < 20  # it is remembered, though


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3])
def test_near_a_singularity_forces_and_errors_are_those_of_a_careful_model(off, monkeypatch):
    """Both elbows of a five-bar at one place: the motors do not hold its tip."""
    loop, slow = (ClosedLoopModel.from_urdf(five_bar(), FIVE_BAR_SIDECAR) for _ in range(2))
    careful(monkeypatch, slow)
    usual = five_bar_q(2.0, 1.0)
    loop.inverse_dynamics(usual, *moving(loop, usual, np.random.default_rng(0)))  # something to remember
    left = np.arctan2(0.2, 0.15)  # the elbow is above the middle of the ground
    q = np.array([left, 1.0 - left, np.pi - left, 1.0 - np.pi + left])
    if off:
        q = five_bar_q(left, np.pi - left + off)
    N = loop._tree.kinematics.at(q).svd.null_space  # from rest, as not every velocity can be kept there
    motion = np.zeros(4), N @ np.random.default_rng(1).normal(size=N.shape[1])
    one, other = outcome(loop, q, *motion), outcome(slow, q, *motion)
    assert type(one) is type(other)
    if isinstance(one, P3dofError):
        assert off <= 1e-9
        assert isinstance(one, SingularityError)
        assert str(one) == str(other)
    else:
        np.testing.assert_allclose(one.conditioning, other.conditioning, rtol=1e-6)
        np.testing.assert_allclose(one.tau, other.tau, rtol=0, atol=1e-9 * np.abs(other.tau).max())


def outcome(loop, q, v, a):
    try:
        return loop.inverse_dynamics(q, v, a)
    except P3dofError as error:
        return error


def test_masses_and_gravity_are_those_of_now():
    loop = robot("stewart")
    q, v, a = state(loop, 2)
    loop.inverse_dynamics(q, v, a)
    tau = loop.hybrid_dynamics(q, v, a[loop.actuated_v]).tau
    loop.forward_dynamics(q, v, tau)
    for inertia in list(loop.model.inertias)[1:]:
        inertia.mass *= 2.0
        inertia.inertia *= 2.0
    loop.model.gravity.linear = np.array([0.0, 0.0, -1.62])
    fresh = ClosedLoopModel(loop.model.copy(), loop.sidecar)
    a = fresh.hybrid_dynamics(q, v, a[loop.actuated_v]).a
    np.testing.assert_allclose(loop.hybrid_dynamics(q, v, a[loop.actuated_v]).a, a, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        loop.inverse_dynamics(q, v, a).tau, fresh.inverse_dynamics(q, v, a).tau, rtol=1e-12
    )
    assert not np.allclose(loop.inverse_dynamics(q, v, a).tau, tau)
    np.testing.assert_allclose(
        loop.forward_dynamics(q, v, tau).a, fresh.forward_dynamics(q, v, tau).a, rtol=1e-9, atol=1e-9
    )


def test_results_keep_their_evidence_whatever_the_model_does_next():
    loop = robot("stewart")
    q, v, a = state(loop, 4)
    a = loop.hybrid_dynamics(q, v, a[loop.actuated_v]).a
    first = loop.inverse_dynamics(q, v, a)
    sent = pickle.loads(pickle.dumps(first))  # noqa: S301 - our own
    told = {what: np.copy(getattr(loop.copy().inverse_dynamics(q, v, a), what)) for what in EVIDENCE}
    loop.inverse_dynamics(
        *state(loop, 5)[:1], np.zeros(loop.model.nv), np.zeros(loop.model.nv)
    ) if False else None
    loop.model.inertias[1].mass *= 3.0
    loop.forward_dynamics(state(loop, 6)[0], np.zeros(loop.model.nv), np.zeros(6))
    for result in (first, sent):
        for what in EVIDENCE:
            np.testing.assert_array_equal(getattr(result, what), told[what])
        assert result.residual <= 1e-12 * np.abs(result.lambda_).max()
    for array in (first.tau, first.lambda_, first.unique):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_copies_remember_for_themselves():
    loop = robot("delta")
    states = [state(loop, seed) for seed in range(12)]
    states = [(q, v, loop.hybrid_dynamics(q, v, a[loop.actuated_v]).a) for q, v, a in states]
    expected = [loop.inverse_dynamics(*one).tau for one in states]

    def work(copy):
        return [copy.inverse_dynamics(*one).tau for one in states for _ in range(20)][::20]

    with ThreadPoolExecutor(3) as pool:
        for found in pool.map(work, [loop.copy() for _ in range(3)]):
            np.testing.assert_array_equal(found, expected)


def test_a_frame_can_be_prescribed_quickly(monkeypatch):
    loop, slow = robot("stewart"), careful(monkeypatch, robot("stewart"))
    q, v, _ = state(loop, 7)
    frame = loop.model.frames[-1].name
    wanted = np.linspace(-1, 1, 6)
    one, other = (model.hybrid_dynamics(q, v, {}, {frame: wanted}) for model in (loop, slow))
    np.testing.assert_allclose(one.tau, other.tau, rtol=1e-9)
    np.testing.assert_allclose(one.a, other.a, rtol=0, atol=1e-9 * np.abs(other.a).max())
    assert one.conditioning == pytest.approx(other.conditioning)


@pytest.mark.parametrize("name", ROBOTS)
def test_motions_of_a_target_are_those_of_a_pseudo_inverse(name):
    """Also where closures are redundant, and where more is asked than the mechanism can choose."""
    loop = robot(name)
    inner = core(loop)
    for seed in range(4):
        q, v, a = state(loop, seed)
        q, v, a = loop._scaled.q(q), v / loop._scaled.of_v, a / loop._scaled.of_v
        point = inner.kinematics.at(q)
        plain = [i for i in range(1, inner.model.njoints) if inner.model.nqs[i] == inner.model.nvs[i] == 1]
        for joints in (inner.joints, plain):
            target = {inner.model.names[i]: angle(inner.model, q, i) for i in joints}
            S = np.eye(inner.model.nv)[[inner.model.idx_vs[i] for i in joints]]
            A = np.concatenate((point.J, S))
            rates = S @ v
            found = inner.complete(target, rates, S @ a, q)
            inverse = np.linalg.pinv(A, rcond=1e-9)
            size = np.abs(inverse).max()
            np.testing.assert_allclose(found.influence, inverse[:, len(point.J) :], rtol=0, atol=1e-9 * size)
            np.testing.assert_allclose(found.v, found.influence @ rates, rtol=0, atol=1e-9 * size)
            assert found.determined == (np.linalg.matrix_rank(A, tol=1e-9) == inner.model.nv)
            assert (found.rank, found.mobility) == (point.svd.rank, inner.model.nv - point.svd.rank)


def angle(model, q, joint):
    at = model.idx_qs[joint]
    return q[at] if model.nqs[joint] == 1 else np.arctan2(q[at + 1], q[at])


def test_closing_loops_beside_a_solution_decomposes_no_singular_values(monkeypatch):
    loop = robot("stewart")
    q, v, _ = state(loop, 0)
    nearby = pin.integrate(loop.model, q, 0.003 * np.cos(np.arange(loop.model.nv)))
    target = {name: angle(loop.model, q, loop.model.getJointId(name)) + 0.001 for name in loop.actuated}
    rates = v[loop.actuated_v]
    expected = loop.complete(target, rates, rates, q)  # something to remember
    loop.closure_error(loop.reference)
    for routine in ("svd", "lstsq", "pinv"):
        monkeypatch.setattr(np.linalg, routine, None)
    assert loop.assemble(None, nearby).gap < 1e-12
    np.testing.assert_array_equal(loop.complete(target, rates, rates, q).a, expected.a)


def test_shortest_solutions_and_orientations_are_those_of_singular_value_decompositions():
    rng = np.random.default_rng(0)
    for m, n, rank in ((3, 5, 3), (5, 3, 3), (6, 6, 4), (6, 9, 5), (9, 6, 2), (1, 1, 1), (40, 50, 37)):
        for _ in range(10):
            A, B = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n)), rng.normal(size=(m, n))
            b = rng.normal(size=m)
            x = np.linalg.lstsq(A, b, rcond=1e-9)[0]
            np.testing.assert_allclose(least_norm(A, b, 1e-9), x, rtol=0, atol=1e-9 * np.abs(x).max())
            U, _, Vt = np.linalg.svd(A)
            assert orientation(A, B, 1e-9) == np.sign(np.linalg.det(U[:, :rank].T @ B @ Vt[:rank].T))
            assert orientation(A, A, 1e-9) == 1.0
    assert orientation(np.diag([1.0, 1e-12]), np.diag([1.0, -1.0]), 1e-9) == 1.0  # one row does not count
    assert orientation(np.diag([1.0, 1e-5]), np.diag([1.0, -1.0]), 1e-9) == -1.0
    plane, tilted = np.diag([1.0, -1.0, 0.0])[:, [1, 0, 2]], np.diag([1.0, 1.0, -1.0])[:, [1, 0, 2]]
    assert orientation(plane, tilted, 1e-9) == -1.0  # nor one that is nothing, and whatever it becomes
    assert orientation(plane[:2], -tilted[:2], 1e-9) == orientation(plane.T, -tilted.T, 1e-9) == -1.0


@pytest.mark.parametrize("way", ["partitions", "singular values"])
def test_bodies_of_little_inertia_do_not_feel_the_rounding_of_large_forces(way, monkeypatch):
    """Rods that spin about themselves between two balls, with 1e-8 of the inertia of what they carry.

    What closures bear is large; an error of Nᵀ times that, though J N = 0, would turn the rods.
    """
    loop = robot("leg")
    for name in ("left_ball", "right_ball"):
        loop.model.inertias[loop.model.getJointId(name)].inertia = 1e-8 * np.eye(3)
    if way != "partitions":
        careful(monkeypatch, loop)
    q, v, a = state(loop, 1)
    found = loop.hybrid_dynamics(q, v, a[loop.actuated_v])
    again = loop.forward_dynamics(q, v, found.tau)
    np.testing.assert_allclose(again.a, found.a, rtol=0, atol=1e-10 * np.abs(found.a).max())
