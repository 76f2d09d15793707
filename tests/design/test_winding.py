"""What a bus voltage lets a motor give: reference torques, data sheets, bad input; the best lead."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import p3dof
from p3dof._base.errors import DriveError
from p3dof.design.drives import Drive, Motor, Screw, Winding, axes_table, cycle_of, read_catalogue, size_of

RPM = math.pi / 30
PHASE = {"bus_voltage": 320, "pole_pairs": 4, "resistance": 0.5, "inductance": 4e-3, "measured": "phase"}
REFERENCE = {**PHASE, "flux": 0.07, "max_current_peak": 12}
SPEEDS = RPM * np.array([0.0, 3000, 5000, 6000, 7000])


@pytest.mark.parametrize(
    ("weakening", "expected"),
    [(False, [5.04, 5.04, 5.04, 2.01728, 0]), (True, [5.04, 5.04, 5.04, 4.78175, 4.30986])],
)
def test_the_torque_that_a_voltage_allows(weakening, expected):
    """Found elsewhere; with field weakening on a grid of currents, which is a little under the best."""
    found = Winding(**REFERENCE, field_weakening=weakening).torque(SPEEDS)
    np.testing.assert_allclose(found, expected, rtol=0, atol=4e-4 if weakening else 1e-5)


@pytest.mark.parametrize("rpm", [6000, 7000])
def test_with_field_weakening_both_limits_are_met(rpm):
    """On the circle of the largest current, where the voltage is that of the bus."""
    speed = rpm * RPM
    w = 4 * speed

    def left(angle):
        direct, cross = -12 * math.sin(angle), 12 * math.cos(angle)
        across, along = 0.5 * direct - w * 4e-3 * cross, 0.5 * cross + w * (4e-3 * direct + 0.07)
        return across**2 + along**2 - 320**2 / 3

    expected = 6 * 0.07 * 12 * math.cos(brentq(left, 0, math.pi / 2, xtol=1e-14))
    found = Winding(**REFERENCE, field_weakening=True).torque(np.array([speed]))
    assert float(found[0]) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("weakening", [False, True])
def test_no_currents_within_the_limits_give_more(weakening):
    """A search over a grid of currents; with a lot of resistance, with a weak and with a strong magnet."""
    for change in ({}, {"resistance": 4.0}, {"flux": 0.02}, {"flux": 0.2}, {"inductance": 2e-4}):
        winding = Winding(**(REFERENCE | change), field_weakening=weakening)
        direct = np.linspace(-12, 12, 481)[:, None] if weakening else np.zeros((1, 1))
        cross = np.linspace(0, 12, 961)
        for speed in RPM * np.array([500.0, 4000, 6500, 9000, 20000]):
            w = 4 * speed
            across = winding.resistance * direct - w * winding.inductance * cross
            along = winding.resistance * cross + w * (winding.inductance * direct + winding.peak_flux)
            good = (across**2 + along**2 <= 320**2 / 3) & (direct**2 + cross**2 <= 144)
            most = 6 * winding.peak_flux * np.where(good, cross, 0).max()
            found = float(winding.torque(np.array([speed]))[0])
            assert most <= found + 1e-9
            assert found - most < 6 * winding.peak_flux * 12 * 0.03


@pytest.mark.parametrize(
    "given",
    [
        {"torque_constant_peak": 6 * 0.07, "max_current_rms": 12 / math.sqrt(2)},
        {"torque_constant_rms": 6 * 0.07 * math.sqrt(2), "max_current_peak": 12},
        {"voltage_constant": 4 * 1000 * RPM * 0.07 * math.sqrt(3 / 2), "max_current_peak": 12},
    ],
)
def test_all_ways_of_a_data_sheet_are_the_same_motor(given):
    lines = PHASE | {"resistance": 1.0, "inductance": 8e-3, "measured": "between lines"}
    for base in (PHASE, lines):
        found = Winding(**base, **given, field_weakening=True).torque(SPEEDS)
        np.testing.assert_allclose(
            found, Winding(**REFERENCE, field_weakening=True).torque(SPEEDS), rtol=1e-12
        )


def test_a_motor_gives_what_curve_and_winding_allow():
    winding = Winding(**REFERENCE)
    motor = Motor(1.6, 4.8, 7000 * RPM, 1e-4, rated_speed=3000 * RPM, winding=winding)
    np.testing.assert_allclose(motor.peak(SPEEDS), [4.8, 4.8, 4.8, 2.01728, 0], rtol=0, atol=1e-5)
    assert (motor.continuous(SPEEDS) <= motor.peak(SPEEDS)).all()
    bare = Motor(1.6, 4.8, 7000 * RPM, 1e-4, rated_speed=3000 * RPM)
    drives = [Drive(one, Screw(0.01, inertia=2e-4)) for one in (motor, bare)]
    cycle = cycle_of(p3dof.load().inverse_dynamics(p3dof.paper_motion(401), method="compiled"))
    used = [size_of(cycle, drive).axes[2].ratings[0].share for drive in drives]
    assert used[0] > 1.2 * used[1]  # 6600 rpm: the voltage is nearly used up


CATALOGUE = """
motors:
  - name: M
    rated_torque: 1.6
    peak_torque: 4.8
    max_speed: 6000 rpm
    inertia: 1 kg cm^2
    winding: {bus_voltage: 320, pole_pairs: 4, resistance: 1, inductance: 0.008, measured: between lines,
              torque_constant_rms: 0.59397, max_current_rms: 8.48528}
screws: [{name: S, lead: 10 mm, inertia: 0.0002}]
"""


def test_a_catalogue_may_give_a_winding(tmp_path):
    (tmp_path / "drives.yaml").write_text(CATALOGUE, encoding="utf-8")
    motor = read_catalogue(tmp_path / "drives.yaml").motors[0]
    assert float(motor.peak(np.array([6000 * RPM]))[0]) == pytest.approx(2.01728, abs=1e-3)


BAD_FILES = {
    "winding: the field 'measured' is missing": (", measured: between lines", ""),
    "measured: expected one of phase, between lines": ("between lines", "line"),
    "expected exactly one of flux, torque_constant_rms": ("torque_constant_rms: 0.59397,", ""),
    "got flux and torque_constant_rms": ("torque_constant_rms", "flux: 1, torque_constant_rms"),
    "exactly one of max_current_rms, max_current_peak": (", max_current_rms: 8.48528", ""),
    "unknown field 'torque_constant'": ("torque_constant_rms", "torque_constant"),
    "is each of them by rms or by peak value?": ("max_current_rms", "max_current_peak"),
    "resistance: expected": ("resistance: 1", "resistance: one"),
    "inductance: expected a number above zero": ("inductance: 0.008", "inductance: 0"),
    "pole_pairs: expected a whole number": ("pole_pairs: 4", "pole_pairs: 4.5"),
    "winding: expected": ("{bus_voltage: 320", "[{bus_voltage: 320"),
}


@pytest.mark.parametrize(("words", "change"), BAD_FILES.items())
def test_what_may_be_meant_otherwise_is_refused_by_name(tmp_path, words, change):
    text = CATALOGUE.replace(*change)
    if change[1].startswith("["):
        text = text.replace("8.48528}", "8.48528}]")
    (tmp_path / "bad.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(DriveError, match=r"\A[^\n]*\Z") as found:
        read_catalogue(tmp_path / "bad.yaml")
    assert words in str(found.value)
    assert "bad.yaml" in str(found.value)


def test_the_best_lead_is_that_of_the_least_rms_torque():
    """Of the paper's motion with 1.5 kg cm²; each axis has its own. Other leads take more."""
    cycle = cycle_of(p3dof.load().inverse_dynamics(p3dof.paper_motion(4001), method="compiled"))

    def sized(lead):
        return size_of(cycle, Drive(Motor(1.6, 30.0, 1e5, 0.5e-4), Screw(lead, 1.0, 1.0, inertia=1e-4)))

    found = sized(0.02)
    leads = [axis.best_lead for axis in found.axes]
    np.testing.assert_allclose(np.multiply(leads, 1e3), [14.785, 8.677, 22.407], rtol=0, atol=2e-3)
    assert "lead for minimum rms torque [mm]" in [row[0] for row in axes_table(found).rows]
    for leg, lead in enumerate(leads):
        rms = [sized(share * lead).axes[leg].rms_torque for share in (0.9, 1.0, 1.1)]
        assert rms[1] < min(rms[0], rms[2])


def test_a_peak_torque_a_tenth_above_the_windings_is_taken_for_another_unit():
    winding = Winding(**REFERENCE)
    given = {"rated_torque": 1.0, "max_speed": 500.0, "inertia": 1e-4, "winding": winding}
    assert Motor(peak_torque=1.0999 * winding.stall_torque, **given).winding is winding
    with pytest.raises(DriveError, match="by rms or by peak value"):
        Motor(peak_torque=1.1001 * winding.stall_torque, **given)
