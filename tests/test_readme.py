"""What the README says runs: every Python block in one session, every p3dof command in a new folder."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from p3dof import engines
from p3dof.cli import main
from p3dof.parameters import PAPER
from p3dof.parameters.serialization import parse

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^\$ \.venv/bin/p3dof ([^#\n]*)", README, re.MULTILINE)
SNIPPETS = re.findall(r'^\$ \.venv/bin/python -c "([^\n]*)"$', README, re.MULTILINE)


def test_python_blocks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    session = {}
    for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL):
        exec(compile(block, "README.md", "exec"), session)  # noqa: S102 - our own text
    assert session["result"].tau.shape == (1,)
    assert np.isfinite(session["result"].lambda_).all()


def test_the_parameter_file_is_one():
    (text,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    parameters = parse(text, "README.md")
    assert parameters.geometry == PAPER.geometry
    np.testing.assert_allclose(
        parameters.bodies.leg_a.inertia, PAPER.bodies.leg_a.inertia, rtol=1e-12, atol=1e-12
    )


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A folder with the committed files that the commands read."""
    folder = tmp_path_factory.mktemp("clone")
    shutil.copytree(ROOT / "urdf", folder / "urdf")
    return folder


def test_commands_are_found():
    assert len(COMMANDS) >= 6
    assert len(SNIPPETS) == 1


def test_commands(clone, monkeypatch, capsys):
    monkeypatch.chdir(clone)
    Path("out").mkdir()
    for snippet in SNIPPETS:
        exec(snippet, {})  # noqa: S102 - our own text
    for command in COMMANDS:
        if "--engines" in command and not all(map(engines.available, engines.ENGINES)):
            continue
        assert main(shlex.split(command)) == 0, command
    assert "the methods agree" in capsys.readouterr().out
    assert Path("out/forces.png").exists()
