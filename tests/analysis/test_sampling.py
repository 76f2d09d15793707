"""Poses from a file are a curve, nine columns are samples: are there as many as peaks and work need?"""

from __future__ import annotations

import copy
import pickle
import re

import numpy as np
import pytest
from documents import first_block

import p3dof
from p3dof._base.errors import InputError, MotionError
from p3dof.analysis.sampling import MOST, loads_at
from p3dof.cli import main
from p3dof.machine.motion import Curve, Motion, WrenchHistory

SIX = (
    np.array([[-15, 21, -584], [8, -21, 39], [13, -21, -124], [-15, 7, -31], [-17, 26, 193], [21, -19, 122]])
    / 1000
)
"""Six poses, 100 ms apart: actuator A bears 104.6 N at them, and 123.4 N on the curve between them."""

LOAD = WrenchHistory([0.0, 0.5], np.zeros((2, 6)))


def test_the_file_of_a_planned_task_is_fine_enough(tmp_path, robot):
    """The least force of C misses 0.03 N of 71 N: nothing that a drive is sized by."""
    (tmp_path / "task.yaml").write_text(first_block("how-to/plan-a-task.md", "yaml"), encoding="utf-8")
    task = p3dof.read_task(tmp_path / "task.yaml")
    task.plan(duration=2.0).motion.to_csv(tmp_path / "motion.csv")
    motion = Motion.from_csv(tmp_path / "motion.csv")
    assert robot.remarks(motion) == ()
    exact = task.plan(duration=2.0, samples=20_001).motion
    forces = [
        robot.forces(one.pose, one.velocity, one.acceleration, method="compiled") for one in (motion, exact)
    ]
    few, many = (np.array([force.min(axis=0), force.max(axis=0)]) for force in forces)
    assert np.abs(few - many).max() < 1e-3 * np.abs(many).max(axis=0).min()
    coarse = task.plan(duration=2.0, samples=101).motion
    assert any("lowest force of A" in words for words in robot.remarks(coarse))


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def six():
    return Motion.from_poses(np.linspace(0, 0.5, 6), SIX)


@pytest.fixture
def files(tmp_path, six):
    """The six poses, and the six samples of their curve with all derivatives."""
    lines = [
        f"{t!r},{y!r},{z!r},{theta!r}"
        for t, (y, z, theta) in zip(six.time.tolist(), SIX.tolist(), strict=True)
    ]
    (tmp_path / "poses.csv").write_text("\n".join(["t,y,z,theta", *lines, ""]))
    six.to_csv(tmp_path / "samples.csv")
    return tmp_path


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def rows_of(shown):
    """The numbers of a printed table by the first cell of each row."""
    rows = {}
    for line in shown.splitlines():
        cells = [cell.strip() for cell in re.split("[│|┃]", line)][1:-1]
        if len(cells) == 4 and all(re.fullmatch(r"-?[\d.]+", cell) for cell in cells[1:]):
            rows[cells[0]] = [float(cell) for cell in cells[1:]]
    return rows


def near(found, exact, share=1e-3):
    exact = np.asarray(exact)
    floor = 1e-2 * np.abs(exact).max()
    assert np.all(np.abs(found - exact) <= share * np.maximum(np.abs(exact), floor)), (found, exact)


# --- the curve ----------------------------------------------------------------------------------------------


def test_a_curve_is_the_polynomial_through_few_poses(six):
    fit = np.polynomial.Polynomial
    t = np.linspace(0, 0.5, 41)
    pose, velocity, acceleration = six.curve.at(t)
    for k in range(3):
        known = fit.fit(six.time, SIX[:, k], 5)
        np.testing.assert_allclose(pose[:, k], known(t), rtol=0, atol=1e-13)
        np.testing.assert_allclose(velocity[:, k], known.deriv()(t), rtol=0, atol=1e-11)
        np.testing.assert_allclose(acceleration[:, k], known.deriv(2)(t), rtol=0, atol=1e-9)
    assert repr(six.curve) == "Curve(through 6 poses, 0 to 0.5 s)"


def test_a_motion_from_poses_keeps_its_curve(six):
    fine, copied = six.divided(16), pickle.loads(pickle.dumps(six))  # noqa: S301
    for motion in (fine, six.resampled(81), six[1:5], copy.deepcopy(six), copied):
        assert motion.curve is not None
        pose, velocity, acceleration = six.curve.at(motion.time)
        np.testing.assert_allclose(motion.pose, pose, atol=1e-15)
        np.testing.assert_allclose(motion.velocity, velocity, atol=1e-13)
        np.testing.assert_allclose(motion.acceleration, acceleration, atol=1e-11)
    for name in ("time", "pose", "velocity", "acceleration"):  # the poses of the file stay, to the last bit
        np.testing.assert_array_equal(getattr(fine, name)[::16], getattr(six, name))
    assert len(six.from_rest(0.1)) > 1000
    assert p3dof.paper_motion(11).curve is None
    assert p3dof.paper_motion(11).divided(4).curve is None
    np.testing.assert_allclose(
        p3dof.paper_motion(101).divided(4).velocity, p3dof.paper_motion(401).velocity, atol=1e-8
    )


def test_curves_refuse_what_does_not_fit(six):
    with pytest.raises(MotionError, match=r"times: expected times from 0 to 0\.5 s, got 0\.6 s"):
        six.curve.at([0.1, 0.6])
    with pytest.raises(MotionError, match="strictly rising"):
        Curve([0.0, 0.0], np.zeros((2, 3)))
    with pytest.raises(MotionError, match="curve: expected a Curve"):
        Motion(six.time, six.pose, six.velocity, six.acceleration, curve="straight")
    for parts in (0, 1.5, 10_000_000):
        with pytest.raises(MotionError, match="samples: expected"):
            six.divided(parts)


# --- as many samples as it takes ----------------------------------------------------------------------------


def test_a_curve_gets_as_many_samples_as_its_loads_need(robot, six):
    fine, finest = robot.refined(six), six.divided(20 * 64)
    for name, exact in loads_at(robot.kernels, finest, LOAD).items():
        near(loads_at(robot.kernels, fine, LOAD)[name], exact)
    assert 200 <= len(fine) <= 1000
    assert set(six.time) <= set(fine.time)
    assert robot.refined(fine) is not six
    assert len(robot.refined(fine)) == len(fine)  # enough is enough
    result = robot.inverse_dynamics(fine, method="virtual-power")
    assert not [words for words in result.warnings if "undersampled" in words]
    with pytest.raises(InputError, match="motion: expected a Motion"):
        robot.refined("poses.csv")


def test_rows_that_resolve_the_curve_remain_the_samples(robot):
    smooth = p3dof.paper_motion(1001)
    poses = Motion.from_poses(smooth.time, smooth.pose)
    np.testing.assert_array_equal(robot.refined(poses).time, smooth.time)
    many = Motion.from_poses(np.linspace(0, 1, MOST + 2), p3dof.paper_motion(MOST + 2).pose)
    assert robot.refined(many) is many


def test_rough_poses_are_not_refined_without_end_and_told(robot):
    """At 1 kHz, rounded to 10 µm: what is between the rows is noise."""
    smooth = p3dof.paper_motion(1001)
    rough = Motion.from_poses(smooth.time, smooth.pose.round(5))
    fine = robot.refined(rough)
    assert len(fine) <= 4001
    assert any("the motion is undersampled" in words for words in robot.remarks(fine))
    told = [words for words in robot.remarks(fine) if "too noisy" in words]
    assert len(told) == 1
    assert re.search(
        r"splines of degree 7 and 5 differ by [\d.e+]+ \w+/s² in the acceleration of \w+", told[0]
    )
    assert not any(
        "too noisy" in words for words in robot.remarks(Motion.from_poses(smooth.time, smooth.pose))
    )


def test_a_load_that_peaks_between_the_samples_counts(robot, six):
    time = np.array([0.0, 0.2437, 0.24395, 0.2442, 0.5])
    wrench = np.zeros((5, 6))
    wrench[2, 2] = -500.0
    load = WrenchHistory(time, wrench)
    fine = robot.refined(six, wrench=load)
    highest = loads_at(robot.kernels, fine, load)["highest force"]
    exact = loads_at(robot.kernels, six.resampled(np.union1d(six.divided(512).time, time)), load)
    near(highest, exact["highest force"])
    told = robot.inverse_dynamics(six.divided(64), method="virtual-power", wrench=load).warnings
    assert any("undersampled" in words for words in told)


# --- samples that are too few -------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["pinocchio", "virtual-power", "compiled"])
def test_too_few_samples_are_told_of_any_motion(robot, six, method):
    plain = Motion(six.time, six.pose, six.velocity, six.acceleration)
    for motion in (six, plain):
        (told,) = [
            words
            for words in robot.inverse_dynamics(motion, method=method).warnings
            if "undersampled" in words
        ]
        assert "between them" in told
        assert "work and energy differ by" in told
    assert robot.inverse_dynamics(p3dof.paper_motion(1001), method=method).warnings == ()
    (told,) = robot.inverse_dynamics(p3dof.paper_motion(11), method=method).warnings
    assert told.startswith("the motion is undersampled: ")
    assert "1 warnings" in repr(robot.inverse_dynamics(p3dof.paper_motion(11), method=method))


def test_what_is_told_is_so(robot):
    """Of 21 samples of the paper's motion, the warning names numbers that a finer motion has."""
    (told,) = robot.inverse_dynamics(p3dof.paper_motion(21), method="virtual-power").warnings
    exact = loads_at(robot.kernels, p3dof.paper_motion(4001), WrenchHistory([0.0], np.zeros((1, 6))))
    named = re.findall(
        r"([\w ]+) of ([ABC]) is (-?[\d.]+) \S+ between them, (-?[\d.]+)", told.split(": ", 1)[1]
    )
    assert len(named) >= 2
    for name, leg, better, worse in named:
        value = exact[name.strip()]["ABC".index(leg)]
        assert abs(float(better) - value) < 0.1 * abs(float(worse) - value)


@pytest.mark.parametrize("at", [0.0, 0.5])
def test_an_acceleration_that_jumps_is_not_taken_for_coarse(robot, at):
    """A trapezoidal profile sampled every ms, its jumps at samples (half-way up) or between them."""
    time = np.linspace(0, 1, 1001)
    edges = np.array([0.2, 0.4, 0.6, 0.8]) + 1e-3 * at
    levels = np.array([0.5, 0.0, -0.5, 0.0, 0.0])
    a = levels[np.searchsorted(edges, time, side="right")]
    corner = np.concatenate([[0.0], edges, [2.0]])
    speed = np.concatenate([[0.0], np.cumsum(levels * np.diff(corner))])
    way = np.concatenate([[0.0], np.cumsum(speed[:-1] * np.diff(corner) + levels * np.diff(corner) ** 2 / 2)])
    part = np.searchsorted(corner, time, side="right") - 1
    since = time - corner[part]
    v = speed[part] + levels[part] * since
    p = way[part] + speed[part] * since + levels[part] * since**2 / 2
    zero = 0 * time
    motion = Motion(time, *(np.column_stack([zero, x, zero]) for x in (p, v, a)))
    assert robot.inverse_dynamics(motion, method="virtual-power").warnings == ()


def test_rounded_samples_are_not_taken_for_coarse(robot):
    exact = p3dof.paper_motion(1001)
    columns = (x.round(6) for x in (exact.pose, exact.velocity, exact.acceleration))
    assert robot.inverse_dynamics(Motion(exact.time, *columns), method="virtual-power").warnings == ()


# --- the command line ---------------------------------------------------------------------------------------


def test_the_commands_print_the_peaks_of_the_curve(robot, six, files, capsys):
    """Every printed number agrees with a 20 times finer computation; at the six rows, none would."""
    fine = robot.inverse_dynamics(six.divided(20 * 64), method="virtual-power")
    drives = robot.energy(fine).drives
    code, shown, _ = run(capsys, "forces", "--motion", files / "poses.csv", "--method", "virtual-power")
    assert code == 0
    rows = rows_of(shown)
    for leg, name in enumerate("ABC"):
        values = fine.forces[:, leg]
        near(rows[name], [values.min(), values.max(), fine.rms_forces[leg]])
    code, shown, _ = run(capsys, "energy", "--motion", files / "poses.csv", "--method", "virtual-power")
    assert code == 0
    rows = rows_of(shown)
    names = {
        "peak force [N]": "peak_force", "RMS force [N]": "rms_force", "peak speed [m/s]": "peak_speed",
        "peak power [W]": "peak_power", "peak braking power [W]": "peak_braking",
        "work supplied [J]": "positive_work", "work regenerated [J]": "negative_work",
    }  # fmt: skip
    for name, field in names.items():
        near(rows[name], getattr(drives, field))
    assert "undersampled" not in shown
    coarse = robot.inverse_dynamics(six, method="virtual-power")
    assert round(coarse.peak_forces[0], 1) == 104.6
    assert round(fine.peak_forces[0], 1) == 123.4


def test_poses_say_how_they_begin_and_that_they_look_like_waypoints(files, capsys):
    _, shown, _ = run(capsys, "forces", "--motion", files / "poses.csv", "--method", "compiled")
    (starts,) = [line for line in shown.splitlines() if "starts" in line]
    assert re.search(r"starts \(t = 0 s\) with ydot .* m/s, .*ends \(t = 0.5 s\) with .* rad/s", starts)
    (waypoints,) = [line for line in shown.splitlines() if "waypoints" in line]
    assert "6 poses 100 ms apart look like waypoints" in waypoints
    assert waypoints.endswith(
        "(from rest to rest plan p3dof.Motion.through and, from a task file, p3dof plan)"
    )
    _, shown, _ = run(capsys, "forces", "--motion", files / "samples.csv", "--method", "compiled")
    assert "waypoints" not in shown


def test_poses_that_begin_and_end_at_rest_say_nothing(robot):
    smooth = Motion.rest_to_rest([0, 0, 0], [0.05, 0.05, 0.2], 1.0, 201, order=9)
    assert robot.remarks(Motion.from_poses(smooth.time, smooth.pose)) == ()


def test_samples_fix_the_number_for_poses_only(files, capsys):
    out = files / "f.csv"
    arguments = ("--method", "compiled", "--out", out, "--samples", 33)
    code, shown, _ = run(capsys, "forces", "--motion", files / "poses.csv", *arguments)
    assert code == 0
    table = np.genfromtxt(out, delimiter=",", skip_header=1)
    np.testing.assert_array_equal(table[:, 0], np.linspace(0, 0.5, 33))
    assert "undersampled" in shown
    code, _, err = run(capsys, "forces", "--motion", files / "samples.csv", "--samples", 33)
    assert code == 2
    assert "--samples belongs to the paper's motion and to poses alone" in err
    assert "its rows are the samples" in err


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "command", ["forces", "energy", "compare", "reactions", "plots", "simulate", "report", "show"]
)
def test_every_command_tells_that_samples_are_too_few(command, files, capsys):
    out = {"compare": "o", "plots": "o", "simulate": "o", "show": "a.html", "report": "r.html"}.get(
        command, "o.csv"
    )
    more = {
        "compare": ["--no-plot"], "plots": ["--only", "forces", "--format", "svg"],
        "simulate": ["--controller", "pd", "--no-plot"], "report": ["--no-animation"],
    }.get(command, [])  # fmt: skip
    arguments = (command, "--motion", files / "samples.csv", *more, "--out", files / out)
    _, shown, _ = run(capsys, *arguments)
    told = [line for line in shown.splitlines() if "the motion is undersampled" in line]
    assert len(told) == 1
    if command == "report":
        page = (files / out).read_text(encoding="utf-8")
        assert page.count("the motion is undersampled") == 1
        assert page.index("the motion is undersampled") < page.index("<nav")
