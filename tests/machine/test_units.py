"""Units in parameter files, and lengths in millimetres that were meant to be metres."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from machines import random_machine
from scipy import constants

import p3dof
from p3dof._base.errors import ParameterError
from p3dof._base.quantities import (
    _UNITS,
    ANGLE,
    CURRENT,
    FLUX,
    FORCE,
    INDUCTANCE,
    INERTIA,
    LENGTH,
    MASS,
    MOMENT,
    POWER,
    PRESSURE,
    RESISTANCE,
    TORQUE_CONSTANT,
    VOLTAGE,
)
from p3dof.cli import main
from p3dof.machine.parameters import PAPER, Body, Geometry, box
from p3dof.machine.parameters.body import inertial_of_cylinder, inertial_of_plate
from p3dof.machine.parameters.machine import doubt, dump, parse

PLAIN = """
geometry: {r: 0.12, R: 0.25, L: 0.4, b: 0.05}
bodies:
  slider: {mass: 0.95, com: [0, 0, -0.01], inertia: [4.1e-4, 4.1e-4, 4.1e-4]}
  leg: {mass: 0.98, com: [0.2, 0, 0], inertia: [6.1e-4, 0.0524, 0.0524], about: [0.1, 0, 0]}
  crossbar: {mass: 0, com: [0, 0, 0], inertia: [0, 0, 0]}
  platform: {mass: 8.1, com: [-0.031, 0, 0], inertia: [[0.02, 1e-4, 0], [1e-4, 0.02, 0], [0, 0, 0.03]]}
limits: {travel: [-0.2, 0.25], speed: 1.5, force: 1200, tilt: [-0.5235987755982988, 0.7853981633974483]}
gravity: [0, 0, -9.806]
friction:
  viscous: {sliders: 20, joints: 0.01, hinge_a: 0.02}
  coulomb: {slide_b: 5, hinge_platform: 0.05}
  smoothing: 0.002
payload: {mass: 1.5, com: [0, 0, -0.1], inertia: [3.8e-4, 3.8e-4, 4.1e-4]}
"""
UNITS = """
geometry: {r: 120 mm, R: 25 cm, L: 0.4 m, b: 50000 um}
bodies:
  slider: {mass: 950 g, com: [0, 0, -10mm], inertia: [410 kg mm^2, 410 kg·mm², 410000 g mm^2]}
  leg:
    {mass: 980 g, com: [200 mm, 0, 0], inertia: [610 kg mm^2, 52400 kg mm2, 524 kg cm^2], about: [10cm, 0, 0]}
  crossbar: {mass: 0 g, com: [0 mm, 0 mm, 0 mm], inertia: [0, 0, 0]}
  platform:
    mass: 0.0081 t
    com: [-31 mm, 0, 0]
    inertia: [[20000 kg mm^2, 100 kg mm^2, 0], [100 kg mm^2, 20000 kg mm^2, 0], [0, 0, 30000 kg mm^2]]
limits: {travel: [-200 mm, 250 mm], speed: 1500 mm/s, force: 1.2 kN, tilt: [-30 deg, 45°]}
gravity: [0, 0, -9806 mm/s^2]
friction:
  viscous: {sliders: 0.02 N s/mm, joints: 10 N mm s/rad, hinge_a: 0.02 N m s}
  coulomb: {slide_b: 0.005 kN, hinge_platform: 50 N mm}
  smoothing: 2 mm/s
payload: {mass: 1500 g, com: [0, 0, -100 mm], inertia: [380 kg mm^2, 380 kg mm^2, 410 kg mm^2]}
"""


def test_a_file_with_units_is_the_file_without():
    """To the last bit: what is written is rounded once."""
    assert dump(parse(UNITS)) == dump(parse(PLAIN))
    assert parse(PLAIN).geometry == Geometry(0.12, 0.25, 0.4, 0.05)


@pytest.mark.parametrize(
    ("quantity", "text", "value"),
    [
        (LENGTH, "120 mm", 0.12),
        (LENGTH, "-0.1e3 mm", -0.1),
        (LENGTH, ".5 µm", 5e-7),
        (LENGTH, "1.5", 1.5),
        (LENGTH, "2 kN s^2/t", 2.0),
        (MASS, "950 g", 0.95),
        (MASS, "3 N s²/m", 3.0),
        (INERTIA, "7 N m s^2", 7.0),
        (ANGLE, "45 deg", math.pi / 4),
        (ANGLE, "250 mrad", 0.25),
        (FORCE, "1.5 kN", 1500.0),
        (FORCE, "2 kg m s^-2", 2.0),
        (LENGTH, "10 in", 0.254),
        (LENGTH, "2 ft", 0.6096),
        (MASS, "3 lb", 1.36077711),
        (FORCE, "100 lbf", 444.82216152605),
        (FORCE, "2 kgf", 19.6133),
        (FORCE, "16 ozf", 4.4482216152605),
        (MASS, "4 oz", 0.11339809250),
        (POWER, "1 hp", 745.6998715822702),
        (PRESSURE, "1 psi", 6894.757293168362),
        (MOMENT, "10 lbf in", 1.129848290276167),
        (MOMENT, "64 Ncm", 0.64),
        (MOMENT, "12 mNm", 0.012),
        (CURRENT, "850 mA", 0.85),
        (VOLTAGE, "0.32 kV", 320.0),
        (RESISTANCE, "700 mΩ", 0.7),
        (RESISTANCE, "0.7 \u2126", 0.7),
        (RESISTANCE, "0.7 V/A", 0.7),
        (INDUCTANCE, "8 mH", 0.008),
        (INDUCTANCE, "8 V ms/A", 0.008),
        (FLUX, "70 mV s", 0.07),
        (TORQUE_CONSTANT, "59.4 Ncm/A", 0.594),
        (INERTIA, "0.4 lb in^2", 1.1705586137168e-4),
        (LENGTH, ["120 mm", 0, "0 m"], [0.12, 0, 0]),
        (LENGTH, 3, 3),
        (LENGTH, None, None),
    ],
)
def test_numbers_with_units(quantity, text, value):
    assert quantity.read(text, "x") == value


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("r: 0.12", "r: 120 kg", "geometry.r: expected a length, a number in m or one with a unit such as"),
        ("r: 0.12", "r: 120 furlongs", "'1 mm', got '120 furlongs'"),
        ("r: 0.12", "r: '1_000'", "got '1_000'"),
        ("r: 0.12", "r: 120 mm mm", "got '120 mm mm'"),
        ("r: 0.12", "r: 120 mm/", "got '120 mm/'"),
        ("r: 0.12", "r: 1/2 m", "got '1/2 m'"),
        ("r: 0.12", "r: 1 m/s/s", "got '1 m/s/s'"),
        ("r: 0.12", "r: 1e999 mm", "got '1e999 mm'"),
        ("r: 0.12", "r: 1e9999999999 mm", "got '1e9999999999 mm'"),
        ("r: 0.12", f"r: {'9' * 500} mm", "9'..."),
        ("mass: 0.95,", "mass: 950 mm,", "bodies.slider.mass: expected a mass, a number in kg or one with"),
        ("[4.1e-4, 4.1e-4, 4.1e-4]", "[1 g mm, 1 g mm, 1 g mm]", "slider.inertia: expected an inertia"),
        ("force: 1200", "force: 1200 kg", "limits.force: expected a force"),
        ("tilt: [-0.5235987755982988, 0.7853981633974483]", "tilt: [-30 mm, 0]", "expected an angle"),
        ("speed: 1.5", "speed: 90 deg/s", "limits.speed: expected a speed"),
        ("-9.806]", "1 g]", "gravity: expected an acceleration"),
        ("sliders: 20", "sliders: 20 N m s", "viscous.sliders: expected viscous friction of a slide"),
        ("joints: 0.01", "joints: 1 N s/m", "friction.viscous.joints: expected viscous friction of a hinge"),
        ("slide_b: 5", "slide_b: 5 N m", "friction.coulomb.slide_b: expected a force"),
        ("platform: 0.05", "platform: 5 N", "friction.coulomb.hinge_platform: expected a moment"),
        ("[0, 0, -0.1]", "[0, 30, -100 mm]", "payload.com: expected a unit with every number but 0, or with"),
    ],
)  # fmt: skip
def test_wrong_units(old, new, words):
    assert old in PLAIN
    with pytest.raises(ParameterError) as info:
        parse(PLAIN.replace(old, new), "m.yaml")
    assert str(info.value).startswith("m.yaml: ")
    assert str(info.value).count("m.yaml") == 1
    assert words in str(info.value)
    assert len(str(info.value)) < 250
    assert "\n" not in str(info.value)


MILLIMETRES = "geometry: {r: 120, R: 250, L: 400, b: 50}"
REFUSED = {
    MILLIMETRES: "geometry: L = 400 m is more than 20 m: lengths are in metres; did you mean '400 mm'",
    "geometry: {r: 0.12, R: 0.25, L: 0.4, b: 50}": "b = 50 m is more than 20 m",
    "geometry: {r: 1.2e-4, R: 2.5e-4, L: 4e-4, b: 5e-5}": "L = 0.0004 m, is less than 0.001 m",
}


@pytest.mark.parametrize("geometry", REFUSED)
def test_machines_of_another_unit(tmp_path, capsys, geometry):
    text = PLAIN.replace("geometry: {r: 0.12, R: 0.25, L: 0.4, b: 0.05}", geometry)
    file = tmp_path / "m.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError) as info:
        p3dof.read_parameters(file)
    assert REFUSED[geometry] in str(info.value)
    with pytest.raises(ParameterError, match="any_size=True"):
        p3dof.load(file)
    assert p3dof.load(file, any_size=True).parameters.geometry == p3dof.read_parameters(file, True).geometry
    for command in ("forces", "urdf", "export", "codegen"):
        out = tmp_path / ("out.csv" if command == "forces" else "out")
        arguments = [command, "--parameters", str(file), "--out", str(out)]
        assert main(arguments) == 2
        told = capsys.readouterr().err
        assert told.startswith("p3dof: error: ")
        assert REFUSED[geometry].removeprefix("m.yaml: ") in told
        assert "--any-size" in told
    assert main(["codegen", "--parameters", str(file), "--out", str(tmp_path / "out"), "--any-size"]) == 0


def test_mass_centres_of_another_unit(tmp_path, capsys):
    with pytest.raises(ParameterError, match=r"leg_a: com: 200 m is more than 20 m.*did you mean '200 mm'"):
        parse(PLAIN.replace("com: [0.2, 0, 0]", "com: [200, 0, 0]").replace("about: [0.1", "about: [200"))
    with pytest.raises(ParameterError, match="payload: com: 100 m is more than 20 m"):
        parse(PLAIN.replace("com: [0, 0, -0.1]", "com: [0, 0, -100]"))
    assert main(["forces", "--samples", "11", "--payload", "5,0,0,-100"]) == 2
    assert "--payload: 100 m is more than 20 m: lengths are in metres" in capsys.readouterr().err
    out = ["--samples", "11", "--out", str(tmp_path / "f.csv")]
    assert main(["forces", *out, "--payload", "5,0,0,-100", "--any-size"]) == 0
    plain, units = tmp_path / "plain.csv", tmp_path / "units.csv"
    assert main(["forces", "--samples", "11", "--out", str(plain), "--payload", "5,0,0,-0.1"]) == 0
    assert main(["forces", "--samples", "11", "--out", str(units), "--payload", "5000 g,0,0,-100 mm"]) == 0
    assert plain.read_bytes() == units.read_bytes()
    assert main(["forces", *out, "--payload", "5 mm"]) == 2
    assert "expected a mass" in capsys.readouterr().err


def test_machines_made_in_python_may_have_any_size():
    machine = replace(PAPER, geometry=Geometry(120, 250, 400, 50))
    assert p3dof.load(machine).parameters is machine
    assert parse(dump(machine), any_size=True).geometry == machine.geometry
    assert np.isfinite(p3dof.load(machine).forces(np.zeros(3), np.zeros(3), np.zeros(3))).all()


SI = {
    (1, 0, 0, 0, 0): {"m": 1, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "um": 1e-6, "km": 1e3}
    | {"in": constants.inch, "ft": constants.foot},
    (0, 1, 0, 0, 0): {"kg": 1, "g": constants.gram, "t": 1e3, "lb": constants.lb, "oz": constants.oz},
    (0, 0, 1, 0, 0): {"s": 1, "ms": 1e-3, "min": constants.minute},
    (0, 0, 0, 1, 0): {"rad": 1, "mrad": 1e-3, "deg": constants.degree, "°": constants.degree},
    (0, 0, -1, 0, 0): {"Hz": 1, "kHz": 1e3},
    (0, 0, -1, 1, 0): {"rpm": 2 * np.pi / constants.minute},
    (1, 1, -2, 0, 0): {"N": 1, "mN": 1e-3, "kN": 1e3}
    | {"lbf": constants.lbf, "kgf": constants.kgf, "ozf": constants.lbf / 16},
    (2, 1, -3, 0, 0): {"W": 1, "kW": 1e3, "hp": constants.hp},
    (-1, 1, -2, 0, 0): {"Pa": 1, "MPa": 1e6, "GPa": 1e9, "psi": constants.psi},
    (2, 1, -2, 0, 0): {"Nm": 1, "Nmm": 1e-3, "Ncm": 1e-2, "mNm": 1e-3, "J": 1, "kJ": 1e3},
    (0, 0, 0, 0, 1): {"A": 1, "mA": 1e-3},
    (2, 1, -3, 0, -1): {"V": 1, "mV": 1e-3, "kV": 1e3},
    (2, 1, -3, 0, -2): {"ohm": 1, "Ω": 1, "mohm": 1e-3, "mΩ": 1e-3},
    (2, 1, -2, 0, -2): {"H": 1, "mH": 1e-3, "uH": 1e-6, "µH": 1e-6},
    (-2, -1, 4, 0, 2): {"F": 1, "mF": 1e-3, "uF": 1e-6, "µF": 1e-6},
}
"""What units are by metre, kilogram, second, radian and ampere: by SciPy's constants."""


def test_every_unit_is_what_it_is_elsewhere():
    """All of them, none besides; those of SciPy have nine digits at least."""
    known = {name: (powers, value) for powers, part in SI.items() for name, value in part.items()}
    assert set(_UNITS) <= set(known)
    for name, (powers, factor) in _UNITS.items():
        assert powers == known[name][0], name
        assert float(factor) == pytest.approx(known[name][1], rel=1e-9), name


def test_a_solid_box_is_the_sum_of_its_grains():
    """Grains of a cube each, which have a m²/6 about their own middle."""
    size, density, edge = (0.2, 0.3, 0.1), 2700.0, 0.05
    found = box(size, density)
    at = np.stack(np.meshgrid(*(np.arange(edge / 2, s, edge) - s / 2 for s in size)), -1).reshape(-1, 3)
    grain = density * edge**3
    own, squares = grain * edge**2 / 6, grain * (at**2).sum(axis=0)
    assert found.mass == pytest.approx(grain * len(at), rel=1e-12)
    np.testing.assert_allclose(found.com, 0, rtol=0, atol=1e-16)
    expected = np.diag(squares.sum() - squares + own * len(at))
    np.testing.assert_allclose(found.inertia, expected, rtol=0, atol=1e-12 * expected.max())


def test_a_solid_cylinder_by_quadrature():
    """Gauss's rule along the axis and the radius, and the mean around: exact for these polynomials."""
    x, w = np.polynomial.legendre.leggauss(4)
    radius, length, density, start = 0.3, 0.7, 2.5, -0.1
    r, along = (x + 1) * radius / 2, start + (x + 1) * length / 2
    ring = density * 2 * np.pi * (w * r)[:, None] * w * radius / 2 * length / 2  # (r, along)
    mass = ring.sum()
    centre = (ring * along).sum() / mass
    axial, across = (
        (ring * r[:, None] ** 2).sum(),
        (ring * (r[:, None] ** 2 / 2 + (along - centre) ** 2)).sum(),
    )
    for axis in range(3):
        found = inertial_of_cylinder(radius, length, axis, start, density)
        moments = np.roll([axial, across, across], axis)
        assert found.mass == pytest.approx(mass, rel=1e-12)
        np.testing.assert_allclose(found.com, np.roll([centre, 0, 0], axis), atol=1e-15)
        np.testing.assert_allclose(found.inertia, np.diag(moments), rtol=1e-12)


@pytest.mark.parametrize("turned", [False, True])
def test_a_widened_plate_by_counting_points(turned):
    """Points of a fine grid that are no farther from the triangle than the radius; either way around."""
    corners = np.array([[0.0, 0.1], [1.0, 0.0], [0.3, 0.8]])[:: -1 if turned else 1]
    size, radius, thickness, density = 0.5, 0.07, 0.02, 3.0
    step = 1e-3
    grid = np.stack(np.meshgrid(np.arange(-0.1, 0.7, step), np.arange(-0.1, 0.6, step)), axis=-1).reshape(
        -1, 2
    )
    a, b, c = size * np.array([[0.0, 0.1], [1.0, 0.0], [0.3, 0.8]])
    far, inside = np.full(len(grid), np.inf), np.ones(len(grid), bool)
    for p, q in ((a, b), (b, c), (c, a)):
        d, e = q - p, grid - p
        share = np.clip(e @ d / (d @ d), 0, 1)
        far = np.minimum(far, np.linalg.norm(e - share[:, None] * d, axis=1))
        inside &= d[0] * e[:, 1] - d[1] * e[:, 0] >= 0
    points = grid[inside | (far <= radius)]
    mass = density * thickness * step**2 * len(points)
    centre, d = points.mean(axis=0), points - points.mean(axis=0)
    (xx, xy), (_, yy) = mass * d.T @ d / len(points)
    thin = mass * thickness**2 / 12
    inertia = [[yy + thin, -xy, 0], [-xy, xx + thin, 0], [0, 0, xx + yy]]
    found = inertial_of_plate(corners, size, radius, thickness, density)
    assert found.mass == pytest.approx(mass, rel=1e-3)  # points at the edge: their number by that of all
    np.testing.assert_allclose(found.com, [*centre, 0], atol=1e-4)
    np.testing.assert_allclose(found.inertia, inertia, rtol=0, atol=2e-3 * inertia[2][2])


PLATFORM = "platform: {mass: 8.1573,"
DOUBTED = {  # what is changed in the paper's file, and what is told of it
    "a length": (
        ("r: 0.1,", "r: 1.0e-05,"),
        "m.yaml: geometry.r = 1e-05 m beside 0.4 m (mm?): units are m, kg",
    ),
    "a mass": (("mass: 8.1573", "mass: 8157.3"), "platform.mass = 8157.3 kg in a machine of 0.65 m (g?)"),
    "a mass centre": (
        ("com: [0.2, 0.0, 0.0]", "com: [5, 0.0, 0.0]"),
        "com = 5 m in a machine of 0.65 m (mm?)",
    ),
    "a payload": (("geometry", "payload: 950\ngeometry"), "payload of 950 kg on a machine of 15 kg (g?)"),
}


@pytest.mark.parametrize("what", DOUBTED)
def test_numbers_that_seem_to_be_in_another_unit_are_told(what):
    (old, new), line = DOUBTED[what]
    text = dump(PAPER)
    assert old in text
    with pytest.warns(p3dof.errors.ModelWarning) as told:
        machine = parse(text.replace(old, new), "m.yaml")
    assert len(told) == 1
    assert line in str(told[0].message)
    assert "\n" not in str(told[0].message)
    assert dump(parse(text.replace(old, new), "m.yaml", any_size=True)) == dump(machine)  # and not a word


def of_platform(inertia, mass=8.1573):
    platform = Body(mass, [0, 0, 0], inertia)
    return replace(PAPER, bodies=replace(PAPER.bodies, platform=platform))


def test_inertias_are_held_to_mass_and_size():
    """None is told whose mass lies within the machine; none is taken whose mass is ten times as far away."""
    size = PAPER.geometry.R + PAPER.geometry.L
    ring = 8.1573 * np.array([1, 1, 2]) * size**2 / 2  # a ring of that radius
    doubt(of_platform(ring))
    with pytest.warns(
        p3dof.errors.ModelWarning, match=r"platform.inertia = .* of 8.1573 kg .*\(kg mm\^2\?\)"
    ):
        doubt(of_platform(4 * ring))
    text = dump(of_platform(np.array([0.0269, 0.0501, 0.0658]) * 1e6))
    with pytest.raises(ParameterError) as told:
        parse(text, "m.yaml")
    assert str(told.value) == (
        "m.yaml: platform.inertia = 71400 kg m^2 of 8.1573 kg in a machine of 0.65 m: no such body is; did "
        "you mean kg mm^2? (--any-size, or any_size=True, takes it as it is)"
    )
    with pytest.raises(ParameterError, match="no such body is"):
        doubt(parse(text, any_size=True))
    assert parse(text, any_size=True).bodies.platform.mass == 8.1573


def test_machines_all_in_grams_are_told_and_others_are_not():
    with pytest.warns(p3dof.errors.ModelWarning, match=r"platform.mass = 8157.3 kg in a machine"):
        doubt(replace(PAPER, bodies=PAPER.bodies.scaled(1000)))
    for factor in (1e-6, 0.1, 10, 100):
        doubt(replace(PAPER, bodies=PAPER.bodies.scaled(factor)))
    for scale in (1e-3, 0.1, 10, 40):
        g = PAPER.geometry
        doubt(p3dof.of_solids(Geometry(*(scale * length for length in (g.r, g.R, g.L, g.b)))))
    for seed in range(300):
        doubt(random_machine(seed))
        doubt(random_machine(seed).carrying(Body(5)))


def test_a_mass_alone_is_a_point_mass():
    point = Body(3, [0, 0, 0], [0, 0, 0])
    known = dump(PAPER.carrying(point))
    assert Body(3).to_dict() == point.to_dict()
    for payload in (3, 3.0, np.float64(3), "3", "3 kg", "3000 g", Body(3)):
        assert dump(PAPER.carrying(payload)) == known
    for text in ("3", "3 kg", "{mass: 3000 g}", "{mass: 3, com: [0, 0, 0]}"):
        assert dump(parse(f"{dump(PAPER)}\npayload: {text}\n")) == known
    for wrong, words in (
        ("5 mm", "payload: expected a mass, a number in kg or one with a unit such as '1 g', got '5 mm'"),
        (-1, "payload: mass: expected zero or more, got -1 kg"),
        (True, "payload: expected a Body or a mass, got True"),
        (None, "payload: expected a Body or a mass, got None"),
    ):
        with pytest.raises(ParameterError) as told:
            PAPER.carrying(wrong)
        assert str(told.value) == words


def test_lengths_alone_and_solids():
    lengths = "geometry: {r: 100 mm, R: 250 mm, L: 400 mm, b: 50 mm}\n"
    assert dump(parse(f"{lengths}bodies: solids")) == dump(p3dof.SOLIDS)
    light = parse(
        f"{lengths}bodies: solids\ndensity: {{platform: 2.7 g/cm^3}}\ndimensions: {{rod_radius: 8 mm}}"
    )
    sizes = p3dof.machine.Dimensions(rod_radius=0.008)
    whole = replace(light, dimensions=asdict(sizes))
    assert dump(whole) == dump(p3dof.of_solids(dimensions=sizes, density={"platform": 2700}))
    assert light.dimensions == {"rod_radius": 0.008}
    assert light.bodies.platform.mass == pytest.approx(
        p3dof.SOLIDS.bodies.platform.mass * 2700 / 7801, rel=1e-15
    )
    assert light.bodies.leg_a.mass == pytest.approx(p3dof.SOLIDS.bodies.leg_a.mass * 0.64, rel=1e-15)
    for text, words in (
        (
            "",
            "m.yaml: the field 'bodies' is missing: give mass, com and inertia of each, or 'bodies: solids' "
            "for bodies of steel in proportion to the paper's",
        ),
        (
            "bodies: solids\ndensity: {legs: 2700}",
            "m.yaml: density: unknown kind 'legs', expected one of slider, leg, crossbar, platform",
        ),
        (
            "bodies: solids\ndensity: 2700 kg",
            "m.yaml: density: expected a density, a number in kg/m^3 or one with "
            "a unit such as '1 g/cm^3', got '2700 kg'",
        ),
        (
            "bodies: solids\ndimensions: {rod: 1}",
            "m.yaml: dimensions: unknown field 'rod', expected slider_edge, "
            "rod_radius, plate_thickness, corner_radius",
        ),
        ("bodies: solid", "m.yaml: bodies: expected 'solids', or mass, com and inertia of each, got 'solid'"),
        (
            "bodis: solids",
            "m.yaml: unknown field 'bodis', expected geometry, bodies, limits, gravity, friction, "
            "actuators, payload, density, dimensions; did you mean 'bodies'?",
        ),
    ):
        with pytest.raises(ParameterError) as told:
            parse(lengths + text, "m.yaml")
        assert str(told.value) == words
