"""What a person reads of `Manipulator`: a short signature, short help, every argument told once."""

from __future__ import annotations

import inspect
import pydoc
import re
import typing

import numpy as np
import pytest

import p3dof
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
    robot.kernels = p3dof.MachineKernels(robot.parameters, level="numpy", threads=1)
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
    if inspect.isclass(function):
        return [hint for name, hint in typing.get_type_hints(function).items() if name[0] != "_"]
    returned = getattr(function, "__annotations__", {}).get("return")
    if not isinstance(returned, str):
        return [returned]
    late = {"Simulation": p3dof.Simulation, "LiveViewer": p3dof.viewer.LiveViewer}
    names = {**late, **getattr(inspect.unwrap(function), "__globals__", {})}
    return [eval(returned, names)]  # noqa: S307 - our own


def test_what_public_functions_return_is_public():
    """By its own name, or in a room that is public."""
    public = [getattr(p3dof, name) for name in p3dof.__all__]
    doors = [door for door in public if inspect.ismodule(door)]
    within = [getattr(door, name) for door in doors for name in getattr(door, "__all__", ())]
    rooms = [*doors, *filter(inspect.ismodule, within)]
    offered = [getattr(room, name) for room in rooms for name in getattr(room, "__all__", ())]
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
    assert missing == {"p3dof.closed_form.compiled.formulas.Kernel"}  # what a benchmark asks of the kernels
