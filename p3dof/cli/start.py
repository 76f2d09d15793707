"""`p3dof init`, `doctor`, `completion`: files to start from, and the installation."""

from __future__ import annotations

import math
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module, metadata
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import NamedTuple

import click
from click.shell_completion import get_completion_class
from rich.console import Console

import p3dof
from p3dof._base.errors import NO_PINOCCHIO, InputError
from p3dof._base.files import together, write_atomic
from p3dof.cli.app import FAILED, app
from p3dof.cli.files import InputFile, OutputFolder, protect, source
from p3dof.cli.output import deliver, give, print_plain, print_written
from p3dof.design.drives import GENERIC, Catalogue, read_catalogue
from p3dof.design.drives.catalogue import dump
from p3dof.machine.motion import paper_motion
from p3dof.machine.parameters import SOLIDS, Body, Parameters

NEXT = {
    "compare --parameters machine.yaml --motion motion.csv": "actuator forces of the motion, by both methods",
    "plan task.yaml --parameters machine.yaml": "motion of the task, and utilisation of the limits",
    "size task.yaml --parameters machine.yaml --drives drives.yaml": "motors and screws that fit the task",
    "bearings bearings.yaml --task task.yaml --parameters machine.yaml": "lives of bearings and guides",
}
"""Commands to go on with, and what each computes."""

_MM, _DEG = 1e-3, math.pi / 180
_ORIGIN = """\
# The numbers are typical of their size, and of no maker. Load ratings of nuts: of three turns of balls, they
# grow with number and diameter of the balls by ISO 281 and ISO 76, and are rounded down to 0.5 kN.
"""


@app.command()
@click.argument("folder", type=OutputFolder(), default=".", metavar="[FOLDER]")
@click.option(
    "--drives",
    "catalogue_file",
    type=InputFile(),
    help="Catalogue of motors, gears, screws and belts (YAML) for drives.yaml, with the makers' tables (CSV) "
    "that it names; by default generic sizes.",
)
@click.option("--drives-only", is_flag=True, help="Write drives.yaml only.")
@click.option("--force", is_flag=True, help="Overwrite existing files.")
def init(folder: Path, catalogue_file: Path | None, drives_only: bool, force: bool) -> int:
    """Write a commented machine.yaml, motion.csv, task.yaml, drives.yaml and bearings.yaml to start from.

    They are written to FOLDER, by default the current one: all of them, or none if one exists already.
    """
    drives = GENERIC if catalogue_file is None else read_catalogue(source(catalogue_file))
    texts = {
        folder / name: text
        for name, text in starting_files(drives).items()
        if not drives_only or name == "drives.yaml"
    }
    protect((catalogue_file,), texts)
    for path in texts:
        if path.exists() and not force:
            raise InputError(f"{path} exists already: nothing was written; --force overwrites it")
    with together():
        written = [write_atomic(path, text) for path, text in texts.items()]
    print_written(console := Console(), written)
    if not drives_only:
        where = f", in {folder}" if folder != Path() else ""
        print_plain(console, f"They work as they are. Try{where}:")
        for command, meaning in NEXT.items():
            print_plain(console, f"  p3dof {command}\n      {meaning}")
    return 0


def starting_files(drives: Catalogue = GENERIC) -> dict[str, str]:
    """Return the texts by name: numbers of the package, in the units that people write."""
    fills = {
        "machine.yaml": _numbers(SOLIDS),
        "task.yaml": {},
        "bearings.yaml": {},
        "drives.yaml": {"origin": _ORIGIN if drives is GENERIC else "", "parts": dump(drives)},
    }
    folder = files("p3dof.cli") / "templates"
    texts = {
        name: Template((folder / f"{name}.in").read_text(encoding="utf-8")).substitute(fill)
        for name, fill in fills.items()
    }
    motion = paper_motion(41)
    rows = zip(motion.time, *(motion.pose / (_MM, _MM, _DEG)).T, strict=True)
    lines = [
        "# Poses over time, here of the paper's motion; the platform moves on the smooth curve through them."
    ]
    lines += ["t [s],y [mm],z [mm],theta [deg]", *(",".join(map(_plain, row)) for row in rows)]
    aligned = re.sub(
        r"(?m)^( *\w.*?) +# (.*)$", lambda found: f"{found[1]:31} # {found[2]}", texts["machine.yaml"]
    )
    return texts | {"machine.yaml": aligned, "motion.csv": "\n".join([*lines, ""])}


def _numbers(machine: Parameters) -> dict[str, str]:
    """Return the numbers of a machine as its file has them, by their names in the template."""
    limits, bodies = machine.limits, machine.bodies
    found = {name: f"{_plain(value / _MM)} mm" for name, value in vars(machine.geometry).items()}
    found |= {"travel": _row(limits.travel, _MM, " mm"), "tilt": _row(limits.tilt, _DEG, " deg")}
    found |= {"speed": f"{limits.speed:g} m/s", "force": f"{limits.force:g} N"}
    found["gravity"] = _row(machine.gravity, 1, "")
    kinds: dict[str, Body] = {
        "slider": bodies.slider_a,
        "leg": bodies.leg_a,
        "crossbar": bodies.crossbar_upper,
    }
    for kind, body in (kinds | {"platform": bodies.platform}).items():
        found[f"{kind}_mass"] = f"{_plain(body.mass * 1e3)} g"
        found[f"{kind}_com"] = _row(body.com, _MM, " mm")
        found[f"{kind}_inertia"] = _row(body.inertia.diagonal(), 1e-6, " kg mm^2")
    return found


def _row(values: Iterable[float], scale: float, unit: str) -> str:
    return f"[{', '.join(f'{_plain(value / scale)}{unit}' for value in values)}]"


def _plain(number: float) -> str:
    """Return a number with six digits, never minus zero."""
    return f"{number + 0.0:.6g}"


REQUIRED = {"numpy": "numpy", "scipy": "scipy", "pin": "pinocchio", "PyYAML": "yaml", "rich": "rich"}
"""Packages that are always installed, pin where it has wheels, and what is imported of each."""

EXTRAS = {
    "plot": ("figures", "matplotlib"),
    "viz": ("MeshCat, and live pages in the browser", "meshcat tornado"),
    "jupyter": ("live pages in notebooks", "anywidget meshcat tornado"),
    "shapes": ("shapes and meshes of other robots", "lxml meshcat pycollada tornado trimesh yourdfpy"),
    "video": ("films and pictures", "imageio-ffmpeg meshcat playwright tornado"),
    "report": ("reports", "Jinja2 matplotlib"),
    "mjcf": ("MJCF files of other robots", "mujoco"),
    "models": ("robots by name (example-robot-data)", "example-robot-data-loaders"),
    "tables": ("tables in Parquet", "pyarrow"),
    "xarray": ("results as labelled arrays and data frames", "pandas xarray"),
    "usd": ("USD files", "usd-core"),
    "xacro": ("robots with macros", "xacro"),
    "jax": ("forces as functions of JAX arrays", "jax"),
    "studio": ("Pareto fronts by genetic algorithms", "pymoo"),
    "identify": ("possible bodies in identification", "clarabel"),
    "cluster": ("sweeps on Dask clusters", "dask distributed pyarrow"),
}
"""Optional parts of the package: what each is for, and the packages that it needs."""

ENGINES = ("mujoco", "drake", "exudyn")
"""Packages of the extra 'engines', each of use alone: they compute the same forces."""

_OK, _MISSING, _BROKEN = "ok", "missing", "BROKEN"


class Finding(NamedTuple):
    """What was looked for, whether it is there, and which and where; or what it would be for."""

    name: str
    state: str  # ok; missing, which is optional; BROKEN, which is required
    detail: str


@app.command()
def doctor() -> int:
    """Check the installation: versions, compiled kernels, extras, engines, compiler, browser, cache.

    What is missing is optional: its line says what it would be for. Exit code 1 when something required is
    broken.
    """
    findings, console = list(examined()), Console()
    works = all(one.state != _BROKEN for one in findings)
    give({"works": works, "findings": [one._asdict() for one in findings]})
    for one in findings:
        print_plain(console, f"{one.state:9}{one.name:12}{one.detail}")
    return 0 if works else FAILED


def examined() -> Iterator[Finding]:
    """Look at one thing after the other."""
    yield Finding("p3dof", _OK, f"{p3dof.__version__} in {Path(p3dof.__file__).parent}")
    yield Finding("Python", _OK, f"{platform.python_version()} in {sys.prefix}")
    for package, module in REQUIRED.items():
        yield _required(package, module)
    kernels = _tried("kernels", _kernels, "for fast evaluation of many samples")
    yield kernels._replace(state=_MISSING) if kernels.detail.startswith("numpy") else kernels
    for extra, (purpose, packages) in EXTRAS.items():
        yield _optional(extra, packages.split(), purpose, extra)
    for engine in ENGINES:
        yield _optional(engine, [engine], "cross-checks of the forces", "engines")
    yield _tried("C compiler", _compiler, "for compiled robots: install gcc or clang")
    yield _tried("browser", _browser, "for films, pictures and PDF: install Chromium or Chrome")
    yield _tried("cache", _cache, "for compiled robots: without it, every process compiles again")


def _required(package: str, module: str) -> Finding:
    if package == "pin" and _version(package) is None:
        return Finding(package, _MISSING, f"for other robots, pages and cross-checks: {NO_PINOCCHIO}")
    try:
        import_module(module)
    except Exception as error:  # whatever a broken installation may raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return Finding(package, _BROKEN, f"{reason}; try: pip install --force-reinstall {package}")
    return Finding(package, _OK, _version(package) or "without a version")


def _optional(name: str, packages: list[str], purpose: str, extra: str) -> Finding:
    versions = {package: _version(package) for package in packages}
    lacking = [package for package, version in versions.items() if version is None]
    if lacking:
        return Finding(name, _MISSING, f"for {purpose} ({', '.join(lacking)}): pip install 'p3dof[{extra}]'")
    return Finding(name, _OK, ", ".join(f"{package} {version}" for package, version in versions.items()))


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _tried(name: str, look: Callable[[], str | None], purpose: str) -> Finding:
    try:
        found = look()
    except Exception:  # a package that is broken has a line of its own
        found = None
    return Finding(name, _OK if found else _MISSING, found or purpose)


def _kernels() -> str | None:
    from p3dof.closed_form.compiled import in_words

    return in_words()


def _compiler() -> str | None:
    from p3dof.loops.compiled.build import compiler

    return compiler()


def _browser() -> str | None:
    from p3dof.viewer.headless import NAMES

    own = Path(os.environ.get("PLAYWRIGHT_BROWSERS_PATH") or Path.home() / ".cache" / "ms-playwright")
    places = (os.environ.get("CHROMIUM"), *map(shutil.which, NAMES), *map(str, own.glob("chromium-*")))
    return next(filter(None, places), None)


def _cache() -> str | None:
    from p3dof.loops.compiled.build import _folders

    return next((f"{folder} can be written" for folder in _folders(make=True)), None)


@app.command()
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")), metavar="SHELL")
def completion(shell: str) -> int:
    """Print the script with which a shell completes commands, options and files.

    SHELL is bash, zsh or fish. For bash, put eval "$(p3dof completion bash)" into ~/.bashrc; for zsh the same
    with zsh into ~/.zshrc, after compinit; for fish, p3dof completion fish | source into config.fish.
    """
    found = get_completion_class(shell)
    deliver("" if found is None else found(app, {}, "p3dof", "_P3DOF_COMPLETE").source() + "\n")
    return 0
