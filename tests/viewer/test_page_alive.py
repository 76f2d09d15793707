"""A robot's page that moves by itself: without network or Python, with the forces of Pinocchio's layer."""

from __future__ import annotations

import json

import closed_loop_robots as robots
import closure_robots
import numpy as np
import pinocchio as pin
import pytest
from browser import opened
from gallery import GALLERY

import p3dof
from p3dof._base.errors import InputError
from p3dof.loops import Bushing
from p3dof.loops.sidecar import Coupling, JointData
from p3dof.runs import simulate_robot
from p3dof.viewer.answers import RobotAnswers
from p3dof.viewer.document.document import robot_document
from p3dof.viewer.document.encoding import decoded, encoded
from p3dof.viewer.document.html import page_html
from p3dof.viewer.document.motion import JointMotion

READY = "!!window.p3dof && p3dof.ready.then(() => true)"
NAMES = sorted(path.stem for path in GALLERY.glob("*.urdf"))
LARGEST = 1_200_000  # of a page of the gallery [bytes]
MOVES = """([count, share]) => {
    // one joint at a time, by a share of its range; with what the page shows there
    const { engine, document: { inputs } } = p3dof.state, found = [];
    let seed = 1;
    const random = () => (seed = (16807 * seed) % 2147483647) / 2147483647;
    for (let i = 0; i < count; i++) {
        const input = inputs[Math.floor(random() * inputs.length)];
        const now = engine.values(p3dof.instant().q)[inputs.indexOf(input)];
        const goal = now + share * (input.high - input.low) * (2 * random() - 1);
        const value = Math.min(Math.max(goal, input.low), input.high);
        engine.move({ inputs: { [input.key]: value } });
        p3dof.state.refresh();
        const { q, values, loads } = p3dof.instant(), { refused, hand } = p3dof.state;
        found.push({
            q: [...q], values, loads: Object.fromEntries(loads.map((one) => [one.load.key, one.vector])),
            asked: [input.key, value], refused: refused?.text ?? "",
            notes: hand ? engine.held(hand).notes : [],
        });
    }
    const plain = (_, x) => (typeof x === "number" && !isFinite(x) ? null : x);
    return found.map((one) => JSON.stringify(one, plain));
}"""
STATE = """([q, v, tau]) => {
    const { engine } = p3dof.state, at = engine.at(Float64Array.from(q));
    const found = engine.accelerated(at, Float64Array.from(v), tau);
    return { a: [...found.a], lambda: [...found.lambda], tau: [...engine.inverse(at, v, found.a)] };
}"""


@pytest.fixture
def alone(browser, tmp_path):
    """Opens a document as a file."""

    def open_(document, width=900, height=700):
        path = tmp_path / "page.html"
        path.write_text(page_html(document), encoding="utf-8")
        return opened(browser, path.as_uri(), width, height, READY)

    return open_


def some(names, now):
    """All names as parameters; those that are not tested now are slow."""
    return [name if name in now else pytest.param(name, marks=pytest.mark.slow) for name in sorted(names)]


def gallery(name):
    return p3dof.load_robot(GALLERY / f"{name}.urdf")


def moved(watched, count, share):
    return [json.loads(one) for one in watched.page.evaluate(MOVES, [count, share])]


def same(found, expected, largest, what):
    """Numbers to 1e-10 of the largest force; none where none is known."""
    assert found is not None or expected is None, what
    if expected is not None:
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * largest, err_msg=what)


def check_forces(robot, moves, answers):
    """The forces of a page at its configurations are those of the general layer there."""
    for move in moves:
        q = np.array(move["q"])
        assert np.abs(robot.closure_error(q)).max(initial=0.0) < 2e-12
        expected = answers({"q": q, "inputs": {}})
        sizes = [abs(x) for key, x in expected["values"].items() if "force" in key or "moment" in key if x]
        largest = max(1.0, *sizes)
        for key, value in expected["values"].items():
            same(move["values"][key], value, largest, key)
        for key, vector in expected["loads"].items():
            if key not in move["loads"] and (not np.any(vector) or key.startswith("wrench")):
                continue  # a moment in a ball, or a load that is given
            same(move["loads"].get(key), vector, largest, key)


@pytest.mark.parametrize("name", some(NAMES, ("biped", "gripper", "stewart")))
def test_a_page_of_the_gallery_has_the_forces_of_pinocchio_at_fifty_poses(alone, name):
    robot = gallery(name)
    document = robot_document(robot)
    with alone(document) as watched:
        (address,) = watched.requests
        assert address.startswith("file:")
        assert watched.page.evaluate("p3dof.state.engine.agreement.count") == 4
        assert watched.page.evaluate("p3dof.state.engine.agreement.most") < 1e-10
        moves = moved(watched, 50, 0.1)
        good = [move for move in moves if not move["refused"]]
        assert len(good) >= 25
        for move in good:
            key, value = move["asked"]
            assert move["values"][f"q {key}"] == pytest.approx(value, abs=1e-11)
        check_forces(robot, good, RobotAnswers(robot, robot.assemble().q))
        told = watched.page.inner_text(".agreement")
        assert told.startswith("Forces and accelerations of this page agree with Pinocchio's to ")
        watched.healthy()


def test_pages_of_the_gallery_are_small(tmp_path):
    for name in NAMES:
        page = p3dof.robot_page(gallery(name), shapes=GALLERY / f"{name}.urdf")
        assert page.save(tmp_path / f"{name}.html").stat().st_size < LARGEST


def consistent(robot, q, draw):
    """A velocity and forces of the motors at a closed configuration."""
    J = robot.closure_jacobian(q)
    N = np.linalg.svd(J)[2][robot.rank(q) :].T if J.size else np.eye(robot.model.nv)
    return N @ draw.normal(size=N.shape[1]), 5.0 * draw.normal(size=len(robot.actuated))


def check_state(watched, robot, q, draw):
    v, tau = consistent(robot, q, draw)
    found = watched.page.evaluate(STATE, [list(q), list(v), list(tau)])
    expected = robot.forward_dynamics(q, v, tau)
    scale = np.abs(expected.a).max()
    np.testing.assert_allclose(found["a"], expected.a, rtol=0, atol=1e-10 * max(1.0, scale))
    largest = max(1.0, np.abs(expected.lambda_).max(initial=0.0))
    np.testing.assert_allclose(found["lambda"], expected.lambda_, rtol=0, atol=1e-10 * largest)
    np.testing.assert_allclose(found["tau"], tau, rtol=0, atol=1e-10 * largest)


@pytest.mark.parametrize("kind", some(closure_robots.MASSLESS, ("hinge",)))
def test_every_kind_of_closure_gives_the_accelerations_of_pinocchio(alone, kind):
    """The general layer itself is held to the same loop, built with massless joints, in other tests."""
    robot, twin, place = closure_robots.built_otherwise(kind, 3)
    q = place[closure_robots.common(twin.model)]
    with alone(robot_document(robot, None, JointMotion([0.0], q[None]))) as watched:
        check_state(watched, robot, q, np.random.default_rng(1))
        watched.healthy()


def test_every_kind_of_joint_with_springs_friction_dampers_and_a_bushing(alone):
    """A floating tree of eleven joints: what acts in them by itself is in the traced functions, too."""
    model, draw = closure_robots.tree(2), np.random.default_rng(2)
    names = [str(name) for name in model.names[1:]]
    ball = next(name for name in names if name.startswith("ball"))
    data = [JointData(name, damping=0.3, friction=0.2) for name in names if name.startswith("circle")]
    data += [JointData(ball, stiffness=4.0, rest=(0.1, -0.2, 0.3, np.sqrt(0.86)))]
    data += [JointData(name, stiffness=30.0, rest=0.1) for name in names if name.startswith("hinge")]
    motors = tuple(name for name in names if model.nvs[model.getJointId(name)] == 1)
    ends = [str(frame.name) for frame in model.frames if frame.parentJoint in (1, model.njoints - 1)][::-1]
    mount = Bushing((ends[0], ends[-1]), (30, 20, 40, 0.5, 0.3, 0.2), (3, 2, 4, 0.2, 0.1, 0.3))
    robot = p3dof.ClosedLoopModel(model, p3dof.Sidecar((), motors, joint_data=tuple(data), bushings=(mount,)))
    q = pin.integrate(model, pin.neutral(model), draw.normal(size=model.nv))
    with alone(robot_document(robot, None, JointMotion([0.0], q[None]))) as watched:
        check_state(watched, robot, q, draw)
        # a point's Jacobian, which pulls bodies, against Pinocchio's
        data = model.createData()
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        find = """([q, joint, point]) => {
            const { engine } = p3dof.state;
            return [...engine.pointJacobian(engine.tree.place(q), joint, point)];
        }"""
        for joint in range(1, model.njoints):
            point = draw.normal(size=3)
            found = watched.page.evaluate(find, [list(q), joint - 1, list(point)])
            frame = pin.SE3(np.eye(3), point)
            J = pin.getFrameJacobian(model, data, joint, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
            np.testing.assert_allclose(np.reshape(found, (3, -1)), J, rtol=0, atol=1e-12)
        watched.healthy()


def test_couplings_hold_while_a_joint_is_moved(alone):
    """A five-bar whose motors are geared by a polynomial: one freedom, and a torque in the gear."""
    gear = Coupling("right_joint", "left_joint", (0.7, -0.8, 0.05))
    robot = p3dof.ClosedLoopModel.from_urdf(
        robots.five_bar(), p3dof.Sidecar(robots.FIVE_BAR_SIDECAR.closures, ("left_joint",), couplings=(gear,))
    )
    with alone(robot_document(robot)) as watched:
        moves = [move for move in moved(watched, 12, 0.03) if not move["refused"]]
        assert len(moves) >= 6
        check_forces(robot, moves, RobotAnswers(robot, robot.assemble().q))
        assert abs(moves[-1]["values"]["coupling 1"]) > 1e-3
        watched.healthy()


def changed(robot, change):
    """A robot with another model."""
    other = robot.copy()
    change(other.model)
    return other


def test_payload_mass_gravity_and_loads_are_those_of_another_robot(alone):
    given = gallery("stewart")
    body = given.model.getJointId("platform_free")
    own = given.model.inertias[body]
    wrench = np.array([3.0, -2.0, 1.0, 0.4, 0.1, -0.3])
    model = given.model.copy()
    model.addFrame(pin.Frame("centre", body, pin.SE3(np.eye(3), own.lever), pin.FrameType.OP_FRAME))
    robot = p3dof.ClosedLoopModel(model, given.sidecar)

    def heavier(model):
        model.inertias[body] = pin.Inertia(1.7 * own.mass, own.lever, 1.7 * own.inertia)

    def loaded(model):
        model.inertias[body] = own + pin.Inertia(2.5, own.lever, np.zeros((3, 3)))

    def tilted(model):
        model.gravity.linear = 9.81 * np.array([0.0, -0.5, -np.sqrt(0.75)])

    cases = (
        ("payload", 2.5, changed(robot, loaded), {}),
        ("mass", 1.7 * own.mass, changed(robot, heavier), {}),
        ("gravity", "x", changed(robot, tilted), {}),
        ("wrench", wrench, robot, {"centre": wrench}),
    )
    with alone(robot_document(robot), 1200, 900) as watched:
        page = watched.page
        assert page.locator("[name=body] option:checked").inner_text() == "platform"
        assert float(page.locator("[name=mass]").input_value()) == own.mass
        for kind, value, other, external in cases:
            if kind == "gravity":
                page.select_option("#what-if [name=gravity]", "x")
            elif kind == "wrench":
                page.locator("#what-if details summary").first.click()
                boxes = page.locator("#what-if .wrench input")
                for i, part in enumerate(wrench):
                    boxes.nth(i).fill(str(part))
            else:
                page.fill(f"[name={kind}]", str(value))
            watched.wait("p3dof.state.engine.changed && p3dof.instant().byHand")
            check_forces(other, moved(watched, 3, 0.02), RobotAnswers(other, other.assemble().q, external))
            if kind == "wrench":
                keys = page.evaluate("p3dof.instant().loads.map((one) => one.load.key)")
                assert "wrench force platform" in keys
            page.click("#reset")
            watched.wait("!p3dof.state.engine.changed")
        check_forces(robot, moved(watched, 1, 0.02), RobotAnswers(robot, robot.assemble().q))
        watched.healthy()


PULL = """([joint, goal]) => {
    p3dof.state.engine.pull(joint, [0, 0, 0], goal);
    p3dof.state.refresh();
    const { q, placements } = p3dof.instant();
    return { q: [...q], at: [12, 13, 14].map((k) => placements[16 * joint + k]) };
}"""


def test_a_platform_is_pulled_with_closed_loops_and_within_the_ranges_of_its_motors(alone):
    robot = gallery("stewart")
    body = robot.model.getJointId("platform_free") - 1
    q = robot.assemble().q
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    home, draw = data.oMi[body + 1].translation.copy(), np.random.default_rng(4)
    with alone(robot_document(robot)) as watched:
        for _ in range(5):
            goal = home + 0.03 * draw.normal(size=3) / np.sqrt(3)
            found = watched.page.evaluate(PULL, [body, list(goal)])
            np.testing.assert_allclose(found["at"], goal, rtol=0, atol=1e-6)
            assert np.abs(robot.closure_error(np.array(found["q"]))).max() < 2e-12
        far = watched.page.evaluate(PULL, [body, list(home + np.array([0.0, 0.0, 5.0]))])
        values = watched.page.evaluate("() => p3dof.state.engine.values(p3dof.instant().q)")
        ranges = watched.page.evaluate("p3dof.state.document.inputs.map(({ low, high }) => [low, high])")
        for value, (low, high) in zip(values, ranges, strict=True):
            assert low <= value <= high
        assert far["at"][2] > home[2]
        assert np.abs(robot.closure_error(np.array(far["q"]))).max() < 2e-12
        watched.healthy()


def test_no_joint_goes_beyond_its_limits_by_a_slider_of_another(alone):
    """The elbow of a five-bar with a limit just beyond where it is."""
    given = gallery("five_bar")
    model, q = given.model.copy(), given.assemble().q
    elbow = next(str(n) for n in model.names[1:] if n not in given.actuated)
    at = model.idx_qs[model.getJointId(elbow)]
    upper = model.upperPositionLimit
    upper[at] = q[at] + 0.02
    model.upperPositionLimit = upper
    robot = p3dof.ClosedLoopModel(model, given.sidecar)
    with alone(robot_document(robot, None, JointMotion([0.0], q[None]))) as watched:
        moves = moved(watched, 40, 0.03)
        refused = [move for move in moves if move["refused"]]
        words = f"The robot cannot go there: the joint {elbow} is at its upper limit"
        assert words in {move["refused"] for move in refused}
        assert max(move["q"][at] for move in moves) <= q[at] + 0.02
        watched.healthy()


def test_a_body_is_dragged_by_the_pointer(alone):
    robot = gallery("five_bar")
    with alone(robot_document(robot), 1000, 700) as watched:
        grips = """() => {
            const { stage } = p3dof.state, found = [];
            for (let x = 20; x < stage.width; x += 6) for (let y = 20; y < stage.height; y += 6) {
                const grip = stage.gripAt(x, y);
                if (grip) found.push([grip.place, ...grip.point.toArray(), x, y]);
            }
            return found;
        }"""
        found = [one for one in watched.page.evaluate(grips) if one[0] == 1]  # a rod, not its motor
        place, *point, x, y = found[len(found) // 2]
        watched.page.mouse.move(x, y)
        watched.page.mouse.down()
        watched.page.mouse.move(x + 12, y - 9, steps=4)
        watched.wait("p3dof.state.hand !== null")
        seen = """([place, p]) => {
            p3dof.state.refresh();
            const m = p3dof.instant().placements.subarray(16 * place, 16 * place + 16);
            return p3dof.state.stage.pixel([0, 1, 2].map((k) =>
                m[k] * p[0] + m[4 + k] * p[1] + m[8 + k] * p[2] + m[12 + k]));
        }"""
        watched.wait(f"{seen.strip()[: seen.strip().rindex('}')]}}}" and "p3dof.instant().byHand")
        at = watched.page.evaluate(seen, [place, point])
        assert np.hypot(at[0] - (x + 12), at[1] - (y - 9)) < 1.0
        q = np.array(watched.page.evaluate("() => [...p3dof.instant().q]"))
        assert np.abs(robot.closure_error(q)).max() < 1e-12
        watched.page.mouse.up()
        watched.healthy()


def run_of(watched, count):
    """The last run of the page when there are so many: times and configurations."""
    watched.wait(f"p3dof.state.document.runs.length === {count}")
    return watched.page.evaluate(
        "() => { const run = p3dof.state.document.runs.at(-1); return { name: run.name, notes: run.notes,"
        " time: [...run.time.data], q: [...run.q.data], keys: run.curves.map(({ key }) => key),"
        " curves: run.curves.map(({ values }) => [...values.data].map((x) => isNaN(x) ? null : x)) }; }"
    )


@pytest.mark.parametrize("name", ["four_bar", "leg"])
def test_a_robot_falls_in_the_page_as_in_python(alone, name):
    """The leg until its knee is at its limit."""
    robot = gallery(name)
    with alone(robot_document(robot), 1100, 900) as watched:
        page = watched.page
        page.select_option("[name=motors]", "off")
        page.fill("[name=duration]", "0.3")
        page.click("[name=simulate]")
        found = run_of(watched, 2)
        assert found["name"] == "Falling 1"
        q = np.reshape(found["q"], (len(found["time"]), -1))
        expected = simulate_robot(robot, 0.3, samples=76, method="general")
        if name == "leg":
            assert found["notes"] == ["The run ended early: the joint knee is at its lower limit."]
            assert "'knee' at its lower limit" in str(expected.stop)
        else:
            assert found["notes"] == []
        np.testing.assert_allclose(found["time"], expected.time, rtol=0, atol=1e-6)
        np.testing.assert_allclose(q, expected.q, rtol=0, atol=2e-5 if name == "leg" else 1e-8)
        np.testing.assert_allclose(q[:-1], expected.q[:-1], rtol=0, atol=1e-8)
        assert np.abs(robot.closure_error(q[-1])).max() < 1e-12
        watched.healthy()


def test_pd_control_holds_a_pose_goes_to_another_and_can_be_stopped(alone):
    robot = gallery("five_bar")
    q0 = robot.assemble().q
    with alone(robot_document(robot), 1100, 900) as watched:
        page = watched.page
        page.fill("[name=duration]", "0.2")
        page.click("[name=simulate]")
        found = run_of(watched, 2)
        np.testing.assert_allclose(np.reshape(found["q"], (-1, len(q0)))[-1], q0, rtol=0, atol=1e-9)
        name = robot.actuated[0]
        page.evaluate("([name, value]) => p3dof.state.engine.move({ inputs: { [name]: value } })",
                      [name, float(q0[0] + 0.2)])  # fmt: skip
        page.select_option("[name=motors]", "go")
        page.fill("[name=duration]", "1.5")
        page.fill("[name=damping]", "1")
        page.click("[name=simulate]")
        found = run_of(watched, 3)
        q = np.reshape(found["q"], (-1, len(q0)))
        assert abs(q[0, 0] - q0[0]) == pytest.approx(0.2, abs=1e-9)
        np.testing.assert_allclose(q[-1], q0, rtol=0, atol=1e-6)
        force = found["curves"][found["keys"].index(f"force {name}")]
        assert max(map(abs, force)) > abs(force[-1])
        page.fill("[name=duration]", "60")
        page.click("[name=simulate]")
        watched.wait("document.querySelector('#what-if progress').value > 0")
        page.click("[name=simulate]")
        found = run_of(watched, 4)
        assert found["notes"] == ["The run was stopped."]
        for wrong in ("0", "-1", "61", ""):
            page.fill("[name=duration]", wrong)
            page.click("[name=simulate]")
            watched.wait("document.querySelector('#what-if').innerText.includes('Duration [s]: expected')")
        watched.healthy()


def test_what_the_hand_does_is_recorded_and_saved(alone):
    robot = gallery("five_bar")
    with alone(robot_document(robot), 1100, 900) as watched:
        page = watched.page
        page.click("[name=record]")
        assert page.get_attribute("[name=record]", "aria-pressed") == "true"
        page.click("[name=record]")
        watched.wait("document.querySelector('#what-if').innerText.includes('Nothing was recorded')")
        page.click("[name=record]")
        moves = []
        for _ in range(4):
            moves += moved(watched, 1, 0.02)
            last = page.evaluate("performance.now()")
            page.wait_for_function("last => performance.now() > last + 5", arg=last)
        page.click("[name=record]")
        found = run_of(watched, 2)
        assert found["name"] == "Recorded 1"
        q = np.reshape(found["q"], (len(found["time"]), -1))
        np.testing.assert_array_equal(q, [move["q"] for move in moves])
        assert np.all(np.diff(found["time"]) > 0)
        with page.expect_download() as file:
            page.click("text=Motion CSV")
        rows = np.loadtxt(file.value.path(), delimiter=",", skiprows=1)
        np.testing.assert_array_equal(rows[:, 0], found["time"])
        watched.healthy()


def test_a_wrong_force_in_the_file_is_seen(alone):
    """The check is no ornament: another number in the document, and the page says so."""
    document = robot_document(gallery("five_bar"))
    check = document["engine"]["check"]
    wrong = np.array(decoded(check["forces"]))
    wrong[2, 1] += 1e-6 * np.abs(wrong).max()
    check["forces"] = encoded(wrong)
    with alone(document) as watched:
        told = watched.page.inner_text(".agreement")
        assert told.startswith("Forces of this page are not those of Pinocchio: they differ by 0.000")
        assert "alarm" in watched.page.get_attribute(".agreement", "class")


def test_a_page_goes_on_when_its_python_is_gone(browser):
    robot = gallery("four_bar")
    with p3dof.show_robot(robot, port=0) as live, opened(browser, live.url, 900, 600, READY) as watched:
        watched.wait("p3dof.state.connection?.open")
        live.stop()
        watched.wait("!p3dof.state.connection.open")
        assert "the page goes on by itself" in watched.page.inner_text("#connection")
        moves = moved(watched, 4, 0.05)
        assert all(not move["refused"] for move in moves)
        check_forces(robot, moves, RobotAnswers(robot, robot.assemble().q))


def test_links_and_joints_are_named_under_the_pointer(alone):
    robot = gallery("five_bar")
    with alone(robot_document(robot), 1000, 700) as watched:
        grips = """() => {
            const { stage, document: { scene } } = p3dof.state;
            for (let x = 20; x < stage.width; x += 6) for (let y = 60; y < stage.height; y += 6) {
                const grip = stage.gripAt(x, y);
                if (grip) return [scene.joints[grip.place].name, x, y];
            }
        }"""
        joint, x, y = watched.page.evaluate(grips)
        model = robot.model
        (body,) = [
            frame.name
            for frame in model.frames
            if frame.type == pin.FrameType.BODY and model.names[frame.parentJoint] == joint
        ][:1]
        watched.page.mouse.move(x, y)
        watched.wait("!document.querySelector('.named').hidden")
        assert watched.page.inner_text(".named") == f"{body} · joint {joint} (revolute)"
        watched.page.mouse.move(3, 690)
        watched.wait("document.querySelector('.named').hidden")
        watched.healthy()


def test_a_long_legend_stands_in_two_columns(alone):
    robot = gallery("biped")
    q = robot.assemble().q
    forces = np.ones((2, len(robot.actuated)))
    motion = JointMotion([0.0, 1.0], np.stack([q, q]), robot.actuated, forces)
    with alone(robot_document(robot, None, motion), 1400, 860) as watched:
        rows = watched.page.locator(".chart").first.locator(".legend .row:not(.head)")
        assert rows.count() == len(robot.actuated)
        boxes = [rows.nth(i).bounding_box() for i in range(rows.count())]
        assert len({round(box["x"]) for box in boxes}) == 2
        side = watched.page.locator(".chart .side").first.bounding_box()
        assert boxes[7]["y"] + boxes[7]["height"] <= side["y"] + side["height"] + 1  # all others by the wheel
        watched.healthy()


def test_limits_that_differ_are_told_as_the_strictest(alone):
    for efforts, words in (((500, 500), "limits ±500 N m"), ((500, 300), "strictest limits ±300 N m")):
        robot = gallery("five_bar")
        robot.model.effortLimit[robot.actuated_v] = efforts
        q = robot.assemble().q
        motion = JointMotion([0.0, 1.0], np.stack([q, q]), robot.actuated, np.ones((2, 2)))
        with alone(robot_document(robot, None, motion)) as watched:
            assert words in watched.page.locator(".legend .limits").all_inner_texts()
            watched.healthy()


def test_what_a_page_cannot_move_is_said(alone):
    robot, q = closure_robots.universal_loop()  # with a composite joint
    document = robot_document(robot, None, JointMotion([0.0], q[None]))
    assert document["engine"]["kind"] == "none"
    with alone(document) as watched:
        told = watched.page.inner_text("#pose")
        assert "By itself it cannot move this robot: joint " in told
        watched.healthy()
    with pytest.raises(InputError, match="engine: expected 'page', 'ask' or 'none', got 'loop'"):
        robot_document(robot, engine="loop")
