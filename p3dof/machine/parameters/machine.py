"""`Parameters`: one machine of the paper's kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from p3dof._base.checks import FloatArray, FrozenArrays, frozen_array
from p3dof._base.errors import ParameterError
from p3dof._base.tables import ShownInNotebook
from p3dof.machine.parameters.actuators import Actuators
from p3dof.machine.parameters.bodies import Bodies
from p3dof.machine.parameters.body import Body
from p3dof.machine.parameters.friction import Friction
from p3dof.machine.parameters.geometry import Geometry
from p3dof.machine.parameters.limits import Limits
from p3dof.machine.parameters.plain import named, read_parts


@dataclass(frozen=True, eq=False)
class Parameters(FrozenArrays, ShownInNotebook):
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
    actuators : Actuators
        Reflected inertia and balance at the sliders; none by default.

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
    actuators: Actuators = field(default_factory=Actuators)

    def __post_init__(self) -> None:
        kinds = {
            "geometry": Geometry,
            "bodies": Bodies,
            "limits": Limits,
            "friction": Friction,
            "actuators": Actuators,
        }
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

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, lists and texts: what the parameter file holds, ready for JSON.

        Returns
        -------
        dict
            With the names and the nesting of the parameter file, in SI units; each link has its own entry. No
            friction, no actuators and no payload if the machine has none.
        """
        limits = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self.limits).items()
        }
        data: dict[str, Any] = {
            "geometry": asdict(self.geometry),
            "gravity": self.gravity.tolist(),
            "limits": limits,
            "bodies": {name: body.to_dict() for name, body in self.unladen.bodies.items()},
        }
        if self.friction.to_dict() != Friction().to_dict():
            data["friction"] = self.friction.to_dict()
        if self.actuators:
            data["actuators"] = self.actuators.to_dict()
        payloads = [body.to_dict() for body in self.payloads]
        if payloads:
            data["payload"] = payloads[0] if len(payloads) == 1 else payloads
        return data

    @classmethod
    def from_dict(
        cls, data: Mapping[str, Any], source: str = "parameters", any_size: bool = False
    ) -> Parameters:
        """Make a machine from plain data: what `to_dict` returns, or anything that a parameter file may hold.

        Parameters
        ----------
        data : mapping
            With the names and the nesting of the parameter file; units in texts (``"120 mm"``) too.
        source : str
            What to call it in an error.
        any_size : bool
            Take a machine of more than 20 m or less than 1 mm too.

        Returns
        -------
        machine : Parameters
            `to_dict` of a machine gives the same numbers back to the last bit.

        Raises
        ------
        ParameterError
            If a field is missing, unknown, in a wrong unit or not physical, or the machine is too large or
            too small; the message names `source` and the field.
        """
        parts, payloads = read_parts(data, source, any_size)
        machine = named(source, lambda: cls(**parts))
        for payload in payloads:
            machine = machine.carrying(payload)
        return machine
