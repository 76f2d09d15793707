"""Calibration of any robot: by a closed form of the Delta, by differences, by statistics of known errors."""

import itertools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from gallery import gallery
from linear_delta import ANGLES, ARM, RADIUS, heights_of, linear_delta, spheres
from numpy.testing import assert_allclose
from table_numbers import check_evidence, check_table, shows

import p3dof
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops import Measurements, calibrate, plan_measurements
from p3dof.loops.identification.calibration import MeasuredRobot, candidate_readings
from p3dof.loops.identification.fitting import (
    DisplacedRobot,
    chosen_poses,
    combinations_of,
    displacements,
    fit,
    observability,
)

TOWERS = [f"tower_{one}" for one in "abc"]
XYZ = ("x", "y", "z")
ALL = ("x", "y", "z", "rx", "ry", "rz")


def delta_parameters(robot):
    """Rods of one length, the radius of the towers, their shifts along its circle; tolerances of all."""
    along = dict(zip(TOWERS, zip(np.cos(ANGLES), np.sin(ANGLES), strict=True), strict=True))
    combined = {
        "arms": [f"{closure.name}.length" for closure in robot.sidecar.closures],
        "radius": {
            f"{tower}.{axis}": x for tower, xy in along.items() for axis, x in zip("xy", xy, strict=True)
        },
    }
    for tower, (c, s) in along.items():  # rods stay parallel in pairs, so that the platform does not turn
        combined[f"along_{tower[-1]}"] = {f"{tower}.x": -s, f"{tower}.y": c}
    tolerances = {"arms": 1e-3, "radius": 1e-3, "along_?": 1e-3, "tower_?.offset": 2e-3}
    return tolerances, combined


TRUE = {"radius": RADIUS - 3e-4, "arms": (ARM + 4e-4,) * 3}
OFFSETS = np.array([5e-4, -3e-4, 2e-4])


def delta_poses(count, seed=0):
    """Readings of the towers at positions by the design, and where the tool truly is, by three spheres."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-0.08, 0.08, (count, 2)), rng.uniform(0, 0.03, count)])
    readings = np.array([heights_of(point) for point in points])
    return readings, np.array([spheres(heights, **TRUE) for heights in readings - OFFSETS])


@pytest.fixture(scope="module")
def delta():
    return linear_delta()


def test_the_delta_of_this_test_is_that_of_three_spheres(delta):
    for point in np.random.default_rng(2).uniform(-0.07, 0.07, (5, 3)):
        heights = heights_of(point)
        assert_allclose(spheres(heights), point, rtol=0, atol=1e-15)
        assert_allclose(seen(delta, heights[None], "tool")[0, :3], point, rtol=0, atol=1e-14)


def seen(robot, readings, frame):
    """Poses of a frame (K, 6): positions and rotation vectors."""
    nothing, data, found = np.zeros_like(readings), robot.model.createData(), []
    for q in robot.complete_batch(readings, nothing, nothing, guess=robot.assemble().q).q:
        pin.framesForwardKinematics(robot.model, data, q)
        place = data.oMf[robot.model.getFrameId(frame)]
        found.append(np.concatenate((place.translation, pin.log3(place.rotation))))
    return np.array(found)


def test_errors_of_a_delta_are_found_to_rounding_from_exact_positions(delta):
    tolerances, combined = delta_parameters(delta)
    readings, positions = delta_poses(12)
    measured = Measurements(readings, positions, XYZ, "tool", sigma=1e-9)
    found = calibrate(delta, measured, tolerances, combined)
    values = dict(zip(found.names, found.parameters, strict=True))
    # One length and the towers' radius are found to rounding times the condition of the problem, 200.
    assert values["arms"] == pytest.approx(4e-4, abs=1e-12)
    assert values["radius"] == pytest.approx(-3e-4, abs=1e-12)
    assert_allclose([found.offsets[tower] for tower in TOWERS], OFFSETS, rtol=0, atol=1e-12)
    assert_allclose([values[f"along_{one}"] for one in "abc"], 0, atol=1e-12)
    assert np.abs(found.after[0]).max() < 1e-14
    assert np.abs(found.before[0]).max() > 5e-4
    others, there = delta_poses(20, seed=1)
    assert_allclose(found.errors(Measurements(others, there, XYZ, "tool", 1e-9))[0], 0, atol=1e-13)
    assert_allclose(seen(found.robot, others, "tool")[:, :3], there, rtol=0, atol=1e-13)


def test_errors_of_the_result_are_those_that_it_tells(delta):
    """Of many calibrations with noise: the parameters' errors have the covariance, the rest is the noise."""
    tolerances, combined = delta_parameters(delta)
    readings, positions = delta_poses(12)
    rng, distances, noise = np.random.default_rng(5), [], []
    for _ in range(12):
        values = positions + rng.normal(0, 2e-5, positions.shape)
        found = calibrate(delta, Measurements(readings, values, XYZ, "tool", 2e-5), tolerances, combined)
        off = found.parameters - [4e-4, -3e-4, 0, 0, 0, *OFFSETS]
        distances.append(off @ np.linalg.solve(found.covariance, off))
        noise.append(found.noise)
        assert (found.deviations < found.tolerances).all()
    # Sums of 96 squares: their standard deviation is sqrt(2 / 96); the prior is wide.
    assert np.mean(distances) / 8 == pytest.approx(1, abs=4 * np.sqrt(2 / 96))
    assert np.mean(np.square(noise)) == pytest.approx(1, abs=4 * np.sqrt(2 / (12 * 28)))


def test_a_delta_is_calibrated_by_touching_its_plate(delta):
    """Twelve touches of a plate of unknown height; the tool is then as far from it as it believes to be."""
    tolerances, combined = delta_parameters(delta)
    rings = [(0.0, 0.0)] + [
        (r * np.cos(a), r * np.sin(a))
        for r, count in ((0.04, 5), (0.08, 6))
        for a in 2 * np.pi * np.arange(count) / count
    ]
    readings = np.array([touching(x, y, -1e-3) for x, y in rings])
    measured = Measurements(readings, np.zeros(12), "z", "tool", sigma=1e-6)
    wide = tolerances | {"arms": 1e-8, "device.z": 5e-3}
    found = calibrate(delta, measured, wide, combined)
    assert np.abs(found.before[0]).max() > 5e-4
    values = dict(zip(found.names, found.parameters, strict=True))
    assert "radius" in values
    across = np.linspace(-0.075, 0.075, 7)
    grid = [(x, y) for x, y in itertools.product(across, across) if np.hypot(x, y) < 0.08]
    heights = np.array([touching(x, y, -1e-3) for x, y in grid])
    before = calibrate(delta, Measurements(heights, np.zeros(len(grid)), "z", "tool", 1e-6), wide, combined)
    flat = found.errors(Measurements(heights, np.zeros(len(grid)), "z", "tool", 1e-6))[0]
    assert np.abs(flat).max() < 5e-6  # rods of a wrong length are known to the tolerance only
    assert np.ptp(before.before[0]) > 100 * np.ptp(flat)


def test_constants_of_firmware_are_those_of_the_true_printer(delta):
    """Klipper and Marlin, by what their constants mean, stand where the true Delta does: three spheres."""
    tolerances, combined = delta_parameters(delta)
    turned = np.array([1e-3, -5e-4, 0.0])
    readings, _ = delta_poses(20)
    positions = np.array([spheres(at, **TRUE, angles=ANGLES + turned) for at in readings - OFFSETS])
    found = calibrate(delta, Measurements(readings, positions, XYZ, "tool", 1e-6), tolerances, combined)
    value = dict(zip(found.names, found.parameters, strict=True))
    arm, radius = ARM + value["arms"], RADIUS + value["radius"]
    angles = ANGLES + [value[f"along_{one}"] / RADIUS for one in "abc"]
    # Shifts for turns: radius times the square of an angle, 0.06 µm, and what the condition makes of it.
    assert_allclose(angles - ANGLES, turned, rtol=0, atol=3e-6)
    old = 0.3  # position_endstop so far: the nozzle's height over the middle where the switches trigger
    believed = old + np.sqrt(ARM**2 - RADIUS**2)  # the carriages there
    switch = believed - [found.offsets[tower] for tower in TOWERS]
    endstops = switch - np.sqrt(arm**2 - radius**2)
    # Klipper: a carriage at its switch is at position_endstop + sqrt(arm_length² - delta_radius²).
    down = believed - readings  # how far carriages have gone down from their switches, as steps are counted
    for steps, there in zip(down, positions, strict=True):
        carriage = endstops + np.sqrt(arm**2 - radius**2) - steps
        assert_allclose(spheres(carriage, radius, (arm,) * 3, angles), there, rtol=0, atol=3e-7)
    # Marlin: after homing each carriage has gone down by -M666 and all count as at H over the middle.
    adjust, height = switch.min() - switch, endstops.min()
    assert (adjust <= 0).all()
    for steps, there in zip(down, positions, strict=True):
        carriage = height + np.sqrt(arm**2 - radius**2) - (steps + adjust)
        assert_allclose(spheres(carriage, radius, (arm,) * 3, angles), there, rtol=0, atol=3e-7)


def touching(x, y, plate):
    """Heights of the carriages, by the design's commands for (x, y), where the true tool is at a height."""
    low, high = -0.02, 0.02
    for _ in range(60):
        middle = (low + high) / 2
        heights = heights_of((x, y, middle))
        low, high = (middle, high) if spheres(heights - OFFSETS, **TRUE)[2] < plate else (low, middle)
    return heights_of((x, y, (low + high) / 2))


CASES = {
    "planar": (
        "five_bar",
        "left_tip",
        {"*_motor.offset": 1, "left_elbow.x": 1, "left_tip.length": 1},
        ("x", "z"),
    ),
    "base": (
        "five_bar",
        "left_tip",
        {"right_motor.offset": 1, "left_elbow.length": 1, "device.z": 1, "device.pitch": 1},
        ("x", "distance"),
    ),
    "rods": (
        "delta",
        "platform",
        {"motor_?.offset": 1, "rod_a_?_tip.length": 1, "rod_b_l_seat.x": 1, "motor_c.yaw": 1, "motor_a.z": 1},
        ALL,
    ),
    "parts": ("delta", "platform", {"rod_?_l_swing.length": 1, "device.roll": 1}, ("rx", "rz", "y")),
    "ball bar": ("delta", "platform", {"motor_a.pitch": 1, "rod_c_r_tip.y": 1}, ("distance",)),
    "legs": (
        "stewart",
        "platform",
        {"leg_?.offset": 1, "seat_1.z": 1, "ball_2.length": 1, "device.x": 1},
        ALL,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_derivatives_are_differences(case):
    name, frame, tolerances, components = CASES[case]
    robot = gallery(name)
    readings = readings_about(robot, 3, 0.05 if name != "stewart" else 0.02)
    values = np.full((3, len(components)), 0.1)
    measured = Measurements(readings, values, components, frame, 1.0, point=(0.1, 0.2, 0.5))
    parameters = displacements(robot, tolerances, {}, ["device"])
    problem = MeasuredRobot(robot, measured, parameters)
    p = 1e-3 * np.random.default_rng(1).normal(size=len(parameters.names))
    _, rows = problem.evaluate(p)
    step = 1e-4
    for k, name in enumerate(parameters.names):
        h = step * np.eye(len(p))[k]
        a, b, c, d = (problem.evaluate(p + n * h)[0] for n in (-2, -1, 1, 2))
        found = (a - 8 * b + 8 * c - d) / (12 * step)  # of fourth order: 1e-16 / step and step⁴
        assert_allclose(rows[:, k], found, rtol=0, atol=1e-10 * max(1, np.abs(rows).max()), err_msg=name)
    assert np.linalg.matrix_rank(rows) == len(p) or case in ("ball bar", "parts", "legs")


def readings_about(robot, count, amplitude, seed=0):
    """Readings of the motors about the reference."""
    home = robot.assemble().q
    start = np.array([home[robot.model.idx_qs[robot.model.getJointId(name)]] for name in robot.actuated])
    return start + amplitude * np.random.default_rng(seed).uniform(-1, 1, (count, len(start)))


def test_lengths_of_single_rods_tilt_the_platform_and_are_found(tmp_path):
    """A Delta whose six rods differ, and offsets of motors, from poses: then written, and read again."""
    design = gallery("delta")
    tolerances = {"rod_*_tip.length": 3e-4, "motor_?.offset": 3e-3}
    parameters = displacements(design, tolerances, {}, ["device"])
    true = parameters.tolerances * np.random.default_rng(3).normal(size=len(parameters.names))
    readings = readings_about(design, 12, 0.3)
    unknown = Measurements(readings, np.zeros((12, 6)), ALL, "platform", 1.0)
    as_built = MeasuredRobot(design, unknown, parameters).corrected(true)
    measured = Measurements(readings, seen(as_built, readings, "platform"), ALL, "platform", 1e-10)
    found = calibrate(design, measured, tolerances)
    assert_allclose(found.parameters, true, rtol=0, atol=1e-12)
    assert np.abs(found.before[0][:, 3:5]).max() > 1e-3  # it tilts [rad]
    path = tmp_path / "as_built.urdf"
    found.robot.write(path)
    again = p3dof.load_robot(path)
    assert_allclose(seen(again, readings, "platform"), measured.values, rtol=0, atol=1e-12)


@shows(
    "p3dof.loops.identification.calibration.calibration_table",
    "p3dof.loops.identification.calibration.Calibration.table",
)
def test_what_is_not_seen_stays_at_the_design_and_is_told():
    """A slide whose tool is further out, and whose encoder reads more: only the sum of both is seen."""
    robot = slide()
    measured = Measurements([[0.0], [0.1], [0.2]], [[0.51], [0.61], [0.71]], "x", "tool", 1e-6)
    found = calibrate(robot, measured, {"slide.offset": 0.01, "tool.x": 0.01})
    assert found.seen.unseen == ("slide.offset + tool.x",)
    assert found.seen.rank == 1
    # Of two normal parameters whose difference is known, the mean goes halfway, their deviation by √2.
    assert_allclose(found.parameters, [-0.005, 0.005], rtol=1e-7)
    assert_allclose(found.deviations, 0.01 / np.sqrt(2), rtol=1e-7)
    free = calibrate(robot, measured, {"slide.offset": np.inf, "tool.x": np.inf})
    assert_allclose(free.parameters, [-0.005, 0.005], rtol=1e-9)
    assert np.isinf(free.deviations).all()
    only = calibrate(robot, measured, {"slide.offset": np.inf})
    assert only.deviations == pytest.approx(1e-6 / np.sqrt(3))
    assert only.offsets == {"slide": pytest.approx(-0.01)}
    half = 10 / np.sqrt(2)
    rows = {"slide.offset [mm]": (-5, half, 10), "tool.x [mm]": (5, half, 10)}
    check_table(found.table(), rows, note=(1, 2, "slide.offset + tool.x"), rtol=1e-7)


SLIDE = """<robot name="slide"><link name="base"/><link name="car"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tool"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="car"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
<joint name="mount" type="fixed"><parent link="car"/><child link="tool"/><origin xyz="0.5 0 0"/></joint>
</robot>"""


def slide():
    return p3dof.load_robot(SLIDE, ())


def test_a_step_is_taken_however_little_the_sum_falls():
    """A design a millionth of a deviation from the best: what is left is 1e12 times what a step can gain."""
    rng = np.random.default_rng(8)
    A = rng.normal(size=(40, 3))
    best, noise = np.array([1e-6, -2e-6, 5e-7]), rng.normal(size=40)
    noise -= A @ np.linalg.lstsq(A, noise, rcond=None)[0]
    found = fit(lambda p: (A @ (p - best) + noise, A), np.ones(40), np.full(3, np.inf))
    assert_allclose(found.parameters, best, rtol=1e-8)


@shows("p3dof.loops.identification.fitting.Fit.residuals")
def test_the_fit_is_the_posterior_of_normal_distributions():
    """Linear numbers, by the formulas of the text book with plain inverses."""
    rng = np.random.default_rng(5)
    A, truth, tolerances, sigma = (
        rng.normal(size=(12, 4)),
        rng.normal(size=4),
        np.array([0.5, 2, 0.1, 1]),
        0.3,
    )
    measured = A @ truth + rng.normal(0, sigma, 12)
    found = fit(lambda p: (A @ p - measured, A), np.full(12, sigma), tolerances)
    precision = np.diag(tolerances**-2) + A.T @ A / sigma**2
    assert_allclose(found.parameters, np.linalg.solve(precision, A.T @ measured / sigma**2), rtol=1e-12)
    assert_allclose(found.covariance, np.linalg.inv(precision), rtol=1e-11, atol=1e-15)
    hat = A @ np.linalg.inv(precision) @ A.T / sigma**2
    left = (A @ found.parameters - measured) / sigma
    check_evidence(found, "residuals", left, rtol=1e-10)
    assert_allclose(found.tested, left / np.sqrt(1 - np.diag(hat)), rtol=1e-9)
    assert found.noise == pytest.approx(np.sqrt(left @ left / (12 - np.trace(hat))), rel=1e-9)


def test_outliers_are_told_and_left_out(delta):
    tolerances, combined = delta_parameters(delta)
    readings, positions = delta_poses(16)
    clean = positions + np.random.default_rng(6).normal(0, 1e-5, positions.shape)
    wrong = clean.copy()
    wrong[3, 2] += 3e-4  # thirty deviations
    wrong[11, 0] -= 1e-4
    expected = {(0, 3, "z"), (0, 11, "x")}
    told = calibrate(delta, Measurements(readings, wrong, XYZ, "tool", 1e-5), tolerances, combined)
    assert set(told.outliers) == expected
    assert told.outliers[0] == (0, 3, "z")
    assert not told.left_out
    assert told.noise > 3
    better = calibrate(
        delta, Measurements(readings, wrong, XYZ, "tool", 1e-5), tolerances, combined, leave_out=True
    )
    assert better.left_out
    assert better.noise < 1.3
    without = clean.copy()
    without[3, 2] = without[11, 0] = np.nan
    same = calibrate(delta, Measurements(readings, without, XYZ, "tool", 1e-5), tolerances, combined)
    assert_allclose(better.parameters, same.parameters, rtol=0, atol=1e-10)
    assert same.outliers == ()


def test_chosen_poses_are_the_best_of_all_sets():
    """Against every set of three of nine candidates, with and without tolerances."""
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(9, 2, 4)) * [1, 3, 0.2, 1]
    for tolerances in (np.array([1.0, 0.5, 2.0, 1.0]), np.full(4, np.inf)):
        prior = np.diag(np.where(np.isfinite(tolerances), tolerances, np.inf) ** -2.0)

        def information(some, prior=prior):
            flat = rows[list(some)].reshape(-1, 4)
            return prior + flat.T @ flat

        best = max(itertools.combinations(range(9), 3), key=lambda some: np.linalg.det(information(some)))
        found = chosen_poses(rows, tolerances, 3)
        assert tuple(found.poses) == best
        assert_allclose(found.deviations, np.sqrt(np.diag(np.linalg.inv(information(best)))), rtol=1e-9)


@pytest.mark.parametrize(
    ("count", "words"), [(1, "expected 2 poses or more for 4"), (10, "at most 9"), (0, "count: expected")]
)
def test_too_few_poses_are_refused(count, words):
    rows = np.random.default_rng(4).normal(size=(9, 2, 4))
    with pytest.raises(InputError, match=words):
        chosen_poses(rows, np.full(4, np.inf), count)


def test_observability_is_that_of_borm_and_menq():
    rows = np.random.default_rng(1).normal(size=(5, 2, 3))
    scaled = rows.reshape(10, 3) * [2.0, 3.0, 0.5]
    volume = np.sqrt(np.linalg.det(scaled.T @ scaled)) ** (1 / 3)
    assert observability(rows, np.array([2.0, 3.0, 0.5])) == pytest.approx(volume / np.sqrt(5), rel=1e-12)


@shows(
    "p3dof.loops.identification.calibration.plan_table",
    "p3dof.loops.identification.calibration.MeasurementPlan.table",
)
def test_a_plan_tells_the_deviations_that_the_calibration_has(delta):
    tolerances, combined = delta_parameters(delta)
    readings, positions = delta_poses(150, seed=9)
    plan = plan_measurements(
        delta, Measurements(readings, positions, XYZ, "tool", 1e-5), 8, tolerances, combined
    )
    assert plan.observability > 1.2 * plan.random
    rows = {
        f"{name} [mm]": (1e3 * sd, 1e3 * tolerance)
        for name, sd, tolerance in zip(plan.names, plan.deviations, plan.tolerances, strict=True)
    }
    check_table(plan.table(), rows, note=(plan.observability, plan.random))
    found = {}
    for name, some in (("plan", plan.poses), ("first", np.arange(8))):
        measured = Measurements(readings[some], positions[some], XYZ, "tool", 1e-5)
        found[name] = calibrate(delta, measured, tolerances, combined)
    # Deviations change with the derivatives: the geometry is off by a millesimal of lengths.
    assert_allclose(found["plan"].deviations, plan.deviations, rtol=0.05)
    assert (found["plan"].deviations < found["first"].deviations).all()


def test_candidates_are_found_where_few_readings_within_limits_are_poses():
    """A hexapod with limits of its legs far beyond its reach: of 80 random readings not one is a pose."""
    loop, told = gallery("stewart").copy(), []
    at = [loop.model.idx_qs[loop.model.getJointId(name)] for name in loop.actuated]
    home = loop.assemble().q
    loop.model.lowerPositionLimit, loop.model.upperPositionLimit = (
        np.where(np.isin(np.arange(loop.model.nq), at), home + way, limits)
        for way, limits in ((-3, loop.model.lowerPositionLimit), (3, loop.model.upperPositionLimit))
    )
    found = candidate_readings(loop, 4, progress=lambda *done: told.append(done))
    assert told == [(k, 4) for k in range(1, 5)]
    for reading in found:
        there = loop.assemble(reading, guess=home)
        assert there.same_assembly
        assert loop.beyond_limits(there.q) == {}
        assert loop.singularity_margins(there.q).actuation > 0.01
        assert np.abs(reading - home[at]).max() > 0.02


def test_loops_that_cannot_close_with_a_parameter_are_told():
    """The five-bar is planar: its closure holds the third direction too, twice."""
    robot = gallery("five_bar")
    measured = Measurements(readings_about(robot, 6, 0.05), np.zeros((6, 2)), ("x", "z"), "left_tip", 1e-5)
    with pytest.raises(
        InputError, match=r"cannot close with another left_elbow\.y: they are overconstrained"
    ):
        calibrate(robot, measured, {"left_elbow.y": 1e-3})


def wrong_cases():
    yield "fewer numbers", {"poses": slice(0, 2)}, "6 numbers fit exactly to 6 combinations"
    yield "all alike", {"readings": lambda x: x[:1].repeat(len(x), 0)}, "all poses are alike"
    yield "in mm", {"values": lambda x: 1000 * x}, r"x is 1e\+03 times what the robot does \(mm\?"
    yield "unknown", {"tolerances": {"tower_d.x": 1e-3}}, "there is no 'tower_d.x'"
    yield "nothing", {"tolerances": {}}, "tolerances: expected one parameter or more"
    yield "negative", {"tolerances": {"tower_a.x": -1.0}}, "'tower_a.x': expected a positive number"
    yield "frame", {"frame": "hand"}, "frame: the robot has no 'hand'"
    yield "component", {"components": ("x", "w")}, "components: expected some of x, y, z"
    yield "shape", {"components": ("x", "y")}, r"values: expected shape \(K, 2\), got \(10, 3\)"
    yield "sigma", {"sigma": 0.0}, "sigma: expected positive"
    yield "motors", {"readings": lambda x: x[:, :2]}, r"expected 3 columns \(tower_a, tower_b, tower_c\)"
    yield (
        "no length",
        {"tolerances": {"free.length": 1e-3}},
        r"free\.length: it is at the origin of the joint",
    )
    yield "combined", {"combined": {"rods": ["rod.length"]}}, "rods: there is no displacement 'rod.length'"


@pytest.mark.parametrize("case", list(wrong_cases()), ids=lambda case: case[0])
def test_bad_data_are_one_clear_line(delta, case):
    _, change, words = case
    tolerances, combined = delta_parameters(delta)
    readings, values = delta_poses(10)
    some = change.get("poses", slice(None))
    given = {name: change.get(name, lambda x: x) for name in ("readings", "values")}
    tolerances, combined = change.get("tolerances", tolerances), combined | change.get("combined", {})

    def attempt():
        numbers = given["readings"](readings[some]), given["values"](values[some])
        named = change.get("components", XYZ), change.get("frame", "tool")
        calibrate(delta, Measurements(*numbers, *named, change.get("sigma", 1e-5)), tolerances, combined)

    with pytest.raises(InputError, match=words):
        attempt()


def test_a_pose_that_does_not_assemble_is_named(delta):
    readings, values = delta_poses(5)
    readings[3] = [0.1, 0.9, 0.1]
    with pytest.raises(AssemblyError, match="pose 4 of 5: the loops do not close at the target"):
        calibrate(delta, Measurements(readings, values, XYZ, "tool", 1e-5), {"tower_?.offset": 1e-3})


def test_what_the_motors_do_not_determine_is_refused():
    robot = gallery("stewart")
    measured = Measurements(readings_about(robot, 8, 0.01), np.zeros((8, 1)), "x", "ball_1", 1e-5)
    assert calibrate(robot, Measurements(measured.readings, seen(robot, measured.readings, "ball_1")[:, :1],
                     "x", "ball_1", 1e-5), {"leg_1.offset": 1e-3}).noise < 1e-6  # fmt: skip
    loose = p3dof.load_robot(slide_on_slide(), {"closed_loop": [], "type": [], "name_mot": ["first"]})
    with pytest.raises(InputError, match="the motors do not determine x of 'tool'"):
        calibrate(loose, Measurements([[0.0], [0.1]], [0.0, 0.1], "x", "tool", 1e-5), {"first.offset": 1e-3})


def slide_on_slide():
    second = SLIDE.replace("slide", "first").replace(
        'name="mount" type="fixed"', 'name="second" type="prismatic"'
    )
    return second.replace('<origin xyz="0.5 0 0"/>', '<limit lower="-1" upper="1" effort="9" velocity="9"/>')


def test_more_motors_than_freedoms_are_refused():
    both = replace(gallery("four_bar").sidecar, actuated=("crank_joint", "rocker_joint"))
    robot = p3dof.loops.ClosedLoopModel(gallery("four_bar").model, both)
    measured = Measurements(np.zeros((3, 2)), np.zeros(3), "x", "coupler", 1e-5)
    with pytest.raises(InputError, match="2 motors for 1 freedoms"):
        calibrate(robot, measured, {"*.offset": 1e-3})


def test_combinations_are_told_in_words():
    rows = np.array([[1.0, -1.0, 0.0], [2.0, -2.0, 0.0], [0.0, 0.0, 3.0]])
    found = combinations_of(rows, ("a", "b", "c"))
    assert (found.rank, found.unseen) == (2, ("a + b",))
    assert_allclose(found.null_space, [[1, 1, 0]], atol=1e-14)


def test_rods_that_are_not_calibrated_keep_their_length(delta):
    first, *others = delta.sidecar.closures
    assert first.length is not None
    found = DisplacedRobot(delta, [f"{first.name}.length"], ()).corrected(np.array([1e-3])).sidecar.closures
    assert found[0].length == pytest.approx(first.length + 1e-3, rel=1e-15)
    assert list(found[1:]) == others


def test_parameters_that_are_told_in_combination_only_have_no_deviation_of_their_own():
    """Two columns that are the same, without tolerances: their sum is told, a third parameter by itself."""
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(2, 12, 1))
    rows = np.stack([one, one, other], axis=-1)
    found = chosen_poses(rows, np.full(3, np.inf), 6)
    assert np.isinf(found.deviations).tolist() == [True, True, False]
    chosen = np.column_stack([one[found.poses, 0], other[found.poses, 0]])
    assert found.deviations[2] == pytest.approx(np.sqrt(np.linalg.inv(chosen.T @ chosen)[1, 1]), rel=1e-10)
