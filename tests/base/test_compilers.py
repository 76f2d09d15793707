"""What the package compiles itself, by every compiler: without a warning, and the same numbers."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import closed_trees as trees
import numpy as np
import pytest
from compilers import CPP, each_c
from documents import ROOT
from gallery import GALLERY
from machines import random_machine, random_states

import p3dof
from p3dof.closed_form.compiled.formulas import kernel
from p3dof.closed_form.compiled.reduced import model_of
from p3dof.loops.compiled import build
from p3dof.loops.compiled.printing import lanes_source

INCLUDE = Path(sysconfig.get_path("include"))
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
REPEAT = """
#include <stdio.h>
#include <stdlib.h>
int main(void)
{
    static const int in_sizes[] = {@in}, out_sizes[] = {@out};
    double *in[@groups], *out[@found];
    ptrdiff_t strides[@groups];
    for (ptrdiff_t count = 0; count < 20; ++count) { /* arrays end where their last number does */
        for (int g = 0; g < @groups; ++g) {
            strides[g] = in_sizes[g];
            in[g] = malloc(sizeof(double) * (size_t)(count * in_sizes[g] + !count));
            for (ptrdiff_t i = 0; i < count * in_sizes[g]; ++i)
                in[g][i] = 0.1 * (double)(i % 7);
        }
        for (int g = 0; g < @found; ++g)
            out[g] = malloc(sizeof(double) * (size_t)(count * out_sizes[g] + !count));
        inverse_dynamics_many(count, (const double *const *)in, strides, out);
        for (int g = 0; g < @groups; ++g)
            free(in[g]);
        for (int g = 0; g < @found; ++g)
            free(out[g]);
    }
    puts("all is well");
    return 0;
}
"""


def extension_flags():
    """Those of setup.py, not optimised: that would take half a minute."""
    text = (ROOT / "setup.py").read_text(encoding="utf-8")
    found = re.search(r"^FLAGS = \[(.*)\]$", text, re.M)
    return [*re.findall(r'"(-[^"]*)"', found[1]), "-O0"]


@pytest.mark.skipif(not (INCLUDE / "Python.h").exists(), reason="no headers of Python here")
@each_c
def test_the_extension_is_clean_and_right(tmp_path, compiler):
    made = tmp_path / f"_compiled{sysconfig.get_config_var('EXT_SUFFIX')}"
    sources = (ROOT / "p3dof/_native").glob("*.c")
    # Python's own tables of methods and slots need casts and leave fields out.
    silent = ("-Wno-cast-function-type", "-Wno-missing-field-initializers")
    command = [compiler, *extension_flags(), "-std=c11", *WARNINGS, *silent, "-fPIC", "-shared"]
    mac = ["-undefined", "dynamic_lookup"] if sys.platform == "darwin" else []
    done = subprocess.run(
        [*command, *mac, f"-I{INCLUDE}", "-o", made, *sources], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    spec = importlib.util.spec_from_file_location("_compiled", made)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    machine = random_machine(1)
    states = random_states(machine, 1, 1003)
    motion = np.hstack([states.pose, states.velocity, states.acceleration])
    used = kernel("inverse_dynamics")
    constants = used.of(model_of(machine))
    columns = [np.ascontiguousarray(column) for column in motion.T]
    expected = used.on_arrays(*constants, *columns)
    for level in module.levels:
        found = [np.full(len(motion), np.nan) for _ in used.outputs]
        assert module.Call(used.name, level, constants, columns, found)()
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


@each_c
@pytest.mark.parametrize("level", build.LEVELS)
def test_lanes_are_clean_and_right(monkeypatch, tmp_path, compiler, level):
    told = Path("/proc/cpuinfo").read_text(encoding="ascii") if Path("/proc/cpuinfo").exists() else ""
    needed = {"avx512": "avx512dq", "avx2": "avx2"}.get(level, "")
    if needed not in told:
        pytest.skip("this processor has no such vectors")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(build, "compiler", lambda: compiler)
    flags = [flag for flag in build._FLAGS if flag != "-w"]
    monkeypatch.setattr(build, "_FLAGS", (*flags, *WARNINGS))
    loop = p3dof.load_robot(GALLERY / "five_bar.urdf")
    compiled = loop.compile(level=level, threads=1)
    moving = trees.motions(loop, 21, seed=3)
    found = compiled.inverse_dynamics(moving.q, moving.v, moving.a)
    assert not found.general.any()
    expected = loop.inverse_dynamics_batch(moving.q, moving.v, moving.a).tau
    np.testing.assert_allclose(found.tau, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    bound = compiled.bind("inverse_dynamics")
    for name, values in zip("qva", (moving.q, moving.v, moving.a), strict=True):
        bound.inputs[name][:] = values[4]
    bound.run()
    np.testing.assert_allclose(bound.outputs["tau"], expected[4], rtol=1e-11)


@each_c
def test_lanes_stay_inside_their_arrays(tmp_path, compiler):
    function = p3dof.load_robot(GALLERY / "five_bar.urdf").compile(level="numpy").function("inverse_dynamics")
    sizes = {"in": function.inputs.values(), "out": function.outputs.values()}
    text = REPEAT
    for name, values in sizes.items():
        text = text.replace(f"@{name}}}", f"{', '.join(map(str, values))}}}")
    text = text.replace("@groups", str(len(function.inputs))).replace("@found", str(len(function.outputs)))
    (tmp_path / "lanes.c").write_text(lanes_source([function]) + text)
    command = [compiler, "-std=gnu11", "-O1", "-g", *SANITIZERS, *WARNINGS, "-o", "lanes", "lanes.c", "-lm"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    done = subprocess.run([tmp_path / "lanes"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "all is well\n"), done.stderr


def test_the_checks_have_both_compilers():
    """`.ci/run` runs `make test EXTRAS=all`, which installs them; a test that misses one fails there."""
    line = re.search(r"^DEBIAN := (.*)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    assert {*CPP.values()} - {"clang++"} <= set(line[1].split())  # g++ brings gcc, clang brings clang++
    assert {"clang", "libclang-rt-dev", "lld"} <= set(line[1].split())
