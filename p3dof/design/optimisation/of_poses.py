"""Measures over a box of poses, in closed forms: reach, singularity, height, transmission, stiffness."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from p3dof._base.algebra import Namespace
from p3dof._base.errors import InputError
from p3dof.analysis.workspace.boxes import box_margins
from p3dof.analysis.workspace.closed_forms import Sizes, drops, extents
from p3dof.closed_form.compiled import reduced
from p3dof.design.optimisation.box import Box
from p3dof.design.optimisation.measure import ClosedForm
from p3dof.design.optimisation.population import STEP, Numbers, Population


class Legs(NamedTuple):
    """The legs at poses, (D, G) each.

    Parameters
    ----------
    wa, wb, wc : ndarray
        Horizontal extents; that of C in the plane x, z [m].
    Sa, Sb, Sc : ndarray
        Drops [m].
    """

    wa: Any
    wb: Any
    wc: Any
    Sa: Any
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
    """Return the box of a problem.

    Raises
    ------
    InputError
        If it has none.
    """
    if population.setting.box is None:
        raise InputError("box: measures over poses need a box of them: box=Box(y=..., theta=...)")
    return population.setting.box


def _margin(n: Numbers, population: Population, name: str) -> Any:
    """Return an exact margin of the whole box; see `p3dof.analysis.workspace.boxes.BoxMargins`."""
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
    ClosedForm(
        "box_height",
        "m",
        "large",
        "height in z that the sliders' travel leaves for the whole box at once",
        partial(_margin, name="height"),
    ),
    ClosedForm(
        "singularity",
        "rad",
        "large",
        "least angle from det J = 0 in the box",
        partial(_margin, name="actuation"),
    ),
    ClosedForm(
        "serial_reach",
        "",
        "large",
        "least S/L of a leg over the box: drop by length",
        partial(_margin, name="serial"),
    ),
    ClosedForm(
        "transmission",
        "",
        "large",
        "local transmission index LTI: least ITI and OTI over the box",
        _transmission,
    ),
    ClosedForm(
        "accuracy_y",
        "m/m",
        "small",
        "largest |δy| of errors |δλ| ≤ 1 over the box",
        partial(_accuracy, row=0),
    ),
    ClosedForm(
        "accuracy_z",
        "m/m",
        "small",
        "largest |δz| of errors |δλ| ≤ 1 over the box",
        partial(_accuracy, row=1),
    ),
    ClosedForm(
        "accuracy_theta",
        "rad/m",
        "small",
        "largest |δθ| of errors |δλ| ≤ 1 over the box",
        partial(_accuracy, row=2),
    ),
    ClosedForm(
        "lowest_frequency",
        "Hz",
        "large",
        "lowest natural frequency at the middle and the corners of the box, drives and rods elastic",
        _frequencies,
    ),
)
"""Measures over a box of poses."""
