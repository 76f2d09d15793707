"""`p3dof loop`: any robot with closed loops, from the command line."""

from __future__ import annotations

import json
import re
import shutil
import warnings

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
import yaml
from browser import find_chromium
from command_line import run
from documents import ROOT
from gallery import GALLERY, gallery
from other_robots import load, others
from PIL import Image

import p3dof
from p3dof._base.errors import InputError, ModelError, ModelWarning
from p3dof._base.quantities import FORCE, MOMENT
from p3dof.cli.kinds import Amount, require_unit
from p3dof.loops import ClosedLoopModel, Closure, Coupling, Sidecar
from p3dof.loops.compiled.build import compiler
from p3dof.loops.tables import doubtful_bodies, doubtful_units, overview
from p3dof.loops.writers.urdf import texts
from p3dof.runs import ControlLoop, Integration, JointComputedTorque, JointReference, gains, simulate_robot
from p3dof.runs.forces_along import forces_along
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.headless import as_image

ONE_LINE = 1


def loop(capsys, command, *arguments):
    return run(capsys, "loop", command, *arguments)


@pytest.fixture
def five_bar(tmp_path):
    """A five-bar in a file, its sidecar beside it."""
    path = tmp_path / "five_bar.urdf"
    path.write_text(robots.five_bar())
    path.with_suffix(".yaml").write_text(robots.FIVE_BAR_SIDECAR.to_yaml())
    return path


@pytest.fixture
def motion(tmp_path):
    """Two motors in time, the second one first and in degrees."""
    path, time = tmp_path / "motion.csv", np.linspace(0, 1, 201)
    right, left = 1.2 + 0.1 * np.sin(3 * time), 1.9 + 0.1 * np.cos(3 * time)
    rows = np.column_stack([time * 1e3, np.rad2deg(right), left])
    text = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    path.write_text(f"t [ms],right_joint [deg],left_joint\n{text}\n")
    return path


def columns(path):
    with path.open(encoding="utf-8") as lines:
        header = lines.readline().strip().split(",")
    return dict(zip(header, np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).T, strict=True))


def test_info_tells_mobility_and_what_is_left_open(capsys, five_bar):
    code, out, err = loop(capsys, "info", five_bar)
    assert (code, err) == (0, "")
    for words in ("left_tip/right_tip", "2 of 3", "mobility", "left_elbow", "actuated", "revolute"):
        assert words in out
    code, short, _ = loop(capsys, "info", five_bar, "--no-list-joints")
    assert code == 0
    assert "left_elbow" not in short


def test_a_robot_without_its_sidecar_is_told_to_be_an_open_chain(capsys, five_bar):
    words = "no loop closures are known: this is an open chain"
    assert words not in " ".join(loop(capsys, "info", five_bar)[1].split())
    five_bar.with_suffix(".yaml").unlink()
    code, out, _ = loop(capsys, "info", five_bar)
    assert code == 0
    assert words in " ".join(out.split())


def test_idle_joints_and_redundant_closures_are_found():
    model = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    seen = overview(model, robots.five_bar_q(1.9, 1.2))
    assert (seen.rank, seen.mobility, seen.held, seen.idle) == (2, 2, 2, ())
    assert seen.undetermined.tolist() == [False, True, False]  # across the plane
    one = Sidecar(robots.FIVE_BAR_SIDECAR.closures, ("left_joint",))
    seen = overview(ClosedLoopModel(model.model, one), robots.five_bar_q(1.9, 1.2))
    assert (seen.mobility, seen.held) == (2, 1)
    assert seen.idle == ("left_elbow", "right_joint", "right_elbow")


def test_info_of_many_joints_is_a_table_on_80_columns(capsys, tmp_path, monkeypatch):
    """Thirty joints of which most are idle: one line each, and no line that is longer."""
    names = [f"wrist_of_finger_{i}/2" for i in range(30)]
    parts = [robots.link("base"), *(robots.link(f"body_{i}", robots.ROD) for i in range(30))]
    parts += [
        robots.joint(name, f"body_{i - 1}" if i else "base", f"body_{i}", (0.1, 0, 0))
        for i, name in enumerate(names)
    ]
    path = tmp_path / "chain.urdf"
    path.write_text(robots.robot(*parts))
    sidecar = {"closed_loop": [], "type": [], "name_mot": names[:2]}
    path.with_suffix(".yaml").write_text(yaml.safe_dump(sidecar))
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = loop(capsys, "info", path)
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    lines = {name: [line for line in out.splitlines() if f" {name} " in line] for name in names}
    assert all(len(found) == ONE_LINE for found in lines.values())
    assert [name for name in names if " passive " in lines[name][0]] == names[2:]
    assert re.search(r"passive joints\W+28\b", out)


def test_info_of_a_singular_reference_says_what_holds_beside_it(capsys, tmp_path):
    path, sidecar = tmp_path / "flat.urdf", tmp_path / "flat.yaml"
    path.write_text(robots.flat_parallelogram(), encoding="utf-8")
    sidecar.write_text(robots.PARALLELOGRAM_SIDECAR.to_yaml(), encoding="utf-8")
    code, out, err = loop(capsys, "info", path)
    assert (code, err) == (0, "")
    cells = dict(re.findall(r"│ ([a-z ]+?) +│ (.+?) +│", out))
    assert (cells["rank"], cells["mobility"], cells["rank at the reference"]) == ("2", "1", "1, singular")
    told = " ".join(out.split())
    assert "the closures have rank 1 there and 2 nearby" in told
    values = dict(re.findall(r"(\w+)=(-?[\d.]+)", told))
    assert set(values) == {"left_joint", "bar_joint", "right_joint"}
    named = p3dof.load_robot(path, sidecar, reference={name: float(x) for name, x in values.items()})
    assert named.rank(named.assemble().q) == 2


def test_info_of_a_dead_centre_says_where_the_motor_moves_it(capsys, tmp_path):
    path, sidecar = tmp_path / "dead.urdf", tmp_path / "dead.yaml"
    path.write_text(robots.slider_crank(), encoding="utf-8")
    sidecar.write_text(robots.SLIDER_CRANK_SIDECAR.to_yaml(), encoding="utf-8")
    code, out, err = loop(capsys, "info", path)
    assert (code, err) == (0, "")
    cells, told = dict(re.findall(r"│ ([a-z ]+?) +│ (.+?) +│", out)), flat(out)
    assert (cells["controlled free motions"], cells["actuator forces"]) == ("1", "unique")
    assert "the motors move 0 of 1 free motions there and 1 nearby" in told
    named = re.search(r"for --around or 'reference' of the sidecar: (.*)", told)
    code, out, _ = loop(capsys, "info", path, "--around", named[1].strip())
    assert (code, "singular" in out) == (0, False)


def test_all_commands_start_around_given_values(capsys, tmp_path, five_bar):
    """What `info` names of a flat linkage makes it regular; assembly and generated C start in closed form."""
    path, sidecar = tmp_path / "flat.urdf", tmp_path / "flat.yaml"
    path.write_text(robots.flat_parallelogram(), encoding="utf-8")
    sidecar.write_text(robots.PARALLELOGRAM_SIDECAR.to_yaml(), encoding="utf-8")
    named = re.search(
        r"for --around or 'reference' of the sidecar: (.*)", flat(loop(capsys, "info", path)[1])
    )
    code, out, _ = loop(capsys, "info", path, "--around", named[1].strip())
    assert code == 0
    assert "singular" not in out
    values, out = "left_joint=1.9, right_joint=70 deg", tmp_path / "out"
    expected = robots.five_bar_q(1.9, np.deg2rad(70))
    assert loop(capsys, "assemble", five_bar, "--around", values, "--out", tmp_path / "q.csv")[0] == 0
    found = [value[0] for value in columns(tmp_path / "q.csv").values()]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    given = ("codegen", five_bar, "--around", values, "--out", out)
    assert loop(capsys, *given)[0] == 0
    code = (out / "robot_selftest.c").read_text(encoding="utf-8")
    assert f"--around '{values}'" in code
    home = re.search(r"home\[1\]\[4\] = \{\s*\{(.*?)\}", code, re.DOTALL)[1]
    np.testing.assert_allclose([float(x) for x in home.split(",")], expected, rtol=0, atol=1e-12)
    assert loop(capsys, *given, "--check")[0] == 0
    assert loop(capsys, *given[:2], *given[4:], "--check")[0] == 1  # elsewhere it is other code
    given = (five_bar, "--around", "left_joint=1.9,left_elbow=1", "--around", "right_joint=1.2")
    code, _, err = loop(capsys, "info", *given)
    assert (code, err.count("\n")) == (1, 1)
    told = (
        "p3dof: error: --around: the loops do not close at left_joint=1.9, left_elbow=1, right_joint=1.2: 0."
    )
    assert err.startswith(told)


def flat(text):
    return " ".join(text.split())


def test_arguments_of_macros_reach_the_robot_its_shapes_and_its_code(capsys, tmp_path):
    pytest.importorskip("xacro")
    pytest.importorskip("yourdfpy")
    shape = '<link name="base"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
    text = robots.five_bar().replace('<link name="base"/>', shape)
    arg = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="size" default="1"/>'
    text = re.sub("<robot[^>]*>", arg.replace("<robot ", '<robot name="five" '), text, count=1)
    path = tmp_path / "five.urdf.xacro"
    path.write_text(text.replace('size="1 1 1"', 'size="$(arg size) 1 1"'), encoding="utf-8")
    (tmp_path / "five.yaml").write_text(robots.FIVE_BAR_SIDECAR.to_yaml(), encoding="utf-8")
    sizes = {}
    for value in ("2", "3"):
        out = tmp_path / f"{value}.glb"
        assert loop(capsys, "export", path, "--xacro-arg", f"size:={value}", "--out", out)[0] == 0
        sizes[value] = out.read_bytes()
    assert sizes["2"] != sizes["3"]
    assert loop(capsys, "codegen", path, "--xacro-arg", "size:=2", "--out", tmp_path / "c")[0] == 0
    assert "--xacro-arg size:=2" in (tmp_path / "c" / "five.c").read_text(encoding="utf-8")
    code, _, err = loop(capsys, "info", path, "--xacro-arg", "size=2")
    assert (code, err) == (2, "p3dof: error: --xacro-arg: expected NAME:=VALUE, got 'size=2'\n")


def test_a_usd_file_is_shown_as_rods(capsys, tmp_path):
    pytest.importorskip("pxr")
    code, out, _ = loop(capsys, "show", ROOT / "urdf/p3dof.usda", "--still", "--out", tmp_path / "p.html")
    assert code == 0
    assert "the shapes of a USD file are not read" in out
    code, out, _ = loop(capsys, "info", ROOT / "urdf/p3dof.usda", "--around", "slide_a=10 mm,slide_b=0")
    assert code == 0
    assert "rank at the reference" not in out


def test_info_doubts_the_axis_of_a_hinge_that_takes_the_mobility(capsys, tmp_path):
    path, sidecar = tmp_path / "bar.urdf", tmp_path / "bar.yaml"
    hinged = Sidecar((Closure("bar_tip", "right_tip", "hinge"),), ("left_joint",))
    sidecar.write_text(hinged.to_yaml(), encoding="utf-8")
    doubt = "is the z axis of both frames of bar_tip/right_tip the axis of the joint?"
    quarter = repr(np.pi / 2)
    across, along = ("0.0 0.0 0.0", f"0.0 -{quarter} 0.0"), (f"{quarter} 0.0 0.0",) * 2
    for turns, mobility in ((across, 0), (along, 1)):
        xml = robots.parallelogram()
        for place, turn in zip(("0.3 0.0 0.0", "0.4 0.0 0.0"), turns, strict=True):
            tip = f'_tip"/><origin xyz="{place}" rpy='
            assert xml.count(tip) == 1
            xml = xml.replace(f'{tip}"0.0 0.0 0.0"', f'{tip}"{turn}"')
        path.write_text(xml, encoding="utf-8")
        told = " ".join(loop(capsys, "info", path)[1].split())
        assert f"│ mobility │ {mobility} │" in told
        assert (doubt in told) == (mobility == 0)


def test_info_of_what_does_not_close(capsys, tmp_path):
    path, sidecar = tmp_path / "open.urdf", tmp_path / "loops.yaml"
    path.write_text(robots.four_bar(2.0, 0.2, 0.45, 0.35))
    sidecar.write_text(robots.FOUR_BAR_SIDECAR.to_yaml())
    code, out, _ = loop(capsys, "info", path, sidecar)
    assert code == 1
    assert "the loops do not close" in out
    code, _, err = loop(capsys, "assemble", path, sidecar)
    assert code == 1
    assert err.startswith("p3dof: error: the loops do not close")
    assert len(err.splitlines()) == ONE_LINE


def test_assemble_takes_units_and_writes_a_reference(capsys, tmp_path, five_bar):
    values = ("--set", "left_joint=1.9", "--set", "right_joint=70 deg")
    code, out, _ = loop(capsys, "assemble", five_bar, *values, "--out", tmp_path / "q.csv")
    assert code == 0
    assert "mobility 2" in out
    expected = robots.five_bar_q(1.9, np.deg2rad(70))
    found = columns(tmp_path / "q.csv")
    assert list(found) == ["left_joint", "left_elbow", "right_joint", "right_elbow"]
    np.testing.assert_allclose([value[0] for value in found.values()], expected, rtol=0, atol=1e-12)
    assert loop(capsys, "assemble", five_bar, *values, "--out", tmp_path / "q.yaml")[0] == 0
    reference = yaml.safe_load((tmp_path / "q.yaml").read_text())["reference"]
    again = p3dof.load_robot(five_bar, reference=reference)
    np.testing.assert_allclose(again.reference, expected, rtol=0, atol=1e-12)
    code, out, err = loop(capsys, "assemble", five_bar, "--set", "right_joint=1.2", "--out", "-")
    assert code == 0
    assert out.startswith("left_joint,")
    assert "Assembly" in err


def test_forces_are_those_of_the_package(capsys, tmp_path, five_bar, motion):
    code, out, _ = loop(capsys, "forces", five_bar, "--motion", motion, "--out", tmp_path / "f.csv")
    assert code == 0
    assert "Forces of the actuators" in out
    found, model = columns(tmp_path / "f.csv"), p3dof.load_robot(five_bar)
    assert found["t [s]"][-1] == 1.0
    for i in (0, 60, 200):
        t = found["t [s]"][i]
        turn = np.array([np.cos(3 * t), np.sin(3 * t)])
        state = model.complete(
            np.array([1.9, 1.2]) + 0.1 * turn,
            0.3 * np.array([-turn[1], turn[0]]),
            -0.9 * turn,
            robots.five_bar_q(1.9, 1.2),
        )
        tau = model.inverse_dynamics(state.q, state.v, state.a).tau
        names = [f"force {name} [N m]" for name in model.actuated]
        np.testing.assert_allclose([found[name][i] for name in names], tau, rtol=0, atol=1e-8)
    forces = np.array([found[f"force {name} [N m]"] for name in model.actuated])
    for row in forces:
        peak, rms = row[np.argmax(np.abs(row))], np.sqrt(np.trapezoid(row**2, found["t [s]"]))
        assert f"{peak:.4f}" in out
        assert f"{rms:.4f}" in out


@pytest.mark.skipif(compiler() is None, reason="no C compiler here")
def test_forces_compiled_are_the_same(capsys, tmp_path, five_bar, motion):
    found = []
    for method in ("general", "compiled"):
        file = tmp_path / f"{method}.csv"
        options = ("--motion", motion, "--samples", "50", "--method", method, "--out", file)
        code, out, _ = loop(capsys, "forces", five_bar, *options)
        assert code == 0
        assert "50 samples" in out
        found.append(columns(file))
    assert list(found[0]) == list(found[1])
    for name, column in found[0].items():
        np.testing.assert_allclose(found[1][name], column, rtol=0, atol=1e-11 * max(1, np.abs(column).max()))


def test_motors_before_their_gears_are_told(capsys, five_bar, motion):
    sidecar = five_bar.with_suffix(".yaml")
    data = "joint_data: [{joint: right_joint, gear_ratio: 40, rotor_inertia: 1e-5}]\n"
    sidecar.write_text(sidecar.read_text() + data)
    code, out, _ = loop(capsys, "forces", five_bar, "--motion", motion)
    assert code == 0
    table = out[out.index("Motors, before their gears") :]
    peak = float(re.search(r"right_joint \W+(-?\d+\.\d+)", out)[1])
    row = re.search(r"right_joint\W+40\.0+\W+0\.000010\W+(\d+\.\d+)\W+(\d+\.\d+)", table)
    assert float(row[1]) == pytest.approx(abs(peak) / 40, abs=1e-5)
    assert float(row[2]) == pytest.approx(40 * 0.3, rel=1e-3)
    assert "left_joint" not in table[: table.index("The curve")]


def test_a_robot_without_joints_is_told_in_one_line(capsys, tmp_path):
    path = tmp_path / "stone.urdf"
    path.write_text('<robot name="stone"><link name="stone"/></robot>')
    (tmp_path / "m.csv").write_text("t\n0\n")
    assert loop(capsys, "info", path)[0] == 0
    assert loop(capsys, "assemble", path)[0] == 0
    for arguments, words in (
        (("simulate", path), "loop: expected a robot with joints, this one has none"),
        (("forces", path, "--motion", tmp_path / "m.csv"), "the robot has no actuated joints"),
        (
            ("codegen", path, "--out", tmp_path / "c"),
            "robot: expected one with joints, this one has none: nothing moves",
        ),
    ):
        code, _, err = loop(capsys, *arguments)
        assert (code, err) == (2, f"p3dof: error: {words}\n")


def test_values_of_a_motion_are_points_of_a_curve(capsys, tmp_path, five_bar):
    """Of six values, peaks and RMS are those of very many samples, not those at the six."""
    path, found = tmp_path / "six.csv", {}
    rows = ["0,1.9,1.2", "100,2.0,1.15", "200,1.95,1.1", "300,1.8,1.2", "400,1.85,1.3", "500,1.9,1.25"]
    path.write_text("\n".join(["t [ms],left_joint,right_joint", *rows]))
    for samples in ((), ("--samples", 6), ("--samples", 10001)):
        out_file = tmp_path / "f.csv"
        code, out, _ = loop(capsys, "forces", five_bar, "--motion", path, *samples, "--out", out_file)
        assert code == 0
        forces = columns(out_file)
        both = np.array([forces[f"force {side}_joint [N m]"] for side in ("left", "right")])
        rms = np.sqrt(np.trapezoid(both**2, forces["t [s]"]) / 0.5)
        found[samples] = np.array([np.abs(both).max(axis=1), rms])
        assert "The curve through the 6 values starts with left_joint at" in out
        assert f"{len(forces['t [s]'])} samples of the curve" in out
    fine = found["--samples", 10001]
    np.testing.assert_allclose(found[()], fine, rtol=1e-3)
    assert np.abs(found["--samples", 6] / fine - 1).max() > 0.1


def slide_forces(capsys, folder, values, *options):
    """`forces` of 2 kg on a slide, up to 9 m, 9 m/s and 9 N, through values of whole seconds."""
    urdf, path = folder / "slide.urdf", folder / "slide.csv"
    body = robots.link("body", robots.Solid(2.0, (0, 0, 0), (0.1, 0, 0, 0.1, 0, 0.1)))
    slide = robots.joint("slide", "base", "body", axis=(1, 0, 0), kind="prismatic")
    urdf.write_text(robots.robot(robots.link("base"), body, slide))
    urdf.with_suffix(".yaml").write_text("closed_loop: []\ntype: []\nname_mot: [slide]\n")
    path.write_text("t,slide\n" + "".join(f"{t},{value}\n" for t, value in enumerate(values)))
    return loop(capsys, "forces", urdf, "--motion", path, *options)


def test_limits_of_the_file_are_told_of_forces_too(capsys, tmp_path):
    """x = -10 t² has 40 N, 40 m/s at its end, and leaves the slide; 8.9 m in a second is only too fast."""
    code, out, err = slide_forces(capsys, tmp_path, (0, -10, -40))
    lines = [line for line in out.splitlines() if "limit exceeded" in line]
    assert (code, err, len(lines)) == (1, "", 3)
    assert re.fullmatch(r"limit exceeded: force of slide: -40 N at t = \S+ s, limit -9 N", lines[0])
    assert lines[1:] == [
        "limit exceeded: speed of slide: -40 m/s at t = 2 s, limit -9 m/s",
        "limit exceeded: position of slide: -40 m at t = 2 s, limit -9 m",
    ]
    code, out, _ = slide_forces(capsys, tmp_path, (0, -10, -40), "--json")
    assert (code, json.loads(out)["warnings"]) == (1, lines)
    code, out, _ = slide_forces(capsys, tmp_path, (0, 9.0, 9.0), "--json")
    told = json.loads(out)["warnings"]
    assert (code, len(told)) == (1, 3)  # the curve goes beyond its values
    code, out, _ = slide_forces(capsys, tmp_path, (0, 2.5, 9.0), "--json")
    assert (code, json.loads(out)["warnings"]) == (0, [])
    code, out, _ = slide_forces(capsys, tmp_path, (-9.0, 0.5), "--json")
    assert code == 0
    assert json.loads(out)["warnings"] == ["limit exceeded: speed of slide: 9.5 m/s at t = 0 s, limit 9 m/s"]


@pytest.mark.parametrize("samples", [(), ("--samples", 302), ("--samples", 5), ("--samples", 4)])
def test_forces_tell_where_closures_become_dependent(capsys, tmp_path, samples):
    """A parallelogram lies flat at a crank of 0 deg, after one second; some samples meet it."""
    urdf, path = tmp_path / "flat.urdf", tmp_path / "crank.csv"
    urdf.write_text(robots.four_bar(0.5, 0.2, 0.5, 0.2))
    reference = "reference: {crank_joint: 1.0, coupler_joint: -1.0, rocker_joint: 1.0}\n"
    urdf.with_suffix(".yaml").write_text(robots.FOUR_BAR_SIDECAR.to_yaml() + reference)
    path.write_text("t,crank_joint [deg]\n0,-30\n1,0\n2,30\n3,60\n")
    code, out, err = loop(capsys, "forces", urdf, "--motion", path, *samples)
    when = re.search(r"singular closures at t = (\S+) s: the closures become dependent", out + err)
    assert code == 1
    assert float(when[1]) == pytest.approx(1.0, abs=1e-3)
    path.write_text("t,crank_joint [deg]\n0,2\n1,30\n2,90\n3,178\n")
    code, out, err = loop(capsys, "forces", urdf, "--motion", path, *samples, "--json")
    assert (code, err, json.loads(out)["warnings"]) == (0, "", [])


@pytest.mark.parametrize("samples", [2, 3, 4, 5, 9, 200])
def test_few_samples_are_no_singularity(capsys, tmp_path, samples):
    """A crank that goes round turns the Jacobian, too: by half a turn between two of three samples."""
    path = tmp_path / "round.csv"
    path.write_text("t,crank_joint [deg]\n" + "".join(f"{t},{60 * t}\n" for t in range(7)))
    code, out, err = loop(
        capsys, "forces", GALLERY / "four_bar.urdf", "--motion", path, "--samples", samples, "--json"
    )
    assert (code, err, json.loads(out)["warnings"]) == (0, "", [])


def test_a_robot_without_inertia_is_told(capsys, tmp_path, five_bar):
    five_bar.write_text(re.sub(r"<inertial>.*?</inertial>", "", five_bar.read_text(), flags=re.DOTALL))
    (tmp_path / "m.csv").write_text("t,left_joint,right_joint\n0,1.9,1.2\n1,2.0,1.2\n")
    words = "the mechanism has a free motion without inertia"
    out = tmp_path / "c"
    code, _, err = loop(capsys, "codegen", five_bar, "--out", out, "--functions", "motion,inverse_dynamics")
    assert (code, err) == (2, f"p3dof: error: robot: the self-test finds no motion: {words}\n")
    assert not out.exists()
    for method in ((), ("--method", "general")):
        code, _, err = loop(capsys, "simulate", five_bar, "--set", "left_joint=1.9", *method)
        assert (code, err) == (1, f"p3dof: error: {words}\n")
    code, out, _ = loop(capsys, "forces", five_bar, "--motion", tmp_path / "m.csv", "--json")
    assert (code, json.loads(out)["warnings"]) == (0, ["all bodies are without mass"])


def test_generated_code_tells_what_it_leaves_out(capsys, tmp_path, five_bar):
    """With three motors for two freedoms all is there but what follows a motion."""
    told = {}
    for motors in ("left_joint, right_joint", "left_joint, right_joint, left_elbow", "left_joint"):
        sidecar = f"closed_loop: [[left_tip, right_tip]]\ntype: [3d]\nname_mot: [{motors}]\n"
        five_bar.with_suffix(".yaml").write_text(sidecar)
        code, out, _ = loop(capsys, "codegen", five_bar, "--out", tmp_path / motors, "--prefix", "five")
        assert code == 0
        told[motors] = [line for line in out.splitlines() if line.startswith("Left out")]
        header = (tmp_path / motors / "five.h").read_text()
        assert ("five_follow(" in header, "five_hybrid_dynamics(" in header) == (
            len(told) == 1,
            len(told) == 3,
        )
        assert all((f"five_{name}(" in header) == (len(told) < 3) for name in ("motion", "step", "integrate"))
    assert list(told.values()) == [
        [],
        [
            "Left out: five_start and five_follow: the motion of the motors does not determine the forces "
            "of all motors."
        ],
        [
            "Left out: motion, step, integrate, five_start and five_follow: the motion of the motors leaves "
            "joints free."
        ],
    ]


def test_a_motion_that_starts_where_forces_are_not_determined_is_refused(capsys, tmp_path):
    """All joints in one line: motors leave more free than anywhere else, and nothing is passive."""
    path = tmp_path / "flat.urdf"
    path.write_text(robots.flat_parallelogram(), encoding="utf-8")
    path.with_suffix(".yaml").write_text(robots.PARALLELOGRAM_SIDECAR.to_yaml(), encoding="utf-8")
    (name,) = robots.PARALLELOGRAM_SIDECAR.actuated
    for values, expected in (((0.0, 0.1), 1), ((0.1, 0.2), 0)):
        (tmp_path / "m.csv").write_text(f"t,{name}\n" + "".join(f"{t},{x}\n" for t, x in enumerate(values)))
        code, _, err = loop(capsys, "forces", path, "--motion", tmp_path / "m.csv")
        assert code == expected
        assert err.startswith("p3dof: error: the motion starts at a singular configuration") == bool(expected)


def test_motors_that_do_not_fit_each_other_are_told(capsys, tmp_path):
    """Twice the motors of a four-bar, which move against its coupler curve."""
    path = tmp_path / "two.urdf"
    path.write_text(robots.four_bar(0.5, 0.2, 0.45, 0.35))
    sidecar = Sidecar(robots.FOUR_BAR_SIDECAR.closures, ("crank_joint", "rocker_joint"))
    path.with_suffix(".yaml").write_text(sidecar.to_yaml())
    crank, _, rocker = map(float, robots.four_bar_q(0.7, 0.5, 0.2, 0.45, 0.35))
    rows = "".join(f"{t},{crank + 0.01 * t},{rocker}\n" for t in range(3))
    (tmp_path / "m.csv").write_text(f"t,crank_joint,rocker_joint\n{rows}")
    code, _, err = loop(capsys, "forces", path, "--motion", tmp_path / "m.csv")
    assert code == 1
    words = (
        r"this velocity: \S+ m/s or rad/s is left over; 2 values are prescribed at a mobility of 1: they have"
    )
    assert re.search(words, err)


def in_units(robot, length=1.0, inertia=1.0, mass=1.0):
    """A robot whose file has numbers in other units: so many of them are a metre, a kg m² and a kg."""
    model = robot.model.copy()
    for i in range(model.njoints):
        body, place = model.inertias[i], model.jointPlacements[i]
        model.jointPlacements[i] = pin.SE3(place.rotation, length * place.translation)
        model.inertias[i] = pin.Inertia(mass * body.mass, length * body.lever, inertia * body.inertia)
    for frame in model.frames:
        frame.placement = pin.SE3(frame.placement.rotation, length * frame.placement.translation)
    return ClosedLoopModel(model, robot.sidecar)


PLAIN = sorted(
    [*GALLERY.glob("*.urdf"), *(ROOT / "docs/benchmark/robots").glob("*.urdf"), ROOT / "urdf/p3dof.urdf"]
)


@pytest.mark.parametrize("path", PLAIN, ids=lambda path: path.stem)
def test_units_are_in_doubt_of_no_plain_robot_and_of_each_in_millimetres(path):
    robot = p3dof.load_robot(path)
    assert doubtful_bodies(robot) == []
    (told,) = doubtful_bodies(in_units(robot, 1e3, 1e6))
    assert told.startswith("are lengths in millimetres?")
    if path.stem != "linear_delta":  # its bodies fix no distance, so that it says less
        (told,) = doubtful_units(in_units(robot, 1e3))  # the inertias are right
        assert told.startswith("are lengths in millimetres?")
        for inertias, masses in ((1e6, 1.0), (1e9, 1e3)):  # kg mm², or g and g mm²
            (told,) = doubtful_units(in_units(robot, 1.0, inertias, masses))
            assert told.startswith("are inertias in kg mm²?")


@pytest.mark.parametrize("name", others())
def test_units_are_in_doubt_of_none_of_other_people_s_robots(name):
    assert doubtful_units(load(name)) == []


MOMENTS = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


@pytest.mark.parametrize(
    ("moments", "told"),
    [((1, 2, 3.002), 0), ((1, 2, 3.01), 1), ((-0.01, 2, 2), 1), ((0, 2, 2), 0), ((-3, -3, -3), 1)],
)
def test_moments_of_inertia_that_no_body_has_are_told(capsys, tmp_path, moments, told):
    """In whatever axes: of a body the largest is at most the sum of the others."""
    turn = pin.utils.rotate("x", 0.4) @ pin.utils.rotate("z", 0.7)
    own = turn @ np.diag(moments) @ turn.T
    values = (f'{name}="{float(own[at])!r}"' for name, at in MOMENTS.items())
    path, wanted = tmp_path / "five_bar.urdf", GALLERY / "five_bar.urdf"
    text = re.sub("<inertia [^>]*>", f"<inertia {' '.join(values)}/>", wanted.read_text("utf-8"), count=1)
    path.write_text(text, encoding="utf-8")
    shutil.copy(wanted.with_suffix(".yaml"), path.with_suffix(".yaml"))
    code, out, err = loop(capsys, "info", path)
    assert (code, err) == (0, "")
    assert out.endswith("more than the others together: the one after left_motor\n") == bool(told)


def test_what_speaks_for_millimetres_is_told(capsys, tmp_path):
    """A rod of 1.3 kg whose end is 250 m away; its loop closes."""
    path = tmp_path / "large.urdf"
    large = in_units(gallery("four_bar"), 1e3, 1e6)
    for file, text in zip((path, path.with_suffix(".yaml")), texts(large), strict=True):
        file.write_text(text)
    (tmp_path / "m.csv").write_text("t,crank_joint\n0,0.5\n1,0.6\n")
    options = {"info": (), "forces": ("--motion", tmp_path / "m.csv"), "simulate": ("--duration", 0.01)}
    heaviest = max(range(1, large.model.njoints), key=lambda i: large.model.inertias[i].mass)
    told = f"body after {large.model.names[heaviest]} has {large.model.inertias[heaviest].mass:.3g} kg"
    for command, more in options.items():
        code, out, err = loop(capsys, command, path, *more)
        words = " ".join((out + err).split())
        assert code == 0
        assert "are lengths in millimetres? They are read in metres" in words
        assert told in words


def test_what_is_regular_is_asked_once_for_all_steps_of_a_motion(five_bar, motion, monkeypatch):
    robot, asked, rank = p3dof.load_robot(five_bar), [], ClosedLoopModel.rank
    found = forces_along(robot, motion, samples=101)
    monkeypatch.setattr(ClosedLoopModel, "rank", lambda self, q: asked.append(q) or rank(self, q))
    assert found.crossing() is None
    assert len(asked) == 1


def test_a_motion_that_the_robot_cannot_make(capsys, tmp_path):
    urdf, path = tmp_path / "short.urdf", tmp_path / "far.csv"
    urdf.write_text(robots.four_bar(0.5, 0.45, 0.3, 0.35))
    urdf.with_suffix(".yaml").write_text(robots.FOUR_BAR_SIDECAR.to_yaml())
    path.write_text("t,crank_joint\n0,0.7\n0.5,1.0\n1,3.0\n")
    code, _, err = loop(capsys, "forces", urdf, "--motion", path, "--out", tmp_path / "f.csv")
    assert code == 1
    assert re.match(r"p3dof: error: at t = 0\.\d+ s: the loops do not close at the target", err)
    assert len(err.splitlines()) == ONE_LINE
    assert not (tmp_path / "f.csv").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,left_joint\n0,1\n", "expected the columns t,left_joint,right_joint"),
        ("t,left_joint,other\n0,1,2\n", "column 3: expected right_joint, got 'other'"),
        ("t,left_joint,other\n0,1,2\n", "(the columns t,left_joint,right_joint, the joints in any order)"),
        ("t,left_joint [mm],right_joint\n0,1,2\n", "expected a unit of rad, deg, °, mrad, got [mm]"),
        (
            "t,left_joint,right_joint,other dot\n0,1,2,0\n",
            "column 4: expected no more columns, got 'other dot'",
        ),
        ("t,gap,left_joint,other.x\n0,0,1,2\n", "column 4: expected right_joint, got 'other.x'"),
        ("t,gap,left_joint,left_joint\n0,0,1,2\n", "column 4: expected right_joint, got 'left_joint'"),
        ("t,gap,left_joint,right_joint\n0,x,1,2\n", "column gap: expected a number, got 'x'"),
        ("t,gap,left_joint,right_joint\n0,0,x,2\n", "column left_joint: expected a number, got 'x'"),
        ("gap,t,left_joint,right_joint\n0,0,0,2\n0,0,0,2\n", "column t: expected a time after 0, got 0"),
        ("t,left_joint,right_joint\n0,1,x\n", "column right_joint: expected a number, got 'x'"),
        ("t,left_joint,right_joint\n0,1,1\n0,1,1\n", "column t: expected a time after 0, got 0"),
        ("", "expected a motion of joints"),
    ],
)
def test_bad_motions_of_joints(capsys, tmp_path, five_bar, text, words):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    code, _, err = loop(capsys, "forces", five_bar, "--motion", path)
    assert code == 2
    assert words in err
    assert len(err.splitlines()) == ONE_LINE


def test_simulate_keeps_energy_and_loops(capsys, tmp_path, five_bar):
    start = ("--set", "left_joint=1.9", "--set", "right_joint=1.2")
    options = ("--actuator-force", "left_joint=2000 N mm", "--duration", 0.2, "--samples", 201)
    code, out, _ = loop(capsys, "simulate", five_bar, *start, *options, "--out", tmp_path / "run.csv")
    assert code == 0
    assert "work of the actuators" in out
    found = columns(tmp_path / "run.csv")
    np.testing.assert_array_equal(found["force left_joint [N m]"], 2.0)
    np.testing.assert_array_equal(found["force right_joint [N m]"], 0.0)
    angles = np.column_stack([found[name] for name in ("left_joint", "right_joint")])
    np.testing.assert_allclose(angles[0], [1.9, 1.2], rtol=0, atol=1e-12)
    work = 2.0 * (angles[-1, 0] - angles[0, 0])  # a constant torque
    assert abs(work) > 0.1
    assert found["energy [J]"][-1] - found["energy [J]"][0] == pytest.approx(work, abs=1e-7)
    elbow = robots.five_bar_q(*angles[-1])[1]
    assert found["left_elbow"][-1] == pytest.approx(elbow, abs=1e-7)
    assert found["gap"].max() < 1e-8


@pytest.mark.parametrize(
    "options", [(), ("--rate", 300), ("--rate", 300, "--delay", "4.3ms"), ("--rate", 300, "--bandwidth", 40)]
)
def test_the_work_of_simulate_is_the_energy_that_a_robot_without_losses_gains(
    capsys, tmp_path, five_bar, monkeypatch, options
):
    """Whatever acts between the few samples that are asked for; without a look at the ticks it is not."""
    motion, out = tmp_path / "m.csv", tmp_path / "run.csv"
    motion.write_text("t,left_joint,right_joint\n0,1.9,1.2\n0.2,2.3,1.3\n0.4,1.5,0.8\n0.6,1.9,1.2\n")
    given = ("--motion", motion, "--controller", "pd", "--samples", 7, *options, "--out", out, "--json")

    def told():
        code, text, _ = loop(capsys, "simulate", five_bar, *given)
        rows = dict(json.loads(text)["tables"][0]["rows"])
        return code, rows["energy gained"], rows["work of the actuators"]

    code, energy, work = told()
    assert code == 0
    assert abs(energy) > 0.05
    assert work == pytest.approx(energy, rel=1e-5 if "--bandwidth" in options else 1e-7)
    time = columns(out)["t [s]"]
    np.testing.assert_allclose(time, np.linspace(0, 0.6, 7), rtol=0, atol=1e-12)
    monkeypatch.setattr("p3dof.cli.loop.simulate._looked_at", lambda asked, _: asked)
    assert told()[2] != pytest.approx(energy, rel=0.01)


def test_what_a_run_and_forces_write_is_a_motion_again(capsys, tmp_path, five_bar):
    """A constant torque moves the robot; the forces of that motion are it. Only joints and time are read."""
    start = ("--set", "left_joint=1.9", "--set", "right_joint=1.2", "--actuator-force", "left_joint=2")
    run_, bare, first, again = (tmp_path / f"{name}.csv" for name in ("run", "bare", "first", "again"))
    options = ("--duration", 0.2, "--samples", 21, "--multipliers")
    assert loop(capsys, "simulate", five_bar, *start, *options, "--out", run_)[0] == 0
    names = list(columns(run_))
    keep = [names.index(name) for name in ("t [s]", "left_joint", "right_joint")]
    lines = [line.split(",") for line in run_.read_text().splitlines()]
    bare.write_text("\n".join(",".join(line[k] for k in keep) for line in lines))
    for source in (bare, run_):
        code, _, err = loop(capsys, "forces", five_bar, "--motion", source, "--samples", 201, "--out", first)
        assert code == 0
    beside = "left_elbow, right_elbow, left_joint dot, left_elbow dot and 9 more"
    assert err == f"p3dof: {run_}: passed over what p3dof writes beside a motion: {beside}\n"
    found = columns(first)
    np.testing.assert_allclose(found["force left_joint [N m]"][50:150], 2, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found["force right_joint [N m]"][50:150], 0, rtol=0, atol=1e-5)
    code, _, err = loop(capsys, "forces", five_bar, "--motion", first, "--samples", 201, "--out", again)
    assert code == 0
    assert "passed over" in err
    assert loop(capsys, "forces", five_bar, "--motion", bare, "--samples", 201, "--out", run_)[2] == ""
    assert run_.read_bytes() == first.read_bytes()  # what is beside changes nothing
    for name, column in columns(again).items():
        np.testing.assert_allclose(found[name], column, rtol=0, atol=1e-4, err_msg=name)
    code, _, err = loop(capsys, "simulate", five_bar, "--motion", first, "--controller", "pd")
    assert (code, "passed over" in err) == (0, True)


@pytest.mark.parametrize("name", ["stewart", "leg"])
def test_joints_of_several_freedoms_are_passed_over(tmp_path, name):
    robot = gallery(name)
    q, v = robot.assemble().q, np.zeros(robot.model.nv)
    path = simulate_robot(robot, 1e-3, q, v, samples=2).save(tmp_path / "run.csv", multipliers=True)
    with pytest.warns(ModelWarning, match="passed over"):
        reference = JointReference.from_csv(robot, path)
    wanted = columns(path)
    np.testing.assert_array_equal(reference.curve.values.T, [wanted[joint] for joint in robot.actuated])


def test_simulate_follows_a_motion_under_a_controller(capsys, tmp_path, five_bar):
    """Computed torque at 200 Hz, pushed at the tip; the same run in Python."""
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    time = np.linspace(0, 0.2, 21)
    angles = np.column_stack([1.9 + 2.0 * time**3, 1.2 - 1.0 * time**3])
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in np.column_stack([time, angles]))
    (tmp_path / "m.csv").write_text(f"t,left_joint,right_joint\n{rows}\n")
    files = ("--out", tmp_path / "run.csv", "--multipliers", "--figure", tmp_path / "run.png")
    options = ("--controller", "computed-torque", "--rate", 200, "--external", "left_tip=0,0,-5,0,0,0")
    code, out, _ = loop(capsys, "simulate", five_bar, "--motion", tmp_path / "m.csv", *options, *files)
    assert code == 0
    assert "largest error of an actuated joint" in out
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
    model, found = p3dof.load_robot(five_bar), columns(tmp_path / "run.csv")
    wanted = JointReference(time, angles)
    state = model.complete(*wanted.at(0.0), robots.five_bar_q(1.9, 1.2))
    run_ = simulate_robot(
        model,
        0.2,
        state.q,
        state.v,
        JointComputedTorque(model, wanted, *gains(5)),
        control=ControlLoop(rate=200),
        external={"left_tip": [0, 0, -5, 0, 0, 0]},
        method="general",
    )
    np.testing.assert_allclose(found["left_joint"], run_.q[:, 0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(found["force left_joint [N m]"], run_.forces[:, 0], rtol=0, atol=1e-6)
    assert np.abs(found["multiplier left_tip/right_tip.0"]).max() > 1
    assert found["t [s]"][-1] == 0.2


@pytest.mark.skipif(compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize("controller", ["none", "pd"])
def test_simulate_compiled_is_the_same_run(capsys, tmp_path, five_bar, controller):
    options = ("--set", "left_joint=1.9", "--set", "right_joint=1.2", "--duration", 0.1, "--samples", 11)
    options = (*options, "--controller", controller, "--external", "left_tip=0,0,-5,0,0,0")
    runs = []
    for method in ("general", "compiled"):
        path = tmp_path / f"{method}.csv"
        assert loop(capsys, "simulate", five_bar, *options, "--method", method, "--out", path)[0] == 0
        runs.append(columns(path))
    for name, column in runs[0].items():
        if name != "gap":
            np.testing.assert_allclose(runs[1][name], column, rtol=1e-6, atol=1e-6, err_msg=name)


def test_simulate_stops_at_limits_or_ignores_them(capsys, five_bar):
    text = five_bar.read_text()
    five_bar.write_text(text.replace('lower="-9" upper="9" effort="9"', 'lower="-9" upper="1.95" effort="1"'))
    start = (
        "--set",
        "left_joint=1.9",
        "--set",
        "right_joint=1.2",
        "--actuator-force",
        "left_joint=3",
        "--duration",
        0.3,
    )
    code, out, _ = loop(capsys, "simulate", five_bar, *start)
    assert code == 1
    assert re.search(
        r"ended by joint limit at t = 0\.\d+ s: the joint 'left_joint' at its upper limit, 1\.95", out
    )
    assert "limit exceeded: force of left_joint: 3 N m" in out
    code, out, _ = loop(capsys, "simulate", five_bar, *start, "--limits", "ignore")
    assert code == 0
    assert "ended by" not in out
    holding = ("--controller", "pd", "--kp", "30,20", "--kd", 2, "--rate", 100, "--duration", 0.1)
    code, out, _ = loop(capsys, "simulate", five_bar, *start[:4], *holding)
    assert code == 0
    error = re.search(r"largest error of an actuated joint\W+(\S+) m or rad", out)
    assert float(error[1]) < 1e-9  # it stays where it is
    code, out, _ = loop(capsys, "simulate", five_bar, *start[:4], *holding, "--saturation", "file")
    assert code == 0
    assert re.search(r"largest force of an actuator\W+1 N", out)


def test_numbers_of_simulate_have_units(five_bar, tmp_path, capsys):
    """The same run, to the byte; saturation and noise in the units of the actuated joints, which turn."""
    given = {
        "--duration": ("0.02", "20ms"),
        "--rate": ("500", "0.5 kHz"),
        "--saturation": ("3", "3000 N mm"),
        "--noise": ("0.001 0.02", "1mrad 20mrad/s"),
        "--resolution": ("0.002", "2 mrad"),
        "--delay": ("0.002", "2 ms"),
        "--bandwidth": ("150", "0.15 kHz"),
        "--external": ("left_tip=1,0,0.5,0,0,0.001", "left_tip=1000 mN,0,0.5 N,0,0,1 N mm"),
    }
    files = []
    for i, out in enumerate((tmp_path / "plain.csv", tmp_path / "units.csv")):
        line = ["--controller", "pd", "--frequency", "4", "--method", "general", "--out", out]
        for option, values in given.items():
            line += [option, *(values[i].split() if option == "--noise" else [values[i]])]
        assert loop(capsys, "simulate", five_bar, *line)[0] == 0
        files.append(out.read_bytes())
    assert files[0] == files[1]


def test_a_number_with_a_unit_is_for_motors_that_are_alike():
    """Slides and hinges together have no common unit; a plain number, and None, are for all."""
    given = Amount(FORCE, MOMENT).convert("5 N", None, None)
    for number in (3.0, None, True):
        require_unit("--saturation", number, ["N m", "N"])
    with pytest.raises(
        InputError, match=r"--saturation: expected N and N m, as .*, by a number without a unit, got 5 N$"
    ):
        require_unit("--saturation", given, ["N m", "N"])


def test_many_limits_that_are_exceeded_are_counted(capsys, tmp_path):
    """Ten sliders side by side, each pushed by twice its effort: eight are named."""
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    parts = [
        f'<link name="body_{i}">{body}</link><joint name="slide_{i}" type="prismatic"><parent link="base"/>'
        f'<child link="body_{i}"/><limit lower="-9" upper="9" effort="1" velocity="9"/></joint>'
        for i in range(10)
    ]
    path = tmp_path / "sliders.urdf"
    path.write_text(f'<robot name="sliders"><link name="base"/>{"".join(parts)}</robot>')
    for count in (8, 10):
        forces = [word for i in range(count) for word in ("--actuator-force", f"slide_{i}=2")]
        code, out, _ = loop(capsys, "simulate", path, *forces, "--duration", 0.1)
        assert code == 0
        assert re.findall(r"limit exceeded: force of slide_(\d): 2 N", out) == list("01234567")
        assert re.findall(r"(\S+) more limits are exceeded", out) == ([] if count == 8 else ["2"])


def test_a_controller_of_any_robot_brings_it_to_rest():
    model, goal = p3dof.ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR), (2.0, 1.1)
    q = robots.five_bar_q(*goal)
    hold = model.inverse_dynamics(q, np.zeros(4), np.zeros(4)).tau
    start = robots.five_bar_q(1.95, 1.15)

    def controller(seen):
        return hold + 150 * (np.array(goal) - seen.positions) - 15 * seen.velocities

    found = simulate_robot(model, 1.5, start, None, controller, samples=21, method="general")
    assert found.finished
    np.testing.assert_allclose(found.q[-1], q, atol=2e-3)
    np.testing.assert_allclose(found.v[-1], 0, atol=2e-2)
    assert found.forces.shape == (21, 2)
    assert found.gap.max() < 1e-9


def test_runs_that_cannot_be(five_bar):
    model = p3dof.load_robot(five_bar)
    q = robots.five_bar_q(1.9, 1.2)
    for arguments, words in (
        ((model, 0.0), "duration"),
        ((model, 1.0, np.zeros(4)), "q: the loops are open"),
        ((model, 1.0, q, [1.0, 0, 0, 0]), "v: opens the loops"),
        ((model, 1.0, q, None, [1.0]), "controller: expected shape"),
        ((object(), 1.0), "loop: expected a ClosedLoopModel"),
    ):
        with pytest.raises(InputError, match=words):
            simulate_robot(*arguments, method="general")
    with pytest.raises(InputError, match="allow it by time_limit"):
        simulate_robot(model, 1e6, q, integration=Integration(time_limit=1.0), method="general")
    with pytest.raises(InputError, match="integration: expected Integration"):
        simulate_robot(model, 1.0, q, integration=1e-9, method="general")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("assemble", "FILE", "--set", "left_joint"), "--set: expected JOINT=VALUE, got 'left_joint'"),
        (
            ("assemble", "FILE", "--set", "left_elbow=1"),
            "the joint 'left_elbow' is not actuated; did you mean",
        ),
        (("assemble", "FILE", "--set", "left_joint=1 kg"), "--set left_joint: expected an angle"),
        (("info", "FILE", "--around", "1.9"), "--around: expected JOINT=VALUE, got '1.9'"),
        (
            ("forces", "FILE", "--around", "left_jont=1", "--motion", "FILE"),
            "--around: there is no joint 'left_jont' with one degree of freedom; did you mean 'left_joint'",
        ),
        (("info", "FILE", "--around", "left_joint=1,left_joint=2"), "the joint 'left_joint' is set twice"),
        (("info", "FILE", "--around", "left_joint=5 mm"), "--around left_joint: expected an angle"),
        (("info", "FILE", "--around", "left_joint=0,5"), "with a decimal point it is 0.5"),
        (("assemble", "FILE", "--set", "left_joint=nan"), "--set left_joint: expected a finite number"),
        (
            ("assemble", "FILE", "--set", "left_joint=1", "--set", "left_joint=1"),
            "the joint 'left_joint' is set twice",
        ),
        (("simulate", "FILE", "--actuator-force", "left_joint=1 N"), "force left_joint: expected a moment"),
        (("simulate", "FILE", "--duration", "0"), "Invalid value for '--duration'"),
        (("simulate", "FILE", "--controller", "lqr"), "'lqr' is not one of 'none', 'pd', 'computed-torque'"),
        (
            ("simulate", "FILE", "--controller", "pd", "--kp", "1,2,3"),
            "error: --kp: expected one number or 2",
        ),
        (
            ("simulate", "FILE", "--controller", "pd", "--kp", "much"),
            "error: --kp: expected numbers with commas",
        ),
        (("simulate", "FILE", "--controller", "pd", "--kp", "-5"), "error: --kp: expected zero or more"),
        (("simulate", "FILE", "--controller", "pd", "--kd", "-5"), "error: --kd: expected zero or more"),
        (("simulate", "FILE", "--controller", "pd", "--kd", "nan"), "--kd: expected finite numbers"),
        (
            ("simulate", "FILE", "--controller", "pd", "--actuator-force", "left_joint=1"),
            "exclude each other",
        ),
        (("simulate", "FILE", "--motion", "FILE"), "--motion: needs a --controller that follows it"),
        (("simulate", "FILE", "--noise", "1", "1"), "--noise: needs a --controller"),
        (("simulate", "FILE", "--kp", "5"), "--kp: needs a --controller"),
        (("simulate", "FILE", "--kd", "5"), "--kd: needs a --controller"),
        (("simulate", "FILE", "--rate", "500"), "--rate: needs a --controller"),
        (("simulate", "FILE", "--frequency", "3"), "--frequency: needs a --controller"),
        (
            ("simulate", "FILE", "--method", "general", "--time-limit", "1e-9"),
            "fewer samples or --method compiled, or allow it by --time-limit",
        ),
        (("simulate", "FILE", "--saturation", "-1"), "'--saturation': expected a positive number, got -1"),
        (
            ("simulate", "FILE", "--saturation", "foo"),
            "expected a force or a moment such as '5 kN', or file, got 'foo'",
        ),
        (
            ("simulate", "FILE", "--saturation", "5 N"),
            "--saturation: expected N m, as the actuated joints have, got 5 N",
        ),
        (
            ("simulate", "FILE", "--resolution", "1 mm"),
            "--resolution: expected rad, as the actuated joints have, got 0.0",
        ),
        (
            ("simulate", "FILE", "--noise", "1", "1 mm/s"),
            "--noise: expected rad/s, as the actuated joints have, got 0.0",
        ),
        (
            ("simulate", "FILE", "--duration", "2 mm"),
            "'--duration': expected a time such as '5 ms', got '2 mm'",
        ),
        (
            ("simulate", "FILE", "--external", "left_tip=1 m,2,3"),
            "--external left_tip: expected a force, a number in N",
        ),
        (("simulate", "FILE", "--multipliers"), "--multipliers needs --out"),
        (
            ("simulate", "FILE", "--external", "left_tip=1,2"),
            "--external left_tip: expected three or six numbers, got 2",
        ),
        (("simulate", "FILE", "--external", "1,2"), "--external: expected FRAME=FX,FY,FZ or with"),
        (("simulate", "FILE", "--external", "hand=1,2,3,4,5,6"), "external: the frame 'hand' does not exist"),
        (("simulate", "FILE", "--external", "left_tip=no.csv"), "no.csv: cannot be read"),
        (
            ("simulate", "FILE", "--external", "a=1,2,3,4,5,6", "--external", "a=1,2,3,4,5,6"),
            "--external: the frame 'a' is named twice",
        ),
        (("simulate", "FILE", "--limits", "bounce"), "'bounce' is not one of 'stop', 'ignore'"),
        (("simulate", "FILE", "--figure", "run.txt"), "expected a file name that ends in"),
        (("info", "nowhere.urdf"), "nowhere.urdf"),
        (("info", "FILE", "nowhere.yaml"), "nowhere.yaml"),
        (("info", "FILE", "--reference", "home"), "needs an SRDF"),
        (
            ("simulate", "FILE", "--reference", "m.csv"),
            "--reference: expected a keyframe or group state; a motion",
        ),
        (("forces", "FILE"), "Missing option '--motion'"),
        (("forces", "FILE", "--motion", "nowhere.csv"), "nowhere.csv: cannot be read"),
        (("export", "FILE", "--out", "robot.usd"), "expected a file name that ends in .urdf"),
        (("export", "FILE", "--format", "mjcf", "--out", "a.urdf"), "that ends in .xml for mjcf"),
        (("export", "FILE", "--out", "FILE"), "would be overwritten"),
        (("assemble", "FILE", "--out", "q.txt"), "expected a file name that ends in .csv, .yaml or .yml"),
        (
            ("show", "FILE", "--out", "p.html", "--set", "left_joint=1", "--motion", "FILE"),
            "exclude each other",
        ),
        (("show", "FILE", "--no-open", "--simulate", "1", "--motion", "FILE"), "exclude each other"),
        (("show", "FILE", "--no-open", "--actuator-force", "left_joint=1"), "force needs --simulate"),
        (("show", "FILE", "--no-open", "--at", "9"), "--at: expected a time from 0 to 4 s, got 9"),
        (("show", "FILE", "--no-open", "--external", "left_tip=1,2"), "expected three or six numbers, got 2"),
        (("show", "FILE", "--no-open", "--external", "nowhere=1,2,3"), "'nowhere' does not exist"),
        (("show", "FILE", "--no-open", "--external", "left_tip=1,2,nan"), "expected finite numbers"),
        (("show", "FILE", "--no-open", "--package-dir", "nowhere"), "expected folders, got 'nowhere'"),
        (("show", "FILE", "--out", "p.txt"), "expected a file name that ends in .html, .mp4, .gif or .png"),
    ],
)
def test_bad_input_is_one_line(capsys, tmp_path, monkeypatch, five_bar, arguments, words):
    monkeypatch.chdir(tmp_path)
    before = {path.name for path in tmp_path.iterdir()}
    code, _, err = loop(capsys, *(five_bar if word == "FILE" else word for word in arguments))
    assert code == 2
    assert words in err
    assert len(err.splitlines()) == ONE_LINE
    assert {path.name for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("how", [(), ("--controller", "pd"), ("--limits", "ignore")])
def test_a_singular_start_is_one_line(capsys, tmp_path, how):
    path, sidecar = tmp_path / "flat.urdf", tmp_path / "flat.yaml"
    path.write_text(robots.flat_parallelogram(), encoding="utf-8")
    sidecar.write_text(robots.PARALLELOGRAM_SIDECAR.to_yaml(), encoding="utf-8")
    code, _, err = loop(capsys, "simulate", path, "--duration", "0.1", *how)
    assert code == 2
    assert err.startswith("p3dof: error: the run would start at a singular configuration, ")
    assert err.count("\n") == 1


def test_a_start_beyond_a_limit_names_the_options(capsys):
    code, _, err = loop(capsys, "simulate", GALLERY / "five_bar.urdf", "--set", "left_motor=400 deg")
    assert code == 2
    assert err.startswith("p3dof: error: the run would start beyond a limit: joint limit: ")
    assert err.endswith("(see --limits)\n")


def test_a_sidecar_of_another_robot_is_named(capsys, tmp_path, five_bar):
    other = tmp_path / "other.yaml"
    other.write_text(five_bar.with_suffix(".yaml").read_text().replace("left_tip", "left_toe"))
    code, _, err = loop(capsys, "info", five_bar, other)
    assert code == 2
    assert "the frame 'left_toe' does not exist" in err
    assert err.endswith("(five_bar.urdf with other.yaml)\n")


def test_no_compiler_is_told_in_one_line(capsys, monkeypatch, five_bar, motion):
    monkeypatch.setattr("p3dof.loops.compiled.build.compiler", lambda: None)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        code, _, err = loop(capsys, "forces", five_bar, "--motion", motion, "--method", "compiled")
    assert code == 0
    assert err == "p3dof: no C compiler (gcc or clang) on the path: NumPy computes the same, more slowly\n"


def test_a_doubtful_file_is_told_in_one_line(capsys, five_bar):
    sidecar = five_bar.with_suffix(".yaml")
    sidecar.write_text(sidecar.read_text() + "joint_name: [left_elbo]\njoint_type: [SPHERICAL]\n")
    code, _, err = loop(capsys, "info", five_bar)
    assert code == 0
    assert err.startswith("p3dof: sidecar: joint_name[0]: the joint 'left_elbo' does not exist; did you mean")
    assert len(err.splitlines()) == ONE_LINE


# --- written files ------------------------------------------------------------------------------------------


def hexapod():
    return ClosedLoopModel.from_urdf(robots.hexapod(), robots.HEXAPOD_SIDECAR)


def geared():
    sidecar = Sidecar(
        (),
        ("crank_joint",),
        (Coupling("rocker_joint", "crank_joint", (0.1, -2.0)), Coupling("coupler_joint", None, (0.3,))),
        reference={"crank_joint": 0.2},
    )
    return ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)


def odd_axes():
    """A free base, a ball, a continuous joint, a slide along one, frames in between."""
    rng = np.random.default_rng(4)
    model = pin.Model()
    skew = np.array([0.6, 0.0, -0.8])
    kinds = (
        pin.JointModelFreeFlyer(),
        pin.JointModelSpherical(),
        pin.JointModelRUBY(),
        pin.JointModelPrismaticUnaligned(skew),
        pin.JointModelRevoluteUnaligned(skew),
    )
    for i, kind in enumerate(kinds):
        place = pin.SE3(pin.rpy.rpyToMatrix(rng.normal(size=3)), rng.normal(size=3))
        model.addJointFrame(model.addJoint(i, kind, place, f"joint{i}"))
        model.appendBodyToJoint(i + 1, pin.Inertia.Random(), pin.SE3.Random())
        model.addFrame(pin.Frame(f"mark{i}", i + 1, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    return ClosedLoopModel(model, Sidecar((Closure("mark2", "mark4", "hinge"),), ("joint3", "joint4")))


def endless():
    """Continuous joints about skew axes."""
    text = robots.four_bar(*robots.FOUR_BAR, kind="continuous").replace('"0 1 0"', '"0.6 0 -0.8"')
    return ClosedLoopModel.from_urdf(text, robots.FOUR_BAR_SIDECAR)


def rotors():
    """Bodies without mass that have inertia, as rotors in public files do."""
    loop = geared()
    loop.model.inertias[2] = pin.Inertia(0.0, np.zeros(3), np.diag([1e-4, 2e-4, 2e-4]))
    return loop


@pytest.mark.parametrize("make", [hexapod, geared, odd_axes, endless, rotors])
def test_a_robot_that_is_written_is_the_same_robot_when_it_is_read(make):
    pin.seed(3)
    one = make()
    other = p3dof.load_robot(*texts(one))
    kinds = [[str(joint.shortname()) for joint in m.model.joints] for m in (one, other)]
    assert kinds[0] == kinds[1]
    assert list(one.model.names) == list(other.model.names)
    assert (one.actuated, one.constraint_rows) == (other.actuated, other.constraint_rows)
    rng, nv = np.random.default_rng(1), one.model.nv
    q = pin.integrate(one.model, pin.neutral(one.model), rng.normal(size=nv))
    v, a = rng.normal(size=(2, nv))
    data = one.model.createData(), other.model.createData()
    forces = [np.array(pin.rnea(m.model, d, q, v, a)) for m, d in zip((one, other), data, strict=True)]
    np.testing.assert_allclose(forces[1], forces[0], rtol=0, atol=1e-12 * np.abs(forces[0]).max())
    np.testing.assert_allclose(other.closure_error(q), one.closure_error(q), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(other.reference, one.reference)


def test_what_no_urdf_can_hold_is_refused():
    five = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    five.model.gravity.linear = np.zeros(3)
    with pytest.raises(ModelError, match="the gravity of the robot is not"):
        texts(five)
    model = pin.Model()
    model.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), "slides")
    with pytest.raises(ModelError, match="'slides' is a JointModelTranslation, which no URDF knows"):
        texts(ClosedLoopModel(model, Sidecar((), ())))


def test_export_writes_both_files_or_none(capsys, tmp_path, five_bar, motion):
    target = tmp_path / "new" / "robot.urdf"
    code, out, _ = loop(capsys, "export", five_bar, "--out", target)
    assert code == 0
    assert f"wrote {target}" in out
    args = ("--motion", motion, "--out")
    assert loop(capsys, "forces", five_bar, *args, tmp_path / "1.csv")[0] == 0
    assert loop(capsys, "forces", target, *args, tmp_path / "2.csv")[0] == 0
    one, other = columns(tmp_path / "1.csv"), columns(tmp_path / "2.csv")
    for name, values in one.items():
        np.testing.assert_allclose(other[name], values, rtol=0, atol=1e-11)
    pytest.importorskip("mujoco")
    (tmp_path / "tight.urdf").write_text(five_bar.read_text().replace('upper="9"', 'upper="-9"'))
    code, out, err = loop(
        capsys, "export", tmp_path / "tight.urdf", five_bar.with_suffix(".yaml"), "--out", tmp_path / "r.xml"
    )
    assert (code, out.strip()) == (0, f"wrote {tmp_path / 'r.xml'}")
    assert "MJCF: limits that leave a joint no travel are not written: 'left_joint'" in err
    assert loop(capsys, "forces", tmp_path / "r.xml", *args, tmp_path / "3.csv")[0] == 0
    for name, values in columns(tmp_path / "3.csv").items():
        np.testing.assert_allclose(values, one[name], rtol=0, atol=1e-9)
    for more in ((), ("--format", "sdf"), ("--format", "drake")):
        assert loop(capsys, "export", five_bar, "--out", tmp_path / "r.sdf", *more)[0] == 0
        assert ("drake:ball_constraint" in (tmp_path / "r.sdf").read_text()) == ("drake" in more)
    assert not (tmp_path / "r.yaml").exists()
    (tmp_path / "blocked.yaml").mkdir()
    code, _, err = loop(capsys, "export", five_bar, "--out", tmp_path / "blocked.urdf")
    assert code == 2
    assert "blocked.yaml" in err
    assert not (tmp_path / "blocked.urdf").exists()


def test_show_writes_a_page_with_every_joint(capsys, tmp_path, five_bar, motion):
    def written(*options):
        path = tmp_path / "page.html"
        code, out, _ = loop(capsys, "show", five_bar, *options, "--out", path)
        assert (code, f"wrote {path}" in out) == (0, True)
        page = path.read_text(encoding="utf-8")
        (text,) = re.findall(r'id="p3dof-document">(.*?)</script>', page, re.DOTALL)
        return json.loads(text)

    document = written("--motion", motion)
    names = {joint["name"] for joint in document["scene"]["joints"]}
    assert names == {str(name) for name in p3dof.load_robot(five_bar).model.names[1:]}
    assert decoded(document["runs"][0]["time"]).size > 1
    (run,) = written("--set", "left_joint=1.9")["runs"]
    forces = [decoded(c["values"]) for c in run["curves"] if c["group"].startswith("Actuator")]
    assert len(forces) == 2
    assert np.isfinite(forces).all()  # determined
    swinging, still = written()["runs"][0], written("--still")["runs"][0]
    assert decoded(swinging["time"])[[0, -1]].tolist() == [0, 4]
    assert np.ptp(decoded(swinging["q"]), axis=0).max() > 0.1
    assert "through the ranges of the motors" in swinging["notes"][0]
    assert (decoded(still["time"]).size, still["notes"]) == (1, [])
    weight = ("--external", "left_tip=0,0,-5")
    assert decoded(written(*weight)["runs"][0]["time"]).size == 1


def test_show_takes_a_picture(capsys, tmp_path, five_bar):
    find_chromium()
    picture = tmp_path / "still.png"
    code, out, _ = loop(capsys, "show", five_bar, "--closure-forces", "--out", picture)
    assert code == 0
    assert f"wrote {picture}" in out
    colours = np.asarray(as_image(picture.read_bytes())).reshape(-1, 3).astype(int)
    violet = (colours[:, 2] > colours[:, 0] + 30) & (colours[:, 0] > colours[:, 1] + 30)
    assert violet.sum() > 100  # closures and their forces are violet, and nothing else


def test_show_makes_a_film(capsys, tmp_path, five_bar):
    find_chromium()
    film = tmp_path / "fall.gif"
    options = ("--simulate", "0.05", "--fps", "20", "--speed", "0.5", "--size", "160", "120")
    code, out, _ = loop(capsys, "show", five_bar, *options, "--out", film)
    assert code == 0
    assert f"wrote {film}" in out
    with Image.open(film) as played:
        assert (played.size, played.n_frames) == ((160, 120), 3)
        first = np.asarray(played.convert("RGB")).astype(int)
        played.seek(2)
        assert np.abs(np.asarray(played.convert("RGB")) - first).max() > 50


def test_rods_of_a_robot_reach_from_joint_to_joint_and_meet_where_loops_close():
    pytest.importorskip("coal", reason="coal is not installed")
    from p3dof.viewer.document.figure import StickFigure

    model = ClosedLoopModel.from_urdf(robots.five_bar(), robots.FIVE_BAR_SIDECAR)
    figure, q = StickFigure(model), robots.five_bar_q(1.9, 1.2)
    data, shapes = model.model.createData(), figure.visual_model.createData()
    pin.updateGeometryPlacements(model.model, data, figure.visual_model, shapes, q)
    ends = {}
    for solid, place in zip(figure.visual_model.geometryObjects, shapes.oMg, strict=True):
        if "_rod_" in solid.name:
            half = np.array([0, 0, solid.geometry.halfLength])
            ends[solid.name] = place.act(-half), place.act(half)
    assert len(ends) == 5
    ground = {tuple(np.round(end, 9)) for end in ends.pop("universe_rod_0")}
    assert ground == {tuple(np.round(ends[f"{side}_joint_rod_0"][0], 9)) for side in ("left", "right")}
    for side in ("left", "right"):
        near, far = ends[f"{side}_joint_rod_0"], ends[f"{side}_elbow_rod_0"]
        np.testing.assert_allclose(near[1], far[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(ends["left_elbow_rod_0"][1], ends["right_elbow_rod_0"][1], rtol=0, atol=1e-9)


def test_an_element_that_looks_like_a_loop_names_the_option_that_leaves_it_out(capsys, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(robots.robot(robots.link("base", robots.BAR), "<tendon/>"))
    code, _, error = loop(capsys, "info", path)
    assert code == 2
    assert "<tendon> may hold links or joints together, and is not understood (--ignore-unknown" in error


def test_an_mjcf_includes_files_below_a_folder_that_is_named(capsys, tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "own").mkdir()
    (tmp_path / "part.xml").write_text(
        '<mujoco><worldbody><body name="a"><joint name="j"/><geom size="0.1" mass="1"/></body>'
        "</worldbody></mujoco>"
    )
    (tmp_path / "own/robot.xml").write_text('<mujoco><include file="../part.xml"/></mujoco>')
    code, _, error = loop(capsys, "info", tmp_path / "own/robot.xml")
    assert code == 2
    assert "'../part.xml' is outside the folder of the file (--include-root FOLDER allows" in error
    code, out, _ = loop(capsys, "info", tmp_path / "own/robot.xml", "--include-root", tmp_path)
    assert (code, "j" in out) == (0, True)
    code, _, error = loop(capsys, "info", tmp_path / "own/robot.xml", "--include-root", tmp_path / "none")
    assert code == 2
    assert "expected a folder" in error
