"""The rows that the tool's measurement records. Joints in degrees, lengths in mm; docs/reference/run-folder.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, final

from cellctl.records import Row, VerdictRow
from procedures.steps.sphere.rows import ContactRow, Joints

ToolSet = Literal["fit", "test"]
Vector = tuple[float, ...]


@final
@dataclass(frozen=True, kw_only=True)
class ToolTouchRow(ContactRow):
    """A touch on the sphere with tool orientation `orientation`, from 0. joints: at the contact.

    set: `fit`, or `test` if its orientation is held out.
    """

    KIND: ClassVar[str] = "tool_touch"
    MEASUREMENT: ClassVar[bool] = True
    set: ToolSet
    orientation: int
    joints: Joints


@final
@dataclass(frozen=True, kw_only=True)
class ToolPoseRow(Row):
    """The joints with the tip at the fixed point, as the operator confirmed them. number: from 0."""

    KIND: ClassVar[str] = "tool_pose"
    MEASUREMENT: ClassVar[bool] = True
    number: int
    joints: Joints


@final
@dataclass(frozen=True, kw_only=True)
class ToolErrorsRow(Row):
    """N contacts: error with the taught tool and with the found one, mm; point fitted alike for both.

    orientation, held_out (N,). Of a touch the signed distance to the surface; of the tip at a point the distance from
    it, both with the contact itself left out of the fit where `held_out`.
    """

    KIND: ClassVar[str] = "tool_errors"
    orientation: tuple[int, ...]
    held_out: tuple[bool, ...]
    taught: tuple[float, ...]
    found: tuple[float, ...]


@final
@dataclass(frozen=True, kw_only=True)
class ToolFigures:
    """The tool's offset in the flange frame, mm: taught, found, found − taught, 1 σ of found; point: base frame, mm.

    orientations, contacts: of the fit. scatter_mm: 1 σ of one contact; common_mm: 1 σ per axis of the error that
    the touches of one orientation share, which is the robot model's (None: not separable).
    """

    taught: Vector
    found: Vector
    difference: Vector
    sigma: Vector
    point: Vector
    orientations: int
    contacts: int
    scatter_mm: float
    common_mm: float | None


@final
@dataclass(frozen=True, kw_only=True)
class ToolVerdict(VerdictRow):
    """Whether the found tool is better than the taught one on held-out contacts."""

    SECTION: ClassVar[tuple[str, ...]] = ("tool",)
    tool: ToolFigures
