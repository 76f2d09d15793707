"""The public benchmark of closed-loop robots: its files, its references, and what engines reach.

References are held against a second derivation, closed forms, and p3dof and other engines up to the condition
numbers of the files; all of it is in docs/benchmark, which needs no p3dof.
"""

import json
import shutil
import subprocess
import sys
from xml.etree import ElementTree

import exact
import make
import pytest
import run
import tables
from documents import ROOT

FOLDER = ROOT / "docs" / "benchmark"
NAMES = sorted(make.ROBOTS)
QUICK = {"bennett", "five_bar_singular", "four_bar_change_point", "gripper", "linear_delta", "planar_4rrr"}
"""Robots of all kinds whose references are computed anew in a second."""
BOUND = 4 * 2.0**-52
"""Times the condition number of the file, what doubles can be held to."""
MAXIMAL = 12.5
"""How much wider that is in maximal coordinates, whose closures have condition numbers of their own."""
FREEDOMS = {
    1: {
        "bennett",
        "bricard",
        "four_bar",
        "four_bar_chain",
        "four_bar_long",
        "gripper",
        "klann_leg",
        "parallelogram",
        "sarrus",
        "scissor_lift",
        "scott_russell",
        "slider_crank",
        "spherical_four_bar",
        "stephenson_six_bar",
        "strandbeest_leg",
        "watt_six_bar",
    },
    2: {
        "ankle",
        "differential",
        "five_bar",
        "five_bar_near_singular",
        "five_bar_singular",
        "four_bar_change_point",
        "pantograph",
    },
    3: {
        "delta",
        "five_bar_mass_ratio",
        "linear_delta",
        "orthoglide",
        "planar_3prr",
        "planar_3rrr",
        "planar_4rrr",
        "rps_3",
        "spherical_wrist",
        "tricept",
        "upu_3",
    },
    4: {"excavator"},
    6: {"biped", "crane", "hexapod_screws", "humanoid_leg", "stewart"},
}
"""What the text books say; the stretched parallelogram has one more at that instant."""


def data(name):
    return json.loads((FOLDER / "robots" / f"{name}.json").read_text(encoding="utf-8"))


def allowed(engine):
    return (MAXIMAL if engine == "exudyn" else 1) * BOUND


def states():
    return [(name, state) for name in NAMES for state in data(name)["states"]]


def slowly(names, quick):
    return [pytest.param(name, marks=() if name in quick else pytest.mark.slow) for name in names]


def test_the_robots_are_what_their_program_builds():
    files = {path.stem for path in (FOLDER / "robots").iterdir()}
    assert files == set(NAMES)
    assert len(NAMES) == 40
    for name in NAMES:
        build = make.ROBOTS[name]()
        assert build.urdf(name) == (FOLDER / "robots" / f"{name}.urdf").read_text(encoding="utf-8"), name
        filed = data(name)
        assert len(filed.pop("states")) == 2
        assert filed == json.loads(json.dumps(make.model(name, build)))


@pytest.mark.parametrize(
    ("other", "same"),
    [({"a": ["2", "-2e-101"]}, True), ({"a": ["2", "0.0"]}, True), ({"a": ["2", "1e-89"]}, False),
     ({"a": ["2.0000000000000000000000000000000000000001", "0.0"]}, False), ({"a": ["2"]}, False)],
)  # fmt: skip
def test_what_counts_as_the_same(other, same):
    assert make.same({"a": ["2", "1.5e-99"]}, other) == same


@pytest.mark.parametrize("name", slowly(NAMES, QUICK))
def test_the_references_are_what_their_program_computes(name):
    assert make.differing(name) == []


def test_two_derivations_agree_in_all_digits_of_the_files():
    for name, state in states():
        assert min(state["digits"].values()) >= exact.GIVEN, name
        for text in [*state["tau"].values(), *state["forward"]["a"].values()]:
            assert len(text.strip("-0.").replace(".", "").partition("e")[0]) <= exact.GIVEN
    assert exact.compare("five_bar")["file"] >= exact.GIVEN - 1


def test_a_wrong_digit_shows(tmp_path):
    robot = data("five_bar")
    tau = robot["states"][1]["tau"]
    digits = tau["left_arm_joint"]
    at = digits.index(".") + 30
    tau["left_arm_joint"] = digits[:at] + str((int(digits[at]) + 1) % 10) + digits[at + 1 :]
    shutil.copy(FOLDER / "robots" / "five_bar.urdf", tmp_path)
    (tmp_path / "five_bar.json").write_text(json.dumps(robot), encoding="utf-8")
    assert exact.compare("five_bar", tmp_path)["file"] in range(28, 32)


def test_freedoms_are_those_of_the_text_books():
    found = {name: state["mobility"] for name, state in states()}
    assert found == {name: count for count, names in FREEDOMS.items() for name in names}
    for name, state in states():
        robot, kinds = data(name), set(data(name)["kinds"])
        motors, freedoms = len(robot["actuated"]), state["mobility"]
        singular = state["actuation_rank"] < min(motors, freedoms) or name == "four_bar_change_point"
        assert ("singular" in kinds) == singular
        assert ("redundantly actuated" in kinds) == (motors > freedoms)
        assert ("underactuated" in kinds) == (motors < freedoms and not singular)
        assert state["tau_unique"] == (state["actuation_rank"] == motors)
        points = sum(closure["kind"] == "point" for closure in robot["closures"])  # a row across a plane
        assert ("overconstrained" in kinds) == (state["rows"] - state["rank"] > points and not singular)
        large = max(state["condition_inverse"], state["condition_forward"]) > 1.2e5
        assert ("ill-conditioned" in kinds) == large


def test_the_scissor_lift_at_rest_needs_what_its_height_says():
    """Stages of bars from (0, 0) to (w, h): all centres are at odd multiples of h/2, and w² + h² stays."""
    mp, robot = exact.mp, exact.Robot("scissor_lift")
    state = robot.data["states"][0]
    w = mp.mpf("0.6") + mp.mpf(state["q"]["slider_joint"])
    h = mp.sqrt(mp.mpf("0.6") ** 2 + mp.mpf("0.3") ** 2 - w**2)
    mass = {name: body[0] for name, body in robot.links.items() if body}
    climb = sum(mass[f"bar_{side}{k}"] * (k - mp.mpf("0.5")) for side in "ab" for k in range(1, 7))
    force = robot.vector([-mp.mpf("9.81") * climb * w / h])
    assert exact.agreed(force, robot.vector(state["tau"].values())) >= exact.GIVEN - 1


@pytest.mark.parametrize(
    "engine",
    ["p3dof", "pinocchio", "mujoco", "pinocchio-solver"]
    + [pytest.param(name, marks=pytest.mark.slow) for name in ("drake", "exudyn")],
)
def test_engines_reach_the_references_to_what_condition_numbers_allow(engine):
    if run.installed(engine) is None:
        pytest.skip(f"{engine} not installed: pip install 'p3dof[engines]'")
    refused = set()
    for name in NAMES:
        conditions = {state["name"]: state for state in data(name)["states"]}
        for row in run.measure(engine, name):
            if row.note:
                refused.add((name, row.quantity, row.note))
                continue
            bound = allowed(engine) * conditions[row.state][f"condition_{row.quantity}"]
            assert row.error <= bound, (name, row.state, row.quantity, row.error / bound)
    if engine == "pinocchio-solver":
        assert {quantity for _, quantity, note in refused if "no hinges" not in note} == {"inverse"}
    elif engine == "p3dof":  # motors that cannot hold the robot: shortest forces, or a refusal
        ((name, quantity, note),) = refused
        assert (name, quantity, note.partition(":")[0]) == (
            "five_bar_singular",
            "inverse",
            "SingularityError",
        )
    else:
        assert refused == set()


def test_soft_constraints_show():
    """One in ten thousand of the force of a closure is missing, and nothing else."""
    pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[engines]'")
    for name in ("four_bar", "slider_crank", "scott_russell", "spherical_four_bar", "five_bar"):
        for row in run.measure("mujoco-solver", name):
            assert row.note if row.quantity == "inverse" else 1e-7 < row.error < 2e-4


def test_a_reference_off_by_more_than_rounding_is_found(monkeypatch):
    read = json.loads

    def off(text, **how):
        found = read(text, **how)
        for state in found["states"]:
            for name, value in state["tau"].items():
                state["tau"][name] = str(float(value) * (1 + 1e-12))
        return found

    monkeypatch.setattr(run.json, "loads", off)
    (row,) = [
        r for r in run.measure("pinocchio", "five_bar") if (r.state, r.quantity) == ("moving", "inverse")
    ]
    assert 0.9e-12 < row.error < 1.1e-12


def test_the_page_has_the_tables_of_the_files():
    assert tables.page() == tables.PAGE.read_text(encoding="utf-8")
    text = tables.PAGE.read_text(encoding="utf-8")
    fields = {key for _, state in states() for key in state} | set(data("gripper"))
    fields |= {key for name in NAMES for closure in data(name)["closures"] for key in closure}
    for field in fields - {"name", "about", "urdf"}:
        assert f"`{field}`" in text or field.startswith("condition_"), field


def test_the_results_are_of_all_robots():
    rows = tables.results()
    engines = {row["engine"] for row in rows}
    assert engines == set(run.ENGINES)
    expected = {(name, state["name"], engine, what) for name, state in states() for engine in engines
                for what in ("inverse", "forward")}  # fmt: skip
    assert {(row["robot"], row["state"], row["engine"], row["quantity"]) for row in rows} == expected
    assert len(rows) == len(expected)
    conditions = {(name, state["name"]): state for name, state in states()}
    for row in rows:
        if row["engine"] != "mujoco-solver" and not row["note"]:
            condition = conditions[row["robot"], row["state"]][f"condition_{row['quantity']}"]
            assert float(row["error"]) <= allowed(row["engine"]) * condition, row


def started(*options):
    command = [sys.executable, str(FOLDER / "run.py"), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_runner_says_what_it_does_not_know():
    for options, words in (
        (["--engine", "nix"], "no engine of this name: nix"),
        (["--robot", "x"], "no robot of this"),
    ):
        done = started(*options)
        assert done.returncode == 2
        assert words in done.stderr.splitlines()[-1]


def test_the_runner_needs_no_p3dof(tmp_path):
    """In a folder of its own, with a p3dof that cannot be imported."""
    shutil.copytree(FOLDER, tmp_path / "benchmark", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "benchmark" / "p3dof.py").write_text("raise ImportError\n", encoding="utf-8")
    command = [
        sys.executable,
        "run.py",
        "--robot",
        "four_bar",
        "delta",
        "--engine",
        "p3dof",
        "pinocchio",
        "--write",
    ]
    done = subprocess.run(command, cwd=tmp_path / "benchmark", capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert lines[0] == "not installed: p3dof (module p3dof)"
    assert [line.split()[0] for line in lines[3:]] == ["four_bar", "delta"]
    assert all(float(error) < 1e-13 for line in lines[3:] for error in line.split()[1:])
    # What was not measured stays as it was.
    old, new = (
        (folder / "results.csv").read_text(encoding="utf-8").splitlines()
        for folder in (FOLDER, tmp_path / "benchmark")
    )
    assert len(new) == len(old)
    changed = {(line.split(",")[0], line.split(",")[2]) for line in set(new) ^ set(old)}
    assert changed <= {("four_bar", "pinocchio"), ("delta", "pinocchio")}


def test_urdf_is_plain():
    for name in NAMES:
        root = ElementTree.parse(FOLDER / "robots" / f"{name}.urdf").getroot()  # noqa: S314 - our own
        assert {joint.get("type") for joint in root.findall("joint")} <= {
            "revolute",
            "continuous",
            "prismatic",
        }
        assert not root.findall(".//origin[@rpy]")
        for link in root.findall("link"):
            assert (link.get("name") == "ground") == (link.find("inertial") is None)
