"""Motions of several targets at once, at many samples: those of each sample, and done by arrays."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from gallery import GALLERY

import p3dof
from p3dof import ClosedLoopModel
from p3dof._base.errors import InputError
from p3dof.loops import FrameTarget, FrameTargets

COUNT = 24


def robot(name: str) -> ClosedLoopModel:
    return p3dof.load_robot(GALLERY / f"{name}.urdf", GALLERY / f"{name}.yaml")


def states(loop: ClosedLoopModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A motion that keeps the loops closed: samples in small steps."""
    home = loop.assemble().q
    joints = [loop.model.getJointId(name) for name in loop.actuated]
    start = np.array([value(loop, home, joint) for joint in joints])
    phase = 0.05 * np.arange(COUNT)[:, None] + np.arange(len(start))
    wave, rate = 0.05 * np.sin(phase), 0.05 * np.cos(phase)
    found = loop.complete_batch(start + wave - wave[0], rate, -wave)
    assert not found.errors
    return found.q, found.v, found.a


def value(loop, q, joint):
    at = loop.model.idx_qs[joint]
    return q[..., at] if loop.model.nqs[joint] == 1 else np.arctan2(q[..., at + 1], q[..., at])


def by_name(loop, q, names):
    return {name: value(loop, q, loop.model.getJointId(name)) for name in names}


def rates_of(loop, rates, names):
    return rates[:, [loop.model.idx_vs[loop.model.getJointId(name)] for name in names]]


def frame_motion(loop, motion, frame, mask):
    """Placements of a frame, and its velocity and classical acceleration."""
    model, data = loop.model, loop.model.createData()
    index = model.getFrameId(frame)
    places, velocities, accelerations = [], [], []
    for q, v, a in zip(*motion, strict=True):
        pin.forwardKinematics(model, data, q, v, a)
        places.append(pin.updateFramePlacement(model, data, index).copy())
        at = (model, data, index, pin.LOCAL_WORLD_ALIGNED)
        velocities.append(pin.getFrameVelocity(*at).vector[mask])
        accelerations.append(pin.getFrameClassicalAcceleration(*at).vector[mask])
    positions = np.array([M.translation for M in places])
    target = FrameTargets(frame, positions, np.array([M.rotation for M in places]), mask)
    return target, np.array(velocities), np.array(accelerations)


CASES = {
    "joints by name": ("stewart", 0, 6, False),
    "a frame, then joints": ("stewart", 3, 3, False),
    "joints, then a frame": ("stewart", 3, 3, True),
    "a small robot": ("gripper", 0, 1, True),
}


@pytest.mark.parametrize("case", CASES)
def test_several_targets_are_reached_together(case, monkeypatch):
    name, places, named, reverse = CASES[case]
    loop = robot(name)
    motion = states(loop)
    q, v, a = motion
    names = loop.actuated[:named]
    parts = [(by_name(loop, q, names), rates_of(loop, v, names), rates_of(loop, a, names))]
    if places:
        mask = np.arange(6) >= 6 - places  # rotations only
        parts.insert(0, frame_motion(loop, motion, "platform", mask))
    if reverse:
        parts.reverse()
    goal = [part[0] for part in parts]
    velocity, acceleration = (np.concatenate([part[i] for part in parts], axis=1) for i in (1, 2))
    alone = [
        loop.complete(
            [one[i] if isinstance(one, FrameTargets) else {k: x[i] for k, x in one.items()} for one in goal],
            velocity[i],
            acceleration[i],
            q[i],
        )
        for i in range(0, COUNT, 7)
    ]
    monkeypatch.setattr(loop._tree, "complete", None)  # all samples are done without it
    found = loop.complete_batch(goal, velocity, acceleration)
    assert not found.errors
    assert found.same_assembly.all()
    for mine, wanted in ((found.q, q), (found.v, v), (found.a, a)):
        np.testing.assert_allclose(mine, wanted, rtol=0, atol=1e-9 * max(1.0, np.abs(wanted).max()))
    for state, influence in zip(alone, found.influence[::7], strict=True):
        np.testing.assert_allclose(influence, state.influence, rtol=0, atol=1e-8 * np.abs(influence).max())


def test_two_frames_and_few_samples_are_reached_one_by_one():
    loop = robot("stewart")
    motion = states(loop)
    first = frame_motion(loop, motion, "platform", np.arange(6) < 3)
    second = frame_motion(loop, motion, "platform", np.arange(6) >= 3)
    velocity, acceleration = (np.concatenate((second[i], first[i]), axis=1) for i in (1, 2))
    found = loop.complete_batch([second[0], first[0]], velocity, acceleration)
    np.testing.assert_allclose(found.v, motion[1], rtol=0, atol=1e-9)
    few = [
        FrameTargets(one.frame, one.positions[:3], one.rotations[:3], one.mask)
        for one in (second[0], first[0])
    ]
    some = loop.complete_batch(few, velocity[:3], acceleration[:3])
    np.testing.assert_allclose(some.a, found.a[:3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(some.influence, found.influence[:3], rtol=0, atol=1e-9)


def test_a_number_is_the_same_at_all_samples():
    loop = robot("stewart")
    home = loop.assemble().q
    target = {name: float(angle) for name, angle in by_name(loop, home, loop.actuated).items()}
    rest = np.zeros((10, 6))
    found = loop.complete_batch(target, rest, rest)
    np.testing.assert_allclose(found.q, np.tile(home, (10, 1)), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ({"no_joint": np.zeros(10)}, "no_joint"),
        ({"leg_1": np.zeros((10, 2))}, "expected shape"),
        ([{"leg_1": np.zeros(10)}, {"leg_2": np.zeros(9)}], "as many samples"),
        ({"leg_1": np.zeros(10), "leg_2": np.zeros(9)}, "as many samples"),
        ({"leg_1": ["one"] * 10}, "real numbers"),
    ],
)
def test_wrong_targets_are_one_error(target, message):
    loop = robot("stewart")
    with pytest.raises(InputError, match=message):
        loop.complete_batch(target, np.zeros((10, 1)), np.zeros((10, 1)))


def test_the_target_of_one_sample_is_a_frame_target():
    one = FrameTargets("tip", np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)))[1]
    assert isinstance(one, FrameTarget)
