"""Differential inverse kinematics of a closed-loop robot in Pink, its closures a task or a constraint."""

import numpy as np
import pink
import pinocchio as pin

import p3dof


class ClosureTask(pink.tasks.Task):
    """All closures and couplings of a p3dof robot, in as many rows as are independent."""

    def __init__(self, robot, cost=1e3):
        super().__init__(cost=cost)
        self.robot = robot

    def compute_error(self, configuration, jacobian=False):
        """Return the errors of the closures [m, rad]."""
        J = self.robot.closure_jacobian(configuration.q)
        U, values, _ = np.linalg.svd(J)
        along = U[:, : np.count_nonzero(values > 1e-9 * values[0])].T
        return along @ (J if jacobian else self.robot.closure_error(configuration.q))

    def compute_jacobian(self, configuration):
        """Return their Jacobian by the velocities of the tree."""
        return self.compute_error(configuration, jacobian=True)

    def __repr__(self):
        return f"ClosureTask({self.robot!r}, cost={self.cost})"


def reach(robot, frame, target, strict=True, gain=1.0, steps=30):
    """Return the configurations on the way of a frame to a target (`pinocchio.SE3`).

    Loops are closed strictly, or as a task at its cost; a small gain moves in small steps.
    """
    home = robot.assemble().q
    configuration = pink.Configuration(robot.model, robot.model.createData(), home)
    task, closed = pink.tasks.FrameTask(frame, 1.0, 1.0, gain=gain), ClosureTask(robot)
    task.set_target(target)
    tasks, constraints, way = ([task], [closed], [home]) if strict else ([task, closed], [], [home])
    for _ in range(steps):
        v = pink.solve_ik(configuration, tasks, 1.0, "daqp", damping=1e-9, constraints=constraints)
        configuration.integrate_inplace(v, 1.0)
        way.append(configuration.q)
    return np.array(way)


if __name__ == "__main__":
    stewart = p3dof.load_robot("gallery/stewart.urdf")
    goal = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.05, 0.2), np.array([0.03, 0.02, 0.52]))
    q = reach(stewart, "platform", goal)[-1]
    ours = stewart.assemble(p3dof.FrameTarget("platform", goal)).q
    opening = np.abs(stewart.closure_error(q)).max()
    print("loops open by [m]:", opening, "joints elsewhere by [m, rad]:", np.abs(q - ours).max())
