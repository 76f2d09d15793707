"""Assembling from far away: closing what can close, all modes, and the limits of joints."""

from __future__ import annotations

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from other_robots import load, others

import p3dof
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops import ClosedLoopModel, Closure, FrameTarget, Sidecar

XZ = [True, False, True, False, False, False]
TIP = pin.SE3(np.eye(3), np.array([0.12, 0.0, 0.45]))


def ring(lengths: np.ndarray) -> ClosedLoopModel:
    """A chain of links on hinges of two directions in turn, whose end has to reach a point far away."""
    parts, parent, x = [robots.link("base")], "base", 0.0
    for i, length in enumerate(lengths[1:]):
        axis = (0, 0, 1) if i % 2 else (0, 1, 0)
        parts += [robots.link(f"l{i}", robots.ROD), robots.joint(f"j{i}", parent, f"l{i}", (x, 0, 0), axis)]
        parent, x = f"l{i}", length
    parts += [robots.link("tip"), robots.joint("tip_joint", parent, "tip", (x, 0, 0), kind="fixed")]
    parts += [robots.link("goal"), robots.joint("g", "base", "goal", (lengths[0], 0, 0), kind="fixed")]
    return ClosedLoopModel.from_urdf(robots.robot(*parts), Sidecar((Closure("tip", "goal"),), ()))


@pytest.mark.parametrize("seed", range(8))
def test_chains_close_from_anywhere_up_to_the_border_of_reach(seed):
    generator = np.random.default_rng(seed)
    lengths = generator.uniform(0.1, 0.4, 6)
    loop = ring(np.concatenate(([0.999 * lengths.sum()], lengths)))
    far = generator.uniform(-3, 3, 6)
    result = loop.assemble(None, far)
    assert np.abs(loop.closure_error(result.q)).max() < 1e-12
    assert np.array_equal(loop.copy().assemble(None, far).q, result.q)  # random starts are always the same
    out = ring(np.concatenate(([1.05 * lengths.sum()], lengths)))
    with pytest.raises(AssemblyError, match="most at the closure tip/goal") as caught:
        out.assemble(None, far)
    assert caught.value.gap == pytest.approx(0.05 * lengths.sum(), rel=0.02)


@pytest.mark.parametrize("name", others("leg_with_rods", "two_legs", "tiny_delta"))
def test_other_robots_close_from_anywhere(name):
    loop = load(name)
    for seed in range(10):
        far = np.random.default_rng(seed).uniform(-3, 3, loop.model.nv)
        result = loop.assemble(None, pin.integrate(loop.model, pin.neutral(loop.model), far))
        assert np.abs(loop.closure_error(result.q)).max() < 1e-12


# --- modes --------------------------------------------------------------------------------------------------


def five_bar(lower: dict[str, float] | None = None, upper: dict[str, float] | None = None) -> ClosedLoopModel:
    loop = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    low, high = (np.array(x) for x in (loop.model.lowerPositionLimit, loop.model.upperPositionLimit))
    for values, limits in ((low, lower), (high, upper)):
        for name, value in (limits or {}).items():
            values[loop.model.idx_qs[loop.model.getJointId(name)]] = value
    loop.model.lowerPositionLimit, loop.model.upperPositionLimit = low, high
    return loop


def arms_to(x: float, z: float) -> list[tuple[float, float]]:
    """Both solutions of an arm of the five-bar in closed form: its angles at the motor and the elbow."""
    _, near, far = robots.FIVE_BAR
    bend = np.arccos((x * x + z * z - near**2 - far**2) / (2 * near * far))
    return [
        (np.arctan2(z, x) - np.arctan2(far * np.sin(e), near + far * np.cos(e)), e) for e in (bend, -bend)
    ]


def test_a_five_bar_has_four_modes_at_a_point():
    loop = five_bar()
    modes = loop.assembly_modes(FrameTarget("left_tip", TIP, XZ))
    x, _, z = TIP.translation
    ground = robots.FIVE_BAR[0]
    expected = [[*left, *right] for left in arms_to(x, z) for right in arms_to(x - ground, z)]
    assert len(modes) == len(expected) == 4
    for q in expected:
        apart = [(np.array(mode.q) - q + np.pi) % (2 * np.pi) - np.pi for mode in modes]
        assert min(np.abs(difference).max() for difference in apart) < 1e-11
    assert all(mode.gap < 1e-12 and mode.rank == 2 for mode in modes)
    again = loop.assembly_modes(FrameTarget("left_tip", TIP, XZ))
    assert all(np.array_equal(one.q, other.q) for one, other in zip(modes, again, strict=True))
    few = loop.assembly_modes(FrameTarget("left_tip", TIP, XZ), starts=1)
    assert len(few) == 1


def test_modes_of_given_motors_are_those_of_two_circles():
    loop = ClosedLoopModel(
        five_bar().model,
        Sidecar(
            robots.FIVE_BAR_SIDECAR.closures,
            robots.FIVE_BAR_SIDECAR.actuated,
            reference=dict(
                zip(
                    ["left_joint", "left_elbow", "right_joint", "right_elbow"],
                    robots.five_bar_q(2.0, 1.2),
                    strict=True,
                )
            ),
        ),
    )
    modes = loop.assembly_modes([2.1, 1.1])
    assert len(modes) == 2
    assert [mode.same_assembly for mode in modes] == [True, False]  # the nearest is that of the reference
    np.testing.assert_allclose(modes[0].q, robots.five_bar_q(2.1, 1.1), rtol=0, atol=1e-12)


def test_modes_need_a_target_that_determines_the_joints_and_can_be_reached():
    loop = five_bar()
    with pytest.raises(AssemblyError, match="the target leaves 1 free motions"):
        loop.assembly_modes({"left_joint": 2.0})
    far = FrameTarget("left_tip", pin.SE3(np.eye(3), np.array([0.15, 0.0, 2.0])), XZ)
    with pytest.raises(AssemblyError, match="do not close at the target"):
        loop.assembly_modes(far, starts=4)
    for arguments in ({"starts": 0}, {"starts": 2.5}, {"seed": -1}, {"starts": True}):
        with pytest.raises(InputError, match="expected a whole number"):
            loop.assembly_modes(far, **arguments)


# --- limits -------------------------------------------------------------------------------------------------


def test_limits_are_respected_on_request_and_told():
    """Elbows that bend to one side only: of four modes, one is within the limits."""
    loop = five_bar({"left_elbow": 0.0, "right_elbow": 0.1}, {"left_elbow": 3.0, "right_elbow": 3.0})
    target = FrameTarget("left_tip", TIP, XZ)
    start = np.array([2.2, -1.8, 1.2, 1.4])
    free = loop.assemble(target, start)
    assert set(loop.beyond_limits(free.q)) == {"left_elbow"}
    assert loop.beyond_limits(free.q)["left_elbow"] == pytest.approx(free.q[1])
    held = loop.assemble(target, start, within_limits=True)
    assert not loop.beyond_limits(held.q)
    assert held.gap < 1e-12
    x, _, z = TIP.translation
    expected = [*arms_to(x, z)[0], *arms_to(x - robots.FIVE_BAR[0], z)[0]]
    assert np.abs((held.q - expected + np.pi) % (2 * np.pi) - np.pi).max() < 1e-11
    assert held.iterations > free.iterations
    [mode] = loop.assembly_modes(target, within_limits=True)
    assert np.abs((mode.q - held.q + np.pi) % (2 * np.pi) - np.pi).max() < 1e-11
    assert np.array_equal(
        loop.assemble(target, held.q, within_limits=True).q, loop.assemble(target, held.q).q
    )


def test_whole_turns_bring_a_joint_within_its_limits():
    loop = five_bar({"left_joint": -3.0}, {"left_joint": 3.0})
    turned = robots.five_bar_q(2.0, 1.2) - [2 * np.pi, 0, 0, 0]
    assert loop.beyond_limits(turned) == {"left_joint": pytest.approx(turned[0] + 3.0)}
    back = loop.assemble(None, turned, within_limits=True)
    np.testing.assert_allclose(back.q, robots.five_bar_q(2.0, 1.2), rtol=0, atol=1e-12)


def test_a_joint_with_a_range_of_turns_stays_where_it_is():
    """Another joint has to turn back; this one is at its limit, but for rounding, and may not."""
    turned = robots.five_bar_q(2.0, 1.2) + 2 * np.pi * np.array([1, 0, 1, 0])
    limit = turned[2] - 3e-14
    loop = five_bar({"left_joint": -3.0, "right_joint": -9.0}, {"left_joint": 3.0, "right_joint": limit})
    back = loop.assemble(None, turned, within_limits=True)
    np.testing.assert_allclose(back.q, turned - [2 * np.pi, 0, 0, 0], rtol=0, atol=1e-12)
    assert not loop.beyond_limits(back.q)


def test_turns_that_nothing_asks_for_are_taken_back(monkeypatch):
    """What an iteration far away leads to may be turns from the guess; those of a target stay."""
    loop = five_bar({"right_elbow": -10.0}, {"right_elbow": 10.0})
    q, at = robots.five_bar_q(2.0, 1.2), np.array([0, 0, 0, 2 * np.pi])
    found = loop._tree.assembler.assemble
    monkeypatch.setattr(loop._tree.assembler, "assemble", lambda target, _, tol: found(target, q + at, tol))
    near = loop.assemble(None, q, within_limits=True)
    np.testing.assert_allclose(near.q, q, rtol=0, atol=1e-12)
    asked = loop.assemble({"right_elbow": q[3] + 2 * np.pi}, q, within_limits=True)
    np.testing.assert_allclose(asked.q, q + at, rtol=0, atol=1e-12)


def test_what_closes_beyond_the_limits_only_is_an_error_that_names_the_joint():
    loop = five_bar({"right_joint": -0.1}, {"right_joint": 0.1})
    with pytest.raises(
        AssemblyError, match="beyond the limits of joints only: the joint 'right_joint' would be at"
    ):
        loop.assemble(FrameTarget("left_tip", TIP, XZ), robots.five_bar_q(2.0, 1.2), within_limits=True)


@pytest.mark.parametrize("s", [1e-3, 1e3])
def test_limits_and_modes_of_machines_of_any_size(s):
    """A slide's limits are lengths: the leg of a small or large Stewart platform stops at its own."""
    loop = ClosedLoopModel.from_urdf(robots.hexapod(), robots.HEXAPOD_SIDECAR)
    model = loop.model.copy()
    for i in range(model.njoints):
        model.jointPlacements[i] = pin.SE3(
            model.jointPlacements[i].rotation, s * model.jointPlacements[i].translation
        )
    for frame in model.frames:
        frame.placement = pin.SE3(frame.placement.rotation, s * frame.placement.translation)
    high = np.full(model.nq, np.inf)
    high[model.idx_qs[model.getJointId("slide_2")]] = 0.6 * s
    model.upperPositionLimit = high
    other = ClosedLoopModel(model, loop.sidecar)
    place = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.7 * s]))
    start = robots.hexapod_q(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5])), loop.model)
    for name in ("float", *loop.actuated):
        at = model.idx_qs[model.getJointId(name)]
        start[at : at + (3 if name == "float" else 1)] *= s
    reached = other.assemble(FrameTarget("platform", place), start)
    assert set(other.beyond_limits(reached.q)) == {"slide_2"}
    held = other.assemble(None, reached.q, within_limits=True)
    slide = held.q[model.idx_qs[model.getJointId("slide_2")]]
    assert slide <= 0.6 * s * (1 + 1e-12)
    assert np.abs(other.closure_error(held.q)).max() < 1e-11 * max(1.0, s)


def test_turns_of_geared_joints_are_other_modes():
    """A hinge that follows another one at half its speed has another angle after each of its turns."""
    xml = robots.robot(
        robots.link("base"),
        robots.link("one", robots.ROD),
        robots.link("two", robots.BAR),
        robots.joint("a", "base", "one"),
        robots.joint("b", "base", "two"),
    )
    place = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.6, 0.0), np.zeros(3))
    target = FrameTarget("one", place, [False, False, False, False, True, False])
    loop = ClosedLoopModel.from_urdf(xml, Sidecar((), ("a",), (p3dof.Coupling("b", "a", (0.0, 0.5)),)))
    values = [mode.q for mode in loop.assembly_modes(target)]
    np.testing.assert_allclose([q[1] for q in values], [q[0] / 2 for q in values], rtol=0, atol=1e-12)
    turns = sorted({round((q[0] - 0.6) / (2 * np.pi)) for q in values})
    assert len(turns) == len(values) == 2
