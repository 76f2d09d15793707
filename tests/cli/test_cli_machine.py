"""Commands that load, weigh and move the machine: payload, wrench, engines, energy, reactions, simulate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import run

import p3dof
from p3dof._base.errors import MotionError
from p3dof.cli import main
from p3dof.machine.parameters import PAPER, Body

WRENCH = "t,fx,fy,fz,mx,my,mz\n0,1,2,3,0.4,0.5,0.6\n0.5,1,20,-30,0.4,0.5,0.6\n"


@pytest.fixture
def wrench_file(tmp_path):
    path = tmp_path / "wrench.csv"
    path.write_text(WRENCH)
    return path


def columns(path):
    return np.genfromtxt(path, delimiter=",", names=True)


def test_payload_and_wrench_reach_the_forces(tmp_path, capsys, wrench_file):
    arguments = ("--samples", 21, "--payload", "5,0.01,0.02,-0.1", "--wrench", wrench_file)
    code, _, err = run(capsys, "forces", *arguments, "--out", tmp_path / "f.csv")
    assert code == 0
    assert err.startswith("p3dof: the load is known from 0 to 0.5 s, the motion takes place from 0 to 1 s")
    robot = p3dof.load(PAPER.carrying(Body(5, [0.01, 0.02, -0.1], np.zeros(3))))
    history = p3dof.WrenchHistory.from_csv(wrench_file)
    expected = robot.inverse_dynamics(p3dof.paper_motion(21), method="virtual-power", wrench=history).forces
    table = columns(tmp_path / "f.csv")
    for leg, name in enumerate("ABC"):
        np.testing.assert_allclose(table[f"f{name}_N"], expected[:, leg], rtol=1e-10)
    code, out, _ = run(capsys, "compare", *arguments, "--out", tmp_path, "--no-plot")
    assert code == 0
    assert "the methods agree" in out


@pytest.mark.parametrize("command", ["compare", "forces", "energy", "reactions", "simulate"])
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--payload", "heavy"), "expected a mass [kg], or a mass and x,y,z [m], got 'heavy'"),
        (("--payload", "5,0"), "expected a mass [kg], or a mass and x,y,z [m], got '5,0'"),
        (("--payload=-5",), "mass: expected zero or more, got -5 kg"),
        (("--payload", "nan"), "mass: expected a finite number, got nan"),
        (("--wrench", "nowhere.csv"), "nowhere.csv: cannot be read"),
    ],
)
def test_bad_loads(capsys, tmp_path, monkeypatch, command, arguments, words):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, command, "--samples", 3, *arguments)
    assert code == 2
    assert words in err
    assert len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["compare", "forces", "energy", "reactions", "plots"])
def test_every_command_says_what_is_carried(tmp_path, capsys, command):
    file = tmp_path / "m.yaml"
    p3dof.write_parameters(PAPER.carrying(Body(5, [0, 0, -0.1], [0.02] * 3)), file)
    arguments = ["--samples", 3, "--parameters", file]
    if command in ("compare", "plots"):
        arguments += ["--out", tmp_path / "out"]
    if command == "plots":
        arguments += ["--only", "forces", "--format", "svg"]
    _, out, _ = run(capsys, command, *arguments, "--payload", 2)
    words = f"5 kg at (0, 0, -0.1) m ({file}) + 2 kg at (0, 0, 0) m (--payload) = 7 kg"
    assert f"payload: {words}; platform 8.1573 kg, with payload 15.1573 kg\n" in out
    _, out, _ = run(capsys, command, *arguments)
    assert f"payload: 5 kg at (0, 0, -0.1) m ({file}); platform 8.1573 kg, with payload 13.1573 kg\n" in out
    arguments[2:4] = []
    assert "payload" not in run(capsys, command, *arguments)[1]


@pytest.mark.parametrize("command", ["forces", "energy"])
def test_peaks_stand_beside_limits(capsys, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    _, out, _ = run(capsys, command, "--samples", 101)
    cells = next(line.split("│") for line in out.splitlines() if "force A [N]" in line)
    assert [cell.strip() for cell in cells[2:-1]] == ["118.498", "1", "500", "23.7%"]


def test_generated_files_say_what_is_carried(tmp_path, capsys):
    file = tmp_path / "m.yaml"
    p3dof.write_parameters(PAPER.carrying(Body(5, [0, 0, -0.1], [0.02] * 3)), file)
    for arguments in (
        ("urdf", "--out", tmp_path / "u"),
        ("codegen", "--out", tmp_path / "c", "--payload", 2),
    ):
        _, out, _ = run(capsys, *arguments, "--parameters", file)
        assert f"payload: 5 kg at (0, 0, -0.1) m ({file})" in out


def test_engines_add_a_column_each(tmp_path, capsys, wrench_file):
    for name in ("mujoco", "pydrake", "exudyn"):
        pytest.importorskip(name)
    arguments = ("compare", "--samples", 21, "--engines", "all", "--wrench", wrench_file, "--out", tmp_path)
    code, out, _ = run(capsys, *arguments, "--no-plot")
    assert code == 0
    for name in ("mujoco", "drake", "exudyn"):
        assert name in out
    header = (tmp_path / "forces.csv").read_text().splitlines()[0]
    assert header.count("fA ") == 5
    table = np.genfromtxt(tmp_path / "forces.csv", delimiter=",", skip_header=1)
    for first in (1, 7, 10, 13):
        np.testing.assert_allclose(table[:, first : first + 3], table[:, 4:7], rtol=0, atol=1e-9)


def test_an_engine_that_disagrees_fails(tmp_path, capsys, monkeypatch):
    pytest.importorskip("mujoco")
    from p3dof.methods import engines

    heavy = replace(PAPER, bodies=PAPER.bodies.scaled(1 + 1e-7))
    monkeypatch.setattr(engines, "load", lambda name, _: engines.ENGINES[name](heavy))
    code, out, _ = run(
        capsys, "compare", "--samples", 11, "--engines", "mujoco", "--out", tmp_path, "--no-plot"
    )
    assert code == 1
    assert "one of the others DISAGREES by more than 1e-09" in out


def test_engines_leave_invalid_samples_out(tmp_path, capsys):
    pytest.importorskip("mujoco")
    time = np.linspace(0, 1, 21)
    pose = np.column_stack([0.3 * time**2, 0 * time, 0 * time])
    p3dof.Motion.from_poses(time, pose).to_csv(tmp_path / "m.csv")
    arguments = ("--motion", tmp_path / "m.csv", "--on-invalid", "nan", "--engines", "mujoco")
    code, out, _ = run(capsys, "compare", *arguments, "--out", tmp_path, "--no-plot")
    assert code == 1
    assert "the methods agree" in out
    assert "DISAGREE" not in out
    table = np.genfromtxt(tmp_path / "forces.csv", delimiter=",", skip_header=1)
    np.testing.assert_array_equal(np.isnan(table[:, 10]), np.isnan(table[:, 4]))
    assert np.isnan(table[:, 10]).any()


def test_a_missing_engine_names_the_extra(tmp_path, capsys, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "mujoco", None)
    code, _, err = run(capsys, "compare", "--samples", 3, "--engines", "mujoco", "--out", tmp_path)
    assert code == 2
    assert "p3dof[engines]" in err


@pytest.mark.slow
def test_exudyn_in_time(tmp_path, capsys):
    pytest.importorskip("exudyn")
    code, out, _ = run(capsys, "compare", "--in-time", "--out", tmp_path, "--no-plot", "--samples", 501)
    assert code == 0
    rows = [line.split("│")[1:-1] for line in out.splitlines() if line.startswith("│")]
    steps = [
        [cell.strip() for cell in row]
        for row in rows
        if row[0].strip() in {"1", "0.5", "0.25", "0.125", "→ 0"}
    ]
    assert len(steps) == 5
    for row in steps[1:4]:
        assert float(row[2]) > 1.99
    assert float(steps[3][1]) < 1e-6  # by a single step size, not only extrapolated
    assert float(steps[4][1]) < 1e-8


def test_energy(tmp_path, capsys):
    files = ("--out", tmp_path / "e.csv", "--figure", tmp_path / "e.png")
    code, out, err = run(capsys, "energy", "--samples", 101, *files)
    assert (code, err) == (0, "")
    assert "Loads of the drives" in out
    assert (tmp_path / "e.png").read_bytes().startswith(b"\x89PNG")
    assert len(columns(tmp_path / "e.csv")) == 101


@pytest.mark.parametrize("joints", ["paper", "points"])
def test_reactions(tmp_path, capsys, wrench_file, joints):
    files = ("--out", tmp_path / "r.csv", "--figure", tmp_path / "r.svg")
    arguments = ("--samples", 11, "--joint-model", joints, "--wrench", wrench_file)
    code, out, _ = run(capsys, "reactions", *arguments, *files)
    assert code == 0
    assert f"{joints}" in out
    assert "hinge_platform" in out
    assert "</svg>" in (tmp_path / "r.svg").read_text()
    assert len(columns(tmp_path / "r.csv")) == 11


def test_simulate_shows_what_the_inverse_model_gains(tmp_path, capsys):
    code, out, err = run(capsys, "simulate", "--samples", 201, "--method", "virtual-power", "--out", tmp_path)
    assert (code, err) == (0, "")
    lines = [line.split("larger by ")[1] for line in out.splitlines() if "larger by" in line]
    gains = [float(part.split()[0]) for line in lines for part in line.split(", ")]
    assert len(gains) == 6
    assert min(gains) > 1000
    for name in ("pd", "feedforward", "computed-torque"):
        table = columns(tmp_path / f"simulation_{name}.csv")
        assert table["t_s"][-1] == pytest.approx(1.1)
        error = np.abs(table["y_m"] - table["reference_y_m"]).max()
        assert error < (5e-3 if name == "pd" else 1e-6)
    assert (tmp_path / "tracking.png").read_bytes().startswith(b"\x89PNG")


PARTS = (
    ("y_m", "z_m", "theta_rad"),
    ("ydot_ms", "zdot_ms", "thetadot_rads"),
    ("yddot_ms2", "zddot_ms2", "thetaddot_rads2"),
)


def test_what_a_run_writes_is_a_motion_again(tmp_path, capsys):
    """Its forces are those of the run, though accelerations jump where the controller acts."""
    code, *_ = run(capsys, "simulate", "--controller", "pd", "--out", tmp_path, "--no-plot")
    assert code == 0
    path = tmp_path / "simulation_pd.csv"
    code, _, err = run(capsys, "forces", "--motion", path, "--out", tmp_path / "f.csv")
    assert code == 0
    beside = "slider A, slider B, slider C, slider velocity A and 18 more"
    assert err == f"p3dof: {path}: passed over what p3dof writes beside a motion: {beside}\n"
    told, found = columns(path), columns(tmp_path / "f.csv")
    for leg in "ABC":
        assert np.abs(told[f"f{leg}_N"]).max() > 50
        np.testing.assert_allclose(found[f"f{leg}_N"], told[f"f{leg}_N"], rtol=0, atol=1e-9)
    with pytest.raises(MotionError, match="acceleration of theta"):
        p3dof.Motion(told["t_s"], *(np.column_stack([told[n] for n in names]) for names in PARTS))


@pytest.mark.parametrize("armature", [0, 0.5])
def test_what_forces_writes_is_a_motion_again(tmp_path, capsys, armature):
    options = ("--armature", armature) if armature else ()
    assert run(capsys, "forces", *options, "--out", tmp_path / "f.csv")[0] == 0
    arguments = (*options, "--motion", tmp_path / "f.csv", "--out", tmp_path / "g.csv", "--samples", 1001)
    code, _, err = run(capsys, "forces", *arguments)
    assert (code, err.count("\n")) == (0, 1)
    assert "passed over what p3dof writes beside a motion: fA, fB, fC, " in err
    told, found = columns(tmp_path / "f.csv"), columns(tmp_path / "g.csv")
    assert told.dtype == found.dtype
    for leg in "ABC":
        np.testing.assert_allclose(found[f"f{leg}_N"], told[f"f{leg}_N"], rtol=0, atol=1e-3)


def test_a_run_that_ends_early_says_why_and_keeps_its_samples(tmp_path, capsys):
    arguments = ("--controller", "computed-torque", "--saturation", 40, "--format", "npz", "--no-plot")
    code, out, _ = run(capsys, "simulate", "--samples", 101, *arguments, "--out", tmp_path)
    assert code == 1
    assert "computed-torque: ended by slider stop at t = " in out
    with np.load(tmp_path / "simulation_computed-torque.npz") as arrays:
        assert arrays["stop"][0] == "slider stop"
        assert len(arrays["time"]) > 10
        assert np.abs(arrays["forces"]).max() == 40
    assert not (tmp_path / "tracking.png").exists()


def test_every_option_of_simulate(tmp_path, capsys, wrench_file):
    p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.3, 31).to_csv(tmp_path / "m.csv")
    code, out, err = run(
        capsys, "simulate", "--motion", tmp_path / "m.csv", "--wrench", wrench_file, "--payload", "2",
        "--controller", "feedforward", "--controller", "pd", "--rate", 500, "--frequency", 8,
        "--damping", 0.8, "--integral-time", 0.1, "--mass-error", -0.1, "--saturation", 200,
        "--noise", 1e-6, 1e-4, "--seed", 3, "--ramp", 0, "--method", "pinocchio", "--out", tmp_path / "o",
    )  # fmt: skip
    assert (code, err) == (0, "")
    table = columns(tmp_path / "o" / "simulation_feedforward.csv")
    assert len(table) == 1001
    assert table["closure_error_m"].max() < 1e-9
    assert "computed-torque" not in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--rate", "0"), "'--rate': expected a positive number, got 0"),
        (("--frequency", "-1"), "'--frequency': expected a positive number, got -1"),
        (("--mass-error", "-1"), "'--mass-error': -1.0 is not in the range x>-1"),
        (("--mass-error", "nan"), "'--mass-error': expected a finite number"),
        (("--saturation", "0"), "'--saturation': expected a positive number, got 0"),
        (("--armature", "nan"), "'--armature': expected finite numbers from zero on, got 'nan'"),
        (("--armature", "1,-1,1"), "'--armature': expected finite numbers from zero on, got '1,-1,1'"),
        (("--counterbalance", "inf"), "'--counterbalance': expected finite numbers, got 'inf'"),
        (("--saturation", "foo"), "'--saturation': expected a force such as '5 kN', got 'foo'"),
        (("--saturation", "50 Nm"), "'--saturation': expected a force such as '5 kN', got '50 Nm'"),
        (("--rate", "500 rpm"), "'--rate': expected a frequency such as '5 kHz', got '500 rpm'"),
        (("--delay", "nan"), "'--delay': expected zero or a positive number, got nan"),
        (
            ("--ramp", "0,5"),
            "'--ramp': expected a time such as '5 ms', got '0,5'; with a decimal point it is 0.5",
        ),
        (("--noise", "1", "2 mm"), "'--noise': expected a speed such as '5 mm/s', got '2 mm'"),
        (("--noise", "-1", "0"), "'--noise': expected zero or a positive number, got -1"),
        (("--seed", "-1", "--noise", "0", "0"), "'--seed': -1 is not in the range x>=0"),
        (("--ramp", "5"), "ramp, stop: expected at most 2 s together, got 5 s"),
        (("--controller", "magic"), "'magic' is not one of"),
        (("--integral-time", "0"), "'--integral-time': expected a positive number, got 0"),
    ],
)
def test_bad_options_of_simulate(tmp_path, capsys, arguments, words):
    code, _, err = run(capsys, "simulate", "--samples", 11, "--out", tmp_path, *arguments)
    assert code == 2
    assert words in err
    assert len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_numbers_of_simulate_have_units(tmp_path, capsys):
    """The same run, to the byte, whether its numbers are in SI units or in others."""
    given = {
        "--rate": ("500", "0.5 kHz"),
        "--frequency": ("8", "8 Hz"),
        "--integral-time": ("0.1", "100ms"),
        "--saturation": ("200", "0.2kN"),
        "--noise": ("1e-6 0.0001", "1um 0.1mm/s"),
        "--resolution": ("1e-6", "0.001 mm"),
        "--delay": ("0.002", "2 ms"),
        "--bandwidth": ("120", "0.12kHz"),
        "--ramp": ("0.25", "250 ms"),
        "--time-limit": ("600", "10 min"),
    }
    files = []
    for i, out in enumerate((tmp_path / "plain", tmp_path / "units")):
        line = ["--controller", "pd", "--no-plot", "--out", out]
        for option, values in given.items():
            line += [option, *(values[i].split() if option == "--noise" else [values[i]])]
        code, _, err = run(capsys, "simulate", *line)
        assert (code, err) == (0, "")
        files.append((out / "simulation_pd.csv").read_bytes())
    assert files[0] == files[1]


def test_outputs_never_replace_inputs(capsys, wrench_file):
    for command in ("forces", "energy", "reactions"):
        code, _, err = run(capsys, command, "--samples", 3, "--wrench", wrench_file, "--out", wrench_file)
        assert code == 2
        assert "would be overwritten" in err
    assert wrench_file.read_text() == WRENCH


def test_a_motion_that_starts_at_rest_gets_no_ramp(tmp_path, capsys):
    """The runs last as long as the motion; one that starts at speed takes half the ramp longer."""
    rest = p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, 0.01, 0.1], 0.2, 41)
    rest.to_csv(tmp_path / "rest.csv")
    rest[10:31].to_csv(tmp_path / "moving.csv")
    ends = {}
    for name, options in (
        ("rest", ()),
        ("moving", ()),
        ("rest", ("--ramp", "0.1")),
        ("moving", ("--ramp", "0")),
    ):
        arguments = ["simulate", "--controller", "pd", "--method", "compiled", "--no-plot", "--format", "npz"]
        arguments += ["--motion", str(tmp_path / f"{name}.csv"), "--out", str(tmp_path), *options]
        assert run(capsys, *arguments)[0] == 0
        found = p3dof.Simulation.load(tmp_path / "simulation_pd.npz")
        ends[(name, *options)] = found.time[-1]
    expected = {
        ("rest",): 0.2,
        ("moving",): 0.15,
        ("rest", "--ramp", "0.1"): 0.25,
        ("moving", "--ramp", "0"): 0.1,
    }
    assert ends == pytest.approx(expected, abs=1e-12)


# --- motors and counterbalances on the command line ---------------------------------------------------------


@pytest.mark.usefixtures("undrawn")
def test_armature_and_counterbalance_take_the_place_of_the_file_s(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    own = p3dof.machine.Actuators({"sliders": 5.0}, {"sliders": 10.0}, {"slide_a": 100.0})
    p3dof.write_parameters(replace(p3dof.PAPER, actuators=own), "machine.yaml")
    command = "forces --parameters machine.yaml --armature 14.8,3,500g --counterbalance 48 --samples 11"
    assert main([*command.split(), "--out", "forces.csv"]) == 0
    given = dict(zip(p3dof.machine.parameters.SLIDES, (14.8, 3.0, 0.5), strict=True))
    machine = replace(p3dof.PAPER, actuators=replace(own, armature=given, counterbalance={"sliders": 48.0}))
    expected = p3dof.load(machine).inverse_dynamics(p3dof.paper_motion(11)).forces
    rows = np.genfromtxt("forces.csv", delimiter=",", skip_header=1)
    np.testing.assert_allclose(rows[:, 1:4], expected, rtol=1e-12)
    assert (
        main(["report", "--armature", "14.8", "--samples", "11", "--out", "report.html", "--no-animation"])
        == 0
    )
    assert "--armature=14.8,14.8,14.8" in Path("report.html").read_text(encoding="utf-8")
    capsys.readouterr()
    assert main(["codegen", "--counterbalance", "48", "--out", "c"]) == 0
    assert "--counterbalance 48,48,48" in Path("c/p3dof.h").read_text(encoding="utf-8")
    assert "a sine or a tanh counts as one, though it takes" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--armature 1,2", "'--armature': expected one number, or three for A, B and C, got '1,2'"),
        ("--armature -2", "expected finite numbers from zero on, got '-2'"),
        ("--counterbalance 3kg", "expected a force"),
        ("--armature much", "expected a mass"),
    ],
)
def test_motors_and_balances_that_are_none_are_refused(options, message, capsys):
    assert main(["forces", *options.split()]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
