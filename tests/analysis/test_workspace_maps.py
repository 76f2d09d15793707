"""Means, shares and maps of indices over workspaces."""

from dataclasses import replace

import numpy as np
import pytest
import xarray

import p3dof
from p3dof.analysis.indices import COLUMNS, DEFINITIONS, write_dataset

ROBOT = p3dof.load()
SPACE = ROBOT.workspace()
OTHERS = {
    "turned": (replace(p3dof.PAPER.limits, tilt=(-np.pi / 3, np.pi / 3)), 0.25593, 0.55565, 0.2798),
    "narrow": (replace(p3dof.PAPER.limits, travel=(-0.1, 0.1)), 0.29169, 0.64828, 0.3698),
}


def test_global_indices_are_the_references():
    assert SPACE.mean("lci") == pytest.approx(0.276475, abs=4e-6)
    assert SPACE.mean("lci", "area") == pytest.approx(0.26165, abs=5e-6)
    assert SPACE.mean("lti") == pytest.approx(0.60286, abs=1.5e-5)
    assert SPACE.share("lti", 0.7) == pytest.approx(0.3025, abs=5e-4)


@pytest.mark.parametrize("name", OTHERS)
def test_global_indices_within_other_limits_are_the_references(name):
    limits, lci, lti, share = OTHERS[name]
    space = ROBOT.workspace(limits)
    assert space.mean("lci") == pytest.approx(lci, abs=1.1e-5)
    assert space.mean("lti") == pytest.approx(lti, abs=3e-5)
    assert space.share("lti", 0.7) == pytest.approx(share, abs=5e-4)


def test_means_and_shares_are_those_of_random_poses():
    limits = p3dof.PAPER.limits
    pose = np.random.default_rng(9).uniform([-0.25, -0.2, -0.7854], [0.25, 0.4, 0.7854], (40_000, 3))
    inside = pose[SPACE.margin(pose).inside]
    found = ROBOT.indices(inside, limits=limits)
    count = np.sqrt(len(inside))
    for name in ("lti", "frequency_1", "actuator_inertia_3"):
        values = found.column(name)
        assert abs(SPACE.mean(name) - values.mean()) < 4.5 * values.std() / count, name
        level = float(np.quantile(values, 0.4))
        share = (values >= level).mean()
        assert abs(SPACE.share(name, level) - share) < 4.5 * np.sqrt(share * (1 - share)) / count, name


def test_the_acceleration_ball_of_the_map_is_the_reference():
    ball = SPACE.map("acceleration_ball", y=np.linspace(-0.24, 0.24, 121)).acceleration_ball
    assert float(ball.min()) == pytest.approx(21.136, abs=6e-4)
    place = ball.where(ball == ball.min(), drop=True)
    assert abs(float(place.y[0])) == pytest.approx(0.24)
    assert float(place.theta[0]) == pytest.approx(np.pi / 4)
    assert 50.199 <= float(ball.max()) < 50.25  # a peak that grids come near


def test_a_map_has_its_indices_with_units_definitions_and_limits(tmp_path):
    found = SPACE.map("lti", "frequency", count=40)
    assert set(found.data_vars) == {"lti", "frequency_1", "frequency_2", "frequency_3", "height"}
    assert found.frequency_2.attrs["units"] == "Hz"
    assert "local transmission index" in found.lti.attrs["long_name"]
    assert "Wang" in found.lti.attrs["source"]
    assert found.attrs["characteristic_length"] == 0.1
    assert list(found.attrs["travel"]) == [-0.2, 0.2]
    i, k = 11, 25
    pose = [float(found.y[i]), 0.0, float(found.theta[k])]
    assert float(found.lti[i, k]) == float(ROBOT.indices(pose).lti)
    assert float(found.height[i, k]) == float(SPACE.height(pose[0], pose[2]))
    assert "ℓ = 0.3 m" in SPACE.map("lci", count=3, length=0.3).lci.attrs["long_name"]
    path = write_dataset(found, tmp_path / "map.nc")
    with xarray.open_dataset(path) as again:
        xarray.testing.assert_identical(again.load(), found)
    with pytest.raises(p3dof.InputError, match=r"ends in \.nc"):
        write_dataset(found, tmp_path / "map.csv")


def test_indices_over_a_workspace_are_within_its_limits():
    weak = replace(p3dof.PAPER.limits, force=250.0, speed=1.0)
    space = ROBOT.workspace(weak)
    found = space.map("acceleration_ball", "lone_velocity", y=[0.0, 0.1], theta=[0.0, 0.2])
    known = ROBOT.indices([0.1, 0, 0.2], limits=weak)
    assert float(found.acceleration_ball[1, 1]) == float(known.acceleration_ball)
    assert float(found.lone_velocity_z[1, 1]) == 1.0
    assert found.attrs["force_limit"] == 250.0
    assert space.mean("lone_velocity_z") == pytest.approx(1.0)
    assert space.share("acceleration_ball", 17.0) < 0.5 < SPACE.share("acceleration_ball", 17.0)


def test_outside_the_workspace_a_map_has_nothing():
    narrow = ROBOT.workspace(replace(p3dof.PAPER.limits, travel=(-0.02, 0.02)))
    found = narrow.map("lti", "lone_force", y=[0.0, 0.2], theta=[0.0, 0.7])
    assert np.isnan(found.lti.values).tolist() == [[False, True], [True, True]]
    assert (np.isnan(found.lone_force_least_y.values) == np.isnan(found.height.values)).all()


def test_a_map_of_all_indices_has_every_column():
    found = SPACE.map(count=12)
    assert set(found.data_vars) == {*COLUMNS, "height"}
    assert all(found[name].attrs["units"] for name in COLUMNS)


def test_indices_at_poses_become_a_dataset():
    poses = np.array([[0, 0, 0], [0.1, 0, 0.2]])
    found = ROBOT.indices(poses).to_dataset("iti", "gie")
    assert found.iti_b.dims == ("pose",)
    np.testing.assert_array_equal(found.theta, poses[:, 2])
    assert set(found.data_vars) == {"iti_a", "iti_b", "iti_c", "gie"}


def test_what_is_no_map_is_refused():
    with pytest.raises(p3dof.InputError, match=f"index: expected one of {', '.join(DEFINITIONS)}; got 'lit'"):
        SPACE.map("lit")
    with pytest.raises(p3dof.InputError, match="count: expected a whole number from 2 to 5000, got 1"):
        SPACE.map("lti", count=1)
    with pytest.raises(p3dof.InputError, match="measure: expected 'volume' or 'area', got 'pose'"):
        SPACE.mean("lti", "pose")
    with pytest.raises(p3dof.InputError, match="index: expected one of"):
        SPACE.share("lit", 0.7)
