"""Results as columns: files, pandas, polars, xarray and pint have the same numbers, in the same units."""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from importlib import import_module

import numpy as np
import pandas as pd
import pint
import polars as pl
import pytest
import xarray
from documents import ROOT

import p3dof
from p3dof._base.checks import name_and_unit
from p3dof._base.tables import Tabular, columns_by, dataset_of
from p3dof.analysis.tolerances import calibrate_machine, plan_machine
from p3dof.design.drives import Drive, Motor, Screw
from p3dof.runs import PD, InitialState
from p3dof.runs.forces_along import forces_along

UNITS = pint.UnitRegistry()
MOTION = p3dof.paper_motion(21)
MACHINE = replace(p3dof.PAPER, actuators=replace(p3dof.PAPER.actuators, armature={"sliders": 2.0}))
ROBOT = p3dof.load(MACHINE)
FIVE_BAR = ROOT / "docs" / "_static" / "gallery" / "five_bar.urdf"
TURNS = "t [s],left_motor [rad],right_motor [rad]\n" + "".join(
    f"{t},{1.8 + t},{1.3 - t}\n" for t in (0, 0.1, 0.2)
)
SIGMA = (1e-5, 1e-5, 5e-5)
LEGS = dict.fromkeys(("R", "r", "L", "encoder"), "50 um")


def five_bar():
    return p3dof.load_robot(FIVE_BAR)


def log(forces):
    """Three seconds of a robot whose motor has friction that the design does not know."""
    time, noise = np.arange(600) / 200, np.random.default_rng(0).normal(0, 0.01, (600, 2))
    w = 2 * np.pi * time[:, None] + [0, np.pi / 2]
    motion = forces.home + 0.3 * np.sin(w), 0.6 * np.pi * np.cos(w), -1.2 * np.pi**2 * np.sin(w)
    rows = forces.rows(forces.from_actuators(*motion))
    measured = rows.columns @ (forces.design + 0.5 * np.equal(forces.names, "left_motor.damping"))
    return p3dof.loops.MotorLog(forces.actuators, time, motion[0], measured + rows.known + noise)


def calibrated():
    read = [[1.8, 1.3], [2.0, 1.0], [2.2, 1.4], [1.7, 0.9]]
    seen = [[0.15535, 0.58464], [0.17312, 0.51894], [0.06761, 0.54234], [0.24335, 0.5405]]
    measured = p3dof.loops.Measurements(read, seen, ("x", "z"), "left_tip", sigma=5e-6)
    return p3dof.loops.calibrate(five_bar(), measured, {"*_motor.offset": 0.02, "left_tip.length": 1e-3})


def legs_calibrated():
    plan = plan_machine(ROBOT, 12, SIGMA, LEGS, candidates=200)
    seen = ROBOT.forward_kinematics(plan.readings - [3e-5, 0, 0])
    return calibrate_machine(ROBOT, plan.readings, seen, SIGMA, LEGS)


def task_forces():
    part = p3dof.machine.Body(2.0, com=[0, 0, -0.04], inertia=[0, 0, 0])
    pick = p3dof.Waypoint([-0.1, 0, -0.2], "pick", dwell=0.1, pick_up=part)
    plan = p3dof.Task([pick, p3dof.Waypoint([0.1, 0, 0.2], "place")]).plan(duration=0.6, samples=21)
    return p3dof.design.forces_of_task(ROBOT, plan)


def drives():
    motor = Motor(rated_torque=1.3, peak_torque=3.8, max_speed=520.0, inertia=3e-5)
    (sizing,) = p3dof.size_drives(
        ROBOT, ROBOT.inverse_dynamics(MOTION), [Drive(motor, Screw(lead=0.02, diameter=0.0127, length=0.5))]
    )
    return sizing


def front():
    return p3dof.design.DesignProblem(
        {"R": (0.2, 0.3), "L": (0.35, 0.5)}, MOTION, objectives=["peak_force", "width"]
    ).pareto(points=3)


def run():
    start = InitialState(MOTION.pose[0], MOTION.velocity[0])
    return ROBOT.simulate(0.02, start=start, controller=PD(ROBOT, MOTION), samples=5)


MADE = {
    "Motion": lambda: MOTION,
    "InverseDynamics": lambda: ROBOT.inverse_dynamics(MOTION),
    "Comparison": lambda: ROBOT.compare(MOTION),
    "Energy": lambda: ROBOT.energy(ROBOT.inverse_dynamics(MOTION)),
    "Reactions": lambda: ROBOT.reactions(MOTION, "elastic"),
    "ReactionsComparison": lambda: ROBOT.reactions(MOTION),
    "Indices": lambda: ROBOT.indices([[0, 0, 0], [0.1, 0, 0.3], [9, 0, 0]], on_invalid="nan"),
    "PoseMargins": lambda: ROBOT.workspace().margin([[0, 0, 0], [0.3, 0, 0]]),
    "Simulation": run,
    "RobotRun": lambda: p3dof.runs.simulate_robot(five_bar(), 0.02, samples=5),
    "RobotForces": lambda: forces_along(five_bar(), io.StringIO(TURNS), 5),
    "ManyRuns": lambda: ROBOT.simulate_many(0.01, {"start.y [mm]": [0.0, 1.0]}),
    "TaskForces": task_forces,
    "MotorReferences": lambda: p3dof.design.motor_references(task_forces(), 1e7),
    "Clearance": lambda: p3dof.design.clearance_of(ROBOT, MOTION),
    "DesignForces": lambda: p3dof.analysis.forces_of_designs({"R": [0.25, 0.26]}, MOTION, gradients=["R"]),
    "Evaluated": lambda: front().found,
    "Front": front,
    "DesignComparison": lambda: p3dof.compare_designs({"as it is": p3dof.PAPER, "heavy": MACHINE}, MOTION)[0],
    "Sizing": drives,
    "Assessment": lambda: p3dof.assess(ROBOT, ROBOT.inverse_dynamics(MOTION)),
    "ForceTolerance": lambda: p3dof.tolerance(MACHINE, MOTION, sigma={"R": 1e-4, "platform.mass": "2 %"}),
    "PoseTolerance": lambda: p3dof.tolerance(MACHINE, pose=[0.05, 0, 0.2], sigma={"R": 1e-4}),
    "SobolIndices": lambda: p3dof.sensitivity(MACHINE, MOTION, {"L": "10 %", "R": "10 %"}, rows=16),
    "LocalSensitivity": lambda: p3dof.sensitivity(MACHINE, MOTION, {"L": "10 %"}, method="gradient"),
    "Identification": lambda: p3dof.loops.identify(
        forces := p3dof.loops.LoopForces(five_bar()), log(forces), check=False
    ),
    "Calibration": calibrated,
    "MachineCalibration": legs_calibrated,
}
"""How each result is made, by the name of its class."""


def subclasses(kind):
    return {kind, *(each for one in kind.__subclasses__() for each in subclasses(one))}


def test_every_result_with_columns_is_made_here():
    for path in (ROOT / "p3dof").rglob("*.py"):
        if "Tabular" in path.read_text(encoding="utf-8"):
            import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    known = {kind.__name__ for kind in subclasses(Tabular) - {Tabular}}
    assert known - {"LaterSimulation"} == set(MADE)


@pytest.fixture(scope="module", params=MADE)
def result(request):
    return MADE[request.param]()


def same(found, column):
    """Whether numbers have the same bits, or texts are the same."""
    found = np.asarray(found)
    if column.dtype.kind == "U":
        return found.tolist() == column.tolist()
    return np.array_equal(found.astype(float), column.astype(float), equal_nan=True)


def test_files_and_frames_have_the_same_numbers(result, tmp_path):
    columns = result.to_columns()
    rows = {len(column) for column in columns.values()}
    assert len(rows) == 1
    assert all(column.ndim == 1 for column in columns.values())
    path = result.to_csv(tmp_path / "table.csv")
    read = pd.read_csv(path, float_precision="round_trip", keep_default_na=False, na_values=["nan"])
    frame, other = result.to_dataframe(), pl.DataFrame(columns)
    assert list(read) == list(frame) == other.columns == list(columns)
    for name, column in columns.items():
        assert same(read[name], column), name
        assert same(frame[name], column), name
        assert same(other[name], column), name
        assert same(pl.from_pandas(frame)[name], column), name


def test_units_are_attributes_that_pint_reads(result):
    columns, frame, dataset = result.to_columns(), result.to_dataframe(), result.to_dataset()
    row, names = result._row_name, [name_and_unit(header)[0] for header in columns]
    assert list(dataset.dims) == ([row] if not isinstance(result, p3dof.Indices) else ["pose"])
    for name, header in zip(names, columns, strict=True):
        unit = name_and_unit(header)[1]
        assert frame.attrs["units"].get(header) == unit
        there = dataset[name if names.count(name) == 1 else header]
        assert there.attrs.get("units") == unit
        assert same(there.values, columns[header])
        if unit is not None:
            UNITS.Unit(unit.replace("%", "percent"))
    for unit in columns.get("unit", ()):
        UNITS.Unit(unit)
    assert row in dataset.coords or isinstance(result, p3dof.Indices)


DIMENSIONS = {
    "t": "[time]",
    "kinetic": "[energy]",
    "potential": "[energy]",
    "power A": "[power]",
    "work C": "[energy]",
    "dissipated power": "[power]",
    "momentum x": "[mass] * [length] / [time]",
    "angular momentum y": "[mass] * [length] ** 2 / [time]",
    "kinetic platform": "[energy]",
}


def test_quantities_of_pint_have_the_dimensions_of_mechanics():
    dataset = MADE["Energy"]().to_dataset()
    of = {
        name: UNITS.Quantity(one.values, one.attrs.get("units", ""))
        for name, one in dataset.variables.items()
    }
    for name, dimension in DIMENSIONS.items():
        assert of[name].check(dimension), name
    parts = (of["kinetic"] + of["potential"]).to("N mm").magnitude
    np.testing.assert_allclose(parts, 1e3 * dataset["total"].values, rtol=1e-14)


@pytest.mark.parametrize("take", ["to_dataframe", "to_dataset", "polars"])
def test_frames_are_taken_as_motions_again(take):
    table = pl.DataFrame(MOTION.to_columns()) if take == "polars" else getattr(MOTION, take)()
    time = table["t"].values if take == "to_dataset" else table["t [s]"]
    again = p3dof.Motion(time, table, table, table)
    for name in ("time", "pose", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(again, name), getattr(MOTION, name))
    np.testing.assert_array_equal(ROBOT.inverse_dynamics(again).forces, ROBOT.inverse_dynamics(MOTION).forces)


def test_a_dataset_goes_through_netcdf(tmp_path):
    dataset = MADE["InverseDynamics"]().to_dataset()
    with xarray.open_dataset(p3dof.analysis.indices.write_dataset(dataset, tmp_path / "forces.nc")) as again:
        xarray.testing.assert_identical(again, dataset)


def test_what_columns_are_called():
    forces = MADE["InverseDynamics"]().to_columns()
    assert list(forces)[:7] == ["t [s]", "fA [N]", "fB [N]", "fC [N]", "nut A [N]", "nut B [N]", "nut C [N]"]
    assert "nut A [N]" not in p3dof.load().inverse_dynamics(MOTION).to_columns()
    values = np.arange(12.0).reshape(2, 2, 3)
    found = columns_by("f{} [N]", "ABC", values)
    assert {name: column.tolist() for name, column in found.items()} == {
        "fA [N]": [0, 3, 6, 9], "fB [N]": [1, 4, 7, 10], "fC [N]": [2, 5, 8, 11]
    }  # fmt: skip


def test_a_name_with_two_units_and_rows_without_a_name():
    dataset = dataset_of({"A [m]": np.ones(2), "A [m/s]": np.zeros(2)}, "sample")
    assert set(dataset) == {"A", "A [m/s]"}
    assert dataset["A [m/s]"].attrs == {"units": "m/s"}
    assert dataset["sample"].values.tolist() == [0, 1]
    assert dict(dataset_of({}, "sample").sizes) == {"sample": 0}


@pytest.mark.parametrize(("library", "door"), [("pandas", "to_dataframe"), ("xarray", "to_dataset")])
def test_a_library_that_is_missing_is_named(monkeypatch, library, door):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(p3dof.errors.MissingExtraError, match=f"{door} needs {library}: pip install 'p3dof"):
        getattr(MOTION, door)()


def test_a_table_of_another_kind_of_file_is_refused(tmp_path):
    with pytest.raises(p3dof.InputError, match=r"forces\.xlsx: expected a file name that ends in \.csv"):
        ROBOT.inverse_dynamics(MOTION).to_csv(tmp_path / "forces.xlsx")
