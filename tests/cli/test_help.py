"""The help as a user meets it: commands by subject, one word for one thing, and what is meant by a slip."""

from __future__ import annotations

import re

import click
import pytest
from command_line import commands, run

from p3dof.cli.app import COMMANDS, app
from p3dof.cli.loop import COMMANDS as OF_ROBOTS

OPTIONS = r"""
--acceleration | Y,Z,THETA | Accelerations along y
--accuracy | AMOUNT | Standard deviation of a measured length
--actuation | AMOUNT | Margin from parallel singularities
--actuator-force | JOINT=FORCE | (With --simulate: c|C)onstant force of an actuated joint
--actuators | text | Actuators behind --coordinates
--algorithm | choice | (SLSQP|Epsilon-constraint)
--angle-accuracy | AMOUNT | Standard deviation of a measured angle
--animation | flag | Embed the page with the
--any-size | flag | Accept a machine larger than
--armature | NUMBER[,B,C] | Armature
--around | JOINT=VALUE,... | Positions of joints
--at | AMOUNT | (Start time of playback|Time of the motion)
--bake | flag | Make the parameters of the
--bandwidth | AMOUNT | Bandwidth of the drives
--base | text | Frame that it is seen
--bearings | FILE | Ratings of bearings and guides
--best-path | flag | Also optimise blends and waypoints
--brake-safety | number | Safety factor of holding brakes
--centre-error | AMOUNT | Error of the mass centres
--check | flag | Write nothing
--clearance | AMOUNT | Least distance that all parts
--closure-forces | flag | Show the closure forces
--combine | NAME=PART,... | Parameter that changes several
--compute | choice | Also compute this
--constants | text | Force per ampere of the
--controller | choice | PD control
--coordinates | text | Joints, with commas
--counterbalance | NUMBER[,B,C] | Counterbalance force on the sliders
--cpu | text | Processor that the Makefile compiles
--criterion | choice | Least error of predicted forces
--cuda | flag | Also CUDA C\+\+
--damping | number | Damping ratio of the closed
--delay | AMOUNT | Delay from a measurement to
--designs | FILE | Table of designs
--differencing | flag | Measure velocities as position differences
--drive-stiffness | NUMBER[,B,C] | Stiffness of each drive
--drive | NAME | Drive of the catalogue
--drives | FILE | Catalogue of motors
--drives-only | flag | Write drives.yaml only
--drop-missing | flag | Leave out base samples with
--duration | AMOUNT | Duration of
--engines | choice | Also compute the forces with
--equilibrium | flag | Start uncontrolled degrees of freedom
--estimator | choice | Maximum a posteriori
--every-tick | flag | Write a row at every
--exact | flag | Keep massless links massless
--external | FRAME=FX,FY,FZ[,MX,MY,MZ] / FRAME | (External wrench on a frame|Frame on which)
--frictionless | flag | Size drives without the usual friction
--life | text | Required life of ball nuts
--fastest | flag | Plan the time-optimal motion of
--figure | FILE | Figure (of histograms and Pareto fronts )?to draw
--fix | NAME=VALUE | Fixed value that differs from
--float | flag | Single precision
--floating | flag | Floating base
--force | flag | Overwrite
--force-delay | AMOUNT | Time by which forces are
--forces-out | FILE | File to write forces
--format | choice | Format
--fps | number | Frames per second of a
--frame | text | Frame that is measured
--frequency | AMOUNT | Natural frequency of the closed
--functions | text | Functions
--generations | whole number | Largest number of generations of
--gradient | COLUMN | Column by which all results
--grid | whole number | Number of poses of the
--harmonics | whole number | Harmonics of the Fourier series
--hold-out | N | Leave every N-th pose out
--ignore-unknown | flag | Ignore elements of a URDF
--in-time | flag | Also simulate the motion with
--include-root | FOLDER | Folder below which an MJCF or SDF may
--index | NAME | Performance index
--inertia | JOINT | Joint of a body whose
--integral-time | AMOUNT | Integral time of the controller
--joint-forces | flag | Additional joint forces as an
--joint-model | choice | Model for the reactions that
--json | flag | Print the results as JSON
--kd | text | Velocity gains
--kernels | flag | For developers: the kernels
--kind | choice | Kind of counterbalance
--kp | text | Position gains
--large | COLUMN | Column of designs to maximise
--leave-out | flag | Leave out numbers that do
--length | AMOUNT | Characteristic length ℓ of the
--limits | choice | At a joint limit in
--list-joints | flag | List all joints
--load-friction | FILE | Load-dependent friction of guides
--local | flag | Local sensitivities
--local-folder | flag | The cluster does not share
--machines | whole number | Monte Carlo
--mass-error | number | Relative error of the masses
--max-force | AMOUNT | Limit of the force of each actuator
--max-jerk | AMOUNT | Limit of the slider jerks
--max-nut-force | AMOUNT | Limit of the force of each nut
--max-power | AMOUNT | Limit of the power of
--max-speed | AMOUNT | Limit of the slider speeds
--measured | FILE | Measured poses
--meshcat | flag | Play the motion repeatedly in MeshCat
--method | choice | (Method of inverse|Forward|Dynamics by)
--motion | FILE | Motion (file (\(|of the glb)|of the actuated joints)
--motions | whole number | Motions that are evaluated
--motors-out | FILE | File to write motor references
--multipliers | flag | Also write the closure forces
--nodes | whole number | Grid intervals between two stops
--noise | AMOUNT AMOUNT / AMOUNT | (Standard deviations of measured positions|Noise of a measured force)
--objective | choice / text | (What is minimised|Measure to optimise)
--observer | flag | A momentum observer
--of | text | Result whose sensitivity is computed
--offsets | flag | Estimate constant offsets
--on-invalid | choice | At a sample that is
--once | flag | With --meshcat: play once
--only | choice | Draw only this figure
--open | flag | Open the user's browser
--out | FOLDER / FILE | (?!Task|Film|Picture|Report to write,? on|File to write (fo|mo|the ex)).*to write
--package-dir | FILE | Folder of the packages
--page | flag | For developers: the WebAssembly
--paper-motion | flag | Draw and check the path
--parameters | FILE | Parameter file of the machine
--paused | flag | Start with playback paused
--payload | MASS[,X,Y,Z] | Point mass on the platform
--payload-estimator | flag | An estimator of the inertial parameters
--per-axis | flag | Choose the drive of each
--period | AMOUNT | Period of the motion
--periods | whole number | Periods that are measured
--plan | POSES | Choose so many poses to
--plot | flag | Draw the figure
--point | X,Y,Z | Point that distances are measured
--points | whole number | Number of designs on the
--population | whole number | Population of the genetic algorithms
--port | whole number | Port of the page on
--pose | Y,Z,THETA | Pose of the platform
--prefix | text | Prefix of all names and
--prior | flag | The estimate will use
--ramp | AMOUNT | (Time over which the motion|Ramps from and to rest)
--quiet | flag | Print warnings and errors only
--rate | AMOUNT | (Sampling rate of the controller|Samples of the measurement)
--reference | text | Reference configuration that selects the
--reflected-mass | AMOUNT | Reflected mass of motor and
--report | FILE | Report to write,? on
--resolution | AMOUNT | Resolution of the encoders
--rest | AMOUNT | Time at rest after each
--resume | flag | Resume the work in the
--rigid-rods | flag | Rigid legs and rods
--rod-diameter | AMOUNT | Diameter of legs and rods
--rows | whole number | Base samples of the Sobol'
--samples | whole number | (N|Least n)umber of samples
--saturation | AMOUNT / FORCE|file | Saturation of the actuator forces
--scheduler | ADDRESS | Scheduler of a Dask cluster
--screenshot | FILE | Picture to write
--seed | whole number | Seed of the random numbers
--serial | number | Margin from serial singularities
--set | JOINT=VALUE | Position of an actuated joint
--shape | choice | Shape the motion so
--shapes | flag | Show the shapes of the
--sigma | NAME=VALUE | Standard deviation of a parameter
--simulate | AMOUNT | Simulate the robot from rest
--size | WIDTH HEIGHT | Size of a picture or film
--small | COLUMN | Column of designs to minimise
--smooth | auto|HZ | Filter a measured or rounded
--solids | flag | Compute all bodies from the
--speed | number | Playback speed
--spread | choice | Distribution of the parameters of
--srdf | FILE | SRDF file of a URDF
--start | whole number | Row of the reference design
--starts | whole number | Number of starts of slsqp
--step | AMOUNT | Largest step of the RK4
--stiffness | FILE | Stiffness of joints and rods
--still | flag | Show the reference configuration
--stops | flag | Also compute emergency stops
--store | FOLDER | Folder for intermediate
--subject-to | NAME=VALUE | Constraint
--surroundings | FILE | Payload, obstacles and sizes of parts
--target-error | AMOUNT | Also compute how long
--task | FILE | (Task file \(|Motion file whose forces)
--task-out | FILE | Task file to write
--threads | whole number | Number of threads
--tilt | MOST|FROM,TO | Range of the rotation θ
--time-limit | AMOUNT | Limit of the computing time
--title | text | Title of the report
--tolerance | number | Largest allowed difference of the
--top | whole number | Number of \w+ to list
--trace | FRAME | With --meshcat: draw the path
--travel | MOST|FROM,TO | Stroke of the sliders
--trust-columns | flag | Do not stop where columns
--validate | FILE | Log of another motion
--vary | NAME=VALUE | Parameter range
--velocity | Y,Z,THETA | Velocities along y
--video | FILE | Film to write
--view | choice | What --figure draws
--wasm | flag | Also WebAssembly for browsers and
--waypoints | whole number | Use closed quintic splines
--widths | choice | Whether the width of the
--workers | whole number | Number of worker processes
--worst | number | Worst case
--wrench | FILE | External load on the platform
--wrench-out | FILE | File to write the external
--xacro-arg | NAME:=VALUE | Argument of a .xacro file
"""
"""Every option: its name, the kinds of its values, and how its help begins.

A new option needs a line of its own; what another option means already is given by that option's name."""


def options():
    """Every option of every command: command, name, kind, help."""
    for command, found in commands():
        for one in found.params:
            if isinstance(one, click.Option):
                choice = isinstance(one.type, click.Choice)
                kind = "flag" if one.is_flag else "choice" if choice else one.metavar or one.type.name
                yield command, one.opts[0], kind, one.help


def table():
    rows = [line.split(" | ", 2) for line in OPTIONS.strip().splitlines()]
    return {name: (kinds.split(" / "), begins) for name, kinds, begins in rows}


def test_the_help_fits_a_page_of_forty_lines(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = run(capsys, "--help")
    lines = out.splitlines()
    assert code == 0
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    assert "..." not in out.replace("[ARGS]...", "")
    known = [(name, summary) for table in COMMANDS.values() for name, (_, summary) in table.items()]
    shown = [re.fullmatch(r".{12}(\S+) +(.*)", line) for line in lines if line[12:13].strip()]
    assert [found.groups() for found in shown if found and found[1] in app.table] == known


@pytest.mark.parametrize("group", [COMMANDS, OF_ROBOTS])
def test_headings_stand_beside_their_commands_or_above_them(capsys, monkeypatch, group):
    arguments = ("--help",) if group is COMMANDS else ("loop", "--help")
    monkeypatch.setenv("COLUMNS", "80")
    lines = run(capsys, *arguments)[1].splitlines()
    for heading, table in group.items():
        first = next(i for i, line in enumerate(lines) if line[12:].startswith(f"{next(iter(table))} "))
        beside = " ".join(line[:12].strip() for line in lines[first : first + len(table)])
        assert beside.strip() == heading
    monkeypatch.setenv("COLUMNS", "60")
    narrow = run(capsys, *arguments)[1].splitlines()
    assert [line[:-1] for line in narrow if line[:1].strip() and line.endswith(":")][: len(group)] == list(
        group
    )
    assert max(map(len, narrow)) <= 60


def test_called_alone_the_program_says_what_to_try_first(capsys):
    code, out, err = run(capsys)
    assert (code, out) == (2, "")
    tried = re.findall(r"^  p3dof (\S+)", err, re.MULTILINE)
    assert tried == ["compare", "show", "init"]
    assert "p3dof --help" in err
    assert max(map(len, err.splitlines())) <= 80


def test_one_name_has_one_meaning_and_one_meaning_one_name():
    known, seen = table(), set()
    for command, name, kind, words in options():
        assert name in known, f"{command} {name}: a new option? enter it, unless there is one of its meaning"
        alike = {
            other for other, (kinds, begins) in known.items() if re.match(begins, words) and kind in kinds
        }
        assert alike == {name}, (command, name, kind, words)
        seen.add(name)
    assert seen == set(known)


def test_every_help_is_a_sentence_in_words_of_the_field():
    own = (
        r"\b(beats?|say how|tell of|the balance|ways? to the forces|waits?|misfit|idle|as held|likewise \[)\b"
    )
    for command, found in commands():
        for text in (found.help, *(one.help for one in found.params if isinstance(one, click.Option))):
            assert re.match(r"[A-Z]", text), (command, text)
            assert re.search(r"[.\]]$", text.strip()), (command, text)
            assert not re.search(own, text), (command, text)


@pytest.mark.parametrize(
    ("arguments", "ending"),
    [
        ("comapre", "no such command 'comapre'; did you mean 'compare'?"),
        ("optimize", "no such command 'optimize'; did you mean 'optimise'?"),
        ("frobnicate", "no such command 'frobnicate'; see 'p3dof --help'"),
        ("loop inf", "no such command 'inf'; did you mean 'info'?"),
        ("loop frobnicate", "no such command 'frobnicate'; see 'p3dof loop --help'"),
        ("compare --motoin m.csv", "no such option '--motoin'; did you mean '--motion'?"),
        (
            "fastest t.yaml --maxforce 3",
            "no such option '--maxforce'; did you mean '--max-force' or '--max-nut-force'?",
        ),
        ("compare --hlep", "no such option '--hlep'; did you mean '--help'?"),
        ("compare --xyz", "no such option '--xyz'; see 'p3dof compare --help'"),
        ("loop info r.urdf -x", "no such option '-x'; see 'p3dof loop info --help'"),
        ("--verison", "no such option '--verison'; did you mean '--version'?"),
        ("forces mine.yaml", "unexpected argument 'mine.yaml'; did you mean --parameters mine.yaml?"),
        ("forces m.csv n.csv", "unexpected argument 'm.csv'; did you mean --motion m.csv?"),
        ("workspace big.txt", "unexpected argument 'big.txt'; see 'p3dof workspace --help'"),
        ("doctor m.csv", "unexpected argument 'm.csv'; see 'p3dof doctor --help'"),
    ],
)
def test_what_is_misspelt_is_guessed(capsys, arguments, ending):
    assert run(capsys, *arguments.split()) == (2, "", f"p3dof: error: {ending}\n")
