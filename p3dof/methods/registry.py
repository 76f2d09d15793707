"""The ways to the forces, by name. A new one: a file with the doors of `DynamicsMethod`, a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol, TypeAlias

from p3dof.checks import shown
from p3dof.closed_loop import ClosedLoopModel
from p3dof.compiled import MachineKernels
from p3dof.errors import InputError
from p3dof.methods.compiled import CompiledMethod
from p3dof.methods.pinocchio import PinocchioMethod
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.methods.way import DynamicsMethod
from p3dof.parameters import Parameters

Method: TypeAlias = str
"""The name of a way to the forces, one of `METHODS`."""


class Machine(Protocol):
    """What a way can be made from: `p3dof.Manipulator`."""

    @property
    def parameters(self) -> Parameters:
        """The machine."""

    @property
    def loop(self) -> ClosedLoopModel:
        """Its closed-loop model on Pinocchio; made when it is first asked for."""

    @property
    def kernels(self) -> MachineKernels:
        """Its compiled kernels; made when they are first asked for."""


METHODS: Mapping[Method, Callable[[Machine], DynamicsMethod]] = {
    "pinocchio": lambda machine: PinocchioMethod(machine.parameters, machine.loop),
    "virtual-power": lambda machine: VirtualPowerMethod(machine.parameters),
    "compiled": lambda machine: CompiledMethod(machine.kernels),
}
"""The ways to the forces. The first two share only the parameters; the third is the second's result by the
reduced formulas of `p3dof.compiled.reduced`, compiled."""

DEFAULT_METHOD: Method = "pinocchio"
"""Wherever a method can be chosen."""


def check_method(method: str) -> str:
    """Return the name of a method if it is known.

    Parameters
    ----------
    method : str
        What the user gave.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If it is not one of `METHODS`.
    """
    if not isinstance(method, str) or method not in METHODS:
        raise InputError(f"method: expected one of {', '.join(map(repr, METHODS))}, got {shown(method)}")
    return method


def check_closed_form(method: str) -> str:
    """Return the name of a method if it is one of the paper's closed forms, else raise `InputError`."""
    if method not in ("virtual-power", "compiled"):
        raise InputError(f"method: expected 'virtual-power' or 'compiled', got {shown(method)}")
    return method


class Methods:
    """The ways to the forces of one machine, each made when it is first asked for.

    Parameters
    ----------
    machine : Machine
        What they are made from.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._made: dict[str, DynamicsMethod] = {}

    def __getitem__(self, method: Method) -> DynamicsMethod:
        try:
            return self._made[method]
        except (KeyError, TypeError):
            found = METHODS[check_method(method)](self._machine)
            self._made[method] = found
            return found
