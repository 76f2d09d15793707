"""Many designs at once: the figures of each are those of the machine that it is."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from machines import random_machine
from sanitized import LINUX, run_sanitized

import p3dof
from p3dof import PAPER, InputError
from p3dof.analysis import Designs, DesignStatus, forces_of_designs
from p3dof.analysis.designs.columns import column_of
from p3dof.analysis.designs.evaluation import BLOCK, DesignEvaluation
from p3dof.analysis.designs.figures import given, sampled, samples_of
from p3dof.analysis.designs.folding import folding_of
from p3dof.analysis.designs.results import status_of
from p3dof.closed_form.compiled import designs as compiled_designs
from p3dof.closed_form.compiled.designs import NAMES, design_kernel, forces_tangent, sliders_tangent
from p3dof.closed_form.compiled.kernels import levels
from p3dof.machine import Actuators, Body, Friction, Geometry

MOTION = p3dof.paper_motion(101)
EVERYTHING = ("singularity", "power")
FIGURES = ("reach", "peak_force", "peak_time", "rms_force", "actuation", "lowest_slider", "highest_slider",
           "peak_speed", "peak_power", "peak_braking", "work", "positive_work", "negative_work",
           "travel_margin", "tilt_margin", "speed_margin", "force_margin")  # fmt: skip
GENERAL = p3dof.Parameters(Geometry(), random_machine(2).bodies, gravity=np.array([1.0, -2.0, -9.0]))
LADEN = PAPER.carrying(Body(2.0, [0, 0, 0.05], np.zeros(3)))
DRIVES = Actuators({"sliders": 14.8}, {"slide_a": 40.0}, {"slide_b": 495.0}, {"slide_c": 2.0})
DRIVEN = p3dof.Parameters(
    Geometry(), PAPER.bodies, friction=p3dof.machine.Friction({"sliders": 3}), actuators=DRIVES
)
SLIDING = p3dof.machine.Friction({"sliders": 3.0, "hinge_c": 0.2}, {"sliders": 2.0, "universal_a": 0.1}, 0.02)


def lengths(count, seed=0):
    rng = np.random.default_rng(seed)
    return {"R [mm]": rng.uniform(235, 265, count), "L": rng.uniform(0.39, 0.45, count)}


def columns(kind, count=12):
    rng = np.random.default_rng(5)
    more = {
        "lengths": {},
        "kept": {
            "platform.mass": rng.uniform(5, 9, count),
            "bodies.leg.com.y [mm]": rng.uniform(-3, 3, count),
            "rod_left.inertia.zz": rng.uniform(0.0128, 0.0135, count),
            "gravity.z": rng.uniform(-11, -8, count),
        },
        "masses": {"platform.mass": rng.uniform(5, 9, count), "leg.com.y": rng.uniform(-3e-3, 3e-3, count)},
        "solids": {
            "rod_radius [mm]": rng.uniform(8, 12, count),
            "density": rng.uniform(2700, 7800, count),
            "r": rng.uniform(0.08, 0.11, count),
            "b": rng.uniform(0.03, 0.06, count),
        },
        "loads": {
            "payload.mass": rng.uniform(0, 3, count),
            "payload.com.z [mm]": rng.uniform(-50, 50, count),
            "payload.inertia.yy": rng.uniform(0.001, 0.0012, count),
            "payload.inertia.xx": np.full(count, 0.001),
            "payload.inertia.zz": np.full(count, 0.001),
            "offset.y [mm]": rng.uniform(-5, 5, count),
            "offset.z": rng.uniform(-0.02, 0.02, count),
            "offset.theta [deg]": rng.uniform(-2, 2, count),
            "limits.travel.low": rng.uniform(-0.3, -0.2, count),
            "limits.force": rng.uniform(100, 400, count),
        },
        "friction": {
            "friction.viscous.sliders": rng.uniform(0, 5, count),
            "friction.coulomb.slide_b": rng.uniform(0, 5, count),
            "friction.viscous.hinge_left": rng.uniform(0, 0.2, count),
            "friction.smoothing [mm/s]": rng.uniform(5, 20, count),
        },
        "actuators": {
            "armature.sliders": rng.uniform(0, 40, count),
            "actuators.armature.slide_b [g]": rng.uniform(0, 4000, count),
            "counterbalance.slide_a": rng.uniform(-20, 80, count),
            "spring.sliders [N/um]": rng.uniform(-5e-4, 5e-4, count),
            "counterweight.slide_c": rng.uniform(0, 5, count),
            "gravity.z": rng.uniform(-11, -8, count),
        },
        "constant": {
            "armature.slide_a": rng.uniform(0, 40, count),
            "counterbalance.sliders": rng.uniform(0, 80, count),
        },
        "viscous": {
            "friction.viscous.sliders": rng.uniform(0, 5, count),
            "friction.viscous.universal_b": rng.uniform(0, 0.2, count),
            "friction.coulomb.slide_a": rng.choice([0.0, 2.0], count, p=[0.7, 0.3]),
        },
    }[kind]
    return lengths(count) | more


CASES = {
    "lengths": ("lengths", PAPER, "kept", None),
    "bodies": ("kept", PAPER, "kept", None),
    "bodies without symmetry": ("masses", GENERAL, "kept", None),
    "solids": ("solids", PAPER, "solids", None),
    "payload, place and limits": ("loads", PAPER, "kept", None),
    "solids that carry something": ("loads", LADEN, "solids", None),
    "a wrench": ("lengths", PAPER, "kept", [1.0, 20.0, -30.0, 1.0, 2.0, 3.0]),
    "friction": ("friction", GENERAL, "kept", None),
    "motors and balances": ("actuators", PAPER, "kept", None),
    "motors and balances of solids, besides others": ("actuators", DRIVEN, "solids", None),
    "motors and constant forces, under a wrench": ("constant", PAPER, "kept", [0, 5.0, -30.0, 0, 2.0, 3.0]),
    "lengths of a machine with motors and balances": ("lengths", DRIVEN, "kept", None),
    "friction, viscous or both": ("viscous", GENERAL, "kept", [0.0, 5.0, -30.0, 0.0, 2.0, 3.0]),
    "friction of the machine, under a wrench": ("kept", p3dof.Parameters(
        Geometry(), PAPER.bodies, friction=SLIDING), "kept", [0.0, 5.0, -30.0, 0.0, 2.0, 3.0]),
}  # fmt: skip


each_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES)


def designs_of(case):
    kind, machine, bodies, wrench = case
    return Designs(columns(kind), machine, bodies), wrench


def expected(machine, wrench, offset):
    """The same figures by the robot of one machine; power and work by `energy`."""
    robot = p3dof.load(machine)
    motion = p3dof.Motion(
        MOTION.time, MOTION.pose + offset, MOTION.velocity, MOTION.acceleration, check=False
    )
    forces = robot.forces(motion.pose, motion.velocity, motion.acceleration, wrench=wrench, method="compiled")
    result = robot.inverse_dynamics(motion, method="compiled", wrench=wrench)
    drives, energy, near = robot.energy(result).drives, robot.energy(result), robot.singularity(motion.pose)
    limits = machine.limits
    return {
        "reach": near.serial.min(),
        "actuation": near.actuation.min(),
        "peak_force": np.abs(forces).max(axis=0),
        "peak_time": motion.time[np.abs(forces).argmax(axis=0)],
        "rms_force": drives.rms_force,
        "lowest_slider": result.sliders.min(axis=0),
        "highest_slider": result.sliders.max(axis=0),
        "peak_speed": drives.peak_speed,
        "peak_power": drives.peak_power,
        "peak_braking": drives.peak_braking,
        "work": energy.work[-1],
        "positive_work": drives.positive_work,
        "negative_work": drives.negative_work,
        "travel_margin": min(
            result.sliders.min() - limits.travel[0], limits.travel[1] - result.sliders.max()
        ),
        "tilt_margin": min(
            motion.pose[:, 2].min() - limits.tilt[0], limits.tilt[1] - motion.pose[:, 2].max()
        ),
        "speed_margin": limits.speed - drives.peak_speed.max(),
        "force_margin": limits.force - np.abs(forces).max(),
    }


def offset_of(designs, index):
    return [designs.columns.get(f"offset.{name}", np.zeros(99))[index] for name in ("y", "z", "theta")]


@each_case
@pytest.mark.parametrize("level", levels())
def test_figures_of_designs_are_those_of_their_machines(case, level):
    designs, wrench = designs_of(case)
    found = forces_of_designs(designs, MOTION, wrench=wrench, figures=EVERYTHING, level=level)
    assert found.feasible.all()
    for index in range(0, len(designs), 5):
        wanted = expected(designs[index], wrench, offset_of(designs, index))
        for name in FIGURES:
            by_steps = name in ("positive_work", "negative_work")  # other polynomials; Coulomb friction jumps
            tolerance = (1e-4 if designs[index].friction else 1e-6) if by_steps else 1e-12
            scale = max(1.0, np.abs(wanted[name]).max())
            np.testing.assert_allclose(
                getattr(found, name)[index], wanted[name], rtol=0, atol=tolerance * scale,
                err_msg=f"{name} of design {index}",
            )  # fmt: skip


def test_machines_in_a_sequence_are_designs():
    machines = [random_machine(seed) for seed in range(4, 8)] + [
        p3dof.Parameters(Geometry(), PAPER.bodies, friction=SLIDING),
        DRIVEN,
    ]
    still = p3dof.Motion(0.0 + np.arange(1), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    found = forces_of_designs(machines, still, figures=EVERYTHING)
    for machine, peak in zip(machines, found.peak_force, strict=True):
        wanted = p3dof.load(machine).forces(still.pose, still.velocity, still.acceleration, method="compiled")
        np.testing.assert_allclose(peak, np.abs(wanted[0]), rtol=1e-12)
    assert not found.work.any()  # of one sample
    assert not found.positive_work.any()


def test_viscous_friction_takes_no_hyperbolic_tangents():
    kernels = [design_kernel(name) for name in NAMES if "friction" in name]
    assert [kernel.operations(margin=True)["tanh"] for kernel in kernels] == [9, 0]


def test_a_wrong_constant_is_seen():
    """The agreement above is worth something: one constant in a billion parts wrong shows."""
    designs = Designs(columns("lengths"))
    right = forces_of_designs(designs, MOTION)
    original = compiled_designs.design_kernel("design_forces_symmetric").of_columns

    class Wrong:
        def of_columns(self, model, count):
            table = original(model, count)
            table[:, 4] *= 1 + 1e-9
            return table

    problem = DesignEvaluation(MOTION, level=levels()[-1])
    if problem._loops(False) is None:
        pytest.skip("needs the extension")
    problem._loops(False)._kernels[True] = Wrong()
    wrong = problem.evaluate(designs)
    assert np.abs(wrong.peak_force / right.peak_force - 1).max() > 1e-11


def with_impossible(count=64):
    """Designs of which some cannot be, by reason, and which columns say so."""
    given = {
        **lengths(count),
        "platform.mass": np.full(count, 8.0),
        "platform.inertia.xx": np.full(count, 0.03),
        "friction.viscous.sliders": np.zeros(count),
        "limits.force": np.full(count, 500.0),
        "armature.slide_b": np.full(count, 3.0),
        "r": np.full(count, 0.1),
        "payload.mass": np.full(count, 0.0),
        **{f"payload.inertia.{axes}": np.full(count, 0.0) for axes in ("xx", "xy", "yy", "zz")},
    }
    for name, value in {"mass": 1.0, "inertia.xx": 0.02, "inertia.yy": 0.02, "inertia.zz": 0.04}.items():
        given[f"payload.{name}"][count // 2 :] = value  # a thin plate: two moments make the third
    spoiled = {
        1: ("payload.mass", -0.5, DesignStatus.BODY),
        6: ("payload.inertia.yy", 0.01, DesignStatus.BODY),
        40: ("payload.mass", 0.0, DesignStatus.BODY),
        41: ("payload.inertia.zz", 0.041, DesignStatus.BODY),
        42: ("payload.inertia.xy", 0.021, DesignStatus.BODY),
        3: ("platform.mass", 0.0, DesignStatus.BODY),
        5: ("platform.inertia.xx", 9.0, DesignStatus.BODY),
        8: ("r", 0.3, DesignStatus.GEOMETRY),
        13: ("r", -0.1, DesignStatus.GEOMETRY),
        21: ("L", np.nan, DesignStatus.NOT_FINITE),
        22: ("L", np.inf, DesignStatus.NOT_FINITE),
        34: ("L", 0.17, DesignStatus.OUT_OF_REACH),
        35: ("friction.viscous.sliders", -1.0, DesignStatus.FRICTION),
        36: ("limits.force", 0.0, DesignStatus.LIMITS),
        37: ("armature.slide_b", -1.0, DesignStatus.ACTUATORS),
        55: ("platform.mass", np.nan, DesignStatus.NOT_FINITE),
        56: ("platform.inertia.xx", np.nan, DesignStatus.NOT_FINITE),
    }
    return given, spoiled


@pytest.mark.parametrize("friction", [False, True], ids=["", "friction"])
@pytest.mark.parametrize("level", levels())
def test_impossible_designs_have_a_reason_and_leave_their_neighbours_alone(level, friction):
    given, spoiled = with_impossible()
    if not friction:
        del given["friction.viscous.sliders"]
        spoiled = {index: what for index, what in spoiled.items() if "friction" not in what[0]}
    machine = p3dof.Parameters(Geometry(), PAPER.bodies, friction=SLIDING) if friction else None
    ask = {"figures": EVERYTHING, "gradients": ("R",), "level": level}
    clean = forces_of_designs(given, MOTION, machine, **ask)
    assert clean.feasible.all()
    for index, (name, value, _) in spoiled.items():
        given[name] = given[name].copy()
        given[name][index] = value
    found = forces_of_designs(given, MOTION, machine, **ask)
    good = np.ones(len(found), dtype=bool)
    for index, (name, value, status) in spoiled.items():
        assert found.status[index] == status, (name, value)
        assert status.in_words in found.reason(index)
        good[index] = False
    assert found.feasible.tolist() == good.tolist()
    for name in FIGURES:
        np.testing.assert_array_equal(getattr(found, name)[good], getattr(clean, name)[good], err_msg=name)
        if name not in ("reach", "actuation"):
            assert np.isnan(getattr(found, name)[~good]).all(), name
    for name, values in found.gradients["geometry.R"].items():
        np.testing.assert_array_equal(values[good], clean.gradients["geometry.R"][name][good])
        assert np.isnan(values[~good]).all()
    wanted = p3dof.load(p3dof.Parameters(Geometry(L=0.17, R=given["R [mm]"][34] / 1e3), PAPER.bodies))
    inside = wanted.singularity(MOTION.pose).serial.min(axis=1) > 0
    assert found.status_at[34] == MOTION.time[np.argmin(inside)]
    assert np.isnan(found.status_at[3])


INERTIA = ("xx", "xy", "yy", "yz", "zz", "xz")
CHOICES = {
    "lengths": {"r": (0.1, 0.25 - 3e-7, 0.25 - 5e-7, 0.25, 0.3, 0.0), "L": (0.4, 0.15, 0.1),
                "b": (0.1, 0.0, -0.1)},
    "platform": {"platform.mass": (8.0, 0.0, -1.0), **{
        f"platform.inertia.{axes}": (1e-12, 2e-12) if axes[0] == axes[1] else (0.0, 5e-13, -1.5e-12)
        for axes in INERTIA
    }},
    "cross-bar": {"crossbar_upper.mass": (2.0, 0.3, 0.0, -1.0), **{
        f"crossbar_upper.inertia.{axes}": (0.0, 0.02) for axes in ("xx", "yy", "zz")
    }},
    "payload": {"payload.mass": (2.0, 0.3, 0.0, -1.0)},
    "payload with inertia": {"payload.mass": (2.0, 0.3, 0.0, -1.0), **{
        f"payload.inertia.{axes}": (0.0, 0.02) for axes in INERTIA
    }},
    "moment of a rod": {"rod_left.inertia.xx": (0.0, 5e-5, 5e-3, 0.025, 0.03, 0.05), "L": (0.3, 0.4, 0.5)},
    "moment of the platform": {"platform.inertia.zz": (0.0, 0.03, 0.06, 0.07, 0.08, 0.1, 0.2)},
    "mass of a rod": {"rod_left.mass": (2.0, 0.3, 0.0, -1.0)},
    "mass of a cross-bar": {"crossbar_upper.mass": (2.0, 0.3, 0.0, -1.0)},
    "friction": {"friction.viscous.sliders": (0.0, 0.5, -0.5), "friction.coulomb.hinge_a": (0.0, 0.5, -0.5),
                 "friction.smoothing": (1e-3, 0.5, 0.0, -1e-3)},
    "limits": {"limits.speed": (2.0, 0.5, 0.0), "limits.force": (300.0, 0.5, 0.0),
               "limits.travel.low": (-0.5, 0.0, 0.1), "limits.tilt.high": (0.5, 0.0, -0.1)},
    "actuators": {"armature.slide_b": (0.5, 0.0, -0.1), "counterweight.slide_a": (0.5, 0.0, -0.1),
                  "counterbalance.slide_a": (0.5, 0.0, -5.0)},
}  # fmt: skip


def is_machine(designs, index):
    """Whether all its parts can be made."""
    try:
        return designs[index] is not None
    except p3dof.errors.ParameterError:
        return False


@pytest.mark.parametrize("machine", [PAPER, LADEN], ids=["", "laden"])
@pytest.mark.parametrize("bodies", ["kept", "solids"])
@pytest.mark.parametrize("case", CHOICES)
def test_impossible_are_just_those_designs_that_are_no_machine(case, bodies, machine):
    rng = np.random.default_rng(3)
    designs = Designs(
        {name: rng.choice(values, 80) for name, values in CHOICES[case].items()}, machine, bodies
    )
    found, possible = status_of(designs), [is_machine(designs, index) for index in range(80)]
    np.testing.assert_array_equal(found == DesignStatus.FEASIBLE, possible)
    assert 0 < sum(possible) < 80


@pytest.mark.parametrize("level", levels())
def test_designs_at_the_edge_of_reach_are_told_as_the_robot_does(level):
    """The least L that reaches, bit by bit: the compiled loop leaves the verdict to the closed forms."""
    y, theta = MOTION.pose[:, 0], MOTION.pose[:, 2]
    edge = np.hypot(y, 0.25 - 0.1 * np.cos(theta)).max()
    edge = max(edge, 0.15 + np.abs(y).max())
    near = edge * (1 + np.array([-1e-6, -1e-12, -1e-15, 0, 1e-15, 2e-14, 1e-13, 1e-12, 1e-10, 1e-6, 1e-3]))
    found = forces_of_designs({"L": near}, MOTION, level=level)
    for index, L in enumerate(near):
        robot = p3dof.load(p3dof.Parameters(Geometry(L=L), PAPER.bodies))
        forces = robot.forces(
            MOTION.pose, MOTION.velocity, MOTION.acceleration, method="compiled", on_invalid="nan"
        )
        assert found.feasible[index] == np.isfinite(forces).all(), L
        if found.feasible[index]:
            np.testing.assert_allclose(found.peak_force[index], np.abs(forces).max(axis=0), rtol=1e-12)


@pytest.mark.parametrize("level", levels())
def test_a_motion_into_the_actuation_singularity_is_refused(level):
    """One sample within 1e-6 rad of det J = 0: at y = 0, where β = asin((R - r cos θ) / L) is π/2 - θ."""
    from scipy.optimize import brentq

    theta = brentq(lambda t: np.arcsin((0.25 - 0.1 * np.cos(t)) / 0.4) + t - np.pi / 2, 0.5, 1.5)
    motion = p3dof.Motion.rest_to_rest([0, 0, theta - 0.4], [0, 0, theta], 1.0, 50)
    found = forces_of_designs({"R": [0.25, 0.26, 0.25]}, motion, level=level)
    assert found.status.tolist() == [DesignStatus.SINGULAR, DesignStatus.FEASIBLE, DesignStatus.SINGULAR]
    assert found.status_at[0] == 1.0
    assert found.actuation[1] < 0  # it went through the singularity, between two samples
    assert np.isnan(found.peak_force[0]).all()


def complex_figures(designs, wrench, name):
    """Figures with a complex step in one column, by reductions of this test."""
    samples, step = samples_of(MOTION, wrench), 1e-30
    folding = folding_of(tuple(designs.columns), designs.machine, designs.bodies)
    moved = {each: column.astype(complex) for each, column in designs.columns.items()}
    moved[name] = moved[name] + 1j * step
    offsets = np.stack(
        [moved.get(f"offset.{axis}", np.zeros(len(designs), complex)) for axis in ("y", "z", "theta")], axis=1
    )
    state = sampled(folding.fold(moved), samples, offsets)
    forces, speeds, sliders = (
        np.stack(group, axis=1) for group in (state.found.forces, state.found.speeds, state.found.sliders)
    )
    power = forces * speeds
    width = np.arange(len(designs))

    def at(values, index):
        return np.take_along_axis(values, index[..., None], axis=-1)[..., 0]

    def largest(values):
        index = np.abs(values.real).argmax(axis=-1)
        return at(values * np.sign(values.real), index)

    r, R, L = (np.broadcast_to(np.ravel(n), len(width)) for n in state.numbers[:3])
    y, theta = state.pose[..., 0], state.pose[..., 2]
    demand = np.stack(
        [
            (R - r)[:, None] + y,
            (R - r)[:, None] - y,
            np.sqrt(y * y + (R[:, None] - r[:, None] * np.cos(theta)) ** 2),
        ]
    )
    reach = (L[:, None] - demand).transpose(1, 0, 2).reshape(len(width), -1)
    sine = state.found.sine
    angle = np.arcsin(at(sine, sine.real.argmin(axis=-1)))
    found = {
        "reach": at(reach, reach.real.argmin(axis=-1)),
        "actuation": angle,
        "peak_force": largest(forces),
        "rms_force": np.sqrt((forces * forces) @ samples.mean),
        "lowest_slider": at(sliders, sliders.real.argmin(axis=-1)),
        "highest_slider": at(sliders, sliders.real.argmax(axis=-1)),
        "peak_speed": largest(speeds),
        "peak_power": at(power, power.real.argmax(axis=-1)),
        "peak_braking": -at(power, power.real.argmin(axis=-1)),
        "work": power @ samples.work,
        "positive_work": given(power, samples),
    }
    return {key: values.imag / step for key, values in found.items()}


@each_case
@pytest.mark.parametrize(
    "level", [*(pytest.param(one, marks=pytest.mark.slow) for one in levels()[:-1]), levels()[-1]]
)
def test_gradients_equal_complex_steps(case, level):
    designs, wrench = designs_of(case)
    by = [name for name in designs.columns if not name.startswith("limits.")]
    found = forces_of_designs(designs, MOTION, wrench=wrench, figures=EVERYTHING, gradients=by, level=level)
    for name in by:
        wanted = complex_figures(designs, wrench, name)
        assert set(found.gradients[name]) == {*wanted, "negative_work"}
        for figure, values in wanted.items():
            scale = max(1.0, np.abs(values).max())
            np.testing.assert_allclose(
                found.gradients[name][figure],
                values,
                rtol=0,
                atol=1e-10 * scale,
                err_msg=f"d {figure} / d {name}",
            )


@pytest.mark.skipif(levels() == ("numpy",), reason="the extension was not built")
@each_case
def test_compiled_gradients_are_those_of_numpy(case, monkeypatch):
    """In blocks of samples and beside designs that cannot, at samples that tie, and without NumPy's help."""
    designs, wrench = designs_of(case)
    by = [name for name in designs.columns if not name.startswith("limits.")]
    rest = p3dof.Motion(np.arange(13) / 12, *np.zeros((3, 13, 3)))
    for motion in (p3dof.paper_motion(331), p3dof.paper_motion(9), MOTION[4:5], rest):
        load = None if wrench is None else np.tile(wrench, (len(motion), 1))
        found = {}
        for level in ("numpy", levels()[-1]):
            if level != "numpy":
                monkeypatch.setattr(p3dof.analysis.designs.evaluation, "gradient_of", None)
            columns = {name: column.copy() for name, column in designs.columns.items()}
            columns["geometry.L"][3] = 0.1  # out of reach
            problem = DesignEvaluation(motion, load, EVERYTHING, by, level, 1)
            found[level] = problem.evaluate(Designs(columns, designs.machine, designs.bodies)).gradients
            monkeypatch.undo()
        wanted, gradients = found.values()
        for name, figures in wanted.items():
            for figure, values in figures.items():
                scale = max(1.0, np.nanmax(np.abs(values)))
                np.testing.assert_allclose(
                    gradients[name][figure], values, rtol=0, atol=1e-11 * scale, err_msg=figure
                )
                assert np.isnan(gradients[name][figure][3]).all()


def test_gradients_are_those_of_the_figures():
    """Against differences of the whole, compiled: sizes that follow from lengths included."""
    designs = Designs({"R": [0.25], "r": [0.101], "rod_radius": [0.01]}, bodies="solids")
    found = forces_of_designs(designs, MOTION, figures=EVERYTHING, gradients=("R", "r", "rod_radius"))
    for name, by in found.gradients.items():
        step = 1e-6
        ends = []
        for sign in (1, -1):
            moved = {**designs.columns, name: designs.columns[name] + sign * step}
            ends.append(forces_of_designs(moved, MOTION, bodies="solids", figures=EVERYTHING))
        for figure, value in by.items():
            change = (getattr(ends[0], figure) - getattr(ends[1], figure)) / (2 * step)
            np.testing.assert_allclose(
                value, change, rtol=2e-5, atol=2e-5 * max(1, np.abs(change).max()), err_msg=figure
            )


def test_figures_do_not_depend_on_blocks_threads_or_the_designs_beside():
    count = 2 * BLOCK + 17
    given_columns = lengths(count) | {
        "leg.com.y": np.where(np.arange(count) % 3, 0.0, 1e-3)
    }  # some are symmetric
    ask = {"figures": EVERYTHING}
    found = forces_of_designs(given_columns, MOTION, **ask, threads=2)
    alone = forces_of_designs(given_columns, MOTION, **ask, threads=1)
    part = forces_of_designs(
        {name: column[4000:4200] for name, column in given_columns.items()}, MOTION, **ask
    )
    for name in FIGURES:
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
        np.testing.assert_array_equal(getattr(found, name)[4000:4200], getattr(part, name))


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 9, 159, 160, 161, 1001])
def test_motions_of_any_length(count):
    time = (
        np.sort(np.random.default_rng(count).uniform(0, 1, count)) if count > 9 else np.linspace(0, 1, count)
    )
    motion = MOTION.resampled(time) if count > 1 else MOTION[50:51]
    found = forces_of_designs({"R": [0.25, 0.24]}, motion, figures=EVERYTHING)
    slow = forces_of_designs({"R": [0.25, 0.24]}, motion, figures=EVERYTHING, level="numpy")
    result = p3dof.load().inverse_dynamics(motion, method="compiled")
    drives = p3dof.load().energy(result).drives
    np.testing.assert_allclose(found.peak_force[0], drives.peak_force, rtol=1e-12)
    np.testing.assert_allclose(found.rms_force[0], drives.rms_force, rtol=1e-12)
    np.testing.assert_allclose(found.work[0], p3dof.load().energy(result).work[-1], rtol=0, atol=1e-11)
    for name in FIGURES:
        np.testing.assert_allclose(
            getattr(found, name), getattr(slow, name), rtol=1e-11, atol=1e-12, err_msg=name
        )


def test_the_derivations_of_one_machine_and_of_columns_are_one():
    """Constants by columns are those that `model_of` folds from the bodies, bit for bit."""
    from p3dof.closed_form.compiled.reduced import model_of

    for kind, bodies in (("lengths", "kept"), ("solids", "solids"), ("kept", "kept"), ("actuators", "kept")):
        designs = Designs(columns(kind), PAPER, bodies)
        numbers = folding_of(tuple(designs.columns), PAPER, bodies).fold(designs.columns).numbers
        for index in range(len(designs)):
            row = [float(n[index]) if isinstance(n, np.ndarray) else float(n) for n in numbers]
            wanted = np.array(model_of(designs[index]).numbers, dtype=float)
            np.testing.assert_allclose(row, wanted, rtol=4e-15, atol=1e-16)


class Table:
    """What pandas, polars and pyarrow have in common."""

    def __init__(self, given_columns):
        self.columns, self._columns = list(given_columns), given_columns

    def __getitem__(self, name):
        return self._columns[name]


def test_tables_of_any_kind_are_columns():
    plain = {"R [mm]": np.array([240.0, 260.0]), "L": np.array([0.4, 0.41])}
    structured = np.zeros(2, dtype=[("R [mm]", float), ("L", float)])
    for name, column in plain.items():
        structured[name] = column
    wanted = forces_of_designs(plain, MOTION).peak_force
    for table in (Table(plain), structured, {"R": [0.24, 0.26], "L [cm]": [40, 41]}):
        np.testing.assert_allclose(forces_of_designs(table, MOTION).peak_force, wanted, rtol=1e-15)
    pyarrow = pytest.importorskip("pyarrow")
    np.testing.assert_array_equal(forces_of_designs(pyarrow.table(plain), MOTION).peak_force, wanted)


def test_arrays_of_xarray_are_columns_with_their_units():
    xarray = pytest.importorskip("xarray")
    wanted = forces_of_designs({"R [mm]": [240.0, 260.0], "L": [0.4, 0.41]}, MOTION).peak_force
    data = xarray.Dataset({"R": ("design", [240.0, 260.0], {"units": "mm"}), "L": ("design", [0.4, 0.41])})
    np.testing.assert_array_equal(forces_of_designs(data, MOTION).peak_force, wanted)
    np.testing.assert_array_equal(forces_of_designs({"R": data.R, "L": data.L}, MOTION).peak_force, wanted)
    named = data.rename({"R": "R [mm]"})  # told twice, the name counts
    np.testing.assert_array_equal(forces_of_designs(named, MOTION).peak_force, wanted)
    one = data.assign(payload=((), 0.1)).rename(payload="payload.mass")
    assert len(forces_of_designs(one, MOTION)) == 2
    grid = xarray.Dataset({"R": ("i", [0.24, 0.26]), "L": ("j", [0.4, 0.41])})  # xarray would combine them
    for bad, message in (
        (grid, r"along one dimension, got i, j; .*\.stack\(run=\['i', 'j'\]\)"),
        (data.set_coords(["R", "L"]), "got coordinates only; data variables are columns"),
        (data.L, "expected columns by name"),
        (data.assign(L=data.L.assign_attrs(units="kg")), r"column 'L \[kg\]': expected a length"),
        ({"R": ("design", [0.24, 0.26])}, "column 'R': expected real numbers"),
    ):
        with pytest.raises(InputError, match=message):
            forces_of_designs(bad, MOTION)
    stacked = xarray.merge(xarray.broadcast(grid)).stack(run=["i", "j"])
    assert len(forces_of_designs(stacked, MOTION)) == 4


def test_units_are_those_of_parameter_files():
    assert column_of("R [mm]").in_si(np.array([120.0]))[0] == 0.12
    assert column_of("density [g/cm^3]").in_si(np.array([7.8]))[0] == pytest.approx(7800)
    assert column_of("offset.theta [deg]").in_si(np.array([180.0]))[0] == pytest.approx(np.pi)
    assert column_of("slider.inertia.xx [kg mm^2]").name == "bodies.slider.inertia.xx"


def test_a_problem_can_be_sent_elsewhere():
    problem = DesignEvaluation(MOTION, [0, 0, -5.0, 0, 0, 0], EVERYTHING, ("R",), threads=1)
    designs = Designs(lengths(5))
    copy = pickle.loads(pickle.dumps(problem))  # noqa: S301 - our own
    sent = pickle.loads(pickle.dumps(designs))  # noqa: S301 - our own
    wanted, found = problem.evaluate(designs).to_columns(), copy.evaluate(sent).to_columns()
    assert list(wanted) == list(found)
    for name, values in wanted.items():
        np.testing.assert_array_equal(found[name], values)


def test_other_processes_compute_the_same_bits(monkeypatch):
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from p3dof.analysis.designs import evaluation as clients

    monkeypatch.setattr(clients, "AT_A_TIME", 40)
    ask = {"figures": EVERYTHING, "gradients": ("R",), "threads": 1}
    given_columns = lengths(100)
    told = []
    with ProcessPoolExecutor(1, get_context("spawn")) as client:
        found = forces_of_designs(
            given_columns, MOTION, **ask, client=client, progress=lambda *now: told.append(now)
        )
    wanted = forces_of_designs(given_columns, MOTION, **ask).to_columns()
    assert told == [(40, 100), (80, 100), (100, 100)]
    for name, column in found.to_columns().items():
        np.testing.assert_array_equal(column, wanted[name], err_msg=name)


def results_from_columns(columns):
    """The results that columns hold, and their gradients: `DesignForces.to_columns` the other way round."""
    known = {name.partition(" [")[0]: column for name, column in columns.items()}

    def found(before, behind):
        whole = {
            name: known[f"{before}{name}{behind}"] for name in FIGURES if f"{before}{name}{behind}" in known
        }
        legs = {name: [known.get(f"{before}{name}_{leg}{behind}") for leg in "abc"] for name in FIGURES}
        return whole | {name: np.stack(each, axis=1) for name, each in legs.items() if each[0] is not None}

    return found("", ""), found("d_", "/d_geometry.R")


def test_results_as_columns_and_back(tmp_path):
    found = forces_of_designs(lengths(4), MOTION, figures=EVERYTHING, gradients=("R",))
    table = found.to_columns()
    assert "peak_force_a [N]" in table
    assert "d_peak_force_c/d_geometry.R [N/(m)]" in table
    again, gradients = results_from_columns(table)
    for name in FIGURES:
        np.testing.assert_array_equal(again[name], getattr(found, name))
    for name, values in found.gradients["geometry.R"].items():
        np.testing.assert_array_equal(gradients[name], values)
    path = found.to_csv(tmp_path / "found.csv")
    assert path.read_text().splitlines()[0] == ",".join(table)
    assert "4 of 4" in repr(found)


BAD = {
    "no such column": ({"Q": [1.0]}, {}, "unknown column 'Q'"),
    "a name that is nearly right": ({"rod_radios": [1.0]}, {"bodies": "solids"}, "did you mean 'rod_radius'"),
    "a wrong unit": ({"R [kg]": [1.0]}, {}, r"column 'R \[kg\]': expected a length"),
    "an unknown unit": ({"R [parsec]": [1.0]}, {}, "expected a length"),
    "texts": ({"R": ["wide"]}, {}, "column 'R': expected real numbers, one a design"),
    "complex numbers": ({"R": [1j]}, {}, "expected real numbers"),
    "a table in a column": ({"R": [[0.2]]}, {}, r"shape \(1, 1\)"),
    "lengths that differ": ({"R": [0.2, 0.3], "L": [0.4, 0.4, 0.4]}, {}, "of one length, got geometry.R 2"),
    "one column twice": ({"R": [0.2], "geometry.R [mm]": [200]}, {}, "two columns are geometry.R"),
    "no columns": ({}, {}, "at least one column"),
    "no table": (7, {}, "expected columns by name"),
    "a name that is none": ({3: [1.0]}, {}, "expected names of columns, got 3"),
    "solids that are not asked for": ({"rod_radius": [0.01]}, {}, "bodies='solids'"),
    "unknown bodies": ({"R": [0.2]}, {"bodies": "hollow"}, "expected 'kept' or 'solids', got 'hollow'"),
    "unknown figures": ({"R": [0.2]}, {"figures": ("noise",)}, "some of singularity, sliders, power"),
    "a gradient without its column": ({"R": [0.2]}, {"gradients": ("L",)}, "expected columns of the designs"),
    "a gradient by a limit": ({"limits.force": [2.0]}, {"gradients": ("limits.force",)}, "expected col"),
    "no machine": ({"R": [0.2]}, {"machine": 3}, "machine: expected Parameters"),
    "a level that is not here": ({"R": [0.2]}, {"level": "avx9"}, "level: expected one of"),
    "a wrench of another length": ({"R": [0.2]}, {"wrench": np.zeros((3, 6))}, "wrench: expected shape"),
    "a wrench that is not finite": ({"R": [0.2]}, {"wrench": [np.nan] * 6}, "wrench: expected finite"),
    "solids of machines": ([PAPER], {"bodies": "solids"}, "expected 'kept' for a sequence"),
    "no client": ({"R": [0.2]}, {"client": 3}, "client: expected a distributed.Client or an executor"),
    "machines and others": ([PAPER, 3], {}, "expected Parameters, got 3"),
}  # fmt: skip


@pytest.mark.parametrize(("given_columns", "options", "message"), BAD.values(), ids=BAD)
def test_bad_input_has_one_clear_error(given_columns, options, message):
    with pytest.raises(InputError, match=message):
        forces_of_designs(given_columns, MOTION, **options)


def test_a_motion_that_is_none_and_one_that_is_too_long():
    with pytest.raises(InputError, match="motion: expected a Motion, got 3"):
        forces_of_designs({"R": [0.25]}, 3)
    with pytest.raises(InputError, match="at most 100000 samples"):
        forces_of_designs({"R": [0.25]}, p3dof.paper_motion(100_001))


def test_no_designs_have_no_results():
    found = forces_of_designs({"R": []}, MOTION, figures=EVERYTHING, gradients=("R",))
    assert len(found) == 0
    assert found.peak_force.shape == (0, 3)


def test_a_design_of_many_is_a_machine_that_may_have_friction():
    designs = Designs({"friction.viscous.slide_a": [0.0, 2.0], "limits.tilt.high": [0.5, 0.6]}, PAPER)
    assert not designs[0].friction
    assert designs[1].friction.viscous["slide_a"] == 2.0
    assert designs[-1].limits.tilt[1] == 0.6
    with pytest.raises(IndexError):
        designs[2]
    assert "2 designs by" in repr(designs)
    overridden = Designs(
        {"friction.viscous.slide_a": [0.0]},
        p3dof.Parameters(Geometry(), PAPER.bodies, friction=Friction({"sliders": 1.0})),
    )
    assert "slide_a" not in overridden[0].friction.viscous
    assert overridden[0].friction.viscous["slide_b"] == 1.0


def test_the_figure_shows_every_design_in_its_place(tmp_path):
    given_columns = lengths(30) | {"L [cm]": np.r_[np.full(4, 16.0), np.linspace(39, 45, 26)]}
    del given_columns["L"]
    designs = Designs(given_columns)
    found = forces_of_designs(designs, MOTION)
    figure = p3dof.report.plots.designs_figure(designs, found, "R [mm]", "L")
    left, _, right = figure.axes
    assert (left.get_xlabel(), left.get_ylabel()) == ("R [mm]", "L [m]")
    points, colours = left.collections[0].get_offsets(), left.collections[0].get_array()
    np.testing.assert_allclose(
        points, np.column_stack([given_columns["R [mm]"], given_columns["L [cm]"] / 100])[4:]
    )
    np.testing.assert_array_equal(colours, found.peak_force.max(axis=1)[4:])
    np.testing.assert_allclose(left.lines[0].get_xdata(), given_columns["R [mm]"][:4])
    assert (np.diff(right.lines[-1].get_ydata()) >= 0).all()
    assert p3dof.report.plots.save(figure, tmp_path / "designs.png").stat().st_size > 10_000
    with pytest.raises(InputError, match="expected columns of the designs, got 'r'"):
        p3dof.report.plots.designs_figure(designs, found, "r", "L")
    with pytest.raises(InputError, match="expected results of 12 designs, got 30"):
        p3dof.report.plots.designs_figure(designs.part(0, 12), found, "R", "L")


def test_progress_is_told():
    told = []
    forces_of_designs(lengths(2 * BLOCK), MOTION, progress=lambda done, total: told.append((done, total)))
    assert told == [(BLOCK, 2 * BLOCK), (2 * BLOCK, 2 * BLOCK)]


@pytest.mark.skipif(levels() == ("numpy",), reason="the extension was not built")
def test_the_compiled_loop_refuses_what_does_not_fit():
    from p3dof._native import _compiled

    samples = samples_of(MOTION)
    good = ("design_motion", levels()[-1], 7, len(samples), 6, samples.packed())
    loop = _compiled.DesignLoop(*good)
    count = len(design_kernel("design_motion").constants)
    constants, sizes, results = (np.zeros((2, width)) for width in (count, 3, 34))
    loop(constants, sizes, None, results)
    for place, value, error in (
        (0, "kinematics", ValueError), (0, "statics", ValueError), (0, "design_forces", ValueError),
        (1, "avx9", ValueError), (3, 0, ValueError),
        (3, 102, ValueError), (4, 7, ValueError), (4, 0, ValueError), (5, samples.packed()[1:], ValueError),
        (5, samples.packed().astype(np.float32), TypeError), (5, "text", TypeError),
        (3, 2**62, (ValueError, OverflowError)),
    ):  # fmt: skip
        arguments = list(good)
        arguments[place] = value
        with pytest.raises(error):
            _compiled.DesignLoop(*arguments)
    frozen = results.copy()
    frozen.setflags(write=False)
    for place, value, error in (
        (0, constants[:, :-1].copy(), ValueError), (0, constants[:1], ValueError), (1, None, TypeError),
        (1, sizes.astype(np.float32), TypeError), (2, np.zeros((3, 3)), ValueError), (3, frozen, BufferError),
        (0, constants.T, (ValueError, BufferError)), (3, [1.0], TypeError), (3, np.zeros(67), ValueError),
    ):  # fmt: skip
        arguments = [constants, sizes, None, results]
        arguments[place] = value
        with pytest.raises(error if place != 3 or value is not frozen else (BufferError, ValueError)):
            loop(*arguments)
    with pytest.raises(TypeError, match="by position"):
        loop(constants)
    tangents = [np.zeros((2, len(kernel.constants))) for kernel in (forces_tangent(), sliders_tangent())]
    sizes = np.zeros((2, 9))
    loop.tangent(False, *tangents, sizes, None, results)
    assert np.isnan(results[:, 0]).all()
    for place, value, error in (
        (0, True, ValueError), (1, constants, ValueError), (2, None, TypeError), (2, tangents[0], ValueError),
        (3, np.zeros((2, 3)), ValueError), (4, np.zeros((3, 3)), ValueError), (5, results[:1], ValueError),
    ):  # fmt: skip
        arguments = [False, *tangents, sizes, None, results]
        arguments[place] = value
        with pytest.raises(error):
            loop.tangent(*arguments)
    with pytest.raises(TypeError, match="by position"):
        loop.tangent(False)
    rough = _compiled.DesignLoop("design_motion_with_friction", *good[1:5], samples.packed())
    with pytest.raises(ValueError, match="no form for symmetric bodies"):
        rough.tangent(True, *tangents, sizes, None, results)


UNDER_SANITIZERS = """
import numpy as np
import p3dof
from p3dof.closed_form.compiled.designs import design_kernel
from p3dof.closed_form.compiled.kernels import levels
rng, paper, D = np.random.default_rng(0), p3dof.paper_motion(101), 20
for count in (1, 2, 3, 6, 7, 8, 9, 101, 159, 160, 161, 321):
    motion = paper.resampled(np.sort(rng.uniform(0, 1, count))) if count > 1 else paper[3:4]
    for level in levels():
        for more in (
            {},
            {f"offset.{name}": rng.uniform(-0.5, 0.5, D) for name in ("y", "z", "theta")},
            {"leg.com.y": rng.choice([0, 1e-3], D), "friction.viscous.sliders": rng.uniform(-1, 3, D)},
        ):
            L = rng.choice([np.nan, np.inf, 0, 0.15, 0.2, 0.4, 1e300, 1e-300, -1], D)
            columns = {"R": rng.uniform(0.1, 0.3, D), "L": L, **more}
            ask = {"figures": ("singularity", "power"), "gradients": ("R", "L"), "level": level, "threads": 2}
            p3dof.analysis.forces_of_designs(columns, motion, **ask)
print("clean")
"""


@pytest.mark.fuzz
@LINUX
def test_the_compiled_loop_under_sanitizers(tmp_path):
    done = run_sanitized(tmp_path, UNDER_SANITIZERS)
    assert done.stdout == "clean\n", done.stderr[-3000:]


@pytest.mark.parametrize("level", levels())
def test_runs_of_many_have_columns_of_motors_and_balances(level):
    given = {
        "armature.sliders": [0.0, 14.8, 40.0],
        "counterbalance.slide_a": [0.0, 40.0, -10.0],
        "spring.slide_b": [0.0, 495.0, -200.0],
        "counterweight.slide_c": [0.0, 2.0, 0.0],
    }
    machines, hold = Designs(given), p3dof.load().gravity_forces(np.zeros(3))
    many = p3dof.load().simulate_many(0.1, given, controller=hold, level=level)
    assert len(np.unique(np.round(many.pose[:, 1], 6))) == 3
    for index, pose in enumerate(many.pose):
        run = p3dof.load(machines[index]).simulate(0.1, controller=hold, samples=2)
        np.testing.assert_allclose(pose, run.pose[-1], rtol=0, atol=1e-8)
