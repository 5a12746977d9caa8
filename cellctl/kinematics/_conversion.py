"""Conversion of a robot between the three forms, which every serial chain has.

The joints' axes at model zero are the same in all forms. What a table cannot hold (the pose of its first frame, and the
rest between its last frame and the tool) goes to base and tool. Deviations become part of the new table, so that an
identified robot converts as a nominal one does; their covariance does not convert.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cellctl.kinematics._chain import SerialChain
from cellctl.kinematics._frames import Floats, inverse_pose
from cellctl.kinematics.geometry import JointAxis, Link, LinkTable, Segment, TableConvention, segment_matrix

PARALLEL = float(np.sin(np.radians(1.0)))
"""Axes with a sine of their angle below this take Hayati's β in place of d."""

_NOWHERE = 1e-10
"""A distance, mm, below which a direction from one point to another is undefined."""


def settled(chain: SerialChain) -> SerialChain:
    """The chain in its own form with its deviations as part of table, base and tool."""
    return _settled(chain, chain.table) if isinstance(chain.table, LinkTable) else to_poe(chain)


def to_poe(chain: SerialChain) -> SerialChain:
    """The chain by its joints' axes; base, flange and tool do not move.

    The point on each axis is the origin of the chain's joint frame.
    """
    frames, home = _at_zero(chain)
    axes = [
        JointAxis.through(frame[:3, 3], frame[:3, 2], prismatic=bool(slides))
        for frame, slides in zip(frames, chain.prismatic, strict=True)
    ]
    return SerialChain.from_axes(axes, home, chain.base_now, chain.tool_now)


def to_mdh(chain: SerialChain) -> SerialChain:
    """The chain as a table T = Rz(θ) Tz(d) Tx(a) Rx(α) Ry(β); β in place of d where axes lie within 1° of parallel.

    Base and tool do not change where base z is joint 1's axis and the flange's x crosses joint n's axis squarely.
    """
    return _as_table(chain, "mdh-hayati")


def to_craig(chain: SerialChain) -> SerialChain:
    """The chain as a table T = Rx(α) Tx(a) Ry(β) Rz(θ) Tz(d); β where axes lie within 1° of parallel.

    Its flange is a frame on joint n's axis, so that the tool holds the robot's flange relative to it.
    """
    return _as_table(chain, "dh-craig")


def _as_table(chain: SerialChain, convention: TableConvention) -> SerialChain:
    if isinstance(chain.table, LinkTable) and chain.table.convention == convention:
        return _settled(chain, chain.table)
    frames, home = _at_zero(chain)
    rows, first = _rows(frames, home, keep_heights=isinstance(chain.table, LinkTable))
    rows = [replace(row, prismatic=bool(slides)) for row, slides in zip(rows, chain.prismatic, strict=True)]
    if convention == "dh-craig":
        rows = _shifted(rows)
    table = SerialChain.from_links(convention, rows, chain.base_now @ first)
    last = first @ table.with_base(np.eye(4)).forward_flange(np.zeros(chain.n))
    return table.with_tool(inverse_pose(last) @ home @ chain.tool_now)


def _settled(chain: SerialChain, table: LinkTable) -> SerialChain:
    deviations = chain.deviations if chain.deviations.size else np.zeros(len(chain.parameters))
    added = {name: float(value) for name, value in zip(chain.parameters, deviations, strict=True)}
    links = [
        Link(
            row.theta + added[f"theta{number}"],
            row.d + added.get(f"d{number}", 0.0),
            row.a + added[f"a{number}"],
            row.alpha + added[f"alpha{number}"],
            None if row.beta is None else row.beta + added[f"beta{number}"],
            row.prismatic,
        )
        for number, row in enumerate(table.links, 1)
    ]
    return SerialChain.from_links(table.convention, links, chain.base_now, chain.tool_now)


def _at_zero(chain: SerialChain) -> tuple[Floats, Floats]:
    """Joint frames (n, 4, 4) and flange (4, 4) at model zero, in the robot's base frame."""
    frames = chain.with_base(np.eye(4)).frames(np.zeros(chain.n))
    return frames[:-1], frames[-1]


def _rows(frames: Floats, home: Floats, *, keep_heights: bool) -> tuple[list[Link], Floats]:
    """Rows of an mdh-hayati table for axes along z of `frames`, and the pose of its first frame (4, 4)."""
    first = here = _first_frame(frames[0])
    rows = []
    for behind in frames[1:]:
        rows.append(_row(inverse_pose(here) @ behind, keep_height=keep_heights))
        here = here @ _row_matrix(rows[-1])
    rows.append(_last_row(inverse_pose(here) @ home))
    return rows, first


def _first_frame(joint: Floats) -> Floats:
    """The frame on joint 1's axis that is nearest to the base frame: the base itself where its z is that axis."""
    along, point = joint[:3, 2], joint[:3, 3]
    return JointAxis.through(point - (point @ along) * along, along).frame()


def _row(behind: Floats, *, keep_height: bool) -> Link:
    """The row that leads from a frame on one axis to one on the next, which is z of `behind` (4, 4) in that frame.

    Of the two senses that x may have, the one nearer to x of `behind`.
    """
    along = behind[:3, 2]
    lean = float(np.hypot(along[0], along[1]))
    if lean < PARALLEL:
        return _parallel_row(behind, float(behind[2, 3]) if keep_height else 0.0)
    x = np.array([-along[1], along[0], 0.0]) / lean
    x = x * _sense(float(x @ behind[:3, 0]), float(x @ behind[:3, 3]))
    y = np.array([-x[1], x[0], 0.0])
    height = behind[2, 3] - along[2] * (y @ behind[:3, 3]) / (y @ along)
    return Link(float(np.arctan2(x[1], x[0])), float(height), float(x @ behind[:3, 3]), _lean(y, along))


def _parallel_row(behind: Floats, height: float) -> Link:
    """Hayati's row: a and θ lead to where the next axis passes through the plane at `height`, α and β tilt onto it."""
    along = behind[:3, 2]
    foot = behind[:2, 3] + along[:2] * (height - behind[2, 3]) / along[2]
    apart = float(np.hypot(foot[0], foot[1]))
    x = np.append(foot / apart if apart > _NOWHERE else _level(behind[:2, 0]), 0.0)
    x = x * _sense(float(x @ behind[:3, 0]), 1.0)
    y = np.array([-x[1], x[0], 0.0])
    beta = float(np.arctan2(x @ along, np.hypot(y @ along, along[2])))
    return Link(float(np.arctan2(x[1], x[0])), height, float(x[:2] @ foot), _lean(y, along), beta)


def _last_row(flange: Floats) -> Link:
    """The row that comes nearest to the flange (4, 4) in the frame on joint n's axis."""
    x = np.append(_level(flange[:2, 0]), 0.0)
    y = np.array([-x[1], x[0], 0.0])
    return Link(float(np.arctan2(x[1], x[0])), float(flange[2, 3]), float(x @ flange[:3, 3]), _lean(y, flange[:3, 2]))


def _shifted(rows: list[Link]) -> list[Link]:
    """Rows of an mdh-hayati table as dh-craig's: a, α and β come before the next joint; the last row's are dropped."""
    before = [Link(), *rows]
    return [
        replace(row, a=front.a, alpha=front.alpha, beta=front.beta) for front, row in zip(before, rows, strict=False)
    ]


def _row_matrix(row: Link) -> Floats:
    segments: list[Segment] = LinkTable("mdh-hayati", (row,)).segments
    return segment_matrix(segments[1])


def _lean(y: Floats, along: Floats) -> float:
    """α: the turn about x that carries z towards `along`."""
    return float(np.arctan2(-(y @ along), along[2]))


def _level(x: Floats) -> Floats:
    """A direction (2,) of length 1 along `x` (2,), or along X where that has none."""
    length = float(np.hypot(x[0], x[1]))
    return x / length if length > 1e-9 else np.array([1.0, 0.0])


def _sense(likeness: float, length: float) -> float:
    """1 or −1: the sense of the chain's own x; where that is perpendicular, the sense with a ≥ 0."""
    side = likeness if abs(likeness) > 1e-6 else length
    return -1.0 if side < 0.0 else 1.0
