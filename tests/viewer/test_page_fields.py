"""Fields and links of the page: what is typed stays, what is refused is marked, what is left out is said."""

from __future__ import annotations

import pages
import pytest
from browser import opened
from playwright.sync_api import expect

import p3dof

ALARMS = {"light": "rgb(185, 28, 28)", "dark": "rgb(248, 113, 113)"}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    result = p3dof.Manipulator().inverse_dynamics(p3dof.paper_motion(101))
    return pages.written(tmp_path_factory.mktemp("pages"), result, slower=pages.slower(51, 2.0))


@pytest.fixture(scope="module")
def opened_page(browser, written):
    with pages.shared(browser, written) as watched:
        yield watched


@pytest.fixture
def watched(opened_page):
    yield pages.as_new(opened_page)
    opened_page.healthy()


def settled(watched):
    watched.page.evaluate("p3dof.state.refresh()")
    watched.page.evaluate(pages.SETTLED)


def test_a_pose_is_typed_while_the_run_plays(watched):
    field = watched.page.locator("#pose input[name=y]")
    watched.page.evaluate("p3dof.state.set({playing: true, speed: 0.25})")
    watched.wait("p3dof.state.time > 0.01")
    field.focus()
    watched.wait("!p3dof.state.playing")
    watched.page.evaluate("p3dof.state.set({playing: true})")  # by a script: a key pauses it as well
    field.press("Control+a")
    field.press_sequentially("12.5")
    watched.wait("!p3dof.state.playing")
    settled(watched)
    assert field.input_value() == "12.5"
    field.press("Enter")
    settled(watched)
    assert watched.page.evaluate("p3dof.instant().pose[0]") == pytest.approx(0.0125, abs=1e-15)


def test_a_pose_that_is_refused_is_marked_until_a_good_one_comes(watched):
    field, said = watched.page.locator("#pose input[name=y]"), watched.page.locator("#pose .refused")
    before = field.input_value()
    field.fill("9999")
    field.press("Tab")
    settled(watched)
    expect(field).to_have_attribute("aria-invalid", "true")
    assert (field.input_value(), "cannot go there" in said.inner_text()) == ("9999", True)
    for theme, colour in ALARMS.items():
        watched.page.evaluate("theme => p3dof.state.set({theme})", theme)
        expect(field).to_have_css("border-top-color", colour)
    field.fill("5")
    field.press("Enter")
    settled(watched)
    expect(field).not_to_have_attribute("aria-invalid", "true")
    assert said.inner_text() == ""
    for text in ("9999", ""):
        field.fill(text)
        field.press("Tab")
        settled(watched)
    assert (field.input_value(), said.inner_text()) == ("5.00", "")
    assert before != "5.00"
    tilt = watched.page.locator("#pose input[name=theta]")
    tilt.fill("9999")
    tilt.press("Enter")
    settled(watched)
    assert "within ±360°, got 9999°" in said.inner_text()


@pytest.mark.parametrize(
    ("label", "wrong", "sentence", "good"),
    [
        ("Payload", "1e9", "at most 1000 times the moving mass", "2"),
        ("Payload", "-1", "expected zero or more", "2"),
        ("… below P", "-99999", "at most 100 lengths of a leg from P", "20"),
        ("Base R", "60", "base R larger than the platform r", "260"),
    ],
)
def test_a_machine_that_cannot_be_marks_its_field(watched, label, wrong, sentence, good):
    field = watched.page.get_by_label(f"{label}, number", exact=True)
    alarm = watched.page.locator("#what-if [role=alert]")
    field.fill(wrong)
    field.blur()
    settled(watched)
    assert sentence in alarm.inner_text()
    assert watched.page.locator("[aria-invalid=true]").count() == 1
    expect(field).to_have_attribute("aria-invalid", "true")
    field.fill(good)
    settled(watched)
    assert watched.page.locator("[aria-invalid=true]").count() == 0
    assert alarm.text_content() == ""
    field.fill("")
    field.blur()
    settled(watched)
    assert float(field.input_value()) == float(good)


def test_the_base_is_not_tilted_beyond_a_turn(watched):
    watched.page.locator("select[name=gravity]").select_option("x")
    field = watched.page.get_by_label("Tilt of the base in degrees")
    known = watched.page.evaluate("p3dof.state.whatIf.gravity")
    field.fill("9999")
    field.blur()
    settled(watched)
    assert watched.page.evaluate("p3dof.state.whatIf.gravity") == known
    expect(field).to_have_attribute("aria-invalid", "true")
    assert "within ±360°, got 9999°. 30° is kept" in watched.page.locator("#what-if").inner_text()
    field.fill("45")
    settled(watched)
    expect(field).not_to_have_attribute("aria-invalid", "true")
    assert "is kept" not in watched.page.locator("#what-if").inner_text()
    field.fill("")
    field.blur()
    settled(watched)
    assert field.input_value() == "45"


def test_a_link_says_what_it_leaves_out(watched):
    kept = watched.page.evaluate("""() => {
        const {document} = p3dof.state, [first] = document.runs;
        window.filed = document;
        const runs = [...document.runs, {...first, computed: "waypoints"}, {...first, computed: "kept"}];
        p3dof.state.set({document: {...document, runs}, run: 2, whatIf: {payload: 1}});
        p3dof.seek(0.25);
        return runs.length;
    }""")
    assert kept == 4
    watched.page.get_by_role("button", name="Link", exact=True).click()
    watched.wait("location.hash === '#run=1&t=0.25'")
    said = watched.page.locator("#downloads [role=status]")
    for text in ("Not in it: planned runs (save the task)", "kept runs", "what-if"):
        expect(said).to_contain_text(text)
    watched.page.evaluate("p3dof.state.set({document: filed, run: 1, whatIf: {}})")
    watched.page.get_by_role("button", name="Link", exact=True).click()
    watched.wait("location.hash === '#run=2&t=0.25'")
    expect(said).not_to_contain_text("Not in it")


def test_a_link_to_no_run_is_said(browser, written):
    with opened(browser, f"{written}#run=7&t=0.3", ready=pages.READY) as linked:
        said = linked.page.locator("#heading [role=alert]")
        expect(said).to_contain_text("The link leads to run 7, but there are 2 runs here")
        linked.page.evaluate("location.hash = 'run=2&t=0.5'")
        expect(said).to_be_hidden()
        assert linked.page.evaluate("p3dof.state.run") == 1
        linked.healthy()


def test_the_tilt_has_the_units_that_are_chosen_and_no_minus_before_zero(watched):
    words = watched.page.locator("#stage .tilt span")
    watched.page.locator("#stage .views [data-view=front]").click()
    watched.page.evaluate("p3dof.state.set({hand: {pose: [0, 0, -1e-9]}})")
    expect(words).to_have_text("θ 0.0°")
    watched.page.evaluate("p3dof.state.set({units: 'SI'})")
    expect(words).to_have_text("θ 0.000 rad")
    watched.page.evaluate("p3dof.state.set({hand: {pose: [0, 0, -0.25]}})")
    expect(words).to_have_text("θ −0.250 rad")
