"""The kernels against the full formulas, at every level of the processor; bad samples beside good ones."""

from __future__ import annotations

import multiprocessing
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from machines import (
    SEEDS,
    conditioning,
    derivative,
    random_friction,
    random_machine,
    random_states,
    virtual_power_forces,
)

import p3dof
from p3dof._base.errors import InputError, ReachError, SingularityError
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled import MachineKernels, levels
from p3dof.closed_form.compiled.kernels import pose_at
from p3dof.closed_form.paper.formulas import Lengths, configuration, jacobian
from p3dof.closed_form.paper.friction import generalized_losses, losses_of
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import Friction
from p3dof.methods import compiled
from p3dof.methods.compiled import CompiledMethod
from p3dof.runs.controllers import Measurement

HOME = np.zeros(3)


class dynamics:  # noqa: N801 - what the compiled way does with kernels of any level
    @staticmethod
    def forces(kernels, q, v, a, wrench=None, on_invalid="raise"):
        return CompiledMethod(kernels).forces(states_of(q, v, a, wrench=wrench, on_invalid=on_invalid))

    @staticmethod
    def forward_dynamics(kernels, q, v, f, wrench=None, on_invalid="raise"):
        states = states_of(q, v, forces=f, wrench=wrench, on_invalid=on_invalid)
        return CompiledMethod(kernels).accelerate(states)

    @staticmethod
    def inverse_dynamics_derivatives(kernels, q, v, a, wrench=None, on_invalid="raise"):
        states = states_of(q, v, a, wrench=wrench, on_invalid=on_invalid)
        return compiled.inverse_dynamics_derivatives(kernels, states)

    @staticmethod
    def mass_matrix(kernels, q, on_invalid="raise"):
        return CompiledMethod(kernels).mass_matrix(states_of(q, on_invalid=on_invalid))

    @staticmethod
    def jacobian(kernels, q, on_invalid="raise"):
        return CompiledMethod(kernels).jacobian(states_of(q, on_invalid=on_invalid))

    @staticmethod
    def sliders(kernels, q, on_invalid="raise"):
        return compiled.sliders(kernels, states_of(q, on_invalid=on_invalid))


TURN = float(np.arccos(0.25 / 0.5))
"""θ of the paper's machine at which the sliders lose hold of the platform, y = 0 [rad]."""


@pytest.fixture(params=levels())
def level(request):
    return request.param


def machine_of(seed):
    """Machines without symmetry, with it, with friction, and the paper's."""
    rng = np.random.default_rng(seed)
    machine = random_machine(seed)
    if seed % 4 == 1:
        machine = replace(p3dof.SOLIDS if seed % 8 == 1 else p3dof.PAPER)
    return replace(machine, friction=random_friction(rng)) if seed % 3 == 0 else machine


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_they_are_the_full_formulas(seed):
    machine = machine_of(seed)
    states = random_states(machine, seed, 30)
    motion = states.pose, states.velocity, states.acceleration
    wrench = states.wrench if seed % 2 else None
    expected = virtual_power_forces(machine, *motion, wrench)
    close = conditioning(machine.geometry, states.pose)[:, None]
    full = p3dof.load(machine)
    M = full.mass_matrix(states.pose, method="virtual-power")
    acceleration = full.forward_dynamics(*motion[:2], expected, wrench=wrench, method="virtual-power")
    J = kinematics.inverse_jacobian(machine.geometry, states.pose)
    sliders = kinematics.inverse_kinematics(machine.geometry, states.pose).sliders
    for name in levels():
        kernels = MachineKernels(machine, name)
        found = dynamics.forces(kernels, *motion, wrench)
        assert np.all(np.abs(found - expected) < 1e-12 * close * np.abs(expected).max())
        found = dynamics.inverse_dynamics_derivatives(kernels, *motion, wrench).forces
        assert np.all(np.abs(found - expected) < 1e-12 * close * np.abs(expected).max())
        found = dynamics.forward_dynamics(kernels, *motion[:2], expected, wrench)
        error = np.abs(found - acceleration) / np.maximum(1, np.linalg.cond(M))[:, None]
        assert np.all(error < 1e-12 * close * np.abs(acceleration).max())
        found = dynamics.mass_matrix(kernels, states.pose)
        np.testing.assert_allclose(found, M, rtol=0, atol=1e-12 * np.abs(M).max())
        found = dynamics.jacobian(kernels, states.pose)
        np.testing.assert_allclose(found, J, rtol=0, atol=1e-12 * np.abs(J).max())
        found = dynamics.sliders(kernels, states.pose)
        np.testing.assert_allclose(found, sliders, rtol=0, atol=1e-14 * machine.geometry.L)


@pytest.mark.slow
def test_a_million_random_samples_of_random_machines():
    count, machines = 20_000, 50
    for seed in range(machines):
        machine = random_machine(seed) if seed % 5 else p3dof.PAPER
        states = random_states(machine, seed, count)
        motion = states.pose, states.velocity, states.acceleration
        expected = virtual_power_forces(machine, *motion)
        bound = 1e-12 * conditioning(machine.geometry, states.pose) * np.abs(expected).max()
        for level in levels():
            found = dynamics.forces(MachineKernels(machine, level), *motion)
            assert np.all(np.abs(found - expected).max(axis=1) < bound), level


@given(seed=SEEDS)
@settings(max_examples=12, deadline=None)
def test_derivatives_are_those_of_the_full_formulas(seed):
    machine = machine_of(seed)
    states = random_states(machine, seed, 8, drop=0.3, angle=0.3)
    given_ = [states.pose, states.velocity, states.acceleration]
    if machine.friction:  # tanh turns around within mm/s: leave that to the test of one joint
        machine = replace(machine, friction=replace(machine.friction, smoothing=1.0))
    found = dynamics.inverse_dynamics_derivatives(MachineKernels(machine), *given_, states.wrench)
    size = machine.geometry.L
    for which, by in enumerate((found.by_pose, found.by_velocity, found.by_acceleration)):
        for axis in range(3):

            def moved(t, which=which, axis=axis):
                rows = [row.copy() for row in given_]
                rows[which][:, axis] += t
                return virtual_power_forces(machine, *rows, states.wrench)

            step = (2e-4 if which == 0 else 1e-2) * (size if axis < 2 else 1)
            expected = derivative(moved, 0.0, step)
            rounding = 1e-14 * np.abs(found.forces).max() / step
            bound = 1e-7 * np.abs(by).max() + 100 * rounding
            np.testing.assert_allclose(by[..., axis], expected, rtol=0, atol=bound)


@given(seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_what_friction_adds_to_the_derivatives_is_that_of_the_virtual_powers(seed):
    """By complex steps through the paper's formulas: exact, however suddenly Coulomb friction turns."""
    smooth, rng = replace(machine_of(seed), friction=Friction()), np.random.default_rng(seed)
    rough = replace(smooth, friction=replace(random_friction(rng), smoothing=float(rng.uniform(1e-3, 0.5))))
    states = random_states(smooth, seed, 40, drop=0.2, angle=0.2)
    motion = states.pose, states.velocity, states.acceleration
    lengths, coefficients = Lengths.of(rough.geometry), losses_of(rough.friction)

    def resisting(state):
        pose, velocity = state[:, :3].T, state[:, 3:].T
        transposed = np.empty((len(state), 3, 3), dtype=complex)
        for force, row in enumerate(jacobian(lengths, configuration(lengths, pose, np))):
            for axis, entry in enumerate(row):
                transposed[:, axis, force] = entry
        lost = np.stack(generalized_losses(lengths, pose, velocity, coefficients, np), axis=-1)
        return np.linalg.solve(transposed, lost[..., None])[..., 0]

    steps = 1e-30j * np.eye(9, 6)  # the last three, of the acceleration, move nothing
    state = np.hstack(motion[:2])
    expected = np.stack([resisting(state + step).imag / 1e-30 for step in steps], axis=-1)
    close = conditioning(rough.geometry, states.pose)[:, None, None]
    for level in levels():
        found, less = (
            np.concatenate(
                dynamics.inverse_dynamics_derivatives(
                    MachineKernels(machine, level), *motion, states.wrench
                ).arrays[1:],
                axis=-1,
            )
            for machine in (rough, smooth)
        )
        sizes = np.maximum(np.abs(found), np.abs(less)).max(axis=(0, 1))
        assert np.all(np.abs(found - less - expected) <= 1e-12 * close * sizes)


def test_bad_samples_do_not_touch_their_neighbours(level):
    rng = np.random.default_rng(3)
    kernels = MachineKernels(p3dof.PAPER, level)
    states = random_states(p3dof.PAPER, 3, 203)
    q, v, a, w = (np.array(row) for row in (states.pose, states.velocity, states.acceleration, states.wrench))
    bad = rng.choice(203, 60, replace=False)
    expected = virtual_power_forces(p3dof.PAPER, q, v, a, w)
    spoil = [
        (q, 0, np.nan), (q, 2, np.inf), (q, 1, -np.inf), (q, 0, 0.2501), (q, 0, 1e200), (q, 2, 3.1),
        (v, 1, np.nan), (v, 2, np.inf), (a, 1, np.nan), (a, 0, -np.inf), (w, 1, np.nan), (w, 0, np.inf),
    ]  # fmt: skip
    for k, row in enumerate(bad):
        array, column, value = spoil[k % len(spoil)]
        array[row, column] = value
        if value == 3.1:
            q[row, 0] = 0.22
    q[bad[-1]] = [0, 0, TURN]
    found = dynamics.forces(kernels, q, v, a, w, on_invalid="nan")
    reference = virtual_power_forces(p3dof.PAPER, q, v, a, w, on_invalid="nan")
    np.testing.assert_array_equal(np.isnan(found), np.isnan(reference))
    assert np.isnan(found[bad]).all()
    good = np.setdiff1d(np.arange(203), bad)
    close = conditioning(p3dof.PAPER.geometry, q[good])[:, None]
    assert np.all(np.abs(found[good] - expected[good]) < 1e-12 * close * np.abs(expected).max())
    by = dynamics.inverse_dynamics_derivatives(kernels, q, v, a, w, on_invalid="nan")
    for array in (by.by_pose, by.by_velocity, by.by_acceleration):
        assert np.isnan(array[bad]).all()
        assert np.isfinite(array[good]).all()
    reference = p3dof.load().forward_dynamics(q, v, a, wrench=w, on_invalid="nan", method="virtual-power")
    found = dynamics.forward_dynamics(kernels, q, v, a, w, on_invalid="nan")
    np.testing.assert_array_equal(np.isnan(found), np.isnan(reference))
    reference = p3dof.load().mass_matrix(q, on_invalid="nan", method="virtual-power")
    found = dynamics.mass_matrix(kernels, q, on_invalid="nan")
    np.testing.assert_array_equal(np.isnan(found), np.isnan(reference))


def test_samples_near_the_borders_are_decided_as_numpy_decides(level):
    """Reach, det J = 0 and far turns: the same samples are refused, and the others have their forces."""
    kernels = MachineKernels(p3dof.PAPER, level)
    edges = 10.0 ** np.arange(-16, -1)
    q = np.concatenate(
        [
            [[0.25 - e, 0, 0] for e in edges],
            [[-0.25 + e, 0, 0.1] for e in edges],
            [[0, 0.1, TURN + s * e] for e in edges for s in (-1, 1)],
            [[0.01, 0, 0.3 + 2 * np.pi * n] for n in (1, 1000, 1e4, 1e5, 1e7, -1e9)],
        ]
    )
    v, a = np.full(q.shape, 0.1), np.full(q.shape, 1.0)
    reference = virtual_power_forces(p3dof.PAPER, q, v, a, on_invalid="nan")
    found = dynamics.forces(kernels, q, v, a, on_invalid="nan")
    np.testing.assert_array_equal(np.isnan(found), np.isnan(reference))
    good = np.isfinite(found[:, 0])
    assert 40 < good.sum() < len(q)
    close = conditioning(p3dof.PAPER.geometry, q[good])[:, None]
    turned = np.maximum(1, np.abs(q[good, 2:]))  # one unit in the last place of θ
    size = np.abs(reference[good]).max(axis=1, keepdims=True)
    assert np.all(np.abs(found[good] - reference[good]) < 1e-13 * close * turned * np.maximum(size, 100))


def test_few_bad_samples_are_looked_at_alone(level, monkeypatch):
    asked = []
    real = compiled.holdable
    monkeypatch.setattr(
        compiled, "holdable", lambda g, states: (asked.append(len(states.pose)), real(g, states))[1]
    )
    states = random_states(p3dof.PAPER, 4, 400)
    q = states.pose.copy()
    q[[7, 300]] = [0.3, 0, 0]
    dynamics.forces(
        MachineKernels(p3dof.PAPER, level), q, states.velocity, states.acceleration, on_invalid="nan"
    )
    assert asked == [2]


def test_what_overflows_is_told_by_name_and_place(level):
    kernels = MachineKernels(p3dof.PAPER, level)
    v = np.zeros((2, 2, 3))
    v[1, 1] = 1e200
    row = r"expected finite numbers, got \[[^(]*\] from velocity \[1e\+200, 1e\+200, 1e\+200\]"
    place = r" \(sample \(1, 1\), the first of 1 such of 4\)$"
    rough = MachineKernels(replace(p3dof.PAPER, friction=Friction({"sliders": 20})), level)
    with pytest.raises(InputError, match=f"^forces: {row}{place}"):
        dynamics.forces(kernels, HOME, v, HOME, wrench=np.ones(6))
    with pytest.raises(InputError, match=f"^forces: {row}$"):
        dynamics.forces(kernels, HOME, v[1, 1], HOME)
    for given_ in (kernels, rough):
        with pytest.raises(InputError, match=f"^forces and derivatives: {row}{place}"):
            dynamics.inverse_dynamics_derivatives(given_, HOME, v, HOME)
    with pytest.raises(InputError, match=f"^acceleration: {row}{place}"):
        dynamics.forward_dynamics(kernels, HOME, v, HOME)
    with pytest.raises(InputError, match=f"^regressor: {row}{place}"):
        p3dof.load().force_regressor(HOME, v, HOME)
    with pytest.raises(InputError, match=f"^forces: {row}$"):
        virtual_power_forces(p3dof.PAPER, HOME, v[1, 1], HOME)
    full = p3dof.load()
    with pytest.raises(InputError, match=f"^acceleration: {row}{place}"):
        full.forward_dynamics(HOME, v, HOME, method="virtual-power")
    found = full.forward_dynamics(HOME, v, HOME, method="virtual-power", on_invalid="nan")
    assert np.isnan(found).all(axis=-1).tolist() == [[False, False], [False, True]]
    with pytest.raises(InputError, match=r"^forces: .* from wrench \[0.0, 1e\+308, 1e\+308"):
        virtual_power_forces(p3dof.PAPER, HOME, HOME, HOME, [0, 1e308, 1e308, 1e308, 0, 0])
    found = dynamics.forces(kernels, HOME, HOME, [[0, 0, 1e308], [0, 0, 0]], on_invalid="nan")
    assert np.isnan(found[0]).all() or np.isfinite(found[0]).all()
    assert np.isfinite(found[1]).all()


def test_packed_records_are_served(level):
    kernels = MachineKernels(p3dof.PAPER, level)
    records = np.zeros(10, [("mark", "u1"), ("pose", "<f8", (3,)), ("rate", "<f8", (3,))])
    records["pose"] = np.linspace(-0.1, 0.1, 30).reshape(10, 3)
    expected = virtual_power_forces(p3dof.PAPER, records["pose"], records["rate"], HOME)
    found = dynamics.forces(kernels, records["pose"], records["rate"], HOME)
    np.testing.assert_allclose(found, expected, rtol=1e-13)
    assert dynamics.sliders(kernels, records["pose"]).shape == (10, 3)
    assert dynamics.forces(kernels, records["pose"][3], HOME, HOME).shape == (3,)
    loads = np.zeros(10, [("mark", "u1"), ("wrench", "<f8", (6,))])
    loads["wrench"] = np.linspace(-5, 5, 60).reshape(10, 6)
    expected = virtual_power_forces(p3dof.PAPER, records["pose"], records["rate"], HOME, loads["wrench"])
    found = dynamics.forces(kernels, records["pose"], records["rate"], HOME, loads["wrench"])
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([0.3, 0, 0], HOME, HOME), ReachError, "leg A is too short by 0.05 m"),
        (
            ([HOME, [0, 0, TURN]], HOME, HOME),
            SingularityError,
            "actuation-singular.*sample 1, the first of 1",
        ),
        (([np.nan, 0, 0], HOME, HOME), InputError, "pose: expected finite numbers, got"),
        ((HOME, [0, np.inf, 0], HOME), InputError, "velocity: expected finite numbers, got"),
        ((HOME, HOME, [HOME, [0, 0, np.nan]]), InputError, "acceleration: expected finite numbers.*sample 1"),
        ((HOME, HOME, HOME, [0, 0, np.nan, 0, 0, 0]), InputError, "wrench: expected finite numbers"),
        ((HOME, HOME, HOME, np.zeros(5)), InputError, r"wrench: expected shape \(..., 6\)"),
        ((HOME, [0, 1e200, 1e200], HOME), InputError, "forces: expected finite numbers"),
        (([0, 0], HOME, HOME), InputError, r"pose: expected shape \(..., 3\), got \(2,\)"),
        ((np.zeros((2, 3)), np.zeros((3, 3)), HOME), InputError, "expected shapes that fit each other"),
        (("home", HOME, HOME), InputError, "pose: expected real numbers"),
    ],
)
def test_bad_input_is_the_error_of_the_other_methods(level, arguments, error, message):
    with pytest.raises(error, match=message):
        dynamics.forces(MachineKernels(p3dof.PAPER, level), *arguments)
    with pytest.raises(error, match=message):
        virtual_power_forces(p3dof.PAPER, *arguments)


def test_shapes_and_strides(level):
    kernels = MachineKernels(p3dof.PAPER, level)
    motion = p3dof.paper_motion(24)
    q, v, a = motion.pose, motion.velocity, motion.acceleration
    expected = virtual_power_forces(p3dof.PAPER, q, v, a)

    def close(found, reference):
        np.testing.assert_allclose(found, reference, rtol=0, atol=1e-13 * np.abs(expected).max())

    close(dynamics.forces(kernels, q.reshape(2, 3, 4, 3), v.reshape(2, 3, 4, 3), a.reshape(2, 3, 4, 3)),
          expected.reshape(2, 3, 4, 3))  # fmt: skip
    close(dynamics.forces(kernels, q[::-2], v[::-2], a[::-2]), expected[::-2])
    close(dynamics.forces(kernels, np.asfortranarray(q), v.copy("F"), a.tolist()), expected)
    close(dynamics.forces(kernels, q[5], v[5], a[5]), expected[5])
    close(dynamics.forces(kernels, q, v[3], a[3]), virtual_power_forces(p3dof.PAPER, q, v[3], a[3]))
    close(
        dynamics.forces(kernels, q[:, None], v[0], a[:2]),
        virtual_power_forces(p3dof.PAPER, q[:, None], v[0], a[:2]),
    )
    close(
        dynamics.forces(kernels, q.astype(np.float32), v, a),
        virtual_power_forces(p3dof.PAPER, q.astype(np.float32), v, a),
    )
    for count in (0, 1, 2, 7, 9):
        assert dynamics.forces(kernels, q[:count], v[:count], a[:count]).shape == (count, 3)
    assert dynamics.mass_matrix(kernels, np.zeros((0, 3))).shape == (0, 3, 3)


def test_threads_share_a_batch(level):
    states = random_states(p3dof.PAPER, 8, 500)
    motion = [np.tile(row, (300, 1)) for row in (states.pose, states.velocity, states.acceleration)]
    one, three = (MachineKernels(p3dof.PAPER, level, threads) for threads in (1, 3))
    np.testing.assert_array_equal(dynamics.forces(one, *motion), dynamics.forces(three, *motion))
    motion[0][149_999] = [0.3, 0, 0]
    with pytest.raises(ReachError, match="sample 149999, the first of 1"):
        dynamics.forces(three, *motion)
    found = dynamics.forces(three, *motion, on_invalid="nan")
    assert np.flatnonzero(np.isnan(found[:, 0])).tolist() == [149_999]


def _in_a_child(kernels, motion, queue):
    queue.put(float(dynamics.forces(kernels, *motion).sum()))


@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="processes are not forked here")
@pytest.mark.filterwarnings("ignore:This process.*is multi-threaded:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own():
    states = random_states(p3dof.PAPER, 8, 400)
    motion = [np.tile(row, (300, 1)) for row in (states.pose, states.velocity, states.acceleration)]
    kernels = MachineKernels(p3dof.PAPER, threads=2)
    expected = float(dynamics.forces(kernels, *motion).sum())
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_in_a_child, args=(kernels, motion, queue), daemon=True)
    child.start()
    assert queue.get(timeout=60) == expected
    child.join(60)
    assert child.exitcode == 0


@pytest.mark.parametrize("friction", [False, True])
def test_a_control_loop_has_its_buffers(level, friction):
    machine = p3dof.PAPER
    if friction:
        machine = replace(machine, friction=p3dof.machine.Friction({"sliders": 20.0}, {"hinge_c": 0.1}))
    kernels = MachineKernels(machine, level)
    loop = kernels.bind_inverse_dynamics()
    motion = p3dof.paper_motion(7)
    wrench = [5.0, 1, 2, 6, 3, 7]
    for q, v, a in zip(motion.pose, motion.velocity, motion.acceleration, strict=True):
        expected = virtual_power_forces(machine, q, v, a, wrench)
        loop.wrench[:] = wrench
        np.testing.assert_allclose(loop([q, v, a]), expected, rtol=1e-13)
        loop.state[:] = q, v, a
        assert loop.run() is True
        np.testing.assert_allclose(loop.forces, expected, rtol=1e-13)
        np.testing.assert_array_equal(loop.wrench, wrench)
        assert loop.call() is True
    for bad in ([0.3, 0, 0], [0.25, 0, 0], [0, 0, TURN], [0, 0, TURN + 1e-8], [np.nan, 0, 0], [0, np.inf, 0]):
        assert np.isnan(loop([bad, HOME, HOME])).all()
        assert loop.run() is False
        assert np.isnan(loop.forces).all()
    assert np.isfinite(loop([HOME, HOME, HOME])).all()
    with pytest.raises(AttributeError):
        loop.state = np.zeros((3, 3))
    for shape in ((3,), (9,), (3, 4)):
        with pytest.raises(InputError, match=r"state: expected shape \(3, 3\), got"):
            loop(np.zeros(shape))


def test_a_single_sample_at_the_very_border(level):
    kernels = MachineKernels(p3dof.PAPER, level)
    edge = p3dof.PAPER.geometry.L - 0.15
    for pose in ([edge, 0, 0], [-edge, 0, 0], [0.0, 0, 2.5], [1e300, 0, 0]):
        reference = virtual_power_forces(p3dof.PAPER, pose, HOME, HOME, on_invalid="nan")
        found = dynamics.forces(kernels, pose, HOME, HOME, on_invalid="nan")
        np.testing.assert_array_equal(np.isnan(found), np.isnan(reference))
        np.testing.assert_allclose(found, reference, rtol=1e-12)


def test_one_sample_as_numbers(level):
    function = MachineKernels(p3dof.PAPER, level).function("inverse_dynamics")
    q, v, a = [0.1, 0.2, 0.3], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]
    *forces, margin = function(*q, *v, *a)
    np.testing.assert_allclose(forces, virtual_power_forces(p3dof.PAPER, q, v, a), rtol=1e-13)
    assert margin > 0
    *forces, margin = function(0.3, *[0] * 8)
    assert np.isnan(forces).any()
    assert not margin > 0


def test_levels_and_threads_are_checked(monkeypatch):
    assert levels()[0] == "numpy"
    with pytest.raises(InputError, match=r"level: expected one of numpy.*, got 'fast'"):
        MachineKernels(p3dof.PAPER, "fast")
    for bad in (0, -1, 2.5, True, 10**6):
        with pytest.raises(InputError, match="threads: expected a number from 1 to 1024"):
            MachineKernels(p3dof.PAPER, threads=bad)
    monkeypatch.setenv("P3DOF_LEVEL", "numpy")
    monkeypatch.setenv("P3DOF_THREADS", "3")
    kernels = MachineKernels(p3dof.PAPER)
    assert (kernels.level, kernels.threads) == ("numpy", 3)
    again = pickle.loads(pickle.dumps(kernels))  # noqa: S301 - our own
    assert (again.level, again.threads) == ("numpy", 3)
    assert repr(again) == "MachineKernels(level='numpy', threads=3)"
    for bad in ("many", "-1", "1.5", "0", "9" * 30):
        monkeypatch.setenv("P3DOF_THREADS", bad)
        with pytest.raises(InputError, match=f"P3DOF_THREADS: expected a number from 1 to 1024, got '?{bad}"):
            MachineKernels(p3dof.PAPER)
    monkeypatch.setenv("P3DOF_THREADS", "")
    monkeypatch.setenv("P3DOF_LEVEL", "AVX2")
    with pytest.raises(InputError, match=r"P3DOF_LEVEL: expected one of numpy.*, got 'AVX2'"):
        MachineKernels(p3dof.PAPER)
    monkeypatch.setenv("P3DOF_LEVEL", "")
    kernels = MachineKernels(p3dof.PAPER)
    assert kernels.level == levels()[-1]
    with pytest.raises(InputError, match=r"kernel: expected one of inverse_dynamics, .* got 'magic'"):
        kernels.function("magic")
    with pytest.raises(InputError, match="parameters: expected Parameters, got Manipulator"):
        MachineKernels(p3dof.load())


def test_the_facade_offers_them():
    robot = p3dof.load()
    motion = p3dof.paper_motion(101)
    reference = robot.inverse_dynamics(motion, method="virtual-power", wrench=[0, 5, 0, 0, 1, 0])
    found = robot.inverse_dynamics(motion, method="compiled", wrench=[0, 5, 0, 0, 1, 0])
    assert found.method == "compiled"
    np.testing.assert_allclose(found.forces, reference.forces, rtol=0, atol=1e-12)
    assert np.abs(found.power_residual).max() < 1e-11
    q, v = motion.pose, motion.velocity
    np.testing.assert_allclose(
        robot.forward_dynamics(q, v, found.forces, method="compiled", wrench=[0, 5, 0, 0, 1, 0]),
        motion.acceleration, rtol=0, atol=1e-11,
    )  # fmt: skip
    np.testing.assert_allclose(
        robot.mass_matrix(q, method="compiled"),
        robot.mass_matrix(q, method="virtual-power"),
        rtol=0,
        atol=1e-13,
    )
    np.testing.assert_allclose(
        robot.jacobian(q, method="compiled"), robot.jacobian(q, method="virtual-power"), rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(robot.sliders(q), robot.inverse_kinematics(q).sliders, rtol=0, atol=1e-15)
    by = robot.inverse_dynamics_derivatives(motion, wrench=[0, 5, 0, 0, 1, 0])
    np.testing.assert_allclose(by.forces, found.forces, rtol=0, atol=1e-12)
    J = robot.jacobian(q, method="virtual-power")
    M = np.linalg.solve(np.swapaxes(J, -1, -2), robot.mass_matrix(q, method="virtual-power"))
    np.testing.assert_allclose(by.by_acceleration, M, rtol=0, atol=1e-11)
    regressor = robot.force_regressor(q, v, motion.acceleration)
    np.testing.assert_allclose(
        regressor.base @ regressor.base_parameters,
        robot.forces(q, v, motion.acceleration, method="compiled"),
        rtol=0, atol=1e-11,
    )  # fmt: skip
    with pytest.raises(
        InputError, match="method: expected one of 'pinocchio', 'virtual-power', 'compiled', got 'numpy'"
    ):
        robot.mass_matrix(q, method="numpy")
    with pytest.raises(InputError, match="motion: expected a Motion, got a list"):
        robot.inverse_dynamics_derivatives([1, 2])


@pytest.mark.parametrize("friction", [False, True])
def test_a_run_in_time_is_the_same(friction):
    machine = (
        replace(p3dof.PAPER, friction=p3dof.machine.Friction({"sliders": 20.0, "joints": 0.01}))
        if friction
        else p3dof.PAPER
    )
    robot = p3dof.load(machine)
    forces = robot.forces(HOME, HOME, HOME, method="compiled") * [0.9, 1, 1.1]
    options = {"controller": forces, "wrench": [0, 3, 1, 0, 0.2, 0]}
    options["integration"] = p3dof.runs.Integration(rtol=1e-12)
    runs = [robot.simulate(0.2, method=m, **options) for m in ("virtual-power", "compiled")]
    np.testing.assert_allclose(runs[1].motion.pose, runs[0].motion.pose, rtol=0, atol=1e-11)
    np.testing.assert_allclose(runs[1].slider_velocities, runs[0].slider_velocities, rtol=0, atol=1e-10)
    fallen = robot.simulate(5.0, method="compiled")
    assert fallen.stop is not None
    assert fallen.stop.kind == robot.simulate(5.0, method="virtual-power").stop.kind


@given(seed=SEEDS)
@settings(max_examples=30, deadline=None)
def test_friction_is_that_of_the_virtual_powers(seed):
    rng = np.random.default_rng(seed)
    machine = replace(machine_of(seed), friction=random_friction(rng))
    states = random_states(machine, seed, 90)
    motion, wrench = (states.pose, states.velocity, states.acceleration), states.wrench
    robot = p3dof.load(machine)
    close = conditioning(machine.geometry, states.pose)[:, None]
    for load in (None, wrench):
        expected = virtual_power_forces(machine, *motion, load)
        moved = robot.forward_dynamics(*motion[:2], expected, wrench=load, method="virtual-power")
        uncertain = (
            close
            * np.maximum(1, np.linalg.cond(robot.mass_matrix(states.pose, method="virtual-power")))[:, None]
        )
        for name in levels():
            kernels = MachineKernels(machine, name)
            assert kernels.prepared("inverse_dynamics_with_friction")[0].outputs[:3] == ("f_a", "f_b", "f_c")
            found = dynamics.forces(kernels, *motion, load)
            assert np.all(np.abs(found - expected) < 1e-12 * close * np.abs(expected).max())
            found = dynamics.forward_dynamics(kernels, *motion[:2], expected, load)
            assert np.all(np.abs(found - moved) < 1e-12 * uncertain * np.abs(moved).max())


def test_one_sample_with_friction_is_answered_at_once(monkeypatch):
    machine = replace(p3dof.PAPER, friction=random_friction(np.random.default_rng(3)))
    robot, states = p3dof.load(machine), random_states(machine, 4, 1)
    state = states.pose[0], states.velocity[0], states.acceleration[0]
    expected = [robot.forces(*state, wrench=w, method="virtual-power") for w in (None, states.wrench[0])]
    by = robot.force_derivatives(states.pose, states.velocity, states.acceleration).arrays
    if levels()[-1] != "numpy":
        monkeypatch.setattr("p3dof.methods.compiled.run_kernel", None)  # the way of batches
    for w, forces in zip((None, states.wrench[0]), expected, strict=True):
        np.testing.assert_allclose(robot.forces(*state, wrench=w, method="compiled"), forces, rtol=1e-11)
        np.testing.assert_allclose(robot.force_derivatives(*state, wrench=w).forces, forces, rtol=1e-11)
    for one, rows in zip(robot.force_derivatives(*state).arrays, by, strict=True):
        np.testing.assert_allclose(one, rows[0], rtol=1e-11)


@given(seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_coriolis_matrix_and_gravity_are_those_of_the_paper(seed):
    machine = machine_of(seed)
    states = random_states(machine, seed, 12)
    full = p3dof.load(machine)
    C = full.coriolis_matrix(states.pose, states.velocity)
    g = full.gravity_forces(states.pose)
    for name in levels():
        full.kernels = MachineKernels(machine, name)
        found = full.coriolis_matrix(states.pose, states.velocity, method="compiled")
        np.testing.assert_allclose(found, C, rtol=0, atol=1e-12 * np.abs(C).max())
        one = full.coriolis_matrix(states.pose[0], states.velocity[0], method="compiled")
        np.testing.assert_allclose(one, C[0], rtol=0, atol=1e-12 * np.abs(C).max())
        found = full.gravity_forces(states.pose, method="compiled")
        np.testing.assert_allclose(found, g, rtol=0, atol=1e-12 * np.abs(g).max())


@pytest.mark.filterwarnings("ignore:beyond what the machine can do")  # 9 m
def test_coriolis_matrix_and_gravity_refuse_what_the_paper_refuses(level):
    robot = p3dof.load()
    robot.kernels = MachineKernels(p3dof.PAPER, level)
    poses = np.array([[0.1, 0, 0], [9.0, 0, 0], [0, np.nan, 0], [0, 0, 0.2]])
    for ask in (
        lambda **k: robot.coriolis_matrix(poses, np.ones((4, 3)), **k),
        lambda **k: robot.gravity_forces(poses, **k),
    ):
        found, expected = (ask(method=m, on_invalid="nan") for m in ("compiled", "virtual-power"))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.nanmax(np.abs(expected)))
        with pytest.raises(InputError, match="sample 2"):
            ask(method="compiled")
        with pytest.raises(InputError, match="'virtual-power' or 'compiled', got 'pinocchio'"):
            ask(method="pinocchio")
        out = np.empty(expected.shape)
        assert ask(method="compiled", on_invalid="nan", out=out) is out
        np.testing.assert_array_equal(out, found)


@given(seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_forward_kinematics_is_that_of_the_closed_form(seed):
    machine = random_machine(seed)
    poses = random_states(machine, seed, 60).pose
    sliders = kinematics.inverse_kinematics(machine.geometry, poses).sliders
    expected = kinematics.forward_kinematics(machine.geometry, sliders)
    robot = p3dof.load(machine)
    scale = (
        np.array([machine.geometry.L, machine.geometry.L, 1]) * conditioning(machine.geometry, poses)[:, None]
    )
    for name in levels():
        robot.kernels = MachineKernels(machine, name)
        assert np.all(np.abs(robot.forward_kinematics(sliders) - expected) < 1e-14 * scale * 10)
        assert np.all(np.abs(robot.forward_kinematics(sliders[0]) - expected[0]) < 1e-14 * scale[0] * 10)


def test_forward_kinematics_refuses_what_the_closed_form_refuses(level):
    robot, geometry = p3dof.load(), p3dof.PAPER.geometry
    robot.kernels = MachineKernels(p3dof.PAPER, level)
    rng = np.random.default_rng(8)
    sliders = rng.uniform(-1, 1, (2000, 3))  # most do not assemble
    sliders[5] = np.nan, 0, 0
    sliders[6] = 0, np.inf, 0
    sliders[7] = 1e308, -1e308, 0
    sliders[8:11] = 0  # home
    found = robot.forward_kinematics(sliders, on_invalid="nan")
    expected = kinematics.forward_kinematics(geometry, sliders, on_invalid="nan")
    assert 50 < np.isfinite(expected[:, 0]).sum() < 1900
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    good = np.isfinite(expected[:, 0])
    np.testing.assert_allclose(robot.forward_kinematics(sliders[good]), expected[good], rtol=0, atol=1e-11)
    for bad in (sliders, sliders[11:]):
        with pytest.raises((ReachError, InputError)) as one:
            robot.forward_kinematics(bad)
        with pytest.raises((ReachError, InputError)) as other:
            kinematics.forward_kinematics(geometry, bad)
        assert str(one.value) == str(other.value)
    out = np.empty_like(sliders)
    assert robot.forward_kinematics(sliders, on_invalid="nan", out=out) is out
    np.testing.assert_array_equal(out, found)
    assert robot.forward_kinematics(np.empty((0, 3))).shape == (0, 3)
    with pytest.raises(InputError, match="on_invalid"):
        robot.forward_kinematics(sliders[8], on_invalid="skip")


def test_a_controllers_pose_is_that_of_the_closed_form():
    machine = random_machine(11)
    geometry, poses = machine.geometry, random_states(machine, 11, 50).pose
    for row in kinematics.inverse_kinematics(geometry, poses).sliders:
        expected = kinematics.forward_kinematics(geometry, row)
        found = pose_at(geometry, row)
        assert found.shape == (3,)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    with pytest.raises(ReachError, match="do not assemble"):
        pose_at(geometry, np.array([0.0, 9 * geometry.L, 0.0]))
    with pytest.raises(InputError, match="finite"):
        pose_at(geometry, np.array([0.0, np.nan, 0.0]))


def test_a_controller_does_not_take_the_way_of_batches(monkeypatch):
    sliders = np.array([0.01, -0.02, 0.015])
    measured = Measurement(0.0, 1e-3, sliders, np.zeros(3), np.zeros(3, bool), p3dof.PAPER.geometry)
    expected = kinematics.forward_kinematics(p3dof.PAPER.geometry, sliders)
    monkeypatch.setattr("p3dof.closed_form.compiled.kernels.forward_kinematics", None)
    np.testing.assert_allclose(measured.pose, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("friction", [False, True])
def test_some_rows_are_answered_at_once(friction, monkeypatch):
    machine = replace(
        p3dof.PAPER, friction=random_friction(np.random.default_rng(3)) if friction else p3dof.PAPER.friction
    )
    robot, states = p3dof.load(machine), random_states(machine, 4, 200)
    q, v, a, w = states.pose, states.velocity, states.acceleration, states.wrench
    f = robot.forces(q, v, a, wrench=w)
    plain = robot.kernels.level == "numpy"
    same = {"rtol": 1e-11 if friction or plain else 0, "atol": 0}  # tanh of a few rows may round otherwise
    sliders = robot.inverse_kinematics(q).sliders
    calls = [
        lambda n, **to: robot.forces(q[:n], v[:n], a[:n], method="compiled", **to),
        lambda n, **to: robot.forces(q[:n], v[:n], a[:n], wrench=w[:n], method="compiled", **to),
        lambda n, **to: robot.forces(q[:n], v[0], a[:n], wrench=w[0], method="compiled", **to),
        lambda n, **to: robot.forward_dynamics(q[:n], v[:n], f[:n], wrench=w[:n], method="compiled", **to),
        lambda n, **to: robot.jacobian(q[:n], method="compiled", **to),
        lambda n, **to: robot.mass_matrix(q[:n], method="compiled", **to),
        lambda n, **to: robot.sliders(q[:n], **to),
        lambda n, **to: robot.forward_kinematics(sliders[:n], **to),
    ]
    with monkeypatch.context() as patched:
        patched.setattr("p3dof.methods.one_sample.POLICIES", ())  # nothing is answered at once
        expected = [call(200) for call in calls]
        derivatives = robot.force_derivatives(q, v, a, wrench=w).arrays
    if not plain:
        for way in ("run_kernel", "poses"):  # the way of batches
            monkeypatch.setattr(f"p3dof.methods.compiled.{way}", None)
    for call, batch in zip(calls, expected, strict=True):
        for n in (1, 2, 200):
            out = np.empty_like(batch[:n])
            np.testing.assert_allclose(call(n), batch[:n], **same)
            assert call(n, out=out) is out
            np.testing.assert_allclose(out, batch[:n], **same)
    for one, batch in zip(robot.force_derivatives(q, v, a, wrench=w).arrays, derivatives, strict=True):
        np.testing.assert_allclose(one, batch, **same)


def test_rows_with_a_bad_one_have_the_error_and_the_nan_of_a_batch():
    robot, states = p3dof.load(), random_states(p3dof.PAPER, 4, 20)
    good = states.pose, states.velocity, states.acceleration
    for row, which, value, error in (
        (7, 0, 0.3, ReachError),
        (3, 0, np.nan, InputError),
        (9, 1, 1e200, InputError),
    ):
        state, out = [array.copy() for array in good], np.zeros((20, 3))
        state[which][row, 0] = value
        with pytest.raises(error) as told:
            robot.forces(*state, method="compiled", out=out)
        assert f"sample {row}" in str(told.value)
        assert np.isnan(out).all()
        found = robot.forces(*state, method="compiled", on_invalid="nan", out=out)
        expected = robot.forces(*good, method="compiled")
        expected[row] = np.nan
        np.testing.assert_array_equal(found, expected)
    for wrench in (np.zeros((20, 5)), np.zeros((19, 6)), np.full(6, np.nan)):
        with pytest.raises(InputError, match="wrench"):
            robot.forces(*good, wrench=wrench, method="compiled")
    with pytest.raises(InputError, match="shape"):
        robot.forces(good[0], good[1][:19], good[2], method="compiled")
    with pytest.raises(InputError, match="on_invalid"):
        robot.forces(*good, on_invalid="skip", method="compiled")
