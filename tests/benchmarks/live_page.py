"""How long the live page takes: a run until two open pages show it, a question to Python and back.

Run from the top of the repository: ``.venv/bin/python tests/benchmarks/live_page.py``; it needs a Chromium.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

TOP = Path(__file__).parents[2]
sys.path[:0] = [str(TOP), str(TOP / "tests")]

from browser import chromium, opened  # noqa: E402

import p3dof  # noqa: E402

READY = "!!window.p3dof && p3dof.ready.then(() => p3dof.state.connection.open)"
ASK = """
async () => {
    const { connection, document } = p3dof.state, [input] = document.inputs;
    const q = [...p3dof.instant().q], times = [];
    for (let k = 0; k < 200; k++) {
        const begun = performance.now();
        const answer = await connection.ask({ q, inputs: { [input.key]: input.value + 1e-4 * k } });
        if (answer.refused) throw new Error(answer.refused);
        times.push(performance.now() - begun);
        await new Promise((done) => setTimeout(done, 5));
    }
    return times;
}
"""


def told(what: str, seconds: list[float]) -> None:
    low, middle, high = 1e3 * np.percentile(seconds, [0, 50, 95])
    print(f"{what}: {low:.2f} ms at best, {middle:.2f} median, {high:.2f} for 95 %")  # noqa: T201


def main() -> None:
    robot = p3dof.load()
    result = robot.inverse_dynamics(p3dof.paper_motion())
    with (
        chromium() as browser,
        robot.show(result, port=0, playing=False) as live,
        opened(browser, live.url, ready=READY) as one,
        opened(browser, live.url, ready=READY) as two,
    ):
        seconds = []
        for count in range(20):
            begun = time.perf_counter()
            live.show(result)
            for page in (one, two):
                page.page.wait_for_function(f"() => p3dof.state.connection.version === {count + 1}")
            seconds.append(time.perf_counter() - begun)
        told("1,001 samples to two pages until both show them", seconds)
    robot = p3dof.load_robot(TOP / "docs/_static/gallery/five_bar.urdf")
    with (
        chromium() as browser,
        p3dof.show_robot(robot, port=0) as live,
        opened(browser, live.url, ready=READY) as page,
    ):
        told("a five-bar asked of Python and back", [1e-3 * t for t in page.page.evaluate(ASK)])


if __name__ == "__main__":
    main()
