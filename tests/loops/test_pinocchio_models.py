"""Trees and constraint models that were made with Pinocchio's own calls."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import p3dof
from p3dof import ClosedLoopModel, Closure, Coupling, Sidecar
from p3dof._base.errors import InputError, ModelError

HERE = pin.SE3.Identity()


def along(x, y=0.0, z=0.0):
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def body(model, joint, mass, length):
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(mass, 0.05), along(length / 2))


def four_bar():
    """A crank, a coupler and a rocker, all turning about y; joints 1, 2 and 3."""
    model = pin.Model()
    crank = model.addJoint(0, pin.JointModelRY(), HERE, "crank")
    coupler = model.addJoint(crank, pin.JointModelRY(), along(0.2), "coupler")
    rocker = model.addJoint(0, pin.JointModelRY(), along(0.4), "rocker")
    for joint, mass, length in ((crank, 1.0, 0.2), (coupler, 2.0, 0.5), (rocker, 1.5, 0.4)):
        body(model, joint, mass, length)
    return model


REFERENCE = {"crank": -1.2, "coupler": 1.0, "rocker": -1.4}
ENDS = (2, along(0.5), 3, along(0.4))


def constraints(model):
    point = pin.PointAnchorConstraintModel(model, *ENDS)
    rigid = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ENDS)
    held = pin.StdVec_ConstraintModel()
    held.append(pin.ConstraintModel(point))
    rigids = pin.StdVec_RigidConstraintModel()
    rigids.append(rigid)
    return {"anchor": [point], "rigid": [rigid], "held": held, "rigids": rigids}


def forces(robot):
    state = robot.complete([-1.0], [2.0], [3.0])
    return robot.inverse_dynamics(state.q, state.v, state.a)


@pytest.mark.parametrize("which", ["anchor", "rigid", "held", "rigids"])
def test_a_machine_is_the_one_with_named_frames(which):
    model = four_bar()
    taken = ClosedLoopModel.from_pinocchio(
        model, constraints(model)[which], actuated=["crank"], reference=REFERENCE
    )
    assert model.nframes == 1  # the caller's own is as it was
    named = four_bar()
    for joint in (1, 2, 3):
        named.addJointFrame(joint)
    for name, joint, place in (("tip", 2, along(0.5)), ("end", 3, along(0.4))):
        named.addFrame(
            pin.Frame(name, joint, named.getFrameId(named.names[joint]), place, pin.FrameType.OP_FRAME)
        )
    other = ClosedLoopModel(named, Sidecar((Closure("tip", "end"),), ("crank",), reference=REFERENCE))
    mine, theirs = forces(taken), forces(other)
    np.testing.assert_allclose(mine.tau, theirs.tau, rtol=1e-13)
    np.testing.assert_allclose(mine.lambda_, theirs.lambda_, rtol=1e-12, atol=1e-12)
    assert mine.mobility == 1


def test_forces_are_those_of_pinocchio_s_constrained_dynamics():
    model = four_bar()
    rigid = constraints(model)["rigids"]
    robot = ClosedLoopModel.from_pinocchio(model, rigid, actuated=["crank"], reference=REFERENCE)
    state = robot.complete([-1.0], [2.0], [3.0])
    tau = np.zeros(3)
    tau[0] = robot.inverse_dynamics(state.q, state.v, state.a).tau[0]
    data, datas = model.createData(), pin.StdVec_RigidConstraintData()
    datas.append(rigid[0].createData())
    pin.initConstraintDynamics(model, data, rigid, datas)
    settings = pin.ProximalSettings(1e-12, 1e-12, 1e-10, 50)
    a = pin.constraintDynamics(model, data, state.q, state.v, tau, rigid, datas, settings)
    np.testing.assert_allclose(a, state.a, rtol=1e-8, atol=1e-8)


def test_a_frame_on_the_ground_holds_a_floating_body():
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), HERE, "base")
    body(model, base, 3.0, 0.2)
    foot = pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, base, along(0.1), 0, along(0.1))
    foot.name = "base"  # a name that a frame has already
    robot = ClosedLoopModel.from_pinocchio(model, [foot])
    assert robot.actuated == ()
    assert robot.sidecar.closures[0].kind == "6d"
    q = robot.assemble().q
    zero = np.zeros(6)
    assert robot.inverse_dynamics(q, zero, zero).lambda_[2] == pytest.approx(-3.0 * 9.81)


def test_couplings_and_what_is_actuated():
    gear = Coupling("rocker", "crank", (0.0, 2.0))
    robot = ClosedLoopModel.from_pinocchio(four_bar(), couplings=[gear])
    assert robot.actuated == ("crank", "coupler")


def test_a_wrapper_is_taken_for_its_model():
    assert ClosedLoopModel.from_pinocchio(SimpleNamespace(model=four_bar())).model.nv == 3


def refused(change):
    model = four_bar()
    anchor = constraints(model)["anchor"][0]
    rigid = constraints(model)["rigid"][0]
    return {
        "offset": lambda: setattr(anchor, "desired_constraint_offset", np.array([0.1, 0, 0])) or [anchor],
        "placement": lambda: setattr(rigid, "desired_contact_placement", along(0.1)) or [rigid],
        "velocity": lambda: setattr(anchor, "desired_constraint_velocity", np.ones(3)) or [anchor],
        "friction": lambda: [pin.JointFrictionConstraintModel(model, [1])],
        "a number": lambda: [3],
    }[change](), model


@pytest.mark.parametrize("change", ["offset", "placement", "velocity", "friction", "a number"])
def test_constraints_that_mean_something_else_are_refused(change):
    wrong, model = refused(change)
    with pytest.raises(ModelError, match=r"^constraint 1: "):
        ClosedLoopModel.from_pinocchio(model, wrong)


def test_a_constraint_of_another_model_is_refused():
    model = four_bar()
    small = pin.Model()
    body(small, small.addJoint(0, pin.JointModelRY(), HERE, "one"), 1.0, 1.0)
    with pytest.raises(ModelError, match="joint1_id is 2, the model has 2 joints"):
        ClosedLoopModel.from_pinocchio(small, constraints(model)["anchor"])


@pytest.mark.parametrize("wrong", [None, "robot.urdf", 3])
def test_what_is_no_model_is_refused(wrong):
    with pytest.raises(InputError, match=r"^model: expected a pinocchio"):
        ClosedLoopModel.from_pinocchio(wrong)


@pytest.mark.parametrize("wrong", [3, "all", {"a": 1}])
def test_what_is_no_list_of_constraints_is_refused(wrong):
    with pytest.raises(InputError, match=r"^constraint_models: expected"):
        ClosedLoopModel.from_pinocchio(four_bar(), wrong)


def test_a_model_for_load_robot_says_where_it_goes():
    with pytest.raises(ModelError, match="from_pinocchio"):
        p3dof.load_robot(four_bar())


def out_of_order():
    """Two arms; the hand of the first is added behind the second."""
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRY(), HERE, "first")
    second = model.addJoint(0, pin.JointModelRY(), HERE, "second")
    hand = model.addJoint(first, pin.JointModelRY(), along(0.3), "hand")
    for joint in (first, second, hand):
        body(model, joint, 1.0, 0.3)
    return model


def test_a_tree_that_pinocchio_computes_wrongly_is_refused():
    model = out_of_order()
    data, q = model.createData(), np.array([0.3, -0.2, 0.5])
    mass = np.triu(pin.crba(model, data, q))
    by_rnea = [pin.rnea(model, data, q, 0 * q, e) - pin.rnea(model, data, q, 0 * q, 0 * q) for e in np.eye(3)]
    assert np.abs(mass - np.triu(np.array(by_rnea))).max() > 1e-3  # why it is refused
    with pytest.raises(ModelError, match="'hand' is not depth first: add it right behind 'first'"):
        ClosedLoopModel.from_pinocchio(model)
    with pytest.raises(ModelError, match="depth first"):
        ClosedLoopModel(model, Sidecar((), ("first",)))


MIMIC = """<robot name="two"><link name="a"/>
  <link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <link name="c"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="k" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="j" multiplier="2"/></joint></robot>"""


def test_a_tree_with_pinocchio_s_mimic_joints_is_refused():
    model = pin.buildModelFromXML(MIMIC, mimic=True)
    with pytest.raises(ModelError, match="'k' mimics another one"):
        ClosedLoopModel(model, Sidecar((), ("j",)))


def test_a_macro_file_is_refused():
    text = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="b"/></robot>'
    with pytest.raises(ModelError, match=r"<xacro:include> is a macro: name the file robot\.urdf\.xacro, or"):
        p3dof.load_robot(text)


def test_a_sidecar_in_the_place_of_the_robot_is_told(tmp_path):
    (tmp_path / "robot.yaml").write_text("closed_loop: [[a, b]]\n")
    with pytest.raises(ModelError, match="this is not XML; a sidecar comes second"):
        p3dof.load_robot(tmp_path / "robot.yaml")
