"""Every line of the page on other tools as it stands there, for who installed the package and the tool."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pinocchio as pin
import pytest
from documents import ROOT

import p3dof
from p3dof._base.errors import ModelError
from p3dof.machine import description
from p3dof.machine.parameters import PAPER, Actuators

PAGE = (ROOT / "docs/how-to/other-tools.md").read_text("utf-8")
ROWS = dict(re.findall(r"^\| ([^|]+?) \| [\d.]+ \| `([^`]+)`", PAGE, re.MULTILINE))
VERSIONS = dict(re.findall(r"^\| ([^|]+?) \| ([\d.]+) \| `", PAGE, re.MULTILINE))
LEFT = re.findall(
    r"^\| ([^|]+?) \| (`p3dof[^|]+?) \| (\w[^|]*?) \|([^|]*)\| (\w[^|]*?) \|$", PAGE, re.MULTILINE
)
"""Tool, file, and what becomes of loops, mimic and the inertia of motors."""
INERTIA = 3.0  # kg, of the motors in the files that are read here
ARMED = replace(PAPER, actuators=Actuators(armature={"sliders": INERTIA}))
PACKAGES = {
    "example-robot-data style": "example-robot-data",
    "Pinocchio": "pin",
    "Pinocchio's MJCF reader": "pin",
    "DART": "dartpy",
    "Rerun": "rerun-sdk",
    "Robotics Toolbox": "roboticstoolbox-python",
}
"""What a tool is called on the index, where that is not its name."""
DEBIAN = ("check_urdf", "libsdformat")
"""Whose version is Debian's."""
WORLDS = ("libsdformat",)
"""Whose line is one of a world's file."""
HERE = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}


def test_the_table_has_all_tools():
    assert len(ROWS) == 17


@pytest.mark.parametrize("tool", sorted(ROWS.keys() - set(WORLDS)))
def test_a_line_is_complete_as_written(tool, tmp_path):
    line = ROWS[tool]
    if line.startswith("import "):
        first, _, others = line.partition("; ")
        needed = re.findall(r"(?:import|,) +(\w+)", first) + re.findall(r"from (\w+)", others)
        needed += ["pxr"] * ("usd" in line)  # by which newton reads it
        missing = [module for module in needed if find_spec(module) is None]
        command = [sys.executable, "-c", line]
    else:
        missing = [] if shutil.which(line.split()[0]) else line.split()[:1]
        command = ["sh", "-c", line]
    if missing:
        pytest.skip(f"{missing[0]} is not installed")
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=HERE)
    assert ran.returncode == 0, ran.stderr
    assert "Traceback" not in ran.stderr


def _pinocchio(file):
    robot = p3dof.load_robot(file)
    return len(robot.constraint_models), 10 - robot.model.nv, max(robot.model.armature)


def _wrapper(file):
    model = pin.RobotWrapper.BuildFromURDF(str(file)).model
    return 0, 10 - model.nv, max(model.armature)


def _pinocchio_mjcf(file):
    model, points, frames = pin.buildModelAndConstraintsFromMJCF(str(file))
    return len(points) + len(frames), 10 - model.nv, max(model.armature)


def _mujoco(file):
    mujoco = pytest.importorskip("mujoco", reason="mujoco not installed: pip install 'p3dof[engines]'")
    model = mujoco.MjModel.from_xml_path(str(file))
    kinds = list(model.eq_type)
    loops, ties = (kinds.count(kind) for kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_JOINT))
    return loops, ties, model.dof_armature.max()


def _drake(file):
    every = pytest.importorskip("pydrake.all", reason="drake not installed: pip install 'p3dof[engines]'")
    plant = every.MultibodyPlant(1e-3)
    every.Parser(plant).AddModels(str(file))
    plant.Finalize()
    motors = [
        plant.get_joint_actuator(i).default_reflected_inertia() for i in plant.GetJointActuatorIndices()
    ]
    count = plant.num_constraints()  # of balls in the one file, of couplers in the other
    return (count, 0, max(motors)) if "drake" in file.name else (0, count, max(motors, default=0))


def _newton(file):
    newton = pytest.importorskip("newton", reason="newton not installed: pip install 'p3dof[interop]'")
    builder = newton.ModelBuilder()
    (builder.add_usd if file.suffix == ".usda" else builder.add_urdf)(str(file))
    model = builder.finalize(device="cpu")
    loops, ties = (model.joint_articulation.numpy() < 0).sum(), (model.joint_mimic_joint.numpy() >= 0).sum()
    return loops, ties, model.joint_armature.numpy().max()


def _usd(file):
    pytest.importorskip("pxr", reason="usd-core not installed: pip install 'p3dof[usd]'")
    from pxr import Usd, UsdPhysics

    stage = Usd.Stage.Open(str(file))  # whose prims end with it
    prims = list(stage.Traverse())
    apart = [UsdPhysics.Joint(p).GetExcludeFromArticulationAttr() for p in prims if p.IsA(UsdPhysics.Joint)]
    inertia = [prim.GetAttribute("newton:armature").Get() or 0.0 for prim in prims]
    return sum(bool(one.Get()) for one in apart), 0, max(inertia)


def _bullet(file):
    bullet = pytest.importorskip("pybullet", reason="pybullet not installed: pip install 'p3dof[interop]'")
    client = bullet.connect(bullet.DIRECT)
    robot = bullet.loadURDF(
        str(file), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
    )
    joints = [bullet.getJointInfo(robot, i, client)[2] for i in range(bullet.getNumJoints(robot, client))]
    ties = 10 - sum(kind != bullet.JOINT_FIXED for kind in joints)
    loops = bullet.getNumConstraints(client)
    bullet.disconnect(client)
    return loops, ties, 0.0  # it has no word for it


def _dart(file):
    dart = pytest.importorskip("dartpy", reason="dartpy not installed: pip install 'p3dof[interop]'")
    robot = dart.utils.DartLoader().parseSkeleton(str(file))
    kinds = [robot.getJoint(i).getActuatorType() for i in range(robot.getNumJoints())]
    return 0, kinds.count(dart.dynamics.ActuatorType.MIMIC), 0.0


def _yourdfpy(file):
    tool = pytest.importorskip("yourdfpy", reason="yourdfpy not installed: pip install 'p3dof[interop]'")
    return 0, 10 - len(tool.URDF.load(str(file)).actuated_joint_names), 0.0


def _urchin(file):
    tool = pytest.importorskip("urchin", reason="urchin not installed: pip install 'p3dof[interop]'")
    return 0, 10 - len(tool.URDF.load(str(file)).actuated_joints), 0.0


def _urdf_parser(file):
    tool = pytest.importorskip("urdf_parser_py.urdf", reason="urdf_parser_py not installed")
    return (
        0,
        sum(joint.mimic is not None for joint in tool.URDF.from_xml_string(file.read_bytes()).joints),
        0.0,
    )


def _rerun(file):
    tool = pytest.importorskip("rerun.urdf", reason="rerun not installed: pip install 'p3dof[interop]'")
    joints = tool.UrdfTree.from_file_path(str(file)).joints()
    return 0, sum(joint.mimic is not None for joint in joints), 0.0


def _toolbox(file):
    tool = pytest.importorskip("roboticstoolbox", reason="roboticstoolbox not installed")
    reader = pytest.importorskip("roboticstoolbox.models.URDF.URDFRobot")
    robot = tool.Robot(reader.URDF_file(str(file))[0])
    return 0, 10 - robot.n, max(abs(link.Jm) for link in robot.links)


READERS: dict[str, Callable[[Path], tuple[int, int, float]]] = {
    "Pinocchio": _pinocchio,
    "example-robot-data style": _wrapper,
    "MuJoCo": _mujoco,
    "Pinocchio's MJCF reader": _pinocchio_mjcf,
    "Drake": _drake,
    "Newton": _newton,
    "usd-core": _usd,
    "PyBullet": _bullet,
    "DART": _dart,
    "yourdfpy": _yourdfpy,
    "viser": _yourdfpy,  # by which it reads
    "urchin": _urchin,
    "urdf_parser_py": _urdf_parser,
    "Rerun": _rerun,
    "Robotics Toolbox": _toolbox,
}
"""How many loops and tied joints a tool has, and the inertia of a motor [kg]."""


@pytest.fixture(scope="module")
def armed(tmp_path_factory):
    """Files of a machine whose motors have inertia, in every format that has a word for it."""
    folder = tmp_path_factory.mktemp("armed")
    description.write(ARMED, folder, ("urdf", "mjcf", "drake", *["usd"] * (find_spec("pxr") is not None)))
    return folder


@pytest.mark.filterwarnings("ignore:`Scene.dump")
@pytest.mark.parametrize(
    "row", [row for row in LEFT if row[0] not in WORLDS], ids=lambda row: " ".join(row[:2])
)
def test_what_a_tool_keeps_and_leaves_out_is_what_the_page_says(row, armed, request):
    tool, files, *told = row
    if ".usda" in files:
        pytest.importorskip("pxr", reason="usd-core not installed: pip install 'p3dof[usd]'")
    if tool == "Newton" and find_spec("warp"):
        request.getfixturevalue("warp_cache")
    found = READERS[tool](armed / re.search(r"`(.+?)`", files)[1])
    assert found[0] in (0, 3)
    assert found[1] in (0, 2)
    assert found[2] in (0, pytest.approx(INERTIA, rel=1e-6))
    for number, words in zip(found, map(str.strip, told), strict=True):
        assert words.partition(":")[0] in (("kept",) if number else ("lost", "")), row
    has_mimic = "<mimic " in (armed / re.search(r"`(.+?)`", files)[1]).read_text(encoding="utf-8")
    assert bool(told[1].strip()) == has_mimic


def test_sdf_refuses_the_inertia_of_motors(tmp_path):
    """What libsdformat has of the loops and of <mimic> is in `test_sdformat.py`."""
    with pytest.raises(ModelError, match="SDF has no word for an inertia of its motor"):
        description.write(ARMED, tmp_path, ("sdf",))
    rows = {files: list(map(str.strip, told)) for tool, files, *told in LEFT if tool in WORLDS}
    assert rows == {
        "`p3dof.sdf`": ["kept", "", "refused by the writer"],
        "`p3dof.urdf`": ["lost", "lost", "lost"],
    }
    there = (ROOT / "tests/interop/test_sdformat.py").read_text("utf-8")
    assert "<mimic> and the loops are lost" in there
    assert "def test_loops_are_joints_that_close_at_home(" in there


def test_what_is_left_out_is_told_of_every_tool():
    assert {tool for tool, *_ in LEFT} == ROWS.keys() - {"check_urdf"}
    assert set(READERS) | {"libsdformat"} == {tool for tool, *_ in LEFT}


def test_versions_are_those_that_are_tested():
    pinned = re.findall(r"^([\w.-]+)==([\d.]+)", (ROOT / "constraints.txt").read_text("utf-8"), re.MULTILINE)
    versions = {name.lower().replace("-", "_"): version for name, version in pinned}
    for tool in VERSIONS.keys() - set(DEBIAN):
        package = PACKAGES.get(tool, tool).lower().replace("-", "_")
        assert VERSIONS[tool] == versions[package], tool
    assert len(VERSIONS) == 17
