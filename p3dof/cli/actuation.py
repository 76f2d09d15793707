"""What stands between a controller and the machine, as options of the commands that simulate."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import click

from p3dof.cli.kinds import POSITIVE, Number, Whole
from p3dof.runs import ControlLoop, Noise

_OPTIONS = (
    click.option(
        "--noise",
        type=Number(min=0),
        nargs=2,
        help="Standard deviations of measured positions [m or rad] and velocities of the actuated joints.",
    ),
    click.option("--seed", type=Whole(min=0), default=0, show_default=True, help="Of the noise."),
    click.option(
        "--resolution",
        type=Number(min=0),
        default=0.0,
        help="Of the encoders: positions are rounded to counts of this size [m or rad].",
    ),
    click.option(
        "--differencing", is_flag=True, help="Measure velocities as differences of positions over a period."
    ),
    click.option(
        "--delay",
        type=Number(min=0),
        default=0.0,
        help="How long after a measurement its forces begin to act [s]; a period or more if you like.",
    ),
    click.option(
        "--bandwidth", type=POSITIVE, help="Of the drives, a first-order lag [Hz]; none without it."
    ),
)


class ActuationOptions(NamedTuple):
    """What the options say.

    Parameters
    ----------
    noise : (float, float), optional
        Standard deviations.
    seed : int
        Of the noise.
    resolution : float
        Of the encoders [m or rad].
    differencing : bool
        Whether velocities are differences of positions.
    delay : float
        Of the forces [s].
    bandwidth : float, optional
        Of the drives [Hz].
    """

    noise: tuple[float, float] | None
    seed: int
    resolution: float
    differencing: bool
    delay: float
    bandwidth: float | None

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

    def loop(self, rate: float | None, saturation: bool | float) -> ControlLoop:
        """Return how a controller acts."""
        return ControlLoop(
            rate,
            saturation,
            None if self.noise is None else Noise(*self.noise, self.seed),
            resolution=self.resolution,
            differencing=self.differencing,
            delay=self.delay,
            bandwidth=math.inf if self.bandwidth is None else self.bandwidth,
        )


def with_actuation(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of `ActuationOptions`, and these as `actuation`."""

    @functools.wraps(command)
    def run(*positional: Any, **given: Any) -> Any:
        own = {name: given.pop(name) for name in ActuationOptions._fields}
        return command(*positional, actuation=ActuationOptions(**own), **given)

    for option in reversed(_OPTIONS):
        run = option(run)
    return run
