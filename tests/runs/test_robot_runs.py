"""Runs of any robot: what ends them, events, controllers, loads, and what they leave behind."""

from __future__ import annotations

from contextlib import nullcontext

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

import p3dof
from p3dof._base.errors import ControllerError, InputError, MotionError
from p3dof.loops import ClosedLoopModel, Sidecar
from p3dof.runs import (
    ControlLoop,
    Event,
    InitialState,
    Integration,
    JointComputedTorque,
    JointFeedforward,
    JointPD,
    JointReference,
    gains,
    moved_inertia,
    simulate_robot,
)

FINE = Integration(rtol=1e-11, atol=1e-13)


def five_bar(actuated=("left_joint", "right_joint")):
    return ClosedLoopModel.from_urdf(
        robots.five_bar(), Sidecar(robots.FIVE_BAR_SIDECAR.closures, tuple(actuated))
    )


def slider(lower=-9.0, upper=9.0, effort=9.0, velocity=9.0):
    """A mass of 2 kg on a horizontal slide: x = F t² / 4."""
    text = robots.robot(
        robots.link("base"),
        robots.link("body", robots.Solid(2.0, (0, 0, 0), (0.1, 0, 0, 0.1, 0, 0.1))),
        robots.joint("slide", "base", "body", axis=(1, 0, 0), kind="prismatic"),
    )
    limit = f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"/>'
    return ClosedLoopModel.from_urdf(
        text.replace('<limit lower="-9" upper="9" effort="9" velocity="9"/>', limit), ()
    )


def reference(amplitude=0.1, count=41, duration=1.0):
    """Both motors of the five-bar, from rest to rest."""
    time = np.linspace(0, duration, count)
    s = time / duration
    smooth = s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
    return JointReference(time, np.array([1.9, 1.2]) + amplitude * smooth[:, None] * [1.0, -1.5])


# --- what ends a run ----------------------------------------------------------------------------------------


def test_a_joint_at_its_limit_ends_the_run_at_the_right_time():
    run = simulate_robot(slider(upper=0.3), 2.0, controller=[3.0], samples=11, method="general")
    exact = np.sqrt(4 * 0.3 / 3.0)
    assert run.stop.kind == "joint limit"
    assert run.stop.time == pytest.approx(exact, abs=1e-9)
    assert "the joint 'slide' at its upper limit, 0.3" in str(run.stop)
    assert run.time[-1] == run.stop.time
    assert run.q[-1, 0] == pytest.approx(0.3, abs=1e-9)
    assert not run.finished
    free = simulate_robot(slider(upper=0.3), 2.0, controller=[3.0], samples=11, stop_at=(), method="general")
    assert free.finished
    assert free.q[-1, 0] == pytest.approx(3.0, abs=1e-9)
    down = simulate_robot(slider(lower=-0.2), 2.0, controller=[-3.0], samples=11, method="general")
    assert down.stop.time == pytest.approx(np.sqrt(4 * 0.2 / 3.0), abs=1e-9)


def test_limits_of_a_closed_loop_end_a_run_where_the_closed_form_has_them():
    """The elbow is at its limit where the motors' angles, integrated finely, put it."""
    loop, start = five_bar(), robots.five_bar_q(1.9, 1.2)
    free = simulate_robot(loop, 0.2, start, samples=3, integration=FINE, method="general")
    limits = [np.array(loop.model.lowerPositionLimit), np.array(loop.model.upperPositionLimit)]
    moved = free.q[:, 1] - start[1]
    assert abs(moved[1]) > 0.01
    limits[int(moved[1] > 0)][1] = free.q[1, 1]
    loop.model.lowerPositionLimit, loop.model.upperPositionLimit = limits
    run = simulate_robot(loop, 1.0, start, samples=5, method="general")
    assert run.stop.kind == "joint limit"
    assert "'left_elbow' at its" in run.stop.reason
    assert run.stop.time == pytest.approx(0.1, abs=1e-9)
    assert robots.five_bar_q(*run.actuated[-1])[1] == pytest.approx(free.q[1, 1], abs=1e-9)


def test_limits_that_a_file_leaves_out_are_none():
    assert simulate_robot(
        slider(lower=0, upper=0), 0.2, controller=[3.0], samples=3, method="general"
    ).finished


def test_closures_that_become_dependent_end_a_run():
    """A parallelogram folds flat: its closure loses rank where all bars lie in one line."""
    lengths = (0.5, 0.2, 0.5, 0.2)
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), robots.FOUR_BAR_SIDECAR)
    speed = loop.complete([0.6], [-2.0], [0.0], np.array([0.6, -0.6, 0.6]))
    run = simulate_robot(loop, 1.0, speed.q, speed.v, samples=101, method="general")
    assert run.stop.kind == "singular closures"
    assert abs(run.q[-1, 0]) < 1e-4
    assert "\n" not in str(run.stop)
    short = simulate_robot(loop, 0.9 * run.stop.time, speed.q, speed.v, samples=11, method="general")
    assert short.finished
    upper = np.array(loop.model.upperPositionLimit)
    upper[0] = 0.5
    loop.model.upperPositionLimit = upper
    with pytest.raises(InputError, match="would start beyond a limit: joint limit: the joint 'crank_joint'"):
        simulate_robot(loop, 1.0, speed.q, method="general")


@pytest.mark.parametrize("method", ["general", None])
@pytest.mark.parametrize("controller", [[0.1], None], ids=["forces", "none"])
def test_a_singular_start_is_told_and_none_beside_it(method, controller):
    """Flat at zero, a parallelogram has two free motions: the motor determines one."""
    loop = ClosedLoopModel.from_urdf(robots.flat_parallelogram(), robots.PARALLELOGRAM_SIDECAR)
    controller = np.full(len(loop.actuated), 0.1) if controller else None
    with pytest.raises(InputError, match=r"singular configuration, .* regular_configuration give a regular"):
        simulate_robot(loop, 0.1, controller=controller, samples=3, method=method)
    beside = loop.regular_configuration
    assert simulate_robot(loop, 0.01, beside, controller=controller, samples=3, method=method).finished


def test_events_end_a_run_or_are_noted():
    loop = slider()
    fast = Event("fast", lambda _t, _q, v: v[0] - 1.5)
    passing = Event("passing", lambda _t, q, _v: np.sin(8 * q[0]), stops=False)
    late = Event("late", lambda t, _q, _v: t - 0.25, stops=False)
    run = simulate_robot(
        loop, 2.0, [0.1], controller=[3.0], events=[passing, fast, late], samples=21, method="general"
    )
    assert (run.stop.kind, run.stop.reason) == ("event", "fast")
    assert run.stop.time == pytest.approx(1.0, abs=1e-9)  # v = 1.5 t
    x = np.pi / 8 * np.array([1, 2])
    times = np.sqrt((x - 0.1) / 0.75)
    assert [event.name for event in run.events] == ["late", "passing", "passing"]
    np.testing.assert_allclose([event.time for event in run.events], [0.25, *times], rtol=0, atol=1e-9)
    assert [event.rising for event in run.events] == [True, False, True]
    assert str(run.events[0]) == "late at t = 0.25 s"


def test_events_are_noted_in_steps_that_hold_no_sample():
    late = Event("late", lambda t, _q, _v: t - 0.25, stops=False)
    run = simulate_robot(
        slider(), 1.0, controller=[3.0], events=[late], samples=2, stop_at=(), method="general"
    )
    assert [event.name for event in run.events] == ["late"]
    assert run.events[0].time == pytest.approx(0.25, abs=1e-9)


def test_an_event_whose_value_fades_without_end_never_happens():
    fading = Event("fading", lambda t, _q, _v: np.exp(-1e5 * t), stops=False)
    run = simulate_robot(slider(), 0.006, controller=[3.0], events=[fading], samples=3, method="general")
    assert run.finished
    assert run.events == ()


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (("bad", lambda *_: 1 / 0), "event 'bad' failed at t = 0 s: division by zero"),
        (("bad", lambda *_: [1, 2]), "event 'bad': expected a finite number at t = 0 s"),
        (("bad", lambda *_: np.nan), "event 'bad': expected a finite number"),
        (("bad", lambda _t, _q, v: v[0]), "event 'bad': the run would start at it, its value is zero"),
    ],
)
def test_events_that_are_none(event, words):
    with pytest.raises(InputError, match=words):
        simulate_robot(slider(), 1.0, events=[Event(*event)], method="general")


def test_arguments_that_do_not_fit_a_robot():
    loop, good = slider(), Event("same", lambda *_: 1.0)
    for arguments, words in (
        (
            {"stop_at": ["collision"]},
            "stop_at: expected a list of joint limit, singular closures, got 'collision'",
        ),
        ({"events": [good, good]}, "events: two are called 'same'"),
        ({"events": good}, "events: expected a list of Event"),
        ({"control": 3}, r"control: expected ControlLoop\(...\), got 3"),
        ({"control": ControlLoop(saturation=[1, 2])}, "saturation: expected one force or 1, got 2"),
        ({"reference": [1.0, 2.0]}, "reference: expected values of the 1 actuated joints, got 2"),
        ({"external": {"hand": np.zeros(6)}}, "external: the frame 'hand' does not exist"),
        ({"external": {"body": np.zeros(3)}}, r"external 'body': wrench: expected shape \(6,\)"),
        ({"external": [1.0]}, "external: expected a mapping of frames to wrenches"),
        ({"q": InitialState()}, "q: of any robot an InitialState gives the joints"),
    ):
        with pytest.raises(InputError, match=words):
            simulate_robot(loop, 1.0, **arguments)
    for arguments, words in (
        ((" ", good.value), "event: expected a name"),
        (("x", 3), "expected a function"),
    ):
        with pytest.raises(InputError, match=words):
            Event(*arguments)


# --- controllers --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frequency", "damping"), [(2.0, 0.3), (1.5, 1.0), (0.8, 2.0)])
def test_gains_are_those_of_a_damped_oscillator(frequency, damping):
    """Its characteristic numbers; and an error that computed torque lets swing freely."""
    kp, kd = gains(frequency, damping)
    omega = 2 * np.pi * frequency
    np.testing.assert_allclose([kp, kd], [omega**2, 2 * damping * omega], rtol=1e-14)
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR)
    start, offset = 1.1, 0.05
    controller = JointComputedTorque(loop, [start + offset], kp, kd)
    run = simulate_robot(
        loop,
        0.3,
        robots.four_bar_q(start, *robots.FOUR_BAR),
        controller=controller,
        samples=7,
        method="general",
    )
    matrix = np.array([[0, 1], [-(omega**2), -2 * damping * omega]])
    expected = [(expm(matrix * t) @ [offset, 0])[0] for t in run.time]
    np.testing.assert_allclose(run.error[:, 0], expected, rtol=0, atol=1e-7)


def test_computed_torque_follows_a_motion_and_pd_lags_behind():
    loop, wanted = five_bar(), reference()
    q = robots.five_bar_q(1.9, 1.2)
    exact = simulate_robot(
        loop, 1.0, q, controller=JointComputedTorque(loop, wanted, *gains(5)), samples=21, method="general"
    )
    assert np.abs(exact.error).max() < 1e-8
    inertia = moved_inertia(loop, q)
    kp, kd = (gain * inertia for gain in gains(5))
    lagging = simulate_robot(
        loop, 1.0, q, controller=JointPD(loop, wanted, kp, kd, gravity=True), samples=21, method="general"
    )
    sagging = simulate_robot(
        loop, 1.0, q, controller=JointPD(loop, wanted, kp, kd), samples=21, method="general"
    )
    errors = [np.abs(run.error).max() for run in (exact, lagging, sagging)]
    assert errors[0] < 1e-4 * errors[1]
    assert errors[1] < 0.5 * errors[2]
    np.testing.assert_allclose(exact.reference, wanted.over(exact.time)[0])


def test_forces_of_an_inverse_dynamics_run_are_fed_forward():
    loop, wanted = five_bar(), reference()
    time = np.linspace(0, 0.3, 601)
    states = loop.complete_batch(*wanted.over(time), robots.five_bar_q(1.9, 1.2))
    forces = loop.inverse_dynamics_batch(states.q, states.v, states.a).tau
    q, kp, kd = states.q[0], 30.0, 3.0
    fed = simulate_robot(
        loop,
        0.3,
        q,
        controller=JointFeedforward(loop, wanted, time, forces, kp, kd),
        samples=7,
        method="general",
    )
    plain = simulate_robot(
        loop, 0.3, q, controller=JointPD(loop, wanted, kp, kd), samples=7, method="general"
    )
    assert np.abs(fed.error).max() < 1e-5
    assert np.abs(plain.error).max() > 1e3 * np.abs(fed.error).max()
    with pytest.raises(InputError, match="time: expected rising times"):
        JointFeedforward(loop, wanted, [0.0, 0.0], np.zeros((2, 2)))


def test_held_forces_change_at_the_ticks_and_are_cut_off():
    """Of a sampled PD: forces are constant in between; saturation takes the file's effort."""
    loop, ticks = slider(effort=2.0), ControlLoop(rate=50, saturation=True)
    run = simulate_robot(
        loop, 0.5, controller=JointPD(loop, [1.0], 20.0, 4.0), control=ticks, samples=501, method="general"
    )
    held = run.forces[:, 0].reshape(-1)
    at = np.floor(run.time * 50 + 1e-9)
    for tick in np.unique(at)[:-1]:
        assert np.ptp(held[at == tick]) == 0
    assert np.abs(run.forces).max() == 2.0
    assert run.asked.max() == pytest.approx(20.0, rel=1e-6)
    weak = simulate_robot(
        loop, 0.5, controller=[5.0], control=ControlLoop(saturation=0.5), samples=3, method="general"
    )
    np.testing.assert_array_equal(weak.forces, 0.5)
    noisy = ControlLoop(rate=50, noise=p3dof.runs.Noise(1e-3, 1e-3, 7))
    one, other = (
        simulate_robot(
            loop, 0.2, controller=JointPD(loop, [1.0], 20.0), control=noisy, samples=5, method="general"
        )
        for _ in range(2)
    )
    np.testing.assert_array_equal(one.forces, other.forces)
    assert one.forces[0, 0] != 20.0


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0, 1.5])
def test_a_sample_at_a_tick_has_the_forces_that_begin_to_act_there(late):
    """Ten ticks a second, the k-th asks for 1 + k newtons; those of the first act from the start."""
    run = simulate_robot(
        slider(effort=100.0),
        1.0,
        controller=lambda seen: [1 + 10 * seen.time],
        control=ControlLoop(rate=10, delay=0.1 * late),
        samples=21,
        method="general",
    )
    halves = np.arange(20)
    tick = np.maximum(np.floor(halves / 2 - late), 0)
    np.testing.assert_allclose(run.forces[:20, 0], 1 + tick, rtol=0, atol=1e-12)
    speeds = np.cumsum([0, *(1 + tick) * 0.05 / 2])
    np.testing.assert_allclose(run.v[:, 0], speeds, rtol=0, atol=1e-12)


def test_a_continuous_motor_takes_the_shorter_way():
    text = robots.robot(
        robots.link("base"),
        robots.link("arm", robots.ROD),
        robots.joint("turn", "base", "arm", kind="continuous"),
    )
    loop = ClosedLoopModel.from_urdf(text, ())
    loop.model.gravity.linear = np.zeros(3)
    start = [np.cos(3.0), np.sin(3.0)]
    wanted = [-3.0]
    kp, kd = (gain * moved_inertia(loop, start) for gain in gains(2))
    run = simulate_robot(
        loop, 2.0, start, controller=JointPD(loop, wanted, kp, kd), samples=41, method="general"
    )
    np.testing.assert_allclose(run.actuated[-1], 2 * np.pi - 3.0, atol=1e-4)
    assert run.actuated.min() > 2.99
    assert np.abs(run.error[-1]).max() < 1e-4


def test_computed_torque_lets_idle_freedoms_move():
    """One motor of two: the other arm swings, the motor follows its reference nonetheless."""
    loop = five_bar(("left_joint",))
    time = np.linspace(0, 0.3, 31)
    wanted = JointReference(time, 1.9 + 0.1 * (10 * time[:, None] / 3) ** 4)
    state = loop.complete([1.9], [0.0], [0.0], robots.five_bar_q(1.9, 1.2))
    controller = JointComputedTorque(loop, wanted, *gains(5))
    run = simulate_robot(loop, 0.3, state.q, controller=controller, samples=301, method="general")
    assert np.abs(run.error).max() < 1e-8
    assert np.ptp(run.q[:, 2]) > 0.05
    work = np.trapezoid(run.power[:, 0], run.time)
    assert run.energy[-1] - run.energy[0] == pytest.approx(work, abs=1e-5)


def test_more_motors_than_motions_share_what_there_is_to_do():
    """A four-bar with motors on crank and rocker: PD with gravity holds it, computed torque moves it."""
    sidecar = Sidecar(robots.FOUR_BAR_SIDECAR.closures, ("crank_joint", "rocker_joint"))
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)
    q = robots.four_bar_q(0.7, *robots.FOUR_BAR)
    inertia = moved_inertia(loop, q)
    kp, kd = (gain * inertia for gain in gains(3))
    held = simulate_robot(
        loop, 0.3, q, controller=JointPD(loop, q[[0, 2]], kp, kd, gravity=True), samples=4, method="general"
    )
    np.testing.assert_allclose(held.q, np.tile(q, (4, 1)), rtol=0, atol=1e-9)
    alone = ClosedLoopModel(loop.model, robots.FOUR_BAR_SIDECAR)
    assert inertia[0] == pytest.approx(moved_inertia(alone, q)[0], rel=1e-9)
    time = np.linspace(0, 0.3, 31)
    crank = 0.7 + 5 * time**4
    both = np.array([robots.four_bar_q(angle, *robots.FOUR_BAR)[[0, 2]] for angle in crank])
    controller = JointComputedTorque(loop, JointReference(time, both), *gains(5))
    run = simulate_robot(loop, 0.3, q, controller=controller, samples=7, method="general")
    assert np.abs(run.error).max() < 1e-7


def test_a_controller_that_fails_leaves_the_run_so_far():
    def failing(seen):
        if seen.time > 0.1:
            raise ValueError("no more")
        return [1.0]

    with pytest.raises(ControllerError, match="no more") as caught:
        simulate_robot(
            slider(), 1.0, controller=failing, control=ControlLoop(rate=100), samples=101, method="general"
        )
    run = caught.value.run
    assert run.stop.kind == "controller"
    assert 0.1 <= run.time[-1] < 0.13


def test_references_that_are_none():
    loop = five_bar()
    for arguments, words in (
        (([], np.zeros((0, 2))), "time: expected at least one sample"),
        (([0, 0], np.zeros((2, 2))), "time: expected"),
        (([0, 1], np.zeros((3, 2))), "values: expected shape"),
        (([0, 1e-300], np.ones((2, 2)) * [[0], [1e29]]), "too large or too near"),
    ):
        with pytest.raises(MotionError, match=words):
            JointReference(*arguments)
    with pytest.raises(InputError, match="kp: expected one number or 2, one an actuated joint, got 3"):
        JointPD(loop, [1.9, 1.2], [1, 2, 3])
    with pytest.raises(InputError, match="kd: expected zero or more"):
        JointPD(loop, [1.9, 1.2], 1.0, -1.0)
    still = reference()
    assert (still.duration, still.size) == (1.0, 2)
    values, speeds, accelerations = still.over(np.array([-1.0, 2.0]))
    np.testing.assert_allclose(values, [[1.9, 1.2], [2.0, 1.05]], rtol=0, atol=1e-12)
    assert not speeds.any()
    assert not accelerations.any()


# --- loads, and what a run leaves behind --------------------------------------------------------------------


def test_wrenches_act_over_time():
    """A force that grows in proportion to time: x = c t³ / 12; and a history with a kink."""
    loop = slider()
    run = simulate_robot(
        loop, 1.0, external={"body": lambda t: [6 * t, 0, 5.0, 0, 0, 0]}, samples=5, method="general"
    )
    np.testing.assert_allclose(run.q[:, 0], 0.5 * run.time**3, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.external["body"][:, 0], 6 * run.time)
    history = p3dof.WrenchHistory([0.0, 0.5, 1.0], np.outer([0.0, 0.0, 6.0], [1, 0, 0, 0, 0, 0]))
    run = simulate_robot(loop, 1.0, external={"body": history}, samples=5, method="general")
    exact = np.where(run.time > 0.5, (run.time - 0.5) ** 3, 0.0)  # 12 (t - 0.5) N on 2 kg
    np.testing.assert_allclose(run.q[:, 0], exact, rtol=0, atol=1e-9)
    with pytest.raises(InputError, match=r"external 'body': wrench at t = \S+ s: expected shape \(6,\)"):
        simulate_robot(loop, 1.0, external={"body": lambda _: [1.0]}, method="general")


def test_a_closed_loop_that_is_pushed_gains_the_work():
    loop = five_bar()
    push = np.array([4.0, 0, -3.0, 0, 0, 0])
    run = simulate_robot(
        loop, 0.2, robots.five_bar_q(1.9, 1.2), external={"left_tip": push}, samples=3, method="general"
    )
    data = loop.model.createData()
    tips = []
    for q in run.q[[0, -1]]:
        pin.framesForwardKinematics(loop.model, data, q)
        tips.append(data.oMf[loop.model.getFrameId("left_tip")].translation.copy())
    assert run.energy[-1] - run.energy[0] == pytest.approx(push[:3] @ (tips[1] - tips[0]), abs=1e-7)


def test_multipliers_and_reactions_are_those_of_inverse_dynamics(tmp_path):
    loop = five_bar()
    push = {"left_tip": np.array([4.0, 0, -3.0, 0, 0, 0])}
    run = simulate_robot(
        loop,
        0.1,
        robots.five_bar_q(1.9, 1.2),
        controller=[1.0, -1.0],
        external=push,
        samples=4,
        method="general",
    )
    found = run.multipliers()
    for i in range(4):
        known = loop.inverse_dynamics(run.q[i], run.v[i], run.a[i], push)
        np.testing.assert_allclose(found[i], known.lambda_, rtol=0, atol=1e-6)
        np.testing.assert_allclose(run.forces[i], known.tau, rtol=0, atol=1e-6)
    reactions = run.reactions()
    assert not reactions.errors
    header = run.save(tmp_path / "run.csv", multipliers=True).read_text().splitlines()[0].split(",")
    assert [name for name in header if "multiplier" in name] == [
        f"multiplier left_tip/right_tip.{i}" for i in range(3)
    ]
    assert "multiplier" not in run.save(tmp_path / "run.csv").read_text()


def test_forces_and_speeds_beyond_the_file_are_told():
    run = simulate_robot(
        slider(effort=2.0, velocity=1.0), 1.0, controller=[3.0], samples=11, method="general"
    )
    force, speed = run.exceedances()
    assert (force.quantity, force.joint, force.value, force.limit) == ("force", "slide", 3.0, 2.0)
    assert str(speed) == "speed of slide: 1.5 m/s at t = 1 s, limit 1 m/s"
    assert not simulate_robot(
        slider(effort=0, velocity=0), 1.0, controller=[3.0], samples=3, method="general"
    ).exceedances()
    for method in ("general", "compiled"):
        at_end, beyond = (
            simulate_robot(slider(upper=0.25), 1.0, controller=[3.0], samples=3, stop_at=kinds, method=method)
            for kinds in (["joint limit"], [])
        )
        assert (at_end.stop.kind, at_end.exceedances()) == ("joint limit", ())
        (left,) = beyond.exceedances()
        assert str(left) == "position of slide: 0.75 m at t = 1 s, limit 0.25 m"


@pytest.mark.parametrize("method", ["general", "compiled"])
@pytest.mark.parametrize(("lower", "upper", "outwards"), [(0.0, 0.5, -1.0), (-0.5, 0.0, 1.0)])
def test_a_run_starts_at_a_limit_and_ends_when_it_moves_outwards(method, lower, upper, outwards):
    loop = slider(lower, upper)
    for force in (0.0, -outwards):
        assert simulate_robot(loop, 1.0, controller=[force], samples=5, method=method).finished
    stop = simulate_robot(loop, 1.0, controller=[outwards], samples=5, method=method).stop
    end = "lower" if outwards < 0 else "upper"
    assert stop.reason == f"the joint 'slide' at its {end} limit, 0"
    assert stop.time < 1e-4  # where t² / 4 is 1e-9 m at most
    for beyond, fits in ((1e-12, True), (1e-8, False)):
        with nullcontext() if fits else pytest.raises(InputError, match="start beyond a limit: joint limit"):
            simulate_robot(loop, 0.1, [outwards * beyond], samples=2, method=method)


def test_a_run_starts_where_an_initial_state_says():
    loop = slider()
    run = simulate_robot(loop, 1.0, InitialState(joints=([0.5], [0.2])), samples=3, method="general")
    np.testing.assert_allclose(run.q[:, 0], [0.5, 0.6, 0.7], rtol=0, atol=1e-12)
    free = pin.Model()
    free.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    free.appendBodyToJoint(1, pin.Inertia.Random(), pin.SE3.Identity())
    ball = ClosedLoopModel(free, Sidecar((), ()))
    run = simulate_robot(
        ball, 0.1, InitialState(joints=(pin.neutral(free), np.ones(3))), samples=3, method="general"
    )
    assert (run.actuated.shape, run.forces.shape) == ((3, 0), (3, 0))
