"""Every number of the tables of tasks, assessments and comparisons, from Lagrange's forces at samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drives_by_hand import GEARED, MARGINS, Axis
from lagrange import BODIES, LagrangeModel
from table_numbers import check_evidence, check_table, shows

import p3dof
from p3dof import Task, Waypoint
from p3dof.design import AxisLimits
from p3dof.design.assessment import assumptions, loads_table, needs_table, uses_table
from p3dof.design.bearings import Bearing, Bearings, Guide
from p3dof.design.design_comparison import comparison_table, verdicts_table
from p3dof.design.drives import Cycle
from p3dof.design.fastest import sizing_table
from p3dof.design.forces_of_tasks import limits_table, pieces_table
from p3dof.machine import Actuators, Body, Limits

HEAVY = Body(14.0, np.array([0.02, -0.03, -0.05]), np.diag([0.03, 0.04, 0.05]))
TASK = Task(
    [
        Waypoint([0, 0, 0], "home", dwell=0.05),
        Waypoint([-0.12, 0.01, -0.2], "pick", dwell=0.15, pick_up=HEAVY),
        Waypoint([0.02, 0.05], "over", blend=0.03),
        Waypoint([0.13, -0.01, 0.22], "place", dwell=0.1, put_down=True, wrench=[3, -20, 40, 1, 2, -1]),
        Waypoint([0, 0, 0], "back"),
    ],
    "hand over",
)
MACHINE = replace(
    p3dof.PAPER,
    actuators=Actuators({"slide_a": 3.0, "slide_c": 1.5}, {"slide_b": 12.0}),
    limits=Limits(travel=(-0.14, 0.11), speed=1.3, force=620.0, tilt=(-0.3, 0.5)),
)
REST = 0.2


class Samples:
    """A task at the samples of its plan, each with the piece it belongs to and the machine's load there."""

    def __init__(self, machine, plan):
        self.plan, self.machine, self.model = plan, machine, LagrangeModel(machine)
        parts, self.place, self.held, self.mass = [], [], [], []
        for piece in plan.pieces:
            laden = machine if piece.payload is None else machine.carrying(piece.payload)
            model, m = LagrangeModel(laden), piece.motion
            states = m.pose, m.velocity, m.acceleration
            bare, change = model.forces(*states, piece.wrench), model.slider_accelerations(*states)
            balance = [machine.actuators.counterbalance.get(f"slide_{leg}", 0.0) for leg in "abc"]
            nut = bare - balance
            parts.append(
                (m.time, nut, model.slider_velocities(*states[:2]), change, model.sliders(m.pose), m.pose)
            )
            self.place += [piece.name] * len(m)
            zero = np.zeros(3)
            self.held.append(model.forces(m.pose, zero, zero) - balance)
            inverse = np.linalg.inv(model.jacobian(m.pose))
            moved = np.swapaxes(inverse, 1, 2) @ model.mass_matrix(m.pose) @ inverse
            self.mass.append(np.diagonal(moved, axis1=1, axis2=2))
        columns = (np.concatenate(column) for column in zip(*parts, strict=True))
        self.time, self.nut, self.speed, self.change, self.slider, self.pose = columns
        self.rotors = np.array([machine.actuators.armature.get(f"slide_{leg}", 0.0) for leg in "abc"])
        self.force = self.nut + self.rotors * self.change
        self.ends = np.cumsum([len(part[0]) for part in parts])
        begins = self.ends[:-1]
        self.time[begins] = np.nextafter(self.time[begins], np.inf)  # so that a time tells its piece

    def integral(self, values):
        step = np.diff(self.time)
        return ((values[1:] + values[:-1]).T * step / 2).T.sum(axis=0)

    def vertex(self, values, k):
        """When a parabola through three samples of one piece is steady; at the ends of a piece the sample."""
        if k + 1 in self.ends or k in self.ends or k == 0:
            return self.time[k]
        a, b, _ = np.polyfit(self.time[k - 1 : k + 2] - self.time[k], values[k - 1 : k + 2], 2)
        return self.time[k] - (b / (2 * a) if abs(a) > 1e-9 else 0.0)

    def of_machine(self):
        """What is used of the machine's limits: value, limit, unit, time, place by quantity and leg."""
        low, high = MACHINE.limits.travel  # the same of all machines here
        least, most = MACHINE.limits.tilt
        columns = {
            "force": (self.force, -620.0, 620.0, "N"),
            "speed": (self.speed, -1.3, 1.3, "m/s"),
            "travel": (self.slider, low, high, "m"),
            "tilt": (self.pose[:, 2:], least, most, "rad"),
        }
        found = {}
        for name, (values, low, high, unit) in columns.items():
            for leg, column in zip("ABC" if values.shape[1] > 1 else ["platform"], values.T, strict=True):
                k = int(np.maximum(column / low, column / high).argmax())
                limit = low if column[k] < 0 else high
                found[name, leg] = column[k], limit, unit, self.vertex(column, k), self.place[k]
        return found

    def of_task(self, limits):
        """Likewise of the task's own, at samples."""
        force = self.force + limits.reflected_mass * self.change
        columns = {
            "force": (np.abs(force), limits.force, "N"),
            "speed": (np.abs(self.speed), limits.speed, "m/s"),
            "power": (force * self.speed, limits.power, "W"),
        }
        found = {}
        for name, (values, allowed, unit) in columns.items():
            for leg, column, limit in zip("ABC", values.T, allowed, strict=True):
                k = int(column.argmax())
                if np.isfinite(limit) and (name, limit) != ("speed", 1.3):  # that is the machine's
                    found[name, leg] = column[k], limit, unit, self.time[k], self.place[k]
        return found


@pytest.fixture(scope="module")
def plan():
    return TASK.plan(1.4, 141)


@pytest.fixture(scope="module")
def robot():
    return p3dof.load(MACHINE)


@pytest.fixture(scope="module")
def forces(robot, plan):
    return p3dof.design.forces_of_task(robot, plan)


@pytest.fixture(scope="module")
def samples(plan):
    return Samples(MACHINE, plan)


@shows("p3dof.design.forces_of_tasks.pieces_table")
def test_what_each_piece_of_a_task_takes(forces, samples):
    assert len(samples.ends) == 7
    rows = []
    for piece, begin, end in zip(forces.plan.pieces, [0, *samples.ends], samples.ends, strict=False):
        carried = 14.0 if piece.payload else np.nan
        time, peaks = samples.time[begin:end], np.abs(samples.force[begin:end]).max(axis=0)
        fastest = np.abs(samples.speed[begin:end]).max()
        rows.append((piece.name, time[0], time[-1] - time[0], carried, fastest, *peaks))
    check_table(pieces_table(forces), rows, note=[1.4])


LIMITS = AxisLimits([640, 300, 500], [0.9, 1.3, 1.0], [np.inf, 150, 260], [2.0, 0.0, 4.0], nut_force=900)


@pytest.fixture(scope="module")
def slow(robot):
    """So slow that the load at a stop, from the moment in which it is picked up, is the largest."""
    plan = TASK.plan(7.0, 141)
    return p3dof.design.forces_of_task(robot, plan), Samples(MACHINE, plan)


@pytest.mark.parametrize("limits", [None, LIMITS])
@pytest.mark.parametrize("pace", ["quick", "slow"])
@shows("p3dof.design.fastest.sizing_table")
def test_how_much_a_task_uses_of_limits(forces, samples, slow, pace, limits):
    if pace == "slow":
        forces, samples = slow
        assert {samples.of_machine()["force", leg][-1] for leg in "AB"} == {"at pick", "at place"}
    found = {key: (*use, "machine") for key, use in samples.of_machine().items()}
    if limits is not None:
        for key, use in samples.of_task(limits).items():
            if key not in found or use[0] / use[1] > abs(found[key][0] / found[key][1]):
                found[key] = (*use, "task")
        assert {use[-1] for use in found.values()} == {"task", "machine"}
    rows = {
        f"{name} {leg} [{unit}]": (value, when, place, limit, of, (value / limit,))
        for (name, leg), (value, limit, unit, when, place, of) in found.items()
    }
    check_table(
        sizing_table(forces, MACHINE.limits, limits), rows, note=() if limits is None else ("nut force",)
    )


HOLDS = {
    "force": ("actuator", "N", (400, 400, 400)),
    "speed": ("slider", "m/s", (1.0, 1.5, 1.2)),
    "power": ("actuator", "W", (200, np.nan, 300)),
    "nut force": ("nut", "N", (380, 380, 380)),
}


@shows("p3dof.design.forces_of_tasks.limits_table")
def test_how_much_the_fastest_motion_uses_of_its_limits():
    """The numbers of a plan in its table; and its peaks are those of Lagrange at its samples, about there."""
    task = Task([Waypoint([-0.1, 0, -0.2]), Waypoint([0.1, 0.02, 0.2], pick_up=HEAVY), Waypoint([0, 0, 0])])
    limits = AxisLimits(400, [1.0, 1.5, 1.2], [200, np.inf, 300], [1.0, 2.0, 0.0], nut_force=380)
    plan = p3dof.design.fastest_plan(p3dof.load(MACHINE), task, limits, nodes=60, samples=2001)
    s = Samples(MACHINE, plan)
    own = s.force + s.change * [1.0, 2.0, 0.0]
    lift = s.nut + np.array([0.0, 12.0, 0.0])
    values = {"force": abs(own), "speed": abs(s.speed), "power": own * s.speed, "nut force": abs(lift)}
    rows, seen = {}, []
    for use in plan.uses:
        column = values[use.quantity][:, "ABC".index(use.leg)]
        assert use.value == pytest.approx(column.max(), rel=2e-3)
        near = np.abs(s.time - use.time) < 2e-3
        assert column[near].max() == pytest.approx(use.value, rel=2e-2)
        assert use.way in {s.place[k] for k in np.flatnonzero(near)}
        seen.append((use.quantity, use.leg))
        where, unit, allowed = HOLDS[use.quantity]
        limit = allowed["ABC".index(use.leg)]
        numbers = use.value, limit, (use.value / limit,), use.time
        rows[f"{use.quantity} {use.leg} [{unit}]"] = (where, *numbers, use.way)
    assert len(seen) == 3 + 3 + 2 + 3
    check_table(limits_table(plan), rows)


PARTS = Bearings(
    joints={
        "hinge_left": Bearing(3000.0, 400.0),
        "loop_b": Bearing(5e3, 700.0, kind="roller"),
        "slide_b": Guide(1e4, 50e3, (120, 90, 150), static=2e3),
        "hinge_a": Bearing(4e3),
    }
)


def assessed(robot, forces, drive=None, bearings=None, limits=None):
    return p3dof.assess(
        robot, forces, drives=drive, bearings=bearings, limits=limits, rest=REST, frictionless=True
    )


def axes_of(samples, drive):
    """The drive on each axis, by hand: no rotor of the machine, brakes that hold what is heaviest."""
    held, mass = np.concatenate(samples.held), np.concatenate(samples.mass)
    cycle = Cycle(samples.time, samples.nut, samples.speed, samples.change, REST, held[-1])
    most = np.abs(held).argmax(axis=0)
    axes = []
    for k in range(3):
        masses = [mass[:, k].min(), mass[:, k].max()]
        axes.append(Axis(cycle, drive, k, abs(held[most[k], k]), samples.time[most[k]], masses))
    return axes


def peak(samples, values, side=abs):
    """The largest of each axis, and when and where the largest of all is."""
    sizes = np.abs(values if side is abs else side(values, 0.0))
    row, _ = np.unravel_index(sizes.argmax(), sizes.shape)
    return [*sizes.max(axis=0), samples.time[row], samples.place[row]]


def rms(samples, values, resting):
    total = samples.time[-1] - samples.time[0] + REST
    return [*np.sqrt((samples.integral(values**2) + REST * resting**2) / total), np.nan, "–"]


@pytest.mark.parametrize("drive", [None, GEARED])
@shows("p3dof.design.assessment.loads_table")
def test_what_each_slider_bears_and_does(robot, forces, samples, drive):
    power = samples.nut * samples.speed
    rows = {
        "force at the nut, peak [N]": peak(samples, samples.nut),
        "force at the nut, rms [N]": rms(samples, samples.nut, samples.nut[-1]),
    }
    if drive is None:
        rows["force of the actuator, with armature, peak [N]"] = peak(samples, samples.force)
        rows["force of the actuator, with armature, rms [N]"] = rms(samples, samples.force, samples.nut[-1])
    else:
        axes = axes_of(samples, drive)
        ratio = axes[0].ratio
        motor = ratio * np.transpose([axis.torque for axis in axes])
        rows["force of the motor at the slider, peak [N]"] = peak(samples, motor)
        square = [ratio * axis.mean(axis.torque, axis.holding) ** 0.5 for axis in axes]
        rows["force of the motor at the slider, rms [N]"] = [*square, np.nan, "–"]
    rows["speed, peak [m/s]"] = peak(samples, samples.speed)
    rows["acceleration, peak [m/s²]"] = peak(samples, samples.change)
    rows["power at the nut, peak [W]"] = peak(samples, power, np.maximum)
    rows["regenerative power at the nut, peak [W]"] = peak(samples, power, np.minimum)
    if drive is not None:
        rows["power of the motor, peak [W]"] = peak(samples, motor * samples.speed, np.maximum)
        rows["regenerative power of the motor, peak [W]"] = peak(samples, motor * samples.speed, np.minimum)
    note = (
        ("Without inertia and losses of drives",) if drive is None else ("and the losses of its drive too",)
    )
    check_table(loads_table(assessed(robot, forces, drive)), rows, note=note)


@shows("p3dof.design.assessment.needs_table")
def test_what_motors_must_give_behind_screws(robot, forces, samples):
    peaks, means = np.abs(samples.nut).max(axis=0), rms(samples, samples.nut, samples.nut[-1])
    rows = {}
    for lead in (5, 10, 16, 20, 32):
        torques = [force * lead / 2e3 / math.pi for k in range(3) for force in (peaks[k], means[k])]
        rows[f"{lead} mm"] = [*torques, *(60e3 * np.abs(samples.speed).max(axis=0) / lead)]
    check_table(needs_table(assessed(robot, forces)), rows)


def ratings(samples, found, drive, limits):
    """All ratings by hand, those used most first: part, kind, required, allowed, unit, time, place."""
    rows = [
        (name, leg, "machine", abs(value), abs(limit), unit, when, place)
        for (name, leg), (value, limit, unit, when, place) in samples.of_machine().items()
    ]
    if limits is not None:
        rows += [(name, leg, "task", *use) for (name, leg), use in samples.of_task(limits).items()]
    for leg, axis in zip("ABC", axes_of(samples, drive), strict=True):
        for name, (value, allowed, when) in axis.ratings.items():
            place = "over the cycle"
            if not math.isnan(when):
                place = samples.place[int(np.flatnonzero(samples.time == when)[0])]
            words, _, unit = name.rstrip("]").partition(" [")
            rows.append((words, leg, "drive", value, allowed, unit, when, place))
    rows += static_loads(samples, found.reactions)
    return sorted(rows, key=broken, reverse=True)


def static_loads(samples, reactions):
    """Largest static loads of bearings, guides and rods, by hand from the reactions."""
    times, names = reactions.time, reactions.joints
    f = {name: reactions.forces[:, names.index(name)] for name in names}
    m = reactions.moments[:, names.index("slide_b")]
    radial = {name: np.hypot(f[name][:, 0], f[name][:, 2]) for name in ("hinge_left", "loop_b")}
    guide = np.abs(f["slide_b"][:, :2]).sum(axis=1) + 1e4 * (np.abs(m) / [120, 90, 150]).sum(axis=1)
    ball = np.maximum(radial["hinge_left"], 0.6 * radial["hinge_left"] + 0.5 * np.abs(f["hinge_left"][:, 1]))
    loads = [
        ("static load", "hinge_left", "bearing", ball, 200.0),
        ("static load", "loop_b", "bearing", radial["loop_b"], 350.0),
        ("static load", "slide_b", "guide", guide, 1000.0),
    ]
    length, fixed, _ = p3dof.PAPER.geometry.L, *reactions.in_base()
    for rod, ends in {
        "leg_a": ("hinge_a", "loop_a"), "leg_b": ("hinge_b", "loop_b"),
        "rod_left": ("hinge_left", "hinge_lower"), "rod_right": ("hinge_right", "loop_c"),
    }.items():  # fmt: skip
        along = samples.model.orientations(reactions.motion.pose)[:, BODIES.index(rod), :, 0]
        thrust = np.max([(fixed[:, names.index(end)] * along).sum(axis=1) for end in ends], axis=0)
        mass = getattr(p3dof.PAPER.bodies, rod).mass  # a solid cylinder of steel as heavy
        section = mass / length / 7801
        euler = math.pi**2 * 210e9 * section**2 / 4 / math.pi / length**2
        loads.append(("buckling", rod, "rod", thrust.clip(0), euler))
    for name, part, kind, load, allowed in loads:
        k = int(load.argmax())
        place = samples.plan.piece_at(times[k]).name if load[k] else "over the cycle"
        yield name, part, kind, load[k], allowed, "N", times[k] if load[k] else math.nan, place


def limit(name, kind):
    """The share that keeps the margin, in percent; machine and task have none."""
    return f"{1 - MARGINS.get(name, 0) * (kind == 'drive'):.0%}"


def broken(rating):
    """How bad a rating is: beyond it, without reserve, how much of it is used."""
    name, _, kind, value, allowed, *_ = rating
    margin = MARGINS.get(name, 0) * (kind == "drive")
    return value > allowed, value > (1 - margin) * allowed, value / allowed


@shows("p3dof.design.assessment.uses_table")
def test_how_much_of_all_ratings_is_used(robot, forces, samples):
    found = assessed(robot, forces, GEARED, PARTS, LIMITS)
    rows = [
        (
            f"{name} of {part}",
            kind,
            (value, unit),
            (allowed, unit),
            (value / allowed,),
            limit(name, kind),
            when,
            place,
        )
        for name, part, kind, value, allowed, unit, when, place in ratings(samples, found, GEARED, LIMITS)
    ]
    assert len({row[1] for row in rows}) == 6
    check_table(uses_table(found), rows)
    assert {"drives", "ambient"} <= assumptions(found).keys() - assumptions(assessed(robot, forces)).keys()
    told = assumptions(found)["limits"]
    assert "force 640, 300, 500 N, speed 0.9, 1.3, 1 m/s, power any, 150, 260 W, nut force 900 N" in told
    assert told.endswith(", with 2, 0, 4 kg of drives in its force")
    for left in (len(rows) - 5, 1):
        check_table(uses_table(found, len(rows) - left), rows[: len(rows) - left], note=[left, "more"])


WIDE = replace(MACHINE, geometry=replace(MACHINE.geometry, R=0.27, b=0.07), actuators=Actuators())


def places(samples):
    """Where the thirteen joints are, (N, 13, 3), from Lagrange's bodies."""
    origins, axes = samples.model.origins(samples.pose), samples.model.orientations(samples.pose)
    tips = origins + samples.machine.geometry.L * axes[..., 0]
    joints = [origins[:, k] for k, body in enumerate(BODIES) if body != "platform"]
    return np.stack(
        joints + [tips[:, BODIES.index(rod)] for rod in ("leg_a", "leg_b", "rod_left", "rod_right")], 1
    )


def measured(found, samples, drive):
    """Numbers of a design by hand, by name and unit; which direction is better."""
    power = (samples.force * samples.speed).sum(axis=1)
    x, y, z = np.ptp(places(samples).reshape(-1, 3), axis=0)
    axes = samples.model.orientations(samples.pose)
    arm, normal = axes[:, BODIES.index("platform"), :, 0], axes[:, BODIES.index("rod_left"), :, 1]
    motors = axes_of(samples, drive)
    bus = sum(np.array(axis.power) for axis in motors)
    loads = [row[3:5] for row in ratings(samples, found, drive, None)]
    mean = samples.integral(samples.force**2) / (samples.time[-1] - samples.time[0])
    each = {
        "peak force of {} [N]": np.abs(samples.force).max(axis=0),
        "rms force of {} [N]": np.sqrt(mean),
        "top speed of {} [m/s]": np.abs(samples.speed).max(axis=0),
    }
    lives, guides = (found.bearings.bearings, found.bearings.guides)
    borne = static_loads(samples, found.reactions)
    return {name.format(leg): value[k] for name, value in each.items() for k, leg in enumerate("ABC")} | {
        "peak power [W]": power.max(),
        "work supplied per cycle [J]": samples.integral(power.clip(0)),
        "work regenerated per cycle [J]": -samples.integral(power.clip(None, 0)),
        "cycle time [s]": 1.4 + REST,
        "highest utilisation [%]": 100 * max(value / allowed for value, allowed in loads),
        "peak torque of the motors [N m]": max(max(map(abs, axis.torque)) for axis in motors),
        "rms torque of the motors [N m]": max(axis.mean(axis.torque, axis.holding) ** 0.5 for axis in motors),
        "peak power of the bus [W]": bus.max(),
        "work of the motors per cycle [J]": samples.integral(bus.clip(0)),
        "moving mass [kg]": sum(body.mass for _, body in samples.machine.bodies.items()),
        "footprint of the joints [m²]": x * y,
        "height of the joints [m]": z,
        "nearest singularity [°]": np.degrees(np.arcsin(np.abs((arm * normal).sum(axis=1)).min())),
        "shortest life of bearings [h]": min(one.hours for one in lives),
        "shortest life of guides [h]": min(one.hours for one in guides),
        "largest compression of rods [N]": max(row[3] for row in borne if row[2] == "rod"),
    }


@pytest.fixture(scope="module")
def compared():
    designs = {"narrow": MACHINE, "wide": WIDE}
    (found,) = p3dof.compare_designs(
        designs,
        TASK,
        duration=1.4,
        drives=[GEARED],
        bearings=PARTS,
        rest=REST,
        samples=141,
        frictionless=True,
    )
    both = [Samples(machine, TASK.plan(1.4, 141)) for machine in designs.values()]
    return found, both


HIGHER = ("nearest singularity", "shortest life")
NEITHER = ("work regenerated per cycle",)


@shows(
    "p3dof.design.design_comparison.comparison_table",
    "p3dof.design.design_comparison.DesignMeasure.differences",
)
def test_designs_side_by_side(compared):
    found, both = compared
    one, other = (
        measured(assessment, samples, GEARED)
        for assessment, samples in zip(found.assessments, both, strict=True)
    )
    rows = {}
    for name, first in one.items():
        second = other[name]
        share = second / first - 1
        better = "" if name.startswith(NEITHER) else "higher" if name.startswith(HIGHER) else "lower"
        wins = (second > first) == (better == "higher")
        best = f"{'wide' if wins else 'narrow'} ({better})" if better and abs(share) > 5e-4 else "–"
        rows[name] = (first, second, (share,), best)
        measure = next(measure for measure in found.measures if measure.label == name)
        if abs(share) > 1e-3:
            check_evidence(measure, "differences", [0.0, share], rtol=1e-6, atol=1e-9)
    check_table(comparison_table(found), rows)
    assert (
        0
        < sum("wide" in row[-1] for row in rows.values())
        < sum("narrow" in row[-1] for row in rows.values())
    )


@shows("p3dof.design.design_comparison.verdicts_table")
def test_which_rating_each_design_uses_most(compared):
    found, both = compared
    rows = {}
    for assessment, samples in zip(found.assessments, both, strict=True):
        name, part, _, value, allowed, _, when, place = ratings(samples, assessment, GEARED, None)[0]
        fits = "yes" if value <= allowed else "no"
        rows[assessment.name] = (fits, f"{name} of {part}", (value / allowed,), (when, place), "geared")
    check_table(verdicts_table(found), rows, note=[])
