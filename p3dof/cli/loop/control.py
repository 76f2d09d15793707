"""Controllers, motions and loads of `p3dof loop simulate`, as its options name them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from click.core import ParameterSource

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.cli.actuation import ActuationOptions, with_actuation
from p3dof.cli.files import InputFile, protect, source
from p3dof.cli.kinds import POSITIVE
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiling_model import ROBOT_METHODS
from p3dof.machine.motion import WrenchHistory
from p3dof.runs import (
    ControlLoop,
    JointComputedTorque,
    JointPD,
    JointReference,
    gains,
    moved_inertia,
)

NONE, PD, COMPUTED_TORQUE = "none", "pd", "computed-torque"


class _Saturation(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A largest force, or the word ``file``."""

    name = "FORCE|file"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return True if value in ("file", True) else POSITIVE.convert(value, param, ctx)


_OPTIONS = (
    click.option(
        "--controller",
        type=click.Choice((NONE, PD, COMPUTED_TORQUE)),
        default=NONE,
        show_default=True,
        help="Feedback at the actuated joints with what holds the robot at rest, computed torque (hybrid "
        "dynamics: idle freedoms move as they must), or the constant forces of --force.",
    ),
    click.option(
        "--kp",
        help="Gains, one or one an actuated joint, with commas: of pd [N/m, N m/rad], of "
        "computed-torque [1/s^2]; from --frequency without it.",
    ),
    click.option(
        "--kd", help="Gains of the speed, likewise [per s]; from --frequency and --damping without it."
    ),
    click.option("--frequency", type=POSITIVE, default=5.0, show_default=True, help="Of the feedback [Hz]."),
    click.option(
        "--damping", type=POSITIVE, default=1.0, show_default=True, help="Damping ratio of the feedback."
    ),
    click.option(
        "--motion",
        "motion_file",
        type=InputFile(),
        help="Motion of the actuated joints to follow, as of 'forces'; the robot starts as it does, or at "
        "rest where --set says. Without it the controller stays at the start.",
    ),
    click.option("--rate", type=POSITIVE, default=1000.0, show_default=True, help="Of the controller [Hz]."),
    click.option(
        "--saturation",
        type=_Saturation(),
        metavar="FORCE|file",
        help="Largest force of an actuator [N or N m], or 'file' for the "
        "limits of effort in the robot's file; unlimited without it.",
    ),
)


class Control(NamedTuple):
    """What the options say.

    Parameters
    ----------
    controller : str
        Its name.
    kp, kd : str, optional
        Gains.
    frequency, damping : float
        For the gains that are not given.
    motion_file : Path, optional
        What to follow.
    rate : float
        Of the controller [Hz].
    saturation : float or True, optional
        Largest force, or those of the file.
    actuation : ActuationOptions
        What stands between the controller and the robot.
    given : tuple of str
        The options of controllers that were given.
    """

    controller: str
    kp: str | None
    kd: str | None
    frequency: float
    damping: float
    motion_file: Path | None
    rate: float
    saturation: float | bool | None
    actuation: ActuationOptions
    given: tuple[str, ...] = ()

    @property
    def loop(self) -> ControlLoop:
        """How the controller acts."""
        cut = False if self.saturation is None else self.saturation
        if self.controller == NONE:
            for option in (*self.given, *self.actuation.measuring):
                raise InputError(f"{option}: needs a --controller")
            return self.actuation.loop(None, cut)
        return self.actuation.loop(self.rate, cut)

    def reference(self, robot: ClosedLoopModel) -> JointReference | None:
        """Return the motion to follow."""
        if self.motion_file is None:
            return None
        if self.controller == NONE:
            raise InputError("--motion: needs a --controller that follows it")
        if not robot.actuated:
            raise InputError("--motion: the robot has no actuated joints")
        return JointReference.from_csv(robot, source(self.motion_file))

    def of(
        self,
        robot: ClosedLoopModel,
        q: FloatArray,
        reference: JointReference,
        compiled: CompiledLoop | None = None,
    ) -> JointPD:
        """Return the controller, for a start at a configuration (nq,)."""
        if not robot.actuated:
            raise InputError(f"--controller {self.controller}: the robot has no actuated joints")
        computed = self.controller == COMPUTED_TORQUE
        own = gains(self.frequency, self.damping)
        scale = np.ones(1) if computed or None not in (self.kp, self.kd) else moved_inertia(robot, q)
        kp = own[0] * scale if self.kp is None else _numbers("--kp", self.kp)
        kd = own[1] * scale if self.kd is None else _numbers("--kd", self.kd)
        if computed:
            return JointComputedTorque(robot, reference, kp, kd, compiled)
        return JointPD(robot, reference, kp, kd, gravity=True, compiled=compiled)


_OF_CONTROLLERS = ("kp", "kd", "frequency", "damping", "rate")


def with_control(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of a `Control`, and the control as `control`."""

    @functools.wraps(command)
    def taking(**given: Any) -> Any:
        own = {name: given.pop(name) for name in Control._fields if name != "given"}
        asked = click.get_current_context().get_parameter_source
        told = [name for name in _OF_CONTROLLERS if asked(name) == ParameterSource.COMMANDLINE]
        return command(control=Control(**own, given=tuple(f"--{name}" for name in told)), **given)

    run = with_actuation(taking)
    for option in reversed(_OPTIONS):
        run = option(run)
    return run


METHOD = click.option(
    "--method",
    type=click.Choice(list(ROBOT_METHODS)),
    default="general",
    show_default=True,
    help="What computes the dynamics: the robot, or C that is compiled for it (needs gcc or clang).",
)
EXTERNAL = click.option(
    "--external",
    "external",
    multiple=True,
    metavar="FRAME=FX,FY,FZ,MX,MY,MZ",
    help="Wrench on a frame in world axes at its origin [N, N m]; or FRAME=FILE with one over time (CSV: "
    "t,fx,fy,fz,mx,my,mz).",
)


def externals(texts: tuple[str, ...]) -> dict[str, FloatArray | WrenchHistory]:
    """Return the wrenches on frames that `EXTERNAL` names."""
    found: dict[str, FloatArray | WrenchHistory] = {}
    for text in texts:
        name, sign, value = text.partition("=")
        name = name.strip()
        if not sign or not name:
            raise InputError(f"--external: expected FRAME=FX,FY,FZ,MX,MY,MZ, got {shown(text)}")
        if name in found:
            raise InputError(f"--external: the frame {shown(name)} is named twice")
        if value.strip().lower().endswith(".csv"):
            path = Path(value.strip())
            protect([path], ())
            found[name] = WrenchHistory.from_csv(path)
            continue
        numbers = _numbers(f"--external {name}", value)
        if len(numbers) != 6:
            raise InputError(f"--external {name}: expected six numbers, got {len(numbers)}")
        found[name] = numbers
    return found


def _numbers(option: str, text: str) -> FloatArray:
    """Return the numbers between commas."""
    try:
        found = np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise InputError(f"{option}: expected numbers with commas, got {shown(text)}") from error
    if not np.isfinite(found).all():
        raise InputError(f"{option}: expected finite numbers, got {shown(text)}")
    return found
