"""PyTorch: docs/examples/torch_forces.py, forces of a closed-loop robot with exact gradients."""

import numpy as np
import pytest
from forces_of_motors import ROBOTS, exact, motions
from gallery import gallery
from numpy.testing import assert_allclose

torch = pytest.importorskip("torch", reason="torch not installed: pip install 'p3dof[torch]'")

from torch_forces import inverse_dynamics  # noqa: E402

# What torch does of its own when it first differentiates forward.
pytestmark = pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:DeprecationWarning")


@pytest.fixture(scope="module", params=ROBOTS)
def case(request):
    """Return the function, its robot, and samples of motions."""
    robot = ROBOTS[request.param]()
    return inverse_dynamics(robot), robot, torch.tensor(motions(robot, 4))


def test_values_and_jacobians_are_the_robots(case):
    forces, robot, samples = case
    expected = [exact(robot, x) for x in samples.numpy()]
    size = max(np.abs(J).max() for _, J in expected)
    assert_allclose(forces(samples), [tau for tau, _ in expected], rtol=0, atol=1e-12 * size)
    for x, (_, J) in zip(samples, expected, strict=True):
        found = torch.autograd.functional.jacobian(forces, x)
        assert_allclose(found, J, rtol=0, atol=1e-10 * size)
        with torch.autograd.forward_ad.dual_level():
            dual = torch.autograd.forward_ad.make_dual(x, torch.ones_like(x))
            tangent = torch.autograd.forward_ad.unpack_dual(forces(dual)).tangent
        assert_allclose(tangent, J.sum(axis=1), rtol=0, atol=1e-10 * size * x.numel())


def test_gradients_are_torchs_own_differences(case):
    forces, _, samples = case
    x = samples.clone().requires_grad_()
    size = float(forces(x).detach().abs().max())
    how = {"eps": 1e-6, "atol": 1e-6, "rtol": 1e-6}
    assert torch.autograd.gradcheck(lambda x: forces(x) / size, x, check_forward_ad=True, **how)

    class Wrong(torch.autograd.Function):
        @staticmethod
        def forward(ctx, tau):  # noqa: ARG004
            return tau.clone()

        @staticmethod
        def backward(ctx, gradient):  # noqa: ARG004
            return 1.001 * gradient

    with pytest.raises(RuntimeError, match="Jacobian mismatch"):
        torch.autograd.gradcheck(lambda x: Wrong.apply(forces(x) / size), x, **how)


def test_a_motion_is_improved_by_an_optimiser_of_torch(case):
    """Accelerations without forces are found: the sum of squares goes to zero."""
    forces, robot, samples = case
    n = len(robot.actuated)
    fixed = samples[:, : 2 * n]
    a = samples[:, 2 * n :].clone().requires_grad_()
    optimiser = torch.optim.LBFGS([a], max_iter=200, tolerance_grad=1e-12, line_search_fn="strong_wolfe")

    def cost():
        optimiser.zero_grad()
        total = forces(torch.cat([fixed, a], dim=-1)).square().sum()
        total.backward()
        return total

    before = cost().item()
    optimiser.step(cost)
    assert cost().item() < 1e-12 * before
    state = robot.complete(*np.split(torch.cat([fixed, a], dim=-1)[0].detach().numpy(), 3))
    free = robot.forward_dynamics(state.q, state.v, np.zeros(n))
    assert_allclose(a[0].detach(), free.a[robot.actuated_v], rtol=0, atol=1e-5 * np.abs(free.a).max())


def test_redundant_motors_are_refused():
    with pytest.raises(ValueError, match="expected as many motors as free motions, got"):
        inverse_dynamics(gallery("two_arms"))
