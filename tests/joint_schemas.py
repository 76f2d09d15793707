"""The JSON Schemas of bearings and stiffness files, made of the classes, their units and the reference.

A new field is a line in its class, one in `_NUMBERS` of its module if it has a unit, and a row in the table
of ``docs/reference/files.md``; ``python tests/joint_schemas.py`` then writes the schemas again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, get_args, get_type_hints

from documents import ROOT
from drives_schema import BELOW, DIGITS, LIFE, POINTS, described, rows

from p3dof._base import quantities
from p3dof._base.errors import P3dofError
from p3dof._base.quantities import Quantity
from p3dof.analysis.reactions import JOINTS, stiffness
from p3dof.analysis.reactions.results import Idealisation
from p3dof.design.bearings import catalogue
from p3dof.design.bearings.catalogue import SLIDES, TURNING, Bearing, Guide

BEARINGS: Mapping[str, type[Any]] = {"hinges": Bearing, "guides": Guide}
GIVING: Mapping[str, type[Any]] = {
    **stiffness.KINDS, "rods": stiffness.RodSection, "misfit": stiffness.Misfit,
}  # fmt: skip
"""Classes of the parts of both files, by the fields that they stand in."""
SECTIONS = {"bearings": "Bearings file", "stiffness": "Stiffness file"}
LEAST: dict[type[Any], dict[str, Any]] = {
    Bearing: {"dynamic": 3e3},
    Guide: {"dynamic": 1e4, "basis": 5e4, "moments": [100, 100, 100]},
    **{cls: {} for cls in GIVING.values()},
}
"""Of each class fields that are taken."""
MORE = {"poisson": {"exclusiveMaximum": 0.5}}
"""What a field keeps besides its sign."""
_WAYS = [int(way) for way in catalogue._BASES]


def unit_of(cls: type[Any], name: str) -> Quantity | None:
    """Return what kind of number a field is; None without a unit."""
    kinds = catalogue._NUMBERS if cls in BEARINGS.values() else stiffness._NUMBERS
    return quantities.FORCE if name == "preload" else kinds.get(name)


def takes(cls: type[Any], name: str, value: Any) -> bool:
    """Return whether a part with this field is taken by the reader."""
    data = {**LEAST[cls], name: value}
    try:
        if cls in BEARINGS.values():
            catalogue._read(data, cls, "x")
        else:
            stiffness._read(data, cls(), "x")
    except P3dofError:
        return False
    return True


def least(cls: type[Any], name: str) -> str:
    """Return which of the three kinds of number a field is, by what the reader takes."""
    each = (lambda number: [1, number, 1]) if takes(cls, name, [1, 1, 1]) else (lambda number: number)
    below = takes(cls, name, each(-1))
    return "number" if below else "fromZero" if takes(cls, name, each(0)) else "positive"


def alike(unit: str) -> str:
    """Return the pattern of a unit and those of the same kind: each of its factors may be another one."""
    powers = quantities.unit_of(unit)[0]
    whole = [name for name, (own, _) in quantities._UNITS.items() if own == powers]
    sign, between = ("/", r"\s*/\s*") if "/" in unit else (" ", r"[\s*·]+")
    product = between.join(f"({alike(word)})" for word in unit.split(sign)) if sign in unit else ""
    return "|".join([*map(re.escape, sorted(whole)), *([product] if product else [])])


def written(quantity: Quantity) -> str:
    """Return the pattern of a number with a unit of this kind."""
    units = dict.fromkeys(alike(unit) for unit in (quantity.unit, *quantity.others))
    return rf"^\s*[+-]?{DIGITS}\s*({'|'.join(units)})?\s*$"


def numbers(used: Mapping[str, tuple[Quantity, str]]) -> dict[str, Any]:
    """Return the definitions of the numbers with units, by their names."""
    found: dict[str, Any] = {}
    for name, (quantity, kind) in sorted(used.items()):
        text = {"type": "string", "pattern": written(quantity)}
        example = (quantity.unit, *quantity.others)[-1]
        words = (
            f"{quantity.name[0].upper()}{quantity.name[1:]} [{quantity.unit}], or text such as '2 {example}'."
        )
        found[name] = {"description": words, "anyOf": [{"type": "number"}, text], **POINTS[kind]}
        if kind in BELOW:
            found[name]["not"] = {"type": "string", "pattern": BELOW[kind]}
    return found


def form(  # noqa: PLR0911  # a line for each kind of field
    cls: type[Any], name: str, used: dict[str, tuple[Quantity, str]]
) -> dict[str, Any]:
    """Return what may stand in a field; `used` gains the number with a unit that it is."""
    choices = get_args(get_type_hints(cls)[name])
    if choices and all(isinstance(choice, str) for choice in choices):
        return {"enum": list(choices)}
    if name == "name":
        return {"type": ["string", "integer"]}
    quantity = unit_of(cls, name)
    if quantity is None:
        return {"type": "number", **POINTS[least(cls, name)], **MORE.get(name, {})}
    if name == "basis":
        return {"anyOf": [{"enum": _WAYS}, {"type": "string", "pattern": written(quantity)}]}
    kind = least(cls, name)
    key = f"{quantity.name.partition(' ')[2].title().replace(' ', '')}{kind[0].upper()}{kind[1:]}"
    key = key[0].lower() + key[1:]
    used[key] = (quantity, kind)
    one = {"$ref": f"#/$defs/{key}"}
    if takes(cls, name, [1, 1, 1]):
        return {"type": "array", "items": one, "minItems": 3, "maxItems": 3}
    if name == "preload":
        return {"anyOf": [one, {"type": "string", "pattern": rf"^\s*\+?{DIGITS}\s*%\s*$"}]}
    return one


def part(cls: type[Any], place: str, section: str, used: dict[str, tuple[Quantity, str]]) -> dict[str, Any]:
    """Return the schema of a part."""
    told, properties, required = rows(section), {}, []
    for item in fields(cls):
        row = told[f"{place}.{item.name}"]
        properties[item.name] = {"description": described(row), **form(cls, item.name, used)}
        if isinstance(item.default, int | float | str) and item.name != "name":
            properties[item.name]["default"] = item.default
        if item.default is MISSING and item.default_factory is MISSING:
            required.append(item.name)
        assert (row[2] == "required") == (item.name in required), f"{place}.{item.name}: {row[2]}"
    needed = {"required": required} if required else {}
    return {"type": "object", **needed, "additionalProperties": False, "properties": properties}


def _file(name: str, description: str, properties: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
    told = rows(SECTIONS[name])
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"p3dof {name} file",
        "description": f"{description} SI units, or a unit with the number.",
        "type": "object",
        "additionalProperties": False,
        "properties": {
            field: {"description": described(told[field]), **value} for field, value in properties.items()
        },
        "$defs": defs,
    }


def _of_joints(kinds: Mapping[str, str]) -> dict[str, Any]:
    own = {joint: {"$ref": f"#/$defs/{kind}"} for joint, kind in kinds.items()}
    return {"type": "object", "additionalProperties": False, "properties": own}


def bearings_schema() -> dict[str, Any]:
    """Return the schema of bearings files."""
    used: dict[str, tuple[Quantity, str]] = {}
    parts = {name: part(cls, name, SECTIONS["bearings"], used) for name, cls in BEARINGS.items()}
    properties: dict[str, Any] = {name: {"$ref": f"#/$defs/{name}"} for name in BEARINGS}
    properties["joints"] = _of_joints(dict.fromkeys(SLIDES, "guides") | dict.fromkeys(TURNING, "hinges"))
    properties["life"] = {"type": "string", "pattern": LIFE}
    found = _file("bearings", "What the joints run in.", properties, {**numbers(used), **parts})
    some = {"required": ["joints"], "properties": {"joints": {"minProperties": 1}}}
    found["anyOf"] = [*({"required": [name]} for name in BEARINGS), some]
    return found


def stiffness_schema() -> dict[str, Any]:
    """Return the schema of stiffness files."""
    used: dict[str, tuple[Quantity, str]] = {}
    parts = {name: part(cls, name, SECTIONS["stiffness"], used) for name, cls in GIVING.items()}
    properties: dict[str, Any] = {name: {"$ref": f"#/$defs/{name}"} for name in GIVING}
    properties["rods"] = {"anyOf": [{"const": "rigid"}, {"$ref": "#/$defs/rods"}]}
    properties["joints"] = _of_joints({joint.name: stiffness.kind_of(joint.name) for joint in JOINTS})
    properties["cuts"] = {"enum": list(get_args(Idealisation)), "default": stiffness.Stiffness().cuts}
    return _file("stiffness", "How joints and rods give way.", properties, {**numbers(used), **parts})


SCHEMAS = {"bearings": bearings_schema, "stiffness": stiffness_schema}


def text(name: str) -> str:
    """Return the text of a schema."""
    return json.dumps(SCHEMAS[name](), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for each in SCHEMAS:
        (ROOT / f"docs/reference/{each}.schema.json").write_text(text(each), encoding="utf-8")
