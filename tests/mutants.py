"""Break the sources on purpose, one place at a time, and tell which breakages no test notices.

    make mutants                        # a sample of 300
    make mutants COUNT=0                # all of them: hours
    make mutants ONLY=paper SEED=7      # a sample of the modules whose path holds this word
    make mutants ONLY=reference.py:36:  # what is changed in one line

Each mutant is one changed operator, sign, comparison, number, function or returned array in one of the
modules below. A child process imports the mutated module and runs the module's tests until the first fails.
Messages, indices and annotations stay. A survivor is a line for a person to judge: if it is equivalent, or a
matter of speed alone, it goes into ``mutants_survivors.txt`` with a reason, and is not tried again. Others
make the command fail: CI tries a small sample, another one with every commit.
"""

from __future__ import annotations

import argparse
import ast
import atexit
import copy
import functools
import hashlib
import importlib.abc
import importlib.util
import os
import random
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

ROOT = Path(__file__).parents[1]
SURVIVORS = ROOT / "tests/mutants_survivors.txt"
SHARED = ("kinematics", "thresholds", "minimal", "friction", "virtual_power", "manipulator", "evidence")
CLOSED = ("evidence", "thresholds", "closed_loop", "closed_loop_assembly", "manipulator", "closed_loop_batch")
LOOPS = ("loop_minimal", "loop_derivatives", "loop_identification", "loop_margins")
FILES = ("mjcf_traits", "write_mjcf", "write_sdf")
READ = ("mjcf_traits", "robot_mjcf", "robot_files", "closed_loop_files", "pinocchio_models")
RUNS = ("evidence", "thresholds", "control")
ROBOTS = ("any_robot", "robot_runs")
KINDS = ("closure_kinds", "couplings", "closed_loop", "scale")
PRINTED = ("codegen::test_generated_kernels_are_up_to_date",)
WRITTEN = ("codegen::test_the_command_checks_the_kernels", "codegen::test_the_command_writes_and_checks")
TESTS = {
    # Formulas and the machine.
    "p3dof/_base/__init__.py": ("facade",),
    "p3dof/_base/algebra.py": SHARED,
    "p3dof/_base/checks.py": ("checks", "bad_input", "parameters", "start"),
    "p3dof/_base/samples.py": ("evidence", "gate", "methods"),
    "p3dof/_base/quantities.py": ("shown_tables", "parameters", "parameter_data", "units"),
    "p3dof/_base/outputs.py": ("outputs",),
    "p3dof/_base/threads.py": ("threads",),
    "p3dof/_base/model_files.py": ("model_files",),
    "p3dof/_base/files/": ("files", "outputs"),
    "p3dof/_base/tables.py": ("tables", "every_number", "shown_tables"),
    "p3dof/_base/time_series/": ("motion", "measured_motions", "shown_tables"),
    "p3dof/_base/time_series/smoothing.py": ("reported_errors", "measured_motions", "motion", "shown_tables"),
    "p3dof/_base/time_series/joint_files.py": ("measured_motions", "cli_loop", "joint_data"),
    "p3dof/_base/time_series/wrenches.py": ("wrenches", "measured_motions", "motion"),
    "p3dof/_base/tracing/": ("tracing", "minimal"),
    "p3dof/_base/integrators/": ("integrators",),
    "p3dof/closed_form/paper/": SHARED,
    "p3dof/closed_form/kinematics/": SHARED,
    "p3dof/closed_form/kinematics/validity.py": (*SHARED, "gate"),
    "p3dof/machine/parameters/": (
        "shown_tables",
        "parameters",
        "parameter_data",
        "units",
        "solids_of_the_machine",
    ),
    "p3dof/machine/parameters/actuators.py": (
        "actuators",
        "shown_tables",
        "parameters",
        "parameter_data",
        "units",
    ),
    "p3dof/machine/motion/": ("motion", "measured_motions", "shown_tables"),
    "p3dof/machine/motion/states.py": ("states", "wrenches", *SHARED),
    "p3dof/methods/": ("utilisation", "shown_tables", *SHARED, "gate", "methods"),
    "p3dof/methods/compiled.py": (*SHARED, "outputs", "gate", "methods", "utilisation", "shown_tables"),
    "p3dof/methods/one_sample.py": ("outputs",),
    "p3dof/methods/pinocchio.py": (*SHARED, "utilisation", "shown_tables", "gate", "methods"),
    "p3dof/methods/regressor.py": ("reduced",),
    # The paper's method compiled, and C.
    "p3dof/closed_form/compiled/": (*PRINTED, "minimal", "reduced"),
    "p3dof/_native/": ("kernels_extension",),
    "p3dof/closed_form/compiled/designs.py": (
        "designs",
        "codegen::test_generated_kernels_are_up_to_date",
        "minimal",
        "reduced",
    ),
    "p3dof/closed_form/compiled/lanes.py": (*PRINTED, "lanes", "minimal", "reduced"),
    "p3dof/closed_form/compiled/many.py": ("lanes", "runs_in_c"),
    "p3dof/closed_form/compiled/runs.py": ("lanes", "runs_in_c"),
    "p3dof/codegen/": (*PRINTED, "shown_tables", "codegen_names", "codegen_chains", "loop_codegen"),
    "p3dof/codegen/selftest.py": (
        *PRINTED,
        "codegen::test_the_six_entries_of_an_inertia_stand_by_rows",
        "shown_tables",
        "codegen_names",
        "codegen_chains",
    ),
    "p3dof/codegen/web_controller.py": (
        "codegen::test_generated_kernels_are_up_to_date",
        "shown_tables",
        "codegen_names",
        "codegen_chains",
        "loop_codegen",
        "page_wasm",
    ),
    # Any robot.
    "p3dof/loops/": (*KINDS, "reported_errors", "closed_loop_assembly", "closed_loop_batch"),
    "p3dof/loops/results.py": (
        *CLOSED,
        "closure_kinds",
        "couplings",
        "scale",
        "reported_errors",
        "assembly_far",
        "assembly_targets",
        "hybrid_dynamics",
    ),
    "p3dof/loops/robots.py": (*READ, *KINDS, "reported_errors", "closed_loop_assembly", "closed_loop_batch"),
    "p3dof/loops/tables.py": (
        *KINDS,
        "shown_tables",
        "reported_errors",
        "closed_loop_assembly",
        "closed_loop_batch",
    ),
    "p3dof/loops/trees.py": ("robot_files", *LOOPS, "locks"),
    "p3dof/loops/inverse.py": (*CLOSED, "refusals"),
    "p3dof/loops/sidecar.py": (
        *KINDS,
        "closed_loop_files",
        "sidecar_schema",
        "shown_tables",
        "joint_data",
        "any_robot",
    ),
    "p3dof/loops/batch/": ("reported_errors", "closed_loop_batch", "batch_targets", "closure_kinds"),
    "p3dof/loops/batch/kinematics.py": (
        "reported_errors",
        "closed_loop_batch",
        "batch_targets",
        "closure_kinds",
        "any_robot",
    ),
    "p3dof/loops/batch/hybrid.py": ("hybrid_dynamics",),
    "p3dof/loops/batch/traced.py": ("traced", "closed_loop_batch", "batch_targets"),
    "p3dof/loops/closure_kinds.py": (*KINDS,),
    "p3dof/loops/closure_joints.py": ("reactions", "any_robot", "elastic_reactions", "closure_wrenches"),
    "p3dof/loops/closure_tangents.py": (*LOOPS,),
    "p3dof/loops/compiled/": ("compiled_loops",),
    "p3dof/loops/compiled/functions.py": (
        "compiled_loops",
        "reported_errors",
        "compiled_runs",
        "robot_runs_in_c",
        "page_alive",
    ),
    "p3dof/loops/compiled/adaptive.py": ("robot_runs_in_c", "compiled_loops"),
    "p3dof/loops/compiled/run": ("reported_errors", "compiled_runs", "robot_runs_in_c"),
    "p3dof/loops/compiled/solutions.py": ("compiled_loops", "following"),
    "p3dof/loops/compiled/following.py": ("compiled_loops", "compiled_runs", "robot_runs_in_c"),
    "p3dof/loops/transmission.py": ("transmission",),
    "p3dof/loops/observer.py": ("observer",),
    "p3dof/loops/identification/calibration.py": ("calibration",),
    "p3dof/loops/identification/fitting.py": ("calibration",),
    "p3dof/cli/measuring.py": ("cli_calibrate", "excite"),
    "p3dof/loops/online.py": ("online",),
    "p3dof/loops/compliance.py": ("elastic_reactions",),
    "p3dof/loops/coordinates.py": (
        *KINDS,
        "reported_errors",
        "closed_loop_assembly",
        "closed_loop_batch",
        "joint_data",
        "any_robot",
        "loop_minimal",
    ),
    "p3dof/loops/closures.py": (
        *KINDS,
        "reported_errors",
        "closed_loop_assembly",
        "closed_loop_batch",
        "closure_wrenches",
    ),
    "p3dof/loops/regressor.py": ("loop_identification", "loop_margins"),
    "p3dof/loops/formats/": READ,
    "p3dof/loops/formats/sdf": ("robot_sdf", "sdformat"),
    "p3dof/loops/formats/usd.py": ("robot_usd",),
    "p3dof/loops/formats/urdf.py": (*READ, "closed_loop", "reactions", "elastic_reactions", "any_robot"),
    "p3dof/loops/hybrid": ("hybrid_dynamics",),
    "p3dof/loops/derivatives.py": LOOPS,
    "p3dof/loops/margins": ("loop_margins",),
    "p3dof/loops/minimal": LOOPS,
    "p3dof/loops/assembly.py": (
        *CLOSED,
        *KINDS,
        "closed_loop_assembly",
        "closed_loop_batch",
        "assembly_far",
        "assembly_targets",
        "closure_kinds",
        "couplings",
        "scale",
        "reported_errors",
    ),
    "p3dof/loops/partitions.py": (*CLOSED, "hybrid_dynamics"),
    "p3dof/loops/reaction": ("any_robot", "reactions", "closure_kinds"),
    "p3dof/loops/reaction_algebra.py": ("any_robot", "reactions", "closure_kinds", "elastic_reactions"),
    "p3dof/loops/bushings.py": ("bushings",),
    "p3dof/loops/tree_formulas.py": ("compiled_loops", "bushings"),
    "p3dof/loops/tree_tangents.py": (*LOOPS,),
    "p3dof/loops/units.py": ("scale", "loop_derivatives", "reactions"),
    "p3dof/loops/model.py": ("closed_loop_batch", "hybrid_dynamics", "compiled_loops"),
    "p3dof/loops/writers/": FILES,
    "p3dof/_base/markup.py": ("description::test_angles_give_the_rotation_back", *FILES, "robot_files"),
    "p3dof/machine/description/": ("description", "masses", "urdf_plus", "friction_elsewhere"),
    "p3dof/machine/description/mjcf_text.py": ("description", "mujoco", "friction_elsewhere"),
    "p3dof/machine/description/sdf_text.py": ("description", "sdformat", "friction_elsewhere"),
    "p3dof/machine/description/usd_stage.py": ("usd", "friction_elsewhere"),
    "p3dof/machine/description/tree.py": (
        "description",
        "masses",
        "urdf_plus",
        "description_workspace",
        "friction_elsewhere",
    ),
    "p3dof/machine/description/shapes.py": ("viewer_shapes", "description"),
    "p3dof/methods/engines/": ("reported_errors", "engines"),
    # In time.
    "p3dof/runs/": ("reported_errors", "following", "robot_runs", *RUNS),
    "p3dof/runs/archive.py": ("simulation_files",),
    "p3dof/runs/compiled_": ("equal_steps_in_c", "robot_runs_in_c", "runs_in_c"),
    "p3dof/runs/controllers.py": RUNS,
    "p3dof/runs/machine_plants.py": (*RUNS, "minimal", "simulation"),
    "p3dof/runs/joint_": ("robot_runs", "any_robot"),
    "p3dof/runs/plants.py": ("any_robot", "actuators", *RUNS),
    "p3dof/runs/margins.py": ROBOTS,
    "p3dof/runs/results.py": ROBOTS,
    "p3dof/runs/robots.py": ROBOTS,
    "p3dof/runs/robots_many.py": ("reported_errors", "robot_runs_in_c", "compiled_runs"),
    "p3dof/runs/simulation.py": ("reported_errors", "study_numbers", "simulation_files", "tables", "control"),
    "p3dof/runs/settings.py": ("reported_errors", "energy", "blocks_cluster", "robot_runs", *RUNS),
    "p3dof/runs/forces_along.py": ("cli_loop", "page_robots"),
    "p3dof/runs/many/": ("study_numbers", "many_runs", "many_runs_friction", "many_runs_clients"),
    "p3dof/analysis/energy/": ("energy", "actuators"),
    "p3dof/analysis/reactions/": ("reactions", "elastic_reactions"),
    "p3dof/analysis/load_friction/": ("load_friction",),
    # Designs.
    "p3dof/_base/blocks/": ("reductions", "sampling_of_blocks", "study_numbers", "blocks"),
    "p3dof/design/sweeps/": ("sweeps", "run_sweeps"),
    "p3dof/analysis/designs/": ("study_numbers", "designs", "solids_of_the_machine", "own_bodies"),
    "p3dof/analysis/designs/files.py": (
        "cli_designs",
        "sweeps",
        "run_sweeps",
        "optimisation",
        "study_numbers",
        "designs",
    ),
    "p3dof/analysis/tolerances/": ("tolerance_numbers", "tolerances", "sensitivity", "cli_tolerance"),
    "p3dof/analysis/identification.py": ("machine_forces", "estimates"),
    "p3dof/loops/identification/": ("estimates", "machine_forces"),
    "p3dof/analysis/tolerances/calibration.py": (
        "machine_calibration",
        "tolerance_numbers",
        "tolerances",
        "sensitivity",
        "cli_tolerance",
    ),
    "p3dof/loops/identification/excitation.py": ("excitation",),
    "p3dof/loops/identification/search.py": ("excitation",),
    "p3dof/report/plots/identification.py": ("excite", "cli_calibrate", "identification_validation"),
    "p3dof/loops/identification/data.py": ("identification_data", "identification_validation"),
    "p3dof/loops/identification/logs.py": ("identification_data",),
    "p3dof/loops/identification/validation.py": ("identification_data", "identification_validation"),
    "p3dof/design/optimisation/": ("optimisation", "study_numbers", "optima", "pareto"),
    "p3dof/design/optimisation/expressions.py": ("expressions",),
    "p3dof/design/optimisation/constraints.py": ("expressions", "optimisation", "study_numbers", "pareto"),
    "p3dof/design/optimisation/pareto.py": (
        "optimisation",
        "study_numbers",
        "own_bodies",
        "optima",
        "pareto",
    ),
    "p3dof/design/optimisation/feasibility.py": (
        "conflicts",
        "optimisation",
        "study_numbers",
        "optima",
        "pareto",
    ),
    "p3dof/design/optimisation/robust.py": ("robust",),
    "p3dof/design/optimisation/statement.py": ("optimisation", "mixed", "own_bodies", "optima"),
    "p3dof/design/optimisation/minimising.py": ("mixed", "optimisation", "optima", "pareto"),
    "p3dof/design/optimisation/task_measures.py": ("mixed",),
    "p3dof/design/optimisation/measures.py": (
        "optimisation",
        "study_numbers",
        "optima",
        "pareto",
        "bearings_of_tasks",
    ),
    "p3dof/analysis/workspace/": (
        "workspace_forms",
        "study_numbers",
        "workspace",
        "largest_boxes",
        "workspace_maps",
    ),
    "p3dof/analysis/workspace/largest.py": ("largest_boxes",),
    "p3dof/analysis/workspace/workspace.py": ("largest_boxes", "study_numbers", "cli_workspace"),
    "p3dof/analysis/indices/": ("indices",),
    "p3dof/analysis/indices/definitions.py": ("workspace_maps", "indices"),
    "p3dof/design/tasks/": ("tasks", "fastest", "fastest_jerk", "fastest_drives"),
    "p3dof/design/tasks/paths.py": ("tasks", "fastest_motion", "fastest", "joint_paths"),
    "p3dof/design/tasks/f": ("fastest", "tasks", "fastest_jerk", "fastest_drives"),
    "p3dof/design/tasks/laws.py": ("fastest_jerk", "fastest", "tasks"),
    "p3dof/design/drives/": ("margins", "drive_numbers", "winding", "drives"),
    "p3dof/design/drives/catalogue.py": ("drive_files", "drives"),
    "p3dof/design/drives/makers.py": ("drive_files",),
    "p3dof/design/drives/stopping.py": ("stopping",),
    "p3dof/design/drives/supply.py": ("supply",),
    "p3dof/design/drives/nuts.py": ("nuts", "makers_examples"),
    "p3dof/design/bearings/": ("bearings", "nuts"),
    "p3dof/manipulator.py": ("comparison", "manipulator", "gate"),
    "p3dof/methods/comparison": ("comparison", "manipulator", "gate"),
    "p3dof/methods/registry.py": ("comparison", "manipulator", "gate"),
    "p3dof/design/assessment": ("task_numbers", "assessment"),
    "p3dof/design/balance.py": ("balance",),
    "p3dof/design/clearance.py": ("clearance",),
    "p3dof/design/vibration.py": ("vibration",),
    "p3dof/design/design_comparison.py": ("task_numbers", "compare_designs"),
    "p3dof/design/fastest.py": (
        "fastest",
        "best_path",
        "tasks",
        "fastest_jerk",
        "task_numbers",
        "assessment",
    ),
    "p3dof/analysis/sampling.py": ("sampling",),
    "p3dof/design/sizing.py": ("task_numbers", "drives", "drive_numbers", "supply", "stopping", "assessment"),
    "p3dof/design/forces_of_tasks.py": ("task_numbers", "tasks", "fastest", "assessment"),
    "p3dof/cli/codegen.py": ("shown_tables", *WRITTEN),
    "p3dof/cli/loop/simulate.py": ("shown_tables", "cli_loop"),
    "p3dof/cli/simulate.py": ("cli_machine",),
    "p3dof/cli/workspace.py": ("shown_tables", "cli_workspace"),
}
"""Which tests look after which modules, the quick ones first: the longest beginning of a path counts. One
test of a file is ``file::test``."""

EXCEPTIONS = {
    "p3dof/__main__.py": "starts the command in a process of its own, where no mutant is",
    "p3dof/cli/": "hands on to the rooms and words what they say",
    "p3dof/_base/errors.py": "words",
    "p3dof/viewer/document/": "what is drawn in a browser, by Chromium",
    "p3dof/report/plots/": "where lines and texts are drawn: looks; the numbers are those of the rooms",
    "p3dof/report/": "pages of tables and figures of the rooms",
    "p3dof/viewer/": "what is drawn in a browser, by Chromium",
}
"""Modules that are not broken, and why not; what `TESTS` names inside is."""

SLOW = (
    "hundreds_of_times",
    "wrong_mass_costs",
    "cut_off_forces",
    "takes_away",
    "wind_up",
    "equal_seeds",
    "can_be_used_again",
)
"""Parts of the names of tests that are left out: others find the same sooner."""

OPERATORS = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.MatMult: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
COMPARISONS = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
NAMES = {"sin": "cos", "cos": "sin", "max": "min", "min": "max", "maximum": "minimum", "minimum": "maximum",
         "all": "any", "any": "all", "sum": "max", "hypot": "arctan2"}  # fmt: skip
VALUES = (ast.Call, ast.BinOp, ast.Subscript)
"""What is worth setting to zero where it is returned or passed on by name."""

QUIET = (ast.JoinedStr, ast.Raise, ast.Assert)
"""What is told in words: no number a user computes with."""


@dataclass(frozen=True)
class Mutant:
    """One change of one module: the n-th of those that `changes` finds, at a line, in words."""

    module: str
    number: int
    line: int
    words: str


Children: TypeAlias = dict[int, tuple[Mutant | None, float, str]]
"""Running processes by their number: the mutant, when it began, the module whose tests it runs."""


def replacements(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield what to put in the place of a node, with words for it."""
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        yield "operator", _with(node, op=OPERATORS[type(node.op)]())
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in COMPARISONS:
        yield "comparison", _with(node, ops=[COMPARISONS[type(node.ops[0])](), *node.ops[1:]])
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield "sign", node.operand
    elif isinstance(node, ast.Constant) and type(node.value) in {int, float}:
        value = node.value + 1 if isinstance(node.value, int) else 1.01 * node.value or 0.01
        yield "number", _with(node, value=value)
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield "function", _with(node, attr=NAMES[node.attr])
    elif isinstance(node, ast.Return | ast.keyword) and isinstance(node.value, VALUES):
        yield "zeroed", _with(node, value=ast.BinOp(ast.Constant(0), ast.Mult(), node.value))


def _with(node: ast.AST, **fields: Any) -> ast.AST:
    """Return a node with other fields; what is below it is shared."""
    new = copy.copy(node)
    for name, value in fields.items():
        setattr(new, name, value)
    return new


def _is_shape(node: ast.AST) -> bool:
    """Whether a call only puts an array into another shape, or makes an empty one or one of NaN."""
    if not isinstance(node, ast.Call):
        return False
    name = getattr(node.func, "attr", "")
    of_nan = name == "full" and ast.unparse(node.args[-1]) == "np.nan"
    return of_nan or name in {"reshape", "empty", "swapaxes"}


def changes(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int | None, ast.AST, str]]:
    """Yield every change of a tree: where it is made (node, field, index), what is put there, and words."""
    for field, value in ast.iter_fields(tree):
        if field in {"annotation", "returns", "decorator_list", "bases"}:
            continue
        if isinstance(tree, ast.Subscript) and field == "slice":
            continue
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if not isinstance(child, ast.AST) or isinstance(child, QUIET) or _is_shape(child):
                continue
            for words, new in replacements(child):
                yield tree, field, index, new, words
            yield from changes(child)


def longest(module: str, table: Mapping[str, Any]) -> str:
    """Return the longest beginning of a path that a table has; empty if none."""
    return max((place for place in table if module.startswith(place)), key=len, default="")


def tests_of(module: str) -> tuple[str, ...]:
    """Return the tests that look after a module; none if it is an exception, or nobody does."""
    place = longest(module, TESTS)
    return () if len(longest(module, EXCEPTIONS)) > len(place) else TESTS.get(place, ())


def modules() -> list[str]:
    """Return the modules that can be broken."""
    return sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "p3dof").rglob("*.py"))


def room_of(module: str) -> str:
    """Return the room of a module."""
    return "/".join(module.split("/")[1:3]).removesuffix(".py")


def mutants_of(module: str) -> list[Mutant]:
    """Return all mutants of a module."""
    found = enumerate(changes(ast.parse((ROOT / module).read_text(encoding="utf-8"))))
    return [
        Mutant(module, number, place.lineno if hasattr(place, "lineno") else 0, words)
        for number, (_, _, _, place, words) in found
    ]


def mutated(mutant: Mutant) -> ast.Module:
    """Return the tree of a mutant."""
    tree = ast.parse((ROOT / mutant.module).read_text(encoding="utf-8"))
    for number, (node, field, index, new, _) in enumerate(changes(tree)):
        if number == mutant.number:
            if index is None:
                setattr(node, field, new)
            else:
                getattr(node, field)[index] = new
            break
    return ast.fix_missing_locations(tree)


class Loader(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module from a tree instead of from its file."""

    def __init__(self, mutant: Mutant) -> None:
        self.name = mutant.module.removesuffix(".py").replace("/", ".")
        self.path, self.tree = str(ROOT / mutant.module), mutated(mutant)

    def find_spec(self, name, path=None, target=None):  # noqa: ARG002
        if name == self.name:
            return importlib.util.spec_from_file_location(name, self.path, loader=self)
        return None

    def exec_module(self, module) -> None:
        exec(compile(self.tree, self.path, "exec"), vars(module))  # noqa: S102


class FewExamples:
    """A pytest plugin: no slow tests, five examples of each random test and no search for the smallest."""

    def pytest_collection_modifyitems(self, items) -> None:
        from hypothesis import Phase, settings

        items[:] = [item for item in items if not any(word in item.name for word in SLOW)]
        for item in items:
            test = getattr(item, "obj", None)
            if hasattr(test, "hypothesis"):
                given = getattr(test, "_hypothesis_internal_use_settings", None)
                few = {"max_examples": 5, "phases": (Phase.explicit, Phase.generate), "database": None}
                test._hypothesis_internal_use_settings = settings(given, **few)


def file_of(name: str) -> str:
    """Return what pytest is given for a name of `TESTS`."""
    file, *test = name.split("::")
    (path,) = (ROOT / "tests").glob(f"*/test_{file}.py")
    return "::".join([str(path), *test])


def run_tests(mutant: Mutant | None, module: str) -> int:
    """Run a module's tests in this process, until one fails; return pytest's exit code."""
    import pytest

    if mutant is not None:
        sys.meta_path.insert(0, Loader(mutant))
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    files = [file_of(name) for name in dict.fromkeys(tests_of(module))]
    options = [
        "-x",
        "-q",
        "--assert=plain",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-p",
        "no:nbmake",
        "-o",
        "addopts=",
    ]
    return int(pytest.main([*options, "-m", "not fuzz and not slow", *files], plugins=[FewExamples()]))


def start(mutant: Mutant | None, module: str) -> int:
    """Start a child process for a mutant; return its number."""
    child = os.fork()
    if child:
        return child
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a script's background job ignores it
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        os._exit(run_tests(mutant, module))
    except BaseException:  # pytest itself: also a mutant that is found
        traceback.print_exc()
        os._exit(3)


def wait(children: Children, limit: float) -> tuple[Mutant | None, int, float, str]:
    """Wait for one child; return its mutant, exit code (-1: out of time), processor's seconds and module."""
    while True:
        now = time.monotonic()
        for child, (mutant, began, module) in list(children.items()):
            done, status, used = os.wait4(child, os.WNOHANG)
            if done:
                del children[child]
                return mutant, os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, module
            if now - began > limit:
                stop({child: children.pop(child)})
                return mutant, -1, now - began, module
        time.sleep(0.05)


def stop(children: Children) -> None:
    """End children, with what they have started."""
    for child in children:
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)


@functools.cache
def keys_of(module: str) -> tuple[str, ...]:
    """Return the mutants of a module in words that stay when lines move: what is changed, in which line."""
    text = (ROOT / module).read_text(encoding="utf-8")
    lines, found = text.splitlines(), []
    for _, _, _, new, words in changes(ast.parse(text)):
        old = lines[new.lineno - 1].strip() if hasattr(new, "lineno") else ""
        found.append(f"{module}: {words}: {old}  ->  {ast.unparse(new)}")
    return tuple(found)


def drawn(seed: int, mutant: Mutant) -> bytes:
    """Return what mutants are sorted by: by chance, but changes elsewhere and moves leave the sample."""
    key, folder = keys_of(mutant.module)[mutant.number], mutant.module.rpartition("/")[0]
    return hashlib.sha256(f"{seed} {key.removeprefix(folder)}".encode()).digest()


def known_survivors() -> dict[str, str]:
    """Return the survivors that a person has judged, by their key, and why no test could find them."""
    found, lines = {}, SURVIVORS.read_text(encoding="utf-8").splitlines()
    lines = [line for line in lines if line.strip() and not line.startswith("#")]
    for key, reason in zip(lines[::2], lines[1::2], strict=True):
        if key.startswith(" ") or not reason.startswith("    "):
            raise SystemExit(
                f"{SURVIVORS.name}: expected a survivor and below it, by four spaces, why: {key}"
            )
        found[key] = reason.strip()
    return found


def say(*words: object) -> None:
    """Print, at once."""
    print(*words, flush=True)  # noqa: T201 - its output


def main() -> int:
    """Try mutants, and list the survivors; return 1 if there are any that nobody has explained."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300, help="how many to try; 0 for all")
    parser.add_argument("--groups", type=int, default=0, help="of so many groups of tests; 0 for all")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(2**32))
    parser.add_argument("--only", default="", help="part of path:line: of what to break")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=float, default=600.0, help="seconds that a mutant may take")
    given = parser.parse_args()
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    os.chdir(ROOT)
    for name in (
        "numpy",
        "scipy.interpolate",
        "scipy.integrate",
        "pinocchio",
        "casadi",
        "sympy",
        "hypothesis",
    ):
        importlib.import_module(name)  # once, before the children are made; p3dof itself comes later
    known = known_survivors()
    path = given.only.partition(".py")[0]
    asked = [module for module in modules() if tests_of(module) and path in module]
    chosen = [mutant for module in asked for mutant in mutants_of(module)]
    chosen = [mutant for mutant in chosen if given.only in f"{mutant.module}:{mutant.line}:"]
    chosen = [mutant for mutant in chosen if keys_of(mutant.module)[mutant.number] not in known]
    total, broken = len(chosen), {mutant.module for mutant in chosen}
    chosen.sort(key=functools.partial(drawn, given.seed))
    if given.groups:  # those of the first mutants
        order = list(dict.fromkeys(tests_of(mutant.module) for mutant in chosen))
        chosen = [mutant for mutant in chosen if tests_of(mutant.module) in order[: given.groups]]
    chosen = chosen[: given.count or None]
    say(f"{len(chosen)} of {total} mutants in {len(broken)} modules; again with: SEED={given.seed}")
    of_tests = {tests_of(mutant.module): mutant.module for mutant in chosen}
    unchanged = [(None, module) for _, module in sorted(of_tests.items(), reverse=True)]
    waiting = [*((mutant, mutant.module) for mutant in chosen), *unchanged]
    children, survivors, late = {}, [], 0
    atexit.register(stop, children)  # however it ends
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    tried, found, spent = Counter(), Counter(), Counter()
    while waiting or children:
        while waiting and len(children) < given.jobs:
            mutant, module = waiting.pop()
            children[start(mutant, module)] = (mutant, time.monotonic(), module)
        mutant, code, seconds, module = wait(children, given.limit)
        if mutant is None:
            say(f"unchanged, {', '.join(tests_of(module))}: {seconds:.1f} s")
            if code:
                say(f"these tests fail as they are (exit code {code})")
                return 2
            continue
        room = room_of(mutant.module)
        tried[room] += 1
        found[room] += code != 0
        late += code == -1
        spent[room] += seconds
        if code == 0:
            survivors.append(mutant)
            say("survived:", f"line {mutant.line},", keys_of(mutant.module)[mutant.number])
        elif tried.total() % 25 == 0:
            say(f"{tried.total()} tried, {len(survivors)} survived")
    for room in sorted(tried):
        say(f"{room}: {found[room]} of {tried[room]} found, {spent[room] / tried[room]:.1f} s each")
    say(f"{tried.total()} tried, {found.total()} found ({late} by their time), {len(survivors)} survived")
    if survivors:
        say(f"test what survived, or give a reason why nothing could find it in {SURVIVORS.name}")
    return int(bool(survivors))


if __name__ == "__main__":
    sys.exit(main())
