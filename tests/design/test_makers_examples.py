"""Worked examples that makers print of guides, ball screws and braking resistors, to their digits.

THK: general catalogue, A Technical Descriptions of the Products, by its pages. HIWIN: Linear Guideway
G99TE20-1808 and Ballscrews S99TE20-1610, Technical Information. What a maker multiplies loads with for
impacts, f_W or f_p, is in the forces here.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from p3dof.design.bearings import Guide
from p3dof.design.bearings.evaluation import _guide
from p3dof.design.drives import Cycle, Drive, Motor, Screw, Supply, size_of, with_supply
from p3dof.design.drives.nuts import nut_life

G = 9.8
RPM = math.pi / 30
SOFTER = math.sqrt(2.06 / 2.1)  # THK takes 2.06e11 N/m² for Young's modulus of a screw


def life_of(guide, phases):
    """Return the life of a guide; a phase is its time [s], speeds at both ends [m/s], force and moment."""
    ends = np.cumsum([0.0, *(phase[0] for phase in phases)])
    time = np.repeat(ends, 2)[1:-1]
    rate = np.array([speed for phase in phases for speed in phase[1:3]])
    forces, moments = (np.repeat([phase[k] for phase in phases], 2, axis=0) for k in (3, 4))
    loads = SimpleNamespace(forces=forces, moments=moments)
    reactions = type("Loads", (), {"time": time, "__getitem__": lambda *_: loads})()
    return _guide(reactions, "slide_a", guide, rate, float(ends[-1]), None)


# --- guides -------------------------------------------------------------------------------------------------

SET_DOWN = {  # PE of THK's blocks 1 to 4 [N]: even, to the left faster and slower, to the right likewise
    "even": (2891, 4459, 3479, 1911),
    "left faster": (608.9, 7958.9, 6978.9, 1588.9),
    "left slower": (4057.7, 3514.5, 2534.5, 3077.7),
    "right faster": (6390.9, 1625.7, 645.7, 5410.9),
    "right slower": (1946.5, 5625.7, 4645.7, 966.5),
}
ACCELERATIONS = {
    "even": 0.0,
    "left faster": 10.0,
    "left slower": -3.333,
    "right faster": -10.0,
    "right slower": 3.333,
}


def horizontal(rail, acceleration, factor=1.0):
    """Return force and moment of one of two rails, across x (up) and y; its blocks are 0.6 m apart."""
    m1, m2, l1, l2, l3, l4, l5 = 800.0, 500.0, 0.4, 0.12, 0.05, 0.2, 0.35
    up = (m1 + m2) * G / 2 + (m1 * G * l3 / l1 if rail == 0 else -m1 * G * l3 / l1)
    about_y = -m1 * G * l2 / 2 - (m1 * l5 + m2 * l4) * acceleration / 2
    return factor * np.array([up, 0.0, 0.0]), factor * np.array([m1 * l3 * acceleration / 2, about_y, 0.0])


def test_four_blocks_on_two_horizontal_rails():
    """THK, A-103 to A-107: HSR35LA2SS, fast acceleration, load factor 1.5."""
    guide = Guide(dynamic=50.2e3, static=81.4e3, basis=50e3, moments=(1.0, 1.0, 1.0), distance=0.6)
    for phase, printed in SET_DOWN.items():
        found = [
            guide.equivalent(*(each[None] for each in horizontal(rail, ACCELERATIONS[phase])))[0]
            for rail in (0, 1)
        ]
        blocks = (*found[0], *found[1][::-1])
        assert blocks == pytest.approx(printed, abs=0.2), phase  # sums of four loads in 0.1 N
    times = {"faster": (0.05, 0.0, 0.5), "even": (2.8, 0.5, 0.5), "slower": (0.15, 0.5, 0.0)}

    def cycle(rail, factor):
        each = [(f"{way} {kind}", kind) for way in ("left", "right") for kind in times]
        return [
            (*times[kind], *horizontal(rail, ACCELERATIONS.get(name, 0.0), factor)) for name, kind in each
        ]

    lives = []
    for rail, (first, second) in enumerate(((2940.1, 4492.2), (1985.5, 3520.4))):
        found = life_of(guide, cycle(rail, 1.0))
        assert found.mean_loads == pytest.approx((first, second), abs=0.1)
        assert found.way == pytest.approx(2 * 1.45, rel=1e-12)
        worn = life_of(guide, cycle(rail, 1.5))
        lives += [50 * (50.2e3 / mean) ** 3 for mean in worn.mean_loads]
        assert worn.life / 1e3 == pytest.approx(min(lives[-2:]), rel=1e-12)
        if rail == 0:
            assert found.static_safety == pytest.approx(10.2, abs=0.05)
            assert worn.life / 1e3 == pytest.approx(20_600, abs=100)
    assert lives == pytest.approx((73_700, 20_600, 239_000, 43_000), rel=5e-3)


def test_four_blocks_on_two_vertical_rails():
    """THK, A-108 to A-110: HSR25CA2SS, 100 kg more on the way up, load factor 1.2."""
    guide = Guide(dynamic=19.9e3, static=34.4e3, basis=50e3, moments=(1.0, 1.0, 1.0), distance=0.3)
    carried = [
        (200 * 0.15 + 100 * 0.25 + 100 * 0.28, 300 * 0.05 + 100 * 0.08),
        (200 * 0.15 + 100 * 0.25, 300 * 0.05),
    ]

    def cycle(factor):
        return [
            (2.0, 0.5, 0.5, np.zeros(3), factor * G / 2 * np.array([aside, out, 0.0]))
            for out, aside in carried
        ]

    for phase, (load, out, aside) in zip(
        cycle(1.0), ((1731.3, 1355.6, 375.7), (1143.3, 898.3, 245)), strict=True
    ):
        assert phase[4] / 0.3 == pytest.approx([aside, out, 0], abs=0.1)
        assert guide.equivalent(phase[3][None], phase[4][None])[0] == pytest.approx((load, load), abs=0.1)
    found = life_of(guide, cycle(1.0))
    assert found.mean_loads == pytest.approx((1495.1, 1495.1), abs=0.1)
    assert found.static_safety == pytest.approx(19.9, abs=0.05)
    assert life_of(guide, cycle(1.2)).life / 1e3 == pytest.approx(68_200, abs=50)


def test_blocks_under_a_tilting_weight():
    """HIWIN, table 1-6: HGH30CA, 15 kN at 0.2 m against 1 kN at 0.25 m, load factor 2."""
    guide = Guide(dynamic=38.74e3, static=52.19e3, basis=50e3, moments=(1.0, 1.0, 1.0), distance=0.6)
    moment = np.array([0.0, (15e3 * 0.2 - 1e3 * 0.25) / 2, 0.0])
    assert guide.equivalent(np.zeros((1, 3)), moment[None])[0] == pytest.approx((2290, 2290), abs=5)
    found = life_of(guide, [(1.0, 0.5, 0.5, np.zeros(3), 2 * moment)])
    assert found.life / 1e3 == pytest.approx(30_258, rel=3 * 0.005 / 2.29)  # of a load in three digits


def test_moments_of_a_single_block_are_loads():
    """THK, A-403: KR5520A, moment equivalent factors 0.0863 and 0.0283 per mm, 30 kg, 2.4 m/s²."""
    guide = Guide(
        dynamic=38.1e3, static=61.9e3, basis=50e3, moments=(38.1e3 / 86.3, 38.1e3 / 86.3, 38.1e3 / 28.3)
    )
    weight = 30 * 9.807
    for acceleration, load in ((0.0, 627), (2.4, 1826)):
        moment = np.array([0.0, 30 * acceleration * 0.193, weight * 0.04])
        found = guide.equivalent(np.array([[weight, 0, 0]]), moment[None])[0, 0]
        assert found == pytest.approx(load, abs=1)
        if acceleration:
            assert 61.9e3 / found == pytest.approx(33.9, abs=0.05)


# --- ball screws --------------------------------------------------------------------------------------------


def trapezoids(top, times, forces, acceleration, rest, back=None):
    """Return a cycle of a slider: faster, evenly, slower, at rest; then back with other forces."""
    rows, clock = [], 0.0
    for sign, loads in ((1, forces), (-1, back)):
        speeds = ((0.0, top), (top, top), (top, 0.0))
        for span, pair, load, way in zip(times, speeds, loads, (1, 0, -1), strict=True):
            rows += [(clock + k * span, load, sign * pair[k], sign * way * acceleration) for k in (0, 1)]
            clock += span
        if sign > 0 and rest:
            rows += [(clock, 0.0, 0.0, 0.0), (clock + rest, 0.0, 0.0, 0.0)]
            clock += rest
    time, *columns = np.array(rows).T
    return Cycle(
        time, *(np.repeat(column[:, None], 3, axis=1) for column in columns), rest=rest, holding=np.zeros(3)
    )


TRANSFER = Screw(
    0.04,
    1.0,
    inertia=1.48e-4,
    diameter=0.0175,
    length=1.1,
    nominal_diameter=0.02075,
    dynamic=5400.0,
    preload=0.0,
)


def test_a_screw_of_fast_transfer_equipment():
    """THK, A-722 to A-735: 80 kg at 1 m/s over 1 m, eight times a minute to and fro, WTF2040-2."""
    drag, push = 0.003 * 80 * 9.807 + 15, 80 * 1 / 0.15
    forces = (drag + push, drag, drag - push)
    assert forces == pytest.approx((550, 17, -516), abs=1)
    cycle = trapezoids(1.0, (0.15, 0.85, 0.15), forces, 1 / 0.15, 2.6, tuple(-force for force in forces))
    assert cycle.duration == pytest.approx(60 / 8)
    motor = Motor(1.5, 5.0, 3000 * RPM, 1e-3)
    axis = size_of(cycle, Drive(motor, TRANSFER)).axes[0]
    assert axis.nut.mean_loads == pytest.approx((225, 225), abs=0.5)
    assert axis.nut.mean_speed / RPM * cycle.duration / 7.5 == pytest.approx(8 * 2 * 1 / 0.04, rel=1e-12)
    lives = {5400: 4.1e9, 6600: 7.47e9, 11800: 4.27e10, 14500: 7.93e10}
    for rating, turns in lives.items():
        assert 1e6 * (rating / 1.5 / axis.nut.mean_loads[0]) ** 3 == pytest.approx(turns, rel=5e-3)
    used = {one.name: one for one in axis.ratings}
    assert used["critical speed"].allowed * SOFTER == pytest.approx(2180, rel=2e-3)
    assert used["DN"].allowed / 20.75 == pytest.approx(3370, abs=5)
    large = Screw(0.06, inertia=0.0, diameter=0.0264, length=1.1)
    assert 0.8 * large.critical_speed / RPM * SOFTER == pytest.approx(3294, rel=2e-3)
    fixed = Screw(0.02, inertia=0.0, diameter=0.0175, length=1.1, ends="fixed-fixed")
    assert fixed.buckling_force / 2 * SOFTER**2 == pytest.approx(15_500, rel=4e-3)  # 20 for 19.95
    # the torque: losses of the screw under friction only, as they are counted there
    lossy = tuple(drag / 0.9 + way * push for way in (1, 0, -1))
    turned = trapezoids(1.0, (0.15, 0.85, 0.15), lossy, 1 / 0.15, 2.6, tuple(-force for force in lossy))
    sized = size_of(turned, Drive(motor, TRANSFER)).axes[0]
    assert abs(sized.peak_torque) == pytest.approx(4.73, rel=3e-3)  # 1050 rad/s² is 1047
    assert sized.rms_torque == pytest.approx(1.305, rel=3e-3)
    assert 80 * (0.04 / (2 * math.pi)) ** 2 + 1.48e-4 == pytest.approx(3.39e-3, abs=5e-6)


def test_a_screw_of_a_vertical_conveyor():
    """THK, A-736 to A-746: 50 kg at 0.3 m/s over 0.6 m, five times a minute, BLK1510-5.6."""
    weight, push = 50 * 9.807, 50 * 0.3 / 0.2
    ways = (weight + 20, weight - 20)
    up, down = ([static + sign * push for sign in (1, 0, -1)] for static in ways)
    down.reverse()
    assert (*up, *down) == pytest.approx((585, 510, 435, 395, 470, 545), abs=1)
    times, screw = (0.2, 1.8, 0.2), Screw(0.01, 1.0, inertia=3.1e-5, dynamic=9800.0, preload=0.0)
    motor = Motor(1.0, 3.0, 3000 * RPM, 5e-5)
    bearing = trapezoids(0.3, times, [1.5 * f for f in up], 1.5, 0.0, [1.5 * f for f in down])
    nut = size_of(bearing, Drive(motor, screw)).axes[0].nut
    assert nut.mean_loads[0] / 1.5 == pytest.approx(492, abs=0.5)
    assert nut.life == pytest.approx(2.34e9, rel=3e-3)
    assert nut.life * 0.01 / 1e3 == pytest.approx(23_400, rel=3e-3)
    assert nut.turns * 5 == pytest.approx(600, rel=1e-12)  # in a minute
    lossy = [
        [static / 0.9 + sign * push for sign in order]
        for static, order in zip(ways, ((1, 0, -1), (-1, 0, 1)), strict=True)
    ]
    turned = trapezoids(0.3, times, lossy[0], 1.5, 0.0, lossy[1])
    held = np.full(3, (40 * 9.807 - 20) / 0.9)
    cycle = Cycle(turned.time, turned.force, turned.speed, turned.acceleration, rest=7.6, holding=held)
    axis = size_of(cycle, Drive(motor, screw)).axes[0]
    assert axis.peak_torque == pytest.approx(1.1, abs=0.005)
    assert axis.rms_torque == pytest.approx(0.743, abs=0.001)
    assert 0.01 / (2 * math.pi) * held[0] == pytest.approx(0.658, abs=5e-4)
    fixed = Screw(0.01, inertia=0.0, diameter=0.0125, length=0.7)
    assert 0.8 * fixed.critical_speed / RPM * SOFTER == pytest.approx(3852, rel=2e-3)


KGF = 9.80665


@pytest.mark.parametrize(
    ("rows", "speed", "load"),
    [  # HIWIN, examples 4.5-1 and 4.5-4: load [kgf], rpm, share of the time; mean speed and mean load
        ([(110, 1000, 0.45), (440, 50, 0.35), (880, 100, 0.2)], 487.5, 318.3),  # printed: 318.5
        ([(100, 500, 0.2), (300, 100, 0.5), (500, 50, 0.3)], 165, 272),
    ],
)
def test_mean_loads_of_phases(rows, speed, load):
    ends = np.cumsum([0.0, *(row[2] for row in rows)])
    time = np.repeat(ends, 2)[1:-1]
    force, turning = (np.repeat([row[k] for row in rows], 2) for k in (0, 1))
    found = nut_life(time, force * KGF, turning * RPM, 1.0, 1e4, 0.0)
    assert found.mean_speed / RPM == pytest.approx(speed, rel=1e-12)
    assert found.mean_loads[0] / KGF == pytest.approx(load, abs=0.5 if load == 272 else 0.05)


@pytest.mark.parametrize(
    ("rating", "load", "rpm", "million"),
    [(2023, 432.5, 487.5, 102.375), (5674, 2966, 100, 7.0)],  # HIWIN, examples 4.5-2 and 4.5-3 [kgf]
)
def test_ratings_that_lives_need(rating, load, rpm, million):
    time, force, turning = np.array([0.0, 1.0]), np.full(2, load * KGF), np.full(2, rpm * RPM)
    found = nut_life(time, force, turning, 1.0, rating * KGF, 0.0)
    assert found.life / 1e6 == pytest.approx(million, rel=3 * 0.5 / 2023)  # of a rating in whole kgf
    assert found.hours == pytest.approx(found.life / rpm / 60, rel=1e-12)


# --- braking resistors --------------------------------------------------------------------------------------


def test_the_braking_resistor_of_a_cycle():
    """Yaskawa SGM7D manual, 12.8.6: E_S = J n² / 182, E_L = π n T_L t_D / 60, W_K = (E_S - E_L - E_C) / .2 T.

    Omron R88M-G, 4-4: E = 0.0524 N T_D t, and its mean over the cycle.
    """
    inertia, rpm, drag, stop, period = 4e-4, 3000.0, 0.2, 0.1, 1.0
    bus = Supply(100e-6, 320.0, 380.0, resistance=40.0, resistor_power=100.0)
    rotation = inertia * rpm**2 / 182
    burnt = rotation - math.pi / 60 * rpm * drag * stop - bus.energy
    speed = rpm * RPM  # a screw of 2π m a turn: 1 rad is 1 m
    screw = Screw(2 * math.pi, 1.0, inertia=0.0)
    time = np.array([0.0, 0.1, 0.1, 0.1 + stop])
    moving = np.array([0.0, speed, speed, 0.0])
    slowing = np.array([1, 1, -1, -1]) * speed / np.array([0.1, 0.1, stop, stop])
    columns = (np.array([drag, drag, drag, drag]), moving, slowing)
    only_a = np.array([1.0, 0.0, 0.0])
    cycle = Cycle(
        time, *(column[:, None] * only_a for column in columns), rest=period - 0.2, holding=np.zeros(3)
    )
    sized = size_of(cycle, Drive(Motor(3.0, 9.0, 600.0, inertia), screw))
    (found,) = with_supply(sized, cycle, bus).supply.buses
    assert found.burnt == pytest.approx(burnt, rel=4e-3 * rotation / burnt)  # 182 is 182.38
    assert found.mean_power / 0.2 == pytest.approx(burnt / 0.2 / period, rel=4e-3 * rotation / burnt)
    torque = inertia * speed / stop - drag
    assert found.braking_work == pytest.approx(0.0524 * rpm * torque * stop, rel=1e-3)
