"""`p3dof init`: a machine, a motion, a task and drives to start from."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import click

from p3dof._base.errors import InputError
from p3dof._base.files import check_writable, together, write_atomic
from p3dof.cli.app import app
from p3dof.cli.files import OutputFolder
from p3dof.design.drives import GENERIC
from p3dof.machine.motion import paper_motion
from p3dof.machine.parameters import SOLIDS, Body, Parameters

NEXT = {
    "compare --parameters machine.yaml --motion motion.csv": "actuator forces of the motion, by both methods",
    "plan task.yaml --parameters machine.yaml": "motion of the task, and utilisation of the limits",
    "size task.yaml --parameters machine.yaml --drives drives.yaml": "motors and screws that fit the task",
}
"""Commands to go on with, and what each computes."""

_MM, _DEG, _RPM = 1e-3, math.pi / 180, math.pi / 30
_MOTOR = {
    "rated_torque": (1, " Nm"),
    "peak_torque": (1, " Nm"),
    "rated_speed": (_RPM, " rpm"),
    "max_speed": (_RPM, " rpm"),
    "inertia": (1e-4, " kg cm^2"),
    "brake_torque": (1, " Nm"),
}
_SCREW = {"lead": (_MM, " mm"), "diameter": (_MM, " mm"), "length": (_MM, " mm"), "efficiency": (1, "")}
"""What a line of a catalogue has: numbers in units that makers print."""


@app.command()
@click.argument("folder", type=OutputFolder(), default=".", metavar="[FOLDER]")
@click.option("--force", is_flag=True, help="Overwrite existing files.")
def init(folder: Path, force: bool) -> int:
    """Write a commented machine.yaml, motion.csv, task.yaml and drives.yaml to start from.

    They are written to FOLDER, by default the current one: all of them, or none if one exists already.
    """
    texts = {folder / name: text for name, text in starting_files().items()}
    for path in texts:
        if path.exists() and not force:
            raise InputError(f"{path} exists already: nothing was written; --force overwrites it")
        check_writable(path)
    with together():
        written = [write_atomic(path, text) for path, text in texts.items()]
    click.echo("\n".join(f"wrote {path}" for path in written))
    click.echo(
        f"They work as they are. Try, in {folder}:" if folder != Path() else "They work as they are. Try:"
    )
    click.echo("\n".join(f"  p3dof {command}\n      {meaning}" for command, meaning in NEXT.items()))
    return 0


def starting_files() -> dict[str, str]:
    """Return the texts by name: numbers of the package, in the units that people write."""
    fills = {
        "machine.yaml": _numbers(SOLIDS),
        "task.yaml": {},
        "drives.yaml": {
            "motors": _lines(GENERIC.motors, _MOTOR),
            "screws": _lines(GENERIC.transmissions, _SCREW),
        },
    }
    folder = files("p3dof.cli") / "templates"
    texts = {
        name: Template((folder / f"{name}.in").read_text(encoding="utf-8")).substitute(fill)
        for name, fill in fills.items()
    }
    motion = paper_motion(41)
    rows = zip(motion.time, *(motion.pose / (_MM, _MM, _DEG)).T, strict=True)
    lines = [
        "# Poses over time, here of the paper's motion; the platform moves on the smooth curve through them."
    ]
    lines += ["t [s],y [mm],z [mm],theta [deg]", *(",".join(map(_plain, row)) for row in rows)]
    aligned = re.sub(
        r"(?m)^( *\w.*?) +# (.*)$", lambda found: f"{found[1]:31} # {found[2]}", texts["machine.yaml"]
    )
    return texts | {"machine.yaml": aligned, "motion.csv": "\n".join([*lines, ""])}


def _numbers(machine: Parameters) -> dict[str, str]:
    """Return the numbers of a machine as its file has them, by their names in the template."""
    limits, bodies = machine.limits, machine.bodies
    found = {name: f"{_plain(value / _MM)} mm" for name, value in vars(machine.geometry).items()}
    found |= {"travel": _row(limits.travel, _MM, " mm"), "tilt": _row(limits.tilt, _DEG, " deg")}
    found |= {"speed": f"{limits.speed:g} m/s", "force": f"{limits.force:g} N"}
    found["gravity"] = _row(machine.gravity, 1, "")
    kinds: dict[str, Body] = {
        "slider": bodies.slider_a,
        "leg": bodies.leg_a,
        "crossbar": bodies.crossbar_upper,
    }
    for kind, body in (kinds | {"platform": bodies.platform}).items():
        found[f"{kind}_mass"] = f"{_plain(body.mass * 1e3)} g"
        found[f"{kind}_com"] = _row(body.com, _MM, " mm")
        found[f"{kind}_inertia"] = _row(body.inertia.diagonal(), 1e-6, " kg mm^2")
    return found


def _lines(parts: Iterable[Any], units: Mapping[str, tuple[float, str]]) -> str:
    """Return a line of YAML for each part of a catalogue."""
    rows = [
        [f"{name}: {_plain(getattr(part, name) / scale)}{unit}" for name, (scale, unit) in units.items()]
        for part in parts
    ]
    return "\n".join(
        f"  - {{name: {part.name}, {', '.join(row)}}}" for part, row in zip(parts, rows, strict=True)
    )


def _row(values: Iterable[float], scale: float, unit: str) -> str:
    return f"[{', '.join(f'{_plain(value / scale)}{unit}' for value in values)}]"


def _plain(number: float) -> str:
    """Return a number with six digits, never minus zero."""
    return f"{number + 0.0:.6g}"
