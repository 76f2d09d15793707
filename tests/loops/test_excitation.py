"""Excitation motions: within limits, from rest, best for what they are for; what they promise comes true."""

import dataclasses

import numpy as np
import pytest
from gallery import GALLERY
from numpy.testing import assert_allclose, assert_array_equal
from table_numbers import check_evidence, check_table, shows

import p3dof
from p3dof._base.errors import InputError, ModelError, OptimisationError
from p3dof.analysis.identification import MachineForces
from p3dof.loops import LoopForces, load_robot, optimise_excitation
from p3dof.loops.compiled import build
from p3dof.loops.identification import excitation
from p3dof.loops.identification.excitation import excitation_tables
from p3dof.loops.identification.search import Basis, Search, Unknowns, _At, amplitude, gram, measure, sampled
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import SOLIDS, Friction, Limits
from p3dof.runs.forces_along import forces_along

CRITERIA = ("prediction", "D", "condition")


@pytest.fixture(scope="module")
def machine():
    return MachineForces(p3dof.load(SOLIDS))


@pytest.fixture(scope="module")
def task(machine):
    motion = paper_motion(201)
    return machine.from_coordinates(motion.pose, motion.velocity, motion.acceleration)


@pytest.fixture(scope="module")
def found(machine, task):
    """A motion for the paper's one, after a short search."""
    one = optimise_excitation(machine, task=task, motions=400)
    assert one.noise.tolist() == [1.0, 1.0, 1.0]
    return one


def rms(errors):
    return float(np.sqrt(np.mean(np.square(errors))))


def measured(forces, found):
    """The regressor of an experiment's whole periods, of what is uncertain, over the noise."""
    time = found.ramp + np.arange(round(found.measured * found.rate)) / found.rate
    columns = forces.rows(forces.from_coordinates(*found.at(time))).columns
    free = [forces.names.index(name) for name in found.parameter_names]
    return columns[..., free] / found.noise[:, None], free


def base(found, columns):
    """The columns of the combinations: those of the parameters that their names begin with."""
    first = [found.parameter_names.index(name.split(" ")[0]) for name in found.names]
    return columns[..., first]


def test_a_short_search_predicts_the_papers_motion_or_any_other(found, machine):
    """21 base parameters and six of friction; 10 s at 1 kHz and 1 N of noise; each where it is looked for."""
    assert len(found.names) == 27
    assert found.measured == 10.0
    assert rms(found.task_error) < 0.0195
    assert rms(optimise_excitation(machine, motions=400).workspace_error) < 0.026
    assert found.motions < 400 + 10


@pytest.mark.slow
def test_least_condition_number_predicts_worse_than_what_is_optimised_for_prediction(machine, task):
    made = {one: optimise_excitation(machine, criterion=one, task=task, motions=4000) for one in CRITERIA}
    condition = {name: one.condition for name, one in made.items()}
    on_task = {name: rms(one.task_error) for name, one in made.items()}
    elsewhere = {name: rms(one.workspace_error) for name, one in made.items()}
    assert condition["condition"] < 450
    assert min(condition["D"], condition["prediction"]) > 700
    assert on_task["prediction"] < on_task["D"] < on_task["condition"]
    assert on_task["condition"] > 1.4 * on_task["prediction"]
    anywhere = rms(optimise_excitation(machine, motions=4000).workspace_error)
    assert elsewhere["condition"] > 1.3 * max(elsewhere["D"], anywhere)
    assert anywhere < 0.019
    assert on_task["prediction"] < 0.0185


@shows(
    "p3dof.loops.identification.excitation.Excitation.task_error",
    "p3dof.loops.identification.excitation.Excitation.workspace_error",
)
def test_the_predicted_error_is_that_of_many_experiments(machine, task):
    """Least squares of 300 experiments with other noise, each actuator its own."""
    noise = np.array([0.5, 1.0, 2.0])
    one = optimise_excitation(machine, task=task, noise=noise, rate=250.0, periods=2, motions=60)
    columns, _ = measured(machine, one)
    A = base(one, columns).reshape(-1, len(one.names))
    draws = np.random.default_rng(5).normal(size=(len(A), 300))
    wrong = np.linalg.lstsq(A, draws, rcond=None)[0]
    free = [machine.names.index(name) for name in one.parameter_names]
    predicted = base(one, machine.rows(task).columns[..., free])
    seen = np.sqrt(np.mean((predicted @ wrong) ** 2, axis=(0, 2)))
    # About ten combinations matter: the mean square of 300 draws has a deviation of 3 %, its root of 1.4 %.
    assert_allclose(seen, one.task_error, rtol=0.05)
    assert_allclose(np.std(wrong, axis=1), one.deviations, rtol=5 / np.sqrt(2 * 300))
    covariance = np.linalg.inv(A.T @ A)
    variance = np.einsum("nip,pq,niq->i", predicted, covariance, predicted) / len(predicted)
    check_evidence(one, "task_error", np.sqrt(variance), rtol=5e-3)  # friction near reversals: other samples
    ratio = one.predicted_error(one.measured / 4, "workspace") / 2
    check_evidence(one, "workspace_error", ratio, rtol=1e-12)
    with pytest.raises(AssertionError):  # noise of one size would be seen
        assert_allclose(seen / noise, one.task_error, rtol=0.05)


def test_with_the_prior_of_the_design_it_is_the_posterior(machine):
    doubts = machine.deviations()
    one = optimise_excitation(machine, prior=True, rate=312.0, periods=1, motions=40)
    columns, free = measured(machine, one)
    _, s, Vt = np.linalg.svd(columns.reshape(-1, len(free)) * doubts[free], full_matrices=False)
    share = 1 - np.einsum("kp,k->p", Vt**2, s**2 / (1 + s**2))
    # At 312 Hz these are the samples by which a period is integrated.
    assert_allclose(one.parameter_deviations, doubts[free] * np.sqrt(share), rtol=1e-8)
    assert_array_equal(one.parameter_prior, doubts[free])
    assert (one.parameter_deviations <= one.parameter_prior).all()
    without = optimise_excitation(machine, rate=250.0, periods=2, motions=40)
    alone = np.isfinite(without.parameter_deviations)
    assert 0 < alone.sum() < len(free)
    known = dict(zip(without.names, without.deviations, strict=True))
    for name, deviation in zip(without.parameter_names, without.parameter_deviations, strict=True):
        if np.isfinite(deviation):
            assert known[name] == deviation


@pytest.mark.parametrize("shape", [{"harmonics": 3}, {"waypoints": 8}])
def test_the_whole_experiment_is_smooth_within_limits_and_from_rest_to_rest(machine, shape):
    one = optimise_excitation(machine, **shape, duration=1.5, periods=2, motions=40)
    motion = one.sampled()
    assert motion.time[-1] == pytest.approx(one.duration, abs=1e-9)
    states = machine.from_coordinates(*motion[1:])
    excess = machine.excess(states)
    assert excess.max() <= 0
    assert_allclose(1 + excess.max(axis=0), one.utilisation, atol=5e-3)
    assert one.nearest_limit == machine.limits[int(excess.max(axis=0).argmax())]
    ends = np.array(one.at([0.0, one.duration]))
    assert_allclose(ends[0], [machine.home] * 2, rtol=0, atol=1e-15)
    assert_allclose(ends[1:], 0, rtol=0, atol=1e-12)
    step = 1e-4
    moments = np.linspace(0.1, one.duration - 0.1, 57)
    before, at, after = (np.array(one.at(moments + k * step)) for k in (-1, 0, 1))
    size = np.abs(at).max(axis=(1, 2))
    for k in (0, 1):  # the error of these differences is h²/6 of the third derivative
        assert_allclose((after[k] - before[k]) / (2 * step), at[k + 1], rtol=0, atol=2e-5 * size[k + 1])
    period = [np.array(one.steady(np.array([0.3]) + k * one.period)) for k in (0, 1)]
    assert_allclose(*period, rtol=0, atol=1e-10)


def test_motion_files_are_read_back(machine, found, tmp_path):
    motion = Motion.from_csv(found.to_csv(tmp_path / "motion.csv", rate=200.0, derivatives=True))
    assert_array_equal(motion.pose, found.sampled(200.0).values)
    assert_array_equal(motion.acceleration, found.sampled(200.0).accelerations)
    forces = p3dof.load(SOLIDS).inverse_dynamics(motion).forces
    rows = machine.rows(machine.from_coordinates(*found.sampled(200.0)[1:]))
    assert_allclose(forces, rows.columns @ machine.design + rows.known, rtol=0, atol=1e-9)


def test_how_long_an_accuracy_takes(found):
    wanted = 0.6 * rms(found.task_error)
    long = found.duration_for(wanted)
    assert long == round(long / found.period) * found.period
    assert (found.predicted_error(long) <= wanted).all()
    assert (found.predicted_error(long - found.period) > wanted).any()
    assert_allclose(found.predicted_error(found.measured), found.task_error, rtol=1e-12)
    four_times = found.predicted_error(4 * found.measured, "workspace")
    assert_allclose(four_times, found.workspace_error / 2, rtol=1e-12)
    with pytest.raises(InputError, match="accuracy: it takes more than 1e"):
        found.duration_for(1e-9)


def test_the_same_seed_finds_the_same_motion(machine):
    one, same, other = (
        optimise_excitation(machine, harmonics=2, motions=20, seed=seed) for seed in (3, 3, 4)
    )
    assert_array_equal(one.coefficients, same.coefficients)
    assert np.abs(one.coefficients - other.coefficients).max() > 1e-3


@shows(
    "p3dof.loops.identification.excitation.excitation_tables",
    "p3dof.loops.identification.excitation._motion_table",
    "p3dof.loops.identification.excitation._error_table",
    "p3dof.loops.identification.excitation._combinations_table",
)
def test_tables_tell_limits_errors_and_combinations(found):
    motion, errors, combinations = excitation_tables(found)
    time = np.arange(2000) / 1000
    values, rates, accelerations = found.steady(time)
    ends = (
        values.min(axis=0),
        values.max(axis=0),
        np.abs(rates).max(axis=0),
        np.abs(accelerations).max(axis=0),
    )
    rows = dict(zip(("y [m]", "z [m]", "theta [rad]"), np.transpose(ends).tolist(), strict=True))
    check_table(motion, rows, note=(2.0, 5, 2.0, found.nearest_limit, found.utilisation.max()))
    rows = {"task motion": found.task_error, "random motions in the workspace": found.workspace_error}
    check_table(errors, {**rows, "noise of one measured force": found.noise}, note=(10.0, 1000.0))
    shares = np.divide(
        found.deviations, np.abs(found.values), out=np.full(27, np.inf), where=found.values != 0
    )
    order = np.argsort(shares, kind="stable")
    names = [row[0] for row in combinations.rows]
    for k, name in zip(order, names, strict=True):
        assert found.names[k].startswith(name.split(" ...")[0])
    rows = [
        (name, found.values[k], found.deviations[k], shares[k] if shares[k] < 1e3 else "-")
        for k, name in zip(order, names, strict=True)
    ]
    check_table(combinations, rows, note=(len(found.parameter_names), found.condition))
    assert "<table" in found._repr_html_()


@pytest.mark.parametrize("criterion", CRITERIA)
def test_derivatives_of_the_criteria(criterion):
    rng = np.random.default_rng(2)
    A, B, D = rng.normal(size=(9, 5)), rng.normal(size=(3, 5)), rng.normal(size=(5, 5))
    H, over, D = A.T @ A, B.T @ B, D + D.T
    value, by = measure(criterion, H, over)
    step = 1e-6
    difference = (measure(criterion, H + step * D, over)[0] - measure(criterion, H - step * D, over)[0]) / (
        2 * step
    )
    assert_allclose(np.sum(by * D), difference, rtol=1e-7)
    known = {
        "prediction": np.log(np.trace(over @ np.linalg.inv(H))) / 2,
        "D": -np.linalg.slogdet(H)[1] / 10,
        "condition": np.log(np.linalg.cond(A / np.linalg.norm(A, axis=0))),
    }
    assert_allclose(value, known[criterion], rtol=1e-10)
    with pytest.raises(np.linalg.LinAlgError):
        measure(criterion, np.diag([1.0, 1, 1, 1, 0]), over)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("waypoints", [None, 7])
def test_gradients_of_a_search_are_those_of_its_values(criterion, waypoints):
    machine = MachineForces(dataclasses.replace(SOLIDS, friction=Friction(smoothing=0.2)))
    basis = Basis(2.0, 2, waypoints)
    search = Search(machine, basis, criterion, np.array([0.2, 0.2, 0.7]), 10**6, lambda _: None)
    rng = np.random.default_rng(1)
    X = search.fitted(basis.random(machine.home, search.size, rng))

    def another():
        return sampled(machine, search.motion(search.fitted(basis.random(machine.home, search.size, rng))))

    search.unknowns = Unknowns.of(machine, another, np.ones(3), machine.deviations(), False)
    search.count = 1000.0
    search.over = gram(search.unknowns.columns(another().rows)).mean(axis=0)
    search.refine(40)
    at, x = _At(search), (0.7 * X / search.scale).ravel()
    by_value, by_margins = at.value_by(x), at.margins_by(x)
    size, magnified = 3e-6, np.exp(measure("condition", gram(at._columns).sum(axis=0), search.over)[0])
    for k in range(0, len(x), 4):
        step = size * np.eye(len(x))[k]
        value = (at.value(x + step) - at.value(x - step)) / (2 * size)
        margins = (at.margins(x + step) - at.margins(x - step)) / (2 * size)
        # Forward differences of a share of 1e-6; a criterion magnifies them by the conditioning.
        assert_allclose(by_value[k], value, rtol=0, atol=1e-6 * magnified * np.abs(by_value).max())
        assert_allclose(by_margins[:, k], margins, rtol=0, atol=3e-5 * np.abs(by_margins).max())
    worst = sampled(machine, search.motion(0.7 * X)).excess.max(axis=0)
    assert (at.margins(x) <= -worst).all()  # the smooth limit is never beyond the true one


def test_amplitudes_reach_limits_from_either_side():
    for limit in (0.013, 1.0, 57.0):
        found = amplitude(lambda by, limit=limit: by / limit - 1, 1e-4)
        assert limit * (1 - 2e-3 - 2e-4) < found <= limit * (1 - 2e-3)
    assert amplitude(lambda _: 1.0, 0.1) == 0.0


def of_robot(name, **options):
    """A robot of the gallery, an excitation motion, and its forces over the whole experiment."""
    robot = load_robot(GALLERY / f"{name}.urdf")
    forces = LoopForces(robot, "general" if build.compiler() is None else "compiled")
    one = optimise_excitation(forces, noise=0.01, rate=100.0, periods=1, **options)
    motion = one.sampled()
    states = forces.from_coordinates(*motion[1:])
    rows = forces.rows(states)
    excess = forces.excess(states, rows)
    assert excess.max() <= 0
    assert_allclose(forces.excess(states), excess, rtol=0, atol=1e-9)  # by inverse dynamics
    by_name, v = dict(zip(forces.limits, excess.T, strict=True)), states.whole[1]
    for joint, joint_name in enumerate(robot.model.names.tolist()[1:], start=1):  # passive ones, too
        at, most = robot.model.idx_vs[joint], robot.model.velocityLimit[robot.model.idx_vs[joint]]
        if robot.model.nvs[joint] > 1 or most > 1e6:
            continue
        assert_allclose(by_name[f"speed of {joint_name}"], np.abs(v[:, at]) / most - 1, atol=1e-12)
    return robot, one, rows.columns @ forces.design + rows.known


def test_a_crank_of_any_robot(tmp_path):
    robot, one, tau = of_robot("four_bar", harmonics=1, motions=10)
    assert one.coordinates == robot.actuated
    along = forces_along(robot, one.to_csv(tmp_path / "crank.csv"), samples=len(tau))
    # The file's values are those of a curve that is not quite the motion between them.
    assert_allclose(along.forces, tau, rtol=0, atol=1e-3 * np.abs(tau).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["five_bar", "delta"])
def test_parallel_robots_are_excited_within_their_limits(name, tmp_path):
    short = of_robot(name, harmonics=3, motions=10)[1]
    robot, one, tau = of_robot(name, harmonics=3, motions=150)
    assert rms(one.workspace_error) < rms(short.workspace_error)
    along = forces_along(robot, one.to_csv(tmp_path / "motion.csv"), samples=len(tau))
    assert_allclose(along.forces, tau, rtol=0, atol=1e-3 * np.abs(tau).max())


@pytest.mark.parametrize(("name", "times"), [("machine", 1), ("four_bar", 2)])
def test_a_search_has_two_equations_for_each_combination(machine, monkeypatch, name, times):
    """However few harmonics; twice as many where passive joints have limits of speed, as in the gallery."""
    seen = []

    def noted(search, _):
        seen.append(search)
        raise OptimisationError("seen")

    monkeypatch.setattr(excitation, "_best", noted)
    method = "general" if build.compiler() is None else "compiled"
    forces = machine if name == "machine" else LoopForces(load_robot(GALLERY / f"{name}.urdf"), method)
    with pytest.raises(OptimisationError, match="seen"):
        optimise_excitation(forces, harmonics=1, motions=5)
    (search,) = seen
    count, m = len(search.unknowns.base), len(forces.actuators)
    assert 2 * count > search.basis.samples * m
    assert search.functions.shape[1] == times * int(np.ceil(2 * count / m))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"criterion": "E"}, "criterion: expected prediction, D, condition, got 'E'"),
        ({"criterion": "predicton"}, "did you mean 'prediction'"),
        ({"harmonics": 0}, "harmonics: expected a whole number of at least 1, got 0"),
        ({"waypoints": 5}, "waypoints: expected a whole number of at least 6, got 5"),
        ({"duration": 0.0}, "duration: expected a positive number"),
        ({"duration": -1.0}, "duration: expected a positive number"),
        (
            {"rate": 5.0},
            r"rate: expected more than 5 Hz, twice the highest frequency of the motion, got 5 Hz",
        ),
        ({"noise": [1.0, 2.0]}, "noise: expected a positive number or 3 of them"),
        ({"noise": 0.0}, "noise: expected a positive number or 3 of them, got 0.0"),
        ({"deviations": np.ones(3)}, r"deviations: expected shape \(115,\)"),
        ({"ramp": 0.0}, "ramp: expected a positive number"),
        ({"periods": 0}, "periods: expected a whole number of at least 1"),
        ({"motions": 0}, "motions: expected a whole number of at least 1"),
    ],
)
def test_a_bad_argument_is_one_clear_error(machine, options, words):
    with pytest.raises(InputError, match=words):
        optimise_excitation(machine, **options)


def test_what_is_not_possible_is_said(machine, found):
    weak = MachineForces(dataclasses.replace(SOLIDS, limits=Limits(force=20.0)))
    with pytest.raises(
        OptimisationError, match=r"at home, at rest, force of slide_[abc] exceeds its limit by"
    ):
        optimise_excitation(weak)
    nothing = np.zeros(len(machine.names))
    with pytest.raises(OptimisationError, match="no parameter is uncertain"):
        optimise_excitation(machine, deviations=nothing)
    with pytest.raises(OptimisationError, match=r"in a ramp of 0\.001 s the motion does not stay within"):
        optimise_excitation(machine, ramp=1e-3, motions=20)
    five_bar = load_robot(GALLERY / "five_bar.urdf")
    one = dataclasses.replace(five_bar.sidecar, actuated=five_bar.actuated[:1])
    with pytest.raises(
        ModelError, match="1 actuators do not determine a motion with 2 degrees of freedom; lock"
    ):
        LoopForces(p3dof.ClosedLoopModel(five_bar.model, one))
    with pytest.raises(InputError, match="over: expected 'task' or 'workspace', got 'all'"):
        found.predicted_error(1.0, "all")
    with pytest.raises(InputError, match="rate: expected more than 5 Hz"):
        found.sampled(4.0)
