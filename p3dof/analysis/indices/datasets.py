"""Indices as labelled arrays, with units and definitions in their attributes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.version import __version__
from p3dof.analysis.indices.definitions import COLUMNS


def dataset_of(
    found: Any, columns: Mapping[str, NDArray[Any]], dims: Sequence[str], coords: Mapping[str, Any]
) -> Any:
    """Return columns of indices as an `xarray.Dataset`.

    Parameters
    ----------
    found : Indices
        Where they come from, with its shape, length, limits and machine.
    columns : mapping of str to ndarray
        Of `p3dof.analysis.indices.columns_of`.
    dims : sequence of str
        Names of the axes of the poses.
    coords : mapping
        As of `xarray.Dataset`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    InputError
        Unless there is a name for each axis.
    MissingExtraError
        If xarray is not installed.
    """
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

    Returns
    -------
    Path
        The path written.

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
