"""Any closed-loop robot in Crocoddyl, in independent coordinates with exact derivatives."""

import crocoddyl
import numpy as np

import p3dof


class RobotAction(crocoddyl.DifferentialActionModelAbstract):
    """Accelerations of the motors y under their forces u; the cost is (w·(x - goal)² + force · u²) / 2.

    The state is x = (y, ẏ); each motor has one coordinate. Loops are closed from where they were last.
    """

    def __init__(self, robot, goal, weights, force, limit=np.inf):
        super().__init__(crocoddyl.StateVector(len(goal)), len(robot.actuated))
        self.robot, self.compiled, self.q = robot, robot.compile(), robot.assemble().q
        self.flow, self.rows = self.compiled.bind("flow"), list(self.compiled.independent_places)
        self.at = [
            robot.model.joints[robot.model.getJointId(name)].idx_q for name in self.compiled.independent
        ]
        self.goal, self.weights, self.force = np.asarray(goal), np.asarray(weights), force
        self.u_lb, self.u_ub = np.full(self.nu, -limit), np.full(self.nu, limit)

    def calc(self, data, x, u=None):
        """Set the acceleration and the cost; the acceleration of a state out of reach is NaN."""
        error, u = x - self.goal, np.zeros(self.nu) if u is None else u
        data.cost = (self.weights @ error**2 + self.force * u @ u) / 2
        given, found, n, q = self.flow.inputs, self.flow.outputs, len(x) // 2, self.q.copy()
        given["v_independent"][:], given["tau"][:] = x[n:], u
        way = x[:n] - q[self.at]
        pieces = max(1, min(int(np.abs(way).max() / 0.2), 50)) if np.isfinite(way).all() else 1  # rad
        for _ in range(pieces):
            q[self.at] += way / pieces
            for _ in range(6):  # steps of Newton's method
                given["q"][:] = q
                self.flow.run()
                q[:] = found["q"]
                if found["gap"][0] < 1e-12:
                    break
        closed = found["trusted"][0] > 0 and found["gap"][0] < 1e-9
        self.q = q if closed else self.q
        data.xout = found["a_independent"].copy() if closed else np.full(n, np.nan)

    def calcDiff(self, data, x, u=None):  # noqa: N802
        """Set the derivatives of both, those of the acceleration on the manifold of closed loops."""
        u = np.zeros(self.nu) if u is None else u
        self.calc(data, x, u)
        by = self.compiled.forward_dynamics_derivatives(self.q, self.flow.outputs["v"], u).by
        data.Fx = np.hstack([by.by_coordinates, by.by_speeds])[self.rows]
        data.Fu = by.by_forces[self.rows]
        data.Lx, data.Lxx = self.weights * (x - self.goal), np.diag(self.weights)
        data.Lu, data.Luu = self.force * u, self.force * np.eye(self.nu)


if __name__ == "__main__":
    action = RobotAction(p3dof.load().loop, np.zeros(6), np.ones(6), 1.0)
    found = action.createData()
    action.calcDiff(found, np.full(6, 0.02), np.full(3, 50.0))
    print("accelerations [m/s²]:", found.xout, "their derivatives by the forces [1/kg]:", *found.Fu)
