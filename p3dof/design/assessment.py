"""`Assessment`: whether a machine fits what it has to do, which rating is used most, when and by how much."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from p3dof._base.checks import FloatArray, Progress, not_negative, require, shown
from p3dof._base.errors import InputError
from p3dof._base.tables import (
    NONE,
    Cell,
    Columns,
    Numeral,
    ShownInNotebook,
    Table,
    Tabular,
    columns_of_items,
    html_of,
    notebook_html,
    number,
    percent,
    table_of,
)
from p3dof.analysis.reactions import JOINTS, Reactions, Stiffness
from p3dof.design.bearings import BearingLife, BearingReport, Bearings, bearing_life
from p3dof.design.clearance import Clearance
from p3dof.design.drives import (
    VERDICTS,
    Ambient,
    Catalogue,
    Cycle,
    Drive,
    Margins,
    RequiredLife,
    Sizing,
    StopLoads,
    caveats,
    cycle_of,
    not_checked,
    required_life,
)
from p3dof.design.drives.margins import verdict_of
from p3dof.design.drives.sizing import BRAKE_SAFETY, BUCKLING, RATING_COLUMNS, RPM, WHIRL
from p3dof.design.drives.tables import FALLS
from p3dof.design.fastest import unseen_limits, uses_of_task
from p3dof.design.forces_of_tasks import (
    USUAL_FRICTION,
    TaskForces,
    joined,
    reactions_under,
    with_guide_friction,
)
from p3dof.design.sizing import size_drives, stopped_safely
from p3dof.design.tasks import AxisLimits, FastestPlan
from p3dof.machine.parameters import LEGS
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics
from p3dof.methods.utilisation import Utilisation, utilisations

_TOLD = 4  # exceeded ratings that are told in words; the tables have all
_WHOLE = "over the cycle"
_SOME = 0.005  # least reserve that is told as a number
_FITS = 1 + 1e-9  # shares up to this one are within a limit: the fastest motion uses all of it


@dataclass(frozen=True)
class RatingUse:
    """How much of one rating is used, by which part, when and where.

    Parameters
    ----------
    kind : str
        What has the rating: ``"machine"``, ``"task"``, ``"drive"``, ``"bearing"``, ``"guide"``, ``"rod"`` or
        ``"clearance"``.
    name : str
        The rating, such as ``"peak torque"``.
    part : str
        Whose: ``"A"``, ``"platform"``, ``"hinge_a"``, ``"leg_a"``, ...
    required, allowed : float
        What the cycle takes, and what there is [`unit`].
    unit : str
        Of both.
    time : float
        When most of it is used [s]; NaN for what belongs to the whole cycle.
    place : str
        The piece of the way, from waypoint to waypoint; empty for a motion without waypoints.
    margin : float
        Share of `allowed` that must stay free.
    assumed : str
        Which default stands for a number that nobody gave, in words.
    """

    kind: str
    name: str
    part: str
    required: float
    allowed: float
    unit: str
    time: float
    place: str
    margin: float = 0.0
    assumed: str = ""

    @property
    def verdict(self) -> str:
        """One of `p3dof.design.drives.VERDICTS`."""
        return VERDICTS[verdict_of(self.share, self.margin, _FITS - 1)]

    @property
    def share(self) -> float:
        """Required by allowed: 1 at the rating."""
        if self.allowed != 0:
            return self.required / self.allowed
        return math.inf if self.required > 0 else 0.0

    @property
    def amounts(self) -> str:
        """What is required of what is allowed, in words."""
        if self.required == math.inf:
            return FALLS
        if self.share == math.inf:
            return f"{short(self.required)} {self.unit} where none is permissible"
        required, allowed = self.figures
        return f"{required} of {allowed} {self.unit}".strip()

    @property
    def figures(self) -> tuple[str, str]:
        """What is required and what is allowed, with digits enough to see what is exceeded."""
        above = self.share - 1
        digits = 4 if not _FITS - 1 < above < 1e-3 else min(2 + math.ceil(-math.log10(above)), 12)
        return short(self.required, digits), short(self.allowed, digits)

    @property
    def when(self) -> str:
        """Time and place in words."""
        if math.isnan(self.time):
            return _WHOLE
        return f"at t = {self.time:.4g} s" + (f", {self.place}" if self.place else "")


@dataclass(frozen=True, eq=False)
class Assessment(ShownInNotebook, Tabular):
    """A machine and what it has to do: whether it fits, by all ratings that are known.

    Parameters
    ----------
    name : str
        What it is called beside others.
    robot : Manipulator
        The machine.
    found : InverseDynamics or TaskForces
        Its forces over a motion or a task.
    rest : float
        How long it rests after each cycle [s].
    ranked : tuple of Sizing
        Drives, the best first; none without a catalogue.
    reactions : Reactions or None
        Of all joints, with elastic ones; None if nobody asked for them.
    bearings : BearingReport or None
        Lives and safeties of bearings, guides and rods; None without their ratings.
    stiffness : Stiffness or None
        What the reactions rest on; None for guesses.
    limits : AxisLimits or None
        What the task allows, besides the limits of the machine.
    ambient : Ambient
        Where its motors work.
    clearance : Clearance or None
        How near parts come to each other; None if nobody asked.
    stops : tuple of StopLoads
        Emergency stops with the first of the drives; none if nobody asked for them.
    assumed : tuple of str
        What stands in where nothing was given, besides what ratings tell.
    """

    _row_name = "rating"

    name: str
    robot: Manipulator
    found: InverseDynamics | TaskForces
    rest: float = 0.0
    ranked: tuple[Sizing, ...] = ()
    reactions: Reactions | None = None
    bearings: BearingReport | None = None
    stiffness: Stiffness | None = None
    limits: AxisLimits | None = None
    ambient: Ambient = field(default_factory=Ambient)
    clearance: Clearance | None = None
    stops: tuple[StopLoads, ...] = ()
    assumed: tuple[str, ...] = ()

    def to_columns(self) -> Columns:
        """Return every rating with what is required and allowed, by name; one a row, the worst first."""
        return columns_of_items(
            self.ratings, {"kind": "kind", "part": "part", **RATING_COLUMNS, "place": "place"}
        )

    def __repr__(self) -> str:
        return f"Assessment({self.name}: {self.verdict})"

    @property
    def drives(self) -> Sizing | None:
        """The drives that were chosen: the first of the ranking."""
        return self.ranked[0] if self.ranked else None

    @cached_property
    def cycle(self) -> Cycle:
        """Forces at the nuts, without the machine's armature, and motion of the sliders over a cycle."""
        return cycle_of(self.found, self.rest)

    @property
    def cycle_time(self) -> float:
        """Of a whole cycle, with its rest [s]."""
        return float(self.found.time[-1] - self.found.time[0]) + self.rest

    def place(self, time: float) -> str:
        """Return the piece of the way at a time; empty for a motion without waypoints."""
        if math.isnan(time) or not isinstance(self.found, TaskForces):
            return ""
        return self.found.piece_at(time).name

    @cached_property
    def ratings(self) -> tuple[RatingUse, ...]:
        """All ratings that are known: those that are exceeded, then those that are used most first."""
        found = [*self._of_machine(), *self._of_task(), *self._of_drives(), *self._of_bearings()]
        found += [] if self.clearance is None else of_clearance(self.clearance)
        return tuple(sorted(found, key=lambda one: (-VERDICTS.index(one.verdict), -round(one.share, 9))))

    @property
    def worst(self) -> RatingUse:
        """The rating that is exceeded most, or else is used most."""
        return self.ratings[0]

    @property
    def fits(self) -> bool:
        """Whether all ratings keep their margins."""
        return self.worst.verdict == VERDICTS[0]

    @property
    def verdict(self) -> str:
        """Whether it fits, with which reserve, and which rating is the worst, when, in one sentence."""
        return f"{self.answer}{'; the least is ' if self.fits else ': '}{self.reason}"

    @property
    def answer(self) -> str:
        """Whether it fits, and with which reserve: one of `p3dof.design.drives.VERDICTS`, with a number."""
        told, left = self.worst.verdict, 1 - self.worst.share
        if not self.fits:
            return told
        return f"{told} with {left:.0%} reserve" if left >= _SOME else f"{told}, just"

    @property
    def reason(self) -> str:
        """Which rating is worst, when and by how much."""
        one = self.worst
        words = f"{one.name} of {one.part}"
        if self.fits:
            return f"{words}, {one.amounts} {one.when}"
        if one.share == math.inf:
            much = f"{'has' if one.required == math.inf else 'takes'} {one.amounts}"
        else:
            much = f"has a utilisation of {percent(one.share, 0)}, {one.amounts}"
        keeps = f"; {1 - one.margin:.0%} keep the margin"
        return f"{words} {much} {one.when}{keeps if one.verdict == VERDICTS[1] else _beyond(one.share)}"

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What to know before the numbers are used, the most important first."""
        above = [one for one in self.ratings if one.verdict == VERDICTS[2]]
        told = [f"{one.name} of {one.part}: {one.amounts}, {one.when}" for one in above[:_TOLD]]
        if len(above) > _TOLD:
            told.append(f"{len(above) - _TOLD} more ratings are exceeded")
        scarce = [one for one in self.ratings if one.verdict == VERDICTS[1]]
        if scarce:
            words = ", ".join(f"{one.name} of {one.part} {percent(one.share, 0)}" for one in scarce[:_TOLD])
            more = f" and {len(scarce) - _TOLD} more" if len(scarce) > _TOLD else ""
            told.append(f"without reserve: {words}{more}")
        if isinstance(self.found, TaskForces):
            first, last = self.found.plan.motion.pose[[0, -1]]
            if np.abs(first - last).max() > 1e-12:
                told.append("the last pose of the task is not its first: it cannot be repeated")
        else:
            told += [words for words in self.found.warnings if "limit" not in words or not told]
        if self.limits is not None and self._fastest is None:
            unseen = unseen_limits(self.limits)
            told += [unseen] if unseen else []
        if self.drives is not None:
            told += [*caveats(self.drives), *_of_brakes(self.drives), *_of_preloads(self.drives)]
            told += self.ambient.warnings
        return (*told, *(() if self.bearings is None else self.bearings.warnings))

    @cached_property
    def unchecked(self) -> tuple[str, ...]:
        """What the verdict says nothing about, as nobody gave numbers for it or nothing computes it."""
        if self.drives is None:
            told = ["motors, gears, screws and belts (no drives were given)"]
        else:
            told = list(not_checked(self.drives))
        if self.clearance is None:
            told.append("collisions (no clearance was asked for)")
        return (*told, *_of_parts(self.bearings), *frictionless(self.robot, self.found))

    @cached_property
    def slider_energy(self) -> tuple[float, float]:
        """Work that the sliders take and give back over a cycle, together and without losses [J]."""
        power = (self.found.forces * self.found.slider_velocities).sum(axis=1)
        return _works(power, self.found.time)

    @cached_property
    def motor_forces(self) -> FloatArray:
        """Torques of the motors as forces at the sliders, with inertia and losses of drives, (N, 3) [N].

        Those of the actuators where there are no drives, with the machine's armature.
        """
        if self.drives is None:
            return self.found.forces
        cycle = self.cycle
        columns = [
            drive.ratio * drive.torque(cycle.force[:, k], cycle.speed[:, k], cycle.acceleration[:, k])
            for k, drive in enumerate(self.drives.drives)
        ]
        return np.column_stack(columns)

    def _of_machine(self) -> list[RatingUse]:
        limits = self.robot.parameters.limits
        if isinstance(self.found, TaskForces):
            uses = self.found.utilisations(limits)
        else:
            result = self.found
            columns = {"force": result.forces, "speed": result.slider_velocities, "travel": result.sliders}
            uses = utilisations(result.time, columns | {"tilt": result.motion.pose[:, 2:]}, limits)
        return [self._limit(use) for use in uses if not math.isnan(use.share)]

    def _limit(self, use: Utilisation) -> RatingUse:
        values = use.value, use.limit, use.unit, use.time
        return RatingUse("machine", use.quantity, use.leg, *values, self.place(use.time))

    @property
    def _fastest(self) -> FastestPlan | None:
        """The plan, if it is that of a fastest motion."""
        plan = self.found.plan if isinstance(self.found, TaskForces) else None
        return plan if isinstance(plan, FastestPlan) else None

    def _of_task(self) -> list[RatingUse]:
        """Return what is used of the limits of the task: densely of the fastest motion, else by samples."""
        uses = uses_of_task(self.found, self.limits, self.robot.parameters.limits)
        return [
            RatingUse("task", use.quantity, use.leg, use.value, use.limit, use.unit, use.time, use.way)
            for use in uses
        ]

    def _of_drives(self) -> list[RatingUse]:
        if self.drives is None:
            return []
        axes = zip(LEGS, self.drives.axes, strict=True)
        owned = [*((leg, one) for leg, axis in axes for one in axis.ratings), *self.drives.others]
        return [
            RatingUse(
                "drive",
                one.name,
                owner,
                one.required,
                one.allowed,
                one.unit,
                one.time,
                self.place(one.time),
                one.margin,
                one.assumed,
            )
            for owner, one in owned
        ]

    def _of_bearings(self) -> list[RatingUse]:
        if self.bearings is None:
            return []
        report, found = self.bearings, list[RatingUse]()
        for one in report.parts:
            kind, part = ("bearing", one.bearing) if isinstance(one, BearingLife) else ("guide", one.guide)
            if part.static is not None:
                allowed, when = part.static / part.static_safety, one.static_time
                use = ("static load", one.joint, one.static_load, allowed, "N", when, self.place(when))
                found.append(RatingUse(kind, *use))
            if not math.isnan(one.required):
                found.append(RatingUse(kind, "life", one.joint, one.required, one.hours, "h", math.nan, ""))
        for rod in report.rods:
            values = (
                rod.compression,
                rod.buckling,
                "N",
                rod.compression_time,
                self.place(rod.compression_time),
            )
            found.append(RatingUse("rod", "buckling", rod.rod, *values))
        return found


def assess(
    robot: Manipulator,
    found: InverseDynamics | TaskForces,
    *,
    drives: Drive | Sequence[Drive] | Iterable[Drive] | None = None,
    bearings: Bearings | None = None,
    stiffness: Stiffness | None = None,
    limits: AxisLimits | None = None,
    rest: float = 0.0,
    brake_safety: float = BRAKE_SAFETY,
    margins: Margins | None = None,
    ambient: Ambient | None = None,
    per_axis: bool = False,
    stops: bool = False,
    life: RequiredLife | str | None = None,
    frictionless: bool = False,
    name: str = "",
    clearance: Clearance | None = None,
    progress: Progress | None = None,
) -> Assessment:
    """Return whether a machine fits what it has to do, by its limits and by the ratings of its parts.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    found : InverseDynamics or TaskForces
        Its forces over a motion, or over a task (`forces_of_task`).
    drives : Drive or iterable of Drive, optional
        What to choose from, such as a `p3dof.design.drives.Catalogue`; see `size_drives`.
    bearings : Bearings, optional
        Ratings of bearings and guides.
    stiffness : Stiffness, optional
        How joints and rods give way, for the loads of joints; guesses without it. It asks for these loads
        even without `bearings`.
    limits : AxisLimits, optional
        What the task allows, besides the limits of the machine; the fastest motion has its own.
    rest : float
        How long the machine rests after each cycle [s].
    brake_safety : float
        How much more a brake must hold than what it bears.
    margins, ambient : Margins and Ambient, optional
        What of each rating of drives must stay free, and where motors work; see `size_drives`.
    per_axis : bool
        Whether the axes may have different drives.
    stops : bool
        Whether emergency stops with the best of the drives count too, with the `stop` of a catalogue.
    life : RequiredLife or str, optional
        What ball nuts, bearings and guides have to live, such as ``"20000 h"``; what their files say
        without it.
    frictionless : bool
        Leave the forces as they are; else drives are sized with friction of guides, see `size_drives`.
    name : str
        What the assessment is called; the name of the task without one.
    clearance : Clearance, optional
        How near parts come to each other over it, from `clearance_of`: the distance required is a rating.
    progress : callable, optional
        Called with (done, total) drives.

    Raises
    ------
    SampleError
        If the machine cannot perform the motion.
    DriveError, InputError
        If an argument does not fit.
    """
    require("robot", robot, Manipulator)
    if not isinstance(found, InverseDynamics | TaskForces):
        raise InputError(f"found: expected forces over a motion or a task, got {shown(found)}")
    if not isinstance(name, str):
        raise InputError(f"name: expected a text, got {shown(name)}")
    if not isinstance(limits, AxisLimits | None):
        raise InputError(f"limits: expected AxisLimits, got {shown(limits)}")
    if not isinstance(clearance, Clearance | None):
        raise InputError(f"clearance: expected a Clearance, got {shown(clearance)}")
    pause = not_negative("rest", rest)
    cycle_of(found, pause)  # says at once that the machine cannot make it
    needed = required_life(life)
    ranked: list[Sizing] = []
    bare = found
    if drives is not None:
        found = found if frictionless else with_guide_friction(robot, found, bearings, stiffness)
        ranked = size_drives(
            robot,
            found,
            drives,
            rest=pause,
            brake_safety=brake_safety,
            margins=margins,
            ambient=ambient,
            per_axis=per_axis,
            life=needed,
            frictionless=True,
            progress=progress,
        )
    stopped: tuple[StopLoads, ...] = ()
    if stops:
        if not ranked:
            raise InputError("stops: expected drives, which stop the machine")
        ramp = drives.stop if isinstance(drives, Catalogue) else None
        ranked, stopped = stopped_safely(robot, found, ranked, ramp)
    loads = report = None
    if bearings is not None or stiffness is not None:
        loads = _reactions(robot, found, stiffness)
    if loads is not None and bearings is not None:
        about = {"stiffness": stiffness, "rest": pause, "life": needed}
        report = bearing_life(robot.parameters, loads, bearings, **about)  # type: ignore[arg-type]  # by name
    told = name or (found.plan.name if isinstance(found, TaskForces) else "motion") or "task"
    place = ambient or (drives.ambient if isinstance(drives, Catalogue) else Ambient())
    assumed = () if found is bare else (USUAL_FRICTION,)
    parts = loads, report, stiffness, limits, place, clearance, stopped, assumed
    return Assessment(told, robot, found, pause, tuple(ranked), *parts)


def as_result(found: InverseDynamics | TaskForces) -> InverseDynamics:
    """Return forces over a motion or a task as one result."""
    return joined(found) if isinstance(found, TaskForces) else found


def _reactions(
    robot: Manipulator, found: InverseDynamics | TaskForces, stiffness: Stiffness | None
) -> Reactions:
    from p3dof.analysis.reactions.evaluation import of_result

    if isinstance(found, TaskForces):
        return reactions_under(robot, found, stiffness)
    loads = of_result(robot.bare_loop, robot.parameters, found, "elastic", "raise", stiffness)
    return loads.each[0]


def frictionless(robot: Manipulator, found: InverseDynamics | TaskForces) -> tuple[str, ...]:
    """Return that forces have no friction of guides and joints in them, if it is so."""
    results = found.results if isinstance(found, TaskForces) else (found,)
    if robot.parameters.friction or any(result.coulomb is not None for result in results):
        return ()
    return ("friction of guides and joints (none was given: forces are those without)",)


def of_clearance(found: Clearance) -> list[RatingUse]:
    """Return the distance that is required of that of the nearest parts, or by how much they overlap."""
    one = found.least
    if one.distance < 0:
        return [RatingUse("clearance", "overlap", one.names, -one.distance, 0.0, "m", one.time, one.place)]
    if not found.required:
        return []
    values = found.required, one.distance, "m", one.time, one.place
    return [RatingUse("clearance", "required clearance", one.names, *values)]


def _of_parts(report: BearingReport | None) -> list[str]:
    """Return what was not checked of bearings, guides and rods."""
    if report is None:
        return ["bearings, guides and rods (no ratings were given)"]
    rated: dict[str, float | None] = {one.joint: one.bearing.static for one in report.bearings}
    rated |= {one.joint: one.guide.static for one in report.guides}
    bare = [joint.name for joint in JOINTS if joint.name not in rated]
    blank = [joint for joint, static in rated.items() if static is None]
    told = [f"bearings of {', '.join(bare)} (no ratings)"] if bare else []
    told += [f"static load of {', '.join(blank)} (no static rating)"] if blank else []
    told += [] if report.rods else ["legs and rods (their stiffness is none)"]
    lives = [one.required for one in report.parts]
    if not all(map(math.isnan, lives)):
        return told
    return [*told, "whether lives of bearings and guides suffice (no life was required)"]


def _of_brakes(sizing: Sizing) -> list[str]:
    """Return a warning if a motor has no brake: the machine is vertical."""
    if all(drive.motor.brake_torque > 0 for drive in sizing.drives):
        return []
    names = ", ".join(
        dict.fromkeys(drive.motor.name for drive in sizing.drives if not drive.motor.brake_torque)
    )
    return [f"{names}: no brake is given; the machine falls when the power fails"]


def _of_preloads(sizing: Sizing) -> list[str]:
    """Return a warning for nuts whose preload the largest force releases."""
    return [
        f"{leg}: {short(nut.largest)} N at t = {nut.largest_time:.4g} s release the nut, whose preload is "
        f"{short(nut.preload)} N: a third of the largest force is usual"
        for leg, nut in zip(LEGS, (axis.nut for axis in sizing.axes), strict=True)
        if nut is not None and nut.released
    ]


def short(value: float, digits: int = 4) -> str:
    """Return the size of a number in some digits, without an exponent where it has up to six of them."""
    size = abs(value)
    return f"{size:.0f}" if digits < 6 and 1e4 <= size < 1e6 else f"{size:.{digits}g}"


def _beyond(share: float) -> str:
    if share == math.inf:
        return ""
    return f"; {share - 1:.0%} too much" if share >= 1.005 else f"; {100 * (share - 1):.1g}% too much"


def _works(power: FloatArray, time: FloatArray) -> tuple[float, float]:
    given, back = np.maximum(power, 0), np.minimum(power, 0)
    return float(np.trapezoid(given, time)), float(np.trapezoid(back, time))


_LEADS = (5.0, 10.0, 16.0, 20.0, 32.0)  # of screws for which torques of motors are told [mm a turn]


def uses_table(found: Assessment, most: int | None = None) -> Table:
    """Return all ratings that are known, those used most first, with times and places."""
    rows = tuple(_use(one) for one in found.ratings[:most])
    header = ("rating", "of", "required", "rated", "used", "limit", "at t [s]", "segment")
    left = 0 if most is None else len(found.ratings) - most
    note = f"{left} more have a lower utilisation." if left > 0 else ""
    return Table("Utilisation of ratings", header, rows, note)


def _use(one: RatingUse) -> tuple[str, ...]:
    told, sizes = one.figures, (one.required, one.allowed)
    values = (Numeral(f"{told[k]} {one.unit}".strip(), sizes[k]) for k in (0, 1))
    shares = percent(one.share), percent(1 - one.margin, 0)
    return (f"{one.name} of {one.part}", one.kind, *values, *shares, *_when(one.time, one.place))


def _when(time: float, place: str) -> tuple[str, str]:
    return (NONE, "over the cycle") if math.isnan(time) else (number(time), place or NONE)


def loads_table(found: Assessment) -> Table:
    """Return what each slider bears and does over the cycle, with the instant of the largest.

    The force at the nut, which guide and mechanism feel, and that of the motor, which moves its own inertia
    too, are two rows.
    """
    forces, speed = found.cycle.force, found.found.slider_velocities
    power, motor = forces * speed, found.motor_forces
    own = bool(found.robot.parameters.actuators.armature)
    rows: dict[str, list[Cell]] = {"force at the nut, peak [N]": _peak(found, forces)}
    rows["force at the nut, rms [N]"] = [*_rms(found, forces), NONE, NONE]
    if found.drives is not None:
        rows["force of the motor at the slider, peak [N]"] = _peak(found, motor)
        axes = zip(found.drives.axes, found.drives.drives, strict=True)
        rms = [axis.rms_torque * drive.ratio for axis, drive in axes]
        rows["force of the motor at the slider, rms [N]"] = [*rms, NONE, NONE]
    elif own:
        rows["force of the actuator, with armature, peak [N]"] = _peak(found, motor)
        rows["force of the actuator, with armature, rms [N]"] = [*_rms(found, motor), NONE, NONE]
    rows["speed, peak [m/s]"] = _peak(found, speed)
    rows["acceleration, peak [m/s²]"] = _peak(found, found.found.slider_accelerations)
    rows["power at the nut, peak [W]"] = _peak(found, power, np.maximum)
    rows["regenerative power at the nut, peak [W]"] = _peak(found, power, np.minimum)
    if found.drives is not None:
        turning = motor * speed
        rows["power of the motor, peak [W]"] = _peak(found, turning, np.maximum)
        rows["regenerative power of the motor, peak [W]"] = _peak(found, turning, np.minimum)
    header = ("load", *LEGS, "peak at t [s]", "segment")
    note = (
        "The nut's force is what mechanism and guides feel; that of the motor holds the inertia and the "
        "losses of its drive too."
        if found.drives is not None
        else "Without inertia and losses of drives."
    )
    return table_of("Loads of the sliders", header, rows, note)


def _peak(found: Assessment, values: FloatArray, side: np.ufunc = np.abs) -> list[Cell]:
    """Return the largest values of the axes, and when and where the largest of all is."""
    sizes = np.abs(values) if side is np.abs else np.abs(side(values, 0.0))
    row, _ = np.unravel_index(int(sizes.argmax()), sizes.shape)
    time = float(found.found.time[row])
    place = _when(time, found.place(time))
    return [*(number(float(size)) for size in sizes.max(axis=0)), *place]


def _rms(found: Assessment, forces: FloatArray) -> list[float]:
    cycle = found.cycle
    squares = np.trapezoid(forces**2, cycle.time, axis=0) + cycle.rest * np.asarray(cycle.holding) ** 2
    return [float(value) for value in np.sqrt(squares / cycle.duration)]


def needs_table(found: Assessment) -> Table:
    """Return what motors must give behind screws of some leads, without inertia and losses of drives."""
    forces, speed = found.cycle.force, np.abs(found.found.slider_velocities).max(axis=0)
    peak, rms = np.abs(forces).max(axis=0), np.array(_rms(found, forces))
    rows = {}
    for lead in _LEADS:
        turn = lead / 1e3 / (2 * math.pi)
        torques = [
            number(value, form=".4g")
            for pair in zip(peak, rms, strict=True)
            for value in pair * np.array(turn)
        ]
        rows[f"{lead:g} mm"] = [*torques, *(number(RPM * value / turn, form=".0f") for value in speed)]
    header = (
        "lead of the screw",
        *(f"{leg} {what} [N m]" for leg in LEGS for what in ("peak", "rms")),
        *(f"{leg} top [rpm]" for leg in LEGS),
    )
    note = (
        "Without efficiency, and without the inertia of motor and screw, which may take most of the torque: "
        "give a catalogue of drives (--drives) for these."
    )
    return table_of("Required torque and speed of the motors", header, rows, note, "wide")


def assumptions(found: Assessment) -> dict[str, str]:
    """Return what the numbers rest on, by topic; the most important first."""
    parameters = found.robot.parameters
    limits = parameters.limits
    told = {
        "limits": f"force ({limits.force:g} N) holds at the actuator, which is the nut without armature; "
        f"speed ({limits.speed:g} m/s) and travel at the slider; torque, speed and heat of motors at their "
        "shafts, buckling at the nut" + _of_the_task(found),
        "parallelogram": f"half width b = {1e3 * parameters.geometry.b:g} mm: the paper does not give it; it "
        "affects no actuator force, but the loads of rods and bearings",
        "friction": "; ".join(found.assumed) or _friction(found),
        "armature and counterbalance": _actuators(found),
    }
    if found.drives is not None:
        told["drives"] = (
            "efficiency acts on the force at the nut only, in the direction of its power, not on the inertia "
            "of motor and screw; rms torque is compared with the continuous torque at the rms speed, at rest "
            f"the motor holds; screws run to {WHIRL:.0%} of their critical speed and {BUCKLING:.0%} of "
            f"Euler's load; {'the same' if ':' not in found.drives.name else 'another'} drive on each axis"
        )
        told["margins"] = _margins(found.drives)
        told["ambient"] = _ambient(found)
    if found.reactions is not None:
        guess = "estimates" if found.stiffness is None else "as given"
        told["stiffness and assembly errors"] = (
            f"stiffnesses of joints and rods are {guess}; "
            f"bodies are rigid, joints have no backlash; {_fit(found)}"
        )
    if isinstance(found.found, TaskForces):
        told["payloads"] = "picked up when a dwell begins, put down when it ends, rigidly held"
    told["cycle"] = f"{number(found.cycle_time)} s" + (
        f", of which {number(found.rest)} s at rest after the motion" if found.rest else ""
    )
    gravity = ", ".join(f"{value:g}" for value in parameters.gravity)
    told["gravity"] = f"({gravity}) m/s²"
    return told


def _margins(sizing: Sizing) -> str:
    """Return which shares of which ratings must stay free."""
    shares: dict[float, dict[str, None]] = {}
    for axis in sizing.axes:
        for one in axis.ratings:
            shares.setdefault(one.margin, {})[one.name] = None
    told = [f"{percent(share, 0)} of {', '.join(names)}" for share, names in shares.items() if share]
    return f"{'; '.join(told) or 'none'}; brakes, critical speed and buckling have safety factors instead"


def _ambient(found: Assessment) -> str:
    """Return where motors work, and what that leaves of their continuous torque."""
    place, motors = (
        found.ambient,
        {} if found.drives is None else {d.motor: None for d in found.drives.drives},
    )
    shares = ", ".join(f"{motor.name} {motor.heat_share(place):.3g}" for motor in motors)
    where = f"{place.temperature:g} °C, {place.altitude:g} m"
    return (
        f"{where}; share of the continuous torque that is left at standstill: {shares}; no derating of duty"
    )


def _of_the_task(found: Assessment) -> str:
    """Return what the task allows besides the machine, in words."""
    plan = found.found.plan if isinstance(found.found, TaskForces) else None
    fastest = isinstance(plan, FastestPlan)
    limits = plan.limits if isinstance(plan, FastestPlan) else found.limits
    if limits is None:
        return ""
    units = {"force": "N", "speed": "m/s", "power": "W", "jerk": "m/s³", "nut_force": "N"}
    words = []
    for name, unit in units.items():
        values, own = getattr(limits, name), getattr(found.robot.parameters.limits, name, math.inf)
        if (values != own).any():
            each = values[:1] if (values == values[0]).all() else values
            text = ", ".join(f"{value:.6g}" if math.isfinite(value) else "any" for value in each)
            words.append(f"{name.replace('_', ' ')} {text} {unit}")
    if not words:
        return ""
    own = f"; the {'time-optimal motion' if fastest else 'task'} has limits of its own: {', '.join(words)}"
    masses = ", ".join(f"{mass:g}" for mass in limits.reflected_mass)
    return own + (f", with {masses} kg of drives in its force" if limits.reflected_mass.any() else "")


def _friction(found: Assessment) -> str:
    friction = found.robot.parameters.friction
    results = found.found.results if isinstance(found.found, TaskForces) else (found.found,)
    loads = any(result.coulomb is not None for result in results)
    grows = "load-dependent friction of the joints is in forces and reactions"
    if not friction:
        return grows if loads else "none in guides and joints: that of screws is in their efficiency"
    words = {
        "viscous": ", ".join(f"{name} {value:g}" for name, value in friction.viscous.items()),
        "Coulomb": ", ".join(f"{name} {value:g}" for name, value in friction.coulomb.items()),
    }
    told = "; ".join(f"{kind}: {text}" for kind, text in words.items() if text) + " (SI units)"
    return f"{told}; {grows}" if loads else told


def _actuators(found: Assessment) -> str:
    given = found.robot.parameters.actuators
    if not given:
        return "the machine has no counterbalance" + (
            "" if found.drives else ", and its actuators no inertia"
        )
    kinds = {"armature": "kg", "counterbalance": "N", "spring": "N/m", "counterweight": "kg"}
    words = []
    for kind, unit in kinds.items():
        numbers = getattr(given, kind)
        if numbers:
            words.append(
                f"{kind} " + ", ".join(f"{name} {value:g} {unit}" for name, value in numbers.items())
            )
    if found.drives is not None and given.armature:
        words.append("the drives' own inertia replaces the armature")
    return "; ".join(words)


def _fit(found: Assessment) -> str:
    loads = found.reactions
    if loads is None or not loads.fit.any():
        return "no assembly error was given"
    worst = np.nanmax(loads.fit[:, 0, :, 0])
    most = number(worst, form=".3f")
    return f"assembly errors add up to {most} N to a component, which is not in the lives"


@html_of.register(Assessment)
def assessment_html(found: Assessment) -> str:
    """Return how a notebook shows an assessment, as HTML."""
    tables = [loads_table(found), uses_table(found, 12)]
    facts = f"{found.verdict}. Not checked: {'; '.join(found.unchecked)}."
    return notebook_html(found.name, facts, tables, found.warnings)
