"""`Population`: some designs of a problem, with what several measures need of them computed once.

Columns may be moved by a complex step, which gives exact derivatives of every formula that is made of
analytic functions (W. Squire, G. Trapp, SIAM Review 40 (1998) 110): it is so small that nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array, shown
from p3dof._base.errors import InputError
from p3dof._base.time_series.wrenches import Load, WrenchOverTime
from p3dof.analysis.designs import DesignEvaluation, DesignForces, Designs
from p3dof.analysis.designs.columns import (
    DENSITY,
    LENGTHS,
    OFFSETS,
    SIZES,
    BodiesOfDesigns,
    members_of,
    number_in,
)
from p3dof.analysis.designs.figures import (
    FigureGroup,
    Outputs,
    Sampled,
    Samples,
    derivatives,
    sampled,
    samples_of,
)
from p3dof.analysis.designs.folding import Folded, folding_of
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.reduced import Model
from p3dof.design.clearance import Surroundings
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Dimensions, Parameters
from p3dof.machine.parameters.solids import scales

GRID = (9, 13)  # poses along y and θ


@dataclass(frozen=True)
class Box(Readable):
    """A box of poses y0 ≤ y ≤ y1, θ0 ≤ θ ≤ θ1: within it, measures of poses take the worst one.

    Height, reach and distance from singularities are those of the whole box, exactly; other measures take
    the poses of a grid with the borders of the box in it. None depends on z: all sliders move alike with it.

    Parameters
    ----------
    y : tuple of float
        Ends along y [m].
    theta : tuple of float
        Ends of the rotation [rad].
    grid : tuple of int
        How many poses along y and along θ, from 2 to 201 each.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    y: tuple[float, float]
    theta: tuple[float, float]
    grid: tuple[int, int] = GRID

    def __post_init__(self) -> None:
        for name in ("y", "theta"):
            low, high = (float(end) for end in frozen_array(f"box.{name}", getattr(self, name), (2,)))
            if not low < high:
                raise InputError(
                    f"box.{name}: expected the lower end below the upper one, got {low:g} and {high:g}"
                )
            object.__setattr__(self, name, (low, high))
        if not isinstance(self.grid, tuple | list) or len(self.grid) != 2:
            raise InputError("box.grid: expected two numbers of poses")
        for count in self.grid:
            if isinstance(count, bool) or not isinstance(count, int) or not 2 <= count <= 201:
                raise InputError(f"box.grid: expected whole numbers from 2 to 201, got {count!r}")
        object.__setattr__(self, "grid", tuple(self.grid))

    @property
    def poses(self) -> tuple[FloatArray, FloatArray]:
        """Y and θ of all poses of the grid, (G,) each."""
        y, theta = (np.linspace(*ends, n) for ends, n in zip((self.y, self.theta), self.grid, strict=True))
        found = np.meshgrid(y, theta, indexing="ij")
        return found[0].ravel(), found[1].ravel()

    @property
    def corners(self) -> tuple[FloatArray, FloatArray]:
        """Y and θ of the middle of the box and of its corners, (5,) each."""
        (y0, y1), (t0, t1) = self.y, self.theta
        middle = (y0 + y1) / 2, (t0 + t1) / 2
        return np.array([middle[0], y0, y0, y1, y1]), np.array([middle[1], t0, t1, t0, t1])

    def finer(self, times: int) -> Box:
        """Return the same box with a grid that is several times finer."""
        grid = tuple(min((count - 1) * times + 1, 201) for count in self.grid)
        return Box(self.y, self.theta, (grid[0], grid[1]))


DRIVE = "drive."  # what the names of variables of drives begin with: no columns of designs


class LoadCase(NamedTuple):
    """A part of a task over which what the platform carries and bears stays."""

    setting: Setting  # its motion, its load and its payload; all else as of the problem
    duty: int  # which of the tasks
    duration: float  # [s]


STEP = 1e-60  # of complex steps; nothing is subtracted, so that it may be so small


@dataclass(frozen=True, eq=False)
class Setting:
    """What all designs of a problem share."""

    machine: Parameters  # what has no column
    bodies: BodiesOfDesigns  # where bodies come from; see `Designs`
    fixed: Mapping[str, float]  # columns that are the same for all, by full names
    names: tuple[str, ...]  # full names of the variables
    motion: Motion  # what all do
    wrench: WrenchOverTime  # external force and moment on the platform
    box: Box | None  # the poses that all must reach
    modulus: float  # of the rods' material [Pa], and of one drive [N/m]
    drive_stiffness: float
    figures: tuple[FigureGroup, ...] = ()  # groups of figures that measures need of the motion
    level: str | None = None  # what to run on
    threads: int | None = None  # how many threads
    surroundings: Surroundings | None = None  # what parts must keep away from, for measures of space
    duties: Any = None  # tasks and drives, where there are any: `Duties` of `task_measures`
    samples: Samples = field(init=False)

    def __post_init__(self) -> None:
        load = None if self.wrench is None else Load(self.wrench, self.motion.start).over(self.motion.time)
        object.__setattr__(self, "wrench", load)
        object.__setattr__(self, "samples", samples_of(self.motion, load))

    @cached_property
    def cases(self) -> tuple[LoadCase, ...]:
        """Parts of the tasks, where these are what all designs do."""
        return () if self.duties is None else tuple(self.duties.cases(self))

    @cached_property
    def forces(self) -> DesignEvaluation:
        """Figures of forces over the motion."""
        return DesignEvaluation(
            self.motion, self.wrench, self.figures, (), level=self.level, threads=self.threads
        )

    @cached_property
    def slopes(self) -> DesignEvaluation:
        """The same with derivatives by all variables."""
        return DesignEvaluation(
            self.motion, self.wrench, self.figures, self.of_machine, level=self.level, threads=self.threads
        )

    @cached_property
    def of_machine(self) -> tuple[str, ...]:
        """Names of the variables that are columns of designs: all but those of drives."""
        return tuple(name for name in self.names if not name.startswith(DRIVE))

    def columns(self, values: FloatArray) -> dict[str, FloatArray]:
        """Return the columns of designs from rows of variables, (D,) each; at least one."""
        found: dict[str, FloatArray] = {}
        for name, value in self.fixed.items():
            found[name] = np.full(len(values), value)
        found |= {
            name: np.ascontiguousarray(values[:, i])
            for i, name in enumerate(self.names)
            if name in self.of_machine
        }
        return found or {LENGTHS[0]: np.full(len(values), self.machine.geometry.r)}

    def designs(self, values: FloatArray) -> Designs:
        """Return designs from rows of variables, (D, n)."""
        return Designs(self.columns(values), self.machine, self.bodies)


_NONE = np.zeros((1, 1))  # how results change with what is no column


class Numbers:
    """Lengths, sizes of solids and the numbers of the dynamics of some designs, each (D, 1)."""

    def __init__(self, setting: Setting, columns: Mapping[str, Any]) -> None:
        self._setting, self._columns = setting, columns

    def __getitem__(self, name: str) -> Any:
        """Return a length or an offset by its full name, (D, 1) or a number."""
        if name in self._columns:
            return self._columns[name][:, None]
        if name in LENGTHS:
            return getattr(self._setting.machine.geometry, name[-1])
        return 0.0

    def named(self, name: str) -> Any:
        """Return any column by its full name, (D, 1) or a number: that of the machine where there is none."""
        if name in self._columns or name in LENGTHS or name in OFFSETS:
            return self[name]
        if name in SIZES:
            return self.size(name.partition(".")[2])
        machine, members = self._setting.machine, set(members_of(name))
        others = {column: set(members_of(column)) & members for column in self._columns}
        for column, shared in others.items():
            if shared == members:
                return self[column]
        solids = self._setting.bodies == "solids" and name.startswith((DENSITY, "bodies."))
        if name == DENSITY and solids and len(set(machine.density.values())) == 1:
            return self.density
        if solids or name == DENSITY:
            raise InputError(f"{name}: has no number of its own: expected it in variables or in fixed")
        apart = [column for column, shared in others.items() if shared]
        if apart or len({number_in(machine, member) for member in members}) > 1:
            raise InputError(f"{name}: stands for several numbers, which differ: expected one of them")
        return number_in(machine, name)

    @property
    def r(self) -> Any:
        """Size of the platform [m]."""
        return self["geometry.r"]

    @property
    def R(self) -> Any:  # noqa: N802 - as of `Geometry`
        """Size of the base [m]."""
        return self["geometry.R"]

    @property
    def L(self) -> Any:  # noqa: N802 - as of `Geometry`
        """Length of the legs [m]."""
        return self["geometry.L"]

    @property
    def b(self) -> Any:
        """Half of the width of the parallelogram [m]."""
        return self["geometry.b"]

    @property
    def density(self) -> Any:
        """Of the solids of legs and rods [kg/m³]."""
        own = self._setting.machine.density["leg"]
        return self._columns[DENSITY][:, None] if DENSITY in self._columns else own

    def size(self, name: str) -> Any:
        """Return a size of solids, such as ``rod_radius`` [m]."""
        if self._setting.bodies != "solids":
            raise InputError(
                f"the {name.replace('_', ' ')} is known of bodies of solids only: bodies='solids'"
            )
        full = f"dimensions.{name}"
        if full in self._columns:
            return self._columns[full][:, None]
        if name in (own := self._setting.machine.dimensions):
            return own[name]
        L, r, b, width = scales(self.r, self.R, self.L, self.b)
        ratio = np.minimum(np.minimum(np.minimum(L, r), b), width)
        return ratio * getattr(Dimensions(), name)

    @cached_property
    def folded(self) -> Folded:
        """The numbers of the dynamics."""
        folding = folding_of(tuple(self._columns), self._setting.machine, self._setting.bodies)
        return folding.fold(self._columns)

    @cached_property
    def model(self) -> Model:
        """The machines of the reduced dynamics, each number (D, 1)."""
        numbers = [n[:, None] if isinstance(n, np.ndarray) and n.ndim else n for n in self.folded.numbers]
        return Model.of_numbers(tuple(numbers[: len(MODEL)]))


class Population:
    """Some designs of a problem."""

    def __init__(self, setting: Setting, values: FloatArray) -> None:
        self.setting, self.values = setting, values
        self.columns = setting.columns(values)
        self._rates: dict[str, Outputs] = {}

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def designs(self) -> Designs:
        """The machines."""
        return Designs(self.columns, self.setting.machine, self.setting.bodies)

    @cached_property
    def forces(self) -> DesignForces:
        """What they need over the motion."""
        return self.setting.forces.evaluate(self.designs)

    @cached_property
    def slopes(self) -> DesignForces:
        """The same with derivatives by all variables."""
        return self.setting.slopes.evaluate(self.designs)

    @cached_property
    def numbers(self) -> Numbers:
        """Lengths and sizes."""
        return Numbers(self.setting, self.columns)

    @cached_property
    def cases(self) -> tuple[Population, ...]:
        """The same designs over each part of the tasks."""
        return tuple(Population(case.setting, self.values) for case in self.setting.cases)

    @cached_property
    def status(self) -> NDArray[np.uint8]:
        """Which designs make the motion, or all tasks, and why not (D,): `DesignStatus`."""
        if not self.cases:
            return np.asarray(self.forces.status)
        return np.asarray(np.max([part.forces.status for part in self.cases], axis=0))

    def stepped(self, name: str) -> Numbers:
        """Return lengths and sizes with a complex step of one variable."""
        if name not in self.columns:
            return self.numbers
        moved = self.columns[name] + 1j * STEP
        return Numbers(self.setting, {**self.columns, name: moved})

    @cached_property
    def feasible(self) -> Any:
        """Which designs make the motion (D,)."""
        return self.status == 0

    @cached_property
    def sampled(self) -> Sampled:
        """Forces, slider positions and speeds at all samples of the motion (D, N)."""
        return sampled(self.numbers.folded, self.setting.samples, self._offsets)

    @property
    def _offsets(self) -> FloatArray:
        none = np.zeros(len(self))
        return np.stack([self.columns.get(name, none) for name in OFFSETS], axis=1)

    def rates(self, name: str) -> Outputs:
        """Return how forces, slider positions and speeds change with one variable (D, N)."""
        if name not in self.columns:
            return Outputs((_NONE,) * 3, (_NONE,) * 3, (_NONE,) * 3, _NONE)
        if name not in self._rates:
            setting = self.setting
            folding = folding_of(tuple(self.columns), setting.machine, setting.bodies)
            by = [
                rate[:, None] if isinstance(rate, np.ndarray) and rate.ndim else rate
                for rate in folding.tangents(self.columns, name)
            ]
            moved = tuple(float(name == offset) for offset in OFFSETS)
            state = self.sampled
            with np.errstate(all="ignore"):
                self._rates[name] = derivatives(state.numbers, state.inputs, by, moved)
        return self._rates[name]


Better: TypeAlias = Literal["small", "large"]
"""Whether small or large numbers of a measure are good; its worst piece is the other end."""


Over: TypeAlias = Literal["", "worst", "rms", "sum", "task"]
"""How a measure of a task follows from its parts, or as a whole (``"task"``); empty if not of tasks."""


class Pieces:
    """The pieces of a measure, and their derivatives by all variables of the problem.

    `gradients`: by the variables, in SI units; a function that returns them is called when they are asked
    for.
    """

    def __init__(self, values: FloatArray, gradients: FloatArray | Callable[[], FloatArray]) -> None:
        self.values, self._gradients = values, gradients

    @cached_property
    def gradients(self) -> FloatArray:
        """Derivatives by the variables, (D, P, n)."""
        return self._gradients() if callable(self._gradients) else self._gradients


@runtime_checkable
class Measure(Protocol):
    """A number of a design. Objects of any class with these doors will do, if they can be pickled."""

    @property
    def name(self) -> str:
        """What it is called in tables and files."""

    @property
    def unit(self) -> str:
        """Its SI unit; empty for plain numbers."""

    @property
    def better(self) -> Better:
        """Whether small or large is good."""

    @property
    def figures(self) -> tuple[FigureGroup, ...]:
        """Groups of figures over the motion that it needs beside the forces."""

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,); NaN where there is none."""

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""


@dataclass(frozen=True)
class OfDesigns:
    """What is known of a measure that has a name here."""

    name: str  # as of `Measure`
    unit: str
    better: Better
    about: str  # what it is, in a line
    figures: tuple[FigureGroup, ...] = field(default=(), kw_only=True)
    over: Over = field(default="", kw_only=True)


@dataclass(frozen=True)
class ClosedForm(OfDesigns):
    """A measure that is a formula of the numbers of designs, differentiated by complex steps."""

    formula: Callable[[Numbers, Population], Any]
    """From `Numbers` and `Population` to pieces (D, P): analytic in the numbers."""

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        with np.errstate(all="ignore"):
            found = np.asarray(self.formula(population.numbers, population), dtype=np.float64)
        found = np.broadcast_to(found, (len(population), found.shape[-1]))
        return worst_of(found, self.better)

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        with np.errstate(all="ignore"):
            values = np.asarray(self.formula(population.numbers, population), dtype=np.float64)
        shape = (len(population), values.shape[-1])
        return Pieces(np.broadcast_to(values, shape), partial(self._gradients, population, shape))

    def _gradients(self, population: Population, shape: tuple[int, int]) -> FloatArray:
        with np.errstate(all="ignore"):
            moved = [
                np.imag(self.formula(population.stepped(name), population)) / STEP
                for name in population.setting.names
            ]
        return np.stack([np.broadcast_to(each, shape) for each in moved], axis=-1)


@dataclass(frozen=True)
class FunctionMeasure(Readable):
    """A measure by a function of one's own.

    Parameters
    ----------
    name, unit, better
        As of `Measure`.
    function : callable
        Called with `Designs` and with the full names of the variables. Returns values (D,) or pieces (D, P),
        and derivatives (D, n) or (D, P, n) by the variables, or None in their place where no names are given
        (``()``): then only values are needed.
    figures : tuple
        As of `Measure`.

    Raises
    ------
    InputError
        If `better` is neither ``"small"`` nor ``"large"``.
    """

    name: str
    unit: str
    function: Callable[[Designs, tuple[str, ...]], tuple[FloatArray, FloatArray | None]]
    better: Better = "small"
    figures: tuple[FigureGroup, ...] = field(default=())

    def __post_init__(self) -> None:
        if self.better not in ("small", "large"):
            raise InputError(f"better: expected 'small' or 'large', got {shown(self.better)}")

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        found = np.asarray(self.function(population.designs, ())[0], dtype=np.float64)
        self._require(found.shape[:1] == (len(population),) and found.ndim <= 2, found.shape)
        return found if found.ndim == 1 else worst_of(found, self.better)

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        names = population.setting.of_machine
        values, gradients = self.function(population.designs, names)
        if gradients is None:
            raise InputError(f"{self.name}: expected derivatives by {', '.join(names)}, got None")
        values = np.asarray(values, dtype=np.float64).reshape(len(population), -1)
        expected = (*values.shape, len(names))
        found = np.asarray(gradients, dtype=np.float64)
        self._require(found.size == np.prod(expected), found.shape)
        whole = np.zeros((*values.shape, len(population.setting.names)))
        whole[..., [population.setting.names.index(name) for name in names]] = found.reshape(expected)
        return Pieces(values, whole)

    def _require(self, fits: bool, shape: tuple[int, ...]) -> None:
        if not fits:
            raise InputError(f"{self.name}: expected a number for each design, got the shape {shape}")


def worst_of(pieces: FloatArray, better: Better) -> FloatArray:
    """Return the worst of pieces (D, P) of each design, (D,)."""
    found: FloatArray = pieces.max(axis=1) if better == "small" else pieces.min(axis=1)
    return found


def worst_gradient(pieces: Pieces, better: Better) -> FloatArray:
    """Return the derivatives of the worst of pieces, (D, n): where two tie, those of the first."""
    at = pieces.values.argmax(axis=1) if better == "small" else pieces.values.argmin(axis=1)
    found: FloatArray = np.take_along_axis(pieces.gradients, at[:, None, None], axis=1)[:, 0]
    return found
