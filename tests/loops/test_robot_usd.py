"""USD is read: robots that usd-core writes are those of a URDF; single precision holds their numbers."""

from __future__ import annotations

import random
import warnings
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest
from damage import damaged
from documents import ROOT

pytest.importorskip("pxr", reason="usd-core not installed: pip install 'p3dof[usd]'")

from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

import p3dof
from p3dof._base.errors import FileError, InputError, MissingExtraError, ModelError, ModelWarning
from p3dof.loops import load_robot

TURNS = (  # quaternions w, x, y, z of turns that single precision holds exactly
    (1.0, 0.0, 0.0, 0.0),
    (0.5, 0.5, 0.5, 0.5),
    (0.5, -0.5, 0.5, 0.5),
    (0.0, 1.0, 0.0, 0.0),
)


def placed(point, turn=0):
    w, x, y, z = TURNS[turn]
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), np.array(point, dtype=float))


@dataclass(frozen=True)
class Body:
    place: pin.SE3
    mass: float = 2.0
    com: tuple = (0.125, 0.0, 0.25)
    moments: tuple = (0.5, 0.25, 0.375)


@dataclass(frozen=True)
class Joint:
    kind: str
    one: str  # "world" or a body
    other: str
    place: pin.SE3
    axis: str = "Y"
    drive: float | None = None  # its largest force
    limits: tuple | None = None
    closes: bool = False


def hinge(one, other, point, turn=0, **more):
    """A hinge about y."""
    place = placed(point, turn)
    return Joint("revolute", one, other, place, "XYZ"[int(np.abs(place.rotation[1]).argmax())], **more)


FOUR_BAR = (
    {
        "crank": Body(placed((0, 0, 0.125), 2)),
        "coupler": Body(placed((0.25, 0, 0.25), 1), 1.5),
        "rocker": Body(placed((0.5, 0, 0.25), 3), 3.0),
    },
    {
        "crank_joint": hinge("world", "crank", (0, 0, 0), 1, drive=8.0, limits=(-90.0, 180.0)),
        "elbow": hinge("crank", "coupler", (0, 0, 0.25)),
        "rocker_joint": hinge("world", "rocker", (0.5, 0, 0), 2),
        "closing": hinge("rocker", "coupler", (0.5, 0, 0.375), 1, closes=True),
    },
)


def stewart():
    """Six legs between balls: three upright, two along y, one along x."""
    bodies = {"platform": Body(placed((0, 0, 1), 1), 8.0, (0.0, 0.0625, 0.0))}
    joints = {}
    tips = [
        (0.5, 0, 1),
        (-0.25, 0.5, 1),
        (-0.25, -0.5, 1),
        (0.25, 0.5, 1.25),
        (-0.5, 0.5, 1.125),
        (0.5, 0.25, 0.875),
    ]
    for i, (tip, axis) in enumerate(zip(tips, "ZZZYYX", strict=True)):
        along = np.eye(3)["XYZ".index(axis)]
        foot, middle = np.array(tip) - along, np.array(tip) - 0.5 * along
        bodies[f"cylinder_{i}"] = Body(placed(foot), 1.0 + i / 8)
        bodies[f"piston_{i}"] = Body(placed(middle, 2), 0.5)
        joints[f"foot_{i}"] = Joint("ball", "world", f"cylinder_{i}", placed(foot))
        joints[f"leg_{i}"] = Joint("prismatic", f"cylinder_{i}", f"piston_{i}", placed(middle), axis, 100.0)
        joints[f"tip_{i}"] = Joint("ball", f"piston_{i}", "platform", placed(tip), closes=i > 0)
    return bodies, joints


def stage_of(robot, metre=1.0, kilogram=1.0, up="Z"):
    """Write a robot by the library, in other units."""
    bodies, joints = robot
    stage = Usd.Stage.CreateInMemory("robot.usda")
    UsdGeom.SetStageMetersPerUnit(stage, metre)
    UsdGeom.SetStageUpAxis(stage, up)
    UsdPhysics.SetStageKilogramsPerUnit(stage, kilogram)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/robot").GetPrim())
    UsdPhysics.Scene.Define(stage, "/scene")
    for name, body in bodies.items():
        xform = UsdGeom.Xform.Define(stage, f"/robot/{name}")
        w, x, y, z = pin.Quaternion(body.place.rotation).coeffs()[[3, 0, 1, 2]]
        xform.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*(body.place.translation / metre)))
        xform.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(w, x, y, z))
        UsdPhysics.RigidBodyAPI.Apply(xform.GetPrim())
        mass = UsdPhysics.MassAPI.Apply(xform.GetPrim())
        mass.CreateMassAttr(body.mass / kilogram)
        mass.CreateCenterOfMassAttr(Gf.Vec3f(*(np.array(body.com) / metre)))
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*(np.array(body.moments) / kilogram / metre**2)))
        mass.CreatePrincipalAxesAttr(Gf.Quatf(*TURNS[1]))
    for name, joint in joints.items():
        write_joint(stage, name, joint, bodies, metre, kilogram)
    return stage


def write_joint(stage, name, joint, bodies, metre, kilogram):
    kinds = {
        "revolute": UsdPhysics.RevoluteJoint,
        "prismatic": UsdPhysics.PrismaticJoint,
        "ball": UsdPhysics.SphericalJoint,
        "fixed": UsdPhysics.FixedJoint,
    }
    prim = kinds[joint.kind].Define(stage, f"/robot/{name}")
    for number, end in enumerate((joint.one, joint.other)):
        place = pin.SE3.Identity() if end == "world" else bodies[end].place
        if end != "world":
            (prim.CreateBody0Rel, prim.CreateBody1Rel)[number]().SetTargets([f"/robot/{end}"])
        own = place.actInv(joint.place)
        w, x, y, z = pin.Quaternion(own.rotation).coeffs()[[3, 0, 1, 2]]
        pos = (prim.CreateLocalPos0Attr, prim.CreateLocalPos1Attr)[number]
        pos(Gf.Vec3f(*(own.translation / metre)))
        (prim.CreateLocalRot0Attr, prim.CreateLocalRot1Attr)[number](Gf.Quatf(w, x, y, z))
    if joint.kind in ("revolute", "prismatic"):
        prim.CreateAxisAttr(joint.axis)
        turns = joint.kind == "revolute"
        for attribute, limit in zip(
            (prim.CreateLowerLimitAttr, prim.CreateUpperLimitAttr), joint.limits or (), strict=False
        ):
            attribute(limit if turns else limit / metre)
        if joint.drive is not None:
            drive = UsdPhysics.DriveAPI.Apply(prim.GetPrim(), "angular" if turns else "linear")
            drive.CreateMaxForceAttr(joint.drive / kilogram / metre ** (2 if turns else 1))
    prim.CreateExcludeFromArticulationAttr(joint.closes)


def urdf_of(robot):
    """The same robot as a URDF, whose links are where their joints are, and its sidecar."""
    bodies, joints = robot
    frames = {"world": pin.SE3.Identity()}
    frames |= {joint.other: joint.place for joint in joints.values() if not joint.closes}

    def origin(place, within):
        own = within.actInv(place)
        xyz, rpy = (
            " ".join(map(repr, x.tolist())) for x in (own.translation, pin.rpy.matrixToRpy(own.rotation))
        )
        return f'<origin xyz="{xyz}" rpy="{rpy}"/>'

    w, x, y, z = TURNS[1]
    parts = ['<link name="world"/>']
    for name, body in bodies.items():
        R = pin.Quaternion(w, x, y, z).matrix()
        com = body.place * pin.SE3(R, np.array(body.com))
        xx, yy, zz = body.moments
        parts.append(
            f'<link name="{name}"><inertial>{origin(com, frames[name])}<mass value="{body.mass}"/>'
            f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
    closures, balls = [], []
    for name, joint in joints.items():
        if joint.closes:
            closures.append([f"{name}_0", f"{name}_1"])
            for number, end in enumerate((joint.one, joint.other)):
                parts.append(
                    f'<link name="{name}_{number}"/><joint name="{name}_at_{number}" type="fixed">'
                    f'<parent link="{end}"/><child link="{name}_{number}"/>'
                    f"{origin(joint.place, frames[end])}</joint>"
                )
            continue
        axis = " ".join(str(int(letter == joint.axis)) for letter in "XYZ")
        kind = {"ball": "continuous"}.get(joint.kind, joint.kind)
        balls += [name] * (joint.kind == "ball")
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{joint.one}"/><child link="{joint.other}"/>'
            f'{origin(joint.place, frames[joint.one])}<axis xyz="{axis}"/>'
            '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        )
    sidecar = {
        "closed_loop": closures,
        "type": ["3d"] * len(closures),
        "name_mot": [name for name, joint in joints.items() if joint.drive is not None],
        "joint_name": balls,
        "joint_type": ["SPHERICAL"] * len(balls),
    }
    return load_robot(f"<robot name='robot'>{''.join(parts)}</robot>", sidecar)


def saved(stage, tmp_path, name="robot.usda"):
    path = tmp_path / name
    stage.GetRootLayer().Export(str(path))
    return path


def text_of(stage):
    return stage.GetRootLayer().ExportToString()


def same(robot, known, seed=0):
    """Assert the same accelerations for the same forces, in states with closed loops."""
    generator = np.random.default_rng(seed)
    assert list(robot.model.names) == list(known.model.names)
    assert robot.actuated == known.actuated
    np.testing.assert_allclose(robot.model.gravity.linear, known.model.gravity.linear, rtol=1e-15)
    q = known.assemble().q
    np.testing.assert_allclose(robot.assemble().q, q, rtol=0, atol=1e-12)
    for _ in range(4):
        J = known.closure_jacobian(q)
        free = np.linalg.svd(J)[2][known.rank(q) :].T
        assert robot.mobility(q) == free.shape[1]
        v = free @ generator.normal(size=free.shape[1])
        tau = 10 * generator.normal(size=len(known.actuated))
        one, other = (each.forward_dynamics(q, v, tau).a for each in (robot, known))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-10 * np.abs(other).max())
        q = known.assemble(None, guess=pin.integrate(known.model, q, 0.1 * v / np.abs(v).max())).q


@pytest.mark.parametrize(("metre", "kilogram"), [(1.0, 1.0), (2.0**-7, 0.25)])
@pytest.mark.parametrize("name", ["four_bar", "stewart"])
def test_a_robot_of_the_library_is_that_of_the_urdf(tmp_path, name, metre, kilogram):
    robot = FOUR_BAR if name == "four_bar" else stewart()
    path = saved(stage_of(robot, metre, kilogram), tmp_path)
    found = load_robot(path)
    kinds = [closure.kind for closure in found.sidecar.closures]
    assert kinds == (["hinge"] if name == "four_bar" else ["3d"] * 5)
    same(found, urdf_of(robot))
    if name == "four_bar":
        low, high = (getattr(found.model, f"{end}PositionLimit") for end in ("lower", "upper"))
        np.testing.assert_allclose([low[0], high[0]], [-np.pi / 2, np.pi], rtol=1e-15)
        assert np.isinf(low[1:]).all()
        np.testing.assert_allclose(found.model.upperEffortLimit[0], 8.0, rtol=1e-15)


def test_the_machine_is_that_of_its_urdf():
    """Numbers of the file are in single precision."""
    robot, known = (load_robot(ROOT / f"urdf/p3dof.{ending}") for ending in ("usda", "urdf"))
    assert (robot.actuated, robot.model.nv) == (known.actuated, known.model.nv)
    order = [list(robot.model.names).index(name) - 1 for name in list(known.model.names)[1:]]
    q, v = known.assemble().q, np.zeros(known.model.nv)
    assert robot.mobility(robot.assemble().q) == known.mobility(q) == 3
    zeros = np.zeros(known.model.nv)
    known.model.gravity.linear = robot.model.gravity.linear
    theirs = known.inverse_dynamics(q, v, zeros).tau
    ours = robot.inverse_dynamics(robot.assemble().q, zeros, zeros).tau
    assert sorted(order) == list(range(known.model.nv))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())


def test_gravity_is_along_the_up_axis_or_as_the_scene_says(tmp_path):
    stage = stage_of(FOUR_BAR, metre=0.5, up="Y")
    path = saved(stage, tmp_path)
    assert load_robot(path).model.gravity.linear.tolist() == [0, -9.81, 0]
    scene = UsdPhysics.Scene(stage.GetPrimAtPath("/scene"))
    scene.CreateGravityDirectionAttr(Gf.Vec3f(3, 0, 4))
    scene.CreateGravityMagnitudeAttr(5.0)
    path = saved(stage, tmp_path, "other.usda")
    np.testing.assert_allclose(load_robot(path).model.gravity.linear, [1.5, 0, 2], rtol=1e-15)


def test_what_is_displaced_counts_from_where_the_bodies_are(tmp_path):
    """A crank that is drawn at half a radian: limits and zero count from there. Frames have to meet."""
    bodies, joints = FOUR_BAR
    stage = stage_of((bodies, joints))
    joint = UsdPhysics.Joint(stage.GetPrimAtPath("/robot/crank_joint"))
    place = joints["crank_joint"].place.rotation @ pin.utils.rotate(joints["crank_joint"].axis.lower(), -0.5)
    w, x, y, z = pin.Quaternion(place).coeffs()[[3, 0, 1, 2]]
    joint.GetLocalRot0Attr().Set(Gf.Quatf(w, x, y, z))
    found = load_robot(saved(stage, tmp_path))
    np.testing.assert_allclose(found.model.lowerPositionLimit[0], -np.pi / 2 - 0.5, rtol=0, atol=1e-6)
    same(found, urdf_of(FOUR_BAR))
    joint.GetLocalPos0Attr().Set(Gf.Vec3f(0, 0.01, 0))
    with pytest.raises(
        ModelError, match=r"/robot/crank_joint: its frames are 0\.01 m and 3e-08 rad apart|0\.01 m"
    ):
        load_robot(saved(stage, tmp_path, "apart.usda"))


def test_backward_joints_static_bodies_and_floating_ones(tmp_path):
    """A world that is the second body, a kinematic body for a ground, and no ground at all."""
    bodies, joints = FOUR_BAR
    backward = replace(joints["rocker_joint"], one="rocker", other="world")
    robot = load_robot(saved(stage_of((bodies, joints | {"rocker_joint": backward})), tmp_path, "back.usda"))
    known = urdf_of(FOUR_BAR)
    q = robot.assemble({"crank_joint": 0.25}).q
    expected = known.assemble({"crank_joint": 0.25}).q
    np.testing.assert_allclose(q, expected * [1, 1, -1], rtol=0, atol=1e-12)
    ground = {"ground": Body(placed((0.5, 0.25, 0), 3))}
    held = {name: replace(one, one="ground") if one.one == "world" else one for name, one in joints.items()}
    stage = stage_of((ground | bodies, held))
    floating = load_robot(saved(stage, tmp_path, "floating.usda"))
    assert (floating.model.nv, floating.mobility(floating.assemble().q)) == (9, 7)
    UsdPhysics.RigidBodyAPI(stage.GetPrimAtPath("/robot/ground")).CreateKinematicEnabledAttr(True)
    same(load_robot(saved(stage, tmp_path, "static.usda")), known)
    stage.GetPrimAtPath("/robot/ground").RemoveAPI(UsdPhysics.RigidBodyAPI)
    same(load_robot(saved(stage, tmp_path, "none.usda")), known)


def test_rods_and_generic_joints(tmp_path):
    bodies, joints = FOUR_BAR
    stage = stage_of((bodies, {name: one for name, one in joints.items() if name != "closing"}))
    rod = UsdPhysics.DistanceJoint.Define(stage, "/robot/rod")
    rod.CreateBody0Rel().SetTargets(["/robot/coupler"])
    rod.CreateBody1Rel().SetTargets(["/robot/rocker"])
    for name, place, attribute in (
        ("coupler", placed((0.5, 0, 0.25)), rod.CreateLocalPos0Attr),
        ("rocker", placed((0.5, 0, 0.375)), rod.CreateLocalPos1Attr),
    ):
        attribute(Gf.Vec3f(*bodies[name].place.actInv(place).translation))
    rod.CreateMinDistanceAttr(0.125)
    rod.CreateMaxDistanceAttr(0.125)
    robot = load_robot(saved(stage, tmp_path, "rod.usda"))
    (closure,) = robot.sidecar.closures
    assert (closure.kind, closure.length) == ("distance", 0.125)
    assert np.abs(robot.closure_error(pin.neutral(robot.model))).max() < 1e-15
    rod.CreateMaxDistanceAttr(0.25)
    path = saved(stage, tmp_path, "slack.usda")
    with pytest.raises(
        ModelError, match=r"expected a minDistance that is the maxDistance, got 0\.125 and 0\.25 m"
    ):
        load_robot(path)
    assert load_robot(path, on_unknown="ignore").sidecar.closures == ()
    stage = stage_of(FOUR_BAR)
    generic = stage.GetPrimAtPath("/robot/elbow")
    generic.SetTypeName("PhysicsJoint")
    for name in ("transX", "transY", "transZ", "rotX", "rotZ"):
        limit = UsdPhysics.LimitAPI.Apply(generic, name)
        limit.CreateLowAttr(1.0)
        limit.CreateHighAttr(-1.0)
    same(load_robot(saved(stage, tmp_path, "generic.usda")), urdf_of(FOUR_BAR))
    generic.RemoveAPI(UsdPhysics.LimitAPI, "rotZ")
    with pytest.raises(
        ModelError, match="/robot/elbow: a PhysicsJoint that is free in rotY, rotZ is not under"
    ):
        load_robot(saved(stage, tmp_path, "universal.usda"))


def changed(old, new, text):
    assert old in text
    return text.replace(old, new, 1)


WRONG = {
    "/robot/crank: expected a positive mass and diag": ("float physics:mass = 2", "float physics:mass = 0"),
    "mass: expected finite numbers, got nan": ("float physics:mass = 2", "float physics:mass = nan"),
    "body1: /robot/none does not exist": ("physics:body1 = </robot/crank>", "physics:body1 = </robot/none>"),
    "expected positive metersPerUnit": ("metersPerUnit = 1", "metersPerUnit = -1"),
    "it joins no two bodies that move": ("rel physics:body1 = </robot/crank>", ""),
    "localRot0: expected a quaternion of length 1": ("localRot0 = (0.5", "localRot0 = (0.25"),
    "/robot/closing: Physx.*MimicJointAPI:rotX may hold": (
        'def PhysicsRevoluteJoint "closing"',
        'def PhysicsRevoluteJoint "closing" (prepend apiSchemas = ["PhysxMimicJointAPI:rotX"])',
    ),
    "/robot/closing: PhysxPhysicsGearJoint, physics:body0, .* may hold": (
        'def PhysicsRevoluteJoint "closing"',
        'def PhysxPhysicsGearJoint "closing"',
    ),
    "/robot/closing: physics:body0, physics:body1 may hold bodies": (
        'def PhysicsRevoluteJoint "closing"',
        'def Belt "closing"',
    ),
    "/robot/crank_joint: physics:bod0 may h": ("body1 = </robot/crank>", "bod0 = </robot/crank>"),
    "as SDF, line .*expected lower <= upper": ("lowerLimit = -90", "lowerLimit = 900"),
}


@pytest.mark.parametrize(("words", "change"), WRONG.items())
def test_what_is_wrong_is_one_clear_error(tmp_path, words, change):
    text = changed(*change, text_of(stage_of(FOUR_BAR)))
    (tmp_path / "robot.usda").write_text(text, encoding="utf-8")
    with pytest.raises(ModelError, match=words) as caught:
        load_robot(tmp_path / "robot.usda")
    assert str(caught.value).isprintable()
    if "may hold" in words:
        robot = load_robot(tmp_path / "robot.usda", on_unknown="ignore")
        assert len(robot.sidecar.closures) == ("Mimic" in words)


def test_what_shapes_would_weigh_is_not_guessed(tmp_path):
    stage = stage_of(FOUR_BAR)
    stage.GetPrimAtPath("/robot/crank").RemoveProperty("physics:centerOfMass")
    lever = load_robot(saved(stage, tmp_path)).model.inertias[1].lever
    turn = placed((0, 0, 0), 1).rotation  # of the joint, below the body's own place
    np.testing.assert_allclose(turn @ lever, [0, 0, 0.125], rtol=0, atol=1e-15)
    UsdPhysics.CollisionAPI.Apply(UsdGeom.Cube.Define(stage, "/robot/crank/cube").GetPrim())
    with pytest.raises(ModelError, match="/robot/crank: expected a centerOfMass: that of shapes is not comp"):
        load_robot(saved(stage, tmp_path, "shapes.usda"))


def test_what_is_not_understood_is_named_in_one_warning(tmp_path):
    stage = stage_of(FOUR_BAR)
    stage.DefinePrim("/robot/fluid", "PhysxParticleSystem")
    prim = stage.GetPrimAtPath("/robot/elbow")
    prim.CreateAttribute("physxJoint:armature", Sdf.ValueTypeNames.Float).Set(0.5)
    with pytest.warns(
        ModelWarning, match="left out: .*armature .*elbow.*PhysxParticleSystem .*fluid"
    ) as told:
        robot = load_robot(saved(stage, tmp_path))
    assert len(told) == 1
    assert told[0].filename == __file__
    same(robot, urdf_of(FOUR_BAR))
    load_robot(saved(stage, tmp_path), on_unknown="ignore")  # warnings are errors here


def test_files_that_are_composed_are_below_the_folder(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    saved(stage_of(FOUR_BAR), tmp_path, "secret.usda")
    for place, name in ((tmp_path, "../secret.usda"), (inner, "part.usda")):
        saved(stage_of(FOUR_BAR), inner, "part.usda")
        outer = (
            f'#usda 1.0\n(defaultPrim = "robot"\nupAxis = "Z"\nmetersPerUnit = 1\nsubLayers = [@{name}@])\n'
        )
        (inner / "robot.usda").write_text(outer, encoding="utf-8")
        if place == inner:
            same(load_robot(inner / "robot.usda"), urdf_of(FOUR_BAR))
            continue
        with pytest.raises(ModelError, match=r"'\.\./secret\.usda' is no file below the folder of the first"):
            load_robot(inner / "robot.usda")
        same(load_robot(inner / "robot.usda", include_root=tmp_path), urdf_of(FOUR_BAR))


@pytest.mark.parametrize(
    "text", ["", "#usda 1.0\n", "#usda 1.0\ndef {", "PXR-USDC" + "\0" * 100, "<robot/>", "\0"]
)
def test_what_is_no_usd_is_one_error(tmp_path, text, capfd):
    for ending in ("usda", "usd", "usdc"):
        path = tmp_path / f"robot.{ending}"
        path.write_text(text, encoding="utf-8")
        with pytest.raises((FileError, ModelError)) as caught:
            load_robot(path)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 1000
    assert capfd.readouterr().err == ""


def test_damaged_files_are_one_error_or_the_robot(tmp_path, capfd):
    text = text_of(stage_of(FOUR_BAR)).encode()
    draw, path, told = random.Random(1), tmp_path / "robot.usda", []  # noqa: S311 - damages
    for _ in range(100):
        path.write_bytes(damaged(text, "text", draw))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            try:
                load_robot(path)
            except p3dof.P3dofError as error:
                told.append(str(error))
    assert 20 < len(told) < 100
    assert [words for words in told if not words.isprintable() or len(words) > 1000] == []
    assert capfd.readouterr().err == ""


def test_a_binary_file_is_told_how_to_be_text(tmp_path):
    """For the library ends the process in some that are damaged."""
    for name in ("robot.usdc", "robot.usd"):
        path = saved(stage_of(FOUR_BAR), tmp_path, name)
        with pytest.raises(FileError, match=r"expected USD as text \(#usda \.\.\.\): usdcat"):
            load_robot(path)


def test_what_does_not_fit_is_refused(tmp_path, monkeypatch):
    path = saved(stage_of(FOUR_BAR), tmp_path)
    for options, words in (
        ({"srdf_file": path}, "srdf_file: a USD file has no states with names"),
        ({"reference": "home"}, "reference: a USD file has no states with names"),
        ({"bushings": "closures"}, "bushings: only a URDF has such closures"),
    ):
        with pytest.raises(InputError, match=words):
            load_robot(path, **options)
    with pytest.raises(FileError, match="cannot be read"):
        load_robot(tmp_path / "none.usda")
    monkeypatch.setitem(__import__("sys").modules, "pxr", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'p3dof\[usd\]'"):
        load_robot(path)
