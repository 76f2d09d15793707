"""Reflected inertia and balance at the sliders: as parameters, and in the dynamics everywhere."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

import p3dof
from p3dof import PAPER, Actuators, ParameterError

SOME = Actuators(
    armature={"sliders": 14.8, "slide_c": 2.5},
    counterbalance={"slide_a": 48.15, "slide_c": -5},
    spring={"slide_b": -420.0},
    counterweight={"slide_b": 4.9},
)


def test_numbers_are_by_slide_and_the_group_comes_first():
    assert dict(SOME.armature) == {"slide_a": 14.8, "slide_b": 14.8, "slide_c": 2.5}
    assert dict(Actuators({"slide_c": 2.5, "sliders": 14.8}).armature) == dict(SOME.armature)
    np.testing.assert_array_equal(SOME.inertia, [14.8, 14.8 + 4.9, 2.5])
    np.testing.assert_array_equal(SOME.stiffness, [0, -420, 0])
    np.testing.assert_array_equal(SOME.balance_at_home(np.array([1, 2, -9.806])), [48.15, 4.9 * 9.806, -5])
    assert SOME.slides == ("slide_a", "slide_b", "slide_c")
    assert not Actuators({"sliders": 0})
    assert not PAPER.actuators


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"armature": {"hinge_a": 1}},
            "armature: unknown slide 'hinge_a', expected one of sliders, slide_a, ",
        ),
        ({"armature": {"slide_a": -1}}, "armature.slide_a: expected zero or more, got -1"),
        ({"counterweight": {"sliders": -0.5}}, "counterweight.sliders: expected zero or more, got -0.5"),
        ({"spring": {"slide_b": float("nan")}}, "spring.slide_b: expected a finite number, got nan"),
        ({"counterbalance": {"slide_b": "x"}}, "counterbalance.slide_b: expected real numbers"),
        ({"counterbalance": 48}, "counterbalance: expected numbers by slide, got 48"),
    ],
)
def test_errors_name_the_number(given, message):
    with pytest.raises(ParameterError) as caught:
        Actuators(**given)
    assert str(caught.value).startswith(message)


def test_parameters_hold_only_actuators():
    with pytest.raises(ParameterError, match="actuators: expected Actuators, got dict"):
        dataclasses.replace(PAPER, actuators={"armature": {"sliders": 1}})


def test_a_file_gives_the_same_machine_back(tmp_path):
    machine = dataclasses.replace(PAPER, actuators=SOME)
    path = tmp_path / "machine.yaml"
    p3dof.write_parameters(machine, path)
    for same in (
        p3dof.read_parameters(path),
        p3dof.Parameters.from_dict(machine.to_dict()),
        pickle.loads(pickle.dumps(machine)),  # noqa: S301 - our own
        copy.deepcopy(machine),
    ):
        assert same.actuators.to_dict() == SOME.to_dict()
    assert machine.carrying(PAPER.bodies.leg_a).unladen.actuators.to_dict() == SOME.to_dict()
    with pytest.raises(TypeError):
        machine.actuators.armature["slide_a"] = 1
    assert "actuators" not in PAPER.to_dict()


def test_a_file_may_have_units():
    data = {
        **PAPER.to_dict(),
        "actuators": {"armature": {"sliders": "900 g"}, "spring": {"slide_a": "2 N/mm"}},
    }
    found = p3dof.Parameters.from_dict(data).actuators
    assert found.armature["slide_b"] == 0.9
    assert found.spring["slide_a"] == 2000


def test_tables_and_pages_show_them():
    machine = dataclasses.replace(PAPER, actuators=SOME)
    table = next(t for t in p3dof.parameters.parameter_tables(machine) if t.title == "Actuators")
    assert table.rows[1][:5] == ("slide_b", 14.8, 0.0, -420.0, 4.9)
    assert "counterweight [kg]" in machine._repr_html_()
    assert "counterweight [kg]" not in PAPER._repr_html_()
