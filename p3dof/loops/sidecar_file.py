"""The YAML file of a `Sidecar`: its content as plain data, read and written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from p3dof._base.checks import frozen_array, shown
from p3dof._base.errors import ModelError
from p3dof.loops.constraints import Closure, Coupling, check_couplings, checked_name, known_kind
from p3dof.loops.joint_data import JointData, checked_data

_REQUIRED = ("closed_loop", "type", "name_mot")
_OPTIONAL = ("length", "coupling", "reference", "joint_name", "joint_type", "joint_data")
_JOINT_DATA = ("stiffness", "rest", "damping", "friction", "armature", "rotor_inertia", "gear_ratio", "force")
_COUPLING = ("joint", "coefficients", "on", "name", "others")


def parts_of(content: Mapping[str, Any], source: str) -> tuple[Any, ...]:
    """Return the arguments of `Sidecar` from a mapping with the keys of the file.

    Parameters
    ----------
    content : mapping
        What the file holds.
    source : str
        What to call it in an error.

    Returns
    -------
    tuple
        Closures, actuated joints, couplings, reference, joints, joint data.

    Raises
    ------
    ModelError
        If a key is missing or unknown, or a value has the wrong type or length.
    """
    if not isinstance(content, Mapping):
        raise ModelError(f"{source}: expected a mapping with {_listed(_REQUIRED)}, got {shown(content)}")
    _known_keys(source, content, _REQUIRED, _OPTIONAL)
    pairs, kinds, actuated = (_list(source, content, key) for key in _REQUIRED)
    lengths, couplings, names, types, data = (
        [] if content.get(key) is None else _list(source, content, key)
        for key in ("length", "coupling", "joint_name", "joint_type", "joint_data")
    )
    _same_number(source, "type", len(kinds), len(pairs), "closure")
    if lengths:
        _same_number(source, "length", len(lengths), len(pairs), "closure")
    _same_number(source, "joint_type", len(types), len(names), "name")
    entries = zip(pairs, kinds, lengths or [None] * len(pairs), strict=True)
    closures = [_closure(source, i, *entry) for i, entry in enumerate(entries)]
    distinct(f"{source}: name_mot", actuated)
    distinct(f"{source}: joint_name", names)
    found = [_coupling(f"{source}: coupling[{i}]", entry) for i, entry in enumerate(couplings)]
    check_couplings(f"{source}: coupling", found)
    return (
        tuple(closures),
        tuple(actuated),
        tuple(found),
        reference_of(f"{source}: reference", content.get("reference")),
        tuple(pair_of(f"{source}: joint_type", pair) for pair in zip(names, types, strict=True)),
        checked_data(
            f"{source}: joint_data",
            [_joint_data(f"{source}: joint_data[{i}]", entry) for i, entry in enumerate(data)],
        ),
    )


def content_of(
    closures: tuple[Closure, ...],
    actuated: tuple[str, ...],
    couplings: tuple[Coupling, ...],
    reference: Mapping[str, Any] | None,
    joints: tuple[tuple[str, str], ...],
    joint_data: tuple[JointData, ...],
) -> dict[str, Any]:
    """Return what the file of a sidecar holds; keys that would be empty are left out.

    Parameters
    ----------
    closures, actuated, couplings, reference, joints, joint_data
        As of `Sidecar`.

    Returns
    -------
    dict
        It is plain: lists, text and numbers.
    """
    content: dict[str, Any] = {
        "closed_loop": [[closure.frame1, closure.frame2] for closure in closures],
        "type": [closure.kind for closure in closures],
        "name_mot": list(actuated),
    }
    if any(closure.length is not None for closure in closures):
        content["length"] = [closure.length for closure in closures]
    if couplings:
        content["coupling"] = [_fields(coupling) for coupling in couplings]
    if reference is not None:
        content["reference"] = {
            joint: list(value) if isinstance(value, tuple) else value for joint, value in reference.items()
        }
    if joints:
        content["joint_name"], content["joint_type"] = (list(part) for part in zip(*joints, strict=True))
    if joint_data:
        content["joint_data"] = [_data_fields(entry) for entry in joint_data]
    return content


def reference_of(where: str, reference: Any) -> Mapping[str, float | tuple[float, ...]] | None:
    """Return a reference configuration that cannot be changed: a number, or a tuple of several, by joint.

    Parameters
    ----------
    where : str
        What to call it in an error.
    reference : mapping of str to float or sequence of float, or None
        The configuration.

    Returns
    -------
    mapping, or None

    Raises
    ------
    ModelError
        If it is no mapping of names to finite numbers.
    """
    if reference is None:
        return None
    if not isinstance(reference, Mapping):
        raise ModelError(f"{where}: expected a mapping of joints to values, got {shown(reference)}")
    result: dict[str, float | tuple[float, ...]] = {}
    for joint, value in reference.items():
        checked_name(where, joint)
        several = isinstance(value, Iterable) and not isinstance(value, str | Mapping)
        numbers = tuple(_number(number) for number in value) if several else (_number(value),)
        array = frozen_array(f"{where}: {shown(joint)}", numbers, ("n",), ModelError)
        if not len(array):
            raise ModelError(f"{where}: {shown(joint)}: expected a number, got none")
        result[joint] = tuple(float(x) for x in array) if len(array) > 1 else float(array[0])
    return MappingProxyType(result)


def pair_of(where: str, pair: Any) -> tuple[str, str]:
    """Return a pair of names as a tuple.

    Parameters
    ----------
    where : str
        What to call it in an error.
    pair : sequence of two str
        A joint and its type.

    Returns
    -------
    tuple of (str, str)

    Raises
    ------
    ModelError
        If it is no such pair.
    """
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise ModelError(f"{where}: expected pairs of a joint and its type, got {shown(pair)}")
    for name in pair:
        checked_name(where, name)
    return pair[0], pair[1]


def distinct(where: str, joints: Sequence[Any]) -> None:
    """Refuse names of which two are the same.

    Parameters
    ----------
    where : str
        What to call them in an error.
    joints : sequence of str
        The names.

    Raises
    ------
    ModelError
        If one is named twice, or is no name.
    """
    seen: set[str] = set()
    for index, joint in enumerate(joints):
        checked_name(f"{where}[{index}]", joint)
        if joint in seen:
            raise ModelError(f"{where}[{index}]: the joint {shown(joint)} is named twice")
        seen.add(joint)


def _known_keys(
    where: str, content: Mapping[str, Any], required: tuple[str, ...], optional: tuple[str, ...]
) -> None:
    for key in content:
        if key not in required + optional:
            raise ModelError(f"{where}: unknown key {shown(key)}, expected {_listed(required + optional)}")
    for key in required:
        if key not in content:
            raise ModelError(f"{where}: the key {key!r} is missing")


def _list(source: str, content: Mapping[str, Any], key: str) -> list[Any]:
    if isinstance(content[key], str | Mapping) or not isinstance(content[key], Iterable):
        raise ModelError(f"{source}: {key}: expected a list, got {shown(content[key])}")
    return list(content[key])


def _same_number(source: str, key: str, got: int, expected: int, what: str) -> None:
    if got != expected:
        raise ModelError(f"{source}: {key}: expected {expected} entries, one a {what}, got {got}")


def _closure(source: str, index: int, pair: Any, kind: Any, length: Any) -> Closure:
    where = f"{source}: closed_loop[{index}]"
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        raise ModelError(f"{where}: expected a pair of frame names, got {shown(pair)}")
    for frame in pair:
        checked_name(where, frame)
    if pair[0] == pair[1]:
        raise ModelError(f"{where}: expected two different frames, got {shown(pair[0])} twice")
    kind = known_kind(f"{source}: type[{index}]", kind)
    try:
        return Closure(pair[0], pair[1], kind, _number(length))
    except ModelError as error:
        raise ModelError(f"{source}: length[{index}]: {error}") from error


def _coupling(where: str, entry: Any) -> Coupling:
    if not isinstance(entry, Mapping):
        raise ModelError(f"{where}: expected a mapping with {_listed(_COUPLING)}, got {shown(entry)}")
    if "on" not in entry:  # which YAML reads as true, if it is not in quotes
        entry = {"on" if key is True else key: value for key, value in entry.items()}
    _known_keys(where, entry, _COUPLING[:2], _COUPLING[2:])
    numbers = entry["coefficients"]
    if isinstance(numbers, list | tuple):
        numbers = tuple(_number(number) for number in numbers)
    try:
        others = entry.get("others", ())
        if isinstance(others, Mapping):
            others = {name: _number(factor) for name, factor in others.items()}
        return Coupling(entry["joint"], entry.get("on"), numbers, entry.get("name"), others)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error


def _joint_data(where: str, entry: Any) -> JointData:
    if not isinstance(entry, Mapping):
        raise ModelError(
            f"{where}: expected a mapping with {_listed(('joint', *_JOINT_DATA))}, got {shown(entry)}"
        )
    _known_keys(where, entry, ("joint",), _JOINT_DATA)
    try:
        given = {key: entry[key] for key in _JOINT_DATA if key in entry}
        for key, value in given.items():
            several = key == "rest" and isinstance(value, list | tuple)
            given[key] = [_number(number) for number in value] if several else _number(value)
        return JointData(entry["joint"], **given)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error


def _data_fields(entry: JointData) -> dict[str, Any]:
    plain = JointData(entry.joint)
    found = {key: getattr(entry, key) for key in _JOINT_DATA if getattr(entry, key) != getattr(plain, key)}
    if isinstance(entry.rest, tuple):
        found["rest"] = list(entry.rest)
    return {"joint": entry.joint, **found}


def _fields(coupling: Coupling) -> dict[str, Any]:
    content: dict[str, Any] = {
        "joint": coupling.joint,
        "on": coupling.on,
        "coefficients": list(coupling.coefficients),
    }
    if coupling.name is not None:
        content["name"] = coupling.name
    if coupling.others:
        content["others"] = dict(coupling.others)
    return content


def _number(value: Any) -> Any:
    """Return what YAML reads as text but is a number, such as 1e-3, as a number; else the value itself."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _listed(keys: Iterable[str]) -> str:
    return ", ".join(repr(key) for key in keys)
