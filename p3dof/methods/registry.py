"""The ways to the forces, by name. A new one: a file with the doors of `DynamicsMethod`, a line here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import NO_PINOCCHIO, InputError, MissingExtraError
from p3dof.closed_form.compiled import MachineKernels
from p3dof.machine.motion.core import Motion
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import Parameters
from p3dof.methods import closed_form, compiled
from p3dof.methods.compiled import CompiledMethod
from p3dof.methods.solution import Solution

if TYPE_CHECKING:  # Pinocchio and all that stands on it is imported when it is first asked for
    from p3dof.loops import ClosedLoopModel
    from p3dof.machine import description


class AtOnce(Protocol):
    """What answers for plain samples at once; None where somebody must look closer. See `OneSample`."""

    def forces(self, out: Any, q: Any, v: Any, a: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the actuator forces at a pose, velocity and acceleration."""

    def accelerate(self, out: Any, q: Any, v: Any, f: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the acceleration of the platform at a pose and velocity, under forces."""

    def jacobian(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return ∂(λA, λB, λC)/∂(y, z, θ)."""

    def mass_matrix(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return the mass matrix in y, z, θ."""

    def derivatives(self, q: Any, v: Any, a: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the actuator forces and their derivatives by pose, velocity and acceleration."""

    def sliders(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return the slider positions at a pose."""

    def poses(self, out: Any, sliders: Any, on_invalid: str) -> FloatArray | None:
        """Return the pose at slider positions."""


class DynamicsMethod(Protocol):
    """A way to the forces of one machine.

    Each decides by itself which states are within reach, and at which the actuators hold the platform. With
    ``states.on_invalid`` ``"nan"`` it leaves rows of NaN for the others. With ``"raise"`` every door raises:

    - `ReachError` for the first state that is out of reach, naming the leg, its margin and the sample,
    - `SingularityError` for the first at which the actuators cannot hold the platform (`forces`, `solve`),
    - `SampleError` for one that Pinocchio cannot solve for another reason,
    - `InputError` for numbers that are not finite, or where a result would not be.

    Forces and sliders are those of A, B, C, positive along +z0.
    """

    @property
    def one(self) -> AtOnce | None:
        """What answers for one plain sample at once; None where nothing does."""

    def forces(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the actuator forces that a motion takes, (..., 3) [N]."""

    def solve(self, states: States, progress: Progress | None = None) -> Solution:
        """Return the forces at N samples with joints and evidence.

        `progress`: called with (done, total) now and then by a way that takes its time.
        """

    def accelerate(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the acceleration of (y, z, θ) under actuator forces, (..., 3) [m/s², m/s², rad/s²].

        It exists at singular poses too.
        """

    def jacobian(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3) [1, 1, m/rad]."""

    def mass_matrix(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3) [kg, kg m, kg m²]."""


Method: TypeAlias = str
"""The name of a way to the forces, one of `METHODS`."""


class Machine(Protocol):
    """What a way can be made from: `p3dof.Manipulator`."""

    @property
    def parameters(self) -> Parameters:
        """The machine."""

    @property
    def bare_loop(self) -> ClosedLoopModel:
        """Its closed-loop model on Pinocchio, of bodies and motors; made when it is first asked for."""

    @property
    def kernels(self) -> MachineKernels:
        """Its compiled kernels; made when they are first asked for."""


@contextmanager
def _with_pinocchio() -> Iterator[None]:
    """Say what to do where Pinocchio is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != "pinocchio":
            raise
        raise MissingExtraError(NO_PINOCCHIO) from error


def _pinocchio(machine: Machine) -> DynamicsMethod:
    with _with_pinocchio():
        from p3dof.methods.pinocchio import PinocchioMethod

    return PinocchioMethod(machine.parameters, machine.bare_loop)


def _virtual_power(machine: Machine) -> DynamicsMethod:
    from p3dof.methods.virtual_power import VirtualPowerMethod

    return VirtualPowerMethod(machine.parameters)


METHODS: Mapping[Method, Callable[[Machine], DynamicsMethod]] = {
    "pinocchio": _pinocchio,
    "virtual-power": _virtual_power,
    "compiled": lambda machine: CompiledMethod(machine.kernels),
}
"""The ways to the forces. The first two share only the parameters; the third is the second's result by the
reduced formulas of `p3dof.closed_form.compiled.reduced`, compiled."""

DEFAULT_METHOD: Method = "pinocchio"
"""Wherever a method can be chosen."""

TOLERANCE = 1e-10
"""Largest difference of the two methods that passes, as a share of the largest force."""


def check_method(method: str) -> str:
    """Return the name of a method if it is known."""
    if not isinstance(method, str) or method not in METHODS:
        raise InputError(f"method: expected one of {', '.join(map(repr, METHODS))}, got {shown(method)}")
    return method


def prepare(forces: Callable[..., FloatArray], motion: Motion, method: Method) -> None:
    """Let a method find, by the first sample of a motion, what it needs once for a machine."""
    forces(motion.pose[:1], motion.velocity[:1], motion.acceleration[:1], on_invalid="nan", method=method)


Term: TypeAlias = Callable[[Machine, States, FloatArray | None], FloatArray]
"""A term of the equations of motion at states, written into an array if there is one."""


class EquationTerms(NamedTuple):
    """Terms of the equations of motion that only the closed forms have."""

    coriolis_matrix: Term  # of a machine and states
    gravity_forces: Term


EQUATION_TERMS: Mapping[Method, EquationTerms] = {
    "virtual-power": EquationTerms(
        lambda machine, *given: closed_form.coriolis_matrix(machine.parameters, *given),
        lambda machine, *given: closed_form.gravity_forces(machine.parameters, *given),
    ),
    "compiled": EquationTerms(
        lambda machine, *given: compiled.coriolis_matrix(machine.kernels, *given),
        lambda machine, *given: compiled.gravity_forces(machine.kernels, *given),
    ),
}
"""What computes them, by method."""


def equation_terms(method: Method) -> EquationTerms:
    """Return what computes Coriolis matrix and gravity by a method."""
    if not isinstance(method, str) or method not in EQUATION_TERMS:
        raise InputError(f"method: expected {' or '.join(map(repr, EQUATION_TERMS))}, got {shown(method)}")
    return EQUATION_TERMS[method]


class Methods:
    """The ways to the forces of one machine, each made when it is first asked for.

    Parameters
    ----------
    machine : Machine
        What they are made from.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._made: dict[str, DynamicsMethod] = {}

    def __getitem__(self, method: Method) -> DynamicsMethod:
        try:
            return self._made[method]
        except (KeyError, TypeError):
            found = METHODS[check_method(method)](self._machine)
            self._made[method] = found
            return found


class ManipulatorModel:
    """Parameters, description, Pinocchio model and methods of one machine, each made when first asked for."""

    def __init__(self, parameters: Parameters) -> None:
        if not isinstance(parameters, Parameters):
            raise InputError(
                f"parameters: expected Parameters, got {type(parameters).__name__}; from_dict takes a dict"
            )
        self.parameters = parameters
        self.methods = Methods(self)

    @cached_property
    def mechanism(self) -> description.Mechanism:
        """The neutral description: links, joints, closures, solids."""
        from p3dof.machine import description

        return description.describe(self.parameters)

    @cached_property
    def urdf(self) -> str:
        """The URDF of the tree for any reader: self-contained, primitives only, every link with a mass."""
        from p3dof.machine import description

        return description.urdf(description.with_masses(self.mechanism))

    @cached_property
    def exact_urdf(self) -> str:
        """The URDF of the tree with the bodies just as the parameters have them, massless ones included."""
        from p3dof.machine import description

        return description.urdf(self.mechanism)

    @cached_property
    def sidecar(self) -> str:
        """The loop closures and actuated joints that belong to the URDF, as YAML."""
        from p3dof.machine import description

        return description.sidecar(self.mechanism)

    @cached_property
    def kernels(self) -> MachineKernels:
        """The compiled kernels of the machine, or what stands in for them."""
        return MachineKernels(self.parameters)

    def use(self, kernels: MachineKernels) -> None:
        """Put other kernels in the place of those that are there, such as ones of another level."""
        if not isinstance(kernels, MachineKernels):
            raise InputError(f"kernels: expected MachineKernels, got {type(kernels).__name__}")
        self.__dict__["kernels"] = kernels
        self.methods = Methods(self)

    @cached_property
    def loop(self) -> ClosedLoopModel:
        """The mechanism as a closed-loop model on Pinocchio: the `bare_loop` with friction and balances."""
        bare = self.bare_loop
        sidecar = type(bare).from_urdf(self.exact_urdf, self.sidecar, mimic=False).sidecar
        return type(bare)(bare.model, sidecar) if sidecar.joint_data or sidecar.bushings else bare

    @cached_property
    def bare_loop(self) -> ClosedLoopModel:
        """The same with armature alone: the method has a way of its own to friction and counterbalances."""
        from p3dof.machine import description

        with _with_pinocchio():
            from p3dof.loops import ClosedLoopModel
            from p3dof.methods.pinocchio import armature_of

        closures = description.sidecar(self.mechanism.bare())
        loop = ClosedLoopModel.from_urdf(self.exact_urdf, closures, mimic=False)
        loop.model.gravity.linear = self.parameters.gravity  # a URDF has no place for it
        loop.model.armature = armature_of(loop.model, self.parameters.actuators)  # nor for this
        return loop

    @cached_property
    def visual_model(self) -> Any:
        """The visible solids as a `pinocchio.GeometryModel`."""
        import pinocchio as pin

        return pin.buildGeomFromUrdfString(self.bare_loop.model, self.exact_urdf, pin.GeometryType.VISUAL)

    @cached_property
    def collision_model(self) -> Any:
        """The solids for collision checks as a `pinocchio.GeometryModel`."""
        import pinocchio as pin

        return pin.buildGeomFromUrdfString(self.bare_loop.model, self.exact_urdf, pin.GeometryType.COLLISION)
