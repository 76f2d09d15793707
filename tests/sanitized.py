"""The extension under the sanitizers of gcc, in a Python of its own: building it takes half a minute."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import p3dof

ROOT = Path(p3dof.__file__).parents[1]
LINUX = pytest.mark.skipif(
    sys.platform != "linux" or not shutil.which("gcc"), reason="gcc's sanitizers on Linux"
)

_BEGIN = """
import importlib.util, sys
import p3dof._native as room
spec = importlib.util.spec_from_file_location("p3dof._native._compiled", sys.argv[1])
room._compiled = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(room._compiled)
"""


_KINDS = {
    "address,undefined": (
        ["-O0", "-fno-sanitize-recover=all"],
        ("libasan.so", "libubsan.so"),
        {"ASAN_OPTIONS": "detect_leaks=0"},
        [],
    ),
    "thread": (
        ["-O1"],
        ("libtsan.so",),
        {"TSAN_OPTIONS": "exitcode=66", "OPENBLAS_NUM_THREADS": "1"},
        ["setarch", "-R"],  # it needs addresses where it expects them
    ),
}
"""Of the sanitizers: how the extension is built, what is loaded before Python, and how that is started."""


def run_sanitized(
    folder: Path, script: str, kind: str = "address,undefined"
) -> subprocess.CompletedProcess[str]:
    """Build the extension with sanitizers into a folder, and run a script that imports it and this folder.

    The first error of addresses ends it, races are all told; leaks are not looked for, the interpreter has
    its own.
    """
    flags, names, settings, before = _KINDS[kind]
    made = folder / "_compiled.so"
    include, sources = sysconfig.get_path("include"), map(str, (ROOT / "p3dof/_native").glob("*.c"))
    command = ["gcc", "-shared", "-fPIC", "-g1", f"-fsanitize={kind}", *flags, "-fno-math-errno"]
    if not made.exists():
        subprocess.run([*command, f"-I{include}", *sources, "-o", str(made)], check=True)
    libraries = [
        subprocess.run(
            ["gcc", f"-print-file-name={name}"], check=True, capture_output=True, text=True
        ).stdout.strip()
        for name in names
    ]
    environment = {
        **os.environ,
        **settings,
        "LD_PRELOAD": " ".join(libraries),
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")]),
    }
    command = [*before, sys.executable, "-W", "ignore", "-c", _BEGIN + script, str(made)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
