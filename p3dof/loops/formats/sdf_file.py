"""The files of a robot in SDF: the elements that are read, its names, and where they are in the world.

A scope is a world or a model; what is in a nested model has the name ``model::name``. A pose is relative to
another frame of its scope, and what is attached to a frame moves with a link.

References
----------
SDFormat specification 1.4 to 1.12, "Pose Frame Semantics" and "Composition and Nesting Semantics of Models";
Drake, parsing of SDF.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree as Xml

import numpy as np
import pinocchio as pin

from p3dof._base.checks import LARGEST, FloatArray, one_line, shown
from p3dof.loops.formats.urdf import MAX_LINKS
from p3dof.loops.sidecar import suggestion
from p3dof.loops.xml_text import MAX_DEPTH, XmlReader, folder_below_which, is_text, number_of, read_xml

BALL = "drake:ball_constraint"
_AXIS = ("xyz", "use_parent_model_frame", "dynamics", "limit", "mimic")
_ENDS = (f"{BALL}_body_A", f"{BALL}_p_AP", f"{BALL}_body_B", f"{BALL}_p_BQ")
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_GEARBOX = ("gearbox_ratio", "gearbox_reference_body")
DRAKES = ("drake:mimic", "drake:rotor_inertia", "drake:gear_ratio")
READ: Mapping[str, tuple[str, ...]] = {
    "sdf": ("model", "world"),
    "world": ("model", "include", "frame", "joint", "gravity", "physics"),
    "model": ("pose", "static", "link", "joint", "frame", "model", "include", BALL),
    "include": ("uri", "pose", "name", "static", "placement_frame"),
    "frame": ("pose",),
    "link": ("pose", "inertial", "gravity", "kinematic", "enable_wind"),
    "inertial": ("pose", "mass", "inertia"),
    "inertia": MOMENTS,
    "joint": (
        "parent",
        "child",
        "pose",
        "axis",
        "axis2",
        "thread_pitch",
        "screw_thread_pitch",
        *_GEARBOX,
        *DRAKES,
    ),
    "axis": _AXIS,
    "axis2": _AXIS,
    "dynamics": ("damping", "friction", "spring_reference", "spring_stiffness"),
    "limit": ("lower", "upper", "effort", "velocity"),
    "mimic": ("multiplier", "offset", "reference"),
    BALL: _ENDS,
}
"""Elements that are read, by the element that they are in."""
_SHAPES = ("visual", "collision", "sensor", "projector", "audio_sink", "audio_source", "battery", "light")
IDLE: Mapping[str, tuple[str, ...]] = {
    "sdf": ("light", "actor"),
    "world": (
        "audio", "magnetic_field", "atmosphere", "gui", "physics", "scene", "light", "actor", "road",
        "spherical_coordinates", "wind",
    ),
    "model": ("self_collide", "allow_auto_disable", "enable_wind", "gripper", "drake:collision_filter_group"),
    "link": (*_SHAPES, "self_collide", "must_be_base_link", "particle_emitter"),
    "inertial": ("density", "auto_inertia_params"),
    "joint": ("physics", "sensor", "drake:controller_gains"),
    "axis": ("initial_position",),
    "axis2": ("initial_position",),
    "limit": ("stiffness", "dissipation", "drake:acceleration"),
}  # fmt: skip
"""Elements, likewise, that say nothing of the dynamics and are not read."""
SEVERAL = ("link", "joint", "frame", "model", "include", "world", "physics", BALL)  # may be there repeatedly
_MOVING = re.compile(
    r"(::|^)(ApplyJointForce|Joint(Position|Trajectory)?Controller)$"
    r"|(apply-joint-force|joint-((position|trajectory)-)?controller)-system"
)
"""Names and files of Gazebo's plug-ins that act on joints as motors."""
_VERSIONS = (1, 4), (1, 12)  # the first and the last that is read
_UNIT = 1e-3  # how far the length of a quaternion may be from 1


class SdfText(XmlReader):
    """One file of SDF: its elements, and errors about them."""

    text_of = None

    def __init__(self, text: str, source: str, above: SdfText | None = None) -> None:
        super().__init__(source)
        self.above = above  # the file that includes it
        self.root = self.parse(text)
        if self.root.tag != "sdf":
            self.bad(self.root, f"expected the element <sdf>, got <{self.root.tag}>")
        words = (self.root.get("version") or "").split(".")
        self.version = tuple(
            int(word) for word in words if word.isascii() and word.isdigit() and len(word) < 4
        )
        if len(words) != len(self.version) or not _VERSIONS[0] <= self.version[:2] <= _VERSIONS[1]:
            self.bad(self.root, f"version: expected 1.4 to 1.12, got {shown(self.root.get('version'))}")

    def bad(self, element: Xml.Element, message: str) -> NoReturn:
        """Raise ModelError about an element."""
        name = element.get("name")
        called = f"<{element.tag:.80}{f' name={shown(name)}' if name else ''}>"
        self.fail(f"{called}: {message}", self.line_of(element))

    def number(self, parent: Xml.Element | None, tag: str, default: float, infinite: bool = False) -> float:
        """Return the number in an element."""
        element = None if parent is None else first(parent, tag)
        return default if element is None else float(self.numbers(element, 1, infinite)[0])

    def numbers(self, element: Xml.Element, count: int, infinite: bool = False) -> FloatArray:
        """Return the numbers in an element."""
        text = element.text or ""
        values = [number_of(word) for word in text.split()]
        good = all(math.isfinite(x) and abs(x) < LARGEST for x in values)
        if len(values) != count or not (good or (infinite and not math.isnan(values[0]))):
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            self.bad(element, f"expected {wanted}, got {shown(text.strip())}")
        return np.array(values)

    def flag(self, element: Xml.Element, text: str | None) -> bool:
        """Return what a text says, which is true or false."""
        word = (text or "").strip().lower()
        if word not in ("true", "1", "false", "0"):
            self.bad(element, f"expected true or false, got {shown((text or '').strip())}")
        return word in ("true", "1")

    def is_set(self, parent: Xml.Element, tag: str, default: bool = False) -> bool:
        """Return what an element says, which is true or false."""
        element = parent.find(tag)
        return default if element is None else self.flag(element, element.text)

    def word(self, parent: Xml.Element, tag: str) -> str:
        """Return the text of an element, which must be there."""
        element = first(parent, tag)
        text = "" if element is None else (element.text or "").strip()
        if not text:
            self.bad(parent, f"expected the element <{tag}> with a text in it")
        return text

    def placement(self, element: Xml.Element | None) -> pin.SE3:
        """Return the placement that a pose is, in the axes that it is relative to."""
        if element is None:
            return pin.SE3.Identity()
        degrees = self.flag(element, element.get("degrees", "false"))
        kind = element.get("rotation_format", "euler_rpy")
        if kind not in ("euler_rpy", "quat_xyzw") or (degrees and kind != "euler_rpy"):
            self.bad(element, "rotation_format: expected euler_rpy, or quat_xyzw without degrees")
        if not (element.text or "").strip():
            return pin.SE3.Identity()
        values = self.numbers(element, 6 if kind == "euler_rpy" else 7)
        if kind == "euler_rpy":
            angles = np.radians(values[3:]) if degrees else values[3:]
            return pin.SE3(pin.rpy.rpyToMatrix(*angles), values[:3])
        length = float(np.linalg.norm(values[3:]))
        if not abs(length - 1) < _UNIT:
            self.bad(element, f"expected a quaternion of length 1, got {length:g}")
        return pin.SE3(pin.Quaternion(values[3:] / length).matrix(), values[:3])


def first(parent: Xml.Element, tag: str) -> Xml.Element | None:
    """Return the first part of a name, which may have a prefix."""
    return next((part for part in parent if part.tag == tag), None)


POSE_FRAMES = (1, 7)  # the first version with frames of poses and one scope of names
_MAX_FRAMES = 10_000  # Pinocchio compares each with all others
_MAX_INCLUDES = 200  # most files of a robot


@dataclass(eq=False)
class Item:
    """What has a name: a link, a joint, a frame or a model."""

    kind: str
    name: str
    scope: Scope  # where it has its name
    file: SdfText
    element: Xml.Element
    pose: Xml.Element | None = None
    relative: str = ""  # what its pose is relative to
    poser: SdfText | None = None  # the file that the pose is in
    inner: Scope | None = None  # what is in a model

    @property
    def full(self) -> str:
        """Its name with those of the models that it is in."""
        return self.scope.path + self.name


@dataclass(eq=False)
class Scope:
    """A world or a model."""

    item: Item | None = None  # the model; None for the world
    static: bool = False  # nothing in it moves
    placement_frame: str = ""  # which frame of a model its pose places
    depth: int = 0
    bare: bool = False  # whether names in it go without its own
    items: dict[str, list[Item]] = field(default_factory=dict)
    """By name; before version 1.7 a link and a joint may have the same."""

    @property
    def path(self) -> str:
        """What is before its names, such as ``model::``."""
        parts, scope = list[str](), self
        while scope.item is not None and not scope.bare:
            parts.append(f"{scope.item.name}::")
            scope = scope.item.scope
        return "".join(reversed(parts))

    @property
    def own(self) -> str:
        """The name of its own frame."""
        return "world" if self.item is None else "__model__"

    def of(self, kind: str) -> list[Item]:
        """Return what is of a kind."""
        return [item for items in self.items.values() for item in items if item.kind == kind]

    def find(self, name: str, kind: str = "") -> Item | None:
        """Return what has a name, if possible of a kind."""
        found = self.items.get(name, ())
        return min(found, key=lambda item: (item.kind != kind, item.kind != "link"), default=None)


class SdfRobot:
    """A robot's files, in which all names and placements are known."""

    def __init__(
        self, source: str | os.PathLike[str], include_root: str | os.PathLike[str] | None = None
    ) -> None:
        allowed = folder_below_which(include_root)
        text, self.source = read_xml(source, "SDF")
        self.files = [SdfText(text, self.source)]
        self.unknown: list[tuple[SdfText, Xml.Element, str]] = []  # elements, and what they are in
        self.world = Scope()
        self.links: list[Item] = []
        self.joints: list[Item] = []
        self.frames: list[Item] = []
        self._items: list[Item] = []
        own = None if is_text(source) else Path(source).resolve().parent
        self._folder, self._where = (
            allowed or own,
            "include_root" if allowed else "the folder of the first one",
        )
        self.gravity = self._fill_world(self.files[0])
        self.model = self._chosen()
        self._bodies: dict[Item, Item | None] = {}
        self._places = self._resolved()

    def _fill_world(self, file: SdfText) -> FloatArray | None:
        """Enter all models; return the gravity, if the file says one."""
        self._look(file, file.root, "sdf")
        worlds, models = file.root.findall("world"), file.root.findall("model")
        if len(worlds) > 1 or bool(worlds) == bool(models):
            file.bad(file.root, f"expected models or one world, got {len(models)} and {len(worlds)}")
        for model in models:
            self._enter(self.world, model, file)
        for world in worlds:
            self._fill(self.world, world, file)
            for place in (world, world.find("physics")):
                gravity = None if place is None else place.find("gravity")
                if gravity is not None:
                    return file.numbers(gravity, 3)
        return None

    def _chosen(self) -> Item:
        """Return the model that the robot is; its name is left out of the names in it."""
        models = self.world.of("model")
        moving = [model for model in models if model.inner is not None and not model.inner.static]
        if len(moving) > 1 or not models:
            got = ", ".join(shown(model.name) for model in moving[:5])
            self.files[0].bad(self.files[0].root, f"expected one model that moves, got {got or 'none'}")
        chosen = (moving or models)[0]
        assert chosen.inner is not None  # noqa: S101 - it is a model
        chosen.inner.bare = True
        if not self.links:
            chosen.file.bad(chosen.element, "the robot has no links")
        return chosen

    def all_models(self) -> list[Item]:
        """Return the models, nested ones too."""
        return [item for item in self._items if item.kind == "model"]

    def driven(self) -> list[str]:
        """Return the full names of joints that plug-ins of Gazebo move, in their order."""
        found = []
        for model in self.all_models():
            assert model.inner is not None  # noqa: S101 - a model
            for plugin in model.element.findall("plugin"):
                if _MOVING.search(plugin.get("name", "")) or _MOVING.search(plugin.get("filename", "")):
                    names = [(one.text or "").strip() for one in plugin.findall("joint_name")]
                    found += [model.inner.path + name for name in names]
        return list(dict.fromkeys(found))

    def _look(self, file: SdfText, element: Xml.Element, tag: str) -> None:
        """Note what is unknown in an element, and refuse what is there twice."""
        seen = set()
        for part in element:
            if part.tag in READ.get(tag, ()):
                if part.tag in seen and part.tag not in SEVERAL:
                    file.bad(part, f"it is given twice in <{element.tag}>")
                seen.add(part.tag)
                if part.tag not in ("model", "world", "physics"):  # a model is looked at as a scope
                    self._look(file, part, str(part.tag))
            elif part.tag != "plugin" and part.tag not in IDLE.get(tag, ()):
                self.unknown.append((file, part, tag))

    def _fill(self, scope: Scope, element: Xml.Element, file: SdfText) -> None:
        """Enter all that has a name in a scope."""
        self._look(file, element, str(element.tag))
        for part in element:
            if part.tag in ("link", "joint", "frame", "model"):
                self._enter(scope, part, file)
            elif part.tag == "include":
                self._include(scope, part, file)

    def _enter(self, scope: Scope, element: Xml.Element, file: SdfText, name: str | None = None) -> Item:
        """Enter a link, joint, frame or model."""
        kind, pose = str(element.tag), element.find("pose")
        item = Item(kind, element.get("name") or "" if name is None else name, scope, file, element, pose)
        item.relative = relative_to(file, pose)
        if not item.relative and kind == "frame":
            item.relative = element.get("attached_to", "")
        if not item.relative and kind == "joint":
            item.relative = file.word(element, "child")
        others = scope.items.setdefault(item.name, [])
        if others and (file.version >= POSE_FRAMES or any(one.kind == kind for one in others)):
            file.bad(element, f"the name {shown(item.name)} is there twice")
        _check_name(item)
        others.append(item)
        self._items.append(item)
        lists = {"link": self.links, "joint": self.joints, "frame": self.frames}
        if kind in lists:
            lists[kind].append(item)
            most = _MAX_FRAMES if kind == "frame" else MAX_LINKS
            if len(lists[kind]) > most:
                file.bad(element, f"expected at most {most} {kind}s")
            return item
        if scope.depth == MAX_DEPTH:
            file.bad(element, f"expected models nested at most {MAX_DEPTH} deep")
        static = scope.static or file.is_set(element, "static")
        item.inner = Scope(item, static, element.get("placement_frame", ""), scope.depth + 1)
        if name is None:
            self._fill(item.inner, element, file)
        return item

    def _include(self, scope: Scope, element: Xml.Element, file: SdfText) -> None:
        """Enter the model of another file."""
        if file.flag(element, element.get("merge", "false")):
            file.bad(element, "merge: it is not read; nest the model")
        path = self._included(element, file)
        text, name = read_xml(path, "SDF")
        inner = SdfText(text, name, file)
        self.files.append(inner)
        self._look(inner, inner.root, "sdf")
        models = inner.root.findall("model")
        if len(models) != 1 or inner.root.find("world") is not None:
            file.bad(element, f"expected a file with one model, got {len(models)}")
        called = element.find("name")
        item = self._enter(
            scope,
            models[0],
            inner,
            models[0].get("name", "") if called is None else (called.text or "").strip(),
        )
        assert item.inner is not None  # noqa: S101 - it is a model
        pose, placed = element.find("pose"), element.find("placement_frame")
        if pose is not None:
            item.pose, item.relative, item.poser = pose, relative_to(file, pose), file
        if placed is not None:
            if pose is None:
                file.bad(element, "a <placement_frame> needs a <pose>")
            item.inner.placement_frame = (placed.text or "").strip()
        if (flag := element.find("static")) is not None:
            item.inner.static = scope.static or file.flag(flag, flag.text)
        self._fill(item.inner, models[0], inner)

    def _included(self, element: Xml.Element, file: SdfText) -> Path:
        """Return the file that an element includes: one below the folder of the first file, or the user's."""
        uri, root = file.word(element, "uri"), self._folder
        if root is None:
            file.bad(element, "it needs the files beside it: give the path of the file")
        if len(self.files) > _MAX_INCLUDES:
            file.bad(element, f"expected at most {_MAX_INCLUDES} files")
        scheme, _, rest = uri.rpartition("://")
        if scheme not in ("", "model", "file"):
            file.bad(element, f"uri: expected a path or model://, got {shown(uri)}")
        folder = root if scheme == "model" else Path(file.source).resolve().parent
        try:
            path = (folder / rest).resolve()
            if path.is_relative_to(root) and path.is_dir():
                path = _file_of_folder(path).resolve()
            if not path.is_relative_to(root) or not path.is_file():
                file.bad(
                    element,
                    f"uri: {shown(uri)} is no file below {self._where} (include_root=FOLDER names another)",
                )
        except (OSError, ValueError) as error:
            file.bad(element, f"uri: {one_line(str(error))}")
        above: SdfText | None = file
        while above is not None:
            if Path(above.source).resolve() == path:
                file.bad(element, f"uri: {shown(uri)} includes itself")
            above = above.above
        return path

    # -- Names and placements ------------------------------------------------------------------------------

    def way(self, scope: Scope, name: str, at: tuple[SdfText, Xml.Element], kind: str = "") -> list[Item]:
        """Return what a name means, behind the models that it is in; empty for the scope itself."""
        way: list[Item] = []
        rest = name
        while rest != scope.own:
            item = scope.find(rest, kind)
            if item is not None:
                return [*way, item]
            head, _, rest = rest.partition("::")
            item = scope.find(head, "model")
            if item is None or item.inner is None or not rest:
                file, element = at
                file.bad(element, f"the frame {shown(name)} does not exist; {suggestion(name, scope.items)}")
            way.append(item)
            scope = item.inner
        return way

    def _resolved(self) -> dict[Item, pin.SE3]:
        """Return where everything is, in the axes of its scope."""
        ways = {item: self._ways(item) for item in self._items}
        needs = {item: {one for way in found for one in way} for item, found in ways.items()}
        try:
            order = list(TopologicalSorter(needs).static_order())
        except CycleError as error:
            ring = " -> ".join(shown(item.name) for item in error.args[1][:5])
            item = error.args[1][0]
            item.file.bad(item.element, f"its pose is relative to itself: {ring}")
        found: dict[Item, pin.SE3] = {}
        for item in order:
            start, *frame = (_along(found, way) for way in ways[item])
            here = start * (item.poser or item.file).placement(item.pose)
            found[item] = here * frame[0].inverse() if frame else here
        return found

    def _ways(self, item: Item) -> list[list[Item]]:
        """Return the way to what a pose is relative to, and that to a placement frame."""
        at, inner = (item.file, item.element), item.inner
        ways = [self.way(item.scope, item.relative or item.scope.own, at)]
        if inner is not None and inner.placement_frame:
            ways.append(self.way(inner, inner.placement_frame, at))
        return ways

    def place(self, scope: Scope, name: str, at: tuple[SdfText, Xml.Element]) -> pin.SE3:
        """Return where what a name means is, in the axes of the world."""
        place = _along(self._places, self.way(scope, name, at))
        while scope.item is not None:
            place, scope = self._places[scope.item] * place, scope.item.scope
        return place

    def place_of(self, item: Item) -> pin.SE3:
        """Return where something is, in the axes of the world."""
        return self.place(item.scope, item.scope.own, (item.file, item.element)) * self._places[item]

    def link(self, scope: Scope, name: str, at: tuple[SdfText, Xml.Element]) -> Item | None:
        """Return the link that what a name means moves with; None for the world."""
        way = self.way(scope, name, at)
        item = way[-1] if way else scope.item
        trail: list[Item] = []
        while item is not None and item.kind != "link" and item not in self._bodies:
            if len(trail) > len(self._items):
                item.file.bad(item.element, "it is attached to itself")
            trail.append(item)
            item = self._next(item)
        found = self._bodies.get(item, item) if item is not None else None
        self._bodies.update(dict.fromkeys(trail, found))
        return found

    def _next(self, item: Item) -> Item | None:
        """Return what a frame, a joint or a model is attached to."""
        at = item.file, item.element
        if item.inner is not None:
            if chosen := item.element.get("canonical_link"):
                return (self.way(item.inner, chosen, at) or [item])[-1]
            inside = item.inner.of("link") or item.inner.of("model")
            if not inside:
                item.file.bad(item.element, "expected a link in the model, its frame moves with one")
            return inside[0]
        name = (
            item.element.get("attached_to", "")
            if item.kind == "frame"
            else item.file.word(item.element, "child")
        )
        way = self.way(item.scope, name or item.scope.own, at)
        return way[-1] if way else item.scope.item


def _along(places: Mapping[Item, pin.SE3], way: list[Item]) -> pin.SE3:
    """Return the product of the placements on a way."""
    place = pin.SE3.Identity()
    for item in way:
        place = place * places[item]
    return place


def relative_to(file: SdfText, pose: Xml.Element | None) -> str:
    """Return what a pose says that it is relative to."""
    if pose is None:
        return ""
    old = pose.get("frame", "")
    if old and file.version >= POSE_FRAMES:
        file.bad(pose, "frame: since version 1.7 it is relative_to")
    return pose.get("relative_to") or old


def _check_name(item: Item) -> None:
    file, element, name = item.file, item.element, item.name
    if not name:
        file.bad(element, "expected a name")
    if name == "world" or (name.startswith("__") and name.endswith("__")):
        file.bad(element, f"the name {shown(name)} is reserved")
    if "::" in name and file.version >= POSE_FRAMES:
        file.bad(element, f"the name {shown(name)} has :: in it, which is between a model and its parts")


def _file_of_folder(folder: Path) -> Path:
    """Return the file of a model's folder: that of the newest version in its ``model.config``."""
    if not (folder / "model.config").is_file():
        return folder / "model.sdf"
    text, name = read_xml(folder / "model.config", "SDF")
    reader = XmlReader(name)
    reader.text_of = None
    found = reader.parse(text).findall("sdf")
    newest = max(
        found, key=lambda one: [number_of(word) for word in one.get("version", "0").split(".")], default=None
    )
    return folder / ("model.sdf" if newest is None else (newest.text or "").strip())


def table() -> str:
    """Return the elements that are read, and those without effect, in Markdown."""
    rows = ["| In | Elements that are read | Elements without effect on the dynamics |", "|---|---|---|"]
    for within in dict.fromkeys((*READ, *IDLE)):
        parts = (", ".join(f"`{name}`" for name in known.get(within, ())) for known in (READ, IDLE))
        rows.append(f"| `{within}` | {' | '.join(parts)} |")
    return "\n".join(rows) + "\n"
