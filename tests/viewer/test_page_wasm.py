"""The WebAssembly of the page, as it is committed: what it computes, and which sources it is of."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from command_line import run
from page_machines import COUNTS, MACHINES, known

import p3dof
from p3dof.closed_form import kinematics
from p3dof.codegen import web_controller as page_wasm
from p3dof.codegen.webassembly import compiler_here, section_of
from p3dof.viewer.machine.document import engine_row

BOUND = 1e-12
"""Largest difference from Pinocchio, relative to the largest value of a kind."""
with_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
SCRIPT = """
import { readFileSync } from "node:fs";
import { load } from "./p3dof.mjs";
const bytes = readFileSync(process.argv[2]), robot = await load(bytes);
const imports = WebAssembly.Module.imports(new WebAssembly.Module(bytes));
const { parameters, calls } = JSON.parse(readFileSync(0, "utf8"));
robot.parameters.set(parameters);
const prepared = robot.prepare(), found = {};
for (const [name, given] of Object.entries(calls)) {
    found[name] = {};
    for (const [key, values] of Object.entries(robot[name](given)))
        found[name][key] = values.length === undefined ? values : [...values].map((x) => x);
}
console.log(JSON.stringify({ prepared, imports, found }));
"""


def called(folder, parameters, calls):
    """Return what the committed file says in Node."""
    (folder / "p3dof.mjs").write_text(page_wasm.page_wasm()[0].module.loader(), encoding="utf-8")
    (folder / "try.mjs").write_text(SCRIPT, encoding="utf-8")
    given = {name: {k: np.ravel(x).tolist() for k, x in each.items()} for name, each in calls.items()}
    for each in given.values():
        if "theta" in each:
            (each["theta"],) = each["theta"]
    text = json.dumps({"parameters": engine_row(parameters), "calls": given})
    command = ["node", folder / "try.mjs", page_wasm.DIRECTORY / "p3dof.wasm"]
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["prepared"], answer["imports"]) == (0, [])
    return {
        name: {key: np.array(values, dtype=float) for key, values in each.items()}
        for name, each in answer["found"].items()
    }


@with_node
@pytest.mark.parametrize("name", MACHINES)
def test_all_is_as_pinocchio_has_it(tmp_path, name):
    expected = known(name)
    motion = {key: getattr(expected, key) for key in ("pose", "velocity", "acceleration", "wrench")}
    pose = {"pose": expected.pose}
    functions = ("inverse_kinematics", "joints", "jacobian", "mass_matrix")
    found = called(tmp_path, MACHINES[name], {"inverse_dynamics": motion} | dict.fromkeys(functions, pose))
    rows = {
        "inverse_dynamics": ("forces", expected.forces),
        "inverse_kinematics": ("sliders", expected.joints[:, [0, 2, 4]]),
        "joints": ("joints", expected.joints),
        "jacobian": ("jacobian", expected.jacobian),
        "mass_matrix": ("mass", expected.mass),
    }
    out = np.isnan(expected.joints).any(axis=1)
    assert out.sum() == (0 if name == "paper" else COUNTS[name] // 10)
    for function, (key, values) in rows.items():
        result = found[function]
        np.testing.assert_array_equal(result["status"], 2.0 * out, err_msg=function)
        off = np.abs(result[key].reshape(values.shape) - values)
        np.testing.assert_array_equal(np.isnan(off).any(axis=1), out)
        assert np.nanmax(off) <= BOUND * np.nanmax(np.abs(values)), function


def test_states_are_as_many_as_promised():
    assert sum(COUNTS.values()) == 8001


@with_node
def test_there_and_back_again(tmp_path):
    expected = known("paper")
    forces = {"pose": expected.pose, "velocity": expected.velocity, "forces": expected.forces}
    sliders = {"sliders": expected.joints[:, [0, 2, 4]]}
    found = called(tmp_path, p3dof.PAPER, {"forward_dynamics": forces, "forward_kinematics": sliders})
    again = found["forward_dynamics"]["acceleration"].reshape(-1, 3)
    assert np.abs(again - expected.acceleration).max() <= BOUND * np.abs(expected.acceleration).max()
    assert np.abs(found["forward_kinematics"]["pose"].reshape(-1, 3) - expected.pose).max() <= BOUND


@with_node
@pytest.mark.parametrize("name", ["paper", "payload"])
def test_the_map_is_what_the_platform_can_do_at_rest(tmp_path, name):
    parameters, theta, wrench = MACHINES[name], 0.3, np.array([5.0, 20.0, -40.0, 0.0, 1.5, 0.0])
    y, z = np.linspace(-0.39, 0.39, 33), np.linspace(-0.3, 0.3, 25)
    found = called(tmp_path, parameters, {"map": {"theta": theta, "y": y, "z": z, "wrench": wrench}})["map"]
    robot, nan = p3dof.Manipulator(parameters), {"on_invalid": "nan"}
    pose = np.stack(np.broadcast_arrays(y[:, None], z[None, :], theta), axis=-1)
    held = robot.forces(pose, 0 * pose, 0 * pose, wrench=wrench, method="pinocchio", **nan)
    forces = found["forces"].reshape(-1, 1, 3)
    bound = BOUND * np.nanmax(np.abs(held))
    np.testing.assert_allclose(np.broadcast_to(forces, held.shape), held, rtol=0, atol=bound)
    angle = kinematics.singularity(parameters.geometry, pose[:, 0]).actuation
    np.testing.assert_allclose(found["margins"], angle, rtol=0, atol=1e-9)
    sliders = kinematics.inverse_kinematics(parameters.geometry, pose, **nan).sliders
    limits = parameters.limits
    beyond = ((sliders < limits.travel[0]) | (sliders > limits.travel[1])).any(axis=-1)
    beyond |= (np.abs(held) > limits.force).any(axis=-1)
    expected = np.where(np.isnan(held).any(axis=-1), 2, np.where(beyond, 6, 0))
    assert set(np.unique(expected)) == {0, 2, 6}
    np.testing.assert_array_equal(found["status"].reshape(33, 25), expected)


def test_the_file_is_that_of_the_sources(capsys):
    assert run(capsys, "codegen", "--page", "--check")[0] == 0
    content = (page_wasm.DIRECTORY / "p3dof.wasm").read_bytes()
    assert len(content) < 20_000
    told = section_of(content)
    if told["compiler"] == compiler_here():
        web, texts = page_wasm.page_wasm()
        assert web.compare(page_wasm.DIRECTORY, *texts.values()) == []


def test_a_file_of_other_sources_is_found_out(capsys, tmp_path, monkeypatch):
    web, texts = page_wasm.page_wasm()
    header, library = texts.values()
    assert web.compare(tmp_path, header, library) == [f"{tmp_path / 'p3dof.wasm'}: missing"]
    (told,) = web.compare(page_wasm.DIRECTORY, header, library + "/* more */")
    assert "was not built from the C" in told
    monkeypatch.setattr("p3dof.cli.codegen.PAGE", tmp_path)
    assert run(capsys, "codegen", "--page", "--check")[0] == 1
    assert run(capsys, "codegen", "--page", "--out", str(tmp_path))[0] == 2
