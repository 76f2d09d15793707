"""Figures: what is drawn is what was computed."""

from __future__ import annotations

import numpy as np
import pytest

import p3dof
from p3dof import plots
from p3dof.errors import FileError, InputError, MissingExtraError


@pytest.fixture(scope="module")
def results():
    robot, motion = p3dof.load(), p3dof.paper_motion(51)
    return [robot.inverse_dynamics(motion, method=method) for method in ("pinocchio", "virtual-power")]


def test_curves_are_the_forces_and_their_difference(results):
    figure = plots.forces_figure(results)
    assert len(figure.axes) == 6
    for leg in range(3):
        top, bottom = figure.axes[leg], figure.axes[3 + leg]
        for line, result in zip(top.lines, results, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), result.forces[:, leg])
        difference = results[0].forces[:, leg] - results[1].forces[:, leg]
        np.testing.assert_array_equal(bottom.lines[0].get_ydata(), difference)
        assert "[N]" in top.get_ylabel()
        assert bottom.get_xlabel() == "time [s]"


def test_one_result(results, tmp_path):
    figure = plots.forces_figure(results[:1])
    assert len(figure.axes) == 3
    for name, start in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.pdf", b"%PDF")):
        assert plots.save(figure, tmp_path / name).read_bytes().startswith(start)


def test_bad_input(results, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="expected one or two, got 3"):
        plots.forces_figure([*results, results[0]])
    other = p3dof.load().inverse_dynamics(p3dof.paper_motion(7), method="virtual-power")
    with pytest.raises(InputError, match="same motion"):
        plots.forces_figure([results[0], other])
    with pytest.raises(InputError, match=r"ends in \.png"):
        plots.save(plots.forces_figure(results), tmp_path / "figure.doc")
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="cannot be written"):
        plots.save(plots.forces_figure(results), tmp_path / "file" / "a.png")
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[plot\]"):
        plots.forces_figure(results)
