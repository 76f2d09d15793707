"""The studio: one page with maps of a machine's indices, and designs that are compared, linked by selection.

Drawn by Apache ECharts, which is in the page: one file that asks for nothing outside.
"""

from __future__ import annotations

import html
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, shown, suggestion, whole
from p3dof._base.errors import InputError
from p3dof._base.files import check_writable, write_atomic
from p3dof.analysis.designs.columns import by_header
from p3dof.analysis.indices import DEFINITIONS, Indices
from p3dof.analysis.indices.definitions import IndicesMachine as WithIndices
from p3dof.analysis.indices.definitions import check_names
from p3dof.analysis.workspace.margins import WorkspaceMachine as WithWorkspace
from p3dof.analysis.workspace.workspace import Workspace
from p3dof.machine.motion import Motion
from p3dof.machine.motion.core import require_motion
from p3dof.viewer.document.html import as_script, filled, template

INDICES = (
    "lti",
    "lci",
    "accuracy_y",
    "accuracy_z",
    "accuracy_theta",
    "serial_a",
    "serial_b",
    "serial_c",
    "actuation",
    "frequency_1",
    "acceleration_ball",
    "actuator_inertia_3",
    "holding_a",
    "holding_b",
    "holding_c",
)
"""What the map offers where nobody says."""

MOST_DESIGNS = 20_000
"""More points make no page that anybody can read; take a sample of them."""

_DIGITS = 5


class MappedMachine(WithIndices, WithWorkspace, Protocol):
    """What the studio asks of a machine: `Manipulator` has it."""


def studio_document(
    machine: MappedMachine,
    motion: Motion | None = None,
    designs: Any = None,
    *,
    indices: Sequence[str] | None = None,
    counts: tuple[int, int] = (81, 81),
    better: Mapping[str, str] | None = None,
    start: int | None = None,
    title: str = "Design studio",
) -> dict[str, Any]:
    """Return what the studio shows, as plain data for JSON; see `studio_page`."""
    workspace = Workspace(machine)
    across, up = (whole("counts", count, 5, 401) for count in counts)
    reach = 0.999 * float(workspace.sizes.reach)
    low, high = _tilts(workspace)
    y, step = np.linspace(-reach, reach, across), (high - low) / (up - 1)
    theta = step * (np.arange(up) + round(low / step))  # with home among them
    grid = np.stack(np.broadcast_arrays(y[None, :], 0.0, theta[:, None]), axis=-1)
    at = Indices(machine, grid, on_invalid="nan")
    height = workspace.height(grid[..., 0], grid[..., 2])
    names = INDICES if indices is None else check_names(indices)
    geometry = machine.parameters.geometry
    lengths = {name: float(getattr(geometry, name)) for name in ("r", "R", "L", "b")}
    sizes = (("area", "m rad", workspace.area_y_theta), ("volume", "m² rad", workspace.volume))
    return {
        "title": title,
        "machine": lengths | {"travel": _plain(workspace.limits.travel)},
        "sizes": [{"name": name, "unit": unit, "value": float(f"{size:.4g}")} for name, unit, size in sizes],
        "map": {
            "y": _plain(y, 9),
            "theta": _plain(np.degrees(theta), 9),
            "inside": (np.nan_to_num(height, nan=0.0) > 0).astype(int).ravel().tolist(),
            "indices": [_index(at, name) for name in names]
            + [
                {
                    "name": "height",
                    "unit": "m",
                    "meaning": "free height in z that the sliders' travel leaves",
                    "values": _plain(height.ravel()),
                }
            ],
        },
        "loci": [
            {
                "name": name,
                "points": [_plain(point) for point in np.column_stack([c[:, 0], np.degrees(c[:, 1])])],
            }
            for name, c in workspace.loci().items()
        ],
        "limits": {"tilt": _plain(np.degrees(workspace.limits.tilt))},
        "path": None if motion is None else _path(motion),
        "designs": None if designs is None else _designs(designs, better or {}, start),
    }


def studio_page(
    machine: MappedMachine,
    motion: Motion | None = None,
    designs: Any = None,
    *,
    indices: Sequence[str] | None = None,
    counts: tuple[int, int] = (81, 81),
    better: Mapping[str, str] | None = None,
    start: int | None = None,
    title: str = "Design studio",
) -> str:
    """Return one page with maps of a machine over y and θ, and with designs to choose from.

    The map has a choice of indices, the loci of singularities, the limits, the path of a motion, values of
    all indices where the mouse is, and slices where it was clicked. Designs are points over two columns and
    lines through all columns; what is selected in one picture is selected in the other.

    HTML with all scripts, styles and numbers in it; it asks for nothing outside.
    """
    document = studio_document(
        machine, motion, designs, indices=indices, counts=counts, better=better, start=start, title=title
    )
    values = {"@@TITLE@@": html.escape(title), "@@DOCUMENT@@": as_script(document)}
    return filled(template("studio.html", tuple(values)), values)


def save_studio(path: str | os.PathLike[str], machine: MappedMachine, *contents: Any, **options: Any) -> Path:
    """Write `studio_page` to a file.

    Parameters
    ----------
    path : path-like
        The file; replaced whole or not at all.
    machine : Manipulator
        The machine.
    *contents, **options
        As of `studio_page`.

    Raises
    ------
    InputError
        If an argument does not fit.
    FileError
        If the file cannot be written.
    """
    check_writable(Path(path))
    return write_atomic(path, studio_page(machine, *contents, **options))


def _tilts(workspace: Workspace) -> tuple[float, float]:
    """Return from where to where the map goes: the limits and the singularities around them, with room."""
    low, high = workspace.limits.tilt
    curves = [curve[:, 1] for name, curve in workspace.loci().items() if name.startswith("actuation")]
    above = max((float(np.nanmax(c)) for c in curves if np.nanmax(c) > 0), default=high)
    return max(low - np.radians(15), -np.pi), min(max(high, above) + np.radians(8), np.pi)


def _index(at: Indices, column: str) -> dict[str, Any]:
    definition = next(one for one in DEFINITIONS.values() if column in one.columns)
    meaning = definition.describe(column, at.length) + (
        f" ({definition.source})" if definition.source else ""
    )
    return {
        "name": column,
        "unit": definition.unit_of(column),
        "meaning": meaning,
        "values": _plain(at.column(column).ravel()),
    }


def _path(motion: Motion) -> dict[str, Any]:
    require_motion(motion)
    places = np.column_stack([motion.pose[:, 0], np.degrees(motion.pose[:, 2])])
    return {"time": _plain(motion.time), "points": [_plain(point) for point in places]}


def _designs(designs: Any, better: Mapping[str, str], start: int | None) -> dict[str, Any]:
    told = dict(better)
    found = getattr(designs, "found", designs)  # of a front, whose start comes first
    for measure in getattr(getattr(found, "asked", None), "objectives", ()):
        told.setdefault(measure.name, measure.better)
    given = found.to_columns() if hasattr(found, "to_columns") else by_header(designs)
    if found is not designs and start is None:
        before, start = designs.start.to_columns(), 0
        given = {name: np.concatenate([before[name], values]) for name, values in given.items()}
    columns = []
    for header, values in given.items():
        name, _, unit = str(header).partition(" [")
        column = as_floats(f"designs: {name}", getattr(values, "values", values))
        if column.ndim != 1:
            raise InputError(f"designs: {name}: expected one number a design, got the shape {column.shape}")
        way = told.pop(name, "")
        if way not in ("", "small", "large"):
            raise InputError(f"better: {name}: expected 'small' or 'large', got {shown(way)}")
        columns.append({"name": name, "unit": unit.rstrip("]"), "better": way, "values": _plain(column)})
    if told:
        missing, names = next(iter(told)), [str(column["name"]) for column in columns]
        hint = suggestion(missing, names)
        raise InputError(f"better: {shown(missing)} is no column of the designs; {hint}")
    sizes = {len(column["values"]) for column in columns}
    if len(sizes) != 1 or not 1 <= min(sizes) <= MOST_DESIGNS:
        raise InputError(
            f"designs: expected 1 to {MOST_DESIGNS} designs in columns of one length, got {sorted(sizes)}"
        )
    if start is not None:
        whole("start", start, 0, min(sizes) - 1)
    moving = [c for c in columns if c["better"] or len(set(c["values"])) > 1]
    return {"columns": moving or columns, "start": start}


def _plain(values: ArrayLike, digits: int = _DIGITS) -> list[float | None]:
    """Return numbers as JSON has them, with digits that can be seen."""
    array: FloatArray = np.asarray(values, dtype=np.float64)
    with np.errstate(all="ignore"):
        size = 10.0 ** (digits - np.floor(np.log10(np.where(array == 0, 1.0, np.abs(array)))))
        short = np.where(np.isfinite(array) & np.isfinite(size), np.round(array * size) / size, array)
    return [value if np.isfinite(value) else None for value in short.tolist()]
