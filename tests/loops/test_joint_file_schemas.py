"""The schemas of the files about joints and the programs that read these agree, on good and on bad files."""

from __future__ import annotations

import copy
import json
from dataclasses import fields

import drives_schema
import joint_schemas
import jsonschema
import pytest
import yaml
from documents import ROOT

import p3dof
from p3dof._base.quantities import LENGTH
from p3dof.analysis.reactions import JOINTS
from p3dof.design.bearings import read_bearings

READERS = {
    "stiffness": p3dof.analysis.read_stiffness,
    "bearings": read_bearings,
    "load-friction": p3dof.analysis.read_load_friction,
}
SCHEMAS = {
    name: json.loads((ROOT / f"docs/reference/{name}.schema.json").read_text(encoding="utf-8"))
    for name in READERS
}
STIFFNESS = {
    "hinges": {"radial": "100 N/um", "axial": 5e7, "tilt": "10 N m/mrad"},
    "slides": {"lateral": "200 N/um", "tilt": "20 N m/mrad", "roll": "10 N m/mrad"},
    "universals": {"force": "80 N/um", "moment": 4e3},
    "rods": {"diameter": "20 mm", "young": "210 GPa", "poisson": 0.3},
    "joints": {"hinge_left": {"radial": "60 N/um"}, "slide_a": {"roll": 9e3}, "loop_a": {"moment": 2e3}},
    "misfit": {"shift": "5 um", "turn": "0.1 mrad"},
    "cuts": "points",
}
BEARING = {
    "name": "6001",
    "dynamic": "5.1 kN",
    "static": "2.4 kN",
    "X": 0.56,
    "Y": 1.6,
    "e": 0.27,
    "X0": 0.6,
    "Y0": 0.5,
}
GUIDE = {"dynamic": "10 kN", "basis": "50 km", "static": 16e3, "moments": ["120 Nm", "120 Nm", "150 Nm"]}
BEARINGS = {
    "hinges": BEARING,
    "guides": {**GUIDE, "centre": [0, "10 mm", "-30 mm"], "turn": "90 deg", "name": 15},
    "joints": {"hinge_left": {"dynamic": 6e3, "kind": "roller"}, "slide_b": GUIDE},
}
FRICTION = {
    "hinges": {"mu": 0.1, "radius": "8 mm"},
    "universals": {"mu": 0, "radius": 0.008},
    "slides": {"drag": "4 N", "mu": 0.01, "arm": "30 mm", "screw": 0.1},
    "joints": {"hinge_lower_right": "none", "hinge_platform": {"mu": 0.002}, "slide_c": {"drag": 0}},
    "smoothing": "1 mm/s",
}
MISSING = object()


def changed(data, path, value):
    data = copy.deepcopy(data)
    *parents, last = path.split(".")
    place = data
    for name in parents:
        place = place[name]
    if value is MISSING:
        del place[last]
    else:
        place[last] = value
    return data


ACCEPTED = [
    ("stiffness", STIFFNESS),
    ("stiffness", {}),
    ("stiffness", {"rods": "rigid"}),
    ("stiffness", {"misfit": {"shift": 0}}),
    ("bearings", BEARINGS),
    ("bearings", {"hinges": BEARING}),
    ("bearings", {"joints": {"loop_a": {"dynamic": 1}}}),
    ("load-friction", FRICTION),
    ("load-friction", {"joints": {"slide_a": {"mu": 0.1}}}),
    ("load-friction", {"joints": {"universal_a": {"mu": 0.1, "radius": "5 mm"}, "hinge_a": "none"}}),
]
REFUSED = [
    ("stiffness", []),
    ("stiffness", changed(STIFFNESS, "hinges.radial", 0)),
    ("stiffness", changed(STIFFNESS, "hinges.radial", "-60 N/um")),
    ("stiffness", changed(STIFFNESS, "hinges.radius", 1)),
    ("stiffness", changed(STIFFNESS, "slides.radial", 1)),
    ("stiffness", changed(STIFFNESS, "rods", "soft")),
    ("stiffness", changed(STIFFNESS, "rods.poisson", 0.5)),
    ("stiffness", changed(STIFFNESS, "rods.diameter", "20 kg")),
    ("stiffness", changed(STIFFNESS, "joints.elbow", {"radial": 1})),
    ("stiffness", changed(STIFFNESS, "joints.slide_a", {"radial": 1})),
    ("stiffness", changed(STIFFNESS, "misfit.shift", "-5 um")),
    ("stiffness", changed(STIFFNESS, "misfit.turn", -1)),
    ("stiffness", changed(STIFFNESS, "cuts", "welds")),
    ("stiffness", changed(STIFFNESS, "platform", {})),
    ("bearings", {}),
    ("bearings", {"joints": {}}),
    ("bearings", changed(BEARINGS, "hinges.dynamic", MISSING)),
    ("bearings", changed(BEARINGS, "guides.basis", MISSING)),
    ("bearings", changed(BEARINGS, "guides.moments", MISSING)),
    ("bearings", changed(BEARINGS, "guides.moments", [1, 2])),
    ("bearings", changed(BEARINGS, "guides.moments", [1, 0, 2])),
    ("bearings", changed(BEARINGS, "hinges.dynamic", "3 mm")),
    ("bearings", changed(BEARINGS, "hinges.static", 0)),
    ("bearings", changed(BEARINGS, "hinges.kind", "needle")),
    ("bearings", changed(BEARINGS, "hinges.Y", -1)),
    ("bearings", changed(BEARINGS, "hinges.name", [1])),
    ("bearings", changed(BEARINGS, "joints.slide_b", BEARING)),
    ("bearings", changed(BEARINGS, "joints.elbow", BEARING)),
    ("bearings", changed(BEARINGS, "guides.centre", [1, 2])),
    ("bearings", changed(BEARINGS, "guides.turn", "90 mm")),
    ("load-friction", {}),
    ("load-friction", {"smoothing": 1}),
    ("load-friction", changed(FRICTION, "hinges.radius", MISSING)),
    ("load-friction", changed(FRICTION, "hinges.mu", -0.1)),
    ("load-friction", changed(FRICTION, "hinges.mu", "0.1")),
    ("load-friction", changed(FRICTION, "hinges.radius", "8 N")),
    ("load-friction", changed(FRICTION, "slides.arm", 0)),
    ("load-friction", changed(FRICTION, "slides.drag", "-1 N")),
    ("load-friction", changed(FRICTION, "slides.radius", 1)),
    ("load-friction", changed(FRICTION, "joints.loop_a", "none")),
    ("load-friction", changed(FRICTION, "joints.slide_a", "much")),
    ("load-friction", changed(FRICTION, "smoothing", 0)),
    ("load-friction", changed(FRICTION, "hinges", MISSING)),  # hinge_platform then has no radius
]


def read(name, data, folder):
    path = folder / "file.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return READERS[name](path)


def validator(name):
    return jsonschema.Draft202012Validator(SCHEMAS[name])


@pytest.mark.parametrize(("name", "data"), ACCEPTED)
def test_both_accept(name, data, tmp_path):
    validator(name).validate(data)
    read(name, data, tmp_path)


@pytest.mark.parametrize(("name", "data"), REFUSED)
def test_both_refuse(name, data, tmp_path):
    assert not validator(name).is_valid(data)
    with pytest.raises(p3dof.errors.ParameterError, match=r"file\.yaml: "):
        read(name, data, tmp_path)


@pytest.mark.parametrize("name", SCHEMAS)
def test_they_are_schemas_that_know_all_joints(name):
    jsonschema.Draft202012Validator.check_schema(SCHEMAS[name])
    known = set(SCHEMAS[name]["properties"]["joints"]["properties"])
    if name == "load-friction":
        assert known == {*p3dof.machine.parameters.SLIDES, *p3dof.machine.parameters.PASSIVE}
    else:
        assert known == {joint.name for joint in JOINTS}


PARTS = [("bearings", place, cls) for place, cls in joint_schemas.BEARINGS.items()] + [
    ("stiffness", place, cls) for place, cls in joint_schemas.GIVING.items()
]
FIELDS = [(name, place, cls, item) for name, place, cls in PARTS for item in fields(cls)]


@pytest.mark.parametrize("name", joint_schemas.SCHEMAS)
def test_a_schema_is_made_of_the_classes_and_the_reference(name):
    text = (ROOT / f"docs/reference/{name}.schema.json").read_text(encoding="utf-8")
    assert text == joint_schemas.text(name), "write it: python tests/joint_schemas.py"


@pytest.mark.parametrize("name", joint_schemas.SCHEMAS)
def test_the_reference_has_every_field_with_its_unit_and_its_default(name):
    told = drives_schema.rows(joint_schemas.SECTIONS[name])
    whole = {"bearings": p3dof.design.bearings.Bearings, "stiffness": p3dof.analysis.Stiffness}[name]
    mine = [(place, cls, item) for each, place, cls, item in FIELDS if each == name]
    expected = {item.name for item in fields(whole)} | {f"{place}.{item.name}" for place, _, item in mine}
    assert set(told) == expected, "a field is a row in files.md"
    for place, cls, item in mine:
        _, unit, default = told[f"{place}.{item.name}"]
        quantity = joint_schemas.unit_of(cls, item.name)
        assert unit in ({"", "1"} if quantity is None else {quantity.unit, *quantity.others}), item.name
        if isinstance(item.default, str):
            assert default == f"`{item.default}`"
        elif isinstance(item.default, float):
            assert (quantity or LENGTH).read(default, "") == item.default, item.name


VALUES = (-1, 0, 0.4, 0.6, 1, 5e4, "x", "-1", "0", "3", "ball", True, [], {}, None, [1, 2, 3], [0, 0, 0])
VALUES += ("2 %", "-2 %", "0 N", "-1 N", "1 kN", "1 lbf", "2 N mm", "2 Nm", "3 mm", "1 ft", "50 km", "-3 mm")
VALUES += (
    "5 deg",
    "2 N/um",
    "4 N m/mrad",
    "4 Nm/mrad",
    "3 GPa",
    "20 psi",
    "7 kg",
    "1,3",
    ["1 mm", 0, 1],
    ["1 mm", 2],
)
KNOWN = {  # a schema does not know what number a text is, nor how numbers fit
    ("basis", "3"), ("basis", "3 mm"), ("basis", "1 ft"), ("basis", "0"), ("basis", "-3 mm"), ("basis", "-1"),
    ("preload", "50000.0"), ("centre", "['1 mm', 0, 1]"), ("name", "50000.0"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "place", "cls", "item"), FIELDS, ids=[f"{place}.{item.name}" for _, place, _, item in FIELDS]
)
def test_schema_and_reader_take_the_same_of_every_field(name, place, cls, item):
    check = validator(name)
    differ = set()
    for value in VALUES:
        data = {place: {**joint_schemas.LEAST[cls], item.name: value}}
        if joint_schemas.takes(cls, item.name, value) != check.is_valid(data):
            differ.add((item.name, str(value)))
    assert {each for each in differ if each[1] != "None"} <= KNOWN  # null stands for what is left out


@pytest.mark.parametrize("life", ["20000 h", "1e7 cycles", "1 cycle", "5000 km", "7 m", ".5 h"])
def test_both_take_a_life(life, tmp_path):
    validator("bearings").validate({**BEARINGS, "life": life})
    assert read("bearings", {**BEARINGS, "life": life}, tmp_path).life is not None


@pytest.mark.parametrize("life", ["20000", "h", "7 days", "-1 h", 20000, "1,5 h", ["1 h"]])
def test_both_refuse_a_life(life, tmp_path):
    assert not validator("bearings").is_valid({**BEARINGS, "life": life})
    with pytest.raises(p3dof.errors.ParameterError, match="life"):
        read("bearings", {**BEARINGS, "life": life}, tmp_path)
