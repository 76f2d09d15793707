"""The field `run` of a sweep's file: runs in time under a controller, as `p3dof runs` makes them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from p3dof._base.blocks import Sampling
from p3dof._base.checks import positive, shown
from p3dof._base.errors import InputError
from p3dof.analysis.designs.fields import listed, mapping, motion_of, named, number, wrench_of
from p3dof.design.sweeps.runs import RunSweep
from p3dof.machine.motion import Motion, WrenchHistory
from p3dof.machine.motion.entering import load_along, natural_ramp
from p3dof.machine.parameters import PAPER, Parameters
from p3dof.machine.parameters.quantities import FORCE, LENGTH, SPEED, TIME, Quantity
from p3dof.runs import KINDS, ControlLoop, InitialState, Integration, Noise
from p3dof.runs.controllers_by_name import CONTROLLERS

SAMPLES = 1001
"""Of the paper's motion, where nobody says what is followed."""

STEP = 1e-3
"""Longest step of RK4, where nobody says so [s]."""

_NO_LIMIT = 1e9
"""How long a block may take [s]: a sweep can be interrupted."""

_NUMBERS: dict[str, Quantity | None] = {
    "rate": None,
    "frequency": None,
    "damping": None,
    "integral_time": TIME,
    "saturation": FORCE,
    "resolution": LENGTH,
    "delay": TIME,
    "bandwidth": None,
    "ramp": TIME,
    "duration": TIME,
    "step": TIME,
}
RUN_FIELDS = ("controller", *_NUMBERS, "noise", "differencing", "stop_at")
"""Fields of `run`."""


def run_sweep(
    data: Mapping[str, Any], sampling: Sampling, machine: Parameters | None, folder: Path, name: str
) -> RunSweep:
    """Return the runs that a file describes.

    Parameters
    ----------
    data : mapping
        The fields of the file, `run` among them.
    sampling : Sampling
        What differs between runs.
    machine : Parameters, optional
        What all share; the model of the controller.
    folder : Path
        Where files are that it names.
    name : str
        What to call the file.

    Returns
    -------
    RunSweep

    Raises
    ------
    InputError
        If a field does not fit.
    """
    where = f"{name}: run"
    fields = mapping(data["run"], where, RUN_FIELDS)
    given = {
        key: number(fields[key], quantity, f"{where}.{key}")
        for key, quantity in _NUMBERS.items()
        if key in fields
    }
    followed = motion_of(data.get("motion", {"paper": SAMPLES}), folder, f"{name}: motion")
    ramp = given.get("ramp", natural_ramp(followed))
    motion = named(where, lambda: followed.from_rest(ramp)) if ramp else followed
    load = wrench_of(data.get("wrench"), folder, f"{name}: wrench")
    model = PAPER if machine is None else machine
    return RunSweep(
        sampling,
        named(where, lambda: positive("duration", given.get("duration", motion.duration), InputError)),
        machine,
        start=InitialState(motion.pose[0], motion.velocity[0]),
        controller=named(where, lambda: _controller(fields, given, model, motion)),
        control=named(where, lambda: _control(fields, given, where)),
        wrench=load_along(load, followed, ramp) if isinstance(load, WrenchHistory) else load,
        stop_at=_stop_at(fields, where),
        integration=named(
            where, lambda: Integration(scheme="rk4", step=given.get("step", STEP), time_limit=_NO_LIMIT)
        ),
    )


def _stop_at(fields: Mapping[str, Any], where: str) -> list[Any]:
    found = listed(fields.get("stop_at", list(KINDS)), f"{where}.stop_at")
    for kind in found:
        if kind not in KINDS:
            raise InputError(f"{where}.stop_at: expected some of {', '.join(KINDS)}, got {shown(kind)}")
    return found


def _controller(
    fields: Mapping[str, Any], given: Mapping[str, float], machine: Parameters, motion: Motion
) -> Any:
    kind = fields.get("controller", "pd")
    if not isinstance(kind, str) or kind not in CONTROLLERS:
        raise InputError(f"controller: expected {', '.join(CONTROLLERS)}, got {shown(kind)}")
    return CONTROLLERS[kind](
        machine,
        motion,
        given.get("frequency", 5.0),
        given.get("damping", 1.0),
        integral_time=given.get("integral_time", math.inf),
    )


def _control(fields: Mapping[str, Any], given: Mapping[str, float], where: str) -> ControlLoop:
    noise = None
    if "noise" in fields:
        told = mapping(fields["noise"], f"{where}.noise", ("position", "velocity", "seed"))
        noise = Noise(
            number(told.get("position", 0.0), LENGTH, f"{where}.noise.position"),
            number(told.get("velocity", 0.0), SPEED, f"{where}.noise.velocity"),
            told.get("seed", 0),
        )
    return ControlLoop(
        given.get("rate", 1000.0),
        given.get("saturation", False),
        noise,
        resolution=given.get("resolution", 0.0),
        differencing=fields.get("differencing", False),
        delay=given.get("delay", 0.0),
        bandwidth=given.get("bandwidth", math.inf),
    )
