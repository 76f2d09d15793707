"""`Catalogue`: motors, gears, screws and belts to choose from; and a few generic ones.

The form of a file::

    motors:
      - name: M400
        rated_torque: 1.3 Nm
        peak_torque: 3.8 Nm
        rated_speed: 3000 rpm
        max_speed: 5000 rpm
        inertia: 0.3 kg cm^2
        brake_torque: 1.4 Nm
        winding:                             # optional: what the voltage of the drive allows; in SI units
          {bus_voltage: 320, pole_pairs: 4, resistance: 1.0, inductance: 0.008, measured: between lines,
           torque_constant_rms: 0.594, max_current_rms: 8.5, field_weakening: true}
    screws:
      - {name: 16x10, lead: 10 mm, diameter: 12.7 mm, length: 500 mm, efficiency: 0.9}
    belts: []
    gears:                                   # optional; without it motors drive screws and belts directly
      - {name: direct, ratio: 1}
      - {name: i3, ratio: 3, efficiency: 0.96, inertia: 0.1 kg cm^2}

Every motor is tried with every gear and every screw or belt. Numbers are in SI units, or have one of their
own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any

from p3dof._base.checks import Readable, shown, warn_caller
from p3dof._base.errors import DriveError, ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof._base.quantities import INERTIA, LENGTH, MOMENT, POWER, ROTATION, TIME, Quantity
from p3dof.design.drives.motor import Motor, Winding
from p3dof.design.drives.transmission import Belt, Drive, Gear, Screw
from p3dof.machine.parameters.machine import read_fields

_MOST = 5000  # most drives of a catalogue: motors by gears by screws and belts
_UNITS: Mapping[str, Quantity] = {
    **dict.fromkeys(("rated_torque", "peak_torque", "max_torque", "brake_torque", "drag"), MOMENT),
    **dict.fromkeys(("max_power", "max_braking_power"), POWER),
    **dict.fromkeys(("max_speed", "rated_speed"), ROTATION),
    **dict.fromkeys(("inertia", "coupling_inertia"), INERTIA),
    "time_constant": TIME,
    **dict.fromkeys(("lead", "diameter", "nominal_diameter", "length"), LENGTH),
}
_KINDS: Mapping[str, type[Any]] = {"motors": Motor, "screws": Screw, "belts": Belt, "gears": Gear}
_CURVE = (ROTATION, MOMENT, MOMENT)


@dataclass(frozen=True, eq=False)
class Catalogue(Readable):
    """Motors, gears, screws and belts to choose from."""

    motors: Sequence[Motor]  # at least one
    transmissions: Sequence[Screw | Belt]  # at least one
    gears: Sequence[Gear] = (Gear(),)  # at least one; none but the direct one by default

    def __post_init__(self) -> None:
        kinds: tuple[tuple[str, type[Any] | tuple[type[Any], ...]], ...] = (
            ("motors", Motor),
            ("transmissions", (Screw, Belt)),
            ("gears", Gear),
        )
        for field, kind in kinds:
            parts = tuple(getattr(self, field))
            if not parts:
                raise DriveError(f"catalogue: expected at least one of the {field}, got none")
            for part in parts:
                if not isinstance(part, kind):
                    raise DriveError(f"catalogue: {field}: got {shown(part)}")
            names = [part.name for part in parts]
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise DriveError(f"catalogue: {field}: the name {twice[0]!r} is given twice")
            object.__setattr__(self, field, parts)
        if len(self) > _MOST:
            raise DriveError(f"catalogue: expected at most {_MOST} drives, got {len(self)}")

    def __len__(self) -> int:
        return len(self.motors) * len(self.transmissions) * len(self.gears)

    def __iter__(self) -> Iterator[Drive]:
        for motor in self.motors:
            for gear in self.gears:
                for transmission in self.transmissions:
                    yield Drive(motor, transmission, gear)


def read_catalogue(path: Source) -> Catalogue:
    """Read a catalogue of drives.

    Parameters
    ----------
    path : path-like or stream
        The YAML file.

    Raises
    ------
    DriveError
        If a field is missing, unknown, in a wrong unit or does not fit; the message names file and field.
    FileError
        If the file cannot be read.
    """
    source = called(path)
    data = parse_yaml(read_text(path), source, DriveError)
    try:
        data = read_fields(data, source, ("motors",), tuple(_KINDS))
        parts = {kind: _parts(data.get(kind, []), kind, f"{source}: {kind}") for kind in _KINDS}
    except ParameterError as error:
        raise DriveError(str(error)) from error
    try:
        gears = parts["gears"] or [Gear()]
        found = Catalogue(parts["motors"], [*parts["screws"], *parts["belts"]], gears)
    except DriveError as error:
        raise DriveError(f"{source}: {error}") from error
    _doubt(found, source)
    return found


def _doubt(catalogue: Catalogue, source: str) -> None:
    """Warn of numbers that seem to be in another unit: of the first part that has any."""
    for part in (*catalogue.motors, *catalogue.transmissions):
        told = [
            f"{name} = {value:g} {unit} ({other}?)"
            for name, (most, unit, other) in _MOST_OF.items()
            if (value := getattr(part, name, None)) is not None and most < value < math.inf
        ]
        if isinstance(part, Motor) and part.inertia > _SLUGGISH * part.peak_torque:
            told.append(f"inertia = {part.inertia:g} kg m^2 (kg cm^2?)")
        if told:
            return warn_caller(
                f"{source}: {part.name}: {'; '.join(told)}: a number without a unit is in SI units"
            )
    return None


_MOST_OF = {
    "max_speed": (2500.0, "rad/s", "rpm"), "lead": (1.0, "m", "mm"), "diameter": (1.0, "m", "mm"),
    "length": (50.0, "m", "mm"),
}  # fmt: skip
"""Numbers of motors, screws and belts that are believed, with their unit and the one that may be meant."""
_SLUGGISH = 0.02
"""Rotor inertia by peak torque that is believed [s²]: no motor needs a second to 50 rad/s."""


def _parts(data: Any, kind: str, where: str) -> list[Any]:
    if not isinstance(data, list):
        raise DriveError(f"{where}: expected a list, got {shown(data)}")
    return [_part(item, _KINDS[kind], f"{where}[{k}]") for k, item in enumerate(data)]


def _part(data: Any, kind: type[Any], where: str) -> Any:
    known = [field.name for field in fields(kind)]
    required = [field.name for field in fields(kind) if field.default is field.default_factory]
    data = read_fields(data, where, ("name", *required), known)
    values: dict[str, Any] = {}
    for key, value in data.items():
        place = f"{where}: {key}"
        if key == "curve":
            values[key] = _curve(value, place)
        elif key == "winding":
            values[key] = _winding(value, place)
        else:
            values[key] = _UNITS[key].read(value, place) if key in _UNITS else value
    try:
        return kind(**values)
    except DriveError as error:
        raise DriveError(f"{where}: {error}") from error


def _winding(data: Any, where: str) -> Winding:
    """Return a winding; its numbers are in SI units, without text."""
    known = [field.name for field in fields(Winding)]
    required = [field.name for field in fields(Winding) if field.default is MISSING]
    data = read_fields(data, where, required, known)
    try:
        return Winding(**data)
    except DriveError as error:
        raise DriveError(f"{where}: {error}") from error


def _curve(data: Any, where: str) -> list[list[float]]:
    if not isinstance(data, list) or len(data) > 1000:
        raise DriveError(f"{where}: expected a list of [speed, continuous torque, peak torque]")
    rows = []
    for k, row in enumerate(data):
        if not isinstance(row, list) or len(row) != 3:
            raise DriveError(f"{where}[{k}]: expected [speed, continuous torque, peak torque]")
        rows.append([unit.read(value, f"{where}[{k}]") for unit, value in zip(_CURVE, row, strict=True)])
    return rows


def _generic() -> Catalogue:
    """Return sizes that are typical of servo motors and rolled ball screws; no maker's."""
    rpm = math.pi / 30
    sizes = [
        ("50 W", 0.16, 4e-6),
        ("100 W", 0.32, 7e-6),
        ("200 W", 0.64, 2.5e-5),
        ("400 W", 1.27, 4.5e-5),
        ("750 W", 2.4, 1.2e-4),
        ("1.5 kW", 4.8, 6e-4),
        ("3 kW", 9.6, 1.5e-3),
    ]
    motors = [
        Motor(
            rated_torque=torque,
            peak_torque=3 * torque,
            rated_speed=3000 * rpm,
            max_speed=6000 * rpm if torque < 3 else 5000 * rpm,
            inertia=inertia,
            brake_torque=torque,
            name=f"generic {name}",
        )
        for name, torque, inertia in sizes
    ]
    screws = [
        Screw(lead=lead / 1e3, diameter=core / 1e3, length=0.5, efficiency=0.9, name=f"generic {size}x{lead}")
        for size, core, leads in ((12, 9.5, (5, 10)), (16, 12.7, (5, 10, 16)), (20, 16.7, (5, 10, 20)))
        for lead in leads
    ]
    return Catalogue(motors, screws)


GENERIC = _generic()
"""Generic sizes, with numbers of our own that are typical of their class: for a first look only."""
