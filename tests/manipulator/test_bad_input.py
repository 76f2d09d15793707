"""Bad input of every kind: exit code 2, one line that says what was expected and what came."""

from __future__ import annotations

import os

import numpy as np
import pytest

import p3dof
from p3dof import Motion, P3dofError, WrenchHistory
from p3dof.cli import main
from p3dof.machine import Body, Friction, Geometry
from p3dof.machine.parameters import PAPER
from p3dof.machine.parameters import machine as serialization

POSES = "t,y,z,theta\n"
NINE = "t,y,z,theta,ydot,zdot,thetadot,yddot,zddot,thetaddot\n"
LOAD = "t,fx,fy,fz,mx,my,mz\n"
MACHINE = serialization.dump(PAPER)
SHORT = ("--samples", "5", "--method", "virtual-power")


def refused(code, captured, *words):
    """One line of error, and nothing that looks like a result."""
    error = captured.err
    assert code == 2, error
    assert error.startswith("p3dof: error: ")
    assert error.count("\n") == 1
    assert len(error) < 1100
    assert captured.out == ""
    for never in ("Traceback", "Warning", "index []", "a int", "a str", "shape ()", "check=", "factor:"):
        assert never not in error
    for word in words:
        assert word in error


def two(row):
    return POSES + f"0,{row}\n1,{row}\n"


MOTIONS = {
    "": "got an empty file",
    "\n\n": "got an empty file",
    POSES: "expected lines of numbers after the header",
    POSES + "0,a,0,0\n1,0,0,0\n": "line 2, column y: expected a number, got 'a'",
    POSES + "0,,0,0\n1,0,0,0\n": "line 2, column y: expected a number, got nothing",
    "t;y;z;theta\n0;0;0;0\n": "expected commas between the columns, got semicolons",
    "t;y;z;theta\n0;0,1;0;0\n": "expected commas between the columns, got semicolons",
    "t\ty\tz\ttheta\n0\t0\t0\t0\n": "expected commas between the columns, got tabs",
    POSES + "0,0,0,0\n0,5,0,0,0\n": "line 3: expected 4 columns, got 5",
    POSES + "0,0,0,0\n1,0,0\n": "line 3: expected 4 columns, got 3",
    "t,y,y,theta\n0,0,0,0\n": "column 3: expected z, got 'y'",
    "t,y,theta\n0,0,0\n": "column 3: expected z, got 'theta'",
    "t,y,z\n0,0,0\n": "got only t,y,z",
    "0,0,0,0\n1,0,0,0\n": "column 1: expected t, got '0'",
    "T,Y,Z,THETA\n0,0,0,0\n": "column 1: expected t, got 'T'",
    "t [h],y,z,theta\n0,0,0,0\n": "expected a unit of s, ms, us, µs, ns, got [h]",
    "t [\x1b],y,z,theta\n0,0,0,0\n": "expected a unit of s, ms, us, µs, ns, got [\\x1b]",
    two("1e300,0,0"): "line 2, column y: expected a number of at most 1e+30 in size, got 1e+300",
    two("0,1e200,0"): "line 2, column z: expected a number of at most 1e+30 in size",
    two("inf,0,0"): "column y: expected a finite number, got inf",
    two("0,nan,0"): "column z: expected a finite number, got nan",
    two("1_0,0,0"): "column y: expected a number, got '1_0'",
    two("0x1,0,0"): "column y: expected a number, got '0x1'",
    two("١,0,0"): "column y: expected a number",
    two("1j,0,0"): "column y: expected a number, got '1j'",
    two("0,0,\0"): "column theta: expected a number",
    two('"0,0,0'): "not valid CSV",
    POSES + "0,0,0,0\n1e308,0,0,0\n": "line 3, column t: expected a number of at most 1e+30",
    POSES + "0,0,0,0\n1e-320,0,0,0\n": "acceleration: expected finite numbers, got nan",
    POSES + "0,0,0,0\n1e-200,.01,0,0\n2e-200,0,0,0\n": "velocity: expected numbers of at most 1e+30",
    NINE
    + "0,0,0,0,1e200,0,0,0,0,0\n1,0,0,0,1e200,0,0,0,0,0\n": "column ydot: expected a number of at most 1e+30",
    NINE + "0,0,0,0,0,0,0,1e308,0,0\n1,0,0,0,0,0,0,1e308,0,0\n": "column yddot: expected a number of at most",
    NINE
    + "".join(f"{t / 10},{t / 100},0,0,5,0,0,0,0,0\n" for t in range(10)): "as the poses have it, got 5 m/s",
    POSES + "0,0,0,0\n0,0,0,0\n": "line 3, column t: expected a time after 0",
    POSES + "1,0,0,0\n0,0,0,0\n": "line 3, column t: expected a time after 1",
    POSES + "0,0,0,0\n": "expected at least two samples",
    "t" * 20_000: "expected at most 10000 characters",
    '{"t": [0, 1]}': "expected t, got",
    "<?xml version='1.0'?>\n<robot name='x'/>": "expected t, got",
    MACHINE: "expected t, got",
}


@pytest.mark.parametrize("text", MOTIONS)
def test_motion_files(tmp_path, capsys, text):
    path = tmp_path / "m.csv"
    path.write_text(text, encoding="utf-8")
    code = main(["forces", "--method", "virtual-power", "--motion", str(path)])
    refused(code, capsys.readouterr(), MOTIONS[text])


LOADS = {
    "": "expected a wrench with the columns",
    "t,fx\n0,1\n": "got only t,fx",
    POSES + "0,0,0,0\n": "expected fx, got 'y'",
    LOAD + "0,a,0,0,0,0,0\n": "column fx: expected a number, got 'a'",
    LOAD + "0,1e308,0,0,0,0,0\n1,1e308,0,0,0,0,0\n": "line 2, column fx: expected a number of at most 1e+30",
}


@pytest.mark.parametrize("text", LOADS)
def test_wrench_files(tmp_path, capsys, text):
    path = tmp_path / "m.csv"
    path.write_text(text, encoding="utf-8")
    refused(main(["forces", *SHORT, "--wrench", str(path)]), capsys.readouterr(), LOADS[text])


BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{','.join([f'*{chr(97 + i)}'] * 9)}]\n" for i in range(8)
)


def with_mass(text):
    return MACHINE.replace("mass: 8.1573", f"mass: {text}")


MACHINES = {
    "": "geometry, bodies, limits, gravity, friction, actuators, payload, density, dimensions, got nothing",
    "[1, 2]": "got a list",
    "5": "got 5",
    "hello": "got 'hello'",
    "geometry: 5\nbodies: 3\n": "geometry: expected the fields r, R, L, b, got 5",
    "<?xml version='1.0'?>\n<robot name='x'/>": "expected YAML, got what looks like a URDF",
    " <sdf/>": "expected YAML, got what looks like XML",
    POSES + "0,0,0,0\n": "got 't,y,z,theta",
    MACHINE + "\ngravity: [0, 0, -1]\n": "the key 'gravity' is given more than once",
    BOMB: "expected at most 20000 values, aliases expanded",
    "a: &a [*a]": "expected at most 20000 values",
    "[" * 3000: "nested too deeply",
    "!!python/object/apply:os.system ['true']": "could not determine a constructor",
    with_mass("heavy"): "bodies.platform.mass: expected a mass, a number in kg",
    with_mass("8,1573"): "with a unit such as '1 g', got '8,1573'",
    with_mass("[1, 2]"): "mass: expected a single number, got shape (2,)",
    with_mass("true"): "mass: expected real numbers, got True",
    with_mass(""): "mass: expected real numbers, got None",
    with_mass("1e308"): "mass: expected a number of at most 1e+30 in size, got 1e+308",
    with_mass("9" * 400): "got a huge integer",
    with_mass("-1"): "mass: expected zero or more, got -1",
    with_mass(".nan"): "mass: expected a finite number, got nan",
    with_mass("2001-01-01"): "mass: expected real numbers, got a date",
    with_mass("{a: 1}"): "mass: expected",
    MACHINE.replace("{r: 0.1", "{r: 0"): "r: expected a positive number, got 0",
    MACHINE.replace("{r: 0.1", "{r: abc"): "geometry.r: expected a length",
    MACHINE.replace("{r: 0.1", "{r: 1e200"): "geometry: r: expected",
    MACHINE.replace("L: 0.4", "L: 1e-200"): "geometry: L: expected",
    MACHINE.replace("com: [0.2, 0.0, 0.0]", "com: [0.2, 0.0]"): "com: expected shape (3,), got (2,)",
    MACHINE.replace("com: [0.2, 0.0, 0.0]", "com: [1e+200, 0, 0]"): "com: expected numbers of at most 1e+30",
    MACHINE.replace("[0.0, 0.0, -9.806]", "9.81"): "gravity: expected shape (3,), got a single number",
    MACHINE.replace("[0.0, 0.0, -9.806]", "[0, 0, -1e300]"): "gravity: expected numbers of at most 1e+30",
    MACHINE + "\nfriction: 5\n": "friction: expected the fields viscous, coulomb, smoothing, got 5",
    MACHINE + "\nfriction: {viscous: {slider: 1}}\n": "unknown joint 'slider'",
    MACHINE + "\nfriction: {viscous: {sliders: -1}}\n": "viscous.sliders: expected zero or more, got -1",
    MACHINE + "\nfriction: {viscous: {sliders: abc}}\n": "viscous.sliders: expected",
    MACHINE
    + "\nfriction: {viscous: {sliders: 1e308}}\n": "viscous.sliders: expected a number of at most 1e+30",
    MACHINE + "\nfriction: {coulomb: {sliders: 1}, smoothing: 0}\n": "smoothing: expected a positive number",
    MACHINE + "\nactuators: 5\n": "actuators: expected the fields armature, counterbalance, spring, counterw",
    MACHINE + "\nactuators: {armature: {sliders: -1}}\n": "armature.sliders: expected zero or more, got -1",
    MACHINE + "\nactuators: {spring: {hinge_a: 1}}\n": "spring: unknown slide 'hinge_a'",
    MACHINE + "\nactuators: {counterbalance: {slide_a: 5 kg}}\n": "counterbalance.slide_a: expected a force",
    MACHINE + "\npayload: yes\n": "payload: expected the fields mass, com, inertia, about, got True",
    MACHINE + "\npayload: {com: [0, 0, 0]}\n": "payload: the field 'mass' is missing",
    MACHINE
    + "\npayload: {mass: 1e308, com: [1e100, 0, 0], inertia: [0, 0, 0]}\n": "payload: mass: expected a",
    MACHINE.replace("speed: 2.0", "speed: fast"): "limits.speed: expected a speed",
    MACHINE.replace(
        "travel: [-0.2, 0.2]", "travel: 0.2"
    ): "limits: travel: expected shape (2,), got a single number",
    MACHINE + "\ncolour: red\n": "unknown field 'colour'",
    MACHINE + "\n---\na: 1\n": "another document",
    "a: " + "x" * 5000: "expected at most 1000 characters a value",
    "? [1, 2]\n: 3\n": "unhashable key",
}


@pytest.mark.parametrize("text", MACHINES, ids=range(len(MACHINES)))
def test_parameter_files(tmp_path, capsys, text):
    path = tmp_path / "p.yaml"
    path.write_text(text, encoding="utf-8")
    code = main(["forces", *SHORT, "--parameters", str(path)])
    refused(code, capsys.readouterr(), "p.yaml", MACHINES[text])


@pytest.mark.parametrize("option", ["--motion", "--parameters", "--wrench"])
@pytest.mark.parametrize(
    "kind", ["folder", "loop", "pipe", "missing", "binary", "UTF-16", "long", "device", ""]
)
def test_what_is_no_text_file(tmp_path, capsys, option, kind):
    path = tmp_path / "x"
    if kind == "folder":
        path.mkdir()
    elif kind == "loop":
        path.symlink_to(tmp_path / "y")
        (tmp_path / "y").symlink_to(path)
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "binary":
        path.write_bytes(bytes(range(256)))
    elif kind == "UTF-16":
        path.write_bytes(POSES.encode("utf-16"))
    name = {"long": "x" * 5000, "device": "/dev/zero", "": ""}.get(kind, str(path))
    arguments = ["forces", "--method", "virtual-power", option, name]
    refused(main([*arguments, "--out", str(tmp_path / "f.csv")]), capsys.readouterr())
    assert not (tmp_path / "f.csv").exists()


@pytest.mark.parametrize(
    "text", ["\ufeff" + two("0,0,0"), two("0,0,0").replace("\n", "\r\n"), two("0 ,0, 0")]
)
def test_what_other_programs_write_is_read(tmp_path, capsys, text):
    (tmp_path / "m.csv").write_bytes(text.encode())
    assert main(["forces", "--method", "virtual-power", "--motion", str(tmp_path / "m.csv")]) == 0, (
        capsys.readouterr()
    )


PAYLOADS = (
    "1e308",
    "1e308,1e308,1e308,1e308",
    "1e150,1e150,0,0",
    "1,1e308,0,0",
    "1,0,0,1e154",
    "-1",
    "nan",
    "inf",
    "1,2",
    "",
    "a",
    "1,a,b,c",
    "1;2",
    "1_0",
    "0x5",
    "1,nan,0,0",
    "1,,,",
    "5 m",
)


@pytest.mark.parametrize("payload", PAYLOADS)
def test_payloads(capsys, payload):
    refused(
        main(["forces", *SHORT, "--payload", payload]),
        capsys.readouterr(),
        "--payload",
        "expected a mass [kg]",
    )


POSITIVE = ("nan", "inf", "-inf", "-1", "0", "1e300", "abc", "")
NOT_NEGATIVE = ("nan", "inf", "-1", "1e300", "abc", "")
NUMBERS = {
    "simulate --rate": POSITIVE,
    "simulate --frequency": POSITIVE,
    "simulate --damping": POSITIVE,
    "simulate --integral-time": POSITIVE,
    "simulate --saturation": POSITIVE,
    "simulate --mass-error": ("nan", "inf", "-1", "-2", "1e300", "abc", ""),
    "simulate --ramp": NOT_NEGATIVE,
    "simulate --time-limit": POSITIVE,
    "simulate --seed": ("-1", "1.5", "nan", "abc", ""),
    "compare --tolerance": NOT_NEGATIVE,
    "show --fps": POSITIVE,
    "show --speed": POSITIVE,
    "show --port": ("-1", "70000", "abc", "nan"),
    "forces --samples": ("0", "1", "-1", "1.5", "1000001", "9" * 400, "many", ""),
}


@pytest.mark.parametrize(
    ("option", "value"), [(option, value) for option in NUMBERS for value in NUMBERS[option]]
)
def test_numbers_of_options(tmp_path, capsys, monkeypatch, option, value):
    """The option that was typed is named, and nothing is begun."""
    monkeypatch.chdir(tmp_path)
    refused(main([*option.split(), value]), capsys.readouterr(), option.split()[1])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "options", [("--rate", "1e9"), ("--rate", "1e6", "--method", "pinocchio"), ("--time-limit", "1e-3")]
)
def test_runs_that_would_take_for_ever(tmp_path, capsys, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    code = main(["simulate", *options])
    words = (
        "the run would take about",
        "steps), the limit is",
        "a lower rate",
        "or allow it by --time-limit",
    )
    refused(code, capsys.readouterr(), *words)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("noise", [("nan", "0"), ("0", "-1"), ("1e300", "0"), ("a", "b")])
def test_noise(capsys, noise):
    refused(main(["simulate", "--noise", *noise]), capsys.readouterr(), "--noise")


ROBOT = p3dof.load()
REST = (np.zeros(3),) * 2
CALLS = {
    "mass as text": lambda: Body("8,15", [0, 0, 0], [1, 1, 1]),
    "mass none": lambda: Body(None, [0, 0, 0], [1, 1, 1]),
    "mass true": lambda: Body(True, [0, 0, 0], [1, 1, 1]),
    "mass nan": lambda: Body(np.nan, [0, 0, 0], [1, 1, 1]),
    "mass huge": lambda: Body(1e200, [0, 0, 0], [1, 1, 1]),
    "mass list": lambda: Body([1], [0, 0, 0], [1, 1, 1]),
    "com short": lambda: Body(1, [0, 0], [1, 1, 1]),
    "com ragged": lambda: Body(1, [[0], [0, 0]], [1, 1, 1]),
    "com complex": lambda: Body(1, [0, 1j, 0], [1, 1, 1]),
    "r text": lambda: Geometry(r="0.1"),
    "r dict": lambda: Geometry(r={}),
    "friction number": lambda: Friction(5),
    "friction text": lambda: Friction({"sliders": "much"}),
    "friction bool": lambda: Friction({"sliders": True}),
    "time text": lambda: Motion("now", np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3))),
    "time none": lambda: Motion(None, *[np.zeros((1, 3))] * 3),
    "pose text": lambda: Motion([0.0], [["a", "b", "c"]], *[np.zeros((1, 3))] * 2),
    "velocity huge": lambda: Motion([0.0], np.zeros((1, 3)), [[1e200, 0, 0]], np.zeros((1, 3))),
    "no samples": lambda: Motion([], *[np.zeros((0, 3))] * 3),
    "duration text": lambda: Motion.rest_to_rest([0, 0, 0], [0, 0, 0.1], "long"),
    "duration bool": lambda: Motion.rest_to_rest([0, 0, 0], [0, 0, 0.1], True),
    "samples float": lambda: Motion.rest_to_rest([0, 0, 0], [0, 0, 0.1], 1, samples=2.5),
    "samples text": lambda: Motion.rest_to_rest([0, 0, 0], [0, 0, 0.1], 1, samples="10"),
    "samples huge": lambda: p3dof.paper_motion(10**9),
    "wrench huge": lambda: WrenchHistory([0, 1], np.full((2, 6), 1e308)),
    "forces pose text": lambda: ROBOT.forces("home", *REST),
    "forces pose none": lambda: ROBOT.forces(None, *REST),
    "forces pose shape": lambda: ROBOT.forces([0, 0], *REST),
    "forces method": lambda: ROBOT.forces([0, 0, 0], *REST, method="adams"),
    "simulate duration": lambda: ROBOT.simulate(np.nan),
    "simulate duration text": lambda: ROBOT.simulate("1"),
    "simulate rate": lambda: ROBOT.simulate(1.0, control=p3dof.runs.ControlLoop(-1)),
    "simulate controller": lambda: ROBOT.simulate(1.0, controller="strong"),
    "simulate saturation": lambda: ROBOT.simulate(1.0, control=p3dof.runs.ControlLoop(saturation=-1)),
    "file none": lambda: Motion.from_csv(None),
    "file number": lambda: p3dof.read_parameters(5),
    "load number": lambda: p3dof.load(5),
}


@pytest.mark.parametrize("call", CALLS)
def test_calls_from_python(call):
    with pytest.raises(P3dofError) as caught:
        CALLS[call]()
    message = str(caught.value)
    assert "\n" not in message
    for never in ("index []", "a int", "a str", "shape ()", "got text"):
        assert never not in message


def test_hints_for_programs_are_not_shown_to_people(tmp_path, capsys):
    (tmp_path / "m.csv").write_text(
        NINE + "".join(f"{t / 10},{t / 100},0,0,5,0,0,0,0,0\n" for t in range(10)), encoding="utf-8"
    )
    with pytest.raises(
        p3dof.errors.MotionError, match=r"sample is wrong\) \(check=False takes the motion as it is\)$"
    ):
        Motion.from_csv(tmp_path / "m.csv")
    refused(
        main(["forces", "--motion", str(tmp_path / "m.csv")]), capsys.readouterr(), "a sample is wrong)\n"
    )


ZERO = np.zeros(3)
DEGREES = [[0, 0, 0], [0, 0, 10], [0, 0, 20]]


def moved(waypoints, machine=ROBOT, **options):
    return machine.inverse_dynamics(Motion.through(waypoints, duration=1), **options)


UNITS = {  # what is given in other units, and the line that a user gets
    "15 degrees": (
        lambda robot: robot.forces([0, 0, 15], ZERO, ZERO),
        "beyond what the machine can do (15 rad: degrees?): units are m, rad, s, N and N m",
    ),
    "10 degrees, compiled": (
        lambda robot: robot.forces([0, 0, 10.0], ZERO, ZERO, method="compiled"),
        "beyond what the machine can do (10 rad: degrees?): units are m, rad, s, N and N m",
    ),
    "a batch in degrees": (
        lambda robot: robot.forces(DEGREES, ZERO, ZERO, method="virtual-power"),
        "beyond what the machine can do (20 rad: degrees?): units are m, rad, s, N and N m",
    ),
    "rows in degrees, compiled": (
        lambda robot: robot.forces(np.array(DEGREES, float), ZERO, ZERO, method="compiled"),
        "beyond what the machine can do (20 rad: degrees?): units are m, rad, s, N and N m",
    ),
    "a height in mm": (
        lambda robot: robot.sliders([0, 50, 0]),
        "beyond what the machine can do (50 m: mm?): units are m, rad, s, N and N m",
    ),
    "poses in mm that are left NaN": (
        lambda robot: robot.forces([[30, 0, 0]], ZERO, ZERO, on_invalid="nan"),
        "beyond what the machine can do (30 m: mm?): units are m, rad, s, N and N m",
    ),
    "a motion in mm": (
        lambda robot: moved([[0, 0, 0], [0, 50, 0]], robot),
        "beyond what the machine can do (50 m: mm?): units are m, rad, s, N and N m",
    ),
    "a speed in mm/s": (
        lambda robot: robot.forces(ZERO, [500, 0, 0], ZERO),
        "beyond what the machine can do (500 m/s: mm/s?): units are m, rad, s, N and N m",
    ),
    "rates in degrees/s, compiled": (
        lambda robot: robot.forces(ZERO, np.array([0, 0, -250.0]), ZERO, method="compiled"),
        "beyond what the machine can do (250 rad/s: degrees/s?): units are m, rad, s, N and N m",
    ),
    "a speed in mm/s, forward": (
        lambda robot: robot.forward_dynamics(ZERO, [0, 300, 0], ZERO),
        "beyond what the machine can do (300 m/s: mm/s?): units are m, rad, s, N and N m",
    ),
    "a moment in N mm": (
        lambda robot: robot.forces(ZERO, ZERO, ZERO, wrench=[0, 0, -50, 0, 5000, 0]),
        "beyond what the machine can do (5000 N m: N mm?): units are m, rad, s, N and N m",
    ),
    "a load in mN": (
        lambda robot: moved([[0, 0, 0], [0, 0, 0.1]], robot, wrench=[0, 0, -50_000, 0, 0, 0]),
        "beyond what the machine can do (50000 N: mN?): units are m, rad, s, N and N m",
    ),
}


@pytest.mark.parametrize("given", UNITS)
def test_a_pose_beyond_the_machine_warns_once_with_the_likely_unit(given):
    call, line = UNITS[given]
    robot = p3dof.load()
    with pytest.warns(p3dof.errors.ModelWarning) as told:
        call(robot)
    assert [str(warning.message) for warning in told] == [line]
    assert told[0].filename == __file__
    call(robot)  # warnings are errors here


def test_each_quantity_in_another_unit_is_told_once_and_a_motion_tells_its_limits_each_time():
    """A machine that warned of millimetres warns of degrees, too."""
    robot = p3dof.load()
    with pytest.warns(p3dof.errors.ModelWarning, match=r"\(50 m: mm\?\)"):
        robot.forces([0, 50, 0], ZERO, ZERO)
    motion = Motion(np.linspace(0, 1, 5), np.outer(np.ones(5), [0, 50, 12]), *np.zeros((2, 5, 3)))
    with pytest.warns(p3dof.errors.ModelWarning, match=r"\(12 rad: degrees\?\)"):
        first = robot.inverse_dynamics(motion)
    again = robot.inverse_dynamics(motion)  # warnings are errors here
    assert "limit exceeded: tilt of platform: 12 rad at t = 0 s, limit 0.785398 rad" in again.warnings
    assert first.warnings == again.warnings


def test_fast_motions_that_a_machine_can_do_warn_of_nothing():
    """Up to ten times the limit of speed, at any acceleration; what is not finite has errors of its own."""
    robot = p3dof.load()
    limits, g = robot.parameters.limits, robot.parameters.geometry
    fast = 9.9 * limits.speed * np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1 / g.r]])
    for velocity in fast:
        robot.forces(ZERO, velocity, [1e4, -1e4, 1e4])
    robot.forces(ZERO, 100 * fast, [[1e4, 0, 0], [0, -1e4, 0], [0, 0, 1e4]])
    robot.forces([0.1, np.nan, 0], ZERO, [np.inf, 0, 0], on_invalid="nan")


CANNOT = {  # what cannot be, and the end of the line that a user gets
    "y in mm": (lambda: p3dof.load().forces([100, 0, 0], ZERO, ZERO), "is too short by 99.75 m (100 m: mm?)"),
    "waypoints": (
        lambda: moved([[0, 0, 0], [100, 0, 20]], p3dof.load()),
        "the first of 935 such of 1001) (100 m: mm?, 20 rad: degrees?)",
    ),
    "a motion in degrees": (
        lambda: moved([[0, 0, 0], [0, 0, 20]], p3dof.load()),
        "crosses an actuation singularity: no force can do that (sample 192, the first of 7 such) "
        "(20 rad: degrees?)",
    ),
    "a start in degrees": (
        lambda: ROBOT.simulate(0.1, start=[0, 0, 30]),
        "pose (y = 0 m, z = 0 m, theta = 30 rad): the run would start beyond a limit: tilt limit: the "
        "platform at 0.785398 rad (30 rad: degrees?)",
    ),
    "a start in mm": (
        lambda: ROBOT.simulate(0.1, start=[0, 30, 0]),
        "slider A at its upper end, 0.2 m (30 m: mm?)",
    ),
    "a start that is only too far": (
        lambda: ROBOT.simulate(0.1, start=[0, 0, 1]),
        "theta = 1 rad): the run would start beyond a limit: tilt limit: the platform at 0.785398 rad",
    ),
    "a pose that is only too far": (
        lambda: ROBOT.forces([0.26, 0, 0], ZERO, ZERO),
        "is out of reach: leg A is too short by 0.01 m",
    ),
}


@pytest.mark.filterwarnings("ignore:beyond what the machine can do:p3dof._base.errors.ModelWarning")
@pytest.mark.parametrize("given", CANNOT)
def test_errors_about_reach_and_singularity_name_the_likely_unit(given):
    call, line = CANNOT[given]
    with pytest.raises(P3dofError) as told:
        call()
    assert str(told.value).endswith(line)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (POSES + "0,0,0,0\n.5,0,0,10\n1,0,0,20\n", "crosses an actuation singularity"),
        (POSES + "0,0,0,0\n.5,40,0,0\n1,100,0,0\n", "is out of reach: leg A is too short by"),
    ],
)
def test_a_file_in_degrees_or_mm(tmp_path, capsys, text, words):
    (tmp_path / "m.csv").write_text(text, encoding="utf-8")
    assert main(["forces", "--motion", str(tmp_path / "m.csv"), "--out", str(tmp_path / "f.csv")]) == 1
    error = capsys.readouterr().err  # without a warning that says the same
    assert error.count("\n") == 1
    hint = "(20 rad: degrees?)" if "singular" in words else "(100 m: mm?)"
    assert words in error
    assert error.endswith(hint + GIVE)


GIVE = ": give the unit, as in '10 mm' or '30 deg', or y [mm], theta [deg] in a CSV file\n"


def test_a_task_in_mm_and_degrees(tmp_path, capsys):
    (tmp_path / "t.yaml").write_text("waypoints: [{pose: [0, 0, 0]}, {pose: [100, 0, 20]}]", encoding="utf-8")
    assert main(["plan", str(tmp_path / "t.yaml"), "--duration", "1"]) == 1
    told = capsys.readouterr().err
    assert told.endswith("(100 m: mm?, 20 rad: degrees?)" + GIVE)
