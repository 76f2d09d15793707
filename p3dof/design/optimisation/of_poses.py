"""Measures over a box of poses, in closed forms: reach, singularity, height, transmission, stiffness.

Measures of legs and rods by the forces in them over the motion: buckling and stress.

The forces are the reactions with elastic joints and rods (`p3dof.analysis.reactions`): the two rods of the
parallelogram bear different ones, which no model of rigid bodies tells. They are found machine by machine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from p3dof._base.algebra import Namespace
from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError, P3dofError
from p3dof.analysis.designs.columns import OFFSETS
from p3dof.analysis.reactions import Reactions
from p3dof.analysis.reactions.evaluation import over_motion
from p3dof.analysis.reactions.stiffness import RodSection, Stiffness
from p3dof.analysis.workspace.closed_forms import Sizes, drops, extents
from p3dof.analysis.workspace.margins import box_margins
from p3dof.closed_form.compiled import reduced
from p3dof.design.bearings.evaluation import rod_check
from p3dof.design.bearings.results import RodCheck
from p3dof.design.optimisation.measure import ClosedForm, OfDesigns, Pieces
from p3dof.design.optimisation.population import STEP, Box, Numbers, Population
from p3dof.loops import ClosedLoopModel
from p3dof.machine import description
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Parameters
from p3dof.methods.pinocchio import armature_of


class Legs(NamedTuple):
    """The legs at poses, (D, G) each."""

    wa: Any  # horizontal extents; that of C in the plane x, z [m]
    wb: Any
    wc: Any
    Sa: Any  # drops [m]
    Sb: Any
    Sc: Any


def sizes_of(n: Numbers) -> Sizes:
    """Return the lengths that the workspace depends on, (D, 1) each."""
    return Sizes(*np.broadcast_arrays(n.r, n.R, n.L))


def legs(n: Numbers, y: Any, theta: Any) -> Legs:
    """Return the legs at poses (G,); NaN out of reach."""
    sizes = sizes_of(n)
    return Legs(*extents(sizes, y, theta), *drops(sizes, y, theta))


def box_of(population: Population) -> Box:
    """Return the box of a problem."""
    if population.setting.box is None:
        raise InputError("box: measures over poses need a box of them: box=Box(y=..., theta=...)")
    return population.setting.box


def _margin(n: Numbers, population: Population, name: str) -> Any:
    """Return an exact margin of the whole box; see `p3dof.analysis.workspace.margins.BoxMargins`."""
    box, (lowest, highest) = box_of(population), population.setting.machine.limits.travel
    return getattr(box_margins(sizes_of(n), box.y, box.theta, highest - lowest), name)


def _transmission(n: Numbers, population: Population) -> Any:
    """Input indices S/L; output indices: sin of the angle between rods A and B, and that of C."""
    y, theta = box_of(population).poses
    x = legs(n, y, theta)
    between = (x.wa * x.Sb + x.wb * x.Sa) / n.L**2
    of_c = (np.cos(theta) * x.Sc - np.sin(theta) * x.wc) / n.L
    inputs = (x.Sa / n.L, x.Sb / n.L, x.Sc / n.L)
    return np.concatenate(np.broadcast_arrays(*inputs, between, of_c), axis=1)


def _rows(n: Numbers, y: Any, theta: Any) -> tuple[tuple[Any, ...], ...]:
    """Return the rows of J = ∂(λA, λB, λC)/∂(y, z, θ); see eq. of `reduced.slider_rates`."""
    x = legs(n, y, theta)
    arm = n.r * (np.cos(theta) - np.sin(theta) * x.wc / x.Sc)
    one = np.ones_like(x.Sa)
    none = np.zeros_like(x.Sa)
    return (-x.wa / x.Sa, one, none), (x.wb / x.Sb, one, none), (-y / x.Sc, one, arm)


def _inverse_rows(n: Numbers, population: Population) -> tuple[Any, ...]:
    """Return the rows of J⁻¹, solved by hand: A and B move y and z, C turns."""
    (ta, _, _), (tb, _, _), (tc, _, arm) = _rows(n, *box_of(population).poses)
    span = tb - ta
    by_y = (-1 / span, 1 / span, 0 * span)
    by_z = (tb / span, -ta / span, 0 * span)
    by_theta = tuple(((j == 2) - by_z[j] - tc * by_y[j]) / arm for j in range(3))
    return by_y, by_z, by_theta


def _accuracy(n: Numbers, population: Population, row: int) -> Any:
    """Return the sum of magnitudes of a row of J⁻¹: the worst that errors of all sliders make together."""
    total: Any = 0
    for entry in _inverse_rows(n, population)[row]:
        total = total + entry * np.sign(np.real(entry))
    return total


def _frequencies(n: Numbers, population: Population) -> Any:
    """Lowest natural frequency at the middle and the corners of the box.

    M of the dynamics; K = Jᵀ diag(k) J with the drive and the rods in series. A complex step moves the
    eigenvalue ω² as its eigenvector v says: v·(dK - ω² dM) v by v·M v.
    """
    y, theta = box_of(population).corners
    setting, model = population.setting, n.model
    x = reduced.shape(model, y, theta, _ARRAYS)
    M = _matrix(reduced.mass_matrix(model, x, y, _ARRAYS))
    area = np.pi * n.size("rod_radius") ** 2
    rod = setting.modulus * area / n.L
    K: Any = 0
    for row, drop, rods in zip(_rows(n, y, theta), (x.Sa, x.Sb, x.Sc), (1, 1, 2), strict=True):
        stiffness = 1 / (1 / setting.drive_stiffness + 1 / (rods * rod * (drop / n.L) ** 2))
        entries = [[stiffness * a * b for b in row] for a in row]
        K = K + _matrix(entries)
    return _lowest(K, M)


def _matrix(entries: Any) -> Any:
    """Return 3 × 3 entries as matrices (D, G, 3, 3)."""
    flat = np.broadcast_arrays(*(entry for row in entries for entry in row))
    return np.stack(flat, axis=-1).reshape(*flat[0].shape, 3, 3)


def _lowest(K: Any, M: Any) -> Any:
    good = np.isfinite(K).all(axis=(-1, -2)) & np.isfinite(M).all(axis=(-1, -2))
    safe = np.where(good[..., None, None], M, np.eye(3)), np.where(good[..., None, None], K, np.eye(3))
    L = np.linalg.cholesky(np.real(safe[0]))
    inverse = np.linalg.inv(L)
    turned = inverse @ np.real(safe[1]) @ np.swapaxes(inverse, -1, -2)
    values, vectors = np.linalg.eigh(turned)
    square, v = values[..., 0], (np.swapaxes(inverse, -1, -2) @ vectors[..., :, :1])[..., 0]  # v·M v = 1
    if np.iscomplexobj(K) or np.iscomplexobj(M):
        moved = np.imag(safe[1]) / STEP - square[..., None, None] * np.imag(safe[0]) / STEP
        square = square + 1j * STEP * np.einsum("...i,...ij,...j->...", v, moved, v)
    return np.where(good, np.sqrt(square) / (2 * np.pi), np.nan)


_ARRAYS: Namespace = np

OF_POSES = (
    *(
        ClosedForm(name, unit, "large", about, partial(_margin, name=margin))
        for name, unit, margin, about in (
            (
                "box_height",
                "m",
                "height",
                "height in z that the sliders' travel leaves for the whole box at once",
            ),
            ("singularity", "rad", "actuation", "least angle from det J = 0 in the box"),
            ("serial_reach", "", "serial", "least S/L of a leg over the box: drop by length"),
        )
    ),
    ClosedForm(
        *("transmission", "", "large"),
        "local transmission index LTI: least ITI and OTI over the box",
        _transmission,
    ),
    *(
        ClosedForm(
            *(f"accuracy_{name}", unit, "small"),
            f"largest |δ{sign}| of errors |δλ| ≤ 1 over the box",
            partial(_accuracy, row=row),
        )
        for row, (name, sign, unit) in enumerate(
            (("y", "y", "m/m"), ("z", "z", "m/m"), ("theta", "θ", "rad/m"))
        )
    ),
    ClosedForm(
        *("lowest_frequency", "Hz", "large"),
        "lowest natural frequency at the middle and the corners of the box, drives and rods elastic",
        _frequencies,
    ),
)
"""Measures over a box of poses."""


def loop_of(machine: Parameters) -> ClosedLoopModel:
    """Return the mechanism of a machine as a general closed-loop model."""
    mechanism = description.describe(machine)
    urdf = description.urdf(mechanism)
    sidecar = description.sidecar(mechanism.without_balance())  # the method adds it itself
    loop = ClosedLoopModel.from_urdf(urdf, sidecar, mimic=False)
    loop.model.gravity.linear = machine.gravity  # a URDF has no place for it
    loop.model.armature = armature_of(loop.model, machine.actuators)  # nor for this
    return loop


_RODS = ("leg_a", "leg_b", "rod_left", "rod_right")
_STEP = 1e-5  # of differences, as a share of a variable
_SAMPLES = 101  # most samples of the motion that reactions are found at


@dataclass(frozen=True)
class RodLoad(OfDesigns):
    """The worst compression by Euler's load, both ends hinged, or axial force by the section [Pa] of a rod.

    Gradients are central differences.
    """

    slow: bool = True

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        return np.asarray(self._of_rods(population).max(axis=1))

    def pieces(self, population: Population) -> Pieces:
        """Return that of each leg and rod, and the gradients."""
        return Pieces(self._of_rods(population), lambda: self._differences(population))

    def _differences(self, population: Population) -> FloatArray:
        values, slopes = population.values, []
        for index in range(values.shape[1]):
            step = np.zeros_like(values)
            step[:, index] = _STEP * np.maximum(np.abs(values[:, index]), 1e-3)
            moved = (Population(population.setting, values + sign * step) for sign in (1.0, -1.0))
            ahead, behind = (self._of_rods(each) for each in moved)
            slopes.append((ahead - behind) / (2 * step[:, [index]]))
        return np.stack(slopes, axis=-1)

    def _of_rods(self, population: Population) -> FloatArray:
        found = np.full((len(population), len(_RODS)), np.nan)
        radius = np.broadcast_to(population.numbers.size("rod_radius"), (len(population), 1))[:, 0]
        for index in np.flatnonzero(population.feasible):
            section = RodSection(diameter=2 * float(radius[index]), young=population.setting.modulus)
            try:
                rods = _rods(population, int(index), section)
            except P3dofError:
                continue
            area = math.pi * float(radius[index]) ** 2
            found[index] = [self._one(rod, area) for rod in rods]
        return found

    def _one(self, rod: RodCheck, area: float) -> float:
        if self.name == "rod_stress":
            return max(rod.compression, rod.tension) / area
        return rod.compression / rod.buckling


def _rods(population: Population, index: int, section: RodSection) -> list[RodCheck]:
    setting, machine = population.setting, population.designs[index]
    motion, load = setting.motion, setting.wrench
    every = max(1, -(-len(motion) // _SAMPLES))
    load = None if load is None else np.asarray(load)[::every]
    shift = [float(population.columns[n][index]) if n in population.columns else 0.0 for n in OFFSETS]
    pose, velocity, acceleration = (
        rows[::every] for rows in (motion.pose + np.array(shift), motion.velocity, motion.acceleration)
    )
    motion = Motion(motion.time[::every], pose, velocity, acceleration, check=False, start=motion.start)
    stiffness = replace(Stiffness(), rods=section)
    found = over_motion(loop_of(machine), machine, motion, "elastic", load, stiffness=stiffness)
    assert isinstance(found, Reactions)  # noqa: S101 - one way was asked for
    return [rod_check(machine, found, name, section) for name in _RODS]


OF_RODS = (
    RodLoad(
        *("rod_buckling_share", "", "small"),
        "largest compression of a leg or rod over the motion, by Euler's load",
    ),
    RodLoad("rod_stress", "Pa", "small", "largest axial stress of a leg or rod over the motion"),
)
"""Measures of legs and rods."""


def _width(n: Numbers, population: Population) -> Any:
    return _column(2 * n.R, population)


def _mass(n: Numbers, population: Population) -> Any:
    """All that moves moves along z: the entry of the mass matrix."""
    none = np.zeros(1)
    x = reduced.shape(n.model, none, none, np)
    return _column(reduced.mass_matrix(n.model, x, none, np)[1][1], population)


def _bending(n: Numbers, population: Population) -> Any:
    """First natural frequency of a rod between hinges, (π / 2 L²) √(E I / μ), with √(I/A) = radius / 2."""
    radius = n.size("rod_radius")
    return _column(
        np.pi * radius / (4 * n.L**2) * np.sqrt(population.setting.modulus / n.density), population
    )


def _buckling(n: Numbers, population: Population) -> Any:
    """Euler's load of a rod between two hinges, π² E I / L²."""
    radius = n.size("rod_radius")
    return _column(np.pi**3 * population.setting.modulus * radius**4 / (4 * n.L**2), population)


def _clearance(n: Numbers, population: Population) -> Any:
    """Gaps between solids at all poses of the box or at home: sliders and plate, rods, sliders."""
    edge, rod, corner = n.size("slider_edge"), n.size("rod_radius"), n.size("corner_radius")
    thickness = n.size("plate_thickness")
    box = population.setting.box
    y, theta = (np.zeros(1), np.zeros(1)) if box is None else box.poses
    x = legs(n, y, theta)
    edges = thickness / 2 * np.cos(theta) + corner * np.abs(np.sin(theta))  # of the plate, upward
    gaps = [
        np.maximum(across - edge / 2 - corner, drop - edge / 2 - upward)
        for across, drop, upward in (
            (x.wa, x.Sa, thickness / 2),
            (x.wb, x.Sb, thickness / 2),
            (x.wc, x.Sc, edges),
        )
    ]
    gaps += [_column(2 * n.b - 2 * rod, population), _column(n.R - edge, population)]
    rows = [np.broadcast_to(gap, (len(population), np.shape(gap)[-1])) for gap in gaps]
    return np.concatenate(rows, axis=1)


def _column(values: Any, population: Population) -> Any:
    return np.broadcast_to(values, (len(population), 1))


OF_SOLIDS = (
    ClosedForm("width", "m", "small", "width of the base between the guides of A and B, 2R", _width),
    ClosedForm("moving_mass", "kg", "small", "moving mass", _mass),
    ClosedForm(
        "rod_frequency", "Hz", "large", "first bending frequency of a rod between its hinges", _bending
    ),
    ClosedForm("rod_buckling", "N", "large", "Euler's buckling load of a rod between its hinges", _buckling),
    ClosedForm("clearance", "m", "large", "least gap between solids that come side by side", _clearance),
)
"""Measures of the machine as it stands."""
