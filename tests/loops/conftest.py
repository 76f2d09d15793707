"""Small robots with loops that several files of tests ask for."""

import closed_loop_robots as robots
import pytest
from closed_loop_robots import FIVE_BAR_SIDECAR, FOUR_BAR, FOUR_BAR_SIDECAR

from p3dof.loops import ClosedLoopModel


@pytest.fixture(scope="module")
def four_bar() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.four_bar(*FOUR_BAR), FOUR_BAR_SIDECAR)


@pytest.fixture(scope="module")
def five_bar() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.five_bar(), FIVE_BAR_SIDECAR)


@pytest.fixture(scope="module")
def hexapod() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.hexapod(), robots.HEXAPOD_SIDECAR)


@pytest.fixture(scope="module")
def sarrus() -> ClosedLoopModel:
    return ClosedLoopModel.from_urdf(robots.sarrus(), robots.SARRUS_SIDECAR)
