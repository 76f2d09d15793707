"""Checks the spelling of all that git knows, in British English: `make lint` runs this.

codespell finds misspelt words, and American ones by its own table from British to American, turned round. In
pages all of that table counts; elsewhere words are left out that are names in code.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import codespell_lib

ROOT = Path(__file__).parents[1]
OTHERS = {
    "math",
    "program",
    "programs",
    "dialog",
    "license",
    "licenses",
    "biased",
    "focused",
    "sanitizer",
    "sanitizers",
}
"""American words that are British ones, too, or have another meaning."""
NAMES = ("color", "center", "normaliz", "generaliz", "visualiz", "optimiz", "minimiz", "sanitiz", "initializ")
NAMES += (
    "serializ",
    "finaliz",
    "rasteriz",
    "capitaliz",
    "vectoriz",
    "parameteriz",
    "writable",
    "analyz",
    "meter",
)
"""Beginnings and middles of words that libraries, formats and C call things by."""
CODE = r"(?s)```.*?```|`[^`]*`|\]\([^)]*\)|\$\$.*?\$\$"
"""What is no text in a page: code, and where links lead."""


def american() -> dict[str, str]:
    """Return American words, and how they are written here."""
    table = Path(codespell_lib.__file__).parent / "data/dictionary_en-GB_to_en-US.txt"
    pairs = (line.split("->") for line in table.read_text(encoding="utf-8").splitlines())
    found = {word: british for british, words in pairs for word in words.rstrip(",").split(", ")}
    return {word: british for word, british in found.items() if word not in OTHERS}


def misspelt(files: list[str], words: dict[str, str], *options: str) -> int:
    """Print what is misspelt in files, and return what codespell does: 0 where nothing is."""
    with TemporaryDirectory() as folder:
        dictionary = Path(folder) / "american.txt"
        text = "".join(f"{word}->{british}\n" for word, british in words.items())
        dictionary.write_text(text, encoding="utf-8")
        told = ("--toml", "pyproject.toml", "-D", "-", "-D", str(dictionary), *options)
        return codespell_lib.main(*told, *files)


def main() -> int:
    """Check all files; return 0 when no word is misspelt."""
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
    files = [name for name in done.stdout.split("\0") if (ROOT / name).is_file()]
    pages = [name for name in files if name.endswith(".md")]
    words = american()
    plain = {word: british for word, british in words.items() if not any(name in word for name in NAMES)}
    found = misspelt(pages, words, "--ignore-multiline-regex", CODE)
    return found | misspelt([name for name in files if name not in pages], plain)


if __name__ == "__main__":
    sys.exit(main())
