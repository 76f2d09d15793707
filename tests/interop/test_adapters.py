"""Adapters to other libraries, docs/examples: short, shown, tested, run; the package needs none of them."""

import ast
import os
import re
import shutil
import subprocess
import sys

import pytest
from documents import ROOT
from lowest import read_project

FOLDER = ROOT / "docs/examples"
EXAMPLES = sorted(path for path in FOLDER.iterdir() if path.suffix in (".py", ".c"))
PROGRAMS = [path for path in EXAMPLES if path.suffix == ".py"]
PAGES = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))
LIBRARIES = {
    "casadi_robot": ("casadi",),
    "casadi_swing_up": ("casadi",),
    "crocoddyl_pick": ("crocoddyl",),
    "crocoddyl_robot": ("crocoddyl",),
    "crocoddyl_swing_up": ("crocoddyl",),
    "jax_forces": ("jax",),
    "mink_closures": ("mink",),
    "pink_closures": ("pink",),
    "robot_fmu": ("pythonfmu", "pythonfmu3"),
    "robot_in_mjx": ("jax", "mujoco.mjx"),
    "robot_in_rerun": ("rerun",),
    "robot_in_steps": (),
    "robot_in_warp": ("mujoco_warp",),
    "swing_up_gym": ("gymnasium",),
    "swing_up_learning": ("gymnasium", "cma"),
    "torch_forces": ("torch",),
}
"""What a program needs of other libraries."""
MODULES = {"swing_up"}  # what programs share
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
"""What it prints; others some numbers."""
QUICK = {"pink_closures", "robot_fmu", "robot_in_rerun", "robot_in_steps", "swing_up_gym"}


def imported(path):
    """Return the first parts of all names that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return found


def with_imported(name):
    """Return an example, what goes with it in another language, and the examples that these import."""
    others = imported(FOLDER / f"{name}.py") & {path.stem for path in PROGRAMS}
    return {path for path in EXAMPLES if path.stem == name}.union(*map(with_imported, others))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_an_example_is_short_and_shown_whole(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert f"{{literalinclude}} ../examples/{path.name}\n" in PAGES
    if path.suffix == ".py":
        assert ast.get_docstring(ast.parse(text))
        assert text.count('\nif __name__ == "__main__":\n') == (path.stem not in MODULES)


def test_every_example_has_a_test():
    """Beside this one."""
    tests = [path for path in (ROOT / "tests").glob("*/test_*.py") if path.name != "test_adapters.py"]
    text = "\n".join(path.read_text(encoding="utf-8") for path in tests)
    assert [path.name for path in PROGRAMS if not re.search(rf"\b{path.stem}\b", text)] == []
    assert {path.stem for path in PROGRAMS} == LIBRARIES.keys() | MODULES


def test_the_package_imports_no_example_and_none_of_their_libraries():
    names = {path.stem for path in PROGRAMS}
    theirs = {library.partition(".")[0] for needed in LIBRARIES.values() for library in needed}
    theirs -= {"jax", "mujoco", "rerun"}  # which have a face of their own here
    for path in (ROOT / "p3dof").rglob("*.py"):
        assert not (names | theirs) & imported(path), path


def test_what_adapters_serve_is_pinned():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {line.partition("==")[0].lower() for line in lines}
    extras = read_project()["optional-dependencies"]
    names = {re.match(r"[\w.-]+", one).group().lower() for one in (*extras["adapters"], *extras["torch"])}
    assert names - {"p3dof"} <= pinned


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in LIBRARIES]
)
def test_an_example_runs_where_it_was_copied_to(name, tmp_path):
    """With the examples that it imports, and nothing else of the repository."""
    for library in LIBRARIES[name]:
        pytest.importorskip(library, reason=f"{library} not installed")
    for path in with_imported(name):
        shutil.copy(path, tmp_path)
    command = [sys.executable, f"{name}.py", *ARGUMENTS.get(name, [])]
    quiet = os.environ | {"MPLBACKEND": "Agg"}
    done = subprocess.run(command, cwd=tmp_path, env=quiet, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(SAID.get(name, r"\d\.\d"), done.stdout), done.stdout
    assert "nan" not in done.stdout.lower()
    for made in ARGUMENTS.get(name, [])[:1]:
        assert (tmp_path / made).exists()
