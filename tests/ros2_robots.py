"""Small robots with a joint of several freedoms each, which ROS has as several joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from closed_loop_robots import ARM, BAR, ROD, joint, link, robot

import p3dof
from p3dof.loops import Closure, Sidecar

CRANK = (
    link("base"),
    link("crank", ROD),
    link("end"),
    joint("motor", "base", "crank", (0.1, 0.2, 0.3), (0.48, 0.6, 0.64), rpy=(0.3, -0.2, 0.5)),
    joint("end_joint", "crank", "end", (0.2, 0.1, 0.05), kind="fixed", rpy=(0.5, 0.2, 0.1)),
)


def _closed(parts, closures, **given):
    """The robot whose closures hold where all joints are zero: distances are those there."""
    bare = p3dof.load_robot(robot(*parts), Sidecar((), ("motor",), **given))
    data = bare.model.createData()
    pin.framesForwardKinematics(bare.model, data, pin.neutral(bare.model))
    at = {frame.name: data.oMf[i].translation for i, frame in enumerate(bare.model.frames)}
    found = [
        Closure(a, b, kind, length=float(np.linalg.norm(at[a] - at[b])) if kind == "distance" else None)
        for a, b, kind in closures
    ]
    return p3dof.load_robot(robot(*parts), Sidecar(tuple(found), ("motor",), **given))


def free():
    """A free body that is welded to the crank; its joint has a name that ROS does not know."""
    return _closed(
        [
            *CRANK,
            link("body", BAR),
            joint("loose body", "base", "body", kind="floating", rpy=(0.1, 0.2, -0.3)),
            link("mark"),
            joint("mark_joint", "body", "mark", (0.02, 0, 0.1), kind="fixed"),
        ],
        [("end", "mark", "6d")],
    )


def plane():
    """A sled in a plane behind three rods, and a wheel that turns without end with it."""
    return _closed(
        [
            *CRANK,
            link("sled", BAR),
            joint("glide", "base", "sled", (0.3, 0.3, 0.2), (0, 0, 1), "planar", (0.7, 0.4, -0.2)),
            link("wheel", ROD),
            joint("turn", "sled", "wheel", (0.1, 0.05, 0.02), (0.6, 0, 0.8), "continuous"),
            link("rim"),
            joint("rim_joint", "wheel", "rim", (0.05, 0.02, 0), kind="fixed"),
            link("near"),
            joint("near_joint", "sled", "near", (0.1, 0.05, 0), kind="fixed"),
            link("far"),
            joint("far_joint", "sled", "far", (-0.1, 0.15, 0), kind="fixed"),
        ],
        [(a, b, "distance") for a, b in (("near", "crank"), ("near", "end"), ("far", "end"), ("rim", "end"))],
    )


def ball():
    """A rod on a ball at the crank, whose tip is on a slider; it spins about itself as it likes."""

    def parts(origin):
        return [
            *CRANK,
            link("rod", ARM),
            joint("ball", "crank", "rod", (0.1, 0.2, -0.1), (0, 0, 1), "continuous", (0.2, 0.1, 0.6)),
            link("tip"),
            joint("tip_joint", "rod", "tip", (0.4, 0.1, 0), kind="fixed"),
            link("slider", ROD),
            joint("slide", "base", "slider", origin, (0.6, 0, 0.8), "prismatic"),
        ]

    given = {"joints": (("ball", "SPHERICAL"),)}
    bare = p3dof.load_robot(robot(*parts((0, 0, 0))), Sidecar((), ("motor",), **given)).model
    data = bare.createData()
    pin.framesForwardKinematics(bare, data, pin.neutral(bare))
    origin = data.oMf[bare.getFrameId("tip")].translation
    return _closed(parts(origin.tolist()), [("tip", "slider", "3d")], **given)


ROBOTS = {"free": free, "plane": plane, "ball": ball}
