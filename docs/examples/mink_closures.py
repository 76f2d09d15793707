"""Differential inverse kinematics of a closed-loop robot in mink, from the MJCF that p3dof writes."""

import tempfile
from pathlib import Path

import mink
import mujoco
import numpy as np
import pinocchio as pin

import p3dof


def reach(robot, frame, target, strict=True, gain=1.0, steps=30):
    """Return the actuated joints and the errors of all closures on the way of a frame to a target.

    MuJoCo's equality constraints close the loops: strictly, or as a task at its cost.
    """
    with tempfile.TemporaryDirectory() as folder:
        (file,) = robot.write(Path(folder) / "robot.xml")
        model = mujoco.MjModel.from_xml_path(str(file))
    configuration = mink.Configuration(model)
    configuration.update_from_keyframe("reference")
    kind = "site" if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, frame) >= 0 else "body"
    task = mink.FrameTask(frame, kind, 1.0, 1.0, gain=gain)
    task.set_target(mink.SE3.from_matrix(target.homogeneous))
    closed = mink.EqualityConstraintTask(model, cost=1e3)
    tasks, constraints, way = ([task], [closed], []) if strict else ([task, closed], [], [])
    for _ in range(steps):
        v = mink.solve_ik(configuration, tasks, 1.0, "daqp", damping=1e-9, constraints=constraints)
        configuration.integrate_inplace(v, 1.0)
        joints = [configuration.data.joint(name).qpos[0] for name in robot.actuated]
        way.append((joints, closed.compute_error(configuration)))
    return tuple(map(np.array, zip(*way, strict=True)))


if __name__ == "__main__":
    stewart = p3dof.load_robot("gallery/stewart.urdf")
    goal = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.05, 0.2), np.array([0.03, 0.02, 0.52]))
    legs, errors = reach(stewart, "platform", goal)
    ours = stewart.assemble(p3dof.FrameTarget("platform", goal)).q
    own = [ours[stewart.model.idx_qs[stewart.model.getJointId(name)]] for name in stewart.actuated]
    print("loops open by [m]:", np.abs(errors[-1]).max())
    print("legs elsewhere than p3dof's own by [m]:", np.abs(legs[-1] - own).max())
