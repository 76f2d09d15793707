"""The engine of the page, WebAssembly and its scripts, against Pinocchio and the tasks of Python, in Node."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from documents import ROOT
from machines import random_machine, random_states

from p3dof import Manipulator
from p3dof.closed_form import kinematics
from p3dof.design.tasks import Task, Waypoint
from p3dof.machine.parameters import PAPER, SLIDES, Actuators, Body, Friction, Geometry, of_solids
from p3dof.machine.parameters.solids import KINDS
from p3dof.viewer.document.encoding import encoded
from p3dof.viewer.machine.document import engine_row

WASM = ROOT / "p3dof/viewer/document/p3dof.wasm"
COUNT, BEYOND = 300, 40
FRICTION = Friction({"sliders": 30.0, "joints": 0.2}, {"sliders": 8.0, "hinge_a": 0.3}, 0.01)
MACHINES = {
    "the paper's": PAPER,
    "solids with friction": replace(of_solids(), friction=FRICTION),
    "tilted, with a payload": replace(PAPER, gravity=[1.0, -3.0, -9.0]).carrying(
        Body(3.0, [0.01, 0.02, -0.1], [0.01, 0.02, 0.015])
    ),
    "without symmetry": random_machine(5),
}
LONGER = Geometry(r=0.13, R=0.31, L=0.52, b=0.05)
SLOWED = Friction({"sliders": 40.0}, {"sliders": 6.0})
DRIVES = Actuators(
    dict(zip(SLIDES, (14.8, 3.0, 40.0), strict=True)),
    dict(zip(SLIDES, (48.0, -10.0, 55.0), strict=True)),
    {"slide_b": 495.0, "slide_c": -200.0},
    {"slide_c": 2.5},
)
ALUMINIUM = {
    "density": dict.fromkeys(KINDS, 2700.0) | {"platform": 4500.0, "slider": 1200.0, "leg": 1800.0},
    "dimensions": {"rod_radius": 0.012, "plate_thickness": 0.03},
}
CHANGES = {
    "2 kg below P": (
        {"payload": 2, "below": 0.15},
        PAPER.carrying(Body(2.0, [0, 0, -0.15], np.zeros((3, 3)))),
    ),
    "other lengths, bodies kept": ({"r": 0.13, "R": 0.31, "L": 0.52}, replace(PAPER, geometry=LONGER)),
    "other lengths, solids": (
        {"r": 0.13, "R": 0.31, "L": 0.52, "bodies": "solids"},
        of_solids(LONGER, limits=PAPER.limits),
    ),
    "other lengths, solids of aluminium with a heavy plate, by sizes of its own": (
        {"r": 0.13, "R": 0.31, "L": 0.52, "bodies": "solids"},
        replace(PAPER, geometry=LONGER, **ALUMINIUM).solid,
    ),
    "friction": ({"viscous": 40, "coulomb": 6}, replace(PAPER, friction=SLOWED)),
    "motors and counterbalances": (
        {
            "armature": [14.8, 3, 40],
            "counterbalance": [48, -10, 55],
            "spring": [0, 495, -200],
            "counterweight": [0, 0, 2.5],
        },
        replace(PAPER, actuators=DRIVES),
    ),
    "on the Moon, pushed": (
        {"gravity": [0, 0, -1.62], "wrench": [0, 10, -50, 1, 0, 0]},
        replace(PAPER, gravity=[0, 0, -1.62]),
    ),
}


def random_rows(parameters, seed):
    """Random states, the last ones out of reach."""
    states = random_states(parameters, seed, COUNT, drop=0.3, angle=0.2)
    far = np.random.default_rng(seed).uniform(-1, 1, (BEYOND, 3))
    far[:, 0] += 2 + parameters.geometry.L
    rows = {"pose": np.concatenate([states.pose, far])}
    for name in ("velocity", "acceleration", "wrench"):
        rows[name] = np.resize(getattr(states, name), (COUNT + BEYOND, getattr(states, name).shape[1]))
    return rows


def expected(name, parameters, seed, own_wrench=None):
    """What the engine is to find, by Pinocchio where it has it."""
    robot = Manipulator(parameters)
    rows = random_rows(parameters, seed)
    pose, velocity, acceleration = (rows[key] for key in ("pose", "velocity", "acceleration"))
    given = rows["wrench"] if seed % 2 else None
    wrench = given if own_wrench is None else np.add(own_wrench, 0.0 if given is None else given)
    known = {"wrench": wrench, "on_invalid": "nan"}
    forces = robot.forces(pose, velocity, acceleration, method="pinocchio", **known)
    moved = kinematics.mechanism_motion(parameters.geometry, pose, velocity, acceleration, on_invalid="nan")
    none = np.zeros_like(pose)
    speeds = np.column_stack([moved.velocity[slide] for slide in SLIDES])
    speeds[np.isnan(forces)] = np.nan
    arrays = {
        "pose": pose,
        "velocity": velocity,
        "acceleration": acceleration,
        "forces": forces,
        "sliders": moved.sliders,
        "speeds": speeds,
        "power": forces * speeds,
        "holding": robot.forces(pose, none, none, method="pinocchio", **known),
        "jacobian": robot.jacobian(pose, on_invalid="nan"),
        "mass": robot.mass_matrix(pose, method="pinocchio", on_invalid="nan"),
        "joints": np.column_stack([moved.position[joint] for joint in kinematics.inverse.JOINTS]),
        "slider_accelerations": np.column_stack([moved.acceleration[slide] for slide in SLIDES]),
        "poses": robot.forward_kinematics(moved.sliders, on_invalid="nan"),
        "serial": robot.singularity(pose).serial,
    }
    assert np.isnan(forces).any(axis=1).sum() == BEYOND
    found = {"name": name, "parameters": engine_row(parameters)}
    if given is not None:
        found["wrench"] = encoded(given)
    return found | {key: encoded(np.ravel(rows)) for key, rows in arrays.items()}


def tasks():
    """Tasks, and the motions that Python plans of them."""
    corners = [
        Waypoint([0.0, 0.0, 0.0], dwell=0.1),
        Waypoint([0.12, 0.05, 0.3], blend=0.03),
        Waypoint([0.1, 0.12, 0.1], blend=0.02),
        Waypoint([-0.1, 0.1, -0.3], dwell=0.2),
        Waypoint([0.0, -0.05, 0.0]),
    ]
    turning = [Waypoint([0, 0, 0]), Waypoint([0.1, 0.02], blend=0.02), Waypoint([0.1, 0.1, 0.4])]
    loaded = [
        Waypoint([0, 0, 0]),
        Waypoint([0.1, 0, 0], duration=0.7, wrench=[0, 10, -50, 0, 0, 0]),
        Waypoint([0, 0.1, 0.1], duration=0.4),
    ]
    for name, points, duration, kind in (
        ("corners", corners, 2.9371, {}),
        ("smoother", corners, 2.0173, {"profile": "septic", "smoothness": 3, "turning_length": 0.2}),
        ("jerky", corners, 2.0173, {"profile": "s-curve"}),
        ("turning", turning, 1.0, {}),
        ("loaded", loaded, None, {}),
    ):
        task = Task(points, name, **kind)
        plan = task.plan(duration, 301)
        waypoints = [
            {
                "name": point.name,
                "pose": point.pose.tolist(),
                "blend": point.blend,
                "dwell": point.dwell,
                "duration": point.duration,
                "wrench": point.wrench.tolist() if point.wrench.any() else None,
            }
            for point in points
        ]
        motion = plan.motion
        found = {"pose": motion.pose, "velocity": motion.velocity, "acceleration": motion.acceleration}
        found |= {"time": motion.time, "times": plan.times}
        yield {
            "task": {
                "name": name,
                "profile": task.profile,
                "smoothness": task.smoothness,
                "turning": task.turning_length,
                "waypoints": waypoints,
            },
            "duration": duration,
            "samples": 301,
            **{key: encoded(np.ravel(rows)) for key, rows in found.items()},
        }


def test_the_engine_of_the_page_is_python(tmp_path):
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    changes = []
    for seed, (name, (what_if, parameters)) in enumerate(CHANGES.items(), 20):
        changes.append(expected(name, parameters, seed, what_if.get("wrench")) | {"what_if": what_if})
        if parameters.dimensions:
            changes[-1]["solids"] = {key: dict(getattr(parameters, key)) for key in ALUMINIUM}
    machines = [expected(*item, seed) for seed, item in enumerate(MACHINES.items(), 10)]
    reference = {
        "wasm": str(WASM),
        "machines": machines,
        "changes": changes,
        "tasks": list(tasks()),
        "joints": list(kinematics.inverse.JOINTS),
    }
    path = tmp_path / "reference.json"
    path.write_text(json.dumps(reference))
    done = subprocess.run(
        [node, "--test", "--test-reporter=tap", "test/engine.reference.test.mjs"],
        cwd=ROOT / "page",
        env={**os.environ, "P3DOF_REFERENCE": str(path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert int(re.search(r"# pass (\d+)", done.stdout)[1]) >= 5, done.stdout
    assert "# skipped 0" in done.stdout
