"""A motion that crosses a singularity, or leaves the reach: no peak, gaps everywhere, exit code 1."""

from __future__ import annotations

import re
from dataclasses import fields
from html.parser import HTMLParser

import numpy as np
import pytest

import p3dof
from p3dof._base.errors import ReachError, SingularityError
from p3dof.cli import main
from p3dof.methods.solution import NEAR, crossings_of
from p3dof.report import plots
from p3dof.report.plots.common import GAP
from p3dof.report.plots.forces import joints_figure

METHODS = ("pinocchio", "virtual-power", "compiled")
TOLD = r"after t = 0\.1\d+ s the motion crosses an actuation singularity: no force can do that"


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def motion():
    """Through the singularity at 60 degrees and back; no sample is singular."""
    t = np.linspace(0, 1, 201)
    return p3dof.Motion.from_poses(t, poses_at(t))


def poses_at(t):
    swing = 2 * np.pi * t
    return np.column_stack([0.03 * np.sin(swing), 0.05 * t, 0.9 + 0.5 * np.sin(swing - 0.9)])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The motion as poses and as samples, and one that leaves the reach."""
    folder = tmp_path_factory.mktemp("gaps")
    t = np.linspace(0, 1, 41)
    for name, pose in (("crossing", poses_at(t)), ("far", np.column_stack([0.3 * t**2, 0 * t, 0 * t]))):
        one = p3dof.Motion.from_poses(t, pose)
        one.to_csv(folder / f"{name}_samples.csv")
        rows = [",".join(map(repr, row)) for row in np.column_stack([t, pose]).tolist()]
        (folder / f"{name}_poses.csv").write_text("\n".join(["t,y,z,theta", *rows, ""]))
    return folder


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


# --- where it is crossed ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("actuation", "after", "spoilt"),
    [
        ([0.5, 0.3, 0.2, -0.2, -0.3], [2], [2, 3]),
        ([0.5, 0.09, 0.02, -0.03, -0.3], [2], [1, 2, 3]),
        ([0.09, 0.5, 0.02, -0.5, -0.5, -0.09], [2], [2, 3]),
        ([0.5, 0.09, np.nan, 0.09, 0.5], [], [1, 3]),
        ([0.5, 0.3, np.nan, -0.3, -0.5], [1], [1, 3]),
        ([0.5, 0.09, 0.01, 0.09, 0.5], [], []),
        ([0.5, 0.5, -0.5, 0.5], [1, 2], [1, 2, 3]),
        ([0.05], [], []),
        ([np.nan, np.nan], [], []),
    ],
)
def test_what_a_crossing_spoils(actuation, after, spoilt):
    found, rows = crossings_of(np.array(actuation))
    assert found.tolist() == after
    assert np.flatnonzero(rows).tolist() == spoilt


@pytest.mark.parametrize("method", METHODS)
def test_forces_near_a_crossing_are_left_out(robot, motion, method):
    with pytest.raises(SingularityError, match=TOLD) as info:
        robot.inverse_dynamics(motion, method=method)
    result = robot.inverse_dynamics(motion, method=method, on_invalid="nan")
    assert len(result.crossings) == info.value.count == 2
    assert motion.time[info.value.index] == result.crossings[0]
    angle = robot.singularity(motion.pose).actuation
    assert np.sign(angle).min() == -1
    np.testing.assert_array_equal(result.valid, np.abs(angle) >= NEAR)
    for rows in (result.forces, result.power, result.power_residual, result.closure_error, result.sliders):
        assert np.isnan(rows[~result.valid]).all()
        assert np.isfinite(rows[result.valid]).all()
    assert np.abs(result.forces[result.valid]).max() < 200  # at the samples it was thousands


@pytest.mark.parametrize("method", METHODS)
def test_such_a_motion_has_no_peaks(robot, motion, method):
    result = robot.inverse_dynamics(motion, method=method, on_invalid="nan")
    assert not result.possible
    assert np.isnan([result.peak_forces, result.rms_forces]).all()
    assert result.force_scale.max() < 200
    assert "peak" not in repr(result)
    assert re.fullmatch(TOLD, result.warnings[0])
    limits = p3dof.machine.Limits(travel=(-1, 1), speed=1e-3, force=1.0, tilt=(-3, 3))
    assert result.exceedances(limits) == []
    for one in result.utilisations(limits):
        assert np.isnan(one.share) == (one.quantity in {"force", "speed"})
    energy = robot.energy(result)
    for item in fields(energy.drives):
        assert np.isnan(getattr(energy.drives, item.name)).all()
    np.testing.assert_array_equal(energy.valid, result.valid)


def test_reactions_have_the_same_gaps(robot, motion):
    some = motion[20:60]
    known = robot.inverse_dynamics(some, method="virtual-power", on_invalid="nan")
    for joints in ("paper", "all"):
        with pytest.raises(SingularityError, match=TOLD):
            robot.reactions(some, joints)
        found = robot.reactions(some, joints, on_invalid="nan")
        np.testing.assert_array_equal(found.valid, known.valid)
        assert not found.possible
        assert all(np.isnan(getattr(peak, name)) for peak in found.peaks() for name in ("force", "moment"))
        assert found.open_peaks() == ()


# --- the command line, figures and the report ---------------------------------------------------------------


@pytest.mark.parametrize("name", ["crossing_poses", "crossing_samples", "far_poses", "far_samples"])
def test_the_command_refuses_and_writes_nothing(files, tmp_path, capsys, name):
    motion = files / f"{name}.csv"
    code, out, err = run(capsys, "forces", "--motion", motion, "--out", tmp_path / "f.csv")
    assert code == 1
    assert err.startswith("p3dof: error: ")
    assert err.count("\n") == 1
    assert re.search(TOLD if "crossing" in name else "leg A is too short", err)
    assert (out, list(tmp_path.iterdir())) == ("", [])


@pytest.mark.parametrize("name", ["crossing_poses", "crossing_samples", "far_poses", "far_samples"])
@pytest.mark.parametrize("command", ["forces", "energy", "compare", "reactions"])
def test_commands_leave_gaps_and_tell_no_peak(files, tmp_path, capsys, command, name):
    place = tmp_path / ("o" if command == "compare" else "o.csv")
    arguments = (command, "--motion", files / f"{name}.csv", "--on-invalid", "nan", "--out", place)
    code, out, _ = run(capsys, *arguments, *(["--no-plot"] if command == "compare" else []))
    assert code == 1
    assert "samples are invalid and left NaN" in out
    assert ("crosses an actuation singularity" in out) == ("crossing" in name)
    tables = out[: out.index("samples are invalid")]
    for row in re.findall(r"^│ (?:[ABC]|force .*|peak.*|RMS.*|work.*|mean.*) +│ *(\S+)", tables, re.M):
        assert row == "-"
    if command == "reactions":
        loads = [line.split()[2:9] for line in tables.splitlines() if re.match(r"\s*\w+ \([ABC]\d\) ", line)]
        assert len(loads) == 13
        assert all(cell == "-" for row in loads for cell in row)
    path = place / "forces.csv" if command == "compare" else place
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    gaps = np.isnan(table[:, 1:4]).any(axis=1)
    assert 2 <= gaps.sum() < len(gaps) / 2


def test_figures_mark_gaps_and_keep_the_whole_time(robot, motion):
    first, second = (robot.inverse_dynamics(motion, method=one, on_invalid="nan") for one in METHODS[:2])
    some = motion[20:60]
    reactions = robot.reactions(some, on_invalid="nan")
    far = np.linspace(0, 1, 41)
    pose = np.column_stack([0.3 * far**2, 0 * far, 0 * far])  # its gap is at the end
    leaving = robot.inverse_dynamics(p3dof.Motion.from_poses(far, pose), method="compiled", on_invalid="nan")
    for figure, end, gaps in (
        (plots.forces_figure([first, second]), 1.0, 2),
        (plots.forces_figure([leaving]), 1.0, 1),
        (joints_figure(first), 1.0, 2),
        (plots.energy_figure(robot.energy(first)), 1.0, 2),
        (plots.reactions_figure(reactions), some.time[-1], 1),
    ):
        panels = [axis for axis in figure.axes if axis.get_title() and axis.lines] or figure.axes
        for axis in panels:
            hatched = [patch for patch in axis.patches if patch.get_hatch()]
            if axis.lines and not hatched:
                assert axis.get_shared_x_axes()  # the twin of a panel that has them
                continue
            assert len(hatched) == gaps
            assert axis.get_xlim()[1] >= end
    axis = plots.forces_figure([first]).axes[2]
    low, high = axis.get_ylim()
    assert max(-low, high) < 250  # neither blown up nor cut off
    drawn = axis.lines[0].get_ydata()
    np.testing.assert_array_equal(np.isnan(drawn), ~first.valid)
    assert low < np.nanmin(drawn)
    assert np.nanmax(drawn) < high
    legend = plots.forces_figure([first]).legends[0]
    assert [text.get_text() for text in legend.get_texts()][-1] == GAP
    calm = robot.inverse_dynamics(p3dof.paper_motion(151), method="compiled")
    assert len(plots.forces_figure([calm]).legends[0].get_texts()) == 1


class Words(HTMLParser):
    """The text of a page, one line a cell."""

    def __init__(self, page):
        super().__init__()
        self.lines = []
        self.feed(page)

    def handle_data(self, data):
        if data.strip():
            self.lines.append(data.strip())


@pytest.mark.usefixtures("undrawn")
def test_the_report_tells_no_peak_and_says_why_at_its_top(files, tmp_path, capsys):
    page = tmp_path / "r.html"
    arguments = ("--motion", files / "crossing_samples.csv", "--no-animation", "--out", page)
    code, _, _ = run(capsys, "report", *arguments)
    assert code == 1
    assert not page.exists()
    code, shown, _ = run(capsys, "report", *arguments, "--on-invalid", "nan")
    assert code == 1
    assert re.search(TOLD, shown)
    text = page.read_text(encoding="utf-8")
    top = text[: text.index("<nav")]
    assert re.search(TOLD, top)
    assert "cannot perform this motion" in top
    words = Words(re.sub(r'src="data:[^"]*"', "", text)).lines
    for name in ("peak force", "RMS force", "peak speed", "peak power"):
        assert words[words.index(name) + 1] == "–"
    drives = words[words.index("Loads of the drives") :]
    for name in ("peak force [N]", "peak power [W]", "work supplied [J]", "RMS force [N]"):
        assert drives[drives.index(name) + 1 :][:3] == ["–"] * 3
    assert not [line for line in words if re.search(r"(?<!=)\bnan\b", line)]  # but in the command
    assert "Peaks:" not in text


def test_out_of_reach_is_named_by_its_row(files, robot):
    motion = p3dof.Motion.from_csv(files / "far_poses.csv")
    with pytest.raises(ReachError, match="sample 37, the first of 4 such of 41"):
        robot.inverse_dynamics(motion)
