"""The page in a notebook: static in a frame, and live through the messages of a widget.

The browser runs the widget's own module with a model as anywidget gives it; what that sends goes to the real
widget in Python, and back. A real notebook is tried by hand.
"""

from __future__ import annotations

import base64
import html
import re
import sys

import numpy as np
import pytest
from browser import opened, until

from p3dof._base.errors import MissingExtraError
from p3dof.viewer.document.html import Page
from p3dof.viewer.machine.document import page_document

pytest.importorskip("anywidget", reason="anywidget is not installed")

import p3dof
from p3dof.viewer.live_viewer import LiveViewer

HARNESS = (
    """<!doctype html><meta charset="utf-8"><title>cell</title><div id="one"></div><div id="two"></div>"""
)
START = """
async ([esm, title]) => {
    const listeners = new Map();
    window.model = {
        get: (name) => ({ title, height: 700 })[name],
        on: (name, listener) => listeners.set(name, [...(listeners.get(name) || []), listener]),
        off: (name, listener) => listeners.set(name, listeners.get(name).filter((one) => one !== listener)),
        send: (content) => toPython(content),
    };
    window.fromPython = (content, buffers) => {
        const views = buffers.map((text) => {  // a view that does not begin at zero, as a notebook's do
            const binary = atob(text), bytes = new Uint8Array(binary.length + 4);
            for (let i = 0; i < binary.length; i++) bytes[i + 4] = binary.charCodeAt(i);
            return new DataView(bytes.buffer, 4);
        });
        for (const listener of listeners.get("msg:custom") || []) listener(content, views);
    };
    const url = URL.createObjectURL(new Blob([esm], { type: "text/javascript" }));
    const { default: widget } = await import(url);
    window.ends = ["one", "two"].map((id) => widget.render({ model, el: document.getElementById(id) }));
    window.listening = () => (listeners.get("msg:custom") || []).length;
}
"""


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


def shown(robot, samples=11):
    return page_document(robot, p3dof.paper_motion(samples)) | {"engine": {"kind": "none"}}


class Cell:
    """A cell of a notebook with the widget of a viewer: what passes between them is passed on by `run`."""

    def __init__(self, page, widget):
        self.page, self.sent, self.said = page, [], []
        widget.send = lambda content, buffers=None: self.sent.append((content, buffers or []))
        self.widget = widget
        page.expose_function("toPython", self.hear)
        page.set_content(HARNESS)
        page.evaluate(START, [widget._esm, widget.title])

    def hear(self, content):
        self.said.append(content)

    def run(self, condition):
        """Pass messages on until something holds."""

        def passed():
            while self.said:
                self.widget._msg_callbacks(self.widget, self.said.pop(0), [])
            while self.sent:
                content, buffers = self.sent.pop(0)
                texts = [base64.b64encode(one).decode() for one in buffers]
                self.page.evaluate("([content, texts]) => fromPython(content, texts)", [content, texts])
            return condition()

        until(self.page, passed)

    def frames(self):
        return [frame for frame in self.page.frames[1:] if frame.evaluate("() => !!window.p3dof")]

    def all(self, condition):
        frames = self.frames()
        return len(frames) == 2 and all(frame.evaluate(condition) for frame in frames)


@pytest.fixture
def cell(browser, robot):
    viewer = LiveViewer(shown(robot), run_of, port=0)
    context = browser.new_context(viewport={"width": 900, "height": 800})
    errors = []
    page = context.new_page()
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    outside = []
    page.on("request", lambda request: outside.append(request.url))
    try:
        yield viewer, Cell(page, viewer.widget())
        assert errors == []
        assert [url for url in outside if not url.startswith(("blob:", "data:", "about:"))] == []
    finally:
        context.close()
        viewer.stop()


def run_of(samples):
    return shown(p3dof.load(), samples)["runs"][0]


def test_a_static_page_in_a_notebook_needs_no_python(browser, robot, tmp_path):
    page = Page(shown(robot))
    text = page._repr_html_()
    assert 'sandbox="allow-scripts allow-downloads"' in text
    inner = html.unescape(re.search(r'srcdoc="(.*?)" sandbox', text, re.DOTALL)[1])
    assert inner == page.html == page.save(tmp_path / "page.html").read_text()
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!doctype html><meta charset='utf-8'><title>cell</title>{text}")
    with opened(browser, notebook.as_uri(), ready="true", width=900, height=800) as watched:
        frame = watched.page.frames[1]
        frame.wait_for_function("() => window.p3dof && p3dof.ready.then(() => true)")
        frame.evaluate("() => p3dof.seek(0.5)")
        assert frame.evaluate("() => p3dof.instant().time") == 0.5
        assert frame.evaluate("() => p3dof.state.connection") is None
        assert watched.errors == []


def test_a_widget_shows_pages_that_python_sends_runs_to(cell):
    viewer, notebook = cell
    notebook.run(lambda: notebook.all("() => p3dof.ready.then(() => p3dof.state.connection.open)"))
    for frame, time in zip(notebook.frames(), (0.25, 0.75), strict=True):
        frame.evaluate("time => p3dof.seek(time)", time)
    viewer.show(101, name="finer")
    notebook.run(
        lambda: notebook.all("() => p3dof.state.document.runs.length === 2 && p3dof.state.run === 1")
    )
    run = p3dof.load().inverse_dynamics(p3dof.paper_motion(101))
    for frame, time in zip(notebook.frames(), (0.25, 0.75), strict=True):  # each has its own time
        seen = frame.evaluate("() => [p3dof.instant().time, p3dof.instant().values.force_a]")
        row = round(100 * time)
        np.testing.assert_allclose(seen, [time, run.forces[row, 0]], rtol=1e-12)


def test_a_widget_goes_on_when_python_ends_and_leaves_nothing_behind(cell):
    viewer, notebook = cell
    notebook.run(lambda: notebook.all("() => p3dof.ready.then(() => p3dof.state.connection.open)"))
    viewer.stop()
    notebook.run(lambda: notebook.all("() => !p3dof.state.connection.open"))
    frame = notebook.frames()[0]
    assert "Python has ended it" in frame.inner_text("#connection")
    frame.evaluate("() => p3dof.seek(0.5)")
    assert frame.evaluate("() => p3dof.instant().time") == 0.5
    notebook.page.evaluate("() => ends.forEach((end) => end())")
    assert notebook.page.evaluate("() => listening()") == 0


def test_a_viewer_in_a_cell_is_the_widget_and_else_a_frame(robot, monkeypatch):
    with LiveViewer(shown(robot), port=0) as viewer:
        data, _ = viewer._repr_mimebundle_()
        assert "application/vnd.jupyter.widget-view+json" in data
        assert viewer.url in data["text/html"]
        viewer.stop()
        assert "srcdoc=" in viewer._repr_mimebundle_()["text/html"]
        viewer.start()
        monkeypatch.setitem(sys.modules, "anywidget", None)  # not installed
        monkeypatch.delitem(sys.modules, "p3dof.viewer.widget")
        with pytest.raises(MissingExtraError, match=r"pip install 'p3dof\[jupyter\]'"):
            viewer.widget()
        data = viewer._repr_mimebundle_()
        assert "application/vnd.jupyter.widget-view+json" not in data
        assert viewer.url in data["text/html"]
