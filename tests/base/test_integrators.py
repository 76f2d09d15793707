"""The integrators in C against SciPy: steps, states, evaluations, crossings, of a system that is no robot."""

import ctypes
import math
import re
import shutil
import subprocess
from fractions import Fraction
from itertools import chain

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp
from scipy.integrate._ivp import dop853_coefficients as published
from scipy.optimize import brentq

from p3dof._base import integrators
from p3dof.runs import integration
from p3dof.runs.integration import RungeKutta4

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")

MASS = 0.012277471  # of the moon, in the restricted problem of three bodies

SOURCE = r"""
#include <float.h>
#include <math.h>

/* Arenstorf's problem: a satellite between earth and moon. */
static void satellite(const double *mass, double t, const double *y, double *rate)
{
    const double m = *mass, n = 1.0 - m, a = y[0] + m, b = y[0] - n;
    const double d1 = pow(a * a + y[1] * y[1], 1.5), d2 = pow(b * b + y[1] * y[1], 1.5);
    (void)t;
    rate[0] = y[2];
    rate[1] = y[3];
    rate[2] = y[0] + 2.0 * y[3] - n * a / d1 - m * b / d2;
    rate[3] = y[1] - 2.0 * y[2] - n * y[1] / d1 - m * y[1] / d2;
    if (!(y[0] < 50.0)) /* there is no world out there */
        rate[0] = NAN;
}

#define DOP853_NAME(f) orbit_##f
#define DOP853_SIZE 4
#define DOP853_CONTEXT const double *
#define DOP853_RATE satellite
#define DOP853_TARGET
@DOP853@

typedef struct {
    const orbit_solver *solver;
    double wall, side;
} watched;

static void state(const watched *w, double t, double *y)
{
    orbit_at(w->solver, t, y);
}

static void margins(const watched *w, double t, const double *y, double *margin, double *rate)
{
    (void)t;
    margin[0] = w->side * (w->wall - y[0]);
    rate[0] = -w->side * y[2];
    margin[1] = INFINITY;
    rate[1] = 0.0;
}

#define CROSSINGS_NAME(f) wall_##f
#define CROSSINGS_SIZE 4
#define CROSSINGS_COUNT 2
#define CROSSINGS_CONTEXT const watched *
#define CROSSINGS_STATE state
#define CROSSINGS_MARGINS margins
#define CROSSINGS_TARGET
@CROSSINGS@

int run(double mass, const double *y0, double end, double first, double rtol, double atol, double longest,
        double wall, double side, int room, double *out, long *counts)
{
    orbit_solver s;
    int status = DOP853_RUNNING, steps = 0;
    counts[1] = -1;
    if (!orbit_start(&s, &mass, 0.0, y0, end, first, rtol, atol, longest))
        return -1;
    while (status == DOP853_RUNNING && steps < room) {
        double when = 0.0, *row = out + 9 * steps;
        const watched w = {&s, wall, side};
        wall_look before, after;
        margins(&w, s.t, s.y, before.margin, before.rate);
        status = orbit_step(&s, &mass);
        if (status == DOP853_FAILED)
            break;
        margins(&w, s.t, s.y, after.margin, after.rate);
        row[0] = s.t;
        for (int i = 0; i < 4; ++i)
            row[1 + i] = s.y[i];
        orbit_interpolate(&s, &mass);
        orbit_at(&s, s.t_old + 0.3 * (s.t - s.t_old), row + 5);
        ++steps;
        if (wall_possible(&before, &after, s.t - s.t_old) && wall_first(&w, s.t_old, s.t, &when) == 0) {
            row[0] = when;
            counts[1] = steps;
            break;
        }
    }
    counts[0] = s.evaluations;
    return status == DOP853_FAILED ? -2 : steps;
}

/* The step that is tried for all of an interval, and what is within; else what `step` does instead. */
int run_at_once(double mass, const double *y0, double end, double first, double rtol, double longest,
                int *trials, double *out, long *counts)
{
    orbit_solver s;
    orbit_start(&s, &mass, 0.0, y0, end, first, rtol, rtol, longest);
    counts[0] = s.evaluations;
    const int whole = orbit_at_once(&s, &mass, trials);
    counts[1] = s.evaluations;
    if (!whole)
        orbit_step(&s, &mass);
    for (int i = 0; i < 4; ++i)
        out[i] = s.y[i];
    counts[2] = s.evaluations;
    orbit_interpolate(&s, &mass);
    counts[3] = s.evaluations;
    orbit_at(&s, s.t_old + 0.3 * (s.t - s.t_old), out + 4);
    orbit_at(&s, s.t, out + 8);
    out[12] = s.t;
    out[13] = s.next;
    return whole;
}

#define RK4_NAME(f) even_##f
#define RK4_SIZE 4
#define RK4_CONTEXT const double *
#define RK4_RATE satellite
#define RK4_TARGET
@RK4@

int run_evenly(double mass, const double *y0, double end, double longest, int every, double *out, long *count)
{
    even_solver s;
    int status = RK4_RUNNING, steps = 0;
    if (!even_start(&s, &mass, 0.0, y0, end, longest))
        return -1;
    while (status == RK4_RUNNING) {
        double *row = out + 9 * steps++;
        status = even_step(&s, &mass);
        row[0] = s.t;
        for (int i = 0; i < 4; ++i)
            row[1 + i] = s.y[i];
        if (steps % every == 0) { /* a step that is not looked into costs no evaluation */
            even_interpolate(&s, &mass);
            even_at(&s, s.t_old + 0.3 * (s.t - s.t_old), row + 5);
        }
    }
    *count = s.evaluations;
    return steps;
}

#ifdef PROGRAM
int main(void)
{
    static double out[9 * 20000];
    const double orbit[4] = {0.994, 0.0, 0.0, -2.00158510637908}, away[4] = {0.994, 0.0, 2000.0, 0.0};
    const double none[4] = {NAN, 0.0, 0.0, 0.0}, m = 0.012277471, far = INFINITY;
    long n[4];
    int trials[2] = {0, 0};
    return !(run_at_once(m, orbit, 1e-6, 1.0, 1e-6, far, trials, out, n) == 1 &&
             run_at_once(m, orbit, 0.1, 1.0, 1e-12, far, trials, out, n) == 0 &&
             run_evenly(m, orbit, 17.1, 1e-3, 7, out, n) == 17100 &&
             run_evenly(m, none, 17.1, 1e-3, 7, out, n) == -1 &&
             run(m, orbit, 17.1, 0.0, 1e-10, 1e-12, far, far, 1.0, 20000, out, n) > 50 &&
             run(m, orbit, 17.1, 0.0, 1e-10, 1e-12, 0.1, 0.5, 1.0, 20000, out, n) > 0 &&
             run(m, away, 17.1, 0.0, 1e-10, 1e-12, 0.1, far, 1.0, 20000, out, n) == -2 &&
             run(m, none, 17.1, 0.0, 1e-10, 1e-12, 0.1, far, 1.0, 20000, out, n) == -1);
}
#endif
"""

AT_ONCE = (
    ("1/5", "1/5"),
    ("3/10", "3/40 9/40"),
    ("3/5", "3/10 -9/10 6/5"),
    ("1", "-11/54 5/2 -70/27 35/27"),
    ("7/8", "1631/55296 175/512 575/13824 44275/110592 253/4096"),
    ("", "37/378 0 250/621 125/594 0 512/1771"),
    ("", "2825/27648 0 18575/48384 13525/55296 277/14336 1/4"),
)
"""Of Cash and Karp, 1990: times and rows of the stages, the end, and the end of order 4."""

ORBIT = np.array([0.994, 0.0, 0.0, -2.00158510637908252240537862224])


def source(dop853=None):
    text = SOURCE.replace("@DOP853@", dop853 or integrators.text("dop853"))
    return text.replace("@CROSSINGS@", integrators.text("crossings")).replace(
        "@RK4@", integrators.text("rk4")
    )


def compiled(folder, text, *flags, program=False):
    file = folder / f"orbit_{abs(hash((text, flags)))}.c"
    file.write_text(text)
    made = file.with_suffix(".out" if program else ".so")
    kind = ["-DPROGRAM"] if program else ["-shared", "-fPIC"]
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wno-unused-function", "-Werror"]
    subprocess.run(["cc", *strict, *flags, *kind, "-o", made, file, "-lm"], check=True)
    return made


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return ctypes.CDLL(str(compiled(tmp_path_factory.mktemp("orbit"), source(), "-O2")))


def orbit(
    library, y0=ORBIT, end=17.0, first=0.0, rtol=1e-10, atol=1e-12, longest=math.inf, wall=math.inf, side=1.0
):
    """Return the number of steps or -1, -2; their rows (t, y, y at 0.3 of the step); evaluations; stop."""
    rows, counts = np.empty((20000, 9)), np.empty(2, dtype=np.int_)
    numbers = [ctypes.c_double(x) for x in (end, first, rtol, atol, longest, wall, side)]
    y0 = np.ascontiguousarray(y0, dtype=float)
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (y0, rows, counts)]
    steps = library.run(ctypes.c_double(MASS), pointers[0], *numbers, 20000, *pointers[1:])
    return steps, rows[: max(steps, 0)], counts[0], counts[1] > 0


def satellite(_, y):
    n, a, b = 1 - MASS, y[0] + MASS, y[0] - 1 + MASS
    d1, d2 = (a * a + y[1] ** 2) ** 1.5, (b * b + y[1] ** 2) ** 1.5
    rate = [y[2], y[3], y[0] + 2 * y[3] - n * a / d1 - MASS * b / d2, y[1] - 2 * y[2] - n * y[1] / d1]
    rate[3] -= MASS * y[1] / d2
    return np.array(rate) if y[0] < 50 else np.full(4, np.nan)


def by_scipy(**how):
    solver = DOP853(satellite, 0.0, how.pop("y0", ORBIT), how.pop("end", 17.0), **how)
    rows = []
    while solver.status == "running":
        solver.step()
        inside = solver.dense_output()(solver.t_old + 0.3 * (solver.t - solver.t_old))
        rows.append([solver.t, *solver.y, *inside])
    return np.array(rows), solver.nfev, solver.status


def check_against_scipy(library):
    far = [0.4, 0.0, 0.0, 1.2]  # from the moon: rounding stays what it is
    for y0, end, rtol, longest, near in (
        (ORBIT, 5.0, 1e-11, math.inf, 1e-4),  # a small error is mostly rounding, and steps follow from it
        (far, 2.0, 1e-11, math.inf, 1e-4),
        (far, 2.0, 1e-4, math.inf, 1e-9),
        (far, 0.5, 1e-6, 5e-3, 1e-13),  # no step depends on its error
    ):
        steps, rows, evaluations, _ = orbit(library, y0, end, rtol=rtol, atol=rtol, longest=longest)
        theirs, nfev, status = by_scipy(y0=y0, end=end, rtol=rtol, atol=rtol, max_step=longest)
        assert (status, steps, evaluations) == ("finished", len(theirs), nfev)
        np.testing.assert_allclose(rows, theirs, rtol=near, atol=near)


def test_the_steps_are_those_of_scipy(library):
    check_against_scipy(library)


def test_a_wrong_coefficient_is_noticed(tmp_path):
    text = integrators.text("dop853")
    for right, wrong in (
        ("0.054293734116568765", "0.054293734126568765"),  # of the solution
        ("1.2251564463762044", "1.2251664463762044"),  # of its error
        ("2.273310147516538", "2.273310148516538"),  # of a stage
    ):
        broken = text.replace(right, wrong)
        assert broken != text
        with pytest.raises(AssertionError):
            check_against_scipy(ctypes.CDLL(str(compiled(tmp_path, source(broken), "-O2"))))


def test_every_published_coefficient_is_there():
    text = integrators.text("dop853")
    extra = published.A[13:]
    for table in (published.A[:12], published.B, published.E3, published.E5, published.D, extra):
        for number in np.abs(np.ravel(table)):
            assert number == 0 or repr(float(number)) in text


def test_a_step_that_is_given_and_one_that_is_refused(library):
    steps, rows, evaluations, _ = orbit(library, end=0.5, first=0.4, rtol=1e-4, atol=1e-4)  # much too long
    theirs, nfev, _ = by_scipy(end=0.5, first_step=0.4, rtol=1e-4, atol=1e-4)
    assert (steps, evaluations) == (len(theirs), nfev)
    np.testing.assert_allclose(rows, theirs, rtol=1e-7, atol=1e-7)


def test_a_system_that_ends_is_given_up(library):
    steps, _, evaluations, _ = orbit(library, y0=[0.994, 0.0, 2000.0, 0.0])
    assert steps == -2
    assert evaluations < 2000
    assert orbit(library, y0=[math.nan, 0, 0, 0])[0] == -1


def test_a_wall_is_found_where_the_dense_output_crosses_it(library):
    def x_of(t):
        found = solve_ivp(satellite, (0, t), ORBIT, method="DOP853", rtol=1e-13, atol=1e-14)
        return found.y[0, -1]

    steps, rows, _, stopped = orbit(library, end=1.0, rtol=1e-13, atol=1e-14, wall=0.9, side=-1.0)
    assert stopped
    when = brentq(lambda t: x_of(t) - 0.9, 0.0, 1.0, xtol=1e-13)
    assert rows[steps - 1, 0] == pytest.approx(when, abs=1e-9)


def test_a_wall_that_is_only_just_touched_between_two_looks_is_found(library):
    """The orbit turns back at its farthest point, for less than a microsecond beyond the wall."""
    run = solve_ivp(satellite, (0, 6.0), ORBIT, method="DOP853", rtol=1e-13, atol=1e-14, dense_output=True)
    t = np.linspace(0, 6.0, 60001)
    x = run.sol(t)[0]
    inner = np.flatnonzero((x[1:-1] < x[:-2]) & (x[1:-1] <= x[2:])) + 1
    turn = brentq(lambda s: run.sol(s)[2], t[inner[0] - 1], t[inner[0] + 1], xtol=1e-13)
    lowest = run.sol(turn)[0]
    how = {"end": 6.0, "rtol": 1e-13, "atol": 1e-14, "side": -1.0}
    steps, rows, _, stopped = orbit(library, wall=lowest + 1e-12, **how)
    assert stopped
    assert rows[steps - 1, 0] == pytest.approx(turn, abs=1e-4)
    assert not orbit(library, wall=lowest - 1e-9, **how)[3]


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize(("end", "longest"), [(0.5, 1e-3), (0.0101, 1e-3), (1.0, 5.0)])
def test_equal_steps_are_those_in_python(library, end, longest, every):
    far = np.array([0.4, 0.0, 0.0, 1.2])
    rows, count = np.full((600, 9), np.nan), ctypes.c_long()
    numbers = [ctypes.c_double(MASS), ctypes.c_void_p(far.ctypes.data), ctypes.c_double(end)]
    numbers += [ctypes.c_double(longest), every, ctypes.c_void_p(rows.ctypes.data), ctypes.byref(count)]
    steps = library.run_evenly(*numbers)
    solver, expected = RungeKutta4(satellite, 0.0, far, end, longest), []
    while solver.status == "running":
        solver.step()
        inside = solver.dense_output()(solver.t_old + 0.3 * (solver.t - solver.t_old))
        looked = (len(expected) + 1) % every == 0
        expected.append([solver.t, *solver.y, *(inside if looked else np.full(4, np.nan))])
    assert steps == len(expected)
    np.testing.assert_allclose(rows[:steps], expected, rtol=1e-13, atol=1e-13)
    assert count.value == 4 * steps + (steps % every == 0)


# A whole interval at once


def rooted_trees(order):
    """Return all rooted trees of an order, each the sorted tuple of what hangs on its root."""
    if order == 1:
        return {()}
    smaller = [rooted_trees(k) for k in range(1, order)]
    return {
        tuple(sorted((*rest, branch)))
        for k, branches in enumerate(smaller, 1)
        for branch in branches
        for rest in rooted_trees(order - k)
    }


def size_and_density(tree):
    below = [size_and_density(branch) for branch in tree]
    size = 1 + sum(n for n, _ in below)
    return size, size * math.prod(density for _, density in below)


def weights(tree, rows):
    """Return the elementary weight of a tree at each stage."""
    of = [weights(branch, rows) for branch in tree]
    inner = [[sum(a * w for a, w in zip(row, weight, strict=False)) for weight in of] for row in rows]
    return [math.prod(sums, start=Fraction(1)) for sums in inner]


def residuals(rows, end, order):
    return [
        sum(b * w for b, w in zip(end, weights(tree, rows), strict=True))
        - Fraction(1, size_and_density(tree)[1])
        for tree in rooted_trees(order)
    ]


def test_the_pair_has_the_orders_five_and_four():
    """Exactly: the conditions of all rooted trees, 17 up to order 5."""
    times, rows = zip(*[(time, [Fraction(a) for a in row.split()]) for time, row in AT_ONCE], strict=True)
    stages, (end, low) = [[], *rows[:5]], rows[5:]
    assert [sum(row) for row in stages[1:]] == [Fraction(time) for time in times[:5]]
    assert [len(rooted_trees(order)) for order in range(1, 6)] == [1, 1, 2, 4, 9]
    for order in range(1, 6):
        assert not any(residuals(stages, end, order))
        assert any(residuals(stages, low, order)) == (order == 5)
    assert any(residuals(stages, end, 6))


def test_both_languages_have_the_coefficients_of_the_pair():
    text = integrators.text("dop853").partition("(at_once)")[2].partition("(step)")[0]
    times, rows = zip(*[(time, [Fraction(a) for a in row.split()]) for time, row in AT_ONCE], strict=True)
    error = [a - b for a, b in zip(rows[5], rows[6], strict=True)]
    in_c = {float(number) for number in re.findall(r"\d+\.\d+", text)}
    for number in [*(Fraction(time) for time in times[:5]), *chain(*rows[:6]), *error]:
        assert min(abs(abs(float(number)) - one) for one in in_c | {0.0}) <= 1e-16
    assert [time for time, _ in integration._STAGES] == [float(Fraction(time)) for time in times[:5]]
    mine = [row for _, row in integration._STAGES] + [integration._END, integration._ERROR]
    for found, expected in zip(mine, [*rows[:6], error], strict=True):
        np.testing.assert_allclose(found, [float(a) for a in expected], rtol=0, atol=1e-16)


FAR = [0.4, 0.0, 0.0, 1.2]


def at_once(library, end, rtol, first=None, longest=math.inf, trials=(0, 0), y0=FAR):
    """Return whether it was taken; end, inside and end again (3, 4), time, next; counts; trials."""
    y0, out, counts = np.array(y0), np.empty(14), np.empty(4, dtype=np.int_)
    left = np.array(trials, dtype=np.int32)
    numbers = [ctypes.c_double(x) for x in (end, end if first is None else first, rtol, longest)]
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (y0, left, out, counts)]
    whole = library.run_at_once(ctypes.c_double(MASS), pointers[0], *numbers, *pointers[1:])
    return bool(whole), out[:12].reshape(3, 4), out[12:], np.diff(counts).tolist(), left.tolist()


def test_a_step_at_once_is_of_order_five(library):
    errors = []
    for end in (0.08, 0.04, 0.02):
        exact = solve_ivp(satellite, (0, end), FAR, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        whole, states, _, counts, _ = at_once(library, end, 1.0)
        assert (whole, counts) == (True, [5, 0, 15])
        errors.append(np.abs(states[0] - exact).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert ((orders > 5.7) & (orders < 6.5)).all()  # the error of one step is of the next order
    assert errors[-1] < 1e-9


@pytest.mark.parametrize("end", [0.002, 0.01, 0.05])
def test_it_is_taken_where_its_error_is_a_small_share(library, end):
    """By the same rule as in Python; else all goes on as if it had not been tried."""
    taken = []
    for rtol in 10.0 ** np.arange(-13, 0):
        solver = DOP853(satellite, 0.0, FAR, end, first_step=end, rtol=rtol, atol=rtol)
        python = integration.AtOnce(solver, satellite)
        whole, states, (time, following), counts, trials = at_once(library, end, rtol)
        taken.append(whole)
        assert whole == python.good
        if whole:
            python.step()
            assert (time, following, counts, trials) == (end, 10 * end, [5, 0, 15], [0, 0])
            assert (python.t, python.h_abs, python.status) == (end, 10 * end, "finished")
            dense = python.dense_output()
            inside = [python.y, dense(0.3 * end), dense(end)]
            np.testing.assert_allclose(states, inside, rtol=0, atol=1e-15)
            np.testing.assert_allclose(states[2], states[0], rtol=0, atol=1e-16)  # its end stays
        else:
            alone = at_once(library, end, rtol, trials=(1, 1))  # not tried
            assert (counts[0], counts[1:], trials) == (5, alone[3][1:], [1, 1])
            np.testing.assert_array_equal(states, alone[1])
    assert taken == sorted(taken)
    assert 2 < sum(taken) < 13


def test_within_a_step_at_once_are_the_states_of_order_eight(library):
    end = 0.05
    exact = solve_ivp(satellite, (0, 0.3 * end), FAR, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    whole, states, *_ = at_once(library, end, 1.0)
    eight = at_once(library, end, 1.0, trials=(1, 0))[1]
    assert whole
    assert np.abs(states[1] - exact).max() < 1.5 * np.abs(states[0] - eight[0]).max()
    np.testing.assert_allclose(states[1], eight[1], rtol=0, atol=np.abs(states[0] - eight[0]).max())


def test_where_it_is_of_no_use_it_waits_longer_each_time(library):
    trials, tried = [0, 0], []
    for _ in range(350):
        _, _, _, counts, trials = at_once(library, 0.05, 1e-14, trials=trials)
        tried.append(counts[0] > 0)
    waited = np.diff(np.flatnonzero(tried)) - 1
    assert waited.tolist() == [1, 3, 7, 15, 31, 63, 63, 63, 63]
    assert at_once(library, 0.05, 1.0, trials=(0, 63))[4] == [0, 0]


@pytest.mark.parametrize("short", [{"first": 0.01}, {"longest": 0.01}])
def test_it_is_not_tried_where_the_next_step_would_be_shorter(library, short):
    whole, _, _, counts, trials = at_once(library, 0.05, 1.0, **short)
    assert (whole, counts[0], trials) == (False, 0, [0, 0])


def test_a_step_at_once_into_nowhere_is_refused(library):
    whole, states, *_ = at_once(library, 0.02, 1.0, y0=[49.9, 0.0, 10.0, 0.0])
    assert not whole
    assert not np.isnan(states[0]).any()


def test_sanitizers_find_nothing(tmp_path):
    flags = "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
    program = compiled(tmp_path, source(), *flags, program=True)
    assert subprocess.run([program], check=False).returncode == 0
