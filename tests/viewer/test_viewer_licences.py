"""Every page that has JavaScript in it carries the notices of all whose script that is."""

from __future__ import annotations

import hashlib
import html
import importlib.metadata
import json
import re
import urllib.request
from pathlib import Path

import pytest
from documents import ROOT

import p3dof

pytest.importorskip("meshcat", reason="meshcat is not installed")
import meshcat

from p3dof.viewer import Scene
from p3dof.viewer.machine.scene import viewer
from p3dof.viewer.window import licences

DIST = Path(meshcat.__file__).parent / "viewer" / "dist"


def words(text):
    return " ".join(text.split())


@pytest.fixture(scope="module")
def notices():
    return words(licences())


@pytest.fixture(scope="module")
def sources():
    """What MeshCat's script is made of, from its version for developers, by file."""
    parts = re.split(r'\n/\*\*\*/ "(\./[^"]+)":', (DIST / "main.js").read_text(encoding="utf-8"))
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def test_the_notices_are_those_of_the_script_that_is_installed(notices):
    """A new MeshCat may bring others: then look at what is in it, and write their notices first."""
    digest = hashlib.sha256((DIST / "main.min.js").read_bytes()).hexdigest()
    version = importlib.metadata.version("meshcat")
    assert f"MeshCat {version}, main.min.js, sha256 {digest}" in notices


def test_every_package_in_it_is_named_with_its_version_and_copyright(notices):
    packages = json.loads((DIST / "main.min.js.THIRD_PARTY_LICENSES.json").read_text(encoding="utf-8"))
    assert len(packages) == 9
    for package in packages:
        assert f"{package['name']} {package['version']}" in notices
        assert package["license"] in notices
        lines = (package["licenseText"] or "").splitlines()
        copyrights = [words(line) for line in lines if re.match(r"\s*Copyright \D*\d{4}", line)]
        assert copyrights or package["name"] == "isarray"  # whose package has no file of it
        assert [line for line in copyrights if line not in notices] == []
    own = (DIST.parent / "LICENSE").read_text(encoding="utf-8")
    assert re.search(r"Copyright.*", own)[0] in notices


def test_every_file_in_it_is_of_a_package_that_is_named(notices, sources):
    found = {re.sub(r"^\./(?:node_modules/)?([^/]+)/.*", r"\1", name) for name in sources}
    assert found > {"three", "dat.gui", "three-wtm", "src"}
    for package in found - {"src"}:
        assert re.search(rf"(^|[ (]){re.escape(package)} \d", notices), package
    inner = {name.rpartition("/")[2] for name in sources if "/ccapture.js/" in name}
    assert inner == {"CCapture.js", "download.js", "gif.js", "tar.js"}
    for name in ("download.js 3.0", "gif.js 0.2.0", "tar-js", "NeuQuant", "events of Node.js", "webpack"):
        assert f"* {name}" in notices


def test_every_notice_in_its_sources_is_there(notices, sources):
    banner = (DIST / "main.min.js.LICENSE.txt").read_text(encoding="utf-8")
    pattern = re.compile(r"copyright .*|\(c\) \d{4} .*|\[CCBY2\].*", re.IGNORECASE)
    lines = [
        line for text in sources.values() for line in re.split(r"\\r|\\n|\\t", text)
    ] + banner.splitlines()
    said = [pattern.search(words(line.strip(" /*"))) for line in lines if len(line) < 500]
    found = {match[0].strip(" */,") for match in said if match}
    assert len(found) >= 5
    for line in found:
        assert line.removeprefix("copyright Yusuke").strip() in notices, line


@pytest.mark.parametrize(
    "line",
    [
        "Copyright (c) 2018 Robin Deits",
        "Copyright © 2010-2021 three.js authors",
        "Copyright (c) 2016, Mapbox",
        "Copyright (c) 2016-2021 Kai Salmen",
        "Copyright (c) 2021 Kai Salmen",
        "Copyright 2014, Google Inc.",
        "Copyright (c) 2015 Yusuke Kawasaki",
        "Copyright (c) 2015-2016 Yusuke Kawasaki",
        "Copyright 2008 Fair Oaks Labs, Inc.",
        "Copyright (c) 2013 Julian Gruber <julian@juliangruber.com>",
        "Copyright (c) 2012 Jaume Sanchez Elias",
        "Copyright (c) 2011 T. Jameson Little",
        "Copyright (c) 2013 Johan Nordberg",
        "Copyright (c) 1994 Anthony Dekker",
        "Copyright Joyent, Inc. and other Node contributors.",
        "Copyright JS Foundation and other contributors",
        "The above copyright notice and this permission notice shall be included in all copies",
        "Neither the name of the copyright holder nor the names of its contributors",
        "provided that the above copyright notice and this permission notice appear in all copies.",
        "with the only requirement being that this copyright notice remain intact.",
        "9. Accepting Warranty or Additional Liability.",
    ],
)
def test_copyrights_and_licences(notices, line):
    assert line in notices


def test_our_own_licence_is_there(notices):
    own = words((ROOT / "LICENSE").read_text(encoding="utf-8"))
    title, _, rest = own.partition(" Copyright")
    assert title == "BSD 2-Clause License"
    copyright_, _, terms = rest.partition(" Redistribution")
    assert f"Copyright{copyright_}" in notices
    assert f"Redistribution{terms}" in notices


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


def test_a_scene_that_stands_alone_carries_them(robot):
    page = Scene(robot).window.get_scene()
    assert "three.js" in page
    assert licences() in html.unescape(page)


def test_meshcats_live_page_links_them(robot):
    shown = viewer(robot, port=0)
    try:
        with urllib.request.urlopen(shown.viewer.url(), timeout=60) as answer:  # noqa: S310 - http
            link = re.search(r'<a id="licences" href="([^"]+)"', answer.read().decode())[1]
        address = shown.viewer.url().partition("?")[0] + link
        with urllib.request.urlopen(address, timeout=60) as answer:  # noqa: S310 - likewise
            assert answer.headers["Content-Type"].startswith("text/plain")
            assert answer.read().decode() == licences()
    finally:
        shown.viewer.close()
