"""Motions and runs of a closed-loop robot in Rerun: bodies that move, forces and gaps as series.

python docs/examples/robot_in_rerun.py run.rrd && rerun run.rrd
"""

import sys

import numpy as np
import pinocchio as pin
import rerun as rr

import p3dof


def log_bodies(recording, loop, at="robot"):
    """Draw each body as lines from its joint to what is fixed to it: joints, and the frames of closures."""
    model = loop.model
    recording.log(at, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    ends = {joint: [] for joint in range(model.njoints)}
    for joint in range(1, model.njoints):
        ends[model.parents[joint]].append(model.jointPlacements[joint].translation)
    for closure in loop.sidecar.closures:
        for frame in (model.frames[model.getFrameId(name)] for name in (closure.frame1, closure.frame2)):
            ends[frame.parentJoint].append(frame.placement.translation)
    for joint, name in enumerate(model.names):
        strips = [[np.zeros(3), end] for end in ends[joint] if np.linalg.norm(end) > 0]
        recording.log(f"{at}/{name}", rr.LineStrips3D(strips, radii=0.006), static=True)


def log_motion(recording, loop, time, q, series, at="robot"):
    """Send samples of a motion: placements of the bodies from q (N, nq), and series (N, n) by name."""
    data, times = loop.model.createData(), [rr.TimeColumn("time", duration=time)]
    places = np.empty((len(time), loop.model.njoints, 7))
    for k, configuration in enumerate(q):
        pin.forwardKinematics(loop.model, data, configuration)
        places[k] = [pin.SE3ToXYZQUAT(place) for place in data.oMi]
    for joint, name in enumerate(loop.model.names):
        columns = rr.Transform3D.columns(translation=places[:, joint, :3], quaternion=places[:, joint, 3:])
        recording.send_columns(f"{at}/{name}", times, columns)
    for name, values in series.items():
        for actuator, column in zip(loop.actuated, np.transpose(values), strict=True):
            recording.send_columns(f"{at}/{name}/{actuator}", times, rr.Scalars.columns(scalars=column))


if __name__ == "__main__":
    path = sys.argv[1] if len(sys.argv) > 1 else "run.rrd"
    robot = p3dof.load_robot("gallery/stewart.urdf")
    control = p3dof.runs.JointPD(
        robot, np.full(6, 0.6) + 0.04 * (-1.0) ** np.arange(6), 4e3, 2e2, gravity=True
    )
    run = p3dof.runs.simulate_robot(robot, 1.0, controller=control, samples=201)
    with rr.RecordingStream("p3dof") as stream:
        stream.save(path)
        log_bodies(stream, robot)
        log_motion(stream, robot, run.time, run.q, {"force": run.forces, "error": run.error})
    print(f"{len(run.time)} samples of {robot.model.njoints} bodies in {path}")
