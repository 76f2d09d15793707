"""The package for ROS 2: built against stubs of its libraries, and fed with messages in both languages."""

import ctypes
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin
import pytest
import ros2_robots
import ros2_stubs
from command_line import run
from compilers import CC, COMPILED
from gallery import GALLERY, gallery
from generated_c import WARNINGS
from numpy.testing import assert_allclose

import p3dof
from p3dof._base.errors import AssemblyError, FileError, InputError, ModelError
from p3dof.codegen.ros2 import ros2_files, write_ros2
from p3dof.loops import Sidecar
from p3dof.machine.description import texts
from p3dof.machine.parameters import PAPER

ELBOWS = ["right_elbow", "left_elbow"]
MOTORS = ["left_motor", "right_motor"]


def machine():
    urdf, sidecar = texts(PAPER, ("urdf",)).values()
    return p3dof.load_robot(urdf, sidecar), urdf


def five_bar():
    return gallery("five_bar")


def package(name):
    """The files of a robot's package, and the robot."""
    if name == "p3dof":
        robot, urdf = machine()
        return robot, ros2_files(robot, description=urdf)
    robot = {**ros2_robots.ROBOTS, "five_bar": five_bar}.get(name, lambda: gallery(name))()
    shapes = GALLERY / f"{name}.urdf"
    return robot, ros2_files(robot, f"{name}_bot", shapes=shapes if shapes.is_file() else None)


def names_of(files):
    """The joints of the relay, in their order."""
    row = re.search(r"^JOINTS = \[(.*?)\]", files["scripts/relay.py"], re.M | re.S)[1]
    return re.findall(r"'(\w+)'", row)


def core(folder, files, name):
    """The relay's C, compiled with all warnings."""
    for file in (f"{name}.c", f"{name}.h", f"{name}_relay.c", f"{name}_relay.h"):
        (folder / file).write_text(files[f"src/{file}"], encoding="utf-8")
    flags = ["-std=c99", "-O0", *WARNINGS, "-shared", "-fPIC", "-o", "core.so"]
    command = [CC, *flags, f"{name}.c", f"{name}_relay.c", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return ctypes.CDLL(str(folder / "core.so"))


def configuration(model, names, position):
    """q of an open tree whose joints have one freedom each."""
    q = pin.neutral(model)
    for name, value in zip(names, position, strict=True):
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    return q


EACH = [
    "free",
    "five_bar",
    *(
        pytest.param(name, marks=pytest.mark.slow)
        for name in ("plane", "ball", "p3dof", "delta", "leg", "stewart")
    ),
]


@COMPILED
@pytest.mark.parametrize("name", EACH)
def test_all_joints_are_those_of_the_assembly(tmp_path, name):
    """The description, in the joints of the relay, puts every link where p3dof has it, as fast."""
    robot, files = package(name)
    compare(tmp_path, name, robot, files)
    if name == "free":  # and notices an angle that turns the other way
        relay = files["src/free_bot_relay.c"]
        files["src/free_bot_relay.c"] = relay.replace("atan2(-r12, r22)", "atan2(r12, r22)")
        assert files["src/free_bot_relay.c"] != relay
        (tmp_path / "broken").mkdir()
        with pytest.raises(AssertionError, match="Not equal to tolerance"):
            compare(tmp_path / "broken", name, robot, files)


def compare(tmp_path, name, robot, files):
    for file in ("scripts/relay.py", f"launch/{files['package.xml'].split('name>')[1][:-2]}.launch.py"):
        compile(files[file], file, "exec")
        assert max(map(len, files[file].splitlines())) <= 99  # what ament_flake8 allows
    prefix = name if name == "p3dof" else f"{name}_bot"
    c, row = core(tmp_path, files, prefix), ctypes.c_double
    made = robot.transmission(robot.actuated, robot.actuated, "numpy")
    described = pin.buildModelFromXML(files[f"urdf/{prefix}.urdf"])
    ours, theirs = robot.model.createData(), described.createData()
    names, n = names_of(files), len(robot.actuated)
    assert sorted(names) == sorted(list(described.names)[1:])
    state = ctypes.create_string_buffer(getattr(c, f"{prefix}_relay_size")())
    assert getattr(c, f"{prefix}_relay_start")(state) == 0
    rng, seen = np.random.default_rng(3), 0
    home = made.positions("actuator", made.home)
    slides = np.array(
        [robot.model.joints[robot.model.getJointId(j)].shortname()[10] == "P" for j in robot.actuated]
    )
    for _ in range(8):
        y = home + rng.uniform(-0.15, 0.15, n) * np.where(slides, 0.2, 1.0)
        v = rng.normal(size=n)
        at, rate, some = (row * len(names))(), (row * len(names))(), [(row * n)() for _ in range(3)]
        given = [(row * n)(*y), (row * n)(*v), (row * n)(*v)]
        status = getattr(c, f"{prefix}_relay_states")(state, *given, at, rate, *some)
        there = made.actuator_to_joint(y[None], v[None])
        assert (status == 0) == (not there.errors)
        if status:
            continue
        seen += 1
        assert_allclose(np.array(some), [y, v, v], rtol=0, atol=1e-12)
        full = robot.complete(dict(zip(robot.actuated, y.tolist(), strict=True)), v, 0 * v, guess=there.q[0])
        pin.forwardKinematics(robot.model, ours, full.q, full.v)
        q = configuration(described, names, at)
        speed = np.zeros(described.nv)
        for one, value in zip(names, rate, strict=True):
            speed[described.idx_vs[described.getJointId(one)]] = value
        pin.forwardKinematics(described, theirs, q, speed)
        pin.updateFramePlacements(robot.model, ours)
        pin.updateFramePlacements(described, theirs)
        bodies = [f for f in robot.model.frames if f.type == pin.FrameType.BODY]
        moved = 0
        for frame in bodies:
            a = robot.model.getFrameId(frame.name, pin.FrameType.BODY)
            b = described.getFrameId(frame.name.replace(" ", "_"), pin.FrameType.BODY)
            if a >= len(robot.model.frames) or b >= len(described.frames):
                continue
            fast = [
                np.array(pin.getFrameVelocity(m, d, i, pin.LOCAL_WORLD_ALIGNED))
                for m, d, i in ((robot.model, ours, a), (described, theirs, b))
            ]
            places = [data.oMf[i].homogeneous for data, i in ((ours, a), (theirs, b))]
            if spins(robot, frame):
                places, fast = [place[:3, 3] for place in places], [speed[:3] for speed in fast]
            assert_allclose(*places, rtol=0, atol=1e-12)
            assert_allclose(*fast, rtol=0, atol=1e-11 * max(1.0, np.abs(full.v).max()))
            moved += np.abs(fast[0]).max() > 1e-3
        assert moved >= 2
    assert seen >= 4


def spins(robot, frame):
    """Whether a body is a rod that turns about itself as it likes: its frames' origins are on that axis."""
    joint = robot.model.joints[frame.parentJoint]
    return joint.shortname() == "JointModelSpherical"


def test_the_package_is_valid_in_the_eyes_of_the_tools(tmp_path):
    parser = pytest.importorskip("catkin_pkg.package", reason="catkin-pkg not installed")
    robot, files = package("five_bar")
    write_ros2(files, tmp_path / "five_bar_bot")
    warnings = []
    found = parser.parse_package(str(tmp_path / "five_bar_bot"), warnings=warnings)
    found.validate(warnings=warnings)
    assert warnings == []
    assert (found.name, found.package_format, found.get_build_type()) == ("five_bar_bot", 3, "ament_cmake")
    wanted = {one.name for one in [*found.build_depends, *found.exec_depends]}
    launch = files["launch/five_bar_bot.launch.py"]
    for name in ("robot_state_publisher", "controller_manager", "rviz2"):
        assert f"package='{name}'" in launch
        assert name in wanted
    (tmp_path / "five_bar_bot/package.xml").write_text(
        files["package.xml"].replace("<version>0.0.0", "<version>0.x"), encoding="utf-8"
    )
    with pytest.raises(Exception, match=r"0\.x"):
        parser.parse_package(str(tmp_path / "five_bar_bot"))
    assert robot.actuated == tuple(MOTORS)
    tags = [element.tag for element in Xml.fromstring(files["package.xml"])]  # noqa: S314 - our own
    head = ["name", "version", "description", "maintainer", "license"]  # the sequence of the schema
    assert tags[:5] == head
    assert {tag for tag in tags[5:-1] if not tag.endswith("depend")} == set()
    assert tags[-1] == "export"


def expanded(folder, name, *arguments):
    program = shutil.which("xacro", path=str(Path(sys.executable).parent)) or shutil.which("xacro")
    if program is None:
        pytest.skip("xacro not installed")
    command = [program, f"urdf/{name}.urdf.xacro", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


def test_ros2_control_has_the_motors_with_their_limits(tmp_path):
    robot, files = package("five_bar")
    write_ros2(files, tmp_path)
    text = expanded(tmp_path, "five_bar_bot", "plugin:=my/Drives")
    tree = Xml.fromstring(text)  # noqa: S314 - our own
    control = tree.find("ros2_control")
    assert control.findtext("hardware/plugin") == "my/Drives"
    assert [joint.get("name") for joint in control.findall("joint")] == MOTORS
    model = robot.model
    for joint in control.findall("joint"):
        own = model.joints[model.getJointId(joint.get("name"))]
        effort, speed = model.upperEffortLimit[own.idx_v], model.upperVelocityLimit[own.idx_v]
        ends = {
            "position": (model.lowerPositionLimit[own.idx_q], model.upperPositionLimit[own.idx_q]),
            "velocity": (-speed, speed),
            "effort": (-effort, effort),
        }
        for interface in joint.findall("command_interface"):
            limits = {param.get("name"): float(param.text) for param in interface.findall("param")}
            assert (limits["min"], limits["max"]) == ends.pop(interface.get("name"))
        assert ends == {}
        assert {one.get("name") for one in joint.findall("state_interface")} == {
            "position",
            "velocity",
            "effort",
        }
        start = joint.find("state_interface/param")
        assert float(start.text) == robot.regular_configuration[own.idx_q]
    if shutil.which("check_urdf"):
        (tmp_path / "whole.urdf").write_text(text, encoding="utf-8")
        done = subprocess.run(
            ["check_urdf", tmp_path / "whole.urdf"], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert "Successfully Parsed" in done.stdout


def short():
    """The five-bar with rods that do not reach everywhere."""
    text = five_bar_text().replace('xyz="0.4 0 0"', 'xyz="0.3 0 0"')
    assert text.count('xyz="0.3 0 0"') == 3
    return p3dof.load_robot(text, GALLERY / "five_bar.yaml")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The five-bar's package, whose controller knows the elbows, as CMake installs it with the stubs."""
    if shutil.which("cmake") is None or shutil.which("g++") is None:
        pytest.skip("cmake or g++ not installed")
    base = tmp_path_factory.mktemp("ros2")
    prefix = ros2_stubs.write(base)
    robot = short()
    write_ros2(ros2_files(robot, "arm", coordinates=ELBOWS), base / "arm")
    flags = "-Wall -Wextra -Werror -Wconversion -Wshadow"
    steps = (
        ["cmake", "-S", "arm", "-B", "build", f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_BUILD_TYPE=Debug",
         f"-DCMAKE_INSTALL_PREFIX={base / 'install'}", f"-DCMAKE_CXX_FLAGS={flags}",
         "-DCMAKE_C_FLAGS=-Werror"],
        ["cmake", "--build", "build"],
        ["cmake", "--install", "build"],
    )  # fmt: skip
    for step in steps:
        done = subprocess.run(step, cwd=base, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return base


def line(topic, names, *rows):
    texts = [",".join(format(x, ".17g") for x in row) for row in rows]
    return ";".join([topic, ",".join(names), *texts, *[""] * (3 - len(texts))])


def relayed(base, lines, language, *parameters):
    """What a node says to lines, as topic and the rest."""
    install = base / "install"
    program = (
        [install / "lib/arm/relay"] if language == "cpp" else [sys.executable, install / "lib/arm/relay.py"]
    )
    environment = {**os.environ, "PYTHONPATH": str(base / "python"), "PREFIX_OF_arm": str(install),
                   "LD_LIBRARY_PATH": str(install / "lib")}  # fmt: skip
    arguments = ["--ros-args", *(word for pair in parameters for word in ("-p", pair))]
    done = subprocess.run(
        [*program, *arguments],
        input="\n".join(lines) + "\n",
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr
    first, *rest = done.stdout.splitlines()
    assert first == "node;arm_relay"
    return [one.partition(";")[::2] for one in rest]


def numbers(text):
    return np.array([float(x) for x in text.split(",")]) if text else np.zeros(0)


def both(base, lines, *parameters):
    """The same, of both languages, which agree to the last bit."""
    cpp, python = (relayed(base, lines, language, *parameters) for language in ("cpp", "python"))
    assert [topic for topic, _ in cpp] == [topic for topic, _ in python]
    for (topic, one), (_, other) in zip(cpp, python, strict=True):
        if topic in ("warning", "info"):
            assert one == other
            continue
        for a, b in zip(one.split(";"), other.split(";"), strict=True):
            assert a == b if a[:1].isalpha() else np.array_equal(numbers(a), numbers(b))
    return cpp


def test_states_of_the_motors_become_those_of_all_joints(built):
    robot = short()
    one = robot.transmission(ELBOWS)
    home = robot.assemble().q
    start = np.array([home[robot.model.idx_qs[robot.model.getJointId(name)]] for name in MOTORS])
    rng = np.random.default_rng(1)
    samples = [(start + rng.uniform(-0.2, 0.2, 2), rng.normal(size=2), rng.normal(size=2)) for _ in range(5)]
    lines = [
        line("motor_states", ["other", *MOTORS[::-1]], *([9.0, *x[::-1]] for x in each)) for each in samples
    ]
    found = both(built, lines)
    assert [topic for topic, _ in found] == ["joint_states", "coordinate_states"] * 5
    for (y, v, f), (_, joints), (_, elbows) in zip(samples, found[::2], found[1::2], strict=True):
        stamp, names, *rows = joints.split(";")
        assert stamp == "12.34"
        place = [names.split(",").index(str(name)) for name in list(robot.model.names)[1:]]
        at, rate, load = (numbers(row)[place] for row in rows)
        state = robot.complete(dict(zip(MOTORS, y.tolist(), strict=True)), v, 0 * v)
        assert_allclose(at, state.q, rtol=0, atol=1e-12)
        assert_allclose(rate, state.v, rtol=0, atol=1e-12 * max(1, np.abs(state.v).max()))
        assert dict(zip(names.split(","), numbers(rows[2]), strict=True)) == {
            **dict.fromkeys(ELBOWS, 0.0), **dict(zip(MOTORS, f, strict=True))
        }  # fmt: skip
        assert load.size == 4
        _, names, *rows = elbows.split(";")
        there = one.actuator_to_joint(y, v)
        order = [one.coordinates.index(name) for name in names.split(",")]
        size = max(1, np.abs(there.velocity).max())
        assert_allclose(numbers(rows[0]), there.position[order], rtol=0, atol=1e-12)
        assert_allclose(numbers(rows[1]), there.velocity[order], rtol=0, atol=1e-12 * size)
        assert_allclose(numbers(rows[2]), one.joint_forces(there.q, f)[order], rtol=0, atol=1e-11)


def test_commands_of_the_coordinates_become_those_of_the_motors(built):
    robot = short()
    one = robot.transmission(ELBOWS)
    home = one.joint_to_actuator(one.positions("joint", one.home))
    heard = line("motor_states", one.actuators, home.position)
    x = one.positions("joint", one.home) + np.array([0.1, -0.05])
    v, f = np.array([0.3, 0.2]), np.array([2.0, -1.0])
    told = line("coordinate_commands", one.coordinates, x, v, f)
    there = one.joint_to_actuator(x, v)
    order = [one.actuators.index(name) for name in MOTORS]
    expected = {
        "position": there.position,
        "velocity": there.velocity,
        "effort": one.actuator_forces(home.q, f),
    }
    for interface, wanted in expected.items():
        found = both(built, [told, heard, told], f"interface:={interface}")
        assert [topic for topic, _ in found] == [
            "warning", "joint_states", "coordinate_states", "info", "motor_commands"
        ]  # fmt: skip
        assert found[0][1] == "coordinate_commands: the motors have not been heard yet"
        assert_allclose(
            numbers(found[-1][1]), wanted[order], rtol=0, atol=1e-12 * max(1, np.abs(wanted).max())
        )
    held = line("coordinate_commands", one.coordinates, (), v)
    ((_, rate),) = both(built, [heard, held], "interface:=velocity")[2:]
    still = one.joint_to_actuator(one.positions("joint", one.home), v)
    assert_allclose(numbers(rate), still.velocity[order], rtol=0, atol=1e-12)
    found = both(built, [heard, held])
    assert found[-1] == ("warning", "coordinate_commands: expected a number of every coordinate for position")


def test_what_the_linkage_does_not_reach_is_said_once_and_not_published(built):
    robot = short()
    home = robot.assemble().q
    y = [home[robot.model.idx_qs[robot.model.getJointId(name)]] for name in MOTORS]
    good = line("motor_states", MOTORS, y)
    far = line("motor_states", MOTORS, [y[0] + 1.0, y[1] - 1.0])
    with pytest.raises(AssemblyError):
        robot.assemble({MOTORS[0]: y[0] + 1.0, MOTORS[1]: y[1] - 1.0})
    lost = line("motor_states", MOTORS[:1], y[:1])
    nan = line("motor_states", MOTORS, [y[0], np.nan])
    found = both(built, [good, far, far, good, lost, nan, good])
    assert [topic for topic, _ in found] == [
        "joint_states", "coordinate_states", "warning",
        "joint_states", "coordinate_states", "info", "warning",
        "joint_states", "coordinate_states", "info",
    ]  # fmt: skip
    assert found[2][1] == "motor_states: the linkage does not reach these positions"
    assert found[6][1] == "motor_states: expected a position of every motor"
    first, again = found[0][1].split(";")[2], found[3][1].split(";")[2]
    assert_allclose(numbers(first), numbers(again), rtol=0, atol=1e-12)
    half = line("motor_states", MOTORS, y, [np.nan, 0.0])
    _, names, position, velocity, effort = both(built, [half])[0][1].split(";")
    assert (velocity, effort) == ("", "")
    assert len(numbers(position)) == len(names.split(",")) == 4


def test_a_wrong_interface_is_told(built):
    environment = {**os.environ, "LD_LIBRARY_PATH": str(built / "install/lib")}
    command = [built / "install/lib/arm/relay", "--ros-args", "-p", "interface:=force"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "expected position, velocity or effort, got force" in done.stderr


def test_the_self_test_is_part_of_the_package(built):
    if shutil.which("ctest") is None:
        pytest.skip("ctest not installed")
    command = ["ctest", "--test-dir", "build", "-V"]
    done = subprocess.run(command, cwd=built, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "all is well" in done.stdout
    share = built / "install/share/arm"
    names = {str(path.relative_to(share)) for path in share.rglob("*") if path.is_file()}
    assert names == {
        "urdf/arm.urdf",
        "urdf/arm.urdf.xacro",
        "config/controllers.yaml",
        "launch/arm.launch.py",
        "rviz/arm.rviz",
    }


def test_the_launch_file_starts_what_is_asked_for(built):
    share = built / "install/share/arm"

    def started(*arguments):
        environment = {
            **os.environ, "PYTHONPATH": str(built / "python"), "PREFIX_OF_arm": str(built / "install")
        }  # fmt: skip
        command = [sys.executable, built / "launched.py", share / "launch/arm.launch.py", *arguments]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return {one["executable"]: one for one in ros2_stubs.nodes(done.stdout)}

    usual = started()
    assert [*usual] == ["robot_state_publisher", "relay", "ros2_control_node", "spawner", "rviz2"]
    xacro = f"xacro {share / 'urdf/arm.urdf.xacro'} plugin:=mock_components/GenericSystem"
    assert usual["robot_state_publisher"]["parameters"] == [{"robot_description": xacro}]
    assert usual["ros2_control_node"]["parameters"][1] == str(share / "config/controllers.yaml")
    assert usual["relay"]["remappings"] == [
        ["motor_states", "joint_state_broadcaster/joint_states"],
        ["motor_commands", "position_controller/commands"],
    ]
    assert usual["spawner"]["arguments"] == ["joint_state_broadcaster", "position_controller"]
    assert (share / "rviz/arm.rviz").samefile(usual["rviz2"]["arguments"][1])
    other = started(
        "python:=true", "control:=false", "rviz:=false", "interface:=effort", "motor_states:=drives"
    )
    assert [*other] == ["robot_state_publisher", "relay.py"]
    assert other["relay.py"]["parameters"] == [{"interface": "effort"}]
    assert other["relay.py"]["remappings"] == [
        ["motor_states", "drives"], ["motor_commands", "effort_controller/commands"]
    ]  # fmt: skip
    for name in other.values():
        if name["package"] == "arm":
            assert os.access(built / "install/lib/arm" / name["executable"], os.X_OK)


def test_controllers_are_told_the_motors(built):
    import yaml

    found = yaml.safe_load((built / "arm/config/controllers.yaml").read_text(encoding="utf-8"))
    for name in ("position", "velocity", "effort"):
        own = found[f"{name}_controller"]["ros__parameters"]
        assert own == {"joints": MOTORS, "interface_name": name}
        assert f"{name}_controller" in found["controller_manager"]["ros__parameters"]
    assert found["joint_state_broadcaster"]["ros__parameters"] == {"use_local_topics": True}
    assert yaml.safe_load((built / "arm/rviz/arm.rviz").read_text(encoding="utf-8"))["Visualization Manager"][
        "Global Options"
    ]["Fixed Frame"] == "base"  # fmt: skip


def test_names_are_those_of_ros_or_refused():
    robot, files = package("free")
    assert names_of(files) == [
        *(f"loose_body_{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")), "motor"
    ]  # fmt: skip
    assert list(robot.model.names)[1:] == ["loose body", "motor"]
    for prefix in ("Arm", "arm_", "a__b", "1st", "a", "", "b-c", "string", 3):
        with pytest.raises(InputError, match=r"^prefix: expected"):
            ros2_files(robot, prefix)
    text = five_bar_text().replace('"left_elbow"', '"left motor"')
    message = "the joint 'left motor' is that of 'left_motor' too, as 'left_motor'"
    with pytest.raises(ModelError, match=message):
        ros2_files(gallery("five_bar"), description=text)
    with pytest.raises(ModelError, match=r"ROS 2: the name of the link '\+' has no letter or digit"):
        ros2_files(gallery("five_bar"), description=five_bar_text().replace('"left_rod"', '"+"'))


def five_bar_text():
    return (GALLERY / "five_bar.urdf").read_text(encoding="utf-8")


@pytest.mark.slow
def test_motors_behind_no_linkage_of_the_coordinates_are_coordinates_too():
    """And what the motors do not determine is named, as the floating base."""
    text = (GALLERY / "leg.urdf").read_text(encoding="utf-8")
    floating = pin.JointModelFreeFlyer()
    leg = p3dof.load_robot(text, GALLERY / "leg.yaml", root_joint=floating)
    files = ros2_files(leg, coordinates=["ankle_roll", "ankle_pitch"])
    hips = "hip_yaw, hip_roll, hip_pitch, knee_motor"
    assert f"Coordinates: ankle_roll, ankle_pitch, {hips}.\n" in files["README.md"]
    assert f"Motors: left_motor, right_motor, {hips}." in files["README.md"]
    assert "to be published by others: root_joint." in files["README.md"]
    assert "root_joint" not in names_of(files)
    assert len(names_of(files)) == 9 + 2 * 3


@COMPILED
@pytest.mark.slow
def test_of_motors_that_depend_on_each_other_some_are_measured(tmp_path):
    whole = gallery("two_arms")
    measured = whole.actuated[:6]
    with pytest.raises(ModelError, match="--actuators"):
        ros2_files(whole)
    robot = p3dof.ClosedLoopModel(whole.model, replace(whole.sidecar, actuated=measured))
    compare(tmp_path, "two_arms", robot, ros2_files(whole, "two_arms_bot", actuators=measured))


def test_motors_that_do_not_determine_the_joints_are_told():
    with pytest.raises(ModelError, match=r"^ROS 2: the relay needs measured joints .*--actuators"):
        ros2_files(gallery("two_arms"))
    bare = p3dof.ClosedLoopModel(gallery("five_bar").model, Sidecar((), ()))
    with pytest.raises(ModelError, match=r"^ROS 2: expected a robot with actuated joints"):
        ros2_files(bare)


def test_a_package_is_written_whole_and_over_its_own_only(tmp_path, capsys):
    robot, out = str(GALLERY / "four_bar.urdf"), tmp_path / "out"

    def export(*more, to=out):
        return run(capsys, "loop", "export", robot, "--format", "ros2", "--out", str(to), *more)

    status, told, _ = export()
    assert status == 0
    files = {str(path.relative_to(out)): path for path in out.rglob("*") if path.is_file()}
    assert len(files) == 15 == told.count("wrote")
    assert all("do not edit" in path.read_text(encoding="utf-8")[:300] for path in files.values())
    before = {name: path.read_bytes() for name, path in files.items()}
    assert export("--coordinates", "rocker_joint", "--actuators", "crank_joint")[0] == 0
    relay = files["scripts/relay.py"]
    assert relay.read_bytes() != before["scripts/relay.py"]
    assert "COORDINATES = [\n    'rocker_joint',\n]" in relay.read_text(encoding="utf-8")
    before = {name: path.read_bytes() for name, path in files.items()}
    for arguments, words in (
        (["--prefix", "other"], "belongs to the package 'four_bar'"),
        (["--prefix", "Bar"], "expected a name of a ROS package"),
        (["--coordinates", "x"], "the joint 'x' does not exist"),
        (["--motion", robot], "--motion and --package-dir belong to glb"),
    ):
        status, _, error = export(*arguments)
        assert (status, error.count("\n")) == (2, 1)
        assert words in error
        assert {name: path.read_bytes() for name, path in files.items()} == before
    (out / "config/controllers.yaml").write_text("mine", encoding="utf-8")
    status, _, error = export()
    assert (status, error.count("\n")) == (2, 1)
    assert "was not generated by p3dof" in error
    assert relay.read_bytes() == before["scripts/relay.py"]
    assert export("--force")[0] == 0
    assert relay.read_bytes() != before["scripts/relay.py"]
    status, _, error = export(to=tmp_path / "robot.xml")
    assert "expected a folder for a package of ROS 2" in error
    status, _, error = run(capsys, "loop", "export", robot, "--out", str(tmp_path / "r.sdf"), "--prefix", "a")
    assert "--prefix, --coordinates, --actuators and --force belong to --format ros2" in error
    status, _, error = run(capsys, "loop", "export", robot, "--out", str(tmp_path / "folder"))
    assert (status, error.count("\n")) == (2, 1)
    with pytest.raises(FileError):
        write_ros2(ros2_files(gallery("four_bar")), out / "package.xml")


@pytest.mark.slow
def test_the_machine_is_a_package_too(tmp_path, capsys):
    status, told, _ = run(capsys, "export", "--format", "ros2", "--out", str(tmp_path), "--prefix", "mill")
    assert status == 0
    assert told.count("wrote") == 15
    text = (tmp_path / "urdf/mill.urdf").read_text(encoding="utf-8")
    assert text.count("<visual") > 20
    assert sorted(list(pin.buildModelFromXML(text).names)[1:]) == sorted(list(machine()[0].model.names)[1:])


def test_options_of_the_machine_that_do_not_go_together_are_told(capsys):
    for arguments, words in (
        (["--format", "ros2", "--format", "urdf"], "--format ros2 goes with no other one"),
        (["--format", "ros2", "--check"], "--format ros2 goes with no other one"),
        (["--format", "ros2", "--prefix", "Mill", "--out", "x"], "expected a name of a ROS package"),
        (["--prefix", "mill"], "--prefix belongs to --format ros2"),
    ):
        status, _, error = run(capsys, "export", *arguments)
        assert (status, error.count("\n")) == (2, 1)
        assert words in error
