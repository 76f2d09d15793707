"""Hold programs for multibody dynamics against the benchmark of closed-loop robots.

    python run.py                                  # every engine that is installed, every robot
    python run.py --engine mujoco --robot delta    # some
    python run.py --write                          # also write results.csv, beside this file

Needs NumPy and at least one engine. What each computes is on the page `index.md`. A program of your own
needs a class as those below, with `inverse` and `forward`.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import importlib.metadata
import json
import sys
import warnings
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

HERE = Path(__file__).resolve().parent
FOLDER = HERE / "robots"


class Plain:
    """A robot as its two files say, in doubles."""

    def __init__(self, name: str) -> None:
        self.data = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
        self.urdf = (FOLDER / self.data["urdf"]).read_text(encoding="utf-8")
        self.name, self.states = name, self.data["states"]
        self.gravity = np.array(self.data["gravity"])
        self.closures, self.couplings = self.data["closures"], self.data["couplings"]
        self.actuated = self.data["actuated"]
        root = ElementTree.fromstring(self.urdf)  # noqa: S314 - the benchmark's own file
        self.links = {link.get("name"): link.find("inertial") for link in root.findall("link")}
        self.joints = {joint.get("name"): joint for joint in root.findall("joint")}  # parents come first
        self.names = list(self.joints)

    def axis(self, joint: str) -> np.ndarray:
        """Return the unit axis of a joint."""
        axis = numbers(self.joints[joint].find("axis").get("xyz"))
        return axis / np.linalg.norm(axis)

    def inertia(self, link: str) -> tuple[float, np.ndarray, np.ndarray]:
        """Return mass, centre of mass and inertia (3, 3) about it."""
        element = self.links[link]
        read = element.find("inertia").get
        xx, xy, xz, yy, yz, zz = (float(read(f"i{key}")) for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
        mass, com = float(element.find("mass").get("value")), numbers(element.find("origin").get("xyz"))
        return mass, com, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def numbers(text: str) -> np.ndarray:
    """Return the numbers of a text."""
    return np.array([float(x) for x in text.split()])


def values(given: dict[str, str], names) -> np.ndarray:
    """Return the numbers of these names, as doubles."""
    return np.array([float(given[name]) for name in names])


class Terms:
    """What most engines are asked for: mass matrix, forces of the open tree, and closures.

    A subclass has `set(q, v)`, `tree(a)` (forces of the tree for accelerations), `mass()`, `place(name)` (of
    a joint in its vectors) and `frame(link, point)`. Joint forces and accelerations follow by a null space,
    whose size is that of the rank of the file.
    """

    def frame(self, link: str, point: np.ndarray):
        """Return R, p, Jacobians (3, n) of point and rotation, spin, and accelerations of both at zero a."""
        raise NotImplementedError

    def closures(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Jacobian (rows, n) of the closures, and their second rates at zero accelerations."""
        J, bias = [np.zeros((0, len(v)))], [np.zeros(0)]
        for closure in self.robot.closures:
            ends = [self.frame(closure[f"link_{k}"], np.array(closure[f"position_{k}"])) for k in (1, 2)]
            (R1, p1, Jp1, Jw1, w1, a1, dw1), (R2, p2, Jp2, Jw2, w2, a2, dw2) = ends
            Jp, rate = Jp2 - Jp1, a2 - a1
            if closure["kind"] == "distance":
                apart = p2 - p1
                length = np.linalg.norm(apart)
                along, moving = apart / length, Jp @ v
                J.append((along @ Jp)[None])
                bias.append([along @ rate + (moving @ moving - (along @ moving) ** 2) / length])
                continue
            J.append(Jp)
            bias.append(rate)
            for one, two in right_angles(closure):
                x, y = R1 @ one, R2 @ two
                dx, dy = np.cross(w1, x), np.cross(w2, y)
                ddx, ddy = np.cross(dw1, x) + np.cross(w1, dx), np.cross(dw2, y) + np.cross(w2, dy)
                J.append((np.cross(x, y) @ (Jw1 - Jw2))[None])
                bias.append([ddx @ y + 2 * dx @ dy + x @ ddy])
        for coupling in self.robot.couplings:
            row = np.zeros((1, len(v)))
            row[0, self.place(coupling["joint"])], row[0, self.place(coupling["of"])] = (
                1.0,
                -coupling["ratio"],
            )
            J.append(row)
            bias.append([0.0])
        return np.concatenate(J), np.concatenate(bias)

    def vector(self, given: dict[str, str]) -> np.ndarray:
        """Return numbers by joint in the engine's order."""
        found = np.zeros(len(self.robot.names))
        for name in self.robot.names:
            found[self.place(name)] = float(given[name])
        return found

    def inverse(self, state: dict) -> np.ndarray:
        """Return the shortest forces of the actuators for the motion of a state."""
        q, v, a = (self.vector(state[key]) for key in "qva")
        self.set(q, v)
        J, _ = self.closures(v)
        N = np.linalg.svd(J)[2][state["rank"] :].T if len(J) else np.eye(len(v))
        W = N[[self.place(name) for name in self.robot.actuated]].T
        return shortest(W, N.T @ self.tree(a), state["actuation_rank"])

    def forward(self, state: dict) -> np.ndarray:
        """Return the accelerations under the forces of ``forward``, in the order of the URDF's joints."""
        q, v = (self.vector(state[key]) for key in "qv")
        self.set(q, v)
        J, bias = self.closures(v)
        N = np.linalg.svd(J)[2][state["rank"] :].T if len(J) else np.eye(len(v))
        particular = shortest(J, -bias, state["rank"]) if len(J) else np.zeros(len(v))
        load, M = -self.tree(np.zeros(len(v))), self.mass()
        motors = [self.place(name) for name in self.robot.actuated]
        load[motors] += values(state["forward"]["tau"], self.robot.actuated)
        a = particular + N @ np.linalg.solve(N.T @ M @ N, N.T @ (load - M @ particular))
        return a[[self.place(name) for name in self.robot.names]]


def shortest(A: np.ndarray, b: np.ndarray, rank: int) -> np.ndarray:
    """Return the shortest least-squares solution of A x = b for a matrix of known rank."""
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    return Vt[:rank].T @ ((U[:, :rank].T @ b) / s[:rank])


def right_angles(closure: dict) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return directions on both links that a closure keeps at right angles."""
    if closure["kind"] == "hinge":
        one, two = (np.array(closure[key]) / np.linalg.norm(closure[key]) for key in ("axis_1", "axis_2"))
        return [(x, two) for x in across(one)]
    eye = np.eye(3)
    return [(eye[k], eye[(k + 1) % 3]) for k in range(3)] if closure["kind"] == "weld" else []


def across(axis: np.ndarray) -> np.ndarray:
    """Return two unit vectors at right angles to a unit vector and to each other, as rows."""
    return np.linalg.svd(axis[None])[2][1:]


class Pinocchio(Terms):
    """Pinocchio: RNEA, CRBA, Jacobians and classical accelerations of frames."""

    module, package = "pinocchio", "pin"

    def __init__(self, robot: Plain) -> None:
        self.pin = importlib.import_module("pinocchio")
        self.robot = robot
        self.model = self.pin.buildModelFromXML(robot.urdf)
        self.model.gravity.linear = robot.gravity
        self.data = self.model.createData()
        self.ids = {name: self.model.getJointId(name) for name in robot.names}

    def place(self, name: str) -> int:
        return self.model.idx_vs[self.ids[name]]

    def set(self, q: np.ndarray, v: np.ndarray) -> None:
        pin, zero = self.pin, np.zeros_like(v)
        self.q, self.v = pin.neutral(self.model), v
        for number in self.ids.values():
            at, angle = self.model.idx_qs[number], q[self.model.idx_vs[number]]
            if self.model.nqs[number] == 2:
                self.q[at : at + 2] = np.cos(angle), np.sin(angle)
            else:
                self.q[at] = angle
        pin.computeJointJacobians(self.model, self.data, self.q)
        pin.forwardKinematics(self.model, self.data, self.q, v, zero)
        pin.updateFramePlacements(self.model, self.data)

    def tree(self, a: np.ndarray) -> np.ndarray:
        return self.pin.rnea(self.model, self.model.createData(), self.q, self.v, a)

    def mass(self) -> np.ndarray:
        M = self.pin.crba(self.model, self.model.createData(), self.q)
        return np.triu(M) + np.triu(M, 1).T

    def frame(self, link: str, point: np.ndarray):
        pin, model, data = self.pin, self.model, self.data
        number = model.getFrameId(link)
        axes = pin.LOCAL_WORLD_ALIGNED
        place = data.oMf[number]
        J = pin.getFrameJacobian(model, data, number, axes)
        spin = pin.getFrameVelocity(model, data, number, axes).angular
        moved = pin.getFrameClassicalAcceleration(model, data, number, axes)
        return about(
            place.rotation, place.translation, J[:3], J[3:], spin, moved.linear, moved.angular, point
        )


def about(R, p, Jp, Jw, spin, a, turning, point):
    """Move what is known of a link's origin to a point of the link."""
    r = R @ point
    skew = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    moved = a + np.cross(turning, r) + np.cross(spin, np.cross(spin, r))
    return R, p + r, Jp - skew @ Jw, Jw, spin, moved, turning


class P3dof:
    """p3dof: its general layer as it is, with its own ranks, checks and refusals."""

    module, package = "p3dof", "p3dof"

    def __init__(self, robot: Plain) -> None:
        import pinocchio as pin

        p3dof = importlib.import_module("p3dof")
        self.pinocchio = Pinocchio(robot)
        model, closures = self.pinocchio.model, []
        for number, closure in enumerate(robot.closures):
            names = []
            for k in (1, 2):
                link = model.frames[model.getFrameId(closure[f"link_{k}"])]
                R = np.eye(3)
                if closure["kind"] == "hinge":
                    axis = np.array(closure[f"axis_{k}"]) / np.linalg.norm(closure[f"axis_{k}"])
                    x = across(axis)[0]
                    R = np.column_stack([x, np.cross(axis, x), axis])
                place = link.placement * pin.SE3(R, np.array(closure[f"position_{k}"]))
                names.append(f"closure_{number}_{k}")
                model.addFrame(pin.Frame(names[-1], link.parentJoint, place, pin.FrameType.OP_FRAME))
            kind = {"point": "3d", "weld": "6d"}.get(closure["kind"], closure["kind"])
            closures.append(p3dof.Closure(*names, kind, closure.get("length")))
        couplings = [p3dof.Coupling(c["joint"], c["of"], (0.0, c["ratio"])) for c in robot.couplings]
        self.loop = p3dof.ClosedLoopModel(
            model, p3dof.Sidecar(tuple(closures), tuple(robot.actuated), tuple(couplings))
        )

    def _state(self, state: dict):
        engine = self.pinocchio
        engine.data = engine.model.createData()
        q, v, a = (engine.vector(state[key]) for key in "qva")
        engine.set(q, v)
        return engine.q, v, a

    def inverse(self, state: dict) -> np.ndarray:
        return self.loop.inverse_dynamics(*self._state(state)).tau

    def forward(self, state: dict) -> np.ndarray:
        q, v, _ = self._state(state)
        robot = self.pinocchio.robot
        a = self.loop.forward_dynamics(q, v, values(state["forward"]["tau"], robot.actuated)).a
        return a[[self.pinocchio.place(name) for name in robot.names]]


class Mujoco(Terms):
    """MuJoCo: the tree's inverse dynamics and mass matrix, Jacobians of points and their rates."""

    module, package = "mujoco", "mujoco"

    def __init__(self, robot: Plain) -> None:
        self.mujoco = importlib.import_module("mujoco")
        self.robot = robot
        self.model = self.mujoco.MjModel.from_xml_string(mjcf(robot))
        self.data = self.mujoco.MjData(self.model)

    def place(self, name: str) -> int:
        return int(self.model.joint(name).dofadr[0])

    def set(self, q: np.ndarray, v: np.ndarray) -> None:
        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = q, v, 0
        self.mujoco.mj_forward(self.model, self.data)

    def tree(self, a: np.ndarray) -> np.ndarray:
        self.data.qacc[:] = a
        self.mujoco.mj_inverse(self.model, self.data)
        return self.data.qfrc_inverse.copy()

    def mass(self) -> np.ndarray:
        M = np.zeros((self.model.nv, self.model.nv))
        for row, unit in zip(M, np.eye(self.model.nv), strict=True):
            self.mujoco.mj_mulM(self.model, self.data, row, unit)
        return M

    def frame(self, link: str, point: np.ndarray):
        model, data, body = self.model, self.data, self.mujoco.mj_name2id(self.model, 1, link)
        R = data.xmat[body].reshape(3, 3)
        p = data.xpos[body] + R @ point
        Jp, Jw, rate, turning = (np.zeros((3, model.nv)) for _ in range(4))
        self.mujoco.mj_jac(model, data, Jp, Jw, p, body)
        self.mujoco.mj_jacDot(model, data, rate, turning, p, body)
        v = data.qvel
        return R, p, Jp, Jw, Jw @ v, rate @ v, turning @ v


def mjcf(robot: Plain) -> str:
    """Return the open tree of a robot as MJCF: a body with a joint for each link."""
    root = ElementTree.Element("mujoco", model=robot.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false", balanceinertia="false")
    option = ElementTree.SubElement(root, "option", gravity=written(robot.gravity))
    ElementTree.SubElement(option, "flag", contact="disable", eulerdamp="disable")
    world = ElementTree.SubElement(root, "worldbody")
    bodies = {"ground": ElementTree.SubElement(world, "body", name="ground")}
    for name, joint in robot.joints.items():
        link, parent = joint.find("child").get("link"), joint.find("parent").get("link")
        body = ElementTree.SubElement(bodies[parent], "body", name=link, pos=joint.find("origin").get("xyz"))
        kind = "slide" if joint.get("type") == "prismatic" else "hinge"
        ElementTree.SubElement(body, "joint", name=name, type=kind, axis=joint.find("axis").get("xyz"))
        mass, com, I = robot.inertia(link)  # noqa: E741 - inertia
        full = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
        ElementTree.SubElement(body, "inertial", pos=written(com), mass=repr(mass), fullinertia=written(full))
        bodies[link] = body
    return ElementTree.tostring(root, encoding="unicode")


def written(given) -> str:
    """Return numbers as text, with all digits."""
    return " ".join(repr(float(x)) for x in given)


class Drake(Terms):
    """Drake: inverse dynamics, mass matrix, Jacobians and bias accelerations of a MultibodyPlant."""

    module, package = "pydrake", "drake"

    def __init__(self, robot: Plain) -> None:
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant

        self.robot = robot
        self.plant = plant = MultibodyPlant(0.0)
        Parser(plant).AddModelsFromString(robot.urdf, "urdf")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("ground"))
        plant.mutable_gravity_field().set_gravity_vector(robot.gravity)
        plant.Finalize()
        self.context = plant.CreateDefaultContext()

    def place(self, name: str) -> int:
        return self.plant.GetJointByName(name).velocity_start()

    def set(self, q: np.ndarray, v: np.ndarray) -> None:
        self.plant.SetPositions(self.context, q)  # joints have a number each, so both vectors have one order
        self.plant.SetVelocities(self.context, v)

    def tree(self, a: np.ndarray) -> np.ndarray:
        from pydrake.multibody.tree import MultibodyForces

        forces = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, forces)
        return self.plant.CalcInverseDynamics(self.context, a, forces)

    def mass(self) -> np.ndarray:
        return self.plant.CalcMassMatrix(self.context)

    def frame(self, link: str, point: np.ndarray):
        from pydrake.multibody.tree import JacobianWrtVariable

        plant, context, world = self.plant, self.context, self.plant.world_frame()
        frame = plant.GetFrameByName(link)
        place = frame.CalcPoseInWorld(context)
        common = (context, JacobianWrtVariable.kV, frame)
        J = plant.CalcJacobianSpatialVelocity(*common, point, world, world)
        bias = plant.CalcBiasSpatialAcceleration(*common, point, world, world)
        spin = frame.CalcSpatialVelocityInWorld(context).rotational()
        R = place.rotation().matrix()
        p = place.translation() + R @ point
        return R, p, J[3:], J[:3], spin, bias.translational(), bias.rotational()


class Rbdl(Terms):
    """RBDL: inverse dynamics, mass matrix, Jacobians and accelerations of points of a tree."""

    module, package = "rbdl", "rbdl"

    def __init__(self, robot: Plain) -> None:
        self.rbdl, self.robot = importlib.import_module("rbdl"), robot
        self.model, self.ids = self.rbdl.Model(), {"ground": 0}
        self.model.gravity = robot.gravity
        for name, joint in robot.joints.items():
            link, parent = joint.find("child").get("link"), joint.find("parent").get("link")
            axis, still = robot.axis(name), np.zeros(3)
            turns = (still, axis) if joint.get("type") == "prismatic" else (axis, still)
            place = self.rbdl.SpatialTransform()
            place.r = numbers(joint.find("origin").get("xyz"))
            moving = self.rbdl.Joint.fromJointAxes(np.concatenate(turns)[None])
            body = self.rbdl.Body.fromMassComInertia(*robot.inertia(link))
            self.ids[link] = self.model.AddBody(self.ids[parent], place, moving, body, link)

    def place(self, name: str) -> int:
        return self.robot.names.index(name)

    def set(self, q: np.ndarray, v: np.ndarray) -> None:
        self.q, self.v = q, v

    def tree(self, a: np.ndarray) -> np.ndarray:
        tau = np.zeros_like(self.v)
        self.rbdl.InverseDynamics(self.model, self.q, self.v, a, tau)
        return tau

    def mass(self) -> np.ndarray:
        M = np.zeros((len(self.v), len(self.v)))
        self.rbdl.CompositeRigidBodyAlgorithm(self.model, self.q, M)
        return M

    def frame(self, link: str, point: np.ndarray):
        rbdl, model, number = self.rbdl, self.model, self.ids[link]
        J, still = np.zeros((6, len(self.v))), np.zeros_like(self.v)
        p = rbdl.CalcBodyToBaseCoordinates(model, self.q, number, point)
        R = rbdl.CalcBodyWorldOrientation(model, self.q, number).T
        rbdl.CalcPointJacobian6D(model, self.q, number, point, J)
        spin = rbdl.CalcPointVelocity6D(model, self.q, self.v, number, point)[:3]
        moved = rbdl.CalcPointAcceleration6D(model, self.q, self.v, still, number, point)
        return R, p, J[3:], J[:3], spin, moved[3:], moved[:3]


class Exudyn:
    """Exudyn: maximal coordinates; its mass matrix, forces, loads and Jacobian of all joints and closures.

    Forces of joints are loads on both bodies; couplings use the rates that are dual to them. Accelerations
    are found as a difference from those of the state, which fit the closures.
    """

    module, package = "exudyn", "exudyn"

    def __init__(self, robot: Plain) -> None:
        self.exu, self.items = (
            importlib.import_module("exudyn"),
            importlib.import_module("exudyn.itemInterface"),
        )
        self.robot, items = robot, self.items
        self.container = self.exu.SystemContainer()  # the system lives as long as it does
        self.system = system = self.container.AddSystem()
        self.bodies = {"ground": system.AddObject(items.ObjectGround())}
        self.weights, self.pushes = [], {}
        home = np.zeros(len(robot.names))
        self.home = link_motions(robot, home, home, home)
        for link in self.home:
            self._add_body(link)
        for joint in robot.names:
            self._add_joint(joint)
        for closure in robot.closures:
            self._add_closure(closure)
        system.Assemble()
        settings = self.exu.SimulationSettings()
        settings.solution.file.write = False
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
        self.solver = self.exu.MainSolverImplicitSecondOrder()
        self.solver.InitializeSolver(system, settings)

    def _add_body(self, link: str) -> None:
        mass, com, inertia = self.robot.inertia(link)
        about = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
        place = [*self.home[link].position, 1.0, 0.0, 0.0, 0.0]
        node = self.system.AddNode(self.items.NodeRigidBodyEP(referenceCoordinates=place))
        moments = about[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
        body = self.items.ObjectRigidBody(mass=mass, inertia=moments, centerOfMass=com, nodeNumber=node)
        self.bodies[link] = self.system.AddObject(body)
        marker = self.system.AddMarker(self.items.MarkerBodyMass(bodyNumber=self.bodies[link]))
        load = self.items.LoadMassProportional(markerNumber=marker, loadVector=self.robot.gravity)
        self.weights.append(self.system.AddLoad(load))

    def _marker(self, link: str, point: np.ndarray, axis: np.ndarray | None = None) -> Any:
        """Return a marker on a link, its z axis along a direction."""
        place = np.eye(4)
        place[:3, 3] = point
        if axis is not None:
            unit = axis / np.linalg.norm(axis)
            x = across(unit)[0]
            place[:3, :3] = np.column_stack([x, np.cross(unit, x), unit])
        return self.system.AddMarker(self.items.MarkerBodyRigid(bodyNumber=self.bodies[link], localHT=place))

    def _hold(self, one: Any, other: Any, axes: list[int]) -> None:
        self.system.AddObject(self.items.ObjectJointGeneric(markerNumbers=[one, other], constrainedAxes=axes))

    def _add_joint(self, name: str) -> None:
        joint, axis = self.robot.joints[name], self.robot.axis(name)
        parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
        slides = joint.get("type") == "prismatic"
        start = numbers(joint.find("origin").get("xyz"))
        ends = self._marker(parent, start, axis), self._marker(child, np.zeros(3), axis)
        self._hold(*ends, [1, 1, 0, 1, 1, 1] if slides else [1, 1, 1, 1, 1, 0])
        kind = self.items.LoadForceVector if slides else self.items.LoadTorqueVector
        self.pushes[name] = [  # along the z axes of both markers
            (self.system.AddLoad(kind(markerNumber=marker, bodyFixed=True)), np.array([0.0, 0.0, sign]))
            for marker, sign in zip(ends, (-1.0, 1.0), strict=True)
        ]

    def _add_closure(self, closure: dict) -> None:
        kind = closure["kind"]
        axes = [np.array(closure[f"axis_{k}"]) if kind == "hinge" else None for k in (1, 2)]
        ends = [
            self._marker(closure[f"link_{k}"], np.array(closure[f"position_{k}"]), axis)
            for k, axis in zip((1, 2), axes, strict=True)
        ]
        if kind == "distance":
            rod = self.items.ObjectConnectorDistance(markerNumbers=ends, distance=closure["length"])
            self.system.AddObject(rod)
        else:
            rows = {"point": [1, 1, 1, 0, 0, 0], "hinge": [1, 1, 1, 1, 1, 0], "weld": [1] * 6}
            self._hold(*ends, rows[kind])

    def _coordinates(self, q, v, a) -> list[np.ndarray]:
        """Return displacements from home of all bodies' coordinates, their rates and accelerations."""
        columns: list[list[np.ndarray]] = [[], [], []]
        for link, now in link_motions(self.robot, q, v, a).items():
            rate = product([0.0, *now.spin], now.turn) / 2
            second = (product([0.0, *now.turning], now.turn) + product([0.0, *now.spin], rate)) / 2
            columns[0] += [now.position - self.home[link].position, now.turn - [1.0, 0.0, 0.0, 0.0]]
            columns[1] += [now.velocity, rate]
            columns[2] += [now.acceleration, second]
        return [np.concatenate(column) for column in columns]

    def _forces(self) -> np.ndarray:
        self.solver.ComputeODE2RHS(self.system)
        return self.solver.GetSystemResidual()[: self.size].copy()

    def _terms(self, state: dict):
        """Return N, M x'' - f, M, and the generalised forces (coordinates, n) of unit joint forces."""
        x, dx, ddx = self._coordinates(*(values(state[key], self.robot.names) for key in "qva"))
        self.size, data, solver = len(x), self.system.systemData, self.solver
        data.SetODE2Coordinates(x)
        data.SetODE2Coordinates_t(dx)
        data.SetODE2Coordinates_tt(ddx)
        solver.ComputeMassMatrix(self.system)
        M = solver.GetSystemMassMatrix().copy()
        load = M @ ddx - self._forces()
        held = solver.GetAEsize()
        solver.SetSystemJacobian(np.zeros((self.size + held, self.size + held)))
        solver.ComputeJacobianAE(self.system, 1.0, 0.0, 1.0, False)
        J = solver.GetSystemJacobian()[self.size :, : self.size].copy()
        J = J[J.any(axis=1)]
        B = self._unit_forces()
        place = self.robot.names.index
        rows = [B[:, place(c["joint"])] - c["ratio"] * B[:, place(c["of"])] for c in self.robot.couplings]
        J = np.vstack([J, *rows])
        N = np.linalg.svd(J)[2][self.size - state["mobility"] :].T
        return N, load, M, B

    def _unit_forces(self) -> np.ndarray:
        """Return what unit forces in the joints do, at rest and without weight, where nothing else acts."""
        system, still = self.system, np.zeros(self.size)
        system.systemData.SetODE2Coordinates_t(still)
        for weight in self.weights:
            system.SetLoadParameter(weight, "loadVector", np.zeros(3))
        columns = []
        for name in self.robot.names:
            for load, direction in self.pushes[name]:
                system.SetLoadParameter(load, "loadVector", direction)
            columns.append(self._forces())
            for load, _ in self.pushes[name]:
                system.SetLoadParameter(load, "loadVector", np.zeros(3))
        for weight in self.weights:
            system.SetLoadParameter(weight, "loadVector", self.robot.gravity)
        return np.column_stack(columns)

    def inverse(self, state: dict) -> np.ndarray:
        N, load, _, B = self._terms(state)
        motors = [self.robot.names.index(name) for name in self.robot.actuated]
        return shortest(N.T @ B[:, motors], N.T @ load, state["actuation_rank"])

    def forward(self, state: dict) -> np.ndarray:
        N, load, M, B = self._terms(state)
        motors = [self.robot.names.index(name) for name in self.robot.actuated]
        push = B[:, motors] @ values(state["forward"]["tau"], self.robot.actuated)
        z = np.linalg.solve(N.T @ M @ N, N.T @ (push - load))
        return values(state["a"], self.robot.names) + B.T @ N @ z


class Motion(NamedTuple):
    """How a link stands and moves, in world axes; `turn` is a quaternion (w, x, y, z)."""

    position: np.ndarray
    turn: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    acceleration: np.ndarray
    turning: np.ndarray


def product(one, other) -> np.ndarray:
    """Return the product of two quaternions."""
    a, u, b, w = one[0], np.array(one[1:]), other[0], np.array(other[1:])
    return np.array([a * b - u @ w, *(a * w + b * u + np.cross(u, w))])


def turned(turn: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Turn a vector by a unit quaternion."""
    twice = 2 * np.cross(turn[1:], x)
    return x + turn[0] * twice + np.cross(turn[1:], twice)


def link_motions(robot: Plain, q, v, a) -> dict[str, Motion]:
    """Return the motions of all links but the ground, in the order of the joints."""
    zero = np.zeros(3)
    found = {"ground": Motion(zero, np.array([1.0, 0.0, 0.0, 0.0]), zero, zero, zero, zero)}
    for k, (name, joint) in enumerate(robot.joints.items()):
        up = found[joint.find("parent").get("link")]
        axis, slides = robot.axis(name), joint.get("type") == "prismatic"
        n = turned(up.turn, axis)
        r = turned(up.turn, numbers(joint.find("origin").get("xyz")) + (axis * q[k] if slides else 0.0))
        velocity = up.velocity + np.cross(up.spin, r)
        acceleration = up.acceleration + np.cross(up.turning, r) + np.cross(up.spin, np.cross(up.spin, r))
        turn, spin, turning = up.turn, up.spin, up.turning
        if slides:
            velocity = velocity + n * v[k]
            acceleration = acceleration + n * a[k] + 2 * np.cross(up.spin, n) * v[k]
        else:
            turn = product(turn, [np.cos(q[k] / 2), *(np.sin(q[k] / 2) * axis)])
            turning = turning + n * a[k] + np.cross(up.spin, n) * v[k]
            spin = spin + n * v[k]
        link = joint.find("child").get("link")
        found[link] = Motion(up.position + r, turn, velocity, spin, acceleration, turning)
    del found["ground"]
    return found


class PinocchioSolver:
    """Pinocchio's own solver: `constraintDynamics`, proximal, with the closures that it has."""

    module, package = "pinocchio", "pin"

    def __init__(self, robot: Plain) -> None:
        self.tree = Pinocchio(robot)
        pin, model = self.tree.pin, self.tree.model
        if robot.couplings or {closure["kind"] for closure in robot.closures} & {"hinge", "distance"}:
            raise NotImplementedError("no hinges, distances or couplings among its constraints")
        self.models, self.datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for closure in robot.closures:
            kind = pin.ContactType.CONTACT_3D if closure["kind"] == "point" else pin.ContactType.CONTACT_6D
            ends = []
            for k in (1, 2):
                link = model.frames[model.getFrameId(closure[f"link_{k}"])]
                ends += [
                    link.parentJoint,
                    link.placement * pin.SE3(np.eye(3), np.array(closure[f"position_{k}"])),
                ]
            self.models.append(pin.RigidConstraintModel(kind, model, *ends, pin.ReferenceFrame.LOCAL))
            self.datas.append(self.models[-1].createData())
        self.settings = pin.ProximalSettings(1e-14, 1e-14, 1e-8, 50)
        self.data = model.createData()
        pin.initConstraintDynamics(model, self.data, self.models, self.datas)

    def inverse(self, state: dict) -> np.ndarray:
        raise NotImplementedError("no inverse dynamics with closures")

    def forward(self, state: dict) -> np.ndarray:
        tree = self.tree
        q, v = (tree.vector(state[key]) for key in "qv")
        tree.set(q, v)
        tau = np.zeros(tree.model.nv)
        motors = [tree.place(name) for name in tree.robot.actuated]
        tau[motors] = values(state["forward"]["tau"], tree.robot.actuated)
        given = (tree.model, self.data, tree.q, v, tau, self.models, self.datas, self.settings)
        a = tree.pin.constraintDynamics(*given)
        return a[[tree.place(name) for name in tree.robot.names]]


class RbdlSolver:
    """RBDL's own solver: `ForwardDynamicsConstraintsDirect` and `InverseDynamicsConstraints`."""

    module, package = "rbdl", "rbdl"

    def __init__(self, robot: Plain) -> None:
        self.tree = tree = Rbdl(robot)
        if robot.couplings or any(closure["kind"] == "distance" for closure in robot.closures):
            raise NotImplementedError("no distances or couplings among its constraints")
        if any(state["rows"] > state["joints"] for state in robot.states):
            raise NotImplementedError("no more rows than joints")
        self.loops = tree.rbdl.ConstraintSet()
        for closure in robot.closures:
            ends = []
            for k in (1, 2):
                place = tree.rbdl.SpatialTransform()
                place.r = np.array(closure[f"position_{k}"])
                if closure["kind"] == "hinge":
                    unit = np.array(closure[f"axis_{k}"]) / np.linalg.norm(closure[f"axis_{k}"])
                    x = across(unit)[0]
                    place.E = np.column_stack([x, np.cross(unit, x), unit])  # as its loops read it
                ends.append(place)
            turns = {"point": [], "hinge": [0, 1], "weld": [0, 1, 2]}[closure["kind"]]
            for row in [3, 4, 5, *turns]:
                axis = tree.rbdl.SpatialVector.fromPythonArray(np.eye(6)[row])
                self.loops.AddLoopConstraint(*(tree.ids[closure[f"link_{k}"]] for k in (1, 2)), *ends, axis)
        self.loops.Bind(tree.model)
        self.loops.SetActuationMap(tree.model, np.array([name in robot.actuated for name in robot.names]))

    def inverse(self, state: dict) -> np.ndarray:
        tree = self.tree
        q, v, a = (tree.vector(state[key]) for key in "qva")
        if not state["tau_unique"]:
            raise NotImplementedError(
                "its choice among the forces of redundant actuators is not the shortest"
            )
        if not tree.rbdl.isConstrainedSystemFullyActuated(tree.model, q, v, self.loops):
            raise NotImplementedError("not as many independent motors as freedoms")
        found, tau = np.zeros_like(a), np.zeros_like(a)
        tree.rbdl.InverseDynamicsConstraints(tree.model, q, v, a, self.loops, found, tau)
        return tau[[tree.place(name) for name in tree.robot.actuated]]

    def forward(self, state: dict) -> np.ndarray:
        tree = self.tree
        q, v = (tree.vector(state[key]) for key in "qv")
        tau, a = np.zeros_like(v), np.zeros_like(v)
        motors = [tree.place(name) for name in tree.robot.actuated]
        tau[motors] = values(state["forward"]["tau"], tree.robot.actuated)
        tree.rbdl.ForwardDynamicsConstraintsDirect(tree.model, q, v, tau, self.loops, a)
        return a


class MujocoSolver:
    """MuJoCo's own constraint solver: soft equalities, as stiff as it allows (solimp 0.9999)."""

    module, package = "mujoco", "mujoco"

    def __init__(self, robot: Plain) -> None:
        self.mujoco = importlib.import_module("mujoco")
        self.robot = robot
        root = ElementTree.fromstring(mjcf(robot))  # noqa: S314 - our own
        ElementTree.SubElement(root, "equality")
        ElementTree.SubElement(root, "tendon")
        for number, closure in enumerate(robot.closures):
            add_equalities(root, number, closure)
        stiff = {"solimp": "0.9999 0.9999 0.001 0.5 2"}
        for coupling in robot.couplings:
            joints = {"joint1": coupling["joint"], "joint2": coupling["of"]}
            line = {**joints, "polycoef": f"0 {coupling['ratio']!r} 0 0 0", **stiff}
            ElementTree.SubElement(root.find("equality"), "joint", line)
        self.model = self.mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
        for number, closure in enumerate(robot.closures):
            if closure["kind"] == "distance":  # its error counts from the length at home
                at = self.model.tendon(f"rod_{number}").id
                self.model.equality(f"rod_{number}").data[0] = (
                    closure["length"] - self.model.tendon_length0[at]
                )
        self.model.opt.tolerance, self.model.opt.iterations = 0.0, 200
        self.data = self.mujoco.MjData(self.model)

    def inverse(self, state: dict) -> np.ndarray:
        raise NotImplementedError("no inverse dynamics with closures")

    def forward(self, state: dict) -> np.ndarray:
        names = self.robot.names
        at = [int(self.model.joint(name).dofadr[0]) for name in names]
        self.data.qpos[at], self.data.qvel[at] = (values(state[key], names) for key in "qv")
        motors = [int(self.model.joint(name).dofadr[0]) for name in self.robot.actuated]
        self.data.qfrc_applied[motors] = values(state["forward"]["tau"], self.robot.actuated)
        self.mujoco.mj_forward(self.model, self.data)
        return self.data.qacc[at].copy()


def add_equalities(root: ElementTree.Element, number: int, closure: dict) -> None:
    """Add a closure to an MJCF: sites on both bodies, tied by equalities or by a tendon of fixed length."""
    hinge, stiff = closure["kind"] == "hinge", {"solimp": "0.9999 0.9999 0.001 0.5 2"}
    for end in range(2 if hinge else 1):  # a hinge is two points on its axis
        names = [f"site_{number}_{end}_{k}" for k in (1, 2)]
        for k, name in zip((1, 2), names, strict=True):
            point = np.array(closure[f"position_{k}"])
            if hinge:
                point = point + (0.1 * end) * np.array(closure[f"axis_{k}"]) / np.linalg.norm(
                    closure[f"axis_{k}"]
                )
            body = next(body for body in root.iter("body") if body.get("name") == closure[f"link_{k}"])
            ElementTree.SubElement(body, "site", name=name, pos=written(point))
        sites = {"site1": names[0], "site2": names[1], **stiff}
        if closure["kind"] == "distance":
            cord = ElementTree.SubElement(root.find("tendon"), "spatial", name=f"rod_{number}")
            for name in names:
                ElementTree.SubElement(cord, "site", site=name)
            line = {"name": f"rod_{number}", "tendon1": f"rod_{number}", **stiff}
            ElementTree.SubElement(root.find("equality"), "tendon", line)
        else:
            kind = "weld" if closure["kind"] == "weld" else "connect"
            ElementTree.SubElement(root.find("equality"), kind, sites)


ENGINES = {
    "p3dof": P3dof,
    "pinocchio": Pinocchio,
    "mujoco": Mujoco,
    "drake": Drake,
    "rbdl": Rbdl,
    "exudyn": Exudyn,
    "pinocchio-solver": PinocchioSolver,
    "rbdl-solver": RbdlSolver,
    "mujoco-solver": MujocoSolver,
}
"""What can be measured; those named `solver` are the programs' own constraint solvers."""


def installed(name: str) -> str | None:
    """Return the version of an engine, empty if it has none; None if it is not installed."""
    try:
        importlib.import_module(ENGINES[name].module)
    except ImportError:
        return None
    try:
        return importlib.metadata.version(ENGINES[name].package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def error(found: np.ndarray, wanted: np.ndarray) -> float:
    """Return the largest difference, relative to the largest number that is wanted."""
    size = np.abs(wanted).max()
    return float(np.abs(found - wanted).max() / (size or 1.0))


class Row(NamedTuple):
    """One line of the results; `error` is NaN where `note` says why there is none."""

    robot: str
    state: str
    engine: str
    version: str
    quantity: str
    error: float
    note: str


def measure(engine: str, name: str) -> list[Row]:
    """Return what an engine reaches on a robot."""
    robot, rows, version = Plain(name), [], installed(engine) or ""
    try:
        model = ENGINES[engine](robot)
    except Exception as reason:
        model = reason
    for state in robot.states:
        wanted = {
            "inverse": values(state["tau"], robot.actuated),
            "forward": values(state["forward"]["a"], robot.names),
        }
        for what, reference in wanted.items():
            try:
                if isinstance(model, Exception):
                    raise model
                found, note = error(getattr(model, what)(state), reference), ""
            except Exception as reason:  # whatever an engine says is noted
                found, note = np.nan, noted(reason)
            rows.append(Row(name, state["name"], engine, version, what, found, note))
    return rows


def noted(reason: Exception) -> str:
    """Return in one line why there is no result."""
    text = " ".join(str(reason).split())
    return text if isinstance(reason, NotImplementedError) else f"{type(reason).__name__}: {text}"[:160]


def worst(rows: list[Row]) -> str:
    """Return the largest error of some rows as text; a dash if one is missing."""
    largest = max((row.error for row in rows if not row.note), default=np.nan)
    return "-" if any(row.note for row in rows) else f"{largest:.1e}"


def asked() -> argparse.Namespace:
    """Return the options, checked; all engines and robots where none is named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    known = {"engine": list(ENGINES), "robot": sorted(path.stem for path in FOLDER.glob("*.json"))}
    parser.add_argument(
        "--engine", nargs="+", metavar="NAME", help=f"of {', '.join(ENGINES)}; all by default"
    )
    parser.add_argument("--robot", nargs="+", metavar="NAME", help="of the files in robots/; all by default")
    parser.add_argument("--write", action="store_true", help="write what was measured into results.csv")
    args = parser.parse_args()
    for kind, names in known.items():
        given = getattr(args, kind)
        if unknown := [name for name in given or [] if name not in names]:
            parser.error(f"no {kind} of this name: {', '.join(unknown)}; there are {', '.join(names)}")
        setattr(args, kind, given or names)
    return args


def main() -> None:
    """Run the benchmark, print a table, and write results.csv."""
    args = asked()
    versions = {name: installed(name) for name in args.engine}
    for name in [name for name, version in versions.items() if version is None]:
        print(f"not installed: {name} (module {ENGINES[name].module})")
        del versions[name]
    if not versions:
        sys.exit("none of these engines is installed")
    warnings.simplefilter("ignore")
    print(f"{'largest relative error':24s}" + "".join(f"{name:>22s}" for name in versions))
    print(f"{'robot':24s}" + f"{'inverse   forward':>22s}" * len(versions))
    rows: list[Row] = []
    for name in args.robot:
        line = f"{name:24s}"
        for engine in versions:
            found = measure(engine, name)
            rows += found
            line += f"{worst(found[::2]):>13s}{worst(found[1::2]):>9s}"
        print(line, flush=True)
    reasons = {(row.engine, row.quantity, row.note): [] for row in rows if row.note}
    for row in rows:
        if row.note:
            reasons[row.engine, row.quantity, row.note].append(row.robot)
    for (engine, quantity, note), robots in reasons.items():
        print(f"{engine}, {quantity}: {note} ({', '.join(dict.fromkeys(robots))})")
    if args.write:
        write(rows)


def write(rows: list[Row]) -> None:
    """Write results.csv; lines of engines and robots that were not measured stay."""
    path, lines = HERE / "results.csv", {(row.robot, row.engine): [] for row in rows}
    for row in rows:
        lines[row.robot, row.engine].append([*row[:5], "" if row.note else f"{row.error:.2e}", row.note])
    if path.is_file():
        with path.open(encoding="utf-8", newline="") as file:
            old = list(csv.reader(file))[1:]
        measured = set(lines)
        for line in old:
            if (line[0], line[2]) not in measured and line[2] in ENGINES:
                lines.setdefault((line[0], line[2]), []).append(line)
    order = list(ENGINES)
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(Row._fields)
        for key in sorted(lines, key=lambda key: (key[0], order.index(key[1]))):
            table.writerows(lines[key])


if __name__ == "__main__":
    main()
