"""Reactions of elastic joints: published numbers, springs between bodies, symmetry, limits, files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_forces import S1, Bookkeeping, components, motion_of, random_stiffness, transmitted
from lagrange import BODIES
from machines import random_machine, random_states

import p3dof
from p3dof._base.errors import InputError, ModelError, ParameterError
from p3dof.analysis.reactions import (
    JOINTS,
    HingeStiffness,
    Misfit,
    RodSection,
    SlideStiffness,
    Stiffness,
    open_tables,
    reactions_table,
    read_stiffness,
)
from p3dof.analysis.reactions.results import cuts
from p3dof.cli import main
from p3dof.loops import ReactionSolver
from p3dof.loops.compliance import JointCompliance, beam
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import PAPER, Body, Friction

# Largest components with their sign over the paper's motion, 1,001 samples: fx fy fz [N], mx my mz [N m];
# found by springs between ten bodies and by an independent multibody program.
REFERENCE = """
slide_a         13.0573 -40.9554 118.4980 0 -4.8099 -1.6620
hinge_a         -113.0263 13.0573 -2.9721 -.8206 0 4.9068
slide_b         13.3607 18.0567 65.5672 0 -4.9926 1.0935
hinge_b         -56.3267 13.3607 2.6870 .8304 0 5.0314
slide_c         -23.6038 -9.3501 89.7156 11.1707 0 1.6827
hinge_c         -21.8121 -9.3501 71.5460 11.1707 0 1.6827
hinge_left      -139.0936 5.1799 -.8525 1.1798 0 .5392
hinge_lower     -128.8035 -3.3997 5.4693 1.1798 0 -.5392
hinge_platform  -19.7935 -7.0071 40.1454 11.1707 0 1.6827
hinge_right     80.6359 3.3200 -.8525 1.1798 0 -.5392
loop_a          -100.1411 13.0573 2.5950 -.8206 0 -.5194
loop_b          -47.1553 13.3607 -3.6356 .8304 0 -.3359
loop_c          90.9261 -5.7109 -1.5720 1.1798 0 .5392
"""


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def found(robot):
    return robot.reactions(paper_motion(1001), "elastic", stiffness=S1)


def largest(values):
    """The entry of the largest magnitude over the samples, with its sign."""
    return np.take_along_axis(values, np.abs(values).argmax(axis=0)[None], axis=0)[0]


def test_the_reference_table(found):
    table = {row.split()[0]: [float(x) for x in row.split()[1:]] for row in REFERENCE.strip().splitlines()}
    assert list(table) == list(found.joints)
    np.testing.assert_allclose(largest(components(found)), list(table.values()), atol=1.01e-4)
    left, right = found["hinge_left"].forces[:, 0], found["hinge_right"].forces[:, 0]
    np.testing.assert_allclose(left[[0, 500, 1000]], [-35.15115, 2.66161, -139.09358], atol=1e-5)
    np.testing.assert_allclose(right[[0, 500, 1000]], [-7.68495, -48.27119, 80.63595], atol=1e-5)
    assert found.residual.max() < 1e-11


def test_rigid_rods_and_balls_at_the_cuts(robot):
    motion = paper_motion(1001)
    rigid = robot.reactions(motion, "elastic", stiffness=replace(S1, rods=None))
    assert largest(rigid["slide_a"].forces)[0] == pytest.approx(13.6183, abs=1e-4)
    assert largest(rigid["hinge_left"].forces)[0] == pytest.approx(-136.8576, abs=1e-4)
    assert largest(rigid["slide_c"].moments)[2] == pytest.approx(1.0864, abs=1e-4)
    balls = robot.reactions(motion, "elastic", stiffness=replace(S1, cuts="points"))
    assert largest(balls["slide_a"].forces)[0] == pytest.approx(12.4040, abs=1e-4)
    assert largest(balls["slide_a"].moments)[2] == pytest.approx(-2.6534, abs=1e-4)
    assert largest(balls["hinge_left"].forces)[0] == pytest.approx(-139.5676, abs=1e-4)
    assert largest(balls["hinge_left"].moments)[0] == pytest.approx(2.3068, abs=1e-4)
    assert largest(balls["slide_c"].moments)[2] == pytest.approx(1.8091, abs=1e-4)


@pytest.mark.parametrize(("b", "peak"), [(0.03, 212.35), (0.05, 139.09), (0.1, 83.85)])
def test_the_width_of_the_parallelogram_decides_the_load_of_its_rods(b, peak):
    machine = replace(PAPER, geometry=replace(PAPER.geometry, b=b))
    result = p3dof.load(machine).reactions(paper_motion(201), "elastic", stiffness=S1)
    assert abs(largest(result["hinge_left"].forces)[0]) == pytest.approx(peak, abs=0.01)


# --- springs between ten bodies, each with six small displacements ------------------------------------------


class Springs:
    """The machine at one sample as bodies between springs; it shares parameters and closed forms only."""

    def __init__(self, parameters, book, i, stiffness, kind="paper"):
        self.blocks, self.bend = {}, {}
        self.size = 6 * len(BODIES)
        K = np.zeros((self.size, self.size))
        for joint, compliance in zip(book.ends, stiffness.compliances(parameters), strict=True):
            one, other, rotation, position = book.ends[joint]
            R = rotation[i]
            C = compliance.own
            if compliance.before is not None:
                turn = np.kron(np.eye(2), book.moving[one].rotation[i].T @ R)
                C = C + turn.T @ compliance.before @ turn
            platform = book.moving["platform"].rotation[i]
            T = np.array(transmitted(joint, kind, R.T @ platform[:, 1])).T
            k = T @ np.linalg.solve(T.T @ C @ T, T.T)
            D = np.zeros((6, self.size))  # from displacements of the bodies to that of the joint, in its axes
            for name, sign in ((one, -1), (other, 1)):
                if name != "base_link":
                    at = 6 * BODIES.index(name)
                    arm = position[i] - book.centre[name][i]
                    D[:3, at : at + 3] = sign * R.T
                    D[:3, at + 3 : at + 6] = sign * R.T @ np.cross(np.eye(3), arm).T
                    D[3:, at + 3 : at + 6] = sign * R.T
            self.blocks[joint], self.bend[joint] = (k, D), np.eye(6) - k @ C
            K += D.T @ k @ D
        self.scale = 1 / np.sqrt(np.diagonal(K))
        self.K = K * np.outer(self.scale, self.scale)

    def solve(self, load):
        return self.scale[:, None] * np.linalg.solve(self.K, self.scale[:, None] * load)

    def wrenches(self, load, own=None):
        """What predecessors exert on successors, (13, 6), under loads on the bodies (60,).

        What joints exert along their freedoms, as friction (13, 6), bends what is in series with them: with
        y the strains that the rest of the wrench T y needs, Tᵀ D u = Tᵀ C (T y + own).
        """
        given = np.zeros((13, 6)) if own is None else own
        fixed = [bend @ one for bend, one in zip(self.bend.values(), given, strict=True)]
        carried = sum(D.T @ one for (_, D), one in zip(self.blocks.values(), fixed, strict=True))
        u = self.solve((load + carried)[:, None])
        pairs = zip(self.blocks.values(), fixed, strict=True)
        return np.array([one - (k @ D @ u)[:, 0] for (k, D), one in pairs])

    def influence(self):
        """What a unit of misfit adds to each component, (78, 78)."""
        columns = []
        for j, (k, D) in enumerate(self.blocks.values()):
            u = self.solve(D.T @ k)
            rows = [-(one @ E @ u) for one, E in self.blocks.values()]
            rows[j] = rows[j] + k
            columns.append(np.vstack(rows))
        return np.hstack(columns)


@pytest.mark.parametrize("seed", range(8))
def test_they_are_those_of_springs_between_bodies(seed):
    parameters = random_machine(seed)
    states = random_states(parameters, seed, 3, side=(1, -1)[seed % 2])
    stiffness = random_stiffness(np.random.default_rng(seed))
    stiffness = replace(stiffness, misfit=Misfit(5e-6, 1e-4))
    motion = motion_of(states)
    result = p3dof.load(parameters).reactions(motion, "elastic", wrench=states.wrench, stiffness=stiffness)
    book = Bookkeeping(parameters, motion, states.wrench)
    wrenches, fit = components(result), np.moveaxis(result.fit, 1, 0).reshape(2, len(motion), 13, 6)
    scale = max(1.0, np.abs(wrenches).max())
    for i in range(len(motion)):
        springs = Springs(parameters, book, i, stiffness)
        needs = [-np.concatenate([part[i] for part in book.needs[name]]) for name in BODIES]
        np.testing.assert_allclose(
            wrenches[i], springs.wrenches(np.concatenate(needs)), rtol=0, atol=1e-8 * scale
        )
        H, each = springs.influence(), stiffness.misfits().ravel()
        np.testing.assert_allclose(fit[0, i].ravel(), np.abs(H) @ each, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(fit[1, i].ravel() ** 2, H**2 @ each**2, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("seed", range(200, 204))
def test_friction_in_joints_bends_the_rods_too(seed):
    """In the tree and where the loops were cut alike; of guides it is along their actuators."""
    friction = Friction({}, {"joints": 4.0, "slide_a": 5.0}, smoothing=0.3)
    parameters = replace(random_machine(seed), friction=friction)
    states = random_states(parameters, seed, 2, drop=0.2, angle=0.2, side=(1, -1)[seed % 2])
    stiffness, motion = random_stiffness(np.random.default_rng(seed)), motion_of(states)
    result = p3dof.load(parameters).reactions(motion, "elastic", wrench=states.wrench, stiffness=stiffness)
    book, wrenches = Bookkeeping(parameters, motion, states.wrench), components(result)
    scale = max(1.0, np.abs(wrenches).max())
    for i in range(len(motion)):
        springs, own = Springs(parameters, book, i, stiffness), np.zeros((13, 6))
        for row, (joint, (one, other, rotation, _)) in zip(own, book.ends.items(), strict=True):
            if joint.startswith("slide"):
                continue
            spin = rotation[i].T @ (book.moving[other].omega[i] - book.moving[one].omega[i])
            axes = [np.eye(3)[1]]
            if joint in ("loop_a", "loop_b"):
                axes = [rotation[i].T @ axis for axis in np.eye(3)[:2]]  # a leg turns about x, the platform y
            row[3:] = -4.0 * sum(axis * np.tanh(axis @ spin / 0.3) for axis in axes)
        load = -np.concatenate([np.concatenate([part[i] for part in book.needs[name]]) for name in BODIES])
        np.testing.assert_allclose(wrenches[i], springs.wrenches(load, own), rtol=0, atol=1e-8 * scale)
    assert np.abs(result["loop_a"].moments[:, 1]).max() > 0.1
    assert result.residual.max() < 1e-10 * scale


def exact_wrenches(springs, load):
    """The same with extended precision: soft rods between stiff joints cost plain numbers eight digits."""
    wide = np.longdouble
    blocks = [(k.astype(wide), D.astype(wide)) for k, D in springs.blocks.values()]
    K, force = sum(D.T @ k @ D for k, D in blocks), load.astype(wide)
    u = np.zeros(len(load), dtype=wide)
    for _ in range(8):
        rest = force - K @ u
        u = u + springs.solve(rest.astype(float)[:, None])[:, 0]
    return np.array([-(k @ (D @ u)) for k, D in blocks], dtype=float)


@pytest.mark.parametrize("seed", range(100, 106))
def test_with_payloads_and_tilted_gravity_and_balls_they_are_exact(seed):
    """Stiffness of each kind a tenth to ten times as large; what rigid bodies determine stays as it is."""
    rng = np.random.default_rng(seed)
    payload = Body(rng.uniform(0, 30), rng.uniform(-0.2, 0.2, 3), rng.uniform(0.01, 0.02, 3))
    parameters = replace(random_machine(seed).carrying(payload), gravity=rng.normal(scale=7, size=3))
    states = random_states(parameters, seed, 2, side=(1, -1)[seed % 2])
    kind = ("paper", "points")[seed % 3 == 0]
    stiffness, motion = replace(random_stiffness(rng), cuts=kind), motion_of(states)
    robot = p3dof.load(parameters)
    result = robot.reactions(motion, "elastic", wrench=states.wrench, stiffness=stiffness)
    book, wrenches = Bookkeeping(parameters, motion, states.wrench), components(result)
    scale = max(1.0, np.abs(wrenches).max())
    for i in range(len(motion)):
        needs = [-np.concatenate([part[i] for part in book.needs[name]]) for name in BODIES]
        exact = exact_wrenches(Springs(parameters, book, i, stiffness, kind), np.concatenate(needs))
        np.testing.assert_allclose(wrenches[i], exact, rtol=0, atol=1e-11 * scale)
    rigid = robot.reactions(motion, kind, wrench=states.wrench)
    fixed = np.concatenate([rigid.determined_forces, rigid.determined_moments], axis=-1)
    assert np.abs(wrenches - components(rigid))[fixed].max() < 1e-13 * scale


def test_misfits_of_the_reference(robot):
    home = Motion(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    stiffness = replace(S1, misfit=Misfit(5e-6, 1e-4))
    fit = robot.reactions(home, "elastic", stiffness=stiffness).fit[0, 0]
    by_name = dict(zip((joint.name for joint in JOINTS), fit, strict=True))
    assert by_name["slide_a"][0, 0] == pytest.approx(3.492, abs=1e-3)
    np.testing.assert_allclose(by_name["slide_a"][1, 1:], [1.295, 0.998], atol=1e-3)
    np.testing.assert_allclose(by_name["hinge_left"][0, :2], [5.232, 5.674], atol=1e-3)
    assert by_name["slide_c"][1, 2] == pytest.approx(1.395, abs=1e-3)
    peaks = {peak.joint: peak for peak in robot.reactions(home, "elastic", stiffness=stiffness).peaks()}
    assert peaks["hinge_left"].fit_force == pytest.approx(np.linalg.norm(by_name["hinge_left"][0]), rel=1e-12)
    assert robot.reactions(home, "elastic", stiffness=S1).peaks()[0].fit_force == 0


# --- what must hold whatever the stiffness ------------------------------------------------------------------


def test_the_mirrored_motion_has_mirrored_rods(robot, found):
    motion = found.motion
    mirror = [np.array(part) * [-1, 1, 1] for part in (motion.pose, motion.velocity, motion.acceleration)]
    other = robot.reactions(Motion(motion.time, *mirror), "elastic", stiffness=S1)
    for one, two in (("hinge_left", "hinge_right"), ("hinge_lower", "loop_c")):
        sizes = [
            np.linalg.norm(result[name].forces, axis=-1) for result, name in ((found, one), (other, two))
        ]
        np.testing.assert_allclose(*sizes, rtol=0, atol=1e-10)
    left, right = found["hinge_left"].forces[:, 0], other["hinge_right"].forces[:, 0]
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_mirrored_loads_are_mirrored_whatever_the_stiffness(seed):
    """A payload in the plane of symmetry, gravity along it, and wrenches turned with the motion."""
    rng = np.random.default_rng(seed)
    payload = Body(8.0, np.array([0.05, 0, -0.1]), np.array([0.02, 0.03, 0.04]))
    machine = replace(PAPER.carrying(payload), gravity=np.array([3.0, 0, -9.0]))
    robot, motion = p3dof.load(machine), paper_motion(31)
    stiffness = replace(random_stiffness(rng), joints={})
    force, moment = rng.normal(scale=40, size=3), rng.normal(scale=4, size=3)
    one = robot.reactions(motion, "elastic", wrench=np.append(force, moment), stiffness=stiffness)
    arrays = (np.array(part) * [-1, 1, 1] for part in (motion.pose, motion.velocity, motion.acceleration))
    wrench = np.append(force * [1, -1, 1], moment * [-1, 1, -1])
    other = robot.reactions(Motion(motion.time, *arrays), "elastic", wrench=wrench, stiffness=stiffness)
    twins = {"left": "right", "right": "left", "lower": "c", "_a": "_b", "_b": "_a"}
    for name in ("hinge_left", "hinge_right", "hinge_a", "hinge_b", "slide_a", "slide_c", "loop_a"):
        twin = next((name.replace(k, v) for k, v in twins.items() if name.endswith(k)), name)
        for kind in ("forces", "moments"):
            sizes = [
                np.linalg.norm(getattr(found[key], kind), axis=-1)
                for found, key in ((one, name), (other, twin))
            ]
            np.testing.assert_allclose(*sizes, rtol=0, atol=1e-10)


def test_what_rigid_bodies_determine_stays(robot, found):
    paper = robot.reactions(paper_motion(1001), "paper")
    fixed = np.concatenate([paper.determined_forces, paper.determined_moments], axis=-1)
    apart = np.abs(components(found) - components(paper))
    assert apart[fixed].max() < 1e-12
    assert apart.max() > 1
    np.testing.assert_array_equal(found.determined_forces, paper.determined_forces)


def test_their_energy_is_the_least(robot, found):
    """Any other solution, here that of the smallest sum of squares, stores more."""
    compliances = S1.compliances(PAPER)
    rigid = robot.reactions(found.motion, "paper")

    def energy(result):
        total = 0.0
        for j, one in enumerate(compliances):
            wrench = components(result)[:, j]
            total = total + np.einsum("ni,ij,nj->n", wrench, one.own, wrench)
            if one.before is not None:
                rod = next(k for k, joint in enumerate(JOINTS) if joint.successor == JOINTS[j].predecessor)
                turn = np.swapaxes(result.rotations[:, rod], -1, -2) @ result.rotations[:, j]
                turned = np.einsum("nij,nkj->nki", turn, wrench.reshape(-1, 2, 3)).reshape(-1, 6)
                total = total + np.einsum("ni,ij,nj->n", turned, one.before, turned)
        return total

    assert (energy(found) < energy(rigid)).all()


def test_stiffness_that_is_alike_in_all_joints_is_the_choice_of_the_idealisation(robot):
    """Compliance 1 against forces, 1/l^2 against moments, in every joint: the sum of squares again."""
    motion = paper_motion(11)
    states = robot.inverse_dynamics(motion).joints
    forces = robot.inverse_dynamics(motion).forces
    rigid = robot.reactions(motion, "paper")
    alike = [JointCompliance(np.diag([1.0] * 3 + [1 / rigid.length**2] * 3)) for _ in JOINTS]
    solver = ReactionSolver(robot.loop, cuts("paper"), compliances=alike)
    for i in range(len(motion)):
        one = solver.solve(states.q[i], states.v[i], states.a[i], forces[i])
        np.testing.assert_allclose(one.forces, rigid.forces[i], rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.moments, rigid.moments[i], rtol=0, atol=1e-9)


def test_the_tip_of_a_beam_gives_way_as_the_text_book_says():
    C = beam(0.4, 1e-4, 2e-9, 4e-9, 200e9, 80e9)
    np.testing.assert_array_equal(C, C.T)
    deflection = C @ [0, 0, -1000.0, 0, 0, 0]  # F L^3 / 3 E I, and F L^2 / 2 E I: nose down is about +y
    np.testing.assert_allclose(deflection[[2, 4]], [-1000 * 0.4**3 / 1200, 1000 * 0.4**2 / 800], rtol=1e-14)
    assert C[0, 0] == pytest.approx(0.4 / (200e9 * 1e-4))
    assert C[3, 3] == pytest.approx(0.4 / (80e9 * 4e-9))


# --- input and output ---------------------------------------------------------------------------------------


def test_a_file(tmp_path):
    path = tmp_path / "stiffness.yaml"
    path.write_text(
        "hinges: {radial: 60 N/um, tilt: 5 N m/mrad}\nslides: {lateral: 1.5e8}\n"
        "rods: {diameter: 18 mm, young: 70 GPa}\njoints:\n  hinge_left: {axial: 10 N/um}\n"
        "misfit: {shift: 5 um, turn: 0.1 mrad}\ncuts: points\n",
        encoding="utf-8",
    )
    read = read_stiffness(path)
    assert read.hinges == HingeStiffness(6e7, 5e7, 5e3)
    assert read.slides == SlideStiffness(1.5e8)
    assert read.rods == RodSection(0.018, 70e9)
    assert read.joints == {"hinge_left": HingeStiffness(6e7, 1e7, 5e3)}
    assert read.misfit == Misfit(5e-6, 1e-4)
    assert read.cuts == "points"
    path.write_text("rods: rigid\n", encoding="utf-8")
    assert read_stiffness(path) == Stiffness(rods=None)
    radius = Stiffness().rods.radius(PAPER.geometry.L, PAPER.bodies.leg_a.mass)
    assert radius == pytest.approx(0.01, rel=1e-3)  # the paper's legs, as the solids have them


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("hinges: {radial: 60 mm}\n", r"hinges\.radial: expected a stiffness.*'1 N/um', got '60 mm'"),
        ("hinges: {radius: 1}\n", "hinges: unknown field 'radius', expected radial, axial, tilt"),
        ("hinges: {radial: -1}\n", "hinges: radial: expected a positive number, got -1"),
        ("rods: soft\n", "rods: expected the fields diameter, young, poisson, got 'soft'"),
        ("rods: {poisson: 0.5}\n", "rods: poisson: expected less than 0.5, got 0.5"),
        ("joints: {hinge_x: {radial: 1}}\n", "joints: unknown field 'hinge_x'"),
        ("joints: {slide_a: {radial: 1}}\n", r"joints\.slide_a: unknown field 'radial', expected lateral"),
        ("misfit: {shift: -1 um}\n", "misfit: shift: expected zero or more"),
        ("cuts: welds\n", "cuts: expected 'paper' or 'points', got 'welds'"),
        ("[]\n", "expected the fields hinges"),
    ],
)
def test_a_wrong_file(tmp_path, text, told, capsys):
    path = tmp_path / "s.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises((ParameterError, InputError), match=told):
        read_stiffness(path)
    assert main(["reactions", "--samples", "5", "--stiffness", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("p3dof: error: ")
    assert "s.yaml" in error


def test_wrong_parts(robot):
    with pytest.raises(ParameterError, match="hinges: expected a HingeStiffness, got 3"):
        Stiffness(hinges=3)
    with pytest.raises(ParameterError, match=r"joints: expected names of slide_a, .*got 'elbow'"):
        Stiffness(joints={"elbow": HingeStiffness()})
    with pytest.raises(ParameterError, match="joints: slide_a: expected a SlideStiffness"):
        Stiffness(joints={"slide_a": HingeStiffness()})
    with pytest.raises(ParameterError, match="rods: expected a RodSection or None"):
        Stiffness(rods=0.02)
    with pytest.raises(ParameterError, match="misfit: expected a Misfit or None"):
        Stiffness(misfit=1e-6)
    with pytest.raises(ModelError, match="expected a symmetric matrix"):
        JointCompliance(np.arange(36.0).reshape(6, 6))
    with pytest.raises(ModelError, match="negative eigenvalue"):
        JointCompliance(np.eye(6) + np.fliplr(2 * np.eye(6)))
    with pytest.raises(ModelError, match="stiffness: expected 3 \\+ 3 positive numbers"):
        JointCompliance.of_stiffness((1, 1, 0), (1, 1, 1))
    with pytest.raises(ModelError, match="compliances: expected a JointCompliance for each of slide_a"):
        ReactionSolver(robot.loop, cuts("paper"), compliances=[JointCompliance(np.eye(6))])
    with pytest.raises(ModelError, match="misfit: loads of assembly errors depend on the compliances"):
        ReactionSolver(robot.loop, cuts("paper"), misfit=np.zeros((13, 6)))
    rigid = ReactionSolver(robot.loop, cuts("paper"), compliances=[JointCompliance(np.zeros((6, 6)))] * 13)
    result = robot.inverse_dynamics(paper_motion(2))
    with pytest.raises(ModelError, match="they leave loads open"):
        rigid.solve(result.joints.q[0], result.joints.v[0], result.joints.a[0], result.forces[0])


def test_tables_and_command(tmp_path, capsys):
    path = tmp_path / "s.yaml"
    path.write_text("misfit: {shift: 5 um}\n", encoding="utf-8")
    out = tmp_path / "r.csv"
    arguments = ["reactions", "--samples", "5", "--joint-model", "elastic", "--stiffness", str(path)]
    assert main([*arguments, "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    for words in ("~125.99", "fit", "depends on the stiffness", "which the paper does not give"):
        assert words in " ".join(shown.split())
    assert "no bounds" not in shown
    assert out.read_text(encoding="utf-8").startswith("t [s],slide_a fx [N]")
    robot = p3dof.load()
    result = robot.reactions(paper_motion(5), "elastic", stiffness=read_stiffness(path))
    assert open_tables(result) == []
    assert reactions_table(result).header[-2:] == ("fit [N]", "fit [N m]")


def test_a_heavy_eccentric_part_is_borne_by_the_rods():
    machine = PAPER.carrying(Body(20.0, np.array([0, 0.1, 0]), np.zeros(3)))
    result = p3dof.load(machine).reactions(paper_motion(21))
    (peak,) = (peak for peak in result.peaks() if peak.joint == "hinge_right")
    assert peak.force > 500
    assert "force" in peak.undetermined
