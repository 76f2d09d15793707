"""`Drive`: motor, gear and screw or belt of one actuator, and the torque that a motion takes of its motor."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import DriveError
from p3dof.design.drives.checked import text
from p3dof.design.drives.motor import Motor
from p3dof.design.drives.transmission import Belt, Gear, Screw


@dataclass(frozen=True, eq=False)
class Drive:
    """Motor, gear and screw or belt of one actuator.

    Parameters
    ----------
    motor : Motor
        The motor.
    transmission : Screw or Belt
        What moves the slider.
    gear : Gear
        Between the two; none by default.
    name : str
        What tables call it; made of the parts without one.

    Raises
    ------
    DriveError
        If a part is something else.
    """

    motor: Motor
    transmission: Screw | Belt
    gear: Gear = field(default_factory=Gear)
    name: str = ""

    def __post_init__(self) -> None:
        for part, kinds in (("motor", Motor), ("transmission", (Screw, Belt)), ("gear", Gear)):
            if not isinstance(getattr(self, part), kinds):
                raise DriveError(
                    f"{part}: expected {_kinds(kinds)}, got {type(getattr(self, part)).__name__}"
                )
        text("drive: name", self.name)
        if not self.name:
            parts = [self.motor.name, self.transmission.name]
            if self.gear.ratio != 1 or self.gear.name != Gear().name:
                parts.insert(1, self.gear.name)
            object.__setattr__(self, "name", " + ".join(parts))

    @property
    def ratio(self) -> float:
        """Angle of the motor by way of the slider [rad/m]."""
        return self.gear.ratio * self.transmission.ratio

    @property
    def fast_inertia(self) -> float:
        """Of all that turns with the motor [kg m²]."""
        return self.motor.inertia + self.motor.coupling_inertia + self.gear.inertia

    @property
    def reflected_mass(self) -> float:
        """What the turning parts add to the mass of the slider, each by the ratio of its own shaft [kg]."""
        slow = float(self.transmission.inertia or 0.0)
        return self.fast_inertia * self.ratio**2 + slow * self.transmission.ratio**2

    def torque(self, force: FloatArray, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the torque of the motor.

        Stage by stage from the slider: efficiency acts on the power that passes, in its direction; what the
        turning parts take for themselves is added where they turn. At rest there is no direction: the torque
        is that without losses, in the middle of those that hold.

        Parameters
        ----------
        force : ndarray, shape (...)
            On the slider, along its way, without the reflected mass [N].
        speed, acceleration : ndarray, shape (...)
            Of the slider [m/s, m/s²].

        Returns
        -------
        ndarray, shape (...)
            [N m]
        """
        slow, gear = self.transmission, self.gear
        at_screw = _passed(force * speed, force / slow.ratio, slow)
        at_screw = at_screw + float(slow.inertia or 0.0) * slow.ratio * acceleration
        at_screw = at_screw + slow.drag * np.sign(speed)
        at_motor = _passed(at_screw * speed, at_screw / gear.ratio, gear)
        own = self.fast_inertia * self.ratio * acceleration + self.motor.drag * np.sign(speed)
        return np.asarray(at_motor + own)

    def screw_torque(self, force: FloatArray, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the torque at the output of the gear, arguments as of `torque`, in (...) [N m]."""
        slow = self.transmission
        found = _passed(force * speed, force / slow.ratio, slow)
        return np.asarray(
            found + float(slow.inertia or 0.0) * slow.ratio * acceleration + slow.drag * np.sign(speed)
        )


def _passed(power: FloatArray, torque: FloatArray, stage: Screw | Belt | Gear) -> FloatArray:
    """Return the torque before a stage, given that behind it without losses, and the sign of the power."""
    back = float(stage.efficiency_back or 0.0)
    return np.asarray(torque * np.where(power > 0, 1 / stage.efficiency, np.where(power < 0, back, 1.0)))


def _kinds(kinds: object) -> str:
    return " or ".join(kind.__name__ for kind in (kinds if isinstance(kinds, tuple) else (kinds,)))
