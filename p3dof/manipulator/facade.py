"""`Manipulator`: one machine, with its kinematics and both dynamics behind a few calls."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from functools import partial
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from p3dof import simulation
from p3dof.checks import FloatArray, Progress
from p3dof.energy import Energy, energy_of
from p3dof.errors import InputError
from p3dof.kinematics.states import holdable_states
from p3dof.manipulator.comparison import TOLERANCE, Comparison, compare
from p3dof.manipulator.differential import DifferentialMachine
from p3dof.manipulator.sampling import refined, remarks_on, warnings_about
from p3dof.methods import (
    InverseDynamics,
    compiled,
    pinocchio,
    virtual_power,
    with_evidence,
    without_crossings,
)
from p3dof.methods.registry import Method, check_method
from p3dof.motion import Load, Motion, WrenchHistory, WrenchOverTime
from p3dof.parameters import PAPER, Parameters, read_parameters
from p3dof.reactions import (
    BOTH,
    AnyReactions,
    Choice,
    Idealisation,
    Reactions,
    ReactionsComparison,
    over_motion,
)
from p3dof.samples import OnInvalid, finite_states, wrench_like
from p3dof.simulation import ControllerLike, ControlLoop, InitialState, Integration, Simulation


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

    Returns
    -------
    Manipulator

    Raises
    ------
    ParameterError, FileError
        If the file cannot be read or is not right.
    InputError
        If `parameters` is something else.
    """
    if parameters is None:
        return Manipulator(PAPER)
    if not isinstance(parameters, str | os.PathLike):
        return Manipulator(parameters)
    return Manipulator(read_parameters(parameters, any_size))


class Manipulator(DifferentialMachine):
    """The 3-DOF spatial parallel manipulator: parameters, model and both dynamics.

    Poses are (y [m], z [m], θ [rad]), zero at home; sliders and forces are ordered A, B, C, positive along
    +z0. Arrays may have any leading batch dimensions. The Pinocchio route works in buffers of its own: give
    each thread its own manipulator.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    """

    def forces(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        method: Method = "pinocchio",
        wrench: ArrayLike | None = None,
        on_invalid: OnInvalid = "raise",
    ) -> FloatArray:
        """Return the actuator forces at states of motion, without a time axis.

        Parameters
        ----------
        pose, velocity, acceleration : array-like, shape (..., 3)
            Of (y, z, θ) [m, m, rad] and per second, per second²; leading shapes broadcast.
        method : {"pinocchio", "virtual-power", "compiled"}
            RNEA and loop closures in Pinocchio, whose kinematics runs sample by sample; the paper's virtual
            powers, vectorised; or the kernels, which are the fastest by far.
        wrench : array-like, shape (..., 6), optional
            External force and moment on the platform at P, in the fixed frame [N, N m].
        on_invalid : {"raise", "nan"}
            Raise for samples that are not finite, out of reach or singular, or leave NaN in their rows.

        Returns
        -------
        ndarray, shape (..., 3)
            Forces of the actuators A, B, C on their sliders [N].

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If shapes do not fit, a number is not finite, or the method is unknown.
        """
        check_method(method)
        if method == "compiled":
            return compiled.forces(self.kernels, pose, velocity, acceleration, wrench, on_invalid)
        if method == "virtual-power":
            return virtual_power.forces(self.parameters, pose, velocity, acceleration, wrench, on_invalid)
        states = finite_states(pose, velocity, acceleration, on_invalid)
        leading = states[0].shape[:-1]
        loads = None if wrench is None else wrench_like(wrench, leading, on_invalid)
        pose, velocity, acceleration = (np.reshape(array, (-1, 3)) for array in states)
        solution = pinocchio.solve(
            self.loop,
            self.parameters.geometry.h,
            pose,
            velocity,
            acceleration,
            wrench=None if loads is None else loads.reshape(-1, 6),
            friction=self.parameters.friction,
            on_invalid=on_invalid,
            shape=leading,
        )
        return solution.forces.reshape(states[0].shape)

    def inverse_dynamics(
        self,
        motion: Motion,
        method: Method = "pinocchio",
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
        progress: Progress | None = None,
    ) -> InverseDynamics:
        """Return the actuator forces over a motion, with joints, closure error and power balance.

        Parameters
        ----------
        motion : Motion
            The motion of the platform.
        method : {"pinocchio", "virtual-power", "compiled"}
            RNEA and loop closures, the paper's virtual powers, or the kernels.
        wrench : array-like, shape (6,) or (N, 6), or callable, optional
            External force and moment on the platform at P, in the fixed frame [N, N m]; or a function of the
            times, such as a `p3dof.WrenchHistory`.
        on_invalid : {"raise", "nan"}
            Raise for samples that are out of reach or singular, and where the motion crosses a singularity
            between samples; or leave NaN in their rows, and in those near a crossing.
        progress : callable, optional
            Called with (done, total) while Pinocchio solves.

        Returns
        -------
        InverseDynamics
            With its `warnings`.

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If the wrench does not fit, the method is unknown, or `motion` is not a `Motion`.
        """
        check_method(method)
        if not isinstance(motion, Motion):
            raise InputError(f"motion: expected a Motion, got {type(motion).__name__}")
        given = motion.pose, motion.velocity, motion.acceleration
        loads = None if wrench is None else Load(wrench).over(motion.time, on_invalid)
        if method == "pinocchio":  # which decides by itself which samples are valid
            states = finite_states(*given, on_invalid)
            solution = pinocchio.solve(
                self.loop,
                self.parameters.geometry.h,
                *states,
                wrench=loads,
                friction=self.parameters.friction,
                on_invalid=on_invalid,
                progress=progress,
            )
        else:
            states = holdable_states(self.parameters, *given, on_invalid)
            known = None
            if method == "compiled":
                known = compiled.forces(self.kernels, *states, loads, on_invalid="nan")
            solution = virtual_power.solve(self.parameters, *states, wrench=loads, known=known)
        solution, crossings = without_crossings(motion.time, solution, on_invalid)
        history = wrench if isinstance(wrench, WrenchHistory) else None
        examine = partial(warnings_about, self.parameters, wrench=history)
        return with_evidence(method, motion, solution, loads, crossings, examine)

    def refined(self, motion: Motion, wrench: WrenchOverTime = None) -> Motion:
        """Return a motion with as many samples as its peaks and its work need.

        Of a motion from poses alone, ``Motion.from_csv`` or ``Motion.from_poses``, the samples follow the
        curve through the poses, which are among them; of another one, they follow the interpolation between
        its samples. Twice as many would change no peak of force, speed or power, no RMS force and no work
        of an actuator by more than .03 %. A motion whose samples suffice comes back as it is.

        Parameters
        ----------
        motion : Motion
            The motion of the platform.
        wrench : array-like, shape (6,) or (N, 6), or callable, optional
            External load, as for `inverse_dynamics`.

        Returns
        -------
        Motion
            With at most 4,001 samples, or four times those that there are: where that does not suffice, as
            with noisy poses, `InverseDynamics.warnings` says so.

        Raises
        ------
        InputError
            If the wrench does not fit, or `motion` is not a `Motion`.
        """
        return refined(self.parameters, motion, wrench)

    def remarks(self, motion: Motion, wrench: WrenchOverTime = None) -> tuple[str, ...]:
        """Return what there is to know about the samples of a motion.

        Parameters
        ----------
        motion, wrench
            As for `refined`.

        Returns
        -------
        tuple of str
            Those of `InverseDynamics.warnings` that concern the poses of a file and the number of samples.

        Raises
        ------
        InputError
            If the wrench does not fit, or `motion` is not a `Motion`.
        """
        result = self.inverse_dynamics(motion, "compiled", wrench, on_invalid="nan")
        return remarks_on(self.parameters, result, wrench)

    @overload
    def reactions(
        self,
        motion: Motion,
        joints: Literal["both"] = ...,
        wrench: WrenchOverTime = ...,
        on_invalid: OnInvalid = ...,
        progress: Progress | None = ...,
    ) -> ReactionsComparison: ...
    @overload
    def reactions(
        self,
        motion: Motion,
        joints: Idealisation,
        wrench: WrenchOverTime = ...,
        on_invalid: OnInvalid = ...,
        progress: Progress | None = ...,
    ) -> Reactions: ...
    @overload
    def reactions(
        self,
        motion: Motion,
        joints: Choice,
        wrench: WrenchOverTime = ...,
        on_invalid: OnInvalid = ...,
        progress: Progress | None = ...,
    ) -> AnyReactions: ...
    def reactions(
        self,
        motion: Motion,
        joints: Choice = BOTH,
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
        progress: Progress | None = None,
    ) -> AnyReactions:
        """Return the force and moment in every joint over a motion; see `p3dof.reactions`.

        Parameters
        ----------
        motion : Motion
            The motion of the platform.
        joints : {"both", "paper", "points"}
            How the cuts of the loops are built: universal joints and a hinge, or balls; in both ways by
            default, since rigid bodies leave some loads open (see `p3dof.ReactionsComparison`).
        wrench : array-like, shape (6,) or (N, 6), or callable, optional
            External force and moment on the platform at P, in the fixed frame [N, N m]; or a function of
            the times.
        on_invalid : {"raise", "nan"}
            Raise for samples that are out of reach or singular, or leave NaN in their rows.
        progress : callable, optional
            Called with (done, total) while Pinocchio solves.

        Returns
        -------
        ReactionsComparison or Reactions
            By both idealisations, or by the one that was asked for.

        Raises
        ------
        ReachError, SingularityError, SampleError
            Naming the first bad sample.
        InputError
            If the wrench does not fit, the idealisation is unknown, or `motion` is not a `Motion`.
        """
        return over_motion(self.loop, self.parameters, motion, joints, wrench, on_invalid, progress)

    def compare(
        self,
        motion: Motion,
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
        others: Iterable[str] = (),
        tolerance: float = TOLERANCE,
        progress: Progress | None = None,
    ) -> Comparison:
        """Return the forces over a motion by Pinocchio, by virtual powers and by others, with a verdict.

        Parameters
        ----------
        motion : Motion
            The motion of the platform.
        wrench : array-like, shape (6,) or (N, 6), or callable, optional
            External force and moment on the platform at P, as for `inverse_dynamics` [N, N m].
        on_invalid : {"raise", "nan"}
            Raise for samples that both methods refuse, or leave NaN in their rows. Samples that only one of
            them refuses never raise: the comparison tells them, and the methods disagree.
        others : iterable of str
            Engines to ask too, of `p3dof.engines.ENGINES`, or ``"all"``; the compiled kernels always are.
        tolerance : float
            Largest difference that passes, as a share of the largest force; at least 1e-9 for the others.
        progress : callable, optional
            Called with (done, total) while each solves.

        Returns
        -------
        Comparison

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If an argument does not fit, or an engine is unknown.
        MissingExtraError
            If the library of an engine is not installed.
        """
        return compare(self, motion, wrench, on_invalid, others, tolerance, lambda *_: nullcontext(progress))

    def energy(self, result: InverseDynamics) -> Energy:
        """Return energy, momentum, work and drive loads over a motion; see `p3dof.energy`.

        Of a run in time, ``robot.inverse_dynamics(run.motion, wrench=run.wrench)`` is such a result.

        Parameters
        ----------
        result : InverseDynamics
            Of this machine, by either method.

        Returns
        -------
        Energy

        Raises
        ------
        InputError
            If `result` is something else, or that of a machine of another geometry.
        """
        return energy_of(self.parameters, result)

    def show(self, motion: Motion | InverseDynamics | None = None, **options: Any) -> Any:
        """Show the machine in a page of the browser, moving, with controls; needs the extra ``viz``.

        Parameters
        ----------
        motion : Motion or InverseDynamics, optional
            What to play; without it the machine stands at home.
        **options
            As for `p3dof.viewer.show`: port, speed, ...

        Returns
        -------
        p3dof.viewer.LiveViewer
            With `url` and `stop()`; in a notebook it shows itself.

        Raises
        ------
        MissingExtraError
            If meshcat is not installed.
        """
        from p3dof import viewer

        return viewer.show(self, motion, **options)

    def viewer(self, port: int | None = None) -> Any:
        """Return Pinocchio's MeshCat visualizer of the machine, shown in a page; needs the extra ``viz``.

        Parameters
        ----------
        port : int, optional
            Where to serve the page; a free one by default.

        Returns
        -------
        pinocchio.visualize.MeshcatVisualizer

        Raises
        ------
        MissingExtraError
            If meshcat is not installed.
        """
        from p3dof import viewer

        return viewer.viewer(self, port)

    def simulate(
        self,
        duration: float,
        *,
        start: ArrayLike | InitialState = simulation.AT_HOME,
        controller: ControllerLike = None,
        control: ControlLoop = simulation.CONTINUOUS,
        reference: Motion | None = None,
        wrench: WrenchOverTime = None,
        method: Method = simulation.DEFAULT_METHOD,
        samples: int | ArrayLike = 1001,
        stop_at: Sequence[str] = simulation.KINDS,
        integration: Integration = simulation.PRECISE,
        progress: Progress | None = None,
    ) -> Simulation:
        """Move the machine in time under a controller, constant forces, or none: `p3dof.simulation.simulate`.

        `start` is a pose (y, z, θ), or an `InitialState` with velocity or joints. `controller` takes a
        `Measurement` and returns the forces of A, B, C [N], or is forces that stay; `control` says how often
        and how strongly it acts, with which noise. `reference` is what to follow, for `Simulation.error`.
        `wrench` acts on the platform at P [N, N m], constant or a function of the time. `samples` is how
        many to keep, or when [s]; `stop_at`, which limits end the run; `integration`, how exact it is.

        Raises
        ------
        ReachError, ControllerError, InputError
            If it starts out of reach, its controller fails (with the run so far), or an argument is wrong.
        """
        check_method(method)
        return simulation.simulate(
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
