"""Pages that the program writes about itself, made anew before every build.

* ``tutorials/*.ipynb``: copies of the notebooks, in which a live page gives way to a recorded one;
* ``contributing.md`` and ``tests.md``: what the repository says to contributors;
* ``_static/animation.html``: the recorded one, of the paper's motion;
* ``_static/stewart.html``: a robot that moves;
* ``_static/tutorial/``: what the commands of the tutorial on tasks draw and write;
* ``_static/workspace/``: what those of the page on workspaces draw;
* ``reference/api/``: the list of public names, by the topics of ``p3dof/__init__.pyi``;
* ``reference/generated/*.md``: tables of links, joints and closures, and of the paper's equations.
"""

from __future__ import annotations

import ast
import contextlib
import inspect
import json
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FunctionType, ModuleType
from typing import Any
from xml.etree import ElementTree

import api_examples
import click
import yaml
from api_examples import doors_and_rooms, members, rooms_of
from numpydoc.docscrape import NumpyDocString
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.config import Config
from sphinx.pycode import ModuleAnalyzer
from sphinx.transforms import SphinxTransform

import p3dof
from p3dof.cli import app as program
from p3dof.cli import main

PACKAGE = Path(p3dof.__file__).parent
ROOT = PACKAGE.parent
EQUATION = re.compile(r"(?<![\w\]])\((\d{1,2})\)(?:[-–]\((\d{1,2})\))?|\beqs?\. \(?(\d{1,2})\)?")
LAST_EQUATION = 18
LINKS = {"docs/": "", "tests/README.md": "tests.md", "../CONTRIBUTING.md": "contributing.md"}
LIVE = re.compile(r"robot\.(show|viewer)\(")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NAMED = re.compile(r"# ([\w./-]+\.\w+)\n")
SHOWN = {
    "tutorials/from-a-task-to-a-machine.md": (
        "tutorial",
        "task.png",
        "drives.png",
        "machines.png",
        "out/machine.html",
    ),
    "how-to/workspace-and-indices.md": ("workspace", "map.png", "slices.png", "loci.png"),
}
"""Pages that show what their commands make: a folder for it, and what."""
RECORDED = (
    '<iframe class="machine" src="../_static/animation.html" title="The machine, moving"></iframe>\n\n'
    "(Recorded: in the notebook, the page is live.)"
)


def write_pages(app: Sphinx, _config: Config) -> None:
    """Write all pages; Sphinx calls this when it has read its settings."""
    source = Path(app.srcdir)
    load_commands()
    for page, original in {"contributing.md": "CONTRIBUTING.md", "tests.md": "tests/README.md"}.items():
        _write(source / page, _moved((ROOT / original).read_text(encoding="utf-8")))
    tutorials = source / "tutorials"
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        _write(tutorials / notebook.name, tutorial(notebook.read_text(encoding="utf-8")))
    animation = source / "_static" / "animation.html"
    if not animation.exists() and main(["show", "--out", str(animation)]):
        raise RuntimeError("the animation could not be written")
    alive = source / "_static" / "stewart.html"
    robot = source / "_static" / "gallery" / "stewart.urdf"
    if not alive.exists() and main(["loop", "show", str(robot), "--out", str(alive)]):
        raise RuntimeError("the page of a robot that moves could not be written")
    for page, (folder, *shown) in SHOWN.items():
        results_of(source / page, source / "_static" / folder, shown)
    _write(source / "reference/api/index.rst", api_page())
    for name, text in module_pages().items():
        _write(source / f"reference/api/p3dof.{name}.rst", text)
    for name in data_names():
        _write(source / f"reference/api/p3dof.{name}.rst", data_page(name))
    _write(source / "reference/generated/names.md", names_page())
    _write(source / "reference/generated/equations.md", equations_page())


def results_of(page: Path, folder: Path, shown: list[str]) -> None:
    """Run the commands of a page, and keep what it shows of their figures and files."""
    wanted = {name: folder / Path(name).name for name in shown}
    written = max((path.stat().st_mtime for path in [page, *PACKAGE.rglob("*.py")]), default=0.0)
    if all(path.exists() and path.stat().st_mtime >= written for path in wanted.values()):
        return
    folder.mkdir(exist_ok=True)
    with TemporaryDirectory() as place, contextlib.chdir(place):
        for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            if named := NAMED.match(text):
                Path(named[1]).write_text(text, encoding="utf-8")
            if language == "console":
                for line in re.findall(r"^\$ p3dof (.*)$", text.replace("\\\n", ""), re.MULTILINE):
                    words = shlex.split(line)
                    if not line.endswith(".pdf") and main(words):
                        raise RuntimeError(f"{page.name}: p3dof {line}")
        for name, path in wanted.items():
            shutil.copyfile(name, path)


def load_commands() -> None:
    """Import every command: sphinx-click takes those that are there for all that there are."""
    context = click.Context(program)
    for name in program.list_commands(context):
        program.get_command(context, name)


def _moved(text: str) -> str:
    """Return a page of the repository with its links as they are on the site."""
    for old, new in LINKS.items():
        text = text.replace(f"]({old}", f"]({new}")
    return text


def tutorial(text: str) -> str:
    """Return a notebook for the site: no server answers a live page there, so the recorded one stands in."""
    notebook = json.loads(text)
    cells: list[dict[str, Any]] = []
    for number, cell in enumerate(notebook["cells"]):
        cells.append(cell)
        if cell["cell_type"] == "code" and LIVE.search("".join(cell["source"])):
            cell["metadata"]["tags"] = ["remove-output"]
            recorded = {
                "cell_type": "markdown",
                "metadata": {},
                "source": [RECORDED],
                "id": f"recorded-{number}",
            }
            cells.append(recorded)
    return json.dumps({**notebook, "cells": cells}, ensure_ascii=False, indent=1)


def topics() -> dict[str, list[str]]:
    """Return the public names by topic: a comment line above imports in the stub is their topic."""
    text = (PACKAGE / "__init__.pyi").read_text(encoding="utf-8")
    lines = text.splitlines()
    found: dict[str, list[str]] = {}
    topic = "Names"
    for statement in ast.parse(text).body:
        if not isinstance(statement, ast.ImportFrom):
            continue
        above = lines[statement.lineno - 2]
        if above.startswith("# "):
            topic = above[2:].partition(":")[0].strip()
        names = [alias.asname or alias.name for alias in statement.names]
        found.setdefault(topic, []).extend(name for name in names if name in p3dof.__all__)
    return found


def api_page() -> str:
    """Return the page that lists every public name, and makes Sphinx write a page for each."""
    parts = [
        "Python",
        "======",
        "",
        "The most important names, and the modules, whose pages have all the others. A name is imported",
        "when it is first used, so that ``import p3dof`` takes milliseconds. Poses are (y, z, θ); forces and",
        "sliders are ordered A, B, C; SI units. Each function and class has an example that a test runs; the",
        "robots in ``gallery/`` are those of :doc:`/how-to/gallery`.",
        "",
    ]
    for topic, names in topics().items():
        parts += [topic, "-" * len(topic), ""]
        modules = [name for name in names if isinstance(getattr(p3dof, name), ModuleType)]
        data = [name for name in names if name in data_names()]
        objects = [name for name in names if name not in modules and name not in data]
        if data:
            parts += [".. toctree::", "   :hidden:", "", *(f"   p3dof.{name}" for name in data), ""]
            parts += [".. list-table::", "   :class: autosummary", ""]
            for name in data:
                parts += [f"   * - :py:data:`~p3dof.{name}`", f"     - {data_text(name)}"]
            parts.append("")
        if objects:
            parts += [".. autosummary::", "   :toctree: .", ""]
            parts += [*(f"   ~p3dof.{name}" for name in objects), ""]
        if modules:
            parts += [".. toctree::", "   :maxdepth: 2", "", *(f"   p3dof.{name}" for name in modules), ""]
    return "\n".join(parts)


def data_names() -> list[str]:
    """Return the public names that are neither classes nor functions nor modules."""
    kinds = (type, FunctionType, ModuleType)
    return [name for name in p3dof.__all__ if not isinstance(getattr(p3dof, name), kinds)]


def data_text(name: str) -> str:
    """Return what stands below a constant where it is defined."""
    value = getattr(p3dof, name)
    for module in [key for key in sys.modules if key.startswith("p3dof.")]:
        if getattr(sys.modules[module], name, None) is value:
            text = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name))
            if text:
                return " ".join(text).strip()
    raise RuntimeError(f"p3dof.{name} has no text below its definition")


def data_page(name: str) -> str:
    """Return the page of a constant."""
    kind = type(getattr(p3dof, name)).__name__
    kind = f"p3dof.{kind}" if kind in p3dof.__all__ else kind
    lines = [name, "=" * len(name), "", f".. py:data:: p3dof.{name}", f"   :type: {kind}", ""]
    return "\n".join([*lines, f"   {data_text(name)}", ""])


def module_pages() -> dict[str, str]:
    """Return a page for each public module: what it says about itself, and what it offers beyond `p3dof`."""
    pages, listed = {}, members()
    for name in doors_and_rooms():
        module = attrgetter(name)(p3dof)
        title = f"p3dof.{name}"
        parts = [title, "=" * len(title), ""]
        if module.__name__ == title:
            parts += [f".. automodule:: {title}", "   :no-members:", ""]
        else:  # offered by another name than it has
            parts += [f".. py:module:: {title}", "", inspect.getdoc(module) or "", ""]
        rooms = rooms_of(name) if "." not in name else []
        for room in rooms:
            about = (inspect.getdoc(attrgetter(room)(p3dof)) or "").splitlines()[0]
            parts += [f"* :doc:`p3dof.{room}`: {about}"]
        if rooms:
            parts += ["", ".. toctree::", "   :hidden:", "", *(f"   p3dof.{room}" for room in rooms), ""]
        for member, what in listed[name]:
            parts += _directive(title, member, what)
        pages[name] = "\n".join(parts)
    return pages


def _directive(module: str, name: str, what: Any) -> list[str]:
    """Return the lines that have Sphinx document a function or a class."""
    if inspect.isfunction(what):
        return [f".. autofunction:: {module}.{name}", ""]
    options = ["   :members:"]
    if not issubclass(what, BaseException):  # which inherits what every error of Python has
        options += ["   :inherited-members: object, tuple, int"]
    return [f".. autoclass:: {module}.{name}", *options, ""]


def names_page() -> str:
    """Return tables of the links, joints and closures, read from the URDF and its sidecar."""
    robot = p3dof.load()
    tree = ElementTree.fromstring(robot.urdf)  # noqa: S314 - our own text
    sidecar = yaml.safe_load(robot.sidecar)
    bodies = dict(robot.parameters.bodies.items())
    joints = [joint for joint in tree.findall("joint") if joint.get("type") != "fixed"]
    rows = [
        (
            f"`{joint.get('name')}`",
            str(joint.get("type")),
            f"`{joint.find('parent').get('link')}`",
            f"`{joint.find('child').get('link')}`",
            _axis(joint),
            "yes" if joint.get("name") in sidecar["name_mot"] else "",
        )
        for joint in joints
    ]
    links = [
        (f"`{link.get('name')}`", "moving body" if link.get("name") in bodies else "frame")
        for link in tree.findall("link")
    ]
    closures = sidecar["closed_loop"]
    return "\n".join(
        [
            "## Links",
            "",
            *_table(("link", "what it is"), [("`base_link`", "fixed"), *links[1:]]),
            "",
            "## Joints of the tree",
            "",
            *_table(("joint", "type", "from", "to", "axis at home", "actuated"), rows),
            "",
            "## Closures",
            "",
            *_table(("frame", "frame"), [(f"`{one}`", f"`{two}`") for one, two in closures]),
            "",
        ]
    )


def _axis(joint: ElementTree.Element) -> str:
    axis = joint.find("axis")
    return "" if axis is None else str(axis.get("xyz"))


def equations_page() -> str:
    """Return a table of the paper's equations and the functions and classes whose text names them."""
    where: dict[int, list[str]] = {number: [] for number in range(1, LAST_EQUATION + 1)}
    for name, text in _definitions():
        for match in EQUATION.finditer(text):
            if match[0] == "(1)":  # says nothing on its own: formulas elsewhere are numbered too
                continue
            first = int(match[1] or match[3])
            last = int(match[2] or first)
            for number in range(first, last + 1):
                if number in where and name not in where[number]:
                    where[number].append(name)
    rows = [
        (
            f"({number})",
            ", ".join(f"`{name}`" for name in sorted(names, key=lambda name: ".paper." not in name)),
        )
        for number, names in where.items()
        if names
    ]
    return "\n".join([*_table(("equation", "where it is"), rows), ""])


def _definitions() -> Iterator[tuple[str, str]]:
    """Yield (dotted name, prose) of every function and class that may name an equation of the paper."""
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "import pinocchio" in text:
            continue  # that way knows none of the paper's equations, and numbers its own
        tree = ast.parse(text)
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        lines = text.splitlines()
        inside = set()
        for node in tree.body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                inside.update(range(node.lineno - 1, node.end_lineno or 0))
                yield f"{module}.{node.name}", _prose(lines[node.lineno - 1 : node.end_lineno])
        docstring = ast.get_docstring(tree) or ""
        rest = "\n".join(line for number, line in enumerate(lines) if number not in inside)
        yield module, _prose(rest.replace(docstring, "").splitlines())


def _prose(lines: list[str]) -> str:
    """Return comments and docstrings of some lines."""
    kept, quoted = [], False
    for line in lines:
        marks = line.count('"""')
        if quoted or marks:
            kept.append(line)
        elif "#" in line:
            kept.append(line.partition("#")[2])
        quoted ^= marks % 2 == 1
    return "\n".join(kept)


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    return [
        f"| {' | '.join(header)} |",
        f"|{'---|' * len(header)}",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


def _write(path: Path, text: str) -> None:
    """Write a page where it differs: Sphinx reads again what is newer."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


class Searched(SphinxTransform):
    """Makes entries in the index of what readers search for."""

    default_priority = 840  # the index is collected at 850

    def apply(self, **_: Any) -> None:
        """Enter them, before the index is collected."""
        for place, words in self.config.searched.get(self.env.docname, {}).items():
            entries = [("single", word.strip(), place, "main", None) for word in words.split(";")]
            self.document.insert(0, addnodes.index(entries=entries))


def field_text(kind: type, field: str) -> list[str]:
    """Return what the docstring of a named tuple, or else the comment behind it, says of a field."""
    for one in NumpyDocString(inspect.getdoc(kind) or "")["Parameters"]:
        if field in one.name.split(", "):
            return list(one.desc)
    comment = re.search(rf"^    {field}: [^#\n]*  # (.*)$", inspect.getsource(kind), re.MULTILINE)
    return [comment[1]] if comment else []


def describe_fields(
    _app: Sphinx, _what: str, name: str, _object: Any, _options: Any, lines: list[str]
) -> None:
    """Describe the field of a named tuple by its own text, in place of its number."""
    if lines and lines[0].startswith("Alias for field number"):
        owner, _, field = name.removeprefix("p3dof.").rpartition(".")
        lines[:] = [*field_text(attrgetter(owner)(p3dof), field), ""]


def setup(app: Sphinx) -> dict[str, bool]:
    """Have the pages written before Sphinx looks for its sources."""
    app.add_config_value("searched", {}, "env")
    app.add_transform(Searched)
    app.connect("config-inited", write_pages)
    api_examples.setup(app)
    app.connect("autodoc-process-docstring", describe_fields)
    # Sphinx cannot see that the command line has changed, and forgets the entries of pages that it does not
    # read: these pages are read anew each time.
    app.connect("env-get-outdated", lambda app, *_: ["reference/cli", *app.config.searched])
    return {"parallel_read_safe": True, "parallel_write_safe": True}
