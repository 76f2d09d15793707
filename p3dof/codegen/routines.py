"""What a controller computes, as traced formulas: one `Routine` for every function of the generated C.

All are on one tape, so that what depends on the machine only is there once. With friction the formulas take
what acts on the platform, wrench less friction, as the load ``load_y, load_z, load_theta``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TypeAlias

from p3dof._base.algebra import Matrix, Vector
from p3dof._base.tracing import Number, Symbol, Tape, derivatives
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import ACCELERATION, FORCES, MODEL, POSE, VELOCITY
from p3dof.closed_form.compiled.reduced import Model, Shape, State
from p3dof.closed_form.compiled.reduced.dynamics import FRICTION, TOGETHER, generalized_friction
from p3dof.codegen.frame import DOUBLE, Argument, Prototype
from p3dof.codegen.machine import MACHINE

LOAD = ("load_y", "load_z", "load_theta")
WRENCH = ("", "w_y", "w_z", "", "w_theta", "")
RATES = ("rate_a", "rate_b", "rate_c")

_TEXTS = {
    "pose": "y [m], z [m], theta [rad]",
    "velocity": "of the pose [m/s, m/s, rad/s]",
    "acceleration": "of the pose [m/s^2, m/s^2, rad/s^2]",
    "wrench": "on the platform at P, fixed axes: Fx, Fy, Fz [N], Mx, My, Mz [N m]; NULL for none",
    "forces": "of the actuators A, B, C on their sliders, positive upward [N]",
    "rates": "velocities of the sliders A, B, C [m/s]",
    "sliders": "positions of A, B, C, zero at home, positive upward [m]",
}
_INPUTS = {
    "pose": POSE,
    "velocity": VELOCITY,
    "acceleration": ACCELERATION,
    "wrench": WRENCH,
    "forces": FORCES,
    "rates": RATES,
}


@dataclass(frozen=True, eq=False)
class Routine:
    """A function of the generated C."""

    name: str  # its name, without prefix
    text: str  # what it does
    inputs: tuple[Argument, ...]  # what it takes and gives
    outputs: tuple[Argument, ...]
    held: bool  # the actuators must hold the platform
    results: tuple[Number, ...]  # all entries of the outputs in a row
    friction: tuple[Number, ...] = ()
    """What friction takes in y, z, θ, which is taken off the load; empty if the load does not matter."""
    more: Mapping[int, Number] = field(default_factory=dict)
    """What friction adds to results beside, by their place."""

    @property
    def prototype(self) -> Prototype:
        """Its row in the table of functions."""
        return Prototype(self.name, self.inputs, self.outputs)


@dataclass(frozen=True, eq=False)
class Routines:
    """All functions on their tape."""

    tape: Tape  # the operations
    symbols: Mapping[str, Symbol]
    """Numbers of the machine, inputs, the load and tolerances of a precision, by name."""
    shape: Shape  # where the mechanism is
    least: Number  # what the squared drop of each leg must be more than
    sine2: Number
    """Squared sine of the angle from the actuation singularity, times r² u², and the least of it."""
    least_sine2: Number
    home: Number  # depth h of the platform at home
    all: tuple[Routine, ...]  # the functions

    @property
    def labels(self) -> dict[int, str]:
        """Names of values in the code, by their index."""
        named = dict(zip(Shape._fields, self.shape, strict=True))
        named |= dict(zip(("square_a", "square_b", "square_c"), named.pop("squares"), strict=True))
        return {value.index: name for name, value in named.items() if isinstance(value, Symbol)}

    def values(self, routine: Routine) -> list[Number]:
        """Return all that a routine needs, whether there is friction or not."""
        found = [*self.shape.squares, self.least, *routine.results, *routine.friction, *routine.more.values()]
        return [*found, self.sine2, self.least_sine2] if routine.held else found

    def constants(self) -> list[int]:
        """Return what is computed once for a machine, in the order of first use."""
        constant, found = self.tape.constant, dict[int, None]()
        for routine in self.all:
            values = self.values(routine)
            for index in self.tape.needed(values):
                if not constant[index]:
                    found |= {v.index: None for v in _symbols(self.tape.operations[index].operands)}
            found |= {v.index: None for v in _symbols(values)}
        found |= {v.index: None for v in _symbols([self.home])}
        return [index for index in found if constant[index]]


_Formula: TypeAlias = Callable[["_Trace"], tuple[Sequence[Number], Mapping[int, Number]]]


class _Trace:
    """What the formulas have in common."""

    def __init__(self) -> None:
        self.tape = Tape()
        machine = self.tape.symbols(MACHINE, constant=True)
        moving = (*POSE, *VELOCITY, *ACCELERATION, *FORCES, *RATES, *(name for name in WRENCH if name), *LOAD)
        least = self.tape.symbols(DOUBLE.tolerances, constant=True)
        self.symbols = dict(zip((*MACHINE, *moving), (*machine, *self.tape.symbols(moving)), strict=True))
        self.symbols |= zip(DOUBLE.tolerances, least, strict=True)
        self.model = Model.of_numbers(machine[: len(MODEL)])
        self.y, self.theta = self.symbols["y"], self.symbols["theta"]
        self.shape = reduced.shape(self.model, self.y, self.theta, self.tape, short_chains=True)
        self.plain = reduced.shape(self.model, self.y, self.theta, self.tape)
        self.load = self._vector(LOAD)
        self.state = State(*(self.symbols[name] for name in State._fields))
        self.resting = self.state._replace(ay=0, az=0, atheta=0)
        count, numbers = len(TOGETHER), [self.symbols[name] for name in FRICTION]
        coefficients = numbers[:count], numbers[count : 2 * count], numbers[-1]
        self.friction, self.plain_friction = (
            generalized_friction(x, self.y, self._vector(VELOCITY), coefficients, self.tape)
            for x in (self.shape, self.plain)
        )

    def _vector(self, names: Sequence[str]) -> Vector:
        one, two, three = (self.symbols[name] for name in names)
        return one, two, three

    def forces(self, x: Shape) -> Vector:
        return reduced.actuator_forces(self.model, x, self.state, self.tape, self.load)

    def by(self, names: Sequence[str]) -> tuple[list[list[Number]], list[list[Number]]]:
        """Return derivatives of the forces: rows A, B, C, at a constant load and what friction adds.

        Of the arrangement with fewer operations: derivatives double what it has less.
        """
        inputs = [self.symbols[name] for name in names]
        columns = zip(*derivatives(self.plain_friction, inputs), strict=True)
        added = [reduced.solve_transposed(self.plain, column) for column in columns]
        return derivatives(self.forces(self.plain), inputs), [list(row) for row in zip(*added, strict=True)]


def _inverse_dynamics(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    return trace.forces(trace.shape), {}


def _inverse_kinematics(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    return reduced.sliders(trace.model, trace.shape, trace.symbols["z"], trace.tape), {}


def _jacobian(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    x = trace.shape
    return (-x.ta, 1, 0, x.tb, 1, 0, -x.ty, 1, x.arm), {}


def _pose_velocity(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    x, (a, b, c) = trace.shape, trace._vector(RATES)
    vy = (b - a) * (1 / (x.ta + x.tb))
    vz = a + x.ta * vy
    return (vy, vz, (c - vz + x.ty * vy) * (1 / x.arm)), {}


def _mass_matrix(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    M: Matrix = reduced.mass_matrix(trace.model, trace.shape, trace.y, trace.tape)
    return [entry for row in M for entry in row], {}


def _bias(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    F, Q = reduced.loads(trace.model, trace.shape, trace.resting, trace.tape, trace.load)
    return [f + q for f, q in zip(reduced.transposed(trace.shape, F), Q, strict=True)], {}


def _forward_dynamics(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    forces = trace._vector(FORCES)
    return reduced.forward_dynamics(trace.model, trace.shape, trace.state, forces, trace.tape, trace.load), {}


def _by_motion(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    results, more = list(trace.forces(trace.plain)), dict[int, Number]()
    for names in (POSE, VELOCITY, ACCELERATION):
        _append(results, more, *trace.by(names))
    return results, more


def _by_parameters(trace: _Trace) -> tuple[Sequence[Number], Mapping[int, Number]]:
    results, more = list(trace.forces(trace.plain)), dict[int, Number]()
    _append(results, more, *trace.by(MODEL))
    return results, more


def _append(
    results: list[Number], more: dict[int, Number], rows: list[list[Number]], added: list[list[Number]]
) -> None:
    for row, extra in zip(rows, added, strict=True):
        more |= {len(results) + i: value for i, value in enumerate(extra) if isinstance(value, Symbol)}
        results += row


def _matrix(name: str, text: str) -> Argument:
    return Argument(name, text, (3, 3))


def _input(name: str) -> Argument:
    return Argument(name, _TEXTS[name], (len(_INPUTS[name]),), _INPUTS[name], optional=name == "wrench")


def _output(name: str) -> Argument:
    return Argument(name, _TEXTS[name])


_BY = "d forces / d {}: rows A, B, C"
_MOTION = ("pose", "velocity", "acceleration", "wrench")
_ALL: tuple[tuple[str, str, tuple[str, ...], tuple[Argument, ...], bool, _Formula], ...] = (
    (
        "inverse_dynamics",
        "Forces of the actuators for a motion, friction included.",
        _MOTION,
        (_output("forces"),),
        True,
        _inverse_dynamics,
    ),
    (
        "inverse_kinematics",
        "Positions of the sliders at a pose.",
        ("pose",),
        (_output("sliders"),),
        False,
        _inverse_kinematics,
    ),
    (
        "jacobian",
        "d sliders / d pose: velocities of the sliders are J times the velocity of the pose.",
        ("pose",),
        (_matrix("jacobian", "rows A, B, C [m/m, m/m, m/rad]"),),
        False,
        _jacobian,
    ),
    (
        "pose_velocity",
        "Velocity of the pose at velocities of the sliders: J times it are those.",
        ("pose", "rates"),
        (Argument("velocity", _TEXTS["velocity"]),),
        True,
        _pose_velocity,
    ),
    (
        "mass_matrix",
        "Mass matrix M of M a + h = J^T forces + (Fy, Fz, My), symmetric and positive definite.",
        ("pose",),
        (_matrix("mass", "in y, z, theta [kg, kg m, kg m^2]"),),
        False,
        _mass_matrix,
    ),
    (
        "bias",
        "Bias h of the same equations: what it takes not to accelerate, gravity and friction included.",
        ("pose", "velocity"),
        (Argument("bias", "in y, z, theta [N, N, N m]"),),
        False,
        _bias,
    ),
    (
        "forward_dynamics",
        "Acceleration of the platform under forces of the actuators; at actuation-singular poses too.",
        ("pose", "velocity", "forces", "wrench"),
        (_output("acceleration"),),
        False,
        _forward_dynamics,
    ),
    (
        "inverse_dynamics_derivatives",
        "Forces of the actuators and their exact derivatives by the motion; the wrench stays as it is.",
        _MOTION,
        (
            _output("forces"),
            _matrix("by_pose", _BY.format("(y, z, theta)") + " [N/m, N/m, N/rad]"),
            _matrix("by_velocity", _BY.format("velocity") + " [N s/m, N s/m, N s/rad]"),
            _matrix("by_acceleration", _BY.format("acceleration") + " [N s^2/m, N s^2/m, N s^2/rad]"),
        ),
        True,
        _by_motion,
    ),
    (
        "parameter_derivatives",
        "Forces of the actuators and their exact derivatives by the numbers of the machine, each alone:\n"
        " * by a length with all other numbers, the base inertial parameters among them, kept as they are.",
        _MOTION,
        (
            _output("forces"),
            Argument(
                "by_numbers",
                _BY.format("numbers") + ", columns as in p3dof_number",
                (3, len(MODEL)),
                columns="P3DOF_NUMBERS",
            ),
        ),
        True,
        _by_parameters,
    ),
)


@cache
def routines() -> Routines:
    """Return all functions, traced once."""
    trace = _Trace()
    x, model, found = trace.shape, trace.model, []
    for name, text, inputs, outputs, held, formula in _ALL:
        results, more = formula(trace)
        arguments = tuple(map(_input, inputs))
        friction = trace.friction if "velocity" in inputs else ()
        found.append(Routine(name, text, arguments, outputs, held, tuple(results), friction, more))
    sine = x.arm * x.Sc  # of the angle from det J = 0, times r u
    width = model.R - model.r
    return Routines(
        tape=trace.tape,
        symbols=trace.symbols,
        shape=x,
        least=trace.symbols["least_drop2"] * (model.L * model.L),
        sine2=sine * sine,
        least_sine2=(trace.symbols["least_actuation2"] * (model.r * model.r)) * x.u2,
        home=trace.tape.sqrt((model.L - width) * (model.L + width)),
        all=tuple(found),
    )


def _symbols(values: Sequence[Number]) -> list[Symbol]:
    return [value for value in values if isinstance(value, Symbol)]
