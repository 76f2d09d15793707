"""The C of robots with closed loops: it compiles without a warning, and is what the general layer says."""

import ctypes
import re
import shutil
import subprocess
from dataclasses import replace

import closed_trees as trees
import numpy as np
import pinocchio as pin
import pytest
from closed_loop_robots import (
    FOUR_BAR_SIDECAR,
    PARALLELOGRAM_SIDECAR,
    SLIDER_CRANK_SIDECAR,
    flat_parallelogram,
    four_bar,
    slider_crank,
)
from command_line import run
from compilers import CC, COMPILED, CPP, each_c
from gallery import GALLERY, gallery

import p3dof
from p3dof import runs
from p3dof._base.errors import InputError, ModelError
from p3dof.codegen.loops import loop_files
from p3dof.loops.assembly import Limits

WARNINGS = "-Wall -Wextra -Werror -pedantic -Wconversion -Wshadow -Wdouble-promotion"
pytestmark = COMPILED


def make(folder, *arguments):
    return subprocess.run(
        ["make", "-s", *arguments], cwd=folder, capture_output=True, text=True, check=False, timeout=600
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The C of a loop, idle freedoms, a coupling with a spring, and one with all that acts, by folder."""
    base = tmp_path_factory.mktemp("c")
    jobs = {
        "five_bar": {},
        "leg": {"observer": True},
        "gripper": {"functions": ["inverse_dynamics", "tangent_of_forces", "motion", "step", "integrate"]},
        "stewart": {
            "external": ["platform"],
            "joint_forces": True,
            "inertias": ["platform_free"],
            "observer": True,
            "estimator": True,
        },
        "ankle": {"coordinates": ["ankle_pitch", "ankle_roll"], "prefix": "ankle"},
        "single": {"coordinates": ["ankle_pitch", "ankle_roll"], "prefix": "single", "precision": "float"},
    }
    for name, options in jobs.items():
        (base / name).mkdir()
        robot = gallery("leg" if "coordinates" in options else name)
        for file, text in loop_files(robot, **options).files.items():
            (base / name / file).write_text(text, encoding="utf-8")
    return base


@pytest.mark.parametrize(
    ("xml", "sidecar"),
    [(flat_parallelogram(), PARALLELOGRAM_SIDECAR), (slider_crank(), SLIDER_CRANK_SIDECAR)],
    ids=["closures", "motors"],
)
def test_a_robot_with_a_singular_reference_is_tested_beside_it(tmp_path, xml, sidecar):
    flat = p3dof.loops.ClosedLoopModel.from_urdf(xml, sidecar)
    at, still = flat.regular_configuration[None], np.zeros((1, 3))
    compiled = flat.compile(around=np.zeros(3), level="numpy").inverse_dynamics(at, still, still)
    np.testing.assert_allclose(compiled.tau[0], flat.inverse_dynamics(at[0], *still, *still).tau, rtol=1e-9)
    for file, text in loop_files(flat, "bar").files.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    done = make(tmp_path, "check", f"CC={CC}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all is well" in done.stdout


@each_c
@pytest.mark.parametrize("name", ["five_bar", "leg", "gripper", "stewart", "ankle"])
def test_it_compiles_without_a_warning_and_is_right(written, tmp_path, name, compiler):
    folder = shutil.copytree(written / name, tmp_path / name)
    ways = (compiler, "-std=c99", "-O2"), (CPP[compiler], "-xc++ -std=c++11", "-O0")
    for used, standard, flags in ways:
        if shutil.which(used) is None:
            continue
        options = f"CC={used}", f"STANDARD={standard}", f"CFLAGS={flags}", f"WARNINGS={WARNINGS}"
        done = make(folder, "check", *options)
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stderr == ""
        assert "all is well" in done.stdout
        errors = [float(x) for x in re.findall(r"\d\.\de[-+]\d\d", done.stdout)]
        assert len(errors) >= 3
        assert max(errors) < 1e-10
        make(folder, "clean")


@each_c
@pytest.mark.parametrize(
    "name", ["gripper", *(pytest.param(x, marks=pytest.mark.slow) for x in ("five_bar", "ankle"))]
)
def test_random_bytes_are_survived(written, tmp_path, name, compiler):
    folder = shutil.copytree(written / name, tmp_path / name)
    flags = "-O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all"
    built = make(folder, f"{name}_selftest", f"CC={compiler}", f"CFLAGS={flags}", f"LDFLAGS={flags}")
    assert built.returncode == 0, built.stderr
    done = subprocess.run(
        [f"./{name}_selftest", "--fuzz", "20000"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "20000 calls of each function" in done.stdout


CALLED = {
    "five_bar": ["start", "follow"],
    "leg": ["observe"],
    "stewart": ["start", "follow", "observe", "estimate"],
}


@pytest.mark.parametrize("name", CALLED)
def test_what_a_controller_calls_is_timed(written, tmp_path, name):
    """With the functions of the table; what sleeps for 40 us takes them."""
    folder = shutil.copytree(written / name, tmp_path / name)
    flags = f"CC={CC}", "STANDARD=-std=gnu99", "CFLAGS=-O0", f"WARNINGS={WARNINGS}"
    source, slow = folder / f"{name}.c", CALLED[name][-1]
    text = source.read_text(encoding="utf-8")
    head = re.search(rf"^{name}_status {name}_{slow}\([^)]*\)\n{{\n", text, re.M).group()
    sleep = "    nanosleep(&(const struct timespec){0, 40000}, NULL);\n"
    source.write_text("#include <time.h>\n" + text.replace(head, head + sleep), encoding="utf-8")
    built = make(folder, f"{name}_selftest", *flags)
    assert (built.returncode, built.stderr) == (0, "")
    command = [folder / f"{name}_selftest", "--time", "500"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    found = re.findall(r"^(\w+) +([\d.]+) +(\d+) +(\d+)$", done.stdout, re.M)
    assert [row[0] for row in found][-len(CALLED[name]) :] == CALLED[name]
    assert {"inverse_dynamics", "forward_dynamics"} < {row[0] for row in found}
    for row in found:
        mean, usual, worst = map(float, row[1:])
        assert 0 < usual <= worst
        if row[0] == slow:
            assert mean >= 40_000
            assert usual >= 40_000
    # A call that fails is no time of the function.
    source.write_text(text.replace(head, f"{head}    return {name.upper()}_OPEN;\n"), encoding="utf-8")
    make(folder, f"{name}_selftest", *flags[:-1], "WARNINGS=")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert f"FAILED: {slow}: a timed call" in done.stdout


def of_small(folder, name, flags, calls):
    """The self test of a robot's C, with flags for small processors, and its calls with random bytes."""
    done = make(folder, "check", "CC=gcc", "STANDARD=-std=c99", f"CFLAGS={flags}", f"LDFLAGS={flags}")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr
    assert "all is well" in done.stdout
    errors = [float(x) for x in re.findall(r"\d\.\de[-+]\d\d", done.stdout)]
    assert len(errors) >= 3
    assert max(errors) < 1e-10
    command = [f"./{name}_selftest", "--fuzz", str(calls)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"{calls} calls of each function" in done.stdout


@pytest.mark.parametrize(
    "name", ["five_bar", *(pytest.param(x, marks=pytest.mark.slow) for x in ("gripper", "ankle"))]
)
def test_it_is_right_on_small_processors(written, tmp_path, name, small):
    of_small(shutil.copytree(written / name, tmp_path / name), name, small, 2_000)


@pytest.mark.fuzz
@pytest.mark.parametrize("name", ["leg", "stewart"])
def test_large_ones_are_right_on_small_processors(written, tmp_path, name, small):
    of_small(shutil.copytree(written / name, tmp_path / name), name, small, 20_000)


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("five_bar", r"9\.81\d*", "9.82"),
        ("ankle", r"circle\[i\] \? cos\(x\) : x", "circle[i] ? cos(x) : (x + 1e-6)"),
    ],
)
def test_the_self_test_notices_a_wrong_number(written, tmp_path, name, right, wrong):
    folder = shutil.copytree(written / name, tmp_path / "broken")
    source = folder / f"{name}.c"
    text = source.read_text(encoding="utf-8")
    source.write_text(text.replace(re.search(right, text)[0], wrong), encoding="utf-8")
    done = make(folder, "check", f"CC={CC}")
    assert done.returncode != 0
    assert "error beyond the tolerance" in done.stdout


def library(folder, name):
    if not (folder / f"lib{name}.so").exists():
        command = [CC, "-std=c99", "-O1", "-shared", "-fPIC", "-o", f"lib{name}.so", f"{name}.c", "-lm"]
        subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / f"lib{name}.so"))


def pointer(array):
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


class AnkleState(ctypes.Structure):
    _fields_ = (
        ("q", ctypes.c_double * 12),
        ("joint", ctypes.c_double * 2),
        ("actuator", ctypes.c_double * 2),
    )


def test_a_transmission_keeps_its_branch_and_says_how_a_call_ended(written):
    """A policy's loop: motion of the motors to that of the joints, its forces and gains back."""
    c, state = library(written / "ankle", "ankle"), AnkleState()
    one = gallery("leg").transmission(["ankle_pitch", "ankle_roll"])
    rng, numbers = np.random.default_rng(0), np.zeros
    assert c.ankle_transmission_start(ctypes.byref(state), None) == 0
    np.testing.assert_allclose(list(state.q), one.home, rtol=0, atol=0)
    y, speed, tau, share = numbers(2), numbers(2), numbers(2), numbers(1)
    x, found, evidence = np.array(list(state.joint)), [numbers(2) for _ in range(3)], numbers(2)
    for _ in range(50):
        x, v, f = x + rng.uniform(-0.02, 0.02, 2), rng.normal(size=2), 10 * rng.normal(size=2)
        at = ctypes.byref(state)
        assert (
            c.ankle_joint_to_actuator(
                at, pointer(x), pointer(v), None, pointer(y), pointer(speed), None, None
            )
            == 0
        )
        there = one.joint_to_actuator(x, v)
        np.testing.assert_allclose([y, speed], [there.position, there.velocity], rtol=0, atol=1e-12)
        back = (pointer(z) for z in (y, speed, numbers(2), *found, evidence))
        assert c.ankle_actuator_to_joint(at, *back) == 0
        np.testing.assert_allclose(found[:2], [x, v], rtol=0, atol=1e-12)
        assert evidence[0] > 0.5
        assert evidence[1] < 1e-12
        assert c.ankle_joint_to_actuator_forces(at, pointer(f), pointer(tau), None) == 0
        np.testing.assert_allclose(tau, one.actuator_forces(there.q, f), rtol=0, atol=1e-11)
        assert c.ankle_force_share(at, pointer(f), pointer(share)) == 0
        assert share[0] == pytest.approx(np.abs(tau).max() / 60.0, rel=1e-12)  # N m, the limits of effort
        K, D, Ky, Dy = np.diag([80.0, 60.0]), np.diag([2.0, 1.0]), numbers((2, 2)), numbers((2, 2))
        for forces in (f, None):
            given = (
                pointer(K),
                pointer(D),
                None if forces is None else pointer(f),
                pointer(Ky),
                pointer(Dy),
                None,
            )
            assert c.ankle_joint_to_actuator_gains(at, *given) == 0
            np.testing.assert_allclose(
                [Ky, Dy], one.actuator_gains(there.q, K, D, forces), rtol=0, atol=1e-10
            )
    before = bytes(state), y.copy()
    for wrong, status in (((1.5, 0.0), 7), ((1e9, 0.0), 7), ((np.nan, 0.0), 2)):
        given = pointer(np.array(wrong)), None, None, pointer(y), None, None, None
        assert c.ankle_joint_to_actuator(ctypes.byref(state), *given) == status
        assert (bytes(state), *y) == (before[0], *before[1])
    assert c.ankle_force_share(ctypes.byref(state), pointer(f), None) == 1
    assert c.ankle_transmission_start(ctypes.byref(state), pointer(one.home + 0.01)) == 4  # open
    assert bytes(state) == before[0]


class StewartObserver(ctypes.Structure):
    _fields_ = (
        ("momentum", ctypes.c_double * 6),
        ("rate", ctypes.c_double * 6),
        ("external", ctypes.c_double * 6),
        ("begun", ctypes.c_int),
    )


def test_an_observer_says_what_that_of_python_says(written):
    """A Stewart platform that carries what one knows of, and is pushed by what one does not."""
    c, state, robot = library(written / "stewart", "stewart"), StewartObserver(), gallery("stewart")
    compiled = robot.compile(external=["platform"], joint_forces=True, inertias=["platform_free"])
    start = robot.assemble().q
    known, more = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]), np.array([4.0, -6.0, 50.0, 0.5, 0.0, 0.2])
    body = robot.model.inertias[robot.model.getJointId("platform_free")].toDynamicParameters()
    body[:4] += [2.0, 0.0, 0.0, 0.1]
    loaded = robot.copy()
    loaded.model.inertias[loaded.model.getJointId("platform_free")] = pin.Inertia.FromDynamicParameters(body)
    motion = runs.simulate_robot(loaded, 0.02, start, samples=21, external={"platform": known + more})
    observer = robot.observer(50.0, threshold=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], compiled=compiled)
    free, numbers = list(compiled.independent_places), np.zeros
    external, share, limits = numbers(6), numbers(1), np.arange(1.0, 7.0)
    rate = [ctypes.c_double(50.0)]
    c.stewart_observer_start(ctypes.byref(state))

    def call(dt, q, v, tau, threshold=limits):
        given = [pointer(x) for x in (q, v, tau, known)]
        given += [None, pointer(body), None if threshold is None else pointer(threshold)]
        told = pointer(external), pointer(share), None
        return c.stewart_observe(ctypes.byref(state), ctypes.c_double(dt), *rate, *given, *told)

    for i, now in enumerate(motion.time):
        dt, v = now - motion.time[i - 1] if i else 0.0, np.ascontiguousarray(motion.v[i][free])
        given = {"external": {"platform": known}, "inertias": {"platform_free": body}}
        expected = observer.update(dt, motion.q[i], motion.v[i], motion.forces[i], **given)
        q, tau = (np.ascontiguousarray(x[i]) for x in (motion.q, motion.forces))
        assert call(dt, q, v, tau) == 0
        np.testing.assert_allclose(external, expected, rtol=0, atol=1e-10)
        assert share[0] == pytest.approx(observer.share, rel=1e-10)
    assert np.abs(external).max() > 10.0  # N: most of the push
    before = bytes(state), external.copy(), share.copy()
    for dt, now in ((-1.0, q), (np.nan, q), (np.inf, q), (1e-3, np.full(len(q), np.nan))):
        assert call(dt, now, v, tau) == 2
    for wrong in (-1.0, 0.0, np.nan):
        assert call(1e-3, q, v, tau, np.array([1.0, wrong, 3.0, 4.0, 5.0, 6.0])) == 2
    assert call(1e-3, q + 0.1, v, tau) in (4, 5)  # open, or a quaternion that is none
    assert c.stewart_observe(None, *rate, *rate, *[None] * 10) == 1
    assert (bytes(state), *external, *share) == (before[0], *before[1], *before[2])
    assert call(1e-3, q, v, tau, None) == 0
    assert share[0] == 0.0
    assert call(0.0, q, v, tau) == 0  # begins anew
    assert not external.any()


class StewartEstimator(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_double * 10) for name in ("prior", "spread", "mean")),
        ("factor", ctypes.c_double * 100),
        ("diagonal", ctypes.c_double * 10),
        ("samples", ctypes.c_double),
        ("outliers", ctypes.c_double),
    )


def test_an_estimator_says_what_that_of_python_says(written):
    """With a payload from the middle on, outliers and a known push; what is no sample changes nothing."""
    c, state, robot = library(written / "stewart", "stewart"), StewartEstimator(), gallery("stewart")
    compiled = robot.compile(external=["platform"], inertias=["platform_free"], level="numpy")
    moving, draw, free = (
        trees.motions(robot, 60, seed=2),
        np.random.default_rng(0),
        compiled.independent_places,
    )
    other, known = robot.copy(), np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    other.model.inertias[other.model.getJointId("platform_free")] += pin.Inertia.FromSphere(2.0, 0.05)
    spread, noise = p3dof.loops.payload_deviations(5.0, 0.1), np.linspace(0.5, 1.0, 6)
    estimator = robot.payload_estimator(
        "platform_free", noise, spread, forgetting=0.9, gate=8.0, compiled=compiled
    )
    parameters, deviations, outliers = np.zeros(10), np.zeros(10), np.zeros(1)
    assert c.stewart_estimator_start(ctypes.byref(state), None, pointer(spread)) == 0

    def call(q, v, a, tau, forgetting=0.9, gate=8.0, noise=noise):
        v, a = (np.ascontiguousarray(x[list(free)]) for x in (v, a))
        given = [pointer(x) for x in (noise, q, v, a, tau, known)]
        told = *map(pointer, (parameters, deviations, outliers)), None
        numbers = ctypes.c_double(forgetting), ctypes.c_double(gate)
        return c.stewart_estimate(ctypes.byref(state), *numbers, *given, None, *told)

    for i in range(60):
        q, v, a = (np.ascontiguousarray(x[i]) for x in (moving.q, moving.v, moving.a))
        one = other if i >= 20 else robot
        tau = one.inverse_dynamics(q, v, a, {"platform": known}).tau + noise * draw.normal(size=6)
        tau[0] += 1e4 * (i % 10 == 9)
        estimator.update(q, v, a, tau, {"platform": known})
        assert call(q, v, a, tau) == 0
        for found, expected in (
            (parameters, estimator.body.parameters),
            (deviations, estimator.body.deviations),
        ):
            np.testing.assert_allclose(found / spread, expected / spread, rtol=0, atol=1e-10)
        assert (outliers[0], state.samples) == (estimator.outliers, estimator.samples)
    assert estimator.outliers >= 6
    assert abs(estimator.payload.mass - 2.0) < 4 * estimator.payload.mass_deviation < 1.0
    before = bytes(state), *parameters, *deviations
    wrong = np.full(24, np.nan)
    for arguments in ((wrong, v, a, tau), (q, v, a, wrong), (q, v, a, tau * np.inf), (q, v, wrong, tau)):
        assert call(*arguments) == 2
    for bad in (
        {"forgetting": 0.0},
        {"forgetting": 1.5},
        {"gate": -1.0},
        {"gate": np.nan},
        {"noise": 0 * noise},
    ):
        assert call(q, v, a, tau, **bad) == 2
    assert call(q + 0.1, v, a, tau) in (4, 5)  # open, or a quaternion that is none
    assert c.stewart_estimator_start(ctypes.byref(state), None, pointer(-spread)) == 2
    assert c.stewart_estimator_start(ctypes.byref(state), pointer(wrong), pointer(spread)) == 2
    assert c.stewart_estimator_start(ctypes.byref(state), None, None) == 1
    assert (bytes(state), *parameters, *deviations) == before
    assert c.stewart_estimator_start(ctypes.byref(state), pointer(parameters), pointer(spread)) == 0
    assert call(q, v, a, tau, gate=0.0) == 0  # none is left out
    assert (state.samples, state.outliers) == (1.0, 0.0)
    assert c.stewart_estimator_start(ctypes.byref(state), None, pointer(1e200 * spread)) == 0
    before = bytes(state)
    assert call(q, v, a, tau, gate=0.0) == 2  # squares are infinite
    assert bytes(state) == before


def test_statuses_and_what_acts(written):
    call = library(written / "stewart", "stewart").stewart_inverse_dynamics
    robot = gallery("stewart")
    moving = trees.motions(robot, 3, seed=1)
    rng = np.random.default_rng(0)
    push, joints = rng.normal(0, 20, 6), rng.normal(0, 1, robot.model.nv)
    numbers = np.array(robot.model.inertias[robot.model.getJointId("platform_free")].toDynamicParameters())
    tau, multipliers, evidence = np.zeros(6), np.zeros(18), np.zeros(2)

    def run(i, wrench, forces, inertia, q=None):
        state = [np.ascontiguousarray(x) for x in (moving.q[i] if q is None else q, moving.v[i], moving.a[i])]
        acting = [None if x is None else pointer(x) for x in (wrench, forces, inertia)]
        results = [pointer(x) for x in (tau, multipliers, evidence)]
        return call(*map(pointer, state), *acting, *results)

    for i in range(3):
        state = moving.q[i], moving.v[i], moving.a[i]
        assert run(i, push, joints, numbers) == 0
        expected = robot.inverse_dynamics(*state, {"platform": push}, joints)
        np.testing.assert_allclose(tau, expected.tau, rtol=0, atol=1e-11 * np.abs(expected.tau).max())
        assert evidence[0] > 0.3
        assert evidence[1] < 1e-9
        assert run(i, None, None, None) == 0
        expected = robot.inverse_dynamics(*state)
        np.testing.assert_allclose(tau, expected.tau, rtol=0, atol=1e-11 * np.abs(expected.tau).max())
    before = tau.copy()
    assert run(0, push, None, None, moving.q[0] + np.eye(len(moving.q[0]))[2] * 0.01) == 4  # open
    moving.v[0][0] += 1.0
    assert run(0, None, None, None) == 5  # opens
    moving.v[0][0] = np.nan
    assert run(0, None, None, None) == 2
    assert np.array_equal(tau, before)


def test_the_header_says_what_ten_numbers_an_inertia_is(written):
    """Two masses on the platform, summed as the header has it, load the legs as the body that they are."""
    header = " ".join(
        (written / "stewart" / "stewart.h").read_text(encoding="utf-8").replace("*", " ").split()
    )
    order = "mass [kg], first moments x, y, z [kg m], moments of inertia xx, xy, yy, xz, yz, zz [kg m^2]"
    assert f"at the joint's origin in its axes: {order}" in header
    points, masses = np.array([[0.1, -0.2, 0.3], [-0.3, 0.1, 0.05], [0.2, 0.25, -0.1]]), [2.0, 3.0, 4.0]
    about = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(masses, points, strict=True))
    ten = np.array([9.0, *(np.array(masses) @ points), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
    robot = gallery("stewart").copy()
    centre = np.array(masses) @ points / 9
    own = sum(
        m * ((x - centre) @ (x - centre) * np.eye(3) - np.outer(x - centre, x - centre))
        for m, x in zip(masses, points, strict=True)
    )
    robot.model.inertias[robot.model.getJointId("platform_free")] = pin.Inertia(9.0, centre, own)
    moving, tau = trees.motions(robot, 1, seed=1), np.zeros(6)
    state = [np.ascontiguousarray(x[0]) for x in (moving.q, moving.v, moving.a)]
    call = library(written / "stewart", "stewart").stewart_inverse_dynamics
    outputs = pointer(tau), pointer(np.zeros(18)), pointer(np.zeros(2))
    assert call(*map(pointer, state), None, None, pointer(ten), *outputs) == 0
    expected = robot.inverse_dynamics(*state).tau
    np.testing.assert_allclose(tau, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_limits_of_position_are_those_of_the_file(written, tmp_path):
    """Of joints with one coordinate; all others, and joints without limits, may be anywhere."""
    robot = gallery("four_bar")
    low, high = np.array(robot.model.lowerPositionLimit), np.array(robot.model.upperPositionLimit)
    low[:2], high[:2] = [-0.5, -np.inf], [0.25, 1.0]
    robot.model.lowerPositionLimit, robot.model.upperPositionLimit = low, high
    for name, text in loop_files(robot, "bar", ["inverse_dynamics"]).files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    within = library(tmp_path, "bar").bar_within_limits
    place = ctypes.c_int(7)
    rng, seen = np.random.default_rng(1), set()
    for _ in range(200):
        q = np.ascontiguousarray(rng.uniform(-1.5, 1.5, robot.model.nq))
        beyond = Limits(robot.model).beyond(q)
        first = min((robot.model.idx_qs[robot.model.getJointId(name)] for name in beyond), default=-1)
        assert within(pointer(q), ctypes.byref(place)) == (6 if beyond else 0)
        assert place.value == first
        assert within(pointer(q), None) == (6 if beyond else 0)
        seen.add(first)
    assert seen == {-1, 0, 1}
    place.value = 7
    q[0] = np.nan
    assert within(pointer(q), ctypes.byref(place)) == 2
    assert within(None, ctypes.byref(place)) == 1
    assert place.value == 7
    free = np.full(24, 1e300)
    for name in ("stewart", "leg"):  # balls and free joints
        call = getattr(library(written / name, name), f"{name}_within_limits")
        limits = Limits(gallery(name).model)
        expected = 0 if np.all(limits.upper > 1e299) else 6
        assert call(pointer(np.concatenate([free, free])), None) == expected


def test_a_singular_configuration_is_told(tmp_path):
    bar = gallery("four_bar")
    robot = p3dof.ClosedLoopModel(bar.model, replace(bar.sidecar, actuated=("rocker_joint",)))
    for file, text in loop_files(robot, prefix="bar").files.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    step = library(tmp_path, "bar").bar_step
    evidence, moved, statuses = np.zeros(2), np.zeros(3), []
    low, high, q = None, None, robot.assemble().q
    for angle in np.linspace(0, 2 * np.pi, 361):  # crank and coupler come into line
        q = robot.assemble({"crank_joint": angle}, guess=q).q
        statuses.append(step(pointer(np.array(q)), pointer(moved), pointer(evidence)))
        side = np.sin(q[1])
        if low is not None and side * low[1] < 0:
            high = angle
            break
        low = angle, side
    assert high is not None
    assert set(statuses) == {0}
    low = low[0]
    sign = np.sin(robot.assemble({"crank_joint": low}, guess=q).q[1])
    for _ in range(60):
        middle = (low + high) / 2
        q = robot.assemble({"crank_joint": middle}, guess=q).q
        low, high = (middle, high) if np.sin(q[1]) * sign > 0 else (low, middle)
    assert step(pointer(np.array(q)), pointer(moved), pointer(evidence)) == 3
    assert evidence[0] < 1e-3


def test_a_start_that_leads_nowhere_is_singular_and_no_broken_sensor(tmp_path):
    """Flat, where the pivots are zero; and no configuration at all, with circles of no radius."""
    xml = four_bar(0.5, 0.2, 0.45, 0.35, kind="continuous")
    robot = p3dof.ClosedLoopModel.from_urdf(xml, FOUR_BAR_SIDECAR).around({"crank_joint": 1.0})
    for file, text in loop_files(robot, prefix="bar").files.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    start, room = library(tmp_path, "bar").bar_start, np.zeros(100)
    assert start(pointer(room), pointer(np.array(robot.assemble().q))) == 0
    before = room.copy()
    for q in ([1.0, 0, 1, 0, 1, 0], [0.0] * 6):
        assert start(pointer(room), pointer(np.array(q))) == 3
    assert start(pointer(room), pointer(np.array([np.nan, 0, 1, 0, 1, 0]))) == 2
    np.testing.assert_array_equal(room, before)


def test_names_functions_and_frames_are_checked():
    robot = gallery("five_bar")
    for options, message in (
        ({"prefix": "5bar"}, "^prefix: expected a name"),
        ({"prefix": "Bar"}, "^prefix: expected a name"),
        ({"functions": ["inverse"]}, "^functions: expected some of"),
        ({"functions": []}, "^functions: expected at least one"),
        ({"external": ["nobody"]}, "the frame 'nobody' does not exist"),
    ):
        with pytest.raises(InputError, match=message):
            loop_files(robot, **options)
    with pytest.raises(ModelError, match="more actuators than freedoms"):
        loop_files(gallery("two_arms"), functions=["hybrid_dynamics"])
    with pytest.raises(ModelError, match="does not determine the forces of 12 actuators"):
        loop_files(gallery("two_arms"), inertias=["right_6"], estimator=True)


def test_on_the_command_line(capsys, tmp_path):
    robot, out = str(GALLERY / "four_bar.urdf"), tmp_path / "out"

    def codegen(*more):
        return run(capsys, "loop", "codegen", robot, "--out", str(out), "--prefix", "bar", *more)

    status, told, _ = codegen()
    assert status == 0
    names = ["CMakeLists.txt", "Makefile", "README.md", "bar.c", "bar.h", "bar_selftest.c"]
    assert sorted(path.name for path in out.iterdir()) == names
    assert "inverse_dynamics" in told
    assert codegen("--check")[0] == 0
    text = (out / "bar.c").read_text(encoding="utf-8")
    changed = re.sub(r"\* 0\.\d+;", "* 0.7654321;", text, count=1)
    assert changed != text
    (out / "bar.c").write_text(changed, encoding="utf-8")
    assert codegen("--check")[0] == 1
    assert codegen()[0] == 0  # over its own files
    (out / "README.md").write_text("mine", encoding="utf-8")
    status, _, error = codegen()
    assert (status, error.count("\n")) == (2, 1)
    assert (out / "README.md").read_text(encoding="utf-8") == "mine"
    for wrong, words in (
        (["--functions", "x"], "error: --functions: expected some of"),
        (["--prefix", "a b"], "error: --prefix: expected"),
        (
            ["--cpu", "a b"],
            "error: --cpu: expected a processor as compilers call it, such as haswell, got 'a b'",
        ),
        (["--external", "x"], "error: --external: the frame 'x' does not exist"),
        (["--inertia", "x"], "error: --inertia: the joint 'x' does not exist"),
        (["--coordinates", "x"], "the joint 'x' does not exist"),
        (["--coordinates", "rocker_joint,"], "the joint '' does not exist"),
        (["--actuators", "crank_joint"], "error: --actuators: expected --coordinates, too"),
        (["--float"], "error: --float: single precision is for --coordinates alone"),
        (["--float", "--coordinates", "rocker_joint", "--observer"], "single precision is for --coordinates"),
        (
            ["--float", "--coordinates", "rocker_joint", "--payload-estimator"],
            "single precision is for --coordinates",
        ),
        (
            ["--payload-estimator"],
            "error: --payload-estimator: expected one --inertia, of the body that is estimated, got 0",
        ),
        (
            ["--float", "--coordinates", "rocker_joint", "--functions", "step"],
            "single precision is for --coordinates alone",
        ),
        (["--float", "--coordinates", "rocker_joint", "--wasm"], "JavaScript's numbers are doubles"),
    ):
        status, _, error = codegen("--force", *wrong)
        assert (status, error.count("\n")) == (2, 1)
        assert words in error
    assert codegen("--force", "--coordinates", "rocker_joint", "--actuators", "crank_joint")[0] == 0
    head = (out / "bar.h").read_text(encoding="utf-8")
    assert codegen("--force", "--inertia", "coupler_joint", "--payload-estimator")[0] == 0
    made = (out / "bar.h").read_text(encoding="utf-8")
    assert "--inertia coupler_joint --payload-estimator" in made
    assert "bar_estimate(" in made
    assert "--coordinates rocker_joint --actuators crank_joint" in head
    assert "bar_joint_to_actuator(" in head
    assert "crank_joint (q), coupler_joint (q), rocker_joint (q)" in head
