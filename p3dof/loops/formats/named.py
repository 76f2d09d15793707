"""Robots by name, of the collection example-robot-data."""

from __future__ import annotations

from p3dof._base.checks import shown
from p3dof._base.errors import MissingExtraError, ModelError
from p3dof.loops.sidecar import suggestion


def urdf_of(name: str) -> tuple[str, bool]:
    """Return the path of the URDF of a robot, and whether its base floats.

    Parameters
    ----------
    name : str
        Such as ``"panda"`` or ``"ur5"``.

    Returns
    -------
    path : str
    floating : bool

    Raises
    ------
    ModelError
        If there is no such robot, or it has no URDF.
    MissingExtraError
        If example-robot-data is not installed.
    """
    try:
        from example_robot_data import robots_loader
    except ImportError as error:
        raise MissingExtraError(
            f"{shown(name)} is no file; robots by name need example-robot-data: pip install 'p3dof[models]'"
        ) from error
    loaders = robots_loader.ROBOTS
    if name not in loaders:
        raise ModelError(f"{shown(name)} is no file and no robot by name; {suggestion(name, loaders)}")
    loader = loaders[name]
    if not loader.urdf_filename:
        raise ModelError(f"the robot {shown(name)} has no URDF")
    inside = f"{loader.path}/{loader.urdf_subpath}/{loader.urdf_filename}"
    folder = loader.model_path or robots_loader.getModelPath(inside)
    return f"{folder}/{inside}", bool(loader.free_flyer)
