"""Second opinions: MuJoCo, Drake and Exudyn, each with a model of its own."""

import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from machines import LIBRARIES, engine, off, random_machine, random_states
from numpy.polynomial import Polynomial

import p3dof
from p3dof._base.errors import DynamicsError, InputError, MissingExtraError, ModelError, ReachError
from p3dof.closed_form.kinematics import reachable
from p3dof.machine.description import describe
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import PAPER, SOLIDS, Actuators, Body, Friction
from p3dof.methods import engines
from p3dof.methods.engines import base
from p3dof.methods.engines.base import link_motions

EACH = pytest.mark.parametrize("name", list(LIBRARIES))
MOTION = p3dof.paper_motion(101)


def needs_exudyn():
    pytest.importorskip("exudyn", reason="exudyn not installed: pip install 'p3dof[engines]'")


def tell(text):
    print(f"\n{text}")  # noqa: T201 - what was measured, for pytest -s


def wrenches(count, seed=0):
    return np.random.default_rng(seed).normal(0, 20, (count, 6))


# --- instants ----------------------------------------------------------------------------------------


@EACH
@pytest.mark.parametrize("parameters", [PAPER, SOLIDS], ids=["paper", "solids"])
@pytest.mark.parametrize("wrench", [None, np.arange(6.0), wrenches(101)], ids=["free", "constant", "varying"])
def test_forces_of_the_papers_motion_are_those_of_both_routes(name, parameters, wrench):
    found = engine(name, parameters).forces(MOTION, wrench)
    robot = p3dof.load(parameters)
    for method in ("virtual-power", "pinocchio"):
        expected = robot.inverse_dynamics(MOTION, method=method, wrench=wrench).forces
        assert off(found, expected) < 2e-13


@EACH
def test_forces_of_random_machines_are_those_of_virtual_power(name):
    """Without any symmetry, gravity from anywhere; every third machine has massless cross-bars."""
    worst = 0.0
    for seed in range(12):
        parameters = random_machine(seed)
        states = random_states(parameters, seed, 4, drop=0.3, angle=0.2, side=1)
        time = np.arange(float(len(states.pose)))
        motion = p3dof.Motion(time, states.pose, states.velocity, states.acceleration, check=False)
        found = engine(name, parameters).forces(motion, states.wrench)
        expected = (
            p3dof.load(parameters)
            .inverse_dynamics(motion, method="virtual-power", wrench=states.wrench)
            .forces
        )
        worst = max(worst, off(found, expected))
    tell(f"{name}: {worst:.1e}")
    assert worst < 5e-12


@EACH
def test_an_error_of_a_percent_in_any_mass_shows(name):
    motion = p3dof.paper_motion(5)
    expected = p3dof.load(SOLIDS).inverse_dynamics(motion, method="virtual-power").forces
    for link, body in SOLIDS.bodies.items():
        heavier = replace(SOLIDS.bodies, **{link: Body(1.01 * body.mass, body.com, 1.01 * body.inertia)})
        wrong = replace(SOLIDS, bodies=heavier)
        found = engine(name, wrong).forces(motion)
        assert off(found, expected) > 1e-5, link
        again = p3dof.load(wrong).inverse_dynamics(motion, method="virtual-power").forces
        assert off(found, again) < 2e-13


@EACH
def test_gravity_is_that_of_the_parameters(name):
    still = p3dof.Motion([0.0], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    held = engine(name).forces(still)
    assert held.sum() == pytest.approx(9.806 * PAPER.bodies.mass, rel=1e-13)
    weightless = engine(name, replace(PAPER, gravity=np.zeros(3)))
    assert np.abs(weightless.forces(still)).max() < 1e-12


@EACH
def test_progress_is_told(name):
    told = []
    engine(name).forces(MOTION[:3], progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 3), (2, 3), (3, 3)]


# --- an engine believes nothing that its own model contradicts ---------------------------------------


def lying(monkeypatch, change):
    """Let the kinematics be wrong: `change` gets its true result and its arguments."""
    true = base.kinematics.motion_at
    monkeypatch.setattr(base.kinematics, "motion_at", lambda *given: change(true, *given))


def rates_of_joints(motion, names):
    """Velocities and accelerations of joints at the first sample [m/s, m/s²], of hinges a length L away."""
    joints = p3dof.load().inverse_dynamics(motion).joints.columns(names)
    arms = [1.0 if name.startswith("slide") else PAPER.geometry.L for name in names]
    return joints.v[0] * arms, joints.a[0] * arms


@EACH
@pytest.mark.parametrize(
    ("what", "joint"), [("position", "hinge_a"), ("velocity", "hinge_right"), ("acceleration", "slide_b")]
)
def test_an_open_loop_is_refused(name, what, joint, monkeypatch):
    def change(true, *given):
        motion = true(*given)
        values = getattr(motion, what)
        return replace(motion, **{what: {**values, joint: values[joint] + 1e-6}})

    made, (v, a) = engine(name), rates_of_joints(MOTION[20:22], engine(name).joints)
    L, speed = PAPER.geometry.L, max(np.abs(v))  # sliders, and turning legs at their ends
    scales = {"position": L, "velocity": speed, "acceleration": max(np.abs(a)) + speed**2 / L + 9.81}
    lying(monkeypatch, change)
    told = rf"^{name}: sample 0: finds its loops open in {what} by .*e-0"
    with pytest.raises(DynamicsError, match=rf"{told}.* at most {base.CLOSED * scales[what]:.2g} \(SI units"):
        made.forces(MOTION[20:22])


@EACH
@pytest.mark.parametrize("order", range(3))
@pytest.mark.parametrize("axis", range(3))
def test_another_motion_of_the_platform_is_refused(name, order, axis, monkeypatch):
    def change(true, geometry, placed):
        moved = [state + 1e-6 * np.eye(3)[axis] * (i == order) for i, state in enumerate(placed.states[:3])]
        return true(geometry, reachable(geometry, states_of(*moved)))

    lying(monkeypatch, change)
    what = ("position", "velocity", "acceleration")[order]
    with pytest.raises(DynamicsError, match=f"^{name}: sample 0: finds the platform elsewhere in {what}"):
        engine(name).forces(MOTION[20:22])


def test_links_move_as_their_frames_in_pinocchio():
    """Also the rates of the quaternion, by differences."""
    mechanism, rng = describe(PAPER), np.random.default_rng(0)
    q, v, a = rng.normal(0, 1, (3, 10))
    found, h = link_motions(mechanism, q, v, a), 1e-4
    at = {t: link_motions(mechanism, q + v * t + a * t * t / 2, v + a * t) for t in (-h, 0.0, h)}
    for link, motion in found.items():
        before, now, after = (at[t][link] for t in (-h, 0.0, h))
        for what, rate in (("position", motion.velocity), ("velocity", motion.acceleration)):
            slope = (getattr(after, what) - getattr(before, what)) / (2 * h)
            np.testing.assert_allclose(slope, rate, rtol=0, atol=1e-6)
        np.testing.assert_allclose((after.omega - before.omega) / (2 * h), motion.epsilon, rtol=0, atol=1e-6)
        first, second = motion.quaternion_rates()
        p0, p1, p2 = before.quaternion, now.quaternion, after.quaternion
        np.testing.assert_allclose((p2 - p0) / (2 * h), first, rtol=0, atol=1e-6)
        np.testing.assert_allclose((p2 - 2 * p1 + p0) / h**2, second, rtol=0, atol=1e-5)


# --- in time -----------------------------------------------------------------------------------------


def test_led_along_the_papers_motion_exudyn_finds_its_forces():
    """From its start at 5 rad/s; second order, fourth after one extrapolation."""
    needs_exudyn()
    motion = p3dof.paper_motion(1001)
    expected = p3dof.load().inverse_dynamics(motion, method="virtual-power").forces
    found = engines.convergence(PAPER, motion, expected, step=4e-3, halvings=2)
    tell(
        f"errors {found.errors}, orders {found.orders}, extrapolated {found.extrapolated_error:.1e}, "
        f"gaps {found.gaps} m"
    )
    np.testing.assert_array_equal(found.steps, [4e-3, 2e-3, 1e-3])
    np.testing.assert_allclose(found.orders, 2, rtol=0, atol=0.002)
    assert found.errors[-1] < 7e-6
    assert found.extrapolated_error < 5e-9
    assert found.forces.shape == (125, 3)
    np.testing.assert_allclose(found.time, np.arange(1, 126) * 8e-3, rtol=1e-13)
    np.testing.assert_allclose(found.gaps[:-1] / found.gaps[1:], 4, rtol=1e-3)
    once = engines.convergence(PAPER, motion, expected, step=8e-3, halvings=1).extrapolated_error
    twice = engines.convergence(PAPER, motion, expected, step=4e-3, halvings=1).extrapolated_error
    assert np.log2(once / twice) == pytest.approx(4, abs=0.1)


@pytest.mark.parametrize("varying", [False, True])
def test_led_under_a_wrench(varying):
    needs_exudyn()
    motion = p3dof.paper_motion(501)
    wrench = np.array([5, 10, -20, 0.5, 1, 0.3])
    if varying:
        wrench = wrench * np.sin(7 * motion.time)[:, None]
    expected = p3dof.load(SOLIDS).inverse_dynamics(motion, method="virtual-power", wrench=wrench).forces
    found = engines.convergence(SOLIDS, motion, expected, step=4e-3, halvings=1, wrench=wrench)
    assert found.orders == pytest.approx([2], abs=0.002)
    assert found.extrapolated_error < 1e-7


def from_rest(step, duration=0.5, ramp=0.2):
    """The paper's motion x(s(t)); ds/dt rises from 0 to 1 with three vanishing derivatives."""
    rise = (Polynomial([0, 1]) ** 3 * Polynomial([1, -1]) ** 3).integ()
    rise /= rise(1.0)
    t = np.arange(round(duration / step) + 1) * step
    u = np.minimum(t / ramp, 1.0)
    s = ramp * rise.integ()(u) + np.maximum(t - ramp, 0.0)
    ds, dds = rise(u)[:, None], np.where(u < 1, rise.deriv()(u) / ramp, 0.0)[:, None]
    w = 4 * np.pi
    path = [Polynomial([0, 0, -0.3, 1.3, -1]), Polynomial([0, 0, -0.2, -0.2, 0.4])]
    x, dx, ddx = (
        np.column_stack([curve.deriv(n)(s) if n else curve(s) for curve in path] + [swing])
        for n, swing in enumerate([0.4 * np.sin(w * s), 0.4 * w * np.cos(w * s), -0.4 * w**2 * np.sin(w * s)])
    )
    return p3dof.Motion(t, x, dx * ds, ddx * ds**2 + dx * dds)


def test_led_from_rest_by_either_integrator():
    needs_exudyn()
    motion = from_rest(1e-3)
    expected = p3dof.load().inverse_dynamics(motion, method="virtual-power").forces
    for integrator, error, extrapolated in (("trapezoidal", 2.5e-5, 1e-7), ("generalized-alpha", 6e-5, 1e-5)):
        found = engines.convergence(PAPER, motion, expected, 2e-3, 2, integrator)
        tell(f"{integrator}: {found.errors} {found.orders} {found.extrapolated_error:.1e} {found.gaps}")
        assert found.integrator == integrator
        assert np.all(found.orders > 1.9)
        assert found.errors[-1] < error
        assert found.extrapolated_error < extrapolated


def test_a_percent_of_mass_shows_in_time():
    needs_exudyn()
    motion = p3dof.paper_motion(251)
    expected = p3dof.load().inverse_dynamics(motion, method="virtual-power").forces
    leg = PAPER.bodies.leg_a
    heavier = replace(PAPER.bodies, leg_a=Body(1.01 * leg.mass, leg.com, leg.inertia))
    found = engines.convergence(replace(PAPER, bodies=heavier), motion, expected, 4e-3, 1)
    assert found.extrapolated_error > 1e-4


def test_a_run_says_what_it_was():
    needs_exudyn()
    begin = time.perf_counter()
    run = engines.driven_forces(PAPER, p3dof.paper_motion(101)[:51], 5e-3)
    assert 0 < run.seconds <= time.perf_counter() - begin
    assert run.integrator == "trapezoidal"
    np.testing.assert_allclose(run.time, np.arange(1, 101) * 5e-3, rtol=1e-12)
    assert run.forces.shape == (100, 3)
    assert 0 < run.gap.max() < 1e-5


# --- the free machine --------------------------------------------------------------------------------


def pushed():
    """Forces that do not hold the machine at home."""
    return p3dof.load().forces(np.zeros(3), np.zeros(3), np.zeros(3)) * [0.8, 1, 1.1]


def released(pose, forces, duration):
    """The pose at the end, by the minimal form's forward dynamics."""
    from scipy.integrate import solve_ivp

    robot = p3dof.load()

    def rate(_, x):
        return np.concatenate([x[3:], robot.forward_dynamics(x[:3], x[3:], forces, method="virtual-power")])

    return solve_ivp(rate, (0, duration), np.append(pose, np.zeros(3)), "DOP853", rtol=1e-11, atol=1e-13).y[
        :3, -1
    ]


@pytest.mark.parametrize(
    ("name", "step", "bound"),
    [("mujoco", 1e-3, 1e-7), ("exudyn", 1e-3, 5e-6), ("exudyn", 2.5e-4, 3e-7), ("drake", 2.5e-4, 1e-3)],
)
def test_released_it_ends_where_the_minimal_form_has_it(name, step, bound):
    pose = np.array([0.02, -0.03, 0.1])
    made, begin = engine(name), time.perf_counter()
    end = made.simulate(0.15, step, pose, pushed())
    assert 0 < end.seconds <= time.perf_counter() - begin
    joints = p3dof.load().inverse_kinematics(released(pose, pushed(), 0.15)).joints
    assert list(end.positions) == list(joints)
    error = max(abs(end.positions[joint] - value) for joint, value in joints.items())
    tell(f"{name}, {step:g} s: {error:.1e} m or rad, {end.speed:.1f} times reality")
    assert error < bound
    assert (end.engine, end.duration, end.step) == (name, 0.15, step)
    assert end.speed == pytest.approx(0.15 / end.seconds)


@pytest.mark.parametrize(("name", "order"), [("mujoco", 2), ("drake", 1), ("exudyn", 2)])
def test_released_it_converges_in_the_step(name, order):
    pose, forces = np.zeros(3), pushed()
    joints = p3dof.load().inverse_kinematics(released(pose, forces, 0.1)).joints
    ends = [engine(name).simulate(0.1, step, pose, forces).positions for step in (1e-3, 5e-4)]
    errors = [max(abs(end[joint] - value) for joint, value in joints.items()) for end in ends]
    assert all(np.log2(a / b) == pytest.approx(order, abs=0.05) for a, b in pairwise(errors))


@EACH
def test_springs_at_rest_at_home_leave_the_machine_there(name):
    """What holds it without springs holds it with them: none is stretched, but for loops that are soft."""
    hung = replace(PAPER, actuators=Actuators(spring={"sliders": 5000.0}))
    end = engine(name, hung).simulate(0.1, 1e-3, np.zeros(3), p3dof.load().forces(*np.zeros((3, 3))))
    home = p3dof.load().inverse_kinematics(np.zeros(3)).joints
    assert max(abs(end.positions[joint] - value) for joint, value in home.items()) < 1e-6


@EACH
def test_nothing_stops_the_free_machine(name):
    """Not even at the ends of its guide-ways, 0.2 m from home, or with more force than its actuators have."""
    lifted = engine(name).simulate(0.2, 1e-3, np.zeros(3), 3 * [600.0])
    rise = (1800 / PAPER.bodies.mass - 9.806) * 0.2**2 / 2
    assert rise > 0.5
    for slide in ("slide_a", "slide_b", "slide_c"):
        assert lifted.positions[slide] == pytest.approx(rise, rel=0.2)


# --- what does not fit -------------------------------------------------------------------------------


def test_engines_are_known_by_name():
    assert list(engines.ENGINES) == list(LIBRARIES)
    assert all(kind.name == name for name, kind in engines.ENGINES.items())
    for wrong in ("ode", "", None, 3, ["mujoco"]):
        with pytest.raises(InputError, match="engine: expected one of mujoco, drake, exudyn, got"):
            engines.load(wrong)


@EACH
def test_an_engine_says_what_it_is(name):
    made = engine(name)
    assert made.name == name
    assert made.parameters is PAPER
    assert made.version[0].isdigit()
    assert repr(made) == f"{type(made).__name__}({name} {made.version})"
    assert len(made.joints) == 10


@EACH
def test_a_missing_library_names_the_extra(name, monkeypatch):
    monkeypatch.setitem(sys.modules, LIBRARIES[name], None)
    with pytest.raises(MissingExtraError, match=rf"engine {name} needs .* pip install 'p3dof\[engines\]'"):
        engines.load(name)


def test_in_time_a_missing_library_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "exudyn", None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[engines\]"):
        engines.driven_forces(PAPER, MOTION, 0.01)


def test_no_library_is_loaded_before_it_is_needed():
    loaded = f"sorted({set(LIBRARIES.values())} & set(sys.modules))"
    code = f"import sys, p3dof.methods.engines; print({loaded})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@EACH
def test_what_is_no_machine_is_refused(name):
    with pytest.raises(InputError, match="parameters: expected Parameters, got int"):
        engines.load(name, 3)
    rough = replace(PAPER, friction=Friction(viscous={"sliders": 1.0}))
    with pytest.raises(InputError, match="without friction, got some in slide_a, slide_b, slide_c"):
        engines.load(name, rough)


def test_where_no_neighbour_has_mass_to_give_only_exudyn_goes_on():
    """Rods without thickness: their masses on their axes, no inertia to share."""
    rod = Body(1.0, [0.2, 0, 0], [0, 1e-2, 1e-2])
    slender = replace(PAPER, bodies=replace(PAPER.bodies, rod_left=rod, rod_right=rod))
    for name in ("mujoco", "drake"):
        with pytest.raises(ModelError, match="massless link"):
            engine(name, slender)
    expected = p3dof.load(slender).inverse_dynamics(MOTION, method="virtual-power").forces
    assert off(engine("exudyn", slender).forces(MOTION), expected) < 2e-13


@EACH
def test_bad_input_to_forces(name):
    made = engine(name)
    with pytest.raises(InputError, match="motion: expected a Motion, got 3"):
        made.forces(3)
    for wrench in ([1, 2], np.zeros((5, 6)), 6 * [np.nan], "x"):
        with pytest.raises(InputError, match="wrench"):
            made.forces(MOTION, wrench)
    far = p3dof.Motion([0.0], [[5.0, 0, 0]], np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(ReachError, match="out of reach"):
        made.forces(far)


@EACH
def test_bad_input_to_a_simulation(name):
    made = engine(name)
    for given, text in (
        ((0.1, 0.03, np.zeros(3), np.zeros(3)), "step: expected one that divides"),
        ((-1, 0.1, np.zeros(3), np.zeros(3)), "duration: expected a positive number"),
        ((1, "x", np.zeros(3), np.zeros(3)), "step: expected real numbers"),
        ((0.1, 0.1, np.zeros(2), np.zeros(3)), r"pose: expected shape \(3,\)"),
        ((0.1, 0.1, np.zeros(3), [1, 2, np.inf]), "forces: expected finite"),
    ):
        with pytest.raises(InputError, match=text):
            made.simulate(*given)
    with pytest.raises(ReachError):
        made.simulate(0.1, 0.1, [5, 0, 0], np.zeros(3))


@pytest.mark.parametrize("name", ["mujoco", "exudyn"])
def test_a_simulation_that_fails_says_so_and_nothing_else(name, tmp_path, monkeypatch, capfd):
    made = engine(name)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DynamicsError, match=f"^{name}: "):
        made.simulate(2.0, 0.05, np.zeros(3), [500.0, 0, 0])
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


def test_bad_input_in_time():
    needs_exudyn()
    expected = np.zeros((101, 3))
    for call, text in (
        (lambda: engines.driven_forces(3, MOTION, 0.01), "parameters: expected Parameters"),
        (lambda: engines.driven_forces(PAPER, 3, 0.01), "motion: expected a Motion"),
        (lambda: engines.driven_forces(PAPER, MOTION[:1], 0.01), "at least two samples"),
        (lambda: engines.driven_forces(PAPER, MOTION, 0.03), "step: expected one that divides"),
        (lambda: engines.driven_forces(PAPER, MOTION, 0.01, "euler"), "expected one of trapezoidal, gen"),
        (lambda: engines.driven_forces(PAPER, MOTION, 0.01, wrench=[1]), "wrench"),
        (lambda: engines.driven_forces(PAPER, MOTION, 0.01, "generalized-alpha"), "start at rest"),
        (lambda: engines.convergence(PAPER, MOTION, expected[:3]), "reference: expected shape"),
        (lambda: engines.convergence(PAPER, MOTION, expected, 1e-3), "samples at every second step"),
        (lambda: engines.convergence(PAPER, MOTION, expected, 1.0), "samples at every second step"),
        (lambda: engines.convergence(PAPER, MOTION, expected, "x"), "step: expected real numbers"),
        (lambda: engines.convergence(PAPER, MOTION, expected, 0.01, 0), "halvings: expected 1 to 6, got 0"),
    ):
        with pytest.raises(InputError, match=text):
            call()
    with pytest.raises(DynamicsError, match="exudyn: the simulation failed"):
        engines.driven_forces(PAPER, MOTION, 0.5)
