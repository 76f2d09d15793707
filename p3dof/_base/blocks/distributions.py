"""How the numbers of one column are spread: from numbers between 0 and 1, as all samplings give them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, positive
from p3dof._base.errors import InputError


class Distribution(ABC):
    """A distribution: a frozen dataclass of numbers."""

    @abstractmethod
    def at(self, share: FloatArray) -> FloatArray:
        """Return the numbers below which the given shares of all are; shape (n,)."""

    def settings(self) -> dict[str, Any]:
        """Return what it is, as plain data."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}  # type: ignore[arg-type]
        return {"kind": type(self).__name__, **values}


@dataclass(frozen=True)
class Uniform(Distribution):
    """Numbers evenly spread over a range.

    Parameters
    ----------
    low, high : float
        The range.

    Raises
    ------
    InputError
        Unless low < high.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _range(self)

    def at(self, share: FloatArray) -> FloatArray:
        """Return the numbers below which the given shares of all are."""
        return np.clip(self.low + (self.high - self.low) * share, self.low, self.high)


@dataclass(frozen=True)
class LogUniform(Distribution):
    """Positive numbers whose logarithms are evenly spread over a range.

    Parameters
    ----------
    low, high : float
        The range.

    Raises
    ------
    InputError
        Unless 0 < low < high.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _range(self)
        positive("low", self.low, InputError)

    def at(self, share: FloatArray) -> FloatArray:
        """Return the numbers below which the given shares of all are."""
        return np.clip(self.low * np.exp(math.log(self.high / self.low) * share), self.low, self.high)


@dataclass(frozen=True)
class Normal(Distribution):
    """Numbers spread about a mean as errors are.

    Parameters
    ----------
    mean : float
        The mean.
    deviation : float
        The standard deviation.

    Raises
    ------
    InputError
        If the mean is not finite, or the deviation not positive.
    """

    mean: float
    deviation: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", float(frozen_array("mean", self.mean, ())))
        object.__setattr__(self, "deviation", positive("deviation", self.deviation, InputError))

    def at(self, share: FloatArray) -> FloatArray:
        """Return the numbers below which the given shares of all are."""
        from scipy.special import ndtri

        inside = np.clip(share, 2.0**-54, 1 - 2.0**-53)  # both ends are infinitely far away
        found: FloatArray = self.mean + self.deviation * ndtri(inside)
        return found


def _range(distribution: Any) -> None:
    for name in ("low", "high"):
        value = float(frozen_array(name, getattr(distribution, name), ()))
        object.__setattr__(distribution, name, value)
    if not distribution.low < distribution.high:
        raise InputError(
            f"low, high: expected low < high, got {distribution.low:g} and {distribution.high:g}"
        )
