"""Documents of the page: their schema, and where a document says that joints are, without Pinocchio."""

import json
import struct
from importlib.resources import files

import jsonschema
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from p3dof.viewer.document.encoding import decoded

SCHEMA = json.loads((files("p3dof.viewer.document") / "document.schema.json").read_text(encoding="utf-8"))
_AXES = ("axis", "axis2")
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def read(document):
    """Return what a page reads of a document, after checking it against the schema."""
    text = json.dumps(document, allow_nan=False)
    found = json.loads(text)
    error = jsonschema.exceptions.best_match(VALIDATOR.iter_errors(found))
    assert error is None, f"{error.json_path}: {error.message[:300]}"
    _check_references(found)
    return found


def unpacked_message(data):
    """Return what a page reads of a message that the server has packed, with NumPy arrays."""
    assert data[:4] == b"P3D1"
    (length,) = struct.unpack("<I", data[4:8])
    behind = data[8 + length :]

    def filled(value):
        if isinstance(value, dict) and "offset" in value and "dtype" in value:
            dtype, shape = np.dtype(value["dtype"]).newbyteorder("<"), tuple(value["shape"])
            assert value["offset"] % 8 == 0
            return np.frombuffer(behind, dtype, int(np.prod(shape, dtype=int)), value["offset"]).reshape(
                shape
            )
        if isinstance(value, dict):
            return {key: filled(one) for key, one in value.items()}
        return [filled(one) for one in value] if isinstance(value, list) else value

    return filled(json.loads(data[8 : 8 + length]))


def _check_references(document):
    """What a schema cannot say: places, names and lengths fit together."""
    joints, layers = document["scene"]["joints"], {layer["name"] for layer in document["scene"]["layers"]}
    assert all(joint["parent"] < i for i, joint in enumerate(joints))
    drawn = [part for kind in ("solids", "labels", "lines") for part in document["scene"][kind]]
    assert all(part["joint"] < len(joints) and part["layer"] in layers for part in drawn)
    assert len({solid["name"] for solid in document["scene"]["solids"]}) == len(document["scene"]["solids"])
    for run in document["runs"]:
        count, nq = len(decoded(run["time"])), sum(joint["q"][1] for joint in joints)
        assert decoded(run["q"]).shape == (count, nq)
        assert {j["name"] for j in joints if j["kind"] == "placed"} == set(run.get("placed", {}))
        keys = [curve["key"] for curve in run["curves"]]
        assert len(set(keys)) == len(keys)
        assert all(values_of(run, curve).shape == (count,) for curve in run["curves"])
        for load in run["loads"]:
            assert load["joint"] < len(joints)
            assert load.get("layer", next(iter(layers))) in layers
            assert load["curve"] in keys if "curve" in load else decoded(load["values"]).shape == (count, 3)


def values_of(run, curve):
    """Return the values of a curve."""
    if "values" in curve:
        return decoded(curve["values"])
    table, column = curve["column"]
    return decoded(run[table])[:, column]


def curve_of(run, key):
    """Return the values of the curve with a key."""
    return values_of(run, next(curve for curve in run["curves"] if curve["key"] == key))


def matrix(place):
    """Return x, y, z and a quaternion as a matrix."""
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(place[3:]).as_matrix()
    found[:3, 3] = place[:3]
    return found


def placements(document, run, sample):
    """Return the placements (njoints, 4, 4) of all joints in the world, from the document alone."""
    q, found = decoded(run["q"])[sample], []
    for joint in document["scene"]["joints"]:
        if joint["kind"] == "placed":
            here = matrix(decoded(run["placed"][joint["name"]])[sample])
        else:
            start, count = joint["q"]
            here = matrix(joint["placement"]) @ moved(joint, q[start : start + count])
        found.append(here if joint["parent"] < 0 else found[joint["parent"]] @ here)
    return np.array(found)


def moved(joint, q):
    """Return what a joint adds to its placement."""
    kind, axis, found = joint["kind"], np.array(joint.get("axis", (0.0, 0.0, 1.0))), np.eye(4)
    if kind == "prismatic":
        found[:3, 3] = q[0] * axis
    elif kind in ("revolute", "helical", "continuous"):
        angle = np.arctan2(q[1], q[0]) if kind == "continuous" else q[0]
        found[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix()
        found[:3, 3] = joint.get("pitch", 0.0) * angle * axis
    elif kind == "spherical":
        found[:3, :3] = Rotation.from_quat(q).as_matrix()
    elif kind == "translation":
        found[:3, 3] = q
    elif kind == "planar":
        found[:3, :3] = Rotation.from_euler("z", np.arctan2(q[3], q[2])).as_matrix()
        found[:2, 3] = q[:2]
    elif kind == "free":
        found = matrix(q)
    elif kind == "universal":
        turns = [
            Rotation.from_rotvec(x * np.array(joint[name]))
            for x, name in zip(q, ("axis", "axis2"), strict=True)
        ]
        found[:3, :3] = (turns[0] * turns[1]).as_matrix()
    else:
        raise AssertionError(kind)
    return found


CONTINUOUS = """<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">
<parent link="a"/><child link="b"/><axis xyz="0.6 0 0.8"/></joint></robot>"""


def every_joint():
    rng, axis = np.random.default_rng(5), np.array([0.6, 0.0, 0.8])
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX(), pin.SE3.Random())
    composite.addJoint(pin.JointModelPY(), pin.SE3.Random())
    unbounded = pin.buildModelFromXML(CONTINUOUS).joints[1]
    each = {
        "rz": pin.JointModelRZ(),
        "r": pin.JointModelRevoluteUnaligned(axis),
        "ruby": pin.JointModelRUBY(),
        "ru": unbounded,
        "px": pin.JointModelPX(),
        "p": pin.JointModelPrismaticUnaligned(axis),
        "hy": pin.JointModelHY(0.3),
        "h": pin.JointModelHelicalUnaligned(axis, -0.2),
        "ball": pin.JointModelSpherical(),
        "translation": pin.JointModelTranslation(),
        "planar": pin.JointModelPlanar(),
        "free": pin.JointModelFreeFlyer(),
        "universal": pin.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])),
        "zyx": pin.JointModelSphericalZYX(),
        "composite": composite,
    }
    model = pin.Model()
    for i, (name, joint) in enumerate(each.items()):
        model.addJoint(int(rng.integers(0, i + 1)), joint, pin.SE3.Random(), name)
    return model, model.createData()
