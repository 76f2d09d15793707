"""Random runs of random machines, in C and by the integrator in Python: one against the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from machines import random_machine, random_states

import p3dof
from p3dof import Motion, WrenchHistory
from p3dof._base.errors import P3dofError
from p3dof.closed_form.kinematics import singularity
from p3dof.machine.parameters import Friction, Limits
from p3dof.machine.parameters.body import PASSIVE, SLIDES
from p3dof.runs import (
    KINDS,
    PD,
    ComputedTorque,
    ControlLoop,
    Feedforward,
    InitialState,
    Integration,
    Noise,
    Springs,
)
from p3dof.runs.machine import RunOfMachine


class Follower:
    """A PD controller written in Python, which remembers nothing."""

    def __init__(self, stiffness, damping, rest):
        self.stiffness, self.damping, self.rest = stiffness, damping, rest

    def __call__(self, measured):
        error = self.rest + 0.02 * np.sin(9 * measured.time) - measured.sliders
        return self.stiffness * error - self.damping * measured.slider_velocities


def around(pose, rng):
    """Return a motion that begins at a pose and is shorter than a run; frequency, damping, integral time."""
    time = np.linspace(0, 0.3, 16)
    by = 0.02 * rng.normal(size=3)[:, None]
    phase = 10 * time
    parts = by * (1 - np.cos(phase)), by * 10 * np.sin(phase), by * 100 * np.cos(phase)
    motion = Motion(time, pose + parts[0].T, parts[1].T, parts[2].T, check=False)
    return motion, rng.uniform(2, 10), rng.uniform(0.5, 1.5), rng.choice([np.inf, 0.2])


def random_run(seed):
    """Return a machine, and the arguments of a run of it, from a seed."""
    rng = np.random.default_rng([seed, 14])
    parameters = random_machine(seed)
    states = random_states(parameters, seed, 1)
    pose, g = states.pose[0], parameters.geometry
    if rng.random() < 0.5:
        names = rng.choice([*SLIDES, *PASSIVE], 4, replace=False)
        viscous, coulomb = (dict(zip(names[k : k + 3], rng.uniform(0, 3, 3), strict=False)) for k in (0, 1))
        parameters = replace(parameters, friction=Friction(viscous, coulomb, smoothing=0.05))
    sliders = p3dof.Manipulator(parameters).inverse_kinematics(pose).sliders
    room = g.L * rng.uniform(0.02, 0.5)
    travel = min(sliders.min(), 0) - room, max(sliders.max(), 0) + g.L * rng.uniform(0.02, 0.5)
    tilt = min(pose[2], 0) - rng.uniform(0.05, 1), max(pose[2], 0) + rng.uniform(0.05, 1)
    parameters = replace(parameters, limits=Limits(travel=travel, tilt=tilt, force=rng.uniform(5, 200)))
    mass = parameters.bodies.mass
    rate = rng.choice([None, 50.0, 200.0, 1000.0])
    stiffness, damping = mass * rng.uniform(1, 300), mass * rng.uniform(0, 5)
    drive = rng.integers(8)
    controller = [
        None,
        rng.normal(0, 3 * mass, 3),
        Springs(stiffness, sliders, damping * rng.integers(2), rng.normal(0, 3 * mass, 3)),
        Springs(stiffness * np.array([1, 2, 3]), sliders, damping),
        Follower(stiffness, damping, sliders),
        *(kind(parameters, *around(pose, rng)) for kind in (PD, Feedforward, ComputedTorque)),
    ][drive]
    if drive == 4 or (drive > 4 and (controller.integral_time < np.inf or rng.random() < 0.5)):
        rate = rate or 100.0  # what is continuous has neither Python nor an integral
    if drive == 7 and singularity(g, pose).actuation < 0.3:
        rate = rate or 100.0  # it would take itself for another pose, and ask for endless forces all the time
    noise = Noise(1e-6, 1e-4, seed) if rate and rng.random() < 0.3 else None
    encoders = {"resolution": 1e-5, "differencing": True} if rate and rng.random() < 0.3 else {}
    if rate and rng.random() < 0.3:
        encoders["delay"] = [rng.integers(1, 5), rng.uniform(0, 5), rng.integers(5, 100)][
            rng.integers(3)
        ] / rate
    if rate and rng.random() < 0.3:
        encoders["bandwidth"] = rng.uniform(5, 100, 3)
    time = np.sort(rng.uniform(0, 0.4, 4))
    wrench = [None, rng.normal(0, mass, 6), WrenchHistory(time, rng.normal(0, mass, (4, 6)))][rng.integers(3)]
    counted = [kind for kind in KINDS if rng.random() < 0.8]
    saturation = [False, True, 30.0][rng.integers(3)]
    run = {
        "start": InitialState(pose, states.velocity[0] * rng.uniform(0, 0.5)),
        "controller": controller,
        "control": ControlLoop(rate, saturation=saturation, noise=noise, **encoders),
        "wrench": wrench,
        "stop_at": counted,
        "samples": int(rng.integers(2, 40)),
        "integration": Integration(rtol=1e-12, atol=1e-14, max_step=rng.choice([None, 0.003])),
    }
    return p3dof.Manipulator(parameters), 0.4, run


def in_python(machine, duration, **run):
    """Run by the integrator in Python."""
    return RunOfMachine(machine, duration, method="compiled", **run).in_python()


def both(seed):
    """Return a random run in C and in Python, or the message of what both refuse."""
    machine, duration, run = random_run(seed)
    return result(machine.simulate, duration, method="compiled", **run), result(
        in_python, machine, duration, **run
    )


def result(way, *arguments, **run):
    try:
        return way(*arguments, **run)
    except P3dofError as error:
        return str(error)


def difference(one, other):
    """Return what is wrong with two runs that should be equal, in words; nothing if they are.

    Not evaluations: at tolerances near rounding steps follow from rounding, which differs by processor.
    """
    if isinstance(one, str) or isinstance(other, str):
        return "" if one == other else f"{one} against {other}"
    return _other_end(one, other) or _other_samples(one, other)


def _other_end(one, other):
    stops = [None if run.stop is None else (run.stop.kind, run.stop.reason) for run in (one, other)]
    if stops[0] != stops[1]:
        return f"stopped by {stops[0]} against {stops[1]}"
    if one.stop is not None and abs(one.stop.time - other.stop.time) > 1e-9:
        return f"stopped at {one.stop.time!r} against {other.stop.time!r}"
    return ""


def _other_samples(one, other):
    if len(one) != len(other):
        return f"{len(one)} against {len(other)} samples"
    for name in ("time", "pose", "velocity", "forces", "asked", "sliders", "slider_velocities", "wrench"):
        a, b = getattr(one, name), getattr(other, name)
        error = float(np.abs(a - b).max() / max(1.0, np.abs(b).max()))
        if not error <= 1e-7:
            return f"{name} differs by {error:.2g} of it"
    return ""
