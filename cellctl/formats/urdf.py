"""URDF in and out: its XML, and the serial chain of moving joints from root to tip. m, rad → mm, deg, and back."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn, final
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.files.kinds import read_bytes
from cellctl.formats.description import DECIMALS_MM, JointSaid, RobotDescription, plain_number
from cellctl.kinematics import Floats, JointAxis, SerialChain, abc_from_rotation, inverse_pose, pose_from_xyz_abc

LARGEST_BYTES = 20_000_000


@final
@dataclass(frozen=True, slots=True)
class Element:
    """An element: its name, attributes, children in order, and the line (from 1) and byte (from 0) of its first `<`."""

    tag: str
    attributes: dict[str, str]
    line: int
    start: int = 0
    children: list[Element] = field(default_factory=list)

    def each(self, tag: str) -> Iterator[Element]:
        """The children of this name."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """The first child of this name."""
        return next(self.each(tag), None)


def load_xml(path: Path) -> Element:
    """The root element of a file. Raises InputError where it cannot be read, is no XML, or declares a DTD."""
    data = read_bytes(path)
    if len(data) > LARGEST_BYTES:
        raise InputError(Problem(str(path), 0, 0, f"is too large ({len(data)} bytes)", "meshes belong in other files"))
    return parse_xml(data, str(path))


def parse_xml(data: bytes, file: str) -> Element:
    """The root element of `data`; `file` names it in errors. Raises InputError."""
    builder = _Builder(file)
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        what, cure = _words(error, builder.open_element)
        raise InputError(Problem(file, error.lineno, error.offset + 1, what, cure)) from error
    except (LookupError, ValueError) as error:  # an unknown encoding
        what = "is not XML: its first line names an encoding that is not known"
        raise InputError(Problem(file, 1, 0, what, "save the file as UTF-8")) from error
    return builder.root.children[0]


_WORDS = {
    expat.errors.XML_ERROR_INVALID_TOKEN: (
        "a character that cannot stand here",
        "in text write &amp; for & and &lt; for <",
    ),
    expat.errors.XML_ERROR_UNCLOSED_TOKEN: ("a tag is not closed", "end it with >, and close its quotes"),
    expat.errors.XML_ERROR_DUPLICATE_ATTRIBUTE: ("an attribute stands twice in one tag", "remove one of them"),
    expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT: ("something follows the end of the document", "remove it"),
    expat.errors.XML_ERROR_UNDEFINED_ENTITY: ("an entity (&…;) that is not defined", "write the character itself"),
    expat.errors.XML_ERROR_MISPLACED_XML_PI: (
        "<?xml …?> is not at the beginning of the file",
        "remove what is before it",
    ),
}
"""By the name of expat's error: what is wrong, and the cure."""


def _words(error: expat.ExpatError, unclosed: Element | None) -> tuple[str, str]:
    """What is wrong, and the cure; `unclosed`: the innermost element that is open at the error."""
    kind = expat.errors.messages[error.code]
    if unclosed and kind in (expat.errors.XML_ERROR_TAG_MISMATCH, expat.errors.XML_ERROR_NO_ELEMENTS):
        what = f"<{unclosed.tag}> of line {unclosed.line} is not closed before this place"
        return f"is not XML here: {what}", f"add </{unclosed.tag}>, or mend the closing tag"
    what, cure = _WORDS.get(kind, ("there is no element that could be read", "check the tags and quotes"))
    return f"is not XML here: {what}", cure


class _Builder:
    def __init__(self, file: str) -> None:
        self.file = file
        self.root = Element("", {}, 0)
        self._open = [self.root]
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype

    @property
    def open_element(self) -> Element | None:
        """The innermost element that is not closed yet."""
        return self._open[-1] if len(self._open) > 1 else None

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, self.parser.CurrentLineNumber, self.parser.CurrentByteIndex)
        self._open[-1].children.append(element)
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _doctype(self, *_: object) -> NoReturn:
        what = "declares a document type (DOCTYPE); entities are not read"
        raise InputError(Problem(self.file, self.parser.CurrentLineNumber, 0, what, "remove the declaration"))


BASE_LINK, FLANGE_LINK = "base_link", "tool0"
"""ROS-Industrial's names of the robot's base, and of the flange with z outwards."""
LARGEST = 1e5
"""A number beyond this, in m or rad, cannot be a robot's."""
_MOVING = ("revolute", "continuous", "prismatic")


@final
@dataclass(frozen=True, slots=True)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    element: Element


@final
@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint of a chain: origin (4, 4), mm, in the parent link; axis (3,), unit vector in its own frame.

    stated: its limits as in the file. Of a fixed joint, axis and limits are None.
    """

    name: str
    child: str
    element: Element
    origin: Floats
    axis: Floats | None
    stated: JointSaid | None


@final
@dataclass(frozen=True, eq=False)
class UrdfChain:
    """A URDF's name and its joints from the root link to the tip."""

    name: str
    joints: tuple[UrdfJoint, ...]


def load_urdf(path: Path, tip: str | None = None) -> RobotDescription:
    """The robot whose joints lead from the root link to link `tip`, which may be left out where there is only one.

    A joint's reading is its URDF position, in degrees or mm. The base is `base_link` and the flange `tool0`, where
    these lie before the first and behind the last moving joint; else the root and the tip. Raises InputError as
    `load_chain`.
    """
    return _described(load_chain(path, tip))


def load_chain(path: Path, tip: str | None = None) -> UrdfChain:
    """The joints from the root link to link `tip`, which may be left out where there is only one.

    Raises InputError, each error with its line: no URDF, branches and no tip named, joints of other types (floating,
    planar) or that follow others, closed loops.
    """
    root = load_xml(path)
    file = _File(str(path))
    if root.tag != "robot":
        raise InputError(file.problem(root, f"is no URDF: its root is <{root.tag}>, not <robot>"))
    if any(name.startswith("xmlns:xacro") for name in root.attributes):
        raise InputError(file.problem(root, "is a xacro file", "expand it: xacro robot.urdf.xacro > robot.urdf"))
    joints = _path(file, root, tip)
    file.stop()
    chain = UrdfChain(root.attributes.get("name") or path.stem, tuple(_placed(file, joint) for joint in joints))
    file.stop()
    return chain


@final
class _File:
    """A file, with its errors collected."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.problems: list[Problem] = []

    def problem(self, at: Element, what: str, cure: str = "") -> Problem:
        return Problem(self.name, at.line, 0, what, cure)

    def note(self, at: Element, what: str, cure: str = "") -> None:
        self.problems.append(self.problem(at, what, cure))

    def stop(self) -> None:
        if self.problems:
            raise InputError(self.problems)

    def numbers(self, at: Element | None, name: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """An attribute's numbers, as many as `default` has; `default` where it is absent, or wrong and noted."""
        text = None if at is None else at.attributes.get(name)
        if at is None or text is None:
            return default
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        if len(values) != len(default) or not all(abs(value) <= LARGEST for value in values) or "_" in text:
            count = "a number" if len(default) == 1 else f"{len(default)} numbers"
            self.note(at, f'<{at.tag}> {name}="{text[:40]}" is not {count}')
            return default
        return values


def _path(file: _File, root: Element, tip: str | None) -> list[_Joint]:
    """The joints from the root link to `tip`, in order."""
    joints = [joint for element in root.each("joint") if (joint := _read_joint(file, element))]
    above: dict[str, _Joint] = {}
    for joint in joints:
        if joint.child in above:
            what = f"link '{joint.child}' hangs on two joints, '{above[joint.child].name}' and '{joint.name}'"
            file.note(joint.element, what, "closed loops cannot be calibrated here")
        above[joint.child] = joint
    file.stop()
    found = _tip(file, root, joints, tip)
    path: list[_Joint] = []
    while found in above:
        path.insert(0, above[found])
        found = path[0].parent
        if len(path) > len(joints):
            raise InputError(file.problem(path[0].element, "its joints lead round in a circle"))
    _check_kinds(file, root, path)
    return path


def _read_joint(file: _File, element: Element) -> _Joint | None:
    parent, child = element.first("parent"), element.first("child")
    ends = [end.attributes.get("link") if end is not None else None for end in (parent, child)]
    name = element.attributes.get("name", "")
    if ends[0] is None or ends[1] is None:
        file.note(element, f"joint '{name}' has no <parent link=…> or no <child link=…>")
        return None
    return _Joint(name, element.attributes.get("type", ""), ends[0], ends[1], element)


def _tip(file: _File, root: Element, joints: list[_Joint], tip: str | None) -> str:
    parents, children = {joint.parent for joint in joints}, [joint.child for joint in joints]
    if tip is not None:
        if tip in children:
            return tip
        what = f"has no link '{tip}' at the end of a joint"
        raise InputError(file.problem(root, what, f"its links: {', '.join(children)}"))
    leaves = [child for child in children if child not in parents]
    if len(leaves) == 1:
        return leaves[0]
    if not leaves:
        raise InputError(file.problem(root, "its joints lead round in a circle" if joints else "has no joint"))
    what = f"its links branch: {len(leaves)} of them are the end of a chain"
    raise InputError(file.problem(root, what, f"name one with --tip: {', '.join(leaves)}"))


def _check_kinds(file: _File, root: Element, path: list[_Joint]) -> None:
    for joint in path:
        if joint.kind not in (*_MOVING, "fixed"):
            what = f"joint '{joint.name}' is {joint.kind or 'of no type'}"
            file.note(joint.element, what, "only revolute, continuous and prismatic joints can be calibrated here")
        if joint.element.first("mimic") is not None:
            file.note(joint.element, f"joint '{joint.name}' follows another (mimic)", "it has no reading of its own")
    if not any(joint.kind in _MOVING for joint in path):
        file.note(root, "no joint moves between the root link and the tip")


def _placed(file: _File, joint: _Joint) -> UrdfJoint:
    moves = joint.kind in _MOVING
    along = np.array(_axis(file, joint))
    axis = along / np.linalg.norm(along) if moves else None
    stated = _said(file, joint) if moves else None
    return UrdfJoint(joint.name, joint.child, joint.element, _origin(file, joint.element), axis, stated)


def _described(chain: UrdfChain) -> RobotDescription:
    here, axes, joints = np.eye(4), [], []
    base, flange = here, None
    for joint in chain.joints:
        here = here @ joint.origin
        if joint.axis is not None and joint.stated is not None:
            axes.append((here[:3, 3], here[:3, :3] @ joint.axis))
            joints.append(joint.stated)
            flange = None
        elif joint.child == BASE_LINK and not axes:
            base = here
        elif joint.child == FLANGE_LINK:
            flange = here
    into, flange = inverse_pose(base), here if flange is None else flange
    lines = [
        JointAxis.through(into[:3, :3] @ point + into[:3, 3], into[:3, :3] @ along, prismatic=joint.prismatic)
        for (point, along), joint in zip(axes, joints, strict=True)
    ]
    placed = SerialChain.from_axes(lines, into @ flange, base, inverse_pose(flange) @ here)
    return RobotDescription(chain.name, placed, tuple(joints))


def _origin(file: _File, joint: Element) -> Floats:
    """From the parent link's frame to the joint's (4, 4), mm."""
    origin = joint.first("origin")
    xyz = file.numbers(origin, "xyz", (0.0, 0.0, 0.0))
    roll, pitch, yaw = file.numbers(origin, "rpy", (0.0, 0.0, 0.0))
    return pose_from_xyz_abc(1000.0 * np.array(xyz), np.degrees([yaw, pitch, roll]))


def _axis(file: _File, joint: _Joint) -> tuple[float, ...]:
    element = joint.element.first("axis")
    axis = file.numbers(element, "xyz", (1.0, 0.0, 0.0))
    if not any(axis):
        file.note(element or joint.element, f"joint '{joint.name}': its axis has no direction")
        return (1.0, 0.0, 0.0)
    return axis


def _said(file: _File, joint: _Joint) -> JointSaid:
    """Limits and speed in degrees, of a prismatic joint in mm; of a continuous joint one turn either way. A speed of 0
    means unknown.
    """
    limit, prismatic = joint.element.first("limit"), joint.kind == "prismatic"
    values = (file.numbers(limit, name, (math.nan,))[0] for name in ("lower", "upper", "velocity"))
    lower, upper, speed = (1000.0 * value if prismatic else math.degrees(value) for value in values)
    if joint.kind == "continuous":
        lower, upper = -360.0, 360.0
    elif limit is not None:  # the format's default is 0
        lower, upper = (0.0 if math.isnan(value) else value for value in (lower, upper))
    known = [None if math.isnan(value) else value for value in (lower, upper)]
    return JointSaid(1, 0.0, known[0], known[1], speed if speed > 0.0 else None, joint.name, prismatic)


DECIMALS_RAD = 15


def urdf_text(robot: RobotDescription) -> str:
    """The robot as URDF: from `world` (where the base is not its origin) over `base_link`, `link_1` … `link_n` and the
    flange `tool0` to `tcp` (where there is a tool). Joints without limits become continuous. No masses, no shapes.
    """
    chain = robot.chain.with_base(np.eye(4))
    frames = chain.frames(robot.joint_map().model(np.zeros(chain.n)))
    steps = [
        frames[0],
        *(inverse_pose(before) @ behind for before, behind in itertools.pairwise(frames)),
    ]
    links = [BASE_LINK, *(f"link_{index}" for index in range(1, chain.n + 1)), FLANGE_LINK]
    joints = [
        _joint_text(joint.name or f"joint_{index + 1}", _kind(joint), links[index : index + 2], step, _moves(joint))
        for index, (joint, step) in enumerate(zip(robot.joints, steps[:-1], strict=True))
    ]
    joints.append(_joint_text("-".join(links[-2:]), "fixed", links[-2:], steps[-1]))
    if not np.array_equal(robot.chain.base, np.eye(4)):
        links.insert(0, "world")
        joints.insert(0, _joint_text("-".join(links[:2]), "fixed", links[:2], robot.chain.base))
    if not np.array_equal(robot.chain.tool, np.eye(4)):
        links.append("tcp")
        joints.append(_joint_text("-".join(links[-2:]), "fixed", links[-2:], robot.chain.tool))
    body = [*(f'  <link name="{link}"/>' for link in links), *joints]
    head = ['<?xml version="1.0" encoding="UTF-8"?>', f"<robot name={quoteattr(robot.name)}>"]
    return "".join(f"{line}\n" for line in [*head, *body, "</robot>"])


def origin_words(step: Floats) -> tuple[list[str], list[str]]:
    """A pose (4, 4), mm, as an `<origin>` has it: x, y, z in m; roll, pitch, yaw (R = Rz Ry Rx) in rad."""
    xyz = [_metres(value) for value in step[:3, 3].tolist()]
    return xyz, [_radians(value) for value in reversed(abc_from_rotation(step[:3, :3]).tolist())]


def _joint_text(name: str, kind: str, links: list[str], step: Floats, more: tuple[str, ...] = ()) -> str:
    xyz, rpy = origin_words(step)
    return "\n".join(
        [
            f'  <joint name={quoteattr(name)} type="{kind}">',
            f'    <parent link="{links[0]}"/>',
            f'    <child link="{links[1]}"/>',
            f'    <origin xyz="{" ".join(xyz)}" rpy="{" ".join(rpy)}"/>',
            *(f"    {line}" for line in more),
            "  </joint>",
        ]
    )


def _kind(joint: JointSaid) -> str:
    if joint.prismatic:
        return "prismatic"
    return "continuous" if joint.min is None or joint.max is None else "revolute"


def _moves(joint: JointSaid) -> tuple[str, ...]:
    """The axis, in the reading's sense, and limits. The effort is unknown: 0."""
    axis = f'<axis xyz="0 0 {joint.sign}"/>'
    words = _metres if joint.prismatic else _radians
    ends = "" if joint.min is None or joint.max is None else f'lower="{words(joint.min)}" upper="{words(joint.max)}" '
    if not ends and joint.max_speed is None:
        return (axis,)
    return (axis, f'<limit {ends}effort="0" velocity="{words(joint.max_speed or 0.0)}"/>')


def _metres(value_mm: float) -> str:
    return plain_number(float(plain_number(value_mm, DECIMALS_MM)) / 1000.0, DECIMALS_MM + 3)


def _radians(degrees: float) -> str:
    return plain_number(math.radians(degrees), DECIMALS_RAD)
