"""Generated C that computes with floats: no double in it, and as right as floats can be."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from compilers import CC, COMPILED, each_c, each_c_and_bake, each_cpp
from generated_c import (
    MACHINES,
    OK,
    SINGULAR,
    STRICT,
    WARNINGS,
    build,
    codegen_command,
    general,
    one_line,
    run,
)
from hypothesis import given, settings
from machines import SEEDS

from p3dof._base.errors import InputError, ParameterError
from p3dof._base.files import write_generated
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.codegen import controller
from p3dof.codegen import selftest as reference
from p3dof.codegen.controller import controller_files, prototypes
from p3dof.codegen.frame import SINGLE
from p3dof.codegen.routines import routines
from p3dof.codegen.selftest import size_of, tolerances
from p3dof.machine.parameters import PAPER, SOLIDS, Body, Friction
from p3dof.viewer.machine.document import engine_row

NARROW = (*WARNINGS, *STRICT, "-Wfloat-conversion")
FOREIGN = """
#ifndef TEST_MATH_H
#define TEST_MATH_H
float atan2f(float, float), cosf(float), fabsf(float), hypotf(float, float);
float sinf(float), sqrtf(float), tanhf(float);
double atan2(double, double), cos(double), fabs(double), hypot(double, double);
double sin(double), sqrt(double), tanh(double);
#endif
"""


def write(folder, machine, bake=False, precision="float"):
    write_generated(controller_files(machine, bake, precision=precision), folder, controller.MARK)
    return folder


@each_c
@pytest.mark.parametrize(("name", "bake"), [("general", False), *((name, True) for name in MACHINES)])
def test_it_compiles_without_warnings_and_passes_its_selftest(tmp_path, name, bake, compiler):
    write(tmp_path, MACHINES[name], bake)
    done = run(build(tmp_path, "-std=c99", "-O1", *NARROW, compiler=compiler))
    assert done.returncode == 0, done.stdout
    errors = [float(x) for x in re.findall(r"(\d\.\de[-+]\d\d)$", done.stdout, re.M)]
    assert len(errors) == len(prototypes())
    assert 1e-8 < max(errors) < 1e-3  # more is wrong, less is not done with floats


@each_cpp
def test_it_is_cpp_too(tmp_path, compiler):
    write(tmp_path, MACHINES["general"])
    assert run(build(tmp_path, "-std=c++11", "-xc++", *WARNINGS, compiler=compiler)).returncode == 0


@pytest.mark.parametrize("bake", [False, True], ids=["run-time", "baked"])
def test_no_double_is_left_in_the_text(bake):
    files = controller_files(MACHINES["general"], bake, precision="float")
    for name in ("p3dof.h", "p3dof.c"):
        code = re.sub(r"/\*.*?\*/", "", files[name], flags=re.DOTALL)
        assert not re.search(r"\b(double|DBL_\w+|HUGE_VAL)\b", code)
        assert not re.search(r"\b(sqrt|sin|cos|tanh|fabs|hypot|atan2)\(", code)
        literals = re.findall(r"(?<![\w.])(?:\d+\.\d*|\d+(?=[eE]))(?:[eE][-+]?\d+)?\w?", code)
        assert all(literal.endswith("F") for literal in literals)
        assert not literals or len(literals) > 20
    assert "DBL_MAX" not in files["p3dof.h"]
    assert "double" in controller_files(PAPER)["p3dof.c"]


@pytest.mark.skipif(shutil.which("clang") is None, reason="clang not installed")
def test_a_processor_with_single_precision_only_calls_no_doubles(tmp_path):
    (tmp_path / "math.h").write_text(FOREIGN)
    target = ("--target=armv7em-none-eabihf", "-mcpu=cortex-m4", "-ffreestanding", "-I", str(tmp_path))
    calls = {}
    for precision in ("float", "double"):
        folder = tmp_path / precision
        folder.mkdir()
        write(folder, MACHINES["general"], precision=precision)
        arguments = ["clang", *target, "-O2", "-S", "p3dof.c", "-o", "-"]
        done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)
        if "unable to create target" in done.stderr or "unknown target" in done.stderr:
            pytest.skip("this clang knows no ARM")
        assert done.returncode == 0, done.stderr
        calls[precision] = re.findall(r"__aeabi_(?:d\w+|f2d|[iul]+2d)\b", done.stdout)
        assert "vmul.f32" in done.stdout or precision == "double"
    assert not calls["float"]
    assert len(calls["double"]) > 1000


@pytest.mark.slow
@each_c_and_bake
def test_calls_with_nonsense(tmp_path, bake, compiler):
    write(tmp_path, MACHINES["general"], bake)
    sanitizers = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    done = run(build(tmp_path, "-std=c99", "-O1", *sanitizers, compiler=compiler), "--fuzz", "50000")
    assert done.returncode == 0, done.stdout + done.stderr
    good, not_finite, far, _ = map(
        int, re.search(r"(\d+) good, (\d+) .*, (\d+) .*, (\d+) sing", done.stdout).groups()
    )
    assert min(good, not_finite, far) > 500


@COMPILED
def test_the_selftest_finds_what_is_wrong(tmp_path):
    write(tmp_path, PAPER, bake=True)
    source = (tmp_path / "p3dof.c").read_text()
    forces = source.split("p3dof_inverse_kinematics")[0]
    statements = re.findall(r"    const float t\d+ = .* \+ .*;", forces)
    for i, statement in enumerate(statements[-5:]):  # what comes before has less to say at some states
        (tmp_path / "p3dof.c").write_text(source.replace(statement, statement.replace(" + ", " + 1e-2F + ")))
        done = run(build(tmp_path, "-std=c99", "-O0", output=f"wrong{i}"))
        assert done.returncode == 1
        assert "FAILED" in done.stdout


class Library:
    """The library that takes any machine at run time, with its arrays of floats."""

    def __init__(self, folder):
        flags = ("-std=c99", "-O2", "-fPIC", "-shared")
        write(folder, PAPER)
        self.c = ctypes.CDLL(str(build(folder, *flags, sources=("p3dof.c",), output="libp3dof.so")))

    def prepare(self, machine):
        given_ = np.array(engine_row(machine), np.float32)
        model = np.zeros(len(MODEL) + len(routines().constants()) + 6 + 1, np.float32)
        assert self.c.p3dof_prepare(_at(given_), _at(model)) == OK
        return model

    def call(self, name, model, *inputs):
        _, _, outputs = next(p for p in prototypes() if p[0] == name)
        found = [np.zeros(int(np.prod(output.shape)), np.float32) for output in outputs]
        arrays = [np.ascontiguousarray(x, np.float32) for x in inputs]
        status = getattr(self.c, f"p3dof_{name}")(*map(_at, (model, *arrays, *found)))
        return status, found


def _at(array):
    return array.ctypes.data_as(ctypes.c_void_p)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    if CC is None:
        pytest.skip("no C compiler here")
    return Library(tmp_path_factory.mktemp("floats"))


@pytest.mark.slow
@given(seed=SEEDS)
@settings(max_examples=25, deadline=None)
def test_random_machines_within_the_tolerance_of_the_selftest(library, seed):
    machine = general(seed)
    expected = reference.reference(machine, seed=seed, rounded=SINGLE.rounded)
    model, states = library.prepare(machine), expected.inputs
    for name, inputs, outputs in prototypes():
        size = size_of(name, machine, SINGLE)
        for i, tolerance in enumerate(tolerances(expected, machine, SINGLE)):
            status, found = library.call(name, model, *(states[a.name][i] for a in inputs))
            assert status == OK
            place = 0
            for output, values in zip(outputs, found, strict=True):
                wanted = expected.outputs[name][i, place : place + values.size]
                place += values.size
                error = np.abs(values - wanted).max() / max(size, np.abs(wanted).max())
                assert error <= tolerance, (name, output.name)


def test_near_singular_poses_there_is_no_result(library):
    """Beyond 1e-4 rad from det J = 0 there is one, and it still has two digits."""
    model, at = library.prepare(PAPER), reference.reference(PAPER).singular
    rest = np.zeros(3)
    for away, expected in ((0, SINGULAR), (5e-5, SINGULAR), (-5e-5, SINGULAR), (5e-4, OK), (-5e-4, OK)):
        pose = at + np.array([0, 0, away / 2])
        status, _ = library.call("inverse_dynamics", model, pose, rest, rest, np.zeros(6))
        assert status == expected, away


def test_machines_that_floats_cannot_describe():
    heavy = Body(1e30, np.array([1e6, 0, 0]), np.zeros((3, 3)))  # 1e42 kg m² about P
    huge = replace(SOLIDS, bodies=replace(SOLIDS.bodies, platform=heavy))
    light = replace(SOLIDS, friction=Friction({"joints": 1e-40}, {}, 1e-3))
    for machine in (huge, light):
        controller_files(machine)
        for bake in (False, True):
            with pytest.raises(ParameterError, match="single precision"):
                controller_files(machine, bake, precision="float")


@pytest.mark.parametrize("precision", ["half", "", None, 4])
def test_other_numbers_are_refused(precision):
    with pytest.raises(InputError, match="precision: expected 'double' or 'float', got"):
        controller_files(PAPER, precision=precision)


def test_the_command(tmp_path, capsys):
    out = tmp_path / "c"
    assert codegen_command(capsys, "--out", out, "--float", "--bake", "--prefix", "arm")[0] == 0
    files = controller_files(PAPER, True, "arm", precision="float")
    for name, body in files.items():
        assert (out / name).read_text() == body
        assert "`p3dof codegen --prefix arm --bake --float`" in body
    assert codegen_command(capsys, "--out", out, "--check", "--float", "--bake", "--prefix", "arm")[0] == 0
    assert codegen_command(capsys, "--out", out, "--check", "--bake", "--prefix", "arm")[0] == 1
    for more in (("--kernels", "--float"), ("--out", out, "--float", "--wasm")):
        code, _, err = codegen_command(capsys, *more)
        one_line(code, err)
        assert "--float" in err
