"""`Manipulator.compare`: the verdict, and that it falls when one side is broken on purpose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from table_numbers import check_evidence, check_table, shows

import p3dof
from p3dof._base.errors import InputError, ReachError
from p3dof.methods import virtual_power
from p3dof.methods.comparison import Opinion, agreement_table, opinions_table
from p3dof.methods.virtual_power import VirtualPowerMethod


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def found(robot):
    return robot.compare(p3dof.paper_motion(31), wrench=[0, 1, -20, 0, 0.5, 0])


def test_methods_that_agree_pass(found):
    assert found.agree
    assert found.confirmed
    assert found.passed
    assert found.first.method == "pinocchio"
    assert found.second.method == "virtual-power"
    assert found.share < 1e-12
    assert found.verdict.startswith("the methods agree: ")
    assert found.verdict.endswith("over 31 samples")
    assert found.verdict_on_samples == ""
    assert found.compiled.name.startswith("compiled (")
    assert "the methods agree" in repr(found)


def test_differences_are_those_of_the_results(found):
    np.testing.assert_array_equal(found.difference, np.abs(found.first.forces - found.second.forces))
    assert found.largest_difference == found.difference.max()
    assert found.share == found.largest_difference / np.abs(found.second.forces).max()
    assert found.warnings == found.second.warnings


@pytest.mark.parametrize("factor", [1 + 1e-9, 1 - 1e-9])
def test_a_method_that_is_wrong_by_a_billionth_is_noticed(robot, monkeypatch, factor):
    true = virtual_power.forces_at
    monkeypatch.setattr(virtual_power, "forces_at", lambda *a, **k: true(*a, **k) * factor)
    found = robot.compare(p3dof.paper_motion(11))
    assert not found.agree
    assert not found.passed
    assert "DISAGREE" in found.verdict
    np.testing.assert_allclose(found.share, 1e-9, rtol=1e-3)


@shows(
    "p3dof.methods.comparison.agreement_table",
    "p3dof.methods.comparison.opinions_table",
    "p3dof.methods.comparison.Comparison.difference",
    "p3dof.methods.comparison.Comparison.largest_difference",
)
def test_every_number_of_a_comparison(found):
    """Errors put in on purpose, the largest of each actuator in samples of their own; one invalid."""
    errors = np.zeros((31, 3))
    errors[7], errors[12] = [2e-3, -5e-4, 1e-3], [-1e-3, 4e-4, -3e-3]
    known = found.second.forces
    wrong = known + errors
    wrong[20] = np.nan
    others = [known + part for part in (3 * errors, -0.5 * errors)]
    one = replace(
        found,
        first=replace(found.first, forces=wrong),
        compiled=Opinion("compiled", others[0], 31 * 2.5e-6),
        engines=(Opinion("other", others[1], 31 * 0.004),),
    )
    errors[20] = np.nan
    check_evidence(one, "difference", np.abs(errors), atol=1e-13)
    check_evidence(one, "largest_difference", 3e-3, rtol=1e-9)
    peaks = [max(abs(value) for value in column) for column in known.T.tolist()]
    squares = (found.second.time[1:] - found.second.time[:-1]) @ (known[1:] ** 2 + known[:-1] ** 2) / 2
    rows = {
        leg: (peaks[k], squares[k] ** 0.5, (most,), (most / peaks[k],))
        for k, (leg, most) in enumerate(zip("ABC", (2e-3, 5e-4, 3e-3), strict=True))
    }
    check_table(agreement_table(one), rows)
    shares = [(9e-3, 9e-3 / max(peaks), "2.5 µs"), (1.5e-3, 1.5e-3 / max(peaks), "4 ms")]
    check_table(opinions_table(one), dict(zip(("compiled", "other"), shares, strict=True)))


def test_an_opinion_that_is_off_or_missing_does_not_confirm(found):
    for worse in (1 + 2e-9, np.nan):
        wrong = Opinion("x 1.0", found.second.forces * worse, 1.0)
        other = replace(found, engines=(wrong,))
        assert other.agree
        assert not other.confirmed
        assert not other.passed
    near = Opinion("x 1.0", found.second.forces * (1 + 0.5e-9), 1.0)
    assert replace(found, engines=(near,)).confirmed


def test_samples_that_one_method_takes_alone_are_told_whatever_was_asked(robot, monkeypatch):
    true = VirtualPowerMethod.solve

    def lame(*given, **named):
        solution = true(*given, **named)
        forces = solution.forces.copy()
        forces[4] = np.nan
        return replace(solution, forces=forces)

    monkeypatch.setattr(VirtualPowerMethod, "solve", lame)
    found = robot.compare(p3dof.paper_motion(11), on_invalid="raise")
    np.testing.assert_array_equal(found.differing, [4])
    assert not found.agree
    assert "1 of 11, the first at t = 0.4 s (sample 4), which pinocchio takes and virtual-power refuses" in (
        found.verdict_on_samples
    )
    assert np.isfinite(found.largest_difference)


def test_a_motion_that_both_refuse_raises_or_is_left_out(robot):
    far = p3dof.Motion.rest_to_rest([0, 0, 0], [0.4, 0, 0], 1.0, samples=11)
    with pytest.raises(ReachError, match="leg"):
        robot.compare(far)
    found = robot.compare(far, on_invalid="nan")
    assert found.agree
    assert not found.passed  # the machine cannot make it
    assert 0 < found.both_valid.sum() < 11


def test_no_valid_sample_is_no_agreement(robot):
    out = p3dof.Motion([0, 1], [[0.4, 0, 0]] * 2, np.zeros((2, 3)), np.zeros((2, 3)))
    found = robot.compare(out, on_invalid="nan")
    assert found.compiled is None
    assert not found.agree


def test_the_file_has_all_but_the_kernels(found, tmp_path):
    other = replace(found, engines=(Opinion("x 1.0", found.second.forces, 1.0),))
    path = other.to_csv(tmp_path / "c.csv")
    header = path.read_text(encoding="utf-8").splitlines()[0]
    assert header.count("pinocchio") == header.count("virtual-power") == header.count("x 1.0") == 3
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    np.testing.assert_array_equal(table[:, -3:], found.first.forces - found.second.forces)


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ({"others": ["adams"]}, "engine: expected one of"),
        ({"others": "adams"}, "engine: expected one of"),
        ({"tolerance": -1}, "tolerance: expected a share"),
        ({"tolerance": np.nan}, "tolerance"),
        ({"tolerance": "small"}, "tolerance"),
        ({"wrench": [1, 2]}, "wrench"),
        ({"on_invalid": "skip"}, "on_invalid"),
    ],
)
def test_bad_arguments(robot, named, message):
    with pytest.raises(InputError, match=message):
        robot.compare(p3dof.paper_motion(5), **named)


@pytest.mark.parametrize("motion", [None, [0, 1], "m.csv"])
def test_what_is_no_motion_is_refused(robot, motion):
    with pytest.raises(InputError, match="motion: expected a Motion, got"):
        robot.compare(motion)


def test_progress_is_told(robot):
    told = []
    robot.compare(p3dof.paper_motion(21), progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (21, 21)
