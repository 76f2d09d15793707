"""Bodies that somebody gave stay as they are where designs are made of solids, unless it is told."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from table_numbers import check_table, shows

import p3dof
from p3dof._base.errors import InputError
from p3dof.cli import main
from p3dof.design import DesignProblem
from p3dof.design.optimisation import Robust, optimum_tables, read_problem
from p3dof.machine import Body, Geometry
from p3dof.machine.parameters import SOLIDS, Dimensions, Parameters, of_solids

PLATFORM = p3dof.PAPER.bodies.platform
SHORT = p3dof.paper_motion(21)
OWN = Body(8.2, [0.0, 0.01, -0.02], [0.05, 0.06, 0.07])
GIVEN = {"slider_edge": 0.05, "plate_thickness": 0.05, "corner_radius": 0.02}
KINDS = ("slider", "leg", "crossbar", "platform")
STEEL = 7801.0


def with_platform(machine=p3dof.PAPER, body=OWN):
    return replace(machine, bodies=replace(machine.bodies, platform=body))


def problem(machine=None, bodies="solids", **further):
    bounds = further.pop("variables", {"R": (0.2, 0.3), "L": (0.35, 0.5), "rod_radius": (0.003, 0.015)})
    return DesignProblem(bounds, SHORT, machine=machine, bodies=bodies, **further)


@pytest.mark.parametrize("fixed", [{}, GIVEN])
@pytest.mark.parametrize("machine", [p3dof.PAPER, SOLIDS, of_solids(Geometry(r=0.12, R=0.28, L=0.45))])
def test_a_platform_of_ones_own_keeps_its_mass_and_inertia_while_legs_change(machine, fixed):
    asked = problem(with_platform(machine), fixed=fixed)
    assert asked.solids == ("slider", "leg", "crossbar")
    made = asked.machine([0.26, 0.45, 0.008])
    body = made.bodies.platform
    assert body.mass == 8.2
    assert body.com.tolist() == OWN.com.tolist()
    assert body.inertia.tolist() == OWN.inertia.tolist()
    assert made.bodies.leg_a.mass == pytest.approx(STEEL * np.pi * 0.008**2 * 0.45, rel=1e-12)
    forces = p3dof.load(made).inverse_dynamics(SHORT, method="pinocchio").forces
    assert asked.evaluate([0.26, 0.45, 0.008])["peak_force"][0] == pytest.approx(
        np.abs(forces).max(), rel=1e-11
    )


def test_what_nobody_gave_is_of_solids():
    sized = of_solids(p3dof.PAPER.geometry, Dimensions(**GIVEN, rod_radius=0.01), 2700.0)
    for machine, fixed in (
        (None, {}),
        (p3dof.PAPER, {}),
        (SOLIDS, GIVEN),
        (sized, {**GIVEN, "rod_radius": 0.01, "density": 2700.0}),
    ):
        assert problem(machine, fixed=fixed, variables={"R": (0.2, 0.3)}).solids == KINDS
    again = Parameters.from_dict(yaml.safe_load(yaml.safe_dump(SOLIDS.to_dict())), "a file")
    assert problem(again).solids == KINDS
    light = of_solids(density={"platform": 2700.0})
    assert problem(light).solids == KINDS  # of its own metals
    made = problem(light).machine([0.26, 0.45, 0.008]).bodies
    assert made.leg_a.mass == pytest.approx(STEEL * np.pi * 0.008**2 * 0.45, rel=1e-12)
    assert made.platform.mass == pytest.approx(light.bodies.platform.mass, rel=1e-12)


@pytest.mark.parametrize(
    "body",
    [
        replace(PLATFORM, mass=PLATFORM.mass * 1.001),
        replace(PLATFORM, com=PLATFORM.com + np.array([0, 0, 1e-3])),
        replace(PLATFORM, inertia=PLATFORM.inertia * 1.001),
    ],
)
def test_any_number_makes_a_body_ones_own(body):
    assert problem(with_platform(body=body)).solids == ("slider", "leg", "crossbar")


def test_a_size_that_varies_or_the_kind_by_name_tells_that_a_body_is_a_solid():
    own = with_platform()
    assert problem(own, variables={"plate_thickness": (0.03, 0.06)}).solids == KINDS
    assert problem(own, variables={"corner_radius": {"one_of": [0.02, 0.03]}}).solids == KINDS
    assert problem(own, {"platform": "solids"}, variables={"R": (0.2, 0.3)}).solids == ("platform",)
    assert problem(own, dict.fromkeys(KINDS, "solids")).solids == KINDS
    assert problem(own, {"platform": "kept", "leg": "solids"}).solids == ("leg",)
    legs = problem(None, {"leg": "solids"}).machine([0.26, 0.45, 0.008]).bodies.platform
    assert legs.to_dict() == PLATFORM.to_dict()
    nothing = problem(own, {"platform": "kept"}, variables={"R": (0.2, 0.3)})
    assert nothing.solids == ()
    assert nothing.setting.bodies == "kept"


def test_legs_that_differ_are_kept_each_and_masses_that_vary_vary():
    bodies = replace(p3dof.PAPER.bodies, leg_a=Body(2.0, [0.2, 0, 0], [0.01, 0.05, 0.05]), platform=OWN)
    machine = replace(p3dof.PAPER, bodies=bodies)
    asked = problem(machine, variables={"R": (0.2, 0.3), "platform.mass": (5.0, 9.0)})
    assert asked.solids == ("slider", "crossbar")
    made = asked.machine([0.25, 6.0])
    assert made.bodies.platform.mass == 6.0
    assert made.bodies.platform.com.tolist() == OWN.com.tolist()
    assert made.bodies.leg_a.to_dict() == bodies.leg_a.to_dict()
    assert made.bodies.leg_b.to_dict() == bodies.leg_b.to_dict()
    legs = problem(machine, variables={"leg.mass": (1.0, 2.0)}).machine([1.5])
    assert {legs.bodies.leg_a.mass, legs.bodies.rod_left.mass} == {1.5}
    assert legs.bodies.leg_a.com.tolist() == [0.2, 0, 0]


def test_a_payload_is_carried_once():
    laden = with_platform().carrying(Body(1.5, [0, 0, 0.05], [0.001, 0.001, 0.001]))
    assert problem(laden).machine([0.25, 0.4, 0.01]).bodies.platform.mass == pytest.approx(9.7, rel=1e-15)
    plain = p3dof.PAPER.carrying(1.5)
    assert problem(plain).solids == KINDS


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        ("steel", "expected 'kept' or 'solids'"),
        (3, "expected 'kept' or 'solids'"),
        (["leg"], "expected 'kept' or 'solids'"),
        ({"arm": "solids"}, "unknown kind 'arm', expected one of slider, leg, crossbar, platform"),
        ({"leg": "steel"}, r"bodies\.leg: expected 'kept' or 'solids', got 'steel'"),
        ({"leg": None}, r"bodies\.leg: expected 'kept' or 'solids', got None"),
    ],
)
def test_other_bodies_are_refused(bodies, message):
    with pytest.raises(InputError, match=message):
        problem(bodies=bodies)


@shows("p3dof.design.optimisation.pareto._bodies", "p3dof.design.optimisation.pareto.optimum_tables")
def test_a_table_says_which_bodies_are_of_solids_and_which_are_kept(tmp_path, capsys):
    machine = with_platform()
    (tmp_path / "machine.yaml").write_text(yaml.safe_dump(machine.to_dict()))
    data = {
        "machine": "machine.yaml", "motion": {"paper": 21}, "bodies": "solids",
        "variables": {"L": [0.4, 0.45], "rod_radius": [0.008, 0.01]},
        "fixed": {"slider_edge": 0.05},
    }  # fmt: skip
    (tmp_path / "problem.yaml").write_text(yaml.safe_dump(data))
    optimum = read_problem(tmp_path / "problem.yaml").minimise(starts=1)
    L, radius = optimum.design
    table = optimum_tables(optimum)[-1]
    rod, bodies = STEEL * np.pi * radius**2, machine.bodies
    rows = {
        "slider, all 3": ("solid", 3 * bodies.slider_a.mass, 3 * STEEL * 0.05**3),
        "leg, all 4": ("solid", 4 * bodies.leg_a.mass, 4 * rod * L),
        "crossbar, all 2": ("solid", 2 * bodies.crossbar_upper.mass, 2 * rod * 2 * machine.geometry.b),
        "platform": ("kept", 8.2, 8.2),
    }
    check_table(table, rows, header=(3, 4) if any(c.isdigit() for c in "".join(table.header)) else ())
    assert main(["optimise", str(tmp_path / "problem.yaml"), "--starts", "1"]) == 0
    told = capsys.readouterr().out
    assert "kept" in told
    assert "bodies: {platform: solids}" in told
    data["bodies"] = {"leg": "solids", "crossbar": "solids", "slider": "solids", "platform": "solids"}
    (tmp_path / "problem.yaml").write_text(yaml.safe_dump(data))
    other = read_problem(tmp_path / "problem.yaml")
    assert other.machine([0.4, 0.01]).bodies.platform.mass != 8.2
    assert optimum_tables(other.minimise(starts=1))[-1].note == ""


def test_the_mass_of_a_body_that_is_kept_may_spread():
    """Worst of two corners: forces of machines whose platform is 5 % lighter or heavier, inertia with it."""
    worst = Robust("peak_force", {"platform.mass": "5 %"}, k=1, kind="worst")
    asked = problem(with_platform(), objectives=[worst])
    at = [0.26, 0.45, 0.008]
    machine = asked.machine(at)
    peaks = []
    for share in (0.95, 1.05):
        body = Body(share * OWN.mass, OWN.com, share * OWN.inertia)
        found = p3dof.load(with_platform(machine, body)).inverse_dynamics(SHORT, method="pinocchio").forces
        peaks.append(np.abs(found).max())
    assert asked.evaluate(at)[worst.name][0] == pytest.approx(max(peaks), rel=1e-10)
    with pytest.raises(InputError, match="bodies of solids follow from their sizes"):
        problem(objectives=[worst]).evaluate(at)
