"""The live page without a browser: who may connect, what pages are told, what they are answered."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import http.client
import json
import threading
import time
import urllib.error
import urllib.parse
import urllib.request

import numpy as np
import pytest
from page_documents import unpacked_message

from p3dof._base.errors import InputError

pytest.importorskip("tornado", reason="tornado is not installed")

from tornado.websocket import websocket_connect

from p3dof.viewer.connections import MAX_WAITING
from p3dof.viewer.live_viewer import PageServer
from p3dof.viewer.session import Session, packed_message

PAGE = "<!doctype html><title>page</title>"


def run(name="first", samples=5):
    return {"name": name, "time": np.linspace(0.0, 1.0, samples), "curves": []}


def answered(question):
    if question.get("inputs", {}).get("slide", 0.0) > 1.0:
        raise InputError("slide: out of reach")
    return {"q": np.array([1.0, 2.0]), "values": {"force": 3.0}}


@pytest.fixture
def session():
    made = Session({"title": "machine", "runs": [run()]}, answered)
    yield made
    made.stop()


@pytest.fixture
def server(session):
    with PageServer(session, lambda: PAGE, port=0) as running:
        yield running


def address(server, path="/", token=None, scheme="http"):
    query = urllib.parse.urlencode({"token": server.token if token is None else token})
    return f"{scheme}://127.0.0.1:{server.port}{path}?{query}"


def get(url, **headers):
    request = urllib.request.Request(url, headers=headers)  # noqa: S310 - http, as all of them here
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:  # noqa: S310
            return answer.status, answer.headers, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, error.read().decode()


def handshake(server, token=None, **headers):
    asked = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    key = {"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)) as connection:
        path = address(server, "/page", token).partition(f":{server.port}")[2]
        connection.request("GET", path, headers=asked | key | headers)
        with connection.getresponse() as answer:
            return answer.status


def silent_page(server):
    """A page that is connected, and never reads."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    path = address(server, "/page").partition(f":{server.port}")[2]
    asked = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    connection.request("GET", path, headers=asked | {"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="})
    with connection.getresponse() as answer:
        assert answer.status == 101
    assert eventually(lambda: server.pages == 1)
    return connection


async def page_of(server):
    """A page, and the hello that it was told."""
    page = await websocket_connect(address(server, "/page", scheme="ws"))
    return page, await heard(page)


async def bye(page):
    """Close a connection, and wait until it is."""
    page.close()
    while await page.read_message() is not None:
        pass


async def heard(page):
    message = await asyncio.wait_for(page.read_message(), 60)
    return json.loads(message) if isinstance(message, str) else unpacked_message(message)


def eventually(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return condition()


def test_a_message_keeps_every_bit_of_its_arrays():
    rng = np.random.default_rng(3)
    arrays = {
        "doubles": np.array([[np.nan, -0.0, np.pi], [np.inf, 1e-310, -1.0]]),
        "singles": rng.normal(size=(3, 5)).astype(np.float32)[:, ::2],  # not contiguous
        "shorts": np.arange(7, dtype=np.int16),
        "none": np.zeros((0, 3)),
        "big": np.arange(4, dtype=">u4"),
    }
    found = unpacked_message(packed_message({"type": "run", "deep": [arrays, b"bytes"], "plain": None}))
    assert found["type"] == "run"
    assert found["plain"] is None
    assert found["deep"][1].tobytes() == b"bytes"
    for name, array in arrays.items():
        got = found["deep"][0][name]
        assert got.shape == array.shape
        np.testing.assert_array_equal(got, array, strict=name != "big")
    with pytest.raises(ValueError, match="JSON"):
        packed_message({"plain": float("nan")})


def test_arrays_in_base64_go_as_bytes():
    values = np.linspace(0.0, 1.0, 1001)
    text = base64.b64encode(values.tobytes()).decode()
    message = packed_message({"run": {"time": {"shape": [1001], "dtype": "float64", "base64": text}}})
    assert len(message) < 8 * 1001 + 200
    np.testing.assert_array_equal(unpacked_message(message)["run"]["time"], values)


def test_the_page_has_a_token_and_may_reach_nothing_else(server):
    status, headers, content = get(server.url)
    assert (status, content) == (200, PAGE)
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'")
    assert f"connect-src ws://127.0.0.1:{server.port};" in policy
    assert "unsafe-eval'" not in policy.replace("'wasm-unsafe-eval'", "")
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store"
    for token in ("", "x", server.token[:-1], server.token + "x"):
        assert get(address(server, "/", token))[0] == 403
        assert handshake(server, token) == 403
    assert handshake(server) == 101


def test_a_page_loaded_again_finds_its_token_and_a_foreign_one_learns_nothing(server):
    status, headers, content = get(f"http://127.0.0.1:{server.port}/")
    assert status == 403
    assert "sessionStorage" in content
    assert server.token not in content
    assert PAGE not in content
    assert "unsafe-inline" not in headers["Content-Security-Policy"]
    assert "sessionStorage" not in get(address(server, "/", "wrong"))[2]  # and so it does not go on for ever


@pytest.mark.parametrize(
    "headers", [{"Host": "evil.example"}, {"Origin": "http://evil.example"}, {"Origin": "null"}]
)
def test_foreign_pages_are_refused(server, headers):
    assert get(server.url, **headers)[0] == 403
    assert handshake(server, **headers) == 403


def test_a_run_goes_to_all_pages_and_to_those_that_come_later(session, server):
    async def watch():
        (one, hello), (two, _) = await page_of(server), await page_of(server)
        assert (hello["type"], hello["version"], hello["follow"]) == ("hello", 0, False)
        assert session.show_run(run("second", 3)) == 1
        assert session.show_run(run("first", 4)) == 0
        for page in (one, two):
            told = [await heard(page), await heard(page)]
            assert [(m["type"], m["version"], m["index"], m["run"]["name"]) for m in told] == [
                ("run", 1, 1, "second"),
                ("run", 2, 0, "first"),
            ]
            assert told[1]["run"]["time"].shape == (4,)
        late, hello = await page_of(server)
        assert hello["version"] == 2
        await late.write_message(json.dumps({"type": "get"}))
        document = (await heard(late))["document"]
        assert [(one["name"], len(one["time"])) for one in document["runs"]] == [("first", 4), ("second", 3)]
        for page in (one, two, late):
            await bye(page)

    asyncio.run(watch())


def test_questions_are_answered_and_refused(server):
    async def ask():
        page, _ = await page_of(server)
        await page.write_message(json.dumps({"type": "ask", "id": 7, "inputs": {"slide": 0.5}}))
        answer = await heard(page)
        assert (answer["type"], answer["id"], answer["values"]) == ("answer", 7, {"force": 3.0})
        np.testing.assert_array_equal(answer["q"], [1.0, 2.0])
        await page.write_message(json.dumps({"type": "ask", "id": 8, "inputs": {"slide": 2}}))
        assert (await heard(page))["refused"] == "slide: out of reach"
        for bad, words in (
            ({"type": "quit"}, "type: expected get, ask, selection or waypoints, got 'quit'"),
            ({"type": "ask", "id": "x"}, "id: expected a whole number"),
            ({"type": "waypoints", "waypoints": 3}, "waypoints: expected a list"),
        ):
            await page.write_message(json.dumps(bad))
            answer = await heard(page)
            assert answer["type"] == "error"
            assert words in answer["message"]
        await bye(page)

    asyncio.run(ask())


def test_of_the_questions_of_a_page_that_wait_the_latest_is_answered(session):
    """A page that drags asks faster than a large machine is computed."""
    begun, go_on, done = threading.Event(), threading.Event(), []

    def slow(question):
        begun.set()
        assert go_on.wait(60)
        return {"q": np.array([question["inputs"]])}

    session._answerer = slow
    for number in range(50):
        session.received(
            {"type": "ask", "id": number, "inputs": number},
            "page",
            lambda data, _: done.append(unpacked_message(data)["id"]),
        )
        assert begun.wait(60)
    go_on.set()
    assert eventually(lambda: len(done) == 2)
    assert done == [0, 49]


def test_python_follows_a_page_only_if_it_wants_to(session, server):
    seen, ways = [], []

    async def look():
        page, hello = await page_of(server)
        assert not hello["follow"]
        await page.write_message(json.dumps({"type": "selection", "time": 0.1, "run": 0}))
        await page.write_message(json.dumps({"type": "get"}))
        await heard(page)
        assert session.selection is None
        session.follow("selection", seen.append)
        session.follow("waypoints", ways.append)
        assert (await heard(page))["follow"]
        await page.write_message(json.dumps({"type": "selection", "time": 0.2, "run": 0}))
        await page.write_message(json.dumps({"type": "waypoints", "waypoints": [{"pose": [0, 0, 0]}]}))
        assert await asyncio.to_thread(eventually, lambda: seen and ways)
        await bye(page)

    asyncio.run(look())
    assert seen == [session.selection] == [{"time": 0.2, "run": 0}]
    assert ways == [session.waypoints] == [[{"pose": [0, 0, 0]}]]


def test_a_page_that_is_dead_costs_nothing_and_the_others_go_on(session, server):
    """Ten thousand samples at a time, a hundred times: what waits for it is bounded, the latest is kept."""

    async def push():
        dead = await asyncio.to_thread(silent_page, server)
        handler = next(iter(server._channel.pages))
        alive, _ = await page_of(server)
        for count in range(100):
            session.show_run(run("long", 10_000 + count))
            assert len(handler._outbox) < MAX_WAITING
        latest = 0
        while latest < 10_099:
            message = await heard(alive)
            latest = len(message["run"]["time"])
        dead.close()
        await bye(alive)

    asyncio.run(push())
    assert eventually(lambda: server.pages == 0)


def test_nothing_is_left_at_the_end(session):
    before = {thread.name for thread in threading.enumerate()}
    with PageServer(session, lambda: PAGE, port=0) as server:
        asyncio.run(_ask_once(server))
        token, port = server.token, server.port
    session.stop()
    assert {thread.name for thread in threading.enumerate()} <= before
    with PageServer(session, lambda: PAGE, port, token) as again:  # an open page finds its way back
        assert get(again.url)[0] == 200
        asyncio.run(_ask_once(again))


async def _ask_once(server):
    page, _ = await page_of(server)
    await page.write_message(json.dumps({"type": "ask", "id": 1}))
    assert (await heard(page))["id"] == 1
    await bye(page)
