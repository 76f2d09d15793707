"""What is written of each function of a robot: its head, its body, and the files around them."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence

import numpy as np

from p3dof.codegen.filling import fill
from p3dof.codegen.waves import wave
from p3dof.codegen.web_loops import evidence, loop_module
from p3dof.codegen.webassembly import Rows, WebModule
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiled.function import Function
from p3dof.loops.compiled.limits import EVIDENCE, MARGIN, MARGIN_OF_STATES
from p3dof.loops.compiled.printing import body
from p3dof.loops.tables import units_of_actuated
from p3dof.loops.trust import Limits

STEPS = 2
"""Of Newton's method, each time that a motion is followed."""
START_STEPS = 10
"""Of Newton's method, before a motion is followed."""
FOLLOWING = ("integrate", "step", "motion")
"""The functions that following a motion is made of."""
_INDENT = " " * 4
_TEXTS = {
    "inverse_dynamics": "Forces of the motors and multipliers of the closures for a motion.",
    "hybrid_dynamics": "Forces of the motors for their accelerations, while idle freedoms move as they must.",
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
    "step": "One step of Newton's method for the dependent coordinates.",
    "integrate": "A configuration moved by a small velocity times time.",
    "tangent_of_forces": "Forces, and how they change along one direction of the independent motion.",
    "tangent_of_accelerations": "Accelerations, and how they change along one direction of state and forces.",
}


class LoopPrinter:
    """The parts of a robot's C that its functions make.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot.
    compiled : CompiledLoop
        Its dynamics.
    prefix : str
        What all names begin with.
    functions : sequence of Function
        What is printed.
    note : str
        Where the files come from.
    """

    def __init__(
        self,
        robot: ClosedLoopModel,
        compiled: CompiledLoop,
        prefix: str,
        functions: Sequence[Function],
        note: str,
    ) -> None:
        self.robot, self.compiled, self.prefix, self.functions = robot, compiled, prefix, functions
        self.note = note
        names = {function.name for function in functions}
        self.follows = compiled.determined and names >= set(FOLLOWING)

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
        shared = self._shared
        told = "\n".join(f" * {line}".rstrip() for line in self._orders())
        return fill("loop_header.in", **shared, told=told, declarations="\n".join(declared))

    def source(self) -> str:
        """Return the functions."""
        used = {f.tape.operations[i].name for f in self.functions for i in f.tape.needed(f.results)}
        computed = "\n\n".join(_computation(function) for function in self.functions)
        calls = [self._call(function) for function in self.functions]
        if self.follows:
            calls.append(self._following())
        return fill(
            "loop_source.in",
            **self._shared,
            wave=wave() if used & {"sin", "cos"} else "",
            computations=computed,
            functions="\n".join(calls).rstrip(),
            **_position_limits(self.robot),
        )

    def web(self) -> WebModule:
        """Return what the WebAssembly offers."""
        calls = {}
        for function in self.functions:
            inputs, outputs = (
                [
                    Rows(name, size, optional=_optional(name) and not out)
                    for name, size, out in self._arguments(function)
                    if out == wanted
                ]
                for wanted in (False, True)
            )
            calls[function.name] = (
                inputs,
                [*outputs, evidence(self.prefix)] if "margin" in function.outputs else outputs,
            )
        follow = None
        if self.follows:
            loads = [
                Rows(_identifier(name), size, optional=True)
                for name, size in list(self._function("motion").inputs.items())[3:]
            ]
            model = self.robot.model
            follow = len(self.robot.actuated), model.nq, model.nv, loads
        return loop_module(self.prefix, self.note, calls, follow)

    def readme(self) -> str:
        """Return what a reader has to know of the code."""
        rows = [f"| `{self.prefix}_{f.name}` | {f.operations} | {_TEXTS[f.name]} |" for f in self.functions]
        if self.follows:
            text = (
                f"Start at a configuration, and follow a motion of the motors, {STEPS} steps of Newton each."
            )
            rows.append(f"| `{self.prefix}_start`, `{self.prefix}_follow` | | {text} |")
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
            "wrenches are force [N] and moment [N m] in world axes at the frame's origin.",
        ]

    def _arguments(self, function: Function) -> list[tuple[str, int, bool]]:
        inputs = [(_identifier(name), size, False) for name, size in function.inputs.items() if size]
        outputs = [
            (name, size, True) for name, size in function.outputs.items() if size and name not in EVIDENCE
        ]
        taken = {name for name, _, _ in inputs}
        return inputs + [(f"{name}_out" if name in taken else name, size, out) for name, size, out in outputs]

    def _prototype(self, name: str, arguments: Sequence[str]) -> str:
        head = f"{self.prefix}_status {self.prefix}_{name}("
        line = f"{head}{', '.join(arguments)})"
        return line if len(line) <= 110 else head + "\n" + ",\n".join(_INDENT + a for a in arguments) + ")"

    def _head(self, function: Function) -> str:
        arguments = [
            f"{'' if out else 'const '}double {name}[{size}]" for name, size, out in self._arguments(function)
        ]
        if "margin" in function.outputs:
            arguments.append(f"{self.prefix}_evidence *evidence")
        return self._prototype(function.name, arguments)

    def _declared(self, function: Function) -> str:
        return f"{_comment(_TEXTS[function.name], function)}\n{self._head(function)};\n"

    def _call(self, function: Function) -> str:
        """Return a function that checks its arguments, computes, and copies what came out."""
        P, size = self.prefix.upper(), len(function.results)
        told = "margin" in function.outputs
        lines = [f"double given[{len(function.symbols)}], found[{size}];"]
        arguments = self._arguments(function)
        needed = [name for name, _, out in arguments if out or not _optional(name)]
        nulls = " || ".join(f"({name} == NULL)" for name in needed)
        lines += [f"if ({nulls}) {{", f"{_INDENT}return {P}_NULL_POINTER;", "}"]
        lines += self._given(function, 0)
        lines += [
            f"if (!all_finite(given, {len(function.symbols)}U)) {{",
            f"{_INDENT}return {P}_NOT_FINITE;",
            "}",
            f"compute_{function.name}(given, found);",
        ]
        if told:
            lines += [
                "{",
                f"{_INDENT}const {self.prefix}_status status = "
                f"judged(found, {size}U, {function.closed!r}, {function.least_margin!r}, evidence);",
                f"{_INDENT}if (status != {P}_OK) {{",
                f"{_INDENT}{_INDENT}return status;",
                f"{_INDENT}}}",
                "}",
            ]
        else:
            lines += [f"if (!all_finite(found, {size}U)) {{", f"{_INDENT}return {P}_NOT_FINITE;", "}"]
        place = 0
        outs = [name for name, _, out in arguments if out]
        for group, count in function.outputs.items():
            if count and group not in EVIDENCE:
                lines.append(f"copy({outs.pop(0)}, &found[{place}], {count}U);")
            place += count
        lines.append(f"return {P}_OK;")
        return "\n".join([self._head(function), "{", *(_INDENT + line for line in lines), "}", ""])

    def _given(self, function: Function, start: int) -> list[str]:
        """Return the statements that gather inputs from a place on; those that are missing have defaults."""
        lines, place = [], 0
        for group, count in function.inputs.items():
            name = _identifier(group)
            if place >= start and count:
                where = f"&given[{place}]"
                if _optional(name):
                    default = ", ".join(repr(float(x)) for x in self.compiled.defaults[group])
                    lines += [
                        "{",
                        f"{_INDENT}static const double usual[] = {{{default}}};",
                        f"{_INDENT}copy({where}, ({name} != NULL) ? {name} : usual, {count}U);",
                        "}",
                    ]
                else:
                    lines.append(f"copy({where}, {name}, {count}U);")
            place += count
        return lines

    def _follow_head(self) -> str:
        motion = self._function("motion")
        n = len(self.robot.actuated)
        loads = [
            f"const double {_identifier(name)}[{size}]" for name, size in list(motion.inputs.items())[3:]
        ]
        arguments = [
            f"{self.prefix}_state *state",
            "double dt",
            *(f"const double {name}[{n}]" for name in ("target", "velocity", "acceleration")),
            *loads,
            f"double tau[{n}]",
            f"{self.prefix}_evidence *evidence",
        ]
        return self._prototype("follow", arguments)

    def _follow_declared(self) -> str:
        p, P = self.prefix, self.prefix.upper()
        return (
            "/** Where a motion that is followed has come to; zero velocity at the start. */\n"
            f"typedef struct {{\n{_INDENT}double q[{P}_NQ], v[{P}_NV], a[{P}_NV];\n}} {p}_state;\n\n"
            "/** Begin about at a configuration: its loops are closed; the motors' values stay. */\n"
            f"{p}_status {p}_start({p}_state *state, const double q[{P}_NQ]);\n\n"
            f"{_comment(_FOLLOW, self._function('motion'))}\n{self._follow_head()};\n"
        )

    def _following(self) -> str:
        motion, step = self._function("motion"), self._function("step")
        places = self.compiled.follow_places()
        needed = ["state", "target", "velocity", "acceleration", "tau"]
        loads = self._given(motion, sum(list(motion.inputs.values())[:3]))
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
            loads="".join(f"\n{_INDENT}{line}" for line in loads),
        )

    def _function(self, name: str) -> Function:
        return next(function for function in self.functions if function.name == name)


_OPTIONAL = "Wrenches, other forces and inertias may be NULL: none, and those that the robot has."
_FOLLOW = "Forces of the motors for their values and rates, dt [s] after the last call; 0 the first time."


def _comment(words: str, function: Function) -> str:
    """Return what a function is for, in a comment."""
    more = [_OPTIONAL] if any(map(_optional, function.inputs)) else []
    return "\n".join([f"/** {words}", *(f" *  {line}" for line in more)]) + " */"


def _optional(name: str) -> bool:
    return name.startswith(("wrench_", "joint_forces", "inertia_"))


def _identifier(name: str) -> str:
    """Return a name as C has it."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _computation(function: Function) -> str:
    head = f"static void compute_{function.name}(const double *in, double *out)"
    zero = f"{_INDENT}const double zero = 0.0;\n{_INDENT}(void)zero;\n{_INDENT}(void)in;"
    return f"{head}\n{{\n{zero}\n{body(function, 'double', '_one')}\n}}"


def _wrapped(head: str, parts: Sequence[str], width: int) -> list[str]:
    lines = [head]
    for i, part in enumerate(parts):
        piece = part + (", " if i < len(parts) - 1 else "")
        if len(lines[-1]) + len(piece) > width:
            lines.append("  ")
        lines[-1] += piece
    return [line.rstrip() for line in lines]


def _position_limits(robot: ClosedLoopModel) -> dict[str, str]:
    """Return the limits of q as C has them, for the joints with one coordinate."""
    known, endless = Limits(robot.model), sys.float_info.max
    lower, upper = np.full(robot.model.nq, -endless), np.full(robot.model.nq, endless)
    lower[known.q] = np.clip(known.lower, -endless, endless)
    upper[known.q] = np.clip(known.upper, -endless, endless)
    return {
        name: ", ".join(repr(float(end)) for end in ends)
        for name, ends in (("lower", lower), ("upper", upper))
    }
