"""What stands between a controller and what it moves: counts, differences, delay, lag of the drives."""

import csv

import numpy as np
import pytest

import p3dof
from p3dof import PAPER
from p3dof._base.errors import InputError
from p3dof.cli import main
from p3dof.runs import KINDS, ControlLoop, InitialState, Integration, Noise, simulate_robot

ROBOT = p3dof.Manipulator(PAPER)
PERIOD = 1e-2


def holding():
    return ROBOT.gravity_forces(np.zeros(3))


class Notes:
    """Holds the machine, pushes as a function of time, and notes what it sees."""

    def __init__(self, push=lambda _: 0.0):
        self.seen, self.push, self.held = [], push, holding()

    def __call__(self, measured):
        self.seen.append((measured.time, measured.sliders, measured.slider_velocities))
        return self.held + self.push(measured.time)


def moving(control, controller, duration=0.1, **settings):
    start = InitialState((0.01, 0, 0.02), (0.1, 0.05, -0.1))
    return ROBOT.simulate(duration, start=start, controller=controller, control=control, **settings)


@pytest.mark.parametrize("resolution", [1e-4, [1e-4, 0, 3e-3]])
def test_positions_are_rounded_to_counts(resolution):
    exact, counted = Notes(), Notes()
    moving(ControlLoop(100), exact)
    moving(ControlLoop(100, resolution=resolution), counted)
    for (_, here, speed), (_, seen, told) in zip(exact.seen, counted.seen, strict=True):
        assert np.array_equal(told, speed)
        for value, found, count in zip(here, seen, np.broadcast_to(resolution, 3), strict=True):
            if count == 0:
                assert found == value
            else:
                assert abs(found - value) <= count / 2 * (1 + 1e-12)
                assert found / count == pytest.approx(round(found / count), abs=1e-9)


def test_velocities_by_differencing_are_those_of_what_the_encoders_tell():
    noisy = ControlLoop(100, noise=Noise(1e-5, 1.0, 3), resolution=1e-4, differencing=True)
    notes, exact = Notes(), Notes()
    moving(noisy, notes)
    moving(ControlLoop(100), exact)
    assert np.array_equal(notes.seen[0][2], exact.seen[0][2])  # nothing to take a difference from
    for (_, before, _), (_, now, speed) in zip(notes.seen[:-1], notes.seen[1:], strict=True):
        assert np.array_equal(speed, (now - before) / PERIOD)


@pytest.mark.parametrize("periods", [0.25, 1.0, 2.0, 2.5])
def test_forces_act_as_late_as_they_are_said_to(periods):
    late = periods * PERIOD
    run = moving(
        ControlLoop(100, delay=late), Notes(lambda time: 10 * time), samples=np.linspace(0, 0.1, 401)
    )
    middle = np.abs((run.time - late) / PERIOD % 1 - 0.5) < 0.49  # not at the changes themselves
    tick = np.maximum(np.floor((run.time - late) / PERIOD), 0) * PERIOD
    assert np.allclose((run.forces - holding())[middle], 10 * tick[middle, None], atol=1e-12, rtol=0)
    changes = np.flatnonzero(np.diff(run.forces[:, 0]))
    assert np.allclose(np.diff(run.time[changes + 1]), PERIOD, atol=1e-9)


def test_a_delay_of_whole_periods_is_that_of_a_controller_that_keeps_its_forces():
    class Keeps:
        def __init__(self):
            self.kept, self.held = [], holding()

        def __call__(self, measured):
            self.kept.append(self.held - 500 * (measured.sliders - 0.1) - 30 * measured.slider_velocities)
            return self.kept[max(0, len(self.kept) - 3)]

    class Acts(Keeps):
        def __call__(self, measured):
            super().__call__(measured)
            return self.kept[-1]

    kept = moving(ControlLoop(100), Keeps())
    late = moving(ControlLoop(100, delay=2 * PERIOD), Acts())
    assert np.array_equal(kept.pose, late.pose)
    assert np.array_equal(kept.forces, late.forces)


def test_drives_follow_a_ramp_behind_their_time_constant():
    lag, slope = 1 / (2 * np.pi * 20), 50.0
    run = moving(ControlLoop(bandwidth=[20, np.inf, 20]), lambda m: holding() + slope * m.time)
    behind = slope * (run.time - lag * (1 - np.exp(-run.time / lag)))
    expected = holding() + np.column_stack([behind, slope * run.time, behind])
    assert np.allclose(run.forces, expected, atol=1e-9, rtol=0)
    assert np.allclose(run.asked, holding() + slope * run.time[:, None], atol=1e-12, rtol=0)


@pytest.mark.parametrize("method", ["virtual-power", "compiled", "pinocchio"])
def test_drives_approach_held_forces_exponentially(method):
    control = ControlLoop(100, bandwidth=30, saturation=8.0)
    run = moving(control, Notes(lambda time: 100 * time), samples=101, method=method)
    force = run.forces[0]
    for i in range(100):
        command = np.clip(holding() + 100 * (i // 10) * PERIOD, -8, 8)
        force = command + (force - command) * np.exp(-2 * np.pi * 30 * 1e-3)
        assert np.allclose(run.forces[i + 1], force, atol=1e-9, rtol=0)


@pytest.mark.parametrize("method", ["compiled", "pinocchio"])
def test_rk4_gains_four_orders(method):
    start = InitialState((0.01, 0.0, 0.02), (0.3, -0.2, 0.5))

    def end(integration):
        force = holding() * [1.1, 0.9, 1.0]
        run = ROBOT.simulate(
            0.16, start=start, controller=force, integration=integration, method=method, samples=2
        )
        return run.pose[-1]

    exact = end(Integration(rtol=1e-12, atol=1e-15))
    errors = [np.abs(end(Integration(scheme="rk4", step=0.04 / n)) - exact).max() for n in (4, 8)]
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 11) & (ratios < 24)), errors


@pytest.mark.parametrize(
    ("push", "kinds", "allowed"),
    [
        ([0, 0, 1], KINDS, 1e-9),  # a slider's stop
        ([0, 0, 60], KINDS, 1e-9),  # the tilt
        ([-80, 0, 0], (), 1e-3),  # the reach, near which equal steps lose their accuracy
    ],
)
def test_rk4_ends_at_the_same_limit_at_the_same_time(push, kinds, allowed):
    exact, found = (
        ROBOT.simulate(
            1.0,
            start=[0.01, 0, 0.02],
            controller=push,
            method="compiled",
            integration=integration,
            stop_at=kinds,
        ).stop
        for integration in (Integration(), Integration(scheme="rk4", step=1e-3))
    )
    assert (found.kind, found.reason) == (exact.kind, exact.reason)
    assert found.time == pytest.approx(exact.time, abs=allowed)


def test_any_robot_has_the_same_parts():
    loop = ROBOT.loop
    start = loop.assemble().q

    def run(**control):
        seen = []

        def controller(measured):
            seen.append(np.array(measured.positions))
            return holding() + 20 * measured.time

        found = simulate_robot(
            loop,
            0.05,
            start,
            controller=controller,
            control=ControlLoop(100, **control),
            samples=26,
            method="general",
        )
        return found, seen

    plain, exact = run()
    late, _ = run(delay=1.5 * PERIOD)
    assert np.allclose(late.forces[19:23], plain.forces[0] + 20 * 2 * PERIOD)
    lagging, _ = run(bandwidth=30)
    assert lagging.forces[5:10] == pytest.approx(
        holding() + 0.2 * (1 - np.exp(-2 * np.pi * 30 * 2e-3 * np.arange(5)))[:, None], abs=1e-8
    )
    assert lagging.stop is None
    assert len(lagging.v[0]) == loop.model.nv
    _, counted = run(resolution=1e-3)
    assert np.abs(counted[-1] - exact[-1]).max() <= 0.5e-3
    assert np.abs(np.array(counted) / 1e-3 % 1).max() < 1e-9 or np.allclose(
        np.array(counted) / 1e-3, np.rint(np.array(counted) / 1e-3)
    )
    equal = simulate_robot(
        loop, 0.05, start, samples=6, integration=Integration(scheme="rk4"), method="general"
    )
    exact_run = simulate_robot(loop, 0.05, start, samples=6, method="general")
    assert np.allclose(equal.q, exact_run.q, atol=1e-8)
    assert equal.evaluations == 50 * 4 + 1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"resolution": 1e-3}, "resolution: needs a control rate"),
        ({"differencing": True}, "differencing: needs a control rate"),
        ({"delay": 1e-3}, "delay: needs a control rate"),
        ({"rate": 100, "resolution": -1e-3}, "resolution: expected zero or more"),
        ({"rate": 100, "resolution": np.nan}, "resolution: expected a number"),
        ({"rate": 100, "resolution": np.inf}, "resolution: expected a number"),
        ({"rate": 100, "resolution": [[1e-3]]}, "resolution: expected a number"),
        ({"rate": 100, "resolution": []}, "resolution: expected a number"),
        ({"rate": 100, "delay": -1}, "delay: expected zero or more"),
        ({"rate": 100, "delay": "late"}, "delay: expected real numbers"),
        ({"rate": 100, "differencing": 1}, "differencing: expected True or False"),
        ({"bandwidth": 0}, "bandwidth: expected positive"),
        ({"bandwidth": [1, -1, 1]}, "bandwidth: expected positive"),
        ({"bandwidth": np.nan}, "bandwidth: expected a number"),
    ],
)
def test_bad_control_is_one_clear_error(given, message):
    with pytest.raises(InputError, match=message):
        ControlLoop(**given)


def test_numbers_of_actuators_must_fit():
    for given, message in (
        ({"rate": 100, "resolution": [1e-3, 1e-3]}, "resolution: expected one number or 3, got 2"),
        ({"bandwidth": [10, 10]}, "bandwidth: expected one number or 3, got 2"),
    ):
        with pytest.raises(InputError, match=message):
            ROBOT.simulate(0.1, controller=holding(), control=ControlLoop(**given), method="pinocchio")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"scheme": "euler"}, "scheme: expected 'dop853' or 'rk4', got 'euler'"),
        ({"scheme": 4}, "scheme: expected"),
        ({"scheme": "rk4", "step": 0}, "step"),
    ],
)
def test_a_bad_scheme_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        Integration(**given)


def test_a_quick_drive_counts_in_the_estimate():
    with pytest.raises(InputError, match="would take about"):
        ROBOT.simulate(10.0, controller=holding(), control=ControlLoop(bandwidth=1e9), method="pinocchio")


def test_the_command_line_has_them(tmp_path, capsys):
    def forces(name, *more):
        out = tmp_path / name
        arguments = ["simulate", "--controller", "pd", "--rate", "500", "--no-plot", "--out", str(out)]
        assert main([*arguments, "--method", "compiled", *more]) == 0
        rows = list(csv.DictReader((out / "simulation_pd.csv").read_text("utf-8").splitlines()))
        return np.array([float(row["fA [N]"]) for row in rows])

    plain = forces("plain")
    for name, *more in (
        ("counted", "--resolution", "1e-4"),
        ("differences", "--differencing"),
        ("late", "--delay", "0.0011"),
        ("slow", "--bandwidth", "80"),
    ):
        assert np.abs(forces(name, *more) - plain).max() > 1e-4, name
    assert main(["simulate", "--delay", "-1"]) == 2
    assert "delay" in capsys.readouterr().err
