"""Waypoints in the page, and what Python makes of the files it saves: real clicks, keys and files."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import as_new, shared

import p3dof
from p3dof.cli import main
from p3dof.design.fastest import fastest_plan
from p3dof.design.forces_of_tasks import forces_of_task
from p3dof.design.tasks import Task, Waypoint, read_task
from p3dof.viewer.document.html import page_html
from p3dof.viewer.machine.document import page_document

MACHINE = p3dof.Manipulator()
LIMITS = MACHINE.parameters.limits
RUN = """() => {
    const run = p3dof.state.document.runs.find(({computed}) => computed === "waypoints");
    if (!run) return null;
    const curve = (key) => Array.from(run.curves.find((each) => each.key === key).values.data);
    const rows = (kind) => ["a", "b", "c"].map((leg) => curve(`${kind}_${leg}`));
    return {time: Array.from(run.time.data), force: rows("force"), speed: rows("speed"), power: rows("power"),
        pose: Array.from(run.pose.data), shown: p3dof.state.document.runs[p3dof.state.run] === run};
}"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("pages") / "page.html"
    path.write_text(page_html(page_document(MACHINE, p3dof.paper_motion(101))), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def opened_once(browser, written):
    with shared(browser, written, 1400, 1500) as watched:
        yield watched


@pytest.fixture
def watched(opened_once):
    opened_once.page.evaluate("""() => {
        const {document} = p3dof.state;
        p3dof.state.set({document: {...document, runs: document.runs.slice(0, 1)}, run: 0});
    }""")
    yield as_new(opened_once)
    opened_once.healthy()


def refreshed(watched):
    watched.page.evaluate("p3dof.state.refresh()")


def press(watched, name):
    watched.page.locator("#waypoints").get_by_role("button", name=name, exact=True).click()
    refreshed(watched)


def write(watched, label, text):
    field = watched.page.get_by_label(label, exact=True)
    field.fill(text)
    field.blur()
    refreshed(watched)


def add(watched, y, z, theta):
    """Move the platform by the fields of the pose [mm, deg], and add where it is."""
    for key, value in (("y", y), ("z", z), ("theta", theta)):
        field = watched.page.locator(f"#pose input[name={key}]")
        field.fill(str(value))
        field.blur()
        refreshed(watched)
    press(watched, "Add this pose")


def corners(watched):
    for pose in ((0, 0, 0), (120, 50, 17), (0, 100, 5), (-100, 100, -17), (0, -50, 0)):
        add(watched, *pose)
    write(watched, "Dwell or blend at waypoint 2", "0.1")
    watched.page.get_by_label("What happens at waypoint 3").select_option("pass")
    refreshed(watched)
    write(watched, "Dwell or blend at waypoint 3", "30")


def saved(watched, name, folder):
    with watched.page.expect_download() as waiting:
        press(watched, name)
    path = folder / waiting.value.suggested_filename
    waiting.value.save_as(path)
    return path


def found(watched):
    run = watched.page.evaluate(RUN)
    return {
        key: np.array(rows).T if key in ("force", "speed", "power") else rows for key, rows in run.items()
    }


def densely(robot, task):
    """What a task takes of each actuator, between the page's samples too: force, speed and power."""
    result = robot.inverse_dynamics(task.plan(samples=100_001).motion, method="compiled")
    return np.abs(result.forces), np.abs(result.slider_velocities), result.forces * result.slider_velocities


def test_the_fastest_motion_is_within_the_limits_and_python_makes_the_same_of_its_files(watched, tmp_path):
    corners(watched)
    assert found(watched)["shown"]
    watched.page.get_by_label("How long it takes").select_option("fastest")
    refreshed(watched)
    run = found(watched)
    told = watched.page.locator("#waypoints .result").inner_text()
    duration = run["time"][-1]
    assert f"{duration:.3f} s: the fastest of rest-to-rest quintics along these segments" in told
    assert "At its limit: force of B from 1 to 2" in told

    task = read_task(saved(watched, "Save task", tmp_path))
    force, speed, _ = densely(MACHINE, task)
    assert force.max() / LIMITS.force == pytest.approx(1, abs=1e-6)
    assert speed.max() / LIMITS.speed == pytest.approx(1, abs=1e-6)
    plan = task.plan()
    assert plan.duration == pytest.approx(duration, rel=1e-14)
    assert fastest_plan(MACHINE, read_task(tmp_path / "task.yaml")).duration <= duration * (1 + 1e-9)
    motion = p3dof.Motion.from_csv(saved(watched, "Save motion", tmp_path))
    assert_allclose(motion.time, run["time"], rtol=0, atol=0)
    same = plan.motion.resampled(motion.time)
    for name in ("pose", "velocity", "acceleration"):
        mine, its = getattr(motion, name), getattr(same, name)
        assert_allclose(mine, its, rtol=0, atol=1e-9 * np.abs(its).max())
    out = tmp_path / "forces.csv"
    assert main(["forces", "--motion", str(tmp_path / "motion.csv"), "--out", str(out)]) == 0
    table = np.genfromtxt(out, delimiter=",", names=True)
    forces = np.column_stack(
        [table[name] for name in table.dtype.names if name.lower().startswith(("force", "f"))][:3]
    )
    assert_allclose(run["force"], forces, rtol=0, atol=1e-9 * LIMITS.force)


@pytest.mark.slow
def test_the_power_limit_and_a_payload_make_it_slower(watched, tmp_path):
    corners(watched)
    watched.page.get_by_label("How long it takes").select_option("fastest")
    refreshed(watched)
    bare = found(watched)["time"][-1]
    write(watched, "Most power of each actuator", "200")
    assert found(watched)["time"][-1] > bare
    power = densely(MACHINE, read_task(saved(watched, "Save task", tmp_path)))[2]
    assert_allclose(power.max(), 200, rtol=1e-6)
    write(watched, "Most power of each actuator", "")
    write(watched, "Payload, number", "3")
    assert found(watched)["time"][-1] > bare
    assert "the same motion without it" in watched.page.locator("#waypoints .result").inner_text()
    heavy = p3dof.Manipulator(
        MACHINE.parameters.carrying(p3dof.machine.Body(3.0, [0, 0, 0], np.zeros((3, 3))))
    )
    task = read_task(saved(watched, "Save task", tmp_path))
    force = densely(heavy, task)[0]
    assert_allclose(force.max(), LIMITS.force, rtol=1e-6)
    assert task.carrying.to_dict() == {"mass": 3.0, "com": [0, 0, 0], "inertia": [[0.0] * 3] * 3}
    assert np.abs(forces_of_task(MACHINE, task.plan()).forces).max() == pytest.approx(LIMITS.force, rel=1e-4)
    write(watched, "Viscous friction, number", "20")
    status = watched.page.locator("#waypoints").get_by_text("A task file cannot hold").inner_text()
    assert "viscous friction of 20 N s/m more" in status
    text = saved(watched, "Save task", tmp_path).read_text(encoding="utf-8")
    assert "# left out, as a task has no field for it: viscous friction of 20 N s/m more" in text


def test_peaks_stay_where_a_waypoint_waits_long(watched):
    for pose in ((0, 0, 0), (120, 50, 17), (-100, 100, -17)):
        add(watched, *pose)
    watched.page.get_by_label("How long it takes").select_option("fastest")
    refreshed(watched)
    for wait in ("0", "500"):
        write(watched, "Dwell or blend at waypoint 2", wait)
        assert np.abs(found(watched)["force"]).max() == pytest.approx(LIMITS.force, rel=1e-3)


def test_limits_and_waits_that_are_none_are_refused(watched):
    add(watched, 0, 0, 0)
    add(watched, 100, 0, 0)
    watched.page.get_by_label("How long it takes").select_option("fastest")
    refreshed(watched)
    alarm = watched.page.locator("#waypoints [role=alert]:visible")
    fields = {
        "Most force of each actuator": ("0", "500", "most force of each actuator: expected more than zero N"),
        "Most speed of each actuator": ("", "1000", "most speed of each actuator: expected more than zero"),
        "Most power of each actuator": (
            "-5",
            "",
            "most power of each actuator: expected more than zero W, got -5",
        ),
        "Dwell or blend at waypoint 2": (
            "-1",
            "0",
            "waypoint 2: dwell: expected zero seconds or more, got -1",
        ),
    }
    for label, (wrong, right, sentence) in fields.items():
        field = watched.page.get_by_label(label, exact=True)
        write(watched, label, wrong)
        assert sentence in alarm.inner_text()
        assert field.get_attribute("aria-invalid") == "true"
        assert field.input_value() == wrong
        assert watched.page.evaluate(RUN) is None
        write(watched, label, right)
        assert field.get_attribute("aria-invalid") is None
        assert watched.page.evaluate(RUN) is not None


def test_waypoints_are_moved_changed_and_deleted_by_keys_and_pointer(watched):
    for pose in ((0, 0, 0), (100, 0, 0), (0, 100, 10)):
        add(watched, *pose)
    poses = "p3dof.state.task.waypoints.map(({pose}) => pose.map((x) => Math.round(1e3 * x)))"
    watched.page.get_by_label("Move waypoint 3 by arrow keys").press("ArrowUp")
    refreshed(watched)
    assert watched.page.evaluate(poses) == [[0, 0, 0], [0, 100, 175], [100, 0, 0]]
    focus = watched.page.evaluate("document.activeElement.getAttribute('aria-label')")
    assert focus == "Move waypoint 2 by arrow keys"
    grips = watched.page.locator(".waypoint .grip")
    first, last = grips.nth(0).bounding_box(), grips.nth(2).bounding_box()
    watched.page.mouse.move(first["x"] + 5, first["y"] + 5)
    watched.page.mouse.down()
    watched.page.mouse.move(last["x"] + 5, last["y"] + 12, steps=4)
    watched.page.mouse.up()
    refreshed(watched)
    assert watched.page.evaluate(poses) == [[0, 100, 175], [100, 0, 0], [0, 0, 0]]
    dots = watched.page.evaluate("""p3dof.state.stage.guests.children.filter(
        ({isMesh, visible}) => isMesh && visible).map(({position}) => position.toArray())""")
    h = MACHINE.parameters.geometry.h
    assert_allclose(dots, [[0, 0, 0.1 - h], [0, 0.1, -h], [0, 0, -h]], rtol=0, atol=1e-12)
    write(watched, "z of waypoint 2", "-60")
    assert watched.page.evaluate(poses)[1] == [100, -60, 0]
    write(watched, "Time in all", "4")
    assert found(watched)["time"][-1] == pytest.approx(4, abs=1e-12)
    press(watched, "Delete waypoint 1")
    assert watched.page.evaluate(poses) == [[100, -60, 0], [0, 0, 0]]
    press(watched, "Delete waypoint 1")
    assert watched.page.evaluate(RUN) is None
    assert watched.page.evaluate("p3dof.state.run") == 0


def test_a_way_that_cannot_be_made_says_where_and_why(watched):
    add(watched, 0, 0, 0)
    add(watched, 150, 0, 0)
    write(watched, "y of waypoint 2", "400")
    alarm = watched.page.locator("#waypoints [role=alert]:visible").inner_text()
    assert "waypoint 1 to waypoint 2: the path" in alarm
    assert "beyond its travel" in alarm
    assert watched.page.evaluate(RUN) is None


def test_files_of_python_are_loaded_and_wrong_ones_refused(watched, tmp_path):
    points = [
        Waypoint([0, 0, 0], "home", dwell=0.1),
        Waypoint([0.1, 0.03], blend=0.02),
        Waypoint([0.1, 0.1, 0.2], duration=0.8, wrench=[0, 10, -50, 0, 0, 0]),
    ]
    task = Task(points, "from Python", profile="septic")
    from p3dof.design.tasks import write_task

    write_task(task, tmp_path / "task.yaml")
    chooser = watched.page.locator("#waypoints input[type=file]")
    chooser.set_input_files(tmp_path / "task.yaml")
    watched.wait("p3dof.state.task.name === 'from Python'")
    refreshed(watched)
    run, plan = found(watched), task.plan()
    assert_allclose(run["time"], plan.motion.time, rtol=0, atol=1e-12)
    assert_allclose(np.reshape(run["pose"], (-1, 3)), plan.motion.pose, rtol=0, atol=1e-12)
    forces = MACHINE.inverse_dynamics(plan.motion, wrench=plan.wrench).forces
    jumps = np.isin(plan.motion.time, plan.times)
    assert_allclose(run["force"][~jumps], forces[~jumps], rtol=0, atol=1e-9 * np.abs(forces).max())

    plan.motion.to_csv(tmp_path / "motion.csv")
    chooser.set_input_files(tmp_path / "motion.csv")
    watched.wait("p3dof.state.document.runs[p3dof.state.run].name === 'motion.csv'")
    (tmp_path / "wrong.yaml").write_text("waypoints: [{pose: [1 s, 0, 0]}]")
    chooser.set_input_files(tmp_path / "wrong.yaml")
    alarm = watched.page.locator("#waypoints [role=alert]:visible")
    alarm.wait_for()
    assert "wrong.yaml: waypoint 1: pose: expected a length" in alarm.inner_text()


def test_waypoints_outlive_another_document_from_python(watched):
    add(watched, 0, 0, 0)
    add(watched, 100, 0, 0)
    write(watched, "Time in all", "2")
    forces = found(watched)["force"]
    watched.page.evaluate("""() => {
        const {document} = p3dof.state;
        p3dof.state.set({document: {...document, runs: [document.runs[0]]}, run: 0});
        p3dof.state.refresh();
    }""")
    run = found(watched)
    assert not run["shown"]
    assert (run["force"] == forces).all()
