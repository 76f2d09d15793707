"""Adapters to other libraries, docs/examples: short, shown, tested, and none of the package's business."""

import ast
import re

import pytest
from documents import ROOT
from lowest import read_project

EXAMPLES = sorted(path for path in (ROOT / "docs/examples").iterdir() if path.suffix in (".py", ".c"))
PROGRAMS = [path for path in EXAMPLES if path.suffix == ".py"]
LONGEST = 60
PAGES = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))


def imported(path):
    """Return the first parts of all names that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return found


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_an_example_is_short_and_shown_whole(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= LONGEST
    assert f"{{literalinclude}} ../examples/{path.name}\n" in PAGES
    if path.suffix == ".py":
        assert ast.get_docstring(ast.parse(text))
        assert text.count('\nif __name__ == "__main__":\n') == 1


def test_every_example_has_a_test_that_imports_it():
    used = set().union(*map(imported, (ROOT / "tests").rglob("test_*.py")))
    assert [path.name for path in PROGRAMS if path.stem not in used] == []


def test_the_package_imports_no_example():
    names = {path.stem for path in PROGRAMS}
    assert [path for path in (ROOT / "p3dof").rglob("*.py") if names & imported(path)] == []


def test_what_adapters_serve_is_pinned():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {line.partition("==")[0].lower() for line in lines}
    extras = read_project()["optional-dependencies"]
    names = {re.match(r"[\w.-]+", one).group().lower() for one in (*extras["adapters"], *extras["torch"])}
    assert names - {"p3dof"} <= pinned
