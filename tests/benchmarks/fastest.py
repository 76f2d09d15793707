"""Processor time of the fastest motions: by default, with 1,000 steps a way, and with a limit of jerk.

    python tests/benchmarks/fastest.py [--rounds 3]

CPU time of the process, least of several rounds.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

from rich.console import Console

import p3dof
from p3dof.design.tasks.files import parse

BLENDED = """
waypoints:
  - {name: pick, pose: [-150 mm, 0, -15 deg]}
  - {pose: [-150 mm, 25 mm], blend: 25 mm}
  - {pose: [150 mm, 25 mm], blend: 25 mm}
  - {name: place, pose: [150 mm, 0, 15 deg]}
"""
PICK_AND_PLACE = """
waypoints:
  - {name: home, pose: [0, 0, 0]}
  - name: pick
    pose: [-150 mm, 0, -15 deg]
    dwell: 200 ms
    pick_up: {mass: 2 kg, com: [0, 0, -40 mm], inertia: [0, 0, 0]}
  - {name: up, pose: [-150 mm, 25 mm], blend: 25 mm}
  - {name: over, pose: [150 mm, 25 mm], blend: 25 mm}
  - {name: place, pose: [150 mm, 0, 15 deg], dwell: 0.2, put_down: true}
  - {name: end, pose: [0, 0, 0]}
"""
FRICTION = p3dof.machine.Friction(viscous={"sliders": 20}, coulomb={"sliders": 5})
CASES = {
    "pick and place, friction, 100 W": (True, p3dof.design.AxisLimits(500, 2, 100), None),
    "500 N, 2 m/s, 1,000 steps": (False, p3dof.design.AxisLimits(500, 2), 1000),
    "the same with friction": (True, p3dof.design.AxisLimits(500, 2), 1000),
    "the same with 100 W": (True, p3dof.design.AxisLimits(500, 2, 100), 1000),
    "500 m/s³, as many steps as by default": (False, p3dof.design.AxisLimits(500, 2, jerk=500), None),
    "500 m/s³, 60 steps": (False, p3dof.design.AxisLimits(500, 2, jerk=500), 60),
}


def main() -> None:
    """Print a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    console, bare = Console(highlight=False, width=110), p3dof.load()
    lossy = p3dof.load(replace(bare.parameters, friction=FRICTION))
    for name, (friction, limits, nodes) in CASES.items():
        task, least = parse(PICK_AND_PLACE if "place" in name else BLENDED), float("inf")
        for _ in range(rounds):
            begin = time.process_time()
            plan = p3dof.design.fastest_plan(lossy if friction else bare, task, limits, nodes=nodes)
            least = min(least, time.process_time() - begin)
        worst = max(use.share for use in plan.uses)
        console.print(f"{name:40s} {least:7.2f} s CPU, {plan.duration:.6f} s, limits used to {worst:.6f}")


if __name__ == "__main__":
    main()
