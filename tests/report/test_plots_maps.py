"""Figures of workspaces: what is drawn is what was computed."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

import p3dof
from p3dof._base.errors import InputError
from p3dof.report import plots

ROBOT = p3dof.load()
SPACE = ROBOT.workspace()
MOTION = p3dof.paper_motion(31)


def mesh_of(axis):
    return next(item for item in axis.collections if isinstance(item, QuadMesh))


def lines_of(axis):
    return {line.get_label(): line for line in axis.lines}


def test_a_map_has_its_values_loci_path_and_box():
    figure = plots.map_figure(SPACE, "lti", "frequency_1", motion=MOTION, box=True, count=31)
    left, right = (axis for axis in figure.axes if axis.get_xlabel() == "y [mm]")
    found = SPACE.map("lti", "frequency_1", count=31)
    np.testing.assert_array_equal(mesh_of(left).get_array().filled(np.nan), found.lti.values.T)
    np.testing.assert_array_equal(mesh_of(right).get_array().filled(np.nan), found.frequency_1.values.T)
    assert left.get_title() == "LTI"
    assert right.get_title() == "frequency 1 [Hz]"
    assert left.get_ylabel() == "θ [deg]"
    lines = lines_of(left)
    above = SPACE.loci()["actuation above"]
    np.testing.assert_allclose(lines["det J = 0"].get_ydata(), np.degrees(above[:, 1]))
    assert left.get_ylim()[1] > 60  # the singularity near by is seen
    np.testing.assert_allclose(lines["path"].get_xdata(), 1e3 * MOTION.pose[:, 0])
    np.testing.assert_allclose(lines["path"].get_ydata(), np.degrees(MOTION.pose[:, 2]))
    box = SPACE.largest_box()
    assert max(lines["largest box"].get_xdata()) == pytest.approx(1e3 * box.y[1])
    assert "leg horizontal" in {text.get_text() for text in figure.legends[0].get_texts()}


def test_slices_end_where_the_stroke_does():
    figure = plots.slices_figure(SPACE, "lti", theta=[0.0, 0.5], z=[0.1], count=41)
    turned, _, flat = (axis for axis in figure.axes if axis.get_xlabel() == "y [mm]")
    corners = mesh_of(turned).get_coordinates()
    y = corners[0, :, 0] / 1e3
    low, high = SPACE.z_range(y, 0.0)
    np.testing.assert_allclose(corners[0, :, 1], 1e3 * low)
    np.testing.assert_allclose(corners[1, :, 1], 1e3 * high)
    assert turned.get_title() == "LTI at θ = 0°"
    assert flat.get_title() == "LTI at z = 100 mm"
    values = mesh_of(flat).get_array().filled(np.nan)
    inside = SPACE.margin([[0, 0.1, 0], [0.2499, 0.1, 0]]).inside
    assert inside.tolist() == [True, False]
    assert np.isfinite(values[20, 20])
    assert np.isnan(values[20, 0])


def test_gaps_of_a_slice_have_no_values():
    """The demand leaves two pieces of y: between them nothing is drawn."""
    limits = replace(p3dof.PAPER.limits, force=330.0)
    space = ROBOT.workspace(limits, p3dof.analysis.WorkspaceMargins(acceleration=(27.0, 20.0, 100.0)))
    y = np.linspace(space.points.y.min(), space.points.y.max(), 81)
    inside = np.isfinite(space.height(y, 0.0))
    edges = np.count_nonzero(np.diff(inside.astype(int)))
    assert edges >= 2
    mesh = mesh_of(plots.slices_figure(space, "lti", theta=[0.0], count=81).axes[0])
    drawn = np.ma.filled(mesh.get_array(), np.nan).reshape(2, -1)[0]
    first, last = np.flatnonzero(inside)[[0, -1]]
    np.testing.assert_array_equal(np.isfinite(drawn), inside[first : last + 1])
    assert not inside[first : last + 1].all()


def test_a_slice_outside_says_so():
    figure = plots.slices_figure(SPACE, "lci", z=[3.0], count=11)
    assert "outside the workspace" in [text.get_text() for text in figure.axes[0].texts]


def test_loci_and_aspects_of_other_machines_are_drawn():
    for geometry in (
        p3dof.PAPER.geometry,
        p3dof.machine.Geometry(r=0.2, R=0.3, L=0.45),
        p3dof.machine.Geometry(L=0.9),
    ):
        robot = p3dof.load(replace(p3dof.PAPER, geometry=geometry))
        figure = plots.loci_figure(robot.workspace(), MOTION)
        assert {"home's aspect", "workspace", "det J = 0", "path"} <= set(lines_of(figure.axes[0]))
        assert plots.common.encoded(figure, "png").startswith(b"\x89PNG")


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(InputError, match="workspace: expected a Workspace, got 3"):
        plots.map_figure(3)
    with pytest.raises(InputError, match="motion: expected a Motion, got 'm'"):
        plots.loci_figure(SPACE, "m")
    with pytest.raises(InputError, match="indices: expected at most 9 numbers, got 12"):
        plots.map_figure(SPACE, "lone_force", "lone_acceleration")
    with pytest.raises(InputError, match="theta, z: expected one to 9 slices, got 0"):
        plots.slices_figure(SPACE, theta=[])
    with pytest.raises(InputError, match="index: expected one of"):
        plots.slices_figure(SPACE, "lit")
