"""The balance that spares the actuators most: published numbers, what is optimal, tasks, the command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from lagrange import LagrangeModel
from machines import random_machine
from scipy.optimize import minimize_scalar
from table_numbers import check_table, shows
from task_files import PICK_AND_PLACE

import p3dof
from p3dof import Motion
from p3dof._base.errors import InputError, SampleError
from p3dof.design import best_balance, forces_of_task
from p3dof.design.balance import balance_table
from p3dof.design.tasks.files import parse
from p3dof.machine.parameters import PAPER, SLIDES, Actuators, Friction

KINDS = ("constant", "spring", "counterweight")


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def found(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(1001))


# --- numbers of the paper's machine and motion --------------------------------------------------------------


def test_constant_forces(robot, found):
    best = best_balance(robot, found)
    np.testing.assert_allclose(best.values["counterbalance"], [48.15, 52.49, 55.49], atol=6e-3)
    np.testing.assert_allclose(best.rms_before, [51.7, 53.8, 59.3], atol=0.06)
    np.testing.assert_allclose(best.rms_after, [18.8, 11.9, 20.8], atol=0.06)
    best = best_balance(robot, found, objective="peak")
    np.testing.assert_allclose(best.values["counterbalance"], [76.06, 33.33, 57.47], atol=6e-3)
    np.testing.assert_allclose(best.peak_after, [42.44, 32.23, 32.24], atol=6e-3)
    np.testing.assert_allclose(best.peak_before, [118.498, 65.567, 89.716], atol=1e-3)


def test_springs(robot, found):
    """The load of B and C falls as their sliders rise, as the force of a plain spring does; not that of A."""
    best = best_balance(robot, found, "spring")
    np.testing.assert_allclose(best.values["spring"][1:], [495, 423], atol=0.5)
    assert best.values["spring"][0] < 0
    assert len(best.notes) == 1
    assert best.notes[0].startswith("A: a negative stiffness, -8.49")


def test_counterweights(robot, found):
    best = best_balance(robot, found, "counterweight")
    assert best.values["counterweight"][0] == pytest.approx(4.90, abs=5e-3)
    assert best.rms_after[0] == pytest.approx(26.2, abs=0.05)


OWN = Actuators({"slide_b": 4.0}, {"slide_a": 20.0}, {"slide_c": 60.0}, {"slide_b": 1.0})


def by_hand(force, shapes, weights, objective, least):
    """Shares of one or two shapes that leave the least of a force: sums, or a search of its lowest peak."""
    if objective == "rms":
        matrix = [[(weights * one * other).sum() for other in shapes] for one in shapes]
        share = np.linalg.solve(matrix, [-(weights * one * force).sum() for one in shapes])
        return np.maximum(share, least)

    def peak(value, whole=False):
        rest = force + value * shapes[-1]
        middle = -(rest.max() + rest.min()) / 2 if len(shapes) > 1 else 0.0
        return middle if whole else np.abs(rest + middle).max()

    if (shapes[0] == 1).all() and len(shapes) == 1:
        return [-(force.max() + force.min()) / 2]
    found = minimize_scalar(peak, bounds=(max(least, -2e3), 2e3), method="bounded", options={"xatol": 1e-11})
    return [found.x] if len(shapes) == 1 else [peak(found.x, whole=True), found.x]


@pytest.mark.parametrize("objective", ["rms", "peak"])
@pytest.mark.parametrize("kind", KINDS)
@shows("p3dof.design.balance.balance_table")
def test_every_number_of_the_table_of_balances(kind, objective):
    """From Lagrange's forces of a machine whose balance of another kind, and whose rotor, stay."""
    rows, papers = [0, 3, 4, 9, 15, 16, 22, 30, 40], p3dof.paper_motion(41)
    states = [np.array(part)[rows] for part in (papers.pose, papers.velocity, papers.acceleration)]
    motion = Motion(papers.time[rows], *states, check=False)
    model = LagrangeModel(PAPER)
    lift = model.slider_accelerations(*states) + PAPER.gravity[2]
    slider, step = model.sliders(states[0]), np.diff(motion.time)
    weights = (np.r_[step, 0] + np.r_[0, step]) / 2
    kept = {
        "counterbalance": np.outer(np.ones(9), [-20.0, 0, 0]),
        "spring": slider * [0, 0, 60.0],
        "counterweight": lift * [0, 1.0, 0],
    }
    numbers = {"constant": ["counterbalance"], "spring": ["counterbalance", "spring"]}.get(kind, [kind])
    force = model.forces(*states) + model.slider_accelerations(*states) * [0, 4.0, 0]
    force += sum(part for name, part in kept.items() if name not in numbers)
    expected, negative = {}, []
    for k, leg in enumerate("ABC"):
        ones = np.ones(9)
        shapes = {"constant": [ones], "spring": [ones, slider[:, k]]}.get(kind, [lift[:, k]])
        least = 0.0 if kind == "counterweight" else -np.inf
        share = np.array(by_hand(force[:, k], shapes, weights, objective, least))
        after = force[:, k] + share @ shapes
        told = share * [-1, 1][: len(share)] if kind != "counterweight" else share
        both = [(weights @ part**2 / weights.sum()) ** 0.5 for part in (force[:, k], after)]
        both += [abs(part).max() for part in (force[:, k], after)]
        expected[leg] = [value if value else np.nan for value in told] + both
        negative += [told[1]] if kind == "spring" and told[1] < 0 else []
    machine = p3dof.load(replace(PAPER, actuators=OWN))
    found = best_balance(machine, machine.inverse_dynamics(motion), kind, objective)
    check_table(balance_table(found), expected, note=negative)


# --- what is optimal ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("objective", ["rms", "peak"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [3, 5])
def test_no_other_balance_leaves_less(kind, objective, seed):
    parameters = random_machine(seed)
    machine = p3dof.load(parameters)
    rng, length = np.random.default_rng(seed), parameters.geometry.L
    motion = Motion.rest_to_rest([0, 0, 0], 0.1 * length * rng.uniform(-1, 1, 3), 0.6, 301)
    found = machine.inverse_dynamics(motion)
    best = best_balance(machine, found, kind, objective)

    def cost(actuators):
        """By its own formula: forces of the machine less what the balance gives, plus its inertia."""
        rows = {
            name: np.array([getattr(actuators, name).get(slide, 0.0) for slide in SLIDES])
            for name in ("counterbalance", "spring", "counterweight")
        }
        given = rows["counterbalance"] - rows["spring"] * found.sliders
        given = given - rows["counterweight"] * parameters.gravity[2]
        forces = found.forces + rows["counterweight"] * found.slider_accelerations - given
        if objective == "peak":
            return np.abs(forces).max(axis=0)
        return np.sqrt(np.trapezoid(forces**2, found.time, axis=0) / motion.duration)

    least = cost(best.actuators)
    after = best.rms_after if objective == "rms" else best.peak_after
    np.testing.assert_allclose(after, least, rtol=1e-9)
    assert (least <= cost(Actuators()) * (1 + 1e-12)).all()
    for name, row in best.values.items():
        for slide, value in zip(SLIDES, row, strict=True):
            for factor in (0.97, 1.03):
                changed = {**getattr(best.actuators, name), slide: factor * value}
                assert (cost(replace(best.actuators, **{name: changed})) >= least * (1 - 1e-9)).all()


@pytest.mark.parametrize("objective", ["rms", "peak"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_machine_with_it_takes_what_was_foretold(kind, objective):
    """With armature, friction and another balance that is replaced, over a motion not at rest at its ends."""
    own = Actuators(
        armature={"sliders": 14.8044},
        counterbalance={"slide_a": 20.0},
        spring={"slide_b": 100.0},
        counterweight={"slide_c": 1.0},
    )
    parameters = replace(PAPER, actuators=own, friction=Friction(viscous={"sliders": 20.0}))
    machine, motion = p3dof.load(parameters), p3dof.paper_motion(301)
    best = best_balance(machine, machine.inverse_dynamics(motion), kind, objective)
    result = p3dof.load(best.parameters).inverse_dynamics(motion)
    np.testing.assert_allclose(best.after, result.forces, rtol=0, atol=1e-10)
    np.testing.assert_allclose(best.peak_after, result.peak_forces, rtol=1e-12)
    mean_square = np.trapezoid(result.forces**2, motion.time, axis=0)
    np.testing.assert_allclose(best.rms_after, np.sqrt(mean_square / motion.duration), rtol=1e-12)
    again = best_balance(p3dof.load(best.parameters), result, kind, objective)
    for name, row in best.values.items():
        np.testing.assert_allclose(again.values[name], row, rtol=1e-6, atol=1e-6)
    assert best.actuators.armature == own.armature


def test_armature_shifts_the_best_force_where_a_motion_does_not_rest_at_its_ends():
    """By mass times change of the slider's speed over the duration."""
    machine = p3dof.load(replace(PAPER, actuators=Actuators(armature={"sliders": 14.8044})))
    best = best_balance(machine, machine.inverse_dynamics(p3dof.paper_motion(4001)))
    np.testing.assert_allclose(best.values["counterbalance"], [61.220, 57.180, 64.377], atol=1e-3)
    motion = Motion.rest_to_rest([0, 0, 0], [0.1, 0.05, 0.2], 0.5, 1001)
    chosen = [
        best_balance(one, one.inverse_dynamics(motion)).values["counterbalance"]
        for one in (machine, p3dof.load())
    ]
    np.testing.assert_allclose(*chosen, atol=1e-4)  # trapezoids: m step² / 12 by the change of the jerk


def test_a_slider_that_stands_still_needs_no_spring(robot):
    still = Motion(np.linspace(0, 1, 5), *(np.tile(row, (5, 1)) for row in np.zeros((3, 3))))
    found = robot.inverse_dynamics(still)
    best = best_balance(robot, found, "spring")
    np.testing.assert_array_equal(best.values["spring"], 0)
    np.testing.assert_allclose(best.values["counterbalance"], found.forces[0], rtol=1e-12)
    np.testing.assert_allclose(best.peak_after, 0, rtol=0, atol=1e-12)


def test_waits_and_payloads_of_a_task_count(robot):
    task = parse(PICK_AND_PLACE)
    found = forces_of_task(robot, task.plan(1.5))
    best = best_balance(robot, found)
    total = sum(np.trapezoid(part.forces, part.time, axis=0) for part in found.results)
    np.testing.assert_allclose(best.values["counterbalance"], total / found.plan.duration, rtol=1e-12)
    np.testing.assert_allclose(best.rms_before, found.rms_forces, rtol=1e-12)
    longer = replace(task.waypoints[1], dwell=30.0)  # with the payload in hand
    points = (task.waypoints[0], longer, *task.waypoints[2:])
    waiting = forces_of_task(robot, p3dof.Task(points).plan(31.3))
    held = next(
        part for part, piece in zip(waiting.results, waiting.plan.pieces, strict=True) if piece.dwells
    )
    there = best_balance(robot, waiting).values["counterbalance"]
    assert np.abs(there - held.forces[0]).max() < np.abs(best.values["counterbalance"] - held.forces[0]).max()


def test_a_motion_or_a_plan_is_enough(robot, found):
    plan = parse(PICK_AND_PLACE).plan(1.5)
    for given, forces in ((found.motion, found), (plan, forces_of_task(robot, plan))):
        one, other = (best_balance(robot, what, "spring", "peak") for what in (given, forces))
        for name, row in one.values.items():
            np.testing.assert_allclose(row, other.values[name], rtol=1e-8)


@pytest.mark.parametrize(
    ("message", "ask"),
    {
        "robot: expected a Manipulator": lambda _, found: best_balance(None, found),
        "found: expected forces over a motion or a task": lambda robot, found: best_balance(
            robot, found.forces
        ),
        "kind: expected one of constant, spring, counterweight": lambda robot, found: best_balance(
            robot, found, "rope"
        ),
        "objective: expected one of rms, peak": lambda robot, found: best_balance(
            robot, found, "spring", "mean"
        ),
    }.items(),
)
def test_something_else_is_refused(robot, found, message, ask):
    with pytest.raises(InputError, match=message):
        ask(robot, found)


def test_forces_of_no_motion_are_refused(robot):
    far = Motion.rest_to_rest([0, 0, 0], [0.6, 0, 0], 1.0, 11)
    with pytest.raises(SampleError, match="cannot perform this motion"):
        best_balance(robot, robot.inverse_dynamics(far, on_invalid="nan"))


# --- the command --------------------------------------------------------------------------------------------


def test_the_command_writes_a_machine(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    p3dof.paper_motion(401).to_csv("motion.csv")
    given = replace(PAPER, friction=Friction(viscous={"sliders": 5.0}))
    p3dof.write_parameters(given, "machine.yaml")
    options = "--parameters machine.yaml --kind constant --out balanced.yaml --figure forces.png"
    code, out, _ = run(capsys, "balance", "motion.csv", *options.split())
    assert code == 0
    assert "Constant force on each slider" in out
    written = p3dof.read_parameters("balanced.yaml")
    result = p3dof.load(given).inverse_dynamics(p3dof.paper_motion(401))
    expected = best_balance(p3dof.load(given), result).actuators
    assert written.actuators.counterbalance == expected.counterbalance
    assert written.friction.viscous == given.friction.viscous
    assert (tmp_path / "forces.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_compares_the_kinds_over_a_task(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    code, out, _ = run(capsys, "balance", "task.yaml", "--duration", 2, "--objective", "peak")
    assert code == 0
    for title in ("Constant force", "Spring with a force at home", "Counterweight of each slider"):
        assert title in out
    assert out.count("for the least peak") == 3
    code, out, _ = run(capsys, "balance")
    assert code == 0
    assert "48.1458" in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("motion.csv --duration 2", "--duration belongs to a task"),
        ("task.yaml --duration 2 --wrench motion.csv", "--wrench belongs to a motion"),
        ("motion.csv --out balanced.yaml", "choose it with --kind"),
        ("motion.csv --kind rope", "Invalid value for '--kind'"),
        ("none.csv", "none.csv"),
        ("task.yaml", "duration: expected that of the whole task"),
    ],
)
def test_the_command_refuses_in_one_line(capsys, tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    p3dof.paper_motion(11).to_csv("motion.csv")
    code, _, err = run(capsys, "balance", *options.split())
    assert code == 2
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "balanced.yaml").exists()
