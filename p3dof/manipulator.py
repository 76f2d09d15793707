"""`Manipulator`: one machine, with its kinematics, its dynamics and all else behind a few calls."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, batch_of, warn_caller
from p3dof._base.errors import InputError
from p3dof._base.outputs import result_in
from p3dof._base.samples import OnInvalid
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled import MachineKernels
from p3dof.closed_form.kinematics import InverseKinematics, MechanismMotion, Singularity
from p3dof.machine.motion import Motion, States, WrenchHistory, WrenchOverTime, states_of, states_over
from p3dof.machine.parameters import PAPER, Limits, Parameters, machine_html, read_parameters
from p3dof.methods import DEFAULT_METHOD, InverseDynamics, Method, compiled, with_evidence, without_crossings
from p3dof.methods.compiled import ForceDerivatives
from p3dof.methods.registry import TOLERANCE, ManipulatorModel, equation_terms
from p3dof.runs.settings import AT_HOME, CONTINUOUS, KINDS, PRECISE, ControlLoop, InitialState, Integration

if TYPE_CHECKING:  # what is imported when it is asked for
    from p3dof.analysis.energy import Energy
    from p3dof.analysis.indices import Indices
    from p3dof.analysis.load_friction import LoadFriction, LoadFrictionEffect
    from p3dof.analysis.reactions import AnyReactions, Choice, Reactions, ReactionsComparison, Stiffness, Way
    from p3dof.analysis.workspace import Workspace, WorkspaceMargins
    from p3dof.loops import ClosedLoopModel
    from p3dof.machine import description
    from p3dof.methods.comparison import Comparison
    from p3dof.methods.regressor import ForceRegressor
    from p3dof.runs import ControllerLike, Event, PreparedRun, Simulation
    from p3dof.runs.many import ManyRuns


def load(
    parameters: Parameters | str | os.PathLike[str] | None = None, any_size: bool = False
) -> Manipulator:
    """Return the manipulator with the given parameters.

    Parameters
    ----------
    parameters : Parameters or path-like, optional
        The machine, or a parameter file; the paper's by default.
    any_size : bool
        Take a file whose machine is larger than 20 m or smaller than 1 mm too. Lengths are in metres, and
        such a file is usually one in millimetres. `Parameters` that are given may have any size.

    Raises
    ------
    ParameterError, FileError
        If the file cannot be read or is not right.
    InputError
        If `parameters` is something else.
    """
    if not isinstance(parameters, str | os.PathLike):
        return Manipulator(parameters)
    return Manipulator(read_parameters(parameters, any_size))


_WATCHED, _ROWS = 1000, 64
"""In how many calls the units of poses and loads are watched, and of how many rows of each."""
_MUCH = 10
"""How many times what the machine reaches, or its actuators bear, is taken for another unit."""
_UNITS = (("m: mm", "rad: degrees"), ("m/s: mm/s", "rad/s: degrees/s"), ("N: mN", "N m: N mm"))
"""Of poses, velocities, and loads: the units there are, and those that large numbers seem to be in."""


class Manipulator:
    """The 3-DOF spatial parallel manipulator: parameters, model, kinematics and dynamics.

    Poses are (y [m], z [m], θ [rad]), zero at home; sliders and forces are ordered A, B, C, positive along
    +z0. Arrays may have any leading batch dimensions, which broadcast. Any number of threads may use an
    instance at once.

    Parameters
    ----------
    parameters : Parameters, optional
        The machine; the paper's by default.

    Notes
    -----
    Arguments of the methods:

    pose, velocity, acceleration : array-like, shape (..., 3)
        Of (y, z, θ): [m, m, rad] and per second, per second².
    motion : Motion
        The motion of the platform, N samples.
    forces : array-like, shape (..., 3)
        Of the actuators on their sliders [N].
    wrench : array-like, shape (6,) or (..., 6), optional
        External force and moment on the platform at P, in the fixed frame [N, N m]. Over a motion or a run it
        may be a function of one time or of many too, such as a `p3dof.WrenchHistory`.
    on_invalid : {"raise", "nan"}
        Raise for samples that are not finite, out of reach or, where forces are asked for, actuation-singular
        or beyond a singularity; or leave NaN in their rows.
    out : ndarray, optional
        Where to write the result, as in NumPy: an array of float64 of its shape with any strides, which
        shares no memory with an input; it is returned. After an error in the states it holds NaN. For results
        that are no arrays, an earlier result of the same shape.
    method : {"pinocchio", "virtual-power", "compiled"}
        RNEA and loop closures in Pinocchio, sample by sample; the paper's formulas, vectorised; or the
        compiled kernels, which are the fastest by far.
    progress : callable, optional
        Called with (done, total) during long work.

    They raise `ReachError`, `SingularityError` or `SampleError` for the first invalid sample, naming it and
    how many there are, and `InputError` for arguments that do not fit.
    """

    def __init__(self, parameters: Parameters | None = None) -> None:
        self._model = ManipulatorModel(PAPER if parameters is None else parameters)
        self._watched, self._told = _WATCHED, set[str]()

    @cached_property
    def _most(self) -> list[tuple[FloatArray, tuple[str, str]]]:
        """How large pose, velocity and load are at most in their units; those, and the likely other ones."""
        g, limits = self._model.parameters.geometry, self._model.parameters.limits
        travel, tilt = max(map(abs, limits.travel)), max(np.pi, *map(abs, limits.tilt))
        reach, speed, force = (_MUCH * most for most in (travel + g.L + g.r, limits.speed, limits.force))
        pairs = (reach, tilt), (speed, speed / g.r), (3 * force, force * (g.R + g.L))
        axes = (2, 1), (2, 1), (3, 3)
        return list(zip(map(np.repeat, pairs, axes), _UNITS, strict=True))

    def _watch(self, pose: Any, velocity: Any = None, *, wrench: Any = None) -> None:
        """Warn of what of pose, velocity and load seems in another unit, once each; at the first calls.

        Only of the velocity of a single state: batches also come from searches that try any speed.
        """
        if not self._watched:
            return
        self._watched -= 1
        told = []
        for given, (most, units) in zip((pose, velocity, wrench), self._most, strict=True):
            if given is None or (given is velocity and np.ndim(given) > 1):
                continue
            rows: FloatArray = np.asarray(given).reshape(-1, len(most))
            rows = np.abs(rows[:: -(len(rows) // _ROWS + 1)])  # the last one, too
            if (rows <= most).all():
                continue
            sizes = np.where(np.isfinite(rows) & (rows > most), rows, 0.0).max(axis=0, initial=0.0)
            linear = len(most) - len(most) // 2
            for size, unit in zip((sizes[:linear].max(), sizes[linear:].max()), units, strict=True):
                if size > 0 and unit not in self._told:
                    self._told.add(unit)
                    told.append(f"{size:g} {unit}?")
        if told:
            warn_caller(f"beyond what the machine can do ({', '.join(told)}): units are m, rad, s, N and N m")

    def _states(self, pose: ArrayLike, *motion: ArrayLike, **others: Any) -> States:
        states = states_of(pose, *motion, **others)
        self._watch(states.pose, states.velocity, wrench=states.wrench)
        return states

    # No `__getattr__` that suggests names, as of results: all attributes would be slower, and Python does so.

    def __repr__(self) -> str:
        g, mass = self.parameters.geometry, self.parameters.bodies.mass
        return f"{type(self).__name__}(r={g.r:g}, R={g.R:g}, L={g.L:g}, moving mass {mass:g} kg)"

    def _repr_html_(self) -> str:
        return machine_html(self.parameters, type(self).__name__)

    def __reduce__(self) -> tuple[type[Manipulator], tuple[Parameters]]:
        return type(self), (self.parameters,)

    # What it is made of

    @property
    def parameters(self) -> Parameters:
        """The machine; make another `Manipulator` for another one."""
        return self._model.parameters

    @property
    def mechanism(self) -> description.Mechanism:
        """The neutral description: links, joints, closures, solids."""
        return self._model.mechanism

    @property
    def urdf(self) -> str:
        """The URDF of the tree for any reader, every link with a mass; `ModelError` if one is too light."""
        return self._model.urdf

    @property
    def exact_urdf(self) -> str:
        """The URDF of the tree with the bodies just as the parameters have them, massless ones included."""
        return self._model.exact_urdf

    @property
    def sidecar(self) -> str:
        """The loop closures and actuated joints that belong to the URDF, as YAML."""
        return self._model.sidecar

    @property
    def kernels(self) -> MachineKernels:
        """The compiled kernels, or what stands in for them; others can be put in their place."""
        return self._model.kernels

    @kernels.setter
    def kernels(self, kernels: MachineKernels) -> None:
        self._model.use(kernels)

    @property
    def loop(self) -> ClosedLoopModel:
        """The mechanism as a general closed-loop model on Pinocchio, with the forces of this machine.

        What acts in its joints, counterbalances and friction, is in its `Sidecar`. Friction of joints at
        which loops are cut is entered where a joint of the tree turns as fast: of ``hinge_lower_right`` in
        ``hinge_right``, of the universal joints about x0 in ``hinge_a`` and ``hinge_b``. No joint turns as
        they do about y0: their viscous friction there is a bushing between base and platform, which has no
        rates within 0.5° of θ = ±90°; of their Coulomb friction about y0 there is nothing, as a
        `ModelWarning` tells. `bare_loop` has neither friction nor counterbalances.
        """
        return self._model.loop

    @property
    def bare_loop(self) -> ClosedLoopModel:
        """The same without counterbalances and friction: bodies and the inertia of motors alone."""
        return self._model.bare_loop

    @property
    def model(self) -> Any:
        """The tree as a `pinocchio.Model`."""
        return self.bare_loop.model

    @property
    def constraint_models(self) -> Any:
        """The loop closures as `pinocchio.StdVec_ConstraintModel`."""
        return self.bare_loop.constraint_models

    @property
    def visual_model(self) -> Any:
        """The visible solids as a `pinocchio.GeometryModel`."""
        return self._model.visual_model

    @property
    def collision_model(self) -> Any:
        """The solids for collision checks as a `pinocchio.GeometryModel`."""
        return self._model.collision_model

    # Kinematics

    def inverse_kinematics(
        self, pose: ArrayLike, *, on_invalid: OnInvalid = "raise", out: InverseKinematics | None = None
    ) -> InverseKinematics:
        """Return sliders and passive angles at poses, in closed form: `p3dof.closed_form.kinematics`."""
        return kinematics.inverse_kinematics(self.parameters.geometry, pose, on_invalid, out)

    def forward_kinematics(
        self,
        sliders: ArrayLike,
        *,
        all_modes: bool = False,
        on_invalid: OnInvalid = "raise",
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Return the poses (..., 3) at positions of the `sliders` (..., 3) [m].

        With `all_modes`, all four assembly modes (..., 4, 3), the working one first, NaN where one does not
        exist.
        """
        one = None if all_modes else self._model.methods["compiled"].one
        if one is not None and (pose := one.poses(out, sliders, on_invalid)) is not None:
            return pose
        positions = batch_of("sliders", sliders, 3)
        shape = (*positions.shape[:-1], 4, 3) if all_modes else positions.shape
        geometry = self.parameters.geometry

        def modes(_: FloatArray | None) -> FloatArray:
            return kinematics.forward_kinematics(geometry, positions, all_modes, on_invalid)

        poses = partial(compiled.poses, self.kernels, positions, on_invalid)
        return result_in(out, shape, [positions], modes if all_modes else poses)

    def sliders(
        self, pose: ArrayLike, *, on_invalid: OnInvalid = "raise", out: FloatArray | None = None
    ) -> FloatArray:
        """Return the slider positions (..., 3) [m] at poses by the kernels: for many calls or samples."""
        one = self._model.methods["compiled"].one
        if one is not None and (found := one.sliders(out, pose, on_invalid)) is not None:
            self._watch(pose)
            return found
        states = self._states(pose, on_invalid=on_invalid)
        return result_in(out, states.pose.shape, states, partial(compiled.sliders, self.kernels, states))

    def jacobian(
        self,
        pose: ArrayLike,
        *,
        on_invalid: OnInvalid = "raise",
        method: Method = DEFAULT_METHOD,
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Return J = ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3) [1, 1, m/rad]: slider per pose velocities."""
        dynamics = self._model.methods[method]
        one = dynamics.one
        if one is not None and (found := one.jacobian(out, pose, on_invalid)) is not None:
            self._watch(pose)
            return found
        states = self._states(pose, on_invalid=on_invalid)
        return result_in(out, (*states.shape, 3, 3), states, partial(dynamics.jacobian, states), row=2)

    def singularity(self, pose: ArrayLike) -> Singularity:
        """Return the margins of poses from both kinds of singularity; NaN where a pose is not finite."""
        return kinematics.singularity(self.parameters.geometry, pose)

    def indices(self, pose: ArrayLike, length: float | None = None, **options: Any) -> Indices:
        """Return performance indices at poses: `p3dof.Indices`, which has the `options`.

        `length` is the characteristic length of those that need one [m]; r without it.
        """
        from p3dof.analysis.indices import Indices

        return Indices(self, pose, length, **options)

    def workspace(self, limits: Limits | None = None, margins: WorkspaceMargins | None = None) -> Workspace:
        """Return where the machine can work, within `limits` (its own without it) and `margins`."""
        from p3dof.analysis.workspace import Workspace

        return Workspace(self, limits, margins)

    def mechanism_motion(
        self,
        motion: Motion | ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        *,
        on_invalid: OnInvalid = "raise",
    ) -> MechanismMotion:
        """Return the motion of every joint and body, in closed form: `p3dof.closed_form.kinematics`.

        Of a `Motion`, or of poses (..., 3) with velocities and accelerations.
        """
        pose: ArrayLike
        if not isinstance(motion, Motion):
            pose = motion
        elif velocity is None and acceleration is None:
            pose, velocity, acceleration = motion.pose, motion.velocity, motion.acceleration
        else:
            raise InputError("mechanism_motion: a motion has its own velocities and accelerations")
        if velocity is None or acceleration is None:
            raise InputError("mechanism_motion: expected a motion, or poses, velocities and accelerations")
        return kinematics.mechanism_motion(self.parameters.geometry, pose, velocity, acceleration, on_invalid)

    # Dynamics at states of motion

    def forces(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        *,
        wrench: ArrayLike | None = None,
        on_invalid: OnInvalid = "raise",
        method: Method = DEFAULT_METHOD,
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Return the actuator forces (..., 3) [N] at states of motion, without a time axis."""
        dynamics = self._model.methods[method]
        one = dynamics.one
        if one is not None:
            found = one.forces(out, pose, velocity, acceleration, wrench, on_invalid)
            if found is not None:
                if self._watched:
                    self._watch(pose, velocity, wrench=wrench)
                return found
        states = self._states(pose, velocity, acceleration, wrench=wrench, on_invalid=on_invalid)
        return result_in(out, states.pose.shape, states, partial(dynamics.forces, states))

    def forward_dynamics(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        forces: ArrayLike,
        *,
        wrench: ArrayLike | None = None,
        on_invalid: OnInvalid = "raise",
        method: Method = DEFAULT_METHOD,
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Return the acceleration of the platform under forces, (..., 3) [m/s², rad/s²]; also if singular."""
        dynamics = self._model.methods[method]
        one = dynamics.one
        if one is not None:
            found = one.accelerate(out, pose, velocity, forces, wrench, on_invalid)
            if found is not None:
                if self._watched:
                    self._watch(pose, velocity, wrench=wrench)
                return found
        states = self._states(pose, velocity, forces=forces, wrench=wrench, on_invalid=on_invalid)
        return result_in(out, states.pose.shape, states, partial(dynamics.accelerate, states))

    def mass_matrix(
        self,
        pose: ArrayLike,
        *,
        on_invalid: OnInvalid = "raise",
        method: Method = DEFAULT_METHOD,
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3) [kg, kg m, kg m²]."""
        dynamics = self._model.methods[method]
        one = dynamics.one
        if one is not None and (found := one.mass_matrix(out, pose, on_invalid)) is not None:
            self._watch(pose)
            return found
        states = self._states(pose, on_invalid=on_invalid)
        return result_in(out, (*states.shape, 3, 3), states, partial(dynamics.mass_matrix, states), row=2)

    def coriolis_matrix(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        *,
        on_invalid: OnInvalid = "raise",
        method: Method = "virtual-power",
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Return the Coriolis matrix C in y, z, θ, (..., 3, 3), with Ṁ - 2C skew.

        C times the pose's velocity are forces [N, N, N m]. By the paper's formulas and complex steps, or
        ``"compiled"``.
        """
        term = equation_terms(method).coriolis_matrix
        states = self._states(pose, velocity, on_invalid=on_invalid)
        return result_in(out, (*states.shape, 3, 3), states, partial(term, self, states), row=2)

    def gravity_forces(
        self,
        pose: ArrayLike,
        *,
        on_invalid: OnInvalid = "raise",
        method: Method = "virtual-power",
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Return the gradient of the potential energy by y, z, θ, (..., 3) [N, N, N m]; not by Pinocchio."""
        term = equation_terms(method).gravity_forces
        states = self._states(pose, on_invalid=on_invalid)
        return result_in(out, states.pose.shape, states, partial(term, self, states))

    def force_derivatives(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        *,
        wrench: ArrayLike | None = None,
        on_invalid: OnInvalid = "raise",
        out: ForceDerivatives | None = None,
    ) -> ForceDerivatives:
        """Return the actuator forces and their exact derivatives by pose, velocity and acceleration.

        The wrench stays when the motion changes.
        """
        one = self._model.methods["compiled"].one
        if out is None and one is not None:
            found = one.derivatives(pose, velocity, acceleration, wrench, on_invalid)
            if found is not None:
                return ForceDerivatives(found[..., 0], found[..., 1:4], found[..., 4:7], found[..., 7:])
        states = self._states(pose, velocity, acceleration, wrench=wrench, on_invalid=on_invalid)
        return compiled.inverse_dynamics_derivatives(self.kernels, states, out)

    def force_regressor(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        *,
        on_invalid: OnInvalid = "raise",
    ) -> ForceRegressor:
        """Return how the actuator forces depend on the parameters, in which most of them are linear.

        By the 21 base inertial parameters, the 100 of the bodies, the lengths and gravity, with friction and
        without external loads.
        """
        from p3dof.methods import regressor

        states = self._states(pose, velocity, acceleration, on_invalid=on_invalid)
        return regressor.force_regressor(self.parameters, states)

    # Over a motion

    def inverse_dynamics(
        self,
        motion: Motion,
        *,
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
        method: Method = DEFAULT_METHOD,
        progress: Progress | None = None,
        load_friction: LoadFriction | None = None,
        stiffness: Stiffness | None = None,
    ) -> InverseDynamics:
        """Return the actuator forces over a motion, with joints, closure error, power balance and warnings.

        Where it crosses a singularity between samples, those near by are invalid. With `load_friction` and
        `stiffness` it is the `result` of the method `load_friction`.
        """
        if load_friction is not None:
            return self.load_friction(
                motion,
                load_friction,
                wrench=wrench,
                on_invalid=on_invalid,
                method=method,
                progress=progress,
                stiffness=stiffness,
            ).result
        from p3dof.analysis.sampling import warnings_about

        dynamics, states = self._model.methods[method], states_over(motion, wrench, on_invalid)
        self._watch(motion.pose, wrench=states.wrench)
        solution, crossings = without_crossings(motion, dynamics.solve(states, progress), on_invalid)
        history = wrench if isinstance(wrench, WrenchHistory) else None
        examine = partial(warnings_about, self._model.parameters, wrench=history)
        actuators = self._model.parameters.actuators
        return with_evidence(method, motion, solution, states.wrench, crossings, examine, actuators=actuators)

    def load_friction(
        self,
        motion: Motion,
        friction: LoadFriction,
        *,
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
        method: Method = DEFAULT_METHOD,
        progress: Progress | None = None,
        stiffness: Stiffness | None = None,
    ) -> LoadFrictionEffect:
        """Return the forces over a motion with `friction` that grows with the loads of the joints.

        The loads are those of elastic joints with a `stiffness`: `p3dof.analysis.load_friction`. Not
        ``"compiled"``. `DynamicsError` if friction and loads do not settle: the machine would jam.
        """
        from p3dof.analysis.load_friction import over_motion
        from p3dof.analysis.sampling import warnings_about

        history = wrench if isinstance(wrench, WrenchHistory) else None
        return over_motion(
            self.bare_loop,
            self.parameters,
            self._model.methods[method],
            method,
            motion,
            friction,
            wrench=wrench,
            on_invalid=on_invalid,
            stiffness=stiffness,
            progress=progress,
            examine=partial(warnings_about, self.parameters, wrench=history),
        )

    def inverse_dynamics_derivatives(
        self,
        motion: Motion,
        *,
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
        out: ForceDerivatives | None = None,
    ) -> ForceDerivatives:
        """Return `force_derivatives` over a motion, (N, 3) and (N, 3, 3)."""
        states = states_over(motion, wrench, on_invalid)
        return compiled.inverse_dynamics_derivatives(self.kernels, states, out)

    def compare(
        self,
        motion: Motion,
        *,
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
        others: Iterable[str] = (),
        tolerance: float = TOLERANCE,
        progress: Progress | None = None,
    ) -> Comparison:
        """Return the forces by Pinocchio, virtual powers, kernels and `others`, with differences and verdict.

        `others` are engines of `p3dof.methods.engines.ENGINES`, or ``"all"``; `MissingExtraError` if one is
        not installed. `tolerance` is the largest difference that passes, as a share of the largest force; at
        least 1e-9 for all but the first two. Only samples that both methods refuse raise.
        """
        from p3dof.methods.comparison import compare

        return compare(self, motion, wrench, on_invalid, others, tolerance, lambda *_: nullcontext(progress))

    def refined(self, motion: Motion, *, wrench: WrenchOverTime = None) -> Motion:
        """Return a motion with as many samples as its peaks and its work need.

        Poses alone are followed along the curve through them, other motions between their samples. Twice as
        many would change no peak, RMS or work by more than .03 %. At most 4,001 samples, or four times those
        that there are: where that does not suffice, `InverseDynamics.warnings` says so.
        """
        from p3dof.analysis.sampling import refined

        return refined(self.parameters, motion, wrench)

    def remarks(self, motion: Motion, *, wrench: WrenchOverTime = None) -> tuple[str, ...]:
        """Return what there is to know about the samples of a motion: a part of its warnings."""
        from p3dof.analysis.sampling import remarks_on

        result = self.inverse_dynamics(motion, wrench=wrench, on_invalid="nan", method="compiled")
        return remarks_on(self.parameters, result, wrench)

    @overload
    def reactions(
        self,
        motion: Motion,
        joints: Literal["all"] = ...,
        *,
        wrench: WrenchOverTime = ...,
        on_invalid: OnInvalid = ...,
        progress: Progress | None = ...,
        stiffness: Stiffness | None = ...,
        load_friction: LoadFriction | None = ...,
    ) -> ReactionsComparison: ...
    @overload
    def reactions(
        self,
        motion: Motion,
        joints: Way,
        *,
        wrench: WrenchOverTime = ...,
        on_invalid: OnInvalid = ...,
        progress: Progress | None = ...,
        stiffness: Stiffness | None = ...,
        load_friction: LoadFriction | None = ...,
    ) -> Reactions: ...
    @overload
    def reactions(
        self,
        motion: Motion,
        joints: Choice,
        *,
        wrench: WrenchOverTime = ...,
        on_invalid: OnInvalid = ...,
        progress: Progress | None = ...,
        stiffness: Stiffness | None = ...,
        load_friction: LoadFriction | None = ...,
    ) -> AnyReactions: ...
    def reactions(
        self,
        motion: Motion,
        joints: Choice = "all",
        *,
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
        progress: Progress | None = None,
        stiffness: Stiffness | None = None,
        load_friction: LoadFriction | None = None,
    ) -> AnyReactions:
        """Return the force and moment in every joint over a motion: `p3dof.analysis.reactions`.

        Rigid bodies leave some loads open. `joints` is how these are found: ``"elastic"``, by the `stiffness`
        of joints and rods; ``"paper"`` or ``"points"``, two idealisations of the joints; or ``"all"``. They
        have `load_friction` too, where it is given.
        """
        from p3dof.analysis.reactions import ways_of
        from p3dof.analysis.reactions.evaluation import of_result, over_motion

        if load_friction is not None:
            ways_of(joints)
            found = self.load_friction(
                motion,
                load_friction,
                wrench=wrench,
                on_invalid=on_invalid,
                progress=progress,
                stiffness=stiffness,
            )
            return of_result(self.bare_loop, self.parameters, found.result, joints, on_invalid, stiffness)
        given = wrench, on_invalid, progress, stiffness
        return over_motion(self.bare_loop, self.parameters, motion, joints, *given)

    def energy(self, result: InverseDynamics) -> Energy:
        """Return energy, momentum, work and drive loads over a motion, from its forces by any method.

        Of a run in time, ``robot.inverse_dynamics(run.motion, wrench=run.wrench)`` is such a result.
        """
        from p3dof.analysis.energy import energy_of

        return energy_of(self.parameters, result)

    # In time, and to look at

    def page(self, result: Any = None, **options: Any) -> Any:
        """Return a page of the browser with the machine, its runs and forces: ``page.save("machine.html")``.

        `result` is what moves: a `Motion`, an `InverseDynamics` or a `Simulation`; without it the machine is
        held at home. `options` are those of `p3dof.viewer.page`: wrench, runs to compare with, title, ... It
        shows itself in a notebook, and needs no extra.
        """
        from p3dof import viewer

        return viewer.page(self, result, **options)

    def show(self, result: Any = None, **options: Any) -> Any:
        """Show that page in the browser, live: more runs can be sent to it; needs the extra ``viz``.

        `result` is as of `page`, `options` are those of `p3dof.viewer.show`: port, speed, ... It returns a
        `p3dof.viewer.LiveViewer` with `url`, `show(result)` and `stop()`, which shows itself in a notebook.
        `MissingExtraError` if tornado is not installed.
        """
        from p3dof import viewer

        return viewer.show(self, result, **options)

    def viewer(self, port: int | None = None) -> Any:
        """Return a `pinocchio.visualize.MeshcatVisualizer` of the machine; needs the extra ``viz``.

        ``robot.viewer().play(motion)`` plays a motion, a result or a simulation in the browser, in real time;
        ``robot.viewer().record(motion).save("motion.html")`` writes a page that plays it. The live page is
        served at a `port`, a free one by default. `MissingExtraError` without meshcat.
        """
        from p3dof import viewer

        return viewer.viewer(self, port)

    def simulate(
        self,
        duration: float,
        *,
        start: ArrayLike | InitialState = AT_HOME,
        controller: ControllerLike = None,
        control: ControlLoop = CONTINUOUS,
        reference: Motion | None = None,
        wrench: WrenchOverTime = None,
        method: Method | None = None,
        samples: int | ArrayLike = 1001,
        stop_at: Sequence[str | Event] = KINDS,
        integration: Integration = PRECISE,
        progress: Progress | None = None,
    ) -> Simulation:
        """Move the machine for a `duration` [s] under a controller, constant forces, or none.

        `start` is a pose (y, z, θ), or an `InitialState` with velocity or joints. `controller` takes a
        `Measurement` and returns the forces of A, B, C [N], or is forces that stay; `control` (`ControlLoop`)
        says how often and how strongly it acts, with which noise. `reference` is what to follow, for
        `Simulation.error`. `wrench` acts on the platform at P [N, N m], constant or a function of the time.
        `samples` is how many to keep, or when [s]; `stop_at`, which limits and events (`Event`) end the run;
        `integration` (`Integration`), how exact it is and how long it may take. By default the `method` is
        ``"compiled"``: in C, unless `Simulation.note` says what kept it from that.

        Raises
        ------
        ReachError, ControllerError, InputError
            If it starts out of reach, its controller fails (with the run so far), or an argument is wrong.
        """
        from p3dof.runs import simulate

        return simulate(
            self,
            duration,
            start=start,
            controller=controller,
            control=control,
            reference=reference,
            wrench=wrench,
            method=method,
            samples=samples,
            stop_at=stop_at,
            integration=integration,
            progress=progress,
        )

    def prepare_run(self, duration: float, **options: Any) -> PreparedRun:
        """Make what runs for a `duration` [s] have in common once: `p3dof.runs.prepare_run`.

        `options` are those of `simulate`, but for `start` and `progress`; call the result with a start.

        Raises
        ------
        InputError
            If an argument does not fit, or a run would take too long.
        """
        from p3dof.runs import prepare_run

        return prepare_run(self, duration, **options)

    def simulate_many(self, duration: float, runs: Any, **options: Any) -> ManyRuns:
        """Run this machine, or many like it, many times for a `duration` [s]: `p3dof.runs.simulate_many`.

        `runs` is how many, or columns of what differs: starts, gains, seeds, payloads, any number of the
        machine; or a `Parameters` for each run. `options` are those of `p3dof.runs.simulate_many`: `start`,
        `controller`, `control`, `reference`, `wrench`, `stop_at`, `integration`, `histories`, `every`,
        `threads`, `lanes`, `client`, `progress`.

        Raises
        ------
        InputError
            If an argument or a column does not fit; a run that cannot be has a reason instead.
        """
        from p3dof.runs import many

        options.setdefault("level", self.kernels.level)
        options.setdefault("threads", self.kernels.threads)
        return many.simulate_many(self.parameters, duration, runs, **options)
