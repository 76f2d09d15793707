"""What motors, screws and balances take at the sliders, as formulas on numbers, arrays or symbols."""

from __future__ import annotations

from typing import NamedTuple

from p3dof._base.algebra import ZERO, Scalar, Vector, plus, times
from p3dof._base.checks import FloatArray
from p3dof.closed_form.paper.inertials import numbers
from p3dof.machine.parameters import Actuators


class Actuation(NamedTuple):
    """Reflected inertia [kg], balance at home [N] and its stiffness [N/m] at the sliders A, B, C."""

    inertia: Vector
    balance: Vector
    stiffness: Vector

    @property
    def resting(self) -> Actuation:
        """The inertia alone."""
        return Actuation(self.inertia, ZERO, ZERO)

    def force(self, leg: int, position: Scalar, acceleration: Scalar) -> Scalar:
        """Return what an actuator gives beside the force at its nut.

        Parameters
        ----------
        leg : int
            Its place among A, B, C.
        position, acceleration : number, array or symbol
            Of its slider [m, m/s²].

        Returns
        -------
        number, array or symbol
            [N]
        """
        held = plus(times(self.stiffness[leg], position), -self.balance[leg])
        return plus(times(self.inertia[leg], acceleration), held)


NO_ACTUATION = Actuation(ZERO, ZERO, ZERO)


def actuation_of(actuators: Actuators, gravity: FloatArray) -> Actuation:
    """Return the numbers of the sliders; zeros become structural ones.

    Parameters
    ----------
    actuators : Actuators
        Motors, screws and balances.
    gravity : ndarray, shape (3,)
        Acceleration of gravity, which acts on counterweights [m/s²].

    Returns
    -------
    Actuation
    """
    rows = actuators.inertia, actuators.balance_at_home(gravity), actuators.stiffness
    inertia, balance, stiffness = (numbers(row) for row in rows)
    return Actuation(inertia, balance, stiffness)
