"""What a data file is understood as: rows by kind, joints, σ, sessions, rejected rows, set-up errors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

from pydantic import computed_field

from cellctl.calibration.identification.progress import Progress, silent
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, load_artefact
from cellctl.formats.dataset import DataSet, Sieve, joints_of, text_of
from cellctl.formats.measurements.columns import PLACE, has_own_sigma
from cellctl.formats.measurements.kinds import KINDS, Kind, kinds_of
from cellctl.operations.fit_options import Asked
from cellctl.operations.fitting import NO_CHECK, FitInput, measured_rows, robot_of
from cellctl.operations.robot_suggestion import sample_of
from cellctl.operations.setup_refusals import SetupFiles, refuse_setup_errors, setup_errors
from cellctl.pendant_import import Choices, imported

_CONDITIONS = {"temperature": "temperature", "payload": "payload", "I1": "motor currents"}


@final
@dataclass(frozen=True, eq=False)
class DataFile:
    """A data file as a data set. decided: what an import decided, a sentence each; empty where none was needed.

    left_out: rows of an imported file, with the reason.
    """

    data: DataSet
    decided: tuple[str, ...] = ()
    left_out: tuple[Mapping[str, Any], ...] = ()


@final
@dataclass(frozen=True, eq=False)
class Understood:
    """A data set in figures. rows: of the file. usable: rows for a fit; without a robot, those that can be read.

    joints: their number; unit: `deg` or `rad`, empty without joints. kinds: noun of each kind (`touches`) → rows.
    points: spheres, sockets, … → their names. own_sigma: the rows state their σ. sessions, sets: name → rows. rejected:
    line and reason. problems: why no fit is possible, each with its place and cure. findings: how set-up errors are
    among them. robot: name in the robot file, empty without one.
    """

    file: str
    rows: int
    usable: int
    joints: int
    unit: str
    kinds: Mapping[str, int]
    points: Mapping[str, Sequence[str]]
    own_sigma: bool
    sessions: Mapping[str, int]
    sets: Mapping[str, int]
    conditions: Sequence[str]
    rejected: Sequence[Mapping[str, Any]]
    decided: Sequence[str] = ()
    problems: Sequence[Problem] = ()
    note: str = ""
    robot: str = ""
    checked: bool = False

    def words(self) -> Iterator[tuple[str, str]]:
        """Name and value of each finding, in plain words."""
        yield "File", self.file
        if self.robot:
            yield "Robot", self.robot
        yield "Rows", self._rows_words()
        yield "Joints", f"{self.joints}, in {'degrees' if self.unit == 'deg' else 'radians'}" if self.unit else "none"
        for noun, names in self.points.items():
            yield noun.capitalize(), f"{len(names)}: {_listed(names)}"
        yield "σ", "stated in the rows" if self.own_sigma else "not stated: the robot file's repeatability is used"
        if self.sessions:
            yield "Sessions", _counted(self.sessions)
        yield "Held-out rows", f"by the column set: {_counted(self.sets)}" if self.sets else "chosen in five parts"
        if self.conditions:
            yield "Conditions", ", ".join(self.conditions)
        if self.robot:
            yield "Set-up check", self._check_words()

    @computed_field
    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """The words."""
        return tuple(self.words())

    def _rows_words(self) -> str:
        kinds = _counted({noun: count for noun, count in self.kinds.items() if count}, "{1} {0}")
        rejected = f"; {len(self.rejected)} of {self.rows} cannot be used" if self.rejected else ""
        return f"{kinds or self.rows}{rejected}"

    def _check_words(self) -> str:
        if self.checked:
            return "found an error" if self.problems else "no set-up error found"
        return "not done: the data cannot be used as they are"


def read_data(file: Path, positions: Path | None, choices: Choices, robot: Path | None = None) -> DataFile:
    """A data set, or what `cellctl import` makes of another file: a table, a robot program with measured `positions`.

    Raises InputError where the file is neither, with the errors of the form that it is nearer to.
    """
    if positions is None and _is_data_set(file):
        return DataFile(DataSet.load(file))

    found = imported(file, positions, choices, RobotFile.load(robot) if robot else None)
    left = tuple({"file": row.file, "line": row.line, "reason": row.reason} for row in found.left_out)
    name = f"{file.stem}-imported.csv"
    return DataFile(DataSet.parse(text_of(found.records), name), found.decided, left)


def understand(given: DataFile, robot: Path | None, asked: Asked, progress: Progress = silent) -> Understood:
    """What `given` is understood as, with the set-up check where a robot file is given.

    Problems are part of the result: nothing is raised for wrong data. Raises InputError for a wrong robot file or
    artefact.
    """
    plain = _plain(given)
    if robot is None or plain.problems:
        return plain
    document, robot_file = robot_of(robot)
    input_ = FitInput(document, robot_file, given.data, load_artefact(asked.artefact) if asked.artefact else None)
    named = replace(plain, robot=robot_file.name)
    try:
        return _of_fit(named, input_, asked, progress)
    except InputError as error:
        return replace(named, usable=0, problems=tuple(error.problems), note=error.note)


_CANDIDATE_ROWS = 40
"""Rows with which a robot is tried: 1 s for the right one, 6 s for another; all rows take minutes."""


@final
@dataclass(frozen=True, slots=True)
class Candidate:
    """A robot of the library that the rows can be of once these set-up errors are corrected."""

    name: str
    robot: str
    problems: tuple[Problem, ...]


def candidate_of(
    given: DataFile, robots: Mapping[str, Path], asked: Asked, progress: Progress = silent
) -> Candidate | None:
    """The first of these robots, by name, whose set-up check finds errors that explain the rows; None without one.

    Raises InputError for a wrong artefact.
    """
    artefact = load_artefact(asked.artefact) if asked.artefact else None
    few = sample_of(given.data, _CANDIDATE_ROWS)
    for number, (name, file) in enumerate(robots.items()):
        progress(f"set-up check with {name}", 0.6 + 0.4 * number / len(robots))
        document, robot_file = robot_of(file)
        try:
            measured = measured_rows(FitInput(document, robot_file, few, artefact), asked)
            problems = setup_errors(measured, SetupFiles(document, Path(given.data.file), asked.artefact))
        except InputError:  # too few rows can be of this robot
            continue
        if problems:
            return Candidate(name, robot_file.name, tuple(problems))
    return None


def _plain(given: DataFile) -> Understood:
    """What the columns alone show."""
    data = given.data
    joints, unit = joints_of(data)
    kinds = kinds_of(Sieve(data), None)
    rejected = [{"line": row.line, "reason": row.reason} for row in data.rejected] + [*given.left_out]
    return Understood(
        file=data.file,
        rows=len(data) + len(rejected),
        usable=len(data),
        joints=joints,
        unit=unit,
        kinds=_by_kind(kinds),
        points=_points(data),
        own_sigma=has_own_sigma(data),
        sessions=_counts(data.texts("session")),
        sets=_counts(data.texts("set")),
        conditions=[words for column, words in _CONDITIONS.items() if any(data.texts(column))],
        rejected=rejected,
        decided=given.decided,
        problems=tuple(_lacking(data, joints, kinds)),
    )


def _of_fit(plain: Understood, given: FitInput, asked: Asked, progress: Progress) -> Understood:
    """What a fit would use, and what its set-up check finds."""
    measured = measured_rows(given, asked)
    rejected = [{"line": row.line, "reason": row.reason} for row in measured.rejected]
    imported = [row for row in plain.rejected if "file" in row]
    found = replace(
        plain,
        usable=len(measured.lines),
        kinds=_by_kind(measured.kinds),
        sessions=_counts(measured.texts("session")),
        sets=_counts(measured.sets),
        rejected=[*rejected, *imported],
        checked=True,
    )
    try:
        refuse_setup_errors(
            measured, SetupFiles(given.document, Path(given.data.file), asked.artefact), NO_CHECK, progress
        )
    except InputError as error:
        return replace(found, problems=tuple(error.problems), note=error.note)
    return found


def _is_data_set(file: Path) -> bool:
    """Whether a file has the columns of a data set: joints A1… or q1…, and a measured quantity."""
    try:
        data = DataSet.load(file)
    except InputError:
        return False
    measured = any(data.has(*((kind.point,) if kind.point else kind.columns)) for kind in KINDS.values())
    return bool(joints_of(data)[0]) and measured


def _lacking(data: DataSet, joints: int, kinds: Sequence[Kind]) -> Iterator[Problem]:
    if not joints:
        cure = f"A1, A2, … in degrees or q1, q2, … in radians; columns here: {', '.join(data.columns[:12])}"
        yield Problem(data.file, 1, 0, "has no column with joint readings", cure)
    if "position" in kinds and not data.has(*PLACE):
        cure = f"X, Y, Z in mm, or sphere, plane, socket, anchor; columns here: {', '.join(data.columns[:12])}"
        yield Problem(data.file, 1, 0, "has no column with a measured quantity", cure)


def _by_kind(kinds: Sequence[Kind]) -> dict[str, int]:
    counts = Counter(kinds)
    return {kind.many: counts[name] for name, kind in KINDS.items() if counts[name]}


def _points(data: DataSet) -> dict[str, list[str]]:
    """Names of spheres, planes, sockets and anchors, by their noun."""
    columns = [kind.point for kind in KINDS.values() if kind.point]
    named = {f"{column}s": sorted(set(filter(None, data.texts(column)))) for column in columns}
    return {noun: names for noun, names in named.items() if names}


def _counts(texts: Sequence[str]) -> dict[str, int]:
    return {name: count for name, count in Counter(texts).items() if name}


def _counted(counts: Mapping[str, int], form: str = "{0} ({1} rows)") -> str:
    return ", ".join(form.format(name, count) for name, count in counts.items())


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (" …" if len(names) > 8 else "")
