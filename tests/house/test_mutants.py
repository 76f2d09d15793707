"""The table of mutants knows every module with numbers, and survivors without a reason fail."""

import ast
from pathlib import Path

import mutants
import pytest
from documents import ROOT

MODULES = mutants.modules()


def breakable(module):
    return next(mutants.changes(ast.parse((ROOT / module).read_text("utf-8"))), None) is not None


def test_every_module_that_computes_is_broken_on_purpose_or_named_with_a_reason():
    unknown = [
        module
        for module in MODULES
        if not mutants.tests_of(module)
        and not mutants.longest(module, mutants.EXCEPTIONS)
        and breakable(module)
    ]
    assert unknown == [], "name their tests in TESTS, or a reason in EXCEPTIONS"


def test_the_tables_name_what_there_is():
    used = {
        mutants.longest(module, table) for table in (mutants.TESTS, mutants.EXCEPTIONS) for module in MODULES
    }
    assert {*mutants.TESTS, *mutants.EXCEPTIONS} <= used, "no module begins like that"
    for names in mutants.TESTS.values():
        for name in names:
            path, _, test = mutants.file_of(name).partition("::")
            text = Path(path).read_text("utf-8")  # fails where there is none
            assert f"def {test}(" in text or not test, name


def test_the_longest_beginning_counts(monkeypatch):
    monkeypatch.setattr(
        mutants, "TESTS", {"p3dof/a/": ("one",), "p3dof/a/b.py": ("two",), "p3dof/c/d.py": ("three",)}
    )
    monkeypatch.setattr(mutants, "EXCEPTIONS", {"p3dof/c/": "words", "p3dof/a/x.py": "none"})
    assert mutants.tests_of("p3dof/a/a.py") == ("one",)
    assert mutants.tests_of("p3dof/a/b.py") == ("two",)
    assert mutants.tests_of("p3dof/a/x.py") == mutants.tests_of("p3dof/c/e.py") == ()
    assert mutants.tests_of("p3dof/c/d.py") == ("three",)
    assert mutants.tests_of("p3dof/z.py") == ()


def test_survivors_that_are_explained_are_still_there():
    for key, reason in mutants.known_survivors().items():
        module = key.partition(":")[0]
        assert module in MODULES, key
        assert key in mutants.keys_of(module), f"its line has changed, take it off: {key}"
        assert len(reason) > 15, key


@pytest.fixture
def survivors(tmp_path, monkeypatch):
    """A list of survivors of the test's own, and runs of tests that notice what a test says, or nothing."""
    path = tmp_path / "survivors.txt"
    path.write_text("# none\n")
    monkeypatch.setattr(mutants, "SURVIVORS", path)
    monkeypatch.setattr(mutants, "say", lambda *_: None)
    running, noticed = [], set()

    def start(mutant, module):
        running.append((mutant, module))
        return len(running)

    def wait(children, limit):
        child, (mutant, _, module) = children.popitem()
        code = mutant is not None and mutants.keys_of(module)[mutant.number] in noticed
        return mutant, int(code), 0.0 * child * limit, module

    monkeypatch.setattr(mutants, "start", start)
    monkeypatch.setattr(mutants, "wait", wait)
    return path, noticed


def try_all(monkeypatch, only):
    monkeypatch.setattr("sys.argv", ["mutants.py", "--count", "0", "--only", only])
    return mutants.main()


def test_a_survivor_fails_unless_it_is_explained(survivors, monkeypatch):
    path, noticed = survivors
    module = "p3dof/_base/integrators/__init__.py"
    keys = set(mutants.keys_of(module))
    assert try_all(monkeypatch, module) == 1
    noticed.update(keys)
    assert try_all(monkeypatch, module) == 0
    one = noticed.pop()
    assert try_all(monkeypatch, module) == 1
    path.write_text(f"{one}\n    It is the same number in other words.\n")
    assert try_all(monkeypatch, module) == 0
    for broken in (f"{one}\n", f"{one}\nno reason\n", f"    a reason\n{one}\n"):
        path.write_text(broken)
        with pytest.raises((SystemExit, ValueError)):
            mutants.known_survivors()


def test_keys_stay_when_lines_move():
    module = "p3dof/methods/utilisation.py"
    keys, places = mutants.keys_of(module), mutants.mutants_of(module)
    assert len(keys) == len(places) > 20
    assert all(key.startswith(f"{module}: ") for key in keys)
    assert any("np.where(values < 0, *ends)  ->  values >= 0" in key for key in keys)
