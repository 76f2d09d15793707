"""`Sidecar`: what a tree URDF cannot say, its loops, its couplings and its actuated joints."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import pinocchio as pin
import yaml

from p3dof._base.checks import shown
from p3dof._base.errors import FileError, ModelError
from p3dof._base.files import parse_yaml, read_text
from p3dof.loops.constraints import Closure, Coupling, check_couplings
from p3dof.loops.joint_data import JointData, checked_data
from p3dof.loops.sidecar_file import content_of, distinct, pair_of, parts_of, reference_of

__all__ = ["Closure", "Coupling", "Sidecar", "SidecarLike", "sidecar_of", "suggestion"]


@dataclass(frozen=True)
class Sidecar:
    """What completes a tree model: loop closures, couplings, actuated joints, a reference configuration.

    Its file is the YAML sidecar of the Gepetto team's example-parallel-robots: ``closed_loop`` lists pairs of
    frames, ``type`` says for each pair of which kind the closure is, ``name_mot`` lists the actuated joints.
    Four keys may be added: ``length`` (for each pair the distance, or null), ``coupling`` and ``joint_data``
    (lists of mappings with the fields of `Coupling` and `JointData`) and ``reference`` (a mapping).
    ``joint_name`` and ``joint_type`` list joints that are of another type than the URDF says.

    Parameters
    ----------
    closures : tuple of Closure
        The closures; may be empty, and may be redundant.
    actuated : tuple of str
        Names of the actuated joints, in the order of every `tau`. Empty for a mechanism that moves passively.
    couplings : tuple of Coupling
        Joints that follow others, or are locked.
    reference : mapping of str to float or sequence of float, optional
        A configuration of the assembly that is meant, by joint: its value [m or rad], for a continuous joint
        the angle; all its values in Pinocchio's order if it has several. Joints that are left out are
        neutral. It is where assembling starts; couplings and closures need not hold exactly.
    joints : tuple of (str, str)
        Names and types of joints that are of another type than the tree's file says; whoever reads that file
        applies them.
    joint_data : tuple of JointData
        Springs, damping and friction that act in joints, and their rotors.

    Raises
    ------
    ModelError
        If an entry has the wrong type, a joint is named or coupled twice, or couplings form a ring.
    """

    closures: tuple[Closure, ...]
    actuated: tuple[str, ...]
    couplings: tuple[Coupling, ...] = ()
    reference: Mapping[str, Any] | None = field(default=None, hash=False)
    joints: tuple[tuple[str, str], ...] = ()
    joint_data: tuple[JointData, ...] = ()

    def __post_init__(self) -> None:
        for name in ("closures", "actuated", "couplings", "joints", "joint_data"):
            value = getattr(self, name)
            if isinstance(value, str) or not isinstance(value, Iterable):
                raise ModelError(f"{name}: expected a sequence, got {shown(value)}")
            object.__setattr__(self, name, tuple(value))
        kinds: tuple[tuple[str, type], ...] = (("closures", Closure), ("couplings", Coupling))
        for name, kind in kinds:
            for entry in getattr(self, name):
                if not isinstance(entry, kind):
                    raise ModelError(f"{name}: expected {kind.__name__} objects, got {shown(entry)}")
        distinct("actuated", self.actuated)
        check_couplings("couplings", self.couplings)
        object.__setattr__(self, "reference", reference_of("reference", self.reference))
        object.__setattr__(self, "joints", tuple(pair_of("joints", pair) for pair in self.joints))
        distinct("joints", [name for name, _ in self.joints])
        object.__setattr__(self, "joint_data", checked_data("joint_data", self.joint_data))

    def __reduce__(self) -> tuple[Any, ...]:
        reference = None if self.reference is None else dict(self.reference)
        return Sidecar, (
            self.closures,
            self.actuated,
            self.couplings,
            reference,
            self.joints,
            self.joint_data,
        )

    @classmethod
    def serial(cls, model: pin.Model) -> Sidecar:
        """Return the sidecar of an open tree: no closures, every joint with one degree of freedom actuated.

        Parameters
        ----------
        model : pin.Model
            The tree.

        Returns
        -------
        Sidecar
        """
        joints = range(1, model.njoints)
        return cls((), tuple(str(model.names[i]) for i in joints if model.nvs[i] == 1))

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Sidecar:
        """Read a sidecar file.

        Parameters
        ----------
        path : path-like
            The YAML file.

        Returns
        -------
        Sidecar

        Raises
        ------
        ModelError
            If the file cannot be read or is malformed; the message names the file and the field.
        """
        try:
            text = read_text(path)
        except FileError as error:
            raise ModelError(str(error)) from error
        return cls.parse(text, os.fspath(path))

    @classmethod
    def parse(cls, text: str, source: str = "sidecar") -> Sidecar:
        """Read a sidecar from YAML text.

        Parameters
        ----------
        text : str
            The YAML text.
        source : str
            What to call it in an error: usually the file name.

        Returns
        -------
        Sidecar

        Raises
        ------
        ModelError
            If the text is malformed; the message names the source and the field.
        """
        return cls.from_mapping(parse_yaml(text, source, ModelError), source)

    @classmethod
    def from_mapping(cls, content: Mapping[str, Any], source: str = "sidecar") -> Sidecar:
        """Build a sidecar from a mapping with the keys of the file.

        Parameters
        ----------
        content : mapping
            ``closed_loop``, ``type`` and ``name_mot``, and perhaps more, as in the file.
        source : str
            What to call it in an error.

        Returns
        -------
        Sidecar

        Raises
        ------
        ModelError
            If a key is missing or unknown, or a value has the wrong type or length.
        """
        return cls(*parts_of(content, source))

    def to_yaml(self) -> str:
        """Return the text of the sidecar file.

        Returns
        -------
        str
            YAML that `parse` reads back to an equal sidecar.
        """
        parts = (
            self.closures,
            self.actuated,
            self.couplings,
            self.reference,
            self.joints,
            self.joint_data,
        )
        text: str = yaml.safe_dump(
            content_of(*parts), sort_keys=False, default_flow_style=None, allow_unicode=True
        )
        return text


SidecarLike: TypeAlias = Sidecar | Mapping[str, Any] | str | os.PathLike[str] | tuple[()] | None
"""A sidecar, a mapping with the keys of its file, the path of the file or its text; an empty tuple or None
for none."""


def sidecar_of(given: SidecarLike) -> Sidecar | None:
    """Return what a user gives for a sidecar as one; None for none.

    Parameters
    ----------
    given : Sidecar, mapping, str or path-like, optional
        See `SidecarLike`.

    Returns
    -------
    Sidecar, optional

    Raises
    ------
    ModelError
        If a file cannot be read, or something is malformed.
    """
    if given is None or (isinstance(given, tuple) and not given) or isinstance(given, Sidecar):
        return given or None
    if isinstance(given, str) and "\n" in given:
        return Sidecar.parse(given)
    if isinstance(given, str | os.PathLike):
        return Sidecar.from_yaml(given)
    return Sidecar.from_mapping(given)


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the part of an error message that helps with a name that does not exist.

    Parameters
    ----------
    name : str
        The name that was asked for.
    known : iterable of str
        The names that exist.

    Returns
    -------
    str
        ``"did you mean ...?"`` if names come close, otherwise the known names (at most twenty).
    """
    names = list(dict.fromkeys(known))
    short = [known for known in names if len(known) <= 100]  # comparing takes length times length
    close = difflib.get_close_matches(name, short, n=3) if len(name) <= 100 else []
    if close:
        return f"did you mean {' or '.join(map(repr, close))}?"
    listed = ", ".join(f"{known:.100}" for known in names[:20]) + (", ..." if len(names) > 20 else "")
    return f"known: {listed or 'none'}"
