"""What a release says of itself agrees: version, changelog, citation, tag; workflows run the Makefile."""

from __future__ import annotations

import re
import subprocess
import sys
from datetime import date
from importlib.metadata import version

import pytest
import yaml
from documents import ROOT

import p3dof

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
CHANGELOG = (ROOT / "CHANGELOG.md").read_text("utf-8")
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))


def releases():
    return re.findall(r"^## \[(.+?)\](?: - (\S+))?$", CHANGELOG, re.MULTILINE)


def tags():
    """The tags of this commit; none outside of a repository."""
    call = ["git", "tag", "--points-at", "HEAD"]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.split() if done.returncode == 0 else []


def test_one_version_is_everywhere():
    assert version("p3dof") == p3dof.__version__ == PROJECT["version"] == CITATION["version"]
    assert CITATION["license"] == PROJECT["license"].split(" AND ")[0]  # pages hold other works
    (first, none), (last, day), *_ = releases()
    assert (first, none, last) == ("Unreleased", "", PROJECT["version"])
    assert day == "unreleased" or date.fromisoformat(day) <= date.today()
    assert str(CITATION.get("date-released", "unreleased")) == day


def test_a_tag_is_that_of_the_version_and_dated():
    found = [tag for tag in tags() if tag.startswith("v")]
    assert set(found) <= {f"v{PROJECT['version']}"}
    if found:
        assert releases()[1][1] != "unreleased"


def test_each_release_has_each_kind_of_entry_once_and_in_order():
    kinds = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"]
    for part in re.split(r"^## ", CHANGELOG, flags=re.MULTILINE)[1:]:
        found = re.findall(r"^### (.+)$", part, re.MULTILINE)
        assert found == [kind for kind in kinds if kind in found]


def steps(path):
    for job in yaml.safe_load(path.read_text("utf-8"))["jobs"].values():
        yield from job["steps"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_run_targets_of_the_makefile(path):
    for step in steps(path):
        assert set(step) & {"run", "uses"}
        if "run" in step:
            command, *targets = step["run"].split()
            assert command == "make"
            assert set(targets) <= TARGETS
        else:
            assert re.fullmatch(r"[\w-]+/[\w-]+@[\w./]+", step["uses"])


def test_the_pythons_of_the_tests_begin_with_the_lowest():
    jobs = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text("utf-8"))["jobs"]
    pythons = jobs["tests"]["strategy"]["matrix"]["python"]
    assert PROJECT["requires-python"] == f">={pythons[0]}"
    assert pythons == [f"3.{minor}" for minor in range(10, 10 + len(pythons))]
    assert jobs["lowest"]["steps"][1]["with"]["python-version"] == pythons[0]


def test_only_the_job_that_publishes_may_ask_for_an_identity():
    jobs = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text("utf-8"))["jobs"]
    asked = [name for name, job in jobs.items() if "id-token" in job.get("permissions", {})]
    assert asked == ["publish"]
    assert {"source", "wheels"} == set(jobs["publish"]["needs"])


def test_the_recipe_for_conda_asks_for_what_the_project_does():
    """`make conda` has rattler-build read it."""
    recipe = yaml.safe_load((ROOT / ".github/conda/recipe.yaml").read_text("utf-8"))
    assert recipe["context"]["version"] == PROJECT["version"]
    assert recipe["about"]["license"] == PROJECT["license"]
    assert recipe["about"]["license_file"] == PROJECT["license-files"]
    assert recipe["about"]["summary"] == PROJECT["description"]
    needs = PROJECT["dependencies"]
    asked = {re.sub(r"^pin>", "pinocchio>", one).split(";")[0].lower() for one in needs}
    run = recipe["requirements"]["run"]
    elsewhere = [one for one in run if isinstance(one, dict)]
    assert [one["if"] for one in elsewhere] == ["not win"]
    assert [one.split(";")[1].strip() for one in needs if ";" in one] == ["sys_platform != 'win32'"]
    found = [*(one for one in run if isinstance(one, str)), elsewhere[0]["then"]]
    assert found[0] == "python >=${{ python_min }}"
    assert PROJECT["requires-python"] == f">={recipe['context']['python_min']}"
    assert {one.replace(" ", "") for one in found[1:]} == asked


def test_the_page_of_the_installation_names_every_extra():
    page = (ROOT / "docs/how-to/install.md").read_text("utf-8")
    named = re.findall(r"^\| `([\w-]+)` \|", page, re.MULTILINE)
    assert sorted(named) == sorted(PROJECT["optional-dependencies"])
