"""``out=``: the same numbers in the user's array, whatever it looks like; clear errors; no new memory."""

from __future__ import annotations

import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from machines import random_friction, random_machine, random_states

import p3dof
from p3dof._base.errors import InputError, ReachError, SingularityError
from p3dof.closed_form.compiled import MachineKernels, levels
from p3dof.methods import METHODS
from p3dof.methods.compiled import ForceDerivatives

MACHINE = random_machine(3)
COUNT = 24
STATES = random_states(MACHINE, 5, COUNT)
FAR = np.array([10.0, 0.0, 0.0])
"""A pose that no leg reaches."""


def part_of_states(shape):
    index = 0 if shape == () else slice(0, int(np.prod(shape)))
    widths = {"pose": 3, "velocity": 3, "acceleration": 3, "wrench": 6}
    return [getattr(STATES, name)[index].reshape(*shape, k).copy() for name, k in widths.items()]


def calls(robot, method, q, v, a, w):
    """Every call whose result is an array, by name, as a function of `out`."""
    sliders = robot.sliders(q, on_invalid="nan")
    return {
        "forces": lambda out: robot.forces(q, v, a, method=method, out=out),
        "loaded": lambda out: robot.forces(q, v, a, wrench=w, method=method, out=out),
        "forward": lambda out: robot.forward_dynamics(q, v, a, wrench=w, method=method, out=out),
        "jacobian": lambda out: robot.jacobian(q, method=method, out=out),
        "masses": lambda out: robot.mass_matrix(q, method=method, out=out),
        "sliders": lambda out: robot.sliders(q, out=out),
        "modes": lambda out: robot.forward_kinematics(sliders, all_modes=True, out=out),
        "coriolis": lambda out: robot.coriolis_matrix(q, v, out=out),
        "gravity": lambda out: robot.gravity_forces(q, out=out),
    }


def arrays_of(shape):
    """Arrays of a shape that lie in memory in many ways, by name."""
    yield "plain", np.full(shape, 7.0)
    yield "by columns", np.full(shape, 7.0, order="F")
    yield "beside others", np.full((*shape, 2), 7.0)[..., 1]
    yield "backwards", np.full(shape, 7.0)[..., ::-1]
    if len(shape) > 1:
        yield "every other row", np.full((2 * shape[0], *shape[1:]), 7.0)[::2]
        yield "swapped", np.moveaxis(np.full((*shape[1:], shape[0]), 7.0), -1, 0)
    yield "packed", np.zeros(shape, dtype=[("flag", "i1"), ("value", "f8")])["value"]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", [(), (COUNT,), (4, 6), (0,)])
def test_every_result_goes_into_any_array(method, shape):
    robot = p3dof.load(MACHINE)
    for name, call in calls(robot, method, *part_of_states(shape)).items():
        expected = call(None)
        kinds = list(arrays_of(expected.shape))
        for kind, out in (
            kinds if method == "compiled" else kinds[::3]
        ):  # the others write into any array alike
            assert call(out) is out, (name, kind)
            np.testing.assert_array_equal(out, expected, err_msg=f"{name}, {kind}")


@pytest.mark.parametrize("level", levels())
@pytest.mark.parametrize("friction", [False, True])
def test_at_every_level(level, friction):
    machine = replace(MACHINE, friction=random_friction(np.random.default_rng(0))) if friction else MACHINE
    robot = p3dof.load(machine)
    robot.kernels = MachineKernels(machine, level)
    for shape in ((), (COUNT,)):
        for name, call in calls(robot, "compiled", *part_of_states(shape)).items():
            expected = call(None)
            out = np.empty(expected.shape)
            assert call(out) is out
            np.testing.assert_array_equal(out, expected, err_msg=name)


def test_poses_go_there_too():
    robot, motion = p3dof.load(), p3dof.paper_motion(50)
    sliders = robot.sliders(motion.pose)
    out = np.empty_like(sliders)
    assert robot.forward_kinematics(sliders, out=out) is out
    np.testing.assert_allclose(out, motion.pose, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(out, robot.forward_kinematics(sliders))
    with pytest.raises(ReachError):
        robot.forward_kinematics([0, 5, 0], out=out[0])
    assert np.isnan(out[0]).all()


def beside(shape):
    """An array of a shape in one that has a further row and a further column of samples."""
    whole = np.full((*(n + 1 for n in shape[:2]), *shape[2:]), 7.0)
    return whole[tuple(slice(n) for n in shape)]


@pytest.mark.parametrize("shape", [(), (COUNT,), (4, 6)])
def test_derivatives_go_into_earlier_results(shape):
    robot = p3dof.load(MACHINE)
    q, v, a, w = part_of_states(shape)
    expected = robot.force_derivatives(q, v, a, wrench=w)
    whole = [np.full((*shape, 5, 5), 7.0)[..., :3, 1:4] for _ in range(3)]
    for out in (
        robot.force_derivatives(q, 2 * v, a),
        ForceDerivatives(np.empty((*shape, 3)), *whole),
        ForceDerivatives(np.empty((3, *shape)).T.reshape(expected.forces.shape), *whole),
        ForceDerivatives(*(beside(array.shape) for array in expected.arrays)),
    ):
        assert robot.force_derivatives(q, v, a, wrench=w, out=out) is out
        for one, other in zip(out.arrays, expected.arrays, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.filterwarnings("ignore:beyond what the machine can do")  # 10 m
def test_earlier_results_that_do_not_fit_are_refused():
    robot = p3dof.load(MACHINE)
    q, v, a, _ = part_of_states((COUNT,))
    known = robot.force_derivatives(q, v, a)
    with pytest.raises(InputError, match="out: expected ForceDerivatives, got a ndarray"):
        robot.force_derivatives(q, v, a, out=known.forces)
    with pytest.raises(InputError, match=r"out\.forces: expected shape \(23, 3\), got \(24, 3\)"):
        robot.force_derivatives(q[1:], v[1:], a[1:], out=known)
    twice = replace(known, by_velocity=known.by_pose)
    with pytest.raises(InputError, match=r"out\.by_velocity: expected memory of its own"):
        robot.force_derivatives(q, v, a, out=twice)
    with pytest.raises(InputError, match="out: expected InverseKinematics, got a ndarray"):
        robot.inverse_kinematics(q, out=q)
    with pytest.raises(ReachError):
        robot.force_derivatives(FAR, v, a, out=known)
    assert all(np.isnan(array).all() for array in known.arrays)


def test_inverse_kinematics_are_written_again():
    robot = p3dof.load(MACHINE)
    q, *_ = part_of_states((COUNT,))
    expected, out = robot.inverse_kinematics(q), robot.inverse_kinematics(q[::-1])
    kept = out.sliders
    assert robot.inverse_kinematics(q, out=out) is out
    assert out.sliders is kept
    np.testing.assert_array_equal(out.sliders, expected.sliders)
    for name, values in expected.angles.items():
        np.testing.assert_array_equal(out.angles[name], values)
    with pytest.raises(ReachError):
        robot.inverse_kinematics(np.full((COUNT, 3), FAR), out=out)
    assert np.isnan(out.sliders).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [1, COUNT])
def test_what_does_not_fit_is_refused_and_stays_as_it_was(method, count):
    robot = p3dof.load(MACHINE)
    shape = () if count == 1 else (count,)
    q, v, a, _ = part_of_states(shape)
    locked = np.full((*shape, 3), 7.0)
    locked.setflags(write=False)
    one_more = np.full(((count + 1) * 3), 7.0)
    repeated = np.lib.stride_tricks.as_strided(np.full(3, 7.0), (*shape, 3), (0,) * (len(shape) + 1))
    twice = np.lib.stride_tricks.as_strided(np.full(3, 7.0), (2, 3), (0, 8))
    wrong = {
        "expected an array of float64, got a list": np.zeros((*shape, 3)).tolist(),
        "expected an array of float64, got one of float32": np.full((*shape, 3), 7.0, np.float32),
        "expected an array of float64, got one of >f8": np.full((*shape, 3), 7.0, ">f8"),
        r"expected shape \(.*3,?\), got": one_more,
        "expected a writable array, got a read-only one": locked,
        "expected a place for every number, got an array that repeats some": repeated,
    }
    for words, out in wrong.items():
        with pytest.raises(InputError, match=f"^out: {words}"):
            robot.forces(q, v, a, method=method, out=out)
        assert isinstance(out, list) or (out == 7).all()
    with pytest.raises(InputError, match=r"^out: expected a place for every number"):
        robot.forces(*np.zeros((3, 2, 3)), method=method, out=twice)
    assert (twice == 7).all()
    before = v.copy()
    for out in (v, v[..., ::-1]):
        with pytest.raises(
            InputError, match=r"^out: expected memory of its own, got an array that shares some"
        ):
            robot.forces(q, v, a, method=method, out=out)
    np.testing.assert_array_equal(v, before)


def test_beside_an_input_is_not_among_it():
    robot = p3dof.load(MACHINE)
    q, v, a, _ = part_of_states((COUNT,))
    expected = robot.forces(q, v, a, method="compiled")
    for count in (COUNT, 1):
        table = np.column_stack((q, v, a, np.zeros((COUNT, 3))))[:count]
        rows = [np.squeeze(table[:, k : k + 3]) for k in (0, 3, 6, 9)]
        robot.forces(*rows[:3], method="compiled", out=rows[3])
        np.testing.assert_array_equal(table[:, 9:], expected[:count])


@pytest.mark.filterwarnings("ignore:beyond what the machine can do")  # 1 km
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [1, COUNT])
def test_after_an_error_in_the_states_it_is_nan(method, count):
    robot = p3dof.load(MACHINE)
    shape = () if count == 1 else (count,)
    bad = {"nan": (np.nan, InputError), "far": (1e3, ReachError)}
    for number, error in bad.values():
        q, v, a, _ = part_of_states(shape)
        q[..., 0] = number
        out = np.full((*shape, 3), 7.0)
        with pytest.raises(error):
            robot.forces(q, v, a, method=method, out=out)
        assert np.isnan(out).all()
        robot.forces(q, v, a, method=method, out=out, on_invalid="nan")
        assert np.isnan(out).all()


def test_large_batches_take_no_memory_of_their_own():
    robot, count = p3dof.load(), 100_000
    q, v, a = np.random.default_rng(1).uniform(-0.1, 0.1, (3, count, 3))
    out = np.empty((count, 3))
    matrix = np.empty((count, 3, 3))

    def everything():
        robot.forces(q, v, a, method="compiled", out=out)
        robot.forward_dynamics(q, v, a, method="compiled", out=out)
        robot.mass_matrix(q, method="compiled", out=matrix)

    everything()  # traces the kernels
    tracemalloc.start()
    try:
        everything()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < count  # bytes: not one a sample


def test_derivatives_in_an_earlier_result_take_no_second_room():
    robot, count = p3dof.load(), 10_000
    q, v, a = np.random.default_rng(1).uniform(-0.1, 0.1, (3, count, 3))
    known = robot.force_derivatives(q, v, a)
    tracemalloc.start()
    try:
        robot.force_derivatives(q, v, a, out=known)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.5 * sum(array.nbytes for array in known.arrays)


def same_answer(robot, door, *arguments, **words):
    """What the call says to arrays of one sample and to the same as a batch of one: result, or error."""
    answers = []
    for batch in (False, True):
        given = [np.asarray(x)[None] for x in arguments] if batch else arguments
        try:
            found = getattr(robot, door)(*given, **words)
            answers.append(found[0] if batch else found)
        except p3dof.P3dofError as error:
            answers.append((type(error), re.sub(r" \(sample[^)]*\)", "", str(error))))
    return answers


@pytest.mark.filterwarnings("ignore:beyond what the machine can do")  # 1 km
def test_one_sample_is_what_a_batch_of_one_is():
    robot = p3dof.load(MACHINE)
    q, v, a, w = (part[0] for part in part_of_states((COUNT,)))
    for number in (None, np.nan, np.inf, 1e3, 1e300):
        for row in range(4):
            given = [q.copy(), v.copy(), a.copy(), w.copy()]
            if number is not None:
                given[row][0] = number  # of the wrench, what no kernel reads
            for on_invalid in ("raise", "nan"):
                words = {"on_invalid": on_invalid, "method": "compiled"}
                for door in ("forces", "forward_dynamics"):
                    one, many = same_answer(robot, door, *given[:3], wrench=given[3], **words)
                    assert type(one) is type(many)
                    np.testing.assert_array_equal(one, many)
                    one, many = same_answer(robot, door, *given[:3], **words)
                    assert type(one) is type(many)
                    np.testing.assert_array_equal(one, many)
                for door in ("jacobian", "mass_matrix"):
                    one, many = same_answer(robot, door, given[0], **words)
                    assert type(one) is type(many)
                    np.testing.assert_array_equal(one, many)
                for door in ("sliders", "forward_kinematics"):  # these know no other method
                    one, many = same_answer(robot, door, given[0], on_invalid=on_invalid)
                    assert type(one) is type(many)
                    np.testing.assert_array_equal(one, many)


@pytest.mark.skipif(levels()[-1] == "numpy", reason="no compiled kernels here")
@pytest.mark.parametrize("friction", [False, True])
def test_one_sample_is_answered_without_what_batches_take(friction, monkeypatch):
    machine = replace(MACHINE, friction=random_friction(np.random.default_rng(1))) if friction else MACHINE
    robot, (q, v, a, w) = p3dof.load(machine), part_of_states(())
    for name in ("states_of", "batch_of"):
        monkeypatch.setattr(f"p3dof.manipulator.{name}", None)
    for wrench in (None, w):
        words = {"wrench": wrench, "method": "compiled"}
        f = robot.forces(q, v, a, **words)
        np.testing.assert_allclose(robot.forward_dynamics(q, v, f, **words), a, rtol=1e-7)
        if not friction:
            found = robot.force_derivatives(q, v, a, wrench=wrench)
            M = robot.mass_matrix(q, method="compiled")
            J = robot.jacobian(q, method="compiled")
            np.testing.assert_allclose(J.T @ found.by_acceleration, M, rtol=0, atol=1e-9 * np.abs(M).max())
    np.testing.assert_allclose(robot.forward_kinematics(robot.sliders(q)), q, rtol=0, atol=1e-12)


@pytest.mark.filterwarnings("ignore:beyond what the machine can do")  # 10 m
@pytest.mark.parametrize("friction", [False, True])
def test_derivatives_of_one_sample_are_those_of_a_batch_of_one(friction):
    machine = replace(MACHINE, friction=random_friction(np.random.default_rng(1))) if friction else MACHINE
    for robot in (p3dof.load(machine), p3dof.load()):
        q, v, a, w = (part[0] for part in part_of_states((COUNT,)))
        for wrench in (None, w):
            one = robot.force_derivatives(0.5 * q, v.tolist(), a, wrench=wrench)
            many = robot.force_derivatives(0.5 * q[None], v[None], a[None], wrench=wrench)
            for each, other in zip(one.arrays, many.arrays, strict=True):
                np.testing.assert_array_equal(each, other[0])
        with pytest.raises(ReachError):
            robot.force_derivatives(FAR, v, a)
        assert np.isnan(robot.force_derivatives(FAR, v, a, on_invalid="nan").by_pose).all()


def test_one_sample_may_be_any_row_of_numbers():
    robot = p3dof.load(MACHINE)
    q, v, a, _ = (part[0] for part in part_of_states((COUNT,)))
    expected = robot.forces(q, v, a, method="compiled")
    table = np.column_stack((q, v, a))
    packed = np.zeros(3, dtype=[("flag", "i1"), ("value", "f8")])
    packed["value"] = a
    kinds = [q, q.tolist(), tuple(q.tolist()), list(q), table[:, 0], memoryview(q), q[:, None].T[0]]
    for kind in kinds:
        found = robot.forces(kind, v, packed["value"], method="compiled")
        assert type(found) is np.ndarray
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(
        robot.forces(q, [0, 0, True], [0, 0, 0], method="compiled"),
        robot.forces(q, [0.0, 0.0, 1.0], np.zeros(3, np.int8), method="compiled"),
    )
    for wrong in ([0, 0], "abc", [0, 0, "x"], [0, 0, 1j], 3.0, [0, 0, 10**400], {1, 2, 3}):
        with pytest.raises(InputError, match=r"^velocity: expected"):
            robot.forces(q, wrong, a, method="compiled")
    with pytest.raises(InputError, match="on_invalid: expected 'raise' or 'nan', got 'skip'"):
        robot.forces(q, v, a, method="compiled", on_invalid="skip")
    with pytest.raises(SingularityError):
        p3dof.load().forces([0, 0, np.arccos(0.25 / 0.5)], v, a, method="compiled")


def test_margins_of_many_poses_take_little_more_memory_than_the_result():
    robot, count = p3dof.load(), 50_000
    pose = np.random.default_rng(2).uniform(-0.3, 0.3, (count, 3))
    robot.singularity(pose[:10])
    tracemalloc.start()
    try:
        found = robot.singularity(pose)
        kept, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (peak - kept) / count < 100
    for some in (slice(0, 1), slice(4000, 4200), slice(None, None, 997)):
        part = robot.singularity(pose[some])
        for name in ("serial", "actuation", "determinant"):
            np.testing.assert_array_equal(getattr(part, name), getattr(found, name)[some])
