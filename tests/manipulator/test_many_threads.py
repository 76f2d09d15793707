"""One object in many threads: every door gives what it gives in one thread alone, to the last bit."""

from __future__ import annotations

import copy
import gc
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
import pytest
from gallery import GALLERY

import p3dof
from p3dof._base.errors import InputError, P3dofError
from p3dof._base.threads import OneThread, Own, Workspace
from p3dof.analysis.load_friction import HingeContact
from p3dof.loops import ClosedLoopModel, CompiledLoop, ReactionSolver
from p3dof.loops.compiled.functions import FUNCTIONS

THREADS, SWITCH = 3, 1e-6
Door: TypeAlias = "tuple[str, Callable[[], Any]]"
"""A public name, and what asks it."""


def told(value: Any, inside: bool = False) -> Any:
    """All that a result says, as plain data: arrays as their bytes, dataclasses with their properties."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return {key: told(one, inside) for key, one in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        names = {field.name for field in fields(value)} - {"evidence", "seconds"}
        if not inside:
            names |= properties(type(value)) - {"speed"}  # of a clock, as the seconds are
        return {name: told(asked(lambda name=name: getattr(value, name)), inside=True) for name in names}
    if isinstance(value, list | tuple):
        return [told(one, inside) for one in value]
    plain = isinstance(value, str | int | float | np.generic | Exception | None)
    return repr(value) if plain else type(value).__name__


def at_once(jobs: list[Callable[[], Any]]) -> list[Any]:
    """Results of jobs in a thread each, which begin together and are switched as often as Python can."""
    start, before = threading.Barrier(len(jobs)), sys.getswitchinterval()

    def run(job: Callable[[], Any]) -> Any:
        start.wait(timeout=60)
        return job()

    sys.setswitchinterval(SWITCH)
    try:
        with ThreadPoolExecutor(len(jobs)) as pool:
            return [future.result() for future in [pool.submit(run, job) for job in jobs]]
    finally:
        sys.setswitchinterval(before)


def asked(call: Callable[[], Any]) -> Any:
    """What a call returns, or why it does not."""
    try:
        return call()
    except P3dofError as error:
        return error


def public(kind: type) -> set[str]:
    return {name for name in dir(kind) if not name.startswith("_")}


def properties(kind: type) -> set[str]:
    return {name for name in public(kind) if isinstance(getattr(kind, name), property | cached_property)}


def same_in_threads(doors: Callable[[Any, int], Iterator[Door]], new: Callable[[], Any]) -> set[str]:
    """Every thread asks all doors of one object, with numbers of its own; alone, each asks a new object.

    What results find out when they are asked is found out when all doors have been, the last result first.
    Returns the names of the doors.
    """

    def answers(of: Any, k: int) -> list[tuple[str, Any]]:
        found = [(name, asked(call)) for name, call in doors(of, k)]
        return [(name, told(value)) for name, value in reversed(found)]

    alone = [answers(new(), k) for k in range(THREADS)]
    shared = new()
    together = at_once([lambda k=k: answers(shared, k) for k in range(THREADS)])
    assert [len(part) for part in alone] == [len(part) for part in together]
    pairs = zip(chain(*alone), chain(*together), strict=True)
    assert {name for (name, one), (_, other) in pairs if one != other} == set()
    return {name for part in alone for name, _ in part}


def machine() -> p3dof.Manipulator:
    friction = p3dof.machine.Friction(coulomb={"joints": 0.05, "sliders": 2.0}, viscous={"hinge_a": 0.01})
    return p3dof.load(replace(p3dof.PAPER, friction=friction))


WINDOWS = {"page", "show", "viewer"}
"""Doors that show something; see the tests of the viewer."""


@pytest.mark.parametrize("method", ["pinocchio", "virtual-power", "compiled"])
def test_one_manipulator_in_many_threads(method):
    by = {} if method == "pinocchio" else {"method": method}  # as users do who say nothing

    def doors(robot: p3dof.Manipulator, k: int) -> Iterator[Door]:
        draw = np.random.default_rng(k)
        pose, velocity, acceleration = (size * draw.uniform(-1, 1, (4, 3)) for size in (0.05, 0.5, 3.0))
        motion = p3dof.paper_motion(5 + k)

        def door(name: str, *given: Any, **options: Any) -> Door:
            return name, lambda: getattr(robot, name)(*given, **options)

        for q, v, a in zip(pose, velocity, acceleration, strict=True):
            yield door("forces", q, v, a, **by)
            yield door("forward_dynamics", q, v, (40.0, 50.0, 60.0), **by)
            yield door("jacobian", q, **by)
            yield door("mass_matrix", q, **by)
        yield door("forces", pose, velocity, acceleration, **by)
        yield door("forces", [0.2, 0.5, 0.1 * k], *np.zeros((2, 3)), **by)
        yield door("inverse_dynamics", motion, **by)
        yield door("simulate", 0.001, start=0.5 * pose[0], samples=4, **by)
        if method == "virtual-power":  # what has no method, or not this one
            moved = robot.inverse_dynamics(motion, method="virtual-power")
            for name in ("inverse_kinematics", "sliders", "singularity", "indices"):
                yield door(name, pose)
            yield door("coriolis_matrix", pose, velocity)
            yield door("gravity_forces", pose)
            yield door("forward_kinematics", robot.sliders(pose))
            yield door("mechanism_motion", pose, velocity, acceleration)
            yield door("force_derivatives", pose, velocity, acceleration)
            yield door("force_regressor", pose, velocity, acceleration)
            yield door("inverse_dynamics_derivatives", motion)
            yield door("load_friction", motion, p3dof.analysis.LoadFriction(hinges=HingeContact(0.1, 0.01)))
            yield door("compare", motion)
            yield door("refined", motion)
            yield door("remarks", motion)
            yield door("reactions", motion)
            yield door("energy", moved)
            yield door("simulate_many", 0.001, 2)
            yield "prepare_run", lambda: robot.prepare_run(0.001, samples=4)(0.5 * pose[0])
            yield "workspace", lambda: robot.workspace().volume

    found = same_in_threads(doors, machine)
    if method == "virtual-power":
        assert found == public(p3dof.Manipulator) - properties(p3dof.Manipulator) - WINDOWS


BUILDERS = {"from_urdf", "from_pinocchio", "copy", "lock", "reduced", "write"}
BUILDERS |= {"compile", "transmission", "observer", "payload_estimator"}
"""Doors that make another model or file: they read what never changes."""


@pytest.mark.parametrize("name", ["gripper", "delta", "leg"])
def test_one_closed_loop_model_in_many_threads(name):
    """One in a unit of its own with a coupling, one with redundant loops, one with rods and idle freedoms."""

    def new() -> ClosedLoopModel:
        return p3dof.load_robot(GALLERY / f"{name}.urdf")

    model, home = new().model, np.array(new().assemble().q)
    at = [model.idx_qs[model.getJointId(motor)] for motor in new().actuated]

    def doors(robot: ClosedLoopModel, k: int) -> Iterator[Door]:
        draw, nv, count = np.random.default_rng(k), model.nv, len(at)
        frame = robot.sidecar.closures[0].frame2

        def door(name: str, *given: Any, **options: Any) -> Door:
            return name, lambda: getattr(robot, name)(*given, **options)

        rows: list[list[np.ndarray]] = []
        for _ in range(2):
            goal, rates = home[at] + 2e-3 * draw.normal(size=count), 0.1 * draw.normal(size=(2, count))
            yield door("complete", goal, *rates, guess=home)
            found = asked(lambda goal=goal, rates=rates: robot.complete(goal, *rates, guess=home))
            if isinstance(found, Exception):
                continue
            q, v, a = (np.array(part) for part in (found.q, found.v, found.a))
            tau, wrench = draw.normal(size=count), {frame: draw.normal(size=6)}
            rows.append([q, v, a, tau])
            forces = robot.inverse_dynamics(q, v, a, wrench) if name != "leg" else None
            if forces is not None:
                yield door("inverse_dynamics", q, v, a, wrench)
                yield door("residual", q, v, a, forces.tau, forces.lambda_, wrench)
                yield door("inverse_dynamics_derivatives", q, v, a)
            yield door("assemble", None, guess=pin.integrate(model, q, np.full(nv, 1e-4)))
            yield door("hybrid_dynamics", q, v, rates[1], external=wrench)
            yield door("forward_dynamics", q, v, tau, wrench)
            yield door("hybrid_dynamics_derivatives", q, v, rates[1])
            yield door("forward_dynamics_derivatives", q, v, tau)
            for what in ("closure_error", "closure_gaps", "closure_jacobian", "rank", "mobility"):
                yield door(what, q)
            yield door("coordinates", q)
            yield door("beyond_limits", q)
            for what in ("body_energies", "minimal_dynamics"):
                yield door(what, q, v)
            for what in ("power", "force_regressor"):
                yield door(what, q, v, a)
            yield door("frame_jacobian", frame, q, v)
            yield door("singularity_margins", q, frame)
            yield door("dissipation", v)
            yield door("motor_side", tau, v)
        many = [np.tile(np.array(column), (24 // len(rows), 1)) for column in zip(*rows, strict=True)]
        q, v, a, tau = many
        yield door("inverse_dynamics_batch", q, v, a)
        yield door("hybrid_dynamics_batch", q, v, a[:, robot.actuated_v])
        yield door("forward_dynamics_batch", q[:3], v[:3], tau[:3])
        yield door("power_batch", q, v, a)
        yield door("complete_batch", q[:, at], v[:, robot.actuated_v], a[:, robot.actuated_v], guess=home)
        if name == "gripper":
            yield door("base_parameters")
            yield door("assembly_modes", home[at], starts=3)
            yield door("compiled_for", home)
            yield door("around", {robot.actuated[0]: float(home[at[0]]) + 0.02})
            yield door("inverse_dynamics_batch", q, v, a, method="compiled")

    found = same_in_threads(doors, new)
    if name == "gripper":
        assert found == public(ClosedLoopModel) - properties(ClosedLoopModel) - BUILDERS


@pytest.mark.parametrize("name", ["gripper", "delta"])
def test_one_reaction_solver_in_many_threads(name):
    def new() -> ReactionSolver:
        return ReactionSolver(p3dof.load_robot(GALLERY / f"{name}.urdf"))

    def doors(solver: ReactionSolver, k: int) -> Iterator[Door]:
        robot, draw = solver.loop, np.random.default_rng(k)
        for _ in range(10):
            tau, start = draw.normal(size=len(robot.actuated)), 1e-2 * draw.normal(size=robot.model.nv)
            q = robot.assemble(None, guess=pin.integrate(robot.model, robot.reference, start)).q
            a = robot.forward_dynamics(q, 0 * start, tau).a
            yield "solve", lambda q=q, a=a, tau=tau: solver.solve(q, 0 * a, a, tau)

    assert same_in_threads(doors, new) == {"solve"}


def test_what_a_result_finds_out_later_it_finds_out_in_any_thread():
    """The thread that made it goes on meanwhile, in what would be the same workspace."""
    robot, other = (p3dof.load_robot(GALLERY / "five_bar.urdf") for _ in range(2))

    def made(of: ClosedLoopModel) -> tuple[list[Any], Any]:
        guesses = [of.reference + 1e-3 * k for k in range(30)]
        found = [of.assemble(None, guess=guess) for guess in guesses]
        q = np.array([one.q for one in found])
        return found, of.inverse_dynamics_batch(q, 0 * q, 0 * q)

    def asked_of(results: tuple[list[Any], Any]) -> list[Any]:
        return [*((one.same_assembly, one.rank) for one in results[0]), results[1].conditioning.tolist()]

    expected, results = asked_of(made(other)), made(robot)
    found, *_ = at_once([lambda: asked_of(results), lambda: made(robot)])
    assert found == expected


def test_workspaces_go_with_their_thread_or_their_owner():
    class Made:
        pass

    made: list[weakref.ref[Made]] = []

    def make() -> Made:
        one = Made()
        made.append(weakref.ref(one))
        return one

    class Counted(Workspace):
        def __init__(self, start: int) -> None:
            self.count = start

    kept, counted = [Own(make)], Counted(5)
    counted.count += 1
    assert at_once([lambda: kept[0].here is kept[0].here, lambda: counted.count]) == [True, 5]
    assert counted.count == 6
    assert len(made) == 2
    assert [one() is None for one in made] == [False, True]  # that of the thread which has ended
    kept.clear()
    gc.collect()
    assert made[0]() is None


@pytest.mark.usefixtures("young")
def test_a_robot_that_many_threads_used_goes_and_is_sent_to_processes():
    robot = p3dof.load_robot(GALLERY / "gripper.urdf")
    at_once([robot.assemble] * 2)
    again = copy.deepcopy(robot)  # as pickle does it
    assert again.assemble().q.tobytes() == robot.assemble().q.tobytes()
    gone = weakref.ref(robot)
    del robot
    gc.collect()
    assert gone() is None


def refused(job: Callable[[], Any]) -> InputError:
    """What a job in another thread is refused with."""
    with pytest.raises(InputError) as info:
        at_once([job])
    return info.value


def test_what_can_be_one_threads_only_says_so():
    guard = OneThread("the buffers")
    guard.check()
    guard.check()
    assert str(refused(guard.check)) == "the buffers: another thread uses it"
    assert at_once([guard.give, copy.deepcopy(guard).check]) == [None, None]
    with pytest.raises(InputError, match="another thread uses it"):
        guard.check()


def test_buffers_that_are_bound_belong_to_one_thread():
    bound = p3dof.load().kernels.bind_inverse_dynamics()
    at_once([bound.run])  # whoever runs it first, also if another thread has bound it
    for call in (bound.run, lambda: bound(np.zeros((3, 3)))):
        with pytest.raises(InputError, match="bind one in each thread: another thread uses it"):
            call()


def test_bound_functions_of_a_robot_belong_to_one_thread():
    compiled = p3dof.load_robot(GALLERY / "four_bar.urdf").compile(level="numpy")
    bound = compiled.bind("step")
    bound.inputs["q"][:] = 0.1
    bound.run()
    assert "the arrays of this step, bind one in each thread" in str(refused(bound.run))


def test_an_integral_belongs_to_one_run():
    """Of two runs at once with one controller, the one that began first is told."""
    robot, motion = p3dof.load(), p3dof.paper_motion(20)
    controller = p3dof.runs.PD(robot, motion, integral_time=0.1)
    inside, over = threading.Event(), threading.Event()

    def hold(time: float) -> np.ndarray:
        inside.set()
        assert over.wait(60)
        return 0.0 * time * np.ones(6)

    loop = p3dof.runs.ControlLoop(rate=100.0)

    def first() -> Any:
        return asked(lambda: robot.simulate(0.03, controller=controller, control=loop, wrench=hold))

    def second() -> Any:
        assert inside.wait(60)
        try:
            return robot.simulate(0.03, controller=controller, control=loop)
        finally:
            over.set()

    error, run = at_once([first, second])
    assert "the integral of this controller, give each run its own: another thread uses it" in str(error)
    alone = robot.simulate(0.03, controller=p3dof.runs.PD(robot, motion, integral_time=0.1), control=loop)
    np.testing.assert_array_equal(run.forces, alone.forces)


def slowly(make: Callable[..., Any]) -> Callable[..., Any]:
    """The same, but two threads that are let in at once are in it together."""
    both = threading.Barrier(2)

    def made(*given: Any, **options: Any) -> Any:
        with suppress(threading.BrokenBarrierError):
            both.wait(timeout=0.3)  # until one knows that the other has to wait
        return make(*given, **options)

    return made


def test_what_takes_long_is_compiled_once_for_all_threads(monkeypatch):
    robot = p3dof.load_robot(GALLERY / "four_bar.urdf")
    q = robot.assemble().q
    monkeypatch.setattr(CompiledLoop, "__init__", slowly(CompiledLoop.__init__))
    one, other = at_once([lambda: robot.compiled_for(q)] * 2)
    assert one is other
    monkeypatch.setitem(FUNCTIONS, "integrate", slowly(FUNCTIONS["integrate"]))
    first, second = at_once([lambda: one.function("integrate")] * 2)
    assert first is second


def test_threads_draw_into_one_scene_of_guests(monkeypatch):
    pytest.importorskip("meshcat", reason="meshcat not installed")
    pytest.importorskip("tornado", reason="tornado not installed")
    from p3dof.viewer import server
    from p3dof.viewer.live_viewer import LiveViewer

    monkeypatch.setattr(server, "guest_of", slowly(server.guest_of))
    with LiveViewer({"title": "nothing", "runs": []}, port=0) as viewer:
        one, other = at_once([lambda: viewer.guest] * 2)
    assert one is other


@pytest.mark.parametrize("name", ["mujoco", "drake"])
def test_an_engine_serves_one_thread_after_the_other(name):
    pytest.importorskip({"drake": "pydrake"}.get(name, name), reason=f"{name} not installed")

    def doors(engine: Any, k: int) -> Iterator[Door]:
        motion = p3dof.paper_motion(40)
        part = p3dof.Motion(
            *(column[k::4] for column in (motion.time, motion.pose, motion.velocity, motion.acceleration))
        )
        yield "forces", lambda: engine.forces(part)

    assert same_in_threads(doors, lambda: p3dof.methods.engines.load(name)) == {"forces"}
