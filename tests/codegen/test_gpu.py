"""The forces printed for a GPU, without one: by JAX on the processor, CUDA C++ compiled as C++."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from compilers import CC, CPP, each_cpp
from gallery import GALLERY
from generated_c import general
from machines import conditioning, off, random_machine, random_states, virtual_power_forces

import p3dof
from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.tracing import Symbol
from p3dof._base.tracing.tape import Operation
from p3dof.cli import main
from p3dof.codegen import gpu
from p3dof.codegen.loops import loop_files
from p3dof.codegen.machine import GIVEN, parameter_row
from p3dof.machine.motion import paper_motion
from p3dof.machine.parameters import PAPER

SHIM = """
#pragma once
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#define __host__
#define __device__
#define __global__
#define __forceinline__ inline
struct place { unsigned int x; };
static place gridDim, blockDim, blockIdx, threadIdx;
#define P3DOF_CUDA_LAUNCH(kernel, blocks, ...) \\
    for (gridDim.x = 1 + (blocks) / 2, blockDim.x = P3DOF_CUDA_BLOCK, blockIdx.x = 0; \\
         blockIdx.x < gridDim.x; ++blockIdx.x) \\
        for (threadIdx.x = 0; threadIdx.x < blockDim.x; ++threadIdx.x) kernel(__VA_ARGS__)
enum cudaError_t { cudaSuccess, cudaErrorInvalidValue };
enum kind { cudaMemcpyHostToDevice, cudaMemcpyDeviceToHost };
static cudaError_t cudaMalloc(void **p, size_t n)
{
    *p = malloc(n);
    return *p ? cudaSuccess : cudaErrorInvalidValue;
}
static cudaError_t cudaMemcpy(void *to, const void *from, size_t n, kind)
{
    memcpy(to, from, n);
    return cudaSuccess;
}
static cudaError_t cudaGetLastError(void) { return cudaSuccess; }
static void cudaFree(void *p) { free(p); }
"""
"""What of CUDA the file uses, on one thread; half the blocks, so that each has samples in two rounds."""

MACHINES = {"paper": PAPER, "general": general(4), "massless cross-bars": random_machine(3)}
TRACE = gpu.forces_kernel.__wrapped__  # anew at each call
each_machine = pytest.mark.parametrize("machine", MACHINES.values(), ids=MACHINES)


@pytest.fixture
def jax():
    return pytest.importorskip("jax", reason="jax not installed: pip install 'p3dof[jax]'")


def broken(friction):
    """The kernel with one of its sums made a difference."""
    kernel = TRACE(friction)
    operations = kernel.tape.operations
    sums = [i for i in kernel.tape.needed(kernel.results) if operations[i].name == "add"]
    place = sums[len(sums) // 2]
    operations[place] = Operation("sub", operations[place].operands)
    return kernel


@pytest.fixture
def break_formula(monkeypatch):
    def act():
        for cached in (gpu._on_arrays, gpu._peaks):
            cached.cache_clear()
        monkeypatch.setattr(gpu, "forces_kernel", broken)

    yield act
    for cached in (gpu._on_arrays, gpu._peaks):
        cached.cache_clear()


def states_of(machine, seed=5, count=300):
    found = random_states(machine, seed, count)
    return found.pose, found.velocity, found.acceleration, found.wrench


def paper_states(count=201):
    motion = paper_motion(count)
    return motion.pose, motion.velocity, motion.acceleration, np.zeros((count, 6))


def largest(forces):
    return np.abs(forces).max(axis=-1)


def errors(machine, states, found):
    """Differences from virtual powers, by the largest force of each sample and its conditioning."""
    expected = virtual_power_forces(machine, *states)
    return largest(found - expected) / largest(expected) / conditioning(machine.geometry, states[0])


def designs(count=40):
    """Machines of other lengths and masses, and their rows."""
    rng, found = np.random.default_rng(7), []
    for _ in range(count):
        lengths = p3dof.machine.Geometry(*(np.array([0.1, 0.25, 0.42]) * rng.uniform(0.97, 1.03, 3)), b=0.1)
        found.append(p3dof.Parameters(lengths, PAPER.bodies, gravity=rng.normal(0, 6, 3)))
    return found, np.array([parameter_row(each) for each in found])


def designs_peaks(machines, states):
    return np.array([np.abs(virtual_power_forces(each, *states)).max(axis=0) for each in machines])


# JAX


@each_machine
def test_forces_of_jax_are_those_of_virtual_powers(jax, machine):
    states = states_of(machine)
    found = gpu.jax_forces(parameter_row(machine), *states)
    assert isinstance(found, jax.Array)
    assert found.dtype == "float64"
    assert errors(machine, states, np.asarray(found)).max() < 1e-12
    assert not jax.config.jax_enable_x64  # nothing is changed for the user


@pytest.mark.usefixtures("jax")
def test_forces_of_jax_over_the_papers_motion():
    states = paper_states()
    expected = virtual_power_forces(PAPER, *states)
    for friction in (False, True):
        found = gpu.jax_forces(parameter_row(PAPER), *states[:3], friction=friction)
        assert off(np.asarray(found), expected) < 1e-12


@pytest.mark.usefixtures("jax")
def test_a_broken_formula_is_seen_by_jax(break_formula):
    break_formula()
    machine = MACHINES["general"]
    states = states_of(machine)
    assert errors(machine, states, np.asarray(gpu.jax_forces(parameter_row(machine), *states))).max() > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    "machine", [pytest.param(PAPER, marks=pytest.mark.slow), MACHINES["general"]], ids=["paper", "general"]
)
def test_jax_differentiates_the_forces(jax, machine):
    states, row = states_of(machine, count=60), np.array(parameter_row(machine))
    expected = p3dof.Manipulator(machine).force_derivatives(*states[:3], wrench=states[3])
    with jax.enable_x64(True):
        found = jax.vmap(jax.jacrev(gpu.jax_forces, (1, 2, 3)), (None, 0, 0, 0, 0))(row, *states)
        one = jax.grad(lambda pose: gpu.jax_forces(row, pose, *(part[0] for part in states[1:]))[2])
        last = one(states[0][0])
    wanted = expected.by_pose, expected.by_velocity, expected.by_acceleration
    for got, want in zip(found, wanted, strict=True):
        scale = np.abs(want).max(axis=(1, 2)) * conditioning(machine.geometry, states[0])
        assert (np.abs(np.asarray(got) - want).max(axis=(1, 2)) / scale).max() < 1e-11
    np.testing.assert_allclose(last, found[0][0, 2], rtol=1e-12)


@pytest.mark.slow
def test_jax_differentiates_by_the_machine(jax):
    """Forces are linear in a mass: the derivative is the difference."""
    row, states = np.array(parameter_row(PAPER)), states_of(PAPER, count=20)
    place = GIVEN.index("platform.mass")
    one = np.eye(len(GIVEN))[place]
    heavier = row + one
    with jax.enable_x64(True):
        _, found = jax.jvp(lambda row: gpu.jax_forces(row, *states), (row,), (one,))
    difference = gpu.jax_forces(heavier, *states) - gpu.jax_forces(row, *states)
    assert off(np.asarray(found), np.asarray(difference)) < 1e-11


def test_peaks_of_designs_by_jax(jax):
    machines, rows = designs()
    states = paper_states(101)
    with jax.enable_x64(True):
        found = jax.jit(gpu.jax_peaks)(rows, *states)
    assert off(np.asarray(found), designs_peaks(machines, states)) < 1e-12


@pytest.mark.usefixtures("jax")
def test_jax_out_of_reach_has_nan():
    pose = np.array([[0, 0, 0], [9.0, 0, 0]])
    found = np.asarray(gpu.jax_forces(parameter_row(PAPER), pose, np.zeros(3), np.zeros(3)))
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).any()
    assert np.isnan(gpu.jax_peaks([parameter_row(PAPER)], pose, 0 * pose, 0 * pose)).any()


def test_what_jax_is_not_given_is_refused(jax):
    row, still = np.array(parameter_row(PAPER)), np.zeros(3)
    with pytest.raises(InputError, match=r"machine: expected doubles, got float32: .*enable_x64\(True\)"):
        jax.jit(gpu.jax_forces)(row, still, still, still)
    with pytest.raises(InputError, match="velocity: expected doubles, got float32"):
        gpu.jax_forces(row, still, still.astype("float32"), still)
    with pytest.raises(InputError, match=r"pose: expected shape \(..., 3\), got \(2,\)"):
        gpu.jax_forces(row, still[:2], still, still)
    with pytest.raises(InputError, match=rf"machine: expected shape \(..., {len(GIVEN)}\), got \(7,\)"):
        gpu.jax_forces(row[:7], still, still, still)
    whole = gpu.jax_forces(row, np.zeros(3, dtype=int), still, still)
    np.testing.assert_array_equal(whole, gpu.jax_forces(row, still, still, still))


def test_without_jax_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'p3dof\[jax\]'"):
        gpu.jax_forces(parameter_row(PAPER), np.zeros(3), np.zeros(3), np.zeros(3))


# CUDA C++


class Cuda:
    """The functions of a file, compiled as C++."""

    def __init__(self, machine, folder, compiler):
        (name, text), *_ = gpu.cuda_files(machine, prefix="arm").items()
        assert name == "arm_cuda.cu"
        (folder / name).write_text(text, encoding="ascii")
        (folder / "cuda_runtime.h").write_text(SHIM.replace("P3DOF_", "ARM_"), encoding="ascii")
        warnings = ["-Wall", "-Wextra", "-Werror", "-Wno-unknown-pragmas"]
        command = [compiler, "-O1", *warnings, "-I.", "-shared", "-fPIC", "-xc++", name, "-o", "arm.so"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        self.library = ctypes.CDLL(str(folder / "arm.so"))
        self.machine = np.array((ctypes.c_double * len(GIVEN)).in_dll(self.library, "arm_cuda_machine"))

    def call(self, name, *arguments):
        given = [
            ctypes.c_size_t(each) if isinstance(each, int) else each.ctypes.data_as(ctypes.c_void_p)
            for each in arguments
        ]
        return getattr(self.library, name)(*given)

    def forces(self, states, machine=None):
        motion, found = columns(states), np.empty((3, len(states[0])))
        given = self.machine if machine is None else machine
        assert self.call("arm_cuda_forces", given, motion.shape[1], motion, found) == 0
        return found.T

    def peaks(self, rows, states):
        motion, found = columns(states), np.empty((3, len(rows)))
        assert self.call("arm_cuda_peaks", len(rows), rows, motion.shape[1], motion, found) == 0
        return found.T


def columns(states):
    pose, velocity, acceleration, wrench = states
    return np.ascontiguousarray(np.hstack([pose, velocity, acceleration, wrench[:, [1, 2, 4]]]).T)


@each_machine
@each_cpp
def test_forces_of_cuda_are_those_of_virtual_powers(machine, compiler, tmp_path):
    compiled, states = Cuda(machine, tmp_path, compiler), states_of(machine)
    np.testing.assert_array_equal(compiled.machine, parameter_row(machine))
    assert errors(machine, states, compiled.forces(states)).max() < 1e-12


@each_cpp
def test_cuda_over_the_papers_motion_and_for_many_designs(compiler, tmp_path):
    compiled, states = Cuda(PAPER, tmp_path, compiler), paper_states()
    assert off(compiled.forces(states), virtual_power_forces(PAPER, *states)) < 1e-12
    machines, rows = designs(300)
    found = compiled.peaks(rows, paper_states(11))
    assert off(found, designs_peaks(machines, paper_states(11))) < 1e-12
    away = (np.vstack([[9.0, 0, 0], states[0][:2]]), *(part[:3] for part in states[1:]))
    assert np.isnan(compiled.peaks(rows[:2], away)).any()  # whatever came before it or after
    assert compiled.call("arm_cuda_forces", rows, 0, rows, rows) != 0


@pytest.mark.skipif(CC is None, reason="no C compiler here")
def test_a_broken_formula_is_seen_in_cuda(break_formula, tmp_path):
    break_formula()
    machine = MACHINES["general"]
    states = states_of(machine)
    compiler = next(CPP[name] for name in CPP if shutil.which(CPP[name]))
    assert errors(machine, states, Cuda(machine, tmp_path, compiler).forces(states)).max() > 1e-6


@each_machine
def test_nvcc_compiles_it_where_it_is(machine, tmp_path):
    """Also without: the text has no operation that the tape did not have, and all of them."""
    (text,) = gpu.cuda_files(machine).values()
    kernel = gpu.forces_kernel(bool(machine.friction))
    sample = text[text.index("p3dof_cuda_sample(\n") : text.index("__global__")]
    counts = kernel.operations(margin=True)
    assert sample.count("sqrt(") == counts["sqrt"]
    assert sample.count("tanh(") == counts["tanh"]
    assert sample.count("sincos(") == counts["sin"] == counts["cos"]
    assert sample.count(" / ") == counts["div"]
    assert f"/* {sum(counts.values())} operations: " in text
    assert all(isinstance(result, Symbol) for result in kernel.results)
    if nvcc := shutil.which("nvcc"):
        (tmp_path / "a.cu").write_text(text, encoding="ascii")
        command = [nvcc, "-arch=sm_80", "-cubin", "--Werror", "all-warnings", "a.cu"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_the_command_writes_it(tmp_path, capsys):
    command = ["codegen", "--out", str(tmp_path / "c"), "--cuda", "--prefix", "arm"]
    assert main(command) == 0
    assert main([*command, "--check"]) == 0
    text = (tmp_path / "c" / "arm_cuda.cu").read_text(encoding="ascii")
    assert "`p3dof codegen --prefix arm --cuda`" in text
    assert "p3dof_" not in text
    capsys.readouterr()
    assert main(["codegen", "--cuda"]) != 0
    assert main(["codegen", "--out", str(tmp_path), "--cuda", "--float"]) != 0
    assert "leave out --cuda" in " ".join(capsys.readouterr().err.split())


# Any robot


class RobotOnGpu:
    """The functions of a robot in CUDA C++, compiled as C++, on columns."""

    def __init__(self, folder, compiler, robot, **options):
        (folder / "cuda_runtime.h").write_text(SHIM, encoding="ascii")
        text = loop_files(robot, "bot", cuda=True, **options).files["bot_cuda.cu"]
        self.text = text
        before = "#define BOT_CUDA_LAUNCH P3DOF_CUDA_LAUNCH\n#define P3DOF_CUDA_BLOCK BOT_CUDA_BLOCK\n"
        (folder / "bot.cpp").write_text(before + text, encoding="ascii")
        flags = "-std=c++17 -O1 -Wall -Wextra -Werror -shared -fPIC -I ."
        command = [compiler, *flags.split(), "bot.cpp", "-o", "bot.so"]
        subprocess.run(command, cwd=folder, check=True)
        self.library = ctypes.CDLL(str(folder / "bot.so"))

    def __call__(self, name, outputs, *rows):
        """Outputs (N, outputs) of inputs (N, size) each."""
        given = np.ascontiguousarray(np.concatenate(rows, axis=1).T)
        found, double = np.full((outputs, given.shape[1]), np.nan), ctypes.POINTER(ctypes.c_double)
        call = getattr(self.library, f"bot_cuda_{name}")
        status = call(ctypes.c_size_t(given.shape[1]), *(x.ctypes.data_as(double) for x in (given, found)))
        assert status == 0
        return found.T


@each_cpp
def test_a_transmission_in_cuda_is_that_of_python(tmp_path, compiler):
    """Positions on their branch, motions, forces and gains of many samples, and one that is out of reach."""
    robot = p3dof.load_robot(GALLERY / "leg.urdf")
    one = robot.transmission(["ankle_pitch", "ankle_roll"])
    gpu = RobotOnGpu(tmp_path, compiler, robot, coordinates=["ankle_pitch", "ankle_roll"])
    rng, n = np.random.default_rng(0), 400
    x = rng.uniform([-0.5, -0.25], [0.2, 0.25], (n, 2))
    v, a, f = rng.normal(size=(3, n, 2))
    start = np.tile(one.home, (n, 1)), np.tile(one.positions("joint", one.home), (n, 1))
    found = gpu("joint_to_actuator", 26, *start, x, v, a)
    expected = one.joint_to_actuator(x, v, a)
    assert not found[:, 0].any()
    assert (found[:, -1] > 0).all()
    for values, wanted in zip(
        np.split(found[:, 13:23], [2, 4, 6], axis=1),
        (expected.position, expected.velocity, expected.acceleration, expected.jacobian.reshape(n, 4)),
        strict=True,
    ):
        np.testing.assert_allclose(values, wanted, rtol=0, atol=1e-11 * max(1.0, np.abs(wanted).max()))
    q = found[:, 1:13]
    back = gpu("actuator_to_joint", 26, q, found[:, 13:15], *np.split(found[:, 13:19], 3, axis=1))
    np.testing.assert_allclose(back[:, 13:19], np.concatenate([x, v, a], axis=1), rtol=0, atol=1e-10)
    forces = gpu("joint_to_actuator_forces", 5, q, f)[:, :2]
    np.testing.assert_allclose(forces, one.actuator_forces(q, f), rtol=0, atol=1e-11)
    K, D = np.tile(np.diag([80.0, 60.0]).ravel(), (n, 1)), np.tile(np.diag([2.0, 1.0]).ravel(), (n, 1))
    gains = gpu("joint_to_actuator_gains", 11, q, K, D, f)[:, :8]
    wanted = [
        one.actuator_gains(*sample)
        for sample in zip(q, K.reshape(n, 2, 2), D.reshape(n, 2, 2), f, strict=True)
    ]
    np.testing.assert_allclose(gains, np.reshape(wanted, (n, 8)), rtol=0, atol=1e-9)
    far = gpu("joint_to_actuator", 26, *(rows[:1] for rows in (*start, x + 3.0, v, a)))[0]
    assert far[0] == 1
    np.testing.assert_array_equal(far[1:13], one.home)
    assert np.isnan(far[15:]).all()


def test_the_dynamics_of_a_robot_in_cuda_are_those_of_python(tmp_path):
    robot = p3dof.load_robot(GALLERY / "stewart.urdf")
    gpu = RobotOnGpu(tmp_path, CPP[Path(CC).name], robot, external=["platform"])
    compiled, start = robot.compile(external=["platform"]), robot.assemble().q
    time = np.arange(0, 0.3, 1e-3)
    phase = np.arange(6)
    turned = 9 * time[:, None] + phase
    legs = start[[2, 5, 8, 11, 14, 17]] + 0.02 * (np.sin(turned) - np.sin(phase))
    speed, push = 0.18 * np.cos(turned), -1.62 * np.sin(turned)
    wrench = np.random.default_rng(1).normal(size=(len(time), 6))
    motion = compiled.complete(time, legs, speed, push, {"platform": wrench})
    found = gpu("inverse_dynamics", 6 + 18 + 3, motion.q, motion.v, motion.a, wrench)
    np.testing.assert_allclose(found[:, :6], motion.tau, rtol=0, atol=1e-9)
    assert (found[:, -1] > 0).all()
    back = gpu("forward_dynamics", 24 + 3, motion.q, motion.v, motion.tau, wrench)
    np.testing.assert_allclose(back[:, :24], motion.a, rtol=0, atol=1e-9 * np.abs(motion.a).max())


DEVICE = """
#pragma once
#include <stddef.h>
#define __host__ __attribute__((host))
#define __device__ __attribute__((device))
#define __global__ __attribute__((global))
struct dim3 { unsigned x, y, z; dim3(unsigned a) : x(a), y(1), z(1) {} };
enum cudaError_t { cudaSuccess, cudaErrorInvalidValue };
enum cudaMemcpyKind { cudaMemcpyHostToDevice, cudaMemcpyDeviceToHost };
extern "C" cudaError_t cudaConfigureCall(dim3, dim3, size_t = 0, void * = 0);
extern "C" unsigned __cudaPushCallConfiguration(dim3, dim3, size_t = 0, void * = 0);
cudaError_t cudaMalloc(void **, size_t);
cudaError_t cudaMemcpy(void *, const void *, size_t, cudaMemcpyKind);
cudaError_t cudaGetLastError();
cudaError_t cudaFree(void *);
struct place { unsigned x; };
extern const __device__ __attribute__((weak)) place gridDim, blockDim, blockIdx, threadIdx;
extern "C" {
__device__ double sin(double);
__device__ double cos(double);
__device__ double sqrt(double);
__device__ double fabs(double);
__device__ double floor(double);
__device__ double tanh(double);
__device__ double atan2(double, double);
__device__ void *memcpy(void *, const void *, size_t);
}
"""
"""What of CUDA a compiler for the device has to know: nothing of the host may be called there."""


def test_a_compiler_for_the_device_takes_it(tmp_path):
    """Clang has one, without CUDA: a kernel for each function, in assembly of a GPU."""
    if shutil.which("clang++") is None:
        pytest.skip("clang++ not installed")
    robot = p3dof.load_robot(GALLERY / "leg.urdf")
    text = loop_files(robot, "bot", coordinates=["knee"], observer=True, cuda=True).files["bot_cuda.cu"]
    (tmp_path / "cuda_runtime.h").write_text(DEVICE, encoding="ascii")
    (tmp_path / "bot.cu").write_text(text, encoding="ascii")
    flags = "-x cuda --cuda-gpu-arch=sm_70 -nocudainc -nocudalib --cuda-device-only -S -O1 -I . -Wall -Werror"
    quiet = "-Wno-unknown-cuda-version"
    command = ["clang++", *flags.split(), quiet, "bot.cu", "-o", "bot.ptx"]
    subprocess.run(command, cwd=tmp_path, check=True)
    kernels = (tmp_path / "bot.ptx").read_text(encoding="ascii").count(".entry")
    assert kernels == text.count("\nBOT_CUDA_FUNCTION(") == 14


def test_single_precision_is_not_for_cuda():
    robot = p3dof.load_robot(GALLERY / "leg.urdf")
    with pytest.raises(InputError, match="CUDA C\\+\\+ computes with doubles"):
        loop_files(robot, coordinates=["ankle_pitch", "ankle_roll"], precision="float", cuda=True)
