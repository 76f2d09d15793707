"""`p3dof excite`, `p3dof loop excite`: motions as files and figures, and what they will tell."""

import dataclasses

import numpy as np
import pytest
import yaml
from command_line import run
from gallery import GALLERY
from numpy.testing import assert_allclose

import p3dof
from p3dof.analysis.identification import MachineForces
from p3dof.loops import load_robot, optimise_excitation
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import Limits
from p3dof.report import plots
from p3dof.runs.forces_along import forces_along

SHORT = ("--harmonics", "2", "--motions", "5", "--rate", "100")


def test_the_machines_motion_is_written_drawn_and_judged(capsys, tmp_path):
    out, figure, task = tmp_path / "motion.csv", tmp_path / "motion.svg", tmp_path / "task.csv"
    paper_motion(101).to_csv(task)
    files = ("--task", task, "--out", out, "--figure", figure)
    code, text, err = run(capsys, "excite", *SHORT, *files, "--target-error", "0.5", "--noise", "2")
    assert (code, err) == (0, "")
    machine, motion = MachineForces(), paper_motion(101)
    states = machine.from_coordinates(motion.pose, motion.velocity, motion.acceleration)
    own = optimise_excitation(machine, harmonics=2, motions=5, rate=100.0, task=states, noise=2.0)
    written = Motion.from_csv(out)
    assert_allclose(written.pose, own.sampled().values, rtol=0, atol=1e-12)
    assert p3dof.load().inverse_dynamics(written).exceedances(machine.parameters.limits) == []
    assert f"{own.duration_for(0.5):g} s of measurement" in text
    for error in own.task_error:
        assert f"{error:.6g}" in text
    assert figure.stat().st_size > 1000


@pytest.mark.slow
def test_any_robots_motion_is_written(capsys, tmp_path):
    out = tmp_path / "crank.csv"
    robot = GALLERY / "four_bar.urdf"
    short = ("--harmonics", "1", "--motions", "5", "--rate", "100", "--periods", "1")
    code, text, err = run(capsys, "loop", "excite", robot, *short, "--noise", "0.01", "--out", out)
    assert (code, err) == (0, "")
    assert "crank_joint" in text
    along = forces_along(load_robot(robot), out, samples=50)
    assert np.isfinite(along.forces).all()


def test_the_figure_has_limits_and_every_coordinate():
    machine = MachineForces()
    figure = plots.excitation_figure(optimise_excitation(machine, harmonics=2, motions=10), machine)
    position, velocity, force, limits = figure.axes
    assert [len(axis.get_lines()) for axis in (position, velocity, force)] == [3, 3, 3]
    used = [line.get_ydata() for line in limits.get_lines()]
    assert max(np.max(values) for values in used) == 1.0  # the limit itself: the motion is below it
    assert 0.9 < max(np.max(values) for values in used[:-1]) < 1.0
    assert velocity.get_ylabel() == "velocity [m or rad/s]"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--criterion", "E"), "'E' is not one of 'prediction', 'D', 'condition'"),
        (("--harmonics", "0"), "0 is not in the range 1<=x<=100"),
        (("--duration", "0"), "'--duration': expected a positive number, got 0"),
        (("--noise", "0.1 Nm"), "--noise: expected N, as the actuated joints have, got 0.1 N m"),
        (
            ("--target-error", "1 kg"),
            "'--target-error': expected a force or a moment such as '5 kN', got '1 kg'",
        ),
        (("--rate", "4"), "--rate: expected more than 5 Hz"),
        (("--waypoints", "3"), "3 is not in the range 6<=x<=200"),
        (("--motions", "5", "--target-error", "1e-9"), "--target-error: it takes more than"),
    ],
)
def test_a_bad_option_is_one_line(capsys, options, words):
    code, out, err = run(capsys, "excite", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_no_motion_within_the_limits_is_exit_code_1(capsys, tmp_path):
    weak = tmp_path / "weak.yaml"
    machine = dataclasses.replace(p3dof.load().parameters, limits=Limits(force=5.0))
    weak.write_text(yaml.safe_dump(machine.to_dict()), encoding="utf-8")
    out = tmp_path / "motion.csv"
    code, _, err = run(capsys, "excite", "--parameters", weak, "--out", out)
    assert code == 1, err
    assert "at home, at rest, force of slide_" in err
    assert not out.exists()
