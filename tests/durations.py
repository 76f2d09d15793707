"""Processor time of the tests: `make quick` runs as many of the shortest as its budget allows.

``durations.txt`` has a row for each file, with the time of all its tests, and below it the tests that take
longest. ``pytest --measure`` writes the rows of the files that it runs; `test_house.py` demands that every
file has one.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

TABLE = Path(__file__).with_name("durations.txt")
BUDGET = 30.0
"""Processor time of all quick tests together [s]."""
LONGEST = 0.6
"""Processor time of one test, all its cases together, that `make test` runs at most [s]."""
KEPT = 0.1
"""Tests of less have no row of their own [s]."""
LONG = ("tests/interop/",)
"""Nothing in these is quick."""
HEAD = f"# Processor time [s] of files, and of their tests over {KEPT} s; written by pytest --measure."


def name_of(nodeid: str) -> str:
    """Return a test's name without its parameters."""
    return nodeid.partition("[")[0]


def file_of(name: str) -> str:
    """Return the file of a test."""
    return name.partition("::")[0]


def read() -> dict[str, float]:
    """Return the processor time of files and of their longer tests, by name [s]."""
    found, file = {}, ""
    for line in TABLE.read_text(encoding="utf-8").splitlines():
        if line[:1] != "#":
            name, seconds = line.split()
            file = file if line[:1] == " " else name
            found[f"{file}::{name}" if line[:1] == " " else file] = float(seconds)
    return found


def write(times: Mapping[str, float]) -> None:
    """Write the table: files by name, the tests of each from the longest."""
    lines = [HEAD]
    for file in sorted(name for name in times if "::" not in name):
        lines.append(f"{file} {times[file]:.2f}")
        tests = sorted((-times[name], name) for name in times if name.startswith(f"{file}::"))
        lines += [f"    {name.partition('::')[2]} {-less:.2f}" for less, name in tests if -less >= KEPT]
    TABLE.write_text("\n".join([*lines, ""]), encoding="utf-8")


def longest_first() -> Callable[[pytest.Item], float]:
    """Return the key that sorts tests by their files: at the end no worker waits for a long one."""
    times = read()
    return lambda item: -times.get(file_of(item.nodeid), 0.0)


def slow(times: Mapping[str, float], budget: float) -> set[str]:
    """Return what the budget has no room for: tests with rows, the longest first, then the longest rests."""
    times = {name: seconds for name, seconds in times.items() if not name.startswith(LONG)}
    parts = dict(times)
    for name, seconds in times.items():
        if "::" in name:
            parts[file_of(name)] -= seconds
    left, found = budget, set()
    for name in sorted(parts, key=lambda name: ("::" in name, parts[name])):
        left -= max(parts[name], 0.0)  # may be below zero: what tests share counts for each of them
        if left < 0:
            found.add(name)
    return found


def mark_long(items: Iterable[pytest.Item]) -> None:
    """Mark tests of more than `LONGEST`; of one with cases, those that do not fit in, but never all."""
    times, cases = read(), Counter(name_of(item.nodeid) for item in items)
    run = dict.fromkeys(cases, 0)
    for item in items:
        name = name_of(item.nodeid)
        fit = int(cases[name] * LONGEST / max(times.get(name, 0.0), 1e-9))
        if run[name] >= max(fit, int(cases[name] > 1)):
            item.add_marker("long")
        run[name] += 1


class Measuring:
    """Adds up the processor time of every test, and of the processes that it starts.

    What a fixture that several tests share takes counts for each of them: without the first, the next one
    would have to wait for it. In a file's time it counts once.
    """

    def __init__(self) -> None:
        self.tests: dict[str, float] = {}
        self.fixtures: dict[str, float] = {}
        self.waits: dict[str, float] = {}
        self.skipped: set[str] = set()
        self._shared = 0.0  # time of shared fixtures within the test that runs
        if sys.platform == "linux":  # adopt a browser's processes, which outlive their parent
            ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[object], request: pytest.FixtureRequest
    ) -> Iterator[None]:
        begin, nested = processor_time(), self._shared
        result = yield
        if fixturedef.scope != "function":
            seconds = processor_time() - begin - (self._shared - nested)
            of = request.node.nodeid if fixturedef.scope == "module" else fixturedef.baseid
            key = f"{of}::{fixturedef.argname}"
            self.fixtures[key] = self.fixtures.get(key, 0.0) + seconds
            self._shared += seconds
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        begin, self._shared = processor_time(), 0.0
        result = yield
        name = name_of(item.nodeid)
        self.tests[name] = self.tests.get(name, 0.0) + processor_time() - begin - self._shared
        return result

    def pytest_deselected(self, items: list[pytest.Item]) -> None:
        """Give long random searches no time, and a file of nothing else a row."""
        for item in items:
            self.tests.setdefault(name_of(item.nodeid), 0.0)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.skipped:
            self.skipped.add(name_of(report.nodeid))

    def pytest_testnodedown(self, node: Any) -> None:
        """Add what a worker of ``-n`` has measured."""
        mine = (self.tests, self.waits, self.fixtures)
        for kept, measured in zip(mine, node.workeroutput["durations"], strict=True):
            for name, seconds in measured.items():
                kept[name] = kept.get(name, 0.0) + seconds

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Write the table: what ran, and what is known of other files and of tests that were skipped."""
        for item in session.items if hasattr(session, "items") else ():
            if name_of(item.nodeid) in self.tests:
                self.waits[name_of(item.nodeid)] = self._waits(item)
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["durations"] = (self.tests, self.waits, self.fixtures)
            return
        known = read()
        for name in self.skipped & set(known):
            self.tests[name] = max(self.tests.get(name, 0.0), known[name])
        times = {name: seconds for name, seconds in self.tests.items() if name.startswith("tests/")}
        files = {file_of(name) for name in times}
        for table in (times, self.fixtures):
            for name in [name for name in table if file_of(name) in files and "::" in name]:
                times[file_of(name)] = times.get(file_of(name), 0.0) + table[name]
        for name in self.waits.keys() & times.keys():
            times[name] += self.waits[name]
        others = {
            name: seconds
            for name, seconds in known.items()
            if file_of(name) not in files and (TABLE.parents[1] / file_of(name)).exists()
        }
        write({**others, **times})

    def _waits(self, item: pytest.Item) -> float:
        """Return the time of the shared fixtures that a test uses."""
        names = getattr(item, "fixturenames", ())
        own = (key for key in self.fixtures if item.nodeid.startswith(key.rpartition("::")[0]))
        return sum(self.fixtures[key] for key in own if key.rpartition("::")[2] in names)


def processor_time() -> float:
    """Return the processor time of this process and of those that it has waited for [s]."""
    _wait_for_orphans()
    return sum(os.times()[:4])


def _wait_for_orphans() -> None:
    """Wait for what has ended of a browser's processes: nobody else does."""
    for process in Path("/proc").iterdir() if "playwright" in sys.modules else ():
        with contextlib.suppress(OSError):
            pid, rest = (process / "stat").read_text().split(" (", 1)
            name, _, fields = rest.rpartition(") ")
            state, parent = fields.split()[:2]
            if (state, parent) == ("Z", str(os.getpid())) and ("chrom" in name or "headless" in name):
                os.waitpid(int(pid), 0)


def not_quick(config: pytest.Config) -> Callable[[str], bool]:
    """Return whether a test, or all of a file, is not quick."""
    times = read()
    long = slow(times, config.getoption("--budget"))
    some = {file_of(name) for name in times.keys() - long if "::" in name and not name.startswith(LONG)}

    def leaves_out(name: str) -> bool:
        if name.startswith(LONG) or name in long:
            return name not in some
        return "::" in name and name not in times and file_of(name) in long

    return leaves_out


def deselect_slow(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests that are not quick."""
    leaves_out = not_quick(config)
    left_out = {item for item in items if leaves_out(name_of(item.nodeid))}
    config.hook.pytest_deselected(items=list(left_out))
    items[:] = [item for item in items if item not in left_out]
