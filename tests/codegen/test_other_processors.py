"""Generated C as small processors run it: cross-compiled, emulated, and its self-test green there.

Clang compiles, with Debian's C libraries for these processors, and QEMU runs: Thumb-2 code of Cortex-M7
(doubles in hardware) and Cortex-M4 (floats only), and RISC-V.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import cache

import pytest
from gallery import gallery

from p3dof.codegen.controller import controller_files
from p3dof.codegen.loops import loop_files
from p3dof.machine.parameters import PAPER

ARM = ("--target=arm-linux-gnueabihf", "-mthumb", "-mfloat-abi=hard", "-fuse-ld=lld")
TARGETS = {
    "cortex-m7": ((*ARM, "-mcpu=cortex-m7", "-mfpu=fpv5-d16"), ("qemu-arm", "-cpu", "max")),
    "cortex-m4": ((*ARM, "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"), ("qemu-arm", "-cpu", "max")),
    "riscv64": (("--target=riscv64-linux-gnu", "-march=rv64gc"), ("qemu-riscv64",)),
}
ANKLE = {"coordinates": ["ankle_pitch", "ankle_roll"]}
ROUTINES = r"__aeabi_[df]|__\w*[ds]f[23]?$|__fix|__float|__ext|__trunc"
"""What a compiler calls where the processor has no such arithmetic."""


@cache
def installed(folder, target):
    """Whether a program of nothing is compiled, linked and run."""
    flags, emulator = TARGETS[target]
    if shutil.which("clang") is None or shutil.which(emulator[0]) is None:
        return False
    text = "#include <math.h>\nint main(int n, char **v)\n{\n    return (v == 0) || (sin(n) > 2.0);\n}\n"
    (folder / "none.c").write_text(text, encoding="ascii")
    command = ["clang", *flags, "-static", "none.c", "-o", f"none_{target}", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
    if done.returncode:
        return False
    return subprocess.run([*emulator, folder / f"none_{target}"], check=False).returncode == 0


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The C of the machine, of a robot and of a transmission, once for all processors; folder and name."""
    base, made = tmp_path_factory.mktemp("processors"), {}

    def of(name):
        if name not in made:
            made[name] = folder = base / name
            folder.mkdir()
            for file, text in files(name).items():
                (folder / file).write_text(text, encoding="utf-8")
        return made[name]

    return of


def files(name):
    kind, _, precision = name.partition("_")
    if kind == "machine":
        return controller_files(PAPER, True, name, precision=precision)
    if kind == "ankle":
        return loop_files(gallery("leg"), name, precision=precision, **ANKLE).files
    return loop_files(gallery("five_bar"), name).files


def built(folder, name, target, output):
    flags, _ = TARGETS[target]
    if not installed(folder.parent, target):
        pytest.skip(f"clang, a C library or an emulator for {target} not installed")
    command = ["clang", *flags, "-static", "-std=c99", "-O1", "-Wall", "-Wextra", "-o", output]
    command += ["-Wno-unused-command-line-argument", f"{name}.c", f"{name}_selftest.c", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def emulated(folder, target, output):
    command = [*TARGETS[target][1], folder / output]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def errors(text):
    return {name: float(size) for name, size in re.findall(r"^(\w+) +(\d\.\de[-+]\d\d)$", text, re.MULTILINE)}


CASES = [
    ("cortex-m7", "machine_double"),
    ("cortex-m7", "ankle_double"),
    ("cortex-m7", "five"),
    ("cortex-m4", "machine_float"),
    ("cortex-m4", "ankle_float"),
    ("riscv64", "machine_double"),
    ("riscv64", "ankle_double"),
    ("riscv64", "ankle_float"),
]


@pytest.mark.parametrize(("target", "name"), CASES)
def test_results_are_those_of_p3dof(written, target, name):
    folder = written(name)
    built(folder, name, target, f"{target}_selftest")
    done = emulated(folder, target, f"{target}_selftest")
    assert done.returncode == 0, done.stdout
    assert "all is well" in done.stdout
    found = errors(done.stdout)
    assert len(found) >= 6
    # Of floats the self-test has bounds of its own, which follow from the roundings of each function.
    assert max(found.values()) < (1e-4 if name.endswith("float") else 1e-12)
    if name.endswith("float"):
        assert max(found.values()) > 1e-8  # floats indeed


def test_the_self_test_notices_a_wrong_number_there(written, tmp_path):
    folder = shutil.copytree(written("five"), tmp_path / "broken")
    source = folder / "five.c"
    text = source.read_text(encoding="utf-8")
    source.write_text(re.sub(r"9\.81\d*", "9.82", text, count=1), encoding="utf-8")
    assert source.read_text(encoding="utf-8") != text
    built(folder, "five", "cortex-m7", "broken")
    done = emulated(folder, "cortex-m7", "broken")
    assert done.returncode != 0
    assert "error beyond the tolerance" in done.stdout


def called(folder, name, target):
    """What an object file of a processor calls."""
    if not installed(folder.parent, target) or shutil.which("nm") is None:
        pytest.skip(f"clang, a C library for {target} or nm not installed")
    command = ["clang", *TARGETS[target][0], "-std=c99", "-O1", "-c", f"{name}.c", "-o", f"{target}.o"]
    subprocess.run(command, cwd=folder, capture_output=True, check=True)
    done = subprocess.run(["nm", "-u", f"{target}.o"], cwd=folder, capture_output=True, text=True, check=True)
    return set(re.findall(r"U (\w+)", done.stdout))


@pytest.mark.parametrize("name", ["machine", "ankle"])
def test_single_precision_leaves_no_double_to_a_processor_of_floats(written, name):
    """Nothing of libm but functions of floats, and no arithmetic in software; with doubles there is."""
    single = called(written(f"{name}_float"), f"{name}_float", "cortex-m4")
    assert single <= {"atan2f", "cosf", "floorf", "hypotf", "memcpy", "memset", "sinf", "sqrtf", "tanhf"}
    assert not any(re.match(ROUTINES, one) for one in single)
    if name == "machine":
        assert "__aeabi_dmul" in called(written("machine_double"), "machine_double", "cortex-m4")
