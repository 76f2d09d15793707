"""USD with UsdPhysics: bodies, joints and drives, said in SDF, whose reader finds the tree and the closures.

Joints are zero where the bodies are placed; both frames of a joint meet there but for what it leaves free.
Motors are the joints with a drive, whose gains are those of a controller and are not read. A joint that is
excluded from the articulation is the first to be cut.

References
----------
Pixar, OpenUSD: UsdPhysics, "Rigid Body Physics in USD".
"""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import LARGEST, FloatArray, one_line, shown
from p3dof._base.errors import FileError, MissingExtraError, ModelError, ModelWarning, P3dofError
from p3dof._base.files import called, read_bytes
from p3dof._base.markup import inertial, joint_between, numbers, sub
from p3dof.loops.formats import sdf
from p3dof.loops.sidecar import Closure, Sidecar, SidecarLike
from p3dof.loops.xml_text import folder_below_which

_TEXT = b"#usda"  # what a file in text begins with
_MAX_BYTES = 200_000_000  # largest file
_MAX_FILES = 200  # most files of a robot
_MAX_PRIMS = 200_000
_SINGLE = 5e-6  # how far frames of a joint may be apart, as a share of the robot's size, for single precision
_EARTH = 9.81  # m/s^2, where the scene does not say
_IDLE = re.compile(
    r"Physics(Collision|MeshCollision|Material|FilteredPairs|ArticulationRoot|RigidBody|Mass|Drive|Limit)API(:.*)?|"
    r"Physx(RigidBody|Articulation|Collision|Material|Scene|Joint|Limit|JointState|.*Collision|Contact.*|Trigger.*)"
    r"API(:.*)?|PhysicsJointStateAPI(:.*)?|(Newton|Mjc|Isaac|Semantics).*API(:.*)?"
)
"""Schemas of physics that are applied to prims and are read, or have no effect on the dynamics."""
_PHYSICS = re.compile(r"Physics|Physx|Newton|Mjc")
_IDLE_TYPES = ("PhysicsScene", "PhysicsCollisionGroup")
_TYING = re.compile(r"mimic|gear|rack|tendon|coupling|constraint|loop|joint$", re.IGNORECASE)
_FREEDOMS = ("transX", "transY", "transZ", "rotX", "rotY", "rotZ")


def read(
    source: str | os.PathLike[str],
    closures: SidecarLike = None,
    root_joint: pin.JointModel | None = None,
    on_unknown: str = "raise",
    passive: bool | None = None,
    include_root: str | os.PathLike[str] | None = None,
) -> tuple[pin.Model, Sidecar]:
    """Return the tree of a USD file and its loops."""
    name = os.fspath(source)
    try:
        import pxr  # noqa: F401 - tells only whether it is there
    except ImportError as error:
        raise MissingExtraError("USD files are read by usd-core: pip install 'p3dof[usd]'") from error
    from pxr import UsdUtils

    quiet = UsdUtils.CoalescingDiagnosticDelegate()  # the library writes to the terminal otherwise
    try:
        robot = _Robot(_opened(name, folder_below_which(include_root)), name, on_unknown == "ignore")
        text = robot.text()
    except P3dofError:
        raise
    except Exception as error:  # what the library raises, and values of other types than the schemas say
        raise FileError(f"{called(name)}: it is not understood as USD: {_words(error)}") from error
    finally:
        quiet.TakeUncoalescedDiagnostics()
        del quiet
    try:
        model, sidecar = sdf.read(text, closures, root_joint, True, on_unknown, passive)
    except ModelError as error:
        raise ModelError(f"{name}: {str(error).replace('SDF text, line', 'as SDF, line')}") from error
    return model, replace(sidecar, closures=(*sidecar.closures, *robot.rods))


def _words(error: Exception) -> str:
    """Return the words of an error, without where in the library it was raised."""
    try:
        told = re.sub(r".* in file \S+ : ", "", one_line(str(error), 1000))
    except UnicodeDecodeError:  # the library shows bytes of the file
        told = ""
    return one_line("".join(c if c.isprintable() else "?" for c in told), 300) or type(error).__name__


def _opened(name: str, allowed: Path | None) -> Any:
    """Return the stage of a file, after a look at all files that it is composed of."""
    from pxr import Sdf, Usd

    first = Path(name).resolve()
    below, seen, waiting, layers = allowed or first.parent, {first}, [first], list[Any]()
    for path in waiting:  # grows while it is walked
        if not read_bytes(path, _MAX_BYTES).startswith(_TEXT):  # a damaged binary file ends the process
            raise FileError(
                f"{called(path)}: expected USD as text ({_TEXT.decode()} ...): usdcat FILE -o robot.usda"
            )
        layer = Sdf.Layer.FindOrOpen(str(path))
        if layer is None:
            raise FileError(f"{called(path)}: it is not understood as USD")
        layers.append(layer)
        for asset in layer.GetCompositionAssetDependencies():
            other = Path(layer.ComputeAbsolutePath(asset)).resolve()
            if not other.is_relative_to(below) or not other.is_file():
                where = "the folder of the first file" if allowed is None else "include_root"
                raise ModelError(
                    f"{path}: {shown(asset)} is no file below {where} (include_root=FOLDER names another)"
                )
            if other not in seen:
                seen.add(other)
                waiting.append(other)
        if len(waiting) > _MAX_FILES:
            raise ModelError(f"{name}: expected at most {_MAX_FILES} files")
    return Usd.Stage.Open(layers[0])


@dataclass(frozen=True, eq=False)
class _Body:
    """A rigid body."""

    name: str
    prim: Any
    place: pin.SE3  # in the world, in metres
    moves: bool


@dataclass(frozen=True, eq=False)
class _End:
    """A frame of a joint, in the world [m], and the body that it is on; None for the world."""

    body: _Body | None
    place: pin.SE3


class _Robot:
    """What a stage says of a robot, as SDF."""

    def __init__(self, stage: Any, name: str, ignore: bool) -> None:
        from pxr import Usd, UsdGeom, UsdPhysics

        self._stage, self._name, self._physics, self._ignore = stage, name, UsdPhysics, ignore
        self._metre = float(UsdGeom.GetStageMetersPerUnit(stage))
        self._kilogram = float(UsdPhysics.GetStageKilogramsPerUnit(stage))
        if not (0 < self._metre < LARGEST and 0 < self._kilogram < LARGEST):
            raise ModelError(f"{name}: expected positive metersPerUnit and kilogramsPerUnit")
        self._up = np.eye(3)["XYZ".index(str(UsdGeom.GetStageUpAxis(stage)))]
        self._places = UsdGeom.XformCache()
        prims = []
        for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
            prims.append(prim)
            if len(prims) > _MAX_PRIMS:
                raise ModelError(f"{name}: expected at most {_MAX_PRIMS} prims")
        self._taken: set[str] = {"world"}
        self._bodies = {
            prim.GetPath(): self._body(prim) for prim in prims if prim.HasAPI(UsdPhysics.RigidBodyAPI)
        }
        self._joints = [prim for prim in prims if prim.IsA(UsdPhysics.Joint)]
        self._scenes = [prim for prim in prims if prim.IsA(UsdPhysics.Scene)]
        self._tell_unknown(prims)
        self.rods: list[Closure] = []

    def _bad(self, prim: Any, message: str) -> ModelError:
        return ModelError(f"{self._name}: {prim.GetPath()!s:.200}: {message}")

    def _new(self, prim: Any) -> str:
        """Return a name for a prim: its own, or its path where that is taken."""
        path = str(prim.GetPath())[1:].replace("/", "_")
        for name in (prim.GetDisplayName(), prim.GetName(), path):
            if name and name not in self._taken and "::" not in name and not name.startswith("__"):
                break
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return str(name)

    # -- Bodies --------------------------------------------------------------------------------------------

    def _placed(self, prim: Any, point: Any = (0.0, 0.0, 0.0), turn: FloatArray | None = None) -> pin.SE3:
        """Return where a frame of a prim is in the world, in metres."""
        matrix = np.array(self._places.GetLocalToWorldTransform(prim)).T
        axes, scale, other = np.linalg.svd(matrix[:3, :3])
        R = axes @ other
        there = self._metre * (matrix[:3, :3] @ np.array(point, dtype=float) + matrix[:3, 3])
        if not (np.abs(there) < LARGEST).all() or not scale[-1] > 0 or not scale[0] < LARGEST:
            raise self._bad(prim, "expected a finite placement")
        if np.linalg.det(R) < 0:
            raise self._bad(prim, "expected a placement that mirrors nothing")
        return pin.SE3(R if turn is None else R @ turn, there)

    def _body(self, prim: Any) -> _Body:
        api = self._physics.RigidBodyAPI(prim)
        moves = bool(api.GetRigidBodyEnabledAttr().Get()) and not api.GetKinematicEnabledAttr().Get()
        return _Body(self._new(prim), prim, self._placed(prim), moves)

    def _numbers(self, prim: Any, what: str, value: Any, infinite: bool = False) -> FloatArray:
        array = np.array(value, dtype=float)
        if np.isnan(array).any() or not (infinite or (np.abs(array) < LARGEST).all()):
            raise self._bad(prim, f"{what}: expected finite numbers, got {one_line(str(value), 60)}")
        return array

    def _quaternion(self, prim: Any, what: str, value: Any) -> FloatArray:
        """Return the rotation matrix of a quaternion; all zeros stand for none."""
        x = self._numbers(prim, what, [*value.GetImaginary(), value.GetReal()])
        if not x.any():
            return np.eye(3)
        if not abs(np.linalg.norm(x) - 1) < 1e-3:
            raise self._bad(prim, f"{what}: expected a quaternion of length 1, got {np.linalg.norm(x):g}")
        return np.asarray(pin.Quaternion(x / np.linalg.norm(x)).matrix())

    def _link(self, model: Xml.Element, body: _Body) -> None:
        link = sub(model, "link", name=body.name)
        _pose(link, body.place, "__model__")
        if not body.moves:
            joint_between(model, self._unique(f"{body.name}_fixed"), "fixed", "world", body.name)
            return
        api = self._physics.MassAPI(body.prim)
        mass = float(self._numbers(body.prim, "mass", api.GetMassAttr().Get() or 0.0))
        moments = self._numbers(body.prim, "diagonalInertia", api.GetDiagonalInertiaAttr().Get() or (0,) * 3)
        com = np.array(api.GetCenterOfMassAttr().Get() or (-math.inf,) * 3, dtype=float)
        if not mass > 0 or not moments.any() or moments.min() < 0:
            raise self._bad(
                body.prim, "expected a positive mass and diagonalInertia: those of shapes are not computed"
            )
        if np.isinf(com).any():
            if self._has_shapes(body.prim):
                raise self._bad(body.prim, "expected a centerOfMass: that of shapes is not computed")
            com = np.zeros(3)
        R = self._quaternion(body.prim, "principalAxes", api.GetPrincipalAxesAttr().Get())
        lever = body.place.actInv(self._placed(body.prim, self._numbers(body.prim, "centerOfMass", com)))
        inertia = R @ np.diag(moments) @ R.T * self._kilogram * self._metre**2
        inertial(link, mass * self._kilogram, lever.translation, inertia, exact=True)

    def _has_shapes(self, prim: Any) -> bool:
        return prim.HasAPI(self._physics.CollisionAPI) or any(map(self._has_shapes, prim.GetAllChildren()))

    def _unique(self, name: str) -> str:
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name

    # -- Joints --------------------------------------------------------------------------------------------

    def _end(self, prim: Any, number: int) -> _End:
        """Return a frame of a joint, and the body that it is on."""
        joint = self._physics.Joint(prim)
        relation = joint.GetBody0Rel() if number == 0 else joint.GetBody1Rel()
        targets = relation.GetForwardedTargets()
        if len(targets) > 1:
            raise self._bad(prim, f"body{number}: expected one target, got {len(targets)}")
        point = self._numbers(prim, f"localPos{number}", prim.GetAttribute(f"physics:localPos{number}").Get())
        turn = self._quaternion(
            prim, f"localRot{number}", prim.GetAttribute(f"physics:localRot{number}").Get()
        )
        if not targets:
            return _End(None, pin.SE3(turn, self._metre * point))
        target = self._stage.GetPrimAtPath(targets[0])
        if not target:
            raise self._bad(prim, f"body{number}: {targets[0]!s:.200} does not exist")
        place = self._placed(target, point, turn)
        while target and target.GetPath() not in self._bodies:
            target = target.GetParent()
        return _End(self._bodies[target.GetPath()] if target else None, place)

    def _kind(self, prim: Any) -> tuple[str, FloatArray]:
        """Return the type of a joint in SDF, and its axis."""
        physics, axes = self._physics, np.eye(3)
        for kind, schema in (("revolute", physics.RevoluteJoint), ("prismatic", physics.PrismaticJoint)):
            if prim.IsA(schema):
                return kind, axes["XYZ".index(str(schema(prim).GetAxisAttr().Get()))]
        named = {"PhysicsFixedJoint": "fixed", "PhysicsSphericalJoint": "ball"}
        named["PhysicsDistanceJoint"] = "distance"
        if (kind := str(prim.GetTypeName())) in named:
            return named[kind], axes[2]
        free = tuple(name for name in _FREEDOMS if not self._is_locked(prim, name))
        if kind == "PhysicsJoint" and free in ((), _FREEDOMS[3:]):
            return "ball" if free else "fixed", axes[2]
        if kind == "PhysicsJoint" and len(free) == 1:
            return ("prismatic" if free[0] in _FREEDOMS[:3] else "revolute"), axes["XYZ".index(free[0][-1])]
        raise self._bad(prim, f"a {kind:.80} that is free in {', '.join(free)} is not understood")

    def _is_locked(self, prim: Any, freedom: str) -> bool:
        if not prim.HasAPI(self._physics.LimitAPI, freedom):
            return False
        limit = self._physics.LimitAPI(prim, freedom)
        low, high = limit.GetLowAttr().Get(), limit.GetHighAttr().Get()
        return low is not None and high is not None and float(low) > float(high)

    def _drive(self, prim: Any, kind: str, axis: FloatArray) -> Any:
        """Return the drive of a joint; None if it has none."""
        names = {"revolute": "angular", "prismatic": "linear"}
        letter = "XYZ"[int(np.argmax(np.abs(axis)))]
        for name in (names.get(kind), f"{'rot' if kind == 'revolute' else 'trans'}{letter}"):
            if name and prim.HasAPI(self._physics.DriveAPI, name):
                return self._physics.DriveAPI(prim, name)
        return None

    def _joint(self, model: Xml.Element, prim: Any) -> None:
        kind, axis = self._kind(prim)
        ends = [self._end(prim, number) for number in (0, 1)]
        if ends[0].body is ends[1].body or not any(end.body and end.body.moves for end in ends):
            if kind == "fixed" and any(end.body for end in ends):
                return
            raise self._bad(prim, "it joins no two bodies that move against each other")
        name = self._new(prim)
        if kind == "distance":
            self._rod(model, prim, name, ends)
            return
        there = ends[0].place.actInv(ends[1].place)
        value = self._value(prim, kind, axis, there)
        place, sign = ends[1].place, 1.0
        if ends[1].body is None:  # a child in the world is none
            ends, place, sign = ends[::-1], ends[0].place, -1.0
        parent = "world" if ends[0].body is None else ends[0].body.name
        assert ends[1].body is not None  # noqa: S101 - of the two ends
        element = joint_between(model, name, kind, parent, ends[1].body.name)
        _pose(element, ends[1].body.place.actInv(place), ends[1].body.name)
        if kind not in ("revolute", "prismatic"):
            return
        part = sub(element, "axis")
        sub(part, "xyz", numbers(sign * axis, exact=True))
        self._limits(sub(part, "limit"), prim, kind, axis, value)

    def _value(self, prim: Any, kind: str, axis: FloatArray, there: pin.SE3) -> float:
        """Return the value of a joint where the bodies are placed, after a look at what it holds."""
        turn, shift = pin.log3(there.rotation), np.array(there.translation)
        value = 0.0
        if kind == "revolute":
            value = float(turn @ axis)
            turn = turn - value * axis
        elif kind == "prismatic":
            value = float(shift @ axis)
            shift = shift - value * axis
        elif kind == "ball":
            turn = np.zeros(3)
        apart = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
        if apart[0] > _SINGLE * self._size or apart[1] > _SINGLE:
            raise self._bad(
                prim,
                f"its frames are {apart[0]:.3g} m and {apart[1]:.3g} rad apart where the bodies are placed: "
                "expected bodies that are assembled",
            )
        return value

    def _limits(self, limit: Xml.Element, prim: Any, kind: str, axis: FloatArray, value: float) -> None:
        turns = kind == "revolute"
        unit = math.pi / 180 if turns else self._metre
        low, high = prim.GetAttribute("physics:lowerLimit"), prim.GetAttribute("physics:upperLimit")
        if prim.GetTypeName() == "PhysicsJoint":
            name = f"{'rot' if turns else 'trans'}{'XYZ'[int(np.argmax(np.abs(axis)))]}"
            low, high = (prim.GetAttribute(f"limit:{name}:physics:{end}") for end in ("low", "high"))
        for tag, attribute in (("lower", low), ("upper", high)):
            given = attribute.Get() if attribute else None
            number = float(self._numbers(prim, tag, math.inf if given is None else given, infinite=True))
            if math.isfinite(number):
                sub(limit, tag, numbers(number * unit - value, exact=True))
        drive = self._drive(prim, kind, axis)
        if drive is None:
            sub(limit, "effort", "0")
            return
        self._driven.append(limit)
        force = float(self._numbers(prim, "maxForce", drive.GetMaxForceAttr().Get(), infinite=True))
        force *= self._kilogram * self._metre ** (2 if turns else 1)
        if 0 < force < math.inf:
            sub(limit, "effort", numbers(force, exact=True))

    def _rod(self, model: Xml.Element, prim: Any, name: str, ends: list[_End]) -> None:
        """Keep a distance joint as a closure between two frames."""
        joint = self._physics.DistanceJoint(prim)
        least, most = (
            float(self._numbers(prim, "distance", one.Get(), infinite=True)) * self._metre
            for one in (joint.GetMinDistanceAttr(), joint.GetMaxDistanceAttr())
        )
        if not 0 < least == most < math.inf:
            if self._ignore:
                return
            raise self._bad(
                prim,
                f"expected a minDistance that is the maxDistance, got {least:g} and {most:g} m "
                "(on_unknown='ignore' leaves it out)",
            )
        if any(end.body is None or not end.body.moves for end in ends):
            raise self._bad(prim, "a rod to the world is not understood: give it a body with a fixed joint")
        names = [self._unique(f"{name}_{number}") for number in (0, 1)]
        for frame, end in zip(names, ends, strict=True):
            body = end.body.name if end.body else ""
            _pose(sub(model, "frame", name=frame, attached_to=body), end.place, "__model__")
        self.rods.append(Closure(names[0], names[1], "distance", least))

    # -- All of it -----------------------------------------------------------------------------------------

    def text(self) -> str:
        """Return the robot in SDF."""
        if not self._bodies:
            raise ModelError(f"{self._name}: expected rigid bodies (PhysicsRigidBodyAPI), got none")
        root = Xml.Element("sdf", version="1.11")
        world = sub(root, "world", name="world_of_usd")
        sub(world, "gravity", numbers(self._gravity(), exact=True))
        top = self._stage.GetDefaultPrim()
        model = sub(world, "model", name=self._unique(str(top.GetName()) if top else "robot"))
        places = np.array([body.place.translation for body in self._bodies.values()])
        self._size = max(
            float(np.abs(places - places[0]).max()), float(np.abs(places).max()), self._metre * 1e-2
        )
        self._driven: list[Xml.Element] = []
        for body in self._bodies.values():
            self._link(model, body)
        excluded = "physics:excludeFromArticulation"
        for prim in sorted(self._joints, key=lambda prim: bool(prim.GetAttribute(excluded).Get())):
            if self._physics.Joint(prim).GetJointEnabledAttr().Get():
                self._joint(model, prim)
        if self._driven:
            plugin = sub(model, "plugin", filename="gz-sim-joint-trajectory-controller-system", name="motors")
            for joint in model.iterfind("joint"):
                if joint.find("axis/limit") in self._driven:
                    sub(plugin, "joint_name", joint.get("name"))
        return Xml.tostring(root, encoding="unicode")

    def _gravity(self) -> FloatArray:
        down, size = -self._up, _EARTH
        for prim in self._scenes[:1]:
            scene = self._physics.Scene(prim)
            given = self._numbers(prim, "gravityDirection", scene.GetGravityDirectionAttr().Get())
            if given.any():
                down = given / np.linalg.norm(given)
            magnitude = float(scene.GetGravityMagnitudeAttr().Get())
            if math.isfinite(magnitude) and magnitude >= 0:
                size = float(self._numbers(prim, "gravityMagnitude", magnitude)) * self._metre
        return np.asarray(size * down)

    def _tell_unknown(self, prims: list[Any]) -> None:
        """Refuse what may hold bodies or joints together and is not understood, and name what else acts."""
        found = []
        known = {*self._bodies, *(prim.GetPath() for prim in self._joints)}
        for prim in prims if not self._ignore else ():
            kind, surprises = str(prim.GetTypeName()), list(self._surprises(prim))
            own = ("physics:body0", "physics:body1") if prim.IsA(self._physics.Joint) else ()
            relations = [one for one in prim.GetRelationships() if one.GetName() not in own]
            targets = {path for one in relations for path in one.GetTargets()} & known
            idle = kind in _IDLE_TYPES or "PhysicsFilteredPairsAPI" in _schemas(prim)
            ties = len(targets) > (not own) and not idle
            if ties:
                surprises += [str(one.GetName()) for one in relations if known & {*one.GetTargets()}]
            if ties or any(map(_TYING.search, surprises)):
                raise self._bad(
                    prim,
                    f"{', '.join(surprises)} may hold bodies or joints together, and is not "
                    "understood (on_unknown='ignore' leaves it out)",
                )
            found += [f"{one} ({prim.GetPath()!s:.200})" for one in surprises]
        if found:
            more = f" and {len(found) - 4} more" if len(found) > 4 else ""
            words = f"{self._name}: not understood, and left out: {', '.join(found[:4])}{more}"
            warnings.warn(words, ModelWarning, stacklevel=5)

    def _surprises(self, prim: Any) -> Iterator[str]:
        kind = str(prim.GetTypeName())
        joint = prim.IsA(self._physics.Joint)
        if _PHYSICS.match(kind) and not joint and kind not in _IDLE_TYPES:
            yield kind
        yield from (name for name in _schemas(prim) if _PHYSICS.match(name) and not _IDLE.fullmatch(name))
        for name in ("physxJoint:armature", "physxJoint:jointFriction"):
            attribute = prim.GetAttribute(name)
            if attribute and attribute.Get():
                yield name
        cone = prim.GetAttribute("physics:coneAngle0Limit")
        if prim.IsA(self._physics.SphericalJoint) and cone and float(cone.Get()) >= 0:
            yield "physics:coneAngle0Limit"


def _schemas(prim: Any) -> list[str]:
    """Return the schemas that are applied to a prim, also those that are not installed."""
    listed = prim.GetMetadata("apiSchemas")
    return [] if listed is None else [str(name) for name in listed.GetAddedOrExplicitItems()]


def _pose(parent: Xml.Element, place: pin.SE3, frame: str) -> None:
    turn = pin.Quaternion(place.rotation).normalized().coeffs()
    element = sub(parent, "pose", numbers(place.translation, turn, exact=True), relative_to=frame)
    element.set("rotation_format", "quat_xyzw")
