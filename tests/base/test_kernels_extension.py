"""The compiled kernels: the same numbers as NumPy at every level, whatever the memory looks like."""

from __future__ import annotations

import array
import ctypes
import gc
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import tracemalloc
import weakref
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import mpmath
import numpy as np
import pytest
from documents import ROOT
from machines import conditioning, random_friction, random_machine, random_states

import p3dof
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof._native.sources import PACKAGE, fingerprint, is_cut_off
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled import kernels
from p3dof.closed_form.compiled.formulas import WITH_FRICTION, all_kernels, is_symmetric, kernel
from p3dof.closed_form.compiled.reduced import model_of
from p3dof.closed_form.compiled.reduced.dynamics import friction_numbers
from p3dof.codegen.batch import ONE_LOOP, kernel_code

COMPILER = (sysconfig.get_config_var("CC") or "cc").split()[0]
CAN_BUILD = shutil.which(COMPILER) and Path(sysconfig.get_path("include"), "Python.h").exists()

try:
    from p3dof._native import _compiled
except ImportError:
    if CAN_BUILD and not os.environ.get("P3DOF_NO_EXTENSION"):
        raise  # a compiler is there: the install should have built it
    pytest.skip("the extension was not built", allow_module_level=True)

GENERAL = random_machine(1)
LENGTHS = (0, 1, 7, 8, 9, 79, 80, 81, 1000, 10_003)
BY_CLANG = b"clang version" in Path(_compiled.__file__).read_bytes()
"""It fuses products and sums of one sample and of vectors differently."""
each_level = pytest.mark.parametrize("level", _compiled.levels)
each_kernel = pytest.mark.parametrize("used", all_kernels(), ids=lambda used: used.name)


def machine_for(used):
    return p3dof.PAPER if used.name.endswith("_symmetric") else GENERAL


def constants_of(used):
    """The machine's numbers for a kernel, with some friction where it takes any."""
    friction = friction_numbers(random_friction(np.random.default_rng(7)))
    return used.of(model_of(machine_for(used)), friction if used.name.startswith(WITH_FRICTION) else ())


def columns_for(used, count, seed=1):
    """The inputs of a kernel at random states, by column, and the conditioning of these."""
    machine = machine_for(used)
    states = random_states(machine, seed, min(count, 1200))
    rng = np.random.default_rng(seed)
    q, v, a, w = states.pose, states.velocity, states.acceleration, states.wrench
    rows = {"y z theta": q, "vy vz vtheta": v, "ay az atheta": a, "w_y w_z w_theta": w[:, WRENCH_ROWS]}
    rows["f_a f_b f_c"] = rng.normal(0, 100, q.shape)
    rows["slide_a slide_b slide_c"] = kinematics.inverse_kinematics(machine.geometry, q).sliders
    named = {name: values[:, k] for names, values in rows.items() for k, name in enumerate(names.split())}
    repeated = np.arange(count) % max(1, len(q))
    condition = conditioning(machine.geometry, q)
    return [named[name][repeated] for name in used.inputs], condition[repeated]


def run(used, level, inputs, outputs=None):
    """The outputs of a kernel, margin included, and what the call returned."""
    if outputs is None:
        outputs = [np.full(len(inputs[0]), np.nan) for _ in used.outputs]
    call = _compiled.Call(used.name, level, constants_of(used), inputs, outputs)
    return outputs, call()


def inverse(level, inputs, outputs):
    """A call of the general inverse dynamics."""
    used = kernel("inverse_dynamics")
    return _compiled.Call(used.name, level, used.of(model_of(GENERAL)), inputs, outputs)


@each_level
@each_kernel
def test_every_kernel_gives_what_its_formula_gives_on_arrays(used, level):
    assert is_symmetric(model_of(p3dof.PAPER))
    assert _compiled.kernels[used.name] == (len(used.constants), len(used.inputs), len(used.outputs))
    inputs, condition = columns_for(used, 1003)
    found, good = run(used, level, inputs)
    expected = used.on_arrays(*constants_of(used), *inputs)
    assert good
    for one, other in zip(found, expected, strict=True):
        assert np.all(np.abs(one - other) <= 1e-14 * condition * np.abs(other).max())


def laid_out(values, layout):
    """The same numbers in other memory: a column for each of `values`."""
    count, width = len(values[0]), len(values)
    if layout == "apart":
        return [column.copy() for column in values]
    if layout == "backwards":
        return [column[::-1].copy()[::-1] for column in values]
    if layout == "every fifth, odd start":
        memory = np.full((width, 5 * count + 3), np.nan)
        columns = list(memory[:, 3::5])
    elif layout == "rows of all":
        columns = list(np.full((count, width), np.nan).T)
    elif layout == "rows of three":
        rows = [np.full((count, 3), np.nan) for _ in range(width)]
        columns = [rows[k // 3][:, k % 3] for k in range(width)]
    elif layout == "pairs in rows of three":
        rows = [np.full((count, 3), np.nan) for _ in range(width)]
        columns = [rows[k // 2][:, k % 2] for k in range(width)]
    elif layout == "rows of three, backwards":
        rows = [np.full((count, 3), np.nan)[::-1] for _ in range(width)]
        columns = [rows[k // 3][:, k % 3] for k in range(width)]
    elif layout == "mixed":
        pair = np.full((count, 4), np.nan)
        columns = [pair[:, k] if k in {1, 2} else np.full(count, np.nan) for k in range(width)]
    for column, numbers in zip(columns, values, strict=True):
        column[:] = numbers
    return columns


LAYOUTS = (
    "apart",
    "backwards",
    "every fifth, odd start",
    "rows of all",
    "rows of three",
    "pairs in rows of three",
    "rows of three, backwards",
    "mixed",
)


@each_level
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("count", LENGTHS)
def test_the_layout_of_the_memory_does_not_matter(level, layout, count):
    for used in (kernel("inverse_dynamics"), kernel("inverse_dynamics_derivatives", symmetric=True)):
        if count > 1000 and len(used.outputs) > 4:
            continue
        inputs, condition = columns_for(used, count)
        expected, good = run(used, level, inputs)
        empty = [np.full(count, np.nan) for _ in used.outputs]
        found, also_good = run(used, level, laid_out(inputs, layout), laid_out(empty, layout))
        assert good
        assert also_good
        for one, other in zip(found, expected, strict=True):
            scale = 1e-14 * condition * np.abs(other).max(initial=0)
            assert np.all(np.abs(one - other) <= scale)


@each_level
@pytest.mark.parametrize("count", LENGTHS)
def test_an_input_of_stride_zero_is_one_number_for_all_samples(level, count):
    used = kernel("inverse_dynamics_loaded", symmetric=True)
    inputs, _ = columns_for(used, max(1, count))
    for k in range(1, len(inputs), 2):
        inputs[k] = np.broadcast_to(inputs[k][:1], len(inputs[0]))
    inputs = [column[:count] for column in inputs]
    found, _ = run(used, level, inputs)
    expected, _ = run(used, level, [column.copy() for column in inputs])
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * np.abs(other).max(initial=0))


@each_level
@pytest.mark.parametrize("layout", ["apart", "rows of three"])
def test_a_part_writes_its_samples_and_no_others(level, layout):
    inputs, _ = columns_for(kernel("inverse_dynamics"), 500)
    whole, parts = ([np.full(500, np.nan) for _ in range(4)] for _ in range(2))
    whole, parts = laid_out(whole, layout), laid_out(parts, layout)
    inputs = laid_out(inputs, layout)
    assert inverse(level, inputs, whole)()
    call = inverse(level, inputs, parts)
    assert (call.kernel, call.level, call.size) == ("inverse_dynamics", level, 500)
    ends = [3, 3, 4, 11, 100, 355, 499]
    for start, stop in pairwise(ends):
        assert call(start, stop) is True
    assert call(500, 500)
    for one, other in zip(parts, whole, strict=True):
        assert np.isnan(one[:3]).all()
        assert np.isnan(one[499:]).all()
        np.testing.assert_allclose(one[3:499], other[3:499], rtol=0, atol=1e-13 * np.abs(other).max())


@each_level
@pytest.mark.parametrize("layout", ["apart", "rows of three"])
def test_threads_share_the_work(level, layout):
    inputs, _ = columns_for(kernel("inverse_dynamics"), 100_003)
    inputs = laid_out(inputs, layout)
    whole, parts = (laid_out([np.full(100_003, np.nan)] * 4, layout) for _ in range(2))
    assert inverse(level, inputs, whole)()
    call = inverse(level, inputs, parts)
    ends = np.linspace(0, 100_003, 24).astype(int)
    with ThreadPoolExecutor(4) as pool:
        assert all(list(pool.map(call, ends[:-1], ends[1:])))
    for one, other in zip(parts, whole, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * np.abs(other).max())


@each_level
@pytest.mark.parametrize("layout", ["apart", "rows of three"])
@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e6, 10.0])  # too many turns, out of reach
def test_one_bad_sample_is_told_whoever_has_the_margin(level, layout, kept, bad):
    inputs, _ = columns_for(kernel("inverse_dynamics"), 2500)
    column = kernel("inverse_dynamics").inputs.index("y" if bad == 10.0 else "theta")
    for index in (0, 79, 80, 1023, 1024, 1999, 2499):
        changed = [values.copy() for values in inputs]
        changed[column][index] = bad
        outputs = [np.empty(2500) for _ in range(4)]
        call = inverse(level, laid_out(changed, layout), [*outputs[:3], outputs[3] if kept else None])
        assert call() is False
        assert call(index, index + 1) is False
        assert call(0, index)
        assert call(index + 1, 2500)
        assert not np.isfinite([column[index] for column in outputs[:3]]).all() or bad == 10.0
        if kept:
            assert np.flatnonzero(~(outputs[3] > 0)).tolist() == [index]


INPUTS = kernel("inverse_dynamics").inputs


def arrays(count=5):
    return [np.full(count, 0.1) for _ in INPUTS], [np.empty(count) for _ in range(4)]


def with_input(value):
    inputs, outputs = arrays()
    return ("inverse_dynamics", "baseline", NUMBERS, [*inputs[:3], value, *inputs[4:]], outputs)


def with_output(value, index=2):
    inputs, outputs = arrays()
    outputs[index] = value
    return ("inverse_dynamics", "baseline", NUMBERS, inputs, outputs)


def with_first(kernel_name="inverse_dynamics", level="baseline", constants=None):
    return (kernel_name, level, NUMBERS if constants is None else constants, *arrays())


def read_only():
    values = np.empty(5)
    values.setflags(write=False)
    return values


def shared(shift):
    """An output that lies in an input's memory, or among it."""
    inputs, outputs = arrays()
    memory = np.full((5, 4), 0.1)
    inputs[2], outputs[1] = memory[:, 0], memory[:, shift]
    return ("inverse_dynamics", "baseline", NUMBERS, inputs, outputs)


NUMBERS = kernel("inverse_dynamics").of(model_of(GENERAL))
MISALIGNED = np.frombuffer(bytearray(41), np.uint8)[1:].view(np.float64)
REFUSED = {
    "kernel": (with_first(kernel_name="statics"), ValueError, "no kernel 'statics'"),
    "kernel's type": (with_first(kernel_name=3), TypeError, "must be str"),
    "level": (with_first(level="sse9"), ValueError, "no level 'sse9'"),
    "too few constants": (with_first(constants=NUMBERS[1:]), ValueError, f"{len(NUMBERS)} constants, not"),
    "constants that are no buffer": (with_first(constants=list(NUMBERS)), TypeError, "constants.* not list"),
    "a list": (with_input([0.1] * 5), TypeError, "input 3 must be a buffer of doubles, not list"),
    "nothing": (with_input(None), TypeError, "input 3 must be a buffer of doubles, not NoneType"),
    "floats": (with_input(np.ones(5, np.float32)), TypeError, r"input 3 must hold doubles .* 'f'"),
    "integers": (with_input(np.ones(5, int)), TypeError, r"input 3 must hold doubles .* 'l'|'q'"),
    "other bytes": (with_input(np.ones(5, np.dtype(float).newbyteorder())), TypeError, "doubles"),
    "bytes": (with_input(b"12345"), TypeError, "input 3 must hold doubles"),
    "a table": (with_input(np.ones((5, 1))), ValueError, "input 3 must have one dimension, not 2"),
    "too long": (with_input(np.ones(6)), ValueError, "input 3 has 6 samples, but input 0 has 5"),
    "misaligned": (with_input(MISALIGNED), ValueError, "input 3 must be aligned"),
    "too few inputs": (
        ("inverse_dynamics", "baseline", NUMBERS, *[a[:3] for a in arrays()]),
        ValueError,
        "inputs, not 3",
    ),
    "inputs that are no sequence": (("inverse_dynamics", "baseline", NUMBERS, 3, []), TypeError, "iterable"),
    "read-only output": (with_output(read_only()), ValueError, "output 2 must be writable"),
    "an output too short": (with_output(np.empty(4)), ValueError, "output 2 has 4 samples"),
    "an output of stride 0": (
        with_output(np.lib.stride_tricks.as_strided(np.empty(1), (5,), (0,))),
        ValueError,
        "output 2 must have room",
    ),
    "no output but the margin": (with_output(None, 1), TypeError, "output 1 must be a buffer"),
    "output in the input": (shared(0), ValueError, "output 1 shares memory with input 2"),
}


@pytest.mark.usefixtures("young")
@pytest.mark.parametrize(("arguments", "error", "message"), REFUSED.values(), ids=REFUSED)
def test_bad_input_is_refused_and_nothing_is_kept(arguments, error, message):
    held = [item for argument in arguments[2:] if isinstance(argument, list) for item in argument]
    before = list(map(sys.getrefcount, held))
    for _ in range(20):
        with pytest.raises(error, match=message):
            _compiled.Call(*arguments)
    gc.collect()
    assert all(after < one + 10 for after, one in zip(map(sys.getrefcount, held), before, strict=True))


def test_outputs_among_the_inputs_memory_are_fine_when_no_number_is_shared():
    assert _compiled.Call(*shared(1))
    memory = np.full((len(INPUTS) + 4, 5), 0.1)
    for count in (0, 1, 5):
        assert _compiled.Call(
            "inverse_dynamics", "baseline", NUMBERS, list(memory[:-4, :count]), list(memory[-4:, :count])
        )
    same = memory[-1, :0]
    assert _compiled.Call("inverse_dynamics", "baseline", NUMBERS, list(memory[:-4, :0]), [same] * 4)()


@pytest.mark.parametrize("part", [(-1, 3), (3, 2), (0, 6), (6, 6), (0, 2**80)])
def test_a_part_outside_the_samples_is_refused(part):
    call = _compiled.Call(*with_first())
    with pytest.raises(ValueError, match=r"part|fit"):
        call(*part)


@pytest.mark.parametrize("arguments", [(1,), (0, 1, 2), (0.0, 1.0), ("a", "b")])
def test_a_call_takes_nothing_or_two_integers(arguments):
    call = _compiled.Call(*with_first())
    with pytest.raises(TypeError):
        call(*arguments)
    with pytest.raises(TypeError):
        call(start=0, stop=1)


@pytest.mark.usefixtures("young")
def test_buffers_live_as_long_as_their_call():
    inputs = [array.array("d", [0.1] * 4) for _ in INPUTS]
    outputs = [array.array("d", [0.0] * 4) for _ in range(4)]
    call = _compiled.Call("inverse_dynamics", "baseline", NUMBERS, inputs, outputs)
    with pytest.raises(BufferError):
        inputs[3].append(1.0)
    with pytest.raises(BufferError):
        outputs[0].pop()
    call()
    del call
    inputs[3].append(1.0)
    outputs[0].pop()

    call = _compiled.Call(*with_first())  # nobody else holds these arrays
    gc.collect()
    call()


class Holder(np.ndarray):
    """An array that can hold on to the call that holds it."""


@pytest.mark.usefixtures("young")
def test_a_cycle_through_a_buffer_is_collected():
    inputs, outputs = arrays()
    inputs[0] = inputs[0].view(Holder)
    inputs[0].call = _compiled.Call("inverse_dynamics", "baseline", NUMBERS, inputs, outputs)
    gone = weakref.ref(inputs[0])
    del inputs
    gc.collect()
    assert gone() is None


@pytest.mark.usefixtures("young")
def test_calls_keep_no_memory():
    inputs, outputs = arrays(100)
    call = inverse("baseline", inputs, outputs)
    function = _compiled.Function("inverse_dynamics", "baseline", NUMBERS)
    numbers = [0.1] * len(INPUTS)

    def use(times):
        for _ in range(times):
            call()
            call(3, 9)
            function(*numbers)
        for _ in range(times // 20):
            inverse("baseline", inputs, outputs)()
            _compiled.Function("inverse_dynamics", "baseline", NUMBERS)

    use(1000)
    tracemalloc.start()
    try:
        use(1000)
        before = tracemalloc.get_traced_memory()[0]
        use(20_000)
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < 5000
    finally:
        tracemalloc.stop()
    assert sys.getrefcount(_compiled.Call) < 1000


@each_level
@each_kernel
def test_a_function_of_numbers_is_a_call_of_one_sample(used, level):
    function = _compiled.Function(used.name, level, constants_of(used))
    assert (function.kernel, function.level) == (used.name, level)
    inputs, _ = columns_for(used, 4)
    for sample in zip(*inputs, strict=True):
        outputs, _ = run(used, level, [np.array([number]) for number in sample])
        found = function(*sample)
        assert all(type(number) is float for number in found)
        assert found == tuple(float(output[0]) for output in outputs)


def test_a_function_refuses_what_it_does_not_take():
    function = _compiled.Function("kinematics", "baseline", np.ones(_compiled.kernels["kinematics"][0]))
    for arguments in ((), (1.0, 2.0), (1.0,) * 4, (1.0, 2.0, "3"), (1.0, None, 3.0)):
        with pytest.raises(TypeError):
            function(*arguments)
    with pytest.raises(TypeError):
        function(1.0, 2.0, theta=3.0)
    with pytest.raises(ValueError, match="no kernel"):
        _compiled.Function("statics", "baseline", NUMBERS)
    with pytest.raises(ValueError, match="constants"):
        _compiled.Function("kinematics", "baseline", NUMBERS)


def sample_of(used, level="baseline"):
    """A kernel as a `Sample`: rows of three inputs, the first three outputs."""
    rows = len(used.inputs) // 3
    constants = constants_of(used)
    return _compiled.Sample(used.name, level, constants, rows * ((3, (0, 1, 2)),), (0, 1, 2), (3,), np.empty)


@each_level
@each_kernel
def test_a_sample_in_arrays_is_one_in_numbers(used, level):
    sample = sample_of(used, level)
    assert (sample.kernel, sample.level) == (used.name, level)
    function = _compiled.Function(used.name, level, constants_of(used))
    inputs, _ = columns_for(used, 4)
    for numbers in zip(*inputs, strict=True):
        rows = np.array(numbers).reshape(-1, 3)
        expected = function(*numbers)[:3]
        out = np.full((3, 2), np.nan)[:, 1]
        assert tuple(sample(None, *rows).tolist()) == expected
        assert sample(out, *rows[:, ::-1][:, ::-1]) is out
        assert tuple(out.tolist()) == expected
        assert tuple(sample(None, *rows.tolist()).tolist()) == expected


@each_level
@each_kernel
def test_rows_of_samples_are_those_of_a_call(used, level):
    sample, rows = sample_of(used, level), len(used.inputs) // 3
    for count in (1, 2, 79, 161):
        inputs, _ = columns_for(used, count)
        given = np.stack(inputs, axis=-1).reshape(count, rows, 3).transpose(1, 0, 2)
        expected = np.stack(run(used, level, inputs)[0][:3], axis=-1)
        np.testing.assert_array_equal(sample(None, *map(np.ascontiguousarray, given)), expected)
        out = np.full((count, 3), np.nan)
        assert sample(out, *given) is out  # rows farther apart
        np.testing.assert_array_equal(out, expected)
        if rows > 1:  # a row for all
            constant = [np.repeat(given[1][:1], count, axis=0), *given[2:]]
            single = [given[1][0], *given[2:]]
            np.testing.assert_array_equal(sample(None, given[0], *single), sample(None, given[0], *constant))


def test_rows_that_are_not_plain_are_left_alone():
    used = kernel("inverse_dynamics")
    sample = sample_of(used)
    q, v, a = (np.stack(columns, axis=-1) for columns in np.split(np.array(columns_for(used, 9)[0]), 3))
    far = q.copy()
    far[7, 0] = 1e3
    broken = v.copy()
    broken[8, 1] = np.nan
    longer, other = np.zeros((2001, 3)), np.zeros((8, 3))
    odd = np.zeros((9, 6))[:, ::2]
    for wrong in (broken, v.tolist(), other, np.zeros((9, 2)), odd, v.astype(np.float32), v[None], v[:0]):
        assert sample(None, q, wrong, a) is None
    assert sample(None, far, v, a) is None
    assert sample(None, longer, longer, longer) is None
    both, locked = np.zeros((12, 3)), np.zeros((9, 3))
    both[:9] = v
    locked.setflags(write=False)
    for out in (
        both[3:],
        np.zeros((8, 3)),
        np.zeros((9, 6))[:, ::2],
        np.zeros(3),
        locked,
        np.zeros((3, 9)).T,
    ):
        assert sample(out, q, both[:9], a) is None
    np.testing.assert_array_equal(both[:9], v)


def test_entries_of_a_sample_are_outputs_and_numbers():
    used = kernel("kinematics")
    constants = used.of(model_of(GENERAL))
    entries = (3, 1.0, 0.0, 4, 1.0, 0.0)
    sample = _compiled.Sample(used.name, "baseline", constants, ((5, (4, 0, 2)),), entries, (2, 3), np.empty)
    numbers = [0.2, 99.0, 0.3, 99.0, 0.1]
    found = _compiled.Function(used.name, "baseline", constants)(0.1, 0.2, 0.3)
    np.testing.assert_array_equal(sample(None, numbers), [[found[3], 1, 0], [found[4], 1, 0]])
    out = np.zeros((3, 4)).T[::2]
    assert sample(out, tuple(numbers)) is out
    np.testing.assert_array_equal(out, sample(None, numbers))
    np.testing.assert_array_equal(sample(None, np.array([numbers, numbers])), [out, out])
    assert sample(None, np.array([numbers, [0.2, np.nan, *numbers[2:]]])) is None  # what it does not read


def test_a_sample_that_is_not_plain_is_left_alone():
    used = kernel("inverse_dynamics")
    sample = sample_of(used)
    q, v, a = np.array([x[0] for x in columns_for(used, 4)[0]]).reshape(3, 3)
    broken = (
        [True, 0, 0],
        [0, "x", 0],
        [0, 0],
        [0, 0, 10**400],
        [np.nan, 0, 0],
        (0, 0, np.inf),
        "abc",
        b"abc",
        None,
    )
    for wrong in (
        *broken,
        v[:2],
        v[None],
        v.astype(np.float32),
        v.astype(">f8"),
        v.astype(object),
        1e300 * v,
    ):
        out = np.full(3, 7.0)
        assert sample(out, q, wrong, a) is None
        assert (out == 7).all()
    locked = np.zeros(3)
    locked.setflags(write=False)
    for wrong in (
        np.zeros(4),
        np.zeros((1, 3)),
        np.zeros(3, np.float32),
        locked,
        [0.0] * 3,
        v,
        v[::-1],
        "out",
    ):
        assert sample(wrong, q, v, a) is None
    for arguments in ((), (None, q, v), (None, q, v, a, a)):
        with pytest.raises(TypeError, match="an array or None and 3 arguments"):
            sample(*arguments)


def test_a_sample_refuses_what_does_not_fit_its_kernel():
    row, numbers = (3, (0, 1, 2)), np.ones(_compiled.kernels["kinematics"][0])
    good = ("kinematics", "baseline", numbers, (row,), (0, 1, 2), (3,), np.empty)
    assert _compiled.Sample(*good)(None, [0, 0]) is None
    wrong = {
        3: [
            (),
            (row, row),
            ((3, (0, 1, 3)),),
            ((3, (0, 1, -1)),),
            ((99, (0, 1, 2)),),
            ((0, ()),),
            (row, (3,)),
        ],
        4: [(0, 1), (0, 1, 99), (0, 1, -1), tuple(range(8)), (0, 1, None)],
        5: [(), (2,), (0,), (-3,), (3, 1, 1), ("3",)],
    }
    for place, values in wrong.items():
        for value in values:
            with pytest.raises((ValueError, TypeError)):
                _compiled.Sample(*good[:place], value, *good[place + 1 :])
    with pytest.raises(ValueError, match="no kernel"):
        _compiled.Sample("statics", *good[1:])


@pytest.mark.slow
def test_samples_keep_no_memory():
    used = kernel("inverse_dynamics")
    sample, rows, out = sample_of(used), np.zeros((3, 3)), np.empty(3)
    lists = rows.tolist()

    def use(times):
        for _ in range(times):
            sample(None, *rows)
            sample(out, *lists)
            sample(lists, *rows)
            sample(None, *rows[:2], "x")
        for _ in range(times // 20):
            sample_of(used)

    use(1000)
    tracemalloc.start()
    try:
        use(1000)
        before = tracemalloc.get_traced_memory()[0]
        use(20_000)
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < 5000
    finally:
        tracemalloc.stop()


def test_levels_and_kernels_cannot_be_changed():
    assert _compiled.levels[0] == "baseline"
    with pytest.raises(TypeError):
        _compiled.kernels["kinematics"] = (0, 0, 0)
    with pytest.raises(TypeError):
        _compiled.Call.size = 3
    with pytest.raises(AttributeError):
        _compiled.Call(*with_first()).size = 3


HARNESS = """
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#define P3DOF_INLINE inline __attribute__((always_inline))
#define P3DOF_TARGET {target}
#define P3DOF_NAME(f) f##_here
#define P3DOF_NEWTON
#include "vector_math.h"
P3DOF_TARGET void tangents(ptrdiff_t n, const double *restrict x, double *restrict t)
{{
    _Pragma("omp simd")
    for (ptrdiff_t i = 0; i < n; ++i)
        t[i] = tanh_here(x[i]);
}}
P3DOF_TARGET void roots(ptrdiff_t n, const double *restrict x, double *restrict y)
{{
    _Pragma("omp simd")
    for (ptrdiff_t i = 0; i < n; ++i)
        y[i] = rsqrt_here(x[i]);
}}
P3DOF_TARGET void angles(ptrdiff_t n, const double *restrict y, const double *restrict x, double *restrict a)
{{
    _Pragma("omp simd")
    for (ptrdiff_t i = 0; i < n; ++i)
        a[i] = atan2_here(y[i], x[i]);
}}
P3DOF_TARGET void sines(ptrdiff_t n, const double *restrict x, double *restrict s, double *restrict c)
{{
    _Pragma("omp simd")
    for (ptrdiff_t i = 0; i < n; ++i)
        sincos_here(x[i], &s[i], &c[i]);
}}
"""
TARGETS = {
    "baseline": "",
    "avx2": '__attribute__((target("avx2,fma")))',
    "avx512": '__attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma")))',
}


def library_of(folder, source):
    """C that includes the extension's headers, compiled as the extension is."""
    if not CAN_BUILD or os.name == "nt":
        pytest.skip("no compiler")
    (folder / "given.c").write_text(source)
    flags = ["-O2", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-fopenmp-simd", "-w"]
    headers = ROOT / "p3dof" / "_native"
    paths = ["-I", str(headers), str(folder / "given.c"), "-o", str(folder / "given.so")]
    subprocess.run([COMPILER, "-shared", "-fPIC", *flags, *paths], check=True)
    return ctypes.CDLL(str(folder / "given.so"))


@pytest.fixture(scope="module", params=_compiled.levels)
def functions(request, tmp_path_factory):
    """The functions that the kernels have, compiled here."""
    return library_of(tmp_path_factory.mktemp("functions"), HARNESS.format(target=TARGETS[request.param]))


def computed(function, count, *inputs):
    """So many results of a function of C, of arrays."""
    found = [np.empty_like(inputs[0]) for _ in range(count)]
    pointers = [ctypes.c_void_p(values.ctypes.data) for values in (*inputs, *found)]
    function(ctypes.c_ssize_t(len(inputs[0])), *pointers)
    return found


@pytest.fixture
def sines(functions):
    """Sine and cosine as the kernels have them, on arrays."""
    return lambda x: computed(functions.sines, 2, x)


def near_quarters(rng, count):
    """Numbers at and around multiples of π/2, and of π/4 between them."""
    quarters = rng.integers(-127_000, 127_001, count) * 0.5
    x = quarters * (np.pi / 2) * (1 + rng.integers(-2, 3, count) * np.finfo(float).eps)
    return x[np.abs(x) <= 1e5]


def test_sine_and_cosine_are_right_to_the_last_bit_but_one(sines):
    rng = np.random.default_rng(3)
    x = np.concatenate([rng.uniform(-7, 7, 200_000), rng.uniform(-1e5, 1e5, 200_000)])
    x = np.concatenate(
        [x, near_quarters(rng, 200_000), [0.0, 1e5, -1e5, 5e-324, 1e-200, np.pi / 4, -np.pi / 4]]
    )
    s, c = sines(x)
    exact = np.longdouble if np.finfo(np.longdouble).eps < 1e-18 else np.float64
    assert np.abs(s - np.sin(x.astype(exact))).max() < 2e-16
    assert np.abs(c - np.cos(x.astype(exact))).max() < 2e-16


def test_sine_and_cosine_where_they_vanish(sines):
    x = near_quarters(np.random.default_rng(4), 2000)
    s, c = sines(x)
    with mpmath.workdps(40):
        for angle, sine, cosine in zip(x.tolist(), s.tolist(), c.tolist(), strict=True):
            assert abs(mpmath.sin(angle) - sine) < 2e-16
            assert abs(mpmath.cos(angle) - cosine) < 2e-16


def test_sine_and_cosine_are_nan_for_what_they_do_not_take(sines):
    s, c = sines(np.array([np.nan, np.inf, -np.inf, np.nextafter(1e5, 2e5), -1.1e5, 1e300, -1e9, 1e17, 1e22]))
    assert np.isnan(s).all()
    assert np.isnan(c).all()


def test_the_hyperbolic_tangent_is_right_to_the_last_bits(functions):
    rng = np.random.default_rng(5)
    x = np.concatenate([rng.uniform(-25, 25, 200_000), rng.uniform(-1, 1, 200_000)])
    x = np.concatenate(
        [x, 10 ** rng.uniform(-300, 2, 100_000), [20.0, -20.0, 1e308, np.inf, -np.inf, 0.0, -0.0]]
    )
    (found,) = computed(functions.tangents, 1, x)
    exact = np.tanh(x.astype(np.longdouble if np.finfo(np.longdouble).eps < 1e-18 else float))
    assert np.all(np.abs(found - exact) <= 4e-16 * np.abs(exact))
    assert np.array_equal(np.signbit(found), np.signbit(x))
    assert np.isnan(computed(functions.tangents, 1, np.array([np.nan, np.nan]))).all()


def test_one_over_a_root_is_right_to_the_last_bits(functions):
    rng = np.random.default_rng(7)
    x = np.concatenate([rng.uniform(0, 4, 400_000), 10 ** rng.uniform(-300, 300, 200_000), [1.0, 4.0, 0.25]])
    (found,) = computed(functions.roots, 1, x)
    wide = np.longdouble if np.finfo(np.longdouble).eps < 1e-18 else float
    exact = 1 / np.sqrt(x.astype(wide))
    assert np.all(np.abs(found - exact) <= 2.5e-16 * exact)
    assert np.isnan(computed(functions.roots, 1, np.array([np.nan, np.nan]))).all()


def test_the_angle_of_a_point_is_right_to_the_last_bits(functions):
    rng = np.random.default_rng(6)
    y, x = rng.normal(size=(2, 300_000)) * 10 ** rng.uniform(-150, 150, (2, 300_000))
    near = rng.normal(size=300_000)
    y, x = np.concatenate([y, near]), np.concatenate([x, near * rng.uniform(-3, 3, 300_000)])
    corners = [
        (0.0, 1.0),
        (0.0, -1.0),
        (-0.0, -1.0),
        (1.0, 0.0),
        (-1.0, 0.0),
        (0.0, 0.0),
        (1.0, 1.0),
        (-1.0, -1.0),
    ]
    y, x = (np.concatenate([values, [c[k] for c in corners]]) for k, values in enumerate((y, x)))
    (found,) = computed(functions.angles, 1, y, x)
    wide = np.longdouble if np.finfo(np.longdouble).eps < 1e-18 else float
    exact = np.arctan2(y.astype(wide), x.astype(wide))
    assert np.all(np.abs(found - exact) <= 4e-16 * np.abs(exact))
    bad = np.array([np.nan, 1.0, np.nan, np.inf])
    assert np.isnan(computed(functions.angles, 1, bad, np.array([1.0, np.nan, np.nan, np.inf]))).all()


IN_ONE_LOOP = """
{harness}
#define P3DOF_SIMD _Pragma("omp simd")
#define P3DOF_ALIGNED __attribute__((aligned(64)))
#define P3DOF_ROW 8
#include "rows.h"
{kernels}
"""
CUT = [
    kernel("inverse_dynamics"),
    kernel("inverse_dynamics_loaded", symmetric=True),
    kernel("forward_dynamics_loaded"),
    kernel("coriolis_matrix"),
    kernel("mass_matrix", symmetric=True),
]


@pytest.fixture(scope="module", params=_compiled.levels)
def in_one_loop(request, tmp_path_factory):
    """The kernels of `CUT` as one loop over all samples, compiled here."""
    code = [kernel_code(used, in_blocks=False).replace("static ", "") for used in CUT]
    harness = HARNESS.format(target=TARGETS[request.param])
    source = IN_ONE_LOOP.format(harness=harness, kernels="\n".join(code))
    library = library_of(tmp_path_factory.mktemp("loops"), source)

    def compute(used, inputs):
        constants = constants_of(used)
        outputs = [np.full(len(inputs[0]), np.nan) for _ in used.outputs]
        rows = [(ctypes.c_void_p * len(c))(*(x.ctypes.data for x in c)) for c in (inputs, outputs)]
        count, numbers = ctypes.c_ssize_t(len(inputs[0])), ctypes.c_void_p(constants.ctypes.data)
        getattr(library, f"{used.name}_here")(count, numbers, *rows)
        return outputs

    return request.param, compute


def equal(found, expected, scale=None):
    """To the last bit, NaN included; to rounding where clang built the extension."""
    if BY_CLANG:
        scale = np.nanmax(np.abs(expected), initial=0) if scale is None else scale
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * scale)
    else:
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("used", CUT, ids=lambda used: used.name)
def test_two_loops_give_the_same_bits_as_one(used, in_one_loop):
    level, compute = in_one_loop
    assert used.name not in ONE_LOOP
    assert "between" in kernel_code(used, in_blocks=True)
    inputs, _ = columns_for(used, 1003)
    for k, bad in enumerate([np.nan, np.inf, 1e9, 10.0, -3e5]):  # samples that have no answer
        inputs[k % 3][17 * k + 5] = bad
    for count in (0, 1, 2, 3, 7, 8, 9, 15, 63, 64, 65, 79, 80, 81, 127, 128, 129, 159, 160, 161, 1003):
        part = [np.ascontiguousarray(column[:count]) for column in inputs]
        for one, other in zip(compute(used, part), run(used, level, part)[0], strict=True):
            equal(one, other)
    strided = [np.repeat(column, 3)[::3] for column in inputs]
    for one, other in zip(compute(used, inputs), run(used, level, strided)[0], strict=True):
        equal(one, other)


@each_level
@pytest.mark.parametrize("used", CUT, ids=lambda used: used.name)
def test_a_sample_has_the_same_bits_whatever_is_beside_it(used, level):
    inputs, _ = columns_for(used, 203)
    together, _ = run(used, level, inputs)
    for place in (0, 1, 77, 79, 80, 150, 199, 200, 201, 202):
        alone, _ = run(used, level, [column[place : place + 1].copy() for column in inputs])
        few, _ = run(used, level, [column[place - place % 3 : place + 5].copy() for column in inputs])
        for one, some, whole in zip(alone, few, together, strict=True):
            equal([one[0], some[place % 3]], [whole[place]] * 2, np.abs(whole).max())


def test_the_extension_is_of_the_sources_beside_it(tmp_path):
    assert _compiled.sources == fingerprint()
    for place in ("_native/generated", "_base/integrators", "_base/tracing"):
        shutil.copytree(PACKAGE / place, tmp_path / place, dirs_exist_ok=True)
    (tmp_path / "_base").joinpath("stable_abi.h").write_bytes((PACKAGE / "_base/stable_abi.h").read_bytes())
    for file in (PACKAGE / "_native").glob("*.[ch]"):
        shutil.copy(file, tmp_path / "_native")
    assert fingerprint(tmp_path) == _compiled.sources
    changed = tmp_path / "_native/generated/batch_kernels.h"
    changed.write_text(changed.read_text().replace("+", "-", 1))
    assert fingerprint(tmp_path) != _compiled.sources
    shutil.rmtree(tmp_path / "_native")
    assert fingerprint(tmp_path) is None  # as in a wheel: nothing can be said


@pytest.mark.skipif(sys.platform != "linux", reason="ELF is Linux's")
def test_an_extension_that_is_cut_off_is_not_loaded(monkeypatch, tmp_path):
    """It would end Python with SIGBUS, at every start."""
    whole = Path(importlib.util.find_spec("p3dof._native._compiled").origin)
    assert not is_cut_off(whole)
    data, cut = whole.read_bytes(), tmp_path / "_compiled.so"
    for size in (len(data) - 1, len(data) - 4096, len(data) // 2, 64):
        cut.write_bytes(data[:size])
        assert is_cut_off(cut)
    monkeypatch.setattr(kernels, "find_spec", lambda name: importlib.util.spec_from_file_location(name, cut))
    kernels._extension.cache_clear()
    try:
        with pytest.warns(UserWarning, match="the compiled extension is cut off: install the package again"):
            assert kernels.levels() == ("numpy",)
        assert kernels.in_words() == "numpy: the extension does not load, install it again"
    finally:
        kernels._extension.cache_clear()


def test_an_extension_of_other_sources_is_not_used(monkeypatch):
    """After an update of the sources alone it would give forces of other numbers of the machine."""
    kernels._extension.cache_clear()
    try:
        monkeypatch.setattr(kernels, "fingerprint", lambda: _compiled.sources + 1)
        with pytest.warns(UserWarning, match="compiled from other sources than are here: install"):
            assert kernels.levels() == ("numpy",)
        monkeypatch.delenv("P3DOF_LEVEL", raising=False)
        assert "other sources" in kernels.in_words()
        kernels._extension.cache_clear()
        monkeypatch.setattr(kernels, "fingerprint", lambda: None)
        assert len(kernels.levels()) > 1
    finally:
        kernels._extension.cache_clear()
