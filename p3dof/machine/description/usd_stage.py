"""A USD stage, with the loops in it as joints that no articulation contains."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import MissingExtraError, ModelError
from p3dof.machine.description.mechanism import (
    Box,
    Cylinder,
    Joint,
    Mechanism,
    Placement,
    Solid,
    require_no_drive,
    tell_friction,
)
from p3dof.machine.parameters import Body
from p3dof.machine.parameters.body import steiner

_QUATERNION, _PRODUCT = 1e-12, 1e-9
"""What counts as zero: a part of a quaternion, and a product of inertia relative to the largest moment."""


def usd(mechanism: Mechanism) -> str:
    """Return a mechanism as the text of a USD stage (.usda), with the schemas of UsdPhysics.

    Below the default prim, which is the articulation root, there are ``links`` (rigid bodies side by side,
    at home) and ``joints``. Frames fixed to a link are Xforms below it, their masses part of the link's. The
    root is fixed to the default prim, so that the stage can be referenced anywhere. A loop closure is a
    spherical joint with ``physics:excludeFromArticulation``. Collision solids have the purpose ``guide``. The
    scene with the gravity is beside the default prim: opened with it, not referenced with it.

    Lengths and placements are doubles; UsdPhysics itself keeps masses, inertias, joint frames and limits in
    single precision, angles in degrees. It has no limits of velocity and no inertia of
    motors: they are written for Newton and PhysX. It has no friction of joints.

    openusd.org, UsdPhysics: Rigid Body Physics in USD.
    """
    try:
        from pxr import Usd
    except ImportError as error:
        raise MissingExtraError("USD stages need usd-core: pip install 'p3dof[usd]'") from error
    tell_friction(mechanism, "USD")
    return _Stage(mechanism, Usd.Stage.CreateInMemory()).text()


@dataclass(frozen=True, eq=False)
class _Fixed:
    """Where a link is fixed: a rigid body (a link that no fixed joint leads to), and the place in it."""

    body: str
    placement: Placement


class _Stage:
    """The stage while it is being written."""

    def __init__(self, mechanism: Mechanism, stage: Any) -> None:
        self.mechanism = mechanism
        self.stage = stage
        self.fixed = _fixed(mechanism)
        self.home = _home(mechanism)
        self.paths: dict[str, Any] = {}

    def text(self) -> str:
        from pxr import Gf, UsdGeom, UsdPhysics

        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1)
        UsdPhysics.SetStageKilogramsPerUnit(self.stage, 1)
        layer = self.stage.GetRootLayer()
        layer.documentation = (
            f"{self.mechanism.name}, written by p3dof: change the parameters, not this file. "
            "The loops are in joints that are excluded from the articulation."
        )
        root = UsdGeom.Xform.Define(self.stage, self._child("/", self.mechanism.name))
        UsdPhysics.ArticulationRootAPI.Apply(root.GetPrim())
        self.stage.SetDefaultPrim(root.GetPrim())
        self.root = root.GetPath()
        self._links()
        self._joints()
        scene = UsdPhysics.Scene.Define(self.stage, self._child("/", "physics_scene"))
        size = float(np.linalg.norm(self.mechanism.gravity))
        direction = self.mechanism.gravity / size if size else np.array([0.0, 0.0, -1.0])
        scene.CreateGravityDirectionAttr(Gf.Vec3f(*direction.tolist()))
        scene.CreateGravityMagnitudeAttr(size)
        return str(layer.ExportToString())

    def _links(self) -> None:
        from pxr import UsdGeom, UsdPhysics

        UsdGeom.Scope.Define(self.stage, self.root.AppendChild("links"))
        parents = {joint.child: joint.parent for joint in self.mechanism.joints if joint.kind == "fixed"}
        joints = {joint.child: joint for joint in self.mechanism.joints}
        for link in self.mechanism.links:
            marker = link.name in parents
            above = self.paths[parents[link.name]] if marker else self.root.AppendChild("links")
            xform = UsdGeom.Xform.Define(self.stage, self._child(above, link.name))
            self.paths[link.name] = xform.GetPath()
            _place(xform, joints[link.name].placement if marker else self.home[link.name])
            if not marker:
                UsdPhysics.RigidBodyAPI.Apply(xform.GetPrim())
                self._mass(xform.GetPrim(), link.name)
            for number, solid in enumerate(link.visuals, start=1):
                self._solid(xform.GetPath(), f"visual_{number}", solid)
            for number, solid in enumerate(link.collisions, start=1):
                gprim = self._solid(xform.GetPath(), f"collision_{number}", solid)
                gprim.CreatePurposeAttr(UsdGeom.Tokens.guide)
                UsdPhysics.CollisionAPI.Apply(gprim.GetPrim())

    def _mass(self, prim: Any, name: str) -> None:
        """Give a rigid body the mass of its link and of all that is fixed to it."""
        from pxr import Gf, UsdPhysics

        parts = [
            (self.fixed[link.name].placement, link.body)
            for link in self.mechanism.links
            if link.body is not None and link.body.mass > 0 and self.fixed[link.name].body == name
        ]
        if not parts:
            if name == self.mechanism.links[0].name:
                return
            raise ModelError(f"{name}: USD gives a link without mass one of its own; export it with masses")
        mass, center, inertia = _composite(parts)
        moments, axes = _principal(inertia)
        api = UsdPhysics.MassAPI.Apply(prim)
        api.CreateMassAttr(mass)
        api.CreateCenterOfMassAttr(Gf.Vec3f(*center.tolist()))
        api.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments.tolist()))
        api.CreatePrincipalAxesAttr(Gf.Quatf(*_quaternion(axes)))

    def _solid(self, link: Any, name: str, solid: Solid) -> Any:
        from pxr import Gf, UsdGeom, Vt

        path, shape = self._child(link, name), solid.shape
        if isinstance(shape, Box):
            gprim = UsdGeom.Cube.Define(self.stage, path)
            gprim.CreateSizeAttr(1)
        elif isinstance(shape, Cylinder):
            gprim = UsdGeom.Cylinder.Define(self.stage, path)
            gprim.CreateAxisAttr(UsdGeom.Tokens.z)
            gprim.CreateRadiusAttr(_tidy(shape.radius))
            gprim.CreateHeightAttr(_tidy(shape.length))
        else:
            gprim = UsdGeom.Sphere.Define(self.stage, path)
            gprim.CreateRadiusAttr(_tidy(shape.radius))
        gprim.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(gprim, 0))
        *colour, opacity = solid.colour.rgba
        gprim.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*colour)]))
        gprim.CreateDisplayOpacityAttr(Vt.FloatArray([opacity]))
        _place(gprim, solid.placement)
        if isinstance(shape, Box):
            gprim.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*map(_tidy, shape.size)))
        return gprim

    def _joints(self) -> None:
        from pxr import UsdGeom, UsdPhysics

        scope = self.root.AppendChild("joints")
        UsdGeom.Scope.Define(self.stage, scope)
        base = self.mechanism.links[0].name
        anchor = UsdPhysics.FixedJoint.Define(self.stage, self._child(scope, f"{base}_fixed"))
        anchor.CreateBody0Rel().SetTargets([self.root])
        anchor.CreateBody1Rel().SetTargets([self.paths[base]])
        _frames(anchor, Placement(), Placement())
        for joint in self.mechanism.moving:
            self._joint(scope, joint)
        for closure in self.mechanism.closures:
            one, other = self.fixed[closure.frame1], self.fixed[closure.frame2]
            loop = UsdPhysics.SphericalJoint.Define(self.stage, self._child(scope, closure.name))
            loop.CreateBody0Rel().SetTargets([self.paths[one.body]])
            loop.CreateBody1Rel().SetTargets([self.paths[other.body]])
            # Axes that are parallel at home: the joint is then at its zero there.
            turn = self.home[other.body].rotation.T @ self.home[one.body].rotation @ one.placement.rotation
            _frames(loop, one.placement, Placement(other.placement.position, turn))
            loop.CreateExcludeFromArticulationAttr(True)

    def _joint(self, scope: Any, joint: Joint) -> None:
        from pxr import Sdf, UsdPhysics

        if joint.axis is None or joint.limits is None:  # never for a moving joint
            return
        slides = joint.kind == "prismatic"
        define = UsdPhysics.PrismaticJoint if slides else UsdPhysics.RevoluteJoint
        unit = 1.0 if slides else 180 / math.pi
        prim = define.Define(self.stage, self._child(scope, joint.name))
        parent = self.fixed[joint.parent]
        prim.CreateBody0Rel().SetTargets([self.paths[parent.body]])
        prim.CreateBody1Rel().SetTargets([self.paths[joint.child]])
        token, turn = _axis(joint.axis)
        prim.CreateAxisAttr(token)
        _frames(
            prim,
            _compose(parent.placement, joint.placement, Placement(rotation=turn)),
            Placement(rotation=turn),
        )
        prim.CreateLowerLimitAttr(unit * joint.limits.lower)
        prim.CreateUpperLimitAttr(unit * joint.limits.upper)
        for name in ("newton:velocityLimit", "physxJoint:maxJointVelocity"):
            attribute = prim.GetPrim().CreateAttribute(name, Sdf.ValueTypeNames.Float, custom=False)
            attribute.Set(unit * joint.limits.velocity)
        require_no_drive(joint, "USD", armature=True)
        if joint.armature:
            for name in ("newton:armature", "physxJoint:armature"):
                attribute = prim.GetPrim().CreateAttribute(name, Sdf.ValueTypeNames.Float, custom=False)
                attribute.Set(joint.armature)
        if joint.name in self.mechanism.actuated:
            drive = UsdPhysics.DriveAPI.Apply(prim.GetPrim(), "linear" if slides else "angular")
            drive.CreateTypeAttr(UsdPhysics.Tokens.force)
            drive.CreateMaxForceAttr(joint.limits.effort)
            drive.CreateStiffnessAttr(0)
            drive.CreateDampingAttr(0)

    def _child(self, parent: Any, name: str) -> Any:
        """Return a free path below a prim, with the name as the display name if it is no identifier."""
        from pxr import Sdf, Tf

        identifier = Tf.MakeValidIdentifier(name)
        path, number = Sdf.Path(parent).AppendChild(identifier), 1
        while self.stage.GetPrimAtPath(path):
            number += 1
            path = Sdf.Path(parent).AppendChild(f"{identifier}_{number}")
        if path.name != name:
            self.stage.DefinePrim(path).SetDisplayName(name)
        return path


def _compose(*placements: Placement) -> Placement:
    """Return the placement that the placements make one after the other."""
    position: FloatArray = np.zeros(3)
    rotation: FloatArray = np.eye(3)
    for placement in placements:
        position = position + rotation @ placement.position
        rotation = rotation @ placement.rotation
    return Placement(position, rotation)


def _fixed(mechanism: Mechanism) -> dict[str, _Fixed]:
    """Return where every link is fixed, by link name; a rigid body is fixed to itself."""
    found = {mechanism.links[0].name: _Fixed(mechanism.links[0].name, Placement())}
    for joint in mechanism.joints:
        if joint.kind == "fixed":
            above = found[joint.parent]
            found[joint.child] = _Fixed(above.body, _compose(above.placement, joint.placement))
        else:
            found[joint.child] = _Fixed(joint.child, Placement())
    return found


def _home(mechanism: Mechanism) -> dict[str, Placement]:
    """Return the placements of the links in the root at home, by link name."""
    found = {mechanism.links[0].name: Placement()}
    for joint in mechanism.joints:
        found[joint.child] = _compose(found[joint.parent], joint.placement)
    return found


def _composite(parts: Iterable[tuple[Placement, Body]]) -> tuple[float, FloatArray, FloatArray]:
    """Return mass, mass centre and inertia about it of bodies with placements."""
    masses, centers, inertias = [], [], []
    for at, body in parts:
        masses.append(body.mass)
        centers.append(at.position + at.rotation @ body.com)
        inertias.append(at.rotation @ body.inertia @ at.rotation.T)
    mass = math.fsum(masses)
    center = np.add(np.array(masses) @ np.array(centers) / mass, 0.0)
    offsets = [m * steiner(c - center) for m, c in zip(masses, centers, strict=True)]
    return mass, center, np.sum([*inertias, *offsets], axis=0)


def _principal(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return principal moments and axes as columns: those nearest to the frame's, by Jacobi's rotations.

    Unlike the eigenvectors of a general solver, they do not change with the CPU where two moments are equal.
    """
    J: FloatArray = (inertia + inertia.T) / 2
    axes: FloatArray = np.eye(3)
    for _ in range(50):
        i, j = max(((0, 1), (0, 2), (1, 2)), key=lambda at: abs(J[at]))
        if abs(J[i, j]) <= _PRODUCT * np.abs(J).max():
            break
        angle = 0.5 * math.atan2(2 * J[i, j], J[j, j] - J[i, i])
        if abs(angle) > math.pi / 4:  # the other axis is nearer
            angle -= math.copysign(math.pi / 2, angle)
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = math.cos(angle)
        turn[i, j], turn[j, i] = math.sin(angle), -math.sin(angle)
        J, axes = turn.T @ J @ turn, axes @ turn
    return np.diag(J).copy(), axes


def _axis(axis: FloatArray) -> tuple[str, FloatArray]:
    """Return the axis X, Y or Z of a joint frame, and the least rotation that turns it into a unit vector."""
    k = int(np.argmax(np.abs(axis) - [0.0, 1e-9, 2e-9]))  # of equal ones the first
    e = np.sign(axis[k]) * np.eye(3)[k]
    v = np.cross(e, axis)
    V = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    turn = np.eye(3) + V + V @ V / (1 + e @ axis)
    if axis[k] < 0:  # first half a turn about the next axis
        turn = turn @ (2 * np.diag(np.eye(3)[(k + 1) % 3]) - np.eye(3))
    return "XYZ"[k], turn


def _quaternion(rotation: FloatArray) -> tuple[float, float, float, float]:
    """Return the quaternion w, x, y, z of a rotation; its first part that is not zero is positive."""
    from scipy.spatial.transform import Rotation  # not at start-up: it takes as long as Pinocchio

    writable = np.array(rotation)  # SciPy 1.15 takes no other
    x, y, z, w = Rotation.from_matrix(writable).as_quat().tolist()
    parts = np.array([w, x, y, z])
    parts[np.abs(parts) < _QUATERNION] = 0.0
    parts *= math.copysign(1.0, parts[np.flatnonzero(parts)[0]])
    w, x, y, z = (parts + 0.0).tolist()
    return w, x, y, z


def _tidy(value: float) -> float:
    """Return a number with no more than 15 significant digits; no negative zero."""
    return float(f"{value + 0.0:.15g}")


def _place(xform: Any, placement: Placement) -> None:
    """Move a prim that has no transform yet."""
    from pxr import Gf, UsdGeom

    xform.AddTranslateOp().Set(Gf.Vec3d(*map(_tidy, placement.position.tolist())))
    orient = xform.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
    orient.Set(Gf.Quatd(*map(_tidy, _quaternion(placement.rotation))))


def _frames(joint: Any, frame0: Placement, frame1: Placement) -> None:
    """Set a joint's frames in its two bodies."""
    from pxr import Gf

    joint.CreateLocalPos0Attr(Gf.Vec3f(*frame0.position.tolist()))
    joint.CreateLocalRot0Attr(Gf.Quatf(*_quaternion(frame0.rotation)))
    joint.CreateLocalPos1Attr(Gf.Vec3f(*frame1.position.tolist()))
    joint.CreateLocalRot1Attr(Gf.Quatf(*_quaternion(frame1.rotation)))
