"""Sweeps of runs in time: those of `simulate_many`, whichever block a run is in."""

from __future__ import annotations

import numpy as np
import pytest
from sweep_problems import files

import p3dof
from p3dof._base import blocks
from p3dof.design import sweeps

REST = p3dof.Motion.rest_to_rest([0, 0, 0], [0.02, -0.02, 0.1], 0.1, 11)
VARIABLES = {
    "start.y": blocks.Normal(0, 1e-3),
    "controller.frequency": blocks.Uniform(4, 8),
    "platform.mass": blocks.Normal(8, 0.2),
}


def problem(damping=1.0, count=24):
    return sweeps.RunSweep(
        blocks.Samples(VARIABLES, count),
        0.1,
        controller=p3dof.runs.PD(p3dof.PAPER, REST, damping=damping),
        control=p3dof.runs.ControlLoop(rate=1000, noise=p3dof.runs.Noise(1e-6, 1e-4, seed=5)),
        block_size=7,
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    found = (p3dof.blocks.TopK("rms_error_y", 3), p3dof.blocks.Moments(("peak_force", "rms_error_y")))
    return p3dof.sweep(problem(), tmp_path_factory.mktemp("runs"), reductions=found, seed=2)


def test_runs_are_those_of_one_call(made):
    columns = made.columns()
    given = {name: columns[name] for name in ("start.y", "controller.frequency", "bodies.platform.mass")}
    found = p3dof.load().simulate_many(
        0.1,
        {**given, "seed": np.arange(24) + 5},
        controller=p3dof.runs.PD(p3dof.PAPER, REST),
        control=p3dof.runs.ControlLoop(rate=1000, noise=p3dof.runs.Noise(1e-6, 1e-4)),
    )
    assert found.finished.all()
    np.testing.assert_array_equal(columns["stop"], found.stop)
    for i, leg in enumerate("abc"):
        np.testing.assert_array_equal(columns[f"peak_force_{leg}"], found.peak_force[:, i])
    np.testing.assert_array_equal(columns["rms_error_y"], found.rms_error[:, 0])
    np.testing.assert_array_equal(columns["velocity_theta"], found.velocity[:, 2])
    assert len(np.unique(columns["rms_error_y"])) == 24  # no run has the noise and the start of another


def test_columns_have_units(made):
    units = dict(made.manifest.units)
    assert {units[name] for name in ("start.y", "y", "peak_error_z")} == {"m"}
    told = {
        name: units[name]
        for name in ("controller.frequency", "bodies.platform.mass", "velocity_theta", "end")
    }
    assert list(told.values()) == ["Hz", "kg", "rad/s", "s"]
    assert set(made.manifest.columns) - set(units) == {"stop"}
    assert "peak_force [N]" in made._repr_html_()


def test_runs_go_on_to_the_same_bits(made, tmp_path):
    def press(done, _):
        if done == 14:
            raise KeyboardInterrupt

    options = {"reductions": made.manifest.reductions, "seed": 2}
    with pytest.raises(blocks.SweepInterrupted):
        p3dof.sweep(problem(), tmp_path, progress=press, **options)
    p3dof.sweep(problem(), tmp_path, resume=True, workers=2, **options)
    assert files(tmp_path) == files(made.folder)


def test_another_controller_is_not_resumed(made):
    with pytest.raises(p3dof.errors.SweepError, match=r"settings\.controller\.zeta is 1\.0 there, 0\.7 here"):
        p3dof.sweep(problem(0.7), made.folder, resume=True, reductions=made.manifest.reductions, seed=2)


def test_an_interrupted_block_is_not_taken_for_a_whole_one(tmp_path, monkeypatch):
    """`simulate_many` returns what is done when somebody presses Ctrl-C: less than a block."""
    from dataclasses import replace

    from p3dof.design.sweeps import designs

    whole = designs.simulate_many
    monkeypatch.setattr(designs, "simulate_many", lambda *a, **o: replace(whole(*a, **o), interrupted=True))
    with pytest.raises(blocks.SweepInterrupted, match="0 of 4 blocks"):
        p3dof.sweep(problem(), tmp_path)
    assert not files(tmp_path)


def test_what_a_sweep_has_of_its_own_is_refused():
    with pytest.raises(p3dof.InputError, match="histories: expected none, a sweep has its own"):
        sweeps.RunSweep(blocks.Samples(VARIABLES, 5), 0.1, histories=True)
