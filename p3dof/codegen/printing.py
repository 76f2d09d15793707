"""The functions of a controller as C: `Routine` on the numbers of a machine, or on a prepared model."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from p3dof._base.errors import ParameterError
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.printing import statements, text
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.reduced import SMALLER_ZEROS, Actuated
from p3dof.closed_form.compiled.reduced.dynamics import FRICTION
from p3dof.codegen.frame import DOUBLE, Precision, indented, leave
from p3dof.codegen.machine import (
    MACHINE,
    NOT_NUMBERS,
    finite_number,
    machine_numbers,
    parameter_row,
    preparation,
    replay,
)
from p3dof.codegen.routines import LOAD, Routine, routines
from p3dof.machine.parameters import Parameters

_LOADED_BY = dict(zip(LOAD, ("w_y", "w_z", "w_theta"), strict=True))


class Printer:
    """One routine on a tape of its own, as it is printed."""

    def __init__(
        self, routine: Routine, numbers: dict[str, float] | None = None, precision: Precision = DOUBLE
    ) -> None:
        self.routine, self.baked = routine, numbers is not None
        self.tape, self.names = Tape(), dict[int, str]()
        self._known: dict[int, Number] = {}
        all_ = routines()
        self._known |= _tolerances(precision)
        try:
            self._put_in_machine(numbers)
            self._put_in_state()
            replay(all_.tape, all_.values(routine), self._known, self.tape)
        except (ArithmeticError, ValueError) as error:
            raise ParameterError(NOT_NUMBERS) from error
        self.labels = self._new_labels()
        self.results = [self._of(value) for value in routine.results]
        if self.baked:
            self.results = [
                self.tape.add(self._of(routine.more[i]), value) if i in routine.more else value
                for i, value in enumerate(self.results)
            ]

    def code(self) -> list[str]:
        """Return the body of the function from its inputs, which are finite, to ``found``, its results."""
        routine, added = self.routine, dict[int, str]()
        lines = [*self._inputs(), *self._guards()]
        if routine.friction and not self.baked:
            added = {place: f"added[{i}]" for i, place in enumerate(routine.more)}
            lines += self._load(added)
        lines += self._print(self.results)
        for i, value in enumerate(self.results):
            more = f" + {added[i]}" if i in added else ""
            lines.append(f"found[{i}] = {text(value, self.names)}{more};")
        return lines

    def operations(self) -> tuple[Counter[str], Counter[str]]:
        """Return how many operations a call takes, without and with friction; baked in it is in both."""
        routine = self.routine
        without = [*(self._of(value) for value in self._limits()), *self.results]
        if self.baked:
            return self._count(without), self._count(without)
        more = [self._of(value) for value in (*routine.friction, *routine.more.values())]
        always, loads = len(routine.more), len(LOAD) if routine.friction else 0
        full = self._count([*without, *more]) + Counter(add=always, sub=loads)
        return self._count(without) + Counter(add=always), full

    def _count(self, values: Sequence[Number]) -> Counter[str]:
        found = (self.tape.operations[index] for index in self.tape.needed(values))
        return Counter(operation.name for operation in found if operation.operands)

    def _put_in_machine(self, numbers: dict[str, float] | None) -> None:
        all_ = routines()
        if numbers is None:
            for place, index in enumerate(all_.constants()):
                symbol = self.tape.symbol(f"k[{place}]")
                self._known[index], self.names[symbol.index] = symbol, f"k[{place}]"
        else:
            self._known |= {all_.symbols[name].index: value for name, value in numbers.items()}

    def _put_in_state(self) -> None:
        all_, routine = routines(), self.routine
        for argument in routine.inputs:
            for name in filter(None, argument.symbols):
                symbol = self.tape.symbol(name)
                self._known[all_.symbols[name].index], self.names[symbol.index] = symbol, name
        if not routine.friction:
            return
        if self.baked:
            lost = replay(all_.tape, routine.friction, self._known, self.tape)
            for (load, acting), taken in zip(_LOADED_BY.items(), lost, strict=True):
                wrench = self._known.get(all_.symbols[acting].index, 0)
                self._known[all_.symbols[load].index] = self.tape.subtract(wrench, taken)
            return
        for load in LOAD:
            symbol = self.tape.symbol(load)
            self._known[all_.symbols[load].index], self.names[symbol.index] = symbol, load

    def _new_labels(self) -> dict[int, str]:
        found: dict[int, str] = {}
        for index, name in routines().labels.items():
            value = self._known.get(index)
            if isinstance(value, Symbol) and value.index not in self.names:
                found.setdefault(value.index, name)
        return found

    def _of(self, value: Number) -> Number:
        return self._known[value.index] if isinstance(value, Symbol) else value

    def _limits(self) -> list[Number]:
        all_ = routines()
        squares = [*all_.shape.squares, all_.least]
        return [*squares, all_.sine2, all_.least_sine2] if self.routine.held else squares

    def _print(self, values: Sequence[Number], names: dict[int, str] | None = None) -> list[str]:
        names = self.names if names is None else names
        if any(not isinstance(value, Symbol) and not math.isfinite(value) for value in self._numbers(values)):
            raise ParameterError(NOT_NUMBERS)
        needed = self.tape.needed(values, names)
        return statements(self.tape, needed, names, "sine_cosine", labels=self.labels)

    def _numbers(self, values: Sequence[Number]) -> list[Number]:
        operands = (self.tape.operations[index].operands for index in self.tape.needed(values))
        return [*values, *(operand for several in operands for operand in several)]

    def _inputs(self) -> list[str]:
        """Return a declaration of every input that is used."""
        more = [*self.routine.friction, *self.routine.more.values()]
        wanted = [*(self._of(value) for value in (*self._limits(), *more)), *self.results]
        used = {self.names.get(index) for index in self.tape.needed(wanted)}
        used |= {_LOADED_BY[load] for load in LOAD if load in used}
        lines = []
        for argument in self.routine.inputs:
            for i, name in enumerate(argument.symbols):
                if name and name in used:
                    value = f"{argument.name}[{i}]"
                    given = f"({argument.name} != NULL) ? {value} : 0.0" if argument.optional else value
                    lines.append(f"const double {name} = {given};")
        return lines

    def _guards(self) -> list[str]:
        """Return what leaves the function where it has no result."""
        *squares, least = (self._of(value) for value in self._limits()[:4])
        lines = self._print([*squares, least])
        lines.append(f"const double least = {text(least, self.names)};")
        reached = " && ".join(f"({text(square, self.names)} > least)" for square in squares)
        lines += leave(f"!({reached})", "P3DOF_OUT_OF_REACH")
        if self.routine.held:
            sine2, lowest = (self._of(value) for value in self._limits()[4:])
            lines += self._print([sine2, lowest])
            held = f"!({text(sine2, self.names)} >= {text(lowest, self.names)})"
            lines += leave(held, "P3DOF_SINGULAR")
        return lines

    def _load(self, added: dict[int, str]) -> list[str]:
        """Return the load, wrench less friction if the model has any, and what that adds to results."""
        friction = [self._of(value) for value in self.routine.friction]
        more = [self._of(self.routine.more[place]) for place in added]
        shared = set(self.tape.needed([*friction, *more])) & set(self.tape.needed(self.results))
        lines = self._print([Symbol(self.tape, index) for index in sorted(shared)])
        wrench = any(argument.name == "wrench" for argument in self.routine.inputs)
        lines += [f"double {load} = {name if wrench else '0.0'};" for load, name in _LOADED_BY.items()]
        if added:
            lines.append(f"double added[{len(added)}] = {{{', '.join(['0.0'] * len(added))}}};")
        names = dict(self.names)
        inner = self._print([*friction, *more], names)
        inner += [f"{load} -= {text(lost, names)};" for load, lost in zip(LOAD, friction, strict=True)]
        inner += [f"{name} = {text(value, names)};" for name, value in zip(added.values(), more, strict=True)]
        return [*lines, "if (model->friction != 0U) {", *indented(inner), "}"]


@dataclass(frozen=True)
class Count:
    """How many operations a call of a function takes, checks included; sin, cos and tanh count one each."""

    name: str  # the function
    general: int  # for any machine, and for symmetric bodies under gravity along z0, without friction
    symmetric: int
    friction: int  # what friction adds
    machine: int  # with the numbers of the machine put in, its friction included


def operation_counts(parameters: Parameters) -> list[Count]:
    """Return the operations of all functions but forward kinematics, which is written by hand."""
    found, numbers = [], machine_numbers(parameter_row(parameters))
    for routine in routines().all:
        without, full = Printer(routine).operations()
        machine = Printer(routine, numbers).operations()[0]
        found.append(
            Count(
                routine.name,
                without.total(),
                _symmetric(routine),
                full.total() - without.total(),
                machine.total(),
            )
        )
    return found


def _tolerances(precision: Precision) -> dict[int, Number]:
    symbols = routines().symbols
    return {symbols[name].index: value for name, value in precision.tolerances.items()}


def _symmetric(routine: Routine) -> int:
    """Return the operations for symmetric bodies without actuators, constants aside."""
    all_, tape = routines(), Tape()
    zeros = {*SMALLER_ZEROS, *Actuated._fields, *FRICTION}
    known: dict[int, Number] = {
        symbol.index: 0 if name in zeros else tape.symbol(name, constant=name in MODEL)
        for name, symbol in all_.symbols.items()
    }
    known |= _tolerances(DOUBLE)
    guards = [*all_.shape.squares, all_.least]
    guards += [all_.sine2, all_.least_sine2] if routine.held else []
    values = replay(all_.tape, [*guards, *routine.results], known, tape)
    operations = tape.operations
    return sum(bool(operations[i].operands) and not tape.constant[i] for i in tape.needed(values))


def prepare_code(
    access: dict[str, str], enumerators: Sequence[str], precision: Precision = DOUBLE
) -> list[str]:
    """Return the statements that fill ``found.numbers`` and ``found.constants``."""
    source, given, numbers = preparation()
    all_, tape = routines(), Tape()
    names: dict[int, str] = {}
    known: dict[int, Number] = {}
    for name, symbol in given.items():
        new = tape.symbol(name)
        known[symbol.index], names[new.index] = new, access[name]
    of_machine = replay(source, numbers, known, tape)
    start: dict[int, Number] = {
        all_.symbols[name].index: value for name, value in zip(MACHINE, of_machine, strict=True)
    }
    start |= _tolerances(precision)
    constants = replay(all_.tape, [Symbol(all_.tape, index) for index in all_.constants()], start, tape)
    lines = statements(tape, tape.needed([*of_machine, *constants], names), names)
    shown = zip(enumerators, of_machine, strict=False)  # the numbers of friction are not shown
    lines += [f"found.numbers[{name}] = {text(value, names)};" for name, value in shown]
    lines += [f"found.constants[{i}] = {text(value, names)};" for i, value in enumerate(constants)]
    return lines


def home_depth(numbers: dict[str, float] | None) -> str:
    """Return the depth h of the platform at home in C."""
    all_ = routines()
    home = all_.home
    if numbers is None:
        place = all_.constants().index(home.index) if isinstance(home, Symbol) else 0
        return f"model->constants[{place}]"
    known: dict[int, Number] = {all_.symbols[name].index: value for name, value in numbers.items()}
    return repr(finite_number(replay(all_.tape, [home], known, Tape())[0]))
