"""Bushings: forces as Drake's, in everything that is computed of a robot."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import ARM, BAR, ROD, joint, link, robot
from compilers import CC, COMPILED
from scipy.integrate import solve_ivp

import p3dof
from p3dof._base.errors import InputError, ModelError
from p3dof.codegen.loops import loop_files
from p3dof.loops import Bushing, ClosedLoopModel, ReactionSolver, Sidecar, bushings
from p3dof.loops.writers import contents
from p3dof.runs import simulate_robot

LAWS = (
    ("110 70 40", "9 6 4", "8 5 3", "0.7 0.5 0.4"),  # against forces and torques: stiffness, damping
    ("50 50 50", "0 0 0", "0 0 0", "0 0 0"),
    ("0 30 60", "0 2 4", "0 1.5 0", "0.2 0 0"),
)
ENDS = (("on_hand", "on_leg"), ("at_ground", "hand"), ("foot", "elbow_link"))
FRAMES = """
<frame name="on_hand" link="hand" xyz="0.1 0.02 -0.05" rpy="0.3 -0.2 0.5"/>
<frame name="on_leg" link="foot" xyz="0.03 0.1 0.04" rpy="-0.4 0.3 0.2"/>
<frame name="at_ground" link="base" xyz="0.4 -0.3 0.2" rpy="0.1 0.6 -0.3"/>"""


def bushing(ends, law):
    kinds = ("force_stiffness", "force_damping", "torque_stiffness", "torque_damping")
    values = "".join(
        f'<drake:bushing_{kind} value="{value}"/>' for kind, value in zip(kinds, law, strict=True)
    )
    return (
        f'<drake:linear_bushing_rpy><drake:bushing_frameA name="{ends[0]}"/>'
        f'<drake:bushing_frameC name="{ends[1]}"/>{values}</drake:linear_bushing_rpy>'
    )


ALL = tuple(bushing(*pair) for pair in zip(ENDS, LAWS, strict=True))


def text(*bushings):
    """Two arms on a base, of all that turns and slides."""
    return robot(
        link("base", BAR),
        link("elbow_link", ROD),
        link("hand", BAR),
        link("leg", ARM),
        link("foot", ROD),
        joint("shoulder", "base", "elbow_link", (0, 0, 0.3), axis=(0, 0.6, 0.8)),
        joint("elbow", "elbow_link", "hand", (0.3, 0, 0.1), axis=(1, 0, 0), kind="continuous"),
        joint("hip", "base", "leg", (0.2, 0.3, 0), axis=(0, 1, 0)),
        joint("slide", "leg", "foot", (0.2, 0, 0), axis=(0.6, 0, 0.8), kind="prismatic"),
        FRAMES,
        *bushings,
    )


def loaded(*bushings, **options):
    return p3dof.load_robot(text(*bushings), **options)


def states(loop, count, seed=0):
    """Return random states where no bushing is turned by far."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-0.8, 0.8, (count, loop.model.nv))
    q = np.array([pin.integrate(loop.model, pin.neutral(loop.model), step) for step in steps])
    return q, *rng.normal(size=(2, count, loop.model.nv))


def drake_plant(file, change=None):
    pytest.importorskip("pydrake", reason="Drake not installed: pip install 'p3dof[interop]'")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(file, "urdf")
    if change is None:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    else:
        change(plant)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, -9.81])
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


def angle_of(model, i, q):
    at = model.idx_qs[i]
    return float(np.arctan2(q[at + 1], q[at]) if model.nqs[i] == 2 else q[at])


class Drake:
    """A robot of single joints in Drake, with vectors in the order of Pinocchio."""

    def __init__(self, loop, file):
        self.plant, self.context = drake_plant(file)
        self.model = loop.model
        joints = [self.plant.GetJointByName(name) for name in list(loop.model.names)[1:]]
        self.at = [joint.velocity_start() for joint in joints]

    def accelerations(self, q, v):
        positions, speeds = np.zeros((2, len(self.at)))
        positions[self.at], speeds[self.at] = q, v
        self.plant.SetPositions(self.context, positions)
        self.plant.SetVelocities(self.context, speeds)
        rates = self.plant.EvalTimeDerivatives(self.context)
        return rates.get_generalized_velocity().CopyToVector()[self.at]

    def off(self, loop, seed=0, count=20):
        """By how much accelerations differ, relative to the largest of each state."""
        found = []
        for q, v, _ in zip(*states(loop, count, seed), strict=True):
            expected = self.accelerations([angle_of(self.model, i + 1, q) for i in range(len(v))], v)
            a = loop.forward_dynamics(q, v, np.zeros(len(v))).a
            found.append(np.abs(a - expected).max() / np.abs(expected).max())
        return max(found)


@pytest.mark.parametrize("which", [(0,), (1,), (2,), (0, 1, 2)])
def test_accelerations_are_those_of_drake(which):
    some = [ALL[i] for i in which]
    loop = loaded(*some)
    assert loop.mobility(states(loop, 1)[0][0]) == loop.model.nv == 4
    drake = Drake(loop, text(*some))
    assert drake.off(loop) < 1e-12
    assert drake.off(loaded()) > 1e-3


@pytest.mark.parametrize("name", ["axial", "cross"])
def test_a_wrong_sign_is_noticed(monkeypatch, name):
    """Of the axes half-way, and of the arm of a force."""
    right = getattr(bushings, name)
    monkeypatch.setattr(bushings, name, lambda *given: tuple(-x for x in right(*given)))
    loop = loaded(*ALL)
    assert Drake(loop, text(*ALL)).off(loop, count=3) > 1e-3


def test_a_free_body_on_bushings_moves_as_in_drake():
    pytest.importorskip("pydrake", reason="Drake not installed: pip install 'p3dof[interop]'")
    from pydrake.math import RigidTransform, RotationMatrix
    from pydrake.multibody.math import SpatialVelocity
    from pydrake.multibody.tree import FixedOffsetFrame, LinearBushingRollPitchYaw

    frames = (
        '<frame name="ground" link="world" xyz="0.1 0.2 0.3" rpy="0.2 0.1 0.4"/>',
        '<frame name="seat" link="plate" xyz="0.1 0 0.2" rpy="0.3 -0.5 0.2"/>',
    )
    pairs = ((("ground", "seat"), LAWS[0]), (("plate", "world"), LAWS[1]))
    file = robot(link("plate", ARM), *frames, *(bushing(*pair) for pair in pairs))
    loop = p3dof.load_robot(file, root_joint=pin.JointModelFreeFlyer())

    def with_bushings(plant):
        """Drake's parser knows no frame of the world."""
        ground = RigidTransform(RotationMatrix(pin.rpy.rpyToMatrix(0.2, 0.1, 0.4)), [0.1, 0.2, 0.3])
        plant.AddFrame(FixedOffsetFrame("ground", plant.world_frame(), ground))
        for ends, law in pairs:
            force, loss, torque, drag = (np.array(part.split(), dtype=float) for part in law)
            one, two = (plant.GetFrameByName(end) for end in ends)
            plant.AddForceElement(LinearBushingRollPitchYaw(one, two, torque, drag, force, loss))

    plant, context = drake_plant(robot(link("plate", ARM), frames[1]), with_bushings)
    body = plant.GetBodyByName("plate")
    for q, v, _ in zip(*states(loop, 20), strict=True):
        R = pin.Quaternion(q[3:]).toRotationMatrix()
        plant.SetFreeBodyPose(context, body, RigidTransform(RotationMatrix(R), q[:3]))
        speeds = np.concatenate([R @ v[3:], R @ v[:3]])
        plant.SetVelocities(context, SpatialVelocity(speeds[:3], speeds[3:]).get_coeffs())
        expected = plant.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector()
        a = loop.forward_dynamics(q, v, []).a
        found = np.concatenate([R @ a[3:], R @ (a[:3] + np.cross(v[3:], v[:3]))])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_power_is_that_of_the_forces_and_dampers_only_take():
    loop = loaded(*ALL)
    q, v, _ = states(loop, 20)
    acting, forces = loop.passive, loop.passive.forces(q, v)
    lost = loop.dissipation(v, q)
    assert lost.min() > 0
    np.testing.assert_allclose(np.sum(forces * v, axis=1), -acting.power(q, v) - lost, rtol=0, atol=1e-12)
    assert loop.dissipation(v[0], q[0]) == pytest.approx(lost[0], rel=1e-14)
    with pytest.raises(InputError, match="q: expected the configuration"):
        loop.dissipation(v)


def drift(law, file=text, ends=ENDS[0]):
    """How fast the energy of springs alone changes beside the power that is taken from them."""
    loop = p3dof.load_robot(file(bushing(ends, (law[0], "0 0 0", law[1], "0 0 0"))))
    found = []
    for q, v, _ in zip(*states(loop, 20), strict=True):
        h = 1e-6
        ends = [loop.passive.energy(np.array(pin.integrate(loop.model, q, s * h * v))) for s in (1, -1)]
        found.append(((ends[0] - ends[1]) / (2 * h) - loop.passive.power(q, v)) / loop.passive.power(q, v))
    return np.abs(found)


def flat(*bushings):
    """Two arms in a plane."""
    return robot(
        link("base"),
        link("elbow_link", ROD),
        link("hand", BAR),
        joint("shoulder", "base", "elbow_link", (0, 0, 0.3)),
        joint("elbow", "elbow_link", "hand", (0.3, 0, 0)),
        '<frame name="beside" link="base" xyz="0.3 0 0.1" rpy="0 0.4 0"/>',
        *bushings,
    )


def test_the_energy_of_springs_is_kept_where_the_law_has_one():
    """Equal stiffnesses against forces, any against torques; or turns about one axis."""
    assert drift(("50 50 50", "8 5 3")).max() < 1e-7
    assert drift(("110 70 40", "0 4 0"), flat, ("beside", "hand")).max() < 1e-7
    assert drift(("110 70 40", "0 0 0")).max() > 1e-3
    loop = loaded(bushing(ENDS[0], ("50 50 50", "0 0 0", "8 5 3", "0 0 0")))
    q, v, _ = (rows[0] for rows in states(loop, 1))
    run = simulate_robot(loop, 1.0, q, 0.3 * v, samples=11, method="general")
    assert np.ptp(loop.passive.energy(run.q)) > 1.0
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=0, atol=1e-7)


def test_derivatives_are_exact():
    loop, h = loaded(*ALL), 1e-6
    for q, v, a in zip(*states(loop, 4), strict=True):
        by_q, by_v = loop.passive.derivatives(q, v)
        for k, step in enumerate(h * np.eye(4)):
            moved = [np.array(pin.integrate(loop.model, q, s * step)) for s in (1, -1)]
            one, two = (loop.passive.forces(there, v) for there in moved)
            np.testing.assert_allclose(by_q[:, k], (one - two) / (2 * h), rtol=0, atol=1e-7)
            one, two = (loop.passive.forces(q, v + s * step) for s in (1, -1))
            np.testing.assert_allclose(by_v[:, k], (one - two) / (2 * h), rtol=0, atol=1e-7)
        assert np.abs(by_v - np.diag(np.diag(by_v))).max() > 0.1
        np.testing.assert_allclose(by_v, by_v.T, rtol=0, atol=1e-13)
        tau = loop.inverse_dynamics(q, v, a).tau
        found = loop.inverse_dynamics_derivatives(q, v, a).tau, loop.forward_dynamics_derivatives(q, v, tau).a
        ways = (
            (lambda q, v, a=a: loop.inverse_dynamics(q, v, a).tau),
            (lambda q, v, tau=tau: loop.forward_dynamics(q, v, tau).a),
        )
        for by, way in zip(found, ways, strict=True):
            for k, name in enumerate(loop.coordinates(q)):
                step = h * np.eye(4)[list(loop.model.names).index(name) - 1]
                ends = [way(np.array(pin.integrate(loop.model, q, s * step)), v) for s in (1, -1)]
                expected = (ends[0] - ends[1]) / (2 * h)
                size = max(1.0, np.abs(expected).max())
                np.testing.assert_allclose(by.by_coordinates[:, k], expected, rtol=0, atol=1e-7 * size)
                ends = [way(q, v + s * step) for s in (1, -1)]
                expected = (ends[0] - ends[1]) / (2 * h)
                size = max(1.0, np.abs(expected).max())
                np.testing.assert_allclose(by.by_speeds[:, k], expected, rtol=0, atol=1e-7 * size)


def test_many_samples_compiled_ones_and_one_are_the_same():
    loop = loaded(*ALL)
    q, v, a = states(loop, 8)
    one = np.array([loop.inverse_dynamics(*state).tau for state in zip(q, v, a, strict=True)])
    largest = np.abs(one).max()
    np.testing.assert_allclose(loop.inverse_dynamics_batch(q, v, a).tau, one, rtol=0, atol=1e-13 * largest)
    compiled = loop.compile(level="numpy")
    found = compiled.inverse_dynamics(q, v, a)
    assert not found.general.any()
    np.testing.assert_allclose(found.tau, one, rtol=0, atol=1e-12 * largest)
    back = compiled.forward_dynamics(q, v, one)
    assert not back.general.any()
    np.testing.assert_allclose(back.a, a, rtol=0, atol=1e-11 * np.abs(a).max())
    for i in range(8):
        found = loop.hybrid_dynamics(q[i], v[i], a[i][loop.actuated_v])
        np.testing.assert_allclose(found.tau, one[i], rtol=0, atol=1e-12 * largest)
        minimal = loop.minimal_dynamics(q[i], v[i])
        places = [list(loop.model.names).index(name) - 1 for name in minimal.coordinates]
        bias = minimal.coriolis_matrix @ v[i][places] + minimal.gravity_forces - minimal.passive_forces
        taken = minimal.mass_matrix @ a[i][places] + bias
        full = np.zeros(4)
        full[loop.actuated_v] = one[i]
        np.testing.assert_allclose(taken, full[places], rtol=0, atol=1e-12 * largest)


@COMPILED
def test_the_c_of_a_robot_with_bushings_tests_itself(tmp_path):
    for file, written in loop_files(loaded(*ALL), "arms").files.items():
        (tmp_path / file).write_text(written, encoding="utf-8")
    command = ["make", "-s", "check", f"CC={CC}"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all is well" in done.stdout


def test_a_second_of_motion_is_that_of_drake():
    loop = loaded(*ALL)
    drake, q = Drake(loop, text(*ALL)), pin.neutral(loop.model)
    angles = [angle_of(loop.model, i, q) for i in range(1, 5)]
    run = simulate_robot(loop, 1.0, q, samples=11, method="general")
    expected = solve_ivp(
        lambda _, x: np.concatenate([x[4:], drake.accelerations(x[:4], x[4:])]),
        (0.0, 1.0),
        np.concatenate([angles, np.zeros(4)]),
        rtol=1e-11,
        atol=1e-12,
        t_eval=run.time,
    ).y.T
    assert np.abs(expected[-1] - expected[0]).max() > 0.1
    np.testing.assert_allclose(run.v, expected[:, 4:], rtol=0, atol=1e-6 * np.abs(expected[:, 4:]).max())


def test_a_robot_of_millimetres_is_the_same_machine():
    """Lengths by a thousand, masses as they are: forces by a thousand, torques by a million."""
    loop, size = loaded(*ALL), 1e-3
    model = loop.model.copy()
    for i in range(model.njoints):
        model.jointPlacements[i].translation *= size
        model.inertias[i].lever *= size
        model.inertias[i] = pin.Inertia(
            model.inertias[i].mass, model.inertias[i].lever, size**2 * np.array(model.inertias[i].inertia)
        )
    for frame in model.frames:
        frame.placement.translation *= size
    model.gravity.linear = model.gravity.linear * size
    laws = [
        replace(one, **{w: (*getattr(one, w)[:3], *(size**2 * np.array(getattr(one, w)[3:]))) for w in WHAT})
        for one in loop.sidecar.bushings
    ]
    small = ClosedLoopModel(model, replace(loop.sidecar, bushings=tuple(laws)))
    assert small.unit_of_length != 1
    lengths = np.array([name == "slide" for name in list(model.names)[1:]])
    units = np.where(lengths, size, 1.0)
    for q, v, a in zip(*states(loop, 5), strict=True):
        there = q.copy()
        there[loop.model.idx_qs[model.getJointId("slide")]] *= size
        tau = loop.inverse_dynamics(q, v, a).tau
        found = small.inverse_dynamics(there, v * units, a * units).tau
        of_motors = np.where(lengths, size, size**2)[loop.actuated_v]
        np.testing.assert_allclose(found / of_motors, tau, rtol=0, atol=1e-11 * np.abs(tau).max())
        many = small.inverse_dynamics_batch(there[None], (v * units)[None], (a * units)[None]).tau[0]
        np.testing.assert_allclose(many, found, rtol=0, atol=1e-12 * np.abs(found).max())
        one = small.forward_dynamics(there, v * units, found).a
        np.testing.assert_allclose(one / units, a, rtol=0, atol=1e-10 * np.abs(a).max())
        large, little = (
            robot.inverse_dynamics_derivatives(*state).tau.by_speeds
            for robot, state in ((loop, (q, v, a)), (small, (there, v * units, a * units)))
        )
        columns = units[[list(model.names).index(name) - 1 for name in loop.coordinates(q)]]
        scaled = little / of_motors[:, None] * columns
        np.testing.assert_allclose(scaled, large, rtol=0, atol=1e-10 * np.abs(large).max())


WHAT = ("stiffness", "damping")


def test_reactions_are_those_of_the_same_forces_from_outside():
    """What bushings do to bodies passes through the joints, and not only along their axes."""
    loop, plain = loaded(*ALL), loaded()
    solver, other = (
        ReactionSolver(loop),
        ReactionSolver(ClosedLoopModel(loop.model, Sidecar((), plain.actuated))),
    )
    for q, v, a in zip(*states(loop, 3), strict=True):
        tau = loop.inverse_dynamics(q, v, a).tau
        data = loop.model.createData()
        pin.framesForwardKinematics(loop.model, data, q)
        wrenches = {}
        for (joint_, force), end in zip(
            loop.passive.bushings.wrenches(data, q, v),
            (name for one in loop.sidecar.bushings for name in reversed(one.frames)),
            strict=True,
        ):
            at = data.oMf[loop.model.getFrameId(end)]
            world = data.oMi[joint_].act(force)
            wrenches[end] = pin.SE3(np.eye(3), at.translation).actInv(world).vector
        one, two = solver.solve(q, v, a, tau), other.solve(q, v, a, tau, wrenches)
        assert one.residual < 1e-10
        np.testing.assert_allclose(one.forces, two.forces, rtol=0, atol=1e-11 * np.abs(two.forces).max())
        np.testing.assert_allclose(one.moments, two.moments, rtol=0, atol=1e-11 * np.abs(two.forces).max())


def test_forces_are_linear_in_stiffness_and_damping():
    loop = loaded(*ALL)
    q, v, a = (rows[0] for rows in states(loop, 1))
    found = loop.force_regressor(q, v, a)
    tau = loop.inverse_dynamics(q, v, a).tau
    np.testing.assert_allclose(found.forces @ found.parameters, tau, rtol=0, atol=1e-11 * np.abs(tau).max())
    softer = [
        replace(one, stiffness=0.3 * np.array(one.stiffness) * [1, 2, 3, 4, 5, 6])
        for one in loop.sidecar.bushings
    ]
    other = ClosedLoopModel(loop.model, replace(loop.sidecar, bushings=tuple(softer)))
    changed = other.force_regressor(q, v, a)
    assert changed.parameter_names == found.parameter_names
    assert "bushing_1.stiffness_yaw" in found.parameter_names
    expected = other.inverse_dynamics(q, v, a).tau
    np.testing.assert_allclose(
        found.forces @ changed.parameters, expected, rtol=0, atol=1e-11 * np.abs(tau).max()
    )


def test_files_of_a_robot_give_it_back(tmp_path):
    loop = loaded(*ALL)
    assert Sidecar.parse(loop.sidecar.to_yaml()) == loop.sidecar
    for path, written in contents(loop, tmp_path / "arms.urdf").items():
        path.write_text(written, encoding="utf-8")
    again = p3dof.load_robot(tmp_path / "arms.urdf")
    q, v, a = states(loop, 3)
    tau = loop.inverse_dynamics_batch(q, v, a).tau
    found = again.inverse_dynamics_batch(q, v, a).tau
    np.testing.assert_allclose(found, tau, rtol=0, atol=1e-12 * np.abs(tau).max())
    for file, words in (("arms.xml", "MJCF: the bushing 'bushing_1' acts"), ("arms.sdf", "SDF: the bushing")):
        with pytest.raises(ModelError, match=words):
            contents(loop, tmp_path / file)


def test_a_sidecar_that_tells_those_of_the_file_again_does_not_double_them():
    loop = loaded(*ALL)
    told = tuple(
        replace(one, stiffness=(1.0,) * 6, name=f"{one.name} softer") for one in loop.sidecar.bushings
    )
    again = p3dof.load_robot(text(*ALL), replace(loop.sidecar, bushings=told))
    assert again.sidecar.bushings == told  # the sidecar goes before the file
    other = replace(told[0], frames=loop.sidecar.bushings[0].frames[::-1], name="bushing_2")
    with pytest.raises(ModelError, match=r"bushings\[2\]: the bushing 'bushing_2' is named twice"):
        p3dof.load_robot(text(*ALL), replace(loop.sidecar, bushings=(other,)))


def test_a_bushing_between_two_bodies_of_which_none_moves_is_none():
    loop = loaded(*ALL).lock(["shoulder", "elbow"])
    assert [bushing.title for bushing in loop.sidecar.bushings] == ["bushing_1", "bushing_3"]
    q, v, _ = (rows[0] for rows in states(loop, 1))
    whole = loaded(*ALL)
    there, rates = pin.neutral(whole.model), np.zeros(4)
    there[:2], rates[:2] = q, v
    assert list(whole.model.names)[1:3] == list(loop.model.names)[1:] == ["hip", "slide"]
    expected = whole.passive.forces(there, rates)[:2]
    np.testing.assert_allclose(loop.passive.forces(q, v), expected, rtol=0, atol=1e-12)


def test_where_axes_are_not_determined_is_told():
    """At a pitch of 90 degrees with torques, at half a turn with unequal forces; other laws go on there."""
    file = robot(link("base"), link("arm", ARM), joint("turn", "base", "arm", (0.1, 0, 0.3)), "{}")
    at = {90: "0 0 0", 180: "1 2 3"}
    for angle, force in at.items():
        q = np.array([np.deg2rad(angle)])
        law = (force, "0 0 0", "1 1 1" if angle == 90 else "0 0 0", "0 0 0")
        loop = p3dof.load_robot(file.format(bushing(("base", "arm"), law)))
        with pytest.raises(
            InputError, match=r"q: the bushing 'bushing_1' is turned to where its axes are not"
        ):
            loop.forward_dynamics(q, [0.0], [0.0])
        batch = loop.inverse_dynamics_batch(np.array([q, q + 0.1]), *np.zeros((2, 2, 1)), stop=False)
        assert np.isnan(batch.tau[0]).all()
        assert "bushing_1" in str(batch.errors[0])
        compiled = loop.compile(level="numpy").inverse_dynamics(q[None], *np.zeros((2, 1, 1)))
        assert "bushing_1" in str(compiled.errors[0])
        assert np.isfinite(batch.tau[1]).all()
        for other in ("2 2 2", "0 0 0"):
            ball = p3dof.load_robot(file.format(bushing(("base", "arm"), (other, "1 1 1", "0 0 0", "0 0 0"))))
            assert np.isfinite(ball.forward_dynamics(q, [1.0], [0.0]).a).all()


def test_stiff_bushings_approach_the_closure_that_they_stand_for():
    """A four-bar that hangs at rest: the gap, and the torque that holds it, are off by 1/K."""
    closed = ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), robots.FOUR_BAR_SIDECAR)
    q = closed.assemble([1.1]).q
    wanted = closed.inverse_dynamics(q, np.zeros(3), np.zeros(3)).tau[0]
    off = []
    for stiffness in (1e5, 1e6, 1e7):
        mount = Bushing(("coupler_tip", "rocker_tip"), (stiffness,) * 3 + (0.0,) * 3)
        soft = ClosedLoopModel(closed.model, Sidecar((), closed.model.names[1:], bushings=(mount,)))
        there = q.copy()
        idle = [i for i in range(3) if closed.model.names[i + 1] != "crank_joint"]
        for _ in range(20):
            rest = np.zeros(3), np.zeros(3)
            tau = soft.inverse_dynamics(there, *rest).tau
            by_q = soft.inverse_dynamics_derivatives(there, *rest).tau.by_coordinates
            there[idle] -= np.linalg.solve(by_q[np.ix_(idle, idle)], tau[idle])
        assert np.abs(tau[idle]).max() < 1e-8
        off.append(
            [
                abs(tau[list(closed.model.names).index("crank_joint") - 1] - wanted),
                closed.closure_error(there),
            ]
        )
    torque, gap = np.array([o[0] for o in off]), [np.linalg.norm(o[1]) for o in off]
    assert torque[0] > 1e-6
    np.testing.assert_allclose(torque[:-1] / torque[1:], 10.0, rtol=2e-2)
    np.testing.assert_allclose(np.divide(gap[:-1], gap[1:]), 10.0, rtol=1e-3)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"frames": ("hand", "nowhere")}, "bushing 'hand/nowhere': the frame 'nowhere' does not exist"),
        ({"frames": ("hand", "on_hand"), "name": "mount"}, "bushing 'mount': expected frames on two bodies"),
        ({"frames": ("hand", "hand")}, "frames: expected two different frames"),
        ({"frames": "hand"}, "frames: expected a pair of names, got 'hand'"),
        ({"frames": ("hand", 3)}, "frames: expected a name, got 3"),
        ({"frames": ("hand", "foot"), "stiffness": (1,) * 5}, "stiffness: expected shape"),
        (
            {"frames": ("hand", "foot"), "damping": (0, 0, -1, 0, 0, 0)},
            "damping: expected no negative numbers",
        ),
        ({"frames": ("hand", "foot"), "damping": (np.nan,) * 6}, "damping: expected finite numbers"),
        ({"frames": ("hand", "foot"), "name": ""}, "bushing: name: expected a name"),
    ],
)
def test_bad_bushings_are_one_clear_error(given, words):
    with pytest.raises(ModelError, match=words) as error:
        ClosedLoopModel(loaded().model, Sidecar((), (), bushings=(Bushing(**given),)))
    assert "\n" not in str(error.value)


def test_two_of_one_name_are_told_with_their_file(tmp_path):
    file = tmp_path / "two.yaml"
    one = "{frames: [hand, foot], name: mount}"
    file.write_text(f"{{closed_loop: [], type: [], name_mot: [], bushings: [{one}, {one}]}}")
    with pytest.raises(ModelError, match=r"two\.yaml: bushings\[1\]: the bushing 'mount' is named twice"):
        p3dof.load_robot(text(), file)


def test_two_frames_on_one_body_are_named_with_the_line_of_the_file():
    with pytest.raises(
        ModelError, match=r"line \d+: <drake:linear_bushing_rpy>: expected two links that move"
    ):
        loaded(bushing(("on_hand", "hand"), LAWS[0]))
