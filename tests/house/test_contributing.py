"""What contributors are told is so: the map, its tables, links between pages, the environment."""

import re
import sys
from itertools import pairwise

import click
import pytest
import yaml
from documents import ROOT

from p3dof.cli import app
from p3dof.machine import description
from p3dof.methods import engines

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
DOCS = [page for page in (ROOT / "docs").rglob("*.md") if page.name not in {"contributing.md", "tests.md"}]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "tests/README.md", *DOCS]
COMMANDS = app.list_commands(click.Context(app))


def rooms(line):
    return set(re.findall(r"\w+", line.split("  ")[0]))


def test_the_map_is_that_of_the_import_rules():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (contract,) = [c for c in contracts if c.get("containers") == ["p3dof"]]
    floors = [set(re.findall(r"\w+", layer)) for layer in contract["layers"]]
    drawn = [
        rooms(line) for line in re.search(r"```text\n(cli .*?)```", CONTRIBUTING, re.DOTALL)[1].splitlines()
    ]
    assert drawn[0] == {"cli"}
    assert set.union(*drawn) == set.union(*floors) - {"__main__"}
    heights = {room: height for height, floor in enumerate(floors) for room in floor}
    for upper, lower in pairwise(drawn):
        assert max(heights[room] for room in upper) <= min(heights[room] for room in lower)


def test_every_door_has_a_page_that_names_its_rooms():
    for door in sorted(path.parent for path in (ROOT / "p3dof").glob("*/__init__.py")):
        text = (door / "README.md").read_text(encoding="utf-8")
        behind = {path.parent.name for path in door.glob("*/__init__.py")} - {"generated"}
        assert behind <= set(re.findall(r"`(\w+)/", text)), door
        for name in re.findall(r"`([\w/]+\.py)`", text):
            assert (door / name).is_file(), (door, name)


def test_equation_17_is_where_the_map_says():
    found = [
        path.name
        for path in (ROOT / "p3dof/closed_form/paper").glob("*.py")
        if "(17)" in path.read_text("utf-8")
    ]
    assert found == ["virtual_power.py"]


def test_the_tables_that_are_named_are_there():
    assert "`FORMATS`" in CONTRIBUTING
    assert len(description.FORMATS) >= 6
    assert "`ENGINES`" in CONTRIBUTING
    assert len(engines.ENGINES) >= 3
    assert "`COMMANDS`" in CONTRIBUTING
    assert len(COMMANDS) >= 10
    folders = re.findall(r"`(p3dof/[\w/]+/|tests/[\w/.]+|p3dof/[\w/.]+\.pyi?)`", CONTRIBUTING)
    assert len(folders) >= 8
    for folder in folders:
        assert (ROOT / folder).exists(), folder
    sources = [
        f"/{path.relative_to(ROOT)}" for room in ("p3dof", "tests") for path in (ROOT / room).rglob("*.py")
    ]
    for name in re.findall(r"`([\w/]+\.py)`", CONTRIBUTING):
        assert any(path.endswith(f"/{name}") for path in sources), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_between_pages(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        path = link.partition("#")[0]
        if "://" in link or not path or path.startswith("p3dof."):
            continue  # the web, this page, a public name
        target = page.parent / path
        made = path.endswith(".ipynb") and (ROOT / "notebooks" / target.name).exists()
        made = (
            made or target.resolve() == ROOT / "docs/contributing.md"
        )  # of CONTRIBUTING.md, when docs are built
        assert made or target.exists(), f"{page}: {link}"


def test_every_variable_of_the_environment_is_described():
    used, at_build = set(), set()
    for path in [*(ROOT / "p3dof").rglob("*.py"), ROOT / "setup.py"]:
        text = path.read_text(encoding="utf-8")
        names = re.findall(r'environ(?:\.get\(|\[)"(\w+)"', text)
        (at_build if path.name == "setup.py" else used).update(names)
    page = (ROOT / "docs/reference/environment.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w+)`", page, re.MULTILINE)) == used - {"PATH"}
    assert {"P3DOF_THREADS", "P3DOF_LEVEL", "CC", "CHROMIUM"} <= used
    assert at_build == {"P3DOF_NO_EXTENSION", "P3DOF_BUILD_LEVELS"}
    assert all(f"`{name}" in page for name in at_build)


def test_misspelt_and_american_words_are_found_but_not_in_code(tmp_path, capfd):
    pytest.importorskip("codespell_lib", reason="codespell is not installed")
    from spelling import CODE, american, misspelt

    page = tmp_path / "page.md"
    wrong = ("behav" + "ior", "t" + "eh", "center")
    page.write_text(f"{' '.join(wrong)}\n`center`\n```python\ncolor\n```\n", encoding="utf-8")
    assert misspelt([str(page)], american(), "--ignore-multiline-regex", CODE)
    lines = capfd.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines] == [*wrong]
    assert "tests/spelling.py" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_hooks_and_forms_are_valid():
    for path in (ROOT / ".pre-commit-config.yaml", *(ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml")):
        assert yaml.safe_load(path.read_text(encoding="utf-8"))


def test_commands_that_pages_name_exist():
    for page in PAGES:
        for name in re.findall(r"`p3dof ([a-z]+)", page.read_text(encoding="utf-8")):
            assert name in COMMANDS, f"{page}: p3dof {name}"


def test_make_says_what_there_is():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = " ".join(re.findall(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)).split()
    for target in targets:
        assert re.search(rf"^{target}:.* ## \w", makefile, re.MULTILINE), target


def test_what_users_read_names_no_private_module():
    pages = [path for path in DOCS if "decisions" not in path.parts] + [ROOT / "README.md"]
    for path in [*pages, *(ROOT / "notebooks").glob("*.ipynb")]:
        assert "p3dof._" not in path.read_text(encoding="utf-8"), path


def test_what_c_says_of_modules_is_there():
    for path in [
        *(ROOT / "p3dof").rglob("*.h"),
        *(ROOT / "p3dof").rglob("*.c"),
        *(ROOT / "p3dof").rglob("*.in"),
    ]:
        for name in re.findall(r"\bp3dof((?:\.[a-z]\w*)+)", path.read_text(encoding="utf-8")):
            parts = name[1:].split(".")
            ends = [(ROOT / "p3dof").joinpath(*parts[:count]) for count in (len(parts), len(parts) - 1)]
            assert any(end.is_dir() or end.with_suffix(".py").is_file() for end in ends), (path.name, name)
