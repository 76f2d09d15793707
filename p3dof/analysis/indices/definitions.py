"""What each index is: its parts, unit, definition and source, for data sets, tables and figures."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, as_floats, batch_of, meant, positive, shown
from p3dof._base.errors import InputError
from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.samples import OnInvalid
from p3dof._base.tables import (
    NONE,
    POSE_COLUMNS,
    ShownInNotebook,
    Table,
    Tabular,
    columns_by,
    html_of,
    notebook_html,
    number,
    require_xarray,
    table_of,
)
from p3dof._base.version import __version__
from p3dof.analysis.reactions.stiffness import RodSection
from p3dof.analysis.workspace.closed_forms import Sizes, drops, extents
from p3dof.closed_form.kinematics import holdable, singularity
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import LEGS, Limits, Parameters
from p3dof.methods import Method
from p3dof.methods.compiled import ForceDerivatives

_LEGS = ("a", "b", "c")
_POSE = ("y", "z", "theta")
_ORDER = ("1", "2", "3")
_LINES = "m/s, m/s, rad/s"


@dataclass(frozen=True)
class Definition(Readable):
    """One index.

    Parameters
    ----------
    name : str
        Attribute of `Indices`.
    unit : str
        Of it, or one for each part, with commas.
    meaning : str
        Its definition.
    source : str
        Who defined it; empty for what needs no source.
    parts : tuple of str
        Of an index of several numbers; empty for one number.
    """

    name: str
    unit: str
    meaning: str
    source: str = ""
    parts: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of its numbers, such as ``"iti_a"``."""
        return tuple(f"{self.name}_{part}" for part in self.parts) or (self.name,)

    def unit_of(self, column: str) -> str:
        """Return the unit of one of its columns."""
        units = self.unit.split(", ")
        return units[self.columns.index(column)] if len(units) > 1 else units[0]

    def describe(self, column: str, length: float | None = None) -> str:
        """Return the definition of one of its columns, with the characteristic length where it has one."""
        part = f", {column.removeprefix(self.name + '_')}" if self.parts else ""
        told = f"{self.meaning}{part}"
        if length is not None and "ℓ" in self.meaning:
            told += f"; ℓ = {length:g} m"
        return told


_ROSYID = "Rosyid, El-Khasawneh, Alazzam, Mech. Sci. 11 (2020) 49"
_WANG = "Wang, Wu, Liu, Mech. Mach. Theory 45 (2010) 1462; Takeda, Funabashi (1995)"

DEFINITIONS = {
    one.name: one
    for one in (
        Definition("determinant", "m/rad", "det J of ∂(λA, λB, λC)/∂(y, z, θ)", "Gosselin, Angeles (1990)"),
        Definition("actuation", "rad", "angle from det J = 0, positive on home's side"),
        Definition("serial", "1", "S/L of each leg, the cosine of its angle from the vertical", "", _LEGS),
        Definition(
            "sigma",
            "1",
            "singular values of the homogeneous Jacobian J diag(1, 1, 1/ℓ), the largest first",
            "Salisbury, Craig (1982)",
            _ORDER,
        ),
        Definition("condition", "1", "largest by least singular value of J diag(1, 1, 1/ℓ)", _ROSYID),
        Definition("lci", "1", "1 / condition, the local conditioning index; depends on ℓ", _ROSYID),
        Definition(
            "accuracy",
            "1, 1, rad/m",
            "row sums of |J⁻¹|: largest error of the pose for errors of all sliders up to 1",
            "Merlet, J. Mech. Des. 128 (2006) 199",
            _POSE,
        ),
        Definition("iti", "1", "input transmission: |rod direction · slider direction| = S/L", _WANG, _LEGS),
        Definition(
            "oti",
            "1",
            "output transmission: |rod direction · v| / |v|, v the velocity of the leg's joint at the "
            "platform when its slider alone moves",
            _WANG,
            _LEGS,
        ),
        Definition(
            "lti", "1", "least of all ITI and OTI, the local transmission index; good from 0.7", _WANG
        ),
        Definition(
            "lone_velocity",
            _LINES,
            "largest velocity along one coordinate alone, with sliders within the speed limit",
            "",
            _POSE,
        ),
        Definition(
            "lone_force",
            "N, N, N m, N, N, N m",
            "least and largest force on the surroundings along one coordinate alone, at rest, with actuators "
            "within the force limit, gravity included",
            "",
            tuple(f"{end}_{name}" for end in ("least", "largest") for name in _POSE),
        ),
        Definition(
            "lone_acceleration",
            "m/s^2, m/s^2, rad/s^2, m/s^2, m/s^2, rad/s^2",
            "least and largest acceleration along one coordinate alone, from rest, with actuators within the "
            "force limit, gravity included",
            "",
            tuple(f"{end}_{name}" for end in ("least", "largest") for name in _POSE),
        ),
        Definition(
            "acceleration_ball",
            "m/s^2",
            "radius of the largest ball of accelerations (y, z, ℓ θ) from rest within the force limit",
            _ROSYID,
        ),
        Definition("holding", "N", "static actuator forces", "", _LEGS),
        Definition(
            "actuator_inertia",
            "kg",
            "eigenvalues of J⁻ᵀ M J⁻¹, the inertia reflected to the sliders, smallest first",
            "Cammarata, Angeles (2010)",
            _ORDER,
        ),
        Definition("reflected_mass", "kg", "diagonal of J⁻ᵀ M J⁻¹: one slider moved alone", "", _LEGS),
        Definition(
            "inertia_ellipsoid",
            "kg",
            "eigenvalues of M in (y, z, ℓ θ), of the generalized inertia ellipsoid, the least first",
            "Asada, J. Dyn. Syst. Meas. Control 105 (1983) 131",
            _ORDER,
        ),
        Definition(
            "gie",
            "1",
            "least by largest eigenvalue of M in (y, z, ℓ θ): 1 is isotropic inertia",
            "Asada, J. Dyn. Syst. Meas. Control 105 (1983) 131",
        ),
        Definition(
            "dynamic_manipulability",
            "m^2 rad/(s^6 N^3)",
            "|det J| / det M: the volume of accelerations that forces in a unit cube give, by that cube",
            "Yoshikawa (1985)",
        ),
        Definition(
            "frequency",
            "Hz",
            "natural frequencies with sliders held by elastic drives, rods elastic along themselves, and the "
            "stiffness of gravity; the lowest first",
            "",
            _ORDER,
        ),
    )
}
"""Every index by its name."""

COLUMNS = {column: one for one in DEFINITIONS.values() for column in one.columns}
"""The definition of every single number, by its name."""


def dataset_of(
    found: Any, columns: Mapping[str, NDArray[Any]], dims: Sequence[str], coords: Mapping[str, Any]
) -> Any:
    """Return columns of indices as an `xarray.Dataset`."""
    if len(dims) != len(found.shape):
        raise InputError(f"dims: expected {len(found.shape)} names, one for each axis, got {len(dims)}")
    variables = {}
    for name, values in columns.items():
        one = COLUMNS[name]
        attributes = {"units": one.unit_of(name), "long_name": one.describe(name, found.length)}
        variables[name] = (tuple(dims), values, attributes | ({"source": one.source} if one.source else {}))
    geometry, limits = found.machine.parameters.geometry, found.limits
    told: dict[str, Any] = {
        "title": "performance indices of a 3-DOF parallel manipulator",
        "source": f"p3dof {__version__}",
        "r [m]": geometry.r,
        "R [m]": geometry.R,
        "L [m]": geometry.L,
        "characteristic length [m]": found.length,
        "force limit [N]": limits.force,
        "speed limit [m/s]": limits.speed,
        "drive stiffness [N/m]": found.drive_stiffness,
    }
    attributes = {name.partition(" [")[0].replace(" ", "_"): value for name, value in told.items()}
    return require_xarray().Dataset(variables, coords=coords, attrs=attributes)


def write_dataset(dataset: Any, path: str | os.PathLike[str]) -> Path:
    """Write a map to a netCDF file, which programs for arrays with units read; no other library is needed.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `Workspace.map` or `Indices.to_dataset`. Its own ``to_zarr`` writes Zarr, with zarr installed.
    path : path-like
        The file, which ends in ``.nc``; replaced whole or not at all.

    Raises
    ------
    InputError
        If the ending is another.
    FileError
        If the file cannot be written.
    """
    suffix_of(path, "map")
    plain = dataset.copy()
    for name, values in plain.variables.items():
        if values.dtype == np.bool_:
            plain[name] = values.astype(np.int8)
    return write_atomic(path, bytes(plain.to_netcdf(engine="scipy")))


SIGNS = np.array([[a, b, c] for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)])
"""The corners of a box, (8, 3)."""


def lone_velocities(jacobian: FloatArray, speed: float) -> FloatArray:
    """Return the largest velocity along each coordinate alone; ndarray, shape (n, 3)."""
    found: FloatArray = speed / np.abs(jacobian).max(axis=-2)
    return found


def lone_ranges(held: FloatArray, columns: FloatArray, force: float) -> FloatArray:
    """Return the range of each coordinate's load alone that forces within their limit allow.

    The forces are held + column · load.

    Least loads of the three coordinates, then the largest; NaN where the machine cannot be held.
    """
    size, lean = np.abs(columns), np.sign(columns) * held[..., None]
    with np.errstate(divide="ignore"):  # an actuator that a load does not concern has room without end
        up, down = ((force - lean) / size).min(axis=-2), ((force + lean) / size).min(axis=-2)
    ends = np.concatenate([-down, up], axis=-1)
    return np.where(_holdable(held, force)[..., None], ends, np.nan)


def ball(held: FloatArray, columns: FloatArray, force: float) -> FloatArray:
    """Return the largest ball of loads, min_i (force - |held_i|) / ‖row_i‖; NaN where it cannot be held."""
    radius = ((force - np.abs(held)) / np.linalg.norm(columns, axis=-1)).min(axis=-1)
    return np.where(_holdable(held, force), radius, np.nan)


def _holdable(held: FloatArray, force: float) -> NDArray[np.bool_]:
    return np.asarray((np.abs(held) <= force).all(axis=-1))


DRIVE = 1e7
"""Stiffness of each drive where none is given [N/m]: a guess for a ball screw of this size."""


def stiffness_of_drives(given: Any) -> FloatArray:
    """Return the stiffness of the three drives, (3,) [N/m]."""
    values = as_floats("drive_stiffness", given)
    if values.shape not in ((), (3,)) or not (values > 0).all():
        raise InputError("drive_stiffness: expected a positive number, or three [N/m]")
    return np.broadcast_to(values, (3,)).copy()


def rod_compliances(parameters: Parameters, rods: RodSection | None) -> FloatArray:
    """Return how rods give way along themselves: L / (n E A) of A, B, and the two of C (3,) [m/N]."""
    if rods is None:
        return np.zeros(3)
    length, bodies = parameters.geometry.L, parameters.bodies
    stiffness = np.zeros(3)
    for name, leg in (("leg_a", 0), ("leg_b", 1), ("rod_left", 2), ("rod_right", 2)):
        radius = rods.radius(length, getattr(bodies, name).mass)
        stiffness[leg] += rods.young * np.pi * radius**2 / length
    return 1 / stiffness


def frequencies(
    jacobian: FloatArray,
    mass: FloatArray,
    by_pose: FloatArray,
    iti: FloatArray,
    drives: FloatArray,
    rods: FloatArray,
) -> FloatArray:
    """Return the natural frequencies about rest, K = Jᵀ diag(k) J + K_g; ndarray, shape (n, 3).

    Along its slider a rod gives way by its compliance / ITI². With drives held in place, the load of gravity
    and preload changes with the pose: K_g = Jᵀ ∂f/∂x, f the static actuator forces.
    """
    k = 1 / (1 / drives + rods / iti**2)
    transposed = np.swapaxes(jacobian, -1, -2)
    K = transposed @ (k[..., None] * jacobian) + transposed @ by_pose
    K = (K + np.swapaxes(K, -1, -2)) / 2
    good = np.isfinite(K).all(axis=(-1, -2)) & np.isfinite(mass).all(axis=(-1, -2))
    found = np.full(iti.shape, np.nan)
    if good.any():
        inverse = np.linalg.inv(np.linalg.cholesky(mass[good]))
        squares = np.linalg.eigvalsh(inverse @ K[good] @ np.swapaxes(inverse, -1, -2))
        with np.errstate(invalid="ignore"):
            found[good] = np.sqrt(squares) / (2 * np.pi)
    return found


def input_transmission(sizes: Sizes, y: FloatArray, theta: FloatArray) -> FloatArray:
    """Return ITI of A, B, C = S/L, (n, 3); the rod of leg C is the middle line of the parallelogram."""
    found: FloatArray = np.stack(drops(sizes, y, theta), axis=-1) / sizes.L
    return found


def output_transmission(sizes: Sizes, y: FloatArray, theta: FloatArray) -> FloatArray:
    """Return OTI of A, B, C, ``|rod direction · v| / |v|``, v the velocity of the leg's platform joint.

    v is what it is when the leg's own slider alone moves. With sliders B and C held, P can only turn about
    the slider of B: OTI of A (and of B) is the sine of the angle between the rods A and B. With A and B held
    the platform can only turn about P: OTI of C is the cosine of the angle between its arm's motion and the
    rod.

    From 0 (actuation singularity) to 1; NaN out of reach.
    """
    wa, wb, wc = extents(sizes, y, theta)
    a, b, c = drops(sizes, y, theta)
    across = np.abs(wa * b + wb * a) / sizes.L**2
    return np.stack([across, across, np.abs(np.cos(theta) * c - np.sin(theta) * wc) / sizes.L], axis=-1)


STEEL_RODS = RodSection()
"""Round rods of steel, of the diameter that gives each its mass."""


class IndicesMachine(Protocol):
    """What indices are computed of: `p3dof.Manipulator`."""

    @property
    def parameters(self) -> Parameters:
        """The machine."""

    def jacobian(self, pose: ArrayLike, *, on_invalid: OnInvalid = ..., method: Method = ...) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ) (..., 3, 3)."""

    def mass_matrix(
        self, pose: ArrayLike, *, on_invalid: OnInvalid = ..., method: Method = ...
    ) -> FloatArray:
        """Return the mass matrix in y, z, θ (..., 3, 3)."""

    def force_derivatives(
        self, pose: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, *, on_invalid: OnInvalid = ...
    ) -> ForceDerivatives:
        """Return the actuator forces and their derivatives."""


class Indices(ShownInNotebook, Tabular):
    """Performance indices at poses, as arrays of their shape; each is computed when it is first asked for.

    J mixes m/m and m/rad, so that condition numbers need a characteristic length ℓ to compare turning with
    shifting, and depend on it: at home of the paper's machine the condition is 3.23 for ℓ = r, 3.12 for the
    best ℓ. What needs no ℓ - accuracy, transmission, reflected inertia, capabilities of single axes,
    frequencies - says more. Definitions, units and sources are in `p3dof.analysis.indices.DEFINITIONS`.

    Parameters
    ----------
    machine : Manipulator
        The machine.
    pose : array-like, shape (..., 3)
        y [m], z [m], θ [rad]; z matters for forces of a machine counterbalanced by springs only.
    length : float, optional
        Characteristic length ℓ [m]; r of the machine without it.
    on_invalid : {"raise", "nan"}
        Raise for poses that are not finite, out of reach or singular, or leave NaN, with their `reason`.
    limits : Limits, optional
        Of speed and force; the machine's own without it.
    drive_stiffness : float or array-like, shape (3,)
        Of the drives along their guides [N/m]; 1e7, a guess, by default.
    rods : RodSection, optional
        Section and material of legs and rods; steel, and as heavy as they are, by default; None for rigid.

    Raises
    ------
    ReachError, SingularityError
        For the first invalid pose.
    InputError
        If an argument does not fit.
    """

    def __init__(
        self,
        machine: IndicesMachine,
        pose: ArrayLike,
        length: float | None = None,
        *,
        on_invalid: OnInvalid = "raise",
        limits: Limits | None = None,
        drive_stiffness: ArrayLike = DRIVE,
        rods: RodSection | None = STEEL_RODS,
    ) -> None:
        if not isinstance(getattr(machine, "parameters", None), Parameters):
            raise InputError(f"machine: expected a Manipulator, got {shown(machine)}")
        if not isinstance(limits, Limits | None):
            raise InputError(f"limits: expected Limits, got {shown(limits)}")
        geometry = machine.parameters.geometry
        if not isinstance(rods, RodSection | None):
            raise InputError(f"rods: expected a RodSection or None, got {shown(rods)}")
        self._machine, self._rods, self._drives = machine, rods, stiffness_of_drives(drive_stiffness)
        self.limits = machine.parameters.limits if limits is None else limits
        self.length = geometry.r if length is None else positive("length", length, InputError)
        self.pose = batch_of("pose", pose, 3)
        placed = holdable(geometry, states_of(self.pose, on_invalid=on_invalid))
        self._rows: FloatArray = np.ascontiguousarray(placed.states.pose.reshape(-1, 3))
        self._sizes = Sizes.of(geometry)
        self._scale = np.array([1.0, 1.0, 1 / self.length])

    def __repr__(self) -> str:
        shape = "one pose" if not self.shape else f"poses {self.shape}"
        return f"Indices({shape}, length {self.length:g} m)"

    def __len__(self) -> int:
        return len(self.pose) if self.shape else 1

    @property
    def machine(self) -> IndicesMachine:
        """The machine."""
        return self._machine

    @property
    def drive_stiffness(self) -> FloatArray:
        """Of the three drives, (3,) [N/m]."""
        return self._drives

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the batch."""
        return self.pose.shape[:-1]

    # Which poses

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Which poses the machine can be held at, shape (...)."""
        return np.asarray(np.isfinite(self._rows).all(axis=-1)).reshape(self.shape)

    @cached_property
    def reason(self) -> NDArray[np.str_]:
        """Why a pose has no indices, (...): ``"serial A"``, ``"actuation"``, ``"not finite"``; else empty."""
        known = singularity(self._machine.parameters.geometry, self.pose)
        worst = np.argmin(np.nan_to_num(known.serial), axis=-1)
        legs = np.array([f"serial {leg}" for leg in LEGS])[worst]
        told = np.where(np.nan_to_num(known.serial.min(axis=-1), nan=-1.0) > 0, "actuation", legs)
        told = np.where(np.isfinite(self.pose).all(axis=-1), told, "not finite")
        return np.where(self.valid, "", told)

    # Kinematics

    @cached_property
    def jacobian(self) -> FloatArray:
        """J = ∂(λA, λB, λC)/∂(y, z, θ), shape (..., 3, 3) [1, 1, m/rad]."""
        return self._shaped(self._jacobians)

    @cached_property
    def determinant(self) -> FloatArray:
        """Det J [m/rad], shape (...); zero at the actuation singularity. Gosselin and Angeles (1990)."""
        return self._shaped(self._det)

    @cached_property
    def actuation(self) -> FloatArray:
        """Angle from det J = 0 [rad], positive on home's side, shape (...); see `Singularity`."""
        return singularity(self._machine.parameters.geometry, self._rows).actuation.reshape(self.shape)

    @cached_property
    def serial(self) -> FloatArray:
        """S/L of A, B, C, the cosines of their angles from the vertical, shape (..., 3); as `iti`."""
        return self.iti

    @cached_property
    def sigma(self) -> FloatArray:
        """Singular values of the homogeneous Jacobian J diag(1, 1, 1/ℓ), the largest first, shape (..., 3).

        Dimensionless. Salisbury and Craig (1982).
        """
        return self._shaped(
            _of_finite(lambda J: np.linalg.svd(J, compute_uv=False), self._jacobians * self._scale, 1)
        )

    @cached_property
    def condition(self) -> FloatArray:
        """Condition number of J diag(1, 1, 1/ℓ), 1 or more, shape (...).

        It depends on ℓ. Rosyid, El-Khasawneh, Alazzam, Mech. Sci. 11 (2020) 49.
        """
        with np.errstate(divide="ignore"):  # singular, or as good as that by the length: infinite
            return np.asarray(self.sigma[..., 0] / self.sigma[..., 2])

    @cached_property
    def lci(self) -> FloatArray:
        """Local conditioning index, 1 / `condition`, from 0 to 1, shape (...).

        Its mean over a workspace is the global one: ``workspace.mean("lci")``. Gosselin, Angeles (1991).
        """
        return np.asarray(1 / self.condition)

    @cached_property
    def accuracy(self) -> FloatArray:
        """Largest errors of y, z [m/m] and θ [rad/m] for slider errors of up to 1, shape (..., 3).

        Row sums of ``|J⁻¹|``: nothing in it can be chosen. Merlet, J. Mech. Des. 128 (2006) 199.
        """
        return self._shaped(np.abs(self._inverse).sum(axis=-1))

    # Transmission

    @cached_property
    def iti(self) -> FloatArray:
        """Input transmission of A, B, C, ``|rod direction · slider direction| = S/L``, shape (..., 3).

        From 0 (the leg is horizontal) to 1. Wang, Wu, Liu, Mech. Mach. Theory 45 (2010) 1462.
        """
        return self._shaped(input_transmission(self._sizes, *self._y_theta))

    @cached_property
    def oti(self) -> FloatArray:
        """Output transmission of A, B, C: ``|rod direction · v| / |v|``, shape (..., 3).

        v is the velocity of the leg's joint at the platform when its slider alone moves. From 0 (actuation
        singularity) to 1; A and B have the same, the sine of the angle between their rods. Wang, Wu, Liu
        (2010); Takeda and Funabashi (1995).
        """
        return self._shaped(output_transmission(self._sizes, *self._y_theta))

    @cached_property
    def lti(self) -> FloatArray:
        """Local transmission index, the least of all ITI and OTI, shape (...); good from 0.7.

        Wang, Wu, Liu (2010).
        """
        return np.asarray(np.minimum(self.iti.min(axis=-1), self.oti.min(axis=-1)))

    # What the limits allow

    @cached_property
    def lone_velocity(self) -> FloatArray:
        """Largest ẏ, ż [m/s], θ̇ [rad/s], each alone, within the speed limit, shape (..., 3).

        ``v / max_i |J_ik|``: the polytope's cuts with the axes.
        """
        return self._shaped(lone_velocities(self._jacobians, self.limits.speed))

    @cached_property
    def velocity_vertices(self) -> FloatArray:
        """Corners of the polytope of velocities, J⁻¹ (±v, ±v, ±v), shape (..., 8, 3) [m/s, m/s, rad/s]."""
        return self._shaped(self.limits.speed * SIGNS @ np.swapaxes(self._inverse, -1, -2))

    @cached_property
    def holding(self) -> FloatArray:
        """Static forces of A, B, C, with gravity and counterbalance, shape (..., 3) [N]."""
        return self._shaped(self._at_rest.forces)

    @cached_property
    def lone_force(self) -> FloatArray:
        """Least, then largest forces on the surroundings along y, z [N] and moment about y [N m], each alone.

        Shape (..., 6); at rest, with gravity, forces within their limit; NaN where it cannot be held.
        """
        columns = np.swapaxes(self._inverse, -1, -2)
        return self._shaped(lone_ranges(self._at_rest.forces, columns, self.limits.force))

    @cached_property
    def force_vertices(self) -> FloatArray:
        """Corners of the polytope of forces on the surroundings, Jᵀ((±F, ±F, ±F) - f0), (..., 8, 3) [N, N m].

        Gravity shifts it by the static forces f0.
        """
        return self._shaped((self.limits.force * SIGNS - self._at_rest.forces[:, None, :]) @ self._jacobians)

    @cached_property
    def lone_acceleration(self) -> FloatArray:
        """Least, then largest ÿ, z̈ [m/s²], θ̈ [rad/s²], each alone, from rest, shape (..., 6).

        f0 + J⁻ᵀ M e_k a within the force limit: gravity shifts it. NaN where the machine cannot be held.
        """
        return self._shaped(lone_ranges(self._at_rest.forces, self._loads, self.limits.force))

    @cached_property
    def acceleration_vertices(self) -> FloatArray:
        """Corners of the polytope of accelerations from rest, M⁻¹ Jᵀ ((±F, ±F, ±F) - f0), (..., 8, 3)."""
        generalized = (self.limits.force * SIGNS - self._at_rest.forces[:, None, :]) @ self._jacobians
        return self._shaped(generalized @ _of_finite(np.linalg.inv, self._masses, 2))

    @cached_property
    def acceleration_ball(self) -> FloatArray:
        """Radius of the largest ball of accelerations in (y, z, ℓ θ) from rest [m/s²], shape (...).

        ``min_i (F - |f0_i|) / ‖row_i(J⁻ᵀ M diag(1, 1, 1/ℓ))‖``; NaN where the machine cannot be held.
        """
        return self._shaped(ball(self._at_rest.forces, self._loads * self._scale, self.limits.force))

    # Inertia and stiffness

    @cached_property
    def mass_matrix(self) -> FloatArray:
        """M in y, z, θ, shape (..., 3, 3) [kg, kg m, kg m²]."""
        return self._shaped(self._masses)

    @cached_property
    def actuator_inertia(self) -> FloatArray:
        """Eigenvalues of J⁻ᵀ M J⁻¹ [kg], the least first, shape (..., 3): inertia at the sliders.

        It needs no ℓ. Cammarata, Angeles (2010).
        """
        return self._shaped(_of_finite(np.linalg.eigvalsh, self._felt, 1))

    @cached_property
    def reflected_mass(self) -> FloatArray:
        """Diagonal of J⁻ᵀ M J⁻¹ [kg], of A, B, C: each moved alone, shape (..., 3)."""
        return self._shaped(np.diagonal(self._felt, axis1=-2, axis2=-1))

    @cached_property
    def inertia_ellipsoid(self) -> FloatArray:
        """Eigenvalues of M in (y, z, ℓ θ) [kg], the least first, shape (..., 3).

        Those of the generalized inertia ellipsoid. Asada, J. Dyn. Syst. Meas. Control 105 (1983) 131.
        """
        scaled = self._scale[:, None] * self._masses * self._scale
        return self._shaped(_of_finite(np.linalg.eigvalsh, scaled, 1))

    @cached_property
    def gie(self) -> FloatArray:
        """Least by largest eigenvalue of M in (y, z, ℓ θ), from 0 to 1, shape (...). Asada (1983)."""
        return np.asarray(self.inertia_ellipsoid[..., 0] / self.inertia_ellipsoid[..., 2])

    @cached_property
    def dynamic_manipulability(self) -> FloatArray:
        """``|det J| / det M = 1 / |det(J⁻ᵀ M)|`` [m² rad / (s⁶ N³)], shape (...). Yoshikawa (1985).

        The volume of accelerations that forces in a unit cube give, by the volume of this cube.
        """
        return self._shaped(np.abs(self._det) / _of_finite(np.linalg.det, self._masses, 0))

    @cached_property
    def frequency(self) -> FloatArray:
        """Natural frequencies at rest, sliders held by their drives, the lowest first, shape (..., 3) [Hz].

        M and K = Jᵀ diag(k) J + K_g; 1/k = 1/k_drive + L/(n E A ITI²), n = 1, 1, 2 rods; K_g is the stiffness
        of gravity and counterbalance. Bodies are rigid but for the length of the rods.
        """
        compliances = rod_compliances(self._machine.parameters, self._rods)
        iti = input_transmission(self._sizes, *self._y_theta)
        rest = self._at_rest.by_pose
        return self._shaped(frequencies(self._jacobians, self._masses, rest, iti, self._drives, compliances))

    # By name

    @property
    def columns(self) -> dict[str, FloatArray]:
        """All indices, each of their numbers by its name, such as ``"iti_a"``, (...)."""
        return {name: self.column(name) for name in COLUMNS}

    def column(self, name: str) -> FloatArray:
        """Return one number of an index, shape (...).

        Parameters
        ----------
        name : str
            Of `p3dof.analysis.indices.COLUMNS`, such as ``"lti"`` or ``"frequency_1"``.

        Raises
        ------
        InputError
            If there is no such index.
        """
        return columns_of(self, (name,))[name]

    def to_columns(self, *names: str) -> dict[str, FloatArray]:
        """Return poses and indices, by name and unit; one pose a row.

        Parameters
        ----------
        *names : str
            Of indices or of their columns; all of them without any.

        Raises
        ------
        InputError
            If there is no such index.
        """
        found = columns_by("{}", POSE_COLUMNS, self.pose)
        for name, values in columns_of(self, names or tuple(COLUMNS)).items():
            found[f"{name} [{COLUMNS[name].unit_of(name)}]"] = np.ravel(values)
        return found

    def to_dataset(
        self, *names: str, dims: Sequence[str] | None = None, coords: Mapping[str, Any] | None = None
    ) -> Any:
        """Return indices as an `xarray.Dataset`, with units and definitions as attributes.

        Parameters
        ----------
        *names : str
            Of indices or of their columns; all of them without any.
        dims : sequence of str, optional
            Names of the axes; ``pose`` for one, ``pose_0``, ``pose_1``, ... for more.
        coords : mapping, optional
            Coordinates as of `xarray.Dataset`; y, z and θ of the poses by default.

        Raises
        ------
        InputError
            If there is no such index, or names do not fit the axes.
        MissingExtraError
            If xarray is not installed.
        """
        axes = dims or (["pose"] if len(self.shape) == 1 else [f"pose_{k}" for k in range(len(self.shape))])
        if coords is None:
            units = {"y": "m", "z": "m", "theta": "rad"}
            coords = {
                name: (tuple(axes), self.pose[..., k], {"units": unit})
                for k, (name, unit) in enumerate(units.items())
            }
        return dataset_of(self, columns_of(self, names or tuple(COLUMNS)), axes, coords)

    # Within

    @property
    def _y_theta(self) -> tuple[FloatArray, FloatArray]:
        return self._rows[:, 0], self._rows[:, 2]

    @cached_property
    def _jacobians(self) -> FloatArray:
        return self._machine.jacobian(self._rows, on_invalid="nan", method="compiled")

    @cached_property
    def _det(self) -> FloatArray:
        return _of_finite(np.linalg.det, self._jacobians, 0)

    @cached_property
    def _inverse(self) -> FloatArray:
        return _of_finite(np.linalg.inv, self._jacobians, 2)

    @cached_property
    def _masses(self) -> FloatArray:
        return self._machine.mass_matrix(self._rows, on_invalid="nan", method="compiled")

    @cached_property
    def _loads(self) -> FloatArray:
        """J⁻ᵀ M: forces of the actuators for accelerations."""
        return np.asarray(np.swapaxes(self._inverse, -1, -2) @ self._masses)

    @cached_property
    def _felt(self) -> FloatArray:
        """J⁻ᵀ M J⁻¹, symmetric."""
        found = self._loads @ self._inverse
        return np.asarray((found + np.swapaxes(found, -1, -2)) / 2)

    @cached_property
    def _at_rest(self) -> ForceDerivatives:
        still = np.zeros(3)
        return self._machine.force_derivatives(self._rows, still, still, on_invalid="nan")

    def _shaped(self, rows: FloatArray) -> FloatArray:
        return np.asarray(rows).reshape((*self.shape, *rows.shape[1:]))


def columns_of(found: Indices, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return numbers of indices by name; the name of an index of several numbers stands for all of them."""
    columns: dict[str, FloatArray] = {}
    for name in check_names(names):
        one = COLUMNS[name]
        values = getattr(found, one.name)
        columns[name] = values[..., one.parts.index(name[len(one.name) + 1 :])] if one.parts else values
    return columns


def check_names(names: Any) -> tuple[str, ...]:
    """Return the columns that names stand for, or raise `InputError` for one that is none."""
    found: list[str] = []
    for name in (names,) if isinstance(names, str) else names:
        if isinstance(name, str) and name in COLUMNS:
            found.append(name)
        elif isinstance(name, str) and name in DEFINITIONS:
            found += DEFINITIONS[name].columns
        else:
            told = f"{shown(name)}{meant(name, DEFINITIONS)}"
            raise InputError(f"index: expected one of {', '.join(DEFINITIONS)}; got {told}")
    return tuple(dict.fromkeys(found))


def _of_finite(function: Any, matrices: FloatArray, axes: int) -> FloatArray:
    """Apply a function of LAPACK to the matrices without NaN, which it refuses; `axes` of its results."""
    good = np.isfinite(matrices).all(axis=(-1, -2))
    if good.all():
        return np.asarray(function(matrices))
    found = np.full((len(matrices), *(3,) * axes), np.nan)
    if good.any():
        found[good] = function(matrices[good])
    return found


_FEW = 6  # poses that have a column each


def indices_table(found: Indices, columns: Mapping[str, FloatArray]) -> Table:
    """Return indices at up to six poses, or their least, mean and largest values over more."""
    poses = found.pose.reshape(-1, 3)
    few = len(poses) <= _FEW
    header = [_called(pose) for pose in poses] if few else ["least", "mean", "largest"]
    rows = {}
    for name, values in columns.items():
        flat = np.atleast_1d(values).ravel()
        known = flat[np.isfinite(flat)]
        shown = flat if few else (known.min(), known.mean(), known.max()) if len(known) else [math.nan] * 3
        rows[name] = (*(number(float(v)) for v in shown), COLUMNS[name].unit_of(name))
    bad = found.reason.ravel()
    told = [f"{_called(pose)}: {why}" for pose, why in zip(poses, bad, strict=True) if why]
    note = f"No indices at {'; '.join(told[:_FEW])}{'; ...' if told[_FEW:] else ''}." if told else ""
    title = f"Indices, characteristic length {1e3 * found.length:g} mm"
    if not few:
        title += f", over {len(poses)} poses"
    return table_of(title, ("index", *header, "unit"), rows, note)


def _called(pose: FloatArray) -> str:
    y, z, theta = pose
    if not np.isfinite(pose).all():
        return NONE
    return f"({1e3 * y:g} mm, {1e3 * z:g} mm, {math.degrees(theta):.4g}°)"


@html_of.register(Indices)
def indices_html(found: Indices) -> str:
    """Return how a notebook shows indices, as HTML."""
    return notebook_html("Indices", repr(found), [indices_table(found, found.columns)])
