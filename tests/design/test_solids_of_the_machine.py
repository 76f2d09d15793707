"""Sizes and density that a machine file gives its solids are those of whatever is made of solids.

The references are machines whose bodies are written out, by mass and inertia of cubes, rods and a plate.
"""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

import p3dof
from p3dof._base.errors import InputError, ParameterError
from p3dof.analysis.designs import Designs, forces_of_designs
from p3dof.cli import main
from p3dof.design import DesignProblem
from p3dof.design.clearance import CollisionModel, Surroundings
from p3dof.design.optimisation import Box, Robust, read_problem
from p3dof.machine import Body, Geometry
from p3dof.machine.description.shapes import Solids
from p3dof.machine.parameters import (
    PAPER,
    STEEL_DENSITY,
    Bodies,
    Dimensions,
    Parameters,
    of_solids,
    rounded_plate,
    write_parameters,
)
from p3dof.viewer.machine.room import Room

LENGTHS = {"r": 0.14, "R": 0.32, "L": 0.55, "b": 0.07}
ALUMINIUM = {
    "geometry": {name: f"{1e3 * length:g} mm" for name, length in LENGTHS.items()},
    "bodies": "solids",
    "density": "2700 kg/m^3",
    "dimensions": {"rod_radius": "10 mm"},
}
PLAIN = {"r": 0.1, "R": 0.25, "L": 0.4, "b": 0.05}
STEEL = {"geometry": PLAIN, "bodies": "solids", "dimensions": {"rod_radius": "5 mm"}}
MOTION = p3dof.paper_motion(201)
KINDS = ("slider", "leg", "crossbar", "platform")


def by_hand(density=2700.0, radius=0.01, rods=None, **lengths):
    """Return a machine of written bodies: sizes that are not given are the paper's by the least ratio."""
    geometry = Geometry(**LENGTHS | lengths)
    ratio = min(geometry.L / 0.4, geometry.r / 0.1, geometry.b / 0.05, (geometry.R - geometry.r) / 0.15)
    edge, rods = 0.05 * ratio, density if rods is None else rods

    def rod(length, axis, middle):
        mass = rods * math.pi * radius**2 * length
        inertia = np.full(3, mass * (length**2 / 12 + radius**2 / 4))
        inertia[axis] = mass * radius**2 / 2
        return Body(mass, middle * np.eye(3)[axis], inertia)

    corners = geometry.r * np.array([[0.0, -1.0], [0.0, 1.0], [-1.0, 0.0]])
    bodies = Bodies.alike(
        slider=Body(density * edge**3, np.zeros(3), np.full(3, density * edge**5 / 6)),
        leg=rod(geometry.L, 0, geometry.L / 2),
        crossbar=rod(2 * geometry.b, 1, 0.0),
        platform=rounded_plate(corners, 0.02 * ratio, 0.05 * ratio, density),
    )
    return Parameters(geometry, bodies)


def steel(radius=0.005, **lengths):
    return by_hand(STEEL_DENSITY, radius, **PLAIN | lengths)


def peaks(machine, motion=MOTION):
    return np.abs(p3dof.load(machine).inverse_dynamics(motion, method="pinocchio").forces).max(axis=0)


def alike(one, other):
    for (name, body), (_, given) in zip(one.bodies.items(), other.bodies.items(), strict=True):
        assert body.mass == pytest.approx(given.mass, rel=1e-12), name
        assert_allclose(body.com, given.com, atol=1e-12)
        assert_allclose(body.inertia, given.inertia, rtol=1e-11, atol=1e-13)


@pytest.fixture
def file(tmp_path):
    (tmp_path / "machine.yaml").write_text(yaml.safe_dump(ALUMINIUM))
    return tmp_path / "machine.yaml"


@pytest.fixture
def machine(file):
    return p3dof.read_parameters(file)


def run(capsys, *words):
    assert main([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


# ---------------------------------------------------------------- the machine itself


def test_a_file_keeps_what_its_solids_are_made_of(machine):
    alike(machine, by_hand())
    assert machine.dimensions == {"rod_radius": 0.01}
    assert machine.density == dict.fromkeys(KINDS, 2700.0)
    ratio = 0.18 / 0.15  # the least
    assert machine.sizes == Dimensions(0.05 * ratio, 0.01, 0.05 * ratio, 0.02 * ratio)
    assert peaks(machine)[0] == pytest.approx(88.6798, abs=5e-5)  # as `p3dof forces` has it
    assert PAPER.dimensions == {}
    assert PAPER.density == dict.fromkeys(KINDS, STEEL_DENSITY)
    metals = Parameters.from_dict({**ALUMINIUM, "density": {"leg": 2700, "crossbar": "2700 kg/m^3"}})
    assert metals.density == {"slider": 7801.0, "leg": 2700.0, "crossbar": 2700.0, "platform": 7801.0}
    alike(metals, by_hand(STEEL_DENSITY, rods=2700.0))


def test_a_written_machine_is_read_back_with_its_solids(machine, tmp_path):
    for one in (machine, of_solids(density={"leg": 2700.0}), machine.carrying(Body(2.0, [0, 0, -0.1]))):
        write_parameters(one, tmp_path / "out.yaml")
        again = p3dof.read_parameters(tmp_path / "out.yaml")
        assert again.to_dict() == one.to_dict()
        assert json.loads(json.dumps(one.to_dict())) == one.to_dict()
        assert (again.dimensions, again.density, again.sizes) == (one.dimensions, one.density, one.sizes)
        assert copy.copy(one).to_dict() == one.to_dict()
    assert "density" not in PAPER.to_dict()
    assert "dimensions" not in PAPER.to_dict()


def test_another_geometry_keeps_bodies_and_the_sizes_given(machine):
    longer = replace(machine, geometry=replace(machine.geometry, R=0.2, L=0.6))
    assert longer.bodies is machine.bodies
    assert longer.sizes == Dimensions(0.05 * 0.4, 0.01, 0.05 * 0.4, 0.02 * 0.4)  # by (R - r) = 60 of 150 mm
    alike(longer.solid, by_hand(R=0.2, L=0.6))
    load = Body(2.0, [0, 0, -0.1], [0.01, 0.02, 0.03])
    laden = replace(machine.carrying(load), geometry=longer.geometry).solid
    assert [body.to_dict() for body in laden.payloads] == [load.to_dict()]
    alike(laden.unladen, by_hand(R=0.2, L=0.6))


def test_beside_bodies_of_ones_own_they_change_no_force():
    data = by_hand().to_dict() | {"density": 9000, "dimensions": {"rod_radius": "4 mm"}}
    given = Parameters.from_dict(data)
    assert peaks(given).tolist() == peaks(by_hand()).tolist()
    assert given.sizes.rod_radius == 0.004
    alike(given.solid, by_hand(9000.0, 0.004))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"dimensions": 3}, "dimensions: expected sizes by name, got 3"),
        ({"dimensions": {"rod": 1.0}}, "dimensions: expected slider_edge, rod_radius, .*got 'rod'"),
        ({"dimensions": {"rod_radius": 0.0}}, r"dimensions\.rod_radius: expected .* got 0"),
        ({"density": {"legs": 2700.0}}, "density: unknown kind 'legs'"),
        ({"density": {"leg": -1.0}}, "density: expected .* got -1"),
        ({"density": math.nan}, "density: expected .* got nan"),
    ],
)
def test_sizes_and_densities_that_are_none(given, words):
    with pytest.raises(ParameterError, match=words):
        replace(PAPER, **given)


# ---------------------------------------------------------------- designs


def test_designs_of_solids_start_from_the_file(machine):
    columns = {"L": [0.55, 0.5, 0.6], "R": [0.32, 0.32, 0.25]}
    found = forces_of_designs(columns, MOTION, machine=machine, bodies="solids")
    wanted = [peaks(by_hand(L=L, R=R)) for L, R in zip(*columns.values(), strict=True)]
    assert_allclose(found.peak_force, wanted, rtol=1e-10)
    assert found.peak_force[0, 0] == pytest.approx(88.6798, abs=5e-5)
    designs = Designs(columns, machine, "solids")
    for number, (L, R) in enumerate(zip(*columns.values(), strict=True)):
        alike(designs[number], by_hand(L=L, R=R))
        assert designs[number].dimensions == machine.dimensions
        assert designs[number].density == machine.density


def test_columns_replace_what_the_file_gives(machine):
    columns = {"rod_radius": [0.012, 0.007], "density": [7801.0, 4500.0]}
    found = forces_of_designs(columns, MOTION, machine=machine, bodies="solids")
    rows = list(zip(*columns.values(), strict=True))
    assert_allclose(
        found.peak_force, [peaks(by_hand(density, radius)) for radius, density in rows], rtol=1e-10
    )
    one = Designs(columns, machine, "solids")[1]
    assert (one.density, one.dimensions) == (dict.fromkeys(KINDS, 4500.0), {"rod_radius": 0.007})


def test_metals_by_kind_stay_those_of_their_kinds():
    metals = Parameters.from_dict({**STEEL, "density": {"leg": 2700, "crossbar": 2700}})
    load = Body(2.0, [0.0, 0.01, -0.1], [0.01, 0.02, 0.03])
    found = forces_of_designs(
        {"L": [0.4, 0.45], "slider_a.mass": [1.0, 1.2]},
        MOTION,
        machine=metals.carrying(load),
        bodies="solids",
    )
    for number, (L, mass) in enumerate(((0.4, 1.0), (0.45, 1.2))):
        reference = by_hand(STEEL_DENSITY, 0.005, 2700.0, **PLAIN | {"L": L})
        slider = replace(reference.bodies.slider_a, mass=mass)
        reference = replace(reference, bodies=replace(reference.bodies, slider_a=slider)).carrying(load)
        assert_allclose(found.peak_force[number], peaks(reference), rtol=1e-10)


def test_whether_a_body_is_possible_is_asked_of_the_sizes_of_the_file(machine):
    """A rod's moments across may differ by no more than that along: those of another radius would."""
    across = by_hand().bodies.leg_a.inertia[2, 2]
    columns = {"leg.inertia.yy": [across, 1.1 * across]}
    found = forces_of_designs(columns, MOTION, machine=machine, bodies="solids")
    assert found.feasible.tolist() == [True, False]


def test_gradients_of_designs_of_given_sizes(machine):
    """By R, the sizes that are not given follow: the least ratio is that of R - r."""
    for name, at in (("R", 0.32), ("L", 0.55)):
        found = forces_of_designs({name: [at]}, MOTION, machine=machine, bodies="solids", gradients=(name,))
        ends = [peaks(by_hand(**{name: at + sign * 1e-6})) for sign in (1, -1)]
        slope = found.gradients[f"geometry.{name}"]["peak_force"]
        assert_allclose(np.ravel(slope), (ends[0] - ends[1]) / 2e-6, rtol=1e-5)


def test_the_command_of_designs(file, tmp_path):
    (tmp_path / "designs.csv").write_text("L [mm]\n550\n500\n")
    out = tmp_path / "found.csv"
    words = ("designs", tmp_path / "designs.csv", "--parameters", file, "--samples", "201", "--solids")
    assert main([*map(str, words), "--out", str(out)]) == 0
    header, *rows = [line.split(",") for line in out.read_text().splitlines()]
    first = header.index("peak_force_a [N]")
    found = [[float(number) for number in row[first : first + 3]] for row in rows]
    assert_allclose(found, [peaks(by_hand()), peaks(by_hand(L=0.5))], rtol=1e-9)


# ---------------------------------------------------------------- uncertain machines


def test_tolerances_are_about_the_sizes_of_the_file(machine):
    sigma = {"rod_radius": "0.1 mm", "density": "1 %", "plate_thickness": 1e-4}
    found = p3dof.tolerance(machine, MOTION, sigma=sigma, bodies="solids")
    assert found.nominal.tolist() == [0.01, 2700.0, pytest.approx(0.06, rel=1e-15)]
    assert_allclose(found.peak[:3], peaks(by_hand()), rtol=1e-10)
    step = 1e-6
    slope = (peaks(by_hand(radius=0.01 + step)) - peaks(by_hand(radius=0.01 - step))) / (2 * step)
    assert_allclose(found.peak_gradient[:3, 0], slope, rtol=1e-5)
    assert_allclose(found.peak_gradient[:3, 1], peaks(by_hand()) / 2700.0, rtol=1e-10)  # all are solids
    drawn = p3dof.tolerance(machine, MOTION, sigma=sigma, bodies="solids", method="montecarlo", samples=512)
    assert drawn.peak_mean[3] == pytest.approx(found.peak[3], rel=5e-3)


def test_one_density_of_several_metals_has_no_nominal():
    metals = of_solids(density={"leg": 2700.0})
    words = "density: differs by kind of body in the machine"
    with pytest.raises(InputError, match=words):
        p3dof.tolerance(metals, MOTION, sigma={"density": "1 %"}, bodies="solids")
    told = p3dof.tolerance(metals, MOTION, sigma={"density": "1 %"}, bodies="solids", fixed={"density": 2700})
    assert_allclose(told.peak[:3], peaks(of_solids(density=2700.0)), rtol=1e-10)
    kept = p3dof.tolerance(metals, MOTION, sigma={"R": 1e-4}, bodies="solids")
    assert_allclose(kept.peak[:3], peaks(metals), rtol=1e-10)
    problem = DesignProblem({"density": (2e3, 8e3)}, MOTION, machine=metals, bodies="solids")
    assert np.isnan(problem.start).all()


def test_the_commands_of_uncertain_machines(tmp_path, capsys):
    (tmp_path / "steel.yaml").write_text(yaml.safe_dump(STEEL))
    ask = ("--parameters", tmp_path / "steel.yaml", "--solids", "--samples", "201")
    wanted = peaks(steel()).max()
    assert wanted == pytest.approx(103.55, abs=0.005)
    told = run(capsys, "tolerance", *ask, "--sigma", "rod_radius=0.1 mm")
    assert told["nominal"] == [0.005]
    assert told["peak"][3] == pytest.approx(wanted, rel=1e-10)
    told = run(capsys, "sensitivity", *ask, "--local", "--vary", "rod_radius=1 %")
    assert told["nominal"] == [0.005]
    assert told["value"] == pytest.approx(wanted, rel=1e-10)
    step = 1e-6
    ends = [peaks(steel(radius=0.005 + sign * step)).max() for sign in (1, -1)]
    assert told["gradient"][0] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)


def test_a_sweep_of_solids(tmp_path, capsys):
    (tmp_path / "machine.yaml").write_text(yaml.safe_dump(STEEL))
    data = {
        "machine": "machine.yaml", "motion": {"paper": 201}, "bodies": "solids",
        "variables": {"L": {"values": [0.4, 0.45]}},
        "reductions": [{"top": "peak_force", "count": 2}],
    }  # fmt: skip
    (tmp_path / "sweep.yaml").write_text(yaml.safe_dump(data))
    told = run(capsys, "sweep", tmp_path / "sweep.yaml", "--out", tmp_path / "out")
    for L in (0.4, 0.45):
        assert f"{peaks(steel(L=L)).max():.6g}"[:6] in json.dumps(told)


# ---------------------------------------------------------------- optima


def asked(machine, **variables):
    return DesignProblem(variables or {"L": (0.45, 0.6)}, MOTION, machine=machine, bodies="solids")


def test_an_optimisation_begins_at_the_machine_of_the_file(machine):
    problem = asked(machine, rod_radius=(0.005, 0.02), L=(0.45, 0.6))
    assert problem.solids == KINDS
    assert problem.start.tolist() == [0.01, 0.55]
    at = problem.evaluate([problem.start, [0.008, 0.5]])["peak_force"]
    assert_allclose(at, [peaks(by_hand()).max(), peaks(by_hand(radius=0.008, L=0.5)).max()], rtol=1e-10)
    density = asked(machine, density=(2e3, 8e3))
    assert density.start.tolist() == [2700.0]


def test_lengths_alone_take_the_bodies_of_the_file_with_them(machine):
    problem = asked(machine)
    assert problem.solids == KINDS
    assert problem.evaluate([0.5])["peak_force"][0] == pytest.approx(peaks(by_hand(L=0.5)).max(), rel=1e-10)
    made = problem.machine([0.5])
    alike(made, by_hand(L=0.5))
    assert made.bodies.leg_a.com.tolist() == [0.25, 0.0, 0.0]
    assert made.sizes.rod_radius == 0.01
    other = replace(machine.bodies.platform, mass=9.0)
    own = replace(machine, bodies=replace(machine.bodies, platform=other))
    assert asked(own).solids == ("slider", "leg", "crossbar")
    made = asked(own).machine([0.5])
    assert made.bodies.platform.to_dict() == other.to_dict()
    platform = by_hand(L=0.5).bodies.platform
    alike(replace(made, bodies=replace(made.bodies, platform=platform)), by_hand(L=0.5))


def test_what_the_problem_says_goes_before_the_file(machine):
    problem = DesignProblem(
        {"L": (0.45, 0.6)}, MOTION, machine=machine, bodies="solids",
        fixed={"rod_radius": "7 mm", "density": 4500},
    )  # fmt: skip
    assert problem.solids == KINDS
    wanted = peaks(by_hand(4500.0, 0.007, L=0.5)).max()
    assert problem.evaluate([0.5])["peak_force"][0] == pytest.approx(wanted, rel=1e-10)


def test_measures_of_solids_have_the_sizes_and_density_of_the_file(machine):
    names = ["rod_buckling", "rod_frequency", "clearance", "motion_clearance"]
    problem = DesignProblem(
        {"L": (0.45, 0.6)}, MOTION, names,
        machine=machine, bodies="solids", box=Box((-0.01, 0.01), (-0.1, 0.1)), modulus=70e9,
    )  # fmt: skip
    found = problem.evaluate([0.5])
    second = math.pi * 0.01**4 / 4
    assert found["rod_buckling"][0] == pytest.approx(math.pi**2 * 70e9 * second / 0.5**2, rel=1e-12)
    linear = 2700 * math.pi * 0.01**2
    frequency = math.pi / (2 * 0.5**2) * math.sqrt(70e9 * second / linear)
    assert found["rod_frequency"][0] == pytest.approx(frequency, rel=1e-12)
    metals = replace(machine, density={"leg": 2700.0})
    apart = DesignProblem(
        {"L": (0.45, 0.6)}, MOTION, ["rod_frequency"], machine=metals.solid, bodies="solids", modulus=70e9
    )
    assert apart.evaluate([0.5])["rod_frequency"][0] == pytest.approx(frequency, rel=1e-12)
    bare = replace(problem.machine([0.5]), dimensions={})
    around = CollisionModel(bare, Surroundings(dimensions={"rod_radius": 0.01}))
    assert found["motion_clearance"][0] == around.distances(MOTION.pose).min()
    rods = DesignProblem(
        {"L": (0.45, 0.6)}, MOTION, ["clearance"], machine=replace(machine, dimensions={"rod_radius": 0.068}),
        bodies="solids",
    )  # fmt: skip
    assert rods.evaluate([0.5])["clearance"][0] == pytest.approx(2 * 0.07 - 2 * 0.068, rel=1e-9)


def test_relations_of_density_know_that_of_the_file(machine):
    def keeps(which, relation):
        problem = DesignProblem(
            {"L": (0.45, 0.6)}, MOTION, constraints={"relations": [relation]}, machine=which, bodies="solids"
        )
        return bool(problem.evaluate([0.5]).feasible[0])

    assert keeps(machine, "density <= 2701")
    assert not keeps(machine, "density <= 2699")
    assert keeps(machine, "rod_radius <= 0.0101")
    assert not keeps(machine, "rod_radius <= 0.0099")
    with pytest.raises(InputError, match="density: has no number of its own"):
        keeps(of_solids(Geometry(**LENGTHS), density={"leg": 2700.0}), "density <= 2701")


def test_robust_measures_spread_about_the_file(machine):
    """The worst of two machines, whose rods are 1 % thinner or thicker, or of lighter and denser ones."""
    for sigma, spread in (
        ({"rod_radius": "1 %"}, [by_hand(radius=0.01 * by, L=0.5) for by in (0.99, 1.01)]),
        ({"density": "1 %"}, [by_hand(2700.0 * by, L=0.5) for by in (0.99, 1.01)]),
    ):
        worst = Robust("peak_force", sigma, k=1, kind="worst")
        problem = DesignProblem({"L": (0.45, 0.6)}, MOTION, [worst], machine=machine, bodies="solids")
        wanted = max(peaks(one).max() for one in spread)
        assert problem.evaluate([0.5])[worst.name][0] == pytest.approx(wanted, rel=1e-10)
    loose = Robust("peak_force", {"slider_edge": "1 %"}, k=1, kind="worst")
    with pytest.raises(InputError, match="slider_edge follows from the lengths"):
        DesignProblem({"L": (0.45, 0.6)}, MOTION, [loose], machine=machine, bodies="solids")


@pytest.mark.parametrize("command", ["optimise", "pareto"])
def test_the_commands_of_optima(command, file, tmp_path, capsys):
    assert file.parent == tmp_path
    data = {
        "machine": "machine.yaml", "motion": {"paper": 51}, "bodies": "solids",
        "variables": {"L": ["500 mm", "560 mm"]},
    }  # fmt: skip
    data |= {"objectives": ["peak_force", "moving_mass"]} if command == "pareto" else {}
    (tmp_path / "problem.yaml").write_text(yaml.safe_dump(data))
    problem = read_problem(tmp_path / "problem.yaml")
    assert problem.start.tolist() == [0.55]
    if command == "pareto":
        mass = problem.evaluate([0.5])["moving_mass"][0]
        assert mass == pytest.approx(by_hand(L=0.5).bodies.mass, rel=1e-12)
        return
    assert main(["optimise", str(tmp_path / "problem.yaml"), "--starts", "1"]) == 0
    told = capsys.readouterr().out
    assert "Bodies" in told
    assert f"{4 * 2700 * math.pi * 0.01**2 * 0.55:.6g}"[:6] in told  # legs of the file
    short = p3dof.paper_motion(51)
    assert f"{peaks(by_hand(), short).max():.6g}"[:6] in told


# ---------------------------------------------------------------- space


def test_parts_are_as_thick_as_the_file_says(machine):
    home = np.zeros((1, 3))
    alone, repeated, other = (
        dict(zip(model.names, model.distances(home)[0], strict=True))
        for model in (
            CollisionModel(machine),
            CollisionModel(machine, Surroundings(dimensions={"rod_radius": 0.01})),
            CollisionModel(machine, Surroundings(dimensions={"rod_radius": 0.012})),
        )
    )
    assert alone == repeated
    (rods,) = [pair for pair in alone if set(pair) == {"rod_left", "rod_right"}]
    assert alone[rods] == pytest.approx(2 * 0.07 - 2 * 0.01, abs=1e-9)
    assert other[rods] == pytest.approx(2 * 0.07 - 2 * 0.012, abs=1e-9)


def test_the_clearance_of_a_plan_is_that_of_the_file(file, tmp_path, capsys):
    rows = [{"pose": [0, 0, 0]}, {"pose": ["80 mm", 0, 0], "duration": 1}]
    (tmp_path / "task.yaml").write_text(yaml.safe_dump({"waypoints": rows}))
    (tmp_path / "around.yaml").write_text(yaml.safe_dump({"dimensions": {"rod_radius": "10 mm"}}))
    ask = ("plan", tmp_path / "task.yaml", "--parameters", file, "--clearance", "0")
    alone, repeated = run(capsys, *ask), run(capsys, *ask, "--surroundings", tmp_path / "around.yaml")
    assert alone["tables"] == repeated["tables"]


def test_drawn_and_exported_parts_have_the_sizes_of_the_file(machine):
    drawn = Solids(machine)
    assert drawn.visuals["leg_a"][0].shape.radius == 0.01
    assert drawn.collisions["rod_left"][0].shape.radius == 0.01
    assert drawn.visuals["slider_a"][0].shape.size == (0.06, 0.06, 0.06)
    robot = p3dof.load(machine)
    leg = next(one for one in robot.visual_model.geometryObjects if one.name.startswith("leg_a"))
    assert leg.geometry.radius == 0.01
    assert Room.around(machine).size == machine.sizes
