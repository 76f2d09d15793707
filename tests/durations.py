"""Which tests are quick: `make quick` leaves out those whose processor time, in the table beside, is long.

``pytest --measure`` rewrites the table. What is not in it counts as quick: a new test, or one of hardly any
time.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

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

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Write the table: the tests that ran, and the times that are known of the others."""
        waits = {name_of(item.nodeid): self._waits(item) for item in session.items}
        measured = {name: seconds + waits.get(name, 0.0) for name, seconds in self.tests.items()}
        times = {**(read() if TABLE.exists() else {}), **measured}
        rows = sorted((seconds, name) for name, seconds in times.items() if seconds >= KEPT)
        lines = [f"{seconds:.1f} {name}" for seconds, name in reversed(rows)]
        head = f"# Processor time [s] of tests over {KEPT} s; written by pytest --measure."
        TABLE.write_text("\n".join([head, *lines, ""]), encoding="utf-8")

    def _waits(self, item: pytest.Item) -> float:
        """Return the time of the shared fixtures that a test uses."""
        names = getattr(item, "fixturenames", ())
        own = (key for key in self.fixtures if item.nodeid.startswith(key.rpartition("::")[0]))
        return sum(self.fixtures[key] for key in own if key.rpartition("::")[2] in names)


def processor_time() -> float:
    """Return the processor time of this process and of those that it has waited for [s]."""
    return sum(os.times()[:4])


def deselect_slow(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests that are not quick."""
    slow = {name for name, seconds in read().items() if seconds > QUICK}
    left_out = [item for item in items if name_of(item.nodeid) in slow or "notebooks" in item.path.parts]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
