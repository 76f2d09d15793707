"""Geometry, bodies and their numbers: the paper's, those of the solids, and parameter files."""

import copy
import dataclasses
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import dblquad, tplquad

from p3dof._base import files
from p3dof._base.errors import FileError, InputError, P3dofError, ParameterError
from p3dof.machine.parameters import (
    PAPER,
    SOLIDS,
    STEEL_DENSITY,
    Bodies,
    Body,
    Dimensions,
    Geometry,
    Limits,
    Parameters,
    box,
    cylinder,
    of_solids,
    read_parameters,
    rounded_plate,
    write_parameters,
)
from p3dof.machine.parameters.machine import dump, parse

REPEATABLE = settings(derandomize=True, deadline=None, max_examples=60)
LINKS = [
    "slider_a",
    "leg_a",
    "slider_b",
    "leg_b",
    "slider_c",
    "crossbar_upper",
    "rod_left",
    "crossbar_lower",
    "platform",
    "rod_right",
]
LEGS = ("leg_a", "leg_b", "rod_left", "rod_right")
SLIDERS = ("slider_a", "slider_b", "slider_c")
CROSSBARS = ("crossbar_upper", "crossbar_lower")
CORNERS = np.array([[0.0, -0.1], [0.0, 0.1], [-0.1, 0.0]])


def some_body(mass: float = 2.0) -> Body:
    return Body(mass, [0.1, 0.0, -0.2], [0.02, 0.03, 0.04])


def assert_same_body(one: Body, other: Body) -> None:
    assert one.mass == other.mass
    np.testing.assert_array_equal(one.com, other.com)
    np.testing.assert_array_equal(one.inertia, other.inertia)


def assert_same_parameters(one: Parameters, other: Parameters) -> None:
    assert one.geometry == other.geometry
    assert one.limits == other.limits
    np.testing.assert_array_equal(one.gravity, other.gravity)
    for (name, mine), (also, theirs) in zip(one.bodies.items(), other.bodies.items(), strict=True):
        assert name == also
        assert_same_body(mine, theirs)


# ---------------------------------------------------------------- the paper's numbers


def test_paper_geometry_and_gravity():
    assert (PAPER.geometry.r, PAPER.geometry.R, PAPER.geometry.L) == (0.1, 0.25, 0.4)
    assert PAPER.geometry.h == pytest.approx(math.sqrt(0.4**2 - 0.15**2), rel=1e-15)
    assert PAPER.gravity.tolist() == [0.0, 0.0, -9.806]


def test_paper_masses_are_the_printed_ones():
    masses = {name: body.mass for name, body in PAPER.bodies.items()}
    assert list(masses) == LINKS
    assert {masses[name] for name in SLIDERS} == {0.9751}
    assert {masses[name] for name in LEGS} == {0.9803}
    assert masses["platform"] == 8.1573
    assert {masses[name] for name in CROSSBARS} == {0.0}
    assert PAPER.bodies.mass == pytest.approx(3 * 0.9751 + 4 * 0.9803 + 8.1573)


@pytest.mark.parametrize("name", LEGS)
def test_paper_leg_inertia_is_the_printed_one_about_the_upper_joint(name):
    leg = getattr(PAPER.bodies, name)
    np.testing.assert_allclose(leg.com, [0.2, 0, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        leg.inertia_about(np.zeros(3)), np.diag([0.0006, 0.0524, 0.0524]), rtol=0, atol=1e-16
    )


def test_paper_platform_inertia_is_the_printed_one_about_c5_in_the_axes_of_t5():
    x0, y0, z0 = np.eye(3)
    axes = np.column_stack([x0, -z0, y0])  # of T5, in the platform frame
    printed = np.diag([0.0269, 0.0658, 0.0501])
    got = PAPER.bodies.platform.inertia_about([-PAPER.geometry.r, 0, 0])
    np.testing.assert_allclose(axes.T @ got @ axes, printed, rtol=0, atol=1e-16)


def test_paper_platform_mass_centre():
    com = PAPER.bodies.platform.com
    assert com[0] == pytest.approx(-0.030965, abs=5e-7)  # from P toward C5
    assert com[1:] == pytest.approx([0, 0], abs=1e-15)
    assert 0.1 + com[0] == pytest.approx(0.069035, abs=5e-7)


def test_solids_round_to_the_printed_masses():
    for names, printed in ((SLIDERS, 0.9751), (LEGS, 0.9803), (("platform",), 8.1573)):
        for name in names:
            assert round(getattr(SOLIDS.bodies, name).mass, 4) == printed
    for name in CROSSBARS:
        assert getattr(SOLIDS.bodies, name).mass == pytest.approx(0.245, abs=5e-4)


def test_solids_platform_about_c5_is_the_printed_inertia_but_for_one_entry():
    about_c5 = SOLIDS.bodies.platform.inertia_about([-0.1, 0, 0])
    assert np.round(np.diag(about_c5), 4).tolist() == [0.0269, 0.0501, 0.0736]  # printed: .0269, .0501, .0658
    np.testing.assert_allclose(about_c5, np.diag(np.diag(about_c5)), rtol=0, atol=1e-16)


def test_solids_legs_are_near_the_printed_inertia():
    about_joint = SOLIDS.bodies.leg_a.inertia_about(np.zeros(3))
    assert np.round(np.diag(about_joint), 5).tolist() == pytest.approx([0.00005, 0.05231, 0.05231], abs=2e-5)


def test_solids_follow_the_geometry():
    twice = of_solids(Geometry(r=0.2, R=0.5, L=0.8, b=0.1))
    for (_, big), (_, small) in zip(twice.bodies.items(), SOLIDS.bodies.items(), strict=True):
        assert big.mass == pytest.approx(8 * small.mass)
        np.testing.assert_allclose(big.com, 2 * small.com, rtol=0, atol=1e-15)
        np.testing.assert_allclose(big.inertia, 32 * small.inertia, rtol=0, atol=1e-15)
    heavy = of_solids(density=2 * STEEL_DENSITY, limits=Limits(speed=1.0))
    assert heavy.bodies.mass == pytest.approx(2 * SOLIDS.bodies.mass)
    assert heavy.limits.speed == 1.0
    thick = of_solids(dimensions=Dimensions(plate_thickness=0.1))
    assert thick.bodies.platform.mass == pytest.approx(2 * SOLIDS.bodies.platform.mass)


# ---------------------------------------------------------------- solids against integrals


def moments(polygon: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Area, centroid and ∫ d dᵀ dA about the origin of a polygon, by Green's theorem (shoelace)."""
    x, y = polygon.T
    u, v = np.roll(polygon, -1, axis=0).T
    cross = x * v - u * y
    area = cross.sum() / 2
    centroid = np.array([((x + u) * cross).sum(), ((y + v) * cross).sum()]) / (6 * area)
    xx = ((x * x + x * u + u * u) * cross).sum() / 12
    yy = ((y * y + y * v + v * v) * cross).sum() / 12
    xy = ((x * v + 2 * x * y + 2 * u * v + u * y) * cross).sum() / 24
    return area, centroid, np.array([[xx, xy], [xy, yy]])


def widened(corners: np.ndarray, radius: float, arc: int = 20_000) -> np.ndarray:
    """Return the outline of a counter-clockwise polygon widened by a radius, as many straight pieces."""
    outline = []
    edges = np.roll(corners, -1, axis=0) - corners
    angles = np.arctan2(edges[:, 1], edges[:, 0]) - np.pi / 2  # of the outward normals
    for corner, begin, end in zip(corners, np.roll(angles, 1), angles, strict=True):
        turn = np.linspace(begin, begin + (end - begin) % (2 * np.pi), arc)
        outline.append(corner + radius * np.column_stack([np.cos(turn), np.sin(turn)]))
    return np.vstack(outline)


TRIANGLES = {
    "paper": (CORNERS, 0.02, 0.05),
    "scalene": (np.array([[0.3, -0.1], [0.5, 0.4], [-0.2, 0.1]]), 0.07, 0.01),
    "sharp": (np.array([[0.0, 0.0], [1.0, 0.0], [0.9, 0.05]]), 0.3, 0.2),
    "far": (np.array([[10.0, 5.0], [10.2, 5.0], [10.0, 5.2]]), 0.01, 0.05),
}


@pytest.mark.parametrize(("corners", "radius", "thickness"), TRIANGLES.values(), ids=TRIANGLES)
def test_the_rounded_plate_against_its_outline(corners, radius, thickness):
    area, centroid, second = moments(widened(corners, radius))
    second = second - area * np.outer(centroid, centroid)
    mass = 1000 * thickness * area
    plate = rounded_plate(corners, radius, thickness, density=1000)
    assert plate.mass == pytest.approx(mass, rel=1e-8)
    np.testing.assert_allclose(plate.com, [*centroid, 0], rtol=0, atol=1e-9)
    xx, yy, xy = 1000 * thickness * np.array([second[0, 0], second[1, 1], second[0, 1]])
    across = mass * thickness**2 / 12
    expected = [[yy + across, -xy, 0], [-xy, xx + across, 0], [0, 0, xx + yy]]
    np.testing.assert_allclose(plate.inertia, expected, rtol=1e-7, atol=1e-8 * (xx + yy))


def test_the_papers_plate_against_a_grid():
    """Coarser, but without any geometry: a point belongs to the plate if it is near the triangle."""
    step = 2e-4
    axis = np.arange(-0.13, 0.13, step) + step / 2
    x, y = np.meshgrid(axis, axis, indexing="ij")
    points = np.stack([x, y], axis=-1)
    distance = np.full(x.shape, np.inf)
    inside = np.ones(x.shape, dtype=bool)
    for start, end in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        edge = end - start
        along = np.clip((points - start) @ edge / (edge @ edge), 0, 1)
        distance = np.minimum(distance, np.linalg.norm(points - start - along[..., None] * edge, axis=-1))
        inside &= edge[0] * (y - start[1]) - edge[1] * (x - start[0]) >= 0
    plate = inside | (distance <= 0.02)
    mass = STEEL_DENSITY * 0.05 * step**2 * plate.sum()
    com = x[plate].mean()
    body = rounded_plate(CORNERS, 0.02, 0.05)
    assert body.mass == pytest.approx(mass, rel=1e-3)
    assert body.mass == pytest.approx(8.15731, abs=5e-6)
    assert body.com[0] == pytest.approx(com, abs=2e-5)
    assert body.com[0] == pytest.approx(-0.030965, abs=5e-7)
    xx, yy = np.var(x[plate]), np.var(y[plate])
    expected = mass * np.array([yy + 0.05**2 / 12, xx + 0.05**2 / 12, xx + yy])
    np.testing.assert_allclose(np.diag(body.inertia), expected, rtol=2e-3)


def integral(power: tuple[int, int, int], low: list, high: list) -> float:
    """∫ x^i y^j z^k over a solid, whose limits in x may depend on y, z and those in y on z."""
    i, j, k = power
    value, _ = tplquad(lambda x, y, z: x**i * y**j * z**k, low[0], high[0], low[1], high[1], low[2], high[2])
    return value


def test_a_box_against_its_integrals():
    a, b, c = size = (0.2, 0.3, 0.5)
    body = box(size, density=10.0)
    low, high = [-c / 2, -b / 2, -a / 2], [c / 2, b / 2, a / 2]  # z, y, x
    xx, yy, zz = (10 * integral(power, low, high) for power in ((2, 0, 0), (0, 2, 0), (0, 0, 2)))
    assert body.mass == pytest.approx(10 * a * b * c)
    assert not body.com.any()
    np.testing.assert_allclose(body.inertia, np.diag([yy + zz, xx + zz, xx + yy]), rtol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("start", [0.0, -0.25, 0.4])
def test_a_cylinder_against_its_integrals(axis, start):
    radius, length = 0.1, 0.5
    body = cylinder(radius, length, axis=axis, start=start, density=10.0)
    across, _ = dblquad(lambda r, _: r**3, 0, 2 * np.pi, 0, radius)  # ∫ d² dA over the circle
    area = np.pi * radius**2
    middle = start + length / 2
    spread = np.full(3, 10 * length * across / 2)  # ∫ d_i² dm about the mass centre
    spread[axis] = 10 * area * ((start + length - middle) ** 3 - (start - middle) ** 3) / 3
    assert body.mass == pytest.approx(10 * area * length)
    np.testing.assert_allclose(body.com, middle * np.eye(3)[axis], rtol=0, atol=1e-16)
    np.testing.assert_allclose(body.inertia, np.diag(spread.sum() - spread), rtol=1e-9)


@pytest.mark.parametrize("field", ["slider_edge", "rod_radius", "plate_thickness", "corner_radius"])
@pytest.mark.parametrize("value", [0, -1e-3, math.nan, math.inf, "0.1", None])
def test_dimensions_refuse(field, value):
    with pytest.raises(ParameterError, match=f"^{field}: expected"):
        Dimensions(**{field: value})


def test_dimensions_scale_with_the_smallest_ratio():
    assert Dimensions.scaled(Geometry()) == Dimensions()
    assert Dimensions.scaled(Geometry(L=4.0)) == Dimensions()
    assert Dimensions.scaled(Geometry(b=0.025)).rod_radius == pytest.approx(0.005)


# ---------------------------------------------------------------- Body

BAD_BODIES = {
    "negative_mass": ({"mass": -1.0}, "mass: expected zero or more, got -1 kg"),
    "mass_nan": ({"mass": math.nan}, "mass: expected a finite"),
    "mass_inf": ({"mass": math.inf}, "mass: expected a finite"),
    "mass_text": ({"mass": "2"}, "mass: expected real numbers"),
    "mass_none": ({"mass": None}, "mass: expected real numbers"),
    "mass_bool": ({"mass": True}, "mass: expected real numbers"),
    "mass_array": ({"mass": [1.0]}, r"mass: expected a single number"),
    "com_short": ({"com": [0, 0]}, r"com: expected shape \(3,\), got \(2,\)"),
    "com_nan": ({"com": [0, math.nan, 0]}, r"com: expected finite numbers, got nan at index \[1\]"),
    "com_text": ({"com": "abc"}, "com: expected real numbers"),
    "inertia_scalar": ({"inertia": 1.0}, r"inertia: expected three numbers, .* got shape \(\)"),
    "inertia_shape": ({"inertia": np.eye(2)}, r"inertia: expected three numbers, .* got shape \(2, 2\)"),
    "inertia_text": ({"inertia": ["a", "b", "c"]}, "inertia: expected real numbers"),
    "inertia_none": ({"inertia": None}, "inertia: expected real numbers"),
    "inertia_nan": ({"inertia": [1, 1, math.nan]}, "inertia: expected finite"),
    "asymmetric": ({"inertia": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]}, "inertia: expected a symmetric matrix"),
    "negative_moment": (
        {"inertia": [-1, 1, 1]},
        "inertia: expected principal moments of zero or more, got -1",
    ),
    "hidden_negative_moment": (
        {"inertia": [[1, 2, 0], [2, 1, 0], [0, 0, 1]]},
        "inertia: expected principal moments of zero or more, got -1",
    ),
    "triangle": ({"inertia": [1, 1, 2.01]}, r"at most the sum of the other two, got 2\.01 > 1 \+ 1"),
    "inertia_without_mass": ({"mass": 0.0, "inertia": [1, 1, 1]}, "expected zeros for a body without mass"),
}


@pytest.mark.parametrize(("change", "message"), BAD_BODIES.values(), ids=BAD_BODIES)
def test_a_body_refuses(change, message):
    with pytest.raises(ParameterError, match=message):
        Body(**({"mass": 2.0, "com": [0, 0, 0], "inertia": [1, 1, 1]} | change))


@pytest.mark.parametrize("inertia", [[1, 1, 2], [0, 0, 0], [0, 1, 1], [1, 1, 2 + 1e-12]])
def test_bodies_at_the_border_of_the_physical_are_allowed(inertia):
    assert Body(1.0, [0, 0, 0], inertia).inertia.shape == (3, 3)


def test_the_inertia_that_is_checked_is_the_one_about_the_mass_centre():
    with pytest.raises(ParameterError, match="principal moments"):
        Body.about([0, 0, 0], 1.0, [1, 0, 0], [0.5, 0.5, 0.5])


def test_a_body_is_frozen_and_keeps_copies():
    com, inertia = np.array([0.1, 0, 0]), np.eye(3)
    body = Body(1.0, com, inertia)
    com[0] = inertia[0, 0] = 9.0
    assert (body.com[0], body.inertia[0, 0]) == (0.1, 1.0)
    for array in (body.com, body.inertia):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        body.mass = 2.0
    moments_ = np.eye(3)
    made = Body.about([0, 0, 0], 1.0, [0, 0, 0], moments_)
    moments_[0, 0] = 9.0
    assert made.inertia[0, 0] == 1.0


def test_replace_makes_a_checked_body():
    assert dataclasses.replace(some_body(), mass=3.0).mass == 3.0
    with pytest.raises(ParameterError, match="mass"):
        dataclasses.replace(some_body(), mass=-3.0)


@REPEATABLE
@given(
    st.floats(0.01, 100),
    *[st.lists(st.floats(-2, 2), min_size=3, max_size=3)] * 3,
    st.lists(st.floats(0.01, 1), min_size=3, max_size=3),
)
def test_about_and_inertia_about_are_inverse(mass, com, point, turn, spread):
    from scipy.spatial.transform import Rotation

    axes = Rotation.from_rotvec(turn).as_matrix()
    inertia = axes @ np.diag(sum(spread) - np.array(spread)) @ axes.T
    inertia = (inertia + inertia.T) / 2
    body = Body(mass, com, inertia)
    moved = body.inertia_about(point)
    again = Body.about(point, mass, com, moved)
    scale = max(1.0, np.abs(moved).max())
    np.testing.assert_allclose(again.inertia, inertia, rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(body.inertia_about(com), inertia, rtol=0, atol=1e-15)
    # Against the definition: the mass as three pairs of points along the principal axes.
    points = np.vstack([np.array(com) + sign * axes.T for sign in (1, -1)])  # (6, 3)
    weights = np.tile(np.array(spread) / 2, 2)
    arms = points - point
    rest = mass - weights.sum()
    arm = np.array(com) - point
    expected = sum(w * (d @ d * np.eye(3) - np.outer(d, d)) for w, d in zip(weights, arms, strict=True))
    expected = expected + rest * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-11 * scale)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"point": [0, 0]}, r"point: expected shape \(3,\)"),
        ({"com": [0, 0, math.nan]}, "com: expected finite"),
        ({"inertia": np.eye(2)}, "inertia: expected three numbers"),
        ({"inertia": None}, "inertia: expected"),
        ({"mass": -1.0}, "mass: expected zero or more"),
    ],
)
def test_about_refuses(change, message):
    good = {"point": [0, 0, 0], "mass": 1.0, "com": [0, 0, 0], "inertia": [1, 1, 1]}
    with pytest.raises(ParameterError, match=message):
        Body.about(**(good | change))


@pytest.mark.parametrize(
    ("make", "change"),
    [
        (Body, {"inertia": [1, [2], 3]}),
        (Body.about, {"inertia": [1, [2], 3]}),
        (Body.about, {"inertia": "abc"}),
        (Body.about, {"mass": "abc"}),
        (Body.about, {"mass": None}),
        (Body.about, {"mass": [1.0, 2.0]}),
    ],
)
def test_wrong_types_are_parameter_errors(make, change):
    good = {"mass": 1.0, "com": [0, 0, 0], "inertia": [1, 1, 1]}
    if make is not Body:
        good["point"] = [0, 0, 0]
    with pytest.raises(ParameterError):
        make(**(good | change))


def test_inertia_about_checks_its_point():
    with pytest.raises(ParameterError, match="point"):
        some_body().inertia_about([0, 0])


@pytest.mark.parametrize("masses", [(0.25, 0.75), (1.0, 0.0), (0.0, 0.0), (2.0, 3.0)])
def test_points_that_are_joined_are_those_of_steiner(masses):
    """Of two points on the x axis: the reduced mass times the square of their distance, about y and z."""
    ends = [Body(mass, (x, 0, 0), np.zeros((3, 3))) for mass, x in zip(masses, (0.1, 0.5), strict=True)]
    whole, total = ends[0].joined(ends[1]), sum(masses)
    assert whole.mass == total
    assert len(whole.parts) == (2 if all(masses) else 0)
    if total:
        assert whole.com[0] == pytest.approx((0.1 * masses[0] + 0.5 * masses[1]) / total, rel=1e-14)
        about = masses[0] * masses[1] / total * 0.4**2
        np.testing.assert_allclose(whole.inertia, np.diag([0, about, about]), rtol=0, atol=1e-15)


def test_massless():
    body = Body.massless()
    assert body.mass == 0
    assert not body.com.any()
    assert not body.inertia.any()


# ---------------------------------------------------------------- Geometry, Limits, Bodies, Parameters


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"r": 0.25}, "expected r < R"),
        ({"r": 0.3}, r"expected r < R \(r = R is singular everywhere\), got r = 0\.3, R = 0\.25 m"),
        ({"L": 0.15}, r"L: expected more than R - r = 0\.15 m .* got 0\.15 m"),
        ({"L": 0.1}, "L: expected more than"),
        ({"b": 0.0}, "b: expected a positive number, got 0"),
        ({"b": -0.05}, "b: expected a positive"),
        ({"r": 0}, "r: expected a positive"),
        ({"R": -1}, "R: expected a positive"),
        ({"L": math.nan}, "L: expected a finite"),
        ({"L": math.inf}, "L: expected a finite"),
        ({"R": "0.25"}, "R: expected real numbers"),
        ({"r": None}, "r: expected real numbers"),
        ({"r": True}, "r: expected real numbers"),
        ({"r": [0.1]}, r"r: expected a single number"),
    ],
)
def test_geometry_refuses(change, message):
    with pytest.raises(ParameterError, match=message):
        Geometry(**change)
    with pytest.raises(ParameterError, match=message):
        dataclasses.replace(PAPER.geometry, **change)


def test_geometry_holds_plain_floats():
    geometry = Geometry(r=np.float64(0.1), R=np.array(0.25), L=1)
    assert all(type(value) is float for value in dataclasses.astuple(geometry))
    assert geometry == Geometry(0.1, 0.25, 1.0)
    assert hash(geometry) == hash(Geometry(0.1, 0.25, 1.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"travel": (0.1, 0.2)}, r"travel: expected a range around 0 \(home\), got \[0\.1, 0\.2\]"),
        ({"travel": (0.2, -0.2)}, "travel: expected a range around 0"),
        ({"travel": (0.0, 0.2)}, "travel: expected a range around 0"),
        ({"travel": (-0.2, 0.2, 0.3)}, r"travel: expected shape \(2,\)"),
        ({"travel": 0.2}, r"travel: expected shape \(2,\)"),
        ({"travel": ("a", "b")}, "travel: expected real numbers"),
        ({"travel": (-math.inf, math.inf)}, "travel: expected finite"),
        ({"tilt": (0.1, 1)}, "tilt: expected a range around 0"),
        ({"tilt": (-1, math.nan)}, "tilt: expected finite"),
        ({"speed": 0}, "speed: expected a positive"),
        ({"speed": -2}, "speed: expected a positive"),
        ({"force": math.nan}, "force: expected a finite"),
        ({"force": None}, "force: expected real"),
    ],
)
def test_limits_refuse(change, message):
    with pytest.raises(ParameterError, match=message):
        Limits(**change)


def test_limits_hold_plain_tuples():
    limits = Limits(travel=np.array([-1, 1]), speed=3)
    assert limits.travel == (-1.0, 1.0)
    assert type(limits.travel) is tuple
    assert type(limits.travel[0]) is type(limits.speed) is float
    assert hash(limits) == hash(Limits(travel=(-1.0, 1.0), speed=3.0))


@pytest.mark.parametrize("name", LINKS)
def test_only_cross_bars_may_be_massless(name):
    if name in CROSSBARS:
        assert dataclasses.replace(PAPER.bodies, **{name: Body.massless()}).mass > 0
    else:
        with pytest.raises(ParameterError, match=f"^{name}: expected a positive mass, got 0 kg"):
            dataclasses.replace(PAPER.bodies, **{name: Body.massless()})


@pytest.mark.parametrize("value", [None, 1.0, {"mass": 1}, Body])
def test_bodies_are_bodies(value):
    with pytest.raises(ParameterError, match=r"^leg_b: expected a Body, got"):
        dataclasses.replace(PAPER.bodies, leg_b=value)


def test_bodies_alike():
    slider, leg, crossbar, platform = (some_body(m) for m in (1.0, 2.0, 3.0, 4.0))
    bodies = Bodies.alike(slider=slider, leg=leg, crossbar=crossbar, platform=platform)
    for names, body in ((SLIDERS, slider), (LEGS, leg), (CROSSBARS, crossbar), (("platform",), platform)):
        assert all(getattr(bodies, name) is body for name in names)
    assert [name for name, _ in bodies.items()] == LINKS
    assert bodies.mass == 3 * 1 + 4 * 2 + 2 * 3 + 4


def test_parameters_are_frozen_and_replaceable():
    gravity = np.array([0.0, 0.0, -1.6])
    moon = dataclasses.replace(PAPER, gravity=gravity)
    gravity[2] = 0
    assert moon.gravity.tolist() == [0, 0, -1.6]
    with pytest.raises(ValueError, match="read-only"):
        moon.gravity[0] = 1
    for thing, name in (
        (PAPER, "gravity"),
        (PAPER.geometry, "r"),
        (PAPER.bodies, "leg_a"),
        (PAPER.limits, "speed"),
        (Dimensions(), "rod_radius"),
    ):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(thing, name, None)
    assert PAPER.gravity.tolist() == [0.0, 0.0, -9.806]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"geometry": None}, "geometry: expected Geometry, got NoneType"),
        ({"bodies": {}}, "bodies: expected Bodies, got dict"),
        ({"limits": 3}, "limits: expected Limits, got int"),
        ({"gravity": -9.8}, r"gravity: expected shape \(3,\)"),
        ({"gravity": [0, 0, math.nan]}, "gravity: expected finite"),
        ({"gravity": ["x", 0, 0]}, "gravity: expected real numbers"),
    ],
)
def test_parameters_refuse(change, message):
    with pytest.raises(ParameterError, match=message):
        dataclasses.replace(PAPER, **change)


def test_parameter_errors_are_value_errors_of_the_package():
    assert issubclass(ParameterError, ValueError)
    assert issubclass(ParameterError, P3dofError)


# ---------------------------------------------------------------- parameter files

KINDS = """
geometry: {r: 0.1, R: 0.25, L: 0.4}
bodies:
  slider:   {mass: 1, com: [0, 0, 0], inertia: [1e-3, 1e-3, 1e-3]}
  leg:
    {mass: 1.0, com: [0.2, 0, 0], inertia: [[6e-4, 0, 0], [0, 0.0524, 0], [0, 0, 0.0524]], about: [0, 0, 0]}
  crossbar: {mass: 0, com: [0, 0, 0], inertia: [0, 0, 0]}
  platform: {mass: 8, com: [-0.03, 0, 0], inertia: [0.02, 0.02, 0.03]}
"""


@pytest.mark.parametrize("parameters", [PAPER, SOLIDS], ids=["paper", "solids"])
def test_yaml_round_trip_keeps_every_bit(tmp_path, parameters):
    path = tmp_path / "new folder" / "Maschine θ.yaml"
    write_parameters(parameters, path)
    assert_same_parameters(read_parameters(path), parameters)
    assert_same_parameters(read_parameters(str(path)), parameters)


@REPEATABLE
@given(
    st.lists(st.floats(1e-9, 1e9), min_size=8, max_size=8),
    st.lists(st.floats(-1e9, 1e9), min_size=9, max_size=9),
)
def test_any_numbers_survive_the_file(positive, any_sign):
    r, gap, reach, b, speed, force, mass, size = positive
    R = r * (1.001 + gap)
    geometry = Geometry(r, R, R * (1 + min(reach, 99.0)), b)
    body = Body(mass, any_sign[:3], size * np.array([1.0, 1.1, 1.2]))
    bodies = dataclasses.replace(
        PAPER.bodies, platform=body, crossbar_lower=Body(mass, any_sign[3:6], np.zeros(3))
    )
    limits = Limits((-speed, force), speed, force, (-size, mass))
    parameters = Parameters(geometry, bodies, limits, any_sign[6:])
    assert_same_parameters(parse(dump(parameters), any_size=True), parameters)


def test_the_form_by_kinds():
    parameters = parse(KINDS)
    assert parameters.geometry == Geometry()
    assert parameters.limits == Limits()
    assert parameters.gravity.tolist() == [0, 0, -9.806]
    assert {getattr(parameters.bodies, name).mass for name in SLIDERS} == {1.0}
    for name in LEGS:
        leg = getattr(parameters.bodies, name)
        np.testing.assert_allclose(np.diag(leg.inertia), [0.0006, 0.0124, 0.0124], rtol=0, atol=1e-17)
    assert parameters.bodies.crossbar_lower.mass == 0
    assert parameters.bodies.slider_a.inertia[0, 0] == 1e-3  # text to YAML 1.1


def test_the_form_by_links():
    data = yaml.safe_load(dump(PAPER))
    assert list(data["bodies"]) == LINKS
    data["bodies"]["leg_b"]["mass"] = 2.5
    parameters = parse(yaml.safe_dump(data))
    assert parameters.bodies.leg_b.mass == 2.5
    assert parameters.bodies.leg_a.mass == 0.9803


def test_the_written_file_states_its_units():
    assert dump(PAPER).startswith("# p3dof parameters: m, kg, kg m²")


def edited(path: str, value: object) -> str:
    """Return the text of KINDS with one field changed, or removed if the value is `...`."""
    data = yaml.safe_load(KINDS)
    *parents, last = path.split(".")
    place = data
    for parent in parents:
        place = place[parent]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return yaml.safe_dump(data)


MALFORMED = {
    "no_geometry": (edited("geometry", ...), "file: the field 'geometry' is missing"),
    "no_bodies": (edited("bodies", ...), "file: the field 'bodies' is missing"),
    "no_r": (edited("geometry.r", ...), "file: geometry: the field 'r' is missing"),
    "no_kind": (edited("bodies.leg", ...), "file: bodies: the field 'leg' is missing"),
    "no_mass": (edited("bodies.leg.mass", ...), "file: bodies.leg: the field 'mass' is missing"),
    "unknown_top": (edited("gravitiy", [0, 0, -9]), "file: unknown field 'gravitiy', expected .*gravity"),
    "unknown_length": (edited("geometry.l", 0.4), "file: geometry: unknown field 'l', expected r, R, L"),
    "unknown_link": (edited("bodies.leg_d", {}), "file: bodies: unknown field '[a-z_]+', expected slider_a"),
    "unknown_in_body": (edited("bodies.leg.colour", "red"), "file: bodies.leg: unknown field 'colour'"),
    "unknown_limit": (
        edited("limits", {"torque": 1}),
        "file: limits: unknown field 'torque', expected travel",
    ),
    "number_as_key": (edited("geometry", {1: 2}), "file: geometry: unknown field '1'"),
    "mass_text": (
        edited("bodies.platform.mass", "heavy"),
        "file: bodies.platform.mass: expected a mass, .* got 'heavy'",
    ),
    "mass_nan": (edited("bodies.leg.mass", math.nan), "file: bodies.leg: mass: expected a finite"),
    "mass_nan_text": (edited("bodies.leg.mass", "nan"), "file: bodies.leg: .*expected"),
    "mass_null": (edited("bodies.slider.mass", None), "file: bodies.slider: mass: expected real numbers"),
    "mass_negative": (edited("bodies.slider.mass", -1), "file: bodies.slider: mass: expected zero or more"),
    "mass_bool": (edited("bodies.slider.mass", True), "file: bodies.slider: mass: expected real numbers"),
    "mass_list": (edited("bodies.slider.mass", [1]), r"file: bodies.slider: mass: expected a single number"),
    "massless_platform": (
        edited("bodies.platform", {"mass": 0, "com": [0, 0, 0], "inertia": [0, 0, 0]}),
        "file: bodies: platform: expected a positive mass",
    ),
    "com_short": (edited("bodies.leg.com", [1, 2]), r"file: bodies.leg: com: expected shape \(3,\)"),
    "inertia": (
        edited("bodies.slider.inertia", [1, 1, 3]),
        "file: bodies.slider: inertia: .*sum of the other two",
    ),
    "about_text": (edited("bodies.leg.about", "C5"), "file: bodies.leg.about: expected a length.* 'C5'"),
    "about_short": (edited("bodies.leg.about", [0, 0]), r"file: bodies.leg: point: expected shape \(3,\)"),
    "body_list": (edited("bodies.leg", [1, 2]), "file: bodies.leg: expected the fields mass, com, inertia"),
    "bodies_list": (edited("bodies", [1, 2]), "file: bodies: expected the fields slider_a"),
    "geometry_number": (edited("geometry", 3), "file: geometry: expected the fields r, R, L"),
    "geometry_singular": (edited("geometry.R", 0.1), "file: geometry: r, R: expected r < R"),
    "limits_range": (edited("limits", {"travel": [1, 2]}), "file: limits: travel: expected a range around 0"),
    "gravity_number": (edited("gravity", -9.8), r"file: gravity: expected shape \(3,\)"),
    "gravity_nan": (edited("gravity", [0, 0, math.nan]), "file: gravity: expected finite"),
    "duplicate": (
        KINDS + "geometry: {r: 0.1, R: 0.25, L: 0.5}\n",
        "file, line [0-9]+: .*'geometry' is given more",
    ),
    "empty": (
        "",
        "file: expected the fields geometry, bodies, limits, gravity, friction, actuators, payload, "
        "density, dimensions, got nothing",
    ),
    "list": ("- geometry\n- bodies\n", r"file: expected the fields geometry, .*got a list"),
    "text": ("hello", "file: expected the fields geometry, .*got 'hello'"),
    "not_yaml": ("geometry: {r: 0.1\nbodies: [", "file, line [0-9]: not valid YAML"),
    "tabs": ("geometry:\n\tr: 0.1\n", "file, line 2: not valid YAML"),
    "csv": ("t;y;z;theta\n0;0;0;0\n", "file: expected the fields geometry"),
    "python_tag": ("!!python/object/apply:os.system ['true']", "file, line 1: not valid YAML"),
    "python_tag_inside": (
        KINDS.replace("mass: 8", "mass: !!python/object/apply:os.getpid []"),
        "file, line 8: not valid YAML",
    ),
}


@pytest.mark.parametrize(("text", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files_get_one_clear_line(tmp_path, text, message):
    path = tmp_path / "file"
    path.write_text(text)
    with pytest.raises(ParameterError, match=message) as caught:
        read_parameters(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_python_tag_is_never_executed(tmp_path):
    made = tmp_path / "made"
    with pytest.raises(ParameterError):
        parse(f"!!python/object/apply:os.mkdir ['{made}']")
    assert not made.exists()


def test_a_list_that_holds_itself_is_an_error():
    with pytest.raises(ParameterError):
        parse(KINDS + "gravity: &loop [*loop]\n")


def test_a_ragged_inertia_is_an_error():
    with pytest.raises(ParameterError):
        parse(edited("bodies.slider.inertia", [1, [2]]))


def test_a_mass_of_text_beside_about_is_an_error():
    with pytest.raises(ParameterError):
        parse(edited("bodies.leg.mass", "heavy"))


def test_the_known_fields_are_listed_once():
    with pytest.raises(ParameterError) as caught:
        parse(edited("geometry.l", 0.4))
    assert str(caught.value).endswith("expected r, R, L, b")


def test_unreadable_files(tmp_path):
    with pytest.raises(FileError, match=r"none\.yaml: cannot be read"):
        read_parameters(tmp_path / "none.yaml")
    with pytest.raises(FileError, match="cannot be read"):
        read_parameters(tmp_path)
    path = tmp_path / "large.yaml"
    write_parameters(PAPER, path)
    path.write_bytes(b"#" * (files.MAX_BYTES + 1))
    with pytest.raises(FileError, match=r"large\.yaml: expected at most 20000000 bytes"):
        read_parameters(path)
    (tmp_path / "folder.yaml").mkdir()
    with pytest.raises(FileError, match="cannot be written"):
        write_parameters(PAPER, tmp_path / "folder.yaml")
    with pytest.raises(InputError, match=r"m\.json: expected a file name that ends in \.yaml or \.yml"):
        write_parameters(PAPER, tmp_path / "m.json")


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path: Path = tmp_path / "machine.yaml"
    write_parameters(PAPER, path)

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(FileError):
        write_parameters(SOLIDS, path)
    assert_same_parameters(read_parameters(path), PAPER)
    assert list(tmp_path.iterdir()) == [path]


def test_parameters_can_be_copied():
    for other in (copy.deepcopy(PAPER), pickle.loads(pickle.dumps(PAPER))):  # noqa: S301 - our own
        assert_same_parameters(other, PAPER)
        with pytest.raises(ValueError, match="read-only"):
            other.bodies.platform.com[0] = 9
        with pytest.raises(ValueError, match="read-only"):
            other.gravity[0] = 9


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: box((-0.1, -0.1, 0.1)), "size: expected a positive number"),
        (lambda: box("abc"), "size: expected real numbers"),
        (lambda: cylinder(-0.01, 0.4), "radius: expected a positive number"),
        (lambda: cylinder(0.01, 0.4, axis=5), "axis: expected 0, 1 or 2"),
        (lambda: cylinder(0.01, 0.4, density=0), "density: expected a positive number"),
        (lambda: rounded_plate([[0, 0], [1, 1], [2, 2]], 0.1, 0.1), "corners: expected a triangle"),
        (lambda: rounded_plate([[0, 0], [1, 1]], 0.1, 0.1), "corners: expected shape"),
        (lambda: of_solids(geometry=3), "geometry: expected Geometry, got int"),
        (lambda: of_solids(limits=3), "limits: expected Limits, got int"),
    ],
)
def test_solids_that_are_none(make, words):
    with pytest.raises(ParameterError, match=words):
        make()


def test_a_clockwise_plate_is_the_same():
    corners = np.array([[0.0, -0.1], [0.0, 0.1], [-0.1, 0.0]])
    one, other = (rounded_plate(c, 0.02, 0.05) for c in (corners, corners[::-1]))
    assert one.mass == pytest.approx(other.mass, rel=1e-14)
    np.testing.assert_allclose(one.inertia, other.inertia, rtol=1e-12, atol=1e-15)
