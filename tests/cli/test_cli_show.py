"""`p3dof show` as a process: it serves, says where, ends cleanly; and its files and errors."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request

import numpy as np
import psutil
import pytest
from documents import ROOT
from gallery import GALLERY
from html_pages import document_of, running_loop

import p3dof

pytest.importorskip("meshcat", reason="meshcat is not installed")

from p3dof.cli import main, show  # noqa: F401 - it adds its command
from p3dof.cli.viewing import until_signalled
from p3dof.viewer.document.encoding import decoded

PROGRAM = "import sys; import p3dof.cli.show; from p3dof.cli import main; sys.exit(main(sys.argv[1:]))"


@contextlib.contextmanager
def running(*arguments, **how):
    """The command as a process, and the URL that it prints."""
    command = [sys.executable, "-c", PROGRAM, "show", "--no-open", "--samples", "201", *map(str, arguments)]
    how = {"stdin": subprocess.DEVNULL, **how}
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **how
    )
    try:
        line = process.stdout.readline()
        found = re.match(r"(http://127\.0\.0\.1:(\d+)/\?token=[\w-]+) shows the machine", line)
        assert found, line
        yield process, found[1], int(found[2])
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def run(capsys, *arguments):
    code = main(["show", *map(str, arguments)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def one_line(code, err):
    assert code == 2
    assert err.startswith("p3dof: error: ")
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.usefixtures("ctrl_c")
def test_it_serves_until_it_is_told_to_end(number):
    port = free_port()
    with running("--port", port) as (process, url, found):
        assert found == port
        with urllib.request.urlopen(url, timeout=60) as answer:  # noqa: S310 - http
            assert b"p3dof-document" in answer.read()
        own = psutil.Process(process.pid)
        assert own.children() == []
        listening = [c.laddr for c in own.net_connections() if c.status == psutil.CONN_LISTEN]
        assert {(address.ip, address.port) for address in listening} == {("127.0.0.1", port)}
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")
    with socket.socket() as again:
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # closed connections linger, no listener
        again.bind(("127.0.0.1", port))


@pytest.mark.skipif(os.name != "posix", reason="shells of Unix close standard input like this")
@pytest.mark.usefixtures("ctrl_c")
def test_without_standard_input():
    with running("--port", 0, stdin=None, preexec_fn=lambda: os.close(0)) as (process, url, _):
        with urllib.request.urlopen(url, timeout=60) as answer:  # noqa: S310 - http
            assert answer.status == 200
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 0


def test_a_busy_port(capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code, out, err = run(capsys, "--no-open", "--samples", 11, "--port", port)
    assert f"port {port}: cannot listen on it (it is busy); give another one, or none" in one_line(code, err)
    assert "http" not in out


def test_it_finds_a_free_port():
    with running() as (_, _, first), running() as (_, _, second):
        assert first != second


@pytest.mark.usefixtures("ctrl_c")
def test_options_reach_the_page():
    with running("--port", 0, "--speed", 0.25, "--paused", "--at", 0.5) as (process, url, port):
        document = document_of(url)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert f":{port}/?token=" in url
    assert document["start"] == {"speed": 0.25, "playing": False, "time": 0.5}
    assert document["runs"][0]["time"]["shape"] == [201]


@pytest.mark.usefixtures("ctrl_c")
def test_the_plain_page_of_meshcat():
    with running("--port", 0, "--meshcat") as (process, url, _):
        with urllib.request.urlopen(url, timeout=60) as answer:  # noqa: S310 - http
            assert b"meshcat.js" in answer.read()
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--port", 70000], "70000 is not in the range 0<=x<=65535"),
        (["--speed", 9], "9.0 is not in the range 0.1<=x<=4.0"),
        (["--fps", 0], "is not in the range"),
        (["--at", 3], "--at: expected a time of the motion, from 0 to 1 s, got 3"),
        (["--at", "nan"], "got nan"),
        (["--motion", "missing.csv"], "missing.csv"),
        (["--parameters", "missing.yaml"], "missing.yaml"),
        (["--out", "same.png", "--screenshot", "same.png"], "same.png would be overwritten"),
        (["--out", "show.avi"], "show.avi: expected a file name that ends in .html, .mp4, .gif or .png"),
        (["--out", "-", "--json"], "--json and --out - both take the standard output"),
        (["--video", "film.avi"], ".mp4 or .gif"),
        (["--screenshot", "picture.bmp"], ".png"),
        (["--meshcat", "--out", "show.png"], "show.png: --meshcat writes .html only"),
    ],
)
def test_bad_arguments(capsys, arguments, words):
    code, out, err = run(capsys, "--no-open", *arguments)
    assert words in one_line(code, err)
    assert "http" not in out


def test_a_motion_out_of_reach(tmp_path, capsys):
    (tmp_path / "far.csv").write_text("t,y,z,theta\n0,0,0,0\n1,0.5,0,0\n", encoding="utf-8")
    code, _, err = run(capsys, "--no-open", "--motion", tmp_path / "far.csv")
    assert code == 1
    assert "leg A is too short by 0.25 m" in one_line(2, err)


def test_without_the_extra(capsys, monkeypatch, tmp_path):
    for name in ("connections", "host", "live_viewer"):
        monkeypatch.delitem(sys.modules, f"p3dof.viewer.{name}", raising=False)
    for name in ("meshcat", "tornado", "tornado.iostream", "tornado.web", "tornado.websocket"):
        monkeypatch.setitem(sys.modules, name, None)
    code, _, err = run(capsys, "--no-open", "--samples", 11)
    assert "pip install 'p3dof[viz]'" in one_line(code, err)
    assert run(capsys, "--samples", 11, "--out", tmp_path / "page.html")[0] == 0  # a file needs none of it


def test_the_page_as_a_file(tmp_path, capsys):
    file = tmp_path / "deep" / "motion.html"
    code, out, _ = run(capsys, "--samples", 51, "--at", 0.5, "--paused", "--out", file)
    assert code == 0
    assert f"wrote {file}" in out
    assert "http://127" not in out
    document = json.loads(re.search(r'id="p3dof-document">(.*?)</script>', file.read_text(), re.DOTALL)[1])
    assert document["runs"][0]["time"]["shape"] == [51]
    assert document["start"] == {"speed": 1.0, "playing": False, "time": 0.5}


def test_a_page_with_the_nearest_parts(tmp_path, capsys):
    around = tmp_path / "around.yaml"
    around.write_text("obstacles: [{name: post, ends: [[0, 0.33, -0.6], [0, 0.33, 0]], radius: 20 mm}]\n")
    page = tmp_path / "machine.html"
    code, out, err = run(
        capsys, "--samples", 21, "--surroundings", around, "--clearance", "3 mm", "--out", page
    )
    assert (code, err) == (0, "")
    found = p3dof.design.clearance_of(
        p3dof.load(), p3dof.paper_motion(21), p3dof.design.read_surroundings(around), required=0.003
    )
    assert found.verdict in " ".join(out.split())
    document = document_of(page.as_uri())
    near = document["runs"][0]["nearest"]
    np.testing.assert_array_equal(decoded(near["distances"]), found.distances.min(axis=1))
    assert near["required"] == 0.003
    assert "post" in {solid["name"] for solid in document["scene"]["solids"]}
    assert run(capsys, "--samples", 21, "--out", page)[0] == 0
    assert "nearest" not in document_of(page.as_uri())["runs"][0]
    code, _, err = run(capsys, "--clearance", 0, "--meshcat", "--out", page)
    assert code == 2
    assert "for the page, not for --meshcat" in err
    code, _, err = run(capsys, "--surroundings", around, "--out", around)
    assert code == 2


def test_pictures(tmp_path, capsys, monkeypatch):
    made = {}

    def recorder(name):
        def record(path, *arguments, **options):
            made[name] = (path, *arguments, options)
            return path

        return record

    for name in ("save_screenshot", "save_video"):  # tested on their own, in a browser
        monkeypatch.setattr(f"p3dof.viewer.pictures.{name}", recorder(name))
    picture, film = tmp_path / "machine.png", tmp_path / "machine.gif"
    arguments = ("--samples", 11, "--at", 0.5, "--fps", 4, "--speed", 0.5)
    code, out, _ = run(capsys, *arguments, "--screenshot", picture, "--video", film)
    assert code == 0
    assert out.splitlines()[-2:] == [f"wrote {picture}", f"wrote {film}"]
    path, page, _ = made["save_screenshot"]
    assert path == picture
    assert page.document["start"]["time"] == 0.5
    curve = next(one for one in page.document["runs"][0]["curves"] if one["key"] == "force_b")
    expected = p3dof.load().inverse_dynamics(p3dof.paper_motion(11)).forces[:, 1]
    np.testing.assert_allclose(decoded(curve["values"]), expected, rtol=0, atol=1e-11)
    path, again, fps, speed, _ = made["save_video"]
    assert (path, again, fps, speed) == (film, page, 4.0, 0.5)
    made.clear()
    for ending, name in ((".png", "save_screenshot"), (".GIF", "save_video"), (".mp4", "save_video")):
        out = tmp_path / f"by_ending{ending}"  # --out: the ending decides
        assert run(capsys, *arguments, "--out", out)[0] == 0
        assert made.pop(name)[0] == out
        assert made == {}


def test_interrupted_while_it_computes(capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(p3dof.Manipulator, "inverse_dynamics", interrupted)
    assert run(capsys, "--no-open")[0] == 130


def test_signals_are_given_back(capsys):
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        run(capsys, "--no-open", "--samples", 11, "--port", taken.getsockname()[1])
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


@pytest.mark.skipif(os.name != "posix", reason="shells of Unix start in the background like this")
@pytest.mark.parametrize("name", ["SIGINT", "SIGHUP"])
def test_what_it_was_started_to_ignore_does_not_end_it(name):
    """In the background of a script, or by nohup; SIGTERM does."""
    number = getattr(signal, name)
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with until_signalled() as wait:
            assert signal.getsignal(number) == signal.SIG_IGN
            signal.raise_signal(number)
            looks = []
            wait(lambda _: looks.append(0) or len(looks) == 3)
            assert len(looks) == 3
            signal.raise_signal(signal.SIGTERM)
            wait(lambda _: pytest.fail("it goes on"))
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGTERM])
@pytest.mark.usefixtures("ctrl_c")
def test_any_robot_is_served_until_it_is_told_to_end(number):
    with running_loop(GALLERY / "gripper.urdf", "--set", "left_drive=0.5", "--closure-forces") as (
        process,
        url,
    ):
        document = document_of(url)
        assert document["inputs"][0]["value"] == pytest.approx(0.5, abs=1e-9)
        assert document["start"]["layers"] == {"closures": True, "multipliers": True}
        assert document["engine"]["kind"] == "loop"
        own = psutil.Process(process.pid)
        listening = [c.laddr.ip for c in own.net_connections() if c.status == psutil.CONN_LISTEN]
        assert listening == ["127.0.0.1"]
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")


def test_a_run_of_any_robot_is_served():
    arguments = (GALLERY / "four_bar.urdf", "--simulate", "0.1", "--actuator-force", "crank_joint=0.5 N m")
    with running_loop(*arguments, "--at", "0.1", "--paused") as (_, url):
        document = document_of(url)
    assert document["start"]["time"] == 0.1
    assert document["start"]["playing"] is False
    force = next(one for one in document["runs"][0]["curves"] if one["key"] == "force crank_joint")
    assert set(decoded(force["values"]).tolist()) == {0.5}
