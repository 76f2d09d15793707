"""Design problems: measures of designs, their exact gradients, constraints that say what is missed."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from design_problems import BETTER, PAPER_DESIGN, STEEL, paper_problem
from machines import positions

import p3dof
from p3dof import InputError
from p3dof._base.checks import FloatArray
from p3dof.analysis.reactions.stiffness import RodSection
from p3dof.design import DesignProblem
from p3dof.design.optimisation import MEASURES, Box, FunctionMeasure, relation
from p3dof.design.optimisation.population import Pieces, Population
from p3dof.design.optimisation.task_measures import OF_TASKS

SPACE = ("motion_clearance", "height", "room")  # tests/design/test_clearance.py
BY_DIFFERENCES = ("fastest_time", "rod_buckling_share", "rod_stress", *SPACE)
OF_MOTIONS = [name for name in MEASURES if name not in {measure.name for measure in OF_TASKS}]
NEAR = [[0.11, 0.27, 0.41, 0.008], [0.09, 0.22, 0.36, 0.006], PAPER_DESIGN]


def test_the_papers_design_has_the_published_numbers_of_the_problem() -> None:
    problem = paper_problem()
    found = problem.evaluate(PAPER_DESIGN)
    assert found["peak_force"][0] == pytest.approx(119.93761, abs=1e-5)
    assert found["width"][0] == pytest.approx(0.5, abs=1e-15)
    assert found["rms_power"][0] == pytest.approx(58.44702, abs=1e-5)
    assert found.feasible[0]
    assert problem.start == pytest.approx(PAPER_DESIGN, abs=1e-15)


def test_the_gradient_of_the_papers_peak_is_the_published_one() -> None:
    gradient = paper_problem().gradient(PAPER_DESIGN)["peak_force"]
    assert gradient == pytest.approx([1632.4, -434.67, 219.59, 4369.5], rel=2e-5)


@pytest.mark.parametrize("design", NEAR)
def test_gradients_of_all_measures_are_those_of_differences(design: list[float]) -> None:
    exact = [name for name in OF_MOTIONS if name not in BY_DIFFERENCES]
    problem = paper_problem(objectives=exact, constraints=())
    gradient, step = problem.gradient(design), 1e-6
    moved = np.array([np.array(design) + sign * step * axis for axis in np.eye(4) for sign in (1, -1)])
    found = problem.evaluate(moved)
    for name in exact:
        ahead, behind = found[name][::2], found[name][1::2]
        scale = max(np.abs(found[name]).max(), 1e-3)
        # Differences of step h miss by h² of the third derivative and by rounding of the values over h.
        assert gradient[name] == pytest.approx((ahead - behind) / (2 * step), rel=1e-6, abs=1e-5 * scale), (
            name
        )


def test_a_search_starts_at_the_machine_as_it_is() -> None:
    """Its lengths and masses, the motion where it is, nothing carried; of solids their sizes, and steel."""
    bounds, lengths = (1e-3, 0.5), p3dof.PAPER.geometry
    names = ("offset.y", "offset.theta", "platform.mass", "L", "payload.mass")
    problem = DesignProblem(dict.fromkeys(names, bounds), objectives=["moving_mass"])
    assert problem.start.tolist() == [0.0, 0.0, p3dof.PAPER.bodies.platform.mass, lengths.L, 0.0]
    names = ("rod_radius", "density")
    solids = DesignProblem(dict.fromkeys(names, bounds), objectives=["moving_mass"], bodies="solids")
    radius = p3dof.machine.parameters.Dimensions.scaled(lengths).rod_radius
    assert solids.start.tolist() == [radius, p3dof.machine.parameters.STEEL_DENSITY]


def test_gradients_by_the_place_of_the_motion_and_by_masses_are_those_of_differences() -> None:
    variables = {"offset.y": (-0.05, 0.05), "offset.theta": (-0.2, 0.2), "platform.mass": (4, 12)}
    problem = DesignProblem(variables, objectives=["peak_force", "rms_power", "stroke_margin", "moving_mass"])
    design, step = np.array([0.013, 0.07, 7.0]), 1e-6
    gradient = problem.gradient(design)
    moved = np.array([design + sign * step * axis for axis in np.eye(3) for sign in (1, -1)])
    found = problem.evaluate(moved)
    for name, values in gradient.items():
        assert values == pytest.approx(
            (found[name][::2] - found[name][1::2]) / (2 * step), rel=1e-5, abs=1e-5
        )
    assert gradient["moving_mass"] == pytest.approx([0, 0, 1], abs=1e-12)


def test_measures_of_one_design_are_those_of_its_machine() -> None:
    problem = paper_problem(objectives=OF_MOTIONS, constraints=())
    found, robot = problem.evaluate(NEAR[0]), p3dof.load(problem.machine(NEAR[0]))
    dynamics = robot.inverse_dynamics(p3dof.paper_motion(201))
    assert found["peak_force"][0] == pytest.approx(np.abs(dynamics.forces).max(), rel=1e-12)
    assert found["rms_force"][0] == pytest.approx(dynamics.rms_forces.max(), rel=1e-12)
    power = np.abs(dynamics.forces * dynamics.slider_velocities).sum(axis=1)
    assert found["rms_power"][0] == pytest.approx(np.sqrt(np.trapezoid(power**2, dynamics.time)), rel=1e-12)
    assert found["moving_mass"][0] == pytest.approx(
        sum(body.mass for _, body in robot.parameters.bodies.items()), rel=1e-13
    )
    y, theta = problem.setting.box.poses
    poses = np.stack([y, 0 * y, theta], axis=1)
    singular = robot.singularity(poses)
    assert found["singularity"][0] == pytest.approx(singular.actuation.min(), rel=1e-12)
    index = robot.indices(poses)
    assert found["transmission"][0] == pytest.approx(index.lti.min(), rel=1e-12)
    assert found["serial_reach"][0] == pytest.approx(index.iti.min(), rel=1e-12)
    J = robot.jacobian(poses)
    errors = np.abs(np.linalg.inv(J)).sum(axis=2).max(axis=0)
    for name, value in zip(("accuracy_y", "accuracy_z", "accuracy_theta"), errors, strict=True):
        assert found[name][0] == pytest.approx(value, rel=1e-10)
    sliders = robot.inverse_kinematics(poses).sliders
    assert found["box_height"][0] == pytest.approx(0.4 - (sliders.max() - sliders.min()), rel=1e-12)


def test_solids_keep_the_papers_sizes_times_the_least_ratio_of_lengths() -> None:
    """So they fit any machine: its buckling load and gaps, by hand, where each length is the smallest."""
    variables = {"r": (0.01, 1.0), "R": (0.01, 1.0), "L": (0.1, 2.0), "b": (0.01, 0.5)}
    motion = p3dof.Motion.rest_to_rest([0, 0, 0], [1e-3, 0, 0], 1.0, 11)
    problem = DesignProblem(variables, motion, objectives=["rod_buckling", "clearance"], bodies="solids")
    paper, gaps = p3dof.machine.Geometry(), set()
    for r, R, L, b in (
        (0.06, 0.3, 0.5, 0.08),
        (0.2, 0.3, 0.7, 0.07),
        (0.15, 0.35, 0.38, 0.08),
        (0.12, 0.4, 0.6, 0.03),
        (0.2, 0.3, 0.102, 0.07),
    ):
        ratio = min(r / paper.r, (R - r) / (paper.R - paper.r), L / paper.L, b / paper.b)
        found = problem.evaluate([r, R, L, b])
        inertia = np.pi / 4 * (0.01 * ratio) ** 4
        assert found["rod_buckling"][0] == pytest.approx(np.pi**2 * 210e9 * inertia / L**2, rel=1e-12)
        edge, rod, thickness, corner = ratio * np.array([0.05, 0.01, 0.05, 0.02])
        aside, above = R - r - edge / 2 - corner, np.sqrt(L**2 - (R - r) ** 2) - edge / 2 - thickness / 2
        between = [max(aside, above), 2 * b - 2 * rod, R - edge]
        assert found["clearance"][0] == pytest.approx(min(between), rel=1e-12)
        gaps.add(int(np.argmin(between)))
    assert len(gaps) > 1


def test_gaps_between_solids_are_the_least_of_all_poses_of_the_box() -> None:
    """From positions of sliders and joints, each kind of gap being the least somewhere."""
    sizes = ("slider_edge", "rod_radius", "plate_thickness", "corner_radius")
    variables = dict.fromkeys(("r", "R", "L", "b", *sizes), (1e-3, 2.0))
    rng, box = np.random.default_rng(1), Box((-0.02, 0.03), (-0.5, 0.6), (5, 9))
    motion = p3dof.Motion.rest_to_rest([0, 0, 0], [1e-3, 0, 0], 1.0, 11)
    problem = DesignProblem(variables, motion, objectives=["clearance"], bodies="solids", box=box)
    low = [0.15, 0.3, 0.25, 0.05, 0.01, 0.01, 0.01, 0.01]
    high = [0.2, 0.4, 0.5, 0.3, 0.3, 0.04, 0.3, 0.1]
    designs, poses = rng.uniform(low, high, (100, 8)), np.stack(box.poses, axis=1)
    found, least = problem.evaluate(designs)["clearance"], []
    for design, value in zip(designs, found, strict=True):
        r, R, L, b, edge, rod, thickness, corner = design
        gaps = {"rods": 2 * b - 2 * rod, "sliders": R - edge}
        for y, theta in poses:
            sliders, joints = positions(p3dof.machine.Geometry(r, R, L, b), (y, 0.0, theta))
            aside = R - np.abs([*joints[:2, 1], joints[2, 0]]) - edge / 2 - corner
            tilt = np.array([0, 0, theta])  # the plate turns about the line of A and B
            upward = thickness / 2 * np.cos(tilt) + corner * abs(np.sin(tilt))
            above = sliders - joints[:, 2] - edge / 2 - upward
            for k, leg in enumerate("ABC"):
                kind = f"{leg} {'aside' if aside[k] > above[k] else 'above'}"
                gaps[kind] = min(gaps.get(kind, np.inf), max(aside[k], above[k]))
        assert value == pytest.approx(min(gaps.values()), rel=1e-10)
        least.append(min(gaps, key=gaps.__getitem__))
    assert set(least) == {
        "rods",
        "sliders",
        *(f"{leg} {where}" for leg in "ABC" for where in ("aside", "above")),
    }


def test_the_lowest_frequency_is_that_of_the_published_table() -> None:
    problem = DesignProblem(
        {"R": (0.2, 0.3)},
        objectives=["lowest_frequency"],
        box=Box((-1e-9, 1e-9), (-1e-9, 1e-9)),
        bodies="solids",
    )
    robot = p3dof.load(p3dof.SOLIDS)
    M, J = robot.mass_matrix([0, 0, 0]), robot.jacobian([0, 0, 0])
    rod = 210e9 * np.pi * 0.01**2 / 0.4 * (1 - 0.375**2)
    K = J.T @ np.diag([1 / (1e-7 + 1 / (n * rod)) for n in (1, 1, 2)]) @ J
    expected = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min()) / (2 * np.pi)
    assert problem.evaluate([0.25])["lowest_frequency"][0] == pytest.approx(expected, rel=1e-7)


def test_margins_of_a_box_are_those_between_the_poses_of_its_grid_too() -> None:
    problem = paper_problem(objectives=["singularity"], box=Box((-0.1, 0.1), (-np.pi / 6, np.pi / 4), (2, 2)))
    fine = np.meshgrid(np.linspace(-0.1, 0.1, 41), np.linspace(-np.pi / 6, np.pi / 4, 401))
    y, theta = (axis.ravel() for axis in fine)
    design = [0.18, 0.24, 0.5, 0.01]
    robot = p3dof.load(problem.machine(design))
    least = robot.singularity(np.stack([y, 0 * y, theta], axis=1)).actuation.min()
    found = problem.evaluate(design)["singularity"][0]
    assert found <= least + 1e-12
    assert found == pytest.approx(least, abs=1e-4)


@pytest.mark.parametrize(("name", "peak", "design"), BETTER)
def test_published_optima_have_their_peaks_and_are_feasible_but_for_rounding(
    name: str, peak: float, design: list[float]
) -> None:
    found = paper_problem().evaluate(design)
    assert found["peak_force"][0] == pytest.approx(peak, abs=0.01), name
    assert found.violation[0] < 3e-3


def test_a_missed_constraint_is_named_with_what_is_missing() -> None:
    found = paper_problem().evaluate([0.1, 0.25, 0.27, 0.003])
    assert not found.feasible[0]
    assert found.reason(0).startswith("serial_reach ≥ 0.4: violated by 0.")
    far = paper_problem().evaluate([0.08, 0.5, 0.3, 0.003])
    assert far.reason(0) == "no geometry: 0 < r < R, L > R - r >= 1e-6 L and b > 0 do not hold"
    assert np.isnan(far.objectives[0, 0])
    assert far.violation[0] > 10


def test_relations_are_read_as_they_are_written() -> None:
    problem = DesignProblem({"r": (0.05, 0.2)}, constraints=["L >= 1.02*(R - r + 0.1)", "2*R/4 <= r + 0.1"])
    found = problem.evaluate([[0.1], [0.02]])
    assert found.margins[0] == pytest.approx([0.4 - 1.02 * 0.25, 0.2 - 0.125], abs=1e-15)
    assert found.margins[1] == pytest.approx([0.4 - 1.02 * 0.33, 0.12 - 0.125], abs=1e-15)


@pytest.mark.parametrize(
    "text", ["R", "R >= r * L", "R > 0 > r", "1 >= 0", "R >= __import__('os')", "R >= density", "R >= (", 3]
)
def test_what_is_no_relation_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"relation|expected|columns|units|unexpected|no formula"):
        relation(text)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"variables": {}}, "expected bounds by name"),
        ({"variables": {"R": (0.3, 0.2)}}, "lower bound below"),
        ({"variables": {"R": ("200 kg", 1)}}, "expected a length"),
        ({"variables": {"limits.force": (1, 2)}}, "limits are no part"),
        ({"variables": {"R": (0.2, 0.3), "geometry.R": (0.2, 0.3)}}, "twice"),
        ({"objectives": ["peak_forc"]}, "did you mean 'peak_force'"),
        ({"objectives": []}, "one measure or more"),
        ({"constraints": {"width": {"most": 1}}}, "expected {'min'"),
        ({"constraints": {"width": {"max": "wide"}}}, "expected a length"),
        ({"constraints": {"rms_power": {"max": "much"}}}, "max: expected a power, a number in W"),
        ({"constraints": {"singularity": {"min": 0.2}}}, "need a box"),
        ({"constraints": {"rod_frequency": {"min": 100}}}, "bodies='solids'"),
        ({"fixed": {"R": 0.25}}, "is a variable, too"),
        ({"box": (1, 2)}, "expected a Box"),
    ],
)
def test_what_is_no_problem_is_refused_in_one_line(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        DesignProblem(**{"variables": {"R": (0.2, 0.3)}, **arguments})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("design", "expected"), [(PAPER_DESIGN, 0.6481), ([0.1, 0.25, 0.272771, 0.003], 0.4569)]
)
def test_the_fastest_time_is_that_of_another_program(design: list[float], expected: float) -> None:
    limits = p3dof.machine.Limits(force=120.0, speed=2.0)
    problem = paper_problem(objectives=["fastest_time"], machine=replace(p3dof.PAPER, limits=limits))
    assert problem.evaluate(design)["fastest_time"][0] == pytest.approx(expected, rel=3e-4)


def test_the_fastest_time_has_a_gradient_and_needs_a_motion_that_moves() -> None:
    problem = DesignProblem({"R": (0.2, 0.3)}, objectives=["fastest_time"])
    slope = problem.gradient([0.25])["fastest_time"][0]
    ahead, behind = problem.evaluate([[0.26], [0.24]])["fastest_time"]
    assert slope == pytest.approx((ahead - behind) / 0.02, rel=0.05)
    resting = p3dof.paper_motion(51).from_rest(0.2)
    with pytest.raises(InputError, match="never stands still, for its path; it does at 0 s"):
        DesignProblem({"R": (0.2, 0.3)}, resting, objectives=["fastest_time"])


def test_rods_bear_what_the_reactions_say() -> None:
    names = ["rod_buckling_share", "rod_stress"]
    problem = paper_problem(objectives=names, constraints=(), motion=p3dof.paper_motion(101))
    design = [0.1, 0.25, 0.3, 0.004]
    found, gradient = problem.evaluate(design), problem.gradient(design)
    robot = p3dof.load(problem.machine(design))
    section = RodSection(diameter=0.008)
    stiffness = replace(p3dof.analysis.Stiffness(), rods=section)
    elastic = robot.reactions(p3dof.paper_motion(101), joints="elastic", stiffness=stiffness)
    upper = [elastic[joint].forces[:, 0] for joint in ("hinge_a", "hinge_b", "hinge_left", "hinge_right")]
    area, euler = np.pi * 0.004**2, np.pi**3 * 210e9 * 0.004**4 / 4 / 0.3**2
    # At the lower ends they differ by weight and inertia of the rods, some newtons of a hundred.
    weight = 7801 * area * 0.3 * 20
    assert found["rod_stress"][0] * area == pytest.approx(np.abs(upper).max(), abs=weight)
    assert found["rod_buckling_share"][0] * euler == pytest.approx(np.max(upper), abs=weight)
    for name in names:
        moved = problem.evaluate([[0.1, 0.25, 0.3, 0.00402], [0.1, 0.25, 0.3, 0.00398]])[name]
        assert gradient[name][3] == pytest.approx((moved[0] - moved[1]) / 4e-5, rel=1e-3)


def test_slopes_of_rods_are_each_designs_own_also_where_a_variable_is_zero() -> None:
    problem = DesignProblem(
        {"rod_radius": (0.0005, 0.1), "offset.y": (-0.01, 0.1)},
        p3dof.paper_motion(2),
        objectives=["rod_stress"],
        bodies="solids",
        fixed=STEEL,
    )
    designs, measure = np.array([[0.0008, 0.0], [0.05, 0.02]]), MEASURES["rod_stress"]

    def pieces(rows: FloatArray) -> Pieces:
        return measure.pieces(Population(problem.setting, rows))

    together = pieces(designs).gradients
    np.testing.assert_array_equal(together, [pieces(row[None]).gradients[0] for row in designs])
    for index, step in enumerate(([2e-6, 0], [0, 2e-6])):
        ahead, behind = (pieces(designs + sign * np.array(step)).values for sign in (1, -1))
        expected = (ahead - behind) / 4e-6
        scale = np.abs(expected).max(axis=1, keepdims=True)
        np.testing.assert_allclose(together[..., index] / scale, expected / scale, rtol=0, atol=1e-4)


def test_finer_grids_have_all_samples_and_poses_of_the_coarse_ones_and_some_between() -> None:
    load = np.outer(np.linspace(1.0, 3.0, 21), [1.0, -2.0, 30.0, 0.0, 0.5, 0.1])
    coarse = paper_problem(motion=p3dof.paper_motion(21), wrench=load)
    fine = coarse.refined(4).setting
    time, motion = fine.motion.time, coarse.setting.motion
    np.testing.assert_allclose(time, np.linspace(motion.time[0], motion.time[-1], 81), rtol=0, atol=1e-15)
    np.testing.assert_allclose(fine.motion.pose[::4], motion.pose, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fine.wrench, np.outer(np.linspace(1.0, 3.0, 81), load[0]), rtol=1e-12)
    assert coarse.setting.box is not None
    assert fine.box is not None
    for axis, (ends, count) in enumerate(
        zip((fine.box.y, fine.box.theta), coarse.setting.box.grid, strict=True)
    ):
        np.testing.assert_allclose(
            np.unique(fine.box.poses[axis]), np.linspace(*ends, 4 * count - 3), atol=1e-15
        )
    assert Box((0, 1), (0, 1), (101, 3)).finer(4).grid == (201, 9)
    assert coarse.setting.motion is motion


def test_problems_go_to_other_processes() -> None:
    problem = paper_problem(objectives=OF_MOTIONS, constraints=(), motion=p3dof.paper_motion(21))
    again = pickle.loads(pickle.dumps(problem))  # noqa: S301 - our own
    np.testing.assert_array_equal(again.evaluate(NEAR).objectives, problem.evaluate(NEAR).objectives)


def test_measures_of_ones_own_have_values_and_gradients() -> None:
    def ratio(designs: p3dof.analysis.Designs, by: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray | None]:
        r, L = designs.columns["geometry.r"], designs.columns["geometry.L"]
        gradient = (
            np.stack([{"geometry.r": 1 / L, "geometry.L": -r / L**2}[name] for name in by], axis=1)
            if by
            else None
        )
        return r / L, gradient

    own = FunctionMeasure("slenderness", "", ratio)
    problem = DesignProblem({"r": (0.05, 0.2), "L": (0.3, 0.5)}, objectives=[own, "peak_force"])
    assert problem.evaluate([[0.1, 0.4]])["slenderness"] == pytest.approx(0.25)
    assert problem.gradient([0.1, 0.4])["slenderness"] == pytest.approx([2.5, -0.625])


def test_what_is_evaluated_becomes_an_xarray_with_units() -> None:
    found = paper_problem().evaluate([PAPER_DESIGN, NEAR[0]]).to_dataset()
    assert found["peak_force"].attrs["units"] == "N"
    assert found["R"].attrs["units"] == "m"
    assert found["violation"].values.tolist() == [0, 0]
