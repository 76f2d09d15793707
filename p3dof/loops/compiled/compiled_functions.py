"""`CompiledFunctions`: the functions of one robot, traced and compiled when they are first used."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array, shown
from p3dof._base.errors import InputError, ModelWarning
from p3dof._base.threads import thread_count
from p3dof.loops.closed_tree import CLOSED, External
from p3dof.loops.compiled import build
from p3dof.loops.compiled.function import BoundFunction, Function, Kernel
from p3dof.loops.compiled.functions import FUNCTIONS
from p3dof.loops.compiled.printing import lanes_source
from p3dof.loops.compiled.results import Tangents
from p3dof.loops.compiled.robot import CompiledRobot, closed_configurations, regular_of, robot_of
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.minimal import coordinate_names

_DIRECTIONS = 65_536  # samples times directions that are done at a time


class CompiledFunctions:
    """The functions of one robot, traced and compiled when first used; arguments as of `CompiledLoop`."""

    def __init__(
        self,
        loop: LoopModel,
        around: ArrayLike | None = None,
        external: Iterable[str] = (),
        joint_forces: bool = False,
        inertias: Iterable[str] = (),
        level: str = "auto",
        threads: int | None = None,
        given: Sequence[int] | None = None,
        idle: Sequence[Mapping[int, float]] = (),
    ) -> None:
        if level not in (*build.LEVELS, "numpy"):
            raise InputError(
                f"level: expected one of {', '.join((*build.LEVELS, 'numpy'))}, got {shown(level)}"
            )
        if level != "numpy" and build.compiler() is None:
            warnings.warn(
                "no C compiler (gcc or clang) on the path: NumPy computes the same, more slowly",
                ModelWarning,
                stacklevel=3,
            )
            level = "numpy"
        self.level = level  # instructions that are used
        self._loop, self._threads = (loop.copy(), thread_count(threads))
        start = _configurations(self._loop, around, given is None)
        self._around = start
        self._robot = robot_of(self._loop, start, external, joint_forces, inertias, given, idle)
        self.followed: tuple[int, ...] = self._robot.independent if given is None else tuple(given)
        """Places in v of the coordinates whose values give a configuration."""
        self._given = self._robot.motors if given is None else self.followed
        names = coordinate_names(self._loop.model)
        self.independent: tuple[str, ...] = tuple(names[i] for i in self._robot.independent)
        """Coordinates whose speeds the others follow from: joints, or single freedoms such as ``base[2]``."""
        self.external: tuple[str, ...] = tuple(load.name for load in self._robot.loads)
        """Frames on which external wrenches act."""
        self.kept: dict[object, object] = {}  # what others make of it and keep, by keys of their own
        self._making = threading.RLock()  # once, whoever asks meanwhile
        self._functions: dict[str, Function] = {}
        self._kernels: dict[str, Kernel] = {}
        self._defaults = self._robot.defaults

    def __repr__(self) -> str:
        names = ", ".join(self.independent)
        return f"CompiledLoop({self._loop.model.name!r}, level={self.level!r}, independent=[{names}])"

    def is_of(self, loop: LoopModel) -> bool:
        """Return whether a robot is the one that was compiled, as it was then.

        Parameters
        ----------
        loop : LoopModel
            The robot.
        """
        return bool(loop.model == self._loop.model) and loop.sidecar == self._loop.sidecar

    def margin(self, q: ArrayLike) -> float:
        """Return how far q is from where the partition fails: the smallest pivot over its usual value.

        Parameters
        ----------
        q : (nq,) array
            Configuration.

        Raises
        ------
        InputError
            If `q` has the wrong shape or is not finite.
        """
        q = frozen_array("q", q, (self._loop.model.nq,))
        function = self.function("step")
        with np.errstate(all="ignore"):
            return float(function.on_arrays(*q)[function.outputs["q"]])  # what comes behind q

    def operations(self, name: str = "inverse_dynamics") -> int:
        """Return how many additions, products and so on a sample takes.

        Parameters
        ----------
        name : str
            One of the functions that can be bound, see `bind`.

        Raises
        ------
        InputError
            If there is no such function.
        """
        return self.function(name).operations

    def bind(self, name: str = "inverse_dynamics") -> BoundFunction:
        """Return a function of one sample that reads and writes arrays of its own, for a loop at kHz.

        Parameters
        ----------
        name : str
            ``inverse_dynamics``, ``hybrid_dynamics``, ``forward_dynamics``, ``motion`` (velocity,
            acceleration
            and forces from those of the independent speeds), ``step`` (one of Newton's method), ``integrate``
            (a configuration moved by a small rate), ``tangent_of_forces``, ``tangent_of_accelerations``.

        Raises
        ------
        InputError
            If there is no such function.
        """
        bound = self._kernel(name).bound()
        for key, value in self._defaults.items():
            if key in bound.inputs:
                bound.inputs[key][:] = value
        return bound

    @property
    def defaults(self) -> dict[str, FloatArray]:
        """What acts, and inertial parameters, where a call says nothing of them; by the names of inputs."""
        return dict(self._defaults)

    @property
    def robot(self) -> CompiledRobot:
        """What the formulas need of the robot."""
        return self._robot

    @property
    def independent_places(self) -> tuple[int, ...]:
        """Places of the independent speeds in v."""
        return self._robot.independent

    @property
    def determined(self) -> bool:
        """Whether the actuated joints determine the motion, one by one."""
        return set(self._robot.independent) == set(self._robot.motors)

    @property
    def hybrid(self) -> bool:
        """Whether accelerations of the actuated joints can be prescribed: none depends on the others."""
        return set(self._robot.motors) <= set(self._robot.independent)

    @property
    def unique(self) -> bool:
        """Whether forces and multipliers are determined: no closure is redundant, and no actuator spare."""
        return self.hybrid and len(self._robot.plan.pivots) == self._robot.kinematics.size

    def follow_places(self) -> list[tuple[int, bool, int]]:
        """Return place in q, whether it turns without end, and motor of each coordinate that is followed."""
        parts = {place: part for part in self._robot.tree.parts[1:] for place in part.v}
        return [(parts[i].q[0], parts[i].kind == "unbounded", self._given.index(i)) for i in self.followed]

    @property
    def length(self) -> float:
        """The robot's own unit of length where it is smaller than a metre, else one [m]."""
        return self._robot.length

    @property
    def slides(self) -> list[bool]:
        """Whether each coordinate that is followed is a length."""
        parts = {place: part for part in self._robot.tree.parts[1:] for place in part.v}
        return [parts[i].kind == "prismatic" for i in self.followed]

    def rows(self, name: str, inputs: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return all outputs (N, size) of a function at many samples; nothing is checked.

        Parameters
        ----------
        name : str
            One of those that can be bound, see `bind`.
        inputs : mapping of str to (N, size) or (size,) array
            ``q``, which has N rows, and what else the function takes; what is not given is as by default.
        """
        given = {**self._defaults, **inputs}
        return self._run(name, {key: given[key] for key in self.function(name).inputs})

    def function(self, name: str) -> Function:
        """Return a function as it was traced.

        Parameters
        ----------
        name : str
            One of those that can be bound, see `bind`.

        Raises
        ------
        InputError
            If there is no such function.
        ModelError
            If it has too many operations.
        """
        if name not in tuple(FUNCTIONS):
            raise InputError(f"name: expected one of {', '.join(FUNCTIONS)}, got {shown(name)}")
        with self._making:
            if name not in self._functions:
                self._functions[name] = FUNCTIONS[name](self._robot)
            return self._functions[name]

    def _kernel(self, name: str) -> Kernel:
        with self._making:
            if name not in self._kernels:
                function = self.function(name)
                library = None
                if self.level != "numpy":
                    (library,) = build.libraries([lanes_source([function])], self.level)
                self._kernels[name] = Kernel(function, library)
            return self._kernels[name]

    def _run(self, name: str, inputs: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return self._kernel(name)(len(inputs["q"]), inputs, self._threads)

    def _rows(self, given: Mapping[str, tuple[ArrayLike, int]]) -> tuple[dict[str, FloatArray], bool]:
        """Return the inputs of N samples, and whether there was one without that axis."""
        single = np.ndim(given["q"][0]) == 1
        found: dict[str, FloatArray] = {}
        for name, (value, size) in given.items():
            array = as_floats(name, value)
            if single:
                array = array[None]
            # Numbers that are not finite are no reason to stop: the general layer tells of their samples.
            rows = len(next(iter(found.values()))) if found else len(array)
            if array.shape != (rows, size):
                told = (size,) if single else ("N" if not found else rows, size)
                raise InputError(f"{name}: expected shape {told}, got {np.shape(value)}")
            found[name] = array
        return found, single

    def _load(
        self,
        count: int,
        external: External | None,
        joint_forces: ArrayLike | None,
        inertias: Mapping[str, ArrayLike] | None = None,
    ) -> dict[str, FloatArray]:
        """Return the inputs besides the motion: what is not given is as the robot has it."""
        for what, values in (("external", external), ("inertias", inertias)):
            if values is not None and not isinstance(values, Mapping):
                raise InputError(
                    f"{what}: expected a mapping of names to arrays, got {type(values).__name__}"
                )
        found = dict(self._defaults)
        given: dict[str, ArrayLike] = {f"wrench_{name}": value for name, value in (external or {}).items()}
        given |= {f"inertia_{name}": value for name, value in (inertias or {}).items()}
        if joint_forces is not None:
            given["joint_forces"] = joint_forces
        for name, value in given.items():
            if name not in found:
                raise InputError(
                    f"{name.replace('_', ' ')}: it was not compiled for that; it takes "
                    f"{', '.join(key.replace('_', ' ') for key in found) or 'nothing'}"
                )
            size = len(self._defaults[name])
            found[name] = frozen_array(name, value, (size,) if np.ndim(value) == 1 else (count, size))
        return found

    def _alone(
        self, i: int, load: Mapping[str, FloatArray]
    ) -> tuple[LoopModel, tuple[dict[str, FloatArray], FloatArray | None]]:
        """Return the general robot of a sample, and what acts on it."""
        row = {name: value if value.ndim == 1 else value[i] for name, value in load.items()}
        loop = self._robot.with_inertias(self._loop, row)
        forces = {name.removeprefix("wrench_"): x for name, x in row.items() if name.startswith("wrench_")}
        return loop, (forces, row.get("joint_forces"))

    def _tangents(
        self, name: str, given: Mapping[str, FloatArray], load: Mapping[str, FloatArray], seeds: Sequence[str]
    ) -> Tangents:
        """Return derivatives: every sample as many times as there are directions, side by side."""
        count, function = len(given["q"]), self.function(name)
        widths = [function.inputs[seed] for seed in seeds]
        total, edges = sum(widths), np.cumsum([0, *widths]).tolist()
        directions, parts = np.eye(total), []
        for start in range(0, max(count, 1), _DIRECTIONS // max(total, 1) + 1):
            block = slice(start, start + _DIRECTIONS // max(total, 1) + 1)
            rows = len(given["q"][block])
            inputs = {key: np.repeat(x[block], total, axis=0) for key, x in given.items()}
            inputs |= {
                key: np.repeat(x[block], total, axis=0) if x.ndim == 2 else x for key, x in load.items()
            }
            for seed, (first, stop) in zip(seeds, pairwise(edges), strict=True):
                inputs[seed] = np.tile(directions[:, first:stop], (rows, 1))
            found = self._run(name, inputs)
            parts.append({key: x.reshape(rows, total, x.shape[1]) for key, x in found.items()})
        joined = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
        return Tangents(joined, edges)


def _configurations(loop: LoopModel, around: ArrayLike | None, by_motors: bool) -> list[FloatArray]:
    """Return configurations that pivots are chosen for; those that the motors move, if they are to."""
    if around is None:
        return closed_configurations(loop, loop.regular_configuration)
    rows = frozen_array("around", np.atleast_2d(as_floats("around", around)), ("K", loop.model.nq))
    if not len(rows):
        raise InputError("around: expected at least one configuration")
    gaps = [np.abs(loop.closure_error(q)).max(initial=0.0) for q in rows]
    if max(gaps) > CLOSED:
        raise InputError(f"around: configuration {int(np.argmax(gaps))} is open by {max(gaps):.3g} m or rad")
    several = [np.array(q) for q in rows]
    if len(rows) > 1 and not by_motors:
        return several
    near = closed_configurations(loop, several[0])
    if len(rows) == 1:
        return near
    near, regular = regular_of(loop, near, several)
    return regular or near  # as for one: where all are singular, regular ones beside them
