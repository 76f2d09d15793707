"""Reactions of elastic joints against Exudyn: rigid bodies between its springs, stiffer and stiffer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_forces import S1, Bookkeeping, components, motion_of, transmitted
from lagrange import BODIES
from machines import random_machine, random_states

import p3dof
from p3dof.machine.motion import paper_motion
from p3dof.machine.parameters import PAPER, Body

STIFFER = (1.0, 2.0, 4.0, 8.0)
"""All stiffnesses times that: what is left of large displacements halves with each, to first order."""


class Model:
    """The machine at one sample in Exudyn, with d'Alembert's loads; it shares numbers and poses only.

    Bodies stand with their frames along the fixed axes, which a static solution does not mind.
    """

    def __init__(self, parameters, book, i, stiffness, stiffer):
        reason = "exudyn not installed: pip install 'p3dof[engines]'"
        exudyn = pytest.importorskip("exudyn", reason=reason)
        items = pytest.importorskip("exudyn.itemInterface", reason=reason)
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        self.exudyn, self.stiffer = exudyn, stiffer
        self.bodies, centre = {"base_link": self.system.AddObject(items.ObjectGround())}, {}
        for name in BODIES:
            centre[name] = book.centre[name][i]
            node = self.system.AddNode(
                items.NodeRigidBodyRxyz(referenceCoordinates=[*centre[name], 0.0, 0.0, 0.0])
            )
            self.bodies[name] = self.system.AddObject(
                items.ObjectRigidBody(mass=1.0, inertia=[1.0, 1.0, 1.0, 0.0, 0.0, 0.0], nodeNumber=node)
            )
            marker = self.system.AddMarker(items.MarkerBodyRigid(bodyNumber=self.bodies[name]))
            force, moment = (-part[i] for part in book.needs[name])
            self.system.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=force))
            self.system.AddLoad(items.LoadTorqueVector(markerNumber=marker, loadVector=moment))
        self.joints = []
        for joint, compliance in zip(book.ends, stiffness.compliances(parameters), strict=True):
            one, other, rotation, position = book.ends[joint]
            R, C = rotation[i], compliance.own
            if compliance.before is not None:
                turn = np.kron(np.eye(2), book.moving[one].rotation[i].T @ R)
                C = C + turn.T @ compliance.before @ turn
            across = np.array(transmitted(joint, "paper", R.T @ book.moving["platform"].rotation[i][:, 1])).T
            K = stiffer * across @ np.linalg.solve(across.T @ C @ across, across.T)
            markers = []
            for name in (one, other):
                place = np.eye(4)
                place[:3, :3], place[:3, 3] = R, position[i] - centre.get(name, np.zeros(3))
                markers.append(
                    self.system.AddMarker(items.MarkerBodyRigid(bodyNumber=self.bodies[name], localHT=place))
                )
            self.joints.append(
                self.system.AddObject(
                    items.ObjectConnectorRigidBodySpringDamper(markerNumbers=markers, stiffness=(K + K.T) / 2)
                )
            )
        self.system.Assemble()

    def wrenches(self):
        """What predecessors exert on successors, in the joints' axes, (13, 6)."""
        given = self.exudyn.SimulationSettings()
        given.solution.file.write = False
        static = given.staticSolver
        static.verboseMode = 0
        static.adaptiveStep = False
        static.newton.absoluteTolerance = 3e-8 * self.stiffer
        static.newton.relativeTolerance = 0.0
        self.system.SolveStatic(given)
        what = self.exudyn.OutputVariableType
        read = self.system.GetObjectOutput
        return -np.array(
            [np.append(read(one, what.ForceLocal), read(one, what.TorqueLocal)) for one in self.joints]
        )


def extrapolated(values):
    """What rows come to for infinite stiffness: Neville's polynomials in its inverse."""
    rows, h = list(values), 1 / np.array(STIFFER)
    for order in range(1, len(rows)):
        rows = [
            (h[k] * rows[k + 1] - h[k + order] * rows[k]) / (h[k] - h[k + order])
            for k in range(len(rows) - 1)
        ]
    return rows[0]


def check(parameters, motion, stiffness, wrench, tolerance, stiffest=1.0):
    result = p3dof.load(parameters).reactions(motion, "elastic", wrench=wrench, stiffness=stiffness)
    book = Bookkeeping(parameters, motion, wrench)
    expected = components(result)
    assert np.isfinite(expected).all()
    for i in range(len(motion)):
        found = [Model(parameters, book, i, stiffness, stiffest * stiffer).wrenches() for stiffer in STIFFER]
        assert np.abs(found[0]).max() > 1
        np.testing.assert_allclose(extrapolated(found), expected[i], rtol=0, atol=tolerance)
        first, last = (np.abs(one - expected[i]).max() for one in (found[0], found[-1]))
        assert last < 0.2 * first  # so that what was extrapolated is the size of the displacements
    return expected


def test_exudyn_has_the_reactions_of_the_papers_machine():
    motion = paper_motion(3)
    found = check(PAPER, motion, S1, np.zeros((3, 6)), 1e-5)
    left = found[:, 6, 0]
    np.testing.assert_allclose(left, [-35.15115, 2.66161, -139.09358], atol=1e-5)


def test_exudyn_has_the_reactions_of_rigid_rods_a_payload_and_a_load():
    machine = PAPER.carrying(Body(2.0, np.array([0.02, 0.01, -0.06]), np.diag([0.01, 0.02, 0.015])))
    wrench = np.tile([5.0, -20.0, 30.0, 1.0, -0.5, 2.0], (2, 1))
    check(machine, paper_motion(2), replace(S1, rods=None), wrench, 1e-4)


@pytest.mark.parametrize("seed", [0, 2, 6, 7])
def test_exudyn_has_the_reactions_of_other_machines(seed):
    """Large ones with large loads: their joints are stiffer, so that their poses hardly change."""
    parameters = random_machine(seed)
    states = random_states(parameters, seed, 1)
    check(parameters, motion_of(states), S1, states.wrench, 1e-4, stiffest=100.0)
