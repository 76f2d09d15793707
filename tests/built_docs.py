"""The documentation as it was built: `make docs` runs this on the folder that ``--site`` names."""

from __future__ import annotations

import contextlib
import re
import threading
from functools import cache, partial
from html import unescape
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote_plus, unquote, urlsplit

import api_examples
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

FIRST = {
    "own robot": "how-to/another-closed-loop-robot.html",
    "degrees": "how-to/motion-files.html",
    "payload": "how-to/your-own-machine.html",
    "Stewart": "how-to/gallery.html#stewart-platform",
    "Delta": "how-to/gallery.html#delta-robot",
    "URDF": "how-to/urdf-meshcat-forces.html",
    "MeshCat": "how-to/urdf-meshcat-forces.html",
    "forces": "how-to/urdf-meshcat-forces.html",
    "MJCF": "how-to/another-closed-loop-robot.html",
    "counterbalance": "how-to/balance-the-sliders.html",
    "gas spring": "how-to/balance-the-sliders.html",
    "Pareto front": "how-to/better-machines.html",
    "motor": "how-to/choose-drives.html",
    "bearing": "how-to/drives-and-bearings.html",
    "singular configuration": "explanation/singularities.html",
    "tolerance": "how-to/uncertain-machines.html",
}
"""What readers search for, and the page that they are to find first."""
ACCESSIBLE = [
    "index.html",
    "how-to/plan-a-task.html",
    "how-to/many-designs.html",
    "reference/api/p3dof.load.html",
    "reference/api/p3dof.loops.html",
    "reference/cli.html",
    "reference/files.html",
    "reference/glossary.html",
    "tutorials/quick_start.html",
    "tutorials/from-a-task-to-a-machine.html",
    "explanation/reduced-form.html",
    "search.html",
]
"""A page of each kind, in which axe looks for what some readers could not use."""
AXE = ROOT / "page/node_modules/axe-core/axe.min.js"
NAMED = re.compile(r'<dt class="sig sig-object py" id="([^"]+)">')
"""Where the description of a name begins."""
WIDE = """() => [...document.querySelectorAll("pre")].filter(box => box.scrollWidth > box.clientWidth)
    .map(box => box.textContent.slice(0, 80))"""


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


def bare(text):
    """Characters that are seen of HTML, without spaces."""
    return "".join(unescape(re.sub(r"<[^>]*>", "", text)).split())


def test_every_function_and_class_shows_its_example(site):
    """In its own description: before those of a class's methods, and before the next name's."""
    examples = {name: example.text for example in api_examples.examples() for name in example.names}
    without = []
    for page, listed in api_examples.members().items():
        for name, _ in listed:
            full = f"{page}.{name}" if page else name
            path = site / f"reference/api/p3dof.{page or name}.html"
            _, *found = NAMED.split(path.read_text(encoding="utf-8"))
            described = dict(zip(found[::2], found[1::2], strict=True))
            if "".join(examples[full].split()) not in bare(described.get(f"p3dof.{full}", "")):
                without.append(full)
    assert without == []


def test_fields_of_named_tuples_have_their_own_text(site):
    pages = {path.name: path.read_text(encoding="utf-8") for path in site.glob("reference/api/*.html")}
    assert [name for name, text in pages.items() if "Alias for field number" in text] == []
    page = pages["p3dof.loops.html"]
    described = page[page.index('id="p3dof.loops.MotorSide.torque"') :].partition("</dl>")[0]
    assert "its own inertia included" in described


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


class Quiet(SimpleHTTPRequestHandler):
    """Serves files, and does not say so."""

    def log_message(self, *_):
        pass

    def handle(self):
        with contextlib.suppress(ConnectionError):  # of a page that is left before it is whole
            super().handle()


@pytest.fixture(scope="module")
def address(site):
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=site)) as server:
        threading.Thread(target=server.serve_forever).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_searches_find_the_right_page_first(browser, address):
    """By the script and the index of the site itself."""
    page = browser.new_page()
    found = {}
    for words in FIRST:
        page.goto(f"{address}/search.html?q={quote_plus(words)}")
        first = page.wait_for_selector("#search-results li a")
        found[words] = urlsplit(first.get_attribute("href"))._replace(query="").geturl().removeprefix("./")
    page.close()
    assert found == FIRST


def test_code_fits_its_box_and_the_console_is_silent(browser, address, site, pages):
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    said, wide = [], {}
    page.on("pageerror", lambda error: said.append(str(error)))
    # What Chromium says of its own graphics driver is none of the page's.
    page.on("console", lambda line: "GL Driver Message" in line.text or said.append(line.text))
    for path in pages:
        page.goto(f"{address}/{path.relative_to(site)}")
        if boxes := page.evaluate(WIDE):
            wide[path.name] = boxes
    page.close()
    assert wide == {}
    assert said == []


@pytest.mark.parametrize("width", [390, 1280])
def test_the_machine_on_the_front_page_is_large(browser, address, width):
    page = browser.new_page(viewport={"width": width, "height": 844})
    page.goto(f"{address}/index.html")
    frame = page.wait_for_selector("iframe.machine").bounding_box()
    beyond = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    page.close()
    assert frame["height"] >= 320
    assert beyond == 0


@pytest.mark.parametrize("width", [390, 1280])
def test_axe_finds_nothing_serious(browser, address, width):
    if not AXE.exists():
        pytest.skip("axe-core is not installed: `make page-check` installs what page/ needs")
    page = browser.new_page(viewport={"width": width, "height": 844})
    found = {}
    for name in ACCESSIBLE:
        page.goto(f"{address}/{name}")
        page.evaluate(AXE.read_text(encoding="utf-8"))
        report = page.evaluate("""async () => (await axe.run()).violations.map(
            ({id, impact, nodes}) => [id, impact, nodes.map(({html}) => html.slice(0, 120))])""")
        if serious := [entry for entry in report if entry[1] in ("serious", "critical")]:
            found[name] = serious
    page.close()
    assert found == {}
