"""A robot with its controller that goes on step by step, for other people's time: what `robot_fmu` wraps."""

from pathlib import Path

import numpy as np

import p3dof
from p3dof.runs import JointPD, RobotMeasurement, simulate_robot

FILES = [Path(p3dof.model_files.path("gallery/five_bar")).with_suffix(end) for end in (".urdf", ".yaml")]
KP, KD = 20.0, 0.5  # [N m/rad], [N m s/rad]


class RobotInSteps:
    """At rest where its file has it; `target` may be set between any two steps [rad]."""

    def __init__(self, file=FILES[0]):
        self.loop, self.time = p3dof.load_robot(file), 0.0
        joints = [self.loop.model.joints[self.loop.model.getJointId(name)] for name in self.loop.actuated]
        self.at, self.rates = [joint.idx_q for joint in joints], [joint.idx_v for joint in joints]
        self.q, self.v = self.loop.assemble().q, np.zeros(self.loop.model.nv)
        self.target, self.torque = self.position.copy(), np.zeros(len(joints))
        self.look()

    @property
    def position(self):
        return self.q[self.at]

    @property
    def speed(self):
        return self.v[self.rates]

    def look(self):
        """Have the torques of now, without a step."""
        seen = self.position, self.speed, 0.0, self.torque > 0, self.q, self.v
        self.torque = self._controller()(RobotMeasurement(0.0, *seen))

    def step(self, duration):
        """Go on; returns whether the robot could, which ends at the limits of its joints."""
        run = simulate_robot(self.loop, duration, self.q, self.v, self._controller(), samples=2)
        self.q, self.v, self.torque, self.time = (
            run.q[-1],
            run.v[-1],
            run.forces[-1],
            self.time + run.time[-1],
        )
        return run.stop is None

    def _controller(self):
        return JointPD(self.loop, self.target, KP, KD, gravity=True)


if __name__ == "__main__":
    robot = RobotInSteps()
    robot.target[:] = 2.2, 0.9
    for _ in range(50):
        robot.step(0.02)
    print(f"after {robot.time:.2f} s at {robot.position} rad, with {robot.torque} N m")
