"""Forces and accelerations of a closed-loop robot in MJX, by the MJCF that p3dof writes; exact loops."""

import tempfile

import jax
import jax.numpy as jnp
import mujoco
from mujoco import mjx

import p3dof


class RobotInMjx:
    """Joints in the order of MuJoCo, a coordinate each; forces in that of `loop.actuated`."""

    def __init__(self, loop):
        with tempfile.TemporaryDirectory() as folder:
            loop.write(f"{folder}/robot.xml")
            self.mujoco = mujoco.MjModel.from_xml_path(f"{folder}/robot.xml")
        if self.mujoco.nq != self.mujoco.nv:
            raise ValueError("expected joints with one coordinate each, slides and hinges")
        self.model, self.data = mjx.put_model(self.mujoco), mjx.make_data(self.mujoco)
        joints = [self.mujoco.joint(name).dofadr[0] for name in loop.actuated]
        self.motors = jnp.eye(self.mujoco.nv)[:, jnp.array(joints)]  # (nv, n)

    def _closed(self, q):
        """Return the Jacobian of the closures, and all that it takes."""
        data = self.data.replace(qpos=q)
        for stage in (mjx.kinematics, mjx.com_pos, mjx.tendon, mjx.make_constraint):
            data = stage(self.model, data)
        return data._impl.efc_J[: data._impl.ne], data

    def _tree(self, data, v):
        """Return the mass matrix, and the forces that act on the joints."""
        data = data.replace(qvel=v)
        for stage in (mjx.crb, mjx.com_vel, mjx.passive, mjx.rne):
            data = stage(self.model, data)
        return mjx.full_m(self.model, data), data.qfrc_passive - data.qfrc_bias

    def forces(self, q, v, a):
        """Return the forces of the actuators (n,) for a motion (nv,) each that keeps the loops closed."""
        J, data = self._closed(q)
        M, acting = self._tree(data, v)
        columns = jnp.hstack([self.motors, J.T])
        return (jnp.linalg.pinv(columns, rtol=1e-10) @ (M @ a - acting))[: self.motors.shape[1]]

    def accelerations(self, q, v, forces):
        """Return the accelerations (nv,) that forces (n,) cause."""
        J, rate, data = jax.jvp(self._closed, (q,), (v,), has_aux=True)
        M, acting = self._tree(data, v)
        inverse = jnp.linalg.pinv(jnp.block([[M, J.T], [J, jnp.zeros((len(J), len(J)))]]), rtol=1e-10)
        return (inverse @ jnp.concatenate([acting + self.motors @ forces, -rate @ v]))[: len(q)]


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    robot = RobotInMjx(p3dof.load_robot("gallery/five_bar.urdf"))
    home = robot.mujoco.key_qpos[0]
    print(jax.jit(robot.forces)(home, 0 * home, 0 * home))
