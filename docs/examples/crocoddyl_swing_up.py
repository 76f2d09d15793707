"""A five-bar swings up by motors that cannot hold its arms level: Crocoddyl's FDDP with bounded torques."""

import crocoddyl
import numpy as np
from crocoddyl_robot import RobotAction

import p3dof

DOWN, UP = np.full(2, -np.pi / 2), np.full(2, np.pi / 2)
NODES, STEP = 30, 0.05  # s


def problem(robot, limit=np.inf):
    """Return the shooting problem from rest to rest, its torques held for a step each."""
    start, goal = np.r_[DOWN, 0, 0], np.r_[UP, 0, 0]
    swing = RobotAction(robot, goal, [0, 0, 0.01, 0.01], 0.1, limit)
    step = crocoddyl.IntegratedActionModelRK(swing, crocoddyl.RKType.four, STEP)
    end = crocoddyl.IntegratedActionModelEuler(RobotAction(robot, goal, [100] * 4, 0.0), 0.0)
    return crocoddyl.ShootingProblem(start, [step] * NODES, end)


def swing_up(robot, limit=1.8):
    """Return the solver with the states and torques, first without a limit, then with one [N m]."""
    free = crocoddyl.SolverFDDP(problem(robot))
    free.th_stop = 1e-4
    line = [np.r_[DOWN + share * (UP - DOWN), 0, 0] for share in np.linspace(0, 1, NODES + 1)]
    free.solve(line, [np.zeros(2)] * NODES, 100)
    bounded = crocoddyl.SolverBoxFDDP(problem(robot, limit))
    bounded.th_stop = 1e-4
    if not bounded.solve(list(free.xs), list(free.us), 100):
        raise RuntimeError(f"not solved: {bounded.stop} after {bounded.iter} iterations")
    return bounded


def simulate(robot, solver):
    """Return a run of p3dof under the torques of the solution and the gains that FDDP gives."""

    def controller(seen):
        i = min(round(seen.time / STEP), NODES - 1)
        return solver.us[i] - solver.K[i] @ (np.r_[seen.positions, seen.velocities] - solver.xs[i])

    held, where = p3dof.runs.ControlLoop(rate=1 / STEP), {"samples": NODES + 1, "stop_at": ()}
    return p3dof.runs.simulate_robot(
        robot, NODES * STEP, robot.assemble(DOWN).q, controller=controller, control=held, **where
    )


if __name__ == "__main__":
    five_bar = p3dof.load_robot("gallery/five_bar.urdf")
    solved = swing_up(five_bar)
    run = simulate(five_bar, solved)
    print("iterations:", solved.iter, "largest torque [N m]:", np.abs(solved.us).max())
    print("left at the end [rad, rad/s]:", solved.xs[-1] - np.r_[UP, 0, 0])
    print("p3dof ends elsewhere by [rad]:", run.q[-1, five_bar.actuated_v] - solved.xs[-1][:2])
