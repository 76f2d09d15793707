"""What pyproject.toml cannot say: the optional extensions, and the model files.

The extensions are compiled kernels and numbers of tables as text.

Without a compiler or Python's headers the build goes on and NumPy does the work; the wheel is then one for
any platform (``py3-none-any``), so that its name tells it from one with the extension.

``P3DOF_NO_EXTENSION=1`` leaves the extension out on purpose. ``P3DOF_BUILD_LEVELS`` says for which levels of
the processor it is compiled: ``all``, as for wheels, or ``native``, as in place (``pip install -e``): the
baseline and the best of the processor at hand.
"""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

KERNELS = Path("p3dof/_native")
FLAGS = ["-O3", "-g0", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-fopenmp-simd"]
"""What gcc and clang need for vector instructions with fused multiply-add, and no more: infinities, NaN and
the order of additions stay as written."""

GCC = ["-fno-schedule-insns2"]
"""What takes gcc long and makes no kernel faster, left out; with -O2, many runs are 12 to 25 % slower."""

STABLE = sys.version_info >= (3, 12) and not sysconfig.get_config_var("Py_GIL_DISABLED")
"""Whether the extensions keep to Python's stable ABI: one wheel then serves this Python and later ones."""
LIMITED_API = 0x030C0000

ABOVE = {"avx2": {"__AVX2__", "__FMA__"}, "avx512": {"__AVX512F__", "__AVX512DQ__", "__AVX512VL__"}}
"""The levels above the baseline, and what gcc and clang define on a processor that has them."""


ROBOTS = Path("docs/_static/gallery")
MODELS = {"urdf": [*Path("urdf").iterdir()], "gallery": [*ROBOTS.glob("*.urdf"), *ROBOTS.glob("*.yaml")]}
"""What a wheel has in p3dof/models, by folder: `p3dof.model_files` finds it there."""


class BuildKernels(build_ext):
    """Compile with the flags that the compiler at hand knows, one file on each processor."""

    def run(self) -> None:
        """Build; setuptools forgets here whether it is in place."""
        self.native = bool(self.inplace or self.editable_mode)
        super().run()

    def build_extensions(self) -> None:
        """Build; called once the compiler is known."""
        known = defined(getattr(self.compiler, "compiler_so", None) or [])
        wanted = levels(known, native=self.native)
        for extension in self.extensions:
            extension.define_macros += [
                (f"P3DOF_NO_{level.upper()}", "1") for level in ABOVE if level not in wanted
            ]
            if self.compiler.compiler_type != "msvc":
                extension.extra_link_args = ["-s"] if sys.platform == "linux" else []  # no symbols
                extension.extra_compile_args = FLAGS + (GCC if known and "__clang__" not in known else [])
            built = Path(self.get_ext_fullpath(extension.name))
            old = built.read_bytes() if built.is_file() and "__x86_64__" in known else None
            missing = old is not None and not all(f"\0{level}\0".encode() in old for level in wanted)
            if missing and KERNELS.name in extension.name:
                self.force = True
        if known:
            self.compiler.compile = partial(in_parallel, self.compiler.compile)
        super().build_extensions()

    def build_extension(self, ext: Extension) -> None:
        """Build one extension; where that fails, leave none: not the other one, nor of an earlier build."""
        if not self.distribution.ext_modules:
            return
        try:
            super().build_extension(ext)
        except Exception:
            for each in self.extensions:
                Path(self.get_ext_fullpath(each.name)).unlink(missing_ok=True)
            self.distribution.ext_modules = []
            raise  # setuptools goes on: it is optional


def levels(known: set[str], native: bool) -> list[str]:
    """Return the levels above the baseline to compile for, by what the compiler defines."""
    asked = os.environ.get("P3DOF_BUILD_LEVELS") or ("native" if native else "all")
    if asked not in {"all", "native"}:
        raise SystemExit(f"P3DOF_BUILD_LEVELS: expected all or native, got {asked}")
    if asked == "all" or not known:
        return list(ABOVE)
    return [level for level, needed in ABOVE.items() if needed <= known][-1:]


def in_parallel(compile_all: Callable[..., list[str]], sources: Sequence[str], **options: Any) -> list[str]:
    """Compile each source by itself; the last by name are the longest."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = pool.map(lambda source: compile_all([source], **options), reversed(sources))
        return [made for objects in found for made in objects]


def defined(compiler: Sequence[str]) -> set[str]:
    """Return the names that gcc or clang defines for the processor at hand; none from another compiler."""
    command = [*compiler, "-march=native", "-dM", "-E", "-x", "c", os.devnull]
    try:
        told = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603
    except (OSError, subprocess.CalledProcessError):
        return set()
    return set(re.findall(r"^#define (\w+)", told, re.M))


class BuildWithModels(build_py):
    """Copy the model files, which the repository has where readers look for them, into the package."""

    def run(self) -> None:
        """Build; in place they are found where they are."""
        super().run()
        for name, files in ({} if self.editable_mode else MODELS).items():
            folder = Path(self.build_lib, "p3dof/models", name)
            self.mkpath(folder.as_posix())
            for file in sorted(files):
                self.copy_file(file.as_posix(), folder.as_posix())


class NamedWheel(bdist_wheel):
    """A wheel named after what is in it."""

    def run(self) -> None:
        """Build, then choose the name."""
        self.reinitialize_command("build_ext").inplace = False
        self.run_command("build")
        self.root_is_pure = not self.distribution.has_ext_modules()
        super().run()


def extensions() -> list[Extension]:
    """Return the extensions, unless they are not wanted."""
    if os.environ.get("P3DOF_NO_EXTENSION", "") not in {"", "0"}:
        return []
    limited: list[tuple[str, str | None]] = [("Py_LIMITED_API", hex(LIMITED_API))] if STABLE else []
    sources = runpy.run_path((KERNELS / "sources.py").as_posix())
    return [
        Extension(
            "p3dof._native._compiled",
            [source.as_posix() for source in sorted(KERNELS.glob("*.c"))],
            depends=[header.as_posix() for header in sources["headers"](Path("p3dof"))],
            define_macros=[("P3DOF_SOURCES", f"{sources['fingerprint'](Path('p3dof'))}LL"), *limited],
            py_limited_api=STABLE,
            optional=True,
        ),
        Extension(
            "p3dof._base.files._numbers",
            ["p3dof/_base/files/_numbers.c"],
            depends=["p3dof/_base/stable_abi.h"],
            define_macros=limited,
            py_limited_api=STABLE,
            optional=True,
        ),
    ]


setup(
    ext_modules=extensions(),
    options={"bdist_wheel": {"py_limited_api": "cp312"}} if STABLE else {},
    cmdclass={"build_ext": BuildKernels, "build_py": BuildWithModels, "bdist_wheel": NamedWheel},
)
