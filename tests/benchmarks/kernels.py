"""Speed of every way to the forces, interleaved in one process: medians, best rounds, ratios.

Run with ``make benchmark``. Writes a figure and all numbers. Timings are never a test: machines
differ, and so do runs; compare the ratios of one run.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import batch
import click
import figure
import fresh
import native
import others
import ports
import psutil
import targets
from inputs import forget
from rich.console import Console
from rich.table import Table
from rounds import Timing, described, load_average, machine_description, measure, wide_console

Timings: TypeAlias = Mapping[tuple[str, str, str], Timing]

HALF_DECADES = [round(10 ** (k / 2)) for k in range(15)]
DECADES = HALF_DECADES[:13:2]
SLOW = {False: 1_000_000, True: 100_000}
BYTES = 600
"""A sample of the curve holds less than this in all its arrays."""

MACHINES = ("general", "symmetric")


@click.command()
@click.option("--quick", is_flag=True, help="Fewer rounds, and batches up to a million only.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default="out/benchmark",
    show_default=True,
    help="Folder for the figure and the numbers.",
)
def main(quick: bool, out: Path) -> None:
    """Measure, print and write."""
    console = wide_console()
    batch.check()
    rounds, imports = (7, fresh.import_times(3)) if quick else (21, fresh.import_times(9))
    memory = fresh.memory_per_sample()
    sizes = [size for size in (DECADES if quick else HALF_DECADES) if size * BYTES < _memory()]
    with tempfile.TemporaryDirectory() as folder:
        loops = ports.hot_loops(Path(folder) / "loops") if ports.available() else []
        contenders = [
            *batch.in_cache(),
            *batch.streamed(),
            *batch.one_sample(),
            *native.from_c(Path(folder)),
            *batch.beside(),
            *others.pinocchio(),
            *others.other_engines(),
            *(ports.streams(loops, Path(folder) / "streams") if loops else ()),
        ]
        timings = measure(contenders, rounds, share=0.4 if quick else 1.2)
    forget()
    timings |= measure(batch.curve(sizes, SLOW[quick]), rounds, share=0.2 if quick else 0.6)
    found = targets.findings(timings, loops, imports, batch.all_threads(), sizes)
    _print_timings(console, timings)
    _print_ports(console, timings, loops)
    _print_fresh(console, imports, memory)
    _print_targets(console, found)
    caption = f"medians of {rounds} interleaved rounds; {described()}"
    console.print(f"{caption}; {load_average()}", soft_wrap=True)
    bound = _bound(timings, loops)
    out.mkdir(parents=True, exist_ok=True)
    written = [
        *figure.draw(timings, bound, _wrapped(caption), out),
        _write(out, rounds, timings, loops, found, imports, memory),
    ]
    for path in written:
        console.print(f"wrote {path}", soft_wrap=True)


def _memory() -> float:
    return psutil.virtual_memory().available / 2


def _bound(timings: Timings, loops: Sequence[ports.Loop]) -> float | None:
    for loop in loops:
        if (loop.level, loop.machine) == (batch.BEST, "symmetric"):
            return ports.bounds(loop, timings)["bound"]
    return None


def _wrapped(text: str) -> str:
    """Break a caption in two."""
    middle = text.index(", ", len(text) // 2)
    return f"{text[: middle + 1]}\n{text[middle + 2 :]}"


def _print_timings(console: Console, timings: Timings) -> None:
    """Print one table a group: nanoseconds a sample, and how they compare."""
    bare = timings[others.OTHERS, others.BARE, "symmetric"].median
    for group in dict.fromkeys(key[0] for key in timings if key[0] not in {ports.PORTS, batch.CURVE}):
        table = Table(title=f"{group}, ns a sample: median (best)", title_justify="left")
        table.add_column("")
        for head in (*MACHINES, "of the kernel", "of a bare rnea call"):
            table.add_column(head, justify="right")
        for name in dict.fromkeys(key[1] for key in timings if key[0] == group):
            rows = {machine: timings.get((group, name, machine)) for machine in MACHINES}
            last = rows["symmetric"]
            kernel = timings[batch.IN_CACHE, f"columns, {batch.BEST}", "symmetric"].median
            ratios = (
                ("", "") if last is None else (f"{last.median / kernel:.3g}", f"{last.median / bare:.3g}")
            )
            table.add_row(name, *(_nanoseconds(row) for row in rows.values()), *ratios)
        console.print(table)


def _nanoseconds(timing: Timing | None) -> str:
    return "" if timing is None else f"{_digits(timing.median * 1e9)} ({_digits(timing.best * 1e9)})"


def _digits(value: float) -> str:
    """Return a number with three digits, without exponent."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _print_ports(console: Console, timings: Timings, loops: Sequence[ports.Loop]) -> None:
    if not loops:
        console.print("no port bound: it needs the extension, Linux on x86-64, gcc and objdump")
        return
    table = Table(title="port bound, ns a sample; see ports.py for the model", title_justify="left")
    heads = ("level", "machine", *ports.GROUPS, "bound", "counted", "together", "kernel")
    for head in (*heads, "bound / kernel", "counted / kernel", "together / kernel"):
        table.add_column(head, justify="left" if head in {"level", "machine"} else "right")
    for loop in loops:
        found = ports.bounds(loop, timings)
        kernel = timings[batch.IN_CACHE, f"columns, {loop.level}", loop.machine].median
        shares = [f"{found[name] / kernel:.0%}" for name in ("bound", "counted", "together")]
        numbers = [f"{value * 1e9:.3g}" for value in (*found.values(), kernel)]
        table.add_row(loop.level, loop.machine, *numbers, *shares)
    console.print(table)
    for loop in loops:
        counts = ", ".join(f"{count} {kind}" for kind, count in loop.counts.most_common())
        head = f"{loop.level}, {loop.machine}: {loop.instructions} instructions for {loop.samples} samples"
        console.print(f"{head}: {counts}", soft_wrap=True)
    singles = [timing for key, timing in timings.items() if key[0] == ports.PORTS and not key[2]]
    console.print(
        "one instruction, ns: "
        + "; ".join(
            f"{timing.contender.name.replace(':', '')} {timing.best * 1e9:.3g}" for timing in singles
        ),
        soft_wrap=True,
    )


def _print_fresh(
    console: Console, imports: Mapping[str, float], memory: Mapping[str, tuple[float, float]]
) -> None:
    table = Table(title="imports, ms, in fresh processes", title_justify="left")
    table.add_column("")
    table.add_column("median", justify="right")
    for name, seconds in imports.items():
        table.add_row(name, f"{seconds * 1e3:.0f}")
    console.print(table)
    table = Table(title="memory of robot.forces, bytes a sample, beside the states", title_justify="left")
    for head in ("method", "samples", "resident", "allocated"):
        table.add_column(head, justify="right" if head != "method" else "left")
    for method, (resident, allocated) in memory.items():
        table.add_row(method, f"{fresh.MEMORY[method]:,}", f"{resident:.0f}", f"{allocated:.0f}")
    console.print(table)


def _print_targets(console: Console, found: Sequence[targets.Finding]) -> None:
    table = Table(
        title="targets, found by medians (by best rounds); forces: kernel in the cache, one thread",
        title_justify="left",
    )
    for head in ("what", "asked", "general", "symmetric", "holds"):
        table.add_column(head, justify="left" if head == "what" else "right")
    for finding in found:
        target, values = finding.target, finding.median
        asked = (
            ""
            if target.limit is None
            else f"{'≥' if target.at_least else '≤'} {target.limit:g} {target.unit}".rstrip()
        )
        cells = [_pair(finding, machine) for machine in MACHINES]
        if "" in values:
            cells = ["", _pair(finding, "")]
        verdicts = [target.holds(value) for value in values.values()]
        holds = "" if None in verdicts else "yes" if all(verdicts) else "partly" if any(verdicts) else "no"
        table.add_row(target.what, asked, *cells, holds)
    console.print(table)


def _pair(finding: targets.Finding, machine: str) -> str:
    if machine not in finding.median:
        return ""
    median, best = (_digits(values[machine]) for values in (finding.median, finding.best))
    return median if median == best else f"{median} ({best})"


def _write(
    out: Path,
    rounds: int,
    timings: Timings,
    loops: Sequence[ports.Loop],
    found: Sequence[targets.Finding],
    imports: Mapping[str, float],
    memory: Mapping[str, tuple[float, float]],
) -> Path:
    """Write all numbers as JSON."""
    numbers = {
        "machine": dict(machine_description()),
        "rounds": rounds,
        "timings": [
            {
                "group": key[0],
                "name": key[1],
                "machine": key[2],
                "samples": timing.contender.samples,
                "threads": timing.contender.threads,
                "median_ns": timing.median * 1e9,
                "best_ns": timing.best * 1e9,
                "rounds": len(timing.values),
            }
            for key, timing in timings.items()
        ],
        "loops": [
            {
                "level": loop.level,
                "machine": loop.machine,
                "samples": loop.samples,
                "instructions": dict(loop.counts),
                "ns": {name: value * 1e9 for name, value in ports.bounds(loop, timings).items()},
            }
            for loop in loops
        ],
        "targets": [
            {
                "what": finding.target.what,
                "limit": finding.target.limit,
                "at_least": finding.target.at_least,
                "unit": finding.target.unit,
                "median": finding.median,
                "best": finding.best,
            }
            for finding in found
        ],
        "import_seconds": dict(imports),
        "bytes_per_sample": {
            method: {"resident": resident, "allocated": allocated}
            for method, (resident, allocated) in memory.items()
        },
    }
    path = out / "benchmark.json"
    path.write_text(json.dumps(numbers, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


if __name__ == "__main__":
    main()
