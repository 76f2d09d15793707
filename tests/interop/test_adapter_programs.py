"""The adapters of docs/examples as programs: each runs by itself and says what it found."""

import re
import subprocess
import sys

import pytest
from documents import ROOT

PROGRAMS = {
    "casadi_robot": "casadi",
    "casadi_swing_up": "casadi",
    "crocoddyl_pick": "crocoddyl",
    "crocoddyl_robot": "crocoddyl",
    "crocoddyl_swing_up": "crocoddyl",
    "jax_forces": "jax",
    "mink_closures": "mink",
    "pink_closures": "pink",
    "torch_forces": "torch",
}
QUICK = "pink_closures"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == QUICK else pytest.mark.slow) for name in PROGRAMS]
)
def test_a_program_runs_anywhere_and_prints_numbers(name, tmp_path):
    pytest.importorskip(
        PROGRAMS[name], reason=f"{PROGRAMS[name]} not installed: pip install 'p3dof[adapters]'"
    )
    command = [sys.executable, ROOT / f"docs/examples/{name}.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d\.\d", done.stdout)
    assert "nan" not in done.stdout.lower()
