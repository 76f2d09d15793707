"""The facade: both dynamics agree, results carry their evidence, every bad input raises one clear error."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from hypothesis import given, settings
from lagrange import LagrangeModel
from machines import SEEDS, conditioning, random_machine, random_states

import p3dof
from p3dof import methods
from p3dof._base.errors import (
    DynamicsError,
    InputError,
    ParameterError,
    ReachError,
    SampleError,
    SingularityError,
)
from p3dof._base.samples import ACTUATION_TOLERANCE
from p3dof.loops.batch.traced import TracedLoops
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import PAPER, SOLIDS, Body, Limits
from p3dof.methods import JointStates

HOME = np.zeros(3)
METHODS = ("pinocchio", "virtual-power")
CLAIMED = 1e-12
"""What README and documentation say of random machines: of the largest force, times the conditioning."""


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module", params=["paper", "solids"])
def both(request):
    """Both results over the paper's motion."""
    machine = p3dof.load(PAPER if request.param == "paper" else SOLIDS)
    motion = p3dof.paper_motion(1001)
    return machine, *(machine.inverse_dynamics(motion, method=method) for method in METHODS)


def test_methods_agree_over_the_papers_motion(both):
    _, first, second = both
    assert np.abs(first.forces - second.forces).max() <= 1e-13 * np.abs(second.forces).max()
    for name in ("q", "v", "a"):
        one, other = getattr(first.joints, name), getattr(second.joints, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * max(1, np.abs(other).max()))
    assert first.joints.names == second.joints.names


def test_third_derivation_agrees_over_the_papers_motion(both):
    machine, first, _ = both
    m = first.motion
    expected = LagrangeModel(machine.parameters).forces(m.pose, m.velocity, m.acceleration)
    assert np.abs(first.forces - expected).max() <= 1e-13 * np.abs(expected).max()


def test_loops_are_closed_and_power_is_balanced(both):
    for result in both[1:]:
        assert result.closure_error.max() <= 1e-14
        assert np.abs(result.power_residual).max() <= 1e-13 * np.abs(result.power).max()


def test_energy_balance_is_that_of_lagrange(both):
    """∫ power = change of T + V, with T and V from the third derivation."""
    machine, first, _ = both
    model, m = LagrangeModel(machine.parameters), first.motion
    energy = model.energy(m.pose, m.velocity)
    t, h = m.time, m.time[1] - m.time[0]
    simpson = h / 3 * (first.power[0::2][:-1] + 4 * first.power[1::2] + first.power[2::2]).sum()
    assert t[-1] == 1
    assert simpson == pytest.approx(energy[-1] - energy[0], abs=1e-9)


@settings(max_examples=12)
@given(SEEDS)
def test_methods_agree_on_random_machines(seed):
    """Machines without symmetry over two decades of size; random states and wrenches."""
    machine = p3dof.load(random_machine(seed))
    s = random_states(machine.parameters, seed, 6)
    results = [
        machine.forces(s.pose, s.velocity, s.acceleration, method=method, wrench=s.wrench)
        for method in METHODS
    ]
    allowed = CLAIMED * conditioning(machine.parameters.geometry, s.pose) * np.abs(results[1]).max(axis=-1)
    assert np.all(np.abs(results[0] - results[1]).max(axis=-1) <= allowed)


@pytest.mark.parametrize("page", ["README.md", "docs/explanation/two-ways.md"])
def test_what_is_claimed_of_random_machines_is_what_is_tested(page):
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    claims = re.findall(r"differ by less than (\S+) of the largest force times the conditioning", text)
    assert [float(claim) for claim in claims] == [CLAIMED]


def test_what_is_said_of_the_inertia_of_rods_is_so():
    """Of a cylinder 20 mm thick and of a thin rod, of the printed mass, against the printed inertia."""
    text = " ".join((ROOT / "docs/explanation/assumptions.md").read_text(encoding="utf-8").split())
    (told,) = re.findall(r"by at most (\S+) N \(a cylinder 20 mm thick\) or (\S+) N \(a thin rod\)", text)
    motion, length = p3dof.paper_motion(101), PAPER.geometry.L
    printed = p3dof.load().inverse_dynamics(motion, method="virtual-power").forces
    for claim, radius in zip(told, (0.01, 0.0), strict=True):
        leg = PAPER.bodies.leg_a
        across = leg.mass * (length**2 / 12 + radius**2 / 4)
        rod = Body(leg.mass, leg.com, [leg.mass * radius**2 / 2, across, across])
        rods = dict.fromkeys(("leg_a", "leg_b", "rod_left", "rod_right"), rod)
        machine = p3dof.load(replace(PAPER, bodies=replace(PAPER.bodies, **rods)))
        changed = machine.inverse_dynamics(motion, method="virtual-power").forces - printed
        assert f"{np.abs(changed).max():.3f}" == claim


@settings(max_examples=10)
@given(SEEDS)
def test_methods_agree_near_singular_poses(seed):
    machine = p3dof.load(random_machine(seed))
    near = {"drop": 0.1, "angle": 0.01}
    s = random_states(machine.parameters, seed, 4, drop=0.01, angle=1e-4, near=near)
    results = [machine.forces(s.pose, s.velocity, s.acceleration, method=method) for method in METHODS]
    allowed = CLAIMED * conditioning(machine.parameters.geometry, s.pose) * np.abs(results[1]).max(axis=-1)
    assert np.all(np.abs(results[0] - results[1]).max(axis=-1) <= allowed)


@pytest.mark.fuzz
@settings(max_examples=3000)
@given(SEEDS)
def test_methods_agree_on_very_many_random_machines(seed):
    test_methods_agree_on_random_machines.hypothesis.inner_test(seed)
    test_methods_agree_near_singular_poses.hypothesis.inner_test(seed)


def test_forward_dynamics_of_inverse_dynamics_returns_the_acceleration(robot):
    s = random_states(PAPER, 4, 40)
    result = [robot.forces(s.pose, s.velocity, s.acceleration, method=m) for m in METHODS]
    for i in range(len(s.pose)):
        motion = robot.mechanism_motion(s.pose[i], s.velocity[i], s.acceleration[i])
        q, v, a = (
            np.array([values[name] for name in robot.model.names[1:]])
            for values in (motion.position, motion.velocity, motion.acceleration)
        )
        for forces in result:
            found = robot.loop.forward_dynamics(q, v, forces[i]).a
            np.testing.assert_allclose(found, a, rtol=0, atol=1e-11 * np.abs(a).max())


def test_the_motion_of_the_mechanism_takes_a_motion(robot):
    motion = p3dof.paper_motion(11)
    one = robot.mechanism_motion(motion)
    other = robot.mechanism_motion(motion.pose, motion.velocity, motion.acceleration)
    joints = robot.inverse_dynamics(motion).joints
    for name, values in one.position.items():
        np.testing.assert_array_equal(values, other.position[name])
        if name in joints.names:
            k = joints.names.index(name)
            np.testing.assert_allclose(values, joints.q[:, k], rtol=0, atol=1e-12)
            np.testing.assert_allclose(one.acceleration[name], joints.a[:, k], rtol=0, atol=1e-11)
    with pytest.raises(InputError, match="mechanism_motion: a motion has its own velocities"):
        robot.mechanism_motion(motion, motion.velocity)
    for more in ((), (motion.velocity,)):
        with pytest.raises(InputError, match="expected a motion, or poses, velocities and accelerations"):
            robot.mechanism_motion(motion.pose, *more)


def test_independence_of_width(robot):
    wide = p3dof.load(replace(PAPER, geometry=replace(PAPER.geometry, b=0.2)))
    s = random_states(PAPER, 6, 20)
    one, other = (m.forces(s.pose, s.velocity, s.acceleration) for m in (robot, wide))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * np.abs(one).max())


def test_gravity_reaches_pinocchio():
    gravity = np.array([1.0, -2.0, 3.0])
    machine = p3dof.load(replace(PAPER, gravity=gravity))
    np.testing.assert_array_equal(machine.model.gravity.linear, gravity)
    f = [machine.forces([0.05, 0.01, 0.2], HOME, HOME, method=m) for m in METHODS]
    np.testing.assert_allclose(*f, rtol=1e-13)


def test_jacobian_maps_forces_to_the_platform(robot):
    """A wrench on the platform is balanced by forces with Jᵀ Δf = -(F_y, F_z, M_y), in both methods."""
    pose, wrench = [0.07, -0.03, 0.4], np.arange(1.0, 7.0)
    for method in METHODS:
        free, loaded = (robot.forces(pose, HOME, HOME, method=method, wrench=w) for w in (None, wrench))
        balance = robot.jacobian(pose, method="virtual-power").T @ (loaded - free)
        np.testing.assert_allclose(balance, [-2.0, -3.0, -5.0], rtol=0, atol=1e-12)


def test_wrench_enters_the_power_balance(robot):
    motion = p3dof.paper_motion(51)
    for method in METHODS:
        result = robot.inverse_dynamics(motion, method=method, wrench=[1, 20, -30, 4, 5, 6])
        assert np.abs(result.power_residual).max() <= 1e-13 * np.abs(result.power).max()
        bare = robot.inverse_dynamics(motion, method=method)
        assert np.abs(result.power - bare.power).max() > 1


def test_result_of_forward_and_inverse_kinematics(robot, both):
    first = both[1]
    np.testing.assert_allclose(
        first.sliders, robot.inverse_kinematics(first.motion.pose).sliders, rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(robot.forward_kinematics(first.sliders), first.motion.pose, rtol=0, atol=1e-13)
    speeds = np.einsum(
        "nij,nj->ni", robot.jacobian(first.motion.pose, method="virtual-power"), first.motion.velocity
    )
    np.testing.assert_allclose(first.slider_velocities, speeds, rtol=0, atol=1e-12)
    assert first.slider_accelerations.shape == (1001, 3)


def test_plain_pinocchio_objects(robot):
    assert isinstance(robot.model, pin.Model)
    assert len(robot.constraint_models) == 3
    assert isinstance(robot.visual_model, pin.GeometryModel)
    assert robot.visual_model.ngeoms > robot.model.njoints
    assert robot.collision_model.ngeoms > 0
    assert robot.loop.mobility(pin.neutral(robot.model)) == 3
    assert "<robot" in robot.urdf
    data = robot.model.createData()
    q = robot.inverse_dynamics(p3dof.paper_motion(3)).joints.q[1]  # in the model's own order
    pin.framesForwardKinematics(robot.model, data, q)
    center = data.oMf[robot.model.getFrameId("platform_center")].translation
    pose = p3dof.paper_motion(3).pose[1]
    np.testing.assert_allclose(center, [0, pose[0], pose[1] - PAPER.geometry.h], rtol=0, atol=1e-14)


def test_order_of_samples_does_not_matter(robot):
    """Each sample stands for itself although the solver starts from its neighbour.

    From another neighbour the joints differ by rounding, 2e-16 or so; the poses amplify it up to 44-fold,
    and the forces are differences of larger ones. The closed forms know no neighbour.
    """
    s = random_states(PAPER, 12, 60, drop=0.15)
    forward, backward = (
        {
            method: robot.forces(s.pose[i], s.velocity[i], s.acceleration[i], method=method)[i]
            for method in METHODS
        }
        for i in (slice(None), slice(None, None, -1))
    )
    np.testing.assert_array_equal(forward["virtual-power"], backward["virtual-power"])
    largest = np.abs(forward["pinocchio"]).max(axis=-1)
    allowed = 5e-14 * conditioning(PAPER.geometry, s.pose) * largest
    assert np.all(np.abs(forward["pinocchio"] - backward["pinocchio"]).max(axis=-1) <= allowed)
    well = conditioning(PAPER.geometry, s.pose) < 2
    assert well.sum() > 5
    assert np.abs(forward["pinocchio"] - backward["pinocchio"])[well].max() <= 1e-14 * largest.max()


def test_batches_and_single_samples(robot):
    s = random_states(PAPER, 2, 6)
    for method in METHODS:
        forces = robot.forces(s.pose.reshape(2, 3, 3), s.velocity.reshape(2, 3, 3), HOME, method=method)
        assert forces.shape == (2, 3, 3)
        one = robot.forces(s.pose[4], s.velocity[4], HOME, method=method)
        assert one.shape == (3,)
        np.testing.assert_allclose(forces[1, 1], one, rtol=0, atol=1e-10)
        assert robot.forces(np.zeros((0, 3)), HOME, HOME, method=method).shape == (0, 3)


@pytest.mark.parametrize("method", METHODS)
def test_invalid_samples(robot, method):
    poses = np.zeros((5, 3))
    poses[1, 0], poses[2, 2] = 0.3, np.pi / 3
    with pytest.raises(ReachError, match=r"leg A is too short by 0\.05 m \(sample 1, the first of 1"):
        robot.forces(poses, HOME, HOME, method=method)
    with pytest.raises(SingularityError, match="sample 0, the first of 1"):
        robot.forces(poses[2:3], HOME, HOME, method=method)
    velocity = np.zeros((5, 3))
    velocity[4, 0] = np.nan
    forces = robot.forces(poses, velocity, HOME, method=method, on_invalid="nan")
    assert np.isnan(forces[[1, 2, 4]]).all()
    assert np.isfinite(forces[[0, 3]]).all()
    motion = p3dof.Motion(np.arange(5.0), poses, np.zeros((5, 3)), np.zeros((5, 3)), check=False)
    result = robot.inverse_dynamics(motion, method=method, on_invalid="nan")
    assert result.valid.tolist() == [True, False, False, True, True]
    assert np.isnan(result.closure_error[[1, 2]]).all()
    assert not result.possible
    assert np.isnan([result.peak_forces, result.rms_forces]).all()  # the largest one may be in between
    assert "2 of 5 samples are invalid and left NaN" in " ".join(result.warnings)
    with pytest.raises(ReachError, match="sample 1"):
        robot.inverse_dynamics(motion, method=method)


@settings(max_examples=20)
@given(SEEDS)
def test_methods_agree_on_what_is_valid_near_the_singularity(seed):
    """Twice the threshold away both give forces; half of it away both leave NaN, and nothing raises."""
    machine = p3dof.load(random_machine(seed))
    g = machine.parameters.geometry
    singular = np.arccos(g.R / (g.r + g.L))
    poses = np.zeros((2, 3))
    per_theta = 1 + g.r / g.L  # rate of the singular angle θ + β with θ, where it is a right angle
    poses[:, 2] = singular - np.array([2.0, 0.5]) * ACTUATION_TOLERANCE / per_theta
    for method in METHODS:
        forces = machine.forces(poses, HOME, HOME, method=method, on_invalid="nan")
        assert np.isfinite(forces).all(axis=-1).tolist() == [True, False]


def test_samples_that_pinocchio_cannot_solve_are_invalid_too(monkeypatch):
    """What only the Pinocchio route finds out is told with its sample, or left NaN."""
    monkeypatch.setattr(TracedLoops, "_choose", lambda _: False)  # which leaves them all to the general way
    robot = p3dof.load()
    real = robot.loop.inverse_dynamics_batch

    def failing(*args, **kwargs):
        found = real(*args, **kwargs)
        found.tau[1] = np.nan
        return replace(found, errors={1: DynamicsError("the solver gave up")})

    monkeypatch.setattr(robot.loop, "inverse_dynamics_batch", failing)
    forces = robot.forces(np.zeros((3, 3)), HOME, HOME, on_invalid="nan")
    assert np.isnan(forces).all(axis=-1).tolist() == [False, True, False]
    with pytest.raises(SampleError, match="sample 1: the solver gave up") as info:
        robot.forces(np.zeros((3, 3)), HOME, HOME)
    assert info.value.index == (1,)


def test_a_result_without_a_valid_sample_has_no_peaks(robot):
    poses = np.full((3, 3), 3.0)
    motion = p3dof.Motion(np.arange(3.0), poses, 0 * poses, 0 * poses, check=False)
    result = robot.inverse_dynamics(motion, method="virtual-power", on_invalid="nan")
    assert result.peak_forces.shape == (3,)
    assert np.isnan(result.peak_forces).all()
    assert np.isnan(result.rms_forces).all()


def test_crossing_an_actuation_singularity_is_told(robot):
    theta = np.arange(0, 1.95, 0.1)
    pose = np.column_stack([0 * theta, 0 * theta, theta])
    motion = p3dof.Motion.from_poses(theta, pose)
    told = "after t = 1 s the motion crosses an actuation singularity: no force can do that"
    for method in ("pinocchio", "virtual-power", "compiled"):
        with pytest.raises(SingularityError, match=told) as info:
            robot.inverse_dynamics(motion, method=method)
        assert info.value.index == (10,)
        result = robot.inverse_dynamics(motion, method=method, on_invalid="nan")
        np.testing.assert_allclose(result.crossings, [1.0])  # 1.0472 rad = 60° is singular
        assert np.flatnonzero(~result.valid).tolist() == [10, 11]
        assert np.isnan([result.peak_forces, result.rms_forces]).all()
        assert result.warnings[0] == told
    assert len(robot.inverse_dynamics(p3dof.paper_motion(51), method="virtual-power").crossings) == 0


@pytest.mark.parametrize("geometry", [PAPER.geometry, p3dof.machine.Geometry(r=0.0177, R=0.04746, L=0.0782)])
def test_a_sample_does_not_depend_on_the_one_before(geometry):
    """Poses over the whole reach in random order: between two of them the straight path may leave it."""
    machine = p3dof.load(replace(PAPER, geometry=geometry))
    pose = random_states(machine.parameters, 3, 600, drop=0.02, angle=1e-3).pose
    first, second = (machine.forces(pose, HOME, HOME, method=method) for method in METHODS)
    allowed = 1e-12 * conditioning(geometry, pose) * np.abs(second).max(axis=-1)
    assert np.all(np.abs(first - second).max(axis=-1) <= allowed)


def test_a_path_that_leaves_the_reach_does_not_end_in_another_assembly(robot):
    pair = [[-0.006404, -0.039832, -0.711078], [0.225165, -0.089163, 2.493751]]
    forces = robot.forces(pair, HOME, HOME)
    np.testing.assert_allclose(forces[1], robot.forces(pair[1], HOME, HOME), rtol=1e-10)
    np.testing.assert_allclose(forces[1], [-4.224, 129.167, 22.184], atol=1e-3)


def test_the_machine_of_a_manipulator_cannot_be_exchanged(robot):
    with pytest.raises(AttributeError):
        robot.parameters = SOLIDS


def test_unheld_pose_is_fine_for_kinematics(robot):
    pose = [0, 0, np.pi / 3]
    assert np.isfinite(robot.inverse_kinematics(pose).sliders).all()
    assert np.isfinite(robot.jacobian(pose, method="virtual-power")).all()


def test_pinocchio_follows_the_working_assembly_everywhere(robot):
    """Poses far from home, past the actuation singularity, in random order: joints equal the closed form."""
    s = random_states(PAPER, 21, 60)
    states = states_of(s.pose, s.velocity, s.acceleration)
    first, second = (methods.METHODS[name](robot).solve(states) for name in METHODS)
    difference = np.angle(np.exp(1j * (first.joints.q - second.joints.q)))
    assert np.abs(difference).max() < 1e-11


def test_limits(robot):
    result = robot.inverse_dynamics(p3dof.paper_motion(101), method="virtual-power")
    assert result.exceedances(PAPER.limits) == []
    tight = Limits(travel=(-0.01, 0.01), speed=0.1, force=60, tilt=(-0.1, 0.5))
    found = result.exceedances(tight)
    assert {e.quantity for e in found} == {"travel", "speed", "force", "tilt"}
    tilt = found[-1]
    assert tilt.leg == "platform"
    assert tilt.limit == -0.1
    assert tilt.value == pytest.approx(-0.4, abs=1e-3)
    assert str(found[0]).startswith("travel of slider A: ")


def test_peak_and_rms(robot):
    result = robot.inverse_dynamics(p3dof.paper_motion(1001), method="virtual-power")
    np.testing.assert_allclose(result.peak_forces, np.abs(result.forces).max(axis=0))
    time = np.concatenate([np.linspace(0, 0.5, 20), np.linspace(0.5, 1, 2000)[1:]])  # uneven steps
    uneven = robot.inverse_dynamics(p3dof.paper_motion(20_001).resampled(time), method="virtual-power")
    fine = robot.inverse_dynamics(p3dof.paper_motion(20_001), method="virtual-power")
    exact = np.sqrt(np.mean(fine.forces[:-1] ** 2, axis=0))
    np.testing.assert_allclose(fine.rms_forces, exact, rtol=1e-4)
    np.testing.assert_allclose(uneven.rms_forces, exact, rtol=1e-2)
    one = robot.inverse_dynamics(p3dof.paper_motion(1001)[5:6], method="virtual-power")
    np.testing.assert_array_equal(one.rms_forces, one.peak_forces)


def test_csv_of_a_result(robot, tmp_path):
    result = robot.inverse_dynamics(p3dof.paper_motion(11))
    path = result.to_csv(tmp_path / "ä b" / "forces.csv")
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert path.read_text(encoding="utf-8").startswith(
        "t [s],fA [N],fB [N],fC [N],y [m],z [m],theta [rad],slider A [m]"
    )
    np.testing.assert_array_equal(table[:, 0], result.time)
    np.testing.assert_array_equal(table[:, 1:4], result.forces)
    np.testing.assert_array_equal(table[:, 4:7], result.motion.pose)
    np.testing.assert_array_equal(table[:, 7:10], result.sliders)


def test_progress_is_told(robot):
    seen = []
    robot.inverse_dynamics(p3dof.paper_motion(7), progress=lambda done, total: seen.append((done, total)))
    assert seen == [(0, 7), (7, 7)]
    seen.clear()
    robot.inverse_dynamics(p3dof.paper_motion(2500), progress=lambda done, total: seen.append((done, total)))
    assert seen == [(0, 2500), (1024, 2500), (2048, 2500), (2500, 2500)]


def test_load(tmp_path):
    assert p3dof.load().parameters is PAPER
    assert p3dof.load(SOLIDS).parameters is SOLIDS
    p3dof.write_parameters(SOLIDS, tmp_path / "machine.yaml")
    machine = p3dof.load(tmp_path / "machine.yaml")
    assert machine.parameters.bodies.platform.mass == SOLIDS.bodies.platform.mass
    assert repr(machine) == "Manipulator(r=0.1, R=0.25, L=0.4, moving mass 15.494 kg)"
    (tmp_path / "bad.yaml").write_text("geometry: 3", encoding="utf-8")
    with pytest.raises(ParameterError, match=r"bad\.yaml"):
        p3dof.load(tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda r: r.forces(HOME, HOME, HOME, method="matlab"),
            "method: expected one of 'pinocchio', 'virtual-power', 'compiled'",
        ),
        (lambda r: r.inverse_dynamics(p3dof.paper_motion(5), method="adams"), "method: expected"),
        (lambda r: r.inverse_dynamics(HOME), "motion: expected a Motion, got a ndarray"),
        (lambda r: r.forces(HOME, HOME, HOME, on_invalid="skip"), "on_invalid: expected"),
        (lambda r: r.forces([0, 0], HOME, HOME), "pose: expected shape"),
        (lambda r: r.forces(HOME, HOME, HOME, wrench=[1, 2]), "wrench: expected shape"),
        (
            lambda r: r.inverse_dynamics(p3dof.paper_motion(5), wrench=np.zeros((4, 6))),
            "wrench: expected shape",
        ),
        (lambda r: r.forces(HOME, [np.nan, 0, 0], HOME), "velocity: expected finite"),
        (lambda _: p3dof.load(123), "parameters: expected Parameters, got int"),
        (lambda _: p3dof.Manipulator("paper"), "parameters: expected Parameters, got str"),
    ],
)
def test_bad_input(robot, call, words):
    with pytest.raises(InputError, match=words):
        call(robot)


def test_joint_states_reorder():
    states = JointStates(("a", "b"), *(np.array([[1.0, 2.0]]) * k for k in (1, 2, 3)))
    swapped = states.columns(("b", "a"))
    assert swapped.q.tolist() == [[2.0, 1.0]]
    assert swapped.a.tolist() == [[6.0, 3.0]]


def test_names_of_the_package_exist():
    for name in p3dof.__all__:
        assert getattr(p3dof, name) is not None
