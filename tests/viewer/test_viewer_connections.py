"""Connections to the page that ask for nothing: they keep nobody out, take no files, and fill no log."""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import sys
import urllib.request

import pytest

pytest.importorskip("meshcat", reason="meshcat is not installed")

from p3dof.viewer import host
from p3dof.viewer.server import Server
from p3dof.viewer.window import SceneWindow

TOLD = "p3dof: connections to the page are closed that have not requested it"


@pytest.fixture
def started():
    """A server that is started in the test, after its limits are set."""
    with contextlib.ExitStack() as stack:
        yield lambda: stack.enter_context(Server(SceneWindow(), port=0))


@contextlib.contextmanager
def half_open(port, count, said=b""):
    """Connections that begin a request, at most, and wait."""
    with contextlib.ExitStack() as stack:
        found = []
        for _ in range(count):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=10))
            with contextlib.suppress(ConnectionError):  # it has given way already
                one.sendall(said)
            found.append(one)
        yield found


def closed(connection):
    """Wait until the other side has closed a connection; it may say why before that."""
    with contextlib.suppress(ConnectionError):
        while connection.recv(1 << 16):
            pass
    return True


def status(url):
    with urllib.request.urlopen(url, timeout=10) as answer:  # noqa: S310 - http, here
        answer.read()
        return answer.status


@pytest.mark.parametrize(
    "said", [b"", b"GET / HTTP/1.1\r\n", b"POST / HTTP/1.1\r\nContent-Length: 9\r\n\r\n"]
)
def test_who_asks_for_nothing_keeps_nobody_out(said, started, monkeypatch, caplog):
    monkeypatch.setattr(host, "MOST", 8)
    server = started()
    with half_open(server.port, 40, said) as waiting:
        assert status(server.url) == 200
        assert all(closed(one) for one in waiting[:32])  # the oldest have given way
    told = [record.getMessage().partition(" (")[0] for record in caplog.records]
    # A POST is refused and closed, which may make room: then it is told again, once a half at most, or never.
    assert told == [TOLD] or (said.startswith(b"POST") and set(told) <= {TOLD} and len(told) <= 40 // 4)


def test_a_page_that_knows_the_token_stays(started, monkeypatch):
    monkeypatch.setattr(host, "MOST", 4)
    server = started()
    path = server.url.partition(str(server.port))[2].replace("/?", "/scene?")
    with page_of(server.port, path) as page, half_open(server.port, 20) as waiting:
        assert closed(waiting[0])
        page.sendall(b"\x89\x80" + bytes(4))  # a ping, masked
        assert frames_until(page, 10)


@pytest.mark.parametrize(
    "said", [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n", b"POST / HTTP/1.1\r\nContent-Length: 9\r\n\r\n"]
)
def test_a_request_that_does_not_come_ends(said, started, monkeypatch):
    monkeypatch.setattr(host, "_PATIENCE", 0.05)
    with half_open(started().port, 1, said) as (one,):
        assert closed(one)


@contextlib.contextmanager
def page_of(port, path):
    with socket.create_connection(("127.0.0.1", port), timeout=10) as page:
        page.sendall(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += page.recv(1)
        assert answer.startswith(b"HTTP/1.1 101")
        yield page


def frames_until(page, opcode):
    """Return the content of the first frame of a kind that a page is sent."""
    stream = page.makefile("rb")
    while begin := stream.read(2):
        length = begin[1]
        if length >= 126:
            (length,) = struct.unpack(*((">H", stream.read(2)) if length == 126 else (">Q", stream.read(8))))
        content = stream.read(length)
        if begin[0] & 0x0F == opcode:
            return begin + content
    return b""


@pytest.mark.parametrize("opcode", [1, 2, 8, 9, 10])
def test_frames_without_a_mask_are_refused(opcode, started):
    server = started()
    path = server.url.partition(str(server.port))[2].replace("/?", "/scene?")
    with page_of(server.port, path) as page:
        page.sendall(bytes([0x80 | opcode, 2]) + b"[]")
        told = frames_until(page, 8)
        assert (int.from_bytes(told[2:4], "big"), told[4:]) == (1002, b"frames of a page are masked")
        assert closed(page)
    assert status(server.url) == 200


FEW_FILES = """
import logging, resource, sys
logging.basicConfig(format="%(message)s")
resource.setrlimit(resource.RLIMIT_NOFILE, (200, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
from p3dof.viewer.server import Server
from p3dof.viewer.window import SceneWindow
taken = []
with Server(SceneWindow(), port=0) as server:
    print(server.port, server.url, flush=True)
    for order in sys.stdin:
        if order == "take\\n":
            try:
                while True:
                    taken.append(open("/dev/null"))
            except OSError:
                pass
        elif order == "give\\n":
            while taken:
                taken.pop().close()
        print(order, end="", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limit")
def test_where_files_are_few_the_page_is_there_and_the_log_has_a_line():
    with subprocess.Popen(
        [sys.executable, "-c", FEW_FILES],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        port, url = process.stdout.readline().split()

        def order(word):
            process.stdin.write(f"{word}\n")
            process.stdin.flush()
            assert process.stdout.readline() == f"{word}\n"

        with half_open(int(port), 321):
            assert status(url) == 200
        order("take")
        with half_open(int(port), 3):  # the process has no file left to let one in
            order("give")
            assert status(url) == 200
        _, told = process.communicate(timeout=30)
    assert process.returncode == 0
    assert 1 <= len(told.splitlines()) <= 2, told[:2000]
    assert all(line.startswith(TOLD) for line in told.splitlines())
