"""Third derivation of the dynamics, for tests only: Lagrange's equations in x = (y, z, θ) by CasADi.

Nothing but `p3dof.machine.parameters` is shared with the package. Each body's origin and orientation matrix
are written as functions of x from the geometry, without joint angles; everything else is differentiation:

    T = Σ ½ m |ċ|² + ½ ωᵀ I ω   with  ω× = Ṙ Rᵀ,      V = -Σ m g·c
    Q = d/dt ∂T/∂ẋ - ∂T/∂x + ∂V/∂x - ∂(F·Ṗ + M·ω)/∂ẋ,  Jᵀ f = Q  with  J = ∂λ/∂x

The parameters are inputs of the compiled functions, which are built once and serve every machine.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof.machine.parameters import SLIDES, Bodies, Body, Geometry, Parameters

Array = NDArray[np.float64]

BODIES = (
    "slider_a",
    "leg_a",
    "slider_b",
    "leg_b",
    "slider_c",
    "crossbar_upper",
    "rod_left",
    "crossbar_lower",
    "platform",
    "rod_right",
)
"""Order of the bodies in every result that has one row a body."""

_X0, _Y0 = ca.DM([1, 0, 0]), ca.DM([0, 1, 0])
_GEOMETRY, _GRAVITY, _BODY = 4, 3, 13  # how many numbers describe each: r R L b, g, and m c(3) I(9)


class LagrangeModel:
    """One machine; every method takes arrays with any leading dimensions, which broadcast against each other.

    pose, velocity, acceleration : (..., 3) y, z, θ and their derivatives; wrench : (..., 6) force and moment
    on the platform at P, fixed axes; forces : (..., 3) of actuators A, B, C, positive along +z0. Out of reach
    the results are nan.
    """

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self._constants = pack(parameters)

    def forces(
        self, pose: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, wrench: ArrayLike | None = None
    ) -> Array:
        """Actuator forces (..., 3) [N]."""
        Q = self.generalized_forces(pose, velocity, acceleration, wrench)
        transposed = np.swapaxes(self.jacobian(pose), -1, -2)
        return np.linalg.solve(transposed, Q[..., None])[..., 0]

    def accelerations(
        self, pose: ArrayLike, velocity: ArrayLike, forces: ArrayLike, wrench: ArrayLike | None = None
    ) -> Array:
        """Forward dynamics: ÿ, z̈, θ̈ (..., 3) under given actuator forces."""
        bias = self.generalized_forces(pose, velocity, np.zeros(3), wrench)
        drive = np.einsum("...ij,...i->...j", self.jacobian(pose), np.asarray(forces, float)) - bias
        return np.linalg.solve(self.mass_matrix(pose), drive[..., None])[..., 0]

    def generalized_forces(
        self, pose: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, wrench: ArrayLike | None = None
    ) -> Array:
        """Forces on y, z, θ (..., 3) that the actuators have to supply [N, N, N m]."""
        wrench = np.zeros(6) if wrench is None else wrench
        return self._call("generalized_forces", (3,), pose, velocity, acceleration, wrench)

    def sliders(self, pose: ArrayLike) -> Array:
        """Slider positions λ (..., 3) [m]."""
        return self._call("sliders", (3,), pose)

    def slider_velocities(self, pose: ArrayLike, velocity: ArrayLike) -> Array:
        """λ̇ (..., 3) [m/s]."""
        return self._call("slider_velocities", (3,), pose, velocity)

    def slider_accelerations(self, pose: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> Array:
        """λ̈ (..., 3) [m/s²]."""
        return self._call("slider_accelerations", (3,), pose, velocity, acceleration)

    def jacobian(self, pose: ArrayLike) -> Array:
        """J = ∂λ/∂x (..., 3, 3)."""
        return self._call("jacobian", (3, 3), pose)

    def mass_matrix(self, pose: ArrayLike) -> Array:
        """M = ∂²T/∂ẋ² (..., 3, 3), for x = (y, z, θ)."""
        return self._call("mass_matrix", (3, 3), pose)

    def body_kinetic_energies(self, pose: ArrayLike, velocity: ArrayLike) -> Array:
        """Kinetic energy of each body (..., 10) [J], in the order of `BODIES`."""
        return self._call("kinetic_energies", (10,), pose, velocity)

    def kinetic_energy(self, pose: ArrayLike, velocity: ArrayLike) -> Array:
        """T (...) [J]."""
        return self.body_kinetic_energies(pose, velocity).sum(axis=-1)

    def potential_energy(self, pose: ArrayLike) -> Array:
        """V (...) [J], zero where every mass centre is at the origin O."""
        return self._call("potential_energy", (), pose)

    def energy(self, pose: ArrayLike, velocity: ArrayLike) -> Array:
        """T + V (...) [J]."""
        return self.kinetic_energy(pose, velocity) + self.potential_energy(pose)

    def origins(self, pose: ArrayLike) -> Array:
        """Origins of the body frames (..., 10, 3) [m]."""
        return self._call("origins", (10, 3), pose)

    def orientations(self, pose: ArrayLike) -> Array:
        """Axes of the body frames as columns (..., 10, 3, 3)."""
        return self._call("orientations", (10, 3, 3), pose)

    def mass_centers(self, pose: ArrayLike) -> Array:
        """Mass centres in the fixed frame (..., 10, 3) [m]."""
        return self._call("mass_centers", (10, 3), pose)

    def mass_center_velocities(self, pose: ArrayLike, velocity: ArrayLike) -> Array:
        """Velocities of the mass centres, fixed axes (..., 10, 3) [m/s]."""
        return self._call("mass_center_velocities", (10, 3), pose, velocity)

    def angular_velocities(self, pose: ArrayLike, velocity: ArrayLike) -> Array:
        """Angular velocities, fixed axes (..., 10, 3) [rad/s]."""
        return self._call("angular_velocities", (10, 3), pose, velocity)

    def _call(self, name: str, shape: tuple[int, ...], *arguments: ArrayLike) -> Array:
        arrays = [np.asarray(argument, dtype=float) for argument in arguments]
        batch = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
        columns = [np.broadcast_to(a, (*batch, a.shape[-1])).reshape(-1, a.shape[-1]).T for a in arrays]
        # Arguments of N columns make CasADi map the function; the constants are repeated by it.
        result = _functions()[name](self._constants, *columns)
        return result.full().T.reshape((*batch, *shape))


def lagrange_forces(
    parameters: Parameters,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    wrench: ArrayLike | None = None,
) -> Array:
    """Actuator forces (..., 3) [N] of one machine; see `LagrangeModel`."""
    return LagrangeModel(parameters).forces(pose, velocity, acceleration, wrench)


def pack(parameters: Parameters) -> Array:
    """All constants of a machine in one vector: r R L b, gravity, and m, com, inertia of each body."""
    geometry, bodies = parameters.geometry, parameters.bodies
    rows = [getattr(bodies, name) for name in BODIES]
    return np.concatenate(
        [
            [geometry.r, geometry.R, geometry.L, geometry.b],
            parameters.gravity,
            *(np.concatenate([[body.mass], body.com, body.inertia.ravel()]) for body in rows),
        ]
    )


def general_parameters(seed: int) -> Parameters:
    """A machine without any symmetry: ten different bodies of full inertia, gravity askew, other lengths."""
    rng = np.random.default_rng(seed)
    geometry = Geometry(
        r=rng.uniform(0.05, 0.15), R=rng.uniform(0.2, 0.3), L=rng.uniform(0.38, 0.5), b=rng.uniform(0.02, 0.1)
    )
    bodies = Bodies(**{name: cloud_body(*random_cloud(rng)) for name in BODIES})
    return Parameters(geometry, bodies, gravity=rng.normal(0, 6, 3))


def random_cloud(rng: np.random.Generator, points: int = 5) -> tuple[Array, Array]:
    """Masses (points,) and positions (points, 3) of point masses."""
    return rng.uniform(0.1, 1, points), rng.uniform(-0.3, 0.3, (points, 3))


def cloud_body(masses: Array, positions: Array) -> Body:
    """The rigid body made of point masses."""
    mass = masses.sum()
    com = masses @ positions / mass
    d = positions - com
    inertia = np.einsum("p,pk,pk->", masses, d, d) * np.eye(3) - np.einsum("p,pi,pj->ij", masses, d, d)
    return Body(mass, com, (inertia + inertia.T) / 2)


def _placements(geometry: ca.SX, x: ca.SX) -> tuple[ca.SX, dict[str, tuple[ca.SX, ca.SX]]]:
    """Slider positions λ (3,), and origin and orientation of each body, from the geometry alone."""
    r, R, L, b = ca.vertsplit(geometry)
    y, z, theta = ca.vertsplit(x)
    home = _drop(L, R - r)  # h
    P = ca.vertcat(0, y, z - home)
    turned = ca.vertcat(
        ca.horzcat(ca.cos(theta), 0, ca.sin(theta)),
        ca.horzcat(0, 1, 0),
        ca.horzcat(-ca.sin(theta), 0, ca.cos(theta)),
    )
    A3 = P + turned @ ca.vertcat(0, -r, 0)
    B3 = P + turned @ ca.vertcat(0, r, 0)
    C5 = P + turned @ ca.vertcat(-r, 0, 0)

    # Sliders stand above their joints: by Pythagoras from L and the horizontal distance to be bridged.
    A2 = ca.vertcat(0, -R, A3[2] + _drop(L, A3[1] + R))
    B2 = ca.vertcat(0, R, B3[2] + _drop(L, B3[1] - R))
    reach = _drop(L, C5[1])  # length of the rods seen along y0
    C2 = ca.vertcat(-R, 0, C5[2] + _drop(reach, C5[0] + R))

    # The bars of leg C turn about y0 so that the plane of the parallelogram (y0 and `along`) holds C2 and C5.
    along = ca.vertcat(C5[0] - C2[0], 0, C5[2] - C2[2]) / reach
    along_home = ca.vertcat(R - r, 0, -home) / L
    bar = (
        ca.horzcat(along, _Y0, ca.cross(along, _Y0))
        @ ca.horzcat(along_home, _Y0, ca.cross(along_home, _Y0)).T
    )
    rod = _rod_frame((C5 - C2) / L, ca.cross(along, _Y0))
    left, right = C2 + bar @ ca.vertcat(0, b, 0), C2 + bar @ ca.vertcat(0, -b, 0)

    fixed = ca.SX.eye(3)
    placements = {
        "slider_a": (A2, fixed),
        "leg_a": (A2, _rod_frame((A3 - A2) / L, _X0)),
        "slider_b": (B2, fixed),
        "leg_b": (B2, _rod_frame((B3 - B2) / L, _X0)),
        "slider_c": (C2, fixed),
        "crossbar_upper": (C2, bar),
        "rod_left": (left, rod),
        "crossbar_lower": (C5, bar),
        "platform": (P, turned),
        "rod_right": (right, rod),
    }
    return ca.vertcat(A2[2], B2[2], C2[2]), placements


def _drop(length: ca.SX, offset: ca.SX) -> ca.SX:
    return ca.sqrt((length - offset) * (length + offset))


def _rod_frame(direction: ca.SX, hinge: ca.SX) -> ca.SX:
    return ca.horzcat(direction, hinge, ca.cross(direction, hinge))


@cache
def _functions() -> dict[str, ca.Function]:
    """Compile everything: name -> function of (constants, pose[, velocity[, acceleration[, wrench]]])."""
    constants = ca.SX.sym("constants", _GEOMETRY + _GRAVITY + _BODY * len(BODIES))
    x, xd, xdd = (ca.SX.sym(name, 3) for name in ("x", "xd", "xdd"))
    wrench = ca.SX.sym("wrench", 6)

    def rate(expression: ca.SX) -> ca.SX:
        """Time derivative of a column that depends on x and ẋ."""
        return ca.jtimes(expression, x, xd) + ca.jtimes(expression, xd, xdd)

    geometry, gravity, inertial = ca.vertsplit(
        constants, [0, _GEOMETRY, _GEOMETRY + _GRAVITY, constants.numel()]
    )
    sliders, placements = _placements(geometry, x)
    centers, velocities, spins, kinetic, potential = [], [], [], [], ca.SX(0)
    for name, data in zip(BODIES, ca.vertsplit(inertial, _BODY), strict=True):
        origin, axes = placements[name]
        mass, com, inertia = data[0], data[1:4], ca.reshape(data[4:], 3, 3)
        center = origin + axes @ com
        velocity = rate(center)
        spin = _vee(ca.reshape(rate(ca.vec(axes)), 3, 3) @ axes.T)  # ω× = Ṙ Rᵀ
        own = axes.T @ spin  # in body axes
        kinetic.append(mass * ca.dot(velocity, velocity) / 2 + ca.dot(own, inertia @ own) / 2)
        potential -= mass * ca.dot(gravity, center)
        centers.append(center)
        velocities.append(velocity)
        spins.append(spin)

    T = sum(kinetic)
    platform = BODIES.index("platform")
    power = ca.dot(wrench[:3], rate(placements["platform"][0])) + ca.dot(wrench[3:], spins[platform])
    Q = rate(ca.gradient(T, xd)) - ca.gradient(T, x) + ca.gradient(potential, x) - ca.gradient(power, xd)
    jacobian = ca.jacobian(sliders, x)

    outputs = {
        "sliders": (sliders, 1),
        "jacobian": (ca.vec(jacobian.T), 1),
        "mass_matrix": (ca.vec(ca.hessian(T, xd)[0]), 1),
        "potential_energy": (potential, 1),
        "origins": (ca.vertcat(*(placements[name][0] for name in BODIES)), 1),
        "orientations": (ca.vertcat(*(ca.vec(placements[name][1].T) for name in BODIES)), 1),
        "mass_centers": (ca.vertcat(*centers), 1),
        "mass_center_velocities": (ca.vertcat(*velocities), 2),
        "angular_velocities": (ca.vertcat(*spins), 2),
        "kinetic_energies": (ca.vertcat(*kinetic), 2),
        "slider_velocities": (jacobian @ xd, 2),
        "slider_accelerations": (rate(jacobian @ xd), 3),
        "generalized_forces": (Q, 4),
    }
    inputs = (x, xd, xdd, wrench)
    return {
        name: ca.Function(name, [constants, *inputs[:count]], [ca.densify(expression)])
        for name, (expression, count) in outputs.items()
    }


def _vee(skew: ca.SX) -> ca.SX:
    return ca.vertcat(skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]) / 2


HINGES = {  # the two bodies of each hinge; None is at rest
    "hinge_a": ("slider_a", "leg_a"),
    "hinge_b": ("slider_b", "leg_b"),
    "hinge_c": ("slider_c", "crossbar_upper"),
    "hinge_left": ("crossbar_upper", "rod_left"),
    "hinge_right": ("crossbar_upper", "rod_right"),
    "hinge_lower": ("rod_left", "crossbar_lower"),
    "hinge_platform": ("crossbar_lower", "platform"),
    "hinge_lower_right": ("rod_right", "crossbar_lower"),
}
UNIVERSALS = {"universal_a": ("leg_a", "platform"), "universal_b": ("leg_b", "platform")}


def friction_forces(parameters, pose, velocity):
    """Generalised forces against y, z, θ, and their power, at one sample, from Lagrange's spins."""
    model, friction = LagrangeModel(parameters), parameters.friction
    spins = np.stack([model.angular_velocities(pose, unit) for unit in np.eye(3)], axis=-1)  # (10, 3, 3)
    spin = {name: spins[i] for i, name in enumerate(BODIES)}
    rates = {}
    for name, (one, other) in HINGES.items():
        relative = spin[other] - spin[one]  # along the hinge for every velocity
        axis = np.linalg.svd(relative)[0][:, 0]
        np.testing.assert_allclose(
            relative, np.outer(axis, axis @ relative), rtol=0, atol=1e-9 * abs(relative).max()
        )
        rates[name] = [axis @ relative]
    for name, (one, other) in UNIVERSALS.items():
        rates[name] = list((spin[other] - spin[one])[:2])
        np.testing.assert_allclose((spin[other] - spin[one])[2], 0, rtol=0, atol=1e-12)
    jacobian = model.jacobian(pose)
    rates |= {name: [jacobian[i]] for i, name in enumerate(SLIDES)}
    total = np.zeros(3)
    for name in friction.joints:
        for row in rates[name]:
            rate = row @ velocity
            smooth = np.tanh(rate / friction.smoothing)
            total += row * (friction.viscous.get(name, 0) * rate + friction.coulomb.get(name, 0) * smooth)
    return total, total @ velocity
