"""The ways to the forces: doors that are all alike, one table, one default."""

from __future__ import annotations

import ast
import inspect

import numpy as np
import pytest
from documents import ROOT
from hypothesis import given, settings
from machines import SEEDS, conditioning, random_machine, random_states

import p3dof
from p3dof._base.errors import InputError, ReachError
from p3dof._base.outputs import written
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import PAPER
from p3dof.methods import DEFAULT_METHOD, METHODS, DynamicsMethod, registry
from p3dof.methods.pinocchio import PinocchioMethod
from p3dof.methods.virtual_power import VirtualPowerMethod

HOME = np.zeros(3)
DOORS = [name for name, value in vars(DynamicsMethod).items() if inspect.isfunction(value) and name[0] != "_"]
CHOOSING = ("forces", "inverse_dynamics", "forward_dynamics", "jacobian", "mass_matrix", "simulate")
"""What of a `Manipulator` takes a method."""

ORDER = ("wrench", "on_invalid", "method", "progress", "out")
"""Of arguments by keyword."""


@pytest.mark.parametrize("name", METHODS)
def test_every_way_has_the_same_doors(name):
    way = METHODS[name](p3dof.load())
    assert set(DOORS) == {"forces", "solve", "accelerate", "jacobian", "mass_matrix"}
    assert {name for name in dir(way) if name[0] != "_"} == {*DOORS, "one"}
    for door in DOORS:
        asked = inspect.signature(getattr(DynamicsMethod, door)).parameters
        assert list(inspect.signature(getattr(type(way), door)).parameters) == list(asked)


@settings(max_examples=12)
@given(SEEDS)
def test_every_door_of_every_way_leads_to_the_same_numbers(seed):
    """Jacobian and mass matrix by Pinocchio's influence matrix and CRBA are those of the closed forms."""
    parameters = random_machine(seed)
    robot, s = p3dof.load(parameters), random_states(parameters, seed, 20)
    close = conditioning(parameters.geometry, s.pose)[:, None, None]
    ways = [METHODS[name](robot) for name in METHODS]
    poses = states_of(s.pose)
    # Columns of θ are held to those of y and z by a length.
    size = np.array([1, 1, parameters.geometry.L])
    J, *others = (way.jacobian(poses) / size for way in ways)
    for other in others:
        assert np.all(np.abs(J - other) <= 1e-12 * close * np.abs(J).max())
    M, *others = (way.mass_matrix(poses) / size / size[:, None] for way in ways)
    np.testing.assert_array_equal(M, np.swapaxes(M, -1, -2))
    for other in others:
        assert np.all(np.abs(M - other) <= 1e-12 * close * np.abs(M).max())


@pytest.mark.parametrize("shape", [(), (1,), (7,), (40,), (2, 3), (0,)])
def test_the_doors_for_poses_by_pinocchio_take_batches_of_any_shape(shape):
    robot = p3dof.load()
    count = int(np.prod(shape))
    pose = random_states(PAPER, 5, max(count, 1)).pose[:count].reshape(*shape, 3)
    allowed = 1e-12 * conditioning(PAPER.geometry, pose)
    for door in (robot.jacobian, robot.mass_matrix):
        found, expected = door(pose, method="pinocchio"), door(pose, method="virtual-power")
        assert found.shape == expected.shape == (*shape, 3, 3)
        assert np.isfinite(found).all()
        assert (np.abs(found - expected).max((-2, -1)) <= allowed * np.abs(expected).max((-2, -1))).all()


def test_mass_matrix_and_forces_of_one_way_belong_together():
    """Jᵀ f changes with the acceleration as M says, all by Pinocchio."""
    robot, s = p3dof.load(), random_states(PAPER, 8, 6)
    J, M = robot.jacobian(s.pose), robot.mass_matrix(s.pose)
    change = robot.forces(s.pose, s.velocity, s.acceleration) - robot.forces(s.pose, s.velocity, HOME)
    given_ = np.einsum("nij,ni->nj", J, change)
    expected = np.einsum("nij,nj->ni", M, s.acceleration)
    np.testing.assert_allclose(given_, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("method", METHODS)
def test_invalid_poses_are_alike_at_every_door(method):
    robot = p3dof.load()
    poses = np.zeros((2, 3, 3))
    poses[1, 1] = [0.3, 0, 0]
    for door in (robot.jacobian, robot.mass_matrix):
        with pytest.raises(
            ReachError, match=r"leg A is too short.*sample \(1, 1\), the first of 1 such of 6"
        ):
            door(poses, method=method)
        found = door(poses, on_invalid="nan", method=method)
        assert np.isnan(found[1, 1]).all()
        assert np.isfinite(np.delete(found.reshape(6, 9), 4, axis=0)).all()
        with pytest.raises(InputError, match=r"pose: expected finite numbers, got \[0.0, nan, 0.0\]"):
            door([0, np.nan, 0], method=method)
        assert np.isnan(door([0, np.nan, 0], on_invalid="nan", method=method)).all()
        # Where the actuators cannot hold the platform, both exist.
        assert np.isfinite(door([0, 0, np.pi / 3], method=method)).all()


def test_there_is_one_default_and_one_order():
    for name in CHOOSING:
        arguments = inspect.signature(getattr(p3dof.Manipulator, name)).parameters
        wanted = None if name == "simulate" else DEFAULT_METHOD  # runs in time are made in C, if they can be
        assert arguments["method"].default == wanted
    assert DEFAULT_METHOD == "pinocchio"
    for name, function in inspect.getmembers(p3dof.Manipulator, inspect.isfunction):
        arguments = inspect.signature(function).parameters
        order = [each for each in arguments if each in ORDER]
        if name in CHOOSING:
            assert "method" in order
        if name != "simulate":
            assert order == [each for each in ORDER if each in order], name
        for each in order:
            assert arguments[each].kind is inspect.Parameter.KEYWORD_ONLY, (name, each)


@pytest.mark.parametrize("method", ["closed", None, 3, ["pinocchio"], {}])
def test_a_method_that_does_not_exist(method):
    robot = p3dof.load()
    for ask in (
        lambda: robot.forces(HOME, HOME, HOME, method=method),
        lambda: robot.forward_dynamics(HOME, HOME, HOME, method=method),
        lambda: robot.jacobian(HOME, method=method),
        lambda: robot.mass_matrix(HOME, method=method),
        lambda: robot.inverse_dynamics(p3dof.paper_motion(3), method=method),
    ):
        with pytest.raises(
            InputError, match="method: expected one of 'pinocchio', 'virtual-power', 'compiled'"
        ):
            ask()


def test_a_new_way_is_one_line(monkeypatch):
    class Doubled(VirtualPowerMethod):
        def forces(self, states, out=None):
            return written(2 * super().forces(states), out)

    more = {**METHODS, "doubled": lambda machine: Doubled(machine.parameters)}
    monkeypatch.setattr(registry, "METHODS", more)
    robot = p3dof.load()
    once, twice = (robot.forces(HOME, HOME, HOME, method=m) for m in ("virtual-power", "doubled"))
    np.testing.assert_array_equal(twice, 2 * once)
    assert robot.forces(HOME, HOME, HOME, method="doubled", out=once) is once
    np.testing.assert_array_equal(once, twice)
    result = robot.inverse_dynamics(p3dof.paper_motion(5), method="doubled")
    assert result.method == "doubled"
    np.testing.assert_array_equal(
        robot.jacobian(HOME, method="doubled"), robot.jacobian(HOME, method="virtual-power")
    )


def test_methods_are_chosen_by_the_table_alone():
    """Nothing in the package compares a method with its name; that of a module that is missing is another."""
    found = []
    for path in sorted((ROOT / "p3dof").rglob("*.py")):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        handlers = [one for one in nodes if isinstance(one, ast.ExceptHandler) and one.type is not None]
        missing = [one for one in handlers if "ModuleNotFoundError" in ast.unparse(one.type)]
        modules = {id(node) for one in missing for node in ast.walk(one)}
        for node in nodes:
            if isinstance(node, ast.Compare) and id(node) not in modules:
                words = {each.value for each in ast.walk(node) if isinstance(each, ast.Constant)}
                if any(isinstance(word, str) and word in METHODS for word in words):
                    found.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert found == []


def test_a_way_is_made_once_for_a_manipulator(monkeypatch):
    made = []
    real = PinocchioMethod.__init__
    monkeypatch.setattr(PinocchioMethod, "__init__", lambda *a: (made.append(1), real(*a))[1])
    robot = p3dof.load()
    for _ in range(3):
        robot.forces(HOME, HOME, HOME)
        robot.jacobian(HOME)
    assert made == [1]
