"""Lines from point to point: matrices that take a unit cylinder along z to where a line is."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray

_FLAT = 1e-6
"""Least length of a line: a page cannot take a transform without an inverse apart."""


def turned_to(direction: FloatArray) -> FloatArray:
    """Return axes (3, 3) whose third one has a direction (3,)."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(direction))
    return np.array(turn.toRotationMatrix())


def placed_at(place: FloatArray) -> FloatArray:
    """Return a place (3,) as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, 3] = place
    return matrix


def line_between(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the matrix (4, 4) that takes z from 0 to 1 to a line between two points (3,)."""
    along = np.asarray(end - start)
    length = max(float(np.linalg.norm(along)), _FLAT)
    matrix = placed_at(start)
    if length > _FLAT:
        matrix[:3, :3] = turned_to(along / length)
    matrix[:3, 2] *= length
    return matrix
