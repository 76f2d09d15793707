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
from p3dof.viewer.document.studio import save_studio, studio_document, studio_page

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
    pixel = read(page, "studio.charts[0].convertToPixel({ xAxisIndex: 1, yAxisIndex: 1 }, [0.1, 20])")
    box = page.page.locator("#map").bounding_box()
    page.page.mouse.click(box["x"] + pixel[0], box["y"] + pixel[1])
    page.wait("studio.state.place.i !== 10")
    at = read(
        page,
        "(({ studio: { map }, place }) => [map.y[place.i], map.theta[place.j]])(studio.state)",
    )
    assert (np.abs(np.subtract(at, [0.1, 20])) <= [0.013, 2.5]).all()  # half a cell
    pose = [at[0], 0, np.radians(at[1])]
    for row, index in enumerate(INDICES):
        shown = page.page.locator("#values td").nth(row).inner_text()
        assert float(shown) == pytest.approx(float(ROBOT.indices(pose).column(index)), rel=1e-3)
    data = np.array(read(page, "studio.charts[1].getOption().series[0].data"), dtype=float)
    along = np.column_stack([data[:, 0], np.zeros(len(data)), np.full(len(data), np.radians(at[1]))])
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


def test_hovering_tells_all_indices(page):
    pixel = read(page, "studio.charts[0].convertToPixel({ xAxisIndex: 1, yAxisIndex: 1 }, [0, 0])")
    box = page.page.locator("#map").bounding_box()
    page.page.mouse.move(box["x"] + pixel[0] + 3, box["y"] + pixel[1] + 3)
    page.wait(
        "[...document.querySelectorAll('#map div')].some((each) => each.textContent.includes('LTI: 0.6953'))"
    )


def test_what_is_selected_in_one_picture_is_in_the_other(page):
    """A box across points; then an area of an axis; then all."""
    corners = [
        read(page, f"studio.charts[3].convertToPixel({{ xAxisIndex: 0, yAxisIndex: 0 }}, [{x}, {y}])")
        for x, y in ((108, 0.525), (124, 0.495))
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
    problem = p3dof.DesignProblem({"R": (0.24, 0.28), "L": (0.38, 0.45)}, MOTION, ["peak_force", "width"])
    front = problem.pareto(points=3)
    found = studio_document(ROBOT, None, front, counts=(5, 5), indices=("lti",))["designs"]
    assert found["start"] == 0
    columns = {column["name"]: column for column in found["columns"]}
    assert columns["R"]["values"][0] == 0.25
    assert len(columns["R"]["values"]) == 1 + len(front)
    assert columns["peak_force"]["better"] == "small"
    assert_allclose(columns["peak_force"]["values"][1:], front.objectives[:, 0], rtol=1e-5)


def test_a_point_that_is_clicked_is_told(page):
    x, y = read(page, "studio.charts[3].convertToPixel({ xAxisIndex: 0, yAxisIndex: 0 }, [100, 0.56])")
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
        (("--index", "beauty"), "indices: unknown index 'beauty'"),
        (("--designs", "words.csv"), "expected columns of numbers"),
        (("--designs", "ragged.csv"), "ragged.csv, row 2: expected 2 cells, got 1"),
        (("--designs", "empty.csv"), "expected a header and a row"),
        (("--designs", "good.csv", "--large", "x"), "better: no column x among the designs"),
        (("--designs", "good.csv", "--start", "9"), "start: expected a whole number"),
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
