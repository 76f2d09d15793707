"""What a sizing of drives says nothing about: ratings without a number, and what is not computed."""

from __future__ import annotations

import math

from p3dof.design.drives.drive import Drive
from p3dof.design.drives.sizing import BUCKLING, WHIRL, Sizing
from p3dof.design.drives.transmission import Gear, Screw


def not_checked(sizing: Sizing) -> tuple[str, ...]:
    """Return what was not checked of drives, in words.

    Parameters
    ----------
    sizing : Sizing
        Of a drive on each axis.

    Returns
    -------
    tuple of str
        First what the catalogue could have numbers for, by the field that has none.
    """
    found: dict[str, None] = {}
    for drive in dict.fromkeys(sizing.drives):
        found |= dict.fromkeys((*_of_motor(drive), *_of_gear(drive), *_of_transmission(drive)))
    shares = f", but for {WHIRL:.0%} of the critical speed and {BUCKLING:.0%} of Euler's load"
    screws = any(drive.transmission.critical_speed < math.inf for drive in sizing.drives)
    return (
        *found,
        f"reserves (ratings count in full{shares if screws else ''})",
        "temperature and altitude",
    )


def _of_motor(drive: Drive) -> list[str]:
    motor, name = drive.motor, drive.motor.name
    known = {
        f"heat of {name} within the cycle (no time_constant)": motor.time_constant is not None,
        f"inertia of the load by that of {name} (no max_inertia_ratio)": motor.max_inertia_ratio < math.inf,
        f"power of the amplifier of {name} (no max_power)": motor.max_power < math.inf,
        f"what amplifier and resistor of {name} take back (no max_braking_power)": motor.max_braking_power
        < math.inf,
        f"holding when the power fails ({name} has no brake_torque)": motor.brake_torque > 0,
    }
    return [words for words, checked in known.items() if not checked]


def _of_gear(drive: Drive) -> list[str]:
    gear = drive.gear
    unnamed = gear.name == Gear().name
    if gear.ratio == 1 and unnamed:
        return []
    name = "the gear" if unnamed else gear.name
    known = {
        f"speed of {name} (no max_speed)": gear.max_speed < math.inf,
        f"torque of {name} (no max_torque)": gear.max_torque < math.inf,
        f"life of {name}": False,
    }
    return [words for words, checked in known.items() if not checked]


def _of_transmission(drive: Drive) -> list[str]:
    part = drive.transmission
    if not isinstance(part, Screw):
        speed = [] if part.max_speed < math.inf else [f"speed of {part.name} (no max_speed)"]
        return [*speed, f"strength and life of {part.name}"]
    known = {
        f"speed of the nut of {part.name}, DN (no max_speed)": part.max_speed < math.inf,
        f"critical speed and buckling of {part.name} (no diameter and length)": part.critical_speed
        < math.inf,
        f"life and static load of the nut of {part.name}": False,
    }
    return [words for words, checked in known.items() if not checked]
