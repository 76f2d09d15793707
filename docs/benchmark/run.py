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
from typing import NamedTuple
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
        return shortest(W, N.T @ self.tree(a), state["motor_rank"])

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


ENGINES = {"p3dof": P3dof, "pinocchio": Pinocchio, "mujoco": Mujoco, "drake": Drake}


def installed(name: str) -> str | None:
    """Return the version of an engine; None if it is not installed."""
    try:
        importlib.import_module(ENGINES[name].module)
    except ImportError:
        return None
    try:
        return importlib.metadata.version(ENGINES[name].package)
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


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
                found, note = np.nan, f"{type(reason).__name__}: {' '.join(str(reason).split())}"[:160]
            rows.append(Row(name, state["name"], engine, version, what, found, note))
    return rows


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
    parser.add_argument("--write", action="store_true", help="write results.csv")
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
    for row in rows:
        if row.note:
            print(f"{row.engine}, {row.robot}, {row.state}, {row.quantity}: {row.note}")
    if args.write:
        with (HERE / "results.csv").open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(Row._fields)
            table.writerows(row._replace(error="" if row.note else f"{row.error:.2e}") for row in rows)


if __name__ == "__main__":
    main()
