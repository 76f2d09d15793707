"""Single samples, many, and compiled ones refuse the same, however little a sample misses."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT

import p3dof
import p3dof.loops.batch.dynamics as batch_dynamics
from p3dof._base.errors import InputError, P3dofError
from p3dof.loops import ClosedLoopModel


@pytest.fixture(scope="module")
def gallery_leg() -> tuple[ClosedLoopModel, tuple[np.ndarray, ...]]:
    """A leg with quaternions, and motions of it that keep its loops closed."""
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/leg.urdf")
    return loop, states(loop)[:3]


MISSES = np.logspace(-13, -1, 49)
"""How much samples miss, of what they miss: below, between and above all thresholds."""
NEARLY = np.array([-1e-3, -7e-7, -3e-7, -1e-8, 1e-8, 3e-7, 7e-7, 1e-3])
"""How near a threshold a number is, in shares of it."""


def states(loop: ClosedLoopModel) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.random.Generator]:
    """Motions with closed loops whose idle freedoms move as they must, one for each miss."""
    generator, model = np.random.default_rng(0), loop.model
    q, v, a = [], [], []
    for _ in MISSES:
        step = 1e-2 * generator.normal(size=model.nv)
        at = loop.assemble(None, guess=pin.integrate(model, loop.reference, step)).q
        free = np.linalg.svd(loop.closure_jacobian(at))[2][loop.rank(at) :]
        moving = generator.normal(size=len(free)) @ free
        tau = generator.normal(size=len(loop.actuated))
        q, v, a = [*q, at], [*v, moving], [*a, loop.forward_dynamics(at, moving, tau).a]
    return np.array(q), np.array(v), np.array(a), generator


def missed(loop: ClosedLoopModel, what: str) -> tuple[np.ndarray, ...]:
    """The same, each with a miss: in the closures, their rates, or what the motion of idle freedoms takes."""
    q, v, a, generator = states(loop)
    for i, miss in enumerate(MISSES):
        off = miss * generator.normal(size=loop.model.nv)
        if what == "gap":
            q[i] = pin.integrate(loop.model, q[i], off)
        elif what == "velocity":
            v[i] += off * max(1.0, np.abs(v[i]).max())
        elif what == "acceleration":
            a[i] += off * max(1.0, np.abs(a[i]).max())
        else:
            free = np.linalg.svd(loop.closure_jacobian(q[i]))[2][loop.rank(q[i]) :]
            a[i] += np.abs(a[i]).max() * off @ free.T @ free
    return q, v, a


def alone(call: Callable[..., Any], *rows: np.ndarray) -> dict[int, str]:
    """What single samples are refused with."""

    def asked(row: tuple[np.ndarray, ...]) -> str:
        try:
            call(*row)
        except P3dofError as error:
            return f"{type(error).__name__}: {error}"
        return ""

    told = [asked(row) for row in zip(*rows, strict=True)]
    return {i: why for i, why in enumerate(told) if why}


def of(batch: Any) -> dict[int, str]:
    return {i: f"{type(error).__name__}: {error}" for i, error in sorted(batch.errors.items())}


@pytest.mark.parametrize("what", ["gap", "velocity", "acceleration", "idle force"])
@pytest.mark.parametrize("name", ["five_bar", "leg"])
def test_the_same_samples_are_refused_for_the_same_reason(name, what):
    loop = p3dof.load_robot(ROOT / f"docs/_static/gallery/{name}.urdf")
    q, v, a = missed(loop, what)
    wanted = a[:, loop.actuated_v]
    inverse, hybrid = alone(loop.inverse_dynamics, q, v, a), alone(loop.hybrid_dynamics, q, v, wanted)
    refusable = what != "idle force" or name == "leg"  # the others have no idle freedoms
    assert (0 < len(inverse) < len(MISSES)) == refusable
    assert (0 < len(hybrid) < len(MISSES)) == (what in ("gap", "velocity"))
    for method in ("general", loop.compile(level="numpy")):
        assert of(loop.inverse_dynamics_batch(q, v, a, method=method)) == inverse
        assert of(loop.hybrid_dynamics_batch(q, v, wanted, method=method)) == hybrid
    tau = np.ones_like(wanted)
    forward = loop.forward_dynamics_batch(q, v, tau, method=loop.compile(level="numpy"))
    assert of(forward) == alone(loop.forward_dynamics, q, v, tau)


def test_a_method_that_does_not_exist_is_refused_whatever_is_prescribed():
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/five_bar.urdf")
    q, v, a = missed(loop, "gap")
    wanted, names, tool = a[:, loop.actuated_v], loop.actuated, {str(loop.model.frames[-1].name): np.zeros(6)}
    for asked in (wanted, dict(zip(names, wanted.T, strict=True)), None):
        for frames in (None, tool):
            with pytest.raises(InputError, match=r"method: expected 'general', 'compiled' or what"):
                loop.hybrid_dynamics_batch(q, v, asked, frames, method="fast")


@pytest.mark.parametrize("place", [0, 1, 2])
def test_values_that_are_none_are_told_alike(gallery_leg, place):
    """Compiled functions look at values themselves; what they refuse is told as by the general layer."""
    loop, motion = gallery_leg

    names = {"inverse": "qva", "forward": ("q", "v", "tau"), "hybrid": ("q", "v", "prescribed")}

    def told(value: float, method: str, name: str) -> str:
        rows = [row.copy() for row in motion]
        if name != "inverse":
            rows[2] = rows[2][:, loop.actuated_v]
        rows[place][3, -1] = value
        with pytest.raises(p3dof.InputError) as caught:
            getattr(loop, f"{name}_dynamics_batch")(*rows, method=method)
        return str(caught.value)

    for name in names:
        for value in (np.nan, np.inf, -2e30):
            message = told(value, "compiled", name)
            assert message == told(value, "general", name)
            assert message.startswith(f"{names[name][place]}: expected ")


def test_lengths_of_circles_and_quaternions_are_told_alike(gallery_leg):
    """Little by little around the largest error, all ways refuse the same configurations."""
    loop, (q, v, a) = gallery_leg  # whose forward dynamics take loops that are a little open
    turning = next(joint for joint in loop.model.joints if joint.nq > joint.nv)
    part = slice(turning.idx_q, turning.idx_q + turning.nq)

    def told(rows: np.ndarray, method: str) -> str:
        try:
            loop.forward_dynamics_batch(rows, v, a[:, loop.actuated_v], method=method)
        except p3dof.InputError as error:
            return str(error)
        return ""

    for off in (-1.0, *-1e-6 * (1 + NEARLY), *1e-6 * (1 + NEARLY), 1.0):
        rows = q.copy()
        rows[3, part] *= 1.0 + off
        message = "q: not normalised (unit quaternions and circles); see pinocchio.normalize"
        message *= not pin.isNormalized(loop.model, rows[3], 1e-6)
        assert (told(rows, "general"), told(rows, "compiled")) == (message, message), off


def test_evidence_is_of_the_samples_that_were_given(gallery_leg):
    """What is found out later is not about what the caller has written to the array meanwhile."""
    loop, (q, v, a) = gallery_leg
    rows = q.copy()
    late, known = (loop.inverse_dynamics_batch(x, v, a, method="compiled") for x in (rows, q))
    rows[:] = rows[::-1].copy()
    np.testing.assert_array_equal(late.conditioning, known.conditioning)
    assert np.ptp(known.conditioning) > 0


def test_a_robot_a_million_times_lighter_is_refused_the_same_samples():
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/leg.urdf")
    q, v, a = missed(loop, "idle force")
    light = loop.copy()
    for i, body in enumerate(loop.model.inertias):
        light.model.inertias[i] = pin.Inertia(1e-6 * body.mass, body.lever, 1e-6 * body.inertia)
    light.model.armature = 1e-6 * loop.model.armature
    refused = alone(loop.inverse_dynamics, q, v, a)
    assert 0 < len(refused) < len(MISSES)
    assert list(alone(light.inverse_dynamics, q, v, a)) == list(refused)


def test_targets_that_contradict_each_other_are_refused_alike():
    """Twelve motors of two arms that hold one thing: their rates depend on each other."""
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/two_arms.urdf")
    q, v, a, generator = states(loop)
    at = [loop.model.idx_qs[loop.model.getJointId(name)] for name in loop.actuated]
    rates = v[:, loop.actuated_v] + MISSES[:, None] * generator.normal(size=(len(MISSES), len(at)))
    found = loop.complete_batch(q[:, at], rates, a[:, loop.actuated_v], guess=q[0])
    expected = alone(lambda *row: loop.complete(*row, guess=q[0]), q[:, at], rates, a[:, loop.actuated_v])
    assert 0 < len(expected) < len(MISSES)
    assert of(found) == expected


def test_a_threshold_of_its_own_shows(monkeypatch):
    """The test above, with a batch that is sure of what single samples refuse."""
    monkeypatch.setattr(batch_dynamics, "SURELY", 1e-5)
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/leg.urdf")
    q, v, a = missed(loop, "idle force")
    assert len(loop.inverse_dynamics_batch(q, v, a).errors) < len(alone(loop.inverse_dynamics, q, v, a))


@pytest.mark.parametrize("room", ["loops", "methods"])
def test_each_threshold_is_said_once(room):
    """A public threshold has one place, and its name is no other one's, not even of a private one."""
    said: dict[str, list[str]] = defaultdict(list)
    files = [file for file in (ROOT / "p3dof" / room).rglob("*.py") if "engines" not in file.parts]
    for file in files:
        for line in ast.parse(file.read_text(encoding="utf-8")).body:
            value = getattr(line, "value", None)
            numbers = [one.value for one in ast.walk(value) if isinstance(one, ast.Constant)] if value else []
            if isinstance(line, ast.Assign) and any(isinstance(number, float) for number in numbers):
                for name in (one for target in line.targets for one in ast.walk(target)):
                    if isinstance(name, ast.Name):
                        said[name.id].append(file.name)
    public = {name: files for name, files in said.items() if not name.startswith("_")}
    assert public
    assert {name: files for name, files in public.items() if len(files) > 1 or f"_{name}" in said} == {}
