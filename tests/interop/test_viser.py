"""viser: `viser.extras.ViserUrdf(viser.ViserServer(host="127.0.0.1"), Path("urdf/p3dof.urdf"))`."""

import gc
import socket
import warnings

import numpy as np
import pinocchio as pin
import pytest
from reference import LINKS, MECHANISM, MOVING, URDF, assert_placements, composed, mimicking_joints

viser = pytest.importorskip(
    "viser",
    minversion="1",  # 0.2 leaves its event loops open and needs liblzfse
    reason="viser 1 or later not installed: pip install 'p3dof[interop]'",
)
pytest.importorskip("yourdfpy", reason="yourdfpy, which viser reads with, not installed")

# yourdfpy 0.0.60 itself calls a function that trimesh has deprecated.
pytestmark = pytest.mark.filterwarnings(r"ignore:`Scene.dump\(concatenate=True\)`:DeprecationWarning")

ViserUrdf = pytest.importorskip("viser.extras", reason="viser without its extras").ViserUrdf


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def server():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    yield server
    server.stop()
    with warnings.catch_warnings():  # it leaves a connection that never spoke to the garbage collector
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


def test_it_shows_the_robot_on_the_loopback_only(server):
    robot = ViserUrdf(server, URDF)
    assert server.get_host() == "127.0.0.1"
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=60):
        pass
    assert robot.get_actuated_joint_names() == tuple(n for n, j in MOVING.items() if j.mimic is None)
    for name, limits in robot.get_actuated_joint_limits().items():
        assert limits == pytest.approx((MOVING[name].limits.lower, MOVING[name].limits.upper), rel=1e-14)
    assert len(robot._meshes) == sum(len(link.visuals) for link in LINKS.values())


@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_they_should_be(server, seed):
    robot = ViserUrdf(server, URDF)
    q = mimicking_joints(seed)
    robot.update_cfg(np.array([q[name] for name in robot.get_actuated_joint_names()]))
    parents = {joint.child: joint.parent for joint in MECHANISM.joints}
    steps = {}
    for frame in robot._joint_frames:
        name = frame.name.split("/")[-1]
        w, x, y, z = frame.wxyz
        rotation = pin.Quaternion(float(w), float(x), float(y), float(z)).matrix()
        steps[name] = (parents[name], pin.SE3(rotation, np.array(frame.position)).homogeneous)
    assert_placements(composed(steps), q)


def test_it_ends_cleanly():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    port = server.get_port()
    server.stop()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=60)
