"""Forces of other people's robots against d'Alembert's principle with closures differentiated numerically.

The reference shares nothing with the package's closures: see `virtual_motions`.
"""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from other_robots import load, others
from virtual_motions import errors, smallest_forces, virtual_motions


@pytest.mark.parametrize("name", others())
def test_forces_are_those_of_virtual_motions(name):
    loop = load(name)
    model, rng = loop.model, np.random.default_rng(3)
    home = loop.assemble().q
    q = loop.assemble(None, pin.integrate(model, home, 0.1 * rng.uniform(-1, 1, model.nv))).q
    assert np.abs(errors(loop, q)).max() < 1e-9
    N = virtual_motions(loop, q)
    assert N.shape[1] == loop.mobility(q) == model.nv - loop.generic_rank
    v = N @ rng.normal(size=N.shape[1])
    prescribed = rng.normal(size=len(loop.actuated))
    found = loop.hybrid_dynamics(q, v, prescribed)
    f = pin.rnea(model, model.createData(), q, v, found.a)
    tau = smallest_forces(loop, N, f)
    size = max(np.abs(f).max(), np.abs(tau).max())
    np.testing.assert_allclose(found.tau, tau, rtol=0, atol=1e-10 * size)
    again = loop.inverse_dynamics(q, v, found.a)
    np.testing.assert_allclose(again.tau, tau, rtol=0, atol=1e-10 * size)
    forward = loop.forward_dynamics(q, v, tau)
    np.testing.assert_allclose(forward.a, found.a, rtol=0, atol=1e-9 * max(1.0, np.abs(found.a).max()))
    # The acceleration keeps the loops closed: along q(t) the errors have no second derivative.
    size = max(1.0, np.abs(found.a).max(), np.abs(v).max() ** 2)
    rate, curvature = robots.differences(
        lambda t: errors(loop, pin.integrate(model, q, v * t + found.a * t * t / 2)), h=5e-3 / np.sqrt(size)
    )
    assert np.abs(rate).max() < 1e-9 * size
    assert np.abs(curvature).max() < 1e-7 * size
