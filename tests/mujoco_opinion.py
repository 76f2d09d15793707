"""MuJoCo's opinion of a robot: its tree, and the forces and accelerations that its equalities leave.

Its constraint forces are soft; the Jacobian of its equality rows is not. Forces follow from the null space of
that Jacobian, by numbers that are MuJoCo's alone.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from scipy import linalg

SMOOTHING = 1e-3  # m/s or rad/s over which our friction changes its sign; MuJoCo's is a constraint


class Opinion:
    """MuJoCo's model of a file, set to states of our robot; joints are found by their names.

    A joint of ours that MuJoCo does not have must follow others (that of a tendon).
    """

    def __init__(self, xml: str | Path) -> None:
        text = str(xml)
        is_text = text.lstrip().startswith("<")
        self.m = (mujoco.MjModel.from_xml_string if is_text else mujoco.MjModel.from_xml_path)(text)
        self.d = mujoco.MjData(self.m)

    def set(self, loop, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Set configuration and velocity; return the acceleration (nv,) in MuJoCo's coordinates."""
        m, d, model = self.m, self.d, loop.model
        qacc = np.zeros(m.nv)
        simple = {name: value[0] for name, value, *_ in coordinates(model, q, v, a) if len(value) == 1}
        follows = {
            c.joint: np.polynomial.polynomial.polyval(simple[c.on], c.coefficients)
            for c in loop.sidecar.couplings
            if c.on is not None and not c.others and model.nqs[model.getJointId(c.joint)] == 2
        }
        names = {m.joint(number).name or f"joint_{number}": number for number in range(m.njnt)}
        for name, value, rate, second in coordinates(model, q, v, a):
            if (joint := names.get(name)) is None:
                assert any(coupling.joint == name for coupling in loop.sidecar.couplings)
                continue
            at, to = m.jnt_qposadr[joint], m.jnt_dofadr[joint]
            if name in follows:  # continuous joints have their angles here, MuJoCo counts the turns
                value = value + 2 * np.pi * np.round((follows[name] - value) / (2 * np.pi))  # noqa: PLW2901
            d.qpos[at : at + len(value)] = value
            d.qvel[to : to + len(rate)], qacc[to : to + len(rate)] = rate, second
        d.ctrl[:] = 0
        mujoco.mj_forward(m, d)
        return qacc

    @property
    def mass_matrix(self) -> np.ndarray:
        M = np.zeros((self.m.nv, self.m.nv))
        for row, unit in zip(M, np.eye(self.m.nv), strict=True):
            mujoco.mj_mulM(self.m, self.d, row, unit)
        return M

    @property
    def free_motions(self) -> np.ndarray:
        """Null space (nv, n) of the equality rows at the state that is set."""
        m, d = self.m, self.d
        J = dense(d, m.nv) if mujoco.mj_isSparse(m) else d.efc_J.reshape(-1, m.nv)
        J = J[: d.nefc][self._equalities]
        return null_space(J) if len(J) else np.eye(m.nv)

    @property
    def gaps(self) -> np.ndarray:
        """How far the equalities are open [m or rad]."""
        return self.d.efc_pos[: self.d.nefc][self._equalities]

    @property
    def _equalities(self) -> np.ndarray:
        return self.d.efc_type[: self.d.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY

    def actuators(self) -> np.ndarray:
        """Generalised forces (nv, nu) of unit forces of the actuators, before their gears."""
        m, d = self.m, self.d
        moments = np.zeros((m.nu, m.nv))
        mujoco.mju_sparse2dense(moments, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
        return (moments / m.actuator_gear[:, :1]).T

    def applied(self) -> np.ndarray:
        """All generalised forces that are no actuators' and no constraints', with friction as we have it."""
        m, d = self.m, self.d
        friction = m.dof_frictionloss * np.tanh(d.qvel / SMOOTHING)
        for number in np.flatnonzero(m.tendon_frictionloss):  # of fixed ones
            parts = slice(m.tendon_adr[number], m.tendon_adr[number] + m.tendon_num[number])
            force = m.tendon_frictionloss[number] * np.tanh(d.ten_velocity[number] / SMOOTHING)
            np.add.at(friction, m.jnt_dofadr[m.wrap_objid[parts]], m.wrap_prm[parts] * force)
        return d.qfrc_passive - d.qfrc_bias - friction


def dense(d, nv: int) -> np.ndarray:
    J = np.zeros((d.nefc, nv))
    mujoco.mju_sparse2dense(J, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
    return J


def coordinates(model: pin.Model, q: np.ndarray, v: np.ndarray, a: np.ndarray):
    """Names of joints with values, rates and accelerations in the conventions of MuJoCo."""
    for i in range(1, model.njoints):
        name, kind = str(model.names[i]), str(model.joints[i].shortname())
        x = q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]]
        rate, second = (y[model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]] for y in (v, a))
        if kind == "JointModelFreeFlyer":
            place = model.jointPlacements[i] * pin.XYZQUATToSE3(x)
            R, turn = place.rotation, pin.Quaternion(place.rotation).coeffs()
            linear = R @ (second[:3] + np.cross(rate[3:], rate[:3]))
            value = np.concatenate((place.translation, turn[3:], turn[:3]))
            yield name, value, np.concatenate((R @ rate[:3], rate[3:])), np.concatenate((linear, second[3:]))
        elif kind == "JointModelSpherical":
            yield name, np.roll(x, 1), rate, second
        elif kind == "JointModelPlanar":
            R = np.array([[x[2], -x[3]], [x[3], x[2]]])
            turned = rate[2] * np.array([-rate[1], rate[0]])
            values = (*x[:2], np.arctan2(x[3], x[2]))
            rates, seconds = (*(R @ rate[:2]), rate[2]), (*(R @ (second[:2] + turned)), second[2])
            for part, *numbers in zip("123", values, rates, seconds, strict=True):
                yield (f"{name}_{part}", *(np.array([number]) for number in numbers))
        elif model.nqs[i] == 2 and model.nvs[i] == 1:
            yield name, np.array([np.arctan2(x[1], x[0])]), rate, second
        elif model.nvs[i] > 1:
            for number, one in enumerate(zip(x, rate, second, strict=True)):
                yield (f"{name}_{number + 1}", *(np.array([value]) for value in one))
        else:
            yield name, x, rate, second


def agree(loop, xml: str | Path, seed: int = 0, spread: float = 0.05) -> None:
    """Compare the forces of a motion, and its accelerations, with MuJoCo's model of the same robot."""
    theirs, rng, model = Opinion(xml), np.random.default_rng(seed), loop.model
    home = loop.assemble().q
    q = loop.assemble(None, pin.integrate(model, home, spread * rng.uniform(-1, 1, model.nv))).q
    J = loop.closure_jacobian(q)
    N = null_space(J) if len(J) else np.eye(model.nv)
    v = N @ rng.normal(size=N.shape[1])
    moved = N[loop.actuated_v]  # of redundant motors, some that can be chosen freely
    chosen = linalg.qr(moved.T, pivoting=True)[2][: np.linalg.matrix_rank(moved, 1e-8)]
    found = loop.hybrid_dynamics(q, v, {loop.actuated[i]: rng.normal() for i in chosen})
    qacc = theirs.set(loop, q, v, found.a)
    free = theirs.free_motions
    assert free.shape[1] == N.shape[1], "not the same mobility"
    assert np.abs(theirs.gaps).max(initial=0.0) < 1e-9
    B = theirs.actuators()
    left = theirs.mass_matrix @ qacc - theirs.applied() - B @ found.tau
    size = (
        np.abs(theirs.mass_matrix @ qacc).max()
        + np.abs(theirs.applied()).max()
        + np.abs(found.tau).max(initial=0)
    )
    np.testing.assert_allclose(free.T @ left, 0, rtol=0, atol=1e-10 * size)
    # The acceleration that MuJoCo's numbers have for these forces; J̇v is ours.
    across = qacc - free @ (free.T @ qacc)
    M, f = theirs.mass_matrix, theirs.applied() + B @ found.tau
    own = across + free @ np.linalg.solve(free.T @ M @ free, free.T @ (f - M @ across))
    forward = loop.forward_dynamics(q, v, found.tau)
    again = theirs.set(loop, q, v, forward.a)
    s = np.linalg.svd(J, compute_uv=False)
    smallest = s[s > 1e-7 * s[0]][-1] if len(s) else 1.0
    felt = max(
        1e-9, 1e-14 * np.linalg.cond(free.T @ M @ free) / smallest
    )  # idle rods have next to no inertia
    np.testing.assert_allclose(again, own, rtol=0, atol=felt * max(1.0, np.abs(own).max()))


def null_space(J: np.ndarray) -> np.ndarray:
    _, s, Vt = np.linalg.svd(J)
    return Vt[np.count_nonzero(s > 1e-7 * max(s[0], 1e-300)) :].T
