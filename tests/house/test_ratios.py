"""The table of whole calls: what its gate fails, passes and tells of made-up ratios; what pages say of it."""

import importlib
import re

import pytest
from documents import ROOT

BENCHMARKS = ROOT / "tests/benchmarks"
LAST = {"a batch": 10.0, "one call": 0.05}


@pytest.fixture
def table(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("table")


def test_a_ratio_that_is_worse_fails_with_one_line(table):
    worse, told = table.compare(LAST, {"a batch": 16.0, "one call": 0.074})
    assert worse == ["a batch: 16, 1.60 times 10, of the last release"]
    assert told == []
    assert len(table.compare(LAST, {"a batch": 15.1, "one call": 0.08})[0]) == 2


def test_better_passes_and_rows_that_come_and_go_are_told(table):
    worse, told = table.compare(LAST, {"a batch": 2.0, "another": 3.0})
    assert worse == []
    assert told == ["one call: no longer measured", "another: 3, not in the last release"]


def test_what_is_worse_is_measured_twice_more(table):
    asked = []

    def again(ratios):
        return lambda name: asked.append(name) or next(ratios)

    assert table.judged(LAST, {"a batch": 16.0, "one call": 0.05}, again(iter([18.0, 17.0])))[0] == [
        "a batch: 16, 1.60 times 10, of the last release"
    ]
    assert asked == ["a batch"] * 2
    asked.clear()
    assert table.judged(LAST, {"a batch": 16.0, "one call": 0.05}, again(iter([14.0])))[0] == []
    assert asked == ["a batch"]


def test_a_row_is_measured_beside_what_it_is_divided_by(table, monkeypatch):
    clock = iter([2.0, 30.0, 4.0, 2.0, 30.0, 4.0])
    monkeypatch.setattr(table, "times_of", lambda _: 1)
    monkeypatch.setattr(table, "seconds", lambda *_: next(clock))
    measured = table.Measured(table.Row("ten samples", print, print, count=10, bares=3))
    measured.turn()
    assert measured.found == table.Found(3.0, 3.0, None, None)
    monkeypatch.setattr(table, "ROUNDS", 1)
    assert measured.again() == 3.0


def test_the_reference_says_where_it_was_made(table):
    for known in table.references():
        assert known["machine"]["processor"]
        assert known["commit"]
        assert known["level"]
        assert len(known["ratios"]) >= 25
        assert all(ratio > 0 for ratio in known["ratios"].values())
    dates = [known["date"] for known in table.references()]
    assert dates == sorted(dates, reverse=True)
    assert "make ratios" in (ROOT / ".ci/run").read_text("utf-8")


def test_the_reference_is_that_of_this_processor_and_level_or_the_largest(table, monkeypatch):
    one = {"level": "avx2", "machine": {"processor": "A"}, "ratios": {"x": 1.0, "y": 4.0}}
    other = {"level": "avx512", "machine": {"processor": "B"}, "ratios": {"x": 3.0, "y": 2.0}}
    monkeypatch.setattr(table, "machine_description", {"processor": "B"}.items)
    assert table.reference_for([one, other], "avx512") is other
    assert table.reference_for([one, other], "avx2")["ratios"] == {"x": 3.0, "y": 4.0}
    assert table.reference_for([], "avx2")["ratios"] == {}


def test_pages_say_what_the_reference_says(table):
    ratios = next(one["ratios"] for one in table.references() if one["level"] == "avx512")  # as pages say
    page = (ROOT / "docs/explanation/speed.md").read_text("utf-8")
    said = dict(re.findall(r"^\| ([^|]+) \| [^|]+ \| ([\d,./]+) \|", page.partition("## Inverse")[0], re.M))
    assert len(said) >= 20
    readme = (ROOT / "README.md").read_text("utf-8")
    (line,) = re.findall(r": ([\d.]+), ([\d.]+) and ([\d/]+) of a bare `pin.rnea` call", readme)
    rows = (
        "inverse_dynamics, 1,001",
        "inverse_dynamics, virtual power, 1,001",
        "inverse_dynamics, compiled, 1,000,000",
    )
    for name, text in [*said.items(), *zip(rows, line, strict=True)]:
        over, _, under = text.replace(",", "").partition("/")
        assert float(over) / float(under or 1) == pytest.approx(ratios[name], rel=0.3), name
