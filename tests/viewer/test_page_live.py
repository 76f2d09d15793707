"""The live page in a real browser: it has its own time, shows what Python sends, and outlives its Python."""

from __future__ import annotations

import base64

import numpy as np
import pytest
from browser import opened, until

pytest.importorskip("tornado", reason="tornado is not installed")

from p3dof.viewer.live_viewer import LiveViewer
from p3dof.viewer.session import Session

READY = "!!window.p3dof && p3dof.ready.then(() => true)"
CONNECTED = "p3dof.state.connection.open"


def table(values):
    array = np.asarray(values, dtype=float)
    return {
        "shape": list(array.shape),
        "dtype": "float64",
        "base64": base64.b64encode(array.tobytes()).decode(),
    }


def run(name, heights):
    heights = np.asarray(heights, dtype=float)
    return {
        "name": name,
        "time": table(np.linspace(0.0, 1.0, len(heights))),
        "q": table(heights[:, None]),
        "curves": [
            {
                "key": "force",
                "label": "A",
                "group": "Actuator forces",
                "unit": "N",
                "values": table(10 * heights),
            }
        ],
        "loads": [],
        "notes": [],
    }


def carriage():
    joint = {"name": "rail", "parent": -1, "placement": [0, 0, 0, 0, 0, 0, 1], "kind": "prismatic"}
    return {
        "format": 1,
        "title": "A carriage",
        "generator": {},
        "machine": {"name": "carriage", "hash": ""},
        "scene": {
            "centre": [0, 0, 0],
            "radius": 1.0,
            "floor": -1.0,
            "joints": [{**joint, "axis": [0, 0, 1], "q": [0, 1]}],
            "solids": [],
            "labels": [],
            "lines": [],
            "layers": [],
        },
        "runs": [run("up", [0.0, 0.25, 0.5])],
        "closures": [],
        "inputs": [
            {"key": "rail", "label": "rail", "unit": "m", "low": -1, "high": 1, "value": 0, "joint": 0}
        ],
        "limits": {},
        "engine": {"kind": "ask"},
    }


def answered(question):
    from p3dof._base.errors import InputError

    height = question["inputs"]["rail"]
    if abs(height) > 1.0:
        raise InputError("rail: expected -1 to 1 m")
    return {"q": np.array([height]), "values": {"force": 10 * height}}


@pytest.fixture
def viewer():
    with LiveViewer(carriage(), lambda result: result, answered, port=0) as running:
        yield running


def shown(page):
    """Time, joints and force of one frame."""
    return page.page.evaluate(
        "() => { const i = p3dof.instant(); return [i.time, i.q[0], i.values.force ?? null]; }"
    )


def test_the_token_leaves_the_address_and_the_page_can_be_loaded_again(browser, viewer):
    with opened(browser, viewer.url, ready=READY) as page:
        page.wait(CONNECTED)
        assert page.page.url == f"http://127.0.0.1:{viewer.server.port}/"
        assert page.page.evaluate("() => sessionStorage.getItem('p3dof-token')") == viewer.server.token
        page.healthy()
        page.page.reload()
        page.wait(READY)
        page.wait(CONNECTED)
        assert page.page.url == f"http://127.0.0.1:{viewer.server.port}/"
        stranger = browser.new_context()
        try:
            other = stranger.new_page()
            assert other.goto(page.page.url).status == 403
            assert "p3dof" not in other.evaluate("() => Object.keys(window)")
        finally:
            stranger.close()


def test_two_pages_have_two_cursors_and_a_pushed_run_reaches_both(browser, viewer):
    with opened(browser, viewer.url, ready=READY) as one, opened(browser, viewer.url, ready=READY) as two:
        for page, time in ((one, 0.2), (two, 0.75)):
            page.wait(CONNECTED)
            page.page.evaluate("time => p3dof.seek(time)", time)
        for count in range(3):
            viewer.show(run("up", np.linspace(0.0, 0.5, 5 + count)))
        viewer.show(run("far", np.linspace(0.0, 2.0, 10_000)))
        for page, time in ((one, 0.2), (two, 0.75)):
            page.wait("p3dof.state.document.runs.length === 2 && p3dof.state.run === 1")
            np.testing.assert_allclose(shown(page), [time, 2 * time, 20 * time], atol=1e-12)
            assert page.page.evaluate("() => p3dof.state.document.runs[0].time.data.length") == 7
            page.healthy()
        viewer.seek(0.5)
        for page in (one, two):
            page.wait("p3dof.state.time === 0.5")


def test_a_page_opened_later_has_what_was_sent_before(browser, viewer):
    viewer.show(run("later", [1.0, 1.0]), name="by another name")
    with opened(browser, viewer.url, ready=READY) as page:
        page.wait(CONNECTED)
        names = page.page.evaluate("() => p3dof.state.document.runs.map((run) => run.name)")
        assert names == ["up", "by another name"]
        viewer.session.show_document({**carriage(), "title": "Another one", "runs": [run("only", [0.5])]})
        page.wait("p3dof.state.document.title === 'Another one'")
        assert shown(page) == [0.0, 0.5, 5.0]
        assert page.page.title() == "Another one"


def test_python_answers_what_the_page_cannot_compute(browser, viewer):
    with opened(browser, viewer.url, ready=READY) as page:
        page.wait(CONNECTED)
        page.page.evaluate("() => p3dof.state.engine.move({ inputs: { rail: 0.875 } })")
        page.wait("p3dof.state.hand !== null")
        assert shown(page)[1:] == [0.875, 8.75]
        page.page.evaluate("() => p3dof.state.engine.move({ inputs: { rail: 3 } })")
        page.wait("p3dof.state.refused !== null")
        assert page.page.evaluate("() => p3dof.state.refused.text") == "rail: expected -1 to 1 m"
        assert shown(page)[1:] == [0.875, 8.75]
        page.healthy()


def test_python_can_follow_a_page(browser, viewer):
    seen = []
    viewer.follow(seen.append)
    with opened(browser, viewer.url, ready=READY) as page:
        page.wait(CONNECTED)
        page.page.evaluate("() => p3dof.seek(0.3)")
        page.wait("p3dof.state.connection.said.includes('0.3')")
        page.page.evaluate("() => p3dof.state.engine.move({ inputs: { rail: 0.5 } })")
        page.wait("p3dof.state.connection.said.includes('\"q\":[0.5]')")
        until(page.page, lambda: seen and seen[-1].get("q") == [0.5])
    assert seen[-1] == viewer.selection == {"time": 0.3, "run": 0, "q": [0.5]}


def test_a_page_outlives_its_python_and_finds_it_again(browser, viewer):
    with opened(browser, viewer.url, ready=READY) as page:
        page.wait(CONNECTED)
        viewer.stop()
        page.wait("!p3dof.state.connection.open")
        note = page.page.inner_text("#connection")
        assert "the viewer was closed" in note
        assert "what is stored is shown" in note
        page.page.evaluate("() => p3dof.seek(0.5)")
        assert shown(page) == [0.5, 0.25, 2.5]
        viewer.show(run("up", [0.0, 1.0]))  # while nobody looks
        viewer.start()
        page.wait("p3dof.state.connection.open && p3dof.state.document.runs[0].time.data.length === 2")
        assert shown(page) == [0.5, 0.5, 5.0]
        page.page.evaluate("() => p3dof.state.engine.move({ inputs: { rail: 0.25 } })")
        page.wait("p3dof.state.hand !== null")


def test_a_viewer_shows_itself_in_a_notebook(viewer):
    assert f'src="{viewer.url}"' in viewer._repr_html_()
    viewer.stop()
    assert "srcdoc=" in viewer._repr_html_()
    assert "stopped" in repr(viewer)
    assert isinstance(viewer.session, Session)
