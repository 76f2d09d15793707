"""`Sidecar`: what a tree URDF cannot say, namely which frames coincide and which joints are actuated."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pinocchio as pin
import yaml

from p3dof.checks import shown
from p3dof.errors import FileError, ModelError
from p3dof.files import parse_yaml, read_text

KINDS = ("3d", "6d")
"""The kinds of closure: the frames' origins coincide (3d), or the frames coincide altogether (6d)."""

_REQUIRED = ("closed_loop", "type", "name_mot")
_IGNORED = ("joint_name", "joint_type")


@dataclass(frozen=True)
class Closure:
    """Two frames on different bodies that coincide.

    Parameters
    ----------
    frame1, frame2 : str
        Names of the frames.
    kind : {"3d", "6d"}
        ``"3d"``: the origins coincide (three rows); ``"6d"``: the axes do too (six rows).

    Raises
    ------
    ModelError
        If a name is empty or not text, both are the same, or the kind is unknown.
    """

    frame1: str
    frame2: str
    kind: str = "3d"

    def __post_init__(self) -> None:
        for field in ("frame1", "frame2"):
            _name(f"closure: {field}", getattr(self, field))
        if self.frame1 == self.frame2:
            raise ModelError(f"closure: expected two different frames, got {shown(self.frame1)} twice")
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise ModelError(
                f"closure of {shown(self.frame1)} and {shown(self.frame2)}: expected kind '3d' or '6d', "
                f"got {shown(self.kind)}"
            )

    @property
    def name(self) -> str:
        """Both frames in one text, ``frame1/frame2``."""
        return f"{self.frame1}/{self.frame2}"

    @property
    def rows(self) -> int:
        """How many rows the closure has in the Jacobian: 3 or 6."""
        return 3 if self.kind == "3d" else 6


@dataclass(frozen=True)
class Sidecar:
    """The loop closures and the actuated joints that complete a tree model.

    Its file is the YAML sidecar of the Gepetto team's example-parallel-robots: ``closed_loop`` lists pairs of
    frames, ``type`` says for each pair ``'3d'`` or ``'6d'``, ``name_mot`` lists the actuated joints;
    ``joint_name`` and ``joint_type`` may be there and are ignored.

    Parameters
    ----------
    closures : tuple of Closure
        The closures; may be empty, and may be redundant.
    actuated : tuple of str
        Names of the actuated joints, in the order of every `tau`. Empty for a mechanism that moves passively.

    Raises
    ------
    ModelError
        If an entry has the wrong type or a joint is named twice.
    """

    closures: tuple[Closure, ...]
    actuated: tuple[str, ...]

    def __post_init__(self) -> None:
        for field in ("closures", "actuated"):
            value = getattr(self, field)
            if isinstance(value, str) or not isinstance(value, Iterable):
                raise ModelError(f"{field}: expected a sequence, got {shown(value)}")
            object.__setattr__(self, field, tuple(value))
        for closure in self.closures:
            if not isinstance(closure, Closure):
                raise ModelError(f"closures: expected Closure objects, got {shown(closure)}")
        _distinct("actuated", self.actuated)

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
            ``closed_loop``, ``type`` and ``name_mot``, as in the file.
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
        if not isinstance(content, Mapping):
            raise ModelError(f"{source}: expected a mapping with {_listed(_REQUIRED)}, got {shown(content)}")
        for key in content:
            if key not in _REQUIRED + _IGNORED:
                raise ModelError(
                    f"{source}: unknown key {shown(key)}, expected {_listed(_REQUIRED + _IGNORED)}"
                )
        for key in _REQUIRED:
            if key not in content:
                raise ModelError(f"{source}: the key {key!r} is missing")
            if isinstance(content[key], str | Mapping) or not isinstance(content[key], Iterable):
                raise ModelError(f"{source}: {key}: expected a list, got {shown(content[key])}")
        pairs, kinds, joints = (list(content[key]) for key in _REQUIRED)
        if len(pairs) != len(kinds):
            raise ModelError(
                f"{source}: type: expected {len(pairs)} entries, one a closure, got {len(kinds)}"
            )
        closures = [_closure(source, i, *entry) for i, entry in enumerate(zip(pairs, kinds, strict=True))]
        _distinct(f"{source}: name_mot", joints)
        return cls(tuple(closures), tuple(joints))

    def to_yaml(self) -> str:
        """Return the text of the sidecar file.

        Returns
        -------
        str
            YAML that `parse` reads back to an equal sidecar.
        """
        content = {
            "closed_loop": [[closure.frame1, closure.frame2] for closure in self.closures],
            "type": [closure.kind for closure in self.closures],
            "name_mot": list(self.actuated),
        }
        text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True)
        return text


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


def _closure(source: str, index: int, pair: Any, kind: Any) -> Closure:
    where = f"{source}: closed_loop[{index}]"
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise ModelError(f"{where}: expected a pair of frame names, got {shown(pair)}")
    for frame in pair:
        _name(where, frame)
    if pair[0] == pair[1]:
        raise ModelError(f"{where}: expected two different frames, got {shown(pair[0])} twice")
    if not isinstance(kind, str) or kind.lower() not in KINDS:
        raise ModelError(f"{source}: type[{index}]: expected '3d' or '6d', got {shown(kind)}")
    return Closure(pair[0], pair[1], kind.lower())


def _name(where: str, value: Any) -> None:
    if not isinstance(value, str) or not value.strip():
        raise ModelError(f"{where}: expected a name, got {shown(value)}")


def _distinct(where: str, joints: Sequence[Any]) -> None:
    seen: set[str] = set()
    for index, joint in enumerate(joints):
        _name(f"{where}[{index}]", joint)
        if joint in seen:
            raise ModelError(f"{where}[{index}]: the joint {shown(joint)} is named twice")
        seen.add(joint)


def _listed(keys: Iterable[str]) -> str:
    return ", ".join(repr(key) for key in keys)
