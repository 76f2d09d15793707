"""`Workspace`: where a machine can work within its limits, from closed forms over (y, θ)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array, shown
from p3dof._base.errors import InputError
from p3dof._base.tables import NONE, Cell, ShownInNotebook, Table, html_of, notebook_html, table_of
from p3dof.analysis.workspace.closed_forms import Aspects, Sizes, aspects, loci, offsets
from p3dof.analysis.workspace.largest import Box, largest_box
from p3dof.analysis.workspace.margins import (
    HORIZON,
    PoseMargins,
    WorkspaceMachine,
    WorkspaceMargins,
    demands,
    pose_margins,
)
from p3dof.analysis.workspace.region import Condition, Points, Region
from p3dof.machine.parameters import Limits, Parameters

_NONE = WorkspaceMargins()
_NOTHING = 1e-9  # share of a workspace that a single point of the quadrature may lack


class Workspace(ShownInNotebook):
    """Poses (y, z, θ) of home's aspect within stroke, tilt and margins.

    z moves all sliders alike, so that a workspace is a region in (y, θ) and a height H(y, θ) in z over it:
    areas and volumes are integrals of closed forms, not counts of points.

    Parameters
    ----------
    machine : Manipulator
        The machine.
    limits : Limits, optional
        Stroke, tilt, speed and force; the machine's own without it.
    margins : WorkspaceMargins, optional
        What is demanded besides; nothing without it. Accelerations that a machine counterbalanced by springs
        must have, whose forces depend on z, are demanded at every z of the stroke; `margin` has each pose.

    Raises
    ------
    InputError
        If an argument is something else, or no pose keeps all limits and margins.
    """

    def __init__(
        self, machine: WorkspaceMachine, limits: Limits | None = None, margins: WorkspaceMargins | None = None
    ) -> None:
        if not isinstance(getattr(machine, "parameters", None), Parameters):
            raise InputError(f"machine: expected a Manipulator, got {shown(machine)}")
        for name, value, kind in (("limits", limits, Limits), ("margins", margins, WorkspaceMargins)):
            if not isinstance(value, kind | None):
                raise InputError(f"{name}: expected {kind.__name__}, got {shown(value)}")
        self._machine = machine
        self.limits = machine.parameters.limits if limits is None else limits
        self.margins = _NONE if margins is None else margins
        self.sizes = Sizes.of(machine.parameters.geometry)
        self._region = self._where(None)
        if not self.volume > 0:
            raise InputError(f"no pose satisfies the limits and margins: {self._refusal}")

    def __repr__(self) -> str:
        return f"Workspace(area {self.area_y_theta:.6g} m rad, volume {self.volume:.6g} m² rad)"

    @property
    def machine(self) -> WorkspaceMachine:
        """The machine."""
        return self._machine

    # Sizes

    @cached_property
    def points(self) -> Points:
        """Points and weights: ``points.volume @ values`` at ``points.y``, ``points.theta`` is an integral."""
        return self._region.points()

    @cached_property
    def area_y_theta(self) -> float:
        """Area of the region in (y, θ) [m rad]."""
        return float(self.points.area.sum())

    @cached_property
    def volume(self) -> float:
        """Volume in y, z, θ: the integral of H dy dθ [m² rad]."""
        return float(self.points.volume.sum())

    def area(self, theta: float = 0.0) -> float:
        """Return the area in (y, z) at a constant orientation [m²]; 0 where no such pose is within limits.

        Parameters
        ----------
        theta : float
            The orientation [rad].

        Raises
        ------
        InputError
            If `theta` is no finite number.
        """
        turned = float(frozen_array("theta", theta, ()))
        region = self._region
        y, weights = region.rows(
            lambda _, y: region.contains(y, np.full_like(y, turned)),
            lambda y: np.stack([y, *region.crossings(y, np.full_like(y, turned))]),
        )
        return float(weights @ region.height(y, np.full_like(y, turned)))

    def dexterous(self, tilt: float | tuple[float, float] | None = None) -> float:
        """Return the area in (y, z) [m²] of points that are reached with every orientation of a range, or 0.

        Parameters
        ----------
        tilt : float or tuple of two floats, optional
            Largest tilt to either side, or from and to [rad]; all of the limits' tilt without it.

        Raises
        ------
        InputError
            If it is no range of finite numbers.
        """
        low, high = self._tilt("tilt", tilt)
        crossings = self._region.crossings
        y, weights = self._region.rows(
            lambda _, y: self._all_orientations(y, low, high),
            lambda y: np.stack(
                [y, *(row for end in (low, high) for row in crossings(y, np.full_like(y, end)))]
            ),
        )
        return float(weights @ self._all_orientations(y, low, high))

    @cached_property
    def reachable(self) -> float:
        """Area in (y, z) of points that are reached with some orientation of the limits' tilt [m²]."""
        region, spans = self._region, self._spans
        y, weights = region.rows(lambda _, y: spans(y), region.switches)
        return float(weights @ spans(y))

    @cached_property
    def aspects(self) -> Aspects:
        """Areas of the aspects in (y, θ), without any limits."""
        return aspects(self.sizes)

    def loci(self) -> dict[str, FloatArray]:
        """Return the loci of both kinds of singularity as polylines.

        Returns
        -------
        dict of str to ndarray, shape (n, 2)
            y [m] and θ [rad], from -π to π: ``"actuation above"`` and ``"actuation below"`` (det J = 0),
            ``"serial a"``, ``"serial b"``, ``"serial c above"``, ``"serial c below"`` (a leg is horizontal),
            those that exist. NaN where one is interrupted.
        """
        return loci(self.sizes)

    def largest_box(self, tilt: float | tuple[float, float] | None = None) -> Box:
        """Return the largest box of poses, wherever it is, with a height in z free for all of them.

        Its height is less than the least H over it: z need not follow y and θ. A box may lie aside of home,
        or not have it in it; `largest_symmetric_box` is the largest one of those that are symmetric about it.

        Parameters
        ----------
        tilt : float or tuple of two floats, optional
            Largest tilt to either side, or from and to [rad]: the box of the largest area in (y, z) with all
            of it. Without it, the box of the largest volume, of any range of θ.

        Raises
        ------
        InputError
            If `tilt` is not within the limits, or there is no box.
        """
        return largest_box(self._region, self.points, self._tilt_of_box(tilt), symmetric=False)

    def largest_symmetric_box(self, tilt: float | None = None) -> Box:
        """Return the largest box of poses from -Y to Y and -Θ to Θ, with a height in z free for all of them.

        Parameters
        ----------
        tilt : float, optional
            Θ [rad]: the box of the largest area in (y, z). Without it, that of the largest volume, of any Θ.

        Raises
        ------
        InputError
            If `tilt` is not within the limits, or there is no box.
        """
        if tilt is not None:
            tilt = float(frozen_array("tilt", tilt, ()))
        return largest_box(self._region, self.points, self._tilt_of_box(tilt), symmetric=True)

    def _tilt_of_box(self, tilt: float | tuple[float, float] | None) -> tuple[float, float] | None:
        if tilt is None:
            return None
        low, high = self._tilt("tilt", tilt)
        least, most = self._region.tilt
        if not least <= low <= high <= most:
            raise InputError(
                f"tilt: expected within the limits, {least:g} to {most:g} rad, got {low:g} to {high:g} rad"
            )
        return low, high

    # At poses

    def height(self, y: ArrayLike, theta: ArrayLike) -> FloatArray:
        """Return H(y, θ), the height in z that the stroke leaves [m]; NaN where it is not in the region.

        Parameters
        ----------
        y, theta : array-like
            Position [m] and rotation [rad]; they broadcast.

        Raises
        ------
        InputError
            If they are no numbers, or do not broadcast.
        """
        try:
            across, turned = np.broadcast_arrays(as_floats("y", y), as_floats("theta", theta))
        except ValueError as error:
            raise InputError("y, theta: expected arrays of one shape, or that broadcast") from error
        inside = self._region.contains(across.ravel(), turned.ravel()).reshape(across.shape) >= 0
        return np.where(inside, self._region.height(across, turned), np.nan)

    def z_range(self, y: ArrayLike, theta: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return least and largest z that the stroke leaves [m]; NaN where a pose is not within the region.

        Parameters
        ----------
        y, theta : array-like
            Position [m] and rotation [rad]; they broadcast.
        """
        inside = np.isfinite(self.height(y, theta))
        found = offsets(self.sizes, as_floats("y", y), as_floats("theta", theta))
        low = self.limits.travel[0] - np.minimum.reduce(np.broadcast_arrays(*found))
        high = self.limits.travel[1] - np.maximum.reduce(np.broadcast_arrays(*found))
        return np.where(inside, low, np.nan), np.where(inside, high, np.nan)

    def margin(self, pose: ArrayLike) -> PoseMargins:
        """Return how far poses are from all that bounds the workspace, with the reason for those outside.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad]; a row with NaN is outside.

        Raises
        ------
        InputError
            If the shape does not fit.
        """
        return pose_margins(self._machine, self.limits, self.margins, pose)

    # Indices over it

    def indices(self, pose: ArrayLike, **options: Any) -> Any:
        """Return performance indices at poses, with the limits of the workspace; NaN where there are none.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad]; also outside of the workspace.
        **options
            As of `Manipulator.indices`.

        Raises
        ------
        InputError
            If an argument does not fit.
        """
        return self._machine.indices(pose, **{"on_invalid": "nan", "limits": self.limits, **options})

    def mean(self, index: str, measure: str = "volume", **options: Any) -> float:
        """Return the mean of an index, of ``"lci"`` the global one; NaN if a part of the workspace has none.

        Parameters
        ----------
        index : str
            One of the names of `p3dof.analysis.indices.COLUMNS`, such as ``"lci"`` or ``"frequency_1"``.
        measure : {"volume", "area"}
            Weigh by dy dz dθ, or by dy dθ; they differ.
        **options
            As of `Manipulator.indices`.

        Raises
        ------
        InputError
            If there is no such index or measure.
        """
        if measure not in ("volume", "area"):
            raise InputError(f"measure: expected 'volume' or 'area', got {shown(measure)}")
        points = self.points
        weights = getattr(points, measure)
        values = self._index(index, options)(points.y, points.theta)
        bad = np.isnan(values) & (weights <= _NOTHING * weights.sum())  # at the very singularity
        return float(weights[~bad] @ values[~bad] / weights.sum())

    def share(self, index: str, least: float, **options: Any) -> float:
        """Return the share, 0 to 1, of the volume in which an index is at least a number.

        Parameters
        ----------
        index : str
            One of the names of `p3dof.analysis.indices.COLUMNS`, such as ``"lci"`` or ``"frequency_1"``.
        least : float
            The number.
        **options
            As of `Manipulator.indices`.

        Raises
        ------
        InputError
            If there is no such index.
        """
        level, values = float(frozen_array("least", least, ())), self._index(index, options)
        points = self._where(lambda y, theta: values(y, theta) - level).points()
        return float(points.volume.sum() / self.volume)

    def map(
        self,
        *indices: str,
        y: ArrayLike | None = None,
        theta: ArrayLike | None = None,
        count: int = 200,
        **options: Any,
    ) -> Any:
        """Return indices over (y, θ) as an `xarray.Dataset`, with units and definitions as attributes.

        Parameters
        ----------
        *indices : str
            Names of indices or of their columns, such as ``"lti"``, ``"frequency"`` or ``"frequency_1"``.
        y, theta : array-like, shape (n,), optional
            Positions [m] and orientations [rad]; evenly over the workspace without them.
        count : int
            How many of those that are not given.
        **options
            As of `Manipulator.indices`.

        Returns
        -------
        xarray.Dataset
            With the dimensions ``y`` and ``theta``; also ``height``, H(y, θ) [m]. NaN outside the workspace.
            At z = 0, which matters for forces of a machine counterbalanced by springs only.

        Raises
        ------
        InputError
            If there is no such index, or an argument does not fit.
        MissingExtraError
            If xarray is not installed.
        """
        axes, rise, found = self.gridded(count, y, theta, **options)
        coords = {"y": ("y", axes[0], {"units": "m"}), "theta": ("theta", axes[1], {"units": "rad"})}
        dataset = found.to_dataset(*indices, dims=("y", "theta"), coords=coords)
        told = {"units": "m", "long_name": "height H(y, theta) in z that the stroke leaves"}
        dataset["height"] = (("y", "theta"), rise, told)
        limits, margins = self.limits, self.margins
        dataset.attrs |= {"travel": list(limits.travel), "tilt": list(limits.tilt)}
        dataset.attrs |= {"serial_margin": margins.serial, "actuation_margin": margins.actuation}
        return dataset

    def gridded(
        self, count: int = 200, y: ArrayLike | None = None, theta: ArrayLike | None = None, **options: Any
    ) -> tuple[list[FloatArray], FloatArray, Any]:
        """Return what `map` is made of, without xarray: its two axes, heights and indices over them."""
        axes = [
            _axis(name, given, ends, count)
            for name, given, ends in (("y", y, self.points.y), ("theta", theta, self.points.theta))
        ]
        across, turned = np.meshgrid(*axes, indexing="ij")
        rise = self.height(across, turned)
        poses = np.where(np.isfinite(rise)[..., None], _poses(across, turned), np.nan)
        return axes, rise, self.indices(poses, **options)

    # Within

    def _where(self, more: Condition | None) -> Region:
        """Return the region with what margins demand of speed and force, and one condition more."""
        conditions = [] if more is None else [more]
        if self.margins.velocity is not None or self.margins.acceleration is not None:
            conditions.append(self._demands)
        if not conditions:
            return Region(self.sizes, self.limits, self.margins)

        def condition(y: FloatArray, theta: FloatArray) -> FloatArray:
            found: FloatArray = np.minimum.reduce([one(y, theta) for one in conditions])
            return found

        return Region(self.sizes, self.limits, self.margins, condition)

    def _demands(self, y: FloatArray, theta: FloatArray) -> FloatArray:
        """Return what demands leave, at the worst z: springs make forces linear in z."""
        heights = [np.zeros_like(y)]
        if self._machine.parameters.actuators.spring and self.margins.acceleration is not None:
            found = np.broadcast_arrays(*offsets(self.sizes, y, theta))
            low, high = self.limits.travel
            heights = [low - np.minimum.reduce(found), high - np.maximum.reduce(found)]
        rows = []
        for z in heights:
            left = demands(self._machine, self.limits, self.margins, np.stack([y, z, theta], axis=-1))
            rows += [values.min(axis=-1) for values in left if values is not None]
        least: FloatArray = np.minimum.reduce(rows)
        return least

    def _index(self, name: str, options: dict[str, Any]) -> Condition:
        def values(y: FloatArray, theta: FloatArray) -> FloatArray:
            found: FloatArray = self.indices(_poses(y, theta), **options).column(name)
            return found

        return values

    def _tilt(self, name: str, tilt: float | tuple[float, float] | None) -> tuple[float, float]:
        if tilt is None:
            return self._region.tilt
        if np.ndim(tilt) == 0:
            most = float(frozen_array(name, tilt, ()))
            low, high = -most, most
        else:
            low, high = (float(v) for v in frozen_array(name, tilt, (2,)))
        if not -HORIZON <= low <= high <= HORIZON:
            raise InputError(f"{name}: expected a range of angles within ±π, got {low:g} to {high:g} rad")
        return low, high

    def _all_orientations(self, y: FloatArray, low: float, high: float) -> FloatArray:
        """Return the height in z that is free for all orientations of a range at each y; negative if none."""
        lower, upper = self._region.within(y)
        a, b, least = offsets(self.sizes, y, np.full_like(y, low))
        most = offsets(self.sizes, y, np.full_like(y, high))[2]  # ℓC grows with θ
        span = np.maximum(np.maximum(a, b), most) - np.minimum(np.minimum(a, b), least)
        free = np.where((lower <= low) & (high <= upper), self._region.travel - span, -1.0)
        if self._region.condition is not None:
            theta = np.linspace(low, high, 65)
            across, turned = (g.ravel() for g in np.meshgrid(y, theta, indexing="ij"))
            values = self._region.condition(across, turned).reshape(len(y), -1)
            free = np.where((values >= 0).all(axis=1), free, -1.0)
        return np.asarray(np.nan_to_num(free, nan=-1.0))

    def _spans(self, y: FloatArray) -> FloatArray:
        """Return the length of the z that are reached with some orientation at each y; negative if none."""
        row, low, high = self._region.ranges(y)
        a, b, first = offsets(self.sizes, y[row], low + 1e-12 * (high - low))
        last = offsets(self.sizes, y[row], high - 1e-12 * (high - low))[2]
        from_ = self.limits.travel[0] - np.minimum(np.minimum(a, b), last)  # at its largest θ, C is highest
        to = self.limits.travel[1] - np.maximum(np.maximum(a, b), first)
        return _union(len(y), row, from_, to)

    @property
    def _refusal(self) -> str:
        """Why home is not within, or that no pose is although home might be."""
        home = self.margin(np.zeros(3))
        reason = str(home.reason)
        if not reason:
            return "home satisfies them, but no (y, θ) does at every z of the stroke"
        value = float(home.columns[reason])
        return f"at home the margin of {reason!r} is {value:g}"


def _poses(y: FloatArray, theta: FloatArray) -> FloatArray:
    return np.stack([y, np.zeros_like(y), theta], axis=-1)


def _axis(name: str, given: ArrayLike | None, places: FloatArray, count: int) -> FloatArray:
    """Return the positions of an axis of a map: those given, or evenly spaced ones over all places."""
    if given is not None:
        return frozen_array(name, given, ("N",))
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or not 2 <= count <= 5000:
        raise InputError(f"count: expected a whole number from 2 to 5000, got {shown(count)}")
    return np.asarray(np.linspace(places.min(), places.max(), int(count)), dtype=np.float64)


def _union(count: int, row: Any, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the length of the union of ranges in each row; -1 in rows without any."""
    order = np.lexsort((low, row))
    found, end = np.full(count, -1.0), np.full(count, -np.inf)
    for k in order:
        i = row[k]
        found[i] = max(found[i], 0.0) + max(high[k] - max(low[k], end[i]), 0.0)
        end[i] = max(end[i], high[k])
    return found


_POINTS = 101  # of each locus in JSON


def workspace_table(space: Workspace) -> Table:
    """Return areas and volume of a workspace."""
    rows = {
        "volume in y, z, θ": (space.volume, "m² rad"),
        "area in (y, θ)": (space.area_y_theta, "m rad"),
        "area in (y, z) at θ = 0": (space.area(), "m²"),
        "with every orientation of the tilt": (space.dexterous(), "m²"),
        "with some orientation": (space.reachable, "m²"),
        "home's aspect in (y, θ), without limits": (space.aspects.home, "m rad"),
    }
    return table_of("Workspace", ("size", "value", "unit"), rows, decimals=6)


def box_table(space: Workspace) -> Table:
    """Return the largest boxes of poses in a workspace, all of which can be taken at once.

    Of all boxes, and of those that are symmetric about y = 0 and θ = 0.
    """
    boxes = _boxes(space)
    spans = {name: _spans(box) for name, box in boxes.items()}
    rows = {
        what: (*spans["largest"][k], *spans["symmetric"][k], unit)
        for k, (what, unit) in enumerate((("y", "mm"), ("z", "mm"), ("θ", "deg")))
    }
    sizes = {name: "none" if box is None else f"{box.volume:.6g} m² rad" for name, box in boxes.items()}
    note = (
        f"Of all boxes: {sizes['largest']}; of those with |y| ≤ Y, |θ| ≤ Θ: {sizes['symmetric']}. "
        "z need not follow y and θ in them."
    )
    header = ("largest box", "from", "to", "symmetric: from", "symmetric: to", "unit")
    return table_of("Largest boxes", header, rows, note, decimals=2)


def _spans(box: Box | None) -> Sequence[tuple[Cell, Cell]]:
    """Return the ends of a box in y and z [mm] and θ [deg]."""
    if box is None:
        return 3 * [(NONE, NONE)]
    found = ((1e3, box.y), (1e3, box.z), (math.degrees(1), box.theta))
    return [(factor * low, factor * high) for factor, (low, high) in found]


def _boxes(space: Workspace) -> dict[str, Box | None]:
    """Return the largest boxes by their names; None where there is none."""
    return {"largest": _found(space.largest_box), "symmetric": _found(space.largest_symmetric_box)}


def _found(search: Callable[[], Box]) -> Box | None:
    try:
        return search()
    except InputError:
        return None


def plain_workspace(space: Workspace) -> dict[str, Any]:
    """Return the numbers of a workspace in SI units, ready for JSON."""
    boxes = {
        name: box and {"y": box.y, "z": box.z, "theta": box.theta, "volume": box.volume}
        for name, box in _boxes(space).items()
    }
    limits = space.limits
    aspects = space.aspects
    return {
        "limits": {
            "travel": limits.travel,
            "tilt": limits.tilt,
            "speed": limits.speed,
            "force": limits.force,
        },
        "margins": {
            name: getattr(space.margins, name) for name in ("serial", "actuation", "velocity", "acceleration")
        },
        "volume": space.volume,
        "area_y_theta": space.area_y_theta,
        "area": space.area(),
        "dexterous": space.dexterous(),
        "reachable": space.reachable,
        "aspects": {"home": aspects.home, "above": aspects.above, "below": aspects.below},
        "largest_box": boxes["largest"],
        "largest_symmetric_box": boxes["symmetric"],
        "loci": {
            name: [row for row in curve.tolist() if np.isfinite(row).all()]
            for name, curve in loci(space.sizes, _POINTS).items()
        },
    }


@html_of.register(Workspace)
def workspace_html(space: Workspace) -> str:
    """Return how a notebook shows a workspace, as HTML."""
    facts = f"volume {space.volume:.6g} m² rad"
    return notebook_html("Workspace", facts, [workspace_table(space), box_table(space)])
