"""A saved run is read with no trust in who made it: one error, bounded memory, all arrays fit."""

from __future__ import annotations

import io
import os
import re
import struct
import tracemalloc
import warnings
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import p3dof
from p3dof import FileError, Simulation
from p3dof.methods.registry import METHODS
from p3dof.runs import simulation


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    robot = p3dof.load()
    motion = p3dof.paper_motion(101).from_rest(0.2)
    found = robot.simulate(
        0.1,
        controller=p3dof.runs.PD(robot, motion),
        control=p3dof.runs.ControlLoop(200),
        method="virtual-power",
        samples=21,
    )
    return found.save(tmp_path_factory.mktemp("runs") / "run.npz").read_bytes()


@pytest.fixture(scope="module")
def arrays(saved):
    with np.load(io.BytesIO(saved)) as found:
        return dict(found)


def load(folder, data, **options):
    path = folder / "foreign.npz"
    path.write_bytes(data)
    return Simulation.load(path, **options)


def refused(folder, data, message=""):
    with pytest.raises(
        FileError, match=r"foreign\.npz: expected a run saved as \.npz \(" + message
    ) as caught:
        load(folder, data)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_what_is_saved_is_what_is_read(tmp_path, saved, arrays):
    found = load(tmp_path, saved)
    assert set(arrays) == set(simulation.FORM)
    assert replace(found, stop=None).finished
    assert not replace(
        found, stop=p3dof.runs.Stop("tilt limit", 0.1, "the platform at its upper limit")
    ).finished
    for name, column in found.to_columns().items():
        assert np.isfinite(column).all(), name
    assert load(tmp_path, found.save(tmp_path / "again.npz").read_bytes()).to_columns().keys()
    assert set(simulation.METHODS) == set(METHODS)


CHANGES = {
    "one row less": ("forces", lambda x: x[:-1], "forces: expected the shape"),
    "one column less": ("wrench", lambda x: x[:, :5], "wrench: expected the shape"),
    "one number": ("q", lambda _: 0.0, "q: expected the shape"),
    "a number where there are many": ("time", lambda _: 0.0, "time: expected the shape"),
    "transposed": ("pose", lambda x: x.T, "pose: expected the shape"),
    "text": ("forces", lambda x: x.astype(str), "forces: expected numbers"),
    "integers": ("forces", lambda x: x.astype(int), "forces: expected numbers"),
    "single precision": ("forces", lambda x: x.astype(np.float32), "forces: expected numbers of 8 bytes"),
    "complex": ("forces", lambda x: x + 0j, "forces: it is no array of numbers or text"),
    "objects": ("forces", lambda x: x.astype(object), "forces: it is no array of numbers or text"),
    "records": ("forces", lambda _: np.zeros(2, [("x", "f8")]), "forces: it is no array"),
    "not finite": ("sliders", lambda x: x + np.inf, "sliders: expected finite numbers"),
    "not a number": ("reference", lambda x: x * np.nan, "reference: expected finite numbers"),
    "times fall": ("time", lambda x: x[::-1].copy(), "time: expected strictly rising times"),
    "no samples": ("time", lambda x: x[:0], "time: expected at least one sample"),
    "names twice": ("joint_names", lambda x: np.full_like(x, "slide_a"), "joint_names: expected different"),
    "few names": ("joint_names", lambda x: x[:3], "joint_names: expected the shape"),
    "a method of its own": ("method", lambda _: np.array("magic"), "method: expected one of"),
    "an odd end": ("stop", lambda _: np.array(["boredom", "why"]), "stop: expected nothing, or one of"),
    "half an end": ("stop", lambda _: np.array(["accuracy"]), "stop: expected nothing, or one of"),
    "a long end": ("stop", lambda _: np.array(["accuracy", "x" * 20_000]), "stop: expected at most 10000"),
    "an end too many": ("stop", lambda _: np.array(["accuracy"] * 3), "expected at most 2"),
    "an end at no time": ("stop", lambda _: np.array(["accuracy", "x"]), "stop_time: expected a time if"),
    "a time of no end": ("stop_time", lambda _: np.array(1.0), "stop_time: expected a time if"),
    "less than nothing": ("seconds", lambda _: np.array(-1.0), "seconds: expected no negative"),
    "a fraction": ("evaluations", lambda _: np.array(1.5), "evaluations: expected a whole number"),
}


@pytest.mark.parametrize(("name", "change", "message"), CHANGES.values(), ids=CHANGES)
def test_arrays_that_do_not_fit_are_refused(tmp_path, arrays, name, change, message):
    stream = io.BytesIO()
    np.savez_compressed(stream, **(arrays | {name: change(arrays[name])}))
    refused(tmp_path, stream.getvalue(), re.escape(message))


def test_arrays_in_another_order_or_byte_order_are_the_same(tmp_path, arrays, saved):
    stream = io.BytesIO()
    np.savez(stream, **(arrays | {"q": np.asfortranarray(arrays["q"]), "v": arrays["v"].astype(">f8")}))
    one, other = load(tmp_path, stream.getvalue()).joints, load(tmp_path, saved).joints
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(one.v, other.v)


def packed(contents, method=zipfile.ZIP_DEFLATED, **options):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the name twice
        for name, data in contents:
            file.writestr(name, data, **options)
    return stream.getvalue()


def members(data):
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        return [(info.filename, file.read(info)) for info in file.infolist()]


def test_more_or_less_than_a_run_is_refused(tmp_path, saved):
    all_members = members(saved)
    refused(tmp_path, packed([*all_members, ("../../evil.npy", b"x")]), "it holds '../../evil.npy'")
    refused(tmp_path, packed([*all_members, ("x" * 5000, b"x")]), "it holds 'xxx")
    refused(tmp_path, packed([*all_members, all_members[0]]), "it holds 'time.npy', more than")
    refused(tmp_path, packed(all_members[1:]), "time is missing")
    refused(tmp_path, packed([]), "time is missing")
    refused(tmp_path, packed(all_members, zipfile.ZIP_LZMA), "time: it is packed by another method")
    refused(tmp_path, packed(all_members, zipfile.ZIP_BZIP2), "time: it is packed by another method")
    refused(tmp_path, b"PK\5\6" + b"\xff" * 16 + b"\0\0", "it does not end as")
    refused(tmp_path, packed([(f"{i}.npy", b"") for i in range(5_000)]), "it does not end as")
    refused(tmp_path, saved + b"\0", "it does not end as")
    refused(tmp_path, b"", "it is cut off")


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"(" * 300, "no array of"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (" + b"9" * 30 + b",), }\n", "at most 200000"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (1_0,), }\n", "no array of"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }\n", "no array of"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (10L,), }\n", "no array of"),
        (b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }\n", "no array of"),
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (199999,), }\n", "expected 16000.. bytes"),
        (b"{'descr': '<f8", "no array of"),
        (b"\xff" * 100, "no array of"),
    ],
)
def test_headers_that_claim_odd_things_are_refused(tmp_path, saved, header, message):
    content = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + b"\0" * 16
    found = [(name, content if name == "time.npy" else data) for name, data in members(saved)]
    refused(tmp_path, packed(found), f"(time: )?.*{message}")


def test_a_bomb_takes_no_memory(tmp_path, arrays):
    long = {name: np.zeros((250_000, 3)) for name in ("pose", "velocity")}
    rising = long | {"time": np.arange(250_000.0)}
    zeros = {"time": np.zeros(190_000)}
    for changed, message in (
        (rising, "at most 200000"),
        (zeros, "rising"),
        (long, "pose: expected the shape"),
    ):
        stream = io.BytesIO()
        np.savez_compressed(stream, **(arrays | changed))
        data = stream.getvalue()
        path = tmp_path / "foreign.npz"
        path.write_bytes(data)
        del stream, data
        tracemalloc.start()
        with pytest.raises(FileError, match=message):
            Simulation.load(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 5e6


def test_a_long_run_is_read_when_it_is_asked_for(tmp_path, saved):
    assert len(load(tmp_path, saved, max_samples=21)) == 21
    with pytest.raises(FileError, match="expected at most 20 samples, got 21"):
        load(tmp_path, saved, max_samples=20)
    for wrong in (0, True, 2.5, "many", None):
        with pytest.raises(p3dof.InputError, match="max_samples: expected a positive whole number"):
            load(tmp_path, saved, max_samples=wrong)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    there = [tmp_path, *(tmp_path / name for name in ("pipe", "loop", "nothing"))]
    for path in [*there, "/dev/zero", "nul\0", "a" * 300]:
        with pytest.raises(FileError, match=r"expected a run saved as \.npz"):
            Simulation.load(path)
    for wrong in (5, None, b"run.npz"):
        with pytest.raises(FileError, match="expected the path of a file"):
            Simulation.load(wrong)
