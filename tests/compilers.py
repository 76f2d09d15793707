"""The compilers that C of this package is tried with: every one of these that is installed.

With ``P3DOF_REQUIRE=all`` all of them must be.
"""

from __future__ import annotations

import shutil

import pytest

CPP = {"gcc": "g++", "clang": "clang++"}
"""The C++ compiler beside each C compiler."""
CC = next((found for found in map(shutil.which, (*CPP, "cc")) if found), None)
"""One that is there, for tests to which it does not matter which."""


def parameter(name: str):
    """A compiler as a parameter of tests; where it is missing, they are skipped."""
    missing = pytest.mark.skipif(shutil.which(name) is None, reason=f"{name} not installed")
    return pytest.param(name, id=name, marks=missing)


COMPILED = pytest.mark.skipif(CC is None, reason="no C compiler here")
each_c = pytest.mark.parametrize("compiler", [parameter(name) for name in CPP])
each_cpp = pytest.mark.parametrize("compiler", [parameter(name) for name in CPP.values()])
