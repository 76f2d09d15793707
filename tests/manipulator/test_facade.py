"""What a person reads of `Manipulator`: a short signature, short help, every argument told once."""

from __future__ import annotations

import dataclasses
import inspect
import pydoc
import re
import typing

import numpy as np
import pytest

import p3dof
from p3dof._base.checks import Readable
from p3dof.machine.parameters import PAPER, SOLIDS

METHODS = [
    (name, function)
    for name, function in inspect.getmembers(p3dof.Manipulator, inspect.isfunction)
    if name[0] != "_"
]
COMMON = {
    "pose", "velocity", "acceleration", "motion", "forces", "wrench", "on_invalid", "out", "method",
    "progress",
}  # fmt: skip
"""Arguments that the class tells of, once for all methods."""


def test_its_signature_is_short():
    signature = str(inspect.signature(p3dof.Manipulator))
    assert len(signature) < 200
    assert "parameters: 'Parameters | None' = None" in signature


def test_its_help_is_short_and_mostly_methods():
    text = pydoc.plain(pydoc.render_doc(p3dof.Manipulator)).splitlines()
    assert len(text) < 280
    begin = next(i for i, line in enumerate(text) if "Methods defined here" in line)
    end = next(i for i, line in enumerate(text) if "properties defined here" in line)
    assert end - begin > len(text) / 2


def test_it_is_one_class():
    assert p3dof.Manipulator.__mro__ == (p3dof.Manipulator, object)


@pytest.mark.parametrize(("name", "function"), METHODS, ids=[name for name, _ in METHODS])
def test_every_argument_is_told_of(name, function):
    """In the class for what is common, else in the method, which then names it."""
    own, common = inspect.getdoc(function), inspect.getdoc(p3dof.Manipulator)
    assert len(own.splitlines()) <= 15, name
    told = {
        word for line in re.findall(r"^(\w[\w, ]*) : ", common, re.MULTILINE) for word in line.split(", ")
    }
    assert told == {*COMMON, "parameters"}
    for argument in list(inspect.signature(function).parameters)[1:]:
        if argument not in COMMON:
            assert re.search(rf"\b{argument}\b", own), (name, argument)


@pytest.mark.parametrize(("name", "function"), METHODS, ids=[name for name, _ in METHODS])
def test_arrays_are_told_with_their_shape(name, function):
    if inspect.signature(function).return_annotation == "FloatArray":
        assert re.search(r"\(\.\.\., 3(, 3)?\)", inspect.getdoc(function)), name


def test_without_parameters_it_is_the_papers():
    assert p3dof.Manipulator().parameters is p3dof.load().parameters is PAPER
    with pytest.raises(p3dof.InputError, match="parameters: expected Parameters, got str"):
        p3dof.Manipulator("machine.yaml")


def test_copies_are_machines_of_their_own():
    import copy
    import pickle

    robot = p3dof.load(SOLIDS)
    expected = robot.forces(np.zeros(3), np.zeros(3), np.zeros(3))
    for other in (copy.deepcopy(robot), pickle.loads(pickle.dumps(robot))):  # noqa: S301 - our own
        assert other.loop is not robot.loop
        np.testing.assert_array_equal(other.forces(np.zeros(3), np.zeros(3), np.zeros(3)), expected)


def test_its_kernels_can_be_exchanged():
    robot = p3dof.load()
    pose = np.tile([0.01, 0.02, 0.1], (5, 1))
    before = robot.forces(pose, pose, pose, method="compiled")
    robot.kernels = p3dof.closed_form.MachineKernels(robot.parameters, level="numpy", threads=1)
    assert robot.kernels.level == "numpy"
    ran = []
    real = robot.kernels.run
    robot.kernels.run = lambda *given: (ran.append(1), real(*given))[1]
    np.testing.assert_allclose(robot.forces(pose, pose, pose, method="compiled"), before, rtol=1e-13)
    assert ran == [1]
    with pytest.raises(p3dof.InputError, match="kernels: expected MachineKernels, got str"):
        robot.kernels = "numpy"


def classes(hint):
    if isinstance(hint, type):
        yield hint
    for each in typing.get_args(hint):
        yield from classes(each)


def functions_of(value):
    if not inspect.isclass(value):
        yield value
        return
    yield value
    for name, member in inspect.getmembers(value):
        if name[0] != "_":
            yield getattr(member, "fget", None) or getattr(member, "func", member)


def hints_of(function):
    wings = (p3dof.machine, p3dof.closed_form, p3dof.methods, p3dof.runs, p3dof.analysis, p3dof.design)
    doors = [p3dof, p3dof.loops, p3dof.viewer, *wings]
    offered = [(room, name) for room in (*doors, p3dof.analysis.reactions) for name in room.__all__]
    late = {name: getattr(room, name) for room, name in offered}  # what is imported when it is used
    if inspect.isclass(function):
        hints = typing.get_type_hints(function, localns=late)
        return [hint for name, hint in hints.items() if name[0] != "_"]
    returned = getattr(function, "__annotations__", {}).get("return")
    if not isinstance(returned, str):
        return [returned]
    names = {**late, **getattr(inspect.unwrap(function), "__globals__", {})}
    return [eval(returned, names)]  # noqa: S307 - our own


def test_what_public_functions_return_is_public():
    """By its own name, or in a room that is public."""
    public = [getattr(p3dof, name) for name in p3dof.__all__]
    doors = [door for door in public if inspect.ismodule(door)]
    within = [getattr(door, name) for door in doors for name in getattr(door, "__all__", ())]
    rooms = [*doors, *filter(inspect.ismodule, within)]
    offered = [getattr(room, name) for room in rooms for name in getattr(room, "__all__", ())]
    wings = (p3dof.machine, p3dof.closed_form, p3dof.methods, p3dof.runs, p3dof.analysis, p3dof.design)
    public += [getattr(door, name) for door in wings for name in door.__all__]
    known = {*map(id, public), *map(id, offered)}
    missing = {
        f"{found.__module__}.{found.__qualname__}"
        for value in public
        if not inspect.ismodule(value)
        for function in functions_of(value)
        for hint in hints_of(function)
        for found in classes(hint)
        if found.__module__.startswith("p3dof.") and id(found) not in known
    }
    assert missing == {
        "p3dof.closed_form.compiled.formulas.Kernel",  # what a benchmark asks of the kernels
        "p3dof._base.tables.Table",  # what functions of a wing make for pages, which show it by themselves
        "p3dof.design.tasks.plan.Source",  # what a plan keeps for `p3dof.design.shaped`
        "p3dof.methods.registry.AtOnce",  # what a method prepares for `Manipulator`
    }


ROWS = np.array([[0.0, 0.01, 0.1], [0.01, 0.0, 0.2]])
SPEEDS = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])


def tables():
    """Poses by name in other orders and units, and what each is made with."""
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    y, z, theta = ROWS.T
    frame = pandas.DataFrame({"theta [deg]": np.degrees(theta), "t": [0, 1], "z [mm]": 1000 * z, "y": y})
    columns = {"theta": ("t", theta), "y": ("t", 1000 * y, {"units": "mm"}), "z": ("t", z)}
    array = xarray.DataArray(ROWS[:, ::-1], dims=("t", "axis"), coords={"axis": ["theta", "z", "y"]})
    return {
        "frame": frame,
        "records": frame.to_records(index=False),
        "structured": np.rec.fromarrays([theta, z, y], names="theta,z,y").view(np.ndarray),
        "dataset": xarray.Dataset(columns),
        "array": array,
        "array turned": array.T,
        "numbers alone": pandas.DataFrame(ROWS),
    }


@pytest.mark.parametrize("kind", tables())
def test_tables_are_read_by_name(kind):
    robot, table, still = p3dof.load(), tables()[kind], np.zeros((2, 3))
    known = robot.forces(ROWS, SPEEDS, still)
    for method in ("pinocchio", "virtual-power", "compiled"):
        found = robot.forces(table, SPEEDS, still, method=method)
        np.testing.assert_allclose(found, known, rtol=0, atol=1e-11 * np.abs(known).max())
    np.testing.assert_allclose(p3dof.Motion([0, 1], table, still, still).pose, ROWS, rtol=1e-15, atol=1e-17)
    np.testing.assert_allclose(p3dof.Motion.from_poses([0, 1], table).pose, ROWS, rtol=1e-15, atol=1e-17)
    np.testing.assert_allclose(p3dof.Motion.through(table, [0, 1]).pose[-1], ROWS[1], rtol=1e-15, atol=1e-17)


def test_a_whole_motion_and_its_load_in_one_table():
    pandas = pytest.importorskip("pandas")
    motion, names = p3dof.paper_motion(21), ["t", "y", "z", "theta", "ydot", "zdot", "thetadot"]
    columns = np.column_stack([motion.time, motion.pose, motion.velocity, motion.acceleration, np.eye(21, 6)])
    names += ["yddot", "zddot", "thetaddot", "fx", "fy", "fz", "mx", "my", "mz"]
    frame = pandas.DataFrame(columns, columns=names)[names[::-1]]
    robot, same = p3dof.load(), p3dof.Motion(frame["t"], frame, frame, frame)
    assert same.pose.tolist() == motion.pose.tolist()
    assert same.acceleration.tolist() == motion.acceleration.tolist()
    found = robot.inverse_dynamics(same, wrench=frame, method="compiled").forces
    known = robot.inverse_dynamics(motion, wrench=np.eye(21, 6), method="compiled").forces
    assert found.tolist() == known.tolist()
    assert p3dof.WrenchHistory(frame.t, frame).wrench.tolist() == np.eye(21, 6).tolist()
    row = frame.iloc[5]
    assert (
        robot.forces(row, row, row).tolist()
        == robot.forces(*(a[5] for a in (motion.pose, motion.velocity, motion.acceleration))).tolist()
    )
    assert robot.simulate(0.01, start=row).pose[0].tolist() == motion.pose[5].tolist()
    with pytest.warns(p3dof.errors.ModelWarning, match=r"\(300 m/s: mm/s\?\)"):
        robot.forces(row, pandas.Series({"thetadot": 0, "zdot": 300, "ydot": 0}), row)


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        (["y", "z", "phi"], "pose: expected the columns y,z,theta, got a DataFrame with y,z,phi"),
        (
            ["y", "z [kg]", "theta"],
            "pose, column z: expected a unit of m, mm, cm, um, µm, km, in, ft, got [kg]",
        ),
        (["y", "z", "theta [mm]"], "pose, column theta: expected a unit of rad, deg, °, mrad, got [mm]"),
        (["y", "y [mm]", "z"], "pose: expected the columns y,z,theta, got a DataFrame with y,y [mm],z"),
    ],
)
def test_tables_without_the_names_are_refused(columns, line):
    pandas = pytest.importorskip("pandas")
    with pytest.raises(p3dof.P3dofError) as told:
        p3dof.load().forces(pandas.DataFrame(ROWS, columns=columns), SPEEDS, SPEEDS)
    assert str(told.value) == line
    with pytest.raises(
        p3dof.P3dofError, match="com: expected numbers without names, got a Series with a,b,c"
    ):
        p3dof.machine.Body(1, pandas.Series([0, 0, 0], index=["a", "b", "c"]))


def test_a_table_for_another_quantity_has_its_units():
    pandas = pytest.importorskip("pandas")
    poses = pandas.DataFrame(ROWS, columns=["y", "z", "theta [deg]"])
    with pytest.raises(p3dof.P3dofError) as told:
        p3dof.load().forces(ROWS, poses, SPEEDS)
    assert (
        str(told.value) == "velocity, column theta: expected a unit of rad/s, deg/s, °/s, mrad/s, got [deg]"
    )


@pytest.mark.parametrize("method", ["pinocchio", "virtual-power", "compiled"])
def test_masked_numbers_are_invalid_samples(method):
    robot, zero = p3dof.load(), np.zeros((2, 3))
    masked = np.ma.masked_array(ROWS, mask=[[0, 0, 0], [0, 0, 1]])
    for given in ((masked, zero, zero), (ROWS, masked, zero), (ROWS, zero, masked)):
        found = robot.forces(*given, method=method, on_invalid="nan")
        assert np.isfinite(found).tolist() == [[True] * 3, [False] * 3]
        with pytest.raises(p3dof.P3dofError, match=r"expected finite numbers, got \[0.01, 0.0, nan\]"):
            robot.forces(*given, method=method)
        alone = robot.forces(*(rows[1] for rows in given), method=method, on_invalid="nan")
        assert np.isnan(alone).all()
    load = np.ma.masked_array(np.ones(6), mask=[1, 0, 0, 0, 0, 0])
    assert np.isnan(robot.forces(ROWS[0], *zero, wrench=load, method=method, on_invalid="nan")).all()
    with pytest.raises(
        p3dof.errors.MotionError, match=r"pose: expected finite numbers, got nan at index \[1, 2\]"
    ):
        p3dof.Motion([0, 1], masked, zero, zero)


def test_nor_are_they_data_elsewhere():
    robot, masked = p3dof.load(), np.ma.masked_array([0.0, 0.01, 0.1], mask=[0, 0, 1])
    for ask in (robot.sliders, robot.jacobian, robot.mass_matrix, robot.forward_kinematics):
        assert np.isnan(ask(masked, on_invalid="nan")).all()
        if ask != robot.forward_kinematics:
            method = {} if ask == robot.sliders else {"method": "compiled"}
            assert np.isnan(ask(masked, on_invalid="nan", **method)).all()
    zero = np.zeros(3)
    force = robot.forward_dynamics(zero, zero, masked, on_invalid="nan", method="compiled")
    assert np.isnan(force).all()
    assert np.isnan(robot.force_derivatives(zero, masked, zero, on_invalid="nan").forces).all()


@pytest.mark.parametrize(
    ("ask", "line"),
    [
        (lambda: p3dof.loda, "module 'p3dof' has no attribute 'loda'; did you mean 'load'?"),
        (
            lambda: p3dof.runs.ControlLop,
            "module 'p3dof.runs' has no attribute 'ControlLop'; did you mean 'ControlLoop'?",
        ),
        (lambda: p3dof.Motoin, "module 'p3dof' has no attribute 'Motoin'; did you mean 'Motion'?"),
        (lambda: p3dof.xylophone, "module 'p3dof' has no attribute 'xylophone'"),
        (
            lambda: p3dof.PAPER.geometri,
            "'Parameters' object has no attribute 'geometri'; did you mean 'geometry'?",
        ),
        (
            lambda: p3dof.paper_motion(3).poses,
            "'Motion' object has no attribute 'poses'; did you mean 'pose'?",
        ),
        (
            lambda: p3dof.load().inverse_dynamics(p3dof.paper_motion(3)).force,
            "'InverseDynamics' object has no attribute 'force'; did you mean 'forces'?",
        ),
        (
            lambda: p3dof.load().simulate(0.01).sliderz,
            "'LaterSimulation' object has no attribute 'sliderz'; did you mean 'sliders'?",
        ),
    ],
)
def test_a_wrong_name_gets_the_nearest_one(ask, line):
    with pytest.raises(AttributeError) as told:
        ask()
    assert str(told.value) == line


def public_classes():
    """Every class that a door offers, of data."""
    doors = [getattr(p3dof, name) for name in p3dof.__all__]
    doors = [p3dof, *(door for door in doors if inspect.ismodule(door) and hasattr(door, "__all__"))]
    found = [getattr(door, name) for door in doors for name in door.__all__]
    rooms = [room for room in found if inspect.ismodule(room)]
    found += [getattr(room, name) for room in rooms for name in getattr(room, "__all__", ())]
    kinds = {each for each in found if inspect.isclass(each) and dataclasses.is_dataclass(each)}
    return sorted(kinds, key=lambda each: (each.__module__, each.__name__))


def has_a_form_of_its_own(kind):
    """Neither that of us for all, nor that of dataclasses, which wrap theirs."""
    return kind.__repr__ is not Readable.__repr__ and not hasattr(kind.__repr__, "__wrapped__")


FORMS = [kind for kind in public_classes() if not has_a_form_of_its_own(kind)]


@pytest.mark.parametrize("kind", FORMS, ids=lambda kind: kind.__name__)
def test_whatever_is_in_a_result_it_is_written_in_ten_lines(kind):
    """One of each class of data, all fields large that are no single number or text."""
    large = np.arange(30_000.0).reshape(-1, 3)
    for value in (large, (large,) * 50, dict.fromkeys(range(50), large), [p3dof.PAPER] * 3):
        made = kind.__new__(kind)
        for item in dataclasses.fields(kind):
            single = set(re.findall(r"\w+", str(item.type))) <= {"float", "int", "bool", "str", "None"}
            object.__setattr__(made, item.name, 1.5 if single else value)
        text = repr(made)
        assert text.count("\n") < 10, text
        assert len(text) < 1200


def test_real_results_are_written_in_ten_lines():
    robot, motion = p3dof.load(), p3dof.paper_motion(1001)
    result, still = robot.inverse_dynamics(motion, method="compiled"), np.zeros((1001, 3))
    task = p3dof.Task([p3dof.Waypoint([0, 0, 0]), p3dof.Waypoint([0.1, 0, 0])])
    loop = robot.loop
    made = [
        p3dof.PAPER, p3dof.PAPER.bodies, p3dof.PAPER.friction, robot, robot.mechanism, motion, result,
        result.joints, result.utilisations(p3dof.PAPER.limits), robot.energy(result), task, task.plan(1),
        robot.simulate(0.05), robot.indices(motion.pose), robot.workspace(), robot.compare(motion[::100]),
        robot.inverse_kinematics(motion.pose), robot.singularity(motion.pose),
        robot.mechanism_motion(motion.pose, motion.velocity, still), robot.reactions(motion[::100]),
        robot.force_derivatives(motion.pose, still, still), robot.force_regressor(motion.pose, still, still),
        loop, loop.assemble(), loop.complete(np.zeros(3), np.zeros(3), np.zeros(3), loop.assemble().q),
        p3dof.WrenchHistory(motion.time, np.zeros((1001, 6))), motion.curve, robot.refined(motion),
    ]  # fmt: skip
    for each in made:
        assert repr(each).count("\n") < 10, repr(each)
    assert repr(p3dof.PAPER.geometry) == "Geometry(r=0.1, R=0.25, L=0.4, b=0.05)"
    assert repr(robot.singularity(motion.pose)) == (
        "Singularity(serial=array(1001,3), actuation=array(1001,), determinant=array(1001,))"
    )
