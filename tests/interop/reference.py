"""What every reader of the committed files must find: Pinocchio's numbers for the same files."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import p3dof
from p3dof.machine import description
from p3dof.machine.parameters import PAPER

FILES = Path(__file__).parents[2] / "urdf"
URDF = FILES / "p3dof.urdf"
MECHANISM = description.with_masses(description.describe(PAPER))
LINKS = {link.name: link for link in MECHANISM.links}
MOVING = {joint.name: joint for joint in MECHANISM.moving}
GRAVITY = np.array(PAPER.gravity)


def later(name: str, missing: str) -> Any:
    """Return a module that is imported when it is first used, so in one worker; skip without it."""
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.find_spec(name)
    if spec is None or spec.loader is None:
        pytest.skip(missing, allow_module_level=True)
    spec.loader = importlib.util.LazyLoader(spec.loader)
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def random_joints(seed: int, share: float = 0.9) -> dict[str, float]:
    """Joint values of the open tree within `share` of their limits, by joint name."""
    rng = np.random.default_rng(seed)
    return {
        name: float(share * rng.uniform(joint.limits.lower, joint.limits.upper))
        for name, joint in MOVING.items()
    }


def mimicking_joints(seed: int) -> dict[str, float]:
    """Joint values that also keep the parallelogram together, for readers that honour <mimic>."""
    q = random_joints(seed)
    for name, joint in MOVING.items():
        if joint.mimic is not None:
            q[name] = joint.mimic.multiplier * q[joint.mimic.joint]
    return q


def placements(q: dict[str, float], urdf: Path = URDF) -> dict[str, np.ndarray]:
    """4 × 4 placement of every link in base_link, by Pinocchio, at joint values by name."""
    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    values = np.array([q[name] for name in model.names[1:]])
    pin.framesForwardKinematics(model, data, values)
    return {name: data.oMf[model.getFrameId(name, pin.FrameType.BODY)].homogeneous for name in LINKS}


def closed_states(samples: int = 11) -> p3dof.InverseDynamics:
    """The paper's motion with joints (names, q, v, a) and forces, by the paper's method."""
    return p3dof.load().inverse_dynamics(p3dof.paper_motion(samples), method="virtual-power")


def closed_joints(count: int, seed: int = 0) -> list[dict[str, float]]:
    """Joint values of closed poses all over the workspace, its corners included: sliders within travel."""
    geometry, (low, high) = PAPER.geometry, PAPER.limits.travel
    rng = np.random.default_rng(seed)
    far, (down, up) = geometry.L - (geometry.R - geometry.r), PAPER.limits.tilt
    corners = [(share * far, tilt) for share in (-0.999, 0, 0.999) for tilt in (down, 0, up)]
    found: list[dict[str, float]] = []
    while len(found) < count:
        y, tilt = corners.pop() if corners else (0.999 * far * rng.uniform(-1, 1), rng.uniform(down, up))
        joints = p3dof.load().inverse_kinematics([y, 0.0, tilt]).joints
        sliders = [joints[name] for name in MECHANISM.actuated]
        bottom, top = low - min(sliders), high - max(sliders)
        for share in (0, rng.random(), 1) if bottom <= top else ():
            z = bottom + share * (top - bottom)
            found.append({name: float(joints[name]) + z * (name in MECHANISM.actuated) for name in MOVING})
    return found[:count]


def composed(steps: Mapping[str, tuple[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Placement of every link in base_link from its placement in its parent link, parents first."""
    found = {"base_link": np.eye(4)}
    for name, (parent, step) in steps.items():
        found[name] = found[parent] @ step
    return found


def assert_placements(
    found: Mapping[str, np.ndarray], q: dict[str, float], tolerance: float = 1e-9, urdf: Path = URDF
) -> None:
    """Assert that every link is where Pinocchio has it."""
    expected = placements(q, urdf)
    assert sorted(found) == sorted(expected)
    for name, placement in expected.items():
        np.testing.assert_allclose(found[name], placement, rtol=0, atol=tolerance, err_msg=name)


def assert_bodies(found: Mapping[str, tuple[float, np.ndarray, np.ndarray]], relative: float = 1e-12) -> None:
    """Assert mass, mass centre and inertia about it, in link axes, of every link."""
    assert sorted(found) == sorted(LINKS)
    for name, (mass, com, inertia) in found.items():
        body = LINKS[name].body
        np.testing.assert_allclose(mass, body.mass, rtol=relative, err_msg=name)
        np.testing.assert_allclose(com, body.com, rtol=relative, atol=1e-15, err_msg=name)
        size = np.abs(body.inertia).max()
        np.testing.assert_allclose(inertia, body.inertia, rtol=0, atol=relative * size, err_msg=name)


def tree_forces(seed: int) -> tuple[dict[str, float], dict[str, float], dict[str, float], dict[str, float]]:
    """Random positions, speeds, accelerations of the open tree and the joint forces they take, by name."""
    model = pin.buildModelFromUrdf(str(URDF))
    model.gravity.linear = GRAVITY
    rng = np.random.default_rng(seed)
    names = list(model.names)[1:]
    q = np.array([random_joints(seed)[name] for name in names])
    v, a = rng.normal(0, 1, (2, model.nv))
    forces = pin.rnea(model, model.createData(), q, v, a)
    q, v, a, forces = (dict(zip(names, map(float, values), strict=True)) for values in (q, v, a, forces))
    return q, v, a, forces
