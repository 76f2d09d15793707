"""Damaged files: what disks, networks, editors and people with bad intentions make of files.

`damaged` takes the bytes of a file that is all right. The damage depends on the random generator alone.
"""

from __future__ import annotations

import contextlib
import copy
import io
import json
import random
import re
import zipfile
from collections.abc import Callable
from typing import Any

import yaml

NUMBERS = ("nan", "inf", "-inf", ".nan", "-1", "0", "-0.0", "1e308", "-1e308", "1e-320", "1e400", "9" * 400)
ODD_NUMBERS = (
    *NUMBERS,
    "1_0",
    "0x1f",
    "1j",
    "\u0661\u0662",
    "1,5",
    "--1",
    "1 m",
    "1 2 3",
    "10**10",
    "2001-01-01",
)
WORDS = (
    "",
    "x",
    "..",
    "true",
    "null",
    "~",
    "world",
    "é",
    "a" * 2000,
    "\x1b[2J",
    "a\nb",
    "\u202etxt",
    "\x00",
    "🙂",
)
SIGNS = (
    "<",
    "&",
    '"',
    "'",
    "[",
    "{",
    "}",
    "]",
    ":",
    ",",
    "- ",
    "*a",
    "&a ",
    "!!int ",
    "%",
    "\t",
    "#",
    "\r",
    "\u2028",
)
VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        [],
        {},
        [[]],
        {"": 0},
        0,
        -1,
        1e308,
        float("nan"),
        float("inf"),
        1e-320,
        10**400,
        -(10**25),
    ),
    *(
        "",
        "x",
        "1 mm",
        "1e999 m",
        "9" * 400,
        "nan",
        "\x1b[31m",
        "a\nb",
        "é\u202e",
        [0] * 50,
        list(range(4)),
        "../x",
    ),
)
BYTES = (b"\0", b"\xff", b"\xc3(", b"\xed\xa0\x80", b"\x1b]0;x\x07", b"\r", b"\xef\xbb\xbf", b"\x85", b"\n\n")
BOMBS = (
    '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>',
    '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
    '<?xml version="1.0" encoding="utf-16"?>',
    "a: &a [x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a,*a]\nc: [*b,*b,*b,*b,*b,*b,*b,*b]\n",
    "%TAG ! tag:x,2000:\n---\n",
)
_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_FORMS = {
    "value": re.compile(r'"[^"]*"'),
    "tag": re.compile(r"<[^>]*>"),
    "word": re.compile(r"\w+"),
    "number": _NUMBER,
}

Rng = random.Random


def damaged(data: bytes, kind: str, rng: Rng) -> bytes:
    """Return a file with one to some damages.

    Parameters
    ----------
    data : bytes
        A file that is all right.
    kind : {"yaml", "json", "csv", "xml", "text", "npz", "binary"}
        What it holds: some damages leave the form as it is.
    rng : random.Random

    Returns
    -------
    bytes
    """
    ways = _WAYS[kind]
    for _ in range(rng.choice((1, 1, 1, 1, 2, 3, 8))):
        data = rng.choice(ways)(data, rng)
    return data


def of_bytes(data: bytes, rng: Rng) -> bytes:
    """Change, cut out, double, move or insert some bytes anywhere."""
    if not data:
        return rng.choice(BYTES)
    found = bytearray(data)
    at, length = rng.randrange(len(found)), rng.choice((1, 1, 2, 4, 8, 64, 700))
    part, other = slice(at, at + length), rng.randrange(len(found))
    kind = rng.randrange(9)
    if kind == 0:
        found[at] ^= 1 << rng.randrange(8)
    elif kind == 1:
        found[part] = rng.randbytes(len(found[part]))
    elif kind == 2:
        found[part] = rng.choice((b"\xff", b"\0")) * len(found[part])
    elif kind == 3:
        found[part] = found[other : other + len(found[part])]
    elif kind == 4:
        found[at:at] = found[other : other + length]
    elif kind == 5:
        found[at:at] = rng.choice(BYTES)
    elif kind == 6:
        del found[slice(at, None) if rng.random() < 0.5 else slice(at)]
    elif len(found) > length:
        del found[part]
    return bytes(found)


def of_text(data: bytes, rng: Rng) -> bytes:
    """Change a number, a word or a sign of a text."""
    text = data.decode("utf-8", "surrogateescape")
    kind = rng.choice(("number", "number", "number", "word", "value", "tag", "sign"))
    if kind == "sign":
        at = rng.randrange(len(text) + 1)
        text = text[:at] + rng.choice((*SIGNS, *WORDS)) + text[at + rng.randrange(3) :]
    elif parts := list(_FORMS[kind].finditer(text)):
        part, new = (
            rng.choice(parts),
            rng.choice(ODD_NUMBERS if kind == "number" or rng.random() < 0.5 else WORDS),
        )
        if kind == "tag":
            new = rng.choice(("", 2 * part.group(), part.group() * 150))
        elif kind == "value":
            new = f'"{new}"'
        text = text[: part.start()] + new + text[part.end() :]
    return text.encode("utf-8", "surrogateescape")


def of_lines(data: bytes, rng: Rng) -> bytes:
    """Swap, double, lose or indent lines."""
    lines = data.splitlines(keepends=True) or [b""]
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(5)
    if kind == 0:
        lines[one], lines[other] = lines[other], lines[one]
    elif kind == 1:
        lines.insert(other, lines[one])
    elif kind == 2:
        del lines[one]
    elif kind == 3:
        lines[one] = b"  " + lines[one]
    else:
        lines[one] = lines[one].rstrip() + b" " + lines[other]
    return b"".join(lines)


def of_all(data: bytes, rng: Rng) -> bytes:
    """Encode all of it otherwise, or put a bomb, or much that is nested, around or into it."""
    kind = rng.randrange(6)
    if kind == 0:
        text = data.decode("utf-8", "replace")
        return text.encode(rng.choice(("utf-16", "utf-32", "latin-1", "cp037", "utf-7")), "replace")
    if kind == 1:
        return b"\xef\xbb\xbf" + data
    if kind == 2:
        return rng.choice(BOMBS).encode() + data
    sign, end = rng.choice(
        (("[", "]"), ("{a: ", "}"), ('{"a":', "}"), ("<a>", "</a>"), ("- ", ""), ("(", ")"))
    )
    deep = rng.choice((50, 3000))
    at = data.find(b"\n", rng.randrange(len(data) + 1)) + 1
    nested = (sign * deep + "1" + end * deep).encode()
    return nested if kind == 3 else data[:at] + nested + data[at:]


def of_tree(data: bytes, rng: Rng, read: Callable[..., Any], write: Callable[..., str]) -> bytes:
    """Change, double, rename or lose a value of plain data, whose form stays right."""
    try:
        found = read(data.decode())
    except (ValueError, yaml.YAMLError, RecursionError):
        return of_text(data, rng)
    places: list[tuple[Any, Any]] = []

    def walk(value: Any) -> None:
        for key in value if isinstance(value, dict) else range(len(value)):
            places.append((value, key))
            if isinstance(value[key], dict | list) and len(places) < 20_000:
                walk(value[key])

    if isinstance(found, dict | list):
        with contextlib.suppress(RecursionError):
            walk(found)
    if not places:
        return write(rng.choice(VALUES)).encode()
    inside, key = rng.choice(places)
    kind = rng.randrange(6)
    if kind == 0 and isinstance(inside, dict):
        inside[rng.choice(("", "x", "mass", "\x1b[1m", "a\nb", "é" * 300))] = inside.pop(key)
    elif kind == 1:
        del inside[key]
    elif kind == 2 and isinstance(inside, list):
        inside.insert(key, inside[key])
    elif kind == 3:
        other, there = rng.choice(places)
        inside[key] = copy.copy(other[there]) if there in _keys(other) else None
    else:
        inside[key] = rng.choice(VALUES)
    try:
        return write(found).encode("utf-8", "surrogatepass")
    except (RecursionError, ValueError):  # it is nested deeply, or in itself, already
        return of_text(data, rng)


def _keys(value: Any) -> Any:
    return value if isinstance(value, dict) else range(len(value))


def of_yaml(data: bytes, rng: Rng) -> bytes:
    """Change plain data, written as YAML again."""
    return of_tree(
        data, rng, yaml.safe_load, lambda x: yaml.safe_dump(x, sort_keys=False, allow_unicode=True)
    )


def of_json(data: bytes, rng: Rng) -> bytes:
    """Change plain data, written as JSON again."""
    return of_tree(data, rng, json.loads, json.dumps)


def of_member(data: bytes, rng: Rng) -> bytes:
    """Change one file inside of an archive, pack it again so that its sums are right; or lose one."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            members = [(info.filename, file.read(info)) for info in file.infolist()]
    except Exception:  # it is damaged already
        return of_bytes(data, rng)
    if not members:
        return of_bytes(data, rng)
    at = rng.randrange(len(members))
    name, content = members[at]
    kind = rng.randrange(8)
    if kind == 0:
        del members[at]
    elif kind == 1:
        members[at] = (rng.choice(("x.npy", "../x.npy", "\x1b.npy", "a\nb.npy", "y" * 300)), content)
    elif kind == 2:
        members[at] = (name, members[rng.randrange(len(members))][1])
    else:
        members[at] = (name, of_bytes(content, rng))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as file:
        for name, content in dict(members).items():
            file.writestr(name, content)
    return stream.getvalue()


_TEXT = (of_text, of_text, of_text, of_lines, of_bytes, of_all)
_WAYS: dict[str, tuple[Callable[[bytes, Rng], bytes], ...]] = {
    "yaml": (of_yaml, of_yaml, of_yaml, *_TEXT),
    "json": (of_json, of_json, of_json, *_TEXT),
    "csv": (*_TEXT, of_lines),
    "xml": _TEXT,
    "text": _TEXT,
    "npz": (of_member, of_member, of_bytes, of_bytes, of_all),
    "binary": (of_bytes, of_bytes, of_bytes, of_bytes, of_bytes, of_all),
}
