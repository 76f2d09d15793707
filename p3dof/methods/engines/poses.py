"""Where the links of a description are when its joints move: a plain recursion along the tree."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.description import Joint, Mechanism, Placement


def _zeros() -> FloatArray:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """How a link frame stands and moves, in the axes of the root.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        Its axes, as columns.
    quaternion : ndarray, shape (4,)
        The same, as Euler parameters, the scalar first; their sign is steady as joints move.
    position, velocity, acceleration : ndarray, shape (3,)
        Of its origin [m, m/s, m/s²].
    omega, epsilon : ndarray, shape (3,)
        Angular velocity and acceleration [rad/s, rad/s²].
    """

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    quaternion: FloatArray = field(default_factory=lambda: np.eye(4)[0])
    position: FloatArray = field(default_factory=_zeros)
    velocity: FloatArray = field(default_factory=_zeros)
    acceleration: FloatArray = field(default_factory=_zeros)
    omega: FloatArray = field(default_factory=_zeros)
    epsilon: FloatArray = field(default_factory=_zeros)

    def quaternion_rates(self) -> tuple[FloatArray, FloatArray]:
        """Return the first and second time derivative of the quaternion, ṗ = ½ ω p, each of shape (4,)."""
        spin = np.append(0.0, self.omega)
        first = product(spin, self.quaternion) / 2
        return first, (product(np.append(0.0, self.epsilon), self.quaternion) + product(spin, first)) / 2


def link_motions(
    mechanism: Mechanism,
    q: FloatArray | None = None,
    v: FloatArray | None = None,
    a: FloatArray | None = None,
) -> dict[str, LinkMotion]:
    """Return the motion of every link, by its name.

    Parameters
    ----------
    mechanism : Mechanism
        The description.
    q, v, a : ndarray, shape (n,), optional
        Positions, velocities and accelerations of the moving joints; zero by default.

    Returns
    -------
    dict of str to LinkMotion
    """
    rest = np.zeros(len(mechanism.moving))
    rates = np.column_stack([rest if values is None else values for values in (q, v, a)])
    given = {joint.name: row for joint, row in zip(mechanism.moving, rates, strict=True)}
    found = {mechanism.links[0].name: LinkMotion()}
    for joint in mechanism.joints:
        base = _fixed(found[joint.parent], joint.placement)
        found[joint.child] = base if joint.axis is None else _moved(base, joint, *given[joint.name])
    return found


def _fixed(link: LinkMotion, place: Placement) -> LinkMotion:
    """Return the motion of a frame fixed to a link."""
    arm = link.rotation @ place.position
    spin = cross(link.omega, arm)
    return LinkMotion(
        link.rotation @ place.rotation,
        product(link.quaternion, quaternion_of(place.rotation)),
        link.position + arm,
        link.velocity + spin,
        link.acceleration + cross(link.epsilon, arm) + cross(link.omega, spin),
        link.omega,
        link.epsilon,
    )


def _moved(base: LinkMotion, joint: Joint, q: float, v: float, a: float) -> LinkMotion:
    """Return the motion of a joint's child from that of the joint's frame."""
    axis = base.rotation @ np.asarray(joint.axis)
    omega, epsilon = base.omega, base.epsilon
    if joint.kind == "prismatic":
        arm = q * axis
        spin = cross(omega, arm)
        return LinkMotion(
            base.rotation,
            base.quaternion,
            base.position + arm,
            base.velocity + spin + v * axis,
            base.acceleration + cross(epsilon, arm) + cross(omega, spin + 2 * v * axis) + a * axis,
            omega,
            epsilon,
        )
    turn = np.append(np.cos(q / 2), np.sin(q / 2) * np.asarray(joint.axis))
    return LinkMotion(
        base.rotation @ rotation_of(turn),
        product(base.quaternion, turn),
        base.position,
        base.velocity,
        base.acceleration,
        omega + v * axis,
        epsilon + a * axis + cross(omega, v * axis),
    )


def carrier(mechanism: Mechanism, frame: str) -> tuple[str, Placement]:
    """Return the moving link or root that a frame is fixed to, and its place there.

    Parameters
    ----------
    mechanism : Mechanism
        The description.
    frame : str
        A link or a marker.

    Returns
    -------
    link : str
    place : Placement
    """
    place = Placement()
    while joint := mechanism.markers.get(frame):
        own = joint.placement
        place = Placement(own.position + own.rotation @ place.position, own.rotation @ place.rotation)
        frame = joint.parent
    return frame, place


def axis_frame(axis: FloatArray) -> FloatArray:
    """Return right-handed axes, as columns, of which the third is given, shape (3, 3)."""
    x = cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, cross(axis, x), axis])


def homogeneous(place: Placement) -> FloatArray:
    """Return a placement as a homogeneous transformation, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = place.rotation, place.position
    return matrix


def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return the product of two quaternions, shape (4,)."""
    vector = p[0] * q[1:] + q[0] * p[1:] + cross(p[1:], q[1:])
    return np.append(p[0] * q[0] - p[1:] @ q[1:], vector)


def quaternion_of(rotation: FloatArray) -> FloatArray:
    """Return the Euler parameters of a rotation matrix, the scalar first and not negative, shape (4,)."""
    from scipy.spatial.transform import Rotation

    writable = np.array(rotation)  # SciPy 1.15 takes no other
    x, y, z, w = (float(value) for value in Rotation.from_matrix(writable).as_quat())
    found = np.array([w, x, y, z])
    return np.asarray(found if w >= 0 else -found)


def rotation_of(p: FloatArray) -> FloatArray:
    """Return the rotation matrix of Euler parameters, shape (3, 3)."""
    s, u = p[0], p[1:]
    U = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
    return np.asarray(np.eye(3) + 2 * s * U + 2 * U @ U)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b, shape (3,): NumPy's own takes twenty times as long for one pair."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1])
