"""C99 for a controller: all functions of a machine, with its parameters at run time or baked in.

The formulas are those of `p3dof.compiled.reduced`; the library in C allocates nothing, keeps no state and
calls nothing but mathematical functions. A self-test comes with it that holds it against
`p3dof.codegen.reference`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.resources import files
from string import Template

from p3dof.codegen.files import MARK
from p3dof.codegen.friction import JOINTS
from p3dof.codegen.machine import GIVEN, body_names, machine_numbers, parameter_row
from p3dof.codegen.printing import INDENT, Printer, home_depth, prepare_code
from p3dof.codegen.routines import Argument, Routine, routines
from p3dof.codegen.selftest import selftest
from p3dof.compiled.formulas import MODEL
from p3dof.parameters import LINKS, Parameters

NOTE = f"{MARK}`: do not edit."

_NUMBERS = {
    "r": ("PLATFORM_SIZE", "r [m]"),
    "R": ("BASE_SIZE", "R [m]"),
    "L": ("LEG_LENGTH", "L [m]"),
    "gx": ("GRAVITY_X", "[m/s^2]"),
    "gy": ("GRAVITY_Y", "[m/s^2]"),
    "gz": ("GRAVITY_Z", "[m/s^2]"),
    "a_a": ("A_A", "slider and upper end of leg A [kg]"),
    "c_a": ("C_A", "between the ends of leg A [kg]"),
    "d_a": ("D_A", "mass centre of leg A beside the line of its ends [kg]"),
    "a_b": ("A_B", "likewise of leg B [kg]"),
    "c_b": ("C_B", "[kg]"),
    "d_b": ("D_B", "[kg]"),
    "a_c": ("A_C", "slider and upper end of the rods of leg C [kg]"),
    "c_c": ("C_C", "between their ends [kg]"),
    "m": ("M", "all that moves along y with the platform [kg]"),
    "k": ("K", "at C5, less the platform's first moment along its arm over r [kg]"),
    "e": ("E", "the platform's first moment across its arm over r [kg]"),
    "i": ("I", "platform and what is at C5, about P [kg m^2]"),
    "k0": ("K0", "what turns with the plane of the parallelogram, about y0 [kg m^2]"),
    "k1": ("K1", "[kg]"),
    "k2": ("K2", "[kg]"),
    "k3": ("K3", "[kg m]"),
    "n0": ("N0", "[kg m]"),
    "n1": ("N1", "[kg m]"),
    "h1": ("H1", "first moments of what turns [kg m]"),
    "h2": ("H2", "[kg m]"),
    "h3": ("H3", "[kg]"),
}


class _Text(Template):
    """Templates mark what is put in with ``@``, which C, make and CMake leave free here."""

    delimiter = "@"


def controller_files(parameters: Parameters, bake: bool = False) -> dict[str, str]:
    """Return the C of a controller.

    Parameters
    ----------
    parameters : Parameters
        The machine: the initial one of the code, or the only one.
    bake : bool
        Put its numbers into the code instead of taking a model as an argument.

    Returns
    -------
    dict of str to str
        Text by file name: library, self-test, Makefile and CMakeLists.txt.

    Raises
    ------
    ParameterError
        If the machine's numbers overflow, or it hardly reaches any pose.
    """
    row = parameter_row(parameters)
    numbers = machine_numbers(row) if bake else None
    machine_numbers(row)  # raises for what no function could use
    return {
        "p3dof.h": _header(bake),
        "p3dof.c": _source(parameters, numbers),
        "p3dof_selftest.c": _fill("selftest.in", **selftest(parameters, prototypes(), baked=bake), note=NOTE),
        "Makefile": _fill("makefile.in", note=NOTE),
        "CMakeLists.txt": _fill("cmake.in", note=NOTE),
    }


def prototypes() -> list[tuple[str, tuple[Argument, ...], tuple[Argument, ...]]]:
    """Return name, inputs and outputs of every function, forward kinematics last."""
    found = [(routine.name, routine.inputs, routine.outputs) for routine in routines().all]
    by_name = {name: outputs for name, _, outputs in found}
    pose = routines().all[0].inputs[0]
    sliders = by_name["inverse_kinematics"][0]
    inputs = (Argument("sliders", sliders.text, (3,), ("", "", "")),)
    return [*found, ("forward_kinematics", inputs, (Argument("pose", pose.text),))]


def _header(baked: bool) -> str:
    names = [(f"P3DOF_BY_{_NUMBERS[name][0]}", _NUMBERS[name][1]) for name in MODEL]
    texts = {routine.name: routine.text for routine in routines().all}
    texts["forward_kinematics"] = (
        "Pose at positions of the sliders, in the working mode: platform below the sliders, on home's side\n"
        " * of the actuation singularity."
    )
    declarations = []
    for name, inputs, outputs in prototypes():
        told = "\n".join(f" * {argument.name}: {argument.text}." for argument in (*inputs, *outputs))
        prototype = _prototype(name, (*inputs, *outputs), baked)
        declarations.append(f"/** {texts[name]}\n *\n{told}\n */\n{prototype};\n")
    types = _fill(
        "types.in",
        links=_enumerators([(f"P3DOF_{link.upper()}", "") for link in LINKS]),
        joints=_enumerators([(f"P3DOF_{joint.upper()}", "") for joint in JOINTS]),
        constants=str(len(routines().constants())),
    )
    machine = (
        "The numbers of the machine are in the code."
        if baked
        else "A machine is described by p3dof_parameters and made ready by p3dof_prepare."
    )
    return _fill(
        "header.in",
        note=NOTE,
        machine=machine,
        numbers=_enumerators(names),
        count=str(len(MODEL)),
        types="" if baked else types,
        declarations="\n".join(declarations),
    )


def _source(parameters: Parameters, numbers: dict[str, float] | None) -> str:
    baked = numbers is not None
    r, R, L = (
        repr(numbers[name]) if numbers is not None else f"model->numbers[P3DOF_BY_{_NUMBERS[name][0]}]"
        for name in ("r", "R", "L")
    )
    forward = _fill(
        "forward_kinematics.in",
        model_argument="" if baked else "const p3dof_model *model, ",
        model_null="" if baked else "(model == NULL) || ",
        r=r,
        R=R,
        L=L,
        h=home_depth(numbers),
    )
    return (
        _fill(
            "source.in",
            note=NOTE,
            tables="" if baked else _table(parameters),
            preparation="" if baked else _preparation(),
            functions="\n".join(_function(routine, numbers) for routine in routines().all),
            forward_kinematics=forward,
        ).rstrip("\n")
        + "\n"
    )


def _function(routine: Routine, numbers: dict[str, float] | None) -> str:
    arguments = (*routine.inputs, *routine.outputs)
    needed = [argument.name for argument in arguments if argument.name != "wrench"]
    if numbers is None:
        needed.insert(0, "model")
    lines = _leave(_joined([f"({name} == NULL)" for name in needed], "||"), "P3DOF_NULL_POINTER")
    finite = [
        f"all_finite({argument.name}, {argument.shape[0]}U)"
        if argument.name != "wrench"
        else "((wrench == NULL) || all_finite(wrench, 6U))"
        for argument in routine.inputs
    ]
    lines += _leave(f"!({_joined(finite, '&&')})", "P3DOF_NOT_FINITE")
    if numbers is None:
        lines = ["const double *k;", *lines, "k = model->constants;"]
    lines = [f"double found[{len(routine.results)}];", *lines, *Printer(routine, numbers).code()]
    lines += _leave(f"!all_finite(found, {len(routine.results)}U)", "P3DOF_NOT_FINITE")
    lines += [*_copies(routine), "return P3DOF_OK;"]
    head = _prototype(routine.name, arguments, numbers is not None)
    return "\n".join([head, "{", *(INDENT + line for line in lines), "}", ""])


def _copies(routine: Routine) -> list[str]:
    lines, place = [], 0
    for argument in routine.outputs:
        how = {(3,): "vector", (3, 3): "matrix"}.get(argument.shape, "by_numbers")
        lines.append(f"copy_{how}({argument.name}, {f'&found[{place}]' if place else 'found'});")
        place += math.prod(argument.shape)
    return lines


def _prototype(name: str, arguments: Sequence[Argument], baked: bool) -> str:
    model = [] if baked else ["const p3dof_model *model"]
    declared = [*model, *(_declaration(argument) for argument in arguments)]
    head = f"p3dof_status p3dof_{name}("
    line = f"{head}{', '.join(declared)})"
    if len(line) <= 118:
        return line
    return head + "\n" + ",\n".join(INDENT + text for text in declared) + ")"


def _declaration(argument: Argument) -> str:
    return argument.declaration.replace(f"[{len(MODEL)}]", "[P3DOF_NUMBERS]")


def _preparation() -> str:
    access = {name: _access(name) for name in GIVEN}
    enumerators = [f"P3DOF_BY_{_NUMBERS[name][0]}" for name in MODEL]
    lines = prepare_code(access, enumerators)
    return _fill(
        "preparation.in",
        prepare="\n".join(INDENT + line for line in lines),
        constants=str(len(routines().constants())),
    )


def _access(name: str) -> str:
    """Return how C reads a parameter, by its name in `GIVEN`."""
    if name in {"gx", "gy", "gz"}:
        return f"p->gravity[{'xyz'.index(name[1])}]"
    owner, _, entry = name.partition(".")
    if not entry:
        return f"p->{name}"
    if owner in {"viscous", "coulomb"}:
        return f"p->{owner}[P3DOF_{entry.upper()}]"
    place = body_names(owner).index(name)
    body = f"p->bodies[P3DOF_{owner.upper()}]"
    if place == 0:
        return f"{body}.mass"
    return f"{body}.com[{place - 1}]" if place < 4 else f"{body}.inertia[{place - 4}]"


def _table(parameters: Parameters) -> str:
    geometry = parameters.geometry
    given = dict(zip(GIVEN, parameter_row(parameters), strict=True))
    lines = ["const p3dof_parameters p3dof_machine = {"]
    for name, value in (("r", geometry.r), ("R", geometry.R), ("L", geometry.L), ("b", geometry.b)):
        lines.append(f"{INDENT}{value!r}, /* {name} */")
    lines.append(f"{INDENT}{_braced([given[name] for name in ('gx', 'gy', 'gz')])}, /* gravity */")
    lines.append(f"{INDENT}{{")
    for link in LINKS:
        m, *more = (given[name] for name in body_names(link))
        lines.append(f"{2 * INDENT}/* {link} */")
        lines.append(f"{2 * INDENT}{{{m!r}, {_braced(more[:3])},")
        lines.append(f"{2 * INDENT} {_braced(more[3:])}}},")
    lines.append(f"{INDENT}}},")
    for kind in ("viscous", "coulomb"):
        row = _braced([given[f"{kind}.{joint}"] for joint in JOINTS])
        lines += [f"{INDENT}/* {kind} */", f"{INDENT}{row},"]
    return "\n".join([*lines, f"{INDENT}{given['smoothing']!r} /* smoothing */", "};", "", ""])


def _braced(row: Sequence[float]) -> str:
    return "{" + ", ".join(repr(float(value)) for value in row) + "}"


def _enumerators(names: Sequence[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in names)
    lines = []
    for i, (name, text) in enumerate(names):
        told = f" /**< {text} */" if text else ""
        lines.append(f"{INDENT}{name}{' ' * (width - len(name))} = {i},{told}")
    return "\n".join(lines)


def _joined(parts: Sequence[str], sign: str) -> str:
    """Return a condition on as many lines as it takes, inside an `if` of a function."""
    lines = [""]
    for i, part in enumerate(parts):
        piece = f"{sign} {part}" if i else part
        if len(lines[-1]) + len(piece) > 100:
            lines.append("")
        lines[-1] += f" {piece}" if lines[-1] else piece
    return f"\n{3 * INDENT}".join(lines)


def _leave(condition: str, status: str) -> list[str]:
    return [f"if ({condition}) {{", f"{INDENT}return {status};", "}"]


def _fill(template: str, **values: str) -> str:
    text = (files("p3dof.codegen") / "templates" / template).read_text(encoding="utf-8")
    return _Text(text).substitute(values)
