"""Bare simulators of the paper's machine, stepped by nothing but what is needed; for `simulation.py`."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import pinocchio as pin

import p3dof
from p3dof.machine.description.mjcf_text import mjcf
from p3dof.machine.parameters import SLIDES
from p3dof.methods import engines
from p3dof.methods.engines.base import bare_mechanism

Forces = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Of slider positions and speeds."""
Simulate = Callable[[Forces, float, float, float], tuple[np.ndarray, float]]
"""Of forces, duration, tick and step; returns sliders at the end and seconds of processor time."""
HOME = np.zeros(3)


def available(robot: p3dof.Manipulator, held: bool) -> dict[str, Simulate]:
    """Return the simulators that are installed.

    Exudyn's solver runs from begin to end: it is left out where forces are held from tick to tick.
    """
    found: dict[str, Simulate] = {
        "bare pin.constraintDynamics, semi-implicit Euler": Pinocchio(robot, Pinocchio.euler),
        "bare pin.constraintDynamics, RK4": Pinocchio(robot, Pinocchio.rk4),
    }
    if find_spec("mujoco"):
        found["bare mj_step, RK4"] = Mujoco(robot)
    if find_spec("pydrake"):
        found["Drake, SAP"] = Drake(robot)
    if find_spec("exudyn") and not held:
        found["Exudyn, trapezoidal rule"] = Exudyn(robot)
    return found


def ticks(duration: float, tick: float, step: float) -> tuple[int, int]:
    """Return how often forces are computed, and steps between; a step longer than a tick is one."""
    each = max(1, round(tick / step))
    return round(duration / (each * step)), each


class Pinocchio:
    """`pin.constraintDynamics`, one call an evaluation."""

    def __init__(
        self, robot: p3dof.Manipulator, scheme: Callable[..., tuple[np.ndarray, np.ndarray]]
    ) -> None:
        self.model, self.data, self.scheme = robot.model, robot.model.createData(), scheme
        self.models, self.datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for constraint in robot.constraint_models:
            self.models.append(pin.convertToRigidConstraintModel(robot.model, constraint.extract()))
            self.datas.append(self.models[-1].createData())
        pin.initConstraintDynamics(self.model, self.data, self.models, self.datas)
        self.settings = pin.ProximalSettings(1e-12, 1e-12, 1e-8, 50)
        self.slides = [robot.model.idx_vs[robot.model.getJointId(name)] for name in SLIDES]

    def acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        return pin.constraintDynamics(
            self.model, self.data, q, v, tau, self.models, self.datas, self.settings
        )

    def euler(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        v = v + h * self.acceleration(q, v, tau)
        return q + h * v, v

    def rk4(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        a1 = self.acceleration(q, v, tau).copy()
        v2 = v + h / 2 * a1
        a2 = self.acceleration(q + h / 2 * v, v2, tau).copy()
        v3 = v + h / 2 * a2
        a3 = self.acceleration(q + h / 2 * v2, v3, tau).copy()
        v4 = v + h * a3
        a4 = self.acceleration(q + h * v3, v4, tau)
        return q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)

    def __call__(self, forces: Forces, duration: float, tick: float, step: float) -> tuple[np.ndarray, float]:
        count, each = ticks(duration, tick, step)
        q, v, tau = np.zeros((3, self.model.nv))
        begin = time.process_time()
        for _ in range(count):
            tau[self.slides] = forces(q[self.slides], v[self.slides])
            for _ in range(each):
                q, v = self.scheme(self, q, v, tau, step)
        return q[self.slides], time.process_time() - begin


class Mujoco:
    """`mj_step` on the MJCF, its loops as stiff as the step allows; several steps a call."""

    def __init__(self, robot: p3dof.Manipulator) -> None:
        self.text = mjcf(bare_mechanism(robot.parameters))

    def __call__(self, forces: Forces, duration: float, tick: float, step: float) -> tuple[np.ndarray, float]:
        import mujoco

        model = mujoco.MjModel.from_xml_string(self.text)
        model.opt.timestep = step
        model.eq_solref[:] = -1 / step**2, -1 / step
        data = mujoco.MjData(model)
        places = [model.jnt_qposadr[model.joint(name).id] for name in SLIDES]  # all joints have one freedom
        count, each = ticks(duration, tick, step)
        begin = time.process_time()
        for _ in range(count):
            data.ctrl[:] = forces(data.qpos[places], data.qvel[places])
            mujoco.mj_step(model, data, nstep=each)
        return data.qpos[places].copy(), time.process_time() - begin


class Drake:
    """Drake's discrete solver."""

    def __init__(self, robot: p3dof.Manipulator) -> None:
        self.engine = engines.load("drake", robot.parameters)

    def __call__(self, forces: Forces, duration: float, tick: float, step: float) -> tuple[np.ndarray, float]:
        from pydrake.systems.analysis import Simulator

        plant = self.engine._built(step)
        simulator = Simulator(plant)
        context = simulator.get_mutable_context()
        joints = [plant.GetJointByName(name) for name in SLIDES]
        q_at = [joint.position_start() for joint in joints]
        v_at = [joint.velocity_start() for joint in joints]
        port = plant.get_actuation_input_port().FixValue(context, np.zeros(3))
        simulator.Initialize()
        count, each = ticks(duration, tick, step)
        begin = time.process_time()
        for k in range(count):
            now = forces(plant.GetPositions(context)[q_at], plant.GetVelocities(context)[v_at])
            port.GetMutableData().set_value(now)
            simulator.AdvanceTo((k + 1) * each * step)
        return plant.GetPositions(context)[q_at].copy(), time.process_time() - begin


class Exudyn:
    """Exudyn's implicit trapezoidal rule."""

    def __init__(self, robot: p3dof.Manipulator) -> None:
        self.engine = engines.load("exudyn", robot.parameters)

    def __call__(self, forces: Forces, duration: float, _: float, step: float) -> tuple[np.ndarray, float]:
        end = self.engine.simulate(duration, step, HOME, forces(HOME, HOME))
        return np.array([end.positions[slide] for slide in SLIDES]), end.seconds
