"""Write the tables of the benchmark's page, and draw its robots.

python docs/benchmark/tables.py              # the tables of index.md, from the robots' files and results.csv
python docs/benchmark/tables.py --check      # write nothing; fail if a table would change
python docs/benchmark/tables.py --draw       # also the picture; needs Matplotlib
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import sys
from pathlib import Path

import exact
import numpy as np

HERE = Path(__file__).resolve().parent
PAGE, RESULTS = HERE / "index.md", HERE / "results.csv"
PICTURE = HERE.parent / "_static" / "benchmark.png"
KINDS = ("inverse", "forward")
COLUMNS, FEW = 6, 13
SMALL = 0.03  # the mass of bodies between the joints of a floating one [kg]


def robots() -> list[dict]:
    """Return the JSON files, those with the fewest joints first."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(exact.FOLDER.glob("*.json"))]
    return sorted(found, key=lambda data: (data["states"][0]["joints"], data["name"]))


def short(value: float) -> str:
    """Return a number as tables show it."""
    return f"{value:.0f}" if value < 9999.5 else f"{value:.0e}".replace("e+0", "e")


def robots_table() -> list[str]:
    """Return the table of robots: files, what each is, what is special about it."""
    lines = ["| robot | what it is | kind |", "|---|---|---|"]
    for data in robots():
        name, kinds = data["name"], ", ".join(data["kinds"])
        links = f"[{name}](robots/{name}.urdf) ([JSON](robots/{name}.json))"
        lines.append(f"| {links} | {data['about'].rstrip('.')} | {kinds} |")
    return lines


def numbers_table() -> list[str]:
    """Return the table of counts and condition numbers, the larger ones of both states."""
    head = ["robot", "joints", "rows", "rank", "mobility", "actuators", "κ(J)", "κ inverse", "κ forward"]
    lines = [f"| {' | '.join(head)} |", f"|---|{'---:|' * 8}"]
    for data in robots():
        states = data["states"]
        counts = [str(states[0][key]) for key in ("joints", "rows", "rank", "mobility")]
        largest = [short(max(s[f"condition_{key}"] for s in states)) for key in ("closures", *KINDS)]
        cells = [data["name"], *counts, str(len(data["actuated"])), *largest]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def digits_line() -> list[str]:
    """Return how well both ways to the reference agree."""
    states = [state for data in robots() for state in data["states"]]
    least = min(min(state["digits"].values()) for state in states)
    return [f"Both ways agree to {least} digits or more in all {len(states)} states."]


def results() -> list[dict[str, str]]:
    """Return the rows of results.csv."""
    with RESULTS.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def results_tables() -> list[str]:
    """Return a table of results for each question, one of own solvers, and what has no result and why."""
    rows, lines = results(), []
    versions = {row["engine"]: row["version"] for row in rows}
    every = [(engine, kind) for kind in KINDS for engine in versions]
    own = [pair for pair in every if pair[0].endswith("solver")]
    tables = {
        f"{kind} dynamics": [pair for pair in every if pair[1] == kind and pair not in own] for kind in KINDS
    }
    for title, columns in (tables | {"own solver": sorted(own)}).items():
        found = {pair: [r for r in rows if (r["engine"], r["quantity"]) == pair] for pair in columns}
        kept = {pair: some for pair, some in found.items() if any(row["error"] for row in some)}
        heads = [
            f"{name} {versions[name]}".strip() + (f", {kind}" if "own" in title else "")
            for name, kind in kept
        ]
        lines += [f"| {title} | {' | '.join(heads)} |", f"|---|{'---:|' * len(heads)}"]
        for name in (data["name"] for data in robots()):
            cells = [worst([row for row in some if row["robot"] == name]) for some in kept.values()]
            lines.append(f"| {name} | {' | '.join(cells)} |")
        lines.append("")
    whys: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        if row["note"]:
            whys.setdefault((row["engine"], row["quantity"], row["note"]), []).append(row["robot"])
    lines += ["What a program does not compute:", ""]
    for (engine, quantity, note), names in whys.items():
        few = list(dict.fromkeys(names))
        where = ", ".join(few) if len(few) <= FEW else f"{len(few)} robots"
        lines.append(f"* {engine}, {quantity} dynamics of {where}: {note}")
    return lines


def worst(rows: list[dict[str, str]]) -> str:
    """Return the largest error of some rows; a dash where there is none."""
    if any(not row["error"] for row in rows):
        return "–"
    return f"{max(float(row['error']) for row in rows):.0e}".replace("e-0", "e-").replace("0e+00", "0")


def page() -> str:
    """Return the page with its tables anew."""
    text = PAGE.read_text(encoding="utf-8")
    parts = {
        "robots": robots_table(),
        "numbers": numbers_table(),
        "digits": digits_line(),
        "results": results_tables(),
    }
    for name, lines in parts.items():
        begin, end = f"<!-- {name} -->\n", f"\n<!-- end of {name} -->"
        before, _, rest = text.partition(begin)
        _, found, after = rest.partition(end)
        if not found:
            sys.exit(f"{PAGE.name}: expected the marks {begin.strip()} and {end.strip()}")
        text = f"{before}{begin}" + "\n".join(["", *lines, ""]) + f"{end}{after}"
    return text


def draw() -> None:
    """Draw all robots as sticks in their second state, projected; circles are closures, dots are motors."""
    from matplotlib.figure import Figure
    from PIL import Image

    everything = robots()
    count = -(-len(everything) // COLUMNS)
    figure = Figure(figsize=(1.4 * COLUMNS, 1.5 * count), layout="constrained")
    axes = figure.subplots(count, COLUMNS).ravel()
    for axis in axes:
        axis.axis("off")
    for axis, data in zip(axes, everything, strict=False):
        sticks(axis, data)
        axis.set_title(data["name"].replace("_", " "), fontsize=7.5)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=120)
    Image.open(drawn).convert("RGB").quantize(24, dither=Image.Dither.NONE).save(PICTURE, optimize=True)


def sticks(axis, data: dict) -> None:
    """Draw one robot."""
    robot = exact.Robot(data["name"], real=float)
    at = exact.placements(robot, robot.of(data["states"][1]["q"]))
    ends: list[list[np.ndarray]] = [[] for _ in robot.order]
    for k, joint in enumerate(robot.joints):
        ends[joint["up"]].append(at[joint["up"]][0] @ joint["origin"] + at[joint["up"]][1])
        if joint["slides"]:
            ends[joint["up"]].append(at[k + 1][1])
    marks = []
    for closure in robot.closures:
        for link, point in zip(closure["links"], closure["points"], strict=True):
            marks.append(at[link][0] @ point + at[link][1])
            ends[link].append(marks[-1])
        if closure["kind"] == "distance":
            axis.plot(*project(np.array(marks[-2:]), False), color="#8a94a6", lw=0.9)
    flat = not any(point[1] for point in [*marks, *(p for _, p in at)])
    for link, points in enumerate(ends[1:], 1):
        R, p = at[link]
        _, com, _ = robot.links[robot.order[link]]
        if all(np.allclose(point, p) for point in points):  # its own end, if nothing else is there
            points.append(p + 2 * R @ com)
        for point in points:
            axis.plot(*project(np.array([p, point]), flat), color="#2d4f8e", lw=1.3, solid_capstyle="round")
    ground = [
        j["origin"]
        for j in robot.joints
        if not j["up"] and not (j["slides"] and robot.links[j["child"]][0] < SMALL)
    ]
    if ground:
        axis.plot(*project(np.array(ground), flat), "^", color="#555c68", ms=3.5)
    axis.plot(*project(np.array([at[k + 1][1] for k in robot.actuated]), flat), "o", color="#d9622b", ms=3.2)
    if marks:
        axis.plot(*project(np.array(marks), flat), "o", mfc="white", mec="#7a3fa0", mew=0.8, ms=2.8)
    axis.set_aspect("equal", "datalim")
    axis.margins(0.12)


def project(points: np.ndarray, flat: bool) -> np.ndarray:
    """Return points (n, 3) as seen from the front or, unless flat, from a corner above, (2, n)."""
    x, y, z = points.T
    turn, tilt = (0.0, 0.0) if flat else (-0.6, 0.35)
    right, back = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    return np.array([right, np.cos(tilt) * z + np.sin(tilt) * back])


def main() -> None:
    """Write the tables, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; fail if a table would change")
    parser.add_argument("--draw", action="store_true", help="draw the picture too")
    args = parser.parse_args()
    text = page()
    if args.check:
        if text != PAGE.read_text(encoding="utf-8"):
            sys.exit(f"{PAGE.name}: a table is not that of the files; run docs/benchmark/tables.py")
        return
    PAGE.write_text(text, encoding="utf-8")
    if args.draw:
        draw()


if __name__ == "__main__":
    main()
