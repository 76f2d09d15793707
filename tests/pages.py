"""Pages with the paper's run for the tests of a browser: opened once for a module, as new for each test."""

from __future__ import annotations

import contextlib

import numpy as np
from browser import opened

import p3dof
from p3dof.viewer.document.html import page_html
from p3dof.viewer.machine.document import page_document

READY = "!!window.p3dof && p3dof.ready.then(() => true)"
SETTLED = "() => new Promise((done) => setTimeout(() => requestAnimationFrame(done)))"
"""Comes back when what was changed last is shown."""
AS_NEW = """() => {
    window.blind = true;
    const {state} = p3dof;
    if (!window.fresh) {
        const {document, engine, stage, connection, solved, before, report, set, subscribe, refresh, version,
            map, ...fields} = state;
        window.fresh = JSON.stringify(fields);
    }
    document.activeElement?.blur();
    history.replaceState(null, "", location.href.split("#")[0]);
    state.set(JSON.parse(fresh));
    state.refresh();
}"""
LONG_RUN = """() => {  // how long three charts of three curves take to be drawn anew [ms]
    const {document} = p3dof.state, [first] = document.runs;
    const run = (name, count) => {
        const table = (value) => ({
            shape: [count], data: Float64Array.from({length: count}, (_, i) => value(i / (count - 1))),
        });
        const curves = ["Forces", "Speeds", "Powers"].flatMap((group, g) => [1, 2, 3].map((k) => ({
            key: group + k, label: `${group} ${k}`, group, unit: "N", colour: "#0072b2",
            values: table((t) => k * Math.sin(20 * t + g) + Math.sin(3000 * t)),
        })));
        const q = {shape: [count, first.q.shape[1]], data: new Float64Array(count * first.q.shape[1])};
        return {name, time: table((t) => t), q, curves, loads: [], notes: []};
    };
    document.runs.push(run("short", 1001), run("long", 100001));
    const times = {short: [], long: []};
    for (let k = 0; k < 40; k++) {
        const at = document.runs.length - 1 - k % 2;
        p3dof.state.run = at;
        const start = performance.now();
        for (const chart of p3dof.charts) chart.draw();
        times[document.runs[at].name].push(performance.now() - start);
    }
    p3dof.state.run = document.runs.length - 1;
    for (const chart of p3dof.charts) chart.draw();
    times.points = p3dof.charts.map(({chart}) => chart.plot.data[0].length);
    times.widths = p3dof.charts.map(({chart}) => chart.plot.over.clientWidth);
    times.highest = p3dof.charts.map(({chart}) => Math.max(...chart.plot.data[1]));
    document.runs.splice(-2);
    p3dof.state.set({run: 0});
    return times;
}"""


def slower(samples=501, stretch=1.2):
    """The paper's motion in more time."""
    motion = p3dof.paper_motion(samples)
    velocity, acceleration = motion.velocity / stretch, motion.acceleration / stretch**2
    return p3dof.Motion(stretch * motion.time, motion.pose, velocity, acceleration)


def written(folder, result, **runs):
    """Write a page with a result and further runs; returns its address."""
    path = folder / "page.html"
    document = page_document(p3dof.Manipulator(), result, runs=runs)
    path.write_text(page_html(document), encoding="utf-8")
    return path.as_uri()


@contextlib.contextmanager
def shared(browser, address, width=1400, height=860):
    """A page for several tests, each of which begins with `as_new`."""
    with opened(browser, address, width, height, ready=READY) as watched:
        watched.page.evaluate(AS_NEW)
        yield watched


def as_new(watched):
    """Bring the state of a page back to that in which it came."""
    watched.page.mouse.move(5, 5)
    watched.page.evaluate(AS_NEW)
    watched.page.evaluate(SETTLED)
    return watched


PLACES = """() => [...p3dof.instant().placements]"""
DRAWN = "() => p3dof.state.stage.contents.arrows.drawn"


def placements(watched):
    """All joints in the fixed frame as the page draws them, shape (10, 4, 4)."""
    return np.reshape(watched.page.evaluate(PLACES), (-1, 4, 4)).transpose(0, 2, 1)
