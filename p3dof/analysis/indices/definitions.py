"""What each index is: its parts, unit, definition and source, for data sets, tables and figures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import Readable
from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.version import __version__

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
    try:
        import xarray  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        raise MissingExtraError("to_xarray needs xarray: pip install 'p3dof[xarray]'") from error
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
    return xarray.Dataset(variables, coords=coords, attrs=attributes)


def write_dataset(dataset: Any, path: str | os.PathLike[str]) -> Path:
    """Write a map to a netCDF file, which programs for arrays with units read; no other library is needed.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `Workspace.map` or `Indices.to_xarray`. Its own ``to_zarr`` writes Zarr, with zarr installed.
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
