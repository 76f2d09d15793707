"""XML from outside: read within bounds and without entities, before a library of somebody else reads it."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree as Xml
from xml.parsers import expat

from p3dof._base.checks import one_line, require, shown
from p3dof._base.errors import FileError, InputError, MissingExtraError, ModelError
from p3dof._base.files import MAX_BYTES, called, read_text, reason

MAX_DEPTH = 100  # deepest nesting of XML elements that is read; a URDF needs six
MAX_ATTRIBUTES = 100  # most of an element: urdfdom's time grows with the square of their number
MAX_ELEMENTS = 200_000  # most elements of a file


def number_of(word: str) -> float:
    """Return the number that a word is, as C's readers have it; NaN for none."""
    try:
        return float(word) if word.isascii() and "_" not in word else math.nan
    except ValueError:
        return math.nan


def read_xml(source: str | os.PathLike[str], what: str = "URDF") -> tuple[str, str]:
    """Return the text of an XML file and what to call it in an error."""
    if is_text(source):
        text = str(source).lstrip("\ufeff")
        if len(text) > MAX_BYTES:
            raise ModelError(f"{what} text: expected at most {MAX_BYTES} characters, got {len(text)}")
        return text, f"{what} text"
    if not isinstance(source, str | os.PathLike) or not os.fspath(source):
        raise ModelError(f"{what}: expected XML text or the path of a file, got {shown(source)}")
    if os.fspath(source).lower().endswith(Macros.SUFFIX):
        return (source if isinstance(source, Macros) else Macros(source)).expanded
    try:
        return read_text(source), os.fspath(source)
    except (FileError, ValueError) as error:
        raise ModelError(str(error)) from error


class Macros(os.PathLike[str]):
    """The path of a file for xacro, with the values of its arguments."""

    SUFFIX = ".xacro"

    def __init__(self, path: str | os.PathLike[str], arguments: Mapping[str, object] | None = None) -> None:
        self._path = os.fspath(path)
        require("xacro_args", arguments or {}, Mapping)
        self._arguments = {str(name): str(value) for name, value in (arguments or {}).items()}
        for name, value in self._arguments.items():
            if not name.isidentifier() or "\0" in value:
                raise InputError(
                    f"xacro_args: expected names with values, got {shown(name)} = {shown(value)}"
                )

    def __fspath__(self) -> str:
        return self._path

    @cached_property
    def expanded(self) -> tuple[str, str]:
        """What xacro makes of the file, and what to call it; the file itself if there are no macros in it."""
        try:
            text = read_text(self._path)
        except FileError as error:
            raise ModelError(str(error)) from error
        if not self._arguments and not _MACROS.search(text):
            return text, self._path
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', os.defpath)}"
        tool = shutil.which("xacro", path=path)
        if tool is None:
            raise MissingExtraError(
                f"{called(self._path)}: its macros need the program xacro: pip install 'p3dof[xacro]', or "
                "expand the file where it is: xacro FILE > robot.urdf"
            )
        given = (f"{name}:={value}" for name, value in self._arguments.items())
        name = called(self._path)
        return _output([tool, str(Path(self._path).absolute()), *given], name), f"{name} (expanded)"


_MACROS = re.compile(r"xacro:|\$[({]")
_SECONDS = 60.0  # most that xacro may take


def _output(command: Sequence[str], name: str) -> str:
    """Return what a program writes, which expands a file of a name."""
    try:
        process = subprocess.Popen(  # noqa: S603 - no shell; the arguments are a path and values
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
    except (OSError, ValueError) as error:
        raise ModelError(f"{name}: xacro does not start: {reason(error)}") from error
    assert process.stdout is not None and process.stderr is not None  # noqa: S101, PT018 - pipes
    told: deque[bytes] = deque(maxlen=6)  # the last lines of its errors
    lines = (line[:200] for line in iter(partial(process.stderr.readline, 4096), b""))
    listener = threading.Thread(target=told.extend, args=(lines,), daemon=True)
    timer = threading.Timer(_SECONDS, process.kill)
    with process:
        listener.start()
        timer.start()
        try:
            data = process.stdout.read(MAX_BYTES + 1)
            if len(data) <= MAX_BYTES:
                process.wait()
        finally:
            late = not timer.is_alive()
            timer.cancel()
            process.kill()
            listener.join()
    if late:
        raise ModelError(f"{name}: xacro took more than {_SECONDS:g} s")
    if len(data) > MAX_BYTES:
        raise ModelError(f"{name}: expected at most {MAX_BYTES} bytes from xacro")
    if process.returncode:
        words = (
            one_line(b" ".join(told).decode("utf-8", "replace"), 1300) or f"exit code {process.returncode}"
        )
        raise ModelError(f"{name}: xacro cannot expand it: {words}")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ModelError(f"{name}: expected UTF-8 text from xacro, got {error.reason}") from error


def is_text(source: object) -> bool:
    """Whether a source is XML text, and not the path of a file."""
    return isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")


class XmlReader:
    """Reads XML into elements, whose names keep their prefixes."""

    text_of: tuple[str, ...] | None = ("plugin",)
    """Elements in which text is kept; None for all."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.path: list[str] = []
        self._parser = expat.ParserCreate("utf-8")
        self._tree = Xml.TreeBuilder()
        self._count = 0
        self._lines: dict[int, int] = {}

    @property
    def line(self) -> int:
        """Where the parser is."""
        return self._parser.CurrentLineNumber

    def line_of(self, element: Xml.Element) -> int:
        """Return the line on which an element of the tree that was read begins."""
        return self._lines[id(element)]

    def fail(self, message: str, line: int | None = None) -> NoReturn:
        """Raise ModelError with the source and the line."""
        raise ModelError(f"{self.source}, line {line or self.line}: {one_line(message)}")

    def parse(self, text: str) -> Xml.Element:
        """Return the first element of a text, with all that is in it."""
        parser = self._parser
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.CharacterDataHandler = self._data
        # Robots have no use for entities; refusing the document type stops expansion attacks.
        parser.StartDoctypeDeclHandler = lambda *_: self.fail("a document type declaration is not allowed")
        try:
            parser.Parse(text.encode("utf-8"), True)
        except expat.ExpatError as error:
            raise ModelError(f"{self.source}, line {error.lineno}: not well-formed XML: {error}") from error
        except UnicodeEncodeError as error:
            raise ModelError(f"{self.source}: not Unicode text: {error}") from error
        return self._tree.close()

    def visit(self, tag: str, attributes: dict[str, str]) -> None:
        """Look at an element as it begins; `path` ends with it."""

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self.path.append(tag)
        self._count += 1
        if len(self.path) > MAX_DEPTH:
            self.fail(f"expected elements nested at most {MAX_DEPTH} deep")
        if self._count > MAX_ELEMENTS:
            self.fail(f"expected at most {MAX_ELEMENTS} elements")
        if len(attributes) > MAX_ATTRIBUTES:
            self.fail(f"expected at most {MAX_ATTRIBUTES} attributes, <{tag:.80}> has {len(attributes)}")
        self._lines[id(self._tree.start(tag, attributes))] = self.line
        self.visit(tag, attributes)

    def _data(self, text: str) -> None:
        if self.text_of is None or not set(self.text_of).isdisjoint(self.path):
            self._tree.data(text)

    def _end(self, tag: str) -> None:
        self.path.pop()
        self._tree.end(tag)


class _Begun(Exception):  # noqa: N818 - never seen outside
    """The first element of a text has begun."""


class _FirstElement(XmlReader):
    def visit(self, tag: str, attributes: dict[str, str]) -> None:  # noqa: ARG002 - only the name counts
        raise _Begun(tag)


def root_of(text: str, source: str) -> str:
    """Return the name of the element that a text begins with; what follows is not looked at."""
    try:
        return str(_FirstElement(source).parse(text).tag)
    except _Begun as begun:
        return str(begun)


def folder_below_which(root: str | os.PathLike[str] | None) -> Path | None:
    """Return the folder below which a user allows files to be included; None for the file's own."""
    if root is None:
        return None
    if not isinstance(root, str | os.PathLike) or not Path(root).is_dir():
        raise ModelError(f"include_root: expected a folder, got {shown(root)}")
    return Path(root).resolve()


def check_includes(
    robot: Xml.Element, source: str | os.PathLike[str], name: str, root: str | os.PathLike[str] | None = None
) -> None:
    """Raise ModelError for an ``<include>``, in included files too, of a file that is not below a folder."""
    allowed = folder_below_which(root)
    if is_text(source):
        if robot.find(".//include") is not None:
            raise ModelError(f"{name}: <include> needs the files beside it: give the path of the file")
        return
    folder = Path(source).resolve().parent
    below = folder if allowed is None else allowed
    seen, pending = {Path(source).resolve()}, [(robot, folder, name)]
    while pending:
        inside, beside, called = pending.pop()
        for element in inside.iter("include"):
            file = element.get("file", "")
            # MuJoCo looks beside the first file, then beside the one that includes
            for place in dict.fromkeys((folder, beside)):
                path = (place / file).resolve()
                if not path.is_relative_to(below) and (path.exists() or place == beside):
                    where = "the folder of the file" if root is None else f"include_root={os.fspath(root)}"
                    raise ModelError(
                        f"{called}: <include>: {shown(file)} is outside {where} (include_root=FOLDER allows "
                        "what is below another one)"
                    )
                if path.is_file() and path not in seen:
                    seen.add(path)
                    text, part = read_xml(path, "MJCF")
                    pending.append((XmlReader(part).parse(text), path.parent, part))
