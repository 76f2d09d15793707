"""The studio in a real browser: maps, slices and designs with the package's numbers, linked by clicks."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from browser import chromium, opened
from documents import ROOT
from numpy.testing import assert_allclose

import p3dof
from p3dof._base.errors import FileError, InputError
from p3dof.cli import main
from p3dof.viewer.machine.studio import save_studio, studio_document, studio_page

AXE = ROOT / "page/node_modules/axe-core/axe.min.js"
ROBOT = p3dof.load()
MOTION = p3dof.paper_motion(101)
INDICES = ("lti", "lci", "frequency_1")
COLUMNS = {
    "R [m]": np.linspace(0.24, 0.28, 9),
    "peak_force [N]": np.linspace(130, 100, 9),
    "width [m]": 2 * np.linspace(0.24, 0.28, 9),
    "reach [m]": np.linspace(0.1, 0.2, 9) ** 2,
    "same": np.ones(9),
}
BETTER = {"peak_force": "small", "width": "small", "reach": "large"}


def document(**options):
    return studio_document(ROBOT, MOTION, COLUMNS, indices=INDICES, counts=(21, 31), better=BETTER, **options)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("studio") / "studio.html"
    options = {"indices": INDICES, "counts": (21, 31), "better": BETTER, "start": 3}
    save_studio(path, ROBOT, MOTION, COLUMNS, **options)
    with chromium() as browser, opened(browser, path.as_uri(), 1300, 1400, "!!window.studio") as watched:
        yield watched
        watched.healthy()


def read(page, what):
    return page.page.evaluate(f"() => {what}")


def test_the_document_has_the_numbers_of_the_package():
    found = document()
    y, theta = np.array(found["map"]["y"]), np.radians(found["map"]["theta"])
    grid = np.stack(np.broadcast_arrays(y[None], 0.0, theta[:, None]), axis=-1)
    indices = ROBOT.indices(grid, on_invalid="nan")
    for item in found["map"]["indices"][:3]:
        values = np.array(item["values"], dtype=float).reshape(31, 21)
        assert_allclose(values, indices.column(item["name"]), rtol=1e-4, atol=1e-6)
        assert item["meaning"]
    height = np.array(found["map"]["indices"][3]["values"], dtype=float)
    assert_allclose(height, ROBOT.workspace().height(grid[..., 0], grid[..., 2]).ravel(), rtol=1e-4)
    inside = np.array(found["map"]["inside"]).reshape(31, 21)
    assert inside[np.abs(theta) < 0.78].all()
    assert not inside[np.abs(theta) > 0.79].any()
    assert np.abs(theta).min() < 1e-12
    path = np.array(found["path"]["points"])
    assert_allclose(path, np.column_stack([MOTION.pose[:, 0], np.degrees(MOTION.pose[:, 2])]), atol=1e-4)
    names = {curve["name"] for curve in found["loci"]}
    assert {"actuation above", "serial a", "serial b"} <= names
    assert [column["name"] for column in found["designs"]["columns"]] == ["R", "peak_force", "width", "reach"]


def test_the_page_is_whole_and_says_whose_work_is_in_it():
    html = studio_page(ROBOT, title="A <b>title</b>", counts=(11, 11))
    assert "A &lt;b&gt;title&lt;/b&gt;" in html
    assert "Apache License" in html
    assert "@@" not in re.sub(r"<script>.*?</script>", "", html, flags=re.DOTALL)
    (data,) = re.findall(r'id="p3dof-studio">(.*?)</script>', html, re.DOTALL)
    assert json.loads(data)["designs"] is None


def test_indices_are_chosen_and_slices_follow_a_click(page):
    page.page.select_option("#index", "1")
    page.wait("document.querySelector('#map').ariaLabel.startsWith('LCI over y')")
    pixel = read(page, "studio.charts[0].convertToPixel({ xAxisIndex: 1, yAxisIndex: 1 }, [100, 20])")
    box = page.page.locator("#map").bounding_box()
    page.page.mouse.click(box["x"] + pixel[0], box["y"] + pixel[1])
    page.wait("studio.state.place.i !== 10")
    at = read(page, "(({ studio: { map }, place }) => [map.y[place.i], map.theta[place.j]])(studio.state)")
    assert (np.abs(np.subtract(at, [0.1, 20])) <= [0.013, 2.5]).all()  # half a cell
    pose = [at[0], 0, np.radians(at[1])]
    for row, index in enumerate(INDICES):
        shown = page.page.locator("#values td").nth(row).inner_text()
        assert float(shown) == pytest.approx(float(ROBOT.indices(pose).column(index)), rel=1e-3)
    data = np.array(read(page, "studio.charts[1].getOption().series[0].data"), dtype=float)
    along = np.column_stack([data[:, 0] / 1000, np.zeros(len(data)), np.full(len(data), np.radians(at[1]))])
    assert_allclose(data[:, 1], ROBOT.indices(along, on_invalid="nan").column("lci"), rtol=1e-4)
    assert "LCI" in page.page.locator("#slice-theta").get_attribute("aria-label")


def test_keys_move_the_slices(page):
    before = read(page, "studio.state.place")
    page.page.focus("#map")
    page.page.keyboard.press("ArrowLeft")
    page.page.keyboard.press("ArrowUp")
    after = read(page, "studio.state.place")
    assert (after["i"], after["j"]) == (before["i"] - 1, before["j"] + 1)
    shown = float(page.page.locator("#values td").first.inner_text())
    y, theta = read(
        page, "(({ studio: { map }, place }) => [map.y[place.i], map.theta[place.j]])(studio.state)"
    )
    assert shown == pytest.approx(float(ROBOT.indices([y, 0, np.radians(theta)]).lti), rel=1e-3)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_serious(page, theme):
    if not AXE.exists():
        pytest.skip("axe-core is not installed: `make page-check` installs what page/ needs")
    page.page.emulate_media(color_scheme=theme)
    page.page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.page.evaluate("""async () => (await axe.run()).violations.map(
        ({id, impact, nodes}) => [id, impact, nodes.map(({html}) => html)])""")
    assert [each for each in found if each[1] in ("serious", "critical")] == []
    page.page.emulate_media(color_scheme="light")


def test_hovering_tells_the_chosen_index_in_four_rows_at_most(page):
    page.page.select_option("#index", "0")
    for theta, outside in ((0, False), (50, True)):
        pixel = read(
            page, f"studio.charts[0].convertToPixel({{ xAxisIndex: 1, yAxisIndex: 1 }}, [0, {theta}])"
        )
        box = page.page.locator("#map").bounding_box()
        page.page.mouse.move(box["x"] + pixel[0] + 3, box["y"] + pixel[1] + 3)
        tip = "[...document.querySelectorAll('#map > div')].map((each) => each.innerText)"
        tip += ".find((text) => text.includes('LTI: '))"
        page.wait(f"({tip} ?? '').includes('outside') === {str(outside).lower()} && {tip}")
        rows = read(page, tip).split("\n")
        assert rows[0].startswith("y = 0 mm, θ = ")
        assert len(rows) == 3 + outside
        assert rows[2].startswith("height [mm]: ")
        theta_of_cell = float(rows[0].partition("θ = ")[2].rstrip("°"))
        lti = float(ROBOT.indices([0, 0, np.radians(theta_of_cell)]).lti)
        assert float(rows[1].partition(": ")[2]) == pytest.approx(lti, rel=1e-3)


FRAMES = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(draws))))"


def test_a_click_moves_lines_over_the_map_which_is_not_drawn_anew(page):
    """Nor does the mouse over it."""
    page.page.mouse.move(5, 5)
    read(page, "studio.charts[0].on('rendered', () => window.draws++)")
    read(page, "new Promise((done) => setTimeout(() => requestAnimationFrame(done)))")
    read(page, "(window.draws = 0)")
    box = page.page.locator("#map").bounding_box()
    cell = "studio.charts[0].getModel().getComponent('grid').coordinateSystem.getRect()"
    half = [read(page, f"{cell}.width") / 42, read(page, f"{cell}.height") / 62]
    for y, theta in ((-100, -20), (50, 10), (0, 0)):
        at = read(
            page, f"studio.charts[0].convertToPixel({{ xAxisIndex: 1, yAxisIndex: 1 }}, [{y}, {theta}])"
        )
        page.page.mouse.click(box["x"] + at[0], box["y"] + at[1])
        page.wait(
            """([y, theta]) => {
                const {place: {i, j}, studio: {map}} = studio.state;
                return Math.abs(1000 * map.y[i] - y) < 13 && Math.abs(map.theta[j] - theta) < 2.5;
            }""",
            [y, theta],
        )
        assert read(page, FRAMES) == 0
        lines = page.page.locator("#map > .line")
        across, up = lines.nth(0).bounding_box(), lines.nth(1).bounding_box()
        assert abs(up["x"] + 0.5 - box["x"] - at[0]) <= half[0] + 0.5
        assert abs(across["y"] + 0.5 - box["y"] - at[1]) <= half[1] + 0.5
    page.page.select_option("#index", "1")
    page.wait("draws > 0")


SLIDERS = "[...document.querySelectorAll('#machine .leg')].map((leg) => Number(leg.dataset.slider))"


def test_the_machine_is_drawn_beside_the_map_at_the_chosen_pose(page):
    """Its sliders are where Python has them, and in the middle of their travel."""
    for i, j in ((10, 15), (14, 9), (5, 20)):
        read(page, f"studio.state.choosePlace({i}, {j})")
        y, theta = read(page, f"[studio.state.studio.map.y[{i}], studio.state.studio.map.theta[{j}]]")
        z = float(page.page.locator("#machine").get_attribute("data-z"))
        a, b, c, also_c = read(page, SLIDERS)
        assert c == also_c  # two rods on one slider
        wanted = ROBOT.inverse_kinematics([y, z, np.radians(theta)])
        assert_allclose([a, b, c], wanted.sliders, rtol=0, atol=1e-12)
        assert max(a, b, c) + min(a, b, c) == pytest.approx(sum(ROBOT.parameters.limits.travel), abs=1e-12)
    read(page, "studio.state.studio.machine.L = 0.2")  # no leg of this machine reaches the edge of the map
    read(page, "studio.state.choosePlace(0, 15)")
    assert read(page, SLIDERS) == []
    assert "does not reach" in page.page.locator("#machine").get_attribute("aria-label")
    read(page, "studio.state.studio.machine.L = 0.4")
    read(page, "studio.state.choosePlace(10, 15)")


def test_units_are_those_of_the_page(page):
    """Millimetres and degrees, or SI: in facts, axes, tables and choices, with the same machine."""
    page.page.select_option("#index", "2")
    assert page.page.inner_text("#facts").startswith("R = 250 mm, r = 100 mm, L = 400 mm; area ")
    sizes = {size["unit"]: size["value"] for size in read(page, "studio.state.studio.sizes")}
    for unit, factor in (("", 1), ("²", 1000)):
        said = re.search(rf" ([\d.e+]+) mm{unit} °", page.page.inner_text("#facts"))[1]
        assert float(said) == pytest.approx(1000 * factor * np.degrees(sizes[f"m{unit} rad"]), rel=1e-3)
    page.page.select_option("#units", "SI")
    page.wait(
        "document.querySelector('#facts').textContent.startsWith('R = 0.25 m, r = 0.1 m, L = 0.4 m; area ')"
    )
    assert re.search(
        rf"area {sizes['m rad']} m rad, volume [\d.]+ m² rad within", page.page.inner_text("#facts")
    )
    option = read(page, "studio.charts[0].getOption()")
    assert [option[axis][1]["name"] for axis in ("xAxis", "yAxis")] == ["y [m]", "θ [rad]"]
    height = float(page.page.locator("#values td").nth(3).inner_text())
    assert "height [m]" in page.page.inner_text("#values")
    assert page.page.locator("#across option").first.inner_text() == "R [m]"
    page.page.select_option("#units", "mm")
    page.wait("document.querySelector('#across option').text === 'R [mm]'")
    assert float(page.page.locator("#values td").nth(3).inner_text()) == pytest.approx(
        1000 * height, rel=1e-3
    )
    option = read(page, "studio.charts[0].getOption()")
    assert [option[axis][1]["name"] for axis in ("xAxis", "yAxis")] == ["y [mm]", "θ [°]"]


def test_what_is_selected_in_one_picture_is_in_the_other(page):
    """A box across points; then an area of an axis; then all."""
    corners = [
        read(page, f"studio.charts[3].convertToPixel({{ xAxisIndex: 0, yAxisIndex: 0 }}, [{x}, {y}])")
        for x, y in ((108, 525), (124, 495))
    ]
    box = page.page.locator("#front").bounding_box()
    mouse = page.page.mouse
    mouse.move(box["x"] + corners[0][0], box["y"] + corners[0][1])
    mouse.down()
    for share in (0.5, 1.0):
        x, y = (a + share * (b - a) for a, b in zip(*corners, strict=True))
        mouse.move(box["x"] + x, box["y"] + y)
    mouse.up()
    page.wait("studio.state.selected.size < 9")
    force, width = COLUMNS["peak_force [N]"], COLUMNS["width [m]"]
    expected = np.flatnonzero((force > 108) & (force < 124) & (width > 0.495) & (width < 0.525))
    assert sorted(read(page, "[...studio.state.selected]")) == expected.tolist()
    lines = read(
        page,
        "studio.charts[4].getOption().series[0].data.map((each) => [each.value[1], each.lineStyle.opacity])",
    )
    bright = {round(value, 3) for value, opacity in lines if opacity > 0.1}
    start_and_looked_at = {round(float(force[3]), 3)}
    assert bright == {round(float(value), 3) for value in force[expected]} | start_and_looked_at
    assert f"{len(expected)} of 9 designs selected" in page.page.inner_text("#count")
    page.page.click("#clear")
    page.wait("studio.state.selected.size === 9")
    read(
        page,
        "studio.charts[4].dispatchAction({ type: 'axisAreaSelect', intervals: [[99, 110]], "
        "parallelAxisId: studio.charts[4].getModel().getComponent('parallelAxis', 1).id })",
    )
    page.wait("studio.state.selected.size === 3")
    assert sorted(read(page, "[...studio.state.selected]")) == np.flatnonzero(force <= 110).tolist()
    with page.page.expect_download() as download:
        page.page.click("#save")
    header, *rows = download.value.path().read_text().splitlines()
    assert header == "design,R [m],peak_force [N],width [m],reach [m]"
    assert len(rows) == 3
    page.page.click("#clear")
    page.wait("studio.state.selected.size === 9")


def test_a_front_stands_beside_its_start():
    problem = p3dof.design.DesignProblem(
        {"R": (0.24, 0.28), "L": (0.38, 0.45)}, MOTION, ["peak_force", "width"]
    )
    front = problem.pareto(points=3)
    found = studio_document(ROBOT, None, front, counts=(5, 5), indices=("lti",))["designs"]
    assert found["start"] == 0
    columns = {column["name"]: column for column in found["columns"]}
    assert columns["R"]["values"][0] == 0.25
    assert len(columns["R"]["values"]) == 1 + len(front)
    assert columns["peak_force"]["better"] == "small"
    assert_allclose(columns["peak_force"]["values"][1:], front.objectives[:, 0], rtol=1e-5)


def test_a_point_that_is_clicked_is_told(page):
    x, y = read(page, "studio.charts[3].convertToPixel({ xAxisIndex: 0, yAxisIndex: 0 }, [100, 560])")
    box = page.page.locator("#front").bounding_box()
    page.page.mouse.click(box["x"] + x, box["y"] + y)
    page.wait("studio.state.design === 8")
    assert page.page.inner_text("#design caption").startswith("Design 9")
    page.page.select_option("#up", "3")
    page.wait("document.querySelector('#front').ariaLabel.includes('reach')")


def test_the_command_writes_it(tmp_path, capsys):
    table = tmp_path / "designs.csv"
    table.write_text(
        "# from a search\nstatus,R [mm],peak_force [N]\nfeasible,240,130\nfeasible,260,\n", "utf-8"
    )
    out = tmp_path / "studio.html"
    ask = ["studio", "--designs", str(table), "--small", "peak_force", "--start", "1", "--grid", "11"]
    assert main([*ask, "--index", "lti", "--samples", "11", "--out", str(out)]) == 0
    assert f"wrote {out}" in capsys.readouterr().out
    (data,) = re.findall(r'id="p3dof-studio">(.*?)</script>', out.read_text("utf-8"), re.DOTALL)
    columns = json.loads(data)["designs"]["columns"]
    assert [(c["name"], c["unit"], c["better"]) for c in columns] == [
        ("R", "mm", ""),
        ("peak_force", "N", "small"),
    ]
    assert columns[1]["values"] == [130, None]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--small", "x"), "belong to --designs"),
        (("--index", "beauty"), "error: --index: expected one of determinant"),
        (("--index", "lit"), "got 'lit'; did you mean 'lti'"),
        (("--designs", "words.csv"), "expected columns of numbers"),
        (("--designs", "ragged.csv"), "ragged.csv, row 2: expected 2 cells, got 1"),
        (("--designs", "empty.csv"), "expected a header and a row"),
        (("--designs", "good.csv", "--large", "x"), "--large: 'x' is no column of the designs; known: a, b"),
        (("--designs", "good.csv", "--large", "a", "--small", "a"), "'a' is given as --small and as --large"),
        (("--designs", "good.csv", "--start", "9"), "error: --start: expected a whole number from 1 to 1"),
        (("--designs", "none.csv"), "none.csv"),
    ],
)
def test_bad_input_is_one_line(arguments, told, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in {
        "words": "a,b\nx,y\n",
        "ragged": "a,b\n1,2\n3\n",
        "empty": "a\n",
        "good": "a,b\n1,2\n",
    }.items():
        (tmp_path / f"{name}.csv").write_text(text, "utf-8")
    assert main(["studio", *arguments, "--grid", "7", "--out", "studio.html"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("p3dof: error: ")
    assert error.count("\n") == 1
    assert told in error
    assert not (tmp_path / "studio.html").exists()


def test_bad_arguments_are_told(tmp_path):
    with pytest.raises(InputError, match="counts: expected a whole number from 5"):
        studio_page(ROBOT, counts=(2, 5))
    with pytest.raises(InputError, match="motion: expected a Motion"):
        studio_page(ROBOT, "paper")
    with pytest.raises(InputError, match="expected 'small' or 'large'"):
        studio_page(ROBOT, None, {"a": [1.0]}, better={"a": "good"}, counts=(5, 5))
    with pytest.raises(InputError, match="one number a design"):
        studio_page(ROBOT, None, {"a": [[1.0]]}, counts=(5, 5))
    (tmp_path / "file").touch()
    with pytest.raises(FileError):
        save_studio(tmp_path / "file" / "studio.html", ROBOT, counts=(5, 5))
