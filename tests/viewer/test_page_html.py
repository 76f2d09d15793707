"""The page of a document: one file, with the licences of what is in it, whatever texts the document has."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess

import pytest
from documents import ROOT

from p3dof._base.errors import FileError
from p3dof.viewer.document import html as page_template
from p3dof.viewer.document.html import page_html

PAGE = ROOT / "p3dof/viewer/document/page.html"
SMALL = {"format": 1, "title": "A", "scene": {}, "runs": []}


def test_a_document_is_in_the_page_whatever_texts_it_has():
    nasty = "</script><script>alert(1)</script><!--<script> @@DOCUMENT@@ @@ENGINE@@ \u2028 \\u003c & é"
    page = page_html(SMALL | {"title": nasty})
    kept = re.search(r'<script type="application/json" id="p3dof-document">(.*?)</script>', page, re.DOTALL)
    assert json.loads(kept[1])["title"] == nasty
    assert f"<title>{html.escape(nasty)}</title>" in page
    assert "<!--<script>" not in page
    assert page.count("<script") == PAGE.read_text().count("<script")


def test_the_page_carries_the_licences_of_what_is_in_it():
    page = page_html(SMALL)
    for holder in (
        "© 2010-2026 three.js authors",
        "(c) 2022 Leon Sorokin",
        "2019 The MessagePack Community",
        "2017 Matt D",
    ):
        assert holder in page
    assert page.count("The above copyright notice and this permission notice shall be included in") == 3
    assert page.count('THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND') == 3


def test_the_page_may_load_nothing_and_run_nothing_but_its_own_script():
    page = page_html(SMALL)
    policy = re.search(r'http-equiv="Content-Security-Policy" content="(.*?)"', page)[1]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "'wasm-unsafe-eval'" in policy
    assert "'unsafe-eval'" not in policy
    assert "connect-src" not in policy
    assert not re.search(r'(?:src|href)\s*=\s*["\']?(?:https?:)?//', page.partition("<script>")[0])


def test_two_builds_of_the_page_are_the_same_bytes_as_the_one_here():
    node = shutil.which("node")
    if node is None or not (ROOT / "page/node_modules").exists():
        pytest.skip("node is not installed, or `make page-check` has not installed what page/ needs")
    check = [node, ROOT / "page/build.mjs", "--check"]
    for _ in range(2):
        done = subprocess.run(check, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


DAMAGES = {
    "cut": lambda data: data[: len(data) // 2],
    "a byte short": lambda data: data[:-1],
    "empty": lambda _: b"",
    "missing": lambda _: None,
}


@pytest.mark.parametrize("name", ["page.html", "p3dof.wasm", "studio.html"])
@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_page_that_is_not_as_it_was_installed_is_told(name, damage, tmp_path, monkeypatch):
    """Half a page would be written as if it were one, and show nothing."""
    for file in ("page.html", "p3dof.wasm", "studio.html"):
        data = (PAGE.parent / file).read_bytes()
        data = damage(data) if file == name else data
        if data is not None:
            (tmp_path / file).write_bytes(data)
    monkeypatch.setattr(page_template, "files", lambda _: tmp_path)
    made = {
        "studio.html": lambda: page_template.template("studio.html", ("@@TITLE@@", "@@DOCUMENT@@")),
        "page.html": lambda: page_html(SMALL),
        "p3dof.wasm": lambda: page_html(SMALL | {"engine": {"kind": "p3dof"}}),
    }
    with pytest.raises(FileError, match=rf"{name}: is not as it was installed; install p3dof again"):
        made[name]()
