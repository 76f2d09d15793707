"""What guards the checks themselves: skips that are not allowed, seeds of the long random search."""

import ast
import os
import re
import subprocess
import sys

import mutants
import pytest
from documents import ROOT
from lowest import lowest, read_project
from other_robots import collection

TESTS = ROOT / "tests"
SKIPPED = {
    "module": "import pytest\npytest.importorskip('tool_1')\ndef test_it(): pass\n",
    "test": "import pytest\ndef test_it(): pytest.importorskip('tool_2')\n",
    "mark": "import pytest\n@pytest.mark.skipif(True, reason='tool_3')\ndef test_it(): pass\n",
    "fixture": "import pytest\n@pytest.fixture\ndef tool(): pytest.skip('tool_4')\ndef test_it(tool): pass\n",
}
ALLOWED = (
    "import pytest\n@pytest.mark.skipif(True, reason='root may write everywhere')\ndef test_it(): pass\n"
)


def run_pytest(folder, *arguments, **variables):
    environment = {**os.environ, "PYTHONPATH": str(TESTS), "P3DOF_REQUIRE": "", **variables}
    plugins = [
        word for name in ("conftest", "no:cacheprovider", "no:nbmake", "no:xdist") for word in ("-p", name)
    ]
    command = [
        sys.executable,
        "-m",
        "pytest",
        *plugins,
        "--continue-on-collection-errors",
        "--rootdir",
        folder,
    ]
    options = {"cwd": folder, "env": environment, "capture_output": True, "text": True}
    ran = subprocess.run([*command, *arguments, folder], check=False, **options)
    return ran.returncode, ran.stdout + ran.stderr


def test_a_tool_that_is_required_is_not_skipped(tmp_path):
    for name, text in SKIPPED.items():
        (tmp_path / f"test_{name}.py").write_text(text)
    (tmp_path / "test_allowed.py").write_text(ALLOWED + "def test_other(): pass\n")
    code, out = run_pytest(tmp_path)
    assert code == 0
    assert "1 passed, 5 skipped" in out
    code, out = run_pytest(tmp_path, P3DOF_REQUIRE="all")
    assert code == 1
    missing = re.findall(r"P3DOF_REQUIRE=all, but something is missing: .*(tool_\d)", out)
    assert set(missing) == {"tool_1", "tool_2", "tool_3", "tool_4"}
    assert "1 failed, 1 passed, 1 skipped, 3 errors" in out  # skips of modules and fixtures are errors


def test_the_checks_require_every_tool_and_try_every_level():
    text = (ROOT / ".ci" / "run").read_text()
    assert "\nmake test EXTRAS=all P3DOF_REQUIRE=all\nmake slow EXTRAS=all P3DOF_REQUIRE=all\n" in text
    assert "\nmake levels\n" in text
    make = ["make", "-n", "DEV=", "levels"]
    told = subprocess.run(make, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    files = set(re.findall(r"tests/\w+/test_\w+\.py", told))
    assert len(files) > 15
    assert all((ROOT / file).is_file() for file in files)
    assert "P3DOF_LEVEL=$level OPENBLAS_CORETYPE=$core" in told


def test_robots_from_outside_are_more_cases_and_missing_only_if_they_are_named(tmp_path):
    assert collection(None, tmp_path) == collection(str(tmp_path), tmp_path / "none") == tmp_path
    assert collection(None, tmp_path / "none") is None
    with pytest.raises(FileNotFoundError, match="P3DOF_ROBOTS: expected the folder"):
        collection(str(tmp_path / "none"), tmp_path)


def test_seeds_of_the_search_are_fresh_or_repeated(tmp_path):
    """The same seed draws the same numbers, another one others."""
    (tmp_path / "test_draw.py").write_text(
        "from hypothesis import given, settings, strategies as st\n"
        "@settings(max_examples=20)\n@given(st.integers(0, 2**32))\n"
        "def test_it(n): print('drew', n)\n"
    )

    def drawn(seed):
        fuzz = "-s", "-m", "fuzz or hypothesis", "--hypothesis-profile=fuzz", f"--hypothesis-seed={seed}"
        code, out = run_pytest(tmp_path, *fuzz)
        assert code == 0
        return re.findall(r"drew (\d+)", out)

    one, again, other = map(drawn, (1, 1, 2))
    assert len(one) == 20
    assert one == again != other


def test_make_prints_the_seed_that_repeats_it():
    def said(*arguments):
        return subprocess.run(
            ["make", "--no-print-directory", "-n", "fuzz", *arguments],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip

    fresh = re.findall(r"--hypothesis-seed=(\d+)", said() + said())
    assert len(set(fresh)) == 2
    out = said("SEED=123")
    assert "repeat with: make fuzz SEED=123" in out
    assert "--hypothesis-seed=123 " in out


def test_lowest_versions_are_those_that_are_declared():
    project = {
        "name": "it",
        "dependencies": ["one>=1.2,<5", "two~=2.0"],
        "optional-dependencies": {
            "a": ["it[b]", "three>=3; python_version >= '3.11'"],
            "b": ["four==4", "one>=1.2,<5"],
            "c": ["five<6"],
        },
    }
    pins = ["four==4", "one==1.2", 'three==3; python_version >= "3.11"', "two==2.0"]
    assert lowest(project, ["a"]) == pins
    assert lowest(project, []) == ["one==1.2", "two==2.0"]
    with pytest.raises(SystemExit, match="five<6: expected one lower bound"):
        lowest(project, ["c"])
    own = read_project()
    assert len(lowest(own, list(own["optional-dependencies"]))) > 30


def test_a_mutant_is_one_change_and_tells_its_place(tmp_path, monkeypatch):
    text = (
        'def f(x: int = 1) -> float:\n    """A word of 3."""\n'
        "    if x < 2:\n        raise ValueError(f'{x - 1} is 5')\n    return -x + h(y=sin(x))\n"
    )
    (tmp_path / "m.py").write_text(text)
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    found = mutants.mutants_of("m.py")
    trees = [ast.unparse(mutants.mutated(mutant)) for mutant in found]
    assert len({text, *trees}) == len(found) + 1
    for change in (
        "x: int=2",
        "x >= 2",
        "x < 3",
        "return 0 * (-x + ",
        "return -x - h",
        "return x + h",
        "y=0 * sin(x)",
    ):
        assert sum(change in tree for tree in trees) == 1, change
    assert all("{x - 1} is 5" in tree and "A word of 3." in tree for tree in trees)
    assert {mutant.line for mutant in found} == {1, 3, 5}
