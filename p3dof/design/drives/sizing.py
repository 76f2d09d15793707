"""`Sizing`: what a cycle takes of a drive on each axis, by its ratings, and whether it fits with reserve.

References
----------
Root mean square over the cycle, dwells included, is held against the continuous torque at the rms speed: that
is stricter than at the mean speed. Heating is that of one body: τ ẋ + x = (T / T_c(n))².

A speed above the motor's fastest is a matter of the speed alone: the peak torque is judged at the other
samples, rms torque and heating by the continuous torque at the fastest speed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from p3dof._base.checks import FloatArray, FrozenArrays, Readable, frozen_array, not_negative, require
from p3dof._base.errors import DriveError
from p3dof._base.tables import Columns, Tabular, columns_of_items
from p3dof.design.drives.margins import (
    INERTIA_RATIO,
    REMARKED_RATIO,
    SPEED_OF_NUTS,
    TURNS_OF_NUTS,
    VERDICTS,
    Ambient,
    Margins,
    verdict_of,
)
from p3dof.design.drives.motor import above_zero
from p3dof.design.drives.nuts import NutLife, RequiredLife, nut_life, required_life
from p3dof.design.drives.supply import DUTY, Supply, SupplyLoads, loads_of_supply
from p3dof.design.drives.transmission import (
    RACK_SAFETY,
    STATIC_SAFETY,
    USUAL_PRELOAD,
    Belt,
    Drive,
    Rack,
    Screw,
    passed,
)
from p3dof.machine.parameters import LEGS


class Moved(Protocol):
    """Forces over a motion: an `InverseDynamics` or a `TaskForces`."""

    @property
    def possible(self) -> bool:
        """Whether all samples are valid."""

    @property
    def time(self) -> FloatArray:
        """Times of the samples, shape (N,) [s]."""

    @property
    def nut_forces(self) -> FloatArray:
        """Forces of the actuators without what armatures take, shape (N, 3) [N]."""

    @property
    def slider_velocities(self) -> FloatArray:
        """Shape (N, 3) [m/s]."""

    @property
    def slider_accelerations(self) -> FloatArray:
        """Shape (N, 3) [m/s²]."""


@dataclass(frozen=True, eq=False)
class Cycle(FrozenArrays):
    """Forces and motion of the sliders over a cycle."""

    time: FloatArray  # (N,): times, rising; two samples of one time are a step [s]
    force: FloatArray  # (N, 3): of the sliders A, B, C: forces without reflected mass [N], [m/s], [m/s²]
    speed: FloatArray
    acceleration: FloatArray
    rest: float = 0.0
    """How long the machine rests after the last sample, with the forces that it has there at rest [s]."""
    holding: FloatArray = None  # type: ignore[assignment]  # made below
    """(3,): those forces [N]."""

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        time = frozen_array("time", self.time, ("N",), DriveError)
        if len(time) < 2 or (np.diff(time) < 0).any() or time[-1] <= time[0]:
            raise DriveError("time: expected at least two times that do not fall")
        set_(self, "time", time)
        for name in ("force", "speed", "acceleration"):
            set_(self, name, frozen_array(name, getattr(self, name), (len(time), 3), DriveError))
        set_(self, "rest", not_negative("rest", self.rest, DriveError))
        held = self.force[-1] if self.holding is None else self.holding
        set_(self, "holding", frozen_array("holding", held, (3,), DriveError))

    @property
    def duration(self) -> float:
        """How long a cycle takes [s]."""
        return float(self.time[-1] - self.time[0]) + self.rest

    @property
    def resting(self) -> FloatArray:
        """Which intervals between samples are at rest, shape (N-1,) of 0 and 1."""
        still = ((self.speed == 0) & (self.acceleration == 0)).all(axis=1)
        return np.asarray((still[1:] & still[:-1]).astype(float))


def cycle_of(found: Moved, rest: float = 0.0, holding: FloatArray | None = None) -> Cycle:
    """Return the cycle of forces over a motion or a task."""
    if not found.possible:
        raise DriveError("the machine cannot perform this motion: there is nothing to size")
    columns = found.nut_forces, found.slider_velocities, found.slider_accelerations
    return Cycle(found.time, *columns, rest, holding)  # type: ignore[arg-type]


WHIRL, BUCKLING = 0.8, 0.5  # shares of the critical speed and of Euler's load that a screw may bear
RPM = 30 / math.pi  # of rad/s
BRAKE_SAFETY = 1.5  # how much more a holding brake must hold than what it bears


@dataclass(frozen=True)
class Rating:
    """How much of one rating an axis uses, when it uses most of it."""

    name: str  # such as `"peak torque"`
    required: float  # what the cycle takes, and what there is [`unit`]
    allowed: float
    unit: str  # of both
    time: float = math.nan  # when [s]; NaN for what belongs to the whole cycle
    margin: float = 0.0  # share of what there is that must stay free
    assumed: str = ""  # which default stands for a number that the catalogue does not have, in words

    @property
    def limit(self) -> float:
        """What there is, less the margin [`unit`]."""
        return self.allowed * (1 - self.margin)

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        return VERDICTS[verdict_of(self.share, self.margin)]

    @property
    def share(self) -> float:
        """Required by allowed: 1 at the limit."""
        if self.allowed > 0:
            return self.required / self.allowed
        return math.inf if self.required > 0 else 0.0


def _by_need(rating: Rating) -> tuple[int, float]:
    """Return what orders ratings, the worst last; shares that differ by rounding are equal."""
    return VERDICTS.index(rating.verdict), round(rating.share, 9)


@dataclass(frozen=True)
class AxisLoads(Readable):
    """What a cycle takes of the drive of one axis."""

    peak_torque: float  # largest torque of the motor, with its sign [N m]
    peak_time: float  # when [s]
    peak_inertia_share: float  # share of it that the turning parts take for themselves
    rms_torque: float  # over the cycle with holding torque at rest, and with the brake closed at rest [N m]
    braked_rms_torque: float
    top_speed: float  # of the motor, over the cycle [rad/s]
    mean_speed: float
    rms_speed: float
    peak_power: float  # largest power of the motor [W]
    positive_work: float  # what the motor gives and takes back over a cycle [J]
    negative_work: float
    screw_loss: float  # lost between nut and screw [J]
    heating: float
    """Largest (T / T_c)² of the one-body model in steady state, 1 at the limit; NaN without a time
    constant."""
    inertia_ratio: tuple[float, float]
    """Least and largest inertia of the load at the motor by that of the rotor; NaN where the load's mass
    was not given."""
    best_lead: float
    """Way of the slider a turn of the screw or pulley with which the rms torque would be least, with the
    same turning parts and no losses [m]; NaN where the slider does not move."""
    ratings: tuple[Rating, ...]  # how much of each rating is used
    heat_share: float = 1.0  # what heat and height leave of the motor's continuous torque at standstill
    nut: NutLife | None = None  # of a screw whose dynamic rating is known

    @property
    def worst(self) -> Rating:
        """The rating that is exceeded most, or else is used most."""
        return max(self.ratings, key=_by_need)

    @property
    def fits(self) -> bool:
        """Whether all ratings keep their margins."""
        return self.worst.verdict == VERDICTS[0]


RATING_COLUMNS = {
    "rating": "name", "unit": "unit", "required": "required", "allowed": "allowed", "used": "share",
    "margin": "margin", "verdict": "verdict", "t [s]": "time",
}  # fmt: skip
"""What the columns of ratings are called, and their attributes."""


@dataclass(frozen=True, eq=False)
class Sizing(Tabular):
    """A drive on each axis, and what a cycle takes of it."""

    _row_name = "rating"

    drives: tuple[Drive, Drive, Drive]  # of A, B, C
    axes: tuple[AxisLoads, AxisLoads, AxisLoads]  # what the cycle takes of each
    bus_positive_work: float  # what the three give and take back over a cycle on a common bus [J]
    bus_negative_work: float
    bus_peak_power: float  # largest power on it, and back from it [W]
    bus_peak_braking: float
    supply: SupplyLoads | None = None  # of the supply, if there is one
    others: tuple[tuple[str, Rating], ...] = ()  # ratings of more than a cycle and an axis: whose, and which
    margins: Margins = field(default_factory=Margins)  # what of each rating must stay free

    def to_columns(self) -> Columns:
        """Return every rating with its part, and what is required and allowed; one a row, the worst first."""
        parts, ratings = zip(*self._by_need(), strict=True)
        return {"part": np.array(parts), **columns_of_items(ratings, RATING_COLUMNS)}

    def __repr__(self) -> str:
        leg, rating = self.worst
        return f"Sizing({self.name}: {self.verdict}, {rating.name} of {leg} {rating.share:.0%})"

    @property
    def name(self) -> str:
        """That of the drive, or those of the drives of A, B and C."""
        names = [drive.name for drive in self.drives]
        pairs = zip(LEGS, names, strict=True)
        return names[0] if len(set(names)) == 1 else ", ".join(f"{leg}: {name}" for leg, name in pairs)

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`, the worst of all ratings."""
        return self.worst[1].verdict

    @property
    def fits(self) -> bool:
        """Whether all ratings of all axes keep their margins."""
        return self.verdict == VERDICTS[0]

    @property
    def worst(self) -> tuple[str, Rating]:
        """The axis and the rating that is exceeded most, or else is used most."""
        return self._by_need()[0]

    @property
    def exceeded(self) -> tuple[tuple[str, Rating], ...]:
        """Axes and ratings that are exceeded, the farthest first."""
        return tuple(one for one in self._by_need() if one[1].verdict == VERDICTS[2])

    @property
    def without_reserve(self) -> tuple[tuple[str, Rating], ...]:
        """Axes and ratings that are kept without their margins, those that are used most first."""
        return tuple(one for one in self._by_need() if one[1].verdict == VERDICTS[1])

    @property
    def assumed(self) -> tuple[str, ...]:
        """Which defaults stand for numbers that the catalogue does not have, in words."""
        return tuple(dict.fromkeys(one.assumed for _, one in self._by_need() if one.assumed))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is within the ratings, and yet worth knowing."""
        high = {
            leg: axis.inertia_ratio[1]
            for leg, axis in zip(LEGS, self.axes, strict=True)
            if axis.inertia_ratio[1] > REMARKED_RATIO
        }
        if not high:
            return ()
        words = ", ".join(f"{leg} {value:.3g}" for leg, value in high.items())
        return (
            f"load by rotor inertia above {REMARKED_RATIO:g} ({words}, without the screw): usual in "
            "handling, high for machine tools",
        )

    def _by_need(self) -> list[tuple[str, Rating]]:
        pairs = zip(LEGS, self.axes, strict=True)
        each = [*((leg, rating) for leg, axis in pairs for rating in axis.ratings), *self.others]
        return sorted(each, key=lambda one: _by_need(one[1]), reverse=True)


def size_of(
    cycle: Cycle,
    drives: Drive | Sequence[Drive],
    *,
    held: FloatArray | None = None,
    held_time: FloatArray | None = None,
    load_mass: FloatArray | None = None,
    brake_safety: float = BRAKE_SAFETY,
    margins: Margins | None = None,
    ambient: Ambient | None = None,
    life: RequiredLife | str | None = None,
) -> Sizing:
    """Return what a cycle takes of drives.

    `held`: largest forces that brakes must hold, over the poses of the task, without friction [N]; those at
    rest in the cycle without it. `life`: what nuts have to live, such as ``"20000 h"``.
    """
    reserves, place = margins or Margins(), ambient or Ambient()
    require("margins", reserves, Margins, DriveError)
    require("ambient", place, Ambient, DriveError)
    require("cycle", cycle, Cycle, DriveError)
    chosen = (drives,) * 3 if isinstance(drives, Drive) else tuple(drives)
    if len(chosen) != 3 or not all(isinstance(drive, Drive) for drive in chosen):
        raise DriveError("drives: expected one Drive, or those of A, B and C")
    safety, needed = above_zero("brake_safety", brake_safety), required_life(life)
    still = np.abs(cycle.holding) if held is None else np.abs(frozen_array("held", held, (3,), DriveError))
    unknown: FloatArray = np.full((2, 3), np.nan)
    when = unknown[0] if held_time is None else frozen_array("held_time", held_time, (3,), DriveError)
    mass = unknown if load_mass is None else frozen_array("load_mass", load_mass, (2, 3), DriveError)
    axes, powers = [], []
    for leg, drive in enumerate(chosen):
        columns = cycle.force[:, leg], cycle.speed[:, leg], cycle.acceleration[:, leg]
        axis = _Axis(cycle, drive, *columns, float(cycle.holding[leg]), drive.motor.heat_share(place))
        brake = Rating(
            "brake",
            safety * float(still[leg]) / drive.ratio,
            drive.motor.brake_torque,
            "N m",
            float(when[leg]),
        )
        axes.append(axis.loads(brake, (float(mass[0, leg]), float(mass[1, leg])), reserves, needed))
        powers.append(axis.power)
    bus = np.sum(powers, axis=0)
    given, back = (float(np.trapezoid(part, cycle.time)) for part in (np.maximum(bus, 0), np.minimum(bus, 0)))
    return Sizing(
        (chosen[0], chosen[1], chosen[2]),
        (axes[0], axes[1], axes[2]),
        given,
        back,
        float(bus.max()),
        float(bus.min()),
        margins=reserves,
    )


class _Axis:
    """The motor of one axis over a cycle."""

    def __init__(
        self,
        cycle: Cycle,
        drive: Drive,
        force: FloatArray,
        speed: FloatArray,
        acceleration: FloatArray,
        holding: float,
        heat_share: float,
    ) -> None:
        self._heat_share = heat_share
        self._cycle, self._drive, self._force, self._speed = cycle, drive, force, speed
        self._acceleration = acceleration
        self._time = cycle.time
        self._step = np.diff(cycle.time)
        self._torque = drive.torque(force, speed, acceleration)
        self._own = drive.reflected_mass / drive.ratio * acceleration
        self._turning = drive.ratio * speed
        self._screw_torque = drive.screw_torque(force, speed, acceleration)
        self._holding = holding / drive.ratio
        self.power = self._torque * self._turning

    def loads(
        self, brake: Rating, mass: tuple[float, float], margins: Margins, life: RequiredLife | None = None
    ) -> AxisLoads:
        """Return what the cycle takes, given what brake and nut must do, and the least and largest load."""
        drive, motor = self._drive, self._drive.motor
        top = int(np.argmax(np.abs(self._torque)))
        own = motor.inertia * drive.ratio**2
        ratio = [m / own if own else m * math.inf for m in mass]
        constant = motor.time_constant
        heating, hottest = (math.nan, math.nan) if constant is None else self._heating(constant)
        rms_speed = self._mean_square(self._turning, 0.0) ** 0.5
        rms = self._mean_square(self._torque, self._holding) ** 0.5
        slow = drive.transmission
        bare = self._force / slow.ratio
        loss = (passed(self._force * self._speed, bare, slow) - bare) * slow.ratio * self._speed
        nut = self._nut()
        return AxisLoads(
            peak_torque=float(self._torque[top]),
            peak_time=float(self._time[top]),
            peak_inertia_share=float(self._own[top] / self._torque[top]) if self._torque[top] else math.nan,
            rms_torque=rms,
            braked_rms_torque=self._braked() ** 0.5,
            top_speed=float(np.abs(self._turning).max()),
            mean_speed=float(np.trapezoid(np.abs(self._turning), self._time)) / self._cycle.duration,
            rms_speed=rms_speed,
            peak_power=float(self.power.max()),
            positive_work=float(np.trapezoid(np.maximum(self.power, 0), self._time)),
            negative_work=float(np.trapezoid(np.minimum(self.power, 0), self._time)),
            screw_loss=float(np.trapezoid(loss, self._time)),
            heating=heating,
            inertia_ratio=(ratio[0], ratio[1]),
            best_lead=self._best_lead(),
            ratings=tuple(
                replace(rating, margin=margins.of(rating.name))
                for rating in (
                    *self._ratings(rms, rms_speed),
                    *([brake] if motor.brake_torque > 0 else []),
                    *self._of_motor(heating, hottest, ratio),
                    *self._of_amplifier(rms),
                    *self._of_transmission(),
                    *self._of_teeth_and_nuts(nut, life),
                )
            ),
            heat_share=self._heat_share,
            nut=nut,
        )

    def _nut(self) -> NutLife | None:
        """Return the life of the nut, if its rating is known."""
        slow = self._drive.transmission
        if not isinstance(slow, Screw) or slow.dynamic is None:
            return None
        turning = slow.ratio * self._speed
        cycle = self._cycle.duration
        return nut_life(self._time, self._force, turning, cycle, slow.dynamic, slow.preload_force)

    def _of_teeth_and_nuts(self, nut: NutLife | None, life: RequiredLife | None) -> list[Rating]:
        """Return what the force on the slider uses of nut, belt or rack, and whether the nut lives."""
        slow = self._drive.transmission
        found = _of_teeth(slow, *self._hardest)
        if isinstance(slow, Screw) and life is not None and nut is not None:
            hours = life.hours_of(self._cycle.duration, nut.turns * slow.lead)
            told = "" if slow.preload is not None else f"preload {USUAL_PRELOAD:.0%} of the dynamic rating"
            if not math.isnan(hours):
                found.append(Rating("life", hours, nut.hours, "h", assumed=told))
        return found

    @property
    def _hardest(self) -> tuple[float, float]:
        """Largest force on the slider [N], and when [s]."""
        at = int(np.argmax(np.abs(self._force)))
        return float(np.abs(self._force[at])), float(self._time[at])

    def _best_lead(self) -> float:
        """Return the way a turn with the least mean square of f / i + J i λ̈: i⁴ = <f²> / (J² <λ̈²>)."""
        drive = self._drive
        inertia = drive.reflected_mass / drive.ratio**2
        forces = self._mean_square(self._force, self._holding * drive.ratio)
        inertial = inertia**2 * self._mean_square(self._acceleration, 0.0)
        if inertial == 0 or forces == 0:
            return math.nan
        return float(2 * math.pi * drive.gear.ratio / (forces / inertial) ** 0.25)

    def _mean_square(self, values: FloatArray, resting: float) -> float:
        """Return the mean of the square over the cycle, given the value at rest after it."""
        squares = float(np.trapezoid(values**2, self._time)) + resting**2 * self._cycle.rest
        return squares / self._cycle.duration

    def _braked(self) -> float:
        """Return the mean square of the torque with the brake closed at rest."""
        squares = self._torque**2
        steps = self._step * (1 - self._cycle.resting)
        return float(steps @ (squares[1:] + squares[:-1]) / 2) / self._cycle.duration

    def _heating(self, constant: float) -> tuple[float, float]:
        """Return the largest heating in steady state, and when; NaN in the rest after the cycle."""
        allowed = self._continuous(self._turning)
        with np.errstate(divide="ignore"):
            loads = (self._torque / allowed) ** 2
        if not np.isfinite(loads).all():
            return math.inf, float(self._time[int(np.argmax(loads))])
        still = float(self._drive.motor.continuous(np.zeros(1), self._heat_share)[0])
        means = np.append((loads[1:] + loads[:-1]) / 2, (self._holding / still) ** 2)
        fade = np.exp(-np.append(self._step, self._cycle.rest) / constant)

        def heated(start: float) -> list[float]:
            found = [start]
            for mean, left in zip(means.tolist(), fade.tolist(), strict=True):
                found.append(found[-1] * left + mean * (1 - left))
            return found

        # Once from zero, which tells where the cycle begins in steady state.
        found = heated(heated(0.0)[-1] / -math.expm1(-self._cycle.duration / constant))
        hottest = int(np.argmax(found))
        return found[hottest], float(np.append(self._time, math.nan)[hottest])

    def _continuous(self, speed: FloatArray) -> FloatArray:
        """Return the continuous torque at speeds, at the fastest where they are above it."""
        motor = self._drive.motor
        return motor.continuous(np.minimum(np.abs(speed), motor.max_speed), self._heat_share)

    def _of_motor(self, heating: float, hottest: float, inertia: list[float]) -> list[Rating]:
        """Return what is used of the motor's heat and of the load's inertia that it may have."""
        motor, found = self._drive.motor, []
        if not math.isnan(heating):
            found.append(Rating("heating", heating, 1.0, "", hottest))
        allowed = INERTIA_RATIO if motor.max_inertia_ratio is None else motor.max_inertia_ratio
        if allowed < math.inf and not math.isnan(inertia[1]):
            assumed = f"load by rotor inertia up to {INERTIA_RATIO:g} (no max_inertia_ratio of {motor.name})"
            told = assumed if motor.max_inertia_ratio is None else ""
            found.append(Rating("inertia ratio", inertia[1], allowed, "", assumed=told))
        return found

    def _of_amplifier(self, rms: float) -> list[Rating]:
        """Return what is used of the amplifier's currents and power."""
        motor, amplifier = self._drive.motor, self._drive.motor.amplifier
        if amplifier is None or motor.torque_constant is None:
            return []
        current = np.abs(self._torque) / motor.torque_constant
        most = int(np.argmax(current))
        found = [
            Rating("rms current", rms / motor.torque_constant, amplifier.rated_current, "A"),
            Rating("peak current", float(current[most]), amplifier.max_current, "A", float(self._time[most])),
        ]
        if amplifier.max_current_time < math.inf:
            rest = abs(self._holding) / motor.torque_constant
            longest, when = self._longest_above(current, rest, amplifier.rated_current)
            found.append(Rating("time above rated current", longest, amplifier.max_current_time, "s", when))
        if amplifier.max_power < math.inf:
            power = self.power + motor.copper_loss(self._torque)
            most = int(np.argmax(power))
            values = max(float(power[most]), 0.0), amplifier.max_power
            found.append(Rating("amplifier power", *values, "W", float(self._time[most])))
        return found

    def _longest_above(self, values: FloatArray, resting: float, limit: float) -> tuple[float, float]:
        """Return the longest stretch above a limit, over the ends of the cycle too, and when it begins."""
        time, rest = self._time, self._cycle.rest
        if rest > 0:
            values = np.append(values, [resting, resting])
            time = np.append(time, [time[-1], time[-1] + rest])
        total, over = float(time[-1] - time[0]), values - limit
        if (over > 0).all():
            return math.inf, math.nan
        ends, heights = np.append(time, time + total).tolist(), np.append(over, over).tolist()
        longest, when, start = 0.0, math.nan, math.nan
        for a, b, low, high in zip(ends, ends[1:], heights, heights[1:], strict=False):
            if low > 0 or high > 0:
                passed = a if high == low else a + (b - a) * low / (low - high)  # where it is at the limit
                start = passed if low <= 0 else (a if math.isnan(start) else start)
                stretch = (b if high > 0 else passed) - start
                if stretch > longest:
                    longest, when = stretch, start
            if high <= 0:
                start = math.nan
        return longest, when - total if when > ends[len(time) - 1] else when

    def _ratings(self, rms: float, rms_speed: float) -> list[Rating]:
        motor, gear = self._drive.motor, self._drive.gear
        found = [
            *self._peak_torque(),
            Rating("rms torque", rms, float(self._continuous(np.array([rms_speed]))[0]), "N m"),
            *_of_motor_and_gear(self._drive, *self._fastest),
        ]
        for name, power, limit in (
            ("power", self.power, motor.max_power),
            ("regeneration", -self.power, motor.max_braking_power),
        ):
            if limit < math.inf:
                most = int(np.argmax(power))
                found.append(Rating(name, max(float(power[most]), 0.0), limit, "W", float(self._time[most])))
        if gear.max_torque < math.inf:
            most = int(np.argmax(np.abs(self._screw_torque)))
            torque = float(np.abs(self._screw_torque[most]))
            found.append(Rating("gear torque", torque, gear.max_torque, "N m", float(self._time[most])))
        return found

    @property
    def _fastest(self) -> tuple[float, float]:
        """Largest speed of the motor [rpm], and when [s]."""
        at = int(np.argmax(np.abs(self._turning)))
        return RPM * float(np.abs(self._turning[at])), float(self._time[at])

    def _of_transmission(self) -> list[Rating]:
        """Return what is used of a screw or belt: each of its speeds by itself, and buckling."""
        return [
            *_of_turning(self._drive, *self._fastest),
            *_of_buckling(self._drive.transmission, *self._hardest),
        ]

    def _peak_torque(self) -> list[Rating]:
        """Return what is used of the peak torque where the motor is not too fast; nothing if it always is."""
        motor = self._drive.motor
        rows = np.flatnonzero(~motor.too_fast(self._turning))
        if not len(rows):
            return []
        torque, allowed = np.abs(self._torque[rows]), motor.peak(self._turning[rows])
        with np.errstate(divide="ignore", invalid="ignore"):
            worst = int(np.argmax(np.where(torque == 0, 0.0, torque / allowed)))
        time = float(self._time[rows[worst]])
        return [Rating("peak torque", float(torque[worst]), float(allowed[worst]), "N m", time)]


def speed_ratings(drive: Drive, speed: float, when: float = math.nan) -> list[Rating]:
    """Return what a speed of the motor [rpm] uses of every part of a drive."""
    return [*_of_motor_and_gear(drive, speed, when), *_of_turning(drive, speed, when)]


def force_ratings(drive: Drive, force: float, when: float = math.nan) -> list[Rating]:
    """Return what a force on the slider [N] uses of nut, screw, belt or rack."""
    slow = drive.transmission
    return [*_of_teeth(slow, force, when), *_of_buckling(slow, force, when)]


def _of_motor_and_gear(drive: Drive, speed: float, when: float) -> list[Rating]:
    """Return what is used of the speeds of motor and gear."""
    found = [Rating("speed", speed, RPM * drive.motor.max_speed, "rpm", when)]
    if drive.gear.max_speed < math.inf:
        found.append(Rating("gear speed", speed, RPM * drive.gear.max_speed, "rpm", when))
    return found


def _of_turning(drive: Drive, speed: float, when: float) -> list[Rating]:
    """Return what a speed of the motor uses of screw, belt or rack."""
    slow, turns, found = drive.transmission, speed / drive.gear.ratio, []
    if isinstance(slow, Screw):
        found += _of_nut(slow, turns, when)
    elif slow.max_speed < math.inf:
        name = "rack speed" if isinstance(slow, Rack) else "belt speed"
        found.append(Rating(name, turns, RPM * slow.max_speed, "rpm", when))
    if slow.critical_speed < math.inf:
        found.append(Rating("critical speed", turns, RPM * WHIRL * slow.critical_speed, "rpm", when))
    return found


def _of_buckling(slow: Screw | Belt, force: float, when: float) -> list[Rating]:
    if slow.buckling_force == math.inf:
        return []
    return [Rating("buckling", force, BUCKLING * slow.buckling_force, "N", when)]


def _of_teeth(slow: Screw | Belt, force: float, when: float) -> list[Rating]:
    """Return what a force uses of nut, belt or rack."""
    found, safety, told = [], slow.static_safety, ""
    if isinstance(slow, Screw):
        if slow.static is not None:
            told = f"static safety {STATIC_SAFETY:g}, without impact" if safety is None else ""
            found.append(Rating("static load", force, slow.static_limit, "N", when, assumed=told))
        return found
    if slow.max_force < math.inf:
        rack = isinstance(slow, Rack)
        if safety is None:
            safety = RACK_SAFETY if rack else 1.0
            told = f"static safety {safety:g}"
        name = "rack force" if rack else "belt force"
        found.append(Rating(name, force, slow.max_force / safety, "N", when, assumed=told))
    if slow.pretension > 0:
        found.append(Rating("pretension", force, slow.pretension, "N", when))
    if slow.max_tension < math.inf:
        found.append(Rating("belt tension", force + slow.pretension, slow.max_tension, "N", when))
    return found


def _of_nut(screw: Screw, turns: float, when: float) -> list[Rating]:
    """Return what is used of the speed of a nut [rpm]: of its own limit, or by DN and what is assumed."""
    found = []
    if screw.max_speed is not None:
        if screw.max_speed < math.inf:
            found.append(Rating("nut speed", turns, RPM * screw.max_speed, "rpm", when))
    else:
        limit = RPM * TURNS_OF_NUTS
        assumed = f"nuts turn up to {limit:,.0f} rpm (no max_speed of {screw.name})"
        found.append(Rating("nut speed", turns, limit, "rpm", when, assumed=assumed))
    nominal, source = screw.sold_diameter
    if not math.isnan(nominal) and (screw.dn is not None or screw.max_speed is None):
        words = [] if screw.dn is not None else [f"DN {SPEED_OF_NUTS:,.0f} (no dn of {screw.name})"]
        assumed = ", ".join((*words, *([source] if source else [])))
        limit = SPEED_OF_NUTS if screw.dn is None else screw.dn
        found.append(Rating("DN", 1e3 * nominal * turns, limit, "mm rpm", when, assumed=assumed))
    return found


def with_supply(sizing: Sizing, cycle: Cycle, supply: Supply) -> Sizing:
    """Return drives with what the cycle takes of their supply, and its ratings among the `others`."""
    for name, value, kind in (
        ("sizing", sizing, Sizing),
        ("cycle", cycle, Cycle),
        ("supply", supply, Supply),
    ):
        require(name, value, kind, DriveError)
    drawn: FloatArray = np.empty_like(cycle.force)
    rest: FloatArray = np.empty(3)
    for leg, drive in enumerate(sizing.drives):
        torque = drive.torque(cycle.force[:, leg], cycle.speed[:, leg], cycle.acceleration[:, leg])
        drawn[:, leg] = torque * drive.ratio * cycle.speed[:, leg] + drive.motor.copper_loss(torque)
        rest[leg] = drive.motor.copper_loss(cycle.holding[leg] / drive.ratio)
    loads = loads_of_supply(supply, cycle.time, drawn, rest, cycle.rest)
    return with_others(replace(sizing, supply=loads), _of_supply(loads, sizing))


def with_others(sizing: Sizing, ratings: Iterable[tuple[str, Rating]]) -> Sizing:
    """Return drives with more ratings, of no axis or of single events, each with its margin."""
    more = ((owner, replace(one, margin=sizing.margins.of(one.name))) for owner, one in ratings)
    return replace(sizing, others=(*sizing.others, *more))


def _of_supply(loads: SupplyLoads, sizing: Sizing) -> list[tuple[str, Rating]]:
    """Return how much of each rating of buses is used, and of what amplifiers bear of their voltage."""
    supply, found = loads.supply, []
    for bus in loads.buses:
        if supply.resistor_power is not None:
            words = "" if supply.duty is not None else f"{DUTY:.0%} of the resistor's rated power in the mean"
            needed, most = bus.mean_power / loads.duty, supply.resistor_power
            found.append((bus.name, Rating("braking resistor power", needed, most, "W", assumed=words)))
        if supply.resistance is not None:
            most = supply.max_voltage**2 / supply.resistance
            found.append((bus.name, Rating("peak braking", bus.peak_power, most, "W", bus.peak_time)))
        if supply.max_feedback_power < math.inf:
            most = supply.max_feedback_power
            found.append((bus.name, Rating("feedback", bus.peak_power, most, "W", bus.peak_time)))
        if not (supply.has_resistor or supply.feedback):
            top = bus.top_voltage - supply.voltage, supply.max_voltage - supply.voltage
            found.append((bus.name, Rating("rise of the voltage", *top, "V", bus.top_time)))
        if supply.max_power < math.inf:
            most = supply.max_power
            found.append((bus.name, Rating("line power", bus.line_power, most, "W", bus.line_time)))
    buses = loads.buses * (3 if supply.common else 1)
    for leg, drive, bus in zip(LEGS, sizing.drives, buses, strict=True):
        amplifier = drive.motor.amplifier
        if amplifier is not None and amplifier.max_voltage < math.inf:
            top = bus.top_voltage - supply.voltage, amplifier.max_voltage - supply.voltage
            found.append((leg, Rating("rise of the bus voltage", *top, "V", bus.top_time)))
    return found
