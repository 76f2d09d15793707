"""Write the robots of the benchmark, their states and their reference numbers.

    python docs/benchmark/make.py                # all robots; needs mpmath and NumPy
    python docs/benchmark/make.py four_bar       # some
    python docs/benchmark/make.py --check        # are the files what this program writes? (about a minute)

The reference numbers come from `exact.py`, which reads the files that are written here.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import exact
import numpy as np
from building import Build, plain
from planar import PLANAR
from spatial import SPATIAL

ROBOTS = {make.__name__: make for make in (*PLANAR, *SPATIAL)}
POSITIONS = (0.3, -0.25, 0.2, 0.15, -0.35, 0.1)
RATES = (1.2, -0.7, 0.9, 1.5, -1.1, 0.4)
ACCELERATIONS = (-2.5, 3.0, 1.5, -4.0, 2.0, 3.5)
FORCES = (3.0, -2.0, 5.0, 1.5, -4.0, 2.5)
STEPS = 40


def pattern(values, joints, slides, scale, digits=5):
    """Return values for joints, one after the other; those of slides are a fifth."""
    return [
        round(values[k % len(values)] * scale * (0.2 if slides[name] else 1.0), digits)
        for k, name in enumerate(joints)
    ]


def states(b: Build) -> list[dict]:
    """Return the states of a robot: what is given, in short decimals."""
    if b.states is not None:
        return b.states
    zero = [0.0] * len(b.given)
    rest = [-x for x in pattern(POSITIONS[::-1], b.given, b.slides, b.size)]
    return [
        {"name": "rest", "q": rest, "v": zero, "a": zero},
        {
            "name": "moving",
            "q": pattern(POSITIONS, b.given, b.slides, b.size),
            "v": pattern(RATES, b.given, b.slides, b.size),
            "a": pattern(ACCELERATIONS, b.given, b.slides, b.size),
        },
    ]


def model(name: str, b: Build) -> dict:
    """Return what the JSON file says of the robot itself."""
    return {
        "name": name,
        "about": ROBOTS[name].__doc__,
        "kinds": b.kinds,
        "urdf": f"{name}.urdf",
        "gravity": list(b.gravity),
        "closures": b.closures,
        "couplings": b.couplings,
        "actuated": b.actuated,
    }


def closed(robot: exact.Robot, given: list[int], target) -> np.ndarray:
    """Return q (n,), closed to doubles: from home to the target in small steps."""
    q, still, target = np.zeros(robot.n), np.zeros(robot.n), np.array(target, dtype=float)
    free = [k for k in range(robot.n) if k not in given]
    for share in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        q[given] = share * target
        for _ in range(20):
            error = exact.errors(robot, q)
            if not len(error) or np.abs(error).max() < 1e-12:
                break
            J, _ = exact.State(robot, q, still, still).closures()
            q[free] -= np.linalg.lstsq(J[:, free], error, rcond=1e-9)[0]
        else:
            raise SystemExit(
                f"{robot.data['name']}: does not close at {share:.3f} ({np.abs(error).max():.1e})"
            )
    return q


def digits(values, names) -> dict[str, str]:
    """Return numbers by name, as decimals of 40 significant digits."""
    return {
        name: exact.mp.nstr(value, exact.GIVEN, strip_zeros=True)
        for name, value in zip(names, values, strict=True)
    }


def number(value: float) -> float:
    """Return a number to three digits, as tables show it."""
    return float(f"{value:.3g}")


def conditions(robot: exact.Robot, q, v, a, tau, forward_tau, forward_a) -> dict:
    """Return rank, freedoms and condition numbers of a state; see the page for what they mean."""
    zero = robot.zeros(robot.n)
    J, _ = exact.State(robot, q, zero, zero).closures()
    null = exact.solve(J, robot.zeros(len(J)))[1]
    rank = robot.n - null.shape[1]
    sizes = np.linalg.svd(as_doubles(J).reshape(-1, robot.n), compute_uv=False)
    N = orthonormal(null)
    M = as_doubles(exact.mass_matrix(robot, q))
    used = np.linalg.svd(as_doubles(N[robot.actuated]), compute_uv=False)
    actuation_rank = (
        null.shape[1] - exact.solve(null[robot.actuated], robot.zeros(len(robot.actuated)))[1].shape[1]
    )
    closures = sizes[0] / sizes[rank - 1] if rank else 1.0
    need = as_doubles(exact.State(robot, q, v, a).forces(robot.gravity))
    load = as_doubles(-exact.State(robot, q, v, zero).forces(robot.gravity))
    load[robot.actuated] += as_doubles(forward_tau)
    least = np.linalg.eigvalsh(as_doubles(N.T @ exact.mass_matrix(robot, q) @ N))[0]
    size = np.linalg.norm(as_doubles(forward_a))
    return {
        "joints": robot.n,
        "rows": len(J),
        "rank": rank,
        "mobility": robot.n - rank,
        "actuation_rank": actuation_rank,
        "tau_unique": actuation_rank == len(robot.actuated),
        "condition_closures": number(closures),
        "condition_inverse": number(
            closures / used[actuation_rank - 1] * (1 + np.linalg.norm(need) / np.linalg.norm(as_doubles(tau)))
        ),
        "condition_forward": number(
            closures * (np.linalg.norm(M, 2) * size + np.linalg.norm(load)) / (least * size)
        ),
    }


def as_doubles(values) -> np.ndarray:
    """Return numbers as doubles."""
    return np.array(values, dtype=float)


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the space of these columns, to all digits."""
    found = []
    for column in columns.T:
        for other in found:
            column = column - other * (other @ column)  # noqa: PLW2901
        found.append(column / exact.mp.sqrt(column @ column))
    return np.array(found).T


def filled(name: str, b: Build, folder: Path) -> dict:
    """Return the whole JSON file; the URDF and the model must be written already."""
    doubles = exact.Robot(name, folder, real=float)
    robot = exact.Robot(name, folder)
    push = dict(zip(b.actuated, given_forces(b), strict=True))
    return model(name, b) | {
        "states": [filled_state(b, robot, doubles, wanted, push) for wanted in states(b)]
    }


def given_forces(b: Build) -> list[str]:
    """Return the forces of the actuators that accelerations are computed for."""
    if b.forces:
        return [plain(force) for force in b.forces]
    return [plain(round(FORCES[k % len(FORCES)] * b.force, 6)) for k in range(len(b.actuated))]


def filled_state(b: Build, robot, doubles, wanted: dict, push: dict[str, str]) -> dict:
    """Return a state with all its numbers."""
    given = [robot.place[name] for name in b.given]
    start = {
        name: repr(float(x)) for name, x in zip(robot.names, closed(doubles, given, wanted["q"]), strict=True)
    }
    state = {
        "name": wanted["name"],
        "given": b.given,
        "a_from": "forces" if b.from_forces else "given",
        "q": start | dict(zip(b.given, map(plain, wanted["q"]), strict=True)),
        "forward": {"tau": push},
    }
    for key in "va":
        known = map(plain, wanted.get(key, [0.0] * len(given)))
        state[key] = dict.fromkeys(robot.names, "0") | dict(zip(b.given, known, strict=True))
    forward_tau = robot.vector(push.values())
    q, v, a = exact.motion(robot, state)
    tau = exact.inverse(robot, q, v, a)
    forward_a = exact.forward(robot, q, v, forward_tau)
    for key, values in (("q", q), ("v", v), ("a", a)):
        state[key] = digits(values, robot.names)
    state["tau"] = digits(tau, b.actuated)
    del state["forward"]
    state["forward"] = {"tau": push, "a": digits(forward_a, robot.names)}
    state |= conditions(robot, q, v, a, tau, forward_tau, forward_a)
    state["digits"] = exact.second_opinion(robot, q, v, a, tau, forward_tau, forward_a)
    return state


def dump(data: dict) -> str:
    """Return the text of a JSON file, short lists in one line."""
    lines: list[str] = []
    for line in json.dumps(data, indent=1, ensure_ascii=False).splitlines():
        last = lines[-1] if lines else ""
        opened = last.rfind("[") > max(last.rfind("]"), last.rfind("{"))
        if opened and not line.strip().startswith(("{", "[")) and not line.strip().endswith(("{", "[")):
            gap = "" if last.endswith("[") or line.strip().startswith("]") else " "
            lines[-1] = last + gap + line.strip()
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def written(name: str, folder: Path) -> list[Path]:
    """Write a robot's URDF and JSON files; return their paths."""
    b = ROBOTS[name]()
    urdf, data = folder / f"{name}.urdf", folder / f"{name}.json"
    urdf.write_text(b.urdf(name), encoding="utf-8")
    data.write_text(dump(model(name, b) | {"states": []}), encoding="utf-8")
    data.write_text(dump(filled(name, b, folder)), encoding="utf-8")
    return [urdf, data]


_NUMBER = re.compile(r"-?[0-9.]+(e[+-]?[0-9]+)?")


def same(one, other, key="") -> bool:
    """Compare two JSON values: condition numbers to a percent, digits to two, zeros as rounded."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(
            same(one[name], other[name], "digits" if key == "digits" else name) for name in one
        )
    if key.startswith("condition_"):
        return abs(one - other) <= 0.01 * one
    if key == "digits":
        return abs(one - other) <= 2
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (_zero(one) and _zero(other))


def _zero(number) -> bool:
    """Whether a number with a hundred digits is zero, which each processor rounds from another start."""
    return isinstance(number, str) and _NUMBER.fullmatch(number) is not None and abs(float(number)) < 1e-90


def differing(name: str) -> list[str]:
    """Return which files of a robot are not what this program writes."""
    with TemporaryDirectory() as folder:
        found = []
        for path in written(name, Path(folder)):
            new, filed = path.read_text(encoding="utf-8"), exact.FOLDER / path.name
            old = filed.read_text(encoding="utf-8") if filed.is_file() else ""
            if new != old and not (path.suffix == ".json" and old and same(json.loads(new), json.loads(old))):
                found.append(path.name)
        return found


def main() -> None:
    """Write the files, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", help="names; all, if none is given")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if a file would change")
    args = parser.parse_args()
    if unknown := [name for name in args.robots if name not in ROBOTS]:
        parser.error(f"no robot of this name: {', '.join(unknown)}; there are {', '.join(ROBOTS)}")
    exact.FOLDER.mkdir(exist_ok=True)
    changed = []
    for name in args.robots or ROBOTS:
        if args.check:
            changed += differing(name)
        else:
            print(*(path.name for path in written(name, exact.FOLDER)), flush=True)
    if changed:
        sys.exit(f"not what make.py writes: {', '.join(changed)}")


if __name__ == "__main__":
    main()
