"""Nothing that a user can name is left out of the documentation: modules, errors, commands, files.

Elsewhere: names of Python (`test_examples.py`), options (`test_help.py`), variables of the environment
(`test_contributing.py`), fields of files (each with the reader of its file).
"""

from __future__ import annotations

import builtins
import importlib.util
import re
from types import ModuleType

import pytest
from command_line import commands
from documents import ROOT
from readers import READERS

import p3dof
from p3dof.cli.app import _CANNOT
from p3dof.machine import description
from p3dof.viewer.document.meshes import SUFFIXES

DOCS = ROOT / "docs"
REFERENCE = DOCS / "reference"
BY_HAND = {path: path.read_text("utf-8") for path in DOCS.rglob("*.md") if "generated" not in path.parts}


def page(name):
    return (REFERENCE / f"{name}.md").read_text("utf-8")


def test_the_modules_that_are_stable_are_those_that_the_package_offers():
    row = re.search(r"^\| Python \| (.*?) \|", page("stability"), re.MULTILINE)[1]
    modules = {name for name in dir(p3dof) if isinstance(getattr(p3dof, name), ModuleType)}
    offered = {name for name in modules if hasattr(getattr(p3dof, name), "__all__")}
    assert modules - offered == {"codegen"}, "which the page excepts"
    assert set(re.findall(r"`(\w+)`", row)) - {"p3dof", "__all__"} == offered
    assert [name for name in p3dof.__all__ if name.startswith("_")] == ["__version__"]
    for name in offered:
        assert [one for one in getattr(p3dof, name).__all__ if one.startswith("_")] == [], name


def test_what_is_named_with_its_module_is_there():
    files = {"c", "h", "mjs", "sdf", "srdf", "urdf", "usda", "wasm", "yaml"}
    sources = {path: path.read_text("utf-8") for path in (ROOT / "p3dof").rglob("*.py")}
    for path, text in {**BY_HAND, **sources}.items():
        for name in re.findall(r"`(p3dof(?:\.\w+)+)[`(]", text):
            assert name.rpartition(".")[2] in files or _named(name) is not None, (path.name, name)


def _named(name):
    """What a name with its module is; None if there is no such thing."""
    module, _, last = name.rpartition(".")
    try:
        return importlib.import_module(name)
    except ImportError:
        owner = _named(module) if module else None
        return getattr(owner, last, None) or getattr(owner, "__dataclass_fields__", {}).get(last)


def test_no_public_name_is_that_of_a_module_or_folder():
    """Else whoever imports that one, if only by its name, puts it in the place of what users call."""
    for init in (ROOT / "p3dof").rglob("__init__.pyi"):
        door = ".".join(init.parent.relative_to(ROOT).parts)
        face = importlib.import_module(door)
        names = [name for name in face.__all__ if importlib.util.find_spec(f"{door}.{name}") is not None]
        assert [name for name in names if not isinstance(getattr(face, name), ModuleType)] == [], door


def test_what_pages_import_is_public():
    """But for a few functions that no face exports yet; the page on stability says what becomes of them."""
    imported = set()
    for path, text in BY_HAND.items():
        if path.parent.name != "decisions":
            imported.update(re.findall(r"^\s*from p3dof\.([\w.]+) import", text, re.MULTILINE))
    assert len(imported) > 10
    odd = set()
    for name in imported:
        module = p3dof
        for part in name.split("."):
            if part not in getattr(module, "__all__", ()):
                odd.add(name)
                break
            module = getattr(module, part)
    assert odd == {
        "analysis.tolerances.pose",
        "codegen.gpu",
        "codegen.machine",
        "loops.identification.calibration",
        "methods.regressor",
    }
    assert "`p3dof.codegen.gpu.jax_forces`" in page("stability")


def test_the_stable_versions_of_pinocchio_are_those_that_are_declared():
    low, high = re.search(r"Pinocchio is\s+([\d.]+) or newer, below (\d)", page("stability")).groups()
    assert f'"pin>={low},<{high};' in (ROOT / "pyproject.toml").read_text("utf-8")


def test_every_error_is_described_with_what_it_is_and_the_exit_code():
    rows = re.findall(r"^\| `(\w+)` \| (?:`(\w+)`)? ?\| (.+?) \| (\d?) ?\|$", page("errors"), re.MULTILINE)
    assert sorted(name for name, *_ in rows) == sorted(p3dof.errors.__all__)
    for name, other, when, code in rows:
        kind = getattr(p3dof.errors, name)
        assert len(when) > 20, name
        if name == "P3dofError":
            assert (other, code, kind.__bases__) == ("", "", (Exception,))
            continue
        assert issubclass(kind, getattr(p3dof.errors, other, None) or getattr(builtins, other)), name
        assert issubclass(kind, Warning) or code == str(1 if issubclass(kind, _CANNOT) else 2), name
        told = set(re.findall(r"`(\w+)`", when))
        wanted = set(re.findall(r"^    (\w+(?:, \w+)*) :", kind.__doc__ or "", re.MULTILINE)) - {"message"}
        assert told == wanted, f"{name}: what a program can read from it"


@pytest.mark.parametrize("command", [name for name, _ in commands()])
def test_every_command_is_shown_on_a_page(command):
    """The reference is made of its help; this is about a page that uses it."""
    asked = re.compile(rf"\bp3dof {command}\b")
    assert any(map(asked.search, BY_HAND.values()))


def test_every_format_that_is_written_is_described():
    tools = (DOCS / "how-to/other-tools.md").read_text("utf-8")
    for kind in description.FORMATS:
        assert re.search(rf"(?<!\w){re.escape(kind)}(?![\w+])", tools), kind


FILES = {
    "parameters": "Parameter file",
    "drives of makers": "Makers' tables",
    "table of a maker": "Makers' tables",
    "joints": "Motion file of joints",
    "designs": "Table of designs",
    "designs in Parquet": "Table of designs: Parquet",
    "runs": "Table of runs",
    "runs in Parquet": "Table of runs: Parquet",
    "run archive": "Result files: .npz",
    "manifest": "Sweep file: sweep.json",
    "block": "Sweep file: NumPy archive",
    "block in Parquet": "Sweep file: Parquet",
    "reductions": "Sweep file: reductions.npz",
    "journal": "Problem file: optimisation.json",
    "part of a journal": "Problem file: NumPy archive",
    "sidecar": "Sidecar of a URDF",
    "any sidecar": "Sidecar of a URDF",
    "binary STL": "Model files: STL",
    **{name: f"Model files: {name}" for name in ("URDF", "MJCF", "SDF", "USD", "SRDF", "xacro")},
    **{name: f"Model files: {name}" for name in ("STL", "OBJ", "OFF", "PLY", "Collada")},
}
"""Where a file is described: the section, and what it is called there; by default its name and `file`."""


@pytest.mark.parametrize("reader", READERS)
def test_every_file_that_is_read_has_a_section(reader):
    title, _, word = FILES.get(reader, f"{reader.removesuffix(' file').capitalize()} file").partition(": ")
    parts = dict(re.findall(r"^#+ ([^\n]+)\n(.*?)(?=^#|\Z)", page("files"), re.MULTILINE | re.DOTALL))
    assert word in " ".join(parts[title].split())


def test_every_schema_is_linked():
    for path in sorted(REFERENCE.glob("*.schema.json")):
        assert f"]({path.name})" in page("files"), path.name


def test_every_mesh_that_is_read_is_named():
    (line,) = re.findall(r"^Meshes are read .*$", page("files"), re.MULTILINE)
    assert set(re.findall(r"`(\.\w+)`", line)) == set(SUFFIXES)
