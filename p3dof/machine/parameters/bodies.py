"""`Bodies`: the ten moving bodies of the machine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

from p3dof._base.checks import positive
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.body import Body


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
