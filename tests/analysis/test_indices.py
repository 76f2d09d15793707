"""Performance indices, each by a second way: own positions, complex steps, Lagrange, moved sliders.

Nothing but parameters is shared with the package in the second ways; J is that of own slider positions.
"""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from lagrange import LagrangeModel
from machines import SEEDS, positions, random_machine, random_states
from table_numbers import check_table, shows

import p3dof
from p3dof.analysis.indices import COLUMNS, DEFINITIONS, indices_table
from p3dof.analysis.reactions.stiffness import RodSection

ROBOT = p3dof.load()
ROUND = RodSection(diameter=0.02)
TABLE = {
    (0, 0, 0): {
        "sigma": [1.847759, 0.765367, 0.572078],
        "condition": 3.229910,
        "iti": [0.927025] * 3,
        "oti": [0.695269, 0.695269, 0.927025],
        "lti": 0.695269,
        "holding": [46.7853, 46.7853, 53.5567],
        "actuator_inertia": [4.17166, 5.12900, 30.23046],
        "gie": 0.141633,
        "rigid": [91.537, 222.231, 246.414],
        "elastic": [88.470, 217.178, 239.509],
        "acceleration_ball": 34.5168,
    },
    (0.1, 0, 0): {
        "sigma": [1.933972, 0.794749, 0.602873],
        "condition": 3.207928,
        "iti": [0.780625, 0.992157, 0.892679],
        "oti": [0.717676, 0.717676, 0.892679],
        "lti": 0.717676,
        "holding": [12.7920, 80.7785, 53.5567],
        "actuator_inertia": [4.08722, 4.83139, 25.97901],
        "gie": 0.138646,
        "rigid": [98.744, 228.973, 248.946],
        "elastic": [95.183, 223.675, 240.181],
        "acceleration_ball": 31.6825,
    },
    (0, 0, 0.5): {
        "sigma": [1.778335, 0.572078, 0.528711],
        "condition": 3.363529,
        "oti": [0.695269, 0.695269, 0.607696],
        "lti": 0.607696,
        "holding": [41.2843, 41.2843, 64.5587],
        "actuator_inertia": [4.66069, 8.67700, 30.23046],
        "gie": 0.131375,
        "rigid": [91.537, 170.858, 233.128],
        "elastic": [88.470, 167.556, 225.697],
        "acceleration_ball": 35.4343,
    },
    (0, 0, -0.5): {
        "sigma": [1.873971, 0.822827, 0.572078],
        "condition": 3.275728,
        "oti": [0.695269, 0.695269, 0.996610],
        "lti": 0.695269,
        "holding": [50.1395, 50.1395, 46.8482],
        "actuator_inertia": [4.15379, 5.03081, 30.23046],
        "gie": 0.167125,
        "rigid": [91.537, 224.389, 246.944],
        "elastic": [88.470, 217.407, 241.981],
        "acceleration_ball": 33.9332,
    },
    (0.1, 0, -0.5): {
        "sigma": [1.960688, 0.855985, 0.606643],
        "condition": 3.232027,
        "iti": [0.780625, 0.992157, 0.879196],
        "oti": [0.717676, 0.717676, 0.966024],
        "holding": [15.6975, 84.7940, 46.6358],
        "actuator_inertia": [4.11495, 4.63250, 26.06963],
        "gie": 0.164319,
        "rigid": [98.572, 233.837, 248.106],
        "elastic": [95.034, 224.980, 242.857],
        "acceleration_ball": 30.8296,
    },
    (0.2, 0, 0.7): {
        "sigma": [2.454534, 0.872807, 0.307670],
        "condition": 7.977823,
        "iti": [0.484123, 0.992157, 0.749551],
        "oti": [0.807622, 0.807622, 0.293833],
        "lti": 0.293833,
        "holding": [-14.6530, 75.5239, 86.2564],
        "actuator_inertia": [3.02058, 14.27611, 23.52871],
        "gie": 0.106309,
        "rigid": [103.758, 133.203, 289.584],
        "elastic": [100.276, 126.977, 264.876],
        "acceleration_ball": 35.1600,
    },
}


def own_jacobian(geometry, pose):
    steps = pose + 1e-30j * np.eye(3)
    return np.stack([positions(geometry, step)[0].imag / 1e-30 for step in steps], axis=-1)


def rod_directions(geometry, pose):
    sliders, joints = positions(geometry, pose)
    tops = np.array([[0, -geometry.R, sliders[0]], [0, geometry.R, sliders[1]], [geometry.R, 0, sliders[2]]])
    return (joints - tops) / geometry.L


def states(seed, count=4):
    machine = random_machine(seed)
    limits = p3dof.machine.Limits(travel=(-99, 99), speed=1.7, force=40 * machine.bodies.mass + 1)
    machine = replace(machine, limits=limits)
    pose = random_states(machine, seed, count, drop=0.2, angle=0.1).pose
    return p3dof.load(machine), LagrangeModel(machine), pose


@pytest.mark.parametrize("pose", TABLE)
def test_the_references_of_the_paper_s_machine(pose):
    known = dict(TABLE[pose])
    rigid, elastic = known.pop("rigid"), known.pop("elastic")
    found = ROBOT.indices(pose)
    for name, values in known.items():
        last = 5.1e-5 if name in ("holding", "acceleration_ball") else 5.1e-6 if "inertia" in name else 5.1e-7
        np.testing.assert_allclose(getattr(found, name), values, rtol=0, atol=last, err_msg=name)
    weightless = p3dof.load(replace(p3dof.PAPER, gravity=np.zeros(3)))
    np.testing.assert_allclose(weightless.indices(pose, rods=None).frequency, rigid, atol=5.1e-4)
    np.testing.assert_allclose(weightless.indices(pose, rods=ROUND).frequency, elastic, atol=5.1e-4)


def test_lone_capabilities_and_accuracy_at_home_are_the_references():
    found = ROBOT.indices([0, 0, 0])
    np.testing.assert_allclose(found.lone_velocity, [4.94413, 2, 20], rtol=1e-6)
    least, largest = found.lone_acceleration.reshape(2, 3)
    np.testing.assert_allclose(least, [-37.0612, -101.3538, -1143.65], rtol=1e-6)
    np.testing.assert_allclose(largest, [37.0612, 81.7418, 922.354], rtol=1e-6)
    np.testing.assert_allclose(found.accuracy, [2.472066, 1, 20], rtol=1e-6)
    shares = (
        found.frequency / p3dof.load(replace(p3dof.PAPER, gravity=np.zeros(3))).indices([0, 0, 0]).frequency
    )
    assert shares[0] - 1 == pytest.approx(4.5e-5, rel=0.1)  # gravity's stiffness


def test_the_best_length_is_not_the_default_one():
    assert ROBOT.indices([0, 0, 0]).length == p3dof.PAPER.geometry.r
    assert ROBOT.indices([0, 0, 0], 0.138287).condition == pytest.approx(3.12482, abs=1e-5)
    free = ("accuracy", "iti", "oti", "lti", "actuator_inertia", "lone_acceleration", "frequency")
    one, other = (ROBOT.indices([0.1, 0, -0.2], length) for length in (0.1, 0.7))
    for name in free:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_nothing_depends_on_z_and_the_sum_of_holding_forces_is_the_weight():
    rng = np.random.default_rng(4)
    pose = rng.uniform([-0.2, -0.5, -0.7], [0.2, 0.5, 0.8], (300, 3))
    found, low = ROBOT.indices(pose), ROBOT.indices(pose * [1, 0, 1])
    for name, values in found.columns.items():
        scale = np.abs(values).max()
        np.testing.assert_allclose(values, low.columns[name], rtol=0, atol=1e-10 * scale, err_msg=name)
    np.testing.assert_allclose(found.holding.sum(axis=-1), 147.127, atol=5e-4)


@settings(max_examples=20)
@given(SEEDS)
def test_kinematic_indices_are_those_of_complex_steps_and_moved_sliders(seed):
    robot, _, poses = states(seed)
    geometry, length = robot.parameters.geometry, 0.37 * robot.parameters.geometry.L
    found = robot.indices(poses, length)
    step = 1e-6 * geometry.L
    corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    for k, pose in enumerate(poses):
        J = own_jacobian(geometry, pose)
        np.testing.assert_allclose(found.determinant[k], scipy.linalg.det(J), rtol=1e-8)
        gram = J.T @ J / np.outer([1, 1, length], [1, 1, length])
        np.testing.assert_allclose(found.sigma[k][::-1] ** 2, scipy.linalg.eigvalsh(gram), rtol=1e-6)
        worst = np.abs(scipy.linalg.solve(J, corners.T)).max(axis=1)
        np.testing.assert_allclose(found.accuracy[k], worst, rtol=1e-8)
        np.testing.assert_allclose(
            found.lone_velocity[k] * np.abs(J).max(axis=0), robot.parameters.limits.speed, rtol=1e-9
        )
        np.testing.assert_allclose(
            np.abs(found.velocity_vertices[k] @ J.T), robot.parameters.limits.speed, rtol=1e-8
        )
        # transmission: rods from positions, velocities of the joints from sliders that are moved
        rods = rod_directions(geometry, pose)
        np.testing.assert_allclose(np.linalg.norm(rods, axis=1), 1, rtol=1e-12)
        np.testing.assert_allclose(found.iti[k], np.abs(rods[:, 2]), rtol=1e-9)
        sliders = positions(geometry, pose)[0]
        if abs(pose[2]) > 1.4 or found.actuation[k] < 0:
            continue  # forward kinematics is of home's side
        for leg in range(3):
            moved = [robot.forward_kinematics(sliders + side * step * np.eye(3)[leg]) for side in (1, -1)]
            joint = positions(geometry, moved[0])[1][leg] - positions(geometry, moved[1])[1][leg]
            share = abs(rods[leg] @ joint) / np.linalg.norm(joint)
            np.testing.assert_allclose(found.oti[k, leg], share, atol=2e-6)


@settings(max_examples=8)
@given(SEEDS)
def test_inertia_and_capabilities_are_those_of_lagrange_s_equations(seed):
    robot, lagrange, poses = states(seed)
    limit = robot.parameters.limits.force
    length = 0.4 * robot.parameters.geometry.L
    found = robot.indices(poses, length)
    still = np.zeros(3)
    for k, pose in enumerate(poses):
        J, M = lagrange.jacobian(pose), lagrange.mass_matrix(pose)
        assert found.reflected_mass[k] == pytest.approx(
            [np.linalg.solve(J, e) @ M @ np.linalg.solve(J, e) for e in np.eye(3)], rel=1e-8
        )
        np.testing.assert_allclose(found.actuator_inertia[k], scipy.linalg.eigvalsh(M, J.T @ J), rtol=1e-6)
        own = scipy.linalg.eigvalsh(M, np.diag([1, 1, length**2]))
        np.testing.assert_allclose(found.inertia_ellipsoid[k], own, rtol=1e-7)
        assert found.gie[k] == pytest.approx(own[0] / own[2], rel=1e-7)
        held = lagrange.forces(pose, still, still)
        np.testing.assert_allclose(found.holding[k], held, rtol=0, atol=1e-9 * np.abs(held).max())
        if np.abs(held).max() > limit:
            assert np.isnan(found.lone_acceleration[k]).all()
            assert np.isnan(found.acceleration_ball[k])
            continue
        for end in range(6):
            a = np.eye(3)[end % 3] * found.lone_acceleration[k, end]
            assert (a.sum() < 0) == (end < 3)
            assert np.abs(lagrange.forces(pose, still, a)).max() == pytest.approx(limit, rel=1e-8)
            load = np.eye(3)[end % 3] * found.lone_force[k, end]
            wrench = -np.array([0, load[0], load[1], 0, load[2], 0])  # what the surroundings push back
            assert np.abs(lagrange.forces(pose, still, still, wrench)).max() == pytest.approx(limit, rel=1e-8)
        ways = np.random.default_rng(seed).normal(size=(200, 3))
        rows = np.linalg.solve(J.T, M / [1, 1, length])  # the ball touches its bounds along these
        ways = np.concatenate([ways, rows, -rows])
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        still_too = np.zeros_like(ways)
        poses_too = np.tile(pose, (len(ways), 1))
        forces = lagrange.forces(poses_too, still_too, found.acceleration_ball[k] * ways / [1, 1, length])
        assert np.abs(forces).max() == pytest.approx(limit, rel=1e-8)
        corner = lagrange.forces(np.tile(pose, (8, 1)), np.zeros((8, 3)), found.acceleration_vertices[k])
        np.testing.assert_allclose(np.abs(corner), limit, rtol=1e-7)
        y, z, moment = found.force_vertices[k].T
        back = -np.stack([0 * y, y, z, 0 * y, moment, 0 * y], axis=-1)
        corner = lagrange.forces(np.tile(pose, (8, 1)), np.zeros((8, 3)), np.zeros((8, 3)), back)
        np.testing.assert_allclose(np.abs(corner), limit, rtol=1e-7)


@settings(max_examples=8)
@given(SEEDS)
def test_dynamic_manipulability_is_the_volume_of_accelerations_by_that_of_forces(seed):
    robot, _, poses = states(seed, 2)
    found = robot.indices(poses).dynamic_manipulability
    for pose, value in zip(poses, found, strict=True):
        scale = robot.parameters.bodies.mass
        rest = robot.forward_dynamics(pose, np.zeros(3), np.zeros(3))
        columns = [robot.forward_dynamics(pose, np.zeros(3), scale * e) - rest for e in np.eye(3)]
        assert value == pytest.approx(abs(np.linalg.det(columns)) / scale**3, rel=1e-6)


@settings(max_examples=12)
@given(SEEDS)
def test_frequencies_are_those_of_a_perturbed_equilibrium(seed):
    """K by differences of what pulls back when the pose is moved with the drives held."""
    robot, lagrange, poses = states(seed, 2)
    geometry = robot.parameters.geometry
    drives = np.array([1e3, 2e3, 1.5e3]) * robot.parameters.bodies.mass / geometry.L
    rods = RodSection(diameter=0.002 * geometry.L, young=drives[0] / geometry.L * 1e6)
    found = robot.indices(poses, drive_stiffness=drives, rods=rods).frequency
    area = np.pi * (0.001 * geometry.L) ** 2
    for pose, values in zip(poses, found, strict=True):
        iti = np.abs(rod_directions(geometry, pose)[:, 2])
        k = 1 / (1 / drives + geometry.L / (rods.young * area * np.array([1, 1, 2]) * iti**2))
        held, start = lagrange.forces(pose, np.zeros(3), np.zeros(3)), positions(geometry, pose)[0]

        def pull(x, k=k, held=held, start=start):
            forces = held - k * (positions(geometry, x)[0] - start)
            return (
                lagrange.generalized_forces(x, np.zeros(3), np.zeros(3))
                - own_jacobian(geometry, x).T @ forces
            )

        steps = np.diag([geometry.L, geometry.L, 1.0]) * 1e-6
        K = np.stack([(pull(pose + s) - pull(pose - s)) / (2 * s.sum()) for s in steps], axis=-1)
        squares = scipy.linalg.eigvalsh((K + K.T) / 2, lagrange.mass_matrix(pose))
        np.testing.assert_allclose(K, K.T, atol=1e-5 * np.abs(K).max())
        stable = squares > 0  # upside down it falls over: no frequency
        assert np.isnan(values[~stable]).all()
        scale = np.abs(squares).max()
        np.testing.assert_allclose((2 * np.pi * values[stable]) ** 2, squares[stable], atol=1e-6 * scale)


@settings(max_examples=6)
@given(SEEDS)
def test_armature_and_balance_at_the_sliders_are_in_the_indices(seed):
    plain, lagrange, poses = states(seed, 3)
    geometry, mass = plain.parameters.geometry, plain.parameters.bodies.mass
    armature, spring = mass * np.array([0.3, 0.1, 0.2]), mass / geometry.L * np.array([20.0, 30.0, 10.0])
    push = 4 * mass * np.array([0.5, 0.2, 0.3])
    slides = ("slide_a", "slide_b", "slide_c")
    named = [dict(zip(slides, values.tolist(), strict=True)) for values in (armature, push, spring)]
    actuators = p3dof.machine.Actuators(armature=named[0], counterbalance=named[1], spring=named[2])
    robot = p3dof.load(replace(plain.parameters, actuators=actuators))
    k = mass / geometry.L * 1e3
    found = robot.indices(poses, drive_stiffness=k, rods=None)
    bare = plain.indices(poses)
    sliders = np.array([positions(geometry, pose)[0] for pose in poses])
    np.testing.assert_allclose(
        found.reflected_mass - bare.reflected_mass, np.tile(armature, (3, 1)), rtol=1e-6
    )
    scale = np.abs(bare.holding).max() + np.abs(push).max()
    np.testing.assert_allclose(
        found.holding, bare.holding + spring * sliders - push, rtol=0, atol=1e-9 * scale
    )
    for n, pose in enumerate(poses):
        J, M = lagrange.jacobian(pose), lagrange.mass_matrix(pose)
        M = M + J.T @ np.diag(armature) @ J
        np.testing.assert_allclose(found.actuator_inertia[n], scipy.linalg.eigvalsh(M, J.T @ J), rtol=1e-6)
        held = found.holding[n]

        def pull(x, held=held, start=sliders[n]):
            now = positions(geometry, x)[0]
            forces = held - k * (now - start) + push - spring * now
            return (
                lagrange.generalized_forces(x, np.zeros(3), np.zeros(3))
                - own_jacobian(geometry, x).T @ forces
            )

        steps = np.diag([geometry.L, geometry.L, 1.0]) * 1e-6
        K = np.stack([(pull(pose + s) - pull(pose - s)) / (2 * s.sum()) for s in steps], axis=-1)
        squares = scipy.linalg.eigvalsh((K + K.T) / 2, M)
        stable = squares > 0
        np.testing.assert_allclose(
            (2 * np.pi * found.frequency[n][stable]) ** 2, squares[stable], atol=1e-6 * np.abs(squares).max()
        )


def test_invalid_poses_are_nan_with_a_reason_or_raise():
    poses = [[0, 0, 0], [0.3, 0, 0], [0, 0, np.pi / 3], [np.nan, 0, 0]]
    found = ROBOT.indices(poses, on_invalid="nan")
    assert found.reason.tolist() == ["", "serial A", "actuation", "not finite"]
    assert found.valid.tolist() == [True, False, False, False]
    for name, values in found.columns.items():
        assert np.isfinite(values[0]), name
        assert np.isnan(values[3]), name
    assert np.isnan(found.lti[1:]).all()
    with pytest.raises(p3dof.errors.ReachError, match=r"leg A is too short by 0.05 m"):
        ROBOT.indices([0.3, 0, 0])
    with pytest.raises(p3dof.errors.SingularityError, match=r"sample 2"):
        ROBOT.indices([poses[0], poses[0], poses[2]])


def test_what_does_not_fit_is_refused():
    home = np.zeros(3)
    with pytest.raises(p3dof.InputError, match=r"length: expected a positive number, got -1"):
        ROBOT.indices(home, -1)
    with pytest.raises(p3dof.InputError, match=r"drive_stiffness: expected a positive number, or three"):
        ROBOT.indices(home, drive_stiffness=[1, 2])
    with pytest.raises(p3dof.InputError, match=r"rods: expected a RodSection or None, got 3"):
        ROBOT.indices(home, rods=3)
    with pytest.raises(p3dof.InputError, match=r"index: expected one of determinant, .*; got 'lit'"):
        ROBOT.indices(home).column("lit")


def test_near_impossible_machines_have_extreme_but_finite_indices():
    """R nearly r: A and B are parallel at home. A leg hardly longer than R - r: it is horizontal."""
    narrow = p3dof.machine.Geometry(r=0.25 - 1e-6, R=0.25, L=0.4)
    flat = p3dof.machine.Geometry(r=0.1, R=0.25, L=0.150001)
    for geometry, sign in ((narrow, "oti"), (flat, "iti")):
        found = p3dof.load(replace(p3dof.PAPER, geometry=geometry)).indices([0, 0, 0])
        J = own_jacobian(geometry, np.zeros(3))
        assert getattr(found, sign)[0] < 0.01
        assert found.condition > 300
        np.testing.assert_allclose(found.jacobian, J, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(found.accuracy, np.abs(np.linalg.inv(J)).sum(axis=1), rtol=1e-6)
        assert np.isfinite([float(v) for v in found.columns.values()]).mean() > 0.7
        assert found.lti < 0.01


def test_a_notebook_shows_indices():
    html = ROBOT.indices([0, 0, 0])._repr_html_()
    assert "3.22991" in html
    over = ROBOT.indices(np.zeros((9, 3)))._repr_html_()
    assert "largest" in over


def test_every_index_has_its_definition_and_shape():
    found = ROBOT.indices(np.zeros((2, 5, 3)))
    for name, one in DEFINITIONS.items():
        values = getattr(found, name)
        assert values.shape == ((2, 5, len(one.parts)) if one.parts else (2, 5)), name
        assert len(one.unit.split(", ")) in {1, len(one.parts)}, name
        assert one.meaning
    assert set(found.columns) == set(COLUMNS)
    assert ROBOT.indices([0, 0, 0]).lti.shape == ()
    assert len(found) == 2


@shows("p3dof.analysis.indices.definitions.indices_table")
def test_the_table_has_indices_at_few_poses_and_their_range_over_more():
    geometry = ROBOT.parameters.geometry
    poses = np.array([[0.1, 0.05, -0.5], [0, 0, 0.5], [0.05, 0, 0.2], [-0.1, 0, 0], [0.12, 0, 0.3],
                      [0, 0, -0.4], [0.02, 0, 0.1], [0.3, 0, 0]])  # fmt: skip
    length, wanted = 0.08, []
    for pose in poses[:-1]:
        J = own_jacobian(geometry, pose)
        values = np.linalg.svd(J @ np.diag([1, 1, 1 / length]), compute_uv=False)
        drops = -rod_directions(geometry, pose)[:, 2]
        wanted.append([values[2] / values[0], *drops, np.abs(np.linalg.inv(J)).sum(axis=1)[2]])
    wanted = np.array([*wanted, [np.nan] * 5])
    names, units = ("lci", "iti_a", "iti_b", "iti_c", "accuracy_theta"), ("1", "1", "1", "1", "rad/m")

    def table(some):
        found = ROBOT.indices(some, length=length, on_invalid="nan")
        return indices_table(found, {name: found.column(name) for name in names})

    check_table(
        table(poses[[0, 1, 7]]),
        {name: (*wanted[[0, 1, 7], k], units[k]) for k, name in enumerate(names)},
        title=(80, " mm"),
        header=(100, 50, -28.65, 0, 0, 28.65, 300, 0, 0),
        note=(300, 0, 0, "serial A"),
    )
    good = wanted[:-1]
    ranges = {
        name: (good[:, k].min(), good[:, k].sum() / 7, good[:, k].max(), units[k])
        for k, name in enumerate(names)
    }
    check_table(table(poses), ranges, title=(80, "over", 8), note=(300, 0, 0, "serial A"))
