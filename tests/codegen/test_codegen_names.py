"""Generated C in a larger program: names with a prefix, where files come from, the machine's limits."""

from __future__ import annotations

import ctypes
import re
from dataclasses import replace

import numpy as np
import pytest
from compilers import COMPILED, each_c, each_cpp
from gallery import GALLERY, gallery
from generated_c import (
    BAD_PARAMETERS,
    MACHINES,
    OK,
    STRICT,
    WARNINGS,
    CModel,
    CParameters,
    build,
    general,
    library_of_any_machine,
    load_library,
    run,
    write,
)
from machines import random_states

import p3dof
from p3dof._base.errors import InputError
from p3dof._base.files import write_generated
from p3dof.cli import main
from p3dof.codegen import controller
from p3dof.codegen.controller import controller_files
from p3dof.codegen.loops import loop_files
from p3dof.codegen.web_controller import controller_module
from p3dof.machine.parameters import PAPER, SOLIDS
from p3dof.methods.utilisation import exceedances_of

LIMITS = p3dof.machine.Limits(travel=(-0.1, 0.15), speed=1.5, force=200.0, tilt=(-0.3, 0.5))
BEYOND = 6


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return library_of_any_machine(tmp_path_factory.mktemp("library"))


def bits(robot, pose, velocity, forces):
    """What is beyond the limits, as C tells it, from what Python says of a motion of one sample."""
    motion = p3dof.Motion([0.0], [pose], [velocity], [np.zeros(3)], check=False)
    result = robot.inverse_dynamics(motion, method="compiled")
    limits = robot.parameters.limits
    speeds = result.slider_velocities
    place = {"travel": 0, "speed": 3, "force": 6}
    found = 0
    for one in exceedances_of(limits, motion, result.sliders, speeds, np.array([forces])):
        found |= 512 if one.quantity == "tilt" else 1 << (place[one.quantity] + "ABC".index(one.leg))
    return found


@COMPILED
@pytest.mark.parametrize("bake", [False, True])
def test_limits_are_those_of_python(tmp_path, bake):
    machine = replace(general(4), limits=LIMITS)
    robot, loaded = p3dof.load(machine), load_library(write(tmp_path, machine, bake))
    model = None if bake else loaded.prepare(machine)
    first = [] if bake else [ctypes.byref(model)]
    states = random_states(machine, 3, 100)
    forces = np.random.default_rng(3).normal(0, 150, (100, 3))
    seen = 0
    for q, v, f in zip(0.5 * states.pose, 0.5 * states.velocity, forces, strict=True):  # nearer home
        found = ctypes.c_uint(77)
        if not np.isfinite(robot.sliders(q, on_invalid="nan")).all():
            continue
        rows = [np.ascontiguousarray(x).ctypes.data_as(ctypes.c_void_p) for x in (q, v, f)]
        status = loaded.c.p3dof_within_limits(*first, *rows, ctypes.byref(found))
        expected = bits(robot, q, v, f)
        assert (status, found.value) == (BEYOND if expected else OK, expected)
        assert loaded.c.p3dof_within_limits(*first, *rows, None) == status
        loaded.c.p3dof_within_limits(*first, rows[0], None, None, ctypes.byref(found))
        assert found.value == expected & (0b111 | 512)
        seen |= expected
    assert seen == 1023


@pytest.mark.parametrize(
    ("name", "value"),
    [("travel", (0.1, 0.2)), ("travel", (-1, np.inf)), ("tilt", (-1, 0)), ("tilt", (np.nan, 1))]
    + [(name, value) for name in ("speed", "force") for value in (0.0, -1.0, np.nan, np.inf)],
)
def test_bad_limits_are_refused(library, name, value):
    parameters, model = CParameters.of(general(4)), CModel()
    setattr(parameters, name, value)
    assert library.c.p3dof_prepare(ctypes.byref(parameters), ctypes.byref(model)) == BAD_PARAMETERS


PROGRAM = """
#include <stdio.h>
#include "left.h"
#include "right_arm.h"
#include "bar.h"

int main(void)
{
    const double q[3] = {0.01, 0.02, 0.1}, v[3] = {0.1, -0.2, 0.3}, a[3] = {1.0, 2.0, -3.0};
    const double joints[4] = {0.0, 0.0, 0.0, 0.0};
    double one[3], two[3], tau[2], lambda[3];
    left_model model;
    unsigned int exceeded;
    bar_evidence evidence;
    if ((left_prepare(&left_machine, &model) != LEFT_OK)
        || (left_inverse_dynamics(&model, q, v, a, NULL, one) != LEFT_OK)
        || (right_arm_inverse_dynamics(q, v, a, NULL, two) != RIGHT_ARM_OK)
        || (right_arm_within_limits(q, v, two, &exceeded) == RIGHT_ARM_NULL_POINTER)
        || (bar_inverse_dynamics(joints, joints, joints, tau, lambda, &evidence) == BAR_NULL_POINTER)) {
        return 1;
    }
    printf("%.17g %.17g %.17g %.17g %.17g %.17g", one[0], one[1], one[2], two[0], two[1], two[2]);
    return 0;
}
"""


def write_program(folder):
    """A program of two manipulators and a five-bar, each with its own prefix."""
    texts = controller_files(PAPER, prefix="left") | controller_files(MACHINES["general"], True, "right_arm")
    texts |= loop_files(gallery("five_bar"), "bar", ["inverse_dynamics"]).files
    for name, text in texts.items():
        (folder / name).write_text(text)
    (folder / "program.c").write_text(PROGRAM)
    return "program.c", "left.c", "right_arm.c", "bar.c"


def expected_forces():
    q, v, a = [0.01, 0.02, 0.1], [0.1, -0.2, 0.3], [1.0, 2.0, -3.0]
    machines = PAPER, MACHINES["general"]
    return np.concatenate([p3dof.load(one).forces(q, v, a, method="virtual-power") for one in machines])


@each_c
def test_two_machines_have_room_in_one_program(tmp_path, compiler):
    sources = write_program(tmp_path)
    program = build(tmp_path, "-std=c99", "-O0", *WARNINGS, compiler=compiler, sources=sources)
    done = run(program)
    assert done.returncode == 0
    np.testing.assert_allclose(np.fromstring(done.stdout, sep=" "), expected_forces(), rtol=1e-12)


@each_cpp
def test_and_in_one_of_cpp(tmp_path, compiler):
    sources = write_program(tmp_path)
    program = build(tmp_path, "-std=c++11", "-O0", "-xc++", *WARNINGS, compiler=compiler, sources=sources)
    assert run(program).returncode == 0


@COMPILED
def test_the_selftest_has_the_prefix_too(tmp_path):
    write_generated(controller_files(PAPER, True, "arm"), tmp_path, controller.MARK)
    sources = ("arm.c", "arm_selftest.c")
    done = run(build(tmp_path, "-std=c99", "-O0", *WARNINGS, *STRICT, sources=sources))
    assert done.returncode == 0, done.stdout
    assert run(tmp_path / "selftest", "--fast").stdout.startswith("usage: arm_selftest")


def test_a_prefix_is_that_of_every_name():
    for bake in (False, True):
        files = controller_files(PAPER, bake, "arm2")
        plain = controller_files(PAPER, bake)
        assert set(files) == {name.replace("p3dof", "arm2") for name in plain}
        for name, text in plain.items():
            other = files[name.replace("p3dof", "arm2")]
            assert not re.search(r"\bp3dof[_.]|P3DOF", other)
            _, body = other.split("do not edit.", 1)
            words = text.split("do not edit.", 1)[1]
            assert body == words.replace("P3DOF", "ARM2").replace("p3dof", "arm2")
    for wrong in ("", "Arm", "2arm", "a-b", "ä", "a" * 50, "math", None, 3, "arm\n"):
        with pytest.raises(InputError, match=r"^prefix: expected"):
            controller_files(PAPER, prefix=wrong)


def first_line(**changes):
    command = changes.pop("command", "")
    return controller_files(replace(SOLIDS, **changes), command=command)["p3dof.h"].splitlines()[0]


def test_files_say_where_they_come_from():
    line = first_line()
    version = re.escape(p3dof.__version__)
    pattern = rf"/\* Generated by `p3dof codegen` \(p3dof {version}, machine [0-9a-f]{{12}}\): do not edit\."
    assert re.fullmatch(pattern, line)
    rounded = replace(SOLIDS.geometry, L=SOLIDS.geometry.L * (1 + 1e-15))
    assert first_line(geometry=rounded) == line
    others = {
        first_line(geometry=replace(SOLIDS.geometry, L=SOLIDS.geometry.L * (1 + 1e-9))),
        first_line(limits=LIMITS),
        first_line(friction=p3dof.machine.Friction({"joints": 1.0})),
        first_line(gravity=(0, 0, -9.7)),
    }
    assert len({line, *others}) == 5
    given = first_line(command="p3dof codegen --parameters 'a */ b\n`\\.yaml'")
    assert given.count("*/") == 0
    assert "'a _ b___.yaml'" in given
    assert first_line(command="make all") == line


def test_a_robots_files_say_where_they_come_from(tmp_path, capsys):
    robot = gallery("five_bar")
    line = loop_files(robot, functions=["inverse_dynamics"]).files["five_bar.h"].splitlines()[0]
    version = re.escape(p3dof.__version__)
    assert re.search(
        rf"`p3dof loop codegen --prefix five_bar` \(p3dof {version}, robot [0-9a-f]{{12}}\)", line
    )
    heavier = robot.copy()
    heavier.model.inertias[1].mass *= 2
    again = loop_files(type(robot)(heavier.model, robot.sidecar), functions=["inverse_dynamics"])
    assert again.files["five_bar.h"].splitlines()[0] != line
    assert main(["loop", "codegen", str(GALLERY / "five_bar.urdf"), "--out", str(tmp_path / "c")]) == 0
    capsys.readouterr()
    for path in (tmp_path / "c").iterdir():
        text = path.read_text(encoding="utf-8")
        assert "Generated by `p3dof loop codegen five_bar.urdf` (p3dof " in text[:200]
        assert str(tmp_path) not in text


@pytest.mark.parametrize("command", [("codegen",), ("loop", "codegen", str(GALLERY / "five_bar.urdf"))])
def test_a_second_prefix_does_not_take_the_makefile_of_the_first(tmp_path, capsys, command):
    out = tmp_path / "c"
    assert main([*command, "--prefix", "left", "--out", str(out)]) == 0
    there = {path.name: path.read_bytes() for path in out.iterdir()}
    assert main([*command, "--prefix", "right", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "Makefile: would be overwritten, but belongs to the C of left; use another folder" in error
    assert {path.name: path.read_bytes() for path in out.iterdir()} == there
    assert main([*command, "--prefix", "left", "--out", str(out)]) == 0
    assert main([*command, "--prefix", "right", "--out", str(out), "--force"]) == 0
    assert "right.c" in (out / "Makefile").read_text()


@pytest.mark.parametrize("bake", [False, True])
def test_the_webassembly_hands_over_rows_as_the_header_declares_them(bake):
    header = controller_files(PAPER, bake)["p3dof.h"]
    declared = {
        name: dict(re.findall(r"double (\w+)((?:\[\w+\])+)", arguments))
        for name, arguments in re.findall(r"^p3dof_status p3dof_(\w+)\(([^)]*)\)", header, re.MULTILINE)
    }
    for function in controller_module(bake).functions:
        for rows in (*function.inputs, *function.outputs):
            _, *inner = re.findall(r"\[\w+\]", declared[function.name][rows.name])
            assert rows.cast == (f"(double (*){inner[0]})" if inner else ""), rows.name
            assert rows.optional == (rows.name == "wrench")
