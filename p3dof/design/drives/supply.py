"""`Supply`: what feeds the amplifiers; its capacitors, its braking resistor and the line over a cycle.

What the motors draw from a bus, P, is their power at the shaft and the losses of their windings. With W the
energy of the capacitors above that at the nominal voltage, and E what they take up to the largest voltage,

    Ẇ = -P,   0 <= W <= E

The line gives P where W = 0 and P > 0, the resistor burns -P where W = E and P < 0. P is straight between
samples, and all is integrated exactly. A cycle takes W to clip(W + a, low, high), so its steady state needs
no iteration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray, FrozenArrays, Readable
from p3dof._base.errors import DriveError
from p3dof._base.tables import NONE, Table, number, table_of
from p3dof.design.drives.motor import above_zero, share, text
from p3dof.machine.parameters import LEGS

DUTY = 0.2
"""Share of its rated power that a braking resistor may burn in the mean where nothing is said: Yaskawa's;
Teco has 0.4."""
_NOTHING = 1e-12  # share of the energy moved by which a cycle may seem to charge the bus


@dataclass(frozen=True)
class Supply(Readable):
    """What feeds the amplifiers: capacitors, a braking resistor or a line that takes energy back.

    Parameters
    ----------
    capacitance : float
        Of each direct-current bus [F]: of all amplifiers on it together.
    voltage : float
        Of the bus while the line feeds it [V]: √2 times the rms voltage of the line.
    max_voltage : float
        At which the braking resistor is switched on or the line takes energy back; without either, what the
        bus bears [V].
    resistance : float, optional
        Of the braking resistor on each bus [Ω]; none without it, unless `resistor_power` is given.
    resistor_power : float, optional
        Rated power of that resistor [W].
    duty : float, optional
        Share of the rated power that it may burn in the mean, up to 1; `DUTY` without it.
    feedback : bool
        Whether the line takes back what the capacitors cannot: then there is no resistor.
    max_power : float
        Largest power that the line gives to each bus [W]; infinite if nothing is known.
    max_feedback_power : float
        Largest power that the line takes back from each bus [W]; infinite if nothing is known.
    common : bool
        Whether the three axes share one bus; else each has its own, of the same data.
    name : str
        What tables call it.

    Raises
    ------
    DriveError
        If a number does not fit, or a resistor is given for a line that takes energy back.
    """

    capacitance: float
    voltage: float
    max_voltage: float
    resistance: float | None = None
    resistor_power: float | None = None
    duty: float | None = None
    feedback: bool = False
    max_power: float = math.inf
    max_feedback_power: float = math.inf
    common: bool = True
    name: str = "supply"

    def __post_init__(self) -> None:
        where = text("supply: name", self.name)
        for name in ("capacitance", "voltage", "max_voltage", "resistance", "resistor_power"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, above_zero(f"{where}: {name}", getattr(self, name)))
        for name in ("max_power", "max_feedback_power"):
            if getattr(self, name) != math.inf:
                object.__setattr__(self, name, above_zero(f"{where}: {name}", getattr(self, name)))
        if self.duty is not None:
            object.__setattr__(self, "duty", share(f"{where}: duty", self.duty))
        for name in ("feedback", "common"):
            if not isinstance(getattr(self, name), bool):
                raise DriveError(f"{where}: {name}: expected true or false")
        if self.max_voltage <= self.voltage:
            raise DriveError(f"{where}: max_voltage: expected more than the nominal {self.voltage:g} V")
        if self.feedback and self.has_resistor:
            raise DriveError(f"{where}: feedback: a line that takes energy back has no braking resistor")
        if self.duty is not None and not self.has_resistor:
            raise DriveError(f"{where}: duty: expected a resistance or a resistor_power with it")

    @property
    def has_resistor(self) -> bool:
        """Whether there is a braking resistor."""
        return self.resistance is not None or self.resistor_power is not None

    @property
    def energy(self) -> float:
        """What the capacitors of a bus take between the two voltages [J]."""
        return 0.5 * self.capacitance * (self.max_voltage**2 - self.voltage**2)


@dataclass(frozen=True, eq=False)
class BusLoads(FrozenArrays):
    """What a cycle takes of one direct-current bus, in the steady state of many cycles."""

    name: str  # `"bus"`, or `"bus A"` of an axis
    time: FloatArray  # (N,): of the samples, of zeros of the power between them, and of the rest [s]
    power: FloatArray  # (N,): what the motors draw, with the losses of their windings [W]
    voltage: FloatArray  # (N,) [V]
    duration: float  # of a cycle [s]
    braking_work: float  # what comes back from the motors over a cycle [J]
    burnt: float  # what of it the capacitors cannot take: burnt, or given back to the line [J]
    peak_power: float  # largest power of that, and when [W, s]
    peak_time: float
    line_work: float  # what the line gives over a cycle [J], and its largest power, and when [W, s]
    line_power: float
    line_time: float

    @property
    def mean_power(self) -> float:
        """Of what is burnt or given back, over the cycle [W]."""
        return self.burnt / self.duration

    @property
    def top_voltage(self) -> float:
        """Largest voltage [V]."""
        return float(self.voltage.max())

    @property
    def top_time(self) -> float:
        """When it is reached [s]."""
        return float(self.time[int(np.argmax(self.voltage))])


@dataclass(frozen=True, eq=False)
class SupplyLoads(Readable):
    """What a cycle takes of a supply."""

    supply: Supply
    buses: tuple[BusLoads, ...]  # one, or those of A, B and C

    @property
    def duty(self) -> float:
        """Share of its rated power that the braking resistor may burn in the mean."""
        return DUTY if self.supply.duty is None else self.supply.duty


def loads_of_supply(
    supply: Supply, time: FloatArray, drawn: FloatArray, rest: FloatArray, resting: float
) -> SupplyLoads:
    """Return what a cycle takes of a supply.

    Motors draw (N, 3) over `time`, and (3,) in the rest after it [W], which takes `resting` [s].
    """
    names = ["bus"] if supply.common else [f"bus {leg}" for leg in LEGS]
    columns = [drawn.sum(axis=1)] if supply.common else list(drawn.T)
    still = [float(np.sum(rest))] if supply.common else [float(value) for value in rest]
    buses = [
        march(supply, name, time, column, held, resting)
        for name, column, held in zip(names, columns, still, strict=True)
    ]
    return SupplyLoads(supply, tuple(buses))


def march(
    supply: Supply, name: str, time: FloatArray, power: FloatArray, rest: float, resting: float
) -> BusLoads:
    """Return what a cycle takes of one bus, whose motors draw `power` (N,), and `rest` in the rest [W]."""
    if resting > 0:
        time, power = np.append(time, [time[-1], time[-1] + resting]), np.append(power, [rest, rest])
    time, power = _with_zeros(time, power)
    charge = -0.5 * (power[1:] + power[:-1]) * np.diff(time)  # what comes back in each interval
    bounded = supply.has_resistor or supply.feedback
    most = supply.energy if bounded else math.inf
    ends = np.flatnonzero(np.diff(charge > 0)) + 1
    runs = list(zip([0, *ends], [*ends, len(charge)], strict=True))  # of braking and of driving, in turn
    stored: FloatArray = np.empty_like(time)
    stored[0] = held = _steady([float(charge[i:j].sum()) for i, j in runs], most)
    burnt = given = peak = line = 0.0
    peak_time = line_time = math.nan
    for i, j in runs:
        level = held + np.cumsum(charge[i:j])
        stored[i + 1 : j + 1] = np.clip(level, 0.0, most)
        high, low = float(level[-1]) - most, -float(level[-1])
        if high > 0:
            burnt += high
            worst, when = _worst(time[i : j + 1], -power[i : j + 1], most - held)
            peak, peak_time = max((peak, peak_time), (worst, when), key=lambda one: one[0])
        if low > 0:
            given += low
            worst, when = _worst(time[i : j + 1], power[i : j + 1], held)
            line, line_time = max((line, line_time), (worst, when), key=lambda one: one[0])
        held = float(stored[j])
    voltage = np.sqrt(supply.voltage**2 + 2 * stored / supply.capacitance)
    back = float(np.maximum(charge, 0.0).sum())
    total = float(time[-1] - time[0])
    for array in (time, power, voltage):
        array.setflags(write=False)
    return BusLoads(name, time, power, voltage, total, back, burnt, peak, peak_time, given, line, line_time)


def _with_zeros(time: FloatArray, power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return samples, and those where a straight power changes its sign between them."""
    rows = np.flatnonzero((power[1:] * power[:-1] < 0) & (np.diff(time) > 0))
    along = power[rows] / (power[rows] - power[rows + 1])
    zeros = time[rows] + along * (time[rows + 1] - time[rows])
    return np.insert(time, rows + 1, zeros), np.insert(power, rows + 1, 0.0)


def _steady(charges: list[float], most: float) -> float:
    """Return the energy with which a cycle begins that ends with it: of W to clip(W + a, low, high)."""
    added, low, high = 0.0, 0.0, most
    for charge in charges:
        added += charge
        low, high = (min(max(end + charge, 0.0), most) for end in (low, high))
    gains = added > _NOTHING * sum(map(abs, charges))
    return high if gains else low


def _worst(time: FloatArray, power: FloatArray, before: float) -> tuple[float, float]:
    """Return the largest of a straight power once it has done so much work, and when."""
    step = np.diff(time)
    work = np.cumsum(0.5 * (power[1:] + power[:-1]) * step)
    k = int(np.searchsorted(work, before, side="right"))
    k = min(k, len(step) - 1)
    left = before - (float(work[k - 1]) if k else 0.0)
    first, slope = float(power[k]), float(power[k + 1] - power[k]) / float(step[k]) if step[k] > 0 else 0.0
    # first s + slope s²/2 = left, in the form that takes no small difference
    root = first + math.sqrt(max(first**2 + 2 * slope * left, 0.0))
    passed = 2 * left / root if root > 0 else 0.0
    times = [float(time[k]) + passed, *time[k + 1 :].tolist()]
    powers = [first + slope * passed, *power[k + 1 :].tolist()]
    top = max(range(len(powers)), key=powers.__getitem__)
    return powers[top], times[top]


def supply_table(loads: SupplyLoads) -> Table:
    """Return what a cycle takes of each direct-current bus."""
    supply, buses = loads.supply, loads.buses
    most = supply.max_voltage**2
    rows: dict[str, list[float]] = {
        "regenerated [J]": [bus.braking_work for bus in buses],
        "given back to the line [J]" if supply.feedback else "burnt in the resistor [J]": [
            bus.burnt for bus in buses
        ],
        "mean of that [W]": [bus.mean_power for bus in buses],
        "largest of that [W]": [bus.peak_power for bus in buses],
        "from the line [J]": [bus.line_work for bus in buses],
        "from the line, peak [W]": [bus.line_power for bus in buses],
        "largest voltage [V]": [bus.top_voltage for bus in buses],
    }
    if not supply.feedback:
        rows["rated power of the resistor, at least [W]"] = [bus.mean_power / loads.duty for bus in buses]
        rows["resistance, at most [Ω]"] = [
            most / bus.peak_power if bus.peak_power > 0 else math.nan for bus in buses
        ]
    note = "In steady state, with the losses of windings that are known."
    note += f" The capacitors take {number(supply.energy)} J up to {number(supply.max_voltage)} V."
    if not supply.feedback:
        assumed = " (assumed)" if supply.duty is None else ""
        note += f" The resistor may burn {loads.duty:.0%} of its rated power in the mean{assumed}."
    cells = {
        row: [number(value) if math.isfinite(value) else NONE for value in values]
        for row, values in rows.items()
    }
    return table_of(f"Supply: {supply.name}", ("over a cycle", *(bus.name for bus in buses)), cells, note)
