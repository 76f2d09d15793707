"""Rerun: `docs/examples/robot_in_rerun.py` logs motions and runs; what its file has is read back."""

import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT
from numpy.testing import assert_allclose, assert_array_equal

import p3dof
from p3dof.runs import JointPD, simulate_robot, simulate_robot_many

rerun = pytest.importorskip("rerun", reason="rerun not installed: pip install 'p3dof[adapters]'")
reading = pytest.importorskip("rerun.chunk", reason="this rerun-sdk has no rerun.chunk")
robot_in_rerun = pytest.importorskip("robot_in_rerun")
GALLERY = ROOT / "docs/_static/gallery"
SINGLE = 1e-6
"""Rerun keeps transforms and lines in single precision [m]."""


@pytest.fixture(scope="module")
def stewart():
    loop = p3dof.load_robot(GALLERY / "stewart.urdf")
    targets = np.full(6, 0.6) + 0.04 * (-1.0) ** np.arange(6)
    return loop, simulate_robot(
        loop, 0.3, controller=JointPD(loop, targets, 4e3, 2e2, gravity=True), samples=31
    )


def logged(path, *motions):
    """Log motions (loop, time, q, series, at) into a file, and return its chunks by the paths of entities."""
    with rerun.RecordingStream("p3dof") as stream:
        stream.save(path)
        for loop, *motion, at in motions:
            robot_in_rerun.log_bodies(stream, loop, at)
            robot_in_rerun.log_motion(stream, loop, *motion, at)
    found = {}
    for chunk in reading.RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        columns = found.setdefault(chunk.entity_path, {})
        for name in batch.schema.names:
            column = batch.column(name)
            if name == "time":
                columns[name] = np.array(column.cast("int64").to_pylist()) * 1e-9
            elif ":" in name:
                columns[name] = np.squeeze(np.array(column.to_pylist(), dtype=object))
    return found


def placements(columns):
    pairs = zip(columns["Transform3D:translation"], columns["Transform3D:quaternion"], strict=True)
    return [pin.XYZQUATToSE3(np.concatenate([xyz, turn]).astype(float)) for xyz, turn in pairs]


def gaps(loop, found, at):
    """How far the ends of each closure are apart, from what was logged alone."""
    model, largest = loop.model, 0.0
    for closure in loop.sidecar.closures:
        ends = []
        for frame in (model.frames[model.getFrameId(name)] for name in (closure.frame1, closure.frame2)):
            bodies = placements(found[f"/{at}/{model.names[frame.parentJoint]}"])
            ends.append([body.act(frame.placement.translation) for body in bodies])
        largest = max(largest, np.abs(np.subtract(*ends)).max())
    return largest


def test_bodies_forces_and_times_of_a_run_are_read_back(stewart, tmp_path):
    loop, run = stewart
    found = logged(tmp_path / "run.rrd", (loop, run.time, run.q, {"force": run.forces}, "robot"))
    data = loop.model.createData()
    for joint, name in enumerate(loop.model.names):
        columns = found[f"/robot/{name}"]
        assert_allclose(columns["time"], run.time, rtol=0, atol=1e-9)
        for place, q in zip(placements(columns), run.q, strict=True):
            pin.forwardKinematics(loop.model, data, q)
            assert_allclose(place.homogeneous, data.oMi[joint].homogeneous, rtol=0, atol=SINGLE)
    for i, name in enumerate(loop.actuated):
        columns = found[f"/robot/force/{name}"]
        assert_array_equal(columns["Scalars:scalars"].astype(float), run.forces[:, i])
    assert np.ptp(run.forces, axis=0).min() > 1.0
    assert gaps(loop, found, "robot") < 2 * SINGLE


def test_open_loops_are_seen(stewart, tmp_path):
    loop, run = stewart
    q = run.q.copy()
    q[:, loop.model.joints[loop.model.getJointId(loop.actuated[0])].idx_q] += 0.01
    found = logged(tmp_path / "open.rrd", (loop, run.time, q, {}, "robot"))
    assert gaps(loop, found, "robot") == pytest.approx(0.01, rel=0.3)


def test_lines_are_as_long_as_the_links(tmp_path):
    loop = p3dof.load_robot(GALLERY / "five_bar.urdf")
    found = logged(tmp_path / "lines.rrd", (loop, [0.0], loop.assemble().q[None], {}, "robot"))
    for side in ("left", "right"):
        for name, length in (("motor", 0.25), ("elbow", 0.4)):
            strips = found[f"/robot/{side}_{name}"]["LineStrips3D:strips"].astype(float)
            assert_allclose(strips, [[0, 0, 0], [length, 0, 0]], rtol=0, atol=SINGLE)


def test_each_run_of_many_has_its_path(tmp_path):
    loop = p3dof.load_robot(GALLERY / "five_bar.urdf")
    pd = JointPD(loop, [2.2, 0.9], 20.0, 0.5, gravity=True)
    many = simulate_robot_many(loop, 0.2, {"kd": [[0.3, 0.3], [1.0, 1.0]]}, pd, samples=21)
    past, times = many.past, many.sample_time
    motions = [(loop, times, past["q"][k], {"force": past["forces"][k]}, f"run_{k}") for k in range(2)]
    found = logged(tmp_path / "runs.rrd", *motions)
    for k in range(2):
        for i, name in enumerate(loop.actuated):
            read = found[f"/run_{k}/force/{name}"]["Scalars:scalars"].astype(float)
            assert_array_equal(read, past["forces"][k][:, i])
        assert gaps(loop, found, f"run_{k}") < 2 * SINGLE
    one, other = (found[f"/run_{k}/left_elbow"]["Transform3D:translation"][-1] for k in range(2))
    assert np.abs(np.subtract(one, other)).max() > 0.01
