"""What is drawn, from the commands that a page would get: placements, loops, arrows, the path of P."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import threading

import numpy as np
import pinocchio as pin
import pytest
from machines import random_machine, random_states

import p3dof

pytest.importorskip("meshcat", reason="meshcat is not installed")
import umsgpack

from p3dof.machine.parameters import LINKS
from p3dof.viewer import ArrowScale, Scene, SceneWindow, joints_of, trace_of
from p3dof.viewer.machine.room import LINKS_OF_LEGS
from p3dof.viewer.machine.scene import MARK
from p3dof.viewer.stage import ROOT

VISUALS = f"/meshcat/{ROOT}/visuals/"


def commands(window):
    """The commands that rebuild a scene, by what they are of."""
    unpacked = [umsgpack.unpackb(message) for message in window.messages()]
    return {(c["type"], c["path"], c.get("property")): c for c in unpacked}


def matrix(found, path):
    return np.reshape(found["set_transform", path, None]["matrix"], (4, 4)).T


def visible(found, path):
    return found["set_property", path, "visible"]["value"]


def moved(transform, point):
    return (transform @ [*point, 1.0])[:3]


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


@pytest.fixture(scope="module")
def result(robot):
    return robot.inverse_dynamics(p3dof.paper_motion(samples=41), method="virtual-power")


@pytest.fixture
def scene(robot):
    return Scene(robot)


def machines_and_poses():
    yield p3dof.PAPER, p3dof.paper_motion(samples=6).pose
    for seed in (3, 11):
        parameters = random_machine(seed)
        yield parameters, random_states(parameters, seed, 4).pose


@pytest.mark.parametrize(("parameters", "poses"), [*machines_and_poses()])
def test_all_bodies_are_where_pinocchio_has_them(parameters, poses):
    robot = p3dof.load(parameters)
    scene, data, visual = Scene(robot), robot.model.createData(), robot.visual_model
    L, seen = parameters.geometry.L, set()
    for pose, q in zip(poses, joints_of(robot, poses), strict=True):
        scene.display(q)
        found = commands(scene.window)
        pin.forwardKinematics(robot.model, data, q)
        for solid in visual.geometryObjects:
            expected = data.oMi[solid.parentJoint] * solid.placement
            np.testing.assert_allclose(
                matrix(found, VISUALS + solid.name), expected.homogeneous, rtol=0, atol=1e-12 * max(1, L)
            )
            seen.add(solid.name.rpartition("_")[0])
        skin = matrix(found, "/meshcat/platform")
        np.testing.assert_allclose(skin[:3, 3], trace_of(robot, pose), rtol=0, atol=1e-12 * max(1, L))
        c, s = np.cos(pose[2]), np.sin(pose[2])
        np.testing.assert_allclose(skin[:3, :3], [[c, 0, s], [0, 1, 0], [-s, 0, c]], rtol=0, atol=1e-12)
    assert seen == {*LINKS, "base_link"}


@pytest.mark.parametrize(("parameters", "poses"), [*machines_and_poses()])
def test_the_loops_are_closed_in_the_drawn_solids(parameters, poses):
    robot = p3dof.load(parameters)
    scene, L = Scene(robot), parameters.geometry.L

    def lower_end(found, name):
        place = matrix(found, f"{VISUALS}{name}_0")
        ends = (moved(place, (0, 0, L / 2)), moved(place, (0, 0, -L / 2)))
        return min(ends, key=lambda point: point[2])

    def middle(found, name):
        return matrix(found, VISUALS + name)[:3, 3]

    for q in joints_of(robot, poses):
        scene.display(q)
        found = commands(scene.window)
        pairs = [
            (lower_end(found, "leg_a"), middle(found, "platform_0")),  # the round corner about A3
            (lower_end(found, "leg_b"), middle(found, "platform_1")),
            (middle(found, "crossbar_lower_0"), middle(found, "platform_2")),  # C5
        ]
        knobs = [middle(found, "crossbar_lower_1"), middle(found, "crossbar_lower_2")]
        for rod in ("rod_left", "rod_right"):
            end = lower_end(found, rod)
            pairs.append((end, min(knobs, key=lambda knob: np.linalg.norm(knob - end))))
        for one, other in pairs:
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * max(1, L))
        np.testing.assert_allclose(  # rods stay parallel
            lower_end(found, "rod_left") - lower_end(found, "rod_right"),
            [0, 2 * parameters.geometry.b, 0],
            rtol=0,
            atol=1e-12 * max(1, L),
        )


def arrow(found, leg):
    """Where an arrow starts and ends, and where its shaft meets its head."""
    root = matrix(found, f"/meshcat/forces/{leg}")
    shaft, head = (root @ matrix(found, f"/meshcat/forces/{leg}/{part}") for part in ("shaft", "head"))
    return (moved(part, (0, 0, end)) for part, end in ((shaft, 0), (shaft, 1), (head, 0), (head, 1)))


def test_arrows_follow_the_forces(result, scene):
    for q, forces, sliders in zip(result.joints.q, result.forces, result.sliders, strict=True):
        for signed in (forces, -forces):
            scene.display(q, signed)
            found = commands(scene.window)
            for leg, force, slider in zip("abc", signed, sliders, strict=True):
                start, joint, neck, tip = arrow(found, leg)
                np.testing.assert_allclose(tip - start, [0, 0, scene.scale.length(force)], rtol=0, atol=1e-12)
                np.testing.assert_allclose(joint, neck, rtol=0, atol=2e-6)  # of a shaft of no length
                assert start[2] == pytest.approx(slider, abs=1e-12)
                assert visible(found, f"/meshcat/forces/{leg}")
                assert np.sign(tip[2] - start[2]) == np.sign(force)


def scaled(result, largest):
    """A result whose largest force is so many newtons."""
    return dataclasses.replace(result, forces=result.forces * (largest / np.abs(result.forces).max()))


def drawn_length(found, leg):
    start, _, _, tip = arrow(found, leg)
    return tip[2] - start[2]


def text_of(found, path):
    return found["set_object", path, None]["object"]["textures"][0]["text"]


def test_arrows_are_in_proportion_to_the_largest_force_of_the_motion(robot, result):
    strong = scaled(result, 599.0)
    scene = Scene(robot, scale=ArrowScale.of_motion(robot, strong))
    scene.display(np.zeros(10), [599.0, 300.0, -150.0])
    found = commands(scene.window)
    lengths = np.array([drawn_length(found, leg) for leg in "abc"])
    np.testing.assert_allclose(lengths / lengths[0], [1.0, 300 / 599, -150 / 599], rtol=1e-12)
    assert lengths[0] == pytest.approx(robot.parameters.geometry.R)
    assert not any(visible(found, f"/meshcat/cut/{leg}") for leg in "abc")
    assert scene.scale.newtons == pytest.approx(599.0)


@pytest.mark.parametrize(
    ("largest", "reference", "text"),
    [(599.0, 500.0, "500 N"), (118.5, 100.0, "100 N"), (0.0199, 0.01, "0.01 N"), (2.5e4, 2e4, "20000 N")],
)
def test_the_legend_states_the_scale(robot, result, largest, reference, text):
    scene = Scene(robot, scale=ArrowScale.of_motion(robot, scaled(result, largest)))
    found = commands(scene.window)
    assert scene.scale.reference == pytest.approx(reference)
    assert text_of(found, "/meshcat/legend/text") == text
    head = matrix(found, "/meshcat/legend/arrow/head")
    length = moved(head, (0, 0, 1))[2]
    scene.display(np.zeros(10), [reference, 0, 0])
    assert length == pytest.approx(drawn_length(commands(scene.window), "a"))
    assert f"The grey arrow is {text}; the longest is " in scene.scale.legend
    assert scene.scale.legend.endswith("N, the largest force of the motion.")


def test_a_force_beyond_the_scale_is_said_to_be(robot, result):
    scale = ArrowScale.of_motion(robot, result)
    scene = Scene(robot, scale=scale)
    for forces, cut in (([2 * scale.newtons, 1, -5 * scale.newtons], "ac"), ([1, np.inf, np.nan], "b")):
        scene.display(np.zeros(10), forces)
        found = commands(scene.window)
        assert {leg for leg in "abc" if visible(found, f"/meshcat/cut/{leg}")} == set(cut)
        for leg in cut:
            assert text_of(found, f"/meshcat/cut/{leg}/text") == "off scale"
            assert abs(drawn_length(found, leg)) == pytest.approx(1.01 * robot.parameters.geometry.R)
    scene.display(np.zeros(10), [scale.newtons, -scale.newtons, 0])
    assert not any(visible(commands(scene.window), f"/meshcat/cut/{leg}") for leg in "abc")


def test_the_scale_at_rest_holds_the_poses_of_the_sliders(robot):
    scale = ArrowScale.at_rest(robot)
    rng, rest = np.random.default_rng(5), np.zeros(3)
    poses = rng.uniform([-0.25, -0.2, -0.78], [0.25, 0.2, 0.78], (4000, 3))
    forces = np.abs(robot.forces(poses, rest, rest, method="virtual-power", on_invalid="nan")).max(axis=1)
    forces = forces[np.isfinite(forces)]
    assert 0.9 * forces.max() < scale.newtons < 1.1 * forces.max()
    assert "static" in scale.legend
    light = p3dof.load(dataclasses.replace(robot.parameters, gravity=np.zeros(3)))
    assert ArrowScale.at_rest(light).newtons == light.parameters.limits.force  # no force at all
    assert "the limit of the drives" in ArrowScale.at_rest(light).legend


def test_samples_without_forces_do_not_count_for_the_scale(robot, result):
    gap = result.forces.copy()
    gap[5:9] = np.nan
    scale = ArrowScale.of_motion(robot, dataclasses.replace(result, forces=gap))
    assert scale.newtons == np.nanmax(np.abs(gap))
    assert np.isfinite([scale.low, scale.high]).all()
    lost = ArrowScale.of_motion(robot, dataclasses.replace(result, forces=np.full_like(gap, np.nan)))
    assert lost.newtons == robot.parameters.limits.force


def test_arrows_vanish_without_a_force(scene):
    for forces in (None, [0, 0, 0], [np.nan, 0, np.nan]):
        scene.display(np.zeros(10), [10, 10, 10])
        scene.display(np.zeros(10), forces)
        found = commands(scene.window)
        assert not any(visible(found, f"/meshcat/forces/{leg}") for leg in "abc")
        assert visible(found, "/meshcat/legend") == (forces is not None)
    scene.display(np.zeros(10), [5, np.nan, -5])
    found = commands(scene.window)
    assert [visible(found, f"/meshcat/forces/{leg}") for leg in "abc"] == [True, False, True]
    assert [visible(found, f"/meshcat/open/{leg}") for leg in "abc"] == [False, True, False]
    assert text_of(found, "/meshcat/open/b/text") == "undetermined"
    scene.display(np.zeros(10))
    found = commands(scene.window)
    assert not any(visible(found, f"/meshcat/{text}/{leg}") for leg in "abc" for text in ("open", "cut"))


def test_a_short_arrow_is_all_head(scene):
    short = 0.5 * scene._arrows.radius
    force = short / scene.scale.length(1.0)
    scene.display(np.zeros(10), [force, -force, force])
    start, _, _, tip = arrow(commands(scene.window), "b")
    assert tip[2] - start[2] == pytest.approx(-short)


def drawn_points(window, path):
    place = commands(window)["set_object", path, None]["object"]["geometries"][0]["data"]["attributes"][
        "position"
    ]
    return np.frombuffer(place["array"].data, np.float32).reshape(-1, place["itemSize"])


def test_the_trace_is_the_path_of_p(robot, scene):
    poses = p3dof.paper_motion(samples=101).pose
    scene.draw_trace(trace_of(robot, poses))
    drawn = drawn_points(scene.window, "/meshcat/trace")
    data, frame = robot.model.createData(), robot.model.getFrameId("platform_center")
    path = []
    for q in joints_of(robot, poses):
        pin.framesForwardKinematics(robot.model, data, q)
        path.append(data.oMf[frame].translation.copy())
    np.testing.assert_allclose(trace_of(robot, poses), path, rtol=0, atol=1e-14)
    np.testing.assert_allclose(drawn[::2], path[:-1], rtol=0, atol=1e-7)  # single precision
    np.testing.assert_allclose(drawn[1::2], path[1:], rtol=0, atol=1e-7)


def test_a_trace_has_gaps_and_can_be_taken_away(scene):
    points = np.arange(18.0).reshape(6, 3)
    points[2] = np.nan
    scene.draw_trace(points)
    np.testing.assert_array_equal(drawn_points(scene.window, "/meshcat/trace"), points[[0, 1, 3, 4, 4, 5]])
    for none in (points[:1], np.full((4, 3), np.nan), np.zeros((0, 3))):
        scene.draw_trace(points)
        scene.draw_trace(none)
        assert ("set_object", "/meshcat/trace", None) not in commands(scene.window)


def test_a_marked_leg_turns_red_and_back(robot, scene):
    def red(found):
        return {
            solid.name.rpartition("_")[0]
            for solid in robot.visual_model.geometryObjects
            if found.get(("set_property", VISUALS + solid.name, "color"), {}).get("value") == list(MARK)
        }

    assert red(commands(scene.window)) == set()
    for leg in ("a", "c", "b"):
        scene.mark_leg(leg)
        assert red(commands(scene.window)) == set(LINKS_OF_LEGS[leg])
    scene.mark_leg(None)
    found = commands(scene.window)
    for solid in robot.visual_model.geometryObjects:
        if solid.parentJoint and not solid.name.startswith("platform"):
            colour = found["set_property", VISUALS + solid.name, "color"]["value"]
            np.testing.assert_allclose(colour, solid.meshColor, rtol=0, atol=1e-15)


def test_the_legs_have_all_bodies_but_the_platform():
    assert {name for links in LINKS_OF_LEGS.values() for name in links} == {*LINKS} - {"platform"}


def test_guide_ways_floor_axes_and_letters_are_there(robot, scene):
    found = commands(scene.window)
    R, (low, high) = robot.parameters.geometry.R, robot.parameters.limits.travel
    for leg, (x, y) in {"a": (0, -R), "b": (0, R), "c": (-R, 0)}.items():
        place = matrix(found, f"/meshcat/scenery/guides/{leg}")
        rod = found["set_object", f"/meshcat/scenery/guides/{leg}", None]["object"]["geometries"][0]
        half = rod["height"] / 2
        ends = sorted((moved(place, (0, half, 0)), moved(place, (0, -half, 0))), key=lambda end: end[2])
        np.testing.assert_allclose(np.array(ends)[:, :2], [[x, y], [x, y]], atol=1e-15)
        assert ends[0][2] < low
        assert ends[1][2] > high
    for name, axis in zip("xyz", np.eye(3), strict=True):
        place = matrix(found, f"/meshcat/scenery/axes/{name}")
        np.testing.assert_array_equal(place[:3, 2], axis)
        assert np.linalg.det(place[:3, :3]) == pytest.approx(1)
    grid = drawn_points(scene.window, "/meshcat/scenery/floor/grid")
    np.testing.assert_allclose(grid[:, :2] / 0.1, np.round(grid[:, :2] / 0.1), atol=1e-5)
    lowest = -robot.parameters.geometry.h + low
    assert (grid[:, 2] < lowest).all()


class Eye:
    """The camera of a scene, as the page has it: heights and widths in a picture of 4:3 run from -1 to 1."""

    def __init__(self, window):
        found = commands(window)
        camera = "/Cameras/default/rotated/<object>"
        x, z, minus_y = found["set_property", camera, "position"]["value"]
        self.shift = matrix(found, "/meshcat")
        self.eye = np.array([x, -minus_y, z])
        self.forward = -self.eye / np.linalg.norm(self.eye)
        self.right = np.cross(self.forward, [0, 0, 1])
        self.right /= np.linalg.norm(self.right)
        self.sight = np.tan(np.radians(75 / 2)) / found["set_property", camera, "zoom"]["value"]
        self.near, self.far = (found["set_property", camera, name]["value"] for name in ("near", "far"))

    def sees(self, point):
        """Where a point of the scene is in the picture: to the right, and up."""
        seen = moved(self.shift, point) - self.eye
        depth = seen @ self.forward
        assert self.near < depth < self.far
        up = np.cross(self.right, self.forward)
        return np.array([seen @ self.right / (4 / 3), seen @ up]) / depth / self.sight


@pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
def test_machines_of_any_size_fill_the_picture(scale):
    """The eye sees the whole frame: its corners and the floor under it are inside the picture."""
    g = p3dof.machine.Geometry(scale * 0.1, scale * 0.25, scale * 0.4, scale * 0.05)
    limits = p3dof.machine.Limits(travel=(-0.2 * scale, 0.2 * scale))
    robot = p3dof.load(p3dof.Parameters(g, p3dof.PAPER.bodies, limits))
    eye = Eye(Scene(robot).window)
    places = np.array(
        [
            eye.sees((px, py, pz))
            for px, py in ((0, -g.R), (0, g.R), (-g.R, 0))
            for pz in (-0.2 * scale - g.h, 0.3 * scale)
        ]
    )
    assert np.abs(places).max() < 1
    assert places[:, 1].min() < -0.4
    assert places[:, 1].max() > 0.4


@pytest.mark.parametrize("largest", [0.3, 118.0, 599.0])
@pytest.mark.parametrize("seed", [None, 3, 11])
def test_the_camera_sees_every_arrow_of_a_motion(seed, largest):
    parameters = p3dof.PAPER if seed is None else random_machine(seed)
    robot, g = p3dof.load(parameters), parameters.geometry
    way = np.linspace(0, 1, 31)
    reach = g.L - (g.R - g.r)
    y, z, theta = 0.5 * reach * np.sin(7 * way), parameters.limits.travel[1] * np.sin(4 * way), 0.3 * way
    motion = p3dof.Motion.from_poses(way, np.stack((y, z, theta), axis=-1))
    solved = scaled(robot.inverse_dynamics(motion, method="virtual-power", on_invalid="nan"), 1.0)
    assert solved.valid.any()
    solved = dataclasses.replace(solved, forces=largest * np.where(way > 0.6, -1, 1)[:, None] * solved.forces)
    scale = ArrowScale.of_motion(robot, solved)
    assert scale.newtons == pytest.approx(largest, rel=0.2)
    scene = Scene(robot, scale=scale)
    eye = Eye(scene.window)
    for q, forces in zip(
        joints_of(robot, motion.pose[solved.valid]), solved.forces[solved.valid], strict=True
    ):
        scene.display(q, forces)
        found = commands(scene.window)
        for leg in "abc":
            for end in arrow(found, leg):
                assert np.abs(eye.sees(end)).max() < 1
    legend = matrix(found, "/meshcat/legend")
    for end in ((0, 0, 0), (0, 0, scale.metres)):
        assert np.abs(eye.sees(moved(legend, end))).max() < 1


def test_the_visualizer_is_a_plain_one_to_go_on_from(robot, scene):
    import meshcat.geometry

    assert isinstance(scene.visualizer, pin.visualize.MeshcatVisualizer)
    q = joints_of(robot, [0.02, -0.03, 0.2])
    scene.display(q)
    ours = commands(scene.window)
    scene.display(np.zeros(10))
    scene.visualizer.display(q)
    theirs = commands(scene.window)
    for solid in robot.visual_model.geometryObjects:
        np.testing.assert_array_equal(
            matrix(ours, VISUALS + solid.name), matrix(theirs, VISUALS + solid.name)
        )
    np.testing.assert_array_equal(*(matrix(found, "/meshcat/platform") for found in (ours, theirs)))
    scene.visualizer.viewer["mine"].set_object(meshcat.geometry.Sphere(0.01))
    assert ("set_object", "/meshcat/mine", None) in commands(scene.window)
    html = scene.visualizer.viewer.static_html()
    assert html.startswith("<!DOCTYPE html>")
    assert len(scene.visualizer.viewer.render_static().data) > 800_000
    assert scene.visualizer.viewer.url() == ""


def test_a_window_keeps_what_counts_and_passes_all_on():
    import meshcat
    import meshcat.geometry as mg

    window, heard = SceneWindow(), []
    unsubscribe = window.subscribe(heard.append)
    viewer = meshcat.Visualizer(window=window)
    for radius in (1.0, 2.0):
        viewer["ball"].set_object(mg.Sphere(radius))
        viewer["ball"].set_property("color", [1, 0, 0, 1])
        viewer["ball/part"].set_transform(np.eye(4))
    viewer["ball"].set_object(mg.Sphere(3.0))  # which is not red
    found = commands(window)
    assert len(heard) == 7
    assert found["set_object", "/meshcat/ball", None]["object"]["geometries"][0]["radius"] == 3.0
    assert set(found) == {
        ("set_object", "/meshcat/ball", None),
        ("set_transform", "/meshcat/ball/part", None),
    }
    unsubscribe()
    unsubscribe()
    viewer["balloon"].set_transform(np.eye(4))
    viewer["ball"].delete()
    assert set(commands(window)) == {("set_transform", "/meshcat/balloon", None)}
    assert len(heard) == 7
    viewer.delete()
    assert window.messages() == []
    assert window.wait() == "ok"
    window.close()
    with pytest.raises(p3dof.InputError, match="no server"):
        window.open()


def test_several_threads_may_draw(robot):
    scene, heard = Scene(robot), []
    scene.window.subscribe(heard.append)
    viewer = scene.visualizer.viewer

    def draw(name):
        for i in range(200):
            viewer[name].set_transform(np.eye(4) * (i + 1))
            scene.window.messages()

    threads = [threading.Thread(target=draw, args=(f"t{n}",)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = commands(scene.window)
    assert len(heard) == 800
    assert all(matrix(found, f"/meshcat/t{n}")[0, 0] == 200 for n in range(4))


def test_pictures_of_several_threads_come_whole(robot):
    scene, heard = Scene(robot), []
    places = [np.full(10, 0.02 * k) for k in range(3)]
    scene.window.subscribe(heard.append)
    alone = []
    for q in places:
        scene.display(q, [10, 20, 30])
        alone.append(list(heard))
        heard.clear()
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [
            threading.Thread(target=lambda q=q: [scene.display(q, [10, 20, 30]) for _ in range(5)])
            for q in places
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    size = len(alone[0])
    found = [heard[i : i + size] for i in range(0, len(heard), size)]
    assert sorted(map(alone.index, found)) == [0] * 5 + [1] * 5 + [2] * 5


def test_bad_input_is_one_clear_error(robot, scene):
    cases = [
        (lambda: Scene("p3dof"), "robot: expected a Manipulator, got 'p3dof'"),
        (lambda: Scene(robot, 3), "window: expected a SceneWindow, got int"),
        (lambda: Scene(robot, scale=3), "scale: expected an ArrowScale, got int"),
        (lambda: scene.display(np.zeros(9)), r"q: expected shape \(10,\), got \(9,\)"),
        (lambda: scene.display(np.full(10, np.nan)), "q: expected finite"),
        (lambda: scene.display(np.zeros(10), [1, 2]), r"forces: expected shape \(3,\), got \(2,\)"),
        (lambda: scene.display(np.zeros(10), "up"), "forces: expected real numbers"),
        (lambda: scene.draw_trace([1, 2, 3]), r"points: expected shape \(N, 3\), got \(3,\)"),
        (lambda: scene.mark_leg("d"), "leg: expected 'a', 'b', 'c' or None, got 'd'"),
        (lambda: trace_of(robot, 1.0), "pose: expected shape"),
    ]
    for call, message in cases:
        with pytest.raises(p3dof.InputError, match=message):
            call()
    with pytest.raises(p3dof.errors.ReachError):
        joints_of(robot, [1, 0, 0])


def test_without_meshcat_the_extra_is_named(robot, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshcat", None)
    for call in (lambda: Scene(robot), SceneWindow):
        with pytest.raises(p3dof._base.errors.MissingExtraError, match=r"p3dof\[viz\]"):
            call()


def test_nothing_heavy_is_imported_before_it_is_used():
    code = (
        "import sys, p3dof.viewer; "
        "heavy = ('meshcat', 'zmq', 'tornado', 'IPython', 'PIL', 'playwright', 'matplotlib'); "
        "print([name for name in heavy if name in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
