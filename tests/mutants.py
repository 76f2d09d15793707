"""Break the sources on purpose, one place at a time, and tell which breakages no test notices.

    make mutants                        # a sample of 300
    make mutants COUNT=0                # all of them: hours
    make mutants ONLY=paper SEED=7      # a sample of the modules whose path holds this word
    make mutants ONLY=reference.py:36:  # what is changed in one line

Each mutant is one changed operator, sign, comparison, number, function or returned array in one of the
modules below. A child process imports the mutated module and runs the module's tests until the first fails.
Messages, indices and annotations stay. A survivor is a line for a person to judge: it may be equivalent.
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib.abc
import importlib.util
import os
import random
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
SHARED = ("evidence", "thresholds", "manipulator", "virtual_power", "friction", "kinematics", "minimal")
CLOSED = ("evidence", "thresholds", "closed_loop", "closed_loop_assembly", "manipulator", "closed_loop_batch")
LOOPS = ("loop_minimal", "loop_derivatives", "loop_identification", "loop_margins")
FILES = ("mjcf_traits", "write_mjcf", "write_sdf")
RUNS = ("evidence", "thresholds", "control")
TESTS = {
    "p3dof/algebra.py": SHARED,
    "p3dof/paper/formulas.py": SHARED,
    "p3dof/paper/friction.py": SHARED,
    "p3dof/paper/inertials.py": SHARED,
    "p3dof/paper/recursion.py": SHARED,
    "p3dof/paper/virtual_power.py": SHARED,
    "p3dof/kinematics/bodies.py": SHARED,
    "p3dof/kinematics/forward.py": SHARED,
    "p3dof/kinematics/inverse.py": SHARED,
    "p3dof/kinematics/gate.py": (*SHARED, "gate"),
    "p3dof/kinematics/validity.py": (*SHARED, "gate"),
    "p3dof/methods/equations_of_motion.py": SHARED,
    "p3dof/methods/evidence.py": SHARED,
    "p3dof/methods/closed_form.py": SHARED,
    "p3dof/methods/pinocchio.py": (*SHARED, "gate", "methods"),
    "p3dof/methods/pinocchio_friction.py": SHARED,
    "p3dof/methods/exceedances.py": SHARED,
    "p3dof/methods/results.py": (*SHARED, "utilisation"),
    "p3dof/methods/virtual_power.py": (*SHARED, "gate"),
    "p3dof/motion/states.py": ("states", "wrenches", *SHARED),
    "p3dof/motion/wrenches.py": ("wrenches", "motion"),
    "p3dof/closed_loop/closures.py": CLOSED,
    "p3dof/closed_loop/forward.py": CLOSED,
    "p3dof/closed_loop/inverse.py": CLOSED,
    "p3dof/closed_loop/partitions.py": (*CLOSED, "hybrid_dynamics"),
    "p3dof/closed_loop/terms.py": (*CLOSED, "hybrid_dynamics"),
    "p3dof/closed_loop/energy.py": CLOSED,
    "p3dof/closed_loop/hybrid.py": ("hybrid_dynamics",),
    "p3dof/closed_loop/formats/mjcf_tendons.py": FILES,
    "p3dof/closed_loop/writers/bodies.py": FILES,
    "p3dof/closed_loop/writers/chains.py": FILES,
    "p3dof/closed_loop/writers/mjcf.py": FILES,
    "p3dof/closed_loop/writers/mjcf_loops.py": FILES,
    "p3dof/closed_loop/writers/mjcf_tendons.py": FILES,
    "p3dof/closed_loop/writers/sdf.py": FILES,
    "p3dof/closed_loop/batch/hybrid.py": ("hybrid_dynamics",),
    "p3dof/closed_loop/compiled/tree.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/dynamics.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/loops.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/couplings.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/passive.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/pivots.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/formulas.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/functions.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/function.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/limits.py": ("compiled_loops",),
    "p3dof/closed_loop/compiled/rates.py": ("compiled_loops",),
    "p3dof/closed_loop/tree_tangents.py": LOOPS,
    "p3dof/closed_loop/closure_tangents.py": LOOPS,
    "p3dof/closed_loop/coupling_tangents.py": LOOPS,
    "p3dof/closed_loop/independent.py": LOOPS,
    "p3dof/closed_loop/simple_joints.py": LOOPS,
    "p3dof/closed_loop/linearised.py": LOOPS,
    "p3dof/closed_loop/minimal.py": LOOPS,
    "p3dof/closed_loop/minimal_model.py": LOOPS,
    "p3dof/closed_loop/derivatives_model.py": LOOPS,
    "p3dof/closed_loop/regressor.py": ("loop_identification",),
    "p3dof/closed_loop/base_parameters.py": ("loop_identification", "loop_margins"),
    "p3dof/closed_loop/margins.py": ("loop_margins",),
    "p3dof/closed_loop/margins_model.py": ("loop_margins",),
    "p3dof/closed_loop/modes.py": ("assembly_far",),
    "p3dof/closed_loop/trust.py": ("assembly_far",),
    "p3dof/closed_loop/linear.py": CLOSED,
    "p3dof/closed_loop/configuration_rates.py": ("any_robot",),
    "p3dof/closed_loop/reaction_algebra.py": ("any_robot", "reactions", "closure_kinds"),
    "p3dof/closed_loop/reactions_batch.py": ("any_robot", "reactions"),
    "p3dof/closed_loop/batch/energy.py": ("any_robot",),
    "p3dof/closed_loop/batch/dynamics.py": ("evidence", "closed_loop_batch", "manipulator"),
    "p3dof/closed_loop/batch/kinematics.py": (
        "evidence",
        "closed_loop_batch",
        "manipulator",
        "closure_kinds",
    ),
    "p3dof/simulation/controllers.py": RUNS,
    "p3dof/simulation/machine_plants.py": RUNS,
    "p3dof/simulation/plants.py": ("any_robot", *RUNS),
    "p3dof/simulation/reference.py": RUNS,
}
"""Which tests look after which module, the quick ones first."""

SLOW = (
    "hundreds_of_times",
    "wrong_mass_costs",
    "cut_off_forces",
    "takes_away",
    "wind_up",
    "equal_seeds",
    "again",
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


def replacements(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield what to put in the place of a node, with words for it."""
    new = copy.deepcopy(node)
    if isinstance(new, ast.BinOp) and type(new.op) in OPERATORS:
        new.op = OPERATORS[type(new.op)]()
        yield "operator", new
    elif isinstance(new, ast.Compare) and type(new.ops[0]) in COMPARISONS:
        new.ops[0] = COMPARISONS[type(new.ops[0])]()
        yield "comparison", new
    elif isinstance(new, ast.UnaryOp) and isinstance(new.op, ast.USub | ast.Not | ast.Invert):
        yield "sign", new.operand
    elif isinstance(new, ast.Constant) and type(new.value) in {int, float}:
        new.value = new.value + 1 if isinstance(new.value, int) else 1.01 * new.value or 0.01
        yield "number", new
    elif isinstance(new, ast.Attribute) and new.attr in NAMES:
        new.attr = NAMES[new.attr]
        yield "function", new
    elif isinstance(new, ast.Return | ast.keyword) and isinstance(new.value, VALUES):
        new.value = ast.BinOp(ast.Constant(0), ast.Mult(), new.value)
        yield "zeroed", new


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


def run_tests(mutant: Mutant | None, module: str) -> int:
    """Run a module's tests in this process, until one fails; return pytest's exit code."""
    import pytest

    if mutant is not None:
        sys.meta_path.insert(0, Loader(mutant))
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    files = [str(ROOT / "tests" / f"test_{name}.py") for name in dict.fromkeys(TESTS[module])]
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
    return int(pytest.main([*options, "-m", "not fuzz", *files], plugins=[FewExamples()]))


def start(mutant: Mutant | None, module: str) -> int:
    """Start a child process for a mutant; return its number."""
    child = os.fork()
    if child:
        return child
    os.setpgid(0, 0)
    try:
        os._exit(run_tests(mutant, module))
    except BaseException:  # pytest itself: also a mutant that is found
        traceback.print_exc()
        os._exit(3)


def wait(children: dict[int, tuple[Mutant | None, float]], limit: float) -> tuple[Mutant | None, int, float]:
    """Wait for one child; return its mutant, exit code (-1: out of time) and seconds."""
    while True:
        now = time.monotonic()
        for child, (mutant, began) in list(children.items()):
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                del children[child]
                return mutant, os.waitstatus_to_exitcode(status), now - began
            if now - began > limit:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                del children[child]
                return mutant, -1, now - began
        time.sleep(0.05)


def line_of(mutant: Mutant) -> str:
    """Return the place of a mutant, with the changed line in words that Python reads."""
    old = (ROOT / mutant.module).read_text(encoding="utf-8").splitlines()[mutant.line - 1].strip()
    tree = ast.parse((ROOT / mutant.module).read_text(encoding="utf-8"))
    new = next(ast.unparse(change[3]) for n, change in enumerate(changes(tree)) if n == mutant.number)
    return f"{mutant.module}:{mutant.line}: {mutant.words}: {old}  ->  {new}"


def say(*words: object) -> None:
    """Print, at once."""
    print(*words, flush=True)  # noqa: T201 - its output


def main() -> int:
    """Try mutants, and list the survivors; return 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300, help="how many to try; 0 for all")
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
    everywhere = [mutant for module in TESTS for mutant in mutants_of(module)]
    chosen = [mutant for mutant in everywhere if given.only in f"{mutant.module}:{mutant.line}:"]
    total, modules = len(chosen), {mutant.module for mutant in chosen}
    random.Random(given.seed).shuffle(chosen)  # noqa: S311 - no secret
    chosen = chosen[: given.count or None]
    say(
        f"{len(chosen)} of {total} mutants in {len(modules)} modules; again with: SEED={given.seed}",
    )
    for tests in sorted({TESTS[mutant.module] for mutant in chosen}):
        module = next(module for module in TESTS if TESTS[module] == tests)
        _, code, seconds = wait({start(None, module): (None, time.monotonic())}, given.limit)
        say(f"unchanged, {', '.join(tests)}: {seconds:.0f} s")
        if code:
            say(f"these tests fail as they are (exit code {code})")
            return 2
    children, survivors, late, tried = {}, [], 0, 0
    while chosen or children:
        while chosen and len(children) < given.jobs:
            mutant = chosen.pop()
            children[start(mutant, mutant.module)] = (mutant, time.monotonic())
        mutant, code, _ = wait(children, given.limit)
        tried, late = tried + 1, late + (code == -1)
        if code == 0:
            survivors.append(mutant)
            say("survived:", line_of(mutant))
        elif tried % 25 == 0:
            say(f"{tried} tried, {len(survivors)} survived")
    say(f"{tried} tried, {tried - len(survivors)} found ({late} by their time), {len(survivors)} survived")
    return int(bool(survivors))


if __name__ == "__main__":
    sys.exit(main())
