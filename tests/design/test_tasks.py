"""Tasks: paths with blends, profiles, plans with payloads and loads, and the forces that they take."""

import jsonschema
import numpy as np
import pytest
import yaml
from command_line import run
from task_files import PICK_AND_PLACE, SCHEMA

import p3dof
from p3dof import Motion, Task, Waypoint
from p3dof._base.errors import InputError, ReachError, TaskError
from p3dof.design import fastest_plan, forces_of_task
from p3dof.design.tasks import PROFILES
from p3dof.design.tasks.files import dump, parse
from p3dof.machine import Body

VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
POINT = Body(2.0, np.array([0, 0, -0.04]), np.zeros((3, 3)))


@pytest.fixture(scope="module")
def task():
    return parse(PICK_AND_PLACE)


@pytest.fixture(scope="module")
def plan(task):
    return task.plan(2.0)


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


def over(points, **options):
    return Task([Waypoint(*point) if isinstance(point, tuple) else point for point in points], **options)


# --- paths --------------------------------------------------------------------------------------------------


def test_a_blended_path_has_the_published_length(task):
    """The length of the reference path "25/300/25" with blends of 25 mm, computed by others."""
    path = task.paths[1]
    fine = path.at(np.linspace(0, path.end, 40_001))[0]
    length = np.linalg.norm(np.diff(fine[:, :2], axis=0), axis=1).sum()
    assert length == pytest.approx(0.332129903, abs=1e-9)


@pytest.mark.parametrize("smoothness", [2, 3])
@pytest.mark.parametrize("angle", [True, False])
def test_derivatives_of_a_path_go_on_through_blends(smoothness, angle):
    third = [0.1] if angle else []
    task = over(
        [
            ([-0.1, 0, -0.2],),
            Waypoint([-0.1, 0.04, *third], blend=0.015),
            Waypoint([0.1, 0.05, *third], blend=0.02),
            ([0.1, 0, 0.3],),
        ],
        smoothness=smoothness,
    )
    path = task.paths[0]
    for corner in path.breaks[1:-1]:
        h = 1e-7
        before, after = path.at(np.array([corner - h])), path.at(np.array([corner + h]))
        for order in range(3):
            jump = np.abs(after[order] - before[order]).max()
            assert jump < 5e3 * h * 20**order
        h = 1e-5
        sides = [
            (path.at(np.array([corner + 2 * k * h]))[2] - path.at(np.array([corner + k * h]))[2]) / (k * h)
            for k in (-1, 1)
        ]
        jerk = np.abs(sides[1] - sides[0]).max()
        scale = np.abs(path.at(np.linspace(0, path.end, 999))[2]).max() / 0.01
        assert (jerk < 0.02 * scale) == (smoothness == 3)


def test_derivatives_of_a_path_are_those_of_its_poses(task):
    for path in (
        *task.paths,
        over([([0, 0, 0],), Waypoint([0.05, 0.02, 0.1], blend=0.01), ([0.1, 0, 0],)], path="spline").paths[0],
    ):
        h = 1e-4 * path.end
        inside = np.linspace(3 * h, path.end - 3 * h, 57)
        inside = inside[np.abs(inside[:, None] - path.breaks).min(axis=1) > 2 * h]
        _, first, second = path.at(inside)
        for order, found in ((0, first), (1, second)):
            values = [path.at(inside + k * h)[order] for k in (-2, -1, 1, 2)]
            expected = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
            np.testing.assert_allclose(found, expected, rtol=0, atol=2e-7 * np.abs(found).max() + 1e-9)


def test_a_spline_passes_its_waypoints():
    poses = np.array([[0, 0, 0], [0.03, 0.02, 0.1], [0.05, -0.02, 0.2], [0.1, 0, 0]])
    points = [Waypoint(pose, blend=0.01 if 0 < k < 3 else 0) for k, pose in enumerate(poses)]
    plan = Task(points, path="spline").plan(1.0)
    rows = np.searchsorted(plan.motion.time, plan.times)
    np.testing.assert_allclose(plan.motion.pose[rows], poses, rtol=0, atol=1e-12)


# --- profiles -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_goes_all_the_way_and_its_derivatives_are_right(name):
    profile = PROFILES[name]
    share, rate, change = profile(np.array([0.0, 1.0]))
    np.testing.assert_allclose(share, [0, 1], rtol=0, atol=1e-14)
    np.testing.assert_allclose([rate, change], 0, rtol=0, atol=1e-12)
    time = np.linspace(0.01, 0.99, 197)
    h = 1e-6
    for order in (0, 1):
        expected = (profile(time + h)[order] - profile(time - h)[order]) / (2 * h)
        np.testing.assert_allclose(profile(time)[order + 1], expected, rtol=0, atol=2e-4)
    assert (np.diff(profile(time)[0]) > 0).all()


def test_an_s_curve_has_a_jerk_of_one_height():
    time = np.linspace(0, 1, 7001)[1:-1]
    jerk = np.diff(PROFILES["s-curve"](time)[2]) / np.diff(time)
    heights = np.unique(np.round(jerk[np.abs(jerk - 7**3 / 8 * np.round(jerk / (7**3 / 8))) < 1e-6], 6))
    np.testing.assert_allclose(heights, [-(7**3) / 8, 0, 7**3 / 8], atol=1e-5)


# --- plans --------------------------------------------------------------------------------------------------


def test_a_way_without_anything_else_is_a_motion_from_rest_to_rest():
    start, end = [0, 0, 0.1], [0.05, -0.03, 0.2]
    found = over([(start,), (end,)]).plan(0.7, 301).motion
    expected = Motion.rest_to_rest(start, end, 0.7, 301)
    for name in ("time", "pose", "velocity", "acceleration"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0, atol=1e-13)


@pytest.mark.parametrize("profile", ["quintic", "septic", "s-curve"])
def test_peaks_are_seen_however_long_the_task_waits(robot, profile):
    def planned(dwell, samples):
        points = [
            Waypoint([-0.15, 0, -0.2], dwell=dwell),
            Waypoint([-0.15, 0.025], blend=0.02),
            Waypoint([0.15, 0.025], blend=0.008),
            Waypoint([0.15, 0, 0.2], duration=0.4, dwell=dwell),
            Waypoint([0, 0.04, 0], duration=0.15, dwell=dwell),
        ]
        return Task(points, profile=profile).plan(samples=samples)

    dense, limits = forces_of_task(robot, planned(0.0, 40_001)), robot.parameters.limits
    for wait in (0.05, 50.0, 5e5):
        plan = planned(wait, 1001)
        assert np.diff(plan.motion.time).min() > 1e-6
        for piece in plan.pieces:
            assert len(piece.motion.time) <= 22 if piece.dwells else len(piece.motion.time) > 140
        found = forces_of_task(robot, plan)
        np.testing.assert_allclose(found.peak_forces, dense.peak_forces, rtol=1e-3)
        for one, other in zip(found.utilisations(limits), dense.utilisations(limits), strict=True):
            assert abs(one.value) == pytest.approx(abs(other.value), rel=1e-3)  # it tilts as far either way


@pytest.mark.parametrize("dwell", [0.1, 0.3, 0.7, 1 / 3, 1.1])
def test_no_two_samples_are_one_but_for_rounding(robot, dwell):
    """Ends of waits and of blends, nodes of the fastest law, and even samples fall on each other."""
    points = [
        Waypoint([0, 0, 0], dwell=dwell),
        Waypoint([0.1, 0, 0], blend=0.05),
        Waypoint([0.1, 0.1, 0], blend=0.05),
        Waypoint([0, 0.1, 0], dwell=dwell),
        Waypoint([0, 0, 0], dwell=dwell, duration=dwell),
    ]
    task = Task(points)
    for plan in (task.plan(4 * dwell + 0.8, 501), fastest_plan(robot, task, nodes=50, samples=501)):
        assert np.diff(plan.motion.time).min() > 1e-9
        for time in plan.times:
            assert time in plan.motion.time


def test_velocity_and_acceleration_belong_to_the_poses(task):
    for smoothness, profile in ((2, "quintic"), (3, "septic"), (2, "s-curve")):
        motion = Task(task.waypoints, smoothness=smoothness, profile=profile).plan(2.0, 20_001).motion
        for value, slope in ((motion.pose, motion.velocity), (motion.velocity, motion.acceleration)):
            step = np.diff(motion.time)[:, None]
            whole = np.cumsum(step * (slope[1:] + slope[:-1]) / 2, axis=0)
            np.testing.assert_allclose(value[1:] - value[0], whole, rtol=0, atol=2e-5)


def test_time_is_shared_out_to_equal_accelerations(task, plan):
    peaks = []
    for first, last in ((0, 1), (2, 5), (6, 7)):
        rows = np.concatenate([piece.motion.acceleration for piece in plan.pieces[first:last]])
        peaks.append(np.linalg.norm(rows * [1, 1, task.turning_length], axis=1).max())
    np.testing.assert_allclose(peaks, peaks[0], rtol=1e-3)
    assert plan.duration == pytest.approx(2.0, abs=1e-14)
    assert plan.times[4] - plan.times[1] > 0.2


def test_given_durations_are_kept():
    task = over([([0, 0, 0],), ([0.05, 0, 0], "a", 0.0, 0.1, 0.3), ([0, 0.02, 0], "b", 0.0, 0.0, 0.4)])
    plan = task.plan()
    np.testing.assert_allclose(plan.times, [0, 0.3, 0.8], rtol=0, atol=1e-15)
    assert plan.duration == pytest.approx(0.8)
    np.testing.assert_array_equal(task.plan(0.8).motion.pose, plan.motion.pose)


def test_names_times_payloads_and_loads_of_the_pieces(plan):
    assert [piece.name for piece in plan.pieces] == [
        "home → pick",
        "at pick",
        "pick → up",
        "up → over",
        "over → place",
        "at place",
        "place → end",
    ]
    assert [piece.payload is not None for piece in plan.pieces] == [
        False,
        True,
        True,
        True,
        True,
        True,
        False,
    ]
    assert [bool(piece.wrench.any()) for piece in plan.pieces] == [False] * 6 + [True]
    for former, latter in zip(plan.pieces[:-1], plan.pieces[1:], strict=True):
        assert former.motion.time[-1] == latter.motion.time[0]
        np.testing.assert_array_equal(former.motion.pose[-1], latter.motion.pose[0])
    history = plan.wrench
    np.testing.assert_array_equal(history([1.0, 1.9]), [[0] * 6, [0, 10, -50, 0, 0, 0]])


def test_what_is_exchanged_is_carried_from_the_beginning_of_the_dwell():
    other = Body(1.0, np.zeros(3), np.zeros((3, 3)))
    stop = Waypoint([0.05, 0, 0], dwell=0.1, pick_up=other, put_down=True)
    plan = over([([0, 0, 0],), stop, ([0, 0, 0],)], carrying=POINT).plan(1.0)
    assert [piece.payload for piece in plan.pieces] == [POINT, other, other]


# --- forces -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["virtual-power", "pinocchio"])
def test_forces_are_those_of_the_machine_with_what_it_carries(robot, method):
    task = over(
        [
            ([0, 0, 0],),
            Waypoint([-0.1, 0, -0.2], "pick", dwell=0.1, pick_up=POINT),
            Waypoint([0.1, 0.02, 0.2], "place", put_down=True, wrench=[0, 5, -20, 0, 1, 0]),
            ([0, 0, 0],),
        ]
    )
    plan = task.plan(1.5, 61)
    found = forces_of_task(robot, plan, method)
    laden = p3dof.load(robot.parameters.carrying(POINT))
    at_rest = laden.forces([-0.1, 0, -0.2], np.zeros(3), np.zeros(3))
    dwell = found.results[1].forces
    np.testing.assert_allclose(dwell, np.tile(at_rest, (len(dwell), 1)), rtol=0, atol=1e-9)
    motion = plan.pieces[2].motion
    expected = laden.forces(
        motion.pose, motion.velocity, motion.acceleration, wrench=np.array([0, 5, -20, 0, 1, 0])
    )
    np.testing.assert_allclose(found.results[2].forces, expected, rtol=0, atol=1e-9)
    assert found.peak_forces == pytest.approx(np.abs(found.forces).max(axis=0))


def test_the_drives_do_no_work_over_a_task_that_ends_where_it_began(robot):
    task = over([([0, 0, 0],), Waypoint([0.1, 0.05, 0.3], dwell=0.1), ([-0.1, 0, 0],), ([0, 0, 0],)])
    assert task.closed
    found = forces_of_task(robot, task.plan(1.0, 2001))
    assert abs(np.trapezoid(found.power, found.time)) < 1e-9 * np.abs(found.power).max()


def test_a_step_of_load_is_a_step_of_force(robot, plan):
    """What would be lost if the pieces were one motion with one payload."""
    found = forces_of_task(robot, plan)
    last, first = found.results[0].forces[-1], found.results[1].forces[0]
    still = np.array([-0.15, 0, np.radians(-15)]), np.zeros(3), np.zeros(3)
    weight = p3dof.load(robot.parameters.carrying(POINT)).forces(*still) - robot.forces(*still)
    np.testing.assert_allclose(first - last, weight, rtol=0, atol=1e-9)
    assert np.abs(weight).max() > 10


def test_out_of_reach_is_an_error_of_the_machine(robot):
    with pytest.raises(ReachError, match=r"^waypoint 1 → waypoint 2: pose \(y = "):
        forces_of_task(robot, over([([0, 0, 0],), ([0.5, 0, 0],)]).plan(1.0))


# --- files --------------------------------------------------------------------------------------------------


def test_a_task_file_reads_back_to_the_same_numbers(task, tmp_path):
    p3dof.write_task(task, tmp_path / "task.yaml")
    again = p3dof.read_task(tmp_path / "task.yaml")
    assert dump(again) == dump(task)
    np.testing.assert_array_equal(again.plan(2.0).motion.pose, task.plan(2.0).motion.pose)
    VALIDATOR.validate(yaml.safe_load((tmp_path / "task.yaml").read_text(encoding="utf-8")))


def test_limits_of_a_file_are_one_number_or_three():
    text = """
limits: {force: 0.3 kN, speed: 1500 mm/s, power: 1 kW, jerk: [500, 600, 700 m/s^3], reflected_mass: 900 g}
waypoints: [{pose: [0, 0, 0]}, {pose: [0.1, 0, 0]}]
"""
    VALIDATOR.validate(yaml.safe_load(text))
    found = parse(text)
    assert dict(found.limits) == {
        "force": 300.0,
        "speed": 1.5,
        "power": 1000.0,
        "jerk": (500.0, 600.0, 700.0),
        "reflected_mass": 0.9,
    }
    assert dict(parse(dump(found)).limits) == dict(found.limits)
    VALIDATOR.validate(yaml.safe_load(dump(found)))


def test_the_schema_takes_the_example():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    VALIDATOR.validate(yaml.safe_load(PICK_AND_PLACE))


WAYPOINTS = [{"pose": [0, 0, 0]}, {"pose": [0.1, 0, 0]}]
BAD_FILES = {
    "expected the fields waypoints, name, path": [],
    "the field 'waypoints' is missing": {},
    "waypoints: expected a list, got a dict": {"waypoints": {"pose": [0, 0, 0]}},
    "unknown field 'speed'": {"waypoints": WAYPOINTS, "speed": 1},
    "waypoint 2: unknown field 'dwel'": {"waypoints": [WAYPOINTS[0], {"pose": [0, 0, 1], "dwel": 1}]},
    "waypoint 1: the field 'pose' is missing": {"waypoints": [{}, WAYPOINTS[1]]},
    "waypoint 1: pose[0]: expected a length": {"waypoints": [{"pose": ["5 deg", 0, 0]}, WAYPOINTS[1]]},
    "waypoint 1: pose: expected at most 3 numbers": {"waypoints": [{"pose": [0, 0, 0, 0]}, WAYPOINTS[1]]},
    "waypoint 2: dwell: expected a time": {"waypoints": [WAYPOINTS[0], {"pose": [0, 0, 1], "dwell": "5 mm"}]},
    "waypoint 2: dwell: expected zero or more": {
        "waypoints": [WAYPOINTS[0], {"pose": [0, 0, 1], "dwell": -1}]
    },
    "path: expected one of straight, spline": {"waypoints": WAYPOINTS, "path": "curved"},
    "profile: expected one of quintic": {"waypoints": WAYPOINTS, "profile": "trapezoid"},
    "smoothness: expected 2 or 3": {"waypoints": WAYPOINTS, "smoothness": 4},
    "turning_length: expected": {"waypoints": WAYPOINTS, "turning_length": 0},
    "carrying: the field 'mass' is missing": {"waypoints": WAYPOINTS, "carrying": {"com": [0, 0, 0]}},
    "carrying: expected a mass": {"waypoints": WAYPOINTS, "carrying": "2 mm"},
    "waypoints: expected from 2 to 1000, got 1": {"waypoints": WAYPOINTS[:1]},
    "put_down: expected true or false": {"waypoints": [WAYPOINTS[0], {"pose": [0, 0, 1], "put_down": 1}]},
    "wrench: expected shape (6,)": {"waypoints": [WAYPOINTS[0], {"pose": [0, 0, 1], "wrench": [1, 2]}]},
    "name: expected a text": {"waypoints": WAYPOINTS, "name": 5},
    "limits: jerk: expected above zero, got 0": {"waypoints": WAYPOINTS, "limits": {"jerk": 0}},
    "limits: jerk: expected above zero, got -5": {"waypoints": WAYPOINTS, "limits": {"jerk": [1, -5, 2]}},
    "limits: jerk: expected a jerk": {"waypoints": WAYPOINTS, "limits": {"jerk": "5 m/s^2"}},
    "limits: jerk: expected a number, or those of A, B and C": {
        "waypoints": WAYPOINTS,
        "limits": {"jerk": [1, 2]},
    },
    "limits: unknown field 'snap'": {"waypoints": WAYPOINTS, "limits": {"snap": 1}},
    "limits: reflected_mass: expected zero or more": {
        "waypoints": WAYPOINTS,
        "limits": {"reflected_mass": "-1 kg"},
    },
}


@pytest.mark.parametrize(("words", "data"), BAD_FILES.items())
def test_a_bad_file_is_one_clear_error_and_fails_the_schema(words, data):
    with pytest.raises(TaskError, match=r"\A[^\n]*\Z") as found:
        parse(yaml.safe_dump(data), "task.yaml")
    assert str(found.value).startswith("task.yaml: ")
    assert words in str(found.value)
    assert not VALIDATOR.is_valid(data)


def test_a_named_waypoint_is_told_once():
    data = {"waypoints": [WAYPOINTS[0], {"pose": [0.1, 0, 0], "name": "place", "put_down": 1}]}
    with pytest.raises(TaskError) as found:
        parse(yaml.safe_dump(data), "task.yaml")
    assert str(found.value) == "task.yaml: waypoint 2 (place): put_down: expected true or false, got 1"


BAD_TASKS = {
    "expected a stop at the beginning": lambda: over([Waypoint([0, 0, 0], blend=0.01), ([0.1, 0, 0],)]),
    "expected two different poses": lambda: over([([0, 0, 0],), ([0, 0, 0],)]),
    "overlap: they are 0.1 m apart": lambda: over(
        [([0, 0, 0],), Waypoint([0.1, 0, 0], blend=0.06), Waypoint([0.2, 0, 0], blend=0.06), ([0.3, 0, 0],)]
    ),
    "at all waypoints between two stops, or at none": lambda: over(
        [([0, 0, 0],), Waypoint([0.1, 0], blend=0.01), Waypoint([0.2, 0, 0], blend=0.01), ([0.3, 0, 0],)]
    ),
    "pick_up: expected at a stop only": lambda: Waypoint([0.1, 0], blend=0.01, pick_up=POINT),
    "expected y, z, θ at a stop": lambda: Waypoint([0.1, 0]),
    "put_down: the platform carries nothing": lambda: over(
        [([0, 0, 0],), Waypoint([0.1, 0, 0], put_down=True)]
    ),
    "carries something already": lambda: over(
        [([0, 0, 0],), Waypoint([0.1, 0, 0], pick_up=POINT)], carrying=POINT
    ),
    "nothing is before the first": lambda: over([Waypoint([0, 0, 0], duration=1.0), ([0.1, 0, 0],)]),
    "pose: expected finite": lambda: Waypoint([np.nan, 0, 0]),
    "waypoints: expected Waypoint objects": lambda: Task([[0, 0, 0], [0, 0, 1]]),
    "duration: expected that of the whole task": lambda: over([([0, 0, 0],), ([0.1, 0, 0],)]).plan(),
    "duration: expected more than the 1 s": lambda: over(
        [Waypoint([0, 0, 0], dwell=1.0), ([0.1, 0, 0],)]
    ).plan(0.5),
    "duration: expected 2 s, which the waypoints add up to": lambda: over(
        [([0, 0, 0],), Waypoint([0.1, 0, 0], duration=2.0)]
    ).plan(1.0),
}


@pytest.mark.parametrize(("words", "make"), BAD_TASKS.items())
def test_a_task_that_does_not_fit_is_one_clear_error(words, make):
    with pytest.raises(TaskError, match=r"\A[^\n]*\Z") as found:
        make()
    assert words in str(found.value)


@pytest.mark.parametrize("bad", [(None, "plan"), ("robot", None)])
def test_forces_of_something_else_are_refused(robot, plan, bad):
    given = {"robot": robot, "plan": plan}
    with pytest.raises(InputError, match="expected"):
        forces_of_task(*(given.get(name) for name in bad))


# --- the command --------------------------------------------------------------------------------------------


def test_the_command_writes_what_other_commands_read(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    files = "--out motion.csv --wrench-out wrench.csv --forces-out forces.csv --figure task.png"
    code, out, _ = run(capsys, "plan", "task.yaml", "--duration", 2, *files.split())
    assert code == 0
    assert "pick → up" in out
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "forces.csv",
        "motion.csv",
        "task.png",
        "task.yaml",
        "wrench.csv",
    ]
    code, out, _ = run(
        capsys, "forces", "--method", "compiled", "--motion", "motion.csv", "--wrench", "wrench.csv"
    )
    assert code == 0


def test_the_command_says_when_a_limit_is_exceeded(capsys, tmp_path):
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    code, out, _ = run(capsys, "plan", tmp_path / "task.yaml", "--duration", 0.8)
    assert code == 1
    assert "force A" in out


def test_a_load_that_is_not_there_is_told_before_the_plan(capsys, tmp_path):
    lines = [line for line in PICK_AND_PLACE.splitlines() if "wrench" not in line]
    (tmp_path / "task.yaml").write_text("\n".join(lines), encoding="utf-8")
    code, _, err = run(capsys, "plan", tmp_path / "task.yaml", "--wrench-out", tmp_path / "w.csv")
    assert code == 2
    assert "--wrench-out: there is no external load in this task" in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("", "duration: expected that of the whole task, since pick has none"),
        ("--duration 2 --wrench-out w.txt", "expected a file name that ends in .csv"),
        ("--duration -1", "--duration"),
        ("--duration 2 --out task.yaml", "task.yaml"),
    ],
)
def test_bad_use_of_the_command_is_one_line(capsys, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    code, _, err = run(capsys, "plan", "task.yaml", *options.split())
    assert code == 2
    assert words in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["task.yaml"]


def test_a_mass_alone_is_picked_up():
    text = (
        "carrying: 100 g\nwaypoints: [{pose: [0, 0, 0], put_down: true}, {pose: [.1, 0, 0], pick_up: 2 kg}]"
    )
    task = parse(text)
    assert task.carrying.to_dict() == Body(0.1).to_dict()
    assert task.waypoints[1].pick_up.to_dict() == Body(2, [0, 0, 0], [0, 0, 0]).to_dict()
    ends = [Waypoint([0, 0, 0], put_down=True), Waypoint([0.1, 0, 0], pick_up=2)]
    assert dump(Task(ends, carrying="100 g")) == dump(task)
    for wrong in (True, "2 mm", [2]):
        with pytest.raises(TaskError, match=r"^pick_up: expected a"):
            Waypoint([0, 0, 0], pick_up=wrong)
        with pytest.raises(TaskError, match=r"^carrying: expected a"):
            Task(ends, carrying=wrong)
