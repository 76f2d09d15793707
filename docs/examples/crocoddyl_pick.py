"""The paper's machine fetches a payload and carries it off: Crocoddyl's FDDP, two robots in one problem."""

import crocoddyl
import numpy as np
from crocoddyl_robot import RobotAction

import p3dof

NODES, STEP = 40, 0.0125  # s; the payload is taken halfway
PAYLOAD = 10.0  # kg
POSES = np.array([[0, 0, 0], [0.05, -0.1, 0.1], [-0.05, 0.02, -0.2]])  # y, z [m], θ [rad]: start, pick, place


def robots():
    """Return the closed-loop robot empty and laden, and its sliders' places at the poses [m]."""
    empty, laden = p3dof.load(), p3dof.load(p3dof.PAPER.carrying(PAYLOAD))
    return empty.loop, laden.loop, empty.inverse_kinematics(POSES).sliders


def pick(empty, laden, places):
    """Return the solver with states and forces: at rest at every place."""
    rest = np.hstack([places, np.zeros_like(places)])
    half = NODES // 2

    def step(robot, goal, weight=0.0):
        action = RobotAction(robot, goal, [weight] * 6, 1e-5)
        return crocoddyl.IntegratedActionModelRK(action, crocoddyl.RKType.four, STEP)

    steps = [step(empty, rest[1])] * half + [step(laden, rest[1], 1e9)] + [step(laden, rest[2])] * (half - 1)
    end = crocoddyl.IntegratedActionModelEuler(RobotAction(laden, rest[2], [1e7] * 6, 0.0), 0.0)
    solver = crocoddyl.SolverFDDP(crocoddyl.ShootingProblem(rest[0], steps, end))
    solver.th_stop = 1e-8
    if not solver.solve([rest[0]] * (NODES + 1), [np.zeros(3)] * NODES, 100):
        raise RuntimeError(f"not solved: {solver.stop} after {solver.iter} iterations")
    return solver


def simulate(empty, laden, solver):
    """Return two runs of p3dof under the forces of the solution, the second one from the end of the first."""
    half, held, at, found = NODES // 2, p3dof.runs.ControlLoop(rate=1 / STEP), (None, None), []
    for robot, forces in ((empty, list(solver.us)[:half]), (laden, list(solver.us)[half:])):

        def controller(seen, u=forces):
            return u[min(round(seen.time / STEP), half - 1)]

        run = p3dof.runs.simulate_robot(robot, half * STEP, *at, controller, control=held, samples=half + 1)
        at = run.q[-1], run.v[-1]
        found.append(run)
    return found


if __name__ == "__main__":
    parts = robots()
    solved = pick(*parts)
    _, back = simulate(*parts[:2], solved)
    print("iterations:", solved.iter, "largest force [N]:", np.abs(solved.us).max())
    print("sliders elsewhere [m]:", solved.xs[NODES // 2][:3] - parts[2][1], solved.xs[-1][:3] - parts[2][2])
    print("p3dof ends elsewhere by [m]:", back.q[-1, parts[0].actuated_v] - solved.xs[-1][:3])
