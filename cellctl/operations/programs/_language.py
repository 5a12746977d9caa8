"""A robot program in no language: its motions and their points, and what the module of a language does.

A language's module reads files as `Move`s and writes a point's new numbers and new motions into their text. Goals,
corrections and paths know no more of it than this. Positions are X, Y, Z, A, B, C (mm, deg; Z-Y-X), in the move's base.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, TypeAlias, final

from cellctl.compensation.paths import Segment
from cellctl.files.spans import Span
from cellctl.kinematics import Floats

FrameKind: TypeAlias = Literal["tool", "base"]
Numbers: TypeAlias = tuple[float, ...]
Gives: TypeAlias = Literal["joints", "pose", "place", "orientation"]
"""What of a point is written anew: its joint readings, or all or a part of its position."""


@final
@dataclass(frozen=True, slots=True)
class ProgramPoint:
    """A point with its numbers in the program: a position, or joint readings, deg, as many as are written from A1 on.

    key: its place in the program's files, unique. part: the file. name: of a point without one, its line. status, turn:
    S and T of the posture, None where they are not stated.
    """

    key: Hashable
    part: str
    line: int
    name: str
    position: Numbers | None
    readings: Numbers | None = None
    status: int | None = None
    turn: int | None = None

    @property
    def title(self) -> str:
        """Its name; of one without, its line."""
        return self.name or f"the point in line {self.line}"


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
    """One motion. place: in its file, unique. kind: PTP, LIN, CIRC or SPL, others as written. written_kind: in the
    program's words. start: index of the motion before, None where it is not certain. fault: why its points are not
    understood, else empty. other_way: why its way is no line or circle along which the tool turns evenly, else empty.
    near: joint readings, deg, near which its posture is, None where the program states none. undivided: why no points
    can be inserted on its way, else empty.
    """

    place: int
    line: int
    kind: str
    written_kind: str
    target: ProgramPoint | None
    auxiliary: ProgramPoint | None
    angle_deg: float | None
    tool: Frame
    base: Frame
    start: int | None
    fault: str = ""
    other_way: str = ""
    near: Numbers | None = None
    undivided: str = ""

    @property
    def uses(self) -> tuple[ProgramPoint, ...]:
        """Its points."""
        return tuple(point for point in (self.auxiliary, self.target) if point is not None)


@final
@dataclass(frozen=True, slots=True)
class Unchanged:
    """What stays as it was, and why. part: the file; line: in it."""

    part: str
    line: int
    name: str
    reason: str

    @property
    def words(self) -> str:
        """The point and the reason."""
        named = self.name and not self.reason.startswith(self.name)
        return f"{self.name}: {self.reason}" if named else self.reason


@final
@dataclass(frozen=True, eq=False)
class Insertion:
    """A motion in several parts. base (4, 4): of its points. bound_mm: within which its way is the wanted one then."""

    move: Move
    parts: Sequence[Segment]
    base: Floats
    bound_mm: float

    @property
    def words(self) -> str:
        """For the comment above the new motions."""
        count = len(self.parts) - 1
        within = f"the path is within {self.bound_mm:.3f} mm of the wanted one"
        return f"cellctl: {count} point{'s' * (count > 1)} inserted, {within}"


class Program(Protocol):
    """A program that was read."""

    @property
    def name(self) -> str:
        """The name of the program's own file."""
        ...

    @property
    def names(self) -> Mapping[str, str]:
        """The name of each file by its part; the program itself is the first."""
        ...

    @property
    def moves(self) -> tuple[Move, ...]:
        """All motions of the robot, in the order of the file."""
        ...

    @property
    def own_calibration(self) -> bool:
        """Whether the controller computes positions with its own arm's calibration, not with its maker's data sheet."""
        ...

    @property
    def not_understood(self) -> Iterable[Unchanged]:
        """Lines that are not understood."""
        ...

    def several(self, kind: FrameKind) -> list[str]:
        """The tools or bases of the program's motions, where there are several."""
        ...

    def rewritten(
        self, point: ProgramPoint, values: Mapping[Gives, Floats], turn: int | None
    ) -> tuple[dict[str, str], ProgramPoint]:
        """New numbers of a point by their names, as text, and the point with the numbers as they are rounded.

        values: readings (n,), deg, or poses (4, 4) in the base. turn: the new T, None where it stays.
        """
        ...

    def texts(self, numbers: Mapping[Hashable, Mapping[str, str]], insertions: Sequence[Insertion]) -> dict[str, bytes]:
        """The content of each file with the new numbers of points (by their key) and the motions in parts."""
        ...


class ProgramFiles(Protocol):
    """The files of a program."""

    @property
    def main(self) -> Path:
        """The program itself."""
        ...

    @property
    def read(self) -> list[Path]:
        """All files that are read."""
        ...

    def outputs(self, out: Path) -> dict[str, Path]:
        """Where the changed files go, by part. Raises InputError where `out` does not suit."""
        ...

    def load(self, tool: Numbers | None, base: Numbers | None) -> Program:
        """Read the program. tool, base: stated by a person, for all motions. Raises OSError, and InputError where the
        program is not of its language, or has no place for such a base.
        """
        ...


@final
@dataclass(frozen=True)
class ProgramLanguage:
    """A language in which programs are read and written. suffixes: of its files, lower case.

    files: finds a program's files from its path and that of the controller's data (None where it is not given), raises
    InputError.
    """

    name: str
    suffixes: tuple[str, ...]
    files: Callable[[Path, Path | None], ProgramFiles]


def replacing(texts: Mapping[Span, str], added: Mapping[Span, str]) -> dict[Span, str]:
    """`added` too, in place of the numbers inside its spans."""
    kept = {
        span: text
        for span, text in texts.items()
        if not any(place.start <= span.start and span.end <= place.end for place in added)
    }
    return kept | dict(added)


def surroundings(text: str, span: Span) -> tuple[str, str]:
    """White space before a motion in its line, and the end of line used there."""
    before = text[: span.start].rpartition("\n")[2]
    following = text[span.end :].partition("\n")
    end = "\r\n" if following[0].endswith("\r") or (not following[1] and "\r\n" in text) else "\n"
    return before if not before.strip() else "", end


def is_new_folder(out: Path) -> bool:
    """Whether `out` names a folder that is not there yet, in one that is."""
    return not out.suffix and not out.exists() and out.parent.is_dir()
