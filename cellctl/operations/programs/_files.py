"""A program and its files, compensated: shared by `cellctl compensate` and `Model.compensate_program`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self, final

from cellctl.compensation import METHODS
from cellctl.devices import TABLE_CORRECTION_DEG
from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile
from cellctl.formats.table_making import mean_rms_max
from cellctl.operations.compensating import CellRobot, refuse_model, refuse_other_cell
from cellctl.operations.programs._compensated import Changed, CompensatedProgram
from cellctl.operations.programs._compensated import compensate_program as compensated
from cellctl.operations.programs._goals import ProgramRobots
from cellctl.operations.programs._krl import KRL
from cellctl.operations.programs._language import FrameKind, Program, ProgramFiles
from cellctl.operations.programs._paths import Path as ProgramPath
from cellctl.operations.programs._paths import program_paths, program_texts, with_points_between
from cellctl.operations.programs._urscript import URSCRIPT

LANGUAGES = (KRL, URSCRIPT)
"""The languages whose programs are compensated."""


def is_program(path: Path) -> bool:
    """Whether the suffix is that of a robot program whose points can be compensated, or of its data."""
    return any(path.suffix.lower() in language.suffixes for language in LANGUAGES)


def program_files(path: Path, config: Path | None) -> ProgramFiles:
    """The files of a program; config: the controller's data. Raises InputError where `path` is no program, or where a
    file is not there.
    """
    language = next((each for each in LANGUAGES if path.suffix.lower() in each.suffixes), KRL)
    return language.files(path, config)


DEFAULT_TOLERANCE_MM = 0.05

_FRAME = 6
_METHODS = tuple(name for name, each in METHODS.items() if each.write_back is None and not each.position_only)
"""A program's points are whole poses, and its controller computes with its own parameters."""


@final
@dataclass(frozen=True)
class ProgramOptions:
    """Options of `compensate` for programs. config: `$config.dat`. tool, base: X,Y,Z,A,B,C. path_tolerance: mm; points
    are inserted where the deviation is larger, if `insert`. arm_only: the tool is the program's.
    """

    config: Path | None = None
    tool: str | None = None
    base: str | None = None
    path_tolerance: float | None = None
    insert: bool = False
    arm_only: bool = False

    def refuse(self) -> None:
        """Raise InputError if any of them is given: the targets are not a program."""
        given = [f"--{name.replace('_', '-')}" for name, value in vars(self).items() if value]
        if given:
            raise InputError(Problem(given[0], 0, 0, "is for programs (.src, .script)", "leave it out"))


@final
@dataclass(frozen=True, slots=True)
class LeftPlace:
    """A place of a program that stays as it was, and why."""

    file: str
    line: int
    name: str
    reason: str


@final
@dataclass(frozen=True, slots=True)
class PointFigures:
    """A compensated point, see `Changed`. motions: their lines. numbers: its new components, as they are written."""

    file: str
    line: int
    name: str
    motions: tuple[int, ...]
    numbers: dict[str, float]
    correction_mm: float
    correction_deg: float
    before_mm: float
    after_mm: float
    turn: tuple[int, int] | None

    @classmethod
    def of(cls, program: Program, one: Changed) -> Self:
        """The point `one` of `program`."""
        return cls(
            file=program.names[one.point.part],
            line=one.point.line,
            name=one.point.name,
            motions=one.lines,
            numbers={label: float(text) for label, text in one.numbers.items()},
            correction_mm=one.correction_mm,
            correction_deg=one.correction_deg,
            before_mm=one.before_mm,
            after_mm=one.after_mm,
            turn=one.turn,
        )


@final
@dataclass(frozen=True, slots=True)
class PathFigures:
    """The way to a point, see `_paths.Path`; None where `reason` says why a number is not computed.

    bound_mm, undivided_mm: upper bound of the deviation with and without the inserted points.
    """

    line: int
    kind: str
    before_mm: float | None
    bound_mm: float | None
    undivided_mm: float | None
    largest_sample_mm: float | None
    at_share: float | None
    inserted: int
    remarks: tuple[str, ...]
    reason: str

    @classmethod
    def of(cls, path: ProgramPath) -> Self:
        """The figures of `path`."""
        return cls(
            line=path.move.line,
            kind=path.move.written_kind,
            before_mm=_known(path.before_mm),
            bound_mm=_known(path.final_mm),
            undivided_mm=_known(path.bound_mm),
            largest_sample_mm=_known(path.sampled_mm),
            at_share=_known(path.share),
            inserted=0 if path.between is None else len(path.between.sent) - 1,
            remarks=(*path.remarks, *([path.undivided] if path.undivided else [])),
            reason=path.reason,
        )


def _known(number: float) -> float | None:
    return float(number) if math.isfinite(number) else None


@final
@dataclass(frozen=True, slots=True)
class ProgramFigures:
    """A compensated program in figures, each `…_mm` and `…_deg` as mean, RMS and max over the points.

    compensated: number of points. tool_shift_mm: of the identified tool from the taught one, None with the program's
    tool. files: those written.
    """

    method: str
    robot: str
    compensated: int
    left: tuple[LeftPlace, ...]
    correction_mm: dict[str, float]
    correction_deg: dict[str, float]
    before_mm: dict[str, float]
    after_mm: dict[str, float]
    points: tuple[PointFigures, ...]
    path_tolerance_mm: float
    paths: tuple[PathFigures, ...]
    tool_shift_mm: float | None
    files: tuple[str, ...]


@final
@dataclass(frozen=True, eq=False)
class CompensatedFiles:
    """A compensated program, with its paths between the points, and what it was compensated by."""

    program: CompensatedProgram
    paths: list[ProgramPath]
    method: str
    tolerance_mm: float

    def texts(self) -> dict[str, bytes]:
        """The content of the changed files."""
        return program_texts(self.program, self.paths)

    def figures(self, files: Sequence[Path] = ()) -> ProgramFigures:
        """All that is known of the compensated program; files: those written."""
        found, changed = self.program, list(self.program.changed.values())
        robots = found.goals.robots
        return ProgramFigures(
            method=self.method,
            robot=robots.model.robot.name,
            compensated=len(changed),
            left=tuple(LeftPlace(found.file(one), one.line, one.name, one.reason) for one in found.left),
            correction_mm=mean_rms_max([one.correction_mm for one in changed]),
            correction_deg=mean_rms_max([one.correction_deg for one in changed]),
            before_mm=mean_rms_max([one.before_mm for one in changed]),
            after_mm=mean_rms_max([one.after_mm for one in changed]),
            points=tuple(PointFigures.of(found.program, one) for one in changed),
            path_tolerance_mm=self.tolerance_mm,
            paths=tuple(map(PathFigures.of, self.paths)),
            tool_shift_mm=None if robots.arm_only else robots.tool_shift_mm,
            files=tuple(map(str, files)),
        )


def compensate_files(
    identified: ModelFile, name: str, files: ProgramFiles, method: str, options: ProgramOptions, place: CellRobot | None
) -> CompensatedFiles:
    """Compensate the points of a program. name: of the model in errors. place: of the cell that it is for.

    Raises InputError for wrong options and files, and with all reasons if no point can be changed.
    """
    found = _compensated(identified, name, files, method, options, place)
    if not found.changed:
        raise _nothing(found)
    tolerance = DEFAULT_TOLERANCE_MM if options.path_tolerance is None else options.path_tolerance
    return CompensatedFiles(found, _paths(found, options.insert, tolerance, method), method, tolerance)


def refuse_method(method: str) -> None:
    """Raise InputError for a method that is not for programs."""
    if method not in _METHODS:
        raise InputError(Problem("--method", 0, 0, f"'{method}' is not for programs", f"one of: {', '.join(_METHODS)}"))


def _compensated(
    identified: ModelFile, name: str, files: ProgramFiles, method: str, options: ProgramOptions, place: CellRobot | None
) -> CompensatedProgram:
    tool, base = (_frame(name, getattr(options, name)) for name in ("tool", "base"))
    refuse_model(identified, str(files.main))
    if place:
        refuse_other_cell(identified, name, place)
    program = files.load(tool, base)
    _refuse_several(program, options)
    limit = place.correction_deg if place else TABLE_CORRECTION_DEG
    return compensated(program, ProgramRobots(identified, options.arm_only), method=method, limit_deg=limit)


def _refuse_several(program: Program, options: ProgramOptions) -> None:
    """Refuse a stated tool or base that would stand for several of the program."""
    kinds: tuple[FrameKind, ...] = ("tool", "base")
    several = {kind: names for kind in kinds if getattr(options, kind) and (names := program.several(kind))}
    if several:
        raise InputError(
            Problem(f"--{kind}", 0, 0, f"the program uses several: {', '.join(names)}", "give --config '$config.dat'")
            for kind, names in several.items()
        )


def _frame(name: str, text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != _FRAME or not all(math.isfinite(number) for number in numbers):
        raise InputError(Problem(f"--{name}", 0, 0, f"'{text}' is not X,Y,Z,A,B,C", "six numbers, mm and degrees"))
    return numbers


def _paths(found: CompensatedProgram, insert: bool, tolerance: float, method: str) -> list[ProgramPath]:
    paths = program_paths(found)
    return [with_points_between(found, path, tolerance, method) for path in paths] if insert else paths


def _nothing(found: CompensatedProgram) -> Exception:
    """The error where no point can be compensated: every reason, with its place."""
    problems = [Problem(found.file(left), left.line, 0, left.words) for left in found.left]
    if not problems:
        problems = [Problem(next(iter(found.program.names.values())), 0, 0, "has no motion")]
    return InputError(problems, "no point was compensated, nothing was written")
