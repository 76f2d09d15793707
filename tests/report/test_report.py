"""The report: one page with the numbers of the API, that loads nothing and trusts nobody."""

from __future__ import annotations

import base64
import contextlib
import re
import shlex
import shutil
import subprocess
import sys
import threading
from datetime import datetime, timezone
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from browser import chromium, find_chromium
from documents import ROOT
from html_pages import HOSTILE, Page

import p3dof
import p3dof.cli.report
from p3dof import report
from p3dof._base.errors import FileError, InputError, MissingExtraError, ReachError
from p3dof._base.tables import number
from p3dof.analysis.reactions import JOINTS
from p3dof.cli import main
from p3dof.viewer import headless

NOON = datetime(2024, 5, 6, 12, 0, tzinfo=timezone.utc)


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(scope="module")
def robot():
    friction = p3dof.machine.Friction({"sliders": 20.0}, {"hinge_a": 0.05})
    parameters = p3dof.PAPER
    limits = p3dof.machine.Limits(speed=0.5)
    return p3dof.load(
        p3dof.Parameters(parameters.geometry, parameters.bodies, limits, parameters.gravity, friction)
    )


@pytest.fixture(scope="module")
def motion():
    return p3dof.paper_motion(41)


def full_page(robot, motion):
    return report.render(
        robot,
        motion,
        wrench=(1.0, 2.0, -30.0, 0.0, 0.4, 0.0),
        title=HOSTILE,
        about={HOSTILE: HOSTILE},
        command=f"p3dof report --title {HOSTILE}",
        page=f"<!DOCTYPE html><p title='x'>{HOSTILE}</p>",
        date=NOON,
    )


@pytest.fixture(scope="module")
def html(robot, motion):
    return full_page(robot, motion)


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


def test_the_numbers_are_those_of_the_api(robot, motion, page):
    wrench = (1.0, 2.0, -30.0, 0.0, 0.4, 0.0)
    by_pinocchio = robot.inverse_dynamics(motion, wrench=wrench)
    result = robot.inverse_dynamics(motion, method="virtual-power", wrench=wrench)
    energy = robot.energy(by_pinocchio)
    rows = {row[0]: row[1:] for row in page.tables["Loads of the drives"]}
    for name, values in (
        ("peak force [N]", energy.drives.peak_force),
        ("RMS force [N]", energy.drives.rms_force),
        ("peak speed [m/s]", energy.drives.peak_speed),
        ("peak power [W]", energy.drives.peak_power),
        ("peak braking power [W]", energy.drives.peak_braking),
        ("mean power [W]", energy.drives.mean_power),
        ("work supplied [J]", energy.drives.positive_work),
        ("work regenerated [J]", energy.drives.negative_work),
    ):
        np.testing.assert_allclose([float(cell) for cell in rows[name]], values, rtol=5.1e-6)
    rows = page.tables["Forces by pinocchio and by virtual-power"][1:]
    for leg, row in enumerate(rows):
        assert float(row[1]) == pytest.approx(result.peak_forces[leg], rel=5.1e-6)
        assert float(row[2]) == pytest.approx(result.rms_forces[leg], rel=5.1e-6)
        assert float(row[3]) < 1e-11
    rows = page.tables["Kinetic energy"][1:]
    assert [row[0] for row in rows] == list(energy.bodies)
    np.testing.assert_allclose(
        [float(row[1]) for row in rows], energy.kinetic.max(axis=0), rtol=5.1e-6, atol=1e-12
    )
    assert sum(float(row[2].rstrip("%")) for row in rows) == pytest.approx(100, abs=0.5)
    rows = {row[0]: row[1:] for row in page.tables["Motion"][1:]}
    assert [float(cell) for cell in rows["θ [rad], per s, per s²"]] == pytest.approx(
        [-0.4, 0.4, 1.6 * np.pi, 6.4 * np.pi**2], rel=1e-5
    )
    assert "1, 2, 30 N; 0, 0.4, 0 N m" in page.text
    assert "41 samples over 1 s" in page.text


def test_open_reactions_to_size_for_are_those_of_elastic_joints(robot, motion, page):
    found = robot.reactions(motion, wrench=(1.0, 2.0, -30.0, 0.0, 0.4, 0.0))
    rows = page.tables["Largest reactions: to size joints for"]
    fields = ("force", "axial", "radial", "rms_force", "moment", "across", "rms_moment")
    assert len(rows) == 14
    for peak, row in zip(found.peaks(), rows[1:], strict=True):
        assert row[0].split()[0] == peak.joint
        for name, cell in zip(fields, row[1:], strict=True):
            assert cell.startswith("~") == (name in peak.undetermined)
            accuracy = {"abs": 5.1e-3} if cell.startswith("~") else {"rel": 5.1e-6, "abs": 1e-9}
            assert float(cell.lstrip("~")) == pytest.approx(getattr(peak, name), **accuracy)
    opened = {(peak.joint, peak.load): peak.values for peak in found.open_peaks()}
    shown = 0
    for title, loads in (("forces", fields[:4]), ("moments", fields[4:])):
        header, *rows = page.tables[
            f"Open {title}: of elastic joints, and by two idealisations, which are no bounds"
        ]
        assert [name.split()[-1] for name in header[1:]] == ["elastic", "paper", "points"] * len(loads)
        for row in rows:
            cells = iter(row[1:])
            for load in loads:
                for kind in ("elastic", "paper", "points"):
                    cell, value = next(cells), opened.get((row[0].split()[0], load), {}).get(kind)
                    if value is None or np.isnan(value):
                        assert cell == ("" if value is None else "–")
                        continue
                    assert float(cell) == pytest.approx(value, rel=5.1e-6, abs=1e-9)
                    shown += 1
    assert shown == sum(np.isfinite(value) for values in opened.values() for value in values.values())
    assert "Rigid bodies do not determine the open loads" in page.text
    assert "Neither is a bound" in page.text


@pytest.mark.usefixtures("undrawn")
def test_one_idealisation_alone(tmp_path, capsys):
    arguments = ("--samples", 5, "--no-animation", "--out", tmp_path / "r.html", "--joint-model", "points")
    assert run(capsys, "report", *arguments)[0] == 0
    page = Page((tmp_path / "r.html").read_text(encoding="utf-8"))
    header, *_ = page.tables["Open forces: not to size joints for"]
    assert [name.split()[-1] for name in header[1:]] == ["points"] * 4
    assert "--joint-model=points" in page.text


def test_one_key_ties_the_drawing_to_the_tables(page):
    """The labels in the drawing, those in the key beside it, and the names in the tables of reactions."""
    _, *rows = page.tables["Names of the joints"]
    names = {name: label for label, name, _ in rows}
    assert len(rows) == len(names) == 13
    assert names["hinge_lower"] == "C4"
    table = page.tables["Largest reactions: to size joints for"]
    assert [row[0] for row in table[1:]] == [f"{joint.name} ({joint.label})" for joint in JOINTS]
    assert names == {joint.name: joint.label for joint in JOINTS}
    reference = ROOT.joinpath("docs/reference/names.md").read_text(encoding="utf-8")
    for label, name, meaning in rows:
        assert f"| {label} | `{name}` | {meaning} |" in reference


@pytest.mark.usefixtures("undrawn")
def test_every_payload_is_shown(tmp_path, capsys):
    """That of the file and that of the command line: both are on, and both are told, with what they weigh."""
    file = tmp_path / "m.yaml"
    in_file = p3dof.machine.Body(5.0, [0.01, 0, -0.1], [0.02, 0.03, 0.04])
    p3dof.write_parameters(p3dof.PAPER.carrying(in_file), file)
    arguments = ("--parameters", file, "--payload", "2,0,0.03,0", "--samples", 5, "--no-animation")
    code, text, _ = run(capsys, "report", *arguments, "--out", tmp_path / "r.html")
    assert code == 0
    words = (
        f"5 kg at (0.01, 0, -0.1) m ({file}) + 2 kg at (0, 0.03, 0) m (--payload) = 7 kg; platform 8.1573 kg"
    )
    assert f"payload: {words}, with payload 15.1573 kg" in text
    page = Page((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert words in page.text
    rows = page.tables["Platform and payload"]
    assert [row[0] for row in rows[1:]] == ["platform", "payload 1", "payload 2", "together"]
    alone, first, second, together = (np.array([float(cell) for cell in row[1:]]) for row in rows[1:])
    platform = p3dof.PAPER.bodies.platform
    np.testing.assert_allclose(alone[:4], [platform.mass, *platform.com], rtol=5.1e-6, atol=1e-15)
    np.testing.assert_allclose(first[:7], [5, 0.01, 0, -0.1, 0.02, 0.03, 0.04])
    np.testing.assert_allclose(second, [2, 0, 0.03, 0, 0, 0, 0, 0, 0, 0])
    assert together[0] == pytest.approx(alone[0] + 7, rel=1e-5)
    centre = sum(row[0] * row[1:4] for row in (alone, first, second)) / together[0]
    np.testing.assert_allclose(together[1:4], centre, atol=2e-6)
    bodies = {row[0]: row[1] for row in page.tables["Bodies"]}
    assert bodies["platform + payload"] == "15.1573"
    assert "platform" not in bodies


def test_each_limit_has_its_peak_time_and_share(robot, motion, page):
    wrench = (1.0, 2.0, -30.0, 0.0, 0.4, 0.0)
    result = robot.inverse_dynamics(motion, method="virtual-power", wrench=wrench)
    rows = {row[0]: row[1:] for row in page.tables["Utilisation of limits"][1:]}
    assert len(rows) == 10
    columns = {f"force {leg} [N]": (result.forces[:, k], 500.0) for k, leg in enumerate("ABC")} | {
        f"speed {leg} [m/s]": (result.slider_velocities[:, k], 0.5) for k, leg in enumerate("ABC")
    }
    when = {f"{one.quantity} {one.leg}": one.time for one in result.utilisations(robot.parameters.limits)}
    step = result.time[1] - result.time[0]
    for name, (values, limit) in columns.items():
        peak, time, shown, used = rows[name]
        most = int(np.argmax(np.abs(values)))
        assert float(peak) == pytest.approx(values[most], rel=5.1e-6)
        assert float(time) == pytest.approx(when[name.split(" [")[0]], rel=5.1e-6)
        assert abs(float(time) - result.time[most]) <= step  # the peak of the curve through the samples
        assert abs(float(shown)) == limit
        assert float(used.rstrip("%")) == pytest.approx(100 * abs(values[most]) / limit, abs=0.051)
    assert rows["tilt platform [rad]"][2] == "0.785398"
    assert float(rows["speed C [m/s]"][3].rstrip("%")) > 100  # an exceeded one is more than all of it


def test_parameters_are_complete(robot, page):
    geometry, parameters = robot.parameters.geometry, robot.parameters
    lengths = [float(row[1]) for row in page.tables["Geometry"][1:]]
    assert lengths == pytest.approx([geometry.r, geometry.R, geometry.L, geometry.b, geometry.h], rel=1e-5)
    rows = page.tables["Bodies"]
    for (name, body), row in zip(parameters.bodies.items(), rows[1:], strict=True):
        assert row[0] == name
        upper = body.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        expected = [body.mass, *body.com, *upper]
        np.testing.assert_allclose([float(cell) for cell in row[1:]], expected, rtol=5.1e-6, atol=1e-15)
    limits = {row[0]: row[1] for row in page.tables["Limits and gravity"][1:]}
    assert limits["slider speed [m/s]"] == "0.5"
    assert limits["slider travel [m]"] == "-0.2 to 0.2"
    assert limits["gravity x₀, y₀, z₀ [m/s²]"] == "0, 0, -9.806"
    friction = {row[0]: row[1:] for row in page.tables["Friction"][1:]}
    assert friction == {
        "slide_a": ["20", "0"],
        "slide_b": ["20", "0"],
        "slide_c": ["20", "0"],
        "hinge_a": ["0", "0.05"],
    }


@pytest.mark.usefixtures("undrawn")
def test_exceeded_limits_stand_in_a_box(robot, motion, page, html):
    result = robot.inverse_dynamics(motion, method="virtual-power")
    exceedances = result.exceedances(robot.parameters.limits)
    assert exceedances
    box = html[html.index('class="box care"') : html.index('<dl class="key">')]
    for exceedance in exceedances:
        assert f"<li>limit exceeded: {exceedance}</li>" in box
    assert "The two methods agree:" in page.text
    calm = report.render(p3dof.load(), p3dof.paper_motion(151))
    assert 'class="box care"' not in calm


@pytest.mark.usefixtures("undrawn")
def test_a_comparison_that_is_known_is_not_made_again(robot, motion, monkeypatch):
    """And the reactions are those of its forces by Pinocchio."""
    known = robot.compare(motion)
    again = report.render(robot, motion, date=NOON)
    monkeypatch.setattr("p3dof.manipulator.Manipulator.compare", None)
    page = Page(report.render(robot, motion, date=NOON, comparison=known))
    tables = Page(again).tables
    assert {title: rows for title, rows in page.tables.items() if title != "Evidence"} == {
        title: rows for title, rows in tables.items() if title != "Evidence"
    }
    for other in (p3dof.load().inverse_dynamics(motion), known.first):
        with pytest.raises(InputError, match=r"comparison: expected what robot\.compare found"):
            report.render(robot, motion, comparison=other)
    with pytest.raises(InputError, match=r"comparison: expected what robot\.compare found"):
        report.render(robot, p3dof.paper_motion(11), comparison=known)


def test_versions_date_and_command(page):
    for name in ("p3dof", "pin", "numpy", "Python"):
        assert name in page.text
    for version in (p3dof.__version__, np.__version__, sys.version.split()[0]):
        assert version in page.text
    assert "2024-05-06 12:00:00+00:00" in page.text
    assert f"p3dof report --title {HOSTILE}" in page.text


def test_nothing_is_loaded_from_elsewhere(html, page):
    for tag, attributes in page.tags:
        assert tag not in {"link", "object", "embed", "base", "form"}
        assert tag != "script" or not attributes
        for name in ("src", "href", "data", "action", "poster", "srcset", "background"):
            address = attributes.get(name)
            assert address is None or address.startswith(("data:image/svg+xml;base64,", "#"))
    style = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style
    assert re.search(r"https?://", html) is None
    policy = page.named("meta")[2]["content"]
    assert policy.startswith("default-src 'none'")


def test_on_a_phone_axe_finds_nothing_and_drawings_can_be_read_in_the_dark(html, tmp_path):
    axe = ROOT / "page/node_modules/axe-core/axe.min.js"
    if not axe.exists():
        pytest.skip("axe-core is not installed: `make page-check` installs what page/ needs")
    (tmp_path / "report.html").write_text(html, encoding="utf-8")
    with chromium() as browser:
        context = browser.new_context(viewport={"width": 390, "height": 844})
        page = context.new_page()
        page.goto((tmp_path / "report.html").as_uri())
        page.evaluate(axe.read_text(encoding="utf-8"))
        light = """(each) => Math.max(...getComputedStyle(each).backgroundColor.match(/\\d+/g).slice(0, 3))"""
        for theme in ("light", "dark"):
            page.emulate_media(media="screen", color_scheme=theme)
            found = page.evaluate("""async () => (await axe.run()).violations.map(
                ({id, impact, nodes}) => [id, impact, nodes.map(({html}) => html.slice(0, 100))])""")
            assert found == []
            assert page.evaluate("document.documentElement.scrollWidth") == 390
            assert (page.eval_on_selector("body", light) < 60) is (theme == "dark")
            if theme == "dark":  # their lines are dark
                assert min(page.eval_on_selector_all("figure img", f"(all) => all.map({light})")) == 255
            page.emulate_media(media="print", color_scheme=theme)
            assert page.eval_on_selector("body", light) == 255
        context.close()


def test_pictures_are_drawings_with_words(page):
    images = page.named("img")
    assert len(images) == 5
    for image in images:
        svg = base64.b64decode(image["src"].split(",", 1)[1]).decode("utf-8")
        assert svg.rstrip().endswith("</svg>")
        assert re.search(r'(href|src)="(?!#|data:)', svg) is None
        assert len(image["alt"]) > 40
        assert int(image["width"]) > 600
    assert len({image["alt"] for image in images}) == 5
    targets = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    links = [link["href"] for link in page.named("a")]
    instants = [link for link in links if link.startswith("#t=")]
    assert len(instants) == 10  # in the table of limits: three of each, and the tilt
    assert all(0.0 <= float(link.removeprefix("#t=")) <= 1.0 for link in instants)
    assert {link[1:] for link in links} - {link[1:] for link in instants} <= targets


def test_hostile_words_stay_words(html, page):
    assert html.count("<script") == 1  # the report's own
    assert "49" not in html[html.index("<h1>") : html.index("</header>")]
    assert page.text.count(HOSTILE) == 5  # title, heading, term, description, command
    (frame,) = page.named("iframe")
    assert frame["srcdoc"] == f"<!DOCTYPE html><p title='x'>{HOSTILE}</p>"
    assert frame["sandbox"] == "allow-scripts allow-downloads"
    assert frame["title"]


def test_the_same_motion_makes_the_same_page(robot, motion, html):
    assert full_page(robot, motion) == html


@pytest.mark.usefixtures("undrawn")
def test_invalid_samples_are_left_out(tmp_path):
    time = np.linspace(0, 1, 21)
    pose = np.column_stack([0.3 * time**2, 0 * time, 0 * time])
    motion = p3dof.Motion.from_poses(time, pose)
    with pytest.raises(ReachError, match="leg A is too short"):
        report.write(tmp_path / "r.html", p3dof.load(), motion)
    assert not list(tmp_path.iterdir())
    path = report.write(tmp_path / "r.html", p3dof.load(), motion, on_invalid="nan")
    page = Page(path.read_text(encoding="utf-8"))
    assert re.search(r"\d of 21 samples are invalid and left NaN", page.text)
    assert not re.search(r"\bnan\b", page.text.replace("left NaN", "").lower())
    far = p3dof.Motion(time, pose + 1, 0 * pose, 0 * pose, check=False)
    with pytest.raises(InputError, match=r"no sample of the motion .* \(21 samples\)"):
        report.render(p3dof.load(), far, on_invalid="nan")


def test_one_sample_is_enough():
    motion = p3dof.Motion([0.0], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    page = Page(report.render(p3dof.load(), motion))
    assert "1 samples over 0 s" in page.text
    assert not page.named("iframe")


@contextlib.contextmanager
def outside_world():
    """A server that gives everybody everything, and the paths that it was asked for."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_response(200)
            self.send_header("Access-Control-Allow-Origin", "*")
            self.end_headers()

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", asked
        finally:
            server.shutdown()
            thread.join()


@pytest.mark.usefixtures("undrawn")
def test_a_browser_runs_what_is_in_the_frame_and_lets_nothing_in_or_out(tmp_path, motion):
    with chromium() as browser, outside_world() as (address, asked):
        inner = f"""<!DOCTYPE html><body><img src="{address}/image"><script>
            document.body.dataset.ran = "yes";
            fetch("{address}/data").then(() => "loaded", () => "refused").then(
                what => document.body.dataset.fetch = what);
            try {{ parent.document.title }} catch (error) {{ document.body.dataset.apart = error.name }}
        </script></body>"""
        path = report.write(tmp_path / "r.html", p3dof.load(), motion, page=inner, title=HOSTILE)
        errors = []
        tab = browser.new_page(viewport={"width": 400, "height": 800})
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(path.as_uri())
        frame = next(frame for frame in tab.frames if frame is not tab.main_frame)
        frame.wait_for_function("document.body && document.body.dataset.fetch")
        found = frame.evaluate("({...document.body.dataset})")
        width = tab.evaluate("document.documentElement.scrollWidth")
        title = tab.title()
    assert found == {"ran": "yes", "fetch": "refused", "apart": "SecurityError"}
    assert asked == []
    assert errors == []
    assert title == HOSTILE
    assert width == 400  # wide tables scroll in themselves


@pytest.mark.usefixtures("undrawn")
def test_disagreement_is_shown(monkeypatch, motion):
    from p3dof.methods import virtual_power

    real = virtual_power.forces_at
    monkeypatch.setattr(virtual_power, "forces_at", lambda *a, **k: real(*a, **k) * (1 + 1e-9))
    html = report.render(p3dof.load(), motion)
    assert "The two methods DISAGREE:" in html
    assert 'class="box bad"' in html


@pytest.mark.usefixtures("undrawn")
def test_bad_arguments(robot, motion, tmp_path):
    for arguments, options, words in (
        ((None, motion), {}, "robot: expected a Manipulator, got None"),
        ((robot, None), {}, "motion: expected a Motion, got None"),
        ((robot, motion), {"title": 3}, "title: expected text, got 3"),
        ((robot, motion), {"command": b"x"}, "command: expected text, got bytes"),
        ((robot, motion), {"page": 1.5}, "page: expected text, got 1.5"),
        ((robot, motion), {"picture": "a.png"}, "picture: expected the bytes of a PNG, got 'a.png'"),
        ((robot, motion), {"date": "now"}, "date: expected a datetime, got 'now'"),
        ((robot, motion), {"wrench": (1, 2)}, "wrench"),
    ):
        with pytest.raises(InputError, match=words):
            report.render(*arguments, **options)
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="cannot be written"):
        report.write(tmp_path / "file" / "r.html", p3dof.load(), p3dof.paper_motion(3))


@pytest.mark.usefixtures("undrawn")
def test_a_pdf_is_printed(tmp_path, capsys):
    """Pages of A4 with an outline and tags, and a picture where the report has a page that moves."""
    find_chromium()  # skips where there is none
    out = tmp_path / "r.PDF"
    code, text, _ = run(capsys, "report", "--samples", 11, "--out", out, "--title", "Ä page")
    assert code == 0
    assert f"wrote {out}" in text
    pdf = out.read_bytes()
    assert pdf.startswith(b"%PDF-")
    boxes = [list(map(float, box.split())) for box in re.findall(rb"/MediaBox \[([^]]*)\]", pdf)]
    assert 3 <= len(boxes) <= 8
    np.testing.assert_allclose(boxes, np.tile([0, 0, 595, 842], (len(boxes), 1)), atol=1)
    titles = re.findall(rb"/Title \(([^)]*)\)", pdf)
    for title in (b"Machine", b"Motion", b"Forces", b"Drives and energy", b"Reactions", b"Provenance"):
        assert title in titles
    assert b"/StructTreeRoot" in pdf
    assert len(re.findall(rb"/Width 960\b", pdf)) == 1
    if shutil.which("pdftotext"):
        for number in range(1, len(boxes) + 1):
            ends = ["-f", str(number), "-l", str(number)]
            text = subprocess.run(
                ["pdftotext", "-layout", *ends, out, "-"], capture_output=True, check=True
            ).stdout
            assert re.search(rf"Ä page +{number} ?/ ?{len(boxes)}\s*$", text.decode())
    assert list(tmp_path.iterdir()) == [out]


def test_a_pdf_of_a_file_has_the_pictures_beside_it(tmp_path, monkeypatch):
    find_chromium()
    image = pytest.importorskip("PIL.Image", reason="Pillow not installed: pip install 'p3dof[viz]'")
    monkeypatch.chdir(tmp_path)
    image.new("RGB", (37, 11), "red").save("dot.png")
    Path("page.html").write_text("<title>Page</title><img src='dot.png' alt='a dot'>", encoding="utf-8")
    pdf = headless.pdf_of(Path("page.html"))
    assert pdf.startswith(b"%PDF-")
    assert b"/Width 37" in pdf


@pytest.mark.usefixtures("undrawn")
def test_a_pdf_without_a_browser_names_the_extra(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "playwright", None)
    for more in ((), ("--no-animation",)):
        code, _, err = run(capsys, "report", "--samples", 3, "--out", tmp_path / "r.pdf", *more)
        assert code == 2
        assert "p3dof[video]" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("missing", ["jinja2", "matplotlib.figure"])
def test_a_missing_library_names_the_extra(robot, motion, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(MissingExtraError, match=r"p3dof\[report\]"):
        report.render(robot, motion)


def test_number():
    assert [number(value) for value in (0.1, -0.0, np.nan, 1234567.0)] == ["0.1", "0", "–", "1.23457e+06"]


@pytest.mark.usefixtures("undrawn")
def test_the_command(tmp_path, capsys, monkeypatch):
    from p3dof.viewer.document import html

    def brief(document):
        (moving,) = document["runs"]
        joints = sum(load["group"] == "reaction" for load in moving["loads"])
        return f"<p>{moving['time']['shape']}, {joints} loads of joints</p>"

    monkeypatch.setattr(html, "page_html", brief)
    folder = tmp_path / "<img src=x onerror=alert(1)> ö"
    folder.mkdir()
    p3dof.write_parameters(p3dof.SOLIDS, folder / "m.yaml")
    p3dof.paper_motion(11).to_csv(folder / "m.csv")
    out = folder / "r.html"
    arguments = ["report", "--parameters", folder / "m.yaml", "--motion", folder / "m.csv", "--out", out]
    arguments += ["--payload", "2,0,0.01,0.1", "--title", "A page"]
    code, text, err = run(capsys, *arguments)
    assert (code, err) == (0, "")
    assert f"wrote {out}" in text
    page = Page(out.read_text(encoding="utf-8"))
    assert page.named("iframe")[0]["srcdoc"] == "<p>[11], 26 loads of joints</p>"
    assert all(image["src"].startswith("data:") for image in page.named("img"))
    assert f"--parameters={folder / 'm.yaml'}" in page.text
    assert "--payload=2.0,0.0,0.01,0.1" in page.text
    assert "2 kg at (0, 0.01, 0.1) m" in page.text
    assert page.text.count("A page") == 3
    # The command in the page makes the page again.
    line = next(line for line in page.text.splitlines() if line.startswith("p3dof report"))
    first = out.read_text(encoding="utf-8")
    code, _, _ = run(capsys, *shlex.split(line)[1:])
    dated = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d\d:\d\d")
    assert code == 0
    assert dated.sub("", out.read_text(encoding="utf-8")) == dated.sub("", first)


@pytest.mark.usefixtures("undrawn")
def test_the_command_without_a_page(tmp_path, capsys):
    out = tmp_path / "r.html"
    code, _, _ = run(capsys, "report", "--samples", 5, "--out", out, "--no-animation")
    assert code == 0
    page = Page(out.read_text(encoding="utf-8"))
    assert not page.named("iframe")
    assert not [link for link in page.named("a") if link["href"].startswith("#t=")]
    assert "--no-animation" in page.text
    assert "<script" not in out.read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn")
def test_bad_arguments_of_the_command(tmp_path, capsys, monkeypatch):
    motion = p3dof.paper_motion(5).to_csv(tmp_path / "m.csv").rename(tmp_path / "m.html")
    (tmp_path / "file").touch()
    for arguments, words in (
        (("--motion", motion, "--out", motion), "would be overwritten"),
        (("--motion", tmp_path / "none.csv"), "cannot be read"),
        (("--samples", 5, "--out", tmp_path / "file" / "r.html", "--no-animation"), "cannot be written"),
        (("--samples", 1), "1 is not in the range"),
        (("--format", "pdf"), "no such option"),
    ):
        code, out, err = run(capsys, "report", *arguments)
        assert code == 2
        assert words in err
        assert err.count("\n") == 1
        assert "wrote" not in out
    monkeypatch.setitem(sys.modules, "jinja2", None)
    code, _, err = run(capsys, "report", "--samples", 5, "--out", tmp_path / "r.html", "--no-animation")
    assert code == 2
    assert "p3dof[report]" in err
    assert not (tmp_path / "r.html").exists()


@pytest.mark.usefixtures("undrawn")
def test_an_interrupted_write_leaves_the_old_page(tmp_path, monkeypatch):
    path = tmp_path / "r.html"
    path.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(FileError, match="No space left"):
        report.write(path, p3dof.load(), p3dof.paper_motion(3))
    assert path.read_text() == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["r.html"]


def test_importing_the_report_loads_no_template_engine():
    rooms = "import sys, p3dof.report.page, p3dof.report.assessment, p3dof.report.templates"
    loaded = "print(sorted({'jinja2', 'matplotlib'} & set(sys.modules)))"
    command = [sys.executable, "-c", f"{rooms}; {loaded}"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == "[]"
    assert Path(report.__file__).parent.joinpath("report.html.j2").is_file()
