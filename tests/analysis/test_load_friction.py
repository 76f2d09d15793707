"""Friction that grows with loads: a reference, both methods, virtual powers of Lagrange, bad input."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from joint_forces import S1, motion_of, random_stiffness
from lagrange import BODIES, LagrangeModel, friction_forces
from machines import conditioning, random_machine, random_states
from table_numbers import check_table, shows

import p3dof
from p3dof._base.errors import DriveError, DynamicsError, InputError, ParameterError, SampleError
from p3dof.analysis.load_friction import (
    HingeContact,
    LoadFriction,
    SlideContact,
    additions_table,
    contacts,
    contacts_table,
    read_load_friction,
)
from p3dof.analysis.reactions import JOINTS, Stiffness
from p3dof.analysis.reactions.evaluation import of_result
from p3dof.cli import main
from p3dof.design.assessment import assumptions
from p3dof.design.bearings import Bearing, Bearings, Guide, bearing_life
from p3dof.design.drives import GENERIC
from p3dof.machine.motion import Motion, paper_motion, states_over
from p3dof.machine.parameters import PAPER, PASSIVE, SLIDES, Actuators, Body, Friction
from p3dof.methods import pinocchio as pinocchio_friction
from p3dof.methods import virtual_power
from p3dof.report.plots import forces_figure

PLAIN = HingeContact(mu=0.1, radius=8e-3)
REFERENCE = LoadFriction(
    hinges=PLAIN, slides=SlideContact(drag=4.0, mu=0.01, arm=0.03), joints={"hinge_lower_right": None}
)
ALL = LoadFriction(
    HingeContact(0.15, 6e-3),
    HingeContact(0.12, 9e-3),
    SlideContact(3.0, 0.02, 0.05, screw=0.11),
    {"hinge_c": HingeContact(0.3, 4e-3), "slide_b": SlideContact(1.0, 0.004, 0.02, 0.2)},
    smoothing=0.02,
)
CUTS = {"hinge_lower_right": "loop_c", "universal_a": "loop_a", "universal_b": "loop_b"}


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module", params=["pinocchio", "virtual-power"])
def effect(request, robot):
    return robot.load_friction(paper_motion(101), REFERENCE, method=request.param, stiffness=S1)


def test_the_reference(effect):
    """Found outside of the package; its RMS values are means over the samples."""
    np.testing.assert_allclose(effect.result.peak_forces, [126.1397, 71.3509, 94.9579], atol=6e-5)
    rms = np.sqrt((effect.result.forces**2).mean(axis=0))
    np.testing.assert_allclose(rms, [52.0594, 52.0095, 59.8292], atol=6e-5)
    np.testing.assert_allclose(effect.largest_additions, [7.6417, 6.5123, 8.9907], atol=6e-5)
    assert effect.steps <= 10


def test_both_methods_agree(robot):
    for friction in (REFERENCE, ALL):
        one, other = (
            robot.load_friction(paper_motion(21), friction, method=method, stiffness=S1)
            for method in ("pinocchio", "virtual-power")
        )
        largest = np.abs(one.reactions.forces).max()
        np.testing.assert_allclose(one.result.forces, other.result.forces, rtol=0, atol=1e-13 * largest)
        for name, limit in one.coulomb.limits.items():
            np.testing.assert_allclose(limit, other.coulomb.limits[name], rtol=1e-11)


def test_against_the_same_friction_both_ways_need_the_same(robot, effect):
    """One by joint forces on closed loops, one by virtual powers."""
    states = states_over(effect.result.motion, None)
    one, lost = pinocchio_friction.forces_against(robot.loop, effect.result.joints, effect.coulomb)
    other, also = virtual_power.forces_against(PAPER, states, effect.coulomb)
    allowed = 1e-12 * conditioning(PAPER.geometry, states.pose).max()
    for mine, theirs in ((one, other), (lost, also), (one, effect.additions)):
        assert np.abs(mine - theirs).max() < allowed * np.abs(theirs).max()


def random_contacts(rng):
    def hinge():
        return HingeContact(rng.uniform(0.01, 0.2), rng.uniform(2e-3, 6e-3))

    def slide():
        return SlideContact(*rng.uniform([0, 0, 0.02, 0], [5, 0.03, 0.08, 0.3]))

    own = {"hinge_left": hinge(), "hinge_platform": None, "universal_b": hinge(), "slide_c": slide()}
    return LoadFriction(hinge(), hinge(), slide(), own, smoothing=float(rng.uniform(0.01, 0.3)))


def expected_limits(friction, reactions, nuts):
    """The rule of every contact, once more, from reactions in the fixed axes."""
    forces, _ = reactions.in_base()
    found = {}
    for name in (*SLIDES, *PASSIVE):
        contact = friction.of(name)
        i = reactions.joints.index(CUTS.get(name, name))
        own = reactions.forces[:, i]
        if contact is None:
            continue
        if name in SLIDES:
            load = abs(own[:, 0]) + abs(own[:, 1]) + abs(reactions.moments[:, i]).sum(axis=1) / contact.arm
            lost = contact.drag + contact.mu * load + contact.screw * abs(nuts[:, SLIDES.index(name)])
            found[name] = lost[:, None]
        elif name.startswith("universal"):
            across = [np.linalg.norm(np.delete(forces[:, i], axis, axis=1), axis=1) for axis in (0, 1)]
            found[name] = contact.mu * contact.radius * np.array(across).T
        else:
            found[name] = contact.mu * contact.radius * np.linalg.norm(own[:, [0, 2]], axis=1)[:, None]
    return found


@pytest.mark.parametrize("method", ["pinocchio", "virtual-power"])
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_on_random_machines_it_is_the_virtual_power_of_its_own_reactions(seed, method):
    """Any machine, gravity, payload, wrench, stiffness and constant friction besides."""
    rng = np.random.default_rng(seed)
    machine = replace(
        random_machine(seed).carrying(Body(3.0, rng.uniform(-0.05, 0.05, 3), np.full(3, 0.01))),
        gravity=rng.normal(scale=6, size=3),
        friction=Friction({"sliders": 12.0}, {"joints": 0.1, "slide_a": 2.0}, smoothing=0.05),
    )
    states = random_states(machine, seed, 3, drop=0.2, angle=0.2, side=(1, -1)[seed % 2])
    friction, motion = random_contacts(rng), motion_of(states)
    robot, stiffness = p3dof.load(machine), random_stiffness(rng)
    found = robot.load_friction(motion, friction, method=method, wrench=states.wrench, stiffness=stiffness)
    again = robot.reactions(
        motion, "elastic", wrench=states.wrench, stiffness=stiffness, load_friction=friction
    )
    scale = np.abs(again.forces).max() * conditioning(machine.geometry, states.pose).max()
    np.testing.assert_allclose(found.reactions.forces, again.forces, rtol=0, atol=1e-12 * scale)
    limits = expected_limits(friction, again, found.result.nut_forces)
    assert limits.keys() == found.coulomb.limits.keys()
    for name, limit in limits.items():
        np.testing.assert_allclose(found.coulomb.limits[name], limit, rtol=1e-9, atol=1e-12 * scale)
    base = robot.forces(*motion_arrays(motion), wrench=states.wrench, method="virtual-power")
    for i in range(len(motion)):
        added = np.zeros(3)
        for name, limit in limits.items():  # each axis of a universal joint has a limit of its own
            for axis in range(limit.shape[1]):
                one = replace(machine, friction=Friction({}, {name: limit[i, axis]}, friction.smoothing))
                added += share_of(one, name, axis, motion.pose[i], motion.velocity[i])
        np.testing.assert_allclose(found.result.forces[i] - base[i], added, rtol=0, atol=1e-10 * scale)
    assert np.abs(found.result.power_residual).max() < 1e-11 * scale
    assert np.abs(again.residual).max() < 1e-10 * scale


def motion_arrays(motion):
    return motion.pose, motion.velocity, motion.acceleration


def share_of(machine, name, axis, pose, velocity):
    """Actuator forces against Coulomb friction about one axis of a joint, from Lagrange's spins."""
    model = LagrangeModel(machine)
    if not name.startswith("universal"):
        total, _ = friction_forces(machine, pose, velocity)
        return np.linalg.solve(model.jacobian(pose).T, total)
    leg = name.replace("universal", "leg")
    spins = np.stack([model.angular_velocities(pose, unit) for unit in np.eye(3)], axis=-1)
    row = (spins[BODIES.index("platform")] - spins[BODIES.index(leg)])[axis]
    resisting = machine.friction.coulomb[name] * np.tanh(row @ velocity / machine.friction.smoothing)
    return np.linalg.solve(model.jacobian(pose).T, resisting * row)


def test_the_mirrored_motion_has_mirrored_friction(robot):
    motion = paper_motion(51)
    mirror = [np.array(part) * [-1, 1, 1] for part in motion_arrays(motion)]
    friction = replace(ALL, joints={})
    one = robot.load_friction(motion, friction, stiffness=S1)
    other = robot.load_friction(Motion(motion.time, *mirror), friction, stiffness=S1)
    np.testing.assert_allclose(other.result.forces, one.result.forces[:, [1, 0, 2]], rtol=0, atol=1e-10)
    twins = {
        "hinge_left": "hinge_right",
        "hinge_lower": "hinge_lower_right",
        "hinge_a": "hinge_b",
        "universal_a": "universal_b",
        "slide_a": "slide_b",
    }
    for name, twin in twins.items():
        np.testing.assert_allclose(other.coulomb.limits[twin], one.coulomb.limits[name], rtol=0, atol=1e-10)


def test_friction_of_a_guide_stays_with_its_actuator(robot):
    """No other force and no reaction but that along the guide changes, and one step settles it."""
    friction = LoadFriction(joints={"slide_b": SlideContact(2.0, 0.02, 0.04)})
    found = robot.load_friction(paper_motion(21), friction, stiffness=S1)
    assert np.abs(found.additions[:, [0, 2]]).max() < 1e-11
    assert found.largest_additions[1] > 2
    np.testing.assert_allclose(found.of_guides, found.additions, rtol=0, atol=1e-11)
    plain = robot.reactions(paper_motion(21), "elastic", stiffness=S1)
    np.testing.assert_allclose(found.reactions.forces, plain.forces, rtol=0, atol=1e-10)
    assert found.steps <= 2


def test_a_screw_loses_its_share_of_the_nut_by_the_direction_of_power(robot):
    """Efficiency 1 / (1 + k) forward, 1 - k backward, of the force that overcomes the guide too."""
    guide = LoadFriction(slides=SlideContact(4.0, 0.01, 0.03))
    both = LoadFriction(slides=SlideContact(4.0, 0.01, 0.03, screw=1 / 0.9 - 1))
    one, other = (robot.load_friction(paper_motion(51), part, stiffness=S1) for part in (guide, both))
    np.testing.assert_allclose(other.result.nut_forces, one.result.forces, rtol=1e-12)
    speeds = one.result.slider_velocities
    fast = np.abs(speeds) > 0.01
    drives = one.result.forces * speeds > 0
    expected = np.where(drives, one.result.forces / 0.9, one.result.forces * (2 - 1 / 0.9))
    np.testing.assert_allclose(other.result.forces[fast], expected[fast], rtol=1e-6)
    assert (drives & fast).any()
    assert (~drives & fast).any()
    assert one.coulomb.screws is None


def test_rotors_and_balances_load_no_joint(robot):
    """Neither guides nor hinges feel them; a screw feels the balance, but not its rotor."""
    motion = paper_motion(21)
    plain = LoadFriction(PLAIN, slides=SlideContact(4.0, 0.01, 0.03))
    screws = replace(plain, slides=SlideContact(4.0, 0.01, 0.03, screw=0.1))
    bare = robot.load_friction(motion, plain, stiffness=S1)
    for actuators in (
        Actuators(armature={"sliders": 14.8}),
        Actuators({"slide_a": 9.0}, {"sliders": 50.0}, {"slide_b": 30.0}, {"slide_c": 2.0}),
    ):
        heavy = p3dof.load(replace(PAPER, actuators=actuators))
        for method in ("pinocchio", "virtual-power"):
            found = heavy.load_friction(motion, plain, method=method, stiffness=S1)
            np.testing.assert_allclose(found.additions, bare.additions, rtol=0, atol=1e-10)
            lossy = heavy.load_friction(motion, screws, method=method, stiffness=S1)
            nuts = found.result.forces - found.result.slider_accelerations * actuators.rotors
            np.testing.assert_allclose(lossy.result.nut_forces, nuts, rtol=0, atol=1e-10)
            lost = 0.1 * np.abs(nuts) * np.tanh(lossy.result.slider_velocities / 1e-3)
            np.testing.assert_allclose(lossy.result.forces - found.result.forces, lost, rtol=0, atol=1e-10)
            assert np.abs(lossy.result.power_residual).max() < 1e-9


def test_losses_add_up(effect):
    assert sum(effect.lost_work.values()) == pytest.approx(
        np.trapezoid(effect.result.dissipation, effect.result.time), rel=1e-12
    )
    assert effect.lost_work["slide_c"] > effect.lost_work["hinge_left"] > 0
    assert "hinge_lower_right" not in effect.lost_work
    assert np.abs(effect.result.power_residual).max() < 1e-11
    assert "9 steps" in repr(effect)
    html = effect._repr_html_()
    assert "hinge_platform" in html
    assert "126.14" in html


def rates_of(machine, motion):
    """How fast each contact slides or turns, (N, axes), signs apart, from Lagrange's rates and spins."""
    model = LagrangeModel(machine)
    spins = model.angular_velocities(motion.pose, motion.velocity)
    sliders = model.slider_velocities(motion.pose, motion.velocity)
    found = {name: sliders[:, [k]] for k, name in enumerate(SLIDES)}
    for name in PASSIVE:
        joint = next(joint for joint in JOINTS if joint.name == CUTS.get(name, name))
        one, other = (spins[:, BODIES.index(link)] for link in (joint.predecessor, joint.successor))
        turn = other - one
        # The leg turns about x0 against its slider, the platform about y0: an axis of the joint each.
        found[name] = turn[:, :2] if name.startswith("uni") else np.linalg.norm(turn, axis=1)[:, None]
    return found


def losses(machine, effect):
    """Friction of each contact and the work it takes, from the rule of contacts and Lagrange's rates."""
    rates = rates_of(machine, effect.result.motion)
    limits = expected_limits(effect.friction, effect.reactions, effect.result.nut_forces)
    power = {
        name: (limit * np.tanh(rates[name] / effect.friction.smoothing) * rates[name]).sum(axis=1)
        for name, limit in limits.items()
    }
    return limits, {name: np.trapezoid(lost, effect.result.time) for name, lost in power.items()}


def test_every_contact_loses_the_work_of_all_its_axes(robot):
    effect = robot.load_friction(paper_motion(41), ALL, stiffness=S1)
    _, expected = losses(PAPER, effect)
    assert effect.lost_work.keys() == expected.keys() == {*SLIDES, *PASSIVE}
    for name, work in expected.items():
        assert effect.lost_work[name] == pytest.approx(work, rel=1e-9), name


@shows(
    "p3dof.analysis.load_friction.contacts.additions_table",
    "p3dof.analysis.load_friction.contacts.contacts_table",
)
def test_every_number_of_the_tables_of_friction_by_load(robot):
    papers, rows = paper_motion(41), [0, 5, 6, 14, 21, 33, 40]
    motion = Motion(papers.time[rows], *(part[rows] for part in motion_arrays(papers)), check=False)
    effect = robot.load_friction(motion, ALL, stiffness=S1)
    limits, works = losses(PAPER, effect)
    rates = rates_of(PAPER, motion)
    bare = LagrangeModel(PAPER).forces(*motion_arrays(motion))
    forces, step = effect.result.forces, np.diff(motion.time)[:, None]

    def rms(values):
        return np.sqrt((step * (values[1:] ** 2 + values[:-1] ** 2)).sum(axis=0) / 2 / step.sum())

    expected = {}
    for k, (leg, slide) in enumerate(zip("ABC", SLIDES, strict=True)):
        added = np.abs(forces - bare)[:, k]
        at = added.argmax()
        own = limits[slide][at, 0] * abs(np.tanh(rates[slide][at, 0] / 0.02))
        peaks = abs(bare[:, k]).max(), abs(forces[:, k]).max()
        share = (added.max() / peaks[0],)
        means = rms(bare)[k], rms(forces)[k]
        expected[f"force {leg} [N]"] = (*peaks, *means, added.max(), motion.time[at], own, share)
    check_table(additions_table(replace(effect, steps=77)), expected, note=[77])
    loads = {}
    for name, limit in limits.items():
        contact = ALL.of(name)
        if name in SLIDES:
            screw = contact.screw * abs(effect.result.nut_forces[:, [SLIDES.index(name)]])
            loads[name] = (limit - contact.drag - screw) / contact.mu
        else:
            loads[name] = limit / contact.mu / contact.radius
    expected = {
        name: (
            loads[name].max(),
            (limit.max(), "N" if name in SLIDES else "N m"),
            works[name],
            (works[name] / sum(works.values()),),
        )
        for name, limit in limits.items()
    }
    check_table(contacts_table(effect), expected)


def gliding(speed, count=5):
    """All sliders alike, so that the machine moves as one body."""
    time = np.linspace(0.0, 0.1, count)
    pose, velocity = np.zeros((2, count, 3))
    pose[:, 1], velocity[:, 1] = speed * time, speed
    return Motion(time, pose, velocity, np.zeros((count, 3)))


@pytest.mark.parametrize(
    ("contact", "force"),
    [
        (SlideContact(drag=4.0), 4.0),
        (SlideContact(drag=4.0, mu=0.01, screw=0.1), 4.4),
        (SlideContact(mu=0.01), 0.0),
        (SlideContact(screw=0.1), 0.0),
    ],
)
def test_without_loads_there_is_the_drag_alone(contact, force):
    """Nothing weighs, nothing accelerates: motors overcome the drag, joints bear but rounding."""
    robot = p3dof.load(replace(PAPER, gravity=np.zeros(3)))
    found = robot.load_friction(gliding(-0.1), LoadFriction(PLAIN, PLAIN, contact), method="virtual-power")
    np.testing.assert_allclose(found.result.forces, -force, rtol=1e-12, atol=1e-15)
    assert max(load.max() for load in found.loads.values()) < 1e-14
    assert sum(found.lost_work.values()) == pytest.approx(3 * force * 0.01, abs=1e-15)


@pytest.mark.parametrize("place", [(0, 0, 0.1), (0.05, 0.1, -0.2), (-0.02, -0.1, 0.15), (0, 0, 0)])
@pytest.mark.parametrize("speed", [-1.0, -0.037, 0.3])
def test_what_rounds_where_bodies_glide_is_no_missing_force(speed, place):
    """v × m v of every body is rounding; a millionth of m v² is still missed."""
    robot = p3dof.load(replace(PAPER, gravity=np.zeros(3)))
    along = gliding(speed, 2)
    motion = Motion(along.time, along.pose + np.array(place), along.velocity, along.acceleration)
    own = dict(zip(SLIDES, map(SlideContact, (4.0, 1.0, 2.5)), strict=True))
    found = robot.load_friction(motion, LoadFriction(PLAIN, joints=own), method="virtual-power")
    drags = np.sign(speed) * np.array([4.0, 1.0, 2.5])
    np.testing.assert_allclose(found.result.forces, [drags] * 2, rtol=1e-12)
    free = robot.inverse_dynamics(motion, method="pinocchio")
    energy = sum(body.mass for _, body in PAPER.bodies.items()) * speed**2
    for k in range(3):
        wrong = replace(free, forces=free.forces + 1e-6 * energy * np.eye(3)[k])
        with pytest.raises(SampleError, match="sample 0: tau: the forces do not produce the motion"):
            of_result(robot.loop, robot.parameters, wrong, "elastic")


def test_shares_of_small_losses_are_told(robot):
    effect = robot.load_friction(gliding(0.01), LoadFriction(slides=SlideContact(drag=4.0)))
    assert sum(effect.lost_work.values()) == pytest.approx(3 * 4.0 * 1e-3)
    assert [row[-1] for row in contacts_table(effect).rows] == ["33.3%"] * 3
    still = robot.load_friction(gliding(0.0), LoadFriction(slides=SlideContact(drag=4.0)))
    assert [row[-1] for row in contacts_table(still).rows] == ["–"] * 3


def test_no_axis_of_a_universal_joint_may_change_any_more():
    former = {"hinge_a": np.full((2, 1), 30.0), "universal_b": np.array([[10.0, 20.0], [30.0, 40.0]])}
    latter = {"hinge_a": np.full((2, 1), 30.4), "universal_b": np.array([[10.0, 20.5], [30.0, 41.5]])}
    now = SimpleNamespace(loads=latter, reactions=SimpleNamespace(valid=np.ones(2, dtype=bool)))
    found = contacts._largest_change(former, now, np.array([50.0, 100.0]))
    assert found == (pytest.approx(0.015), "universal_b", 1)


def test_friction_that_grows_with_itself_is_told(robot):
    for mu, radius in ((0.5, 0.3), (50.0, 3.0), (1e3, 1e6)):
        with pytest.raises(DynamicsError, match=r"do not converge: after \d+ steps the load of \w+ at t = "):
            robot.load_friction(paper_motion(11), LoadFriction(HingeContact(mu, radius)))


@pytest.mark.parametrize("left", [0.01, 0.4, 0.6, 1.5])
def test_changes_must_halve_within_twelve_steps(monkeypatch, left):
    """A load whose changes are a geometric series, of which this share is left after twelve."""
    ratio, states = left ** (1 / 12), []

    def stepped(*_):
        reactions = SimpleNamespace(forces=np.ones((1, 1, 3)), valid=np.ones(1, dtype=bool))
        states.append({"hinge_c": np.full((1, 1), (1 - ratio) * sum(ratio**k for k in range(len(states))))})
        return SimpleNamespace(loads=states[-1], reactions=reactions)

    monkeypatch.setattr(contacts, "_stepped", stepped)
    monkeypatch.setattr(contacts, "loads_of", lambda *_: stepped().loads)
    given, motion = SimpleNamespace(loaded=lambda *_: None, solution=None, friction=None), paper_motion(11)
    if left < 0.5:
        settled, steps = contacts._settle(given, motion)
        assert settled.loads is states[-1]
        assert steps == len(states) - 1
        assert steps == pytest.approx(1 + np.log(1e-12 / (1 - ratio)) / np.log(ratio), abs=2)
    else:
        with pytest.raises(DynamicsError, match="after 13 steps the load of hinge_c at t = 0 s"):
            contacts._settle(given, motion)


def test_invalid_samples_stay_out(robot):
    motion = paper_motion(11)
    pose = np.array(motion.pose)
    pose[4, 0] = 5.0
    broken = Motion(motion.time, pose, motion.velocity, motion.acceleration, check=False)
    with pytest.raises(p3dof.errors.ReachError, match="sample 4"):
        robot.load_friction(broken, REFERENCE)
    for method in ("pinocchio", "virtual-power"):
        found = robot.load_friction(broken, REFERENCE, on_invalid="nan", method=method)
        assert np.flatnonzero(~found.result.valid).tolist() == [4]
        whole = robot.load_friction(motion, REFERENCE)
        np.testing.assert_allclose(
            np.delete(found.result.forces, 4, axis=0),
            np.delete(whole.result.forces, 4, axis=0),
            rtol=0,
            atol=1e-10,
        )
        assert np.isnan(found.largest_additions).all()
        assert "nan" in str(additions_table(found).rows)
        assert contacts_table(found).rows


def test_figures_and_assessments_say_that_it_is_in(robot, effect):
    labels = [
        text.get_text() for text in forces_figure([effect.result, effect.without]).legends[0].get_texts()
    ]
    assert [label.endswith("with load-dependent friction") for label in labels] == [True, False]
    assert "load-dependent" in assumptions(p3dof.assess(robot, effect.result))["friction"]
    assert "load-dependent" not in assumptions(p3dof.assess(robot, effect.without))["friction"]


def test_where_it_does_not_apply_it_is_refused(robot):
    with pytest.raises(InputError, match="'pinocchio' or 'virtual-power', not by 'compiled': kernels, gen"):
        robot.inverse_dynamics(paper_motion(5), load_friction=REFERENCE, method="compiled")
    with pytest.raises(InputError, match="load_friction: expected a LoadFriction, got 3"):
        robot.inverse_dynamics(paper_motion(5), load_friction=3)


def test_reactions_bearings_and_page_have_it(robot, effect):
    motion = paper_motion(101)
    every = robot.reactions(motion, stiffness=S1, load_friction=REFERENCE)
    np.testing.assert_allclose(every.elastic.forces, effect.reactions.forces, rtol=0, atol=1e-9)
    assert every.residual.max() < 1e-10
    known = of_result(robot.loop, PAPER, effect.result, "elastic", stiffness=S1)
    np.testing.assert_allclose(known.forces, effect.reactions.forces, rtol=0, atol=1e-9)
    parts = Bearings(Bearing(3000.0), Guide(1e4, 50e3, (120, 120, 150)))
    bare = bearing_life(PAPER, robot.reactions(motion, "elastic", stiffness=S1), parts)
    rough = bearing_life(PAPER, every, parts)
    assert rough.bearings[0].mean_load != pytest.approx(bare.bearings[0].mean_load, rel=1e-4)
    assert robot.page(effect.result)


def task_of(tmp_path):
    path = tmp_path / "task.yaml"
    path.write_text(
        "waypoints:\n- {pose: [-0.1, 0, 0], pick_up: {mass: 2, com: [0, 0, 0], inertia: [0, 0, 0]}}\n"
        "- {pose: [0.1, 0.02, 5 deg], duration: 0.5, dwell: 0.1, put_down: true}\n"
        "- {pose: [-0.1, 0, 0], duration: 0.5}\n",
        encoding="utf-8",
    )
    return path


def test_tasks_and_drives_have_it(robot, tmp_path):
    plan = p3dof.read_task(task_of(tmp_path)).plan(samples=101)
    bare, rough = (
        p3dof.design.forces_of_task(robot, plan, "virtual-power", load_friction=friction, stiffness=S1)
        for friction in (None, REFERENCE)
    )
    assert (np.abs(rough.forces - bare.forces).max(axis=0) > 3).all()
    laden = p3dof.load(PAPER.carrying(plan.pieces[0].payload))
    own = laden.inverse_dynamics(plan.pieces[0].motion, load_friction=REFERENCE, stiffness=S1)
    np.testing.assert_allclose(rough.results[0].forces, own.forces, rtol=0, atol=1e-10)
    drive = next(iter(GENERIC))
    assert p3dof.size_drives(robot, rough, drive)[0].worst[1].share > 0
    lossy = LoadFriction(slides=SlideContact(screw=0.1))
    with pytest.raises(DriveError, match="the forces have losses of screws"):
        p3dof.size_drives(robot, robot.inverse_dynamics(paper_motion(5), load_friction=lossy), drive)


# --- input --------------------------------------------------------------------------------------------------


def test_wrong_parts():
    with pytest.raises(ParameterError, match="expected hinges, universals, slides or joints, got none"):
        LoadFriction()
    with pytest.raises(ParameterError, match="expected hinges, universals, slides or joints, got none"):
        LoadFriction(joints={"hinge_a": None})
    with pytest.raises(ParameterError, match="hinges: expected a HingeContact, got 0"):
        LoadFriction(hinges=0.1)
    with pytest.raises(ParameterError, match="joints: slide_a: expected a SlideContact"):
        LoadFriction(joints={"slide_a": PLAIN})
    with pytest.raises(ParameterError, match=r"joints: unknown joint 'elbow', expected one of slide_a"):
        LoadFriction(joints={"elbow": PLAIN})
    with pytest.raises(ParameterError, match="mu: expected zero or more, got -1"):
        HingeContact(-1, 0.01)
    with pytest.raises(ParameterError, match="arm"):
        SlideContact(mu=0.1, arm=0)
    with pytest.raises(ParameterError, match="smoothing"):
        LoadFriction(PLAIN, smoothing=0)


def test_a_file(tmp_path):
    path = tmp_path / "friction.yaml"
    path.write_text(
        "hinges: {mu: 0.1, radius: 8 mm}\nslides: {drag: 4 N, mu: 0.01, arm: 30 mm}\n"
        "joints:\n  hinge_lower_right: none\n  hinge_platform: {mu: 0.002}\n"
        "  universal_a: {mu: 0.2, radius: 5 mm}\n  slide_b: {screw: 0.1}\nsmoothing: 2 mm/s\n",
        encoding="utf-8",
    )
    read = read_load_friction(path)
    assert read.of("hinge_left") == PLAIN
    assert read.of("hinge_lower_right") is None
    assert read.of("hinge_platform") == HingeContact(0.002, 8e-3)
    assert read.of("universal_a") == HingeContact(0.2, 5e-3)
    assert read.of("universal_b") is None
    assert read.of("slide_b") == SlideContact(4.0, 0.01, 0.03, 0.1)
    assert read.smoothing == 2e-3
    assert read.screws
    assert SlideContact() == SlideContact(0.0, 0.0, 0.03, 0.0)  # what a file may leave out


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("hinges: {mu: 0.1}\n", "hinges: the field 'radius' is missing"),
        ("hinges: {mu: 0.1, radius: 8 N}\n", "hinges.radius: expected a length"),
        ("hinges: {mu: -0.1, radius: 8 mm}\n", "hinges: mu: expected zero or more, got -0.1"),
        ("slides: {drag: 4, rub: 1}\n", "slides: unknown field 'rub', expected drag, mu, arm, screw"),
        ("joints: {hinge_a: {mu: 0.1}}\n", r"joints\.hinge_a: the field 'radius' is missing"),
        ("joints: {loop_a: {mu: 0.1, radius: 1}}\n", "joints: unknown field 'loop_a'"),
        ("smoothing: 0\nslides: {drag: 1}\n", "smoothing"),
        ("{}\n", "expected hinges, universals, slides or joints"),
        ("3\n", "expected the fields hinges"),
    ],
)
def test_a_wrong_file(tmp_path, capsys, text, told):
    path = tmp_path / "f.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError, match=told):
        read_load_friction(path)
    assert main(["forces", "--samples", "5", "--load-friction", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("p3dof: error: ")
    assert "f.yaml" in error


def test_the_commands(tmp_path, capsys):
    path, stiffness, out = tmp_path / "f.yaml", tmp_path / "s.yaml", tmp_path / "out.csv"
    path.write_text(
        "hinges: {mu: 0.1, radius: 8 mm}\nslides: {drag: 4, mu: 0.01, arm: 30 mm}\n"
        "joints: {hinge_lower_right: none}\n",
        encoding="utf-8",
    )
    stiffness.write_text("rods: {diameter: 20 mm}\n", encoding="utf-8")
    given = ["--samples", "101", "--load-friction", str(path), "--stiffness", str(stiffness)]
    figure = tmp_path / "f.png"
    assert main(["forces", *given, "--out", str(out), "--figure", str(figure)]) == 0
    assert figure.stat().st_size > 10_000
    shown = " ".join(capsys.readouterr().out.split())
    for words in ("forces of load-dependent friction", "126.140", "7.642",
                  "Origin of load-dependent friction", "have only the constant friction"):  # fmt: skip
        assert words in shown
    assert float(out.read_text(encoding="utf-8").splitlines()[-1].split(",")[1]) == pytest.approx(126.1397)
    assert main(["reactions", *given, "--joint-model", "elastic", "--out", str(out)]) == 0
    assert main(["reactions", *given, "--out", str(path)]) == 2
    bearings = tmp_path / "b.yaml"
    bearings.write_text("hinges: {dynamic: 3 kN}\n", encoding="utf-8")
    assert main(["bearings", str(bearings), *given]) == 0
    task = ["size", str(task_of(tmp_path)), "--samples", "51", "--load-friction", str(path)]
    assert main([*task, "--top", "2"]) in (0, 1)
    capsys.readouterr()
    assert main([*task, "--method", "compiled"]) == 2
    assert "not by 'compiled'" in capsys.readouterr().err
    assert main(["forces", "--samples", "5", "--stiffness", str(stiffness)]) == 2
    assert "--load-friction, which is not given" in capsys.readouterr().err


def test_default_stiffness_is_that_of_reactions(robot):
    one = robot.load_friction(paper_motion(5), REFERENCE)
    other = robot.load_friction(paper_motion(5), REFERENCE, stiffness=Stiffness())
    np.testing.assert_array_equal(one.result.forces, other.result.forces)
