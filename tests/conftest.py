"""Settings that all tests share."""

from __future__ import annotations

import dataclasses
import gc
import os
import re
import signal
import sys
import threading
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # one worker for each core: more threads would wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
gc.disable()  # until all tests are collected: nothing that is imported or collected goes before the end

import durations
import pytest
from compilers import small  # noqa: F401 - a fixture
from hypothesis import HealthCheck, settings

SLOW = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}  # time limits belong to benchmarks
# A fixed seed (derandomize) makes a failure repeatable; `make fuzz` takes fresh seeds and prints them.
settings.register_profile("p3dof", derandomize=True, **SLOW)
settings.register_profile("fuzz", derandomize=False, database=None, print_blob=True, **SLOW)
settings.load_profile("p3dof")

REQUIRED = os.environ.get("P3DOF_REQUIRE", "")
"""With "all" a test that is skipped has failed: what it needs should have been there."""

EXCEPTIONS = {
    "root may write everywhere": True,  # machines that test may run as root
    "this processor has no such vectors": True,
    "this processor runs no programs of 32 bits": True,
    "this usd-core has no UsdValidation": True,  # Pixar leaves it out of some wheels
    "pybullet not installed": sys.version_info >= (3, 12),  # no wheels beyond
    "(mink|mujoco|usd-core|rerun|Newton|viser) not installed": sys.version_info < (3, 11),  # no wheels before
    "torch not installed": True,  # its wheels for Linux on the index bring 2.6 GB for GPUs
}
"""Reasons to skip that are no failed installation, and where they hold."""


@pytest.fixture
def ctrl_c():
    """What Ctrl-C is in a terminal, here and in processes that the test starts.

    What a script starts in the background ignores it, and so do its children.
    """
    if threading.current_thread() is not threading.main_thread():
        pytest.skip("needs the main thread")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def young():
    """Have `gc.collect` look only at what the test makes: all that was imported takes it a second."""
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture(scope="module")
def browser():
    """A browser for the tests of a file."""
    from browser import chromium

    with chromium() as running:
        yield running


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the pictures of reports away, which take nearly all of the time."""
    from p3dof.report import assessment, page, templates

    blank = templates.Picture("data:,", "nothing", "nothing", 1, 1)
    for module, name, kind in (
        (page, "pictures_of", templates.Pictures),
        (assessment, "_pictures", assessment.AssessmentPictures),
    ):
        made = kind(*[blank] * len(dataclasses.fields(kind)))
        monkeypatch.setattr(module, name, lambda *_, made=made: made)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="leave out the tests that take long")
    parser.addoption("--budget", type=float, default=durations.BUDGET, help="of --quick, for all files [s]")
    parser.addoption("--measure", action="store_true", help="write down how long tests of whole files take")
    parser.addoption("--site", help="folder of the documentation that built_docs.py looks at")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--measure"):
        if any("::" in name for name in config.args):
            raise pytest.UsageError("--measure takes whole files: their rows are times of all their tests")
        config.pluginmanager.register(durations.Measuring())


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what has no quick test."""
    if not config.getoption("--quick") or collection_path.suffix != ".py":
        return None
    if not hasattr(config, "leaves_out"):
        config.leaves_out = durations.not_quick(config)
    return True if config.leaves_out(collection_path.relative_to(config.rootpath).as_posix()) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    items.sort(key=durations.longest_first())
    if not config.getoption("--measure"):
        durations.mark_long(items)
    if config.getoption("--quick"):
        durations.deselect_slow(config, items)


def pytest_collection_finish() -> None:
    """Collect garbage again, but seldom: each time, all that was imported is looked at.

    `gc.freeze` would hide it from `gc.get_referrers`, by which Hypothesis sees whether generators are kept.
    """
    gc.set_threshold(50_000, 20, 50)
    gc.enable()


def _must_run(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip into a failure, unless there is a good reason for it."""
    if REQUIRED != "all" or not report.skipped or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if any(holds and re.search(pattern, reason) for pattern, holds in EXCEPTIONS.items()):
        return
    report.outcome = "failed"
    report.longrepr = f"P3DOF_REQUIRE=all, but something is missing: {reason}"


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function):
    """Hold what a test claims by `@shows` against what it compared."""
    claims = [name for mark in pyfuncitem.iter_markers("shows") for name in mark.args]
    if not claims:
        return (yield)
    import table_numbers  # it imports p3dof, which not every test does

    table_numbers.begin()
    done = yield
    missing = table_numbers.not_compared(claims)
    assert not missing, f"claimed by @shows, but not compared: {missing}"
    return done


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    report = yield
    _must_run(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report():
    report = yield
    _must_run(report)
    return report
