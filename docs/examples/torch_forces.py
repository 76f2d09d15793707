"""Forces of a closed-loop robot as a differentiable function in PyTorch, with exact gradients."""

import numpy as np
import torch

import p3dof


def inverse_dynamics(robot):
    """Return the motors' forces (..., n) as a function of positions, velocities, accelerations (..., 3n).

    Tensors are of 64 bits, on the processor. What is out of reach is NaN.
    """
    compiled, n = robot.compile(), len(robot.actuated)
    if compiled.independent != robot.actuated:
        raise ValueError(f"expected as many motors as free motions, got {robot.actuated}")

    def states(x):
        parts = np.split(x.detach().numpy().reshape(-1, 3 * n), 3, axis=-1)
        found = robot.complete_batch(*parts, method=compiled)
        return found.q, found.v, found.a

    class Forces(torch.autograd.Function):
        @staticmethod
        def forward(x):
            tau = compiled.inverse_dynamics(*states(x)).tau
            return torch.from_numpy(tau.copy()).reshape(*x.shape[:-1], n)

        @staticmethod
        def setup_context(ctx, inputs, output):  # noqa: ARG004
            ctx.save_for_backward(*inputs)
            ctx.save_for_forward(*inputs)

        @staticmethod
        def jacobian(x):
            by = compiled.inverse_dynamics_derivatives(*states(x)).by
            whole = np.concatenate([by.by_coordinates, by.by_speeds, by.by_accelerations], axis=-1)
            return torch.from_numpy(whole).reshape(*x.shape[:-1], n, 3 * n)

        @staticmethod
        @torch.autograd.function.once_differentiable
        def backward(ctx, gradient):
            return torch.einsum("...ij,...i->...j", Forces.jacobian(*ctx.saved_tensors), gradient)

        @staticmethod
        def jvp(ctx, tangent):
            return torch.einsum("...ij,...j->...i", Forces.jacobian(*ctx.saved_tensors), tangent)

    return Forces.apply


if __name__ == "__main__":
    forces = inverse_dynamics(p3dof.load_robot("gallery/five_bar.urdf"))
    x = torch.tensor([2.0, 1.1, 0.5, -0.3, 1.0, 2.0], dtype=torch.float64).repeat(1000, 1).requires_grad_()
    forces(x).square().sum().backward()
    print("forces [N m]:", forces(x)[0].tolist(), "gradient of their squares:", x.grad[0].tolist())
