"""Straight-line functions: the formulas they come from, number for number."""

import cmath
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from machines import SEEDS, random_friction, random_machine, random_states, virtual_power_forces

import p3dof
from p3dof._base.tracing import Symbol, Tape, derivatives, straight_line
from p3dof._base.tracing.printing import function_of, statements
from p3dof._base.tracing.tape import in_pairs, in_two
from p3dof.closed_form import kinematics
from p3dof.runs.machine_plants import Equations


@given(seed=SEEDS)
@settings(max_examples=12, deadline=None)
def test_the_equations_are_those_of_the_arrays(seed):
    machine = replace(random_machine(seed), friction=random_friction(np.random.default_rng(seed)))
    states = random_states(machine, seed, 3)
    equations, geometry = Equations(machine), machine.geometry
    inverse = kinematics.inverse_kinematics(geometry, states.pose).sliders
    J = kinematics.inverse_jacobian(geometry, states.pose)
    forces = virtual_power_forces(machine, states.pose, states.velocity, states.acceleration)
    given_ = np.random.default_rng(seed).normal(0, np.abs(forces).max(), (3, 3))
    expected = p3dof.load(machine).forward_dynamics(
        states.pose, states.velocity, given_, wrench=states.wrench, method="virtual-power"
    )
    for i, (x, v, a) in enumerate(zip(states.pose, states.velocity, states.acceleration, strict=True)):
        sliders = equations.sliders(*x, *v)
        np.testing.assert_allclose(sliders[:3], inverse[i], rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(sliders[3:], J[i] @ v, rtol=1e-12, atol=1e-13 * np.abs(J[i]).max())
        np.testing.assert_allclose(np.reshape(equations.jacobian(*x), (3, 3)), J[i], rtol=1e-13, atol=1e-15)
        found = equations.forces(*x, *v, *a)
        np.testing.assert_allclose(found, forces[i], rtol=0, atol=1e-13 * np.abs(forces[i]).max())
        found = equations.acceleration(*x, *v, *given_[i], *states.wrench[i][[1, 2, 4]])
        np.testing.assert_allclose(found, expected[i], rtol=0, atol=1e-11 * np.abs(expected[i]).max())


def test_out_of_reach_raises_as_math_does():
    with pytest.raises((ValueError, ZeroDivisionError)):
        Equations(p3dof.PAPER).sliders(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_an_operation_is_done_once_and_only_if_it_is_needed():
    calls = []

    class Counting:
        sqrt, cos, tanh = math.sqrt, math.cos, math.tanh

        @staticmethod
        def sin(x):
            calls.append(x)
            return math.sin(x)

    def formula(tape, x, y):
        twice = tape.sin(x) + tape.sin(x)
        _ = tape.sin(y)
        return [twice, 2 * (x * y) - (y * x) / 2, -x, 1 - x, 1 / x, x - 0, 0 - x, x + 0, 0 * x, 0 / x, 3.5]

    compiled = straight_line(formula, 2, Counting)
    x, y = 0.3, 0.7
    expected = (2 * math.sin(x), 1.5 * x * y, -x, 1 - x, 1 / x, x, -x, x, 0, 0, 3.5)
    assert compiled(x, y) == pytest.approx(expected, rel=1e-15)
    assert calls == [x]


def test_constants_are_computed_beforehand_and_arrays_are_served():
    tape = Tape()
    assert [tape.rsqrt(4), tape.fabs(-3)] == [0.5, 3]
    assert [tape.sqrt(4), tape.sin(0), tape.cos(0), tape.tanh(0)] == [2, 0, 1, 0]
    compiled = straight_line(lambda tape, x: [tape.sqrt(x) + tape.tanh(x) * tape.cos(x) - 1], 1, np)
    x = np.linspace(0, 3, 7)
    np.testing.assert_allclose(compiled(x)[0], np.sqrt(x) + np.tanh(x) * np.cos(x) - 1, rtol=1e-15)


def test_numbers_keep_every_bit():
    compiled = straight_line(lambda _, x: [0.1 * x, x - 1e-320, x / (1 / 3)], 1)
    assert compiled(0.7) == (0.1 * 0.7, 0.7 - 1e-320, 0.7 / (1 / 3))


def test_derivatives_are_exact():
    def formula(tape, x, y, z):
        root = tape.sqrt(x * x + y)
        mixed = tape.sin(x * y) / root - tape.cos(z) * tape.tanh(x - z) + (1 / z) * (-x)
        return [mixed, root * 3.0, y, 2.5]

    tape = Tape()
    symbols = tape.symbols("xyz")
    rows = derivatives(formula(tape, *symbols), symbols)
    found = function_of(tape, symbols, [entry for row in rows for entry in row])
    x, y, z, h = 0.7, 1.3, 0.4, 1e-20

    class Complex:
        sqrt, sin, cos, tanh = cmath.sqrt, cmath.sin, cmath.cos, cmath.tanh

    expected = []
    for result in range(4):
        for step in ((1j * h, 0, 0), (0, 1j * h, 0), (0, 0, 1j * h)):
            moved = (x + step[0], y + step[1], z + step[2])
            expected.append(complex(formula(Complex, *moved)[result]).imag / h)
    np.testing.assert_allclose(found(x, y, z), expected, rtol=1e-14, atol=1e-15)
    assert rows[2] == [0, 1, 0]
    assert rows[3] == [0, 0, 0]
    assert derivatives([1.0, 2.0], [3.0]) == [[0], [0]]


def test_signs_move_outward_and_zeros_vanish():
    tape = Tape()
    x, y = tape.symbols("xy")
    before = len(tape.operations)
    for value in (x + 0, x * 1, x - 0, x / 1, 0 * x, 0 / x, (-x).__neg__()):
        assert value == 0 or value.index == x.index
    assert (x + (-y)).index == (x - y).index
    assert (x - (-y)).index == (y + x).index
    assert ((-x) * (-y)).index == (x * y).index
    assert (-(x * y)).index == ((-x) * y).index == (x * (-y)).index
    assert (-(x / y)).index == ((-x) / y).index == (x / (-y)).index
    assert (y - x).index == ((-x) + y).index
    assert (-x - y).index == (-(x + y)).index
    names = [operation.name for operation in tape.operations[before:]]
    assert names.count("neg") <= 6
    assert names.count("add") == 1
    assert names.count("mul") == 1


def test_what_depends_on_constants_only_is_told():
    tape = Tape()
    c, d = tape.symbols("cd", constant=True)
    (x,) = tape.symbols("x")
    once = tape.sqrt(c * d) + 2
    assert [tape.constant[value.index] for value in (once, once * x, tape.minimum(c, 3))] == [
        True,
        False,
        True,
    ]
    assert tape.minimum(3, 2) == 2


def test_statements_of_c_do_what_the_formula_does():
    tape = Tape()
    x, y = tape.symbols("xy")
    result = tape.minimum(tape.sin(x) / y, -tape.sqrt(y)) * tape.cos(x) - 0.1
    names = {x.index: "x", y.index: "y"}
    lines = statements(tape, tape.needed([result], names), names)
    scope = {"x": 0.3, "y": 2.0, "sin": math.sin, "cos": math.cos, "sqrt": math.sqrt}
    for line in lines:
        name, expression = line.removeprefix("const double ").removesuffix(";").split(" = ")
        if "?" in expression:
            condition, values = expression.split(" ? ")
            first, second = values.split(" : ")
            expression = f"{first} if {condition} else {second}"
        scope[name] = eval(expression, {}, scope)  # noqa: S307 - our own statements
    assert scope[names[result.index]] == -math.sqrt(2.0) * math.cos(0.3) - 0.1
    merged = statements(tape, tape.needed([result]), {x.index: "x", y.index: "y"}, "sincos")
    assert sum("sincos(x, &" in line for line in merged) == 1
    assert not any("= sin(" in line or "= cos(" in line for line in merged)


def test_numbers_are_computed_at_once():
    tape = Tape()
    found = [f(0.035, 1.075) for f in (tape.add, tape.subtract, tape.multiply, tape.divide)]
    assert found == [0.035 + 1.075, 0.035 - 1.075, 0.035 * 1.075, 0.035 / 1.075]
    assert not tape.operations


def test_reciprocals_are_taken_in_pairs():
    tape = Tape()
    x, y = tape.symbols(("x", "y"))
    k = tape.symbol("k", constant=True)
    a, b = 1 / x, 1 / y
    third = 1 / (a + y * b)  # waits for the first two
    results = [a * 2, b - k, third, x / y, 1 / k, 7.5]
    shared = in_pairs(tape, results)
    divisions = [tape.operations[i] for i in tape.needed(shared) if tape.operations[i].name == "div"]
    # Of two and of one; the quotient that is no reciprocal; that of a constant.
    assert [d.operands[0] == 1 for d in divisions].count(True) == 3
    assert len(divisions) == 4
    numbers = 0.7, -1.3, 2.5
    found = function_of(tape, (x, y, k), shared)(*numbers)
    assert found == pytest.approx(function_of(tape, (x, y, k), results)(*numbers), rel=1e-15)
    alone = [x + y, 1 / x, 1 / k, 3.5]  # nothing to share
    assert list(map(repr, in_pairs(tape, alone))) == list(map(repr, alone))


def test_a_formula_is_cut_where_few_values_go_over():
    tape = Tape()
    symbols = tape.symbols([f"x{i}" for i in range(6)])
    early = [tape.sqrt(1 / (x * x + 1)) for x in symbols]
    narrow = early[0] + early[1] + early[2] + early[3] + early[4] * early[5]
    late = [tape.sqrt(tape.sqrt(narrow * narrow + x)) for x in symbols]
    results = [one * other for one, other in pairwise(late)]
    places = [i for i in tape.needed(results) if tape.operations[i].operands]
    first, second, between = in_two(tape, places)
    assert sorted([*first, *second]) == places
    assert narrow.index in first
    assert len(between) == 1
    for index in first:
        assert not set(second).intersection(
            o.index for o in tape.operations[index].operands if isinstance(o, Symbol)
        )


def test_a_product_is_not_cut_from_its_sums():
    tape = Tape()
    x, y = tape.symbols(("x", "y"))
    early = tape.sqrt(tape.sqrt(x))
    product = early * y  # the one value between; two would have to go over instead
    late = [tape.sqrt(tape.sqrt(product + k)) for k in (1, 2, 3)]
    results = [late[0] + late[1], late[1] + late[2]]
    places = [i for i in tape.needed(results) if tape.operations[i].operands]
    _, second, between = in_two(tape, places)
    assert product.index in second
    assert len(between) == 1
    assert {early.index, tape.operations[early.index].operands[0].index}.issuperset(between)
