"""How heavy the page is and how fast it follows, in Chromium with software WebGL at 1400 x 860.

Times are those of the browser's own clock: an event is timed from its listener until the picture with it has
been handed over. Run with ``make benchmark``. Timings are never a test: machines differ.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

from rich.table import Table
from rounds import load_average, wide_console

sys.path.insert(0, str(Path(__file__).parents[1]))

import pages
from browser import chromium, opened

import p3dof
from p3dof.viewer.document.html import page_html
from p3dof.viewer.machine.document import page_document

READY = "!!window.p3dof && p3dof.ready.then(() => true)"
SECONDS = 4
FIRST = """() => {
    const start = performance.getEntriesByType("navigation")[0].startTime;
    return p3dof.ready.then(() => performance.now() - start);
}"""
PLAY = f"""() => new Promise((done) => {{
    const {{ state }} = p3dof, {{ stage }} = state;
    state.set({{ playing: true, loop: true, layers: {{ ...state.layers, map: true }} }});
    const [start, first] = [performance.now(), stage.frames];
    const wait = () => {{
        const passed = performance.now() - start;
        if (passed < {1000 * SECONDS}) return void requestAnimationFrame(wait);
        state.set({{ playing: false }});
        done(1000 * (stage.frames - first) / passed);
    }};
    wait();
}})"""
WATCH = """() => {
    let event = 0;
    window.delays = [];
    addEventListener("pointermove", () => { event = performance.now(); }, { capture: true });
    p3dof.state.stage.drawn.add(() => {
        if (event) delays.push(performance.now() - event);
        event = 0;
    });
}"""
PLACE = """() => {
    const { stage } = p3dof.state, { left, top } = stage.canvas.getBoundingClientRect();
    const [x, y] = stage.pixel(stage.contents.handles.P.position.toArray());
    return [x + left, y + top];
}"""
SOLVE = """() => {
    const delays = [];
    for (let i = 0; i < 40; ++i) {
        const start = performance.now();
        p3dof.state.set({ whatIf: { payload: 0.1 * i } });
        p3dof.state.refresh();
        delays.push(performance.now() - start);
    }
    p3dof.state.set({ whatIf: {} });
    return delays;
}"""
LENGTHS = SOLVE.replace("payload: 0.1 * i", "L: 0.4 + 0.002 * i")
MAP = """() => {
    const { state } = p3dof, delays = [];
    state.set({ layers: { ...state.layers, map: true } });
    for (let i = 0; i < 40; ++i) {
        state.set({ whatIf: { payload: 0.1 * i, L: 0.4 + 0.002 * i } });
        state.refresh();
        delays.push(p3dof.map().milliseconds);
    }
    state.set({ whatIf: {}, layers: { ...state.layers, map: false } });
    return delays;
}"""
FASTEST = """() => {
    const { state } = p3dof, delays = [];
    const poses = [[0, 0, 0], [0.12, 0.05, 0.3], [-0.1, 0.1, -0.3], [0, -0.05, 0]];
    const stop = { name: "", blend: 0, dwell: 0.1, duration: null, wrench: null };
    const waypoints = poses.map((pose) => ({ ...stop, pose })), pace = { ...state.pace, fastest: true };
    for (let i = 0; i < 20; ++i) {
        state.set({ task: { ...state.task, waypoints: [...waypoints] }, pace });
        state.refresh();
        delays.push(state.planned.milliseconds);
    }
    state.set({ task: { ...state.task, waypoints: [] } });
    state.refresh();
    return delays;
}"""
WHOLE = """() => {
    document.getElementById("panel").style.display = "none";
    document.getElementById("page").style.gridTemplateColumns = "1fr";
    document.getElementById("main").style.gridTemplateRows = "1fr 0 0";
    document.getElementById("stage").style.height = "860px";
}"""


def main() -> None:
    """Print what was measured."""
    machine = p3dof.Manipulator()
    page = page_html(page_document(machine, machine.inverse_dynamics(p3dof.paper_motion())))
    table = Table(title=f"The page with 1,001 samples; {load_average()}")
    for head in ("what", "is", "wanted"):
        table.add_column(head)
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        file = Path(folder) / "page.html"
        file.write_text(page, encoding="utf-8")
        table.add_row("size", f"{len(page.encode()) / 1000:.0f} kB", "≤ 1200 kB")
        for row in _measured(browser, file.as_uri()):
            table.add_row(*row)
    wide_console().print(table)


def _measured(browser: Any, url: str) -> list[tuple[str, str, str]]:
    with opened(browser, url, 1400, 860, ready=READY) as watched:
        page = watched.page
        rows = [("ready", f"{page.evaluate(FIRST) / 1000:.2f} s", "≤ 3 s")]
        rows.append(("playing everything, map too", f"{page.evaluate(PLAY):.0f} frames/s", "≥ 20"))
        page.evaluate("() => p3dof.seek(0)")
        page.evaluate(WATCH)
        x, y = page.evaluate(PLACE)
        page.mouse.move(x, y)
        page.mouse.down()
        for i in range(120):
            page.mouse.move(x + 0.3 * i, y - 0.2 * i)
        page.mouse.up()
        delays = page.evaluate("() => delays")
        rows.append(("from a drag event to all shown, median", _median(delays), "≤ 10 ms"))
        delays = page.evaluate(SOLVE)
        rows.append(("1,001 samples solved and redrawn, median", _median(delays), "≤ 50 ms"))
        rows.append(("the same, worst", f"{max(delays):.1f} ms", ""))
        rows.append(("the same with other lengths, median", _median(page.evaluate(LENGTHS)), "≤ 50 ms"))
        rows.append(("map of 81 x 61 poses, median", _median(page.evaluate(MAP)), "≤ 5 ms"))
        rows.append(("fastest way through four waypoints, median", _median(page.evaluate(FASTEST)), ""))
        delays = page.evaluate(pages.LONG_RUN)["long"]
        rows.append(("three charts of 100,001 samples redrawn, quickest", f"{min(delays):.1f} ms", "≤ 33 ms"))
        page.evaluate(WHOLE)
        watched.wait("p3dof.state.stage.width === 1400")
        rows.append(("playing, the picture alone in the window", f"{page.evaluate(PLAY):.0f} frames/s", ""))
        return rows


def _median(delays: list[float]) -> str:
    return f"{statistics.median(delays):.1f} ms"


if __name__ == "__main__":
    main()
