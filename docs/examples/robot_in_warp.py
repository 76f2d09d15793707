"""Forces of a closed-loop robot in MuJoCo Warp, many motions at once, by the MJCF that p3dof writes."""

import tempfile

import mujoco
import mujoco_warp as mjw
import numpy as np

import p3dof


class RobotInWarp:
    """Joints in the order of MuJoCo, a coordinate each; forces in the order of `loop.actuated`.

    Single precision, on Warp's default device. One model has the tree alone, the other one its closures, of
    which the Jacobian counts: the forces of MuJoCo's closures are soft.
    """

    def __init__(self, loop, count):
        with tempfile.TemporaryDirectory() as folder:
            loop.write(f"{folder}/robot.xml")
            self.mujoco = model = mujoco.MjModel.from_xml_path(f"{folder}/robot.xml")
        if model.nq != model.nv:
            raise ValueError("expected joints with one coordinate each, slides and hinges")
        self.closed = mjw.put_model(model), mjw.make_data(model, nworld=count)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
        self.tree = mjw.put_model(model), mjw.make_data(model, nworld=count)
        self.motors = np.eye(model.nv)[:, [model.joint(name).dofadr[0] for name in loop.actuated]]

    def forces(self, q, v, a):
        """Return the forces of the actuators (N, n) for motions (N, nv) each that keep the loops closed."""
        for _, data in (self.closed, self.tree):
            for array, values in ((data.qpos, q), (data.qvel, v), (data.qacc, a)):
                array.assign(np.asarray(values, dtype=np.float32))
        mjw.inverse(*self.tree)
        mjw.fwd_position(*self.closed)
        data, size = self.closed[1], self.mujoco.nv
        J = data.efc.J.numpy()[:, : data.ne.numpy().max(), :size].astype(float)
        columns = np.concatenate([np.broadcast_to(self.motors, (len(q), *self.motors.shape)), J.mT], axis=2)
        tree = self.tree[1].qfrc_inverse.numpy().astype(float)
        found = np.linalg.pinv(columns, rcond=1e-5) @ tree[..., None]
        return found[:, : self.motors.shape[1], 0]


if __name__ == "__main__":
    robot = RobotInWarp(p3dof.load_robot("gallery/five_bar.urdf"), count=2)
    home = np.tile(robot.mujoco.key_qpos[0], (2, 1))
    print(robot.forces(home, 0 * home, np.zeros_like(home)))
