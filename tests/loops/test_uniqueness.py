"""Whether forces are unique, and how well conditioned: every door says what the test finds by itself."""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import ARM, BAR, ROD, joint, link, robot
from gallery import GALLERY

import p3dof
from p3dof._base.errors import DynamicsError, SingularityError
from p3dof.loops import ClosedLoopModel, Closure, Sidecar
from p3dof.loops.tables import overview

GROUND, CRANK, COUPLER, ROCKER = robots.FOUR_BAR
FORCES = np.array([0.0, 1.0, 0.5, 0.3])
"""What acts in the joints of the four-bar."""


def four_bar(actuated: tuple[str, ...], slides: int) -> ClosedLoopModel:
    """A four-bar whose ground slides freely along z, or stays where it is."""
    down = (0, -1, 0)
    xml = robot(
        link("world"),
        link("base", ARM),
        link("crank", ROD),
        link("coupler", BAR),
        link("rocker", ARM),
        link("coupler_tip"),
        link("rocker_tip"),
        joint("slide", "world", "base", axis=(0, 0, 1), kind="prismatic" if slides else "fixed"),
        joint("crank_joint", "base", "crank", axis=down),
        joint("coupler_joint", "crank", "coupler", (CRANK, 0, 0), axis=down),
        joint("coupler_tip_joint", "coupler", "coupler_tip", (COUPLER, 0, 0), kind="fixed"),
        joint("rocker_joint", "base", "rocker", (GROUND, 0, 0), axis=down),
        joint("rocker_tip_joint", "rocker", "rocker_tip", (ROCKER, 0, 0), kind="fixed"),
    )
    return ClosedLoopModel.from_urdf(xml, Sidecar((Closure("coupler_tip", "rocker_tip"),), actuated))


def at(before: float, slides: int) -> np.ndarray:
    """Joints at an angle of the crank before the dead point of the rocker: crank and coupler in line."""
    reach = CRANK + COUPLER
    dead = np.arccos((GROUND**2 + reach**2 - ROCKER**2) / (2 * GROUND * reach))
    if before:
        q = robots.four_bar_q(dead - before, GROUND, CRANK, COUPLER, ROCKER)
    else:
        q = np.array([dead, 0.0, np.arctan2(reach * np.sin(dead), reach * np.cos(dead) - GROUND)])
    return np.concatenate((np.zeros(slides), q))


def own_motions(q: np.ndarray, slides: int) -> np.ndarray:
    """The free motions (nv, mobility), from the loop's own vector equation in its plane."""
    crank, coupler, rocker = q[slides:]
    along = [np.array([-np.sin(x), np.cos(x)]) for x in (crank, crank + coupler, rocker)]
    first = CRANK * along[0] + COUPLER * along[1]
    J = np.column_stack([*[np.zeros(2)] * slides, first, COUPLER * along[1], -ROCKER * along[2]])
    return np.linalg.svd(J)[2][2:].T


def own_evidence(N: np.ndarray, actuated_v: np.ndarray) -> tuple[int, float]:
    """How many forces of the actuators do something, each on its own, and the conditioning."""
    s = np.linalg.svd(N[actuated_v].T, compute_uv=False)
    return np.count_nonzero(s > 1e-9), s.min()


@pytest.mark.parametrize("before", [0.0, 1e-11, 1e-7, 1e-4, 0.02, 0.5])
@pytest.mark.parametrize(
    ("actuated", "slides"),
    [
        (("rocker_joint",), 1),  # fewer than freedoms
        (("rocker_joint",), 0),
        (("crank_joint",), 0),
        (("crank_joint", "rocker_joint"), 0),  # one to spare
        (("crank_joint", "rocker_joint"), 1),  # one to spare, and one too few
    ],
)
def test_every_door_says_the_same_of_a_four_bar_near_its_dead_point(actuated, slides, before):
    loop, q = four_bar(actuated, slides), at(before, slides)
    N, n, count = own_motions(q, slides), 10, len(actuated)
    rank, least = own_evidence(N, loop.actuated_v)
    close = {"rtol": 1e-9, "atol": 1e-14}  # the second of rounding in J, whose entries are below 1
    zero, forces = np.zeros(loop.model.nv), FORCES[1 - slides :]
    a = loop.forward_dynamics(q, zero, np.ones(count), joint_forces=forces).a
    acting, many = {"joint_forces": forces}, (np.tile(q, (n, 1)), np.zeros((n, len(zero))))
    if rank < N.shape[1] <= count:
        with pytest.raises(SingularityError):
            loop.inverse_dynamics(q, zero, a, **acting)
    else:
        found = loop.inverse_dynamics(q, zero, a, **acting)
        assert found.tau_unique == (rank == count)
        np.testing.assert_allclose(found.conditioning, least, **close)
        compiled = [loop.compile(around=q, joint_forces=True, level="numpy")] if before > 1e-3 else []
        for method in ("general", *compiled):
            batch = loop.inverse_dynamics_batch(*many, np.tile(a, (n, 1)), **acting, method=method)
            assert not batch.errors
            np.testing.assert_allclose(batch.conditioning, least, **close)
    wanted = np.zeros((n, count))
    batch = loop.hybrid_dynamics_batch(*many, wanted, **acting)
    if rank == count:
        found = loop.hybrid_dynamics(q, zero, wanted[0], **acting)
        assert found.tau_unique
        assert not batch.errors
        for conditioning in (found.conditioning, found.prescribed_conditioning, batch.conditioning):
            np.testing.assert_allclose(conditioning, least, **close)
    else:  # nobody can choose all of these accelerations
        with pytest.raises(DynamicsError, match="depend on each other"):
            loop.hybrid_dynamics(q, zero, wanted[0], **acting)
        assert [type(error) for error in batch.errors.values()] == [DynamicsError] * n
    assert overview(loop, q).held == rank


def test_where_forces_are_not_unique_they_can_change_without_any_effect():
    """The force of the rocker at its dead point; beside it a change is felt."""
    zero, changes = np.zeros(4), []
    for before in (0.0, 1e-4):
        loop, q = four_bar(("rocker_joint",), slides=1), at(before, slides=1)
        a, b = (loop.forward_dynamics(q, zero, [tau], joint_forces=FORCES).a for tau in (0.0, 42.5))
        changes.append(np.abs(a - b).max() / np.abs(a).max())
    assert changes[0] < 42.5 * 1e-13
    assert changes[1] > 1e-4


@pytest.mark.parametrize("name", ["five_bar", "delta", "leg", "biped", "two_arms"])
def test_every_door_says_the_same_of_a_gallery_robot(name):
    """Regular poses of robots with redundant closures, idle freedoms, and actuators to spare."""
    loop = p3dof.load_robot(GALLERY / f"{name}.urdf")
    generator, count, size, model = np.random.default_rng(1), 12, len(loop.actuated), loop.model
    steps = 0.05 * generator.normal(size=(count, model.nv))
    q = np.array([loop.assemble(None, guess=pin.integrate(model, loop.reference, step)).q for step in steps])
    zero, tau = np.zeros((count, loop.model.nv)), generator.normal(size=(count, size))
    a = np.array([loop.forward_dynamics(q[i], zero[i], tau[i]).a for i in range(count)])
    batch = loop.inverse_dynamics_batch(q, zero, a)
    hybrid = loop.hybrid_dynamics_batch(q, zero, a[:, loop.actuated_v])
    for i in range(count):
        N = np.linalg.svd(loop.closure_jacobian(q[i]))[2][loop.rank(q[i]) :].T
        rank, least = own_evidence(N, loop.actuated_v)
        unique = rank == size
        one = loop.inverse_dynamics(q[i], zero[i], a[i])
        assert one.tau_unique == unique == (size <= N.shape[1])
        assert one.conditioning == pytest.approx(least, rel=1e-9)
        assert batch.conditioning[i] == pytest.approx(least, rel=1e-9)
        if unique:
            found = loop.hybrid_dynamics(q[i], zero[i], a[i, loop.actuated_v])
            assert (found.tau_unique, found.conditioning) == (True, pytest.approx(least, rel=1e-9))
            assert hybrid.conditioning[i] == pytest.approx(least, rel=1e-9)
    assert bool(hybrid.errors) == (not unique)
