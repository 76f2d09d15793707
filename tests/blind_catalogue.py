"""Random tasks and drives, and what a drive takes by direct simulation, without `p3dof.design.drives`.

The machine is Lagrange's, with friction at its sliders; between motor and slider is a spring, so that the
motor leads by the force over the stiffness. Torques are from the motor's own angle by differences, the
temperature of the winding from its differential equation by Runge and Kutta's method, to its steady state.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from drives_by_hand import MARGINS
from lagrange import LagrangeModel

import p3dof
from p3dof.design.drives import Drive, Motor, Screw
from p3dof.machine.parameters import Friction

RPM = math.pi / 30
STIFFNESS = 5e7  # of nut, screw and bearings [N/m]
COULOMB, VISCOUS, SMOOTHING = 6.0, 12.0, 1e-3  # of each slider [N], [N s/m], [m/s]
MACHINE = replace(p3dof.PAPER, friction=Friction({"sliders": VISCOUS}, {"sliders": COULOMB}, SMOOTHING))
LEAST = 0.01  # so near to a border, or to the next reason, a verdict may be either
ENDS = {
    "fixed-free": (3.51601527, 0.25),
    "supported-supported": (math.pi**2, 1.0),
    "fixed-fixed": (22.3732854, 4.0),
}


def drives(seed: int, count: int) -> list[Drive]:
    """Torques log-uniform, inertias by their power 1.3, leads of 4 to 25 mm, three ways to hold the screw."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        torque = math.exp(rng.uniform(math.log(0.1), math.log(6.0)))
        inertia = 3e-5 * (torque / 1.27) ** 1.3 * math.exp(rng.normal(0, 0.3))
        motor = Motor(
            torque, torque * rng.uniform(2, 3.5), rng.uniform(4500, 7000) * RPM, inertia, 3000 * RPM,
            brake_torque=torque * rng.uniform(0.8, 1.3), drag=0.01 * torque,
            time_constant=rng.uniform(200, 1500), max_inertia_ratio=rng.uniform(6, 40), name=f"motor {k}",
        )  # fmt: skip
        nominal = float(rng.choice([12, 16, 20, 25]))
        screw = Screw(
            rng.uniform(4, 25) / 1e3, rng.uniform(0.82, 0.95), diameter=0.8e-3 * nominal,
            nominal_diameter=nominal / 1e3, length=rng.uniform(0.4, 0.8), ends=str(rng.choice([*ENDS])),
            drag=0.01 * torque, dn=rng.uniform(5e4, 1.3e5), name=f"screw {k}",
        )  # fmt: skip
        found.append(Drive(motor, screw))
    return found


def task(seed: int) -> p3dof.design.Plan:
    """Three to six stops, something of .3 to 5 kg carried between two of them, in a random time."""
    rng = np.random.default_rng(1000 + seed)
    stops = int(rng.integers(3, 7))
    points = []
    for k in range(stops):
        pose = rng.uniform([-0.16, -0.08, -0.4], [0.16, 0.06, 0.4])
        part = p3dof.machine.Body(rng.uniform(0.3, 5), com=[0, 0, -0.03], inertia=[0, 0, 0])
        points.append(
            p3dof.Waypoint(
                pose,
                f"stop {k}",
                dwell=float(rng.uniform(0, 0.2)),
                pick_up=part if k == 0 else None,
                put_down=k == stops - 2,
            )
        )
    points.append(p3dof.Waypoint(points[0].pose, "back"))
    chosen = p3dof.Task(points, f"task {seed}", profile="septic")
    return chosen.plan(chosen.dwell + stops * rng.uniform(0.25, 0.7), 3001)


class Moved(NamedTuple):
    """A task at samples: forces at the sliders and how they move, what holds still, moved masses."""

    time: np.ndarray
    force: np.ndarray
    speed: np.ndarray
    change: np.ndarray
    rate: np.ndarray  # of the force and of that, within each piece
    bend: np.ndarray
    held: np.ndarray
    mass: np.ndarray


def moved(plan) -> Moved:
    parts = []
    for piece in plan.pieces:
        laden = MACHINE if piece.payload is None else MACHINE.carrying(piece.payload)
        model, m = LagrangeModel(laden), piece.motion
        speed = model.slider_velocities(m.pose, m.velocity)
        bare = model.forces(m.pose, m.velocity, m.acceleration)
        force = bare + COULOMB * np.tanh(speed / SMOOTHING) + VISCOUS * speed
        rate = np.gradient(
            bare, m.time, axis=0
        )  # the step of Coulomb friction bends no spring: it is guessed away
        still = model.forces(m.pose, 0 * m.pose, 0 * m.pose)
        inverse = np.linalg.inv(model.jacobian(m.pose))
        masses = np.diagonal(
            np.swapaxes(inverse, 1, 2) @ model.mass_matrix(m.pose) @ inverse, axis1=1, axis2=2
        )
        change = model.slider_accelerations(m.pose, m.velocity, m.acceleration)
        parts.append((m.time, force, speed, change, rate, np.gradient(rate, m.time, axis=0), still, masses))
    return Moved(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def curve(motor, speed, peak):
    """The usual curve, at the fastest speed where it is exceeded."""
    low, high = motor.rated_speed, motor.max_speed
    top = motor.peak_torque if peak else motor.rated_torque
    end = motor.rated_torque if peak else motor.rated_torque * low / high
    return np.interp(np.minimum(np.abs(speed), high), [0, low, high], [top, top, end])


def at_motor(found: Moved, drive: Drive) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and torques (N, 3) of the motors."""
    motor, screw = drive.motor, drive.transmission
    turn = 2 * math.pi / screw.lead
    own = motor.inertia + math.pi * 7850 * screw.diameter**4 * screw.length / 32
    turning = turn * (found.speed + found.rate / STIFFNESS)
    power = found.force * found.speed
    back = max(0.0, 2 - 1 / screw.efficiency)
    passed = found.force / turn * np.where(power > 0, 1 / screw.efficiency, np.where(power < 0, back, 1))
    drag = (screw.drag + motor.drag) * np.sign(found.speed)
    return turning, own * turn * (found.change + found.bend / STIFFNESS) + passed + drag


def shares(found: Moved, drives: list[Drive]) -> list[list[dict[str, float]]]:
    """How much of each rating the axes of each drive use, by direct simulation."""
    moving = [at_motor(found, drive) for drive in drives]
    loads = [
        (torque / curve(drive.motor, turning, False)) ** 2
        for drive, (turning, torque) in zip(drives, moving, strict=True)
    ]
    constants = np.repeat([drive.motor.time_constant for drive in drives], 3)
    heats = hottest(found.time, np.concatenate(loads, axis=1), constants).reshape(-1, 3)
    return [used(found, *each) for each in zip(drives, moving, heats, strict=True)]


def used(
    found: Moved, drive: Drive, moving: tuple[np.ndarray, np.ndarray], heat: np.ndarray
) -> list[dict[str, float]]:
    """How much of each rating each axis uses."""
    motor, screw, (turning, torque) = drive.motor, drive.transmission, moving
    turn, total = 2 * math.pi / screw.lead, found.time[-1] - found.time[0]
    rms, rms_speed = (np.sqrt(np.trapezoid(x**2, found.time, axis=0) / total) for x in (torque, turning))
    top = np.abs(turning).max(axis=0) / RPM
    within = np.abs(turning) <= motor.max_speed
    squared, factor = ENDS[screw.ends]
    whirl = squared / screw.length**2 * math.sqrt(2.1e11 / 7850) * screw.diameter / 4 / RPM
    euler = math.pi**2 * 2.1e11 * math.pi * screw.diameter**4 / 64 * factor / screw.length**2
    each = {
        "peak torque": (np.abs(torque) / curve(motor, turning, True) * within).max(axis=0),
        "rms torque": rms / curve(motor, rms_speed, False),
        "heating": heat,
        "speed": top / (motor.max_speed / RPM),
        "nut speed": top / 5000,
        "DN": 1e3 * screw.nominal_diameter * top / screw.dn,
        "critical speed": top / (0.8 * whirl),
        "buckling": np.abs(found.force).max(axis=0) / (0.5 * euler),
        "brake": 1.5 * np.abs(found.held).max(axis=0) / turn / motor.brake_torque,
        "inertia ratio": found.mass.max(axis=0) / turn**2 / motor.inertia / motor.max_inertia_ratio,
    }
    return [{name: float(values[k]) for name, values in each.items()} for k in range(3)]


def hottest(time: np.ndarray, load: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """The largest x (P,) of τ ẋ + x = load in steady state, by Runge and Kutta's method."""
    middle, steps = (load[1:] + load[:-1]) / 2, np.diff(time)[:, None] / constants

    def cycle(x):
        most = x
        for a, m, b, h in zip(load[:-1], middle, load[1:], steps, strict=True):
            k1 = a - x
            k2 = m - x - h / 2 * k1
            k3 = m - x - h / 2 * k2
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + b - x - h * k3)
            most = np.maximum(most, x)
        return x, most

    none, one = (cycle(np.full(load.shape[1], start))[0] for start in (0.0, 1.0))
    return cycle(none / (1 - (one - none)))[1]


class Judgement(NamedTuple):
    """What may be said of a drive."""

    verdict: int  # 0 fits, 1 without reserve, 2 does not fit
    reasons: set[tuple[str, str]]  # axis and rating of the worst, and of all that are as bad but for LEAST
    near: bool  # whether LEAST more or less would change the verdict


def judged(used: list[dict[str, float]]) -> Judgement:
    """The verdict on the shares of ratings of three axes."""

    def verdicts(scale: float) -> list[tuple[int, float, str, str]]:
        return sorted(
            (
                (share * scale > 1) + (share * scale > 1 - MARGINS.get(name, 0)), share, leg, name,
            )
            for leg, axis in zip("ABC", used, strict=True)
            for name, share in axis.items()
        )  # fmt: skip

    each = verdicts(1.0)
    verdict, worst, *_ = each[-1]
    alike = {
        (leg, name) for found, share, leg, name in each if found == verdict and share > worst * (1 - LEAST)
    }
    near = any(verdicts(scale)[-1][0] != verdict for scale in (1 - LEAST, 1 + LEAST))
    return Judgement(verdict, alike, near)
