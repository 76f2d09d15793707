"""The server and the player, without a browser: who may connect, what is told, what is left at the end."""

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

import p3dof
from p3dof.errors import InputError, ReachError, SingularityError

pytest.importorskip("meshcat", reason="meshcat is not installed")

import meshcat
import meshcat.geometry
import umsgpack
from tornado.websocket import websocket_connect

from p3dof.viewer.connections import BURST, MAX_MESSAGE, MAX_PAGES, MAX_WAITING
from p3dof.viewer.limits import Allowance, Outbox
from p3dof.viewer.live import LiveViewer, viewer
from p3dof.viewer.panel import slider_ranges
from p3dof.viewer.player import END_PAUSE, Frames, Player
from p3dof.viewer.server import PORT, Server
from p3dof.viewer.states import States
from p3dof.viewer.window import SceneWindow

FILES = ("", "licences.txt", "pane.js", "fit.js", "common.js", "panel.js", "panel.css", "meshcat.js")


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
    with LiveViewer(robot, result, port=0, playing=False) as running:
        yield running


def at(server, name="", token=None, scheme="http"):
    """The address of a file or websocket, with the server's token or another."""
    parts = urllib.parse.urlsplit(server.url)
    query = parts.query if token is None else urllib.parse.urlencode({"token": token})
    return urllib.parse.urlunsplit((scheme, parts.netloc, f"/{name}", query, ""))


def get(url, **headers):
    request = urllib.request.Request(url, headers=headers)  # noqa: S310 - http, as all of them here
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:  # noqa: S310
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
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)) as connection:
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
    """What the panel of a page is told: two messages at first, and the errors that answer its own."""
    page = await socket_at(server, "control")
    heard = [json.loads(await page.read_message()) for _ in range(2)]
    for message in messages:
        await page.write_message(message)
        while (answer := json.loads(await page.read_message()))["type"] != "error":
            pass
        heard.append(answer)
    await bye(page)
    return heard


@contextlib.contextmanager
def raw_page(server, name):
    """The bare socket of a page, after the handshake."""
    path = at(server, name).partition(f":{server.port}")[2]
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as page:
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


def eventually(condition, seconds=5.0):
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
    for name in ("scene", "control"):
        assert handshake(server, name, **headers) in (400, 403)


@pytest.mark.parametrize("token", ["", "x", "x" * 32, "\u00e9", "{token}x", "{half}"])
def test_without_the_token_nothing_is_answered(server, token):
    own = server.url.partition("token=")[2]
    token = token.format(token=own, half=own[:16])
    for name in FILES:
        status, _, content = get(at(server, name, token))
        assert status == 403
        assert b"Open the whole address of the viewer, with its token" in content
    for name in ("scene", "control"):
        assert handshake(server, name, token) == 403
    assert get(at(server, "").partition("?")[0])[0] == 403
    assert get(f"{server.url}&token=x")[0] == 403  # two of them


def test_every_server_has_a_token_of_its_own(window, server):
    with Server(window, port=0) as other:
        foreign = other.url.partition("token=")[2]
        assert get(at(server, "", foreign))[0] == 403
        assert handshake(server, "control", foreign) == 403
        assert get(other.url)[0] == 200


@pytest.mark.parametrize("version", ["7", "8", "0", "76", "", "13, 8"])
def test_old_drafts_of_the_protocol_are_refused(server, version):
    own = f"http://127.0.0.1:{server.port}"
    for headers in ({}, {"Origin": own}, {"Sec-WebSocket-Origin": own}):
        assert handshake(server, "control", **{"Sec-WebSocket-Version": version}, **headers) == 426


def test_hixie_is_refused(server):
    """Draft 76, whose handshake has a body and no version: it is answered without a 101."""
    path = at(server, "control").partition(f":{server.port}")[2]
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as page:
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
    assert handshake(server, "control") == 101  # a program, not a page
    assert (
        get(server.url, Host=f"localhost:{server.port}", Origin=f"http://localhost:{server.port}")[0] == 200
    )


def test_200_page_loads(live):
    messages = len(live.scene.window.messages())

    async def load(number):
        for name in FILES:
            assert (await asyncio.to_thread(get, at(live, name)))[0] == 200
        scene, panel = await socket_at(live.server, "scene"), await socket_at(live.server, "control")
        told = [json.loads(await panel.read_message())["type"] for _ in range(2)]
        assert told == ["setup", "state"]
        for _ in range(messages if number % 20 == 0 else 1):
            assert isinstance(await scene.read_message(), bytes)
        await bye(scene)
        await bye(panel)

    async def loads():
        for first in range(0, 200, 8):
            await asyncio.wait_for(asyncio.gather(*(load(first + k) for k in range(8))), 20)

    asyncio.run(loads())
    assert eventually(lambda: live.server.pages == 0)
    assert len(threading.enumerate()) < 12


def test_bad_messages_are_answered_and_change_nothing(live):
    live.seek(0.5)
    assert eventually(lambda: abs(live._state["time"] - 0.5) < 1e-12)
    bad = {
        "nonsense": "JSON",
        "[1]": "JSON object",
        "[" * 9000: "JSON",
        "{}": "type: expected play",
        '{"type": ["play"]}': "type: expected play",
        '{"type": "quit"}': "got 'quit'",
        '{"type": "time"}': "time: expected a number from 0 to 1, got None",
        '{"type": "time", "value": 2}': "time: expected a number from 0 to 1, got 2",
        '{"type": "time", "value": NaN}': "got nan",
        '{"type": "time", "value": true}': "got True",
        '{"type": "speed", "value": 1e9}': "speed: expected a number from 0.1 to 4",
        '{"type": "case", "value": "all"}': "case: expected one of total, static, dynamic",
        '{"type": "case", "value": {}}': "case: expected one of",
        '{"type": "pose", "value": [1, 2]}': "pose: expected shape (3,)",
        '{"type": "pose", "value": ["a", 2, 3]}': "pose: expected real numbers",
        '{"type": "pose", "value": [NaN, 0, 0]}': "pose: expected finite numbers",
        '{"type": "pose", "value": [0, 1e20, 0]}': "z: expected a number from -0.2 to 0.2",
        '{"type": "pose", "value": [0, 1e300, 0]}': "pose: expected numbers of at most 1e+30",
    }
    heard = asyncio.run(talk(live.server, *bad))
    assert [one["type"] for one in heard[:2]] == ["setup", "state"]
    for answer, words in zip(heard[2:], bad.values(), strict=True):
        assert words in answer["message"]
    assert live._state["time"] == 0.5
    assert not live._state["playing"]


def test_a_long_message_ends_its_connection_only(live):
    async def shout():
        page = await socket_at(live.server, "control")
        await page.write_message("x" * (MAX_MESSAGE + 1))
        while await page.read_message() is not None:
            pass
        page.close()
        return page.close_code

    assert asyncio.run(shout()) == 1009
    assert asyncio.run(talk(live.server))[0]["type"] == "setup"


def frame(opcode, content=b"", final=True):
    """A frame as a page sends it, masked with zeros."""
    assert len(content) < 126
    return bytes([0x80 * final | opcode, 0x80 | len(content)]) + bytes(4) + content


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

    with raw_page(server, "control") as page:
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
def quiet(caplog):
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
    assert eventually(lambda: live.server.pages == 0)


@pytest.mark.usefixtures("quiet")
def test_others_are_served_while_a_page_floods(live):
    """The flood begins anew whenever it is ended; meanwhile others get their answers."""
    ended, floods, longest = threading.Event(), [], []

    def flood_on():
        while not ended.is_set() and len(floods) < 50:
            floods.append(flood(live.server, FLOODS["messages"])[-1][0])

    def watch():
        while not ended.wait(0.002):
            pages = tuple(live.server._panels.pages)
            longest.append(max((len(page._outbox) for page in pages), default=0))

    threads = [threading.Thread(target=work) for work in (flood_on, flood_on, watch)]
    for thread in threads:
        thread.start()
    assert eventually(lambda: len(floods) >= 2)
    served, begun = 0, len(floods)
    while len(floods) < begun + 4:
        assert get(live.url)[0] == 200
        assert len(asyncio.run(talk(live.server, "{}"))) == 3
        served += 1
    ended.set()
    for thread in threads:
        thread.join()
    assert set(floods) == {8}
    assert served >= 4
    assert max(longest) <= 3  # the latest state, the latest error, and the setup


def test_a_page_that_sends_as_a_user_does_is_not_closed(live):
    async def drag():
        page = await socket_at(live.server, "control")
        for k in range(BURST - 20):
            await page.write_message(json.dumps({"type": "time", "value": k / BURST}))
        await page.write_message("{}")
        while json.loads(await page.read_message())["type"] != "error":
            pass
        await bye(page)

    asyncio.run(drag())
    assert eventually(lambda: live._state["time"] == (BURST - 21) / BURST)


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
        assert handshake(server, "control") == 101
    assert eventually(lambda: not server._scenes.pages)
    assert handshake(server, "scene") == 101


@pytest.mark.usefixtures("quiet")
def test_pages_that_close_in_the_middle_of_it_are_not_talked_about(live):
    """Cut off while the scene is sent, while a motion is played, and while a file is sent."""
    cut = struct.pack("ii", 1, 0)  # a reset instead of an end
    live.play()
    for name in ("scene", "control") * 10:
        with raw_page(live.server, name) as page:
            page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, cut)
    for name in ("scene", "control") * 5:
        with raw_page(live.server, name) as page:
            assert len(page.recv(1000)) > 0
            page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, cut)
    path = at(live, "meshcat.js").partition(f":{live.server.port}")[2]
    for _ in range(5):
        with socket.create_connection(("127.0.0.1", live.server.port), timeout=10) as page:
            page.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            page.recv(100)
            page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, cut)
    assert eventually(lambda: not live.server.pages and not live.server._scenes.pages)
    live.seek(0.0)
    assert asyncio.run(talk(live.server))[0]["type"] == "setup"


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


def test_it_ends_though_a_page_does_not_answer(window):
    server = Server(window, port=0)
    with silent_page(server):
        start = time.monotonic()
        server.stop()
        assert not server.running
        assert time.monotonic() - start < 3


def test_ports(window):
    with Server(window, port=0) as first:
        with pytest.raises(InputError, match=rf"port {first.port}: cannot listen on it \(it is busy\)"):
            Server(window, port=first.port)
        assert window.web_url == first.url
    with Server(window) as one, Server(window) as two:
        assert PORT <= one.port < two.port
    with Server(window, port=one.port) as again:  # free at once
        assert again.running
        assert get(again.url)[0] == 200
    assert window.web_url == ""
    for bad in (-1, 65536, "7000", 7000.0, True):
        with pytest.raises(InputError, match="port: expected a whole number from 0 to 65535"):
            Server(window, port=bad)


def test_nothing_is_left_of_it(robot, result):
    threads, open_files = set(threading.enumerate()), psutil.Process().num_fds()
    for _ in range(3):
        live = LiveViewer(robot, result, port=0)
        asyncio.run(talk(live.server))
        live.stop()
        live.stop()
        assert set(threading.enumerate()) == threads
        with pytest.raises(urllib.error.URLError):
            get(live.url)
        assert live.wait(0)
        live.scene.display(np.zeros(10))  # the scene goes on without it
        live.server.tell({"type": "state"})
    assert psutil.Process().num_fds() <= open_files + 1
    assert repr(live) == "LiveViewer(stopped)"
    assert "srcdoc" in live._repr_html_()


def test_a_process_ends_with_its_viewers():
    program = (
        "import p3dof; from p3dof.viewer.live import LiveViewer, viewer\n"
        "robot = p3dof.load()\n"
        "shown = [LiveViewer(robot, p3dof.paper_motion(11), port=0), viewer(robot, port=0)]\n"
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


def test_player():
    now = [100.0]
    player = Player(1.0, 3.0, speed=0.5, clock=lambda: now[0])
    assert (player.time, player.playing) == (1.0, True)
    now[0] += 2
    assert player.time == 2.0
    player.set_speed(1.0)
    now[0] += 0.5
    assert player.time == 2.5
    now[0] += 0.5 + END_PAUSE / 2
    assert player.time == 3.0  # the end is shown for a while
    now[0] += END_PAUSE / 2 + 0.25
    assert player.time == pytest.approx(1.25)  # and then it begins again
    player.pause()
    now[0] += 10
    assert player.time == pytest.approx(1.25)
    player.play()
    now[0] += 0.5
    assert player.time == pytest.approx(1.75)
    player.seek(3.0)
    assert not player.playing
    player.play()
    assert player.time == 1.0
    for bad in (0.05, 5, "1", None, float("nan")):
        with pytest.raises(InputError, match=r"speed: expected a number from 0\.1 to 4"):
            player.set_speed(bad)
    with pytest.raises(InputError, match="time: expected a number from 1 to 3, got 0"):
        player.seek(0)
    still = Player(2.0, 2.0, clock=lambda: now[0])  # a single sample
    now[0] += 7.3
    assert still.time == 2.0


def test_frames_are_left_out_rather_than_late():
    drawn = []

    def slow():
        drawn.append(time.perf_counter())
        time.sleep(0.02)
        return len(drawn) < 10

    frames = Frames(slow, 1000.0, "test")
    frames.start()
    assert eventually(lambda: len(drawn) == 10)
    time.sleep(0.1)
    assert len(drawn) == 10  # nothing moves any more
    frames.ask()
    assert eventually(lambda: len(drawn) == 11)
    frames.stop()
    assert not frames.running


def test_an_error_while_drawing_is_handed_on():
    def fail():
        raise ZeroDivisionError

    frames = Frames(fail, 60.0, "test")
    frames.start()
    with pytest.raises(ZeroDivisionError):
        frames.wait(5)


def test_a_frame_takes_a_fraction_of_a_thirtieth_of_a_second(robot):
    with LiveViewer(robot, p3dof.paper_motion(1001), port=0, playing=False) as live:
        live._frames.stop()
        start = time.thread_time()
        for at in np.linspace(0, 1, 60):
            live._player.seek(at)
            live._step()
        assert (time.thread_time() - start) / 60 < 0.5 / 30


def test_states(robot, result):
    states, rest = States(robot, result), np.zeros(3)
    for sample in (0, 17, 50):
        at, pose = result.time[sample], result.motion.pose[sample]
        static = robot.forces(pose, rest, rest)
        for case, forces in (
            ("total", result.forces[sample]),
            ("static", static),
            ("dynamic", result.forces[sample] - static),
        ):
            shown = states.of_time(at, case)
            np.testing.assert_allclose(shown.pose, pose, atol=1e-15)
            np.testing.assert_allclose(shown.forces, forces, atol=1e-11)
            np.testing.assert_allclose(shown.q, result.joints.q[sample], atol=1e-14)
            np.testing.assert_allclose(shown.sliders, result.sliders[sample], atol=1e-14)
    between = states.of_time(0.123, "total")
    exact = p3dof.paper_motion(1001)[123]
    np.testing.assert_allclose(between.pose, exact.pose[0], atol=1e-9)
    at_rest = states.of_pose(np.array([0.1, 0.0, 0.2]), 0.0, rest, "total")
    np.testing.assert_allclose(at_rest.forces, robot.forces([0.1, 0, 0.2], rest, rest), atol=1e-11)
    assert not states.of_pose(np.array([0.1, 0.0, 0.2]), 0.0, rest, "dynamic").forces.any()


def test_the_load_stays_on_a_platform_that_is_moved_by_hand(robot):
    motion = p3dof.paper_motion(11)
    wrench = np.linspace(0, 1, 11)[:, None] * [0, 0, -50.0, 0, 3.0, 0]
    states = States(robot, robot.inverse_dynamics(motion, method="virtual-power", wrench=wrench))
    pose, rest = np.array([0.05, 0.01, 0.1]), np.zeros(3)
    shown = states.of_pose(pose, 0.55, rest, "static")
    expected = robot.forces(pose, rest, rest, wrench=[0, 0, -27.5, 0, 1.65, 0])
    np.testing.assert_allclose(shown.forces, expected, atol=1e-11)


def test_limits_in_words(robot):
    states, rest = States(robot, None), np.zeros(3)
    shown = states.of_pose(np.array([0.0, 0.25, 0.9]), 0.0, rest, "total")
    assert "travel of slider A: 0.250 m, limit 0.2 m" in shown.limits
    assert "tilt of the platform: 0.900 rad, limit 0.785 rad" in shown.limits
    assert states.of_pose(rest, 0.0, rest, "total").limits == ()


def test_the_platform_cannot_be_dragged_through_a_singular_pose():
    robot = p3dof.load(p3dof.Parameters(p3dof.Geometry(r=0.2, R=0.25, L=0.3), p3dof.PAPER.bodies))
    angles = robot.singularity(
        np.stack([np.zeros(401), np.zeros(401), np.linspace(-2, 2, 401)], -1)
    ).actuation
    beyond = np.linspace(-2, 2, 401)[np.flatnonzero(angles < -0.05)[0]]
    states, home = States(robot, None), np.zeros(3)
    with pytest.raises(SingularityError, match="has passed the plane of leg C's rods by"):
        states.of_pose(np.array([0.0, 0.0, beyond]), 0.0, home, "total")
    there = np.array([0.0, 0.0, beyond])
    states.of_pose(there, 0.0, there, "total")  # on its own side it may stay


def test_a_motion_that_leaves_the_reach_keeps_the_last_pose(robot):
    time_, y = np.linspace(0, 1, 51), np.linspace(0, 0.3, 51)
    motion = p3dof.Motion.from_poses(time_, np.stack([y, 0 * y, 0 * y], -1))
    with pytest.raises(ReachError, match="leg A"):
        LiveViewer(robot, motion, port=0)
    result = robot.inverse_dynamics(motion, method="virtual-power", on_invalid="nan")
    with LiveViewer(robot, result, port=0, playing=False, at=0.7) as live:
        assert live.shown.pose[0] == pytest.approx(0.21)
        live.seek(0.95)
        assert eventually(lambda: live._state["leg"] == "a")
        assert "leg A is too short" in live._state["message"]
        assert live.shown.pose[0] == pytest.approx(0.21)
        live.seek(0.5)
        assert eventually(lambda: live._state["leg"] is None)
        assert live._state["message"] == ""


def test_python_methods(live, robot):
    live.move_to([0.1, 0.0, 0.1])
    assert eventually(lambda: live.shown.pose[0] == 0.1)
    with pytest.raises(ReachError):
        live.move_to([0.26, 0.0, 0.0])
    with pytest.raises(InputError, match="theta: expected a number from"):
        live.move_to([0.0, 0.0, 1.0])
    live.play()
    assert eventually(lambda: live._state["playing"])
    live.pause()
    assert eventually(lambda: not live._state["playing"])
    with pytest.raises(InputError, match="robot: expected a Manipulator"):
        LiveViewer("robot")
    with pytest.raises(InputError, match="motion: expected a Motion or InverseDynamics, got str"):
        LiveViewer(robot, "motion")
    with pytest.raises(InputError, match="fps"):
        LiveViewer(robot, fps=0)
    with pytest.raises(InputError, match="speed"):
        LiveViewer(robot, speed=9)
    with pytest.raises(InputError, match="wrench"):
        LiveViewer(robot, wrench=np.zeros(6))
    with LiveViewer(robot, port=0) as still, pytest.raises(InputError, match="play: there is no motion"):
        still.play()


def test_slider_ranges_hold_the_reach(robot):
    (low, high), travel, tilt = slider_ranges(robot)
    g, limits = robot.parameters.geometry, robot.parameters.limits
    assert low == -high
    assert high > g.L - (g.R - g.r)
    assert (travel, tilt) == (limits.travel, limits.tilt)
