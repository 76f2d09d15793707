"""Tasks that tests share: a pick and place, blended and straight paths, the paper's path."""

from __future__ import annotations

import json

import numpy as np
from documents import ROOT

from p3dof.design.tasks.files import dump, parse

SCHEMA = json.loads((ROOT / "docs/reference/task.schema.json").read_text(encoding="utf-8"))
PICK_AND_PLACE = """
name: pick and place
waypoints:
  - {name: home, pose: [0, 0, 0]}
  - name: pick
    pose: [-150 mm, 0, -15 deg]
    dwell: 200 ms
    pick_up: {mass: 2 kg, com: [0, 0, -40 mm], inertia: [0, 0, 0]}
  - {name: up, pose: [-150 mm, 25 mm], blend: 25 mm}
  - {name: over, pose: [150 mm, 25 mm], blend: 25 mm}
  - {name: place, pose: [150 mm, 0, 15 deg], dwell: 0.2, put_down: true}
  - {name: end, pose: [0, 0, 0], wrench: [0, 10 N, -50 N, 0, 0, 0]}
"""


BLENDED = parse(
    """
waypoints:
  - {name: pick, pose: [-150 mm, 0, -15 deg]}
  - {pose: [-150 mm, 25 mm], blend: 25 mm}
  - {pose: [150 mm, 25 mm], blend: 25 mm}
  - {name: place, pose: [150 mm, 0, 15 deg]}
"""
)
LINE = parse("waypoints: [{pose: [-150 mm, 0, -15 deg]}, {pose: [150 mm, 30 mm, 15 deg]}]")


class PapersPath:
    """The path of the paper's motion, by its time."""

    end = 1.0
    at_waypoints = np.array([0.0, 1.0])

    def at(self, t):
        w = 4 * np.pi
        return (
            np.column_stack(
                [-(t**2) * (t**2 - 1.3 * t + 0.3), 0.2 * t**2 * (2 * t**2 - t - 1), 0.4 * np.sin(w * t)]
            ),
            np.column_stack(
                [-t * (4 * t**2 - 3.9 * t + 0.6), 0.2 * t * (8 * t**2 - 3 * t - 2), 0.4 * w * np.cos(w * t)]
            ),
            np.column_stack(
                [-(12 * t**2 - 7.8 * t + 0.6), 0.2 * (24 * t**2 - 6 * t - 2), -0.4 * w**2 * np.sin(w * t)]
            ),
        )


SMOOTHER = parse(dump(BLENDED).replace("smoothness: 2", "smoothness: 3"))
