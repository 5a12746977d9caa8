"""DH tables as CSV: a row for each joint, mm and degrees; rows `base` and `tool` where these are not zero."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, final

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats.dataset import DataSet, text_of
from cellctl.formats.description import DECIMALS_DEG, DECIMALS_MM, JointSaid, RobotDescription
from cellctl.kinematics import (
    Floats,
    Link,
    LinkTable,
    SerialChain,
    TableConvention,
    abc_from_rotation,
    pose_from_xyz_abc,
    to_craig,
    to_mdh,
)
from cellctl.robot_file import looks_like_radians, parallel_to_neighbour

CONVENTIONS = ("mdh-hayati", "dh-craig")
_LINK = ("theta", "d", "a", "alpha")
_FRAME = ("X", "Y", "Z", "A", "B", "C")
_LARGEST = {
    **dict.fromkeys(("theta", "alpha", "beta", "A", "B", "C"), 360.0),
    **dict.fromkeys(("d", "a", "X", "Y", "Z"), 20_000.0),
}
"""mm and degrees, as in a robot file."""
_LARGEST_OFFSET_DEG = 360.0
_JOINT = ("sign", "offset", "min", "max", "max_speed")


def load_dh_table(path: Path, convention: str | None = None) -> RobotDescription:
    """The robot of a table with columns theta, d, a, alpha.

    Optional: beta, type (revolute, prismatic), sign, offset, min, max, max_speed; convention (else `convention` holds);
    joint: 1 … n, base, tool; X, Y, Z, A, B, C of the rows base and tool. A row without beta whose axes are parallel
    gets β = 0 besides its d.
    Raises InputError with every cell that is wrong, by line.
    """
    table = _Table(DataSet.load(path))
    said = table.convention(convention)
    rows = table.joints()
    joints = tuple(table.joint(row) for row in rows)
    links = [
        replace(table.link(row, said, number, len(rows)), prismatic=joint.prismatic)
        for number, (row, joint) in enumerate(zip(rows, joints, strict=True))
    ]
    base, tool = table.frame("base"), table.frame("tool")
    table.stop()

    return RobotDescription(path.stem, SerialChain.from_links(said, links, base, tool), joints)


def dh_table_text(robot: RobotDescription, convention: TableConvention) -> str:
    """The robot as a table in `convention`, with its joint map and limits; what the table cannot hold is in base and
    tool. Raises InputError where a link is too long to be read back: axes just too far from parallel for β.
    """
    chain = (to_mdh if convention == "mdh-hayati" else to_craig)(robot.chain)
    assert isinstance(chain.table, LinkTable)
    _refuse_long_links(robot.name, chain.table.links)
    with_kinds = any(joint.prismatic for joint in robot.joints)
    rows: list[dict[str, Any]] = [
        {"joint": number, "convention": convention, **_link_cells(link), **_joint_cells(joint, with_kinds)}
        for number, (link, joint) in enumerate(zip(chain.table.links, robot.joints, strict=True), 1)
    ]
    for name, frame in (("base", chain.base), ("tool", chain.tool)):
        if not np.array_equal(frame, np.eye(4)):
            rows.append({"joint": name, "convention": convention, **_frame_cells(frame)})
    return text_of(rows)


def _refuse_long_links(name: str, links: Sequence[Link]) -> None:
    problems = [
        Problem(name, 0, 0, f"link {number} is {longest / 1000.0:.0f} m long in this table", "write urdf or poe")
        for number, longest in enumerate((max(abs(link.a), abs(link.d)) for link in links), 1)
        if longest > _LARGEST["a"]
    ]
    if problems:
        raise InputError(problems)


def _link_cells(link: Link) -> dict[str, float | None]:
    beta = None if link.beta is None else _degrees(link.beta)
    return {
        "theta": _degrees(link.theta),
        "d": round(link.d, DECIMALS_MM) + 0.0,
        "a": round(link.a, DECIMALS_MM) + 0.0,
        "alpha": _degrees(link.alpha),
        "beta": beta,
    }


def _joint_cells(joint: JointSaid, with_kind: bool) -> dict[str, float | int | str | None]:
    kind = {"type": "prismatic" if joint.prismatic else "revolute"} if with_kind else {}
    return {**kind, **{name: getattr(joint, name) for name in _JOINT}}


def _frame_cells(frame: Floats) -> dict[str, float]:
    values = [*frame[:3, 3].tolist(), *abc_from_rotation(frame[:3, :3]).tolist()]
    return {
        name: round(value, DECIMALS_MM if name in "XYZ" else DECIMALS_DEG) + 0.0
        for name, value in zip(_FRAME, values, strict=True)
    }


def _degrees(radians: float) -> float:
    return round(math.degrees(radians), DECIMALS_DEG) + 0.0


@final
class _Table:
    """A table's cells as numbers; errors are collected."""

    def __init__(self, data: DataSet) -> None:
        self.data = data
        self.problems = [Problem(data.file, row.line, 0, row.reason) for row in data.rejected]
        lacking = [name for name in _LINK if not data.has(name)]
        if lacking:
            cure = "theta, d, a, alpha (and beta) in mm and degrees"
            raise InputError(Problem(data.file, 1, 0, f"has no column {', '.join(lacking)}", cure))

    def stop(self) -> None:
        if self.problems:
            raise InputError(self.problems)

    def convention(self, asked: str | None) -> TableConvention:
        """The convention that every row states, or `asked` where none does."""
        said = {text for text in self.data.texts("convention") if text} or {asked or ""}
        match [*said]:
            case ["mdh-hayati" | "dh-craig" as one] if asked in (None, one):
                return one
        if said == {""}:
            what, cure = (
                "does not say how its rows are read",
                f"add a column convention, or --table: {', '.join(CONVENTIONS)}",
            )
        else:
            what, cure = f"its convention is {', '.join(sorted(said))}", f"one of {', '.join(CONVENTIONS)}"
            cure += f", and not another than --table {asked}" if asked else ""
        raise InputError(Problem(self.data.file, 1, 0, what, cure))

    def joints(self) -> list[int]:
        """The rows of the joints, numbered from 1 if they have numbers."""
        names = self.data.texts("joint")
        rows = [row for row, name in enumerate(names) if name not in ("base", "tool")]
        for number, row in enumerate(rows, 1):
            if names[row] not in ("", str(number)):
                self._note(row, f"joint is '{names[row][:20]}', not {number}", "rows in order: 1, 2, …, base, tool")
        if not rows:
            raise InputError(Problem(self.data.file, 0, 0, "holds no joint", "one row for each"))
        return rows

    def link(self, row: int, convention: TableConvention, index: int, n: int) -> Link:
        """The link of a row."""
        theta, d, a, alpha = (self._number(row, name) or 0.0 for name in _LINK)
        beta = self._number(row, "beta", needed=False)
        for name, angle in (("theta", theta), ("alpha", alpha), ("beta", beta)):
            if looks_like_radians(angle):
                self._note(row, f"{name} {angle:g} looks like radians", "write degrees")
        if beta is None and parallel_to_neighbour(convention, alpha, index, n):
            beta = 0.0
        return Link(math.radians(theta), d, a, math.radians(alpha), None if beta is None else math.radians(beta))

    def joint(self, row: int) -> JointSaid:
        """The joint of a row: values missing from the table are None, or reading = model angle."""
        sign, offset, least, most, speed = (self._number(row, name, needed=False) for name in _JOINT)
        if sign not in (None, 1.0, -1.0):
            self._note(row, f"sign {sign:g} is neither 1 nor -1")
        kind = self.data.texts("type")[row]
        if kind not in ("", "revolute", "prismatic"):
            self._note(row, f"type '{kind[:20]}' is neither revolute nor prismatic")
        if kind != "prismatic" and abs(offset or 0.0) > _LARGEST_OFFSET_DEG:
            self._note(row, f"offset {offset:g} is not from -360 to 360", "degrees; mm only with type prismatic")
        return JointSaid(-1 if sign == -1.0 else 1, offset or 0.0, least, most, speed, prismatic=kind == "prismatic")

    def frame(self, name: str) -> Floats | None:
        """The frame of row `name`, or None."""
        rows = [row for row, said in enumerate(self.data.texts("joint")) if said == name]
        for row in rows[1:]:
            self._note(row, f"a second row '{name}'", "remove one of them")
        if not rows:
            return None
        values = [self._number(rows[0], column) or 0.0 for column in _FRAME]
        return pose_from_xyz_abc(values[:3], values[3:])

    def _number(self, row: int, name: str, *, needed: bool = True) -> float | None:
        text = self.data.texts(name)[row]
        if not text:
            if needed:
                self._note(row, f"{name} is missing")
            return None
        try:
            value = float(text if "_" not in text else "text")
        except ValueError:
            value = math.nan
        largest = _LARGEST.get(name, 100_000.0)
        if abs(value) <= largest:
            return value
        self._note(row, f"{name} '{text[:20]}' is not a number from {-largest:g} to {largest:g}")
        return None

    def _note(self, row: int, what: str, cure: str = "") -> None:
        self.problems.append(Problem(self.data.file, self.data.lines[row], 0, what, cure))
