"""Relations of columns and measures: what they mean, derivatives, what is refused, optima under them."""

import cmath
import math
import pickle

import numpy as np
import pytest
from design_problems import paper_problem
from hypothesis import given
from hypothesis import strategies as st

import p3dof
from p3dof._base.errors import InputError
from p3dof.design import DesignProblem
from p3dof.design.optimisation import FunctionMeasure, Robust, relation
from p3dof.design.optimisation.constraints import Formula, Linear
from p3dof.design.optimisation.expressions import FUNCTIONS, read_comparison
from p3dof.design.optimisation.population import Population

NAMES = ("a", "b", "c")
SHORT = p3dof.paper_motion(21)


def of_names(name: str) -> tuple[str, str]:
    if name not in NAMES:
        raise InputError(f"no name {name}")
    return name, "one of any unit"


def least(*given: complex) -> complex:
    return min(given, key=lambda z: complex(z).real)  # the first of those that are alike


def most(*given: complex) -> complex:
    return max(given, key=lambda z: complex(z).real)


ANALYTIC = ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log")
COMPLEX = {
    **{name: getattr(cmath, name) for name in ANALYTIC},
    "abs": lambda z: z if z.real >= 0 else -z,
    "min": least,
    "max": most,
    "atan2": lambda y, x: 2 * cmath.atan(y / (cmath.sqrt(x * x + y * y) + x)),
    "pi": math.pi,
}
"""What Python's own evaluation takes: analytic functions, so that a complex step gives derivatives."""
STEP = 1e-30


def by_python(text: str, values: dict[str, complex]) -> complex:
    return complex(eval(text, {"__builtins__": {}}, {**COMPLEX, **values}))  # noqa: S307 - the test's own text


def ours(text: str, values: dict[str, float]) -> tuple[float, np.ndarray]:
    """Return the value of a formula of a, b, c, and its derivatives."""
    node = read_comparison(f"{text} >= a - a", of_names).left
    known = {name: (np.array([values[name]]), np.eye(3)[[k]]) for k, name in enumerate(NAMES)}
    value, slopes = node.of(known)
    return float(np.ravel(value)[0]), np.broadcast_to(slopes, (1, 3))[0]


@pytest.mark.parametrize(
    "text",
    [
        "a + b*c - 2*c/a",
        "-a**2 + b**-1.5 + c**0",
        "a**b",
        "2**a - -b",
        "sqrt(a) + sin(b)*cos(c) + tan(a/4)",
        "asin(a/3)*acos(b/3) - atan(c)",
        "atan2(a - 1, b - 2) + atan2(b, -c)",
        "exp(-a)*log(b)",
        "abs(a - 2)*max(a, b, c) + min(b, 2*c, a)",
        "pi*a**2/4 + (a + (b - (c)))",
        "1.5e-1*a + .5*b + 3.*c",
        "a**2 + b**2 - 2*a*b*cos(c)",
    ],
)
def test_values_and_derivatives_are_those_of_python_and_of_complex_steps(text):
    values = {"a": 1.3, "b": 0.7, "c": 2.1}
    value, slopes = ours(text, values)
    assert value == pytest.approx(by_python(text, values).real, rel=1e-14)
    for k, name in enumerate(NAMES):
        slope = by_python(text, {**values, name: values[name] + 1j * STEP}).imag / STEP
        assert slopes[k] == pytest.approx(slope, rel=1e-13, abs=1e-15)


NUMBERS = st.floats(0.01, 9).map(lambda x: f"{x:.3g}")
FORMULAS = st.recursive(
    st.one_of(NUMBERS, st.sampled_from((*NAMES, "pi"))),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        st.tuples(inner, st.integers(-3, 3)).map(lambda t: f"({t[0]})**{t[1]}"),
        inner.map(lambda t: f"-({t})"),
        st.tuples(st.sampled_from(("sin", "cos", "atan", "abs", "exp", "sqrt", "log")), inner).map(
            lambda t: f"{t[0]}({t[1]})"
        ),
        st.tuples(st.sampled_from(("min", "max")), inner, inner).map(lambda t: f"{t[0]}({t[1]}, {t[2]})"),
    ),
    max_leaves=12,
)


@given(text=FORMULAS, values=st.tuples(*[st.floats(0.1, 3)] * 3))
def test_random_formulas_are_what_python_makes_of_them(text, values):
    point = dict(zip(NAMES, values, strict=True))
    try:
        value, slopes = ours(text, point)
    except InputError as error:
        known = ("finite number", "division by zero", "characters", "inside each other")
        if not any(told in str(error) for told in known):
            raise
        return
    try:
        expected = by_python(text, point)
        rates = [by_python(text, {**point, n: point[n] + 1j * STEP}).imag / STEP for n in NAMES]
    except (ZeroDivisionError, OverflowError, ValueError):
        return
    if abs(expected.imag) > 1e-12 * abs(expected) or not np.isfinite([expected.real, value]).all():
        return  # a root or a logarithm of what is negative
    assert value == pytest.approx(expected.real, rel=1e-9, abs=1e-12)
    if np.isfinite(slopes).all() and max(map(abs, rates)) < 1e6:
        assert slopes == pytest.approx(rates, rel=1e-6, abs=1e-6 * max(1.0, *map(abs, rates)))


def test_where_two_are_alike_the_first_one_has_the_derivative_and_roots_at_zero_none():
    assert ours("max(a, b)", {"a": 1.0, "b": 1.0, "c": 0.0})[1].tolist() == [1, 0, 0]
    assert ours("min(b, a)", {"a": 1.0, "b": 1.0, "c": 0.0})[1].tolist() == [0, 1, 0]
    assert ours("c**2 + c**0", {"a": 1.0, "b": 1.0, "c": 0.0})[0] == 1.0
    assert ours("c**0*a", {"a": 1.0, "b": 1.0, "c": 0.0})[1].tolist() == [1, 0, 0]
    problem = DesignProblem({"R": (0.2, 0.3)}, SHORT, constraints=["sqrt(max(R - 0.25, 0)) <= 0.1"])
    assert problem.gradient([0.24])["sqrt(max(R - 0.25, 0)) <= 0.1"].tolist() == [0]


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        ("R >= __import__('os')", 17, "unexpected character \"'\""),
        ("R >= __import__(os)", 6, "no function"),
        ("R >= r.__class__", 6, "unknown column"),
        ("R >= (r).__class__", 6, "unknown column"),
        ("R >= sin(r).real", 6, "before the dot"),
        ("R >= 9**9**9", 6, "exponent of at most 100"),
        ("R >= r**101", 6, "exponent of at most 100"),
        ("R >= 1e300*1e300", 6, "finite"),
        ("R >= r*1e999", 8, "finite"),
        ("R >= " + "9" * 400, 6, "finite"),
        ("R >= lambda: 1", 12, "unexpected character ':'"),
        ("R >= (lambda)", None, "can go on"),
        ("R >= [x for x in R]", 6, "unexpected character '\\['"),
        ("R >= (x for x in R)", 6, "functions only"),
        ("R >= {r}", 6, "unexpected character '\\{'"),
        ("R >= r if r else L", 1, "one >= or <="),
        ("R >= (r if r else L)", 7, "functions only"),
        ("R >= (r and L)", 7, "functions only"),
        ("R >= (r >= L)", 7, "functions only"),
        ("R >= not r", None, "can go on"),
        ("R >= (r, L)", 6, "functions only"),
        ("R >= max(*r)", 6, "two or more arguments, got 1"),
        ("R >= max(r, *L)", 13, "functions only"),
        ("R >= max(r, key=L)", 6, "functions only"),
        ("R >= (r := 1)", 9, "unexpected character ':'"),
        ("R >= r // 2", 6, "functions only"),
        ("R >= ~r", 6, "unexpected character '~'"),
        ("R == r", 1, "one >= or <="),
        ("R >= r >= L", 1, "one >= or <="),
        ("R", 1, "one >= or <="),
        ("Ｒ >= r", 1, "unexpected character '\\\\uff32'"),
        ("R >= ѕin(r)", 6, "unexpected character '\\\\u0455'"),
        ("R ≥ r", 3, "write >="),
        ("R^2 >= r", 2, r"write \*\*"),
        ("R² >= r", 2, r"write \*\*2"),
        ("R >= r\x00", 7, "unexpected character"),
        ("R >= r # more", 8, "unexpected character '#'"),
        ("R >= 3 foo", 8, "'foo' is no unit"),
        ("R >= 2 min(r, L)", 8, "'min' is no unit"),
        ("R >= 30 mm**2", 11, "brackets"),
        ("R >= 30 mm * r", 6, r"different units: m and m\^2"),
        ("R >= sni(r)", 6, "did you mean 'sin'"),
        ("R >= sin(0.1, 2)", 6, "expected 1 arguments, got 2"),
        ("R >= atan2(r)", 6, "expected 2 arguments, got 1"),
        ("R >= True", 6, "real number"),
        ("R >= 1j*r", 7, "'j' is no unit"),
        ("R >= 0x10*r", 7, "'x10' is no unit"),
        ("R >= r/0", 6, "division by zero"),
        ("R >= 1/0", 6, "finite"),
        ("R >= sqrt(-1)*r", 6, "finite"),
        ("R >= peak_forc", 6, "did you mean 'peak_force'"),
        ("R >= (", None, "can go on"),
        ("R >= r)", None, "can go on"),
        ("\n R >= +", None, "can go on"),
        ("R >= platform.mass", 6, "different units: m and kg"),
        ("R + platform.mass >= 0.1", 5, "different units: m and kg"),
        ("sin(R) >= 0.1", 5, "different units: m and a plain number"),
        ("R**r >= 0.1", 4, "different units: m and a plain number"),
        ("2**r*R >= 0.1", 4, "different units: m and a plain number"),
        ("min(R, platform.mass) >= 0.1", 8, "different units: m and kg"),
        ("R >= 3 kg", 6, "different units: m and kg"),
        ("R/platform.mass >= 3 kg", 20, r"different units: m kg\^-1 and kg"),
    ],
)  # fmt: skip
def test_what_is_no_relation_is_refused_at_its_character(text, place, message):
    with pytest.raises(InputError, match=message) as caught:
        relation(text)
    assert f"character {place or ''}" in str(caught.value)  # where Python's parser gives up depends on it
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("(" * 10_000, "at most 500 characters, got 10000"),
        ("R >= " + "(" * 240 + "r" + ")" * 240, "can go on|inside each other"),
        ("R >= " + "-" * 60 + "r", "at most 50 operations inside each other"),
        ("R >= " + "+".join("r" * 60), "at most 50 operations inside each other"),
        ("R*1e300*1e300 >= r", "expected smaller numbers"),
        ("R - R >= 0.1", "cancel each other"),
        ("1 >= 0", "expected columns"),
        ("", "expected a relation"),
        (3, "expected a relation"),
        (None, "expected a relation"),
    ],
)
def test_what_is_too_long_too_deep_or_empty_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        relation(text)


@pytest.mark.parametrize("given_", [3, {"R >= r": 1}, None])
def test_relations_that_are_no_list_are_refused_in_one_line(given_):
    with pytest.raises(InputError, match="relations: expected a list of texts"):
        DesignProblem({"R": (0.2, 0.3)}, SHORT, constraints={"relations": given_})


def test_numbers_may_have_units_and_what_is_linear_stays_so():
    for text, coefficient, constant in [
        ("R >= 30 mm", 1.0, -0.03),
        ("R >= 3cm", 1.0, -0.03),
        ("2 * R >= (2 in)", 2.0, -0.0508),
        ("offset.theta <= 30 deg", -1.0, math.pi / 6),
        ("offset.theta <= 30°", -1.0, math.pi / 6),
        ("R >= sqrt(4)*1e-2*(3 - 1)/4", 1.0, -0.01),
        ("-R <= 20 mm - 2*R/2**2", 1.0 - 0.5, 0.02),
    ]:
        item = relation(text)
        assert isinstance(item.measure, Linear)
        assert list(item.measure.coefficients.values()) == pytest.approx([coefficient], rel=1e-15)
        assert item.measure.constant == pytest.approx(constant, rel=1e-15)
        assert item.at_least
        assert item.bound == 0
    item = relation("1 mm^2 <= R*r")
    assert isinstance(item.measure, Formula)
    assert (item.bound, item.at_least) == (1e-6, True)
    assert relation("R*r <= L**2").measure.better == "small"
    assert relation("platform.mass*gravity.z >= -90 N").bound == -90
    assert set(FUNCTIONS) == set(COMPLEX) - {"pi"}


def problem_of(*constraints, **changes):
    bounds = {"R": (0.2, 0.3), "L": (0.35, 0.5), "slider.mass": (1.0, 3.0)}
    return DesignProblem(bounds, SHORT, constraints=list(constraints), **changes)


def test_columns_that_do_not_vary_are_those_of_the_machine():
    """They were zero in linear relations."""
    machine = p3dof.PAPER
    found = problem_of(
        "platform.mass >= slider_a.mass", "leg.mass >= 0", "platform.com.x + r >= 0", "gravity.z <= 0",
        "limits.force >= 0", "offset.y >= -0.1", "slider.mass*R >= 0", "payload.mass + 1 >= 0",
        "friction.viscous.sliders >= -1", "counterbalance >= -1",
    ).evaluate([[0.25, 0.4, 2.0]]).constraints[0]  # fmt: skip
    bodies = machine.bodies
    expected = [bodies.platform.mass - 2, bodies.leg_a.mass, bodies.platform.com[0] + 0.1]
    expected += [-machine.gravity[2], machine.limits.force, 0.1, 0.5, 1, 1, 1]
    assert found == pytest.approx(expected, rel=1e-15)


def test_a_name_of_several_numbers_that_differ_or_of_bodies_of_solids_is_refused():
    with pytest.raises(InputError, match="differ: expected one of them"):
        DesignProblem({"slider_a.mass": (1, 2)}, SHORT, constraints=["slider.mass <= 3"])
    with pytest.raises(InputError, match=r"platform\.mass: has no number of its own"):
        problem_of("platform.mass <= 9", bodies="solids")
    with pytest.raises(InputError, match="density: has no number of its own"):
        problem_of("density >= 9")
    assert problem_of("density >= 7000", bodies="solids").evaluate([0.25, 0.4, 2.0]).feasible[0]
    with pytest.raises(InputError, match="lead: needs tasks"):
        problem_of("lead >= 0.01")


@pytest.mark.parametrize(
    "text",
    [
        "rod_radius <= 0.02",
        "rod_radius + 0.1*R <= 0.9",
        "rod_radius*L*density <= 90",
        "R**2 + L**2 - 2*R*L*cos(offset.theta) <= 0.04",
        "peak_force*width <= 70 N*(1 m)",
        "peak_force/moving_mass + 3*R >= 2",
        "slider.mass >= 2*R/L",
    ],
)
def test_gradients_of_relations_are_those_of_differences(text):
    """Sizes of solids that follow from the lengths had no gradient in linear relations."""
    problem = problem_of(text, bodies="solids")
    row, names = np.array([0.26, 0.41, 1.7]), problem.variables.names
    slopes = problem.gradient(row)[problem.constraints[0].measure.name]
    for k, _ in enumerate(names):
        step = 1e-6 * np.eye(3)[k]
        ends = problem.evaluate([row + step, row - step]).constraints[:, 0]
        assert slopes[k] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6, abs=1e-8)


def total(designs, names):
    R, L = (designs.columns[f"geometry.{name}"] for name in "RL")
    return R + L, np.ones((len(R), 2)) if names else None


def test_the_least_sum_of_two_lengths_of_a_given_product_is_twice_its_root():
    """By the inequality of the means: R + L ≥ 2 √(R L)."""
    measure = FunctionMeasure("total", "m", total)
    bounds = {"R": (0.15, 0.5), "L": (0.2, 0.8)}
    best = DesignProblem(bounds, SHORT, measure, ["R*L >= 0.1"]).minimise(starts=2)
    assert best.value == pytest.approx(2 * math.sqrt(0.1), rel=1e-8)
    assert best.design == pytest.approx([math.sqrt(0.1)] * 2, rel=1e-4)
    assert best.binding == ("R*L >= 0.1",)
    within = ["(R - 0.3)**2 + (L - 0.45)**2 <= 0.1**2"]
    circle = DesignProblem(bounds, SHORT, measure, within).minimise(starts=2)
    assert circle.design == pytest.approx([0.3 - 0.1 / math.sqrt(2), 0.45 - 0.1 / math.sqrt(2)], rel=1e-5)


def test_a_bound_on_a_measure_and_the_same_as_a_relation_have_one_optimum():
    bounds = {"R": (0.2, 0.4), "L": (0.35, 0.5)}
    bound = DesignProblem(bounds, SHORT, "width", {"peak_force": {"max": 110}}).minimise(starts=2)
    told = DesignProblem(bounds, SHORT, "width", ["peak_force <= 110 N"]).minimise(starts=2)
    assert told.value == pytest.approx(bound.value, rel=1e-7)
    assert told.binding[0] == "peak_force <= 110 N"


def test_evolution_pareto_and_sweeps_keep_relations(tmp_path):
    bounds = {"R": (0.15, 0.5), "L": (0.2, 0.8)}
    wanted = ["peak_force", "width"]
    problem = DesignProblem(bounds, SHORT, wanted, ["R*L >= 0.1", "peak_force*width <= 80"])
    best = problem.minimise("width", method="evolution", generations=60)
    direct = problem.minimise("width", starts=3)
    assert best.value == pytest.approx(direct.value, rel=1e-6)
    front = problem.pareto(points=4)
    kept = problem.evaluate(front.designs)
    assert (front.designs.prod(axis=1) >= 0.1 - 1e-8).all()
    assert kept.feasible.all()
    made = problem.sweep(64, tmp_path / "sweep")
    (archive,) = made.reductions.values()
    columns = archive.columns
    assert (columns["geometry.R"] * columns["geometry.L"] >= 0.1).all()
    assert (columns["peak_force"] * columns["width"] <= 80).all()


def test_a_relation_without_a_value_is_missed_and_says_so():
    problem = DesignProblem(
        {"R": (0.15, 0.3)}, SHORT, constraints=["log(5*R - 1) <= 9", "1/(R - 0.25) <= 1e9"]
    )
    found = problem.evaluate([[0.19], [0.25], [0.21]])
    assert found.feasible.tolist() == [False, False, True]
    assert found.reason(0) == "log(5*R - 1) <= 9: has no value"
    assert found.reason(1) == "1/(R - 0.25) <= 1e9: has no value"
    missed = DesignProblem({"R": (0.15, 0.3)}, SHORT, constraints=["R**2 <= 0.04"]).evaluate([0.3])
    assert missed.reason(0) == "R**2 <= 0.04: violated by 0.05 (it is 0.09)"


def test_measures_in_relations_count_as_built_in_tasks_and_in_settings():
    robust = Robust("peak_force", {"R": 0.001}, points=8)
    item = relation("peak_force <= 200")
    plain = DesignProblem({"R": (0.2, 0.3)}, SHORT, constraints=[item])
    assert pickle.loads(pickle.dumps(item)).measure.node == item.measure.node  # noqa: S301
    problem = paper_problem(constraints=["peak_force <= 200"])
    assert problem.settings()["constraints"][0]["of"][0]["name"] == "peak_force"
    other = DesignProblem({"R": (0.2, 0.3)}, SHORT, constraints=["peak_force <= 201"])
    assert plain.settings() != other.settings()
    population = Population(plain.setting, np.array([[0.25]]))
    assert item.measure.values(population) == pytest.approx([118.5], abs=0.1)
    assert robust.name == "peak_force_with_3_sigma"
