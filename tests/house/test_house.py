"""The tests' own house: its folders are the package's doors, and what is shared is in helper modules."""

import ast
import subprocess
import sys

import durations
import pytest
from documents import ROOT

TESTS = ROOT / "tests"
FILES = sorted(TESTS.rglob("test_*.py"))
OTHERS = {"house", "interop", "benchmarks"}
"""Folders beside those of the doors: the repository itself, other programs, and what is no test."""


def imported(path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def test_every_test_is_behind_a_door():
    doors = {path.parent.name.strip("_") for path in (ROOT / "p3dof").glob("*/__init__.py")} | {"manipulator"}
    folders = {path.parent.name for path in TESTS.glob("*/*.py")}
    assert folders <= doors | OTHERS
    assert [path.name for path in FILES if path.parent.parent != TESTS] == []
    names = [path.name for path in FILES]
    assert len(names) == len(set(names)), "two test files of one name"


def test_no_test_is_imported():
    found = [
        f"{path.name} imports {name}"
        for path in [*FILES, *TESTS.glob("*.py")]
        for name in imported(path)
        if name.split(".")[-1].startswith("test_")
    ]
    assert found == [], "move what is shared into a helper module in tests/"


def test_every_test_file_was_measured():
    rows = set(durations.read())
    files = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in FILES}
    advice = "run .venv/bin/pytest -n 0 --measure with these files (all: make durations)"
    assert sorted(set(files) - rows) == [], advice
    gone = [
        name
        for name in sorted(rows)
        for file, _, test in [name.partition("::")]
        if f"def {test}" not in files.get(file, "")
    ]
    assert gone == [], advice


@pytest.mark.parametrize("name", ["blocks", "errors", "model_files"])
def test_a_module_below_the_doors_is_there_when_it_is_the_first_name(name):
    code = f"import p3dof; assert p3dof.{name}.__all__ or dir(p3dof.{name})"
    subprocess.run([sys.executable, "-c", code], check=True)
