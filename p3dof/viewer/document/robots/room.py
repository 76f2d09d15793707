"""How much room a robot takes along a motion."""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

_LOOKED_AT = 60
"""At so many configurations at most it is looked how much room a robot takes."""


def some_of(count: int) -> NDArray[np.int_]:
    """Return indices of some of so many samples, the first and the last included."""
    return np.asarray(np.unique(np.linspace(0, count - 1, min(count, _LOOKED_AT)).round().astype(int)))


def corners_of(solid: pin.GeometryObject) -> FloatArray:
    """Return the corners (8, 3) of the box around a solid, in its own axes [m]."""
    solid.geometry.computeLocalAABB()
    box = solid.geometry.aabb_local
    ends = np.array([box.min_, box.max_])
    return np.array(list(product(*ends.T)))


def room_of(model: pin.Model, visual_model: pin.GeometryModel, q: FloatArray) -> FloatArray:
    """Return points that hold all solids, or the joints of a robot without, along a motion.

    Parameters
    ----------
    model : pin.Model
        The tree.
    visual_model : pin.GeometryModel
        Its solids.
    q : ndarray, shape (N, nq)
        Configurations; those that are not finite are passed over.

    Returns
    -------
    ndarray, shape (n, 3)
        [m]; the origin if there is nothing.
    """
    data, points = model.createData(), [np.zeros((0, 3))]
    boxes = [(one, corners_of(one)) for one in visual_model.geometryObjects]
    for row in q[some_of(len(q))]:
        if not np.isfinite(row).all():
            continue
        pin.forwardKinematics(model, data, row)
        if not boxes:
            points.append(np.array([place.translation for place in data.oMi]))
        for solid, box in boxes:
            place = data.oMi[solid.parentJoint] * solid.placement
            points.append(box @ place.rotation.T + place.translation)
    found = np.concatenate(points)
    return found[np.isfinite(found).all(axis=1)] if len(found) else np.zeros((1, 3))
