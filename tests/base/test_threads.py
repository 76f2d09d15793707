"""Work in shares: every piece once, errors told, and threads that outlive no fork."""

from __future__ import annotations

import os
import threading

import pytest

from p3dof._base.errors import InputError
from p3dof._base.threads import in_threads, processors, shares, slices, thread_count
from p3dof.closed_form.compiled import MachineKernels
from p3dof.machine.parameters import PAPER


@pytest.mark.parametrize("count", [0, 1, 7, 100, 100_003])
@pytest.mark.parametrize("threads", [1, 2, 3, 24])
@pytest.mark.parametrize("least", [1, 10, 1000])
def test_shares_are_all_of_the_work_once(count, threads, least):
    found = shares(count, threads, least)
    assert [piece for start, stop in found for piece in range(start, stop)] == list(range(count))
    assert 1 <= len(found) <= threads
    sizes = [stop - start for start, stop in found]
    assert max(sizes) - min(sizes) <= 1
    assert len(found) == 1 or min(sizes) >= least


def test_slices_are_all_of_a_range_once():
    assert list(slices(10, 4)) == [slice(0, 4), slice(4, 8), slice(8, 10)]
    assert list(slices(0, 4)) == []


def test_jobs_are_done_at_once_and_in_order():
    meeting = threading.Barrier(3, timeout=60)

    def job(part):
        meeting.wait()  # nobody leaves before all are there
        return part, threading.get_ident()

    found = in_threads(job, ["a", "b", "c"])
    assert [part for part, _ in found] == ["a", "b", "c"]
    assert found[0][1] == threading.get_ident()
    assert len({thread for _, thread in found}) == 3
    assert in_threads(job, []) == []


@pytest.mark.parametrize("bad", [0, 2])
def test_an_error_is_raised_when_all_are_done(bad):
    done = []

    def job(part):
        if part == bad:
            raise ValueError(f"part {part}")
        done.append(part)

    with pytest.raises(ValueError, match=f"part {bad}"):
        in_threads(job, range(4))
    assert sorted(done) == [part for part in range(4) if part != bad]


def test_the_environment_counts_the_threads_of_everything(monkeypatch):
    monkeypatch.delenv("P3DOF_THREADS", raising=False)
    assert thread_count(None) == processors() == MachineKernels(PAPER).threads
    monkeypatch.setenv("P3DOF_THREADS", "3")
    assert thread_count(None) == MachineKernels(PAPER).threads == 3
    assert thread_count(2) == 2
    for name, wrong in (("threads", 0), ("threads", 1.5), ("threads", True), ("threads", 1025)):
        with pytest.raises(InputError, match=f"{name}: expected a number from 1 to 1024"):
            thread_count(wrong)
    monkeypatch.setenv("P3DOF_THREADS", "many")
    with pytest.raises(InputError, match="P3DOF_THREADS: expected a number"):
        thread_count(None)


def test_processors_are_those_of_the_process_or_of_the_machine(monkeypatch):
    of_process = {0: {1, 4, 5}}  # 0: the process that asks
    monkeypatch.setattr(os, "sched_getaffinity", of_process.__getitem__, raising=False)
    assert processors() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    for told, expected in ((6, 6), (None, 1)):
        monkeypatch.setattr(os, "cpu_count", lambda told=told: told)
        assert processors() == expected
