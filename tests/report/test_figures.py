"""The figures of joints and mechanism, and `p3dof plots`: what is drawn is what was computed."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as limited
from machines import SEEDS, random_geometry, random_states
from matplotlib.backends.backend_agg import FigureCanvasAgg

import p3dof
import p3dof.cli.forces
from p3dof._base.errors import InputError, MissingExtraError, ReachError
from p3dof.analysis.reactions import JOINTS
from p3dof.cli import main
from p3dof.closed_form import kinematics
from p3dof.report import plots
from p3dof.report.plots.forces import joints_figure
from p3dof.report.plots.mechanism import (
    HINGES,
    SLIDES,
    UNIVERSAL,
    VIEWS,
    Prism,
    View,
    hull,
    link_frames,
    mechanism_figure,
    solids_of,
)

AXES = {"front": ([0, 1, 0], [0, 0, 1]), "side": ([1, 0, 0], [0, 0, 1]), "top": ([0, 1, 0], [-1, 0, 0])}
"""Which fixed axes point to the right and up on the page."""


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def result(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(51), method="virtual-power")


def test_every_joint_is_drawn_once_with_its_position_velocity_and_acceleration(result):
    figure = joints_figure(result)
    rows, columns = 3, 4
    assert len(figure.axes) == rows * columns
    for row, (field, words) in enumerate((("q", "position"), ("v", "velocity"), ("a", "acceleration"))):
        names = []
        for column in range(columns):
            axis = figure.axes[row * columns + column]
            unit = ("m" if column == 0 else "rad") + ("", "/s", "/s²")[row]
            assert axis.get_ylabel() == f"{words} [{unit}]"
            for line in axis.lines:
                if line.get_label().startswith("_"):
                    continue  # the zero line
                names.append(line.get_label())
                values = getattr(result.joints, field)[:, result.joints.names.index(names[-1])]
                np.testing.assert_array_equal(line.get_ydata(), values)
                np.testing.assert_array_equal(line.get_xdata(), result.time)
        assert sorted(names) == sorted(result.joints.names)
    assert figure.axes[-1].get_xlabel() == "time [s]"


def test_invalid_samples_leave_gaps_and_lonely_ones_are_dots(robot):
    time = np.linspace(0, 1, 5)
    pose = np.zeros((5, 3))
    pose[[1, 3], 0] = 0.3  # out of reach
    motion = p3dof.Motion(time, pose, 0 * pose, 0 * pose, check=False)
    result = robot.inverse_dynamics(motion, method="virtual-power", on_invalid="nan")
    line = joints_figure(result).axes[0].lines[0]
    np.testing.assert_array_equal(np.isnan(line.get_ydata()), [False, True, False, True, False])
    assert line.get_markevery() == [0, 2, 4]
    with pytest.raises(InputError, match="at least one valid sample, got none"):
        joints_figure(
            robot.inverse_dynamics(
                p3dof.Motion(time, pose + 1, 0 * pose, 0 * pose), method="virtual-power", on_invalid="nan"
            )
        )
    with pytest.raises(InputError, match="expected InverseDynamics, got None"):
        joints_figure(None)


def points_on(axis):
    return {line.get_gid(): np.ravel(line.get_xydata()) for line in axis.lines if line.get_gid() is not None}


def expected_points(geometry, pose):
    """The joints by the closed forms of the paper's recursion, which the drawing does not use."""
    bodies = kinematics.mechanism_motion(geometry, pose, np.zeros(3), np.zeros(3)).bodies
    r, L = geometry.r, geometry.L
    found = {name: bodies[link].joint for name, link in HINGES.items() if name != "C_7"}
    found["C_7"] = bodies["rod_right"].at((L, 0, 0))[0]
    found["A_3"] = bodies["platform"].at((0, -r, 0))[0]
    found["B_3"] = bodies["platform"].at((0, r, 0))[0]
    found["P"] = np.array([0, pose[0], pose[1] - geometry.h])
    return found


@limited(max_examples=4)
@given(SEEDS)
def test_joints_are_drawn_where_the_kinematics_has_them(seed):
    geometry = random_geometry(np.random.default_rng(seed))
    parameters = p3dof.of_solids(geometry)
    pose = random_states(parameters, seed, 1).pose[0]
    figure = mechanism_figure(p3dof.load(parameters), pose)
    expected = expected_points(geometry, pose)
    assert set(expected) == {*HINGES, *UNIVERSAL, "P"}
    for axis, view in zip(figure.axes, VIEWS, strict=False):
        page = np.array(AXES.get(view.name, (view.right, view.up)))
        drawn = points_on(axis)
        for name, point in expected.items():
            np.testing.assert_allclose(
                drawn[f"{view.name}-{name}"], page @ point, rtol=0, atol=1e-13 * geometry.L
            )


@limited(max_examples=20)
@given(SEEDS)
def test_links_and_loops_of_the_drawing_close(seed):
    geometry = random_geometry(np.random.default_rng(seed))
    parameters = p3dof.of_solids(geometry)
    robot = p3dof.load(parameters)
    pose = random_states(parameters, seed, 1).pose[0]
    joints = robot.inverse_kinematics(pose).joints
    frames = link_frames(robot.mechanism, {name: float(value) for name, value in joints.items()})
    bodies = kinematics.mechanism_motion(geometry, pose, np.zeros(3), np.zeros(3)).bodies
    for name in ("slider_a", "leg_a", "leg_b", "rod_left", "rod_right", "platform", "crossbar_upper"):
        np.testing.assert_allclose(frames[name][1], bodies[name].rotation, atol=1e-14)
    for closure in robot.mechanism.closures:
        gap = frames[closure.frame1][0] - frames[closure.frame2][0]
        assert np.abs(gap).max() < 1e-14 * geometry.L * 10


def test_the_views_are_right_handed_and_at_one_scale(robot):
    figure = mechanism_figure(robot)
    for view in VIEWS:
        np.testing.assert_allclose(view.right @ view.up, 0, atol=1e-15)
        np.testing.assert_allclose([view.right @ view.right, view.up @ view.up], 1, atol=1e-15)
    toward = {view.name: view.toward for view in VIEWS}
    np.testing.assert_array_equal(toward["front"], [1, 0, 0])
    np.testing.assert_array_equal(toward["side"], [0, -1, 0])
    np.testing.assert_array_equal(toward["top"], [0, 0, 1])
    scales = []
    for axis in figure.axes[:4]:
        size = figure.get_size_inches() * [axis.get_position().width, axis.get_position().height]
        spans = [np.ptp(axis.get_xlim()), np.ptp(axis.get_ylim())]
        np.testing.assert_allclose(size[0] / spans[0], size[1] / spans[1], rtol=1e-12)
        scales.append(size[0] / spans[0])
    np.testing.assert_allclose(scales[:3], scales[0], rtol=1e-12)


def test_real_lengths_are_drawn_and_named(robot):
    figure = mechanism_figure(robot, (0.02, -0.01, 0.3))
    front, side, top = (points_on(axis) for axis in figure.axes[:3])
    length = np.linalg.norm
    np.testing.assert_allclose(length(front["front-A_2"] - front["front-A_3"]), 0.4, rtol=1e-13)
    np.testing.assert_allclose(length(front["front-B_2"] - front["front-B_3"]), 0.4, rtol=1e-13)
    np.testing.assert_allclose(length(side["side-C_5"] - side["side-P"]), 0.1, rtol=1e-13)
    np.testing.assert_allclose(length(top["top-C_3"] - top["top-C_6"]), 0.1, rtol=1e-13)
    words = [text.get_text() for axis in figure.axes for text in axis.texts]
    for text in ("$2R$ = 500", "$2r$ = 200", "$L$ = 400", "$R$ = 250", "$r$ = 100", "$2b$ = 100"):
        assert text in words
    assert f"$h-z$ = {1e3 * (robot.parameters.geometry.h + 0.01):.1f}" in words
    for name in ("A_3", "B_3", "C_3", "C_4", "C_5", "C_6", "C_7", "x_0", "y_0", "z_0"):
        assert any(f"${name}$" in text for text in words)
    plain = mechanism_figure(robot, dimensions=False)
    assert not any(" = 500" in text.get_text() for axis in plain.axes for text in axis.texts)


def test_the_labels_are_those_of_the_joints():
    drawn = {**SLIDES, **HINGES, **UNIVERSAL}
    assert {name.replace("_", ""): frame for name, frame in drawn.items()} == {
        j.label: j.frame for j in JOINTS
    }


def test_open_reactions_are_drawn_in_all_ways(robot):
    figure = plots.reactions_figure(robot.reactions(p3dof.paper_motion(11)))
    lines = {axis.get_title(): axis.lines for axis in figure.axes if axis.get_title()}
    assert len(lines["slide_c (C1)"]) == 1  # its force is determined
    assert len(lines["hinge_right (C6)"]) == 3
    for drawn, one in zip(
        lines["hinge_right (C6)"], robot.reactions(p3dof.paper_motion(11)).each, strict=True
    ):
        size = np.linalg.norm(one["hinge_right"].forces, axis=1)
        np.testing.assert_allclose(drawn.get_ydata(), size, atol=1e-12)
        assert (drawn.get_linestyle() == "-") == (one.way == "elastic")
    words = " ".join(text.get_text() for axis in figure.axes for text in axis.texts)
    assert "no bounds" in words


def test_the_solids_are_the_descriptions(robot):
    platform = next(link for link in robot.mechanism.links if link.name == "platform")
    (plate,) = solids_of(platform, np.zeros(3), np.eye(3))
    assert isinstance(plate, Prism)
    assert plate.thickness == 0.05
    # The triangle A3 B3 C5 widened by 20 mm, as seen from C5: its area is that of the plate's mass.
    x, y = plate.outline.T
    area = (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    mass = p3dof.SOLIDS.bodies.platform.mass
    np.testing.assert_allclose(area * 0.05 * 7801, mass, rtol=2e-3)  # a circle of 36 corners
    box = Prism(np.array([[-1, -2], [1, -2], [1, 2], [-1, 2]]), 6.0, np.zeros(3), np.eye(3), (0, 0, 0))
    front = View("front", np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert len(box.faces(front)) == 1
    assert len(box.faces(View.oblique("", 0.5, 0.5))) == 3
    np.testing.assert_allclose(np.ptp(box.silhouette(front), axis=0), [4, 6])
    square = hull(np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5], [0.5, 0], [1, 1]]))
    assert sorted(map(tuple, square.tolist())) == [(0, 0), (0, 1), (1, 0), (1, 1)]


def test_the_path_is_that_of_p(robot):
    motion = p3dof.paper_motion(31)
    figure = mechanism_figure(robot, motion.pose[0], motion)
    y, z = motion.pose[:, 0], motion.pose[:, 1] - robot.parameters.geometry.h
    for axis, name, columns in zip(
        figure.axes, ("front", "side", "top"), ((y, z), (0 * y, z), (y, 0 * y)), strict=False
    ):
        (line,) = (line for line in axis.lines if line.get_gid() == f"{name}-trace")
        np.testing.assert_allclose(line.get_xydata(), np.column_stack(columns), atol=1e-15)
    assert not [line for line in mechanism_figure(robot).axes[0].lines if line.get_gid() == "front-trace"]


@pytest.mark.parametrize("row", [0, 30])
def test_labels_stay_apart(robot, row):
    figure = mechanism_figure(robot, p3dof.paper_motion(41).pose[row])
    FigureCanvasAgg(figure).draw()  # lays it out
    for axis in figure.axes[:4]:
        texts = [text for text in axis.texts if text.get_text().startswith("$")]
        boxes = [text.get_window_extent().padded(-3) for text in texts]
        for i, box in enumerate(boxes):
            for other in boxes[:i]:
                assert not box.overlaps(other)


def test_bad_arguments_of_the_drawing(robot, monkeypatch):
    with pytest.raises(ReachError, match="leg A is too short"):
        mechanism_figure(robot, (0.3, 0, 0))
    for arguments, words in (
        ((None,), "robot: expected a Manipulator, got None"),
        ((robot, (0, 0)), r"pose: expected shape \(3,\), got \(2,\)"),
        ((robot, (0, 0, np.nan)), "pose: expected finite numbers"),
        ((robot, (0, 0, 0), "fast"), "motion: expected a Motion, got 'fast'"),
    ):
        with pytest.raises(InputError, match=words):
            mechanism_figure(*arguments)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[plot\]"):
        mechanism_figure(robot)


def test_the_command_writes_all_figures(tmp_path, capsys):
    code, out, err = run(
        capsys, "plots", "--samples", 21, "--out", tmp_path / "ö", "--format", "png", "--format", "pdf"
    )
    assert (code, err) == (0, "")
    names = ("forces", "joints", "energy", "reactions", "mechanism")
    for kind, start in (("png", b"\x89PNG"), ("pdf", b"%PDF")):
        for name in names:
            path = tmp_path / "ö" / f"{name}.{kind}"
            assert path.read_bytes().startswith(start)
            assert f"wrote {path}" in out
    assert len(list((tmp_path / "ö").iterdir())) == 10


def test_the_command_draws_what_it_is_asked_for(tmp_path, capsys):
    out = tmp_path / "f"
    arguments = ("plots", "--samples", 11, "--only", "mechanism", "--only", "joints", "--at", 0.1)
    code, text, _ = run(capsys, *arguments, "--out", out)
    assert code == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "joints.png",
        "joints.svg",
        "mechanism.png",
        "mechanism.svg",
    ]
    assert text.count("wrote") == 4


def test_bad_arguments_of_the_command(tmp_path, capsys, monkeypatch):
    motion = p3dof.paper_motion(11).to_csv(tmp_path / "motion.csv").rename(tmp_path / "joints.svg")
    (tmp_path / "file").touch()
    for arguments, words in (
        (("--format", "doc"), "'doc' is not one of 'png', 'svg', 'pdf'"),
        (("--only", "all"), "'all' is not one of"),
        (("--at", "nan"), "expected a time of the motion, from 0 to 1 s, got nan"),
        (("--motion", motion, "--out", tmp_path), "would be overwritten"),
        (("--only", "mechanism", "--out", tmp_path / "file"), "cannot be written"),
        (("--motion", tmp_path / "none.csv"), "cannot be read"),
    ):
        code, out, err = run(capsys, "plots", *arguments)
        assert code == 2
        assert words in err
        assert err.count("\n") == 1
        assert "wrote" not in out
    assert motion.read_text().startswith("t")
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    code, _, err = run(capsys, "plots", "--out", tmp_path)
    assert code == 2
    assert "p3dof[plot]" in err


def test_limits_and_invalid_samples_are_told(tmp_path, capsys):
    time = np.linspace(0, 1, 21)
    pose = np.column_stack([0.3 * time**2, 0 * time, 0 * time])
    p3dof.Motion.from_poses(time, pose).to_csv(tmp_path / "m.csv")
    arguments = ("plots", "--motion", tmp_path / "m.csv", "--out", tmp_path / "o", "--format", "svg")
    arguments += ("--only", "joints", "--only", "reactions", "--only", "mechanism")
    code, _, err = run(capsys, *arguments)
    assert code == 1
    assert "leg A is too short" in err
    code, out, _ = run(capsys, *arguments, "--on-invalid", "nan")
    assert code == 1
    assert "samples are invalid and left NaN" in out
    assert len(list((tmp_path / "o").iterdir())) == 3


def test_importing_the_command_loads_no_matplotlib():
    code = "import p3dof.cli.forces, p3dof.report.plots.mechanism, sys; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
