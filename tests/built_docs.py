"""The documentation as it was built: `make docs` runs this on the folder that ``--site`` names."""

from __future__ import annotations

import re
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import click
import pytest
from documents import ROOT
from sphinx.util.inventory import InventoryFile

import p3dof
from p3dof.cli import app

LOADED = {("script", "src"), ("img", "src"), ("iframe", "src"), ("link", "href"), ("source", "src")}
"""What a browser fetches by itself."""
NO_FETCH = {"canonical", "next", "prev", "search", "index", "author"}
"""Links of a page's head that are not fetched."""


class Page(HTMLParser):
    """The anchors of a page, what it points to, and what it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: set[str] = set()
        self.loads: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = {name: value or "" for name, value in attrs}
        self.anchors.update(values[name] for name in ("id", "name") if name in values)
        for name in ("href", "src"):
            if name not in values:
                continue
            self.links.add(values[name])
            if (tag, name) in LOADED and values.get("rel") not in NO_FETCH:
                self.loads.add(values[name])


@pytest.fixture(scope="module")
def site(request):
    folder = request.config.getoption("--site")
    assert folder, "say where the site is: --site out/docs"
    return Path(folder).resolve()


@pytest.fixture(scope="module")
def pages(site):
    return {path: read(path) for path in sorted(site.rglob("*.html")) if path.parent.name != "_static"}


@cache
def read(path):
    return Page(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def inventory(site):
    with (site / "objects.inv").open("rb") as file:
        return InventoryFile.load(file, "", lambda *parts: "".join(parts))


def test_every_public_name_has_a_page(site, inventory):
    known = {name for kind, names in inventory.items() if kind.startswith("py:") for name in names}
    assert [name for name in p3dof.__all__ if f"p3dof.{name}" not in known] == []
    for name in p3dof.__all__:
        assert (site / f"reference/api/p3dof.{name}.html").exists()
    assert "p3dof.Manipulator.mass_matrix" in known  # inherited or not


def test_links_lead_somewhere(site, pages):
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or parts.fragment.startswith("t="):  # a time of the page's run
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.exists():
                broken.append(f"{path.relative_to(site)}: {link}")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                broken.append(f"{path.relative_to(site)}: {link}: no such anchor")
    assert broken == []
    assert len(pages) > len(p3dof.__all__) + 30


def test_nothing_comes_from_a_network(pages):
    fetched = {link for page in pages.values() for link in page.loads if urlsplit(link).netloc}
    assert fetched == set()


def test_every_command_is_described(inventory):
    options = inventory["std:cmdoption"]
    context = click.Context(app)
    for name in app.list_commands(context):
        for option in app.get_command(context, name).params:
            shown = option.metavar if isinstance(option, click.Argument) else option.opts[0]
            assert f"p3dof-{name}.{shown}" in options
    assert len(options) > 50


def test_notebooks_are_shown_with_their_results(site):
    for notebook in (ROOT / "notebooks").glob("*.ipynb"):
        page = (site / "tutorials" / f"{notebook.stem}.html").read_text(encoding="utf-8")
        assert "cell_output" in page
        assert re.search(r'<img[^>]*src="\.\./_images/', page)


def test_formulas_are_drawn(site):
    page = (site / "explanation/reduced-form.html").read_text(encoding="utf-8")
    assert page.count('<svg class="formula"') > 10
    assert "$$" not in page
