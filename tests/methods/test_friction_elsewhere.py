"""Friction and counterbalances in the closed-loop model of the machine, in files and in other programs."""

from __future__ import annotations

import warnings
from dataclasses import replace
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
import yaml
from command_line import run
from machines import conditioning, random_actuators, random_machine, random_states

import p3dof
from p3dof._base.errors import ModelError, ModelWarning
from p3dof.closed_form.kinematics import mechanism_motion
from p3dof.machine import description
from p3dof.machine.description import Joint, Placement
from p3dof.machine.parameters import PASSIVE, SLIDES, SOLIDS, Actuators, Friction
from p3dof.runs import Integration, JointPD, gains, simulate_robot

UNIVERSALS = ("universal_a", "universal_b")
FRICTION = Friction(
    viscous={"sliders": 35.0, "joints": 0.02, "hinge_lower_right": 0.05, "universal_a": 0.03},
    coulomb={"sliders": 8.0, "hinge_a": 0.3, "hinge_c": 0.2, "hinge_lower_right": 0.15},
)
"""All of which a closed-loop model has."""
BALANCED = Actuators(
    armature={"sliders": 11.2},
    counterbalance={"sliders": 30.0},
    spring={"slide_b": 200.0},
    counterweight={"slide_c": 1.5},
)
MACHINE = replace(SOLIDS, friction=FRICTION, actuators=BALANCED)
COULOMB = replace(MACHINE, friction=Friction(coulomb={"joints": 0.2}))
HOME = np.zeros(3)


def random_friction(rng, machine):
    """Friction that matters at the speeds of `random_states`, within and beyond its smoothing."""
    weight, L = 10 * machine.bodies.mass, machine.geometry.L

    def by(names, size):
        return dict(zip(names, rng.uniform(0, size, len(names)), strict=True))

    passive = [name for name in PASSIVE if name not in UNIVERSALS]
    return Friction(
        by(SLIDES, weight / L) | by(PASSIVE, weight * L / 10),
        by(SLIDES, weight) | by(passive, weight * L / 10),
        10 ** rng.uniform(-3, 1),
    )


def joint_states(machine, loop, states):
    moving = mechanism_motion(machine.geometry, states.pose, states.velocity, states.acceleration)
    names = [str(name) for name in loop.model.names[1:]]
    return [
        np.stack([rates[name] for name in names], axis=-1)
        for rates in (moving.position, moving.velocity, moving.acceleration)
    ]


# --- the closed-loop model ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_the_loop_has_the_forces_and_accelerations_of_the_machine(seed):
    """Those of the other way, which shares the parameters alone; and without them both are others."""
    rng = np.random.default_rng(seed)
    machine = random_machine(seed)
    machine = replace(
        machine, friction=random_friction(rng, machine), actuators=random_actuators(rng, machine)
    )
    robot = p3dof.load(machine)
    states = random_states(machine, seed, 5)
    forces = robot.forces(states.pose, states.velocity, states.acceleration, method="virtual-power")
    q, v, a = joint_states(machine, robot.loop, states)
    bound = 1e-11 * conditioning(machine.geometry, states.pose) * np.abs(forces).max(axis=1)
    tau = robot.loop.inverse_dynamics_batch(q, v, a).tau
    assert (np.abs(tau - forces).max(axis=1) <= bound).all()
    bare = robot.bare_loop.inverse_dynamics_batch(q, v, a).tau
    assert (np.abs(bare - forces).max(axis=1) > 1e-2 * np.abs(forces).max(axis=1)).all()
    for i in range(len(q)):
        found = robot.loop.forward_dynamics(q[i], v[i], forces[i]).a
        size = np.abs(a[i]).max() + np.abs(forces[i]).max() / machine.bodies.mass
        assert np.abs(found - a[i]).max() <= 1e-9 * conditioning(machine.geometry, states.pose[i]) ** 2 * size


def test_at_a_usual_size_they_agree_to_a_fraction_of_a_nanonewton():
    robot, motion = p3dof.load(MACHINE), p3dof.paper_motion(21)
    q, v, a = joint_states(MACHINE, robot.loop, motion)
    for method in ("virtual-power", "pinocchio", "compiled"):
        forces = robot.forces(motion.pose, motion.velocity, motion.acceleration, method=method)
        tau = robot.loop.inverse_dynamics_batch(q, v, a).tau
        np.testing.assert_allclose(tau, forces, rtol=0, atol=1e-10)
    compiled = robot.loop.compile().inverse_dynamics(q, v, a).tau
    np.testing.assert_allclose(compiled, tau, rtol=0, atol=1e-10)


def test_a_machine_without_them_has_one_loop():
    for parameters in (p3dof.PAPER, replace(SOLIDS, actuators=Actuators(armature={"sliders": 3.0}))):
        robot = p3dof.load(parameters)
        assert robot.loop is robot.bare_loop
        assert not robot.loop.passive


def test_the_pinocchio_method_adds_nothing_twice():
    """Whichever of both loops it is given; to the last bit."""
    robot, motion = p3dof.load(MACHINE), p3dof.paper_motion(21)
    forces = robot.inverse_dynamics(motion, method="pinocchio").forces
    given = motion.pose, motion.velocity, motion.acceleration
    states = p3dof.machine.motion.states_of(*given)
    for loop in (robot.loop, robot.bare_loop):
        found = p3dof.methods.pinocchio.PinocchioMethod(MACHINE, loop).forces(states)
        np.testing.assert_array_equal(found, forces)
    from p3dof.analysis.reactions.evaluation import over_motion

    found, expected = (
        over_motion(loop, MACHINE, motion, "elastic") for loop in (robot.loop, robot.bare_loop)
    )
    np.testing.assert_array_equal(found.forces, expected.forces)
    np.testing.assert_array_equal(found.moments, robot.reactions(motion, joints="elastic").moments)


def test_an_observer_of_the_machine_at_rest_sees_nothing_but_the_load():
    robot = p3dof.load(MACHINE)
    pose, load = np.array([0.02, 0.03, 0.1]), np.array([0, 25.0, -40.0, 0, 3.0, 0])
    for wrench, expected in ((np.zeros(6), np.zeros(3)), (load, load[[1, 2, 4]])):
        observer = robot.loop.observer(bandwidth=30)
        forces = robot.forces(pose, HOME, HOME, wrench=wrench, method="virtual-power")
        for _ in range(1000):
            observer.update_from_motors(1e-3, robot.sliders(pose), HOME, forces)
        found = np.linalg.solve(robot.jacobian(pose).T, expected)
        np.testing.assert_allclose(observer.external, found, rtol=0, atol=1e-9)


def test_a_controller_of_its_joints_balances_the_machine():
    robot = p3dof.load(MACHINE)
    target = robot.sliders([0.01, 0.0, 0.0])
    controller = JointPD(robot.loop, target, *gains(10), gravity=True)
    q = robot.loop.complete(target, HOME, HOME).q
    held = robot.forces([0.01, 0.0, 0.0], HOME, HOME, method="virtual-power")
    run_ = robot.simulate(0.05, start=[0.01, 0.0, 0.0], controller=controller, method="pinocchio")
    np.testing.assert_allclose(run_.forces, np.broadcast_to(held, run_.forces.shape), rtol=0, atol=1e-9)
    still = simulate_robot(robot.loop, 0.05, q, controller=controller)
    np.testing.assert_allclose(still.q, np.broadcast_to(q, still.q.shape), rtol=0, atol=1e-9)


def test_a_robot_run_of_the_loop_is_a_run_of_the_machine():
    """Here without friction at the cuts: the same forces in the same places give the same steps."""
    friction = Friction(viscous={"sliders": 35.0, "hinge_c": 0.02}, coulomb={"sliders": 2.0}, smoothing=0.05)
    robot = p3dof.load(replace(MACHINE, friction=friction))
    pose, forces = np.array([0.02, 0.03, 0.1]), np.array([60.0, 90.0, 40.0])
    integration = Integration(rtol=1e-10, atol=1e-12)
    given = {"stop_at": (), "samples": 11, "integration": integration}
    machine = robot.simulate(0.1, start=pose, controller=forces, method="pinocchio", **given)
    q = robot.loop.complete(robot.sliders(pose), HOME, HOME).q
    general = simulate_robot(robot.loop, 0.1, q, controller=forces, method="general", **given)
    paper = robot.simulate(0.1, start=pose, controller=forces, method="virtual-power", **given)
    names = [str(name) for name in robot.model.names[1:]]
    columns = [names.index(slide) for slide in SLIDES]
    for run_ in (machine, paper):
        np.testing.assert_allclose(general.q[:, columns], run_.sliders, rtol=0, atol=1e-8)
    assert np.abs(machine.sliders[-1] - machine.sliders[0]).max() > 0.01


def test_what_a_loop_cannot_have_is_told_once():
    robot = p3dof.load(COULOMB)
    words = "A closed-loop model has no word for the Coulomb friction in universal_a and universal_b about y0"
    with pytest.warns(ModelWarning, match=words) as told:
        loop = robot.loop
    assert len(told) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert robot.loop is loop
        robot.forces(HOME, HOME, HOME, method="pinocchio")
        robot.reactions(p3dof.paper_motion(3))
    states = random_states(COULOMB, 1, 4)
    q, v, a = joint_states(COULOMB, loop, states)
    missing = robot.forces(states.pose, states.velocity, states.acceleration, method="virtual-power")
    missing -= loop.inverse_dynamics_batch(q, v, a).tau
    torque = 2 * 0.2 * np.tanh(states.velocity[:, 2] / 1e-3)  # of both, about y0
    moved = np.einsum("nij,ni->nj", robot.jacobian(states.pose), missing)
    np.testing.assert_allclose(moved[:, 2], torque, rtol=0, atol=1e-9)
    np.testing.assert_allclose(moved[:, :2], 0, rtol=0, atol=1e-9)


# --- files --------------------------------------------------------------------------------------------------


def read_back(parameters, folder, form, **given):
    file = description.write(parameters, folder, (form,))[0]
    loop = p3dof.load_robot(file, **given)
    loop.model.gravity.linear = parameters.gravity
    return loop


def told_of(parameters, form):
    """What is said when a format is written."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        texts = description.texts(parameters, (form,))
    return [str(one.message) for one in told], texts


def losses(loop):
    return {entry.joint: (entry.damping, entry.friction) for entry in loop.sidecar.joint_data}


def test_urdf_and_sidecar_read_back_have_the_forces(tmp_path):
    """From a file and from texts; universal joints are a bushing."""
    robot, motion = p3dof.load(MACHINE), p3dof.paper_motion(21)
    forces = robot.forces(motion.pose, motion.velocity, motion.acceleration, method="virtual-power")
    for loop in (read_back(MACHINE, tmp_path, "urdf"), p3dof.load_robot(robot.urdf, robot.sidecar)):
        loop.model.gravity.linear = MACHINE.gravity
        tau = loop.inverse_dynamics_batch(*joint_states(MACHINE, loop, motion)).tau
        np.testing.assert_allclose(tau, forces, rtol=0, atol=1e-9)
    assert loop.sidecar.bushings[0].damping == (0, 0, 0, 0, 0.05, 0)
    assert losses(p3dof.load_robot(robot.urdf, replace(loop.sidecar, joint_data=()), passive=True)) == losses(
        loop
    )


def test_the_sidecar_says_over_which_rate_friction_turns():
    data = [{"joint": "slide_a", "friction": 2.0, "smoothing": 0.05}]
    one = replace(SOLIDS, friction=Friction(coulomb={"slide_a": 2.0}, smoothing=0.05))
    assert yaml.safe_load(p3dof.load(one).sidecar)["joint_data"] == data


IN_JOINTS = replace(
    MACHINE, friction=replace(FRICTION, viscous={"sliders": 35.0, "hinge_c": 0.02, "hinge_lower_right": 0.05})
)
"""All of it at rates of joints of the tree."""


@pytest.mark.parametrize("form", ["mjcf", "sdf", "urdf+"])
def test_other_files_read_back_have_the_friction_of_joints(form, tmp_path):
    parameters = IN_JOINTS if form == "mjcf" else replace(IN_JOINTS, actuators=Actuators())
    if form == "mjcf":
        pytest.importorskip("mujoco")
    robot, motion = p3dof.load(parameters), p3dof.paper_motion(21)
    assert told_of(parameters, form)[0] == []
    motors = {"closed_loop": [], "type": [], "name_mot": list(SLIDES)}  # which SDF and URDF+ do not say
    given = {} if form == "mjcf" else {"sidecar": motors, "passive": True}
    loop = read_back(parameters, tmp_path, form, **given)
    tau = loop.inverse_dynamics_batch(*joint_states(parameters, loop, motion)).tau
    forces = robot.forces(motion.pose, motion.velocity, motion.acceleration, method="virtual-power")
    np.testing.assert_allclose(tau, forces, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("form", "lost"),
    [
        ("mjcf", "MJCF has no word for the viscous friction in universal_a and universal_b about y0"),
        ("sdf", "SDF has no word for the viscous friction in universal_a and universal_b about y0"),
        ("urdf+", "URDF+ has no word for the viscous friction in universal_a and universal_b about y0"),
        (
            "drake",
            "Drake's URDF has no word for the viscous friction in universal_a and universal_b about y0 "
            "and the Coulomb friction in slide_a, hinge_a, slide_b, slide_c, hinge_c, hinge_right",
        ),
        (
            "usd",
            "USD has no word for the viscous friction in slide_a, hinge_a, slide_b, hinge_b, slide_c, "
            "hinge_c, hinge_left, hinge_lower, hinge_platform, hinge_right, universal_a and universal_b "
            "about y0 and the Coulomb friction in slide_a, hinge_a, slide_b, slide_c, hinge_c, hinge_right",
        ),
        ("urdf", None),
        ("srdf", None),
    ],
)
def test_what_a_format_has_no_word_for_is_told_in_a_line(form, lost):
    if form == "usd":
        pytest.importorskip("pxr")
    told, _ = told_of(replace(MACHINE, actuators=Actuators()), form)
    assert told == ([f"{lost}, which is left out"] if lost else [])


def test_coulomb_friction_about_y0_is_in_no_file():
    told, texts = told_of(COULOMB, "urdf")
    assert told == [
        "A closed-loop model has no word for the Coulomb friction in universal_a and universal_b about y0, "
        "which is left out"
    ]
    assert "bushings" not in yaml.safe_load(texts["p3dof.yaml"])


def test_the_command_tells_it(tmp_path, capsys):
    p3dof.write_parameters(MACHINE, tmp_path / "my.yaml")
    given = "--format", "urdf", "--format", "mjcf", "--out", tmp_path
    code, _, err = run(capsys, "export", "--parameters", tmp_path / "my.yaml", *given)
    assert code == 0
    assert err.count("MJCF has no word for the viscous friction in universal_a and universal_b about y0") == 1
    assert err.count("\n") == 1


def test_a_fixed_joint_has_no_friction():
    with pytest.raises(ModelError, match="expected no armature, counterbalance or friction of a fixed joint"):
        Joint("weld", "fixed", "base_link", "hand", Placement(), damping=1.0)


# --- other programs -----------------------------------------------------------------------------------------


def test_mujoco_has_the_friction_of_the_file():
    """Damping in its own inverse dynamics, with the friction losses that it read added by their signs."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(told_of(IN_JOINTS, "mjcf")[1]["p3dof_mjcf.xml"])
    data, robot, motion = mujoco.MjData(model), p3dof.load(IN_JOINTS), p3dof.paper_motion(21)
    found = []
    for q, v, a in zip(*joint_states(IN_JOINTS, robot.loop, motion), strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        J = data.efc_J.reshape(data.nefc, model.nv)[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        load = data.qfrc_inverse + data.qfrc_constraint + model.dof_frictionloss * np.tanh(v / 1e-3)
        free = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, 1e-9) :]
        B = np.eye(model.nv)[:, model.actuator_trnid[:, 0]]
        found.append(np.linalg.solve(free @ B, free @ load))
    forces = robot.forces(motion.pose, motion.velocity, motion.acceleration, method="virtual-power")
    np.testing.assert_allclose(found, forces, rtol=0, atol=1e-9)


def test_pybullet_reads_the_friction_of_the_urdf(tmp_path):
    pybullet = pytest.importorskip("pybullet")
    description.write(MACHINE, tmp_path, ("urdf",))
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(tmp_path / "p3dof.urdf"), useFixedBase=True, physicsClientId=client)
        count = pybullet.getNumJoints(body, physicsClientId=client)
        joints = [pybullet.getJointInfo(body, i, physicsClientId=client) for i in range(count)]
    finally:
        pybullet.disconnect(client)
    read = {one[1].decode(): (one[6], one[7]) for one in joints if one[6] or one[7]}
    assert read == losses(p3dof.load(MACHINE).loop)


def test_drake_reads_the_damping_of_its_urdf():
    pytest.importorskip("pydrake")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(1e-3)
    text = told_of(replace(MACHINE, actuators=Actuators()), "drake")[1]["p3dof_drake.urdf"]
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.Finalize()
    for name, (damping, _) in losses(p3dof.load(MACHINE).loop).items():
        assert plant.GetJointByName(name).default_damping() == damping


def test_sdf_has_springs_and_friction_in_one_element():
    spring = Actuators(counterbalance={"slide_a": 30.0}, spring={"slide_a": 200.0})
    text = told_of(replace(IN_JOINTS, actuators=spring), "sdf")[1]["p3dof.sdf"]
    dynamics = Xml.fromstring(text).findall(".//joint[@name='slide_a']/axis/dynamics")  # noqa: S314 - ours
    assert [{item.tag: float(item.text) for item in one} for one in dynamics] == [
        {"damping": 35.0, "friction": 8.0, "spring_reference": 0.15, "spring_stiffness": 200.0}
    ]
