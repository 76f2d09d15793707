"""Each rule of who may import whom, broken on purpose: a rule that cannot break is none."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from documents import ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LINTER = shutil.which("lint-imports", path=str(Path(sys.executable).parent))
pytestmark = pytest.mark.skipif(LINTER is None, reason="import-linter is not installed")

BREAKS = {
    "Each door imports only downward": ("_base/checks.py", "import p3dof.machine.motion"),
    "Each room of the machine imports only downward": (
        "machine/parameters/machine.py",
        "import p3dof.machine.motion.core",
    ),
    "Each room of the closed form imports only downward": (
        "closed_form/paper/formulas.py",
        "import p3dof.closed_form.kinematics.inverse",
    ),
    "Each room of the analysis imports only downward": (
        "analysis/energy/__init__.py",
        "import p3dof.analysis.load_friction",
    ),
    "Each room of the design imports only downward": (
        "design/drives/__init__.py",
        "import p3dof.design.optimisation",
    ),
    "Each room of the viewer imports only downward": ("viewer/session.py", "import p3dof.viewer.showing"),
    "Each room of the base imports only downward": ("_base/errors.py", "import p3dof._base.checks"),
    "The paper's way knows neither Pinocchio nor the description": (
        "closed_form/paper/formulas.py",
        "import pinocchio",
    ),
    "The Pinocchio way knows no closed form of the mechanism": (
        "methods/pinocchio.py",
        "from p3dof.closed_form.kinematics import singularity",
    ),
    "The ways to the forces do not know each other": (
        "methods/closed_form.py",
        "from p3dof.methods.compiled import sliders",
    ),
    "The closed-loop layer knows nothing of this mechanism": (
        "loops/forward.py",
        "from p3dof.machine.parameters import PAPER",
    ),
    "What integrates runs knows no particular mechanism": (
        "runs/integration.py",
        "from p3dof.machine.parameters import PAPER",
    ),
    "Commands for any robot know nothing of this mechanism": (
        "cli/loop/robot.py",
        "from p3dof.machine.parameters import PAPER",
    ),
    "What draws any robot knows no particular mechanism": (
        "viewer/stage.py",
        "from p3dof.machine.parameters import PAPER",
    ),
    "The engines share no dynamics with the methods": (
        "methods/engines/driven.py",
        "from p3dof.closed_form.paper.virtual_power import actuator_forces",
    ),
    "Heavy optional libraries are imported by what shows things only": (
        "closed_form/kinematics/inverse.py",
        "import matplotlib",
    ),
    "No cycles": ("closed_form/paper/formulas.py", "from p3dof.closed_form.paper.recursion import frames"),
}
"""Of each rule: a module, and what it must not import."""

SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
CONTRACTS = [contract["name"] for contract in SETTINGS["contracts"]]


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """Return a copy of the package that may be broken."""
    top = tmp_path_factory.mktemp("contracts")
    shutil.copy(ROOT / "pyproject.toml", top)
    shutil.copytree(
        ROOT / "p3dof", top / "p3dof", ignore=lambda _, names: [n for n in names if n == "__pycache__"]
    )
    return top


def broken(top):
    """Return the names of the rules that import-linter finds broken."""
    environment = {**os.environ, "PYTHONPATH": str(top), "COLUMNS": "200"}
    run = subprocess.run(
        [LINTER, "--no-cache"], cwd=top, env=environment, capture_output=True, text=True, check=False
    )
    states = {
        name: word for name in CONTRACTS for word in ("KEPT", "BROKEN") if f"{name} {word}" in run.stdout
    }
    assert set(states) == set(CONTRACTS), run.stdout + run.stderr
    found = {name for name, word in states.items() if word == "BROKEN"}
    assert bool(found) == bool(run.returncode)
    return found


def test_no_rule_is_broken(copy):
    assert broken(copy) == set()


def test_every_rule_is_broken_below():
    assert list(BREAKS) == CONTRACTS


@pytest.mark.parametrize("contract", CONTRACTS)
def test_an_import_hidden_in_a_function_breaks_the_rule(contract, copy):
    module, line = BREAKS[contract]
    path = copy / "p3dof" / module
    before = path.read_text(encoding="utf-8")
    path.write_text(f"{before}\n\ndef _hidden():\n    {line}\n", encoding="utf-8")
    try:
        assert contract in broken(copy)
    finally:
        path.write_text(before, encoding="utf-8")
