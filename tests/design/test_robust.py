"""Robust measures: exact where they can be, with exact gradients, and what they are good for."""

from __future__ import annotations

import json
import pickle

import jsonschema
import numpy as np
import pytest
import yaml
from documents import ROOT
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import p3dof
from p3dof._base.errors import InputError, SweepError
from p3dof.design.optimisation import MEASURES, Box, Constraint, Robust, read_problem
from p3dof.machine.parameters import PAPER, SOLIDS

SIGMA = {"R": "0.5 mm", "r": "0.2 mm", "L": 5e-4, "density": "1 %"}
FIXED = {"slider_edge": 0.05, "plate_thickness": 0.05, "corner_radius": 0.02, "b": 0.05}
VARIABLES = {"r": (0.08, 0.2), "R": (0.15, 0.5), "L": (0.2, 0.8), "rod_radius": (0.003, 0.015)}
DESIGN = np.array([0.1, 0.25, 0.4, 0.01])
MOTION = p3dof.paper_motion(101)


def problem(*objectives, **options):
    given = {"bodies": "solids", "machine": SOLIDS, "fixed": FIXED} | options
    return p3dof.design.DesignProblem(VARIABLES, MOTION, objectives, **given)


def test_small_tolerances_spread_as_the_first_order_says():
    small = dict(zip(SIGMA, ("10 um", "10 um", "10 um", "0.01 %"), strict=True))
    linear = p3dof.tolerance(SOLIDS, MOTION, sigma=small, bodies="solids")
    found = problem(Robust("peak_force", small, k=2), Robust("peak_force", small, k=3, kind="worst"))
    spread, worst = found.evaluate(DESIGN).objectives[0]
    assert spread - linear.peak[3] == pytest.approx(2 * linear.peak_deviation[3], rel=2e-3)
    by_parameter = 3 * np.abs(linear.peak_gradient[3]) @ linear.sigma
    assert worst - linear.peak[3] == pytest.approx(by_parameter, rel=2e-3)


@pytest.mark.parametrize(
    "robust",
    [
        Robust("peak_force", SIGMA),
        Robust("peak_force", SIGMA, kind="worst"),
        Robust("rms_force", SIGMA | {"rod_radius": "5 %"}, k=2, points=20),
        Robust("motion_singularity", SIGMA, k=2),
        Robust("energy", {"plate_thickness": "2 %", "offset.y": "1 mm"}, k=1, seed=3),
    ],
    ids=lambda robust: robust.name,
)
def test_gradients_are_exact(robust):
    asked = problem(robust)
    found = asked.gradient(DESIGN)[robust.name]
    step = 1e-6
    ends = asked.evaluate(np.concatenate([DESIGN + step * np.eye(4), DESIGN - step * np.eye(4)]))
    by_hand = (ends.objectives[:4, 0] - ends.objectives[4:, 0]) / (2 * step)
    assert_allclose(found, by_hand, rtol=1e-6, atol=1e-6 * np.abs(by_hand).max())


def test_masses_of_machines_that_keep_their_bodies_take_the_inertia_along():
    sigma = {"leg.mass": "0.1 %", "platform.mass": "1 g"}
    asked = p3dof.design.DesignProblem({"R": (0.2, 0.3)}, MOTION, [Robust("peak_force", sigma, k=1)])
    linear = p3dof.tolerance(PAPER, MOTION, sigma=sigma)
    found = asked.evaluate([0.25]).objectives[0, 0] - linear.peak[3]
    assert found == pytest.approx(linear.peak_deviation[3], rel=1e-3)


def test_large_measures_keep_to_the_other_side():
    plain, robust = (
        problem("motion_singularity", Robust("motion_singularity", SIGMA)).evaluate(DESIGN).objectives[0]
    )
    assert robust < plain
    few, many = (
        problem(Robust("motion_singularity", SIGMA, points=n)).evaluate(DESIGN).objectives[0, 0]
        for n in (16, 1024)
    )
    assert few == pytest.approx(many, abs=0.02 * (plain - many))


def test_a_robust_constraint_is_kept_by_machines_as_they_are_built():
    """The nominal optimum is at its limit, so that half of all machines miss it."""
    sigma = {"R": "2 mm", "r": "1 mm", "L": "2 mm"}
    box = Box((-0.1, 0.1), (-0.5, 0.5))

    def best(measure):
        asked = p3dof.design.DesignProblem(
            {"R": (0.2, 0.4)},
            MOTION,
            ["peak_force"],
            [Constraint(measure, 0.6, at_least=True)],
            box=box,
            machine=PAPER,
        )
        return brentq(lambda R: asked.evaluate([R]).margins[0, 0], 0.2, 0.34, xtol=1e-7)

    nominal, robust = (best(MEASURES["serial_reach"]), best(Robust("serial_reach", sigma, k=2)))
    assert robust < nominal
    rng = np.random.default_rng(5)
    for R, low, high in ((nominal, 0.4, 0.6), (robust, 0.96, 0.99)):
        machines = np.array([0.1, R, 0.4]) + rng.normal(size=(4000, 3)) * [1e-3, 2e-3, 2e-3]
        asked = p3dof.design.DesignProblem(
            dict.fromkeys(("r", "R", "L"), (0.05, 0.9)), MOTION, ["serial_reach"], box=box, machine=PAPER
        )
        kept = (asked.evaluate(machines).objectives[:, 0] >= 0.6).mean()
        assert low < kept < high


def test_it_can_be_sent_elsewhere():
    robust = pickle.loads(pickle.dumps(Robust("peak_force", SIGMA, k=2)))  # noqa: S301 - our own
    assert robust.name == "peak_force_with_2_sigma"
    assert hash(robust) == hash(Robust("peak_force", SIGMA, k=2))
    one, other = problem(robust), problem(Robust("peak_force", SIGMA, k=2))
    assert one.evaluate(DESIGN).objectives == other.evaluate(DESIGN).objectives


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"measure": "beauty"}, "measure: unknown measure 'beauty'"),
        ({"sigma": {}}, "sigma: expected numbers by names"),
        ({"sigma": {"radius": 1e-4}}, "unknown column 'radius'"),
        ({"k": 0}, "k: expected"),
        ({"kind": "best"}, "kind: expected 'spread' or 'worst'"),
        ({"points": 15}, "points: expected an even number"),
        ({"points": 6}, "at least 8 for 2 parameters"),
        ({"seed": -1}, "seed: expected"),
    ],
)
def test_bad_arguments_are_told(changes, told):
    given = {"measure": "peak_force", "sigma": {"R": 1e-4, "L": 1e-4}} | changes
    with pytest.raises(InputError, match=told):
        Robust(**given)


FILE = """
motion: {paper: 51}
variables: {R: [0.2, 0.3], L: [0.35, 0.5]}
objectives: [peak_force, width]
constraints: {motion_singularity: {min: 20 deg}, peak_speed: {max: 3}}
robust:
  sigma: {R: 0.5 mm, L: 0.5 mm}
  measures: [peak_force, motion_singularity]
  k: 2
"""


def test_a_file_asks_for_machines_as_they_are_built(tmp_path):
    path = tmp_path / "problem.yaml"
    path.write_text(FILE, encoding="utf-8")
    asked = read_problem(path)
    sigma = {"R": "0.5 mm", "L": "0.5 mm"}
    robust = Robust("peak_force", sigma, k=2)
    bound = Constraint(Robust("motion_singularity", sigma, k=2), np.radians(20), at_least=True)
    expected = p3dof.design.DesignProblem(
        {"R": (0.2, 0.3), "L": (0.35, 0.5)},
        p3dof.paper_motion(51),
        [robust, "width"],
        [bound, {"peak_speed": {"max": 3}}],
    )
    assert asked.settings() == expected.settings()
    found = asked.evaluate([0.25, 0.4])
    assert_allclose(found.objectives, expected.evaluate([0.25, 0.4]).objectives)
    reference = ROOT / "docs/reference"
    schema = json.loads((reference / "problem.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema["properties"]["robust"] | {"$defs": schema["$defs"]}).validate(
        yaml.safe_load(FILE)["robust"]
    )


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("  k: 2", "  k: none", "robust"),
        ("  k: 2", "  how: 2", "robust: unknown field 'how'"),
        ("sigma: {R: 0.5 mm, L: 0.5 mm}", "seed: 1", "robust: the field 'sigma' is missing"),
        ("[peak_force, motion_singularity]", "[energy]", "robust.measures: energy is no objective"),
        ("[peak_force, motion_singularity]", "[beauty]", "unknown measure 'beauty'"),
    ],
)
def test_files_that_ask_for_something_else_are_refused(old, new, told, tmp_path):
    path = tmp_path / "problem.yaml"
    path.write_text(FILE.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=told):
        read_problem(path)


def test_an_optimisation_goes_on_only_with_the_same_tolerances(tmp_path):
    ask = {"starts": 1, "store": tmp_path / "store"}
    asked, other = (
        p3dof.design.DesignProblem(
            {"R": (0.24, 0.26)}, p3dof.paper_motion(11), [Robust("peak_force", {"L": size})]
        )
        for size in ("1 mm", "2 mm")
    )
    best = asked.minimise(**ask)
    assert asked.minimise(resume=True, **ask).value == best.value
    with pytest.raises(SweepError):
        other.minimise(resume=True, **ask)


def test_what_cannot_vary_is_told():
    with pytest.raises(InputError, match="slider_edge follows from the lengths: give it in `fixed`"):
        problem(Robust("peak_force", {"slider_edge": 1e-4}), fixed={})
    with pytest.raises(InputError, match="let density vary"):
        problem(Robust("peak_force", {"leg.mass": "1 %"}))
    with pytest.raises(InputError, match=r"sigma of geometry\.R: expected"):
        problem(Robust("peak_force", {"R": "1 kg"}))
