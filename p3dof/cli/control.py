"""How a controller acts, and what stands between it and what it moves: options of all that simulates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import click

from p3dof._base.quantities import Quantity
from p3dof.cli.kinds import FROM_ZERO, HERTZ, POSITIVE, SECONDS, Amount, Whole, options
from p3dof.runs import Noise
from p3dof.runs.settings import TIME_LIMIT, ControlLoop

RATE = click.option("--rate", type=HERTZ, default=1000.0, help="Sampling rate of the controller [Hz].")
FREQUENCY = click.option(
    "--frequency", type=HERTZ, default=5.0, help="Natural frequency of the closed loop [Hz]."
)
DAMPING = click.option("--damping", type=POSITIVE, default=1.0, help="Damping ratio of the closed loop.")


def actuation(positions: tuple[Quantity, ...], velocities: tuple[Quantity, ...]) -> Callable[..., Any]:
    """Return the options of what is measured, of such kinds, and of drives."""
    unit, per = (" or ".join(kind.unit for kind in kinds) for kinds in (positions, velocities))
    return options(
        click.option(
            "--noise",
            type=(Amount(*positions, zero=True), Amount(*velocities, zero=True)),
            metavar="AMOUNT AMOUNT",
            help=f"Standard deviations of measured positions [{unit}] and velocities [{per}] of the actuated "
            "joints.",
        ),
        click.option("--seed", type=Whole(min=0), default=0, help="Seed of the random numbers."),
        click.option(
            "--resolution",
            type=Amount(*positions, zero=True),
            default=0.0,
            help=f"Resolution of the encoders: positions are rounded to it [{unit}].",
        ),
        click.option(
            "--differencing", is_flag=True, help="Measure velocities as position differences over a period."
        ),
        click.option(
            "--delay",
            type=FROM_ZERO,
            default=0.0,
            help="Delay from a measurement to the forces that follow from it [s]; may exceed a period.",
        ),
        click.option(
            "--bandwidth",
            type=HERTZ,
            help="Bandwidth of the drives, a first-order lag [Hz]; by default unlimited.",
        ),
    )


def time_limit(what: str) -> Callable[..., Any]:
    """Return the option for the longest time that something may take."""
    return click.option(
        "--time-limit",
        type=SECONDS,
        default=TIME_LIMIT,
        help=f"Limit of the computing time of {what} [s], estimated before the start.",
    )


@dataclass(frozen=True)
class Feedback:
    """What the options say."""

    rate: float  # of the controller [Hz]
    frequency: float  # of its feedback [Hz]
    damping: float  # of its feedback, a ratio
    saturation: Any  # largest force of an actuator [N or N m], True for those of a file; None for no limit
    noise: tuple[float, float] | None  # standard deviations
    seed: int  # of the noise
    resolution: float  # of the encoders [m or rad]
    differencing: bool  # whether velocities are differences of positions
    delay: float  # of the forces [s]
    bandwidth: float | None  # of the drives [Hz]

    @property
    def measuring(self) -> tuple[str, ...]:
        """The options that were given and mean nothing without a controller."""
        given = {
            "--noise": self.noise is not None,
            "--resolution": self.resolution > 0,
            "--differencing": self.differencing,
            "--delay": self.delay > 0,
        }
        return tuple(name for name, is_given in given.items() if is_given)

    def loop(self, controlled: bool = True) -> ControlLoop:
        """Return how a controller acts, or forces that nothing controls."""
        return ControlLoop(
            self.rate if controlled else None,
            False if self.saturation is None else self.saturation,
            None if self.noise is None else Noise(*self.noise, self.seed),
            resolution=self.resolution,
            differencing=self.differencing,
            delay=self.delay,
            bandwidth=math.inf if self.bandwidth is None else self.bandwidth,
        )
