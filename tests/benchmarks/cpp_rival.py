"""What an expert writes for a robot in C++ with Pinocchio (`rival.cpp`): RNEA, closures' Jacobian, one LU.

Pinocchio's headers are those of the wheel; Eigen's are Debian's ``libeigen3-dev``, or where pkg-config finds
them. Compiled once a process, in a minute or two; every robot gets a copy of the library for itself.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from robots import independent

from p3dof import ClosedLoopModel

HERE = Path(__file__).parent
DEFINITIONS = (
    "BOOST_MPL_LIMIT_LIST_SIZE=30",
    "BOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "BOOST_FUSION_INVOKE_MAX_ARITY=12",
    "NDEBUG",
)
"""As Pinocchio's own CMake files have them."""
FLAGS = ("-std=c++17", "-O3", "-march=native", "-fPIC", "-shared", "-w", "-fno-gnu-unique", "-Wl,-Bsymbolic")
"""Templates are compiled here, for this processor; the wheel's library, in the same process, is not used."""


class NotHereError(Exception):
    """The rival cannot be built, or not for this robot; the message says why."""


@cache
def built(folder: Path) -> Path:
    """Return the library."""
    headers = Path(pin.__file__).parents[4] / "include"
    found = [Path(path) for path in ("/usr/include/eigen3", "/usr/local/include/eigen3")]
    if shutil.which("pkg-config"):
        told = subprocess.run(
            ["pkg-config", "--cflags-only-I", "eigen3"], capture_output=True, text=True, check=False
        )
        found += [Path(word[2:]) for word in told.stdout.split()]
    eigen = next((path for path in found if (path / "Eigen" / "Core").exists()), None)
    if eigen is None or not (headers / "pinocchio").is_dir() or shutil.which("g++") is None:
        raise NotHereError(
            "it needs g++, the headers of the pin wheel, and Eigen (apt-get install libeigen3-dev)"
        )
    made = folder / "rival.so"
    command = [
        "g++",
        *FLAGS,
        *(f"-D{name}" for name in DEFINITIONS),
        f"-isystem{headers}",
        f"-isystem{eigen}",
    ]
    subprocess.run([*command, "-o", str(made), str(HERE / "rival.cpp")], check=True)
    return made


def rival(loop: ClosedLoopModel, q: np.ndarray, folder: Path, name: str) -> tuple[ctypes.CDLL, np.ndarray]:
    """Return the library of a robot, and which speeds it takes as independent.

    Its ``inverse_dynamics_bound`` takes q, v, a; its ``motion_bound`` q and the independent speeds and
    accelerations. Both return the actuators' forces.
    """
    if loop.passive or loop.sidecar.couplings:
        raise NotHereError("it knows neither springs and friction nor couplings")
    if any(closure.kind not in ("3d", "distance") for closure in loop.sidecar.closures):
        raise NotHereError("it knows closures of points only")
    own = folder / f"rival_{name}.so"
    shutil.copy(built(folder), own)
    library = ctypes.CDLL(str(own))
    _add_joints(library, loop.model)
    for closure in loop.sidecar.closures:
        ends: list[object] = []
        for frame in (closure.frame1, closure.frame2):
            found = loop.model.frames[loop.model.getFrameId(frame)]
            ends += [ctypes.c_int(found.parentJoint), _doubles(found.placement.translation)]
        library.add_closure(ctypes.c_int(closure.kind == "distance"), *ends)
    rank, passive = loop.rank(q), np.setdiff1d(np.arange(loop.model.nv), loop.actuated_v)
    J = loop.closure_jacobian(q)
    rows = independent(J[:, passive].T, rank)
    follow = np.sort(passive[independent(J[rows][:, passive], rank)])
    library.begin(
        _doubles(loop.model.gravity.linear),
        ctypes.c_int(rank),
        _integers(rows),
        _integers(follow),
        ctypes.c_int(len(loop.actuated_v)),
        _integers(loop.actuated_v),
    )
    return library, np.setdiff1d(np.arange(loop.model.nv), follow)


def _add_joints(library: ctypes.CDLL, model: pin.Model) -> None:
    known = {
        "RX",
        "RY",
        "RZ",
        "PX",
        "PY",
        "PZ",
        "RevoluteUnaligned",
        "PrismaticUnaligned",
        "Spherical",
        "FreeFlyer",
    }
    for i in range(1, model.njoints):
        joint = model.joints[i]
        kind = joint.shortname()
        if kind.removeprefix("JointModel") not in known:
            raise NotHereError(f"it knows no {kind}")
        actual = joint.extract() if hasattr(joint, "extract") else joint
        axis = getattr(actual, "axis", np.zeros(3))
        place, body = model.jointPlacements[i], model.inertias[i]
        library.add_joint(
            kind.encode(),
            ctypes.c_int(model.parents[i]),
            _doubles(axis),
            _doubles(np.concatenate([place.rotation.ravel(), place.translation])),
            _doubles(np.concatenate([[body.mass], body.lever, body.inertia.ravel()])),
        )


def _doubles(values: object) -> object:
    array = np.asarray(values, dtype=float).ravel()
    return (ctypes.c_double * len(array))(*array)


def _integers(values: object) -> object:
    array = np.asarray(values).ravel()
    return (ctypes.c_int * len(array))(*map(int, array))
