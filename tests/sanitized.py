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
import p3dof.compiled.extension as room
spec = importlib.util.spec_from_file_location("p3dof.compiled.extension._compiled", sys.argv[1])
room._compiled = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(room._compiled)
"""


def run_sanitized(folder: Path, script: str) -> subprocess.CompletedProcess[str]:
    """Build the extension with sanitizers into a folder, and run a script that imports it and this folder.

    The first error ends it; leaks are not looked for, the interpreter has its own.
    """
    made = folder / "_compiled.so"
    flags = ["-shared", "-fPIC", "-O0", "-g1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    include, source = sysconfig.get_path("include"), ROOT / "p3dof/compiled/extension/_compiled.c"
    command = ["gcc", *flags, "-fno-math-errno", f"-I{include}", str(source), "-o", str(made)]
    subprocess.run(command, check=True)
    libraries = [
        subprocess.run(
            ["gcc", f"-print-file-name={name}"], check=True, capture_output=True, text=True
        ).stdout.strip()
        for name in ("libasan.so", "libubsan.so")
    ]
    environment = {
        **os.environ,
        "LD_PRELOAD": " ".join(libraries),
        "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")]),
    }
    command = [sys.executable, "-W", "ignore", "-c", _BEGIN + script, str(made)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
