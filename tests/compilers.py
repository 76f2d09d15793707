"""The compilers that C of this package is tried with: every one of these that is installed.

With ``P3DOF_REQUIRE=all`` all of them must be.
"""

from __future__ import annotations

import platform
import shutil
import subprocess

import pytest

CPP = {"gcc": "g++", "clang": "clang++"}
"""The C++ compiler beside each C compiler."""
CC = next((found for found in map(shutil.which, (*CPP, "cc")) if found), None)
"""One that is there, for tests to which it does not matter which."""


def parameter(name: str, slow: bool = False):
    """A compiler as a parameter of tests; where it is missing, they are skipped."""
    missing = pytest.mark.skipif(shutil.which(name) is None, reason=f"{name} not installed")
    return pytest.param(name, id=name, marks=[missing, *([pytest.mark.slow] if slow else [])])


COMPILED = pytest.mark.skipif(CC is None, reason="no C compiler here")
each_c = pytest.mark.parametrize("compiler", [parameter(name, name != "gcc") for name in CPP])
each_cpp = pytest.mark.parametrize("compiler", [parameter(name, name != "g++") for name in CPP.values()])
"""Both; the second opinion is slow."""

each_c_and_bake = pytest.mark.parametrize(
    ("compiler", "bake"),
    [
        pytest.param(
            compiler,
            bake,
            id=f"{'baked' if bake else 'run-time'}-{compiler}",
            marks=parameter(compiler, slow=bake == (compiler == "gcc")).marks,
        )
        for compiler in CPP
        for bake in (False, True)
    ],
)
"""Both compilers and both kinds of code, each of the four in one quick test: the others are slow."""

SMALL = ("-Os", "-Os -m32", "-O1 -g -m32 -fsanitize=address,undefined -fno-sanitize-recover=all")
"""What C for small processors is tried with: few bytes, addresses of 32 bits, and both under sanitizers."""


@pytest.fixture(params=SMALL, ids=["small", "32 bits", "32 bits, sanitizers"])
def small(request, tmp_path) -> str:
    """Flags of gcc; those of 32 bits where it can, which takes Debian's gcc-multilib on this processor."""
    flags: str = request.param
    if shutil.which("gcc") is None:
        pytest.skip("gcc not installed")
    if "-m32" in flags:
        if platform.machine() != "x86_64":
            pytest.skip("this processor runs no programs of 32 bits")
        (tmp_path / "try.c").write_text("#include <math.h>\nint main(void) { return 0; }\n", encoding="ascii")
        command = ["gcc", *flags.split(), "try.c", "-o", "try", "-lm"]
        if subprocess.run(command, cwd=tmp_path, capture_output=True, check=False).returncode:
            pytest.skip("gcc-multilib not installed")
    return flags
