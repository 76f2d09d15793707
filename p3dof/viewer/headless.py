"""A browser without a window, to take pictures of pages: the system's Chromium, driven by playwright."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from p3dof._base.errors import InputError, MissingExtraError
from p3dof._base.files import scratch_folder

NAMES = (
    "chromium-headless-shell",  # the same engine without windows: it takes half the time
    "chrome-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "msedge",
)
"""Programs that will do, the first one found is taken; the environment's ``CHROMIUM`` goes before them."""
MAX_PIXELS = 4096
"""Largest width or height of a picture."""
_FLAGS = (
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-quic",
    "--hide-scrollbars",
)
SIZE = (960, 720)
"""Width and height of pictures and films [pixels]."""

_READY = "typeof viewer === 'object' && viewer.renderer.domElement.width > 0"
_HIDE = """
const parts = [viewer.gui.domElement, ...document.querySelectorAll('#licences, #player')];
for (const part of parts) part.style.display = 'none';
"""
_Result = TypeVar("_Result")


class Shooter:
    """Takes pictures of an open page: of a scene of MeshCat."""

    def __init__(self, page: Any) -> None:
        self._page = page
        page.wait_for_function(_READY)
        page.evaluate(_HIDE)

    def picture(self, time: float | None = None) -> bytes:
        """Return the scene as PNG: as it is, or at a time of its animation [s]."""
        if time is not None:
            self._page.evaluate(
                "time => { viewer.animator.pause(); viewer.animator.seek(time); }", float(time)
            )
        self._page.evaluate("viewer.render()")
        return bytes(self._page.screenshot(type="png"))


class PageShooter(Shooter):
    """Likewise of a page of `p3dof.viewer.document`, of which only the machine is seen."""

    def __init__(self, page: Any) -> None:
        self._page = page
        page.evaluate("() => p3dof.ready.then(() => p3dof.picture())")

    def picture(self, time: float | None = None) -> bytes:
        """Return the machine as PNG: as it is, or at a time of the run [s]."""
        if time is not None:
            self._page.evaluate("time => p3dof.seek(time)", float(time))
        return bytes(self._page.screenshot(type="png"))


@contextmanager
def opened(html: str, size: tuple[int, int], shooter: type[Shooter] = Shooter) -> Iterator[Shooter]:
    """Open a page that needs nothing else, with the network off, to take pictures of it."""
    width, height = checked_size(size)
    with _page_of(html, viewport={"width": width, "height": height}) as page:
        yield shooter(page)


@contextmanager
def _page_of(html: str | Path, **context: Any) -> Iterator[Any]:
    with browser_of_system() as browser, scratch_folder() as folder:
        file = html if isinstance(html, Path) else folder / "page.html"
        if isinstance(html, str):
            file.write_text(html, encoding="utf-8")
        page = browser.new_context(offline=True, **context).new_page()
        page.goto(file.absolute().as_uri())
        yield page


def picture_of(
    html: str, size: tuple[int, int], time: float | None = None, shooter: type[Shooter] = Shooter
) -> bytes:
    """Return a page as PNG; see `opened` and `Shooter.picture`."""

    def take() -> bytes:
        with opened(html, size, shooter) as taking:
            return taking.picture(time)

    return aside(take)


def pdf_of(html: str | Path) -> bytes:
    """Return a page, or one in a file, as PDF: as its style sheet has it for print.

    Without scripts, with the network off; with the title and page numbers on each page, an outline of the
    headings, and tags for screen readers.
    """
    style = "font: 8px sans-serif; width: 100%; margin: 0 14mm; color: #565656; display: flex; gap: 2em"
    number = "<span class='pageNumber'></span>&nbsp;/&nbsp;<span class='totalPages'></span>"
    title = "<span class='title' style='flex: 1; overflow: hidden; white-space: nowrap'></span>"

    def take() -> bytes:
        with _page_of(html, java_script_enabled=False) as page:
            pdf: bytes = page.pdf(
                prefer_css_page_size=True,
                print_background=True,
                display_header_footer=True,
                header_template="<span></span>",
                footer_template=f"<div style='{style}'>{title}<span>{number}</span></div>",
                outline=True,
                tagged=True,
            )
            return pdf

    return aside(take)


def aside(work: Callable[[], _Result]) -> _Result:
    """Do some work in a thread of its own: playwright does not start where an event loop runs (notebooks)."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).result()


@contextmanager
def browser_of_system() -> Iterator[Any]:
    """Run the system's browser."""
    sync_api = require_playwright()
    sandbox = () if os.name == "nt" or os.geteuid() else ("--no-sandbox",)  # as root it would not start
    with sync_api.sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(
                executable_path=find_browser(playwright), args=[*_FLAGS, *sandbox]
            )
        except sync_api.Error as error:
            reason = str(error).splitlines()[0]
            raise MissingExtraError(f"the browser for pictures does not start: {reason}") from error
        try:
            yield browser
        finally:
            browser.close()


def require_playwright() -> Any:
    """Return what drives a browser; raise `MissingExtraError` if it is not installed."""
    try:
        from playwright import sync_api
    except ImportError as error:
        raise MissingExtraError(
            "pictures and films need a browser without a window: pip install 'p3dof[video]', and Chromium"
        ) from error
    return sync_api


def find_browser(playwright: Any) -> str:
    """Return the path of a browser: the user's choice, the system's, or the one that playwright brings."""
    chosen = os.environ.get("CHROMIUM")
    found = chosen or next(filter(None, map(shutil.which, NAMES)), None)
    own: str = playwright.chromium.executable_path
    if found is None and not Path(own).exists():
        raise MissingExtraError(
            "pictures and films need Chromium or Chrome: install one, or run 'playwright install chromium'"
        )
    return found or own


def checked_size(size: Any) -> tuple[int, int]:
    """Return width and height as whole numbers of pixels."""
    fits = isinstance(size, tuple | list) and len(size) == 2 and all(type(n) is int for n in size)
    if not (fits and all(16 <= n <= MAX_PIXELS for n in size)):
        got = f"({size[0]}, {size[1]})" if fits else f"a {type(size).__name__}"
        raise InputError(f"size: expected width and height from 16 to {MAX_PIXELS} pixels, got {got}")
    return size[0], size[1]


def as_image(png: bytes) -> Any:
    """Return a picture as a `PIL.Image`."""
    try:
        from PIL import Image
    except ImportError as error:
        raise MissingExtraError("pictures need Pillow: pip install 'p3dof[viz]'") from error
    return Image.open(io.BytesIO(png)).convert("RGB")
