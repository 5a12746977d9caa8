"""A KRL program as motions: from where to which point, with which tool and base. No mathematics."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, final

from cellctl.krl import (
    CARTESIAN,
    Assignment,
    Begin,
    Control,
    FrameChoice,
    Invocation,
    KrlFile,
    Motion,
    MotionFrames,
    Number,
    Spline,
    Unknown,
    frame_values,
    motion_frames,
)
from cellctl.operations.path_modes import Modes
from cellctl.operations.program_points import Part, ProgramPoints, Written

Kind: TypeAlias = Literal["tool", "base"]
Numbers: TypeAlias = tuple[float, ...]
"""X, Y, Z, A, B, C, mm and degrees."""

_KINDS = {"SPTP": "PTP", "SLIN": "LIN", "SCIRC": "CIRC"}
_STAYS = frozenset(
    {"WAIT", "HALT", "CONTINUE", "TRIGGER", "SIGNAL", "INTERRUPT", "EXT", "EXTFCT", "IF", "SWITCH", "STRUC", "ENUM",
     "CONST_VEL", "TIME_BLOCK", "CONFIRM", "ANOUT", "ANIN", "IMPORT", "CHANNEL", "ON_ERROR_PROCEED"}
)  # fmt: skip
"""Control statements after which the robot is where the motion before left it."""

_MOVE_NOTHING = ("SET_CD_PARAMS", "PULSE")
"""Subprograms of the system in inline forms: collision detection, outputs."""


@final
@dataclass(frozen=True, slots=True)
class Frame:
    """A tool on the flange, or a base in the robot's base frame. numbers: None where it is not certain; reason: why."""

    name: str
    numbers: Numbers | None
    reason: str = ""


@final
@dataclass(frozen=True, slots=True)
class Move:
    """One motion. kind: PTP, LIN, CIRC or SPL, also of SPTP, SLIN, SCIRC; other kinds as written. start: index of the
    motion before, None where it is not certain. orientation, circle: `$ORI_TYPE`, `$CIRC_TYPE`. fault: why its points
    are not understood, else empty.
    """

    statement: Motion
    kind: str
    target: Written | None
    auxiliary: Written | None
    angle_deg: float | None
    tool: Frame
    base: Frame
    orientation: str
    circle: str
    start: int | None
    fault: str = ""

    @property
    def line(self) -> int:
        """Its line in the program."""
        return self.statement.line

    @property
    def uses(self) -> tuple[Written, ...]:
        """Its points."""
        return tuple(point for point in (self.auxiliary, self.target) if point is not None)


@final
@dataclass(frozen=True)
class Program:
    """A program with its data list and the controller's `$config.dat`, None where there is none.

    tool, base: stated by a person, for all motions.
    """

    src: KrlFile
    dat: KrlFile | None
    config: KrlFile | None
    tool: Numbers | None = None
    base: Numbers | None = None

    @cached_property
    def parts(self) -> dict[Part, KrlFile]:
        """Program and data list, if there is one."""
        return {"src": self.src, "dat": self.dat} if self.dat else {"src": self.src}

    @cached_property
    def points(self) -> ProgramPoints:
        """The points that its motions name or write out."""
        return ProgramPoints(self.parts)

    @cached_property
    def data(self) -> tuple[KrlFile, ...]:
        """Files with values: data list, `$config.dat`."""
        return tuple(file for file in (self.dat, self.config) if file)

    @cached_property
    def frames(self) -> dict[int, MotionFrames]:
        """Tool and base of each motion, by its place in the program."""
        return {frames.motion.span.start: frames for frames in motion_frames(self.src, self.data)}

    @cached_property
    def moves(self) -> tuple[Move, ...]:
        """All motions of the robot, in the order of the file."""
        return tuple(_moves(self))

    def several(self, kind: Kind) -> list[str]:
        """The tools or bases of the program's motions, where there are several."""
        found = {_choice(frames, kind) for frames in self.frames.values()}
        names = {
            str(choice.number) if choice.frame is None else "a frame written out"
            for choice in found
            if not choice.reason
        }
        return sorted(names) if len(names) > 1 else []

    def frame(self, motion: Motion, kind: Kind) -> Frame:
        """The tool or base of a motion."""
        found = self.frames[motion.span.start]
        choice, array, stated = _choice(found, kind), f"{kind.upper()}_DATA", getattr(self, kind)
        name = f"{array}[{choice.number}]" if choice.number else f"{kind.upper()}_NO 0" if choice.number == 0 else kind
        if found.fixed_tool:
            return Frame(name, None, "its tool is fixed in the cell (#TCP)")
        if stated is not None:
            return Frame(f"--{kind}", stated)
        if choice.reason:
            return Frame(name, None, f"its {kind} is not certain: {choice.reason}")
        values = frame_values(choice, array, self.data)
        if values is None:
            if self.config:
                cure = f"define it there, give the $config.dat of this controller, or --{kind}"
                return Frame(name, None, f"{name} is not defined in {self.config.name}: {cure}")
            return Frame(name, None, f"{name} is not known: give --config '$config.dat', or --{kind}")
        return Frame(name, tuple(values[label] for label in CARTESIAN))


def _choice(frames: MotionFrames, kind: Kind) -> FrameChoice:
    return frames.tool if kind == "tool" else frames.base


def _moves(program: Program) -> Iterator[Move]:
    """The motions in order. After a label, a branch or the call of a subprogram the place before is not certain."""
    previous, count, modes = None, 0, Modes(program.data)
    for statement in program.src.statements:
        match statement:
            case Motion() if statement.kind != "ASYPTP":
                yield _move(program, statement, modes, previous)
                previous, count = count, count + 1
            case Assignment():
                modes.assign(statement)
            case Invocation() if statement.call.name.upper() == "BAS":
                modes.call(statement.call)
            case Spline():
                modes.spline(statement)
            case Invocation() if statement.call.name.upper() in _MOVE_NOTHING:
                pass
            case Invocation() | Unknown() | Begin():
                previous = None
            case Control() if statement.keyword not in _STAYS:
                previous = None
            case _:
                pass


def _move(program: Program, motion: Motion, modes: Modes, previous: int | None) -> Move:
    faults = ["the motion is relative"] if motion.kind.endswith("_REL") else []
    angle = motion.circular_angle
    if angle is not None and not isinstance(angle, Number):
        faults.append("its circular angle is computed")
    asked = (motion.target, motion.auxiliary) if not faults else ()
    points = [program.points.of(expression) if expression else None for expression in asked]
    faults += [point for point in points if isinstance(point, str)]
    target, auxiliary = [point if isinstance(point, Written) else None for point in [*points, None, None][:2]]
    orientation, circle = modes.of(motion)
    return Move(
        statement=motion,
        kind=_KINDS.get(motion.kind, motion.kind),
        target=target,
        auxiliary=auxiliary,
        angle_deg=angle.value if isinstance(angle, Number) else None,
        tool=program.frame(motion, "tool"),
        base=program.frame(motion, "base"),
        orientation=orientation,
        circle=circle,
        start=previous,
        fault="; ".join(dict.fromkeys(faults)),
    )
