"""The JSON Schema of drives files, made of the classes, their units and the table of the reference.

A new field of a part is a line in its class, one in `_UNITS` of the catalogue if it has a unit, and a row in
the table of ``docs/reference/files.md``; ``python tests/drives_schema.py`` then writes the schema again.
"""

from __future__ import annotations

import json
import re
from dataclasses import fields
from typing import Any

from documents import ROOT

from p3dof._base.errors import P3dofError
from p3dof.design.drives import catalogue
from p3dof.design.drives.makers import ENCODINGS, FIELDS, SEPARATORS
from p3dof.design.drives.margins import Ambient, Margins
from p3dof.design.drives.motor import MEASURED, Amplifier, Motor, Winding
from p3dof.design.drives.stopping import StopRamp
from p3dof.design.drives.supply import Supply
from p3dof.design.drives.transmission import ENDS, LEAD_GRADES, Belt, Gear, Rack, Screw

PAGE = ROOT / "docs/reference/files.md"
PATH = ROOT / "docs/reference/drives.schema.json"
LEAST: dict[type[Any], dict[str, Any]] = {
    Motor: {
        "name": "a", "rated_torque": 1, "peak_torque": 2, "max_speed": 100, "inertia": 1e-4,
    },
    Winding: {
        "bus_voltage": 320, "pole_pairs": 4, "resistance": 1, "inductance": 8e-3, "measured": "phase",
        "flux": 0.1, "max_current_rms": 8,
    },
    Screw: {"name": "a", "lead": 0.01, "inertia": 1e-5},
    Belt: {"name": "a", "diameter": 0.04},
    Gear: {"name": "a"},
    Rack: {"name": "a", "diameter": 0.04},
    Amplifier: {"name": "a", "rated_current_rms": 3, "max_current_rms": 9},
    Supply: {"capacitance": 5e-4, "voltage": 320, "max_voltage": 380, "resistor_power": 200},
    StopRamp: {"deceleration": 8, "jerk": 400},
    Margins: {},
    Ambient: {},
}  # fmt: skip
"""Of each class fields that are taken; one more class needs its own."""
CHOICES = {"ends": ENDS, "measured": MEASURED}
RULES: dict[type[Any], dict[str, Any]] = {
    Amplifier: {
        "allOf": [
            {"oneOf": [{"required": [f"{most}_current_rms"]}, {"required": [f"{most}_current_peak"]}]}
            for most in ("rated", "max")
        ]
    },
    Screw: {"anyOf": [{"required": ["inertia"]}, {"required": ["diameter", "length"]}]},
    Winding: {
        "allOf": [
            {"oneOf": [{"required": [name]} for name in names]}
            for names in (
                ("flux", "torque_constant_rms", "torque_constant_peak", "voltage_constant"),
                ("max_current_rms", "max_current_peak"),
            )
        ]
    },
}
"""What fields have to do with each other."""
_JSON = {"str": "string", "bool": "boolean"}
DIGITS = r"(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
LIFE = rf"^\s*{DIGITS}\s+(h|cycles?|km|m)\s*$"
POINTS = {"number": {}, "fromZero": {"minimum": 0}, "positive": {"exclusiveMinimum": 0}}
BELOW = {
    "fromZero": r"^\s*-(?!\s*(0+\.?0*|\.0+)([eE][^ ]*)?\s*([^\d.eE].*)?$)",
    "positive": r"^\s*-|^\s*[+-]?(0+\.?0*|\.0+)([eE][^ ]*)?\s*([^\d.eE].*)?$",
}


def rows(section: str = "Drives file") -> dict[str, tuple[str, str, str]]:
    """Return meaning, unit and default of each field of a file, as the reference says."""
    text = PAGE.read_text(encoding="utf-8").partition(f"\n## {section}")[2].partition("\n## ")[0]
    cells = [re.split(r"(?<!\\) ?\| ?", line)[1:5] for line in text.partition("###")[0].splitlines()]
    return {row[0].strip("` "): (row[1], row[2], row[3]) for row in cells if row and row[0].startswith("`")}


def described(row: tuple[str, str, str]) -> str:
    """Return the description of a field, of its row in the reference."""
    meaning, unit, _ = row
    unit = f" [{unit}]" if unit not in ("", "1") else ""
    words = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", meaning).replace("`", "")
    return f"{words[0].upper()}{words[1:]}{unit}."


def takes(cls: type[Any], name: str, value: Any) -> bool:
    """Return whether a part with this field is taken by the reader."""
    try:
        catalogue._part({**LEAST[cls], name: value}, cls, "x", [n for n in ("name",) if n in LEAST[cls]])
    except P3dofError:
        return False
    return True


def least(cls: type[Any], name: str) -> str:
    """Return which of the three kinds of number a field is, by what the reader takes."""
    return "number" if takes(cls, name, -1) else "fromZero" if takes(cls, name, 0) else "positive"


def form(cls: type[Any], item: Any) -> dict[str, Any]:  # noqa: PLR0911  # a line for each kind of field
    """Return what may stand in a field."""
    kind, name = str(item.type), item.name
    if name == "curve":
        point = [{"$ref": "#/$defs/fromZero"}] * 3
        return {"type": "array", "minItems": 2, "maxItems": 1000, "items": {
            "type": "array", "prefixItems": point, "minItems": 3, "maxItems": 3}}  # fmt: skip
    if name in catalogue._PAIRS:
        pair = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
        return {"type": "array", "minItems": 1, "items": pair}
    if name == "amplifier":
        return {"type": "string"}
    if name == "preload":
        return {
            "anyOf": [
                {"$ref": "#/$defs/fromZero"},
                {"type": "string", "pattern": rf"^\s*\+?{DIGITS}\s*%\s*$"},
            ]
        }
    if name == "lead_accuracy":
        return {"anyOf": [{"enum": list(LEAD_GRADES)}, {"$ref": "#/$defs/positive"}]}
    if name in catalogue._INNER:
        return {"$ref": f"#/$defs/{name}"}
    if kind in ("str", "bool"):
        return {"enum": list(CHOICES[name])} if name in CHOICES else {"type": _JSON[kind]}
    if name in ("temperature", "rated_ambient"):
        degrees = {"type": "string", "pattern": r"^\s*[+-]?\d+\.?\d*\s*(°C|degC)?\s*$"}
        return {"anyOf": [{"type": "number", "minimum": -60, "maximum": 150}, degrees]}
    if takes(cls, name, "50 %") and not takes(cls, name, 1):
        return {"$ref": "#/$defs/margin"}
    assert kind in ("int", "float", "float | None"), f"{cls.__name__}.{name}: say here what form {kind} has"
    if catalogue.unit_of(cls, name) is not None:
        return {"$ref": f"#/$defs/{least(cls, name)}"}
    if takes(cls, name, "50 %"):
        return {"$ref": f"#/$defs/share{'FromZero' if takes(cls, name, 0) else ''}"}
    return {"type": "integer" if kind == "int" else "number", **POINTS[least(cls, name)]}


def part(cls: type[Any], place: str, named: bool) -> dict[str, Any]:
    """Return the schema of a part."""
    told = rows()
    properties, required = {}, ["name"] if named else []
    for item in fields(cls):
        row = told[f"{place}.{item.name}"]
        properties[item.name] = {"description": described(row), **form(cls, item)}
        if isinstance(item.default, bool | int | float | str) and item.default != float("inf"):
            properties[item.name] |= {"default": item.default} if item.name != "name" else {}
        if item.default is item.default_factory:
            required.append(item.name)
        assert (row[2] == "required") == (item.name in required), f"{place}.{item.name}: {row[2]}"
    return {
        "type": "object", "required": required, "additionalProperties": False, "properties": properties,
        **RULES.get(cls, {}),
    }  # fmt: skip


def listed(kind: str) -> dict[str, Any]:
    """Return a list of parts, or a table in its place."""
    one = {"$ref": f"#/$defs/{kind.removesuffix('s')}"}
    table = {"$ref": "#/$defs/table"}
    items = {"if": {"required": ["table"]}, "then": table, "else": one}
    least = {"minItems": 1} if kind == "motors" else {}
    return {
        "description": rows()[kind][0].capitalize().replace("`", ""),
        "if": {"type": "array"}, "then": {"type": "array", "items": items, **least}, "else": table,
    }  # fmt: skip


def table() -> dict[str, Any]:
    """Return the schema of a maker's table."""
    line = {"type": "integer", "minimum": 1}
    a_field = {"type": "string"}
    found = {
        "table": {"description": "A CSV file, seen from the folder of this one.", "type": "string"},
        "columns": {
            "description": "Column, or its number: the field, with the unit of its numbers in brackets.",
            "type": "object",
            "minProperties": 1,
            "additionalProperties": {"anyOf": [a_field, {"type": "array", "items": a_field}]},
        },
        "encoding": {"enum": list(ENCODINGS), "default": "utf-8"},
        "separator": {"enum": list(SEPARATORS), "default": ","},
        "decimal": {"enum": [".", ","], "default": "."},
        "thousands": {"enum": ["", ".", ",", "'", "’", " "], "default": ""},
        "header": {"description": "Line with the names of the columns.", **line},
        "first": {"description": "Line of the first row.", **line},
        "constant": {"description": "Fields of all rows.", "type": "object"},
    }
    assert set(found) == set(FIELDS)
    return {
        "description": "Parts from a maker's table.", "type": "object", "required": ["table", "columns"],
        "additionalProperties": False, "properties": found,
    }  # fmt: skip


def schema() -> dict[str, Any]:
    """Return the whole schema."""
    unit = rf"^\s*[+-]?{DIGITS}\s*([A-Za-zµ°Ω][A-Za-zµ°Ω0-9²³^/*· -]*)?\s*$"
    number = {"anyOf": [{"type": "number"}, {"type": "string", "pattern": unit}]}
    defs: dict[str, Any] = {
        "number": {"description": "In SI units; or text with a unit, such as '120 mm'.", **number}
    }
    for name in ("fromZero", "positive"):
        below = {"type": "string", "pattern": BELOW[name]}
        defs[name] = {"allOf": [{"$ref": "#/$defs/number"}], **POINTS[name], "not": below}
    percent = {"type": "string", "pattern": rf"^\s*\+?{DIGITS}\s*%?\s*$"}
    for name, bound in (("share", "positive"), ("shareFromZero", "fromZero")):
        known = {"type": "number", "maximum": 1, **POINTS[bound]}
        defs[name] = {"description": "A number up to 1, or text in percent.", "anyOf": [known, percent]}
    below = {"type": "number", "minimum": 0, "exclusiveMaximum": 1}
    defs["margin"] = {"description": "A share below 1, or text in percent.", "anyOf": [below, percent]}
    kinds = catalogue._KINDS
    for kind, cls in kinds.items():
        defs[kind.removesuffix("s")] = part(cls, f"{kind}[]", named=True)
    for name, cls in catalogue._INNER.items():
        place = next(path for path in rows() if path.rpartition(".")[2] == name)
        defs[name] = part(cls, place, named=False)
    defs["table"] = table()
    single = [
        name for name in catalogue._INNER if name in vars(catalogue.Catalogue).get("__dataclass_fields__")
    ]
    properties = {kind: listed(kind) for kind in kinds}
    properties |= {name: {"$ref": f"#/$defs/{name}"} for name in single}
    names = {"type": "array", "minItems": 1, "items": {"type": "string"}}
    of_axis = {
        "type": "object",
        "additionalProperties": False,
        "properties": dict.fromkeys(catalogue._SELECTED, names),
    }
    properties["axes"] = {
        "type": "object",
        "additionalProperties": False,
        "properties": dict.fromkeys("ABC", of_axis),
    }
    properties["life"] = {"type": "string", "pattern": LIFE}
    some = [
        {"required": [kind], "properties": {kind: {"anyOf": [{"type": "object"}, {"minItems": 1}]}}}
        for kind in ("screws", "belts", "racks")
    ]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "p3dof drives file",
        "description": "Motors, gears, screws and belts to choose from. SI units, or a unit with the number.",
        "type": "object",
        "required": ["motors"],
        "additionalProperties": False,
        "properties": properties,
        "anyOf": some,
        "$defs": defs,
    }


def text() -> str:
    """Return the text of the schema."""
    return json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
