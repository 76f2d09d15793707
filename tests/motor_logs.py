"""Logs of motors as a machine would write them: noise, counts of encoders, a delay, damage of all kinds."""

from __future__ import annotations

import numpy as np

from p3dof.loops.identification.logs import MotorLog


def fourier_motion(home, sizes, period, harmonics, seed):
    """A random periodic motion about home: a function of time, which returns values and two derivatives."""
    rng = np.random.default_rng(seed)
    k = np.arange(1, harmonics + 1)
    omega = 2 * np.pi / period * k
    a, b = (rng.normal(size=(harmonics, len(home))) / k[:, None] for _ in range(2))
    amplitude = np.abs(np.cos(np.outer(np.linspace(0, period, 400), omega)) @ a
                       + np.sin(np.outer(np.linspace(0, period, 400), omega)) @ b).max(axis=0)  # fmt: skip
    a, b = a * sizes / amplitude, b * sizes / amplitude

    def at(time):
        c, s = np.cos(np.outer(time, omega)), np.sin(np.outer(time, omega))
        w = omega[:, None]
        return home + c @ a + s @ b, c @ (w * b) - s @ (w * a), -(c @ (w**2 * a)) - s @ (w**2 * b)

    return at


def motor_log(forces, truth, motion, duration, *, rate=1000.0, noise=0.0, counts=0.0, delay=0.0, seed=0):
    """A log of a motion in the coordinates of `forces`: parameters `truth`, forces late by `delay`.

    Counts are the encoders' steps; forces at a time are those of the motion at this time less the delay.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(round(duration * rate)) / rate
    here = forces.from_coordinates(*motion(time)).positions
    then = forces.rows(forces.from_coordinates(*motion(time - delay)))
    measured = then.columns @ truth + then.known
    measured = measured + noise * rng.normal(size=measured.shape)
    if counts:
        here = np.round(here / counts) * counts
    return MotorLog(forces.actuators, time, here, measured)


def truth_of(forces, seed, size=0.8):
    """Parameters of a robot as built: drawn from the prior, friction positive."""
    rng = np.random.default_rng(seed)
    drawn = forces.design + size * forces.deviations() * rng.normal(size=len(forces.design))
    positive = [name.rpartition(".")[2] in ("damping", "friction", "armature") for name in forces.names]
    return np.where(positive, np.abs(drawn), drawn)
