"""Every line of the page on other tools as it stands there, for who installed the package and the tool."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from documents import ROOT

PAGE = (ROOT / "docs/how-to/other-tools.md").read_text("utf-8")
ROWS = dict(re.findall(r"^\| ([^|]+?) \| [\d.]+ \| `([^`]+)`", PAGE, re.MULTILINE))
WORLDS = ("libsdformat",)
"""Whose line is one of a world's file."""
HERE = {
    **os.environ,
    "PYTHONPATH": str(ROOT),
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
}


def test_the_table_has_all_tools():
    assert len(ROWS) == 17


@pytest.mark.parametrize("tool", sorted(ROWS.keys() - set(WORLDS)))
def test_a_line_is_complete_as_written(tool, tmp_path):
    line = ROWS[tool]
    if line.startswith("import "):
        first, _, others = line.partition("; ")
        needed = re.findall(r"(?:import|,) +(\w+)", first) + re.findall(r"from (\w+)", others)
        missing = [module for module in needed if find_spec(module) is None]
        command = [sys.executable, "-c", line]
    else:
        missing = [] if shutil.which(line.split()[0]) else line.split()[:1]
        command = ["sh", "-c", line]
    if missing:
        pytest.skip(f"{missing[0]} is not installed")
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=HERE)
    assert ran.returncode == 0, ran.stderr
    assert "Traceback" not in ran.stderr
