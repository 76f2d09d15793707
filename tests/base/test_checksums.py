"""Files that are written here and read again carry checksums: what became of them is noticed, and told."""

from __future__ import annotations

import json
from importlib.util import find_spec

import numpy as np
import pytest
import sweep_problems

import p3dof
from p3dof._base.blocks import storage
from p3dof._base.blocks.storage import NAME_OF_FILE, parse_manifest, read_manifest
from p3dof._base.errors import FileError, P3dofError, SweepError
from p3dof._base.files import pack_arrays
from p3dof.design.optimisation.evolution import MANIFEST, Journal
from p3dof.runs import Simulation

ABOUT = {"objective": "peak_force", "bounds": [0.24, 0.28]}


def swept(folder, kind):
    keep, reductions = ("R", "peak_a"), sweep_problems.reductions()[:1]
    problem = sweep_problems.problem(8, 4)
    return p3dof.sweep(problem, folder / "sweep", seed=3, format=kind, keep=keep, reductions=reductions)


def run(folder):
    made = p3dof.load().simulate(0.005, controller=lambda *_: np.full(3, 40.0), samples=3)
    path = folder / "run.npz"
    made.save(path)
    return path, lambda: vars(Simulation.load(path))


def block(folder, kind):
    made = swept(folder, kind)
    (path,) = made.folder.rglob(f"0000000001.{kind}")
    return path, lambda: storage.read_block(made.manifest, made.manifest.block(1), path)


def totals(folder):
    made = swept(folder, "npz")
    path = made.folder / "reductions.npz"
    return path, lambda: storage.read_totals(made.manifest, path)


def manifest(folder):
    made = swept(folder, "npz")
    path = made.folder / NAME_OF_FILE
    return path, lambda: parse_manifest(read_manifest(made.folder), path).to_dict()


def part(folder):
    with Journal(folder / "journal", ABOUT) as journal:
        journal.write("part", x=np.arange(6.0).reshape(2, 3), n=np.array(3))
    path = folder / "journal" / "part.npz"

    def read():
        found = journal.read("part")
        if found is None:  # and it is computed again
            raise FileError(str(path))
        return found

    return path, read


def journal(folder):
    Journal(folder / "journal", ABOUT)
    path = folder / "journal" / MANIFEST
    return path, lambda: Journal(path.parent, ABOUT, resume=True).taken


FILES = {
    "a run": (run, 59),
    "a block": (lambda folder: block(folder, "npz"), 23),
    "a block as Parquet": pytest.param(
        lambda folder: block(folder, "parquet"),
        23,
        marks=pytest.mark.skipif(find_spec("pyarrow") is None, reason="pyarrow not installed"),
    ),
    "what reductions found": (totals, 11),
    "a manifest": (manifest, 7),
    "a part of an optimisation": (part, 3),
    "the state of an optimisation": (journal, 2),
}


def plain(value):
    """What two results are compared by."""
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items() if not name.startswith("_")}
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    return [plain(item) for item in value] if isinstance(value, list | tuple) else repr(value)


@pytest.mark.parametrize(("write", "step"), FILES.values(), ids=FILES)
def test_a_file_with_a_bit_changed_is_refused_or_says_the_same(write, step, tmp_path):
    """Bits of no meaning, such as the time in an archive, may change; numbers, names and lengths may not."""
    path, read = write(tmp_path)
    data, expected, refused = path.read_bytes(), plain(read()), 0
    for place in range(0, len(data), step):
        damaged = bytearray(data)
        damaged[place] ^= 1 << (place // step % 8)
        path.write_bytes(damaged)
        try:
            found = read()
        except P3dofError as error:
            refused += 1
            told = str(error)
        else:
            told = ""
            assert plain(found) == expected, place
        assert "\n" not in told
    assert refused > len(data) // step // 3


def test_an_archive_whose_directory_seems_to_end_early_has_lost_nothing_unnoticed(tmp_path):
    with Journal(tmp_path, ABOUT) as made:
        path = tmp_path / "part.npz"
        data = bytearray(pack_arrays({"x": np.arange(3.0), "n": np.array(3)}, compressed=False))
        directory = int.from_bytes(data[-6:-2], "little")
        data[directory + 32] = 0x80  # the comment of its first entry is as long as what follows
        path.write_bytes(data)
        assert made.read("part") is None


def test_a_damaged_state_is_not_taken_for_another_optimisation(tmp_path):
    Journal(tmp_path, ABOUT)
    path = tmp_path / MANIFEST
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("0.24", "0.25"), encoding="utf-8")
    with pytest.raises(FileError, match=r"expected the state of an optimisation \(its hash does not fit\)"):
        Journal(tmp_path, ABOUT, resume=True)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SweepError, match=r"bounds is \[0\.24, 0\.28\] there, \[0\.25, 0\.28\] here"):
        Journal(tmp_path, {**ABOUT, "bounds": [0.25, 0.28]}, resume=True)
    data = json.loads(text)
    del data["hash"]  # as files before there were hashes: they are of another version
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(FileError, match="its hash does not fit"):
        Journal(tmp_path, ABOUT, resume=True)
