"""Designs that do tasks: what drives take, and choices of motors and screws against every combination."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from table_numbers import check_table, shows

import p3dof
from p3dof.cli import main
from p3dof.design import DesignProblem
from p3dof.design.bearings import Bearing, Bearings, bearing_life
from p3dof.design.drives import Ambient, Catalogue, Drive, Margins, Motor, Screw
from p3dof.design.forces_of_tasks import reactions_of_task
from p3dof.design.optimisation import Duty, optimum_tables
from p3dof.design.optimisation.task_measures import Discrete
from p3dof.design.tasks import Task, Waypoint

RPM = np.pi / 30


def task(mass: float = 3.0) -> Task:
    carried = p3dof.machine.Body(mass, [0, 0, -0.04], [0.0, 0.0, 0.0])
    return Task(
        [
            Waypoint([0, 0, 0], "home"),
            Waypoint([-0.15, 0, np.radians(-15)], "pick", dwell=0.2, pick_up=carried),
            Waypoint([-0.15, 0.025], "up", blend=0.025),
            Waypoint([0.15, 0.025], "over", blend=0.025),
            Waypoint([0.15, 0, np.radians(15)], "place", dwell=0.2, put_down=True),
            Waypoint([0, 0, 0], "back"),
        ],
        "pick and place",
    )


MOTORS = (
    Motor(0.32, 0.95, 6000 * RPM, 5e-6, 3000 * RPM, brake_torque=0.3, name="M100", cost=100.0, mass=0.5),
    Motor(0.64, 1.9, 6000 * RPM, 2.5e-5, 3000 * RPM, brake_torque=0.7, name="M200", cost=140.0, mass=0.9),
    Motor(1.3, 3.8, 5000 * RPM, 3e-5, 3000 * RPM, brake_torque=1.4, name="M400", cost=200.0, mass=1.4),
)
SCREWS = (
    Screw(0.005, 0.88, diameter=0.0127, length=0.5, name="16x5", cost=60.0, mass=1.0),
    Screw(0.010, diameter=0.0127, length=0.5, name="16x10", cost=70.0, mass=1.0),
    Screw(0.016, diameter=0.0127, length=0.5, name="16x16", cost=85.0, mass=1.0),
)
CATALOGUE = Catalogue(MOTORS, SCREWS)
DUTY = Duty(task(), 2.0)
CHOICES: dict[str, Any] = {"motor": "all", "screw": "all"}


def problem(variables: Any = None, objectives: Any = "worst_utilisation", **given: Any) -> DesignProblem:
    arguments = {"tasks": DUTY, "drives": CATALOGUE} | given
    return DesignProblem(variables or CHOICES, objectives=objectives, **arguments)


def sized(motor: Motor, screw: Screw, machine: Any = None, of: Duty = DUTY) -> Any:
    robot = p3dof.Manipulator(machine or p3dof.PAPER)
    (found,) = p3dof.size_drives(
        robot, p3dof.design.forces_of_task(robot, of.plan), Drive(motor, screw), frictionless=True
    )
    return found


def test_measures_of_drives_are_those_of_size_drives_and_forces_those_of_the_task() -> None:
    names = ["rms_torque", "worst_utilisation", "cost", "drive_mass", "peak_force", "rms_force", "energy"]
    asked = problem(objectives=names)
    for i, j in product(range(3), range(3)):
        found, drives = asked.choosing((i, j)).evaluate(np.zeros((1, 0))), sized(MOTORS[i], SCREWS[j])
        assert found["rms_torque"][0] == pytest.approx(max(a.rms_torque for a in drives.axes), rel=1e-13)
        worst = max(r.required / r.limit for axis in drives.axes for r in axis.ratings)
        assert found["worst_utilisation"][0] == pytest.approx(worst, rel=1e-13)
        assert found["cost"][0] == 3 * (float(MOTORS[i].cost or 0) + float(SCREWS[j].cost or 0))
        assert found["drive_mass"][0] == pytest.approx(3 * (float(MOTORS[i].mass or 0) + 1.0), rel=1e-15)
    forces = p3dof.design.forces_of_task(p3dof.load(), DUTY.plan, method="pinocchio")
    assert found["peak_force"][0] == pytest.approx(forces.peak_forces.max(), rel=1e-12)
    assert found["rms_force"][0] == pytest.approx(forces.rms_forces.max(), rel=1e-12)
    work = sum(
        np.trapezoid(np.maximum(r.forces * r.slider_velocities, 0), r.time, axis=0).sum()
        for r in forces.results
    )
    assert found["energy"][0] == pytest.approx(work, rel=1e-3)  # trapezoids against polynomials


@pytest.mark.parametrize(
    ("objective", "constraints"),
    [
        ("worst_utilisation", {}),
        ("rms_torque", {"worst_utilisation": {"max": 0.9}}),
        ("cost", {"worst_utilisation": {"max": 1.0}}),
        ("cost", {"worst_utilisation": {"max": 0.75}}),
        ("drive_mass", {"rms_torque": {"max": 0.4}, "worst_utilisation": {"max": 1.0}}),
    ],
)
def test_the_best_combination_is_that_of_all_of_them(objective: str, constraints: Any) -> None:
    optimum = problem(objectives=objective, constraints=constraints).minimise()
    table = []
    for motor, screw in product(MOTORS, SCREWS):
        drives = sized(motor, screw)
        numbers = {
            "worst_utilisation": max(r.required / r.limit for a in drives.axes for r in a.ratings),
            "rms_torque": max(axis.rms_torque for axis in drives.axes),
            "cost": 3 * (float(motor.cost or 0) + float(screw.cost or 0)),
            "drive_mass": 3 * (float(motor.mass or 0) + float(screw.mass or 0)),
        }
        if all(numbers[name] <= bounds["max"] for name, bounds in constraints.items()):
            table.append((numbers[objective], {"motor": motor.name, "screw": screw.name}))
    best = min(table, key=lambda one: one[0])
    assert optimum.value == pytest.approx(best[0], rel=1e-12)
    assert optimum.problem.choice in [choice for value, choice in table if value <= best[0] * (1 + 1e-12)]
    assert len(optimum.combinations) == 9
    assert any(one.pruned and one.reason for one in optimum.combinations)
    assert optimum.check.difference < 1e-11 * optimum.check.largest
    assert optimum.check.violation == 0


def test_a_counterbalance_with_a_motor_is_the_best_of_a_fine_grid_for_each() -> None:
    variables = {**CHOICES, "screw": ["16x10", "16x16"], "counterbalance": (-20.0, 120.0)}
    optimum = problem(variables, "rms_torque", constraints={"worst_utilisation": {"max": 1.0}}).minimise(
        starts=2
    )

    def torque(motor: Motor, screw: Screw, force: float) -> float:
        sides = dict.fromkeys(("slide_a", "slide_b", "slide_c"), force)
        machine = replace(p3dof.PAPER, actuators=p3dof.machine.Actuators(counterbalance=sides))
        drives = sized(motor, screw, machine)
        return max(axis.rms_torque for axis in drives.axes) if drives.fits else np.inf

    rows = [
        (torque(motor, screw, force), motor.name, screw.name)
        for motor, screw in product(MOTORS, SCREWS[1:])
        for force in np.linspace(-20, 120, 15)
    ]
    least = min(rows)
    assert optimum.value <= least[0] * (1 + 1e-9)
    assert list(optimum.problem.choice.values()) == list(least[1:])
    motor, screw = (
        next(p for p in parts if p.name == n) for parts, n in zip((MOTORS, SCREWS), least[1:], strict=True)
    )
    assert torque(motor, screw, float(optimum.design[0])) == pytest.approx(optimum.value, rel=1e-12)


def test_gradients_of_tasks_are_those_of_differences() -> None:
    variables = {"R": (0.22, 0.3), "platform.mass": (4.0, 12.0), "lead": (0.006, 0.02)}
    names = [
        "peak_force",
        "rms_force",
        "energy",
        "rms_power",
        "rms_torque",
        "worst_utilisation",
        "peak_speed",
    ]
    drives = Drive(MOTORS[2], SCREWS[1])
    two = [DUTY, Duty(task(1.0), 2.5, weight=3)]
    asked = [problem(variables, names, drives=drives, together=way, tasks=two) for way in ("worst", "mean")]
    design, steps = np.array([0.26, 7.0, 0.012]), np.array([1e-6, 1e-4, 1e-7])
    moved = np.concatenate([[design + s * h for s in (1, -1)] for h in np.diag(steps)])
    for one in asked:
        gradient, found = one.gradient(design), one.evaluate(moved)
        for name in names:
            ours = (found[name][::2] - found[name][1::2]) / (2 * steps)
            assert gradient[name] * steps == pytest.approx(ours * steps, rel=1e-4, abs=1e-12), name
    worst, mean = (one.evaluate(design) for one in asked)
    both = (DUTY, Duty(task(1.0), 2.5))
    each = [problem(variables, names, drives=drives, tasks=t).evaluate(design) for t in both]
    for name in names:
        values = [found[name][0] for found in each]
        assert worst[name][0] == max(values)
        assert mean[name][0] == pytest.approx((values[0] + 3 * values[1]) / 4, rel=1e-14)


def test_life_and_fastest_time_are_those_of_the_functions() -> None:
    few = Duty(task(), 2.0, samples=15)
    bearings = Bearings(Bearing(5100.0, 2400.0))
    asked = DesignProblem({"R": (0.2, 0.3)}, objectives=["life"], tasks=few, bearings=bearings)
    robot = p3dof.load()
    report = bearing_life(robot.parameters, reactions_of_task(robot, few.plan), bearings)
    assert asked.evaluate([0.25])["life"][0] == pytest.approx(
        min(b.hours for b in report.bearings), rel=1e-12
    )
    short = Task([Waypoint([0, 0, 0]), Waypoint([0.05, 0.01, 0])])
    asked = DesignProblem({"R": (0.2, 0.3)}, objectives=["fastest_time"], tasks=Duty(short, 1.0))
    time = p3dof.design.fastest_plan(robot, short).duration
    assert asked.evaluate([0.25])["fastest_time"][0] == pytest.approx(time, rel=1e-12)


MADE = Screw(0.010, diameter=0.0127, length=0.5, name="16x10", dynamic=9000.0, preload=450.0)


def test_choices_keep_margins_surroundings_and_required_life_of_the_catalogue() -> None:
    """As `size_drives` has them: a bound of 1 is what fits."""
    hot, margins = Ambient(50.0, 2200.0), Margins(peak_torque=0.3, speed=0.05)
    catalogue = Catalogue(MOTORS, [MADE], margins=margins, ambient=hot, life="60000 h")
    asked = problem({"motor": "all"}, ["worst_utilisation", "life"], drives=catalogue)
    forces = p3dof.design.forces_of_task(p3dof.load(), DUTY.plan)
    sizings = p3dof.size_drives(p3dof.load(), forces, catalogue, frictionless=True)
    by_motor = {sizing.drives[0].motor.name: sizing for sizing in sizings}
    for k, motor in enumerate(MOTORS):
        found, sizing = asked.choosing((k,)).evaluate(np.zeros((1, 0))), by_motor[motor.name]
        ratings = [r for axis in sizing.axes for r in axis.ratings]
        assert "life" in [r.name for r in ratings]
        worst = max(r.required / (r.allowed * (1 - r.margin)) for r in ratings)
        assert found["worst_utilisation"][0] == pytest.approx(worst, rel=1e-13)
        assert (found["worst_utilisation"][0] <= 1) == sizing.fits
        hours = min(axis.nut.hours for axis in sizing.axes if axis.nut is not None)
        assert found["life"][0] == pytest.approx(hours, rel=1e-13)
    warm = replace(MOTORS[1], inertia=2e-3, peak_torque=50.0, brake_torque=9.0)  # its heat decides
    free = Margins(peak_torque=0.0)
    asked_of = [Catalogue([warm], [SCREWS[1]], margins=free, ambient=where) for where in (Ambient(), hot)]
    used = [problem({"R": (0.2, 0.3)}, drives=one).evaluate([0.25]) for one in asked_of]
    cool, heated = (one["worst_utilisation"][0] for one in used)
    assert heated / cool == pytest.approx(1 / 0.883176, rel=1e-5)  # as published for a maker's motors


def test_the_least_life_is_that_of_nuts_and_bearings_together() -> None:
    few = Duty(task(), 2.0, samples=15)
    bearings = Bearings(Bearing(5100.0, 2400.0))
    drives = Drive(MOTORS[2], MADE)
    nuts, both, alone = (
        DesignProblem({"R": (0.2, 0.3)}, objectives=["life"], tasks=few, **given).evaluate([0.25])["life"][0]
        for given in ({"drives": drives}, {"drives": drives, "bearings": bearings}, {"bearings": bearings})
    )
    assert both == min(nuts, alone)
    assert nuts != alone


CHANGES: dict[str, Any] = {
    "rest": lambda d: replace(d, rest=0.5),
    "weight": lambda d: replace(d, weight=2.0),
    "samples": lambda d: replace(d, samples=202),
    "duration": lambda d: replace(d, duration=2.0 + 1e-12),
    "pose": lambda d: replace(d, task=pointed(d.task, 2, pose=np.array(d.task.waypoints[2].pose) + 1e-15)),
    "dwell": lambda d: replace(d, task=pointed(d.task, 1, dwell=0.2 + 1e-15)),
    "payload": lambda d: replace(d, task=task(3.0 + 1e-15)),
    "blend": lambda d: replace(d, task=pointed(d.task, 2, blend=0.025 - 1e-15)),
    "name": lambda d: replace(d, task=replace(d.task, name="other")),
    "profile": lambda d: replace(d, task=replace(d.task, profile="septic")),
    "turning length": lambda d: replace(
        d, task=replace(d.task, turning_length=d.task.turning_length + 1e-15)
    ),
}


def pointed(of: Task, index: int, **changes: Any) -> Task:
    points = list(of.waypoints)
    points[index] = replace(points[index], **changes)
    return replace(of, waypoints=points)


@pytest.mark.parametrize("what", CHANGES)
def test_tasks_that_differ_anywhere_have_other_settings(what: str) -> None:
    before, after = (problem(tasks=one).settings()["duties"]["tasks"] for one in (DUTY, CHANGES[what](DUTY)))
    assert json.loads(json.dumps(before)) == before
    assert before != after


def test_parts_that_differ_anywhere_have_other_settings() -> None:
    """Of the catalogue only the first motor and screw counted: others could go on with what was stored."""
    known = problem().settings()
    for catalogue in (
        Catalogue([*MOTORS[:2], replace(MOTORS[2], peak_torque=3.8 + 1e-15)], SCREWS),
        Catalogue(MOTORS, [*SCREWS[:2], replace(SCREWS[2], cost=85.5)]),
        Catalogue(MOTORS, SCREWS, margins=Margins(speed=0.1)),
        Catalogue(MOTORS, SCREWS, ambient=Ambient(41.0)),
        Catalogue(MOTORS, SCREWS, life="1000 h"),
    ):
        assert problem(drives=catalogue).settings() != known
    assert problem({**CHOICES, "motor": ["M100", "M200"]}).settings() != known
    assert problem(drives=Catalogue(MOTORS, SCREWS)).settings() == known
    bearings = [Bearings(Bearing(5100.0, load)) for load in (2400.0, 2400.0 + 1e-12)]
    told = [problem(bearings=each).settings() for each in bearings]
    assert told[0] != told[1]


BAD = [
    ({"tasks": ()}, "drives: expected tasks beside them"),
    ({"motion": p3dof.paper_motion(11)}, "tasks: expected no motion"),
    ({"variables": {"motor": ["M1"], "screw": "all"}}, "the catalogue has no 'M1'"),
    ({"variables": {"motor": [], "screw": "all"}}, "expected 'all' or a list of names"),
    ({"variables": {"motor": ["M100", "M100"], "screw": "all"}}, "a name is there twice"),
    ({"variables": {"motor": "all"}}, "no variable 'screw'"),
    ({"variables": {**CHOICES, "R": {"one_of": []}}}, "expected bounds or"),
    ({"variables": {**CHOICES, "R": {"one_of": ["1 kg"]}}}, "expected a length"),
    ({"variables": {**CHOICES, "payload.mass": (0.0, 1.0)}}, "can be no column besides"),
    ({"together": "sum"}, "together: expected 'worst' or 'mean'"),
    ({"objectives": "life"}, "life: needs bearings"),
    ({"drives": None, "variables": {"R": (0.2, 0.3)}}, "drives: measures of drives need some"),
    ({"drives": "M100"}, "drives: expected a Catalogue or a Drive"),
    ({"tasks": 3}, "tasks: expected a Task, a Duty"),
]


@pytest.mark.parametrize(("changes", "message"), BAD)
def test_what_does_not_fit_is_told(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(p3dof.P3dofError, match=re.escape(message)):
        problem(**changes)


def test_parts_without_a_cost_and_combinations_that_all_fail_are_told() -> None:
    bare = Catalogue([replace(MOTORS[0], cost=None)], SCREWS)
    with pytest.raises(p3dof.InputError, match="cost: M100 has no cost in the catalogue"):
        problem({"screw": "all"}, "cost", drives=bare)
    with pytest.raises(p3dof.P3dofError, match="none of 9 combinations of motor, screw satisfies"):
        problem(constraints={"worst_utilisation": {"max": 0.1}}).minimise()
    with pytest.raises(p3dof.InputError, match="discrete variables: say which"):
        problem().evaluate(np.zeros((1, 0)))
    assert Discrete("lead", "drive.lead", (0.01,)).told(0) == "0.01"


@shows("p3dof.design.optimisation.pareto._combinations", "p3dof.design.optimisation.pareto.optimum_tables")
def test_a_table_says_why_each_combination_was_left_out() -> None:
    """The cheapest that fits is the best; what costs more is left out by its cost, by a sum by hand.

    Too small an inertia of the motor is seen before the task is done; too weak a brake is not.
    """
    motors = (*MOTORS, replace(MOTORS[0], inertia=2e-5, name="M110"))
    bounds = {"worst_utilisation": {"max": 1.0}, "cost": {"max": 700.0}}
    given = {"drives": Catalogue(motors, [SCREWS[1]]), "constraints": bounds}
    optimum = problem({"motor": "all"}, "cost", **given).minimise()
    table = optimum_tables(optimum)[-1]
    worst, why = {}, {}
    for motor in motors:
        ratings = [rating for axis in sized(motor, SCREWS[1]).axes for rating in axis.ratings]
        found = max(ratings, key=lambda rating: rating.required / rating.limit)
        worst[motor.name], why[motor.name] = found.required / found.limit, found.name
    assert worst["M100"] > worst["M110"] > 1 > worst["M200"]
    assert (why["M100"], why["M110"]) == ("inertia ratio", "brake")
    unit = "worst_utilisation ≤ 1:"
    rows = {
        "M200": (3 * (140 + 70), "best", "optimised"),
        "M110": (np.nan, (f"{unit} violated by", 1, worst["M110"] - 1, worst["M110"]), "optimised"),
        "M100": (np.nan, (f"{unit} at least", 1, worst["M100"]), "left out"),
        "M400": (np.nan, ("cost ≤", 700, "at least", 810), "left out"),
    }
    assert {row[0]: row[1:] for row in table.rows}["M200"] == (630.0, "best", "optimised")
    check_table(table, {row[0]: rows[row[0]] for row in table.rows}, rtol=1e-3)
    assert sorted(rows) == sorted(row[0] for row in table.rows)


def test_a_file_with_tasks_tells_motor_and_screw(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    p3dof.design.tasks.write_task(task(), "task.yaml")
    motors = [
        {"name": m.name, "rated_torque": m.rated_torque, "peak_torque": m.peak_torque, "cost": m.cost,
         "max_speed": m.max_speed, "rated_speed": m.rated_speed, "inertia": m.inertia, "mass": "500 g",
         "brake_torque": m.brake_torque} for m in MOTORS
    ]  # fmt: skip
    screw = {"name": "16x10", "diameter": 0.0127, "length": 0.5, "lead": 0.01, "cost": 70}
    Path("drives.yaml").write_text(yaml.safe_dump({"motors": motors, "screws": [screw]}))
    data = {
        "tasks": [{"file": "task.yaml", "duration": "2 s"}],
        "drives": "drives.yaml",
        "variables": {"motor": "all", "lead": {"one_of": ["5 mm", "10 mm", "16 mm"]}},
        "objectives": ["cost", "worst_utilisation"],
        "constraints": {"worst_utilisation": {"max": 0.8}},
    }
    Path("problem.yaml").write_text(yaml.safe_dump(data))
    assert main(["optimise", "problem.yaml", "--report", "better.html"]) == 0
    assert "pick and place" in Path("better.html").read_text(encoding="utf-8")
    told = capsys.readouterr().out
    asked = p3dof.design.optimisation.read_problem("problem.yaml")
    optimum = asked.minimise()
    fits = [
        (3 * (float(motor.cost or 0) + 70), motor.name)
        for motor, lead in product(MOTORS, (0.005, 0.01, 0.016))
        if all(
            r.required <= 0.8 * r.limit
            for a in sized(motor, replace(SCREWS[1], lead=lead)).axes
            for r in a.ratings
        )
    ]
    assert (optimum.value, optimum.problem.choice["motor"]) == min(fits)
    assert optimum.problem.choice["motor"] in told
    assert "9 combinations" in told
    changes = optimum_tables(optimum)[0]
    assert {row[0]: row[2] for row in changes.rows}["motor"] == optimum.problem.choice["motor"]


def test_the_report_compares_each_machine_with_its_own_lead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    p3dof.design.tasks.write_task(task(), "task.yaml")
    motor, screw = MOTORS[-1], {"name": "16x10", "diameter": 0.0127, "length": 0.5, "lead": 0.01}
    fields = ("name", "rated_torque", "peak_torque", "max_speed", "rated_speed", "inertia", "brake_torque")
    motors = [{field: getattr(motor, field) for field in fields}]
    Path("drives.yaml").write_text(yaml.safe_dump({"motors": motors, "screws": [screw]}))
    data = {
        "tasks": [{"file": "task.yaml", "duration": "2 s", "samples": 41}],
        "drives": "drives.yaml",
        "variables": {"lead": ["6 mm", "16 mm"]},
        "objectives": ["rms_torque"],
    }
    Path("problem.yaml").write_text(yaml.safe_dump(data))
    assert main(["optimise", "problem.yaml", "--starts", "1", "--report", "better.html"]) == 0
    assert "Margins" not in capsys.readouterr().out  # there is no constraint
    (lead,) = p3dof.design.optimisation.read_problem("problem.yaml").minimise(starts=1).design
    (found,) = p3dof.compare_designs(
        {"start": p3dof.PAPER, "optimum": p3dof.PAPER}, task(), duration=2.0, samples=41,
        drives={"start": [Drive(motor, SCREWS[1])], "optimum": [Drive(motor, replace(SCREWS[1], lead=lead))]},
    )  # fmt: skip
    one, other = found["rms torque of the motors"].values
    page = Path("better.html").read_text(encoding="utf-8")
    assert f"{100 * (other / one - 1):+.1f} %" in page
    assert f"{motor.name} + 16x10<" in page
    assert f"{motor.name} + 16x10, lead {1e3 * lead:.4g} mm<" in page
    assert "e-324" not in page  # of the rest at the beginning
