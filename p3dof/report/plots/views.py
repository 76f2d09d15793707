"""Solids of the neutral description seen from a side: what a drawing of the mechanism is made of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.description import Box, Cylinder, Link, Mechanism, Solid, Sphere

_LIGHT = np.array([0.25, 0.35, 0.9])
"""Where the light comes from, as seen by the viewer: shares of right, up and toward him."""

_ROUND = 36
"""Corners of the polygon that stands for a circle."""


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection.

    Parameters
    ----------
    name : str
        What it is called.
    right, up : ndarray, shape (3,)
        Perpendicular unit vectors of the page, in the fixed frame; right × up points to the viewer.
    """

    name: str
    right: FloatArray
    up: FloatArray

    @classmethod
    def oblique(cls, name: str, azimuth: float, elevation: float) -> View:
        """Return the view from an azimuth (from +x0 toward +y0) and an elevation [rad]."""
        c, s = np.cos(azimuth), np.sin(azimuth)
        right = np.array([-s, c, 0.0])
        toward = np.array([np.cos(elevation) * c, np.cos(elevation) * s, np.sin(elevation)])
        return cls(name, right, np.cross(toward, right))

    @property
    def toward(self) -> FloatArray:
        """Unit vector to the viewer, shape (3,)."""
        return np.asarray(np.cross(self.right, self.up), dtype=np.float64)

    def project(self, points: FloatArray) -> FloatArray:
        """Return points of the fixed frame, (..., 3), on the page, (..., 2) [m]."""
        return np.asarray(points @ np.stack([self.right, self.up], axis=-1))


@dataclass(frozen=True, eq=False)
class Prism:
    """A solid with two equal parallel faces: a box, a bar or the platform.

    Parameters
    ----------
    outline : ndarray, shape (n, 2)
        Convex, counter-clockwise, in its own x and y [m].
    thickness : float
        Along its own z, half of it on each side [m].
    position, rotation : ndarray, shape (3,) and (3, 3)
        Its middle and its axes, in the fixed frame.
    rgb : tuple of float
        Its colour.
    """

    outline: FloatArray
    thickness: float
    position: FloatArray
    rotation: FloatArray
    rgb: tuple[float, float, float]

    @property
    def caps(self) -> FloatArray:
        """Corners of the two faces, the upper one first, shape (2, n, 3) [m]."""
        flat = np.column_stack([self.outline, np.zeros(len(self.outline))])
        half = np.array([0.0, 0.0, self.thickness / 2])
        return np.stack([self.position + (flat + side * half) @ self.rotation.T for side in (1, -1)])

    @property
    def edged(self) -> bool:
        """Whether its sides meet at edges that can be seen."""
        return len(self.outline) <= 4

    def silhouette(self, view: View) -> FloatArray:
        """Return its outline on the page, shape (k, 2) [m]."""
        return hull(view.project(self.caps).reshape(-1, 2))

    def faces(self, view: View) -> list[tuple[FloatArray, tuple[float, float, float]]]:
        """Return the faces that the viewer sees, on the page, with their colours in his light.

        Parameters
        ----------
        view : View
            Whence.

        Returns
        -------
        list of (ndarray, shape (k, 2), tuple of float)
            Polygons [m] and their red, green and blue.
        """
        upper, lower = self.caps
        sides = np.roll(self.outline, -1, axis=0) - self.outline
        normals = np.column_stack([sides[:, 1], -sides[:, 0], np.zeros(len(sides))])
        normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True) @ self.rotation.T
        quads = np.stack([upper, lower, np.roll(lower, -1, axis=0), np.roll(upper, -1, axis=0)], axis=1)
        axis = self.rotation[:, 2]
        polygons = [(upper, axis), (lower, -axis), *zip(quads, normals, strict=True)]
        seen = [(corners, normal) for corners, normal in polygons if normal @ view.toward > 1e-6]
        return [(view.project(corners), _lit(self.rgb, normal, view)) for corners, normal in seen]


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball: its middle in the fixed frame, its radius [m] and its colour."""

    position: FloatArray
    radius: float
    rgb: tuple[float, float, float]

    edged = False

    def silhouette(self, view: View) -> FloatArray:
        """Return its outline on the page, shape (n, 2) [m]."""
        return np.asarray(view.project(self.position) + _circle(self.radius))

    def faces(self, view: View) -> list[tuple[FloatArray, tuple[float, float, float]]]:
        """Return what the viewer sees: a disc, see `Prism.faces`."""
        return [(self.silhouette(view), _lit(self.rgb, view.toward, view))]


def link_frames(
    mechanism: Mechanism, joints: Mapping[str, float]
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return where every link is, from the positions of the joints of the tree.

    Parameters
    ----------
    mechanism : Mechanism
        The neutral description.
    joints : mapping of str to float
        Position of every moving joint [m or rad].

    Returns
    -------
    dict of str to (ndarray, ndarray)
        By link: position, shape (3,) [m], and rotation, shape (3, 3), in the root's frame.
    """
    frames: dict[str, tuple[FloatArray, FloatArray]] = {mechanism.links[0].name: (np.zeros(3), np.eye(3))}
    for joint in mechanism.joints:
        position, rotation = frames[joint.parent]
        position = position + rotation @ joint.placement.position
        rotation = rotation @ joint.placement.rotation
        if joint.axis is not None and joint.kind == "prismatic":
            position = position + rotation @ joint.axis * joints[joint.name]
        elif joint.axis is not None:
            rotation = rotation @ _turn(joint.axis, joints[joint.name])
        frames[joint.child] = (position, rotation)
    return frames


def solids_of(link: Link, position: FloatArray, rotation: FloatArray) -> list[Prism | Ball]:
    """Return the visible solids of a link that stands somewhere.

    The platform's many slabs are drawn as the one plate that they make.

    Parameters
    ----------
    link : Link
        The link.
    position, rotation : ndarray, shape (3,) and (3, 3)
        Where it is, in the fixed frame.

    Returns
    -------
    list of Prism or Ball
    """
    if link.name == "platform":
        return [_plate(link.visuals, position, rotation)]
    return [_placed(solid, position, rotation) for solid in link.visuals]


def hull(points: FloatArray) -> FloatArray:
    """Return the convex hull of points, counter-clockwise (Andrew's monotone chain).

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Points of the page.

    Returns
    -------
    ndarray, shape (k, 2)
    """
    ordered = sorted(set(map(tuple, np.round(points, 12).tolist())))

    def half(candidates: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
        chain: list[tuple[float, float]] = []
        for x, y in candidates:
            while len(chain) > 1:
                (x0, y0), (x1, y1) = chain[-2:]
                if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0:
                    break
                chain.pop()
            chain.append((x, y))
        return chain[:-1]

    return np.array(half(ordered) + half(reversed(ordered)))


def _placed(solid: Solid, position: FloatArray, rotation: FloatArray) -> Prism | Ball:
    where = position + rotation @ solid.placement.position
    red, green, blue, _ = solid.colour.rgba
    if isinstance(solid.shape, Sphere):
        return Ball(where, solid.shape.radius, (red, green, blue))
    outline, thickness = _outline(solid.shape)
    return Prism(outline, thickness, where, rotation @ solid.placement.rotation, (red, green, blue))


def _plate(slabs: tuple[Solid, ...], position: FloatArray, rotation: FloatArray) -> Prism:
    """Return the convex plate that slabs of equal thickness in one plane make."""
    corners, thickness = [], 0.0
    for slab in slabs:
        if not isinstance(slab.shape, Sphere):
            outline, thickness = _outline(slab.shape)
            corners.append(outline @ slab.placement.rotation[:2, :2].T + slab.placement.position[:2])
    red, green, blue, _ = slabs[0].colour.rgba
    return Prism(hull(np.concatenate(corners)), thickness, position, rotation, (red, green, blue))


def _outline(shape: Box | Cylinder) -> tuple[FloatArray, float]:
    """Return the face of a solid across its own z, and its length along it."""
    if isinstance(shape, Cylinder):
        return _circle(shape.radius), shape.length
    x, y, z = shape.size
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2, z


def _circle(radius: float) -> FloatArray:
    angles = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    return np.asarray(radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1))


def _turn(axis: FloatArray, angle: float) -> FloatArray:
    """Return the rotation about a unit vector (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def _lit(rgb: tuple[float, float, float], normal: FloatArray, view: View) -> tuple[float, float, float]:
    """Return the colour of a face in the viewer's light, pale enough for print to show lines on it."""
    light = _LIGHT @ np.stack([view.right, view.up, view.toward]) / np.linalg.norm(_LIGHT)
    share = 0.55 + 0.45 * max(0.0, float(normal @ light))
    red, green, blue = (1 - 0.8 * (1 - share * part) for part in rgb)
    return red, green, blue
