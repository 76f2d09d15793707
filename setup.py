"""What pyproject.toml cannot say: the optional extension of compiled kernels.

Without a compiler or Python's headers the build goes on and NumPy does the work. Set ``P3DOF_NO_EXTENSION=1``
to leave the extension out on purpose.
"""

from __future__ import annotations

import os
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

KERNELS = Path("p3dof/compiled/extension")
FLAGS = ["-O3", "-g0", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-fopenmp-simd"]
"""What gcc and clang need for vector instructions with fused multiply-add, and no more: infinities, NaN and
the order of additions stay as written."""


class BuildKernels(build_ext):
    """Compile with the flags that the compiler at hand knows."""

    def build_extensions(self) -> None:
        """Build; called once the compiler is known."""
        if self.compiler.compiler_type != "msvc":
            for extension in self.extensions:
                extension.extra_compile_args = FLAGS
        super().build_extensions()


def extensions() -> list[Extension]:
    """Return the extension, unless it is not wanted."""
    if os.environ.get("P3DOF_NO_EXTENSION", "") not in {"", "0"}:
        return []
    headers = [*KERNELS.glob("*.h"), *KERNELS.glob("generated/*.h")]
    return [
        Extension(
            "p3dof.compiled.extension._compiled",
            [(KERNELS / "_compiled.c").as_posix()],
            depends=[header.as_posix() for header in headers],
            optional=True,
        )
    ]


setup(ext_modules=extensions(), cmdclass={"build_ext": BuildKernels})
