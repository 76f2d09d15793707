"""Every reader of files that the package has, each with files that it takes: for tests that damage them."""

from __future__ import annotations

import contextlib
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import closed_loop_robots as robots
import numpy as np
import robot_texts
import sdf_texts
import sweep_problems
import yaml
from documents import ROOT
from robot_texts import FULL

try:
    import mujoco
except ImportError:
    mujoco = None

import p3dof
from p3dof._base import blocks
from p3dof._base.files import pack_arrays, read_text
from p3dof._base.files.reading import dump_hashed
from p3dof._base.time_series.joint_files import read_joints
from p3dof.analysis.designs.files import read_designs
from p3dof.analysis.load_friction.contacts import read_load_friction
from p3dof.analysis.reactions.stiffness import read_stiffness
from p3dof.analysis.tolerances import read_uncertainty
from p3dof.design.bearings import read_bearings
from p3dof.design.drives import read_catalogue
from p3dof.design.optimisation.evolution import Journal
from p3dof.design.optimisation.problem import read_problem
from p3dof.design.sweeps import read_sweep
from p3dof.design.tasks import read_task
from p3dof.loops import Sidecar, load_robot
from p3dof.loops.writers import mjcf, sdf, urdf
from p3dof.machine.parameters import machine as serialization
from p3dof.runs.many.columns import read_runs
from p3dof.viewer.document.meshes import MeshFiles

MOTION = p3dof.paper_motion(11)
HOME = np.zeros(3)


@dataclass(frozen=True)
class Reader:
    """One reader.

    Parameters
    ----------
    name : str
        The file's name, below a folder.
    kind : str
        What its damages are, as of `damage.damaged`.
    files : callable
        Returns files that it takes.
    read : callable
        Is given the path; reads the file and does with it what comes next.
    around : callable
        Is given the folder before; puts there what belongs to the file.
    takes : {"files", "all", "nothing"}
        What is not refused: the files; damaged ones too, which count as missing; or not even the files, whose
        format is not read.
    """

    name: str
    kind: str
    files: Callable[[], list[bytes]]
    read: Callable[[Path], Any]
    around: Callable[[Path], Any] = lambda _: None
    takes: Literal["files", "all", "nothing"] = "files"


def encoded(*texts: str) -> Callable[[], list[bytes]]:
    return lambda: [text.encode() for text in texts]


# Parameters, tasks, parts of machines ---------------------------------------------------------------------

MORE = """
friction: {viscous: {sliders: 12.5, hinge_left: 0.1}, coulomb: {slide_a: 3 N}, smoothing: 0.002}
actuators: {armature: {sliders: 14.8}, counterbalance: {slide_a: 40 N}, spring: {slide_b: 495}}
payload: {mass: 950 g, com: [0, 0, -100 mm], inertia: [410 kg mm^2, 410 kg mm^2, 380 kg mm^2]}
"""
TASK = """
name: pick and place
path: straight
profile: s-curve
smoothness: 3
turning_length: 100 mm
carrying: {mass: 200 g, com: [0, 0, 0], inertia: [0, 0, 0]}
limits: {force: 300 N, jerk: [500, 500, 300 m/s^3]}
waypoints:
  - {name: home, pose: [0, 0, 0 deg]}
  - {name: pick, pose: [-50 mm, 0, -5 deg], dwell: 200 ms, put_down: true}
  - {pose: [-50 mm, 25 mm], blend: 15 mm, blend_range: [1 mm, 20 mm], tolerance: [1 mm, 2 mm]}
  - {name: back, pose: [0, 0, 0], duration: 1.5, wrench: [0, 10 N, -50 N, 0, 0, 0]}
"""
BEARINGS = """
hinges: {name: 6001, dynamic: 5.1 kN, static: 2.4 kN, X: 0.56, Y: 1.6, e: 0.27}
guides: {name: size 15, dynamic: 10 kN, basis: 50 km, static: 16 kN, moments: [120 Nm, 120 Nm, 150 Nm]}
joints: {hinge_left: {name: needle, dynamic: 6 kN, kind: roller}}
"""
STIFFNESS = """
hinges: {radial: 100 N/um, axial: 50 N/um, tilt: 10 N m/mrad}
slides: {lateral: 200 N/um, tilt: 20 N m/mrad, roll: 10 N m/mrad}
universals: {force: 80 N/um, moment: 4 N m/mrad}
rods: {diameter: 20 mm, young: 210 GPa, poisson: 0.3}
joints: {hinge_left: {radial: 60 N/um}}
misfit: {shift: 5 um, turn: 0.1 mrad}
cuts: paper
"""
LOAD_FRICTION = """
hinges: {mu: 0.002, radius: 8 mm}
universals: {mu: 0.003, radius: 6 mm}
slides: {mu: 0.004, drag: 2 N, arm: 30 mm, screw: 0.1}
smoothing: 0.002
joints: {hinge_left: none}
"""
DRIVES = """
motors:
  - {name: M400, rated_torque: 1.3 Nm, peak_torque: 3.8 Nm, rated_speed: 3000 rpm, max_speed: 5000 rpm,
     inertia: 0.3 kg cm^2, brake_torque: 1.4 Nm,
     winding: {bus_voltage: 320, pole_pairs: 4, resistance: 1.0, inductance: 0.008, measured: between lines,
               torque_constant_rms: 0.594, max_current_rms: 8.5, field_weakening: true}}
screws:
  - {name: 16x10, lead: 10 mm, diameter: 12.7 mm, length: 500 mm, efficiency: 0.9}
belts: []
gears:
  - {name: direct, ratio: 1}
  - {name: i3, ratio: 3, efficiency: 0.96, inertia: 0.1 kg cm^2}
"""
MAKER = """
motors:
  table: m.csv
  encoding: cp1252
  separator: ";"
  decimal: ","
  thousands: "."
  header: 2
  columns: {Typ: name, "M0 [Nm]": rated_torque, Mmax: "peak_torque [Nm]", 4: "max_speed [rpm]", J: inertia,
            n: "curve.speed [rpm]", S1: curve.continuous, S6: curve.peak, U: winding.bus_voltage}
  constant: {max_inertia_ratio: 10, winding: {pole_pairs: 4, resistance: 1 ohm, inductance: 8 mH,
             measured: between lines, torque_constant_rms: 0.6, max_current_rms: 20 A}}
screws:
  - {name: 16x10, lead: 10 mm, diameter: 12.7 mm, length: 500 mm, efficiency: 0.9}
"""
MOTORS = """Servomotoren;;;;;;;;
Typ;M0 [Nm];Mmax;n max;J;n;S1;S6;U
M 1;1,3;3,8;5.000;0,3 kg cm^2;0;1,3;3,8;320
;;;;;3.000;1,2;3,8;
;;;;;5.000;0,9;1,5;
"M 2 ""Größe"" 5";2,4;7,2 Nm;6.000;1,2 kgcm²;;;;325
"""
UNCERTAINTY = """
sigma: {R: 0.5 mm, L: 0.2 mm, platform.mass: 50 g, slide_a.offset: 0.1 mm}
variables: {L: {uniform: [395 mm, 405 mm]}, platform.mass: {normal: [8 kg, 200 g]}}
"""
PROBLEM = """
motion: {paper: 21}
bodies: solids
variables: {R: [150 mm, 500 mm], L: [200 mm, 800 mm], rod_radius: [3 mm, 15 mm]}
fixed: {slider_edge: 50 mm}
box: {y: [-100 mm, 100 mm], theta: [-30 deg, 30 deg]}
objectives: [peak_force, width]
constraints: {singularity: {min: 15 deg}, width: {max: 500 mm}, relations: [R >= r + 0.03]}
robust: {sigma: {R: 0.5 mm, L: 0.5 mm}, measures: [peak_force, singularity], k: 3}
"""
SWEEP = """
motion: {paper: 21}
variables:
  {R: {uniform: [240 mm, 280 mm]}, L: {uniform: [380 mm, 500 mm]}, platform.mass: {normal: [8 kg, 200 g]}}
sampling: sobol
count: 1000
figures: [singularity, sliders]
seed: 3
block_size: 100
keep: [peak_force, geometry.R]
reductions:
  - {top: peak_force, count: 20}
  - {pareto: {peak_force: min, reach: max}}
  - {histogram: peak_force, from: 0, to: 500, bins: 50}
  - {moments: [peak_force]}
"""
RUNS = """
motion: {paper: 21}
run: {controller: pd, rate: 1000, noise: {position: 2 um, velocity: 0.1 mm/s}}
variables: {start.y: {uniform: [-1 mm, 1 mm]}, damping: {uniform: [0.5, 1]}}
count: 10
"""


def used_parameters(path: Path) -> None:
    robot = p3dof.load(p3dof.read_parameters(path))
    robot.forces(HOME, HOME, HOME, on_invalid="nan")
    serialization.parse(serialization.dump(robot.parameters), any_size=True)


def beside_a_table(folder: Path) -> None:
    (folder / "m.csv").write_bytes(MOTORS.encode("cp1252"))


# Tables of motions, loads and designs ---------------------------------------------------------------------

POSES = "t,y,z,theta\n" + "".join(f"{k / 10},{k / 500},{-k / 700},{k * k / 2000}\n" for k in range(9))
UNITS = "# from a robot\nt [ms],y [mm],z,theta [deg]\n0,1,0.01,3\n10,2,0.02,4\n25,3.5,0.025,4.5\n"
WRENCH = "t,fx,fy [kN],fz,mx,my,mz [N mm]\n0,1,2,3,4,5,6\n0.5,1,-2,3,-4,5,-6\n1,0,0,0,0,0,0\n"
JOINTS = "t,left,right\n" + "".join(f"{k / 8},{k / 9},{-k / 10}\n" for k in range(8))
DESIGNS = "R [mm],L,platform.mass [g]\n250,0.4,8000\n260,0.41,8100\n240,0.39,7900\n1,0.39,7900\n"
OF_RUNS = "start.y [mm],platform.mass [g]\n0.1,8000\n-0.1,8100\n0,7900\n"


@cache
def ten_columns() -> bytes:
    moving = p3dof.paper_motion(5)
    rows = np.column_stack((moving.time, moving.pose, moving.velocity, moving.acceleration))
    header = "t,y,z,theta,ydot,zdot,thetadot,yddot,zddot,thetaddot\n"
    return (header + "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist())).encode()


def used_motion(path: Path) -> None:
    moving = p3dof.Motion.from_csv(path)
    p3dof.load().forces(moving.pose, moving.velocity, moving.acceleration, on_invalid="nan")


def used_joints(path: Path) -> None:
    curve = read_joints(read_text(path), path.name, ("left", "right"), (False, True))
    curve.at(curve.divided(2))


def used_designs(path: Path) -> None:
    for rows in read_designs(path, 3):
        p3dof.analysis.forces_of_designs(rows.columns, MOTION)


@cache
def parquet(text: str) -> bytes:
    import pyarrow
    from pyarrow import parquet as file

    header, *rows = (line.split(",") for line in text.splitlines())
    columns = {
        name: np.array(cells, float) for name, cells in zip(header, zip(*rows, strict=True), strict=True)
    }
    sink = pyarrow.BufferOutputStream()
    file.write_table(pyarrow.table(columns), sink)
    return sink.getvalue().to_pybytes()


# Runs, sweeps, optimisations ------------------------------------------------------------------------------


@cache
def archives() -> list[bytes]:
    robot, folder = p3dof.load(), sweep_folder().parent
    run = robot.simulate(
        0.05,
        controller=p3dof.runs.PD(robot, MOTION.from_rest(0.2)),
        control=p3dof.runs.ControlLoop(200),
        samples=11,
    )
    data = run.save(folder / "run.npz").read_bytes()
    with np.load(folder / "run.npz") as arrays:
        return [data, pack_arrays(dict(arrays), compressed=False)]


def used_run(path: Path) -> None:
    run = p3dof.Simulation.load(path)
    assert all(np.isfinite(column).all() for column in run.to_columns().values())


_FOLDERS: dict[str, Path] = {}


def sweep_folder(kind: str = "npz") -> Path:
    """Return the folder of a sweep that was computed once."""
    if kind not in _FOLDERS:
        import tempfile

        folder = Path(tempfile.mkdtemp(prefix="p3dof-readers-")) / "sweep"
        p3dof.sweep(sweep_problems.problem(10), folder, reductions=sweep_problems.reductions(), format=kind)
        _FOLDERS[kind] = folder
    return _FOLDERS[kind]


def beside(kind: str, folder: Path) -> None:
    for file in sweep_folder(kind).rglob("*"):
        if file.is_file():
            there = folder / file.relative_to(sweep_folder(kind))
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_bytes(file.read_bytes())


def part_of_sweep(name: str, kind: str = "npz") -> Callable[[], list[bytes]]:
    return lambda: [(sweep_folder(kind) / name).read_bytes()]


def hash_again(path: Path) -> None:
    """Make the hash of a file right after its damage, so that what is behind it is reached."""
    with contextlib.suppress(ValueError, TypeError, AttributeError, RecursionError):
        data = json.loads(path.read_bytes())
        path.write_text(dump_hashed({k: v for k, v in data.items() if k != "hash"}), encoding="utf-8")


def used_sweep(path: Path) -> None:
    folder = next(above for above in path.parents if (above / "sweep.json").exists())
    if path.name == "sweep.json":
        hash_again(path)
    found = blocks.Sweep.load(folder)
    _ = found.reductions
    found.columns()


ABOUT = {"problem": {"geometry": {"r": 0.1}}, "seed": 3, "method": "slsqp"}
PART = {"design": np.arange(3.0), "value": np.array(3.5), "done": np.array([1, 2])}


@cache
def journal() -> bytes:
    folder = sweep_folder().parent / "journal"
    with Journal(folder, ABOUT) as kept:
        kept.write("part", **PART)
    return (folder / "optimisation.json").read_bytes()


def used_journal(path: Path) -> None:
    if path.suffix == ".json":
        hash_again(path)
    with Journal(path.parent, ABOUT, resume=True) as kept:
        kept.read("part")


def beside_a_part(folder: Path) -> None:
    (folder / "optimisation.json").write_bytes(journal())


# Robots ---------------------------------------------------------------------------------------------------


def used_robot(path: Path) -> None:
    """Read a robot; what is written of it is what MuJoCo takes, or refused in one line too."""
    robot = load_robot(path)
    for write in (urdf.texts, mjcf.text, sdf.text, partial(sdf.text, drake=True)):
        try:
            text = write(robot)
            if write is mjcf.text and mujoco is not None:
                mujoco.MjModel.from_xml_string(text)
        except p3dof.P3dofError as error:  # noqa: PERF203 - a format may not have what a robot has
            assert "\n" not in str(error)  # noqa: PT017 - most are written


def robot_files() -> list[bytes]:
    return [
        robot_texts.chain(robot_texts.ROTOR + robot_texts.GEAR + robot_texts.loop()).encode(),
        robot_texts.chain(robot_texts.BALL, second='<mimic joint="shoulder"/>').encode(),
        robots.hexapod().encode(),
        robot_texts.chain(
            robot_texts.LOOP_JOINT.format("spherical")
            + robot_texts.GAZEBO.format("ball")
            + robot_texts.QUIET
            + robot_texts.CONTROL.format("shoulder")
            + '<frame name="tool" link="lower" xyz="0 0 1"/>'
        ).encode(),
        *((ROOT / "urdf" / name).read_bytes() for name in ("p3dof_plus.urdf", "p3dof_drake.urdf")),
    ]


def sdf_files() -> list[bytes]:
    return [(ROOT / "urdf/p3dof.sdf").read_bytes(), *(text.encode() for text in sdf_texts.ALL)]


def file_of(*names: str) -> Callable[[], list[bytes]]:
    return lambda: [(ROOT / "urdf" / name).read_bytes() for name in names]


XACRO = """<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="d" value="1"/><xacro:macro name="m" params="p"><link name="l"/></xacro:macro>
<xacro:m p="${d}"/><link name="base"/></robot>"""


def used_sidecar(path: Path) -> None:
    load_robot(robots.five_bar(), Sidecar.from_yaml(path))


DATA = """
joint_data:
- {joint: left_elbow, stiffness: 20, rest: 0.1, damping: 0.3, friction: 0.5, rotor_inertia: 4e-6,
   gear_ratio: 50}
reference: {left_joint: 0.3, right_joint: 2}
"""
OWN = "closed_loop:\n- [left_tip, right_tip]\ntype: [3d]\nname_mot: [left_joint, right_joint]\n"


def used_srdf(path: Path) -> None:
    load_robot(robot_texts.chain(), srdf_file=path)


# Meshes ---------------------------------------------------------------------------------------------------

CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "".join(
    f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES
)
OFF = (
    "OFF\n4 4 0\n"
    + "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)
)
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 4\nproperty list uchar int vertex_indices\nend_header\n" + OFF.split("0\n", 1)[1]
)
ASCII_STL = (
    "solid a\n"
    + "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*CORNERS[i]) for i in face)
        + "endloop\nendfacet\n"
        for face in FACES
    )
    + "endsolid a\n"
)
BINARY_STL = (
    bytes(80)
    + struct.pack("<I", 4)
    + b"".join(struct.pack("<12fH", 0, 0, 1, *(x for i in face for x in CORNERS[i]), 0) for face in FACES)
)
DAE = f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="s">
<float_array id="f" count="12">{" ".join(str(x) for c in CORNERS for x in c)}</float_array>
<technique_common><accessor source="#f" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{" ".join(str(i) for f in FACES for i in f)}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def used_mesh(path: Path) -> None:
    MeshFiles(path.parent).read(path.name, None)


def _yaml(read: Callable[[Path], Any], *texts: str) -> Reader:
    return Reader("x.yaml", "yaml", encoded(*texts), read)


def _mesh(name: str, kind: str, content: str | bytes) -> Reader:
    data = content if isinstance(content, bytes) else content.encode()
    return Reader(name, kind, lambda: [data], used_mesh)


BLOCK = "blocks/0000000/0000000001"
READERS: dict[str, Reader] = {
    "parameters": _yaml(
        used_parameters, serialization.dump(p3dof.PAPER), serialization.dump(p3dof.PAPER) + MORE
    ),
    "task": _yaml(lambda path: read_task(path).plan(4.0, 40), TASK),
    "problem": _yaml(read_problem, PROBLEM),
    "sweep file": _yaml(read_sweep, SWEEP, RUNS, PROBLEM + "count: 100\n"),
    "bearings": _yaml(read_bearings, BEARINGS),
    "stiffness": _yaml(read_stiffness, STIFFNESS),
    "load friction": _yaml(read_load_friction, LOAD_FRICTION),
    "drives": _yaml(lambda path: list(read_catalogue(path)), DRIVES),
    "drives of makers": Reader("x.yaml", "yaml", encoded(MAKER), read_catalogue, beside_a_table),
    "table of a maker": Reader(
        "m.csv",
        "csv",
        lambda: [MOTORS.encode("cp1252")],
        lambda path: list(read_catalogue(path.with_name("x.yaml"))),
        lambda folder: (folder / "x.yaml").write_text(MAKER, encoding="utf-8"),
    ),
    "uncertainty": _yaml(read_uncertainty, UNCERTAINTY),
    "motion": Reader("m.csv", "csv", lambda: [POSES.encode(), UNITS.encode(), ten_columns()], used_motion),
    "wrench": Reader("w.csv", "csv", encoded(WRENCH), p3dof.WrenchHistory.from_csv),
    "joints": Reader("j.csv", "csv", encoded(JOINTS), used_joints),
    "designs": Reader("d.csv", "csv", encoded(DESIGNS), used_designs),
    "designs in Parquet": Reader("d.parquet", "binary", lambda: [parquet(DESIGNS)], used_designs),
    "runs": Reader("r.csv", "csv", encoded(OF_RUNS), read_runs),
    "runs in Parquet": Reader("r.parquet", "binary", lambda: [parquet(OF_RUNS)], read_runs),
    "run archive": Reader("r.npz", "npz", archives, used_run),
    "manifest": Reader("sweep.json", "json", part_of_sweep("sweep.json"), used_sweep, partial(beside, "npz")),
    "block": Reader(f"{BLOCK}.npz", "npz", part_of_sweep(f"{BLOCK}.npz"), used_sweep, partial(beside, "npz")),
    "block in Parquet": Reader(
        f"{BLOCK}.parquet",
        "binary",
        part_of_sweep(f"{BLOCK}.parquet", "parquet"),
        used_sweep,
        partial(beside, "parquet"),
    ),
    "reductions": Reader(
        "reductions.npz", "npz", part_of_sweep("reductions.npz"), used_sweep, partial(beside, "npz"), "all"
    ),
    "journal": Reader("optimisation.json", "json", lambda: [journal()], used_journal),
    "part of a journal": Reader(
        "part.npz", "npz", lambda: [pack_arrays(PART, compressed=False)], used_journal, beside_a_part, "all"
    ),
    "URDF": Reader("r.urdf", "xml", robot_files, used_robot),
    "MJCF": Reader("r.xml", "xml", file_of("p3dof_mjcf.xml"), used_robot),
    "SDF": Reader("r.sdf", "xml", sdf_files, used_robot),
    "USD": Reader("r.usda", "text", file_of("p3dof.usda"), used_robot),
    "SRDF": Reader("r.srdf", "xml", encoded(robot_texts.SRDF), used_srdf),
    "xacro": Reader("r.urdf", "xml", encoded(XACRO), used_robot, takes="nothing"),
    "sidecar": _yaml(used_sidecar, OWN, OWN + DATA),
    "any sidecar": _yaml(Sidecar.from_yaml, yaml.safe_dump(FULL)),
    "STL": _mesh("a.stl", "text", ASCII_STL),
    "binary STL": _mesh("b.stl", "binary", BINARY_STL),
    "OBJ": _mesh("a.obj", "text", OBJ),
    "OFF": _mesh("a.off", "text", OFF),
    "PLY": _mesh("a.ply", "text", PLY),
    "Collada": _mesh("a.dae", "xml", DAE),
}
