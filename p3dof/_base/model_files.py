"""Files of models that come with the package: the paper's machine in every format, and the gallery of robots.

The paths are named as those of a module of robot_descriptions, for tools that take such a module.
"""

from __future__ import annotations

from pathlib import Path

from p3dof._base.checks import meant, shown
from p3dof._base.errors import InputError, ModelError

__all__ = ["MJCF_PATH", "NAMES", "PACKAGE_PATH", "REPOSITORY_PATH", "SRDF_PATH", "URDF_PATH", "path"]

_GALLERY, _LONGEST = "gallery", 100
_PACKAGE = Path(__file__).parents[1]
_INSTALLED = _PACKAGE / "models"  # setup.py copies the files into a wheel
_MACHINE, _ROBOTS = (
    (_INSTALLED / "urdf", _INSTALLED / _GALLERY)
    if _INSTALLED.is_dir()
    else (_PACKAGE.parent / "urdf", _PACKAGE.parent / "docs/_static" / _GALLERY)
)
_FILES = {
    "urdf": "p3dof.urdf",
    "sidecar": "p3dof.yaml",
    "drake": "p3dof_drake.urdf",
    "mjcf": "p3dof_mjcf.xml",
    "sdf": "p3dof.sdf",
    "urdf+": "p3dof_plus.urdf",
    "srdf": "p3dof.srdf",
    "usd": "p3dof.usda",
}

NAMES: tuple[str, ...] = (*_FILES, *sorted(f"{_GALLERY}/{file.stem}" for file in _ROBOTS.glob("*.urdf")))
"""What `path` knows: formats of the paper's machine, and robots of the gallery."""


def path(name: str) -> str:
    """Return the path of a model file that comes with the package.

    Parameters
    ----------
    name : str
        One of `NAMES`: a format of the paper's machine, such as ``"urdf"``, or a robot of the gallery, as
        ``"gallery/stewart"``, whose file is a URDF with its sidecar beside it. `p3dof.load_robot` takes both.

    Returns
    -------
    str
        Path of a file, for any tool that reads the format.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if not isinstance(name, str) or name not in NAMES:
        near = meant(name, NAMES) if isinstance(name, str) else ""
        raise InputError(f"name: expected one of {', '.join(NAMES)}, got {shown(name)}{near}")
    return str(_MACHINE / _FILES[name] if name in _FILES else _ROBOTS / f"{name.partition('/')[2]}.urdf")


def in_gallery(name: str) -> str | None:
    """Return the path of a robot of the gallery, ``gallery/NAME`` with or without ``.urdf``; None of others.

    A file that is there goes before, as a copy of the gallery.
    """
    bare = name.replace("\\", "/").removesuffix(".urdf")
    if not bare.startswith(f"{_GALLERY}/") or len(name) > _LONGEST or Path(name).exists():
        return None
    if bare not in NAMES and Path(bare).suffix == "" and bare == name:
        raise ModelError(f"{shown(name)} is no file and no robot of the gallery{meant(bare, NAMES)}")
    return path(bare) if bare in NAMES else None


REPOSITORY_PATH: str = str(_MACHINE.parent)
PACKAGE_PATH: str = str(_MACHINE)
URDF_PATH: str = path("urdf")
MJCF_PATH: str = path("mjcf")
SRDF_PATH: str = path("srdf")
