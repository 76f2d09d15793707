"""Gymnasium and CMA-ES: `docs/examples/swing_up*.py`, a linkage as an environment, alone and many at once."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from p3dof.runs import simulate_robot

gym = pytest.importorskip("gymnasium", reason="gymnasium not installed: pip install 'p3dof[adapters]'")
swing_up = pytest.importorskip("swing_up")
swing_up_gym = pytest.importorskip("swing_up_gym")
NAME = "p3dof/SwingUp-v0"


def test_it_is_an_environment():
    """Gymnasium's own check; its warnings are errors here."""
    from gymnasium.utils.env_checker import check_env

    check_env(gym.make(NAME).unwrapped)
    assert isinstance(gym.make_vec(NAME, num_envs=2), swing_up.SwingUpVector)


def test_many_at_once_are_each_alone(monkeypatch):
    """To the last bit, over ends of episodes by time and by speed, and what Gymnasium does after them."""
    monkeypatch.setattr(swing_up, "STEPS", 5)
    monkeypatch.setattr(swing_up, "SPEED", 2.0)
    alone, many = (gym.make_vec(NAME, 4, mode) for mode in ("sync", "vector_entry_point"))
    assert alone.metadata["autoreset_mode"] == many.metadata["autoreset_mode"]
    (one, _), (other, _) = alone.reset(seed=3), many.reset(seed=3)
    assert_array_equal(one, other)
    assert len(np.unique(one[:, 0])) == 4
    rng, ends = np.random.default_rng(1), np.zeros((2, 4), dtype=int)
    for _ in range(18):
        given = rng.choice([-1, 1, 1], size=(4, 1)).astype(np.float32)
        one, other = alone.step(given), many.step(given)
        for left, right in zip(one[:4], other[:4], strict=True):
            assert left.dtype == right.dtype
            assert_array_equal(left, right)
        ends += np.stack(other[2:4])
    assert (ends.sum(axis=1) > 2).all()


def test_a_step_is_a_run_of_the_robot():
    """By its general method, with adaptive steps; torques beyond the motor's are cut off."""
    many = swing_up.SwingUpVector(3)
    many.reset(seed=0)
    given = np.array([[0.3], [-1.0], [7.0]])
    for _ in range(20):
        before = many.q, many.v
        many.step(given)
    for i, torque in enumerate([0.18, -0.6, 0.6]):
        alone = simulate_robot(
            many.loop, swing_up.PERIOD, before[0][i], before[1][i], [torque], samples=2, method="general"
        )
        assert_allclose(many.q[i], alone.q[-1], rtol=0, atol=1e-8)
        assert_allclose(many.v[i], alone.v[-1], rtol=0, atol=1e-7)
    assert np.abs(many.v[:, 0]).min() > 0.1


def test_the_reward_is_the_share_of_the_potential_energy():
    many = swing_up.SwingUpVector(1)
    data, loop = many.loop.model.createData(), many.loop
    angles = np.linspace(-np.pi, np.pi, 41)[:, None]
    states = loop.complete_batch(angles, 0 * angles, 0 * angles).q
    energy = np.array([pin.computePotentialEnergy(loop.model, data, q) for q in states])
    share = np.interp(angles[:, 0], many.angles[:, 0], many.height, period=2 * np.pi)
    low, high = energy.min(), energy.max()
    # A sum instead of an integral: an error of half a step of one degree times the largest torque.
    assert_allclose(share, (energy - low) / (high - low), rtol=0, atol=1.7 * np.radians(1) / (high - low))
    held = loop.inverse_dynamics_batch(states, 0 * states, 0 * states).tau
    assert np.abs(held).max() > 2.5 * swing_up.TORQUE  # so no constant torque lifts it


def test_a_robot_with_several_motors_is_told():
    with pytest.raises(ValueError, match="expected a robot with one motor, got left_motor, right_motor"):
        swing_up.SwingUpVector(1, "gallery/five_bar")


def rise(generations, steps, share, **options):
    """Learn, and compare with the first generation, and with a motor that does nothing."""
    pytest.importorskip("cma", reason="cma not installed: pip install 'p3dof[adapters]'")
    learning = pytest.importorskip("swing_up_learning")
    policy, curve = learning.learn(generations, steps=steps, **options)
    assert np.median(curve[-3:]) > share * np.median(curve[0])
    runs, seeds = swing_up.SwingUpVector(2 * 8), list(range(500, 508))
    learned, none = learning.rewards(runs, np.stack([policy, 0 * policy]), seeds, steps).sum(axis=0)
    assert learned.mean() > 5 * none.mean()


def test_returns_rise():
    rise(9, 80, 2.0, population=20, starts=2)


@pytest.mark.slow
def test_returns_rise_further():
    rise(12, swing_up.STEPS, 2.5, starts=2)
