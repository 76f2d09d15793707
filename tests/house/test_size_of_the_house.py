"""A stranger can walk through the house: few doors and modules, a class name once behind a door."""

import ast
from collections import Counter

from documents import ROOT

PACKAGE = ROOT / "p3dof"
MODULES = sorted(PACKAGE.rglob("*.py"))


def classes_of(path):
    return [
        node.name
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    ]


def test_there_are_few_doors_and_modules_and_not_much_to_read():
    doors = [path for path in PACKAGE.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()]
    assert len([path for path in doors if not path.name.startswith("__")]) <= 14
    assert len(MODULES) <= 400
    # 92,000; the reader of SDF, whose joints may form loops; elements of a URDF, and loops of its dialects;
    # traced functions as WebAssembly, and the engine of a robot's page; where robots start, `--around`; signs
    # of loops that are left open; macros of a URDF; shapes of an SDF; USD; bushings; a free root
    # beside the world; transmissions, in Python and C; momentum observers, likewise; CUDA
    # of any robot; packages for ROS 2; excitation, identification and calibration, payloads in a loop;
    # drive trains one can sign: margins, lives of nuts, supplies, stops, clearances, tasks; what swings on at
    # stops, on the command line; torque-speed curves in fastest motions; formulas in design problems; nearest
    # parts in pages; results as columns with units, every command as JSON; model files, and no Pinocchio;
    # sizes and density of solids that a machine keeps; limits and singular poses along a robot's motion;
    # units in every option, and options by their names in errors.
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES)
    assert lines <= 92_000 + 1_500 + 700 + 450 + 420 + 480 + 450 + 20 + 1_360 + 400 + 80 + 430 + 7_670 + 8_050


def test_a_class_has_a_name_of_its_own_behind_its_door():
    names = Counter(
        (path.relative_to(PACKAGE).parts[0], name) for path in MODULES for name in classes_of(path)
    )
    assert [name for name, count in names.items() if count > 1] == []
