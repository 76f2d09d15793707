"""A real browser for the tests: Chromium of the system, driven by playwright, with no names to resolve."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from p3dof.viewer import headless

FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-quic",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
WALK = """
window.nodeOf = (path) => {  // never `scene_tree.find`: it makes what is missing
    let node = viewer.scene_tree;
    for (const name of path.split("/")) node = node && node.children[name];
    return node || null;
};
window.placeOf = (path) => {  // 4x4 in rows, relative to the fixed frame of the machine
    const node = nodeOf(path), root = nodeOf("meshcat");
    if (!node || !root) return null;
    node.object.updateWorldMatrix(true, false);
    root.object.updateWorldMatrix(true, false);
    const place = root.object.matrixWorld.clone().invert().multiply(node.object.matrixWorld);
    return place.transpose().toArray();
};
window.tipsOf = (paths) => paths.map((path) => {  // of arrows, in the picture: from -1 to 1
    const node = nodeOf(path + "/head");
    node.object.updateWorldMatrix(true, false);
    viewer.camera.updateWorldMatrix(true, false);
    const tip = viewer.camera.position.clone().set(0, 0, 1).applyMatrix4(node.object.matrixWorld);
    const seen = tip.project(viewer.camera);
    return [seen.x, seen.y];
});
"""

BLIND = """{  // without a graphics card drawing in WebGL takes most of the time: only `Watched.see` begins it
    window.blind = true;
    const fail = () => { throw new Error("a blind page has no picture"); };
    const drawn = (canvas) => canvas instanceof HTMLCanvasElement && !canvas.getContext("2d") && fail();
    const change = (type, name, then) => {
        const {prototype} = type, own = prototype[name];
        prototype[name] = function (...all) { return blind && then(this, ...all) || own.apply(this, all); };
    };
    for (const type of [WebGLRenderingContext, WebGL2RenderingContext])
        for (const name of Object.getOwnPropertyNames(type.prototype))
            if (/^draw[EAR]|^readPixels/.test(name)) change(type, name, name[0] === "d" ? () => true : fail);
    change(CanvasRenderingContext2D, "drawImage", (_, source) => drawn(source));
    change(HTMLCanvasElement, "toDataURL", drawn);
}"""


@dataclass
class Watched:
    """A page, with all that went wrong in it and all that it asked for."""

    page: Any
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def see(self) -> None:
        """Have WebGL draw from now on, for what looks at pixels."""
        self.page.evaluate("blind = false")

    def place(self, path: str) -> np.ndarray:
        """Where a node of the scene is, relative to the fixed frame of the machine, (4, 4)."""
        matrix = self.page.evaluate("path => placeOf(path)", path)
        assert matrix is not None, f"no {path} in the page"
        return np.reshape(matrix, (4, 4))

    def places(self, paths: list[str]) -> np.ndarray:
        """Those of several at one instant, (len(paths), 4, 4)."""
        found = self.page.evaluate("paths => paths.map(placeOf)", paths)
        assert all(found), "not all are in the page"
        return np.reshape(found, (-1, 4, 4))

    def tips(self) -> np.ndarray:
        """Where the tips of the arrows are in the picture, that of the legend too, (4, 2)."""
        arrows = ["meshcat/forces/a", "meshcat/forces/b", "meshcat/forces/c", "meshcat/legend/arrow"]
        return np.array(self.page.evaluate("paths => tipsOf(paths)", arrows))

    def wait(self, condition: str, argument: Any = None, timeout: float = 60.0) -> None:
        """Wait until a JavaScript condition holds: an expression, or a function of the argument."""
        function = condition if "=>" in condition else f"() => {condition}"  # no eval under the page's policy
        self.page.wait_for_function(function, arg=argument, polling=30, timeout=1000 * timeout)

    def outside(self) -> list[str]:
        """Requests that left the page's own host."""
        own = urlsplit(self.page.url).netloc
        return [
            url
            for url in self.requests
            if urlsplit(url).scheme not in ("data", "blob") and urlsplit(url).netloc != own
        ]

    def healthy(self) -> None:
        """Assert that nothing went wrong and nothing left this machine."""
        assert self.errors == []
        assert self.outside() == []


def until(page: Any, condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait until something of Python holds; the page goes on meanwhile."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came to that"
        page.wait_for_timeout(50)


def eventually(page: Any, check: Callable[..., object], *arguments: Any, seconds: float = 60.0) -> None:
    """Wait until a check of what a live page shows passes: its messages come one after another."""
    end = time.monotonic() + seconds
    while True:
        try:
            check(*arguments)
            return
        except AssertionError:
            if time.monotonic() > end:
                raise
        page.wait_for_timeout(50)


def find_chromium() -> str:
    """The browser's path; skips the test, saying why, where there is none."""
    pytest.importorskip("playwright", reason="playwright is not installed")
    path = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, headless.NAMES)), None)
    if path is None:
        pytest.skip("no Chromium is installed (" + ", ".join(headless.NAMES) + ")")
    return path


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """A running browser, whose pages draw in WebGL only from `Watched.see` on."""
    path = find_chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        own = browser.new_context

        def new_context(**settings: Any) -> Any:
            context = own(**settings)
            context.add_init_script(BLIND)
            return context

        browser.new_context = new_context  # type: ignore[method-assign]
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def opened(
    browser: Any, url: str, width: int = 700, height: int = 480, ready: str = "!!window.viewer"
) -> Iterator[Watched]:
    """A page at a URL, in a context of its own."""
    context = browser.new_context(viewport={"width": width, "height": height})
    try:
        page = context.new_page()
        watched = Watched(page)
        page.on("pageerror", lambda error: watched.errors.append(str(error)))
        page.on("console", lambda line: watched.errors.append(line.text) if line.type == "error" else None)
        page.on("request", lambda request: watched.requests.append(request.url))
        page.on("websocket", lambda socket: watched.requests.append(socket.url))
        page.add_init_script(WALK)
        page.goto(url)
        watched.wait(ready)
        yield watched
    finally:
        context.close()
