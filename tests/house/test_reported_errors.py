"""Errors that results report: each is put in on purpose, and found again at its size."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from table_numbers import check_evidence, shows

import p3dof
from p3dof._base.time_series.smoothing import fitted
from p3dof.loops import ClosedLoopModel, ReactionSolver
from p3dof.loops import forward as forward_dynamics
from p3dof.loops import hybrid as hybrid_dynamics
from p3dof.loops.assembly import Point
from p3dof.loops.batch.hybrid import BatchHybrid
from p3dof.loops.closures import ClosurePoint
from p3dof.loops.compiled import build
from p3dof.loops.compiled.runs import PreparedRuns
from p3dof.loops.partitions import Split
from p3dof.loops.results import ActuatedForces, InverseDynamics
from p3dof.methods import engines
from p3dof.methods.engines import driven
from p3dof.runs import (
    ControlLoop,
    Integration,
    JointPD,
    JointReference,
    robots_many,
    simulate_robot,
    simulate_robot_many,
)
from p3dof.runs import forces_along as along
from p3dof.runs.machine_plants import MachineJoints

GROUND, CRANK, COUPLER, ROCKER = robots.FOUR_BAR
OPEN = np.array([2e-6, -3e-6, 7e-6])
"""By what the joints of a four-bar are off [rad], so that its loop is open."""


@pytest.fixture(scope="module")
def loop():
    return ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR)


def opening(q):
    """The rocker's tip seen from the coupler's, in the coupler's axes: plane trigonometry in x and z."""
    crank, coupler, rocker = q[0], q[0] + q[1], q[2]
    x = GROUND + ROCKER * np.cos(rocker) - CRANK * np.cos(crank) - COUPLER * np.cos(coupler)
    z = ROCKER * np.sin(rocker) - CRANK * np.sin(crank) - COUPLER * np.sin(coupler)
    c, s = np.cos(coupler), np.sin(coupler)
    return np.array([c * x + s * z, 0.0, c * z - s * x])


def slope(q):
    """The Jacobian of `opening`, (3, 3), by complex steps."""
    return np.array([opening(q + 1e-20j * row).imag / 1e-20 for row in np.eye(3)]).T


def moving(theta=1.1, speed=1.3, change=-2.0):
    """A closed configuration, and velocities and accelerations that keep it closed."""
    step = 1e-3
    q = [robots.four_bar_q(theta + n * step, *robots.FOUR_BAR) for n in (-2, -1, 0, 1, 2)]
    first = (q[0] - 8 * q[1] + 8 * q[3] - q[4]) / (12 * step)
    second = (-q[0] + 16 * q[1] - 30 * q[2] + 16 * q[3] - q[4]) / (12 * step**2)
    return q[2], speed * first, change * first + speed**2 * second


def rnea(loop, q, v, a):
    return np.array(pin.rnea(loop.model, loop.model.createData(), q, v, a))


def beyond_closures(q, force):
    """The largest entry of what no multiplier can balance."""
    J = slope(q)[[0, 2]]
    return np.abs(force - J.T @ np.linalg.lstsq(J.T, force, rcond=None)[0]).max()


# Any robot: configurations that are open.


@shows(
    "p3dof.loops.closures.ClosurePoint.error",
    "p3dof.loops.closures.ClosurePoint.gap",
    "p3dof.loops.assembly.Point.gap",
    "p3dof.loops.results.ClosureForces.gap",
    "p3dof.loops.results.InverseDynamics.gap",
    "p3dof.loops.results.ForwardDynamics.gap",
    "p3dof.loops.results.HybridDynamics.gap",
)
def test_the_gap_of_a_loop_that_is_open(loop):
    q, v, a = moving()
    q = q + OPEN
    expected = opening(q)
    point = loop._tree.kinematics.at(q)
    assert isinstance(point, ClosurePoint)
    check_evidence(point, "error", expected, rtol=1e-10)
    check_evidence(point, "gap", np.abs(expected).max(), rtol=1e-10)
    target = np.array([*expected, -0.2, 0.1])
    check_evidence(Point(q, target, np.zeros((5, 3)), 1e-9), "gap", 0.2)
    for found in (
        loop.inverse_dynamics(q, v, a),
        loop.forward_dynamics(q, v, [3.0]),
        loop.hybrid_dynamics(q, v, [-2.0]),
    ):
        check_evidence(found, "gap", np.abs(expected).max(), rtol=1e-10)
        check_evidence(found.evidence, "gap", np.abs(expected).max(), rtol=1e-10)


@pytest.mark.parametrize("size", [2e-7, 1.0])
@shows(
    "p3dof.loops.batch.dynamics.BatchInverseDynamics.closure_error",
    "p3dof.loops.batch.dynamics.BatchForwardDynamics.closure_error",
    "p3dof.loops.batch.dynamics.BatchHybridDynamics.closure_error",
)
def test_the_gaps_of_many_samples_that_are_open(loop, size):
    """So little that they go together, and so much that each goes alone; each by another share."""
    states = [moving(0.9 + 0.02 * n) for n in range(12)]
    q, v, a = (np.array(rows) for rows in zip(*states, strict=True))
    q = q + size * np.outer(np.linspace(0.2, 1, 12), OPEN)
    expected = np.array([opening(row) for row in q])
    for found in (
        loop.inverse_dynamics_batch(q, v, a),
        loop.forward_dynamics_batch(q, v, np.full((12, 1), 3.0)),
        loop.hybrid_dynamics_batch(q, v, a[:, :1]),
    ):
        assert not found.errors
        check_evidence(found, "closure_error", expected, rtol=1e-9, atol=1e-15)


@shows("p3dof.loops.compiled.results.CompiledDynamics.gap")
def test_the_gap_of_compiled_dynamics(loop):
    q, v, a = moving()
    rows = q + np.outer([1e-3, 2e-3, -1e-3], OPEN)
    found = loop.compile(level="numpy").inverse_dynamics(rows, np.tile(v, (3, 1)), np.tile(a, (3, 1)))
    check_evidence(found, "gap", [np.linalg.norm(opening(row)) for row in rows], rtol=1e-6)


@shows("p3dof.loops.assembly.Assembly.gap")
def test_the_gap_of_an_assembly_that_ends_a_little_open(loop, monkeypatch):
    """The last configuration is turned by less than the tolerance, after the iteration."""
    solve = loop._tree.assembler._solve

    def off(system, *arguments):
        path, kept = solve(system, *arguments)
        return replace(path, point=system.moved(path.point.q, 1e-2 * OPEN)), kept

    monkeypatch.setattr(loop._tree.assembler, "_solve", off)
    found = loop.assemble([1.1])
    check_evidence(found, "gap", max(np.abs(opening(found.q)).max(), abs(found.q[0] - 1.1)), rtol=1e-6)


# Any robot: forces and accelerations that are off.


@shows("p3dof.loops.results.ClosureForces.residual", "p3dof.loops.results.InverseDynamics.residual")
def test_the_residual_of_forces_whose_multipliers_are_off(loop):
    q, v, a = moving()
    right = loop.inverse_dynamics(q, v, a)
    force = rnea(loop, q, v, a)
    force[0] -= right.tau[0]
    wrong = np.array([0.3, 0.0, -0.2])
    evidence = ActuatedForces(loop._tree.kinematics.at(q), force, loop.actuated_v, right.lambda_ + wrong)
    expected = np.abs(slope(q).T @ wrong).max()
    check_evidence(evidence, "residual", expected, rtol=1e-9)
    check_evidence(InverseDynamics(right.tau, evidence), "residual", expected, rtol=1e-9)
    tau = right.tau + 0.4  # and a force that is off
    force[0] -= 0.4
    check_evidence(
        InverseDynamics(tau, ActuatedForces(loop._tree.kinematics.at(q), force, loop.actuated_v)),
        "residual",
        beyond_closures(q, np.array([0.4, 0, 0])),
        rtol=1e-9,
    )


class Off:
    """LAPACK, of which one function adds a little to what it finds."""

    def __init__(self, lapack, name, by):
        self._lapack, self._name, self._by = lapack(), name, by

    def __call__(self):
        return self

    def __getattr__(self, name):
        function = getattr(self._lapack, name)

        def off(*arguments):
            found, *rest = function(*arguments)
            return found + self._by, *rest

        return off if name == self._name else function


@shows(
    "p3dof.loops.results.ForwardDynamics.residual", "p3dof.loops.batch.dynamics.BatchForwardDynamics.residual"
)
def test_the_residual_of_an_acceleration_that_is_off(loop, monkeypatch):
    """What the free motion is off by is left in the equation of motion, as its inertia."""
    q, v, _ = moving()
    right = loop.forward_dynamics(q, v, [3.0])
    monkeypatch.setattr(forward_dynamics, "lapack", Off(forward_dynamics.lapack, "dpotrs", 1e-8))
    found = loop.forward_dynamics(q, v, [3.0])
    missing = rnea(loop, q, v, found.a) - rnea(loop, q, v, right.a)
    expected = beyond_closures(q, missing)
    check_evidence(found, "residual", expected, rtol=1e-4)
    check_evidence(loop.forward_dynamics_batch([q], [v], [[3.0]]), "residual", [expected], rtol=1e-4)


@shows(
    "p3dof.loops.results.ForwardDynamics.closure_residual",
    "p3dof.loops.results.AcceleratedClosures.closure_residual",
    "p3dof.loops.batch.dynamics.BatchForwardDynamics.closure_residual",
    "p3dof.loops.results.HybridDynamics.closure_residual",
    "p3dof.loops.results.HybridDynamics.prescribed_residual",
    "p3dof.loops.results.PrescribedMotion.closure_residual",
    "p3dof.loops.results.PrescribedMotion.prescribed_residual",
)
def test_the_residuals_of_accelerations_that_open_the_loop(loop, monkeypatch):
    """Joints that follow are off: so is what they prescribe, and how fast the loop opens."""
    q, v, a = moving()
    right = loop.forward_dynamics(q, v, [3.0]), loop.hybrid_dynamics(q, v, a[:1])
    solve = Split.solve
    monkeypatch.setattr(Split, "solve", lambda self, b: solve(self, b) + 1e-9)
    found = loop.forward_dynamics(q, v, [3.0])
    expected = np.abs(slope(q) @ (found.a - right[0].a)).max()
    check_evidence(found, "closure_residual", expected, rtol=1e-4)
    check_evidence(found.evidence, "closure_residual", expected, rtol=1e-4)
    together = loop.forward_dynamics_batch([q], [v], [[3.0]])
    check_evidence(together, "closure_residual", [expected], rtol=1e-4)
    found = loop.hybrid_dynamics(q, v, a[:1])
    off = found.a - right[1].a
    for of in (found, found.evidence):
        check_evidence(of, "closure_residual", np.abs(slope(q) @ off).max(), rtol=1e-4)
        check_evidence(of, "prescribed_residual", abs(off[0]), rtol=1e-4)


@shows(
    "p3dof.loops.results.HybridDynamics.residual", "p3dof.loops.batch.dynamics.BatchHybridDynamics.residual"
)
def test_the_residual_of_a_force_that_is_off(loop, monkeypatch):
    """For one sample, and for one in a batch that goes alone: what no multiplier balances of the force."""
    q, v, a = moving()
    right = loop.hybrid_dynamics(q, v, a[:1])
    monkeypatch.setattr(hybrid_dynamics, "lapack", Off(hybrid_dynamics.lapack, "dgetrs", 1e-9))
    found = loop.hybrid_dynamics(q, v, a[:1])
    expected = beyond_closures(q, np.array([*(found.tau - right.tau), 0, 0]))
    check_evidence(found, "residual", expected, rtol=1e-4)
    check_evidence(loop.hybrid_dynamics_batch([q], [v], [a[:1]]), "residual", [expected], rtol=1e-4)


@shows("p3dof.loops.batch.dynamics.BatchHybridDynamics.residual")
def test_the_residual_of_many_forces_that_are_off(loop, monkeypatch):
    """Along the motion in which the crank turns by one: its own share is one, the force's error itself."""
    states = [moving(0.9 + 0.02 * n) for n in range(12)]
    q, v, a = (np.array(rows) for rows in zip(*states, strict=True))
    solution = BatchHybrid._solution
    wrong = np.linspace(2e-11, 4e-11, 12)

    def off(self, *arguments):
        tau, a, force, scale = solution(self, *arguments)
        return tau, a, force + np.outer(wrong, [1, 0, 0]), scale

    monkeypatch.setattr(BatchHybrid, "_solution", off)
    found = loop.hybrid_dynamics_batch(q, v, a[:, :1])
    assert not found.errors
    check_evidence(found, "residual", wrong, rtol=1e-3)


@shows("p3dof.loops.reactions.JointReactions.residual", "p3dof.loops.reaction_algebra.Solved.residual")
def test_the_residual_of_reactions_to_a_force_that_is_off(loop):
    """A torque beyond the motion is what is missing in the equation of motion, as far as nothing bears it."""
    q, v, a = moving()
    tau = loop.inverse_dynamics(q, v, a).tau
    solver, wrong = ReactionSolver(loop), 3e-9
    expected = beyond_closures(q, np.array([wrong, 0, 0]))
    check_evidence(solver.solve(q, v, a, tau + wrong), "residual", expected, rtol=1e-4)
    together = solver.solve_all([solver.state(q, v, a, tau + wrong)])
    check_evidence(together, "residual", [expected], rtol=1e-4)


# Runs.


@shows("p3dof.runs.results.RobotRun.gap")
def test_the_gap_of_a_run_that_starts_a_little_open(loop):
    q, *_ = moving()
    q = q + 1e-5 * OPEN
    run = simulate_robot(loop, 1e-4, q, samples=3, method="general")
    assert run.gap.shape == (3,)
    check_evidence(run, "gap", np.linalg.norm(opening(q)), rtol=1e-3, measure=lambda gaps: gaps[0])


@shows("p3dof.runs.results.RobotRun.error")
def test_the_error_of_a_robots_run():
    """Reference less value, by the shorter way of a joint that turns without end."""
    loop = ClosedLoopModel.from_urdf(
        robots.four_bar(*robots.FOUR_BAR, kind="continuous"), robots.FOUR_BAR_SIDECAR
    )
    q = loop.assemble([1.1]).q
    run = simulate_robot(loop, 0.01, q, samples=3, method="general")
    wrong = np.array([[0.1], [-3.0], [2 * np.pi + 0.2]])
    led = replace(run, reference=run.actuated + wrong)
    check_evidence(led, "error", [[0.1], [-3.0], [0.2]], rtol=1e-9)
    fixed = replace(
        led, loop=ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR)
    )
    plain = replace(fixed, q=np.zeros((3, 3)), reference=wrong)
    check_evidence(plain, "error", wrong)


@shows(
    "p3dof.runs.simulation.Simulation.error",
    "p3dof.runs.results.RunResult.peak_error",
    "p3dof.runs.results.RunResult.rms_error",
)
def test_the_errors_of_a_run():
    run = p3dof.load().simulate(0.02, samples=4, method="compiled")
    wrong = np.array([[1e-3, -2e-3, 0.1], [0, 4e-3, 0], [-3e-3, 0, -0.3], [0, 0, 0]])
    led = replace(run, reference=run.pose - wrong)
    check_evidence(led, "error", wrong, atol=1e-15)
    check_evidence(led, "peak_error", [3e-3, 4e-3, 0.3])
    check_evidence(led, "rms_error", [np.sqrt(10e-6 / 4), np.sqrt(20e-6 / 4), np.sqrt(0.1 / 4)])


@shows("p3dof.runs.simulation.Simulation.closure_error", "p3dof.runs.simulation.Simulation.gap")
def test_the_closure_error_of_a_run_whose_slider_is_off(monkeypatch):
    """A slider that is .1 mm too high opens its own loop by so much."""
    joints = MachineJoints.joints

    def off(self, states, rates):
        return joints(self, states + 1e-4 * np.eye(states.shape[1])[0], rates)

    monkeypatch.setattr(MachineJoints, "joints", off)
    run = p3dof.load().simulate(0.01, samples=3, method="pinocchio")
    check_evidence(run, "closure_error", np.full(3, 1e-4), rtol=1e-6)
    check_evidence(run, "gap", np.full(3, 1e-4), rtol=1e-6)


@pytest.fixture
def in_lanes(monkeypatch):
    """What comes out of C."""
    if build.compiler() is None:
        pytest.skip("no C compiler here")
    kept, found = [], PreparedRuns.found
    monkeypatch.setattr(PreparedRuns, "found", lambda self: kept.append(found(self)) or kept[-1])
    return kept


TIME = np.linspace(0, 0.1, 21)
FINE, EQUAL = Integration(1e-11, 1e-12), Integration(scheme="rk4", step=1e-3)


def lagging(loop, samples):
    """Two runs that lag behind, and their errors at the beginning of each period of control, (2, 10, 1)."""
    wanted = JointReference(TIME, 1.1 + 0.2 * np.sin(20 * TIME)[:, None])
    q, pd, control = loop.assemble([1.1]).q, JointPD(loop, wanted, 5.0, 0.1), ControlLoop(100.0)
    columns, off = {"q": [q, q], "v": [np.zeros(3), moving(speed=4.0)[1]]}, []
    runs = simulate_robot_many(loop, 0.1, columns, pd, control=control, samples=samples, integration=EQUAL)
    for v in columns["v"]:
        run = simulate_robot(
            loop, 0.1, q, v, pd, control=control, samples=11, integration=FINE, method="general"
        )
        off.append([wanted.at(0.01 * n)[0] - run.q[n, :1] for n in range(10)])
    return runs, np.array(off)


@shows(
    "p3dof.runs.robots_many.RobotRuns.peak_error",
    "p3dof.runs.robots_many.RobotRuns.rms_error",
    "p3dof.loops.compiled.runs.RunsFound.peak_error",
    "p3dof.loops.compiled.runs.RunsFound.square_error",
)
def test_the_errors_of_runs_in_lanes(loop, in_lanes):
    runs, off = lagging(loop, None)
    (found,) = in_lanes
    for one in (runs, found):
        check_evidence(one, "peak_error", np.abs(off).max(axis=1), rtol=1e-5)
    check_evidence(found, "square_error", np.sum(off**2, axis=1), rtol=1e-5)
    check_evidence(runs, "rms_error", np.sqrt(np.mean(off**2, axis=1)), rtol=1e-5)


@pytest.mark.parametrize("samples", [None, 11, 4])
@shows("p3dof.runs.robots_many.RobotRuns.peak_error", "p3dof.runs.robots_many.RobotRuns.rms_error")
def test_the_errors_of_runs_one_by_one_are_those_of_all_ticks(loop, samples, monkeypatch):
    """However many samples are kept."""
    monkeypatch.setattr(robots_many, "acting_in_c", lambda *_: None)
    runs, off = lagging(loop, samples)
    check_evidence(runs, "peak_error", np.abs(off).max(axis=1), rtol=1e-5)
    check_evidence(runs, "rms_error", np.sqrt(np.mean(off**2, axis=1)), rtol=1e-5)
    assert runs.past.get("q", np.zeros((2, 0))).shape[1] == (samples or 0)


@shows("p3dof.runs.robots_many.RobotRuns.gap", "p3dof.loops.compiled.runs.RunsFound.gap")
def test_the_gap_of_runs_that_start_a_little_open(loop, in_lanes):
    """What Newton's method finds before it closes the loop: that of the start, after one short step."""
    q = moving()[0] + np.outer([3e-5, 6e-5], OPEN)
    runs = simulate_robot_many(loop, 1e-5, {"q": q}, np.zeros(1), control=ControlLoop(), integration=EQUAL)
    expected = [np.linalg.norm(opening(row)) for row in q]
    for one in (runs, in_lanes[0]):
        check_evidence(one, "gap", expected, rtol=1e-3)


@shows("p3dof._base.time_series.smoothing.SmoothingFit.residual")
def test_the_residual_of_a_fit_is_what_it_leaves():
    """One piece is a polynomial of degree 5, which leaves what NumPy's leaves of powers and a wave."""
    time = np.linspace(3.0, 5.0, 40)
    values = np.stack([time**3 + 0.1 * np.sin(40 * time), np.cos(25 * time)], axis=-1)
    wanted = [np.polyval(np.polyfit(time - 4, column, 5), time - 4) for column in values.T]
    left = values - np.transpose(wanted)
    found = fitted(time, values, 0.2)
    check_evidence(found, "residual", np.sqrt(np.mean(left**2, axis=0)), rtol=1e-8)
    check_evidence(found, "largest", np.abs(left).max(axis=0), rtol=1e-7)


# Other engines.

LIBRARIES = {"mujoco": "mujoco", "drake": "pydrake", "exudyn": "exudyn"}


@pytest.mark.parametrize("name", LIBRARIES)
@shows("p3dof.methods.engines.base.Sample.gap")
def test_the_gap_that_an_engine_finds_of_a_slider_that_is_off(name):
    pytest.importorskip(LIBRARIES[name], reason=f"{name} not installed: pip install 'p3dof[engines]'")
    engine, motion = engines.load(name, p3dof.PAPER), p3dof.paper_motion(11)
    joints = p3dof.load().inverse_dynamics(motion).joints.columns(engine.joints)
    high = 1e-4 * (np.array(engine.joints) == "slide_a")
    sample = engine._sample(joints.q[4] + high, joints.v[4], joints.a[4], np.zeros(6))
    check_evidence(sample, "gap", 1e-4, rtol=1e-3, measure=np.linalg.norm)


@shows(
    "p3dof.methods.engines.driven.Convergence.errors",
    "p3dof.methods.engines.driven.Convergence.extrapolated_error",
    "p3dof.methods.engines.driven.Convergence.gaps",
)
def test_the_errors_of_forces_that_converge(monkeypatch):
    """Forces that are off by 8 h² + 16 h³ with h in milliseconds: what is extrapolated leaves the cubes."""
    motion = p3dof.paper_motion(9)
    motion = p3dof.Motion(np.arange(9) * 1e-3, motion.pose, motion.velocity, motion.acceleration, check=False)
    reference = np.outer(np.linspace(1, -2, 9), [100.0, 50, 25])

    def forces(parameters, motion, step, integrator, wrench):  # noqa: ARG001
        time = np.arange(step, motion.duration + step / 2, step)
        known = np.array([np.interp(time, motion.time, column) for column in reference.T]).T
        h = 1e3 * step
        known[:, 1] += np.where(np.isclose(time, 6e-3), 8 * h**2 + 16 * h**3, 0.5 * h**2)
        return driven.DrivenForces(integrator, step, time, known, np.array([0, 1e-6 * h, 1e-7]), 0.0)

    monkeypatch.setattr(driven, "driven_forces", forces)
    found = driven.convergence(p3dof.PAPER, motion, reference, halvings=1)  # from a millisecond
    largest = np.abs(reference[2::2]).max()
    check_evidence(found, "errors", np.array([24, 2 + 2]) / largest, rtol=1e-12)
    check_evidence(found, "gaps", [1e-6, 0.5e-6])
    check_evidence(found, "extrapolated_error", abs((4 * 4 - 24) / 3) / largest, rtol=1e-12)


@shows("p3dof.methods.engines.driven.DrivenForces.gap")
def test_the_gaps_of_a_driven_mechanism_are_those_of_its_sensors(monkeypatch):
    """The largest distance at any loop, which sensors give as coordinates."""
    numbers = np.random.default_rng(0).normal(0, 1e-6, (3, 5, 4))
    model = SimpleNamespace(
        drives=[0, 1, 2],
        closures=[3, 4, 5],
        add_sensor=lambda what, kind: what,  # noqa: ARG005
        add_drives=lambda *_: None,
        start=lambda *_: None,
        mechanism=p3dof.machine.description.describe(p3dof.PAPER),
        exudyn=SimpleNamespace(
            OutputVariableType=SimpleNamespace(Force=0, DisplacementLocal=1),
            DynamicSolverType=SimpleNamespace(TrapezoidalIndex2=0),
        ),
        system=SimpleNamespace(GetSensorStoredData=lambda n: numbers[n - 3] if n > 2 else np.ones((5, 2))),
    )
    settings = SimpleNamespace(timeIntegration=SimpleNamespace(generalizedAlpha=SimpleNamespace()))
    monkeypatch.setattr(driven, "_led_model", lambda *_: model)
    monkeypatch.setattr(driven, "settings", lambda *_: settings)
    monkeypatch.setattr(driven, "integrate", lambda *_: None)
    found = driven.driven_forces(p3dof.PAPER, p3dof.paper_motion(5), 0.25 * p3dof.paper_motion(5).duration)
    expected = np.sqrt((numbers[:, 1:, 1:] ** 2).sum(axis=2)).max(axis=0)
    check_evidence(found, "gap", expected)


# Commands.


@shows("p3dof.runs.forces_along.RobotForces.gap", "p3dof.runs.forces_along.RobotForces.residual")
def test_the_errors_of_forces_along_a_file(loop, tmp_path, monkeypatch):
    """Whatever the batch finds: the largest of all samples, of either sign."""
    path = tmp_path / "motion.csv"
    path.write_text("t,crank_joint\n" + "".join(f"{t},{1 + 0.1 * t * t}\n" for t in np.linspace(0, 1, 6)))
    batch = loop.inverse_dynamics_batch

    def off(*arguments, **named):
        found = batch(*arguments, **named)
        found.closure_error[3, 1], found.residual[2] = -4e-5, 0.7
        return found

    monkeypatch.setattr(loop, "inverse_dynamics_batch", off)
    found = along.forces_along(loop, path, samples=9)
    check_evidence(found, "gap", 4e-5)
    check_evidence(found, "residual", 0.7)
