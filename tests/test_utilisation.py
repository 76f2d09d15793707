"""How much of each limit a motion uses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import p3dof
from p3dof.errors import InputError
from p3dof.methods import Utilisation
from p3dof.parameters import PAPER, Limits


@pytest.fixture(scope="module")
def result():
    return p3dof.load().inverse_dynamics(p3dof.paper_motion(101), "virtual-power")


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
        assert one.time == result.time[np.argmax(shares)]
        assert one.limit == (low if one.value < 0 else high)
    assert found["travel", "A"].limit == -0.11
    assert found["tilt", "platform"].limit == 0.41
    assert found["force", "A"].time == 1.0


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
