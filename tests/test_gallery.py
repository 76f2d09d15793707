"""The robots of the gallery: what the page says of them, against what is known of such machines."""

from __future__ import annotations

import numpy as np
import pytest
from documents import ROOT, run

import p3dof
from p3dof.closed_loop.overview import overview

FOLDER = ROOT / "docs/_static/gallery"
MOBILITY = {"four_bar": 1, "five_bar": 2, "delta": 3, "stewart": 6, "gripper": 1}


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Names of the page's session."""
    folder = tmp_path_factory.mktemp("gallery")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return run(ROOT / "docs/how-to/gallery.md", folder)


@pytest.mark.parametrize("name", MOBILITY)
def test_robots_close_near_their_reference_and_every_motor_counts(name):
    robot = p3dof.load_robot(FOLDER / f"{name}.urdf")
    assembly = robot.assemble()
    assert assembly.same_assembly
    assert assembly.gap < 1e-12
    seen = overview(robot, assembly.q)
    assert seen.mobility == seen.held == len(robot.actuated) == MOBILITY[name]
    assert seen.idle == ()
    assert (FOLDER / f"{name}.png").stat().st_size > 5000
    assert f"{name}.png" in (ROOT / "docs/how-to/gallery.md").read_text(encoding="utf-8")


def test_the_four_bar_keeps_its_energy_and_a_whole_turn_takes_no_work(page):
    assert page["drift"] < 1e-6
    turn, torque, time = page["turn"], page["torque"], page["time"]
    np.testing.assert_allclose(turn.q[-1] - turn.q[0], [2 * np.pi, -2 * np.pi, 0], rtol=0, atol=1e-9)
    power = torque[:, 0] * np.pi
    work = np.sum((power[1:] + power[:-1]) / 2 * np.diff(time))
    assert abs(work) < 1e-9 * np.abs(power).max()  # of a periodic function: the rule is exact


def test_the_delta_shifts_and_does_not_turn(page):
    np.testing.assert_allclose(page["turning"], 0, atol=1e-12)
    assert page["mobility"] == 3
    assert page["delta"].unique.all()


def test_the_five_bar_has_one_force_that_is_open(page):
    assert page["five_bar"].unique.tolist() == [True, False, True]


def test_the_stewart_platform_bears_its_weight_and_what_pushes_it(page):
    np.testing.assert_allclose(page["back"].a, page["wanted"], rtol=0, atol=1e-9)
    assert page["legs"].residual < 1e-11


def test_the_gripper_squeezes_by_virtual_work(page):
    robot, state = page["robot"], page["state"]
    free = robot.inverse_dynamics(state.q, state.v, state.a)
    lever = 0.09 * np.cos(0.35)  # m a finger moves per rad of the motor
    np.testing.assert_allclose(page["motor"] - free.tau, -2 * 10.0 * lever, rtol=1e-12)
    weightless = page["held"].lambda_[robot.constraint_rows[-1]] - free.lambda_[robot.constraint_rows[-1]]
    np.testing.assert_allclose(np.abs(weightless), 10.0 * lever, rtol=1e-10)
