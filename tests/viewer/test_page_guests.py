"""What MeshCat's commands draw appears in the page, where it is and as large as it is."""

from __future__ import annotations

import io

import numpy as np
import pytest
from browser import opened

import p3dof

pytest.importorskip("meshcat", reason="meshcat is not installed")

import meshcat
import meshcat.geometry as mg

from p3dof.viewer import viewer as meshcat_viewer
from p3dof.viewer.live_viewer import LiveViewer
from p3dof.viewer.machine.document import page_document
from p3dof.viewer.server import guest_of

READY = "!!window.p3dof && p3dof.ready.then(() => p3dof.state.connection.open)"
FIND = """
window.guestAt = (path) => {  // where a guest is in the fixed frame [m], and how large its box is
    const { stage } = p3dof.state;
    let node = stage.guests;
    for (const name of path) node = node && node.children.find((child) => child.name === name);
    if (!node) return null;
    node.updateWorldMatrix(true, true);
    stage.guests.updateWorldMatrix(true, false);
    const inside = stage.guests.matrixWorld.clone().invert().multiply(node.matrixWorld);
    const mesh = node.children.find((child) => child.geometry) || node;
    if (mesh.geometry) mesh.geometry.computeBoundingBox();
    const box = mesh.geometry ? mesh.geometry.boundingBox : null;
    return {
        place: inside.transpose().toArray(),
        size: box ? box.max.clone().sub(box.min).toArray() : null,
        colour: mesh.material ? mesh.material.color.getHex() : null,
        visible: node.visible,
    };
};
window.guestsDrawn = () => {
    let count = 0;
    p3dof.state.stage.guests.traverse((node) => { if (node.material) count += 1; });
    return count;
};
"""


@pytest.fixture(scope="module")
def robot():
    return p3dof.load()


def shown(robot):
    return page_document(robot) | {"engine": {"kind": "none"}}  # no forces are needed here


@pytest.fixture
def viewed(browser, robot):
    with LiveViewer(shown(robot), port=0) as running, opened(browser, running.url, ready=READY) as page:
        page.page.evaluate(FIND)
        yield running, page


def test_what_meshcat_draws_is_in_the_page_where_it_is(viewed):
    viewer, page = viewed
    box = viewer.guest["my/box"]
    box.set_object(mg.Box([0.1, 0.2, 0.3]), mg.MeshLambertMaterial(color=0x336699))
    place = meshcat.transformations.rotation_matrix(0.5, [0.0, 1.0, 0.0])
    place[:3, 3] = [0.1, -0.2, 0.3]
    box.set_transform(place)
    vertices = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.25, 0.0]])
    viewer.guest["my/triangle"].set_object(mg.TriangularMeshGeometry(vertices, np.array([[0, 1, 2]])))
    viewer.guest["my/cloud"].set_object(mg.PointCloud(np.eye(3), np.eye(3)))
    viewer.guest["my/axes"].set_object(mg.triad(0.2))
    path = ["meshcat", "my", "box"]
    page.wait("path => guestAt(path) !== null && guestsDrawn() === 4", path)
    seen = page.page.evaluate("path => guestAt(path)", path)
    np.testing.assert_allclose(np.reshape(seen["place"], (4, 4)), place, atol=1e-12)
    np.testing.assert_allclose(seen["size"], [0.1, 0.2, 0.3], atol=1e-6)
    assert seen["colour"] == 0x336699
    np.testing.assert_allclose(
        page.page.evaluate("() => guestAt(['meshcat', 'my', 'triangle']).size"), [0.5, 0.25, 0.0], atol=1e-6
    )
    box.set_property("visible", False)
    page.wait("path => guestAt(path).visible === false", path)
    viewer.guest["my"].delete()
    page.wait("guestsDrawn() === 0")
    page.healthy()


def test_a_page_opened_later_has_the_guests_too(browser, robot):
    with LiveViewer(shown(robot), port=0) as viewer:
        viewer.guest["ball"].set_object(mg.Sphere(0.125))
        with opened(browser, viewer.url, ready=READY) as page:
            page.page.evaluate(FIND)
            page.wait("guestsDrawn() === 1")
            size = page.page.evaluate("() => guestAt(['meshcat', 'ball']).size")
            np.testing.assert_allclose(size, 3 * [0.25], atol=2e-3)


def test_pinocchios_visualizer_can_be_a_guest(viewed, robot):
    """Its 54 objects, letters included, in the page of the same machine."""
    viewer, page = viewed
    visualizer = meshcat_viewer(robot, port=0)
    try:
        guest_of(viewer.session, visualizer.viewer.window)
        visualizer.viewer["another"].set_object(mg.Box([0.1, 0.1, 0.1]))
        page.wait("guestAt(['meshcat', 'another']) !== null")
    finally:
        visualizer.viewer.close()
    with opened(page.page.context.browser, viewer.url, ready=READY) as later:
        later.page.evaluate(FIND)
        count = sum(b"set_object" in message for message in visualizer.viewer.window.messages())
        assert count > 50
        later.wait("count => guestsDrawn() >= count", count)
        assert later.page.inner_text("#stage .guests") == ""
        later.healthy()


def test_what_cannot_be_drawn_is_said(viewed):
    viewer, page = viewed
    viewer.guest["mesh"].set_object(mg.DaeMeshGeometry.from_stream(io.StringIO("<COLLADA/>")))
    page.wait("!document.querySelector('#stage .guests').hidden")
    assert page.page.inner_text("#stage .guests") == "a mesh in .dae of MeshCat is not drawn"
    viewer.guest["ball"].set_object(mg.Sphere(0.125))
    page.wait("guestsDrawn() === 1")
