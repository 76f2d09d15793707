"""What pyproject.toml cannot say: the optional extension of compiled kernels.

Without a compiler or Python's headers the build goes on and NumPy does the work; the wheel is then one for
any platform (``py3-none-any``), so that its name tells it from one with the extension. Set
``P3DOF_NO_EXTENSION=1`` to leave the extension out on purpose.
"""

from __future__ import annotations

import os
import runpy
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

KERNELS = Path("p3dof/_native")
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

    def build_extension(self, ext: Extension) -> None:
        """Build one extension; where that fails, leave none of an earlier build either."""
        try:
            super().build_extension(ext)
        except Exception:
            Path(self.get_ext_fullpath(ext.name)).unlink(missing_ok=True)
            self.distribution.ext_modules = [e for e in self.distribution.ext_modules if e is not ext]
            raise  # setuptools goes on: it is optional


class NamedWheel(bdist_wheel):
    """A wheel named after what is in it."""

    def run(self) -> None:
        """Build, then choose the name."""
        self.reinitialize_command("build_ext").inplace = False
        self.run_command("build")
        self.root_is_pure = not self.distribution.has_ext_modules()
        super().run()


def extensions() -> list[Extension]:
    """Return the extension, unless it is not wanted."""
    if os.environ.get("P3DOF_NO_EXTENSION", "") not in {"", "0"}:
        return []
    sources = runpy.run_path((KERNELS / "sources.py").as_posix())
    return [
        Extension(
            "p3dof._native._compiled",
            [(KERNELS / "_compiled.c").as_posix()],
            depends=[header.as_posix() for header in sources["headers"](Path("p3dof"))],
            define_macros=[("P3DOF_SOURCES", f"{sources['fingerprint'](Path('p3dof'))}LL")],
            optional=True,
        )
    ]


setup(ext_modules=extensions(), cmdclass={"build_ext": BuildKernels, "bdist_wheel": NamedWheel})
