"""The JSON Schema of the sidecar and `Sidecar.from_mapping` accept and refuse the same files."""

import copy
import json

import jsonschema
import pytest
import yaml
from documents import ROOT
from robot_texts import FULL, GEARS

from p3dof._base.errors import ModelError
from p3dof.loops import Sidecar
from p3dof.loops.sidecar import KINDS, SYNONYMS

SCHEMA = json.loads((ROOT / "docs/reference/sidecar.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
MISSING = object()


def changed(key, value):
    data = copy.deepcopy(FULL)
    if value is MISSING:
        del data[key]
    else:
        data[key] = value
    return data


def coupling(**fields):
    return changed("coupling", [{**GEARS, **fields}])


def joint_data(**fields):
    return changed("joint_data", [{"joint": "hip", **fields}])


ALL = [*KINDS, *SYNONYMS]
ACCEPTED = {
    "everything": FULL,
    "the convention": {"closed_loop": [["a", "b"]], "type": ["6D"], "name_mot": []},
    "nothing closed": {"closed_loop": [], "type": [], "name_mot": []},
    "all kinds": {
        "closed_loop": [[f"a{i}", f"b{i}"] for i in range(2 * len(ALL))],
        "type": [*ALL, *(kind.upper() for kind in ALL)],
        "length": [0.3 if kind == "distance" else None for kind in ALL * 2],
        "name_mot": [],
    },
    "lists left empty": {**FULL, **dict.fromkeys(("coupling", "reference", "joint_name", "joint_type"))},
    "a length in an exponent": changed("length", [None, "5e-1"]),
    "a coefficient in an exponent": coupling(coefficients=[0, "-1e-3"]),
    "a factor in an exponent": coupling(others={"ring": "5e-1"}),
    "no others": coupling(others={}),
    "a polynomial": coupling(coefficients=[1, 2, 3, 4, 5]),
    "a coupling without a name": coupling(name=None),
    "a locked joint": coupling(on=None, coefficients=[1]),
    "an empty reference": changed("reference", {}),
    "a joint of which nothing is said": joint_data(),
    "a smoothing in an exponent": joint_data(friction=1, smoothing="1e-2"),
}
REFUSED = {
    "joint data of no joint": changed("joint_data", [{"stiffness": 1}]),
    "joint data that are no mapping": changed("joint_data", ["hip"]),
    "joint data that are no list": changed("joint_data", {"hip": 1}),
    "a force in words": joint_data(force="some"),
    "a negative armature": joint_data(armature=-1e-3),
    "damping in words": joint_data(damping="some"),
    "a smoothing of nothing": joint_data(smoothing=0),
    "a negative smoothing": joint_data(smoothing=-1e-3),
    "an unknown datum": joint_data(mass=1),
    "a bushing of one frame": changed("bushings", [{"frames": ["a"]}]),
    "a bushing of no frames": changed("bushings", [{"stiffness": [1] * 6}]),
    "a bushing on one frame": changed("bushings", [{"frames": ["a", "a"]}]),
    "a negative stiffness": changed("bushings", [{"frames": ["a", "b"], "stiffness": [1, 1, -1, 0, 0, 0]}]),
    "three dampings": changed("bushings", [{"frames": ["a", "b"], "damping": [1, 1, 1]}]),
    "one stiffness for all": changed("bushings", [{"frames": ["a", "b"], "stiffness": 3}]),
    "an unknown field of a bushing": changed("bushings", [{"frames": ["a", "b"], "mass": 1}]),
    "a bushing that is no mapping": changed("bushings", ["a"]),
    "a name of nothing": changed("bushings", [{"frames": ["a", "b"], "name": " "}]),
    "nothing": None,
    "a list": [1],
    "no frames": changed("closed_loop", MISSING),
    "no types": changed("type", MISSING),
    "no motors": changed("name_mot", MISSING),
    "an unknown key": {**FULL, "lengths": [1]},
    "frames as text": changed("closed_loop", "a b"),
    "three frames": changed("closed_loop", [["a", "b", "c"], ["c", "d"]]),
    "a frame with itself": changed("closed_loop", [["a", "a"], ["c", "d"]]),
    "a number as a frame": changed("closed_loop", [["a", 1], ["c", "d"]]),
    "an unknown kind": changed("type", ["weld", "distance"]),
    "a number as a kind": changed("type", [3, "distance"]),
    "a motor twice": changed("name_mot", ["a", "a"]),
    "a motor without a name": changed("name_mot", [" "]),
    "a negative length": changed("length", [None, -0.5]),
    "a length of zero": changed("length", [None, 0]),
    "a length in words": changed("length", [None, "long"]),
    "one length": changed("length", 0.5),
    "a coupling alone": changed("coupling", GEARS),
    "a coupling of nothing": changed("coupling", [{"on": "motor", "coefficients": [1]}]),
    "a coupling without coefficients": coupling(coefficients=[]),
    "six coefficients": coupling(coefficients=[1] * 6),
    "one number as coefficients": coupling(coefficients=2),
    "a coefficient in words": coupling(coefficients=[0, "much"]),
    "an unknown field of a coupling": coupling(ratio=2),
    "a number as a joint": coupling(on=3),
    "a factor in words": coupling(others={"ring": "much"}),
    "a factor for a joint without a name": coupling(others={" ": 1}),
    "another joint without a factor": coupling(others="ring"),
    "a locked joint with a ratio": coupling(on=None),
    "a reference as a list": changed("reference", [0.1]),
    "a reference in words": changed("reference", {"motor": "up"}),
    "a reference of nothing": changed("reference", {"motor": []}),
    "a type as a number": changed("joint_type", [3]),
    "a joint with two types": {**FULL, "joint_name": ["a", "a"], "joint_type": ["b", "c"]},
}
BEYOND = {
    "one kind for two closures": changed("type", ["hinge"]),
    "one length for two closures": changed("length", [None]),
    "a length for a hinge": changed("length", [0.5, 0.5]),
    "a distance without a length": changed("length", MISSING),
    "a joint that follows itself": coupling(on="wheel"),
    "another joint that is there already": coupling(others={"motor": 1}),
    "a joint that is coupled twice": changed("coupling", [GEARS, GEARS]),
    "two names and one type": changed("joint_name", ["hip", "knee"]),
}
"""What no schema can say; the parser refuses it."""


@pytest.mark.parametrize("data", ACCEPTED.values(), ids=ACCEPTED)
def test_both_accept(data):
    VALIDATOR.validate(data)
    sidecar = Sidecar.parse(yaml.safe_dump(data))
    written = yaml.safe_load(sidecar.to_yaml())
    VALIDATOR.validate(written)
    assert Sidecar.from_mapping(written) == sidecar


@pytest.mark.parametrize("data", REFUSED.values(), ids=REFUSED)
def test_both_refuse(data):
    assert not VALIDATOR.is_valid(data)
    with pytest.raises(ModelError):
        Sidecar.from_mapping(data)


@pytest.mark.parametrize("data", BEYOND.values(), ids=BEYOND)
def test_the_parser_refuses_what_no_schema_can_say(data):
    VALIDATOR.validate(data)
    with pytest.raises(ModelError):
        Sidecar.from_mapping(data)


def test_the_schema_knows_all_keys():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert set(SCHEMA["properties"]) == set(FULL)
    for kind in ALL:
        assert kind in SCHEMA["properties"]["type"]["description"]
