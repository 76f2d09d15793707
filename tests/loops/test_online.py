"""Recursive estimates of a body: against regressors, batch estimates, known payloads, and what goes wrong."""

from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from gallery import gallery
from numpy.testing import assert_allclose

from p3dof import runs
from p3dof._base.errors import InputError, ModelError, SingularityError
from p3dof.loops import BodyEstimate, RecursiveEstimator, estimate_parameters, payload_deviations
from p3dof.loops.compiled.robot import closed_configurations
from p3dof.loops.online import UDFactors
from p3dof.loops.trees import joint_value

BODY = {"five_bar": "right_elbow", "delta": "platform_free", "stewart": "platform_free"}
SWING = {"five_bar": 0.3, "delta": 0.2, "stewart": 0.05}
CENTRE = np.array([0.03, 0.02, 0.05])
SPREAD = payload_deviations(5.0, 0.1)


class Log(NamedTuple):
    """A motion, the motors' forces with and without two kilograms more, and one per cent of the largest."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    usual: np.ndarray
    loaded: np.ndarray
    noise: float

    def __len__(self):
        return len(self.q)


def payload(mass=2.0):
    """A ball of 4 cm beside the origin of its joint."""
    ball = pin.Inertia.FromSphere(mass, 0.04)
    ball.lever = CENTRE
    return ball


def with_payload(robot, joint):
    other = robot.copy()
    other.model.inertias[other.model.getJointId(joint)] += payload()
    return other


@pytest.fixture(scope="module", params=BODY)
def case(request):
    """A robot, the joint of its body, a log, and what makes estimators: compiled once."""
    robot, joint = gallery(request.param), BODY[request.param]
    compiled = robot.compile(inertias=[joint])
    return robot, joint, logged(request.param), partial(robot.payload_estimator, joint, compiled=compiled)


def logged(name, count=300, seconds=3.0):
    robot = gallery(name)
    home = robot.assemble().q
    start = np.array([joint_value(robot.model, motor, home) for motor in robot.actuated])
    time, k = np.linspace(0.0, seconds, count)[:, None], np.arange(len(start))
    w, phase, size = 2 * np.pi * (0.5 + 0.37 * k), 1.3 * k, SWING[name]
    turned = w * time + phase
    way = start + size * (np.sin(turned) - np.sin(phase))
    s = robot.complete_batch(way, size * w * np.cos(turned), -size * w * w * np.sin(turned), guess=home)
    usual, loaded = (
        one.inverse_dynamics_batch(s.q, s.v, s.a).tau for one in (robot, with_payload(robot, BODY[name]))
    )
    return Log(s.q, s.v, s.a, usual, loaded, 0.01 * np.abs(loaded).max())


def noisy(log, forces, seed=0):
    return forces + log.noise * np.random.default_rng(seed).normal(size=forces.shape)


def run(estimator, log, forces, some=None):
    """Estimates (N, 10) and their deviations after each sample."""
    found = []
    for i in range(len(log)) if some is None else some:
        estimator.update(log.q[i], log.v[i], log.a[i], forces[i])
        found.append([estimator.body.parameters, estimator.body.deviations])
    return np.array(found).swapaxes(0, 1)


@pytest.mark.parametrize(
    ("name", "joint"),
    [*BODY.items(), ("gripper", "right_guide"), ("leg", "knee_motor"), ("two_arms", "right_6")],
)
def test_forces_are_linear_in_the_parameters_of_a_body(name, joint):
    """Columns are those by Pinocchio, of redundant loops and motors and idle freedoms, too."""
    robot, draw = gallery(name), np.random.default_rng(0)
    compiled, n = robot.compile(inertias=[joint], level="numpy"), 0
    first = 10 * (robot.model.getJointId(joint) - 1)
    for q in closed_configurations(robot, robot.regular_configuration)[:4]:
        speeds, rates = draw.normal(size=(2, len(compiled.independent)))
        state = {"q": q[None], "v_independent": speeds[None], "a_independent": rates[None]}
        found, moving = compiled.rows("body_regressor", state), compiled.rows("completion", state)
        if not found["trusted"][0] > 0:
            continue
        of = robot.force_regressor(q, moving["v"][0], moving["a"][0])
        expected = of.forces[:, first : first + 10]
        R = found["regressor"][0].reshape(-1, 10)
        assert_allclose(R, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        tau = R @ of.parameters[first : first + 10] + found["rest"][0]
        expected = of.forces @ of.parameters
        assert_allclose(tau, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        n += 1
    assert n > 1


def test_a_payload_is_found(case):
    """Mass to one per cent; what the motion shows, within four deviations; what it does not, as it was."""
    robot, _joint, log, new = case
    estimator = new(log.noise, SPREAD)
    run(estimator, log, noisy(log, log.loaded))
    found = estimator.payload
    assert abs(found.mass - 2.0) < 0.02
    assert found.mass_deviation < 0.01
    assert np.abs((found.parameters - payload().toDynamicParameters()) / found.deviations).max() < 4.0
    seen = {"five_bar": [0, 2], "delta": [], "stewart": [0, 1, 2]}[robot.model.name]
    assert_allclose(found.centre[seen], CENTRE[seen], rtol=0, atol=0.005)
    assert (found.centre_deviations[seen] < 0.005).all()
    unseen = np.setdiff1d(range(3), seen)
    assert_allclose(found.deviations[1 + unseen], SPREAD[1 + unseen], rtol=1e-6)
    assert_allclose(found.centre[unseen], 0.0, rtol=0, atol=1e-6)
    assert (estimator.samples, estimator.outliers) == (len(log), 0)


def test_all_samples_together_are_the_batch_estimate(case):
    robot, joint, log, new = case
    measured = noisy(log, log.loaded)
    prior = new(log.noise, SPREAD).design * 1.1
    noise = log.noise * (1 + np.arange(measured.shape[1]))
    estimator = new(noise, SPREAD, prior)
    run(estimator, log, measured)
    of, first = robot.force_regressor(log.q, log.v, log.a), 10 * (robot.model.getJointId(joint) - 1)
    R = of.forces[..., first : first + 10]
    rest = of.forces @ of.parameters + of.external - R @ estimator.design
    batch = estimate_parameters(R, measured - rest, prior, SPREAD, noise, consistent=False)
    atol = 1e-10  # signals are up to 500 times the noise: squares of that in roundings
    assert_allclose(estimator.body.parameters / SPREAD, batch.parameters / SPREAD, rtol=0, atol=atol)
    scale = np.outer(SPREAD, SPREAD)
    assert_allclose(estimator.body.covariance / scale, batch.covariance / scale, rtol=0, atol=atol)


def test_a_payload_that_is_taken_up_is_followed_with_forgetting(case):
    """Behind a gate, too: what is forgotten widens it; without forgetting it stays closed."""
    _robot, _joint, log, new = case
    forces = noisy(log, np.where(np.arange(len(log))[:, None] < 100, log.usual, log.loaded))
    for gate in (None, 6.0):
        estimator = new(log.noise, SPREAD, forgetting=0.95, gate=gate)
        mass, deviation = run(estimator, log, forces)[..., 0]
        mass = mass - estimator.design[0]
        assert abs(mass[99]) < 4 * deviation[99] < 0.15
        assert abs(mass[-1] - 2.0) < 4 * deviation[-1] < 0.15
        if gate is None:
            assert (np.abs(mass[200:] - 2.0) < 0.05 * 2.0).all()  # five memories later
        assert (estimator.outliers > 0) == (gate is not None)
        assert estimator.samples + estimator.outliers == len(log)
    held = new(log.noise, SPREAD, gate=6.0)
    assert abs(run(held, log, forces)[0, -1, 0] - held.design[0]) < 0.3
    assert held.outliers > 150
    slow = new(log.noise, SPREAD)
    assert abs(run(slow, log, forces)[0, 200, 0] - slow.design[0] - 2.0) > 0.3


def test_without_excitation_nothing_drifts(case):
    """A robot stands still for twenty memories; plain forgetting blows its covariance up meanwhile."""
    robot, joint, log, new = case
    estimator = new(log.noise, SPREAD, forgetting=0.95)
    run(estimator, log, noisy(log, log.loaded))
    before, still = estimator.body, np.zeros(robot.model.nv)
    q, noise = log.q[-1], np.random.default_rng(1)
    held = with_payload(robot, joint).inverse_dynamics(q, still, still).tau
    for _ in range(400):
        estimator.update(q, still, still, held + log.noise * noise.normal(size=len(held)))
        assert (estimator.body.deviations <= SPREAD * (1 + 1e-12)).all()
    R = robot.force_regressor(q, still, still).forces
    first = 10 * (robot.model.getJointId(joint) - 1)
    R = R[:, first : first + 10]
    S = R @ estimator.body.covariance @ R.T
    assert (np.sqrt(np.diag(S)) < log.noise).all()  # what is seen is known
    moved = (estimator.body.parameters - before.parameters) / before.deviations
    assert np.abs(moved).max() < 6.0
    assert abs(estimator.payload.mass - 2.0) < 0.1
    plain = UDFactors(10)
    for _ in range(400):
        plain.D = [d / 0.95 for d in plain.D]
        for h in (R * SPREAD).tolist():
            plain.measure(h, log.noise**2, 0.0)
    assert plain.deviations().max() > 1e3


def test_outliers_are_left_out_and_counted(case):
    _robot, joint, log, new = case
    forces, bad = noisy(log, log.loaded), range(20, len(log), 25)
    wrong = forces.copy()
    wrong[bad, 0] += 60 * log.noise
    gated, plain, without = (new(log.noise, SPREAD, gate=gate) for gate in (6.0, None, None))
    run(gated, log, wrong)
    run(plain, log, wrong)
    run(without, log, forces, np.setdiff1d(range(len(log)), bad))
    assert (gated.outliers, gated.samples) == (len(bad), len(log) - len(bad))
    assert np.array_equal(gated.body.parameters, without.body.parameters)
    off = np.abs(plain.body.parameters - without.body.parameters) / without.body.deviations
    assert off.max() > 5.0
    assert repr(gated) == f"RecursiveEstimator({joint}; {gated.samples} samples, {len(bad)} left out)"
    gated.start()
    assert (gated.outliers, gated.samples) == (0, 0)
    assert np.array_equal(gated.body.parameters, gated.design)
    assert_allclose(gated.body.deviations, SPREAD, rtol=1e-15)


def test_what_is_known_stays(case):
    """Without doubt about it: here the mass alone is estimated, as of a payload at the origin."""
    _robot, _joint, log, new = case
    known, prior = np.zeros(10), np.arange(10.0)
    known[0] = 5.0
    estimator = new(log.noise, known, prior)
    run(estimator, log, log.loaded, range(5))
    assert np.array_equal(estimator.body.parameters[1:], prior[1:])
    assert not estimator.body.deviations[1:].any()
    assert estimator.body.deviations[0] < 1.0
    assert_allclose(estimator.payload.parameters, estimator.body.parameters - estimator.design, rtol=1e-15)


def test_a_simulated_robot_and_known_wrenches():
    """Under computed torque without its payload, pushed at its tip by what one knows of."""
    robot, joint = gallery("five_bar"), "right_elbow"
    home, time = robot.assemble().q, np.linspace(0.0, 0.5, 51)
    turned = 2 * np.pi * time[:, None] * [0.5, 0.8]
    way = runs.JointReference(time, home[[0, 2]] + 0.3 * np.sin(turned) * [1, -1])
    control = runs.JointComputedTorque(robot, way, *runs.gains(frequency=4, damping=1))
    wrench, truth = {"right_tip": np.array([2.0, 0.0, -5.0, 0.0, 0.0, 0.0])}, with_payload(robot, joint)
    made = runs.simulate_robot(truth, 0.5, home, controller=control, samples=51, external=wrench)
    a = truth.forward_dynamics_batch(made.q, made.v, made.forces, external=wrench).a
    found = []
    for compiled, known in (
        (robot.compile(external=["right_tip"], inertias=[joint], level="numpy"), wrench),
        (None, None),
    ):
        estimator = robot.payload_estimator(joint, 0.01, SPREAD, compiled=compiled)
        for state in zip(made.q, made.v, a, made.forces, strict=True):
            estimator.update(*state, external=known)
        found.append(estimator.payload)
    assert abs(found[0].mass - 2.0) < 1e-3
    assert_allclose(found[0].centre[[0, 2]], CENTRE[[0, 2]], rtol=0, atol=1e-3)
    assert abs(found[1].mass - 2.0) > 0.1  # without what is known


def test_idle_freedoms_need_no_motor():
    """A leg whose foot hangs: its shin is what is estimated."""
    robot, joint = gallery("leg"), "knee_motor"
    compiled = robot.compile(inertias=[joint], level="numpy")
    estimator = robot.payload_estimator(joint, 1e-3, payload_deviations(2.0, 0.1), compiled=compiled)
    other = robot.copy()
    other.model.inertias[other.model.getJointId(joint)] += payload(0.5)
    draw = np.random.default_rng(0)
    for q in closed_configurations(robot, robot.regular_configuration):
        N = np.linalg.svd(robot.closure_jacobian(q))[2][robot.rank(q) :].T
        v = N @ draw.normal(size=N.shape[1])
        found = other.hybrid_dynamics(q, v, draw.normal(size=6))
        estimator.update(q, v, found.a, found.tau)
    body = estimator.body
    assert abs(estimator.payload.mass - 0.5) < 4 * body.deviations[0]
    assert body.deviations[0] < 0.2


def test_the_covariance_stays_positive_where_the_usual_update_fails():
    """Measurements of 1e-9 of the doubt, in almost the same direction: roundings are what is left."""
    draw, factors, P = np.random.default_rng(0), UDFactors(10), np.eye(10)
    h, least = draw.normal(size=10), 1.0
    for _ in range(200):
        row, noise = h + 1e-6 * draw.normal(size=10), 1e-18
        factors.measure(row.tolist(), noise, 0.0)
        gain = P @ row / (row @ P @ row + noise)
        P = P - np.outer(gain, row @ P)
        least = min(least, np.linalg.eigvalsh((P + P.T) / 2).min())
    assert least < -1e-17  # negative variances
    assert min(factors.D) > 0.0
    assert (factors.deviations() > 0.0).all()


def test_what_is_forgotten_is_not_what_was_known_before():
    """Inverse covariances: of the measurements by the factor, of the prior none."""
    draw, factors = np.random.default_rng(0), UDFactors(10)
    rows = draw.normal(size=(15, 10))
    for h in rows:
        factors.measure(h.tolist(), 0.04, 1.0)
    mean = factors.z.copy()
    factors.forget(0.9)
    U, D = np.array(factors.U), np.diag(factors.D)
    expected = np.linalg.inv(np.eye(10) + 0.9 * rows.T @ rows / 0.04)
    assert_allclose(U @ D @ U.T, expected, rtol=0, atol=1e-14 * np.linalg.cond(expected))
    assert_allclose(factors.deviations(), np.sqrt(np.diag(expected)), rtol=1e-11)
    assert np.array_equal(np.triu(U), U)
    assert factors.z == mean
    new, variance = factors.seen(rows[0].tolist(), 3.0)
    assert new == pytest.approx(3.0 - rows[0] @ mean, rel=1e-12)
    assert variance == pytest.approx(rows[0] @ expected @ rows[0], rel=1e-11)


def test_numbers_of_a_body():
    """Standard deviations of a mass centre: those of normal samples, to first order."""
    robot, draw = gallery("stewart"), np.random.default_rng(0)
    light = pin.Inertia(1e-3, np.array([2.0, -3.0, 1.0]), 1e-2 * np.eye(3))  # kg, m
    spread = payload_deviations(2e-5, 0.1)
    estimator = robot.payload_estimator("platform_free", 1.0, spread, light.toDynamicParameters())
    body = estimator.body
    mixed = draw.normal(size=(10, 10)) * 1e-5
    sure = BodyEstimate(body.parameters, mixed @ mixed.T)
    some = draw.multivariate_normal(sure.parameters, sure.covariance, size=20_000)
    assert_allclose(sure.centre_deviations, (some[:, 1:4].T / some[:, 0]).std(axis=1), rtol=0.05)
    assert_allclose(body.centre, light.lever, rtol=1e-14)
    assert body.mass == 1e-3
    assert body.mass_deviation == pytest.approx(2e-5, rel=1e-15)
    second = np.array([1.0, 0.5, 1.0, 0.5, 0.5, 1.0])  # no product of inertia is above half the mass times r²
    assert_allclose(payload_deviations(3.0, 0.2), 3 * np.array([1.0, *[0.2] * 3, *0.04 * second]), rtol=1e-15)
    assert estimator.payload.mass == 1e-3 - robot.model.inertias[-1].mass
    nothing = robot.payload_estimator("platform_free", 1.0, spread).payload
    assert nothing.mass == 0.0
    assert np.isnan(nothing.centre).all()
    assert np.isnan(nothing.centre_deviations).all()


def test_bad_input_is_one_line_and_changes_nothing():
    robot, joint, log = gallery("five_bar"), "right_elbow", logged("five_bar", 4, 0.1)
    compiled = robot.compile(inertias=[joint], level="numpy")
    for words, arguments in (
        ("noise: expected a positive number or 2", (joint, 0.0, SPREAD)),
        ("noise: expected a positive number or 2", (joint, [1.0, np.nan], SPREAD)),
        ("noise: expected a positive number or 2", (joint, [1.0, 1.0, 1.0], SPREAD)),
        ("noise: expected a positive number or 2", (joint, 1e-200, SPREAD)),
        ("noise: expected real numbers", (joint, "x", SPREAD)),
        ("deviations: expected zero or more", (joint, 1.0, -SPREAD)),
        ("deviations: expected zero or more", (joint, 1.0, 0 * SPREAD)),
        ("deviations: expected shape", (joint, 1.0, SPREAD[:9])),
        ("parameters: expected shape", (joint, 1.0, SPREAD, [1.0])),
        ("forgetting: expected a positive number", (joint, 1.0, SPREAD, None, 0.0)),
        ("forgetting: expected at most 1", (joint, 1.0, SPREAD, None, 1.1)),
        ("gate: expected a positive number", (joint, 1.0, SPREAD, None, 1.0, -1.0)),
        ("compiled with inertias=", ("left_elbow", 1.0, SPREAD, None, 1.0, None, compiled)),
    ):
        with pytest.raises(InputError, match=words) as caught:
            robot.payload_estimator(*arguments)
        assert "\n" not in str(caught.value)
    with pytest.raises(ModelError, match="the joint 'nothing' does not exist"):
        robot.payload_estimator("nothing", 1.0, SPREAD)
    with pytest.raises(InputError, match="compiled: it was compiled for another robot"):
        gallery("delta").payload_estimator(joint, 1.0, SPREAD, compiled=compiled)
    with pytest.raises(ModelError, match="does not determine the forces of 12 actuators"):
        gallery("two_arms").payload_estimator("right_6", 1.0, SPREAD)
    with pytest.raises(ModelError, match=r"expected one body .* got 0"):
        robot.compile(level="numpy").function("body_regressor")
    for mass, reach in ((0.0, 1.0), (1.0, -1.0), (np.nan, 1.0)):
        with pytest.raises(InputError, match=r"mass|reach"):
            payload_deviations(mass, reach)
    assert isinstance(robot.payload_estimator(joint, 1.0, SPREAD, compiled=compiled), RecursiveEstimator)
    estimator = RecursiveEstimator(robot, joint, log.noise, SPREAD, compiled=compiled)
    run(estimator, log, log.loaded)
    before, (q, v, a, tau) = estimator.body, (log.q[0], log.v[0], log.a[0], log.loaded[0])
    for words, sample in (
        ("q: ", (q[:3], v, a, tau)),
        ("v: ", (q, [np.nan] * 4, a, tau)),
        ("a: ", (q, v, a[:2], tau)),
        ("forces: ", (q, v, a, [np.inf, 0.0])),
        ("loops are open by", (q + np.eye(4)[1] / 10, v, a, tau)),
        ("it was not compiled for that", (q, v, a, tau, {"right_tip": np.zeros(6)})),
    ):
        with pytest.raises(InputError, match=words):
            estimator.update(*sample)
    with pytest.raises(SingularityError, match="hardly determine the motion"):
        estimator.update(robot.assemble([np.pi, 0.0]).q, 0 * v, 0 * a, tau)
    assert estimator.body is before
    assert estimator.samples == 4
