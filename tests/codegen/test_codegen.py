"""Generated C against virtual powers: compiled, called, measured by sanitizers, fed with nonsense."""

from __future__ import annotations

import ctypes
import platform
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from compilers import CC, COMPILED, each_c, each_c_and_bake, each_cpp
from generated_c import (
    BAD_PARAMETERS,
    GROUPS,
    MACHINES,
    NOT_FINITE,
    NULL_POINTER,
    OK,
    OUT_OF_REACH,
    SINGULAR,
    STRICT,
    WARNINGS,
    CBody,
    CModel,
    CParameters,
    build,
    codegen_command,
    general,
    library_of_any_machine,
    load_library,
    one_line,
    run,
    write,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import SEEDS, conditioning, random_machine, random_states, virtual_power_forces

import p3dof.cli.codegen  # the command
from p3dof._base.errors import FileError, InputError, P3dofError, ParameterError, ReachError, SingularityError
from p3dof._base.files import check_generated, write_generated
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled.formulas import kernel
from p3dof.closed_form.compiled.reduced import Actuated, Reduced, model_of
from p3dof.codegen import batch, controller
from p3dof.codegen import batch as lanes
from p3dof.codegen import selftest as reference
from p3dof.codegen.controller import controller_files, prototypes
from p3dof.codegen.machine import machine_numbers, parameter_row
from p3dof.codegen.printing import Printer, operation_counts
from p3dof.codegen.routines import routines
from p3dof.machine.parameters import PAPER, SOLIDS, Body, Friction, Parameters, write_parameters

OF_LENGTHS = {"inverse_kinematics", "jacobian", "pose_velocity"}
"""Functions that no body matters to."""


# Compiling, and the self-test that comes with the code.


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return library_of_any_machine(tmp_path_factory.mktemp("library"))


@each_c
@pytest.mark.parametrize(("name", "bake"), [("general", False), *((name, True) for name in MACHINES)])
def test_it_compiles_without_warnings_and_passes_its_selftest(tmp_path, name, bake, compiler):
    write(tmp_path, MACHINES[name], bake)
    done = run(build(tmp_path, "-std=c99", "-O1", *WARNINGS, *STRICT, compiler=compiler))
    assert done.returncode == 0, done.stdout
    assert len(re.findall(r"(?:0.0e\+00|e-1\d)$", done.stdout, re.M)) == len(prototypes())
    assert "all is well" in done.stdout


@each_cpp
@pytest.mark.parametrize("standard", ["c++11", "c++20"])
@pytest.mark.parametrize("bake", [False, True], ids=["run-time", "baked"])
def test_it_is_cpp_too(tmp_path, standard, bake, compiler):
    write(tmp_path, MACHINES["general"], bake)
    program = build(tmp_path, f"-std={standard}", "-xc++", *WARNINGS, compiler=compiler)
    assert run(program).returncode == 0


@COMPILED
@pytest.mark.skipif(shutil.which("make") is None, reason="no make here")
def test_its_makefile_builds_and_checks(tmp_path):
    write(tmp_path, PAPER, bake=True)
    done = run("make", "-C", str(tmp_path), f"CC={CC}", "CFLAGS=-O0", "check")
    assert done.returncode == 0, done.stderr
    assert "all is well" in done.stdout


@COMPILED
@pytest.mark.skipif(
    shutil.which("make") is None or platform.machine() != "x86_64", reason="no make, or no x86"
)
def test_the_makefile_compiles_for_the_processor_that_is_asked_for(tmp_path):
    """Fused products are instructions of haswell, which the first of x86-64 had not."""
    texts = controller_files(PAPER, cpu="haswell")
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    assert "--cpu haswell" in texts["p3dof.c"].splitlines()[0]
    fused = {}
    for cpu in (None, "x86-64", ""):
        given = [] if cpu is None else [f"CPU={cpu}"]
        done = run(
            "make", "-B", "-C", str(tmp_path), f"CC={CC}", "CPPFLAGS=-save-temps=obj", *given, "p3dof.o"
        )
        assert done.returncode == 0, done.stderr
        fused[cpu] = "vfmadd" in (tmp_path / "p3dof.s").read_text()
    assert fused == {None: True, "x86-64": False, "": False}
    done = run("make", "-C", str(tmp_path), f"CC={CC}", "CPU=pdp11")
    assert done.returncode != 0
    assert "knows no processor pdp11" in done.stderr
    with pytest.raises(InputError, match="cpu: expected a processor as compilers call it"):
        controller_files(PAPER, cpu="$(rm)")


@COMPILED
@pytest.mark.skipif(shutil.which("cmake") is None, reason="no CMake here")
def test_its_cmake_project_builds_and_checks(tmp_path):
    write(tmp_path, PAPER, bake=True)
    for command in (
        ("cmake", "-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_C_COMPILER={CC}"),
        ("cmake", "--build", tmp_path / "build"),
        ("cmake", "--build", tmp_path / "build", "--target", "test"),
    ):
        done = run(*command)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "100% tests passed" in done.stdout


@COMPILED
def test_the_selftest_finds_what_is_wrong(tmp_path):
    write(tmp_path, PAPER, bake=True)
    source = (tmp_path / "p3dof.c").read_text()
    statements = re.findall(r"    const double t\d+ = .* \+ .*;", source)
    for i, statement in enumerate(statements[:: len(statements) // 5]):
        (tmp_path / "p3dof.c").write_text(source.replace(statement, statement.replace(" + ", " + 1e-3 + ")))
        done = run(build(tmp_path, "-std=c99", "-O0", output=f"wrong{i}"))
        assert done.returncode == 1
        assert "FAILED" in done.stdout


@pytest.mark.slow
@each_c_and_bake
def test_a_million_calls_with_nonsense(tmp_path, bake, compiler):
    write(tmp_path, MACHINES["general"], bake)
    sanitizers = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    program = build(tmp_path, "-std=c99", "-O1", *sanitizers, compiler=compiler)
    calls = 250_000  # of each of the four
    done = run(program, "--fuzz", str(calls))
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stderr
    counts = [int(n) for n in re.findall(r"(\d+) (?:calls|good|not finite|out of reach)", done.stdout)]
    assert counts[0] == calls
    assert min(counts[1:]) > calls / 20  # it does not stop at the first check


@pytest.mark.fuzz
def test_it_is_right_on_small_processors(tmp_path, small):
    write(tmp_path, MACHINES["general"], bake=False)
    program = build(tmp_path, "-std=c99", *small.split(), compiler="gcc")
    done = run(program)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert "FAILED" not in done.stdout
    assert len(re.findall(r"\d\.\de[-+]\d\d", done.stdout)) >= len(prototypes())
    done = run(program, "--fuzz", "20000")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout


@COMPILED
def test_it_is_timed(tmp_path):
    write(tmp_path, PAPER, bake=False)
    done = run(build(tmp_path, "-std=c99", "-O1"), "--time", "1000")
    assert done.returncode == 0
    for name, _, _ in prototypes():
        assert re.search(rf"^{name} +[\d.]+ +\d+ +\d+$", done.stdout, re.M), done.stdout
    assert re.search(r"^1000 calls each +mean +99\.99 % +worst ns$", done.stdout, re.M), done.stdout
    assert run(tmp_path / "selftest", "--fast").returncode == 2
    # What sleeps for 40 us takes them in each call: no time is cut off where a table would end.
    source = tmp_path / "p3dof.c"
    head = re.search(r"^p3dof_status p3dof_mass_matrix\([^)]*\)\n{\n", source.read_text(), re.M).group()
    sleep = "    nanosleep(&(const struct timespec){0, 40000}, NULL);\n"
    source.write_text("#include <time.h>\n" + source.read_text().replace(head, head + sleep))
    done = run(build(tmp_path, "-std=gnu99", "-O1"), "--time", "1000")
    times = re.search(r"^mass_matrix +([\d.]+) +(\d+) +(\d+)$", done.stdout, re.M).groups()
    mean, usual, worst = map(float, times)
    assert mean >= 40_000
    assert 40_000 <= usual <= worst


@each_c
@pytest.mark.parametrize("bake", [False, True], ids=["run-time", "baked"])
def test_it_has_no_state_and_calls_mathematics_only(tmp_path, bake, compiler):
    write(tmp_path, MACHINES["general"], bake)
    flags = ("-std=c99", "-O2", "-fno-builtin", "-c")
    build(tmp_path, *flags, compiler=compiler, sources=("p3dof.c",), output="p3dof.o")
    symbols = run("nm", str(tmp_path / "p3dof.o")).stdout.splitlines()
    kinds = {line.split()[-2] for line in symbols}
    assert kinds <= {"T", "t", "R", "r", "U"}
    called = {line.split()[-1] for line in symbols if line.split()[-2] == "U"}
    # A compiler may copy structures by memcpy and clear them by memset: no header declares those.
    assert called - {"memcpy", "memset"} <= {"sqrt", "sin", "cos", "tanh", "fabs", "hypot", "atan2"}
    source = (tmp_path / "p3dof.c").read_text()
    assert set(re.findall(r"#include (.*)", source)) == {'"p3dof.h"', "<float.h>", "<math.h>", "<stddef.h>"}
    assert not re.search(r"\bstatic (?!inline void|int|void|p3dof_status)", source)


# The functions against the other methods.


def close(found, expected, allowed, groups=None):
    """Compare rows, each group of entries relative to its largest."""
    place = 0
    for shape in groups or [expected.shape[1:]]:
        block = slice(place, place + int(np.prod(shape)))
        scale = np.abs(expected[:, block]).max(axis=1, keepdims=True)
        assert (np.abs(found[:, block] - expected[:, block]) <= allowed[:, None] * scale).all()
        place = block.stop


def hold_against_python(library, model, machine, states, tolerance=1e-12):
    allowed = tolerance * conditioning(machine.geometry, states.pose)
    acting = states.wrench[:, :3] * 20
    inputs = {
        "pose": states.pose,
        "velocity": states.velocity,
        "acceleration": states.acceleration,
        "wrench": states.wrench,
        "forces": acting,
        "rates": acting / 100,
    }
    sliders = kinematics.inverse_kinematics(machine.geometry, states.pose).sliders
    for name, expected in reference.outputs(machine, inputs | {"sliders": sliders}).items():
        if name == "forward_kinematics":  # has its own test: these poses are of both modes
            continue
        arguments = next(given for known, given, _ in prototypes() if known == name)
        found = library.rows(name, model, *(inputs[argument.name] for argument in arguments))
        twice = 10 if "derivatives" in name else 1
        close(found, expected, twice * allowed, GROUPS[name])


@given(seed=SEEDS, friction=st.booleans())
@settings(max_examples=6, deadline=None)
def test_any_machine_at_run_time(library, seed, friction):
    machine = general(seed) if friction else random_machine(seed)
    model = library.prepare(machine)
    assert bool(model.friction) == friction
    expected = [float(number) for number in model_of(machine).numbers]
    np.testing.assert_allclose(model.numbers, expected, rtol=1e-13, atol=1e-15 * np.abs(expected).max())
    hold_against_python(library, model, machine, random_states(machine, seed, 3, drop=0.2, angle=0.05))


@pytest.mark.parametrize("name", ["paper", "solids"])
def test_the_symmetric_machines_at_run_time(library, name):
    machine = MACHINES[name]
    hold_against_python(library, library.prepare(machine), machine, random_states(machine, 5, 30))


@COMPILED
@pytest.mark.parametrize("machine", MACHINES.values(), ids=MACHINES)
def test_baked_machines(tmp_path, machine):
    library = load_library(write(tmp_path, machine, bake=True))
    hold_against_python(library, None, machine, random_states(machine, 6, 20))


def test_near_singularities(library):
    machine = general(8)
    near = {"drop": 0.05, "angle": 0.005}
    states = random_states(machine, 8, 40, drop=0.01, angle=1e-4, near=near)
    assert len(states.pose) > 20
    model = library.prepare(machine)
    expected = virtual_power_forces(machine, states.pose, states.velocity, states.acceleration, states.wrench)
    found = library.rows(
        "inverse_dynamics", model, states.pose, states.velocity, states.acceleration, states.wrench
    )
    close(found, expected, 1e-12 * conditioning(machine.geometry, states.pose))


@given(seed=SEEDS)
@settings(max_examples=12, deadline=None)
def test_forward_kinematics(library, seed):
    machine = random_machine(seed)
    model, rng, L = library.prepare(machine), np.random.default_rng(seed), machine.geometry.L
    for sliders in rng.uniform(-L, L, (20, 3)):
        expected = kinematics.forward_kinematics(machine.geometry, sliders, on_invalid="nan")
        status, (pose,) = library.status("forward_kinematics", model, sliders)
        assert status == (OK if np.isfinite(expected).all() else OUT_OF_REACH)
        if status == OK:
            np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-12 * max(L, 1))


def test_the_equations_of_motion_balance(library):
    """M a + h = Jᵀ f + Eᵀ w, and forward dynamics gives back what inverse dynamics was asked for."""
    machine = general(9)
    model, states = library.prepare(machine), random_states(machine, 9, 20, drop=0.3, angle=0.2)
    for q, v, a, w in zip(states.pose, states.velocity, states.acceleration, states.wrench, strict=True):
        f = library.call("inverse_dynamics", model, q, v, a, w)
        M, J = library.call("mass_matrix", model, q), library.call("jacobian", model, q)
        left, right = M @ a + library.call("bias", model, q, v), J.T @ f + w[[1, 2, 4]]
        np.testing.assert_allclose(left, right, rtol=0, atol=1e-12 * np.abs(left).max())
        back = library.call("forward_dynamics", model, q, v, f, w)
        np.testing.assert_allclose(back, a, rtol=0, atol=1e-11 * np.abs(a).max())


def test_base_parameters_are_all_that_matters(library):
    """The forces are the derivatives by the base parameters times these, without friction and wrench."""
    machine = replace(general(10), friction=Friction())
    model, states = library.prepare(machine), random_states(machine, 10, 20, drop=0.3, angle=0.2)
    for motion in zip(states.pose, states.velocity, states.acceleration, strict=True):
        forces, by = library.call("parameter_derivatives", model, *motion, None)
        found = by[:, 6:] @ np.array(model.numbers)[6:]
        np.testing.assert_allclose(found, forces, rtol=0, atol=1e-12 * np.abs(by[:, 6:]).max())
    assert len(Reduced._fields) + len(Actuated._fields) == by.shape[1] - 6


def test_derivatives_by_finite_differences(library):
    """By lengths with friction too: the model's numbers are changed one by one in its parameters."""
    machine = general(11)
    states = random_states(machine, 11, 3, drop=0.4, angle=0.4)
    model = library.prepare(machine)
    for q, v, a, w in zip(states.pose, states.velocity, states.acceleration, states.wrench, strict=True):
        forces, *by = library.call("inverse_dynamics_derivatives", model, q, v, a, w)
        alone = library.call("inverse_dynamics", model, q, v, a, w)  # by shorter chains, in another order
        np.testing.assert_allclose(forces, alone, rtol=0, atol=1e-14 * np.abs(alone).max())
        for k, axis in np.ndindex(3, 3):
            motion = [q, v, a]

            def at(step, k=k, axis=axis, motion=motion, w=w):
                moved = [x.copy() for x in motion]
                moved[k][axis] += step
                return library.call("inverse_dynamics", model, *moved, w)

            step = 1e-4 * (machine.friction.smoothing if k == 1 else 1) * machine.geometry.L
            slope = (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step)
            np.testing.assert_allclose(slope, by[k][:, axis], rtol=0, atol=1e-6 * np.abs(by[k]).max())


# What is refused.


EXPECTED = {ReachError: OUT_OF_REACH, SingularityError: SINGULAR}


def python_status(function, *arguments):
    try:
        function(*arguments)
    except tuple(EXPECTED) as error:
        return EXPECTED[type(error)]
    except P3dofError:
        return NOT_FINITE
    return OK


@pytest.mark.filterwarnings("ignore:beyond what the machine can do")  # more than half a turn
@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_the_limits_are_those_of_python(library, seed):
    machine, rng = random_machine(seed), np.random.default_rng(seed)
    model, g, full = library.prepare(machine), machine.geometry, p3dof.load(machine)
    width, rest = g.R - g.r, np.zeros(3)
    theta = np.arccos(g.R / (g.L + g.r))  # there the arm points along the rods, at y = 0
    poses = [[0, 0, theta + s * d] for s in (-1, 1) for d in (0, 5e-7, 2e-6)]
    poses += [[s * (g.L - width - d * g.L), 0, 0] for s in (-1, 1) for d in (0, 3e-15, 3e-14, -1e-9, 1e-3)]
    poses += list(rng.uniform(-1.5, 1.5, (20, 3)) * [g.L, g.L, np.pi])
    poses += [[1e200, 0, 0], [-1e308, 0, 1], [0, 1e308, 0], [0, 0, 1e15], [np.nan, 0, 0], [0, np.inf, 0]]
    for pose in poses:
        expected = python_status(virtual_power_forces, machine, pose, rest, rest)
        assert library.status("inverse_dynamics", model, pose, rest, rest, None)[0] == expected, pose
        expected = python_status(lambda x: full.mass_matrix(x, method="virtual-power"), pose)
        assert library.status("mass_matrix", model, pose)[0] == expected, pose


def test_what_overflows_is_told(library):
    model = library.prepare(PAPER)
    q, fast = np.zeros(3), np.full(3, 1e200)
    assert library.status("inverse_dynamics", model, q, fast, q, None)[0] == NOT_FINITE
    assert library.status("bias", model, q, fast)[0] == NOT_FINITE
    assert library.status("inverse_dynamics", model, q, q, q, [0, 0, 0, np.nan, 0, 0])[0] == NOT_FINITE


def spoilt():
    """Parameters that are not those of a machine, each by what is wrong."""
    good = CParameters.of(general(4))
    for name, value in (("r", good.R), ("r", 0), ("L", good.R - good.r), ("b", 0), ("smoothing", 0)):
        yield name, value
    for name in ("r", "R", "L", "b", "smoothing"):
        yield from ((name, np.nan), (name, np.inf), (name, -1.0))
    yield "smoothing", 1e-320  # one over it overflows


@pytest.mark.parametrize(("name", "value"), list(spoilt()))
def test_bad_parameters_are_refused(library, name, value):
    parameters, model = CParameters.of(general(4)), CModel()
    setattr(parameters, name, value)
    assert library.c.p3dof_prepare(ctypes.byref(parameters), ctypes.byref(model)) == BAD_PARAMETERS
    assert not any(model.constants)


def test_bad_bodies_friction_and_gravity_are_refused(library):
    changes = [lambda p: p.gravity.__setitem__(1, np.nan)]
    changes += [lambda p: p.viscous.__setitem__(2, -1), lambda p: p.coulomb.__setitem__(12, np.inf)]
    changes += [lambda p: setattr(p.bodies[8], "mass", 0), lambda p: setattr(p.bodies[1], "mass", -1)]
    changes += [lambda p: setattr(p.bodies[5], "mass", 0)]  # with an inertia
    changes += [
        lambda p: p.bodies[0].com.__setitem__(0, np.nan),
        lambda p: p.bodies[0].inertia.__setitem__(0, -1),
    ]
    changes += [lambda p: setattr(p.bodies[8], "mass", 1e308)]
    changes += [lambda p: p.armature.__setitem__(0, -1), lambda p: p.counterweight.__setitem__(2, -1)]
    changes += [lambda p: p.spring.__setitem__(0, np.nan), lambda p: p.counterbalance.__setitem__(1, np.inf)]
    for change in changes:
        parameters, model = CParameters.of(general(4)), CModel()
        change(parameters)
        assert library.c.p3dof_prepare(ctypes.byref(parameters), ctypes.byref(model)) == BAD_PARAMETERS


def test_null_is_told(library):
    model, parameters = library.prepare(PAPER), CParameters.of(PAPER)
    assert library.c.p3dof_prepare(None, ctypes.byref(model)) == NULL_POINTER
    assert library.c.p3dof_prepare(ctypes.byref(parameters), None) == NULL_POINTER
    assert library.c.p3dof_carry(ctypes.byref(parameters), None, ctypes.byref(parameters)) == NULL_POINTER
    for name, inputs, outputs in prototypes():
        place = [True, *(a.name != "wrench" for a in inputs), *(True for _ in outputs)]
        row = np.zeros((3, 128))
        for i in np.flatnonzero(place):
            arguments = [ctypes.byref(model), *[row.ctypes.data_as(ctypes.c_void_p)] * (len(place) - 1)]
            arguments[i] = None
            assert getattr(library.c, f"p3dof_{name}")(*arguments) == NULL_POINTER


# Payloads, and several machines at once.


@given(seed=SEEDS)
@settings(max_examples=12, deadline=None)
def test_a_payload_at_run_time(library, seed):
    machine, payload = general(seed), random_machine(seed + 1).bodies.platform
    parameters = CParameters.of(machine)
    given_ = ctypes.byref(parameters)
    assert library.c.p3dof_carry(given_, ctypes.byref(CBody.of(payload)), given_) == OK
    expected = CBody.of(machine.carrying(payload).bodies.platform)
    for name in ("com", "inertia"):
        found, wanted = (np.array(getattr(body, name)) for body in (parameters.bodies[8], expected))
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * np.abs(wanted).max())
    assert parameters.bodies[8].mass == expected.mass


@given(seed=SEEDS)
@settings(max_examples=80, deadline=None)
def test_inertias_that_no_body_has_are_refused(library, seed):
    rng = np.random.default_rng(seed)
    moments, turned = rng.uniform(-0.1, 1, 3), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    inertia = turned @ np.diag(moments) @ turned.T * 10 ** rng.uniform(-3, 3)
    body = CBody.of(replace(PAPER.bodies.platform))
    I = inertia  # noqa: E741 - the inertia
    body.inertia = (ctypes.c_double * 6)(I[0, 0], I[0, 1], I[0, 2], I[1, 1], I[1, 2], I[2, 2])
    try:
        Body(body.mass, np.zeros(3), (inertia + inertia.T) / 2)
        expected = OK
    except ParameterError:
        expected = BAD_PARAMETERS
    parameters = CParameters.of(PAPER)
    given_ = ctypes.byref(parameters)
    assert library.c.p3dof_carry(given_, ctypes.byref(body), given_) == expected


def test_two_models_in_several_threads(library):
    machines = [general(4), general(5)]
    models = [library.prepare(machine) for machine in machines]
    states = [random_states(machine, 1, 200) for machine in machines]

    def forces(i):
        return library.rows(
            "inverse_dynamics", models[i], states[i].pose, states[i].velocity, states[i].acceleration, None
        )

    alone = [forces(0), forces(1)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(forces, [0, 1] * 4))
    for i, found in enumerate(together):
        np.testing.assert_array_equal(found, alone[i % 2])


def test_outputs_may_be_inputs(library):
    model, states = library.prepare(PAPER), random_states(PAPER, 2, 1)
    q, v, a = states.pose[0], states.velocity[0], states.acceleration[0]
    expected = library.call("inverse_dynamics", model, q, v, a, None)
    at = [np.ascontiguousarray(x).ctypes.data_as(ctypes.c_void_p) for x in (q, v, a)]
    assert library.c.p3dof_inverse_dynamics(ctypes.byref(model), *at, None, at[2]) == OK
    np.testing.assert_array_equal(a, expected)


# The generator.


def test_the_reference_is_a_matter_of_the_other_methods():
    """They balance: base parameters times their columns are the forces, Jᵀ times the forces is the bias."""
    machine = general(12)
    found = reference.reference(machine)
    q, v, a, w = (found.inputs[name] for name in ("pose", "velocity", "acceleration", "wrench"))
    by = reference.number_derivatives(machine, q, v, a, w)
    without = replace(machine, friction=p3dof.machine.parameters.Friction())
    base = np.array([float(x) for x in model_of(machine).numbers[6:]])
    forces = virtual_power_forces(without, q, v, a)
    np.testing.assert_allclose(by[..., 6:] @ base, forces, rtol=0, atol=1e-12 * np.abs(forces).max())
    bias = reference.bias(machine, q, v)
    at_rest = p3dof.load(machine).gravity_forces(q)
    np.testing.assert_allclose(
        reference.bias(machine, q, 0 * v), at_rest, rtol=0, atol=1e-13 * np.abs(at_rest).max()
    )
    J = kinematics.inverse_jacobian(machine.geometry, q)
    held = virtual_power_forces(machine, q, v, 0 * a)
    np.testing.assert_allclose(
        np.einsum("nij,ni->nj", J, held), bias, rtol=0, atol=1e-11 * np.abs(bias).max()
    )


def test_generated_kernels_are_up_to_date():
    assert check_generated(batch.batch_files() | lanes.lane_files(), batch.DIRECTORY) == []


def test_the_counts_are_those_of_the_code():
    machine = general(4)
    numbers = machine_numbers(parameter_row(machine))
    counts = {count.name: count for count in operation_counts(machine)}
    for routine in routines().all:
        for given_, with_friction in ((numbers, False), (None, True)):
            code = Printer(routine, given_).code()
            done = [
                line
                for line in code
                if re.search(r" = .*( [-+*/] |(?<!e)-\w|\w\()", line) and "found[" not in line
            ]
            done += 2 * [line for line in code if line.startswith("sine_cosine(")]
            added = [line for line in code if re.search(r"-= |\] = .* \+ added", line)]
            count = counts[routine.name]
            expected = count.general + count.friction if with_friction else count.machine
            assert len(done) + len(added) == expected, routine.name
        assert count.symmetric < count.general or routine.name in OF_LENGTHS
    own = sum(kernel("inverse_dynamics_loaded").operations(margin=True).values())
    assert counts["inverse_dynamics"].general <= own  # without the least of several, and the test for NaN


def test_zeros_vanish_from_baked_code():
    size = {name: len(controller_files(MACHINES[name], bake=True)["p3dof.c"]) for name in MACHINES}
    assert size["paper"] < 0.6 * size["general"]
    assert "tanh" not in controller_files(PAPER, bake=True)["p3dof.c"]
    for coulomb, calls in (({}, 0), ({"slide_b": 5.0}, 1), ({"sliders": 5.0, "joints": 0.2}, 9)):
        rough = replace(PAPER, friction=Friction({"sliders": 20.0, "joints": 0.3}, coulomb))
        inverse = next(one for one in routines().all if one.name == "inverse_dynamics")
        lines = Printer(inverse, machine_numbers(parameter_row(rough))).code()
        assert sum("tanh(" in line for line in lines) == calls


def test_generated_twice_is_the_same():
    assert controller_files(SOLIDS) == controller_files(SOLIDS)
    for text in controller_files(SOLIDS).values():
        assert text.startswith(("/* " + controller.MARK, "# " + controller.MARK))
        assert "@{" not in text
        assert not re.search(r"\b(inf|nan)\b", text.replace('" (not finite)"', ""))


def test_machines_that_cannot_be_written():
    heavy = {name: Body(1e30, body.com, 1e30 * body.inertia) for name, body in SOLIDS.bodies.items()}
    huge = replace(
        SOLIDS, bodies=replace(SOLIDS.bodies, **{name: heavy[name] for name in ("leg_a", "platform")})
    )
    controller_files(huge, bake=True)  # large, but not too large
    steep = p3dof.machine.parameters.Friction({}, {"joints": 1.0}, 1e-30)
    controller_files(replace(SOLIDS, friction=steep), bake=True)  # the least that there is
    short = replace(SOLIDS.geometry, L=0.15 * (1 + 1e-9))
    with pytest.raises(ParameterError, match="hardly reaches"):
        controller_files(Parameters(short, SOLIDS.bodies))


# The command.


def test_the_command_writes_and_checks(tmp_path, capsys):
    out = tmp_path / "ö x"
    code, text, err = codegen_command(capsys, "--out", out)
    assert code == 0, err
    assert {path.name for path in out.iterdir()} == set(controller_files(PAPER))
    for name, body in controller_files(PAPER).items():
        assert (out / name).read_text() == body
        assert f"wrote {out / name}" in text
    for count in operation_counts(PAPER):
        numbers = (str(count.general), str(count.symmetric), f"\\+{count.friction}", str(count.machine))
        assert re.search(rf"{count.name} .*{' .*'.join(numbers)} ", text)
    code, text, _ = codegen_command(capsys, "--out", out, "--check")
    assert (code, text.strip()) == (0, f"{out}: up to date")
    assert codegen_command(capsys, "--out", out, "--check", "--bake")[0] == 1
    assert codegen_command(capsys, "--out", out, "--bake")[0] == 0  # over its own files
    assert codegen_command(capsys, "--out", out, "--check", "--bake")[0] == 0
    file = out / "p3dof.c"
    changed = file.read_text().replace("0.4", "0.4000001", 1)
    file.write_text(changed)
    code, text, _ = codegen_command(capsys, "--out", out, "--check", "--bake")
    assert code == 1
    assert str(file) in text
    assert file.read_text() == changed
    file.unlink()
    code, text, _ = codegen_command(capsys, "--out", out, "--check", "--bake")
    assert (code, text.strip()) == (1, f"{file}: missing")


def test_the_command_takes_a_machine_and_a_payload(tmp_path, capsys):
    machine = general(4)
    write_parameters(machine, tmp_path / "machine.yaml")
    options = ("--parameters", tmp_path / "machine.yaml", "--payload", "2.5,0.1,0,-0.05")
    assert codegen_command(capsys, *options, "--out", tmp_path / "c")[0] == 0
    carried = machine.carrying(Body(2.5, np.array([0.1, 0, -0.05]), np.zeros((3, 3))))
    told = "p3dof codegen --parameters machine.yaml --payload 2.5,0.1,0,-0.05"
    assert check_generated(controller_files(carried, command=told), tmp_path / "c", 1e-9) == []
    assert all(told in path.read_text()[:200] for path in (tmp_path / "c").iterdir())
    assert check_generated(controller_files(machine), tmp_path / "c", 1e-9)


def test_the_command_checks_the_kernels(tmp_path, capsys, monkeypatch):
    code, text, err = codegen_command(capsys, "--kernels", "--check")
    assert (code, text.strip()) == (0, f"{batch.DIRECTORY}: up to date"), err
    monkeypatch.setattr(p3dof.cli.codegen, "DIRECTORY", tmp_path)
    code, text, _ = codegen_command(capsys, "--kernels")
    assert code == 0
    for name in ("batch_kernels.h", "kernel_table.h"):
        assert (tmp_path / name).read_bytes() == (batch.DIRECTORY / name).read_bytes()
    numbers = [sum(kernel("inverse_dynamics", s).operations().values()) for s in (False, True)]
    assert re.search(rf"inverse_dynamics .*{numbers[0]} .*{numbers[1]} ", text)
    table, kernels = tmp_path / "kernel_table.h", tmp_path / "batch_kernels.h"
    table.write_text(table.read_text() + "\n#define MORE\n")
    kernels.write_text(kernels.read_text().replace("0.5", "0.5000001", 1))  # numbers are exact here
    code, text, _ = codegen_command(capsys, "--kernels", "--check")
    assert code == 1
    assert f"{table}, line " in text
    assert f"{kernels}, line " in text


def test_bad_requests_are_one_line(tmp_path, capsys):
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "p3dof.h").write_text("/* mine */\n")
    (tmp_path / "file").write_text("")
    for arguments in (
        (),
        ("--check",),
        ("--kernels", "--bake"),
        ("--kernels", "--payload", "1"),
        ("--kernels", "--prefix", "arm"),
        ("--out", tmp_path / "x", "--prefix", "Arm"),
        ("--out", tmp_path / "x", "--prefix", "math"),
        ("--out", tmp_path / "file"),
        ("--out", tmp_path / "file" / "below"),
        ("--out", foreign),
        ("--out", tmp_path / "x", "--parameters", tmp_path / "missing.yaml"),
        ("--out", tmp_path / "x", "--payload", "-1"),
    ):
        code, _, err = codegen_command(capsys, *arguments)
        one_line(code, err)
    assert [path.name for path in foreign.iterdir()] == ["p3dof.h"]
    assert (foreign / "p3dof.h").read_text() == "/* mine */\n"
    assert not (tmp_path / "x").exists()
    with pytest.raises(FileError, match="not generated"):
        write_generated(controller_files(PAPER), foreign, controller.MARK)


def test_the_six_entries_of_an_inertia_stand_by_rows():
    from p3dof.codegen import selftest

    assert [*selftest._ENTRIES] == [*zip(*(rows.tolist() for rows in np.triu_indices(3)), strict=True)]
