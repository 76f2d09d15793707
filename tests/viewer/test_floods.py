"""Live pages of any robot and in notebooks under floods of garbage and storms: they still answer."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import random
import signal
import socket
import struct
import threading
import urllib.parse
import urllib.request

import numpy as np
import psutil
import pytest
from damage import damaged
from gallery import GALLERY

pytest.importorskip("meshcat", reason="meshcat not installed")

from html_pages import document_of, frame, running_loop
from page_documents import unpacked_message
from tornado.websocket import WebSocketClosedError, websocket_connect

from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.session import Session

STORM, GARBAGE, QUESTIONS = 150, 60, 400
ROOM = 150_000_000
"""What a flood may leave in memory [bytes]: what waits for pages is bounded by less."""


def asked(document, number=1):
    """The question of a page where the robot stands."""
    (time, *_), q = document["runs"][0]["time"]["shape"], decoded(document["runs"][0]["q"])[0].tolist()
    assert time >= 1
    inputs = {one["key"]: one["value"] for one in document["inputs"]}
    return {"type": "ask", "id": number, "q": q, "inputs": inputs}


def answered(url, document, messages=()):
    """Ask as a page does, after other messages; return the answer to the last question."""
    return asyncio.run(asyncio.wait_for(_answered(url, document, messages), 60))


async def _answered(url, document, messages):
    address = url.replace("http://", "ws://").replace("/?", "/page?")
    page = await websocket_connect(address)
    number, answer, heard = 424_242, None, ""
    try:
        for message in (*messages, json.dumps(asked(document, number))):
            await page.write_message(message, binary=isinstance(message, bytes))
        while answer is None and heard is not None:
            heard = await page.read_message()
            found = json.loads(heard) if isinstance(heard, str) else unpacked_message(heard) if heard else {}
            answer = found if found.get("type") == "answer" and found["id"] == number else None
    except WebSocketClosedError:
        pass
    page.close()
    while heard is not None:  # the end is told once
        heard = await page.read_message()
    assert answer is not None, "the connection was closed"
    return answer


def storm(port, path, rng):
    """Connections that say something, or nothing, and are reset."""
    shake = (
        f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    ).encode()
    for k in range(STORM):
        with socket.create_connection(("127.0.0.1", port), timeout=60) as page, contextlib.suppress(OSError):
            page.sendall((b"", shake[: rng.randrange(len(shake))], shake, rng.randbytes(300))[k % 4])
            if k % 4 == 2 and k % 8 == 2:
                page.sendall(
                    rng.choice(
                        (rng.randbytes(500), frame(2, rng.randbytes(100)), frame(15), frame(1, b"\xff"))
                    )
                )
            page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close by a reset


def test_loop_show_answers_after_a_flood_and_takes_no_more_memory():
    rng = random.Random(1)  # noqa: S311 - no secret
    with running_loop(GALLERY / "five_bar.urdf") as (process, url):
        document, address = document_of(url), urllib.parse.urlsplit(url)
        question = json.dumps(asked(document)).encode()
        first = answered(url, document)
        assert first["refused"] == "nobody answers: the page computes by itself"
        own = psutil.Process(process.pid)
        before = own.memory_info().rss
        storm(address.port, f"/page?{address.query}", rng)
        spoilt = [damaged(question, "json", rng) for _ in range(GARBAGE)]
        for some in (spoilt, [json.dumps(asked(document, k)) for k in range(QUESTIONS)], ["x" * (1 << 20)]):
            with contextlib.suppress(
                AssertionError, WebSocketClosedError
            ):  # what sends too much is closed, with a reason
                answered(url, document, some)
        again = answered(url, document)
        assert again == first
        with urllib.request.urlopen(url, timeout=60) as answer:  # noqa: S310 - http
            assert answer.status == 200
        assert own.memory_info().rss < before + ROOM
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")


def test_a_widget_answers_after_a_flood(caplog):
    """Whatever a notebook passes on, of views that come and go."""
    pytest.importorskip("anywidget", reason="anywidget is not installed")
    from p3dof import load_robot
    from p3dof.viewer import RobotFigure, robot_document
    from p3dof.viewer.answers import RobotAnswers
    from p3dof.viewer.widget import PageWidget

    robot = load_robot(GALLERY / "five_bar.urdf")
    document = robot_document(robot, RobotFigure(robot, GALLERY / "five_bar.urdf"))
    session = Session(document, RobotAnswers(robot, decoded(document["runs"][0]["q"])[0]))
    widget, sent, rng = PageWidget(session, lambda: "<p>page</p>"), [], random.Random(2)  # noqa: S311 - no secret
    widget.send = lambda content, buffers=None: sent.append((content, buffers or []))
    plain = {"view": "1", "message": asked(document)}
    try:
        with caplog.at_level(logging.WARNING):
            for _ in range(QUESTIONS):
                with contextlib.suppress(ValueError, RecursionError):  # what is no JSON never gets here
                    widget._received(None, json.loads(damaged(json.dumps(plain).encode(), "json", rng)), [])
            widget._received(None, {"view": "2", "message": asked(document, 7)}, [])
            ended = threading.Event()
            session._work.put("end", ended.set)
            assert ended.wait(60)
        assert caplog.records == []
        told = [unpacked_message(parts[0]) for content, parts in sent if content.get("view") == "2"]
        assert told[-1]["id"] == 7
        assert np.isfinite(told[-1]["q"]).all()
    finally:
        session.stop()
