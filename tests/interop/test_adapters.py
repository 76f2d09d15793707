"""`docs/examples`: adapters to other libraries are short and run as programs; the package needs none."""

import os
import re
import subprocess
import sys

import pytest
from documents import ROOT

FOLDER = ROOT / "docs/examples"
FILES = sorted(FOLDER.glob("*.py"))
LIBRARIES = {
    "robot_fmu": ("pythonfmu", "pythonfmu3"),
    "robot_in_mjx": ("jax", "mujoco.mjx"),
    "robot_in_rerun": ("rerun",),
    "robot_in_steps": (),
    "robot_in_warp": ("mujoco_warp",),
    "swing_up_gym": ("gymnasium",),
    "swing_up_learning": ("gymnasium", "cma"),
}
ARGUMENTS = {"robot_fmu": ["out"], "robot_in_rerun": ["run.rrd"], "swing_up_learning": ["swing_up.png", "2"]}
SAID = {
    "robot_fmu": r"out/FiveBar2\.fmu\nout/FiveBar3\.fmu",
    "robot_in_mjx": r"\[-1\.0543\d+ +1\.1120\d+\]",
    "robot_in_rerun": r"201 samples of 20 bodies in run\.rrd",
    "robot_in_steps": r"after 1\.00 s at \[2\.19789\d+ 0\.90217\d+\] rad",
    "robot_in_warp": r"\[\[-1\.0543\d+ +1\.1120\d+\]",
    "swing_up_gym": r"0\.0\d+",
    "swing_up_learning": r"return \d+, the first generation's 2\d",
}
LONG = {"robot_in_mjx", "robot_in_warp", "swing_up_learning"}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_they_are_short_and_shown(file):
    text = file.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert text.startswith('"""')
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs/how-to").glob("*.md")]
    assert any(f"```{{literalinclude}} ../examples/{file.name}\n" in page for page in pages)
    assert any(
        re.search(rf"\b{file.stem}\b", test.read_text()) for test in (ROOT / "tests").glob("*/test_*.py")
    )


def test_the_package_imports_none_of_their_libraries():
    names = {library for libraries in LIBRARIES.values() for library in libraries} - {"jax"}
    found = re.compile(rf"^\s*(import|from) ({'|'.join(map(re.escape, sorted(names)))})\b", re.MULTILINE)
    assert found.search((FOLDER / "robot_fmu.py").read_text(encoding="utf-8"))
    for file in (ROOT / "p3dof").rglob("*.py"):
        assert not found.search(file.read_text(encoding="utf-8")), file


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in LIBRARIES]
)
def test_they_run_as_programs(name, tmp_path):
    for library in LIBRARIES[name]:
        pytest.importorskip(library, reason=f"{library} not installed: pip install 'p3dof[adapters]'")
    command = [sys.executable, FOLDER / f"{name}.py", *ARGUMENTS.get(name, [])]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(SAID[name], done.stdout), done.stdout
    for made in ARGUMENTS.get(name, [])[:1]:
        assert (tmp_path / made).exists()
