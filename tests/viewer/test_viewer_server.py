"""The server, without a browser: who may connect, what is told, what is left at the end."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import http.client
import json
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from collections import Counter

import numpy as np
import psutil
import pytest
from html_pages import frame
from page_documents import unpacked_message

import p3dof
from p3dof._base.errors import InputError, ReachError

pytest.importorskip("meshcat", reason="meshcat is not installed")

import meshcat
import meshcat.geometry
import umsgpack
from tornado.websocket import websocket_connect

from p3dof.viewer.connections import BURST, MAX_PAGES, MAX_WAITING, Allowance, Outbox
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.host import PORT
from p3dof.viewer.live_viewer import MAX_MESSAGE
from p3dof.viewer.machine.scene import viewer
from p3dof.viewer.server import Server
from p3dof.viewer.window import SceneWindow

FILES = ("", "licences.txt", "pane.js", "fit.js", "scene.js", "meshcat.js")


@pytest.fixture
def window():
    return SceneWindow()


@pytest.fixture
def server(window):
    with Server(window, port=0) as running:
        yield running


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def result(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(51), method="virtual-power")


@pytest.fixture(scope="module")
def live(robot, result):
    with robot.show(result, port=0, playing=False) as running:
        yield running


def at(server, name="", token=None, scheme="http"):
    """The address of a file or websocket, with the server's token or another."""
    parts = urllib.parse.urlsplit(server.url)
    query = parts.query if token is None else urllib.parse.urlencode({"token": token})
    return urllib.parse.urlunsplit((scheme, parts.netloc, f"/{name}", query, ""))


def get(url, **headers):
    request = urllib.request.Request(url, headers=headers)  # noqa: S310 - http, as all of them here
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:  # noqa: S310
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, error.read()


def socket_at(server, name):
    return websocket_connect(at(server, name, scheme="ws"))


def handshake(server, name, token=None, **headers):
    """The status with which a websocket is answered: 101 when it is opened."""
    asked = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    key = {"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)) as connection:
        path = at(server, name, token).partition(f":{server.port}")[2]
        connection.request("GET", path, headers=asked | key | headers)
        with connection.getresponse() as answer:
            return answer.status


async def bye(page):
    """Close a connection, and wait until it is."""
    page.close()
    while await page.read_message() is not None:
        pass


async def talk(server, *messages):
    """What a page is told: hello, and the errors that answer its own messages."""
    page = await socket_at(server, "page")
    heard = [unpacked_message(await page.read_message())]
    for message in messages:
        await page.write_message(message)
        heard.append(json.loads(await page.read_message()))
    await bye(page)
    return heard


@contextlib.contextmanager
def raw_page(server, name):
    """The bare socket of a page, after the handshake."""
    path = at(server, name).partition(f":{server.port}")[2]
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as page:
        page.sendall(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += page.recv(1)
        assert answer.startswith(b"HTTP/1.1 101")
        yield page


@contextlib.contextmanager
def silent_page(server):
    """A page that opens the scene, and then neither reads nor answers."""
    before = len(server._scenes.pages)
    with raw_page(server, "scene") as page:
        assert eventually(lambda: len(server._scenes.pages) == before + 1)
        yield page


def eventually(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return condition()


def listening(pid=None):
    return {c.laddr for c in psutil.Process(pid).net_connections() if c.status == psutil.CONN_LISTEN}


def test_files(server):
    for name in FILES:
        status, headers, content = get(at(server, name))
        assert status == 200
        assert headers["Cache-Control"] == "no-store"
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert len(content) > 200
    for name in ("server.py", "../server.py", "%2e%2e/server.py", "meshcat.js/x"):
        assert get(at(server, name))[0] == 404
    assert re.fullmatch(rf"http://127\.0\.0\.1:{server.port}/\?token=[\w-]{{32}}", server.url)
    assert get(server.url)[1]["Referrer-Policy"] == "no-referrer"


def test_nothing_listens_beyond_this_machine(server):
    mine = {address for address in listening() if address.port == server.port}
    assert {address.ip for address in mine} == {"127.0.0.1"}
    others = [a.address for n in psutil.net_if_addrs().values() for a in n if a.family == socket.AF_INET]
    for address in others:
        if not address.startswith("127."):
            with socket.socket() as probe:
                probe.settimeout(2)
                assert probe.connect_ex((address, server.port)) != 0


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1.evil.example:{port}"},
        {"Host": "127.0.0.1:{port}@evil.example"},
        {"Origin": "http://evil.example"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "http://localhost:{port}"},
        {"Origin": "null"},
        {"Origin": "http://["},
        {"Origin": ""},
        {"Sec-WebSocket-Origin": "http://evil.example"},  # of drafts before the standard
        {"Sec-WebSocket-Origin": "http://evil.example", "Sec-WebSocket-Version": "8"},
        {"Sec-WebSocket-Origin": "http://evil.example", "Origin": "http://127.0.0.1:{port}"},
        {"WebSocket-Origin": "http://evil.example"},
    ],
)
def test_foreign_pages_are_refused(server, headers):
    headers = {name: value.format(port=server.port) for name, value in headers.items()}
    assert get(server.url, **headers)[0] in (400, 403)
    for name in ("scene",):
        assert handshake(server, name, **headers) in (400, 403)


@pytest.mark.parametrize("token", ["", "x", "x" * 32, "\u00e9", "{token}x", "{half}"])
def test_without_the_token_nothing_is_answered(server, token):
    own = server.url.partition("token=")[2]
    token = token.format(token=own, half=own[:16])
    for name in FILES:
        status, _, content = get(at(server, name, token))
        assert status == 403
        assert b"Open the whole address of the viewer, with its token" in content
    for name in ("scene",):
        assert handshake(server, name, token) == 403
    assert get(at(server, "").partition("?")[0])[0] == 403
    assert get(f"{server.url}&token=x")[0] == 403  # two of them


def test_every_server_has_a_token_of_its_own(window, server):
    with Server(window, port=0) as other:
        foreign = other.url.partition("token=")[2]
        assert get(at(server, "", foreign))[0] == 403
        assert handshake(server, "scene", foreign) == 403
        assert get(other.url)[0] == 200


@pytest.mark.parametrize("version", ["7", "8", "0", "76", "", "13, 8"])
def test_old_drafts_of_the_protocol_are_refused(server, version):
    own = f"http://127.0.0.1:{server.port}"
    for headers in ({}, {"Origin": own}, {"Sec-WebSocket-Origin": own}):
        assert handshake(server, "scene", **{"Sec-WebSocket-Version": version}, **headers) == 426


def test_hixie_is_refused(server):
    """Draft 76, whose handshake has a body and no version: it is answered without a 101."""
    path = at(server, "scene").partition(f":{server.port}")[2]
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as page:
        page.sendall(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nUpgrade: WebSocket\r\n"
            f"Connection: Upgrade\r\nOrigin: http://127.0.0.1:{server.port}\r\n"
            "Sec-WebSocket-Key1: 4 @1  46546xW%0l 1 5\r\nSec-WebSocket-Key2: 12998 5 Y3 1  .P00\r\n\r\n"
            "^n:ds[4U".encode()
        )
        assert page.recv(12) == b"HTTP/1.1 426"


def test_own_pages_are_not(server):
    own = f"127.0.0.1:{server.port}"
    assert get(server.url, Origin=f"http://{own}")[0] == 200
    assert handshake(server, "scene", Origin=f"http://{own}") == 101
    assert handshake(server, "scene") == 101  # a program, not a page
    assert (
        get(server.url, Host=f"localhost:{server.port}", Origin=f"http://localhost:{server.port}")[0] == 200
    )


def test_200_page_loads(live):
    async def load():
        assert (await asyncio.to_thread(get, live.url))[0] == 200
        page = await socket_at(live.server, "page")
        assert unpacked_message(await page.read_message())["type"] == "hello"
        await page.write_message('{"type": "get"}')
        assert unpacked_message(await page.read_message())["type"] == "document"
        await bye(page)

    async def loads():
        for _ in range(25):
            await asyncio.wait_for(asyncio.gather(*(load() for _ in range(8))), 20)

    before = set(threading.enumerate())  # the pools of other tests in this process among them
    asyncio.run(loads())
    assert eventually(lambda: live.pages == 0)
    assert eventually(lambda: set(threading.enumerate()) <= before)


def test_bad_messages_are_answered(live):
    bad = {
        "nonsense": "JSON",
        "[1]": "JSON object",
        "[" * 9000: "JSON",
        "{}": "type: expected get",
        '{"type": ["get"]}': "type: expected get",
        '{"type": "quit"}': "got 'quit'",
        '{"type": "ask", "id": 1.5}': "id: expected a whole number",
    }
    heard = asyncio.run(talk(live.server, *bad))
    assert heard[0]["type"] == "hello"
    for answer, words in zip(heard[1:], bad.values(), strict=True):
        assert words in answer["message"]


def test_a_long_message_ends_its_connection_only(live):
    async def shout():
        page = await socket_at(live.server, "page")
        await page.write_message("x" * (MAX_MESSAGE + 1))
        while await page.read_message() is not None:
            pass
        page.close()
        return page.close_code

    assert asyncio.run(shout()) == 1009
    assert asyncio.run(talk(live.server))[0]["type"] == "hello"


def answers(page):
    """All frames that a page is sent until the end of its connection: opcode and content."""
    data = b""
    with contextlib.suppress(ConnectionError):
        while more := page.recv(1 << 16):
            data += more
    found = []
    while len(data) >= 2:
        length, start = data[1], 2
        if length >= 126:
            start = {126: 4, 127: 10}[length]
            length = int.from_bytes(data[2:start], "big")
        found.append((data[0] & 0x0F, data[start : start + length]))
        data = data[start + length :]
    return found


def flood(server, frames):
    """Send all frames at once, and return what comes back until the connection is closed."""

    def send():
        with contextlib.suppress(OSError):
            page.sendall(frames)

    with raw_page(server, "page") as page:
        sender = threading.Thread(target=send)
        sender.start()
        try:
            return answers(page)
        finally:
            page.close()
            sender.join()


COUNT = 100_000
FLOODS = {
    "messages": frame(1, b"[]") * COUNT,
    "objects": frame(1, b'{"type": "time", "value": 0.25}') * COUNT,
    "parts of a message": frame(1, b"", final=False) + frame(0, b"", final=False) * COUNT,
    "pings": frame(9, b"x" * 100) * COUNT,
}


@pytest.fixture
def quiet(caplog, young):  # noqa: ARG001
    """Nothing is logged, by whomever; also of what is forgotten."""
    yield caplog
    gc.collect()
    assert [record.getMessage() for record in caplog.records] == []


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("kind", FLOODS)
def test_a_flood_ends_its_connection_with_a_reason(live, kind):
    heard = flood(live.server, FLOODS[kind])
    frames = Counter(opcode for opcode, _ in heard)
    code, reason = heard[-1][1][:2], heard[-1][1][2:].decode()
    assert (heard[-1][0], int.from_bytes(code, "big")) == (8, 1008)
    assert re.match(r"too many (messages: at most 200|pings: at most 1) a second", reason)
    assert frames[1] < 2 * BURST  # and not an error for every message
    assert frames[10] < 100
    assert eventually(lambda: live.pages == 0)


@pytest.mark.usefixtures("quiet")
def test_others_are_served_while_a_page_floods(live):
    """The flood begins anew whenever it is ended; meanwhile others get their answers."""
    ended, floods, longest = threading.Event(), [], []

    def flood_on():
        while not ended.is_set() and len(floods) < 50:
            floods.append(flood(live.server, FLOODS["messages"])[-1][0])

    def watch():
        while not ended.wait(0.002):
            pages = tuple(live.server._channel.pages)
            longest.append(max((len(page._outbox) for page in pages), default=0))

    threads = [threading.Thread(target=work) for work in (flood_on, flood_on, watch)]
    for thread in threads:
        thread.start()
    assert eventually(lambda: len(floods) >= 2)
    served, begun = 0, len(floods)
    while len(floods) < begun + 4:
        assert get(live.url)[0] == 200
        assert len(asyncio.run(talk(live.server, "{}"))) == 2
        served += 1
    ended.set()
    for thread in threads:
        thread.join()
    assert set(floods) == {8}
    assert served >= 4
    assert max(longest) <= 3  # the latest state, the latest error, and the setup


def test_a_page_that_sends_as_a_user_does_is_not_closed(live):
    seen = []
    live.follow(seen.append)

    async def drag():
        page = await socket_at(live.server, "page")
        for k in range(BURST - 20):
            await page.write_message(json.dumps({"type": "selection", "time": k / BURST, "run": 0}))
        await page.write_message("{}")
        while not isinstance(await page.read_message(), str):
            pass
        await bye(page)

    asyncio.run(drag())
    assert eventually(lambda: bool(seen) and seen[-1]["time"] == (BURST - 21) / BURST)


@pytest.mark.usefixtures("quiet")
def test_what_waits_for_a_page_that_does_not_read_is_bounded(window, server):
    """Objects cannot take each other's place: the page is closed, and comes back for the scene as it is."""
    drawn, ball = meshcat.Visualizer(window=window), meshcat.geometry.Sphere(0.1)
    with silent_page(server) as page:
        handler = next(iter(server._scenes.pages))
        most, count = 0, 0
        while handler in server._scenes.pages and count < 200_000:
            drawn["ball"].set_object(ball)
            most, count = max(most, len(handler._outbox), len(server._scenes.fresh)), count + 1
        assert eventually(lambda: not server._scenes.pages)
        assert 0 < most <= MAX_WAITING
        assert count > MAX_WAITING
        code = [int.from_bytes(content[:2], "big") for opcode, content in answers(page) if opcode == 8]
        assert code in ([], [1013])  # behind what it did not read
    assert len(server._scenes.fresh) == 0
    assert len(window.messages()) == 1


def test_an_outbox_keeps_the_latest_of_each_key_and_no_more_than_it_may():
    box = Outbox(most=3, most_bytes=10)
    assert box.put("aa", "a")
    assert box.put("bb", "b")
    assert box.put("cc")
    assert box.put("AAAAAA", "a")  # ten in all
    assert [box.pop()[1] for _ in range(3)] == ["bb", "cc", "AAAAAA"]
    assert box.pop() is None
    for message in "abc":
        assert box.put(message)
    assert not box.full
    assert not box.put("d")
    assert (box.full, len(box), box.pop()) == (True, 0, None)
    assert not box.put("e")
    assert not Outbox(3, 10).put("x" * 11)


def test_an_allowance_is_saved_up_to_the_burst():
    now = [0.0]
    allowance = Allowance(rate=2.0, burst=3.0, clock=lambda: now[0])
    assert [allowance.take() for _ in range(4)] == [True, True, True, False]
    now[0] += 0.5
    assert [allowance.take() for _ in range(2)] == [True, False]
    now[0] += 100
    assert [allowance.take() for _ in range(4)] == [True, True, True, False]


def test_there_is_a_most_number_of_pages(server):
    with contextlib.ExitStack() as pages:
        for _ in range(MAX_PAGES):
            pages.enter_context(raw_page(server, "scene"))
        assert handshake(server, "scene") == 503
    assert eventually(lambda: not server._scenes.pages)
    assert handshake(server, "scene") == 101


@pytest.mark.usefixtures("quiet")
def test_pages_that_close_in_the_middle_of_it_are_not_talked_about(live):
    """Cut off while it is greeted, and while a file is sent."""
    cut = struct.pack("ii", 1, 0)  # a reset instead of an end
    for _ in range(20):
        with raw_page(live.server, "page") as page:
            page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, cut)
    for _ in range(10):
        with raw_page(live.server, "page") as page:
            assert len(page.recv(10)) > 0
            page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, cut)
    path = at(live.server).partition(f":{live.server.port}")[2]
    for _ in range(5):
        with socket.create_connection(("127.0.0.1", live.server.port), timeout=60) as page:
            page.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            page.recv(100)
            page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, cut)
    assert eventually(lambda: not live.pages)
    assert asyncio.run(talk(live.server))[0]["type"] == "hello"


def test_a_scene_takes_no_messages(server):
    async def ask():
        page = await socket_at(server, "scene")
        await page.write_message("{}")
        answer = json.loads(await page.read_message())
        await bye(page)
        return answer

    assert asyncio.run(ask())["type"] == "error"


def test_a_slow_page_gets_the_latest_and_not_all(window, server):
    drawn = meshcat.Visualizer(window=window)
    count = 40_000

    async def draw_and_read():
        page = await socket_at(server, "scene")
        await asyncio.to_thread(move)
        got = []
        while not got or got[-1] != count - 1:
            message = umsgpack.unpackb(await asyncio.wait_for(page.read_message(), 10))
            if message["path"] == "/meshcat/fast":
                got.append(message["matrix"][12])
        await bye(page)
        return got

    def move():
        matrix = np.eye(4)
        for k in range(count):
            matrix[0, 3] = k
            drawn["fast"].set_transform(matrix)

    with silent_page(server):
        page = next(iter(server._scenes.pages))
        got = asyncio.run(draw_and_read())
        assert sorted(got) == got
        assert len(got) < count / 4
        assert len(page._outbox) <= 2
    assert eventually(lambda: len(server._scenes.pages) == 0)


def test_what_was_drawn_last_arrives_before_the_end(window, server):
    drawn = meshcat.Visualizer(window=window)

    async def draw_and_end():
        page = await socket_at(server, "scene")
        got = []
        await asyncio.to_thread(draw)
        while (message := await page.read_message()) is not None:
            got.append(umsgpack.unpackb(message)["path"])
        page.close()
        return got

    def draw():
        for k in range(200):
            drawn[f"node_{k}"].set_transform(np.eye(4))
        server.stop()

    assert asyncio.run(draw_and_end())[-200:] == [f"/meshcat/node_{k}" for k in range(200)]


def test_it_ends_though_a_page_does_not_answer(window):
    server = Server(window, port=0)
    with silent_page(server):
        ending = threading.Thread(target=server.stop, daemon=True)
        ending.start()
        ending.join(60)
        assert not ending.is_alive()
        assert not server.running


def test_ports(window):
    with Server(window, port=0) as first:
        with pytest.raises(InputError, match=rf"port {first.port}: cannot listen on it \(it is busy\)"):
            Server(window, port=first.port)
        assert window.web_url == first.url
    with Server(window) as one, Server(window) as two:
        assert one.port != two.port  # other tests take and leave ports, too
        assert min(one.port, two.port) >= PORT
    with Server(window, port=first.port) as again:  # free at once
        assert again.running
        assert get(again.url)[0] == 200
    assert window.web_url == ""
    for bad in (-1, 65536, "7000", 7000.0, True):
        with pytest.raises(InputError, match="port: expected a whole number from 0 to 65535"):
            Server(window, port=bad)


def test_nothing_is_left_of_it(robot, result):
    threads, open_files = set(threading.enumerate()), psutil.Process().num_fds()
    for _ in range(3):
        live = robot.show(result, port=0)
        asyncio.run(talk(live.server))
        live.stop()
        live.stop()
        assert set(threading.enumerate()) == threads
        with pytest.raises(urllib.error.URLError):
            get(live.url)
        assert live.wait(0)
        live.show(result)  # for pages that come when it is started again
    assert psutil.Process().num_fds() <= open_files + 1
    assert repr(live) == "LiveViewer(stopped)"
    assert "srcdoc" in live._repr_html_()


def test_a_process_ends_with_its_viewers():
    program = (
        "import p3dof\n"
        "robot = p3dof.load()\n"
        "shown = [robot.show(p3dof.paper_motion(11), port=0), robot.viewer(port=0)]\n"
        "print(shown[0].url)\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error::ResourceWarning", "-c", program],
        check=False,
        capture_output=True,
        timeout=60,
    )
    assert done.returncode == 0
    assert done.stderr == b""


def test_viewer_without_controls(robot):
    shown = viewer(robot, port=0)
    assert get(shown.viewer.url())[0] == 200
    shown.viewer.close()
    shown.viewer.close()
    assert shown.viewer.url() == ""


def test_a_motion_that_leaves_the_reach_has_gaps(robot):
    time_, y = np.linspace(0, 1, 51), np.linspace(0, 0.3, 51)
    motion = p3dof.Motion.from_poses(time_, np.stack([y, 0 * y, 0 * y], -1))
    with pytest.raises(ReachError, match="leg A"):
        robot.show(motion, port=0)
    result = robot.inverse_dynamics(motion, method="virtual-power", on_invalid="nan")
    with robot.show(result, port=0, at=0.7) as live:
        force = next(one for one in live.session.document["runs"][0]["curves"] if one["key"] == "force_a")
        np.testing.assert_array_equal(np.isnan(decoded(force["values"])), ~result.valid)


def test_bad_input_is_one_clear_error(robot, result):
    for arguments, options, words in (
        (("motion",), {}, "result: expected a Motion, InverseDynamics or Simulation, got 'motion'"),
        ((result,), {"speed": 9}, r"speed: expected a number from 0\.1 to 4"),
        ((result,), {"at": 2.0}, "at: expected a number from 0 to 1, got 2"),
        ((), {"at": 0.0}, "at: expected a run to go with it"),
        ((result,), {"playing": 1}, "playing: expected True or False, got 1"),
        ((), {"wrench": np.zeros(6)}, "wrench: expected a Motion to go with it"),
        ((result,), {"title": 3}, "title: expected text, got 3"),
    ):
        with pytest.raises(InputError, match=words):
            robot.show(*arguments, port=0, **options)
    with pytest.raises(InputError, match="robot: expected a Manipulator"):
        p3dof.viewer.show("robot")
    with robot.show(result, port=0) as live:
        for act, words in (
            (lambda: live.show("run"), "result: expected a Motion"),
            (lambda: live.show(result, name=3), "name: expected text, got 3"),
            (lambda: live.seek("x"), "time: expected"),
            (lambda: live.follow(3), "follower: expected a function, got 3"),
            (lambda: live.follow(print, "forces"), "what: expected selection or waypoints, got 'forces'"),
        ):
            with pytest.raises(InputError, match=words):
                act()
