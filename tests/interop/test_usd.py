"""USD: `Usd.Stage.Open("urdf/p3dof.usda")`; usdview, Isaac Sim and Newton open the same file."""

import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from reference import (
    FILES,
    GRAVITY,
    LINKS,
    MECHANISM,
    MOVING,
    URDF,
    assert_placements,
    closed_joints,
    placements,
    random_joints,
)

from p3dof._base.errors import MissingExtraError, ModelError
from p3dof.machine import description
from p3dof.machine.description.mechanism import Box, Cylinder, Joint, JointLimits, Link, Mechanism, Placement
from p3dof.machine.description.usd_stage import _axis, _principal, _quaternion, usd
from p3dof.machine.parameters import PAPER, SOLIDS, Body, Geometry, of_solids

pytest.importorskip("pxr", reason="usd-core not installed: pip install 'p3dof[usd]'")

from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

FILE = FILES / "p3dof.usda"
SINGLE = 2e-7  # single precision, relative
BODIES = [name for name in LINKS if name not in MECHANISM.markers]


def opened(text):
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(text)
    return Usd.Stage.Open(layer)


@pytest.fixture(scope="module")
def stage():
    return Usd.Stage.Open(str(FILE))


def links(stage):
    """The prims of all links and markers, by name."""
    scope = stage.GetDefaultPrim().GetChild("links")
    return {prim.GetDisplayName() or prim.GetName(): prim for prim in Usd.PrimRange(scope) if is_link(prim)}


def is_link(prim):
    return prim.IsA(UsdGeom.Xform)


def joints(stage):
    scope = stage.GetDefaultPrim().GetChild("joints")
    return {prim.GetDisplayName() or prim.GetName(): UsdPhysics.Joint(prim) for prim in scope.GetChildren()}


def homogeneous(position, quaternion):
    result = np.eye(4)
    w, (x, y, z) = quaternion.GetReal(), quaternion.GetImaginary()
    result[:3, :3] = pin.Quaternion(w, x, y, z).normalized().toRotationMatrix()
    result[:3, 3] = position
    return result


def frames(joint):
    """The joint's frames in its two bodies."""
    return [
        homogeneous(
            getattr(joint, f"GetLocalPos{i}Attr")().Get(), getattr(joint, f"GetLocalRot{i}Attr")().Get()
        )
        for i in (0, 1)
    ]


def ends(joint):
    """The names of its two bodies."""
    found = []
    for relation in (joint.GetBody0Rel(), joint.GetBody1Rel()):
        (target,) = relation.GetTargets()
        prim = joint.GetPrim().GetStage().GetPrimAtPath(target)
        assert prim
        found.append(prim.GetDisplayName() or prim.GetName())
    return found


def world(prim):
    """Placement of a prim: USD's matrices act on rows."""
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.Default())).T


def moved(joint, value):
    """What the joint does at a value of its coordinate, in its frames."""
    prim = joint.GetPrim()
    result = np.eye(4)
    slides = prim.IsA(UsdPhysics.PrismaticJoint)
    token = (UsdPhysics.PrismaticJoint if slides else UsdPhysics.RevoluteJoint)(prim).GetAxisAttr().Get()
    axis = np.eye(3)["XYZ".index(token)]
    if slides:
        result[:3, 3] = value * axis
    else:
        result[:3, :3] = pin.exp3(value * axis)
    return result


def kinematics(stage, q):
    """Placement of every link, along the joints."""
    found = {"base_link": np.eye(4)}
    for name, joint in joints(stage).items():
        if name in MOVING:
            parent, child = ends(joint)
            one, other = frames(joint)
            found[child] = found[parent] @ one @ moved(joint, q[name]) @ np.linalg.inv(other)
    for name, prim in links(stage).items():
        if name in MECHANISM.markers:
            local = np.array(UsdGeom.Xformable(prim).GetLocalTransformation()).T
            found[name] = found[prim.GetParent().GetName()] @ local
    return found


def parsed(stage):
    """What UsdPhysics's own parser makes of the stage; newer versions have renamed it."""
    new = getattr(UsdPhysics, "UsdPhysicsLoadStageFromPrimRange", None)
    return new(stage, ["/"]) if new else UsdPhysics.LoadUsdPhysicsFromRange(stage, ["/"])


def test_file_is_up_to_date():
    assert description.check(PAPER, FILES, ["usd"]) == []


def test_validators_have_nothing_to_say(stage):
    validation = pytest.importorskip("pxr.UsdValidation", reason="this usd-core has no UsdValidation")
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    names = {validator.GetMetadata().name for validator in validators}
    assert {"usdPhysicsValidators:ArticulationChecker", "usdPhysicsValidators:PhysicsJointChecker"} <= names
    errors = validation.ValidationContext(validators).Validate(stage)
    assert [(error.GetName(), error.GetMessage()) for error in errors] == []


def test_units_and_root(stage):
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1
    assert UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage)
    root = stage.GetDefaultPrim()
    assert root.GetName() == MECHANISM.name
    assert root.HasAPI(UsdPhysics.ArticulationRootAPI)


def test_gravity(stage):
    (prim,) = (prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene))
    scene = UsdPhysics.Scene(prim)
    gravity = scene.GetGravityMagnitudeAttr().Get() * np.array(scene.GetGravityDirectionAttr().Get())
    np.testing.assert_allclose(gravity, GRAVITY, rtol=SINGLE)
    assert not prim.GetPath().HasPrefix(stage.GetDefaultPrim().GetPath())


def test_bodies_weigh_what_they_and_their_markers_weigh(stage):
    model = pin.buildModelFromUrdf(str(URDF))
    body = LINKS["base_link"].body
    expected = {"base_link": pin.Inertia(body.mass, body.com, body.inertia)}
    expected |= {joint.child: model.inertias[model.getJointId(name)] for name, joint in MOVING.items()}
    prims = links(stage)
    assert sorted(name for name in prims if prims[name].HasAPI(UsdPhysics.RigidBodyAPI)) == sorted(BODIES)
    assert sorted(expected) == sorted(BODIES)
    total = 0.0
    for name, inertia in expected.items():
        api = UsdPhysics.MassAPI(prims[name])
        total += api.GetMassAttr().Get()
        np.testing.assert_allclose(api.GetMassAttr().Get(), inertia.mass, rtol=SINGLE)
        np.testing.assert_allclose(api.GetCenterOfMassAttr().Get(), inertia.lever, rtol=SINGLE, atol=1e-9)
        axes = homogeneous((0, 0, 0), api.GetPrincipalAxesAttr().Get())[:3, :3]
        found = axes @ np.diag(api.GetDiagonalInertiaAttr().Get()) @ axes.T
        scale = np.abs(inertia.inertia).max()
        np.testing.assert_allclose(found, inertia.inertia, rtol=0, atol=SINGLE * scale, err_msg=name)
    assert total == pytest.approx(MECHANISM.mass + body.mass, rel=SINGLE)
    for name in MECHANISM.markers:
        assert not prims[name].GetAppliedSchemas()


def test_links_are_at_home(stage):
    assert_placements({name: world(prim) for name, prim in links(stage).items()}, dict.fromkeys(MOVING, 0.0))


@pytest.mark.parametrize("seed", range(3))
def test_joints_move_the_links_as_they_should(stage, seed):
    q = random_joints(seed)
    assert_placements(kinematics(stage, q), q, 1e-6)


def test_joints_have_the_same_names_links_limits_and_drives(stage):
    found = joints(stage)
    closures = {closure.name for closure in MECHANISM.closures}
    assert set(found) == {"base_link_fixed", *MOVING, *closures}
    for name, joint in MOVING.items():
        prim = found[name].GetPrim()
        assert ends(found[name]) == [joint.parent, joint.child]
        slides = joint.kind == "prismatic"
        schema = UsdPhysics.PrismaticJoint if slides else UsdPhysics.RevoluteJoint
        assert prim.IsA(schema)
        unit = 1 if slides else 180 / math.pi
        assert schema(prim).GetLowerLimitAttr().Get() == pytest.approx(unit * joint.limits.lower, rel=SINGLE)
        assert schema(prim).GetUpperLimitAttr().Get() == pytest.approx(unit * joint.limits.upper, rel=SINGLE)
        for attribute in ("newton:velocityLimit", "physxJoint:maxJointVelocity"):
            speed = prim.GetAttribute(attribute).Get()
            assert speed == pytest.approx(unit * joint.limits.velocity, rel=SINGLE)
        drive = UsdPhysics.DriveAPI.Get(prim, "linear" if slides else "angular")
        assert bool(drive) == (name in MECHANISM.actuated)
        if drive:
            assert drive.GetTypeAttr().Get() == "force"
            assert drive.GetMaxForceAttr().Get() == pytest.approx(joint.limits.effort, rel=SINGLE)
            assert drive.GetStiffnessAttr().Get() == drive.GetDampingAttr().Get() == 0


def test_frames_of_every_joint_coincide_at_home(stage):
    assert_frames_coincide(stage)


def assert_frames_coincide(stage, size=1.0):
    prims = {**links(stage), stage.GetDefaultPrim().GetName(): stage.GetDefaultPrim()}
    for joint in joints(stage).values():
        one, other = (
            world(prims[name]) @ frame for name, frame in zip(ends(joint), frames(joint), strict=True)
        )
        np.testing.assert_allclose(one[:3, :3], other[:3, :3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(one[:3, 3], other[:3, 3], rtol=0, atol=2e-7 * size)


def test_root_is_fixed_to_the_default_prim(stage):
    joint = joints(stage)["base_link_fixed"]
    assert joint.GetPrim().IsA(UsdPhysics.FixedJoint)
    assert ends(joint) == [MECHANISM.name, "base_link"]


def test_loops_are_spherical_joints_outside_the_articulation(stage):
    found = joints(stage)
    for closure in MECHANISM.closures:
        joint = found.pop(closure.name)
        assert joint.GetPrim().IsA(UsdPhysics.SphericalJoint)
        assert joint.GetExcludeFromArticulationAttr().Get() is True
        carriers = [MECHANISM.markers[frame].parent for frame in (closure.frame1, closure.frame2)]
        assert ends(joint) == carriers
    for joint in found.values():
        assert not joint.GetExcludeFromArticulationAttr().Get()
    objects = parsed(stage)
    ((root,), _) = objects[UsdPhysics.ObjectType.Articulation]
    assert root == stage.GetDefaultPrim().GetPath()
    paths, loops = objects[UsdPhysics.ObjectType.SphericalJoint]
    assert {path.name for path in paths} == {closure.name for closure in MECHANISM.closures}
    # The parser lists all joints as the articulation's; engines leave out those with this mark.
    assert all(loop.excludeFromArticulation for loop in loops)


def test_loops_are_closed_at_closed_poses_and_only_there(stage):
    found = joints(stage)

    def gaps(q):
        at = kinematics(stage, q)
        for closure in MECHANISM.closures:
            joint = found[closure.name]
            one, other = (at[n] @ frame for n, frame in zip(ends(joint), frames(joint), strict=True))
            yield np.linalg.norm(one[:3, 3] - other[:3, 3])

    for q in closed_joints(10):
        assert max(gaps(q)) < 5e-7
    for seed in range(3):
        assert min(gaps(random_joints(seed))) > 1e-3


def test_every_solid_is_there(stage):
    prims = links(stage)
    for name, link in LINKS.items():
        for kind, solids in (("visual", link.visuals), ("collision", link.collisions)):
            found = [prim for prim in prims[name].GetChildren() if prim.GetName().startswith(f"{kind}_")]
            assert len(found) == len(solids)
            for prim, solid in zip(found, solids, strict=True):
                assert_solid(prim, solid)
                guide = UsdGeom.Imageable(prim).ComputePurpose() == "guide"
                assert prim.HasAPI(UsdPhysics.CollisionAPI) == guide == (kind == "collision")


def assert_solid(prim, solid):
    local = np.array(UsdGeom.Xformable(prim).GetLocalTransformation()).T
    np.testing.assert_allclose(local[:3, 3], solid.placement.position, rtol=0, atol=1e-14)
    size = np.linalg.norm(local[:3, :3], axis=0)
    np.testing.assert_allclose(local[:3, :3] / size, solid.placement.rotation, rtol=0, atol=1e-14)
    if isinstance(solid.shape, Box):
        cube = UsdGeom.Cube(prim)
        np.testing.assert_allclose(cube.GetSizeAttr().Get() * size, solid.shape.size, rtol=1e-14)
    else:
        np.testing.assert_allclose(size, 1, rtol=1e-14)
        round_one = (UsdGeom.Cylinder if isinstance(solid.shape, Cylinder) else UsdGeom.Sphere)(prim)
        assert round_one.GetRadiusAttr().Get() == pytest.approx(solid.shape.radius, rel=1e-14)
    if isinstance(solid.shape, Cylinder):
        assert round_one.GetAxisAttr().Get() == "Z"
        assert round_one.GetHeightAttr().Get() == pytest.approx(solid.shape.length, rel=1e-14)
    gprim = UsdGeom.Gprim(prim)
    np.testing.assert_allclose(gprim.GetDisplayColorAttr().Get(), [solid.colour.rgba[:3]], rtol=SINGLE)
    np.testing.assert_allclose(gprim.GetDisplayOpacityAttr().Get(), [solid.colour.rgba[3]], rtol=SINGLE)
    extent = UsdGeom.Boundable.ComputeExtentFromPlugins(gprim, Usd.TimeCode.Default())
    assert gprim.GetExtentAttr().Get() == extent


def test_stage_can_be_referenced_anywhere():
    stage = Usd.Stage.CreateInMemory()
    cell = UsdGeom.Xform.Define(stage, "/cell")
    cell.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    stage.OverridePrim("/cell").GetReferences().AddReference(str(FILE))
    assert not [prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene)]
    base = stage.GetPrimAtPath("/cell/links/base_link")
    np.testing.assert_array_equal(world(base)[:3, 3], [1, 2, 3])
    (anchor,) = parsed(stage)[UsdPhysics.ObjectType.FixedJoint][1]
    np.testing.assert_allclose(anchor.localPose0Position, [1, 2, 3])


@pytest.mark.parametrize(
    "parameters",
    [SOLIDS, *(of_solids(Geometry(k * 0.1, k * 0.25, k * 0.4, k * 0.05)) for k in (0.01, 0.1, 3, 100))],
    ids=["solids", "0.01", "0.1", "3", "100"],
)
def test_other_machines(parameters):
    mechanism = description.with_masses(description.describe(parameters))
    stage = opened(usd(mechanism))
    assert_frames_coincide(stage, parameters.geometry.L / 0.4)
    total = sum(
        UsdPhysics.MassAPI(prim).GetMassAttr().Get()
        for prim in links(stage).values()
        if prim.HasAPI(UsdPhysics.MassAPI)
    )
    assert total == pytest.approx(mechanism.mass + mechanism.links[0].body.mass, rel=SINGLE)


def test_moving_links_without_mass_are_refused():
    with pytest.raises(ModelError, match="crossbar_upper"):
        usd(description.describe(PAPER))


def test_root_may_have_no_mass():
    links_ = (replace(MECHANISM.links[0], body=None), *MECHANISM.links[1:])
    stage = opened(usd(replace(MECHANISM, links=links_)))
    prim = links(stage)["base_link"]
    assert prim.HasAPI(UsdPhysics.RigidBodyAPI)
    assert not prim.HasAPI(UsdPhysics.MassAPI)


def test_no_gravity_is_no_gravity():
    stage = opened(usd(replace(MECHANISM, gravity=np.zeros(3))))
    (prim,) = (prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene))
    assert UsdPhysics.Scene(prim).GetGravityMagnitudeAttr().Get() == 0


def test_odd_names_become_display_names():
    odd, twin = '<a & "b">: é\\ """', "<a & 'b'>: é\\ '''"
    limits = JointLimits(-1.0, 1.0, 1.0, 1.0)
    body = Body(1.0, np.zeros(3), np.eye(3))
    joints_ = (
        Joint(odd, "revolute", "root", odd, Placement(), [0, 0, -1], limits),
        Joint("visual_1", "fixed", odd, "fixed", Placement((1, 0, 0))),
        Joint(twin, "prismatic", "fixed", twin, Placement((1, 0, 0)), [0.6, 0, 0.8], limits),
    )
    links_ = (Link("root"), Link(odd, body), Link("fixed", body), Link(twin, body))
    mechanism = Mechanism(odd, links_, joints_, (), (twin,), np.zeros(3))
    stage = opened(usd(mechanism))
    assert stage.GetDefaultPrim().GetDisplayName() == odd
    found = links(stage)
    assert set(found) == {"root", odd, twin, "fixed"}
    assert ends(joints(stage)[twin]) == [odd, twin]
    np.testing.assert_allclose(world(found[twin])[:3, 3], [2, 0, 0])
    mass = UsdPhysics.MassAPI(found[odd])
    assert mass.GetMassAttr().Get() == 2
    np.testing.assert_allclose(mass.GetCenterOfMassAttr().Get(), [0.5, 0, 0])
    np.testing.assert_allclose(mass.GetDiagonalInertiaAttr().Get(), [2, 2.5, 2.5])
    assert_frames_coincide(stage)


def test_without_usd_core_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[usd\]"):
        usd(MECHANISM)


def test_text_is_the_same_in_every_process():
    code = (
        "import sys; from p3dof.machine.description import files; from p3dof.machine.parameters import PAPER;"
        "sys.stdout.buffer.write(files.texts(PAPER, ['usd'])['p3dof.usda'].encode())"
    )
    outputs = {
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
        ).stdout
        for seed in (0, 1)
    }
    assert len(outputs) == 1


def test_principal_axes_are_those_nearest_to_the_frame():
    rng = np.random.default_rng(0)
    for _ in range(200):
        A = rng.normal(0, 1, (3, 3))
        moments, axes = _principal(A @ A.T)
        np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, A @ A.T, rtol=0, atol=1e-7)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), rtol=0, atol=1e-12)
        assert np.linalg.det(axes) > 0
    noise = 1e-13 * rng.normal(0, 1, (3, 3))
    np.testing.assert_array_equal(_principal(np.diag([2.0, 3.0, 3.0]) + noise)[1], np.eye(3))
    turn = pin.exp3(np.array([0.0, 0.3, 0.0]))
    moments, axes = _principal(turn @ np.diag([3.0, 2.0, 1.0]) @ turn.T)
    np.testing.assert_allclose(moments, [3, 2, 1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(axes, turn, rtol=0, atol=1e-9)


def test_axis_tokens_and_quaternions():
    rng = np.random.default_rng(1)
    axes = [*np.eye(3), *-np.eye(3), *(v / np.linalg.norm(v) for v in rng.normal(0, 1, (50, 3)))]
    for axis in axes:
        token, turn = _axis(axis)
        np.testing.assert_allclose(turn @ np.eye(3)["XYZ".index(token)], axis, rtol=0, atol=1e-12)
        w, x, y, z = _quaternion(turn)
        np.testing.assert_allclose(pin.Quaternion(w, x, y, z).toRotationMatrix(), turn, rtol=0, atol=1e-10)
        assert next(part for part in (w, x, y, z) if part) > 0
    assert _quaternion(np.diag([-1.0, 1.0, -1.0])) == (0, 0, 1, 0)


def test_committed_placements_match_the_urdf_to_double_precision(stage):
    expected = placements(dict.fromkeys(MOVING, 0.0))
    for name, prim in links(stage).items():
        np.testing.assert_allclose(world(prim), expected[name], rtol=0, atol=1e-13, err_msg=name)
