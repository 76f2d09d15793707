"""Pages as they are written and served: what is in them, and what a browser sends."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
import sys
import urllib.request
from html.parser import HTMLParser

from documents import ROOT

HOSTILE = "<script>alert(1)</script>&\"'--{{ 7 * 7 }}"
VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """What a browser would find: tags in order, tables by their captions, texts."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.text = ""
        self._open: list[str] = []
        self._rows: list[list[str]] = []
        self._caption = ""
        self.feed(html)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)
        if tag == "table":
            self._rows, self._caption = [], ""
        if tag == "tr":
            self._rows.append([])
        if tag in {"td", "th"}:
            self._rows[-1].append("")

    def handle_endtag(self, tag):
        assert self._open.pop() == tag
        if tag == "table":
            self.tables[self._caption] = self._rows

    def handle_data(self, data):
        if "style" in self._open:
            return
        self.text += data
        if "caption" in self._open:
            self._caption += data
        elif {"td", "th"} & set(self._open):
            self._rows[-1][-1] += data

    def named(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def document_of(url):
    """The document in the page that is served."""
    with urllib.request.urlopen(url, timeout=60) as answer:  # noqa: S310 - http
        page = answer.read().decode()
    return json.loads(re.search(r'id="p3dof-document">(.*?)</script>', page, re.DOTALL)[1])


@contextlib.contextmanager
def running_loop(*arguments):
    """`p3dof loop show` as a process, and the URL that it prints."""
    command = [
        sys.executable,
        "-m",
        "p3dof",
        "loop",
        "show",
        *map(str, arguments),
        "--no-open",
        "--port",
        "0",
    ]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        found = re.match(r"(http://127\.0\.0\.1:(\d+)/\?token=[\w-]+) shows the robot; Ctrl-C ends it", line)
        assert found, line + (process.stderr.read() if process.poll() is not None else "")
        yield process, found[1]
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def frame(opcode, content=b"", final=True):
    """A frame as a page sends it, masked with zeros."""
    assert len(content) < 126
    return bytes([0x80 * final | opcode, 0x80 | len(content)]) + bytes(4) + content
