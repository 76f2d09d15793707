"""Which tests are quick: `make quick` leaves out those whose processor time, in the table beside, is long.

``pytest --measure`` rewrites the table. What is not in it counts as quick: a new test, or one of hardly any
time.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

TABLE = Path(__file__).with_name("durations.txt")
QUICK = 0.3
"""Most processor time that a quick test may take, over all its parameters [s]."""
KEPT = 0.1
"""Shorter times are not written down [s]."""


def name_of(nodeid: str) -> str:
    """Return a test's name without its parameters."""
    return nodeid.partition("[")[0]


def read() -> dict[str, float]:
    """Return the processor time of tests by name [s]."""
    rows = (line.split() for line in TABLE.read_text(encoding="utf-8").splitlines() if line[:1] != "#")
    return {name: float(seconds) for seconds, name in rows}


class Measuring:
    """Adds up the processor time of every test, and of the processes that it starts.

    What a fixture that several tests share takes counts for each of them: without the first, the next one
    would have to wait for it.
    """

    def __init__(self) -> None:
        self.tests: dict[str, float] = {}
        self.fixtures: dict[str, float] = {}
        self.waits: dict[str, float] = {}
        self._shared = 0.0  # time of shared fixtures within the test that runs

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object]) -> Iterator[None]:
        begin, nested = processor_time(), self._shared
        result = yield
        if fixturedef.scope != "function":
            seconds = processor_time() - begin - (self._shared - nested)
            key = f"{fixturedef.baseid}::{fixturedef.argname}"
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

    def pytest_testnodedown(self, node: Any) -> None:
        """Add what a worker of ``-n`` has measured."""
        for kept, measured in zip((self.tests, self.waits), node.workeroutput["durations"], strict=True):
            for name, seconds in measured.items():
                kept[name] = kept.get(name, 0.0) + seconds

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Write the table: the tests that ran, and the times that are known of those in other files."""
        for item in session.items if hasattr(session, "items") else ():
            if name_of(item.nodeid) in self.tests:
                self.waits[name_of(item.nodeid)] = self._waits(item)
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["durations"] = (self.tests, self.waits)
            return
        measured = {name: seconds + self.waits.get(name, 0.0) for name, seconds in self.tests.items()}
        files = {name.partition("::")[0] for name in measured}
        others = {name: seconds for name, seconds in read().items() if is_elsewhere(name, files)}
        rows = sorted((seconds, name) for name, seconds in {**others, **measured}.items() if seconds >= KEPT)
        lines = [f"{seconds:.1f} {name}" for seconds, name in reversed(rows)]
        head = f"# Processor time [s] of tests over {KEPT} s; written by pytest --measure."
        TABLE.write_text("\n".join([head, *lines, ""]), encoding="utf-8")

    def _waits(self, item: pytest.Item) -> float:
        """Return the time of the shared fixtures that a test uses."""
        names = getattr(item, "fixturenames", ())
        own = (key for key in self.fixtures if item.nodeid.startswith(key.rpartition("::")[0]))
        return sum(self.fixtures[key] for key in own if key.rpartition("::")[2] in names)


def is_elsewhere(name: str, files: set[str]) -> bool:
    """Return whether a test is in a file that is there and not among some."""
    file = name.partition("::")[0]
    return file not in files and (TABLE.parents[1] / file).exists()


def processor_time() -> float:
    """Return the processor time of this process and of those that it has waited for [s]."""
    return sum(os.times()[:4])


def deselect_slow(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests that are not quick."""
    slow = {name for name, seconds in read().items() if seconds > QUICK}
    left_out = [item for item in items if name_of(item.nodeid) in slow or "notebooks" in item.path.parts]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
