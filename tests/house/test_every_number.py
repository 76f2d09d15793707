"""No number is shown, and no error reported, without a test that compares it with a reference of its own."""

import ast
import functools
import re

import numpy as np
import pytest
import table_numbers
from documents import ROOT
from table_numbers import check_evidence, check_table, numbers_in

from p3dof._base.tables import NONE, percent, table_of

_ERRORS = re.compile(r"(^|_)(residual|error|gap|difference)s?$")


@functools.cache
def sources():
    """Return the trees of all modules that may have tables or errors, by their dotted names."""
    found = {}
    for path in sorted((ROOT / "p3dof").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "p3dof._base.tables" in text or re.search(r"(residual|error|gap|difference)s?(: |\(self\))", text):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            found[name] = ast.parse(text)
    return found


def functions_of(tree):
    """Yield the functions of a module and the methods of its classes, with their names inside of it."""
    for node in tree.body:
        members = node.body if isinstance(node, ast.ClassDef) else [node]
        prefix = f"{node.name}." if isinstance(node, ast.ClassDef) else ""
        yield from ((prefix + n.name, n) for n in members if isinstance(n, ast.FunctionDef))


def makers_of_tables(modules):
    """Return the names of functions that are said to return tables, or that make one inside."""
    found = set()
    for module, tree in modules.items():
        imported = [
            n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module == "p3dof._base.tables"
        ]
        names = {alias.name for node in imported for alias in node.names} & {"Table", "table_of"}
        if not names:
            continue
        for name, node in functions_of(tree):
            said = ast.walk(node.returns) if node.returns else ()
            calls = [n.func for n in ast.walk(node) if isinstance(n, ast.Call)]
            if any(isinstance(n, ast.Name) and n.id in names for n in (*said, *calls)):
                found.add(f"{module}.{name}")
    return found


def fields_of_errors(modules):
    """Return the fields and properties of public classes, or their private bases, that hold errors."""
    found = set()
    for module, tree in modules.items():
        classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}

        def body_of(node, classes=classes):
            own = [base.id for base in node.bases if isinstance(base, ast.Name) and base.id[:1] == "_"]
            return [*node.body, *(n for name in own if name in classes for n in body_of(classes[name]))]

        for node in classes.values():
            if node.name.startswith("_"):
                continue
            for n in body_of(node):
                name, said = "", None
                if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name):
                    name, said = n.target.id, n.annotation
                elif isinstance(n, ast.FunctionDef) and "property" in "".join(
                    map(ast.unparse, n.decorator_list)
                ):
                    name, said = n.name, n.returns
                if _ERRORS.search(name) and re.search(r"\b(float|FloatArray)\b", ast.unparse(said)):
                    found.add(f"{module}.{node.name}.{name}")
    return found


def claims():
    """Return the names that tests claim by `@shows("...")`."""
    found = set()
    for path in (ROOT / "tests").rglob("test_*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "@shows(" in text else ():
            for mark in getattr(node, "decorator_list", ()):
                if isinstance(mark, ast.Call) and ast.unparse(mark.func) == "shows":
                    found.update(ast.literal_eval(name) for name in mark.args)
    return found


def test_every_table_and_every_error_is_claimed_by_a_test():
    shown = makers_of_tables(sources()) | fields_of_errors(sources())
    assert {
        "p3dof.design.drives.tables.axes_table",
        "p3dof.analysis.reactions.results.Reactions.residual",
    } <= shown
    claimed = claims()
    assert claimed <= shown, "claimed, but not there"
    assert shown <= claimed, "no test claims it by @shows(...)"


def test_makers_of_tables_and_fields_of_errors_are_found():
    source = """
from p3dof._base.tables import Table, table_of
class _Base:
    base_residual: float
class Result(_Base):
    gap: float
    closure_errors: FloatArray
    errors: dict[int, P3dofError]
    @property
    def residual(self) -> FloatArray: ...
    def tables(self) -> list[Table]: ...
def private() -> Table | None: ...
def inside(console): show(console, table_of("A", (), {}))
def other() -> rich.table.Table: ...
"""
    modules = {"room.module": ast.parse(source), "room.rich": ast.parse("def f() -> Table: ...")}
    names = {"Result.tables", "private", "inside"}
    assert makers_of_tables(modules) == {f"room.module.{name}" for name in names}
    names = {"gap", "closure_errors", "residual", "base_residual"}
    assert fields_of_errors(modules) == {f"room.module.Result.{name}" for name in names}


def test_numbers_of_texts_are_found_with_their_digits():
    assert numbers_in("12.3 % at -0.41 s of 5,000 rpm, 1e-07, A₃ leg2 1.25e+3 M12") == [
        (pytest.approx(0.123), pytest.approx(0.0005)),
        (-0.41, pytest.approx(0.005)),
        (5000.0, 0.5),
        (1e-7, pytest.approx(0.5e-7)),
        (1250.0, pytest.approx(5.0)),
    ]
    assert [value for value, _ in numbers_in("3 to 4, 1-2 (5) m^2 6s 7.")] == [3, 4, 1, 2, 5, 6, 7]
    assert [value for value, _ in numbers_in("−5 m/s² and .5 for 0.")] == [-5, 0.5, 0]


ROWS = {"A": (1 / 3, "12.3 % at 0.41 s", "2 of 3"), "B": (float("nan"), NONE, "open")}
RIGHT = {"A": (0.333333, (0.1232, 0.412), (2, "of", 3)), "B": (float("nan"), float("nan"), "open")}


def of_rows(rows=ROWS, note="7 kg move"):
    return table_of("Title", ("", "force [N]", "peak", "count"), rows, note)


def test_a_table_fits_its_references():
    check_table(of_rows(), RIGHT, note=[7.2])
    check_table(of_rows(), [(name, *cells) for name, cells in RIGHT.items()], note=(6.9, "kg"))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"A": (0.33334, (0.1232, 0.412), (2, 3))}, "force"),
        ({"A": (0.333333, (0.1236, 0.412), (2, 3))}, "peak"),
        ({"A": (0.333333, (0.1232,), (2, 3))}, "peak"),  # a number without a reference
        ({"A": (0.333333, (0.1232, 0.416), (2, 3))}, "peak"),
        ({"A": (0.333333, (0.1232, 0.412), (2, "in", 3))}, "count"),
        ({"A": (0.333333, (0.1232, 0.412))}, "cells"),
        ({"A": ("0.333333", (0.1232, 0.412), (2, 3))}, "force"),
        ({"B": (float("nan"), 0.0, "open")}, "peak"),
        ({"B": (float("nan"), float("nan"), "shut")}, "count"),
        ({"B": (0.0, float("nan"), "open")}, "force"),
        ({"C": ()}, "rows"),
    ],
)
def test_a_number_that_differs_or_has_no_reference_is_named(wrong, words):
    with pytest.raises(AssertionError, match=words):
        check_table(of_rows(), RIGHT | wrong, note=[7])


def test_numbers_of_notes_need_references_too():
    with pytest.raises(AssertionError, match="note"):
        check_table(of_rows(), RIGHT)
    with pytest.raises(AssertionError, match="note"):
        check_table(of_rows(note="9 kg move"), RIGHT, note=[7])


class Result:
    def __init__(self, residual):
        self.residual = residual


def test_an_error_that_is_zeroed_does_not_fit():
    check_evidence(Result(np.array([0.0, 0.3])), "residual", [0.0, 0.3])
    with pytest.raises(AssertionError, match="residual"):
        check_evidence(Result(np.zeros(2)), "residual", [0.0, 0.3])
    with pytest.raises(AssertionError, match="no error was put in"):
        check_evidence(Result(np.zeros(2)), "residual", [0.0, 1e-9], atol=1e-9)
    with pytest.raises(AssertionError, match="no error was put in"):
        check_evidence(Result(np.zeros(2)), "residual", [0.0, 0.0])


def test_claims_are_held_against_what_was_compared():
    names = ["p3dof._base.tables.percent", "p3dof._base.tables.table_of", f"{__name__}.of_rows"]
    field = f"{__name__}.Result.residual"
    table_numbers.begin()
    assert percent(0.1)
    table = of_rows()
    assert table_numbers.not_compared([*names, field]) == [*names, field]
    check_table(table, RIGHT, note=[7])
    check_evidence(Result(1.0), "residual", 1.0)
    assert table_numbers.not_compared([*names, field]) == names[:1]


@pytest.mark.xfail(strict=True, reason="what it claims it did not compare", raises=AssertionError)
@pytest.mark.shows("p3dof._base.tables.table_of")
def test_a_claim_that_is_false_fails_its_test():
    assert of_rows() == of_rows()
