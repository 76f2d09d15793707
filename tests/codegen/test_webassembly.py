"""WebAssembly of generated C: it imports nothing, runs in Node, and says what Python says."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from pathlib import Path

import closed_trees as trees
import mpmath
import numpy as np
import pytest
from command_line import run
from compilers import CC, COMPILED
from gallery import GALLERY
from generated_c import WARNINGS, general

import p3dof
import p3dof.codegen.webassembly as builder
from p3dof import PAPER
from p3dof.codegen.controller import controller_files
from p3dof.codegen.loops import loop_files
from p3dof.codegen.selftest import reference
from p3dof.codegen.web_controller import controller_module
from p3dof.codegen.webassembly import WebFiles, webassembly
from p3dof.loops import payload_deviations
from p3dof.machine.parameters import LINKS, SLIDES, Body

TOOLS = ("clang", "wasm-ld", "node")
MISSING = [tool for tool in TOOLS if shutil.which(tool) is None]
built = pytest.mark.skipif(bool(MISSING), reason=f"{', '.join(MISSING)} not installed")
SCRIPT = """
import { readFileSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { pathToFileURL } from "node:url";
const given = JSON.parse(readFileSync(0, "utf8")), base = pathToFileURL(process.argv[2] + "/");
const library = await import(new URL(process.argv[3] + ".mjs", base));
const bytes = await readFile(new URL(process.argv[3] + ".wasm", base));
const robot = await library.load(bytes), found = [];
for (const [what, values, more] of given) {
    try {
        if (what === "parameters") robot.parameters.set(values), found.push(robot.prepare());
        else if (what === "carry" || what === "start") found.push(robot[what](values));
        else {
            const result = robot[what](values, more);
            for (const [name, x] of Object.entries(result)) result[name] = x.length ? [...x] : x;
            found.push(result);
        }
    } catch (error) {
        found.push(`${error.name}: ${error.message}`);
    }
}
const told = await library.provenance(bytes), module = await WebAssembly.compile(bytes);
const imports = WebAssembly.Module.imports(module), { statuses, functions, places } = library;
console.log(JSON.stringify({ found, told, imports, statuses, functions, places }));
"""


def rows(**arrays):
    return {name: np.ravel(values).tolist() for name, values in arrays.items()}


def node(folder, prefix, calls):
    """What JavaScript gets from calls, and what it is told."""
    script = folder / "try.mjs"
    script.write_text(SCRIPT)
    done = subprocess.run(
        ["node", script, folder, prefix], input=json.dumps(calls), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    for result in answer["found"]:
        if isinstance(result, dict):
            result |= {k: np.array(x, dtype=float) for k, x in result.items() if isinstance(x, list)}
    return answer


def write(folder, files, module):
    web = WebFiles(module)
    folder.mkdir(exist_ok=True)
    for name, text in (files | web.texts()).items():
        (folder / name).write_text(text, encoding="utf-8")
    web.write(folder, files)
    return folder


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    """The manipulator, with parameters at run time."""
    return write(tmp_path_factory.mktemp("wasm"), controller_files(PAPER), controller_module())


def numbers(parameters):
    """A machine as JavaScript writes it."""
    g, friction = parameters.geometry, parameters.friction
    found = [g.r, g.R, g.L, g.b, *parameters.gravity]
    for link in LINKS:
        body = getattr(parameters.bodies, link)
        found += [body.mass, *body.com, *body.inertia[np.triu_indices(3)]]
    names = list(controller_module().places["viscous"])
    for kind in (friction.viscous, friction.coulomb):
        found += [kind.get(name, 0.0) for name in names]
    limits = parameters.limits
    found += [friction.smoothing, *limits.travel, limits.speed, limits.force, *limits.tilt]
    for of_slides in parameters.actuators.mappings:
        found += [of_slides.get(slide, 0.0) for slide in SLIDES]
    return [float(x) for x in found]


def holds(found, known, function):
    """Whether all outputs of a function are those of a reference."""
    place = 0
    for output in [x for name, x in found.items() if name not in ("good", "status")]:
        values = output.reshape(len(known.amplification), -1)
        expected = known.outputs[function][:, place : place + values.shape[1]]
        place += values.shape[1]
        off = np.abs(values - expected).max(axis=1) / np.abs(expected).max(axis=1)
        assert (off <= 2e-12 * known.amplification).all(), function


@built
@pytest.mark.parametrize("seed", [None, 3, 4])
def test_any_machine_at_run_time(machine, seed):
    parameters = PAPER if seed is None else general(seed)
    known = reference(parameters, count=9)
    module = controller_module()
    calls = [("parameters", numbers(parameters))]
    for function in module.functions:
        given = {one.name: known.inputs[one.name] for one in function.inputs}
        calls.append((function.name, rows(**given)))
    answer = node(machine, "p3dof", calls)
    assert answer["imports"] == []
    status, *found = answer["found"]
    assert status == 0
    for function, result in zip(module.functions, found, strict=True):
        assert result.pop("good") == 9
        assert not result.pop("status").any()
        holds(result, known, function.name)
    robot = p3dof.load(parameters)
    motion = known.inputs["pose"], known.inputs["velocity"], known.inputs["acceleration"]
    expected = robot.forces(*motion, wrench=known.inputs["wrench"], method="compiled")
    off = np.abs(found[0]["forces"].reshape(-1, 3) - expected).max(axis=1)
    assert (off <= 1e-13 * known.amplification * np.abs(expected).max()).all()


@built
def test_numbers_in_the_code(tmp_path):
    parameters = general(5)
    write(tmp_path, controller_files(parameters, bake=True), controller_module(bake=True))
    known = reference(parameters, count=4)
    given = {name: known.inputs[name] for name in ("pose", "velocity", "acceleration", "wrench")}
    answer = node(tmp_path, "p3dof", [("inverse_dynamics", rows(**given))])
    assert "places" not in answer
    (found,) = answer["found"]
    assert found.pop("good") == 4
    found.pop("status")
    holds(found, known, "inverse_dynamics")


@built
def test_payloads_defaults_and_what_is_refused(machine):
    pose, rest = np.array([0.05, 0.1, 0.2]), np.zeros(3)
    state = rows(pose=pose, velocity=rest, acceleration=rest)
    many = rows(pose=np.tile(pose, (70_000, 1)), velocity=rest, acceleration=rest)  # memory has to grow
    bad = [("parameters", numbers(PAPER)[:1]), ("parameters", [0.5, *numbers(PAPER)[1:]])]
    answer = node(
        machine,
        "p3dof",
        [
            ("inverse_dynamics", state),
            ("carry", [2.0, 0.1, 0.0, -0.05, *[0.0] * 6]),
            ("inverse_dynamics", state),
            ("inverse_dynamics", many),
            ("inverse_dynamics", rows(pose=[pose, [9, 0, 0]], velocity=rest, acceleration=rest)),
            ("inverse_dynamics", rows(pose=pose, velocity=rest)),
            ("inverse_dynamics", state | {"speed": [1]}),
            ("inverse_dynamics", state | {"pose": [1, 2]}),
            ("inverse_dynamics", state | rows(pose=np.zeros((2, 3)), velocity=np.zeros((3, 3)))),
            *bad,
        ],
    )
    alone, carried, loaded, all_loaded, half, *errors = answer["found"]
    expected = p3dof.load(PAPER).forces(pose, rest, rest)
    np.testing.assert_allclose(alone["forces"], expected, rtol=1e-12)
    payload = Body(2.0, np.array([0.1, 0.0, -0.05]), np.zeros((3, 3)))
    expected = p3dof.load(PAPER.carrying(payload)).forces(pose, rest, rest)
    assert carried == 0
    np.testing.assert_allclose(loaded["forces"], expected, rtol=1e-12)
    assert all_loaded["good"] == 70_000
    assert np.array_equal(all_loaded["forces"].reshape(-1, 3), np.tile(loaded["forces"], (70_000, 1)))
    assert half["good"] == 1
    assert [answer["statuses"][str(int(s))] for s in half["status"]] == ["OK", "OUT_OF_REACH"]
    assert np.isnan(half["forces"][3:]).all()
    assert np.array_equal(half["forces"][:3], loaded["forces"])
    assert errors[:2] == [
        "TypeError: inverse_dynamics: acceleration is missing",
        "TypeError: inverse_dynamics: no input speed",
    ]
    assert errors[2] == "TypeError: inverse_dynamics: pose has 2 numbers, expected rows of 3"
    assert errors[3] == "TypeError: inverse_dynamics: velocity has 9 numbers, expected rows of 3"
    assert errors[4:] == [0, answer["found"][-1]]
    assert answer["statuses"][str(errors[-1])] == "BAD_PARAMETERS"


@built
def test_any_robot(tmp_path):
    robot = p3dof.load_robot(GALLERY / "stewart.urdf")
    code = loop_files(robot, external=["platform"], inertias=["platform_free"])
    write(tmp_path, code.files, code.web)
    moving = trees.motions(robot, 5, seed=2)
    rng = np.random.default_rng(1)
    push = rng.normal(0, 20, 6)
    inertia = robot.model.inertias[robot.model.getJointId("platform_free")].toDynamicParameters()
    inertia[0] += 3.0
    state = rows(q=moving.q, v=moving.v)
    loads = rows(wrench_platform=push, inertia_platform_free=inertia)
    carrying = p3dof.ClosedLoopModel(robot.model.copy(), robot.sidecar)
    joint = carrying.model.getJointId("platform_free")
    carrying.model.inertias[joint] = type(carrying.model.inertias[joint]).FromDynamicParameters(inertia)
    states = list(zip(moving.q, moving.v, moving.a, strict=True))
    plain = np.array([robot.inverse_dynamics(*one).tau for one in states])
    answer = node(
        tmp_path,
        "stewart",
        [
            ("inverse_dynamics", state | rows(a=moving.a)),
            ("inverse_dynamics", state | rows(a=moving.a) | loads),
            ("forward_dynamics", state | rows(tau=plain)),
            ("step", rows(q=moving.q + 1e-6 * np.eye(robot.model.nq)[0])),
            ("inverse_dynamics", rows(q=moving.q + 0.01, v=moving.v, a=moving.a)),
        ],
    )
    assert answer["imports"] == []
    found, loaded, forward, stepped, opened = answer["found"]
    scale = np.abs(plain).max()
    assert found["good"] == 5
    np.testing.assert_allclose(found["tau"].reshape(5, -1), plain, rtol=0, atol=1e-12 * scale)
    evidence = found["evidence"].reshape(5, 2)
    assert evidence[:, 0].min() > 0.1
    assert evidence[:, 1].max() < 1e-9
    expected = np.array([carrying.inverse_dynamics(*one, {"platform": push}).tau for one in states])
    off = np.abs(loaded["tau"].reshape(5, -1) - expected).max()
    assert off <= 1e-12 * np.abs(expected).max()
    assert off < 1e-3 * np.abs(expected - plain).max()
    np.testing.assert_allclose(
        forward["a"].reshape(5, -1), moving.a, rtol=0, atol=1e-10 * np.abs(moving.a).max()
    )
    gaps = [np.abs(robot.closure_error(q)).max() for q in stepped["q_out"].reshape(5, -1)]
    assert max(gaps) < 1e-11
    assert opened["good"] == 0
    assert {answer["statuses"][str(int(s))] for s in opened["status"]} <= {"OPEN", "SINGULAR"}


@built
def test_a_transmission(tmp_path):
    robot = p3dof.load_robot(GALLERY / "leg.urdf")
    code = loop_files(robot, prefix="ankle", coordinates=["ankle_pitch", "ankle_roll"])
    write(tmp_path, code.files, code.web)
    one = robot.transmission(["ankle_pitch", "ankle_roll"])
    x = np.linspace([-0.45, 0.0], [-0.1, 0.2], 20)
    expected = one.joint_to_actuator(x, np.ones_like(x))
    answer = node(
        tmp_path,
        "ankle",
        [
            ("startTransmission", one.home.tolist()),
            ("joint_to_actuator", rows(position=x, velocity=np.ones((1, 2)))),
            ("joint_to_actuator_forces", rows(forces=[20.0, 5.0])),
            ("joint_to_actuator", rows(position=[1.5, 0.0])),
        ],
    )
    status, found, forces, far = answer["found"]
    assert status == 0
    for name in ("position", "velocity"):
        values = found[f"{name}_out"].reshape(20, 2)
        np.testing.assert_allclose(values, getattr(expected, name), rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        forces["forces_out"], one.actuator_forces(expected.q[-1], [20.0, 5.0]), rtol=1e-11
    )
    assert answer["statuses"][str(int(far["status"][0]))] == "UNREACHED"


@built
def test_a_motion_is_followed(tmp_path):
    robot = p3dof.load_robot(GALLERY / "five_bar.urdf")
    code = loop_files(robot, prefix="bar", inertias=["right_elbow"], observer=True, estimator=True)
    write(tmp_path, code.files, code.web)
    home, time = robot.assemble().q, np.arange(0, 0.2, 0.01)
    w, phase = 2 * np.pi * 2, np.array([0.0, 1.0])
    turned = w * time[:, None] + phase
    angle = home[[0, 2]] + 0.1 * (np.sin(turned) - np.sin(phase))
    speed, push = 0.1 * w * np.cos(turned), -0.1 * w**2 * np.sin(turned)
    steps = np.diff(time, prepend=0.0)
    expected = robot.compile().complete(time, angle, speed, push)
    forces = expected.tau + np.array([1.0, -2.0])
    spread = payload_deviations(2.0, 0.1)
    estimator = robot.payload_estimator("right_elbow", 0.5, spread)
    sample = {
        "forgetting": np.full(len(time), 0.9),
        "gate": np.zeros(len(time)),
        "noise": np.full((len(time), 2), 0.5),
        "q": expected.q,
        "v_independent": expected.v[:, [0, 2]],
        "a_independent": expected.a[:, [0, 2]],
        "tau": forces,
    }
    answer = node(
        tmp_path,
        "bar",
        [
            ("start", home.tolist()),
            ("follow", rows(dt=steps, target=angle, velocity=speed, acceleration=push)),
            ("start", (home + 0.3).tolist()),
            ("startObserver",),
            (
                "observe",
                rows(
                    dt=steps,
                    bandwidth=np.full(len(time), 5.0),
                    q=expected.q,
                    v_independent=expected.v[:, [0, 2]],
                    tau=np.roll(forces, 1, axis=0),  # that acted since the last sample
                ),
            ),
            ("startEstimator", spread.tolist()),
            ("estimate", rows(**sample)),
            ("startEstimator", spread.tolist(), (estimator.design + 0.1).tolist()),
            ("estimate", rows(**sample)),
            ("startEstimator", spread[:9].tolist()),
        ],
    )
    status, found, open_status, _, observed, begun, *estimated, short = answer["found"]
    for answered, more in ((estimated[0], 0.0), (estimated[2], 0.1)):
        one = robot.payload_estimator("right_elbow", 0.5, spread, estimator.design + more, 0.9)
        for state in zip(expected.q, expected.v, expected.a, forces, strict=True):
            one.update(*state)
        for name in ("parameters", "deviations"):
            seen = answered[name].reshape(len(time), 10)[-1]
            np.testing.assert_allclose(seen, getattr(one.body, name), rtol=0, atol=1e-11)
    assert begun == 0
    assert short == "TypeError: startEstimator: expected ten numbers"
    seen = robot.observer(5.0).record(time, expected.q, expected.v, forces, held=True)
    np.testing.assert_allclose(observed["external"].reshape(len(time), 2), seen, rtol=0, atol=1e-12)
    assert np.abs(seen).max() > 1.0
    assert status == 0
    assert found["good"] == len(time)
    for name in ("q", "v", "a", "tau"):
        values = getattr(expected, name)
        atol = 1e-9 * max(1.0, np.abs(values).max())
        np.testing.assert_allclose(found[name].reshape(len(time), -1), values, rtol=0, atol=atol)
    assert answer["statuses"][str(open_status)] == "OK"  # Newton's method closes them


@COMPILED
def test_its_own_mathematics(tmp_path):
    """Sines and the others are not those of a C library: within two units in the last place of 60 digits."""
    names = {"sin": 1, "cos": 1, "tanh": 1, "atan2": 2, "hypot": 2}
    for name, text in builder.mathematics("").items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    renamed = [f"-D{name}=own_{name}" for name in (*names, "memcpy", "memset")]
    flags = ["-std=c99", "-O2", "-shared", "-fPIC", "-fno-builtin", "-ffp-contract=off", "-Iinclude"]
    command = [CC, *flags, *WARNINGS, *renamed, "-o", "own.so", "mathematics.c", "-lm"]
    done = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    library = ctypes.CDLL(str(tmp_path / "own.so"))
    rng = np.random.default_rng(0)
    samples = [*rng.normal(0, 1, 300), *rng.normal(0, 30, 100), *rng.uniform(-1e5, 1e5, 50)]
    samples += [0.0, 1e-9, -1e-300, 20.0, -20.5, 0.17328, 0.5, 1.0, 3e4]
    others = np.roll(samples, 7)
    with mpmath.workprec(200):
        for name, count in names.items():
            own, exact = getattr(library, f"own_{name}"), getattr(mpmath, name)
            own.restype, own.argtypes = ctypes.c_double, [ctypes.c_double] * count
            for arguments in zip(samples, others, strict=True):
                used = [float(x) for x in arguments[:count]]
                expected = exact(*map(mpmath.mpf, used))
                allowed = 2.0 * np.spacing(abs(float(expected)))
                if name in ("sin", "cos", "atan2"):
                    allowed = max(allowed, 4e-16)
                assert abs(own(*used) - expected) <= allowed, (name, used)
        for x, angle in ((1.0, 0.0), (0.0, 0.0), (-1.0, np.pi)):
            assert library.own_atan2(0.0, x) == angle
        assert np.isnan(library.own_sin(1e6))
        assert np.isnan(library.own_tanh(np.nan))
        assert library.own_tanh(np.inf) == 1.0
        assert library.own_hypot(3e300, 4e300) == pytest.approx(5e300, rel=1e-15)


@built
def test_the_same_input_gives_the_same_bytes(machine):
    files = controller_files(PAPER)
    again = webassembly(files["p3dof.h"], files["p3dof.c"], controller_module())
    assert again == (machine / "p3dof.wasm").read_bytes()
    assert len(again) < 50_000
    told = node(machine, "p3dof", [])["told"]
    assert told["compiler"] == builder._version("clang")
    assert len(told["sources"]) == 64


@built
@pytest.mark.parametrize(
    ("prefix", "command"),
    [
        pytest.param("p3dof", ("codegen",), marks=pytest.mark.slow),  # a page of the documentation has it
        ("bar", ("loop", "codegen", str(GALLERY / "four_bar.urdf"), "--prefix", "bar")),
    ],
)
def test_on_the_command_line(capsys, tmp_path, prefix, command):
    made = tmp_path / "out" / prefix
    arguments = (*command, "--wasm", "--out", str(made))
    status, told, error = run(capsys, *arguments)
    assert status == 0, error
    file = made / f"{prefix}.wasm"
    assert f"wrote {file}" in told
    assert run(capsys, *arguments, "--check")[0] == 0
    assert run(capsys, *arguments)[0] == 0  # over its own
    good = file.read_bytes()
    file.write_bytes(
        good.replace(b"Debian clang", b"Zebian clang").replace(b"clang version", b"clang versiom")
    )
    assert run(capsys, *arguments, "--check")[0] == 0  # another compiler's bytes may differ
    place = good.index(b"\x44") + 3  # inside a constant
    file.write_bytes(good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :])
    status, told, _ = run(capsys, *arguments, "--check")
    assert (status, "the same compiler gives other bytes" in told) == (1, True)
    code = made / f"{prefix}.c"
    kept = code.read_text(encoding="utf-8")
    file.write_bytes(good)
    code.write_text(kept + "\n/* more */\n", encoding="utf-8")
    status, told, _ = run(capsys, *arguments, "--check")
    assert (status, "was not built from the C" in told) == (1, True)
    file.unlink()
    status, told, _ = run(capsys, *arguments, "--check")
    assert (status, f"{file}: missing" in told) == (1, True)
    file.write_bytes(b"\0asm of somebody")
    status, _, error = run(capsys, *arguments)
    assert (status, error.count("\n")) == (2, 1)
    assert "was not generated by p3dof" in error
    assert file.read_bytes() == b"\0asm of somebody"
    status, _, error = run(capsys, "codegen", "--kernels", "--wasm")
    assert (status, error.count("\n")) == (2, 1)


def test_without_clang_nothing_is_written(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(builder.shutil, "which", lambda _: None)
    for command in (("codegen",), ("loop", "codegen", str(GALLERY / "four_bar.urdf"))):
        status, _, error = run(capsys, *command, "--wasm", "--out", str(tmp_path / "out"))
        assert (status, error.count("\n")) == (2, 1)
        assert "WebAssembly needs clang and wasm-ld" in error
        assert not (tmp_path / "out").exists()


def test_a_clang_without_webassembly_is_told(capsys, tmp_path, monkeypatch):
    old = tmp_path / "clang"
    old.write_text(
        "#!/bin/sh\necho \"error: unable to create target: 'No available targets wasm32'\" >&2\nexit 1\n"
    )
    old.chmod(0o755)
    monkeypatch.setattr(builder, "tools", lambda: (str(old), str(old)))
    status, _, error = run(capsys, "codegen", "--wasm", "--out", str(tmp_path / "out"))
    assert (status, error.count("\n")) == (2, 1)
    assert "knows no WebAssembly" in error
    assert not Path(tmp_path / "out").exists()
