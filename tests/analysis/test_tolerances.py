"""Tolerances of forces and poses: against published numbers, machines drawn at random, and differences."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import p3dof
from p3dof._base.errors import InputError, ReachError, SweepError
from p3dof.analysis.tolerances.pose import NAMES, closure_derivatives, closures
from p3dof.machine.parameters import PAPER, SOLIDS, Body

MOTION = p3dof.paper_motion(1001)
LENGTHS = {"r": "0.1 mm", "R": "0.1 mm", "L": "0.1 mm"}
MASSES = {"slider.mass": "2 %", "leg.mass": "2 %", "platform.mass": "2 %"}
POSES = [[0, 0, 0], [0.1, 0, -0.5], [0, 0, 0.5]]
LEGS = {"R": "50 um", "r": "50 um", "L": 5e-5, "encoder": "10 um"}


@pytest.mark.parametrize(
    ("sigma", "expected"),
    [
        (LENGTHS | MASSES, (1.76961, 0.88004, 1.07221)),
        (LENGTHS, (0.07352, 0.04893, 0.03939)),
        (MASSES, (1.76809, 0.87985, 1.07211)),
    ],
)
def test_first_order_has_the_published_deviations(sigma, expected):
    found = p3dof.tolerance(PAPER, MOTION, sigma=sigma)
    assert_allclose(found.deviation.max(axis=0), expected, atol=2e-5)


def test_shares_and_gradients_of_the_peak_are_the_published_ones():
    found = p3dof.tolerance(p3dof.load(), MOTION, sigma=LENGTHS | MASSES)
    shares = dict(zip(found.names, found.shares[3], strict=True))
    assert shares["bodies.platform.mass"] == pytest.approx(0.923, abs=5e-4)
    assert shares["bodies.leg.mass"] == pytest.approx(0.053, abs=5e-4)
    assert shares["bodies.slider.mass"] == pytest.approx(0.022, abs=5e-4)
    assert shares["geometry.r"] + shares["geometry.R"] + shares["geometry.L"] < 0.002
    assert sum(shares.values()) == pytest.approx(1, abs=1e-12)
    assert_allclose(found.peak_gradient[3, :3], [587.75, -423.49, 125.27], atol=5e-3)
    assert found.units == ("m", "m", "m", "kg", "kg", "kg")


def test_a_mass_moves_as_a_body_of_another_density_does():
    """The derivative is that of a machine built anew, by the other way to the forces too."""
    found = p3dof.tolerance(PAPER, MOTION, sigma={"platform.mass": "1 %"})
    forces = []
    for share in (0.999, 1.001):
        body = PAPER.bodies.platform
        made = replace(PAPER.bodies, platform=Body(share * body.mass, body.com, share * body.inertia))
        machine = p3dof.load(replace(PAPER, bodies=made))
        forces.append(machine.inverse_dynamics(MOTION, method="pinocchio").forces)
    by_mass = (forces[1] - forces[0]) / (0.002 * PAPER.bodies.platform.mass)
    sigma = 0.01 * PAPER.bodies.platform.mass
    assert_allclose(found.deviation, np.abs(by_mass) * sigma, rtol=0, atol=1e-10)
    assert_allclose(found.worst, 3 * found.deviation, rtol=0, atol=1e-12)


def test_machines_drawn_spread_as_the_first_order_says():
    motion = p3dof.paper_motion(51)
    linear = p3dof.tolerance(PAPER, motion, sigma=LENGTHS | MASSES)
    drawn = p3dof.tolerance(PAPER, motion, sigma=LENGTHS | MASSES, method="montecarlo", samples=8000, seed=3)
    standard_error = 1 / np.sqrt(2 * 8000)
    assert_allclose(drawn.deviation, linear.deviation, rtol=5 * standard_error)
    assert_allclose(drawn.peak_deviation, linear.peak_deviation, rtol=5 * standard_error)
    assert_allclose(drawn.peak_high, linear.peak_high, atol=0.15)
    assert_allclose(drawn.peak_mean, linear.peak, atol=0.1)
    assert (drawn.low < drawn.forces).all()
    assert (drawn.high > drawn.forces).all()
    assert drawn.machines == 8000
    assert drawn.impossible == 0
    assert "montecarlo" in repr(drawn)


def test_each_machine_drawn_has_the_peak_of_that_machine():
    """Against `Designs` by hand: the masses take the inertias with them."""
    motion = p3dof.paper_motion(51)
    found = p3dof.tolerance(
        SOLIDS, motion, sigma={"leg.mass": "5 %", "L": "1 mm"}, method="montecarlo", samples=20
    )
    for moved, peaks in zip(found.drawn[:5], found.peaks, strict=False):
        share = 1 + moved[0] / SOLIDS.bodies.leg_a.mass
        legs = {
            link: Body(share * body.mass, body.com, share * body.inertia)
            for link, body in SOLIDS.bodies.items()
            if link in ("leg_a", "leg_b", "rod_left", "rod_right")
        }
        machine = replace(
            SOLIDS,
            geometry=replace(SOLIDS.geometry, L=SOLIDS.geometry.L + moved[1]),
            bodies=replace(SOLIDS.bodies, **legs),
        )
        forces = np.abs(p3dof.load(machine).inverse_dynamics(motion).forces).max(axis=0)
        assert_allclose(peaks[:3], forces, rtol=1e-10)
        assert peaks[3] == peaks[:3].max()


def test_bodies_of_solids_follow_the_lengths():
    """The gradient is that of the design whose rods grow: published."""
    found = p3dof.tolerance(
        SOLIDS, p3dof.paper_motion(201), sigma=dict.fromkeys("rRL", 1e-4), bodies="solids"
    )
    assert found.peak[3] == pytest.approx(119.93761, abs=1e-5)
    more = p3dof.tolerance(
        SOLIDS, p3dof.paper_motion(201), sigma={"r": 1e-4, "rod_radius": "0.1 mm"}, bodies="solids"
    )
    assert_allclose(more.peak_gradient[3], [1632.4, 4369.5], atol=0.05)


def test_solids_have_the_sizes_that_are_told():
    """A machine whose solids are not the paper's, scaled: its bodies are found again, told or not."""
    sizes = p3dof.machine.Dimensions(rod_radius=0.006, plate_thickness=0.03)
    machine = p3dof.of_solids(replace(PAPER.geometry, L=0.35), sizes)
    motion = p3dof.paper_motion(51)
    told = {"rod_radius": "6 mm", "plate_thickness": 0.03, "slider_edge": sizes.slider_edge}
    told |= {"corner_radius": sizes.corner_radius}
    peak = np.abs(p3dof.load(machine).inverse_dynamics(motion).forces).max()
    ask = {"sigma": {"rod_radius": "1 %", "R": 1e-4}, "bodies": "solids", "fixed": told}
    found = p3dof.tolerance(machine, motion, **ask)
    assert found.peak[3] == pytest.approx(peak, rel=1e-12)
    assert found.nominal[0] == 0.006
    drawn = p3dof.tolerance(machine, motion, method="montecarlo", samples=4000, **ask)
    assert drawn.peak_mean[3] == pytest.approx(peak, rel=1e-3)
    assert drawn.peak_deviation[3] == pytest.approx(found.peak_deviation[3], rel=0.05)
    local = p3dof.sensitivity(machine, motion, ask["sigma"], method="gradient", bodies="solids", fixed=told)
    assert_allclose(local.gradient, found.peak_gradient[3])
    ask["fixed"] = None
    assert p3dof.tolerance(machine, motion, **ask).peak[3] == pytest.approx(peak, rel=1e-12)
    bare = replace(machine, dimensions={})
    assert p3dof.tolerance(bare, motion, **ask).peak[3] != pytest.approx(peak, rel=0.1)


def test_balances_vary_about_those_of_the_machine():
    """Each slider has its own; a group moves as one."""
    balance = {"slide_a": 40.0, "slide_b": 30.0, "slide_c": 50.0}
    machine = replace(PAPER, actuators=p3dof.machine.Actuators(counterbalance=balance))
    motion = p3dof.paper_motion(51)
    found = p3dof.tolerance(machine, motion, sigma={"actuators.counterbalance.sliders": "2 N"})
    forces = p3dof.load(machine).inverse_dynamics(motion).forces
    assert_allclose(found.forces, forces, rtol=0, atol=1e-9)
    assert_allclose(found.deviation, 2.0, rtol=0, atol=1e-12)
    assert found.nominal[0] == 40


def test_a_load_counts():
    wrench = np.array([0.0, 500.0, 0.0, 0, 0, 0])
    without = p3dof.tolerance(PAPER, MOTION, sigma=LENGTHS)
    loaded = p3dof.tolerance(PAPER, MOTION, sigma=LENGTHS, wrench=wrench)
    assert loaded.peak[3] > without.peak[3] + 50
    assert (
        loaded.deviation.max(axis=0)[:2] > 5 * without.deviation.max(axis=0)[:2]
    ).all()  # C bears nothing of it


def test_the_same_seed_gives_the_same_machines_anywhere(tmp_path):
    motion = p3dof.paper_motion(11)
    ask = {"sigma": LENGTHS, "method": "montecarlo", "samples": 4100, "seed": 5}
    here = p3dof.tolerance(PAPER, motion, **ask)
    with ThreadPoolExecutor(2) as client:
        there = p3dof.tolerance(PAPER, motion, client=client, folder=tmp_path / "draws", **ask)
    assert_array_equal(there.peaks, here.peaks)
    assert_array_equal(there.deviation, here.deviation)
    blocks = sorted(path for path in (tmp_path / "draws" / "blocks").rglob("*") if path.is_file())
    assert len(blocks) == 3
    blocks[1].unlink()
    seen = []
    again = p3dof.tolerance(
        PAPER, motion, folder=tmp_path / "draws", resume=True, progress=lambda *a: seen.append(a), **ask
    )
    assert_array_equal(again.peaks, here.peaks)
    assert seen[-1] == (4100, 4100)
    with pytest.raises(SweepError, match="resume=True"):
        p3dof.tolerance(PAPER, motion, folder=tmp_path / "draws", **ask)
    assert not np.array_equal(p3dof.tolerance(PAPER, motion, **ask | {"seed": 6}).peaks, here.peaks)


def test_a_uniform_spread_has_the_same_deviation_and_ends():
    motion = p3dof.paper_motion(11)
    found = p3dof.tolerance(
        PAPER, motion, sigma={"platform.mass": "2 %"}, method="montecarlo", samples=4000, spread="uniform"
    )
    assert found.drawn.std() == pytest.approx(found.sigma[0], rel=0.03)
    assert np.abs(found.drawn).max() <= np.sqrt(3) * found.sigma[0]


def test_machines_that_cannot_move_are_counted_and_left_out():
    motion = p3dof.paper_motion(11)
    found = p3dof.tolerance(PAPER, motion, sigma={"L": "100 mm"}, method="montecarlo", samples=500, seed=1)
    assert 0 < found.impossible < 100
    assert np.isfinite(found.deviation).all()
    assert np.isfinite(found.peak_high).all()


def test_static_errors_of_the_pose_are_the_published_ones():
    found = p3dof.tolerance(PAPER, pose=POSES, sigma=LEGS)
    scaled = found.deviation * [1e6, 1e6, 1e3]
    published = [[108.141, 43.745, 0.757688], [108.600, 46.550, 0.715293], [108.141, 43.745, 1.292619]]
    assert_allclose(scaled, published, rtol=1e-5)
    worst = found.worst[0] * [1e6, 1e6, 1e3] - [774.16, 313.16, 6.2633]
    assert (np.abs(worst) <= [5e-3, 5e-3, 5e-5]).all()  # as it is rounded
    assert found.names == NAMES
    assert_allclose(found.shares.sum(axis=-1), 1)
    assert_allclose(np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)), found.deviation)


def test_poses_that_are_solved_for_spread_as_the_first_order_says():
    linear = p3dof.tolerance(PAPER, pose=POSES[0], sigma=LEGS)
    drawn = p3dof.tolerance(PAPER, pose=POSES[0], sigma=LEGS, method="montecarlo", samples=100_000, seed=2)
    assert_allclose(drawn.deviation, linear.deviation, rtol=4 / np.sqrt(2 * 100_000))
    assert_allclose(drawn.high, linear.high, rtol=0.01)
    assert_allclose(drawn.covariance[0, 0], linear.covariance[0, 0], rtol=0.02)
    assert drawn.impossible == 0


def test_closures_are_those_of_the_machine_and_of_machines_with_other_lengths():
    rng = np.random.default_rng(1)
    poses = rng.uniform([-0.1, -0.2, -0.7], [0.1, 0.2, 0.7], (20, 3))
    own = p3dof.load()
    assert_allclose(closures(PAPER.geometry, poses, np.zeros(12)), own.inverse_kinematics(poses).sliders)
    off = np.tile([3e-3, -2e-3, 5e-3, 0.0], 3)
    geometry = replace(PAPER.geometry, R=0.253, r=0.098, L=0.405)
    other = p3dof.load(replace(PAPER, geometry=geometry))
    expected = other.inverse_kinematics(poses).sliders + geometry.h - PAPER.geometry.h
    assert_allclose(closures(PAPER.geometry, poses, off), expected, rtol=0, atol=1e-15)
    by_pose, by_off = closure_derivatives(PAPER.geometry, poses, np.zeros(12))
    assert_allclose(by_pose, own.jacobian(poses), rtol=0, atol=1e-14)
    tiny = rng.normal(0, 1e-6, 12)
    change = closures(PAPER.geometry, poses, tiny) - closures(PAPER.geometry, poses, -tiny)
    assert_allclose(change / 2, by_off @ tiny, rtol=0, atol=1e-15)


def test_one_leg_alone_and_all_legs_with_an_exception():
    alone = p3dof.tolerance(PAPER, pose=POSES[0], sigma={"L.c": "50 um"})
    assert alone.names == ("L.c",)
    assert_allclose(alone.deviation[:2], 0, rtol=0, atol=1e-18)
    both = p3dof.tolerance(PAPER, pose=POSES[0], sigma={"L.c": "1 um", "geometry.L": "50 um"})
    assert_allclose(both.sigma, [5e-5, 5e-5, 1e-6])


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"sigma": {}}, "sigma: expected numbers by names"),
        ({"sigma": {"R": "-1 mm"}}, "sigma of geometry.R: expected"),
        ({"sigma": {"R": "2 kg"}}, "expected a length.*share such as '2 %'"),
        ({"sigma": {"R": "two %"}}, "expected a share such as '2 %'"),
        ({"sigma": {"payload.com.x": "2 %"}}, "of a number that is 0"),
        ({"sigma": {"radius": 1}}, "sigma: unknown column 'radius'"),
        ({"sigma": {"R": 1e-4, "geometry.R": 1e-4}}, "geometry.R is there twice"),
        ({"sigma": {"limits.force": 1}}, "a limit moves no force"),
        ({"sigma": {"crossbar.mass": "2 %"}}, "has no mass"),
        ({"sigma": {"rod_radius": 1e-4}}, "bodies='solids'"),
        ({"sigma": {"leg.mass": 1e-4}, "bodies": "solids"}, "let density vary"),
        ({"fixed": {"rod_radius": 0.01}}, "fixed: dimensions.rod_radius: sizes need bodies of solids"),
        ({"fixed": {"L": "1 kg"}}, "fixed: geometry.L: expected a length"),
        ({"fixed": 3}, "fixed: expected numbers by names"),
        ({"method": "guess"}, "method: expected 'gradient' or 'montecarlo'"),
        ({"bodies": "mine"}, "bodies: expected"),
        ({"worst": 0}, "worst: expected"),
        ({"samples": 1}, "samples: expected a whole number from 2"),
        ({"spread": "round", "method": "montecarlo"}, "spread: expected 'normal' or 'uniform'"),
        ({"resume": True, "method": "montecarlo"}, "resume: expected a folder"),
        ({"pose": [0, 0, 0]}, "one of both"),
        ({"motion": None}, "one of both"),
        ({"motion": "paper"}, "motion: expected a Motion"),
        ({"robot": 3}, "robot: expected a Manipulator or Parameters"),
        ({"motion": None, "pose": [0, 0, 0], "sigma": {"rod": 1e-4}}, "parallelogram and tilted guides"),
        ({"motion": None, "pose": [0, 0, 0], "sigma": {"encoder": "2 %"}}, "of a number that is 0"),
        ({"sigma": {"L": "390 mm"}, "method": "montecarlo", "samples": 2, "seed": 1}, "samples: only"),
    ],
)
def test_bad_arguments_are_told(changes, told):
    given = {"robot": PAPER, "motion": p3dof.paper_motion(11), "sigma": LENGTHS} | changes
    with pytest.raises(InputError, match=told):
        p3dof.tolerance(**given)


def test_a_machine_that_cannot_make_the_motion_is_refused():
    short = replace(PAPER, geometry=replace(PAPER.geometry, L=0.16))
    with pytest.raises(InputError, match="the nominal machine cannot perform the motion: a leg is too short"):
        p3dof.tolerance(short, MOTION, sigma=LENGTHS)
    with pytest.raises(ReachError):
        p3dof.tolerance(PAPER, pose=[0.5, 0, 0], sigma=LEGS)


def test_draws_of_another_machine_are_not_mixed(tmp_path):
    ask = {"sigma": LENGTHS, "method": "montecarlo", "samples": 20, "folder": tmp_path / "draws"}
    p3dof.tolerance(PAPER, p3dof.paper_motion(5), **ask)
    with pytest.raises(SweepError):
        p3dof.tolerance(SOLIDS, p3dof.paper_motion(5), resume=True, **ask)


@pytest.mark.parametrize("where", [{"pose": [0, 0, 0]}, {"motion": p3dof.paper_motion(11)}])
def test_a_length_that_varies_by_more_than_it_is_lacks_a_unit(where):
    with pytest.raises(p3dof.InputError, match=r"expected less than the number itself, 0\.25 m, got 50 m"):
        p3dof.tolerance(p3dof.load(), sigma={"R": 50}, **where)
