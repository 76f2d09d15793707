"""What the two ways to the forces share, by a trace of both: parameters, motion, and who asks and tells."""

from __future__ import annotations

import sys
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

import p3dof

SHARED = {
    "p3dof._base.checks",  # arguments
    "p3dof._base.samples",  # which samples are told as invalid, in words
    "p3dof.machine.motion.states",
    "p3dof._base.time_series.wrenches",
    "p3dof.manipulator",
    "p3dof.methods.solution",  # remarks on samples between which a way is closed
    "p3dof.methods.results",  # whose evidence is kept
    "p3dof.methods.registry",
}
"""All modules of ours that the forces pass on both ways: none of them knows the mechanism's equations."""

MACHINE = replace(
    p3dof.PAPER,
    friction=p3dof.machine.Friction(viscous={"slide_a": 20.0}, coulomb={"slide_b": 3.0}),
    actuators=p3dof.machine.Actuators(armature={"slide_a": 5.0}, counterbalance={"slide_c": 10.0}),
)


def passed(call):
    """The functions of ours that run, by module, once everything is imported; no comprehensions."""
    call()
    found = defaultdict(set)

    def note(frame, event, _):
        name, code = frame.f_globals.get("__name__", ""), frame.f_code
        if event == "call" and name.startswith("p3dof."):
            found[name] |= set() if "<" in (code.co_name[0], code.co_filename[0]) else {code}

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(before)
    return found


def test_the_two_ways_share_no_dynamics():
    robot, motion = p3dof.load(MACHINE), p3dof.paper_motion(21)
    wrench = np.array([0.0, 3.0, -2.0, 0.5, 0.0, 0.0])
    ways = {
        method: passed(lambda method=method: robot.inverse_dynamics(motion, wrench=wrench, method=method))
        for method in ("pinocchio", "virtual-power")
    }
    assert ways["pinocchio"].keys() & ways["virtual-power"].keys() == SHARED
    assert any(name.startswith("p3dof.loops.") for name in ways["pinocchio"])
    assert any(name.startswith("p3dof.closed_form.paper.") for name in ways["virtual-power"])
    assert not any(name.startswith("p3dof.closed_form.") for name in ways["pinocchio"])
    assert not any(
        name.startswith(("p3dof.loops.", "p3dof.machine.description")) for name in ways["virtual-power"]
    )


@pytest.mark.parametrize(
    ("method", "modules", "functions"),
    [("pinocchio", 10, 40), ("virtual-power", 17, 83), ("compiled", 10, 20)],
)
def test_the_forces_of_a_motion_are_found_in_few_functions(method, modules, functions):
    robot, motion = p3dof.load(), p3dof.paper_motion(21)
    found = passed(lambda: robot.inverse_dynamics(motion, method=method))
    table = "\n".join(f"{len(codes):4d} {name}" for name, codes in found.items())
    assert len(found) <= modules, table
    assert sum(map(len, found.values())) <= functions, table
