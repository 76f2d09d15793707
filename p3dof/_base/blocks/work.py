"""What a worker does: compute some blocks of a sweep, and write them or give them back."""

from __future__ import annotations

import pickle
import threading
import time
from pathlib import Path
from typing import NamedTuple

from p3dof._base.blocks import storage
from p3dof._base.blocks.folder import path_of, require_folder
from p3dof._base.blocks.manifest import Manifest
from p3dof._base.blocks.problem import Problem, computed
from p3dof._base.blocks.reduction import State
from p3dof._base.files import write_atomic


class Work(NamedTuple):
    """What every worker is told once."""

    problem: Problem
    manifest: Manifest
    folder: str | None


class Done(NamedTuple):
    """What comes back of a block."""

    states: tuple[State, ...]
    data: bytes | None


_memory = threading.local()


def run_blocks(told: bytes | Work, numbers: tuple[int, ...]) -> tuple[list[Done], float]:
    """Compute some blocks: what a worker does; return how long it took too."""
    work = told if isinstance(told, Work) else _unpacked(told)
    if work.folder is not None:
        require_folder(Path(work.folder))
    begun = time.perf_counter()
    found = [_run_block(work, number) for number in numbers]
    return found, time.perf_counter() - begun


def _run_block(work: Work, number: int) -> Done:
    manifest = work.manifest
    block = manifest.block(number)
    columns = computed(work.problem, block)
    states = tuple(reduction.of(columns, block.start) for reduction in manifest.reductions)
    content = storage.Content({name: columns[name] for name in manifest.keep}, states)
    data = storage.pack_block(manifest, block, content)
    if work.folder is None:
        return Done(states, data)
    write_atomic(path_of(Path(work.folder), manifest, number), data)
    return Done(states, None)


def _unpacked(packed: bytes) -> Work:
    """Return what a worker was told: the last one is remembered by each thread, for its own use."""
    if getattr(_memory, "packed", None) != packed:
        _memory.work = pickle.loads(packed)  # noqa: S301 - by the process that we work for
        _memory.packed = packed
    work: Work = _memory.work
    return work
