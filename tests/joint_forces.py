"""Joint forces by Newton's and Euler's equations, body by body; stiffnesses of joints."""

from __future__ import annotations

import numpy as np
from lagrange import BODIES

from p3dof.analysis.reactions import HingeStiffness, RodSection, SlideStiffness, Stiffness, UniversalStiffness
from p3dof.closed_form import kinematics
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Parameters

X, Y, Z = np.eye(3)


def motion_of(states) -> Motion:
    count = len(states.pose)
    return Motion(np.arange(float(count)), states.pose, states.velocity, states.acceleration, check=False)


class Bookkeeping:
    """Bodies, joints and loads of a motion in the fixed frame, from `p3dof.closed_form.kinematics` alone."""

    def __init__(self, parameters: Parameters, motion: Motion, wrench: np.ndarray) -> None:
        states = motion.pose, motion.velocity, motion.acceleration
        g = parameters.geometry
        self.parameters, self.bodies = parameters, parameters.bodies
        self.moving = kinematics.mechanism_motion(g, *states).bodies
        self.centre = {name: self.moving[name].at(body.com)[0] for name, body in self.bodies.items()}
        s, c = (g.R - g.r) / g.L, g.h / g.L
        rod = np.array([[s, c, 0], [0, 0, -1], [-c, s, 0]])
        self.ends = {}  # joint: (predecessor, successor, rotation, position)
        pairs = (
            ("slide_a", "base_link", "slider_a"), ("hinge_a", "slider_a", "leg_a"),
            ("slide_b", "base_link", "slider_b"), ("hinge_b", "slider_b", "leg_b"),
            ("slide_c", "base_link", "slider_c"), ("hinge_c", "slider_c", "crossbar_upper"),
            ("hinge_left", "crossbar_upper", "rod_left"), ("hinge_lower", "rod_left", "crossbar_lower"),
            ("hinge_platform", "crossbar_lower", "platform"), ("hinge_right", "crossbar_upper", "rod_right"),
        )  # fmt: skip
        for joint, one, other in pairs:
            its = self.moving[other]
            turn = rod if other == "crossbar_lower" else np.eye(3)
            self.ends[joint] = one, other, its.rotation @ turn, its.joint
        cuts = (
            ("loop_a", "leg_a", "platform"),
            ("loop_b", "leg_b", "platform"),
            ("loop_c", "rod_right", "crossbar_lower"),
        )
        for joint, one, other in cuts:
            self.ends[joint] = one, other, self.moving[one].rotation, self.moving[one].at((g.L, 0, 0))[0]
        self.needs = {name: self._needs(name, body, wrench) for name, body in self.bodies.items()}

    def _needs(self, name, body, wrench):
        """m a - m g - F and the rate of the angular momentum about the mass centre less the load's moment."""
        its = self.moving[name]
        inertia = its.rotation @ body.inertia @ np.swapaxes(its.rotation, -1, -2)
        spin = (inertia @ its.omega[..., None])[..., 0]
        force = body.mass * (its.at(body.com)[2] - self.parameters.gravity)
        moment = (inertia @ its.epsilon[..., None])[..., 0] + np.cross(its.omega, spin)
        if name == "platform":
            force = force - wrench[:, :3]
            moment = moment - wrench[:, 3:] - np.cross(its.origin - self.centre[name], wrench[:, :3])
        return force, moment

    def errors(self, result):
        """Newton's and Euler's errors (N, 10, 3) of the reported reactions, body by body."""
        found = []
        for name in self.bodies.__dataclass_fields__:
            force, moment = (-part for part in self.needs[name])
            for joint, (one, other, rotation, position) in self.ends.items():
                if name in (one, other):
                    sign = 1 if name == other else -1
                    f, m = ((rotation @ part[..., None])[..., 0] for part in wrench_of(result, joint))
                    force = force + sign * f
                    moment = moment + sign * (m + np.cross(position - self.centre[name], f))
            found.append((force, moment))
        return (np.stack(parts, axis=1) for parts in zip(*found, strict=True))

    def system(self, i, kind):
        """The 60 Newton-Euler equations of sample i in all components that the joints can transmit.

        Returns their matrix, and a matrix (13 joints x 6, columns) from these unknowns to the components.
        """
        columns, components = [], []
        for k, (joint, (one, other, rotation, position)) in enumerate(self.ends.items()):
            platform = self.moving["platform"].rotation[i]
            for part in transmitted(joint, kind, rotation[i].T @ platform[:, 1]):
                f, m = rotation[i] @ part[:3], rotation[i] @ part[3:]
                column = np.zeros((10, 6))
                for name, sign in ((one, -1), (other, 1)):
                    if name != "base_link":
                        arm = position[i] - self.centre[name][i]
                        column[BODIES.index(name)] = sign * np.concatenate([f, m + np.cross(arm, f)])
                columns.append(column.ravel())
                components.append(np.zeros((13, 6)))
                components[-1][k] = part
        return np.transpose(columns), np.transpose(np.reshape(components, (-1, 78)))


def wrench_of(result, joint):
    return result[joint].forces, result[joint].moments


def transmitted(joint, kind, platform_axis):
    """Unit wrenches that a joint (with its actuator) transmits, in its own axes."""
    forces = [np.r_[axis, 0, 0, 0] for axis in np.eye(3)]
    if joint.startswith("slide"):
        moments = [X, Y, Z]
    elif joint.startswith("hinge") or (joint == "loop_c" and kind == "paper"):
        moments = [X, Z]
    elif kind == "paper":
        normal = np.cross(Y, platform_axis)
        moments = [normal / np.linalg.norm(normal)]
    else:
        moments = []
    return forces + [np.r_[0, 0, 0, moment] for moment in moments]


S1 = Stiffness(
    HingeStiffness(radial=1e8, axial=5e7, tilt=1e4),
    SlideStiffness(lateral=2e8, tilt=2e4, roll=1e4),
    UniversalStiffness(force=8e7, moment=4e3),
    RodSection(diameter=0.02, young=210e9, poisson=0.3),
)


def components(result):
    """Forces and moments side by side, (N, 13, 6)."""
    return np.concatenate([result.forces, result.moments], axis=-1)


def random_stiffness(rng):
    def about(value):
        return value * 10 ** rng.uniform(-1, 1)

    return Stiffness(
        HingeStiffness(about(1e8), about(5e7), about(1e4)),
        SlideStiffness(about(2e8), about(2e4), about(1e4)),
        UniversalStiffness(about(8e7), about(4e3)),
        RodSection(diameter=0.02 * 10 ** rng.uniform(-0.2, 0.2)),
        {"hinge_right": HingeStiffness(about(1e8), about(5e7), about(1e4))},
    )
