"""What formulas need of a model, with a plan of elimination that was made on closed configurations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import AssemblyError, InputError
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.compiled.formulas import Load, Robot
from p3dof.loops.compiled.functions import jacobian_rows
from p3dof.loops.compiled.loops import CoupledJoints, PassiveJoints
from p3dof.loops.compiled.pivots import Plan, planned
from p3dof.loops.coordinates import joint_named
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.tree_formulas import numbers, tree_of

SAMPLES = 12  # closed configurations that the pivots are chosen on
_STEP = 0.3  # how far they are from each other [m or rad, of the largest entry]


@dataclass(frozen=True, eq=False)
class CompiledRobot(Robot):
    """A robot for formulas, and what calls of it need."""

    defaults: Mapping[str, FloatArray] = field(default_factory=dict)
    """Values of `inputs` that are meant where none are given."""

    def with_inertias(self, loop: LoopModel, row: Mapping[str, FloatArray]) -> LoopModel:
        """Return a robot with the inertial parameters of a call."""
        changed = {
            name: values
            for name in self.inertias
            if not np.array_equal(values := row[f"inertia_{name}"], self.defaults[f"inertia_{name}"])
        }
        if not changed:
            return loop
        other = loop.copy()
        for name, values in changed.items():
            joint = other.model.getJointId(name)
            other.model.inertias[joint] = pin.Inertia.FromDynamicParameters(np.array(values))
        return other


def robot_of(
    loop: LoopModel,
    around: Sequence[FloatArray],
    external: Iterable[str] = (),
    joint_forces: bool = False,
    inertias: Iterable[str] = (),
    given: Sequence[int] | None = None,
    idle: Sequence[Mapping[int, float]] = (),
) -> CompiledRobot:
    """Return what formulas need of a model; independent are its motors, or given places in v."""
    model = loop.model
    robot = unplanned(loop)
    tree, kinematics = robot.tree, robot.kinematics
    loads = []
    for name in _different("external", external):
        frame = kinematics.frame(name, "external", InputError)
        place = numbers(frame.placement.translation, tree.size)
        loads.append(Load(name, tree.of_joint[int(frame.parentJoint)], place))
    joints = {name: joint_named(model, name, "inertias") for name in _different("inertias", inertias)}
    parts = {name: tree.of_joint[joint] for name, joint in joints.items()}
    robot = replace(
        robot, loads=tuple(loads), joint_forces=bool(joint_forces), inertias=parts, idle=tuple(idle)
    )
    defaults = {name: np.zeros(size) for name, size in robot.inputs.items()}
    for name, joint in joints.items():
        defaults[f"inertia_{name}"] = np.array(model.inertias[joint].toDynamicParameters())
    robot = replace(robot, defaults=defaults)
    size = kinematics.size + len(idle)
    if not size:
        return robot
    columns = jacobian_rows(robot).on_arrays(*np.array(around).T)
    J = np.stack([np.broadcast_to(column, (len(around),)) for column in columns], axis=-1)
    last = robot.motors if given is None else given
    return replace(robot, plan=planned(J.reshape(len(around), size, tree.nv), last))


def unplanned(loop: LoopModel) -> CompiledRobot:
    """Return what formulas need of a model on which nothing acts, without a plan of elimination."""
    model, tree = loop.model, tree_of(loop.model)
    kinematics = LoopKinematics(model, loop.sidecar)
    return CompiledRobot(
        tree,
        kinematics,
        CoupledJoints(model, loop.sidecar.couplings, kinematics.couplings.periods.tolist()),
        PassiveJoints(model, loop.sidecar.joint_data, loop.sidecar.bushings),
        tuple(int(i) for i in loop.actuated_v),
        Plan((), ()),
        length=min(1.0, loop.unit_of_length),
    )


def _different(what: str, names: Iterable[str]) -> list[str]:
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InputError(f"{what}: expected several names, got {shown(names)}")
    found = [str(name) for name in names]
    if len(set(found)) < len(found):
        raise InputError(f"{what}: a name is given twice")
    return found


def closed_configurations(loop: LoopModel, start: FloatArray, seed: int = 0) -> list[FloatArray]:
    """Return closed configurations around one, always the same, all regular; fewer if not found."""
    found, draw = [np.array(start)], np.random.default_rng(seed)
    for _ in range(4 * SAMPLES):
        if len(found) == SAMPLES:
            break
        base = found[draw.integers(len(found))]
        J = loop.closure_jacobian(base)
        basis = np.linalg.svd(J)[2][loop.rank(base) :] if J.size else np.eye(loop.model.nv)
        if not len(basis):
            break
        shift = draw.normal(size=len(basis)) @ basis
        shift *= _STEP / np.abs(shift).max()
        try:
            found.append(np.array(loop.assemble(None, guess=pin.integrate(loop.model, base, shift)).q))
        except AssemblyError:
            continue
    return regular_of(loop, found)[0]


def regular_of(loop: LoopModel, *groups: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """Return the regular ones of each group: of the largest rank, and held by most motors, in all of them."""
    from p3dof.loops.tables import overview

    seen = [[overview(loop, q) for q in group] for group in groups]
    ranks = [[(each.rank, each.held) for each in group] for group in seen]
    most = max(rank for group in ranks for rank in group)
    return [
        [q for q, rank in zip(group, of_group, strict=True) if rank == most]
        for group, of_group in zip(groups, ranks, strict=True)
    ]
