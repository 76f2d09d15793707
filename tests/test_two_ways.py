"""What the two ways to the forces share, by a trace of both: parameters, motion, and who asks and tells."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

import p3dof

SHARED = {
    "p3dof._base.checks",  # arguments
    "p3dof._base.samples",  # which samples are told as invalid, in words
    "p3dof.machine.motion.states",
    "p3dof.machine.motion.wrenches",
    "p3dof.machine.parameters.actuators",
    "p3dof.machine.parameters.friction",
    "p3dof.manipulator",
    "p3dof.methods.crossings",  # remarks on samples between which a way is closed
    "p3dof.methods.evidence",  # whose evidence is kept
    "p3dof.methods.registry",
    "p3dof.methods.results",
    "p3dof.methods.solution",
}
"""All modules of ours that the forces pass on both ways: none of them knows the mechanism's equations."""

MACHINE = replace(
    p3dof.PAPER,
    friction=p3dof.Friction(viscous={"slide_a": 20.0}, coulomb={"slide_b": 3.0}),
    actuators=p3dof.Actuators(armature={"slide_a": 5.0}, counterbalance={"slide_c": 10.0}),
)


def passed(call):
    """The modules of ours in which functions run, once everything is imported."""
    call()
    found = set()

    def note(frame, event, _):
        if event == "call":
            found.add(frame.f_globals.get("__name__", ""))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(before)
    return {name for name in found if name.startswith("p3dof.")}


def test_the_two_ways_share_no_dynamics():
    robot, motion = p3dof.load(MACHINE), p3dof.paper_motion(21)
    wrench = np.array([0.0, 3.0, -2.0, 0.5, 0.0, 0.0])
    ways = {
        method: passed(lambda method=method: robot.inverse_dynamics(motion, wrench=wrench, method=method))
        for method in ("pinocchio", "virtual-power")
    }
    assert ways["pinocchio"] & ways["virtual-power"] == SHARED
    assert any(name.startswith("p3dof.loops.") for name in ways["pinocchio"])
    assert any(name.startswith("p3dof.closed_form.paper.") for name in ways["virtual-power"])
    assert not any(name.startswith("p3dof.closed_form.") for name in ways["pinocchio"])
    assert not any(
        name.startswith(("p3dof.loops.", "p3dof.machine.description")) for name in ways["virtual-power"]
    )
