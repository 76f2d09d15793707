"""Results as a notebook shows them, and the tables that page, notebook and terminal share."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from html_pages import HOSTILE, Page
from rich.console import Console

import p3dof
from p3dof._base.tables import (
    Table,
    formatted,
    notebook_html,
    number,
    percent,
    table_html,
    table_of,
    time_text,
)
from p3dof.cli.output import show

MACHINE = replace(
    p3dof.PAPER,
    friction=p3dof.machine.Friction({"sliders": 20.0}, {"hinge_a": 0.05}),
    limits=p3dof.machine.Limits(force=100.0),
).carrying(p3dof.machine.Body(5.0, [0, 0, -0.1], [0.02, 0.02, 0.02]))


@pytest.fixture(scope="module")
def robot():
    return p3dof.load(MACHINE)


@pytest.fixture(scope="module")
def motion():
    return p3dof.paper_motion(41)


@pytest.fixture(scope="module")
def result(robot, motion):
    return robot.inverse_dynamics(motion)


@pytest.fixture(scope="module")
def shown(robot, motion, result):
    """Everything that a user of a notebook holds."""
    controller = p3dof.runs.PD(MACHINE, motion)
    start = p3dof.runs.InitialState(motion.pose[0], motion.velocity[0])
    return {
        "machine": MACHINE,
        "robot": robot,
        "motion": motion,
        "forces": result,
        "comparison": robot.compare(motion),
        "energy": robot.energy(result),
        "reactions": robot.reactions(motion, "paper"),
        "both reactions": robot.reactions(motion),
        "run": robot.simulate(0.2, start=start, controller=controller, method="compiled"),
    }


def page_of(thing):
    return Page(thing._repr_html_())


def column(page, title, k, rows=None):
    return [float(row[k]) for row in page.tables[title][1:][:rows]]


def near(found, expected):
    np.testing.assert_allclose(found, expected, rtol=5.1e-6, atol=1e-12)


NAMES = (
    "machine", "robot", "motion", "forces", "comparison", "energy", "reactions", "both reactions", "run",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_gets_whole_html_without_colours_of_its_own(shown, name):
    html = shown[name]._repr_html_()
    page = Page(html)  # every tag is closed where it must be
    assert page.tables
    assert len(html) < 12_000  # also of long motions
    assert {tag for tag, _ in page.tags} <= {
        *("div", "style", "p", "strong", "ul", "li"),
        *("table", "caption", "thead", "tbody", "tr", "th", "td"),
    }
    colours = re.findall(r"(?:color|background)[^:;{]*: *([^;!}]+)", html)
    assert {word.strip() for word in colours} <= {
        "inherit", "none", "color-mix(in srgb, currentColor 30%, transparent)"
    }  # fmt: skip
    assert "#" not in re.sub(r"&#?\w+;", "", html[html.index("<style>") : html.index("</style>")])


def test_the_numbers_of_a_machine(shown):
    page = page_of(MACHINE)
    geometry = MACHINE.geometry
    near(column(page, "Geometry", 1), [geometry.r, geometry.R, geometry.L, geometry.b, geometry.h])
    near(column(page, "Bodies", 1), [body.mass for _, body in MACHINE.bodies.items()])
    assert [row[0] for row in page.tables["Friction"][1:]] == ["slide_a", "slide_b", "slide_c", "hinge_a"]
    near(column(page, "Platform and payload", 1), [8.1573, 5, 13.1573])
    assert page.tables == page_of(shown["robot"]).tables
    assert "Friction" not in page_of(p3dof.PAPER).tables
    assert "Platform and payload" not in page_of(p3dof.PAPER).tables


def test_the_numbers_of_forces_and_energy(shown, result, motion):
    page = page_of(result)
    rows = "Forces, pinocchio"
    near(column(page, rows, 1), result.forces.min(axis=0))
    near(column(page, rows, 2), result.forces.max(axis=0))
    near(column(page, rows, 3), result.rms_forces)
    assert result.warnings
    before = page.text[: page.text.index(rows)]
    for warning in result.warnings:
        assert warning in before  # warnings first
    page, energy = page_of(shown["energy"]), shown["energy"]
    near(column(page, "Kinetic energy", 1), energy.kinetic.max(axis=0))
    near(column(page, "Loads of the drives", 1)[0], energy.drives.peak_force[0])
    near(column(page, "Change of the energy less the work done", 1), [energy.work_done[-1]])
    page = page_of(motion)
    near(column(page, "Motion", 1), motion.pose.min(axis=0))
    near(column(page, "Motion", 4), np.abs(motion.acceleration).max(axis=0))


def test_the_numbers_of_a_comparison_and_a_run(shown):
    found = shown["comparison"]
    page = page_of(found)
    assert found.verdict in page.text
    rows = "Forces by pinocchio and by virtual-power"
    near(column(page, rows, 1), found.second.peak_forces)
    near(column(page, rows, 2), found.second.rms_forces)
    assert [row[0] for row in page.tables["Evidence"][1:]] == ["pinocchio", "virtual-power"]
    assert page.tables["Others against virtual-power"][1][0] == found.compiled.name
    run = shown["run"]
    page = page_of(run)
    near(column(page, "Actuators", 1), np.abs(run.forces).max(axis=0))
    near(column(page, "Actuators", 3), run.sliders.min(axis=0))
    (row,) = page.tables["Largest tracking errors and forces, and the speed of the simulation"][1:]
    np.testing.assert_allclose([float(cell) for cell in row[1:4]], 1e3 * run.peak_error, rtol=6e-3)
    assert page.tables["Actuators"] != page.tables["Motion"]


def test_open_loads_stand_with_their_remark(shown):
    page = page_of(shown["both reactions"])
    assert "Rigid bodies do not determine the open loads" in page.text
    assert "open loads: elastic, paper, points" in page.text
    header = page.tables["Open forces: of elastic joints, and by two idealisations, which are no bounds"][0]
    assert [name.split()[-1] for name in header[1:]] == ["elastic", "paper", "points"] * 4


def test_samples_that_are_not_possible_are_told(robot):
    time = np.linspace(0, 1, 21)
    pose = np.column_stack([0.3 * time**2, 0 * time, 0 * time])
    part = p3dof.Motion.from_poses(time, pose)
    far = p3dof.Motion(time, pose + 1, 0 * pose, 0 * pose, check=False)
    for motion in (part, far):
        forces = robot.inverse_dynamics(motion, on_invalid="nan")
        reactions = robot.reactions(motion, on_invalid="nan")
        for thing in (forces, reactions, robot.compare(motion, on_invalid="nan")):
            page = page_of(thing)
            assert "invalid" in page.text
            assert "nan" not in page.text.replace("left NaN", "").lower()
        invalid = int((~forces.valid).sum())
        assert 0 < invalid != int(forces.valid.sum())
        assert f"{invalid} samples are invalid" in page_of(robot.energy(forces)).text


def test_a_run_that_ended_tells_why_and_its_words_stay_words(robot, tmp_path):
    run = robot.simulate(2.0, method="compiled")
    assert run.stop is not None
    page = page_of(run)
    assert f"ended by {run.stop}" in page.text
    foreign = replace(run, stop=replace(run.stop, reason=HOSTILE), method=HOSTILE)
    foreign = p3dof.Simulation.load(replace(foreign, method="compiled").save(tmp_path / "run.npz"))
    html = foreign._repr_html_()
    assert HOSTILE in Page(html).text
    assert "<script" not in html


def test_every_text_of_a_table_is_escaped():
    table = Table(HOSTILE, (HOSTILE, HOSTILE), ((HOSTILE, HOSTILE), (HOSTILE, 1.5)), HOSTILE, "wide")
    html = notebook_html(HOSTILE, HOSTILE, [table], [HOSTILE, "out\udcff.csv"], HOSTILE)
    page = Page(html)
    assert "<script" not in html
    assert page.text.count(HOSTILE) == 1 + 1 + 1 + 2 + 3 + 1 + 1 + 1
    assert page.tables[HOSTILE] == [[HOSTILE, HOSTILE], [HOSTILE, HOSTILE], [HOSTILE, "1.5"]]
    assert page.named("div")[-1]["aria-label"] == HOSTILE
    assert html.encode("utf-8")


def test_one_table_on_a_page_and_on_a_terminal(capsys):
    table = table_of(
        "A title", ("", "force [N]"), {"A": (118.498034,), "B": (np.nan,), "C": ("open",)}, "why"
    )
    assert Page(table_html(table)).tables["A title"][1:] == [["A", "118.498"], ["B", "–"], ["C", "open"]]
    show(Console(width=80), table, notes=True)
    lines = capsys.readouterr().out.splitlines()
    cells = re.findall(r"[│] (\S+) +│ +(\S+) +│", "\n".join(lines))
    assert cells == [("A", "118.4980"), ("B", "-"), ("C", "open")]
    assert lines[-1] == "why"
    assert (number(-0.0), number(np.nan), number(1 / 3)) == ("0", "–", "0.333333")


@pytest.mark.parametrize(("scheme", "ink"), [("dark", "rgb(221, 221, 221)"), ("light", "rgb(17, 17, 17)")])
def test_a_browser_shows_the_colours_of_the_notebook(browser, shown, scheme, ink):
    """Text, lines and background of every cell follow the page around it."""
    ground = {"dark": "rgb(17, 17, 17)", "light": "rgb(255, 255, 255)"}[scheme]
    html = shown["both reactions"]._repr_html_()
    page = browser.new_page()
    page.set_content(f"<!DOCTYPE html><body style='background:{ground};color:{ink}'>{html}</body>")
    cells = page.eval_on_selector_all(
        ".p3dof :is(th, td, caption, p)",
        "all => all.map(one => [getComputedStyle(one).color, getComputedStyle(one).backgroundColor])",
    )
    edges = page.eval_on_selector_all(
        ".p3dof tbody td", "all => all.map(one => getComputedStyle(one).borderBottomWidth)"
    )
    assert len(cells) > 200
    assert {tuple(cell) for cell in cells} == {(ink, "rgba(0, 0, 0, 0)")}
    assert set(edges) == {"1px"}


@pytest.mark.parametrize(
    ("share", "decimals", "text"),
    [
        (0.5, 1, "50.0%"),
        (1.0, 1, "100.0%"),
        (1.5, 0, "150%"),
        (1.00003, 1, "100.003%"),  # above the whole, by the first digit that shows it
        (1.004, 0, "100.4%"),
        (np.inf, 1, "beyond"),
    ],
)
def test_shares_just_above_the_whole_show_that_they_are(share, decimals, text):
    assert percent(share, decimals) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (72.14e-6, "72.1 µs"),
        (10.26e-3, "10.3 ms"),
        (1.234e-3, "1.23 ms"),
        (0.99996, "1 s"),
        (2.5e-10, "0.25 ns"),
    ],
)
def test_short_times_have_three_digits_and_their_unit(seconds, text):
    assert time_text(seconds) == text
    assert (
        time_text(float(text.split()[0]) * {"s": 1, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}[text[-2:].strip()])
        == text
    )


@pytest.mark.parametrize(
    ("layout", "tag"),
    [("plain", "<table>"), ("list", '<table class="words">'), ("wide", '<table class="wide">')],
)
def test_a_table_of_a_page_has_the_class_of_its_layout(layout, tag):
    table = Table("Title", ("name", "value"), [("a", "1")], layout=layout)
    assert tag in table_html(table)


def test_a_number_in_a_text():
    shown = [
        number(1234.56789, form=".3g"),
        number(-1e-9, "N", ".2f"),
        number(0.25, "m"),
        number(np.nan, "m"),
    ]
    assert shown == ["1230", "0 N", "0.25 m", "–"]
    assert [one.value for one in shown[:3]] == [1234.56789, -1e-9, 0.25]
    signs = [
        formatted(-1e-9, ".4f"),
        formatted(-0.0, ".3g", "J"),
        formatted(-4e-4, "+.1f", "%"),
        formatted(-0.0, ".1e"),
    ]
    assert signs == ["0.0000", "0 J", "+0.0 %", "0.0e+00"]
    assert [formatted(-5e-5, ".4f"), formatted(-np.inf, ".4f"), percent(-1e-4, 1)] == [
        "-0.0001",
        "-inf",
        "0.0%",
    ]
    assert table_of("T", ("a", "b"), {"work done": (-1e-7,)}).aligned() == (("work done", "0.0000"),)
    shown = [formatted(0.2264, "+.1f", "%"), formatted(0.2264, ".1%"), formatted(3e-5, ".1e", "m or rad")]
    assert shown == ["+22.6 %", "22.6%", "3.0e-05 m or rad"]
    assert [one.value for one in shown] == [0.2264, 0.2264, 3e-5]
    assert (repr(number(np.int64(4)).value), time_text(7.21e-5).value) == ("4", 7.21e-5)
