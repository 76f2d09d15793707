"""What the pages of the documentation say runs, and what they point to is there."""

import shutil
import subprocess

import numpy as np
import pytest
from documents import ROOT, blocks, commands, run

import p3dof

DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "generated" not in path.parts)
RUN = [page for page in PAGES if commands(page) or any(block.language == "python" for block in blocks(page))]


def need_tools(page, *tools):
    """Skip a page whose commands need what is not here."""
    if any("--wasm" in command for command in commands(page)):
        tools += ("clang", "wasm-ld")
    for tool in tools:
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} not installed")


def name(page):
    return str(page.relative_to(DOCS))


@pytest.mark.parametrize("page", RUN, ids=name)
def test_what_a_page_says_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    need_tools(page)
    run(page, tmp_path)


def test_pages_are_run():
    assert {"index.md", "how-to/your-own-machine.md", "how-to/motion-files.md"} <= set(map(name, RUN))
    assert sum(len(commands(page)) for page in RUN) >= 10


def test_the_parameter_file_is_one(tmp_path):
    """The complete example is the paper's machine, with an inertia about the joint as the paper prints it."""
    (text,) = (
        block.text for block in blocks(DOCS / "how-to/your-own-machine.md") if block.language == "yaml"
    )
    (tmp_path / "machine.yaml").write_text(text, encoding="utf-8")
    parameters = p3dof.read_parameters(tmp_path / "machine.yaml")
    assert parameters.geometry == p3dof.PAPER.geometry
    expected = p3dof.PAPER.bodies.leg_a.inertia
    np.testing.assert_allclose(parameters.bodies.leg_a.inertia, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("page", "folder"),
    [("how-to/controller-in-c.md", "out/c"), ("how-to/compile-any-robot.md", "out/five_bar")],
)
def test_the_c_of_a_controller_compiles(tmp_path, monkeypatch, page, folder):
    monkeypatch.chdir(tmp_path)
    page = DOCS / page
    need_tools(page, "cc")
    run(page, tmp_path)
    (text,) = (block.text for block in blocks(page) if block.language == "c")
    includes, body = text.split("\n\n", 1)
    source = f"{includes}\nvoid stop(void);\nvoid period(void);\nvoid period(void)\n{{\n{body}}}\n"
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"-I{folder}", "-xc", "-"]
    # In the text the state has no values yet: that it is read is all that the compiler may find.
    command.insert(4, "-Wno-maybe-uninitialized")
    done = subprocess.run(command, input=source, text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", ["how-to/controller-in-c.md", "how-to/compile-any-robot.md"])
def test_the_javascript_of_a_page_runs(tmp_path, monkeypatch, page):
    monkeypatch.chdir(tmp_path)
    page = DOCS / page
    need_tools(page, "node")
    run(page, tmp_path)
    (text,) = (block.text for block in blocks(page) if block.language == "js")
    (tmp_path / "page.mjs").write_text(text, encoding="utf-8")
    done = subprocess.run(["node", "page.mjs"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("OK") == text.count("statuses[")
    assert "NaN" not in done.stdout


def test_blocks_that_are_not_run_are_few():
    """Of the pages' languages, only these hold something that no test runs."""
    languages = {block.language for page in PAGES for block in blocks(page)}
    assert languages <= {"python", "console", "yaml", "text", "c", "js"}
