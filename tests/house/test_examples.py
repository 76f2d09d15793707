"""Every public function and class has an example on its page of the API, and it shows what it says."""

import doctest
import inspect
import re
import shutil

import api_examples
import pytest
from documents import ROOT

from p3dof.viewer import headless

EXAMPLES = api_examples.examples()
PUBLIC = api_examples.public()
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
WIDEST = 100
"""Of a line that fits into its box on a page at 1280 px [characters]."""
LONGEST = 16
"""Of an example [lines of code]."""


def named(example):
    return example.names[0]


def need(example):
    """Skip an example whose libraries, or whose browser, are not here."""
    for library in example.needs:
        pytest.importorskip(library, reason=f"{library} not installed")
    if "playwright" in example.needs and not any(map(shutil.which, headless.NAMES)):
        pytest.skip("Chromium not installed")


@pytest.mark.parametrize("example", EXAMPLES, ids=named)
def test_an_example_runs_and_shows_what_it_says(example, tmp_path, monkeypatch):
    need(example)
    gallery = ROOT / "docs/_static/gallery"
    shutil.copytree(gallery, tmp_path / "gallery", ignore=shutil.ignore_patterns("*.png"))
    monkeypatch.chdir(tmp_path)
    parser, told = doctest.DocTestParser(), []
    test = parser.get_doctest(example.text, {}, named(example), str(example.file), 0)
    assert test.examples[-1].want or any(one.want for one in test.examples), "it shows nothing"
    doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=told.append, clear_globs=False)
    assert told == [], "".join(told)
    there = list(parts(test.globs.values()))
    for name in example.names:
        assert is_in(name, example.text, there), f"{name} is not in its example"


def parts(values):
    """Yield values, and what is in those that are collections."""
    for value in values:
        yield value
        if isinstance(value, tuple | list | dict):
            yield from parts(value.values() if isinstance(value, dict) else value)


def is_in(name, text, values):
    """Whether an example names it, or has an object of this class."""
    word, kind = name.rpartition(".")[2], PUBLIC[name]
    if re.search(rf"\b{word}\b", text):
        return True
    return inspect.isclass(kind) and any(isinstance(value, kind) for value in values)


def test_every_public_function_and_class_has_one_example():
    shown = [name for example in EXAMPLES for name in example.names]
    assert sorted(shown) == sorted(PUBLIC)
    assert len(PUBLIC) > 450


def test_examples_are_in_one_place_only():
    """Docstrings have none of their own, which would stand beside these on the page, and nobody would run."""
    assert [name for name, what in PUBLIC.items() if ">>> " in (inspect.getdoc(what) or "")] == []


def test_examples_are_short_and_fit_into_their_boxes():
    for example in EXAMPLES:
        lines = example.text.splitlines()
        code = [line for line in lines if line.startswith((">>> ", "... "))]
        assert len(code) <= LONGEST, named(example)
        assert [line for line in lines if len(line) > WIDEST] == [], named(example)


def test_a_file_of_examples_begins_with_names(tmp_path, monkeypatch):
    (tmp_path / "odd.txt").write_text(">>> 1 + 1\n2\n", encoding="utf-8")
    monkeypatch.setattr(api_examples, "FOLDER", tmp_path)
    with pytest.raises(ValueError, match=r"odd\.txt: expected '# names' in the first line, got '>>> 1"):
        api_examples.examples.__wrapped__()
