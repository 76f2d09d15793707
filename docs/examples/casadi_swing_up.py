"""The swing-up of a five-bar by multiple shooting in CasADi and IPOPT, with the C of `p3dof loop codegen`."""

import tempfile

import casadi
import numpy as np
from casadi_robot import dynamics

DOWN, UP = np.full(2, -np.pi / 2), np.full(2, np.pi / 2)
OPTIONS = {"hessian_approximation": "limited-memory", "print_level": 0, "sb": "yes"}


def swing_up(accelerate, nodes=30, step=0.05, limit=1.8):
    """Return states, torques that are held for a step [s] each and within a limit, and what they cost."""
    problem = casadi.Opti()
    xs, us, cost = problem.variable(4, nodes + 1), problem.variable(2, nodes), 0

    def rate(x, u):
        return casadi.vertcat(
            x[2:], accelerate(x, u), (0.1 * casadi.sumsqr(u) + 0.01 * casadi.sumsqr(x[2:])) / 2
        )

    for i in range(nodes):
        x, u = xs[:, i], us[:, i]
        a = rate(x, u)  # the classical Runge-Kutta method
        b = rate(x + step / 2 * a[:-1], u)
        c = rate(x + step / 2 * b[:-1], u)
        way = step / 6 * (a + 2 * b + 2 * c + rate(x + step * c[:-1], u))
        cost += way[-1]
        problem.subject_to(xs[:, i + 1] == x + way[:-1])
    problem.subject_to(problem.bounded(-limit, casadi.vec(us), limit))
    problem.subject_to(xs[:, 0] == np.r_[DOWN, 0, 0])
    problem.subject_to(xs[:, -1] == np.r_[UP, 0, 0])
    problem.set_initial(xs[:2, :], np.linspace(DOWN, UP, nodes + 1).T)
    problem.minimize(cost)
    problem.solver("ipopt", {"print_time": False}, OPTIONS)
    found = problem.solve()
    return found.value(xs).T, found.value(us).T, found.value(cost)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        _, torques, least = swing_up(dynamics("gallery/five_bar.urdf", made))
    print("cost:", least, "largest torque [N m]:", np.abs(torques).max())
