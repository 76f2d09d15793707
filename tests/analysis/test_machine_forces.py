"""Forces as linear functions of parameters: the machine's in closed form beside any robot's by Pinocchio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from documents import ROOT

import p3dof
from p3dof._base.errors import InputError, ModelError, ParameterError
from p3dof.analysis import MachineForces
from p3dof.loops import LoopForces
from p3dof.machine.parameters import PASSIVE, SLIDES, SOLIDS, Actuators, Friction

MACHINE = replace(
    SOLIDS,
    friction=Friction({"sliders": 20.0, "hinge_a": 0.3}, {"slide_b": 4.0, "joints": 0.2}),
    actuators=Actuators({"slide_a": 3.0}, {"sliders": 50.0}, {"slide_c": 80.0}, {"slide_b": 2.0}),
)
GALLERY = ROOT / "docs/_static/gallery"


def states_of(forces, seed=0, count=40):
    rng = np.random.default_rng(seed)
    pose = rng.uniform(-1, 1, (count, 3)) * [0.1, 0.1, 0.6]
    return forces.from_coordinates(pose, rng.normal(size=(count, 3)), 5 * rng.normal(size=(count, 3)))


def changed(forces, seed=0):
    """Possible parameters: each body heavier or lighter as a whole, all other data as they may be."""
    rng, found = np.random.default_rng(seed), forces.design.copy()
    for first in range(0, sum(name.endswith(".m") for name in forces.names) * 10, 10):
        found[first : first + 10] *= rng.uniform(0.5, 2.0)
    for at, name in enumerate(forces.names):
        if name.rpartition(".")[2] in (
            "armature",
            "damping",
            "friction",
            "counterbalance",
            "spring",
            "preload",
        ):
            found[at] += rng.uniform(0.1, 1.0) if "[" not in name else 0.0
    return found


@pytest.mark.parametrize("passive", [False, True])
def test_the_machines_forces_are_those_of_pinocchio_at_any_parameters(passive):
    forces = MachineForces(MACHINE, passive)
    states = states_of(forces)
    rows = forces.rows(states)
    for seed, parameters in enumerate((forces.design, changed(forces, 1), changed(forces, 2))):
        machine = forces.corrected(parameters)
        assert seed or machine == forces.parameters or repr(machine) == repr(forces.parameters)
        expected = p3dof.load(machine).forces(*states.whole[:3], method="pinocchio")
        found = rows.columns @ parameters + rows.known
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    rubbing = {name.rpartition(".")[0] for name in forces.names if name.endswith(".damping")}
    assert rubbing == {*SLIDES, *(PASSIVE if passive else ())}


def test_the_machine_as_any_robot_owes_the_same_to_each_body():
    """Columns of the ten bodies in closed form and by Pinocchio's regressor."""
    forces, loop = MachineForces(SOLIDS), LoopForces(p3dof.load(SOLIDS).loop)
    states = states_of(forces)
    own = loop.from_actuators(states.positions, states.velocities, states.accelerations)
    found, other = forces.rows(states), loop.rows(own)
    assert loop.actuators == forces.actuators
    total = other.columns @ loop.design + other.known
    np.testing.assert_allclose(found.columns @ forces.design + found.known, total, rtol=0, atol=1e-9)
    common = [name for name in forces.names if name in loop.names and "damping" in name]
    assert len(common) == 3
    for name in common:
        np.testing.assert_allclose(
            found.columns[..., forces.names.index(name)],
            other.columns[..., loop.names.index(name)],
            atol=1e-12,
        )


def test_states_from_sliders_and_from_poses_are_the_same():
    forces = MachineForces(MACHINE)
    states = states_of(forces, 3)
    back = forces.from_actuators(states.positions, states.velocities, states.accelerations)
    for name, size in (("pose", 1), ("velocity", 3), ("acceleration", 30)):
        np.testing.assert_allclose(
            getattr(back.whole, name), getattr(states.whole, name), rtol=0, atol=size * 1e-13
        )


def test_limits_are_zero_where_they_are_reached():
    forces = MachineForces(MACHINE)
    limits, rest = MACHINE.limits, np.zeros((1, 3))
    low, high = limits.travel
    names = list(forces.limits)

    def excess(states):
        return dict(zip(names, forces.excess(states)[0], strict=True))

    all_up = excess(forces.from_actuators([[high] * 3], rest, rest))
    all_down = excess(forces.from_actuators([[low] * 3], rest, rest))
    for slide in SLIDES:
        assert all_up[f"position of {slide}"] == pytest.approx(0, abs=1e-12)
        assert all_down[f"position of {slide}"] == pytest.approx(0, abs=1e-12)
    fast = excess(forces.from_actuators(rest, [[limits.speed, -limits.speed, 0]], rest))
    assert [fast[f"speed of {slide}"] for slide in SLIDES] == pytest.approx([0, 0, -1], abs=1e-12)
    tilted = excess(forces.from_coordinates([[0, 0, limits.tilt[0]]], rest, rest))
    assert tilted["tilt"] == pytest.approx(0, abs=1e-12)
    here = forces.from_actuators(rest, rest, rest)
    held = p3dof.load(MACHINE).forces(np.zeros(3), np.zeros(3), np.zeros(3))
    found = excess(here)
    assert [found[f"force of {slide}"] for slide in SLIDES] == pytest.approx(np.abs(held) / limits.force - 1)
    margin = p3dof.load(MACHINE).singularity(np.zeros(3)).actuation
    assert found["singularity margin"] == pytest.approx(1 - float(margin) / 0.1)


@pytest.mark.parametrize("name", ["five_bar", "stewart", "delta", "four_bar"])
def test_any_robots_forces_are_those_of_the_corrected_robot(name):
    robot = p3dof.load_robot(GALLERY / f"{name}.urdf")
    forces, rng = LoopForces(robot), np.random.default_rng(0)
    m = len(forces.actuators)
    slides = np.array([0.1 if unit == "m" else 1.0 for unit in forces.position_units])
    motion = (
        forces.home + 0.1 * slides * rng.normal(size=(10, m)),
        rng.normal(size=(10, m)),
        rng.normal(size=(10, m)),
    )
    states = forces.from_actuators(*motion)
    rows, parameters = forces.rows(states), changed(forces)
    for values in (forces.design, parameters):
        found = forces.corrected(values).inverse_dynamics_batch(*states.whole).tau
        np.testing.assert_allclose(rows.columns @ values + rows.known, found, rtol=0, atol=1e-11)
    excess = dict(zip(forces.limits, forces.excess(states).T, strict=True))
    model = robot.model
    for k, joint in enumerate(forces.actuators):
        limit = model.velocityLimit[model.idx_vs[model.getJointId(joint)]]
        np.testing.assert_allclose(
            excess[f"speed of {joint}"], np.abs(motion[1][:, k]) / limit - 1, rtol=1e-12
        )
    margins = robot.singularity_margins(states.whole[0]).actuation
    np.testing.assert_allclose(excess["singularity margin"], 1 - margins / 0.05, rtol=1e-12)


def test_doubts_about_friction_are_shares_of_the_limits():
    forces = LoopForces(p3dof.load_robot(GALLERY / "five_bar.urdf"))
    doubts = dict(zip(forces.names, forces.deviations(coulomb=0.02, viscous=0.1), strict=True))
    assert doubts["left_motor.friction"] == pytest.approx(0.02 * 500)
    assert doubts["left_motor.damping"] == pytest.approx(0.1 * 500 / 20)
    assert doubts["left_elbow.friction"] == 0
    machine = MachineForces(SOLIDS)
    own = dict(zip(machine.names, machine.deviations(), strict=True))
    assert (own["slide_a.friction"], own["slide_a.damping"]) == pytest.approx((5.0, 12.5))
    assert own["slide_a.armature"] == 0


def test_what_cannot_be_is_refused():
    five_bar = p3dof.load_robot(GALLERY / "five_bar.urdf")
    one = replace(five_bar.sidecar, actuated=five_bar.actuated[:1])
    with pytest.raises(ModelError, match="1 actuators do not determine a motion with 2 degrees of freedom"):
        LoopForces(p3dof.ClosedLoopModel(five_bar.model, one))
    machine = MachineForces(SOLIDS)
    impossible = machine.design.copy()
    impossible[machine.names.index("platform.Ixx")] *= -1
    with pytest.raises(InputError, match="no body has the mass, mass centre and inertia of platform"):
        machine.corrected(impossible)
    negative = machine.design.copy()
    negative[machine.names.index("slide_a.friction")] = -1.0
    with pytest.raises(ParameterError, match="slide_a: expected zero or more"):
        machine.corrected(negative)
    with pytest.raises(InputError, match=r"positions: expected shape"):
        machine.from_actuators(np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2)))
    robot = LoopForces(p3dof.load_robot(GALLERY / "stewart.urdf"))
    one = robot.design.copy()
    (ball,) = [at for at, name in enumerate(robot.names) if name.endswith("[0].damping")][:1]
    one[ball] = 1.0
    with pytest.raises(InputError, match="cannot be changed in the robot"):
        robot.corrected(one)
