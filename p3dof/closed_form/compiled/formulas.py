"""The kernels as formulas: what is traced, from which numbers of the machine, for which inputs and outputs.

Every kernel exists for general bodies and, with fewer operations, for bodies that are symmetric as the
paper's are under gravity along z0, without springs at the sliders. The last output of each is its margin; see
`p3dof.closed_form.compiled.reduced.margin`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from p3dof._base.tracing import Number, Symbol, Tape, derivatives
from p3dof._base.tracing.printing import function_of
from p3dof._base.tracing.tape import in_pairs
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.reduced import MOVING, SMALLER_ZEROS, Actuated, Model, Reduced, State
from p3dof.closed_form.compiled.reduced.dynamics import FRICTION, generalized_friction

WRENCH = ("w_y", "w_z", "w_theta")
FORCES = ("f_a", "f_b", "f_c")
POSE = ("y", "z", "theta")
VELOCITY = ("vy", "vz", "vtheta")
ACCELERATION = ("ay", "az", "atheta")
SLIDERS = ("slide_a", "slide_b", "slide_c")
MASSES = ("m_yy", "m_yz", "m_yt", "m_zt", "m_tt", "m_zz")
GRAVITY = ("gx", "gy", "gz")

MODEL = ("r", "R", "L", *GRAVITY, *Reduced._fields, *Actuated._fields)
"""The numbers of a machine in a row, as in `Model.numbers`."""


@dataclass(frozen=True, eq=False)
class Kernel:
    """A traced formula: constants of the machine and inputs of a sample to outputs."""

    name: str  # its name, also in C
    tape: Tape  # its operations
    model: tuple[Number, ...]
    """The 36 numbers of a machine, and of its friction where there is; zeros of symmetric bodies are the
    number 0."""
    inputs: tuple[str, ...]  # what a sample has, and what comes out, by name
    outputs: tuple[str, ...]
    symbols: tuple[Symbol, ...]  # the inputs on the tape
    results: tuple[Number, ...]  # the outputs on the tape

    @cached_property
    def constants(self) -> tuple[Symbol, ...]:
        """What can be computed once for a machine, in the order of first use."""
        constant, found = self.tape.constant, dict[int, None]()
        for index in self.tape.needed(self.results):
            if not constant[index]:
                for operand in self.tape.operations[index].operands:
                    if isinstance(operand, Symbol) and constant[operand.index]:
                        found.setdefault(operand.index)
        for result in self.results:
            if isinstance(result, Symbol) and constant[result.index]:
                found.setdefault(result.index)
        return tuple(Symbol(self.tape, index) for index in found)

    @cached_property
    def prepare(self) -> Callable[..., tuple[float, ...]]:
        """The constants of a machine from its numbers that are symbols here, by name of `MODEL`."""
        given = [number for number in self.model if isinstance(number, Symbol)]
        return function_of(self.tape, given, self.constants)

    @cached_property
    def prepare_columns(self) -> Callable[..., tuple[Any, ...]]:
        """The constants of many machines, from columns of the numbers that `prepare` takes."""
        given = [number for number in self.model if isinstance(number, Symbol)]
        return function_of(self.tape, given, self.constants, np)

    @cached_property
    def on_arrays(self) -> Callable[..., tuple[Any, ...]]:
        """The outputs on NumPy arrays, from the constants and the inputs."""
        return function_of(self.tape, (*self.constants, *self.symbols), self.results, np)

    def operations(self, margin: bool = False) -> Counter[str]:
        """Return how many operations a sample takes, by name; sin, cos and tanh count one each."""
        results = self.results if margin else self.results[:-1]
        tape = self.tape
        return Counter(
            tape.operations[index].name
            for index in tape.needed(results)
            if tape.operations[index].operands and not tape.constant[index]
        )

    def of(self, model: Model, friction: Sequence[float] = ()) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the constants of a machine, (len(constants),)."""
        return self.of_numbers((*model.numbers, *friction))

    def of_numbers(self, numbers: Sequence[float]) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the constants of a machine by its numbers, (len(constants),)."""
        pairs = zip(self.model, numbers, strict=True)
        return np.array(self.prepare(*(float(value) for name, value in pairs if isinstance(name, Symbol))))

    def of_columns(self, numbers: Sequence[Any], count: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the constants of many machines, (count, len(constants)); as `of`, bit for bit."""
        pairs = zip(self.model, numbers, strict=True)
        found = self.prepare_columns(*(value for name, value in pairs if isinstance(name, Symbol)))
        table = np.empty((count, len(found)))
        for column, values in zip(table.T, found, strict=True):
            column[:] = values
        return table


def is_symmetric(model: Model) -> bool:
    """Return whether the smaller kernels serve a machine."""
    return not any(number for name, number in zip(MODEL, model.numbers, strict=True) if name in SMALLER_ZEROS)


def _inverse(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    state = state_of(rows)
    x = reduced.shape(model, state.y, state.theta, tape)
    forces = reduced.actuator_forces(model, x, state, tape, _wrench(rows))
    return [*forces, reduced.margin(model, x, tape, [*forces, rows["z"], rows["vz"]])]


def _inverse_with_friction(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    return _inverse(tape, model, rows | less_friction(tape, model, rows))


def _forward_with_friction(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    return _forward(tape, model, rows | less_friction(tape, model, rows))


def less_friction(tape: Tape, model: Model, rows: Mapping[str, Any]) -> dict[str, Symbol]:
    """Return the wrench less what friction takes in y, z, θ; by names of `WRENCH`."""
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    numbers = [rows[name] for name in FRICTION]
    count = len(numbers) // 2
    coefficients = numbers[:count], numbers[count : 2 * count], numbers[-1]
    velocity = rows["vy"], rows["vz"], rows["vtheta"]
    lost = generalized_friction(x, rows["y"], velocity, coefficients, tape)
    return {name: rows[name] - force for name, force in zip(WRENCH, lost, strict=True)}


def _gravity(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    F, Q = reduced.loads(model, x, State(rows["y"], rows["theta"], 0, 0, 0, 0, 0, rows["z"]), tape)
    found = [f + q for f, q in zip(reduced.transposed(x, F), Q, strict=True)]
    return [*found, reduced.margin(model, x, tape, [*found, rows["z"]], held=False)]


def _coriolis(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    M = reduced.mass_matrix(model, x, rows["y"], tape)
    velocity = rows["vy"], rows["vz"], rows["vtheta"]
    C = reduced.coriolis_matrix(M, (rows["y"], 0, rows["theta"]), velocity)
    found = [entry for y, _, theta in C for entry in (y, theta)]
    return [*found, reduced.margin(model, x, tape, [*found, rows["z"], rows["vz"]], held=False)]


def _assembly(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    pose, margin = reduced.assembled(model, (rows["slide_a"], rows["slide_b"], rows["slide_c"]), tape)
    return [*pose, margin]


def _derivatives(
    tape: Tape, model: Model, rows: dict[str, Symbol], by: Sequence[str] = MOVING
) -> list[Number]:
    *forces, margin = _inverse(tape, model, rows)
    by_state = derivatives(forces, [rows[name] for name in by])
    return [*forces, *(entry for row in by_state for entry in row), margin]


def _derivatives_with_friction(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    return _derivatives(tape, model, rows | less_friction(tape, model, rows), _RESISTED)


def _forward(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    state, forces = state_of(rows), (rows["f_a"], rows["f_b"], rows["f_c"])
    x = reduced.shape(model, state.y, state.theta, tape)
    found = reduced.forward_dynamics(model, x, state, forces, tape, _wrench(rows))
    return [*found, reduced.margin(model, x, tape, [*found, rows["z"], rows["vz"]], held=False)]


def _masses(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    (yy, yz, yt), (_, zz, zt), (_, _, tt) = reduced.mass_matrix(model, x, rows["y"], tape)
    return [yy, yz, yt, zt, tt, zz, reduced.margin(model, x, tape, (yy, yt, tt, rows["z"]), held=False)]


def _kinematics(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    sliders = reduced.sliders(model, x, rows["z"], tape)
    return [*sliders, -x.ta, x.tb, -x.ty, x.arm, reduced.margin(model, x, tape, sliders, held=False)]


def _limits(tape: Tape, model: Model, rows: dict[str, Symbol]) -> list[Number]:
    x = reduced.shape(model, rows["y"], rows["theta"], tape)
    velocity = rows["vy"], rows["vz"], rows["vtheta"]
    sliders = reduced.sliders(model, x, rows["z"], tape)
    cosines, rates = reduced.limit_cosines(model, x, rows["y"], velocity, tape)
    found = [*sliders, *cosines, *reduced.slider_rates(x, velocity), *rates]
    return [*found, reduced.margin(model, x, tape, found, held=False)]


_Formula = Callable[[Tape, Model, dict[str, Symbol]], list[Number]]
_MOTION = (*POSE, *VELOCITY, *ACCELERATION)
_DRIVEN = (*POSE, *VELOCITY, *FORCES)
CORIOLIS = ("c_yy", "c_yt", "c_zy", "c_zt", "c_ty", "c_tt")
_WATCHED = (*SLIDERS, "cos_a", "cos_b", "cos_c", "cos_54")
_RESISTED = (*MOVING, "vz")


def _forces_by(names: Sequence[str]) -> tuple[str, ...]:
    return (*FORCES, *(f"d{force}_d{name}" for force in FORCES for name in names))


_FORMULAS: dict[str, tuple[_Formula, tuple[str, ...], tuple[str, ...]]] = {
    "inverse_dynamics": (_inverse, _MOTION, FORCES),
    "inverse_dynamics_loaded": (_inverse, (*_MOTION, *WRENCH), FORCES),
    "inverse_dynamics_derivatives": (_derivatives, (*_MOTION, *WRENCH), _forces_by(MOVING)),
    "forward_dynamics": (_forward, _DRIVEN, ACCELERATION),
    "forward_dynamics_loaded": (_forward, (*_DRIVEN, *WRENCH), ACCELERATION),
    "inverse_dynamics_with_friction": (_inverse_with_friction, (*_MOTION, *WRENCH), FORCES),
    "forward_dynamics_with_friction": (_forward_with_friction, (*_DRIVEN, *WRENCH), ACCELERATION),
    "inverse_dynamics_derivatives_with_friction": (
        _derivatives_with_friction,
        (*_MOTION, *WRENCH),
        _forces_by(_RESISTED),
    ),
    "mass_matrix": (_masses, POSE, MASSES),
    "coriolis_matrix": (_coriolis, (*POSE, *VELOCITY), CORIOLIS),
    "gravity_forces": (_gravity, POSE, ("g_y", "g_z", "g_theta")),
    "kinematics": (_kinematics, POSE, (*SLIDERS, "j_ay", "j_by", "j_cy", "j_ctheta")),
    "forward_kinematics": (_assembly, SLIDERS, POSE),
    "limits": (_limits, (*POSE, *VELOCITY), (*_WATCHED, *(f"d{name}" for name in _WATCHED))),
}

NAMES = tuple(_FORMULAS)  # the kernels; all but those of `OF_LENGTHS` also exist as ``..._symmetric``

OF_LENGTHS = ("kinematics", "forward_kinematics", "limits")  # kernels that no body matters to

WITH_FRICTION = tuple(name for name in NAMES if name.endswith("_with_friction"))
"""Kernels whose constants are also of the friction."""

DERIVATIVES = {
    False: ("inverse_dynamics_derivatives", MOVING),
    True: ("inverse_dynamics_derivatives_with_friction", _RESISTED),
}
"""Without and with friction: the kernel, and what its derivatives are by; ż only resists."""


def all_kernels() -> list[Kernel]:
    """Return every kernel in both forms."""
    found = []
    for name in NAMES:
        found.append(kernel(name))
        if name not in OF_LENGTHS:
            found.append(kernel(name, symmetric=True))
    return found


@cache
def kernel(name: str, symmetric: bool = False) -> Kernel:
    """Return a kernel, traced once."""
    formula, inputs, outputs = _FORMULAS[name]
    symmetric = symmetric and name not in OF_LENGTHS
    zeros: Sequence[str] = SMALLER_ZEROS if symmetric else ()
    tape = Tape()
    model = tuple(0 if number in zeros else tape.symbol(number, constant=True) for number in MODEL)
    friction = tape.symbols(FRICTION, constant=True) if name in WITH_FRICTION else ()
    symbols = tape.symbols(inputs)
    rows = dict(zip((*inputs, *FRICTION), (*symbols, *friction), strict=False))
    results = in_pairs(tape, formula(tape, Model.of_numbers(model), rows))
    full_name = f"{name}_symmetric" if symmetric else name
    return Kernel(full_name, tape, (*model, *friction), inputs, (*outputs, "margin"), symbols, tuple(results))


def state_of(rows: dict[str, Symbol]) -> State:
    """Return the state that rows have by its names; zero where they have none."""
    return State(*(rows.get(name, 0) for name in State._fields))


def _wrench(rows: dict[str, Symbol]) -> tuple[Number, Number, Number]:
    return rows.get("w_y", 0), rows.get("w_z", 0), rows.get("w_theta", 0)
