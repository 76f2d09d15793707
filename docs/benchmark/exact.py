"""Reference forces and accelerations of the benchmark's robots, in 100 digits, from their plain files alone.

Two ways to the same numbers, which share only the reader, the placements and the errors of the closures:

1. Newton and Euler's equations of each body, exact Jacobians, and the null space of the closures;
2. Lagrange's equations with homogeneous matrices: the power of each body is tr((X'' - G) P dX'), where P is
   its pseudo-inertia and all derivatives are differences; then multipliers of the closures.

    python exact.py                # compute all anew, and compare with the files; needs mpmath and NumPy
    python exact.py four_bar delta

The page `index.md` says what the fields of the files mean.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from xml.etree import ElementTree

import mpmath
import numpy as np

FOLDER = Path(__file__).parent / "robots"
DIGITS = 100
"""Decimal digits of the arithmetic."""
GIVEN = 40
"""Significant digits that the files have."""
STEP = 14
"""Differences have a step of 10 to the minus this."""
ROWS = {"point": 3, "hinge": 5, "weld": 6, "distance": 1}
mp = mpmath.mp.clone()
mp.dps = DIGITS


class Robot:
    """A robot of the benchmark; numbers are exact decimals, or doubles with ``real=float``."""

    def __init__(self, name: str, folder: Path = FOLDER, real=mp.mpf) -> None:
        self.real = real
        self.zero, self.one = real(0), real(1)
        self.sin, self.cos, self.sqrt = (
            (mp.sin, mp.cos, mp.sqrt) if real is mp.mpf else (np.sin, np.cos, np.sqrt)
        )
        text = (folder / f"{name}.json").read_text(encoding="utf-8")
        self.data = json.loads(text, parse_float=str, parse_int=str)
        urdf = ElementTree.parse(folder / self.data["urdf"]).getroot()  # noqa: S314 - the benchmark's own file
        self.links, self.joints = {}, []
        for link in urdf.findall("link"):
            self.links[link.get("name")] = self._inertia(link.find("inertial"))
        waiting = [self._joint(joint) for joint in urdf.findall("joint")]
        (root,) = set(self.links) - {joint["child"] for joint in waiting}
        self.order = [root]  # the root link, then the child of each joint
        while waiting:
            ready = next(joint for joint in waiting if joint["parent"] in self.order)
            waiting.remove(ready)
            self.joints.append(ready | {"up": self.order.index(ready["parent"])})
            self.order.append(ready["child"])
        self.names = [joint["name"] for joint in self.joints]
        self.n = len(self.joints)
        self.place = {name: k for k, name in enumerate(self.names)}
        self.link = {name: k for k, name in enumerate(self.order)}
        self.above = [[]]  # joints between the root and each link
        for k, joint in enumerate(self.joints):
            self.above.append([*self.above[joint["up"]], k])
        self.gravity = self.vector(self.data["gravity"])
        self.closures = [self._closure(c) for c in self.data["closures"]]
        self.couplings = [
            (self.place[c["joint"]], self.place[c["of"]], real(c["ratio"])) for c in self.data["couplings"]
        ]
        self.actuated = [self.place[name] for name in self.data["actuated"]]

    def vector(self, values) -> np.ndarray:
        """Return numbers as an array of this robot's kind of numbers."""
        kind = float if self.real is float else object
        return np.array([self.real(value) for value in values], dtype=kind)

    def zeros(self, *shape: int) -> np.ndarray:
        """Return zeros of this robot's kind of numbers."""
        return np.full(shape, self.zero, dtype=float if self.real is float else object)

    def of(self, values: dict[str, str]) -> np.ndarray:
        """Return values by joint as an array (n,)."""
        return self.vector([values[name] for name in self.names])

    def _inertia(self, element):
        if element is None:
            return None
        origin = element.find("origin")
        _plain(origin)
        read = element.find("inertia").get
        rows = [[read("ixx"), read("ixy"), read("ixz")], [read("ixy"), read("iyy"), read("iyz")]]
        moments = np.array([self.vector(row) for row in [*rows, [read("ixz"), read("iyz"), read("izz")]]])
        return self.real(element.find("mass").get("value")), self.vector(origin.get("xyz").split()), moments

    def _joint(self, element) -> dict:
        origin, kind = element.find("origin"), element.get("type")
        _plain(origin)
        if kind not in ("revolute", "continuous", "prismatic"):
            raise SystemExit(f"joint {element.get('name')}: a type that this benchmark does not have: {kind}")
        axis = self.vector(element.find("axis").get("xyz").split())
        return {
            "name": element.get("name"),
            "slides": kind == "prismatic",
            "parent": element.find("parent").get("link"),
            "child": element.find("child").get("link"),
            "origin": self.vector(origin.get("xyz").split()),
            "axis": axis / self.sqrt(axis @ axis),
        }

    def _closure(self, given: dict) -> dict:
        made = {"kind": given["kind"], "links": (self.link[given["link_1"]], self.link[given["link_2"]])}
        made["points"] = self.vector(given["position_1"]), self.vector(given["position_2"])
        if given["kind"] == "hinge":
            axes = [self.vector(given[key]) for key in ("axis_1", "axis_2")]
            one, two = (axis / self.sqrt(axis @ axis) for axis in axes)
            across = np.roll(one, 1) * self.vector([1, 2, -3])  # any other direction
            x = cross(one, across)
            x = x / self.sqrt(x @ x)
            made["axes"] = x, cross(one, x), two
        if given["kind"] == "distance":
            made["length"] = self.real(given["length"])
        return made


def _plain(origin) -> None:
    if [float(x) for x in origin.get("rpy", "0 0 0").split()] != [0, 0, 0]:
        raise SystemExit(
            "expected no rpy: all frames of this benchmark are parallel where all joints are zero"
        )


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b; also of many vectors (..., 3)."""
    (a0, a1, a2), (b0, b1, b2) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)


def placements(robot: Robot, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return rotation (3, 3) and origin (3,) of each link."""
    eye = robot.zeros(3, 3)
    eye[range(3), range(3)] = robot.one
    found = [(eye, robot.zeros(3))]
    for joint, value in zip(robot.joints, q, strict=True):
        R, p = found[joint["up"]]
        if joint["slides"]:
            found.append((R, p + R @ (joint["origin"] + joint["axis"] * value)))
        else:
            s, c, n = robot.sin(value), robot.cos(value), joint["axis"]
            turn = np.outer(n, n) * (robot.one - c) + eye * c
            turn = turn + s * np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
            found.append((R @ turn, p + R @ joint["origin"]))
    return found


def errors(robot: Robot, q: np.ndarray, at=None) -> np.ndarray:
    """Return the errors of all closures and couplings."""
    at, found = at or placements(robot, q), []
    for closure in robot.closures:
        (R1, p1), (R2, p2) = (at[link] for link in closure["links"])
        apart = p2 + R2 @ closure["points"][1] - p1 - R1 @ closure["points"][0]
        if closure["kind"] == "distance":
            found.append(robot.sqrt(apart @ apart) - closure["length"])
            continue
        found += list(apart)
        found += [(R1 @ one) @ (R2 @ two) for one, two in _square(robot, closure)]
    found += [q[joint] - ratio * q[of] for joint, of, ratio in robot.couplings]
    return np.array(found)


def _square(robot: Robot, closure: dict) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return pairs of directions, one on each link, that a closure keeps at right angles."""
    if closure["kind"] == "hinge":
        x, y, z = closure["axes"]
        return [(x, z), (y, z)]
    if closure["kind"] == "weld":
        x, y, z = (robot.vector(row) for row in ([1, 0, 0], [0, 1, 0], [0, 0, 1]))
        return [(x, y), (y, z), (z, x)]
    return []


class State:
    """All bodies of a robot in motion, with the closures' rates: the first way."""

    def __init__(self, robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> None:
        self.robot, self.q, self.v = robot, q, v
        self.at = placements(robot, q)
        self.axis = [self.at[j["up"]][0] @ j["axis"] for j in robot.joints]
        self.spin, self.turning, self.speeding = self._motion(v, a)

    def _motion(self, v, a):
        zero = self.robot.zeros(3)
        spin, turning, moving = [zero], [zero], [zero]
        for k, (joint, n) in enumerate(zip(self.robot.joints, self.axis, strict=True)):
            up = joint["up"]
            w, dw, r = spin[up], turning[up], self.at[k + 1][1] - self.at[up][1]
            acceleration = moving[up] + cross(dw, r) + cross(w, cross(w, r))
            rate = cross(w, n) * v[k]
            if joint["slides"]:
                spin.append(w)
                turning.append(dw)
                acceleration = acceleration + n * a[k] + rate + rate
            else:
                spin.append(w + n * v[k])
                turning.append(dw + n * a[k] + rate)
            moving.append(acceleration)
        return spin, turning, moving

    def forces(self, gravity: np.ndarray) -> np.ndarray:
        """Return the joint forces (n,) of the open tree that its motion needs."""
        robot = self.robot
        force = [robot.zeros(3) for _ in robot.order]
        moment = [robot.zeros(3) for _ in robot.order]  # about the link's origin
        for i, name in enumerate(robot.order):
            if (body := robot.links[name]) is None:
                continue
            mass, com, inertia = body
            R, w, dw = self.at[i][0], self.spin[i], self.turning[i]
            r = R @ com
            F = (self.speeding[i] + cross(dw, r) + cross(w, cross(w, r)) - gravity) * mass
            I = R @ inertia @ R.T  # noqa: E741 - the inertia about the centre of mass, in world axes
            force[i] = F
            moment[i] = I @ dw + cross(w, I @ w) + cross(r, F)
        tau = robot.zeros(robot.n)
        for k in reversed(range(robot.n)):
            i, up = k + 1, robot.joints[k]["up"]
            tau[k] = self.axis[k] @ (force[i] if robot.joints[k]["slides"] else moment[i])
            if up:
                force[up] = force[up] + force[i]
                moment[up] = moment[up] + moment[i] + cross(self.at[i][1] - self.at[up][1], force[i])
        return tau

    def closures(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the Jacobian (rows, n) of the errors, and their second rates (rows,) at this motion."""
        robot, J, second = self.robot, [], []
        for closure in robot.closures:
            one, two = closure["links"]
            (R1, p1), (R2, p2) = self.at[one], self.at[two]
            r1, r2 = R1 @ closure["points"][0], R2 @ closure["points"][1]
            columns = self._point(two, p2 + r2) - self._point(one, p1 + r1)
            rate = self._swing(two, r2) - self._swing(one, r1)
            if closure["kind"] == "distance":
                apart, moving = p2 + r2 - p1 - r1, columns @ self.v
                length = robot.sqrt(apart @ apart)
                along = apart / length
                J.append(along @ columns)
                second.append(along @ rate + (moving @ moving - (along @ moving) ** 2) / length)
                continue
            J += list(columns)
            second += list(rate)
            turns = self._turn(one) - self._turn(two)
            for u, w in _square(robot, closure):
                u, w = R1 @ u, R2 @ w  # noqa: PLW2901
                J.append(cross(u, w) @ turns)
                du, dw = cross(self.spin[one], u), cross(self.spin[two], w)
                ddu = cross(self.turning[one], u) + cross(self.spin[one], du)
                ddw = cross(self.turning[two], w) + cross(self.spin[two], dw)
                second.append(ddu @ w + 2 * (du @ dw) + u @ ddw)
        for joint, of, ratio in robot.couplings:
            row = robot.zeros(robot.n)
            row[joint], row[of] = robot.one, -ratio
            J.append(row)
            second.append(robot.zero)
        return np.array(J).reshape(-1, robot.n), np.array(second)

    def _point(self, link: int, p: np.ndarray) -> np.ndarray:
        """Return the Jacobian (3, n) of a point of a link."""
        found = self.robot.zeros(3, self.robot.n)
        for k in self.robot.above[link]:
            n = self.axis[k]
            found[:, k] = n if self.robot.joints[k]["slides"] else cross(n, p - self.at[k + 1][1])
        return found

    def _turn(self, link: int) -> np.ndarray:
        """Return the Jacobian (3, n) of a link's rotation."""
        found = self.robot.zeros(3, self.robot.n)
        for k in self.robot.above[link]:
            if not self.robot.joints[k]["slides"]:
                found[:, k] = self.axis[k]
        return found

    def _swing(self, link: int, r: np.ndarray) -> np.ndarray:
        """Return the acceleration of a point at r from a link's origin."""
        w = self.spin[link]
        return self.speeding[link] + cross(self.turning[link], r) + cross(w, cross(w, r))


def solve(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Solve A x = b by elimination with full pivoting, whatever the rank of A.

    Returns a solution (zero where it is free), a basis (n, n - rank) of the null space, and the rest of b.
    """
    rows, n = A.shape
    T = np.concatenate([A, b.reshape(rows, 1)], axis=1)
    scale = max([abs(x) for x in A.ravel()], default=0) or mp.mpf(1)
    columns, r = [], 0
    free = list(range(n))
    while r < rows and free:
        size = np.abs(T[r:, free])
        at = np.unravel_index(np.argmax(size), size.shape)
        if size[at] < scale * mp.mpf(10) ** (-DIGITS // 2):
            break
        row, column = r + at[0], free[at[1]]
        T[[r, row]] = T[[row, r]]
        T[r] = T[r] / T[r, column]
        others = np.flatnonzero(T[:, column] != 0)
        others = others[others != r]
        T[others] = T[others] - np.outer(T[others, column], T[r])
        columns.append(column)
        free.remove(column)
        r += 1
    x = np.full(n, mp.mpf(0), dtype=object)
    x[columns] = T[:r, n]
    null = np.full((n, len(free)), mp.mpf(0), dtype=object)
    null[columns] = -T[:r, free]
    null[free, range(len(free))] = mp.mpf(1)
    return x, null, max([abs(t) for t in T[r:, n]], default=mp.mpf(0))


def close(robot: Robot, q: np.ndarray, given: list[int]) -> np.ndarray:
    """Return q with the closures closed by Newton's method; the joints of `given` stay."""
    free = [k for k in range(robot.n) if k not in given]
    still = robot.zeros(robot.n)
    for _ in range(12):
        error = errors(robot, q)
        if max([abs(e) for e in error], default=0) < mp.mpf(10) ** (6 - DIGITS):
            return q
        J, _ = State(robot, q, still, still).closures()
        q = q.copy()
        q[free] = q[free] + solve(J[:, free], -error)[0]
    raise SystemExit(f"{robot.data['name']}: the closures do not close")


def _consistent(robot: Robot, left, what: str) -> None:
    if left > mp.mpf(10) ** (-DIGITS // 2):
        raise SystemExit(f"{robot.data['name']}: no {what} fits the closures ({mp.nstr(left, 3)} is left)")


def motion(robot: Robot, state: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q, v, a (n,) of a state of the file, to all digits."""
    given = [robot.place[name] for name in state["given"]]
    free = [k for k in range(robot.n) if k not in given]
    zero = robot.zeros(robot.n)
    q = close(robot, robot.of(state["q"]), given)
    v, a = zero.copy(), zero.copy()
    v[given] = robot.of(state["v"])[given]
    J, _ = State(robot, q, zero, zero).closures()
    v[free], _, left = solve(J[:, free], -(J @ v))
    _consistent(robot, left, "velocity")
    _, bias = State(robot, q, v, zero).closures()
    if state["a_from"] == "given":
        a[given] = robot.of(state["a"])[given]
        a[free], _, left = solve(J[:, free], -(J @ a) - bias)
        _consistent(robot, left, "acceleration")
        return q, v, a
    return (
        q,
        v,
        forward(robot, q, v, robot.vector(state["forward"]["tau"][n] for n in robot.data["actuated"])),
    )


def inverse(robot: Robot, q, v, a) -> np.ndarray:
    """Return the shortest forces (actuated,) of the actuators that fit a motion: the first way."""
    zero = robot.zeros(robot.n)
    J, _ = State(robot, q, zero, zero).closures()
    N = solve(J, robot.zeros(len(J)))[1]
    W, b = N[robot.actuated].T, N.T @ State(robot, q, v, a).forces(robot.gravity)
    y, _, left = solve(W @ W.T, b)
    _consistent(robot, left, "actuator force")
    return W.T @ y


def mass_matrix(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Return the mass matrix (n, n) of the open tree, column by column: the first way."""
    zero, rows = robot.zeros(robot.n), []
    for k in range(robot.n):
        unit = zero.copy()
        unit[k] = robot.one
        rows.append(State(robot, q, zero, unit).forces(robot.zeros(3)))
    return np.array(rows)


def forward(robot: Robot, q, v, tau) -> np.ndarray:
    """Return the accelerations (n,) under forces of the actuators: the first way."""
    zero = robot.zeros(robot.n)
    at = State(robot, q, v, zero)
    J, bias = at.closures()
    particular, N, left = solve(J, -bias)
    _consistent(robot, left, "acceleration")
    load = -at.forces(robot.gravity)
    load[robot.actuated] = load[robot.actuated] + tau
    M = mass_matrix(robot, q)
    z, null, _ = solve(N.T @ M @ N, N.T @ (load - M @ particular))
    if null.shape[1]:
        raise SystemExit(f"{robot.data['name']}: accelerations are not determined")
    return particular + N @ z


class ByDifferences:
    """The second way: nothing but placements and errors, and differences of them along straight lines."""

    def __init__(self, robot: Robot, q, v, a) -> None:
        self.robot, n, h = robot, robot.n, mp.mpf(10) ** -STEP
        unit = np.full((n, n), mp.mpf(0), dtype=object)
        unit[range(n), range(n)] = mp.mpf(1)
        near = (-2, -1, 1, 2)
        first = (mp.mpf(1) / 12, -mp.mpf(2) / 3, mp.mpf(2) / 3, -mp.mpf(1) / 12)
        self.dX = {}  # (link, joint): (3, 4)
        J = []
        for k in range(n):
            X, e = zip(*(self._look(q + unit[k] * (s * h)) for s in near), strict=True)
            J.append(sum(w * x for w, x in zip(first, e, strict=True)) / h)
            for link in range(1, n + 1):
                if k in robot.above[link]:
                    self.dX[link, k] = sum(w * x[link] for w, x in zip(first, X, strict=True)) / h
        self.J = np.array(J).T.reshape(-1, n)
        second = (-mp.mpf(1) / 12, mp.mpf(4) / 3, -mp.mpf(5) / 2, mp.mpf(4) / 3, -mp.mpf(1) / 12)

        def along(acceleration):
            times = [s * h for s in (-2, -1, 0, 1, 2)]
            X, e = zip(*(self._look(q + v * t + acceleration * (t * t / 2)) for t in times), strict=True)
            bend = [sum(w * x[i] for w, x in zip(second, X, strict=True)) / h**2 for i in range(n + 1)]
            return bend, sum(w * x for w, x in zip(second, e, strict=True)) / h**2

        self.bend, _ = along(a)
        self.bend0, self.bias = along(a * 0)
        self.pseudo = [self._pseudo(robot.links[name]) for name in robot.order]

    def _look(self, q):
        at = placements(self.robot, q)
        return [np.concatenate([R, p[:, None]], axis=1) for R, p in at], errors(self.robot, q, at)

    @staticmethod
    def _pseudo(body):
        P = np.full((4, 4), mp.mpf(0), dtype=object)
        if body is not None:
            mass, com, inertia = body
            half = (inertia[0, 0] + inertia[1, 1] + inertia[2, 2]) / 2
            P[:3, :3] = mass * np.outer(com, com) - inertia
            P[range(3), range(3)] = P[range(3), range(3)] + half
            P[:3, 3] = P[3, :3] = mass * com
            P[3, 3] = mass
        return P

    def _forces(self, bend):
        robot, G = self.robot, np.full((3, 4), mp.mpf(0), dtype=object)
        G[:, 3] = robot.gravity
        push = [(X - G) @ P for X, P in zip(bend, self.pseudo, strict=True)]
        f = robot.zeros(robot.n)
        for (link, k), dX in self.dX.items():
            f[k] = f[k] + (push[link] * dX).sum()
        return f

    def inverse(self) -> np.ndarray:
        """Return the shortest forces of the actuators, from forces and multipliers together."""
        robot, m = self.robot, len(self.robot.actuated)
        A = np.full((robot.n, m + len(self.J)), mp.mpf(0), dtype=object)
        A[robot.actuated, range(m)] = mp.mpf(1)
        A[:, m:] = self.J.T
        x, null, _ = solve(A, self._forces(self.bend))
        tau, free = x[:m], null[:m]
        free = free[:, [max(abs(t) for t in column) > mp.mpf(10) ** (-DIGITS // 3) for column in free.T]]
        share = solve(free.T @ free, free.T @ tau)[0]
        return tau - free @ share

    def forward(self, tau: np.ndarray) -> np.ndarray:
        """Return the accelerations, from accelerations and multipliers together."""
        robot, n, rows = self.robot, self.robot.n, len(self.J)
        A = np.full((n + rows, n + rows), mp.mpf(0), dtype=object)
        for link in range(1, n + 1):
            above = robot.above[link]
            D = np.array([self.dX[link, k] for k in above])
            A[np.ix_(above, above)] = (
                A[np.ix_(above, above)]
                + (D @ self.pseudo[link]).reshape(len(above), -1) @ D.reshape(len(above), -1).T
            )
        A[:n, n:], A[n:, :n] = self.J.T, self.J
        load = -self._forces(self.bend0)
        load[robot.actuated] = load[robot.actuated] + tau
        return solve(A, np.concatenate([load, -self.bias]))[0][:n]


def agreed(one: np.ndarray, two: np.ndarray) -> int:
    """Return the decimal digits that two arrays have in common, by the largest entry."""
    size = max(abs(x) for x in one)
    apart = max(abs(x) for x in one - two)
    if apart == 0:
        return DIGITS
    return int(mp.floor(-mp.log10(apart / size))) if size else int(mp.floor(-mp.log10(apart)))


def second_opinion(robot: Robot, q, v, a, tau, forward_tau, forward_a) -> dict[str, int]:
    """Return the digits that the second way has in common with the first one's forces and accelerations."""
    other = ByDifferences(robot, q, v, a)
    return {"tau": agreed(tau, other.inverse()), "a": agreed(forward_a, other.forward(forward_tau))}


def compare(name: str, folder: Path = FOLDER) -> dict[str, int]:
    """Compute a robot's numbers anew; return the digits that file and second way have in common."""
    robot, least = Robot(name, folder), {"file": DIGITS, "second way": DIGITS}
    for state in robot.data["states"]:
        q, v, a = motion(robot, state)
        tau = inverse(robot, q, v, a)
        given = robot.vector(state["forward"]["tau"][n] for n in robot.data["actuated"])
        found = forward(robot, q, v, given)
        filed = robot.vector(state["tau"][n] for n in robot.data["actuated"])
        pairs = [(q, state["q"]), (v, state["v"]), (a, state["a"]), (found, state["forward"]["a"])]
        same = min(agreed(tau, filed), *(agreed(x, robot.of(y)) for x, y in pairs))
        least["file"] = min(least["file"], same)
        other = second_opinion(robot, q, v, a, tau, given, found)
        least["second way"] = min(least["second way"], *other.values())
    return least


def main() -> None:
    """Compute the references anew, and compare them with the files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", help="names; all, if none is given")
    names = parser.parse_args().robots or sorted(path.stem for path in FOLDER.glob("*.json"))
    worst = DIGITS
    for name in names:
        if not (FOLDER / f"{name}.json").is_file():
            parser.error(f"no robot of this name in {FOLDER.name}/: {name}")
        digits = compare(name)
        worst = min(worst, *digits.values())
        print(f"{name}: equal digits:", ", ".join(f"{what} {count}" for what, count in digits.items()))
    if worst < GIVEN - 2:
        sys.exit(f"only {worst} digits agree; expected {GIVEN - 2}")


if __name__ == "__main__":
    main()
