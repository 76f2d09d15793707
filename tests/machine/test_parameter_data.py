"""Parameters as plain data: to dictionaries and back, copies, and what the readers refuse."""

import copy
import dataclasses
import json
import pickle

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from machines import SEEDS, random_machine
from parameter_files import ACCEPTED, REFUSED, VALIDATOR

import p3dof
from p3dof import PAPER, SOLIDS, Parameters
from p3dof._base.errors import ParameterError
from p3dof.machine import Actuators, Body, Friction, Limits
from p3dof.machine.parameters import PASSIVE, SLIDES


def rich_machine(seed):
    """A random machine with friction, actuators, limits and payloads."""
    rng = np.random.default_rng(seed)
    some = {name: float(rng.uniform(0, 3)) for name in (*SLIDES, *PASSIVE) if rng.random() < 0.5}
    machine = dataclasses.replace(
        random_machine(seed),
        limits=Limits((-rng.random() - 1e-3, rng.random() + 1e-3), rng.random() + 0.1, rng.random() + 0.1),
        friction=Friction(some, {"sliders": rng.random()}, rng.random() + 1e-9),
        actuators=Actuators(
            {"sliders": rng.random()}, {"slide_c": rng.normal()}, {"slide_a": rng.normal()}, {"slide_b": 0.5}
        ),
    )
    for _ in range(rng.integers(0, 3)):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        inertia = turn @ np.diag(rng.uniform(0.1, 0.15, 3)) @ turn.T
        machine = machine.carrying(Body(rng.random() + 0.1, rng.normal(size=3), (inertia + inertia.T) / 2))
    return machine


def numbers(thing):
    """All numbers of a tree, as their bits, with their places."""
    if isinstance(thing, dict):
        return {(key, *place): x for key, value in thing.items() for place, x in numbers(value).items()}
    if isinstance(thing, list):
        return {(i, *place): x for i, value in enumerate(thing) for place, x in numbers(value).items()}
    assert type(thing) is float
    return {(): thing.hex()}


def assert_same_machine(one, other):
    assert numbers(one.to_dict()) == numbers(other.to_dict())
    for (_, mine), (_, theirs) in zip(one.bodies.items(), other.bodies.items(), strict=True):
        assert (mine.mass, mine.com.tolist(), mine.inertia.tolist()) == (
            theirs.mass,
            theirs.com.tolist(),
            theirs.inertia.tolist(),
        )
    assert len(one.payloads) == len(other.payloads)


@settings(max_examples=40)
@given(SEEDS)
def test_plain_data_hold_every_bit_also_through_json(seed):
    machine = rich_machine(seed)
    data = machine.to_dict()
    assert_same_machine(Parameters.from_dict(data, any_size=True), machine)
    assert_same_machine(Parameters.from_dict(json.loads(json.dumps(data)), any_size=True), machine)
    VALIDATOR.validate(data)


@pytest.mark.parametrize("machine", [PAPER, SOLIDS, rich_machine(5)], ids=["paper", "solids", "rich"])
def test_plain_data_are_what_the_file_holds(machine, tmp_path):
    p3dof.write_parameters(machine, tmp_path / "machine.yaml")
    held = yaml.safe_load((tmp_path / "machine.yaml").read_text(encoding="utf-8"))
    assert numbers(held) == numbers(machine.to_dict())


def test_plain_data_belong_to_the_caller():
    data = PAPER.to_dict()
    data["geometry"]["r"] = 0.12
    data["bodies"]["leg_a"]["com"][0] = 0.3
    changed = Parameters.from_dict(data)
    assert (changed.geometry.r, changed.bodies.leg_a.com[0]) == (0.12, 0.3)
    assert (PAPER.geometry.r, PAPER.to_dict()["geometry"]["r"]) == (0.1, 0.1)


def test_from_dict_takes_tuples_arrays_and_units():
    data = PAPER.to_dict()
    data["limits"]["travel"] = ("-200 mm", "20 cm")
    data["gravity"] = np.array([0, 0, -9.81])
    data["bodies"]["leg_a"]["mass"] = np.float64(2)
    machine = Parameters.from_dict(data)
    assert machine.limits.travel == (-0.2, 0.2)
    assert machine.gravity[2] == -9.81
    assert machine.bodies.leg_a.mass == 2


@pytest.mark.parametrize("data", ACCEPTED.values(), ids=ACCEPTED)
def test_from_dict_takes_what_a_file_may_hold(data, tmp_path):
    (tmp_path / "machine.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    assert_same_machine(Parameters.from_dict(data), p3dof.read_parameters(tmp_path / "machine.yaml"))


@pytest.mark.parametrize("data", REFUSED.values(), ids=REFUSED)
def test_from_dict_refuses_in_the_words_of_the_file_reader(data, tmp_path):
    path = tmp_path / "machine.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    with pytest.raises(ParameterError) as of_file:
        p3dof.read_parameters(path)
    with pytest.raises(ParameterError) as of_data:
        Parameters.from_dict(data, source=str(path))
    assert str(of_data.value) == str(of_file.value)
    assert "\n" not in str(of_data.value)


ITSELF: list = []
ITSELF.append(ITSELF)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ("geometry", PAPER.geometry, "parameters: geometry: expected the fields r, R, L, b, got a Geometry"),
        ("gravity", ITSELF, "parameters: gravity"),
        ("gravity", {"z": -9.8}, "parameters: gravity: expected real numbers, got a dict"),
        ("gravity", [0, 0, 1j], "parameters: gravity: expected real numbers, got complex numbers"),
        ("payload", object(), "parameters: payload: expected the fields mass, com, inertia, about, got an"),
        ("friction", {"viscous": {3: 1}}, "parameters: friction: viscous: unknown joint 3"),
        ("actuators", {"spring": {3: 1}}, "parameters: actuators: spring: unknown slide 3"),
        ("actuators", {"spring": 3}, "parameters: actuators: spring: expected numbers by slide, got 3"),
        (7, {}, "parameters: unknown field '7'"),
    ],
)
def test_from_dict_refuses_what_no_file_holds(place, value, message):
    with pytest.raises(ParameterError) as caught:
        Parameters.from_dict({**PAPER.to_dict(), place: value})
    assert str(caught.value).startswith(message)


def test_from_dict_takes_millimetres_for_metres_only_if_it_must():
    data = PAPER.to_dict()
    data["geometry"] = {"r": 100.0, "R": 250.0, "L": 400.0, "b": 50.0}
    with pytest.raises(ParameterError, match="parameters: geometry: L = 400 m is more than 20 m"):
        Parameters.from_dict(data)
    assert Parameters.from_dict(data, any_size=True).geometry.L == 400


def test_parameters_go_through_dataclasses_copies_and_pickles():
    machine = rich_machine(8)
    plain = dataclasses.asdict(p3dof.load(machine).parameters)
    assert plain["geometry"] == dataclasses.asdict(machine.geometry)
    assert plain["friction"] == machine.friction.to_dict()
    assert type(plain["friction"]["viscous"]) is dict
    plain["friction"]["viscous"]["slide_a"] = -1.0
    plain["bodies"]["platform"]["com"][0] = 9.0
    for other in (machine, copy.deepcopy(machine), copy.copy(machine), pickle.loads(pickle.dumps(machine))):  # noqa: S301
        assert_same_machine(other, rich_machine(8))
        with pytest.raises(TypeError):
            other.friction.viscous["slide_a"] = -1.0
    assert dataclasses.replace(machine, friction=copy.deepcopy(machine.friction)).friction.viscous == dict(
        machine.friction.viscous
    )
