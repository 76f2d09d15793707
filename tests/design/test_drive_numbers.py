"""Every number of the tables of drives, by hand: sums over samples of unlike drives, one with a gear."""

import math

import numpy as np
import pytest
from drives_by_hand import BELTED, GEARED, MARGINS, PLAIN, Axis, trapezoids
from table_numbers import check_table, shows

from p3dof.design.drives import Cycle, Drive, Motor, size_of
from p3dof.design.drives.tables import axes_table, ranking_table, ratings_table


def cycle_by_hand():
    """Twelve samples at uneven times, a dwell among them, and a rest after them."""
    rng = np.random.default_rng(5)
    time = np.cumsum([0.2, 0.03, 0.05, 0.02, 0.07, 0.04, 0.1, 0.03, 0.06, 0.02, 0.05, 0.04])
    force, speed = rng.normal(20, 70, (12, 3)), rng.normal(0, 1, (12, 3))
    acceleration = rng.normal(0, 3, (12, 3))
    speed *= [0.35, 1.6, 0.25]
    speed[5:8] = acceleration[5:8] = 0  # at rest
    return Cycle(time, force, speed, acceleration, rest=0.35, holding=[30.0, -55.0, 41.0])


HELD, WHEN = [61.0, 58.0, 47.0], [0.23, 0.35, math.nan]
MASSES = np.array([[4.0, 5.0, 6.0], [9.0, 11.0, 7.0]])


@pytest.fixture(scope="module")
def found():
    cycle = cycle_by_hand()
    drives = GEARED, BELTED, PLAIN
    sizing = size_of(
        cycle, drives, held=np.array(HELD), held_time=np.array([0.23, 0.35, 0.4]), load_mass=MASSES
    )
    axes = [Axis(cycle, drive, k, HELD[k], WHEN[k], MASSES[:, k].tolist()) for k, drive in enumerate(drives)]
    return sizing, axes


def bus(axes):
    together = [sum(powers) for powers in zip(*(axis.power for axis in axes), strict=True)]
    time = axes[0].time
    works = (trapezoids(time, [side(p, 0) for p in together]) for side in (max, min))
    return [*works, max(together), min(together)]


@shows("p3dof.design.drives.tables.axes_table")
def test_what_a_cycle_takes_of_each_axis(found):
    sizing, axes = found
    columns = [axis.column() for axis in axes]
    rows = {name: [column[name] for column in columns] for name in columns[0]}
    check_table(axes_table(sizing), rows, note=bus(axes))


@shows("p3dof.design.drives.tables.ratings_table")
def test_how_much_of_each_rating_is_used(found):
    sizing, axes = found
    rows = {}
    for leg, axis in zip("ABC", axes, strict=True):
        for name, (value, allowed, when) in sorted(
            axis.ratings.items(), key=lambda item: -item[1][0] / item[1][1]
        ):
            place = "over the cycle" if math.isnan(when) else f"place {when:.3f}"
            limit = f"{1 - MARGINS.get(name.split(' [')[0], 0):.0%}"
            rows[f"{leg}: {name}"] = (value, allowed, (value / allowed,), limit, when, place)
    check_table(ratings_table(sizing, "place {:.3f}".format), rows)
    assert max(len(axis.ratings) for axis in axes) == 13


@shows("p3dof.design.drives.tables.ranking_table")
def test_which_rating_is_used_most_and_by_how_much(found):
    sizing, axes = found
    cycle = cycle_by_hand()
    slow = Cycle(
        cycle.time, 0.05 * cycle.force, 0.05 * cycle.speed, 0.05 * cycle.acceleration, 0.35, [1.0] * 3
    )
    light = size_of(slow, BELTED, held=np.full(3, 1.0), load_mass=MASSES)
    others = [Axis(slow, BELTED, k, 1.0, math.nan, MASSES[:, k].tolist()) for k in range(3)]
    rows = []
    for name, three in (("belted", others), ("A: geared, B: belted, C: plain", axes)):
        worst = [axis.worst() for axis in three]
        leg = max(range(3), key=lambda k: worst[k])
        fits = "yes" if worst[leg][0] <= 1 else "no"
        most = f"{worst[leg][1]} of {'ABC'[leg]}"
        rows.append((name, fits, most, *((share,) for share, _ in worst), bus(three)[2]))
    assert [row[1] for row in rows] == ["yes", "no"]  # most of the light one is used of its inertia ratio
    check_table(ranking_table([light, sizing]), rows, note=[1, "of", 2])
    check_table(ranking_table([light, sizing], 1), rows[:1], note=[1, 2, 1, "more"])
    check_table(ranking_table([light] * 12), rows[:1] * 10, note=[12, 12, 2])


def test_a_motor_without_continuous_torque_at_a_speed_is_too_hot_from_there():
    motor = Motor(1.0, 3.0, 400.0, 1e-4, curve=[[0, 1, 3], [100, 0, 3], [400, 0, 1]], time_constant=5.0)
    speed = np.outer([0.01, 0.3, 0.01], np.ones(3))
    cycle = Cycle([0, 1, 2], np.full((3, 3), 100.0), speed, 0 * speed)
    (heating,) = (
        rating
        for rating in size_of(cycle, Drive(motor, PLAIN.transmission)).axes[0].ratings
        if rating.name == "heating"
    )
    assert (heating.required, heating.time) == (math.inf, 1.0)


def test_an_axis_that_only_drives_takes_nothing_back():
    still = np.full((2, 3), 50.0), np.full((2, 3), 0.2), np.zeros((2, 3))
    axis = size_of(Cycle([0, 1], *still), GEARED).axes[0]
    used = {rating.name: rating.required for rating in axis.ratings}
    assert used["power"] == axis.peak_power > 10
    assert used["regeneration"] == axis.negative_work == 0


def test_a_small_torque_is_more_than_none():
    force = np.outer([0.0, 1e-6], np.ones(3))
    cycle = Cycle([0, 1], force, 0 * force, 0 * force)
    peak = next(rating for rating in size_of(cycle, PLAIN).axes[0].ratings if rating.name == "peak torque")
    assert peak.required == pytest.approx(1e-6 * 0.01 / (2 * math.pi), rel=1e-12)
    assert peak.time == 1.0
