"""Drake: `Parser(plant).AddModels("urdf/p3dof_drake.urdf")` in a discrete plant, root welded to the world."""

import itertools
import logging
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from reference import (
    FILES,
    GRAVITY,
    LINKS,
    MECHANISM,
    MOVING,
    URDF,
    assert_bodies,
    assert_placements,
    closed_joints,
    closed_states,
    random_joints,
    tree_forces,
)
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

import p3dof
from p3dof.machine import description
from p3dof.machine.description.urdf_text import drake
from p3dof.machine.parameters import SOLIDS, Geometry, of_solids

pytest.importorskip("pydrake", reason="Drake not installed: pip install 'p3dof[interop]'")

from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

WITH_LOOPS = FILES / "p3dof_drake.urdf"
NAMES = list(MOVING)
PAIRS = [(closure.frame1, closure.frame2) for closure in MECHANISM.closures]


class Machine:
    """A diagram of plant and geometry with a context; joint values are arrays in the order of NAMES."""

    def __init__(self, text, kind="urdf", step=1e-3, anchored=True):
        builder = DiagramBuilder()
        self.plant, self.scene = AddMultibodyPlantSceneGraph(builder, time_step=step)
        Parser(self.plant).AddModelsFromString(text, kind)
        if anchored:
            self.plant.WeldFrames(self.plant.world_frame(), self.plant.GetFrameByName("base_link"))
        self.plant.mutable_gravity_field().set_gravity_vector(GRAVITY)  # Drake's own default is 9.81
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        joints = [self.plant.GetJointByName(name) for name in NAMES]
        self.q_at = [joint.position_start() for joint in joints]
        self.v_at = [joint.velocity_start() for joint in joints]

    def set(self, q, v=None):
        self.plant.SetPositions(self.context, _scattered(q, self.q_at))
        self.plant.SetVelocities(self.context, _scattered(np.zeros(10) if v is None else v, self.v_at))

    def get(self):
        q, v = self.plant.GetPositions(self.context), self.plant.GetVelocities(self.context)
        return q[self.q_at], v[self.v_at]

    def mass_matrix(self):
        return self.plant.CalcMassMatrix(self.context)[np.ix_(self.v_at, self.v_at)]

    def bias(self):
        """Coriolis, centrifugal and gravity forces."""
        plant = self.plant
        force = plant.CalcBiasTerm(self.context) - plant.CalcGravityGeneralizedForces(self.context)
        return force[self.v_at]

    def inverse_dynamics(self, a):
        """Joint forces of the open tree."""
        given = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, given)  # gravity
        return self.plant.CalcInverseDynamics(self.context, _scattered(a, self.v_at), given)[self.v_at]

    def loop_jacobian(self):
        """Speeds (9, 10) with which the two points of every closure part."""
        plant, world = self.plant, self.plant.world_frame()

        def jacobian(name):
            frame = plant.GetFrameByName(name)
            return plant.CalcJacobianTranslationalVelocity(
                self.context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
            )

        return np.vstack([jacobian(one) - jacobian(two) for one, two in PAIRS])[:, self.v_at]

    def gaps(self):
        placed = self.placements(itertools.chain(*PAIRS))
        return [float(np.linalg.norm(placed[one][:3, 3] - placed[two][:3, 3])) for one, two in PAIRS]

    def placements(self, names=LINKS):
        return {
            name: self.plant.GetFrameByName(name).CalcPoseInWorld(self.context).GetAsMatrix4()
            for name in names
        }

    def bodies(self, names=LINKS):
        found = {}
        for name in names:
            spatial = self.plant.GetBodyByName(name).default_spatial_inertia()
            about_com = spatial.Shift(spatial.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
            found[name] = (spatial.get_mass(), spatial.get_com(), about_com)
        return found


def _scattered(values, where):
    result = np.empty(len(where))
    result[where] = values
    return result


def _vector(joints):
    return np.array([joints[name] for name in NAMES])


@pytest.fixture(scope="module", params=[URDF, WITH_LOOPS], ids=lambda path: path.name)
def machine(request):
    return Machine(request.param.read_text("utf-8"))


@pytest.fixture(scope="module")
def looped():
    return Machine(WITH_LOOPS.read_text("utf-8"))


@pytest.mark.parametrize("path", [URDF, WITH_LOOPS], ids=lambda path: path.name)
def test_the_file_itself_loads_without_a_warning(path, caplog):
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=1e-3)
    with caplog.at_level(logging.INFO):
        (model,) = Parser(plant).AddModels(str(path))
    assert plant.GetModelInstanceName(model) == "p3dof"
    assert not caplog.records


def test_every_link_weighs_the_same(machine):
    assert_bodies(machine.bodies())
    total = machine.plant.CalcTotalMass(machine.context)
    assert total == pytest.approx(MECHANISM.mass + LINKS["base_link"].body.mass, rel=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_links_are_where_they_should_be(machine, seed):
    q = random_joints(seed)
    machine.set(_vector(q))
    assert_placements(machine.placements(), q)


def test_joints_have_the_same_names_and_limits(machine):
    plant = machine.plant
    found = {plant.get_joint(index).name(): plant.get_joint(index) for index in plant.GetJointIndices()}
    found.pop("world_welds_to_base_link")  # ours
    assert list(found) == [joint.name for joint in MECHANISM.joints]
    for joint in MECHANISM.joints:
        drakes = found[joint.name]
        kind = {"fixed": "weld"}.get(joint.kind, joint.kind)
        assert drakes.type_name() == kind
        assert (drakes.parent_body().name(), drakes.child_body().name()) == (joint.parent, joint.child)
        if joint.limits is not None:
            limits = joint.limits
            np.testing.assert_allclose(drakes.position_lower_limits(), [limits.lower], rtol=1e-14)
            np.testing.assert_allclose(drakes.position_upper_limits(), [limits.upper], rtol=1e-14)
            np.testing.assert_allclose(drakes.velocity_upper_limits(), [limits.velocity], rtol=1e-14)
            np.testing.assert_allclose(drakes.velocity_lower_limits(), [-limits.velocity], rtol=1e-14)


def test_the_sliders_have_actuators_with_their_largest_force(looped):
    plant = looped.plant
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    assert [actuator.joint().name() for actuator in actuators] == list(MECHANISM.actuated)
    for actuator in actuators:
        assert actuator.effort_limit() == MOVING[actuator.joint().name()].limits.effort
    assert Machine(URDF.read_text("utf-8")).plant.num_actuators() == 0  # Drake reads no <ros2_control>


def test_no_two_solids_touch_in_the_workspace(machine):
    context = machine.scene.GetMyContextFromRoot(machine.root)
    smallest, count = np.inf, 0
    for joints in closed_joints(2000):
        machine.set(_vector(joints))
        query = machine.scene.get_query_output_port().Eval(context)
        assert query.ComputePointPairPenetration() == []
        distances = [pair.distance for pair in query.ComputeSignedDistancePairwiseClosestPoints(0.1)]
        smallest, count = min(smallest, *distances), count + len(distances)
    solids = sum(len(link.collisions) for link in LINKS.values())
    inspector = query.inspector()
    assert inspector.NumGeometriesWithRole(Role.kProximity) == solids
    assert count > 2000 * 20
    assert smallest > 0.003


# -- dynamics ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_the_open_tree_takes_the_same_forces(machine, seed):
    q, v, a, forces = map(_vector, tree_forces(seed))
    machine.set(q, v)
    scale = np.abs(forces).max()
    np.testing.assert_allclose(machine.inverse_dynamics(a), forces, rtol=0, atol=1e-12 * scale)
    by_matrix = machine.mass_matrix() @ a + machine.bias()
    np.testing.assert_allclose(by_matrix, forces, rtol=0, atol=1e-12 * scale)
    model = pin.buildModelFromUrdf(str(URDF))
    M = pin.crba(model, model.createData(), q)
    np.testing.assert_allclose(np.triu(machine.mass_matrix()), np.triu(M), rtol=0, atol=1e-12 * M.max())


def test_projected_on_the_loops_the_forces_are_those_of_the_paper(machine):
    states = closed_states(101)
    order = [states.joints.names.index(name) for name in NAMES]
    actuated = [NAMES.index(name) for name in MECHANISM.actuated]
    forces, by_matrix, gaps = [], [], []
    for q, v, a in zip(states.joints.q, states.joints.v, states.joints.a, strict=True):
        machine.set(q[order], v[order])
        gaps.append(max(machine.gaps()))
        J = machine.loop_jacobian()
        _, s, V = np.linalg.svd(J)
        assert np.sum(s > 1e-9) == 7  # two of nine rows are redundant: both are across a parallelogram
        N = V[7:].T
        for found, tree in (
            (forces, machine.inverse_dynamics(a[order])),
            (by_matrix, machine.mass_matrix() @ a[order] + machine.bias()),
        ):
            found.append(np.linalg.solve(N[actuated].T, N.T @ tree))
    scale = np.abs(states.forces).max()
    np.testing.assert_allclose(forces, states.forces, rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(by_matrix, states.forces, rtol=0, atol=1e-13 * scale)
    assert max(gaps) < 1e-14


# -- the loops, in Drake's discrete solver -----------------------------------------------------------------


def _simulated(machine, times, force, start):
    """Move under forces (a function of time, held over a step); return q at `times` and the largest gap."""
    port, step = machine.plant.get_actuation_input_port(), machine.plant.time_step()
    machine.root.SetTime(0.0)
    machine.set(*start)
    held = port.FixValue(machine.context, force(step / 2))
    simulator = Simulator(machine.diagram, machine.root)
    simulator.Initialize()
    found, gap = [], 0.0
    count = round(times[-1] / step)
    kept = {round(time / step) for time in times}
    for i in range(1, count + 1):
        simulator.AdvanceTo(i * step)
        gap = max(gap, *machine.gaps())
        if i in kept:
            found.append(machine.get()[0])
        held.GetMutableData().set_value(force((i + 0.5) * step))
    return np.array(found), gap


def _assert_converges(expected, times, force, start, bounds):
    """Assert first-order convergence in the step, second-order after Richardson's extrapolation.

    SAP is first-order in time: halving the step halves the error, and 2 q(h/2) - q(h) is of second order. Its
    constraints are as stiff as the step lets them be: the gap shrinks with its square.
    """
    text, steps = WITH_LOOPS.read_text("utf-8"), (1e-3, 5e-4, 2.5e-4)
    found, gaps = zip(*(_simulated(Machine(text, step=h), times, force, start) for h in steps), strict=True)
    errors = [np.abs(q - expected).max() for q in found]
    better = [np.abs(2 * fine - coarse - expected).max() for coarse, fine in itertools.pairwise(found)]
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(2, rel=0.02)
    assert better[0] / better[1] == pytest.approx(4, rel=0.05)
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.05)
    assert gaps[1] / gaps[2] == pytest.approx(4, rel=0.05)
    assert errors[0] < bounds["error"]
    assert better[-1] < bounds["extrapolated"]
    assert gaps[0] < bounds["gap"]


def test_released_from_home_it_moves_as_our_forward_dynamics():
    """Off balance by up to 30 N: balanced, or without forces, it would hang or fall whatever its loops do."""
    robot = p3dof.load()
    force = robot.forces(np.zeros(3), np.zeros(3), np.zeros(3)) + np.array([30, -20, 10])
    order = [NAMES.index(name) for name in robot.model.names[1:]]

    def rate(_, x):
        q, v = x[:10][order], x[10:][order]
        a = np.empty(10)
        a[order] = robot.loop.forward_dynamics(q, v, force).a
        return np.concatenate([x[10:], a])

    times = np.linspace(0.05, 0.3, 6)
    exact = solve_ivp(rate, (0, 0.3), np.zeros(20), "DOP853", times, rtol=1e-12, atol=1e-13).y[:10].T
    assert np.abs(robot.loop.closure_error(exact[-1][order])).max() < 1e-12
    assert np.abs(exact[-1]).max() > 0.2  # it does move: up to .29 rad and 74 mm
    bounds = {"error": 8e-4, "extrapolated": 1e-7, "gap": 4e-7}
    _assert_converges(exact, times, lambda _: force, (np.zeros(10), np.zeros(10)), bounds)


def test_driven_by_the_computed_forces_it_makes_the_papers_motion():
    states = closed_states(1001)
    order = [states.joints.names.index(name) for name in NAMES]
    q, v = states.joints.q[:, order], states.joints.v[:, order]
    force = make_interp_spline(states.time, states.forces, 5)
    rows = np.arange(100, 1001, 100)
    bounds = {"error": 5e-3, "extrapolated": 5e-6, "gap": 4e-6}
    _assert_converges(q[rows], states.time[rows], force, (q[0], v[0]), bounds)


@pytest.mark.parametrize("off", range(3))
def test_it_is_the_three_constraints_that_close_the_loops(off):
    """An element unknown to Drake would do nothing: switched off, each constraint lets its own loop open."""
    machine = Machine(WITH_LOOPS.read_text("utf-8"))
    constraints = machine.plant.GetConstraintIds()
    assert len(constraints) == machine.plant.num_constraints() == 3
    machine.plant.SetConstraintActiveStatus(machine.context, constraints[off], False)
    force = np.array([70.0, 30.0, 60.0])
    _simulated(machine, [0.1], lambda _: force, (np.zeros(10), np.zeros(10)))
    gaps = machine.gaps()
    assert gaps.pop(off) > 1e-3
    assert max(gaps) < 1e-5


def test_a_continuous_plant_refuses_to_move():
    machine = Machine(WITH_LOOPS.read_text("utf-8"), step=0.0)
    machine.plant.get_actuation_input_port().FixValue(machine.context, np.zeros(3))
    simulator = Simulator(machine.diagram, machine.root)
    with pytest.raises(RuntimeError, match="Continuous time does not support constraints"):
        simulator.AdvanceTo(1e-3)


def test_of_the_plain_urdf_it_closes_the_parallelogram_only():
    machine = Machine(URDF.read_text("utf-8"))
    assert machine.plant.num_constraints() == 2  # the couplers that it makes of <mimic>


# -- other machines, other names ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parameters",
    [SOLIDS, of_solids(Geometry(0.01, 0.025, 0.04, 0.005)), of_solids(Geometry(0.3, 0.75, 1.2, 0.15))],
    ids=["solids", "a tenth", "threefold"],
)
def test_other_machines_load(parameters):
    mechanism = description.with_masses(description.describe(parameters))
    machine = Machine(drake(mechanism))
    assert machine.plant.num_constraints() == 3
    machine.set(np.zeros(10))
    assert max(machine.gaps()) < 1e-13
    for link in mechanism.links:
        mass, com, inertia = machine.bodies([link.name])[link.name]
        assert mass == pytest.approx(link.body.mass, rel=1e-12)
        np.testing.assert_allclose(com, link.body.com, rtol=0, atol=1e-14)
        np.testing.assert_allclose(inertia, link.body.inertia, rtol=0, atol=1e-12 * inertia.max())


def test_names_are_escaped():
    hostile = "a & <b> \"c\" 'd' é --"
    joints = tuple(
        replace(
            joint, parent=joint.parent.replace("leg_a", hostile), child=joint.child.replace("leg_a", hostile)
        )
        for joint in MECHANISM.joints
    )
    links = tuple(replace(link, name=link.name.replace("leg_a", hostile)) for link in MECHANISM.links)
    closures = (replace(MECHANISM.closures[0], frame1=f"{hostile}_tip"), *MECHANISM.closures[1:])
    mechanism = replace(MECHANISM, name=hostile, links=links, joints=joints, closures=closures)
    machine = Machine(drake(mechanism))
    assert machine.plant.HasModelInstanceNamed(hostile)
    assert machine.plant.HasBodyNamed(hostile)
    assert machine.plant.num_constraints() == 3


# -- the SDF -----------------------------------------------------------------------------------------------


def test_of_the_sdf_drake_takes_the_tree_but_not_the_loops():
    text = (FILES / "p3dof.sdf").read_text("utf-8")
    with pytest.raises(RuntimeError, match="form one or more loops in the system graph"):
        Machine(text, "sdf", anchored=False)
    root = ET.fromstring(text)  # noqa: S314 - our own file
    model = root.find("model")
    for joint in model.findall("joint[@type='ball']"):
        model.remove(joint)
    machine = Machine(ET.tostring(root, encoding="unicode"), "sdf", anchored=False)
    for seed in range(3):
        q = random_joints(seed)
        machine.set(_vector(q))
        assert_placements(machine.placements(), q)  # of frames and links
    tree = pin.buildModelFromUrdf(str(URDF))
    for joint, inertia in zip(list(tree.names)[1:], list(tree.inertias)[1:], strict=True):
        link = MOVING[joint].child
        mass, com, about_com = machine.bodies([link])[link]
        assert mass == pytest.approx(inertia.mass, rel=1e-14)
        np.testing.assert_allclose(com, inertia.lever, rtol=0, atol=1e-14)
        np.testing.assert_allclose(about_com, inertia.inertia, rtol=0, atol=1e-14)
    q, v, a, forces = map(_vector, tree_forces(1))
    machine.set(q, v)
    scale = np.abs(forces).max()
    np.testing.assert_allclose(machine.inverse_dynamics(a), forces, rtol=0, atol=1e-12 * scale)
