"""Second opinions: the forces and the motion of a machine by MuJoCo, Drake and Exudyn.

Each engine has a model of its own, made from the neutral description of the machine: MuJoCo reads the MJCF,
Drake the URDF with its ball constraints, Exudyn gets one rigid body a link and a joint for every joint, as in
ADAMS. None of them shares dynamics with `p3dof.closed_form.paper`, `p3dof.methods` or `p3dof.loops`.

`load` gives an engine: `Engine.forces` at every sample of a motion, `Engine.simulate` of the free machine
under constant forces. `driven_forces` and `convergence` let Exudyn integrate a motion in time.
"""

from __future__ import annotations

from importlib.util import find_spec
from types import MappingProxyType

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.machine.parameters import PAPER, Parameters
from p3dof.methods.engines.base import Engine, FinalState
from p3dof.methods.engines.drake import DrakeEngine
from p3dof.methods.engines.driven import Convergence, DrivenForces, Integrator, convergence, driven_forces
from p3dof.methods.engines.exudyn import ExudynEngine
from p3dof.methods.engines.mujoco import MujocoEngine

ENGINES = MappingProxyType({engine.name: engine for engine in (MujocoEngine, DrakeEngine, ExudynEngine)})
"""The engines by name."""


def load(name: str, parameters: Parameters = PAPER) -> Engine:
    """Return an engine with its model of a machine.

    Parameters
    ----------
    name : {"mujoco", "drake", "exudyn"}
        Which one.
    parameters : Parameters
        The machine; the paper's by default.

    Raises
    ------
    InputError
        If there is no such engine, `parameters` is something else, or the machine has friction.
    MissingExtraError
        If its library is not installed.
    ModelError
        If MuJoCo or Drake needs a mass for a massless link, and its neighbours have none to give.
    """
    return _known(name)(parameters)


def available(name: str) -> bool:
    """Return whether the library of an engine is installed.

    Parameters
    ----------
    name : {"mujoco", "drake", "exudyn"}
        Which one.

    Raises
    ------
    InputError
        If there is no such engine.
    """
    return find_spec(_known(name).module.partition(".")[0]) is not None


def _known(name: str) -> type[Engine]:
    if not isinstance(name, str) or name not in ENGINES:
        raise InputError(f"engine: expected one of {', '.join(ENGINES)}, got {shown(name)}")
    return ENGINES[name]


__all__ = [
    "ENGINES",
    "Convergence",
    "DrakeEngine",
    "DrivenForces",
    "Engine",
    "ExudynEngine",
    "FinalState",
    "Integrator",
    "MujocoEngine",
    "available",
    "convergence",
    "driven_forces",
    "load",
]
