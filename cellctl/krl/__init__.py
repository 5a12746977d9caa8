"""KRL, the language of KUKA controllers: files read without loss, points understood, values written."""

from cellctl.krl.expressions import (
    Aggregate,
    Call,
    Expression,
    Field,
    Literal,
    Number,
    Operation,
    Reference,
    references,
)
from cellctl.krl.frame_state import FrameChoice
from cellctl.krl.frames import MotionFrames, frame_values, motion_frames
from cellctl.krl.grammar import aggregate_in, statements
from cellctl.krl.krl_file import KrlFile
from cellctl.krl.points import CARTESIAN, JOINTS, FrameData, Point, point_of, points_of
from cellctl.krl.statements import (
    Assignment,
    Begin,
    Comment,
    Control,
    Declaration,
    Declared,
    End,
    EndFold,
    Fold,
    Header,
    InlineForm,
    Invocation,
    Motion,
    Spline,
    Statement,
    Unknown,
)
from cellctl.krl.tokens import Span

__all__ = [
    "CARTESIAN",
    "JOINTS",
    "Aggregate",
    "Assignment",
    "Begin",
    "Call",
    "Comment",
    "Control",
    "Declaration",
    "Declared",
    "End",
    "EndFold",
    "Expression",
    "Field",
    "Fold",
    "FrameChoice",
    "FrameData",
    "Header",
    "InlineForm",
    "Invocation",
    "KrlFile",
    "Literal",
    "Motion",
    "MotionFrames",
    "Number",
    "Operation",
    "Point",
    "Reference",
    "Span",
    "Spline",
    "Statement",
    "Unknown",
    "aggregate_in",
    "frame_values",
    "motion_frames",
    "point_of",
    "points_of",
    "references",
    "statements",
]
