"""Files of parameters that are accepted and refused, and their schema."""

from __future__ import annotations

import copy
import json

import jsonschema
import yaml
from documents import ROOT

import p3dof

SCHEMA = json.loads((ROOT / "docs/reference/parameters.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
MISSING = object()
BODY = {"mass": 1.2, "com": [0.1, 0, 0], "inertia": [0.01, 0.02, 0.02]}
KINDS = {
    "geometry": {"r": 0.1, "R": 0.25, "L": 0.4, "b": 0.05},
    "bodies": {"slider": BODY, "leg": BODY, "crossbar": BODY, "platform": BODY},
    "limits": {"travel": [-0.2, 0.2], "speed": 2, "force": 500, "tilt": [-0.785, 0.785]},
    "gravity": [0, 0, -9.806],
    "friction": {"viscous": {"sliders": 20, "joints": 0.01}, "coulomb": {"hinge_platform": 0.05}},
    "actuators": {"armature": {"sliders": 14.8}, "counterbalance": {"slide_a": -48}},
    "payload": BODY,
}
SOLIDS = {"geometry": {"r": "100 mm", "R": 0.25, "L": 0.4}, "bodies": "solids"}
LINKS = {**KINDS, "bodies": dict.fromkeys([name for name, _ in p3dof.PAPER.bodies.items()], BODY)}


def changed(place, value, start=KINDS):
    """A file with one field set, added or (MISSING) left out."""
    data = copy.deepcopy(start)
    *outer, last = place.split(".")
    target = data
    for key in outer:
        target = target[key]
    if value is MISSING:
        del target[last]
    else:
        target[last] = value
    return data


ACCEPTED = {
    "four kinds": KINDS,
    "ten links": LINKS,
    "no limits": changed("limits", MISSING),
    "no b": changed("geometry.b", MISSING),
    "no friction": changed("friction", MISSING),
    "some limits": changed("limits", {"force": 100}),
    "no actuators": changed("actuators", MISSING),
    "no number of the actuators": changed("actuators", {}),
    "actuators with units": changed(
        "actuators",
        {
            "armature": {"sliders": "14.8 kg", "slide_b": "900 g"},
            "counterbalance": {"slide_a": "0.05 kN"},
            "spring": {"sliders": "-0.4 N/mm", "slide_c": -423},
            "counterweight": {"slide_c": 5},
        },
    ),
    "empty friction": changed("friction", {}),
    "friction of every joint": changed(
        "friction.viscous",
        dict.fromkeys(
            ["sliders", "joints", *p3dof.machine.Friction({"sliders": 1, "joints": 1}).joints], 0.1
        ),
    ),
    "an exponent that YAML reads as text": changed("geometry.b", "5e-2"),
    "massless cross-bars": changed("bodies.crossbar", {"mass": 0, "com": [0, 0, 0], "inertia": [0, 0, 0]}),
    "a full inertia": changed("bodies.leg.inertia", [[0.01, 0.001, 0], [0.001, 0.02, 0], [0, 0, 0.02]]),
    "lengths with units": changed("geometry", {"r": "100 mm", "R": "25 cm", "L": "0.4m", "b": "5e4 um"}),
    "masses with units": changed("bodies.leg.mass", "950 g"),
    "a point with units": changed("bodies.leg.com", ["100 mm", 0, "-1e1 mm"]),
    "an inertia with units": changed("bodies.leg.inertia", ["4e4 kg mm^2", "4e4 kg mm²", "2e4 kg mm²"]),
    "limits with units": changed(
        "limits",
        {"travel": ["-200 mm", "20 cm"], "tilt": ["-45 deg", "45 °"], "force": "0.5 kN", "speed": "80 mm/ms"},
    ),
    "friction with units": changed("friction.viscous", {"sliders": "0.02 N s/mm", "joints": 0.01}),
    "two payloads": changed("payload", [BODY, BODY]),
    "a mass alone": changed("payload", 2),
    "a mass alone with a unit": changed("payload", "950 g"),
    "masses and a body": changed("payload", [BODY, 5, {"mass": "1 kg", "com": [0, 0, "-40 mm"]}]),
    "solids": SOLIDS,
    "solids of aluminium": changed("density", "2.7 g/cm^3", SOLIDS),
    "solids of several metals": changed("density", {"platform": 2700, "leg": "7.8 g/cm^3"}, SOLIDS),
    "a density beside bodies that are given": changed("density", 2700),
    "sizes beside bodies that are given": changed("dimensions", {"rod_radius": 0.01}),
    "solids of some sizes": changed("dimensions", {"rod_radius": "8 mm", "plate_thickness": 0.01}, SOLIDS),
    "about": changed("bodies.leg.about", [0, 0, 0]),
    "as written": yaml.safe_load(yaml.safe_dump(KINDS)),
}
REFUSED = {
    "nothing": None,
    "a list": [1, 2],
    "no geometry": changed("geometry", MISSING),
    "no bodies": changed("bodies", MISSING),
    "a negative armature": changed("actuators.armature", {"sliders": -1}),
    "a negative counterweight": changed("actuators.counterweight", {"slide_b": "-1 kg"}),
    "armature of a hinge": changed("actuators.armature", {"hinge_a": 1}),
    "armature of all joints": changed("actuators.armature", {"joints": 1}),
    "one armature for all": changed("actuators.armature", 14.8),
    "an unknown number of the actuators": changed("actuators.inertia", {"sliders": 1}),
    "a force in kg": changed("actuators.counterbalance", {"slide_a": "5 kg"}),
    "an unknown part": changed("colour", "red"),
    "an unknown length": changed("geometry.l", 0.4),
    "no L": changed("geometry.L", MISSING),
    "text for a length": changed("geometry.L", "long"),
    "a negative length": changed("geometry.b", -0.05),
    "a length of zero": changed("geometry.b", 0),
    "text for nothing": changed("geometry.b", "-5e-2"),
    "a list for a length": changed("geometry.b", [0.05]),
    "no platform": changed("bodies.platform", MISSING),
    "kinds and links": changed("bodies.leg_a", BODY),
    "nine links": changed("bodies.rod_right", MISSING, LINKS),
    "no mass": changed("bodies.leg.mass", MISSING),
    "a massless leg": changed("bodies.leg", {"mass": 0, "com": [0, 0, 0], "inertia": [0, 0, 0]}),
    "a negative mass": changed("bodies.crossbar.mass", -1),
    "two numbers for com": changed("bodies.leg.com", [0, 0]),
    "four numbers for com": changed("bodies.leg.com", [0, 0, 0, 0]),
    "two rows of inertia": changed("bodies.leg.inertia", [[1, 0, 0], [0, 1, 0]]),
    "an unknown field of a body": changed("bodies.leg.weight", 9.8),
    "home outside the travel": changed("limits.travel", [0.1, 0.2]),
    "one end of the travel": changed("limits.travel", [-0.2]),
    "no speed": changed("limits.speed", 0),
    "an unknown limit": changed("limits.power", 100),
    "gravity as a number": changed("gravity", 9.8),
    "friction of an unknown joint": changed("friction.viscous", {"knee": 1}),
    "negative friction": changed("friction.coulomb", {"sliders": -1}),
    "friction as a number": changed("friction.viscous", 20),
    "no smoothing": changed("friction.smoothing", 0),
    "a length in kilograms": changed("geometry.r", "100 kg"),
    "a mass in millimetres": changed("bodies.leg.mass", "950 mm"),
    "a negative length with a unit": changed("geometry.b", "-50 mm"),
    "a length of zero with a unit": changed("geometry.b", "0.0 mm"),
    "home outside the travel, with units": changed("limits.travel", ["10 mm", "200 mm"]),
    "an unknown unit": changed("limits.force", "500 dyn"),
    "a mass centre of the payload alone": changed("payload.mass", MISSING),
    "an inertia of the payload about a point, without its mass centre": changed(
        "payload", {"mass": 1, "inertia": [1, 1, 1], "about": [0, 0, 0]}
    ),
    "a payload of nothing": changed("payload", "heavy"),
    "a mass alone for a body": changed("bodies.slider", 1),
    "solids by another name": changed("bodies", "solid"),
    "a density of zero": changed("density", 0, SOLIDS),
    "a density in kg": changed("density", {"leg": "-1 kg/m^3"}, SOLIDS),
    "a density of one link": changed("density", {"leg_a": 2700}, SOLIDS),
    "an unknown size": changed("dimensions", {"leg_radius": 0.01}, SOLIDS),
    "no size": changed("dimensions", {"rod_radius": 0}, SOLIDS),
}
