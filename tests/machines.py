"""Random valid machines and states of motion for the tests, from a seed that hypothesis draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import strategies as st
from lagrange import BODIES, cloud_body, random_cloud

from p3dof.closed_form import kinematics
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import (
    PAPER,
    PASSIVE,
    SLIDES,
    Actuators,
    Bodies,
    Body,
    Friction,
    Geometry,
    Parameters,
)
from p3dof.methods import engines
from p3dof.methods.virtual_power import VirtualPowerMethod

SEEDS = st.integers(0, 2**32 - 1)
FAR = {"drop": 0.1, "angle": 0.01}
"""Kept from the singularities: S/L of every leg, and the angle from det J = 0 [rad]."""


@dataclass(frozen=True)
class States:
    """Poses, velocities, accelerations and wrenches of a machine, shape (n, 3) and (n, 6)."""

    pose: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    wrench: np.ndarray


def random_geometry(rng):
    scale = 10 ** rng.uniform(-1, 1)
    R = scale * rng.uniform(0.2, 0.4)
    r = R * rng.uniform(0.1, 0.9)
    return Geometry(r=r, R=R, L=(R - r) * rng.uniform(1.2, 4) + 0.3 * r, b=R * rng.uniform(0.05, 0.5))


def random_machine(seed):
    """A machine without any symmetry, of any size; every third one has massless cross-bars."""
    rng = np.random.default_rng(seed)
    geometry = random_geometry(rng)
    bodies = {}
    for name in BODIES:
        masses, positions = random_cloud(rng)
        bodies[name] = cloud_body(masses, positions * geometry.L)
    if seed % 3 == 0:
        bodies["crossbar_upper"] = bodies["crossbar_lower"] = Body.massless()
    return Parameters(geometry, Bodies(**bodies), gravity=rng.normal(0, 6, 3))


def drops(geometry, pose):
    """S/L of the legs A, B, C, from the geometry alone."""
    y, theta = pose[..., 0], pose[..., 2]
    L, d = geometry.L, geometry.R - geometry.r
    squares = np.stack(
        [
            L**2 - (d + y) ** 2,
            L**2 - (d - y) ** 2,
            L**2 - y**2 - (geometry.R - geometry.r * np.cos(theta)) ** 2,
        ],
        axis=-1,
    )
    return np.sqrt(np.maximum(squares, 0)) / L


def random_actuators(rng, machine, springs=True):
    """Armature and balance at all sliders, about as heavy as the machine."""
    mass = machine.bodies.mass

    def by(low, high):
        return dict(zip(SLIDES, rng.uniform(low, high, 3) * mass, strict=True))

    return Actuators(by(0, 2), by(-10, 10), by(-20, 20) if springs else {}, by(0, 1))


def random_states(parameters, seed, count, drop=FAR["drop"], angle=FAR["angle"], near=None, side=None):
    """Random states that keep a distance from the singularities; with `near`, none farther than that.

    With `side`, all on home's side (1) of the actuation singularity, or all on the other (-1): a motion that
    goes from one to the other is refused.
    """
    rng = np.random.default_rng(seed)
    geometry = parameters.geometry
    reach = geometry.L - (geometry.R - geometry.r)
    found = []
    for _ in range(200):
        pose = rng.uniform(-1, 1, (4 * count, 3)) * [reach, geometry.L, np.pi]
        pose = pose[drops(geometry, pose).min(axis=-1) >= drop]
        signed = kinematics.singularity(geometry, pose).actuation
        margin = np.abs(signed)
        keep = margin >= angle
        if side is not None:
            keep &= np.sign(signed) == side
        if near is not None:
            keep &= (margin <= near["angle"]) | (drops(geometry, pose).min(axis=-1) <= near["drop"])
        found.extend(pose[keep])
        if len(found) >= count:
            break
    pose = np.array(found[:count]).reshape(-1, 3)
    n, size = len(pose), [geometry.L, geometry.L, 1]
    return States(
        pose, rng.normal(0, 2, (n, 3)) * size, rng.normal(0, 20, (n, 3)) * size, rng.normal(0, 10, (n, 6))
    )


def conditioning(geometry, pose):
    """By how much rounding of the pose is amplified near the singularities (paper-notes' rule)."""
    worst = 1 / drops(geometry, pose).min(axis=-1) ** 2
    return np.maximum(
        np.maximum(1, worst), 1 / np.abs(np.sin(kinematics.singularity(geometry, pose).actuation))
    )


def virtual_power_forces(parameters, *motion, wrench=None, on_invalid="raise"):
    """The forces at pose, velocity and acceleration by virtual powers; the wrench may be the fourth."""
    if len(motion) > 3:
        *motion, wrench = motion
    states = states_of(*motion, wrench=wrench, on_invalid=on_invalid)
    return VirtualPowerMethod(parameters).forces(states)


def derivative(function, t, step):
    """Central difference of order 4 of function(t): array."""
    return (
        8 * (function(t + step) - function(t - step)) - (function(t + 2 * step) - function(t - 2 * step))
    ) / (12 * step)


def random_friction(rng, share=0.7):
    def some():
        return {name: float(rng.uniform(0.1, 3)) for name in (*SLIDES, *PASSIVE) if rng.random() < share}

    return Friction(some(), some(), smoothing=float(rng.uniform(0.01, 0.5)))


def positions(geometry, pose):
    """Sliders of A, B, C and the joints at the platform, (3,) and (3, 3), for complex numbers too."""
    r, R, L = geometry.r, geometry.R, geometry.L
    y, z, theta = pose
    p = z - np.sqrt(L**2 - (R - r) ** 2)
    x_c, z_c = r * np.cos(theta), p + r * np.sin(theta)
    sliders = (
        p + np.sqrt(L**2 - (R - r + y) ** 2),
        p + np.sqrt(L**2 - (R - r - y) ** 2),
        z_c + np.sqrt(L**2 - y**2 - (R - x_c) ** 2),
    )
    return np.array(sliders), np.array([[0 * y, y - r, p], [0 * y, y + r, p], [x_c, y, z_c]])


LIBRARIES = {"mujoco": "mujoco", "drake": "pydrake", "exudyn": "exudyn"}


def engine(name, parameters=PAPER):
    pytest.importorskip(LIBRARIES[name], reason=f"{name} not installed: pip install 'p3dof[engines]'")
    return engines.load(name, parameters)


def off(found, expected):
    """The largest difference, by the largest force."""
    return np.abs(found - expected).max() / np.abs(expected).max()
