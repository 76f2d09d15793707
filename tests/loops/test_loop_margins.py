"""Distances of any robot from its singularities."""

from __future__ import annotations

from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from loop_motions import biped, five_bar, stewart

from p3dof import ClosedLoopModel, InputError

PLANE = (True, False, True, False, False, False)


def wide_five_bar() -> ClosedLoopModel:
    """The five-bar with its motors 0.5 m apart."""
    loop, _ = five_bar()
    model = loop.model.copy()
    model.jointPlacements[model.getJointId("right_joint")].translation = np.array([0.5, 0.0, 0.0])
    return ClosedLoopModel(model, loop.sidecar)


def symmetric(left: float) -> np.ndarray:
    """Its configuration with the tip in the middle, above the elbows."""
    _, near, far = robots.FIVE_BAR
    half = 0.25 - near * np.cos(left)
    rise = np.arccos(half / far)
    return np.array([left, rise - left, np.pi - left, left - rise])


def test_the_margin_of_actuation_of_a_four_bar_is_the_share_of_its_crank():
    lengths = robots.FOUR_BAR
    loop = ClosedLoopModel.from_urdf(robots.four_bar(*lengths), robots.FOUR_BAR_SIDECAR)
    for theta in (0.3, 1.5, 4.0):
        rates, _ = robots.differences(lambda t, theta=theta: robots.four_bar_q(theta + t, *lengths))
        found = loop.singularity_margins(robots.four_bar_q(theta, *lengths))
        assert found.actuation == pytest.approx(1.0 / np.linalg.norm(rates), rel=1e-9)
        direction = found.actuation_direction / found.actuation_direction[0]
        np.testing.assert_allclose(direction, rates, rtol=0, atol=1e-9)
        assert np.isnan(found.output)


def test_distal_links_in_line_leave_the_elbows_free():
    loop, (_, near, far) = wide_five_bar(), robots.FIVE_BAR
    left = np.arccos((0.25 - far) / near)  # there the elbows are 2 far apart
    found = [loop.singularity_margins(symmetric(left - x), "left_tip", PLANE) for x in (1e-2, 1e-5, 1e-6)]
    margins = np.array([float(one.actuation) for one in found])
    assert np.all(np.diff(margins) < 0)
    np.testing.assert_allclose(margins[1] / margins[2], np.sqrt(10), rtol=1e-2)  # as the height of the tip
    at = found[-1]
    assert set(at.moving(at.actuation_direction)) == {"left_elbow", "right_elbow"}
    assert at.output > 0.1
    assert at.closures > 0.1


def test_a_stretched_leg_holds_the_tip_along_itself():
    """Proximal and distal link of the left side in one line: the tip cannot move along it."""
    loop, _ = five_bar()
    ground, near, far = robots.FIVE_BAR
    tips = [np.array([0.3, np.sqrt((near + far) ** 2 * s - 0.3**2)]) for s in (0.99, 0.9999, 1.0)]
    found = []
    for x, z in tips:
        reach = np.hypot(x, z)
        left = np.arctan2(z, x) + np.arccos(min(1.0, (reach**2 + near**2 - far**2) / (2 * reach * near)))
        right = np.arctan2(z, x - ground)
        away = np.hypot(x - ground, z)
        right -= np.arccos((near**2 + away**2 - far**2) / (2 * near * away))
        q = loop.assemble([left, right], guess=np.array([left, 0.0, right, 0.0])).q
        found.append(loop.singularity_margins(q, "left_tip", PLANE))
    margins = np.array([float(one.output) for one in found])
    assert margins[0] > margins[1] > 10 * margins[2]
    assert margins[2] < 1e-6
    along = tips[-1] / np.linalg.norm(tips[-1])
    np.testing.assert_allclose(np.abs(found[-1].output_twist[[0, 2]] @ along), 1.0, rtol=1e-6)
    assert found[-1].output_twist[[1, 3, 4, 5]].tolist() == [0, 0, 0, 0]


def test_a_flat_parallelogram_is_about_to_lose_a_closure():
    loop = ClosedLoopModel.from_urdf(robots.parallelogram(), robots.PARALLELOGRAM_SIDECAR)
    angles = np.pi / 2 - np.array([0.5, 0.1, 0.01, 0.0])
    q = np.array([loop.assemble([x]).q for x in angles[:3]])
    margins = loop.singularity_margins(q).closures
    assert np.all(np.diff(margins) < 0)
    np.testing.assert_allclose(margins[1] / margins[2], 10, rtol=0.05)
    dead = loop.assemble([angles[3]]).q
    assert loop.mobility(dead) == 2
    assert loop.singularity_margins(dead).closures < 1e-9


def sarrus() -> tuple[ClosedLoopModel, np.ndarray]:
    loop = ClosedLoopModel.from_urdf(robots.sarrus(), robots.SARRUS_SIDECAR)
    return loop, loop.assemble([0.2]).q


def test_the_margin_of_closures_is_that_of_their_homogeneous_jacobian():
    loop, q = sarrus()  # six rows: lengths, angles
    found = loop.singularity_margins(q, length=0.3)
    J = loop.closure_jacobian(q) / np.repeat([0.3, 1.0], 3)[:, None]
    _, s, Vt = np.linalg.svd(J)
    assert found.closures == pytest.approx(s[4] / s[0], rel=1e-9)
    np.testing.assert_allclose(np.abs(found.closures_direction), np.abs(Vt[4]), rtol=0, atol=1e-9)
    assert found.moving(np.array([0.0, 1.0, -2.0, 0.15, 0.25, 0.0])) == ("x_head", "x_knee", "y_knee")


@pytest.mark.parametrize(("build", "frame"), [(stewart, "platform"), (sarrus, "plate")])
def test_margins_do_not_depend_on_the_size_of_the_robot(build, frame):
    loop, q = build()
    found = loop.singularity_margins(q, frame)
    for s in (1e-3, 0.5, 50.0):
        model = loop.model.copy()
        for i in range(model.njoints):
            place = model.jointPlacements[i]
            model.jointPlacements[i] = pin.SE3(place.rotation, s * place.translation)
        for mark in model.frames:
            mark.placement = pin.SE3(mark.placement.rotation, s * mark.placement.translation)
        sidecar = replace(
            loop.sidecar,
            reference={
                name: np.asarray(value) * np.where(_lengths(model, name), s, 1.0)
                for name, value in (loop.sidecar.reference or {}).items()
            }
            or None,
        )
        other = ClosedLoopModel(model, sidecar)
        factors = np.concatenate([np.where(_lengths(model, name), s, 1.0) for name in model.names[1:]])
        same = other.singularity_margins(q * factors, frame)
        assert same.length == pytest.approx(s * found.length)
        for name in ("actuation", "closures", "output"):
            assert getattr(same, name) == pytest.approx(getattr(found, name), rel=1e-6)


def _lengths(model: pin.Model, name: str) -> np.ndarray:
    joint = model.joints[model.getJointId(name)]
    kind, size = joint.shortname(), joint.nq
    marked = 3 if "FreeFlyer" in kind else size if kind.startswith("JointModelP") else 0
    return np.arange(size) < marked


def test_a_length_of_ones_own_weighs_the_frame():
    loop, q = stewart()
    by_default, long = (
        loop.singularity_margins(q, "platform"),
        loop.singularity_margins(q, "platform", length=9.0),
    )
    assert long.length == 9.0
    assert long.output != pytest.approx(by_default.output, rel=0.1)
    shift = loop.singularity_margins(q, "platform", PLANE)
    assert shift.output > by_default.output
    np.testing.assert_allclose(np.linalg.norm(shift.output_twist), 1.0)


def test_idle_freedoms_are_left_out_of_the_actuation():
    loop, q = biped()  # the base is idle: the motors see 12 of 18 free motions, all of these fully
    assert loop.singularity_margins(q).actuation == pytest.approx(1.0)
    assert loop.singularity_margins(q).closures == 1.0
    standing, q = biped("left")
    found = standing.singularity_margins(q, "left_sole")
    assert found.output == 0  # it stands


def test_bad_input_is_refused():
    loop, q = five_bar()
    for change, words in (
        ({"frame": "nowhere"}, "nowhere"),
        ({"length": -1.0}, "length"),
        ({"components": [True] * 5}, "components"),
        ({"components": [False] * 6}, "components"),
        ({"components": [[True], [True, False]]}, "components"),
    ):
        with pytest.raises(InputError, match=words):
            loop.singularity_margins(q, **{"frame": "left_tip", **change})
    with pytest.raises(InputError, match="open by"):
        loop.singularity_margins(q + 0.01)
