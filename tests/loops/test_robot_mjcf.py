"""MJCF: the tree, its constraints and its data are those of MuJoCo's own compiler."""

import sys

import numpy as np
import pinocchio as pin
import pytest

mujoco = pytest.importorskip("mujoco")

from p3dof._base.errors import InputError, MissingExtraError, ModelError  # noqa: E402
from p3dof.loops.formats import mjcf, mjcf_file  # noqa: E402
from p3dof.loops.robots import load_robot  # noqa: E402

RICH = """
<mujoco model="rich">
  <compiler angle="degree"/>
  <option gravity="0.3 0.1 -9"/>
  <default><joint armature="0.3" damping="0.2"/><default class="k"><joint armature="0.7"/></default></default>
  <asset>
    <texture name="paint" type="2d" file="missing.png"/><material name="shiny" texture="paint"/>
    <mesh name="shell" file="missing.stl"/>
  </asset>
  <worldbody>
    <geom type="plane" size="1 1 1" material="shiny"/>
    <body name="a" pos="0.1 0.2 0.3" euler="10 20 30">
      <joint name="j1" axis="0 1 0" pos="0.1 0 0.2" ref="20"/>
      <joint name="j2" axis="1 0.5 0" class="k" range="-60 60" pos="0 0.3 0"/>
      <inertial pos="0.1 0.2 0" mass="1" fullinertia="1 1.1 1.2 0.1 0.05 0.02"/>
      <geom type="mesh" mesh="shell"/>
      <body name="b" pos="0 0 1">
        <joint name="j3" type="slide" axis="0 0.3 1" frictionloss="0.5" ref="0.1"/>
        <geom type="sphere" size="0.1" mass="2"/>
        <body name="f" pos="0.1 0 0" quat="0.5 0.5 0.5 0.5">
          <geom type="capsule" size="0.1 0.2"/><site name="tip" pos="0 0 0.2" euler="0 0 90"/>
        </body>
      </body>
    </body>
    <body name="c" pos="3 0 0">
      <freejoint name="float"/><geom type="box" size=".1 .2 .3"/>
      <body name="d" pos="0 1 0">
        <joint name="ball" type="ball" pos="0.1 0 0"/><geom type="ellipsoid" size=".1 .2 .3" pos="0.3 0 0"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="j1" joint2="j3" polycoef="0.1 2 0.3 -0.2 0.1"/>
    <connect name="pin" body1="a" body2="c" anchor="0 0 0.1"/>
    <weld body1="b" body2="d" active="false"/>
    <weld body1="b" body2="d" anchor="0.1 0.2 0.3" relpose="0.1 0.1 0.3 0.5 0.5 0.5 0.5"/>
    <joint joint1="j2" polycoef="0.2"/>
  </equality>
  <keyframe>
    <key name="home" qpos="0.1 0.2 0.3  0 0 0 1 0 0 0  1 0 0 0"/>
    <key name="away" qpos="0.4 0.5 0.6  1 2 3 0.5 0.5 -0.5 0.5  0.6 0.8 0 0"/>
  </keyframe>
  <actuator><motor name="m" joint="j1" gear="3"/><position joint="j3"/></actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def rich():
    """Return the tree and its sidecar, MuJoCo's own model, and a state of both."""
    model, sidecar = mjcf.read(RICH)
    compiled = mjcf_file.compiled(RICH)
    data = mujoco.MjData(compiled)
    q = np.random.default_rng(1).normal(size=compiled.nq)
    for start in (6, 10):
        q[start : start + 4] /= np.linalg.norm(q[start : start + 4])
    data.qpos[:] = q
    mujoco.mj_forward(compiled, data)
    ours = np.concatenate([q[:6], q[7:10], q[6:7], q[11:14], q[10:11]])  # quaternions end with their scalar
    return model, sidecar, compiled, data, ours


def test_bodies_and_sites_are_where_mujoco_has_them(rich):
    model, _, compiled, data, q = rich
    places = model.createData()
    pin.framesForwardKinematics(model, places, q)
    found = [("abfcd", data.body), (["tip"], data.site)]
    for names, theirs in found:
        for name in names:
            frame = places.oMf[model.getFrameId(name)]
            np.testing.assert_allclose(frame.translation, theirs(name).xpos, rtol=0, atol=1e-14)
            np.testing.assert_allclose(frame.rotation.ravel(), theirs(name).xmat, rtol=0, atol=1e-14)
    assert compiled.nbody == 6


def test_mass_matrix_and_gravity_are_mujocos(rich):
    model, _, compiled, data, q = rich
    nv = compiled.nv
    theirs = np.zeros((nv, nv))
    for column, unit in enumerate(np.eye(nv)):
        mujoco.mj_mulM(compiled, data, theirs[column], unit)
    work = model.createData()
    pin.forwardKinematics(model, work, q)
    M = pin.crba(model, work, q)
    M = np.triu(M) + np.triu(M, 1).T
    turn = np.eye(nv)  # MuJoCo has the linear velocity of a floating base in the axes of the world
    turn[3:6, 3:6] = work.oMi[model.getJointId("float")].rotation
    np.testing.assert_allclose(M, turn.T @ theirs @ turn, rtol=0, atol=1e-12 * np.abs(M).max())
    gravity = pin.computeGeneralizedGravity(model, work, q)
    np.testing.assert_allclose(gravity, turn.T @ data.qfrc_bias, rtol=0, atol=1e-12 * np.abs(gravity).max())


def test_constraints_are_mujocos_and_only_the_active_ones(rich):
    model, sidecar, _, data, q = rich
    assert [closure.kind for closure in sidecar.closures] == ["3d", "6d"]
    assert sidecar.closures[0].frame1 == "pin_1"
    places = model.createData()
    pin.framesForwardKinematics(model, places, q)
    opened = []
    for closure in sidecar.closures:
        one, two = (places.oMf[model.getFrameId(name)] for name in (closure.frame1, closure.frame2))
        opened.append(one.translation - two.translation)
    theirs = data.efc_pos[: data.nefc]  # in the order of the file: joint 1, connect 3, weld 6, joint 1
    np.testing.assert_allclose(opened[0], theirs[1:4], rtol=0, atol=1e-14)
    np.testing.assert_allclose(opened[1], theirs[4:7], rtol=0, atol=1e-14)
    values = dict(zip(("j1", "j2", "j3"), q[:3], strict=True))
    left = []
    for coupling in sidecar.couplings:
        on = 0.0 if coupling.on is None else values[coupling.on]
        left.append(values[coupling.joint] - np.polynomial.polynomial.polyval(on, coupling.coefficients))
    np.testing.assert_allclose(left, theirs[[0, 10]], rtol=0, atol=1e-13)


def test_data_of_the_joints_are_read(rich):
    model, sidecar, *_ = rich
    np.testing.assert_allclose(model.armature[:3], [0.3, 0.7, 0.3])
    np.testing.assert_allclose(model.damping[:3], 0.2)
    np.testing.assert_allclose(model.upperDryFrictionLimit[:3], [0, 0, 0.5])
    joint = model.idx_qs[model.getJointId("j2")]
    assert model.upperPositionLimit[joint] == pytest.approx(np.pi / 3)
    assert model.lowerPositionLimit[joint] == pytest.approx(-np.pi / 3)
    assert sidecar.actuated == ("j1", "j3")


def test_keyframes_are_reference_configurations(rich):
    sidecar = rich[1]
    assert sidecar.reference["j1"] == 0.1
    assert sidecar.reference["float"] == (0, 0, 0, 0, 0, 0, 1)
    away = mjcf.read(RICH, "away")[1].reference
    assert away["float"] == (1, 2, 3, 0.5, -0.5, 0.5, 0.5)
    assert away["ball"] == pytest.approx((0.8, 0, 0, 0.6))
    with pytest.raises(ModelError, match="keyframe 'hme' does not exist; did you mean 'home'"):
        mjcf.read(RICH, "hme")


def test_without_a_keyframe_the_reference_is_where_the_file_draws_the_robot():
    """At MuJoCo's `qpos0` the loops of a file close, and few files have it at zero."""
    sphere = '<geom type="sphere" size="0.1"/>'
    xml = f"""<mujoco><worldbody>
      <body pos="0 0 0.5"><joint name="turn" axis="0 1 0" ref="80"/>{sphere}
        <body name="arm" pos="0.3 0 0"><joint name="elbow" axis="0 1 0" ref="-70"/>{sphere}</body></body>
      <body name="plate" pos="0.1 0.2 -0.6" euler="0 0 90"><freejoint name="float"/>{sphere}</body>
    </worldbody><equality><connect body1="arm" body2="plate" anchor="0.2 0 0"/></equality></mujoco>"""
    robot, drawn = load_robot(xml), mujoco.MjModel.from_xml_string(xml).qpos0
    expected = [drawn[0], drawn[1], *drawn[2:5], *drawn[6:9], drawn[5]]
    np.testing.assert_allclose(robot.reference, expected, rtol=0, atol=1e-15)
    np.testing.assert_allclose(robot.closure_error(robot.reference), 0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(robot.assemble().q, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("flag", ["", "spring", "damper", "frictionloss", "limit", "equality", "constraint"])
def test_what_the_flags_of_the_file_disable_does_not_act(flag):
    """The passive forces, limits and equalities are those that MuJoCo itself has left."""
    traits = 'stiffness="5" springref="0.3" damping="0.7" frictionloss="0.4" range="-1 1"'
    sphere = '<geom type="sphere" size="0.1"/>'
    xml = f"""<mujoco><compiler angle="radian"/>
      <option>{flag and f'<flag {flag}="disable"/>'}</option><worldbody>
      <body><joint name="one" axis="0 1 0" {traits}/>{sphere}</body>
      <body><joint name="two" axis="0 1 0"/>{sphere}</body></worldbody>
      <equality><joint joint1="two" joint2="one"/></equality></mujoco>"""
    model, sidecar = mjcf.read(xml)
    theirs = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(theirs)
    data.qpos[:], data.qvel[:] = (1.2, 0.0), (0.5, 0.0)
    mujoco.mj_forward(theirs, data)
    one = next(data for data in sidecar.joint_data if data.joint == "one")
    assert one.stiffness * (one.rest - 1.2) - one.damping * 0.5 == pytest.approx(
        data.qfrc_passive[0], abs=1e-15
    )
    kinds, rows = mujoco.mjtConstraint, list(data.efc_type[: data.nefc])
    assert (one.friction > 0) == (kinds.mjCNSTR_FRICTION_DOF in rows)
    assert (model.upperPositionLimit[0] == 1) == (kinds.mjCNSTR_LIMIT_JOINT in rows)
    assert bool(sidecar.couplings) == (kinds.mjCNSTR_EQUALITY in rows)


def test_equalities_of_sites_tie_the_sites():
    sites = '<site name="one"/>', '<site name="two" pos="0 0 1"/>'
    bodies = "".join(
        f'<body><joint axis="0 1 0"/><geom type="sphere" size="0.1"/>{site}</body>' for site in sites
    )
    tie = '<equality><{} site1="one" site2="two"/></equality>'
    xml = f"<mujoco><worldbody>{bodies}</worldbody>{tie}</mujoco>"
    for tag, kind in (("connect", "3d"), ("weld", "6d")):
        (closure,) = mjcf.read(xml.format(tag))[1].closures
        assert (closure.frame1, closure.frame2, closure.kind) == ("one", "two", kind)


def test_without_actuators_every_joint_of_one_freedom_is_actuated():
    body = '<body name="{0}"><joint name="{0}" axis="0 1 0"/><geom type="sphere" size="0.1"/></body>'
    loaded = load_robot(f"<mujoco><worldbody>{body.format('x')}{body.format('y')}</worldbody></mujoco>")
    assert loaded.actuated == ("x", "y")


BODY = '<body name="x"><joint name="x" axis="0 1 0"/>{}</body>'
BALL = '<geom type="sphere" size="0.1"/>'
TENDON = '<tendon><fixed name="t"><joint joint="x" coef="1"/></fixed></tendon>'


def test_a_tendon_over_one_joint_pulls_at_this_joint():
    xml = (
        f"<mujoco><worldbody>{BODY.format(BALL)}</worldbody>{TENDON}"
        '<actuator><motor name="pull" tendon="t"/></actuator></mujoco>'
    )
    loaded = load_robot(xml)
    assert loaded.actuated == ("x",)
    assert loaded.model.nv == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (BODY.format(""), "MuJoCo cannot compile it"),
        (BODY.format('<geom type="mesh" mesh="m"/>'), "MuJoCo cannot compile it"),
        (
            "</worldbody><equality><connect body1='x' body2='y' anchor='0 0 0'/></equality><worldbody>",
            "MuJoCo",
        ),
        (
            "<site name='a'/><site name='b' pos='0 0 1'/><site name='c' pos='0 1 1'/>"
            f"{BODY.format(BALL)}</worldbody><tendon><spatial name='t'><site site='a'/><site site='b'/>"
            "<site site='c'/></spatial></tendon><equality><tendon tendon1='t'/></equality><worldbody>",
            "the equality 'equality_0' ties tendons that are neither fixed nor, one alone, straight",
        ),
        ("</worldbody><include file='../../etc/passwd'/><worldbody>", "<include> needs the files beside it"),
        ("<body name='a'>" * 120 + "</body>" * 120, "nested at most 100 deep"),
        ("<unknown/>", "MuJoCo cannot compile it"),
        (
            '<body name="x"><joint name="x" axis="-1e308 0 1" armature="1"/><geom size="0.1"/></body>',
            "joint 'x': expected an axis",
        ),
    ],
)
def test_what_cannot_be_read_is_one_clear_error(content, message):
    with pytest.raises(ModelError, match=message) as error:
        load_robot(f"<mujoco><worldbody>{content}</worldbody></mujoco>")
    assert "\n" not in str(error.value)


def test_files_are_included_from_the_folder_only(tmp_path):
    (tmp_path / "part.xml").write_text(f"<mujoco><worldbody>{BODY.format(BALL)}</worldbody></mujoco>")
    (tmp_path / "robot.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    assert load_robot(tmp_path / "robot.xml").model.nv == 1
    (tmp_path / "robot.xml").write_text('<mujoco><include file="../part.xml"/></mujoco>')
    with pytest.raises(ModelError, match=r"'../part.xml' is outside the folder of the file"):
        load_robot(tmp_path / "robot.xml")


def test_files_are_included_from_below_a_folder_that_the_user_allows(tmp_path):
    """MuJoCo looks beside the first file, then beside the one that includes."""
    own, parts = tmp_path / "robots" / "arm", tmp_path / "parts"
    for folder in (own, parts, tmp_path / "robots" / "other"):
        folder.mkdir(parents=True)
    (parts / "all.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    (parts / "part.xml").write_text(f"<mujoco><worldbody>{BODY.format(BALL)}</worldbody></mujoco>")
    (own / "robot.xml").write_text('<mujoco><include file="../../parts/all.xml"/></mujoco>')
    with pytest.raises(ModelError, match=r"outside the folder of the file \(include_root=FOLDER allows"):
        load_robot(own / "robot.xml")
    assert load_robot(own / "robot.xml", include_root=tmp_path).model.nv == 1
    with pytest.raises(ModelError, match=r"'../../parts/all.xml' is outside include_root="):
        load_robot(own / "robot.xml", include_root=tmp_path / "robots")
    (tmp_path.parent / "outside.xml").write_text("<mujoco/>")
    (parts / "all.xml").write_text('<mujoco><include file="../../outside.xml"/></mujoco>')
    with pytest.raises(ModelError, match=r"all.xml: <include>: '../../outside.xml' is outside include_root="):
        load_robot(own / "robot.xml", include_root=tmp_path)
    (parts / "all.xml").write_text("<mujoco><include")
    with pytest.raises(ModelError, match=r"all.xml, line 1: not well-formed XML"):
        load_robot(own / "robot.xml", include_root=tmp_path)
    with pytest.raises(ModelError, match="include_root: expected a folder, got"):
        load_robot(own / "robot.xml", include_root=tmp_path / "none")


def test_what_an_included_file_includes_is_held_to_the_folder_too(tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    (tmp_path / "secret.xml").write_text(f"<mujoco><worldbody>{BODY.format(BALL)}</worldbody></mujoco>")
    (own / "part.xml").write_text('<mujoco><include file="../secret.xml"/></mujoco>')
    (own / "robot.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    with pytest.raises(ModelError, match=r"part.xml: <include>: '../secret.xml' is outside the folder"):
        load_robot(own / "robot.xml")


def test_arguments_for_a_urdf_are_refused():
    with pytest.raises(InputError, match="root_joint: an MJCF file has its own"):
        load_robot(RICH, root_joint=pin.JointModelFreeFlyer())
    with pytest.raises(InputError, match="bushings: only a URDF has such closures"):
        load_robot(RICH, bushings="closures")
    with pytest.raises(InputError, match="include_root: a URDF file includes no others"):
        load_robot("<robot name='a'><link name='b'/></robot>", include_root=".")


def test_without_mujoco_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'p3dof\[mjcf\]'"):
        load_robot(RICH)
