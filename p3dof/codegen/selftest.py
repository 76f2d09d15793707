"""The program that tests generated C where it is compiled: its tables of states and its calls.

States of motion with everything that the generated C computes there, by other ways than it does.

Kinematics by `p3dof.closed_form.kinematics`, forces by virtual powers, their derivatives by complex steps
through that recursion, the rest by `p3dof.methods.virtual_power`. Only the fold of the bodies, which says
what the base inertial parameters are, is shared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.algebra import Vector, components
from p3dof._base.checks import FloatArray
from p3dof._base.errors import ParameterError
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.reduced import fold
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.closed_form.paper.friction import NO_ACTUATION, NO_LOSSES, actuation_of, losses_of
from p3dof.closed_form.paper.virtual_power import NO_WRENCH, Wrench, actuator_forces, generalized_forces
from p3dof.codegen.frame import DOUBLE, INDENT, Argument, Precision, Prototype, groups
from p3dof.codegen.naming import number_table
from p3dof.codegen.routines import routines
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import LINKS, SLIDES, Parameters
from p3dof.machine.parameters.body import Inertial, inertials
from p3dof.methods.virtual_power import VirtualPowerMethod

_STEP = 1e-100  # complex step: nothing is subtracted

_CANDIDATES = 4000
_ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_REST: Vector = (0, 0, 0)


@dataclass(frozen=True, eq=False)
class Reference:
    """States and expected results."""

    inputs: dict[str, FloatArray]
    """(N, 3): `pose`, `velocity`, `acceleration`, `wrench`, `forces` that act, `sliders` and their
    `rates`."""
    outputs: dict[str, FloatArray]  # (N, M): by function, all its outputs in a row
    amplification: FloatArray  # (N,): by how much rounding grows near singularities
    singular: FloatArray  # (3,): a pose at which the actuators cannot hold the platform


def reference(
    parameters: Parameters,
    count: int = 8,
    seed: int = 1,
    rounded: Callable[[Sequence[float]], list[float]] = list,
) -> Reference:
    """Return states of a machine and what is expected of them."""
    rng = np.random.default_rng(seed)

    def short(array: FloatArray) -> FloatArray:
        return np.array(rounded(_short(array).ravel().tolist())).reshape(array.shape)

    pose, amplification = _poses(parameters, count, rng)
    pose = short(pose)
    size = [parameters.geometry.L, parameters.geometry.L, 1]
    velocity, acceleration = rng.normal(0, 1, (count, 3)) * size, rng.normal(0, 10, (count, 3)) * size
    holding = VirtualPowerMethod(parameters).forces(states_of(pose))
    weight = float(np.abs(holding).max()) or 1.0
    wrench = rng.normal(0, weight / 2, (count, 6)) * [1, 1, 1, *(3 * [parameters.geometry.r])]
    acting = holding + rng.normal(0, weight / 2, (count, 3))
    sliders = kinematics.inverse_kinematics(parameters.geometry, pose).sliders
    inputs = {
        "pose": pose,
        "velocity": short(velocity),
        "acceleration": short(acceleration),
        "wrench": short(wrench),
        "forces": short(acting),
        "sliders": short(sliders),
        "rates": short(rng.normal(0, parameters.geometry.L, (count, 3))),
    }
    return Reference(inputs, outputs(parameters, inputs), amplification, _singular(parameters))


def outputs(parameters: Parameters, inputs: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the results of all functions at states; dict of str to ndarray, shape (N, M)."""
    names = ("pose", "velocity", "acceleration", "wrench", "forces", "sliders", "rates")
    pose, velocity, acceleration, wrench, acting, sliders, rates = (inputs[name] for name in names)
    motion, count = (pose, velocity, acceleration), len(pose)
    dynamics = VirtualPowerMethod(parameters)
    forces = dynamics.forces(states_of(*motion, wrench=wrench))
    driven = states_of(pose, velocity, forces=acting, wrench=wrench)
    by_motion = force_derivatives(parameters, *motion, wrench)
    by_numbers = number_derivatives(parameters, *motion, wrench)
    geometry = parameters.geometry
    J = kinematics.inverse_jacobian(geometry, pose)
    return {
        "inverse_dynamics": forces,
        "inverse_kinematics": kinematics.inverse_kinematics(geometry, pose).sliders,
        "jacobian": J.reshape(count, 9),
        "pose_velocity": np.linalg.solve(J, rates[..., None])[..., 0],
        "mass_matrix": dynamics.mass_matrix(states_of(pose)).reshape(count, 9),
        "bias": bias(parameters, pose, velocity),
        "forward_dynamics": dynamics.accelerate(driven),
        "inverse_dynamics_derivatives": np.concatenate(
            [forces, *(by_motion[..., i : i + 3].reshape(count, 9) for i in (0, 3, 6))], axis=-1
        ),
        "parameter_derivatives": np.concatenate([forces, by_numbers.reshape(count, -1)], axis=-1),
        "forward_kinematics": kinematics.forward_kinematics(geometry, sliders),
        "joints": np.stack([*kinematics.inverse_kinematics(geometry, pose).joints.values()], axis=-1),
    }


def bias(parameters: Parameters, pose: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return what motions without acceleration take in y, z, θ, (N, 3) [N, N, N m]."""
    found = generalized_forces(
        Lengths.of(parameters.geometry),
        inertials(parameters.bodies),
        components(parameters.gravity),
        components(pose),
        components(velocity),
        _REST,
        np,
        losses=losses_of(parameters.friction),
        actuation=actuation_of(parameters.actuators, parameters.gravity),
    )
    stacked: FloatArray = _stacked(found, len(pose))
    return stacked


def force_derivatives(
    parameters: Parameters,
    pose: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    wrench: FloatArray,
) -> FloatArray:
    """Return the derivatives of the forces by pose, velocity and acceleration; ndarray, shape (N, 3, 9)."""
    lengths, bodies = Lengths.of(parameters.geometry), inertials(parameters.bodies)
    gravity = components(parameters.gravity)
    columns = []
    for place in range(9):
        rows: list[Any] = [*pose.T, *velocity.T, *acceleration.T]
        rows[place] = rows[place] + 1j * _STEP
        stepped = _forces(parameters, lengths, bodies, gravity, rows, wrench)
        columns.append(np.imag(_stacked(stepped, len(pose))) / _STEP)
    return np.stack(columns, axis=-1)


def number_derivatives(
    parameters: Parameters,
    pose: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    wrench: FloatArray,
) -> FloatArray:
    """Return the derivatives of the forces by the numbers of the model; ndarray, shape (N, 3, 36).

    The forces are linear in the inertial parameters of the bodies, 100 in all: their columns, by virtual
    powers, are a fixed matrix times those wanted. Along a length with all bodies kept the forces also change
    with the base parameters, which is taken off.
    """
    lengths, count = Lengths.of(parameters.geometry), len(pose)
    rows: list[Any] = [*pose.T, *velocity.T, *acceleration.T]
    gravity = components(parameters.gravity)
    probes = list(_probes(lengths))
    by_probe = [_forces(None, lengths, bodies, gravity, rows) for bodies in probes]
    folds = np.array([fold(lengths, bodies) for bodies in probes], dtype=float)  # (100, 21)
    columns = np.stack([_stacked(f, count) for f in by_probe], axis=-1)  # (N, 3, 100)
    size = np.abs(folds).max(axis=0)  # kg, kg m and kg m² side by side
    base: FloatArray = columns @ (np.linalg.pinv(folds / size) / size[:, None]).T
    found = np.empty((count, 3, len(MODEL)))
    bodies = 6 + base.shape[-1]
    found[..., 6:bodies], found[..., bodies:] = base, _by_actuators(parameters, pose, velocity, acceleration)
    own, resting = inertials(parameters.bodies), [*pose.T, *([0.0 * pose[:, 0]] * 6)]
    for axis, unit in enumerate(((1, 0, 0), (0, 1, 0), (0, 0, 1))):
        found[..., 3 + axis] = _stacked(_forces(None, lengths, own, unit, resting), count)
    for place in range(3):
        stepped = _stepped(parameters, place)
        total = _forces(parameters, stepped, own, gravity, rows, wrench)
        moved = np.array([np.imag(value) / _STEP for value in fold(stepped, own)])
        found[..., place] = np.imag(_stacked(total, count)) / _STEP - base @ moved
    return found


def _by_actuators(
    parameters: Parameters, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Return the derivatives by inertia, balance and stiffness at each slider, (N, 3, 9)."""
    moving = kinematics.mechanism_motion(parameters.geometry, pose, velocity, acceleration)
    found = np.zeros((len(pose), 3, 9))
    for leg, slide in enumerate(SLIDES):
        found[:, leg, leg] = moving.acceleration[slide]
        found[:, leg, 3 + leg] = -1
        found[:, leg, 6 + leg] = moving.position[slide]
    return found


def _forces(
    parameters: Parameters | None,
    lengths: Lengths,
    bodies: dict[str, Inertial],
    gravity: Vector,
    rows: list[Any],
    wrench: FloatArray | None = None,
) -> Vector:
    """Return the forces at states given as nine columns, with the friction of a machine."""
    losses, actuation = NO_LOSSES, NO_ACTUATION
    if parameters is not None:
        losses = losses_of(parameters.friction)
        actuation = actuation_of(parameters.actuators, parameters.gravity)
    load = NO_WRENCH
    if wrench is not None:
        load = Wrench(components(wrench[:, :3]), components(wrench[:, 3:]))
    pose, velocity, acceleration = (components(rows[i : i + 3]) for i in (0, 3, 6))
    motion = pose, velocity, acceleration
    return actuator_forces(lengths, bodies, gravity, *motion, np, load, losses, actuation)


def _probes(lengths: Lengths) -> list[dict[str, Inertial]]:
    """Return ten sets of bodies for every link, of which it alone is not empty: they span all of its kind."""
    zero = (_REST, _REST, _REST)
    empty = {name: Inertial(0, _REST, zero) for name in LINKS}
    found = []
    for name in LINKS:
        for axis in range(4):
            com = [0.0, 0.0, 0.0, 0.0]
            com[axis] = float(lengths.L)
            found.append(empty | {name: Inertial(1.0, (com[0], com[1], com[2]), zero)})
        for i, j in _ENTRIES:
            inertia = np.zeros((3, 3))
            inertia[i, j] = inertia[j, i] = float(lengths.L) ** 2
            rows = tuple(components(row) for row in inertia)
            found.append(empty | {name: Inertial(0, _REST, (rows[0], rows[1], rows[2]))})
    return found


def _stepped(parameters: Parameters, place: int) -> Lengths:
    """Return the lengths with a complex step in r, R or L, and in h, which follows from them."""
    given: list[Any] = [parameters.geometry.r, parameters.geometry.R, parameters.geometry.L]
    given[place] += 1j * _STEP
    r, R, L = given
    return Lengths(r, R, L, parameters.geometry.b, np.sqrt((L - (R - r)) * (L + (R - r))))


def _poses(parameters: Parameters, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return poses of the working mode that keep away from singularities, as far as this machine can."""
    geometry = parameters.geometry
    reach = geometry.L - (geometry.R - geometry.r)
    pose = rng.uniform(-1, 1, (_CANDIDATES, 3)) * [reach, geometry.L, 1.5]
    pose[: len(pose) // 2] *= [0.2, 1, 0.2]  # many near home, which every machine reaches
    margins = kinematics.singularity(geometry, pose)
    drops = np.sqrt(np.maximum(margins.serial, 0) / geometry.L).min(axis=-1)
    quality = np.minimum(drops, np.sin(np.maximum(np.nan_to_num(margins.actuation), 0)))
    good = np.flatnonzero(quality > 0.5 * quality.max())[:count]
    if quality.max() < 1e-3 or len(good) < count:
        raise ParameterError("this machine hardly reaches any pose: no states to test generated code with")
    return pose[good], 1 / quality[good] ** 2


def _short(array: FloatArray) -> FloatArray:
    """Return numbers with six digits, which are easier to read."""
    return np.array([float(f"{value:.6g}") for value in array.flat]).reshape(array.shape)


def _singular(parameters: Parameters) -> FloatArray:
    """Return the pose on the middle plane where the platform's arm points along the rods of leg C."""
    geometry = parameters.geometry
    return np.array([0.0, 0.0, np.arccos(geometry.R / (geometry.L + geometry.r))])


def _stacked(v: Vector, count: int) -> Any:
    return np.stack([np.broadcast_to(entry, (count,)) for entry in v], axis=-1)


_FIELDS = {"pose": 3, "velocity": 3, "acceleration": 3, "wrench": 6, "forces": 3, "sliders": 3, "rates": 3}


def selftest(
    parameters: Parameters, prototypes: Sequence[Prototype], baked: bool, precision: Precision
) -> dict[str, str]:
    """Return what the template of the self-test is filled with; text by placeholder."""
    expected = reference(parameters, rounded=precision.rounded)
    count = len(expected.amplification)
    rows = []
    for i in range(count):
        entries = [_braced(expected.inputs[name][i], precision) for name in _FIELDS]
        rows.append(f"{INDENT}{{" + f",\n{INDENT} ".join(entries) + "}")
    held = {routine.name for routine in routines().all if routine.held}
    tables, table = [], []
    for name, inputs, outputs in prototypes:
        sizes = [argument.size for argument in outputs]
        tables.append(
            number_table(f"expected_{name}[{count}][{sum(sizes)}]", _settled(expected.outputs[name], sizes))
        )
        size = size_of(name, parameters, precision)
        where = 2 if name == "forward_kinematics" else int(name in held)
        table.append(
            f'{INDENT}{{"{name}", run_{name}, nulls_{name}, expected_{name}[0], {sum(sizes)}, '
            f"{{{groups(sizes, 4)}}}, {where}, {int(any(one.optional for one in inputs))}, {size!r}}},"
        )
    model = "" if baked else "const p3dof_model *model, "
    return {
        "model": model,
        "pass_model": "" if baked else "model, ",
        "model_only": "void" if baked else "const p3dof_model *model",
        "only_model": "" if baked else "model",
        "strong": "P3DOF_BEYOND_LIMITS" if parameters.limits.force < precision.largest else "P3DOF_OK",
        "high": "P3DOF_BEYOND_LIMITS" if parameters.limits.travel[1] < precision.largest else "P3DOF_OK",
        "baked": str(int(baked)),
        "fields": "\n".join(f"{INDENT}real {name}[{size}];" for name, size in _FIELDS.items()),
        "count": str(count),
        "states": ",\n".join(rows),
        "tolerances": ", ".join(f"{value:.3g}" for value in tolerances(expected, parameters, precision)),
        "singular": _braced(expected.singular, precision),
        "far": precision.number(4 * parameters.geometry.L),
        "real": precision.real,
        "limits": precision.limits,
        "tiny": precision.number(1e-320 if precision is DOUBLE else 1e-40),
        "expected": "\n".join(tables),
        "calls": "\n".join(_call(*prototype, baked) for prototype in prototypes),
        "table": "\n".join(table),
        "functions": str(len(prototypes)),
        "largest": str(max(sum(one.size for one in outputs) for _, _, outputs in prototypes)),
    }


def tolerances(expected: Reference, parameters: Parameters, precision: Precision) -> FloatArray:
    """Return the relative error that results at states may have, by what rounding is there.

    It grows near singularities, which for doubles is all that matters. Of floats, guides that are hardly
    farther out than the platform's joints take digits as well, since det J is proportional to R - r. And
    friction turns over within its smoothing rate, of which the rounding of a speed is a share then.
    """
    growth = expected.amplification
    if precision is DOUBLE:
        return precision.accuracy * growth
    geometry, friction = parameters.geometry, parameters.friction
    growth = growth * float(geometry.L / (geometry.R - geometry.r)) ** 2
    found: FloatArray = precision.accuracy * growth
    if any(value > 0 for value in friction.coulomb.values()):
        speed = np.abs(expected.inputs["velocity"]).max(axis=1)
        found = found + 4 * precision.epsilon * growth * speed / friction.smoothing
    return found


def size_of(name: str, parameters: Parameters, precision: Precision) -> float:
    """Return what the error of a function is at least relative to.

    Sliders and poses near home are differences of lengths, and the platform's angle is one over its size,
    which floats feel.
    """
    if precision is DOUBLE or not name.endswith("_kinematics"):
        return 0.0
    L = float(parameters.geometry.L)
    return max(L, L / float(parameters.geometry.r)) if name == "forward_kinematics" else L


def _call(name: str, inputs: tuple[Argument, ...], outputs: tuple[Argument, ...], baked: bool) -> str:
    """Return the functions that call one from a state into a row, and with NULL for each argument."""
    model = "" if baked else "const p3dof_model *model, "
    given = [] if baked else ["model"]
    given += ["(has_wrench ? in->wrench : NULL)" if a.name == "wrench" else f"in->{a.name}" for a in inputs]
    taken, place = [], 0
    for argument in outputs:
        start = f"&out[{place}]" if place else "out"
        shape = argument.shape
        taken.append(start if len(shape) == 1 else f"(real (*)[{shape[1]}])({start})")
        place += argument.size
    optional = [argument.optional for argument in inputs]
    call = f"p3dof_{name}({', '.join([*given, *taken])})"
    uses = any(optional)
    lines = [f"static p3dof_status run_{name}({model}const inputs *in, int has_wrench, real *out)", "{"]
    lines += [] if uses else [f"{INDENT}(void)has_wrench;"]
    lines += [f"{INDENT}return {call};", "}", ""]
    plain = [text.replace("(has_wrench ? in->wrench : NULL)", "in->wrench") for text in given] + taken
    needed = [i for i, text in enumerate(plain) if text != "in->wrench"]
    lines += [f"static int nulls_{name}({model}const inputs *in, real *out)", "{", f"{INDENT}int bad = 0;"]
    for i in needed:
        arguments = ", ".join("NULL" if j == i else text for j, text in enumerate(plain))
        lines.append(f"{INDENT}bad += p3dof_{name}({arguments}) != P3DOF_NULL_POINTER;")
    return "\n".join([*lines, f"{INDENT}return bad;", "}", ""])


def _braced(row: FloatArray, precision: Precision) -> str:
    return "{" + ", ".join(precision.number(value) for value in row) + "}"


def _settled(rows: FloatArray, sizes: Sequence[int]) -> FloatArray:
    """Return results with what is only rounding set to zero: it differs between processors."""
    found, place = rows.copy(), 0
    for size in sizes:
        block = found[:, place : place + size]
        block[np.abs(block) < 1e-15 * np.abs(block).max(axis=1, keepdims=True)] = 0
        place += size
    return found
