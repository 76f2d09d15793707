"""`Geometry`, `Bodies`, `Limits` and `Parameters`: one machine of the paper's kind."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace

from p3dof.checks import FloatArray, FrozenArrays, frozen_array, positive
from p3dof.errors import ParameterError
from p3dof.parameters.body import Body
from p3dof.parameters.friction import Friction

PARALLEL = 1e-6
"""Least R - r, as a share of L: half the angle between the legs A and B at home [rad]."""


@dataclass(frozen=True)
class Geometry:
    """Lengths of the mechanism [m]; the defaults are the paper's.

    Parameters
    ----------
    r : float
        Size of the platform: distance from P to each of its joints A3, B3, C5.
    R : float
        Size of the base: distance from O to each guide-way.
    L : float
        Length of the legs and of the rods of the parallelogram.
    b : float
        Half width of the parallelogram. The paper does not give it, and no force depends on it.

    Raises
    ------
    ParameterError
        Unless 0 < r < R, L > R - r >= 1e-6 L and b > 0. Were R - r smaller, the legs A and B would be
        parallel at home, and could not hold the platform sideways.
    """

    r: float = 0.1
    R: float = 0.25
    L: float = 0.4
    b: float = 0.05

    def __post_init__(self) -> None:
        for item in fields(self):
            value = positive(item.name, getattr(self, item.name), ParameterError)
            object.__setattr__(self, item.name, value)
        if self.r >= self.R:
            raise ParameterError(
                f"r, R: expected r < R (r = R is singular everywhere), got r = {self.r:g}, R = {self.R:g} m"
            )
        if not self.R - self.r >= PARALLEL * self.L:
            raise ParameterError(
                f"R - r: expected at least {PARALLEL:g} L = {PARALLEL * self.L:g} m, or the legs A and B are "
                f"parallel and cannot hold the platform; got {self.R - self.r:g} m"
            )
        if not self.R - self.r < self.L:
            raise ParameterError(
                f"L: expected more than R - r = {self.R - self.r:g} m to reach the platform, got {self.L:g} m"
            )

    @property
    def h(self) -> float:
        """Depth of the platform below the sliders at home, h = √(L² - (R-r)²) [m] (paper, eq. 7)."""
        width = self.R - self.r
        return math.sqrt((self.L - width) * (self.L + width))


@dataclass(frozen=True, eq=False)
class Bodies:
    """The ten moving bodies, one `Body` for each link.

    Parameters
    ----------
    slider_a, leg_a, slider_b, leg_b, slider_c : Body
        Sliders (T1) and legs (T2) of the legs A and B, slider of leg C.
    crossbar_upper, rod_left, crossbar_lower, platform, rod_right : Body
        T2, T3, T4, T5 and T6 of leg C. Only the cross-bars may be massless.

    Raises
    ------
    ParameterError
        If a field is not a `Body`, or a body other than a cross-bar has no mass.
    """

    slider_a: Body
    leg_a: Body
    slider_b: Body
    leg_b: Body
    slider_c: Body
    crossbar_upper: Body
    rod_left: Body
    crossbar_lower: Body
    platform: Body
    rod_right: Body

    def __post_init__(self) -> None:
        for name, body in self.items():
            if not isinstance(body, Body):
                raise ParameterError(f"{name}: expected a Body, got {type(body).__name__}")
            if body.mass == 0 and not name.startswith("crossbar"):
                raise ParameterError(f"{name}: expected a positive mass, got 0 kg")

    @classmethod
    def alike(cls, *, slider: Body, leg: Body, crossbar: Body, platform: Body) -> Bodies:
        """Make the usual set: equal sliders, equal legs and rods, equal cross-bars.

        Parameters
        ----------
        slider, leg, crossbar, platform : Body
            One body of each kind.

        Returns
        -------
        Bodies
        """
        return cls(
            slider_a=slider,
            leg_a=leg,
            slider_b=slider,
            leg_b=leg,
            slider_c=slider,
            crossbar_upper=crossbar,
            rod_left=leg,
            crossbar_lower=crossbar,
            platform=platform,
            rod_right=leg,
        )

    def items(self) -> Iterator[tuple[str, Body]]:
        """Iterate over (link name, body)."""
        return ((item.name, getattr(self, item.name)) for item in fields(self))

    def scaled(self, factor: float) -> Bodies:
        """Return the bodies with all masses and inertias times a factor: a model that is wrong by so much.

        Parameters
        ----------
        factor : float
            Positive.

        Returns
        -------
        Bodies

        Raises
        ------
        ParameterError
            If the factor is not positive.
        """
        by = positive("factor", factor, ParameterError)
        return Bodies(
            **{name: Body(by * body.mass, body.com, by * body.inertia) for name, body in self.items()}
        )

    @property
    def mass(self) -> float:
        """Total moving mass [kg]."""
        return sum(body.mass for _, body in self.items())


LINKS = tuple(item.name for item in fields(Bodies))
"""The ten moving bodies by name."""


@dataclass(frozen=True)
class Limits:
    """What the actuators can do, and how far the platform may turn; the paper gives none of these.

    Parameters
    ----------
    travel : tuple of float
        Lowest and highest slider position [m]; home (0) lies between.
    speed : float
        Largest slider speed [m/s].
    force : float
        Largest actuator force [N].
    tilt : tuple of float
        Smallest and largest platform rotation θ [rad]; home (0) lies between.

    Raises
    ------
    ParameterError
        If a number is not finite, not positive where it must be, or a range does not hold home.
    """

    travel: tuple[float, float] = (-0.2, 0.2)
    speed: float = 2.0
    force: float = 500.0
    tilt: tuple[float, float] = (-math.pi / 4, math.pi / 4)

    def __post_init__(self) -> None:
        for name in ("travel", "tilt"):
            low, high = (float(end) for end in frozen_array(name, getattr(self, name), (2,), ParameterError))
            if not low < 0 < high:
                raise ParameterError(f"{name}: expected a range around 0 (home), got [{low:g}, {high:g}]")
            object.__setattr__(self, name, (low, high))
        for name in ("speed", "force"):
            object.__setattr__(self, name, positive(name, getattr(self, name), ParameterError))


@dataclass(frozen=True, eq=False)
class Parameters(FrozenArrays):
    """One machine: geometry, bodies, limits and gravity.

    Parameters
    ----------
    geometry : Geometry
        Lengths.
    bodies : Bodies
        Inertial parameters.
    limits : Limits
        Actuator limits.
    gravity : array-like, shape (3,)
        Acceleration of gravity in the fixed frame [m/s²].
    friction : Friction
        What the joints lose; nothing by default.

    Raises
    ------
    ParameterError
        If a field has the wrong type, or gravity is not three finite numbers.
    """

    geometry: Geometry
    bodies: Bodies
    limits: Limits = field(default_factory=Limits)
    gravity: FloatArray = (0.0, 0.0, -9.806)  # type: ignore[assignment]
    friction: Friction = field(default_factory=Friction)

    def __post_init__(self) -> None:
        kinds = {"geometry": Geometry, "bodies": Bodies, "limits": Limits, "friction": Friction}
        for name, kind in kinds.items():
            if not isinstance(getattr(self, name), kind):
                got = type(getattr(self, name)).__name__
                raise ParameterError(f"{name}: expected {kind.__name__}, got {got}")
        object.__setattr__(self, "gravity", frozen_array("gravity", self.gravity, (3,), ParameterError))

    def carrying(self, payload: Body) -> Parameters:
        """Return the machine with a payload fixed to its platform, besides what it carries already.

        Parameters
        ----------
        payload : Body
            In the platform's body frame: origin P, axes parallel to the fixed frame at θ = 0.

        Returns
        -------
        machine : Parameters

        Raises
        ------
        ParameterError
            If `payload` is not a `Body`.
        """
        if not isinstance(payload, Body):
            raise ParameterError(f"payload: expected a Body, got {type(payload).__name__}")
        platform = self.bodies.platform.joined(payload)
        return replace(self, bodies=replace(self.bodies, platform=platform))

    @property
    def payloads(self) -> tuple[Body, ...]:
        """What the platform carries, in its frame, one after the other as `carrying` joined them."""
        return self.bodies.platform.parts[1:]

    @property
    def unladen(self) -> Parameters:
        """The machine without its payloads."""
        if not self.payloads:
            return self
        return replace(self, bodies=replace(self.bodies, platform=self.bodies.platform.parts[0]))
