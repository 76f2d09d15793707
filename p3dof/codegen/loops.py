"""The dynamics of any robot with closed loops as C99 for a controller: library, self-test, README."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError, ModelError, P3dofError
from p3dof.codegen.frame import (
    DOUBLE,
    INDENT,
    SINGLE,
    Argument,
    Precision,
    Prototype,
    definition,
    groups,
    indented,
    leave,
    precision_of,
    with_build,
)
from p3dof.codegen.naming import CPU, checked_prefix, fill, fingerprint, number_table, origin, wave
from p3dof.codegen.webassembly import Exported, WebModule
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.assembly import Limits
from p3dof.loops.compiled.formulas import EVIDENCE, MARGIN, MARGIN_OF_STATES
from p3dof.loops.compiled.function import Function
from p3dof.loops.compiled.functions import FUNCTIONS
from p3dof.loops.compiled.printing import body
from p3dof.loops.compiled.printing import fill as core_of
from p3dof.loops.compiled.robot import closed_configurations
from p3dof.loops.online import UDFactors, payload_deviations
from p3dof.loops.tables import units_of_actuated
from p3dof.loops.transmission import MAPS, STEPS_OF_PIECE, TRIES, Transmission, mapping_text
from p3dof.loops.trees import joint_value

_COUNT = 8
_RATE, _SWING, _SAMPLES = 1000.0, 0.02, 100
"""Of the motion that is followed: samples a second, amplitude [m or rad], number."""
_FORGETTING, _GATE = 0.9, 6.0  # of the estimator: factor, standard deviations
_BANDWIDTH = 30.0  # of forces that are observed [Hz]
_TOLERANCE = 1e-9  # largest error, of the largest entry of a result
_ROUNDINGS = 64.0  # by how much another order of roundings may be worse than that of NumPy


@dataclass(frozen=True, eq=False)
class _State:
    """A motion of the tree that keeps the loops closed, with its forces."""

    q: FloatArray
    v: FloatArray
    a: FloatArray
    tau: FloatArray


class _Case(NamedTuple):
    """What the self-test calls: rows of numbers that go in, and that come out, in groups."""

    name: str
    given: FloatArray
    expected: FloatArray
    sizes: list[int]  # of the groups of results that are compared
    results: int  # how many numbers come out at most
    run: str  # C that calls it
    rounding: float = 0.0  # relative error that single precision makes


def selftest(
    robot: ClosedLoopModel, compiled: CompiledLoop, printer: LoopPrinter, functions: Sequence[Function]
) -> dict[str, str]:
    """Return what the template of the self-test is filled with; text by placeholder."""
    states, prefix, cases = _states(robot, compiled), printer.prefix, list[_Case]()
    for function in functions:
        given, expected, sizes = _table(robot, compiled, function, states)
        run = _run(prefix, printer.row(function))
        cases.append(_Case(function.name, given, expected, sizes, len(function.results), run))
    if printer.maps is not None:
        cases += printer.maps.cases([state.q for state in states])
    tables = [
        number_table(f"{way}_{case.name}[{len(rows)}][{rows.shape[1]}]", rows)
        for case in cases
        for way, rows in (("in", case.given), ("out", case.expected))
    ]
    rows = [
        f'{INDENT}{{"{case.name}", run_{case.name}, in_{case.name}[0], out_{case.name}[0], '
        f"{case.given.shape[1]}, {case.expected.shape[1]}, {case.results}, {{{groups(case.sizes, 6)}}}}},"
        for case in cases
    ]
    return {
        "prefix": prefix,
        "PREFIX": prefix.upper(),
        "count": str(len(states)),
        "functions": str(len(cases)),
        "inputs": str(max(case.given.shape[1] for case in cases)),
        "results": str(max(case.results for case in cases)),
        "tolerance": repr(max(_TOLERANCE, _ROUNDINGS * max(case.rounding for case in cases))),
        "tables": "\n\n".join(tables),
        "runs": "\n".join(case.run for case in cases),
        "rows": "\n".join(rows),
        "follow": _follow(robot, prefix, functions) if printer.follows else "",
        "follows": str(int(printer.follows)),
        "observe": _observe(prefix, cases, functions) if printer.observes else "",
        "observes": str(int(printer.observes)),
        "estimate": _estimate(prefix, cases, functions, compiled) if printer.estimates else "",
        "estimates": str(int(printer.estimates)),
    }


def _states(robot: ClosedLoopModel, compiled: CompiledLoop) -> list[_State]:
    """Return motions that keep the loops closed, always the same."""
    draw, found, why = np.random.default_rng(1), [], ""
    for q in closed_configurations(robot, robot.regular_configuration, seed=1)[:_COUNT]:
        J = robot.closure_jacobian(q)
        free = np.linalg.svd(J)[2][robot.rank(q) :].T if J.size else np.eye(robot.model.nv)
        v = free @ draw.normal(size=free.shape[1])
        a_actuated = draw.normal(size=len(robot.actuated))
        try:
            if compiled.determined or not compiled.hybrid:
                wanted = free @ draw.normal(size=free.shape[1])
                a = robot.forward_dynamics(q, v, np.zeros(len(robot.actuated))).a + wanted
                found.append(_State(q, v, a, robot.inverse_dynamics(q, v, a).tau))
            else:
                done = robot.hybrid_dynamics(q, v, a_actuated)
                found.append(_State(q, v, np.array(done.a), np.array(done.tau)))
        except P3dofError as error:
            why = str(error)  # a singular configuration is no sample
    if not found:
        raise ModelError(f"robot: the self-test finds no motion: {why}")
    return found


def _table(
    robot: ClosedLoopModel, compiled: CompiledLoop, function: Function, states: Sequence[_State]
) -> tuple[FloatArray, FloatArray, list[int]]:
    """Return inputs and expected outputs, by the general layer or the traced function, and group sizes."""
    free = np.array(compiled.independent_places, dtype=int)
    known: dict[str, Callable[[_State], FloatArray]] = {
        "q": lambda s: s.q,
        "v": lambda s: s.v,
        "a": lambda s: s.a,
        "tau": lambda s: s.tau,
        "a_actuated": lambda s: s.a[robot.actuated_v],
        "v_independent": lambda s: s.v[free],
        "a_independent": lambda s: s.a[free],
    }
    given, expected = [], []
    results = [name for name in function.outputs if name not in EVIDENCE]
    compared = [name for name in results if name in ("tau", "v", "a")]
    by_python = not compared or function.name.startswith("tangent")
    sizes = [function.outputs[name] for name in (results if by_python else compared)]
    for number, state in enumerate(states):
        row = []
        for name, size in function.inputs.items():
            if name in known:
                row.append(known[name](state))
            elif name in compiled.defaults:
                row.append(compiled.defaults[name])
            else:  # a direction, or a small change
                row.append(1e-3 * np.cos(np.arange(size) + number))
        given.append(np.concatenate(row))
        if by_python:
            expected.append(np.array(function.on_arrays(*given[-1])[: sum(sizes)], dtype=float))
        else:
            expected.append(np.concatenate([known[name](state) for name in compared]))
    return np.array(given), np.array(expected), sizes


def _run(
    prefix: str, row: Prototype, precision: Precision = DOUBLE, state: Sequence[tuple[str, int]] = ()
) -> str:
    """Return what calls a function from a row of numbers into another, perhaps with a NULL.

    `state`: what of the ``state`` of a transmission the row begins with, and its size; without, the function
    takes none.
    """
    narrow, real = precision is SINGLE, precision.real
    source, target = ("given", "found") if narrow else ("in", "out")
    inputs, outputs, kept, place, size = ["&state"] * bool(state), list[str](), list[str](), 0, 0
    for name, count in state:
        kept.append(f"memcpy(state.{name}, &{source}[{place}], sizeof state.{name});")
        place += count
    for one in row.inputs:
        inputs.append(f"&{source}[{place}]")
        place += one.size
    for one in row.outputs:
        outputs += [] if one is _TOLD else [f"&{target}[{size}]"]
        size += 0 if one is _TOLD else one.size
    inputs[0] = f"(missing == 1) ? NULL : {inputs[0]}"
    outputs[0] = f"(missing == 2) ? NULL : {outputs[0]}"
    arguments = [*inputs, *outputs, *["NULL"] * (_TOLD in row.outputs)]
    call = f"{prefix}_{row.name}(\n{2 * INDENT}" + f",\n{2 * INDENT}".join(arguments) + ");"
    lines = [f"{prefix}_transmission state;", "memset(&state, 0, sizeof state);", *kept] if state else []
    if narrow:
        rounded = [f"for (i = 0U; i < {place}U; ++i) {{", f"{INDENT}given[i] = ({real})in[i];", "}"]
        back = [
            f"for (i = 0U; (status == {prefix.upper()}_OK) && (i < {size}U); ++i) {{",
            f"{INDENT}out[i] = (double)found[i];",
            "}",
        ]
        declared = [f"{real} given[{place}], found[{size}];", f"{prefix}_status status;", "size_t i;"]
        lines = [*lines[:1], *declared, *rounded, *lines[1:], f"status = {call}", *back, "return status;"]
    else:
        lines.append(f"return {call}")
    head = f"static {prefix}_status run_{row.name}(const double *in, double *out, int missing)"
    return definition(head, lines)


def _follow(robot: ClosedLoopModel, prefix: str, functions: Sequence[Function]) -> str:
    """Return tables of a motion of the motors and the forces for it, and what tests them."""
    start = robot.regular_configuration
    home = np.array([joint_value(robot.model, name, start) for name in robot.actuated])
    time, phase = np.arange(_SAMPLES)[:, None] / _RATE, np.arange(len(home))
    w = 2 * np.pi * 2.0
    for swing in _SWING * 0.25 ** np.arange(6):  # shorter where the start is near the border of reach
        target = home + swing * (np.sin(w * time + phase) - np.sin(phase))
        rates = swing * w * np.cos(w * time + phase), -swing * w * w * np.sin(w * time + phase)
        states = robot.complete_batch(target, *rates, guess=start)
        if np.isfinite(states.q).all():
            break
    forces = robot.inverse_dynamics_batch(states.q, states.v, states.a).tau
    motion = next(function for function in functions if function.name == "motion")
    return fill(
        "loop_selftest_follow.in",
        prefix=prefix,
        PREFIX=prefix.upper(),
        start=number_table(f"home[1][{len(start)}]", start[None]),
        tables="\n\n".join(
            number_table(f"{name}[{_SAMPLES}][{len(home)}]", rows)
            for name, rows in zip(
                ("targets", "speeds", "accelerations", "torques"), (target, *rates, forces), strict=True
            )
        ),
        samples=str(_SAMPLES),
        motors=str(len(home)),
        dt=repr(1.0 / _RATE),
        tolerance=repr(_TOLERANCE),
        loads="NULL, " * (len(motion.inputs) - 3),
    )


def _observe(prefix: str, cases: Sequence[_Case], functions: Sequence[Function]) -> str:
    """Return a table of what an observer says at the states one after another, and what tests that."""
    (case,) = (one for one in cases if one.name == "momentum")
    (inputs,) = (one.inputs for one in functions if one.name == "momentum")
    free = inputs["v_independent"]
    lag = 2 * np.pi * _BANDWIDTH / _RATE
    observed = [np.zeros(free)]
    for before, now in pairwise(case.expected):
        seen = (now[:free] - before[:free]) * _RATE - (now[free:-free] + before[free:-free]) / 2 - now[-free:]
        observed.append(observed[-1] + lag / (1 + lag) * (seen - observed[-1]))
    return fill(
        "loop_selftest_observe.in",
        prefix=prefix,
        PREFIX=prefix.upper(),
        table=number_table(f"observed[{len(observed)}][{free}]", np.array(observed)),
        nq=str(inputs["q"]),
        free=str(free),
        dt=repr(1.0 / _RATE),
        bandwidth=repr(_BANDWIDTH),
        loads="NULL, " * (len(inputs) - 3),
    )


def _estimate(
    prefix: str, cases: Sequence[_Case], functions: Sequence[Function], compiled: CompiledLoop
) -> str:
    """Return tables of what an estimator says at the states one after another, and what tests that."""
    (case,) = (one for one in cases if one.name == "body_regressor")
    (inputs,) = (one.inputs for one in functions if one.name == "body_regressor")
    (design,) = (compiled.defaults[f"inertia_{joint}"] for joint in compiled.robot.inertias)
    motors, spread, found = case.sizes[1], payload_deviations(1.0, 0.1), UDFactors(10)
    R = case.expected[:, : 10 * motors].reshape(len(case.expected), motors, 10)
    noise = 0.1 * np.abs(R * spread).max() * np.linspace(1.0, 2.0, motors)
    more = spread * np.cos(np.arange(10)) / 2  # than the parameters before
    new, estimated, outliers = R @ more, list[FloatArray](), 0
    new[len(new) // 2] += 1e3 * noise.max()
    for rows, values in zip(R, new, strict=True):
        taken = found.sample((rows * spread).tolist(), values.tolist(), noise.tolist(), _FORGETTING, _GATE)
        outliers += not taken
        estimated.append(np.concatenate([spread * found.z, spread * found.deviations()]))
    tables = {
        "spread": spread[None],
        "noises": noise[None],
        "measured": new + case.expected[:, 10 * motors :] + R @ design,
        "estimated": np.array(estimated) + np.concatenate([design, np.zeros(10)]),
    }
    return fill(
        "loop_selftest_estimate.in",
        prefix=prefix,
        PREFIX=prefix.upper(),
        tables="\n\n".join(
            number_table(f"{name}[{len(rows)}][{rows.shape[1]}]", rows) for name, rows in tables.items()
        ),
        nq=str(inputs["q"]),
        free=str(inputs["v_independent"]),
        most=str(max(10, motors, inputs["q"])),
        forgetting=repr(_FORGETTING),
        gate=repr(_GATE),
        outliers=repr(float(outliers)),
        loads="NULL, " * (len(inputs) - 3),
    )


_STATUSES = (
    "OK",
    "NULL_POINTER",
    "NOT_FINITE",
    "SINGULAR",
    "OPEN",
    "INCONSISTENT",
    "BEYOND_LIMITS",
    "UNREACHED",
)
_METHODS = """
    /** Begins to follow a motion about at a configuration, whose loops it closes; returns a status. */
    start(q) {
        return this.#exports.start(this.#put(q));
    }
"""

_OBSERVER_METHODS = """
    /** Begins to observe forces anew. */
    startObserver() {
        this.#exports.start_observer();
    }
"""

_ESTIMATOR_METHODS = """
    /** Begins to estimate anew: standard deviations of ten parameters, and these, by default the design's. */
    startEstimator(deviations, parameters) {
        const given = parameters !== undefined, numbers = [...deviations, ...(given ? parameters : [])];
        if (numbers.length !== (given ? 20 : 10)) throw new TypeError("startEstimator: expected ten numbers");
        return this.#exports.start_estimator(given ? 1 : 0, this.#put(numbers));
    }
"""

_TRANSMISSION_METHODS = """
    /** Begins a transmission at a configuration, whose loops are closed, or where the robot's file has it. */
    startTransmission(q) {
        return this.#exports.start_transmission(q === undefined ? 0 : this.#put(q));
    }
"""


STEPS = 2  # of Newton's method, each time that a motion is followed
START_STEPS = 10  # of Newton's method, before a motion is followed
FOLLOWING = ("integrate", "step", "motion")  # the functions that following a motion is made of
_TEXTS = {
    "inverse_dynamics": "Forces of the motors and multipliers of the closures for a motion.",
    "hybrid_dynamics": "Forces of the motors for their accelerations, passive freedoms moving as they must.",
    "forward_dynamics": "Acceleration of the tree under forces of the motors.",
    "stabilised_hybrid_dynamics": "The same, for loops that drifted open, with Baumgarte's stabilisation.",
    "stabilised_forward_dynamics": "Acceleration of the tree, with Baumgarte's stabilisation of the loops.",
    "checked_inverse_dynamics": "Forces of the motors, and how far they are from the equation of motion.",
    "checked_hybrid_dynamics": "Forces of the motors for their accelerations, and how far they are likewise.",
    "checked_forward_dynamics": "Acceleration under forces of the motors, and how far it is likewise.",
    "completion": "Velocity and acceleration of the tree from those of the independent speeds, and why.",
    "flow": "Rates of a configuration and the independent speeds under forces of the motors.",
    "stabilised_flow": "Rates of configuration and velocity under forces, with Baumgarte's stabilisation.",
    "model_forces": "Forces of the motors for their accelerations, from the independent speeds.",
    "motion": "Velocity and acceleration of the tree, and forces, from those of the independent speeds.",
    "momentum": "Momentum along the independent coordinates, its rate without motors, and their forces.",
    "body_regressor": "What the motors' forces owe to the parameters of a body, row by row, and the rest.",
    "step": "One step of Newton's method for the dependent coordinates.",
    "integrate": "A configuration moved by a small velocity times time.",
    "tangent_of_forces": "Forces, and how they change along one direction of the independent motion.",
    "tangent_of_accelerations": "Accelerations, and how they change along one direction of state and forces.",
}


_CALLS = {
    "joint_to_actuator_forces": (
        "actuator",
        "forces",
        "Forces of the actuators with the power of those of the coordinates.",
    ),
    "actuator_to_joint_forces": (
        "joint",
        "forces",
        "Forces of the coordinates with the power of those of the actuators.",
    ),
    "joint_to_actuator_gains": (
        "actuator",
        "gains",
        "Gains of the actuators that act like those of the coordinates, which bear forces.",
    ),
    "actuator_to_joint_gains": (
        "joint",
        "gains",
        "Gains that those of the actuators, which bear forces, give the coordinates.",
    ),
    "joint_dynamics": (
        "joint",
        "dynamics",
        "Inertia of the whole, and forces for a motion, in the coordinates.",
    ),
    "actuator_dynamics": (
        "actuator",
        "dynamics",
        "Inertia of the whole, and forces for a motion, in the actuators.",
    ),
    "linkage_dynamics": (
        "bare",
        "dynamics",
        "The same in the coordinates, of all that their own joints' bodies are without.",
    ),
}
"""What maps forces and gains where a transmission is: its direction, its function there, what it gives."""
_SAME_TIME = ", nothing branches on numbers: every call of a function takes the same time."
_BOUNDED_TIME = f""".
 * Every call of a function takes the same time, but where positions are mapped: in at most {TRIES} pieces of
 * their way, of at most {STEPS_OF_PIECE} steps of Newton's method each."""
_OTHER = {"joint": "actuator", "actuator": "joint"}  # side of a transmission
_MAPS = {
    "joint": "Motion of the actuators for one of the coordinates, at rest where it is NULL; moves on there.",
    "actuator": "Motion of the coordinates for one of the actuators, likewise.",
}


_RATES = ("position", "velocity", "acceleration")


class _CudaFunction(NamedTuple):
    """A function in CUDA C++, with the sizes of what it takes and gives by name."""

    name: str
    inputs: Mapping[str, int]
    outputs: Mapping[str, int]

    def row(self) -> str:
        """Return what a comment says of it."""
        given, found = (
            [name if size == 1 else f"{name} ({size})" for name, size in sizes.items() if size]
            for sizes in (self.inputs, self.outputs)
        )
        return "\n".join(
            _wrapped(f"{self.name}: ", [*given[:-1], f"{given[-1]} -> {found[0]}", *found[1:]], 110)
        )

    def called(self, macro: str) -> str:
        """Return what makes it a kernel, and a function of the host."""
        return f"{macro}({self.name}, {sum(self.inputs.values())}, {sum(self.outputs.values())})"


class TransmissionPrinter:
    """The parts of a robot's C that map between coordinates and actuators."""

    def __init__(
        self, transmission: Transmission[ClosedLoopModel], prefix: str, precision: Precision
    ) -> None:
        self.transmission, self._p, self._P = transmission, prefix, prefix.upper()
        self._precision, single = precision, precision is SINGLE
        self._n, self._nq = len(transmission.coordinates), transmission.robot.model.nq
        self._calls = {
            name: replace(getattr(transmission, side).function(kind), name=name)
            for name, (side, kind, _) in _CALLS.items()
        }
        kinds = {kind: f"single_{kind}" if single and kind == "motion" else kind for kind in MAPS}
        self._steps = {
            name: replace(getattr(transmission, side).function(kinds[kind]), name=name)
            for side in _MAPS
            for kind in MAPS
            for name in [f"{side}_{kind}"]
        }
        self.functions = [*self._steps.values(), *self._calls.values()]

    def declarations(self) -> str:
        """Return the struct, and what works with it."""
        maps = [f"/** {text} */\n{self._map_head(side)};\n" for side, text in _MAPS.items()]
        maps += [f"/** {text} */\n{self._call_head(name)};\n" for name, (*_, text) in _CALLS.items()]
        sides = self.transmission.coordinates, self.transmission.actuators
        names = dict(zip(("coordinates", "actuators"), (", ".join(side) for side in sides), strict=True))
        return fill("loop_transmission_header.in", **self._shared, **names, maps="\n".join(maps))

    @property
    def _shared(self) -> dict[str, str]:
        return {"prefix": self._p, "PREFIX": self._P, "n": str(self._n), "nq": str(self._nq)}

    @property
    def _rounding(self) -> float:
        return 32.0 * self._precision.epsilon if self._precision is SINGLE else 0.0

    def _reaching(self, side: str, **statuses: str) -> str:
        text = mapping_text(self.transmission, side, self._rounding)
        return core_of("transmission.in", **text, **statuses, compute="compute_", one="")

    def cuda(self) -> tuple[str, list[_CudaFunction]]:
        """Return what maps positions on a GPU, and rows of its functions."""
        n, nq, rows = self._n, self._nq, list[_CudaFunction]()
        texts = [self._reaching(side, unreached="1", singular="2") for side in _MAPS]
        for side, other in _OTHER.items():
            outputs = {"status": 1, "q_out": nq, "position_out": n, **self._steps[f"{side}_motion"].outputs}
            inputs = {"q": nq, "position_before": n, **dict.fromkeys(_RATES, n)}
            results = str(len(self._steps[f"{side}_motion"].results))
            more = {"nq": str(nq), "n": str(n), "results": results}
            texts.append(fill("loop_cuda_map.in", side=side, other=other, **more))
            rows.append(_CudaFunction(f"{side}_to_{other}", inputs, outputs))
        return "\n".join(texts), rows

    def definitions(self) -> str:
        """Return the functions."""
        step = self._steps["joint_motion"]
        shared = {**self._shared, "results": str(len(step.results))}
        statuses = {"unreached": f"{self._P}_UNREACHED", "singular": f"{self._P}_SINGULAR"}
        maps = [self._reaching(side, **statuses) for side in _MAPS]
        maps += [
            fill("loop_map.in", **shared, head=self._map_head(side), side=side, other=other)
            for side, other in _OTHER.items()
        ]
        model, actuators = self.transmission.robot.model, list(self.transmission.actuator.followed)
        least, endless = self._precision.least, self._precision.largest
        upper = np.clip(np.array(model.upperEffortLimit)[actuators], least, endless).tolist()
        lower = np.clip(np.array(model.lowerEffortLimit)[actuators], -endless, -least).tolist()
        own = fill(
            "loop_transmission.in",
            **shared,
            upper=", ".join(map(repr, upper)),
            lower=", ".join(map(repr, lower)),
            inputs=str(len(step.symbols)),
            closed=repr(step.closed),
            least=repr(step.least_margin),
            home=", ".join(map(repr, self.transmission.home.tolist())),
            maps="\n".join(maps),
        )
        return "\n".join([*map(self._call, _CALLS), own])

    def rows(self) -> list[str]:
        """Return what the README has of them."""
        rows = [
            f"| `{self._p}_{side}_to_{_OTHER[side]}` | {self._steps[f'{side}_motion'].operations} | {text} |"
            for side, text in _MAPS.items()
        ]
        rows += [
            f"| `{self._p}_{name}` | {self._calls[name].operations} | {text} |"
            for name, (*_, text) in _CALLS.items()
        ]
        return rows

    def exported(self) -> list[Exported]:
        """Return what WebAssembly has of them."""
        rows = [*map(self._map_row, _MAPS), *map(self._call_row, _CALLS)]
        return [Exported(row, "&transmission") for row in rows]

    def cases(self, configurations: Sequence[FloatArray]) -> list[_Case]:
        """Return what the self-test calls at closed configurations, of which it moves a little."""
        found = [self._map_case(side, configurations) for side in _MAPS]
        for name, function in self._calls.items():
            rows = np.array(
                [
                    np.concatenate([q, 10.0 * np.cos(np.arange(len(function.symbols) - self._nq) + i)])
                    for i, q in enumerate(configurations)
                ]
            )
            sizes = [one.size for one in self._call_row(name).outputs[:-1]]
            expected = np.array([function.on_arrays(*row)[: sum(sizes)] for row in rows], dtype=float)
            rounded = self._rounded(function, rows, expected, sizes)
            run = _run(self._p, self._call_row(name), self._precision, [("q", self._nq)])
            found.append(_Case(name, rows, expected, sizes, len(function.results), run, rounded))
        return found

    def _rounded(
        self, function: Function, rows: FloatArray, expected: FloatArray, sizes: Sequence[int], at: int = 0
    ) -> float:
        """Return the largest error, of the largest entry of a group of results, in single precision."""
        if self._precision is not SINGLE:
            return 0.0
        worst = float(self._precision.epsilon)
        for row, wanted in zip(rows, expected, strict=True):
            values = np.array(function.on_arrays(*row.astype(np.float32)), dtype=float)
            for size, stop in zip(sizes, np.cumsum(sizes), strict=True):
                group = slice(int(stop) - size, int(stop))
                off = np.abs(values[group] - wanted[at:][group]).max(initial=0.0)
                worst = max(worst, float(off / np.abs(wanted[at:][group]).max(initial=1e-300)))
        return worst

    def _map_case(self, side: str, configurations: Sequence[FloatArray]) -> _Case:
        """Return a direction, whose results are those of the general layer."""
        robot, n, given, expected, closed = self.transmission.robot, self._n, [], [], []
        one, values = getattr(self.transmission, side), self.transmission.positions
        for i, q in enumerate(configurations):
            start = values(side, q)
            rates = [1.0 + 0.5 * np.cos(np.arange(n) - i), 1.0 + 0.5 * np.sin(np.arange(n) + i)]
            for share in (1.0, -1.0, 0.1, -0.1, 0.0):  # near where the way ends, back or not at all
                moved = start + share * 0.02 * np.cos(np.arange(n) + i)
                try:
                    target = dict(zip(one.names, moved.tolist(), strict=True))
                    state = robot.complete(target, rates[0], rates[1], guess=q)
                except P3dofError:
                    continue
                break
            else:
                raise ModelError("coordinates: no motion of them was found to test the code with")
            motion = [x[list(one.others)] for x in (state.v, state.a)]
            given.append(np.concatenate([q, values("joint", q), values("actuator", q), moved, *rates]))
            closed.append(state.q)
            expected.append(np.concatenate([values(_OTHER[side], state.q), *motion]))
        fields = [("q", self._nq), ("joint", n), ("actuator", n)]
        run = _run(self._p, self._map_row(side), self._precision, fields)
        close, step, results = self._steps[f"{side}_close"], self._steps[f"{side}_motion"], np.array(expected)
        for _ in range(3 if self._precision is SINGLE else 0):  # as near as its roundings let it come
            closed = [np.array(close.on_arrays(*q.astype(np.float32))[: self._nq], float) for q in closed]
        rows = np.array([np.concatenate([q, row[-2 * n :]]) for q, row in zip(closed, given, strict=True)])
        rounded = self._rounded(step, rows, results, [n, n], at=n)
        return _Case(self._map_row(side).name, np.array(given), results, [n] * 3, 3 * n, run, rounded)

    def _map_head(self, side: str) -> str:
        return self._map_row(side).head(self._p, [f"{self._p}_transmission *state"], 110)

    def _map_row(self, side: str) -> Prototype:
        n = (self._n,)
        given = tuple(Argument(name, shape=n, optional=name != "position") for name in _RATES)
        found = tuple(Argument(f"{one.name}_out", shape=n) for one in given)
        return Prototype(f"{side}_to_{_OTHER[side]}", given, (*found, _TOLD))

    def _call_row(self, name: str) -> Prototype:
        function = self._calls[name]
        optional = {"velocity", "acceleration", "gravity", *["forces"] * ("stiffness" in function.inputs)}
        words = {"v": "velocity", "a": "acceleration"}
        taken = [(words.get(one, one), size) for one, size in function.inputs.items() if one != "q"]
        given = tuple(Argument(one, shape=(size,), optional=one in optional) for one, size in taken)
        clash = {one for one, _ in taken}
        found = tuple(
            Argument(f"{one}_out" if one in clash else one, shape=(size,))
            for one, size in function.outputs.items()
            if one not in EVIDENCE
        )
        return Prototype(name, given, (*found, _TOLD))

    def _call_head(self, name: str) -> str:
        return self._call_row(name).head(self._p, [f"const {self._p}_transmission *state"], 110)

    def _call(self, name: str) -> str:
        function, row, P = self._calls[name], self._call_row(name), self._P
        size, place = len(function.results), self._nq
        lines = [f"double given[{len(function.symbols)}], found[{size}];", f"{self._p}_status status;"]
        lines += leave(" || ".join(f"({one} == NULL)" for one in ["state", *row.needed]), f"{P}_NULL_POINTER")
        lines += ["memset(given, 0, sizeof given);", f"copy(given, state->q, {place}U);"]
        for one in row.inputs:
            copied = f"copy(&given[{place}], {one.name}, {one.size}U);"
            if one.name == "gravity":
                lines += _or_usual(place, one.name, self.transmission.robot.model.gravity.linear)
            elif one.optional:
                lines += [f"if ({one.name} != NULL) {{", f"{INDENT}{copied}", "}"]
            else:
                lines.append(copied)
            place += one.size
        lines += leave(f"!all_finite(given, {place}U)", f"{P}_NOT_FINITE")
        lines.append(f"compute_{name}(given, found);")
        numbers = f"{function.closed!r}, {function.least_margin!r}"
        lines.append(f"status = judged(found, {size}U, {numbers}, evidence);")
        lines += leave(f"status != {P}_OK", "status")
        place = 0
        for one in row.outputs[:-1]:
            lines.append(f"copy({one.name}, &found[{place}], {one.size}U);")
            place += one.size
        return definition(self._call_head(name), [*lines, f"return {P}_OK;"])


class LoopPrinter:
    """The parts of a robot's C that its functions make."""

    def __init__(
        self,
        robot: ClosedLoopModel,
        compiled: CompiledLoop,
        prefix: str,
        functions: Sequence[Function],
        note: str,
        transmission: Transmission[ClosedLoopModel] | None = None,
        precision: Precision = DOUBLE,
    ) -> None:
        self.robot, self.compiled, self.prefix, self.functions = robot, compiled, prefix, functions
        self.note, self.precision = note, precision
        self.maps = None if transmission is None else TransmissionPrinter(transmission, prefix, precision)
        names = {function.name for function in functions}
        self.follows = compiled.determined and names >= set(FOLLOWING)
        self.observes = "momentum" in names
        self.estimates = "body_regressor" in names and compiled.hybrid

    @property
    def _shared(self) -> dict[str, str]:
        robot, tree = self.robot, self.compiled
        return {
            "note": self.note,
            "robot": str(robot.model.name) or "without a name",
            "prefix": self.prefix,
            "PREFIX": self.prefix.upper(),
            "nq": str(robot.model.nq),
            "nv": str(robot.model.nv),
            "motors": str(len(robot.actuated)),
            "free": str(len(tree.independent)),
            "margin": f"{MARGIN!r} ({MARGIN_OF_STATES!r} of accelerations and derivatives)",
        }

    def header(self) -> str:
        """Return the header, with units and orders."""
        declared = [self._declared(function) for function in self.functions]
        if self.follows:
            declared.append(self._follow_declared())
        if self.observes:
            declared.append(self._observe_declared())
        if self.estimates:
            declared.append(self._estimate_declared())
        if self.maps is not None:
            declared.append(self.maps.declarations())
        shared = self._shared
        told = "\n".join(f" * {line}".rstrip() for line in self._orders())
        time = _SAME_TIME if self.maps is None else _BOUNDED_TIME
        text = fill("loop_header.in", **shared, told=told, time=time, declarations="\n".join(declared))
        return self.precision.code(text)

    def source(self) -> str:
        """Return the functions."""
        printed = [*self.functions, *(self.maps.functions if self.maps is not None else ())]
        used = {f.tape.operations[i].name for f in printed for i in f.tape.needed(f.results)}
        computed = "\n\n".join(_computation(function) for function in printed)
        calls = [self._call(function) for function in self.functions]
        if self.follows:
            calls.append(self._following())
        if self.observes:
            calls.append(self._observing())
        if self.estimates:
            calls.append(self._estimating())
        if self.maps is not None:
            calls.append(self.maps.definitions())
        single = self.precision is SINGLE
        narrow = fill("sine_cosine_float.in").replace("sine_cosine(", "sincos_one(") if single else wave()
        text = fill(
            "loop_source.in",
            **self._shared,
            wave=narrow if used & {"sin", "cos"} else "",
            suffix="f" if single else "",
            computations=computed,
            functions="\n".join(calls).rstrip(),
            **_position_limits(self.robot, self.precision.largest),
        )
        return self.precision.code(text)

    def cuda(self) -> str:
        """Return the functions for a GPU."""
        printed = [*self.functions, *(self.maps.functions if self.maps is not None else ())]
        code = "\n\n".join(_computation(function) for function in printed)
        rows = [_CudaFunction(one.name, one.inputs, one.outputs) for one in printed]
        if self.maps is not None:
            text, maps = self.maps.cuda()
            code, rows = f"{code}\n\n{text}", [*rows, *maps]
        return fill(
            "loop_cuda.in",
            **self._shared,
            told="\n".join(f" * {line}".rstrip() for line in self._orders()),
            rows="\n".join(f" * {line}" for one in rows for line in one.row().splitlines()),
            computations=re.sub(r"^static (void|int) ", r"static __device__ \1 ", code, flags=re.MULTILINE),
            functions="\n".join(one.called(f"{self.prefix.upper()}_CUDA_FUNCTION") for one in rows),
        )

    def web(self) -> WebModule:
        """Return what the WebAssembly offers."""
        functions = [Exported(self.row(function)) for function in self.functions]
        state = methods = ""
        if self.follows:
            model = self.robot.model
            kept = {"q": model.nq, "v": model.nv, "a": model.nv}
            arguments = tuple(Argument(name, shape=(size,)) for name, size in kept.items())
            functions.append(Exported(self._follow_row, "&state", arguments))
            state, methods = fill("wasm_state.in", prefix=self.prefix), _METHODS
        if self.observes:
            functions.append(Exported(self._observe_row, "&observer"))
            state += fill("wasm_observer.in", prefix=self.prefix)
            methods += _OBSERVER_METHODS
        if self.estimates:
            functions.append(Exported(self._estimate_row, "&estimator"))
            state += fill("wasm_estimator.in", prefix=self.prefix)
            methods += _ESTIMATOR_METHODS
        if self.maps is not None:
            functions += self.maps.exported()
            state += fill("wasm_transmission.in", prefix=self.prefix)
            methods += _TRANSMISSION_METHODS
        return WebModule(self.prefix, self.note, functions, dict(enumerate(_STATUSES)), state, methods)

    def readme(self) -> str:
        """Return what a reader has to know of the code."""
        rows = [f"| `{self.prefix}_{f.name}` | {f.operations} | {_TEXTS[f.name]} |" for f in self.functions]
        if self.follows:
            text = (
                f"Start at a configuration, and follow a motion of the motors, {STEPS} steps of Newton each."
            )
            rows.append(f"| `{self.prefix}_start`, `{self.prefix}_follow` | | {text} |")
        if self.observes:
            text = "External forces, as of a contact, from the motion and the motors' forces."
            rows.append(f"| `{self.prefix}_observer_start`, `{self.prefix}_observe` | | {text} |")
        if self.estimates:
            text = "Inertial parameters of a body, as with a payload, sample by sample."
            rows.append(f"| `{self.prefix}_estimator_start`, `{self.prefix}_estimate` | | {text} |")
        if self.maps is not None:
            rows += self.maps.rows()
        robot, q = self.robot, self.robot.assemble().q
        return fill(
            "loop_readme.in",
            **self._shared,
            orders="\n".join(f"* {line}" for line in self._orders(width=10_000)),
            rank=str(robot.rank(q)),
            mobility=str(robot.mobility(q)),
            rows="\n".join(rows),
        )

    def _orders(self, width: int = 106) -> list[str]:
        model, robot = self.robot.model, self.robot
        joints = [
            f"{model.names[i]} ({'q' if model.nqs[i] == 1 else f'{model.nqs[i]} of q'})"
            for i in range(1, model.njoints)
        ]
        motors = [
            f"{name} [{force}]"
            for name, (_, force) in zip(robot.actuated, units_of_actuated(robot), strict=True)
        ]
        return [
            *_wrapped("q and v by joint, in this order [m, rad, m/s, rad/s]: ", joints, width),
            *_wrapped("motors: ", motors, width),
            *_wrapped("independent speeds: ", self.compiled.independent, width),
            "quaternions are x, y, z, w; joints that turn without end have cosine and sine in q;",
            "wrenches are force [N] and moment [N m] in world axes at the frame's origin;",
            "joint_forces are beside those of the motors, in the order of v [N, N m];",
            *_wrapped("inertia_... of a joint's body, at the joint's origin in its axes: ", _TEN, width),
            "lambda_ by closure, then coupling: on the second frame's body, in axes of the first [N, N m].",
        ]

    def row(self, function: Function) -> Prototype:
        """Return the row of a function in the table."""
        inputs = _inputs(function.inputs.items())
        outputs = [(name, size) for name, size in function.outputs.items() if size and name not in EVIDENCE]
        taken = {one.name for one in inputs}
        names = [f"{name}_out" if name in taken else name for name, _ in outputs]
        found = [Argument(name, shape=(size,)) for name, (_, size) in zip(names, outputs, strict=True)]
        told = [_TOLD] * ("margin" in function.outputs)
        return Prototype(function.name, inputs, (*found, *told))

    @cached_property
    def _follow_row(self) -> Prototype:
        motors, motion = (len(self.robot.actuated),), self._function("motion")
        wanted = (Argument(name, shape=motors) for name in ("target", "velocity", "acceleration"))
        loads = _inputs(list(motion.inputs.items())[3:])
        inputs = (Argument("dt", shape=(1,), kind="number"), *wanted, *loads)
        return Prototype("follow", inputs, (Argument("tau", shape=motors), _TOLD))

    def _head(self, row: Prototype, *first: str) -> str:
        return row.head(self.prefix, first, 110)

    def _declared(self, function: Function) -> str:
        return f"{_comment(_TEXTS[function.name], function)}\n{self._head(self.row(function))};\n"

    def _call(self, function: Function) -> str:
        """Return a function that checks its arguments, computes, and copies what came out."""
        P, size, row = self.prefix.upper(), len(function.results), self.row(function)
        lines = [f"double given[{len(function.symbols)}], found[{size}];"]
        lines += leave(" || ".join(f"({name} == NULL)" for name in row.needed), f"{P}_NULL_POINTER")
        lines += self._given(function, 0)
        lines += leave(f"!all_finite(given, {len(function.symbols)}U)", f"{P}_NOT_FINITE")
        lines.append(f"compute_{function.name}(given, found);")
        if _TOLD in row.outputs:
            numbers = f"{function.closed!r}, {function.least_margin!r}"
            judged = f"const {self.prefix}_status status = judged(found, {size}U, {numbers}, evidence);"
            inner = [judged, *leave(f"status != {P}_OK", "status")]
            lines += ["{", *indented(inner), "}"]
        else:
            lines += leave(f"!all_finite(found, {size}U)", f"{P}_NOT_FINITE")
        place, outputs = 0, iter(row.outputs)
        for group, count in function.outputs.items():
            if count and group not in EVIDENCE:
                lines.append(f"copy({next(outputs).name}, &found[{place}], {count}U);")
            place += count
        return definition(self._head(row), [*lines, f"return {P}_OK;"])

    def _loads(self, function: Function) -> str:
        lines = self._given(function, sum(list(function.inputs.values())[:3]))  # behind the motion
        return "".join(f"\n{INDENT}{line}" for line in lines)

    def _given(self, function: Function, start: int) -> list[str]:
        """Return the statements that gather inputs from a place on; those that are missing have defaults."""
        lines, place = [], 0
        for group, count in function.inputs.items():
            name = _identifier(group)
            if place >= start and count:
                if _optional(name):
                    lines += _or_usual(place, name, self.compiled.defaults[group])
                else:
                    lines.append(f"copy(&given[{place}], {name}, {count}U);")
            place += count
        return lines

    def _follow_head(self) -> str:
        return self._head(self._follow_row, f"{self.prefix}_state *state")

    def _follow_declared(self) -> str:
        p, P = self.prefix, self.prefix.upper()
        return (
            "/** Where a motion that is followed has come to; zero velocity at the start. */\n"
            f"typedef struct {{\n{INDENT}double q[{P}_NQ], v[{P}_NV], a[{P}_NV];\n}} {p}_state;\n\n"
            "/** Begin about at a configuration: its loops are closed; the motors' values stay. */\n"
            f"{p}_status {p}_start({p}_state *state, const double q[{P}_NQ]);\n\n"
            f"{_comment(_FOLLOW, self._function('motion'))}\n{self._follow_head()};\n"
        )

    def _following(self) -> str:
        motion, step = self._function("motion"), self._function("step")
        places = self.compiled.follow_places()
        needed = ["state", *self._follow_row.needed]
        return fill(
            "loop_follow.in",
            **self._shared,
            head=self._follow_head(),
            nulls=" || ".join(f"({name} == NULL)" for name in needed),
            steps=str(STEPS),
            start_steps=str(START_STEPS),
            step_closed=repr(step.closed),
            motion_closed=repr(motion.closed),
            least=repr(motion.least_margin),
            step_results=str(len(step.results)),
            motion_inputs=str(len(motion.symbols)),
            motion_results=str(len(motion.results)),
            places=", ".join(str(place) for place, _, _ in places),
            circles=", ".join(str(int(circle)) for _, circle, _ in places),
            order=", ".join(str(motor) for _, _, motor in places),
            loads=self._loads(motion),
        )

    @cached_property
    def _observe_row(self) -> Prototype:
        momentum = self._function("momentum")
        free = (len(self.compiled.independent),)
        numbers = (Argument(name, shape=(1,), kind="number") for name in ("dt", "bandwidth"))
        threshold = Argument("threshold", shape=free, optional=True)
        found = (Argument("external", shape=free), Argument("share", shape=(1,)), _TOLD)
        return Prototype("observe", (*numbers, *_inputs(momentum.inputs.items()), threshold), found)

    def _observe_head(self) -> str:
        return self._head(self._observe_row, f"{self.prefix}_observer *observer")

    def _observe_declared(self) -> str:
        p, P = self.prefix, self.prefix.upper()
        return (
            "/** What an observer of forces keeps; all zero at the start. */\n"
            f"typedef struct {{\n{INDENT}double momentum[{P}_INDEPENDENT], rate[{P}_INDEPENDENT], "
            f"external[{P}_INDEPENDENT];\n{INDENT}int begun;\n}} {p}_observer;\n\n"
            "/** Begin anew: the next sample is the first. */\n"
            f"void {p}_observer_start({p}_observer *observer);\n\n"
            f"{_comment(_OBSERVE, self._function('momentum'))}\n{self._observe_head()};\n"
        )

    def _observing(self) -> str:
        momentum = self._function("momentum")
        return fill(
            "loop_observe.in",
            **self._shared,
            head=self._observe_head(),
            nulls=" || ".join(f"({name} == NULL)" for name in ["observer", *self._observe_row.needed]),
            inputs=str(len(momentum.symbols)),
            results=str(len(momentum.results)),
            closed=repr(momentum.closed),
            least=repr(momentum.least_margin),
            loads=self._loads(momentum),
        )

    @cached_property
    def _estimate_row(self) -> Prototype:
        motors, regressor = (len(self.robot.actuated),), self._function("body_regressor")
        given = _inputs(regressor.inputs.items())
        numbers = (Argument(name, shape=(1,), kind="number") for name in ("forgetting", "gate"))
        noise, tau = Argument("noise", shape=motors), Argument("tau", shape=motors)
        found = (Argument(name, shape=(10,)) for name in ("parameters", "deviations"))
        outliers = Argument("outliers", shape=(1,))
        inputs = (*numbers, noise, *given[:3], tau, *given[3:])
        return Prototype("estimate", inputs, (*found, outliers, _TOLD))

    def _estimate_head(self) -> str:
        return self._head(self._estimate_row, f"{self.prefix}_estimator *estimator")

    def _estimate_declared(self) -> str:
        (joint,) = self.compiled.robot.inertias
        comment = _comment(_ESTIMATE, self._function("body_regressor"))
        head = self._estimate_head()
        return fill("loop_estimator_header.in", prefix=self.prefix, joint=joint, comment=comment, head=head)

    def _estimating(self) -> str:
        regressor = self._function("body_regressor")
        (joint,) = self.compiled.robot.inertias
        return fill(
            "loop_estimate.in",
            **self._shared,
            head=self._estimate_head(),
            nulls=" || ".join(f"({name} == NULL)" for name in ["estimator", *self._estimate_row.needed]),
            design=", ".join(map(repr, self.compiled.defaults[f"inertia_{joint}"].tolist())),
            inputs=str(len(regressor.symbols)),
            results=str(len(regressor.results)),
            closed=repr(regressor.closed),
            least=repr(regressor.least_margin),
            loads=self._loads(regressor),
        )

    def _function(self, name: str) -> Function:
        return next(function for function in self.functions if function.name == name)


_TEN = "mass [kg]", "first moments x, y, z [kg m]", "moments of inertia xx, xy, yy, xz, yz, zz [kg m^2]"
_OPTIONAL = "Wrenches, other forces and inertias may be NULL: none, and those that the robot has."
_OBSERVE = """External forces along the independent coordinates, as of a contact or an unknown payload.
 *
 *  dt [s] after the last sample, 0 to begin anew; bandwidth [Hz] of the lag of first order behind which they
 *  are seen; tau: of the motors since the last sample. share: largest of them in its threshold, above 1
 *  in contact; 0 where threshold, which is positive, is NULL."""
_ESTIMATE = """The body's inertial parameters and their standard deviations after one more sample.
 *
 *  forgetting: by what the weight of older samples is multiplied, above 0; 1 forgets none. gate: how many
 *  standard deviations a force may be off before its sample is left out; 0: none is. noise: standard
 *  deviations of the forces. tau: of the motors now. outliers: samples left out so far."""
_FOLLOW = "Forces of the motors for their values and rates, dt [s] after the last call; 0 the first time."


_TOLD = Argument("evidence", shape=(2,), kind="struct")  # margin and gap


def _inputs(groups: Iterable[tuple[str, int]]) -> tuple[Argument, ...]:
    """Return the arguments of groups of inputs that are not empty."""
    return tuple(
        Argument(_identifier(name), shape=(size,), optional=_optional(name)) for name, size in groups if size
    )


def _comment(words: str, function: Function) -> str:
    """Return what a function is for, in a comment."""
    more = [_OPTIONAL] if any(map(_optional, function.inputs)) else []
    return "\n".join([f"/** {words}", *(f" *  {line}" for line in more)]) + " */"


def _or_usual(place: int, name: str, usual: FloatArray) -> list[str]:
    """Return statements that gather an input, or what it is where it is NULL."""
    return [
        "{",
        f"{INDENT}static const double usual[] = {{{', '.join(repr(float(x)) for x in usual)}}};",
        f"{INDENT}copy(&given[{place}], ({name} != NULL) ? {name} : usual, {len(usual)}U);",
        "}",
    ]


def _optional(name: str) -> bool:
    return name.startswith(("wrench_", "joint_forces", "inertia_"))


def _identifier(name: str) -> str:
    """Return a name as C has it."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _computation(function: Function) -> str:
    head = f"static void compute_{function.name}(const double *in, double *out)"
    zero = f"{INDENT}const double zero = 0.0;\n{INDENT}(void)zero;\n{INDENT}(void)in;"
    return f"{head}\n{{\n{zero}\n{body(function, 'double', '_one')}\n}}"


def _wrapped(head: str, parts: Sequence[str], width: int) -> list[str]:
    lines = [head]
    for i, part in enumerate(parts):
        piece = part + (", " if i < len(parts) - 1 else "")
        if len(lines[-1]) + len(piece) > width:
            lines.append("  ")
        lines[-1] += piece
    return [line.rstrip() for line in lines]


def _position_limits(robot: ClosedLoopModel, endless: float) -> dict[str, str]:
    """Return the limits of q as C has them, for the joints with one coordinate."""
    known = Limits(robot.model)
    lower, upper = np.full(robot.model.nq, -endless), np.full(robot.model.nq, endless)
    lower[known.q] = np.clip(known.lower, -endless, endless)
    upper[known.q] = np.clip(known.upper, -endless, endless)
    return {
        name: ", ".join(repr(float(end)) for end in ends)
        for name, ends in (("lower", lower), ("upper", upper))
    }


MARK = "Generated by `p3dof loop codegen"  # what stands near the beginning of every generated file


@dataclass(frozen=True, eq=False)
class LoopCode:
    """What is written for a robot."""

    files: dict[str, str]  # text by file name
    operations: dict[str, int]  # by function
    web: WebModule  # what its WebAssembly offers
    left_out: str  # what is usual but not there, and why


def loop_files(
    robot: ClosedLoopModel,
    prefix: str | None = None,
    functions: Iterable[str] | None = None,
    external: Iterable[str] = (),
    joint_forces: bool = False,
    inertias: Iterable[str] = (),
    command: str = "",
    cpu: str = CPU,
    coordinates: Iterable[str] | None = None,
    actuators: Iterable[str] | None = None,
    precision: str = "double",
    observer: bool = False,
    cuda: bool = False,
    estimator: bool = False,
    transmission: Transmission[ClosedLoopModel] | None = None,
) -> LoopCode:
    """Return the C of a robot's dynamics; with coordinates, that of their linkage and its transmission.

    Who has made that transmission before may give it instead, by NumPy and of the robot as it is.
    """
    if not robot.model.nv:
        raise ModelError("robot: expected one with joints, this one has none: nothing moves")
    if coordinates is not None:
        transmission = robot.transmission(coordinates, actuators, "numpy")
    if transmission is not None:
        robot = transmission.robot
    kind = precision_of(precision)
    if kind is SINGLE and (transmission is None or functions is not None or observer or estimator):
        raise InputError("float: single precision is for --coordinates alone, without other functions")
    if kind is SINGLE and cuda:
        raise InputError("float: CUDA C++ computes with doubles, leave out --cuda")
    if transmission is None and actuators is not None:
        raise InputError("actuators: expected coordinates, too, whose actuators they are")
    compiled = robot.compile(external=external, joint_forces=joint_forces, inertias=inertias, level="numpy")
    name = _prefix(robot, prefix)
    if estimator and len(compiled.robot.inertias) != 1:
        count = len(compiled.robot.inertias)
        raise InputError(f"estimator: expected one inertia, of the body that is estimated, got {count}")
    if estimator and not compiled.hybrid:
        raise ModelError(
            f"estimator: the motion does not determine the forces of {len(robot.actuated)} actuators"
        )
    wanted = [] if transmission is not None and functions is None else _chosen(compiled, functions)
    more = [*["momentum"] * observer, *["body_regressor"] * estimator]
    chosen = [compiled.function(one) for one in dict.fromkeys([*wanted, *more])]
    note = origin(command or f"{MARK.split('`')[1]} --prefix {name}", f"robot {_fingerprint(robot)}", MARK)
    printer = LoopPrinter(robot, compiled, name, chosen, note, transmission, kind)
    c = {
        f"{name}.h": printer.header(),
        f"{name}.c": printer.source(),
        f"{name}_selftest.c": fill(
            "loop_selftest.in", note=note, **selftest(robot, compiled, printer, chosen)
        ),
    }
    if cuda:
        c[f"{name}_cuda.cu"] = printer.cuda()
    texts = with_build(c, note, name, cpu) | {"README.md": printer.readme()}
    told = ""
    if functions is None and transmission is None and not compiled.determined:
        why = "leaves joints free" if compiled.hybrid else "does not determine the forces of all motors"
        names = "motion, step, integrate, " * compiled.hybrid + f"{name}_start and {name}_follow"
        told = f"Left out: {names}: the motion of the motors {why}."
    every = [*chosen, *(printer.maps.functions if printer.maps is not None else ())]
    return LoopCode(texts, {one.name: one.operations for one in every}, printer.web(), told)


def _prefix(robot: ClosedLoopModel, prefix: str | None) -> str:
    if prefix is not None:
        return checked_prefix(prefix)
    name = re.sub(r"[^a-z0-9]+", "_", str(robot.model.name).lower()).strip("_")[:40]
    try:
        return checked_prefix(name)
    except InputError:
        return "loop"


def _fingerprint(robot: ClosedLoopModel) -> str:
    """Return what tells the robot from another: its tree, what closes it, what acts in its joints."""
    model = robot.model
    bodies = [[Y.mass, Y.lever, Y.inertia] for Y in model.inertias]
    joints = [str(joint) for joint in model.joints]
    placements = list(model.jointPlacements)
    return fingerprint(
        [*model.names], [*model.parents], joints, placements, bodies, model.gravity.linear, robot.sidecar
    )


def _chosen(compiled: CompiledLoop, functions: Iterable[str] | None) -> list[str]:
    if functions is None:
        usual = ["inverse_dynamics", "forward_dynamics"]
        if compiled.determined:
            return [*usual, *FOLLOWING]
        return [*usual, *(["hybrid_dynamics"] if compiled.hybrid else FOLLOWING)]
    found = list(dict.fromkeys(functions))
    for name in found:
        if name not in FUNCTIONS:
            raise InputError(f"functions: expected some of {', '.join(FUNCTIONS)}, got {shown(name)}")
    if not found:
        raise InputError("functions: expected at least one")
    return found
