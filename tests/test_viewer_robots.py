"""Other robots than the manipulator in the viewer: a four-bar's run, drawn and played by the same code."""

from pathlib import Path
from types import SimpleNamespace

import closed_loop_robots as robots
import numpy as np
import pinocchio as pin
import pytest
from test_any_robot import five_bar, four_bar, run

import p3dof
from p3dof.closed_loop.constraints import KINDS
from p3dof.errors import InputError
from p3dof.simulation.plants import ConstrainedPlant

pytest.importorskip("meshcat", reason="meshcat is not installed")
from browser import chromium, opened
from test_viewer_scene import commands, matrix, moved

from p3dof.page.robots.sticks import StickFigure
from p3dof.viewer import JointMotion, RobotScene, robot_animation_html
from p3dof.viewer.drawing import ROOT
from p3dof.viewer.robots.arrows import LONGEST

coal = pytest.importorskip("coal")
GALLERY = Path(__file__).parents[1] / "docs/_static/gallery"
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
        assert length == pytest.approx(LONGEST * scene.half * motion.known[i, 0] / 7.0, rel=1e-9)


def from_middle(found, point):
    """Return how far from the middle of the picture a point of the page is; at its edge 1."""
    camera = found["set_property", "/Cameras/default/rotated/<object>", "position"]["value"]
    eye = np.array([camera[0], -camera[2], camera[1]])
    right = np.cross([0.0, 0.0, 1.0], eye) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], eye))
    up = np.cross(eye, right) / np.linalg.norm(eye)
    reach = np.tan(np.radians(75 / 2)) / 2.4 * (eye - point) @ eye / np.linalg.norm(eye)
    return max(abs(point @ up) / reach, abs(point @ right) / (4 / 3 * reach))


def test_the_picture_holds_all_of_the_motion(swing):
    """Every end of every bar, at every sample, is inside of what the camera sees."""
    robot, motion = swing
    found = commands(RobotScene(robot, motion).window)
    shift = matrix(found, "/meshcat")
    for q in motion.q[::5]:
        for place, length in zip(places(robot, q), robots.FOUR_BAR[1:], strict=True):
            for end in (-length / 2, length / 2):
                assert from_middle(found, moved(shift @ place, (0.0, 0.0, end))) < 1


@pytest.mark.parametrize("name", ["four_bar", "five_bar"])
def test_the_picture_holds_the_numbers_of_closures(name):
    """The closure is the highest point of these robots, and its number stands above it."""
    loop = p3dof.load_robot(GALLERY / f"{name}.urdf")
    found = commands(RobotScene(StickFigure(loop), JointMotion.at_rest(loop), loop=loop).window)
    shift, middle = matrix(found, "/meshcat"), matrix(found, "/meshcat/closure_numbers/0")
    sprite = matrix(found, "/meshcat/closure_numbers/0/text")
    height = sprite[2, 2] * 150 / 256  # of the letters in their picture
    assert from_middle(found, moved(shift @ middle, (0.0, 0.0, height / 2))) < 1


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


@pytest.fixture(scope="module")
def gripper():
    loop = p3dof.load_robot(GALLERY / "gripper.urdf")
    return loop, JointMotion.at_rest(loop)


def test_closures_stand_at_their_frames_and_their_arrows_are_to_scale(gripper):
    loop, motion = gripper
    scene = RobotScene(StickFigure(loop), motion, loop=loop, layers={"closure_forces": True})
    found = commands(scene.window)
    data = loop.model.createData()
    pin.framesForwardKinematics(loop.model, data, motion.q[0])
    forces = loop.inverse_dynamics(motion.q[0], np.zeros(6), np.zeros(6))
    assert forces.unique.tolist() == [True, False, True] * 2 + [True]
    for i, closure in enumerate(loop.sidecar.closures):
        place = data.oMf[loop.model.getFrameId(closure.frame1)]
        mark = matrix(found, f"/meshcat/closures/{i}/first")
        np.testing.assert_allclose(mark, place.homogeneous, rtol=0, atol=1e-12)
        assert ("set_object", f"/meshcat/closures/{i}/first/ball") in {key[:2] for key in found}
        determined = np.where(forces.unique, forces.lambda_, 0)[3 * i : 3 * i + 3]
        arrow = matrix(found, f"/meshcat/closure_forces/{i}/part_of_force")
        np.testing.assert_allclose(
            arrow[:3, 2], place.rotation @ determined / np.linalg.norm(determined), rtol=0, atol=1e-9
        )
        head = matrix(found, f"/meshcat/closure_forces/{i}/part_of_force/head")
        length = moved(head, np.array([0.0, 0.0, 1.0]))[2]
        share = np.linalg.norm(determined) / scene.largest["N"]
        assert length == pytest.approx(LONGEST * scene.half * share, rel=1e-9)
        assert not found["set_property", f"/meshcat/closure_forces/{i}/force", "visible"]["value"]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "distance"])
def test_every_kind_of_closure_is_drawn(kind):
    sidecar = p3dof.Sidecar((p3dof.Closure("coupler_tip", "rocker_tip", kind),), ())
    loop = p3dof.ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)
    scene = RobotScene(StickFigure(loop), JointMotion([0.0], [np.zeros(3)]), loop=loop)
    drawn = {path for what, path, *_ in commands(scene.window) if what == "set_object"}
    assert any(path.startswith("/meshcat/closures/0/") for path in drawn)
    assert "/meshcat/closure_numbers/0/text" in drawn


def test_a_distance_is_a_rod_from_frame_to_frame():
    sidecar = p3dof.Sidecar((p3dof.Closure("crank", "rocker_tip", "distance", 0.4),), ("crank_joint",))
    loop = p3dof.ClosedLoopModel.from_urdf(robots.four_bar(*robots.FOUR_BAR), sidecar)
    q = loop.assemble([0.5], guess=[0.5, 0.1, 0.7]).q
    scene = RobotScene(StickFigure(loop), JointMotion([0.0], [q]), loop=loop)
    data = loop.model.createData()
    pin.framesForwardKinematics(loop.model, data, q)
    rod = matrix(commands(scene.window), "/meshcat/closures/0/rod")
    for end, name in ((0.0, "crank"), (1.0, "rocker_tip")):
        place = data.oMf[loop.model.getFrameId(name, pin.FrameType.BODY)].translation
        np.testing.assert_allclose(moved(rod, np.array([0.0, 0.0, end])), place, rtol=0, atol=1e-12)


def test_layers_hide_parts_of_the_picture(gripper):
    loop, motion = gripper
    scene = RobotScene(StickFigure(loop), motion, loop=loop, layers={"closures": False})
    assert scene.layers.seen == {
        "sticks": True,
        "forces": True,
        "closures": False,
        "numbers": True,
        "closure_forces": False,
    }
    found = commands(scene.window)
    assert not found["set_property", "/meshcat/closures", "visible"]["value"]
    scene.layers.choose({"closures": True, "shapes": True})
    assert commands(scene.window)["set_property", "/meshcat/closures", "visible"]["value"]
    for bad in ({"axes": True}, {"closures": 1}, "closures"):
        with pytest.raises(InputError, match="layers: "):
            RobotScene(StickFigure(loop), motion, loop=loop, layers=bad)


def test_a_page_says_that_other_torques_would_do():
    loop = p3dof.load_robot(GALLERY / "two_arms.urdf")
    page = robot_animation_html(StickFigure(loop), JointMotion.at_rest(loop), loop=loop)
    assert "these are the smallest" in page
    robot = p3dof.load_robot(GALLERY / "four_bar.urdf")
    assert "these are the smallest" not in robot_animation_html(
        StickFigure(robot), JointMotion.at_rest(robot), loop=robot
    )


def test_external_wrenches_have_arrows(gripper):
    loop, motion = gripper
    push = {"left_finger": np.array([3.0, 0.0, 4.0, 0.0, 0.1, 0.0])}
    pushed = JointMotion.at_rest(loop, motion.q[0], push)
    scene = RobotScene(StickFigure(loop), pushed, loop=loop)
    arrow = matrix(commands(scene.window), "/meshcat/wrenches/0/force")
    np.testing.assert_allclose(arrow[:3, 2], [0.6, 0.0, 0.8], atol=1e-12)
    assert abs(pushed.known[0, 0]) > abs(motion.known[0, 0])


def test_a_page_has_boxes_for_what_is_seen_and_says_the_forces_in_closures(gripper, tmp_path):
    loop, motion = gripper
    path = tmp_path / "gripper.html"
    path.write_text(robot_animation_html(StickFigure(loop), motion, title="gripper", loop=loop), "utf-8")
    with chromium() as browser, opened(browser, path.as_uri(), 640, 480) as watched:
        rows = watched.page.inner_text("#closures").splitlines()
        assert [row.split("\t")[1] for row in rows] == ["point", "point", "coupling"]
        assert rows[0].endswith("in part")
        hidden = "!nodeOf('meshcat/closure_forces').object.visible"
        watched.wait(hidden)
        watched.page.check("#layer_closure_forces")
        watched.wait(f"!({hidden})")
        watched.healthy()
