"""Other robots than the manipulator in the viewer: a four-bar's run, drawn and played by the same code."""

from types import SimpleNamespace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from test_any_robot import five_bar, four_bar, run

from p3dof.errors import InputError
from p3dof.simulation.plants import ConstrainedPlant

pytest.importorskip("meshcat", reason="meshcat is not installed")
from browser import chromium, opened
from test_viewer_scene import commands, matrix, moved

from p3dof.viewer import JointMotion, RobotScene, robot_animation_html
from p3dof.viewer.drawing import ROOT

coal = pytest.importorskip("coal")
VISUALS = f"{ROOT}/visuals/"


def drawable(loop, lengths):
    """A robot of rods: what the viewer asks for is a tree and solids."""
    solids = pin.GeometryModel()
    for joint, length in enumerate(lengths, 1):
        along_x = pin.SE3(pin.utils.rotate("y", np.pi / 2), np.array([length / 2, 0.0, 0.0]))
        solids.addGeometryObject(
            pin.GeometryObject(f"bar_{joint}", joint, along_x, coal.Cylinder(0.01, length))
        )
    return SimpleNamespace(model=loop.model, visual_model=solids)


@pytest.fixture(scope="module")
def swing():
    """A four-bar that swings under a torque of its crank."""
    loop = four_bar()
    plant = ConstrainedPlant(loop, stabilisation=10.0)
    state = plant.checked_state(robots.four_bar_q(0.7, *robots.FOUR_BAR), np.zeros(3), 1e-9)
    record = run(plant, state, 0.5, lambda measured: [3.0 + 8.0 * measured[0]])
    q, *_ = plant.motion(np.array(record.states), np.array(record.rates))
    motion = JointMotion(record.times, q, loop.actuated, record.forces)
    return drawable(loop, robots.FOUR_BAR[1:]), motion


def places(robot, q):
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    solids = robot.visual_model.geometryObjects
    return np.array([(data.oMi[solid.parentJoint] * solid.placement).homogeneous for solid in solids])


def test_solids_and_the_arrow_of_a_torque_are_where_pinocchio_has_them(swing):
    robot, motion = swing
    scene = RobotScene(robot, motion)
    assert scene.units == ("N m",)
    assert scene.largest == {"N m": 7.0}
    for i in (0, 20, 50):
        scene.display(motion.q[i], motion.known[i])
        found = commands(scene.window)
        drawn = [matrix(found, f"/meshcat/{VISUALS}bar_{joint}") for joint in (1, 2, 3)]
        np.testing.assert_allclose(drawn, places(robot, motion.q[i]), rtol=0, atol=1e-12)
        arrow = matrix(found, "/meshcat/forces/0")
        np.testing.assert_allclose(arrow[:3, 2], [0, -1, 0], atol=1e-12)  # the crank's axis
        head, tip = matrix(found, "/meshcat/forces/0/head"), np.array([0.0, 0.0, 1.0])
        length = moved(head, tip)[2]
        assert length == pytest.approx(0.6 * scene.half * motion.known[i, 0] / 7.0, rel=1e-9)


def test_the_picture_holds_all_of_the_motion(swing):
    """Every end of every bar, at every sample, is inside of what the camera sees."""
    robot, motion = swing
    scene = RobotScene(robot, motion)
    found = commands(scene.window)
    shift = matrix(found, "/meshcat")
    camera = found["set_property", "/Cameras/default/rotated/<object>", "position"]["value"]
    eye = np.array([camera[0], -camera[2], camera[1]])
    right = np.cross([0.0, 0.0, 1.0], eye) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], eye))
    up = np.cross(eye, right) / np.linalg.norm(eye)
    sight = np.tan(np.radians(75 / 2)) / 2.4
    for q in motion.q[::5]:
        for place, length in zip(places(robot, q), robots.FOUR_BAR[1:], strict=True):
            for end in (-length / 2, length / 2):
                point = moved(shift @ place, (0.0, 0.0, end))
                distance = (eye - point) @ eye / np.linalg.norm(eye)
                assert abs(point @ up) < sight * distance
                assert abs(point @ right) < 4 / 3 * sight * distance


def test_its_page_plays_in_a_browser_with_the_torque(swing, tmp_path):
    robot, motion = swing
    path = tmp_path / "swing.html"
    path.write_text(robot_animation_html(robot, motion, fps=40, title="four-bar"), encoding="utf-8")
    with chromium() as browser, opened(browser, path.as_uri(), 500, 400) as watched:
        for i in (0, 10, 50):
            watched.page.evaluate("time => freeze(time)", float(motion.time[i]))
            shown = watched.places([f"meshcat/{VISUALS}bar_{joint}" for joint in (1, 2, 3)])
            np.testing.assert_allclose(shown, places(robot, motion.q[i]), rtol=0, atol=2e-3)
            assert watched.page.inner_text("#force_crank_joint") == f"{motion.known[i, 0]:.2f} N m"
        assert "torque crank_joint" in watched.page.inner_text("table")
        assert watched.page.inner_text("#legend") == "The longest arrow is 7 N m."
        watched.healthy()


def test_a_robot_without_solids_or_known_forces_is_shown_too():
    loop = five_bar()
    bare = SimpleNamespace(model=loop.model, visual_model=pin.GeometryModel())
    motion = JointMotion([0.0], [robots.five_bar_q(1.9, 1.2)], loop.actuated)
    assert motion.known.shape == (1, 0)
    scene = RobotScene(bare, motion)
    assert scene.half > 0.1
    assert "table" in robot_animation_html(bare, motion)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda r, m: RobotScene(r, m.q), "motion: expected a JointMotion, got"),
        (
            lambda r, _: RobotScene(r, JointMotion([0.0], [[1.0, 2.0]])),
            r"q: expected shape \(N, 3\), got \(1, 2\)",
        ),
        (lambda _, m: JointMotion(m.time, m.q[:3]), r"q: expected shape \(51, 3\), got \(3, 3\)"),
        (lambda _, m: JointMotion([1.0, 0.5], m.q[:2]), "time: expected strictly rising times"),
        (lambda _, m: JointMotion([], m.q[:0]), "time: expected at least one sample, got none"),
        (lambda _, m: JointMotion(m.time, m.q, ("a", "b"), m.forces), r"forces: expected shape \(51, 2\)"),
        (
            lambda r, m: RobotScene(r, JointMotion(m.time, m.q, ("motor",), m.forces)),
            "'motor' does not exist",
        ),
        (
            lambda r, m: RobotScene(r, m).display(m.q[0], [1.0, 2.0]),
            r"expected shape \(1,\), got \(2,\)",
        ),
        (lambda r, m: robot_animation_html(r, m, fps=1e9), "at most 20000 frames, got 500000000"),
        (lambda r, m: robot_animation_html(r, m, title=None), "title: expected text, got None"),
    ],
)
def test_bad_input_is_one_clear_error(make, message, swing):
    with pytest.raises(InputError, match=message):
        make(*swing)
