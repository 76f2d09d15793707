"""Damaged files of every kind: each is one clear error in bounded time and memory, or is read; nothing else.

`make test` tries a few of each; ``make fuzz`` very many, each reader in a process of its own with bounds
that the system keeps. ``PYTHONPATH=tests python tests/house/test_damaged_files.py READER SEED COUNT``
tries one alone.
"""

from __future__ import annotations

import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from contextlib import contextmanager
from pathlib import Path

import pytest
from damage import damaged
from documents import ROOT
from readers import READERS
from sweep_problems import environment

from p3dof._base.errors import ModelWarning, P3dofError

SECONDS = 10.0
"""Of processor time that a file may take; the files here take milliseconds."""
LONGEST = 2500
"""Of a message [characters]."""
GIGABYTE = 2**30
CONTROLS = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""What ends a line, what a terminal obeys, what turns the order of text round, and what is no character."""


class Hang(BaseException):
    """A file took too long; no reader catches this."""


@contextmanager
def bounded():
    """Raise `Hang` when the block takes too much processor time."""

    def stop(*_):
        raise Hang

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def fault(read, path):
    """Return what is wrong with how a reader took a file ("" if nothing is), and whether it refused it."""
    refused = False
    with warnings.catch_warnings(record=True) as leaked:
        warnings.simplefilter("always")
        try:
            with bounded():
                read(path)
        except P3dofError as error:
            refused, told = True, str(error)
            if not told or CONTROLS.search(told) or len(told) > LONGEST:
                return f"message: {told!r}"[:500], refused
        except Hang:
            return "hang", refused
        except MemoryError:
            return "memory", refused
        except Exception as error:
            return f"uncaught: {type(error).__name__}: {str(error)[:200]!r}", refused
    foreign = [one for one in leaked if not issubclass(one.category, ModelWarning)]
    for one in leaked:
        if issubclass(one.category, ModelWarning) and CONTROLS.search(str(one.message)):
            return f"message: {str(one.message)[:300]!r}", refused
    return (f"warning: {foreign[0].category.__name__}: {foreign[0].message}" if foreign else ""), refused


def search(name, seed, count, folder):
    """Damage files for a reader; return faults, each with its file, and how many were refused."""
    reader, rng = READERS[name], random.Random(f"{seed} {name}")  # noqa: S311 - no secret
    sources, path = reader.files(), folder / reader.name
    path.parent.mkdir(parents=True, exist_ok=True)
    reader.around(folder)
    for data in sources:
        path.write_bytes(data)
        assert fault(reader.read, path) == ("", reader.takes == "nothing"), data
    found, refused = [], 0
    for _ in range(count):
        data = damaged(rng.choice(sources), reader.kind, rng)
        path.write_bytes(data)
        told, was_refused = fault(reader.read, path)
        refused += was_refused
        if told:
            found.append((told, data))
    return found, refused


FEW = {"parameters": 60, "URDF": 60, "MJCF": 40, "run archive": 150, "task": 40}


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_read_or_refused_in_one_line(name, tmp_path, capfd):
    count = FEW.get(name, 30)
    found, refused = search(name, 1, count, tmp_path)
    assert not found, f"{found[0][0]}\nfor {found[0][1][:3000]!r}"
    assert refused >= count / 10 or (READERS[name].takes == "all" and refused == 0)  # else they do no harm
    assert capfd.readouterr() == ("", "")


@pytest.mark.fuzz
@pytest.mark.parametrize("name", READERS)
def test_very_many_damaged_files_are_read_or_refused_in_one_line(name, tmp_path, request):
    seed = request.config.getoption("--hypothesis-seed")
    command = [sys.executable, __file__, name, str(seed), os.environ.get("P3DOF_FUZZ", "3000")]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["faults"] == {}, told
    assert told["noise"] == "", told
    assert list(tmp_path.iterdir()) == []  # nothing is left where the program was started


@pytest.mark.fuzz
@pytest.mark.skipif(shutil.which("node") is None, reason="node not installed")
def test_very_many_damaged_files_for_the_page(request):
    """Documents, task files, motion files, messages and links, as the page reads them."""
    seed = str(request.config.getoption("--hypothesis-seed"))
    settings = {
        "P3DOF_SEED": seed if seed.isdigit() else "1",
        "P3DOF_FUZZ": os.environ.get("P3DOF_FUZZ", "3000"),
    }
    command = ["node", "--test", str(ROOT / "page/test/damaged.test.mjs")]
    done = subprocess.run(command, env=os.environ | settings, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]


def main(name, seed, count):
    """Try many damaged files of a reader within bounds of the system, and print what was found as JSON."""
    resource.setrlimit(resource.RLIMIT_AS, (6 * GIGABYTE,) * 2)
    resource.setrlimit(resource.RLIMIT_FSIZE, (GIGABYTE,) * 2)
    resource.setrlimit(resource.RLIMIT_CPU, (60 + count,) * 2)  # if a hang in C never comes back
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as noise:
        usual = [os.dup(number) for number in (1, 2)]
        for number in (1, 2):
            os.dup2(noise.fileno(), number)
        begun = time.process_time()
        try:
            found, refused = search(name, seed, count, Path(folder))
        finally:
            for number, descriptor in enumerate(usual, 1):
                os.dup2(descriptor, number)
        noise.seek(0)
        kinds: dict[str, int] = {}
        for number, (told, data) in enumerate(found):
            kind = told[:90]
            kinds[kind] = kinds.get(kind, 0) + 1
            keep = os.environ.get("P3DOF_KEEP")
            if keep and kinds[kind] == 1:
                (
                    Path(keep) / f"{name.replace(' ', '_')}-{number}{Path(READERS[name].name).suffix}"
                ).write_bytes(data)
        said = noise.read(2000).decode("utf-8", "replace")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        told = {"reader": name, "files": count, "refused": refused, "faults": kinds, "noise": said}
        told |= {"seconds": round(time.process_time() - begun, 1), "MB": round(peak)}
        sys.stdout.write(json.dumps(told) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
