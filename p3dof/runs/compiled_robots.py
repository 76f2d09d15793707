"""Accelerations and forces of a robot at one state after the other, by its compiled dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

from p3dof._base.checks import FloatArray
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiling_model import Method, method_of

Kind: TypeAlias = Literal["forward_dynamics", "hybrid_dynamics"]


class CompiledStates:
    """A compiled function of one state, with the arrays that it reads and writes.

    Parameters
    ----------
    compiled : CompiledLoop
        The robot.
    kind : {"forward_dynamics", "hybrid_dynamics"}
        What is computed: accelerations from forces, or forces from accelerations of the actuated joints.
    frames : sequence of str
        Where wrenches act.
    stabilisation : float
        β of Baumgarte's stabilisation [1/s].
    """

    def __init__(
        self,
        compiled: CompiledLoop,
        kind: Kind,
        frames: Sequence[str] = (),
        stabilisation: float = 0.0,
    ) -> None:
        self.loop = compiled
        """The robot."""
        bound = compiled.bind(f"stabilised_{kind}" if stabilisation else kind)
        if stabilisation:
            bound.inputs["stabilisation"][:] = stabilisation
        given = bound.inputs["tau" if kind == "forward_dynamics" else "a_actuated"]
        self._state = bound.inputs["q"], bound.inputs["v"], given
        self._wrenches = [bound.inputs[f"wrench_{name}"] for name in frames]
        self._trusted, self._outputs, self._run = bound.outputs["trusted"], bound.outputs, bound.run
        self.doubtful = 0
        """States that were not to be trusted."""

    def __call__(
        self, q: FloatArray, v: FloatArray, given: FloatArray, wrenches: FloatArray, name: str
    ) -> FloatArray | None:
        """Return an output at a state; None where the general layer has to decide.

        Parameters
        ----------
        q : (nq,) array
            Configuration.
        v : (nv,) array
            Velocity.
        given : (n_actuated,) array
            Forces or accelerations of the actuated joints.
        wrenches : (6 k,) array
            On the frames, in their order; those before where it is empty.
        name : str
            ``"a"`` or ``"tau"``.
        """
        for target, value in zip(self._state, (q, v, given), strict=True):
            target[:] = value
        for i, wrench in enumerate(self._wrenches if len(wrenches) else ()):
            wrench[:] = wrenches[6 * i : 6 * i + 6]
        self._run()
        if self._trusted[0] > 0.0:
            return self._outputs[name].copy()
        self.doubtful += 1
        return None


def states_for(
    loop: ClosedLoopModel,
    method: Method,
    kind: Kind,
    frames: Sequence[str],
    stabilisation: float,
    q: FloatArray,
) -> CompiledStates | None:
    """Return what computes the states of a run, None for the robot's own methods.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    method : {"general", "compiled"} or CompiledLoop
        Which is meant.
    kind, frames, stabilisation
        As of `CompiledStates`.
    q : (nq,) array
        Where the run starts, with closed loops: what it is compiled around where the reference configuration
        would not do.

    Raises
    ------
    InputError
        If what is given was compiled for another robot, or without wrenches on the frames.
    ModelError
        If the robot cannot be compiled.
    """
    compiled = method_of(loop, method, frames)
    if compiled is None:
        return None
    if not isinstance(compiled, CompiledLoop):
        compiled = compiled(loop, q, frames)
    return CompiledStates(compiled, kind, frames, stabilisation)
