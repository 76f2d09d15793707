"""Runs of robots whose dynamics are compiled, against those of the general layer."""

import gc
import weakref
from dataclasses import replace
from functools import cache

import closed_trees as trees
import numpy as np
import pinocchio as pin
import pytest
from gallery import GALLERY

import p3dof
from p3dof._base.errors import InputError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiled import build
from p3dof.runs import (
    ControlLoop,
    Integration,
    JointComputedTorque,
    JointPD,
    JointReference,
    follow_motion,
    simulate_robot,
)

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler here")
FINE = Integration(rtol=1e-11, atol=1e-13)


def gallery(name):
    return p3dof.load_robot(GALLERY / f"{name}.urdf")


@cache
def kept(name):
    """A robot of the gallery, compiled once for all runs."""
    loop = gallery(name)
    return loop, loop.compile()


def both(loop, compiled, *arguments, **options):
    return [simulate_robot(loop, *arguments, **options, method=method) for method in ("general", compiled)]


@pytest.mark.parametrize("beta", [0.0, 10.0, 300.0])
def test_accelerations_of_loops_that_drifted_open(beta):
    rng = np.random.default_rng(0)
    for name in ("five_bar", "two_arms", "leg"):
        loop = gallery(name)
        compiled = loop.compile(level="numpy")
        moving = trees.motions(loop, 3, seed=1, spread=0.2)
        q = np.array(
            [pin.integrate(loop.model, row, 1e-9 * rng.normal(size=loop.model.nv)) for row in moving.q]
        )
        v = moving.v + 1e-7 * rng.normal(size=moving.v.shape)
        tau = rng.normal(size=(3, len(loop.actuated)))
        found = compiled.forward_dynamics(q, v, tau, stabilisation=beta)
        plain = compiled.forward_dynamics(moving.q, moving.v, tau)
        assert not found.general.any()
        for i in range(3):
            one = loop.forward_dynamics(q[i], v[i], tau[i], stabilisation=beta).a
            size = np.abs(one).max()
            np.testing.assert_allclose(found.a[i], one, rtol=0, atol=1e-6 * size)
            if beta == 300.0:  # what it takes is there at all
                assert np.abs(found.a[i] - plain.a[i]).max() > 1e-5
        if compiled.hybrid:
            wanted = rng.normal(size=(3, len(loop.actuated)))
            found = compiled.hybrid_dynamics(q, v, wanted, stabilisation=beta)
            for i in range(3):
                one = loop.hybrid_dynamics(q[i], v[i], wanted[i], stabilisation=beta)
                np.testing.assert_allclose(found.a[i], one.a, rtol=0, atol=1e-6 * np.abs(one.a).max())


def test_a_negative_stabilisation_is_refused():
    _, compiled = kept("five_bar")
    with pytest.raises(InputError, match=r"stabilisation: expected zero or more, got -1"):
        compiled.forward_dynamics(np.zeros(4), np.zeros(4), np.zeros(2), stabilisation=-1.0)


@pytest.mark.parametrize("name", ["five_bar", pytest.param("stewart", marks=pytest.mark.slow)])
def test_a_run_and_its_drift_are_the_same(name):
    loop, compiled = kept(name)
    options = {"samples": 51, "stop_at": ["singular closures"], "integration": FINE}
    general, fast = both(loop, compiled, 0.4, **options)
    assert fast.finished
    np.testing.assert_allclose(fast.q, general.q, rtol=0, atol=1e-8)
    np.testing.assert_allclose(fast.v, general.v, rtol=0, atol=1e-7)
    np.testing.assert_allclose(fast.energy, general.energy, rtol=0, atol=1e-8 * np.abs(general.energy).max())
    assert fast.gap.max() <= 3 * general.gap.max() + 1e-15
    # A loop that starts a little open closes: at rest nothing else moves it.
    open_by = [run.gap for run in both(loop, compiled, 0.4, pushed(loop), **options)]
    for gap in open_by:
        assert gap[0] > 1e-11
    assert open_by[1][-1] <= 3 * open_by[0][-1] + 1e-13
    assert open_by[1][-1] <= 0.2 * open_by[1][0]


def pushed(loop):
    """A start whose loops are open by as much as a run may start with."""
    q = np.array(loop.assemble().q)
    q[0] += 3e-10
    return q


@pytest.mark.parametrize("name", [pytest.param("delta", marks=pytest.mark.slow), "gripper"])
def test_runs_end_for_the_same_reasons_at_the_same_times(name):
    loop, compiled = kept(name)
    general, fast = both(loop, compiled, 1.0, controller=0.3 * np.arange(len(loop.actuated)), samples=21)
    assert general.stop is not None
    assert fast.stop.kind == general.stop.kind
    if name == "delta":  # the gripper's limits come in pairs
        assert fast.stop.reason == general.stop.reason
    assert fast.stop.time == pytest.approx(general.stop.time, abs=1e-6)


@pytest.mark.slow
def test_wrenches_and_controllers_of_a_compiled_robot():
    loop = gallery("stewart")
    compiled = loop.compile(external=["platform"])
    q = loop.assemble().q
    target = JointReference.standing(
        np.array([q[loop.model.joints[loop.model.getJointId(n)].idx_q] for n in loop.actuated])
    )
    load = {"platform": [40.0, 0, -60.0, 0, 5.0, 0]}
    options = {"control": ControlLoop(200.0), "external": load, "samples": 21}
    for general, fast in (
        (JointPD(loop, target, 4e4, 4e2, gravity=True), JointPD(loop, target, 4e4, 4e2, True, compiled)),
        (JointComputedTorque(loop, target, 400, 40), JointComputedTorque(loop, target, 400, 40, compiled)),
    ):
        first = simulate_robot(loop, 0.1, controller=general, method="general", **options)
        second = simulate_robot(loop, 0.1, controller=fast, method=compiled, **options)
        np.testing.assert_allclose(second.q, first.q, rtol=0, atol=1e-9)
        np.testing.assert_allclose(
            second.forces, first.forces, rtol=0, atol=1e-6 * np.abs(first.forces).max()
        )
        assert np.abs(first.q - q).max() > 1e-5  # the load moves it


def test_a_motion_is_followed_with_idle_freedoms():
    loop, compiled = kept("leg")
    home = loop.assemble().q
    places = [loop.model.joints[loop.model.getJointId(name)].idx_q for name in loop.actuated]
    time = np.linspace(0.0, 0.3, 7)
    values = home[places] + 0.1 * np.sin(np.pi * time[:, None] / 0.3) ** 2
    motion = JointReference(time, values)
    general, fast = (follow_motion(loop, motion, samples=31, method=m) for m in ("general", compiled))
    np.testing.assert_allclose(fast.forces, general.forces, rtol=0, atol=1e-5 * np.abs(general.forces).max())
    np.testing.assert_allclose(fast.q, general.q, rtol=0, atol=1e-6)


def test_what_cannot_be_used_is_told():
    loop, compiled = kept("five_bar")
    other = gallery("five_bar")
    other.model.inertias[1].mass *= 2
    with pytest.raises(InputError, match=r"method: it was compiled for another robot"):
        simulate_robot(other, 0.1, method=compiled)
    with pytest.raises(InputError, match=r"method: it was compiled without wrenches on 'base'"):
        simulate_robot(loop, 0.1, method=compiled, external={loop.model.frames[1].name: np.ones(6)})
    with pytest.raises(InputError, match=r"method: expected 'general', 'compiled' or what"):
        simulate_robot(loop, 0.1, method="fast")
    with pytest.raises(InputError, match=r"compiled: it was compiled for another robot"):
        JointPD(other, np.zeros(2), 1.0, compiled=compiled)


def test_a_start_far_from_the_reference_is_compiled_for():
    bar = gallery("four_bar")
    loop = ClosedLoopModel(bar.model, replace(bar.sidecar, actuated=("rocker_joint",)))
    at, least = loop.assemble().q, np.inf
    compiled = loop.compile(level="numpy")
    for angle in np.linspace(0.0, 2 * np.pi, 361):
        at = loop.assemble({"crank_joint": angle}, guess=at).q
        if compiled.margin(at) < least:
            start, least = at, compiled.margin(at)
    assert least < 0.05
    runs = [simulate_robot(loop, 0.05, start, samples=6, method=m) for m in ("general", "compiled")]
    np.testing.assert_allclose(runs[1].q, runs[0].q, rtol=0, atol=1e-9)


def test_accelerations_near_a_singular_partition_are_right_or_the_general_layers():
    loop = gallery("stewart")
    compiled = loop.compile(level="numpy")
    run = simulate_robot(loop, 0.9, samples=1801, stop_at=[], method="compiled")
    margins = np.array([compiled.margin(q) for q in run.q])
    near = np.flatnonzero(margins < 0.05)
    assert margins[near].min() < 0.01
    for i in near:
        q = loop.assemble(None, guess=run.q[i]).q
        N = trees.free(loop, q)
        v = N @ (N.T @ run.v[i])
        found, one = (x.forward_dynamics(q, v, run.forces[i]).a for x in (compiled, loop))
        assert np.abs(found - one).max() <= 2e-12 * np.abs(one).max()


@pytest.mark.usefixtures("young")
def test_a_bound_call_keeps_what_it_reads_and_writes():
    _, compiled = kept("five_bar")
    bound = compiled.bind("inverse_dynamics")
    run, pointers = bound.run, weakref.ref(bound._pointers)
    del bound
    gc.collect()
    assert pointers() is not None
    run()
