"""Values from outside, however large, small or strange: one clear line or the right number, no warning."""

from __future__ import annotations

import copy
import io
import json
from importlib.util import find_spec

import numpy as np
import pytest
import yaml
from documents import ROOT

import p3dof
from p3dof._base.checks import LARGEST, as_floats, not_negative, one_line, positive, real, visible
from p3dof._base.errors import P3dofError
from p3dof._base.files import parse_json
from p3dof._base.quantities import LENGTH
from p3dof._base.tables import Table
from p3dof.analysis.load_friction import HingeContact, SlideContact, read_load_friction
from p3dof.analysis.reactions import read_stiffness
from p3dof.analysis.reactions.stiffness import HingeStiffness, Misfit, RodSection
from p3dof.analysis.tolerances import read_uncertainty
from p3dof.cli import main
from p3dof.cli.output import print_plain, print_table, rich_table
from p3dof.design.bearings import read_bearings
from p3dof.design.fastest import fastest_plan
from p3dof.design.optimisation import read_problem
from p3dof.design.sweeps import read_sweep
from p3dof.design.tasks import read_task
from p3dof.runs.joint_controllers import JointReference

HUGE = 10**400

BODY = {"mass": 1, "com": [0, 0, "1 mm"], "inertia": [0.01, 0.01, 0.01], "about": [0, 0, 0]}
FILES = {
    "parameters": (
        p3dof.read_parameters,
        {
            "geometry": {"r": 0.1, "R": 0.25, "L": 0.4, "b": 0.05},
            "bodies": dict.fromkeys(("slider", "leg", "crossbar", "platform"), BODY),
            "limits": {"travel": [-0.2, 0.2], "speed": 2, "force": 500, "tilt": ["-45 deg", "45 deg"]},
            "gravity": [0, 0, -9.8],
            "friction": {"viscous": {"sliders": 1}, "coulomb": {"joints": 0.1}, "smoothing": 0.001},
            "actuators": {"armature": {"sliders": 0.1}, "counterbalance": {"slide_a": 3}},
            "payload": BODY,
        },
    ),
    "task": (
        read_task,
        {
            "turning_length": 0.1,
            "smoothness": 2,
            "limits": {"force": 100, "speed": [1, 1, "1 m/s"], "reflected_mass": 1},
            "waypoints": [
                {"pose": [0, 0, 0]},
                {"pose": [0.05, 0, 0.1], "blend": 0.01, "tolerance": ["1 mm", 0, 0]},
                {"pose": [0.1, 0, 0], "dwell": 1, "duration": 1, "pick_up": BODY, "wrench": [0] * 6},
            ],
        },
    ),
    "stiffness": (
        read_stiffness,
        {
            "hinges": {"radial": 1e8, "axial": 1e7, "tilt": 1e4},
            "slides": {"lateral": 1e8, "tilt": 1e4, "roll": 1e4},
            "universals": {"force": 1e8, "moment": 1e3},
            "rods": {"diameter": 0.02, "young": 2e11, "poisson": 0.3},
            "misfit": {"shift": 1e-5, "turn": 1e-4},
        },
    ),
    "load friction": (
        read_load_friction,
        {
            "hinges": {"mu": 0.1, "radius": 0.01},
            "slides": {"mu": 0.01, "drag": 3, "arm": 0.03, "screw": 0.1},
            "smoothing": 0.001,
        },
    ),
    "bearings": (
        read_bearings,
        {
            "hinges": {"dynamic": 1e4, "static": 5e3, "X": 1, "Y": 0, "e": 1, "X0": 0.6, "Y0": 0.5},
            "guides": {"dynamic": 1e4, "basis": 50000, "moments": [9, 9, 9], "centre": [0, 0, 0]},
        },
    ),
    "sweep": (
        read_sweep,
        {
            "motion": {"paper": 21},
            "variables": {"R": {"uniform": [0.24, 0.28]}, "platform.mass": {"normal": [8, "200 g"]}},
            "count": 12,
            "seed": 4,
            "reductions": [{"histogram": "reach", "from": 0, "to": 1, "bins": 8}],
        },
    ),
    "runs": (
        read_sweep,
        {
            "motion": {"paper": 21},
            "run": {"duration": 0.1, "step": 0.001},
            "variables": {"frequency": {"uniform": [5, 10]}},
            "count": 3,
        },
    ),
    "problem": (
        read_problem,
        {
            "motion": {"paper": 21},
            "variables": {"R": ["240 mm", 0.28]},
            "objectives": ["peak_force"],
            "constraints": {"width": {"max": 0.5}},
        },
    ),
    "uncertainty": (
        read_uncertainty,
        {"sigma": {"geometry.R": 1e-4}, "variables": {"geometry.R": [0.24, 0.26]}},
    ),
}  # fmt: skip


def places(data, before=()):
    """Where the numbers and texts of plain data are."""
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from places(value, (*before, key))
    else:
        yield before


def changed(data, place, value):
    data = copy.deepcopy(data)
    inner = data
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return data


class Plain(yaml.SafeDumper):
    def ignore_aliases(self, _):
        return True


@pytest.mark.parametrize("kind", FILES)
def test_integers_that_no_float_can_hold_are_one_line_wherever_they_stand(kind, tmp_path):
    read, data = FILES[kind]
    path = tmp_path / "file.yaml"
    path.write_text(yaml.dump(data, Dumper=Plain), encoding="utf-8")
    read(path)
    for place in places(data):
        path.write_text(yaml.dump(changed(data, place, -HUGE), Dumper=Plain), encoding="utf-8")
        with pytest.raises(P3dofError, match=r"line \d+: .*expected numbers of at most 1e\+30") as error:
            read(path)
        assert "\n" not in str(error.value)


CALLS = {
    "a contact of a hinge": lambda: HingeContact(mu=HUGE, radius=0.01),
    "of a slide": lambda: SlideContact(drag=HUGE),
    "a misfit": lambda: Misfit(shift=HUGE),
    "a stiffness": lambda: HingeStiffness(radial=HUGE),
    "rods": lambda: RodSection(poisson=-HUGE),
    "numbers with units": lambda: as_floats("x", LENGTH.read([HUGE, "1 mm", 0], "x")),
    "an array": lambda: as_floats("x", [HUGE]),
    "one number": lambda: real("x", HUGE),
    "from zero on": lambda: not_negative("x", -HUGE),
    "positive": lambda: positive("x", HUGE, P3dofError),
    "nearly zero": lambda: positive("x", 1e-300, P3dofError),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_from_python_too(call):
    with pytest.raises(P3dofError) as error:
        call()
    assert "\n" not in str(error.value)


def test_numbers_of_json_fit_into_floats():
    assert parse_json(f"[{HUGE}, -{HUGE}, 1e999, {2**128}]") == [np.inf, -np.inf, np.inf, 2**128]
    with pytest.raises(ValueError, match="nested too deeply"):
        parse_json("[" * 100_000)


@pytest.mark.skipif(find_spec("pyarrow") is None, reason="pyarrow not installed")
@pytest.mark.parametrize("checksum", [True, False])
def test_a_damaged_table_is_one_line_or_the_same_numbers(tmp_path, checksum):
    """Every byte with one bit changed; without checksums other numbers cannot be told."""
    import pyarrow
    from pyarrow import parquet

    from p3dof.analysis.designs.files import read_designs, results_file

    path, table = tmp_path / "table.parquet", {"R [mm]": np.array([250.0, 260.5])}
    if checksum:
        with results_file(path) as writer:
            writer.write(table)
    else:
        parquet.write_table(pyarrow.table(table), path)
    data, kinds, plain = path.read_bytes(), set(), {"R [mm]": [250.0, 260.5]}
    for place in range(len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 1 << (place % 8)
        path.write_bytes(damaged)
        try:
            (rows,) = read_designs(path, 1000)
            kinds.add(
                "same"
                if {name: column.tolist() for name, column in rows.columns.items()} == plain
                else "other"
            )
        except P3dofError as error:
            kinds.add(f"refused in {len(str(error).splitlines())} line")
    assert kinds == {"same", "refused in 1 line", *(() if checksum else ("other",))}


ESCAPE = "\x1b]0;title\x07\x1b[31m\x9b\u202e"


@pytest.mark.parametrize(
    "line",
    [
        [f"com{ESCAPE}mand"],
        ["forces", f"--opt{ESCAPE}ion"],
        ["forces", "--out", f"name{ESCAPE}.txt"],
        ["forces", "--motion", f"name{ESCAPE}.csv"],
        ["forces", "--motion", "columns.csv"],
        ["plan", "task.yaml"],
        ["loop", "info", "robot.urdf"],
    ],
    ids=lambda line: " ".join(line).encode("unicode_escape").decode(),
)
def test_no_terminal_obeys_what_stands_in_files_and_arguments(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "columns.csv").write_text(f"t,y,z,th{ESCAPE}eta\n0,0,0,0\n", encoding="utf-8")
    (tmp_path / "task.yaml").write_text(json.dumps({f"na{ESCAPE}me": 1}, ensure_ascii=True), encoding="utf-8")
    (tmp_path / "robot.urdf").write_text(
        "<robot name='a'><link name='a'/><joint name='j&#x9b;&#x202e;' type='fixed'><parent link='a'/>"
        "<child link='b&#x9b;31m'/></joint></robot>",
        encoding="utf-8",
    )
    assert main(line) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert visible(told.err) == told.err
    assert r"\x9b" in told.err


def test_nor_in_tables_and_notes():
    from rich.console import Console

    for width in (10, 200):
        shown = io.StringIO()
        console = Console(file=shown, width=width)
        print_table(console, rich_table(Table(f"t{ESCAPE}", (f"h{ESCAPE}", "n"), ((f"c{ESCAPE}", 1.0),))))
        print_plain(console, f"wrote {ESCAPE}")
        assert visible(shown.getvalue()) == shown.getvalue()
        assert shown.getvalue().count(r"\x9b") == 4
    assert visible("tab\tand\nline stay") == "tab\tand\nline stay"
    assert one_line(f"a\n{ESCAPE}") == r"a \x1b]0;title\x07\x1b[31m\x9b\u202e"


@pytest.mark.parametrize(
    "rows",
    [
        ["0,1e300", "1,0"],
        ["0,0", "1e300,1"],
        ["0,6e-69", "5e-324,0.91"],
        ["0,0.9", "7e-207,0.91"],
        ["0,1", "1e-160,1e-300", "2e-160,1"],
    ],
)
def test_motions_of_joints_beyond_arithmetic_are_one_line(rows):
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/four_bar.urdf")
    with pytest.raises(P3dofError) as error:
        JointReference.from_csv(loop, io.StringIO("\n".join(["t,crank_joint", *rows, ""])))
    assert "\n" not in str(error.value)


def test_a_motion_of_joints_takes_what_arithmetic_can_bear():
    loop = p3dof.load_robot(ROOT / "docs/_static/gallery/four_bar.urdf")
    text = f"t,crank_joint\n0,{-LARGEST!r}\n1,{LARGEST!r}\n"
    assert JointReference.from_csv(loop, io.StringIO(text)).over(np.array([1.0]))[0] == LARGEST


@pytest.mark.parametrize(("length", "code"), [("1e-300", 2), ("1e-25", 0), ("1e25", 0)])
def test_indices_by_a_length_that_is_far_off(length, code, capsys):
    assert main(["indices", "--length", length, "--samples", "5"]) == code
    told = capsys.readouterr().err
    assert ("expected a positive number, got 1e-300" in told) == bool(code)
    assert "Warning" not in told


@pytest.mark.parametrize("command", [["fastest"], ["plan", "--duration", "1"]])
@pytest.mark.parametrize("other", ["[1e-17, 0, 0]", "[0, 1e-12, 0]", "[0, 0, 1e-10]"])
def test_a_way_that_is_all_rounding_is_no_way(command, other, tmp_path, capsys):
    task = tmp_path / "task.yaml"
    task.write_text(f"waypoints:\n- {{pose: [0, 0, 0]}}\n- {{pose: {other}}}\n", encoding="utf-8")
    assert main([command[0], str(task), *command[1:]]) == 2
    assert "waypoint 1 and waypoint 2: expected two different poses" in capsys.readouterr().err


@pytest.mark.parametrize("start", [[0, 0, 0], [0.1, 0.02, 0.3]])
def test_but_a_short_way_is_one(start):
    """From rest to rest at accelerations that hardly change, its time is in proportion to its root."""
    robot, shares = p3dof.load(), []
    for length in (1e-5, 1e-6, 1e-8, 2e-10):
        ends = [p3dof.Waypoint(np.add(start, [0, length * part, 0])) for part in (0, 1)]
        shares.append(fastest_plan(robot, p3dof.Task(ends)).duration / length**0.5)
    np.testing.assert_allclose(shares, shares[0], rtol=10 * 1e-5 / robot.parameters.geometry.r)
