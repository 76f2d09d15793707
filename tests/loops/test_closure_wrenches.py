"""Multipliers as forces and moments in space: they do the work that the multipliers do, for every kind."""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest

from p3dof import ClosedLoopModel, Closure, Sidecar
from p3dof._base.errors import InputError
from p3dof.loops.closures import ClosureWrenches
from p3dof.loops.sidecar import KINDS


def chain(kind):
    """Two arms of six joints each, whose ends a closure ties."""
    model, generator = pin.Model(), np.random.default_rng(7)
    for side in ("left", "right"):
        joint = 0
        for number in range(3):
            place = pin.SE3(pin.exp3(generator.normal(size=3)), 0.3 * generator.normal(size=3))
            joint = model.addJoint(joint, pin.JointModelSpherical(), place, f"{side}_{number}")
        tip = pin.SE3(pin.exp3(generator.normal(size=3)), 0.3 * generator.normal(size=3))
        model.addFrame(pin.Frame(side, joint, tip, pin.FrameType.OP_FRAME))
    length = 0.7 if kind == "distance" else None
    return ClosedLoopModel(model, Sidecar((Closure("left", "right", kind, length),), ()))


@pytest.mark.parametrize("kind", KINDS)
def test_the_wrench_does_the_work_of_the_multipliers(kind):
    loop = chain(kind)
    guess = pin.integrate(loop.model, pin.neutral(loop.model), np.linspace(-0.5, 0.5, loop.model.nv))
    q = loop.assemble(None, guess).q
    multipliers = np.random.default_rng(1).normal(size=loop.closure_jacobian(q).shape[0])
    wrench = ClosureWrenches(loop.model, loop.sidecar).at(q, multipliers)
    assert wrench.whole.all()
    data, model = loop.model.createData(), loop.model
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    place = wrench.places[0]
    np.testing.assert_allclose(place, data.oMf[model.getFrameId("right")].translation, rtol=0, atol=1e-12)
    work = np.zeros(model.nv)
    for sign, name in ((-1, "left"), (1, "right")):
        joint = model.frames[model.getFrameId(name)].parentJoint
        J = pin.getJointJacobian(model, data, joint, pin.WORLD)
        at_place = J[:3] + np.cross(J[3:].T, place).T  # of the point of the body that is at the place
        work += sign * (at_place.T @ wrench.forces[0] + J[3:].T @ wrench.moments[0])
    np.testing.assert_allclose(work, loop.closure_jacobian(q).T @ multipliers, rtol=0, atol=1e-12)


def test_what_is_not_determined_is_left_out_and_told():
    loop = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    q = loop.assemble(guess=robots.five_bar_q(1.9, 1.2)).q
    found = loop.inverse_dynamics(q, np.zeros(4), np.zeros(4))
    assert found.unique.tolist() == [True, False, True]
    wrenches = ClosureWrenches(loop.model, loop.sidecar)
    part = wrenches.at(q, np.where(found.unique, found.lambda_, np.nan))
    assert part.determined.tolist() == [1]
    whole = wrenches.at(q, found.lambda_)
    np.testing.assert_allclose(
        part.forces[0, [0, 2]], whole.forces[0, [0, 2]], rtol=0, atol=1e-12
    )  # y is across
    assert wrenches.at(q, np.full(3, np.nan)).determined.tolist() == [0]
    with pytest.raises(InputError, match=r"multipliers: expected shape \(3,\), got \(2,\)"):
        wrenches.at(q, [1.0, 2.0])
