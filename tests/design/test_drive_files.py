"""Files of drives: the schema, every field and unit, tables of makers in all their forms, and round trips."""

from __future__ import annotations

import copy
import json
import math
import re
from dataclasses import fields, replace

import drives_schema
import jsonschema
import numpy as np
import pytest
import yaml
from command_line import run
from drives_schema import LEAST, PAGE, PATH, rows
from task_files import PICK_AND_PLACE

from p3dof._base.errors import DriveError, P3dofError
from p3dof.design.drives import (
    GENERIC,
    Belt,
    Catalogue,
    Gear,
    Motor,
    Screw,
    Winding,
    read_catalogue,
    write_catalogue,
)
from p3dof.design.drives.catalogue import _INNER, _KINDS, _PAIRS, _UNITS, dump, unit_of
from p3dof.design.drives.makers import ENCODINGS
from p3dof.design.drives.transmission import LEAD_GRADES

RPM = math.pi / 30
SCHEMA = json.loads(PATH.read_text(encoding="utf-8"))
WINDING = {
    "bus_voltage": "320 V", "pole_pairs": 4, "resistance": "1 ohm", "inductance": "8 mH",
    "measured": "between lines", "torque_constant_rms": 0.594, "max_current_rms": "8.5 A",
    "field_weakening": True,
}  # fmt: skip
MOTOR = {
    "name": "M400", "rated_torque": "1.3 Nm", "peak_torque": "3.8 Nm", "rated_speed": "3000 rpm",
    "max_speed": "5000 rpm", "inertia": "0.3 kg cm^2", "brake_torque": 1.4, "coupling_inertia": 1e-6,
    "drag": "10 N mm", "time_constant": "15 min", "max_inertia_ratio": 10, "max_power": "0.9 kW",
    "max_braking_power": 300, "winding": WINDING,
    "curve": [[0, 1.3, 3.8], ["3000 rpm", 1.3, 3.8], ["5000 rpm", "900 N mm", "1.5 Nm"]],
}  # fmt: skip
SCREW = {
    "name": "16x10", "lead": "10 mm", "diameter": "12.7 mm", "length": "500 mm", "efficiency": "90 %",
    "efficiency_back": 0.8, "ends": "fixed-fixed", "drag": 0, "max_speed": "6000 rpm",
    "inertia": "0.2 kg cm^2",
}  # fmt: skip
BELT = {"name": "pulley", "diameter": "40 mm", "efficiency": 0.95, "inertia": "1 kg cm^2", "drag": "0.1 Nm"}
GEAR = {"name": "i3", "ratio": 3, "efficiency": 0.96, "max_speed": "6000 rpm", "max_torque": "40 Nm"}
FULL = {"motors": [MOTOR], "screws": [SCREW], "belts": [BELT], "gears": [GEAR]}
TABLE = {"table": "motors.csv", "columns": {"Type": "name", 2: ["rated_torque [Nm]", "brake_torque [Nm]"]}}
MISSING = object()


def changed(data, path, value):
    """Return a copy in which what stands at a path is something else, or missing."""
    data = copy.deepcopy(data)
    *parents, last = (int(word) if word.isdigit() else word for word in path.split("."))
    place = data
    for name in parents:
        place = place[name]
    if value is MISSING:
        del place[last]
    else:
        place[last] = value
    return data


def read(data, folder):
    path = folder / "drives.yaml"
    path.write_text(
        data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False), encoding="utf-8"
    )
    return read_catalogue(path)


def valid(data):
    return jsonschema.Draft202012Validator(SCHEMA).is_valid(data)


def same(one, other):
    """Whether two catalogues are the same to the last bit."""

    def bits(part):
        return [
            np.asarray(value).tolist() if item.name in ("curve", *_PAIRS) else value
            for item in fields(part)
            for value in [getattr(part, item.name)]
        ]

    lists = ("motors", "transmissions", "gears")
    return (one.margins, one.ambient) == (other.margins, other.ambient) and all(
        [(type(a), bits(a)) for a in getattr(one, name)] == [(type(b), bits(b)) for b in getattr(other, name)]
        for name in lists
    )


# --- the schema and the reference ---------------------------------------------------------------------------


def test_the_schema_is_made_of_the_classes_and_the_reference():
    assert PATH.read_text(encoding="utf-8") == drives_schema.text(), "write it: python tests/drives_schema.py"
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


def test_the_reference_has_every_field_with_its_unit_and_its_default():
    expected = set(_KINDS)
    for kind, cls in _KINDS.items():
        expected |= {f"{kind}[].{item.name}" for item in fields(cls)}
    single = {"margins", "ambient", "supply", "stop"}  # of the whole catalogue
    expected |= single | {"axes", "life"}
    for inner, cls in _INNER.items():
        place = next(path for path in expected if inner in (path, path.rpartition(".")[2]))
        expected |= {f"{place}.{item.name}" for item in fields(cls)}
    assert set(rows()) == expected, f"a field is a row in {PAGE.name}"
    assert re.findall(r"`([PT]\d+)`", PAGE.read_text(encoding="utf-8")) == list(LEAD_GRADES)
    written = {"kg m^2": "kg m²", "m/s^2": "m/s²", "m/s^3": "m/s³"}
    for path, (_, unit, default) in rows().items():
        name = path.rpartition(".")[2]
        if name in _UNITS and name != "curve" and not path.startswith("margins."):
            assert unit == written.get(_UNITS[name].unit, _UNITS[name].unit), path
        kinds = {**{f"{kind}[]": cls for kind, cls in _KINDS.items()}, "motors[].winding": Winding}
        kinds |= {name: _INNER[name] for name in single}
        cls = kinds.get(path.rpartition(".")[0])
        known = {} if cls is None else {item.name: item.default for item in fields(cls)}
        if isinstance(known.get(name), bool):
            assert default == str(known[name]).lower(), path
        elif isinstance(known.get(name), float) and math.isfinite(known[name]):
            assert float(default.split(":")[0]) == known[name], path


ACCEPTED = [
    FULL,
    {"motors": [MOTOR], "screws": [SCREW]},
    {"motors": [MOTOR], "belts": [BELT]},
    changed(FULL, "screws.0", {"name": "s", "lead": 0.01, "inertia": 0}),
    changed(FULL, "motors.0.winding.torque_constant_rms", "0.594 Nm/A"),
    changed(changed(FULL, "screws.0.efficiency", "95%"), "screws.0.efficiency_back", 0),
    changed(FULL, "gears", []),
    {
        **FULL,
        "margins": {"speed": "30 %", "DN": 0.1},
        "ambient": {"temperature": "45 °C", "altitude": "1.2 km"},
    },
    {**FULL, "ambient": {"temperature": 45}, "margins": {}},
    changed(FULL, "motors.0.derating_temperature", [[40, 1], [60, 0.8]]),
]
REFUSED = [
    [],
    {},
    {"motors": [MOTOR]},
    {"motors": [], "screws": [SCREW]},
    {"motors": [MOTOR], "screws": [], "belts": []},
    changed(FULL, "motors", "many"),
    changed(FULL, "motors.0.torque", 1),
    changed(FULL, "motors.0.name", 5),
    changed(FULL, "motors.0.name", MISSING),
    changed(FULL, "motors.0.inertia", MISSING),
    changed(FULL, "motors.0.curve", [[0, 1, 1]]),
    changed(FULL, "motors.0.curve", [[0, 1], [5, 1]]),
    changed(FULL, "motors.0.curve.1", [1, -1, 3]),
    changed(FULL, "motors.0.max_speed", "-5000 rpm"),
    changed(FULL, "motors.0.time_constant", "0 s"),
    changed(FULL, "motors.0.winding.pole_pairs", 4.5),
    changed(FULL, "motors.0.winding.measured", "star"),
    changed(FULL, "motors.0.winding.flux", 0.1),
    changed(FULL, "motors.0.winding.torque_constant_rms", MISSING),
    changed(FULL, "motors.0.winding.max_current_peak", 12),
    changed(FULL, "motors.0.winding.field_weakening", "yes"),
    changed(FULL, "motors.0.winding", [1]),
    changed(FULL, "screws.0.ends", "free"),
    changed(FULL, "screws.0.efficiency", 1.2),
    changed(FULL, "screws.0.efficiency", "much"),
    changed(FULL, "screws.0", {"name": "s", "lead": 0.01, "diameter": 0.01}),
    changed(FULL, "belts.0.diameter", MISSING),
    changed(FULL, "gears.0.ratio", "3"),
    changed(FULL, "tasks", []),
    {**FULL, "margins": {"speed": 1}},
    {**FULL, "margins": {"spede": 0.1}},
    {**FULL, "margins": [0.2]},
    {**FULL, "ambient": {"temperature": "45 K"}},
    {**FULL, "ambient": {"temperature": 318.15}},
    changed(FULL, "motors.0.derating_altitude", [[1000, 1, 1]]),
    changed(FULL, "motors", {**TABLE, "separator": "/"}),
    changed(FULL, "motors", {**TABLE, "columns": {}}),
    changed(FULL, "motors", {"table": "motors.csv"}),
    changed(FULL, "motors", [{**TABLE, "first": 0}]),
    changed(FULL, "motors", [{**TABLE, "row": 1}]),
]


@pytest.mark.parametrize("data", ACCEPTED)
def test_schema_and_program_accept(data, tmp_path):
    jsonschema.Draft202012Validator(SCHEMA).validate(data)
    read(data, tmp_path)


@pytest.mark.parametrize("data", REFUSED)
def test_schema_and_program_refuse(data, tmp_path):
    assert not valid(data)
    with pytest.raises(DriveError, match=r"drives\.yaml: ") as found:
        read(data, tmp_path)
    assert "\n" not in str(found.value)


@pytest.mark.filterwarnings("ignore:.*is in SI units")
@pytest.mark.parametrize("kind", [*_KINDS, *_INNER])
def test_schema_and_program_take_the_same_of_every_field(kind, tmp_path):
    cls = {**_KINDS, **_INNER}[kind]
    values = (-1, 0, 0.5, 1, 5, "x", "50 %", "-1", "0", True, [], {}, [[0, 1, 1], [200, 1, 1]])
    differ = set()
    for item in fields(cls):
        for value in values:
            part = {**LEAST[cls], item.name: value}
            if kind == "winding":
                data = changed(FULL, "motors.0.winding", part)
                data["motors"][0] = {
                    **LEAST[Motor],
                    "rated_torque": 1e-3,
                    "peak_torque": 1e-3,
                    "winding": part,
                }
            else:
                data = {**FULL, kind: part if kind in _INNER else [part]}
            try:
                read(data, tmp_path)
                taken = True
            except DriveError:
                taken = False
            if taken != valid(data):
                differ.add((cls.__name__, item.name, str(value)))
    alone = {"flux", "torque_constant_rms", "torque_constant_peak", "voltage_constant", "max_current_rms"}
    alone |= {"phase_resistance", "amplifier"}  # these need others
    assert {each for each in differ if each[1] not in alone} <= {
        ("Gear", "efficiency", "0"),  # a schema does not know what number a text is, nor how numbers fit
        ("Screw", "efficiency", "0"),
        ("Belt", "efficiency", "0"),
        ("Rack", "efficiency", "0"),
        *(("Rack", name, text) for name in ("pretension", "max_tension") for text in ("0.5", "1", "5")),
        ("Screw", "preload", "50 %"),  # more than a tenth
        ("Supply", "duty", "0"),
        ("Supply", "feedback", "True"),  # with a resistor
        *(("Supply", "max_voltage", text) for text in ("0.5", "1", "5")),  # less than the other
        ("Motor", "peak_torque", "0.5"),
        ("Motor", "rated_torque", "5"),
        ("Motor", "curve", "[[0, 1, 1], [200, 1, 1]]"),
    }


# --- units --------------------------------------------------------------------------------------------------

FORMS = {
    "N m": {
        "1.3 Nm": 1.3,
        "1300 N mm": 1.3,
        "1.3": 1.3,
        "130 Ncm": 1.3,
        "1300 mNm": 1.3,
        "1.3 kg m^2/s²": 1.3,
    },
    "rad/s": {"3000 rpm": 3000 * RPM, "314 rad/s": 314.0, "18000 deg/s": 100 * math.pi},
    "kg m^2": {"0.3 kg cm^2": 3e-5, "30 kg mm²": 3e-5, "300 g cm²": 3e-5, "3e-5": 3e-5},
    "m": {"10 mm": 0.01, "0.5 in": 0.0127, "1 cm": 0.01},
    "W": {"0.9 kW": 900.0, "900 N m/s": 900.0, "1 hp": 745.69987158227022},
    "s": {"15 min": 900.0, "900": 900.0, "500 ms": 0.5},
    "V": {"0.32 kV": 320.0, "320 V": 320.0, "320 W/A": 320.0},
    "A": {"8.5 A": 8.5, "850 mA": 0.85},
    "ohm": {"0.7 ohm": 0.7, "0.7 Ω": 0.7, "700 mΩ": 0.7, "0.7 V/A": 0.7},
    "H": {"8 mH": 0.008, "800 uH": 8e-4, "8e-3 V s/A": 0.008},
    "V s": {"0.07 V s": 0.07, "70 mV s/rad": 0.07},
    "N": {"12 kN": 12e3, "1 kgf": 9.80665, "900": 900.0},
    "kg": {"2 kg": 2.0, "500 g": 0.5},
    "F": {"560 uF": 5.6e-4, "0.56 mF": 5.6e-4},
    "J": {"25 J": 25.0, "0.1 kJ": 100.0},
    "m/s^2": {"8 m/s^2": 8.0, "8000 mm/s²": 8.0},
    "m/s^3": {"400 m/s^3": 400.0},
    "N m/A": {"0.594 Nm/A": 0.594, "59.4 Ncm/A": 0.594},
}
FIELDS_WITH_UNITS = [
    (cls, item.name)
    for cls in (*_KINDS.values(), *_INNER.values())
    for item in fields(cls)
    if unit_of(cls, item.name)
]


@pytest.mark.parametrize(("cls", "name"), FIELDS_WITH_UNITS)
def test_a_number_in_any_unit_is_the_number_in_si_units_and_of_no_other_kind(cls, name):
    quantity = _UNITS[name]
    for text, value in FORMS[quantity.unit].items():
        assert quantity.read(text, "x") == pytest.approx(value, rel=1e-15)
    alike = {quantity.unit} | next(
        (pair for pair in ({"V s", "N m/A"}, {"N m", "J"}) if quantity.unit in pair), set()
    )
    others = {each for unit, texts in FORMS.items() if unit not in alike for each in texts}
    for text in others:
        if not re.fullmatch(r"[\d.e+-]+", text):
            assert not drives_schema.takes(cls, name, text), (name, text)
    for text in ("1,3", "1,3 Nm", "3 Nm 4", "1_0", "٣"):
        assert not drives_schema.takes(cls, name, text), (name, text)


# --- tables -------------------------------------------------------------------------------------------------

PLAIN = "Type,M0 [Nm],Mmax [Nm],n max [rpm],J [kg cm^2]\nM1,1.3,3.8,5000,0.3\nM2,2.4,7.2,6000,1.2\n"
NAMES = {
    "Type": "name", "M0 [Nm]": "rated_torque", "Mmax [Nm]": "peak_torque", "n max [rpm]": "max_speed",
    "J [kg cm^2]": "inertia",
}  # fmt: skip
BASE = {"table": "motors.csv", "columns": NAMES}
TWO = [Motor(1.3, 3.8, 5000 * RPM, 3e-5, name="M1"), Motor(2.4, 7.2, 6000 * RPM, 1.2e-4, name="M2")]


def imported(folder, text, table=BASE, encoding="utf-8", others=()):
    """Return what a catalogue with a table says, whose other parts are fixed."""
    data = text if isinstance(text, bytes) else text.encode(encoding)
    (folder / "motors.csv").write_bytes(data)
    return read({"motors": [*others, table] if others else table, "screws": [SCREW]}, folder)


def named(*columns):
    return dict(zip(columns, NAMES.values(), strict=True))


FORMS_OF_TABLES = {
    "plain": (PLAIN, BASE),
    "semicolons and decimal commas": (
        PLAIN.replace(",", ";").replace(".", ","),
        {**BASE, "separator": ";", "decimal": ","},
    ),
    "groups of digits": (
        PLAIN.replace(",", ";").replace(".", ",").replace("5000", "5.000").replace("6000", "6.000"),
        {**BASE, "separator": ";", "decimal": ",", "thousands": "."},
    ),
    "narrow spaces": (
        PLAIN.replace("5000", "5\u202f000").replace("6000", "6 000"),
        {**BASE, "thousands": " "},
    ),
    "apostrophes": (PLAIN.replace("5000", "5'000"), {**BASE, "thousands": "'"}),
    "tabs": (PLAIN.replace(",", "\t"), {**BASE, "separator": "\t"}),
    "units of the mapping": (
        "Type,M0,Mmax,n max,J\nM1,1300,3800,5000,300\nM2,2400,7200,6000,1200\n",
        {**BASE, "columns": {"Type": "name", "M0": "rated_torque [mNm]", "Mmax": "peak_torque [mNm]",
                             "n max": "max_speed [1/min]", "J": "inertia [gcm²]"}},
    ),
    "units of makers in the header": (
        "Type,M0 (N·m),Mmax (N.m),n max [min⁻¹],J (kgcm²)\nM1,1.3,3.8,5000,0.3\nM2,2.4,7.2,6000,1.2\n",
        {**BASE, "columns": named("Type", "M0 (N·m)", "Mmax (N.m)", "n max [min⁻¹]", "J (kgcm²)")},
    ),
    "units of the cells, which go first": (
        PLAIN.replace("2.4", "240 Ncm").replace("1.2\n", "120 kg mm^2\n").replace("1.3", '"1,300 N mm"'),
        {**BASE, "thousands": ","},
    ),
    "numbers of columns": (PLAIN, {**BASE, "columns": named(1, 2, 3, 4, 5)}),
    "lines above the header, of units below it, and blank ones": (
        "Servo motors\n\nType,M0,Mmax,n max,J\n,Nm,Nm,rpm,kgcm2\n\n" + PLAIN.partition("\n")[2] + "\n,,\n",
        {**BASE, "header": 3, "first": 5, "columns": {
            "Type": "name", "M0": "rated_torque [Nm]", "Mmax": "peak_torque [Nm]", "n max": "max_speed [rpm]",
            "J": "inertia [kg cm^2]"}},
    ),
    "a header of two lines in a cell, ends of lines of another system": (
        PLAIN.replace("M0 [Nm]", '"M0\n[Nm]"').replace("\n", "\r\n"), BASE,
    ),
    "a name in two columns, more columns, rows that end early": (
        "Type,Size,M0 [Nm],Mmax [Nm],n max [rpm],J [kg cm^2],price\n"
        "M,1,1.3,3.8,5000,0.3\nM2,,2.4,7.2,6000,1.2,9\n",
        {**BASE, "columns": {"Size": "name", **NAMES}},
    ),
    "what holds for all, and for empty cells": (
        PLAIN.replace("5000", "").replace("6000,1.2", "6000 rpm,"),
        {**BASE, "constant": {"max_speed": "5000 rpm", "inertia": "1.2 kg cm^2"}, "columns": NAMES},
    ),
    "a mark at the beginning": ("\ufeff" + PLAIN, BASE),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS_OF_TABLES)
def test_a_table_in_any_form_is_the_catalogue_written_out(form, tmp_path):
    text, table = FORMS_OF_TABLES[form]
    found = imported(tmp_path, text, table)
    expected = list(TWO)
    if form.startswith("a name"):
        expected[0] = replace(TWO[0], name="1 M", curve=None)
    assert valid(yaml.safe_load((tmp_path / "drives.yaml").read_text(encoding="utf-8")))
    assert same(found, Catalogue(expected, found.transmissions))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_table_in_any_encoding(encoding, tmp_path):
    word = {"shift_jis": "サーボ", "gb18030": "电机"}.get(encoding, "Größe")
    found = imported(tmp_path, PLAIN.replace("M1", word), {**BASE, "encoding": encoding}, encoding)
    assert [motor.name for motor in found.motors] == [word, "M2"]


def test_rows_of_one_name_are_the_points_of_a_curve(tmp_path):
    text = (
        "Type,M0 [Nm],Mmax [Nm],n max [rpm],J [kg cm^2],n [rpm],S1 [Nm],S6 [Nm]\n"
        "M1,1.3,3.8,5000,0.3,0,1.3,3.8\n,,,,,3000,1.3,3.8\nM1,1.3,,5000,,5000,900 mNm,1.5\n"
        "M2,2.4,7.2,6000,1.2,,,\nM3,2.4,7.2,6000,1.2,0,2.4,7.2\nM3,,,,,6000,2,7\n"
    )
    points = {"n [rpm]": "curve.speed", "S1 [Nm]": "curve.continuous", "S6 [Nm]": "curve.peak"}
    found = imported(tmp_path, text, {**BASE, "columns": NAMES | points})
    rated, fast = 3000 * RPM, 5000 * RPM
    curve = [[0, 1.3, 3.8], [rated, 1.3, 3.8], [fast, 0.9, 1.5]]
    third = replace(TWO[1], name="M3", curve=[[0, 2.4, 7.2], [6000 * RPM, 2, 7]])
    motors = [replace(TWO[0], curve=curve), TWO[1], third]
    assert same(found, Catalogue(motors, found.transmissions))


def test_a_winding_from_columns_and_constants(tmp_path):
    text = PLAIN.replace("[kg cm^2]\n", "[kg cm^2],kT,R,L,I,weak,p\n").replace(
        "0.3\n", "0.3,0.6,0.7,8,8,yes,4\n"
    )
    text = text.replace("1.2\n", "1.2,59.4 Ncm/A,0.7 V/A,8,15000 mA,no,5\n")
    columns = {
        "kT": "winding.torque_constant_rms [Nm/A]", "R": "winding.resistance [Ω]",
        "L": "winding.inductance [mH]", "I": "winding.max_current_rms [A]",
        "weak": "winding.field_weakening", "p": "winding.pole_pairs",
    }  # fmt: skip
    constant = {"winding": {"bus_voltage": "320 V", "measured": "phase"}, "max_inertia_ratio": 10}
    found = imported(tmp_path, text, {**BASE, "columns": NAMES | columns, "constant": constant})
    given = {"torque_constant_rms": 0.6, "max_current_rms": 8.0, "field_weakening": True}
    first = Winding(320.0, 4, 0.7, 0.008, "phase", **given)
    second = Winding(320.0, 5, 0.7, 0.008, "phase", torque_constant_rms=0.594, max_current_rms=15.0)
    assert [motor.winding for motor in found.motors] == [first, second]
    assert [motor.max_inertia_ratio for motor in found.motors] == [10, 10]


def test_tables_stand_beside_parts_and_shares_are_in_percent(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables/screws.csv").write_text("d0,Ph,d2,l,eta\n16,10,12.7,500,90 %\n20,20,16.7,600,0.92\n")
    (tmp_path / "motors.csv").write_text(PLAIN)
    columns = {
        "d0": "name",
        "Ph": "lead [mm]",
        "d2": "diameter [mm]",
        "l": "length [mm]",
        "eta": "efficiency",
    }
    screws = [SCREW, {"table": "tables/screws.csv", "columns": columns}]
    found = read({"motors": [MOTOR, BASE], "screws": screws}, tmp_path)
    assert [motor.name for motor in found.motors] == ["M400", "M1", "M2"]
    first, second = found.transmissions[1:]
    assert first == Screw(0.01, 0.9, diameter=0.0127, length=0.5, name="16")
    assert second == Screw(0.02, 0.92, diameter=0.0167, length=0.6, name="20")


def columns_with(**others):
    return {**BASE, "columns": NAMES | others}


def torque(text):
    return PLAIN.replace("M1,1.3", f'M1,"{text}"'), BASE


BAD = {
    "drives.yaml: motors: the field 'columns' is missing": (PLAIN, {"table": "motors.csv"}),
    "drives.yaml: motors: unknown field 'column', expected": (PLAIN, {**BASE, "column": {}}),
    "drives.yaml: motors: table: expected the name of a CSV file, got 5": (PLAIN, {**BASE, "table": 5}),
    "none.csv: cannot be read (No such file": (PLAIN, {**BASE, "table": "none.csv"}),
    "columns: expected columns and their fields, got a list": (PLAIN, {**BASE, "columns": ["a"]}),
    "motors: encoding: expected one of 'utf-8', 'utf-16'": (PLAIN, {**BASE, "encoding": "rot13"}),
    "separator: expected one of ',', ';', '\\t', '|', got ', '": (PLAIN, {**BASE, "separator": ", "}),
    "decimal: expected one of '.', ',', got ';'": (PLAIN, {**BASE, "decimal": ";"}),
    "thousands: expected another sign than decimal": (PLAIN, {**BASE, "thousands": "."}),
    "header: expected the number of a line, got True": (PLAIN, {**BASE, "header": True}),
    "first: expected the number of a line, got 0": (PLAIN, {**BASE, "first": 0}),
    "constant: expected fields, got 3": (PLAIN, {**BASE, "constant": 3}),
    "constant: unknown field 'max_inertia'; did you mean 'max_inertia_ratio'": (
        PLAIN, {**BASE, "constant": {"max_inertia": 10}}),
    "motors.csv, line 2: max_power: expected a power": (PLAIN, {**BASE, "constant": {"max_power": "3 Nm"}}),
    "columns: n max [rpm]: unknown field 'maxspeed'; did you mean 'max_speed'": (
        PLAIN, columns_with(**{"n max [rpm]": "maxspeed"})),
    "columns: Type: expected the name of a field, got 3": (PLAIN, columns_with(Type=3)),
    "columns: the field 'inertia' is given by more than one column": (
        PLAIN, {**BASE, "columns": {**NAMES, 1: "inertia"}}),
    "columns: expected a column for the field 'name'": (PLAIN, columns_with(Type=[])),
    "columns: expected curve.speed, curve.continuous, curve.peak, got curve.peak alone": (
        PLAIN, columns_with(Type=["name", "curve.peak"])),
    "motors.csv, line 1: expected a column 'Name', got Type, M0 [Nm]": (PLAIN, columns_with(Name="drag")),
    "expected a column 'n max [rpm', got Type, M0 [Nm], Mmax [Nm], n max [rpm], J [kg cm^2]; did you mean": (
        PLAIN, columns_with(**{"n max [rpm": "rated_speed"})),
    "is the `separator` ';'?": (PLAIN.replace(",", ";"), BASE),
    "motors.csv, line 1: expected a column from 1 to 5, got 6": (
        PLAIN, {**BASE, "columns": {**NAMES, 6: "drag"}}),
    "motors.csv, line 1: 2 columns are called 'M0 [Nm]': give the number": (
        PLAIN.replace("Mmax", "M0"), BASE),
    "columns: M0 [Nm]: expected the unit of the column, Nm, got mNm": (
        PLAIN, columns_with(**{"M0 [Nm]": "rated_torque [mNm]"})),
    "columns: M0 [Nm]: expected a moment": (PLAIN, columns_with(**{"M0 [Nm]": "rated_torque [kg]"})),
    "columns: Type: expected a field without a unit, got [mm]": (PLAIN, columns_with(Type="name [mm]")),
    "motors.csv, line 2, column 'M0 [Nm]': expected a number (decimal '.'), got '1,3'": torque("1,3"),
    "line 2, column 'M0 [Nm]': expected a number (decimal '.'), got '1.3.5'": torque("1.3.5"),
    "got '≤ 1.3'": torque("≤ 1.3"),
    "got '1.3 ± 0.1'": torque("1.3 ± 0.1"),
    "got '٣'": torque("٣"),
    "line 2, column 'M0 [Nm]': expected a moment, a number in N m": torque("1.3 kg"),
    "line 2, column 'M0 [Nm]': expected a value, got none": torque(" – "),
    "expected a moment, a number in N m": torque("1e999"),
    "line 2, column 'J [kg cm^2]': expected a finite number, got '1e999'": (
        PLAIN.replace("0.3", "1e999"), columns_with(**{"J [kg cm^2]": "max_inertia_ratio"})),
    "line 2, column 'n max [rpm]': expected a number (decimal '.', thousands ','), got '50,00'": (
        PLAIN.replace("5000", '"50,00"'), {**BASE, "thousands": ","}),
    "line 2, column 'M0 [Nm]': expected a number (decimal ','), got '1.3'": (PLAIN, {**BASE, "decimal": ","}),
    "motors.csv, line 3: M2: peak_torque: expected at least the rated torque": (
        PLAIN.replace("7.2", "2"), BASE),
    "motors.csv, line 3, column 'Type': expected a value, got none": (PLAIN.replace("M2", ""), BASE),
    "the name 'M1' is given twice": (PLAIN.replace("M2", "M1"), BASE),
    "column 'Type': expected at most 200 characters, got 300": (PLAIN.replace("M2", 300 * "x"), BASE),
    "line 2, column 'J [kg cm^2]': expected a number without a unit, got '0.3 kg'": (
        PLAIN.replace("0.3", "0.3 kg"), columns_with(**{"J [kg cm^2]": "max_inertia_ratio"})),
    "expected yes or no, got 'M1'": (PLAIN, columns_with(Type=["name", "winding.field_weakening"])),
    "motors.csv: expected a row at least": ("Type\n", {**BASE, "columns": {"Type": "name"}}),
    "motors.csv: expected a line with the names of the columns": ("\n\n", BASE),
    "motors.csv, line 2: not valid CSV": (PLAIN.replace("M1", '"M"1'), BASE),
    "motors.csv: expected utf-8 text, got invalid": (PLAIN.replace("M1", "é").encode("latin-1"), BASE),
    "line 20001: expected at most 20000 rows of 500 cells": (PLAIN + "M3,1,1,1,1\n" * 20_000, BASE),
    "line 2: expected at most 20000 rows of 500 cells": (PLAIN.replace("M1", "M1" + 500 * ","), BASE),
    "motors.csv: expected at most 5000000 bytes": (PLAIN + " " * 5_000_000, BASE),
    "line 3: max_speed: expected what the rows before say of 'M1'": (
        "Type,M,n,v\nM1,1,0,9\nM1,1,9,8\n", {"table": "motors.csv", "columns": {
            "Type": "name", "M": ["rated_torque", "peak_torque", "inertia", "curve.continuous", "curve.peak"],
            "n": "curve.speed", "v": "max_speed"}}),
    "motors.csv, line 2: curve.speed: expected a value, got none": (
        "Type,M,n\nM1,1,\n", {"table": "motors.csv", "columns": {
            "Type": "name", "M": ["rated_torque", "peak_torque", "inertia", "max_speed", "curve.continuous",
                                  "curve.peak"], "n": "curve.speed"}}),
}  # fmt: skip


@pytest.mark.parametrize("words", BAD)
def test_a_bad_table_is_one_line_with_file_row_and_column(words, tmp_path):
    text, table = BAD[words]
    with pytest.raises(P3dofError, match=r"\A[^\n]*\Z") as found:
        imported(tmp_path, text, table)
    assert words in str(found.value)


# --- generic sizes ------------------------------------------------------------------------------------------

BALLS = {8: 1.5, 12: 2.381, 16: 3.175, 20: 3.175, 25: 3.175, 32: 4.763}  # usual ones [mm]
ROOTS = {(8, 2.5): 6.65, (16, 5): 13.32, (16, 16): 13.12, (20, 5): 17.32, (20, 10): 17.32, (20, 20): 17.32,
         (25, 5): 22.32, (25, 10): 22.32, (25, 25): 22.32, (32, 10): 28.13, (32, 20): 28.13,
         (32, 32): 28.74}  # fmt: skip
"""Of ground screws by nominal diameter and lead, HIWIN BS-08-2-EN-1704-K, tables 6.4 and 6.6 [mm]."""
LEADS = (1, 2, 2.5, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40)  # nominal ones of ISO 3408-2 [mm]


def test_generic_screws_have_sizes_of_the_standard_and_roots_as_makers_have():
    """A rolled screw is a little thinner than a ground one: 2 to 7 % at the root."""
    found = {}
    for screw in GENERIC.transmissions:
        size, lead = screw.name.removeprefix("generic ").split("x")
        found[int(size), float(lead)] = 1e3 * screw.diameter
        assert 1e3 * screw.lead == pytest.approx(float(lead), rel=1e-15)
        assert float(lead) in LEADS
        assert -1e-12 < int(size) - 1e3 * screw.diameter - BALLS[int(size)] <= 0.25
    for key, root in ROOTS.items():
        assert 0.93 * root < found[key] < 0.98 * root


RATINGS = {
    (16, 5): (7310, 13310), (20, 5): (8520, 17670), (25, 5): (9770, 23140), (16, 16): (6800, 13850),
    (20, 20): (7600, 17300), (20, 10): (11300, 26600), (25, 10): (12600, 33700), (32, 10): (38500, 108900),
}  # fmt: skip
"""C_a and C_0a of that maker's nuts [N]: five with as many balls as the generic ones, others with more."""


def test_load_ratings_of_generic_nuts_are_those_of_thrust_bearings_and_below_a_makers():
    """ISO 281: C_a as Z^(2/3) D_w^1.8; ISO 76: C_0a as Z D_w²; with the cosine of the lead angle."""
    found, exact = {}, {}
    for screw in GENERIC.transmissions:
        size, lead = (float(number) for number in screw.name.removeprefix("generic ").split("x"))
        ball, cosine = BALLS[size], math.pi * size / math.hypot(math.pi * size, lead)
        count = math.pi * size / ball
        exact[size, lead] = (count ** (2 / 3) * ball**1.8 * cosine, count * ball**2 * cosine)
        found[size, lead] = (screw.dynamic, screw.static)
    for k, factor in ((0, 300 / math.pi ** (2 / 3)), (1, 250 / math.pi)):
        for key, rating in found.items():
            assert rating[k] % 500 == 0
            assert 0 <= factor * exact[key][k] - rating[k] < 500
    for number, (key, ratings) in enumerate(RATINGS.items()):
        for mine, makers in zip(found[key], ratings, strict=True):
            assert (0.84 if number < 5 else 0.3) * makers < mine < makers


# --- writing ------------------------------------------------------------------------------------------------


def random_catalogue(seed):
    """Return a catalogue in which most fields have numbers of no meaning, with all their digits."""
    rng = np.random.default_rng(seed)

    def number(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def some(**values):
        return {name: value for name, value in values.items() if rng.random() < 0.5}

    def motor(k):
        rated, fast = number(0.01, 30), number(100, 1000)
        speed = np.append(0.0, np.sort(rng.uniform(1, fast, 3)))
        curve = np.column_stack([np.append(speed, fast), np.full(5, rated), np.full(5, 3 * rated)])
        winding = Winding(
            number(24, 600), int(rng.integers(1, 9)), number(0.1, 9), number(1e-4, 0.1), "phase",
            max_current_peak=number(1, 50), field_weakening=bool(rng.integers(2)),
            **{["flux", "voltage_constant"][rng.integers(2)]: 1e6},
        )  # fmt: skip
        more = some(
            rated_speed=number(1, fast), brake_torque=number(0.1, 9), coupling_inertia=number(1e-7, 1e-4),
            drag=number(1e-3, 1), time_constant=number(1, 2000), max_inertia_ratio=number(1, 20),
            max_power=number(10, 1e4), curve=curve, winding=winding,
        )  # fmt: skip
        return Motor(rated, 3 * rated, fast, number(1e-7, 1e-2), name=f"motor {k}", **more)

    def screw(k):
        more = some(
            inertia=number(1e-7, 1e-4), drag=number(1e-3, 1), max_speed=number(10, 900), ends="fixed-free"
        )
        size = {"diameter": number(0.005, 0.05), "length": number(0.1, 2)}
        return Screw(number(0.002, 0.04), rng.uniform(0.3, 1), name=f"screw {k}", **size, **more)

    belts = [Belt(number(0.01, 0.1), name="belt: 1, [2]", **some(efficiency=0.5, drag=0.1))]
    gears = [Gear(number(1, 20), name=f"i{k}", **some(inertia=1e-6 / 3, max_torque=7.7)) for k in range(2)]
    screws = [screw(k) for k in range(3)]
    return Catalogue([motor(k) for k in range(4)], screws + belts, gears if seed % 2 else [Gear()])


@pytest.mark.filterwarnings("ignore:.*is in SI units")
@pytest.mark.parametrize("seed", range(12))
def test_what_is_written_is_read_again_to_the_last_bit(seed, tmp_path):
    catalogue = random_catalogue(seed)
    path = write_catalogue(catalogue, tmp_path / "new" / "all.yaml")
    assert same(read_catalogue(path), catalogue)
    assert valid(yaml.safe_load(path.read_text(encoding="utf-8")))
    assert dump(read_catalogue(path)) == path.read_text(encoding="utf-8")


def test_what_follows_from_the_rest_is_not_written():
    text = dump(Catalogue([replace(TWO[0], curve=None)], [Screw(0.01, diameter=0.0127, length=0.5)]))
    assert yaml.safe_load(text) == {
        "motors": [
            {
                "name": "M1",
                "rated_torque": "1.3 Nm",
                "peak_torque": "3.8 Nm",
                "max_speed": "5000 rpm",
                "inertia": "0.3 kg cm^2",
            }
        ],
        "screws": [{"name": "screw", "lead": "10 mm", "diameter": "12.7 mm", "length": "500 mm"}],
    }


def test_a_catalogue_that_is_none_or_too_large_is_not_written(tmp_path):
    with pytest.raises(DriveError, match="catalogue: expected a Catalogue, got 3"):
        write_catalogue(3, tmp_path / "x.yaml")
    many = [replace(TWO[0], name=f"M{k}", curve=None) for k in range(2500)]
    with pytest.raises(DriveError, match=r"x\.yaml.*expected at most 20000 values"):
        write_catalogue(Catalogue(many, [D]), tmp_path / "x.yaml")
    assert list(tmp_path.iterdir()) == []


D = Screw(0.01, inertia=0.0)


# --- the commands -------------------------------------------------------------------------------------------


def test_a_table_is_sized_as_the_catalogue_written_out(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(PICK_AND_PLACE, encoding="utf-8")
    imported(tmp_path, PLAIN)
    code, _, err = run(capsys, "init", "all", "--drives", "drives.yaml", "--drives-only")
    assert (code, err) == (0, "")
    assert [path.name for path in (tmp_path / "all").iterdir()] == ["drives.yaml"]
    assert same(read_catalogue("all/drives.yaml"), read_catalogue("drives.yaml"))
    told = [
        run(capsys, "size", "task.yaml", "--duration", 2, "--samples", 201, "--drives", path)
        for path in ("drives.yaml", "all/drives.yaml")
    ]
    assert told[0] == told[1]
    assert told[0][0] == 0
    assert "M1 + 16x10" in told[0][1]


def test_one_file_of_drives_to_edit(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(capsys, "init", "--drives-only")
    assert (code, out) == (0, "wrote drives.yaml\n")
    assert same(read_catalogue("drives.yaml"), GENERIC)
    assert "of no maker" in (tmp_path / "drives.yaml").read_text(encoding="utf-8")
    code, _, err = run(capsys, "init", "--drives", "drives.yaml", "--force")
    assert code == 2
    assert "drives.yaml would be overwritten" in err
    code, _, err = run(capsys, "init", "--drives-only")
    assert (code, err.count("exists already")) == (2, 1)
