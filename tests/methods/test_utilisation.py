"""How much of each limit a motion uses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import p3dof
from p3dof._base.errors import InputError
from p3dof.machine.parameters import PAPER, Limits
from p3dof.methods import Utilisation
from p3dof.methods.utilisation import time_of_peak


@pytest.fixture(scope="module")
def result():
    return p3dof.load().inverse_dynamics(p3dof.paper_motion(101), method="virtual-power")


def test_shares_are_of_the_limit_on_the_side_of_the_value(result):
    limits = Limits(travel=(-0.11, 0.04), speed=1.5, force=130.0, tilt=(-0.5, 0.41))
    found = {(one.quantity, one.leg): one for one in result.utilisations(limits)}
    assert len(found) == 10
    columns = {"force": result.forces, "speed": result.slider_velocities, "travel": result.sliders}
    ends = {"force": (-130, 130), "speed": (-1.5, 1.5), "travel": (-0.11, 0.04), "tilt": (-0.5, 0.41)}
    for (quantity, leg), one in found.items():
        values = result.motion.pose[:, 2] if leg == "platform" else columns[quantity][:, "ABC".index(leg)]
        low, high = ends[quantity]
        shares = np.maximum(values / low, values / high)
        assert one.share == pytest.approx(shares.max(), rel=1e-14)
        assert one.value == values[np.argmax(shares)]
        assert one.time == pytest.approx(result.time[np.argmax(shares)], abs=0.51 * result.time[1])
        assert one.limit == (low if one.value < 0 else high)
    assert found["travel", "A"].limit == -0.11
    assert found["tilt", "platform"].limit == 0.41
    assert found["force", "A"].time == 1.0


def test_a_peak_between_samples_has_its_own_time():
    """At 2 ms a sample, within .02 ms of where 4001 have it; at an end and at a gap the sample's."""
    robot, when = p3dof.load(), {}
    for count in (501, 4001):
        motion = p3dof.paper_motion(count)
        result = robot.inverse_dynamics(motion, method="virtual-power")
        when[count] = {(one.quantity, one.leg): one for one in result.utilisations(PAPER.limits)}
    between = 0
    for key, fine in when[4001].items():
        coarse = when[501][key]
        assert coarse.time == pytest.approx(fine.time, abs=2e-5)
        between += abs(coarse.time / 0.002 - round(coarse.time / 0.002)) > 0.05
    assert between >= 2
    time = np.array([0.0, 1.0, 3.0, 4.0])
    parabola = 5 - (time - 1.4) ** 2
    assert time_of_peak(time, parabola, 1) == pytest.approx(1.4, rel=1e-14)
    assert time_of_peak(time, -parabola, 1) == pytest.approx(1.4, rel=1e-14)
    assert time_of_peak(time, parabola, 0) == 0.0
    assert time_of_peak(time, parabola, 3) == 4.0
    assert time_of_peak(time, np.array([1.0, 2.0, np.nan, 0.0]), 1) == 1.0
    assert time_of_peak(time, np.ones(4), 1) == 1.0


def test_what_is_exceeded_is_used_by_more_than_all(result):
    limits = Limits(travel=(-0.1, 0.1), speed=0.9, force=100.0, tilt=(-0.3, 0.3))
    more = {(one.quantity, one.leg) for one in result.utilisations(limits) if one.share > 1}
    assert more == {(one.quantity, one.leg) for one in result.exceedances(limits)}
    assert 4 <= len(more) < 10


def test_a_motion_with_invalid_samples_has_no_largest_force_and_speed(result):
    forces = result.forces.copy()
    forces[40] = np.nan
    found = replace(result, forces=forces).utilisations(PAPER.limits)
    assert [np.isnan(one.value) for one in found] == [True] * 6 + [False] * 4
    assert all(np.isnan(one.share) == np.isnan(one.time) for one in found)
    with pytest.raises(InputError, match="limits: expected Limits, got int"):
        result.utilisations(3)
    assert Utilisation("force", "A", 50.0, 500.0, 0.1).unit == "N"
