"""Runs what a page of the documentation says: its files, its commands and its Python, in their order.

In a page, a block of the language

* ``python`` is run; all blocks of a page are one session; a cell that Sphinx runs is one without its options;
* ``console`` holds commands after ``$``, in several lines where they end in a backslash: ``p3dof ...`` is run
  and must end with exit code 0, ``> file`` writes it and what ``|`` it is given to is not run,
  ``python -c "..."`` is run, others (``make``, ``pip``) are not; what needs
  engines or a browser that are not there is not run;
* ``yaml`` or ``text`` whose first line is a comment with a file name, as ``# machine.yaml``, is written to
  that file; what has none is read only.
"""

from __future__ import annotations

import io
import re
import shlex
import shutil
from contextlib import nullcontext, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from p3dof.cli import main
from p3dof.methods import engines
from p3dof.viewer import headless

ROOT = Path(__file__).parents[1]
_BLOCK = re.compile(r"^```(?:\{code-cell\} )?(\w+)\n(?:---\n.*?^---\n)?(.*?)^```$", re.DOTALL | re.MULTILINE)
_COMMAND = re.compile(r"^\$ (?:\.venv/bin/)?(p3dof|python -c) (.*)$")
_FILE = re.compile(r"# ([\w./-]+\.\w+)\n")


@dataclass(frozen=True)
class Block:
    """A block of a page: its language and its text."""

    language: str
    text: str


def blocks(page: Path) -> list[Block]:
    found = _BLOCK.findall(page.read_text(encoding="utf-8"))
    return [Block(name, text.replace("\\\n", "") if name == "console" else text) for name, text in found]


def first_block(page: str, language: str) -> str:
    """The text of the first block of a language in a page of the documentation."""
    return next(block.text for block in blocks(ROOT / "docs" / page) if block.language == language)


def commands(page: Path) -> list[str]:
    """The commands of a page that are run."""
    lines = "\n".join(block.text for block in blocks(page) if block.language == "console").splitlines()
    return [line for line in lines if _COMMAND.match(line)]


def begin_with(reader: str) -> list[Path]:
    """The pages that the README names first for a reader, by the words in bold of its list."""
    readers = (ROOT / "README.md").read_text(encoding="utf-8").partition("## For whom")[2].split("\n* **")
    (words,) = [words for words in readers if words.startswith(f"{reader}**")]
    return [ROOT / link for link in re.findall(r"\]\(([\w/.-]+\.md)\)", words.partition("\n\n")[0])]


READERS = (
    "You have the paper",
    "You have a part to move",
    "You control the machine",
    "You have another closed-loop robot",
)
WALKED = [page for reader in READERS for page in begin_with(reader) if "in-c" not in page.stem]
"""Pages that `test_first_hour.py` runs whole, in an empty folder."""


def run(page: Path, folder: Path, clone: bool = True) -> dict[str, object]:
    """Run a page in a folder that is the working directory; return the names of its Python session.

    What a clone has is there, or nothing.
    """
    if clone:
        shutil.copytree(ROOT / "urdf", folder / "urdf")
        (folder / "out").mkdir()
    session: dict[str, object] = {}
    for block in blocks(page):
        if block.language == "python":
            exec(compile(block.text, str(page), "exec"), session)  # noqa: S102 - our own text
        elif block.language == "console":
            for line in block.text.splitlines():
                _run_command(line)
        elif named := _FILE.match(block.text):
            (folder / named[1]).write_text(block.text, encoding="utf-8")
    return session


def _run_command(line: str) -> None:
    found = _COMMAND.match(line)
    if found is None or ("--engines" in line and not all(map(engines.available, engines.ENGINES))):
        return
    if line.endswith(".pdf") and not any(map(shutil.which, headless.NAMES)):
        return
    command, _, file = found[2].partition(" | ")[0].partition(" > ")
    words = shlex.split(command, comments=True)
    if found[1] == "p3dof":
        out = io.StringIO()
        with redirect_stdout(out) if file else nullcontext():
            assert main(words) == 0, line
        if file:
            Path(file).write_text(out.getvalue(), encoding="utf-8")
    else:
        exec(words[0], {})  # noqa: S102 - our own text
