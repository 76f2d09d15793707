"""JAX: docs/examples/jax_forces.py, forces by callbacks, exact derivatives; traced forces in JAX itself."""

import numpy as np
import pytest
from closed_loop_robots import differences
from forces_of_motors import ROBOTS, exact, motions
from gallery import gallery
from numpy.testing import assert_allclose

import p3dof

jax = pytest.importorskip("jax", reason="jax not installed: pip install 'p3dof[jax]'")

import jax.numpy as jnp  # noqa: E402
from jax_forces import inverse_dynamics  # noqa: E402


@pytest.fixture(scope="module", autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module", params=ROBOTS)
def case(request):
    """Return the function, its robot, and samples of motions."""
    robot = ROBOTS[request.param]()
    return inverse_dynamics(robot), robot, motions(robot, 7)


def test_values_and_both_jacobians_are_the_robots(case):
    forces, robot, samples = case
    for x in samples:
        tau, J = exact(robot, x)
        size = np.abs(J).max()
        assert_allclose(forces(x), tau, rtol=0, atol=1e-12 * max(size, np.abs(tau).max()))
        for way in (jax.jacfwd, jax.jacrev):
            assert_allclose(way(forces)(x), J, rtol=0, atol=1e-10 * size)


def test_gradients_are_differences(case):
    forces, _, (x, other, *_) = case
    weights = jnp.arange(1.0, 1 + forces(x).size)

    def cost(x):
        return jnp.sum(weights * forces(x) ** 2)

    gradient = jax.grad(cost)(x)
    rates = [differences(lambda t, along=along: cost(x + t * along), h=5e-4)[0] for along in np.eye(x.size)]
    assert_allclose(gradient, rates, rtol=0, atol=1e-9 * np.abs(rates).max())
    assert np.abs(jax.grad(cost)(other) - np.array(rates)).max() > 1e-3 * np.abs(rates).max()


def test_compiled_and_vectorised_they_are_the_same(case):
    forces, robot, samples = case
    one_by_one = np.array([forces(x) for x in samples])
    size = np.abs(one_by_one).max()
    for many in (jax.jit(forces), jax.vmap(forces), jax.jit(jax.vmap(forces))):
        assert_allclose(many(samples), one_by_one, rtol=0, atol=1e-12 * size)
    J = jax.jit(jax.vmap(jax.jacrev(forces)))(samples)
    expected = np.array([exact(robot, x)[1] for x in samples])
    assert_allclose(J, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    nested = jax.vmap(jax.vmap(jax.grad(lambda x: forces(x)[0])))(np.stack([samples, samples[::-1]]))
    assert_allclose(nested[1, ::-1], expected[:, 0], rtol=0, atol=1e-10 * np.abs(expected).max())


def test_vectorised_calls_reach_p3dof_once(case, monkeypatch):
    _, robot, samples = case
    sizes, complete = [], type(robot).complete_batch

    def counted(self, y, *rest, **options):
        sizes.append(len(y))
        return complete(self, y, *rest, **options)

    monkeypatch.setattr(type(robot), "complete_batch", counted)
    jax.block_until_ready(jax.vmap(inverse_dynamics(robot))(samples))
    assert sizes == [len(samples)]


def test_what_is_out_of_reach_is_nan_beside_others():
    robot = p3dof.load().loop
    forces, samples = inverse_dynamics(robot), 0.01 * np.random.default_rng(2).normal(size=(5, 9))
    samples[2, 0] = 3.0  # a slider 3 m from the others
    found, expected = jax.vmap(forces)(samples), np.array([forces(x) for x in np.delete(samples, 2, axis=0)])
    assert np.isnan(found[2]).all()
    assert_allclose(np.delete(found, 2, axis=0), expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    with pytest.raises(Exception, match="target: expected finite numbers, got nan"):
        jax.block_until_ready(forces(np.full(9, np.nan)))


def test_a_second_derivative_is_an_error(case):
    forces, _, (x, *_) = case
    with pytest.raises(ValueError, match="callbacks do not support JVP"):
        jax.jacfwd(jax.jacrev(forces))(x)


def test_redundant_motors_are_refused():
    with pytest.raises(ValueError, match="expected as many motors as free motions, got"):
        inverse_dynamics(gallery("two_arms"))


def test_traced_forces_are_jax_to_rounding():
    """Of a transmission: forces of the motors for torques at the coordinates, and their Jacobian."""
    one = gallery("five_bar").transmission(["right_elbow", "left_elbow"])
    rng = np.random.default_rng(1)
    at = one.joint_to_actuator(np.array([1.0, -1.0]) + 0.1 * rng.normal(size=(20, 2)))
    torque = rng.normal(size=(20, 2))
    assert not at.errors
    call = one.traced("actuator", "forces", jnp)
    found = jax.jit(jax.vmap(call))(at.q, torque)["forces"]
    expected = one.actuator_forces(at.q, torque)
    assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    by = jax.jacfwd(lambda torque: call(at.q[0], torque)["forces"])(torque[0])
    columns = [one.actuator_forces(at.q[:1], row)[0] for row in np.eye(2)]
    assert_allclose(by, np.transpose(columns), rtol=0, atol=1e-12 * np.abs(columns).max())
