"""One sample in C: its sines without a library, and how many operations wait for one another."""

from __future__ import annotations

import ctypes
import subprocess

import numpy as np
import pytest
from compilers import CC, COMPILED

from p3dof._base.tracing import Symbol, Tape
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.reduced import Model, State, actuator_forces, shape
from p3dof.codegen.naming import fill
from p3dof.codegen.routines import routines

SINES = """
#include <math.h>
{function}
void sines(const double *x, double *s, double *c)
{{
    int i;
    for (i = 0; i < 100000; ++i) {{
        sine_cosine(x[i], &s[i], &c[i]);
    }}
}}
"""


@COMPILED
@pytest.mark.parametrize("flags", [("-std=c99", "-O2"), ("-O3", "-march=native")], ids=["plain", "fused"])
def test_sine_and_cosine_without_the_library(tmp_path, flags):
    (tmp_path / "sines.c").write_text(SINES.format(function=fill("sine_cosine.in")))
    command = [CC, *flags, "-shared", "-fPIC", "-o", "sines.so", "sines.c", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    function = ctypes.CDLL(str(tmp_path / "sines.so")).sines
    rng, found = np.random.default_rng(1), np.empty((2, 100_000))
    parts = [rng.uniform(-0.8, 0.8, 50_000), rng.normal(0, 1e-6, 20_000), rng.uniform(-9, 9, 30_000)]
    x = np.concatenate(parts)
    x[:6] = 0.0, -0.0, np.pi / 4, -np.pi / 4, np.nextafter(np.pi / 4, 1), 1e22
    function(*(ctypes.c_void_p(array.ctypes.data) for array in (x, found[0], found[1])))
    exact = x.astype(np.longdouble if np.finfo(np.longdouble).eps < 1e-18 else float)
    near = np.abs(x) < 1
    assert np.all(np.abs(found[0] - np.sin(exact))[near] <= 2.5e-16 * np.abs(x[near]))
    assert np.abs(found[1] - np.cos(exact))[near].max() < 2e-16
    np.testing.assert_allclose(found[0][~near], np.sin(x[~near]), rtol=0, atol=2e-16)  # of the library
    np.testing.assert_allclose(found[1][~near], np.cos(x[~near]), rtol=0, atol=2e-16)


def chain(tape, results):
    """How many cycles results take at least, with as many units as one likes."""
    cycles = {"div": 13, "sqrt": 18, "sin": 30, "cos": 30, "neg": 1}
    ends = {}
    for index in tape.needed(results):
        name, operands = tape.operations[index]
        start = max((ends[o.index] for o in operands if isinstance(o, Symbol)), default=0)
        ends[index] = start + (cycles.get(name, 4) if operands else 0)
    return max(ends.values())


def test_one_sample_waits_for_fewer_operations_in_a_row():
    tape = Tape()
    model = Model.of_numbers(tape.symbols(MODEL, constant=True))
    state = State(*tape.symbols(State._fields))
    forces = [
        actuator_forces(model, shape(model, state.y, state.theta, tape, short), state, tape)
        for short in (True, False)
    ]
    short, long = (chain(tape, found) for found in forces)
    assert short <= 0.8 * long
    assert len(tape.needed(forces[0])) <= 1.1 * len(tape.needed(forces[1]))
    of_controller = next(r for r in routines().all if r.name == "inverse_dynamics")
    assert chain(routines().tape, of_controller.results) <= short + 8  # a load more
