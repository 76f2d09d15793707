"""Armature and balances of the sliders in other programs and in exported files."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
import yaml
from command_line import run
from machines import engine, off

import p3dof
from p3dof._base.errors import InputError, ModelError
from p3dof.machine import description
from p3dof.machine.parameters import PAPER, SOLIDS, Actuators
from p3dof.methods import engines

MOTION = p3dof.paper_motion(51)
ALL = Actuators(
    armature={"sliders": 14.8, "slide_b": 3.0},
    counterbalance={"slide_a": 48.0, "slide_b": -12.0},
    spring={"slide_b": 495.0, "slide_c": -423.0},
    counterweight={"slide_c": 2.5},
)
LIFTED = Actuators({"slide_a": 2.0}, {"slide_a": 40.0}, {"slide_b": 300.0}, {"slide_c": 1.5})
MACHINES = {
    "paper": replace(PAPER, actuators=ALL),
    "solids, gravity aslant": replace(SOLIDS, actuators=ALL, gravity=(0.3, -0.5, -9.0)),
    "constant forces": replace(SOLIDS, actuators=Actuators(counterbalance={"sliders": 50.0})),
    "armature": replace(PAPER, actuators=Actuators(armature={"sliders": 118.4})),
}


def expected(parameters, motion=MOTION):
    found = p3dof.load(parameters).inverse_dynamics(motion, method="virtual-power").forces
    plain = p3dof.load(replace(parameters, actuators=Actuators()))
    assert off(plain.inverse_dynamics(motion).forces, found) > 0.1
    return found


# --- second opinions ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["mujoco", "drake", "exudyn"])
@pytest.mark.parametrize("machine", MACHINES)
def test_engines_have_them(name, machine):
    parameters = MACHINES[machine]
    assert off(engine(name, parameters).forces(MOTION), expected(parameters)) < 1e-13


def test_a_comparison_asks_them():
    for module in ("mujoco", "pydrake", "exudyn"):
        pytest.importorskip(module)
    found = p3dof.load(MACHINES["paper"]).compare(MOTION, others=list(engines.ENGINES))
    assert found.agree
    for opinion in found.opinions:
        assert found.opinion_share(opinion) < 1e-12


@pytest.mark.parametrize(
    ("name", "step", "bound"), [("mujoco", 5e-4, 1e-7), ("exudyn", 1e-3, 5e-6), ("drake", 5e-4, 1e-3)]
)
def test_engines_move_with_them(name, step, bound):
    own = replace(ALL, spring={"slide_b": 495.0, "slide_c": 423.0})  # which all of them have
    machine = p3dof.load(replace(SOLIDS, actuators=own))
    pose, forces = np.array([0.02, -0.03, 0.1]), np.array([60.0, 90.0, 40.0])
    end = engine(name, machine.parameters).simulate(0.15, step, pose, forces)
    moved = machine.simulate(
        0.15, start=pose, controller=forces, stop_at=(), samples=2, method="pinocchio"
    ).pose[-1]
    joints = machine.inverse_kinematics(moved).joints
    assert max(abs(end.positions[joint] - value) for joint, value in joints.items()) < bound
    still = machine.inverse_kinematics(pose).joints
    assert max(abs(still[joint] - value) for joint, value in joints.items()) > 0.01


def test_exudyn_led_along_a_motion_has_them():
    pytest.importorskip("exudyn")
    motion = p3dof.paper_motion(1001)
    parameters = MACHINES["paper"]
    found = engines.convergence(parameters, motion, expected(parameters, motion), step=2e-3, halvings=2)
    assert found.extrapolated_error < 1e-6


def test_drake_says_that_it_cannot_move_with_a_negative_spring():
    with pytest.raises(InputError, match="drake has no springs of negative stiffness"):
        engine("drake", MACHINES["paper"]).simulate(0.1, 1e-3, np.zeros(3), np.zeros(3))


# --- files --------------------------------------------------------------------------------------------------


def joints_of(parameters, loop, motion=MOTION):
    """The motion in the joints of a model that was read."""
    moving = p3dof.closed_form.kinematics.mechanism_motion(
        parameters.geometry, motion.pose, motion.velocity, motion.acceleration
    )
    names = [str(name) for name in loop.model.names[1:]]
    return [
        np.stack([rates[name] for name in names], axis=-1)
        for rates in (moving.position, moving.velocity, moving.acceleration)
    ]


def read_back(parameters, folder, form):
    file = {"urdf": "p3dof.urdf", "mjcf": "p3dof_mjcf.xml", "drake": "p3dof_drake.urdf"}[form]
    description.write(parameters, folder, (form,))
    return folder / file, p3dof.load_robot(folder / file)


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize("actuators", [ALL, LIFTED], ids=["all", "lifted"])
def test_files_read_back_have_the_same_forces(form, actuators, tmp_path):
    if form == "mjcf":
        pytest.importorskip("mujoco")
        actuators = replace(actuators, counterbalance={"slide_a": 48.0, "slide_b": 12.0})
    parameters = replace(SOLIDS, actuators=actuators)
    _, loop = read_back(parameters, tmp_path, form)
    loop.model.gravity.linear = parameters.gravity
    tau = loop.inverse_dynamics_batch(*joints_of(parameters, loop)).tau
    assert list(loop.actuated) == ["slide_a", "slide_b", "slide_c"]
    assert off(tau, expected(parameters)) < 1e-11


def test_rotors_of_drakes_urdf_are_read_back(tmp_path):
    parameters = replace(SOLIDS, actuators=Actuators(armature={"slide_a": 14.8, "slide_c": 3.0}))
    path, loop = read_back(parameters, tmp_path, "drake")
    loop.model.gravity.linear = parameters.gravity
    assert sorted(entry.joint for entry in loop.sidecar.joint_data) == ["slide_a", "slide_c"]
    loop = p3dof.ClosedLoopModel(loop.model, replace(loop.sidecar, actuated=p3dof.machine.parameters.SLIDES))
    tau = loop.inverse_dynamics_batch(*joints_of(parameters, loop)).tau
    assert off(tau, expected(parameters)) < 1e-11
    geared = path.read_text().replace('rotor_inertia value="14.8"', 'rotor_inertia value="3.7"', 1)
    geared = geared.replace('gear_ratio value="1"', 'gear_ratio value="-2"', 1)
    again = p3dof.load_robot(geared)
    np.testing.assert_allclose(again.model.armature, loop.model.armature, rtol=1e-15)
    for bad, words in (
        ('gear_ratio value="0"', "gear_ratio: expected a number other than zero"),
        ('gear_ratio value="some"', "value: expected a finite number"),
    ):
        with pytest.raises(ModelError, match=words):
            p3dof.load_robot(geared.replace('gear_ratio value="-2"', bad))


def test_the_sidecar_holds_what_urdf_cannot():
    robot = p3dof.load(replace(PAPER, actuators=ALL))
    data = {entry["joint"]: entry for entry in yaml.safe_load(robot.sidecar)["joint_data"]}
    assert data["slide_a"] == {"joint": "slide_a", "armature": 14.8, "force": 48.0}
    assert data["slide_b"] == {"joint": "slide_b", "armature": 3.0, "force": -12.0, "stiffness": 495.0}
    assert data["slide_c"]["armature"] == pytest.approx(17.3)
    assert data["slide_c"]["force"] == pytest.approx(2.5 * 9.806)
    assert "joint_data" not in yaml.safe_load(p3dof.load().sidecar)


def test_mujoco_reads_them_from_the_file(tmp_path):
    """By its own inverse dynamics, and at rest under the controls of the keyframe."""
    mujoco = pytest.importorskip("mujoco")
    parameters = replace(SOLIDS, actuators=LIFTED)
    path, loop = read_back(parameters, tmp_path, "mjcf")
    model = mujoco.MjModel.from_xml_path(str(path))
    rates = joints_of(parameters, loop)
    data = mujoco.MjData(model)
    found = []
    for q, v, a in zip(*rates, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        J = data.efc_J.reshape(data.nefc, model.nv)[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        load = data.qfrc_inverse + data.qfrc_constraint
        free = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, 1e-9) :]
        B = np.eye(model.nv)[:, model.actuator_trnid[:, 0]]
        found.append(np.linalg.solve(free @ B, free @ load))
    assert off(np.array(found), expected(parameters)) < 1e-11
    held = p3dof.load(parameters).forces(np.zeros(3), np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(model.key("home").ctrl, held, rtol=1e-12)


def test_drake_reads_the_inertia_of_motors():
    pytest.importorskip("pydrake")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    parameters = replace(SOLIDS, actuators=Actuators(armature={"slide_a": 7.5}))
    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModelsFromString(description.texts(parameters, ["drake"])["p3dof_drake.urdf"], "urdf")
    plant.Finalize()
    for name, inertia in (("slide_a", 7.5), ("slide_b", 0.0)):
        actuator = plant.GetJointActuatorByName(f"{name}_actuator")
        assert actuator.default_rotor_inertia() * actuator.default_gear_ratio() ** 2 == inertia


def test_sdf_holds_springs_alone():
    spring = Actuators(counterbalance={"slide_a": 30.0}, spring={"slide_a": 200.0})
    text = description.texts(replace(SOLIDS, actuators=spring), ["sdf"])["p3dof.sdf"]
    model = Xml.fromstring(text)  # noqa: S314 - our own text
    dynamics = model.find(".//joint[@name='slide_a']/axis/dynamics")
    assert {item.tag: float(item.text) for item in dynamics} == {
        "spring_reference": 0.15,
        "spring_stiffness": 200.0,
    }
    assert len(model.findall(".//dynamics")) == 1


def test_usd_holds_the_inertia_of_motors_for_two_engines():
    pytest.importorskip("pxr")
    text = description.texts(MACHINES["armature"], ["usd"])["p3dof.usda"]
    assert text.count("float physxJoint:armature = 118.4") == 3
    assert text.count("float newton:armature = 118.4") == 3


@pytest.mark.parametrize(
    ("form", "own", "words"),
    [
        ("sdf", Actuators(armature={"slide_a": 1.0}), "SDF has no word for an inertia of its motor"),
        (
            "sdf",
            Actuators(counterbalance={"slide_b": 1.0}),
            "SDF has no word for a counterbalance, which slide_b has",
        ),
        ("urdf+", Actuators(armature={"slide_a": 1.0}), r"URDF\+ has no word for an inertia"),
        ("urdf+", Actuators(spring={"slide_c": 1.0}), r"URDF\+ has no word for a counterbalance, which"),
        ("drake", Actuators(counterbalance={"slide_a": 1.0}), "URDF has no word for a counterbalance"),
        ("usd", Actuators(counterweight={"slide_a": 1.0}), "USD has no word for a counterbalance"),
        (
            "mjcf",
            Actuators(counterbalance={"slide_a": -5.0}),
            "slide_a: a constant force of -5 N: MuJoCo has",
        ),
    ],
)
def test_formats_without_a_word_for_them_say_so(form, own, words, tmp_path, capsys):
    if form == "usd":
        pytest.importorskip("pxr")
    with pytest.raises(ModelError, match=words):
        description.texts(replace(SOLIDS, actuators=own), [form])
    assert description.texts(replace(SOLIDS, actuators=own), ["srdf"])  # there is nothing of dynamics in it
    p3dof.write_parameters(replace(SOLIDS, actuators=own), tmp_path / "machine.yaml")
    code, _, err = run(
        capsys, "export", "--parameters", tmp_path / "machine.yaml", "--out", tmp_path, "--format", form
    )
    assert code == 2
    assert err.count("\n") == 1


# --- any robot ----------------------------------------------------------------------------------------------


def test_any_robot_writes_them(tmp_path):
    """The files that the general layer writes of it."""
    own = Actuators({"slide_a": 2.0}, {"slide_a": 40.0}, {"slide_a": 80.0, "slide_b": -30.0}, {})
    parameters = replace(SOLIDS, actuators=own)
    _, loop = read_back(parameters, tmp_path, "urdf")
    rates = joints_of(parameters, loop)
    tau = loop.inverse_dynamics_batch(*rates).tau
    again = p3dof.load_robot(loop.write(tmp_path / "again.urdf")[0])
    np.testing.assert_allclose(again.inverse_dynamics_batch(*rates).tau, tau, rtol=0, atol=1e-10)
    pytest.importorskip("mujoco")
    other = p3dof.load_robot(loop.write(tmp_path / "other.xml")[0])
    np.testing.assert_allclose(other.inverse_dynamics_batch(*rates).tau, tau, rtol=0, atol=1e-10)


def test_the_command_for_any_robot_has_the_forces_of_our_file(tmp_path, capsys):
    pytest.importorskip("mujoco")
    parameters = replace(SOLIDS, actuators=LIFTED)
    path, _ = read_back(parameters, tmp_path, "mjcf")
    motion = p3dof.Motion.rest_to_rest([0, 0, 0], [0.05, 0.04, 0.2], 0.5, 201)
    result = p3dof.load(parameters).inverse_dynamics(motion)
    table = np.column_stack([motion.time, result.sliders])
    names = "t,slide_a,slide_b,slide_c"
    np.savetxt(tmp_path / "sliders.csv", table, delimiter=",", header=names, comments="")
    out = tmp_path / "forces.csv"
    code, _, _ = run(
        capsys, "loop", "forces", path, "--motion", tmp_path / "sliders.csv", "--samples", 201, "--out", out
    )
    assert code == 0
    rows = np.genfromtxt(out, delimiter=",", names=True)
    forces = np.column_stack([rows[f"force_slide_{leg}_N"] for leg in "abc"])
    assert off(forces, result.forces) < 1e-6  # of the curve through the sliders' values
    plain = p3dof.load(replace(parameters, actuators=Actuators())).inverse_dynamics(motion)
    assert off(forces, plain.forces) > 0.1
