"""Signals at any moment of sweeps, optimisations, builds and reports: nothing is lost or left over."""

from __future__ import annotations

import json
import os
import random
import signal
import time
from pathlib import Path

import psutil
import pytest
from interruptions import JOBS, end, finish, prepare, seconds_of

pytestmark = [
    pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux"),
    pytest.mark.usefixtures("ctrl_c"),
]


@pytest.fixture
def folder(tmp_path):
    prepare(tmp_path)
    return tmp_path


class Timer:
    """True when some seconds have passed since it was asked first."""

    def __init__(self, seconds):
        self.seconds, self.since = seconds, None

    def __call__(self):
        self.since = time.monotonic() if self.since is None else self.since
        return time.monotonic() > self.since + self.seconds


def whole_of(job, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    prepare(folder)
    return finish(job, folder)


MOMENTS = {
    "sweep by workers": ("SIGTERM", lambda folder: len(list(folder.rglob("*.npz"))) >= 3),
    "optimise": ("SIGTERM", lambda folder: list((folder / "out").glob("*.npz"))),
    "compiled": (
        "SIGINT",
        lambda _: any(p.name() == "cc1" for p in psutil.Process().children(recursive=True)),
    ),
}


@pytest.mark.parametrize(
    "name", [pytest.param("sweep by workers", marks=pytest.mark.slow), "optimise", "compiled"]
)
def test_a_job_that_is_ended_on_its_way_leaves_nothing_and_goes_on_to_the_same(
    name, folder, tmp_path_factory
):
    number, moment = MOMENTS[name]
    whole = whole_of(JOBS[name], tmp_path_factory)
    told = end(JOBS[name], folder, signal.Signals[number], lambda: moment(folder), whole)
    assert told.startswith({"SIGINT": "interrupted", "SIGTERM": "terminated"}[number])


@pytest.mark.fuzz
@pytest.mark.parametrize("name", JOBS)
def test_jobs_that_are_ended_at_random_moments(name, tmp_path, tmp_path_factory, request):
    rng = random.Random(f"{request.config.getoption('--hypothesis-seed')} {name}")  # noqa: S311 - no secret
    job, told = JOBS[name], []
    whole = whole_of(job, tmp_path_factory)
    prepare(tmp_path)
    seconds = seconds_of(job, tmp_path)
    for trial in range(int(os.environ.get("P3DOF_MOMENTS", "20"))):
        folder = tmp_path / f"trial {trial}"
        folder.mkdir()
        prepare(folder)
        number, wait = rng.choice((signal.SIGINT, signal.SIGTERM)), rng.uniform(0, seconds)
        told.append(end(job, folder, number, Timer(wait), whole))
    if keep := os.environ.get("P3DOF_KEEP"):
        text = json.dumps({word: told.count(word) for word in told})
        (Path(keep) / f"{name.replace(' ', '_')}.json").write_text(text, encoding="utf-8")
    assert set(told) - {"done"}
