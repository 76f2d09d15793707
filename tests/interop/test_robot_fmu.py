"""FMI 2.0 and 3.0: `docs/examples/robot_fmu.py`, a five-bar with its controller, in FMPy."""

import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import p3dof

fmpy = pytest.importorskip("fmpy", reason="fmpy not installed: pip install 'p3dof[adapters]'")
pytest.importorskip("pythonfmu", reason="pythonfmu not installed: pip install 'p3dof[adapters]'")
pytest.importorskip("pythonfmu3", reason="pythonfmu3 not installed: pip install 'p3dof[adapters]'")
robot_fmu = pytest.importorskip("robot_fmu")
robot_in_steps = pytest.importorskip("robot_in_steps")
STEP, HOLD = 0.05, 2.0  # [s]: between two exchanges; of a target
TARGETS = np.array([[2.2, 0.9], [1.8, 1.4], [2.0, 0.8], [1.7, 1.0], [2.1, 1.3]])


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    return robot_fmu.build(tmp_path_factory.mktemp("fmus"))


@pytest.fixture(scope="module")
def loop():
    return p3dof.load_robot(robot_in_steps.FILES[0])


def integrate(loop, seconds):
    """The same by SciPy, which has the equations from the robot: positions, speeds, torques of the motors."""
    motors = [loop.model.joints[loop.model.getJointId(name)].idx_q for name in loop.actuated]
    nq, still, rows = loop.model.nq, np.zeros(loop.model.nv), []

    def torque(state, target):
        q, v = state[:nq], state[nq:]
        feedback = robot_in_steps.KP * (target - q[motors]) - robot_in_steps.KD * v[motors]
        return feedback + loop.inverse_dynamics(q, still, still).tau

    def rate(_, state, target):
        return np.concatenate(
            [state[nq:], loop.forward_dynamics(state[:nq], state[nq:], torque(state, target)).a]
        )

    state = np.concatenate([loop.assemble().q, still])
    for target in TARGETS[: round(seconds / HOLD)]:
        times = np.linspace(0, HOLD, round(HOLD / STEP) + 1)
        ran = solve_ivp(rate, (0, HOLD), state, "DOP853", times, args=(target,), rtol=1e-9, atol=1e-10)
        assert ran.success
        state = ran.y[:, -1]
        rows += [np.concatenate([one[motors], one[nq:][motors], torque(one, target)]) for one in ran.y.T[1:]]
    return np.array(rows)


def simulated(fmu, loop, seconds):
    """By FMPy: the targets change between two exchanges."""
    names = [f"target.{name}" for name in loop.actuated]
    given = np.zeros(2 * len(TARGETS), dtype=[("time", float), *((name, float) for name in names)])
    begin = HOLD * np.arange(len(TARGETS))
    given["time"] = np.stack([begin - 0.4 * STEP, begin + HOLD - 0.6 * STEP], axis=1).ravel()
    given["time"][0] = 0.0
    for name, values in zip(names, TARGETS.T, strict=True):
        given[name] = np.repeat(values, 2)
    outputs = [f"{what}.{name}" for what in ("position", "speed", "torque") for name in loop.actuated]
    found = fmpy.simulate_fmu(
        str(fmu), stop_time=seconds, step_size=STEP, output_interval=STEP, input=given, output=outputs
    )
    assert_allclose(found["time"], STEP * np.arange(round(seconds / STEP) + 1), rtol=0, atol=1e-9)
    return np.stack([found[name] for name in outputs], axis=1)


@pytest.mark.parametrize("version", [2, 3])
def test_fmpy_finds_nothing_wrong(fmus, version):
    from fmpy.validation import validate_fmu

    fmu = fmus[version - 2]
    assert validate_fmu(str(fmu)) == []
    described = fmpy.read_model_description(str(fmu))
    assert described.fmiVersion == f"{version}.0"
    assert described.coSimulation is not None


def agree(fmu, loop, seconds):
    found, expected = simulated(fmu, loop, seconds), integrate(loop, seconds)
    assert np.ptp(found[:, :2], axis=0).min() > 0.2
    # A torque follows the errors of positions and speeds by the gains.
    sizes = np.repeat([1.0, 10.0, robot_in_steps.KP], 2)
    assert_allclose((found[1:] - expected) / sizes, 0, atol=1e-8)
    assert np.abs((found[:-1] - expected) / sizes).max() > 0.1  # a step later it is elsewhere


@pytest.mark.parametrize("version", [2, 3])
def test_steps_of_the_fmu_are_the_motion_that_scipy_integrates(fmus, loop, version):
    agree(fmus[version - 2], loop, 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("version", [2, 3])
def test_ten_seconds_of_the_fmu_are_the_motion_that_scipy_integrates(fmus, loop, version):
    agree(fmus[version - 2], loop, 10.0)


def test_two_fmus_at_once_are_alone(fmus, loop):
    """Each goes on from where it is, and the targets of one leave the other at rest."""
    from fmpy.fmi2 import FMU2Slave

    described = fmpy.read_model_description(str(fmus[0]))
    numbers = {variable.name: variable.valueReference for variable in described.modelVariables}
    folder = fmpy.extract(str(fmus[0]))
    slaves = [
        FMU2Slave(guid=described.guid, unzipDirectory=folder, modelIdentifier="FiveBar2", instanceName=name)
        for name in ("one", "other")
    ]
    position = [numbers[f"position.{name}"] for name in loop.actuated]
    start = []
    for slave in slaves:
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        start.append(slave.getReal(position))
    slaves[0].setReal([numbers[f"target.{name}"] for name in loop.actuated], [2.2, 0.9])
    for i in range(10):
        for slave in slaves:
            slave.doStep(currentCommunicationPoint=i * STEP, communicationStepSize=STEP)
    assert_allclose(slaves[1].getReal(position), start[1], rtol=0, atol=1e-9)
    assert np.abs(np.subtract(slaves[0].getReal(position), start[0])).min() > 0.2
    for slave in slaves:
        slave.terminate()
        slave.freeInstance()
    shutil.rmtree(folder)


def test_a_limit_of_a_joint_ends_the_steps():
    robot = robot_in_steps.RobotInSteps()
    robot.target[:] = 3.5, -1.0
    assert robot.step(STEP)
    assert any(not robot.step(STEP) for _ in range(4))
    assert robot.time < 5 * STEP
