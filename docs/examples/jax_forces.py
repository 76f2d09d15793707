"""Forces of a closed-loop robot as a JAX function, with exact derivatives in both modes."""

import jax
import jax.numpy as jnp
import numpy as np

import p3dof


def inverse_dynamics(robot):
    """Return the motors' forces (..., n) as a function of positions, velocities, accelerations (..., 3n).

    JAX calls p3dof, once for many samples; what is out of reach is NaN. It needs ``jax.enable_x64``.
    """
    compiled, m = robot.compile(), len(robot.actuated)
    if compiled.independent != robot.actuated:
        raise ValueError(f"expected as many motors as free motions, got {robot.actuated}")

    def states(x):
        parts = np.split(np.asarray(x).reshape(-1, x.shape[-1]), 3, axis=-1)
        found = robot.complete_batch(*parts, method=compiled)
        return found.q, found.v, found.a

    def value(x):
        return compiled.inverse_dynamics(*states(x)).tau.reshape(*x.shape[:-1], m)

    def jacobian(x):
        by = compiled.inverse_dynamics_derivatives(*states(x)).by
        whole = np.concatenate([by.by_coordinates, by.by_speeds, by.by_accelerations], axis=-1)
        return whole.reshape(*x.shape[:-1], m, x.shape[-1])

    def called(function, x, *shape):
        shaped = jax.ShapeDtypeStruct((*x.shape[:-1], *shape), jnp.float64)
        return jax.pure_callback(function, shaped, x, vmap_method="broadcast_all")

    @jax.custom_jvp
    def forces(x):
        return called(value, x, m)

    @forces.defjvp
    def tangent(primals, tangents):
        (x,), (dx,) = primals, tangents
        J = called(jacobian, x, m, x.shape[-1])
        return forces(x), jnp.einsum("...ij,...j->...i", J, dx)

    return forces


if __name__ == "__main__":
    with jax.enable_x64(True):
        forces = inverse_dynamics(p3dof.load_robot("gallery/five_bar.urdf"))
        square = jax.jit(jax.vmap(jax.value_and_grad(lambda x: jnp.sum(forces(x) ** 2))))
        values, gradients = square(
            jnp.linspace(1.0, 1.1, 1000)[:, None] * jnp.array([2.0, 1.1, 0.5, -0.3, 1, 2])
        )
        print("squares of the torques:", values[::300], "gradient of the last:", gradients[-1])
