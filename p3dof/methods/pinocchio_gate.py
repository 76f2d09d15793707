"""Which samples the Pinocchio route takes: its own verdict, from Pinocchio's model and constraint Jacobian.

A pose is out of reach if the loops do not close there on the assembly of home. It is actuation-singular if
the sliders cannot hold the platform: with ∂λC/∂θ from the constraint Jacobian, r the arm from P to the
hinge and φ the tilt of leg C's cross-bar from the vertical, the arm is

    sin α = ∂λC/∂θ · cos φ / r        (1)

away from the plane of the rods, the angle that `p3dof.closed_form.kinematics` has in closed form. Nothing
here comes from there: when both ways call the same samples valid, they do so independently.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import P3dofError, SampleError, SingularityError
from p3dof._base.samples import ACTUATION_TOLERANCE, raise_out_of_reach, raise_singular
from p3dof.loops import ClosedLoopModel
from p3dof.loops.batch.targets import FrameTargets
from p3dof.machine.parameters import PLATFORM

_CHAINS = (
    ("slide_a", "hinge_a", "leg_a_tip", "platform_a"),
    ("slide_b", "hinge_b", "leg_b_tip", "platform_b"),
    ("slide_c", "hinge_left", "hinge_lower", "hinge_platform"),
)
"""Of each leg: its guide-way, both ends of its rod, and where it meets the platform."""
_TILT, _ARM = "hinge_c", "hinge_platform"
_HOPELESS = 1e-3
"""Share of a leg's length by which it may be too short before the assembly is not even tried."""
_HORIZONTAL = 1e-6
"""Share of a leg's length up to which its margin is taken for the reason why the loops do not close."""


class Gate:
    """Margins of one machine, from its model.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism, whose neutral configuration is home.
    """

    def __init__(self, loop: ClosedLoopModel) -> None:
        model, data = loop.model, loop.model.createData()
        neutral = pin.neutral(model)
        pin.computeJointJacobians(model, data, neutral)
        pin.updateFramePlacements(model, data)

        def place(name: str) -> FloatArray:
            return np.array(data.oMf[model.getFrameId(name)].translation)

        home = data.oMf[model.getFrameId(PLATFORM)]
        self._guides = np.array([place(slide) for slide, *_ in _CHAINS])
        columns = [model.idx_vs[model.getJointId(slide)] for slide, *_ in _CHAINS]
        self._axes = np.array([data.J[:3, column] for column in columns])
        self._lengths = np.array([np.linalg.norm(place(tip) - place(root)) for _, root, tip, _ in _CHAINS])
        self._points = np.array([home.actInv(place(point)) for *_, point in _CHAINS])
        self._arm = float(np.linalg.norm(place(_ARM) - home.translation))
        rod = place(_CHAINS[2][2]) - place(_CHAINS[2][1])
        tilt = model.getJointId(_TILT)
        self._tilt, across = model.idx_qs[tilt], data.J[3:, model.idx_vs[tilt]]
        sideways, along = np.cross(across, rod), self._axes[2]
        size = np.linalg.norm(sideways)
        # The rod, turned by q about the cross-bar's axis, has cos q rod + sin q (axis × rod) along the guide.
        self._cosine, self._sine = -(rod @ along) / size, -(sideways @ along) / size

    def margins(self, targets: FrameTargets) -> FloatArray:
        """Return by how much the chain of each leg is longer than its way from the guide-way, (N, 3) [m].

        Parameters
        ----------
        targets : FrameTargets
            Placements of the platform.

        Returns
        -------
        ndarray, shape (N, 3)
            Negative: too short, whatever the joints do.
        """
        points = targets.positions[:, None] + self._points @ np.swapaxes(targets.rotations, -1, -2)
        return np.asarray(
            self._lengths - np.linalg.norm(np.cross(points - self._guides, self._axes), axis=-1)
        )

    def hopeless(self, margins: FloatArray) -> NDArray[np.bool_]:
        """Whether a chain is so much too short that closing the loops need not be tried, (N,)."""
        return np.asarray((margins < -_HOPELESS * self._lengths).any(axis=-1))

    def horizontal(self, margins: FloatArray) -> NDArray[np.bool_]:
        """Whether a chain is too short, or nearly so, (N,)."""
        return np.asarray((margins < _HORIZONTAL * self._lengths).any(axis=-1))

    def actuation(self, q: FloatArray, inverse_jacobian: FloatArray) -> FloatArray:
        """Return the angle α of (1), (N,) [rad], positive on home's side.

        Parameters
        ----------
        q : ndarray, shape (N, nq)
            Configurations.
        inverse_jacobian : ndarray, shape (N, 3, 3)
            Speeds of the sliders per unit speed of y, z and θ.

        Returns
        -------
        ndarray, shape (N,)
        """
        angle = q[:, self._tilt]
        cosine = self._cosine * np.cos(angle) + self._sine * np.sin(angle)
        sine = inverse_jacobian[:, 2, 2] * cosine / self._arm
        return np.asarray(np.arcsin(np.clip(sine, -1, 1)))


class Verdict:
    """What is known of the samples of a batch, and the error for those that are invalid.

    Parameters
    ----------
    gate : Gate
        Of the machine.
    pose : ndarray, shape (N, 3)
        The poses.
    targets : FrameTargets
        The same as placements; one for each finite pose.
    finite : ndarray of bool, shape (N,)
        Which poses these are.
    """

    def __init__(
        self, gate: Gate, pose: FloatArray, targets: FrameTargets, finite: NDArray[np.bool_]
    ) -> None:
        self._gate, self._pose = gate, pose
        self.margins = np.full(pose.shape, np.nan)
        self.margins[finite] = gate.margins(targets)
        self.actuation = np.full(len(pose), np.nan)
        self.unreached, self.singular = np.zeros((2, len(pose)), dtype=bool)
        self.errors: dict[int, P3dofError] = {}

    def try_rows(self, rows: NDArray[np.int_]) -> NDArray[np.int_]:
        """Return which of some samples are worth assembling; the others are out of reach."""
        hopeless = self._gate.hopeless(self.margins[rows])
        self.unreached[rows[hopeless]] = True
        return np.asarray(rows[~hopeless])

    def not_assembled(self, errors: Mapping[int, P3dofError]) -> None:
        """Enter samples that do not assemble: out of reach where a leg has no margin."""
        for i, error in errors.items():
            if self._gate.horizontal(self.margins[i : i + 1])[0]:
                self.unreached[i] = True
            else:
                self.errors[i] = error

    def hold(self, rows: NDArray[np.int_], q: FloatArray, inverse_jacobian: FloatArray) -> NDArray[np.bool_]:
        """Return which of some assembled samples the sliders can hold."""
        self.actuation[rows] = self._gate.actuation(q, inverse_jacobian)
        self.singular[rows] = ~(np.abs(self.actuation[rows]) >= ACTUATION_TOLERANCE)
        return ~self.singular[rows]

    def tell(self, shape: tuple[int, ...], complete: bool) -> None:
        """Raise for the first invalid sample, if there is one.

        Parameters
        ----------
        shape : tuple of int
            The leading shape of what the user gave.
        complete : bool
            Whether all samples were looked at.

        Raises
        ------
        ReachError, SingularityError, SampleError
            Naming the sample.
        """
        pose = self._pose.reshape(*shape, 3)
        margins, actuation = self.margins.reshape(*shape, 3), self.actuation.reshape(shape)
        raise_out_of_reach(pose, self.unreached.reshape(shape), margins, complete)
        raise_singular(pose, self.singular.reshape(shape), actuation, complete)
        if self.errors:
            sample = min(self.errors)
            index = tuple(int(i) for i in np.unravel_index(sample, shape)) if shape else ()
            error = self.errors[sample]
            kind = SingularityError if isinstance(error, SingularityError) else SampleError
            where = index[0] if len(index) == 1 else index
            words = f"sample {where}: {error}" if index else str(error)
            raise kind(words, index, len(self.errors)) from error
