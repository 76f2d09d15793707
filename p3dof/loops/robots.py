"""`load_robot`: a robot with closed loops from a file of any format that is understood, or by its name."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pinocchio as pin

from p3dof._base.checks import meant, shown
from p3dof._base.errors import FileError, InputError, MissingExtraError, ModelError
from p3dof._base.files import read_text
from p3dof.loops.coordinates import with_armature
from p3dof.loops.model import ClosedLoopModel
from p3dof.loops.sidecar import Sidecar, SidecarLike, names_beside, sidecar_of, suggestion
from p3dof.loops.xml_text import Macros, is_text, read_xml, root_of


def urdf_of(name: str) -> tuple[str, bool]:
    """Return the path of the URDF of a robot, and whether its base floats."""
    from p3dof._base import model_files

    here = [file for ending in _SUFFIXES if _is_there(file := name + ending)]
    if not here and f"gallery/{name}" in model_files.NAMES:
        return model_files.path(f"gallery/{name}"), False
    own = [known.partition("/")[2] for known in model_files.NAMES if "/" in known]
    try:
        from example_robot_data import robots_loader
    except ImportError as error:
        raise MissingExtraError(
            f"{shown(name)} is no file; robots by name need example-robot-data: pip install 'p3dof[models]'"
            + meant(name, [*here, *own])
        ) from error
    loaders = robots_loader.ROBOTS
    if name not in loaders:
        told = f"did you mean {here[0]!r}?" if here else suggestion(name, [*own, *loaders])
        raise ModelError(f"{shown(name)} is no file and no robot by name; {told}")
    loader = loaders[name]
    if not loader.urdf_filename:
        raise ModelError(f"the robot {shown(name)} has no URDF")
    inside = f"{loader.path}/{loader.urdf_subpath}/{loader.urdf_filename}"
    folder = loader.model_path or robots_loader.getModelPath(inside)
    return f"{folder}/{inside}", bool(loader.free_flyer)


_USD = (".usda", ".usd", ".usdc")
_SUFFIXES = (".urdf", ".xml", ".mjcf", ".xacro", ".sdf", *_USD)


def load_robot(
    source: str | os.PathLike[str],
    sidecar: SidecarLike = None,
    *,
    root_joint: pin.JointModel | None = None,
    reference: str | Mapping[str, Any] | None = None,
    srdf_file: str | os.PathLike[str] | None = None,
    mimic: bool = True,
    on_unknown: Literal["raise", "ignore"] = "raise",
    passive: bool | None = None,
    bushings: Literal["closures"] | None = None,
    include_root: str | os.PathLike[str] | None = None,
    xacro_args: Mapping[str, object] | None = None,
) -> ClosedLoopModel:
    """Return a robot with (or without) closed loops.

    Read are URDF with the sidecar of the Gepetto team's collection or of this package, the loops of URDF+,
    Drake, Isaac Sim and Gazebo in it, ``<mimic>``, SDF 1.4 to 1.12 with loops of joints, MJCF (with the
    extra ``mjcf``), and UsdPhysics in USD as text (with the extra ``usd``). An element of a URDF, SDF or USD
    that is not understood is named in a warning; one that may hold links or joints together is an error.
    Meshes are not needed.

    Parameters
    ----------
    source : str or path-like
        The path of a file, its text, or the name of a robot: of the gallery, as ``"stewart"``, or
        of example-robot-data, such as ``"panda"`` (with the extra ``models``), which floats if it does there.
    sidecar : Sidecar, mapping, str or path-like, optional
        Loops and actuated joints that the file does not hold, see `Sidecar`. Its actuated joints go before
        those that ``<transmission>`` and ``<ros2_control>`` name. By default the file of the same
        name that ends in ``.yaml``, if it is a sidecar, but for a USD file; its closures count where an SDF
        or MJCF has none itself. An empty tuple for none.
    root_joint : pin.JointModel, optional
        The joint between the world and the root link of a URDF, such as ``pin.JointModelFreeFlyer()``; by
        default the root link is fixed. In an SDF the joint of a link that no joint holds in the world, which
        floats by default.
    reference : str or mapping, optional
        The configuration that is meant by the assembly, as in `Sidecar`, or its name in the file: a group
        state of the SRDF, a keyframe of the MJCF.
    srdf_file : path-like, optional
        The SRDF of a URDF.
    mimic : bool
        Whether ``<mimic>`` couples joints; else they are independent.
    on_unknown : {"raise", "ignore"}
        What to do with elements of a URDF or SDF that are not understood: refuse those that may hold links or
        joints together and name the others in a warning, or leave all out without a word.
    passive : bool, optional
        Whether springs, damping and friction act that the robot's own file gives to its joints: by default
        those of an MJCF, whose users mean them, the springs of an SDF, and not the damping and friction of a
        URDF or SDF, which are often guesses. They become `Sidecar.joint_data`; what the sidecar says of a
        joint always acts, and goes before.
    bushings : {"closures"}, optional
        Takes Drake's bushings for the closures that they stand for: a stiffness against forces alone is a
        point, against two torques too a hinge, against all but one force a slider, against all a rigid
        connection, below 1/1000 of the largest of its kind nothing. By default they act as in Drake.
    include_root : path-like, optional
        A folder below which an MJCF or SDF may include files, and in which ``model://`` is looked for; by
        default that of the file.
    xacro_args : mapping of str to object, optional
        Values of the arguments of a file that ends in ``.xacro``, whose macros the program xacro expands
        (extra ``xacro``, or that of ROS). It evaluates expressions that are in the file.

    Raises
    ------
    ModelError
        If a file is missing, malformed or too large, names something that does not exist, or has what may
        hold links or joints together and is not understood.
    InputError
        If an argument does not fit the format.
    MissingExtraError
        If the library for the format is not installed.

    Notes
    -----
    In an SDF the motors are the joints of one freedom whose effort is not 0 and that follow no other, as in
    Drake. In a file with loops and no effort of 0 they are those that plug-ins of Gazebo move; then there are
    none without these, unless a sidecar names them.
    """
    if isinstance(source, pin.Model):
        raise ModelError("robot: expected a file or a name; ClosedLoopModel.from_pinocchio takes a model")
    source, path, floating = _found(source, xacro_args)
    if floating and root_joint is None:
        root_joint = pin.JointModelFreeFlyer()
    root = "usd" if path is not None and path.lower().endswith(_USD) else _root(source)
    given = sidecar if sidecar is not None or path is None or root == "usd" else _beside(path)
    state = reference if isinstance(reference, str) else None
    _refuse(
        root,
        root_joint=root_joint,
        srdf_file=srdf_file,
        reference=state,
        bushings=bushings,
        include_root=include_root,
    )
    if root == "mujoco":  # a reader is loaded when a file needs it
        from p3dof.loops.formats import mjcf

        tree, found = mjcf.read(source, state, include_root)
        if passive is False:
            found = replace(found, joint_data=())
    elif root == "sdf":
        from p3dof.loops.formats import sdf

        tree, found = sdf.read(source, given, root_joint, mimic, on_unknown, passive, include_root)
    elif root == "usd":
        from p3dof.loops.formats import usd

        tree, found = usd.read(source, given, root_joint, on_unknown, passive, include_root)
    else:
        from p3dof.loops.formats import urdf

        tree, found = urdf.read(source, given, root_joint, mimic, on_unknown, bool(passive), bushings)
        if srdf_file is not None:
            values = urdf.state_of(srdf_file, state, list(tree.names)[1:])
            found = replace(found, reference=values)
        elif state is not None:
            raise InputError(f"reference: the name {shown(state)} needs an SRDF that has it: srdf_file")
    if root != "robot":
        found = _joined(found, sidecar_of(given), asked=sidecar is not None)
        found = replace(found, joint_data=with_armature(tree, found.joint_data))
    if reference is not None and not isinstance(reference, str):
        found = replace(found, reference=reference)
    return _closed(tree, found, path, given)


def _found(
    source: str | os.PathLike[str], xacro_args: Mapping[str, object] | None
) -> tuple[str | os.PathLike[str], str | None, bool]:
    """Return what is read, its path, and whether its base floats; the path is None for text."""
    path, floating = _path(source), False
    if path is None and not is_text(source):
        path, floating = urdf_of(str(source))
    source = source if path is None else path
    if path is not None and path.lower().endswith(Macros.SUFFIX):
        source = Macros(path, xacro_args)
    elif xacro_args:
        raise InputError("xacro_args: only a file that ends in .xacro has arguments, expected None")
    return source, path, floating


_NO_STATES = {"sdf": "an SDF file has no states with names", "usd": "a USD file has no states with names"}


def _refuse(root: str, **given: Any) -> None:
    """Refuse arguments that a format has no use for."""
    reasons = {
        "root_joint": {"mujoco": "an MJCF file has its own"},
        "srdf_file": {"mujoco": "an MJCF file has its own", **_NO_STATES},
        "reference": _NO_STATES,
        "bushings": dict.fromkeys(("mujoco", "sdf", "usd"), "only a URDF has such closures"),
        "include_root": {"robot": "a URDF file includes no others"},
    }
    for what, value in given.items():
        if value is not None and (reason := reasons[what].get(root)):
            raise InputError(f"{what}: {reason}, expected None")


def _closed(tree: pin.Model, found: Sidecar, path: str | None, given: SidecarLike) -> ClosedLoopModel:
    """Return a robot with its loops; an error about both says of which files they are."""
    try:
        return ClosedLoopModel(tree, found)
    except ModelError as error:
        if path is None or not isinstance(given, str | os.PathLike) or is_text(given):
            raise
        raise ModelError(f"{error} ({Path(path).name} with {Path(given).name})") from error


def file_of(source: str | os.PathLike[str]) -> str | None:
    """Return the path of the file that a source of `load_robot` stands for; None for text."""
    path = _path(source)
    return urdf_of(str(source))[0] if path is None and not is_text(source) else path


def _root(source: str | os.PathLike[str]) -> str:
    """Return the name of the first element of a robot's file, which is one that is read."""
    text, name = read_xml(source, "robot")
    if not is_text(text):
        raise ModelError(f"{name}: expected URDF, SDF or MJCF, this is not XML; a sidecar comes second")
    root = root_of(text, name)
    if root not in ("robot", "sdf", "mujoco"):
        raise ModelError(f"{name}: expected URDF (<robot>), SDF (<sdf>) or MJCF (<mujoco>), got <{root:.80}>")
    return root


def _path(source: object) -> str | None:
    """Return the path that a source is, None for text and for what can only be a robot's name."""
    if is_text(source):
        return None
    if not isinstance(source, str | os.PathLike) or not os.fspath(source):
        raise ModelError(f"robot: expected a path, XML text or a name, got {shown(source)}")
    path = os.fspath(source)
    if not isinstance(path, str) or "<" in path:
        raise ModelError(f"robot: expected a path, XML text or a name, got {shown(source)}")
    path = named_file(path)
    plain = Path(path).name == path and not path.lower().endswith(_SUFFIXES)
    return None if plain and not isinstance(source, os.PathLike) and not _is_there(path) else path


def named_file(path: str) -> str:
    """Return the path of a file, also where it is the name of a robot of the gallery."""
    if not path.replace("\\", "/").startswith("gallery/"):
        return path
    from p3dof._base.model_files import in_gallery

    return in_gallery(path) or path


def _is_there(path: str) -> bool:
    try:
        return Path(path).exists()
    except (OSError, ValueError):  # such as a name that is too long for any file
        return False


def _beside(path: str) -> SidecarLike:
    """Return the sidecar beside a file, if there is one."""
    for beside in names_beside(path):
        with suppress(FileError):
            if "closed_loop:" in read_text(beside):
                return beside
    return None


def _joined(found: Sidecar, given: Sidecar | None, asked: bool) -> Sidecar:
    """Return the sidecar of a file with what another adds, whose loops are the same if not asked for."""
    if given is None:
        return found
    if given.joints:
        raise ModelError("sidecar: joint_type: only a URDF needs other types")
    said = {entry.joint for entry in given.joint_data}
    known = bool(found.closures) and not asked  # as of a URDF and an SDF of one robot in a folder
    return Sidecar(
        (*found.closures, *(() if known else given.closures)),
        given.actuated,
        (*found.couplings, *(() if known else given.couplings)),
        found.reference if given.reference is None else given.reference,
        joint_data=(*given.joint_data, *(entry for entry in found.joint_data if entry.joint not in said)),
        bushings=(*found.bushings, *given.bushings),
    )
