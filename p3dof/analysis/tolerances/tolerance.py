"""`tolerance`: how uncertain forces or poses are, because a machine is never what its drawing says.

What is uncertain about a machine, as a YAML file for `p3dof tolerance` and `p3dof sensitivity`.

Such as this one::

    sigma:                        # standard deviations, for `tolerance`
      R: 0.1 mm
      platform.mass: 2 %
      encoder: 10 um              # for poses only
    variables:                    # ranges, for `sensitivity`
      R: 10 %                     # evenly spread from 90 to 110 %
      L: [380 mm, 420 mm]
      platform.mass: {normal: [8 kg, 200 g]}
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import Progress, positive, shown, unknown_field, whole
from p3dof._base.errors import InputError
from p3dof._base.files import called, parse_yaml, read_text
from p3dof._base.tables import Table, formatted, html_of, notebook_html, number, table_of
from p3dof._base.time_series.wrenches import WrenchOverTime
from p3dof.analysis.designs.columns import QUANTITIES, BodiesOfDesigns
from p3dof.analysis.tolerances.directions import (
    AnyMachine,
    amount_of,
    directions_of,
    fixed_of,
    parameters_of,
    require_smaller,
)
from p3dof.analysis.tolerances.draws import Draws, Spread, drawn_forces, drawn_poses, first_order_pose
from p3dof.analysis.tolerances.pose import (
    ForceCase,
    ForceTolerance,
    PoseTolerance,
    ToleranceMethod,
    checked_pose,
    first_order,
    require_possible,
    sigmas_of,
)
from p3dof.analysis.tolerances.sensitivity import LocalSensitivity, SobolIndices
from p3dof.machine.motion import Motion
from p3dof.machine.motion.core import require_motion
from p3dof.machine.parameters import Parameters

MOST_MACHINES = 10**7


def tolerance(
    robot: AnyMachine = None,
    motion: Motion | None = None,
    pose: ArrayLike | None = None,
    *,
    sigma: Mapping[str, float | str],
    method: ToleranceMethod = "gradient",
    bodies: BodiesOfDesigns = "kept",
    fixed: Mapping[str, float | str] | None = None,
    wrench: WrenchOverTime = None,
    worst: float = 3.0,
    samples: int = 2000,
    spread: Spread = "normal",
    seed: int = 0,
    folder: str | os.PathLike[str] | None = None,
    resume: bool = False,
    client: Any = None,
    progress: Progress | None = None,
) -> ForceTolerance | PoseTolerance:
    """Return how uncertain the forces over a motion, or static poses, are.

    With `motion`, the forces: a machine is built once, with lengths and bodies that differ a little from the
    nominal ones, and makes the motion exactly. With `pose`, the pose: the sliders stand where the nominal
    machine's would, but each leg has its own R, r, L and offset of its encoder.

    Parameters
    ----------
    robot : Manipulator or Parameters, optional
        The nominal machine; the paper's by default.
    motion : Motion, optional
        Whose forces are asked.
    pose : array-like, shape (..., 3), optional
        y [m], z [m], θ [rad] whose errors are asked, instead of `motion`.
    sigma : mapping of str to float or str
        Standard deviations by names of parameters, independent of each other: numbers in SI units, with a
        unit (``"0.1 mm"``), or as a share (``"2 %"``). For forces, names are those of columns of designs
        (``R``, ``platform.mass``, ``leg.mass``, ``payload.com.x``, ``friction.viscous.sliders``): a kind of
        bodies or a group of joints moves as one, and a mass takes the body's inertia with it. For poses, they
        are ``R``, ``r``, ``L``, ``encoder``, which each leg has on its own, or those of one leg (``L.a``).
    method : {"gradient", "montecarlo"}
        First order by exact derivatives; or sampled machines, whose forces are computed, or whose
        closures are solved, without any such approximation.
    bodies : {"kept", "solids"}
        For forces: keep the bodies whatever the lengths are, or compute them anew from solids, whose sizes
        and density may vary then.
    fixed : mapping of str to float or str, optional
        For forces: numbers that are not those of the machine, such as sizes and density of its solids.
    wrench : array-like or callable, optional
        External force and moment on the platform, as of `Manipulator.inverse_dynamics`.
    worst : float
        How many standard deviations all parameters are off in the worst case.
    samples : int
        Machines to draw.
    spread : {"normal", "uniform"}
        How parameters are spread about their nominal numbers, with the standard deviation `sigma`.
    seed : int
        Of the random numbers.
    folder : path-like, optional
        Where to store the machines drawn, block by block.
    resume : bool
        Go on with what is in the folder: ends in the same bits.
    client : distributed.Client or concurrent.futures.Executor, optional
        Who computes; this process by default.
    progress : callable, optional
        Called with the number of machines done and of all.

    Raises
    ------
    InputError
        If an argument does not fit, or the nominal machine cannot perform the motion.
    ReachError, SingularityError
        If it cannot be at a pose, or not hold it.
    SweepError, FileError
        As `sweep`.
    """
    if method not in get_args(ToleranceMethod):
        raise InputError(f"method: expected 'gradient' or 'montecarlo', got {shown(method)}")
    if (motion is None) == (pose is None):
        raise InputError("expected a motion, whose forces are asked, or poses, whose errors are; one of both")
    machine = parameters_of(robot)
    most = positive("worst", worst, InputError)
    whole("samples", samples, 2, MOST_MACHINES)
    draws = Draws(samples, seed, spread, folder, resume, client, progress)
    if motion is None:
        names, sizes = sigmas_of(sigma, machine.geometry)
        poses = checked_pose(machine.geometry, pose)
        linear = first_order_pose(machine.geometry, poses, names, sizes, most)
        return linear if method == "gradient" else drawn_poses(machine.geometry, linear, draws)
    require_motion(motion)
    case = _force_case(machine, motion, sigma, bodies, fixed, wrench, most)
    require_possible(case)
    return first_order(case) if method == "gradient" else drawn_forces(case, draws)


def _force_case(
    machine: Parameters,
    motion: Motion,
    sigma: Mapping[str, Any],
    bodies: BodiesOfDesigns,
    fixed: Mapping[str, Any] | None,
    wrench: WrenchOverTime,
    worst: float,
) -> ForceCase:
    if bodies not in get_args(BodiesOfDesigns):
        raise InputError(f"bodies: expected 'kept' or 'solids', got {shown(bodies)}")
    numbers = fixed_of(fixed, bodies)
    directions, values = directions_of(sigma, "sigma", machine, bodies, numbers)
    pairs = zip(directions, values, strict=True)
    sizes = [
        amount_of(value, direction.nominal, QUANTITIES[direction.name], f"sigma of {direction.name}")
        for direction, value in pairs
    ]
    for direction, size in zip(directions, sizes, strict=True):
        if direction.name.startswith("geometry.") or direction.name.endswith(".mass"):
            require_smaller(size, direction.nominal, direction.unit, f"sigma of {direction.name}")
    return ForceCase(machine, motion, directions, np.array(sizes), bodies, wrench, worst, numbers)


FIELDS = ("sigma", "variables")  # the fields of the file; `reference/uncertainty.schema.json` has their forms

_LARGEST_FILE = 1_000_000


class Uncertainty(NamedTuple):
    """What a file says is uncertain.

    Parameters
    ----------
    sigma : dict
        Standard deviations by names of parameters, as of `p3dof.tolerance`.
    variables : dict
        How parameters are spread, as of `p3dof.sensitivity`.
    """

    sigma: dict[str, Any]
    variables: dict[str, Any]


def read_uncertainty(path: str | os.PathLike[str] | Any) -> Uncertainty:
    """Read what is uncertain about a machine from a YAML file.

    As it stands there: names and numbers are looked at where they are used.
    """
    name = called(path)
    data = parse_yaml(read_text(path, _LARGEST_FILE), name, InputError)
    if not isinstance(data, Mapping) or not data:
        raise InputError(f"{name}: expected the fields sigma or variables, got nothing of the kind")
    for key in data:
        if key not in FIELDS:
            raise InputError(f"{name}: {unknown_field(key, data, FIELDS)}")
    found = []
    for key in FIELDS:
        given = data.get(key, {})
        if not isinstance(given, Mapping):
            raise InputError(f"{name}: {key}: expected names of parameters with numbers, got {shown(given)}")
        found.append({str(each): value for each, value in given.items()})
    return Uncertainty(*found)


def plain_of(result: Any) -> dict[str, Any]:
    """Return a result as plain data for JSON, by the names of its fields in SI units; NaN as None."""
    left_out = ("peaks", "drawn", "errors", "values")
    found = {name: value for name, value in vars(result).items() if name not in left_out}
    for name in ("machines", "impossible", "normalised"):
        if hasattr(result, name):
            found[name] = getattr(result, name)
    return {name: _plain(value) for name, value in found.items()}


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and value != value else value  # noqa: PLR0124 - NaN


RIGID = (
    "Each leg has its own lengths. Unequal rods of the parallelogram, tilted guides and axes are outside: "
    "they jam or strain this overconstrained machine."
)


def tolerance_tables(found: ForceTolerance | PoseTolerance) -> tuple[Table, ...]:
    """Return what is uncertain, and what it comes from."""
    return _of_forces(found) if isinstance(found, ForceTolerance) else _of_poses(found)


def sensitivity_table(found: SobolIndices | LocalSensitivity) -> Table:
    """Return what a figure depends on, the most important parameter first."""
    if isinstance(found, LocalSensitivity):
        order = np.argsort(-np.abs(found.normalised)).tolist()
        rows = {
            found.names[i]: (
                number(found.nominal[i], found.units[i]),
                number(found.gradient[i], f"{found.unit}/{_below(found.units[i])}"),
                formatted(found.normalised[i], "+.4g"),
            )
            for i in order
        }
        title = f"{found.result} = {number(found.value)} {found.unit}"
        return table_of(title, ("parameter", "nominal", "derivative", "% per %"), rows)
    order = np.argsort(-found.total).tolist()
    shares = {
        found.names[i]: (
            f"{formatted(found.first[i], '.3f')} ± {found.first_error[i]:.3f}",
            f"{formatted(found.total[i], '.3f')} ± {found.total_error[i]:.3f}",
        )
        for i in order
    }
    note = (
        f"Mean {number(found.mean)} {found.unit}, standard deviation {number(found.deviation)} {found.unit}, "
        f"95 % from {number(found.low)} to {number(found.high)} {found.unit}; {found.rows} matched rows"
    )
    note += f", {found.missing_rows} left out" if found.missing_rows else ""
    header = ("parameter", "S1: alone", "ST: with interactions")
    return table_of(f"Shares of the variance of {found.result}", header, shares, f"{note}.")


def _of_forces(found: ForceTolerance) -> tuple[Table, ...]:
    largest = found.deviation.max(axis=0)
    deviations = (*largest.tolist(), float(largest.max()))
    each = found.peak, deviations, found.peak_deviation, found.peak_high, found.peak_worst
    legs = zip(("A", "B", "C", "largest"), *each, strict=True)
    rows = {name: tuple(map(number, values)) for name, *values in legs}
    header = (
        "actuator", "peak [N]", "largest σ of the motion [N]", "σ of the peak [N]", "95 % below [N]",
        f"worst case, {found.worst_sigma:g} σ [N]",
    )  # fmt: skip
    forces = table_of(
        "Forces", header, rows, _drawn(found.method, found.machines, found.impossible, "perform the motion")
    )
    order = np.argsort(-found.shares[3]).tolist()
    parts = {
        found.names[i]: (
            number(found.nominal[i], found.units[i]),
            number(found.sigma[i], found.units[i]),
            number(found.peak_gradient[3, i], f"N/{_below(found.units[i])}"),
            formatted(found.shares[3, i], ".3g", "%"),
        )
        for i in order
    }
    what = ("parameter", "nominal", "σ", "derivative of the peak", "share of its variance")
    return forces, table_of("Where it comes from", what, parts)


def _of_poses(found: PoseTolerance) -> tuple[Table, ...]:
    scale = np.array([1e6, 1e6, 1e3])
    shape = (-1, 3)
    poses, sizes, high, worst = (
        array.reshape(shape) for array in (found.pose, found.deviation, found.high, found.worst)
    )
    rows = {}
    for k, (y, z, theta) in enumerate(poses.tolist()):
        name = f"{k + 1}: {y:g} m, {z:g} m, {math.degrees(theta):.4g}°"
        rows[name] = tuple(
            number(float(value)) for values in (sizes, high, worst) for value in (values[k] * scale)
        )
    header = ["pose"]
    for what in ("σ of {}", "95 % of |{}| below", f"worst {{}}, {found.worst_sigma:g} σ"):
        header += [
            f"{what.format(axis)} [{unit}]" for axis, unit in (("y", "µm"), ("z", "µm"), ("θ", "mrad"))
        ]
    told = _drawn(found.method, found.machines, found.impossible, "assemble")
    errors = table_of("Static errors of the pose", header, rows, f"{told} {RIGID}", "wide")
    shares = found.shares.reshape(-1, 3, len(found.names))[0]
    parts = {
        name: (formatted(1e6 * found.sigma[i], ".4g"), *(formatted(100 * x, ".3g") for x in shares[:, i]))
        for i, name in enumerate(found.names)
    }
    titles = ("parameter", "σ [µm]", "of y [%]", "of z [%]", "of θ [%]")
    return errors, table_of("Where it comes from, at the first pose", titles, parts)


def _below(unit: str) -> str:
    """Return a unit as it stands below a line."""
    return f"({unit})" if " " in unit or "/" in unit else unit


def _drawn(method: str, machines: int, impossible: int, can: str) -> str:
    if method == "gradient":
        return "First order, by exact derivatives."
    left = f", {impossible} of which cannot {can} and are left out" if impossible else ""
    return f"{machines} sampled machines{left}; the worst case is of first order."


@html_of.register(ForceTolerance)
@html_of.register(PoseTolerance)
def tolerance_html(found: ForceTolerance | PoseTolerance) -> str:
    """Return how a notebook shows a tolerance, as HTML."""
    return notebook_html("Tolerance", repr(found), tolerance_tables(found), [], "")


@html_of.register(SobolIndices)
@html_of.register(LocalSensitivity)
def sensitivity_html(found: SobolIndices | LocalSensitivity) -> str:
    """Return how a notebook shows a sensitivity, as HTML."""
    return notebook_html("Sensitivity", repr(found), [sensitivity_table(found)], [], "")
