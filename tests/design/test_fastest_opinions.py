"""Second opinions on the fastest way along a path: TOPP-RA, and an interior-point method (IPOPT in CasADi).

They share the path and its derivatives with what is tested. Forces are Pinocchio's here and the compiled
formulas' there; transcriptions and solvers are others. IPOPT keeps a jerk at the nodes only: it is faster.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from task_files import BLENDED, LINE, SMOOTHER, PapersPath

import p3dof
from p3dof.design import AxisLimits, fastest_plan
from p3dof.design.fastest import WayOfMachine
from p3dof.design.tasks.fastest import fastest_law

NONE = np.zeros((1, 6))
VISCOUS, COULOMB = 20.0, 5.0


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


def graded(count, end):
    even = np.linspace(0, 1, count + 1)
    return end * even**2 * (3 - 2 * even)


def coefficients(robot, path, place):
    """Return a, b, c of f = a s̈ + b ṡ² + c, and the sliders' rates by s, by Pinocchio."""
    pose, slope, bend = path.at(place)
    still = np.zeros_like(pose)

    def forces(velocity, acceleration):
        return np.asarray(robot.forces(pose, velocity, acceleration, method="pinocchio"))

    rest = forces(still, still)
    rate = np.einsum("nij,nj->ni", robot.jacobian(pose), slope)
    return forces(still, slope) - rest, forces(slope, bend) - rest, rest, rate


def ipopt(problem, start):
    solver = ca.nlpsol("fastest", "ipopt", problem[0], {"ipopt.print_level": 0, "print_time": False})
    found = solver(x0=start, **problem[1])
    assert solver.stats()["success"]
    return found


@pytest.mark.parametrize(
    ("task", "force", "speed"), [("paper", 120, 2), (BLENDED, 500, 2), (BLENDED, 200, 1.5)]
)
def test_topp_ra_finds_the_same_time(robot, task, force, speed):
    toppra = pytest.importorskip("toppra", reason="toppra is not installed")
    from toppra.algorithm import TOPPRA
    from toppra.constraint import DiscretizationType, LinearConstraint

    path = PapersPath() if task == "paper" else task.paths[0]
    grid = graded(600, path.end)

    class Forces(LinearConstraint):
        def __init__(self):
            super().__init__()
            self.dof, self.identical = 1, True
            self.discretization_type = DiscretizationType.Interpolation

        def compute_constraint_params(self, _, gridpoints):
            a, b, c, rate = coefficients(robot, path, gridpoints)
            both = np.vstack([np.eye(3), -np.eye(3)])
            most = (speed / np.maximum(np.abs(rate).max(axis=1), 1e-6)) ** 2
            bounds = np.column_stack([np.zeros_like(most), np.minimum(most, 1e6)])
            return a, b, c, both, np.full(6, float(force)), None, bounds

    line = toppra.SplineInterpolator(np.linspace(0, path.end, 5), np.linspace(0, path.end, 5)[:, None])
    _, pace, _ = TOPPRA([Forces()], line, gridpoints=grid, solver_wrapper="seidel").compute_parameterization(
        0, 0
    )
    expected = float((2 * np.diff(grid) / (pace[1:] + pace[:-1])).sum())
    way = WayOfMachine(robot, path, NONE, np.zeros(3))
    found = fastest_law(graded(400, path.end), way, AxisLimits(force, speed)).duration
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_ipopt_finds_the_same_time_with_friction(robot):
    """ṡ at nodes, s̈ constant between them, forces with friction at both ends and in the middle."""
    friction = p3dof.machine.Friction(viscous={"sliders": VISCOUS}, coulomb={"sliders": COULOMB})
    machine = p3dof.load(replace(robot.parameters, friction=friction))
    path, count = PapersPath(), 400
    nodes = graded(count, path.end)
    size = np.diff(nodes)
    pace = ca.SX.sym("pace", count + 1)
    change = (pace[1:] ** 2 - pace[:-1] ** 2) / (2 * size)
    limits = []
    for share in (1e-6, 0.5, 1 - 1e-6):
        a, b, c, rate = coefficients(robot, path, nodes[:-1] + share * size)
        square = (1 - share) * pace[:-1] ** 2 + share * pace[1:] ** 2
        for leg in range(3):
            speed = rate[:, leg] * ca.sqrt(square + 1e-12)
            force = a[:, leg] * change + b[:, leg] * square + c[:, leg]
            limits += [(force + VISCOUS * speed + COULOMB * np.sign(rate[:, leg])) / 120, speed / 2]
    time = ca.sum1(2 * size / (pace[1:] + pace[:-1]))
    low, high = np.full(count + 1, 1e-4), np.full(count + 1, 50.0)
    low[[0, -1]] = high[[0, -1]] = 0.0
    start = np.where(high > 0, 0.5, 0.0)
    bounds = {"lbx": low, "ubx": high, "lbg": -1, "ubg": 1}
    found = ipopt(({"x": pace, "f": time, "g": ca.vertcat(*limits)}, bounds), start)
    way = WayOfMachine(machine, path, NONE, np.zeros(3))
    own = fastest_law(graded(400, path.end), way, AxisLimits(120, 2)).duration
    assert own == pytest.approx(0.6202, rel=1e-3)
    assert own == pytest.approx(float(found["f"]), rel=3e-3)


@pytest.mark.parametrize(
    ("task", "within"), [(LINE, 1.5e-3), pytest.param(SMOOTHER, 1e-2, marks=pytest.mark.slow)]
)
def test_ipopt_finds_no_faster_motion_within_a_jerk(robot, task, within):
    """Steps between fixed places: speed, acceleration and time are unknown, the jerk of s is linear in time.

    From a start that is far from the solution, which is not one of those of the programs.
    """
    path, count, most = task.paths[0], 120, 500.0
    share = np.linspace(0, 1, count + 1)
    nodes = path.end * share**3 * (10 + share * (6 * share - 15))
    inside = path.breaks[1:-1]
    nodes[np.abs(nodes[:, None] - inside).argmin(axis=0)] = inside
    size = np.diff(nodes)
    way = WayOfMachine(robot, path, NONE, np.zeros(3), with_jerk=True)
    pace, change = ca.SX.sym("pace", count + 1), ca.SX.sym("change", count + 1)
    step, one, other = (ca.SX.sym(name, count) for name in ("step", "one", "other"))
    v, w, a, b = pace[:-1], pace[1:], change[:-1], change[1:]
    equal = [
        (v * step + a * step**2 / 2 + (3 * one + other) * step**3 / 24 - size) / size,
        v + a * step + (2 * one + other) * step**2 / 6 - w,
        a + (one + other) * step / 2 - b,
    ]
    limits = []
    for at, speed, acceleration, jerk in ((nodes[:-1], v, a, one), (nodes[1:], w, b, other)):
        need = way.demand(at, nodes[:-1] + size / 2)
        for leg in range(3):
            first, second, third = need.rate[:, leg], need.change[:, leg], need.third[:, leg]
            limits.append((third * speed**3 + 3 * second * speed * acceleration + first * jerk) / most)
    unknown = ca.vertcat(pace, change, step, one, other)
    low = np.concatenate(
        [np.zeros(count + 1), np.full(count + 1, -1e4), np.full(count, 1e-6), np.full(2 * count, -1e5)]
    )
    high = np.concatenate(
        [np.full(count + 1, 50.0), np.full(count + 1, 1e4), np.full(count, 1.0), np.full(2 * count, 1e5)]
    )
    for k in (0, count, count + 1, 2 * count + 1):
        low[k] = high[k] = 0.0
    g = ca.vertcat(*equal, *limits)
    lowest = np.concatenate([np.zeros(3 * count), -np.ones(6 * count)])
    highest = np.concatenate([np.zeros(3 * count), np.ones(6 * count)])
    duration = 1.0  # s = end (10 τ³ - 15 τ⁴ + 6 τ⁵), in equal steps of time
    rate = path.end * 30 * (share * (1 - share)) ** 2 / duration
    bend = path.end * 60 * share * (1 - share) * (1 - 2 * share) / duration**2
    jerk = path.end * 60 * (1 - 6 * share * (1 - share)) / duration**3
    start = np.concatenate([rate, bend, np.full(count, duration / count), jerk[:-1], jerk[1:]])
    bounds = {"lbx": low, "ubx": high, "lbg": lowest, "ubg": highest}
    found = float(ipopt(({"x": unknown, "f": ca.sum1(step), "g": g}, bounds), start)["f"])
    own = fastest_plan(robot, task, AxisLimits(500, 2, jerk=most), nodes=100).duration
    assert own == pytest.approx(found, rel=within)
