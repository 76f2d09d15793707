"""Single samples from C, as contenders: the batch kernel on one sample, the controller's code, plain CasADi.

Skipped without gcc; CasADi's without CasADi.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from batch import FORCES
from inputs import MACHINES, rows
from rounds import Contender

import p3dof
from p3dof._native import __file__ as kernels_file
from p3dof.closed_form.compiled import MachineKernels, reduced
from p3dof.closed_form.compiled.reduced import State
from p3dof.closed_form.paper import virtual_power
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.codegen.controller import controller_files
from p3dof.machine.parameters import Parameters
from p3dof.machine.parameters.body import inertials, numbers

HERE = Path(__file__).parent
KERNELS = Path(kernels_file).parent
NATIVE, CASADI = "from C, one call a sample", "plain CasADi C, one call a sample"
INDEPENDENT, DEPENDENT = "independent calls", "each waits for the last"
ROWS = 1024  # as in driver.c

VECTOR_FLAGS = ("-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-fopenmp-simd")
"""The flags of setup.py that change what kernels compute."""

_KERNEL = """\
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#define P3DOF_INLINE inline __attribute__((always_inline))
#define P3DOF_SIMD _Pragma("omp simd")
#define P3DOF_ALIGNED __attribute__((aligned(64)))
#define P3DOF_TARGET __attribute__((unused))
enum {{ BLOCK = 80, LINE = 88 }};
#define P3DOF_NAME(f) f##_one
#include "{headers}/vector_math.h"
#define P3DOF_ROW 8
#include "{headers}/rows.h"
#include "{headers}/generated/batch_kernels.h"
static const double constants[] = {{{constants}}};
static const double *numbers = constants;
static void one(const double *x, double *f)
{{
    double margin;
    const double *in[9];
    double *out[4] = {{f, f + 1, f + 2, &margin}};
    for (int k = 0; k < 9; ++k)
        in[k] = x + k;
    {kernel}_one(1, numbers, in, out);
}}
"""
_CONTROLLER = """\
#include <stddef.h>
#include "p3dof.h"
#ifndef REAL
#define REAL double
#endif
static p3dof_model model;
static void one(const REAL *x, REAL *f)
{
    if (p3dof_inverse_dynamics(&model, x, x + 3, x + 6, NULL, f) != P3DOF_OK)
        f[0] = f[1] = f[2] = (REAL)(0.0 / 0.0);
}
int ready(void) { return p3dof_prepare(&p3dof_machine, &model) == P3DOF_OK; }
"""
_BAKED = """\
#include <stddef.h>
#include "p3dof.h"
#ifndef REAL
#define REAL double
#endif
static void one(const REAL *x, REAL *f)
{
    if (p3dof_inverse_dynamics(x, x + 3, x + 6, NULL, f) != P3DOF_OK)
        f[0] = f[1] = f[2] = (REAL)(0.0 / 0.0);
}
int ready(void) { return 1; }
"""
_CASADI = """\
#include "casadi.c"
static void one(const double *x, double *f)
{
    const double *in[1] = {x};
    double *out[1] = {f}, w[casadi_w + 1];
    casadi_int iw[casadi_iw + 1];
    forces(in, out, iw, w, 0);
}
"""


def from_c(folder: Path) -> Iterator[Contender]:
    """All that can be compiled here; libraries go into the folder."""
    if shutil.which("gcc") is None:
        return
    for machine, parameters in MACHINES.items():
        yield from _both(
            NATIVE, "batch kernel, n = 1", machine, _kernel(parameters, folder / f"kernel-{machine}")
        )
        for name, bake in (("controller", False), ("controller, baked", True)):
            built = _controller(parameters, bake, folder / f"{name}-{machine}")
            yield from _both(NATIVE, name, machine, built)
            built = _controller(parameters, bake, folder / f"{name}, floats-{machine}", "float")
            yield from _both(NATIVE, f"{name}, floats", machine, built, np.float32)
        if find_spec("casadi") is not None:
            for name, formula in {"virtual power": _virtual_power, "reduced form": _reduced}.items():
                built = _casadi(formula, parameters, folder / f"casadi {name}-{machine}")
                yield next(_both(CASADI, name, machine, built))


def _both(
    group: str, name: str, machine: str, library: ctypes.CDLL, real: type = np.float64
) -> Iterator[Contender]:
    """Independent and dependent calls of a library, once its forces are right."""
    states = np.ascontiguousarray(np.hstack(rows(ROWS)), real)
    forces = np.empty((ROWS, 3), real)

    def calls(function: Any) -> Callable[[int], float]:
        def run(count: int) -> float:
            start = time.perf_counter()
            function(ctypes.c_long(count), _pointer(states), _pointer(forces))
            return time.perf_counter() - start

        return run

    calls(library.independent)(ROWS)
    expected = p3dof.load(MACHINES[machine]).forces(*rows(ROWS), method="virtual-power")
    tolerance = 1e-11 if real is np.float64 else 1e-4
    np.testing.assert_allclose(forces, expected, rtol=0, atol=tolerance * np.abs(expected).max())
    yield Contender(group, f"{name}: {INDEPENDENT}", machine, calls(library.independent))
    yield Contender(group, f"{name}: {DEPENDENT}", machine, calls(library.dependent))


def _pointer(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.c_void_p)


def _build(folder: Path, files: dict[str, str], flags: tuple[str, ...] = ()) -> ctypes.CDLL:
    """Compile files with the driver, which is included at the end of main.c, and load them."""
    folder.mkdir(parents=True)
    files["main.c"] += (HERE / "driver.c").read_text()
    for name, text in files.items():
        (folder / name).write_text(text)
    sources = [name for name in files if name in {"main.c", "p3dof.c"}]
    command = ["gcc", "-O3", "-march=native", *flags, "-shared", "-fPIC", "-o", "library.so", *sources, "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "library.so"))
    for function in (library.independent, library.dependent):
        function.restype = None
    return library


def _kernel(parameters: Parameters, folder: Path) -> ctypes.CDLL:
    used, constants = MachineKernels(parameters).prepared(FORCES)
    text = _KERNEL.format(
        headers=KERNELS, constants=", ".join(map(repr, constants.tolist())), kernel=used.name
    )
    return _build(folder, {"main.c": text}, VECTOR_FLAGS)


def _controller(parameters: Parameters, bake: bool, folder: Path, precision: str = "double") -> ctypes.CDLL:
    files = controller_files(parameters, bake, precision=precision)
    library = _build(
        folder,
        {name: files[name] for name in ("p3dof.h", "p3dof.c")} | {"main.c": _BAKED if bake else _CONTROLLER},
        (f"-DREAL={precision}",),
    )
    if not library.ready():
        raise RuntimeError("the controller's code refuses the machine")
    return library


def _casadi(formula: Callable[[Any, Parameters], Any], parameters: Parameters, folder: Path) -> ctypes.CDLL:
    """Compile a formula as CasADi writes it, the machine's numbers put in."""
    import casadi

    x = casadi.SX.sym("x", 9)
    function = casadi.Function("forces", [x], [casadi.vertcat(*formula(casadi.vertsplit(x), parameters))])
    generator = casadi.CodeGenerator("casadi", {"with_header": False})
    generator.add(function)
    sizes = f"enum {{ casadi_iw = {function.sz_iw()}, casadi_w = {function.sz_w()} }};\n"
    return _build(folder, {"casadi.c": generator.dump(), "main.c": sizes + _CASADI})


def _virtual_power(x: list[Any], parameters: Parameters) -> Any:
    import casadi

    pose, velocity, acceleration = (tuple(x[i : i + 3]) for i in (0, 3, 6))
    return virtual_power.actuator_forces(
        Lengths.of(parameters.geometry),
        inertials(parameters.bodies),
        numbers(parameters.gravity),
        pose,
        velocity,
        acceleration,
        casadi,
    )


def _reduced(x: list[Any], parameters: Parameters) -> Any:
    import casadi

    y, z, theta, vy, _, vtheta, ay, az, atheta = x
    model = reduced.model_of(parameters)
    shape = reduced.shape(model, y, theta, casadi)
    return reduced.actuator_forces(model, shape, State(y, theta, vy, vtheta, ay, az, atheta, z), casadi)
