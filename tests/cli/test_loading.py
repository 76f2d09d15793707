"""What a call loads and passes: what it needs, and a command for any robot nothing of the machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import closed_loop_robots as robots
import numpy as np
import pytest

MACHINE = ("machine", "closed_form", "methods", "manipulator", "analysis", "design", "report")
"""Doors behind which the machine is known."""

CALLS = {  # the most modules of ours that are loaded, and passed by a second call
    "p3dof.load()": (73, 4),
    "p3dof.load().forces([0] * 3, [0] * 3, [0] * 3, method='compiled')": (74, 15),
    "p3dof.load().forces([0] * 3, [0] * 3, [0] * 3)": (136, 34),
    "p3dof.ClosedLoopModel": (60, 0),
    "p3dof --help": (5, 1),
    "p3dof loop --help": (6, 1),
    "p3dof loop info R": (81, 22),
    "p3dof loop forces R --motion M": (105, 35),
    "p3dof loop simulate R --motion M --controller pd": (104, 67),
    "p3dof loop simulate R --duration .1 --samples 9 --figure F.png": (108, 62),
    "p3dof loop codegen R --out C": (92, 53),
    "p3dof loop export R --out R.xml": (88, 26),
    "p3dof loop show R --out R.html": (131, 57),
    "p3dof forces --samples 11": (157, 65),
    "p3dof compare --samples 11 --no-plot --out O": (159, 71),
}

ALIKE = ("compare", "loop codegen", "loop export", "R --motion M --", "* 3)")
"""Calls that load what another one loads too, and little more: they are slow."""

SCRIPT = """
import json, shlex, sys
call = sys.argv[1]
import p3dof
if call.startswith("p3dof."):
    def work(): return eval(call)
else:
    from p3dof.cli import main
    def work(): main(shlex.split(call)[1:])
work()
loaded = sorted(name for name in sys.modules if name.partition(".")[0] == "p3dof")
passed = set()
def note(frame, event, _):
    if event == "call":
        passed.add(frame.f_globals.get("__name__", ""))
sys.setprofile(note)
work()
sys.setprofile(None)
sys.stderr.write(json.dumps([loaded, sorted(name for name in passed if name.startswith("p3dof"))]))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A five-bar, and a motion of its motors."""
    path, time = tmp_path_factory.mktemp("loading"), np.linspace(0, 1, 21)
    (path / "R").write_text(robots.five_bar())
    (path / "R.yaml").write_text(robots.FIVE_BAR_SIDECAR.to_yaml())
    rows = np.column_stack([time, 1.9 + 0.1 * np.cos(3 * time), 1.2 + 0.1 * np.sin(3 * time)])
    header = "t,left_joint,right_joint"
    np.savetxt(path / "M", rows, delimiter=",", header=header, comments="")
    return path


@pytest.mark.parametrize(
    "call", [pytest.param(call, marks=[pytest.mark.slow] * any(map(call.count, ALIKE))) for call in CALLS]
)
def test_a_call_loads_and_passes_what_it_needs(folder, call):
    if "--figure" in call:
        pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, call],
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
    )
    assert "p3dof: error" not in done.stderr, done.stderr
    loaded, passed = json.loads(done.stderr.splitlines()[-1])
    sys.stdout.write(f"{call:50} {len(loaded):4} loaded {len(passed):4} passed\n")
    if " loop " in call or call == "p3dof.ClosedLoopModel":
        drawing = "p3dof.report" if "--figure" in call else "none"
        machine = [name for name in loaded if f"{name}.".split(".")[1] in MACHINE]
        assert [name for name in machine if not name.startswith(drawing)] == []
    most = CALLS[call]
    assert len(loaded) <= most[0], loaded
    assert len(passed) <= most[1], passed
